#include "slow_drift.h"

#include <string.h>

enum { SUSPECT = 3 };

/* Growth of the variance from window to window, the least of which is a fifth of the rms, as the standard monitors have it; and how
   many windows in a row prove it. An article that noise sets in motion from rest makes three of the least in a third of all waits,
   at each level anew: enough not to verify a hold yet. What proves it comes in a few waits of a million, by simulation of random
   walks, whose windows grow most; of windows that can be exchanged, eleven are in order in one of 11! cases. */
static const struct {
    real factor;
    int windows;
} growth[GROWTHS] = {{1.44, 10}, {2, 6}, {3.5, 4}, {6, 3}};

void forget_drift(drift_states *o)
{
    spread_window *w = o->window[0][0];
    int k;

    if (!o->begun)
        return;
    memset(o, 0, sizeof *o);
    for (k = 0; k < CHANNELS * 2 * LEVELS; ++k)
        w[k].largest = -1;
}

static void end_window(spread_window *w, real samples)
{
    const real mean = w->sum / samples, variance = w->squares / samples - mean * mean;
    int k;

    for (k = 0; k < GROWTHS; ++k)
        w->records[k] = w->largest >= 0 && variance > growth[k].factor * w->largest ? w->records[k] + 1 : 0;
    w->largest = variance > w->largest ? variance : w->largest;
    w->sum = w->squares = 0;
    w->filled = 0;
}

static enum outwards judge_window(const spread_window *w)
{
    int k;

    for (k = 0; k < GROWTHS; ++k)
        if (w->records[k] >= growth[k].windows)
            return OUTWARDS;
    return w->records[0] >= SUSPECT ? MAYBE_OUTWARDS : NOT_OUTWARDS;
}

static enum outwards judge_windows(const spread_window *w)
{
    enum outwards found = NOT_OUTWARDS, one;
    int k;

    for (k = 0; k < LEVELS; ++k)
        if ((one = judge_window(&w[k])) > found)
            found = one;
    return found;
}

static enum outwards fill_windows(spread_window *w, whole shortest, real sum)
{
    real squares = sum * sum, samples = (real)shortest;
    whole most = shortest;
    int k;

    for (k = 0; k < LEVELS; ++k, most = 2, samples *= 2) {
        w[k].sum += sum;
        w[k].squares += squares;
        if (++w[k].filled < most)
            break;
        sum = w[k].sum;
        squares = w[k].squares;
        end_window(&w[k], samples);
    }
    return judge_windows(w);
}

enum outwards look_for_drift(drift_states *o, int sensor, whole shortest, real value)
{
    enum outwards one, other;

    if (o->window[sensor][0][0].filled == 0 && o->window[sensor][0][0].largest < 0)
        o->from[sensor] = value;
    o->begun = 1;
    one = fill_windows(o->window[sensor][0], shortest, value - o->from[sensor]);
    other = fill_windows(o->window[sensor][1], shortest + (shortest + 1) / 2, value - o->from[sensor]);
    return one > other ? one : other;
}
