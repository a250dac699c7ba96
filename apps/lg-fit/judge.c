/* Errors of a model on rows of a table. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "datasets/table_names.h"
#include "lg-fit/fit.h"
#include "liegrad/metrics.h"

/* By so much of its range an input may be beyond it. */
static const double BEYOND = 0.1;
enum { SHOWN_CLASSES = 12 };

static bool is_regression(const lg_table_file *file) {
    return file->run.model.options.task == LG_TABLE_REGRESSION;
}

bool is_outside(const lg_table_file *file, const double *x) {
    for (uint32_t c = 0; file->low != NULL && file->high != NULL && c < file->run.model.net.inputs; c++) {
        const double slack = BEYOND * (file->high[c] - file->low[c]);
        if (x[c] < file->low[c] - slack || x[c] > file->high[c] + slack) return true;
    }
    return false;
}

void softmax(double *y, uint32_t classes) {
    double largest = -INFINITY, sum = 0;
    for (uint32_t c = 0; c < classes; c++) largest = fmax(largest, y[c]);
    for (uint32_t c = 0; c < classes; c++) sum += y[c] = exp(y[c] - largest);
    for (uint32_t c = 0; c < classes; c++) y[c] /= sum;
}

/* sqrt(mean (x - y)^2) of a column of (rows, stride); y moves on by `step`. It overflows only where the
 * result does. NaN where a number is not finite. */
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

static void sum_columns(const lg_table_file *file, judgement *j) {
    const uint32_t outputs = file->run.model.net.outputs;
    j->scaled_rmse = 0;
    for (uint32_t o = 0; o < outputs; o++) {
        const double *truth = j->truth + o, scale = file->outputs.scale[o];
        double mean = 0;
        for (size_t i = 0; i < j->rows; i++) mean += truth[i * outputs] / (double)j->rows;
        const double spread = distance(truth, outputs, &mean, 0, j->rows);
        j->rmse[o] = distance(truth, outputs, j->prediction + o, outputs, j->rows);
        j->r2[o] = spread > 1e-12 * scale ? 1.0 - pow(j->rmse[o] / spread, 2) : (double)NAN;
        j->scaled_rmse = hypot(j->scaled_rmse, j->rmse[o] / scale / sqrt(outputs));
    }
}

static void sum_classes(uint32_t classes, judgement *j) {
    uint64_t right = 0;
    uint32_t seen = 0;
    double sum = 0;
    for (uint32_t c = 0; c < classes; c++) {
        uint64_t told = 0, is = 0;
        for (uint32_t k = 0; k < classes; k++) {
            is += j->confusion[c * classes + k];
            told += j->confusion[k * classes + c];
        }
        const uint64_t hit = j->confusion[c * classes + c];
        right += hit;
        if (is + told == 0 || (classes == 2 && c == 0)) continue;
        sum += 2.0 * (double)hit / (double)(is + told);
        seen++;
    }
    j->accuracy = (double)right / (double)j->rows;
    j->f1 = seen > 0 ? sum / seen : (double)NAN;
}

static void add_class(const lg_table_file *file, const fit_table *table, size_t row, double *y,
                      judgement *j) {
    const uint32_t classes = file->run.model.net.outputs, truth = table->data.label[row];
    softmax(y, classes);
    j->confusion[truth * classes + lg_class_of(y, classes)]++;
    j->log_loss -= log(fmax(y[truth], 1e-300)) / (double)j->rows;
}

/* Arrays for the rows of a judgement that has some. */
static void make_arrays(const lg_table_file *file, judgement *j) {
    const size_t outputs = file->run.model.net.outputs;
    j->rmse = app_alloc(outputs, sizeof *j->rmse);
    j->r2 = app_alloc(outputs, sizeof *j->r2);
    j->confusion = app_alloc(is_regression(file) ? 1 : outputs * outputs, sizeof *j->confusion);
    if (!is_regression(file)) return;
    j->truth = app_alloc(j->rows * outputs, sizeof *j->truth);
    j->prediction = app_alloc(j->rows * outputs, sizeof *j->prediction);
}

static void run_rows(const lg_table_file *file, const lg_model *model, const fit_table *table,
                     const uint32_t *chosen, judgement *j) {
    const uint32_t inputs = file->run.model.net.inputs, outputs = file->run.model.net.outputs;
    APP_FREE void *work = app_alloc(lg_model_work_size(model), 1);
    APP_FREE double *y = app_alloc(outputs, sizeof *y);
    for (size_t i = 0; i < j->rows; i++) {
        const size_t row = chosen != NULL ? chosen[i] : i;
        const double *x = table_row(table, row);
        j->outside += is_outside(file, x);
        lg_model_eval(model, x, y, work);
        j->infinite += !are_finite(y, outputs);
        if (is_regression(file)) {
            memcpy(j->truth + i * outputs, x + inputs, outputs * sizeof *y);
            memcpy(j->prediction + i * outputs, y, outputs * sizeof *y);
        } else {
            add_class(file, table, row, y, j);
        }
    }
}

lg_status table_model(const app *self, const lg_table_file *file, lg_model **out, lg_error *error) {
    lg_program *program;
    const lg_status status = lg_table_program(self->context, &file->run.model, &file->inputs, &file->outputs,
                                              file->theta, &program, error);
    return status == LG_OK ? lg_model_create(self->context, program, NULL, out, error) : status;
}

lg_status judge_rows(const app *self, const lg_table_file *file, const fit_table *table,
                     const uint32_t *chosen, size_t count, judgement *out, lg_error *error) {
    lg_model *model = NULL;
    *out = (judgement){.rows = chosen != NULL ? count : table->data.rows,
                       .accuracy = (double)NAN,
                       .f1 = (double)NAN,
                       .scaled_rmse = (double)NAN};
    if (out->rows == 0) return LG_OK;
    const lg_status status = table_model(self, file, &model, error);
    if (status != LG_OK) return status;
    make_arrays(file, out);
    run_rows(file, model, table, chosen, out);
    if (is_regression(file))
        sum_columns(file, out);
    else
        sum_classes(file->run.model.net.outputs, out);
    lg_model_destroy(model);
    return LG_OK;
}

void judgement_free(judgement *j) {
    free(j->truth);
    free(j->prediction);
    free(j->rmse);
    free(j->r2);
    free(j->confusion);
    *j = (judgement){.rows = 0};
}

static void put_columns(app_json *json, const lg_table_file *file, const char *key, const double *values) {
    app_json_open(json, key, '{');
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++)
        app_json_real(json, file->output_name[o], values != NULL ? values[o] : (double)NAN);
    app_json_close(json, '}');
}

static void put_confusion(app_json *json, const lg_table_file *file, const judgement *j) {
    const uint32_t classes = file->run.model.net.outputs;
    APP_FREE double *row = app_alloc(classes, sizeof *row);
    app_json_open(json, "confusion", '[');
    for (uint32_t c = 0; c < classes && j->confusion != NULL; c++) {
        for (uint32_t k = 0; k < classes; k++) row[k] = (double)j->confusion[c * classes + k];
        app_json_reals(json, NULL, row, classes);
    }
    app_json_close(json, ']');
    app_json_open(json, "classes", '[');
    for (uint32_t c = 0; c < classes; c++) app_json_text(json, NULL, file->output_name[c]);
    app_json_close(json, ']');
}

void judgement_json(app_json *json, const lg_table_file *file, const judgement *j) {
    if (is_regression(file)) {
        put_columns(json, file, "rmse", j->rmse);
        put_columns(json, file, "r2", j->r2);
        app_json_real(json, "scaled_rmse", j->scaled_rmse);
    } else {
        app_json_real(json, "accuracy", j->accuracy);
        app_json_real(json, "f1", j->f1);
        app_json_real(json, "log_loss", j->rows > 0 ? j->log_loss : (double)NAN);
        put_confusion(json, file, j);
    }
    app_json_size(json, "judged_rows", j->rows);
    app_json_size(json, "outside", j->outside);
}

static void print_confusion(const lg_table_file *file, const judgement *j) {
    const uint32_t classes = file->run.model.net.outputs;
    app_table table;
    if (classes > SHOWN_CLASSES) return;
    app_table_begin(&table, classes + 1);
    app_table_cell(&table, "true \\ told");
    for (uint32_t c = 0; c < classes; c++) app_table_cell(&table, "%s", file->output_name[c]);
    for (uint32_t c = 0; c < classes; c++) {
        app_table_cell(&table, "%s", file->output_name[c]);
        for (uint32_t k = 0; k < classes; k++)
            app_table_cell(&table, "%llu", (unsigned long long)j->confusion[c * classes + k]);
    }
    app_table_end(&table, stdout);
}

void judgement_print(const lg_table_file *file, const judgement *j) {
    app_table table = {0};
    if (j->rows == 0) return;
    if (!is_regression(file)) {
        (void)printf("accuracy %.4f, f1 %.4f on %zu rows\n", j->accuracy, j->f1, j->rows);
        print_confusion(file, j);
        return;
    }
    app_table_row(&table, "column\trmse\tr2");
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++) {
        app_table_cell(&table, "%s", file->output_name[o]);
        app_table_cell(&table, isfinite(j->rmse[o]) ? "%.4g" : "-", j->rmse[o]);
        app_table_cell(&table, isfinite(j->r2[o]) ? "%.4f" : "-", j->r2[o]);
    }
    app_table_end(&table, stdout);
}

bool are_finite(const double *y, uint32_t count) {
    bool finite = true;
    for (uint32_t i = 0; i < count; i++) finite = finite && isfinite(y[i]);
    return finite;
}

int warn_infinite(const app *self, size_t infinite, size_t rows, const char *path) {
    if (infinite == 0) return APP_EXIT_OK;
    app_warn(self, "%s: the predictions of %zu of %zu rows are not finite", path, infinite, rows);
    return APP_EXIT_NUMERIC;
}

void warn_far_outputs(const app *self, const lg_table_file *file, const fit_table *table) {
    const column_names names = {table->outputs, file->output_name};
    warn_far(self, table, table->inputs, &names, "most of the error comes from them");
}

int warn_judgement(const app *self, const lg_table_file *file, const judgement *j, const char *path) {
    int code = warn_infinite(self, j->infinite, j->rows, path);
    char quoted[LG_TABLE_QUOTED];
    for (uint32_t o = 0; j->truth != NULL && o < file->run.model.net.outputs && code == APP_EXIT_OK; o++) {
        const char *name = !isfinite(j->rmse[o])                            ? "rmse"
                           : isinf(j->r2[o])                                ? "r2"
                           : !isfinite(j->rmse[o] / file->outputs.scale[o]) ? "scaled_rmse"
                                                                            : NULL;
        if (name == NULL) continue;
        app_warn(self, "%s: column %s: %s is not finite: the differences from the predictions overflow", path,
                 lg_table_quote(file->output_name[o], quoted), name);
        code = APP_EXIT_NUMERIC;
    }
    return code;
}

void warn_outside(const app *self, size_t outside, size_t rows, const char *path, const char *model) {
    if (outside > 0)
        app_warn(self,
                 "%s: %zu of %zu rows lie outside of the training range of %s: expect large errors there",
                 path, outside, rows, model);
}
