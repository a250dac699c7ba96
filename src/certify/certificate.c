/* Certificates as data: the loop as scalar code, and the tree of boxes. */
#include "certify/certificate.h"

#include <stdio.h>
#include <string.h>

#include "certify/certify.h"
#include "autodiff/program/program.h"
#include "certify/interval.h"
#include "liegrad/ops.h"

enum { LARGEST_STUMPFF = 8 };

_Static_assert((int)LG_CERTIFICATE_STATES == (int)LG_CERTIFY_STATES &&
                   (int)LG_CERTIFICATE_CLAIM == (int)LG_CERTIFY_TEXT,
               "sizes of certificates");
/* Places of the table are numbers of operations. */
enum {
#define X(name, op, operands, last) PLACE_##op,
    LG_CERTIFICATE_OPS(X)
#undef X
};
#define X(name, op, operands, last) _Static_assert((int)PLACE_##op == (int)LG_S_##op, "order of " #op);
LG_CERTIFICATE_OPS(X)
#undef X

void lg_certificate_destroy(lg_certificate *f) {
    if (f == NULL) return;
    LG_FREE_ALL(f->context, f->rate.line, f->rate.output, f->control.line, f->control.output, f->tree);
    memset(f, 0, sizeof *f);
}

/* ---- the loop: from a program ---- */

static void take_line(const lg_scalar_code *c, const uint32_t *number, lg_certificate_line *line) {
    *line = (lg_certificate_line){.op = (uint32_t)c->op};
    for (uint32_t k = 0; k < lg_scalar_instructions(c->op); k++) line->in[k] = number[c->in[k]];
    line->number = c->op == LG_S_CONSTANT || c->op == LG_S_POW ? c->p : c->n;
}

/* The instructions that the first `outputs` results need, in their order. */
static lg_status take_code(const lg_context *context, const lg_expansion *x, size_t outputs,
                           lg_certificate_code *out) {
    const lg_scalars *s = &x->s;
    uint32_t lines = 0;
    LG_SCRATCH(uint32_t, number, context, s->count + 1);
    LG_SCRATCH(uint8_t, needed, context, s->count + 1);
    *out = (lg_certificate_code){.inputs = (uint32_t)x->inputs, .outputs = (uint32_t)outputs};
    if (number == NULL || needed == NULL) return LG_OUT_OF_MEMORY;
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(out->line, s->count + 1), LG_ARRAY(out->output, outputs)));
    lg_scalars_mark(s, x->result, outputs, needed);
    for (uint32_t i = 0; i < s->count; i++) {
        if (needed[i] == 0) continue;
        number[i] = lines++;
        take_line(&s->code[i], number, &out->line[number[i]]);
    }
    for (size_t j = 0; j < outputs; j++) out->output[j] = number[x->result[j]];
    out->lines = lines;
    return LG_OK;
}

static lg_status take_function(const lg_context *context, const lg_program *program, const char *name,
                               lg_certificate_code *out, lg_error *error) {
    size_t function, count;
    LG_TRY(lg_program_find(program, name, &function, error));
    const size_t outputs = lg_shape_count(lg_program_outputs(program, function, &count)->shape);
    LG_CLEAN(lg_expansion_destroy) lg_expansion x;
    lg_status status = lg_expand(program, &function, 1, &x, error);
    if (status == LG_OK) status = take_code(context, &x, outputs, out);
    if (status == LG_OUT_OF_MEMORY) return lg_no_memory(error);
    if (status != LG_OK || out->lines <= LG_CERTIFICATE_LINES) return status;
    return lg_fail(error, LG_UNSUPPORTED, "the function '%s' has %u operations, a certificate at most %d",
                   name, out->lines, LG_CERTIFICATE_LINES);
}

/* ---- the loop: to a program ---- */

static lg_var tanh_of(lg_tape *tape, lg_var x) {
    return lg_act(tape, x, LG_TANH);
}
static lg_var sigmoid_of(lg_tape *tape, lg_var x) {
    return lg_act(tape, x, LG_SIGMOID);
}
static lg_var stumpff_of(lg_tape *tape, lg_var x, double number) {
    const uint32_t k = (uint32_t)number;
    return lg_slice(tape, lg_stumpff_functions(tape, x, (int)k), 1, k, 1);
}
static lg_var dexpinv_of(lg_tape *tape, lg_var x, double number) {
    return lg_dexpinv_coefficient(tape, x, (int)number);
}

static const struct recorder {
    lg_var (*one)(lg_tape *, lg_var), (*two)(lg_tape *, lg_var, lg_var);
    lg_var (*three)(lg_tape *, lg_var, lg_var, lg_var), (*with)(lg_tape *, lg_var, double);
} recorders[LG_SCALAR_OPS] = {[LG_S_ADD] = {.two = lg_add},         [LG_S_SUB] = {.two = lg_sub},
                              [LG_S_MUL] = {.two = lg_mul},         [LG_S_DIV] = {.two = lg_div},
                              [LG_S_NEG] = {.one = lg_neg},         [LG_S_MAX] = {.two = lg_max},
                              [LG_S_GE] = {.two = lg_ge},           [LG_S_SELECT] = {.three = lg_select},
                              [LG_S_SQRT] = {.one = lg_sqrt},       [LG_S_ABS] = {.one = lg_abs},
                              [LG_S_SIGN] = {.one = lg_sign},       [LG_S_POW] = {.with = lg_pow},
                              [LG_S_EXP] = {.one = lg_exp},         [LG_S_LOG] = {.one = lg_log},
                              [LG_S_SIN] = {.one = lg_sin},         [LG_S_COS] = {.one = lg_cos},
                              [LG_S_TANH] = {.one = tanh_of},       [LG_S_SIGMOID] = {.one = sigmoid_of},
                              [LG_S_ATAN2] = {.two = lg_atan2},     [LG_S_STUMPFF] = {.with = stumpff_of},
                              [LG_S_DEXPINV] = {.with = dexpinv_of}};

static lg_var record_line(lg_tape *tape, const lg_certificate_line *l, uint32_t rows, const lg_var *of) {
    const struct recorder *r = &recorders[l->op];
    if (l->op == LG_S_CONSTANT)
        return lg_broadcast_to(tape, lg_input_f64(tape, lg_shape2(1, 1), &l->number), lg_shape2(rows, 1));
    const lg_var a = of[l->in[0]], b = of[l->in[1]];
    return r->one != NULL    ? r->one(tape, a)
           : r->two != NULL  ? r->two(tape, a, b)
           : r->with != NULL ? r->with(tape, a, l->number)
                             : r->three(tape, a, b, of[l->in[2]]);
}

typedef struct part {
    const lg_certificate *f;
    const lg_certificate_code *code;
} part;

/* Inputs of the code are the elements of `in`, of which the first has `states`. */
static lg_status record_part(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_certificate *f = ((const part *)user)->f;
    const lg_certificate_code *code = ((const part *)user)->code;
    const uint32_t n = f->states, rows = lg_var_shape(tape, in[0]).dims[0];
    LG_TRY_SCRATCH(lg_var, of, f->context, code->lines + code->outputs, LG_OUT_OF_MEMORY);
    lg_var *to = of + code->lines;
    for (size_t i = 0; i < code->lines; i++) {
        const lg_certificate_line *l = &code->line[i];
        const uint32_t number = l->op == LG_S_INPUT ? (uint32_t)l->number : 0;
        of[i] = l->op != LG_S_INPUT ? record_line(tape, l, rows, of)
                : number < n        ? lg_slice(tape, in[0], 1, number, 1)
                                    : lg_slice(tape, in[1], 1, number - n, 1);
    }
    for (size_t j = 0; j < code->outputs; j++) to[j] = of[code->output[j]];
    out[0] = code->outputs == 1 ? to[0] : lg_concat(tape, to, code->outputs, 1);
    return lg_tape_status(tape);
}

static lg_status record_closed(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                               lg_var *out) {
    const lg_var u = lg_program_call(tape, "control", 0, in);
    out[0] = lg_program_call(tape, "rate", 0, (const lg_var[]){in[0], u});
    return lg_tape_status(tape);
}

/* Functions rate, control and, where both are there, closed. */
static lg_status make_program(const lg_certificate *f, lg_program **out, lg_error *error) {
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1(f->states)},
                           {.name = "u", .shape = lg_shape1(f->inputs)}},
                  rate = {.name = "dx"}, input = {.name = "v"};
    part parts[2] = {{f, &f->rate}, {f, &f->control}};
    const lg_function_spec functions[3] = {
        {"rate", in, f->inputs > 0 ? 2 : 1, &rate, 1, record_part, &parts[0]},
        {"control", in, 1, &input, 1, record_part, &parts[1]},
        {"closed", in, 1, &rate, 1, record_closed, NULL}};
    return lg_program_of(f->context, functions, f->inputs > 0 ? 3 : 1, out, error);
}

/* ---- making and opening ---- */

static lg_status open_for(const lg_context *context, const lg_certificate *f, lg_certificate *made,
                          int threads, lg_certify **out, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    lg_certify_spec spec;
    lg_certify_spec_init(&spec);
    const bool held = f->period > 0;
    spec.rate = !held && f->inputs > 0 ? "closed" : "rate";
    spec.control = held ? "control" : NULL;
    spec.period = f->period;
    spec.P = f->P, spec.goal = f->goal, spec.low = f->low, spec.high = f->high;
    spec.level = f->level, spec.eps = f->eps, spec.model_error = f->error;
    spec.threads = threads;
    LG_TRY(make_program(f, &program, error));
    spec.program = program;
    return lg_certify_create_for(context, &spec, f, made, out, error);
}

/* Whether each line is an operation on earlier lines. */
static bool code_fits(const lg_certificate_code *code, size_t inputs, size_t outputs) {
    bool fits = code->inputs == inputs && code->outputs == outputs && code->lines <= LG_CERTIFICATE_LINES &&
                (outputs == 0 || (code->line != NULL && code->output != NULL));
    for (size_t i = 0; fits && i < code->lines; i++) {
        const lg_certificate_line *l = &code->line[i];
        const double most = l->op == LG_S_INPUT                              ? (double)inputs - 1
                            : l->op == LG_S_STUMPFF || l->op == LG_S_DEXPINV ? LARGEST_STUMPFF
                                                                             : DBL_MAX;
        fits = l->op < LG_SCALAR_OPS && isfinite(l->number) &&
               (most == DBL_MAX || (l->number >= 0 && l->number <= most && l->number == floor(l->number)));
        for (uint32_t k = 0; fits && k < 3; k++)
            fits = k < lg_scalar_instructions((lg_scalar_op)l->op) ? l->in[k] < i : l->in[k] == 0;
    }
    for (size_t j = 0; fits && j < outputs; j++) fits = code->output[j] < code->lines;
    return fits;
}

static lg_status check_loop(const lg_certificate *f, lg_error *error) {
    const size_t n = f->states, m = f->inputs;
    if (n >= 1 && n <= LG_CERTIFICATE_STATES && m <= LG_CERTIFICATE_STATES && (m > 0 || f->period == 0) &&
        code_fits(&f->rate, n + m, n) && code_fits(&f->control, m > 0 ? n : 0, m))
        return LG_OK;
    return lg_fail(
        error, LG_INVALID_ARGUMENT,
        "the code of the rate or of the control is not of %zu states and %zu inputs, or a line is no "
        "operation on earlier lines that a certificate may have",
        n, m);
}

lg_status lg_certify_open(const lg_context *context, const lg_certificate *f, int threads, lg_certify **out,
                          lg_error *error) {
    LG_NEEDS(error, f, out);
    LG_TRY(check_loop(f, error));
    const size_t n = f->states;
    const double *const sides[] = {f->near, f->from, f->to, f->T, f->P};
    bool fits = f->tree != NULL && f->level > 0 && f->eps > 0 && strcspn(f->tree, "\n") == 1 &&
                (f->period == 0 ||
                 (f->steps > 0 && f->steps <= LG_CERTIFICATE_STEPS && (f->steps & (f->steps - 1)) == 0));
    for (size_t k = 0; k < LG_COUNT(sides); k++)
        for (size_t i = 0; i < (k < 3 ? n : n * n); i++) fits = fits && isfinite(sides[k][i]);
    for (size_t i = 0; i < n * n; i++) fits = fits && f->P[i] == f->P[i % n * n + i / n];
    for (size_t i = 0; i < n; i++) fits = fits && f->from[i] < f->to[i];
    if (!fits)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "a certificate needs a tree with one box at its root, level and eps above 0, steps that "
            "are a power of 2 up to %d, a symmetric P, and finite numbers",
            LG_CERTIFICATE_STEPS);
    return open_for(context, f, NULL, threads, out, error);
}

static lg_status fill(const lg_certify_spec *spec, const lg_certify_result *proved, lg_certificate *f,
                      lg_error *error) {
    const size_t n = f->rate.outputs;
    f->states = (uint32_t)n;
    if (n < 1 || n > LG_CERTIFICATE_STATES) return check_loop(f, error);
    f->inputs = (uint32_t)f->control.outputs;
    f->period = spec->control != NULL ? spec->period : 0;
    for (size_t i = 0; i < n; i++) {
        f->goal[i] = spec->goal != NULL ? spec->goal[i] : 0;
        f->low[i] = spec->low[i];
        f->high[i] = spec->high[i];
        f->error[i] = spec->model_error != NULL ? spec->model_error[i] : 0;
        for (size_t j = 0; j < n; j++) f->P[i * n + j] = 0.5 * spec->P[i * n + j] + 0.5 * spec->P[j * n + i];
    }
    f->level = proved->level;
    f->eps = fmin(proved->eps, 0.999 * proved->level);
    f->between = proved->between * (1 + 1e-9);
    return check_loop(f, error);
}

static lg_status make(const lg_certify_spec *spec, const lg_certify_result *proved, double seconds,
                      lg_certificate *f, lg_error *error) {
    LG_CLEAN(lg_certify_destroy_at) lg_certify *certify = NULL;
    lg_certify_result r;
    LG_TRY(take_function(f->context, spec->program, spec->rate, &f->rate, error));
    if (spec->control != NULL)
        LG_TRY(take_function(f->context, spec->program, spec->control, &f->control, error));
    LG_TRY(fill(spec, proved, f, error));
    LG_TRY(open_for(f->context, f, f, spec->threads, &certify, error));
    LG_TRY(lg_certify_run(certify, SIZE_MAX, seconds, &r, error));
    if (!r.verified)
        return lg_fail(error, LG_CHECK_FAILED, "the certificate could not be written: %s",
                       r.finished ? r.reason : "the time ended");
    (void)snprintf(f->claim, sizeof f->claim, "%s", r.claim);
    return LG_OK;
}

lg_status lg_certificate_make(const lg_context *context, const lg_certify_spec *spec,
                              const lg_certify_result *proved, double seconds, lg_certificate *out,
                              lg_error *error) {
    LG_NEEDS(error, spec, proved, out);
    LG_NEEDS(error, spec->program, spec->rate, spec->low, spec->high);
    if (spec->size != sizeof *spec || !proved->verified)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a certificate needs a proof that succeeded, and its spec");
    if (spec->P == NULL || spec->step)
        return lg_fail(error, LG_UNSUPPORTED,
                       "there are certificates as files for a quadratic V, with held or continuous inputs; "
                       "not for another V, nor for maps");
    *out = (lg_certificate){.context = context};
    const lg_status status = make(spec, proved, seconds, out, error);
    if (status != LG_OK) lg_certificate_destroy(out);
    return status;
}

static bool same_code(const lg_certificate_code *a, const lg_certificate_code *b) {
    return a->inputs == b->inputs && a->lines == b->lines && a->outputs == b->outputs &&
           memcmp(a->line, b->line, a->lines * sizeof *a->line) == 0 &&
           memcmp(a->output, b->output, a->outputs * sizeof *a->output) == 0;
}

lg_status lg_certificate_compare(const lg_certificate *f, const lg_program *program, const char *rate,
                                 const char *control, bool *same_plant, bool *same_controller,
                                 lg_error *error) {
    LG_NEEDS(error, f, program, rate, control, same_plant, same_controller);
    LG_CLEAN(lg_certificate_destroy) lg_certificate now = {.context = f->context};
    LG_TRY(take_function(now.context, program, rate, &now.rate, error));
    LG_TRY(take_function(now.context, program, control, &now.control, error));
    *same_plant = same_code(&now.rate, &f->rate);
    *same_controller = same_code(&now.control, &f->control);
    return LG_OK;
}
