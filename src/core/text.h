/* A growing text, and numbers, strings and comments formatted as C. */
#ifndef LG_TEXT_H
#define LG_TEXT_H

#include "core/core.h"

/* Initialise with {.context = c}. If an allocation fails, the text so far stays, and everything that is added
 * later is discarded. */
typedef struct lg_text {
    const lg_context *context;
    char *data; /* terminated, or NULL if nothing was added */
    size_t length, room;
    bool unfit;  /* a number was added that is not finite in its type (dtype) */
    bool failed; /* an allocation failed */
    size_t lost; /* number of added values that are too small for single precision */
} lg_text;

void lg_text_add(lg_text *to, const char *format, ...) __attribute__((format(printf, 2, 3)));
void lg_text_append(lg_text *to, const char *data, size_t length);
/* Adds the `count` lowest bytes of a number, the lowest first. */
void lg_text_add_bytes(lg_text *to, size_t count, uint64_t bits);
/* Adds all of another text, and takes over its flags and counts. */
void lg_text_join(lg_text *to, const lg_text *from);
/* Adds `code`, with NAME_ at the beginning of a word replaced by `name` and _. */
void lg_text_add_named(lg_text *to, const char *name, const char *code);
void lg_text_destroy(lg_text *to);
/* Reads a number that lg_is_decimal accepts, at the beginning of a text that may go on. Returns its end, or
 * NULL if no number is there. */
const char *lg_decimal(const char *text, double *out);
/* Decodes the UTF-8 character at `text`, of which `left` bytes may be read. Returns its number of bytes;
 * *code becomes its number, or LG_NO_CHARACTER for one byte that begins no character (overlong forms and
 * surrogates are none). Returns 0 if the `left` bytes begin a character whose end is missing. */
#define LG_NO_CHARACTER UINT32_MAX
size_t lg_utf8(const char *text, size_t left, uint32_t *code);
/* A file that is built into a library or program as text. A row of NULL ends a list of texts.
 * lg_named_text_of returns NULL if the list has no text of this name. */
typedef struct lg_named_text {
    const char *name, *text;
} lg_named_text;
const char *lg_named_text_of(const lg_named_text *texts, const char *name);
/* lg_in_word: true if c is a letter, a digit or _. lg_is_word: true if the text has at least one character
 * and all its characters are such. */
bool lg_in_word(char c);
bool lg_is_word(const char *text);
/* True if a double is so small that it becomes 0 or loses digits in this type. */
bool lg_is_lost(lg_dtype dtype, double value);
/* Names joined to the list "a, b, ...", for messages. Where there is no more room, it ends with "...". */
typedef struct lg_name_list {
    char text[240];
    size_t used;
} lg_name_list;
void lg_name_list_add(lg_name_list *names, const char *name);
/* Adds a number as a C literal of this type: 17 digits for double, or 9 digits and the suffix f for float,
 * always with a point or an exponent. */
void lg_text_add_real(lg_text *to, lg_dtype dtype, double value);
/* Adds numbers separated by commas, four per line, each line indented by `indent` blanks. No comma follows
 * the last number. */
void lg_text_add_reals(lg_text *to, lg_dtype dtype, int indent, const double *values, size_t count);
/* Adds up to four numbers with commas, and on the next line a comment with their exact values in
 * hexadecimal. */
void lg_text_add_hex_line(lg_text *to, lg_dtype dtype, const double *values, size_t count);
/* Adds an argument of a command line, quoted if a shell needs it. */
void lg_text_add_word(lg_text *to, const char *word);
/* Adds a C string literal with its quotes. Any bytes are allowed; the literal is ASCII and has no
 * trigraphs. */
void lg_text_add_literal(lg_text *to, const char *value);
/* Adds text for the inside of a C comment, with everything changed that could end the comment or cause a
 * warning. */
void lg_text_add_comment(lg_text *to, const char *value);
/* Replaces, in place, bytes that are not UTF-8 and all bytes of control characters (also those of U+0080 to
 * U+009F) by '?'. Returns whether it replaced a byte. */
bool lg_tame(char *text);

#endif
