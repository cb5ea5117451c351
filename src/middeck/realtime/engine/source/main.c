/* The engine's process: clock, rig, commands and records around the loop of engine.c.

   engine FILE  runs what stands in FILE, which the supervisor has made, until it is told to end.
*/
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "engine.h"
#include "rig.h"
#include "words.h"

enum { GRANTED_PRIORITY = 1, GRANTED_MEMORY = 2, GRANTED_PROCESSOR = 4 };
static const whole SECOND = 1000000000;

/* The regions of the file. */
typedef struct {
    unsigned char *start;
    const places *at;
    const settings *set;
    asks *asks;
    status *status;
    const command *commands;
    acknowledgement *acknowledgements;
    event *events;
} shared;

/* A package on its way into a slot, checked beside the loop in real time. */
typedef struct {
    pthread_mutex_t lock;
    pthread_cond_t wake;
    int wanted, done; /* under the lock */
    whole slot, size;
    enum answer found;
    const shared *file;
} loader;

static engine the_engine;
static loader the_loader = {.lock = PTHREAD_MUTEX_INITIALIZER, .wake = PTHREAD_COND_INITIALIZER};
static volatile sig_atomic_t asked_to_end;

static void on_signal(int signal)
{
    (void)signal;
    asked_to_end = 1;
}

static whole now_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (whole)t.tv_sec * SECOND + t.tv_nsec;
}

static int within(const places *at, whole place, whole size)
{
    return place >= (whole)sizeof *at && size >= 0 && place % 8 == 0 && place <= at->size && size <= at->size - place;
}

static int places_fit(const places *at, whole size)
{
    const settings *set = (const settings *)(const void *)((const unsigned char *)at + at->settings);

    if (at->magic != MAGIC || at->format != FORMAT || at->size != size)
        return 0;
    if (!within(at, at->settings, sizeof(settings)) || set->inputs < 1 || set->inputs > CHANNELS || set->outputs < 1 || set->outputs > CHANNELS)
        return 0;
    return at->stride == (whole)(sizeof(record_head) + sizeof(real) * (size_t)(set->inputs + (3 + 2 * SLOTS) * set->outputs + 1))
        && within(at, at->article, sizeof(article)) && within(at, at->article_numbers, at->article_count * 8)
        && within(at, at->asks, sizeof(asks)) && within(at, at->status, sizeof(status))
        && within(at, at->commands, COMMANDS * sizeof(command)) && within(at, at->acknowledgements, COMMANDS * sizeof(acknowledgement))
        && within(at, at->events, EVENTS * sizeof(event)) && at->ring_count > 0 && within(at, at->ring, at->ring_count * at->stride)
        && at->pretrip_count > 0 && within(at, at->pretrip, at->pretrip_count * at->stride)
        && within(at, at->waveform, at->waveform_samples * set->outputs * 8) && within(at, at->staging, at->staging_size);
}

static int map_file(const char *path, shared *f)
{
    const int file = open(path, O_RDWR);
    struct stat found;

    if (file < 0 || fstat(file, &found) != 0 || found.st_size < (off_t)sizeof(places)) {
        perror(path);
        return 0;
    }
    f->start = mmap(NULL, (size_t)found.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (f->start == MAP_FAILED) {
        perror(path);
        return 0;
    }
    f->at = (const places *)(const void *)f->start;
    if (!places_fit(f->at, (whole)found.st_size)) {
        fprintf(stderr, "%s: not laid out for this engine\n", path);
        return 0;
    }
    f->set = (const settings *)(const void *)(f->start + f->at->settings);
    f->asks = (asks *)(void *)(f->start + f->at->asks);
    f->status = (status *)(void *)(f->start + f->at->status);
    f->commands = (const command *)(const void *)(f->start + f->at->commands);
    f->acknowledgements = (acknowledgement *)(void *)(f->start + f->at->acknowledgements);
    f->events = (event *)(void *)(f->start + f->at->events);
    return 1;
}

/* Copy first, check the copy: what is checked is what will run. */
static enum answer load_from(const shared *f, whole which, whole size)
{
    if (size < 0 || size > LARGEST_PACKAGE || size > f->at->staging_size)
        return BAD_LENGTH;
    memcpy(the_engine.slots[which].bytes, f->start + f->at->staging, (size_t)size);
    return engine_load(&the_engine, (int)which, (size_t)size);
}

static void *load_beside(void *nothing)
{
    (void)nothing;
    pthread_mutex_lock(&the_loader.lock);
    for (;;) {
        while (!the_loader.wanted)
            pthread_cond_wait(&the_loader.wake, &the_loader.lock);
        the_loader.wanted = 0;
        pthread_mutex_unlock(&the_loader.lock);
        the_loader.found = load_from(the_loader.file, the_loader.slot, the_loader.size);
        word_set(&the_loader.done, 1);
        pthread_mutex_lock(&the_loader.lock);
    }
    return NULL;
}

static void publish_events(const shared *f)
{
    whole count = f->status->events;
    int k;

    for (k = 0; k < the_engine.happenings; ++k) {
        event *slot = &f->events[count % EVENTS];

        word_set(&slot->sequence, 0);
        *slot = the_engine.happened[k];
        word_set(&slot->sequence, ++count);
        word_set(&f->status->events, count);
    }
    the_engine.happenings = 0;
}

static whole slot_bits(void)
{
    whole bits = 0;
    int k;

    for (k = 0; k < SLOTS; ++k)
        bits |= (whole)(the_engine.slots[k].running | the_engine.slots[k].in_control << 1) << 2 * k;
    return bits;
}

static void publish_record(const shared *f, const real *y, whole late_ns, whole step_ns)
{
    const whole sample = the_engine.sample - 1;
    unsigned char *place = f->start + f->at->ring + sample % f->at->ring_count * f->at->stride;
    record_head *head = (record_head *)(void *)place;

    word_set(&head->sequence, 0);
    head->state = the_engine.state;
    head->trip = the_engine.trip;
    head->slots = slot_bits();
    head->saturated = (whole)the_engine.saturated;
    head->unhealthy = (whole)the_engine.sensors.unhealthy;
    head->late_ns = late_ns;
    head->step_ns = step_ns;
    engine_record(&the_engine, y, (real *)(void *)(head + 1));
    word_set(&head->sequence, sample + 1);
    if (sample - word_get(&f->asks->taken) >= f->at->ring_count)
        ++f->status->lost;
    if (!f->status->frozen) {
        memcpy(f->start + f->at->pretrip + sample % f->at->pretrip_count * f->at->stride, place, (size_t)f->at->stride);
        f->status->frozen_at = sample + 1;
    }
}

static void publish_status(const shared *f)
{
    status *s = f->status;
    int k;

    s->state = the_engine.state;
    s->trip = the_engine.trip;
    s->trips = the_engine.trips;
    s->hold_verified = the_engine.hold_verified;
    s->frozen = the_engine.state == SAFE && the_engine.trip > 0;
    for (k = 0; k < SLOTS; ++k) {
        s->loaded[k] = the_engine.slots[k].loaded;
        memcpy(s->slot_hash[k], the_engine.slots[k].p.hash, sizeof s->slot_hash[k]);
    }
    if (s->blacklisted != the_engine.blacklisted) {
        memcpy(s->blacklist, the_engine.blacklist, sizeof s->blacklist);
        s->blacklisted = the_engine.blacklisted;
    }
    word_set(&s->sample, the_engine.sample);
}

/* What a command has changed is seen before its answer. */
static void acknowledge(const shared *f, const command *c, enum answer answer)
{
    acknowledgement *a = &f->acknowledgements[c->number % COMMANDS];

    publish_events(f);
    publish_status(f);
    a->number = c->number;
    a->sample = the_engine.sample;
    a->answer = answer;
    a->detail = c->kind;
    word_set(&f->status->acknowledged, c->number);
}

/* Begin or finish a LOAD; 0 while it goes on. */
static int load(const shared *f, const command *c, int *under_way, enum answer *answer)
{
    if (!*under_way) {
        if (c->slot < 0 || c->slot >= SLOTS) {
            *answer = WRONG_SLOT;
            return 1;
        }
        if (the_engine.slots[c->slot].running) {
            *answer = BUSY;
            return 1;
        }
        if (f->set->clock == LOCKSTEP) {
            *answer = engine_loaded(&the_engine, (int)c->slot, load_from(f, c->slot, (whole)c->value[0]));
            return 1;
        }
        if (pthread_mutex_trylock(&the_loader.lock) != 0)
            return 0; /* the loader is at its lock: next sample */
        the_loader.slot = c->slot;
        the_loader.size = (whole)c->value[0];
        the_loader.file = f;
        the_loader.done = 0;
        the_loader.wanted = 1;
        pthread_cond_signal(&the_loader.wake);
        pthread_mutex_unlock(&the_loader.lock);
        *under_way = 1;
        return 0;
    }
    if (!word_get(&the_loader.done))
        return 0;
    *under_way = 0;
    *answer = engine_loaded(&the_engine, (int)c->slot, the_loader.found);
    return 1;
}

/* Carry out what is due, in order; 1 where the end was asked for. */
static int take_commands(const shared *f, int *under_way)
{
    whole next = f->status->acknowledged + 1;

    for (; next <= word_get(&f->asks->written); ++next) {
        const command c = f->commands[next % COMMANDS];
        enum answer answer = UNKNOWN_COMMAND;

        if (c.number != next || c.at > the_engine.sample)
            return 0;
        if (c.kind == LOAD && !load(f, &c, under_way, &answer))
            return 0;
        if (c.kind == END)
            answer = DONE;
        else if (c.kind != LOAD)
            answer = engine_command(&the_engine, &c);
        acknowledge(f, &c, answer);
        if (c.kind == END)
            return 1;
    }
    return 0;
}

/* What has been seen of the supervisor's words. */
typedef struct {
    whole stop, heartbeat, silent, until;
} watch;

/* Beats are counted in samples; in lockstep a beat holds for all that the supervisor then lets run. */
static void look_at_asks(const shared *f, watch *w, circumstances *c)
{
    const whole stop = word_get(&f->asks->stop), beat = word_get(&f->asks->heartbeat), until = word_get(&f->asks->until);

    c->stop = stop != w->stop;
    w->stop = stop;
    if (beat != w->heartbeat)
        w->silent = 0;
    else if (f->set->clock == REAL_TIME || until != w->until || w->silent > 0)
        ++w->silent;
    w->heartbeat = beat;
    w->until = until;
    c->silent = f->set->heartbeat && w->silent > f->set->heartbeat;
}

static void one_sample(const shared *f, rig *r, watch *w, circumstances *c)
{
    static real y[CHANNELS];
    real u[CHANNELS];
    const int timed = f->set->clock == REAL_TIME;
    whole begun, took;
    enum rig_answer answer;

    look_at_asks(f, w, c);
    begun = timed ? now_ns() : 0;
    answer = r->read(r, y);
    c->no_answer = answer == RIG_MISSED;
    c->rig_dead = answer == RIG_LOST;
    engine_sample(&the_engine, y, c, u);
    if (r->write(r, u, f->status->alive) == RIG_LOST)
        c->rig_dead = 1;
    took = timed ? now_ns() - begun : 0;
    if (took > f->status->worst_step_ns)
        f->status->worst_step_ns = took;
    publish_events(f);
    publish_record(f, y, c->late_ns, took);
    word_set(&f->status->alive, f->status->alive + 1);
    publish_status(f);
}

/* Until the supervisor lets it run on; 0 where the supervisor is gone. */
static int wait_for_leave(const shared *f, pid_t parent)
{
    const struct timespec pause = {0, 50000};
    int turns = 0;

    while (the_engine.sample >= word_get(&f->asks->until)) {
        if (f->status->acknowledged < word_get(&f->asks->written))
            return 1;
        if (++turns < 200)
            sched_yield();
        else
            nanosleep(&pause, NULL);
        if (getppid() != parent || asked_to_end)
            return 0;
    }
    return 1;
}

static void run_in_lockstep(const shared *f, rig *r)
{
    const pid_t parent = getppid();
    watch w = {0};
    int loading = 0;

    w.until = -1;
    while (wait_for_leave(f, parent)) {
        circumstances c = {0};

        if (take_commands(f, &loading))
            return;
        if (the_engine.sample < word_get(&f->asks->until))
            one_sample(f, r, &w, &c);
    }
}

static void ask_for_real_time(const shared *f)
{
    const settings *set = f->set;
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
static void look_at_clock(const shared *f, whole missed, whole *in_row, circumstances *c)
{
    const whole late = c->late_ns;

    if (late > f->status->worst_late_ns)
        f->status->worst_late_ns = late;
    if (late <= f->set->late_ns) {
        *in_row = 0;
        return;
    }
    ++f->status->late;
    ++*in_row;
    c->late = *in_row > f->set->late_most || missed > f->set->late_most;
}

static void run_in_real_time(const shared *f, rig *r)
{
    const whole period = (whole)(f->set->period_s * 1e9 + 0.5);
    watch w = {0};
    whole next, in_row = 0, missed = 0, ending = 0;
    int loading = 0;
    pthread_t beside;

    if (pthread_create(&beside, NULL, load_beside, NULL) != 0) {
        perror("the loader's thread");
        return;
    }
    ask_for_real_time(f);
    w.stop = word_get(&f->asks->stop);
    next = now_ns() + period;
    for (;;) {
        circumstances c = {0};

        c.late_ns = sleep_to(&next, period, &missed);
        look_at_clock(f, missed, &in_row, &c);
        if (take_commands(f, &loading) || (ending && ++ending > f->set->safe_ramp + 2))
            return;
        if (asked_to_end && !ending) { /* told to go: first to SAFE, then out */
            ending = 1;
            w.stop = word_get(&f->asks->stop) - 1;
        }
        one_sample(f, r, &w, &c);
    }
}

static rig *open_rig(const shared *f)
{
    const article *a = (const article *)(const void *)(f->start + f->at->article);

    switch (f->set->rig) {
    case LINEAR_RIG:
        return open_linear_rig(f->set, a, (const real *)(const void *)(f->start + f->at->article_numbers), f->at->article_count);
    case UDP_RIG:
        return open_udp_rig(f->set);
    default:
        return open_driver(f->set);
    }
}

int main(int count, char **words)
{
    static const real nothing[CHANNELS];
    shared f;
    rig *r;

    if (count != 2) {
        fputs("usage: engine FILE\n", stderr);
        return 2;
    }
    if (!map_file(words[1], &f))
        return 2;
    signal(SIGTERM, on_signal);
    signal(SIGINT, SIG_IGN); /* of the terminal: the supervisor decides */
    engine_start(&the_engine, f.set, (const real *)(const void *)(f.start + f.at->waveform), f.at->waveform_samples);
    r = open_rig(&f);
    if (!r)
        return 3;
    f.status->pid = getpid();
    f.status->format = FORMAT;
    f.status->size = sizeof(status);
    word_set(&f.status->running, 1);
    if (f.set->clock == LOCKSTEP)
        run_in_lockstep(&f, r);
    else
        run_in_real_time(&f, r);
    r->write(r, nothing, f.status->alive);
    r->close(r);
    engine_tell(&the_engine, ENDED, -1, 0, 0, NULL);
    publish_events(&f);
    word_set(&f.status->running, 0);
    return 0;
}
