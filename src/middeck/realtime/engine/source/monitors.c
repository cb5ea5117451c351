#include "monitors.h"

#include <math.h>
#include <string.h>

#include "kernel.h"

void monitors_start(monitor_states *m)
{
    memset(m, 0, sizeof *m);
}

void monitors_forget(monitor_states *m)
{
    memset(m->sum, 0, sizeof m->sum);
    memset(m->filled, 0, sizeof m->filled);
    memset(m->before, 0, sizeof m->before);
    memset(m->grown, 0, sizeof m->grown);
    memset(m->effort, 0, sizeof m->effort);
    memset(m->effort_before, 0, sizeof m->effort_before);
    m->effort_filled = 0;
}

static void look_for_growth(monitor_states *m, const monitor *set, int k, real square, trip_cause *cause)
{
    real mean;

    m->sum[k] += square;
    if (++m->filled[k] < set->window)
        return;
    mean = m->sum[k] / (real)set->window;
    m->grown[k] = mean > set->floor * set->floor && mean > set->factor * set->factor * m->before[k] ? m->grown[k] + 1 : 0;
    m->before[k] = mean;
    m->sum[k] = 0;
    m->filled[k] = 0;
    if (m->grown[k] >= set->times)
        blame(cause, GROWTH, set->channel, sqrt(mean), set->floor);
}

void monitors_look(monitor_states *m, const settings *set, int outputs, const real *v, trip_cause *cause)
{
    int k;

    for (k = 0; k < set->monitors; ++k) {
        const monitor *one = &set->monitor[k];
        const whole channel = outputs ? one->channel - set->inputs : one->channel;
        real band, square;

        if (outputs ? channel < 0 : channel >= set->inputs)
            continue;
        band = through_section(one->band[0].g, m->section[k][0], v[channel]);
        band = through_section(one->band[1].g, m->section[k][1], band);
        square = band * band;
        m->power[k] += one->forget * (square - m->power[k]);
        if (m->power[k] > one->limit * one->limit)
            blame(cause, BAND_POWER, one->channel, sqrt(m->power[k]), one->limit);
        if (one->factor > 0)
            look_for_growth(m, one, k, square, cause);
    }
}

void monitors_effort(monitor_states *m, const settings *set, const real *u, uint64_t saturated, trip_cause *cause)
{
    const whole half = set->effort_window / 2;
    int i;

    for (i = 0; i < set->outputs; ++i) {
        m->momentum[i] += u[i] * set->period_s;
        if (m->momentum[i] > set->momentum[i] || m->momentum[i] < -set->momentum[i])
            blame(cause, MOMENTUM, set->inputs + i, m->momentum[i], set->momentum[i]);
    }
    if (!set->effort_window)
        return;
    ++m->effort_filled;
    for (i = 0; i < set->outputs; ++i) {
        m->effort[i] += (whole)(saturated >> i & 1);
        if ((real)(m->effort[i] + m->effort_before[i]) > set->effort_share * (real)(2 * half))
            blame(cause, EFFORT, set->inputs + i, (real)(m->effort[i] + m->effort_before[i]) / (real)(2 * half), set->effort_share);
        if (m->effort_filled == half) {
            m->effort_before[i] = m->effort[i];
            m->effort[i] = 0;
        }
    }
    if (m->effort_filled == half)
        m->effort_filled = 0;
}
