/* Programs as C, bodies of functions: the steps of a plan as statements. */
#include "autodiff/program/program_c.h"

#include <limits.h>
#include <stdio.h>

/* ---- steps ---- */

static bool fits_int(lg_c *c, size_t count, const char *what) {
    if (count <= INT_MAX) return true;
    return lg_c_fail(c, LG_UNSUPPORTED, "function '%s': %s has more numbers than an int can count in C",
                     c->frame->plan->name, what);
}

static void write_tensor(lg_c *c, const lg_tensor_step *s) {
    const lg_op *op = s->op;
    const lg_evaluation e = {.k = c->frame->plan->k,
                             .attr = &s->attr,
                             .inputs = s->inputs,
                             .in = s->shapes,
                             .shape = &s->shape,
                             .count = s->count};
    c->step = s;
    lg_c_use(c, s->y, s->count);
    if (!fits_int(c, s->count, op->name)) return;
    if (s->count == 0) return;
    if (op->write_c != NULL)
        op->write_c(c, &e);
    else if (op->element != NULL)
        lg_c_elementwise(c, op, &e);
    else
        (void)lg_c_fail(c, LG_UNSUPPORTED, "function '%s': the operation %s cannot be written in C",
                        c->frame->plan->name, op->name);
}

static void write_dense(lg_c *c, const lg_dense_step *s) {
    const lg_attr kind = {.i = {(uint32_t)s->kind}};
    const lg_place places[3] = {s->x, s->w, s->b};
    const lg_tensor_step step = {.inputs = 3, .x = (lg_place *)places, .y = s->y};
    c->step = &step;
    lg_c_use(c, s->y, s->m * s->n);
    if (!fits_int(c, s->m * s->n, "a layer") || !fits_int(c, s->k * s->n, "a layer")) return;
    lg_c_call(c, "dense_rows(%zu, %zu, %zu, $0, $1, %s, $y)", s->m, s->n, s->k,
              s->b.area == LG_AREA_NONE ? "NULL" : "$2");
    if (s->kind != LG_IDENTITY)
        lg_c_call(c, "%s(%zu, $y)", lg_c_map(c, &lg_op_act, &kind, 1, 1), s->m * s->n);
    c->step = NULL;
}

static void write_copy(lg_c *c, const lg_copy_step *s) {
    lg_place places[1] = {s->x};
    const lg_tensor_step step = {.inputs = 1, .x = places, .y = s->y};
    c->step = &step;
    lg_c_use(c, s->y, s->count);
    if (fits_int(c, s->count, "an output")) lg_c_call(c, "copy(%zu, $0, $y)", s->count);
    c->step = NULL;
}

/* The first input that output j is carried into, or callee->inputs if there is none. */
static size_t carried_to(const lg_call_step *s, size_t j) {
    size_t i = 0;
    while (i < s->callee->inputs && s->carry[i] != j) i++;
    return i;
}

/* The first path of output j, or `paths` if it has none. */
static size_t path_of(const lg_call_step *s, size_t j) {
    size_t k = 0;
    while (k < s->paths && s->path[k] != j) k++;
    return k;
}

/* An input of call i. An output that is carried into several inputs is stored in the memory of the first of
 * them. */
static void add_loop_input(lg_c *c, const lg_call_step *s, size_t i) {
    lg_text *body = &c->frame->body;
    if (s->carry[i] == UINT32_MAX) {
        lg_text_add(body, "x%zu", i);
        return;
    }
    const size_t first = carried_to(s, s->carry[i]), half = s->callee->input_count[first];
    lg_text_add(body, "i == 0 ? x%zu : work + (%zu + i %% 2 * %zu)", i, s->next[first].offset, half);
    lg_c_use(c, s->next[first], 2 * half);
}

/* Where call i puts output j. The last call puts it into the caller's output, unless the caller does not want
 * it and a path needs it. */
static void add_loop_output(lg_c *c, const lg_call_step *s, size_t j) {
    lg_text *body = &c->frame->body;
    const size_t to = carried_to(s, j), k = path_of(s, j);
    lg_text_add(body, k < s->paths ? "i == %u && y%zu != NULL ? y%zu : " : "i == %u ? y%zu : ", s->times - 1,
                j, j);
    if (to < s->callee->inputs)
        lg_text_add(body, "work + (%zu + (i + 1) %% 2 * %zu)", s->next[to].offset,
                    s->callee->input_count[to]);
    else if (k < s->paths)
        lg_text_add(body, "work + %zu", s->kept[k].offset);
    else
        lg_text_add(body, "NULL");
    if (k < s->paths) lg_c_use(c, s->kept[k], s->callee->output_count[j]);
}

/* Copies output path[k] of call i to its entry of the path, where the caller wants the path. */
static void add_loop_path(lg_c *c, const lg_call_step *s, size_t k) {
    lg_text *body = &c->frame->body;
    const size_t j = s->path[k], y = s->callee->outputs + k, count = s->callee->output_count[j];
    if (!fits_int(c, count * s->times, "a path")) return;
    lg_c_need(c, "copy");
    lg_text_add(body, "        copy(%zu, ", count);
    add_loop_output(c, s, j);
    lg_text_add(body, ", y%zu == NULL ? NULL : y%zu + i * %zu);\n", y, y, count);
}

/* Writes a loop. In call i, a carried input is read from the caller's input (i = 0) or from half i % 2 of its
 * memory, and its next value is written to half (i + 1) % 2. */
static void write_call(lg_c *c, const lg_call_step *s) {
    const lg_plan *callee = s->callee;
    size_t work = 0;
    lg_c_frame *own = c->frame;
    const char *name = lg_c_write_plan(c, callee, "static ", NULL, &work);
    c->frame = own;
    if (name == NULL) return;
    lg_text *body = &own->body;
    lg_text_add(body, "    for (int i = 0; i < %u; i++) {\n        %s(", s->times, name);
    for (size_t i = 0; i < callee->inputs; i++) {
        add_loop_input(c, s, i);
        lg_text_add(body, ", ");
    }
    for (size_t j = 0; j < callee->outputs; j++) {
        add_loop_output(c, s, j);
        lg_text_add(body, ", ");
    }
    lg_text_add(body, "work + %zu);\n", s->work.offset);
    for (size_t k = 0; k < s->paths; k++) add_loop_path(c, s, k);
    lg_text_add(body, "    }\n");
    lg_c_use(c, s->work, work);
}

/* Writes a step. One that computes nothing but an output depends on whether the caller wants it; the copy of
 * a whole output finds out itself. */
static void write_wanted(lg_c *c, const lg_plan *plan, const lg_plan_step *s) {
    const bool copy = s->kind == LG_STEP_COPY;
    const lg_place y = copy ? s->copy.y : s->tensor.y;
    const bool tests =
        y.area == LG_AREA_OUTPUT && plan->spill[y.number] == LG_NO_SPILL && !(copy && y.offset == 0);
    if (tests) lg_text_add(&c->frame->body, "    if (y%u != NULL) {\n", y.number);
    if (copy)
        write_copy(c, &s->copy);
    else
        write_tensor(c, &s->tensor);
    if (tests) lg_text_add(&c->frame->body, "    }\n");
}

static void write_steps(lg_c *c, const lg_plan *plan) {
    for (size_t i = 0; i < plan->steps && lg_c_good(c); i++) {
        const lg_plan_step *s = &plan->step[i];
        switch (s->kind) {
        case LG_STEP_TENSOR:
        case LG_STEP_COPY:
            write_wanted(c, plan, s);
            break;
        case LG_STEP_DENSE:
            write_dense(c, &s->dense);
            break;
        case LG_STEP_SCALARS:
            lg_c_scalars(c, &s->scalars);
            break;
        case LG_STEP_CALL:
            write_call(c, &s->call);
            break;
        }
    }
}

/* ---- functions ---- */

/* Writes the first statements of a function: unused arguments are marked, and outputs that the caller does
 * not want get their place in the work memory. In a loop, the callee does the latter. */
static void add_head(const lg_plan *plan, const char *body, lg_text *to, lg_c *c) {
    char word[32];
    for (size_t i = 0; i < plan->inputs; i++) {
        (void)snprintf(word, sizeof word, "x%zu", i);
        if (!lg_c_uses(body, word)) lg_text_add(to, "    (void)%s;\n", word);
    }
    for (size_t j = 0; j < plan->outputs; j++) {
        const lg_place spill = {LG_AREA_WORK, 0, plan->spill[j]};
        if (plan->output_count[j] == 0 || plan->spill[j] == LG_NO_SPILL) continue;
        lg_text_add(to, "    if (y%zu == NULL) y%zu = ", j, j);
        lg_c_add_place(c, to, spill);
        lg_text_add(to, ";\n");
        lg_c_use(c, spill, plan->output_count[j]);
    }
}

/* Writes calls that set outputs to NaN if an input is not finite. `placed`: outputs that the caller does not
 * want have a place in the work memory, so they need no test for NULL. */
static void add_marks(lg_c *c, const lg_plan *plan, bool placed) {
    if (!plan->mark_unfit) return;
    lg_c_need(c, "mark_unfit");
    for (size_t i = 0; i < plan->inputs; i++)
        for (size_t j = 0; j < plan->outputs; j++) {
            if (!placed || plan->spill[j] == LG_NO_SPILL)
                lg_text_add(&c->frame->body, "    if (y%zu != NULL)\n    ", j);
            lg_text_add(&c->frame->body, "    mark_unfit(%zu, x%zu, %zu, y%zu);\n", plan->input_count[i], i,
                        plan->output_count[j], j);
        }
}

/* Writes the whole function: "void @(const real *x0, ..., real *y0, ..., real *work) {", `head` and
 * `body`. */
static void add_whole(lg_text *to, const lg_plan *plan, const char *storage, const lg_text *head,
                      const lg_text *body) {
    lg_text_add(to, "%svoid @(", storage);
    for (size_t i = 0; i < plan->inputs; i++) lg_text_add(to, "const real *x%zu, ", i);
    for (size_t j = 0; j < plan->outputs; j++) lg_text_add(to, "real *y%zu, ", j);
    lg_text_add(to, "real *work) {\n");
    lg_text_join(to, head);
    lg_text_join(to, body);
    lg_text_add(to, "}\n");
}

/* A function with a given name is always written. Without a name, an existing function with the same text is
 * used. */
static const char *define_whole(lg_c *c, const lg_plan *plan, const lg_text *text, const char *name) {
    if (name == NULL) return lg_c_define(c, plan->name, text->data);
    lg_text_add(&c->code, "\n");
    lg_c_add_definition(&c->code, text->data, name);
    return name;
}

static const char *write_body(lg_c *c, const lg_plan *plan, const char *storage, const char *name, bool marks,
                              size_t *work) {
    lg_c_frame frame = {.plan = plan, .body = {.context = c->context}};
    lg_text text = {.context = c->context}, head = {.context = c->context};
    c->frame = &frame;
    if (++c->nesting > c->most_nesting) c->most_nesting = c->nesting;
    lg_c_collect_constants(c, plan);
    write_steps(c, plan);
    if (marks) add_marks(c, plan, true);
    add_head(plan, frame.body.data != NULL ? frame.body.data : "", &head, c);
    if (frame.work == 0) lg_text_add(&head, "    (void)work;\n");
    add_whole(&text, plan, storage, &head, &frame.body);
    name = lg_c_takes(c, &text) ? define_whole(c, plan, &text, name) : NULL;
    *work = frame.work;
    c->frame = NULL;
    c->nesting--;
    lg_text_destroy(&text);
    lg_text_destroy(&head);
    lg_text_destroy(&frame.body);
    lg_free(c->context, frame.range);
    return name;
}

const char *lg_c_write_plan(lg_c *c, const lg_plan *plan, const char *storage, const char *name,
                            size_t *work) {
    return write_body(c, plan, storage, name, plan->mark_unfit, work);
}

void lg_c_write_shared(lg_c *c, const lg_plan *plan, const char *storage, const char *name, size_t *work) {
    lg_c_frame frame = {.plan = plan, .body = {.context = c->context}};
    lg_text text = {.context = c->context};
    const lg_text nothing = {.data = NULL};
    c->nesting++; /* counts the function that calls the body */
    const char *body = write_body(c, plan, "static ", NULL, false, work);
    c->nesting--;
    if (body == NULL) return;
    c->frame = &frame;
    lg_text_add(&frame.body, "    %s(", body);
    for (size_t i = 0; i < plan->inputs; i++) lg_text_add(&frame.body, "x%zu, ", i);
    for (size_t j = 0; j < plan->outputs; j++) lg_text_add(&frame.body, "y%zu, ", j);
    lg_text_add(&frame.body, "work);\n");
    add_marks(c, plan, false);
    add_whole(&text, plan, storage, &nothing, &frame.body);
    if (lg_c_takes(c, &text)) (void)define_whole(c, plan, &text, name);
    c->frame = NULL;
    lg_text_destroy(&text);
    lg_text_destroy(&frame.body);
}
