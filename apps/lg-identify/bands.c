/* Standard deviations of a prediction that follow from the uncertainty of the parameters. */
#include <math.h>
#include <string.h>

#include "lg-identify/identify.h"

enum { SAMPLES = 40 };

/* Draws parameters theta + W x, with x of N(0, 1). */
static void draw(const double *theta, const double *W, size_t n, lg_rng *rng, double *out) {
    memcpy(out, theta, n * sizeof *out);
    for (size_t k = 0; k < n; k++) {
        const double x = lg_rng_normal(rng);
        for (size_t i = 0; i < n; i++) out[i] += W[i * n + k] * x;
    }
}

/* Adds the squared differences of two predictions to `out` (rows, columns of the file). */
static void add_squares(const lg_machine_data *data, const double *q, const double *v, const double *other_q,
                        const double *other_v, double *out) {
    const lg_machine_file *file = &data->file;
    const size_t nq = file->machine.positions, nv = file->machine.velocities;
    double columns[LG_LOG_COLUMNS], other[LG_LOG_COLUMNS];
    for (size_t row = 0; row < data->logs.log.rows; row++) {
        identify_to_columns(file, q + row * nq, v + row * nv, NULL, columns);
        identify_to_columns(file, other_q + row * nq, other_v + row * nv, columns, other);
        for (uint32_t c = 0; c < file->column_count; c++) {
            if (!identify_is_state(&file->columns[c])) continue;
            const double wrapped = identify_column_error(file, c, other, columns);
            out[row * file->column_count + c] += wrapped * wrapped;
        }
    }
}

void identify_bands(const app *self, const identify_given *given, const size_t *start, size_t count,
                    const double *q, const double *v, double *out) {
    const lg_machine *machine = given->model.machine;
    const lg_machine_log *log = &given->data.logs.log;
    const size_t n = machine->parameters, numbers = log->rows * given->data.file.column_count;
    APP_FREE double *theta = app_alloc(n + 1, sizeof *theta);
    APP_FREE double *other_q = app_alloc(log->rows * machine->positions, sizeof *other_q);
    APP_FREE double *other_v = app_alloc(log->rows * machine->velocities, sizeof *other_v);
    lg_learned_machine drawn = given->model;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    drawn.theta = theta;
    memset(out, 0, numbers * sizeof *out);
    for (int i = 0; i < SAMPLES; i++) {
        draw(given->model.theta, given->file.spread, n, &rng, theta);
        identify_run_log(self, &drawn, log, start, count, other_q, other_v);
        add_squares(&given->data, q, v, other_q, other_v, out);
    }
    for (size_t i = 0; i < numbers; i++) out[i] = sqrt(out[i] / SAMPLES);
}
