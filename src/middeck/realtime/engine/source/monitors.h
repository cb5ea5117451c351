/* Band power and growth of channels, effort and momentum of outputs. */
#ifndef MIDDECK_MONITORS_H
#define MIDDECK_MONITORS_H

#include "trip.h"

typedef struct {
    real section[MONITORS][2][2];
    real power[MONITORS];     /* running mean square in the band */
    real sum[MONITORS];       /* of squares in the window so far */
    whole filled[MONITORS];   /* samples of the window so far */
    real before[MONITORS];    /* mean square of the last window */
    whole grown[MONITORS];    /* successive windows that grew */
    whole effort[CHANNELS], effort_before[CHANNELS]; /* samples at the limit in this half window and the last */
    whole effort_filled;
    real momentum[CHANNELS];
} monitor_states;

void monitors_start(monitor_states *m);

/* Forget what has grown and how long limits have been reached; filters and momentum stay. */
void monitors_forget(monitor_states *m);

/* Monitors of sensors (outputs: 0) or of outputs (1), whose channels stand in v. */
void monitors_look(monitor_states *m, const settings *set, int outputs, const real *v, trip_cause *cause);

/* Outputs as written; a bit of ``saturated`` for each at a limit. */
void monitors_effort(monitor_states *m, const settings *set, const real *u, uint64_t saturated, trip_cause *cause);

#endif
