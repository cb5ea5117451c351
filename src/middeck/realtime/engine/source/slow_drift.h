/* Whether a held article drifts outwards, however slowly: the spread of each sensor in windows of 1, 1.5, 2, 3, 4 ... times the shortest. */
#ifndef MIDDECK_SLOW_DRIFT_H
#define MIDDECK_SLOW_DRIFT_H

#include "shared.h"

enum { LEVELS = 12, GROWTHS = 4 };

enum outwards { NOT_OUTWARDS, MAYBE_OUTWARDS, OUTWARDS };

typedef struct {
    whole filled; /* windows of the level below; samples in the lowest */
    real sum, squares;
    real largest; /* variance of a window so far; below zero: there was none */
    int records[GROWTHS]; /* successive windows that have exceeded it by each growth that counts */
} spread_window;

typedef struct {
    real from[CHANNELS]; /* value when it began */
    int begun;
    spread_window window[CHANNELS][2][LEVELS]; /* each level has windows of twice the length */
} drift_states;

void forget_drift(drift_states *o);

/* The next value of a sensor; "shortest" is the samples of the lowest window. Whether one of its spreads grows. */
enum outwards look_for_drift(drift_states *o, int sensor, whole shortest, real value);

#endif
