/* The shared file as the engine has it. What is checked at the start is copied: nobody changes it afterwards. */
#ifndef MIDDECK_MAPPED_H
#define MIDDECK_MAPPED_H

#include "shared.h"

/* Words that two processes share: written with release, read with acquire. */
#define word_get(p) __atomic_load_n((p), __ATOMIC_ACQUIRE)
#define word_set(p, value) __atomic_store_n((p), (value), __ATOMIC_RELEASE)

/* What the word stands for is about to change: nothing of it is written before the zero. */
#define word_open(p)                                  \
    do {                                              \
        __atomic_store_n((p), 0, __ATOMIC_RELAXED);   \
        __atomic_thread_fence(__ATOMIC_RELEASE);      \
    } while (0)

typedef struct {
    unsigned char *start;
    places at;
    settings set;
    article article;
    const real *waveform; /* a copy */
    asks *asks;
    status *status;
    const command *commands;
    acknowledgement *acknowledgements;
    event *events;
    whole told, acknowledged, alive; /* published so far: the engine never reads its own words back */
} shared;

/* Map what stands at ``path``; 0, after saying why on the standard error, where no engine can run it. */
int map_file(const char *path, shared *f);

const real *article_numbers_of(const shared *f);

/* Whether an engine can run what stands there: null, or in words what does not fit. Regions in order and within ``size`` bytes;
   those that count records or samples are left to `misfit_of_regions`. */
const char *misfit_of_places(const places *at, whole size);
const char *misfit_of_settings(const settings *set);
const char *misfit_of_article(const article *a, const settings *set);
const char *misfit_of_regions(const places *at, const settings *set);

#endif
