#define _POSIX_C_SOURCE 200809L
#include <sched.h>
#include <time.h>
#include <unistd.h>

#include "clocks.h"
#include "queue.h"

/* Until the supervisor lets it run on; 0 where the supervisor is gone, or a signal asks for the end. */
static int wait_for_leave(const queue *q, const shared *f, const engine *e, pid_t parent)
{
    const struct timespec pause = {0, 50000};
    int turns = 0;

    while (!asked_to_end) {
        if (e->sample < word_get(&f->asks->until) || command_is_due(q, f, e))
            return 1;
        turns += turns < 200;
        if (turns < 200)
            sched_yield();
        else
            nanosleep(&pause, NULL);
        if (getppid() != parent)
            return 0;
    }
    return 0;
}

/* Until half of the ring has been read, where records are kept by a supervisor that lives; 0 where it takes too long. */
static int wait_for_place(const shared *f, const engine *e, pid_t parent)
{
    const struct timespec pause = {0, 50000};
    int turns;

    for (turns = 0; turns < 40000 && word_get(&f->asks->keeps) && getppid() == parent; ++turns) {
        if (word_get(&f->asks->taken) >= e->sample - f->at.ring_count / 2)
            return 1;
        nanosleep(&pause, NULL);
    }
    return 0;
}

/* As far as the rig still answers. */
static void end_in_safe(shared *f, engine *e, rig *r, watch *w, pid_t parent)
{
    int waits = 1;

    engine_end(e);
    while (!engine_at_rest(e) && !w->lost) {
        circumstances c = {0};

        waits = waits && wait_for_place(f, e, parent);
        one_sample(f, e, r, w, &c);
    }
}

void run_in_lockstep(shared *f, engine *e, rig *r)
{
    static queue commands;
    const whole named = word_get(&f->asks->supervisor);
    const pid_t parent = named ? (pid_t)named : getppid();
    watch w = {0};

    w.until = -1;
    while (wait_for_leave(&commands, f, e, parent)) {
        circumstances c = {0};

        if (take_commands(&commands, f, e))
            break;
        if (e->sample < word_get(&f->asks->until))
            one_sample(f, e, r, &w, &c);
    }
    end_in_safe(f, e, r, &w, parent);
}
