/* What engine and supervisor share: one file, mapped by both.
 *
 * Every field takes eight bytes (or a text of whole eights), so that there is no padding and the layout is the same in
 * C and in header.py, which a test compares. Regions follow each other in the order of "places". A word is written by
 * one side only; the other reads it by the atomics of mapped.h.
 */
#ifndef MIDDECK_SHARED_H
#define MIDDECK_SHARED_H

#include <stdint.h>

typedef double real;
typedef int64_t whole;

enum { MAGIC = 0x4b44524d, FORMAT = 5 }; /* FORMAT: of a rig's datagrams; of the shared file it is LAYOUT, a check of these declarations */
enum { ASKED = 0x4b44524e, ANSWERED = 0x4b44524f }; /* what the checks of a rig's datagrams begin with: no echo is an answer */
enum { REFUSED_FORMAT = 0x4b445250 }; /* what the check of a refusal begins with, in every format */
enum { CHANNELS = 64, SECTIONS = 256, SLOTS = 2, MONITORS = 256, SPREADS = 32, COMMANDS = 256, EVENTS = 1024, HASHES = 1024, NAME = 64, FAULTS = 16 };

enum clock_kind { LOCKSTEP, REAL_TIME };
enum rig_kind { LINEAR_RIG, UDP_RIG, DRIVER_RIG };
enum state { SAFE, READY, IDENTIFY, ENGAGING, CONTROL, DISENGAGING };

/* Why the loop went to SAFE. */
enum trip {
    NO_TRIP, POWER_UP, STOP, NOT_FINITE, RANGE, STUCK, SPREAD, ENVELOPE, GROWTH, BAND_POWER, EFFORT, MOMENTUM, HEARTBEAT,
    LATENESS, NO_ANSWER, COMMAND_NOT_FINITE, RIG_DEAD, OTHER_FORMAT
};

/* What happened that is no trip: kinds of events from here on. */
enum happening { RESET_DONE = 100, LOADED, ENGAGED, IN_CONTROL, DISENGAGED, EXCITED, QUIET, HOLD_VERIFIED, HOLD_LOST, BLACKLISTED, REFUSED, ENDED };

enum command_kind { NO_COMMAND, RESET, LOAD, STANDBY, ENGAGE, DISENGAGE, EXCITE, SILENCE, STRIP, ADAPT, FORGIVE, END };
enum strip_word { STRIP_GAIN, STRIP_OFFSET, STRIP_LIMIT, STRIP_HOLD };

/* Why a command was not carried out; text in commands.py. */
enum answer {
    DONE, UNKNOWN_COMMAND, WRONG_SLOT, NOT_LOADED, NOT_READY, WRONG_TRIP, STILL_UNHEALTHY, BUSY, OUT_OF_RANGE, ON_BLACKLIST,
    NO_WAVEFORM, NOT_ADAPTIVE, WITHDRAWN, NOT_PROVED, OTHER_SESSION, BAD_HASH = 50, BAD_MAGIC, BAD_FORMAT, BAD_SIZE, BAD_LENGTH, BAD_NUMBER, BAD_LIMIT, BAD_PLACE,
    BAD_TEXT, BAD_PADDING, SINGLE_PRECISION, INNER_LOOP, OTHER_RATE, UNKNOWN_PORT, BAD_VECTORS, NO_BYTES, OTHER_BYTE_ORDER,
    NAME_TWICE, UNDECLARED_POLE, BAD_PROOF, CUT_SHORT, TOO_LONG
};

/* out = (b0 + b1/z + b2/z^2) / (1 + a1/z + a2/z^2), as of a package. */
typedef struct {
    real g[5]; /* b0 b1 b2 a1 a2 */
} section;

/* A section of the loop that holds the article: from a sensor to an output. */
typedef struct {
    whole sensor, output;
    section s;
} hold_path;

/* Band-passed signal of a channel: sensors first, then outputs. */
typedef struct {
    whole channel;
    section band[2];
    real forget;  /* share of the last sample in the running mean square */
    real limit;   /* rms that trips; inf for none */
    real floor;   /* rms of a window below which nothing is called growth */
    real factor;  /* growth of rms from one window to the next that counts; 0 for no growth trip */
    whole window; /* samples */
    whole times;  /* successive windows that must grow */
} monitor;

typedef struct {
    whole first, second; /* sensors that read one thing */
    real limit;
    whole samples; /* for so long */
} spread;

/* Gain of the compensator between least and most, moved by a monitor's rms: down above loud, up below quiet. */
typedef struct {
    whole monitor; /* -1 for none */
    real quiet, loud, least, most;
    real rate; /* most change a sample */
} adaptive;

typedef struct {
    whole inputs, outputs, clock, rig;
    real period_s;
    char sensor[CHANNELS][NAME], sensor_unit[CHANNELS][NAME], output[CHANNELS][NAME], output_unit[CHANNELS][NAME];
    real range[CHANNELS];    /* magnitude that no healthy sensor reaches */
    whole stuck[CHANNELS];   /* samples of one and the same value that no healthy sensor gives; 0 for no test */
    real envelope[CHANNELS]; /* amplitude that trips: the root of value^2 + (coast * rate)^2 */
    whole rate[CHANNELS];    /* sensor of its rate; -1 for none */
    real coast[CHANNELS];    /* how far it goes on in the safe state, for a unit of its rate */
    whole spreads;
    spread spread[SPREADS];
    whole monitors;
    monitor monitor[MONITORS];
    adaptive adaptive;
    real lower[CHANNELS], upper[CHANNELS], slew[CHANNELS]; /* of each output; slew a sample */
    real effort_forget;   /* share of the last sample in the running mean square of an output's share of its limit; 0 for no test */
    real effort_share;    /* rms of that share that trips */
    real momentum[CHANNELS]; /* magnitude of an output's integral beyond which no further push is allowed */
    real stored[CHANNELS];   /* of that integral at the start */
    whole paths;
    hold_path path[SECTIONS];
    whole verify;      /* samples of quiet holding after which the hold is verified; 0: never */
    whole ramp;        /* least samples of a fade, and of a strip's change */
    whole leave;       /* most samples in which a law that leaves fades out, whatever its own ramp */
    whole safe_ramp;   /* samples to zero, or from the last command to the hold */
    whole heartbeat;   /* samples of silence that trip; 0 for no test */
    whole late_ns;     /* lateness that counts */
    whole late_most;   /* samples late in a row that trip */
    whole answer_ms;   /* patience with a rig in lockstep */
    whole port;        /* of a rig over UDP, on the loopback interface */
    whole processor;   /* to stay on in real time; -1 for any */
    whole priority;    /* FIFO priority in real time; 0 for none */
} settings;

/* Numbers of the linear article that the engine steps itself: x+ = A x + B u + G w, y = C x + n. */
typedef struct {
    whole states, pairs; /* pairs: -1 for a dense A */
    whole noises;
    whole seed;
    real sensor_noise[CHANNELS]; /* rms */
    whole faults;
    struct {
        whole kind, channel, from, until; /* samples, until excluded */
        real value;
    } fault[FAULTS];
} article;

enum fault_kind {
    SENSOR_NAN, SENSOR_ADD, SENSOR_STUCK, SENSOR_DRIFT, SENSOR_GAIN, SENSOR_LATE, SENSOR_DROP, SENSOR_SWAP, SENSOR_NOISE, ENCODER_WRAP,
    OUTPUT_DEAD, OUTPUT_GAIN, OUTPUT_STUCK, OUTPUT_LIMIT, RIG_SILENT, RIG_DIES
};

typedef struct {
    whole number, session, at, kind, slot;
    real value[4];
    whole check; /* of the words before it: FNV-1a, a word at a time */
} command;

typedef struct {
    whole number, sample, answer, detail;
} acknowledgement;

typedef struct {
    whole sequence, sample, kind, channel;
    real value, limit;
    unsigned char hash[32]; /* of the package in control; of the law that goes on the blacklist */
} event;

/* One sample: this head, then doubles: sensors; outputs; hold; excitation; for each slot what it adds, then what it would
   add at full authority; the adaptive gain. */
typedef struct {
    whole sequence; /* sample + 1, written last */
    whole state, trip, slots; /* slots: two bits each, 1 running, 2 in control */
    whole saturated, unhealthy; /* a bit for each output, sensor */
    whole late_ns, step_ns;
} record_head;

/* Written by the supervisor. */
typedef struct {
    whole until;     /* lockstep: run to this sample and wait */
    whole heartbeat; /* any change is a beat */
    whole stop;      /* asks: any change is a STOP; anybody may add one */
    whole written;   /* commands given */
    whole taken;     /* records read */
    whole keeps;     /* whether they are kept: on its way out a lockstep engine overwrites none of them unread */
    whole supervisor; /* its process: a lockstep engine ends with it */
    whole supervisor_born; /* when that began, in ticks of the system */
    whole session; /* a number of chance, of whoever commands now: a command of another one is refused */
} asks;

/* Written by the engine. */
typedef struct {
    whole pid, born, running; /* born: when the process began, in ticks of the system */
    whole sample, state, trip, trips;
    whole acknowledged, events;
    whole alive; /* changes with every sample */
    whole late, worst_late_ns, worst_step_ns, lost, missed, stale; /* lost: records overwritten before they were read; missed: samples that did not come; stale: datagrams of other sessions and other rigs, dropped by engine and rig */
    whole hold_verified, frozen, frozen_at;
    real momentum[CHANNELS]; /* what each output has stored */
    whole loaded[SLOTS];
    unsigned char slot_hash[SLOTS][32];
    whole blacklisted;
    unsigned char blacklist[HASHES][32]; /* of laws */
    whole real_time; /* what the system granted: 1 priority, 2 locked memory, 4 processor */
} status;

/* Offsets of the regions from the start of the file, and their sizes. */
typedef struct {
    whole magic, layout, size, status; /* these keep their places in every build, and the first two words of status */
    whole settings, article, article_numbers, article_count;
    whole asks;
    whole commands, acknowledgements, events;
    whole stride; /* bytes of a record */
    whole ring, ring_count;
    whole pretrip, pretrip_count;
    whole waveform, waveform_samples;
    whole blacklist, blacklist_count; /* hashes of laws that are refused from the start */
    whole staging, staging_size;
} places;

#endif
