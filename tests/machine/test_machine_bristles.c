/* Machines: the bristles of LuGre friction as a part of the state. */
#include "liegrad/ops.h"

#include "support/machine_support.h"

#include "machine/internal.h"

enum { N = 2, STATE = 6 };

/* c, cs, vs, s0, s1 of a line and an angle. */
static const double values[5 * N] = {1, 0.8, 1.6, 0.9, 0.05, 0.4, 500, 40, 5, 2};

/* A line and an angle with these masses and LuGre friction, learned without `values`. */
static lg_machine bristled(double mass, const double *known) {
    const double masses[N] = {mass, mass}, map[N] = {1, 0.5};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    odd_scales(&machine);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), N, masses);
    lg_machine_term *friction = add_term(&machine, LG_MACHINE_DAMPING, "lugre");
    if (known != NULL) add_values(friction, 5 * N, known);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), N, map);
    assert_machine(&machine);
    return machine;
}

static double sliding(const double *b, int k, double v) {
    const double r = v / b[2 * N + k];
    return b[k] + (b[N + k] - b[k]) * exp(-r * r);
}

static void run(const lg_machine *machine, const char *name, const double *x, double u, double h,
                double *out) {
    lg_program *program;
    assert_ok(lg_machine_program(NULL, machine, NULL, NULL, false, &program, NULL));
    assert_ok(
        lg_program_eval(NULL, program, name, 1, (const double *const[]){x, &u, &h}, (double *[]){out}, NULL));
    lg_program_destroy(program);
}

TEST("the field of a program knows the bristles, in the units of the log") {
    const lg_machine machine = bristled(2, values);
    const double v[N] = {0.07, -0.3}, z[N] = {1e-3, 0.01}, u = 0.7;
    const double x[STATE] = {0.4, -1, 2 * v[0], 2 * v[1], z[0], z[1]};
    double f[STATE];
    run(&machine, "field", x, u, 0, f);
    for (int k = 0; k < N; k++) {
        const double rate = v[k] - values[3 * N + k] * fabs(v[k]) * z[k] / sliding(values, k, v[k]);
        assert_close(f[k], v[k], 1e-13, 0);
        assert_close(f[4 + k], rate, 1e-12, 0);
        assert_close(f[2 + k], (k == 0 ? 1 : 0.5) * u - values[3 * N + k] * z[k] - values[4 * N + k] * rate,
                     1e-12, 0);
    }
}

TEST("a step moves bristles exactly at constant velocity, however long it is") {
    const lg_machine machine = bristled(1e12, values);
    static const double speeds[] = {0.0, 1e-12, 0.02, -0.02, 3.0}, lengths[] = {1e-4, 0.01, 5.0};
    for (size_t i = 0; i < LG_COUNT(speeds); i++)
        for (size_t j = 0; j < LG_COUNT(lengths); j++) {
            const double v = speeds[i], h = lengths[j], z = 1e-3;
            const double x[STATE] = {0, 0, 1e12 * v, 1e12 * v, z, z};
            double next[STATE];
            run(&machine, "step", x, 0, h, next);
            for (int k = 0; k < N; k++) {
                const double g = sliding(values, k, v), s0 = values[3 * N + k];
                const double zs = v == 0.0 ? 0.0 : copysign(g / s0, v);
                assert_close(next[4 + k], z * exp(-s0 * fabs(v) * h / g) - zs * expm1(-s0 * fabs(v) * h / g),
                             1e-7, 1e-15);
            }
        }
}

/* What one step of length h and two of h/2 differ by. */
static double differ(const lg_machine *machine, const double *x, double h) {
    double one[STATE], half[STATE], two[STATE], sum = 0;
    run(machine, "step", x, 1, h, one);
    run(machine, "step", x, 1, h / 2, half);
    run(machine, "step", half, 1, h / 2, two);
    for (int i = 0; i < STATE; i++) sum += fabs(one[i] - two[i]);
    return sum;
}

TEST("steps of machines with bristles have order 2") {
    const lg_machine machine = bristled(2, values);
    const double x[STATE] = {0.4, -1, 0.8, -1, 1e-3, 0.01};
    double before = differ(&machine, x, 2e-3);
    for (double h = 1e-3; h > 1e-4; h /= 2) {
        const double now = differ(&machine, x, h), order = log2(before / now) - 1.0;
        (void)printf("h %g: order %.3f\n", h, order);
        assert_true(order > 1.8 && order < 2.3);
        before = now;
    }
}

/* Power that the friction of the line gives, and its bristles store. */
static double power(const double *known, double v, double z) {
    const lg_machine machine = bristled(2, known);
    const double x[STATE] = {0, 0, 2 * v, 0, z, 0};
    double f[STATE];
    run(&machine, "field", x, 0, 0, f);
    return f[2] * v + known[3 * N] * z * f[4];
}

TEST("LuGre friction and its bristles take energy away if s1 |v| is at most 4 g, else not always") {
    double b[5 * N];
    memcpy(b, values, sizeof b);
    for (double v = -2; v <= 2; v += 0.25)
        for (double z = -8e-3; z <= 8e-3; z += 1e-3) {
            b[4 * N] = v == 0.0 ? 5.0 : 4.0 * sliding(b, 0, v) / fabs(v);
            assert_true(power(b, v, z) <= 1e-12);
        }
    b[4 * N] = 200;
    assert_true(power(b, 0.5, 1.5 / 500) > 0.0);
}

/* ---- bristles at rows of a log ---- */

enum { ROWS = 300 };

/* z at a row of a log in which each velocity is v[0] and then v[1] from row `turn` on, and if `gradient` is
 * not NULL the derivatives of the sum of z by theta. */
static void start(const lg_machine *machine, const double *theta, const double *v, size_t turn, size_t row,
                  double *z, double *gradient) {
    const size_t first[2] = {0, ROWS};
    double *log[3];
    for (int i = 0; i < 3; i++) log[i] = test_numbers(1, ROWS * N, 0, 0);
    for (size_t i = 0; i < ROWS; i++) {
        log[0][i] = 0.01 * (double)i;
        log[2][N * i] = log[2][N * i + 1] = v[i >= turn];
    }
    const lg_machine_log all = {ROWS, 1, first, log[0], log[1], log[2], NULL, NULL, NULL, NULL};
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    lg_tape *tape = test_tape(LG_F64);
    const lg_var numbers = lg_machine_parameter(tape, machine, theta);
    const int at = lg_machine_parts(machine).z;
    assert_ok(lg_machine_bind(tape, machine, numbers, &vars));
    assert_ok(lg_machine_start_bristles(tape, &vars, &all, &row, 1, parts));
    assert_ok(lg_read(tape, parts[at], N, z));
    for (int k = 0; k < N; k++) z[k] *= machine->scales.velocity[k];
    void *const out = gradient;
    if (gradient != NULL) assert_ok(lg_backward_set(tape, lg_sum(tape, parts[at]), &numbers, 1, &out));
}

TEST("bristles at a row follow from the velocities before it") {
    const lg_machine machine = bristled(2, values);
    const double v[2] = {0.3, -0.02};
    double z[N];
    start(&machine, NULL, v, 250, 253, z, NULL);
    for (int k = 0; k < N; k++) {
        double want = sliding(values, k, 0.3) / values[3 * N + k];
        for (int i = 0; i < 4; i++) {
            const double mean = i == 0 ? 0.14 : -0.02, g = sliding(values, k, mean), s0 = values[3 * N + k];
            const double E = exp(-s0 * fabs(mean) * 0.01 / g);
            want = copysign(g / s0, mean) * (1 - E) + want * E;
        }
        assert_close(z[k], want, 1e-12, 0);
    }
}

TEST("the derivatives of these bristles are difference quotients, also at the first row of a part") {
    const lg_machine machine = bristled(2, NULL);
    static const size_t rows[] = {0, 3, 120, 253};
    const double v[2] = {0.3, -0.02}, step = 1e-5;
    const size_t n = machine.parameters;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double *theta = test_numbers(5, n, -0.5, 0.5), *gradient = test_numbers(1, n, 0, 0);
        double z[2][N];
        start(&machine, theta, v, 250, rows[i], z[0], gradient);
        for (size_t j = 0; j < n; j++) {
            const double kept = theta[j];
            double quotient = 0;
            for (int side = 0; side < 2; side++) {
                theta[j] = kept + (side == 0 ? step : -step);
                start(&machine, theta, v, 250, rows[i], z[side], NULL);
            }
            theta[j] = kept;
            for (int k = 0; k < N; k++)
                quotient += (z[0][k] - z[1][k]) / (2 * step * machine.scales.velocity[k]);
            assert_close(gradient[j], quotient, 1e-5, 1e-9);
        }
    }
}

TEST("two terms with bristles, and friction of bristles that would be none, are refused") {
    lg_machine machine = bristled(2, NULL);
    lg_error error = {LG_OK, ""};
    add_term(&machine, LG_MACHINE_DAMPING, "lugre");
    assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "give one term of this kind");
    for (int row = 0; row < 5; row++) {
        double wrong[5 * N];
        memcpy(wrong, values, sizeof wrong);
        wrong[row * N] = row == 1 ? 0.5 : -1;
        machine = bristled(2, NULL);
        add_values(&machine.terms[1], 5 * N, wrong);
        assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "stiffness of the bristles");
    }
}

TEST("machines with bristles have no variational steps") {
    const lg_machine machine = bristled(2, values);
    assert_says(lg_machine_variational_fault(&machine), "LuGre");
}

TEST("a step of a free run is the exported step") {
    const lg_machine machine = bristled(2, values);
    const double q[2 * N] = {0.4, -1}, v[2 * N] = {0.02, -0.5}, u[8] = {0.7, 0, 0, 0, 0.7}, t[2] = {0, 0.02};
    const size_t first[2] = {0, 2}, at = 0;
    const lg_machine_log log = {2, 1, first, t, q, v, u, NULL, NULL, NULL};
    double x[STATE] = {0.4, -1, 2 * v[0], 2 * v[1]}, next[STATE], speeds[2 * N];
    for (int k = 0; k < N; k++) {
        const double w = 1e-3 * machine.scales.fastest[k];
        x[4 + k] = tanh(v[k] / w) * sliding(values, k, v[k]) / values[3 * N + k];
    }
    run(&machine, "step", x, 0.7, 0.02, next);
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("cf4"), 1, &log, &at, 1, 1, NULL,
                                  speeds, NULL));
    for (int k = 0; k < N; k++) assert_close(2 * speeds[N + k], next[2 + k], 1e-12, 0);
}
