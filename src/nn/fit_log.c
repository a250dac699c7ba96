/* Fits a step function of a program to a log. A window of the log begins in an unknown state s:
 *   x_0 = s,  x_j+1 = step(x_j, u_j, h_j),  r_j = (seen(x_j) - y_j)/scale.
 * The derivatives S_j of x_j with respect to the parameters and s follow from
 *   S_0 = (0, 1),  S_j+1 = A_j S_j + (B_j, 0),
 * where A_j and B_j are the derivatives of step with respect to x and the parameters. They are computed for
 * many rows at once, when the states are known. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "kernels/matrix.h"
#include "nn/fit_internal.h"

enum { MOST_EVALUATIONS = 200, MOST_ROUNDS = 8, TOGETHER = 1024, MOST_NUMBERS = 1 << 21 };

typedef struct called { /* a function of the program */
    size_t function, width,
        inputs; /* width: numbers of its output in a row; inputs: 0 for the state itself */
    const lg_port *in;
} called;

typedef struct fitting {
    const lg_context *context;
    const lg_program *program;
    const lg_program_log *log;
    called step, seen;
    size_t n, m, k, p, columns; /* states, inputs, measured values, parameters; columns: p + n */
    size_t windows, longest;    /* windows; rows of the longest one */
    size_t *first;              /* (windows + 1): first rows; window w ends where the next one begins */
    double *h;                  /* (rows): time to the next row; 0 in the last row of a run */
    double *scale, *deviation;  /* (k): unit of the residuals; standard deviation of the measured values */
    double *count;              /* (k): measured values, `measured` in all */
    double measured;
    bool still; /* the parameters keep their values; only starts move */
} fitting;

/* ---- residuals ---- */

/* derivative (rows, width, columns): of `value` with respect to the parameters and the states. */
static lg_status differentiate(const fitting *f, lg_tape *tape, size_t width, lg_var value, lg_var theta,
                               lg_var x, size_t rows, double *derivative) {
    LG_TRY_SCRATCH(double, by_theta, f->context, rows * f->columns, LG_OUT_OF_MEMORY);
    double *by_x = by_theta + rows * f->p;
    const lg_var all = lg_reshape(tape, value, lg_shape2((uint32_t)rows, (uint32_t)width));
    for (uint32_t i = 0; i < width; i++) {
        const lg_mark mark = lg_tape_mark(tape);
        const lg_var sum = lg_sum(tape, lg_slice(tape, all, 1, i, 1));
        LG_TRY(lg_backward_rows(tape, sum, x, by_x, theta, rows, by_theta));
        for (size_t row = 0; row < rows; row++) {
            double *to = derivative + (row * width + i) * f->columns;
            memcpy(to, by_theta + row * f->p, f->p * sizeof *to);
            memcpy(to + f->p, by_x + row * f->n, f->n * sizeof *to);
        }
        LG_TRY(lg_tape_rewind(tape, mark));
    }
    return LG_OK;
}

/* The values of a function at `rows` rows of the log from `first` on, in the states x (rows, n), and unless
 * it is NULL their derivative, which is zeros before. */
static lg_status evaluate(const fitting *f, lg_tape *tape, const called *c, const double *theta, size_t first,
                          size_t rows, const double *x, double *value, double *derivative) {
    lg_var parameters[LG_PROGRAM_FIT_MOST], in[3], out[LG_PROGRAM_FIT_MOST];
    if (c->inputs == 0) {
        memcpy(value, x, rows * f->n * sizeof *value);
        for (size_t i = 0; derivative != NULL && i < rows * f->n; i++)
            derivative[i * f->columns + f->p + i % f->n] = 1.0;
        return LG_OK;
    }
    const double *const from[] = {x, f->m > 0 ? f->log->u + first * f->m : f->h + first, f->h + first};
    lg_tape_reset(tape);
    const lg_var all = lg_parameter(tape, lg_shape1((uint32_t)f->p), theta);
    lg_fit_slice(tape, f->program, all, parameters);
    for (size_t i = 0; i < c->inputs; i++) {
        in[i] = lg_input_f64(tape, lg_port_shape(&c->in[i], rows), from[i]);
        lg_tape_mark_rows(tape, in[i]);
    }
    LG_TRY(lg_program_record(tape, f->program, c->function, parameters, in, out));
    LG_TRY(lg_read(tape, out[0], rows * c->width, value));
    return derivative == NULL ? LG_OK
                              : differentiate(f, tape, c->width, out[0], all, in[0], rows, derivative);
}

/* out (width, columns) = D_x S + (D_theta, 0), for derivatives D (width, columns) of a function. */
static void chain(const fitting *f, size_t width, const double *D, const double *S, double *out) {
    const size_t c = f->columns;
    for (size_t i = 0; i < width; i++, D += c, out += c) {
        memset(out, 0, c * sizeof *out);
        memcpy(out, D, f->p * sizeof *out);
        for (size_t k = 0; k < f->n; k++) lg_kernels_for(LG_F64)->axpy(c, D[f->p + k], S + k * c, out);
    }
}

/* Residuals (longest, k) of a window, times `factor`, and unless it is NULL their Jacobian. Values that were
 * not measured, and rows after the end, have the residual 0. */
static lg_status follow(const fitting *f, lg_tape *tape, const double *theta, uint32_t window, double factor,
                        double *r, double *J) {
    const size_t n = f->n, k = f->k, c = f->columns, first = f->first[window],
                 rows = f->first[window + 1] - first, derived = J != NULL ? rows * c : 0;
    LG_TRY_SCRATCH(double, x, f->context, rows *(2 * n + k) + derived * (n + k) + 2 * n * c,
                   LG_OUT_OF_MEMORY);
    double *next = x + rows * n, *y = next + rows * n, *S = y + rows * k, *moved = S + n * c,
           *of_next = moved + n * c, *of_y = of_next + derived * n;
    memcpy(x, theta + f->p + window * n, n * sizeof *x);
    for (size_t j = 0; j + 1 < rows; j++)
        LG_TRY(evaluate(f, tape, &f->step, theta, first + j, 1, x + j * n, x + (j + 1) * n, NULL));
    for (size_t j = 0; j < rows; j += TOGETHER) {
        const size_t some = rows - j < TOGETHER ? rows - j : TOGETHER;
        double *const to = J != NULL ? of_y + j * k * c : NULL;
        LG_TRY(evaluate(f, tape, &f->seen, theta, first + j, some, x + j * n, y + j * k, to));
        if (J != NULL)
            LG_TRY(evaluate(f, tape, &f->step, theta, first + j, some, x + j * n, next, of_next + j * n * c));
    }
    memset(r, 0, f->longest * k * sizeof *r);
    if (J != NULL) memset(J, 0, f->longest * k * c * sizeof *J);
    for (size_t j = 0; j < n; j++) S[j * c + f->p + j] = 1.0;
    for (size_t j = 0; j < rows; j++) {
        double *const row = J != NULL ? J + j * k * c : NULL;
        if (J != NULL) chain(f, k, of_y + j * k * c, S, row);
        for (size_t o = 0; o < k; o++) {
            const double measured = f->log->y[(first + j) * k + o];
            const double weight = isnan(measured) ? 0.0 : factor / f->scale[o];
            if (weight > 0.0) r[j * k + o] = weight * (y[j * k + o] - measured);
            for (size_t i = 0; J != NULL && i < c; i++)
                row[o * c + i] = weight > 0.0 && (i >= f->p || !f->still) ? weight * row[o * c + i] : 0.0;
        }
        if (J == NULL) continue;
        chain(f, n, of_next + j * n * c, S, moved);
        memcpy(S, moved, n * c * sizeof *S);
    }
    return LG_OK;
}

/* The loss is the mean square of all residuals. */
static lg_status linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                           size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    const fitting *f = user;
    const size_t each = f->longest * f->k;
    for (size_t i = 0; i < count; i++)
        LG_TRY(follow(f, tape, theta, samples[i], sqrt((double)f->windows / (double)batch / f->measured),
                      r + i * each, jacobian + i * each * f->columns));
    *loss = lg_fit_dot(r, r, count * each);
    return LG_OK;
}

/* ---- set-up ---- */

/* Checks the log and cuts its runs into windows, which are almost equal within a run. */
static lg_status cut(fitting *f, lg_error *error) {
    const lg_program_log *log = f->log;
    const size_t zero = 0, *first = log->first != NULL ? log->first : &zero,
                 runs = log->first != NULL ? log->runs : 1;
    size_t longest = 0;
    for (size_t run = 0; run < runs; run++) {
        const size_t begin = first[run], end = run + 1 < runs ? first[run + 1] : log->rows,
                     rows = end - begin, most = log->window > 0 ? log->window : rows;
        if (end <= begin || end > log->rows || first[0] != 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "run %zu of the log, from row %zu on, has no rows",
                           run, begin);
        const size_t count = (rows + most - 1) / most, each = (rows + count - 1) / count;
        for (size_t i = 0; i < count; i++) f->first[f->windows++] = begin + rows * i / count;
        for (size_t i = begin; i + 1 < end; i++) {
            f->h[i] = log->t[i + 1] - log->t[i];
            if (!(f->h[i] > 0.0 && isfinite(f->h[i])))
                return lg_fail(error, LG_INVALID_ARGUMENT, "row %zu of the log: the time %g does not rise",
                               i + 1, log->t[i + 1]);
        }
        longest = rows > longest ? rows : longest;
        f->longest = each > f->longest ? each : f->longest;
    }
    f->first[f->windows] = log->rows;
    if (log->window == 1 || log->window > longest)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "a window of %zu rows is not possible: a window has at least 2 rows, and at most the %zu "
            "rows of the longest run",
            log->window, longest);
    for (size_t i = 0; i < log->rows * f->m; i++)
        if (!isfinite(log->u[i]))
            return lg_fail(error, LG_NOT_FINITE, "row %zu of the log: an input is not finite", i / f->m);
    for (size_t i = 0; i < log->rows * f->k; i++)
        if (isinf(log->y[i]))
            return lg_fail(error, LG_NOT_FINITE, "row %zu of the log: a measured value is infinite",
                           i / f->k);
    return LG_OK;
}

static lg_status open_function(const fitting *f, const char *name, const char *ports, called *out,
                               lg_error *error) {
    size_t outputs;
    LG_TRY(lg_program_find(f->program, name, &out->function, error));
    const lg_port *output = lg_program_outputs(f->program, out->function, &outputs);
    out->in = lg_program_inputs(f->program, out->function, &out->inputs);
    out->width = lg_shape_count(output->shape);
    bool fits =
        !output->shared && (f->n == 0 || (out->inputs == 1 && lg_shape_count(out->in[0].shape) == f->n));
    if (f->n == 0) /* step */
        fits = fits && (out->inputs == 2 || out->inputs == 3) &&
               lg_shape_count(out->in[0].shape) == out->width &&
               lg_shape_count(out->in[out->inputs - 1].shape) == 1;
    for (size_t i = 0; i < out->inputs; i++) fits = fits && !out->in[i].shared;
    return fits ? LG_OK : lg_fail(error, LG_SHAPE, "'%s' is not a function %s", name, ports);
}

static lg_status open_functions(fitting *f, const char *step, const char *seen, lg_error *error) {
    LG_TRY(open_function(f, step, "x (n), u (m), h (1) -> x (n), where u may be missing", &f->step, error));
    f->n = f->seen.width = f->step.width;
    f->m = f->step.inputs == 3 ? lg_shape_count(f->step.in[1].shape) : 0;
    if (seen != NULL) LG_TRY(open_function(f, seen, "x (n) -> y (k) of the same state", &f->seen, error));
    f->k = f->seen.width;
    f->p = lg_fit_take(f->program, NULL);
    f->columns = f->p + f->n;
    if (f->p > 0 && lg_program_parameters(f->program) <= LG_PROGRAM_FIT_MOST && f->n <= LG_FIT_MOST_OWN &&
        f->k <= LG_FIT_MOST_OWN)
        return LG_OK;
    return lg_fail(error, LG_UNSUPPORTED,
                   "the program has no parameters or more than %d, or more than %d states or measured values",
                   LG_PROGRAM_FIT_MOST, LG_FIT_MOST_OWN);
}

/* Starts of the windows: the caller's guess, or where a measured value depends on one state alone, the state
 * that gives this value; otherwise 0. */
static lg_status guess(const fitting *f, lg_tape *tape, double *theta) {
    LG_TRY_SCRATCH(double, D, f->context, f->k * f->columns + f->k + f->n, LG_OUT_OF_MEMORY);
    double *value = D + f->k * f->columns, *zero = value + f->k;
    LG_TRY(evaluate(f, tape, &f->seen, theta, 0, 1, zero, value, D));
    for (size_t w = 0; w < f->windows; w++) {
        double *x = theta + f->p + w * f->n;
        if (f->log->guess != NULL) memcpy(x, f->log->guess + f->first[w] * f->n, f->n * sizeof *x);
        for (size_t o = 0; o < f->k && f->log->guess == NULL; o++) {
            const double *row = D + o * f->columns + f->p;
            size_t only = 0, some = 0;
            for (size_t j = 0; j < f->n; j++)
                if (row[j] != 0.0) only = j, some++;
            const double there = (f->log->y[f->first[w] * f->k + o] - value[o]) / row[only];
            if (some == 1 && isfinite(there)) x[only] = there;
        }
    }
    return LG_OK;
}

/* Counts the measured values; their standard deviations are the first units. */
static void measure(fitting *f) {
    for (size_t o = 0; o < f->k; o++) {
        double sum = 0.0, squares = 0.0;
        for (int pass = 0; pass < 2; pass++)
            for (size_t i = o; i < f->log->rows * f->k; i += f->k) {
                const double y = f->log->y[i];
                if (isnan(y)) continue;
                if (pass == 0) f->count[o]++, sum += y;
                if (pass == 1) squares += pow(y - sum / f->count[o], 2.0);
            }
        f->measured += f->count[o];
        f->deviation[o] = squares > 0.0 ? sqrt(squares / f->count[o]) : 1.0;
        f->scale[o] = f->log->scale != NULL ? f->log->scale[o] : f->deviation[o];
    }
}

/* ---- the fit ---- */

static lg_fit_problem problem_of(fitting *f) {
    const size_t each = f->longest * f->k, room = MOST_NUMBERS / (each * f->columns) + 1;
    return (lg_fit_problem){.parameters = f->p + f->windows * f->n,
                            .samples = f->windows,
                            .user = f,
                            .own = f->n,
                            .linearise = linearise,
                            .rows = each,
                            .chunk = room < LG_FIT_CHUNK ? room : LG_FIT_CHUNK};
}

/* noise (k): standard deviations of the residuals, for as many degrees of freedom as the fit leaves. */
static lg_status find_noise(fitting *f, lg_tape *tape, const double *theta, double *noise) {
    const size_t each = f->longest * f->k;
    const double left = 1.0 - (double)(f->p + f->windows * f->n) / f->measured;
    LG_TRY_SCRATCH(double, r, f->context, each, LG_OUT_OF_MEMORY);
    memset(noise, 0, f->k * sizeof *noise);
    for (uint32_t w = 0; w < f->windows; w++) {
        LG_TRY(follow(f, tape, theta, w, 1.0, r, NULL));
        for (size_t i = 0; i < each; i++) noise[i % f->k] += r[i] * r[i];
    }
    for (size_t o = 0; o < f->k; o++)
        noise[o] = f->count[o] > 0.0 ? f->scale[o] * sqrt(noise[o] / f->count[o] / left) : NAN;
    return LG_OK;
}

static lg_status minimise(fitting *f, const lg_fit_options *options, double *theta,
                          lg_program_log_result *out, lg_error *error) {
    const lg_fit_problem problem = problem_of(f);
    LG_CLEAN(lg_fit_destroy_at) lg_fit *fit = NULL;
    LG_TRY(lg_fit_create(f->context, &problem, options, theta, &fit, error));
    LG_TRY(lg_fit_run(fit, error));
    lg_fit_parameters(fit, theta);
    out->epochs += lg_fit_epochs_done(fit);
    out->end = lg_fit_end_sentence(fit);
    return LG_OK;
}

/* Repeats the fit with the noise that it found as scales until these settle: the most probable parameters for
 * normal noise. Before this, only the starts are fitted: with poor starts the parameters may run away. */
static lg_status settle(fitting *f, const lg_fit_options *options, lg_tape *tape, double *theta,
                        lg_program_log_result *out, lg_error *error) {
    static const double settled = 1e-3, rounding = 1e-9;
    double low = 0.0, high = 1.0;
    f->still = true;
    LG_TRY(minimise(f, options, theta, out, error));
    f->still = false;
    for (int round = 0; round < MOST_ROUNDS && high > (1.0 + settled) * low; round++) {
        LG_TRY(minimise(f, options, theta, out, error));
        LG_TRY(find_noise(f, tape, theta, out->noise));
        low = INFINITY, high = 0.0;
        for (size_t o = 0; o < f->k && f->log->scale == NULL; o++) {
            const double next = fmax(out->noise[o], rounding * f->deviation[o]), ratio = next / f->scale[o];
            low = fmin(low, f->count[o] > 0.0 ? ratio : INFINITY);
            high = fmax(high, f->count[o] > 0.0 ? ratio : 0.0);
            f->scale[o] = next;
        }
    }
    return LG_OK;
}

/* The errors after the sums over windows. A parameter is not determined if the others and the starts can
 * imitate it to 1e-6. */
static lg_status conclude(lg_fit_errors *s, double *W, int *order, lg_program_log_result *out) {
    static const double far = 1e8, lost = 1e6;
    const size_t n = s->n;
    for (size_t i = 0; i < n; i++)
        s->bound[i] = s->lengths[i] > 0.0 ? far * sqrt(lg_fit_errors_variance(s) / s->lengths[i]) : 1.0;
    LG_TRY(lg_fit_errors_invert(s, W + n * n, order, W));
    LG_TRY(lg_fit_errors_colour(s, W, &out->block));
    lg_matrix_multiply_tn(n, n, n, W, W, out->covariance);
    for (size_t i = 0; i < n; i++) {
        out->error[i] = sqrt(out->covariance[i * n + i]);
        if (out->error[i] <= lost / far * s->bound[i] && s->lengths[i] > 0.0) continue;
        for (size_t j = 0; j < n; j++) out->covariance[i * n + j] = out->covariance[j * n + i] = 0.0;
        out->error[i] = out->covariance[i * n + i] = INFINITY;
        out->open++;
    }
    return LG_OK;
}

static lg_status find_errors(fitting *f, const double *theta, lg_program_log_result *out, lg_error *error) {
    LG_TRY_SCRATCH(double, lengths, f->context, (4 * f->p + 1) * f->p, lg_no_memory(error));
    LG_TRY_SCRATCH(int, order, f->context, f->p, lg_no_memory(error));
    lg_fit_errors s = {.context = f->context, .fit = problem_of(f), .theta = theta, .lengths = lengths};
    s.n = f->p, s.each = f->k, s.windows = s.used = f->windows;
    for (size_t i = 0; i < f->k; i++) s.worth[i] = 1.0;
    for (size_t i = 0; i < f->log->rows; i++) s.seconds += f->h[i];
    lg_status status = lg_fit_errors_gather(&s, true);
    if (status == LG_OK) status = conclude(&s, lengths + f->p, order, out);
    return lg_fit_errors_end(&s, status, error);
}

static lg_status fit(fitting *f, const lg_fit_options *given, double *theta, lg_program_log_result *out,
                     lg_error *error) {
    lg_fit_options options;
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    measure(f);
    if (f->measured <= (double)(f->p + f->windows * f->n))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "%.0f measured values cannot determine %zu parameters and %zu starts of %zu states each: "
            "take longer windows or a longer log",
            f->measured, f->p, f->windows, f->n);
    lg_fit_options_init(&options);
    options.epochs = MOST_EVALUATIONS;
    if (given != NULL) options = *given;
    options.plan = (lg_fit_plan){.phases = 1, .phase = {{.method = LG_FIT_LM}}};
    LG_TRY(lg_tape_create(f->context, NULL, &tape));
    lg_status status = guess(f, tape, theta);
    if (status == LG_OK) status = settle(f, &options, tape, theta, out, error);
    if (lg_tape_status(tape) != LG_OK) return lg_tape_conclude(tape, status, error);
    LG_TRY(status);
    for (size_t o = 0; o < f->k; o++)
        if (f->count[o] > 0.0)
            out->loss += pow(out->noise[o] / f->deviation[o], 2.0) * f->count[o] / f->measured;
    return find_errors(f, theta, out, error);
}

lg_status lg_program_fit_log(const lg_context *context, lg_program *program, const char *step,
                             const char *seen, const lg_program_log *log, const lg_fit_options *options,
                             lg_program_log_result *result, lg_error *error) {
    LG_NEEDS(error, program, step, log, result);
    fitting f = {.context = context, .program = program, .log = log};
    LG_TRY(open_functions(&f, step, seen, error));
    if (log->t == NULL || log->y == NULL || (log->u == NULL && f.m > 0) || log->rows >= UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the log has no t, no y, no u or too many rows");
    LG_TRY_SCRATCH(size_t, first, context, log->rows + 1, lg_no_memory(error));
    LG_TRY_SCRATCH(double, h, context, log->rows + 1, lg_no_memory(error));
    f.first = first, f.h = h;
    LG_TRY(cut(&f, error));
    const size_t p = f.p, k = f.k, all = p + f.windows * f.n;
    lg_program_log_result to = *result, made = {.end = ""};
    LG_TRY_SCRATCH(double, theta, context, all + p + 4 * k + p * p, lg_no_memory(error));
    made.error = theta + all, made.noise = made.error + p, made.covariance = made.noise + k;
    f.scale = made.covariance + p * p, f.deviation = f.scale + k, f.count = f.deviation + k;
    (void)lg_fit_take(program, theta);
    LG_TRY(fit(&f, options, theta, &made, error));
    LG_TRY(lg_fit_give(program, theta));
    if (to.error != NULL) memcpy(to.error, made.error, p * sizeof *theta);
    if (to.noise != NULL) memcpy(to.noise, made.noise, k * sizeof *theta);
    if (to.covariance != NULL) memcpy(to.covariance, made.covariance, p * p * sizeof *theta);
    made.error = to.error, made.noise = to.noise, made.covariance = to.covariance;
    return LG_GIVE(result, made);
}
