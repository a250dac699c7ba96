/* An entry of what a training or a command finds out. apps/common/print.c makes JSON and text for people of
 * them. */
#ifndef LG_RESULT_H
#define LG_RESULT_H

#include "liegrad/settings.h"

/* A number, a text, or the beginning or end of a list or an object. */
typedef struct lg_result {
    const char *name;   /* key in JSON; NULL for a member of a list, and where a list or object ends */
    const char *label;  /* explanation for people; may be NULL */
    lg_field_type type; /* LG_FIELD_REAL, _U64, _FLAG, _STRING, _REALS, _TEXT, _WHOLES, _NODE: a bracket */
    double real;
    int digits;     /* of `real`, for people; 0: 6 */
    uint64_t whole; /* also of a flag; of LG_FIELD_REALS and LG_FIELD_TEXT, how many there are */
    const double *reals;
    /* LG_FIELD_WHOLES is a matrix of (whole, whole) counts, whose rows and columns are classes */
    const uint64_t *counts;
    const char *text; /* borrowed; NULL: unknown; of LG_FIELD_TEXT and matrices, texts of `size` bytes each */
    size_t size;
    char bracket; /* one of [ { ] }; 0: the entry is none */
    bool people;  /* a cell that only the table for people has */
    bool shown;   /* people see a line with the label, of a list of numbers too */
} lg_result;

/* Entries of which people see a line with the key, the value and `words` (NULL: no words). */
#define LG_SHOWN(key, type_, words, ...)                                                                     \
    ((lg_result){.name = (key), .type = LG_FIELD_##type_, .label = (words), .shown = true, __VA_ARGS__})
#define LG_REAL(key, value, words)          LG_SHOWN(key, REAL, words, .real = (value))
#define LG_WHOLE(key, value, words)         LG_SHOWN(key, U64, words, .whole = (value))
#define LG_TEXT(key, value, words)          LG_SHOWN(key, STRING, words, .text = (value))
#define LG_REALS(key, values, count, words) LG_SHOWN(key, REALS, words, .reals = (values), .whole = (count))

/* Entries without a label. */
#define LG_AS_REAL(key, value) ((lg_result){.name = (key), .type = LG_FIELD_REAL, .real = (value)})
#define LG_AS_ROUNDED(key, value, count)                                                                     \
    ((lg_result){.name = (key), .type = LG_FIELD_REAL, .real = (value), .digits = (count)})
#define LG_AS_WHOLE(key, value) ((lg_result){.name = (key), .type = LG_FIELD_U64, .whole = (value)})
#define LG_AS_FLAG(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_FLAG, .whole = (value)})
#define LG_AS_TEXT(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_STRING, .text = (value)})
#define LG_AS_REALS(key, values, count)                                                                      \
    ((lg_result){.name = (key), .type = LG_FIELD_REALS, .reals = (values), .whole = (count)})
#define LG_AS_TEXTS(key, texts, count)                                                                       \
    ((lg_result){.name = (key),                                                                              \
                 .type = LG_FIELD_TEXT,                                                                      \
                 .text = (texts)[0],                                                                         \
                 .size = sizeof(texts)[0],                                                                   \
                 .whole = (count)})
#define LG_AS_CONFUSION(key, matrix, classes, names)                                                         \
    ((lg_result){.name = (key),                                                                              \
                 .type = LG_FIELD_WHOLES,                                                                    \
                 .counts = (matrix),                                                                         \
                 .whole = (classes),                                                                         \
                 .text = (names)[0],                                                                         \
                 .size = sizeof(names)[0]})
#define LG_FOR_PEOPLE(key, value)                                                                            \
    ((lg_result){.name = (key), .type = LG_FIELD_STRING, .text = (value), .people = true})
/* A list of such entries, each with a name. */
#define LG_RESULTS(...) ((const lg_result[]){__VA_ARGS__, {.name = NULL}})

#endif
