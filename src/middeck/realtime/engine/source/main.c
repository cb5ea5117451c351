/* The engine's process: engine FILE runs what stands in FILE, which the supervisor has made, until it is told to end. */
#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clocks.h"
#include "queue.h"

static engine the_engine;
static shared the_file;
volatile sig_atomic_t asked_to_end;

static void on_signal(int signal)
{
    (void)signal;
    asked_to_end = 1;
}

/* Again and again: `signal` may give the handler up after its first, and then the second SIGTERM kills. */
static void listen_for_the_end(void)
{
    struct sigaction action;

    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    sigaction(SIGTERM, &action, NULL);
}

static rig *open_rig(const shared *f)
{
    switch (f->set.rig) {
    case LINEAR_RIG:
        return open_linear_rig(&f->set, &f->article, article_numbers_of(f), f->at.article_count);
    case UDP_RIG:
        return open_udp_rig(&f->set, word_get(&f->asks->session), &f->status->stale);
    default:
        return open_driver(&f->set);
    }
}

/* When this process has begun, in the system's ticks: with its number it is told from any that follows under that number. */
static whole when_born(void)
{
    enum { START_TIME = 20 }; /* fields after the name */
    char text[1024] = "";
    const int file = open("/proc/self/stat", O_RDONLY);
    const char *at;
    int k;

    if (file < 0 || read(file, text, sizeof text - 1) < 0)
        return 0;
    close(file);
    at = strrchr(text, ')');
    for (k = 0; at && k < START_TIME; ++k)
        at = strchr(at + 1, ' ');
    return at ? (whole)strtoll(at, NULL, 10) : 0;
}

static void run(shared *f, engine *e, rig *r)
{
    static const real nothing[CHANNELS];

    f->status->pid = getpid();
    f->status->born = when_born();
    publish_status(f, e);
    word_set(&f->status->running, 1);
    if (f->set.clock == LOCKSTEP)
        run_in_lockstep(f, e, r);
    else
        run_in_real_time(f, e, r);
    r->write(r, nothing, f->alive);
    r->close(r);
    engine_tell(e, ENDED, -1, 0, 0, NULL);
    publish_events(f, e);
    publish_status(f, e);
    word_set(&f->status->running, 0);
}

int main(int count, char **words)
{
    rig *r;

    if (count != 2) {
        fputs("usage: engine FILE\n", stderr);
        return 2;
    }
    if (!map_file(words[1], &the_file))
        return 2;
    listen_for_the_end();
    signal(SIGINT, SIG_IGN); /* of the terminal: the supervisor decides */
    signal(SIGPIPE, SIG_IGN); /* nobody may read the standard error any more */
    engine_start(&the_engine, &the_file.set, the_file.waveform, the_file.at.waveform_samples);
    engine_ban(&the_engine, the_file.start + the_file.at.blacklist, the_file.at.blacklist_count);
    r = open_rig(&the_file);
    if (!r)
        return 3;
    run(&the_file, &the_engine, r);
    return 0;
}
