/* Growing text, and numbers, strings and comments as C. */
#ifndef LG_TEXT_H
#define LG_TEXT_H

#include "core/core.h"

/* {.context = c} is the empty text. A failed allocation sticks: what is added later is lost. */
typedef struct lg_text {
    const lg_context *context;
    char *data; /* terminated, or NULL when nothing was added */
    size_t length, room;
    bool unfit;  /* a number was added that is not finite in its type */
    bool failed; /* out of memory */
    size_t lost; /* numbers that were added and are too small for single precision */
} lg_text;

void lg_text_add(lg_text *to, const char *format, ...) __attribute__((format(printf, 2, 3)));
void lg_text_append(lg_text *to, const char *data, size_t length);
/* All of another text, and what is wrong with it. */
void lg_text_join(lg_text *to, const lg_text *from);
/* As it is, with NAME_ at the beginning of a word replaced by the name and _. */
void lg_text_add_named(lg_text *to, const char *name, const char *code);
void lg_text_destroy(lg_text *to);
/* lg_in_word: c is a letter, a digit or _. lg_is_word: the text has at least one character, and all are of
 * this kind. */
bool lg_in_word(char c);
bool lg_is_word(const char *text);
/* Whether a number of double precision becomes 0 or loses digits in this type because it is too small. */
bool lg_is_lost(lg_dtype dtype, double value);
/* A number as C of this type: 17 or 9 digits, suffix f for float, always with a point or exponent. */
void lg_text_add_real(lg_text *to, lg_dtype dtype, double value);
/* Numbers separated by commas, four a line of `indent` blanks, no comma behind the last one. */
void lg_text_add_reals(lg_text *to, lg_dtype dtype, int indent, const double *values, size_t count);
/* Up to four numbers with commas, and in a comment below the same numbers in hexadecimal, exactly. */
void lg_text_add_hex_line(lg_text *to, lg_dtype dtype, const double *values, size_t count);
/* A word of a command line, in quotes where a shell needs them. */
void lg_text_add_word(lg_text *to, const char *word);
/* A string literal with its quotes, ASCII whatever the bytes, free of trigraphs. */
void lg_text_add_literal(lg_text *to, const char *value);
/* As it is, with everything taken out that could end a comment or warn in one. */
void lg_text_add_comment(lg_text *to, const char *value);

#endif
