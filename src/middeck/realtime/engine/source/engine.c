#include "engine.h"

#include <math.h>
#include <string.h>

#include "hold_loops.h"
#include "kernel.h"

enum { RAMPS = 5, COASTS = 4 }; /* the safe state has taken over after so many of its ramps, and of the longest coast */

static void make_neutral(strip *s)
{
    s->gain = s->gain_to = s->limit = s->limit_to = 1;
    s->offset = s->offset_to = s->held_share = 0;
    s->hold = 0;
}

static int is_neutral(const strip *s)
{
    return s->gain == 1 && s->gain_to == 1 && s->limit == 1 && s->limit_to == 1 && s->offset == 0 && s->offset_to == 0 && !s->hold && s->held_share == 0;
}

void engine_start(engine *e, const settings *set, const real *waveform, whole waveform_samples)
{
    int i;

    e->set = *set;
    e->waveform = waveform;
    e->waveform_samples = waveform_samples;
    e->state = SAFE;
    e->cause.kind = POWER_UP;
    e->since_trip = set->safe_ramp;
    e->gain = 1;
    monitors_start(&e->monitors, set);
    e->drift.begun = 1;
    forget_drift(&e->drift);
    e->take_over = RAMPS * set->safe_ramp;
    for (i = 0; i < set->inputs; ++i)
        if (COASTS * set->coast[i] / set->period_s > (real)e->take_over)
            e->take_over = (whole)(COASTS * set->coast[i] / set->period_s);
    for (i = 0; i < set->outputs; ++i)
        make_neutral(&e->strips[i]);
    for (i = 0; i < set->paths; ++i)
        e->hold_needs |= (uint64_t)1 << set->path[i].sensor;
    sensors_start(&e->sensors, set, e->hold_needs);
    hash_hold(set, e->hold_hash);
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

static void stop_slot(slot *s)
{
    s->running = s->in_control = s->leaving = 0;
}

static void go_safe(engine *e, const trip_cause *cause)
{
    const int lawful = of_a_law(e, cause), alone = e->state == READY;
    const slot *blamed = foremost(e);
    int i, k;

    engine_tell(e, cause->kind, cause->channel, cause->value, cause->limit, blamed ? blamed->p.hash : NULL);
    e->state = SAFE;
    e->cause = *cause;
    e->trip = ++e->trips;
    e->hold_off = 0;
    e->taken_over = 1;
    e->playing = 0;
    engine_fade_from_last(e);
    for (i = 0; i < e->set.outputs; ++i)
        make_neutral(&e->strips[i]);
    for (k = 0; k < SLOTS; ++k) {
        if (lawful && acts(&e->slots[k]))
            put_on_blacklist(e, e->slots[k].p.law_hash);
        stop_slot(&e->slots[k]);
    }
    if (alone && e->hold_verified && (is_of_the_hold(cause) || e->doubted)) {
        e->hold_verified = 0;
        lose_hold(e, cause);
    }
    monitors_forget(&e->monitors);
}

/* The hold, or what is left on the way to zero. */
static void safe_command(engine *e, real *u)
{
    fade_hold(e); /* anew: SAFE may be as young as this sample's compensators */
    memcpy(u, e->hold, (size_t)e->set.outputs * sizeof *u);
}

/* How much of the waveform sounds: it falls along the ramp while it is silenced. */
static real loudness(engine *e)
{
    if (!e->silencing)
        return 1;
    e->loud_level -= e->loud_level > 0;
    return e->loud_level > 0 ? fade_at((long)e->loud_level, (long)e->set.ramp) : 0;
}

static void play(engine *e)
{
    const real share = e->playing ? loudness(e) : 0;
    int i;

    memset(e->excitation, 0, sizeof e->excitation);
    if (!e->playing)
        return;
    for (i = 0; share > 0 && i < e->set.outputs; ++i)
        e->excitation[i] = share * e->waveform[e->playing_at * e->set.outputs + i];
    e->playing_at = (e->playing_at + 1) % e->waveform_samples;
    if (share > 0 && !(e->playing_at == 0 && e->periods_left && --e->periods_left == 0))
        return;
    e->playing = 0;
    engine_tell(e, QUIET, -1, 0, 0, NULL);
}

/* Share of the limit on u's side, or of the slew: what saturates is at one. */
static real share_taken(real u, real last, real slew, real least, real most)
{
    const real size = u > 0 ? u / most : u < 0 ? u / least : 0;

    return larger(size, fabs(u - last) / slew);
}

/* Whether this law has a say, from this slot or the other. */
static int has_a_say(const engine *e, const slot *s)
{
    int k;

    for (k = 0; k < SLOTS; ++k)
        if ((acts(&e->slots[k]) || e->slots[k].in_control) && memcmp(e->slots[k].p.law_hash, s->p.law_hash, 32) == 0)
            return 1;
    return 0;
}

/* A compensator whose numbers overflow adds nothing any more: it trips where its law has a say, and stops standing by. */
static void refuse_overflow(engine *e, slot *s, trip_cause *cause)
{
    if (!acts(s))
        put_on_blacklist(e, s->p.law_hash);
    if (has_a_say(e, s))
        blame(cause, COMMAND_NOT_FINITE, e->set.inputs + s->output[0], s->law.wanted[0], 0);
    else
        stop_slot(s);
}

static void run_law(engine *e, int k, real *sum, trip_cause *cause)
{
    slot *s = &e->slots[k];
    const law_tables *t = &s->p.law;
    real y[CHANNELS], u[CHANNELS];
    int i;

    for (i = 0; i < t->inputs; ++i)
        y[i] = e->sensors.value[s->sensor[i]];
    law_compute(&s->law, t, y, e->adaptive_on ? e->gain : 1, u);
    if (!all_finite(s->law.wanted, t->outputs))
        refuse_overflow(e, s, cause);
    for (i = 0; i < t->outputs; ++i) {
        const int o = s->output[i];

        e->added[k][o] = u[i];
        e->wanted[k][o] = s->law.wanted[i];
        sum[o] += u[i];
        if (acts(s))
            e->law_share[o] = larger(e->law_share[o], share_taken(u[i], s->law.last[i], t->slew[i], t->least[i], t->most[i]));
    }
}

static void run_laws(engine *e, real *sum, trip_cause *cause)
{
    int k;

    memset(e->law_share, 0, sizeof e->law_share);
    for (k = 0; k < SLOTS; ++k) {
        memset(e->added[k], 0, sizeof e->added[k]);
        memset(e->wanted[k], 0, sizeof e->wanted[k]);
        if (e->slots[k].running)
            run_law(e, k, sum, cause);
    }
    if (!all_finite(sum, e->set.outputs))
        blame(cause, COMMAND_NOT_FINITE, e->set.inputs, sum[0], 0);
}

/* Each law learns what of the output was the compensators'. Beside another, or without a say, its own slew goes on from what it
   has added itself: who stands by adds nothing, whatever limits did to the hold. */
static void commit_laws(engine *e, const real *asked, const real *sum)
{
    const int both = e->slots[0].running && e->slots[1].running;
    int i, k;

    for (k = 0; k < SLOTS; ++k) {
        slot *s = &e->slots[k];
        const int own = both || !acts(s);
        real applied[CHANNELS];

        if (!s->running)
            continue;
        for (i = 0; i < s->p.law.outputs; ++i) {
            const int o = s->output[i];

            applied[i] = e->u[o] == asked[o] ? sum[o] : e->u[o] - e->hold[o] - e->excitation[o] - e->strips[o].offset;
        }
        law_commit(&s->law, &s->p.law, applied);
        for (i = 0; own && i < s->p.law.outputs; ++i)
            s->law.last[i] = e->added[k][s->output[i]];
    }
}

static real towards(real value, real aim, real step)
{
    return aim > value + step ? value + step : aim < value - step ? value - step : aim;
}

static void move_strip(strip *s, real step, real range)
{
    s->gain = towards(s->gain, s->gain_to, step);
    s->limit = towards(s->limit, s->limit_to, step);
    s->offset = towards(s->offset, s->offset_to, step * range / 2);
    s->held_share = towards(s->held_share, s->hold ? 1 : 0, step);
}

/* Gain, offset and hold, which SAFE has none of; slew, limit. */
static void through_strips(engine *e, const real *command, real *share)
{
    const real step = 1 / (real)(e->set.ramp > 0 ? e->set.ramp : 1);
    int i;

    e->saturated = 0;
    for (i = 0; i < e->set.outputs; ++i) {
        strip *s = &e->strips[i];
        const real last = s->last;
        real least, most, t;

        move_strip(s, step, e->set.upper[i] - e->set.lower[i]);
        least = e->set.lower[i] * s->limit;
        most = e->set.upper[i] * s->limit;
        t = s->gain * command[i] + s->offset;
        if (s->held_share > 0)
            t = s->held_share * s->held + (1 - s->held_share) * t;
        e->u[i] = s->last = limited(t, 0, last, e->set.slew[i], least, most);
        share[i] = larger(share_taken(s->last, last, e->set.slew[i], least, most), e->law_share[i]);
        if (share[i] >= 1)
            e->saturated |= (uint64_t)1 << i;
    }
}

static void look_around(engine *e, const circumstances *c, trip_cause *cause)
{
    if (c->stop)
        blame(cause, STOP, -1, 0, 0);
    if (c->rig_dead)
        blame(cause, c->foreign ? OTHER_FORMAT : RIG_DEAD, -1, 0, 0);
    if (c->no_answer)
        blame(cause, NO_ANSWER, -1, 0, 0);
    if (c->silent)
        blame(cause, HEARTBEAT, -1, 0, (real)e->set.heartbeat);
    if (c->late)
        blame(cause, LATENESS, -1, (real)c->late_ns, (real)e->set.late_ns);
}

/* A trip in SAFE is none anew, but a STOP is, which no reset of an earlier one may undo. What grows there, or takes all effort,
   while the hold holds is the hold's, whatever else is seen before it. */
static void judge(engine *e, const trip_cause *cause, const trip_cause *growing)
{
    if (cause->kind == NO_TRIP)
        return;
    if (e->state != SAFE) {
        go_safe(e, cause);
        return;
    }
    if (cause->kind == STOP) {
        e->trip = ++e->trips;
        e->cause = *cause;
        engine_tell(e, STOP, -1, 0, 0, NULL);
    }
    if (hold_is_good(e) && e->since_trip > e->set.safe_ramp && is_of_the_hold(growing)) {
        lose_hold(e, growing);
        e->hold_verified = 0;
    }
}

static slot *in_control(engine *e)
{
    int k;

    for (k = 0; k < SLOTS; ++k)
        if (e->slots[k].running && e->slots[k].in_control)
            return &e->slots[k];
    return NULL;
}

/* The product of fade and gain acts: the gain stands still while the fade moves, and begins anew where no law acts. */
static void adapt(engine *e)
{
    const adaptive *a = &e->set.adaptive;
    const slot *s = foremost(e);
    const long level = s ? s->law.level : 0;
    const int fades = level != e->faded;
    real power;

    e->faded = level;
    if (!e->adaptive_on)
        return;
    if (!s)
        e->gain = a->least;
    if (!s || fades)
        return;
    power = e->monitors.power[a->monitor];
    if (power > a->loud * a->loud)
        e->gain = towards(e->gain, a->least, a->rate);
    else if (power < a->quiet * a->quiet)
        e->gain = towards(e->gain, a->most, a->rate);
}

void engine_settle(engine *e)
{
    slot *s = in_control(e);
    const enum state before = e->state;
    int k;

    if (before == SAFE)
        return;
    for (k = 0; k < SLOTS; ++k)
        if (e->slots[k].leaving && e->slots[k].law.level == 0)
            stop_slot(&e->slots[k]);
    if (s && s->law.level != s->law.top)
        e->state = ENGAGING;
    else if (s)
        e->state = CONTROL;
    else if (foremost(e))
        e->state = DISENGAGING;
    else
        e->state = e->playing ? IDENTIFY : READY;
    if (before == ENGAGING && e->state == CONTROL)
        engine_tell(e, IN_CONTROL, -1, 0, 0, s->p.hash);
    if (before == DISENGAGING && e->state != DISENGAGING && !s)
        engine_tell(e, DISENGAGED, -1, 0, 0, NULL);
}

static int strips_are_neutral(const engine *e)
{
    int i;

    for (i = 0; i < e->set.outputs; ++i)
        if (!is_neutral(&e->strips[i]))
            return 0;
    return 1;
}

/* Whether nothing but the hold is at work, whole, as SAFE would have it. */
static int holds_alone(const engine *e)
{
    return e->state == READY && e->set.paths && e->set.verify && e->hold_level >= e->set.ramp && strips_are_neutral(e);
}

static void look(engine *e, const real *y, const circumstances *c)
{
    trip_cause cause = {NO_TRIP, -1, 0, 0}, growing = {NO_TRIP, -1, 0, 0};

    look_around(e, c, &cause);
    if (c->no_answer || c->rig_dead)
        sensors_miss(&e->sensors);
    else
        sensors_look(&e->sensors, &e->set, y, &cause);
    monitors_look(&e->monitors, &e->set, 0, e->sensors.value, &cause, &growing);
    judge(e, &cause, &growing);
    watch_hold(e);
}

void engine_sample(engine *e, const real *y, const circumstances *c, real *u)
{
    trip_cause cause = {NO_TRIP, -1, 0, 0}, after = {NO_TRIP, -1, 0, 0}, growing = {NO_TRIP, -1, 0, 0};
    real command[CHANNELS], sum[CHANNELS], share[CHANNELS];
    int i;

    look(e, y, c);
    adapt(e);
    compute_hold(e);
    play(e);
    memset(sum, 0, sizeof sum);
    run_laws(e, sum, &cause);
    for (i = 0; i < e->set.outputs; ++i)
        command[i] = e->hold[i] + sum[i] + e->excitation[i];
    if (e->state != SAFE && (e->hold_spoilt || !all_finite(command, e->set.outputs)))
        blame(&cause, COMMAND_NOT_FINITE, -1, 0, 0);
    judge(e, &cause, &growing);
    if (e->state == SAFE)
        safe_command(e, command);
    through_strips(e, command, share);
    commit_laws(e, command, sum);
    e->since_trip += e->since_trip < INT64_MAX;
    monitors_look(&e->monitors, &e->set, 1, e->u, &after, &growing);
    monitors_effort(&e->monitors, &e->set, e->u, share, &after, &growing);
    judge(e, &after, &growing);
    engine_settle(e);
    verify_hold(e, holds_alone(e));
    memcpy(u, e->u, (size_t)e->set.outputs * sizeof *u);
    ++e->sample;
}

void engine_end(engine *e)
{
    const trip_cause told = {STOP, -1, 0, 0};

    if (e->state != SAFE)
        go_safe(e, &told);
    e->ending = 1;
    e->hold_level = e->set.ramp;
}

int engine_at_rest(const engine *e)
{
    int i;

    for (i = 0; i < e->set.outputs; ++i)
        if (e->strips[i].last != 0)
            return 0;
    return hold_share(e) == 0;
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
