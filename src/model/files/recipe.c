/* Saves, loads and compares a run by the rows of its recipe. */
#include "files/h5.h"
#include "model/files/recipe.h"

#include <math.h>
#include <string.h>

#include "settings/files/attributes.h"

/* Row `index` of a run: first the facts, then the hyperparameters; NULL beyond the last row. */
static const lg_field *row_at(const lg_recipe *kind, size_t index) {
    const lg_field *row = kind->facts;
    for (; row->name != NULL && index > 0; row++) index--;
    if (row->name == NULL) row = kind->fields;
    for (; row->name != NULL && index > 0; row++) index--;
    return row->name != NULL ? row : NULL;
}

/* Whether the member has the value that it gets if its attribute is missing; then its range is not checked.
 * Attributes of /model are never missing. */
static bool is_unknown(const lg_recipe *kind, const lg_field *r, const void *run) {
    return strcmp(r->group, "run") == 0 &&
           memcmp((const char *)run + r->offset, (const char *)kind->defaults + r->offset, r->size) == 0;
}

static lg_status check_row(const char *path, const lg_recipe *kind, const lg_field *r, const void *run,
                           lg_status status, lg_error *error) {
    char place[64];
    if (r->type == LG_FIELD_REAL && !isfinite(lg_field_number(r, run)))
        return lg_fail(error, LG_NOT_FINITE, "%s: %s is not finite", lg_shown_path(path),
                       lg_field_place(r, place, sizeof place));
    if (!lg_field_fits(r, run) && !is_unknown(kind, r, run))
        return lg_fail(error, status, "%s: %s is out of range", lg_shown_path(path),
                       lg_field_place(r, place, sizeof place));
    return LG_OK;
}

lg_status lg_run_check(const char *path, const lg_recipe *kind, const void *run, lg_error *error) {
    const lg_field *r;
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++)
        LG_TRY(check_row(path, kind, r, run, LG_INVALID_ARGUMENT, error));
    const lg_status status = kind->check(run);
    if (status != LG_OK)
        return lg_fail(error, status, "%s: the model was not made by its init function", lg_shown_path(path));
    return LG_OK;
}

lg_status lg_run_put(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_error *error) {
    const lg_field *r;
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) LG_TRY(lg_field_write(h5, r, run, error));
    return kind->describe != NULL ? kind->describe(h5, run, error) : LG_OK;
}

lg_status lg_run_get(lg_h5 *h5, const lg_recipe *kind, bool complete, void *run, lg_error *error) {
    const lg_field *r;
    memcpy(run, kind->defaults, kind->run_size);
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) {
        const bool needed = !r->optional && (complete || strcmp(r->group, "model") == 0);
        if (!needed && !lg_h5_has_attribute(h5, r->group, r->name)) continue;
        LG_TRY(lg_missing_is_format(lg_field_read(h5, r, run, error), error));
        LG_TRY(check_row(h5->path, kind, r, run, LG_FORMAT, error));
    }
    return kind->build != NULL ? kind->build(h5, run, error) : LG_OK;
}

/* ---- comparing ---- */

static bool differs(const lg_field *r, const void *stored, const void *wanted, char have[LG_FIELD_TEXT_SIZE],
                    char want[LG_FIELD_TEXT_SIZE]) {
    lg_field_show(r, stored, have, LG_FIELD_TEXT_SIZE);
    lg_field_show(r, wanted, want, LG_FIELD_TEXT_SIZE);
    return strcmp(have, want) != 0;
}

lg_status lg_recipe_compare_runs(const lg_recipe *kind, const void *stored, const void *wanted,
                                 const char *path, lg_error *error) {
    char have[LG_FIELD_TEXT_SIZE], want[LG_FIELD_TEXT_SIZE];
    const lg_field *r;
    if (path == NULL || kind == NULL || stored == NULL || wanted == NULL) return LG_INVALID_ARGUMENT;
    /* Other data also change the scales, so a difference of the data is reported first. */
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++)
        if (strcmp(r->name, "data_sha256") == 0 && differs(r, stored, wanted, have, want))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written from other data: %s %s, not %s",
                           lg_shown_path(path), r->name, have, want);
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) {
        if (differs(r, stored, wanted, have, want))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written with %s %s, not %s",
                           lg_shown_path(path), r->name, have, want);
    }
    return LG_OK;
}
