/* Networks of several architectures: description, values against a direct evaluation of their formulas, and
 * derivatives computed in several ways against each other. */
#include "nn_support.h"

#include "kernels/kernels.h"
#include "liegrad/networks.h"
#include "plain_layers.h"

enum { ROWS = 5, MAX_WIDTH = 16, MAX_PARAMETERS = 1200 };

/* ---- the formulas, one row at a time ---- */

static void plain(const lg_net *net, const double *theta, const double *x, double *y) {
    double e[MAX_WIDTH], u[MAX_WIDTH], v[MAX_WIDTH], h[MAX_WIDTH], z[MAX_WIDTH], w[MAX_WIDTH];
    uint32_t in = net->inputs;
    const uint32_t n = net->hidden;
    const bool gated = net->kind == LG_NET_MULT || net->kind == LG_NET_MULT_AFFINE;
    memcpy(e, x, in * sizeof *x);
    if (net->embedding > 0) {
        plain_dense(&theta, in, net->embedding, true, LG_IDENTITY, x, e);
        in = net->embedding;
        for (uint32_t i = 0; i < in; i++) e[i] = sin(6.283185307179586 * e[i]);
    }
    if (gated) {
        plain_dense(&theta, in, n, true, net->activation, e, u);
        plain_dense(&theta, in, n, true, net->activation, e, v);
    }
    plain_dense(&theta, in, n, true, net->activation, e, h);
    for (uint32_t l = 0; l < net->layers; l++) {
        plain_dense(&theta, n, n, true, net->activation, h, z);
        memcpy(w, z, sizeof w);
        if (net->kind == LG_NET_RESNET) plain_dense(&theta, n, n, false, LG_IDENTITY, z, w);
        if (net->kind == LG_NET_MULT_AFFINE) plain_dense(&theta, n, n, true, LG_IDENTITY, z, w);
        for (uint32_t j = 0; j < n; j++) {
            if (gated)
                h[j] = (1.0 - w[j]) * u[j] + w[j] * v[j];
            else
                h[j] = net->kind == LG_NET_RESNET ? h[j] + w[j] : w[j];
        }
    }
    plain_dense(&theta, n, net->outputs, true, LG_IDENTITY, h, y);
}

/* ---- networks under test ---- */

typedef struct fixture {
    lg_net net;
    size_t n;
    double theta[MAX_PARAMETERS], x[ROWS * MAX_WIDTH], dx[ROWS * MAX_WIDTH];
} fixture;

static void setup(fixture *f, lg_net_kind kind, uint32_t embedding, uint32_t layers,
                  lg_activation activation) {
    assert_ok(lg_net_init(&f->net, kind, 3, embedding, 7, layers, 2, activation));
    f->n = lg_net_parameters(&f->net);
    assert_true(f->n <= MAX_PARAMETERS);
    lg_rng rng = test_rng(11 + (uint64_t)kind, embedding);
    lg_net_initialise(&f->net, &rng, f->theta);
    for (size_t i = 0; i < ROWS * MAX_WIDTH; i++) {
        f->x[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
        f->dx[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
    }
}

/* Checks every kind, with and without an embedding, with several activations, and also without layers. */
static void each(void (*check)(fixture *f)) {
    static const lg_activation kinds[4] = {LG_TANH, LG_SIGMOID, LG_SWISH, LG_SINE};
    fixture f;
    for (int kind = 0; kind < LG_NET_KIND_COUNT; kind++)
        for (uint32_t embedding = 0; embedding <= 6; embedding += 6)
            for (uint32_t layers = 0; layers <= 3; layers += 3)
                for (size_t a = 0; a < sizeof kinds / sizeof kinds[0]; a++) {
                    setup(&f, (lg_net_kind)kind, embedding, layers, kinds[a]);
                    check(&f);
                }
}

/* ---- descriptions ---- */

TEST("kinds of networks have their names") {
    ASSERT_NAMES(lg_net_kind, lg_net_kind, LG_NET_KIND_COUNT);
    assert_string_equal(lg_net_kind_name(LG_NET_MULT_AFFINE), "mult-affine");
}

TEST("networks have the numbers of parameters of their formulas") {
    lg_net net;
    assert_ok(lg_net_init(&net, LG_NET_MULT, 9, 190, 190, 5, 2, LG_TANH));
    assert_int_equal(lg_net_parameters(&net), 292602);
    assert_ok(lg_net_init(&net, LG_NET_MULT_AFFINE, 9, 190, 190, 5, 2, LG_TANH));
    assert_int_equal(lg_net_parameters(&net), 474052);
    assert_ok(lg_net_init(&net, LG_NET_MLP, 8, 0, 879, 4, 196, LG_TANH));
    assert_int_equal(lg_net_parameters(&net), 3274471);
    assert_ok(lg_net_init(&net, LG_NET_RESNET, 2, 0, 3, 2, 1, LG_TANH));
    assert_int_equal(lg_net_parameters(&net), 9 + 2 * (12 + 9) + 4);
}

TEST("a refused description leaves the network unchanged") {
    lg_net net, before;
    assert_ok(lg_net_init(&net, LG_NET_MULT, 3, 0, 4, LG_NET_MAX_LAYERS, 2, LG_TANH));
    const uint32_t most = 1u << 20, kinds = LG_NET_KIND_COUNT, acts = LG_ACTIVATION_COUNT;
    const uint32_t bad[][7] = {{kinds, 3, 0, 4, 1, 2, LG_TANH},
                               {LG_NET_MLP, 0, 0, 4, 1, 2, LG_TANH},
                               {LG_NET_MLP, 3, 0, 0, 1, 2, LG_TANH},
                               {LG_NET_MLP, 3, 0, 4, 1, 0, LG_TANH},
                               {LG_NET_MLP, 3, 0, most + 1, 1, 2, LG_TANH},
                               {LG_NET_MLP, 3, most + 1, 4, 1, 2, LG_TANH},
                               {LG_NET_MLP, 3, 0, 4, LG_NET_MAX_LAYERS + 1, 2, LG_TANH},
                               {LG_NET_MLP, 3, 0, 4, 1, 2, acts}};
    before = net;
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(lg_net_init(&net, (lg_net_kind)bad[i][0], bad[i][1], bad[i][2], bad[i][3], bad[i][4],
                                  bad[i][5], (lg_activation)bad[i][6]),
                      LG_INVALID_ARGUMENT);
    assert_memory_equal(&net, &before, sizeof net);
}

/* Slices must follow one another and cover the vector; all names must differ. */
static void check_slices(fixture *f) {
    lg_slice_info slice = {.rank = 0};
    char names[64][48];
    size_t at = 0;
    uint32_t count = 0;
    for (; lg_net_slice(&f->net, count, &slice); count++) {
        assert_int_equal(slice.offset, at);
        assert_int_equal(slice.count, slice.rank == 2 ? slice.dims[0] * slice.dims[1] : slice.dims[0]);
        assert_non_null(strstr(slice.name, slice.rank == 2 ? "/weight" : "/bias"));
        for (uint32_t i = 0; i < count; i++) assert_string_not_equal(slice.name, names[i]);
        memcpy(names[count], slice.name, sizeof names[count]);
        at += slice.count;
    }
    assert_int_equal(at, f->n);
    assert_string_equal(names[0], f->net.embedding > 0           ? "embedding/weight"
                                  : f->net.kind == LG_NET_MLP    ? "layer1/weight"
                                  : f->net.kind == LG_NET_RESNET ? "first/weight"
                                                                 : "u/weight");
    assert_string_equal(names[count - 1], "output/bias");
}

TEST("slices follow one another, cover the vector and have different names") {
    each(check_slices);
    lg_net net;
    lg_slice_info slice;
    assert_ok(lg_net_init(&net, LG_NET_MULT_AFFINE, 3, 5, 7, 3, 2, LG_TANH));
    assert_true(lg_net_slice(&net, 11, &slice)); /* embedding, u, v, first, gate1, affine1 */
    assert_string_equal(slice.name, "affine1/bias");
    assert_false(lg_net_slice(&net, 22, &slice));
    assert_string_equal(slice.name, "affine1/bias");
}

/* Checks the bounds of the uniform distribution for each slice, and that no slice stays zero. */
static void check_initialisation(fixture *f) {
    lg_slice_info slice;
    double bound = 0.0;
    for (uint32_t i = 0; lg_net_slice(&f->net, i, &slice); i++) {
        double most = 0.0;
        if (slice.rank == 2) bound = 1.0 / sqrt((double)slice.dims[0]);
        for (size_t k = 0; k < slice.count; k++) most = fmax(most, fabs(f->theta[slice.offset + k]));
        assert_true(most <= bound && most > 0.1 * bound);
    }
}

TEST("initial parameters of every slice are within the bound of their distribution") {
    each(check_initialisation);
}

/* ---- the taped pair of value and derivative ---- */

/* Value and derivative of the pair along f->dx; for a single direction, along the first row of f->dx. */
static void record_pair(const fixture *f, lg_tape *tape, uint32_t directions, double *value,
                        double *derivative) {
    lg_var y = LG_NONE, dy = LG_NONE;
    lg_tape_reset(tape);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)f->n), f->theta);
    const lg_var x = lg_input_f64(tape, lg_shape2(ROWS, 3), f->x);
    const lg_var dx = lg_input_f64(tape, lg_shape2(directions, 3), f->dx);
    assert_ok(lg_net_record_jvp(tape, &f->net, theta, 0, x, dx, &y, &dy));
    assert_ok(lg_read(tape, y, ROWS * 2, value));
    assert_ok(lg_read(tape, dy, ROWS * 2, derivative));
}

/* The same numbers by lg_net_record and lg_jvp. */
static void record_plain(const fixture *f, lg_tape *tape, uint32_t directions, double *value,
                         double *derivative) {
    lg_var dy = LG_NONE;
    lg_tape_reset(tape);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)f->n), f->theta);
    const lg_var x = lg_input_f64(tape, lg_shape2(ROWS, 3), f->x);
    const lg_var dx =
        lg_broadcast_to(tape, lg_input_f64(tape, lg_shape2(directions, 3), f->dx), lg_shape2(ROWS, 3));
    const lg_var y = lg_net_record(tape, &f->net, theta, 0, x);
    assert_ok(lg_jvp(tape, &y, 1, &x, &dx, 1, &dy));
    assert_ok(lg_read(tape, y, ROWS * 2, value));
    assert_ok(lg_read(tape, dy, ROWS * 2, derivative));
}

static void check_values(fixture *f) {
    double value[2][ROWS * 2], derivative[2][ROWS * 2], y[2];
    lg_tape *tape = test_tape(LG_F64);
    for (uint32_t directions = 1; directions <= ROWS; directions += ROWS - 1) {
        record_pair(f, tape, directions, value[0], derivative[0]);
        record_plain(f, tape, directions, value[1], derivative[1]);
        for (size_t i = 0; i < ROWS * 2; i++) assert_close(derivative[0][i], derivative[1][i], 1e-12, 1e-13);
        for (size_t r = 0; r < ROWS; r++) {
            plain(&f->net, f->theta, f->x + 3 * r, y);
            for (size_t o = 0; o < 4; o++) assert_close(value[o / 2][2 * r + o % 2], y[o % 2], 1e-13, 1e-14);
        }
    }
}

TEST("values agree with the formulas, and the pair's derivatives with lg_jvp") {
    each(check_values);
}

static void check_single_precision(fixture *f) {
    double value[2][ROWS * 2], derivative[2][ROWS * 2];
    for (int dtype = LG_F64; dtype <= LG_F32; dtype++) {
        record_pair(f, test_tape((lg_dtype)dtype), ROWS, value[dtype != LG_F64], derivative[dtype != LG_F64]);
    }
    for (size_t i = 0; i < ROWS * 2; i++) {
        assert_close(value[1][i], value[0][i], 2e-5, 1e-5);
        assert_close(derivative[1][i], derivative[0][i], 1e-4, 1e-4);
    }
}

TEST("single precision agrees with double precision to rounding") {
    each(check_single_precision);
}

/* Sum of y^2 and (dy)^2, with dy by the pair or by recorded forward mode. */
static lg_var loss_of(lg_tape *tape, const fixture *f, lg_var theta, lg_var x, lg_var dx, bool pairs) {
    lg_var y = LG_NONE, dy = LG_NONE;
    if (pairs) {
        if (lg_net_record_jvp(tape, &f->net, theta, 1, x, dx, &y, &dy) != LG_OK) return LG_NONE;
    } else {
        y = lg_net_record(tape, &f->net, theta, 1, x);
        if (lg_jvp(tape, &y, 1, &x, &dx, 1, &dy) != LG_OK) return LG_NONE;
    }
    return lg_add(tape, lg_sum(tape, lg_square(tape, y)), lg_sum(tape, lg_square(tape, dy)));
}

/* The gradient with respect to theta, x and direction must be the same in four ways: by the last pass or
 * recorded, each through the pair or through lg_jvp. theta has one more element before and one after the
 * network's. */
static void check_gradients(fixture *f) {
    static double flat[MAX_PARAMETERS], out[4][MAX_PARAMETERS], by_x[4][ROWS * 3], by_dx[4][ROWS * 3];
    const uint32_t n = (uint32_t)f->n + 2;
    lg_tape *tape = test_tape(LG_F64);
    assert_true(n <= MAX_PARAMETERS);
    memset(out, 0, sizeof out);
    memset(by_x, 0, sizeof by_x);
    memset(by_dx, 0, sizeof by_dx);
    flat[0] = flat[n - 1] = 1e3;
    memcpy(flat + 1, f->theta, f->n * sizeof *flat);
    for (int way = 0; way < 4; way++) {
        lg_tape_reset(tape);
        const lg_var theta = lg_parameter(tape, lg_shape1(n), flat);
        const lg_var x = lg_input(tape, lg_shape2(ROWS, 3), f->x);
        const lg_var dx = lg_input(tape, lg_shape2(ROWS, 3), f->dx), wrt[3] = {theta, x, dx};
        const lg_var loss = loss_of(tape, f, theta, x, dx, way % 2 == 0);
        void *const into[3] = {out[way], by_x[way], by_dx[way]};
        if (way < 2) {
            assert_ok(lg_backward_set(tape, loss, wrt, 3, into));
            continue;
        }
        lg_var g[3];
        assert_ok(lg_grad(tape, loss, wrt, 3, g));
        assert_ok(lg_read(tape, g[0], n, out[way]));
        assert_ok(lg_read(tape, g[1], ROWS * 3, by_x[way]));
        assert_ok(lg_read(tape, g[2], ROWS * 3, by_dx[way]));
    }
    for (int way = 0; way < 3; way++) {
        assert_true(out[way][0] == 0.0 && out[way][n - 1] == 0.0);
        for (uint32_t i = 0; i < n; i++) assert_close(out[way][i], out[3][i], 1e-10, 1e-11);
        for (size_t i = 0; i < ROWS * 3; i++) {
            assert_close(by_x[way][i], by_x[3][i], 1e-10, 1e-11);
            assert_close(by_dx[way][i], by_dx[3][i], 1e-10, 1e-11);
        }
    }
}

TEST("the last pass and recorded gradients agree, through pairs and through lg_jvp") {
    each(check_gradients);
}

TEST("the gradient of a gradient is the same by pairs and by lg_jvp") {
    static double out[2][MAX_PARAMETERS], flat[MAX_PARAMETERS];
    static const lg_activation kinds[2] = {LG_TANH, LG_SINE};
    fixture f;
    for (int a = 0; a < 2; a++) {
        setup(&f, LG_NET_MULT_AFFINE, 6, 2, kinds[a]);
        lg_tape *tape = test_tape(LG_F64);
        memcpy(flat + 1, f.theta, f.n * sizeof *flat);
        for (int way = 0; way < 2; way++) {
            lg_tape_reset(tape);
            const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)f.n + 1), flat);
            const lg_var x = lg_input(tape, lg_shape2(ROWS, 3), f.x);
            const lg_var dx = lg_input(tape, lg_shape2(ROWS, 3), f.dx);
            lg_var g = LG_NONE;
            assert_ok(lg_grad(tape, loss_of(tape, &f, theta, x, dx, way == 0), &theta, 1, &g));
            void *into = out[way];
            assert_ok(lg_backward_set(tape, lg_sum(tape, lg_square(tape, g)), &theta, 1, &into));
        }
        for (size_t i = 0; i <= f.n; i++) assert_close(out[0][i], out[1][i], 1e-9, 1e-9);
    }
}

TEST("shapes and offsets that do not fit are refused") {
    fixture f;
    lg_var y = LG_NONE, dy = LG_NONE;
    lg_tape *tape = test_tape(LG_F64);
    setup(&f, LG_NET_MULT, 6, 3, LG_TANH);
    for (int i = 0; i < 4; i++) {
        lg_tape_reset(tape);
        const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)f.n - (i == 0)), f.theta);
        const lg_var x = lg_input(tape, lg_shape2(ROWS, i == 1 ? 2 : 3), f.x);
        const lg_var dx = lg_input(tape, lg_shape2(i == 2 ? 2 : 1, 3), f.dx);
        const lg_status status =
            lg_net_record_jvp(tape, &f.net, theta, i == 3 ? SIZE_MAX : 0, x, dx, &y, &dy);
        assert_int_not_equal(status, LG_OK);
        assert_int_equal(status, lg_tape_status(tape));
        assert_true(lg_is_none(y) && lg_is_none(dy));
    }
    lg_tape_reset(tape);
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)f.n - 1), f.theta);
    assert_true(lg_is_none(lg_net_record(tape, &f.net, theta, 0, lg_input(tape, lg_shape2(ROWS, 3), f.x))));
}

/* ---- kernels: the result for an element depends neither on its position nor on the other requested results
 * ---- */

enum { N = 37 };

static void check_positions(const lg_kernels *k, const float *z, const float *u, const float *v,
                            const float *g) {
    float y[N], d[3][N], some[N], y1, d1[3];
    const void *in[3] = {z, u, v};
    void *out[3] = {d[0], d[1], d[2]}, *only_v[3] = {NULL, NULL, some}, *out1[3] = {d1, d1 + 1, d1 + 2};
    const bool add[3] = {false, true, true};
    k->mix(N, z, u, v, y);
    memset(d, 0, sizeof d);
    memset(some, 0, sizeof some);
    k->mix_reverse(N, in, g, out, add);
    k->mix_reverse(N, in, g, only_v, add);
    assert_memory_equal(some, d[2], sizeof some);
    for (size_t i = 0; i < N; i++) {
        const void *in1[3] = {z + i, u + i, v + i};
        memset(d1, 0, sizeof d1);
        k->mix(1, z + i, u + i, v + i, &y1);
        k->mix_reverse(1, in1, g + i, out1, add);
        assert_true(y1 == y[i] && d1[0] == d[0][i] && d1[1] == d[1][i] && d1[2] == d[2][i]);
    }
    for (int kind = 0; kind < (int)LG_K_ACTS; kind++) {
        const bool reads_x = kind == LG_K_SWISH || kind == LG_K_SINE;
        memcpy(y, z, sizeof y);
        k->bias_act((lg_k_act)kind, 1, N, u, y);
        k->act_reverse((lg_k_act)kind, 0, N, z, reads_x ? NULL : y, g, NULL, NULL, false, d[0], false);
        for (size_t i = 0; i < N; i++) {
            y1 = z[i];
            k->bias_act((lg_k_act)kind, 1, 1, u + i, &y1);
            k->act_reverse((lg_k_act)kind, 0, 1, z + i, reads_x ? NULL : &y1, g + i, NULL, NULL, false, d1,
                           false);
            assert_true(y1 == y[i] && d1[0] == d[0][i]);
        }
    }
}

TEST("results of the kernels do not depend on an element's position or on other requested results") {
    float numbers[4][N];
    lg_rng rng = test_rng(5, 0);
    for (int p = 0; p < 4; p++)
        for (size_t i = 0; i < N; i++) numbers[p][i] = (float)lg_rng_uniform_in(&rng, -1.5, 1.5);
    for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
        const lg_kernels *k = lg_kernels_of(LG_F32, (lg_isa)isa);
        if (k != NULL) check_positions(k, numbers[0], numbers[1], numbers[2], numbers[3]);
    }
}
