/* The first cause of a trip in a sample. */
#ifndef MIDDECK_TRIP_H
#define MIDDECK_TRIP_H

#include "shared.h"

typedef struct {
    whole kind, channel;
    real value, limit;
} trip_cause;

static inline void blame(trip_cause *cause, enum trip kind, whole channel, real value, real limit)
{
    if (cause->kind == NO_TRIP) {
        cause->kind = kind;
        cause->channel = channel;
        cause->value = value;
        cause->limit = limit;
    }
}

#endif
