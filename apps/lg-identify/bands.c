/* How far the uncertainty of the parameters moves a prediction. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-identify/runs.h"

enum { SAMPLES = 40 };

/* theta + W x, x of N(0, 1). */
static void draw(const double *theta, const double *W, size_t n, lg_rng *rng, double *out) {
    memcpy(out, theta, n * sizeof *out);
    for (size_t k = 0; k < n; k++) {
        const double x = lg_rng_normal(rng);
        for (size_t i = 0; i < n; i++) out[i] += W[i * n + k] * x;
    }
}

/* Adds the squares of the differences of two predictions, (rows, columns of the file). */
static void add_squares(const lg_machine_file *file, const lg_machine_log *log, const double *q,
                        const double *v, const double *other_q, const double *other_v, double *out) {
    const lg_machine *machine = &file->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    double columns[LG_LOG_COLUMNS], other[LG_LOG_COLUMNS];
    for (size_t row = 0; row < log->rows; row++) {
        identify_to_columns(file, q + row * nq, v + row * nv, NULL, columns);
        identify_to_columns(file, other_q + row * nq, other_v + row * nv, columns, other);
        for (uint32_t c = 0; c < file->column_count; c++) {
            if (!identify_is_state(&file->columns[c])) continue;
            const double error = other[c] - columns[c];
            const double wrapped = identify_is_wrapped(file, c) ? identify_wrap(error) : error;
            out[row * file->column_count + c] += wrapped * wrapped;
        }
    }
}

lg_status identify_bands(const app *self, const identify_model *model, const double *spread,
                         const lg_machine_file *file, const lg_machine_log *log, const size_t *start,
                         size_t count, bool positions, const double *q, const double *v, double *out,
                         lg_error *error) {
    const lg_machine *machine = model->machine;
    const size_t n = machine->parameters, numbers = log->rows * file->column_count;
    double *theta = app_alloc(n + 1, sizeof *theta),
           *other_q = app_alloc(log->rows * machine->positions, sizeof *other_q),
           *other_v = app_alloc(log->rows * machine->velocities, sizeof *other_v);
    identify_model drawn = *model;
    lg_status status = LG_OK;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    drawn.theta = theta;
    memset(out, 0, numbers * sizeof *out);
    for (int i = 0; i < SAMPLES && status == LG_OK; i++) {
        draw(model->theta, spread, n, &rng, theta);
        status = identify_run_log(self, &drawn, log, start, count, positions, other_q, other_v, error);
        if (status == LG_OK) add_squares(file, log, q, v, other_q, other_v, out);
    }
    for (size_t i = 0; i < numbers; i++) out[i] = sqrt(out[i] / SAMPLES);
    free(theta);
    free(other_q);
    free(other_v);
    return status;
}
