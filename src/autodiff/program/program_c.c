/* Programs as C, the whole file: each function from a plan of one row made in double precision, its
 * declaration, and the arrays. */
#include "autodiff/program/program_c.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>

/* ---- declarations ---- */

static void add_shape(lg_text *to, const lg_port *port) {
    lg_text_add(to, " %s (", port->name);
    for (uint32_t d = 0; d < port->shape.rank; d++)
        lg_text_add(to, "%s%u", d > 0 ? ", " : "", port->shape.dims[d]);
    if (port->shape.rank == 0) lg_text_add(to, "1");
    lg_text_add(to, ")");
    if (port->unit != NULL && port->unit[0] != '\0') {
        lg_text_add(to, " in ");
        lg_text_add_comment(to, port->unit);
    }
}

static void add_ports(lg_text *to, const lg_port *ports, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (i > 0) lg_text_add(to, ",");
        add_shape(to, &ports[i]);
    }
}

/* Writes a parameter of a C function. Its name gets a trailing _ if it could be a macro (no lower-case
 * letter), is `work`, or begins like the program's own names. */
static void add_parameter(lg_c *c, lg_text *to, const char *name, bool in) {
    bool lower = false;
    for (const char *s = name; *s != '\0'; s++) lower = lower || (*s >= 'a' && *s <= 'z');
    const size_t length = strlen(c->name);
    const bool is_ours = strncmp(name, c->name, length) == 0 && name[length] == '_';
    lg_text_add(to, "%s%s_real *%s%s, ", in ? "const " : "", c->name, name,
                !lower || strcmp(name, "work") == 0 || is_ours ? "_" : "");
}

static void add_declaration(lg_c *c, lg_text *to, const lg_function *f, const char *title,
                            const lg_plan *plan, size_t work) {
    lg_text line = {.context = c->context};
    lg_text_add(&line, "/*");
    add_ports(&line, f->input, f->inputs);
    lg_text_add(&line, " ->");
    add_ports(&line, f->output, f->outputs);
    lg_text_add(&line, "; depth %zu, %zu numbers of work memory */", plan->depth, work);
    lg_text_add(to, "\n");
    if (lg_c_takes(c, &line)) lg_c_add_line(to, 0, line.data, line.length);
    lg_text_destroy(&line);
    lg_text_add(&line, "void %s_%s(", c->name, title);
    for (size_t i = 0; i < f->inputs; i++) add_parameter(c, &line, f->input[i].name, true);
    for (size_t j = 0; j < f->outputs; j++) add_parameter(c, &line, f->output[j].name, false);
    lg_text_add(&line, "%s_real *work);", c->name);
    if (lg_c_takes(c, &line)) lg_c_add_line(to, 0, line.data, line.length);
    lg_text_destroy(&line);
}

/* Refuses names of functions that would clash with other names in the C file. */
static bool check_function(lg_c *c, const char *title) {
    static const char *const taken[] = {"real", "weights", "indices", "H"};
    const size_t length = strlen(title), ending = strlen("WORK_SIZE");
    bool bad = lg_program_name_problem(title) != NULL ||
               (length >= ending && strcmp(title + length - ending, "WORK_SIZE") == 0);
    bool lower = false; /* names without lower-case letters are reserved for macros */
    for (const char *s = title; *s != '\0'; s++) lower = lower || (*s >= 'a' && *s <= 'z');
    bad = bad || !lower;
    for (size_t i = 0; i < LG_COUNT(taken); i++) bad = bad || strcmp(title, taken[i]) == 0;
    return !bad ||
           lg_c_fail(c, LG_INVALID_ARGUMENT,
                     "the name of function '%s' cannot be used in C: give the function another name", title);
}

/* ---- arrays ---- */

/* The program's parameter that contains these numbers; *from is the index of the first. NULL: no parameter
 * contains them, so they are constants or were computed from parameters. */
static const lg_program_parameter_own *origin_of(const lg_c *c, const lg_c_piece *piece, size_t *from) {
    const double *values = c->weight + piece->at;
    for (size_t p = 0; p < c->program->parameters; p++) {
        const lg_program_parameter_own *parameter = &c->program->parameter[p];
        for (size_t k = 0; k + piece->count <= parameter->count; k++)
            if (parameter->values[k] == values[0] &&
                memcmp(parameter->values + k, values, piece->count * sizeof *values) == 0) {
                *from = k;
                return parameter;
            }
    }
    return NULL;
}

static void add_origin(lg_c *c, lg_text *to, const lg_c_piece *piece) {
    size_t from = 0;
    const lg_program_parameter_own *parameter = origin_of(c, piece, &from);
    if (parameter == NULL)
        lg_text_add(to, "    /* constants */\n");
    else if (piece->count == parameter->count)
        lg_text_add(to, "    /* %s */\n", parameter->name);
    else
        lg_text_add(to, "    /* %s from %zu on */\n", parameter->name, from);
}

static void add_arrays(lg_c *c, lg_text *arrays, lg_text *weights) {
    if (c->weights == 0 && c->indices == 0) return;
    lg_text_add(arrays, "\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n");
    if (c->weights > 0) {
        lg_text_add(arrays, "extern const %s_real %s_weights[%zu];\n", c->name, c->name, c->weights);
        lg_text_add(weights, "\nconst %s_real %s_weights[%zu] = {\n", c->name, c->name, c->weights);
        for (size_t i = 0; i < c->pieces; i++) {
            const lg_c_piece *piece = &c->piece[i];
            add_origin(c, weights, piece);
            for (size_t k = 0; k < piece->count; k += 4)
                lg_text_add_hex_line(weights, c->dtype, c->weight + piece->at + k,
                                     piece->count - k < 4 ? piece->count - k : 4);
        }
        lg_text_add(weights, "};\n");
    }
    if (c->indices > 0) {
        lg_text_add(arrays, "extern const int %s_indices[%zu];\n", c->name, c->indices);
        lg_text_add(weights, "\nconst int %s_indices[%zu] = {\n", c->name, c->indices);
        for (size_t i = 0; i < c->indices; i++)
            lg_text_add(weights, "%s%u,%s", i % 10 == 0 ? "    " : " ", c->index[i],
                        i % 10 == 9 || i + 1 == c->indices ? "\n" : "");
        lg_text_add(weights, "};\n");
    }
    lg_text_add(arrays, "#ifdef __cplusplus\n}\n#endif\n");
}

/* ---- the whole file ---- */

void lg_c_options_init(lg_c_options *options) {
    *options = (lg_c_options){.size = sizeof *options, .dtype = LG_F64, .mark_unfit = true};
}

/* Upper bounds in bytes on stack frames, for gcc and clang at -O0 to -O3: of a function that calls functions
 * of plans, and of a fragment's function. They are large because clang spills many values in unrolled
 * loops. */
enum { CALLING_FRAME = 1024, FRAGMENT_FRAME = 1024 };

typedef struct writing {
    lg_c c;
    const lg_c_options *options;
    lg_c_source *out;
    lg_text sizes, declarations, arrays, weights;
} writing;

static bool is_called(const lg_program *program, size_t function) {
    for (size_t i = function + 1; i < program->functions; i++)
        if (lg_program_calls(program, i, function) > 0) return true;
    return false;
}

static bool write_function(writing *w, size_t index, const char *alias, bool hidden) {
    lg_c *c = &w->c;
    const lg_function *f = &c->program->function[index];
    const char *title = alias != NULL ? alias : f->name;
    lg_plan_options options;
    lg_plan *plan = NULL;
    char name[2 * LG_PROGRAM_MAX_NAME + 8];
    size_t work = 0;
    lg_plan_options_init(&options);
    options.mark_unfit = w->options->mark_unfit;
    options.compact = w->options->compact;
    options.packed = true;
    options.calls = true;
    const char *storage = hidden ? "static " : "";
    if (!check_function(c, title)) return false;
    c->status = lg_plan_create(c->program, index, &options, &plan, c->error);
    if (c->status != LG_OK) return false;
    (void)snprintf(name, sizeof name, "%s_%s", c->name, title);
    if (is_called(c->program, index))
        lg_c_write_shared(c, plan, storage, name, &work);
    else
        (void)lg_c_write_plan(c, plan, storage, name, &work);
    if (work > INT_MAX)
        (void)lg_c_fail(c, LG_UNSUPPORTED, "function '%s' needs more work memory than an int can count in C",
                        f->name);
    if (!hidden) {
        add_declaration(c, &w->declarations, f, title, plan, work);
        lg_text_add(&w->sizes, "#define %s_WORK_SIZE %zu\n", name, work > 0 ? work : 1);
    }
    lg_c_source *out = w->out;
    out->function[out->functions] = index;
    out->work[out->functions] = work > 0 ? work : 1;
    out->depth[out->functions++] = plan->depth;
    if (work > out->work_size) out->work_size = work;
    if (plan->depth > out->most_depth) out->most_depth = plan->depth;
    lg_plan_destroy(plan);
    return lg_c_good(c);
}

static bool unfit_or_failed(writing *w) {
    lg_text *const texts[] = {&w->sizes, &w->declarations, &w->arrays, &w->weights, &w->c.code};
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        if (texts[i]->failed) lg_c_fail_memory(&w->c);
        if (texts[i]->unfit)
            (void)lg_c_fail(&w->c, LG_NOT_FINITE, "the program has numbers that are not finite%s",
                            w->c.dtype == LG_F32 ? " in single precision" : "");
    }
    return w->c.status != LG_OK;
}

/* Hands the text over to the caller, who must free it. */
static char *give(writing *w, lg_text *text) {
    char *data = text->data != NULL ? text->data : lg_strdup(w->c.context, "");
    if (data == NULL) lg_c_fail_memory(&w->c);
    *text = (lg_text){.context = w->c.context};
    return data;
}

static void write_all(writing *w) {
    lg_c *c = &w->c;
    const lg_c_options *o = w->options;
    const size_t count = o->function_count > 0 ? o->function_count : c->program->functions;
    lg_c_source *out = w->out;
    if (LG_ALLOC_ALL(c->context, LG_ARRAY(out->function, count + 1), LG_ARRAY(out->work, count + 1),
                     LG_ARRAY(out->depth, count + 1)) != LG_OK) {
        lg_c_fail_memory(c);
        return;
    }
    lg_text_add(&w->sizes, "typedef %s %s_real;\n\n", c->dtype == LG_F32 ? "float" : "double", c->name);
    lg_text_add_named(&c->code, c->name, lg_named_text_of(lg_c_texts, "prelude"));
    lg_text_add(&c->code, "%s",
                lg_named_text_of(lg_c_texts, c->dtype == LG_F32 ? "prelude_f32" : "prelude_f64"));
    lg_text_add(&c->code, "\n%s", lg_named_text_of(lg_c_texts, "noinline"));
    for (size_t i = 0; i < count && lg_c_good(c); i++) {
        const size_t index = o->function_count > 0 ? o->functions[i] : i;
        if (index >= c->program->functions)
            (void)lg_c_fail(c, LG_NOT_FOUND, "the program has no function with this number");
        else
            (void)write_function(w, index, o->names != NULL && o->function_count > 0 ? o->names[i] : NULL,
                                 o->hidden != NULL && o->function_count > 0 && o->hidden[i]);
    }
    out->work_size = out->work_size > 0 ? out->work_size : 1;
    lg_text_add(&w->sizes, "#define %s_WORK_SIZE %zu /* the largest of them */\n", c->name, out->work_size);
    add_arrays(c, &w->arrays, &w->weights);
    out->stack_size = CALLING_FRAME * c->most_nesting + c->largest + FRAGMENT_FRAME * c->most_chain;
    out->stack_calls = c->most_nesting + 1 + c->most_chain;
    out->numbers = c->weights;
    out->integers = c->indices;
    out->lost = c->code.lost + w->weights.lost;
    if (!lg_c_good(c) || unfit_or_failed(w)) return;
    out->sizes = give(w, &w->sizes);
    out->declarations = give(w, &w->declarations);
    out->arrays = give(w, &w->arrays);
    out->weights = give(w, &w->weights);
    out->code = give(w, &c->code);
}

static void release(writing *w) {
    lg_c *c = &w->c;
    lg_text *const texts[] = {&w->sizes, &w->declarations, &w->arrays, &w->weights, &c->code};
    for (size_t i = 0; i < LG_COUNT(texts); i++) lg_text_destroy(texts[i]);
    for (size_t i = 0; i < c->functions; i++) lg_free(c->context, c->function[i].text);
    void *const arrays[] = {(void *)c->fragment, c->function, c->weight, c->piece, c->index, c->table};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(c->context, arrays[i]);
}

lg_status lg_program_write_c(const lg_program *program, const lg_c_options *options, lg_c_source **out,
                             lg_error *error) {
    LG_NEEDS(error, program, out);
    const lg_context *context = program->context;
    if (options == NULL || options->size != sizeof *options ||
        (options->dtype != LG_F64 && options->dtype != LG_F32))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the options are NULL, their size is wrong, or their dtype is neither LG_F64 nor LG_F32");
    const char *problem = options->name != NULL ? lg_program_name_problem(options->name) : "it is NULL";
    if (problem != NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the name in C: %s", problem);
    lg_c_source *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory");
    made->context = context;
    const lg_text empty = {.context = context};
    writing w = {.c = {.context = context,
                       .program = program,
                       .name = options->name,
                       .dtype = options->dtype,
                       .error = error,
                       .code = empty},
                 .options = options,
                 .out = made,
                 .sizes = empty,
                 .declarations = empty,
                 .arrays = empty,
                 .weights = empty};
    write_all(&w);
    release(&w);
    if (w.c.status == LG_OK)
        *out = made;
    else
        lg_c_source_destroy(made);
    return w.c.status;
}

void lg_c_source_destroy(lg_c_source *source) {
    if (source == NULL) return;
    char *const texts[] = {source->sizes, source->declarations, source->arrays, source->weights,
                           source->code};
    size_t *const arrays[] = {source->function, source->work, source->depth};
    for (size_t i = 0; i < LG_COUNT(texts); i++) lg_free(source->context, texts[i]);
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(source->context, arrays[i]);
    lg_free(source->context, source);
}
