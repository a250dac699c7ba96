#include "autodiff/program/program_call.h"

#include <stdio.h>

#include "autodiff/program/plan.h"
#include "autodiff/program/program_c.h"
#include "core/widen.h"

/* ---- the operation as it is used in plans ---- */

/* The output has the shape of the called function's output; lg_program_take_function checks this. */
static lg_status shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    return LG_OK;
}

static lg_status forward(lg_evaluation *e) {
    void *outputs[LG_PROGRAM_MAX_PORTS] = {NULL};
    outputs[e->attr->i[1]] = e->y;
    lg_plan_eval(e->attr->pointer, e->x, outputs, e->scratch);
    return LG_OK;
}

static size_t scratch(const lg_evaluation *e) {
    return lg_plan_work_size(e->attr->pointer);
}

/* Writes a call such as "name($0, $1, NULL, $y, $s)". */
static void write_c(lg_c *c, const lg_evaluation *e) {
    lg_text call = {.context = c->context};
    const lg_tensor_step *step = c->step;
    lg_c_frame *frame = c->frame;
    size_t work = 0;
    const lg_plan *plan = e->attr->pointer;
    const char *name = lg_c_write_plan(c, plan, "static ", NULL, &work);
    c->frame = frame;
    c->step = step;
    if (name == NULL) return;
    lg_text_add(&call, "%s(", name);
    for (uint32_t i = 0; i < e->inputs; i++) lg_text_add(&call, "$%u, ", i);
    for (size_t j = 0; j < plan->outputs; j++) lg_text_add(&call, j == e->attr->i[1] ? "$y, " : "NULL, ");
    lg_text_add(&call, "$s)");
    lg_c_scratch(c, work);
    if (lg_c_takes(c, &call)) lg_c_call(c, "%s", call.data);
    lg_text_destroy(&call);
}

const lg_op lg_op_call = {LG_OP("call", ~0u, 1, LG_MAX_INPUTS, shape, forward, lg_no_vjp, lg_zero_jvp),
                          .given = true, .calls = true, .scratch = scratch, .write_c = write_c};

size_t lg_program_calls(const lg_program *program, size_t function, size_t callee) {
    size_t calls = 0;
    if (function >= program->functions) return 0;
    const lg_function *f = &program->function[function];
    for (uint32_t i = 0; i < f->nodes; i++)
        calls += lg_is_call(f->node[i].op) && lg_called(&f->node[i]) == callee;
    return calls;
}

/* ---- marks of calls during a recording ---- */

void lg_calls_destroy(lg_calls *calls) {
    if (calls->program != NULL) lg_free(calls->program->context, calls->mark);
    *calls = (lg_calls){.program = NULL};
}

const lg_call_mark *lg_calls_find(const lg_calls *calls, uint32_t node) {
    for (size_t i = 0; i < calls->count; i++)
        if (calls->mark[i].result == node) return &calls->mark[i];
    return NULL;
}

static lg_call_mark *new_mark(lg_calls *calls) {
    if (calls->count == calls->capacity) {
        const size_t capacity = calls->capacity == 0 ? 8 : 2 * calls->capacity;
        lg_call_mark *grown =
            lg_widen(calls->program->context, calls->mark, calls->count, capacity, sizeof *grown);
        if (grown == NULL) return NULL;
        calls->mark = grown;
        calls->capacity = capacity;
    }
    return &calls->mark[calls->count++];
}

lg_var lg_program_call(lg_tape *tape, const char *function, size_t output, const lg_var *inputs) {
    lg_calls *calls = tape->calls;
    lg_var outputs[LG_PROGRAM_MAX_PORTS];
    size_t number;
    if (tape->status != LG_OK) return LG_NONE;
    if (calls == NULL)
        return lg_tape_fail(tape, LG_NOT_FOUND, "call",
                            "lg_program_call works only while a function of a program is recorded");
    lg_error error = {LG_OK, ""};
    if (lg_program_find(calls->program, function, &number, &error) != LG_OK)
        return lg_tape_fail(tape, LG_NOT_FOUND, "call", error.message);
    if (calls->program->function[number].outputs <= output) {
        char reason[160];
        (void)snprintf(reason, sizeof reason, "'%.64s' has no output number %zu; it has %zu outputs",
                       function, output, calls->program->function[number].outputs);
        return lg_tape_fail(tape, LG_NOT_FOUND, "call", reason);
    }
    const uint32_t before = tape->count;
    if (lg_program_record(tape, calls->program, number, calls->parameters, inputs, outputs) != LG_OK)
        return LG_NONE;
    const lg_var out = outputs[output];
    if (out.index < before) return out; /* the output is one of the inputs, so there is no call */
    lg_call_mark *mark = new_mark(calls);
    if (mark == NULL) return lg_tape_fail(tape, LG_OUT_OF_MEMORY, "call", "no memory");
    *mark = (lg_call_mark){.result = out.index, .function = (uint32_t)number, .output = (uint32_t)output};
    for (size_t i = 0; i < calls->program->function[number].inputs; i++) mark->input[i] = inputs[i].index;
    return out;
}
