/* Errors of a model on the rows of a table. */
#include <math.h>
#include <string.h>

#include "files/csv.h"
#include "liegrad/series.h"
#include "table/files/recipe.h"

/* A row is outside if an input is beyond its training range by more than this part of the range. */
static const double BEYOND = 0.1;

static bool is_regression(const lg_table_file *file) {
    return file->run.model.options.task == LG_TABLE_REGRESSION;
}

bool lg_table_is_outside(const lg_table_file *file, const double *x) {
    for (uint32_t c = 0; file->low != NULL && file->high != NULL && c < file->run.model.net.inputs; c++) {
        const double slack = BEYOND * (file->high[c] - file->low[c]);
        if (x[c] < file->low[c] - slack || x[c] > file->high[c] + slack) return true;
    }
    return false;
}

void lg_table_softmax(double *y, uint32_t classes) {
    double largest = -INFINITY, sum = 0;
    for (uint32_t c = 0; c < classes; c++) largest = fmax(largest, y[c]);
    for (uint32_t c = 0; c < classes; c++) sum += y[c] = exp(y[c] - largest);
    for (uint32_t c = 0; c < classes; c++) y[c] /= sum;
}

/* Root mean square of x - y for one column. x has `stride` numbers per row; y advances by `step` per row (0:
 * y is one number). Overflows only if the result does. NaN if a number is not finite. */
static double distance(const double *x, size_t stride, const double *y, size_t step, size_t rows) {
    double largest = 0, squares = 0;
    for (size_t i = 0; i < rows; i++) largest = fmax(largest, fabs(0.5 * x[i * stride] - 0.5 * y[i * step]));
    if (largest == 0) largest = 1;
    for (size_t i = 0; i < rows; i++) {
        const double part = (0.5 * x[i * stride] - 0.5 * y[i * step]) / largest;
        squares += part * part / (double)rows;
    }
    return 2.0 * (sqrt(squares) * largest);
}

static void sum_columns(const lg_table_file *file, lg_table_judgement *j) {
    const uint32_t outputs = file->run.model.net.outputs;
    j->scaled_rmse = 0;
    for (uint32_t o = 0; o < outputs; o++) {
        const double *truth = j->truth + o, scale = file->outputs.scale[o];
        double mean = 0;
        for (size_t i = 0; i < j->rows; i++)
            mean += (0.5 * truth[i * outputs] - 0.5 * truth[0]) / (double)j->rows;
        mean = 2.0 * (mean + 0.5 * truth[0]);
        const double spread = distance(truth, outputs, &mean, 0, j->rows);
        j->rmse[o] = distance(truth, outputs, j->prediction + o, outputs, j->rows);
        j->r2[o] = spread > 1e-12 * scale ? 1.0 - pow(j->rmse[o] / spread, 2) : (double)NAN;
        j->scaled_rmse = hypot(j->scaled_rmse, j->rmse[o] / scale / sqrt(outputs));
    }
}

static void add_class(const lg_table_file *file, const lg_table_sheet *sheet, size_t row, double *y,
                      lg_table_judgement *j) {
    const uint32_t classes = file->run.model.net.outputs, truth = sheet->data.label[row];
    lg_table_softmax(y, classes);
    j->confusion[truth * classes + lg_metrics_class(y, classes)]++;
    j->log_loss -= log(fmax(y[truth], 1e-300)) / (double)j->rows;
}

/* Allocates the arrays of a judgement; j->rows must be set. */
static lg_status make_arrays(lg_training *self, const lg_table_file *file, lg_table_judgement *j,
                             lg_error *error) {
    const size_t outputs = file->run.model.net.outputs;
    LG_TRAINING_ARRAY(self, j->rmse, outputs, error);
    LG_TRAINING_ARRAY(self, j->r2, outputs, error);
    LG_TRAINING_ARRAY(self, j->confusion, is_regression(file) ? 1 : outputs * outputs, error);
    if (!is_regression(file)) return LG_OK;
    LG_TRAINING_ARRAY(self, j->truth, j->rows * outputs, error);
    LG_TRAINING_ARRAY(self, j->prediction, j->rows * outputs, error);
    return LG_OK;
}

static lg_status run_rows(lg_training *self, const lg_table_file *file, const lg_model *model,
                          const lg_table_sheet *sheet, const uint32_t *chosen, lg_table_judgement *j,
                          lg_error *error) {
    const uint32_t inputs = file->run.model.net.inputs, outputs = file->run.model.net.outputs;
    char *work;
    double *y;
    LG_TRAINING_ARRAY(self, work, lg_model_work_size(model), error);
    LG_TRAINING_ARRAY(self, y, outputs, error);
    for (size_t i = 0; i < j->rows; i++) {
        const size_t row = chosen != NULL ? chosen[i] : i;
        const double *x = lg_table_sheet_row(sheet, row);
        j->outside += lg_table_is_outside(file, x);
        lg_model_eval(model, x, y, work);
        j->infinite += !lg_table_are_finite(y, outputs);
        if (is_regression(file)) {
            memcpy(j->truth + i * outputs, x + inputs, outputs * sizeof *y);
            memcpy(j->prediction + i * outputs, y, outputs * sizeof *y);
        } else {
            add_class(file, sheet, row, y, j);
        }
    }
    return LG_OK;
}

lg_status lg_table_model(const lg_context *context, const lg_table_file *file, lg_model **out,
                         lg_error *error) {
    lg_program *program;
    LG_TRY(lg_table_program(context, &file->run.model, &file->inputs, &file->outputs, file->theta, &program,
                            error));
    return lg_model_create(context, program, NULL, out, error);
}

lg_status lg_table_judge(lg_training *self, const lg_table_file *file, const lg_table_sheet *sheet,
                         const uint32_t *chosen, size_t count, lg_table_judgement *out, lg_error *error) {
    lg_model *model;
    *out = (lg_table_judgement){.rows = chosen != NULL ? count : sheet->data.rows,
                                .accuracy = (double)NAN,
                                .f1 = (double)NAN,
                                .scaled_rmse = (double)NAN};
    LG_TRY(make_arrays(self, file, out, error));
    LG_TRY(lg_table_model(self->context, file, &model, error));
    const lg_status status = run_rows(self, file, model, sheet, chosen, out, error);
    lg_model_destroy(model);
    LG_TRY(status);
    if (is_regression(file)) {
        sum_columns(file, out);
        return LG_OK;
    }
    const lg_metrics of_classes = lg_metrics_of(out->confusion, file->run.model.net.outputs, 0);
    out->accuracy = of_classes.accuracy;
    out->f1 = of_classes.f1;
    return LG_OK;
}

/* ---- results and warnings ---- */

static void tell_columns(lg_training *self, const lg_table_file *file, const char *name,
                         const double *values) {
    lg_result_open(self, name, '{');
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++)
        LG_TELL(self, LG_REAL(file->output_name[o], values[o], NULL));
    lg_result_close(self, '}');
}

void lg_table_tell(lg_training *self, const lg_table_file *file, const lg_table_judgement *j) {
    if (is_regression(file)) {
        tell_columns(self, file, "rmse", j->rmse);
        tell_columns(self, file, "r2", j->r2);
        LG_TELL(self,
                LG_REAL("scaled_rmse", j->scaled_rmse, "over all outputs, in units of their deviations"));
    } else {
        LG_TELL(self, LG_REAL("accuracy", j->accuracy, "share of the rows whose class is right"),
                LG_REAL("f1", j->f1, NULL),
                LG_REAL("log_loss", j->log_loss, "mean of -log of the probability of the true class"),
                LG_AS_CONFUSION("confusion", j->confusion, file->run.model.net.outputs, file->output_name),
                LG_AS_TEXTS("classes", file->output_name, file->run.model.net.outputs));
    }
    LG_TELL(self, LG_WHOLE("judged_rows", j->rows, NULL),
            LG_WHOLE("outside", j->outside, "rows beyond the training range"));
}

bool lg_table_are_finite(const double *y, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        if (!isfinite(y[i])) return false;
    return true;
}

bool lg_table_warn_infinite(const lg_context *context, size_t infinite, size_t rows, const char *path) {
    if (infinite == 0) return false;
    lg_log_message(context, LG_LOG_WARNING, "%s: the predictions of %zu of %zu rows are not finite", path,
                   infinite, rows);
    return true;
}

bool lg_table_warn_errors(const lg_context *context, const lg_table_file *file, const lg_table_judgement *j,
                          const char *path) {
    if (lg_table_warn_infinite(context, j->infinite, j->rows, path)) return true;
    for (uint32_t o = 0; j->truth != NULL && o < file->run.model.net.outputs; o++) {
        const char *name = !isfinite(j->rmse[o])                            ? "rmse"
                           : isinf(j->r2[o])                                ? "r2"
                           : !isfinite(j->rmse[o] / file->outputs.scale[o]) ? "scaled_rmse"
                                                                            : NULL;
        if (name == NULL) continue;
        lg_log_message(context, LG_LOG_WARNING,
                       "%s: column %s: %s is not finite: the differences from the predictions overflow", path,
                       lg_csv_quote(file->output_name[o]).text, name);
        return true;
    }
    return false;
}

void lg_table_warn_outside(const lg_context *context, size_t outside, size_t rows, const char *path,
                           const char *model) {
    if (outside > 0)
        lg_log_message(context, LG_LOG_WARNING,
                       "%s: %zu of %zu rows lie outside of the training range of %s: expect large errors "
                       "there",
                       path, outside, rows, model);
}
