#include "package.h"

#include <string.h>

enum { MARK = 8, HASH = 32, BOUNDS = MARK + 2 * HASH, SEAL = BOUNDS + 3 * (int)sizeof(real) };
static const real ROUNDING = 1e-9; /* of the rate, which is one a sample there and one a second here */

void hash_hold(const settings *set, unsigned char digest[32])
{
    static struct {
        char sensor[NAME], output[NAME];
        section s;
    } paths[SECTIONS];
    int i;

    for (i = 0; i < set->paths; ++i) {
        memcpy(paths[i].sensor, set->sensor[set->path[i].sensor], NAME);
        memcpy(paths[i].output, set->output[set->path[i].output], NAME);
        paths[i].s = set->path[i].s;
    }
    sha256((const unsigned char *)paths, (size_t)set->paths * sizeof *paths, digest);
}

int proof_read(gain_proof *found, const unsigned char *bytes, const unsigned char package_hash[32], const unsigned char hold_hash[32])
{
    unsigned char seal[HASH];
    real bounds[3];

    found->proved = 0;
    sha256(bytes, SEAL, seal);
    if (memcmp(bytes, "MIDDECKG", MARK) != 0 || memcmp(bytes + MARK, package_hash, HASH) != 0 || memcmp(bytes + MARK + HASH, hold_hash, HASH) != 0
        || memcmp(bytes + SEAL, seal, HASH) != 0)
        return 0;
    memcpy(bounds, bytes + BOUNDS, sizeof bounds);
    found->least = bounds[0];
    found->most = bounds[1];
    found->rate = bounds[2];
    found->proved = 1;
    return 1;
}

int proof_covers(const gain_proof *found, const settings *set, real share)
{
    const adaptive *a = &set->adaptive;

    return found->proved && share * a->least >= found->least && a->most <= found->most && a->rate <= found->rate * set->period_s * (1 + ROUNDING);
}
