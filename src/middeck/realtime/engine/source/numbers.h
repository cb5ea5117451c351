/* Small questions about numbers. */
#ifndef MIDDECK_NUMBERS_H
#define MIDDECK_NUMBERS_H

#include "shared.h"

static inline real larger(real a, real b)
{
    return a > b ? a : b;
}

static inline int all_finite(const real *v, whole count)
{
    whole i;

    for (i = 0; i < count; ++i)
        if (!(v[i] - v[i] == 0))
            return 0;
    return 1;
}

#endif
