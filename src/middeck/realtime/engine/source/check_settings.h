/* Whether an engine can run what stands in a shared file. Each returns null, or in words what does not fit. */
#ifndef MIDDECK_CHECK_SETTINGS_H
#define MIDDECK_CHECK_SETTINGS_H

#include "shared.h"

/* Regions in order and within ``size`` bytes; those that count records or samples are left to `misfit_of_regions`. */
const char *misfit_of_places(const places *at, whole size);

const char *misfit_of_settings(const settings *set);
const char *misfit_of_article(const article *a, const settings *set);
const char *misfit_of_regions(const places *at, const settings *set);

#endif
