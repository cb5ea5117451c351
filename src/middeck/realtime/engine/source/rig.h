/* What the engine drives: the simulated article in this process, one in another process over UDP, or hardware. */
#ifndef MIDDECK_RIG_H
#define MIDDECK_RIG_H

#include "shared.h"

/* Missed: no sample this time; lost: there will be none; foreign: none, as it speaks another format. */
enum rig_answer { RIG_READ, RIG_MISSED, RIG_LOST, RIG_FOREIGN };

typedef struct rig {
    /* Sensors now, in the settings' order and units. In real time it must not wait. */
    enum rig_answer (*read)(struct rig *r, real *y);
    /* Outputs from now on, and a number that changes with every sample: where it stands still, the rig must bring its
       outputs to zero by itself. */
    enum rig_answer (*write)(struct rig *r, const real *u, whole alive);
    void (*close)(struct rig *r);
    const settings *set;
} rig;

/* Each returns null where it cannot open, after saying why on the standard error. */
rig *open_linear_rig(const settings *set, const article *a, const real *numbers, whole count);
rig *open_udp_rig(const settings *set, whole session, whole *stale);
rig *open_driver(const settings *set);

#endif
