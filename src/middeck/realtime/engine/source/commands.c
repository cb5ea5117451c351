/* Commands between two samples. */
#include <math.h>
#include <string.h>

#include "engine.h"

static int same_text(const unsigned char *text, const char name[NAME])
{
    const size_t length = (size_t)text[0] | (size_t)text[1] << 8;

    return memcmp(text + 2, name, length) == 0 && (length == NAME || name[length] == 0);
}

static const unsigned char *after(const unsigned char *text)
{
    return text + 2 + ((size_t)text[0] | (size_t)text[1] << 8);
}

/* The engine's place of each port, by name and unit; null where one is not there. */
static const unsigned char *map_ports(const unsigned char *text, int ports, int *place, const char (*name)[NAME], const char (*unit)[NAME], whole known)
{
    int i, k;

    for (i = 0; i < ports; ++i) {
        const unsigned char *its_unit = after(text);

        for (k = 0; k < known && !(same_text(text, name[k]) && same_text(its_unit, unit[k])); ++k)
            ;
        if (k == known)
            return NULL;
        place[i] = k;
        text = after(its_unit);
    }
    return text;
}

enum answer engine_load(engine *e, int which, size_t count, int with_proof)
{
    slot *s = &e->slots[which];
    const settings *set = &e->set;
    const unsigned char *text;
    enum answer found;

    s->proof.proved = 0;
    found = package_read(&s->p, s->bytes, count);
    if (found != DONE)
        return found;
    if (with_proof && !proof_read(&s->proof, s->proof_bytes, s->p.hash, e->hold_hash))
        return BAD_PROOF;
    if (fabs(s->p.period_s - set->period_s) > 1e-9 * set->period_s)
        return OTHER_RATE;
    text = map_ports(after(s->p.texts), s->p.law.inputs, s->sensor, set->sensor, set->sensor_unit, set->inputs);
    if (!text || !map_ports(text, s->p.law.outputs, s->output, set->output, set->output_unit, set->outputs))
        return UNKNOWN_PORT;
    found = package_replay(&s->p, &s->law);
    if (found != DONE)
        return found;
    if (s->p.law.ramp < set->ramp)
        s->p.law.ramp = (long)set->ramp;
    return DONE;
}

enum answer engine_loaded(engine *e, int which, enum answer found)
{
    slot *s = &e->slots[which];

    if (found == DONE && on_blacklist(e, s->p.law_hash))
        found = ON_BLACKLIST;
    s->loaded = found == DONE;
    engine_tell(e, s->loaded ? LOADED : REFUSED, -1, (real)which, 0, s->p.hash);
    return found;
}

static enum answer stand_by(engine *e, slot *s)
{
    if (!s->loaded)
        return NOT_LOADED;
    if (on_blacklist(e, s->p.law_hash))
        return ON_BLACKLIST;
    if (!s->running) {
        law_reset(&s->law, &s->p.law);
        s->law.engaged = 0;
        s->law.within = (long)e->set.leave;
        s->running = 1;
    }
    s->leaving = 0;
    return DONE;
}

/* Of two laws at once no gate proves an adaptive gain. */
static int may_adapt(const engine *e, const slot *s, real share)
{
    const slot *acting = foremost(e);

    return proof_covers(&s->proof, &e->set, share) && (!acting || acting == s);
}

/* Rise to a share of full authority, 1 for all; whoever is in control fades out meanwhile. */
static enum answer engage(engine *e, slot *s, real share)
{
    enum answer found;
    int k;

    if (e->state == SAFE)
        return NOT_READY;
    if (!(share > 0 && share <= 1))
        return OUT_OF_RANGE;
    if (e->adaptive_on && s->loaded && !may_adapt(e, s, share))
        return NOT_PROVED;
    if (e->set.paths && (e->hold_level < e->set.ramp || (e->set.verify && !e->hold_verified)))
        return NOT_READY; /* it is judged beside the whole hold, on which SAFE is to fall back */
    found = stand_by(e, s);
    if (found != DONE)
        return found;
    for (k = 0; k < SLOTS; ++k)
        if (e->slots[k].running)
            e->slots[k].law.engaged = e->slots[k].in_control = &e->slots[k] == s;
    s->law.top = (long)ceil(share * (real)s->p.law.ramp);
    engine_tell(e, ENGAGED, -1, share, 0, s->p.hash);
    return DONE;
}

/* Fade out, then stop: a slot that stands by stops at once, and may be loaded again. One that does not run may be the loader's. */
static void leave(slot *s)
{
    if (!s->running)
        return;
    s->in_control = s->law.engaged = 0;
    s->leaving = s->law.level > 0;
    s->running = s->leaving;
}

static enum answer disengage(engine *e)
{
    int k;

    if (e->state == SAFE)
        return NOT_READY;
    for (k = 0; k < SLOTS; ++k)
        leave(&e->slots[k]);
    return DONE;
}

static enum answer reset(engine *e, real trip)
{
    if (e->state != SAFE)
        return NOT_READY;
    if (trip != (real)e->trip)
        return WRONG_TRIP;
    if (e->sensors.unhealthy)
        return STILL_UNHEALTHY;
    e->hold_level = engine_holds_whole(e) ? e->set.ramp : 0; /* it holds already, or rises */
    if (e->hold_level == 0 && e->hold_verified && !e->hold_off) /* a wheel is full: it has been let go in part */
        engine_fade_from_last(e);
    e->state = READY;
    e->trip = 0;
    e->hold_off = 0;
    monitors_forget(&e->monitors);
    engine_tell(e, RESET_DONE, -1, trip, 0, NULL);
    return DONE;
}

static enum answer excite(engine *e, real periods)
{
    if (e->state == SAFE)
        return NOT_READY;
    if (!e->waveform_samples)
        return NO_WAVEFORM;
    if (!(periods >= 0 && periods < 1e9) || (real)(whole)periods != periods)
        return OUT_OF_RANGE;
    if (e->playing)
        return BUSY; /* to begin anew would be a step */
    e->playing = 1;
    e->silencing = 0;
    e->playing_at = 0;
    e->periods_left = (whole)periods;
    engine_tell(e, EXCITED, -1, periods, 0, NULL);
    return DONE;
}

static enum answer silence(engine *e)
{
    if (!e->silencing)
        e->loud_level = e->set.ramp;
    e->silencing = 1;
    return DONE;
}

/* One that is still let go holds on to what it held: another value would be a step. */
static void hold_strip(strip *s, int on)
{
    if (on && !s->hold && s->held_share == 0)
        s->held = s->last;
    s->hold = on;
}

/* Not in SAFE, which knows no strip: an offset there would move what no reset has freed. */
static enum answer set_strip(engine *e, whole output, const real value[4])
{
    strip *s;

    if (e->state == SAFE)
        return NOT_READY;
    if (output < 0 || output >= e->set.outputs || !(value[1] - value[1] == 0))
        return OUT_OF_RANGE;
    s = &e->strips[output];
    if (e->adaptive_on && ((value[0] == STRIP_HOLD && value[1] != 0) || ((value[0] == STRIP_GAIN || value[0] == STRIP_LIMIT) && value[1] != 1)))
        return NOT_PROVED;
    if (value[0] == STRIP_GAIN && fabs(value[1]) <= 10)
        s->gain_to = value[1];
    else if (value[0] == STRIP_OFFSET && value[1] >= e->set.lower[output] && value[1] <= e->set.upper[output])
        s->offset_to = value[1];
    else if (value[0] == STRIP_LIMIT && value[1] > 0 && value[1] <= 1)
        s->limit_to = value[1];
    else if (value[0] == STRIP_HOLD && (value[1] == 0 || value[1] == 1))
        hold_strip(s, value[1] != 0);
    else
        return OUT_OF_RANGE;
    return DONE;
}

/* Whether a strip lets through all that it is given, shifted at most. */
static int passes_all(const strip *s)
{
    return s->gain == 1 && s->gain_to == 1 && s->limit == 1 && s->limit_to == 1 && !s->hold && s->held_share == 0;
}

/* Only beside a package of which it is proved, and then only such a one engages; no strip has a gain, limit or hold besides. */
static enum answer adapt(engine *e, int on)
{
    int i, k, covered = 0, plain = 1;

    for (k = 0; k < SLOTS; ++k)
        covered |= e->slots[k].loaded && proof_covers(&e->slots[k].proof, &e->set, 1);
    for (i = 0; i < e->set.outputs; ++i)
        plain &= passes_all(&e->strips[i]);
    if (e->set.adaptive.monitor < 0)
        return NOT_ADAPTIVE;
    if (e->state != SAFE && e->state != READY) /* else its gain would jump */
        return NOT_READY;
    if (on && !(covered && plain))
        return NOT_PROVED;
    e->adaptive_on = on;
    e->gain = on ? e->set.adaptive.least : 1;
    return DONE;
}

static enum answer forgive(engine *e, const slot *s)
{
    if (e->state != SAFE && e->state != READY)
        return NOT_READY;
    take_off_blacklist(e, s->p.law_hash);
    return DONE;
}

static enum answer carry_out(engine *e, const command *c)
{
    const int needs_slot = c->kind == STANDBY || c->kind == ENGAGE || c->kind == FORGIVE;

    if (needs_slot && (c->slot < 0 || c->slot >= SLOTS))
        return WRONG_SLOT;
    switch (c->kind) {
    case RESET:
        return reset(e, c->value[0]);
    case STANDBY:
        return stand_by(e, &e->slots[c->slot]);
    case ENGAGE:
        return engage(e, &e->slots[c->slot], c->value[0]);
    case DISENGAGE:
        return disengage(e);
    case EXCITE:
        return excite(e, c->value[0]);
    case SILENCE:
        return silence(e);
    case STRIP:
        return set_strip(e, c->slot, c->value);
    case ADAPT:
        return adapt(e, c->value[0] != 0);
    case FORGIVE:
        return forgive(e, &e->slots[c->slot]);
    default:
        return UNKNOWN_COMMAND;
    }
}

enum answer engine_command(engine *e, const command *c)
{
    const enum answer found = carry_out(e, c);

    engine_settle(e); /* the next command may come before the next sample */
    return found;
}
