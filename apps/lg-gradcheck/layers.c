/* Multilayer perceptrons: value and recorded input gradient, with respect to inputs and parameters. */
#include "lg-gradcheck/tables.h"

#include "common/app.h"
#include "liegrad/nn.h"

typedef struct settings {
    lg_activation activation;
    uint32_t outputs;
    bool last_bias, gradient;
} settings;

enum { OFFSET = 2 }; /* the network's parameters begin here */

/* 2 -> 4 -> 3 -> outputs */
static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    static const uint32_t hidden[2] = {4, 3};
    const settings *s = user;
    lg_mlp net;
    lg_mlp_vars vars;
    lg_status status = lg_mlp_init(&net, 2, hidden, 2, s->outputs, s->activation, s->last_bias);
    if (status != LG_OK) return lg_tape_fail(tape, status, "mlp", "not a network");
    if (!s->gradient) return lg_mlp_apply(tape, &net, x[1], OFFSET, x[0]);
    if (lg_mlp_bind(tape, &net, x[1], OFFSET, &vars) != LG_OK) return LG_NONE;
    return lg_mlp_gradient_bound(tape, &net, &vars, x[0]);
}

/* 2 4 + 4 + 4 3 + 3 weights and biases, then 3 a neuron of the output */
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

static const lg_gradcheck_case rows[] = {
    ROWS("tanh", LG_TANH),
    ROWS("sigmoid", LG_SIGMOID),
    ROWS("swish", LG_SWISH),
    ROWS("sine", LG_SINE),
    ROWS("identity", LG_IDENTITY),
    ROW("mlp tanh, input gradient of the first of two outputs", LG_TANH, 2, true, true),
};

const lg_gradcheck_case *layer_rows(size_t *count) {
    *count = APP_COUNT(rows);
    return rows;
}
