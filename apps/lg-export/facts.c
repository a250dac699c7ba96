/* Tells in headers what a model's file holds about model, data and training: the rows of its recipe. */
#include <math.h>
#include <string.h>

#include "lg-export/faces.h"
#include "model/files/recipe.h"

/* Writes a value, real numbers with six digits. */
static void show(const lg_field *row, const void *values, char *value, size_t size) {
    if (row->type == LG_FIELD_REAL)
        (void)lg_format(value, size, "%.6g", lg_field_number(row, values));
    else
        lg_field_show(row, values, value, size);
}

/* Adds "family chain, links 1, ..." for the rows of a group. Lists of real numbers, hashes, texts of several
 * lines, and options of methods that the training did not use are left out. */
static void tell_rows(text *to, const lg_recipe *recipe, const lg_field *rows, const char *group,
                      const void *run) {
    const lg_fit_settings *training = (const void *)((const char *)run + recipe->training);
    char value[LG_FIELD_TEXT_SIZE];
    for (const lg_field *row = rows; row->name != NULL; row++) {
        if (row->group == NULL || strcmp(row->group, group) != 0) continue;
        if (row->type == LG_FIELD_REALS || strstr(row->name, "sha256") != NULL) continue;
        if (row->adam && !lg_fit_plan_batches(&training->plan)) continue;
        show(row, run, value, sizeof value);
        if (value[0] != '\0' && strchr(value, '\n') == NULL)
            lg_text_add(to, "%s%s %s", to->length > 0 ? ", " : "", row->name, value);
    }
}

static void tell_group(text *about, const lg_recipe *recipe, const char *label, bool facts, bool fields,
                       const char *group, const void *run) {
    APP_CLEAN(lg_text_destroy) text line = app_text();
    if (facts) tell_rows(&line, recipe, recipe->facts, group, run);
    if (fields) tell_rows(&line, recipe, recipe->fields, group, run);
    if (line.length > 0) lg_text_add(about, "%-12s  %s\n", label, line.data);
}

/* Adds a line for each result of training, such as "E1  3.1e-05: mean squared error ...". `hash`: of the
 * training data, which are no test of the model. */
static void tell_results(text *about, const lg_recipe *recipe, const void *file, const char *hash) {
    char value[LG_FIELD_TEXT_SIZE];
    for (const lg_item *item = recipe->items; item != NULL && item->type != LG_ITEM_END; item++) {
        const lg_field *row = &item->field;
        if (item->type != LG_ITEM_ATTRIBUTE || !lg_item_is_known(item, file)) continue;
        show(row, file, value, sizeof value);
        const char *meaning = strcmp(value, hash) == 0 ? "THE TRAINING DATA" : row->meaning;
        lg_text_add(about, "%-12s  %s%s%s\n", row->name, value, meaning != NULL ? ": " : "",
                    meaning != NULL ? meaning : "");
    }
}

void export_tell_facts(const export_model *m) {
    const lg_recipe *recipe = m->file->recipe;
    const lg_model_head *head = m->file->contents;
    const void *run = (const char *)m->file->contents + recipe->file_run;
    const lg_field *sha256 = lg_field_find(recipe->facts, "data_sha256");
    const double *loss = head->history[LG_FIT_LOSS];
    const size_t done = head->epochs_done;
    char hash[LG_FIELD_TEXT_SIZE];
    text *about = &m->source->about;
    lg_text_add(about, "\n");
    tell_group(about, recipe, "model", true, true, "model", run);
    tell_group(about, recipe, "data", true, false, "run", run);
    tell_group(about, recipe, "training", false, true, "run", run);
    if (done > 0 && loss != NULL && isfinite(loss[done - 1]))
        lg_text_add(about, "last loss     %.4e after %zu epochs\n", loss[done - 1], done);
    lg_field_show(sha256, run, hash, sizeof hash);
    tell_results(about, recipe, m->file->contents, hash);
    export_provenance(m->source, &head->provenance, hash);
}
