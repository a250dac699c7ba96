/* Programs: creation and destruction, adding parts, reading. */
#include "autodiff/program/program_check.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/text.h"
#include "core/widen.h"

/* ---- creation and destruction ---- */

void lg_program_spec_init(lg_program_spec *spec) {
    *spec = (lg_program_spec){.size = sizeof *spec};
}

lg_status lg_program_create(const lg_context *context, lg_program **out) {
    lg_program *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return LG_OUT_OF_MEMORY;
    made->context = context;
    *out = made;
    return LG_OK;
}

static void free_ports(const lg_context *context, lg_port *ports, size_t count) {
    for (size_t i = 0; ports != NULL && i < count; i++) LG_FREE_ALL(context, ports[i].name, ports[i].unit);
    lg_free(context, ports);
}

lg_status lg_ports_copy(const lg_context *context, const lg_port *ports, size_t count, lg_port **out) {
    lg_port *made = lg_alloc(context, count, sizeof *made);
    if (made == NULL) return LG_OUT_OF_MEMORY;
    bool whole = true;
    for (size_t i = 0; i < count; i++) {
        made[i] = ports[i];
        made[i].name = ports[i].name == NULL ? NULL : lg_strdup(context, ports[i].name);
        made[i].unit = ports[i].unit == NULL ? NULL : lg_strdup(context, ports[i].unit);
        whole = whole && (ports[i].name == NULL || made[i].name != NULL) &&
                (ports[i].unit == NULL || made[i].unit != NULL);
    }
    if (!whole) {
        free_ports(context, made, count);
        return LG_OUT_OF_MEMORY;
    }
    *out = made;
    return LG_OK;
}

void lg_function_destroy(const lg_context *context, lg_function *f) {
    free_ports(context, f->input, f->inputs);
    free_ports(context, f->output, f->outputs);
    LG_FREE_ALL(context, f->name, f->node, f->edges, f->reals, f->indices, f->result, f->carry, f->path);
    *f = (lg_function){.name = NULL};
}

void lg_program_destroy(lg_program *p) {
    if (p == NULL) return;
    const lg_context *context = p->context;
    for (size_t i = 0; i < p->functions; i++) lg_function_destroy(context, &p->function[i]);
    for (size_t i = 0; i < p->parameters; i++) {
        LG_FREE_ALL(context, p->parameter[i].name, p->parameter[i].values);
    }
    LG_FREE_ALL(context, p->function, p->parameter, p->description, p);
}

/* ---- adding parts ---- */

lg_status lg_program_add_parameter(lg_program *p, const lg_parameter_spec *spec, lg_error *error) {
    LG_TRY(lg_program_check_name("a parameter", spec->name, error));
    if (p->parameters == LG_PROGRAM_MAX_PARAMETERS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a program can have at most %d parameters",
                       LG_PROGRAM_MAX_PARAMETERS);
    for (size_t i = 0; i < p->parameters; i++)
        if (strcmp(p->parameter[i].name, spec->name) == 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "two parameters are called '%s'", spec->name);
    if (!lg_program_shape_is_sound(&spec->shape, LG_MAX_RANK))
        return lg_fail(error, LG_INVALID_ARGUMENT, "parameter '%s': its rank is above 4, or it is too large",
                       spec->name);
    const size_t count = lg_shape_count(spec->shape);
    for (size_t i = 0; i < count && spec->values != NULL; i++)
        if (!isfinite(spec->values[i]))
            return lg_fail(error, LG_NOT_FINITE, "parameter '%s' has a number that is not finite",
                           spec->name);
    lg_program_parameter_own *grown = lg_alloc(p->context, p->parameters + 1, sizeof *grown);
    lg_program_parameter_own made = {.name = lg_strdup(p->context, spec->name),
                                     .shape = spec->shape,
                                     .count = count,
                                     .values = lg_alloc(p->context, count, sizeof(double))};
    if (grown == NULL || made.name == NULL || made.values == NULL) {
        LG_FREE_ALL(p->context, grown, made.name, made.values);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for parameter '%s'", spec->name);
    }
    if (spec->values != NULL) memcpy(made.values, spec->values, count * sizeof(double));
    if (p->parameters > 0) memcpy(grown, p->parameter, p->parameters * sizeof *grown);
    grown[p->parameters++] = made;
    lg_free(p->context, p->parameter);
    p->parameter = grown;
    return LG_OK;
}

lg_status lg_program_take_function(lg_program *p, lg_function *f, lg_error *error) {
    size_t there;
    LG_TRY(lg_program_check_name("a function", f->name, error));
    if (lg_program_find(p, f->name, &there, NULL) == LG_OK)
        return lg_fail(error, LG_INVALID_ARGUMENT, "two functions are called '%s'", f->name);
    if (p->functions == LG_PROGRAM_MAX_FUNCTIONS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a program can have at most %d functions",
                       LG_PROGRAM_MAX_FUNCTIONS);
    LG_TRY(lg_program_check_function(p, f, error));
    if (p->functions == p->capacity) {
        const size_t capacity = p->capacity == 0 ? 8 : 2 * p->capacity;
        lg_function *grown = lg_widen(p->context, p->function, p->functions, capacity, sizeof *grown);
        if (grown == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for function '%s'", f->name);
        p->function = grown;
        p->capacity = capacity;
    }
    p->function[p->functions++] = *f;
    *f = (lg_function){.name = NULL};
    return LG_OK;
}

static size_t find_port(const lg_port *ports, size_t count, const char *name) {
    size_t i = 0;
    while (i < count && strcmp(ports[i].name, name) != 0) i++;
    return i;
}

/* Sets one entry of loop->carry. `of` is the function that the loop calls; `loop` needs its name for
 * messages. */
static lg_status add_carry(lg_function *loop, const lg_function *of, const lg_carry *carry, lg_error *error) {
    if (carry->input == NULL || carry->output == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "loop '%s': each carry needs the names of an input and of an output", loop->name);
    const size_t i = find_port(of->input, of->inputs, carry->input),
                 j = find_port(of->output, of->outputs, carry->output);
    if (i == of->inputs)
        return lg_fail(error, LG_NOT_FOUND, "function '%s' has no input '%s'", of->name, carry->input);
    if (j == of->outputs)
        return lg_fail(error, LG_NOT_FOUND, "function '%s' has no output '%s'", of->name, carry->output);
    if (loop->carry[i] != UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "loop '%s': input '%s' is carried twice", loop->name,
                       carry->input);
    loop->carry[i] = (uint32_t)j;
    return LG_OK;
}

/* Copies the outputs of the called function and adds the paths. */
static lg_status add_outputs(lg_function *loop, const lg_function *of, const lg_loop_spec *spec,
                             const lg_context *context, lg_error *error) {
    lg_port port[LG_PROGRAM_MAX_PORTS];
    char name[LG_PROGRAM_MAX_PORTS][LG_PROGRAM_MAX_NAME + 8];
    if (of->outputs + spec->path_count > LG_PROGRAM_MAX_PORTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "loop '%s' has more than %d outputs", loop->name,
                       LG_PROGRAM_MAX_PORTS);
    memcpy(port, of->output, of->outputs * sizeof *port);
    for (size_t k = 0; k < spec->path_count; k++) {
        const size_t at = of->outputs + k, j = find_port(of->output, of->outputs, spec->path[k]);
        if (j == of->outputs)
            return lg_fail(error, LG_NOT_FOUND, "function '%s' has no output '%s'", of->name, spec->path[k]);
        if (of->output[j].shape.rank == LG_MAX_RANK)
            return lg_fail(error, LG_SHAPE,
                           "loop '%s': output '%s' has the highest rank already, so it cannot have a path, "
                           "which adds an axis",
                           loop->name, spec->path[k]);
        (void)snprintf(name[at], sizeof name[at], "%s_path", spec->path[k]);
        port[at] = lg_path_port(&of->output[j], loop->times, name[at]);
        loop->path[k] = (uint32_t)j;
    }
    loop->outputs = of->outputs + spec->path_count;
    return lg_ports_copy(context, port, loop->outputs, &loop->output);
}

static lg_status make_loop(lg_program *p, const lg_function *of, const lg_loop_spec *spec, lg_function *f,
                           lg_error *error) {
    f->name = lg_strdup(p->context, spec->name);
    f->carry = lg_alloc(p->context, of->inputs, sizeof *f->carry);
    f->path = spec->path_count > 0 ? lg_alloc(p->context, spec->path_count, sizeof *f->path) : NULL;
    if (f->name == NULL || f->carry == NULL || (f->path == NULL && f->paths > 0)) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < of->inputs; i++) f->carry[i] = UINT32_MAX;
    LG_TRY(lg_ports_copy(p->context, of->input, of->inputs, &f->input));
    f->inputs = of->inputs;
    LG_TRY(add_outputs(f, of, spec, p->context, error));
    for (size_t c = 0; c < spec->carry_count; c++) LG_TRY(add_carry(f, of, &spec->carry[c], error));
    return lg_program_take_function(p, f, error);
}

static lg_status check_loop_spec(const lg_program *p, const lg_loop_spec *spec, size_t *callee,
                                 lg_error *error) {
    LG_TRY(lg_program_check_name("a function", spec->name, error));
    bool named = spec->function != NULL && (spec->carry != NULL || spec->carry_count == 0) &&
                 (spec->path != NULL || spec->path_count == 0);
    for (size_t k = 0; named && k < spec->path_count; k++) named = spec->path[k] != NULL;
    if (!named)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "loop '%s': the name of its function, its carries or its paths are NULL", spec->name);
    LG_TRY(lg_program_find(p, spec->function, callee, error));
    if (spec->times < 1 || spec->times > LG_PROGRAM_MAX_TIMES)
        return lg_fail(error, LG_INVALID_ARGUMENT, "loop '%s': times is %zu, expected 1 to %u", spec->name,
                       spec->times, LG_PROGRAM_MAX_TIMES);
    return LG_OK;
}

lg_status lg_program_add_loop(lg_program *p, const lg_loop_spec *spec, lg_error *error) {
    size_t callee = 0;
    LG_NEEDS(error, p, spec);
    if (spec->size != sizeof *spec)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the size of the loop's specification is %zu, expected %zu", spec->size, sizeof *spec);
    LG_TRY(check_loop_spec(p, spec, &callee, error));
    lg_function f = {.times = (uint32_t)spec->times, .callee = (uint32_t)callee, .paths = spec->path_count};
    lg_status status = make_loop(p, &p->function[callee], spec, &f, error);
    if (status == LG_OUT_OF_MEMORY) (void)lg_fail(error, status, "no memory for loop '%s'", spec->name);
    if (status == LG_FORMAT) {
        status = LG_INVALID_ARGUMENT;
        if (error != NULL) error->status = status;
    }
    lg_function_destroy(p->context, &f);
    return status;
}

/* ---- reading ---- */

size_t lg_program_functions(const lg_program *p) {
    return p->functions;
}

const char *lg_program_function_name(const lg_program *p, size_t function) {
    return function < p->functions ? p->function[function].name : NULL;
}

bool lg_program_is_fitted(const lg_program *p, size_t function) {
    return p != NULL && function < p->functions && p->function[function].fitted;
}

lg_status lg_program_set_fitted(lg_program *p, size_t function, bool fitted) {
    if (p == NULL || function >= p->functions) return LG_INVALID_ARGUMENT;
    p->function[function].fitted = fitted;
    return LG_OK;
}

static lg_status refuse_name(const lg_program *p, const char *name, lg_error *error) {
    lg_name_list names = {.used = 0};
    for (size_t i = 0; i < p->functions; i++) lg_name_list_add(&names, p->function[i].name);
    return lg_fail(error, LG_NOT_FOUND, "the program has no function '%.64s'; it has %s", name,
                   names.used > 0 ? names.text : "none");
}

lg_status lg_program_find(const lg_program *program, const char *name, size_t *function, lg_error *error) {
    LG_NEEDS(error, program, name, function);
    for (size_t i = 0; i < program->functions; i++)
        if (strcmp(program->function[i].name, name) == 0) {
            *function = i;
            return LG_OK;
        }
    return error == NULL ? LG_NOT_FOUND : refuse_name(program, name, error);
}

const lg_port *lg_program_inputs(const lg_program *p, size_t function, size_t *count) {
    *count = function < p->functions ? p->function[function].inputs : 0;
    return function < p->functions ? p->function[function].input : NULL;
}

const lg_port *lg_program_outputs(const lg_program *p, size_t function, size_t *count) {
    *count = function < p->functions ? p->function[function].outputs : 0;
    return function < p->functions ? p->function[function].output : NULL;
}

size_t lg_program_parameters(const lg_program *p) {
    return p->parameters;
}

lg_parameter_spec lg_program_parameter(const lg_program *p, size_t index) {
    if (index >= p->parameters) return (lg_parameter_spec){.name = NULL};
    const lg_program_parameter_own *own = &p->parameter[index];
    return (lg_parameter_spec){own->name, own->shape, own->values};
}

lg_status lg_program_set_parameter(lg_program *p, size_t index, const double *values) {
    if (p == NULL || values == NULL) return LG_INVALID_ARGUMENT;
    if (index >= p->parameters) return LG_NOT_FOUND;
    const lg_program_parameter_own *own = &p->parameter[index];
    for (size_t i = 0; i < own->count; i++)
        if (!isfinite(values[i])) return LG_NOT_FINITE;
    memcpy(own->values, values, own->count * sizeof *values);
    return LG_OK;
}

const char *lg_program_description(const lg_program *p) {
    return p->description != NULL ? p->description : "";
}

size_t lg_program_operations(const lg_program *p, size_t function) {
    size_t count = 0;
    if (function >= p->functions) return 0;
    const lg_function *f = &p->function[function];
    for (uint32_t i = 0; i < f->nodes; i++) count += f->node[i].op != &lg_op_leaf;
    return count;
}
