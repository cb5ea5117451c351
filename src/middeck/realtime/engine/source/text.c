#include "package.h"

#include <stdint.h>
#include <string.h>

size_t text_length(const unsigned char *text)
{
    return (size_t)text[0] | (size_t)text[1] << 8;
}

int same_texts(const unsigned char *one, const unsigned char *other)
{
    return memcmp(one, other, 2) == 0 && memcmp(one + 2, other + 2, text_length(one)) == 0;
}

/* The character at ``bytes`` and its length; 0 where it is no whole one in its shortest form. */
static size_t decode(const unsigned char *bytes, size_t count, uint32_t *character)
{
    static const uint32_t least[5] = {0, 0, 0x80, 0x800, 0x10000};
    const unsigned char first = bytes[0];
    const size_t length = first < 0x80 ? 1 : first >> 5 == 6 ? 2 : first >> 4 == 14 ? 3 : first >> 3 == 30 ? 4 : 0;
    size_t i;

    if (length == 0 || length > count)
        return 0;
    *character = length == 1 ? first : first & (0x7fu >> length);
    for (i = 1; i < length; ++i) {
        if (bytes[i] >> 6 != 2)
            return 0;
        *character = *character << 6 | (bytes[i] & 0x3fu);
    }
    return *character >= least[length] && *character <= 0x10ffff && !(*character >= 0xd800 && *character < 0xe000) ? length : 0;
}

/* Blocks in which every place is a character that is shown, in all versions of Unicode since 5.0 (2006): Latin, the Greek and
   Cyrillic of units and names, Hangul and Chinese characters, superscripts, arrows and signs of mathematics. */
static int is_shown(uint32_t c)
{
    static const uint32_t blocks[][2] = {
        {0x20, 0x7e}, {0xa1, 0xac}, {0xae, 0x24f}, {0x250, 0x36f}, {0x391, 0x3a1}, {0x3a3, 0x3ce}, {0x400, 0x4ff}, {0x2010, 0x2027},
        {0x2030, 0x205e}, {0x2074, 0x208e}, {0x2190, 0x22ff}, {0x3041, 0x3096}, {0x30a0, 0x30ff}, {0x4e00, 0x9fbb}, {0xac00, 0xd7a3}
    };
    size_t i;

    for (i = 0; i < sizeof blocks / sizeof *blocks; ++i)
        if (c >= blocks[i][0] && c <= blocks[i][1])
            return 1;
    return c == 0x2070 || c == 0x2071 || c == 0x2126 || c == 0x212b || c == 0x2103;
}

int is_printable(const unsigned char *bytes, size_t count)
{
    size_t at = 0;

    while (at < count) {
        uint32_t character = 0;
        const size_t length = decode(bytes + at, count - at, &character);

        if (length == 0 || !is_shown(character))
            return 0;
        at += length;
    }
    return 1;
}

int is_blank(const unsigned char *bytes, size_t count)
{
    size_t i;

    for (i = 0; i < count; ++i)
        if (bytes[i] != ' ')
            return 0;
    return 1;
}

static int is_letter(unsigned char c)
{
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
}

int is_identifier(const unsigned char *bytes, size_t count)
{
    size_t i;

    if (count == 0 || !is_letter(bytes[0]))
        return 0;
    for (i = 1; i < count; ++i)
        if (!is_letter(bytes[i]) && !(bytes[i] >= '0' && bytes[i] <= '9') && bytes[i] != '_' && bytes[i] != '-')
            return 0;
    return 1;
}
