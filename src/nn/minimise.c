/* The minimiser as a state machine: what happens between two evaluations, and why a run ends. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "liegrad/core.h"
#include "nn/minimise_internal.h"

enum { CHECK_POINTS = 4, CHECK_LEVELS = 4, MOST_ENDLESS = 3, TINY_EACH = 8, MOST_CRAWLS = 10 };
static const double SLOW_DECREASE = 1e-4, FIRST_STEP = 0.1, LONGEST_STEP = 3.0, LOWEST = -1e300,
                    ROUNDED = 1e-14, FEW = 50.0, TINY = 1e-48, CRAWL = 3e-4, FORESEEN = 10.0;
/* relative to 1 + |x_i|; factor from a level to the next */
static const double CHECK_STEP = 1e-4, CHECK_FINER = 1e-2;
static const double CHECK_TOLERANCE = 1e-3, CHECK_ROUNDING = 1e-13, CHECK_ROUGH = 10.0;

/* X(name) for each row lg_minimise_<name>, in the order of lg_minimise_method. Further rows may follow that
 * the enum does not name; training finds them by name. */
#define METHODS(X)    X(ssbroyden) X(lbfgs) X(lm)
#define DECLARE(name) extern const lg_minimise_row lg_minimise_##name;
#define LIST(name)    &lg_minimise_##name,
METHODS(DECLARE)
static const lg_minimise_row *const methods[] = {METHODS(LIST)};

const lg_minimise_row *lg_minimise_row_at(size_t index) {
    return index < LG_COUNT(methods) ? methods[index] : NULL;
}

static const struct {
    lg_status status;
    const char *sentence;
} ends[LG_MINIMISE_END_COUNT] = {
    [LG_MINIMISE_RUNNING] = {LG_OK, ""},
    [LG_MINIMISE_EVALUATIONS] = {LG_OK, "the evaluations are used up"},
    [LG_MINIMISE_SECONDS] = {LG_OK, "the time is used up"},
    [LG_MINIMISE_GRADIENT] = {LG_OK, "the gradient is zero within the tolerance"},
    [LG_MINIMISE_SLOW] = {LG_OK,
                          "many iterations together lowered the value by a relative amount below 1e-4"},
    [LG_MINIMISE_ROUNDING] = {LG_OK, "no step lowers the value any more: rounding is the limit"},
    [LG_MINIMISE_CANCELLED] = {LG_CANCELLED, "the caller asked to stop"},
    [LG_MINIMISE_UNBOUNDED] = {LG_NO_CONVERGENCE, "the function decreases without bound along a direction"},
    [LG_MINIMISE_NOT_FINITE] = {LG_NOT_FINITE, "the value or the gradient is not finite at the start"},
    [LG_MINIMISE_WRONG_GRADIENT] = {LG_CHECK_FAILED,
                                    "the gradient disagrees with differences of the function"},
    [LG_MINIMISE_WRONG_JACOBIAN] = {LG_CHECK_FAILED,
                                    "the Jacobian disagrees with differences of the residuals"},
    [LG_MINIMISE_BARRIER] = {LG_OK, "no step lowers the value: it is not finite beyond the last point"},
    [LG_MINIMISE_STUCK] = {LG_NO_CONVERGENCE,
                           "no step lowers the value much, and nothing shows that the point is a minimum"},
    [LG_MINIMISE_LIMIT] = {LG_NO_CONVERGENCE, "10000 evaluations did not find a minimum"},
};

const char *lg_minimise_end_sentence(lg_minimise_end end) {
    return (int)end >= 0 && (int)end < LG_MINIMISE_END_COUNT ? ends[end].sentence : "";
}

lg_status lg_minimise_end_status(lg_minimise_end end) {
    return (int)end >= 0 && (int)end < LG_MINIMISE_END_COUNT ? ends[end].status : LG_INVALID_ARGUMENT;
}

void lg_minimise_options_init(lg_minimise_options *options) {
    *options = (lg_minimise_options){
        .size = sizeof *options, .method = LG_MINIMISE_SSBROYDEN, .memory = 50, .check = true};
}

/* ---- creation ---- */

static lg_status check_options(size_t n, const lg_minimise_options *o, lg_error *error) {
    if (o->size != sizeof *o)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the size of the options of minimisation is %zu, expected %zu", o->size, sizeof *o);
    if (n == 0 || n > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu variables; 1 to 2^32 - 1 are possible", n);
    if (lg_minimise_row_at((size_t)o->method) == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the method of minimisation is unknown");
    if (o->block > 0 && o->blocks > n / o->block)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu blocks of %zu are more than %zu variables", o->blocks,
                       o->block, n);
    if (o->memory < 1 || o->memory > 1000)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the memory of L-BFGS must be 1 to 1000 pairs");
    if (!(o->gradient_tolerance >= 0.0) || !(o->seconds >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "tolerance and seconds must not be negative");
    return LG_OK;
}

enum { ROWS = 64 };

void lg_minimise_rows(uint32_t rank, uint32_t ranks, size_t n, size_t *first, size_t *end) {
    const size_t blocks = n / ROWS > 0 ? n / ROWS : 1;
    lg_ranks_part(rank, ranks, blocks, first, end);
    *first *= ROWS;
    *end = *end == blocks ? n : *end * ROWS;
    if (*first > *end) *first = *end;
}

static lg_status allocate(lg_minimiser *m) {
    enum { VECTORS = 6 };
    const lg_ranks *ranks = m->options.ranks;
    const size_t stride = lg_minimise_stride(m->n);
    m->length = m->held = m->row->length(m->n, &m->options);
    if (m->length > SIZE_MAX / sizeof(double) - VECTORS * stride) return LG_OUT_OF_MEMORY;
    m->end = m->n;
    if (ranks != NULL && m->row->by_rows) {
        lg_minimise_rows(ranks->rank, ranks->count, m->n, &m->first, &m->end);
        m->held -= (m->n - (m->end - m->first)) * stride;
    }
    LG_TRY(LG_ALLOC_ALL(m->context, LG_ARRAY(m->memory, VECTORS * stride + m->held),
                        LG_ARRAY(m->bytes, ranks != NULL ? ranks->count : 1)));
    double **const vectors[VECTORS] = {&m->x, &m->g, &m->d, &m->point, &m->s, &m->y};
    for (size_t i = 0; i < VECTORS; i++) *vectors[i] = m->memory + i * stride;
    m->curvature = m->memory + VECTORS * stride;
    return LG_OK;
}

lg_status lg_minimiser_create(const lg_context *context, size_t n, const lg_minimise_options *options,
                              const double *x, lg_minimiser **out, lg_error *error) {
    lg_minimise_options chosen;
    lg_minimise_options_init(&chosen);
    if (options != NULL) chosen = *options;
    if (x == NULL || out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "x or `out` is NULL");
    LG_TRY(check_options(n, &chosen, error));
    const lg_kernels *k = lg_kernels_for(LG_F64);
    if (!k->all_finite(n, x)) return lg_fail(error, LG_NOT_FINITE, "the point to start from is not finite");
    lg_minimiser *m = lg_alloc(context, 1, sizeof *m);
    if (m == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory to minimise in %zu variables", n);
    m->context = context;
    m->k = k;
    m->options = chosen;
    m->row = methods[chosen.method];
    m->n = n;
    if (allocate(m) != LG_OK) {
        lg_minimiser_destroy(m);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory to minimise in %zu variables by %s", n,
                       methods[chosen.method]->name);
    }
    memcpy(m->x, x, n * sizeof *x);
    memcpy(m->point, x, n * sizeof *x);
    *out = m;
    return LG_OK;
}

lg_status lg_minimiser_status(const lg_minimiser *m) {
    return m != NULL ? m->status : LG_INVALID_ARGUMENT;
}

void lg_minimise_count_bytes(lg_minimiser *m, size_t numbers) {
    for (uint32_t r = 0; r < m->options.ranks->count; r++) {
        size_t first, end;
        lg_minimise_rows(r, m->options.ranks->count, m->n, &first, &end);
        m->bytes[r] = (end - first) * numbers * sizeof(double);
    }
}

void lg_minimise_gather(lg_minimiser *m, double *x) {
    const lg_ranks *ranks = m->options.ranks;
    if (ranks == NULL || m->status != LG_OK) return;
    lg_minimise_count_bytes(m, 1);
    m->status = ranks->gather(ranks->user, x, m->bytes);
}

void lg_minimiser_destroy(lg_minimiser *m) {
    if (m == NULL) return;
    LG_FREE_ALL(m->context, m->memory, m->bytes, m->whole, m);
}

/* ---- helpers of the states ---- */

double lg_largest(const double *x, size_t n) {
    double top = 0.0;
    for (size_t i = 0; i < n && !isnan(top); i++)
        if (!(fabs(x[i]) <= top)) top = fabs(x[i]);
    return top;
}

/* max |g_i| in the caller's units. */
static double gradient_size(const lg_minimiser *m) {
    double top = 0.0;
    for (size_t i = 0; m->unit != NULL && i < m->n && !isnan(top); i++) {
        const double g = fabs(m->g[i]) / m->unit[i] * m->value_unit;
        if (!(g <= top)) top = g;
    }
    return m->unit != NULL ? top : lg_largest(m->g, m->n);
}

bool lg_minimise_flat(const lg_minimiser *m) {
    return gradient_size(m) <= m->options.gradient_tolerance;
}

double lg_minimise_rounding(const lg_minimiser *m) {
    double sum = fabs(m->numbers.value);
    for (size_t i = 0; i < m->n; i++) sum += fabs(m->g[i] * m->x[i]);
    return m->options.check ? DBL_EPSILON * sum : 0.0;
}

lg_minimise_end lg_minimise_no_step(const lg_minimiser *m) {
    return isfinite(m->numbers.high_value) ? LG_MINIMISE_ROUNDING : LG_MINIMISE_BARRIER;
}

bool lg_minimise_tiny(const lg_minimiser *m) {
    return m->counts.iterations % TINY_EACH == 0 &&
           fabs(m->numbers.value) <= TINY * fabs(m->numbers.start_value);
}

void lg_minimise_finish(lg_minimiser *m, lg_minimise_end end) {
    m->counts.stage = LG_STAGE_DONE;
    m->counts.end = (uint64_t)end;
    memcpy(m->point, m->x, m->n * sizeof *m->x);
}

void lg_minimise_set_point(lg_minimiser *m, double step, const double *direction) {
    for (size_t i = 0; i < m->n; i++) m->point[i] = m->x[i] + step * direction[i];
}

void lg_minimise_search(lg_minimiser *m, double alpha) {
    m->numbers.slope = m->k->dot(m->n, m->g, m->d);
    if (!(m->numbers.slope < 0.0) || !isfinite(m->numbers.slope)) {
        m->counts.pairs = 0;
        m->k->unary[LG_K_SCALE](m->n, -1.0, m->g, m->d);
        m->numbers.slope = -m->k->dot(m->n, m->g, m->g);
        alpha = fmin(1.0, FIRST_STEP / sqrt(-m->numbers.slope));
    }
    lg_minimise_search_begin(m, alpha);
    lg_minimise_set_point(m, m->numbers.alpha, m->d);
}

/* Resets H to 1 and searches along -g. */
static void restart(lg_minimiser *m) {
    m->counts.pairs = 0;
    m->k->unary[LG_K_SCALE](m->n, -1.0, m->g, m->d);
    const double length = sqrt(m->k->dot(m->n, m->g, m->g));
    const bool known = m->counts.iterations == 0 && m->numbers.first > 0.0;
    lg_minimise_search(m, known ? fmin(m->numbers.first, LONGEST_STEP / length)
                                : fmin(1.0, FIRST_STEP / length));
}

/* ---- the check of g: differences of f along a random line against Simpson's rule on its slopes ----
 *
 * One evaluation is enough if the trapezoidal rule agrees with it, as it does for a smooth f. It also tells
 * the curvature along the line, and with it the length of the first step.
 *
 * Each level uses a shorter line than the level before. A level is inconclusive if rounding of f or fourth
 * differences, which are tiny where f is smooth, are as large as the change of f. */

void lg_minimise_check_direction(lg_minimiser *m) {
    lg_rng rng;
    lg_rng_seed(&rng, 1, m->n);
    for (size_t i = 0; i < m->n; i++) m->s[i] = lg_rng_normal(&rng);
}

/* Sets m->s to the direction of the line; returns the half length of the line at the current level. */
static double check_line(lg_minimiser *m) {
    lg_minimise_check_direction(m);
    for (size_t i = 0; i < m->n; i++) m->s[i] *= 1.0 + fabs(m->x[i]);
    return CHECK_STEP * pow(CHECK_FINER, (double)(m->counts.trials / CHECK_POINTS));
}

static void next_check(lg_minimiser *m) {
    static const double at[CHECK_POINTS] = {1.0, -1.0, -0.5, 0.5};
    const double step = check_line(m);
    lg_minimise_set_point(m, at[m->counts.trials % CHECK_POINTS] * step, m->s);
}

static void begin_check(lg_minimiser *m) {
    m->counts.stage = LG_STAGE_CHECK;
    m->counts.trials = m->counts.bounded = 0;
    next_check(m);
}

typedef enum check_verdict { UNKNOWN, AGREES, DIFFERS } check_verdict;

/* Compares the change of f over a step with Simpson's rule on the slopes at its start, middle and end.
 * `noise` is the error of `change`. */
static check_verdict compare(double change, double step, const double slopes[3], double noise) {
    const double simpson = step / 6.0 * (slopes[0] + 4.0 * slopes[1] + slopes[2]);
    const double top = fabs(step) * fmax(fabs(slopes[0]), fmax(fabs(slopes[1]), fabs(slopes[2])));
    const double size = fmax(top, fabs(change)), off = fabs(change - simpson);
    if (!(noise <= CHECK_TOLERANCE * size) || !isfinite(size)) return UNKNOWN;
    return off <= CHECK_TOLERANCE * size + noise ? AGREES : DIFFERS;
}

/* Judges a level from its two half lines, to the left and to the right of x. One half that agrees is enough:
 * the other one may contain a kink. */
static check_verdict compare_level(const lg_minimiser *m, double slope, double step) {
    const lg_minimise_numbers *s = &m->numbers;
    const double *v = s->check_value, *d = s->check_slope;
    double size = fabs(s->value);
    for (size_t i = 0; i < CHECK_POINTS; i++) size = fmax(size, fabs(v[i]));
    const double fourth = fabs(v[0] + v[1] - 4.0 * (v[2] + v[3]) + 6.0 * s->value);
    const double noise = CHECK_ROUNDING * size + CHECK_ROUGH * fourth;
    const double left[3] = {slope, d[2], d[1]}, right[3] = {slope, d[3], d[0]};
    const check_verdict one = compare(v[1] - s->value, -step, left, noise);
    const check_verdict other = compare(v[0] - s->value, step, right, noise);
    if (one == AGREES || other == AGREES) return AGREES;
    return one == DIFFERS && other == DIFFERS ? DIFFERS : UNKNOWN;
}

static void end_check(lg_minimiser *m) {
    if (m->counts.failures > 0)
        (void)lg_minimise_verify(m, lg_minimise_no_step(m));
    else if (lg_minimise_flat(m))
        (void)lg_minimise_verify(m, LG_MINIMISE_GRADIENT);
    else
        restart(m);
}

/* Whether f and the slope at the first point of a level agree with those at x. */
static bool first_agrees(lg_minimiser *m, const double *gradient, double step) {
    const double slope = m->k->dot(m->n, m->g, m->s), end = m->numbers.check_slope[0];
    const double slopes[3] = {slope, 0.5 * (slope + end), end}, value = m->numbers.check_value[0];
    const double noise = CHECK_ROUNDING * fmax(fabs(value), fabs(m->numbers.value));
    double square = 0.0;
    for (size_t i = 0; i < m->n; i++) square += (gradient[i] - m->g[i]) * (gradient[i] - m->g[i]);
    m->numbers.first = square > 0.0 ? fabs(end - slope) * step / square : 0.0;
    return compare(value - m->numbers.value, step, slopes, noise) == AGREES;
}

/* Called at the start, before any search, and after searches have failed. The gradient is wrong if at least
 * one level differs and none agrees. */
static void tell_check(lg_minimiser *m, double value, const double *gradient) {
    const size_t i = (size_t)(m->counts.trials % CHECK_POINTS);
    const double step = check_line(m);
    m->numbers.check_value[i] = value;
    m->numbers.check_slope[i] = m->k->dot(m->n, gradient, m->s);
    m->counts.trials++;
    if (i == 0 && first_agrees(m, gradient, step)) {
        end_check(m);
        return;
    }
    if (i + 1 < CHECK_POINTS) {
        next_check(m);
        return;
    }
    const check_verdict level = compare_level(m, m->k->dot(m->n, m->g, m->s), step);
    if (level == DIFFERS) m->counts.bounded = 1;
    if (level != AGREES && m->counts.trials < CHECK_LEVELS * CHECK_POINTS)
        next_check(m);
    else if (level != AGREES && m->counts.bounded != 0)
        lg_minimise_finish(m, LG_MINIMISE_WRONG_GRADIENT);
    else
        end_check(m);
}

/* ---- steps ---- */

static bool tell_start(lg_minimiser *m, double value, const double *gradient) {
    m->numbers.value = m->numbers.reference_value = m->numbers.start_value = value;
    memcpy(m->g, gradient, m->n * sizeof *gradient);
    if (!isfinite(value) || !m->k->all_finite(m->n, gradient))
        lg_minimise_finish(m, LG_MINIMISE_NOT_FINITE);
    else if (m->options.check)
        begin_check(m);
    else if (lg_minimise_flat(m))
        lg_minimise_finish(m, LG_MINIMISE_GRADIENT);
    else
        restart(m);
    return false;
}

/* First failure: restart from H = 1, unless H predicts a fall of rounding size. Second failure: no step
 * lowers f from H = 1 either. Third failure: the Newton step does not lower f either. */
static void fail_search(lg_minimiser *m) {
    const bool rounding = -m->numbers.slope <= FEW * lg_minimise_rounding(m);
    m->counts.failures += m->counts.failures == 0 && rounding ? 2 : 1;
    if (m->counts.failures == 1)
        restart(m);
    else if (m->counts.failures == 2 && m->options.check)
        begin_check(m);
    else if (lg_minimise_flat(m))
        lg_minimise_finish(m, LG_MINIMISE_GRADIENT);
    else if (m->counts.failures == 2 || !isfinite(m->numbers.high_value) || !lg_minimise_newton_fits(m) ||
             lg_minimise_newton_shows(m))
        lg_minimise_finish(m, lg_minimise_no_step(m));
    else
        lg_minimise_finish(m, LG_MINIMISE_STUCK);
}

bool lg_minimise_slow(lg_minimiser *m) {
    lg_minimise_numbers *s = &m->numbers;
    if (!m->options.slow || m->counts.iterations - m->counts.reference < m->row->slow) return false;
    const bool still = s->reference_value - s->value < SLOW_DECREASE * fabs(s->reference_value);
    m->counts.reference = m->counts.iterations;
    s->reference_value = s->value;
    return still;
}

bool lg_minimise_creeps(lg_minimiser *m) {
    lg_minimise_numbers *s = &m->numbers;
    if (m->options.slow || m->counts.iterations - m->counts.reference < m->row->creep + 4 * m->n)
        return false;
    const double fall = s->reference_value - s->value;
    const bool creeping = fall < 0.5 * fabs(s->reference_value);
    m->counts.crawls = fall < CRAWL * fabs(s->value) ? m->counts.crawls + 1 : 0;
    if (m->counts.crawls == MOST_CRAWLS && lg_minimise_newton_fits(m))
        lg_minimise_finish(m, LG_MINIMISE_STUCK);
    m->counts.reference = m->counts.iterations;
    s->reference_value = s->value;
    return creeping && lg_minimise_newton_fits(m);
}

/* The trial point becomes x. */
static void accept(lg_minimiser *m, double value, const double *gradient) {
    const size_t n = m->n;
    const double fall = m->numbers.value - value;
    const bool looked = m->counts.failures > 1, newton = looked && lg_minimise_newton_fits(m);
    /* `last`: the run ends with LG_MINIMISE_ROUNDING. If alpha is at least FORESEEN, the step is far longer
     * than the Newton step, so the Hessian did not predict where f falls, and the run goes on. After a step
     * along negative curvature found by Lanczos' method: a fall below the rounding of f shows that the
     * curvature was a rounding error. */
    const bool last = newton ? lg_minimise_newton_shows(m) && m->numbers.alpha < FORESEEN
                             : looked && fall <= ROUNDED * fabs(value);
    for (size_t i = 0; i < n; i++) {
        m->s[i] = m->point[i] - m->x[i];
        m->y[i] = gradient[i] - m->g[i];
    }
    memcpy(m->x, m->point, n * sizeof *m->x);
    memcpy(m->g, gradient, n * sizeof *m->g);
    m->numbers.value = value;
    m->counts.failures = 0;
    m->counts.iterations++;
    if (last) {
        lg_minimise_finish(m, LG_MINIMISE_ROUNDING);
    } else if (m->counts.endless >= MOST_ENDLESS || value < LOWEST) {
        lg_minimise_finish(m, LG_MINIMISE_UNBOUNDED);
    } else if (lg_minimise_flat(m)) {
        (void)lg_minimise_verify(m, LG_MINIMISE_GRADIENT);
    } else if (lg_minimise_slow(m)) {
        lg_minimise_finish(m, LG_MINIMISE_SLOW);
    } else if (newton ? lg_minimise_newton_pays(m, fall) : lg_minimise_creeps(m) || lg_minimise_tiny(m)) {
        (void)lg_minimise_verify(m, LG_MINIMISE_ROUNDING);
    } else if (m->k->dot(n, m->s, m->y) > 0.0) {
        m->row->update(m, m->s, m->y);
        m->counts.pairs++;
        lg_minimise_search(m, 1.0);
    } else {
        restart(m);
    }
}

static bool tell_search(lg_minimiser *m, double value, const double *gradient) {
    const bool finite = isfinite(value) && m->k->all_finite(m->n, gradient);
    if (value == -INFINITY) {
        lg_minimise_finish(m, LG_MINIMISE_UNBOUNDED);
        return false;
    }
    const lg_search_verdict verdict = lg_minimise_search_tell(m, value, gradient, finite);
    if (verdict == LG_SEARCH_FAIL) fail_search(m);
    if (verdict == LG_SEARCH_ACCEPT) accept(m, value, gradient);
    return verdict == LG_SEARCH_ACCEPT;
}

bool lg_minimiser_tell(lg_minimiser *m, double value, const double *gradient) {
    if (m->counts.stage == LG_STAGE_DONE || m->row->update == NULL) return false;
    m->counts.evaluations++;
    if (m->counts.stage == LG_STAGE_START) return tell_start(m, value, gradient);
    if (m->counts.stage == LG_STAGE_SEARCH) return tell_search(m, value, gradient);
    if (m->counts.stage == LG_STAGE_CHECK)
        tell_check(m, value, gradient);
    else if (m->counts.stage == LG_STAGE_CURVATURE)
        lg_minimise_curvature_tell(m, gradient);
    else
        lg_minimise_newton_tell(m, gradient);
    return false;
}

void lg_minimiser_change(lg_minimiser *m, double value, const double *gradient) {
    if (m->counts.stage != LG_STAGE_SEARCH || m->counts.iterations == 0 || m->row->direction == NULL) return;
    m->numbers.value = m->numbers.reference_value = value;
    m->counts.reference = m->counts.iterations;
    memcpy(m->g, gradient, m->n * sizeof *gradient);
    if (m->counts.pairs == 0) {
        restart(m);
        return;
    }
    m->row->direction(m);
    lg_minimise_search(m, 1.0);
}

const double *lg_minimiser_gradient(const lg_minimiser *m) {
    return m->g;
}

const double *lg_minimiser_point(const lg_minimiser *m) {
    return m->point;
}

const double *lg_minimiser_best(const lg_minimiser *m) {
    return m->x;
}

lg_minimise_result lg_minimiser_result(const lg_minimiser *m) {
    return (lg_minimise_result){.end = (lg_minimise_end)m->counts.end,
                                .evaluations = m->counts.evaluations,
                                .iterations = m->counts.iterations,
                                .value = m->counts.evaluations > 0 ? m->numbers.value : NAN,
                                .gradient = gradient_size(m)};
}
