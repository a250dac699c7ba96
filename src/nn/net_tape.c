/* Networks of several architectures on a tape. */
#include "nn/net.h"

#include "autodiff/tape/tape_internal.h"
#include "core/core.h"

/* The parameters of the dense layers as views of the flat vector; LG_NONE for a missing bias. */
typedef struct bound {
    lg_layers layers;
    lg_var weight[NET_MAX_DENSE], bias[NET_MAX_DENSE];
    lg_net_tap *taps; /* may be NULL */
} bound;

static lg_var dense(lg_tape *tape, const bound *b, uint32_t i, lg_var x, lg_activation kind) {
    if (b->taps == NULL) return lg_dense(tape, x, b->weight[i], b->bias[i], kind);
    const lg_var y = b->layers.layer[i].has_bias ? lg_matmul_add(tape, x, b->weight[i], b->bias[i])
                                                 : lg_matmul(tape, x, b->weight[i]);
    b->taps[i] = (lg_net_tap){x, y};
    return kind == LG_IDENTITY ? y : lg_act(tape, y, kind);
}

/* h + x W, where W is the weight of dense layer i, which has no bias. */
static lg_var add_dense(lg_tape *tape, const bound *b, uint32_t i, lg_var x, lg_var h) {
    if (b->taps == NULL) return lg_matmul_add(tape, x, b->weight[i], h);
    return lg_add(tape, dense(tape, b, i, x, LG_IDENTITY), h);
}

static lg_var apply(lg_tape *tape, const lg_net *net, const bound *b, lg_var x) {
    const net_body *body = lg_net_body(net);
    const lg_activation kind = net->activation;
    const uint32_t first = net->embedding > 0; /* index of the first head */
    lg_var head[NET_MAX_HEADS];
    if (first > 0) x = lg_sin(tape, lg_scale(tape, dense(tape, b, 0, x, LG_IDENTITY), LG_TWO_PI));
    for (uint32_t i = 0; i < body->heads; i++) head[i] = dense(tape, b, first + i, x, kind);
    lg_var h = head[body->heads - 1];
    for (uint32_t l = 0; l < net->layers; l++) {
        const uint32_t step = first + body->heads + l * body->steps;
        lg_var z = dense(tape, b, step, h, kind);
        if (net->kind == LG_NET_RESNET)
            h = add_dense(tape, b, step + 1, z, h);
        else if (body->gated)
            h = lg_lerp(tape, body->steps > 1 ? dense(tape, b, step + 1, z, LG_IDENTITY) : z, head[0],
                        head[1]);
        else
            h = z;
    }
    return dense(tape, b, b->layers.count - 1, h, LG_IDENTITY);
}

lg_var lg_net_record(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x) {
    return lg_net_record_taps(tape, net, theta, offset, x, NULL);
}

lg_var lg_net_record_taps(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                          lg_net_tap *taps) {
    bound b = {.layers = lg_net_layers(net), .taps = taps};
    const lg_status status = lg_layers_bind(tape, &b.layers, "net", theta, offset, b.weight, b.bias);
    return status == LG_OK ? apply(tape, net, &b, x) : LG_NONE;
}

lg_status lg_net_record_jvp(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                            lg_var dx, lg_var *y, lg_var *dy) {
    LG_TRY(lg_tape_needs(tape, "network", net != NULL && y != NULL && dy != NULL));
    const lg_var value = lg_net_record(tape, net, theta, offset, x);
    const lg_var direction = lg_broadcast_to(tape, dx, lg_var_shape(tape, x));
    lg_var derivative = LG_NONE;
    LG_TRY(lg_jvp(tape, &value, 1, &x, &direction, 1, &derivative));
    *y = value;
    *dy = derivative;
    return LG_OK;
}
