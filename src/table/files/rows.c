/* Chooses the rows of a table that are learned or judged, and warns of odd cells. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clean.h"
#include "core/rounding.h"
#include "files/csv.h"
#include "table/files/recipe.h"

static const char *class_column(const lg_table_state *s) {
    return lg_table_is_regression(s) ? NULL : s->class_name;
}

/* ---- reading ---- */

lg_status lg_table_sheet_read(const lg_context *context, const char *path, const lg_table_names *inputs,
                              const lg_table_names *outputs, const char *class_column, lg_table_sheet *out,
                              lg_error *error) {
    const uint32_t count = inputs->count + outputs->count;
    *out = (lg_table_sheet){.path = path, .inputs = inputs->count, .outputs = outputs->count};
    LG_TRY_SCRATCH(const char *, names, context, count, lg_fail(error, LG_OUT_OF_MEMORY, "out of memory"));
    for (uint32_t i = 0; i < count; i++)
        names[i] = i < inputs->count ? inputs->name[i] : outputs->name[i - inputs->count];
    return lg_table_read(context, path, names, count, class_column, NULL, &out->data, error);
}

/* Leaves out rows with missing cells, and warns of them. */
static lg_status leave_incomplete(lg_training *self, lg_table_sheet *sheet, lg_error *error) {
    lg_table_data *data = &sheet->data;
    lg_error why = {LG_OK, ""};
    const lg_status status = lg_table_keep_complete(&data, 1, &sheet->left_out, &why);
    if (status != LG_OK) return lg_fail(error, status, "%s: %s", sheet->path, why.message);
    if (sheet->left_out > 0)
        LG_WARN(self, "%s: %zu of %zu rows have missing cells and are left out", sheet->path, sheet->left_out,
                sheet->left_out + data->rows);
    return LG_OK;
}

/* Finds the class with this label: the same text, or else the only one that is the same number (1 and 1.0).
 * Returns the number of classes if there is none. */
static uint32_t find_class(const lg_table_names *classes, const char *label) {
    uint32_t found = 0, equal = classes->count;
    for (uint32_t c = 0; c < classes->count; c++) {
        if (strcmp(classes->name[c], label) == 0) return c;
        if (!lg_is_decimal(label) || !lg_is_decimal(classes->name[c]) ||
            lg_decimal_compare(classes->name[c], label) != 0)
            continue;
        found++;
        equal = c;
    }
    return found == 1 ? equal : classes->count;
}

/* Replaces labels by indices of the model's classes. */
static lg_status match_classes(lg_training *self, lg_table_sheet *sheet, const lg_table_names *classes,
                               lg_error *error) {
    lg_table_data *data = &sheet->data;
    uint32_t *number;
    LG_TRAINING_ARRAY(self, number, data->classes, error);
    for (uint32_t c = 0; c < data->classes; c++) number[c] = find_class(classes, data->class_name[c]);
    for (size_t i = 0; i < data->rows; i++) {
        const uint32_t label = data->label[i];
        if (number[label] == classes->count)
            return lg_fail(error, LG_FORMAT, "%s: %s %zu: the model does not know class '%s'", sheet->path,
                           data->place, data->line[i], data->class_name[label]);
        data->label[i] = number[label];
    }
    return LG_OK;
}

/* Reads the complete rows of a table on which a model is judged. `outputs`: columns of the outputs or, with a
 * class column, names of the classes. */
static lg_status read_judged(lg_training *self, const char *path, const lg_table_names *inputs,
                             const lg_table_names *outputs, const char *classes, lg_table_sheet *out,
                             lg_error *error) {
    const lg_table_names none = {.count = 0};
    LG_TRY(lg_table_sheet_read(self->context, path, inputs, classes == NULL ? outputs : &none, classes, out,
                               error));
    LG_TRY(leave_incomplete(self, out, error));
    return classes != NULL ? match_classes(self, out, outputs, error) : LG_OK;
}

/* ---- columns that cannot be read ---- */

/* Whether the table can be read with these inputs, the outputs and the classes. Warns of nothing. */
static bool is_readable(const lg_training *self, const lg_table_names *inputs) {
    const lg_table_state *s = self->state;
    lg_table_sheet sheet;
    lg_context *quiet = NULL;
    lg_status status = lg_context_quiet(self->context, &quiet);
    if (status != LG_OK) return false;
    status = lg_table_sheet_read(quiet, self->paths[0], inputs, &s->outputs, class_column(s), &sheet, NULL);
    lg_table_data_destroy(&sheet.data);
    lg_context_destroy(quiet);
    return status == LG_OK;
}

/* If inputs were not named and some of them are not numbers, but all other columns can be read, adds to the
 * message how to leave these inputs out. */
static lg_status fail_columns(lg_training *self, lg_error *error) {
    enum { MOST_SHOWN = 200, MOST_TRIED = 100 /* each try reads the file again */ };
    const lg_table_state *s = self->state;
    const lg_error was = *error;
    const lg_table_names none = {.count = 0};
    lg_text list = {.context = self->context}, word = list;
    if (was.status != LG_FORMAT || s->given.inputs != NULL) return was.status;
    const bool tried = s->inputs.count <= MOST_TRIED && is_readable(self, &none);
    for (uint32_t i = 0; tried && i < s->inputs.count; i++) {
        const lg_table_names one = {.count = 1, .name = s->inputs.name + i};
        bool again = false; /* two columns of one name */
        for (uint32_t k = 0; k < i; k++) again = again || strcmp(s->inputs.name[k], one.name[0]) == 0;
        if (!again && !is_readable(self, &one))
            lg_text_add(&list, "%s%s", list.length > 0 ? "," : "", lg_csv_quote(one.name[0]).text);
    }
    if (list.data != NULL) lg_text_add_word(&word, list.data);
    const char *empty = strstr(was.message, LG_CSV_EMPTY);
    if (word.data != NULL)
        (void)lg_fail(error, was.status, "%.*s; --without %s leaves out columns that cannot be read%s",
                      empty != NULL ? (int)(empty - was.message) : 250, was.message,
                      word.length <= MOST_SHOWN ? word.data : "A,B,...", empty != NULL ? LG_CSV_EMPTY : "");
    lg_text_destroy(&word);
    lg_text_destroy(&list);
    return was.status;
}

/* ---- columns that cannot be learned from ---- */

/* Keeps the columns with keep[c] true. All outputs must be kept. */
static void keep_columns(lg_table_state *s, const bool *keep) {
    lg_table_data *data = &s->table.data;
    uint32_t kept = 0, inputs = 0;
    for (uint32_t c = 0; c < data->columns; c++) kept += keep[c];
    for (size_t i = 0, to = 0; i < data->rows; i++)
        for (uint32_t c = 0; c < data->columns; c++)
            if (keep[c]) data->values[to++] = data->values[i * data->columns + c];
    for (uint32_t c = 0; c < s->inputs.count; c++)
        if (keep[c]) memmove(s->inputs.name[inputs++], s->inputs.name[c], sizeof(lg_table_text));
    data->columns = kept;
    s->inputs.count = s->table.inputs = inputs;
}

/* Warns of a constant column, and of one whose values differ only by rounding. Refuses a column whose values
 * differ by so little (below the smallest normal number) that they cannot be scaled. *keep: not a constant
 * input. */
static lg_status check_column(lg_training *self, uint32_t column, bool *keep, lg_error *error) {
    const lg_table_state *s = self->state;
    const lg_table_data *data = &s->table.data;
    const double *values = data->values + column;
    const bool input = column < s->inputs.count;
    size_t low = 0, high = 0;
    for (size_t i = 1; i < data->rows; i++) {
        if (values[i * data->columns] < values[low * data->columns]) low = i;
        if (values[i * data->columns] > values[high * data->columns]) high = i;
    }
    const double least = values[low * data->columns], largest = values[high * data->columns];
    const lg_csv_quoted name =
        lg_csv_quote(input ? s->inputs.name[column] : s->outputs.name[column - s->inputs.count]);
    *keep = !input || largest > least;
    if (largest == least)
        LG_WARN(self, "%s: column %s is constant: %s", s->table.path, name.text,
                input ? "it carries no information and is left out" : "there is nothing to learn about it");
    else if (lg_is_rounding(0.5 * largest - 0.5 * least, 0.5 * fmax(fabs(least), fabs(largest))))
        LG_WARN(
            self,
            "%s: column %s: its values, near %.17g, differ only in their last digits, which are rounded: the "
            "column is used as a constant; subtract its mean before the table is written",
            s->table.path, name.text, least);
    if (largest == least || largest - least >= DBL_MIN * sqrt(2.0 * (double)data->rows)) return LG_OK;
    return lg_fail(error, LG_FORMAT,
                   "%s: column %s: its values, from %.3g in %s %zu to %.3g in %s %zu, differ by too little "
                   "to be scaled: give the column in a smaller unit",
                   s->table.path, name.text, least, data->place, data->line[low], largest, data->place,
                   data->line[high]);
}

/* ---- cells far from all others ---- */

lg_status lg_table_warn_far(const lg_context *context, const lg_table_sheet *sheet, uint32_t first,
                            const lg_table_text *name, uint32_t count, const char *follows, lg_error *error) {
    enum { MOST_TOLD = 8 };
    const lg_table_data *data = &sheet->data;
    uint32_t told = 0;
    for (uint32_t c = 0; c < count; c++) {
        const double *values = data->values + first + c;
        lg_table_far far;
        const lg_status status = lg_table_find_far(context, values, data->columns, data->rows, &far);
        if (status != LG_OK) return lg_fail(error, status, "%s", lg_status_sentence(status));
        if (far.count == 0 || told++ >= MOST_TOLD) continue;
        lg_log_message(context, LG_LOG_WARNING,
                       "%s: column %s: %zu of %zu cells %s far from all others, the farthest in %s %zu: %.6g "
                       "(the median is %.6g); %s; if a cell is an error, leave it empty",
                       sheet->path, lg_csv_quote(name[c]).text, far.count, data->rows,
                       far.count == 1 ? "lies" : "lie", data->place, data->line[far.farthest],
                       values[far.farthest * data->columns], far.median, follows);
    }
    if (told > MOST_TOLD)
        lg_log_message(context, LG_LOG_WARNING, "%s: %u more columns have cells far from all others",
                       sheet->path, told - MOST_TOLD);
    return LG_OK;
}

/* ---- classes ---- */

/* Makes the classes the names of the outputs. Fails if fewer than two classes have rows. */
static lg_status take_classes(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_table_data *data = &s->table.data;
    uint32_t present = 0;
    uint64_t *members;
    LG_TRAINING_ARRAY(self, members, data->classes, error);
    for (size_t i = 0; i < data->rows; i++) members[data->label[i]]++;
    for (uint32_t c = 0; c < data->classes; c++) present += members[c] > 0;
    if (present < 2)
        return lg_fail(error, LG_FORMAT, "%s: column %s has one class only: there is nothing to tell apart",
                       s->table.path, s->class_name);
    for (uint32_t c = 0; c < data->classes; c++)
        if (members[c] < 2)
            LG_WARN(self, "%s: class '%s' has only %llu %s", s->table.path, data->class_name[c],
                    (unsigned long long)members[c], members[c] == 1 ? "row" : "complete rows");
    s->outputs = (lg_table_names){
        data->classes, lg_alloc(self->context, data->classes, sizeof(lg_table_text)), self->context};
    if (s->outputs.name == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory");
    memcpy(s->outputs.name, data->class_name, data->classes * sizeof *data->class_name);
    return LG_OK;
}

/* ---- tables of the trainer ---- */

/* Reads the complete rows of the table to learn from: inputs, outputs and classes. */
static lg_status read_learned(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    lg_table_sheet *sheet = &s->table;
    if (lg_table_sheet_read(self->context, self->paths[0], &s->inputs, &s->outputs, class_column(s), sheet,
                            error) != LG_OK)
        return fail_columns(self, error);
    LG_TRY(leave_incomplete(self, sheet, error));
    if (sheet->data.rows < 2)
        return lg_fail(error, LG_FORMAT, "%s: has 1 complete row; at least two are needed", sheet->path);
    /* Constant inputs are left out as if they had not been named: they would change the width and priors. */
    bool *keep;
    LG_TRAINING_ARRAY(self, keep, sheet->data.columns, error);
    for (uint32_t c = 0; c < sheet->data.columns; c++) LG_TRY(check_column(self, c, &keep[c], error));
    keep_columns(s, keep);
    if (s->inputs.count == 0)
        return lg_fail(error, LG_FORMAT, "%s: all inputs are constant: there is nothing to learn from",
                       sheet->path);
    LG_TRY(lg_table_warn_far(self->context, sheet, 0, s->inputs.name, s->inputs.count,
                             "the column is scaled without these cells, but the fit has to follow them",
                             error));
    LG_TRY(lg_table_warn_far(self->context, sheet, s->inputs.count, s->outputs.name, sheet->outputs,
                             "the fit follows these cells, and most of its error comes from them", error));
    return lg_table_is_regression(s) ? LG_OK : take_classes(self, error);
}

lg_status lg_table_read_rows(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_table_file *file = self->file;
    if (file != NULL) {
        const lg_net *net = &file->run.model.net;
        const lg_table_names inputs = {net->inputs, file->input_name, NULL},
                             outputs = {net->outputs, file->output_name, NULL};
        const bool classes = file->run.model.options.task == LG_TABLE_CLASSIFICATION;
        return read_judged(self, self->paths[0], &inputs, &outputs, classes ? file->class_column : NULL,
                           &s->table, error);
    }
    LG_TRY(read_learned(self, error));
    if (s->given.test == NULL) return LG_OK;
    self->failed = s->given.test;
    LG_TRY(read_judged(self, s->given.test, &s->inputs, &s->outputs, class_column(s), &s->test, error));
    self->failed = NULL;
    return LG_OK;
}

/* ---- repeated rows ---- */

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

lg_status lg_table_warn_repeated(lg_training *self, lg_error *error) {
    const lg_table_state *s = self->state;
    const lg_table_data *data = &s->table.data;
    size_t repeated = 0, shared = 0, first = 0;
    bool both = false;
    sorted_row *rows;
    LG_TRAINING_ARRAY(self, rows, data->rows, error);
    for (size_t i = 0; i < data->rows; i++) {
        const size_t row = s->order[i];
        rows[i] = (sorted_row){lg_table_sheet_row(&s->table, row), data->columns,
                               data->label != NULL ? data->label[row] : 0, i < s->trained};
    }
    qsort(rows, data->rows, sizeof *rows, compare_sorted);
    for (size_t i = 1; i < data->rows; i++) {
        const bool same = compare_sorted(&rows[i - 1], &rows[i]) == 0;
        repeated += same;
        if (!same) first = i, both = false;
        if (same && !both && rows[i].trained != rows[first].trained) both = true, shared++;
    }
    if (repeated > 0) LG_WARN(self, "%s: %zu rows repeat other rows", s->table.path, repeated);
    if (shared > 0)
        LG_WARN(self,
                "%s: %zu different rows are both in the training and in the validation part: the validation "
                "errors are too small",
                s->table.path, shared);
    return LG_OK;
}
