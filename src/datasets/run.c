/* The description of a run: one table for saving, loading and comparing. */
#include "datasets/run.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "datasets/names.h"

/* How a model is trained: the same for every kind. */
#define TRAINING(member, type, ...) LG_ROW(lg_training, "run", #member, type, member, __VA_ARGS__)
static const lg_row training_rows[] = {
    TRAINING(dtype, NAME, .value_name = lg_name_dtype),
    TRAINING(epochs, U64, .low = 0),
    TRAINING(batch, U64, .low = 0),
    TRAINING(lr, REAL, .low = 0),
    TRAINING(schedule, NAME, .value_name = lg_name_schedule, .optional = true),
    TRAINING(lr_step, U64, .low = 0),
    TRAINING(lr_gamma, REAL, .low = 0),
    TRAINING(weight_decay, REAL, .low = 0),
    TRAINING(adam_eps, REAL, .low = 0),
    TRAINING(clip, REAL, .low = 0),
    TRAINING(validation, REAL, .low = 0),
    TRAINING(shards, U32, .low = 1),
    TRAINING(seed, U64, .low = 0),
};

/* Row number `index` of a run and where its field is counted from; NULL beyond the last. */
static const lg_row *row_at(const lg_run_kind *kind, size_t index, size_t *base) {
    *base = index < kind->row_count ? 0 : kind->training;
    if (index < kind->row_count) return &kind->rows[index];
    index -= kind->row_count;
    return index < LG_COUNT(training_rows) ? &training_rows[index] : NULL;
}

typedef struct row_value {
    double real;
    uint64_t whole;
    char made[LG_H5_TEXT]; /* LG_ROW_SHOWN */
    const char *text;      /* NULL for a name beyond the list */
} row_value;

_Static_assert(sizeof(lg_dtype) == sizeof(uint32_t) && sizeof(lg_activation) == sizeof(uint32_t) &&
                   sizeof(bool) == 1,
               "enumerations are read through their representation");

/* Number of the row that a pointer points to; one beyond the last where it is none. */
static uint32_t row_number(const lg_row *r, const char *at) {
    const void *row;
    uint32_t value = 0;
    memcpy(&row, at, sizeof row);
    while (r->value_name(value) != NULL && r->value_at(value) != row) value++;
    return value;
}

/* A name's or flag's number, whatever the width of its field. */
static uint32_t narrow_at(const lg_row *r, const char *at) {
    uint32_t value = 0;
    bool flag;
    if (r->value_at != NULL) return row_number(r, at);
    if (r->size == sizeof value) {
        memcpy(&value, at, sizeof value);
    } else {
        memcpy(&flag, at, sizeof flag);
        value = flag;
    }
    return value;
}

static void set_narrow(const lg_row *r, char *at, uint32_t value) {
    const bool flag = value != 0;
    const void *const row = r->value_at != NULL ? r->value_at(value) : NULL;
    if (r->value_at != NULL)
        memcpy(at, &row, sizeof row);
    else if (r->size == sizeof value)
        memcpy(at, &value, sizeof value);
    else
        memcpy(at, &flag, sizeof flag);
}

static void value_of(const lg_row *r, size_t base, const void *run, row_value *out) {
    const char *at = (const char *)run + base + r->offset;
    out->real = 0;
    out->whole = 0;
    out->text = "";
    switch (r->type) {
    case LG_ROW_REAL:
        memcpy(&out->real, at, sizeof out->real);
        break;
    case LG_ROW_U64:
        memcpy(&out->whole, at, sizeof out->whole);
        break;
    case LG_ROW_U32:
    case LG_ROW_FLAG:
        out->whole = narrow_at(r, at);
        break;
    case LG_ROW_TEXT:
        out->text = at;
        break;
    case LG_ROW_NAME:
        out->text = r->value_name(narrow_at(r, at));
        break;
    case LG_ROW_SHOWN:
        r->show(run, out->made, sizeof out->made);
        out->text = out->made;
        break;
    }
}

static bool is_whole(const lg_row *r) {
    return r->type == LG_ROW_U64 || r->type == LG_ROW_U32 || r->type == LG_ROW_FLAG;
}

static const char *place_name(const lg_row *r, char *text, size_t size) {
    (void)snprintf(text, size, "/%s: attribute %s", r->group, r->name);
    return text;
}

static lg_status check_row(const char *path, const lg_row *r, size_t base, const void *run, lg_status status,
                           lg_error *error) {
    char place[64];
    row_value value;
    value_of(r, base, run, &value);
    if (r->type == LG_ROW_REAL && !isfinite(value.real))
        return lg_fail(error, LG_NOT_FINITE, "%s: %s is not finite", lg_shown_path(path),
                       place_name(r, place, sizeof place));
    const bool small =
        (r->type == LG_ROW_REAL && value.real < r->low) || (is_whole(r) && (double)value.whole < r->low);
    if (small || value.text == NULL)
        return lg_fail(error, status, "%s: %s is out of range", lg_shown_path(path),
                       place_name(r, place, sizeof place));
    return LG_OK;
}

lg_status lg_run_check(const char *path, const lg_run_kind *kind, const void *run, lg_error *error) {
    size_t base;
    const lg_row *r;
    for (size_t i = 0; (r = row_at(kind, i, &base)) != NULL; i++)
        LG_TRY(check_row(path, r, base, run, LG_INVALID_ARGUMENT, error));
    const lg_status status = kind->check(run);
    if (status != LG_OK)
        return lg_fail(error, status, "%s: the model was not made by its init function", lg_shown_path(path));
    return LG_OK;
}

lg_status lg_run_put(lg_h5 *h5, const lg_run_kind *kind, const void *run, lg_error *error) {
    size_t base;
    const lg_row *r;
    row_value value;
    for (size_t i = 0; (r = row_at(kind, i, &base)) != NULL; i++) {
        value_of(r, base, run, &value);
        if (r->type == LG_ROW_REAL)
            LG_TRY(lg_h5_put_number(h5, r->group, r->name, LG_ELEMENT_F64, &value.real, error));
        else if (is_whole(r))
            LG_TRY(lg_h5_put_number(h5, r->group, r->name, LG_ELEMENT_U64, &value.whole, error));
        else
            LG_TRY(lg_h5_put_text(h5, r->group, r->name, value.text, error));
    }
    return kind->describe(h5, run, error);
}

/* ---- loading ---- */

static lg_status attribute_format(lg_h5 *h5, const lg_row *r, const char *what, lg_error *error) {
    char place[64];
    return lg_fail(error, LG_FORMAT, "%s: %s %s", lg_shown_path(h5->path), place_name(r, place, sizeof place),
                   what);
}

static lg_status get_name(lg_h5 *h5, const lg_row *r, char *at, lg_error *error) {
    char text[64];
    const lg_status status = lg_h5_text(h5, r->group, r->name, text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return status;
    uint32_t value = 0;
    const char *name = status == LG_OK ? r->value_name(0) : NULL;
    while (name != NULL && strcmp(name, text) != 0) name = r->value_name(++value);
    if (name == NULL) return attribute_format(h5, r, "is not a known name", error);
    set_narrow(r, at, value);
    return LG_OK;
}

static lg_status get_flag(lg_h5 *h5, const lg_row *r, char *at, lg_error *error) {
    uint32_t value;
    LG_TRY(lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U32, &value, error));
    if (value > 1) return attribute_format(h5, r, "is neither 0 nor 1", error);
    set_narrow(r, at, value);
    return LG_OK;
}

static lg_status get_row(lg_h5 *h5, const lg_row *r, size_t base, void *run, lg_error *error) {
    char *at = (char *)run + base + r->offset;
    lg_status status = LG_OK;
    switch (r->type) {
    case LG_ROW_REAL:
        status = lg_h5_number(h5, r->group, r->name, LG_ELEMENT_F64, at, error);
        break;
    case LG_ROW_U64:
        status = lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U64, at, error);
        break;
    case LG_ROW_U32:
        status = lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U32, at, error);
        break;
    case LG_ROW_FLAG:
        status = get_flag(h5, r, at, error);
        break;
    case LG_ROW_NAME:
        status = get_name(h5, r, at, error);
        break;
    case LG_ROW_TEXT:
        status = lg_h5_text(h5, r->group, r->name, at, r->size, error);
        if (status == LG_SHAPE) status = attribute_format(h5, r, "is too long", error);
        break;
    case LG_ROW_SHOWN:
        return LG_OK;
    }
    if (status != LG_OK) return status;
    return check_row(h5->path, r, base, run, LG_FORMAT, error);
}

lg_status lg_run_get(lg_h5 *h5, const lg_run_kind *kind, bool complete, void *run, lg_error *error) {
    size_t base;
    const lg_row *r;
    memcpy(run, kind->defaults, kind->run_size);
    for (size_t i = 0; (r = row_at(kind, i, &base)) != NULL; i++) {
        const bool needed = !r->optional && (complete || strcmp(r->group, "model") == 0);
        if (!needed && !lg_h5_has_attribute(h5, r->group, r->name)) continue;
        LG_TRY(lg_missing_is_format(get_row(h5, r, base, run, error), error));
    }
    return kind->build(h5, run, error);
}

/* ---- comparing ---- */

/* A value as it stands in a sentence. */
static void show_row(const lg_row *r, size_t base, const void *run, char *text, size_t size) {
    row_value value;
    value_of(r, base, run, &value);
    if (r->type == LG_ROW_REAL)
        (void)snprintf(text, size, "%.17g", value.real);
    else if (is_whole(r))
        (void)snprintf(text, size, "%llu", (unsigned long long)value.whole);
    else
        (void)snprintf(text, size, "%s", value.text != NULL ? value.text : "?");
}

lg_status lg_run_compare(const char *path, const lg_run_kind *kind, const void *stored, const void *wanted,
                         lg_error *error) {
    char have[LG_ROW_TEXT_SIZE], want[LG_ROW_TEXT_SIZE];
    size_t base;
    const lg_row *r;
    if (path == NULL || stored == NULL || wanted == NULL) return LG_INVALID_ARGUMENT;
    for (size_t i = 0; (r = row_at(kind, i, &base)) != NULL; i++) {
        show_row(r, base, stored, have, sizeof have);
        show_row(r, base, wanted, want, sizeof want);
        if (strcmp(have, want) != 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written with %s %s, not %s",
                           lg_shown_path(path), r->name, have, want);
    }
    return LG_OK;
}
