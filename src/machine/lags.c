/* Machines: lags of inputs, tau x' = u - x, in closed form over the intervals of a log.
 *
 * For u = sum_j u_j s^j on an interval of length h and z = s h/tau:
 *   x(s) = E x(0) + sum_j g_j(z) u_j s^j,  E = e^-z,  g_j = j! z phi_{j+1}(-z) = 1 - (j/z) g_{j-1},
 * where phi_k are those of exponential integrators. z g_j' = j (g_{j-1} - g_j), z g_0' = z E, and log tau
 * changes z by -z. For small z: g_j = E sum_k z^(k+1)/(k! (k+j+1)), whose terms are positive.
 *
 * Of two equal lags in series the second one is y = x + dx/dlog tau, because 1/(1 + r)^2 = (1 + r d/dr)
 * 1/(1 + r): y(s) = E y(0) + E' x(0) + sum_j (g_j + g_j') u_j s^j, where ' is the derivative by log tau. */
#include <math.h>
#include <pthread.h>
#include <string.h>

#include "machine/internal.h"

/* ---- one interval ---- */

static double series(double z, int j) {
    double power = z, sum = 0.0;
    for (int k = 0; k < 60; k++) {
        const double term = power / (k + j + 1);
        sum += term;
        if (term < 1e-17 * sum) break;
        power *= z / (k + 1);
    }
    return sum * exp(-z);
}

void lg_lag_weights_at(double z, lg_lag_weights *out) {
    static const double small = 2.0;
    const double E = exp(-z);
    *out = (lg_lag_weights){.E = {E, z * E, (z * z - z) * E, ((z - 3.0) * z + 1.0) * z * E}};
    double *before = out->g[0];
    before[0] = -expm1(-z);
    for (int d = 1; d < 4; d++) before[d] = -out->E[d];
    for (int j = 1; j < 4; j++) {
        double *g = out->g[j];
        g[0] = z < small ? series(z, j) : 1.0 - j / z * before[0];
        for (int d = 1; d < 4; d++) g[d] = -j * (before[d - 1] - g[d - 1]);
        before = g;
    }
}

/* Adds E from, and its derivatives, to x. */
static void add_decayed(const double *E, const double *from, double *x) {
    x[0] += E[0] * from[0];
    x[1] += E[0] * from[1] + E[1] * from[0];
    x[2] += E[0] * from[2] + 2.0 * E[1] * from[1] + E[2] * from[0];
}

void lg_lag_move(const lg_lag_weights *w, uint32_t order, double s, const double *u, size_t stride,
                 const double *from, double *out) {
    double x[6] = {0}, power = 1.0;
    add_decayed(w->E, from, x);
    if (order == 2) add_decayed(w->E + 1, from, x + 3);
    if (order == 2) add_decayed(w->E, from + 3, x + 3);
    for (int j = 0; j < 4; j++, power *= s) {
        const double c = u[(size_t)j * stride] * power;
        for (int d = 0; d < 3 && c != 0.0; d++) {
            x[d] += w->g[j][d] * c;
            x[3 + d] += (w->g[j][d] + w->g[j][d + 1]) * c;
        }
    }
    memcpy(out, x, (size_t)3 * order * sizeof *x);
}

/* ---- starts of parts ---- */

/* Whether no velocity of the part's first row is above 1/50 of its largest in the part. */
static bool begins_at_rest(const lg_machine *machine, const lg_machine_log *log, size_t part) {
    static const double still = 0.02;
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES], first[LG_MACHINE_VELOCITIES],
        most[LG_MACHINE_VELOCITIES] = {0};
    bool rest = true;
    for (size_t row = log->first[part]; row < log->first[part + 1]; row++) {
        double *out = row == log->first[part] ? first : v;
        lg_machine_scaled_rows(machine, log, &row, 1, q, out);
        for (uint32_t k = 0; k < machine->velocities; k++) most[k] = fmax(most[k], fabs(out[k]));
    }
    for (uint32_t k = 0; k < machine->velocities; k++) rest = rest && fabs(first[k]) <= still * most[k];
    return rest;
}

/* Writes the lagged inputs (lags) at the start of a part. */
static void start_at(const lg_machine *machine, const lg_machine_log *log, size_t part, double *out) {
    const bool rest = log->lag == NULL && begins_at_rest(machine, log, part);
    for (uint32_t k = 0; k < machine->lags; k++)
        out[k] = log->lag != NULL ? log->lag[part * machine->lags + k]
                 : rest           ? log->u[log->first[part] * 4 * machine->input_count + machine->lagged[k]]
                                  : 0.0;
}

/* The states (order, 3) of an input at the start of a part, whose lagged inputs are `start` (order). */
static void begin(const double *start, uint32_t order, double *x) {
    for (uint32_t k = 0; k < order; k++) x[3 * k] = start[k], x[3 * k + 1] = x[3 * k + 2] = 0.0;
}

/* ---- the recursion from row to row ---- */

typedef struct filter {
    const lg_machine_log *log;
    uint32_t m, input, order;
    double tau, h; /* h: the interval of `weights`; 0: none yet */
    lg_lag_weights weights;
} filter;

static void advance(filter *f, size_t row, const double *from, double *out) {
    static const double rounding = 1e-9; /* as of intervals that count as equal, in step.c */
    const double h = f->log->t[row + 1] - f->log->t[row];
    if (!(fabs(h - f->h) <= rounding * h)) {
        lg_lag_weights_at(h / f->tau, &f->weights);
        f->h = h;
    }
    lg_lag_move(&f->weights, f->order, 1.0, f->log->u + row * 4 * f->m + f->input, f->m, from, out);
}

/* ---- the kept states ---- */

struct lg_machine_filter {
    const lg_context *context;
    pthread_mutex_t mutex;
    lg_machine_log log;
    uint32_t lags;
    double *start; /* (parts, lags) */
    /* Of the first lagged input of each input: (rows, order, 3), the lagged inputs of this input and their
     * derivatives by log tau, for the time constant `tau`; NULL: not asked for yet. */
    double *x[LG_MACHINE_LAGS], tau[LG_MACHINE_LAGS];
};

lg_status lg_machine_filter_create(const lg_context *context, const lg_machine *machine,
                                   const lg_machine_log *log, lg_machine_filter **out, lg_error *error) {
    LG_NEEDS(error, machine, log, out);
    const uint32_t n = machine->lags;
    LG_SCRATCH(double, start, context, log->parts *n + 1);
    lg_machine_filter *made = start != NULL ? lg_alloc(context, 1, sizeof *made) : NULL;
    if (made == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the lags of %u inputs", machine->input_count);
    *made = (lg_machine_filter){.context = context, .log = *log, .lags = n, .start = LG_KEEP(start)};
    made->log.filter = NULL;
    pthread_mutex_init(&made->mutex, NULL);
    for (size_t p = 0; p < log->parts; p++) start_at(machine, log, p, start + p * n);
    *out = made;
    return LG_OK;
}

void lg_machine_filter_destroy(lg_machine_filter *kept) {
    if (kept == NULL) return;
    for (uint32_t k = 0; k < kept->lags; k++) lg_free(kept->context, kept->x[k]);
    pthread_mutex_destroy(&kept->mutex);
    LG_FREE_ALL(kept->context, kept->start, kept);
}

/* The filter of the lagged inputs from `first` on. */
static filter filter_of(const lg_machine *machine, const lg_machine_log *log, uint32_t first, double tau) {
    return (filter){.log = log,
                    .m = machine->input_count,
                    .input = machine->lagged[first],
                    .order = lg_machine_lag_order(machine, first),
                    .tau = tau};
}

/* Computes the states of one input at all rows, unless those of this tau are there. */
static bool fill(lg_machine_filter *l, const lg_machine *machine, uint32_t first, double tau) {
    filter f = filter_of(machine, &l->log, first, tau);
    const size_t each = (size_t)3 * f.order;
    if (l->x[first] != NULL && l->tau[first] == tau) return true;
    if (l->x[first] == NULL) l->x[first] = lg_alloc(l->context, l->log.rows * each + 1, sizeof(double));
    if (l->x[first] == NULL) return false;
    for (size_t p = 0; p < l->log.parts; p++) {
        double *x = l->x[first] + l->log.first[p] * each;
        begin(l->start + p * l->lags + first, f.order, x);
        for (size_t row = l->log.first[p]; row + 1 < l->log.first[p + 1]; row++, x += each)
            advance(&f, row, x, x + each);
    }
    l->tau[first] = tau;
    return true;
}

/* Computes states from the starts of the parts on; rows that follow each other are continued. */
static void compute(const lg_machine *machine, const lg_machine_log *log, uint32_t first, double tau,
                    const size_t *at, size_t count, double *out) {
    filter f = filter_of(machine, log, first, tau);
    size_t part = SIZE_MAX, row = 0;
    double x[6] = {0}, start[LG_MACHINE_LAGS];
    for (size_t i = 0; i < count; i++, out += (size_t)3 * machine->lags) {
        const size_t own = lg_machine_log_part(log, at[i]);
        if (own != part || at[i] < row) {
            part = own, row = log->first[own];
            start_at(machine, log, own, start);
            begin(start + first, f.order, x);
        }
        for (; row < at[i]; row++) advance(&f, row, x, x);
        memcpy(out, x, (size_t)3 * f.order * sizeof *x);
    }
}

lg_status lg_machine_lag_states(const lg_machine *machine, const lg_machine_log *log, const double *tau,
                                const size_t *at, size_t count, double *out) {
    lg_machine_filter *kept = log->filter;
    const size_t stride = (size_t)machine->lags * 3;
    uint32_t order;
    bool room = true;
    if (kept == NULL) {
        for (uint32_t k = 0; k < machine->lags; k += lg_machine_lag_order(machine, k))
            compute(machine, log, k, tau[k], at, count, out + (size_t)3 * k);
        return LG_OK;
    }
    pthread_mutex_lock(&kept->mutex);
    for (uint32_t k = 0; k < machine->lags && room; k += order) {
        order = lg_machine_lag_order(machine, k);
        const size_t each = (size_t)3 * order;
        room = fill(kept, machine, k, tau[k]);
        for (size_t i = 0; i < count && room; i++)
            memcpy(out + i * stride + (size_t)3 * k, kept->x[k] + each * at[i], each * sizeof *out);
    }
    pthread_mutex_unlock(&kept->mutex);
    return room ? LG_OK : LG_OUT_OF_MEMORY;
}

/* Time constants of all lags, in seconds. */
static lg_status read_taus(const lg_context *context, const lg_machine *machine, const double *theta,
                           double *tau) {
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    lg_machine_vars vars;
    LG_TRY(lg_tape_create(context, NULL, &tape));
    LG_TRY(lg_machine_bind(tape, machine, lg_machine_parameter(tape, machine, theta), &vars));
    LG_TRY(lg_read(tape, vars.lag, machine->lags, tau));
    for (uint32_t k = 0; k < machine->lags; k++) tau[k] = machine->scales.time * exp(tau[k]);
    return LG_OK;
}

lg_status lg_machine_lagged_inputs(const lg_context *context, const lg_machine *machine, const double *theta,
                                   const lg_machine_log *log, const size_t *at, size_t count, double *out,
                                   lg_error *error) {
    LG_NEEDS(error, machine, log, at, out);
    if (machine->parameters > 0) LG_NEEDS(error, theta);
    double tau[LG_MACHINE_LAGS];
    const size_t n = count * machine->lags;
    if (n == 0) return LG_OK;
    LG_TRY_SCRATCH(double, states, context, 3 * n, lg_no_memory(error));
    lg_status status = read_taus(context, machine, theta, tau);
    if (status == LG_OK) status = lg_machine_lag_states(machine, log, tau, at, count, states);
    if (status != LG_OK) return lg_fail(error, status, "%s", lg_status_sentence(status));
    for (size_t i = 0; i < n; i++) out[i] = states[3 * i];
    return LG_OK;
}
