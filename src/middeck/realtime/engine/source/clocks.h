/* The two clocks around one and the same sample. */
#ifndef MIDDECK_CLOCKS_H
#define MIDDECK_CLOCKS_H

#include <signal.h>

#include "engine.h"
#include "mapped.h"
#include "rig.h"

/* Set by a signal that asks for the end. */
extern volatile sig_atomic_t asked_to_end;

/* What has been seen of the supervisor's words. */
typedef struct {
    whole stop, heartbeat, silent, until;
    enum rig_answer written; /* what the rig said to the last outputs */
    whole missed;            /* successive samples that did not come, or outputs that did not go */
    int lost;                /* whether the last said that there will be none any more */
    int has_read;            /* whether there has been a sample */
} watch;

whole now_ns(void);

/* Read, compute, write, publish. */
void one_sample(shared *f, engine *e, rig *r, watch *w, circumstances *c);

/* As far as the supervisor lets it, as fast as it can; returns where the supervisor is gone. */
void run_in_lockstep(shared *f, engine *e, rig *r);

/* By the clock, with what the system grants of priority, memory and processor. */
void run_in_real_time(shared *f, engine *e, rig *r);

#endif
