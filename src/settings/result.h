/* An entry of what a training or a command finds out. apps/common/print.c makes JSON and text for people of
 * them. */
#ifndef LG_RESULT_H
#define LG_RESULT_H

#include "liegrad/settings.h"

/* A number, a text, or the beginning or end of a list or an object. */
typedef struct lg_result {
    const char *name;   /* key in JSON; NULL for a member of a list, and where a list or object ends */
    const char *label;  /* explanation for people; may be NULL */
    lg_field_type type; /* LG_FIELD_REAL, _U64, _FLAG, _STRING, _REALS, _WHOLES, or _NODE for a bracket */
    double real;
    int digits;     /* of `real`, for people; 0: 6 */
    uint64_t whole; /* also of a flag; of LG_FIELD_REALS, how many there are */
    const double *reals;
    /* LG_FIELD_WHOLES is a matrix of (whole, whole) counts, whose rows and columns are classes */
    const uint64_t *counts;
    const char
        *text; /* borrowed; NULL: unknown; of a matrix the names of the classes, of `size` bytes each */
    size_t size;
    char bracket; /* one of [ { ] }; 0: the entry is none */
    bool people;  /* a cell that only the table for people has */
    bool shown;   /* people see a line with the label, of a list of numbers too */
} lg_result;

/* Entries without a label. */
#define LG_AS_REAL(key, value) ((lg_result){.name = (key), .type = LG_FIELD_REAL, .real = (value)})
#define LG_AS_ROUNDED(key, value, count)                                                                     \
    ((lg_result){.name = (key), .type = LG_FIELD_REAL, .real = (value), .digits = (count)})
#define LG_AS_WHOLE(key, value) ((lg_result){.name = (key), .type = LG_FIELD_U64, .whole = (value)})
#define LG_AS_FLAG(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_FLAG, .whole = (value)})
#define LG_AS_TEXT(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_STRING, .text = (value)})
#define LG_AS_BRACKET(key, at)  ((lg_result){.name = (key), .type = LG_FIELD_NODE, .bracket = (at)})
#define LG_AS_REALS(key, values, count)                                                                      \
    ((lg_result){.name = (key), .type = LG_FIELD_REALS, .reals = (values), .whole = (count)})
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
