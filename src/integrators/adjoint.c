/* Gradients of functionals of a trajectory: the states are recomputed from checkpoints with the plain
 * stepper, and each step is recorded alone on a tape and swept backwards. */
#include "liegrad/ops.h"
#include "liegrad/taped.h"

#include <math.h>
#include <string.h>

#include "core/core.h"
#include "integrators/stepper.h"

typedef struct lg_adjoint {
    const lg_context *context;
    const lg_adjoint_problem *problem;
    lg_error *error;
    lg_stepper *stepper;
    lg_tape *tape;
    size_t dim, segments, longest; /* longest: number of steps in the longest segment */
    double *memory;
    double *checkpoint; /* (segments + 1, dim): the starts of the segments, then the end */
    double *state;      /* (longest, dim): the starts of all steps in the current segment */
    double *after;      /* dim: dJ/dy after the current step */
    double *before;     /* dim: dJ/dy before the current step */
    double *parameters; /* dJ/dparameters, summed over the steps swept so far; NULL if not wanted */
} lg_adjoint;

/* Variables of one recorded step: start, parameters (or LG_NONE), end. */
typedef struct lg_recorded {
    lg_var y, parameters, next; /* y and next (1, dim) */
} lg_recorded;

void lg_adjoint_problem_init(lg_adjoint_problem *problem) {
    *problem = (lg_adjoint_problem){.size = sizeof(lg_adjoint_problem)};
}

static lg_status fail_at(const lg_adjoint *a, lg_status status, size_t n, const char *what) {
    return lg_fail(a->error, status, "step %zu of %zu, t = %.10g, h = %.3g: %s", n + 1, a->problem->steps,
                   a->problem->t[n], a->problem->h[n], what);
}

/* ---- plain states ---- */

/* Number of the first step of segment s; N for s = segments. The longer segments come first. */
static size_t first_step(const lg_adjoint *a, size_t s) {
    const size_t extra = a->problem->steps % a->segments;
    return s * (a->problem->steps / a->segments) + (s < extra ? s : extra);
}

static lg_status advance(lg_adjoint *a, size_t n, const double *y, double *next) {
    if (lg_cancelled(a->context)) return fail_at(a, LG_CANCELLED, n, "cancelled");
    const lg_status status = lg_stepper_step(a->stepper, a->problem->t[n], a->problem->h[n], y, NULL, next);
    return status == LG_OK ? LG_OK : fail_at(a, status, n, lg_status_sentence(status));
}

/* Computes the checkpoint at the end of segment s from the checkpoint at its start. In the last segment it
 * also stores the state before each step in a->state. The stepper is reset first, so that a segment computed
 * again gives the same bits. */
static lg_status cross_segment(lg_adjoint *a, size_t s) {
    const size_t d = a->dim, begin = first_step(a, s), end = first_step(a, s + 1);
    double *y = a->checkpoint + (s + 1) * d;
    memcpy(y, y - d, d * sizeof(*y));
    lg_stepper_reset(a->stepper);
    for (size_t n = begin; n < end; n++) {
        if (s + 1 == a->segments) memcpy(a->state + (n - begin) * d, y, d * sizeof(*y));
        LG_TRY(advance(a, n, y, y));
    }
    return LG_OK;
}

static lg_status recompute_segment(lg_adjoint *a, size_t s) {
    const size_t d = a->dim, begin = first_step(a, s), length = first_step(a, s + 1) - begin;
    if (s + 1 == a->segments) return LG_OK;
    memcpy(a->state, a->checkpoint + s * d, d * sizeof(*a->state));
    lg_stepper_reset(a->stepper);
    for (size_t i = 0; i + 1 < length; i++)
        LG_TRY(advance(a, begin + i, a->state + i * d, a->state + (i + 1) * d));
    return LG_OK;
}

/* ---- steps on the tape ---- */

/* For splitting schemes, replaces the space R^2n by R^n x R^n, so that q and p are two parts. Other spaces
 * stay; lg_taped_step refuses those that do not fit. */
static lg_status halve(const lg_scheme *scheme, lg_space *space) {
    const size_t n = space->dim / 2;
    if (scheme->kind != LG_SCHEME_SPLITTING || space->factors != 1) return LG_OK;
    if (space->factor[0].kind != LG_SPACE_RN || space->dim % 2 != 0) return LG_OK;
    const lg_space_factor halves[2] = {{LG_SPACE_RN, n}, {LG_SPACE_RN, n}};
    return lg_space_init(space, halves, 2);
}

static lg_status record(lg_adjoint *a, size_t n, const double *y, lg_recorded *r) {
    const lg_adjoint_problem *p = a->problem;
    lg_taped_ode ode = {0};
    lg_var start[LG_TAPED_MAX_PARTS], end[LG_TAPED_MAX_PARTS];
    lg_tape_reset(a->tape);
    *r = (lg_recorded){.y = lg_parameter(a->tape, lg_shape2(1, (uint32_t)a->dim), y), .parameters = LG_NONE};
    if (p->parameter_count > 0)
        r->parameters = lg_parameter(a->tape, lg_shape1((uint32_t)p->parameter_count), p->parameters);
    LG_TRY(lg_tape_status(a->tape));
    LG_TRY(p->bind(p->user, a->tape, r->parameters, &ode));
    if (ode.space.dim != a->dim) {
        (void)lg_tape_fail(a->tape, LG_INVALID_ARGUMENT, "bind",
                           "the recorded equation has a space of another dimension than the plain one");
        return LG_INVALID_ARGUMENT;
    }
    LG_TRY(halve(p->scheme, &ode.space));
    LG_TRY(lg_taped_split(a->tape, &ode.space, r->y, start));
    LG_TRY(lg_taped_step(a->tape, p->scheme, &ode,
                         &(lg_taped_interval){.t = {.value = p->t[n]}, .h = p->h[n]}, start, end));
    r->next = lg_taped_join(a->tape, &ode.space, end);
    return lg_tape_status(a->tape);
}

static lg_status fail_recording(const lg_adjoint *a, lg_status status, size_t n) {
    const char *message = lg_tape_message(a->tape);
    if (message[0] == '\0') message = lg_status_sentence(status);
    return fail_at(a, status, n, message);
}

/* The caller gives the equation twice: problem->ode, and the form for the tape that bind makes. If they
 * differ, the gradient would be wrong. Their first steps may differ by this fraction of the largest |y_i|. */
static const double agreement = 1e-8;

static double largest(size_t n, const double *x) {
    double most = 0.0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(x[i]));
    return most;
}

/* Compares the first step of both forms before the run, so that an inconsistency is found at once. */
static lg_status compare_forms(lg_adjoint *a, const double *y0) {
    const size_t d = a->dim;
    lg_recorded r;
    LG_TRY(advance(a, 0, y0, a->after));
    lg_status status = record(a, 0, y0, &r);
    if (status == LG_OK) status = lg_read(a->tape, r.next, d, a->before);
    if (status != LG_OK) return fail_recording(a, status, 0);
    const double scale = fmax(largest(d, y0), largest(d, a->after));
    for (size_t i = 0; i < d; i++) {
        const double difference = fabs(a->before[i] - a->after[i]);
        if (difference <= agreement * scale) continue;
        return lg_fail(a->error, LG_INVALID_ARGUMENT,
                       "the recorded and the plain equation differ: after the first step, number %zu of the "
                       "state is %.17g on the tape and %.17g in the plain integration",
                       i, a->before[i], a->after[i]);
    }
    return LG_OK;
}

/* gradient = dJ_n/dy at y, the state after n steps. */
static lg_status add_source(lg_adjoint *a, size_t n, const double *y, double *gradient) {
    const lg_adjoint_problem *p = a->problem;
    const size_t last = p->steps - 1;
    const double t = n < p->steps ? p->t[n] : p->t[last] + p->h[last];
    memset(gradient, 0, a->dim * sizeof(*gradient));
    const lg_status status = p->source(p->user, n, t, y, gradient);
    return status == LG_OK ? LG_OK
                           : lg_fail(a->error, status, "source %zu: %s", n, lg_status_sentence(status));
}

/* Sweeps back over step n, which starts at y: from dJ/dy after the step (a->after) computes dJ/dy before it,
 * which is then in a->after. */
static lg_status reverse_step(lg_adjoint *a, size_t n, const double *y) {
    lg_recorded r;
    if (lg_cancelled(a->context)) return fail_at(a, LG_CANCELLED, n, "cancelled");
    LG_TRY(add_source(a, n, y, a->before));
    lg_status status = record(a, n, y, &r);
    if (status != LG_OK) return fail_recording(a, status, n);
    const lg_var weight = lg_parameter(a->tape, lg_shape2(1, (uint32_t)a->dim), a->after);
    const lg_var product = lg_rowdot(a->tape, weight, r.next);
    const lg_var variables[2] = {r.y, r.parameters};
    void *const gradients[2] = {a->before, a->parameters};
    status = lg_backward(a->tape, product, variables, a->parameters ? 2 : 1, gradients);
    if (status != LG_OK) return fail_recording(a, status, n);
    if (!lg_all_finite(a->dim, a->before)) return fail_at(a, LG_NOT_FINITE, n, "the gradient is not finite");
    double *swap = a->after;
    a->after = a->before;
    a->before = swap;
    return LG_OK;
}

static lg_status reverse(lg_adjoint *a) {
    LG_TRY(add_source(a, a->problem->steps, a->checkpoint + a->segments * a->dim, a->after));
    if (!lg_all_finite(a->dim, a->after))
        return fail_at(a, LG_NOT_FINITE, a->problem->steps - 1, "the source after this step is not finite");
    for (size_t s = a->segments; s-- > 0;) {
        const size_t begin = first_step(a, s);
        LG_TRY(recompute_segment(a, s));
        for (size_t n = first_step(a, s + 1); n-- > begin;)
            LG_TRY(reverse_step(a, n, a->state + (n - begin) * a->dim));
    }
    if (a->parameters && !lg_all_finite(a->problem->parameter_count, a->parameters))
        return lg_fail(a->error, LG_NOT_FINITE, "the gradient in the parameters is not finite");
    return LG_OK;
}

/* ---- the whole gradient ---- */

static const char *fault_of(const lg_adjoint_problem *p, const double *y0) {
    if (!p || p->size != sizeof *p) return "the problem was not initialised";
    if (!p->scheme || !p->ode || !p->bind || !p->source || !p->t || !p->h || !y0)
        return "an argument is NULL";
    if (p->steps < 1) return "the number of steps is 0";
    if (p->checkpoints > p->steps) return "more checkpoints than steps";
    if (p->parameter_count > 0 && !p->parameters)
        return "parameter_count is above 0, but `parameters` is NULL";
    if (p->ode->space.dim < 1 || p->ode->space.dim > UINT32_MAX || p->parameter_count > UINT32_MAX)
        return "a state or the parameters are too large";
    if (!lg_all_finite(p->steps, p->t) || !lg_all_finite(p->steps, p->h))
        return "a time or a step is not finite";
    if (!lg_all_finite(p->ode->space.dim, y0)) return "the initial state is not finite";
    if (!lg_all_finite(p->parameter_count, p->parameters)) return "a parameter is not finite";
    return NULL;
}

static size_t root_up(size_t n) {
    size_t root = (size_t)sqrt((double)n);
    while (root * root < n) root++;
    while (root > 1 && (root - 1) * (root - 1) >= n) root--;
    return root;
}

static void lay_out(lg_adjoint *a, bool parameters) {
    a->checkpoint = a->memory;
    a->state = a->checkpoint + (a->segments + 1) * a->dim;
    a->after = a->state + a->longest * a->dim;
    a->before = a->after + a->dim;
    a->parameters = parameters ? a->before + a->dim : NULL;
}

static lg_status open_adjoint(lg_adjoint *a, bool parameters) {
    const lg_adjoint_problem *p = a->problem;
    const size_t rows = a->segments + 1 + a->longest + 2, extra = parameters ? p->parameter_count : 0;
    const lg_status status = lg_stepper_create(a->context, p->scheme, p->ode, &a->stepper);
    if (status != LG_OK)
        return lg_fail(a->error, status, "the scheme cannot step this equation: %s",
                       lg_status_sentence(status));
    if (rows <= SIZE_MAX / sizeof(double) / 2 / a->dim)
        a->memory = lg_alloc(a->context, rows * a->dim + extra, sizeof(double));
    if (!a->memory || lg_tape_create(a->context, NULL, &a->tape) != LG_OK)
        return lg_fail(a->error, LG_OUT_OF_MEMORY, "no memory for %zu states of %zu numbers", rows, a->dim);
    lay_out(a, parameters);
    return LG_OK;
}

static void close_adjoint(lg_adjoint *a) {
    lg_tape_destroy(a->tape);
    lg_free(a->context, a->memory);
    lg_stepper_destroy(a->stepper);
}

static lg_status run(lg_adjoint *a, const double *y0, bool gradient) {
    if (gradient) LG_TRY(compare_forms(a, y0));
    memcpy(a->checkpoint, y0, a->dim * sizeof(*y0));
    for (size_t s = 0; s < a->segments; s++) LG_TRY(cross_segment(a, s));
    return gradient ? reverse(a) : LG_OK;
}

static void copy_out(size_t n, const double *from, double *to) {
    if (to && n > 0) memcpy(to, from, n * sizeof(*to));
}

lg_status lg_adjoint_gradient(const lg_context *context, const lg_adjoint_problem *problem, const double *y0,
                              double *y_end, double *dy0, double *dparameters, lg_adjoint_stats *stats,
                              lg_error *error) {
    const double begin = lg_seconds();
    const char *fault = fault_of(problem, y0);
    if (fault) return lg_fail(error, LG_INVALID_ARGUMENT, "%s", fault);
    const size_t steps = problem->steps, d = problem->ode->space.dim;
    const size_t segments = problem->checkpoints > 0 ? problem->checkpoints : root_up(steps);
    const bool parameters = dparameters && problem->parameter_count > 0;
    lg_adjoint a = {.context = context,
                    .problem = problem,
                    .error = error,
                    .dim = d,
                    .segments = segments,
                    .longest = (steps - 1) / segments + 1};
    lg_status status = open_adjoint(&a, parameters);
    if (status == LG_OK) status = run(&a, y0, dy0 || parameters);
    if (status == LG_OK) {
        copy_out(d, a.checkpoint + segments * d, y_end);
        copy_out(d, a.after, dy0);
        copy_out(parameters ? problem->parameter_count : 0, a.parameters, dparameters);
        if (stats)
            *stats = (lg_adjoint_stats){.checkpoints = segments,
                                        .states_size = sizeof(double) * d * (segments + 1 + a.longest),
                                        .tape_size = lg_tape_size(a.tape),
                                        .seconds = lg_seconds() - begin};
    }
    close_adjoint(&a);
    return status;
}
