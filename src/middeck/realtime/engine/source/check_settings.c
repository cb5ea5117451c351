#include "layout.h"
#include "mapped.h"

#include <math.h>
#include <stddef.h>

enum { STATES_MOST = 1024, HISTORY_MOST = 63, PERIOD_MOST_S = 1000000 };
static const whole LONGEST = (whole)1 << 48; /* samples, nanoseconds: sums of two of them still fit */
static const char other_layout[] = "not laid out for this engine";

static int between(whole least, whole value, whole most)
{
    return value >= least && value <= most;
}

static int finite(real v)
{
    return v - v == 0;
}

static int all_finite(const real *v, size_t count)
{
    size_t i;

    for (i = 0; i < count; ++i)
        if (!finite(v[i]))
            return 0;
    return 1;
}

/* Whether something can exceed it; infinity is for no test. */
static int is_limit(real v)
{
    return v >= 0;
}

/* One without which there would be no test. */
static int is_bound(real v)
{
    return v >= 0 && finite(v);
}

/* Both poles inside the unit circle: the triangle of a1 and a2. */
static int is_stable(const real *g)
{
    return fabs(g[4]) < 1 && fabs(g[3]) < 1 + g[4];
}

/* Room for ``count`` of ``size`` bytes at ``place``, before ``next``. */
static int holds(whole place, whole count, whole size, whole next)
{
    return place % 8 == 0 && count >= 0 && place >= 0 && place <= next && count <= (next - place) / size;
}

const char *misfit_of_places(const places *at, whole size)
{
    if (at->magic != MAGIC || at->layout != LAYOUT || at->size != size)
        return other_layout;
    if (at->settings < (whole)sizeof *at || !between(0, at->staging, size) || !holds(at->staging, at->staging_size, 1, size)
        || !holds(at->settings, 1, sizeof(settings), at->article) || !holds(at->article, 1, sizeof(article), at->article_numbers)
        || !holds(at->article_numbers, at->article_count, sizeof(real), at->asks) || !holds(at->asks, 1, sizeof(asks), at->status)
        || !holds(at->status, 1, sizeof(status), at->commands) || !holds(at->commands, COMMANDS, sizeof(command), at->acknowledgements)
        || !holds(at->acknowledgements, COMMANDS, sizeof(acknowledgement), at->events)
        || !holds(at->events, EVENTS, sizeof(event), at->ring) || !between(at->ring, at->pretrip, at->waveform)
        || at->waveform > at->blacklist || !between(0, at->blacklist_count, HASHES) || !holds(at->blacklist, at->blacklist_count, 32, at->staging))
        return other_layout;
    return NULL;
}

const char *misfit_of_regions(const places *at, const settings *set)
{
    const whole stride = (whole)(sizeof(record_head) + sizeof(real) * (size_t)(set->inputs + (3 + 2 * SLOTS) * set->outputs + 1));

    if (at->stride != stride || at->ring_count < 1 || !holds(at->ring, at->ring_count, stride, at->pretrip) || at->pretrip_count < 1
        || !holds(at->pretrip, at->pretrip_count, stride, at->waveform)
        || !holds(at->waveform, at->waveform_samples, set->outputs * (whole)sizeof(real), at->blacklist))
        return other_layout;
    return NULL;
}

static const char *misfit_of_ports(const settings *set)
{
    int i;

    for (i = 0; i < set->inputs; ++i)
        if (!(set->range[i] > 0) || !finite(set->range[i]) || set->stuck[i] < 0 || !(set->envelope[i] > 0)
            || !between(-1, set->rate[i], set->inputs - 1) || !(set->coast[i] >= 0 && set->coast[i] <= (real)LONGEST * set->period_s))
            return "a sensor with a range or a test that no engine runs";
    for (i = 0; i < set->outputs; ++i)
        if (!(set->lower[i] <= 0 && set->upper[i] >= 0 && set->lower[i] < set->upper[i]) || !finite(set->lower[i])
            || !finite(set->upper[i]) || !(set->slew[i] > 0) || !(set->momentum[i] > 0)
            || !finite(set->stored[i]))
            return "an output with limits that no engine keeps";
    return NULL;
}

static const char *misfit_of_tests(const settings *set)
{
    int k;

    if (!between(0, set->spreads, SPREADS) || !between(0, set->monitors, MONITORS) || !between(0, set->paths, SECTIONS))
        return "more spreads, monitors or paths than an engine has";
    for (k = 0; k < set->spreads; ++k)
        if (!between(0, set->spread[k].first, set->inputs - 1) || !between(0, set->spread[k].second, set->inputs - 1)
            || set->spread[k].first == set->spread[k].second || !is_bound(set->spread[k].limit) || !between(1, set->spread[k].samples, LONGEST))
            return "a spread of what is no sensor, or without a limit or a time";
    for (k = 0; k < set->monitors; ++k)
        if (!between(0, set->monitor[k].channel, set->inputs + set->outputs - 1) || !between(1, set->monitor[k].window, LONGEST)
            || !all_finite(set->monitor[k].band[0].g, 10) || !is_stable(set->monitor[k].band[0].g) || !is_stable(set->monitor[k].band[1].g)
            || !(set->monitor[k].forget > 0 && set->monitor[k].forget <= 1) || !is_limit(set->monitor[k].limit) || !is_bound(set->monitor[k].floor)
            || !is_bound(set->monitor[k].factor) || !between(set->monitor[k].factor > 0, set->monitor[k].times, LONGEST))
            return "a monitor of no channel, without a window, with a band that is not finite and stable, or with limits that nothing exceeds";
    if (!(set->effort_forget >= 0 && set->effort_forget <= 1) || !(set->effort_share >= 0 && set->effort_share < 1))
        return "an effort that nothing exceeds";
    for (k = 0; k < set->paths; ++k)
        if (!between(0, set->path[k].sensor, set->inputs - 1) || !between(0, set->path[k].output, set->outputs - 1)
            || !all_finite(set->path[k].s.g, 5) || !is_stable(set->path[k].s.g))
            return "a hold from no sensor, to no output or with a section that is not finite or not stable";
    if (!between(-1, set->adaptive.monitor, set->monitors - 1))
        return "an adaptive gain without its monitor";
    if (!(set->adaptive.least >= 0 && set->adaptive.least <= set->adaptive.most) || !finite(set->adaptive.most) || !(set->adaptive.rate >= 0)
        || !is_limit(set->adaptive.quiet) || !is_limit(set->adaptive.loud))
        return "an adaptive gain with bounds or a rate that no engine keeps";
    return NULL;
}

const char *misfit_of_settings(const settings *set)
{
    const char *why;

    if (!between(1, set->inputs, CHANNELS) || !between(1, set->outputs, CHANNELS))
        return "a number of sensors or outputs that no engine has";
    if (!between(LOCKSTEP, set->clock, REAL_TIME) || !between(LINEAR_RIG, set->rig, DRIVER_RIG))
        return "a clock or a rig that no engine has";
    if (!(set->period_s >= 1e-6 && set->period_s <= PERIOD_MOST_S))
        return "a period that no engine keeps: 1 us at least";
    if (!between(0, set->verify, LONGEST) || !between(1, set->ramp, LONGEST) || !between(0, set->safe_ramp, 1 << 24)
        || !between(1, set->leave, LONGEST)
        || !between(0, set->heartbeat, LONGEST) || !between(0, set->late_ns, LONGEST) || !between(0, set->late_most, LONGEST)
        || !between(0, set->answer_ms, 1000000000) || !between(0, set->port, 65535) || !between(-1, set->processor, 1 << 20)
        || !between(0, set->priority, 99))
        return "a time, port, processor or priority that no engine takes";
    why = misfit_of_ports(set);
    return why ? why : misfit_of_tests(set);
}

const char *misfit_of_article(const article *a, const settings *set)
{
    int k;

    if (!between(0, a->states, STATES_MOST) || !between(-1, a->pairs, a->states / 2) || !between(0, a->noises, CHANNELS)
        || !between(0, a->faults, FAULTS))
        return "an article of a size that no engine steps";
    for (k = 0; k < a->faults; ++k) {
        const whole kind = a->fault[k].kind, most = kind >= OUTPUT_DEAD && kind <= OUTPUT_LIMIT ? set->outputs : set->inputs;
        const real value = a->fault[k].value;

        if (!between(SENSOR_NAN, kind, RIG_DIES) || !between(0, a->fault[k].channel, most - 1)
            || (kind == SENSOR_LATE && !(value >= 0 && value <= HISTORY_MOST))
            || (kind == SENSOR_SWAP && !(value >= 0 && value <= (real)(most - 1))) || (kind == ENCODER_WRAP && !(value > 0)))
            return "a fault of the article that it cannot have";
    }
    return NULL;
}
