/* Interval evaluation of programs, without allocation or locks. */
#include "certify/interval.h"

#include <float.h>
#include <math.h>
#include <string.h>

void lg_interval_options_init(lg_interval_options *options) {
    if (options != NULL) *options = (lg_interval_options){.size = sizeof *options};
}

/* `what`: Taylor coefficients of the motion with `states` states, whose rate is the function; or NULL */
static lg_status create(const lg_program *program, const size_t *functions, size_t count,
                        const lg_interval_taylor_spec *what, size_t states,
                        const lg_interval_options *options, lg_interval **out, lg_error *error) {
    LG_CLEAN(lg_expansion_destroy) lg_expansion expansion = {.results = 0};
    if (count == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "there are no functions to evaluate");
    if (options != NULL && options->size != sizeof *options)
        return lg_fail(error, LG_INVALID_ARGUMENT, "lg_interval_options.size is not the size of the struct");
    LG_CLEAN(lg_interval_destroy_at) lg_interval *made = lg_alloc(program->context, 1, sizeof *made);
    if (made == NULL) return lg_no_memory(error);
    made->context = program->context;
    made->run = lg_interval_kernel(lg_isa_in_use());
    lg_status status = lg_expand(program, functions, count, &expansion, error);
    if (status == LG_OK && what != NULL) status = lg_expansion_taylor(&expansion, states, what, error);
    if (status == LG_OK) {
        made->inputs = expansion.inputs;
        made->outputs = expansion.results;
        made->functions = count;
        made->parity = lg_alloc(made->context, expansion.results, sizeof *made->parity);
        status = made->parity != NULL ? lg_expansion_parity(&expansion, made->parity) : LG_OUT_OF_MEMORY;
    }
    if (status == LG_OK) status = lg_interval_choose(&expansion, options != NULL && options->widen, made);
    if (status == LG_OUT_OF_MEMORY) return lg_no_memory(error);
    return status == LG_OK ? LG_MOVE(out, made) : status;
}

lg_status lg_interval_create(const lg_program *program, const size_t *functions, size_t count,
                             const lg_interval_options *options, lg_interval **out, lg_error *error) {
    LG_NEEDS(error, program, functions, out);
    return create(program, functions, count, NULL, 0, options, out, error);
}

void lg_interval_taylor_spec_init(lg_interval_taylor_spec *spec) {
    if (spec != NULL) *spec = (lg_interval_taylor_spec){.size = sizeof *spec, .first = 1, .last = 1};
}

lg_status lg_interval_taylor(const lg_program *program, const lg_interval_taylor_spec *spec,
                             const lg_interval_options *options, lg_interval **out, lg_error *error) {
    enum { MOST = 12 };
    size_t inputs, outputs;
    LG_NEEDS(error, program, spec, out);
    const bool itself = spec->first == 0 && spec->last == 0;
    if (spec->size != sizeof *spec || (spec->first < 1 && !itself) || spec->first > spec->last ||
        spec->last > MOST)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "lg_interval_taylor_spec: the size is wrong, or the orders are not 1 <= first <= last <= %d, "
            "nor both 0",
            MOST);
    if (spec->function >= lg_program_functions(program))
        return lg_fail(error, LG_NOT_FOUND, "the program has no function number %zu", spec->function);
    const lg_port *in = lg_program_inputs(program, spec->function, &inputs),
                  *to = lg_program_outputs(program, spec->function, &outputs);
    const size_t states = inputs < 1 || inputs > 2 ? 0 : lg_shape_count(in[0].shape);
    if (!itself && (states == 0 || outputs != 1 || lg_shape_count(to[0].shape) != states))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the function number %zu needs the inputs x (n) and u (m), or x alone, and one output (n)",
            spec->function);
    return create(program, &spec->function, 1, spec, states, options, out, error);
}

void lg_interval_destroy(lg_interval *f) {
    if (f == NULL) return;
    LG_FREE_ALL(f->context, f->constant, f->code, f->stored, f->constant_flag, f->parity, f);
}

size_t lg_interval_inputs(const lg_interval *f) {
    return f == NULL ? 0 : f->inputs;
}

size_t lg_interval_outputs(const lg_interval *f) {
    return f == NULL ? 0 : f->outputs;
}

size_t lg_interval_operations(const lg_interval *f) {
    return f == NULL ? 0 : f->count;
}

int lg_interval_parity(const lg_interval *f, size_t output) {
    return f != NULL && output < f->outputs ? f->parity[output] : 0;
}

enum { IB = LG_INTERVAL_BLOCK, APART = 2 * LG_INTERVAL_BLOCK };

size_t lg_interval_work_size(const lg_interval *f) {
    return f == NULL ? 0 : f->registers * (APART * sizeof(double) + IB);
}

static lg_status check(const lg_interval *f, size_t boxes, const double *lower, const double *upper,
                       lg_error *error) {
    for (size_t i = 0; i < boxes * f->inputs; i++) {
        if (lower[i] <= upper[i] && lower[i] >= -DBL_MAX && upper[i] <= DBL_MAX) continue;
        const bool finite = isfinite(lower[i]) && isfinite(upper[i]);
        return lg_fail(error, finite ? LG_INVALID_ARGUMENT : LG_NOT_FINITE,
                       "box %zu, input %zu: [%g, %g] is %s", i / f->inputs, i % f->inputs, lower[i], upper[i],
                       finite ? "empty" : "not finite");
    }
    return LG_OK;
}

/* Lanes without a box repeat the last box. */
static void load(size_t at, size_t now, const lg_bounds *in, bool *unbounded, double *r) {
    for (size_t j = 0; j < in->width; j++, r += APART)
        for (size_t i = 0; i < IB; i++) {
            const size_t box = at + (i < now ? i : now - 1);
            const double l = in->low[box * in->width + j], h = in->high[box * in->width + j];
            const bool bounded = l >= -DBL_MAX && l <= h && h <= DBL_MAX;
            r[i] = bounded ? l : 0;
            r[IB + i] = bounded ? h : 0;
            if (!bounded) unbounded[box] = true;
        }
}

static void store(size_t at, size_t now, const uint32_t *from, const double *r, const lg_bounds *out) {
    for (size_t i = 0; i < now; i++)
        for (size_t j = 0; j < out->width; j++) {
            out->low[(at + i) * out->width + j] = r[from[j] * APART + i];
            out->high[(at + i) * out->width + j] = r[from[j] * APART + IB + i];
        }
}

void lg_interval_bound(const lg_interval *f, size_t boxes, const lg_bounds *const *in, size_t ins,
                       const lg_bounds *const *out, size_t outs, uint8_t *flags, bool *unbounded,
                       void *work) {
    double *r = work;
    uint8_t *level = (uint8_t *)(r + f->registers * APART);
    for (size_t c = 0; c < f->constants; c++) {
        for (size_t i = 0; i < APART; i++) r[c * APART + i] = f->constant[2 * c + (i >= IB)];
        memset(level + c * IB, f->constant_flag[c], IB);
    }
    memset(level + f->constants * IB, LG_INTERVAL_DIFFERENTIABLE, f->inputs * IB);
    for (size_t at = 0; at < boxes; at += IB) {
        const size_t now = boxes - at < IB ? boxes - at : IB;
        for (size_t p = 0, j = f->constants; p < ins; j += in[p++]->width)
            load(at, now, in[p], unbounded, r + j * APART);
        f->run(f->count, f->code, r, flags == NULL ? NULL : level);
        for (size_t p = 0, j = 0; p < outs; j += out[p++]->width) store(at, now, f->stored + j, r, out[p]);
        for (size_t i = 0; i < now * f->outputs && flags != NULL; i++)
            flags[at * f->outputs + i] = level[f->stored[i % f->outputs] * IB + i / f->outputs];
    }
}

lg_status lg_interval_eval(const lg_interval *f, size_t boxes, const double *lower, const double *upper,
                           double *out_lower, double *out_upper, uint8_t *flags, void *work,
                           lg_error *error) {
    LG_NEEDS(error, f, lower, upper, out_lower, out_upper, work);
    LG_TRY(lg_interval_nearest(error));
    LG_TRY(check(f, boxes, lower, upper, error));
    const lg_bounds *const in[] = {&(lg_bounds){(double *)(uintptr_t)lower, (double *)(uintptr_t)upper,
                                                f->inputs}},
                           *const out[] = {&(lg_bounds){out_lower, out_upper, f->outputs}};
    LG_INTERVAL_BOUND(f, boxes, in, out, flags, NULL, work);
    return LG_OK;
}
