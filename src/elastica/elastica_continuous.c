/* The continuous problem. The discrete problem is solved on finer and finer grids until the collocation
 * converges from its solution. */
#include <math.h>

#include "elastica/elastica.h"

#define FINE_MAX 4096
/* Value of 1 - d for the scaled beam of solve_small. It is 60 times 1.1/n^2 for the coarsest grid (256
 * intervals). */
#define SHORT 1e-3
/* Radians. If the collocation is farther from its discrete start, it is on another branch. */
#define FAR 0.3

/* Whether the collocation stayed on the branch of its discrete start `theta`. `sampled` (n + 1) is work
 * memory. */
static bool is_near(const lg_collocation *c, const lg_beam *beam, const double *theta, double *sampled) {
    lg_collocation_sample(c, beam->n, sampled, NULL);
    for (size_t k = 0; k <= beam->n; k++)
        if (!(fabs(sampled[k] - theta[k]) < FAR)) return false;
    return true;
}

size_t lg_collocation_grid(const lg_beam *beam) {
    lg_beam fine = *beam;
    fine.n = FINE_MAX;
    return lg_beam_coarse(&fine);
}

/* Tells by work->negative and *end whether the solution is a minimum. */
static lg_status judge(const lg_collocation *c, const lg_beam *beam, lg_beam_work *work, lg_beam_end *end) {
    lg_collocation_result found;
    lg_collocation_result_get(c, &found);
    lg_collocation_sample(c, beam->n, work->before, NULL);
    work->negative = lg_beam_inertia(beam, work, work->before, found.force);
    *end = work->negative == 0 ? LG_BEAM_MINIMUM : LG_BEAM_SADDLE;
    return LG_OK;
}

lg_status lg_collocation_polish(lg_collocation *c, const lg_beam *beam, lg_beam_work *work,
                                lg_beam_end *end) {
    LG_TRY(lg_collocation_solve(c, beam, work->theta, work->force, work->tolerance));
    if (!is_near(c, beam, work->theta, work->before)) return LG_NO_CONVERGENCE;
    return judge(c, beam, work, end);
}

/* Solves the discrete problem on finer and finer grids until the collocation converges from one of the
 * solutions. Gives up when there is no discrete solution on two grids. */
static lg_status solve_from(lg_collocation *c, lg_beam *fine, const double *guess, size_t guess_n,
                            double step, lg_beam_work *work, lg_beam_end *end) {
    lg_status status = LG_NO_CONVERGENCE;
    for (int failures = 0; fine->n <= FINE_MAX && failures < 2; fine->n *= 4) {
        if (guess) {
            lg_beam_prolong(guess_n, guess, fine->n, work->theta);
            work->problems++;
            *end = lg_beam_minimise(fine, work);
        } else {
            LG_TRY(lg_beam_solve(fine, work, step, end));
        }
        if (*end != LG_BEAM_MINIMUM && *end != LG_BEAM_SADDLE) {
            failures++;
            continue;
        }
        status = lg_collocation_polish(c, fine, work, end);
        if (status != LG_NO_CONVERGENCE) return status;
        *end = LG_BEAM_LOST;
    }
    return status;
}

/* For nearly straight beams. The discrete problem has no bent minimum for 1 - d below about 1.1/n^2, because
 * its soft ends take up that much of the slack. The angles are proportional to sqrt(1 - d). Therefore a beam
 * with f times the end angles and f^2 times 1 - d is solved. The angles of its solution, divided by f,
 * together with its force, are the start for the given beam; the error of this start is of order 1 - d. */
static lg_status solve_small(lg_collocation *c, const lg_beam *beam, double step, lg_beam_work *work,
                             lg_beam_end *end) {
    const double largest = fmax(fabs(beam->first), fabs(beam->last));
    const double f = fmin(sqrt(SHORT / (1.0 - beam->d)), largest > 0.0 ? 1.0 / largest : INFINITY);
    lg_beam scaled = *beam;
    if (!(f > 1.0)) return LG_NO_CONVERGENCE;
    scaled.first *= f;
    scaled.last *= f;
    scaled.d = 1.0 - f * f * (1.0 - beam->d);
    LG_TRY(solve_from(c, &scaled, NULL, 0, step, work, end));
    scaled.d = beam->d;
    scaled.first = beam->first;
    scaled.last = beam->last;
    LG_TRY(lg_collocation_solve_scaled(c, &scaled, 1.0 / f, work->tolerance));
    return judge(c, &scaled, work, end);
}

static lg_status solve(lg_collocation *c, lg_beam *beam, double step, lg_beam_work *work, lg_beam_end *end) {
    const lg_status status = solve_small(c, beam, step, work, end);
    if (status != LG_NO_CONVERGENCE && (status != LG_OK || *end == LG_BEAM_MINIMUM)) return status;
    return solve_from(c, beam, NULL, 0, step, work, end);
}

static void report(const lg_beam_frame *frame, const lg_collocation *c, const lg_beam_work *work,
                   lg_elastica_solution *solution) {
    lg_collocation_result found;
    lg_collocation_result_get(c, &found);
    const double cosine = cos(frame->chord), sine = sin(frame->chord);
    *solution =
        (lg_elastica_solution){.energy = frame->energy * found.energy,
                               .gradient = frame->force * found.gradient,
                               .residual = found.defect,
                               .force = {frame->force * (cosine * found.force[0] - sine * found.force[1]),
                                         frame->force * (sine * found.force[0] + cosine * found.force[1])},
                               .negative_eigenvalues = work->negative,
                               .iterations = work->iterations + found.iterations,
                               .problems = work->problems + 1};
}

void lg_collocation_export(const lg_collocation *c, const lg_elastica *problem, const lg_beam_frame *frame,
                           double *theta, double *q) {
    const size_t n = problem->intervals;
    const double cosine = cos(frame->chord), sine = sin(frame->chord);
    lg_collocation_sample(c, n, theta, q);
    for (size_t k = 0; k <= n; k++) {
        theta[k] += frame->turn;
        if (!q) continue;
        const double x = problem->length * q[2 * k], y = problem->length * q[2 * k + 1];
        q[2 * k] = problem->q0[0] + cosine * x - sine * y;
        q[2 * k + 1] = problem->q0[1] + sine * x + cosine * y;
    }
    theta[0] = problem->theta0;
    theta[n] = problem->theta0 + problem->rotation;
    for (int i = 0; q && i < 2; i++) {
        q[i] = problem->q0[i];
        q[2 * n + (size_t)i] = problem->qN[i];
    }
}

lg_status lg_elastica_solve_continuous(const lg_context *context, const lg_elastica *problem,
                                       const lg_elastica_options *options, double *theta, double *q,
                                       lg_elastica_solution *solution, lg_error *error) {
    lg_elastica_options o;
    LG_CLEAN(lg_beam_work_destroy) lg_beam_work work = {.memory = NULL};
    lg_beam_end end = LG_BEAM_LOST;
    lg_collocation *c = NULL;
    LG_TRY(lg_elastica_check(problem, error));
    LG_TRY(lg_elastica_options_take(options, &o, error));
    if (!theta) return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: the place for the angles is NULL");
    const lg_beam_frame frame = lg_beam_frame_make(problem);
    lg_beam fine = frame.beam;
    fine.n = lg_collocation_grid(&frame.beam);
    lg_status status = lg_beam_work_create(context, FINE_MAX, &work);
    if (status == LG_OK) status = lg_collocation_create(context, &c);
    work.tolerance = o.gradient_tolerance;
    work.limit = o.max_iterations;
    work.keep_saddles = o.guess != NULL;
    LG_SCRATCH(double, guess, context, frame.beam.n + 1);
    if (guess == NULL) status = LG_OUT_OF_MEMORY;
    if (status == LG_OK && o.guess) status = lg_beam_take_guess(&frame, o.guess, guess, error);
    if (status == LG_OK)
        status = o.guess ? solve_from(c, &fine, guess, frame.beam.n, o.max_step, &work, &end)
                         : solve(c, &fine, o.max_step, &work, &end);
    if (status == LG_OK) {
        lg_collocation_export(c, problem, &frame, theta, q);
        if (solution) report(&frame, c, &work, solution);
        status = lg_elastica_no_minimum(end, &fine, &work, error);
    } else if (status == LG_NO_CONVERGENCE) {
        lg_fail(error, status, "elastica: the collocation found no equilibrium of the continuous problem");
    } else if (status != LG_NOT_FINITE) {
        lg_fail(error, status, "elastica: %s", lg_status_sentence(status));
    }
    lg_collocation_destroy(context, c);
    return status;
}
