#include "law.h"

#include "kernel.h"

static void advance(const law_tables *t, const real *restrict x, const real *restrict y, real *restrict c, real *restrict next)
{
    const int n = t->states;
    int i;

    for (i = 0; i < t->outputs; ++i)
        c[i] = 0;
    add_columns(c, t->outputs, t->D, t->inputs, y);
    add_columns(c, t->outputs, t->C, n, x);
    for (i = 0; i < n; ++i)
        next[i] = 0;
    add_columns(next, n, t->B, t->inputs, y);
    if (t->pairs < 0) {
        add_columns(next, n, t->A, n, x);
        return;
    }
    for (i = 0; i < t->pairs; ++i)
        next[i] += t->upper[i] * x[t->pairs + i];
    for (i = 0; i < t->pairs; ++i)
        next[t->pairs + i] += t->lower[i] * x[i];
    for (i = 0; i < n; ++i)
        next[i] += t->diagonal[i] * x[i];
}

void law_reset(law_state *s, const law_tables *t)
{
    int i;

    for (i = 0; i < t->states; ++i)
        s->x[i] = s->next[i] = 0;
    for (i = 0; i < t->filters; ++i)
        s->section[i][0] = s->section[i][1] = 0;
    for (i = 0; i < t->inputs; ++i)
        s->held[i] = 0;
    for (i = 0; i < t->outputs; ++i)
        s->wanted[i] = s->last[i] = 0;
    s->level = 0;
    s->top = t->ramp;
    s->engaged = 1;
    s->within = s->owed = 0;
}

real law_fade(const law_state *s, const law_tables *t)
{
    if (t->ramp == 0)
        return s->engaged ? 1 : 0;
    return fade_at(s->level, t->ramp);
}

void law_compute(law_state *s, const law_tables *t, const real *y, real gain, real *u)
{
    real filtered[CHANNELS], c[CHANNELS];
    const real f = law_fade(s, t) * gain;
    int i;

    take_inputs(s->held, y, t->reach, t->inputs);
    for (i = 0; i < t->inputs; ++i)
        filtered[i] = s->held[i];
    for (i = 0; i < t->filters; ++i)
        filtered[t->filtered[i]] = through_section(&t->sections[5 * i], s->section[i], filtered[t->filtered[i]]);
    advance(t, s->x, filtered, c, s->next);
    for (i = 0; i < t->outputs; ++i) {
        s->wanted[i] = 0 + c[i]; /* 0: of an inner loop, which is the engine's own */
        u[i] = limited(0 + f * c[i], 0, s->last[i], t->slew[i], t->least[i], t->most[i]);
    }
}

/* Levels by which a law that leaves falls in this sample: one, or so many that a longer ramp ends within what is allowed. */
static long fall(law_state *s, const law_tables *t)
{
    long steps;

    if (s->within == 0 || t->ramp <= s->within)
        return s->level > 0;
    s->owed += t->ramp;
    steps = s->owed / s->within;
    s->owed %= s->within;
    return steps < s->level ? steps : s->level;
}

void law_commit(law_state *s, const law_tables *t, const real *applied)
{
    int i, j;

    if (t->E)
        for (j = 0; j < t->outputs; ++j) {
            const real missing = applied[j] - s->wanted[j];

            if (missing != 0)
                for (i = 0; i < t->states; ++i)
                    s->next[i] += t->E[j * t->states + i] * missing;
        }
    for (i = 0; i < t->states; ++i)
        s->x[i] = kept(s->next[i]);
    for (i = 0; i < t->outputs; ++i)
        s->last[i] = applied[i];
    if (s->engaged)
        s->level += (s->level < s->top) - (s->level > s->top);
    else
        s->level -= fall(s, t);
}
