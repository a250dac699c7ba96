/* Shared by the readers and writers of series and of their models: names of classes and channels, labels of
 * any type. */
#ifndef LG_SERIES_FILES_H
#define LG_SERIES_FILES_H

#include "files/h5.h"
#include "liegrad/series.h"

#define LG_SERIES_CLASSES 65536u /* largest number of classes that is read */

/* ---- names (series_names.c) ---- */

/* A growing list of names. */
typedef struct lg_names {
    const lg_context *context;
    uint32_t count, room;
    char (*name)[LG_SERIES_NAME];
    /* (count) Indices of the names in ascending order. Only lg_names_meet maintains it. */
    uint32_t *order;
    int (*compare)(const char *a, const char *b); /* NULL: bytewise */
} lg_names;

void lg_names_destroy(lg_names *names);
/* Fails with LG_OUT_OF_MEMORY, or with LG_FORMAT if the name is longer than LG_SERIES_NAME - 1 bytes or there
 * are LG_SERIES_CLASSES names already. */
lg_status lg_names_add(lg_names *names, const char *text);
/* Gets the index of a name and adds the name if it is new. *known says whether it was in the list before. Do
 * not use it on a list that was filled by lg_names_add. */
lg_status lg_names_meet(lg_names *names, const char *text, uint32_t *index, bool *known);
/* Puts names that were met into ascending order, and changes their indices in label (count) accordingly.
 * Numbers that are no index stay as they are. Fails with LG_OUT_OF_MEMORY. */
lg_status lg_names_sort(lg_names *names, uint32_t *label, size_t count);

/* Reads names from a file. They are in the attribute `key` of the root (one text with the names joined by |,
 * or a list of texts), else in the data set /key (count) of texts; else count becomes 0. Attributes and data
 * sets of numbers are ignored. With `unique`, no name may be empty or occur twice, and `order` is set. The
 * caller sets names->context and destroys the names, also after a failure. */
lg_status lg_names_get(lg_h5 *h5, const char *key, bool unique, lg_names *names, lg_error *error);
/* Reads names as lg_names_get does, into an array that the caller owns. If there are no names, *out is
 * unchanged. If *count is 0 it becomes the number of names; otherwise another number of names is
 * LG_FORMAT. */
lg_status lg_names_list(lg_h5 *h5, const char *key, bool unique, uint32_t *count,
                        char (**out)[LG_SERIES_NAME], lg_error *error);
/* Writes names as "intact|broken", cut to `size` bytes. */
void lg_names_show(char (*list)[LG_SERIES_NAME], uint32_t count, char *text, size_t size);
/* Returns the array of names and empties `names`. The caller owns the array. NULL if there are no names. */
char (*lg_names_take(lg_names *names))[LG_SERIES_NAME];

/* Reads the attribute `rate` of the root, in Hz; 0 if it is missing. */
lg_status lg_rate_get(lg_h5 *h5, lg_series *out, lg_error *error);

/* Classes, channels and rate of a model or data set, in the attributes `classes`, `class_labels`, `channels`
 * and `rate` of the root; these members of the series are checked, written and read. When reading, class_name
 * and channel_name are NULL if the file does not have them. If `classes` or `channels` is not 0 before
 * reading, the file must have that many names, else LG_FORMAT. On failure *names is unchanged. */
lg_status lg_sensing_check(const lg_context *context, const char *path, const lg_series *names,
                           lg_error *error);
lg_status lg_sensing_put(lg_h5 *h5, const lg_series *names, lg_error *error);
lg_status lg_sensing_get(lg_h5 *h5, lg_series *names, lg_error *error);

/* ---- single precision (series_precision.c) ---- */

/* The channels that lose more than 1 % of their standard deviation in single precision. */
typedef struct lg_precision {
    uint32_t channels;              /* number of these channels */
    double part;                    /* largest loss, relative to the channel's standard deviation */
    char name[LG_SERIES_NAME + 16]; /* number (from 1) and name of the channel with the largest loss */
} lg_precision;
/* Reads /X of any numeric type into series->x as floats, and measures the rounding. Reads the data only
 * once. */
lg_status lg_series_convert(lg_h5 *h5, lg_series *series, lg_precision *out, lg_error *error);
/* Fails with LG_FORMAT if a channel loses more than half of its standard deviation. */
lg_status lg_precision_check(const char *path, const lg_precision *precision, lg_error *error);
void lg_precision_warn(const lg_context *context, const char *path, const lg_precision *precision);

/* ---- labels (series_labels.c) ---- */

/* /y of a file: its distinct values in ascending order and, for each window, the index of the window's
 * value. */
typedef struct lg_labels {
    const lg_context *context;
    size_t count;
    uint32_t *label;    /* (count) index into the distinct values; of numbers, set by lg_labels_classes */
    int64_t *value;     /* (count) the labels if they are numbers; NULL: they are texts */
    lg_names text;      /* the distinct values as texts, in ascending order */
    uint32_t *class_of; /* (text.count) class of each value; set by lg_labels_classes */
    /* The label that each class has in /y; empty if the labels are the class names. Set by
     * lg_labels_classes. */
    lg_names of_class;
    /* Nothing in the file says whether the numbers count from 0 or from 1. 0 is assumed, with a warning. */
    bool guessed;
    /* The labels are taken as class numbers of `like`, because nothing else fits. Gives a warning. */
    bool by_number;
    struct lg_lookup *sorted; /* scratch of lg_labels_classes: a list of labels, sorted for lookups */
} lg_labels;

void lg_labels_destroy(lg_labels *labels);
/* Reads labels. The caller sets labels->context and destroys the labels, also after a failure. There may be
 * at most LG_SERIES_CLASSES different texts. A missing data set is LG_FORMAT. */
lg_status lg_labels_read(lg_h5 *h5, const char *name, size_t count, lg_labels *labels, lg_error *error);
/* Finds the names of the classes and the class of each value. The names come from the attribute `classes`,
 * from the values themselves, or from `like` (may be NULL); at most LG_SERIES_CLASSES. `names`, whose context
 * the caller sets, receives them. `ours` means that this library wrote the file: numbers then count from
 * 0. */
lg_status lg_labels_classes(lg_h5 *h5, bool ours, const lg_series *like, lg_labels *labels, lg_names *names,
                            lg_error *error);

#endif
