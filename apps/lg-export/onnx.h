/* The graph of an ONNX file under construction: tensors and nodes by name (onnx_graph.c), and the ONNX form
 * of each operation of the library (onnx_operations.c). */
#ifndef LG_EXPORT_ONNX_H
#define LG_EXPORT_ONNX_H

#include "lg-export/graph.h"

enum { ONNX_FLOAT = 1, ONNX_INT64 = 7, ONNX_BOOL = 9, ONNX_DOUBLE = 11 }; /* Types of tensors. */

typedef struct onnx_job {
    const graph *g;
    const export_options *options;
    text graph; /* The nodes and initializers so far. */
    size_t helpers;
    bool has_batch; /* The graph already has the value "/batch": the number of rows, shape (1). */
} onnx_job;

/* The name of a value in the graph. Names of inputs have at most 64 bytes. */
typedef struct onnx_name {
    char text[72];
} onnx_name;

typedef struct onnx_attribute {
    const char *name;
    enum { ONNX_INT, ONNX_INTS } type;
    int64_t i[4];
    size_t count;
} onnx_attribute;

static inline onnx_attribute onnx_axis(int64_t axis) {
    return (onnx_attribute){.name = "axis", .type = ONNX_INT, .i = {axis}};
}

/* ---- tensors ---- */

onnx_name onnx_name_of(const onnx_job *j, uint32_t node);
onnx_name onnx_new_name(onnx_job *j);
int onnx_real_type(const onnx_job *j);
/* Adds an initializer of the exported type. */
void onnx_add_reals(onnx_job *j, const char *called, const int64_t *dims, size_t rank, const double *values,
                    size_t count);
onnx_name onnx_number(onnx_job *j, double value);
onnx_name onnx_wholes(onnx_job *j, const int64_t *values, size_t count);

/* ---- nodes: the functions return the name of the result, except onnx_emit_to ---- */

/* Adds a node whose result is called `out`. */
void onnx_emit_to(onnx_job *j, const char *out, const char *type, const onnx_name *in, size_t inputs,
                  const onnx_attribute *with, size_t attributes);
/* Adds a node. `with`: one attribute, or NULL. */
onnx_name onnx_emit(onnx_job *j, const char *type, const onnx_name *in, size_t inputs,
                    const onnx_attribute *with);
onnx_name onnx_unary(onnx_job *j, const char *type, onnx_name x);
onnx_name onnx_binary(onnx_job *j, const char *type, onnx_name x, onnx_name y);
onnx_name onnx_where(onnx_job *j, onnx_name condition, onnx_name yes, onnx_name no);
onnx_name onnx_cast(onnx_job *j, onnx_name x, int to);
/* Permutes the axes. */
onnx_name onnx_transpose(onnx_job *j, onnx_name x, const int64_t *order, size_t rank);
/* Fills `out` with the dimensions, -1 for the one that depends on the number of rows. Returns false if more
 * than one does. */
bool onnx_shape_of(const lg_affine *dims, size_t rank, int64_t *out);
onnx_name onnx_reshape(onnx_job *j, onnx_name x, const lg_affine *dims, size_t rank);
/* Takes the elements at `places` of an axis. */
onnx_name onnx_take(onnx_job *j, onnx_name x, const int64_t *places, size_t count, int64_t axis);
/* Joins tensors one behind the other along an axis. */
onnx_name onnx_join(onnx_job *j, const onnx_name *x, size_t count, int64_t axis);
/* Adds a scalar of the exported type: a.base plus a.rows times the number of rows. */
onnx_name onnx_affine(onnx_job *j, lg_affine a);
/* Copies the tensor once per row of the batch, so that it gets a first dimension of rows. */
onnx_name onnx_for_each_row(onnx_job *j, onnx_name x, const lg_operation *op);

/* ---- operations ---- */

typedef struct onnx_operation {
    onnx_job *j;
    const lg_operation *op;
    onnx_name x[64];
    const char *out;
} onnx_operation;

/* Gives `result` the name of the operation's result. Returns true. */
bool onnx_give(const onnx_operation *o, onnx_name result);
/* Adds the nodes of an operation. Returns false if the operation has no form in ONNX. */
bool onnx_translate(onnx_job *j, uint32_t node);

/* Returns an operation of the function that onnxruntime offers in single precision only, or NULL. */
const char *onnx_single_only(const graph *g);

/* Protocol buffers, the format of ONNX files: fields one behind the other, each with its number. */
void proto_whole(text *to, int field, int64_t value);
void proto_text(text *to, int field, const char *value);
/* Adds `message` as a field of `to`, then frees the message's text. */
void proto_message(text *to, int field, text *message);

#endif
