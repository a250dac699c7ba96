/* States in the columns of a log, and their distance from the range of the training data. */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "lg-identify/identify.h"

bool identify_is_state(const lg_log_column *column) {
    return column->role == LG_LOG_POSITION || column->role == LG_LOG_VELOCITY;
}

/* ---- attitudes ---- */

/* The quaternion (w, x, y, z) of R. Its largest component is computed first, which avoids cancellation. */
static void quaternion_of(const double *R, double out[4]) {
    const double trace = R[0] + R[4] + R[8];
    const double squares[4] = {1 + trace, 1 + 2 * R[0] - trace, 1 + 2 * R[4] - trace, 1 + 2 * R[8] - trace};
    const double odd[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]};
    const double even[3][3] = {
        {0, R[1] + R[3], R[2] + R[6]}, {R[1] + R[3], 0, R[5] + R[7]}, {R[2] + R[6], R[5] + R[7], 0}};
    int most = 0;
    for (int i = 1; i < 4; i++)
        if (squares[i] > squares[most]) most = i;
    const double twice = sqrt(squares[most]);
    out[most] = twice / 2;
    for (int i = 0; i < 4; i++) {
        if (i == most) continue;
        out[i] = (most == 0 ? odd[i - 1] : i == 0 ? odd[most - 1] : even[most - 1][i - 1]) / (2 * twice);
    }
}

static void put_attitude(const lg_log_coordinate *at, const double *position, const double *before,
                         double *columns) {
    double *to = columns + at->attitude;
    if (at->attitudes != 4) {
        memcpy(to, position, at->attitudes * sizeof *to);
        return;
    }
    double dot = 0, x[4];
    quaternion_of(position, x);
    for (int i = 0; before != NULL && i < 4; i++) dot += x[i] * before[at->attitude + (uint32_t)i];
    for (int i = 0; i < 4; i++) to[i] = dot < 0 ? -x[i] : x[i];
}

void identify_to_columns(const lg_machine_file *file, const double *q, const double *v, const double *before,
                         double *columns) {
    for (lg_machine_offsets of = {0}; lg_machine_next(&file->machine, &of);) {
        const lg_log_coordinate *at = &file->coordinates[of.index];
        memcpy(columns + at->place, q, at->places * sizeof *columns);
        if (at->attitudes > 0) put_attitude(at, q + at->places, before, columns);
        if (at->velocities > 0) memcpy(columns + at->velocity, v, at->velocities * sizeof *columns);
        if (at->velocities > 0 && at->space_frame) lg_so3_adjoint(q + at->places, v, columns + at->velocity);
        q += of.positions, v += of.velocities;
    }
}

/* ---- runs as a log ---- */

/* run: NULL: it is a number. False: a state is not finite. */
static bool put_row(lg_columns *to, const lg_machine_file *file, const double *columns, const char *run,
                    const double *bands) {
    bool finite = true;
    for (uint32_t c = 0; c < file->column_count; c++) {
        finite = finite && (isfinite(columns[c]) || !identify_is_state(&file->columns[c]));
        if (c == file->run && run != NULL)
            lg_columns_text(to, run);
        else
            lg_columns_number(to, c == file->run ? columns[c] : columns[c] / file->columns[c].scale);
    }
    for (uint32_t c = 0; c < file->column_count && bands != NULL; c++)
        if (identify_is_state(&file->columns[c]))
            lg_columns_number(to, bands[c] / fabs(file->columns[c].scale));
    lg_columns_end(to);
    return finite;
}

bool identify_write(const app *self, const char *path, const lg_machine_file *file, const lg_machine_log *log,
                    const lg_logs *logs, const identify_runs *runs,
                    double (*input)(const void *user, size_t part, size_t row, uint32_t input),
                    const void *user, size_t *rows) {
    lg_columns to = {.text = app_text()};
    double columns[LG_LOG_COLUMNS] = {0};
    bool finite = true;
    *rows = 0;
    for (uint32_t c = 0; c < file->column_count; c++) lg_columns_name(&to, file->columns[c].name);
    for (uint32_t c = 0; c < file->column_count && runs->bands != NULL; c++) {
        APP_FREE char *name = app_format("%s.sd", file->columns[c].name);
        if (identify_is_state(&file->columns[c])) lg_columns_name(&to, name);
    }
    lg_columns_end(&to);
    for (size_t i = 0; i < runs->count; i++) {
        const size_t first = runs->start[i], part = lg_machine_log_part(log, first);
        const char *name = logs != NULL ? logs->run_names : NULL;
        for (uint32_t k = logs != NULL ? logs->part_run[part] : 0; k > 0; k--) name += strlen(name) + 1;
        for (size_t row = first; row < log->first[part + 1]; row++, ++*rows) {
            identify_to_columns(file, runs->q + row * file->machine.positions,
                                runs->v + row * file->machine.velocities, row > first ? columns : NULL,
                                columns);
            columns[file->time] = log->t[row];
            if (file->run < file->column_count) columns[file->run] = (double)part;
            for (uint32_t c = 0; c < file->column_count; c++)
                if (file->columns[c].role == LG_LOG_INPUT)
                    columns[c] = input(user, part, row, file->columns[c].index);
            if (!put_row(&to, file, columns, name,
                         runs->bands != NULL ? runs->bands + row * file->column_count : NULL))
                finite = false;
        }
    }
    APP_MUST_FILE(self, path, lg_columns_write(&to, self->context, path, &error));
    return finite;
}

/* ---- errors ---- */

void identify_errors(const lg_machine_file *file, const double *q, const double *v, const double *logged_q,
                     const double *logged_v, double *out) {
    double logged[LG_LOG_COLUMNS], predicted[LG_LOG_COLUMNS];
    identify_to_columns(file, logged_q, logged_v, NULL, logged);
    identify_to_columns(file, q, v, logged, predicted);
    for (uint32_t c = 0; c < file->column_count; c++) {
        const bool given = identify_is_state(&file->columns[c]) && !isnan(logged[c]);
        const lg_log_column *column = &file->columns[c];
        const bool angle = column->role == LG_LOG_POSITION &&
                           file->machine.coordinates[column->index].kind == LG_COORDINATE_ANGLE;
        const double error = given ? predicted[c] - logged[c] : NAN;
        out[c] = given && !isfinite(error) ? INFINITY : given && angle ? lg_machine_wrap(error) : error;
    }
}

void identify_column_errors(const identify_given *given, const identify_runs *runs, double *out) {
    const lg_machine_file *file = &given->data.file;
    const lg_machine_log *log = given->log;
    const double *q = runs->q, *v = runs->v;
    const size_t nq = file->machine.positions, nv = file->machine.velocities;
    double error[LG_LOG_COLUMNS];
    lg_squares squares[LG_LOG_COLUMNS] = {{0, 0}};
    for (size_t row = 0; row < log->rows; row++) {
        if (isnan(q[row * nq]) && isnan(v[row * nv])) continue;
        identify_errors(file, q + row * nq, v + row * nv, log->q + row * nq, lg_log_shown(log) + row * nv,
                        error);
        for (uint32_t c = 0; c < file->column_count; c++) lg_squares_add(&squares[c], error[c]);
    }
    for (uint32_t c = 0; c < file->column_count; c++) out[c] = lg_squares_root(&squares[c]);
}

void identify_put_errors(app_json *out, const lg_machine_file *file, const double *errors,
                         const char *label) {
    app_json_open(out, "free_run", '{');
    for (uint32_t c = 0; c < file->column_count; c++)
        if (identify_is_state(&file->columns[c]))
            app_result_real(out, file->columns[c].name, errors[c], label);
    app_json_close(out, '}');
}

/* ---- range of the training data ---- */

/* The range of one position, velocity or input. angle: it is an angle. used: the model depends on it. beyond:
 * the distance of the value `at` from the range. */
typedef struct number {
    char name[LG_LOG_NAME + 32];
    bool angle, used;
    double beyond, at;
} number;

static void name_numbers(const lg_machine_file *file, number *out) {
    const lg_machine *machine = &file->machine;
    number *position = out, *velocity = out + machine->positions, *input = velocity + machine->velocities;
    for (lg_machine_offsets of = {0}; lg_machine_next(machine, &of);) {
        const lg_machine_coordinate *c = &machine->coordinates[of.index];
        const lg_log_coordinate *at = &file->coordinates[of.index];
        for (uint32_t k = 0; k < of.positions; k++, position++) {
            const bool measured = at->places + at->attitudes > 0;
            const bool same = measured && (k < at->places || at->attitudes != 4);
            const uint32_t column = k < at->places ? at->place + k : at->attitude + k - at->places;
            position->used = lg_machine_sees(machine, LG_MACHINE_PART_COUNT, of.index);
            position->angle = of.angle;
            if (same)
                (void)snprintf(position->name, sizeof position->name, "column %s",
                               file->columns[column].name);
            else if (!measured)
                (void)snprintf(position->name, sizeof position->name, "position of %s", c->name);
            else
                (void)snprintf(position->name, sizeof position->name, "R%u%u of %s", (k - at->places) / 3 + 1,
                               (k - at->places) % 3 + 1, c->name);
        }
        for (uint32_t k = 0; k < of.velocities; k++, velocity++) {
            velocity->used = true;
            if (at->velocities > 0)
                (void)snprintf(velocity->name, sizeof velocity->name, "column %s",
                               file->columns[at->velocity + k].name);
            else
                (void)snprintf(velocity->name, sizeof velocity->name, "velocity %u of %s", k + 1, c->name);
        }
    }
    for (uint32_t k = 0; k < machine->input_count; k++, input++) {
        input->used = true;
        (void)snprintf(input->name, sizeof input->name, "column %s", machine->inputs[k]);
    }
}

/* Returns how far x is outside the range. An angle is first turned by full turns towards the range. */
static double outside(double x, double low, double high, bool angle) {
    const double turn = 6.283185307179586;
    if (angle && high - low >= 0.97 * turn) return 0;
    if (angle) x -= turn * round((x - 0.5 * (low + high)) / turn);
    return x < low ? low - x : x > high ? x - high : 0;
}

/* Records a value of number i if it is farther outside the range than the values before it. */
static void look(const lg_machine_range *range, size_t i, double value, number *out) {
    if (!out->used || !isfinite(value) || !(range->low[i] <= range->high[i])) return;
    const double by = outside(value, range->low[i], range->high[i], out->angle);
    if (by > out->beyond) out->beyond = by, out->at = value;
}

void identify_warn_range(const app *self, const identify_given *given, const identify_runs *runs) {
    static const double tolerated = 0.02; /* Relative to the range; covers the noise of a log. */
    const lg_machine_range *range = &given->file.run.range;
    const lg_machine *machine = &given->data.file.machine;
    const lg_machine_log *log = given->log;
    const size_t nq = machine->positions, nv = machine->velocities, total = nq + nv + machine->input_count;
    APP_FREE number *numbers = app_alloc(total, sizeof *numbers);
    name_numbers(&given->data.file, numbers);
    for (size_t i = 0; i < total; i++) {
        if (machine->accelerations && i < nq + nv) continue; /* neither has the states */
        for (size_t row = 0; row < log->rows; row++) {
            look(range, i, lg_log_number(machine, log, row, i), &numbers[i]);
            if (runs != NULL && i < nq + nv)
                look(range, i, i < nq ? runs->q[row * nq + i] : runs->v[row * nv + i - nq], &numbers[i]);
        }
    }
    for (size_t i = 0; i < total; i++) {
        const double low = range->low[i], high = range->high[i], beyond = numbers[i].beyond;
        if (beyond > 0 && beyond > tolerated * (high - low))
            app_warn(self, "%s goes to %.4g, which is %.3g outside the training data (%.4g to %.4g)",
                     numbers[i].name, numbers[i].at, beyond, low, high);
    }
}
