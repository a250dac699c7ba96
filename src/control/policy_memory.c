/* Policies: what the controller or the plant remembers between periods. Functions of the plant get states
 * with a memory, and a period moves the memory. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "control/policy.h"
#include "model/record.h"

/* Periods that are whole but for rounding count as whole. */
static double periods_of(const lg_policy_task *task, double seconds) {
    const double n = seconds / task->period, whole = floor(n + 0.5);
    return fabs(n - whole) < 1e-6 ? whole : n;
}

/* ---- the task ---- */

static lg_status add_line(lg_policy_task *task, const char *kind, const char *name, uint32_t number,
                          lg_policy_coordinate line, lg_error *error) {
    const char *const form = number > 0 ? "%s.%.20s.%u" : "%s.%.20s";
    if (task->coordinate_count == LG_POLICY_COORDINATES)
        return lg_fail(
            error, LG_UNSUPPORTED,
            "coordinates, lagged inputs, inputs of earlier periods and integrals are more than %d: "
            "take a longer period",
            LG_POLICY_COORDINATES);
    line.motion = LG_POLICY_LINE;
    line.success = line.success_velocity = INFINITY;
    (void)snprintf(line.name, sizeof line.name, form, kind, name, number);
    task->coordinate[task->coordinate_count++] = line;
    return LG_OK;
}

lg_status lg_policy_extend_task(lg_policy_task *task, lg_error *error) {
    const uint32_t count = task->coordinate_count;
    if (count > LG_POLICY_COORDINATES || task->input_count > LG_POLICY_INPUTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the task's sizes are out of range");
    for (uint32_t l = 0; l < task->input_count; l++) {
        if (task->dead_time[l] == 0.0) continue;
        if (!(task->period > 0.0 && task->dead_time[l] > 0.0 && task->dead_time[l] <= 1e6 * task->period))
            return lg_fail(error, LG_INVALID_ARGUMENT, "input %s: a dead time of %g s is out of range",
                           task->input[l].name, task->dead_time[l]);
        for (uint32_t k = 1; k <= (uint32_t)ceil(periods_of(task, task->dead_time[l])); k++)
            LG_TRY(add_line(task, "past", task->input[l].name, k,
                            (lg_policy_coordinate){.follows = l + 1, .ago = k}, error));
    }
    for (uint32_t i = 0; i < count; i++)
        if (task->coordinate[i].integral)
            LG_TRY(add_line(task, "integral", task->coordinate[i].name, 0,
                            (lg_policy_coordinate){.integrates = i + 1}, error));
    return LG_OK;
}

void lg_policy_lay_out_memory(lg_policy *p, const double *dead_time) {
    lg_policy_memory *m = &p->memory;
    const lg_policy_memory before = *m;
    *m = (lg_policy_memory){.positions = p->layout.positions};
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        if (c->ago > 0) m->known[c->follows - 1]++;
        m->integrals += c->integrates > 0;
        m->lags += c->follows > 0 && c->ago == 0;
        m->positions -= c->ago > 0 || c->integrates > 0;
    }
    for (uint32_t l = 0; l < p->inputs; l++) {
        m->late[l] = dead_time != NULL ? periods_of(&p->task, dead_time[l]) : before.late[l];
        const uint32_t needed = (uint32_t)ceil(m->late[l]);
        m->line[l] = needed > m->known[l] ? needed : m->known[l];
        m->lines += m->line[l];
    }
    m->believed = p->believes != NULL ? m->lags : 0;
    m->count = m->lines + m->integrals + m->believed;
}

/* ---- parts of a state ---- */

/* Where the past inputs of an input are in x. */
static uint32_t line_at(const lg_policy *p, uint32_t input) {
    uint32_t at = p->memory.plant;
    for (uint32_t l = 0; l < input; l++) at += p->memory.line[l];
    return at;
}

lg_var lg_policy_plant_part(lg_tape *tape, const lg_policy *p, lg_var x) {
    return p->memory.count > 0 ? lg_columns(tape, x, 0, p->memory.plant) : x;
}

/* ---- functions of the plant for states with a memory ---- */

/* The plant's functions are renamed so; functions of states with a memory get the plant's names. */
static const char *const of_plant[] = {"plant_step", "plant_momenta", "plant_positions", "plant_velocities",
                                       "plant_value"};
enum { PREFIX = sizeof "plant_" - 1 };

const char *lg_policy_plant_name(const lg_policy *p, const char *function) {
    for (size_t i = 0; i < LG_COUNT(of_plant) && p->memory.count > 0; i++)
        if (strcmp(of_plant[i] + PREFIX, function) == 0) return of_plant[i];
    return function;
}

/* The positions of the plant, with the lagged inputs that the controller computes, then the memory that it
 * sees. */
LG_POLICY_RECORDING(record_positions) {
    const lg_policy_memory *m = &p->memory;
    const lg_var plant = lg_policy_plant_part(tape, p, in[0]);
    lg_var parts[LG_POLICY_INPUTS + 3];
    uint32_t n = 0;
    parts[n++] = lg_program_call(tape, "plant_positions", 0, &plant);
    if (m->believed > 0) {
        parts[0] = lg_columns(tape, parts[0], 0, m->positions - m->lags);
        parts[n++] = lg_columns(tape, in[0], p->state - m->believed, m->believed);
    }
    for (uint32_t l = 0; l < p->inputs; l++)
        if (m->known[l] > 0) parts[n++] = lg_columns(tape, in[0], line_at(p, l), m->known[l]);
    if (m->integrals > 0) parts[n++] = lg_columns(tape, in[0], m->plant + m->lines, m->integrals);
    out[0] = lg_joined(tape, parts, n);
}

/* The same function of the plant's part */
#define OF_PLANT(function, name)                                                                             \
    LG_POLICY_RECORDING(function) {                                                                          \
        const lg_var plant = lg_policy_plant_part(tape, p, in[0]);                                           \
        out[0] = lg_program_call(tape, name, 0, &plant);                                                     \
    }
OF_PLANT(record_velocities, "plant_velocities")
OF_PLANT(record_value, "plant_value")
#undef OF_PLANT

/* Past inputs that the controller does not see begin as the inputs that hold the goal. */
LG_POLICY_RECORDING(record_momenta) {
    const lg_policy_memory *m = &p->memory;
    const lg_var q = lg_columns(tape, in[0], 0, m->positions);
    lg_var parts[2 * LG_POLICY_INPUTS + 3];
    uint32_t n = 0, at = m->positions;
    parts[n++] = lg_program_call(tape, "plant_momenta", 0, (const lg_var[]){q, in[1]});
    for (uint32_t l = 0; l < p->inputs; at += m->known[l++]) {
        const uint32_t hidden = m->line[l] - m->known[l];
        if (m->known[l] > 0) parts[n++] = lg_columns(tape, in[0], at, m->known[l]);
        if (hidden > 0) parts[n++] = lg_policy_filled(tape, q, hidden, p->regulator.u0[l]);
    }
    if (m->integrals > 0) parts[n++] = lg_columns(tape, in[0], at, m->integrals);
    if (m->believed > 0) parts[n++] = lg_columns(tape, q, m->positions - m->lags, m->lags);
    out[0] = lg_joined(tape, parts, n);
}

/* A step within a period: the memory stays. */
LG_POLICY_RECORDING(record_step) {
    const lg_var plant = lg_policy_plant_part(tape, p, in[0]);
    const lg_var parts[2] = {lg_program_call(tape, "plant_step", 0, (const lg_var[]){plant, in[1], in[2]}),
                             lg_columns(tape, in[0], p->memory.plant, p->memory.count)};
    out[0] = lg_concat(tape, parts, 2, 1);
}

lg_status lg_policy_add_memory(lg_policy *p, lg_error *error) {
    static const lg_record_function record[LG_COUNT(of_plant)] = {
        record_step, record_momenta, record_positions, record_velocities, record_value};
    for (size_t i = 0; i < LG_COUNT(of_plant) && p->memory.count > 0; i++) {
        size_t at, ins, outs;
        lg_port in[3];
        if (lg_program_find(p->program, of_plant[i], &at, NULL) != LG_OK) continue;
        const lg_port *given = lg_program_inputs(p->program, at, &ins),
                      *out = lg_program_outputs(p->program, at, &outs);
        for (size_t k = 0; k < ins && k < LG_COUNT(in); k++) in[k] = given[k];
        in[0].shape = lg_shape1(record[i] == record_momenta ? p->layout.positions : p->state);
        const lg_function_spec spec = {
            of_plant[i] + PREFIX, in, ins, &(lg_port){.name = out->name}, 1, record[i], p};
        LG_TRY(lg_program_add_function(p->program, &spec, error));
    }
    return LG_OK;
}

/* ---- a period ---- */

/* The times, as parts of a period, at which an input changes: 0, ..., 1. Returns how many intervals. */
static uint32_t cut_period(const double *late, uint32_t inputs, double at[LG_POLICY_INPUTS + 2]) {
    uint32_t n = 1;
    at[0] = 0.0;
    for (uint32_t l = 0; l < inputs; l++) {
        const double cut = late[l] - floor(late[l]);
        uint32_t k = n;
        while (k > 0 && at[k - 1] > cut) k--;
        if (k > 0 && at[k - 1] == cut) continue;
        memmove(at + k + 1, at + k, (n - k) * sizeof *at);
        at[k] = cut;
        n++;
    }
    at[n] = 1.0;
    return n;
}

/* Input l, (B, 1), `ago` periods ago. */
static lg_var input_of(lg_tape *tape, const lg_policy *p, lg_var x, lg_var u, lg_var dropped, uint32_t l,
                       uint32_t ago) {
    if (ago == 0) return lg_columns(tape, u, l, 1);
    if (ago <= p->memory.line[l]) return lg_columns(tape, x, line_at(p, l) + ago - 1, 1);
    return lg_columns(tape, dropped, l, 1);
}

/* The inputs that act after the part t of the period. */
static lg_var acting(lg_tape *tape, const lg_policy *p, const double *delay, double t, lg_var x, lg_var u,
                     lg_var dropped, lg_var late) {
    lg_var each[LG_POLICY_INPUTS];
    bool now = lg_is_none(late);
    for (uint32_t l = 0; l < p->inputs; l++) now = now && !(delay[l] > t);
    if (now) return u;
    for (uint32_t l = 0; l < p->inputs; l++) {
        const uint32_t ago = delay[l] > t ? (uint32_t)ceil(delay[l] - t) : 0;
        each[l] = input_of(tape, p, x, u, dropped, l, ago);
        if (lg_is_none(late)) continue;
        const lg_var before = input_of(tape, p, x, u, dropped, l, ago + 1);
        each[l] = lg_add(tape, each[l], lg_mul(tape, lg_sub(tape, before, each[l]), late));
    }
    return lg_joined(tape, each, p->inputs);
}

lg_var lg_policy_record_dropped(lg_tape *tape, const lg_policy *p, lg_var x, lg_var u) {
    lg_var each[LG_POLICY_INPUTS];
    for (uint32_t l = 0; l < p->inputs; l++) each[l] = input_of(tape, p, x, u, LG_NONE, l, p->memory.line[l]);
    return lg_joined(tape, each, p->inputs);
}

/* The integrals after a period. */
static lg_var integrals_after(lg_tape *tape, const lg_policy *p, lg_var before, lg_var z, lg_var u) {
    double centre[LG_POLICY_INPUTS], reach[LG_POLICY_INPUTS];
    lg_var free = LG_NONE, each[LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t l = 0; l < p->inputs; l++) {
        const lg_policy_input *in = &p->task.input[l];
        centre[l] = -0.5 * (in->high + in->low), reach[l] = 2.0 / (in->high - in->low);
    }
    const lg_shape row = lg_shape2(1, p->inputs);
    lg_var s = lg_add(tape, u, lg_input_f64(tape, row, centre));
    s = lg_mul(tape, s, lg_input_f64(tape, row, reach));
    for (int k = 0; k < 4; k++) s = lg_square(tape, s);
    s = lg_add_scalar(tape, lg_neg(tape, s), 1.0);
    for (uint32_t l = 0; l < p->inputs; l++)
        free = l == 0 ? lg_columns(tape, s, 0, 1) : lg_mul(tape, free, lg_columns(tape, s, l, 1));
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const uint32_t of = p->task.coordinate[i].integrates;
        if (of > 0) each[n++] = lg_columns(tape, z, p->layout.at[of - 1].error, 1);
    }
    const lg_var rate = lg_mul(tape, lg_joined(tape, each, n), free);
    return lg_add(tape, before, lg_scale(tape, rate, p->task.period));
}

/* The lagged inputs a after `seconds` under u. With `believes` by the numbers of that policy's lag, which is
 * linear. */
static lg_var lag_after(lg_tape *tape, const lg_policy *p, lg_var a, lg_var u, double seconds) {
    const lg_policy *own = p->believes;
    if (own == NULL)
        return lg_program_call(tape, "lag", 0, (const lg_var[]){a, u, lg_policy_filled(tape, a, 1, seconds)});
    enum { MOST = LG_POLICY_COORDINATES + LG_POLICY_INPUTS };
    const uint32_t n = p->memory.lags, m = p->inputs;
    double start[MOST * LG_POLICY_COORDINATES] = {0}, input[MOST * LG_POLICY_INPUTS] = {0}, h[MOST],
                        map[MOST * LG_POLICY_COORDINATES];
    for (uint32_t i = 0; i < n + m; i++) h[i] = seconds;
    for (uint32_t i = 0; i < n; i++) start[i * n + i] = 1.0;
    for (uint32_t l = 0; l < m; l++) input[(n + l) * m + l] = 1.0;
    if (lg_program_eval(own->context, own->program, "lag", n + m, (const double *const[]){start, input, h},
                        (double *const[]){map}, NULL) != LG_OK)
        return LG_NONE;
    return lg_matmul(tape, lg_concat(tape, (lg_var[]){a, u}, 2, 1),
                     lg_input_f64(tape, lg_shape2(n + m, n), map));
}

/* The lagged inputs after a period, as the controller computes them: by its own dead times. */
static lg_var lags_after(lg_tape *tape, const lg_policy *p, lg_var a, lg_var x, lg_var u) {
    double late[LG_POLICY_INPUTS], at[LG_POLICY_INPUTS + 2];
    for (uint32_t l = 0; l < p->inputs; l++) late[l] = periods_of(&p->task, p->task.dead_time[l]);
    const uint32_t n = cut_period(late, p->inputs, at);
    for (uint32_t k = 0; k < n; k++)
        a = lag_after(tape, p, a, acting(tape, p, late, at[k], x, u, LG_NONE, LG_NONE),
                      (at[k + 1] - at[k]) * p->task.period);
    return a;
}

/* The past inputs at the end of a period; `seen`: those that the controller sees. */
static uint32_t move_lines(lg_tape *tape, const lg_policy *p, bool seen, lg_var x, lg_var u, lg_var *parts) {
    uint32_t n = 0;
    for (uint32_t l = 0; l < p->inputs; l++) {
        const uint32_t count = seen ? p->memory.known[l] : p->memory.line[l];
        if (count > 0) parts[n++] = lg_columns(tape, u, l, 1);
        if (count > 1) parts[n++] = lg_columns(tape, x, line_at(p, l), count - 1);
    }
    return n;
}

lg_var lg_policy_record_period(lg_tape *tape, const lg_policy *p, lg_var x, lg_var u, lg_var dropped,
                               lg_var late) {
    const lg_policy_memory *m = &p->memory;
    const char *const step = lg_policy_plant_name(p, "step");
    double at[LG_POLICY_INPUTS + 2];
    lg_var parts[2 * LG_POLICY_INPUTS + 3] = {lg_policy_plant_part(tape, p, x)};
    uint32_t n = cut_period(m->late, p->inputs, at);
    for (uint32_t k = 0; k < n; k++) {
        const double length = at[k + 1] - at[k];
        const uint32_t steps = (uint32_t)ceil(length * p->task.substeps - 1e-9);
        const lg_var h = lg_policy_filled(tape, x, 1, length * p->task.period / steps),
                     by = acting(tape, p, m->late, at[k], x, u, dropped, late);
        for (uint32_t i = 0; i < steps; i++)
            parts[0] = lg_program_call(tape, step, 0, (const lg_var[]){parts[0], by, h});
    }
    if (m->count == 0) return parts[0];
    n = 1 + move_lines(tape, p, false, x, u, parts + 1);
    if (m->integrals > 0)
        parts[n++] = integrals_after(tape, p, lg_columns(tape, x, m->plant + m->lines, m->integrals),
                                     lg_program_call(tape, "errors", 0, &x), u);
    if (m->believed > 0)
        parts[n++] = lags_after(tape, p, lg_columns(tape, x, p->state - m->believed, m->believed), x, u);
    return lg_joined(tape, parts, n);
}

/* ---- the memory for the caller of `control` ---- */

/* The state's memory from what `control` takes: past inputs and integrals as the controller sees them. */
LG_POLICY_RECORDING(record_remember) {
    const lg_policy_memory *m = &p->memory;
    const uint32_t given = p->layout.given, behind = m->lines + m->integrals;
    lg_var parts[2 * LG_POLICY_INPUTS + 3];
    uint32_t n = 0;
    /* A state whose plant part is not used. */
    const lg_var kept = lg_columns(tape, in[0], given - behind, behind),
                 x = lg_concat(tape, (lg_var[]){lg_policy_filled(tape, in[0], m->plant, 0.0), kept}, 2, 1);
    if (m->lags > 0)
        parts[n++] =
            lags_after(tape, p, lg_columns(tape, in[0], given - behind - m->lags, m->lags), x, in[1]);
    n += move_lines(tape, p, true, x, in[1], parts + n);
    if (m->integrals > 0) {
        lg_policy_seen seen = {lg_policy_record_positions(tape, p, false, lg_columns(tape, in[0], 0, given)),
                               LG_NONE};
        if (p->layout.velocities > 0) seen.v = lg_columns(tape, in[0], given, p->layout.velocities);
        parts[n++] = integrals_after(tape, p, lg_columns(tape, kept, m->lines, m->integrals),
                                     lg_policy_record_errors(tape, p, false, seen), in[1]);
    }
    out[0] = lg_joined(tape, parts, n);
}

/* The lagged inputs and past inputs that hold the goal; integrals of 0. */
LG_POLICY_RECORDING(record_reset) {
    double first[LG_POLICY_COORDINATES];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        if (c->follows > 0 || c->integrates > 0) first[n++] = c->goal[0];
    }
    out[0] = lg_add(tape, lg_policy_filled(tape, in[0], n, 0.0), lg_input_f64(tape, lg_shape2(1, n), first));
}

lg_status lg_policy_add_remember(lg_policy *p, lg_error *error) {
    static const lg_policy_function remember = {"remember", record_remember, {"given", "unit u"}, {"next"}},
                                    reset = {"reset", record_reset, {"given"}, {"first"}};
    LG_TRY(lg_policy_add_row(p, &remember, error));
    return lg_policy_add_row(p, &reset, error);
}

/* ---- for certificates ---- */

lg_status lg_policy_check_memory(const lg_policy *p, bool any, lg_error *error) {
    for (uint32_t l = 0; l < p->inputs; l++)
        if (p->memory.late[l] > 0.0 && (any || p->memory.late[l] != floor(p->memory.late[l])))
            return lg_fail(
                error, LG_UNSUPPORTED,
                "the input %s acts %g periods late, and this certificate does not cover %s: nothing "
                "is proved. Test the policy by runs (evaluate)",
                p->task.input[l].name, p->memory.late[l], any ? "a dead time" : "a part of a period");
    if (any && p->memory.integrals > 0)
        return lg_fail(error, LG_UNSUPPORTED,
                       "this certificate does not cover the integrals of the controller");
    return LG_OK;
}

lg_var lg_policy_record_acting(lg_tape *tape, const lg_policy *p, lg_var x, lg_policy_seen seen, lg_var u) {
    const lg_policy_memory *m = &p->memory;
    lg_var parts[2 * LG_POLICY_INPUTS + 1];
    if (m->count == 0) return u;
    const lg_var before = lg_columns(tape, x, m->plant, m->count),
                 z = lg_policy_record_errors(tape, p, false, seen);
    uint32_t n = move_lines(tape, p, false, x, u, parts);
    if (m->integrals > 0)
        parts[n++] = integrals_after(tape, p, lg_columns(tape, before, m->lines, m->integrals), z, u);
    const lg_var change = lg_sub(tape, lg_joined(tape, parts, n), before),
                 out[2] = {acting(tape, p, m->late, 0.0, x, u, LG_NONE, LG_NONE),
                           lg_scale(tape, change, 1 / p->task.period)};
    return lg_concat(tape, out, 2, 1);
}
