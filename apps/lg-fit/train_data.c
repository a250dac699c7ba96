/* lg-fit train: the columns, the table, and its training and validation part. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "datasets/table_names.h"
#include "lg-fit/train.h"

enum { STREAM_SPLIT = 2 };

/* ---- columns ---- */

/* An output, or the column with the classes. */
static bool is_learned(const training *state, const char *name) {
    return has_name(&state->outputs, name) || (!is_regression(state) && strcmp(name, state->class_name) == 0);
}

/* All columns with a name that are none of the outputs, and not left out by --without. */
static int default_inputs(const app *self, const lg_table_names *all, training *state) {
    column_names *out = &state->inputs;
    *out = (column_names){0, app_alloc((size_t)all->count + 1, sizeof *out->name)};
    for (uint32_t i = 0; i < all->count; i++) {
        const char *name = all->name[i];
        if (name[0] == '\0')
            app_warn(self, "column %u has no name and is not used", i + 1);
        else if (!is_learned(state, name) && !has_name(&state->without, name))
            memcpy(out->name[out->count++], name, sizeof *out->name);
    }
    return APP_EXIT_OK;
}

static bool may_be_used(const training *state, const char *name) {
    return name[0] != '\0' && !has_name(&state->without, name);
}

/* The last column that has a name and is not left out. */
static int default_outputs(const app *self, const lg_table_names *all, const char *path, training *state) {
    column_names *out = &state->outputs;
    char quoted[LG_TABLE_QUOTED];
    uint32_t last = all->count;
    while (last > 0 && !may_be_used(state, all->name[last - 1])) last--;
    if (last == 0) return app_fail(self, LG_FORMAT, "%s: there is no column with a name", path);
    *out = (column_names){1, app_alloc(1, sizeof *out->name)};
    memcpy(out->name[0], all->name[last - 1], sizeof *out->name);
    (void)fprintf(stderr, "%s: the output is the last column, %s; --outputs or --class names others\n",
                  self->title, lg_table_quote(out->name[0], quoted));
    return APP_EXIT_OK;
}

static int no_column(const app *self, const column_names *have, const char *path, const char *name) {
    enum { SHOWN = 20 };
    const column_names first = {have->count < SHOWN ? have->count : SHOWN, have->name};
    char *list = list_names(&first);
    const int code = app_fail(self, LG_FORMAT, "%s: there is no column '%s'; the columns are: %s%s", path,
                              name, list, have->count > SHOWN ? ", ..." : "");
    free(list);
    return code;
}

/* --class and --without: one name, and names of the table. */
static int name_others(const app *self, const lg_table_names *all, const char *path, training *state) {
    const train_values *given = state->given;
    const column_names have = {all->count, all->name};
    int code = APP_EXIT_OK;
    if (!is_regression(state)) code = parse_class(self, given->class_column, state->class_name);
    if (code == APP_EXIT_OK && given->without != NULL)
        code = parse_names(self, "without", given->without, &state->without);
    for (uint32_t i = 0; i < state->without.count && code == APP_EXIT_OK; i++) {
        if (has_name(&have, state->without.name[i])) continue;
        code = no_column(self, &have, path, state->without.name[i]);
    }
    return code;
}

/* Inputs and outputs of all columns. */
static int name_columns(const app *self, const lg_table_names *all, const char *path, training *state) {
    const train_values *given = state->given;
    int code = name_others(self, all, path, state);
    if (code != APP_EXIT_OK) return code;
    if (given->outputs != NULL)
        code = parse_names(self, "outputs", given->outputs, &state->outputs);
    else if (is_regression(state))
        code = default_outputs(self, all, path, state);
    if (code != APP_EXIT_OK) return code;
    return given->inputs != NULL ? parse_names(self, "inputs", given->inputs, &state->inputs)
                                 : default_inputs(self, all, state);
}

/* No column has two of the roles input, output and left out. */
static int check_roles(const app *self, const training *state) {
    for (uint32_t i = 0; i < state->inputs.count; i++)
        if (is_learned(state, state->inputs.name[i]))
            return app_usage(self, "column %s is an input and an output", state->inputs.name[i]);
    for (uint32_t i = 0; i < state->without.count; i++) {
        const char *name = state->without.name[i];
        if (is_learned(state, name) || has_name(&state->inputs, name))
            return app_usage(self, "--without: column %s is an %s", name,
                             is_learned(state, name) ? "output" : "input");
    }
    return APP_EXIT_OK;
}

static int choose_columns(const app *self, const char *path, training *state) {
    lg_table_names all = {.count = 0};
    lg_error error = {LG_OK, ""};
    if (state->given->outputs != NULL && !is_regression(state))
        return app_usage(self,
                         "--outputs and --class: a table is learned by regression or by classification");
    const lg_status status = lg_table_names_read(self->context, path, NULL, &all, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    const int code = name_columns(self, &all, path, state);
    lg_table_names_destroy(&all);
    if (code != APP_EXIT_OK) return code;
    if (state->inputs.count == 0)
        return app_fail(self, LG_FORMAT, "%s: there is no column to learn from", path);
    return check_roles(self, state);
}

/* ---- the tables ---- */

/* The rows of each class; two classes at least have some. */
static int count_classes(const app *self, const training *state, uint64_t *members) {
    const lg_table_data *data = &state->table.data;
    uint32_t present = 0;
    for (size_t i = 0; i < data->rows; i++) members[data->label[i]]++;
    for (uint32_t c = 0; c < data->classes; c++) present += members[c] > 0;
    if (present < 2)
        return app_fail(self, LG_FORMAT, "%s: column %s has one class only: there is nothing to tell apart",
                        state->table.path, state->class_name);
    for (uint32_t c = 0; c < data->classes; c++)
        if (members[c] < 2)
            app_warn(self, "%s: class '%s' has %llu %s", state->table.path, data->class_name[c],
                     (unsigned long long)members[c], members[c] == 1 ? "row" : "complete rows");
    return APP_EXIT_OK;
}

/* The classes become the outputs. */
static int take_classes(const app *self, training *state) {
    const lg_table_data *data = &state->table.data;
    uint64_t *members = app_alloc(data->classes + 1, sizeof *members);
    const int code = count_classes(self, state, members);
    free(members);
    if (code != APP_EXIT_OK) return code;
    state->outputs = (column_names){data->classes, app_alloc(data->classes, sizeof *state->outputs.name)};
    memcpy(state->outputs.name, data->class_name, data->classes * sizeof *data->class_name);
    return APP_EXIT_OK;
}

static bool is_constant(const lg_table_data *data, uint32_t column) {
    size_t same = 1;
    while (same < data->rows && data->values[same * data->columns + column] == data->values[column]) same++;
    return same == data->rows;
}

/* The columns of `keep` (columns of the table) stay; the outputs are among them. */
static void keep_columns(training *state, const bool *keep) {
    lg_table_data *data = &state->table.data;
    uint32_t kept = 0, inputs = 0;
    for (uint32_t c = 0; c < data->columns; c++) kept += keep[c];
    for (size_t i = 0, to = 0; i < data->rows; i++)
        for (uint32_t c = 0; c < data->columns; c++)
            if (keep[c]) data->values[to++] = data->values[i * data->columns + c];
    for (uint32_t c = 0; c < state->inputs.count; c++)
        if (keep[c]) memmove(state->inputs.name[inputs++], state->inputs.name[c], sizeof(lg_table_text));
    data->columns = kept;
    state->inputs.count = state->table.inputs = inputs;
}

/* Constant inputs are left out, as if they had not been named: they would change width and priors. */
static int leave_constant(const app *self, training *state) {
    const lg_table_data *data = &state->table.data;
    bool *keep = app_alloc(data->columns, sizeof *keep);
    char quoted[LG_TABLE_QUOTED];
    for (uint32_t c = 0; c < data->columns; c++) {
        const bool input = c < state->inputs.count, constant = is_constant(data, c);
        const char *name = input ? state->inputs.name[c] : state->outputs.name[c - state->inputs.count];
        keep[c] = !input || !constant;
        if (constant)
            app_warn(self, "%s: column %s is constant: %s", state->table.path, lg_table_quote(name, quoted),
                     input ? "it says nothing and is left out" : "there is nothing to learn of it");
    }
    keep_columns(state, keep);
    free(keep);
    if (state->inputs.count > 0) return APP_EXIT_OK;
    return app_fail(self, LG_FORMAT, "%s: all inputs are constant: there is nothing to learn from",
                    state->table.path);
}

/* ---- cells out of range ---- */

static const char *column_name(const training *state, uint32_t column) {
    const uint32_t inputs = state->inputs.count;
    return column < inputs ? state->inputs.name[column] : state->outputs.name[column - inputs];
}

/* Numbers that differ by less than normal numbers cannot be scaled to 1. */
static int check_spread(const app *self, const training *state, uint32_t column) {
    const lg_table_data *data = &state->table.data;
    const double *values = data->values + column;
    size_t low = 0, high = 0;
    char quoted[LG_TABLE_QUOTED];
    for (size_t i = 1; i < data->rows; i++) {
        if (values[i * data->columns] < values[low * data->columns]) low = i;
        if (values[i * data->columns] > values[high * data->columns]) high = i;
    }
    const double least = values[low * data->columns], largest = values[high * data->columns];
    if (largest == least || largest - least >= DBL_MIN * sqrt(2.0 * (double)data->rows)) return APP_EXIT_OK;
    return app_fail(
        self, LG_FORMAT,
        "%s: column %s: its values, from %.3g in %s %zu to %.3g in %s %zu, differ by less than can "
        "be scaled: give the column in a smaller unit",
        state->table.path, lg_table_quote(column_name(state, column), quoted), least, data->place,
        data->line[low], largest, data->place, data->line[high]);
}

/* All columns that are used. */
static int check_cells(const app *self, const training *state) {
    const fit_table *table = &state->table;
    const column_names outputs = {table->outputs, state->outputs.name};
    int code = APP_EXIT_OK;
    for (uint32_t c = 0; c < table->data.columns && code == APP_EXIT_OK; c++)
        code = check_spread(self, state, c);
    if (code != APP_EXIT_OK) return code;
    warn_far(self, table, 0, &state->inputs,
             "the column is scaled without them, and the fit has to follow them");
    warn_far(self, table, state->inputs.count, &outputs,
             "the fit follows them, and most of its error comes from them");
    return APP_EXIT_OK;
}

/* Whether these inputs, the outputs and the classes can be read. */
static bool is_readable(const app *self, const char *path, const training *state,
                        const column_names *inputs) {
    fit_table table;
    const lg_status status =
        load_table(self, path, inputs, &state->outputs, class_column(state), &table, NULL);
    lg_table_data_destroy(&table.data);
    return status == LG_OK;
}

/* The inputs that cannot be read, where all the rest can. Freed with free_names. */
static column_names find_unreadable(const app *self, const char *path, const training *state) {
    enum { MOST_TRIED = 100 }; /* each reads the file again */
    column_names bad = {0, NULL};
    if (state->inputs.count > MOST_TRIED || !is_readable(self, path, state, &bad)) return bad;
    bad.name = app_alloc(state->inputs.count, sizeof *bad.name);
    for (uint32_t i = 0; i < state->inputs.count; i++) {
        const column_names one = {1, state->inputs.name + i};
        if (!is_readable(self, path, state, &one)) memcpy(bad.name[bad.count++], one.name, sizeof *bad.name);
    }
    return bad;
}

/* Where inputs were not named and some are no numbers: how to leave them out. */
static int fail_columns(const app *self, const char *path, const training *state, lg_error *error) {
    enum { MOST_SHOWN = 200 };
    const lg_error was = *error;
    column_names bad = {0, NULL};
    if (was.status == LG_FORMAT && state->given->inputs == NULL) bad = find_unreadable(self, path, state);
    if (bad.count > 0) {
        char *list = list_names(&bad), *word = app_quote(list);
        (void)app_error(error, was.status, "%.250s; --without %s leaves out what is no number", was.message,
                        strlen(word) <= MOST_SHOWN ? word : "A,B,...");
        free(word);
        free(list);
    }
    free_names(&bad);
    return app_fail_file(self, was.status, error, path);
}

static int read_test(const app *self, training *state) {
    const train_values *given = state->given;
    const column_names none = {0, NULL};
    const bool regression = is_regression(state);
    const int code = read_table(self, given->test, &state->inputs, regression ? &state->outputs : &none,
                                class_column(state), true, &state->test);
    if (code != APP_EXIT_OK || regression) return code;
    return match_classes(self, &state->test, state->outputs.name, state->outputs.count);
}

/* The columns that are learned, and learned from; complete rows. */
static int read_columns(const app *self, const char *path, training *state) {
    lg_error error = {LG_OK, ""};
    const lg_status status =
        load_table(self, path, &state->inputs, &state->outputs, class_column(state), &state->table, &error);
    if (status != LG_OK) return fail_columns(self, path, state, &error);
    const int code = leave_incomplete(self, &state->table);
    if (code != APP_EXIT_OK) return code;
    if (state->table.data.rows < 2)
        return app_fail(self, LG_FORMAT, "%s: has one complete row; two at least are needed", path);
    const int left = leave_constant(self, state);
    return left == APP_EXIT_OK ? check_cells(self, state) : left;
}

int read_training(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    training *state = user;
    int code = choose_columns(self, path, state);
    if (code == APP_EXIT_OK) code = read_columns(self, path, state);
    if (code == APP_EXIT_OK && !is_regression(state)) code = take_classes(self, state);
    if (code == APP_EXIT_OK && state->given->test != NULL) code = read_test(self, state);
    if (code == APP_EXIT_OK) memcpy(sha256, state->table.data.sha256, LG_SHA256_TEXT);
    return code;
}

/* ---- rows that are there twice ---- */

typedef struct sorted_row {
    const double *values;
    uint32_t columns, label;
    bool trained;
} sorted_row;

static int compare_sorted(const void *a, const void *b) {
    const sorted_row *x = a, *y = b;
    for (uint32_t c = 0; c < x->columns; c++)
        if (x->values[c] != y->values[c]) return x->values[c] < y->values[c] ? -1 : 1;
    return (x->label > y->label) - (x->label < y->label);
}

/* Freed with free. */
static sorted_row *sort_rows(const training *state) {
    const lg_table_data *data = &state->table.data;
    sorted_row *rows = app_alloc(data->rows, sizeof *rows);
    for (size_t i = 0; i < data->rows; i++) {
        const size_t row = state->order[i];
        rows[i] = (sorted_row){table_row(&state->table, row), data->columns,
                               data->label != NULL ? data->label[row] : 0, i < state->trained};
    }
    qsort(rows, data->rows, sizeof *rows, compare_sorted);
    return rows;
}

void warn_duplicates(const app *self, const training *state) {
    sorted_row *rows = sort_rows(state);
    size_t repeated = 0, shared = 0, first = 0;
    bool both = false;
    for (size_t i = 1; i < state->table.data.rows; i++) {
        const bool same = compare_sorted(&rows[i - 1], &rows[i]) == 0;
        repeated += same;
        if (!same) first = i, both = false;
        if (same && !both && rows[i].trained != rows[first].trained) both = true, shared++;
    }
    free(rows);
    if (repeated > 0) app_warn(self, "%s: %zu rows are repetitions of others", state->table.path, repeated);
    if (shared > 0)
        app_warn(
            self,
            "%s: %zu different rows are in the training and in the validation part: the errors there are "
            "too good",
            state->table.path, shared);
}

/* ---- parts ---- */

/* Columns first .. first + count - 1 of the training rows. Freed with free. */
static double *training_part(const training *state, uint32_t first, uint32_t count) {
    double *part = app_alloc(state->trained * count, sizeof *part);
    for (size_t i = 0; i < state->trained; i++)
        memcpy(part + i * count, table_row(&state->table, state->order[i]) + first, count * sizeof *part);
    return part;
}

/* Column c of the scaler from the cells that are not far; `chosen` has room for the training rows. */
static lg_status fit_without_far(const training *state, const app *self, const double *part, uint32_t c,
                                 uint32_t *chosen, lg_scaler *scaler) {
    const uint32_t columns = scaler->channels;
    lg_table_far *far = &state->far[c];
    lg_scaler one;
    uint32_t kept = 0;
    lg_status status = lg_table_find_far(self->context, part + c, columns, state->trained, far);
    if (status != LG_OK || far->count == 0) return status;
    double *column = app_alloc(state->trained, sizeof *column);
    for (uint32_t i = 0; i < state->trained; i++) {
        column[i] = part[(size_t)i * columns + c];
        if (!lg_table_is_far(far, column[i])) chosen[kept++] = i;
    }
    status = lg_table_scaler_fit(self->context, column, 1, chosen, kept, &one);
    free(column);
    if (status != LG_OK) return status;
    scaler->mean[c] = one.mean[0];
    scaler->scale[c] = one.scale[0];
    lg_scaler_destroy(&one);
    return LG_OK;
}

/* Inputs are scaled without cells far from all others, which would leave no difference between the others.
 * Outputs are scaled as they are: the loss has all of them. */
static lg_status fit_inputs(training *state, const app *self) {
    const uint32_t n = state->inputs.count;
    double *part = training_part(state, 0, n);
    uint32_t *chosen = app_alloc(state->trained, sizeof *chosen);
    state->far = app_alloc(n, sizeof *state->far);
    lg_status status =
        lg_table_scaler_fit(self->context, part, n, NULL, state->trained, &state->input_scaler);
    for (uint32_t c = 0; c < n && status == LG_OK; c++)
        status = fit_without_far(state, self, part, c, chosen, &state->input_scaler);
    free(chosen);
    free(part);
    return status;
}

static lg_status fit_outputs(training *state, const app *self) {
    const uint32_t m = state->outputs.count;
    double *part = training_part(state, state->inputs.count, m);
    const lg_status status =
        lg_table_scaler_fit(self->context, part, m, NULL, state->trained, &state->output_scaler);
    free(part);
    return status;
}

/* The columns of a scaler from `first` on, scaled, in the order of the parts. Far cells are learned as MOST
 * deviations at most, whose squares can be summed. */
static double *scaled_rows(const training *state, uint32_t first, const lg_scaler *scaler) {
    static const double MOST = 1e100;
    const size_t rows = state->table.data.rows;
    double *out = app_alloc(rows * scaler->channels, sizeof *out);
    for (size_t i = 0; i < rows; i++) {
        const double *row = table_row(&state->table, state->order[i]) + first;
        for (uint32_t c = 0; c < scaler->channels; c++)
            out[i * scaler->channels + c] =
                fmax(-MOST, fmin((row[c] - scaler->mean[c]) / scaler->scale[c], MOST));
    }
    return out;
}

static lg_status make_samples(training *state, const app *self, lg_error *error) {
    const size_t rows = state->table.data.rows;
    lg_status status = fit_inputs(state, self);
    if (status == LG_OK && is_regression(state)) status = fit_outputs(state, self);
    if (status != LG_OK) return app_error(error, status, "the scaling of the columns");
    state->samples = (lg_table_samples){.count = rows, .training = state->trained};
    state->samples.x = scaled_rows(state, 0, &state->input_scaler);
    if (is_regression(state)) {
        state->samples.y = scaled_rows(state, state->inputs.count, &state->output_scaler);
        return LG_OK;
    }
    state->samples.label = app_alloc(rows, sizeof *state->samples.label);
    for (size_t i = 0; i < rows; i++) state->samples.label[i] = state->table.data.label[state->order[i]];
    return LG_OK;
}

/* Once, whatever the number of fits. */
static void warn_few(training *state, const app *self) {
    enum { LEAST = 10 };
    const size_t inputs = state->inputs.count, least = inputs + 2 > LEAST ? inputs + 2 : LEAST;
    if (state->few_told || state->trained >= least) return;
    state->few_told = true;
    app_warn(
        self,
        "%s: there are too few rows: %zu to learn from, with %zu inputs; at least %zu are wanted; errors "
        "and noise say little",
        state->table.path, state->trained, inputs, least);
}

lg_status split_rows(training *state, const app *self, lg_error *error) {
    const size_t rows = state->table.data.rows;
    const double part = state->run->training.validation;
    size_t held = (size_t)floor(part * (double)rows + 0.5);
    if (part > 0.0 && held == 0) held = 1;
    if (held >= rows) held = rows - 1;
    lg_rng rng;
    lg_rng_seed(&rng, state->run->training.seed, STREAM_SPLIT);
    state->order = app_alloc(rows, sizeof *state->order);
    for (size_t i = 0; i < rows; i++) state->order[i] = (uint32_t)i;
    lg_rng_shuffle(&rng, state->order, rows);
    state->trained = rows - held;
    warn_few(state, self);
    return make_samples(state, self, error);
}
