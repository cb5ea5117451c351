/* Arithmetic of a law in its one order of rounding. "real" is its type. The generated C and the engine hold this same text. */

#if defined(__GNUC__) && defined(__SSE2__)
#if defined(__AVX512F__)
enum { WIDTH = 64, MOST = 20 };
#elif defined(__AVX__)
enum { WIDTH = 32, MOST = 10 }; /* bytes of a register; registers for sums */
#else
enum { WIDTH = 16, MOST = 12 };
#endif
enum { LANES = WIDTH / (int)sizeof(real) };
typedef real lanes __attribute__((vector_size(WIDTH), aligned(sizeof(real)), may_alias));
typedef real half_lanes __attribute__((vector_size(WIDTH / 2), aligned(sizeof(real)), may_alias));
#define INLINED static inline __attribute__((always_inline))
#else
enum { LANES = 1, MOST = 12 };
typedef real lanes, half_lanes;
#define INLINED static inline
#endif

#ifdef __GNUC__
#define OPTIONAL static inline __attribute__((unused)) /* not every law has them */
#else
#define OPTIONAL static inline
#endif

/* A tile of rows of out += columns v, ``whole`` registers and ``rest`` rows: its sums stay in registers, which arrays of plain
   numbers do not with every compiler; of the rest as many as half a register takes. Each row is summed by itself, column by
   column, whatever the registers are. */
INLINED void add_tile(real *restrict out, int whole, int rest, int rows, const real *restrict column, int count, const real *restrict v)
{
    enum { HALF = LANES / 2 };
    const int half = HALF > 1 && rest >= HALF, at = whole * LANES, left = at + half * HALF, end = at + rest;
    lanes sum[MOST];
    half_lanes part = {0};
    real single[LANES] = {0};
    int i, j;

    for (i = 0; i < whole; ++i)
        sum[i] = ((const lanes *)out)[i];
    if (half)
        part = *(const half_lanes *)(out + at);
    for (i = left; i < end; ++i)
        single[i - left] = out[i];
    for (j = 0; j < count; ++j, column += rows) {
        for (i = 0; i < whole; ++i)
            sum[i] += ((const lanes *)column)[i] * v[j];
        if (half)
            part += *(const half_lanes *)(column + at) * v[j];
        for (i = left; i < end; ++i)
            single[i - left] += column[i] * v[j];
    }
    for (i = 0; i < whole; ++i)
        ((lanes *)out)[i] = sum[i];
    if (half)
        *(half_lanes *)(out + at) = part;
    for (i = left; i < end; ++i)
        out[i] = single[i - left];
}

/* out += columns v, in the order of the columns. */
INLINED void add_columns(real *restrict out, int rows, const real *restrict columns, int count, const real *restrict v)
{
    const int left = rows % (MOST * LANES);
    int first;

    for (first = 0; first < rows - left; first += MOST * LANES)
        add_tile(out + first, MOST, 0, rows, columns + first, count, v);
    if (left > 0)
        add_tile(out + first, left / LANES, left % LANES, rows, columns + first, count, v);
}

/* Below this a state is zero: products of it would leave the normal numbers, where a processor takes a hundred times as long. */
#define SMALLEST ((real)(sizeof(real) == 4 ? 0x1p-100 : 0x1p-900))

static inline real kept(real v)
{
    return ((v < SMALLEST) & (v > -SMALLEST)) ? 0 : v;
}

/* The last finite value within the range; how many inputs were not finite or beyond it. */
static inline int take_inputs(real *held, const real *y, const real *limit, int count)
{
    int i, taken = 0;

    for (i = 0; i < count; ++i) {
        if (y[i] <= limit[i] && y[i] >= -limit[i]) {
            held[i] = y[i];
        } else {
            ++taken;
            if (y[i] - y[i] == 0) /* else not finite: the last value is kept */
                held[i] = y[i] > 0 ? limit[i] : -limit[i];
        }
    }
    return taken;
}

/* The transposed second form. */
OPTIONAL real through_section(const real *g, real *s, real value)
{
    real out = g[0] * value + s[0];

    s[0] = kept((g[1] * value - g[3] * out) + s[1]);
    s[1] = kept(g[2] * value - g[4] * out);
    return out;
}

/* 3 s^2 - 2 s^3 of the ramp. */
OPTIONAL real fade_at(long level, long ramp)
{
    const real part = (real)level / (real)ramp;

    return part * part * (3 - 2 * part);
}

/* Slew, then size; where the command t is no number the inner loop p stands alone, or zero. */
static inline real limited(real t, real p, real last, real step, real bottom, real top)
{
    const real low = last - step, high = last + step;

    if (t != t)
        t = p != p ? 0 : p;
    t = t < low ? low : t > high ? high : t;
    return t < bottom ? bottom : t > top ? top : t;
}
