/* The loop without clock, rig and shared file: one sample in, one sample out. */
#ifndef MIDDECK_ENGINE_H
#define MIDDECK_ENGINE_H

#include "monitors.h"
#include "slow_drift.h"
#include "package.h"
#include "sensors.h"

static inline real larger(real a, real b)
{
    return a > b ? a : b;
}

static inline int all_finite(const real *v, whole count)
{
    whole i;

    for (i = 0; i < count; ++i)
        if (!(v[i] - v[i] == 0))
            return 0;
    return 1;
}

/* A place for a package, and the law that runs from it. */
typedef struct {
    unsigned char bytes[LARGEST_PACKAGE];
    unsigned char proof_bytes[PROOF];
    package p;
    gain_proof proof;
    law_state law;
    int sensor[CHANNELS], output[CHANNELS]; /* of the engine, for each port of the package */
    int loaded, running, in_control;
    int leaving; /* stops when it has faded out */
} slot;

/* What each output's value passes on its way out. */
typedef struct {
    real gain, gain_to, offset, offset_to, limit, limit_to; /* limit: share of the output's range */
    int hold;
    real held, held_share; /* what it is held at, and how far */
    real last;             /* as written */
} strip;

/* What the world tells the engine with a sample. */
typedef struct {
    int stop, silent, late, no_answer, rig_dead, foreign; /* each: 1 where it is so; foreign: dead for its format */
    whole late_ns;
} circumstances;

typedef struct {
    settings set;
    whole sample;
    enum state state;
    whole trip, trips; /* number of the trip that holds it in SAFE, and of all so far */
    trip_cause cause;
    sensor_tests sensors;
    monitor_states monitors;
    slot slots[SLOTS];
    real hold_state[SECTIONS][2];
    unsigned char hold_hash[32];
    uint64_t hold_needs;         /* sensors that the hold reads */
    int hold_verified, hold_off; /* off: lost in SAFE, until a reset */
    int hold_spoilt;             /* its numbers have overflowed, once and for all */
    whole hold_level;            /* of the ramp on which the hold rises after a reset */
    whole blind;                 /* successive samples in which the hold lacked a sensor */
    whole quiet;                 /* samples of holding so far */
    drift_states drift;
    enum outwards outwards;      /* whether what the hold holds moves out, and which sensor says so */
    int outwards_at;
    int doubted;                 /* it may have moved out, and has not been quiet again for as long as a verification takes */
    whole since_trip;            /* or since the hold was lost */
    whole take_over;             /* samples until the safe state has taken over */
    real taken_over;             /* largest amplitude over its reach, squared, when the safe state took over */
    real from[CHANNELS];         /* outputs at the last trip or loss of the hold */
    strip strips[CHANNELS];
    const real *waveform;
    whole waveform_samples, periods_left, playing_at; /* playing_at: next sample of it */
    int playing, silencing;
    whole loud_level;            /* of the ramp along which it is silenced */
    int ending;                  /* on the way out: the hold falls */
    real gain;                   /* adaptive */
    int adaptive_on;
    long faded; /* level of the law that acted in the last sample */
    unsigned char blacklist[HASHES][32]; /* of laws */
    whole blacklisted;
    /* of the last sample, for the record */
    real whole_hold[CHANNELS], hold[CHANNELS]; /* the latter as it rises and falls */
    real excitation[CHANNELS], added[SLOTS][CHANNELS], wanted[SLOTS][CHANNELS], u[CHANNELS];
    uint64_t saturated;
    real law_share[CHANNELS]; /* of its own limit or slew that a compensator takes */
    /* what happened in it */
    event happened[16];
    int happenings;
} engine;

/* Hashes of laws that are refused from the start. */
void engine_ban(engine *e, const unsigned char *hashes, whole count);

/* ``e`` is all zeros, as static storage is: clearing its rooms for packages would take the memory of both at every start. */
void engine_start(engine *e, const settings *set, const real *waveform, whole waveform_samples);

/* One sample: sensors y to outputs u. */
void engine_sample(engine *e, const real *y, const circumstances *c, real *u);

/* Carry out a command between two samples: all but LOAD and END. */
enum answer engine_command(engine *e, const command *c);

/* Check ``count`` bytes that stand in a slot that does not run, and the proof beside them if there is one, and map its ports:
   DONE, or why not. Takes long, and touches
   nothing but the slot, which the loop then leaves alone: it may run beside it. */
enum answer engine_load(engine *e, int which, size_t count, int with_proof);

/* The loop learns what `engine_load` has found, and gives its own answer. */
enum answer engine_loaded(engine *e, int which, enum answer found);

/* On the way out: to SAFE, and from there along the ramp to outputs of zero, where the engine is at rest. */
void engine_end(engine *e);
int engine_at_rest(const engine *e);

/* Whether SAFE applies the hold, and all that it asks for. */
int engine_holds_whole(const engine *e);

/* From now on the hold, or zero, takes over from what the outputs are. */
void engine_fade_from_last(engine *e);

/* The state that slots and excitation make, where it is not SAFE. */
void engine_settle(engine *e);

void engine_tell(engine *e, whole kind, whole channel, real value, real limit, const unsigned char *hash);

/* Whether the compensator in a slot has moved anything. */
int acts(const slot *s);

/* Whether a trip is held against the compensators that act, and which of them has the most authority; null if none acts. */
int of_a_law(const engine *e, const trip_cause *cause);
const slot *foremost(const engine *e);

/* Laws that are refused: those that have caused a trip, until they are forgiven. */
void put_on_blacklist(engine *e, const unsigned char *hash);
int on_blacklist(const engine *e, const unsigned char *hash);
void take_off_blacklist(engine *e, const unsigned char *hash);

/* Fill a record of the last sample. */
void engine_record(const engine *e, const real *y, real *numbers);

#endif
