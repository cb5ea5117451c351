/* Commands in their order, but for those that make safe, which wait for none. */
#ifndef MIDDECK_QUEUE_H
#define MIDDECK_QUEUE_H

#include "engine.h"
#include "loader.h"
#include "mapped.h"

/* Of the engine's one file: the commands that have been carried out before their turn, and the package under way. */
typedef struct {
    loading load;
    int under_way;
    whole early[COMMANDS]; /* numbers of commands carried out, or withdrawn, before their turn */
} queue;

/* Carry out what is due; 1 where the end was asked for. */
int take_commands(queue *q, shared *f, engine *e);

/* Whether a command waits that may be carried out before the next sample. */
int command_is_due(const queue *q, const shared *f, const engine *e);

#endif
