/* Commands in their order, and the thread that checks a package beside the loop. */
#ifndef MIDDECK_QUEUE_H
#define MIDDECK_QUEUE_H

#include "engine.h"
#include "mapped.h"

/* Start the loader's thread, which real time needs; 0 where there is none. */
int start_loader(const shared *f, engine *e);

/* Carry out what is due; 1 where the end was asked for. */
int take_commands(shared *f, engine *e);

/* Whether a command waits that may be carried out before the next sample. */
int command_is_due(const shared *f, const engine *e);

#endif
