/* A controller package taken apart: nothing in it is believed before it is checked. */
#ifndef MIDDECK_PACKAGE_H
#define MIDDECK_PACKAGE_H

#include <stddef.h>

#include "law.h"

enum { LARGEST_PACKAGE = 1 << 24 };

typedef struct {
    law_tables law;
    real period_s;
    const unsigned char *texts; /* name, then name and unit of each port: 16 bits of length, then the text */
    long samples, start_level;
    const real *test_y, *test_u; /* column by column */
    const unsigned char *test_engaged;
    unsigned char hash[32];
    unsigned char law_hash[32]; /* of what computes: another name, ramp or limit leaves it as it is */
} package;

/* Read ``count`` bytes, aligned to eight, which the package goes on using. Limits of infinity become the largest number.
   Returns an answer of shared.h. */
enum answer package_read(package *p, unsigned char *bytes, size_t count);

/* Replay the test vectors with ``state`` as scratch: DONE where every bit agrees, else BAD_VECTORS. */
enum answer package_replay(const package *p, law_state *state);

/* 1 where no pole of the compensator has a magnitude beyond 1 + 1e-9, and all poles of its sections lie inside. Uses scratch of
   its file: one call at a time. */
int poles_within(const law_tables *t);

/* Texts of a package: 16 bits of length, then UTF-8. */
size_t text_length(const unsigned char *text);
int same_texts(const unsigned char *one, const unsigned char *other);

/* Whole UTF-8 of characters that are shown: no control, no separator but the blank, nothing for private use. */
int is_printable(const unsigned char *bytes, size_t count);
int is_blank(const unsigned char *bytes, size_t count);

/* A letter, then letters, digits, _ and -. */
int is_identifier(const unsigned char *bytes, size_t count);

/* SHA-256 of FIPS 180-4. */
void sha256(const unsigned char *data, size_t count, unsigned char digest[32]);

/* What the gate has proved of an adaptive gain, sealed: of one package, beside one hold. */
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
