/* An entry of what a training or a command finds out. apps/common/print.c makes JSON and text for people of
 * them. */
#ifndef LG_RESULT_H
#define LG_RESULT_H

#include "liegrad/settings.h"

/* A number, a text, or the beginning or end of a list or an object. */
typedef struct lg_result {
    const char *name;   /* key in JSON; NULL for a member of a list, and where a list or object ends */
    const char *label;  /* explanation for people; may be NULL */
    lg_field_type type; /* LG_FIELD_REAL, _U64, _FLAG, _STRING, _REALS, or LG_FIELD_NODE for a bracket */
    double real;
    uint64_t whole; /* also of a flag; of LG_FIELD_REALS, how many there are */
    const double *reals;
    const char *text; /* borrowed; NULL: unknown */
    char bracket;     /* one of [ { ] }; 0: the entry is a number or a text */
} lg_result;

/* Entries without a label. */
#define LG_AS_REAL(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_REAL, .real = (value)})
#define LG_AS_WHOLE(key, value) ((lg_result){.name = (key), .type = LG_FIELD_U64, .whole = (value)})
#define LG_AS_FLAG(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_FLAG, .whole = (value)})
#define LG_AS_TEXT(key, value)  ((lg_result){.name = (key), .type = LG_FIELD_STRING, .text = (value)})
#define LG_AS_BRACKET(key, at)  ((lg_result){.name = (key), .type = LG_FIELD_NODE, .bracket = (at)})
#define LG_AS_REALS(key, values, count)                                                                      \
    ((lg_result){.name = (key), .type = LG_FIELD_REALS, .reals = (values), .whole = (count)})
/* A list of such entries, each with a name. */
#define LG_RESULTS(...) ((const lg_result[]){__VA_ARGS__, {.name = NULL}})

#endif
