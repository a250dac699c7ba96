/* Programs of constraints for tests, in any units. */
#ifndef LG_TEST_CONSTRAINTS_H
#define LG_TEST_CONSTRAINTS_H

#include "support/fixtures.h"
#include "liegrad/constraint.h"
#include "liegrad/ops.h"

RELEASES(release_constraint, lg_constraint_destroy)
RELEASES(release_constraint_program, lg_program_destroy)

static inline lg_constraint *own_constraint(lg_constraint *made) {
    lg_test_owns(made, release_constraint);
    return made;
}

/* q times 1/length and g times `residual` have the units of the formulas. */
typedef struct constraint_units {
    double length, residual;
} constraint_units;

static inline lg_var coordinate(lg_tape *tape, const constraint_units *units, lg_var q, uint32_t i) {
    return lg_scale(tape, lg_slice(tape, q, 1, i, 1), 1.0 / units->length);
}

static inline lg_status put_rows(lg_tape *tape, const constraint_units *units, const lg_var *g, size_t m,
                                 lg_var *out) {
    *out = lg_scale(tape, lg_concat(tape, g, m, 1), units->residual);
    return lg_tape_status(tape);
}

/* (x - cx)^2 + (y - cy)^2 - r^2 */
static inline lg_var circle(lg_tape *tape, lg_var x, double cx, lg_var y, double cy, double r) {
    const lg_var a = lg_square(tape, lg_add_scalar(tape, x, -cx)),
                 b = lg_square(tape, lg_add_scalar(tape, y, -cy));
    return lg_add_scalar(tape, lg_add(tape, a, b), -r * r);
}

static inline lg_status ball(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const constraint_units *units = user;
    const lg_var x = coordinate(tape, units, q[0], 0), y = coordinate(tape, units, q[0], 1);
    const lg_var g0 =
        lg_add(tape, circle(tape, x, 0, y, 0, 1), lg_square(tape, coordinate(tape, units, q[0], 2)));
    (void)theta;
    return put_rows(tape, units, &g0, 1, g);
}

/* A trefoil knot on the torus of the radii 1 and 0.4. */
static inline lg_status knot(void *user, lg_tape *t, const lg_var *theta, const lg_var *q, lg_var *g) {
    const constraint_units *units = user;
    const lg_var x = coordinate(t, units, q[0], 0), y = coordinate(t, units, q[0], 1),
                 z = coordinate(t, units, q[0], 2);
    const lg_var xx = lg_square(t, x), yy = lg_square(t, y), zz = lg_square(t, z);
    const lg_var a = lg_add_scalar(t, lg_sqrt(t, lg_add(t, xx, yy)), -1.0), aa = lg_square(t, a);
    const lg_var re = lg_mul(t, x, lg_sub(t, xx, lg_scale(t, yy, 3.0)));
    const lg_var im = lg_mul(t, y, lg_sub(t, lg_scale(t, xx, 3.0), yy));
    const lg_var rows[2] = {
        lg_add_scalar(t, lg_add(t, aa, zz), -0.16),
        lg_sub(t, lg_mul(t, lg_scale(t, lg_mul(t, a, z), 2.0), re), lg_mul(t, lg_sub(t, aa, zz), im))};
    (void)theta;
    return put_rows(t, units, rows, 2, g);
}

/* A four-bar linkage: the joints (q0, q1) and (q2, q3), fixed points (0, 0) and (1.5, 0). */
static inline lg_status linkage(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const constraint_units *units = user;
    lg_var x[4];
    for (uint32_t i = 0; i < 4; i++) x[i] = coordinate(tape, units, q[0], i);
    const lg_var rows[3] = {circle(tape, x[0], 0, x[1], 0, 0.6),
                            circle(tape, lg_sub(tape, x[2], x[0]), 0, lg_sub(tape, x[3], x[1]), 0, 1.4),
                            circle(tape, x[2], 1.5, x[3], 0, 1.0)};
    (void)theta;
    return put_rows(tape, units, rows, 3, g);
}

/* V = q_last + q_0^2/2, in units in which masses and times stay the same. */
static inline lg_status hill(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *V) {
    const constraint_units *units = user;
    const uint32_t last = lg_var_shape(tape, q[0]).dims[1] - 1;
    const lg_var x = coordinate(tape, units, q[0], 0), z = coordinate(tape, units, q[0], last);
    const lg_var sum = lg_add(tape, z, lg_scale(tape, lg_square(tape, x), 0.5));
    (void)theta;
    *V = lg_scale(tape, sum, units->length * units->length);
    return lg_tape_status(tape);
}

static inline lg_status heavy(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *M) {
    const uint32_t n = lg_var_shape(tape, q[0]).dims[1];
    double m[16];
    (void)user, (void)theta;
    for (uint32_t i = 0; i < n * n; i++) m[i] = i % (n + 1) == 0 ? 1.0 + i / n : 0.3;
    *M = lg_input_f64(tape, lg_shape2(n, n), m);
    return lg_tape_status(tape);
}

typedef struct constraint_case {
    const char *name;
    lg_record_function g, V, M; /* V and M may be NULL */
    uint32_t n, m;
} constraint_case;
static const constraint_case constraint_cases[]
    __attribute__((unused)) = {{"sphere", ball, hill, NULL, 3, 1},
                               {"knot", knot, hill, heavy, 3, 2},
                               {"linkage", linkage, hill, heavy, 4, 3}};
enum { CONSTRAINTS = LG_COUNT(constraint_cases) };

static inline lg_status constraint_program_of(const constraint_case *of, const constraint_units *units,
                                              lg_program **out, lg_error *error) {
    union {
        const constraint_units *borrowed;
        void *user;
    } pointer = {.borrowed = units};
    const lg_port q = {
        .name = "q", .shape = lg_shape1(of->n), .low = -1.6 * units->length, .high = 1.6 * units->length};
    const lg_port out_port[] = {{.name = "g"}, {.name = "V"}, {.name = "M"}};
    const lg_record_function record[] = {of->g, of->V, of->M};
    const char *const names[] = {"constraint", "potential", "mass"};
    lg_function_spec functions[3];
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.functions = functions;
    for (size_t i = 0; i < 3; i++)
        if (record[i] != NULL)
            functions[spec.function_count++] =
                (lg_function_spec){names[i], &q, 1, &out_port[i], 1, record[i], pointer.user};
    return lg_program_build(NULL, &spec, out, error);
}

static inline lg_program *make_constraint_program(const constraint_case *of, const constraint_units *units) {
    lg_program *program;
    assert_told(constraint_program_of(of, units, &program, &told));
    lg_test_owns(program, release_constraint_program);
    return program;
}

static inline lg_constraint *make_constraint(const constraint_case *of, const constraint_units *units) {
    lg_constraint *made;
    assert_told(lg_constraint_create(NULL, make_constraint_program(of, units), &made, &told));
    return own_constraint(made);
}

static const constraint_units plain_units __attribute__((unused)) = {1.0, 1.0};

/* `count` states on T*Q, with the energies (may be NULL). */
static inline double *constraint_states(const lg_constraint *constraint, size_t count, double speed,
                                        double *energies) {
    const size_t d = 2 * lg_constraint_coordinates(constraint);
    double *data = TEST_ARRAY(double, 2 * count * d);
    lg_trajectory_options how;
    lg_trajectory_options_init(&how);
    how.trajectories = 1, how.points = 2;
    how.trajectories = count;
    how.low = -speed, how.high = speed;
    how.t_end = 1e-3;
    how.seed = 5;
    assert_told(lg_constraint_generate(constraint, &how, NULL, data, energies, &told));
    for (size_t i = 1; i < count; i++) memcpy(data + i * d, data + 2 * i * d, d * sizeof *data);
    return data;
}

/* |g| at most a few roundings, however many steps; energy within a band that does not grow. */
static inline void constraint_long_run(size_t i, size_t steps) {
    const lg_constraint *constraint = make_constraint(&constraint_cases[i], &plain_units);
    const double *y = constraint_states(constraint, 1, 1.0, NULL);
    const size_t d = 2 * constraint_cases[i].n, pieces = 20, each = steps / pieces;
    const double h = 0.01;
    double *out = TEST_ARRAY(double, (each + 1) * d), start[8], H0, residual = 0, off = 0, band[2] = {0};
    memcpy(start, y, d * sizeof *start);
    assert_ok(lg_constraint_energy(constraint, start, &H0, NULL));
    for (size_t piece = 0; piece < pieces; piece++) {
        assert_told(lg_constraint_rattle(constraint, 2, h, each, 1, start, out, &told));
        for (size_t k = 0; k <= each; k++) {
            lg_constraint_view view;
            double H;
            assert_told(lg_constraint_look(constraint, 1.0, out + k * d, &view, &told));
            assert_ok(lg_constraint_energy(constraint, out + k * d, &H, NULL));
            residual = fmax(residual, view.residual);
            off = fmax(off, view.off);
            double *half = &band[piece < pieces / 2 ? 0 : 1];
            *half = fmax(*half, fabs(H - H0));
        }
        memcpy(start, out + each * d, d * sizeof *start);
    }
    print_message("  %-8s %zu steps: |g| %.1e, off %.1e, energy %.1e, then %.1e\n", constraint_cases[i].name,
                  steps, residual, off, band[0], band[1]);
    assert_true(residual < 4e-15 && off < 4e-15);
    assert_true(band[1] < 1e-3 && band[1] < 1.2 * band[0]);
}

#endif
