#include "package.h"

#include <float.h>
#include <string.h>


#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "packages are little-endian, and are read where they lie"
#endif

enum { HEAD = 64, HASH = 32, WORDS = 12, TEXT = 64, LONGEST_RAMP = 1 << 24, SAMPLES = 4096 };
enum { MODAL = 1, SINGLE = 2, UNSTABLE = 4, APPLIED = 8, OWN = 16 };
enum word { W_FORMAT, W_FLAGS, W_STATES, W_PAIRS, W_INPUTS, W_OUTPUTS, W_FILTERS, W_PATHS, W_RAMP, W_SAMPLES, W_START, W_RESERVED };

static const uint32_t most[WORDS] = {1, 31, STATES, STATES / 2, CHANNELS, CHANNELS, SECTIONS, SECTIONS, LONGEST_RAMP, SAMPLES, LONGEST_RAMP, 0};

typedef struct {
    unsigned char *at, *end;
} bytes_left;

static int finite(const real *v, size_t count)
{
    size_t i;

    for (i = 0; i < count; ++i)
        if (!(v[i] - v[i] == 0))
            return 0;
    return 1;
}

static int is_zero(const real *v, size_t count)
{
    size_t i;

    for (i = 0; i < count; ++i)
        if (v[i] != 0)
            return 0;
    return 1;
}

static real *take(bytes_left *b, size_t count)
{
    real *found = (real *)(void *)b->at;

    if (count > (size_t)(b->end - b->at) / sizeof(real))
        return NULL;
    b->at += count * sizeof(real);
    return found;
}

/* A text of at most TEXT bytes; null where it does not fit. */
static const unsigned char *take_text(bytes_left *b)
{
    const unsigned char *found = b->at;
    size_t length;

    if (b->end - b->at < 2)
        return NULL;
    length = text_length(found);
    if (length > TEXT || (size_t)(b->end - b->at) < 2 + length || !is_printable(found + 2, length))
        return NULL;
    b->at += 2 + length;
    return found;
}

/* Names and units of one side: a name that is there, and no name twice. */
static enum answer read_ports(bytes_left *b, int count)
{
    const unsigned char *name[CHANNELS];
    int i, k;

    for (i = 0; i < count; ++i) {
        if (!(name[i] = take_text(b)) || is_blank(name[i] + 2, text_length(name[i])) || !take_text(b))
            return BAD_TEXT;
        for (k = 0; k < i; ++k)
            if (same_texts(name[i], name[k]))
                return NAME_TWICE;
    }
    return DONE;
}

static enum answer read_texts(package *p, bytes_left *b)
{
    enum answer found;

    p->texts = take_text(b);
    if (!p->texts || !is_identifier(p->texts + 2, text_length(p->texts)))
        return BAD_TEXT;
    found = read_ports(b, p->law.inputs);
    return found == DONE ? read_ports(b, p->law.outputs) : found;
}

static enum answer read_words(const unsigned char *bytes, uint32_t w[WORDS])
{
    int i;

    memcpy(w, bytes + 8, WORDS * sizeof *w);
    if (w[W_FORMAT] == (uint32_t)most[W_FORMAT] << 24)
        return OTHER_BYTE_ORDER;
    if (w[W_FORMAT] != most[W_FORMAT])
        return BAD_FORMAT;
    for (i = 1; i < WORDS; ++i)
        if (w[i] > most[i])
            return BAD_SIZE;
    if (w[W_INPUTS] < 1 || w[W_OUTPUTS] < 1 || w[W_SAMPLES] < 1 || 2 * w[W_PAIRS] > w[W_STATES] || (!(w[W_FLAGS] & MODAL) && w[W_PAIRS]) || w[W_START] > w[W_RAMP])
        return BAD_SIZE;
    if (w[W_FLAGS] & SINGLE)
        return SINGLE_PRECISION;
    if (w[W_FLAGS] & OWN) /* of a bound that only single precision has */
        return BAD_SIZE;
    if (w[W_PATHS])
        return INNER_LOOP;
    return DONE;
}

static enum answer read_places(package *p, bytes_left *b, const unsigned char *start)
{
    const int filters = p->law.filters;
    int i;

    if (b->end - b->at < 8 * filters)
        return BAD_LENGTH;
    for (i = 0; i < filters; ++i, b->at += 8) {
        uint32_t place[2];

        memcpy(place, b->at, sizeof place);
        if (place[0] >= (uint32_t)p->law.inputs || place[1] != 0)
            return BAD_PLACE;
        p->law.filtered[i] = (int)place[0];
    }
    for (; (b->at - start) % 8; ++b->at)
        if (b->at == b->end || *b->at)
            return BAD_PADDING;
    return DONE;
}

static enum answer read_limits(law_tables *t, bytes_left *b)
{
    real *limit[4];
    int i, k;

    for (k = 0; k < 4; ++k) {
        const int count = k ? t->outputs : t->inputs;

        if (!(limit[k] = take(b, (size_t)count)))
            return BAD_LENGTH;
        for (i = 0; i < count; ++i) {
            const real v = limit[k][i];

            if (v != v || (k == 1 ? v > 0 : k == 2 ? v < 0 : !(v > 0)))
                return BAD_LIMIT;
            if (k == 2 && !(limit[1][i] < v))
                return BAD_LIMIT;
            limit[k][i] = v > DBL_MAX ? DBL_MAX : v < -DBL_MAX ? -DBL_MAX : v;
        }
    }
    t->reach = limit[0];
    t->least = limit[1];
    t->most = limit[2];
    t->slew = limit[3];
    return DONE;
}

static enum answer read_numbers(package *p, bytes_left *b, const uint32_t w[WORDS])
{
    law_tables *t = &p->law;
    const size_t n = w[W_STATES], m = w[W_INPUTS], o = w[W_OUTPUTS], pairs = w[W_PAIRS];
    const real *first = (const real *)(const void *)b->at;

    if (w[W_FLAGS] & MODAL) {
        t->diagonal = take(b, n);
        t->upper = take(b, pairs);
        t->lower = take(b, pairs);
        if (!t->lower)
            return BAD_LENGTH;
    } else if (!(t->A = take(b, n * n))) {
        return BAD_LENGTH;
    }
    t->B = take(b, n * m);
    t->C = take(b, o * n);
    t->D = take(b, o * m);
    t->E = w[W_FLAGS] & APPLIED ? take(b, n * o) : NULL;
    t->sections = take(b, 5 * (size_t)t->filters);
    p->test_y = take(b, p->samples * m);
    p->test_u = take(b, p->samples * o);
    if (!t->B || !t->C || !t->D || (w[W_FLAGS] & APPLIED && !t->E) || !t->sections || !p->test_y || !p->test_u)
        return BAD_LENGTH;
    if (!finite(first, (size_t)((const real *)(const void *)b->at - first)))
        return BAD_NUMBER;
    return t->E && is_zero(t->E, n * o) ? BAD_PADDING : DONE; /* without a path it is left out */
}

static enum answer read_end(package *p, bytes_left *b)
{
    long i;

    if (b->end - b->at != (p->samples + 7) / 8 * 8)
        return b->end - b->at < (p->samples + 7) / 8 * 8 ? BAD_LENGTH : TOO_LONG;
    p->test_engaged = b->at;
    for (i = 0; i < p->samples; ++i)
        if (b->at[i] > 1)
            return BAD_NUMBER;
    for (; b->at + i < b->end; ++i)
        if (b->at[i])
            return BAD_PADDING;
    return DONE;
}

/* Sizes, period, ports, places and coefficients; not the name, ranges, limits, ramp and test vectors. */
static void hash_law(package *p, const uint32_t w[WORDS], const unsigned char *ports, const unsigned char *places)
{
    const law_tables *t = &p->law;
    const uint32_t sizes[8] = {w[W_FLAGS] & (MODAL | SINGLE | APPLIED), w[W_STATES], w[W_PAIRS], w[W_INPUTS], w[W_OUTPUTS], w[W_FILTERS], w[W_PATHS], 0};
    const unsigned char *first = (const unsigned char *)(t->pairs < 0 ? t->A : t->diagonal), *last = (const unsigned char *)(t->sections + 5 * t->filters);
    unsigned char all[sizeof sizes + sizeof p->period_s + 3 * HASH], *at = all + sizeof sizes + sizeof p->period_s;

    memcpy(all, sizes, sizeof sizes);
    memcpy(all + sizeof sizes, &p->period_s, sizeof p->period_s);
    sha256(ports, (size_t)(places - ports), at);
    sha256(places, 8 * (size_t)t->filters, at + HASH);
    sha256(first, (size_t)(last - first), at + 2 * HASH);
    sha256(all, sizeof all, p->law_hash);
}

/* What is not sealed is read for the reason only. */
static enum answer read_whole(package *p, unsigned char *bytes, bytes_left b, int sealed)
{
    uint32_t w[WORDS];
    const unsigned char *places;
    enum answer found;

    if ((found = read_words(bytes, w)) != DONE)
        return found;
    memcpy(&p->period_s, bytes + 8 + sizeof w, sizeof p->period_s);
    if (!(p->period_s > 0) || !finite(&p->period_s, 1))
        return BAD_NUMBER;
    p->law.states = (int)w[W_STATES];
    p->law.inputs = (int)w[W_INPUTS];
    p->law.outputs = (int)w[W_OUTPUTS];
    p->law.filters = (int)w[W_FILTERS];
    p->law.pairs = w[W_FLAGS] & MODAL ? (int)w[W_PAIRS] : -1;
    p->law.ramp = (long)w[W_RAMP];
    p->samples = (long)w[W_SAMPLES];
    p->start_level = (long)w[W_START];
    if ((found = read_texts(p, &b)) != DONE)
        return found;
    places = b.at;
    if ((found = read_places(p, &b, bytes)) != DONE || (found = read_limits(&p->law, &b)) != DONE)
        return found;
    if ((found = read_numbers(p, &b, w)) != DONE)
        return found;
    if ((found = read_end(p, &b)) != DONE || !sealed)
        return found;
    hash_law(p, w, p->texts + 2 + text_length(p->texts), places);
    return w[W_FLAGS] & UNSTABLE || poles_within(&p->law) ? DONE : UNDECLARED_POLE;
}

enum answer package_read(package *p, unsigned char *bytes, size_t count)
{
    enum answer found;
    bytes_left b;
    int sealed;

    memset(p, 0, sizeof *p);
    if (count == 0)
        return NO_BYTES;
    if (count >= 8 && memcmp(bytes, "MIDDECKP", 8) != 0)
        return BAD_MAGIC;
    if (count < HEAD + HASH)
        return CUT_SHORT;
    if (count > LARGEST_PACKAGE)
        return BAD_LENGTH;
    b.at = bytes + HEAD;
    b.end = bytes + count / 8 * 8 - HASH;
    sha256(bytes, count - HASH, p->hash);
    sealed = count % 8 == 0 && memcmp(p->hash, bytes + count - HASH, HASH) == 0;
    found = read_whole(p, bytes, b, sealed);
    if (sealed)
        return found;
    return found == BAD_LENGTH ? CUT_SHORT : BAD_HASH;
}

enum answer package_replay(const package *p, law_state *state)
{
    const law_tables *t = &p->law;
    real y[CHANNELS], u[CHANNELS];
    long k;
    int i;

    law_reset(state, t);
    state->level = p->start_level;
    for (k = 0; k < p->samples; ++k) {
        state->engaged = p->test_engaged[k];
        for (i = 0; i < t->inputs; ++i)
            y[i] = p->test_y[i * p->samples + k];
        law_compute(state, t, y, 1, u);
        law_commit(state, t, u);
        for (i = 0; i < t->outputs; ++i)
            if (memcmp(&u[i], &p->test_u[i * p->samples + k], sizeof(real)) != 0)
                return BAD_VECTORS;
    }
    return DONE;
}
