/* The hold: the engine's own loops, closed beside every package and alone in SAFE, where only a verified one acts. */
#ifndef MIDDECK_HOLD_LOOPS_H
#define MIDDECK_HOLD_LOOPS_H

#include "engine.h"

/* In SAFE, or on the way there: nothing is held any more until a reset. */
void lose_hold(engine *e, const trip_cause *cause);

/* What grows, or takes all effort, while nothing but the hold is at work. */
int is_of_the_hold(const trip_cause *cause);

/* Whether SAFE may apply it. */
int hold_is_good(const engine *e);

/* In SAFE the hold lives through a short silence of its sensors on their last values, not through a long one. */
void watch_hold(engine *e);

/* In SAFE all or nothing; after a reset it rises, if it did not hold already, and at the end it falls as it rose. */
real hold_share(const engine *e);

/* What it adds to the outputs of this sample; then how much of that remains. */
void compute_hold(engine *e);
void fade_hold(engine *e);

/* The hold is verified by holding, ``alone`` and without a trip, and no longer where what it holds is proved to move out from
   window to window. Where it may only do so by chance it stays verified, but SAFE does not begin with it. */
void verify_hold(engine *e, int alone);

#endif
