#include "engine.h"

#include <math.h>
#include <string.h>

int acts(const slot *s)
{
    return s->running && s->law.level > 0;
}

/* A jump beyond a sensor's range is the sensor's; who was half there has been driven. */
int of_a_law(const engine *e, const trip_cause *cause)
{
    switch (cause->kind) {
    case ENVELOPE:
    case GROWTH:
    case BAND_POWER:
    case EFFORT:
    case MOMENTUM:
        return 1;
    case COMMAND_NOT_FINITE:
        return cause->channel >= 0; /* else the hold's */
    case RANGE:
        return fabs(e->sensors.value[cause->channel]) > e->set.range[cause->channel] / 2;
    default:
        return 0;
    }
}

const slot *foremost(const engine *e)
{
    const slot *found = NULL;
    int k;

    for (k = 0; k < SLOTS; ++k)
        if (acts(&e->slots[k]) && (!found || e->slots[k].law.level > found->law.level))
            found = &e->slots[k];
    return found;
}

void engine_ban(engine *e, const unsigned char *hashes, whole count)
{
    memcpy(e->blacklist, hashes, 32 * (size_t)count);
    e->blacklisted = count;
}

static int listed(const engine *e, const unsigned char *hash)
{
    whole k;

    for (k = 0; k < e->blacklisted; ++k)
        if (memcmp(e->blacklist[k], hash, 32) == 0)
            return 1;
    return 0;
}

/* A full list refuses all that is not forgiven; so nothing ever drops out of it. */
void put_on_blacklist(engine *e, const unsigned char *hash)
{
    if (listed(e, hash))
        return;
    if (e->blacklisted < HASHES)
        memcpy(e->blacklist[e->blacklisted++], hash, 32);
    engine_tell(e, BLACKLISTED, -1, 0, 0, hash);
}

int on_blacklist(const engine *e, const unsigned char *hash)
{
    return listed(e, hash) || e->blacklisted > HASHES - SLOTS; /* no room for who trips next */
}

void take_off_blacklist(engine *e, const unsigned char *hash)
{
    whole k, kept = 0;

    for (k = 0; k < e->blacklisted; ++k)
        if (memcmp(e->blacklist[k], hash, 32) != 0)
            memcpy(e->blacklist[kept++], e->blacklist[k], 32);
    e->blacklisted = kept;
}
