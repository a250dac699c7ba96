/* Policies: the functions of the closed loop as programs. */
#include <stdio.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "control/policy.h"
#include "liegrad/ops.h"

/* Whether the functions of a policy begin here, in a program that is a policy's. */
static bool is_own(const lg_program *program, const char *name) {
    char plant[32];
    size_t found;
    (void)snprintf(plant, sizeof plant, "plant_%.20s", name);
    return strcmp(name, "retract") == 0 || strcmp(name, "errors") == 0 || strcmp(name, "period") == 0 ||
           lg_program_find(program, plant, &found, NULL) == LG_OK;
}

/* Copies the plant's functions; `plant` may be the program of a policy. */
static lg_status copy_functions(const lg_policy *policy, const lg_program *plant, lg_error *error) {
    for (size_t f = 0; f < lg_program_functions(plant); f++) {
        LG_CLEAN(lg_function_image_destroy_at) lg_function_image *image = NULL;
        if (is_own(plant, lg_program_function_name(plant, f))) break;
        if (lg_function_image_create(plant, f, &image) != LG_OK) return lg_no_memory(error);
        image->name = lg_policy_plant_name(policy, image->name);
        LG_TRY(lg_program_add_image(policy->program, image, error));
    }
    return LG_OK;
}

/* ---- recordings: `user` is the policy ---- */

static lg_var row_of(lg_tape *tape, const double *x, uint32_t n) {
    return lg_input_f64(tape, lg_shape2(1, n), x);
}

static bool moves(const lg_policy *p) {
    return p->layout.velocities > 0;
}

static lg_policy_seen seen_of(const lg_policy *p, lg_tape *tape, lg_var x) {
    if (!moves(p)) return (lg_policy_seen){x, LG_NONE};
    return (lg_policy_seen){lg_program_call(tape, "positions", 0, &x),
                            lg_program_call(tape, "velocities", 0, &x)};
}

LG_POLICY_RECORDING(record_period) {
    out[0] = lg_policy_record_period(tape, p, in[0], in[1], LG_NONE, LG_NONE);
}

LG_POLICY_RECORDING(record_errors) {
    out[0] = lg_policy_record_errors(tape, p, false, seen_of(p, tape, in[0]));
}

LG_POLICY_RECORDING(record_retract) {
    const lg_policy_seen at = lg_policy_record_place(tape, p, in[0]);
    out[0] = moves(p) ? lg_program_call(tape, "momenta", 0, (const lg_var[]){at.q, at.v}) : at.q;
}

LG_POLICY_RECORDING(record_linear) {
    const lg_var x = lg_program_call(tape, "retract", 0, in),
                 next = lg_program_call(tape, "period", 0, (const lg_var[]){x, in[1]});
    out[0] = lg_program_call(tape, "errors", 0, &next);
}

LG_POLICY_RECORDING(record_lagged) {
    out[0] = lg_program_call(
        tape, "lag", 0, (const lg_var[]){in[0], in[1], lg_policy_filled(tape, in[0], 1, p->task.period)});
}

/* u in its limits: min(max(u, low), high). */
static lg_var saturated(lg_tape *tape, const lg_policy *p, lg_var u) {
    double low[LG_POLICY_INPUTS], minus_high[LG_POLICY_INPUTS];
    for (uint32_t l = 0; l < p->inputs; l++)
        low[l] = p->task.input[l].low, minus_high[l] = -p->task.input[l].high;
    const lg_var above = lg_max(tape, u, row_of(tape, low, p->inputs));
    return lg_neg(tape, lg_max(tape, lg_neg(tape, above), row_of(tape, minus_high, p->inputs)));
}

static lg_var feedback(lg_tape *tape, const lg_policy *p, lg_var z, lg_var K) {
    return saturated(tape, p,
                     lg_sub(tape, row_of(tape, p->regulator.u0, p->inputs), lg_matmul_nt(tape, z, K)));
}

/* ---- policies: a row for each kind ---- */

/* With compensation k tanh(r/w) is added to r = -K z; the last weights are log k and log w. */
static lg_var regulator_of(lg_tape *tape, const lg_policy *p, lg_var z, const double *K, lg_var weights) {
    const uint32_t m = p->inputs, from = (uint32_t)p->parameters - 2 * m;
    const lg_var gain = lg_input_f64(tape, lg_shape2(m, p->layout.errors), K);
    if (!p->task.compensate) return feedback(tape, p, z, gain);
    const lg_var flat = lg_reshape(tape, weights, lg_shape2(1, (uint32_t)p->parameters)),
                 k = lg_exp(tape, lg_slice(tape, flat, 1, from, m)),
                 w = lg_exp(tape, lg_neg(tape, lg_slice(tape, flat, 1, from + m, m))),
                 r = lg_neg(tape, lg_matmul_nt(tape, z, gain)),
                 more = lg_mul(tape, lg_act(tape, lg_mul(tape, r, w), LG_TANH), k);
    return saturated(tape, p, lg_add(tape, row_of(tape, p->regulator.u0, m), lg_add(tape, r, more)));
}

/* V/c (B, 1). Opposite to the goal, where an error is 0 by its formula, V is that of its full length. */
static lg_var level_of(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z) {
    const uint32_t n = p->layout.errors;
    double factors[LG_POLICY_COORDINATES] = {0};
    for (uint32_t k = 0; k < p->layout.at[0].rate; k++) {
        const uint32_t i = p->layout.owner[k];
        factors[i] += p->regulator.P[k * (n + 1)] / lg_policy_row_of(&p->task.coordinate[i])->errors;
    }
    const lg_var P = lg_input_f64(tape, lg_shape2(n, n), p->regulator.P);
    lg_var V = lg_rowdot(tape, lg_matmul(tape, z, P), z);
    const lg_var lost = lg_policy_record_lost(tape, p, seen, z, factors);
    if (!lg_is_none(lost)) V = lg_add(tape, V, lost);
    return lg_scale(tape, V, 1.0 / p->regulator.c);
}

static lg_var record_lqr(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z, lg_var weights) {
    return regulator_of(tape, p, z, p->regulator.K, weights);
}

/* Centre + half range tanh(y). */
static lg_var limited(lg_tape *tape, const lg_policy *p, lg_var y) {
    double centre[LG_POLICY_INPUTS], half[LG_POLICY_INPUTS];
    for (uint32_t l = 0; l < p->inputs; l++) {
        const lg_policy_input *in = &p->task.input[l];
        centre[l] = 0.5 * (in->high + in->low), half[l] = lg_policy_half_range(p, l);
    }
    const lg_var u = lg_mul(tape, lg_act(tape, y, LG_TANH), row_of(tape, half, p->inputs));
    return lg_add(tape, u, row_of(tape, centre, p->inputs));
}

static lg_var record_network(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z,
                             lg_var weights) {
    static const double steepness = 4.5;
    const lg_var features = lg_policy_record_features(tape, p, p->scale, seen);
    const lg_var u = limited(tape, p, lg_mlp_record(tape, &p->net, weights, 0, features));
    if (!p->task.gate) return u;
    const lg_var by = lg_add_scalar(tape, lg_scale(tape, level_of(tape, p, seen, z), -steepness), steepness);
    const lg_var gate = lg_act(tape, by, LG_SIGMOID),
                 held = regulator_of(tape, p, z, p->regulator.near, weights);
    return lg_add(tape, u, lg_mul(tape, gate, lg_sub(tape, held, u)));
}

/* (1, 2 m): k_p = e^weights[l], k_d = e^weights[m + l]; or the task's gains. */
static lg_var gains_of(lg_tape *tape, const lg_policy *p, lg_var weights) {
    const uint32_t m = p->inputs;
    double given[2 * LG_POLICY_INPUTS];
    if (p->parameters > 0) return lg_reshape(tape, lg_exp(tape, weights), lg_shape2(1, 2 * m));
    for (uint32_t l = 0; l < 2 * m; l++) given[l] = p->task.gains[l / m];
    return row_of(tape, given, 2 * m);
}

static lg_var record_energy(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z,
                            lg_var weights) {
    const uint32_t m = p->inputs, n = p->layout.errors;
    double shape[LG_POLICY_INPUTS * LG_POLICY_ERRORS], damp[LG_POLICY_INPUTS * LG_POLICY_ERRORS];
    const uint32_t positions = p->layout.at[0].rate;
    for (uint32_t i = 0; i < m * n; i++) {
        const bool rate = i % n >= positions;
        shape[i] = rate ? 0.0 : p->G[i], damp[i] = rate ? p->G[i] : 0.0;
    }
    const lg_var gain = gains_of(tape, p, weights);
    const lg_var kp = lg_slice(tape, gain, 1, 0, m), kd = lg_slice(tape, gain, 1, m, m);
    const lg_var e = lg_matmul_nt(tape, z, lg_input_f64(tape, lg_shape2(m, n), shape)),
                 v = lg_matmul_nt(tape, z, lg_input_f64(tape, lg_shape2(m, n), damp));
    const lg_var both = lg_add(tape, lg_mul(tape, e, kp), lg_mul(tape, v, kd));
    return saturated(tape, p, lg_sub(tape, row_of(tape, p->regulator.u0, m), both));
}

typedef lg_var (*record_kind)(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z,
                              lg_var weights);
static const record_kind kinds[LG_POLICY_KIND_COUNT] = {record_lqr, record_network, record_energy};

/* Inputs: q, v if the machine moves, then the weights if there are any. */
LG_POLICY_RECORDING(record_policy) {
    const lg_policy_seen seen = {in[0], moves(p) ? in[1] : LG_NONE};
    const lg_var z = lg_policy_record_errors(tape, p, p->task.kind == LG_POLICY_ENERGY, seen);
    out[0] = kinds[p->task.kind](tape, p, seen, z, p->parameters > 0 ? in[moves(p) ? 2 : 1] : LG_NONE);
}

static lg_var call_policy(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var weights) {
    lg_var in[3] = {seen.q};
    size_t n = 1;
    if (moves(p)) in[n++] = seen.v;
    in[n] = weights;
    return lg_program_call(tape, "policy", 0, in);
}

/* The state as `control` takes it. */
LG_POLICY_RECORDING(record_sensed) {
    const lg_policy_seen seen = seen_of(p, tape, in[0]);
    const lg_var parts[2] = {lg_policy_record_positions(tape, p, true, seen.q), seen.v};
    out[0] = moves(p) ? lg_concat(tape, parts, 2, 1) : parts[0];
}

LG_POLICY_RECORDING(record_control) {
    const lg_policy_layout *l = &p->layout;
    lg_policy_seen seen = {lg_policy_record_positions(tape, p, false, lg_slice(tape, in[0], 1, 0, l->given)),
                           LG_NONE};
    if (moves(p)) seen.v = lg_slice(tape, in[0], 1, l->given, l->velocities);
    out[0] = call_policy(tape, p, seen,
                         p->parameters > 0 ? theta[lg_program_parameters(p->program) - 1] : LG_NONE);
}

/* Moves the tracked numbers of (B, given + velocities) so that the set points become the goal. */
static lg_var relative(lg_tape *tape, const lg_policy *p, lg_var x, lg_var reference) {
    const lg_policy_layout *l = &p->layout;
    const uint32_t tracked = lg_policy_tracked(&p->task), n = l->given + l->velocities,
                   rows = moves(p) ? 2 * tracked : tracked;
    double map[2 * LG_POLICY_COORDINATES * 7 * LG_POLICY_COORDINATES] = {0};
    double goal[7 * LG_POLICY_COORDINATES] = {0};
    for (uint32_t i = 0, k = 0; i < p->task.coordinate_count; i++) {
        if (!p->task.coordinate[i].track) continue;
        map[k * n + l->at[i].given] = 1.0;
        goal[l->at[i].given] = p->task.coordinate[i].goal[0];
        if (moves(p)) map[(tracked + k) * n + l->given + l->at[i].velocity] = 1.0;
        k++;
    }
    const lg_var shift = lg_matmul(tape, reference, lg_input_f64(tape, lg_shape2(rows, n), map));
    return lg_add(tape, lg_sub(tape, x, shift), row_of(tape, goal, n));
}

LG_POLICY_RECORDING(record_track) {
    const lg_var x = relative(tape, p, in[0], in[1]);
    out[0] = lg_program_call(tape, "control", 0, &x);
}

/* h (stage + sum_l w_l (u_l - u0_l)^2) */
static lg_var record_cost(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var u) {
    double weight[LG_POLICY_INPUTS];
    for (uint32_t l = 0; l < p->inputs; l++) weight[l] = p->task.input[l].weight;
    const lg_var from = lg_sub(tape, u, row_of(tape, p->regulator.u0, p->inputs));
    const lg_var effort =
        lg_matmul(tape, lg_square(tape, from), lg_input_f64(tape, lg_shape2(p->inputs, 1), weight));
    return lg_scale(tape, lg_add(tape, lg_policy_record_stage(tape, p, seen), effort), p->task.period);
}

/* Outputs of a period under u: next, cost, u. */
static void close_loop(lg_tape *tape, const lg_policy *p, lg_var x, lg_policy_seen seen, lg_var u,
                       lg_var *out) {
    out[0] = lg_program_call(tape, "period", 0, (const lg_var[]){x, u});
    out[1] = record_cost(tape, p, seen, u);
    out[2] = u;
}

LG_POLICY_RECORDING(record_planned) {
    const uint32_t m = p->inputs;
    const lg_policy_seen seen = seen_of(p, tape, in[0]);
    double half[LG_POLICY_INPUTS];
    lg_var by[LG_POLICY_PLANNED];
    for (uint32_t i = 0; i < LG_POLICY_PLANNED; i++) by[i] = lg_slice(tape, in[2], 1, i, 1);
    for (uint32_t l = 0; l < m; l++) half[l] = lg_policy_half_range(p, l);
    const lg_var size = row_of(tape, half, m),
                 K = lg_input_f64(tape, lg_shape2(m, p->layout.errors), p->regulator.K),
                 own =
                     call_policy(tape, p, seen,
                                 p->parameters > 0 ? theta[lg_program_parameters(p->program) - 1] : LG_NONE),
                 held = feedback(tape, p, lg_policy_record_errors(tape, p, false, seen), K),
                 back = lg_add(tape, lg_mul(tape, own, by[0]), lg_mul(tape, held, by[1])),
                 r = lg_add(tape, lg_mul(tape, in[1], size), back), within = saturated(tape, p, r),
                 over = lg_sub(tape, r, within), parts = lg_div(tape, over, size);
    close_loop(tape, p, in[0], seen, lg_add(tape, within, lg_mul(tape, over, by[LG_POLICY_BEYOND])), out);
    out[1] = lg_add(tape, out[1], lg_mul(tape, lg_rowdot(tape, parts, parts), by[LG_POLICY_PENALTY]));
}

LG_POLICY_RECORDING(record_terminal) {
    static const double end = 13.0; /* V_end/c */
    const lg_policy_seen seen = seen_of(p, tape, in[0]);
    const lg_var z = lg_policy_record_errors(tape, p, false, seen);
    const lg_var from = lg_add_scalar(tape, lg_scale(tape, level_of(tape, p, seen, z), 1.0 / end), 1.0);
    out[0] = lg_scale(tape, lg_log(tape, from), p->terminal);
}

/* ---- disturbed runs: the state is x, then the inputs before the oldest ones in x ---- */

/* What a run is in, from the parts of its state. */
static lg_var plant_state(lg_tape *tape, const lg_policy *p, lg_var s) {
    return lg_slice(tape, s, 1, 0, p->state);
}

/* Outputs of a period in which the controller asks for u: it acts as the plant delays it, or a period later
 * still. */
static void close_late_loop(lg_tape *tape, const lg_policy *p, lg_var s, lg_var u, lg_var late, lg_var *out) {
    const lg_var x = plant_state(tape, p, s), dropped = lg_slice(tape, s, 1, p->state, p->inputs);
    const lg_var next[] = {lg_policy_record_period(tape, p, x, u, dropped, late),
                           lg_policy_record_dropped(tape, p, x, u)};
    /* Without past inputs in x, the input that acts. */
    if (p->memory.lines == 0) u = lg_add(tape, u, lg_mul(tape, lg_sub(tape, dropped, u), late));
    out[0] = lg_concat(tape, next, 2, 1);
    out[1] = record_cost(tape, p, seen_of(p, tape, x), u);
    out[2] = u;
}

/* What noisy sensors see. */
static lg_policy_seen sense(lg_tape *tape, const lg_policy *p, lg_var s, lg_var noise) {
    return lg_policy_record_noise(tape, p, seen_of(p, tape, plant_state(tape, p, s)), noise);
}

/* A period of runs of the policy or of the saturated regulator of the gain in[1]. Inputs: the state, the
 * weights if there are any, or the gain, and of disturbed runs noise and late. */
static void run_period(lg_tape *tape, const lg_policy *p, bool disturbed, bool regulated, const lg_var *in,
                       lg_var *out) {
    const size_t own = regulated || p->parameters > 0 ? 1 : 0;
    const lg_policy_seen seen = disturbed ? sense(tape, p, in[0], in[1 + own]) : seen_of(p, tape, in[0]);
    const lg_var u = regulated ? feedback(tape, p, lg_policy_record_errors(tape, p, false, seen), in[1])
                               : call_policy(tape, p, seen, own > 0 ? in[1] : LG_NONE);
    if (disturbed)
        close_late_loop(tape, p, in[0], u, in[2 + own], out);
    else
        close_loop(tape, p, in[0], seen, u, out);
}
#define RUN(function, disturbed, regulated)                                                                  \
    LG_POLICY_RECORDING(function) {                                                                          \
        run_period(tape, p, disturbed, regulated, in, out);                                                  \
    }
RUN(record_closed, false, false)
RUN(record_regulated, false, true)
RUN(record_disturbed, true, false)
RUN(record_disturbed_regulator, true, true)
#undef RUN

LG_POLICY_RECORDING(record_disturbed_end) {
    const lg_var x = plant_state(tape, p, in[0]);
    out[0] = lg_program_call(tape, "terminal", 0, &x);
}

/* ---- adding them ---- */

static const lg_policy_function rows[] = {
    {"retract", record_retract, {"small z"}, {"x"}},
    {"errors", record_errors, {"x"}, {"z"}},
    {"period", record_period, {"x", "u"}, {"next"}},
    {"lagged", record_lagged, {"lagged", "u"}, {"next"}},
    {"linear", record_linear, {"small z", "u"}, {"next_z"}},
    {"regulated", record_regulated, {"x", "K"}, {"next", "cost", "u"}},
    {"policy", record_policy, {"q", "v", "weights"}, {"u"}},
    {"control", record_control, {"given"}, {"u"}},
    {"track", record_track, {"given", "reference"}, {"u"}},
    {"terminal", record_terminal, {"x"}, {"cost"}},
    {"closed", record_closed, {"x", "weights"}, {"next", "cost", "u"}},
    {"sensed_by_control", record_sensed, {"x"}, {"sensed"}},
    {"planned", record_planned, {"x", "y", "how"}, {"next", "cost", "u"}},
    {"disturbed_regulator", record_disturbed_regulator, {"s", "K", "noise", "late"}, {"next", "cost", "u"}},
    {"disturbed", record_disturbed, {"s", "weights", "noise", "late"}, {"next", "cost", "u"}},
    {"disturbed_end", record_disturbed_end, {"s"}, {"cost"}}};

/* Adds the adjoint of a function: with respect to its first two inputs (the state, and the weights or y), for
 * its outputs next state and cost. */
static lg_status add_adjoint(const lg_policy *p, const char *function, lg_error *error) {
    size_t number, ins, outs;
    lg_derivative what;
    LG_TRY(lg_program_find(p->program, function, &number, error));
    const lg_port *from = lg_program_inputs(p->program, number, &ins),
                  *to = lg_program_outputs(p->program, number, &outs);
    const char *const in[] = {from[0].name, ins > 1 ? from[1].name : NULL}, *const out[] = {
                                                                                to[0].name,
                                                                                outs > 1 ? to[1].name : NULL};
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_ADJOINT, what.function = function, what.inputs = in, what.outputs = out;
    what.input_count = ins < 2 ? ins : 2, what.output_count = outs < 2 ? outs : 2;
    return lg_program_derive(p->program, &what, error);
}

lg_status lg_policy_add(const lg_policy *p, const char *name, lg_error *error) {
    const lg_policy_function *row = rows;
    if (strncmp(name, "adj1_", 5) == 0) return add_adjoint(p, name + 5, error);
    while (strcmp(row->name, name) != 0) row++;
    return lg_policy_add_row(p, row, error);
}

static lg_status add_all(const lg_policy *p, const char *const *names, size_t count, lg_error *error) {
    for (size_t i = 0; i < count; i++) LG_TRY(lg_policy_add(p, names[i], error));
    return LG_OK;
}

lg_status lg_policy_begin(lg_policy *policy, const lg_program *plant, lg_error *error) {
    const size_t own = policy->parameters > 0 ? 1 : 0;
    size_t count = lg_program_parameters(plant) + own, found;
    if (own && count > 1 && strcmp(lg_program_parameter(plant, count - 2).name, "policy") == 0) count--;
    lg_program_spec spec;
    LG_TRY_SCRATCH(lg_parameter_spec, parameters, policy->context, count, lg_no_memory(error));
    for (size_t i = 0; i + own < count; i++) parameters[i] = lg_program_parameter(plant, i);
    if (own)
        parameters[count - 1] = (lg_parameter_spec){"policy", lg_shape1((uint32_t)policy->parameters), NULL};
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = count;
    const bool again = lg_program_find(plant, "retract", &found, NULL) == LG_OK;
    spec.description = again ? lg_program_description(plant) : "a machine with its controller";
    LG_TRY(lg_program_begin(policy->context, &spec, &policy->program, error));
    LG_TRY(copy_functions(policy, plant, error));
    LG_TRY(lg_policy_add_memory(policy, error));
    return lg_policy_add(policy, "retract", error);
}

lg_status lg_policy_add_motion(lg_policy *p, lg_error *error) {
    LG_TRY(add_all(p, (const char *const[]){"errors", "period"}, 2, error));
    if (p->memory.count > 0)
        LG_TRY(p->believes == NULL ? lg_policy_add_remember(p, error) : LG_OK);
    else if (lg_policy_has(p, "lag"))
        LG_TRY(lg_policy_add(p, "lagged", error));
    LG_TRY(lg_policy_add(p, "linear", error));
    return lg_program_jacobian(p->program, "linear", error);
}

lg_status lg_policy_add_regulated(lg_policy *p, lg_error *error) {
    const char *const names[] = {"regulated", "disturbed_regulator"};
    return add_all(p, names, lg_policy_is_disturbed(&p->task) ? 2 : 1, error);
}

lg_status lg_policy_add_disturbed(lg_policy *p, lg_error *error) {
    static const char *const names[] = {"disturbed", "disturbed_end", "adj1_disturbed_end", "adj1_disturbed"};
    return add_all(p, names, LG_COUNT(names), error);
}

lg_status lg_policy_add_functions(lg_policy *p, lg_error *error) {
    static const char *const names[] = {"terminal", "closed", "adj1_terminal", "adj1_closed"};
    LG_TRY(add_all(p, (const char *const[]){"policy", "control", "track"},
                   lg_policy_tracked(&p->task) > 0 ? 3 : 2, error));
    LG_TRY(add_all(p, names, LG_COUNT(names), error));
    return lg_policy_is_disturbed(&p->task) ? lg_policy_add_disturbed(p, error) : LG_OK;
}
