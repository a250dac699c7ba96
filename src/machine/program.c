/* A learned machine as a bundle of functions in the units of the log. Functions that are recorded in scaled
 * units have their inputs divided by factors and their results multiplied by factors. Steps are taken in the
 * log's units. */
#include <math.h>

#include "autodiff/program/program.h"
#include "machine/internal.h"

/* Bound on the numbers of a state: of positions, velocities, bristles and lagged inputs together. */
enum { MOST = LG_MACHINE_POSITIONS + 2 * LG_MACHINE_VELOCITIES + LG_MACHINE_LAGS };

typedef struct recording {
    const lg_machine *machine;
    const lg_scheme *scheme; /* of the function `step` */
    lg_space space, full;    /* of mechanical states; of states with lagged inputs at their end */
    uint32_t seen;           /* lagged inputs behind the positions of `momenta` and `positions` */
    /* A number in the log's units is the scaled number times its factor. */
    double state[MOST], field[MOST], positions[LG_MACHINE_POSITIONS + LG_MACHINE_LAGS],
        velocities[LG_MACHINE_VELOCITIES];
} recording;

/* ---- factors ---- */

/* Factors of states and of the field: momenta p = dL/dv have E T/L, their rates of change E/L. */
static void fill_state(recording *r) {
    const lg_machine *machine = r->machine;
    const lg_machine_scales *s = &machine->scales;
    double *state = r->state, *field = r->field;
    for (uint32_t k = 0; k < machine->places; k++) {
        *state++ = s->place[k];
        *field++ = s->place[k] / s->time;
    }
    for (uint32_t k = 0; k < 6 * machine->directions; k++) {
        const bool turns = k % 6 < 3;
        *state++ = turns ? 1.0 : s->energy * s->time;
        *field++ = turns ? 1.0 / s->time : s->energy;
    }
    for (uint32_t k = 0; k < 9 * machine->rotations; k++) *state++ = 1.0;
    for (uint32_t k = 0; k < 3 * machine->rotations; k++) *field++ = 1.0 / s->time;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const double *L = s->velocity + at.velocity;
        for (uint32_t k = 0; at.directions == 0 && k < at.velocities; k++) {
            *state++ = s->energy * s->time / L[k];
            *field++ = s->energy / L[k];
        }
    }
    for (uint32_t k = 0; k < machine->bristles; k++) {
        *state++ = s->velocity[k];
        *field++ = s->velocity[k] / s->time;
    }
    for (uint32_t k = 0; k < machine->lags; k++) {
        *state++ = s->input[machine->lagged[k]];
        *field++ = s->input[machine->lagged[k]] / s->time;
    }
}

static void fill_log(recording *r) {
    const lg_machine *machine = r->machine;
    for (uint32_t k = 0; k < machine->positions; k++) r->positions[k] = 1.0;
    for (uint32_t k = 0; k < machine->velocities; k++) r->velocities[k] = 1.0;
    lg_machine_unscale_row(machine, r->positions, r->velocities);
    for (uint32_t k = 0; k < r->seen; k++)
        r->positions[machine->positions + k] = machine->scales.input[machine->lagged[k]];
}

/* Multiplies the columns of x (B, n) by their factors, or divides by them; returns x itself where all factors
 * are 1. */
static lg_var times(lg_tape *tape, lg_var x, const double *factors, uint32_t n, bool divided) {
    double by[MOST];
    bool any = false;
    for (uint32_t k = 0; k < n; k++) {
        by[k] = divided ? 1.0 / factors[k] : factors[k];
        any = any || factors[k] != 1.0;
    }
    return any ? lg_mul(tape, x, lg_input_f64(tape, lg_shape2(1, n), by)) : x;
}

/* ---- functions ---- */

static lg_status bind(const recording *r, lg_tape *tape, const lg_var *theta, lg_machine_vars *vars) {
    return lg_machine_bind(tape, r->machine, r->machine->parameters > 0 ? theta[0] : LG_NONE, vars);
}

/* Binds theta and splits x, a state in the log's units, into scaled parts. */
static lg_status open_state(const recording *r, lg_tape *tape, const lg_var *theta, lg_var x,
                            lg_machine_vars *vars, lg_var *parts) {
    LG_TRY(bind(r, tape, theta, vars));
    return lg_taped_split(tape, &r->full, times(tape, x, r->state, (uint32_t)r->full.dim, true), parts);
}

/* A function of a state: `recorded`, in scaled units, times its factors (count). */
#define OF_STATE(name, recorded, factors, count)                                                             \
    static lg_status name(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {      \
        const recording *r = user;                                                                           \
        lg_machine_vars vars;                                                                                \
        lg_var parts[LG_TAPED_MAX_PARTS];                                                                    \
        LG_TRY(open_state(r, tape, theta, x[0], &vars, parts));                                              \
        y[0] = times(tape, recorded, factors, count, false);                                                 \
        return lg_tape_status(tape);                                                                         \
    }

static lg_var positions_of(const recording *r, lg_tape *tape, const lg_machine_vars *vars,
                           const lg_var *parts) {
    const lg_var q = lg_machine_record_positions(tape, vars, parts);
    return r->seen == 0 ? q : lg_concat(tape, (lg_var[]){q, parts[lg_taped_parts(&r->space)]}, 2, 1);
}

OF_STATE(value, lg_machine_record_energy(tape, &vars, parts), &r->machine->scales.energy, 1)
OF_STATE(velocities, lg_machine_record_velocities(tape, &vars, parts), r->velocities, r->machine->velocities)
OF_STATE(positions, positions_of(r, tape, &vars, parts), r->positions, r->machine->positions + r->seen)

static lg_status gradient(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    LG_TRY(value(user, tape, theta, x, y));
    return lg_grad(tape, y[0], x, 1, y + 1);
}

static bool is_second(const lg_machine *machine, uint32_t k) {
    return k > 0 && machine->lagged[k - 1] == machine->lagged[k];
}

/* What the lagged inputs x follow, (B, lags): the input, or the lagged input before. x LG_NONE: the input. */
static lg_var followed(lg_tape *tape, const lg_machine *machine, lg_var u, lg_var x) {
    lg_var each[LG_MACHINE_LAGS];
    bool all = machine->lags == machine->input_count;
    for (uint32_t k = 0; k < machine->lags; k++) all = all && machine->lagged[k] == k;
    if (all) return u;
    for (uint32_t k = 0; k < machine->lags; k++)
        each[k] = is_second(machine, k) && !lg_is_none(x)
                      ? lg_machine_columns(tape, x, k - 1, 1)
                      : lg_machine_columns(tape, u, machine->lagged[k], 1);
    return lg_joined(tape, each, machine->lags);
}

static lg_status field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    const uint32_t m = r->machine->input_count;
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS];
    LG_TRY(open_state(r, tape, theta, x[0], &vars, parts));
    lg_var u = m > 0 ? times(tape, x[1], r->machine->scales.input, m, true) : LG_NONE;
    if (r->machine->lags > 0) {
        const size_t last = lg_taped_parts(&r->space);
        const lg_var left = lg_sub(tape, followed(tape, r->machine, u, parts[last]), parts[last]);
        algebra[last] = lg_mul(tape, left, lg_exp(tape, lg_neg(tape, vars.lag)));
        u = lg_machine_put_lagged(tape, r->machine, u, parts[last]);
    }
    LG_TRY(lg_machine_record_field(tape, &vars, parts, u, algebra));
    y[0] = times(tape, lg_taped_join_algebra(tape, &r->full, algebra), r->field,
                 (uint32_t)r->full.algebra_dim, false);
    return lg_tape_status(tape);
}

static lg_status momenta(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    const uint32_t positions = r->machine->positions;
    LG_TRY(bind(r, tape, theta, &vars));
    const lg_var all = times(tape, x[0], r->positions, positions + r->seen, true),
                 v = times(tape, x[1], r->velocities, r->machine->velocities, true);
    const lg_var q = r->seen > 0 ? lg_machine_columns(tape, all, 0, positions) : all;
    LG_TRY(lg_machine_record_state(tape, &vars, q, v, parts));
    if (r->seen > 0) {
        parts[lg_taped_parts(&r->space)] = lg_machine_columns(tape, all, positions, r->seen);
    } else if (r->machine->lags > 0) {
        const lg_var zeros = lg_full(tape, lg_shape2(lg_rows_of(tape, parts[0]), r->machine->lags), 0.0);
        lg_tape_mark_rows(tape, zeros);
        parts[lg_taped_parts(&r->space)] = zeros;
    }
    y[0] = times(tape, lg_taped_join(tape, &r->full, parts), r->state, (uint32_t)r->full.dim, false);
    return lg_tape_status(tape);
}

/* ---- steps with lags, and steps of machine/step.c ----
 *
 * The machine is stepped by the scheme, with the lagged inputs u + (x - u) e^(-t/tau) at each stage, and of a
 * second-order lag u + (x_2 - u + (x_1 - u) t/tau) e^(-t/tau). Machines with bristles or with friction that
 * sticks, and variational steps, take the steps of fits. */

typedef struct lagging {
    const recording *r;
    /* At the start the lagged inputs x, u, x - u, and for second-order lags x_1 - u, 0 in the other columns
     * (LG_NONE: all are of first order), each (B, lags); 1/tau (1, lags). */
    lg_var x, u, left, first, rate;
} lagging;

static lg_var lagged_after(lg_tape *tape, const lagging *l, lg_var t) {
    const lg_var z = lg_mul(tape, t, l->rate), E = lg_exp(tape, lg_neg(tape, z));
    const lg_var left = lg_is_none(l->first) ? l->left : lg_add(tape, l->left, lg_mul(tape, l->first, z));
    return lg_add(tape, l->u, lg_mul(tape, left, E));
}

static lg_status held_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                            lg_var *algebra) {
    const lagging *l = user;
    const size_t last = lg_taped_parts(&l->r->space);
    lg_var parts[LG_TAPED_MAX_PARTS], all[LG_TAPED_MAX_PARTS];
    for (size_t i = 0; i < last; i++) parts[i] = y[i];
    parts[last] = l->x;
    if (l->r->machine->lags > 0 && lg_taped_time_varies(t))
        parts[last] = lagged_after(tape, l, lg_taped_time_rows(tape, t, lg_rows_of(tape, y[0])));
    const lg_var in[2] = {lg_taped_join(tape, &l->r->full, parts), input};
    LG_TRY(lg_taped_split_algebra(tape, &l->r->full, lg_program_call(tape, "field", 0, in), all));
    for (size_t i = 0; i < last; i++) algebra[i] = all[i];
    return lg_tape_status(tape);
}

/* What the lags of the state's part x start with. */
static void begin_lags(const recording *r, lg_tape *tape, const lg_machine_vars *vars, lg_var u, lagging *l) {
    l->u = followed(tape, r->machine, u, LG_NONE);
    l->left = lg_sub(tape, l->x, l->u);
    for (uint32_t k = 0; k < r->machine->lags && lg_is_none(l->first); k++)
        if (is_second(r->machine, k)) l->first = lg_sub(tape, followed(tape, r->machine, u, l->x), l->u);
    l->rate = lg_scale(tape, lg_exp(tape, lg_neg(tape, vars->lag)), 1.0 / r->machine->scales.time);
}

/* The scaled inputs u, after their lags, at the time s h. */
static lg_var input_at(const recording *r, lg_tape *tape, const lagging *l, lg_var u, lg_var h, double s) {
    const lg_machine *machine = r->machine;
    const lg_var own = times(tape, u, machine->scales.input, machine->input_count, true);
    if (machine->lags == 0) return own;
    const lg_var x = s > 0.0 ? lagged_after(tape, l, lg_scale(tape, h, s)) : l->x;
    return lg_machine_put_lagged(tape, machine, own,
                                 times(tape, x, r->state + r->space.dim, machine->lags, true));
}

static bool has_own_step(const recording *r) {
    return r->scheme->kind == LG_SCHEME_VARIATIONAL || r->machine->bristles > 0 || r->machine->sticks != 0;
}

/* Moves `parts`, which are in the log's units, by a step of machine/step.c. Inputs after a lag are parabolas.
 * Places change by the scaled change times its unit, so that a coordinate that sticks keeps its place to the
 * last bit. */
static lg_status own_step(const recording *r, lg_tape *tape, const lg_machine_vars *vars, const lagging *l,
                          lg_var input, lg_var h, lg_var *parts) {
    const uint32_t dim = (uint32_t)r->space.dim;
    const int at = lg_machine_parts(r->machine).x;
    const lg_machine_flow flow = {.vars = vars, .scheme = r->scheme, .substeps = 1, .space = r->space};
    const double parabola[3][3] = {{1.0}, {-3.0, 4.0, -1.0}, {2.0, -4.0, 2.0}};
    lg_var scaled[LG_TAPED_MAX_PARTS], u[4] = {LG_NONE, LG_NONE, LG_NONE, LG_NONE}, in[3], place;
    LG_TRY(lg_taped_split(tape, &r->space,
                          times(tape, lg_taped_join(tape, &r->space, parts), r->state, dim, true), scaled));
    const size_t points = lg_is_none(input) ? 0 : r->machine->lags > 0 ? 3 : 1;
    for (size_t i = 0; i < points; i++) in[i] = input_at(r, tape, l, input, h, 0.5 * i);
    for (size_t i = 0; i < points; i++) u[i] = lg_linear_combination(tape, in, parabola[i], points);
    if (at >= 0) place = scaled[at];
    LG_TRY(lg_machine_record_interval_of(tape, &flow, u, lg_scale(tape, h, 1.0 / r->machine->scales.time),
                                         scaled));
    if (at >= 0)
        place = lg_add(tape, parts[at],
                       times(tape, lg_sub(tape, scaled[at], place), r->state, r->machine->places, false));
    LG_TRY(lg_taped_split(tape, &r->space,
                          times(tape, lg_taped_join(tape, &r->space, scaled), r->state, dim, false), parts));
    if (at >= 0) parts[at] = place;
    return lg_tape_status(tape);
}

static lg_status held_step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    const size_t last = lg_taped_parts(&r->space);
    const bool driven = r->machine->input_count > 0;
    const lg_var u = driven ? x[1] : LG_NONE, h = x[driven ? 2 : 1];
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    LG_TRY(bind(r, tape, theta, &vars));
    LG_TRY(lg_taped_split(tape, &r->full, x[0], parts));
    lagging l = {.r = r, .first = LG_NONE};
    if (r->machine->lags > 0) l.x = parts[last], begin_lags(r, tape, &vars, u, &l);
    const lg_taped_ode ode = {.space = r->space, .field = held_field, .user = &l};
    const lg_taped_interval over = {.h_rows = h, .input = u};
    if (has_own_step(r))
        LG_TRY(own_step(r, tape, &vars, &l, u, h, parts));
    else
        LG_TRY(lg_taped_step(tape, r->scheme, &ode, &over, parts, parts));
    if (r->machine->lags > 0) parts[last] = lagged_after(tape, &l, h);
    y[0] = lg_taped_join(tape, &r->full, parts);
    return lg_tape_status(tape);
}

/* The lagged inputs a after h under u, (a, u, h). */
static lg_status lag(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_machine_vars vars;
    lagging l = {.r = r, .x = x[0], .first = LG_NONE};
    LG_TRY(bind(r, tape, theta, &vars));
    begin_lags(r, tape, &vars, x[1], &l);
    y[0] = lagged_after(tape, &l, x[2]);
    return lg_tape_status(tape);
}

static lg_status add_lag(lg_program *program, const recording *r, lg_error *error) {
    size_t field_at, count;
    LG_TRY(lg_program_find(program, "field", &field_at, error));
    const lg_port in[] = {{.name = "a", .shape = lg_shape1(r->seen), .low = -1, .high = 1},
                          lg_program_inputs(program, field_at, &count)[1],
                          {.name = "h", .shape = lg_shape1(1), .low = 0.001, .high = 0.05}},
                  next = {.name = "next"};
    const lg_function_spec spec = {"lag", in, 3, &next, 1, lag, (void *)(uintptr_t)r};
    return lg_program_add_function(program, &spec, error);
}

static lg_status add_step(lg_program *program, const recording *r, lg_error *error) {
    const double low = 0.001 * r->machine->scales.time, high = 0.05 * r->machine->scales.time;
    if (!has_own_step(r) && r->machine->lags == 0)
        return lg_program_add_step(program, &r->space, r->scheme, low, high, error);
    return lg_program_put_step(program, low, high, held_step, (void *)(uintptr_t)r, error);
}

/* ---- the bundle ---- */

/* A port of the program. Its range for random numbers is the smallest factor, so that no number is far beyond
 * its scale. */
static lg_port port_of(const char *name, const double *factors, uint32_t n) {
    double least = INFINITY;
    for (uint32_t k = 0; k < n; k++) least = fmin(least, factors[k]);
    return (lg_port){.name = name, .shape = lg_shape1(n), .low = -least, .high = least};
}

static lg_status build(const lg_context *context, recording *r, const double *theta, lg_program **out,
                       lg_error *error) {
    const lg_machine *machine = r->machine;
    const uint32_t m = machine->input_count;
    const size_t inputs = m > 0 ? 2 : 1;
    lg_port in[2] = {port_of("x", r->state, (uint32_t)r->full.dim)};
    if (m > 0) in[1] = port_of("u", machine->scales.input, m);
    const lg_port logged[2] = {port_of("q", r->positions, machine->positions + r->seen),
                               port_of("v", r->velocities, machine->velocities)};
    const lg_port energy[2] = {{.name = "y"}, {.name = "g"}}, rate = {.name = "f"}, state = {.name = "x"};
    lg_function_spec functions[] = {
        {"value", in, 1, energy, 1, value, r},
        {"grad", in, 1, energy, 2, gradient, r},
        {"field", in, inputs, &rate, 1, field, r},
        {"momenta", logged, 2, &state, 1, momenta, r},
        {"velocities", in, 1, &logged[1], 1, velocities, r},
        {"positions", in, 1, &logged[0], 1, positions, r},
    };
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)machine->parameters), theta};
    const lg_program_spec spec = {.size = sizeof spec,
                                  .parameters = &weights,
                                  .parameter_count = machine->parameters > 0 ? 1 : 0,
                                  .functions = functions,
                                  .function_count = LG_COUNT(functions),
                                  .description =
                                      "a learned machine with inputs and damping, in the units of its log"};
    return lg_program_build(context, &spec, out, error);
}

lg_status lg_machine_program(const lg_context *context, const lg_machine *machine, const double *theta,
                             const lg_scheme *scheme, bool lagged, lg_program **out, lg_error *error) {
    LG_NEEDS(error, machine, out);
    if (machine->parameters > 0) LG_NEEDS(error, theta);
    recording r = {.machine = machine,
                   .scheme = scheme != NULL ? scheme : lg_scheme_find("cf4"),
                   .seen = lagged ? machine->lags : 0};
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    LG_TRY(lg_machine_space(machine, &r.space));
    LG_TRY(lg_machine_full_space(machine, &r.full));
    fill_state(&r);
    fill_log(&r);
    LG_TRY(build(context, &r, theta, &made, error));
    LG_TRY(add_step(made, &r, error));
    if (r.seen > 0) LG_TRY(add_lag(made, &r, error));
    LG_TRY(lg_program_add_velocity(made, &r.full, error));
    return LG_MOVE(out, made);
}
