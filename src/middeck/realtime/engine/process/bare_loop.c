/* What this machine can reach: a loop that sleeps to each tick and then reads the numbers of a law once, a multiplication and an
   addition for each: no engine, no rig, no record.
   bare_loop PERIOD_NS SAMPLES NUMBERS PRIORITY PROCESSOR (-1: any) writes (lateness, time of the pass) of each sample, in ns. */
#define _GNU_SOURCE
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

enum { LANES = 16, SECOND = 1000000000 }; /* lanes do not wait for each other */

static int64_t now_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * SECOND + t.tv_nsec;
}

static void ask_for_real_time(int priority, int processor)
{
    const struct sched_param order = {.sched_priority = priority};
    cpu_set_t only = {0};

    if (priority > 0)
        sched_setscheduler(0, SCHED_FIFO, &order);
    mlockall(MCL_CURRENT | MCL_FUTURE);
    if (processor >= 0 && processor < CPU_SETSIZE) {
        CPU_SET((size_t)processor, &only);
        sched_setaffinity(0, sizeof only, &only);
    }
}

int main(int words, char **word)
{
    const int64_t period = words == 6 ? atoll(word[1]) : 0;
    const size_t samples = period ? strtoul(word[2], NULL, 10) : 0, count = period ? strtoul(word[3], NULL, 10) : 0;
    double *numbers = calloc(count + LANES + 1, sizeof *numbers), sum[LANES] = {0};
    int64_t *taken = calloc(2 * samples + 1, sizeof *taken), next, begun;
    size_t i, k, lane;

    if (!samples || !numbers || !taken) {
        perror("room for its samples and numbers");
        return 2;
    }
    for (i = 0; i < count; ++i)
        numbers[i] = 1.0;
    ask_for_real_time(atoi(word[4]), atoi(word[5]));
    next = now_ns();
    for (k = 0; k < samples; ++k) {
        next += period;
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &(struct timespec){next / SECOND, next % SECOND}, NULL))
            ;
        begun = now_ns();
        for (i = 0; i < count; i += LANES)
            for (lane = 0; lane < LANES; ++lane)
                sum[lane] += 0.5 * numbers[i + lane];
        numbers[count + LANES] = sum[k % LANES];
        taken[2 * k] = begun - next;
        taken[2 * k + 1] = now_ns() - begun;
        next += (begun - next) / period * period;
    }
    return fwrite(taken, sizeof *taken, 2 * samples, stdout) == 2 * samples ? 0 : 4;
}
