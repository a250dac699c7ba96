/* Continuation in the end angles and the chord, and the public solver of the discrete problem.
 *
 * The start is a moderate problem: its end angles have the same ratio as the end angles of the given problem,
 * the larger of them is 1 radian, and its chord has a moderate length. The continuation goes from the minimum
 * of the moderate problem to the given problem along a straight line in both end angles and log(1 - d), and
 * finds a minimum at every step. For theta_N = -theta_0 and for theta_0 = 0 this is the branch of global
 * minima. */
#include <math.h>
#include <string.h>

#include "elastica/elastica.h"

#define CHORD_LOW  0.3
#define CHORD_HIGH 0.92
#define CHORD_STEP 0.2 /* largest change of log(1 - d) per problem */
/* With more problems there is no continuation. Such a long path means many turns; these beams wind evenly and
 * are solved directly. */
#define PROBLEMS_MAX 4000
#define COARSE       256
#define BRANCHES     16
#define SEARCH_LIMIT 60 /* largest number of Newton steps from one of many starts */

/* ---- paths ---- */

static lg_beam between(const lg_beam *a, const lg_beam *b, double t) {
    lg_beam beam = *b;
    if (t >= 1.0) return beam;
    beam.first = a->first + t * (b->first - a->first);
    beam.last = a->last + t * (b->last - a->last);
    beam.d = a->d == b->d ? b->d : 1.0 - (1.0 - a->d) * pow((1.0 - b->d) / (1.0 - a->d), t);
    return beam;
}

static double problems_between(const lg_beam *a, const lg_beam *b, double step) {
    const double angle = fmax(fabs(b->first - a->first), fabs(b->last - a->last)) / step;
    const double chord = fabs(log((1.0 - b->d) / (1.0 - a->d))) / CHORD_STEP;
    return fmax(1.0, ceil(fmax(angle, chord) - 1e-9));
}

static void set_line(const lg_beam *beam, double *theta) {
    for (size_t k = 0; k <= beam->n; k++) {
        const double t = (double)k / (double)beam->n;
        theta[k] = k == beam->n ? beam->last : (1.0 - t) * beam->first + t * beam->last;
    }
}

/* Predicts the angles of the next problem in w->theta. If `secant`, it extrapolates the last two solutions;
 * otherwise it adds to the last solution a linear function that gives the new end angles. */
static void predict(const lg_beam *beam, lg_beam_work *w, bool secant) {
    const size_t n = beam->n;
    const double first = beam->first - w->theta[0], last = beam->last - w->theta[n];
    for (size_t k = 0; k <= n; k++) {
        const double now = w->theta[k], t = (double)k / (double)n;
        w->theta[k] += secant ? now - w->before[k] : (1.0 - t) * first + t * last;
        w->before[k] = now;
    }
    w->theta[0] = beam->first;
    w->theta[n] = beam->last;
}

/* Continuation from the beam `from`, whose solution is in work->theta, to `beam`. Both must have the same
 * n. */
static lg_status continue_from(const lg_beam *from, const lg_beam *beam, lg_beam_work *work, double step,
                               lg_beam_end *end) {
    const double count = problems_between(from, beam, step);
    *end = LG_BEAM_MINIMUM;
    for (double i = 1.0; i <= count; i += 1.0) {
        if (lg_cancelled(work->context)) return LG_CANCELLED;
        const lg_beam next = between(from, beam, i / count);
        predict(&next, work, i > 1.0);
        work->problems++;
        *end = lg_beam_minimise(&next, work);
        if (*end != LG_BEAM_MINIMUM) return LG_OK;
    }
    return LG_OK;
}

static lg_beam moderate(const lg_beam *beam) {
    const double largest = fmax(fabs(beam->first), fabs(beam->last));
    lg_beam start = *beam;
    start.first = largest > 0.0 ? beam->first / largest : 1.0;
    start.last = largest > 0.0 ? beam->last / largest : -1.0;
    start.d = fmin(fmax(beam->d, CHORD_LOW), CHORD_HIGH);
    return start;
}

lg_status lg_beam_follow(const lg_beam *beam, lg_beam_work *work, double step, lg_beam_end *end) {
    lg_beam start = moderate(beam);
    if (!(problems_between(&start, beam, step) <= PROBLEMS_MAX)) start = *beam;
    set_line(&start, work->theta);
    work->problems++;
    *end = lg_beam_minimise(&start, work);
    if (*end != LG_BEAM_MINIMUM || memcmp(&start, beam, sizeof start) == 0) return LG_OK;
    return continue_from(&start, beam, work, step, end);
}

/* ---- grids ---- */

size_t lg_beam_coarse(const lg_beam *beam) {
    const double wanted = fmax(COARSE, 12.0 * fabs(beam->last - beam->first));
    return wanted < (double)beam->n ? (size_t)wanted : beam->n;
}

double lg_beam_angle_at(size_t n, const double *theta, double s) {
    const double x = s * (double)n;
    const size_t points = n >= 3 ? 4 : n + 1;
    size_t j = (size_t)x > 0 ? (size_t)x - 1 : 0;
    if (j + points > n + 1) j = n + 1 - points; /* interpolates theta[j] .. theta[j + points - 1] */
    double sum = 0.0;
    for (size_t a = 0; a < points; a++) {
        double weight = 1.0;
        for (size_t b = 0; b < points; b++)
            if (b != a) weight *= (x - (double)(j + b)) / ((double)a - (double)b);
        sum += weight * theta[j + a];
    }
    return sum;
}

void lg_beam_prolong(size_t from_n, const double *from, size_t to_n, double *to) {
    for (size_t k = 0; k < to_n; k++) to[k] = lg_beam_angle_at(from_n, from, (double)k / (double)to_n);
    to[0] = from[0];
    to[to_n] = from[from_n];
}

/* Interpolates work->theta from `from` intervals to beam->n intervals, and finds the minimum there. */
static lg_beam_end refine(size_t from, const lg_beam *beam, lg_beam_work *work) {
    memcpy(work->before, work->theta, (from + 1) * sizeof(double));
    lg_beam_prolong(from, work->before, beam->n, work->theta);
    work->theta[0] = beam->first;
    work->theta[beam->n] = beam->last;
    work->problems++;
    return lg_beam_minimise(beam, work);
}

/* ---- search from many starts ---- */

static lg_status solve_anyhow(const lg_beam *beam, lg_beam_work *work, lg_beam_end *end) {
    const size_t n = beam->n;
    LG_TRY_SCRATCH(double, theta, work->context, BRANCHES *(n + 1), LG_OUT_OF_MEMORY);
    lg_beam_branch branches[BRANCHES];
    size_t count = 0;
    const uint32_t limit = work->limit;
    work->limit = limit < SEARCH_LIMIT ? limit : SEARCH_LIMIT;
    const lg_status status = lg_beam_search(beam, work, false, true, BRANCHES, theta, branches, &count);
    work->limit = limit;
    if (status == LG_OK && count > 0) {
        memcpy(work->theta, theta, (n + 1) * sizeof *theta);
        *end = lg_beam_minimise(beam, work);
    }
    return status;
}

lg_status lg_beam_solve(const lg_beam *beam, lg_beam_work *work, double step, lg_beam_end *end) {
    lg_beam coarse = *beam;
    coarse.n = lg_beam_coarse(beam);
    LG_TRY(lg_beam_follow(&coarse, work, step, end));
    if (*end == LG_BEAM_MINIMUM && coarse.n < beam->n) *end = refine(coarse.n, beam, work);
    return *end == LG_BEAM_MINIMUM ? LG_OK : solve_anyhow(beam, work, end);
}

lg_status lg_beam_next(const lg_beam *from, const lg_beam *beam, lg_beam_work *work, double step,
                       lg_beam_end *end) {
    if (from) {
        LG_TRY(continue_from(from, beam, work, step, end));
        if (*end == LG_BEAM_MINIMUM) return LG_OK;
    }
    return lg_beam_solve(beam, work, step, end);
}

/* ---- the public solver ---- */

lg_status lg_elastica_no_minimum(lg_beam_end end, const lg_beam *beam, const lg_beam_work *work,
                                 lg_error *error) {
    const double gradient = lg_beam_relative_gradient(beam, work);
    switch (end) {
    case LG_BEAM_MINIMUM:
        return lg_fail(error, LG_OK, "%s", "");
    case LG_BEAM_SADDLE:
        return lg_fail(error, LG_NO_CONVERGENCE,
                       "elastica: no minimum was found: the energy at the equilibrium has %u negative "
                       "eigenvalues, so this is a saddle (relative gradient %.3g)",
                       work->negative, gradient);
    case LG_BEAM_FOLDED:
        return lg_fail(error, LG_NO_CONVERGENCE,
                       "elastica: no minimum with this rotation was found: angles of neighbouring nodes "
                       "differ by pi or more (relative gradient %.3g); more intervals may help",
                       gradient);
    default:
        return lg_fail(error, LG_NO_CONVERGENCE,
                       "elastica: no equilibrium was found: the search ended at a relative gradient of %.3g",
                       gradient);
    }
}

void lg_beam_export(const lg_elastica *problem, const lg_beam_frame *frame, const lg_beam_branch *branch,
                    const double *beam, double *curve, double *theta, lg_elastica_solution *solution) {
    const size_t n = frame->beam.n, points = 2 * (n + 1);
    const double c = cos(frame->chord), s = sin(frame->chord);
    for (size_t k = 1; k < n; k++) theta[k] = beam[k] + frame->turn;
    theta[0] = problem->theta0;
    theta[n] = problem->theta0 + problem->rotation;
    if (solution == NULL) return;
    lg_elastica_curve(problem, theta, curve, curve + points);
    *solution =
        (lg_elastica_solution){.energy = frame->energy * branch->energy,
                               .gradient = frame->energy * branch->gradient,
                               .residual = lg_elastica_euler_lagrange(problem, curve, curve + points, NULL),
                               .force = {frame->force * (c * branch->force[0] - s * branch->force[1]),
                                         frame->force * (s * branch->force[0] + c * branch->force[1])},
                               .negative_eigenvalues = branch->negative,
                               .iterations = branch->iterations,
                               .problems = 1};
}

lg_status lg_beam_take_guess(const lg_beam_frame *frame, const double *guess, double *out, lg_error *error) {
    const size_t n = frame->beam.n;
    for (size_t k = 1; k < n; k++) {
        if (!isfinite(guess[k]))
            return lg_fail(error, LG_NOT_FINITE, "elastica: angle %zu of the guess is not finite", k);
        out[k] = guess[k] - frame->turn;
    }
    out[0] = frame->beam.first;
    out[n] = frame->beam.last;
    return LG_OK;
}

lg_status lg_elastica_solve(const lg_context *context, const lg_elastica *problem,
                            const lg_elastica_options *options, double *theta, lg_elastica_solution *solution,
                            lg_error *error) {
    lg_elastica_options o;
    LG_CLEAN(lg_beam_work_destroy) lg_beam_work work = {.memory = NULL};
    lg_beam_end end = LG_BEAM_LOST;
    LG_TRY(lg_elastica_check(problem, error));
    LG_TRY(lg_elastica_options_take(options, &o, error));
    if (!theta) return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: the place for the angles is NULL");
    const lg_beam_frame frame = lg_beam_frame_make(problem);
    const size_t n = frame.beam.n;
    if (lg_beam_work_create(context, n, &work) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "elastica: no memory");
    LG_SCRATCH(double, curve, context, 4 * (n + 1));
    work.tolerance = o.gradient_tolerance;
    work.limit = o.max_iterations;
    work.keep_saddles = o.guess != NULL;
    lg_status status = curve ? LG_OK : LG_OUT_OF_MEMORY;
    if (status == LG_OK && o.guess) {
        status = lg_beam_take_guess(&frame, o.guess, work.theta, error);
        if (status == LG_OK) end = lg_beam_minimise(&frame.beam, &work);
        work.problems = 1;
    } else if (status == LG_OK) {
        status = lg_beam_solve(&frame.beam, &work, o.max_step, &end);
    }
    if (status == LG_OK) {
        if (end == LG_BEAM_MINIMUM || end == LG_BEAM_SADDLE) {
            const lg_beam_branch branch = {.energy = lg_beam_energy(&frame.beam, work.theta),
                                           .gradient = lg_beam_gradient(&frame.beam, &work),
                                           .force = {work.force[0], work.force[1]},
                                           .negative = work.negative,
                                           .iterations = work.iterations};
            lg_beam_export(problem, &frame, &branch, work.theta, curve, theta, solution);
            if (solution) solution->problems = work.problems;
        }
        status = lg_elastica_no_minimum(end, &frame.beam, &work, error);
    } else if (status != LG_NOT_FINITE) {
        lg_fail(error, status, "elastica: %s", lg_status_sentence(status));
    }
    return status;
}
