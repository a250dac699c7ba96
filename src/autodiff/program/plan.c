/* Plans: turn a function into steps. */
#include "autodiff/program/plan_make.h"

#include <string.h>

#include "autodiff/program/program_call.h"

/* ---- depth ---- */

static size_t bits(size_t n) {
    size_t b = 0;
    for (; n > 1; n = (n + 1) / 2) b++;
    return b;
}

/* What an operation adds to the longest chain: 1 + log2 of the terms of its longest sum, or 0 if it only
 * moves numbers. */
static size_t own_depth(const lg_graph *g, const lg_graph_node *n) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    if (lg_is_call(n->op)) return ((const lg_plan *)n->attr.pointer)->depth;
    if (n->op->terms == NULL) return 1;
    lg_graph_shapes(g, n, shapes);
    const size_t terms = n->op->terms(shapes, &n->attr, &n->shape);
    return terms > 0 ? 1 + bits(terms) : 0;
}

static lg_status find_depth(lg_planning *p) {
    size_t *depth = lg_planning_take(p, p->g.count, sizeof *depth);
    if (depth == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < p->g.count; i++) {
        const lg_graph_node *n = &p->g.node[i];
        for (uint32_t k = 0; k < n->inputs; k++)
            if (n->in[k] != LG_GRAPH_NONE && depth[n->in[k]] > depth[i]) depth[i] = depth[n->in[k]];
        if (n->sort == LG_GRAPH_OPERATION) {
            depth[i] += own_depth(&p->g, n);
            p->plan->work +=
                lg_is_call(n->op) ? ((const lg_plan *)n->attr.pointer)->work : lg_graph_work(&p->g, n);
        }
        if (depth[i] > p->plan->depth) p->plan->depth = depth[i];
    }
    return LG_OK;
}

/* ---- calls and loops ---- */

/* Makes a plan of a called function. mark_unfit is off, because the caller checks for inputs that are not
 * finite. */
static lg_status plan_callee(lg_planning *p, const lg_program *program, size_t function,
                             const lg_plan_options *options, lg_plan **out) {
    lg_plan_options inner = *options;
    inner.mark_unfit = false;
    return lg_plan_create(program, function, &inner, out, p->error);
}

/* Makes one plan for all calls of each called function. */
static lg_status plan_calls(lg_planning *p, const lg_program *program, const lg_plan_options *options) {
    lg_plan *plan = p->plan;
    for (uint32_t i = 0; i < p->g.count; i++) {
        lg_graph_node *n = &p->g.node[i];
        if (!lg_is_call(n->op)) continue;
        if (plan->callee == NULL) {
            plan->callee = lg_planning_keep(p, program->functions, sizeof *plan->callee);
            if (p->failed) return LG_OUT_OF_MEMORY;
            plan->callees = program->functions;
        }
        lg_plan **callee = &plan->callee[n->attr.i[0]];
        if (*callee == NULL) LG_TRY(plan_callee(p, program, n->attr.i[0], options, callee));
        n->attr.pointer = *callee;
    }
    return LG_OK;
}

static lg_status plan_paths(lg_planning *p, const lg_function *f, lg_call_step *step) {
    const lg_plan *callee = step->callee;
    uint32_t *path = lg_planning_keep(p, f->paths, sizeof *path);
    size_t *rows = lg_planning_keep(p, f->paths, sizeof *rows);
    lg_place *kept = lg_planning_keep(p, f->paths, sizeof *kept);
    if (p->failed) return LG_OUT_OF_MEMORY;
    for (size_t k = 0; k < f->paths; k++) {
        path[k] = f->path[k];
        rows[k] = f->output[callee->outputs + k].shared ? 1 : p->plan->rows;
        kept[k] = (lg_place){LG_AREA_WORK, 0, lg_planning_give_room(p, callee->output_count[path[k]])};
    }
    step->path = path;
    step->path_rows = rows;
    step->kept = kept;
    step->paths = f->paths;
    return LG_OK;
}

static lg_status plan_loop(lg_planning *p, const lg_program *program, const lg_function *f,
                           const lg_plan_options *options) {
    lg_plan *plan = p->plan, *callee;
    /* The callee's plan has its own memory for unwanted outputs. */
    for (size_t j = 0; j < plan->outputs; j++) plan->spill[j] = LG_NO_SPILL;
    LG_TRY(plan_callee(p, program, f->callee, options, &callee));
    lg_plan_step *step = lg_planning_new_step(p, LG_STEP_CALL);
    if (step == NULL) {
        lg_plan_destroy(callee);
        return LG_OUT_OF_MEMORY;
    }
    step->call = (lg_call_step){.callee = callee, .times = f->times};
    uint32_t *carry = lg_planning_keep(p, f->inputs, sizeof *carry);
    step->call.next = lg_planning_keep(p, f->inputs, sizeof *step->call.next);
    if (p->failed) return LG_OUT_OF_MEMORY;
    memcpy(carry, f->carry, f->inputs * sizeof *carry);
    step->call.carry = carry;
    for (size_t i = 0; i < f->inputs; i++)
        if (carry[i] != UINT32_MAX)
            step->call.next[i] = (lg_place){
                LG_AREA_WORK, 0, lg_planning_give_room(p, 2 * ((plan->input_count[i] + 15) / 16 * 16))};
    step->call.work =
        (lg_place){LG_AREA_WORK, 0,
                   lg_planning_give_room(p, (lg_plan_work_size(callee) + plan->k->size - 1) / plan->k->size)};
    if (f->paths > 0) LG_TRY(plan_paths(p, f, &step->call));
    plan->depth = callee->depth * f->times;
    plan->work = callee->work * f->times;
    return LG_OK;
}

/* ---- creation and destruction ---- */

void lg_plan_options_init(lg_plan_options *options) {
    *options = (lg_plan_options){
        .size = sizeof *options, .rows = 1, .dtype = LG_F64, .max_size = (size_t)1 << 30, .most_work = 1e13};
}

static lg_status count_ports(lg_planning *p, const lg_function *f, size_t rows) {
    lg_plan *plan = p->plan;
    const size_t length = strlen(f->name) + 1;
    char *name = lg_planning_keep(p, length, 1);
    plan->inputs = f->inputs;
    plan->outputs = f->outputs;
    plan->input_count = lg_planning_keep(p, f->inputs, sizeof *plan->input_count);
    plan->output_count = lg_planning_keep(p, f->outputs, sizeof *plan->output_count);
    plan->spill = lg_planning_keep(p, f->outputs, sizeof *plan->spill);
    if (p->failed) return LG_OUT_OF_MEMORY;
    memcpy(name, f->name, length);
    plan->name = name;
    for (size_t i = 0; i < f->inputs; i++)
        plan->input_count[i] = lg_shape_count(lg_port_shape(&f->input[i], rows));
    for (size_t j = 0; j < f->outputs; j++) {
        plan->output_count[j] = lg_shape_count(lg_port_shape(&f->output[j], rows));
    }
    return LG_OK;
}

static lg_status plan_nodes(lg_planning *p, const lg_program *program, const lg_function *f,
                            const lg_plan_options *options) {
    LG_TRY(lg_graph_make(&p->temporary, program, f, options, false, &p->g, p->error));
    p->item = lg_planning_take(p, p->g.count, sizeof *p->item);
    if (p->failed) return LG_OUT_OF_MEMORY;
    LG_TRY(plan_calls(p, program, options));
    lg_planning_find_fates(p);
    LG_TRY(lg_planning_add_steps(p));
    LG_TRY(find_depth(p));
    return lg_planning_fill_constants(p);
}

static lg_status make(lg_planning *p, const lg_program *program, const lg_function *f,
                      const lg_plan_options *options) {
    p->plan->k = lg_kernels_for(options->dtype);
    p->plan->rows = options->rows;
    p->plan->mark_unfit = options->mark_unfit;
    LG_TRY(count_ports(p, f, options->rows));
    LG_TRY(f->times > 0 ? plan_loop(p, program, f, options) : plan_nodes(p, program, f, options));
    if (p->plan->work_count * p->plan->k->size > options->max_size)
        return lg_fail(p->error, LG_OUT_OF_MEMORY,
                       "function '%s' needs %zu bytes of work memory, more than the %zu that max_size allows",
                       f->name, p->plan->work_count * p->plan->k->size, options->max_size);
    if (p->plan->work > options->most_work)
        return lg_fail(p->error, LG_UNSUPPORTED,
                       "function '%s' takes about %.2g operations, more than the %.2g that most_work allows",
                       f->name, p->plan->work, options->most_work);
    return LG_OK;
}

static lg_status choose(const lg_plan_options *options, lg_plan_options *chosen, lg_error *error) {
    lg_plan_options_init(chosen);
    if (options != NULL) {
        if (options->size != sizeof *options)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "the size of the plan's options is %zu, expected %zu: use lg_plan_options_init",
                           options->size, sizeof *options);
        *chosen = *options;
    }
    if (chosen->rows < 1 || chosen->rows > (size_t)1 << 31 ||
        (chosen->dtype != LG_F64 && chosen->dtype != LG_F32))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a plan needs rows from 1 to 2^31 and dtype LG_F64 or LG_F32");
    return LG_OK;
}

lg_status lg_plan_create(const lg_program *program, size_t function, const lg_plan_options *options,
                         lg_plan **out, lg_error *error) {
    LG_NEEDS(error, program, out);
    lg_plan_options chosen;
    lg_error ignored;
    if (error == NULL) error = &ignored;
    error->message[0] = '\0';
    LG_TRY(choose(options, &chosen, error));
    if (function >= program->functions)
        return lg_fail(error, LG_NOT_FOUND, "there is no function number %zu; the program has %zu", function,
                       program->functions);
    const lg_function *f = &program->function[function];
    const lg_context *context = program->context;
    lg_plan *plan = lg_alloc(context, 1, sizeof *plan);
    if (plan == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a plan of '%s'", f->name);
    plan->context = context;
    plan->memory = (lg_heap){.context = context, .most = chosen.max_size};
    const size_t most = chosen.max_size < SIZE_MAX / 4 ? 4 * chosen.max_size : 0;
    lg_planning p = {.plan = plan,
                     .temporary = {.context = context, .most = most},
                     .compact = chosen.compact,
                     .packed = chosen.packed,
                     .exchange = program->exchange,
                     .error = error};
    const lg_status status = make(&p, program, f, &chosen);
    lg_heap_destroy(&p.temporary);
    if (status == LG_OK) {
        *out = plan;
        return LG_OK;
    }
    lg_plan_destroy(plan);
    if (error->message[0] == '\0')
        (void)lg_fail(error, status, "function '%s' with %zu rows: %s", f->name, chosen.rows,
                      lg_status_sentence(status));
    return status;
}

void lg_plan_destroy(lg_plan *plan) {
    if (plan == NULL) return;
    for (size_t s = 0; s < plan->steps; s++)
        if (plan->step[s].kind == LG_STEP_CALL) lg_plan_destroy(plan->step[s].call.callee);
    for (size_t i = 0; i < plan->callees; i++) lg_plan_destroy(plan->callee[i]);
    lg_heap_destroy(&plan->memory);
    lg_free(plan->context, plan);
}

size_t lg_plan_work_size(const lg_plan *plan) {
    return (plan->work_count * plan->k->size + LG_ALIGNMENT) & ~(size_t)(LG_ALIGNMENT - 1);
}

size_t lg_plan_input_count(const lg_plan *plan, size_t input) {
    return input < plan->inputs ? plan->input_count[input] : 0;
}

size_t lg_plan_output_count(const lg_plan *plan, size_t output) {
    return output < plan->outputs ? plan->output_count[output] : 0;
}
