/* Energy balance along logs, whiteness of residuals, and values of a model's terms at given states. */
#include <math.h>
#include <string.h>

#include "lg-identify/identify.h"

/* ---- the model's terms at given states ---- */

/* DAMPING: index in `powered`, whose order is that of ENERGY_INPUTS and the next ones. */
enum { CHUNK = 512, DAMPING = 1, POWERS = 4 };
static const lg_machine_part powered[POWERS] = {LG_MACHINE_INPUT_MAP, LG_MACHINE_DAMPING, LG_MACHINE_RESIDUAL,
                                                LG_MACHINE_OFFSET};

/* Records energy (B, 1), powers (B, POWERS) and the damping's force (B, velocities) at positions, velocities
 * and inputs, all in the units of the log. */
static lg_status record(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_machine *machine = user;
    const lg_machine_scales *s = &machine->scales;
    const uint32_t nq = machine->positions, nv = machine->velocities, m = machine->input_count;
    double place[LG_MACHINE_POSITIONS], speed[LG_MACHINE_VELOCITIES], force[LG_MACHINE_VELOCITIES];
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS], power[POWERS];
    for (uint32_t k = 0; k < nq; k++) place[k] = 1;
    for (uint32_t k = 0; k < nv; k++) speed[k] = 1, force[k] = s->energy / s->velocity[k];
    lg_machine_unscale_row(machine, place, speed);
    LG_TRY(lg_machine_bind(t, machine, machine->parameters > 0 ? theta[0] : LG_NONE, &vars));
    const lg_var q = lg_div(t, in[0], lg_input_f64(t, lg_shape2(1, nq), place)),
                 v = lg_div(t, in[1], lg_input_f64(t, lg_shape2(1, nv), speed)),
                 u = m > 0 ? lg_div(t, in[2], lg_input_f64(t, lg_shape2(1, m), s->input)) : LG_NONE;
    LG_TRY(lg_machine_record_state(t, &vars, q, v, parts));
    const lg_var rates = lg_machine_record_rates(t, &vars, parts);
    out[0] = lg_scale(t, lg_machine_record_energy(t, &vars, parts), s->energy);
    out[2] = lg_scale(t, rates, 0);
    for (int k = 0; k < POWERS; k++) {
        const lg_var f = lg_machine_record_force(t, &vars, powered[k], parts, rates, u);
        const bool none = lg_is_none(f);
        power[k] = lg_scale(t, lg_sum_axis(t, lg_mul(t, none ? rates : f, rates), 1, true),
                            none ? 0 : s->energy / s->time);
        if (k == DAMPING && !none) out[2] = lg_mul(t, f, lg_input_f64(t, lg_shape2(1, nv), force));
    }
    out[1] = lg_concat(t, power, POWERS, 1);
    return lg_tape_status(t);
}

/* Computes the terms at `count` states in the layout of logs; u (count, inputs). Outputs may be NULL. */
static void ask(const app *self, const lg_learned_machine *model, size_t count, const double *q,
                const double *v, const double *u, double *energy, double *power, double *damping) {
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, m = machine->input_count;
    const lg_port in[] = {{.name = "q", .shape = lg_shape1((uint32_t)nq)},
                          {.name = "v", .shape = lg_shape1((uint32_t)nv)},
                          {.name = "u", .shape = lg_shape1((uint32_t)m)}},
                  out[] = {{.name = "energy"}, {.name = "power"}, {.name = "damping"}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)machine->parameters), model->theta};
    const lg_function_spec terms = {
        "terms", in, m > 0 ? 3 : 2, out, LG_COUNT(out), record, (void *)(uintptr_t)machine};
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.parameters = &weights, spec.parameter_count = machine->parameters > 0;
    spec.functions = &terms, spec.function_count = 1;
    APP_DO(self, lg_program_build, &spec, &program);
    for (size_t i = 0; i < count; i += CHUNK) {
        const double *const from[] = {q + i * nq, v + i * nv, u + i * m};
        double *const to[] = {energy != NULL ? energy + i : NULL, power != NULL ? power + i * POWERS : NULL,
                              damping != NULL ? damping + i * nv : NULL};
        APP_DO(self, lg_program_eval, program, "terms", count - i < CHUNK ? count - i : CHUNK, from, to);
    }
    lg_program_destroy(program);
}

void identify_values(const app *self, const lg_learned_machine *model, size_t count, const double *q,
                     const double *v, double *potential, double *damping) {
    const lg_machine *machine = model->machine;
    APP_FREE double *zeros = app_alloc(count * (machine->velocities + machine->input_count), sizeof *zeros);
    if (potential != NULL) ask(self, model, count, q, zeros, zeros, potential, NULL, NULL);
    if (damping != NULL) ask(self, model, count, q, v, zeros, NULL, NULL, damping);
}

/* ---- intervals ---- */

typedef struct intervals {
    size_t count, *row; /* Rows of the log at which the intervals begin. */
    /* A copy of the log with a further row in the middle of each interval, which has the mean of the
     * velocities at its ends (bristles follow them): row 2 r of the copy is row r. */
    identify_log finer;
    /* The model's run of each interval: (3 count, positions) and (3 count, velocities). */
    double *run_q, *run_v;
} intervals;

/* Rewrites the polynomial u_0 + s u_1 + ... of an interval for the half of it that begins at s = `from`. */
static void halve(const double *u, size_t m, double from, double *out) {
    for (size_t k = 0; k < m; k++) {
        const double a = u[k], b = u[m + k], c = u[2 * m + k], d = u[3 * m + k];
        out[k] = a + from * (b + from * (c + from * d));
        out[m + k] = (b + from * (2 * c + 3 * from * d)) / 2;
        out[2 * m + k] = (c + 3 * from * d) / 4;
        out[3 * m + k] = d / 8;
    }
}

static void cut(const lg_machine *machine, const lg_machine_log *log, intervals *all) {
    const size_t nq = machine->positions, nv = machine->velocities, m = machine->input_count;
    all->row = app_keep(log->rows, sizeof *all->row);
    all->count = lg_log_starts(machine, log, 0, 1, 1, true, all->row);
    identify_log_begin(&all->finer, machine, log->parts, 2 * log->rows);
    const identify_log *to = &all->finer;
    for (size_t p = 0; p < log->parts; p++) {
        to->first[p + 1] = 2 * log->first[p + 1];
        for (size_t row = log->first[p]; row < log->first[p + 1]; row++) {
            const bool last = row + 1 == log->first[p + 1];
            for (size_t k = 0; k < 2; k++) {
                const size_t at = 2 * row + k;
                to->t[at] = log->t[row] + 0.5 * (double)k * (last ? 1 : log->t[row + 1] - log->t[row]);
                memcpy(to->q + at * nq, log->q + row * nq, nq * sizeof *to->q);
                const double *v = log->v + row * nv, *ahead = k == 0 || last ? v : v + nv;
                for (size_t i = 0; i < nv; i++) to->v[at * nv + i] = 0.5 * v[i] + 0.5 * ahead[i];
                if (m > 0) halve(log->u + row * 4 * m, m, 0.5 * (double)k, to->u + at * 4 * m);
            }
        }
    }
}

/* ---- energy ---- */

static void add_interval(const double *energy, const double *power, double h, double *out) {
    const double change = energy[2] - energy[0];
    double left = change;
    for (int k = 0; k < POWERS; k++) {
        /* Simpson's rule. */
        const double work = h / 6 * (power[k] + 4 * power[POWERS + k] + power[2 * POWERS + k]);
        out[ENERGY_INPUTS + k] += work;
        left -= work;
    }
    out[ENERGY_CHANGE] += change;
    out[ENERGY_LEFT] += left;
    out[ENERGY_LEFT_SIZE] += fabs(left);
    out[ENERGY_CHANGE_SIZE] += fabs(change);
}

/* Takes energies at the logged states, and powers at the logged ends and at the middle of the model's run of
 * each interval, with lagged inputs where they lag; the logged states replace the ends of the runs. */
static void balance(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                    const intervals *all, double *out) {
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, m = machine->input_count,
                 n = machine->lags, points = 3 * all->count;
    APP_FREE size_t *at = app_alloc(points, sizeof *at);
    APP_FREE double *x = app_alloc(points * n, sizeof *x);
    APP_FREE double *u = app_alloc(points * m + 1, sizeof *u);
    APP_FREE double *energy = app_alloc(points, sizeof *energy);
    APP_FREE double *power = app_alloc(points * POWERS, sizeof *power);
    for (size_t i = 0; i < all->count; i++) {
        const size_t row = all->row[i];
        const double *begin = all->finer.u + 2 * row * 4 * m, *middle = begin + 4 * m;
        for (size_t k = 0; k < m; k++) {
            u[3 * i * m + k] = begin[k];
            u[(3 * i + 1) * m + k] = middle[k];
            u[(3 * i + 2) * m + k] = middle[k] + middle[m + k] + middle[2 * m + k] + middle[3 * m + k];
        }
        for (size_t k = 0; k < 2; k++) {
            memcpy(all->run_q + (3 * i + 2 * k) * nq, log->q + (row + k) * nq, nq * sizeof *log->q);
            memcpy(all->run_v + (3 * i + 2 * k) * nv, log->v + (row + k) * nv, nv * sizeof *log->v);
        }
    }
    for (size_t i = 0; i < points; i++) at[i] = 2 * all->row[i / 3] + i % 3;
    if (n > 0 && points > 0)
        APP_DO(self, lg_machine_lagged_inputs, machine, model->theta, &all->finer.log, at, points, x);
    for (size_t i = 0; i < points; i++)
        for (size_t k = 0; k < n; k++) u[i * m + machine->lagged[k]] = x[i * n + k];
    ask(self, model, points, all->run_q, all->run_v, u, energy, power, NULL);
    for (size_t i = 0; i < all->count; i++)
        add_interval(energy + 3 * i, power + 3 * i * POWERS, log->t[all->row[i] + 1] - log->t[all->row[i]],
                     out);
}

/* ---- whiteness ---- */

enum { LAGS = 10 };

/* Tests the residuals x (n) of the intervals that begin at the rows `row`. Two residuals are correlated at a
 * lag only if their rows differ by exactly this lag. */
static void judge_whiteness(const double *x, const size_t *row, size_t n, identify_whiteness *out) {
    double mean = 0, square = 0, variance = 0;
    *out = (identify_whiteness){NAN, NAN, NAN, NAN};
    for (size_t i = 0; i < n; i++) mean += x[i] / (double)n, square += x[i] * x[i] / (double)n;
    for (size_t i = 0; i < n; i++) variance += (x[i] - mean) * (x[i] - mean) / (double)n;
    if (n < 4 * LAGS || !(variance > 0)) return;
    double statistic = 0;
    for (size_t lag = 1; lag <= LAGS; lag++) {
        double sum = 0;
        for (size_t i = lag; i < n; i++)
            if (row[i] - row[i - lag] == lag) sum += (x[i] - mean) * (x[i - lag] - mean);
        const double r = sum / ((double)n * variance);
        if (lag == 1) out->lag1 = r;
        statistic += r * r / (double)(n - lag);
    }
    out->rms = sqrt(square);
    out->ljung_box = (double)n * ((double)n + 2) * statistic;
    /* P(chi^2 with LAGS degrees of freedom > the statistic), LAGS even */
    double term = 1, terms = 1;
    for (int k = 1; k < LAGS / 2; k++) {
        term *= 0.5 * out->ljung_box / k;
        terms += term;
    }
    out->probability = exp(-0.5 * out->ljung_box) * terms;
}

/* Tests the predictions of `count` rows: q and v at the places at[i] against the log at row[i] + 1. */
static void whiteness_of(const lg_machine_data *data, const size_t *row, const size_t *at, size_t count,
                         const double *q, const double *v, identify_whiteness *out) {
    const lg_machine_file *file = &data->file;
    const lg_machine_log *log = &data->logs.log;
    const size_t nq = file->machine.positions, nv = file->machine.velocities;
    APP_FREE double *x = app_alloc(count * file->column_count + 1, sizeof *x);
    double error[LG_LOG_COLUMNS];
    for (size_t i = 0; i < count; i++) {
        identify_errors(file, q + at[i] * nq, v + at[i] * nv, log->q + (row[i] + 1) * nq,
                        lg_log_shown(log) + (row[i] + 1) * nv, error);
        for (uint32_t c = 0; c < file->column_count; c++) x[c * count + i] = error[c];
    }
    for (uint32_t c = 0; c < file->column_count; c++) judge_whiteness(x + c * count, row, count, &out[c]);
}

void identify_run_whiteness(const identify_given *given, const identify_runs *runs, identify_whiteness *out) {
    const lg_machine_log *log = given->log;
    APP_FREE size_t *row = app_alloc(log->rows, sizeof *row);
    APP_FREE size_t *at = app_alloc(log->rows, sizeof *at);
    size_t count = 0;
    for (size_t i = 1; i < log->rows; i++)
        if (isfinite(runs->q[i * given->model.machine->positions]) &&
            lg_machine_log_complete(given->model.machine, log, i, true))
            row[count] = i - 1, at[count++] = i;
    whiteness_of(&given->data, row, at, count, runs->q, runs->v, out);
}

void identify_balance(const app *self, const identify_given *given, double energy[IDENTIFY_ENERGIES],
                      identify_whiteness *whiteness) {
    enum { MOST = 8192 };
    const lg_machine *machine = given->model.machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    const lg_machine_log *log = given->log;
    intervals all = {.count = 0};
    cut(machine, log, &all);
    const size_t count = all.count;
    APP_FREE size_t *start = app_alloc(count, sizeof *start);
    APP_FREE size_t *end = app_alloc(count, sizeof *end);
    all.run_q = app_keep(3 * count * nq, sizeof *all.run_q);
    all.run_v = app_keep(3 * count * nv, sizeof *all.run_v);
    for (size_t i = 0; i < count; i++) start[i] = 2 * all.row[i], end[i] = 3 * i + 2;
    for (int k = 0; k < IDENTIFY_ENERGIES; k++) energy[k] = count > 0 ? 0 : NAN;
    for (size_t first = 0; first < count; first += MOST)
        identify_run(self, &given->model, &all.finer.log, start + first,
                     count - first < MOST ? count - first : MOST, 2, all.run_q + 3 * first * nq,
                     all.run_v + 3 * first * nv);
    whiteness_of(&given->data, all.row, end, all.count, all.run_q, all.run_v, whiteness);
    balance(self, &given->model, log, &all, energy);
}
