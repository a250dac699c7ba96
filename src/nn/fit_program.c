/* Trains a function of a program by lg_fit. theta is all parameters of the program, one after the other. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "autodiff/tape/tape_internal.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "nn/fit_internal.h"

enum { MOST_EVALUATIONS = 1000, MOST_LM = 64, MOST_DENSE = 2000, MOST_TRIED = 8 };

typedef struct training {
    const lg_program *program;
    size_t function, inputs, parameters, outputs, rows;
    const lg_port *input;
    bool squares;   /* the first output has a value for each row */
    size_t numbers; /* of the first output, per row */
    const double *const *data;
    double *theta, *best; /* best: parameters of the best start so far; NULL without starts */
    size_t count;         /* length of theta and best */
} training;

/* ---- on a tape ---- */

/* Records input i with the rows `samples`; a shared input is recorded whole. */
static lg_var put_rows(const training *t, lg_tape *tape, size_t i, const uint32_t *samples, size_t count) {
    const lg_port *port = &t->input[i];
    const size_t width = lg_shape_count(port->shape);
    if (port->shared) return lg_input_f64(tape, port->shape, t->data[i]);
    const lg_kernels *k = lg_kernels_for(lg_tape_dtype(tape));
    void *values;
    const lg_var x = lg_input_buffer(tape, lg_port_shape(port, count), &values);
    if (lg_is_none(x)) return x;
    for (size_t r = 0; r < count; r++)
        k->convert_in(width, t->data[i] + samples[r] * width, (char *)values + r * width * k->size);
    return x;
}

void lg_fit_slice(lg_tape *tape, const lg_program *program, lg_var theta, lg_var *parameters) {
    uint32_t at = 0;
    for (size_t j = 0; j < lg_program_parameters(program); j++) {
        const lg_shape shape = lg_program_parameter(program, j).shape;
        const uint32_t numbers = (uint32_t)lg_shape_count(shape);
        parameters[j] = lg_reshape(tape, lg_slice(tape, theta, 0, at, numbers), shape);
        at += numbers;
    }
}

/* Records the function for these rows; *out is its first output. */
static lg_status record(const training *t, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                        lg_var *out) {
    lg_var parameters[LG_PROGRAM_FIT_MOST], in[LG_PROGRAM_FIT_MOST], outputs[LG_PROGRAM_FIT_MOST];
    lg_fit_slice(tape, t->program, theta, parameters);
    for (size_t i = 0; i < t->inputs; i++) in[i] = put_rows(t, tape, i, samples, count);
    LG_TRY(lg_program_record(tape, t->program, t->function, parameters, in, outputs));
    *out = outputs[0];
    return lg_tape_status(tape);
}

static lg_status residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *r) {
    const training *t = user;
    LG_TRY(record(t, tape, theta, samples, count, r));
    *r = lg_scale(tape, *r, 1.0 / sqrt((double)batch * (double)t->numbers));
    return lg_tape_status(tape);
}

static lg_status loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                      size_t batch, lg_var *out) {
    const training *t = user;
    lg_var y = LG_NONE;
    LG_TRY(record(t, tape, theta, samples, count, &y));
    const double part = (double)count / (double)batch;
    *out = t->squares ? lg_scale(tape, lg_mean(tape, lg_square(tape, y)), part)
                      : lg_scale(tape, lg_reshape(tape, y, lg_shape0()), part);
    return lg_tape_status(tape);
}

/* ---- set-up ---- */

static lg_status check_data(const training *t, lg_error *error) {
    if (t->data == NULL || t->rows == 0 || t->rows >= UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the data are NULL, or the number of rows is not 1 to 2^32 - 2");
    for (size_t i = 0; i < t->inputs; i++) {
        const size_t width = lg_shape_count(t->input[i].shape), rows = t->input[i].shared ? 1 : t->rows;
        if (t->data[i] == NULL)
            return lg_fail(error, LG_INVALID_ARGUMENT, "the data of the input '%s' are NULL",
                           t->input[i].name);
        for (size_t k = 0; k < rows * width; k++)
            if (!isfinite(t->data[i][k]))
                return lg_fail(error, LG_NOT_FINITE, "row %zu of the input '%s' is not finite", k / width,
                               t->input[i].name);
    }
    return LG_OK;
}

size_t lg_fit_take(const lg_program *program, double *theta) {
    size_t at = 0;
    for (size_t j = 0; j < lg_program_parameters(program); j++) {
        const lg_parameter_spec p = lg_program_parameter(program, j);
        const size_t count = lg_shape_count(p.shape);
        if (theta != NULL) memcpy(theta + at, p.values, count * sizeof *theta);
        at += count;
    }
    return at;
}

_Static_assert(LG_PROGRAM_MAX_PORTS <= LG_PROGRAM_FIT_MOST, "inputs and outputs of any program");

static lg_status open_function(training *t, const char *function, lg_error *error) {
    LG_NEEDS(error, t->program, function);
    LG_TRY(lg_program_find(t->program, function, &t->function, error));
    const lg_port *output = lg_program_outputs(t->program, t->function, &t->outputs);
    t->input = lg_program_inputs(t->program, t->function, &t->inputs);
    t->parameters = lg_program_parameters(t->program);
    t->squares = !output->shared;
    t->numbers = lg_shape_count(output->shape);
    if (t->parameters == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "the program has no parameters");
    if (t->parameters > LG_PROGRAM_FIT_MOST)
        return lg_fail(error, LG_UNSUPPORTED, "the program has more than %d parameters", LG_PROGRAM_FIT_MOST);
    if (!t->squares && t->numbers != 1)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "output '%s' has %zu numbers that all rows share, expected one, the loss",
                       output->name, t->numbers);
    t->count = lg_fit_take(t->program, NULL);
    return LG_OK;
}

static void set_defaults(const training *t, lg_fit_options *options) {
    const lg_fit_method method = t->count > MOST_DENSE               ? LG_FIT_LBFGS
                                 : t->squares && t->count <= MOST_LM ? LG_FIT_LM
                                                                     : LG_FIT_SSBROYDEN;
    lg_fit_options_init(options);
    options->plan.phases = 1;
    options->plan.phase[0].method = (uint32_t)method;
    options->epochs = MOST_EVALUATIONS;
}

lg_status lg_fit_give(lg_program *program, const double *theta) {
    for (size_t j = 0; j < lg_program_parameters(program); j++) {
        LG_TRY(lg_program_set_parameter(program, j, theta));
        theta += lg_shape_count(lg_program_parameter(program, j).shape);
    }
    return LG_OK;
}

/* The loss of these rows taken together, at `theta`. *depends: whether it depends on theta. */
static lg_status loss_of(training *t, lg_tape *tape, const double *theta, const uint32_t *samples,
                         size_t rows, double *value, bool *depends) {
    lg_var out = LG_NONE;
    lg_tape_reset(tape);
    const lg_var parameters = lg_parameter(tape, lg_shape1((uint32_t)t->count), theta);
    LG_TRY(loss(t, tape, parameters, samples, rows, rows, &out));
    *depends = lg_depends_on(tape, out, parameters);
    return lg_read(tape, out, 1, value);
}

/* Tries up to MOST_TRIED rows from all over the data: their loss together must be the mean of the losses of
 * the single rows. */
static lg_status check_mean_at(training *t, lg_tape *tape, const double *theta, lg_error *error) {
    uint32_t samples[MOST_TRIED];
    const size_t rows = t->rows < MOST_TRIED ? t->rows : MOST_TRIED;
    const char *name = lg_program_outputs(t->program, t->function, &t->outputs)->name;
    double together, one, mean = 0.0, size = 0.0;
    bool depends;
    for (size_t r = 0; r < rows; r++) samples[r] = (uint32_t)lg_spread(r, t->rows, rows);
    LG_TRY(loss_of(t, tape, theta, samples, rows, &together, &depends));
    if (!depends)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "output '%s' depends on no parameter: there is nothing to learn", name);
    for (size_t r = 0; r < rows; r++) {
        LG_TRY(loss_of(t, tape, theta, &samples[r], 1, &one, &depends));
        mean += one / (double)rows;
        size += fabs(one) / (double)rows;
    }
    if (!isfinite(together) || fabs(together - mean) <= 1e-8 * fmax(size, fabs(together))) return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   t->squares
                       ? "a row of output '%s' depends on other rows: the mean square of %zu rows is %.6g if "
                         "computed together and %.6g if computed one by one"
                       : "output '%s' is not a mean over rows: %zu rows give %.6g if computed together, but "
                         "a mean of %.6g if computed one by one: use lg_mean, or give each row a value",
                   name, rows, together, mean);
}

/* Tries this at parameters that are off by a hundredth, because a loss that has been learned to the last
 * digit is rounding, which may differ between rows together and rows one by one. */
static lg_status check_mean(training *t, const lg_context *context, lg_tape *tape, lg_error *error) {
    LG_SCRATCH(double, off, context, t->count);
    if (off == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu parameters", t->count);
    for (size_t i = 0; i < t->count; i++) off[i] = t->theta[i] * (i % 2 == 0 ? 1.01 : 0.99);
    return check_mean_at(t, tape, off, error);
}

static lg_fit_problem problem_of(training *t) {
    return (lg_fit_problem){.parameters = t->count,
                            .samples = t->rows,
                            .loss = loss,
                            .user = t,
                            .residuals = t->squares ? residuals : NULL,
                            .observations = t->squares ? t->rows * t->numbers : 0};
}

/* The loss of all rows. First checks that it is a mean. */
static lg_status loss_of_all(training *t, const lg_context *context, double *sum, lg_error *error) {
    const lg_fit_problem problem = problem_of(t);
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    LG_TRY(lg_tape_create(context, NULL, &tape));
    const lg_status status = check_mean(t, context, tape, error);
    if (lg_tape_status(tape) != LG_OK)
        (void)lg_fail(error, status, "the function cannot be recorded with these rows: %s",
                      lg_tape_message(tape));
    LG_TRY(status);
    return lg_fit_problem_loss(context, &problem, t->theta, sum, error);
}

static lg_status run(training *t, const lg_context *context, const lg_fit_options *options,
                     lg_program_fit_result *result, lg_error *error) {
    lg_fit_options defaults;
    const lg_fit_problem problem = problem_of(t);
    const double begin = lg_seconds();
    LG_CLEAN(lg_fit_destroy_at) lg_fit *fit = NULL;
    set_defaults(t, &defaults);
    LG_TRY(loss_of_all(t, context, &result->before, error));
    LG_TRY(lg_fit_create(context, &problem, options != NULL ? options : &defaults, t->theta, &fit, error));
    LG_TRY(lg_fit_run(fit, error));
    lg_fit_parameters(fit, t->theta);
    result->epochs = lg_fit_epochs_done(fit);
    result->end = lg_fit_end_sentence(fit);
    LG_TRY(loss_of_all(t, context, &result->after, error));
    result->seconds = lg_seconds() - begin;
    return LG_OK;
}

/* Runs all starts. theta becomes the parameters of the start with the lowest loss. A start whose numbers
 * do not stay finite loses; it is an error only if no other start ends well. */
static lg_status run_starts(training *t, const lg_context *context, const lg_fit_options *options,
                            const lg_fit_starts *starts, lg_program_fit_result *result, lg_error *error) {
    const double begin = lg_seconds();
    lg_status status = LG_OK;
    result->after = INFINITY;
    for (uint32_t start = 0; start < starts->count; start++) {
        lg_program_fit_result made = {.end = "", .start = start};
        lg_rng rng;
        lg_rng_seed(&rng, starts->seed, start);
        (void)lg_fit_take(t->program, t->theta);
        double *to = t->theta;
        for (size_t j = 0; j < t->parameters; j++) {
            const size_t count = lg_shape_count(lg_program_parameter(t->program, j).shape);
            starts->draw(starts->user, j, count, &rng, to);
            to += count;
        }
        status = run(t, context, options, &made, error);
        if (status != LG_OK && status != LG_NOT_FINITE) return status;
        if (status != LG_OK || !(made.after < result->after)) continue;
        *result = made;
        memcpy(t->best, t->theta, t->count * sizeof *t->best);
    }
    if (result->after == INFINITY) return status;
    memcpy(t->theta, t->best, t->count * sizeof *t->best);
    result->seconds = lg_seconds() - begin;
    return LG_OK;
}

static lg_status fit(training *t, const lg_context *context, lg_program *program,
                     const lg_fit_options *options, const lg_fit_starts *starts,
                     lg_program_fit_result *result, lg_error *error) {
    LG_SCRATCH(double, theta, context, t->count);
    LG_SCRATCH(double, best, context, t->count);
    if (theta == NULL || best == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu parameters", t->count);
    t->theta = theta;
    t->best = best;
    (void)lg_fit_take(t->program, theta);
    LG_TRY(starts != NULL ? run_starts(t, context, options, starts, result, error)
                          : run(t, context, options, result, error));
    LG_TRY(lg_fit_give(program, theta));
    return lg_program_set_fitted(program, t->function, true);
}

lg_status lg_program_fit(const lg_context *context, lg_program *program, const char *function,
                         const double *const *data, size_t rows, const lg_fit_options *options,
                         const lg_fit_starts *starts, lg_program_fit_result *result, lg_error *error) {
    training t = {.program = program, .data = data, .rows = rows};
    lg_program_fit_result made = {.end = ""};
    LG_TRY(open_function(&t, function, error));
    LG_TRY(check_data(&t, error));
    if (starts != NULL && (starts->count < 1 || starts->draw == NULL))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the number of starts is 0 or there is no function that draws them");
    LG_TRY(fit(&t, context, program, options, starts, &made, error));
    if (result != NULL) *result = made;
    return LG_OK;
}

lg_status lg_program_fit_options_init(const lg_program *program, const char *function,
                                      lg_fit_options *options, lg_error *error) {
    training t = {.program = program};
    LG_NEEDS(error, options);
    LG_TRY(open_function(&t, function, error));
    set_defaults(&t, options);
    return LG_OK;
}

lg_status lg_program_loss(const lg_context *context, const lg_program *program, const char *function,
                          const double *const *data, size_t rows, double *loss, lg_error *error) {
    training t = {.program = program, .data = data, .rows = rows};
    LG_NEEDS(error, loss);
    LG_TRY(open_function(&t, function, error));
    LG_TRY(check_data(&t, error));
    LG_SCRATCH(double, theta, context, t.count);
    if (theta == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu parameters", t.count);
    t.theta = theta;
    (void)lg_fit_take(t.program, theta);
    return loss_of_all(&t, context, loss, error);
}
