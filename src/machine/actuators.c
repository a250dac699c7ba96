/* Machines: actuators, u -> lag -> dead zone or curve -> input map. Scaled inputs are those of the log
 * divided by U, so that c_k of u + c_2 u^2 + ... is multiplied by U^(k - 1), and a dead zone is divided
 * by U. */
#include <math.h>
#include <stdio.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

/* ---- columns of inputs ---- */

static bool is_all(const uint32_t *at, uint32_t count, uint32_t columns) {
    bool all = count == columns;
    for (uint32_t i = 0; i < count; i++) all = all && at[i] == i;
    return all;
}

/* The matrix that selects the inputs which the term changes, (of_count, inputs); LG_NONE: these are all. */
static lg_var selection(const lg_term_at *at) {
    const uint32_t count = at->term->of_count, all = at->machine->input_count;
    uint32_t of[LG_MACHINE_INPUTS];
    for (uint32_t i = 0; i < count; i++) of[i] = at->term->of[i].index;
    return is_all(of, count, all) ? LG_NONE : lg_machine_record_selection(at->tape, of, count, all);
}

/* The inputs that the term changes, (B, of_count). */
static lg_var chosen(const lg_term_at *at) {
    const lg_var of = selection(at), u = at->seen->u;
    return lg_is_none(of) ? u : lg_matmul_nt(at->tape, u, of);
}

/* The inputs with `change` (B, of_count) added to those of the term. */
static lg_var changed(const lg_term_at *at, lg_var change) {
    const lg_var of = selection(at);
    return lg_add(at->tape, at->seen->u, lg_is_none(of) ? change : lg_matmul(at->tape, change, of));
}

lg_var lg_machine_put_lagged(lg_tape *tape, const lg_machine *machine, lg_var u, lg_var x) {
    const uint32_t m = machine->input_count, n = machine->lags;
    lg_var each[LG_MACHINE_INPUTS];
    uint32_t next = 0;
    if (is_all(machine->lagged, n, m)) return x;
    for (uint32_t j = 0; j < m; j++) {
        const bool lags = next < n && machine->lagged[next] == j;
        if (lags) next += lg_machine_lag_order(machine, next);
        each[j] = lags ? lg_machine_columns(tape, x, next - 1, 1) : lg_machine_columns(tape, u, j, 1);
    }
    return lg_joined(tape, each, m);
}

lg_var lg_machine_record_actuated(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    lg_machine_seen now = *seen;
    if (lg_is_none(now.u)) return LG_NONE;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_ACTUATOR, &term);) {
        const lg_term_at at = lg_term_at_of(tape, vars, term, &now);
        now.u = term->kind->record(&at);
    }
    return now.u;
}

/* ---- curves: u + c_2 u^2 + c_3 u^3 ---- */

static size_t curve_parameters(const lg_machine *machine, const lg_machine_term *term) {
    return (size_t)term->of_count * (term->degree - 1);
}

/* Coefficients (of_count, degree - 1). */
static lg_var curve_numbers(const lg_term_at *at) {
    const lg_machine_term *own = at->term;
    const uint32_t each = own->degree - 1;
    double factor[LG_MACHINE_INPUTS * LG_MACHINE_DEGREE];
    for (uint32_t i = 0; i < own->value_count; i++)
        factor[i] = pow(at->machine->scales.input[own->of[i / each].index], i % each + 1.0);
    const lg_var all =
        own->value_count == 0 ? at->theta : lg_machine_record_entries(at, own->value_count, NULL, factor);
    return lg_reshape(at->tape, all, lg_shape2(own->of_count, each));
}

static void curve_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                        lg_entry_about *out) {
    const uint32_t each = term->degree - 1, input = term->of[index / each].index;
    *out = (lg_entry_about){.unit = pow(machine->scales.input[input], -(index % each + 1.0)), .single = true};
    (void)snprintf(out->name, sizeof out->name, "curve.%s.%u", machine->inputs[input], index % each + 2);
}

static lg_var curve(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const lg_var c = lg_transpose(tape, curve_numbers(at));
    const lg_var u = chosen(at);
    lg_var sum = LG_NONE; /* Horner: u (c_2 + u (c_3 + ...)) */
    for (uint32_t k = at->term->degree - 1; k-- > 0;) {
        const lg_var row = lg_slice(tape, c, 0, k, 1);
        sum = lg_mul(tape, u, lg_is_none(sum) ? row : lg_add(tape, row, sum));
    }
    return changed(at, lg_mul(tape, u, sum));
}

/* ---- dead zones: 0 for |u| < d, else u - d sign u; a learned d is a square ---- */

static size_t one_each(const lg_machine *machine, const lg_machine_term *term) {
    return term->of_count;
}

static void dead_zone_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                            lg_entry_about *out) {
    const uint32_t input = term->of[index].index;
    *out = (lg_entry_about){
        .unit = machine->scales.input[input], .start = 0.16, .positive = true, .single = true};
    (void)snprintf(out->name, sizeof out->name, "dead_zone.%s", machine->inputs[input]);
}

static lg_var dead_zone(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const lg_machine_term *own = at->term;
    const uint32_t n = own->of_count;
    double factor[LG_MACHINE_INPUTS];
    for (uint32_t i = 0; i < n; i++) factor[i] = 1.0 / at->machine->scales.input[own->of[i].index];
    const lg_var d = own->value_count > 0 ? lg_machine_record_entries(at, n, NULL, factor)
                                          : lg_reshape(tape, lg_square(tape, at->theta), lg_shape2(1, n));
    const lg_var u = chosen(at);
    const lg_var twice = lg_sub(tape, lg_abs(tape, lg_sub(tape, u, d)), lg_abs(tape, lg_add(tape, u, d)));
    return changed(at, lg_scale(tape, twice, 0.5));
}

/* ---- lags: tau x' = u - x, or two in series; log tau = log low + log(high/low) sigmoid(theta) ---- */

static double span_of(const lg_machine *machine) {
    return log(machine->scales.lag[1] / machine->scales.lag[0]);
}

/* theta of a time constant, which is kept from the ends of its range. */
static double lag_theta(const lg_machine *machine, double tau) {
    static const double end = 0.02;
    const double at = log(tau / machine->scales.lag[0]) / span_of(machine),
                 part = fmin(fmax(at, end), 1.0 - end);
    return log(part / (1.0 - part));
}

/* Where a lag begins: 5 rows, in the least time constants of .2 rows. */
static const double lag_start = 5.0 / 0.2;

static void start_lag(const lg_machine *machine, const lg_machine_term *term, double *theta) {
    for (size_t i = 0; i < term->parameters; i++)
        theta[i] = lag_theta(machine, lag_start * machine->scales.lag[0]);
}

static void lag_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                      lg_entry_about *out) {
    *out = (lg_entry_about){
        .unit = machine->scales.lag[0], .start = lag_start, .positive = true, .single = true};
    (void)snprintf(out->name, sizeof out->name, "lag.%s", machine->inputs[term->of[index].index]);
}

size_t lg_machine_set_lags(const lg_machine *machine, double tau, double *theta) {
    size_t count = 0;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        const bool open = term->kind->lag != NULL && term->value_count == 0;
        for (size_t k = 0; open && k < term->parameters; k++, count++)
            theta[term->offset + k] = lag_theta(machine, tau);
    }
    return count;
}

static lg_var lag_of(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const lg_machine *machine = at->machine;
    const uint32_t n = at->term->of_count;
    double factor[LG_MACHINE_INPUTS];
    for (uint32_t i = 0; i < n; i++) factor[i] = 1.0 / machine->scales.time;
    if (at->term->value_count > 0) return lg_log(tape, lg_machine_record_entries(at, n, NULL, factor));
    const lg_var part = lg_act(tape, lg_reshape(tape, at->theta, lg_shape2(1, n)), LG_SIGMOID);
    return lg_add_scalar(tape, lg_scale(tape, part, span_of(machine)),
                         log(machine->scales.lag[0] / machine->scales.time));
}

/* The lag acts in time: its inputs are lagged before they come here. */
static lg_var lagged(const lg_term_at *at) {
    return at->seen->u;
}

static void lag_numbers(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                        const double *theta) {
    for (uint32_t i = 0; i < term->of_count; i++)
        lg_numbers_put(l, machine->scales.lag[0] * exp(span_of(machine) / (1.0 + exp(-theta[i]))), "lag.%s",
                       machine->inputs[term->of[i].index]);
}

bool lg_machine_find_lags(lg_machine *machine) {
    uint32_t order[LG_MACHINE_INPUTS] = {0};
    bool twice = false;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        for (uint32_t k = 0; term->kind->lag != NULL && k < term->of_count; k++) {
            twice = twice || order[term->of[k].index] > 0;
            order[term->of[k].index] = term->kind->order;
        }
    }
    machine->lags = 0;
    for (uint32_t j = 0; j < machine->input_count; j++)
        for (uint32_t k = 0; k < order[j]; k++) machine->lagged[machine->lags++] = j;
    return !twice;
}

uint32_t lg_machine_lag_order(const lg_machine *machine, uint32_t first) {
    uint32_t next = first;
    while (next < machine->lags && machine->lagged[next] == machine->lagged[first]) next++;
    return next - first;
}

/* Place of an input's first lagged input among all of them. */
static uint32_t place_of(const lg_machine *machine, uint32_t input) {
    uint32_t place = 0;
    while (machine->lagged[place] != input) place++;
    return place;
}

lg_var lg_machine_record_lag(lg_tape *tape, const lg_machine_vars *vars) {
    const lg_machine *machine = vars->machine;
    lg_var sum = LG_NONE;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        const lg_term_at of = lg_term_at_of(tape, vars, term, NULL);
        uint32_t at[LG_MACHINE_INPUTS];
        if (term->kind->lag == NULL) continue;
        for (uint32_t k = 0; k < term->of_count; k++) at[k] = place_of(machine, term->of[k].index);
        const lg_var own = term->kind->lag(&of);
        if (is_all(at, term->of_count, machine->lags)) return own;
        for (uint32_t o = 0; o < term->kind->order; o++) {
            const lg_var placed =
                lg_matmul(tape, own, lg_machine_record_selection(tape, at, term->of_count, machine->lags));
            sum = lg_add_or(tape, sum, placed);
            for (uint32_t k = 0; k < term->of_count; k++) at[k]++;
        }
    }
    return sum;
}

/* ---- the table ---- */

#define LAG(kind_name, kind_order)                                                                           \
    {                                                                                                        \
        .name = kind_name, .part = LG_MACHINE_ACTUATOR, .options = LG_TERM_OF | LG_TERM_VALUES,              \
        .parameters = one_each, .initialise = start_lag, .entry = lag_entry, .record = lagged,               \
        .lag = lag_of, .order = (kind_order), .numbers = lag_numbers                                         \
    }

const lg_term_kind lg_machine_actuator_kinds[] = {LAG("lag", 1),
                                                  LAG("second_order_lag", 2),
                                                  {.name = "dead_zone",
                                                   .part = LG_MACHINE_ACTUATOR,
                                                   .options = LG_TERM_OF | LG_TERM_VALUES,
                                                   .parameters = one_each,
                                                   .entry = dead_zone_entry,
                                                   .record = dead_zone,
                                                   .each = LG_PARAMETER_SQUARED},
                                                  {.name = "curve",
                                                   .part = LG_MACHINE_ACTUATOR,
                                                   .options = LG_TERM_OF | LG_TERM_VALUES | LG_TERM_DEGREE,
                                                   .least = 2,
                                                   .parameters = curve_parameters,
                                                   .entry = curve_entry,
                                                   .record = curve,
                                                   .each = LG_PARAMETER_ITSELF},
                                                  {.name = NULL}};
