#define _POSIX_C_SOURCE 200809L
#include <string.h>
#include <time.h>

#include "clocks.h"
#include "queue.h"

whole now_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (whole)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* Beats are counted in samples; in lockstep a beat holds for all that the supervisor then lets run. */
static void look_at_asks(const shared *f, watch *w, circumstances *c)
{
    const whole stop = word_get(&f->asks->stop), beat = word_get(&f->asks->heartbeat), until = word_get(&f->asks->until);

    c->stop = stop != w->stop;
    w->stop = stop;
    if (beat != w->heartbeat)
        w->silent = 0;
    else if (f->set.clock == REAL_TIME || until != w->until || w->silent > 0)
        ++w->silent;
    w->heartbeat = beat;
    w->until = until;
    c->silent = f->set.heartbeat && w->silent > f->set.heartbeat;
}

/* Whatever a driver answers that is no word of `rig_answer` is no sample either. */
static int is_dead(enum rig_answer answer)
{
    return answer != RIG_READ && answer != RIG_MISSED;
}

/* In real time a sample or two may fail to come, as one may be late, once there has been one: the last stands for them. */
static enum rig_answer read_rig(const shared *f, rig *r, watch *w, real *y)
{
    static real fresh[CHANNELS];
    const enum rig_answer answer = r->read(r, fresh);
    const whole allowed = f->set.clock == REAL_TIME && w->has_read ? f->set.late_most : 0;

    if (answer == RIG_READ) {
        memcpy(y, fresh, (size_t)f->set.inputs * sizeof *y);
        w->has_read = 1;
    }
    if (is_dead(answer) || (answer != RIG_MISSED && w->written != RIG_MISSED)) {
        w->missed = 0;
        return answer;
    }
    ++w->missed;
    ++f->status->missed;
    return w->missed > allowed ? RIG_MISSED : RIG_READ;
}

void one_sample(shared *f, engine *e, rig *r, watch *w, circumstances *c)
{
    static real y[CHANNELS];
    real u[CHANNELS];
    const int timed = f->set.clock == REAL_TIME;
    whole begun, took;
    enum rig_answer answer;

    look_at_asks(f, w, c);
    begun = timed ? now_ns() : 0;
    answer = read_rig(f, r, w, y);
    c->no_answer = answer == RIG_MISSED;
    c->rig_dead = is_dead(answer) || is_dead(w->written);
    c->foreign = answer == RIG_FOREIGN || w->written == RIG_FOREIGN;
    engine_sample(e, y, c, u);
    w->written = r->write(r, u, f->alive); /* outputs that did not arrive trip in the next sample */
    c->rig_dead |= is_dead(w->written);
    w->lost = c->rig_dead;
    took = timed ? now_ns() - begun : 0;
    if (took > f->status->worst_step_ns)
        f->status->worst_step_ns = took;
    publish_events(f, e);
    publish_record(f, e, y, c->late_ns, took);
    word_set(&f->status->alive, ++f->alive);
    publish_status(f, e);
}
