/* For files of series and of their models: names of classes and channels, labels of any type. */
#ifndef LG_SERIES_FILES_H
#define LG_SERIES_FILES_H

#include "files/h5.h"
#include "liegrad/series.h"

#define LG_SERIES_CLASSES 65536u /* most that are read */

/* ---- names (series_names.c) ---- */

/* A list of names that grows. */
typedef struct lg_names {
    const lg_context *context;
    uint32_t count, room;
    char (*name)[LG_SERIES_NAME];
    uint32_t *order; /* (count) of those added by lg_names_meet, by rising name, bytewise */
} lg_names;

void lg_names_destroy(lg_names *names);
/* LG_OUT_OF_MEMORY; LG_FORMAT: longer than LG_SERIES_NAME - 1 bytes, more than LG_SERIES_CLASSES. */
lg_status lg_names_add(lg_names *names, const char *text);
/* Index of the name, which is added when it is new; *known says whether it was there. Not to be mixed with
 * lg_names_add. */
lg_status lg_names_meet(lg_names *names, const char *text, uint32_t *index, bool *known);

bool lg_names_find(const lg_names *names, const char *text, uint32_t *index); /* by `order` */

/* Names in a file: attribute `key` of the root, joined by | or a list of texts; else data set /key (count) of
 * texts; else count 0. Attributes and data sets of numbers are ignored. `unique`: no name is empty or occurs
 * twice, and `order` is set. The caller sets names->context and frees the names, after a failure too. */
lg_status lg_names_get(lg_h5 *h5, const char *key, bool unique, lg_names *names, lg_error *error);
/* The same as an array that a struct owns; without names *out is unchanged. *count 0 becomes the number of
 * names; otherwise another number is LG_FORMAT. */
lg_status lg_names_list(lg_h5 *h5, const char *key, bool unique, uint32_t *count,
                        char (**out)[LG_SERIES_NAME], lg_error *error);
/* Writes joined names if they are short and can be split again, else a data set. */
lg_status lg_names_put(lg_h5 *h5, const char *key, const char (*name)[LG_SERIES_NAME], uint32_t count,
                       lg_error *error);
/* LG_INVALID_ARGUMENT: not terminated; with `unique`, one empty or two equal. */
lg_status lg_names_check(const lg_context *context, const char *path, const char *what,
                         const char (*name)[LG_SERIES_NAME], uint32_t count, bool unique, lg_error *error);
/* Moves the list out of `names`, which is empty then; NULL when there are none. */
char (*lg_names_take(lg_names *names))[LG_SERIES_NAME];

/* Attribute `rate` of the root, Hz; 0 when it is missing. */
lg_status lg_rate_get(lg_h5 *h5, double *rate, lg_error *error);

/* The classes and channels of a model or data set, and its rate: attributes `classes`, `class_labels`,
 * `channels`, `rate` of the root. Reading: classes NULL and channels NULL where the file does not say; a
 * count other than the one given is LG_FORMAT (0: any). */
typedef struct lg_sensing {
    uint32_t classes, channels;
    char (*class_name)[LG_SERIES_NAME];
    char (*class_label)[LG_SERIES_NAME]; /* or NULL; as in lg_series */
    char (*channel_name)[LG_SERIES_NAME];
    double rate; /* Hz; 0 unknown */
} lg_sensing;
lg_status lg_sensing_check(const lg_context *context, const char *path, const lg_sensing *sensing,
                           lg_error *error);
lg_status lg_sensing_put(lg_h5 *h5, const lg_sensing *sensing, lg_error *error);
/* On failure nothing is kept. */
lg_status lg_sensing_get(lg_h5 *h5, lg_sensing *sensing, lg_error *error);
void lg_sensing_destroy(const lg_context *context, lg_sensing *sensing);

/* ---- single precision (series_precision.c) ---- */

/* Channels that lose more than 1 % of their standard deviation in single precision. */
typedef struct lg_precision {
    uint32_t channels;              /* how many */
    double part;                    /* of the standard deviation, where it is largest */
    char name[LG_SERIES_NAME + 16]; /* of that channel, with its number from 1 on */
} lg_precision;
/* /X of any type, as floats into series->x. Read once. */
lg_status lg_series_convert(lg_h5 *h5, lg_series *series, lg_precision *out, lg_error *error);
/* LG_FORMAT when a channel loses more than half. */
lg_status lg_precision_check(const char *path, const lg_precision *precision, lg_error *error);
void lg_precision_warn(const lg_context *context, const char *path, const lg_precision *precision);

/* ---- labels (series_labels.c) ---- */

/* /y as in the file: the distinct values in rising order, and for each window the index of its value. */
typedef struct lg_labels {
    const lg_context *context;
    size_t count;
    uint32_t *label;    /* (count) index of the distinct value */
    uint32_t distinct;  /* values */
    bool whole;         /* they are numbers, not texts */
    int64_t *value;     /* (distinct) rising; of numbers */
    lg_names text;      /* (distinct) rising; of numbers set by lg_labels_classes */
    uint32_t *class_of; /* (distinct); set by lg_labels_classes */
    lg_names of_class;  /* the label of each class in /y; none: the names. Set by lg_labels_classes */
    bool guessed;       /* nothing says whether numbers count from 0 or 1; 0 is taken, with a warning */
    bool by_number;     /* taken as class numbers of `like`: nothing else fits; with a warning */
} lg_labels;

void lg_labels_destroy(lg_labels *labels);
/* The caller sets labels->context and frees the labels, after a failure too. At most LG_SERIES_CLASSES
 * different texts. A missing data set is LG_FORMAT. */
lg_status lg_labels_read(lg_h5 *h5, const char *name, size_t count, lg_labels *labels, lg_error *error);
/* The names of the classes, from the attribute `classes`, the values themselves or `like` (may be NULL), and
 * the class of each value; at most LG_SERIES_CLASSES. `names`, whose context the caller sets, receives the
 * names. `ours`: numbers with names count from 0. */
lg_status lg_labels_classes(lg_h5 *h5, bool ours, const lg_series *like, lg_labels *labels, lg_names *names,
                            lg_error *error);

#endif
