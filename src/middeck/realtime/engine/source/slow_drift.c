#include "slow_drift.h"

#include <string.h>

enum { RECORDS = 3 };
static const real GROWS = 1.44; /* of the variance: a fifth of the rms, as the standard monitors have it */

void forget_drift(drift_states *o)
{
    int i, k;

    if (!o->begun)
        return;
    memset(o, 0, sizeof *o);
    for (i = 0; i < CHANNELS; ++i)
        for (k = 0; k < LEVELS; ++k)
            o->window[i][k].largest = -1;
}

/* Spread by chance makes no record three times in a row once the article has moved; one that grows with time does. */
static void end_window(spread_window *w, real samples)
{
    const real mean = w->sum / samples, variance = w->squares / samples - mean * mean;

    w->records = w->largest >= 0 && variance > GROWS * w->largest ? w->records + 1 : 0;
    w->largest = variance > w->largest ? variance : w->largest;
    w->sum = w->squares = 0;
    w->filled = 0;
}

static int grows(const spread_window *w)
{
    int k;

    for (k = 0; k < LEVELS; ++k)
        if (w[k].records >= RECORDS)
            return 1;
    return 0;
}

int look_for_drift(drift_states *o, int sensor, whole shortest, real value)
{
    spread_window *w = o->window[sensor];
    real sum, squares, samples = (real)shortest;
    whole most = shortest;
    int k;

    if (w->filled == 0 && w->largest < 0)
        o->from[sensor] = value;
    o->begun = 1;
    sum = value - o->from[sensor];
    squares = sum * sum;
    for (k = 0; k < LEVELS; ++k, most = 2, samples *= 2) {
        w[k].sum += sum;
        w[k].squares += squares;
        if (++w[k].filled < most)
            break;
        sum = w[k].sum;
        squares = w[k].squares;
        end_window(&w[k], samples);
    }
    return grows(w);
}
