/* Functions of programs in files of format 1, as liegrad 1 wrote them. A function is a group. Its operations
 * and ports are stored as columns, with one number or row per operation or port. /operations lists the names
 * of operations. */
#include <string.h>

#include "model/files/program_file.h"

enum { PORTS = 64, MOST_SETS = 40 };
#define ANY UINT64_MAX

/* A function while it is being read. */
typedef struct function {
    lg_program_reading *r;
    const char *path;
    void *set[MOST_SETS]; /* memory of everything that was read for it */
    size_t sets;
    lg_port port[2][PORTS];
    uint32_t carry[PORTS];
} function;

/* The operations that the file names. */
typedef struct known_operations {
    lg_program_texts names;
    const uint32_t *revision;
} known_operations;

/* ---- numbers ---- */

static lg_status keep(function *f, const char *path, uint64_t count, size_t size, void **out) {
    LG_TRY(lg_program_take(f->r, path, count, size, out));
    f->set[f->sets++] = *out;
    return LG_OK;
}

/* Reads the numbers of a data set of this shape. If dims[0] is ANY, it becomes the stored length. */
static lg_status get_numbers(function *f, const char *path, lg_element type, uint32_t rank, uint64_t *dims,
                             void **out) {
    lg_program_reading *r = f->r;
    uint64_t there[4] = {0}, count = 1;
    uint32_t rank_there = rank;
    if (dims[0] == ANY) {
        LG_TRY(lg_program_as_format(r, lg_h5_shape(r->h5, path, &rank_there, there, NULL, r->error)));
        if (rank_there != rank) return lg_program_bad(r, path, "is not a list");
        dims[0] = there[0];
    }
    for (uint32_t d = 0; d < rank; d++) count *= dims[d];
    LG_TRY(keep(f, path, count, type == LG_ELEMENT_U32 ? sizeof(uint32_t) : 8, out));
    return lg_program_as_format(r, lg_h5_get(r->h5, path, type, rank, dims, *out, r->error));
}

static lg_status get_list(function *f, const char *path, lg_element type, uint64_t *count, void **out) {
    return get_numbers(f, path, type, 1, count, out);
}

/* A column: per operation or port one number, or an array of shape `dims`. `at` is the offset in lg_operation
 * or lg_port where it is copied to. */
typedef struct column {
    const char *name;
    lg_element type;
    uint64_t dims[2];
    size_t bytes, at; /* bytes: of one operation or port */
} column;

#define AT(type, member) sizeof(((type *)0)->member), offsetof(type, member)
static const column operation_columns[] = {
    /* index in /operations; its revision replaces it later */
    {"operation", LG_ELEMENT_U32, {0}, AT(lg_operation, revision)},
    {"inputs", LG_ELEMENT_U32, {0}, AT(lg_operation, input_count)},
    {"rank", LG_ELEMENT_U32, {0}, AT(lg_operation, rank)},
    {"shape", LG_ELEMENT_I64, {LG_MAX_RANK, 2}, AT(lg_operation, shape)},
    {"whole", LG_ELEMENT_I64, {LG_WHOLE_COUNT, 2}, AT(lg_operation, whole)},
    {"real", LG_ELEMENT_F64, {0}, AT(lg_operation, real)},
    {"reciprocal", LG_ELEMENT_I64, {2}, AT(lg_operation, reciprocal)},
    {"reals", LG_ELEMENT_U32, {0}, AT(lg_operation, real_count)},
    {"indices", LG_ELEMENT_U32, {0}, AT(lg_operation, index_count)},
};
static const column port_columns[] = {
    {"rank", LG_ELEMENT_U32, {0}, AT(lg_port, shape.rank)},
    {"shape", LG_ELEMENT_U32, {LG_MAX_RANK}, AT(lg_port, shape.dims)},
    {"range", LG_ELEMENT_F64, {2}, 2 * sizeof(double), offsetof(lg_port, low)},
};
_Static_assert(sizeof(lg_affine) == 16 && offsetof(lg_port, high) == offsetof(lg_port, low) + 8,
               "pairs lie in files as in memory");

static lg_status get_columns(function *f, const char *group, const column *columns, size_t n, uint64_t count,
                             void *to, size_t stride) {
    for (const column *c = columns; c < columns + n; c++) {
        uint64_t dims[3] = {count, c->dims[0], c->dims[1]};
        const uint32_t rank = 1 + (dims[1] > 0) + (dims[2] > 0);
        void *from;
        LG_TRY(get_numbers(f, lg_program_below(group, c->name).text, c->type, rank, dims, &from));
        for (uint64_t i = 0; i < count; i++)
            memcpy((char *)to + i * stride + c->at, (const char *)from + i * c->bytes, c->bytes);
    }
    return LG_OK;
}

/* ---- ports ---- */

static lg_status get_texts(function *f, const char *path, lg_program_texts *out) {
    LG_TRY(lg_program_get_texts(f->r, path, NULL, PORTS, out));
    f->set[f->sets++] = out->text;
    return LG_OK;
}

static lg_status get_ports(function *f, const char *name, lg_port *ports, size_t *count) {
    const lg_program_key at = lg_program_below(f->path, name), unit = lg_program_below(at.text, "unit");
    lg_program_texts names, units;
    void *shared;
    LG_TRY(get_texts(f, lg_program_below(at.text, "name").text, &names));
    LG_TRY(get_texts(f, unit.text, &units));
    if (units.count != names.count)
        return lg_program_bad(f->r, unit.text, "the number of entries differs from the number of names");
    uint64_t n = *count = names.count;
    LG_TRY(get_columns(f, at.text, port_columns, LG_COUNT(port_columns), n, ports, sizeof *ports));
    LG_TRY(get_list(f, lg_program_below(at.text, "shared").text, LG_ELEMENT_U32, &n, &shared));
    for (size_t i = 0; i < n; i++) {
        ports[i].name = names.text[i];
        ports[i].unit = units.text[i][0] != '\0' ? units.text[i] : NULL;
        ports[i].shared = ((const uint32_t *)shared)[i] != 0;
        if (((const uint32_t *)shared)[i] > 1)
            return lg_program_bad(f->r, at.text, "an entry of `shared` is neither 0 nor 1");
    }
    return LG_OK;
}

/* ---- operations ---- */

/* Gives each operation its part of a list: the parts follow each other in the order of the operations.
 * `pointer` and `count` are the offsets of pointer and length in lg_operation. */
static lg_status point_into(function *f, const char *name, lg_element type, lg_operation *operations,
                            size_t n, size_t pointer, size_t count) {
    const size_t size = type == LG_ELEMENT_U32 ? 4 : 8;
    const lg_program_key at = lg_program_below(f->path, name);
    uint64_t there = ANY, used = 0;
    void *list;
    LG_TRY(get_list(f, at.text, type, &there, &list));
    for (size_t i = 0; i < n; i++) {
        const void *here = (const char *)list + (used < there ? used : there) * size;
        uint32_t own;
        memcpy(&own, (const char *)&operations[i] + count, sizeof own);
        memcpy((char *)&operations[i] + pointer, &here, sizeof here);
        used += own;
    }
    return used == there
               ? LG_OK
               : lg_program_bad(f->r, at.text, "the length differs from the length that the operations give");
}

static lg_status get_operations(function *f, const known_operations *known, lg_function_image *image) {
    const lg_program_key at = lg_program_below(f->path, "operations");
    uint64_t n = ANY, results = image->output_count;
    void *memory;
    LG_TRY(get_list(f, lg_program_below(at.text, "operation").text, LG_ELEMENT_U32, &n, &memory));
    LG_TRY(keep(f, at.text, n, sizeof(lg_operation), &memory));
    lg_operation *list = image->operations = memory;
    image->operation_count = (size_t)n;
    LG_TRY(get_columns(f, at.text, operation_columns, LG_COUNT(operation_columns), n, list, sizeof *list));
    for (size_t i = 0; i < n; i++) {
        const uint32_t k = list[i].revision;
        if (k >= known->names.count)
            return lg_program_bad(f->r, at.text, "the number of an operation is not in the list /operations");
        list[i].name = known->names.text[k];
        list[i].revision = known->revision != NULL ? known->revision[k] : 1;
    }
    LG_TRY(point_into(f, "edges", LG_ELEMENT_U32, list, n, offsetof(lg_operation, inputs),
                      offsetof(lg_operation, input_count)));
    LG_TRY(point_into(f, "reals", LG_ELEMENT_F64, list, n, offsetof(lg_operation, reals),
                      offsetof(lg_operation, real_count)));
    LG_TRY(point_into(f, "indices", LG_ELEMENT_U32, list, n, offsetof(lg_operation, indices),
                      offsetof(lg_operation, index_count)));
    LG_TRY(get_list(f, lg_program_below(f->path, "results").text, LG_ELEMENT_U32, &results, &memory));
    image->results = memory;
    return LG_OK;
}

static lg_status get_loop(function *f, lg_function_image *image) {
    lg_program_reading *r = f->r;
    char callee[LG_PROGRAM_NAME];
    size_t number;
    uint64_t inputs = image->input_count;
    void *carry;
    const lg_program_key at = lg_program_below(f->path, "carry");
    LG_TRY(lg_program_as_format(r, lg_h5_text(r->h5, f->path, "calls", callee, sizeof callee, r->error)));
    LG_TRY(lg_program_as_format(
        r, lg_h5_number(r->h5, f->path, "times", LG_ELEMENT_U32, &image->times, r->error)));
    LG_TRY(get_list(f, at.text, LG_ELEMENT_I64, &inputs, &carry));
    if (image->times == 0) return lg_program_bad(r, f->path, "attribute times is 0");
    if (lg_program_find(r->program, callee, &number, NULL) != LG_OK)
        return lg_program_bad(r, f->path, "attribute calls must name a function that comes before this one");
    for (size_t i = 0; i < inputs; i++) {
        const int64_t from = ((const int64_t *)carry)[i];
        if (from < -1 || from >= (int64_t)image->output_count)
            return lg_program_bad(r, at.text, "an entry is not the number of an output");
        f->carry[i] = from < 0 ? LG_CARRY_NONE : (uint32_t)from;
    }
    image->callee = (uint32_t)number;
    image->carry = f->carry;
    return LG_OK;
}

/* ---- functions ---- */

static lg_status get_function(function *f, const known_operations *known, const char *name) {
    lg_function_image image = {.name = name, .inputs = f->port[0], .outputs = f->port[1]};
    LG_TRY(get_ports(f, "inputs", f->port[0], &image.input_count));
    LG_TRY(get_ports(f, "outputs", f->port[1], &image.output_count));
    LG_TRY(lg_h5_has_attribute(f->r->h5, f->path, "calls") ? get_loop(f, &image)
                                                           : get_operations(f, known, &image));
    return lg_program_add(f->r, f->path, &image);
}

static lg_status get_each(lg_program_reading *r, const known_operations *known) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < r->functions.count && status == LG_OK; i++) {
        const char *name = r->functions.text[i];
        const lg_program_key at = lg_program_below("functions", name);
        function f = {.r = r, .path = at.text};
        const size_t before = r->left;
        status = get_function(&f, known, name);
        r->left = before - (before - r->left) / 2; /* estimate: the program keeps half of what was read */
        while (f.sets > 0) lg_free(r->h5->context, f.set[--f.sets]);
    }
    return status;
}

lg_status lg_program_get_functions_1(lg_program_reading *r) {
    function file = {.r = r};
    known_operations known = {.revision = NULL};
    void *revisions = NULL;
    lg_status status = lg_program_get_texts(r, "operations", NULL, LG_PROGRAM_MOST_NAMES, &known.names);
    uint64_t count = known.names.count;
    /* files written by hand lack them; all revisions are then 1 */
    if (status == LG_OK && lg_h5_has(r->h5, "revisions"))
        status = get_list(&file, "revisions", LG_ELEMENT_U32, &count, &revisions);
    known.revision = revisions;
    if (status == LG_OK) status = get_each(r, &known);
    lg_free(r->h5->context, known.names.text);
    lg_free(r->h5->context, revisions);
    return status;
}
