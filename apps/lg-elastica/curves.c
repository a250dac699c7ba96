/* Equilibria: solving, collecting, comparing, writing. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/beam.h"

enum { BRANCH_ROOM = 64 };

/* Energies of mirror images differ by rounding: the first one found is kept. */
static const double same_energy = 1e-9;

beam_curve beam_curve_create(const lg_elastica *problem) {
    const size_t nodes = (size_t)problem->intervals + 1;
    return (beam_curve){.problem = *problem,
                        .theta = app_alloc(nodes, sizeof(double)),
                        .q = app_alloc(2 * nodes, sizeof(double)),
                        .v = app_alloc(2 * nodes, sizeof(double))};
}

void beam_curve_free(beam_curve *curve) {
    free(curve->theta);
    free(curve->q);
    free(curve->v);
    *curve = (beam_curve){.theta = NULL};
}

static void fill_tangents(beam_curve *curve) {
    for (size_t k = 0; k <= curve->problem.intervals; k++) {
        curve->v[2 * k] = cos(curve->theta[k]);
        curve->v[2 * k + 1] = sin(curve->theta[k]);
    }
}

static lg_status solve_one(const lg_context *context, const lg_elastica_options *options, bool continuous,
                           beam_curve *curve, lg_error *error) {
    if (!continuous) {
        const lg_status status =
            lg_elastica_solve(context, &curve->problem, options, curve->theta, &curve->solution, error);
        if (status == LG_OK) lg_elastica_curve(&curve->problem, curve->theta, curve->q, curve->v);
        return status;
    }
    const lg_status status = lg_elastica_solve_continuous(context, &curve->problem, options, curve->theta,
                                                          curve->q, &curve->solution, error);
    if (status == LG_OK) fill_tangents(curve);
    return status;
}

static const char *sentence_of(lg_status status, const lg_error *error) {
    return error->message[0] != '\0' ? error->message : lg_status_sentence(status);
}

/* A lower bound on the energy of curves whose angles differ by at most pi from node to node. Where |r|/N lies
 * below the point whose tangent leads to (pi, 2), the largest convex function under 1 - cos is 1 - cos
 * itself. By Jensen's inequality the minimum then spreads the rotation evenly. The bound is also below the
 * bound EI r^2/(2 L) of the continuous energy. */
static double energy_bound(const lg_elastica *problem) {
    const double n = (double)problem->intervals, each = fabs(problem->rotation) / n, half = sin(0.5 * each);
    return each <= 0.8 ? problem->stiffness * n / problem->length * n * 2 * half * half : 0;
}

int beam_solve(const app *self, const boundary *where, const lg_elastica_options *options, bool continuous,
               beam_curve *out) {
    const bool fixed = isfinite(where->chosen);
    const size_t count = fixed ? 1 : where->count;
    lg_status failure = LG_OK;
    lg_error error = {LG_OK, ""}, first = {LG_OK, ""};
    *out = (beam_curve){.theta = NULL};
    for (size_t k = 0; k < count; k++) {
        lg_elastica problem = where->problem;
        problem.rotation = fixed ? where->chosen : where->rotation[k];
        if (out->theta != NULL && energy_bound(&problem) > out->solution.energy) continue;
        beam_curve curve = beam_curve_create(&problem);
        const lg_status status = solve_one(self->context, options, continuous, &curve, &error);
        const bool better =
            status == LG_OK &&
            (out->theta == NULL ||
             curve.solution.energy < out->solution.energy - same_energy * fabs(out->solution.energy));
        if (status != LG_OK && failure == LG_OK) {
            failure = status;
            first = error;
        }
        if (better) {
            beam_curve_free(out);
            *out = curve;
        } else {
            beam_curve_free(&curve);
        }
        if (status == LG_CANCELLED || status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) break;
    }
    if (app_interrupted()) beam_curve_free(out);
    if (out->theta != NULL) return APP_EXIT_OK;
    if (app_interrupted()) return app_fail(self, LG_CANCELLED, "stopped by %s", app_stopper());
    return app_fail(self, failure, "%s", sentence_of(failure, &first));
}

/* ---- branches ---- */

double beam_distance(const beam_curve *a, const beam_curve *b) {
    const size_t n = 2 * ((size_t)a->problem.intervals + 1);
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += (a->v[i] - b->v[i]) * (a->v[i] - b->v[i]);
    return sqrt(2 * sum / (double)n);
}

static int by_energy(const void *a, const void *b) {
    return app_compare_doubles(&((const beam_curve *)a)->solution.energy,
                               &((const beam_curve *)b)->solution.energy);
}

lg_status beam_branches(const lg_context *context, const boundary *where, const lg_elastica_options *options,
                        bool saddles, beam_curves *out, lg_error *error) {
    const size_t nodes = (size_t)where->problem.intervals + 1;
    double *theta = app_alloc(BRANCH_ROOM * nodes, sizeof *theta);
    lg_elastica_solution *solutions = app_alloc(BRANCH_ROOM, sizeof *solutions);
    lg_status status = LG_OK;
    *out = (beam_curves){.list = app_alloc(BOUNDARY_ROTATIONS * BRANCH_ROOM, sizeof *out->list)};
    for (size_t k = 0; k < where->count && status == LG_OK; k++) {
        size_t count = 0;
        lg_elastica problem = where->problem;
        problem.rotation = where->rotation[k];
        status = lg_elastica_branches(context, &problem, options, saddles, BRANCH_ROOM, theta, solutions,
                                      &count, error);
        if (status != LG_OK) break;
        out->full = out->full || count == BRANCH_ROOM;
        for (size_t i = 0; i < count; i++) {
            beam_curve curve = beam_curve_create(&problem);
            memcpy(curve.theta, theta + i * nodes, nodes * sizeof *theta);
            curve.solution = solutions[i];
            lg_elastica_curve(&problem, curve.theta, curve.q, curve.v);
            out->list[out->count++] = curve;
        }
    }
    free(theta);
    free(solutions);
    if (status != LG_OK) beam_curves_free(out);
    if (status == LG_OK) qsort(out->list, out->count, sizeof *out->list, by_energy);
    return status;
}

void beam_curves_free(beam_curves *curves) {
    for (size_t i = 0; i < curves->count; i++) beam_curve_free(&curves->list[i]);
    free(curves->list);
    *curves = (beam_curves){.count = 0};
}

/* ---- output ---- */

lg_status write_curves(const char *path, const beam_curve *curves, size_t count, bool numbered,
                       lg_error *error) {
    app_file file;
    app_file_begin(&file, path);
    (void)fprintf(file.stream, "%ss,x,y,vx,vy,theta\n", numbered ? "branch," : "");
    for (size_t i = 0; i < count; i++) {
        const beam_curve *c = &curves[i];
        for (size_t k = 0; k <= c->problem.intervals; k++) {
            const double s = c->problem.length * (double)k / (double)c->problem.intervals;
            if (numbered) (void)fprintf(file.stream, "%zu,", i + 1);
            (void)fprintf(file.stream, "%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", s, c->q[2 * k],
                          c->q[2 * k + 1], c->v[2 * k], c->v[2 * k + 1], c->theta[k]);
        }
    }
    return app_file_end(&file, error);
}

void json_pairs(app_json *json, const char *key, const double *values, size_t count) {
    app_json_open(json, key, '[');
    for (size_t i = 0; i < count; i++) app_json_reals(json, NULL, values + 2 * i, 2);
    app_json_close(json, ']');
}
