/* Loads programs from files. Sizes in the file are checked before memory is allocated. */
#include "model/files/program_file.h"

#include <stdio.h>
#include <string.h>

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

/* Missing keys and wrong shapes become LG_FORMAT. */
static lg_status as_format(const reading *r, lg_status status) {
    if (status != LG_NOT_FOUND && status != LG_SHAPE && status != LG_INVALID_ARGUMENT) return status;
    if (r->error != NULL) r->error->status = LG_FORMAT;
    return LG_FORMAT;
}

/* Memory within the limit of the reader. */
static lg_status take(reading *r, const char *name, uint64_t count, size_t size, void **out) {
    if (count > r->left / size) return bad(r, name, "holds more than the file can hold or the limit allows");
    r->left -= count * size;
    *out = lg_alloc(r->h5->context, (size_t)count, size);
    return *out != NULL ? LG_OK : lg_program_no_memory(r->h5, r->error);
}

/* A list of any length. */
static lg_status get_list(reading *r, const char *group, const char *name, lg_element type, uint64_t *count,
                          void **out) {
    uint32_t rank;
    uint64_t dims[4];
    const lg_program_key at = lg_program_below(group, name);
    LG_TRY(as_format(r, lg_h5_shape(r->h5, at.text, &rank, dims, NULL, r->error)));
    if (rank != 1) return bad(r, at.text, "is not a list");
    LG_TRY(take(r, at.text, dims[0], type == LG_ELEMENT_U32 ? sizeof(uint32_t) : 8, out));
    *count = dims[0];
    return as_format(r, lg_h5_get(r->h5, at.text, type, 1, dims, *out, r->error));
}

static lg_status get_columns(reading *r, const char *group, const lg_program_column *rows, size_t n,
                             uint64_t count, void **columns) {
    for (size_t i = 0; i < n; i++) {
        uint64_t dims[4];
        const uint32_t rank = lg_program_column_shape(&rows[i], count, dims);
        const lg_program_key at = lg_program_below(group, rows[i].name);
        LG_TRY(take(r, at.text, count, lg_program_row_size(&rows[i]), &columns[i]));
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
    if (t.text == NULL) return lg_program_no_memory(r->h5, r->error);
    LG_TRY(as_format(r, lg_h5_each_text(r->h5, path, keep_text, &t, r->error)));
    *count = (size_t)t.count;
    return LG_OK;
}

/* A name that cannot lead to another place of the file. */
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
    lg_program_free_columns(context, PORT_COLUMNS, p->columns);
}

static lg_status get_ports(reading *r, const char *group, ports *p) {
    size_t units = 0;
    const lg_program_key unit = lg_program_below(group, "unit");
    LG_TRY(get_texts(r, lg_program_below(group, "name").text, LG_COUNT(p->port), &p->name, &p->count));
    LG_TRY(get_texts(r, unit.text, LG_COUNT(p->port), &p->unit, &units));
    if (units != p->count) return bad(r, unit.text, "has another number of entries than there are names");
    LG_TRY(get_columns(r, group, lg_program_port_rows, PORT_COLUMNS, p->count, p->columns));
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
    void *list[LG_PROGRAM_LISTS]; /* edges, reals, indices */
    lg_operation *operations;
    uint32_t *results, carry[64];
} function;

static void free_function(const lg_context *context, function *f) {
    if (f == NULL) return;
    free_ports(context, &f->inputs);
    free_ports(context, &f->outputs);
    lg_program_free_columns(context, OPERATION_COLUMNS, f->columns);
    for (size_t k = 0; k < LG_PROGRAM_LISTS; k++) lg_free(context, f->list[k]);
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

/* The parts of the operations follow each other in the list. */
static lg_status point_into(reading *r, const char *group, function *f, size_t n, size_t k) {
    const lg_program_list *l = &lg_program_lists[k];
    uint64_t there = 0;
    LG_TRY(get_list(r, group, l->name, l->type, &there, &f->list[k]));
    if (lg_program_list_count(l, f->operations, n) != there)
        return lg_fail(r->error, LG_FORMAT, "%s: /%s/%s: has another length than its operations say",
                       lg_shown_path(r->h5->path), group, l->name);
    const char *at = f->list[k];
    for (size_t i = 0; i < n; i++) {
        lg_operation *o = &f->operations[i];
        const void *here = at;
        memcpy((char *)o + l->pointer, &here, sizeof here);
        at += lg_program_count_of(l, o) * l->size;
    }
    return LG_OK;
}

static lg_status get_operations(reading *r, const char *group, function *f, lg_function_image *image) {
    const lg_program_key at = lg_program_below(group, "operations"),
                         first = lg_program_below(at.text, lg_program_operation_rows[0].name);
    uint32_t rank;
    uint64_t dims[4], results = 0;
    void *memory = NULL;
    LG_TRY(as_format(r, lg_h5_shape(r->h5, first.text, &rank, dims, NULL, r->error)));
    if (rank != 1) return bad(r, first.text, "is not a list");
    const size_t n = (size_t)dims[0];
    LG_TRY(get_columns(r, at.text, lg_program_operation_rows, OPERATION_COLUMNS, n, f->columns));
    LG_TRY(take(r, at.text, n, sizeof *f->operations, &memory));
    f->operations = memory;
    LG_TRY(fill_operations(r, at.text, f, n));
    for (size_t k = 0; k < LG_PROGRAM_LISTS; k++) LG_TRY(point_into(r, group, f, n, k));
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
    const lg_program_key at = lg_program_below(group, "carry");
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
    const lg_program_key at = lg_program_below("functions", name);
    lg_function_image image = {.name = name};
    LG_TRY(get_ports(r, lg_program_below(at.text, "inputs").text, &f->inputs));
    LG_TRY(get_ports(r, lg_program_below(at.text, "outputs").text, &f->outputs));
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
        if (f == NULL) return lg_program_no_memory(r->h5, r->error);
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
    const lg_program_key at = lg_program_below("parameters", name);
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
    lg_status status = made != NULL && values != NULL ? LG_OK : lg_program_no_memory(r->h5, r->error);
    for (size_t i = 0; i < count && status == LG_OK; i++)
        status = get_parameter(r, name[i], &made[i], &values[i]);
    if (status == LG_OK) {
        lg_error why = {LG_OK, ""};
        spec.parameters = made;
        spec.parameter_count = count;
        spec.description = description[0] != '\0' ? description : NULL;
        status = lg_program_begin(context, &spec, &r->program, &why);
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
    if (r->revision == NULL) return lg_program_no_memory(r->h5, r->error);
    if (!lg_h5_has(r->h5, "revisions")) { /* written by hand: the first ones */
        for (size_t i = 0; i < r->operations; i++) r->revision[i] = 1;
        return LG_OK;
    }
    return as_format(r, lg_h5_get(r->h5, "revisions", LG_ELEMENT_U32, 1, &count, r->revision, r->error));
}

static lg_status get_program(reading *r, char (**parameter)[NAME], char (**function_)[NAME]) {
    size_t parameters = 0, functions = 0;
    LG_TRY(lg_h5_check_format(r->h5, LG_PROGRAM_KIND, false, r->error));
    LG_TRY(get_names(r));
    if (lg_h5_has(r->h5, "parameter_names"))
        LG_TRY(get_texts(r, "parameter_names", MOST_NAMES, parameter, &parameters));
    LG_TRY(get_texts(r, "function_names", MOST_NAMES, function_, &functions));
    LG_TRY(get_parameters(r, *parameter, parameters));
    return get_functions(r, *function_, functions);
}

static lg_status load(void *user, lg_h5 *h5, lg_error *error) {
    lg_program **out = user;
    reading r = {.h5 = h5, .left = h5->max_size, .error = error};
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
