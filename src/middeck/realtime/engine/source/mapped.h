/* The shared file as the engine has it. What is checked at the start is copied: nobody changes it afterwards. */
#ifndef MIDDECK_MAPPED_H
#define MIDDECK_MAPPED_H

#include "shared.h"

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
