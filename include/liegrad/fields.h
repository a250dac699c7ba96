/* Fields: what a user can set, as rows of tables. A row says where a value lies in a structure, its type,
 * range, default and meaning. Command lines, ranges of searches, grids of studies, attributes of files, the
 * comparison of a resumed run with the stored one, JSON and docs/hyperparameters.md all read the same rows.
 *
 *   lg_surrogate_run run;
 *   lg_fields_default(lg_surrogate_fields, &run);
 *   const lg_field *lr = lg_field_find(lg_surrogate_fields, "lr");
 *   lg_status status = lg_field_set(lr, "1e-3", &run, &error);
 */
#ifndef LIEGRAD_FIELDS_H
#define LIEGRAD_FIELDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

/* What the member is, and how its value is written. */
typedef enum lg_field_type {
    LG_FIELD_REAL,   /* double */
    LG_FIELD_U64,    /* uint64_t */
    LG_FIELD_U32,    /* uint32_t */
    LG_FIELD_FLAG,   /* bool; 0 or 1 in files, one of two names elsewhere */
    LG_FIELD_NAME,   /* an enumeration, or a bool with two names; a name everywhere */
    LG_FIELD_WHOLES, /* a list of whole numbers; commas separate them in a text */
    LG_FIELD_REALS,  /* a list of numbers, likewise */
    LG_FIELD_PHRASE, /* a value that `parse` reads from a text and `phrase` writes */
    LG_FIELD_SWITCH, /* bool; an option without a value: true when it is given */
    LG_FIELD_STRING, /* const char *, borrowed; an empty text is refused */
    LG_FIELD_TEXT,   /* char array; a fact about the data, which cannot be set */
    LG_FIELD_SHOWN,  /* a text that `show` makes from several members; also a fact */
    /* In files of keys alone: */
    LG_FIELD_NAMES, /* a list of names */
    LG_FIELD_NODE,  /* whatever stands there; its reader looks at it */
    LG_FIELD_MAP    /* a mapping, whose keys have rows of their own: "inputs", "inputs.hold" */
} lg_field_type;

/* What a command does with the file that a STRING names. */
typedef enum lg_file_use {
    LG_FILE_NOT,      /* the text names no file, or the command looks after it alone */
    LG_FILE_READ,     /* an input */
    LG_FILE_WRITTEN,  /* the file is replaced */
    LG_FILE_STREAMED, /* the file is replaced; a pipe or a device is written to */
    LG_FILE_DRAWN     /* a picture, .svg or .png: its data and script, next to it, are replaced too */
} lg_file_use;

/* The most numbers in a list, and room for any value as text. */
#define LG_FIELD_LIST_MAX  256
#define LG_FIELD_TEXT_SIZE 4096

/* Members for lists, which need neither `get` nor `put`. */
typedef struct lg_wholes {
    size_t count;
    uint32_t values[LG_FIELD_LIST_MAX];
} lg_wholes;
typedef struct lg_reals {
    size_t count;
    double values[LG_FIELD_LIST_MAX];
} lg_reals;

/* A table ends with a row whose name is NULL. */
typedef struct lg_field {
    const char *name; /* in files and grids, such as lr_step */
    /* On command lines, and with _ for - in JSON; NULL: the name with - for _; "": none. */
    const char *option;
    /* Of a hyperparameter: the HDF5 group that stores it, "model" or "run" (a resumed run must have the same
     * value), or "" when no file stores it. NULL: the row is no hyperparameter (a path, a picture, a key of a
     * scene); a search cannot draw it. */
    const char *group;
    lg_field_type type;
    size_t offset, size; /* of the member in the structure */
    double low, high;    /* of each number */
    bool above;          /* low itself is refused */
    bool required;       /* the option must be given; a file that has the mapping must have the key */
    lg_file_use file;    /* STRING */
    bool adam;           /* it applies only where Adam takes part in the training */
    bool optional;       /* files of earlier versions lack it; the run then has the default for files */
    uint32_t methods;    /* bit v: it applies when the run's method is number v; 0: always */
    /* FLAG, NAME: the names by value, from a function that returns NULL beyond the last, or as a list that
     * ends with NULL. PHRASE: value_name gives the single words. */
    const char *(*value_name)(uint32_t value);
    const char *const *names;
    const void *(*value_at)(uint32_t value); /* NAME, and the member is a pointer into a table: the entry */
    /* Lists in other members than lg_wholes and lg_reals: `get` copies the numbers out and returns how many,
     * `put` stores them. */
    uint32_t (*get)(const void *member, double *values);
    void (*put)(void *member, const double *values, uint32_t count);
    uint32_t most;      /* numbers of a list, at most LG_FIELD_LIST_MAX; 0: so many */
    const char *longer; /* what to do with more; may be NULL */
    void (*show)(const void *run, char *text, size_t size); /* SHOWN */
    /* PHRASE: `parse` reads a text into the member, which a failure leaves as it was; `phrase` writes the
     * text back. `form` says which texts there are besides the single words. */
    lg_status (*parse)(const char *text, void *member, lg_error *error);
    void (*phrase)(const void *member, char *text, size_t size);
    const char *form;
    const char *value;     /* the default as text; NULL: `otherwise` says where the default comes from */
    const char *otherwise; /* "the preset's" */
    const char *unit;      /* what --help calls a value; NULL: NAME */
    const char *meaning;   /* one sentence without its full stop */
} lg_field;

/* A row for `member` of `struct_`; the last arguments are designated initialisers. */
#define LG_FIELD(struct_, group_, name_, type_, member, ...)                                                 \
    {                                                                                                        \
        .group = group_, .name = name_, .type = LG_FIELD_##type_, .offset = offsetof(struct_, member),       \
        .size = sizeof(((struct_ *)0)->member), __VA_ARGS__                                                  \
    }
/* A row for an option that is no hyperparameter, called like its member; designated initialisers may follow
 * the meaning. */
#define LG_OPTION(struct_, member, type_, unit_, ...)                                                        \
    LG_FIELD(struct_, NULL, #member, type_, member, .unit = unit_, .meaning = __VA_ARGS__)
#define LG_ANY_REAL .low = -1e300, .high = 1e300
#define LG_POSITIVE .high = 1e300, .above = true
/* The function that gives a row's names: value 0 has the first name. */
#define LG_NAMES(...)                                                                                        \
    .names = (const char *const[]) {                                                                         \
        __VA_ARGS__, NULL                                                                                    \
    }
#define LG_FIELD_END                                                                                         \
    { .name = NULL }

/* Finds the row with this name, in files or on command lines. NULL: the table has no such row. */
LG_API const lg_field *lg_field_find(const lg_field *table, const char *name);
/* Its name on command lines, cut to `size` bytes; "" for one that has none. */
LG_API void lg_field_option(const lg_field *entry, char *text, size_t size);
/* "Width of the hidden layers (1 to 1048576; default the preset's)"; only hyperparameters tell the range.
 * Returns the length as snprintf does. */
LG_API int lg_field_describe(const lg_field *entry, char *text, size_t size);

/* Sets the run's value from text. LG_INVALID_ARGUMENT with a sentence that says which values are possible;
 * the run is untouched then. A SWITCH becomes true, whatever the text. */
LG_API lg_status lg_field_set(const lg_field *entry, const char *text, void *run, lg_error *error);
/* Sets a number, or a list of one number, to these bits; otherwise as lg_field_set with the number's text. */
LG_API lg_status lg_field_store(const lg_field *entry, double value, void *run, lg_error *error);
/* The run's value as lg_field_set takes it, cut to `size` bytes; "?" for an unknown name. */
LG_API void lg_field_show(const lg_field *entry, const void *run, char *text, size_t size);
/* The name of a value; NULL beyond the last, and for a row without names. */
LG_API const char *lg_field_name(const lg_field *entry, uint32_t value);
/* The value of a number, or the position of a name; NaN for other types. */
LG_API double lg_field_number(const lg_field *entry, const void *run);
/* The exact value of whole numbers, flags and names; 0 for other types. */
LG_API uint64_t lg_field_whole(const lg_field *entry, const void *run);
/* Copies the numbers of a list, at most LG_FIELD_LIST_MAX, and returns how many; 0 for other types. */
LG_API uint32_t lg_field_list(const lg_field *entry, const void *run, double *values);
/* Whether the number or name is within its range; true for other types. */
LG_API bool lg_field_fits(const lg_field *entry, const void *run);
/* Copies the value from one run to another. */
LG_API void lg_field_copy(const lg_field *entry, const void *from, void *to);
/* Sets every hyperparameter that has a default; the others are unchanged. */
LG_API void lg_fields_default(const lg_field *table, void *run);

/* A decimal number, consumed whole, whatever the locale: [+-] digits with optional point and exponent.
 * LG_FORMAT for anything else (empty, "9,81", "9.81m", "0x1p3", "nan"), LG_NOT_FINITE when it overflows. */
LG_API lg_status lg_number_parse(const char *text, double *out);
/* The same for a whole number 0..UINT64_MAX, digits only. */
LG_API lg_status lg_integer_parse(const char *text, uint64_t *out);

LG_END_DECLS

#endif
