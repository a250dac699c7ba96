/* Cases of the gradient check for networks: their value, and their recorded input gradient or directional
 * derivative, differentiated by inputs, direction and parameters. */
#include "gradcheck/table.h"
#include "liegrad/networks.h"
#include "liegrad/ops.h"

typedef struct settings {
    lg_activation activation;
    uint32_t outputs;
    bool last_bias, gradient;
} settings;

enum { OFFSET = 2 }; /* index of the network's first parameter in the flat vector */

/* A perceptron with layers of 2 -> 4 -> 3 -> outputs. */
static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    static const uint32_t hidden[2] = {4, 3};
    const settings *s = user;
    lg_mlp net;
    lg_mlp_vars vars;
    lg_status status = lg_mlp_init(&net, 2, hidden, 2, s->outputs, s->activation, s->last_bias);
    if (status != LG_OK) return lg_tape_fail(tape, status, "mlp", "not a network");
    if (!s->gradient) return lg_mlp_record(tape, &net, x[1], OFFSET, x[0]);
    if (lg_mlp_bind(tape, &net, x[1], OFFSET, &vars) != LG_OK) return LG_NONE;
    return lg_mlp_record_gradient(tape, &net, &vars, x[0]);
}

/* Parameters: 2 4 + 4 + 4 3 + 3 = 27 weights and biases; per output 3 weights and, if any, a bias. */
#define ROW(label, kind, outputs, bias, gradient)                                                            \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = label,                                                                                   \
            .build = build,                                                                                  \
            .user = &(const settings){kind, outputs, bias, gradient},                                        \
            INPUTS({.shape = S2(5, 2)}, {.shape = S1(OFFSET + 27 + 3 * outputs + (bias ? outputs : 0))})     \
        }                                                                                                    \
    }
#define ROWS(label, kind)                                                                                    \
    ROW("mlp " label, kind, 2, true, false), ROW("mlp " label ", input gradient", kind, 1, false, true)

/* ---- networks of several architectures: layers of 2 -> [embedding 3 ->] 3 -> 3 -> 3 -> 2 ---- */

typedef struct net_settings {
    lg_net_kind kind;
    uint32_t embedding;
    lg_activation activation;
} net_settings;

static bool describe(const net_settings *s, lg_tape *tape, lg_net *net) {
    const lg_status status = lg_net_init(net, s->kind, 2, s->embedding, 3, 2, 2, s->activation);
    if (status != LG_OK) (void)lg_tape_fail(tape, status, "net", "not a network");
    return status == LG_OK;
}

static lg_var build_net(const void *user, lg_tape *tape, const lg_var *x) {
    lg_net net;
    return describe(user, tape, &net) ? lg_net_record(tape, &net, x[1], OFFSET, x[0]) : LG_NONE;
}

/* Returns (4, 2): two rows of y, then two rows of its derivative in the direction x[2]. */
static lg_var build_net_jvp(const void *user, lg_tape *tape, const lg_var *x) {
    lg_net net;
    lg_var both[2];
    if (!describe(user, tape, &net)) return LG_NONE;
    if (lg_net_record_jvp(tape, &net, x[1], OFFSET, x[0], x[2], &both[0], &both[1]) != LG_OK) return LG_NONE;
    return lg_concat(tape, both, 2, 0);
}

/* `count`: number of parameters of the network; `e`: width of the embedding. */
#define NET_ROWS(label, kind, e, activation, count)                                                          \
    {.function = {.name = label,                                                                             \
                  .build = build_net,                                                                        \
                  .user = &(const net_settings){kind, e, activation},                                        \
                  INPUTS({.shape = S2(2, 2)}, {.shape = S1(OFFSET + count)})}},                              \
        NET_JVP_ROW(label ", directional", kind, e, activation, count, 2)
#define NET_JVP_ROW(label, kind, e, activation, count, directions)                                           \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = label,                                                                                   \
            .build = build_net_jvp,                                                                          \
            .user = &(const net_settings){kind, e, activation},                                              \
            INPUTS({.shape = S2(2, 2)}, {.shape = S1(OFFSET + count)}, {.shape = S2(directions, 2)})         \
        }                                                                                                    \
    }

/* ---- convolutional networks: (9, 2) -> kernel 3, stride 2, padding 1 -> (5, 3) -> pooling -> (4 or 5, 3)
 * -> kernel 2 -> (3 or 4, 2) -> plane of 2 -> 2 outputs ---- */

typedef struct cnn_settings {
    lg_activation activation;
    lg_pooling pooling;
} cnn_settings;

static lg_var build_cnn(const void *user, lg_tape *tape, const lg_var *x) {
    const cnn_settings *s = user;
    lg_cnn net = {
        .channels = 2,
        .length = 9,
        .blocks = 2,
        .block = {{.channels = 3,
                   .kernel = 3,
                   .stride = 2,
                   .padding = 1,
                   .pooling = s->pooling,
                   .pool_size = 2,
                   .pool_stride = 1},
                  {.channels = 2, .kernel = 2, .stride = 1}},
        .plane = 2,
        .outputs = 2,
        .activation = s->activation,
    };
    const lg_status status = lg_cnn_init(&net, NULL);
    if (status != LG_OK) return lg_tape_fail(tape, status, "cnn", "not a network");
    return lg_cnn_record(tape, &net, x[1], OFFSET, x[0], NULL);
}

/* Parameters, weights and biases of each layer: 3*2*3 + 3, 2*3*2 + 2, 2*2*left + 2 and 2*2 + 2, where `left`
 * samples remain before the plane.
 * `step` scales the inputs and parameters of networks with kinks, so that no difference crosses a kink. */
#define CNN_ROW(label, kind, pool, left, step)                                                               \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = "cnn " label,                                                                            \
            .build = build_cnn,                                                                              \
            .user = &(const cnn_settings){kind, pool},                                                       \
            INPUTS({.shape = S3(2, 9, 2), .scale = step},                                                    \
                   {.shape = S1(OFFSET + 43 + 4 * left), .scale = step})                                     \
        }                                                                                                    \
    }

static const lg_gradcheck_case rows[] = {
    ROWS("tanh", LG_TANH),
    ROWS("sigmoid", LG_SIGMOID),
    ROWS("swish", LG_SWISH),
    ROWS("sine", LG_SINE),
    ROWS("identity", LG_IDENTITY),
    NET_ROWS("net mlp", LG_NET_MLP, 0, LG_TANH, 41),
    NET_ROWS("net mlp, embedding", LG_NET_MLP, 3, LG_SIGMOID, 53),
    NET_ROWS("net resnet", LG_NET_RESNET, 0, LG_TANH, 59),
    NET_ROWS("net resnet, embedding", LG_NET_RESNET, 3, LG_SWISH, 71),
    NET_ROWS("net mult", LG_NET_MULT, 0, LG_TANH, 59),
    NET_ROWS("net mult, embedding", LG_NET_MULT, 3, LG_TANH, 77),
    NET_ROWS("net mult-affine", LG_NET_MULT_AFFINE, 0, LG_SINE, 83),
    NET_ROWS("net mult-affine, embedding", LG_NET_MULT_AFFINE, 3, LG_TANH, 101),
    NET_JVP_ROW("net mult, one direction", LG_NET_MULT, 3, LG_TANH, 77, 1),
    ROW("mlp tanh, input gradient of the first of two outputs", LG_TANH, 2, true, true),
    CNN_ROW("identity", LG_IDENTITY, LG_POOL_AVERAGE, 3, 0.0),
    CNN_ROW("tanh", LG_TANH, LG_POOL_AVERAGE, 3, 0.0),
    CNN_ROW("sigmoid", LG_SIGMOID, LG_POOL_AVERAGE, 3, 0.0),
    CNN_ROW("swish", LG_SWISH, LG_POOL_AVERAGE, 3, 0.0),
    CNN_ROW("sine", LG_SINE, LG_POOL_AVERAGE, 3, 0.0),
    CNN_ROW("relu", LG_RELU, LG_POOL_AVERAGE, 3, 0.03),
    CNN_ROW("leaky-relu", LG_LEAKY_RELU, LG_POOL_AVERAGE, 3, 0.03),
    CNN_ROW("tanh, without pooling", LG_TANH, LG_POOL_NONE, 4, 0.0),
    CNN_ROW("tanh, max pooling", LG_TANH, LG_POOL_MAX, 3, 0.03),
    CNN_ROW("leaky-relu, max pooling", LG_LEAKY_RELU, LG_POOL_MAX, 3, 0.03),
};

FAMILY(nn)
