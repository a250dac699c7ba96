/* YAML and JSON files through tables of keys. A table is flat: "initial.q" is key q of the mapping `initial`.
 * Each value keeps its line. Adding a key or a system is adding rows. */
#ifndef LG_YAML_H
#define LG_YAML_H

#include "core/core.h"
#include "liegrad/io.h"

typedef enum lg_key_type {
    LG_KEY_REAL,   /* one number */
    LG_KEY_COUNT,  /* one whole number below 2^53 */
    LG_KEY_WHOLE,  /* one whole number up to 2^64 - 1 */
    LG_KEY_NAME,   /* one of `names` */
    LG_KEY_TEXT,   /* a text */
    LG_KEY_REALS,  /* a list of numbers; a single one may stand for itself */
    LG_KEY_COUNTS, /* a list of whole numbers; likewise */
    LG_KEY_NAMES,  /* a list of names; likewise */
    LG_KEY_ROWS,   /* a list of lists of three numbers; one of them may stand for itself */
    LG_KEY_MAP     /* a mapping, whose keys have rows of their own */
} lg_key_type;

typedef struct lg_key {
    const char *name;
    lg_key_type type;
    uint32_t systems;  /* bit mask of the systems that have it */
    bool required;     /* when its mapping is there */
    bool open;         /* low < value rather than low <= value */
    double low, high;  /* of every number */
    uint32_t capacity; /* most values of a list, most rows of ROWS */
    /* Names of an enumeration by value; NULL beyond the last. */
    const char *(*name_of)(uint32_t value);
} lg_key;

#define LG_VALUES 96 /* 3 * LG_HAMILTONIAN_MAX_LINKS */
typedef struct lg_key_value {
    uint32_t line;  /* of the value, from 1; 0: absent */
    uint32_t count; /* numbers or names read; 3 * rows for ROWS */
    double real[LG_VALUES];
    uint32_t lines[LG_VALUES]; /* of each number */
    uint64_t whole;            /* WHOLE */
    char text[256];            /* TEXT */
} lg_key_value;

_Static_assert(LG_VALUES >= 3 * LG_HAMILTONIAN_MAX_LINKS, "a row of three numbers a link");

/* A table and where its values go, one for each row. */
typedef struct lg_key_set {
    const lg_key *keys;
    size_t count;
    lg_key_value *values;
} lg_key_set;

typedef struct lg_yaml lg_yaml;

lg_status lg_yaml_open(const lg_context *context, const char *path, lg_yaml **out, lg_error *error);
void lg_yaml_close(lg_yaml *yaml); /* NULL is fine */
const char *lg_yaml_path(const lg_yaml *yaml);

/* True when the top mapping has the key. */
bool lg_yaml_has(const lg_yaml *yaml, const char *key);
/* The value of a NAME key of the top mapping, before the rest can be read: required. */
lg_status lg_yaml_name(lg_yaml *yaml, const lg_key *key, lg_key_value *value, lg_error *error);
/* Reads the top mapping. Refused, each with its line: keys in no table, duplicate keys, keys of other
 * systems, missing keys, wrong shapes, numbers that are none or out of range. `system` is the bit of the
 * system at hand, `system_name` for sentences. */
lg_status lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count, uint32_t system,
                       const char *system_name, lg_error *error);
/* "FILE: line 7: ..." */
lg_status lg_yaml_fail(const lg_yaml *yaml, uint32_t line, lg_status status, lg_error *error,
                       const char *format, ...) __attribute__((format(printf, 5, 6)));

#endif
