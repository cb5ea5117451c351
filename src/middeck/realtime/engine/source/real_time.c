#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <sys/mman.h>
#include <time.h>

#include "clocks.h"
#include "queue.h"

enum { GRANTED_PRIORITY = 1, GRANTED_MEMORY = 2, GRANTED_PROCESSOR = 4 };
static const whole SECOND = 1000000000;

static void ask_for_real_time(shared *f)
{
    const settings *set = &f->set;
    struct sched_param order = {0};
    cpu_set_t only;

    order.sched_priority = (int)set->priority;
    if (set->priority > 0 && sched_setscheduler(0, SCHED_FIFO, &order) == 0)
        f->status->real_time |= GRANTED_PRIORITY;
    if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0)
        f->status->real_time |= GRANTED_MEMORY;
    if (set->processor >= 0 && set->processor < CPU_SETSIZE) {
        CPU_ZERO(&only);
        CPU_SET((size_t)set->processor, &only);
        if (sched_setaffinity(0, sizeof only, &only) == 0)
            f->status->real_time |= GRANTED_PROCESSOR;
    }
}

/* Sleep to the next tick; how late it is, and how many whole periods were missed. */
static whole sleep_to(whole *next, whole period, whole *missed)
{
    const struct timespec t = {(time_t)(*next / SECOND), (long)(*next % SECOND)};
    whole late;

    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        ;
    late = now_ns() - *next;
    *missed = late / period;
    *next += (*missed + 1) * period;
    return late;
}

/* A tick's lateness counts; too many in a row, or as many periods missed at once, trip. Until then the converters hold. */
static void look_at_clock(shared *f, whole missed, whole *in_row, circumstances *c)
{
    const whole late = c->late_ns;

    if (late > f->status->worst_late_ns)
        f->status->worst_late_ns = late;
    if (late <= f->set.late_ns) {
        *in_row = 0;
        return;
    }
    ++f->status->late;
    ++*in_row;
    c->late = *in_row > f->set.late_most || missed > f->set.late_most;
}

void run_in_real_time(shared *f, engine *e, rig *r)
{
    const whole period = (whole)(f->set.period_s * 1e9 + 0.5);
    static queue commands;
    watch w = {0};
    whole next, in_row = 0, missed = 0;

    commands.load.file = f;
    commands.load.engine = e;
    if (!start_loader(&commands.load)) {
        perror("the loader's thread");
        return;
    }
    ask_for_real_time(f);
    next = now_ns() + period;
    for (;;) {
        circumstances c = {0};

        c.late_ns = sleep_to(&next, period, &missed);
        look_at_clock(f, missed, &in_row, &c);
        if (!e->ending && (asked_to_end || take_commands(&commands, f, e)))
            engine_end(e);
        if (e->ending && engine_at_rest(e))
            return;
        one_sample(f, e, r, &w, &c);
    }
}
