/* Programs in files. Parameters and functions lie below /parameters and /functions by name, in the order of
 * /parameter_names and /function_names. A function's operations are columns of one number or row each; ports
 * likewise. Names of operations stand once, in /operations. */
#include <stdio.h>
#include <string.h>

#include "datasets/h5.h"
#include "liegrad/program_image.h"

#define KIND "program"

enum { PATH = 256, NAME = 65, UNIT = 65, TEXT = 4096, MOST_NAMES = 1024 };

/* A path in the file; all are shorter than this. */
typedef struct key {
    char text[PATH];
} key;

static key below(const char *group, const char *name) {
    key k;
    (void)snprintf(k.text, sizeof k.text, "%.180s/%.64s", group, name);
    return k;
}

/* ---- columns ---- */

/* A list as it lies in the file: one row of (width) or (width, 2) numbers for each operation or port. */
typedef struct column {
    const char *name;
    lg_element type;
    uint32_t width; /* 1: no axis */
    bool affine;    /* pairs (base, rows) */
} column;

enum { OPERATION, INPUTS, OPERATION_RANK, SHAPE, WHOLE, REAL, RECIPROCAL, REALS, INDICES, OPERATION_COLUMNS };
static const column operation_rows[OPERATION_COLUMNS] = {
    [OPERATION] = {"operation", LG_ELEMENT_U32, 1, false},
    [INPUTS] = {"inputs", LG_ELEMENT_U32, 1, false},
    [OPERATION_RANK] = {"rank", LG_ELEMENT_U32, 1, false},
    [SHAPE] = {"shape", LG_ELEMENT_I64, LG_MAX_RANK, true},
    [WHOLE] = {"whole", LG_ELEMENT_I64, LG_WHOLE_COUNT, true},
    [REAL] = {"real", LG_ELEMENT_F64, 1, false},
    [RECIPROCAL] = {"reciprocal", LG_ELEMENT_I64, 1, true},
    [REALS] = {"reals", LG_ELEMENT_U32, 1, false},
    [INDICES] = {"indices", LG_ELEMENT_U32, 1, false},
};

enum { PORT_RANK, PORT_SHAPE, SHARED, RANGE, PORT_COLUMNS };
static const column port_rows[PORT_COLUMNS] = {
    [PORT_RANK] = {"rank", LG_ELEMENT_U32, 1, false},
    [PORT_SHAPE] = {"shape", LG_ELEMENT_U32, LG_MAX_RANK, false},
    [SHARED] = {"shared", LG_ELEMENT_U32, 1, false},
    [RANGE] = {"range", LG_ELEMENT_F64, 2, false},
};

_Static_assert(sizeof(lg_affine) == 2 * sizeof(int64_t), "pairs lie in files as in memory");

static size_t row_bytes(const column *c) {
    const size_t one = c->type == LG_ELEMENT_U32 ? sizeof(uint32_t) : 8;
    return one * c->width * (c->affine ? 2 : 1);
}

/* Its shape with `count` rows; the rank. */
static uint32_t column_shape(const column *c, uint64_t count, uint64_t dims[4]) {
    uint32_t rank = 0;
    dims[rank++] = count;
    if (c->width > 1) dims[rank++] = c->width;
    if (c->affine) dims[rank++] = 2;
    return rank;
}

static void free_columns(const lg_context *context, size_t n, void **columns) {
    for (size_t i = 0; i < n; i++) lg_free(context, columns[i]);
}

static lg_status make_columns(const lg_context *context, const column *rows, size_t n, size_t count,
                              void **columns) {
    for (size_t i = 0; i < n; i++)
        if ((columns[i] = lg_alloc(context, count, row_bytes(&rows[i]))) == NULL) return LG_OUT_OF_MEMORY;
    return LG_OK;
}

static lg_status no_memory(const lg_h5 *h5, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(h5->path));
}

/* ---- saving ---- */

/* Names of operations, each once, in the order in which they are met. */
typedef struct names {
    const char *name[MOST_NAMES];
    uint32_t revision[MOST_NAMES];
    uint32_t count;
} names;

static uint32_t number_of(names *known, const lg_operation *o) {
    uint32_t i = 0;
    while (i < known->count && strcmp(known->name[i], o->name) != 0) i++;
    if (i == known->count && i < MOST_NAMES) {
        known->name[known->count] = o->name;
        known->revision[known->count++] = o->revision;
    }
    return i;
}

static lg_status put_columns(lg_h5 *h5, const char *group, const column *rows, size_t n, size_t count,
                             void *const *columns, lg_error *error) {
    for (size_t i = 0; i < n; i++) {
        uint64_t dims[4];
        const uint32_t rank = column_shape(&rows[i], count, dims);
        LG_TRY(lg_h5_put(h5, below(group, rows[i].name).text, rows[i].type, rank, dims, columns[i], error));
    }
    return LG_OK;
}

static lg_status put_list(lg_h5 *h5, const char *group, const char *name, lg_element type, uint64_t count,
                          const void *data, lg_error *error) {
    return lg_h5_put(h5, below(group, name).text, type, 1, &count, data, error);
}

static lg_status put_names(lg_h5 *h5, const char *path, const char *const *name, size_t count, size_t size,
                           lg_error *error) {
    char *texts = lg_alloc(h5->context, count, size);
    if (texts == NULL) return no_memory(h5, error);
    for (size_t i = 0; i < count; i++)
        (void)snprintf(texts + i * size, size, "%s", name[i] != NULL ? name[i] : "");
    const lg_status status = lg_h5_put_texts(h5, path, texts, size, count, error);
    lg_free(h5->context, texts);
    return status;
}

static lg_status put_port_texts(lg_h5 *h5, const char *group, const lg_port *ports, size_t count,
                                lg_error *error) {
    const char *name[64], *unit[64];
    if (count > LG_COUNT(name)) return lg_fail(error, LG_INVALID_ARGUMENT, "too many inputs or outputs");
    for (size_t i = 0; i < count; i++) {
        name[i] = ports[i].name;
        unit[i] = ports[i].unit;
    }
    LG_TRY(put_names(h5, below(group, "name").text, name, count, NAME, error));
    return put_names(h5, below(group, "unit").text, unit, count, UNIT, error);
}

static void fill_ports(const lg_port *ports, size_t count, void *const *columns) {
    uint32_t *rank = columns[PORT_RANK], *shape = columns[PORT_SHAPE], *shared = columns[SHARED];
    double *range = columns[RANGE];
    for (size_t i = 0; i < count; i++) {
        rank[i] = ports[i].shape.rank;
        memcpy(shape + i * LG_MAX_RANK, ports[i].shape.dims, ports[i].shape.rank * sizeof *shape);
        shared[i] = ports[i].shared;
        range[2 * i] = ports[i].low;
        range[2 * i + 1] = ports[i].high;
    }
}

static lg_status put_ports(lg_h5 *h5, const char *group, const lg_port *ports, size_t count,
                           lg_error *error) {
    void *columns[PORT_COLUMNS] = {NULL};
    lg_status status = make_columns(h5->context, port_rows, PORT_COLUMNS, count, columns);
    if (status == LG_OK) {
        fill_ports(ports, count, columns);
        status = put_port_texts(h5, group, ports, count, error);
    } else {
        (void)no_memory(h5, error);
    }
    if (status == LG_OK) status = put_columns(h5, group, port_rows, PORT_COLUMNS, count, columns, error);
    free_columns(h5->context, PORT_COLUMNS, columns);
    return status;
}

static void fill_columns(const lg_function_image *image, names *known, void *const *columns) {
    uint32_t *operation = columns[OPERATION], *inputs = columns[INPUTS], *rank = columns[OPERATION_RANK];
    uint32_t *reals = columns[REALS], *indices = columns[INDICES];
    lg_affine *shape = columns[SHAPE], *whole = columns[WHOLE], *reciprocal = columns[RECIPROCAL];
    double *real = columns[REAL];
    for (size_t i = 0; i < image->operation_count; i++) {
        const lg_operation *o = &image->operations[i];
        operation[i] = number_of(known, o);
        inputs[i] = o->input_count;
        rank[i] = o->rank;
        reals[i] = o->real_count;
        indices[i] = o->index_count;
        real[i] = o->real;
        reciprocal[i] = o->reciprocal;
        memcpy(shape + i * LG_MAX_RANK, o->shape, sizeof o->shape);
        memcpy(whole + i * LG_WHOLE_COUNT, o->whole, sizeof o->whole);
    }
}

/* One of the lists that operations point into, end to end. */
typedef struct list {
    const char *name;
    lg_element type;
    size_t size, pointer, count; /* of an element; offsets in lg_operation */
} list;

static const list lists[] = {
    {"edges", LG_ELEMENT_U32, sizeof(uint32_t), offsetof(lg_operation, inputs),
     offsetof(lg_operation, input_count)},
    {"reals", LG_ELEMENT_F64, sizeof(double), offsetof(lg_operation, reals),
     offsetof(lg_operation, real_count)},
    {"indices", LG_ELEMENT_U32, sizeof(uint32_t), offsetof(lg_operation, indices),
     offsetof(lg_operation, index_count)},
};

/* How many elements of it the operation has. */
static uint32_t count_of(const list *l, const lg_operation *o) {
    uint32_t count;
    memcpy(&count, (const char *)o + l->count, sizeof count);
    return count;
}

static uint64_t list_count(const list *l, const lg_operation *operations, size_t n) {
    uint64_t total = 0;
    for (size_t i = 0; i < n; i++) total += count_of(l, &operations[i]);
    return total;
}

static lg_status put_lists(lg_h5 *h5, const char *group, const lg_function_image *image, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t k = 0; k < LG_COUNT(lists) && status == LG_OK; k++) {
        const list *l = &lists[k];
        const uint64_t total = list_count(l, image->operations, image->operation_count);
        unsigned char *data = lg_alloc(h5->context, (size_t)total, l->size), *to = data;
        if (data == NULL) return no_memory(h5, error);
        for (size_t i = 0; i < image->operation_count; i++) {
            const lg_operation *o = &image->operations[i];
            const size_t bytes = count_of(l, o) * l->size;
            const void *data_of;
            memcpy(&data_of, (const char *)o + l->pointer, sizeof data_of);
            if (bytes > 0) memcpy(to, data_of, bytes);
            to += bytes;
        }
        status = put_list(h5, group, l->name, l->type, total, data, error);
        lg_free(h5->context, data);
    }
    return status;
}

static lg_status put_operations(lg_h5 *h5, const char *group, const lg_function_image *image, names *known,
                                lg_error *error) {
    void *columns[OPERATION_COLUMNS] = {NULL};
    const size_t n = image->operation_count;
    lg_status status = make_columns(h5->context, operation_rows, OPERATION_COLUMNS, n, columns);
    if (status == LG_OK) {
        fill_columns(image, known, columns);
        status = put_columns(h5, below(group, "operations").text, operation_rows, OPERATION_COLUMNS, n,
                             columns, error);
    } else {
        (void)no_memory(h5, error);
    }
    free_columns(h5->context, OPERATION_COLUMNS, columns);
    if (status == LG_OK) status = put_lists(h5, group, image, error);
    if (status != LG_OK) return status;
    return put_list(h5, group, "results", LG_ELEMENT_U32, image->output_count, image->results, error);
}

static lg_status put_loop(lg_h5 *h5, const char *group, const lg_program *program,
                          const lg_function_image *image, lg_error *error) {
    int64_t carry[64];
    const char *callee = lg_program_function_name(program, image->callee);
    if (callee == NULL || image->input_count > LG_COUNT(carry))
        return lg_fail(error, LG_INVALID_ARGUMENT, "a loop calls no function");
    for (size_t i = 0; i < image->input_count; i++)
        carry[i] = image->carry[i] == LG_CARRY_NONE ? -1 : (int64_t)image->carry[i];
    LG_TRY(lg_h5_put_text(h5, group, "calls", callee, error));
    LG_TRY(lg_h5_put_number(h5, group, "times", LG_ELEMENT_U32, &image->times, error));
    return put_list(h5, group, "carry", LG_ELEMENT_I64, image->input_count, carry, error);
}

static lg_status put_function(lg_h5 *h5, const lg_program *program, const lg_function_image *image,
                              names *known, lg_error *error) {
    const key at = below("functions", image->name);
    LG_TRY(put_ports(h5, below(at.text, "inputs").text, image->inputs, image->input_count, error));
    LG_TRY(put_ports(h5, below(at.text, "outputs").text, image->outputs, image->output_count, error));
    return image->times > 0 ? put_loop(h5, at.text, program, image, error)
                            : put_operations(h5, at.text, image, known, error);
}

static lg_status put_functions(lg_h5 *h5, const lg_program *program, names *known, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_functions(program) && status == LG_OK; i++) {
        lg_function_image *image;
        status = lg_function_image_create(program, i, &image);
        if (status != LG_OK) return no_memory(h5, error);
        status = put_function(h5, program, image, known, error);
        lg_function_image_destroy(program, image);
    }
    return status;
}

static lg_status put_parameter(lg_h5 *h5, const lg_parameter_spec *p, lg_error *error) {
    uint64_t dims[LG_MAX_RANK];
    for (uint32_t d = 0; d < p->shape.rank; d++) dims[d] = p->shape.dims[d];
    return lg_h5_put(h5, below("parameters", p->name).text, LG_ELEMENT_F64, p->shape.rank, dims, p->values,
                     error);
}

/* Names of parameters or functions. */
static lg_status put_order(lg_h5 *h5, const lg_program *program, bool functions, lg_error *error) {
    const size_t count = functions ? lg_program_functions(program) : lg_program_parameters(program);
    const char *name[MOST_NAMES];
    if (count > MOST_NAMES) return lg_fail(error, LG_INVALID_ARGUMENT, "too many functions or parameters");
    for (size_t i = 0; i < count; i++)
        name[i] = functions ? lg_program_function_name(program, i) : lg_program_parameter(program, i).name;
    return put_names(h5, functions ? "function_names" : "parameter_names", name, count, NAME, error);
}

static lg_status put_program(lg_h5 *h5, const lg_program *program, const lg_provenance *provenance,
                             lg_error *error) {
    names known = {.count = 0};
    LG_TRY(lg_h5_put_header(h5, KIND, provenance, error));
    if (lg_program_description(program)[0] != '\0')
        LG_TRY(lg_h5_put_text(h5, "", "description", lg_program_description(program), error));
    LG_TRY(put_order(h5, program, false, error));
    LG_TRY(put_order(h5, program, true, error));
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec p = lg_program_parameter(program, i);
        LG_TRY(put_parameter(h5, &p, error));
    }
    LG_TRY(put_functions(h5, program, &known, error));
    const uint64_t count = known.count;
    LG_TRY(put_names(h5, "operations", known.name, known.count, NAME, error));
    return lg_h5_put(h5, "revisions", LG_ELEMENT_U32, 1, &count, known.revision, error);
}

lg_status lg_program_save(const lg_context *context, const char *path, const lg_program *program,
                          const lg_provenance *provenance, lg_error *error) {
    lg_h5 *h5;
    if (path == NULL || program == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a file needs a name and a program");
    LG_TRY(lg_h5_create(context, path, &h5, error));
    lg_status status = put_program(h5, program, provenance, error);
    if (status == LG_OK) status = lg_h5_commit(h5, error);
    lg_h5_close(h5);
    return status;
}

/* ---- loading ---- */

typedef struct reading {
    lg_h5 *h5;
    uint64_t left; /* bytes that may still be read */
    lg_program *program;
    char (*operation)[NAME];
    uint32_t *revision;
    size_t operations;
    lg_error *error;
} reading;

static lg_status bad(const reading *r, const char *name, const char *what) {
    return lg_fail(r->error, LG_FORMAT, "%s: /%s: %s", lg_shown_path(r->h5->path), name, what);
}

/* Missing keys and wrong shapes are matters of format. */
static lg_status as_format(const reading *r, lg_status status) {
    if (status != LG_NOT_FOUND && status != LG_SHAPE && status != LG_INVALID_ARGUMENT) return status;
    if (r->error != NULL) r->error->status = LG_FORMAT;
    return LG_FORMAT;
}

/* Memory that stays within what may be read. */
static lg_status take(reading *r, const char *name, uint64_t count, size_t size, void **out) {
    if (count > r->left / size) return bad(r, name, "holds more than the file can hold or the limit allows");
    r->left -= count * size;
    *out = lg_alloc(r->h5->context, (size_t)count, size);
    return *out != NULL ? LG_OK : no_memory(r->h5, r->error);
}

/* A list of any length. */
static lg_status get_list(reading *r, const char *group, const char *name, lg_element type, uint64_t *count,
                          void **out) {
    uint32_t rank;
    uint64_t dims[4];
    const key at = below(group, name);
    LG_TRY(as_format(r, lg_h5_shape(r->h5, at.text, &rank, dims, NULL, r->error)));
    if (rank != 1) return bad(r, at.text, "is not a list");
    LG_TRY(take(r, at.text, dims[0], type == LG_ELEMENT_U32 ? sizeof(uint32_t) : 8, out));
    *count = dims[0];
    return as_format(r, lg_h5_get(r->h5, at.text, type, 1, dims, *out, r->error));
}

static lg_status get_columns(reading *r, const char *group, const column *rows, size_t n, uint64_t count,
                             void **columns) {
    for (size_t i = 0; i < n; i++) {
        uint64_t dims[4];
        const uint32_t rank = column_shape(&rows[i], count, dims);
        const key at = below(group, rows[i].name);
        LG_TRY(take(r, at.text, count, row_bytes(&rows[i]), &columns[i]));
        LG_TRY(as_format(r, lg_h5_get(r->h5, at.text, rows[i].type, rank, dims, columns[i], r->error)));
    }
    return LG_OK;
}

/* ---- texts ---- */

typedef struct texts {
    reading *r;
    const char *path;
    char (*text)[NAME];
    uint64_t count;
    size_t most;
} texts;

static lg_status keep_text(void *user, uint64_t index, const char *text, lg_error *error) {
    texts *t = user;
    (void)error;
    if (index >= t->most) return bad(t->r, t->path, "has more entries than may be");
    if (strlen(text) >= NAME) return bad(t->r, t->path, "has a text that is too long");
    (void)snprintf(t->text[index], NAME, "%s", text);
    t->count = index + 1;
    return LG_OK;
}

static lg_status get_texts(reading *r, const char *path, size_t most, char (**out)[NAME], size_t *count) {
    texts t = {.r = r, .path = path, .most = most};
    *out = t.text = lg_alloc(r->h5->context, most, NAME);
    if (t.text == NULL) return no_memory(r->h5, r->error);
    LG_TRY(as_format(r, lg_h5_each_text(r->h5, path, keep_text, &t, r->error)));
    *count = (size_t)t.count;
    return LG_OK;
}

/* A name that leads to no other place of the file. */
static bool is_plain(const char *name) {
    for (const char *c = name; *c != '\0'; c++)
        if (!((*c >= 'a' && *c <= 'z') || (*c >= 'A' && *c <= 'Z') || (*c >= '0' && *c <= '9') || *c == '_'))
            return false;
    return *name != '\0';
}

/* ---- ports ---- */

typedef struct ports {
    lg_port port[64];
    size_t count;
    char (*name)[NAME], (*unit)[UNIT];
    void *columns[PORT_COLUMNS];
} ports;

static void free_ports(const lg_context *context, ports *p) {
    lg_free(context, p->name);
    lg_free(context, p->unit);
    free_columns(context, PORT_COLUMNS, p->columns);
}

static lg_status get_ports(reading *r, const char *group, ports *p) {
    size_t units = 0;
    const key unit = below(group, "unit");
    LG_TRY(get_texts(r, below(group, "name").text, LG_COUNT(p->port), &p->name, &p->count));
    LG_TRY(get_texts(r, unit.text, LG_COUNT(p->port), &p->unit, &units));
    if (units != p->count) return bad(r, unit.text, "has another number of entries than there are names");
    LG_TRY(get_columns(r, group, port_rows, PORT_COLUMNS, p->count, p->columns));
    const uint32_t *rank = p->columns[PORT_RANK], *shape = p->columns[PORT_SHAPE];
    const uint32_t *shared = p->columns[SHARED];
    const double *range = p->columns[RANGE];
    for (size_t i = 0; i < p->count; i++) {
        if (shared[i] > 1) return bad(r, group, "an entry of `shared` is neither 0 nor 1");
        p->port[i] = (lg_port){.name = p->name[i],
                               .shape = {.rank = rank[i]},
                               .shared = shared[i] != 0,
                               .unit = p->unit[i][0] != '\0' ? p->unit[i] : NULL,
                               .low = range[2 * i],
                               .high = range[2 * i + 1]};
        memcpy(p->port[i].shape.dims, shape + i * LG_MAX_RANK, sizeof p->port[i].shape.dims);
    }
    return LG_OK;
}

/* ---- functions ---- */

typedef struct function {
    ports inputs, outputs;
    void *columns[OPERATION_COLUMNS];
    void *list[LG_COUNT(lists)]; /* edges, reals, indices */
    lg_operation *operations;
    uint32_t *results, carry[64];
} function;

static void free_function(const lg_context *context, function *f) {
    if (f == NULL) return;
    free_ports(context, &f->inputs);
    free_ports(context, &f->outputs);
    free_columns(context, OPERATION_COLUMNS, f->columns);
    for (size_t k = 0; k < LG_COUNT(lists); k++) lg_free(context, f->list[k]);
    lg_free(context, f->operations);
    lg_free(context, f->results);
    lg_free(context, f);
}

static lg_status fill_operations(reading *r, const char *group, function *f, size_t n) {
    void *const *c = f->columns;
    const uint32_t *operation = c[OPERATION], *inputs = c[INPUTS], *rank = c[OPERATION_RANK];
    const uint32_t *reals = c[REALS], *indices = c[INDICES];
    const lg_affine *shape = c[SHAPE], *whole = c[WHOLE], *reciprocal = c[RECIPROCAL];
    const double *real = c[REAL];
    for (size_t i = 0; i < n; i++) {
        if (operation[i] >= r->operations)
            return bad(r, group, "an operation's number is beyond the list /operations");
        lg_operation *o = &f->operations[i];
        *o = (lg_operation){.name = r->operation[operation[i]],
                            .revision = r->revision[operation[i]],
                            .input_count = inputs[i],
                            .rank = rank[i],
                            .real = real[i],
                            .reciprocal = reciprocal[i],
                            .real_count = reals[i],
                            .index_count = indices[i]};
        memcpy(o->shape, shape + i * LG_MAX_RANK, sizeof o->shape);
        memcpy(o->whole, whole + i * LG_WHOLE_COUNT, sizeof o->whole);
    }
    return LG_OK;
}

/* Operations point into the list, end to end. */
static lg_status point_into(reading *r, const char *group, function *f, size_t n, size_t k) {
    const list *l = &lists[k];
    uint64_t there = 0;
    LG_TRY(get_list(r, group, l->name, l->type, &there, &f->list[k]));
    if (list_count(l, f->operations, n) != there)
        return lg_fail(r->error, LG_FORMAT, "%s: /%s/%s: has another length than its operations say",
                       lg_shown_path(r->h5->path), group, l->name);
    const char *at = f->list[k];
    for (size_t i = 0; i < n; i++) {
        lg_operation *o = &f->operations[i];
        const void *here = at;
        memcpy((char *)o + l->pointer, &here, sizeof here);
        at += count_of(l, o) * l->size;
    }
    return LG_OK;
}

static lg_status get_operations(reading *r, const char *group, function *f, lg_function_image *image) {
    const key at = below(group, "operations"), first = below(at.text, operation_rows[0].name);
    uint32_t rank;
    uint64_t dims[4], results = 0;
    void *memory = NULL;
    LG_TRY(as_format(r, lg_h5_shape(r->h5, first.text, &rank, dims, NULL, r->error)));
    if (rank != 1) return bad(r, first.text, "is not a list");
    const size_t n = (size_t)dims[0];
    LG_TRY(get_columns(r, at.text, operation_rows, OPERATION_COLUMNS, n, f->columns));
    LG_TRY(take(r, at.text, n, sizeof *f->operations, &memory));
    f->operations = memory;
    LG_TRY(fill_operations(r, at.text, f, n));
    for (size_t k = 0; k < LG_COUNT(lists); k++) LG_TRY(point_into(r, group, f, n, k));
    memory = NULL;
    const lg_status status = get_list(r, group, "results", LG_ELEMENT_U32, &results, &memory);
    f->results = memory;
    LG_TRY(status);
    if (results != f->outputs.count) return bad(r, group, "has not one result for each output");
    image->operations = f->operations;
    image->operation_count = n;
    image->results = f->results;
    return LG_OK;
}

static lg_status get_loop(reading *r, const char *group, function *f, lg_function_image *image) {
    char callee[NAME];
    int64_t carry[64];
    const key at = below(group, "carry");
    size_t number;
    const uint64_t dims[1] = {f->inputs.count};
    LG_TRY(as_format(r, lg_h5_text(r->h5, group, "calls", callee, sizeof callee, r->error)));
    LG_TRY(as_format(r, lg_h5_number(r->h5, group, "times", LG_ELEMENT_U32, &image->times, r->error)));
    LG_TRY(as_format(r, lg_h5_get(r->h5, at.text, LG_ELEMENT_I64, 1, dims, carry, r->error)));
    if (image->times == 0) return bad(r, group, "attribute times is 0");
    if (lg_program_find(r->program, callee, &number) != LG_OK)
        return bad(r, group, "attribute calls names no function that comes before this one");
    for (size_t i = 0; i < f->inputs.count; i++) {
        if (carry[i] < -1 || carry[i] >= (int64_t)f->outputs.count)
            return bad(r, at.text, "an entry is no output");
        f->carry[i] = carry[i] < 0 ? LG_CARRY_NONE : (uint32_t)carry[i];
    }
    image->callee = (uint32_t)number;
    image->carry = f->carry;
    return LG_OK;
}

static lg_status get_function(reading *r, const char *name, function *f) {
    const key at = below("functions", name);
    lg_function_image image = {.name = name};
    LG_TRY(get_ports(r, below(at.text, "inputs").text, &f->inputs));
    LG_TRY(get_ports(r, below(at.text, "outputs").text, &f->outputs));
    image.inputs = f->inputs.port;
    image.input_count = f->inputs.count;
    image.outputs = f->outputs.port;
    image.output_count = f->outputs.count;
    LG_TRY(lg_h5_has_attribute(r->h5, at.text, "calls") ? get_loop(r, at.text, f, &image)
                                                        : get_operations(r, at.text, f, &image));
    lg_error why = {LG_OK, ""};
    const lg_status status = lg_program_add_image(r->program, &image, &why);
    if (status == LG_OK) return LG_OK;
    return as_format(
        r, lg_fail(r->error, status, "%s: /%s: %s", lg_shown_path(r->h5->path), at.text, why.message));
}

static lg_status get_functions(reading *r, char (*name)[NAME], size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (!is_plain(name[i])) return bad(r, "function_names", "an entry is not the name of a function");
        function *f = lg_alloc(r->h5->context, 1, sizeof *f);
        if (f == NULL) return no_memory(r->h5, r->error);
        const uint64_t before = r->left;
        const lg_status status = get_function(r, name[i], f);
        free_function(r->h5->context, f);
        LG_TRY(status);
        r->left = before - (before - r->left) / 2; /* about what the program keeps of it */
    }
    return LG_OK;
}

/* ---- parameters ---- */

static lg_status get_parameter(reading *r, const char *name, lg_parameter_spec *p, double **values) {
    const key at = below("parameters", name);
    uint32_t rank;
    uint64_t dims[4], count = 1;
    void *memory = NULL;
    if (!is_plain(name)) return bad(r, "parameter_names", "an entry is not the name of a parameter");
    LG_TRY(as_format(r, lg_h5_shape(r->h5, at.text, &rank, dims, NULL, r->error)));
    p->name = name;
    p->shape.rank = rank;
    for (uint32_t d = 0; d < rank; d++) {
        if (dims[d] > UINT32_MAX) return bad(r, at.text, "is too large");
        p->shape.dims[d] = (uint32_t)dims[d];
        count *= dims[d];
    }
    LG_TRY(take(r, at.text, count, sizeof **values, &memory));
    p->values = *values = memory;
    LG_TRY(as_format(r, lg_h5_get(r->h5, at.text, LG_ELEMENT_F64, rank, dims, memory, r->error)));
    return lg_check_finite(r->h5->path, at.text, rank, dims, *values, r->error);
}

static lg_status get_description(reading *r, char text[TEXT]) {
    text[0] = '\0';
    if (!lg_h5_has_attribute(r->h5, "", "description")) return LG_OK;
    return as_format(r, lg_h5_text(r->h5, "", "description", text, TEXT, r->error));
}

/* The program with its parameters, without functions. */
static lg_status get_parameters(reading *r, char (*name)[NAME], size_t count) {
    const lg_context *context = r->h5->context;
    char description[TEXT];
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    LG_TRY(get_description(r, description));
    lg_parameter_spec *made = lg_alloc(context, count, sizeof *made);
    double **values = lg_alloc(context, count, sizeof *values);
    lg_status status = made != NULL && values != NULL ? LG_OK : no_memory(r->h5, r->error);
    for (size_t i = 0; i < count && status == LG_OK; i++)
        status = get_parameter(r, name[i], &made[i], &values[i]);
    if (status == LG_OK) {
        lg_error why = {LG_OK, ""};
        spec.parameters = made;
        spec.parameter_count = count;
        spec.description = description[0] != '\0' ? description : NULL;
        status = lg_program_build(context, &spec, &r->program, &why);
        if (status != LG_OK)
            status = as_format(
                r, lg_fail(r->error, status, "%s: /parameters: %s", lg_shown_path(r->h5->path), why.message));
    }
    for (size_t i = 0; values != NULL && i < count; i++) lg_free(context, values[i]);
    lg_free(context, values);
    lg_free(context, made);
    return status;
}

/* ---- the file ---- */

static lg_status get_names(reading *r) {
    LG_TRY(get_texts(r, "operations", MOST_NAMES, &r->operation, &r->operations));
    const uint64_t count = r->operations;
    r->revision = lg_alloc(r->h5->context, r->operations, sizeof *r->revision);
    if (r->revision == NULL) return no_memory(r->h5, r->error);
    if (!lg_h5_has(r->h5, "revisions")) { /* written by hand: the first ones */
        for (size_t i = 0; i < r->operations; i++) r->revision[i] = 1;
        return LG_OK;
    }
    return as_format(r, lg_h5_get(r->h5, "revisions", LG_ELEMENT_U32, 1, &count, r->revision, r->error));
}

static lg_status get_program(reading *r, char (**parameter)[NAME], char (**function_)[NAME]) {
    size_t parameters = 0, functions = 0;
    LG_TRY(lg_h5_check_format(r->h5, KIND, false, r->error));
    LG_TRY(get_names(r));
    if (lg_h5_has(r->h5, "parameter_names"))
        LG_TRY(get_texts(r, "parameter_names", MOST_NAMES, parameter, &parameters));
    LG_TRY(get_texts(r, "function_names", MOST_NAMES, function_, &functions));
    LG_TRY(get_parameters(r, *parameter, parameters));
    return get_functions(r, *function_, functions);
}

static lg_status load(void *user, lg_h5 *h5, lg_error *error) {
    lg_program **out = user;
    reading r = {.h5 = h5, .left = h5->max_bytes, .error = error};
    char(*parameter)[NAME] = NULL, (*function_)[NAME] = NULL;
    const lg_status status = get_program(&r, &parameter, &function_);
    lg_free(h5->context, parameter);
    lg_free(h5->context, function_);
    lg_free(h5->context, r.operation);
    lg_free(h5->context, r.revision);
    if (status == LG_OK)
        *out = r.program;
    else
        lg_program_destroy(r.program);
    return status;
}

lg_status lg_program_load(const lg_context *context, const char *path, const lg_read_options *options,
                          lg_program **out, lg_error *error) {
    if (path == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a file needs a name, the program a place");
    return lg_h5_read(context, path, options, load, out, error);
}
