/* Whether a law's poles lie within the unit circle, but for rounding. */
#ifndef MIDDECK_POLES_H
#define MIDDECK_POLES_H

#include "law.h"

/* 1 where no pole of the compensator has a magnitude beyond 1 + 1e-9, and all poles of its sections lie inside. Uses scratch of
   this file: one call at a time. */
int poles_within(const law_tables *t);

#endif
