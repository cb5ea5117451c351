/* What the gate has proved of an adaptive gain, sealed: of one package, beside one hold. */
#ifndef MIDDECK_PROOF_H
#define MIDDECK_PROOF_H

#include "shared.h"

enum { PROOF = 128 };

typedef struct {
    int proved; /* whether there is one */
    real least, most, rate; /* rate: 1/s */
} gain_proof;

/* SHA-256 of the hold of these settings: names and sections of its paths. */
void hash_hold(const settings *set, unsigned char digest[32]);

/* 1 where the PROOF bytes are sealed, and of this package and this hold. */
int proof_read(gain_proof *found, const unsigned char *bytes, const unsigned char package_hash[32], const unsigned char hold_hash[32]);

/* Whether every gain and every move that the settings allow is among what is proved, at this share of authority. */
int proof_covers(const gain_proof *found, const settings *set, real share);

#endif
