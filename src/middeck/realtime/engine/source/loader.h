/* The thread that checks a package beside the loop, which hands it over and asks for it by two words. */
#ifndef MIDDECK_LOADER_H
#define MIDDECK_LOADER_H

#include "engine.h"
#include "mapped.h"

/* A package on its way into a slot. */
typedef struct {
    int wanted, done; /* words that both sides read */
    whole slot, size;
    int with_proof;
    enum answer found;
    const shared *file;
    engine *engine;
} loading;

/* Copy what waits to be loaded, then check the copy: what is checked is what will run. */
enum answer load_package(const shared *f, engine *e, whole slot, whole size, int with_proof);

/* Start the thread, which looks at "wanted" again and again; 0 where there is none. */
int start_loader(loading *l);

#endif
