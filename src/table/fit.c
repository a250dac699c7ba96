/* A regression in one call. */
#include "liegrad/table.h"

#include <math.h>
#include <string.h>

#include "core/core.h"

enum { WIDTH = 16 };

void lg_table_fit_options_init(lg_table_fit_options *options) {
    *options = (lg_table_fit_options){.size = sizeof *options, .starts = 3, .seed = 1};
    options->model = (lg_table_options){.task = LG_TABLE_REGRESSION,
                                        .network = LG_NET_MLP,
                                        .activation = LG_TANH,
                                        .hidden_count = 2,
                                        .hidden = {WIDTH, WIDTH}};
    lg_table_evidence_options_init(&options->evidence);
}

/* Everything that the fit owns. `theta` and `decay` are of the present start, `best` is of the best one. */
typedef struct fitting {
    const lg_context *context;
    const lg_table_fit_options *options;
    lg_table model;
    lg_scaler inputs, outputs;
    lg_table_samples samples;
    double *theta, *best;
    lg_table_fit_result result;
} fitting;

/* *out becomes (x - mean)/scale of each column of x (rows, columns). `what` names the columns in messages. */
static lg_status scale(const fitting *f, const double *x, const char *what, size_t rows, uint32_t columns,
                       lg_scaler *scaler, double **out, lg_error *error) {
    for (size_t i = 0; i < rows * columns; i++)
        if (!isfinite(x[i]))
            return lg_fail(
                error, LG_NOT_FINITE,
                "row %zu of the %s, column %zu (both from 0): %g is not a finite number; leave out "
                "rows with missing values",
                i / columns, what, i % columns, x[i]);
    const lg_status status = lg_table_scaler_fit(f->context, x, columns, NULL, rows, scaler);
    if (status != LG_OK)
        return lg_fail(error, status, "the %s of the rows: %s", what, lg_status_sentence(status));
    *out = lg_alloc(f->context, rows * columns, sizeof **out);
    if (*out == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu rows", rows);
    for (size_t i = 0; i < rows * columns; i++)
        (*out)[i] = (x[i] - scaler->mean[i % columns]) / scaler->scale[i % columns];
    return LG_OK;
}

static lg_status prepare(fitting *f, const double *x, const double *y, size_t rows, lg_error *error) {
    if (rows == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "0 rows: at least one is needed");
    f->samples.count = f->samples.training = rows;
    LG_TRY(scale(f, x, "inputs", rows, f->model.net.inputs, &f->inputs, &f->samples.x, error));
    LG_TRY(scale(f, y, "outputs", rows, f->model.net.outputs, &f->outputs, &f->samples.y, error));
    f->theta = lg_alloc(f->context, 2 * lg_table_parameters(&f->model), sizeof *f->theta);
    if (f->theta == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu rows", rows);
    f->best = f->theta + lg_table_parameters(&f->model);
    return LG_OK;
}

/* Fits from start number `start`, and keeps the parameters if their evidence is the highest so far. */
static lg_status try_start(fitting *f, uint32_t start, lg_error *error) {
    const lg_table_problem problem = {.model = &f->model, .samples = &f->samples};
    double decay[LG_TABLE_SLICES];
    lg_table_evidence_result found;
    lg_rng rng;
    lg_rng_seed(&rng, f->options->seed, start);
    lg_table_initialise(&f->model, &rng, f->theta);
    LG_TRY(lg_table_evidence(f->context, &problem, &f->options->evidence, f->theta, decay, &found, error));
    if (start > 0 && !(found.evidence > f->result.evidence.evidence)) return LG_OK;
    f->result = (lg_table_fit_result){.evidence = found, .start = start};
    memcpy(f->best, f->theta, lg_table_parameters(&f->model) * sizeof *f->best);
    return LG_OK;
}

lg_status lg_table_fit(const lg_context *context, const double *x, uint32_t inputs, const double *y,
                       uint32_t outputs, size_t rows, const lg_table_fit_options *options, lg_program **out,
                       lg_table_fit_result *result, lg_error *error) {
    lg_table_fit_options defaults;
    LG_NEEDS(error, x, y, out);
    lg_table_fit_options_init(&defaults);
    fitting f = {.context = context, .options = options != NULL ? options : &defaults};
    if (f.options->size != sizeof *options)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the size of the options is %zu, expected %zu: begin with lg_table_fit_options_init",
                       f.options->size, sizeof *options);
    if (f.options->starts < 1 || f.options->model.task != LG_TABLE_REGRESSION)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s",
                       f.options->starts < 1 ? "0 starts: at least one is needed"
                                             : "lg_table_fit is for regressions only");
    LG_TRY(lg_table_init(&f.model, &f.options->model, inputs, outputs, error));
    lg_status status = prepare(&f, x, y, rows, error);
    for (uint32_t start = 0; start < f.options->starts && status == LG_OK; start++)
        status = try_start(&f, start, error);
    if (status == LG_OK)
        status = lg_table_program(context, &f.model, &f.inputs, &f.outputs, f.best, out, error);
    if (status == LG_OK && result != NULL) *result = f.result;
    lg_scaler_destroy(&f.inputs);
    lg_scaler_destroy(&f.outputs);
    LG_FREE_ALL(context, f.samples.x, f.samples.y, f.theta);
    return status;
}
