#define _POSIX_C_SOURCE 200809L
#include "loader.h"

#include <pthread.h>
#include <string.h>
#include <time.h>

#include "words.h"

enum answer load_package(const shared *f, engine *e, whole slot, whole size)
{
    if (size < 0 || size > LARGEST_PACKAGE || size > f->at.staging_size)
        return BAD_LENGTH;
    memcpy(e->slots[slot].bytes, f->start + f->at.staging, (size_t)size);
    return engine_load(e, (int)slot, (size_t)size);
}

static void *load_beside(void *given)
{
    const struct timespec pause = {0, 2000000};
    loading *l = given;

    for (;;) {
        while (!word_get(&l->wanted))
            nanosleep(&pause, NULL);
        word_set(&l->wanted, 0);
        l->found = load_package(l->file, l->engine, l->slot, l->size);
        word_set(&l->done, 1);
    }
    return NULL;
}

int start_loader(loading *l)
{
    pthread_t beside;

    return pthread_create(&beside, NULL, load_beside, l) == 0;
}
