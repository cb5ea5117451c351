#include "package.h"

#include <math.h>
#include <string.h>

#include "kernel.h"

enum { SQUARINGS = 46 };
static const real NEAR = 1e-9;
static real scratch[2][(size_t)STATES * STATES];

static int sections_within(const law_tables *t)
{
    int i;

    for (i = 0; i < t->filters; ++i) {
        const real a1 = t->sections[5 * i + 3], a2 = t->sections[5 * i + 4];

        if (!(fabs(a2) < 1 && fabs(a1) < 1 + a2))
            return 0;
    }
    return 1;
}

/* The larger magnitude of the poles of [a b; c d]. */
static real block_radius(real a, real b, real c, real d)
{
    const real middle = 0.5 * (a + d), half = 0.5 * (a - d), square = half * half + b * c;

    return square >= 0 ? fabs(middle) + sqrt(square) : hypot(middle, sqrt(-square));
}

static int modal_within(const law_tables *t)
{
    int i;

    for (i = 0; i < t->pairs; ++i)
        if (!(block_radius(t->diagonal[i], t->upper[i], t->lower[i], t->diagonal[t->pairs + i]) <= 1 + NEAR))
            return 0;
    for (i = 2 * t->pairs; i < t->states; ++i)
        if (!(fabs(t->diagonal[i]) <= 1 + NEAR))
            return 0;
    return 1;
}

/* Divide by the norm; its logarithm, or minus infinity for zero. */
static real normalise(real *m, int n)
{
    real largest = 0, sum = 0;
    int i;

    for (i = 0; i < n * n; ++i)
        largest = fabs(m[i]) > largest ? fabs(m[i]) : largest;
    if (largest == 0)
        return -HUGE_VAL;
    for (i = 0; i < n * n; ++i) {
        m[i] /= largest;
        sum += m[i] * m[i];
    }
    for (i = 0; i < n * n; ++i)
        m[i] /= sqrt(sum);
    return log(largest) + 0.5 * log(sum);
}

static real trace_of(const real *m, int n)
{
    real sum = 0;
    int i;

    for (i = 0; i < n; ++i)
        sum += m[i * (n + 1)];
    return sum;
}

/* With M = A^k, k doubled again and again: norm(M)^(1/k) is no less than the largest magnitude and falls to it; the trace of M
   is at most n times its power k. */
static int dense_within(const law_tables *t)
{
    const int n = t->states;
    real *m = scratch[0], *square = scratch[1], *other, growth = 0, share = 1;
    int turn, j;

    memcpy(m, t->A, (size_t)n * (size_t)n * sizeof *m);
    for (turn = 0; turn < SQUARINGS; ++turn, share /= 2) {
        growth += share * normalise(m, n);
        if (growth <= log1p(NEAR))
            return 1;
        if (growth + share * log(fabs(trace_of(m, n)) / n) > 2 * NEAR)
            return 0;
        memset(square, 0, (size_t)n * (size_t)n * sizeof *square);
        for (j = 0; j < n; ++j)
            add_columns(square + j * n, n, m, n, m + j * n);
        other = m;
        m = square;
        square = other;
    }
    return 0;
}

int poles_within(const law_tables *t)
{
    if (!sections_within(t))
        return 0;
    if (!t->states)
        return 1;
    return t->pairs < 0 ? dense_within(t) : modal_within(t);
}
