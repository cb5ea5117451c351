#define _POSIX_C_SOURCE 200809L
#include "queue.h"

#include <pthread.h>
#include <string.h>
#include <time.h>

enum answer load_package(const shared *f, engine *e, whole slot, whole size, int with_proof)
{
    const unsigned char *from = f->start + f->at.staging;

    if (size < 0 || size > LARGEST_PACKAGE || size + (with_proof ? PROOF : 0) > f->at.staging_size)
        return BAD_LENGTH;
    memcpy(e->slots[slot].bytes, from, (size_t)size);
    if (with_proof)
        memcpy(e->slots[slot].proof_bytes, from + size, PROOF);
    return engine_load(e, (int)slot, (size_t)size, with_proof);
}

static void *load_beside(void *given)
{
    const struct timespec pause = {0, 2000000};
    loading *l = given;

    for (;;) {
        while (!word_get(&l->wanted))
            nanosleep(&pause, NULL);
        word_set(&l->wanted, 0);
        l->found = load_package(l->file, l->engine, l->slot, l->size, l->with_proof);
        word_set(&l->done, 1);
    }
    return NULL;
}

int start_loader(loading *l)
{
    pthread_t beside;

    return pthread_create(&beside, NULL, load_beside, l) == 0;
}
