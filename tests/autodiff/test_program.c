/* Programs: building, what is refused, application on a tape, plans. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/nn.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "test_support.h"

/* ---- a network with an input gradient ---- */

typedef struct network {
    lg_mlp net;
    double *theta;
} network;

static void make_network(network *n, uint32_t inputs, uint32_t width, uint32_t outputs, lg_activation kind) {
    const uint32_t hidden[2] = {width, width};
    lg_rng rng;
    lg_rng_seed(&rng, 3, 1);
    assert_int_equal(lg_mlp_init(&n->net, inputs, hidden, 2, outputs, kind, true), LG_OK);
    n->theta = malloc(lg_mlp_parameters(&n->net) * sizeof(double));
    lg_mlp_initialise(&n->net, &rng, n->theta);
}

static lg_status record_value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mlp_apply(tape, user, theta[0], 0, x[0]);
    return lg_tape_status(tape);
}

static lg_status record_gradient(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mlp_apply(tape, user, theta[0], 0, x[0]);
    return lg_grad(tape, y[0], x, 1, &y[1]);
}

static lg_status record_loss(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mean(tape, lg_square(tape, lg_mlp_apply(tape, user, theta[0], 0, x[0])));
    return lg_tape_status(tape);
}

static const lg_port x3 = {.name = "x", .shape = {1, {3, 0, 0, 0}}};
static const lg_port value_ports[2] = {{.name = "y"}, {.name = "g"}};

static lg_program *build_network(network *n) {
    const lg_parameter_spec theta = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta};
    const lg_function_spec functions[] = {
        {"value", &x3, 1, value_ports, 1, record_value, &n->net},
        {"gradient", &x3, 1, value_ports, 2, record_gradient, &n->net},
        {"loss", &x3, 1, value_ports, 1, record_loss, &n->net},
    };
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_error error;
    lg_program_spec_init(&spec);
    spec.parameters = &theta;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = sizeof functions / sizeof *functions;
    if (lg_program_build(NULL, &spec, &program, &error) != LG_OK) fail_msg("%s", error.message);
    return program;
}

/* Function of the program on a tape, and the recording itself, with `rows` rows: to the last bit. */
static void compare_apply(lg_program *program, size_t function, network *n, lg_program_record record,
                          size_t outputs, size_t rows) {
    lg_tape *tape;
    lg_rng rng;
    lg_rng_seed(&rng, 4, rows);
    assert_int_equal(lg_tape_create(NULL, NULL, &tape), LG_OK);
    double *x = malloc(3 * rows * sizeof *x);
    for (size_t i = 0; i < 3 * rows; i++) x[i] = lg_rng_normal(&rng);
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta);
    lg_var in = lg_input(tape, lg_shape2((uint32_t)rows, 3), x), want[2], got[2];
    assert_int_equal(record(&n->net, tape, &theta, &in, want), LG_OK);
    assert_int_equal(lg_program_apply(tape, program, function, &theta, &in, got), LG_OK);
    for (size_t j = 0; j < outputs; j++) {
        const size_t count = lg_shape_count(lg_var_shape(tape, want[j]));
        assert_int_equal(lg_shape_count(lg_var_shape(tape, got[j])), count);
        assert_memory_equal(lg_value(tape, want[j]), lg_value(tape, got[j]), count * sizeof(double));
    }
    free(x);
    lg_tape_destroy(tape);
}

static void applied_equals_recorded(void **state) {
    (void)state;
    network n;
    make_network(&n, 3, 16, 1, LG_TANH);
    lg_program *program = build_network(&n);
    for (size_t rows = 1; rows <= 4; rows++) {
        compare_apply(program, 0, &n, record_value, 1, rows);
        compare_apply(program, 1, &n, record_gradient, 2, rows);
        compare_apply(program, 2, &n, record_loss, 1, rows);
    }
    lg_program_destroy(program);
    free(n.theta);
}

/* ---- plans ---- */

static void close_to(const double *got, const double *want, size_t count, double tolerance) {
    for (size_t i = 0; i < count; i++) assert_close(got[i], want[i], tolerance, tolerance);
}

static void compare_plan(lg_program *program, size_t function, network *n, lg_program_record record,
                         size_t outputs, size_t rows) {
    lg_tape *tape;
    lg_plan *plan;
    lg_rng rng;
    lg_error error;
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.rows = rows;
    lg_rng_seed(&rng, 5, rows);
    assert_int_equal(lg_tape_create(NULL, NULL, &tape), LG_OK);
    if (lg_plan_create(program, function, &options, &plan, &error) != LG_OK) fail_msg("%s", error.message);
    double *x = malloc(3 * rows * sizeof *x);
    for (size_t i = 0; i < 3 * rows; i++) x[i] = lg_rng_normal(&rng);
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta);
    lg_var in = lg_input(tape, lg_shape2((uint32_t)rows, 3), x), want[2];
    assert_int_equal(record(&n->net, tape, &theta, &in, want), LG_OK);
    void *work = aligned_alloc(64, lg_plan_work_size(plan)), *out[2] = {NULL, NULL};
    memset(work, 0xff, lg_plan_work_size(plan));
    for (size_t j = 0; j < outputs; j++) out[j] = malloc(lg_plan_output_count(plan, j) * sizeof(double));
    lg_plan_run(plan, (const void *const[]){x}, out, work);
    for (size_t j = 0; j < outputs; j++) {
        const size_t count = lg_plan_output_count(plan, j);
        assert_int_equal(count, lg_shape_count(lg_var_shape(tape, want[j])));
        close_to(out[j], lg_value(tape, want[j]), count, 1e-14);
        free(out[j]);
    }
    free(work);
    free(x);
    lg_plan_destroy(plan);
    lg_tape_destroy(tape);
}

static void plans_equal_recorded(void **state) {
    (void)state;
    const lg_activation kinds[] = {LG_TANH,       LG_SIGMOID, LG_SWISH,   LG_RELU,
                                   LG_LEAKY_RELU, LG_SINE,    LG_IDENTITY};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        for (uint32_t width = 2; width <= 20; width += 6) {
            network n;
            make_network(&n, 3, width, 1, kinds[k]);
            lg_program *program = build_network(&n);
            for (size_t rows = 1; rows <= 40; rows += 13) {
                compare_plan(program, 0, &n, record_value, 1, rows);
                compare_plan(program, 1, &n, record_gradient, 2, rows);
                compare_plan(program, 2, &n, record_loss, 1, rows);
            }
            lg_program_destroy(program);
            free(n.theta);
        }
}

/* ---- derivatives ---- */

/* y = (sin(q u), net(q, u) + q . u): two inputs, two outputs, of every sort of operation that networks and
 * mechanics have. */
enum { Q = 3, U = 2, Y0 = 6, Y1 = 2 };

static lg_status record_pair(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const uint32_t rows = lg_var_shape(tape, in[0]).dims[0];
    lg_var outer = lg_matmul(tape, lg_reshape(tape, in[0], lg_shape3(rows, Q, 1)),
                             lg_reshape(tape, in[1], lg_shape3(rows, 1, U)));
    lg_var both[2] = {in[0], in[1]};
    lg_var net = lg_mlp_apply(tape, user, theta[0], 0, lg_concat(tape, both, 2, 1));
    lg_var dot = lg_rowdot(tape, lg_slice(tape, in[0], 1, 0, U), in[1]);
    out[0] = lg_sin(tape, lg_reshape(tape, outer, lg_shape2(rows, Y0)));
    out[1] = lg_add(tape, net, dot);
    return lg_tape_status(tape);
}

static lg_program *build_pair(network *n) {
    static const lg_port in[2] = {{.name = "q", .shape = {1, {Q, 0, 0, 0}}},
                                  {.name = "u", .shape = {1, {U, 0, 0, 0}}}};
    static const lg_port out[2] = {{.name = "a"}, {.name = "b"}};
    const lg_parameter_spec theta = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta};
    const lg_function_spec function = {"pair", in, 2, out, 2, record_pair, &n->net};
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_error error;
    lg_program_spec_init(&spec);
    spec.parameters = &theta;
    spec.parameter_count = 1;
    spec.functions = &function;
    spec.function_count = 1;
    if (lg_program_build(NULL, &spec, &program, &error) != LG_OK) fail_msg("%s", error.message);
    return program;
}

static size_t derived(lg_program *program, lg_derivative_kind kind, const char *function) {
    lg_derivative what;
    lg_error error;
    lg_derivative_init(&what);
    what.kind = kind;
    what.function = function;
    if (lg_program_derive(program, &what, &error) != LG_OK) fail_msg("%s", error.message);
    return lg_program_functions(program) - 1;
}

/* Runs a function on rows of inputs; outputs one after another in out. */
static void run_rows(const lg_program *program, size_t function, size_t rows, const double *const *in,
                     double **out) {
    lg_plan_options options;
    lg_plan *plan;
    lg_error error;
    size_t count;
    lg_plan_options_init(&options);
    options.rows = rows;
    if (lg_plan_create(program, function, &options, &plan, &error) != LG_OK) fail_msg("%s", error.message);
    void *work = aligned_alloc(64, lg_plan_work_size(plan)), *to[64];
    memset(work, 0xff, lg_plan_work_size(plan));
    (void)lg_program_outputs(program, function, &count);
    for (size_t j = 0; j < count; j++)
        to[j] = out[j] = malloc(lg_plan_output_count(plan, j) * sizeof(double));
    lg_plan_run(plan, (const void *const *)in, to, work);
    free(work);
    lg_plan_destroy(plan);
}

typedef struct pair_point {
    double q[Q], u[U], da[Y0], db[Y1];
} pair_point;

/* Each row's Jacobians by the tape, row by row: of (a, b) by (q, u), and of the adjoint by (q, u, da, db). */
typedef struct pair_truth {
    double jac[4][Y0 * Q], adj[2][Q], jac_adj[8][Q * Y0];
    size_t jac_count[4], jac_adj_count[8];
} pair_truth;

static void read_all(const lg_tape *tape, lg_var v, double *out, size_t *count) {
    *count = lg_shape_count(lg_var_shape(tape, v));
    assert_int_equal(lg_read(tape, v, out, *count), LG_OK);
}

static void true_derivatives(network *n, const pair_point *p, pair_truth *t) {
    lg_tape *tape;
    size_t count;
    assert_int_equal(lg_tape_create(NULL, NULL, &tape), LG_OK);
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta);
    lg_var x[4] = {lg_input(tape, lg_shape2(1, Q), p->q), lg_input(tape, lg_shape2(1, U), p->u),
                   lg_input(tape, lg_shape2(1, Y0), p->da), lg_input(tape, lg_shape2(1, Y1), p->db)};
    lg_var y[2], adj[2];
    assert_int_equal(record_pair(&n->net, tape, &theta, x, y), LG_OK);
    for (size_t j = 0; j < 2; j++)
        for (size_t i = 0; i < 2; i++)
            read_all(tape, lg_jacobian(tape, y[j], x[i]), t->jac[2 * j + i], &t->jac_count[2 * j + i]);
    assert_int_equal(lg_vjp(tape, y, x + 2, 2, x, 2, adj), LG_OK);
    for (size_t j = 0; j < 2; j++) {
        read_all(tape, adj[j], t->adj[j], &count);
        for (size_t i = 0; i < 4; i++)
            read_all(tape, lg_jacobian(tape, adj[j], x[i]), t->jac_adj[4 * j + i],
                     &t->jac_adj_count[4 * j + i]);
    }
    lg_tape_destroy(tape);
}

static void derivatives_are_those_of_the_tape(void **state) {
    (void)state;
    enum { ROWS = 5 };
    network n;
    make_network(&n, Q + U, 10, Y1, LG_TANH);
    lg_program *program = build_pair(&n);
    const size_t jac = derived(program, LG_DERIVATIVE_JACOBIAN, "pair");
    const size_t adj = derived(program, LG_DERIVATIVE_ADJOINT, "pair");
    const size_t jac_adj = derived(program, LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "pair");
    const size_t fwd = derived(program, LG_DERIVATIVE_FORWARD, "pair");
    lg_rng rng;
    lg_rng_seed(&rng, 6, 1);
    pair_point point[ROWS];
    pair_truth truth[ROWS];
    double q[ROWS * Q], u[ROWS * U], da[ROWS * Y0], db[ROWS * Y1];
    for (size_t r = 0; r < ROWS; r++) {
        double *all = (double *)&point[r];
        for (size_t i = 0; i < sizeof point[r] / sizeof(double); i++) all[i] = lg_rng_normal(&rng);
        memcpy(q + r * Q, point[r].q, sizeof point[r].q);
        memcpy(u + r * U, point[r].u, sizeof point[r].u);
        memcpy(da + r * Y0, point[r].da, sizeof point[r].da);
        memcpy(db + r * Y1, point[r].db, sizeof point[r].db);
        true_derivatives(&n, &point[r], &truth[r]);
    }
    for (size_t rows = 1; rows <= ROWS; rows += 2) {
        double *out[8];
        run_rows(program, jac, rows, (const double *const[]){q, u}, out);
        for (size_t j = 0; j < 4; j++) {
            for (size_t r = 0; r < rows; r++)
                close_to(out[j] + r * truth[r].jac_count[j], truth[r].jac[j], truth[r].jac_count[j], 1e-13);
            free(out[j]);
        }
        run_rows(program, adj, rows, (const double *const[]){q, u, da, db}, out);
        for (size_t j = 0; j < 2; j++) {
            const size_t count = j == 0 ? Q : U;
            for (size_t r = 0; r < rows; r++) close_to(out[j] + r * count, truth[r].adj[j], count, 1e-13);
            free(out[j]);
        }
        run_rows(program, jac_adj, rows, (const double *const[]){q, u, da, db}, out);
        for (size_t j = 0; j < 8; j++) {
            for (size_t r = 0; r < rows; r++)
                close_to(out[j] + r * truth[r].jac_adj_count[j], truth[r].jac_adj[j],
                         truth[r].jac_adj_count[j], 1e-13);
            free(out[j]);
        }
        /* <c, J d> = <J^T c, d>, with d = (q, u) */
        run_rows(program, fwd, rows, (const double *const[]){q, u, q, u}, out);
        for (size_t r = 0; r < rows; r++) {
            double left = 0.0, right = 0.0;
            for (size_t i = 0; i < Y0; i++) left += out[0][r * Y0 + i] * da[r * Y0 + i];
            for (size_t i = 0; i < Y1; i++) left += out[1][r * Y1 + i] * db[r * Y1 + i];
            for (size_t i = 0; i < Q; i++) right += truth[r].adj[0][i] * q[r * Q + i];
            for (size_t i = 0; i < U; i++) right += truth[r].adj[1][i] * u[r * U + i];
            assert_close(left, right, 1e-12, 1e-12);
        }
        free(out[0]);
        free(out[1]);
    }
    lg_program_destroy(program);
    free(n.theta);
}

/* a_{2i+j} = sin(q_i u_j); b = net(q, u) + q . u depends on everything. */
static void sparsity_is_structural(void **state) {
    (void)state;
    network n;
    make_network(&n, Q + U, 10, Y1, LG_TANH);
    memset(n.theta, 0, lg_mlp_parameters(&n.net) * sizeof *n.theta); /* the weights do not count */
    lg_program *program = build_pair(&n);
    unsigned char by_q[Y0 * Q], by_u[Y0 * U], all[Y1 * Q];
    lg_error error;
    assert_int_equal(lg_program_sparsity(program, 0, 0, 0, by_q, &error), LG_OK);
    assert_int_equal(lg_program_sparsity(program, 0, 0, 1, by_u, &error), LG_OK);
    assert_int_equal(lg_program_sparsity(program, 0, 1, 0, all, &error), LG_OK);
    for (size_t a = 0; a < Y0; a++) {
        for (size_t i = 0; i < Q; i++) assert_int_equal(by_q[a * Q + i], a / U == i);
        for (size_t j = 0; j < U; j++) assert_int_equal(by_u[a * U + j], a % U == j);
    }
    for (size_t i = 0; i < Y1 * Q; i++) assert_int_equal(all[i], 1);
    assert_int_equal(lg_program_sparsity(program, 0, 2, 0, all, &error), LG_NOT_FOUND);
    assert_int_equal(lg_program_sparsity(program, 1, 0, 0, all, &error), LG_NOT_FOUND);
    lg_program_destroy(program);
    free(n.theta);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(applied_equals_recorded),
        cmocka_unit_test(plans_equal_recorded),
        cmocka_unit_test(derivatives_are_those_of_the_tape),
        cmocka_unit_test(sparsity_is_structural),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
