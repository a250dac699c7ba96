/* Programs in files: saving. */
#include "model/files/program_file.h"

#include <stdio.h>
#include <string.h>

static lg_status make_columns(const lg_context *context, const lg_program_column *rows, size_t n,
                              size_t count, void **columns) {
    for (size_t i = 0; i < n; i++)
        if ((columns[i] = lg_alloc(context, count, lg_program_row_size(&rows[i]))) == NULL)
            return LG_OUT_OF_MEMORY;
    return LG_OK;
}

/* Names of operations, each once, in the order of their first use. */
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

static lg_status put_columns(lg_h5 *h5, const char *group, const lg_program_column *rows, size_t n,
                             size_t count, void *const *columns, lg_error *error) {
    for (size_t i = 0; i < n; i++) {
        uint64_t dims[4];
        const uint32_t rank = lg_program_column_shape(&rows[i], count, dims);
        LG_TRY(lg_h5_put(h5, lg_program_below(group, rows[i].name).text, rows[i].type, rank, dims, columns[i],
                         error));
    }
    return LG_OK;
}

static lg_status put_list(lg_h5 *h5, const char *group, const char *name, lg_element type, uint64_t count,
                          const void *data, lg_error *error) {
    return lg_h5_put(h5, lg_program_below(group, name).text, type, 1, &count, data, error);
}

static lg_status put_names(lg_h5 *h5, const char *path, const char *const *name, size_t count, size_t size,
                           lg_error *error) {
    char *texts = lg_alloc(h5->context, count, size);
    if (texts == NULL) return lg_program_no_memory(h5, error);
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
    LG_TRY(put_names(h5, lg_program_below(group, "name").text, name, count, NAME, error));
    return put_names(h5, lg_program_below(group, "unit").text, unit, count, UNIT, error);
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
    lg_status status = make_columns(h5->context, lg_program_port_rows, PORT_COLUMNS, count, columns);
    if (status == LG_OK) {
        fill_ports(ports, count, columns);
        status = put_port_texts(h5, group, ports, count, error);
    } else {
        (void)lg_program_no_memory(h5, error);
    }
    if (status == LG_OK)
        status = put_columns(h5, group, lg_program_port_rows, PORT_COLUMNS, count, columns, error);
    lg_program_free_columns(h5->context, PORT_COLUMNS, columns);
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

static lg_status put_lists(lg_h5 *h5, const char *group, const lg_function_image *image, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t k = 0; k < LG_PROGRAM_LISTS && status == LG_OK; k++) {
        const lg_program_list *l = &lg_program_lists[k];
        const uint64_t total = lg_program_list_count(l, image->operations, image->operation_count);
        unsigned char *data = lg_alloc(h5->context, (size_t)total, l->size), *to = data;
        if (data == NULL) return lg_program_no_memory(h5, error);
        for (size_t i = 0; i < image->operation_count; i++) {
            const lg_operation *o = &image->operations[i];
            const size_t bytes = lg_program_count_of(l, o) * l->size;
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
    lg_status status = make_columns(h5->context, lg_program_operation_rows, OPERATION_COLUMNS, n, columns);
    if (status == LG_OK) {
        fill_columns(image, known, columns);
        status = put_columns(h5, lg_program_below(group, "operations").text, lg_program_operation_rows,
                             OPERATION_COLUMNS, n, columns, error);
    } else {
        (void)lg_program_no_memory(h5, error);
    }
    lg_program_free_columns(h5->context, OPERATION_COLUMNS, columns);
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
    const lg_program_key at = lg_program_below("functions", image->name);
    LG_TRY(put_ports(h5, lg_program_below(at.text, "inputs").text, image->inputs, image->input_count, error));
    LG_TRY(
        put_ports(h5, lg_program_below(at.text, "outputs").text, image->outputs, image->output_count, error));
    return image->times > 0 ? put_loop(h5, at.text, program, image, error)
                            : put_operations(h5, at.text, image, known, error);
}

static lg_status put_functions(lg_h5 *h5, const lg_program *program, names *known, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_functions(program) && status == LG_OK; i++) {
        lg_function_image *image;
        status = lg_function_image_create(program, i, &image);
        if (status != LG_OK) return lg_program_no_memory(h5, error);
        status = put_function(h5, program, image, known, error);
        lg_function_image_destroy(image);
    }
    return status;
}

static lg_status put_parameter(lg_h5 *h5, const lg_parameter_spec *p, lg_error *error) {
    uint64_t dims[LG_MAX_RANK];
    for (uint32_t d = 0; d < p->shape.rank; d++) dims[d] = p->shape.dims[d];
    return lg_h5_put(h5, lg_program_below("parameters", p->name).text, LG_ELEMENT_F64, p->shape.rank, dims,
                     p->values, error);
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
    LG_TRY(lg_h5_put_header(h5, LG_PROGRAM_KIND, provenance, error));
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
