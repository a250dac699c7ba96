/* Convolutional networks against the loops of their definition: default networks of all sizes, values and
 * gradients on a tape, what is refused. */
#include "test_support.h"

#include "liegrad/convolution.h"
#include "liegrad/gradcheck.h"
#include "liegrad/ops.h"
#include "nn/odd_nets.h"
#include "nn/plain_layers.h"

/* ---- the definition, in double ---- */

/* x (L, C) -> a new array (L'', O); *length, *channels become those of the result. Takes x. */
static double *naive_block(const lg_cnn *net, const lg_cnn_block *b, double *x, size_t *length,
                           size_t *channels, const double **theta) {
    const size_t l = *length, c_in = *channels, o = b->channels;
    const size_t convolved = (l + 2 * b->padding - b->kernel) / b->stride + 1;
    const double *w = *theta, *bias = w + b->kernel * c_in * o;
    double *y = calloc(convolved * o, sizeof *y);
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
    free(x);
    *theta = bias + o;
    *channels = o;
    *length = convolved;
    if (b->pooling == LG_POOL_NONE) return y;
    const size_t pooled = (convolved - b->pool_size) / b->pool_stride + 1;
    double *z = calloc(pooled * o, sizeof *z);
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
    free(y);
    *length = pooled;
    return z;
}

/* One series x (L, C). */
static void naive(const lg_cnn *net, const double *theta, const double *x, double *y, double *plane) {
    size_t length = net->length, channels = net->channels;
    double *h = malloc(length * channels * sizeof *h);
    memcpy(h, x, length * channels * sizeof *h);
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
    free(h);
}

/* ---- networks ---- */

static lg_cnn initialised(lg_cnn net) {
    lg_error error;
    if (lg_cnn_init(&net, &error) != LG_OK) fail_msg("%s", error.message);
    return net;
}

static const struct {
    uint32_t channels, length;
} sizes[] = {{1, 1}, {1, 5}, {2, 7}, {6, 300}, {6, 100}, {1, 152}, {1, 96}, {13, 31}};
enum { SIZES = LG_COUNT(sizes), ALL_NETS = ODD_NETS + SIZES };

static lg_cnn net_number(size_t i, lg_activation kind) {
    if (i >= ODD_NETS)
        return lg_cnn_defaults(sizes[i - ODD_NETS].channels, sizes[i - ODD_NETS].length, 2, kind);
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
    lg_rng rng;
    lg_rng_seed(&rng, 21, 0);
    e.theta = malloc(e.parameters * sizeof *e.theta);
    lg_cnn_initialise(&net, LG_INIT_FAN_IN, &rng, e.theta);
    e.x = malloc(ROWS * e.numbers * sizeof *e.x);
    for (size_t i = 0; i < ROWS * e.numbers; i++) e.x[i] = lg_rng_normal(&rng);
    return e;
}

static void release(example *e) {
    free(e->theta);
    free(e->x);
}

enum { OFFSET = 3 };

static lg_tape *tape_of(lg_dtype dtype) {
    lg_tape_options options;
    lg_tape *tape;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    return tape;
}

/* Logits and plane of the first `rows` series on a tape. OFFSET numbers that are not the network's lie before
 * its parameters. */
static void evaluate(const example *e, lg_dtype dtype, uint32_t rows, double *y, double *plane) {
    const lg_cnn *net = &e->net;
    lg_tape *tape = tape_of(dtype);
    double *flat = calloc(e->parameters + OFFSET, sizeof *flat);
    memcpy(flat + OFFSET, e->theta, e->parameters * sizeof *flat);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)e->parameters + OFFSET), flat);
    const lg_var x = lg_input_f64(tape, lg_shape3(rows, net->length, net->channels), e->x);
    lg_var at = LG_NONE;
    const lg_var out = lg_cnn_record(tape, net, theta, OFFSET, x, &at);
    if (lg_tape_status(tape) != LG_OK) fail_msg("%s", lg_tape_message(tape));
    assert_ok(lg_read(tape, out, y, rows * net->outputs));
    assert_int_equal(lg_is_none(at), net->plane == 0);
    if (net->plane > 0) assert_ok(lg_read(tape, at, plane, rows * net->plane));
    lg_tape_destroy(tape);
    free(flat);
}

/* ---- description ---- */

static void the_default(void **state) {
    (void)state;
    static const char *const names[] = {"conv1/weight",  "conv1/bias", "conv2/weight", "conv2/bias",
                                        "conv3/weight",  "conv3/bias", "plane/weight", "plane/bias",
                                        "output/weight", "output/bias"};
    static const uint64_t dims[][3] = {{5, 6, 12}, {12},      {5, 12, 24}, {24},   {5, 24, 48},
                                       {48},       {1632, 2}, {2},         {2, 1}, {1}};
    const lg_cnn net = lg_cnn_defaults(6, 300, 1, LG_LEAKY_RELU);
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
    const lg_cnn classes = lg_cnn_defaults(6, 300, 4, LG_SWISH);
    assert_int_equal(lg_cnn_parameters(&classes), 10910 + 12);
}

static void defaults_of_all_sizes(void **state) {
    (void)state;
    lg_error error;
    for (uint32_t c = 1; c <= 8; c++)
        for (uint32_t l = 1; l <= 64; l++)
            for (uint32_t outputs = 1; outputs <= 3; outputs += 2) {
                lg_cnn net = lg_cnn_defaults(c, l, outputs, LG_TANH);
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
                evaluate(&e, LG_F64, 1, y, plane);
                for (uint32_t i = 0; i < outputs; i++) assert_true(isfinite(y[i]));
                release(&e);
            }
    static const uint32_t extremes[] = {1, 3, 511, 512, 513, 4095, 1 << 20};
    for (size_t i = 0; i < 7; i++)
        for (size_t j = 0; j < 7; j++) {
            lg_cnn net = lg_cnn_defaults(extremes[i], extremes[j], 1 << 20, LG_TANH);
            if (lg_cnn_init(&net, &error) != LG_OK)
                fail_msg("%u x %u: %s", extremes[i], extremes[j], error.message);
        }
    lg_cnn nothing = lg_cnn_defaults(0, 0, 0, LG_TANH);
    assert_status(lg_cnn_init(&nothing, &error), LG_INVALID_ARGUMENT);
}

#define BLOCK(...) .blocks = 1, .block = {{__VA_ARGS__}}
static void refused(void **state) {
    (void)state;
    static const struct {
        lg_cnn net;
        const char *sentence;
    } bad[] = {
        {{.channels = 0, .length = 9, .outputs = 1}, "0 channels"},
        {{.channels = 1, .length = 0, .outputs = 1}, "0 samples"},
        {{.channels = 1, .length = 9, .outputs = 0}, "0 outputs"},
        {{.channels = 1, .length = (1 << 20) + 1, .outputs = 1}, "2^20"},
        {{.channels = 1, .length = 9, .outputs = 1, .plane = UINT32_MAX}, "2^20"},
        {{.channels = 1, .length = 9, .outputs = 1, .blocks = 9}, "9 blocks"},
        {{.channels = 1, .length = 9, .outputs = 1, .activation = (lg_activation)LG_ACTIVATION_COUNT},
         "activation"},
        {{.channels = 1, .length = 9, .outputs = 1, BLOCK(.channels = 0, .kernel = 1, .stride = 1)},
         "block 1"},
        {{.channels = 1, .length = 9, .outputs = 1, BLOCK(.channels = 1, .kernel = 0, .stride = 1)},
         "block 1"},
        {{.channels = 1, .length = 9, .outputs = 1, BLOCK(.channels = 1, .kernel = 1, .stride = 0)},
         "block 1"},
        {{.channels = 1, .length = 9, .outputs = 1, BLOCK(.channels = 1, .kernel = 10, .stride = 1)},
         "block 1: a kernel of 10"},
        {{.channels = 1,
          .length = 9,
          .outputs = 1,
          BLOCK(.channels = 1, .kernel = 2, .stride = 1, .padding = 2)},
         "padding of 2"},
        {{.channels = 1,
          .length = 9,
          .outputs = 1,
          BLOCK(.channels = 1, .kernel = 2, .stride = 1, .padding = UINT32_MAX)},
         "padding"},
        {{.channels = 1,
          .length = 9,
          .outputs = 1,
          BLOCK(.channels = 1, .kernel = 2, .stride = 1, .pooling = LG_POOL_MAX)},
         "pooling size"},
        {{.channels = 1,
          .length = 9,
          .outputs = 1,
          BLOCK(.channels = 1, .kernel = 2, .stride = 1, .pooling = LG_POOL_MAX, .pool_size = 9,
                .pool_stride = 1)},
         "block 1: pooling over 9"},
        {{.channels = 1,
          .length = 9,
          .outputs = 1,
          BLOCK(.channels = 1, .kernel = 2, .stride = 1, .pooling = (lg_pooling)LG_POOLING_COUNT)},
         "pooling"},
        {{.channels = 1 << 16, .length = 1 << 16, .outputs = 1}, "2^31 parameters"},
        {{.channels = 1 << 20, .length = 1 << 20, .outputs = 1 << 20, .plane = 1 << 20}, "2^31 parameters"},
        {{.channels = 1 << 20,
          .length = 1 << 20,
          .outputs = 1,
          BLOCK(.channels = 1 << 20, .kernel = 1 << 20, .stride = 1)},
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
    assert_status(lg_cnn_init(NULL, &error), LG_INVALID_ARGUMENT);
    lg_cnn second = lg_cnn_defaults(1, 30, 1, LG_TANH);
    second.block[1].kernel = 14; /* 13 are left */
    assert_status(lg_cnn_init(&second, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "block 2"));
}

static void pooling_names(void **state) {
    (void)state;
    for (int i = 0; i < LG_POOLING_COUNT; i++) {
        lg_pooling found = (lg_pooling)LG_POOLING_COUNT;
        assert_ok(lg_pooling_parse(lg_pooling_name((lg_pooling)i), &found));
        assert_int_equal(found, i);
    }
    lg_pooling kept = LG_POOL_MAX;
    assert_status(lg_pooling_parse("mean", &kept), LG_NOT_FOUND);
    assert_int_equal(kept, LG_POOL_MAX);
    assert_string_equal(lg_pooling_name((lg_pooling)LG_POOLING_COUNT), "unknown");
}

/* Bounds of uniform laws, deviations of normal ones, biases. Of conv2 of the default network for 6 channels:
 * fan in 60, fan out 120. */
static void initialisation(void **state) {
    (void)state;
    const lg_cnn net = lg_cnn_defaults(6, 300, 1, LG_TANH);
    static const struct {
        lg_initialisation kind;
        double deviation;
    } laws[] = {{LG_INIT_FAN_IN, 1.0 / 60 / 3},
                {LG_INIT_GLOROT_UNIFORM, 6.0 / 180 / 3},
                {LG_INIT_GLOROT_NORMAL, 2.0 / 180},
                {LG_INIT_HE_UNIFORM, 6.0 / 60 / 3},
                {LG_INIT_HE_NORMAL, 2.0 / 60}};
    double *theta = malloc(10913 * sizeof *theta);
    for (size_t i = 0; i < 5; i++) {
        lg_rng rng;
        lg_slice_info w, b;
        lg_rng_seed(&rng, 4, 4);
        lg_cnn_initialise(&net, laws[i].kind, &rng, theta);
        assert_true(lg_cnn_slice(&net, 2, &w) && lg_cnn_slice(&net, 3, &b));
        double squares = 0.0, biases = 0.0;
        for (size_t j = 0; j < w.count; j++)
            squares += theta[w.offset + j] * theta[w.offset + j] / (double)w.count;
        for (size_t j = 0; j < b.count; j++) biases += fabs(theta[b.offset + j]);
        assert_close(squares, laws[i].deviation, 0.12, 0);
        if (laws[i].kind == LG_INIT_FAN_IN)
            assert_true(biases > 0.0);
        else
            assert_close(biases, 0.0, 0, 0);
    }
    free(theta);
}

/* ---- values ---- */

static void against_loops(const example *e, lg_dtype dtype) {
    double y[ROWS * 4], plane[ROWS * 4], wanted[4], wanted_plane[4];
    const lg_cnn *net = &e->net;
    const double rtol = dtype == LG_F64 ? 1e-12 : 2e-5, atol = dtype == LG_F64 ? 1e-13 : 2e-5;
    evaluate(e, dtype, ROWS, y, plane);
    for (size_t r = 0; r < ROWS; r++) {
        naive(net, e->theta, e->x + r * e->numbers, wanted, wanted_plane);
        for (size_t i = 0; i < net->outputs; i++)
            assert_close(y[r * net->outputs + i], wanted[i], rtol, atol);
        for (size_t i = 0; i < net->plane; i++)
            assert_close(plane[r * net->plane + i], wanted_plane[i], rtol, atol);
    }
}

static void on_a_tape(void **state) {
    (void)state;
    for (int dtype = LG_F64; dtype <= LG_F32; dtype++)
        for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
            for (size_t i = 0; i < ALL_NETS; i++) {
                example e = make(net_number(i, (lg_activation)kind));
                against_loops(&e, (lg_dtype)dtype);
                release(&e);
            }
}

static void refused_on_a_tape(void **state) {
    (void)state;
    const lg_cnn net = lg_cnn_defaults(2, 12, 1, LG_TANH);
    const uint32_t parameters = (uint32_t)lg_cnn_parameters(&net);
    lg_tape *tape, *other;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    assert_ok(lg_tape_create(NULL, NULL, &other));
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
    lg_tape_destroy(tape);
    lg_tape_destroy(other);
}

/* ---- gradients ---- */

static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    const lg_cnn *net = user;
    return lg_cnn_record(tape, net, x[1], OFFSET, x[0], NULL);
}

static void gradients(void **state) {
    (void)state;
    static const lg_activation kinds[] = {LG_TANH, LG_SWISH, LG_SINE};
    for (size_t k = 0; k < 3; k++)
        for (size_t i = 0; i < ODD_NETS + 3; i++) {
            lg_cnn net = net_number(i, kinds[k]);
            for (uint32_t b = 0; b < net.blocks; b++) /* a maximum has kinks */
                if (net.block[b].pooling == LG_POOL_MAX) net.block[b].pooling = LG_POOL_AVERAGE;
            net = initialised(net);
            const lg_gradcheck_argument arguments[2] = {
                {.shape = lg_shape3(2, net.length, net.channels)},
                {.shape = lg_shape1((uint32_t)lg_cnn_parameters(&net) + OFFSET),
                 .low = -0.5,
                 .high = 0.5,
                 .scale = 0.25}};
            const lg_gradcheck_function f = {
                .name = "cnn", .inputs = 2, .arguments = arguments, .build = build, .user = &net};
            lg_gradcheck_result result;
            if (lg_gradcheck(NULL, &f, NULL, &result) != LG_OK) fail_msg("net %zu: %s", i, result.message);
        }
}

/* All rectifiers of the first block stand at their kink, where their derivative is 0. */
static void kink_of_a_rectifier(void **state) {
    (void)state;
    const lg_cnn net = net_number(0, LG_RELU);
    example e = make(net);
    lg_slice_info first;
    assert_true(lg_cnn_slice(&net, 0, &first));
    for (size_t j = first.count; j < e.parameters; j++) e.theta[j] = fabs(e.theta[j]);
    memset(e.theta + first.count, 0, net.block[0].channels * sizeof *e.theta);
    memset(e.x, 0, e.numbers * sizeof *e.x);
    lg_tape *tape = tape_of(LG_F64);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)e.parameters), e.theta);
    const lg_var x = lg_input_f64(tape, lg_shape3(1, net.length, net.channels), e.x);
    lg_var gradient = LG_NONE;
    double *g = malloc(e.numbers * sizeof *g);
    assert_ok(lg_grad(tape, lg_sum(tape, lg_cnn_record(tape, &net, theta, 0, x, NULL)), &x, 1, &gradient));
    assert_ok(lg_read(tape, gradient, g, e.numbers));
    for (size_t j = 0; j < e.numbers; j++) assert_close(g[j], 0.0, 0, 0);
    lg_tape_destroy(tape);
    free(g);
    release(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_default),
        cmocka_unit_test(defaults_of_all_sizes),
        cmocka_unit_test(refused),
        cmocka_unit_test(pooling_names),
        cmocka_unit_test(initialisation),
        cmocka_unit_test(on_a_tape),
        cmocka_unit_test(gradients),
        cmocka_unit_test(refused_on_a_tape),
        cmocka_unit_test(kink_of_a_rectifier),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
