#include "monitors.h"

#include <math.h>
#include <string.h>

#include "kernel.h"

void monitors_start(monitor_states *m, const settings *set)
{
    memset(m, 0, sizeof *m);
    memcpy(m->momentum, set->stored, sizeof m->momentum);
    monitors_forget(m);
}

void monitors_forget(monitor_states *m)
{
    int k;

    memset(m->sum, 0, sizeof m->sum);
    memset(m->filled, 0, sizeof m->filled);
    memset(m->grown, 0, sizeof m->grown);
    memset(m->effort, 0, sizeof m->effort);
    for (k = 0; k < MONITORS; ++k)
        m->before[k] = -1;
}

/* As if the value had always been there: what is constant at power-up is no step. */
static real settle_section(const real *g, real *s, real value)
{
    const real out = value * (g[0] + g[1] + g[2]) / (1 + g[3] + g[4]);

    s[1] = g[2] * value - g[4] * out;
    s[0] = g[1] * value - g[3] * out + s[1];
    return out;
}

static void settle_monitor(monitor_states *m, const monitor *one, int k, real value)
{
    settle_section(one->band[1].g, m->section[k][1], settle_section(one->band[0].g, m->section[k][0], value));
    m->settled[k] = 1;
}

static void look_for_growth(monitor_states *m, const monitor *set, int k, real square, trip_cause *cause, trip_cause *growing)
{
    real mean;

    m->sum[k] += square;
    if (++m->filled[k] < set->window)
        return;
    mean = m->sum[k] / (real)set->window;
    if (m->before[k] >= 0 && mean > set->floor * set->floor && mean > set->factor * set->factor * m->before[k])
        ++m->grown[k];
    else
        m->grown[k] = 0;
    m->before[k] = mean;
    m->sum[k] = 0;
    m->filled[k] = 0;
    if (m->grown[k] >= set->times) {
        blame(cause, GROWTH, set->channel, sqrt(mean), set->floor);
        blame(growing, GROWTH, set->channel, sqrt(mean), set->floor);
    }
}

void monitors_look(monitor_states *m, const settings *set, int outputs, const real *v, trip_cause *cause, trip_cause *growing)
{
    int k;

    for (k = 0; k < set->monitors; ++k) {
        const monitor *one = &set->monitor[k];
        const whole channel = outputs ? one->channel - set->inputs : one->channel;
        real band, square;

        if (outputs ? channel < 0 : channel >= set->inputs)
            continue;
        if (!m->settled[k])
            settle_monitor(m, one, k, v[channel]);
        band = through_section(one->band[0].g, m->section[k][0], v[channel]);
        band = through_section(one->band[1].g, m->section[k][1], band);
        square = band * band;
        m->power[k] += one->forget * (square - m->power[k]);
        if (m->power[k] > one->limit * one->limit)
            blame(cause, BAND_POWER, one->channel, sqrt(m->power[k]), one->limit);
        if (one->factor > 0)
            look_for_growth(m, one, k, square, cause, growing);
    }
}

int monitors_full(const monitor_states *m, const settings *set, int output, real u)
{
    return (m->momentum[output] > set->momentum[output] && u > 0) || (m->momentum[output] < -set->momentum[output] && u < 0);
}

void monitors_effort(monitor_states *m, const settings *set, const real *u, const real *share, trip_cause *cause, trip_cause *growing)
{
    int i;

    for (i = 0; i < set->outputs; ++i) {
        m->effort[i] += set->effort_forget * (share[i] * share[i] - m->effort[i]);
        if (m->effort[i] > set->effort_share * set->effort_share) {
            blame(cause, EFFORT, set->inputs + i, sqrt(m->effort[i]), set->effort_share);
            blame(growing, EFFORT, set->inputs + i, sqrt(m->effort[i]), set->effort_share);
        }
    }
    for (i = 0; i < set->outputs; ++i) {
        m->momentum[i] += u[i] * set->period_s;
        if (monitors_full(m, set, i, u[i]))
            blame(cause, MOMENTUM, set->inputs + i, m->momentum[i], set->momentum[i]);
    }
}
