/* Whether a held article drifts outwards, however slowly: the spread of each sensor in windows of doubled lengths. */
#ifndef MIDDECK_SLOW_DRIFT_H
#define MIDDECK_SLOW_DRIFT_H

#include "shared.h"

enum { LEVELS = 12 };

typedef struct {
    whole filled; /* windows of the level below; samples in the lowest */
    real sum, squares;
    real largest; /* variance of a window so far; below zero: there was none */
    int records;  /* successive windows that have exceeded it by the growth that counts */
} spread_window;

typedef struct {
    real from[CHANNELS]; /* value when it began */
    int begun;
    spread_window window[CHANNELS][LEVELS];
} drift_states;

void forget_drift(drift_states *o);

/* The next value of a sensor; "shortest" is the samples of the lowest window. 1 while one of its spreads grows. */
int look_for_drift(drift_states *o, int sensor, whole shortest, real value);

#endif
