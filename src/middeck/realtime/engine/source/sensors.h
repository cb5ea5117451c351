/* Tests of each sensor: finite, range, stuck, spread; and the first cause of a trip in a sample. */
#ifndef MIDDECK_SENSORS_H
#define MIDDECK_SENSORS_H

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

typedef struct {
    real value[CHANNELS]; /* the last good ones */
    real last[CHANNELS];  /* as read */
    whole same[CHANNELS]; /* samples of one value */
    whole apart[SPREADS]; /* samples of disagreement */
    uint64_t unhealthy;   /* a bit for each sensor */
    real reach[CHANNELS]; /* envelope; half of its range for one that the hold reads and that has none */
    real worst;           /* largest amplitude over its reach, squared */
    whole worst_at;
} sensor_tests;

/* The hold reads a bit for each sensor. */
void sensors_start(sensor_tests *s, const settings *set, uint64_t held_by);

/* There is no sample: the last values stay, and no sensor is healthy. */
void sensors_miss(sensor_tests *s);

/* Look at a sample: values, health, and the first trip. */
void sensors_look(sensor_tests *s, const settings *set, const real *y, trip_cause *cause);

#endif
