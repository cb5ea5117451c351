/* A packaged law, from its tables: the arithmetic of the generated C, bit for bit. */
#ifndef MIDDECK_LAW_H
#define MIDDECK_LAW_H

#include "shared.h"

enum { STATES = 1024 };

/* Tables within the bytes of a package; matrices column by column. */
typedef struct {
    int states, inputs, outputs, filters;
    int pairs;          /* -1 for a dense law */
    long ramp;          /* samples from zero to full authority */
    const real *reach, *least, *most, *slew;
    const real *diagonal, *upper, *lower, *A, *B, *C, *D, *E; /* E: null without the path of applied commands */
    const real *sections;
    int filtered[SECTIONS]; /* input of each section */
} law_tables;

typedef struct {
    real x[STATES], next[STATES];
    real section[SECTIONS][2];
    real held[CHANNELS], wanted[CHANNELS], last[CHANNELS];
    long level, top; /* of the ramp; top: where it stops rising */
    int engaged;
    long within, owed; /* most samples of a fall from full authority, 0 for those of the ramp; what it owes of a step */
} law_state;

void law_reset(law_state *s, const law_tables *t);

/* Outputs u for inputs y at the fade of the ramp times gain. */
void law_compute(law_state *s, const law_tables *t, const real *y, real gain, real *u);

/* End the sample: what of the law was really applied. */
void law_commit(law_state *s, const law_tables *t, const real *applied);

real law_fade(const law_state *s, const law_tables *t);

#endif
