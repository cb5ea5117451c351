#include "queue.h"

#include <pthread.h>
#include <string.h>

#include "publish.h"
#include "words.h"

/* A package on its way into a slot. */
typedef struct {
    pthread_mutex_t lock;
    pthread_cond_t wake;
    int wanted, done; /* under the lock; done: an atomic word */
    int under_way;    /* known to the loop alone */
    whole slot, size;
    enum answer found;
    const shared *file;
    engine *engine;
} loader;

static loader the_loader = {.lock = PTHREAD_MUTEX_INITIALIZER, .wake = PTHREAD_COND_INITIALIZER};

/* Copy first, check the copy: what is checked is what will run. */
static enum answer load_from(const shared *f, engine *e, whole which, whole size)
{
    if (size < 0 || size > LARGEST_PACKAGE || size > f->at.staging_size)
        return BAD_LENGTH;
    memcpy(e->slots[which].bytes, f->start + f->at.staging, (size_t)size);
    return engine_load(e, (int)which, (size_t)size);
}

static void *load_beside(void *nothing)
{
    (void)nothing;
    pthread_mutex_lock(&the_loader.lock);
    for (;;) {
        while (!the_loader.wanted)
            pthread_cond_wait(&the_loader.wake, &the_loader.lock);
        the_loader.wanted = 0;
        pthread_mutex_unlock(&the_loader.lock);
        the_loader.found = load_from(the_loader.file, the_loader.engine, the_loader.slot, the_loader.size);
        word_set(&the_loader.done, 1);
        pthread_mutex_lock(&the_loader.lock);
    }
    return NULL;
}

int start_loader(const shared *f, engine *e)
{
    pthread_t beside;

    the_loader.file = f;
    the_loader.engine = e;
    return pthread_create(&beside, NULL, load_beside, NULL) == 0;
}

static whole size_asked(const command *c)
{
    return c->value[0] >= 0 && c->value[0] <= LARGEST_PACKAGE ? (whole)c->value[0] : -1;
}

/* Hand it to the loader; the loader at its lock is asked again with the next sample. */
static void begin_load(const command *c)
{
    if (pthread_mutex_trylock(&the_loader.lock) != 0)
        return;
    the_loader.slot = c->slot;
    the_loader.size = size_asked(c);
    the_loader.done = 0;
    the_loader.wanted = 1;
    pthread_cond_signal(&the_loader.wake);
    pthread_mutex_unlock(&the_loader.lock);
    the_loader.under_way = 1;
}

/* Begin or finish a LOAD; 0 while it goes on. */
static int load(const shared *f, engine *e, const command *c, enum answer *answer)
{
    if (the_loader.under_way) {
        if (!word_get(&the_loader.done))
            return 0;
        the_loader.under_way = 0;
        *answer = engine_loaded(e, (int)the_loader.slot, the_loader.found);
        return 1;
    }
    if (c->slot < 0 || c->slot >= SLOTS)
        *answer = WRONG_SLOT;
    else if (e->slots[c->slot].running)
        *answer = BUSY;
    else if (f->set.clock == LOCKSTEP)
        *answer = engine_loaded(e, (int)c->slot, load_from(f, e, c->slot, size_asked(c)));
    else {
        begin_load(c);
        return 0;
    }
    return 1;
}

int take_commands(shared *f, engine *e)
{
    while (command_is_due(f, e)) {
        const command c = f->commands[(f->acknowledged + 1) % COMMANDS];
        enum answer answer = UNKNOWN_COMMAND;

        if (c.kind == LOAD && !load(f, e, &c, &answer))
            return 0;
        if (c.kind == END)
            answer = DONE;
        else if (c.kind != LOAD)
            answer = engine_command(e, &c);
        acknowledge(f, e, &c, answer);
        if (c.kind == END)
            return 1;
    }
    return 0;
}

int command_is_due(const shared *f, const engine *e)
{
    const whole next = f->acknowledged + 1;
    const command *c = &f->commands[next % COMMANDS];

    return next <= word_get(&f->asks->written) && c->number == next && c->at <= e->sample;
}
