/* Shapes and attributes of a function's nodes for a given number of rows. */
#include "autodiff/program/program_check.h"

/* Multiplies *count by a dimension, where 0 counts as 1. False: too large. */
static bool grow_count(size_t *count, size_t length) {
    if (length >= (size_t)LG_PROGRAM_MAX_DIM) return false;
    *count *= length > 0 ? length : 1;
    return *count < (size_t)LG_PROGRAM_MAX_DIM;
}

bool lg_node_shape_at(const lg_program_node *node, size_t rows, lg_shape *shape) {
    *shape = (lg_shape){.rank = node->rank};
    size_t count = 1;
    bool empty = false;
    for (uint32_t d = 0; d < node->rank; d++) {
        const int64_t length = lg_affine_at(node->dims[d], rows);
        if (length < 0 || !grow_count(&count, (size_t)length)) return false;
        shape->dims[d] = (uint32_t)length;
        empty = empty || length == 0;
    }
    return !empty || count <= LG_PROGRAM_MAX_EMPTY;
}

bool lg_node_attr_at(const lg_function *f, const lg_program_node *node, size_t rows, lg_attr *attr) {
    *attr = (lg_attr){.c = node->c};
    if (node->inverse.base != 0 || node->inverse.rows != 0) {
        const int64_t count = lg_affine_at(node->inverse, rows);
        if (count <= 0) return false;
        attr->c = 1.0 / (double)count;
    }
    for (int k = 0; k < 4; k++) {
        const int64_t value = lg_affine_at(node->i[k], rows);
        if (value < 0 || value > (int64_t)UINT32_MAX) return false;
        attr->i[k] = (uint32_t)value;
    }
    const lg_payload payload = node->op->payload;
    if (payload == LG_PAYLOAD_REALS) attr->pointer = f->reals + node->payload;
    if (payload == LG_PAYLOAD_INDICES) attr->pointer = f->indices + node->payload;
    return true;
}

lg_shape lg_port_shape(const lg_port *port, size_t rows) {
    if (port->shared) return port->shape;
    lg_shape shape = {port->shape.rank + 1, {(uint32_t)rows, 0, 0, 0}};
    for (uint32_t d = 0; d < port->shape.rank && d + 1 < LG_MAX_RANK; d++)
        shape.dims[d + 1] = port->shape.dims[d];
    return shape;
}

bool lg_program_shape_is_sound(const lg_shape *shape, uint32_t most) {
    size_t count = 1;
    for (uint32_t d = 0; shape->rank <= most && d < shape->rank; d++)
        if (!grow_count(&count, shape->dims[d])) return false;
    return shape->rank <= most && (lg_shape_count(*shape) > 0 || count <= LG_PROGRAM_MAX_EMPTY);
}

lg_port lg_path_port(const lg_port *output, uint32_t times, const char *name) {
    lg_port port = *output;
    port.name = name;
    port.shape.rank = output->shape.rank + 1;
    for (uint32_t d = 1; d < port.shape.rank && d < LG_MAX_RANK; d++)
        port.shape.dims[d] = output->shape.dims[d - 1];
    port.shape.dims[0] = times;
    return port;
}
