/* Commands in their order, but for those that make safe, which wait for none. */
#ifndef MIDDECK_QUEUE_H
#define MIDDECK_QUEUE_H

#include "engine.h"
#include "mapped.h"

/* A package on its way into a slot. */
typedef struct {
    int wanted, done; /* words that both sides read */
    whole slot, size;
    int with_proof;
    enum answer found;
    const shared *file;
    engine *engine;
} loading;

/* Of the engine's one file: the commands that have been carried out before their turn, and the package under way. */
typedef struct {
    loading load;
    int under_way;
    whole early[COMMANDS]; /* numbers of commands carried out, or withdrawn, before their turn */
    whole no_engage, no_excite; /* such a command before this number is withdrawn, whenever it arrives */
} queue;

/* Copy what waits to be loaded, then check the copy: what is checked is what will run. */
enum answer load_package(const shared *f, engine *e, whole slot, whole size, int with_proof);

/* Start the thread that checks a package beside the loop, which asks for it by two words; 0 where there is none. */
int start_loader(loading *l);

/* Carry out what is due; 1 where the end was asked for. */
int take_commands(queue *q, shared *f, engine *e);

/* Whether a command waits that may be carried out before the next sample. */
int command_is_due(const queue *q, const shared *f, const engine *e);

/* What the engine tells: events, its state, records and answers. */
void publish_events(shared *f, engine *e);
void publish_status(shared *f, const engine *e);

/* The last sample: into the ring, and before a trip into the ring that a trip freezes. */
void publish_record(shared *f, const engine *e, const real *y, whole late_ns, whole step_ns);

/* What a command has changed is seen before its answer, which may come before its turn. */
void answer_command(shared *f, engine *e, const command *c, enum answer answer);

/* All commands up to this number have been answered. */
void acknowledge(shared *f, whole number);

#endif
