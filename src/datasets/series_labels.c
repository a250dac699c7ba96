/* Maps labels of any type to classes 0, 1, ... */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/lookup.h"
#include "datasets/series_files.h"

void lg_labels_destroy(lg_labels *labels) {
    LG_FREE_ALL(labels->context, labels->label, labels->value, labels->class_of, labels->sorted);
    lg_names_destroy(&labels->text);
    lg_names_destroy(&labels->of_class);
    *labels = (lg_labels){.context = labels->context};
}

/* ---- texts ---- */

typedef struct text_call {
    lg_h5 *h5;
    const char *name;
    lg_labels *labels;
} text_call;

static lg_status meet_text(void *user, uint64_t index, const char *text, lg_error *error) {
    const text_call *call = user;
    bool known;
    if (*text == '\0' || strlen(text) >= LG_SERIES_NAME)
        return lg_h5_fail(call->h5, error,
                          "/%s: the text at index (%llu) is empty or longer than %d bytes; rename it",
                          call->name, (unsigned long long)index, LG_SERIES_NAME - 1);
    const lg_status status = lg_names_meet(&call->labels->text, text, &call->labels->label[index], &known);
    if (status == LG_OUT_OF_MEMORY) return lg_h5_no_memory(call->h5, error);
    if (status == LG_OK) return LG_OK;
    return lg_h5_fail(call->h5, error, "/%s: more than %u different labels; merge some", call->name,
                      LG_SERIES_CLASSES);
}

static lg_status sort_texts(const lg_h5 *h5, lg_labels *labels, lg_error *error) {
    return lg_names_sort(&labels->text, labels->label, labels->count) == LG_OK ? LG_OK
                                                                               : lg_h5_no_memory(h5, error);
}

/* Finds the distinct numbers and sorts them. */
static lg_status name_values(lg_h5 *h5, lg_labels *labels, lg_error *error) {
    text_call call = {h5, "y", labels};
    labels->text.compare = lg_label_compare;
    for (size_t i = 0; i < labels->count; i++) {
        char text[LG_SERIES_NAME];
        (void)snprintf(text, sizeof text, "%" PRId64, labels->value[i]);
        LG_TRY(meet_text(&call, i, text, error));
    }
    return sort_texts(h5, labels, error);
}

/* Distinct number i. */
static int64_t value_at(const lg_labels *labels, uint32_t i) {
    return strtoll(labels->text.name[i], NULL, 10);
}

/* ---- numbers or texts ---- */

lg_status lg_labels_read(lg_h5 *h5, const char *name, size_t count, lg_labels *labels, lg_error *error) {
    lg_h5_about about;
    lg_h5_size windows = {count, "windows", "X"};
    const lg_h5_array list = {name, .dims = {&windows}};
    labels->text.context = labels->context;
    labels->of_class.context = labels->context;
    LG_TRY(lg_h5_fit(h5, &list, sizeof(int64_t), true, &about, error));
    labels->count = count;
    labels->label = lg_alloc(h5->context, count, sizeof *labels->label);
    if (labels->label == NULL) return lg_h5_no_memory(h5, error);
    if (about.kind == LG_H5_WORDS) {
        LG_TRY(lg_h5_each_text(h5, name, meet_text, &(text_call){h5, name, labels}, error));
        return sort_texts(h5, labels, error);
    }
    labels->value = lg_alloc(h5->context, count, sizeof *labels->value);
    return labels->value != NULL ? lg_h5_get_wholes(h5, name, &about, labels->value, error)
                                 : lg_h5_no_memory(h5, error);
}

/* ---- classes ---- */

static bool all_within(const lg_labels *labels, int64_t low, int64_t high) {
    return labels->value != NULL && value_at(labels, 0) >= low &&
           value_at(labels, labels->text.count - 1) <= high;
}

static int by_label(const void *a, const void *b) {
    return lg_label_compare(((const lg_lookup *)a)->name, ((const lg_lookup *)b)->name);
}

/* Sorts a list of labels for lookups. */
static void sort_list(lg_labels *labels, char (*list)[LG_SERIES_NAME], uint32_t count) {
    for (uint32_t c = 0; c < count; c++) labels->sorted[c] = (lg_lookup){list[c], c};
    qsort(labels->sorted, count, sizeof *labels->sorted, by_label);
}

static bool same_number(const char *a, const char *b) {
    return lg_is_decimal(a) && lg_is_decimal(b) && lg_decimal_compare(a, b) == 0;
}

/* Looks up a label: an equal text, or else an equal number ("1" equals "1.0"), which stands next to it. */
static bool find_in(const lg_lookup *sorted, size_t count, const char *text, uint32_t *out) {
    size_t low = 0, high = count;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (lg_label_compare(sorted[middle].name, text) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    const bool equal = low < count && strcmp(sorted[low].name, text) == 0;
    if (!equal && low > 0 && !(low < count && same_number(sorted[low].name, text))) low--;
    if (low == count || !(equal || same_number(sorted[low].name, text))) return false;
    *out = (uint32_t)sorted[low].at;
    return true;
}

/* Sets the class of each distinct label to its index in `list`. Returns false if a label is not in the list;
 * *missing is then the first such label. */
static bool find_labels(char (*list)[LG_SERIES_NAME], uint32_t count, lg_labels *labels, uint32_t *missing) {
    uint32_t i = 0;
    sort_list(labels, list, count);
    while (i < labels->text.count &&
           find_in(labels->sorted, count, labels->text.name[i], &labels->class_of[i]))
        i++;
    if (i < labels->text.count) *missing = i;
    return i == labels->text.count;
}

static bool any_number(char (*list)[LG_SERIES_NAME], uint32_t count) {
    for (uint32_t c = 0; list != NULL && c < count; c++)
        if (lg_is_decimal(list[c])) return true;
    return false;
}

void lg_names_show(char (*list)[LG_SERIES_NAME], uint32_t count, char *text, size_t size) {
    text[0] = '\0';
    for (uint32_t c = 0; c < count; c++) lg_append(text, size, "%s%s", c > 0 ? "|" : "", list[c]);
}

static lg_status unknown_label(const lg_h5 *h5, const char *label, char (*list)[LG_SERIES_NAME],
                               uint32_t count, char (*classes)[LG_SERIES_NAME], lg_error *error) {
    char have[128], named[128];
    lg_names_show(list, count, have, sizeof have);
    if (list == classes)
        return lg_h5_fail(h5, error, "/y: class '%s' is none of the classes %s", label, have);
    lg_names_show(classes, count, named, sizeof named);
    return lg_h5_fail(h5, error,
                      "/y: label '%s' is none of %s, the labels of the classes %s (attribute class_labels)",
                      label, have, named);
}

/* The label `low` becomes class 0, low + 1 becomes class 1, and so on, for `count` classes. */
static lg_status number_from(const lg_h5 *h5, int64_t low, uint32_t count, lg_labels *labels,
                             lg_error *error) {
    for (uint32_t i = 0; i < labels->text.count; i++)
        labels->class_of[i] = (uint32_t)(value_at(labels, i) - low);
    for (uint32_t c = 0; c < count; c++) {
        char text[LG_SERIES_NAME];
        (void)snprintf(text, sizeof text, "%" PRId64, low + c);
        if (lg_names_add(&labels->of_class, text) != LG_OK) return lg_h5_no_memory(h5, error);
    }
    return LG_OK;
}

static lg_status copy_list(const lg_h5 *h5, char (*list)[LG_SERIES_NAME], uint32_t count, lg_names *out,
                           lg_error *error) {
    lg_names_destroy(out);
    for (uint32_t c = 0; c < count; c++)
        if (lg_names_add(out, list[c]) != LG_OK) return lg_h5_no_memory(h5, error);
    return LG_OK;
}

/* Uses the attribute class_labels, if the file has it: the label of each class. */
static lg_status given_labels(lg_h5 *h5, lg_labels *labels, const lg_names *names, bool *given,
                              lg_error *error) {
    uint32_t missing = 0;
    LG_TRY(lg_names_get(h5, "class_labels", true, &labels->of_class, error));
    *given = labels->of_class.count > 0;
    if (!*given && lg_h5_has_attribute(h5, "", "class_labels"))
        return lg_h5_fail(h5, error, "class_labels: expected texts, such as '1|2|3'");
    if (!*given) return LG_OK;
    if (labels->of_class.count != names->count)
        return lg_h5_fail(h5, error, "class_labels: %u labels, but %u classes", labels->of_class.count,
                          names->count);
    return find_labels(labels->of_class.name, names->count, labels, &missing)
               ? LG_OK
               : unknown_label(h5, labels->text.name[missing], labels->of_class.name, names->count,
                               names->name, error);
}

/* If the file has the same classes as `like` in the same order, the labels of `like` apply. If the file's
 * labels are numbers that are not among numeric labels of `like`, this is an error. Texts that are not among
 * them may still be class names. */
static lg_status labels_like(lg_h5 *h5, const lg_series *like, lg_labels *labels, const lg_names *names,
                             bool *done, lg_error *error) {
    uint32_t missing = 0;
    if (like == NULL || like->class_label == NULL || names->count != like->classes) return LG_OK;
    for (uint32_t c = 0; c < names->count; c++)
        if (strcmp(names->name[c], like->class_name[c]) != 0) return LG_OK;
    *done = find_labels(like->class_label, like->classes, labels, &missing);
    if (*done || labels->value == NULL || !any_number(like->class_label, like->classes)) return LG_OK;
    return unknown_label(h5, labels->text.name[missing], like->class_label, like->classes, like->class_name,
                         error);
}

/* Maps labels to the file's class names when nothing else says how. */
static lg_status own_rule(const lg_h5 *h5, bool ours, lg_labels *labels, const lg_names *names,
                          lg_error *error) {
    const int64_t count = names->count;
    uint32_t missing = 0;
    if (all_within(labels, 1, count) && value_at(labels, labels->text.count - 1) == count && !ours)
        return number_from(h5, 1, names->count, labels, error);
    if (all_within(labels, 0, count - 1)) {
        labels->guessed = value_at(labels, 0) != 0 && !ours;
        return number_from(h5, 0, names->count, labels, error);
    }
    if (labels->value == NULL && find_labels(names->name, names->count, labels, &missing)) return LG_OK;
    for (uint32_t i = 0; i < labels->text.count; i++) labels->class_of[i] = i;
    if (labels->text.count == names->count)
        return copy_list(h5, labels->text.name, labels->text.count, &labels->of_class, error);
    return lg_h5_fail(h5, error,
                      "classes: %u names, but /y has %u different labels from '%s' to '%s', which are not "
                      "the numbers 0..%u or 1..%u: attribute class_labels can say which label is which class",
                      names->count, labels->text.count, labels->text.name[0],
                      labels->text.name[labels->text.count - 1], names->count - 1, names->count);
}

/* Maps labels of a file without class names to the classes of `like`: by the labels of `like`, or else by its
 * names. If the labels are numbers from 0 on and neither the labels nor the names of `like` are numbers, the
 * labels are taken as indices of the classes. */
static lg_status match_labels(const lg_h5 *h5, const lg_series *like, lg_labels *labels, lg_error *error) {
    const uint32_t count = like->classes;
    uint32_t missing = 0, unnamed = 0;
    if (like->class_label != NULL && find_labels(like->class_label, count, labels, &missing)) return LG_OK;
    if (find_labels(like->class_name, count, labels, &unnamed)) return LG_OK;
    labels->by_number = all_within(labels, 0, (int64_t)count - 1) && value_at(labels, 0) == 0 &&
                        !any_number(like->class_label, count) && !any_number(like->class_name, count);
    for (uint32_t i = 0; i < labels->text.count && labels->by_number; i++)
        labels->class_of[i] = (uint32_t)value_at(labels, i);
    if (labels->by_number) return LG_OK;
    const bool labelled =
        like->class_label != NULL && (labels->value != NULL) == any_number(like->class_label, count);
    return unknown_label(h5, labels->text.name[labelled ? missing : unnamed],
                         labelled ? like->class_label : like->class_name, count, like->class_name, error);
}

lg_status lg_labels_classes(lg_h5 *h5, bool ours, const lg_series *like, lg_labels *labels, lg_names *names,
                            lg_error *error) {
    bool done = false;
    if (labels->value != NULL) LG_TRY(name_values(h5, labels, error));
    labels->class_of = lg_alloc(h5->context, labels->text.count, sizeof *labels->class_of);
    LG_TRY(lg_names_get(h5, "classes", true, names, error));
    const uint32_t longest = like != NULL && like->classes > names->count ? like->classes : names->count;
    labels->sorted = lg_alloc(h5->context, longest, sizeof *labels->sorted);
    if (labels->class_of == NULL || labels->sorted == NULL) return lg_h5_no_memory(h5, error);
    if (names->count > 0) {
        LG_TRY(given_labels(h5, labels, names, &done, error));
        if (!done && !ours) LG_TRY(labels_like(h5, like, labels, names, &done, error));
        if (!done) LG_TRY(own_rule(h5, ours, labels, names, error));
        /* the classes of the file become the classes of `like` with the same names */
        if (like != NULL) sort_list(labels, like->class_name, like->classes);
        for (uint32_t i = 0; like != NULL && i < labels->text.count; i++) {
            const char *name = names->name[labels->class_of[i]];
            if (!find_in(labels->sorted, like->classes, name, &labels->class_of[i]))
                return unknown_label(h5, name, like->class_name, like->classes, like->class_name, error);
        }
    } else if (like != NULL) {
        LG_TRY(match_labels(h5, like, labels, error));
    } else {
        for (uint32_t i = 0; i < labels->text.count; i++) labels->class_of[i] = i;
        return copy_list(h5, labels->text.name, labels->text.count, names, error);
    }
    if (like == NULL) return LG_OK;
    LG_TRY(copy_list(h5, like->class_name, like->classes, names, error));
    if (like->class_label == NULL) {
        lg_names_destroy(&labels->of_class);
        return LG_OK;
    }
    return copy_list(h5, like->class_label, like->classes, &labels->of_class, error);
}
