/* Convolutions in ONNX. The library's tensors are (batch, length, channels), ONNX's are (batch, channels,
 * length). */
#include "lg-export/onnx.h"

static onnx_name channels_first(onnx_job *j, onnx_name x) {
    return onnx_transpose(j, x, (const int64_t[]){0, 2, 1}, 3);
}

static onnx_name convolved(const onnx_operation *o) {
    const lg_affine *w = o->op->whole;
    onnx_name in[3] = {channels_first(o->j, o->x[0]),
                       onnx_transpose(o->j, o->x[1], (const int64_t[]){2, 1, 0}, 3), o->x[2]};
    const onnx_attribute how[2] = {
        {.name = "strides", .type = ONNX_INTS, .i = {w[0].base}, .count = 1},
        {.name = "pads", .type = ONNX_INTS, .i = {w[1].base, w[1].base}, .count = 2}};
    const onnx_name out = onnx_new_name(o->j);
    onnx_emit_to(o->j, out.text, "Conv", in, o->op->input_count, how, 2);
    return out;
}

static onnx_name pooled(onnx_job *j, const char *type, onnx_name x, int64_t size, int64_t stride) {
    const onnx_attribute how[2] = {{.name = "kernel_shape", .type = ONNX_INTS, .i = {size}, .count = 1},
                                   {.name = "strides", .type = ONNX_INTS, .i = {stride}, .count = 1}};
    const onnx_name out = onnx_new_name(j);
    onnx_emit_to(j, out.text, type, &x, 1, how, 2);
    return out;
}

bool onnx_convolution(const onnx_operation *o) {
    return onnx_give(o, channels_first(o->j, convolved(o)));
}

bool onnx_block(const onnx_operation *o) {
    onnx_name y;
    if (!onnx_activated(o->j, (int64_t)o->op->real, convolved(o), &y)) return false;
    y = pooled(o->j, "AveragePool", y, o->op->whole[2].base, o->op->whole[3].base);
    return onnx_give(o, channels_first(o->j, y));
}

bool onnx_average_pool(const onnx_operation *o) {
    const onnx_name y = pooled(o->j, "AveragePool", channels_first(o->j, o->x[0]), o->op->whole[0].base,
                               o->op->whole[1].base);
    return onnx_give(o, channels_first(o->j, y));
}

bool onnx_max_pool(const onnx_operation *o) {
    if (o->op->inputs[0] != o->op->inputs[1]) return false;
    const int64_t size = o->op->whole[0].base, stride = o->op->whole[1].base;
    const onnx_name x = channels_first(o->j, o->x[0]), not = onnx_not_a_number(o->j, x);
    const onnx_name any = pooled(o->j, "MaxPool", not, size, stride);
    return onnx_give(o, channels_first(o->j, onnx_keep(o->j, any, pooled(o->j, "MaxPool", x, size, stride))));
}
