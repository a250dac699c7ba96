/* The gradient check of programs: value, forward mode and adjoint as computed by plans are compared with the
 * tape. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "gradcheck/cases.h"
#include "autodiff/check/internal.h"
#include "autodiff/program/plan.h"
#include "autodiff/program/program.h"
#include "liegrad/core.h"

enum { MOST = LG_GRADCHECK_MAX_INPUTS, POINTS = 2, VALUE = 0, FORWARD, ADJOINT, FUNCTIONS };
#define MOVED  0.01 /* how far points are from given values, relative to the argument's scale */
#define CLOSER 0.01 /* factor on rounding_tolerance, because no differences are taken here */
/* A planted error that changes no number by more than this, relative to the largest number, cannot be
 * seen. */
#define ROUNDING 1e-12

static const char *const labels[FUNCTIONS] = {"value", "forward", "adjoint"};

typedef struct check {
    const lg_context *context;
    const lg_gradcheck_function *f;
    const lg_gradcheck_options *options;
    lg_gradcheck_program_result *result;
    lg_program *program;
    lg_tape *tape;
    lg_plan *plan[FUNCTIONS], *planted[FUNCTIONS];
    lg_plant *planting; /* NULL: none */
    lg_rng rng;
    bool rounded;   /* of the case */
    lg_shape shape; /* shape of the output */
    /* Offsets of the inputs in x and d; elements of the output; elements of each function's result. */
    size_t at[MOST + 1], outputs, count[FUNCTIONS];
    double *memory, *x, *d, *c, *truth, *got, *other;
} check;

static lg_status failed(check *k, const char *what, const char *function, double value, double bound) {
    (void)lg_format(k->result->message, sizeof k->result->message, "%s, program, %s: %s (%.3g, bound %.3g)",
                    k->f->name, function, what, value, bound);
    return LG_CHECK_FAILED;
}

static lg_status tape_failed(check *k) {
    (void)snprintf(k->result->message, sizeof k->result->message, "%.80s, program: %.200s", k->f->name,
                   lg_tape_message(k->tape));
    return lg_tape_status(k->tape);
}

static lg_status on_tape(check *k, lg_status status) {
    return status == LG_OK ? LG_OK : tape_failed(k);
}

/* ---- the program ---- */

/* Records the user's function. For an argument with given values, the program's input is a displacement that
 * is added to them. */
static lg_status record(void *user, lg_tape *tape, const lg_var *parameters, const lg_var *in, lg_var *out) {
    const check *k = user;
    lg_var x[MOST];
    for (uint32_t i = 0; i < k->f->inputs; i++) {
        const lg_gradcheck_argument *a = &k->f->arguments[i];
        x[i] = in[i];
        if (a->values != NULL) x[i] = lg_add(tape, lg_input_f64(tape, a->shape, a->values), in[i]);
    }
    out[0] = k->f->build(k->f->user, tape, x);
    return lg_tape_status(tape);
}

static double scale_of(const lg_gradcheck_argument *a) {
    return MOVED * (a->scale != 0.0 ? a->scale : 1.0);
}

static lg_status build_program(check *k, lg_error *error) {
    char names[MOST][16];
    lg_port in[MOST], out = {.name = "y"};
    for (uint32_t i = 0; i < k->f->inputs; i++) {
        const lg_gradcheck_argument *a = &k->f->arguments[i];
        const bool moves = a->values != NULL;
        (void)snprintf(names[i], sizeof names[i], "x%u", i);
        in[i] = (lg_port){.name = names[i], .shape = a->shape, .shared = true};
        in[i].low = moves ? -scale_of(a) : a->low;
        in[i].high = moves ? scale_of(a) : a->high;
    }
    const lg_function_spec function = {labels[VALUE], in, k->f->inputs, &out, 1, record, k};
    return lg_program_of(k->context, &function, 1, &k->program, error);
}

static lg_status derive(check *k, lg_error *error) {
    lg_derivative what;
    lg_derivative_init(&what);
    what.function = labels[VALUE];
    what.kind = LG_DERIVATIVE_FORWARD;
    what.name = labels[FORWARD];
    LG_TRY(lg_program_derive(k->program, &what, error));
    what.kind = LG_DERIVATIVE_ADJOINT;
    what.name = labels[ADJOINT];
    return lg_program_derive(k->program, &what, error);
}

static lg_status make_plans(check *k, lg_plan **plans, lg_error *error) {
    for (size_t f = 0; f < FUNCTIONS; f++) LG_TRY(lg_plan_create(k->program, f, NULL, &plans[f], error));
    return LG_OK;
}

/* ---- random points ---- */

/* A random number not close to zero, so that no term is hidden by a small factor. */
static double draw(check *k) {
    const double size = lg_rng_uniform_in(&k->rng, 0.5, 1.0);
    return lg_rng_below(&k->rng, 2) == 0 ? size : -size;
}

static lg_status draw_moved(check *k, uint32_t i, double *x) {
    const lg_gradcheck_argument *a = &k->f->arguments[i];
    const size_t count = k->at[i + 1] - k->at[i];
    if (a->algebra == 0) {
        for (size_t j = 0; j < count; j++) x[j] = scale_of(a) * draw(k);
        return LG_OK;
    }
    double *along = lg_alloc(k->context, a->algebra, sizeof *along);
    if (along == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t j = 0; j < a->algebra; j++) along[j] = draw(k);
    const lg_status status = k->f->perturb(k->f->user, i, a->values, along, scale_of(a), x);
    lg_free(k->context, along);
    for (size_t j = 0; j < count; j++) x[j] -= a->values[j];
    return status;
}

static lg_status draw_point(check *k) {
    for (uint32_t i = 0; i < k->f->inputs; i++) {
        const lg_gradcheck_argument *a = &k->f->arguments[i];
        const bool plain = a->low == 0.0 && a->high == 0.0;
        if (a->values != NULL) LG_TRY(draw_moved(k, i, k->x + k->at[i]));
        for (size_t j = k->at[i]; a->values == NULL && j < k->at[i + 1]; j++)
            k->x[j] = lg_rng_uniform_in(&k->rng, plain ? -1.0 : a->low, plain ? 1.0 : a->high);
        for (size_t j = k->at[i]; j < k->at[i + 1]; j++) k->d[j] = draw(k);
    }
    for (size_t j = 0; j < k->outputs; j++) k->c[j] = draw(k);
    return LG_OK;
}

/* ---- results of the tape ---- */

typedef struct taped {
    lg_var x[MOST], d[MOST], c, y, result[FUNCTIONS][MOST];
} taped;

static size_t results_of(const check *k, size_t function) {
    return function == ADJOINT ? k->f->inputs : 1;
}

static void place(check *k, taped *t) {
    lg_tape_reset(k->tape);
    for (uint32_t i = 0; i < k->f->inputs; i++) {
        t->x[i] = lg_input_f64(k->tape, k->f->arguments[i].shape, k->x + k->at[i]);
        t->d[i] = lg_input_f64(k->tape, k->f->arguments[i].shape, k->d + k->at[i]);
    }
    t->c = lg_input_f64(k->tape, k->shape, k->c);
}

static lg_status read_results(check *k, const taped *t, size_t function, double *to) {
    for (size_t j = 0; j < results_of(k, function); j++) {
        const size_t count = lg_shape_count(lg_var_shape(k->tape, t->result[function][j]));
        LG_TRY(on_tape(k, lg_read(k->tape, t->result[function][j], count, to)));
        to += count;
    }
    return LG_OK;
}

static lg_status recorded(check *k, double *to) {
    taped t;
    place(k, &t);
    LG_TRY(on_tape(k, record(k, k->tape, NULL, t.x, &t.y)));
    t.result[VALUE][0] = t.y;
    LG_TRY(on_tape(k, lg_vjp(k->tape, &t.y, &t.c, 1, t.x, k->f->inputs, t.result[ADJOINT])));
    LG_TRY(on_tape(k, lg_jvp(k->tape, &t.y, 1, t.x, t.d, k->f->inputs, t.result[FORWARD])));
    for (size_t f = 0; f < FUNCTIONS; to += k->count[f++]) LG_TRY(read_results(k, &t, f, to));
    return LG_OK;
}

static lg_status applied(check *k, double *to) {
    taped t;
    place(k, &t);
    for (size_t f = 0; f < FUNCTIONS; to += k->count[f++]) {
        lg_var in[2 * MOST];
        memcpy(in, t.x, sizeof t.x);
        memcpy(in + k->f->inputs, f == ADJOINT ? &t.c : t.d, (f == ADJOINT ? 1 : k->f->inputs) * sizeof *in);
        LG_TRY(on_tape(k, lg_program_record(k->tape, k->program, f, NULL, in, t.result[f])));
        LG_TRY(read_results(k, &t, f, to));
    }
    return LG_OK;
}

/* ---- results of plans ---- */

static lg_status run_plans(check *k, lg_plan *const *plans, double *to) {
    for (size_t f = 0; f < FUNCTIONS; to += k->count[f++]) {
        const void *in[2 * MOST];
        void *out[MOST], *work = lg_alloc(k->context, lg_plan_work_size(plans[f]), 1);
        if (work == NULL) return LG_OUT_OF_MEMORY;
        /* Fills it with NaN, so that reading memory before writing it is noticed. */
        memset(work, 0xff, lg_plan_work_size(plans[f]));
        for (uint32_t i = 0; i < k->f->inputs; i++) {
            in[i] = k->x + k->at[i];
            in[k->f->inputs + i] = k->d + k->at[i];
        }
        if (f == ADJOINT) in[k->f->inputs] = k->c;
        for (size_t j = 0, at = 0; j < results_of(k, f); at += lg_plan_output_count(plans[f], j++))
            out[j] = to + at;
        lg_plan_eval(plans[f], in, out, work);
        lg_free(k->context, work);
    }
    return LG_OK;
}

/* Error relative to the largest number of `truth`, or to 1e-3 of the largest number of the function's value
 * if that is greater: a derivative may be as small as its own rounding error. */
static double difference(const check *k, const double *got, const double *truth, size_t n, double *apart) {
    const double size = fmax(lg_largest(truth, n), 1e-3 * lg_largest(k->truth, k->outputs));
    *apart = lg_largest_difference(got, truth, n);
    return *apart == 0.0 ? 0.0 : *apart / size;
}

static lg_status compare(check *k, const double *got) {
    double *const errors[FUNCTIONS] = {&k->result->value, &k->result->forward, &k->result->adjoint};
    const double tolerance = CLOSER * k->options->rounding_tolerance;
    size_t at = 0;
    for (size_t f = 0; f < FUNCTIONS; at += k->count[f++]) {
        double apart;
        const double error = difference(k, got + at, k->truth + at, k->count[f], &apart);
        if (!(error <= *errors[f])) *errors[f] = error;
        if (!(error <= tolerance))
            return failed(k, "the plan's result differs from the tape's", labels[f], error, tolerance);
    }
    return LG_OK;
}

static size_t total(const check *k) {
    return k->count[VALUE] + k->count[FORWARD] + k->count[ADJOINT];
}

static lg_status check_point(check *k) {
    const size_t all = total(k);
    LG_TRY(draw_point(k));
    LG_TRY(recorded(k, k->truth));
    LG_TRY(applied(k, k->got));
    if (k->rounded) LG_TRY(compare(k, k->got));
    if (!k->rounded && memcmp(k->got, k->truth, all * sizeof *k->got) != 0)
        return failed(k, "the result of lg_program_record has other bits than the original recording",
                      "recording", lg_largest(k->got, all), lg_largest(k->truth, all));
    LG_TRY(run_plans(k, k->plan, k->got));
    if (k->planting == NULL) return compare(k, k->got);
    LG_TRY(run_plans(k, k->planted, k->other));
    for (size_t i = 0; i < all; i++)
        k->planting->changed += !(fabs(k->got[i] - k->other[i]) <= ROUNDING * lg_largest(k->truth, all));
    return compare(k, k->other);
}

/* ---- the whole check ---- */

static lg_status make_memory(check *k) {
    for (uint32_t i = 0; i < k->f->inputs; i++)
        k->at[i + 1] = k->at[i] + lg_shape_count(k->f->arguments[i].shape);
    size_t ports;
    const lg_port *y = lg_program_outputs(k->program, VALUE, &ports);
    k->shape = y->shape;
    k->outputs = lg_shape_count(y->shape);
    k->count[VALUE] = k->count[FORWARD] = k->outputs;
    k->count[ADJOINT] = k->at[k->f->inputs];
    const size_t inputs = k->at[k->f->inputs], all = total(k);
    k->memory = lg_alloc(k->context, 2 * inputs + k->outputs + 3 * all, sizeof *k->memory);
    if (k->memory == NULL) return LG_OUT_OF_MEMORY;
    k->x = k->memory;
    k->d = k->x + inputs;
    k->c = k->d + inputs;
    k->truth = k->c + k->outputs;
    k->got = k->truth + all;
    k->other = k->got + all;
    return LG_OK;
}

/* Makes plans with the planted error, in addition to the right plans. */
static lg_status make_planted(check *k, lg_error *error) {
    lg_plant *plant = k->planting;
    if (plant->direction < LG_PLANT_SCALARS) return LG_INVALID_ARGUMENT;
    k->program->exchange = plant->exchange;
    const lg_status status = make_plans(k, k->planted, error);
    k->program->exchange = (lg_exchange){NULL, NULL};
    for (size_t f = 0; status == LG_OK && plant->direction == LG_PLANT_PLAN && f < FUNCTIONS; f++)
        if (strcmp(labels[f], plant->operation) == 0) (void)lg_plant_plan(plant, k->planted[f]);
    plant->changed = 0;
    return status;
}

/* For a case that must be refused (test->no_program): checks that it is, and that the message contains this
 * text. */
static lg_status check_refusal(check *k, const lg_gradcheck_case *test, lg_status status,
                               const lg_error *error) {
    k->result->refused = status != LG_OK;
    k->result->value = k->result->forward = k->result->adjoint = NAN;
    (void)snprintf(k->result->message, sizeof k->result->message, "%.300s",
                   status != LG_OK
                       ? error->message
                       : "the function became a program, but its case says that this is impossible");
    return status == LG_UNSUPPORTED && strstr(error->message, test->no_program) != NULL ? LG_OK
                                                                                        : LG_CHECK_FAILED;
}

static lg_status run(check *k, const lg_gradcheck_case *test) {
    lg_error error = {.message = ""};
    k->rounded = test->rounded;
    lg_status status = build_program(k, &error);
    if (test->no_program != NULL) return check_refusal(k, test, status, &error);
    if (status == LG_OK) status = derive(k, &error);
    if (status == LG_OK) status = make_plans(k, k->plan, &error);
    if (status == LG_OK && k->planting != NULL) status = make_planted(k, &error);
    if (status != LG_OK) {
        k->result->refused = status == LG_UNSUPPORTED;
        (void)snprintf(k->result->message, sizeof k->result->message, "%.80s, program: %.220s", k->f->name,
                       error.message);
        return status == LG_UNSUPPORTED ? LG_CHECK_FAILED : status;
    }
    LG_TRY(make_memory(k));
    LG_TRY(lg_tape_create(k->context, NULL, &k->tape));
    for (int p = 0; p < POINTS; p++) LG_TRY(check_point(k));
    return LG_OK;
}

lg_status lg_gradcheck_program(const lg_context *context, const lg_gradcheck_case *test,
                               const lg_gradcheck_options *options, lg_plant *plant,
                               lg_gradcheck_program_result *result) {
    lg_gradcheck_options chosen;
    lg_gradcheck_options_init(&chosen);
    if (test == NULL || result == NULL) return LG_INVALID_ARGUMENT;
    *result = (lg_gradcheck_program_result){0};
    if (options != NULL) chosen = *options;
    if (!lg_gradcheck_valid(&test->function, &chosen)) return LG_INVALID_ARGUMENT;
    check k = {
        .context = context, .f = &test->function, .options = &chosen, .planting = plant, .result = result};
    lg_rng_seed(&k.rng, chosen.seed, 3);
    const lg_status status = run(&k, test);
    result->passed = status == LG_OK;
    if (status != LG_OK && result->message[0] == '\0')
        (void)snprintf(result->message, sizeof result->message, "%.80s, program: %s", test->function.name,
                       lg_status_sentence(status));
    for (size_t f = 0; f < FUNCTIONS; f++) {
        lg_plan_destroy(k.plan[f]);
        lg_plan_destroy(k.planted[f]);
    }
    lg_free(context, k.memory);
    lg_tape_destroy(k.tape);
    lg_program_destroy(k.program);
    return status;
}
