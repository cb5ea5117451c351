/* Valid packages, changed, through the engine's reader: sealed again, or (SEAL 0) under the hash that they had.

   package_fuzz SEED COUNT EVERY SEAL FILE...  writes each package that was accepted, and of the others one in EVERY: size, answer, bytes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "package.h"

enum { FILES = 16, LARGEST = 1 << 16, HASH_SIZE = 32, FRONT = 200 };

typedef struct {
    unsigned char bytes[LARGEST];
    size_t size; /* without its hash */
} body;

static body corpus[FILES], changed;
static law_state state;
static uint64_t random_state;

static uint64_t draw(void)
{
    uint64_t z = random_state += 0x9e3779b97f4a7c15u; /* splitmix64 */

    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

static size_t below(size_t limit)
{
    return (size_t)(draw() % limit);
}

static void change(body *b)
{
    static const unsigned char bytes[] = {0, 1, 2, 0x20, 0x7f, 0x80, 0xc0, 0xff};
    static const double numbers[] = {0, -0.0, 1, -1, 1e-310, 1.7e308, NAN, INFINITY, -INFINITY, 1.0000001};
    const size_t reach = below(10) < 6 && b->size > FRONT ? FRONT : b->size, at = below(reach);
    const uint32_t word = (uint32_t)(below(3) ? below(70) : draw());
    size_t size;

    switch (below(8)) {
    case 0:
    case 1:
        b->bytes[at] ^= (unsigned char)(1u << below(8));
        break;
    case 2:
        b->bytes[at] = below(2) ? bytes[below(sizeof bytes)] : (unsigned char)draw();
        break;
    case 3:
        memcpy(b->bytes + 8 + 4 * below(12), &word, sizeof word);
        break;
    case 4:
    case 5:
        memcpy(b->bytes + (b->size > 16 ? below(b->size / 8 - 1) * 8 : 0), &numbers[below(sizeof numbers / sizeof *numbers)], sizeof(double));
        break;
    case 6:
        size = below(2) ? b->size - b->size % 8 : below(b->size);
        b->size = size > 16 && below(2) ? size - 8 * below(size / 8 - 1) : size;
        break;
    default:
        size = below(64);
        if (b->size + size <= LARGEST - HASH_SIZE) {
            memmove(b->bytes + at + size, b->bytes + at, b->size - at);
            b->size += size;
        }
        break;
    }
    if (b->size < 64)
        b->size = 64;
}

static enum answer read_it(const unsigned char *bytes, size_t size)
{
    unsigned char *own = malloc(size ? size : 1); /* as large as it is, so that the sanitizer sees its end */
    package p;
    enum answer found;

    if (!own)
        exit(3);
    memcpy(own, bytes, size);
    found = package_read(&p, own, size);
    if (found == DONE)
        found = package_replay(&p, &state);
    free(own);
    return found;
}

/* Its size with a hash, of ``whole`` unless it is sealed again; one in fifty is cut. */
static size_t end(body *b, const body *whole, int seal)
{
    if (seal)
        sha256(b->bytes, b->size, b->bytes + b->size);
    else
        memcpy(b->bytes + b->size, whole->bytes + whole->size, HASH_SIZE);
    return below(50) ? b->size + HASH_SIZE : below(b->size + HASH_SIZE);
}

static int same(const body *a, const body *b)
{
    return a->size == b->size && !memcmp(a->bytes, b->bytes, a->size);
}

static int load(body *b, const char *path)
{
    FILE *file = fopen(path, "rb");

    if (!file)
        return 0;
    b->size = fread(b->bytes, 1, sizeof b->bytes - HASH_SIZE, file);
    fclose(file);
    if (b->size < 64 + HASH_SIZE || read_it(b->bytes, b->size) == BAD_HASH)
        return 0;
    b->size -= HASH_SIZE;
    return 1;
}

int main(int count, char **words)
{
    const int files = count - 5;
    long k, cases, every, seal;

    if (files < 1 || files > FILES)
        return 2;
    random_state = (uint64_t)strtoul(words[1], NULL, 10);
    cases = strtol(words[2], NULL, 10);
    every = strtol(words[3], NULL, 10);
    seal = strtol(words[4], NULL, 10);
    for (k = 0; k < files; ++k)
        if (!load(&corpus[k], words[5 + k]))
            return 2;
    for (k = 0; k < cases; ++k) {
        const body *whole = &corpus[below((size_t)files)];
        uint32_t told[2];

        do {
            int changes = 1 + (int)below(3);

            changed.size = whole->size;
            memcpy(changed.bytes, whole->bytes, whole->size);
            while (changes--)
                change(&changed);
        } while (same(&changed, whole));
        told[0] = (uint32_t)end(&changed, whole, seal != 0);
        told[1] = (uint32_t)read_it(changed.bytes, told[0]);
        if (told[1] == DONE || k % every == 0) {
            fwrite(told, sizeof told, 1, stdout);
            fwrite(changed.bytes, 1, told[0], stdout);
        }
    }
    return 0;
}
