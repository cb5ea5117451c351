/* Preloaded into an engine in real time: its clock goes as a test lets it, so that lateness is a number and not a matter of the machine.
   Each sleep to a deadline is written down, waits until it is granted, and ends at its deadline, or as much later as is asked for. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { DEADLINES = 4096, SECOND = 1000000000, THIRD = 3 }; /* THIRD: reading after a sleep, at the end of the sample */

typedef struct {
    int64_t granted, sleeps, now, day; /* sleeps that may end, that have begun; ns; what the calendar's clock is off by */
    int64_t late, slow; /* once: of the next sleep, and of the computation behind it */
    int64_t deadline[DEADLINES];
} words;

static words *shared;
static int readings;

__attribute__((constructor)) static void map_words(void)
{
    const char *path = getenv("FAKED_CLOCK");
    const int file = path ? open(path, O_RDWR) : -1;
    void *start = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);

    if (start == MAP_FAILED)
        abort();
    close(file);
    shared = start;
}

static int64_t get(int64_t *word)
{
    return __atomic_load_n(word, __ATOMIC_ACQUIRE);
}

static int64_t take(int64_t *word)
{
    return __atomic_exchange_n(word, 0, __ATOMIC_ACQ_REL);
}

int clock_gettime(clockid_t clock, struct timespec *t)
{
    int64_t now;

    if (clock != CLOCK_MONOTONIC) {
        const long failed = syscall(SYS_clock_gettime, clock, t);

        t->tv_sec += clock == CLOCK_REALTIME ? (time_t)(get(&shared->day) / SECOND) : 0;
        return (int)failed;
    }
    if (++readings == THIRD)
        __atomic_add_fetch(&shared->now, take(&shared->slow), __ATOMIC_ACQ_REL);
    now = get(&shared->now);
    t->tv_sec = (time_t)(now / SECOND);
    t->tv_nsec = (long)(now % SECOND);
    return 0;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *t, struct timespec *left)
{
    const struct timespec pause = {0, 20000};
    const int64_t deadline = (int64_t)t->tv_sec * SECOND + t->tv_nsec, number = get(&shared->sleeps) + 1;

    (void)left;
    if (clock != CLOCK_MONOTONIC || flags != TIMER_ABSTIME)
        abort();
    shared->deadline[number % DEADLINES] = deadline;
    __atomic_store_n(&shared->sleeps, number, __ATOMIC_RELEASE);
    while (get(&shared->granted) < number)
        syscall(SYS_nanosleep, &pause, NULL);
    if (get(&shared->now) < deadline)
        __atomic_store_n(&shared->now, deadline, __ATOMIC_RELEASE);
    __atomic_add_fetch(&shared->now, take(&shared->late), __ATOMIC_ACQ_REL);
    readings = 0;
    return 0;
}

/* Not granted: it would take all the memory of the slots at every start. */
int mlockall(int flags)
{
    (void)flags;
    return -1;
}
