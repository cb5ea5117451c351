#include "hold_loops.h"

#include <math.h>
#include <string.h>

#include "kernel.h"

void engine_fade_from_last(engine *e)
{
    int i;

    for (i = 0; i < e->set.outputs; ++i)
        e->from[i] = e->strips[i].last;
    e->since_trip = 0;
}

void lose_hold(engine *e, const trip_cause *cause)
{
    e->hold_off = 1;
    engine_fade_from_last(e);
    engine_tell(e, HOLD_LOST, cause->channel, cause->value, cause->limit, NULL);
}

int is_of_the_hold(const trip_cause *cause)
{
    return cause->kind == GROWTH || cause->kind == EFFORT;
}

int hold_is_good(const engine *e)
{
    return e->set.paths > 0 && e->hold_verified && !e->hold_off;
}

/* Whether the article goes an eighth beyond where it was when the safe state took over, or beyond its envelope if that is more:
   what holds then pushes it. */
static int runs_away(engine *e)
{
    if (e->since_trip <= e->take_over) {
        e->taken_over = larger(e->taken_over, e->sensors.worst);
        return 0;
    }
    return e->sensors.worst > 1.125 * 1.125 * e->taken_over;
}

void watch_hold(engine *e)
{
    trip_cause why = {NO_TRIP, -1, 0, 0};

    e->blind = e->sensors.unhealthy & e->hold_needs ? e->blind + 1 : 0;
    if (e->state != SAFE || !hold_is_good(e))
        return;
    if (runs_away(e)) {
        blame(&why, ENVELOPE, e->sensors.worst_at, sqrt(e->sensors.worst), sqrt(e->taken_over));
        e->hold_verified = 0;
    }
    if (why.kind != NO_TRIP || e->blind > e->set.safe_ramp)
        lose_hold(e, &why);
}

/* What is left of the outputs at the last trip or loss of the hold. */
static real left(const engine *e)
{
    return e->since_trip < e->set.safe_ramp ? 1 - fade_at((long)e->since_trip + 1, (long)e->set.safe_ramp) : 0;
}

real hold_share(const engine *e)
{
    if (e->state == SAFE && !(e->ending && hold_is_good(e)))
        return hold_is_good(e);
    return e->hold_level >= e->set.ramp ? 1 : fade_at((long)e->hold_level, (long)e->set.ramp);
}

/* In SAFE a push that fills a store of momentum fades as room goes: within a safe ramp it takes no more than is left. */
static real kept_from_full(const engine *e, int i, real push)
{
    const real room = e->set.momentum[i] - (push > 0 ? 1 : -1) * e->monitors.momentum[i];
    const real most = larger(room, 0) / (larger((real)e->set.safe_ramp, 1) * e->set.period_s);

    return push > most ? most : push < -most ? -most : push;
}

int engine_holds_whole(const engine *e)
{
    int i;

    for (i = 0; i < e->set.outputs; ++i)
        if (kept_from_full(e, i, e->whole_hold[i]) != e->whole_hold[i])
            return 0;
    return hold_is_good(e);
}

void fade_hold(engine *e)
{
    const real share = hold_share(e), rest = left(e);
    int i;

    for (i = 0; i < e->set.outputs; ++i) {
        const real whole_hold = e->state == SAFE ? kept_from_full(e, i, e->whole_hold[i]) : e->whole_hold[i];

        e->hold[i] = share < 1 || rest > 0 ? rest * e->from[i] + (1 - rest) * share * whole_hold : whole_hold;
    }
}

/* Numbers of the hold that have overflowed: it adds nothing any more, and is none. */
static void overflow_hold(engine *e)
{
    const trip_cause why = {COMMAND_NOT_FINITE, -1, 0, 0};

    memset(e->whole_hold, 0, sizeof e->whole_hold);
    e->hold_spoilt = 1;
    e->hold_verified = 0;
    if (e->state == SAFE && !e->hold_off)
        lose_hold(e, &why);
}

void compute_hold(engine *e)
{
    int i;

    memset(e->whole_hold, 0, sizeof e->whole_hold);
    for (i = 0; i < e->set.paths; ++i) {
        const hold_path *path = &e->set.path[i];

        e->whole_hold[path->output] += through_section(path->s.g, e->hold_state[i], e->sensors.value[path->sensor]);
    }
    if (!all_finite(e->whole_hold, e->set.outputs))
        overflow_hold(e);
    fade_hold(e);
    if (e->ending)
        e->hold_level -= e->hold_level > 0;
    else if (e->state != SAFE)
        e->hold_level += e->hold_level < e->set.ramp;
}

/* Whether a sensor of the hold moves out, and which. The shortest window lets four of them fit into the verification. */
static void look_outwards(engine *e)
{
    const whole shortest = (e->set.verify + 3) / 4;
    int i;

    e->outwards = NOT_OUTWARDS;
    for (i = 0; i < e->set.inputs; ++i) {
        const int needed = e->hold_needs >> i & 1;
        const enum outwards one = needed ? look_for_drift(&e->drift, i, shortest, e->sensors.value[i]) : NOT_OUTWARDS;

        if (one > e->outwards) {
            e->outwards = one;
            e->outwards_at = i;
        }
    }
}

static void lose_verification(engine *e)
{
    e->hold_verified = 0;
    engine_tell(e, HOLD_LOST, e->outwards_at, e->sensors.value[e->outwards_at], 0, NULL);
}

void verify_hold(engine *e, int alone)
{
    if (!alone) {
        forget_drift(&e->drift);
        e->quiet = e->doubted = 0;
        return;
    }
    look_outwards(e);
    e->quiet = e->outwards ? 0 : e->quiet + 1;
    e->doubted = e->outwards || (e->doubted && e->quiet < e->set.verify);
    if (e->hold_verified && e->outwards == OUTWARDS)
        lose_verification(e);
    else if (!e->hold_verified && e->quiet >= e->set.verify) {
        e->hold_verified = 1;
        engine_tell(e, HOLD_VERIFIED, -1, 0, 0, NULL);
    }
}
