/* Machines: steps over the intervals between rows of logs. */
#include <math.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

typedef struct interval {
    const lg_machine_vars *vars;
    lg_var u[4];   /* coefficients (B, inputs) of u; LG_NONE: no inputs, or this power is 0 in all rows */
    lg_var h;      /* (B, 1), each row's length; time then runs from 0 to 1. LG_NONE: one length for all */
    double length; /* length of the interval in the time of the scheme */
    /* Of machines with lags: the rows of the log, tau (lags) in seconds, log(tau/T) (lags), and the lagged
     * inputs (count, lags, 3) at these rows. */
    const lg_machine_log *log;
    const size_t *at;
    uint32_t count;
    double tau[LG_MACHINE_LAGS], l[LG_MACHINE_LAGS], *lagged;
} interval;

static lg_var polynomial_at(lg_tape *tape, const interval *over, double s) {
    lg_var sum = over->u[0];
    double power = s;
    for (int k = 1; k < 4; k++, power *= s) {
        if (lg_is_none(over->u[k]) || power == 0.0) continue;
        const lg_var both[2] = {sum, over->u[k]};
        sum = lg_linear_combination(tape, both, (const double[]){1.0, power}, 2);
    }
    return sum;
}

/* Fills x[d] (count, lags): the d-th derivatives of the scaled lagged inputs by log tau at s. */
static void fill_lagged(const interval *over, double s, double *const x[3]) {
    const lg_machine *machine = over->vars->machine;
    const uint32_t m = machine->input_count, n = machine->lags;
    for (uint32_t k = 0, order; k < n; k += order) {
        const uint32_t input = machine->lagged[k];
        lg_lag_weights weights;
        double h = -1.0, found[6];
        order = lg_machine_lag_order(machine, k);
        for (uint32_t i = 0; i < over->count; i++) {
            const size_t row = over->at[i];
            const double own = s > 0.0 ? over->log->t[row + 1] - over->log->t[row] : 0.0;
            if (!(fabs(own - h) <= 1e-9 * h)) lg_lag_weights_at(s * (h = own) / over->tau[k], &weights);
            lg_lag_move(&weights, order, s, over->log->u + row * 4 * m + input, m,
                        over->lagged + ((size_t)i * n + k) * 3, found);
            for (uint32_t d = 0; d < 3 * order; d++)
                x[d % 3][(size_t)i * n + k + d / 3] = found[d] / machine->scales.input[input];
        }
    }
}

/* The lagged inputs at s, (B, lags): a Taylor polynomial of degree 2 in log tau about its value, so that the
 * value and two derivatives are exact. */
static lg_var lagged_at(lg_tape *tape, const interval *over, double s) {
    const lg_machine *machine = over->vars->machine;
    const uint32_t n = machine->lags;
    lg_var x[3];
    void *memory[3];
    for (int d = 0; d < 3; d++) {
        x[d] = lg_input_buffer(tape, lg_shape2(over->count, n), &memory[d]);
        if (lg_is_none(x[d])) return LG_NONE;
        lg_tape_mark_rows(tape, x[d]);
    }
    fill_lagged(over, s, (double *const[]){memory[0], memory[1], memory[2]});
    const lg_var change = lg_sub(tape, over->vars->lag, lg_input_f64(tape, lg_shape2(1, n), over->l));
    const lg_var slope = lg_add(tape, x[1], lg_mul(tape, lg_scale(tape, change, 0.5), x[2]));
    return lg_add(tape, x[0], lg_mul(tape, change, slope));
}

static lg_var input_at(lg_tape *tape, const interval *over, double s) {
    const lg_var u = polynomial_at(tape, over, s);
    if (over->lagged == NULL) return u;
    return lg_machine_put_lagged(tape, over->vars->machine, u, lagged_at(tape, over, s));
}

static lg_status field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var *algebra) {
    const interval *over = user;
    lg_space space;
    const lg_var u = input_at(tape, over, t.value / over->length);
    LG_TRY(lg_machine_record_field(tape, over->vars, y, u, algebra));
    const int z = lg_machine_parts(over->vars->machine).z; /* of the bristles, which move by themselves */
    if (z >= 0) algebra[z] = lg_scale(tape, algebra[z], 0.0);
    if (lg_is_none(over->h)) return lg_tape_status(tape);
    LG_TRY(lg_machine_space(over->vars->machine, &space));
    for (size_t i = 0; i < lg_taped_parts(&space); i++) {
        const lg_shape shape = lg_var_shape(tape, algebra[i]);
        const lg_var h =
            shape.rank == 2 ? over->h : lg_reshape(tape, over->h, lg_shape3(shape.dims[0], 1, 1));
        algebra[i] = lg_mul(tape, algebra[i], h);
    }
    return lg_tape_status(tape);
}

static double length_of(const lg_machine *machine, const lg_machine_log *log, size_t row) {
    return (log->t[row + 1] - log->t[row]) / machine->scales.time;
}

/* Returns true if all intervals have the same length, up to rounding errors of the times. Sets *length to
 * this length. If the log's first interval has this length too, sets *length to exactly the length of the
 * first interval, so that all chunks of a uniform log get the same number. */
static bool uniform(const lg_machine *machine, const lg_machine_log *log, const size_t *at, uint32_t count,
                    double *length) {
    const double h = length_of(machine, log, at[0]), first = length_of(machine, log, 0);
    for (uint32_t i = 1; i < count; i++)
        if (!(fabs(length_of(machine, log, at[i]) - h) <= 1e-9 * h)) return false;
    *length = fabs(first - h) <= 1e-9 * h ? first : h;
    return true;
}

/* Coefficients of t^k in the polynomials of the inputs over these rows, (count, inputs); LG_NONE if k > 0 and
 * all are 0. */
static lg_var coefficients(lg_tape *tape, const lg_machine *machine, const lg_machine_log *log,
                           const size_t *at, uint32_t count, uint32_t k) {
    void *memory;
    const uint32_t m = machine->input_count;
    bool any = k == 0;
    for (uint32_t i = 0; i < count && !any; i++)
        for (uint32_t j = 0; j < m && !any; j++) any = log->u[(at[i] * 4 + k) * m + j] != 0.0;
    if (!any) return LG_NONE;
    const lg_var u = lg_input_buffer(tape, lg_shape2(count, m), &memory);
    if (lg_is_none(u)) return u;
    lg_tape_mark_rows(tape, u);
    double *values = memory;
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t j = 0; j < m; j++)
            values[i * m + j] = log->u[(at[i] * 4 + k) * m + j] / machine->scales.input[j];
    return u;
}

static lg_var lengths(lg_tape *tape, const lg_machine *machine, const lg_machine_log *log, const size_t *at,
                      uint32_t count) {
    void *memory;
    const lg_var h = lg_input_buffer(tape, lg_shape2(count, 1), &memory);
    if (lg_is_none(h)) return h;
    lg_tape_mark_rows(tape, h);
    for (uint32_t i = 0; i < count; i++) ((double *)memory)[i] = length_of(machine, log, at[i]);
    return h;
}

/* Moves the bristles in `parts`, if the machine has them, for the time h (B, 1) or (1, 1) with v constant. */
static void move_bristles(lg_tape *tape, const lg_machine_vars *vars, lg_var h, lg_var *parts) {
    const int z = lg_machine_parts(vars->machine).z;
    if (z < 0) return;
    const lg_var v = lg_machine_record_rates(tape, vars, parts);
    parts[z] = lg_machine_bristle_after(tape, vars, v, parts[z], h);
}

/* Steps over the interval by an explicit Lie group scheme. Bristles move for half a step before and after
 * each step. */
static lg_status scheme_steps(lg_tape *tape, const lg_machine_flow *flow, interval *over, lg_var *parts) {
    const lg_taped_ode ode = {.space = flow->space, .field = field, .user = over};
    const double h = over->length / flow->substeps;
    const bool same = lg_is_none(over->h);
    const lg_var half = same ? lg_full(tape, lg_shape2(1, 1), h / 2) : lg_scale(tape, over->h, h / 2);
    for (uint32_t i = 0; i < flow->substeps; i++) {
        move_bristles(tape, flow->vars, half, parts);
        LG_TRY(lg_taped_step(tape, flow->scheme, &ode, &(lg_taped_interval){.t = {.value = i * h}, .h = h},
                             parts, parts));
        move_bristles(tape, flow->vars, half, parts);
    }
    return lg_tape_status(tape);
}

static lg_status variational_steps(lg_tape *tape, const lg_machine_flow *flow, interval *over,
                                   lg_var *parts) {
    const double n = flow->substeps;
    lg_taped_span span = {.h = over->length / n, .rows = over->h};
    lg_var u[2] = {LG_NONE, LG_NONE};
    const char *fault = lg_machine_variational_fault(flow->vars->machine);
    if (fault != NULL) (void)lg_tape_fail(tape, LG_UNSUPPORTED, "variational step", fault);
    LG_TRY(lg_tape_status(tape));
    if (!lg_is_none(over->h))
        span.tall = lg_reshape(tape, over->h, lg_shape3(lg_rows_of(tape, over->h), 1, 1));
    if (!lg_is_none(over->u[0])) u[1] = input_at(tape, over, 0.0);
    for (uint32_t i = 0; i < flow->substeps; i++) {
        u[0] = u[1];
        if (!lg_is_none(over->u[0])) u[1] = input_at(tape, over, (i + 1) / n);
        LG_TRY(lg_machine_variational_step(tape, flow, &span, u, parts));
    }
    return lg_tape_status(tape);
}

/* Steps with friction that sticks. Where inputs change, they are parabolas in each step. */
static lg_status stick_steps(lg_tape *tape, const lg_machine_flow *flow, interval *over, lg_var *parts) {
    const double n = flow->substeps, h = over->length / n;
    const bool held =
        over->lagged == NULL && lg_is_none(over->u[1]) && lg_is_none(over->u[2]) && lg_is_none(over->u[3]);
    lg_machine_stick step = {.h = lg_is_none(over->h) ? lg_full(tape, lg_shape2(1, 1), h)
                                                      : lg_scale(tape, over->h, h),
                             .u = {LG_NONE, LG_NONE, LG_NONE}};
    for (uint32_t i = 0; i < flow->substeps; i++) {
        for (int j = 0; j < (held ? 1 : 3) && !lg_is_none(over->u[0]); j++)
            step.u[j] = input_at(tape, over, (i + 0.5 * j) / n);
        move_bristles(tape, flow->vars, lg_scale(tape, step.h, 0.5), parts);
        LG_TRY(lg_machine_stick_step(tape, flow->vars, &step, parts));
        move_bristles(tape, flow->vars, lg_scale(tape, step.h, 0.5), parts);
    }
    return lg_tape_status(tape);
}

static lg_status steps_of(lg_tape *tape, const lg_machine_flow *flow, interval *over, lg_var *parts) {
    if (flow->scheme->kind == LG_SCHEME_VARIATIONAL) return variational_steps(tape, flow, over, parts);
    return flow->vars->machine->sticks != 0 ? stick_steps(tape, flow, over, parts)
                                            : scheme_steps(tape, flow, over, parts);
}

static size_t lagged_bytes(const interval *over) {
    return (size_t)over->count * over->vars->machine->lags * 3 * sizeof(double);
}

/* Computes the lagged inputs at the rows over->at, if the machine has lags. The caller gives over->lagged
 * back. */
static lg_status take_lags(lg_tape *tape, interval *over) {
    const lg_machine *machine = over->vars->machine;
    if (machine->lags == 0) return LG_OK;
    LG_TRY(lg_read(tape, over->vars->lag, machine->lags, over->l));
    for (uint32_t k = 0; k < machine->lags; k++) over->tau[k] = machine->scales.time * exp(over->l[k]);
    over->lagged = lg_pool_take(tape, lagged_bytes(over));
    if (over->lagged == NULL) return lg_tape_status(tape);
    return lg_machine_lag_states(machine, over->log, over->tau, over->at, over->count, over->lagged);
}

static void give_lags(lg_tape *tape, interval *over) {
    if (over->lagged != NULL) lg_pool_give(tape, over->lagged, lagged_bytes(over));
}

static void fill_coefficients(lg_tape *tape, interval *over, uint32_t powers) {
    const lg_machine *machine = over->vars->machine;
    for (uint32_t k = 0; k < powers && machine->input_count > 0; k++)
        over->u[k] = coefficients(tape, machine, over->log, over->at, over->count, k);
}

lg_status lg_machine_begin_flow(lg_tape *tape, const lg_machine_problem *problem, lg_var theta,
                                lg_machine_vars *vars, lg_machine_flow *flow) {
    LG_TRY(lg_machine_bind(tape, problem->machine, theta, vars));
    *flow = (lg_machine_flow){.vars = vars, .scheme = problem->scheme, .substeps = problem->substeps};
    return lg_machine_space(problem->machine, &flow->space);
}

lg_status lg_machine_split_row(lg_tape *tape, const lg_machine_vars *vars, lg_var z, lg_var *parts) {
    const lg_machine *machine = vars->machine;
    return lg_machine_record_state(tape, vars, lg_machine_columns(tape, z, 0, machine->positions),
                                   lg_machine_columns(tape, z, machine->positions, machine->velocities),
                                   parts);
}

lg_var lg_machine_join_row(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const int z = lg_machine_parts(vars->machine).z;
    const lg_var all[3] = {lg_machine_record_positions(tape, vars, parts),
                           lg_machine_record_velocities(tape, vars, parts), z < 0 ? LG_NONE : parts[z]};
    return lg_concat(tape, all, z < 0 ? 2 : 3, 1);
}

lg_status lg_machine_record_interval(lg_tape *tape, const lg_machine_flow *flow, const lg_machine_log *log,
                                     const size_t *at, uint32_t count, lg_var *parts) {
    const lg_machine *machine = flow->vars->machine;
    interval over = {.vars = flow->vars, .length = 1.0, .log = log, .at = at, .count = count};
    if (!uniform(machine, log, at, count, &over.length)) over.h = lengths(tape, machine, log, at, count);
    fill_coefficients(tape, &over, 4);
    lg_status status = take_lags(tape, &over);
    if (status == LG_OK) status = steps_of(tape, flow, &over, parts);
    give_lags(tape, &over);
    return status;
}

lg_status lg_machine_record_interval_of(lg_tape *tape, const lg_machine_flow *flow, const lg_var *u, lg_var h,
                                        lg_var *parts) {
    interval over = {.vars = flow->vars, .length = 1.0, .h = h, .u = {u[0], u[1], u[2], u[3]}};
    return steps_of(tape, flow, &over, parts);
}

/* The inputs (B, inputs) right after rows at[0..count-1], after their lags; LG_NONE: no inputs. */
static lg_status record_inputs(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_log *log,
                               const size_t *at, uint32_t count, lg_var *u) {
    interval over = {.vars = vars, .log = log, .at = at, .count = count};
    *u = LG_NONE;
    if (vars->machine->input_count == 0) return LG_OK;
    fill_coefficients(tape, &over, 1);
    const lg_status status = take_lags(tape, &over);
    if (status == LG_OK) *u = input_at(tape, &over, 0.0);
    give_lags(tape, &over);
    return status == LG_OK ? lg_tape_status(tape) : status;
}

lg_var lg_machine_record_shown(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_log *log,
                               const size_t *at, uint32_t count, const lg_var *parts) {
    lg_var u;
    if (!vars->machine->accelerations) return lg_machine_record_velocities(tape, vars, parts);
    if (record_inputs(tape, vars, log, at, count, &u) != LG_OK) return LG_NONE;
    const lg_var stuck =
        vars->machine->sticks != 0 ? lg_machine_stick_accelerations(tape, vars, parts, u) : LG_NONE;
    return lg_machine_record_accelerations(tape, vars, parts, u, stuck);
}
