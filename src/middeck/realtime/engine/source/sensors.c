#include "sensors.h"

#include <math.h>
#include <string.h>

void sensors_start(sensor_tests *s, const settings *set, uint64_t held_by)
{
    int i;

    memset(s, 0, sizeof *s);
    for (i = 0; i < set->inputs; ++i)
        s->reach[i] = set->envelope[i] < HUGE_VAL || !(held_by >> i & 1) ? set->envelope[i] : set->range[i] / 2;
}

static void look_at_one(sensor_tests *s, const settings *set, int i, real y, trip_cause *cause)
{
    const int finite = y - y == 0;

    s->same[i] = finite && y == s->last[i] ? s->same[i] + 1 : 0;
    s->last[i] = y;
    if (!finite)
        blame(cause, NOT_FINITE, i, y, 0);
    else if (y > set->range[i] || y < -set->range[i])
        blame(cause, RANGE, i, y, set->range[i]);
    else if (set->stuck[i] && s->same[i] >= set->stuck[i])
        blame(cause, STUCK, i, y, (real)set->stuck[i]);
    else {
        s->value[i] = y;
        return;
    }
    s->unhealthy |= (uint64_t)1 << i;
}

void sensors_miss(sensor_tests *s)
{
    s->unhealthy = ~(uint64_t)0;
}

void sensors_look(sensor_tests *s, const settings *set, const real *y, trip_cause *cause)
{
    int i, k;

    s->unhealthy = 0;
    for (i = 0; i < set->inputs; ++i)
        look_at_one(s, set, i, y[i], cause);
    for (k = 0; k < set->spreads; ++k) {
        const spread *p = &set->spread[k];
        const real apart = s->value[p->first] - s->value[p->second];

        s->apart[k] = apart > p->limit || apart < -p->limit ? s->apart[k] + 1 : 0;
        if (s->apart[k] >= p->samples) {
            s->unhealthy |= (uint64_t)1 << p->first | (uint64_t)1 << p->second;
            blame(cause, SPREAD, p->first, apart, p->limit);
        }
    }
    s->worst = 0;
    for (i = 0; i < set->inputs; ++i) {
        const real ahead = set->rate[i] < 0 ? 0 : set->coast[i] * s->value[set->rate[i]];
        const real square = s->value[i] * s->value[i] + ahead * ahead;
        const real share = square / (s->reach[i] * s->reach[i]);

        if (square > set->envelope[i] * set->envelope[i])
            blame(cause, ENVELOPE, i, sqrt(square), set->envelope[i]);
        if (share > s->worst) {
            s->worst = share;
            s->worst_at = i;
        }
    }
}
