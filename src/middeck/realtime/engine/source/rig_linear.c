/* A sampled linear article with noise and faults: x+ = A x + B u + G w, y = C x + n. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "law.h"
#include "rig.h"

#include "kernel.h"

enum { HISTORY = 64 };

typedef struct {
    rig face;
    const article *a;
    const real *diagonal, *upper, *lower, *A, *B, *C, *G;
    real x[STATES], next[STATES];
    real old[HISTORY][CHANNELS]; /* what sensors gave, before faults */
    real given[CHANNELS];        /* what they gave last, with faults */
    real frozen[FAULTS];
    uint64_t random[4];
    whole sample;
} linear_rig;

/* xoshiro256++ (Blackman and Vigna 2019), the same everywhere. */
static uint64_t random_bits(uint64_t s[4])
{
    const uint64_t sum = s[0] + s[3], result = (sum << 23 | sum >> 41) + s[0], t = s[1] << 17;

    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = s[3] << 45 | s[3] >> 19;
    return result;
}

/* Nearly normal, variance one: twelve uniform numbers, so that no library's logarithm enters. At most 6. */
static real random_normal(uint64_t s[4])
{
    uint64_t sum = 0;
    int i;

    for (i = 0; i < 3; ++i) {
        const uint64_t bits = random_bits(s);

        sum += (bits & 0xffff) + (bits >> 16 & 0xffff) + (bits >> 32 & 0xffff) + (bits >> 48);
    }
    return ((real)sum + 6.0) / 65536.0 - 6.0;
}

static void seed_random(uint64_t s[4], uint64_t seed)
{
    int i;

    for (i = 0; i < 4; ++i) { /* splitmix64 */
        uint64_t z = seed += 0x9e3779b97f4a7c15u;

        z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
        z = (z ^ z >> 27) * 0x94d049bb133111ebu;
        s[i] = z ^ z >> 31;
    }
}

static int acts(const linear_rig *r, int k)
{
    return r->sample >= r->a->fault[k].from && r->sample < r->a->fault[k].until;
}

static void spoil_sensor(linear_rig *r, int k, real *y)
{
    const whole i = r->a->fault[k].channel;
    const real value = r->a->fault[k].value;
    real kept;

    switch (r->a->fault[k].kind) {
    case SENSOR_NAN:
        y[i] = NAN;
        break;
    case SENSOR_ADD:
        y[i] += value;
        break;
    case SENSOR_STUCK:
        if (r->sample == r->a->fault[k].from)
            r->frozen[k] = y[i];
        y[i] = r->frozen[k];
        break;
    case SENSOR_DRIFT:
        y[i] += value * (real)(r->sample - r->a->fault[k].from) * r->face.set->period_s;
        break;
    case SENSOR_GAIN:
        y[i] *= value;
        break;
    case SENSOR_LATE:
        y[i] = r->old[(r->sample + HISTORY - (value >= 0 && value < HISTORY ? (whole)value : 0)) % HISTORY][i];
        break;
    case SENSOR_DROP:
        if ((real)(random_bits(r->random) >> 11) * 0x1p-53 < value)
            y[i] = r->given[i];
        break;
    case SENSOR_SWAP:
        kept = y[i];
        y[i] = y[(whole)value];
        y[(whole)value] = kept;
        break;
    case SENSOR_NOISE:
        y[i] += value * random_normal(r->random);
        break;
    case ENCODER_WRAP:
        y[i] -= 2 * value * floor((y[i] + value) / (2 * value));
        break;
    default:
        break;
    }
}

static void spoil_output(linear_rig *r, int k, real *u)
{
    const whole i = r->a->fault[k].channel;
    const real value = r->a->fault[k].value;

    switch (r->a->fault[k].kind) {
    case OUTPUT_DEAD:
        u[i] = 0;
        break;
    case OUTPUT_GAIN:
        u[i] *= value;
        break;
    case OUTPUT_STUCK:
        if (r->sample == r->a->fault[k].from)
            r->frozen[k] = u[i];
        u[i] = r->frozen[k];
        break;
    case OUTPUT_LIMIT:
        u[i] = u[i] > value ? value : u[i] < -value ? -value : u[i];
        break;
    default:
        break;
    }
}

static enum rig_answer read_linear(rig *face, real *y)
{
    linear_rig *r = (linear_rig *)face;
    const int m = (int)face->set->inputs;
    int i, k;

    for (i = 0; i < m; ++i)
        y[i] = 0;
    add_columns(y, m, r->C, (int)r->a->states, r->x);
    for (i = 0; i < m; ++i)
        if (r->a->sensor_noise[i] > 0)
            y[i] += r->a->sensor_noise[i] * random_normal(r->random);
    memcpy(r->old[r->sample % HISTORY], y, (size_t)m * sizeof *y);
    for (k = 0; k < r->a->faults; ++k) {
        if (!acts(r, k))
            continue;
        if (r->a->fault[k].kind == RIG_SILENT || r->a->fault[k].kind == RIG_DIES)
            return r->a->fault[k].kind == RIG_DIES ? RIG_LOST : RIG_MISSED;
        spoil_sensor(r, k, y);
    }
    memcpy(r->given, y, (size_t)m * sizeof *y);
    return RIG_READ;
}

static enum rig_answer write_linear(rig *face, const real *u, whole alive)
{
    linear_rig *r = (linear_rig *)face;
    const int n = (int)r->a->states, pairs = (int)r->a->pairs, outputs = (int)face->set->outputs;
    real given[CHANNELS], noise[CHANNELS];
    int i, k;

    (void)alive;
    memcpy(given, u, (size_t)outputs * sizeof *u);
    for (k = 0; k < r->a->faults; ++k)
        if (acts(r, k))
            spoil_output(r, k, given);
    for (i = 0; i < n; ++i)
        r->next[i] = 0;
    add_columns(r->next, n, r->B, outputs, given);
    for (i = 0; i < r->a->noises; ++i)
        noise[i] = random_normal(r->random);
    add_columns(r->next, n, r->G, (int)r->a->noises, noise);
    if (pairs < 0) {
        add_columns(r->next, n, r->A, n, r->x);
    } else {
        for (i = 0; i < pairs; ++i)
            r->next[i] += r->upper[i] * r->x[pairs + i];
        for (i = 0; i < pairs; ++i)
            r->next[pairs + i] += r->lower[i] * r->x[i];
        for (i = 0; i < n; ++i)
            r->next[i] += r->diagonal[i] * r->x[i];
    }
    memcpy(r->x, r->next, (size_t)n * sizeof *r->x);
    ++r->sample;
    return RIG_READ;
}

static void close_linear(rig *face)
{
    (void)face;
}

static const real *cut(const real **from, whole count)
{
    const real *found = *from;

    *from += count;
    return found;
}

static int faults_fit(const settings *set, const article *a)
{
    int k;

    for (k = 0; k < a->faults; ++k) {
        const whole ports = a->fault[k].kind >= OUTPUT_DEAD && a->fault[k].kind <= OUTPUT_LIMIT ? set->outputs : set->inputs;
        const real other = a->fault[k].kind == SENSOR_SWAP ? a->fault[k].value : 0;

        if (a->fault[k].channel < 0 || a->fault[k].channel >= ports || !(other >= 0 && other < (real)ports))
            return 0;
    }
    return 1;
}

rig *open_linear_rig(const settings *set, const article *a, const real *numbers, whole count)
{
    static linear_rig r;
    const whole n = a->states, dynamics = a->pairs < 0 ? n * n : n + 2 * a->pairs;
    const real *from = numbers;

    if (n < 0 || n > STATES || 2 * a->pairs > n || a->noises < 0 || a->noises > CHANNELS || a->faults < 0 || a->faults > FAULTS
        || count != dynamics + n * (set->outputs + set->inputs + a->noises + 1)) {
        fputs("the article's numbers do not fit its sizes\n", stderr);
        return NULL;
    }
    if (!faults_fit(set, a)) {
        fputs("a fault of a channel that the article has not\n", stderr);
        return NULL;
    }
    memset(&r, 0, sizeof r);
    r.face.read = read_linear;
    r.face.write = write_linear;
    r.face.close = close_linear;
    r.face.set = set;
    r.a = a;
    if (a->pairs < 0) {
        r.A = cut(&from, n * n);
    } else {
        r.diagonal = cut(&from, n);
        r.upper = cut(&from, a->pairs);
        r.lower = cut(&from, a->pairs);
    }
    r.B = cut(&from, n * set->outputs);
    r.C = cut(&from, n * set->inputs);
    r.G = cut(&from, n * a->noises);
    memcpy(r.x, cut(&from, n), (size_t)n * sizeof *r.x);
    seed_random(r.random, (uint64_t)a->seed);
    return &r.face;
}
