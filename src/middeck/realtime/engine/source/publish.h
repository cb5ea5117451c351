/* What the engine tells: events, records, its state and its answers. */
#ifndef MIDDECK_PUBLISH_H
#define MIDDECK_PUBLISH_H

#include "engine.h"
#include "mapped.h"

void publish_events(shared *f, engine *e);
void publish_status(shared *f, const engine *e);

/* The last sample: into the ring, and before a trip into the ring that a trip freezes. */
void publish_record(shared *f, const engine *e, const real *y, whole late_ns, whole step_ns);

/* What a command has changed is seen before its answer, which may come before its turn. */
void answer_command(shared *f, engine *e, const command *c, enum answer answer);

/* All commands up to this number have been answered. */
void acknowledge(shared *f, whole number);

#endif
