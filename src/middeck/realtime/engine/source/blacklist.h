/* Laws that are refused: those that have caused a trip, until they are forgiven. */
#ifndef MIDDECK_BLACKLIST_H
#define MIDDECK_BLACKLIST_H

#include "engine.h"

/* Whether the compensator in a slot has moved anything. */
int acts(const slot *s);

/* Whether a trip is held against the compensators that act, and which of them has the most authority; null if none acts. */
int of_a_law(const engine *e, const trip_cause *cause);
const slot *foremost(const engine *e);

void put_on_blacklist(engine *e, const unsigned char *hash);
int on_blacklist(const engine *e, const unsigned char *hash);
void take_off_blacklist(engine *e, const unsigned char *hash);

#endif
