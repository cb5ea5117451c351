#ifndef MIDDECK_SHA256_H
#define MIDDECK_SHA256_H

#include <stddef.h>

/* SHA-256 of FIPS 180-4. */
void sha256(const unsigned char *data, size_t count, unsigned char digest[32]);

#endif
