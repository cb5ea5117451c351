/* FNV-1a, a word of eight bytes at a time: whatever changes within one word changes it. */
#ifndef MIDDECK_CHECKSUM_H
#define MIDDECK_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline uint64_t checksum(uint64_t sum, const void *words, size_t count)
{
    const unsigned char *at = words;
    uint64_t word;

    for (; count > 0; --count, at += sizeof word) {
        memcpy(&word, at, sizeof word);
        sum = (sum ^ word) * 0x100000001b3u;
    }
    return sum;
}

#endif
