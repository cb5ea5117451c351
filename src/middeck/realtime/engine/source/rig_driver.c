/* Template of a driver for real converters: copy it, fill in four functions, and build the engine with it
   (build_engine(driver="my_driver.c")).

   - Everything that allocates, waits or may fail belongs into open_driver.
   - read and write are called once a sample from the control loop: no allocation, no lock, no system call that waits.
   - Convert counts to the units of the settings here; a sensor that gives nothing is NAN, which the engine sees in the same sample.
   - Where ``alive`` has not changed for two periods the hardware itself must bring its outputs to zero: a watchdog of the
     converter, or an external circuit that the toggling line ``alive & 1`` feeds. */
#include "rig.h"

#include <stdio.h>

static enum rig_answer read_sensors(rig *r, real *y)
{
    whole i;

    for (i = 0; i < r->set->inputs; ++i)
        y[i] = 0; /* counts to units */
    return RIG_READ;
}

static enum rig_answer write_outputs(rig *r, const real *u, whole alive)
{
    (void)r;
    (void)u;     /* units to counts */
    (void)alive; /* to the watchdog */
    return RIG_READ;
}

static void close_driver(rig *r)
{
    (void)r; /* outputs to zero, then let go */
}

rig *open_driver(const settings *set)
{
    static rig driver = {read_sensors, write_outputs, close_driver, NULL};

    driver.set = set;
    (void)driver;
    fputs("this engine was built without a driver: see rig_driver.c\n", stderr);
    return NULL; /* return &driver once it drives something */
}
