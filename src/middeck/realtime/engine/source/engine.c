#include "engine.h"

#include <float.h>
#include <string.h>

#include "kernel.h"

void engine_start(engine *e, const settings *set, const real *waveform, whole waveform_samples)
{
    int i;

    memset(e, 0, sizeof *e);
    e->set = *set;
    e->waveform = waveform;
    e->waveform_samples = waveform_samples;
    e->state = SAFE;
    e->cause.kind = POWER_UP;
    e->since_trip = set->safe_ramp;
    e->gain = 1;
    sensors_start(&e->sensors);
    monitors_start(&e->monitors);
    for (i = 0; i < set->outputs; ++i)
        e->strips[i].gain = e->strips[i].gain_to = e->strips[i].limit = e->strips[i].limit_to = 1;
    for (i = 0; i < set->paths; ++i)
        e->hold_needs |= (uint64_t)1 << set->path[i].sensor;
}

void engine_tell(engine *e, whole kind, whole channel, real value, real limit, const unsigned char *hash)
{
    event *one;

    if (e->happenings == (int)(sizeof e->happened / sizeof *e->happened))
        return;
    one = &e->happened[e->happenings++];
    memset(one, 0, sizeof *one);
    one->sample = e->sample;
    one->kind = kind;
    one->channel = channel;
    one->value = value;
    one->limit = limit;
    if (hash)
        memcpy(one->hash, hash, sizeof one->hash);
}

static slot *in_control(engine *e)
{
    int k;

    for (k = 0; k < SLOTS; ++k)
        if (e->slots[k].running && e->slots[k].in_control)
            return &e->slots[k];
    return NULL;
}

/* Trips that a compensator can cause. */
static int of_a_law(whole kind)
{
    return kind == ENVELOPE || kind == GROWTH || kind == BAND_POWER || kind == EFFORT || kind == MOMENTUM || kind == COMMAND_NOT_FINITE;
}

static void put_on_blacklist(engine *e, const unsigned char *hash)
{
    if (e->blacklisted == HASHES) { /* the oldest goes */
        memmove(e->blacklist, e->blacklist + 1, sizeof e->blacklist - sizeof *e->blacklist);
        --e->blacklisted;
    }
    memcpy(e->blacklist[e->blacklisted++], hash, 32);
    engine_tell(e, BLACKLISTED, -1, 0, 0, hash);
}

static void go_safe(engine *e, const trip_cause *cause)
{
    slot *blamed = in_control(e);
    int i, k;

    engine_tell(e, cause->kind, cause->channel, cause->value, cause->limit, blamed ? blamed->p.hash : NULL);
    e->state = SAFE;
    e->cause = *cause;
    e->trip = ++e->trips;
    e->since_trip = 0;
    e->hold_off = 0;
    e->playing = 0;
    for (i = 0; i < e->set.outputs; ++i)
        e->at_trip[i] = e->strips[i].last;
    for (k = 0; k < SLOTS; ++k) {
        if (e->slots[k].running && of_a_law(cause->kind) && (e->slots[k].in_control || e->slots[k].law.level > 0))
            put_on_blacklist(e, e->slots[k].p.hash);
        e->slots[k].running = e->slots[k].in_control = 0;
    }
    monitors_forget(&e->monitors);
}

static int hold_is_good(const engine *e)
{
    return e->set.paths > 0 && e->hold_verified && !e->hold_off && !(e->sensors.unhealthy & e->hold_needs);
}

static void compute_hold(engine *e)
{
    int i;

    memset(e->hold, 0, sizeof e->hold);
    for (i = 0; i < e->set.paths; ++i) {
        const hold_path *path = &e->set.path[i];

        e->hold[path->output] += through_section(path->s.g, e->hold_state[i], e->sensors.value[path->sensor]);
    }
}

/* From the last command to the verified hold, else to zero. */
static void safe_command(const engine *e, real *u)
{
    const int good = hold_is_good(e);
    const real left = e->since_trip < e->set.safe_ramp ? 1 - fade_at((long)e->since_trip + 1, (long)e->set.safe_ramp) : 0;
    int i;

    for (i = 0; i < e->set.outputs; ++i)
        u[i] = left * e->at_trip[i] + (good ? (1 - left) * e->hold[i] : 0);
}

static void play(engine *e)
{
    int i;

    memset(e->excitation, 0, sizeof e->excitation);
    if (!e->playing)
        return;
    for (i = 0; i < e->set.outputs; ++i)
        e->excitation[i] = e->waveform[e->playing_at * e->set.outputs + i];
    if (++e->playing_at < e->waveform_samples)
        return;
    e->playing_at = 0;
    if (e->periods_left && --e->periods_left == 0) {
        e->playing = 0;
        engine_tell(e, QUIET, -1, 0, 0, NULL);
    }
}

static void run_laws(engine *e, real *command_of_all)
{
    int i, k;

    for (k = 0; k < SLOTS; ++k) {
        slot *s = &e->slots[k];
        real y[CHANNELS], u[CHANNELS];

        memset(e->added[k], 0, sizeof e->added[k]);
        memset(e->wanted[k], 0, sizeof e->wanted[k]);
        if (!s->running)
            continue;
        for (i = 0; i < s->p.law.inputs; ++i)
            y[i] = e->sensors.value[s->sensor[i]];
        law_compute(&s->law, &s->p.law, y, e->adaptive_on ? e->gain : 1, u);
        for (i = 0; i < s->p.law.outputs; ++i) {
            e->added[k][s->output[i]] = u[i];
            e->wanted[k][s->output[i]] = s->law.wanted[i];
            command_of_all[s->output[i]] += u[i];
        }
    }
}

/* Each law learns what of the torque was the compensators'. */
static void commit_laws(engine *e)
{
    int i, k;

    for (k = 0; k < SLOTS; ++k) {
        slot *s = &e->slots[k];
        real applied[CHANNELS];

        if (!s->running)
            continue;
        for (i = 0; i < s->p.law.outputs; ++i) {
            const int o = s->output[i];

            applied[i] = e->u[o] - e->hold[o] - e->excitation[o] - e->strips[o].offset;
        }
        law_commit(&s->law, &s->p.law, applied);
    }
}

static real towards(real value, real aim, real step)
{
    return aim > value + step ? value + step : aim < value - step ? value - step : aim;
}

/* Gain and offset, hold, slew, limit. */
static void through_strips(engine *e, const real *command, real *u)
{
    const real step = 1 / (real)(e->set.ramp > 0 ? e->set.ramp : 1);
    int i;

    e->saturated = 0;
    for (i = 0; i < e->set.outputs; ++i) {
        strip *s = &e->strips[i];
        const real least = e->set.lower[i] * s->limit, most = e->set.upper[i] * s->limit;
        real t = s->gain * command[i] + s->offset;

        s->gain = towards(s->gain, s->gain_to, step);
        s->limit = towards(s->limit, s->limit_to, step);
        s->offset = towards(s->offset, s->offset_to, step * e->set.upper[i]);
        if (s->hold && e->state != SAFE)
            t = s->last;
        u[i] = limited(t, 0, s->last, e->set.slew[i], least, most);
        if (u[i] <= least || u[i] >= most)
            e->saturated |= (uint64_t)1 << i;
        s->last = u[i];
    }
}

static int all_finite(const real *v, whole count)
{
    whole i;

    for (i = 0; i < count; ++i)
        if (!(v[i] - v[i] == 0))
            return 0;
    return 1;
}

static void look_around(engine *e, const circumstances *c, trip_cause *cause)
{
    if (c->stop)
        blame(cause, STOP, -1, 0, 0);
    if (c->rig_dead)
        blame(cause, RIG_DEAD, -1, 0, 0);
    if (c->no_answer)
        blame(cause, NO_ANSWER, -1, 0, 0);
    if (c->silent)
        blame(cause, HEARTBEAT, -1, 0, (real)e->set.heartbeat);
    if (c->late)
        blame(cause, LATENESS, -1, (real)c->late_ns, (real)e->set.late_ns);
}

/* A trip in SAFE is none anew; but what grows there while the hold holds is the hold's. */
static void judge(engine *e, const trip_cause *cause)
{
    if (cause->kind == NO_TRIP)
        return;
    if (e->state != SAFE) {
        go_safe(e, cause);
    } else if (hold_is_good(e) && e->since_trip > e->set.safe_ramp && cause->kind == GROWTH) {
        e->hold_off = 1;
        e->hold_verified = 0;
        e->since_trip = 0;
        memcpy(e->at_trip, e->u, sizeof e->at_trip);
        engine_tell(e, HOLD_LOST, cause->channel, cause->value, cause->limit, NULL);
    }
}

static void adapt(engine *e)
{
    const adaptive *a = &e->set.adaptive;
    real power;

    if (!e->adaptive_on)
        return;
    power = e->monitors.power[a->monitor];
    if (power > a->high * a->high)
        e->gain = towards(e->gain, 0, a->rate);
    else if (power < a->low * a->low)
        e->gain = towards(e->gain, a->most, a->rate);
}

void engine_settle(engine *e)
{
    slot *s = in_control(e);
    const enum state before = e->state;

    if (before == SAFE)
        return;
    if (s && s->law.level < s->law.top)
        e->state = ENGAGING;
    else if (s)
        e->state = CONTROL;
    else if (e->slots[0].running && e->slots[0].law.level > 0)
        e->state = DISENGAGING;
    else if (e->slots[1].running && e->slots[1].law.level > 0)
        e->state = DISENGAGING;
    else
        e->state = e->playing ? IDENTIFY : READY;
    if (before == ENGAGING && e->state == CONTROL)
        engine_tell(e, IN_CONTROL, -1, 0, 0, s->p.hash);
    if (before == DISENGAGING && e->state != DISENGAGING && !s)
        engine_tell(e, DISENGAGED, -1, 0, 0, NULL);
}

/* The hold is verified by holding, alone and without a trip. */
static void verify_hold(engine *e)
{
    if (e->state != READY || e->hold_verified || !e->set.paths || !e->set.verify)
        e->quiet = 0;
    else if (++e->quiet >= e->set.verify) {
        e->hold_verified = 1;
        engine_tell(e, HOLD_VERIFIED, -1, 0, 0, NULL);
    }
}

void engine_sample(engine *e, const real *y, const circumstances *c, real *u)
{
    trip_cause cause = {NO_TRIP, -1, 0, 0}, after = {NO_TRIP, -1, 0, 0};
    real command[CHANNELS];
    int i;

    look_around(e, c, &cause);
    sensors_look(&e->sensors, &e->set, y, &cause);
    monitors_look(&e->monitors, &e->set, 0, e->sensors.value, &cause);
    judge(e, &cause);
    adapt(e);
    compute_hold(e);
    play(e);
    memset(command, 0, sizeof command);
    run_laws(e, command);
    for (i = 0; i < e->set.outputs; ++i)
        command[i] = e->hold[i] + command[i] + e->excitation[i];
    if (e->state != SAFE && !all_finite(command, e->set.outputs)) {
        blame(&cause, COMMAND_NOT_FINITE, -1, 0, 0);
        go_safe(e, &cause);
    }
    if (e->state == SAFE)
        safe_command(e, command);
    through_strips(e, command, e->u);
    commit_laws(e);
    monitors_look(&e->monitors, &e->set, 1, e->u, &after);
    monitors_effort(&e->monitors, &e->set, e->u, e->saturated, &after);
    judge(e, &after);
    engine_settle(e);
    verify_hold(e);
    e->since_trip += e->since_trip < INT64_MAX;
    memcpy(u, e->u, (size_t)e->set.outputs * sizeof *u);
    ++e->sample;
}

void engine_record(const engine *e, const real *y, real *numbers)
{
    const size_t o = (size_t)e->set.outputs;
    const real *columns[4 + 2 * SLOTS - 1];
    int k, count = 0;

    memcpy(numbers, y, (size_t)e->set.inputs * sizeof *y);
    numbers += e->set.inputs;
    columns[count++] = e->u;
    columns[count++] = e->hold;
    columns[count++] = e->excitation;
    for (k = 0; k < SLOTS; ++k) {
        columns[count++] = e->added[k];
        columns[count++] = e->wanted[k];
    }
    for (k = 0; k < count; ++k, numbers += o)
        memcpy(numbers, columns[k], o * sizeof *numbers);
    *numbers = e->adaptive_on ? e->gain : 1;
}
