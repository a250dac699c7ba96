/* Writes a step of scalar code as C: straight-line code with local variables, in static functions of limited
 * size. */
#include <stdio.h>

#include "autodiff/program/program_c_lines.h"
#include "core/numbers.h"

/* Writes element i of a range as C, such as x0[12]. */
static void add_element(const lg_c *c, lg_text *to, const lg_scalar_range *range, uint32_t i) {
    const lg_place *at = &range->place;
    if (at->area == LG_AREA_CONSTANTS) {
        lg_text_add(to, "%s_weights[%zu]", c->name, lg_c_constant_at(c, at->offset + i));
        return;
    }
    lg_text_add(to, "%s", at->area == LG_AREA_INPUT ? "x" : at->area == LG_AREA_OUTPUT ? "y" : "work");
    if (at->area != LG_AREA_WORK) lg_text_add(to, "%u", at->number);
    lg_text_add(to, "[%zu]", at->offset + i);
}

/* Finds the range that contains a register or stored entry; ranges are sorted by `first`. */
static const lg_scalar_range *range_of(const lg_scalar_range *range, uint32_t count, uint32_t number) {
    uint32_t low = 0, high = count;
    while (high - low > 1) {
        const uint32_t middle = (low + high) / 2;
        if (range[middle].first <= number)
            low = middle;
        else
            high = middle;
    }
    return &range[low];
}

static void step_input(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    const lg_scalar_step *step = user;
    const lg_scalar_range *range = range_of(step->in, step->ins, number);
    add_element(c, to, range, number - range->first);
}

static void step_output(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    const lg_scalar_step *step = user;
    const lg_scalar_range *range = range_of(step->out, step->outs, number);
    add_element(c, to, range, number - range->first);
}

static void add_argument(lg_text *parameters, lg_text *arguments, const char *type, const char *name) {
    lg_text_add(parameters, "%s%s%s", parameters->length > 0 ? ", " : "", type, name);
    lg_text_add(arguments, "%s%s", arguments->length > 0 ? ", " : "", name);
}

/* Defines the C function of a block, and adds a call of it to the body. */
static void define_block(lg_c *c, const lg_text *lines) {
    const lg_plan *plan = c->frame->plan;
    lg_text parameters = {.context = c->context}, arguments = {.context = c->context};
    lg_text text = {.context = c->context};
    char word[32];
    const char *body = lines->data != NULL ? lines->data : "";
    for (size_t i = 0; i < plan->inputs + plan->outputs; i++) {
        const bool in = i < plan->inputs;
        (void)snprintf(word, sizeof word, in ? "x%zu" : "y%zu", in ? i : i - plan->inputs);
        if (lg_c_uses(body, word))
            add_argument(&parameters, &arguments, in ? "const real *" : "real *", word);
    }
    if (lg_c_uses(body, "work")) add_argument(&parameters, &arguments, "real *", "work");
    if (parameters.length == 0) lg_text_add(&parameters, "void");
    lg_text_add(&text, "static NOINLINE void @(");
    lg_text_join(&text, &parameters);
    lg_text_add(&text, ") {\n");
    lg_text_join(&text, lines);
    lg_text_add(&text, "}\n");
    const char *name = lg_c_takes(c, &text) ? lg_c_define(c, "scalars", text.data) : NULL;
    lg_c_largest(c, lg_c_frame_of(lines));
    if (name != NULL) {
        lg_text_add(&c->frame->body, "    %s(", name);
        lg_text_join(&c->frame->body, &arguments);
        lg_text_add(&c->frame->body, ");\n");
    }
    lg_text_destroy(&parameters);
    lg_text_destroy(&arguments);
    lg_text_destroy(&text);
}

static void add_group(const lg_plan *plan, const lg_scalar_step *step, const lg_scalar_group *group,
                      lg_scalar_code *code) {
    const uint32_t *operand = step->operands + group->operands;
    const uint8_t count = lg_scalar_instructions((lg_scalar_op)group->op);
    for (uint32_t i = 0; i < group->count; i++) {
        lg_scalar_code *made = &code[group->result + i];
        *made = (lg_scalar_code){.op = (lg_scalar_op)group->op};
        for (uint8_t k = 0; k < count; k++) made->in[k] = *operand++;
        if (made->op == LG_S_POW) made->p = lg_number_at(plan->k->dtype, step->constant, *operand++);
        if (made->op == LG_S_STUMPFF || made->op == LG_S_DEXPINV) made->n = *operand++;
    }
}

/* Turns the registers of a step into instructions: constants, inputs (numbered by their register) and
 * results. */
static lg_scalar_code *registers_of(lg_c *c, const lg_scalar_step *step) {
    const uint32_t first = step->constants + step->loads;
    const lg_plan *plan = c->frame->plan;
    lg_scalar_code *code = lg_alloc(c->context, (size_t)first + step->instructions, sizeof *code);
    for (uint32_t i = 0; code != NULL && i < step->constants; i++)
        code[i] = (lg_scalar_code){.op = LG_S_CONSTANT, .p = lg_number_at(plan->k->dtype, step->constant, i)};
    for (uint32_t i = step->constants; code != NULL && i < first; i++)
        code[i] = (lg_scalar_code){.op = LG_S_INPUT, .n = i};
    for (uint32_t i = 0; code != NULL && i < step->groups; i++) add_group(plan, step, &step->group[i], code);
    return code;
}

static void use_ranges(lg_c *c, const lg_scalar_range *range, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) lg_c_use(c, range[i].place, range[i].count);
}

void lg_c_scalars(lg_c *c, const lg_scalar_step *step) {
    const lg_c_ends e = {step, step_input, step_output};
    const uint32_t all = step->constants + step->loads + step->instructions;
    const uint32_t roots =
        step->outs == 0 ? 0 : step->out[step->outs - 1].first + step->out[step->outs - 1].count;
    lg_scalar_code *code = registers_of(c, step);
    lg_c_graph g = {.c = c};
    if (code == NULL) {
        (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
        return;
    }
    use_ranges(c, step->in, step->ins);
    use_ranges(c, step->out, step->outs);
    if (lg_c_graph_open(&g, c, code, all, step->stored, roots)) {
        for (uint32_t b = 0; b < lg_c_graph_blocks(&g) && lg_c_good(c); b++) {
            lg_text lines = {.context = c->context};
            lg_c_graph_lines(&g, &lines, "    ", &e, b, step->registers.offset);
            define_block(c, &lines);
            lg_text_destroy(&lines);
        }
        lg_c_use(c, step->registers, g.slots);
    }
    lg_c_graph_close(&g);
    lg_free(c->context, code);
}
