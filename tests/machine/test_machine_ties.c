/* Machines of systems with directions beside other coordinates: their equations compared with the energy and
 * with the field of simulated systems; what is learned of a crane whose equations are written out here.
 * ctest-labels: src/machine src/mechanics */
#include "support/tied_systems.h"

#include "liegrad/fit.h"
#include "liegrad/geometry.h"
#include "mechanics/system.h"

enum { FEW = 3, MOST = FEW * (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES) };

/* A machine on a tape at random rows. */
typedef struct setting {
    lg_tape *tape;
    lg_machine_vars vars;
    lg_space space;
    double q[MOST], v[MOST];
    lg_var parts[LG_TAPED_MAX_PARTS];
} setting;

static setting *record(const lg_machine *machine) {
    setting *s = TEST_ARRAY(setting, 1);
    s->tape = test_tape(LG_F64);
    const lg_var theta =
        lg_parameter(s->tape, lg_shape1((uint32_t)machine->parameters), machine_theta(machine, 5));
    assert_ok(lg_machine_bind(s->tape, machine, theta, &s->vars));
    assert_ok(lg_machine_space(machine, &s->space));
    random_rows(machine, 7, FEW, s->q, s->v);
    assert_ok(lg_machine_record_state(
        s->tape, &s->vars, lg_input_f64(s->tape, lg_shape2(FEW, machine->positions), s->q),
        lg_input_f64(s->tape, lg_shape2(FEW, machine->velocities), s->v), s->parts));
    for (size_t k = 0; k < lg_taped_parts(&s->space); k++)
        s->parts[k] = lg_stop_gradient(s->tape, s->parts[k]);
    return s;
}

TEST("positions and velocities are recovered from the state, and energy changes by the power of the forces, "
     "with further terms of every kind") {
    for (size_t i = 0; i < LG_COUNT(tied_rows); i++) {
        const lg_machine machine = tied_machine(tied_rows[i]);
        setting *s = record(&machine);
        lg_tape *tape = s->tape;
        lg_var algebra[LG_TAPED_MAX_PARTS], rate[LG_TAPED_MAX_PARTS], change;
        double expected[FEW];
        const lg_var u = lg_input_f64(tape, lg_shape2(FEW, 1), test_numbers(3, FEW, -1, 1)),
                     v = lg_machine_record_velocities(tape, &s->vars, s->parts),
                     H = lg_machine_record_energy(tape, &s->vars, s->parts);
        assert_reads(tape, lg_machine_record_positions(tape, &s->vars, s->parts), FEW * machine.positions,
                     s->q, 1e-13, 1e-13);
        assert_reads(tape, v, FEW * machine.velocities, s->v, 1e-10, 1e-10);
        assert_ok(lg_machine_record_field(tape, &s->vars, s->parts, u, algebra));
        assert_ok(lg_taped_generator(tape, &s->space, algebra, s->parts, rate));
        assert_ok(lg_jvp(tape, &H, 1, s->parts, rate, lg_taped_parts(&s->space), &change));
        const lg_var f =
            lg_add(tape, lg_machine_record_force(tape, &s->vars, LG_MACHINE_DAMPING, s->parts, v, u),
                   lg_machine_record_force(tape, &s->vars, LG_MACHINE_INPUT_MAP, s->parts, v, u));
        assert_ok(lg_read(tape, lg_rowdot(tape, v, f), FEW, expected));
        assert_true(fabs(expected[0]) > 1e-3);
        assert_reads(tape, change, FEW, expected, 1e-10, 1e-10);
    }
}

/* The momenta of lines and of the machine's rotation, which is in its own axes: R^T pi. */
static void state_of_system(setting *s, lg_var *y) {
    const lg_machine *machine = s->vars.machine;
    const lg_machine_places at = lg_machine_parts(machine);
    lg_tape *tape = s->tape;
    size_t count = 0;
    if (at.R >= 0) {
        const lg_var R = lg_row_matrices(tape, s->parts[at.R]),
                     m = lg_reshape(tape, lg_slice(tape, s->parts[at.m], 1, 0, 3), lg_shape3(FEW, 3, 1));
        y[count++] = s->parts[at.R];
        y[count++] = lg_reshape(tape, lg_matmul(tape, R, m), lg_shape2(FEW, 3));
    }
    y[count++] = s->parts[at.q];
    y[count++] = s->parts[at.p];
    if (at.x < 0) return;
    y[count++] = s->parts[at.x];
    y[count++] = lg_slice(tape, s->parts[at.m], 1, 3 * machine->rotations, machine->places);
}

/* The velocity of the state, as state_of_system has it. */
static void assert_same_motion(setting *s, const lg_space *space, const lg_var *algebra) {
    const size_t count = lg_taped_parts(space);
    lg_var y[LG_TAPED_MAX_PARTS], expected[LG_TAPED_MAX_PARTS], own[LG_TAPED_MAX_PARTS],
        rate[LG_TAPED_MAX_PARTS], found[LG_TAPED_MAX_PARTS];
    double values[MOST];
    state_of_system(s, y);
    assert_ok(lg_taped_generator(s->tape, space, algebra, y, expected));
    assert_ok(lg_machine_record_field(s->tape, &s->vars, s->parts, LG_NONE, own));
    assert_ok(lg_taped_generator(s->tape, &s->space, own, s->parts, rate));
    assert_ok(lg_jvp(s->tape, y, count, s->parts, rate, lg_taped_parts(&s->space), found));
    for (size_t i = 0; i < count; i++) {
        const size_t n = lg_shape_count(lg_var_shape(s->tape, y[i]));
        assert_ok(lg_read(s->tape, expected[i], n, values));
        assert_reads(s->tape, found[i], n, values, 1e-11, 1e-11);
    }
}

/* The row of a simulated system with these energies: a derived row has the functions of all of them. */
static void simulated(const lg_energy_row *energy, lg_system_row *row, lg_system *system) {
    lg_space_factor factors[4];
    size_t counts[LG_COORDINATE_KIND_COUNT] = {0}, used = 0;
    for (uint32_t i = 0; i < energy->count; i++) counts[energy->coordinates[i]]++;
    const size_t c = counts[LG_COORDINATE_ROTATION], k = counts[LG_COORDINATE_DIRECTION],
                 n = counts[LG_COORDINATE_LINE] + counts[LG_COORDINATE_ANGLE];
    if (c > 0) {
        factors[used++] = (lg_space_factor){LG_SPACE_SO3, c};
        factors[used++] = (lg_space_factor){LG_SPACE_RN, 3 * c};
    }
    factors[used++] = (lg_space_factor){LG_SPACE_TS2, k};
    *row = *lg_derived_row(0);
    row->energy = energy;
    *system = (lg_system){.row = row};
    lg_space_factor all[LG_SPACE_MAX_FACTORS];
    memcpy(all, factors, used * sizeof *all);
    for (int i = 0; i < 2 && n > 0; i++) all[used++] = (lg_space_factor){LG_SPACE_RN, n};
    assert_ok(lg_space_init(&system->space, all, used));
}

TEST("without further terms the machine moves as the simulated system does, and has its energy") {
    for (size_t i = 0; i < LG_COUNT(tied_rows); i++) {
        lg_machine machine = tied_system(tied_rows[i]);
        lg_system_row row;
        lg_system system;
        lg_var y[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS];
        double energy[FEW];
        assert_machine(&machine);
        simulated(tied_rows[i], &row, &system);
        setting *s = record(&machine);
        state_of_system(s, y);
        assert_ok(lg_read(s->tape, row.taped_energy(&system, s->tape, y, s->vars.grey), FEW, energy));
        assert_reads(s->tape, lg_machine_record_energy(s->tape, &s->vars, s->parts), FEW, energy, 1e-12, 0);
        assert_ok(
            row.taped(&system, s->tape, (lg_taped_time){.value = 0}, y, LG_NONE, s->vars.grey, algebra));
        assert_same_motion(s, &system.space, algebra);
    }
}

TEST("variational steps are refused where directions are tied to other coordinates") {
    for (size_t i = 0; i < LG_COUNT(tied_rows); i++) {
        const lg_machine machine = tied_machine(tied_rows[i]);
        assert_says(lg_machine_variational_fault(&machine),
                    lg_machine_mass_moves(&machine) ? "state" : "couples");
    }
}

/* ---- a crane ---- */

enum { PARTS = 6, ROWS = 81, ALL = PARTS * ROWS };
static const double cart = 1.3, load = 0.4, rope = 0.7, spring = 5, friction = 0.15, swing = 0.02;

typedef struct logs {
    size_t first[PARTS + 1], start[ALL];
    double t[ALL], q[ALL * 4], v[ALL * 4], u[ALL * 4];
    lg_machine_log log;
} logs;

/* Newton's equations, y = (q, q', x, x'), where S keeps |q| = 1:
 *   (M + m) x'' + m L e1.q'' = u - k x - c x',  m L^2 q'' = -m L g e3 - m L x'' e1 - d q' - S q. */
static void crane_field(const double *y, double u, double *dy) {
    const double *q = y, *w = y + 3, x = y[6], v = y[7], mL = load * rope, I = mL * rope;
    const double speed = lg_dot3(w, w), across = 1 - q[0] * q[0];
    /* e1.q'' = a - b x'' */
    const double a = -speed * q[0] + 9.81 / rope * q[0] * q[2] - swing / I * w[0], b = across / rope,
                 acceleration = (u - spring * x - friction * v - mL * a) / (cart + load - mL * b);
    for (int i = 0; i < 3; i++) {
        const double e1 = i == 0, e3 = i == 2;
        dy[i] = w[i];
        dy[3 + i] = -speed * q[i] - 9.81 / rope * (e3 - q[2] * q[i]) -
                    acceleration / rope * (e1 - q[0] * q[i]) - swing / I * w[i];
    }
    dy[6] = v, dy[7] = acceleration;
}

static void advance(double *y, double u, double dt) {
    enum { STEPS = 20 };
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    for (int step = 0; step < STEPS; step++) {
        double k[8] = {0}, from[8], sum[8] = {0};
        for (int stage = 0; stage < 4; stage++) {
            for (int i = 0; i < 8; i++) from[i] = y[i] + at[stage] * dt / STEPS * k[i];
            crane_field(from, u, k);
            for (int i = 0; i < 8; i++) sum[i] += dt / STEPS * weight[stage] * k[i];
        }
        for (int i = 0; i < 8; i++) y[i] += sum[i];
    }
}

/* A log with a force on the cart that changes every 10 rows, in units of length 1/`unit` m. */
static logs *make_logs(double noise, double unit) {
    logs *l = TEST_ARRAY(logs, 1);
    lg_rng rng = test_rng(22, 0);
    for (size_t p = 0; p < PARTS; p++) {
        double y[8] = {0.6, 0.3 * (double)p, -0.7, 0, 0, 0, 0.1, -0.2}, u = 0;
        const double length = sqrt(lg_dot3(y, y));
        for (int i = 0; i < 3; i++) y[i] /= length;
        y[3] = 0.8 * y[1], y[4] = -0.8 * y[0];
        l->first[p] = p * ROWS;
        for (size_t j = 0; j < ROWS; j++) {
            const size_t row = p * ROWS + j;
            double *q = l->q + 4 * row, *v = l->v + 4 * row;
            if (j % 10 == 0) u = 4 * lg_rng_normal(&rng);
            lg_cross3(y, y + 3, v);
            for (int i = 0; i < 3; i++) q[i] = y[i] + noise * lg_rng_normal(&rng);
            const double size = sqrt(lg_dot3(q, q));
            for (int i = 0; i < 3; i++) q[i] /= size, v[i] += noise * lg_rng_normal(&rng);
            q[3] = unit * (y[6] + noise * lg_rng_normal(&rng));
            v[3] = unit * (y[7] + noise * lg_rng_normal(&rng));
            l->t[row] = 0.03 * (double)j;
            l->u[4 * row] = unit * u;
            advance(y, u, 0.03);
        }
    }
    l->first[PARTS] = ALL;
    l->log = (lg_machine_log){ALL, PARTS, l->first, l->t, l->q, l->v, l->u, NULL, NULL, NULL};
    return l;
}

/* Torques have the unit of a force times a length, and so do masses of a direction. */
static lg_machine crane(double unit) {
    static const double start = 1.0, map[4] = {0, 0, 0, 1};
    const double g = 9.81 * unit, L = unit;
    lg_machine machine = tied_system(&crane_row);
    add_input(&machine, "u");
    assert_told(lg_machine_set_parameter(&machine, "gravity", 1, &g, NULL, &told));
    assert_told(lg_machine_set_parameter(&machine, "stiffness", 1, &start, (const bool[]){true}, &told));
    assert_told(lg_machine_set_parameter(&machine, "length", 1, &L, (const bool[]){true}, &told));
    add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 4, map);
    assert_machine(&machine);
    return machine;
}

/* Fits the crane, and returns the loss; numbers: M, m, L, k, three dampings of the rope, one of the cart. */
static double fit(logs *l, double unit, double noise, lg_identified *numbers) {
    enum { WINDOW = 11 };
    lg_machine machine = crane(unit);
    assert_ok(lg_machine_find_scales(&machine, &l->log, NULL));
    lg_machine_problem problem = {.machine = &machine,
                                  .scheme = lg_scheme_find("rkmk5"),
                                  .substeps = 2,
                                  .window = WINDOW,
                                  .starts = LG_MACHINE_STARTS_ESTIMATED,
                                  .log = l->log,
                                  .start = l->start};
    for (int i = 0; i < 2; i++)
        problem.position_scale[i] = problem.velocity_scale[i] = (i == 1 ? unit : 1) * fmax(noise, 1e-3);
    problem.windows = lg_machine_windows(&machine, &l->log, WINDOW, WINDOW - 1, false, l->start);
    assert_told(lg_machine_problem_check(&problem, &told));
    double *theta = TEST_ARRAY(double, lg_machine_problem_parameters(&problem)), loss, floor;
    lg_rng rng = test_rng(1, 0);
    lg_fit_problem of;
    lg_machine_initialise(&machine, &rng, theta);
    lg_machine_fit_problem(&problem, &of);
    fit_by_lm(&of, 200, theta);
    assert_ok(lg_machine_loss(NULL, &problem, theta, &loss, &floor, NULL));
    assert_int_equal(lg_machine_numbers(&machine, theta, 8, numbers), 8);
    double correlations[64], open[64];
    lg_identification found = {.numbers = numbers, .correlations = correlations, .open = open};
    assert_ok(lg_machine_identify(NULL, &problem, theta, &found, NULL));
    assert_int_equal(found.open_count, 0);
    return loss;
}

TEST("masses, length, stiffness and damping of a crane are found from exact logs, and within two errors from "
     "noisy ones, also in units that are a billion times smaller or larger") {
    static const double units[] = {1, 1e9, 1e-9}, noises[] = {0, 2e-3},
                        truth[8] = {cart, load, rope, spring, swing, swing, swing, friction};
    for (size_t i = 0; i < 2; i++)
        for (size_t k = 0; k < (i == 0 ? 1 : LG_COUNT(units)); k++) {
            const double unit = units[k], square = unit * unit,
                         factor[8] = {1, 1, unit, 1, square, square, square, 1};
            lg_identified numbers[8];
            const double loss = fit(make_logs(noises[i], unit), unit, noises[i], numbers);
            print_message("unit %.0e, noise %.0e: loss %.3g\n", unit, noises[i], loss);
            for (size_t j = 0; j < 8; j++) {
                const double value = numbers[j].value / factor[j], error = numbers[j].error / factor[j];
                print_message("  %-16s %.6g +- %.2g\n", numbers[j].name, value, error);
                if (noises[i] == 0)
                    assert_close(value, truth[j], 1e-6, 1e-8);
                else
                    assert_close(value, truth[j], 0, 2 * error);
            }
        }
}
