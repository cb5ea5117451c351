/* Arithmetic of a law in its one order of rounding. "real" is its type. The generated C and the engine hold this same text. */

#ifdef __AVX__
#define TILE 24 /* rows whose sums fit the registers */
#else
#define TILE 12
#endif

/* A tile of rows of out += columns v: its sums stay in registers. */
static inline void add_tile(real *restrict out, int size, int rows, const real *restrict column, int count, const real *restrict v)
{
    real sum[TILE];
    int i, j;

    for (i = 0; i < size; ++i)
        sum[i] = out[i];
    for (j = 0; j < count; ++j, column += rows)
        for (i = 0; i < size; ++i)
            sum[i] += column[i] * v[j];
    for (i = 0; i < size; ++i)
        out[i] = sum[i];
}

/* out += columns v, in the order of the columns. */
static inline void add_columns(real *restrict out, int rows, const real *restrict columns, int count, const real *restrict v)
{
    int first;

    for (first = 0; first + TILE <= rows; first += TILE)
        add_tile(out + first, TILE, rows, columns + first, count, v);
    if (first < rows)
        add_tile(out + first, rows % TILE, rows, columns + first, count, v);
}

/* The last finite value within the range; how many inputs were not finite or beyond it. */
static inline int take_inputs(real *held, const real *y, const real *reach, int count)
{
    int i, taken = 0;

    for (i = 0; i < count; ++i) {
        if (!(y[i] - y[i] == 0)) { /* not finite: the last value is kept */
            ++taken;
        } else if (y[i] > reach[i]) {
            held[i] = reach[i];
            ++taken;
        } else if (y[i] < -reach[i]) {
            held[i] = -reach[i];
            ++taken;
        } else {
            held[i] = y[i];
        }
    }
    return taken;
}

/* The transposed second form. */
static inline real through_section(const real *g, real *s, real value)
{
    real out = g[0] * value + s[0];

    s[0] = (g[1] * value - g[3] * out) + s[1];
    s[1] = g[2] * value - g[4] * out;
    return out;
}

/* 3 s^2 - 2 s^3 of the ramp. */
static inline real fade_at(long level, long ramp)
{
    const real part = (real)level / (real)ramp;

    return part * part * (3 - 2 * part);
}

/* Slew, then size; where the command t is no number the inner loop p stands alone, or zero. */
static inline real limited(real t, real p, real last, real slew, real least, real most)
{
    const real low = last - slew, high = last + slew;

    if (t != t)
        t = p != p ? 0 : p;
    t = t < low ? low : t > high ? high : t;
    return t < least ? least : t > most ? most : t;
}
