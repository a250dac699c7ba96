/* Machines as programs and as models in a control loop, in the units of the log, compared with the recording
 * in scaled units and with closed forms. */
#include "support/tied_systems.h"
#include "support/model_support.h"
#include "support/plan_support.h"

#include "liegrad/geometry.h"
#include "liegrad/model.h"

enum { ROWS = 3, STATE = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES };

static lg_program *program_of(const lg_machine *machine, const double *theta, const char *scheme) {
    lg_program *program = NULL;
    assert_told(lg_machine_program(NULL, machine, theta, lg_scheme_find(scheme), false, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

/* A machine as a model, in a random state on the manifold. */
typedef struct driven {
    lg_machine machine;
    lg_space space;
    double *theta, q[STATE], v[STATE], y[STATE], u[LG_MACHINE_INPUTS];
    lg_model *model;
    void *work;
    size_t d, m, r;
} driven;

static driven *drive(const lg_machine *machine, uint64_t seed) {
    driven *s = TEST_ARRAY(driven, 1);
    s->machine = *machine;
    s->theta = machine_theta(machine, seed);
    assert_ok(lg_machine_space(machine, &s->space));
    assert_told(test_machine_model(NULL, machine, s->theta, &s->model, &told));
    lg_test_owns(s->model, release_model);
    s->work = test_work(lg_model_work_size(s->model));
    s->d = lg_model_inputs(s->model), s->m = lg_model_input_dim(s->model);
    s->r = lg_model_tangent_dim(s->model);
    random_rows(machine, seed, 1, s->q, s->v);
    memcpy(s->u, test_numbers(seed, LG_MACHINE_INPUTS, -1, 1), sizeof s->u);
    assert_ok(lg_model_machine_state(s->model, s->q, s->v, s->y, s->work));
    return s;
}

/* ---- the program compared with the recording in scaled units ---- */

/* Factors from scaled numbers to numbers in the log's units, for an algebra element, positions and
 * velocities. */
typedef struct factors {
    double field[STATE], q[STATE], v[STATE];
} factors;

static factors factors_of(const lg_machine *machine) {
    const lg_machine_scales *s = &machine->scales;
    const double T = s->time, E = s->energy;
    factors f = {{0}, {0}, {0}};
    double *field = f.field, *q = f.q, *v = f.v;
    const double *L;
    for (uint32_t k = 0; k < machine->places; k++) *field++ = s->place[k] / T;
    for (uint32_t k = 0; k < 6 * machine->directions; k++) *field++ = k % 6 < 3 ? 1.0 / T : E;
    for (uint32_t k = 0; k < 3 * machine->rotations; k++) *field++ = 1.0 / T;
    L = s->velocity;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        for (uint32_t k = 0; k < lg_coordinate_positions(machine->coordinates[i].kind); k++)
            *q++ = k < row->places ? L[k] : 1.0;
        for (uint32_t k = 0; k < row->velocities; k++, L++) {
            *v++ = *L / T;
            if (row->directions == 0) *field++ = E / *L;
        }
    }
    for (uint32_t k = 0; k < machine->bristles; k++) *field++ = s->velocity[k] / T;
    return f;
}

static void times(double *x, const double *factor, size_t rows, size_t n) {
    for (size_t i = 0; i < rows * n; i++) x[i] *= factor[i % n];
}

/* Sets the lagged inputs, which `momenta` has set to 0, to the inputs u that the recording sees, and changes
 * the inputs of the program; then the lags move by (u' - u)/tau. Compares these rates in `field`, and removes
 * them from it. */
static void set_lagged(const lg_machine *machine, size_t dim, double *x, double *u) {
    const uint32_t m = machine->input_count, n = machine->lags;
    for (uint32_t i = 0; i < ROWS; i++)
        for (uint32_t k = 0; k < n; k++) {
            double *own = x + i * (dim + n) + dim + k, *given = u + i * m + machine->lagged[k];
            assert_true(*own == 0.0);
            *own = *given;
            if (k + 1 < n && machine->lagged[k + 1] == machine->lagged[k])
                *own = 0.7; /* the terms do not see the first of two lags */
            else
                *given = 2.0 * *given + 0.3;
        }
}

/* What lagged input k follows: the input, or the lagged input before. */
static double followed(const lg_machine *machine, const double *u, const double *x, uint32_t k) {
    return k > 0 && machine->lagged[k - 1] == machine->lagged[k] ? x[k - 1] : u[machine->lagged[k]];
}

static void take_lagged(const lg_machine *machine, size_t dim, size_t algebra, const double *tau,
                        const double *x, const double *u, double *field) {
    const uint32_t m = machine->input_count, n = machine->lags;
    for (uint32_t i = 0; i < ROWS; i++) {
        const double *of = field + i * (algebra + n);
        for (uint32_t k = 0; k < n; k++)
            assert_close(
                of[algebra + k],
                (followed(machine, u + i * m, x + i * (dim + n) + dim, k) - x[i * (dim + n) + dim + k]) /
                    tau[k],
                1e-13, 1e-13);
        memmove(field + i * algebra, of, algebra * sizeof *field);
    }
}

/* Compares all functions of `program` at rows of a log with the tape's results for the same rows in scaled
 * units. */
static void check_recording(const lg_machine *machine) {
    const double *theta = machine_theta(machine, 5);
    const lg_program *program = program_of(machine, theta, "cf4");
    const factors f = factors_of(machine);
    lg_tape *tape = test_tape(LG_F64);
    lg_machine_vars vars;
    lg_space space;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS], flat[LG_TAPED_MAX_PARTS];
    double q[ROWS * STATE], v[ROWS * STATE], x[ROWS * STATE], got[ROWS * STATE], want[ROWS * STATE];
    const uint32_t m = machine->input_count;
    double *u = test_numbers(3, ROWS * LG_MACHINE_INPUTS, -1, 1);
    random_rows(machine, 7, ROWS, q, v);
    assert_ok(lg_machine_space(machine, &space));
    const lg_var vq = lg_input_f64(tape, lg_shape2(ROWS, machine->positions), q),
                 vv = lg_input_f64(tape, lg_shape2(ROWS, machine->velocities), v),
                 vu = m > 0 ? lg_input_f64(tape, lg_shape2(ROWS, m), u) : LG_NONE;
    const uint32_t n = (uint32_t)machine->parameters;
    assert_ok(
        lg_machine_bind(tape, machine, n > 0 ? lg_parameter(tape, lg_shape1(n), theta) : LG_NONE, &vars));
    assert_ok(lg_machine_record_state(tape, &vars, vq, vv, parts));
    assert_ok(lg_machine_record_field(tape, &vars, parts, vu, algebra));
    const lg_var H = lg_machine_record_energy(tape, &vars, parts);
    times(q, f.q, ROWS, machine->positions);
    times(v, f.v, ROWS, machine->velocities);
    for (uint32_t i = 0; i < ROWS * m; i++) u[i] *= machine->scales.input[i % m];
    const ready state = make_ready(program, "momenta", ROWS, LG_F64);
    lg_plan_eval(state.plan, (const void *const[]){q, v}, (void *const[]){x}, state.work);
    const ready value = make_ready(program, "value", ROWS, LG_F64);
    double tau[LG_MACHINE_LAGS];
    if (machine->lags > 0) assert_ok(lg_read(tape, vars.lag, machine->lags, tau));
    for (uint32_t k = 0; k < machine->lags; k++) tau[k] = machine->scales.time * exp(tau[k]);
    set_lagged(machine, space.dim, x, u);
    run_value(&value, x, got);
    for (int i = 0; i < ROWS; i++) got[i] /= machine->scales.energy;
    assert_reads(tape, H, ROWS, got, 1e-13, 1e-13);
    const ready field = make_ready(program, "field", ROWS, LG_F64);
    lg_plan_eval(field.plan, (const void *const[]){x, u}, (void *const[]){got}, field.work);
    take_lagged(machine, space.dim, space.algebra_dim, tau, x, u, got);
    size_t count = 0;
    for (size_t i = 0; i < lg_taped_parts(&space); i++) {
        const lg_shape shape = lg_var_shape(tape, algebra[i]);
        flat[count++] = lg_reshape(tape, algebra[i], lg_shape2(ROWS, (uint32_t)lg_shape_count(shape) / ROWS));
    }
    /* In the algebra element the parts of several directions alternate; here is at most one direction. */
    const lg_var all = count == 1 ? flat[0] : lg_concat(tape, flat, count, 1);
    assert_ok(lg_read(tape, all, ROWS * space.algebra_dim, want));
    times(want, f.field, ROWS, space.algebra_dim);
    assert_all_close(got, want, ROWS * space.algebra_dim, 1e-13, 1e-13);
    const ready positions = make_ready(program, "positions", ROWS, LG_F64);
    run_value(&positions, x, got);
    assert_all_close(got, q, ROWS * machine->positions, 1e-14, 1e-14);
    const ready velocities = make_ready(program, "velocities", ROWS, LG_F64);
    run_value(&velocities, x, got);
    assert_all_close(got, v, ROWS * machine->velocities, 1e-11, 1e-11);
}

TEST("a program equals the recording in the log's units, with every kind of coordinate and term") {
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_term_kind *kind;
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            check_recording(&machine);
        }
    }
}

TEST("a program of directions beside other coordinates equals the recording") {
    for (size_t i = 0; i < LG_COUNT(tied_rows); i++) {
        const lg_machine machine = tied_machine(tied_rows[i]);
        if (machine.directions == 1) check_recording(&machine);
    }
}

/* A machine with one coordinate of this kind and learned constants, with or without inputs. */
static lg_machine single(lg_coordinate_kind kind, bool forced) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "one", kind);
    if (forced) add_input(&machine, "u");
    odd_scales(&machine);
    add_term(&machine, LG_MACHINE_MASS, kind == LG_COORDINATE_DIRECTION ? "diagonal" : "constant");
    add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    if (forced) add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

TEST("machines of one coordinate have programs, with and without inputs and potential") {
    for (int kind = 0; kind < LG_COORDINATE_KIND_COUNT; kind++)
        for (int forced = 0; forced < 2; forced++) {
            const lg_machine machine = single((lg_coordinate_kind)kind, forced == 1);
            check_recording(&machine);
        }
}

/* ---- closed forms in the units of the log ---- */

static const double weight = 2.3, body[6] = {2, 2, 2, 0.3, 0.5, 0.7}, rod = 1.7,
                    drag[9] = {0.3, 0.3, 0.3, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6};

/* A direction and a pose with known constants. Input j pushes velocity 2 j + 1 by (j + 1). */
static lg_machine known_machine(void) {
    double mass[9] = {rod, rod, rod}, map[18] = {0};
    lg_machine machine = empty_machine();
    memcpy(mass + 3, body, sizeof body);
    for (int j = 0; j < 2; j++) map[2 * (2 * j + 1) + j] = j + 1;
    add_coordinate(&machine, "rod", LG_COORDINATE_DIRECTION);
    add_coordinate(&machine, "hull", LG_COORDINATE_POSE);
    add_input(&machine, "a");
    add_input(&machine, "b");
    odd_scales(&machine);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 9, mass);
    lg_machine_term *gravity = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
    add_feature(gravity, LG_FEATURE_HEIGHT, 0);
    add_feature(gravity, LG_FEATURE_HEIGHT, 1);
    add_values(gravity, 2, (double[]){weight, 2 * weight});
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "known"), 9, drag);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 18, map);
    assert_machine(&machine);
    return machine;
}

/* State: x, q, p, R, l, m. */
static void known_field(const driven *s, double *field, double *energy) {
    const double *q = s->y + 3, *p = s->y + 6, *R = s->y + 9, *l = s->y + 18, *m = s->y + 21;
    const double *omega = s->v, *w = s->v + 3, *Omega = s->v + 6, e3[3] = {0, 0, 1};
    double f[9], g[3], a[3], b[3];
    for (int i = 0; i < 9; i++) f[i] = -drag[i] * s->v[i];
    for (int j = 0; j < 2; j++) f[2 * j + 1] += (j + 1) * s->u[j];
    *energy = 0.5 * lg_dot3(p, p) / rod + weight * q[2] + 2 * weight * s->y[2] + 0.5 * lg_dot3(l, w) +
              0.5 * lg_dot3(m, Omega);
    lg_cross3(e3, q, g);
    for (int i = 0; i < 3; i++) {
        field[i] = lg_dot3(R + 3 * i, w);
        field[3 + i] = omega[i];
        field[6 + i] = weight * g[i] + f[i];
        field[9 + i] = lg_dot3(R + 3 * i, Omega);
    }
    lg_cross3(l, Omega, a);
    for (int i = 0; i < 3; i++) field[12 + i] = a[i] - 2 * weight * R[6 + i] + f[3 + i];
    lg_cross3(m, Omega, a);
    lg_cross3(l, w, b);
    for (int i = 0; i < 3; i++) field[15 + i] = a[i] + b[i] + f[6 + i];
}

TEST("a rod and a hull with known constants have momenta, energy and field of the closed form") {
    const lg_machine machine = known_machine();
    for (uint64_t seed = 1; seed < 4; seed++) {
        const driven *s = drive(&machine, seed);
        double want[STATE], got[STATE], momentum[3], energy, H;
        lg_cross3(s->v, s->q, momentum);
        for (int i = 0; i < 3; i++) assert_close(s->y[6 + i], rod * momentum[i], 1e-14, 1e-14);
        for (int i = 0; i < 6; i++) assert_close(s->y[18 + i], body[i] * s->v[3 + i], 1e-14, 1e-14);
        known_field(s, want, &energy);
        lg_model_eval(s->model, s->y, &H, s->work);
        assert_close(H, energy, 1e-13, 1e-13);
        assert_ok(lg_model_field(s->model, s->y, s->u, got, s->work));
        assert_all_close(got, want, 18, 1e-13, 1e-13);
        assert_int_equal(lg_model_parameters(s->model), 0);
    }
}

/* ---- the machine as lg_model ---- */

/* A machine with every kind of coordinate, a mass of networks, potential, damping, residual and inputs. */
static lg_machine learned_machine(void) {
    lg_machine machine = all_coordinates();
    lg_machine_term *mass = add_term(&machine, LG_MACHINE_MASS, "network");
    add_feature(mass, LG_FEATURE_POSITION, 1);
    add_feature(mass, LG_FEATURE_UP, 3);
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    see_everything(&machine, add_term(&machine, LG_MACHINE_POTENTIAL, "network"), false, false);
    add_term(&machine, LG_MACHINE_DAMPING, "constant");
    add_term(&machine, LG_MACHINE_DAMPING, "coulomb")->width = 0.5;
    see_everything(&machine, add_term(&machine, LG_MACHINE_INPUT_MAP, "network"), false, false);
    see_everything(&machine, add_term(&machine, LG_MACHINE_RESIDUAL, "network"), true, false);
    assert_machine(&machine);
    return machine;
}

TEST("a machine has the sizes of its space, and NULL as input means zero inputs") {
    const lg_machine machine = learned_machine();
    const driven *s = drive(&machine, 2);
    double free_run[STATE], zero[STATE], driven_by[STATE];
    const double none[2] = {0, 0};
    assert_int_equal(s->d, s->space.dim);
    assert_int_equal(lg_model_outputs(s->model), 1);
    assert_int_equal(lg_model_parameters(s->model), machine.parameters);
    assert_int_equal(s->m, 2);
    assert_int_equal(s->r, 5 + 4 + 6 + 11);
    assert_ok(lg_model_field(s->model, s->y, NULL, free_run, s->work));
    assert_ok(lg_model_field(s->model, s->y, none, zero, s->work));
    assert_ok(lg_model_field(s->model, s->y, s->u, driven_by, s->work));
    assert_memory_equal(free_run, zero, s->space.algebra_dim * sizeof *zero);
    double most = 0;
    for (size_t i = 0; i < s->space.algebra_dim; i++) most = fmax(most, fabs(driven_by[i] - zero[i]));
    assert_true(most > 1e-2);
}

TEST("a state that was made from positions and velocities gives them back") {
    const lg_machine machine = learned_machine();
    const driven *s = drive(&machine, 3);
    double q[STATE], v[STATE];
    assert_ok(lg_model_machine_positions(s->model, s->y, q, s->work));
    assert_all_close(q, s->q, machine.positions, 1e-14, 1e-14);
    assert_ok(lg_model_machine_velocities(s->model, s->y, v, s->work));
    assert_all_close(v, s->v, machine.velocities, 1e-10, 1e-10);
}

TEST("other kinds of model have no machine states") {
    lg_hamiltonian pendulum;
    lg_model *model;
    const double theta[5] = {0, 0, 1, 0, 1};
    double x[24] = {0};
    assert_ok(lg_hamiltonian_init(&pendulum, lg_hamiltonian_family_find("chain"), 1, LG_POTENTIAL_LINEAR,
                                  NULL, 0, LG_TANH));
    assert_ok(test_hamiltonian_model(NULL, &pendulum, theta, &model, NULL));
    lg_test_owns(model, release_model);
    void *work = test_work(lg_model_work_size(model));
    assert_status(lg_model_machine_state(model, x, x, x + 12, work), LG_UNSUPPORTED);
    assert_status(lg_model_machine_velocities(model, x, x + 12, work), LG_UNSUPPORTED);
    assert_status(lg_model_machine_positions(model, x, x + 12, work), LG_UNSUPPORTED);
    assert_status(lg_model_machine_state(NULL, x, x, x + 12, work), LG_INVALID_ARGUMENT);
}

TEST("a state that is not finite gives NaN everywhere") {
    const lg_machine machine = learned_machine();
    driven *s = drive(&machine, 5);
    double v[STATE];
    check_unfit(s->model, s->y, s->work);
    for (size_t i = 0; i < s->d; i++) {
        const double finite = s->y[i];
        s->y[i] = INFINITY;
        assert_ok(lg_model_machine_velocities(s->model, s->y, v, s->work));
        assert_all_nan(v, machine.velocities);
        s->y[i] = finite;
    }
}

/* ---- steps ---- */

/* The largest entry of |R^T R - I| of a rotation. */
static double off_rotation(const double *R) {
    double worst = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = i == j ? -1.0 : 0.0;
            for (int k = 0; k < 3; k++) sum += R[3 * k + i] * R[3 * k + j];
            worst = fmax(worst, fabs(sum));
        }
    return worst;
}

TEST("over 1e5 steps a rotation stays on SO(3) to 1e-14, and its energy is kept") {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "body", LG_COORDINATE_ROTATION);
    odd_scales(&machine);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 3, (double[]){0.4, 0.7, 1.0});
    add_feature(add_term(&machine, LG_MACHINE_POTENTIAL, "network"), LG_FEATURE_UP, 0);
    assert_machine(&machine);
    driven *s = drive(&machine, 6);
    const lg_scheme *scheme = lg_scheme_find("cf4");
    const size_t bytes = lg_model_stepper_size(s->model, scheme);
    lg_stepper *stepper;
    double worst = 0, before, after;
    assert_ok(lg_model_stepper_init(s->model, scheme, &stepper, test_work(bytes), bytes));
    lg_model_eval(s->model, s->y, &before, s->work);
    for (int i = 0; i < 100000; i++) {
        assert_ok(lg_stepper_step(stepper, 0, 1e-3, s->y, NULL, s->y));
        worst = fmax(worst, off_rotation(s->y));
    }
    lg_model_eval(s->model, s->y, &after, s->work);
    assert_true(worst <= 1e-14);
    assert_close(after, before, 1e-8, 0);
}

TEST("classical schemes are for machines on R^n alone, and implicit schemes for no program") {
    lg_program *program;
    lg_error error = {LG_OK, ""};
    const lg_machine flat = single(LG_COORDINATE_ANGLE, true), turning = single(LG_COORDINATE_ROTATION, true);
    const driven *a = drive(&flat, 1), *b = drive(&turning, 1);
    assert_true(lg_model_stepper_size(a->model, lg_scheme_find("rk4")) > 0);
    assert_int_equal(lg_model_stepper_size(b->model, lg_scheme_find("rk4")), 0);
    assert_status(
        lg_machine_program(NULL, &turning, b->theta, lg_scheme_find("rk4"), false, &program, &error),
        LG_UNSUPPORTED);
    size_t implicit = 0;
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        if (lg_scheme_at(i)->kind != LG_SCHEME_IMPLICIT) continue;
        implicit++;
        assert_true(lg_machine_program(NULL, &flat, a->theta, lg_scheme_at(i), false, &program, &error) !=
                    LG_OK);
        assert_true(strlen(error.message) > 10);
    }
    assert_true(implicit > 0);
    /* For a machine with LuGre friction the program has a special step function. */
    lg_machine rubbing = empty_machine();
    add_coordinate(&rubbing, "x", LG_COORDINATE_LINE);
    add_term(&rubbing, LG_MACHINE_MASS, "constant");
    add_term(&rubbing, LG_MACHINE_DAMPING, "lugre");
    assert_machine(&rubbing);
    const double *theta = machine_theta(&rubbing, 1);
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_IMPLICIT && scheme->kind != LG_SCHEME_SLGI) continue;
        assert_status(lg_machine_program(NULL, &rubbing, theta, scheme, false, &program, &error),
                      LG_UNSUPPORTED);
        assert_says(error.message, "solves equations in each step");
    }
    assert_told(lg_machine_program(NULL, &rubbing, theta, lg_scheme_find("cf4"), false, &program, &told));
    size_t inputs, step;
    assert_ok(lg_program_find(program, "step", &step, NULL));
    (void)lg_program_inputs(program, step, &inputs);
    lg_program_destroy(program);
    assert_int_equal(inputs, 2); /* the state and h */
}

/* ---- linearisation ---- */

static void linearise(const driven *s) {
    check_linearisation(s->model, s->y, s->u, 1e-6, s->work);
}

TEST("linearisations agree with differences of the stepper's field along the manifold and in the inputs") {
    const lg_machine machine = learned_machine();
    for (uint64_t seed = 1; seed < 4; seed++) linearise(drive(&machine, seed));
    const lg_machine known = known_machine();
    linearise(drive(&known, 1));
    for (int kind = 0; kind < LG_COORDINATE_KIND_COUNT; kind++) {
        const lg_machine one = single((lg_coordinate_kind)kind, kind % 2 == 0);
        linearise(drive(&one, 9));
    }
}

TEST("a deviation is the difference of places and momenta, and the axis of a rotation times the sine of "
     "its angle") {
    const lg_machine machine = single(LG_COORDINATE_POSE, true);
    const driven *s = drive(&machine, 3);
    const double a[3] = {0.3, -0.5, 0.4}, size = sqrt(0.5);
    double algebra[STATE] = {0}, other[STATE], c[STATE];
    for (int i = 0; i < 3; i++) algebra[3 + i] = lg_dot3(s->y + 3 + 3 * i, a); /* R a */
    lg_space_act(&s->space, algebra, s->y, other);
    for (int i = 0; i < 3; i++) other[i] += 0.1 * i, other[12 + i] -= 0.2;
    assert_ok(lg_model_deviation(s->model, s->y, other, c, s->work));
    for (int i = 0; i < 3; i++) {
        assert_close(c[i], 0.1 * i, 1e-13, 1e-15);
        assert_close(c[3 + i], a[i] / size * sin(size), 1e-13, 0);
        assert_close(c[6 + i], -0.2, 1e-13, 0);
        assert_close(c[9 + i], 0, 0, 1e-15);
    }
}
