/* Saves, loads and compares a run by the rows of its recipe. */
#include "files/h5.h"
#include "model/files/recipe.h"

#include <stdio.h>
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

/* The range of a member that has the value for a missing attribute is not checked. Attributes of /model are
 * never missing. */
static lg_status check_row(const char *path, const lg_recipe *kind, const lg_field *r, const void *run,
                           lg_status status, lg_error *error) {
    const bool unknown =
        strcmp(r->group, "run") == 0 &&
        memcmp((const char *)run + r->offset, (const char *)kind->defaults + r->offset, r->size) == 0;
    return unknown ? LG_OK : lg_field_check(path, r, run, status, error);
}

lg_status lg_run_check(const char *path, const lg_recipe *kind, const void *run, lg_error *error) {
    const lg_field *r;
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++)
        LG_TRY(check_row(path, kind, r, run, LG_INVALID_ARGUMENT, error));
    LG_TRY_SCRATCH(char, again, NULL, kind->run_size, lg_no_memory(error));
    memcpy(again, run, kind->run_size);
    const lg_status made = kind->make(again, NULL);
    if (made == LG_OK && memcmp(again + kind->made, (const char *)run + kind->made, kind->made_size) == 0)
        return LG_OK;
    return lg_fail(error, made != LG_OK ? made : LG_INVALID_ARGUMENT,
                   "%s: the model was not made by its init function", lg_shown_path(path));
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
        LG_TRY(lg_as_format(lg_field_read(h5, r, run, error), error));
        LG_TRY(check_row(h5->path, kind, r, run, LG_FORMAT, error));
    }
    lg_error why = {LG_OK, ""};
    if (kind->read != NULL) LG_TRY(kind->read(h5, run, error));
    if (kind->make(run, &why) == LG_OK) return LG_OK;
    return lg_h5_fail(h5, error, "%s%s",
                      why.message[0] == '/' ? ""
                                            : "/model: the attributes do not describe a possible network: ",
                      why.message);
}

/* ---- slices ---- */

size_t lg_recipe_parameters(const lg_recipe *kind, const void *run) {
    lg_slice_info s;
    size_t count = 0;
    for (uint32_t i = 0; kind->slice != NULL && kind->slice(run, i, &s); i++) count += s.count;
    return count;
}

void lg_slice_set(lg_slice_info *s, size_t offset, uint32_t rank, uint64_t first, uint64_t second) {
    s->rank = rank;
    s->dims[0] = first, s->dims[1] = second;
    s->offset = offset;
    s->count = (size_t)(first * (rank == 2 ? second : 1));
}

bool lg_slice_of_mlp(const lg_mlp *net, const char *part, size_t offset, uint32_t *index, lg_slice_info *s) {
    for (uint32_t layer = 0; layer < net->layers; layer++)
        for (int bias = 0; bias < 2; bias++) {
            if ((bias == 1 && !lg_mlp_has_bias(net, layer)) || (*index)-- != 0) continue;
            const size_t at = bias ? lg_mlp_bias_offset(net, layer) : lg_mlp_weight_offset(net, layer);
            lg_slice_set(s, offset + at, bias ? 1 : 2, net->width[layer + bias],
                         bias ? 0 : net->width[layer + 1]);
            (void)snprintf(s->name, sizeof s->name, "%s/layer%u/%s", part, layer + 1,
                           bias ? "bias" : "weight");
            return true;
        }
    return false;
}

/* ---- comparing ---- */

lg_status lg_recipe_compare_runs(const lg_recipe *kind, const void *stored, const void *wanted,
                                 const char *path, lg_error *error) {
    char have[LG_FIELD_TEXT_SIZE], want[LG_FIELD_TEXT_SIZE];
    const lg_field *r;
    if (path == NULL || kind == NULL || stored == NULL || wanted == NULL) return LG_INVALID_ARGUMENT;
    /* Other data also change the scales, so a difference of the data is reported first. */
    for (int all = 0; all < 2; all++)
        for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) {
            lg_field_show(r, stored, have, sizeof have);
            lg_field_show(r, wanted, want, sizeof want);
            if ((all || strcmp(r->name, "data_sha256") == 0) && strcmp(have, want) != 0)
                return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written %s %s %s, not %s",
                               lg_shown_path(path), all ? "with" : "from other data:", r->name, have, want);
        }
    return LG_OK;
}
