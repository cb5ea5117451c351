/* Band power and growth of channels, effort and momentum of outputs. */
#ifndef MIDDECK_MONITORS_H
#define MIDDECK_MONITORS_H

#include "sensors.h"

typedef struct {
    real section[MONITORS][2][2];
    int settled[MONITORS];    /* whether the sections have seen a sample */
    real power[MONITORS];     /* running mean square in the band */
    real sum[MONITORS];       /* of squares in the window so far */
    whole filled[MONITORS];   /* samples of the window so far */
    real before[MONITORS];    /* mean square of the last window; below zero: there was none */
    whole grown[MONITORS];    /* successive windows that grew */
    real effort[CHANNELS];    /* running mean square of the share of the limit */
    real momentum[CHANNELS];
} monitor_states;

void monitors_start(monitor_states *m, const settings *set);

/* Forget what has grown and how long limits have been reached; filters, power and momentum stay. */
void monitors_forget(monitor_states *m);

/* Monitors of sensors (outputs: 0) or of outputs (1), whose channels stand in v. "growing" is the first that grows, or takes all
   effort, whatever else is seen before it. */
void monitors_look(monitor_states *m, const settings *set, int outputs, const real *v, trip_cause *cause, trip_cause *growing);

/* Outputs as written, and for each the share of its limit that it takes. */
void monitors_effort(monitor_states *m, const settings *set, const real *u, const real *share, trip_cause *cause, trip_cause *growing);

/* Whether an output's integral is beyond what may be stored, and u would add to it. */
int monitors_full(const monitor_states *m, const settings *set, int output, real u);

#endif
