#define _DEFAULT_SOURCE
#include "mapped.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static unsigned char *map_whole(const char *path, whole *size)
{
    const int file = open(path, O_RDWR);
    struct stat found;
    void *start;

    if (file < 0 || fstat(file, &found) != 0) {
        perror(path);
        return NULL;
    }
    *size = (whole)found.st_size;
    if (*size < (whole)sizeof(places)) {
        fprintf(stderr, "%s: too short for a shared file\n", path);
        return NULL;
    }
    start = mmap(NULL, (size_t)*size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (start == MAP_FAILED) {
        perror(path);
        return NULL;
    }
    return start;
}

/* What it plays, where nobody changes it afterwards. */
static const char *take_waveform(shared *f)
{
    const real *given = (const real *)(const void *)(f->start + f->at.waveform);
    const size_t count = (size_t)(f->at.waveform_samples * f->set.outputs);
    real *copy;
    size_t i;

    if (count == 0)
        return NULL;
    copy = mmap(NULL, count * sizeof *copy, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (copy == MAP_FAILED)
        return "no memory for the excitation";
    memcpy(copy, given, count * sizeof *copy);
    for (i = 0; i < count; ++i)
        if (!(copy[i] - copy[i] == 0))
            return "an excitation that is not finite";
    f->waveform = copy;
    return NULL;
}

static const char *take(shared *f, whole size)
{
    const char *why;

    memcpy(&f->at, f->start, sizeof f->at);
    if ((why = misfit_of_places(&f->at, size)) != NULL)
        return why;
    memcpy(&f->set, f->start + f->at.settings, sizeof f->set);
    memcpy(&f->article, f->start + f->at.article, sizeof f->article);
    if ((why = misfit_of_settings(&f->set)) != NULL)
        return why;
    if (f->set.rig == LINEAR_RIG && (why = misfit_of_article(&f->article, &f->set)) != NULL)
        return why;
    if ((why = misfit_of_regions(&f->at, &f->set)) != NULL)
        return why;
    return take_waveform(f);
}

int map_file(const char *path, shared *f)
{
    const char *why;
    whole size;

    f->start = map_whole(path, &size);
    if (!f->start)
        return 0;
    if ((why = take(f, size)) != NULL) {
        fprintf(stderr, "%s: %s\n", path, why);
        return 0;
    }
    f->asks = (asks *)(void *)(f->start + f->at.asks);
    f->status = (status *)(void *)(f->start + f->at.status);
    f->commands = (const command *)(const void *)(f->start + f->at.commands);
    f->acknowledgements = (acknowledgement *)(void *)(f->start + f->at.acknowledgements);
    f->events = (event *)(void *)(f->start + f->at.events);
    memset(f->status, 0, sizeof *f->status);
    return 1;
}

const real *article_numbers_of(const shared *f)
{
    return (const real *)(const void *)(f->start + f->at.article_numbers);
}
