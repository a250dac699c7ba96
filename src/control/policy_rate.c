/* Policies: the closed loop as certificates need it. z = (positions - goal, velocities), angles counted; free
 * positions are no part of z. */
#include <math.h>

#include "autodiff/tape/tape_internal.h"
#include "control/policy.h"
#include "model/record.h"

static bool moves(const lg_policy *p) {
    return p->layout.velocities > 0;
}

/* The numbers of coordinates that are not free, from numbers of all coordinates. LG_NONE: all are free. */
static lg_var gathered(const lg_policy *p, lg_tape *tape, lg_var all) {
    lg_var parts[LG_POLICY_COORDINATES];
    uint32_t n = 0;
    if (p->layout.at[0].rate == p->layout.positions) return all;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++)
        if (!p->task.coordinate[i].free) parts[n++] = lg_columns(tape, all, i, 1);
    return n == 0 ? LG_NONE : lg_joined(tape, parts, n);
}

/* What acts during a period that begins at z. K LG_NONE: by the policy */
static lg_var acting_at(const lg_policy *p, lg_tape *tape, const lg_var *theta, lg_var z, lg_var K) {
    const lg_policy_seen at = lg_policy_record_place(tape, p, z);
    const lg_var x = lg_program_call(tape, "retract", 0, &z);
    lg_var in[3] = {at.q, at.v};
    if (p->parameters > 0) in[moves(p) ? 2 : 1] = theta[lg_program_parameters(p->program) - 1];
    const lg_var u = lg_is_none(K) ? lg_program_call(tape, "policy", 0, in)
                                   : lg_program_call(tape, "regulated", 2, (const lg_var[]){x, K});
    return lg_policy_record_acting(tape, p, x, at, u);
}

LG_POLICY_RECORDING(record_input) {
    out[0] = acting_at(p, tape, theta, in[0], LG_NONE);
}

static lg_status record_rate_by_input(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                      lg_var *out) {
    const lg_policy *p = user;
    const lg_policy_memory *m = &p->memory;
    const lg_policy_seen at = lg_policy_record_place(tape, p, in[0]);
    const lg_var x = lg_policy_plant_part(tape, p, lg_program_call(tape, "retract", 0, in)),
                 f = lg_program_call(tape, "field", 0,
                                     (const lg_var[]){x, lg_columns(tape, in[1], 0, p->inputs)});
    lg_var parts[3] = {moves(p) ? at.v : f};
    uint32_t n = 1;
    if (moves(p) && m->lags > 0) parts[n++] = lg_columns(tape, f, m->plant - m->lags, m->lags);
    if (m->count > 0) parts[n++] = lg_columns(tape, in[1], p->inputs, m->count);
    out[0] = gathered(p, tape, lg_joined(tape, parts, n));
    if (!moves(p)) return lg_tape_status(tape);
    const lg_var v = lg_program_call(tape, lg_policy_plant_name(p, "velocities"), 0, &x);
    parts[0] = out[0];
    LG_TRY(lg_jvp(tape, &v, 1, &x, &f, 1, &parts[1]));
    out[0] = lg_is_none(parts[0]) ? parts[1] : lg_concat(tape, parts, 2, 1);
    return lg_tape_status(tape);
}

/* z after a period in which `acting` is held, by the classical Runge-Kutta method. */
LG_POLICY_RECORDING(record_advance_by_input) {
    const double h = p->task.period / p->task.substeps, to[4] = {0, 0.5 * h, 0.5 * h, h},
                 weight[4] = {h / 6, h / 3, h / 3, h / 6};
    out[0] = in[0];
    for (uint32_t step = 0; step < p->task.substeps; step++) {
        const lg_var z = out[0];
        lg_var rate = LG_NONE;
        for (int stage = 0; stage < 4; stage++) {
            const lg_var at = stage == 0 ? z : lg_add(tape, z, lg_scale(tape, rate, to[stage]));
            rate = lg_program_call(tape, "rate_by_input", 0, (const lg_var[]){at, in[1]});
            out[0] = lg_add(tape, out[0], lg_scale(tape, rate, weight[stage]));
        }
    }
}

/* The same with the policy, and with the saturated regulator of the gains in[1]. */
#define CLOSED(function, name, K)                                                                            \
    LG_POLICY_RECORDING(function) {                                                                          \
        out[0] =                                                                                             \
            lg_program_call(tape, name, 0, (const lg_var[]){in[0], acting_at(p, tape, theta, in[0], K)});    \
    }
CLOSED(record_rate, "rate_by_input", LG_NONE)
CLOSED(record_rate_by_gains, "rate_by_input", in[1])
CLOSED(record_advance, "advance_by_input", LG_NONE)
CLOSED(record_advance_by_gains, "advance_by_input", in[1])
#undef CLOSED

/* ---- adding them ---- */

/* Fails, because of `why`, if operations of the plant's rates use the position of a coordinate. */
static lg_status check_unused(const lg_policy *p, uint32_t coordinate, const char *why, lg_error *error) {
    size_t field, ports;
    LG_TRY(lg_program_find(p->program, "field", &field, error));
    const size_t n = lg_shape_count(lg_program_inputs(p->program, field, &ports)[0].shape);
    LG_TRY_SCRATCH(unsigned char, pattern, p->context, n *n, lg_no_memory(error));
    LG_TRY(lg_program_sparsity(p->program, field, 0, 0, pattern, error));
    for (size_t i = p->layout.at[coordinate].position; i < n * n; i += n)
        if (pattern[i] != 0)
            return lg_fail(error, LG_UNSUPPORTED, "the plant's motion depends on the position %s: %s",
                           p->task.coordinate[coordinate].name, why);
    return LG_OK;
}

static lg_status check(const lg_policy *p, lg_error *error) {
    LG_TRY(lg_policy_check_memory(p, false, error));
    if (!lg_policy_has(p, "field"))
        return lg_fail(error, LG_NOT_FOUND, "the plant has no function field (x, u)");
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        if (c->motion != LG_POLICY_LINE && c->motion != LG_POLICY_ANGLE)
            return lg_fail(error, LG_UNSUPPORTED,
                           "coordinate %s is a %s; certificates are for machines of lines and angles",
                           c->name, lg_policy_motion_row_of(c->motion)->name);
        if (c->free) LG_TRY(check_unused(p, i, "it is free, but a certificate cannot leave it out", error));
    }
    if (p->state != p->layout.positions + p->layout.velocities)
        return lg_fail(error, LG_UNSUPPORTED,
                       "besides positions and velocities the plant has %u more states (bristles, or inputs "
                       "that act later than the controller knows), which a certificate does not cover",
                       p->state - p->layout.positions - p->layout.velocities);
    return LG_OK;
}

lg_status lg_policy_add_rate(lg_policy *p, lg_program **program, lg_error *error) {
    LG_NEEDS(error, p, program);
    LG_TRY(check(p, error));
    static const lg_policy_function rows[] = {
        {"rate_by_input", record_rate_by_input, {"z", "acting"}, {"dz"}},
        {"input_by_state", record_input, {"z"}, {"u"}},
        {"advance_by_input", record_advance_by_input, {"z", "acting"}, {"next_z"}},
        {"rate", record_rate, {"z"}, {"dz"}},
        {"advance", record_advance, {"z"}, {"next_z"}},
        {"rate_by_gains", record_rate_by_gains, {"z", "K"}, {"dz"}},
        {"advance_by_gains", record_advance_by_gains, {"z", "K"}, {"next_z"}}};
    const size_t count = lg_policy_has(p, "regulated") ? LG_COUNT(rows) : LG_COUNT(rows) - 2;
    for (size_t i = 0; i < count; i++)
        if (!lg_policy_has(p, rows[i].name)) LG_TRY(lg_policy_add_row(p, &rows[i], error));
    *program = p->program;
    return LG_OK;
}

/* ---- one coordinate: the energy ---- */

LG_POLICY_RECORDING(record_slope) {
    const lg_var still[2] = {in[0], lg_scale(tape, in[0], 0.0)};
    const lg_var z = lg_concat(tape, still, 2, 1),
                 in_f[2] = {lg_program_call(tape, "retract", 0, &z), acting_at(p, tape, theta, z, LG_NONE)},
                 f = lg_program_call(tape, "field", 0, in_f);
    out[0] = lg_neg(tape, lg_slice(tape, f, 1, 1, 1));
}

static lg_status check_energy(const lg_policy *p, lg_error *error) {
    LG_TRY(check(p, error));
    LG_TRY(lg_policy_needs_energy(p, error));
    if (p->task.coordinate_count != 1 || p->inputs != 1)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the energy is certified for one coordinate and one input; the plant has %u and %u",
                       p->task.coordinate_count, p->inputs);
    if (p->task.coordinate[0].free)
        return lg_fail(error, LG_UNSUPPORTED, "%s is free, and the energy is certified for its position",
                       p->task.coordinate[0].name);
    return LG_OK;
}

lg_status lg_policy_add_slope(lg_policy *p, lg_policy_slope *out, lg_error *error) {
    static const lg_policy_function slope = {"slope", record_slope, {"one z"}, {"g"}};
    lg_policy_body machine;
    LG_NEEDS(error, p, out);
    LG_TRY(check_energy(p, error));
    if (p->task.coordinate[0].motion == LG_POLICY_LINE)
        LG_TRY(check_unused(p, 0, "the energy is certified for angles, or without a potential", error));
    LG_TRY(lg_policy_probe(p, &machine, error));
    const double damping = machine.damping[0], *task = p->task.gains,
                 kp = p->parameters > 0 ? exp(p->theta[0]) : task[0],
                 kd = p->parameters > 0 ? exp(p->theta[1]) : task[1];
    if (!(damping > 1e-9 * machine.mass[0] / p->task.horizon))
        return lg_fail(error, LG_CHECK_FAILED,
                       "the damping of %s is %.4g, not positive: the proof needs friction in the machine",
                       p->task.coordinate[0].name, damping);
    if (!lg_policy_has(p, "slope")) LG_TRY(lg_policy_add_row(p, &slope, error));
    const double u0 = p->regulator.u0[0], low = u0 - p->task.input[0].low, high = p->task.input[0].high - u0;
    out->damping = damping * (1 - 1e-6);
    out->gain = kd * p->G[1] * machine.map[0];
    out->saturated = fmax(low, high) / (kp * fabs(p->G[0])) * (1 + 1e-12);
    return LG_OK;
}
