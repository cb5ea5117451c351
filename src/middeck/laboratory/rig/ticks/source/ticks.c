/* The ticks of a simulated rig whose joints have friction alone: what `tick.py` and `_run_ticks` do, in C.

   The order within a tick is theirs, and so are every branch and every sum: the two give the same bits.
   Matrices come by columns. */
#include <math.h>

typedef struct {
    long ticks, states, joints, inputs, outputs, substeps, feels, noisy, depth, kept, computed, iterations;
    const double *step, *drive, *push, *compliance, *look, *compute, *shift;
    const double *friction, *limits, *converters, *excitation, *offset, *noise;
    double *x, *angles, *sliders, *torques, *stands, *previous, *momentum, *digital, *rows, *issued, *work;
} Run;

enum { LIMITS = 7, CONVERTER = 3, FRICTION = 2 };

/* y += matrix v, column by column as `products.py` does; four of them in a pass are fewer passes, and no other sum. */
static void add_product(double *restrict y, const double *restrict matrix, const double *restrict v, long rows,
                        long columns)
{
    long j = 0;
    for (; j + 4 <= columns; j += 4) {
        const double *a = matrix + j * rows, *b = a + rows, *c = b + rows, *d = c + rows;
        const double p = v[j], q = v[j + 1], r = v[j + 2], s = v[j + 3];
        for (long i = 0; i < rows; i++)
            y[i] = (((y[i] + a[i] * p) + b[i] * q) + c[i] * r) + d[i] * s;
    }
    for (; j < columns; j++)
        for (long i = 0; i < rows; i++)
            y[i] += matrix[j * rows + i] * v[j];
}

static void product(double *restrict y, const double *restrict matrix, const double *restrict v, long rows,
                    long columns)
{
    for (long i = 0; i < rows; i++)
        y[i] = 0.0;
    add_product(y, matrix, v, rows, columns);
}

/* Whole counts where there are counts; never minus zero. */
static double whole(double counts, double limit)
{
    return -limit < counts && counts < limit ? rint(counts) + 0.0 : counts;
}

/* `Friction.balance` */
static double balance_one(const double *friction, double start, double free, double slider, double compliance)
{
    const double slip = friction[0], k = friction[1];
    const double half = 0.5 * k, begin = k * (start - slider), way = free - start;
    const double torque = (begin + half * way) / (1.0 + half * compliance);
    const double gone = way - compliance * torque, sign = gone > 0.0 ? 1.0 : -1.0;
    if (sign * (begin + k * gone) <= slip)
        return torque;
    const double room = (slip - sign * begin) / k;
    if (room <= 0.0)
        return sign * slip;
    const double lost = half * room * room, slack = sign * way - compliance * slip;
    const double slipped = 0.5 * (slack + sqrt(slack * slack + 4.0 * compliance * lost));
    return slipped > 0.0 ? sign * (slip - lost / slipped) : sign * slip;
}

/* `Balance.solve`; zero where the torques do not settle. */
static int balance(const Run *r, const double *compliance, const double *free)
{
    const long n = r->joints;
    for (long iteration = 0; iteration < r->iterations; iteration++) {
        int settled = 1;
        for (long j = 0; j < n; j++) {
            const double own = compliance[j * n + j], last = r->torques[j];
            double pushed = 0.0;
            for (long i = 0; i < n; i++)
                if (i != j)
                    pushed += compliance[j * n + i] * r->torques[i];
            const double left = free[j] - pushed;
            const double new = balance_one(r->friction + j * FRICTION, r->angles[j], left, r->sliders[j], own);
            const double change = fabs(new - last);
            if (change > 0.0) {
                r->torques[j] = new;
                const double noise = 4e-16 * (fabs(left - own * new) + fabs(r->angles[j])) / own;
                settled = settled && change <= 1e-14 * fabs(new) + noise;
            }
        }
        if (settled || n == 1)
            return 1;
    }
    return 0;
}

/* `Tick._rub`: torques held over substep j, where the joints then stand, and what samples feel. */
static int rub(const Run *r, long j, const double *free, double *held)
{
    const long n = r->joints, columns = r->feels ? 3 * n : n;
    const double *compliance = r->compliance + j * n * n;
    if (!balance(r, compliance, free))
        return 0;
    for (long i = 0; i < n; i++) {
        const double slip = r->friction[i * FRICTION], k = r->friction[i * FRICTION + 1];
        double end = free[i];
        for (long other = 0; other < n; other++)
            end -= compliance[i * n + other] * r->torques[other];
        double stands = k * (end - r->sliders[i]);
        if (!(fabs(stands) <= slip)) {
            stands = copysign(slip, stands);
            r->sliders[i] = end - stands / k;
        }
        held[i] = -r->torques[i];
        if (r->feels) {
            held[n + i] = -r->stands[i];
            held[2 * n + i] = -stands;
        }
        r->angles[i] = end;
        r->stands[i] = stands;
    }
    add_product(r->x, r->push + j * r->states * columns, held, r->states, columns);
    return 1;
}

/* `Tick.read`, in counts. */
static void read_sensors(const Run *r, long k, double *counts, double *sampled)
{
    product(sampled, r->look, r->x, r->outputs, r->states);
    for (long i = 0; i < r->outputs; i++) {
        const double *c = r->converters + i * CONVERTER;
        double value = sampled[i] + r->offset[k * r->outputs + i];
        value = value < c[0] ? c[0] : value > c[1] ? c[1] : value;
        counts[i] = whole(value, c[2]);
    }
}

/* `LimitedMotors.drive` */
static void drive_motors(const Run *r, const double *command, const double *excitation, double *torque)
{
    for (long i = 0; i < r->inputs; i++) {
        const double *l = r->limits + i * LIMITS, last = r->previous[i], stored = r->momentum[i];
        double wanted = command[i] + excitation[i], counts = wanted * l[1];
        if (-l[2] < counts && counts < l[2])
            wanted = whole(counts, l[2]) * l[0];
        wanted = wanted < last - l[3] ? last - l[3] : wanted > last + l[3] ? last + l[3] : wanted;
        wanted = wanted < l[4] ? l[4] : wanted > l[5] ? l[5] : wanted;
        wanted = wanted < stored - l[6] ? stored - l[6] : wanted > stored + l[6] ? stored + l[6] : wanted;
        r->momentum[i] = stored - wanted;
        r->previous[i] = torque[i] = wanted;
    }
}

/* `Tick.move` */
static int move(const Run *r, const double *window, const double *noise)
{
    const long rows = r->states + r->joints;
    double *after = r->work, *held = after + rows;
    for (long j = 0; j < r->substeps; j++) {
        product(after, r->step + j * rows * r->states, r->x, rows, r->states);
        add_product(after, r->drive + j * rows * 2 * r->inputs, window, rows, 2 * r->inputs);
        for (long i = 0; i < r->states; i++)
            r->x[i] = after[i];
        if (r->joints && !rub(r, j, after + r->states, held))
            return 0;
    }
    if (r->noisy)
        for (long i = 0; i < r->states; i++)
            r->x[i] += noise[i];
    return 1;
}

/* The counts of a tick, behind the computer's states. */
void read_tick(const Run *r, long k)
{
    read_sensors(r, k, r->digital + k * (r->kept + r->outputs) + r->kept, r->work);
}

/* The motors and the continuous part, for the commands of a row: zero, or 1 where the joints' torques do not settle. */
int move_tick(const Run *r, long k)
{
    const double *command = r->rows + k * r->computed + r->kept + r->outputs;
    double *window = r->issued + k * r->inputs; /* the command that acts first; then comes the next */
    drive_motors(r, command, r->excitation + k * r->inputs, window + r->depth * r->inputs);
    return !move(r, window, r->noise + k * r->states);
}

/* Zero, or 1 where the joints' torques do not settle. */
int run_ticks(const Run *r)
{
    const long wide = r->kept + r->outputs;
    for (long k = 0; k < r->ticks; k++) {
        double *now = r->digital + k * wide, *row = r->rows + k * r->computed;
        read_tick(r, k);
        product(row, r->compute, now, r->computed, wide);
        for (long i = 0; i < r->computed; i++)
            row[i] -= r->shift[i];
        for (long i = 0; i < r->kept; i++)
            now[wide + i] = row[i];
        if (move_tick(r, k))
            return 1;
    }
    return 0;
}
