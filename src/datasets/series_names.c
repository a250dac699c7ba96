/* Lists of names, and the names of classes and channels in files. */
#include <stdio.h>
#include <string.h>

#include "datasets/series_files.h"
#include "files/frame.h"
#include "settings/files/attributes.h"

enum { FIRST_ROOM = 16 };

/* ---- lists ---- */

void lg_names_destroy(lg_names *names) {
    LG_FREE_ALL(names->context, names->name, names->order);
    *names = (lg_names){.context = names->context, .compare = names->compare};
}

char (*lg_names_take(lg_names *names))[LG_SERIES_NAME] {
    char(*name)[LG_SERIES_NAME] = names->name;
    names->name = NULL;
    lg_names_destroy(names);
    return name;
}

static lg_status grow(lg_names *names) {
    const uint32_t room = names->room == 0 ? FIRST_ROOM : 2 * names->room;
    char(*name)[LG_SERIES_NAME] = lg_widen(names->context, names->name, names->count, room, sizeof *name);
    if (name == NULL) return LG_OUT_OF_MEMORY;
    names->name = name;
    uint32_t *order = lg_widen(names->context, names->order, names->count, room, sizeof *order);
    if (order == NULL) return LG_OUT_OF_MEMORY;
    names->order = order;
    names->room = room;
    return LG_OK;
}

lg_status lg_names_add(lg_names *names, const char *text) {
    const size_t length = strlen(text);
    if (length >= LG_SERIES_NAME || names->count >= LG_SERIES_CLASSES) return LG_FORMAT;
    if (names->count == names->room) LG_TRY(grow(names));
    memcpy(names->name[names->count++], text, length + 1);
    return LG_OK;
}

lg_status lg_names_meet(lg_names *names, const char *text, uint32_t *index, bool *known) {
    int (*const compare)(const char *, const char *) = names->compare != NULL ? names->compare : strcmp;
    uint32_t place = 0, high = names->count;
    while (place < high) {
        const uint32_t middle = place + (high - place) / 2;
        if (compare(names->name[names->order[middle]], text) < 0)
            place = middle + 1;
        else
            high = middle;
    }
    *known = place < names->count && strcmp(names->name[names->order[place]], text) == 0;
    if (*known) *index = names->order[place];
    if (*known) return LG_OK;
    LG_TRY(lg_names_add(names, text));
    *index = names->count - 1;
    memmove(names->order + place + 1, names->order + place, (*index - place) * sizeof *names->order);
    names->order[place] = *index;
    return LG_OK;
}

lg_status lg_names_sort(lg_names *names, uint32_t *label, size_t count) {
    LG_CLEAN(lg_names_destroy) lg_names sorted = {.context = names->context, .compare = names->compare};
    LG_TRY_SCRATCH(uint32_t, place, names->context, names->count, LG_OUT_OF_MEMORY);
    for (uint32_t i = 0; i < names->count; i++) {
        place[names->order[i]] = i;
        LG_TRY(lg_names_add(&sorted, names->name[names->order[i]]));
    }
    for (size_t i = 0; i < count; i++)
        if (label[i] < names->count) label[i] = place[label[i]];
    lg_names_destroy(names);
    return LG_GIVE(names, sorted);
}

/* ---- reading ---- */

typedef struct names_call {
    const char *path, *key;
    bool unique;
    lg_status wrong; /* what a name that does not fit is */
    lg_names *names;
} names_call;

static lg_status add_name(void *user, uint64_t number, const char *text, lg_error *error) {
    const names_call *call = user;
    const char *shown = lg_shown_path(call->path);
    uint32_t index;
    bool known = false;
    if (call->unique && *text == '\0')
        return lg_fail(error, call->wrong, "%s: %s: name number %u is empty", shown, call->key,
                       (unsigned)number + 1);
    const lg_status status =
        call->unique ? lg_names_meet(call->names, text, &index, &known) : lg_names_add(call->names, text);
    if (status == LG_OUT_OF_MEMORY) return lg_no_memory_for(shown, error);
    if (status != LG_OK)
        return lg_fail(error, call->wrong, "%s: %s: more than %u names, or one of more than %d bytes: %.80s",
                       shown, call->key, LG_SERIES_CLASSES, LG_SERIES_NAME - 1, text);
    if (known) return lg_fail(error, call->wrong, "%s: %s: '%s' is there twice", shown, call->key, text);
    return LG_OK;
}

lg_status lg_names_get(lg_h5 *h5, const char *key, bool unique, lg_names *names, lg_error *error) {
    names_call call = {h5->path, key, unique, LG_FORMAT, names};
    lg_h5_about about;
    bool words;
    LG_TRY(lg_h5_each_name(h5, "", key, "|", &words, add_name, &call, error));
    if (words || !lg_h5_has(h5, key)) return LG_OK;
    LG_TRY(lg_h5_look(h5, key, 1, &about, error));
    return about.kind == LG_H5_WORDS ? lg_h5_each_text(h5, key, add_name, &call, error) : LG_OK;
}

/* ---- writing ---- */

/* The names may be NULL. Fails with LG_INVALID_ARGUMENT if one is not terminated or, with `unique`, is empty
 * or occurs twice. */
static lg_status check_names(const lg_context *context, const char *path, const char *what,
                             char (*name)[LG_SERIES_NAME], uint32_t count, bool unique, lg_error *error) {
    if (name == NULL) return LG_OK;
    LG_CLEAN(lg_names_destroy) lg_names met = {.context = context};
    names_call call = {path, what, unique, LG_INVALID_ARGUMENT, &met};
    if (count > LG_SERIES_CLASSES)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: more than %u %s", lg_shown_path(path),
                       LG_SERIES_CLASSES, what);
    for (uint32_t i = 0; i < count; i++) {
        if (memchr(name[i], '\0', LG_SERIES_NAME) == NULL)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: %s: name number %u does not end with a zero byte",
                           lg_shown_path(path), what, i + 1);
        LG_TRY(add_name(&call, i, name[i], error));
    }
    return LG_OK;
}

/* Writes the names, unless they are NULL, as one joined attribute if they are short and contain no |, else as
 * a data set. */
static lg_status put_names(lg_h5 *h5, const char *key, char (*name)[LG_SERIES_NAME], uint32_t count,
                           lg_error *error) {
    char joined[LG_H5_TEXT];
    size_t used = 0;
    bool fits = true;
    if (name == NULL) return LG_OK;
    for (uint32_t i = 0; i < count && fits; i++) {
        fits = used + LG_SERIES_NAME + 1 < sizeof joined && strchr(name[i], '|') == NULL;
        if (fits)
            used += (size_t)snprintf(joined + used, sizeof joined - used, "%s%s", i > 0 ? "|" : "", name[i]);
    }
    return fits ? lg_h5_put_text(h5, "", key, joined, error)
                : lg_h5_put_texts(h5, key, name[0], LG_SERIES_NAME, count, error);
}

/* ---- classes, channels, rate ---- */

static const lg_field rate = LG_FIELD(lg_series, "", "rate", REAL, rate, .high = 1e300);

lg_status lg_sensing_check(const lg_context *context, const char *path, const lg_series *sensing,
                           lg_error *error) {
    LG_TRY(lg_field_check(path, &rate, sensing, LG_INVALID_ARGUMENT, error));
    if (sensing->class_name == NULL || sensing->classes < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the classes have no names", lg_shown_path(path));
    LG_TRY(check_names(context, path, "classes", sensing->class_name, sensing->classes, true, error));
    LG_TRY(check_names(context, path, "class_labels", sensing->class_label, sensing->classes, true, error));
    return check_names(context, path, "channels", sensing->channel_name, sensing->channels, false, error);
}

lg_status lg_sensing_put(lg_h5 *h5, const lg_series *sensing, lg_error *error) {
    LG_TRY(put_names(h5, "classes", sensing->class_name, sensing->classes, error));
    LG_TRY(put_names(h5, "class_labels", sensing->class_label, sensing->classes, error));
    LG_TRY(put_names(h5, "channels", sensing->channel_name, sensing->channels, error));
    return sensing->rate == 0 ? LG_OK : lg_field_write(h5, &rate, sensing, error);
}

lg_status lg_names_list(lg_h5 *h5, const char *key, bool unique, uint32_t *count,
                        char (**out)[LG_SERIES_NAME], lg_error *error) {
    LG_CLEAN(lg_names_destroy) lg_names names = {.context = h5->context};
    LG_TRY(lg_names_get(h5, key, unique, &names, error));
    if (*count != 0 && names.count != 0 && names.count != *count)
        return lg_h5_fail(h5, error, "%s: %u names, expected %u", key, names.count, *count);
    if (names.count == 0) return LG_OK;
    *count = names.count;
    *out = lg_names_take(&names);
    return LG_OK;
}

lg_status lg_rate_get(lg_h5 *h5, lg_series *out, lg_error *error) {
    out->rate = 0;
    return lg_h5_has_attribute(h5, "", "rate") ? lg_field_get(h5, &rate, out, error) : LG_OK;
}

lg_status lg_sensing_get(lg_h5 *h5, lg_series *sensing, lg_error *error) {
    LG_CLEAN(lg_series_destroy)
    lg_series got = {.classes = sensing->classes, .channels = sensing->channels, .context = h5->context};
    LG_TRY(lg_names_list(h5, "classes", true, &got.classes, &got.class_name, error));
    if (got.classes > 0)
        LG_TRY(lg_names_list(h5, "class_labels", true, &got.classes, &got.class_label, error));
    LG_TRY(lg_names_list(h5, "channels", false, &got.channels, &got.channel_name, error));
    LG_TRY(lg_rate_get(h5, &got, error));
    return LG_GIVE(sensing, got);
}
