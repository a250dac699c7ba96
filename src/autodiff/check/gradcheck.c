/* The gradient check. At order 1 it checks the user's function; at order 2 it checks G(x, c) = J(x)^T c, with
 * the cotangent c as an additional argument. Both functions go through the same checks. */
#include "autodiff/check/internal.h"
#include "autodiff/ops/op_table.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "liegrad/core.h"

#define MAX_ARGUMENTS   (LG_GRADCHECK_MAX_INPUTS + 1)
#define FIRST_STEP      (1.0 / 16.0)
#define HALVINGS        26 /* the smallest step is 2e-9 */
#define WINDOW          8  /* number of points of the regression */
#define SMALLEST_WINDOW 4
/* A remainder below this fraction of the magnitudes involved counts as rounding. */
#define ROUNDING      5e-13
#define QUOTIENT_STEP (1.0 / 1024.0)

void lg_gradcheck_options_init(lg_gradcheck_options *options) {
    *options = (lg_gradcheck_options){.size = sizeof *options,
                                      .seed = 1,
                                      .order = 2,
                                      .directions = 2,
                                      .slope = 1.9,
                                      .difference_tolerance = 1e-6,
                                      .rounding_tolerance = 1e-10};
}

/* Several tensors in one array: tensor i occupies elements at[i] .. at[i + 1] - 1. */
typedef struct layout {
    size_t count, at[MAX_ARGUMENTS + 1];
    lg_shape shape[MAX_ARGUMENTS];
} layout;

static size_t total(const layout *l) {
    return l->at[l->count];
}

static void append_shape(layout *l, lg_shape shape) {
    l->shape[l->count] = shape;
    l->at[l->count + 1] = l->at[l->count] + lg_shape_count(shape);
    l->count++;
}

typedef struct check {
    const lg_context *context;
    const lg_gradcheck_function *f;
    const lg_gradcheck_options *options;
    lg_gradcheck_result *result;
    lg_gradcheck_order *report;
    lg_tape *tape;
    lg_rng rng;
    int order;
    layout in, out;
    size_t d_at[MAX_ARGUMENTS + 1]; /* offsets in d: algebra elements, or elements of the argument's shape */
    double *memory;
    /* arrays with the layout `in` */
    double *x, *moved, *dx, *vjp, *back, *second;
    double *d;
    /* arrays with the layout `out` */
    double *c, *y, *jvp, *quotient, *work;
} check;

/* ---- messages ---- */

static lg_status failed(check *k, const char *what, double value, double bound) {
    (void)lg_format(k->result->message, sizeof k->result->message, "%s, order %d: %s (%.3g, bound %.3g)",
                    k->f->name, k->order, what, value, bound);
    return LG_CHECK_FAILED;
}

static lg_status tape_failed(check *k) {
    (void)snprintf(k->result->message, sizeof k->result->message, "%.80s, order %d: %.200s", k->f->name,
                   k->order, lg_tape_message(k->tape));
    return lg_tape_status(k->tape);
}

static lg_status on_tape(check *k, lg_status status) {
    return status == LG_OK ? LG_OK : tape_failed(k);
}

/* Records an error in the report, and fails if it is above its bound or NaN. */
static lg_status judge(check *k, const char *what, double error, double bound) {
    if (!(error <= k->report->error)) k->report->error = error;
    return error <= bound ? LG_OK : failed(k, what, error, bound);
}

double lg_largest_difference(const double *a, const double *b, size_t n) {
    double most = 0.0;
    for (size_t i = 0; i < n; i++) {
        const double size = fabs(b == NULL ? a[i] : a[i] - b[i]);
        if (isnan(size)) return size;
        if (size > most) most = size;
    }
    return most;
}

/* Returns sum a_i b_i and adds sum |a_i b_i| to *magnitude. */
static double dot(const double *a, const double *b, size_t n, double *magnitude) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) {
        sum += a[i] * b[i];
        *magnitude += fabs(a[i] * b[i]);
    }
    return sum;
}

/* ---- recording the function ---- */

static void place(check *k, const double *values, lg_var *x) {
    for (size_t i = 0; i < k->in.count; i++)
        x[i] = lg_input_f64(k->tape, k->in.shape[i], values + k->in.at[i]);
}

/* Records the user's function. The planted error is switched off meanwhile: derivatives that the function
 * itself takes belong to its value. */
static lg_var build_first(check *k, const lg_var *x) {
    const lg_exchange planted = k->tape->exchange;
    k->tape->exchange = (lg_exchange){NULL, NULL};
    lg_var y = k->f->build(k->f->user, k->tape, x);
    k->tape->exchange = planted;
    return y;
}

/* Records the function of this order on the tape. At order 2, y has the layout `out`. */
static void build(check *k, const lg_var *x, lg_var *y) {
    lg_var first = build_first(k, x);
    y[0] = first;
    if (k->order == 2) (void)lg_vjp(k->tape, &first, &x[k->f->inputs], 1, x, k->f->inputs, y);
}

static lg_status read_all(check *k, const layout *l, const lg_var *v, double *to) {
    for (size_t i = 0; i < l->count; i++)
        if (lg_read(k->tape, v[i], l->at[i + 1] - l->at[i], to + l->at[i]) != LG_OK) {
            if (lg_tape_status(k->tape) == LG_OK)
                lg_tape_fail(k->tape, LG_SHAPE, "gradcheck",
                             "the function's result has another shape than in the first recording");
            return tape_failed(k);
        }
    return LG_OK;
}

static bool on_manifold(const check *k, size_t i) {
    return i < k->f->inputs && k->f->arguments[i].algebra > 0;
}

/* Sets k->moved = x(h), the point moved by h along the direction d. */
static lg_status move(check *k, double h) {
    for (size_t i = 0; i < k->in.count; i++) {
        const double *x = k->x + k->in.at[i], *d = k->d + k->d_at[i];
        double *moved = k->moved + k->in.at[i];
        if (on_manifold(k, i)) LG_TRY(k->f->perturb(k->f->user, (uint32_t)i, x, d, h, moved));
        for (size_t j = 0; !on_manifold(k, i) && j < k->in.at[i + 1] - k->in.at[i]; j++)
            moved[j] = x[j] + h * d[j];
    }
    return LG_OK;
}

/* Sets y = f(x(h)); k->moved is x(h) afterwards. */
static lg_status evaluate(check *k, double h, double *y) {
    lg_var x[MAX_ARGUMENTS], v[MAX_ARGUMENTS];
    LG_TRY(move(k, h));
    lg_tape_reset(k->tape);
    place(k, k->moved, x);
    build(k, x, v);
    return read_all(k, &k->out, v, y);
}

/* ---- random points and directions ---- */

/* A random number not close to zero, so that no term of a derivative is hidden by a small factor. */
static double draw(check *k) {
    double size = lg_rng_uniform_in(&k->rng, 0.5, 1.0);
    return lg_rng_below(&k->rng, 2) == 0 ? size : -size;
}

static void draw_point(check *k) {
    for (size_t i = 0; i < k->f->inputs; i++) {
        const lg_gradcheck_argument *a = &k->f->arguments[i];
        bool plain = a->low == 0.0 && a->high == 0.0;
        for (size_t j = k->in.at[i]; j < k->in.at[i + 1]; j++)
            k->x[j] = a->values != NULL
                          ? a->values[j - k->in.at[i]]
                          : lg_rng_uniform_in(&k->rng, plain ? -1.0 : a->low, plain ? 1.0 : a->high);
    }
    for (size_t j = k->in.at[k->f->inputs]; j < total(&k->in); j++) k->x[j] = draw(k);
}

/* Draws d, dx and c. */
static lg_status draw_direction(check *k) {
    for (size_t i = 0; i < k->in.count; i++) {
        double scale = i < k->f->inputs && k->f->arguments[i].scale != 0.0 ? k->f->arguments[i].scale : 1.0;
        for (size_t j = k->d_at[i]; j < k->d_at[i + 1]; j++) k->d[j] = scale * draw(k);
        const double *d = k->d + k->d_at[i];
        double *dx = k->dx + k->in.at[i];
        if (on_manifold(k, i))
            LG_TRY(k->f->tangent(k->f->user, (uint32_t)i, k->x + k->in.at[i], d, dx));
        else
            memcpy(dx, d, (k->in.at[i + 1] - k->in.at[i]) * sizeof *d);
    }
    for (size_t j = 0; j < total(&k->out); j++) k->c[j] = draw(k);
    return LG_OK;
}

/* ---- derivatives computed by the tape ---- */

/* The scalar <c, y>, from which the backward pass starts. */
static lg_var weighted(check *k, const lg_var *y, const lg_var *c) {
    lg_var sum = LG_NONE;
    for (size_t i = 0; i < k->out.count; i++)
        sum = lg_add_or(k->tape, sum, lg_sum(k->tape, lg_mul(k->tape, y[i], c[i])));
    return sum;
}

/* Checks lg_backward_set and lg_backward together: sets the gradient in memory that holds NaN, adds the same
 * gradient, and halves the result. It equals the gradient exactly if lg_backward_set overwrote every NaN. */
static lg_status unrecorded(check *k, lg_var y, const lg_var *x, void *const *grad) {
    for (size_t j = 0; j < total(&k->in); j++) k->back[j] = NAN;
    LG_TRY(on_tape(k, lg_backward_set(k->tape, y, x, k->in.count, grad)));
    LG_TRY(on_tape(k, lg_backward(k->tape, y, x, k->in.count, grad)));
    for (size_t j = 0; j < total(&k->in); j++) k->back[j] *= 0.5;
    return LG_OK;
}

static lg_status derivatives(check *k) {
    lg_tape *tape = k->tape;
    lg_var x[MAX_ARGUMENTS], y[MAX_ARGUMENTS], c[MAX_ARGUMENTS], d[MAX_ARGUMENTS], found[MAX_ARGUMENTS];
    void *grad[MAX_ARGUMENTS];
    lg_tape_reset(tape);
    place(k, k->x, x);
    build(k, x, y);
    for (size_t i = 0; i < k->out.count; i++) c[i] = lg_input_f64(tape, k->out.shape[i], k->c + k->out.at[i]);
    for (size_t i = 0; i < k->in.count; i++) {
        d[i] = lg_input_f64(tape, k->in.shape[i], k->dx + k->in.at[i]);
        grad[i] = k->back + k->in.at[i];
    }
    LG_TRY(read_all(k, &k->out, y, k->y));
    LG_TRY(on_tape(k, lg_vjp(tape, y, c, k->out.count, x, k->in.count, found)));
    LG_TRY(read_all(k, &k->in, found, k->vjp));
    LG_TRY(on_tape(k, lg_jvp(tape, y, k->out.count, x, d, k->in.count, found)));
    LG_TRY(read_all(k, &k->out, found, k->jvp));
    return unrecorded(k, weighted(k, y, c), x, grad);
}

/* ---- the checks ---- */

static lg_status check_modes_agree(check *k) {
    double magnitude = 0.0;
    double forward = dot(k->c, k->jvp, total(&k->out), &magnitude);
    double reverse = dot(k->vjp, k->dx, total(&k->in), &magnitude);
    double error = magnitude > 0.0 ? fabs(forward - reverse) / magnitude : 0.0;
    if (!isfinite(forward) || !isfinite(reverse)) error = NAN;
    LG_TRY(judge(k, "<c, jvp(d)> differs from <vjp(c), d>", error, k->options->rounding_tolerance));

    const double most = lg_largest(k->vjp, total(&k->in)),
                 apart = lg_largest_difference(k->back, k->vjp, total(&k->in));
    return judge(k, "lg_backward differs from lg_vjp", apart == 0.0 ? 0.0 : apart / most,
                 k->options->rounding_tolerance);
}

/* Compares J d with central differences of steps h and h/2, extrapolated. */
static lg_status check_quotient(check *k) {
    size_t n = total(&k->out);
    double h = QUOTIENT_STEP;
    memset(k->quotient, 0, n * sizeof *k->quotient);
    static const double step[4] = {1.0, -1.0, 0.5, -0.5}, weight[4] = {-1.0, 1.0, 8.0, -8.0};
    for (int s = 0; s < 4; s++) {
        LG_TRY(evaluate(k, step[s] * h, k->work));
        for (size_t j = 0; j < n; j++) k->quotient[j] += weight[s] * k->work[j] / (6.0 * h);
    }
    const double size = fmax(lg_largest(k->jvp, n), lg_largest(k->quotient, n)) + 1e-6 * lg_largest(k->y, n),
                 apart = lg_largest_difference(k->quotient, k->jvp, n);
    return judge(k, "the jvp differs from the difference quotient", apart == 0.0 ? 0.0 : apart / size,
                 k->options->difference_tolerance);
}

/* Slope of log |R| over log h by regression through `n` points; h is halved from point to point, and the
 * first point has the largest h. */
static double slope_of(const double *log_remainder, int n) {
    double mean_h = 0.5 * (n - 1), mean_r = 0.0, above = 0.0, below = 0.0;
    for (int i = 0; i < n; i++) mean_r += log_remainder[i] / n;
    for (int i = 0; i < n; i++) {
        above += (i - mean_h) * (log_remainder[i] - mean_r);
        below += (i - mean_h) * (i - mean_h);
    }
    return -above / below;
}

/* Computes |R(h)|, and whether it is above rounding level (*usable). */
static lg_status remainder_at(check *k, double h, double *remainder, bool *usable) {
    LG_TRY(evaluate(k, h, k->work));
    double magnitude = 0.0, unused = 0.0, sum = 0.0;
    for (size_t j = 0; j < total(&k->out); j++) {
        sum += k->c[j] * (k->work[j] - k->y[j]);
        magnitude += fabs(k->c[j]) * (fabs(k->work[j]) + fabs(k->y[j]));
    }
    for (size_t j = 0; j < total(&k->in); j++) k->moved[j] -= k->x[j];
    (void)dot(k->vjp, k->x, total(&k->in), &magnitude);
    *remainder = fabs(sum - dot(k->vjp, k->moved, total(&k->in), &unused));
    *usable = *remainder > ROUNDING * magnitude;
    return isfinite(*remainder) ? LG_OK : failed(k, "a value is not finite", *remainder, 0.0);
}

/* The larger of |R(h)| and |R(-h)|. With R = a h^2 + b h^3 this is |a| h^2 + |b| h^3, whereas one side alone
 * is zero at h = -a/b, and no slope can be measured near a zero. */
static lg_status larger_remainder(check *k, double h, double *remainder, bool *usable) {
    double side[2];
    bool above[2];
    LG_TRY(remainder_at(k, h, &side[0], &above[0]));
    LG_TRY(remainder_at(k, -h, &side[1], &above[1]));
    *remainder = fmax(side[0], side[1]);
    *usable = above[0] || above[1];
    return LG_OK;
}

static lg_status check_slope(check *k) {
    double log_remainder[HALVINGS], h = FIRST_STEP;
    int end = 0;
    /* Stops after three steps in a row at rounding level, because all smaller steps will be at rounding
     * level, too. */
    for (int i = 0; i < HALVINGS && i < end + 3; i++, h *= 0.5) {
        double remainder;
        bool usable;
        LG_TRY(larger_remainder(k, h, &remainder, &usable));
        log_remainder[i] = log2(fmax(remainder, 1e-300));
        if (usable) end = i + 1;
    }
    if (end < SMALLEST_WINDOW)
        /* The function is linear up to rounding, and the other checks compare its derivatives. */
        return LG_OK;
    int first = end > WINDOW ? end - WINDOW : 0;
    double slope = slope_of(log_remainder + first, end - first);
    if (!(k->report->slope <= slope)) k->report->slope = slope;
    return slope >= k->options->slope
               ? LG_OK
               : failed(k, "the Taylor remainder falls too slowly", slope, k->options->slope);
}

/* ---- second order: symmetry ---- */

/* Computes <c, D^2 f[d, e]> in four ways. k->dx is d and k->moved is e, both without the part that belongs to
 * the cotangent argument. */
static lg_status check_symmetry(check *k) {
    lg_tape *tape = k->tape;
    uint32_t n = k->f->inputs;
    size_t size = k->in.at[n], outputs = total(&k->in) - size;
    lg_var x[MAX_ARGUMENTS], d[MAX_ARGUMENTS], e[MAX_ARGUMENTS], g[MAX_ARGUMENTS], h[MAX_ARGUMENTS], jd, jde;
    layout l = k->in;
    l.count = n;
    for (size_t j = 0; j < size; j++) k->moved[j] = draw(k);
    lg_tape_reset(tape);
    place(k, k->x, x);
    for (size_t i = 0; i < n; i++) {
        d[i] = lg_input_f64(tape, k->in.shape[i], k->dx + k->in.at[i]);
        e[i] = lg_input_f64(tape, k->in.shape[i], k->moved + k->in.at[i]);
    }
    lg_var y = build_first(k, x), c = x[n];
    double way[4], magnitude[4] = {0.0, 0.0, 0.0, 0.0};
    LG_TRY(on_tape(k, lg_jvp(tape, &y, 1, x, d, n, &jd)));
    LG_TRY(on_tape(k, lg_jvp(tape, &jd, 1, x, e, n, &jde)));
    LG_TRY(on_tape(k, lg_read(tape, jde, outputs, k->second)));
    way[0] = dot(k->x + size, k->second, outputs, &magnitude[0]);
    LG_TRY(on_tape(k, lg_vjp(tape, &jd, &c, 1, x, n, h)));
    LG_TRY(read_all(k, &l, h, k->second));
    way[1] = dot(k->second, k->moved, size, &magnitude[1]);
    LG_TRY(on_tape(k, lg_vjp(tape, &y, &c, 1, x, n, g)));
    LG_TRY(on_tape(k, lg_jvp(tape, g, n, x, e, n, h)));
    LG_TRY(read_all(k, &l, h, k->second));
    way[2] = dot(k->second, k->dx, size, &magnitude[2]);
    LG_TRY(on_tape(k, lg_jvp(tape, g, n, x, d, n, h)));
    LG_TRY(read_all(k, &l, h, k->second));
    way[3] = dot(k->second, k->moved, size, &magnitude[3]);
    for (int i = 1; i < 4; i++) {
        double error = way[i] == way[0] ? 0.0 : fabs(way[i] - way[0]) / fmax(magnitude[i], magnitude[0]);
        LG_TRY(judge(k, "the second derivative is not symmetric", error, k->options->rounding_tolerance));
    }
    return LG_OK;
}

/* ---- one order ---- */

static void release(check *k) {
    lg_free(k->context, k->memory);
    k->memory = NULL;
}

/* Makes the layouts, allocates memory and draws the point for this order. `first_output` is the shape of the
 * user's result. */
static lg_status prepare(check *k, int order, lg_shape first_output) {
    k->order = order;
    k->report = &k->result->order[order - 1];
    k->in = k->out = (layout){0};
    for (uint32_t i = 0; i < k->f->inputs; i++) append_shape(&k->in, k->f->arguments[i].shape);
    if (order == 1) append_shape(&k->out, first_output);
    if (order == 2) {
        k->out = k->in;
        append_shape(&k->in, first_output);
    }
    k->d_at[0] = 0;
    for (size_t i = 0; i < k->in.count; i++)
        k->d_at[i + 1] =
            k->d_at[i] + (on_manifold(k, i) ? k->f->arguments[i].algebra : k->in.at[i + 1] - k->in.at[i]);
    size_t inputs = total(&k->in), outputs = total(&k->out), directions = k->d_at[k->in.count];
    k->memory = lg_alloc(k->context, 6 * inputs + 5 * outputs + directions, sizeof *k->memory);
    if (k->memory == NULL) return LG_OUT_OF_MEMORY;
    double *at = k->memory;
    double **of_inputs[] = {&k->x, &k->moved, &k->dx, &k->vjp, &k->back, &k->second};
    double **of_outputs[] = {&k->c, &k->y, &k->jvp, &k->quotient, &k->work};
    for (size_t i = 0; i < LG_COUNT(of_inputs); i++, at += inputs) *of_inputs[i] = at;
    for (size_t i = 0; i < LG_COUNT(of_outputs); i++, at += outputs) *of_outputs[i] = at;
    k->d = at;
    lg_rng_seed(&k->rng, k->options->seed, (uint64_t)order);
    draw_point(k);
    return LG_OK;
}

static lg_status check_direction(check *k) {
    LG_TRY(draw_direction(k));
    LG_TRY(derivatives(k));
    double most = fmax(lg_largest(k->vjp, total(&k->in)), lg_largest(k->jvp, total(&k->out)));
    if (!(most <= k->report->derivative)) k->report->derivative = most;
    LG_TRY(check_modes_agree(k));
    if (k->f->stops) return most == 0.0 ? LG_OK : failed(k, "the derivative is not zero", most, 0.0);
    LG_TRY(check_quotient(k));
    LG_TRY(check_slope(k));
    return k->order == 2 ? check_symmetry(k) : LG_OK;
}

static lg_status check_order(check *k, int order, lg_shape first_output) {
    lg_status status = prepare(k, order, first_output);
    k->report->checked = true;
    k->report->slope = NAN;
    for (int i = 0; i < k->options->directions && status == LG_OK; i++) status = check_direction(k);
    k->report->passed = status == LG_OK;
    release(k);
    return status;
}

/* For a function with a numeric derivative inside: checks that the second order is refused. */
static lg_status check_refusal(check *k, lg_shape first_output) {
    lg_status status = prepare(k, 2, first_output);
    if (status == LG_OK) status = draw_direction(k);
    if (status == LG_OK) status = derivatives(k);
    release(k);
    if (status == LG_OK)
        return failed(
            k, "a second derivative was computed, but the function is declared as differentiable once only",
            2, 1);
    if (status != LG_NOT_DIFFERENTIABLE) return status;
    k->result->message[0] = '\0';
    return LG_OK;
}

/* ---- the whole check ---- */

bool lg_gradcheck_valid(const lg_gradcheck_function *f, const lg_gradcheck_options *o) {
    if (f == NULL || f->name == NULL || f->build == NULL || f->arguments == NULL || f->inputs == 0 ||
        f->inputs > LG_GRADCHECK_MAX_INPUTS)
        return false;
    for (uint32_t i = 0; i < f->inputs; i++) {
        const lg_gradcheck_argument *a = &f->arguments[i];
        size_t count = lg_shape_count(a->shape);
        if (a->shape.rank > LG_MAX_RANK || count > SIZE_MAX / 4096) return false;
        if (a->algebra > 0 && (f->perturb == NULL || f->tangent == NULL || a->values == NULL)) return false;
    }
    return o->size == sizeof *o && o->order >= 1 && o->order <= LG_GRADCHECK_ORDERS && o->directions >= 1;
}

/* Refuses operations outside the table of operations, because they would not have checks of their own. */
static lg_status in_table(check *k) {
    for (uint32_t i = 0; i < k->tape->count; i++) {
        const char *name = k->tape->nodes[i].op->name;
        if (lg_op_place(k->tape->nodes[i].op) < LG_OPS_MOST) continue;
        (void)snprintf(k->result->message, sizeof k->result->message,
                       "%.80s: the operation '%.40s' is not in the table of operations", k->f->name, name);
        return LG_UNSUPPORTED;
    }
    return LG_OK;
}

/* Finds the shape of the user's result by recording the function once. */
static lg_status learn_shape(check *k, lg_shape *shape) {
    LG_TRY(prepare(k, 1, lg_shape0()));
    lg_var x[MAX_ARGUMENTS], y;
    place(k, k->x, x);
    build(k, x, &y);
    const lg_node *node = lg_node_of(k->tape, y, "gradcheck");
    if (node != NULL) *shape = node->shape;
    const lg_status status = node != NULL ? in_table(k) : tape_failed(k);
    release(k);
    return status;
}

lg_status lg_gradcheck_exchanged(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, lg_exchange exchange,
                                 lg_gradcheck_result *result) {
    lg_gradcheck_options chosen;
    lg_gradcheck_options_init(&chosen);
    if (result == NULL) return LG_INVALID_ARGUMENT;
    *result = (lg_gradcheck_result){0};
    if (options != NULL) chosen = *options;
    if (!lg_gradcheck_valid(function, &chosen)) {
        (void)snprintf(result->message, sizeof result->message,
                       "gradcheck: a member of the function or of the options is missing or out of range");
        return LG_INVALID_ARGUMENT;
    }
    check k = {.context = context, .f = function, .options = &chosen, .result = result};
    lg_shape shape = lg_shape0();
    lg_status status = lg_tape_create(context, NULL, &k.tape);
    if (status == LG_OK) k.tape->exchange = exchange;
    if (status == LG_OK) status = learn_shape(&k, &shape);
    if (status == LG_OK) status = check_order(&k, 1, shape);
    if (status == LG_OK && chosen.order == 2)
        status = function->first_order_only ? check_refusal(&k, shape) : check_order(&k, 2, shape);
    result->passed = status == LG_OK;
    if (status != LG_OK && result->message[0] == '\0')
        (void)snprintf(result->message, sizeof result->message, "%.80s: %s", function->name,
                       lg_status_sentence(status));
    lg_tape_destroy(k.tape);
    return status;
}

lg_status lg_gradcheck(const lg_context *context, const lg_gradcheck_function *function,
                       const lg_gradcheck_options *options, lg_gradcheck_result *result) {
    return lg_gradcheck_exchanged(context, function, options, (lg_exchange){NULL, NULL}, result);
}
