/* Texts of a package: 16 bits of length, then UTF-8. */
#ifndef MIDDECK_TEXT_H
#define MIDDECK_TEXT_H

#include <stddef.h>

size_t text_length(const unsigned char *text);
int same_texts(const unsigned char *one, const unsigned char *other);

/* Whole UTF-8 of characters that are shown: no control, no separator but the blank, nothing for private use. */
int is_printable(const unsigned char *bytes, size_t count);
int is_blank(const unsigned char *bytes, size_t count);

/* A letter, then letters, digits, _ and -. */
int is_identifier(const unsigned char *bytes, size_t count);

#endif
