/* Whether what the hold holds moves out, however slowly: its spread in windows of each length, twice as long from level to level. */
#ifndef MIDDECK_OUTWARD_H
#define MIDDECK_OUTWARD_H

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
} outward_states;

void outward_forget(outward_states *o);

/* The next value of a sensor; "shortest" is the samples of the lowest window. 1 while one of its spreads grows. */
int outward_look(outward_states *o, int sensor, whole shortest, real value);

#endif
