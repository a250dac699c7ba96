/* Runs plans, without allocation or locks. */
#include <math.h>
#include <string.h>

#include "autodiff/program/plan.h"

typedef struct running {
    const lg_plan *plan;
    const lg_kernels *k;
    const void *const *inputs;
    void *const *outputs;
    unsigned char *work;
} running;

static void *at_output(const running *r, const lg_place *p) {
    unsigned char *base = r->outputs[p->number];
    if (base == NULL) base = r->work + r->plan->spill[p->number] * r->k->size;
    return base + p->offset * r->k->size;
}

/* Address of a place to be written. */
static void *to(const running *r, const lg_place *p) {
    if (p->area == LG_AREA_WORK) return r->work + p->offset * r->k->size;
    return p->area == LG_AREA_OUTPUT ? at_output(r, p) : NULL;
}

/* Address of a place to be read. */
static const void *from(const running *r, const lg_place *p) {
    const size_t bytes = p->offset * r->k->size;
    switch (p->area) {
    case LG_AREA_WORK:
        return r->work + bytes;
    case LG_AREA_CONSTANTS:
        return (const unsigned char *)r->plan->constants + bytes;
    case LG_AREA_INPUT:
        return (const unsigned char *)r->inputs[p->number] + bytes;
    case LG_AREA_OUTPUT:
        return at_output(r, p);
    case LG_AREA_NONE:
        break;
    }
    return NULL;
}

/* Whether a step that writes y computes nothing but an output that the caller does not want. */
static bool is_left_out(const running *r, const lg_place *y) {
    return y->area == LG_AREA_OUTPUT && r->outputs[y->number] == NULL &&
           r->plan->spill[y->number] == LG_NO_SPILL;
}

static void run_tensor(const running *r, const lg_tensor_step *s) {
    const void *x[LG_MAX_INPUTS];
    if (is_left_out(r, &s->y)) return;
    for (uint32_t k = 0; k < s->inputs; k++) x[k] = from(r, &s->x[k]);
    /* Every member is listed, so that the compiler need not clear the struct: that would take longer than
     * many an operation. */
    lg_evaluation e = {.k = r->k,
                       .crew = NULL,
                       .attr = &s->attr,
                       .inputs = s->inputs,
                       .in = s->shapes,
                       .x = x,
                       .transposed = from(r, &s->transposed),
                       .shape = &s->shape,
                       .count = s->count,
                       .y = to(r, &s->y),
                       .kept = NULL,
                       .scratch = to(r, &s->scratch)};
    (void)s->op->forward(&e);
}

static void run_dense(const running *r, const lg_dense_step *s) {
    void *y = to(r, &s->y);
    r->k->gemm(s->m, s->n, s->k, from(r, &s->x), s->k, 1, from(r, &s->w), s->n, y, s->n, false);
    r->k->bias_act((lg_k_act)s->kind, s->m, s->n, from(r, &s->b), y);
}

static void store(size_t size, uint32_t count, const uint32_t *registers, const void *values, void *y) {
    if (size == sizeof(double)) {
        const double *x = values;
        double *out = y;
        for (uint32_t i = 0; i < count; i++) out[i] = x[registers[i]];
    } else {
        const float *x = values;
        float *out = y;
        for (uint32_t i = 0; i < count; i++) out[i] = x[registers[i]];
    }
}

static void load(size_t size, uint32_t count, const void *x, void *y) {
    if (size == sizeof(double))
        for (uint32_t i = 0; i < count; i++) ((double *)y)[i] = ((const double *)x)[i];
    else
        for (uint32_t i = 0; i < count; i++) ((float *)y)[i] = ((const float *)x)[i];
}

static size_t rows_at(const lg_scalar_step *s, size_t first) {
    return s->rows - first < LG_K_ROWS ? s->rows - first : LG_K_ROWS;
}

/* Runs scalar code for blocks of LG_K_ROWS rows. Loads constants and inputs without rows for the first block
 * only, because later blocks use the same values. */
static void run_rows(const running *r, const lg_scalar_step *s) {
    const lg_kernels *k = r->k;
    const size_t size = k->size;
    unsigned char *registers = to(r, &s->registers);
    k->load_rows(rows_at(s, 0), s->constants, 0, s->constant, registers);
    for (size_t first = 0; first < s->rows; first += LG_K_ROWS) {
        const size_t n = rows_at(s, first);
        for (uint32_t i = 0; i < s->ins; i++) {
            const lg_scalar_range *in = &s->in[i];
            if (in->apart == 0 && first > 0) continue;
            k->load_rows(n, in->count, in->apart,
                         (const unsigned char *)from(r, &in->place) + first * in->apart * size,
                         registers + in->first * LG_K_ROWS * size);
        }
        k->row_scalars(n, s->groups, s->group, s->operands, registers);
        for (uint32_t i = 0; i < s->outs; i++) {
            const lg_scalar_range *out = &s->out[i];
            if (out->apart == 0 && first > 0) continue;
            k->store_rows(out->apart == 0 ? 1 : n, out->count, s->stored + out->first, out->apart, registers,
                          (unsigned char *)to(r, &out->place) + first * out->apart * size);
        }
    }
}

static void run_scalars(const running *r, const lg_scalar_step *s) {
    const size_t size = r->k->size;
    unsigned char *registers = to(r, &s->registers);
    if (s->rows > 1) {
        run_rows(r, s);
        return;
    }
    load(size, s->constants, s->constant, registers);
    for (uint32_t i = 0; i < s->ins; i++)
        load(size, s->in[i].count, from(r, &s->in[i].place), registers + s->in[i].first * size);
    r->k->scalars(s->groups, s->group, s->operands, registers);
    for (uint32_t i = 0; i < s->outs; i++)
        store(size, s->out[i].count, s->stored + s->out[i].first, registers, to(r, &s->out[i].place));
}

/* Copies the output of call n, `value`, to entry n of path k. */
static void put_path(const running *r, const lg_call_step *s, size_t k, uint32_t n, const void *value) {
    const size_t rows = s->path_rows[k], bytes = s->callee->output_count[s->path[k]] / rows * r->k->size;
    const unsigned char *from_row = value;
    unsigned char *to_row = r->outputs[s->callee->outputs + k];
    for (size_t b = 0; b < rows; b++)
        memcpy(to_row + (b * s->times + n) * bytes, from_row + b * bytes, bytes);
}

static bool wants_path(const running *r, const lg_call_step *s, size_t k) {
    return r->outputs[s->callee->outputs + k] != NULL;
}

/* Runs a loop. Values that are carried from run to run alternate between the two halves of their memory; the
 * last run writes to the caller's outputs. */
static void run_call(const running *r, const lg_call_step *s) {
    const void *in[LG_PROGRAM_MAX_PORTS];
    void *out[LG_PROGRAM_MAX_PORTS], *work = to(r, &s->work);
    const lg_plan *callee = s->callee;
    for (size_t i = 0; i < callee->inputs; i++) in[i] = r->inputs[i];
    for (uint32_t n = 0; n < s->times; n++) {
        const bool last = n + 1 == s->times;
        for (size_t j = 0; j < callee->outputs; j++) out[j] = last ? r->outputs[j] : NULL;
        for (size_t i = 0; !last && i < callee->inputs; i++) {
            if (s->carry[i] == UINT32_MAX || out[s->carry[i]] != NULL) continue;
            lg_place next = s->next[i];
            if (n % 2 == 1) next.offset += (callee->input_count[i] + 15) / 16 * 16;
            out[s->carry[i]] = to(r, &next);
        }
        for (size_t k = 0; k < s->paths; k++)
            if (wants_path(r, s, k) && out[s->path[k]] == NULL) out[s->path[k]] = to(r, &s->kept[k]);
        lg_plan_eval(callee, in, out, work);
        for (size_t k = 0; k < s->paths; k++)
            if (wants_path(r, s, k)) put_path(r, s, k, n, out[s->path[k]]);
        for (size_t i = 0; !last && i < callee->inputs; i++)
            if (s->carry[i] != UINT32_MAX) in[i] = out[s->carry[i]];
    }
}

static void run_copy(const running *r, const lg_copy_step *s) {
    if (is_left_out(r, &s->y)) return;
    memcpy(to(r, &s->y), from(r, &s->x), s->count * r->k->size);
}

static bool all_finite(const running *r) {
    for (size_t i = 0; i < r->plan->inputs; i++)
        if (!r->k->all_finite(r->plan->input_count[i], r->inputs[i])) return false;
    return true;
}

void lg_plan_eval(const lg_plan *plan, const void *const *inputs, void *const *outputs, void *work) {
    const running r = {plan, plan->k, inputs, outputs, work};
    for (size_t i = 0; i < plan->steps; i++) {
        const lg_plan_step *s = &plan->step[i];
        switch (s->kind) {
        case LG_STEP_TENSOR:
            run_tensor(&r, &s->tensor);
            break;
        case LG_STEP_DENSE:
            run_dense(&r, &s->dense);
            break;
        case LG_STEP_SCALARS:
            run_scalars(&r, &s->scalars);
            break;
        case LG_STEP_COPY:
            run_copy(&r, &s->copy);
            break;
        case LG_STEP_CALL:
            run_call(&r, &s->call);
            break;
        }
    }
    if (plan->mark_unfit && !all_finite(&r))
        for (size_t j = 0; j < plan->outputs; j++)
            if (outputs[j] != NULL) plan->k->fill(plan->output_count[j], NAN, outputs[j]);
}

lg_status lg_program_plan(const lg_program *program, const char *function, lg_dtype dtype, size_t rows,
                          lg_plan **out, lg_error *error) {
    lg_plan_options options;
    size_t number;
    LG_TRY(lg_program_find(program, function, &number, error));
    lg_plan_options_init(&options);
    options.rows = rows, options.dtype = dtype;
    return lg_plan_create(program, number, &options, out, error);
}

lg_status lg_program_eval(const lg_context *context, const lg_program *program, const char *function,
                          size_t rows, const double *const *inputs, double *const *outputs, lg_error *error) {
    lg_plan *plan = NULL;
    LG_NEEDS(error, program, function, inputs, outputs);
    LG_TRY(lg_program_plan(program, function, LG_F64, rows, &plan, error));
    void *work = lg_alloc(context, lg_plan_work_size(plan), 1);
    if (work != NULL) lg_plan_eval(plan, (const void *const *)inputs, (void *const *)outputs, work);
    lg_free(context, work);
    lg_plan_destroy(plan);
    return work != NULL ? LG_OK : lg_fail(error, LG_OUT_OF_MEMORY, "no memory to run '%s'", function);
}
