/* Convolutional networks compared with plain loops: default networks of all sizes, values and gradients on a
 * tape, refusals. */
#include "support/fixtures.h"

#include "liegrad/networks.h"
#include "liegrad/ops.h"
#include "nn/odd_nets.h"
#include "nn/plain_layers.h"

/* ---- the definition, in double ---- */

/* Computes a block of x (L, C) and returns an array (L'', O). *length and *channels get the sizes of the
 * result. */
static const double *naive_block(const lg_cnn *net, const lg_cnn_block *b, const double *x, size_t *length,
                                 size_t *channels, const double **theta) {
    const size_t l = *length, c_in = *channels, o = b->channels;
    const size_t convolved = (l + 2 * b->padding - b->kernel) / b->stride + 1;
    const double *w = *theta, *bias = w + b->kernel * c_in * o;
    double *y = TEST_ARRAY(double, convolved *o);
    for (size_t t = 0; t < convolved; t++)
        for (size_t p = 0; p < o; p++) {
            double sum = bias[p];
            for (size_t j = 0; j < b->kernel; j++)
                for (size_t c = 0; c < c_in; c++) {
                    const long at = (long)(b->stride * t + j) - (long)b->padding;
                    if (at >= 0 && at < (long)l) sum += x[(size_t)at * c_in + c] * w[(j * c_in + c) * o + p];
                }
            y[t * o + p] = plain_activation(net->activation, sum);
        }
    *theta = bias + o;
    *channels = o;
    *length = convolved;
    if (b->pooling == LG_POOL_NONE) return y;
    const size_t pooled = (convolved - b->pool_size) / b->pool_stride + 1;
    double *z = TEST_ARRAY(double, pooled *o);
    for (size_t t = 0; t < pooled; t++)
        for (size_t p = 0; p < o; p++) {
            double sum = 0.0, most = -INFINITY;
            for (size_t j = 0; j < b->pool_size; j++) {
                const double value = y[(b->pool_stride * t + j) * o + p];
                sum += value;
                most = value > most ? value : most;
            }
            z[t * o + p] = b->pooling == LG_POOL_MAX ? most : sum / b->pool_size;
        }
    *length = pooled;
    return z;
}

/* The outputs for one series x (L, C). */
static void naive(const lg_cnn *net, const double *theta, const double *x, double *y, double *plane) {
    size_t length = net->length, channels = net->channels;
    const double *h = x;
    for (uint32_t i = 0; i < net->blocks; i++) {
        h = naive_block(net, &net->block[i], h, &length, &channels, &theta);
        assert_int_equal(length, net->lengths[i + 1]);
    }
    size_t in = length * channels;
    if (net->plane > 0) {
        plain_dense(&theta, in, net->plane, true, net->activation, h, plane);
        in = net->plane;
    }
    plain_dense(&theta, in, net->outputs, true, LG_IDENTITY, net->plane > 0 ? plane : h, y);
}

/* ---- networks ---- */

static lg_cnn initialised(lg_cnn net) {
    assert_told(lg_cnn_init(&net, &told));
    return net;
}

static const struct {
    uint32_t channels, length;
} sizes[] = {{1, 1}, {1, 5}, {2, 7}, {6, 300}, {6, 100}, {1, 152}, {1, 96}, {13, 31}};
enum { SIZES = LG_COUNT(sizes), ALL_NETS = ODD_NETS + SIZES };

static lg_cnn default_net(uint32_t channels, uint32_t length, uint32_t outputs, lg_activation activation) {
    lg_cnn net;
    lg_cnn_init_default(&net, channels, length, outputs, activation);
    return net;
}

static lg_cnn net_number(size_t i, lg_activation kind) {
    if (i >= ODD_NETS) return default_net(sizes[i - ODD_NETS].channels, sizes[i - ODD_NETS].length, 2, kind);
    lg_cnn net = odd_nets[i];
    net.activation = kind;
    return initialised(net);
}

enum { ROWS = 3 };

typedef struct example {
    lg_cnn net;
    size_t parameters, numbers;
    double *theta, *x; /* (ROWS, L, C) */
} example;

static example make(lg_cnn net) {
    example e = {
        .net = net, .parameters = lg_cnn_parameters(&net), .numbers = (size_t)net.length * net.channels};
    lg_rng rng = test_rng(21, 0);
    e.theta = TEST_ARRAY(double, e.parameters);
    lg_cnn_initialise(&net, &rng, e.theta);
    e.x = TEST_ARRAY(double, ROWS *e.numbers);
    for (size_t i = 0; i < ROWS * e.numbers; i++) e.x[i] = lg_rng_normal(&rng);
    return e;
}

enum { OFFSET = 3 };

/* Logits and plane of the first `rows` series on a tape. OFFSET other numbers precede the network's
 * parameters. */
static void evaluate(const example *e, lg_tape *tape, uint32_t rows, double *y, double *plane) {
    const lg_cnn *net = &e->net;
    lg_tape_reset(tape);
    double *flat = TEST_ARRAY(double, e->parameters + OFFSET);
    memcpy(flat + OFFSET, e->theta, e->parameters * sizeof *flat);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)e->parameters + OFFSET), flat);
    const lg_var x = lg_input_f64(tape, lg_shape3(rows, net->length, net->channels), e->x);
    lg_var at = LG_NONE;
    const lg_var out = lg_cnn_record(tape, net, theta, OFFSET, x, &at);
    if (lg_tape_status(tape) != LG_OK) fail_msg("%s", lg_tape_message(tape));
    assert_ok(lg_read(tape, out, rows * net->outputs, y));
    assert_int_equal(lg_is_none(at), net->plane == 0);
    if (net->plane > 0) assert_ok(lg_read(tape, at, rows * net->plane, plane));
}

/* ---- descriptions ---- */

TEST("the default network has its layers, names and lengths") {
    static const char *const names[] = {"conv1/weight",  "conv1/bias", "conv2/weight", "conv2/bias",
                                        "conv3/weight",  "conv3/bias", "plane/weight", "plane/bias",
                                        "output/weight", "output/bias"};
    static const uint64_t dims[][3] = {{5, 6, 12}, {12},      {5, 12, 24}, {24},   {5, 24, 48},
                                       {48},       {1632, 2}, {2},         {2, 1}, {1}};
    const lg_cnn net = default_net(6, 300, 1, LG_LEAKY_RELU);
    assert_int_equal(lg_cnn_parameters(&net), 10913);
    static const uint32_t lengths[] = {300, 148, 72, 34};
    for (int i = 0; i < 4; i++) assert_int_equal(net.lengths[i], lengths[i]);
    lg_slice_info info;
    size_t at = 0;
    for (uint32_t i = 0; i < 10; i++) {
        assert_true(lg_cnn_slice(&net, i, &info));
        assert_string_equal(info.name, names[i]);
        assert_int_equal(info.offset, at);
        uint64_t count = 1;
        assert_int_equal(info.rank, dims[i][2] > 0 ? 3 : dims[i][1] > 0 ? 2 : 1);
        for (uint32_t d = 0; d < info.rank; d++) {
            assert_int_equal(info.dims[d], dims[i][d]);
            count *= dims[i][d];
        }
        assert_int_equal(info.count, count);
        at += info.count;
    }
    assert_int_equal(at, 10913);
    assert_false(lg_cnn_slice(&net, 10, &info));
    const lg_cnn classes = default_net(6, 300, 4, LG_SWISH);
    assert_int_equal(lg_cnn_parameters(&classes), 10910 + 12);
}

TEST("default networks of all sizes can be made and evaluated") {
    lg_error error;
    lg_tape *tape = test_tape(LG_F64);
    for (uint32_t c = 1; c <= 8; c++)
        for (uint32_t l = 1; l <= 64; l++)
            for (uint32_t outputs = 1; outputs <= 3; outputs += 2) {
                lg_cnn net = default_net(c, l, outputs, LG_TANH);
                const lg_cnn before = net;
                if (lg_cnn_init(&net, &error) != LG_OK) fail_msg("%u x %u: %s", c, l, error.message);
                assert_memory_equal(before.lengths, net.lengths, sizeof net.lengths);
                assert_in_range(net.blocks, 1, 3);
                assert_true(net.lengths[net.blocks] >= 1);
                assert_int_equal(net.block[0].kernel, l < 5 ? l : 5);
                if (l >= 36) assert_int_equal(net.blocks, 3);
                for (uint32_t i = 0; i < net.blocks; i++)
                    assert_int_equal(net.block[i].channels, c << (i + 1));
                example e = make(net);
                double y[3], plane[2];
                evaluate(&e, tape, 1, y, plane);
                for (uint32_t i = 0; i < outputs; i++) assert_true(isfinite(y[i]));
            }
    static const uint32_t extremes[] = {1, 3, 511, 512, 513, 4095, 1 << 20};
    for (size_t i = 0; i < 7; i++)
        for (size_t j = 0; j < 7; j++) {
            lg_cnn net = default_net(extremes[i], extremes[j], 1 << 20, LG_TANH);
            if (lg_cnn_init(&net, &error) != LG_OK)
                fail_msg("%u x %u: %s", extremes[i], extremes[j], error.message);
        }
    lg_cnn nothing = default_net(0, 0, 0, LG_TANH);
    assert_status(lg_cnn_init(&nothing, &error), LG_INVALID_ARGUMENT);
}

/* LINE: a network for a series of 9 samples. BLOCK: a LINE with one block. */
#define LINE(...)                                                                                            \
    { .channels = 1, .length = 9, .outputs = 1, __VA_ARGS__ }
#define BLOCK(...) LINE(.blocks = 1, .block = {{__VA_ARGS__}})
#define SIZES_OF(c, l, o, p)                                                                                 \
    { .channels = c, .length = l, .outputs = o, .plane = p }
#define M (1u << 20)

TEST("a refused description is reported with the block, and stays unchanged") {
    static const struct {
        lg_cnn net;
        const char *sentence;
    } bad[] = {
        {SIZES_OF(0, 9, 1, 0), "0 channels"},
        {SIZES_OF(1, 0, 1, 0), "0 samples"},
        {SIZES_OF(1, 9, 0, 0), "0 outputs"},
        {SIZES_OF(1, M + 1, 1, 0), "2^20"},
        {SIZES_OF(1, 9, 1, UINT32_MAX), "2^20"},
        {LINE(.blocks = 9), "9 blocks"},
        {LINE(.activation = (lg_activation)LG_ACTIVATION_COUNT), "activation"},
        {BLOCK(0, 1, 1, 0, LG_POOL_NONE, 0, 0), "block 1"},
        {BLOCK(1, 0, 1, 0, LG_POOL_NONE, 0, 0), "block 1"},
        {BLOCK(1, 1, 0, 0, LG_POOL_NONE, 0, 0), "block 1"},
        {BLOCK(1, 10, 1, 0, LG_POOL_NONE, 0, 0), "block 1: a kernel of 10"},
        {BLOCK(1, 2, 1, 2, LG_POOL_NONE, 0, 0), "padding of 2"},
        {BLOCK(1, 2, 1, UINT32_MAX, LG_POOL_NONE, 0, 0), "padding"},
        {BLOCK(1, 2, 1, 0, LG_POOL_MAX, 0, 0), "pooling size"},
        {BLOCK(1, 2, 1, 0, LG_POOL_MAX, 9, 1), "block 1: the pooling size is 9"},
        {BLOCK(1, 2, 1, 0, (lg_pooling)LG_POOLING_COUNT, 0, 0), "pooling"},
        {SIZES_OF(1 << 16, 1 << 16, 1, 0), "2^31 parameters"},
        {SIZES_OF(M, M, M, M), "2^31 parameters"},
        {{.channels = M, .length = M, .outputs = 1, .blocks = 1, .block = {{M, M, 1, 0, LG_POOL_NONE, 0, 0}}},
         "2^31 parameters"},
    };
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        lg_cnn net = bad[i].net;
        net.lengths[0] = 77;
        assert_status(lg_cnn_init(&net, &error), LG_INVALID_ARGUMENT);
        if (strstr(error.message, bad[i].sentence) == NULL)
            fail_msg("\"%s\" does not name \"%s\"", error.message, bad[i].sentence);
        assert_int_equal(net.lengths[0], 77);
    }
    lg_cnn second = default_net(1, 30, 1, LG_TANH);
    second.block[1].kernel = 14; /* 13 samples are left */
    assert_status(lg_cnn_init(&second, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "block 2"));
}

TEST("poolings have their names") {
    ASSERT_NAMES(lg_pooling, lg_pooling, LG_POOLING_COUNT);
}

TEST("initial weights have their deviation by fan in, and biases are drawn") {
    const lg_cnn net = default_net(6, 300, 1, LG_TANH);
    double *theta = TEST_ARRAY(double, 10913), squares = 0.0, biases = 0.0;
    lg_slice_info w, b;
    lg_rng rng = test_rng(4, 4);
    lg_cnn_initialise(&net, &rng, theta);
    assert_true(lg_cnn_slice(&net, 2, &w) && lg_cnn_slice(&net, 3, &b));
    for (size_t j = 0; j < w.count; j++)
        squares += theta[w.offset + j] * theta[w.offset + j] / (double)w.count;
    for (size_t j = 0; j < b.count; j++) biases += fabs(theta[b.offset + j]);
    assert_close(squares, 1.0 / 60 / 3, 0.12, 0);
    assert_true(biases > 0.0);
}

/* ---- values ---- */

TEST("networks on a tape agree with plain loops, in both types") {
    for (int dtype = LG_F64; dtype <= LG_F32; dtype++) {
        const double rtol = dtype == LG_F64 ? 1e-12 : 2e-5, atol = dtype == LG_F64 ? 1e-13 : 2e-5;
        lg_tape *tape = test_tape((lg_dtype)dtype);
        for (size_t i = 0; i < ALL_NETS * LG_ACTIVATION_COUNT; i++) {
            double y[ROWS * 4], plane[ROWS * 4], wanted[4], wanted_plane[4];
            const lg_cnn net = net_number(i % ALL_NETS, (lg_activation)(i / ALL_NETS));
            const example e = make(net);
            evaluate(&e, tape, ROWS, y, plane);
            for (size_t r = 0; r < ROWS; r++) {
                naive(&net, e.theta, e.x + r * e.numbers, wanted, wanted_plane);
                for (size_t j = 0; j < net.outputs; j++)
                    assert_close(y[r * net.outputs + j], wanted[j], rtol, atol);
                for (size_t j = 0; j < net.plane; j++)
                    assert_close(plane[r * net.plane + j], wanted_plane[j], rtol, atol);
            }
        }
    }
}

TEST("shapes, offsets and tapes that do not fit are refused") {
    const lg_cnn net = default_net(2, 12, 1, LG_TANH);
    const uint32_t parameters = (uint32_t)lg_cnn_parameters(&net);
    lg_tape *tape = test_tape(LG_F64), *other = test_tape(LG_F64);
    const struct {
        lg_shape x;
        uint32_t theta;
        size_t offset;
    } bad[] = {{lg_shape3(1, 2, 12), parameters, 0},         {lg_shape2(12, 2), parameters, 0},
               {lg_shape3(1, 11, 2), parameters, 0},         {lg_shape3(1, 12, 3), parameters, 0},
               {lg_shape3(1, 12, 2), parameters - 1, 0},     {lg_shape3(1, 12, 2), parameters, 1},
               {lg_shape3(1, 12, 2), parameters, UINT32_MAX}};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        lg_tape_reset(tape);
        const lg_var theta = lg_full(tape, lg_shape1(bad[i].theta), 0.0);
        const lg_var x = lg_full(tape, bad[i].x, 0.0);
        lg_var plane = x;
        assert_true(lg_is_none(lg_cnn_record(tape, &net, theta, bad[i].offset, x, &plane)));
        assert_true(lg_is_none(plane));
        if (lg_tape_status(tape) == LG_OK) fail_msg("case %zu", i);
        assert_true(strlen(lg_tape_message(tape)) > 0);
    }
    lg_tape_reset(tape);
    const lg_var theta = lg_full(tape, lg_shape1(parameters), 0.0);
    const lg_var foreign = lg_full(other, lg_shape3(1, 12, 2), 0.0);
    assert_true(lg_is_none(lg_cnn_record(tape, &net, theta, 0, foreign, NULL)));
    assert_status(lg_tape_status(tape), LG_STALE_HANDLE);
}

/* ---- gradients ---- */

TEST("at its kink a rectifier has the derivative 0") {
    const lg_cnn net = net_number(0, LG_RELU);
    example e = make(net);
    lg_slice_info first;
    assert_true(lg_cnn_slice(&net, 0, &first));
    for (size_t j = first.count; j < e.parameters; j++) e.theta[j] = fabs(e.theta[j]);
    memset(e.theta + first.count, 0, net.block[0].channels * sizeof *e.theta);
    memset(e.x, 0, e.numbers * sizeof *e.x);
    lg_tape *tape = test_tape(LG_F64);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)e.parameters), e.theta);
    const lg_var x = lg_input_f64(tape, lg_shape3(1, net.length, net.channels), e.x);
    lg_var gradient = LG_NONE;
    double *g = TEST_ARRAY(double, e.numbers);
    assert_ok(lg_grad(tape, lg_sum(tape, lg_cnn_record(tape, &net, theta, 0, x, NULL)), &x, 1, &gradient));
    assert_ok(lg_read(tape, gradient, e.numbers, g));
    for (size_t j = 0; j < e.numbers; j++) assert_close(g[j], 0.0, 0, 0);
}
