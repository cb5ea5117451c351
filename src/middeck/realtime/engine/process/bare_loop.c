/* What this machine can reach: a loop that sleeps to each tick and then reads the numbers of a law once, a multiplication and an
   addition for each: no engine, no rig, no record.

   bare_loop PERIOD_NS SAMPLES NUMBERS PRIORITY PROCESSOR (-1: any) writes (lateness, time of the pass) of each sample, in ns. */
#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

enum { LANES = 16, NS = 1000000000 };

static int64_t now_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * NS + t.tv_nsec;
}

static void ask_for_real_time(int priority, int processor)
{
    struct sched_param order = {0};
    cpu_set_t only;

    order.sched_priority = priority;
    if (priority > 0)
        sched_setscheduler(0, SCHED_FIFO, &order);
    mlockall(MCL_CURRENT | MCL_FUTURE);
    if (processor >= 0 && processor < CPU_SETSIZE) {
        CPU_ZERO(&only);
        CPU_SET((size_t)processor, &only);
        sched_setaffinity(0, sizeof only, &only);
    }
}

/* Lanes that do not wait for each other: neither the processor's units nor its memory stand idle. */
static void pass(const double *numbers, size_t count, double *sum)
{
    size_t i;
    int k;

    for (i = 0; i < count; i += LANES)
        for (k = 0; k < LANES; ++k)
            sum[k] += 0.5 * numbers[i + (size_t)k];
}

int main(int words, char **word)
{
    double sum[LANES] = {0}, *numbers;
    volatile double seen;
    int64_t *taken, next;
    size_t count, samples, k;

    if (words != 6)
        return 2;
    samples = strtoul(word[2], NULL, 10);
    count = (strtoul(word[3], NULL, 10) + LANES - 1) / LANES * LANES;
    numbers = calloc(count, sizeof *numbers);
    taken = calloc(2 * samples, sizeof *taken);
    if (!numbers || !taken)
        return 3;
    for (k = 0; k < count; ++k)
        numbers[k] = 1.0 / (double)(k + 1);
    ask_for_real_time(atoi(word[4]), atoi(word[5]));
    next = now_ns();
    for (k = 0; k < samples; ++k) {
        struct timespec t;
        int64_t period = atoll(word[1]), late, begun;

        next += period;
        t.tv_sec = (time_t)(next / NS);
        t.tv_nsec = (long)(next % NS);
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
            ;
        begun = now_ns();
        late = begun - next;
        next += late / period * period;
        pass(numbers, count, sum);
        seen = sum[k % LANES];
        (void)seen;
        taken[2 * k] = late;
        taken[2 * k + 1] = now_ns() - begun;
    }
    return fwrite(taken, sizeof *taken, 2 * samples, stdout) == 2 * samples ? 0 : 4;
}
