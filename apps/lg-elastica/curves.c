/* Equilibria: solves, collects, compares and writes them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/beam.h"
#include "files/csv.h"

enum { BRANCH_ROOM = 64 };

/* Relative difference of energies that are taken as equal. Mirror images have equal energies up to rounding;
 * then the first curve found is kept. */
static const double same_energy = 1e-9;

beam_nodes beam_nodes_create(size_t count) {
    double *memory = app_keep(6 * count, sizeof *memory);
    return (beam_nodes){count, memory, memory + count, memory + 3 * count, memory + 5 * count};
}

static beam_curve create_curve(const lg_elastica *problem) {
    const size_t n = problem->intervals;
    const beam_curve out = {.problem = *problem, .at = beam_nodes_create(n + 1)};
    for (size_t k = 0; k <= n; k++) out.at.s[k] = problem->length * (double)k / (double)n;
    return out;
}

/* A lower bound on the energy of a discrete curve whose angles differ by at most pi from node to node, with
 * rotation r over N intervals. The largest convex function below 1 - cos equals 1 - cos up to the point whose
 * tangent goes through (pi, 2); |r|/N must be below this point. By Jensen's inequality the minimum then
 * spreads the rotation r evenly over the intervals. The bound is also smaller than the bound EI r^2/(2 L) on
 * the continuous energy. */
static double energy_bound(const lg_elastica *problem) {
    const double n = (double)problem->intervals, each = fabs(problem->rotation) / n, half = sin(0.5 * each);
    return each <= 0.8 ? problem->stiffness * n / problem->length * n * 2 * half * half : 0;
}

void beam_solve(const app *self, const boundary *where, const lg_elastica_options *options, bool continuous,
                beam_curve *out) {
    const bool fixed = isfinite(where->chosen);
    const size_t count = fixed ? 1 : where->count;
    bool found = false;
    lg_status failure = LG_OK;
    lg_error first = {LG_OK, ""}, error = {LG_OK, ""};
    *out = (beam_curve){.solution = {0}};
    for (size_t k = 0; k < count; k++) {
        lg_elastica problem = where->problem;
        problem.rotation = fixed ? where->chosen : where->rotation[k];
        if (found && energy_bound(&problem) > out->solution.energy) continue;
        beam_curve curve = create_curve(&problem);
        const beam_nodes *at = &curve.at;
        const lg_status status =
            continuous
                ? lg_elastica_solve_continuous(self->context, &problem, options, at->theta, at->q,
                                               &curve.solution, &error)
                : lg_elastica_solve(self->context, &problem, options, at->theta, &curve.solution, &error);
        if (status == LG_OK) lg_elastica_curve(&problem, at->theta, continuous ? NULL : at->q, at->v);
        if (app_interrupted()) app_must(self, LG_CANCELLED, NULL);
        if (status != LG_OK && failure == LG_OK) {
            failure = status;
            first = error;
        }
        if (status == LG_OK &&
            (!found ||
             curve.solution.energy < out->solution.energy - same_energy * fabs(out->solution.energy))) {
            *out = curve;
            found = true;
        }
        if (status == LG_OUT_OF_MEMORY || status == LG_INVALID_ARGUMENT) break;
    }
    if (!found) app_must(self, failure, &first);
}

/* ---- branches ---- */

double beam_distance(const beam_curve *a, const beam_curve *b) {
    const size_t n = 2 * a->at.count;
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += (a->at.v[i] - b->at.v[i]) * (a->at.v[i] - b->at.v[i]);
    return sqrt(2 * sum / (double)n);
}

static int by_energy(const void *a, const void *b) {
    return lg_compare_doubles(&((const beam_curve *)a)->solution.energy,
                              &((const beam_curve *)b)->solution.energy);
}

lg_status beam_branches(const lg_context *context, const boundary *where, const lg_elastica_options *options,
                        bool saddles, beam_curves *out, lg_error *error) {
    const size_t nodes = (size_t)where->problem.intervals + 1;
    APP_FREE double *theta = app_alloc(BRANCH_ROOM * nodes, sizeof *theta);
    APP_FREE lg_elastica_solution *solutions = app_alloc(BRANCH_ROOM, sizeof *solutions);
    lg_status status = LG_OK;
    *out = (beam_curves){.list = app_keep(BOUNDARY_ROTATIONS * BRANCH_ROOM, sizeof *out->list)};
    for (size_t k = 0; k < where->count && status == LG_OK; k++) {
        size_t count = 0;
        lg_elastica problem = where->problem;
        problem.rotation = where->rotation[k];
        status = lg_elastica_branches(context, &problem, options, saddles, BRANCH_ROOM, theta, solutions,
                                      &count, error);
        if (status != LG_OK) break;
        out->full = out->full || count == BRANCH_ROOM;
        for (size_t i = 0; i < count; i++) {
            beam_curve curve = create_curve(&problem);
            memcpy(curve.at.theta, theta + i * nodes, nodes * sizeof *theta);
            curve.solution = solutions[i];
            lg_elastica_curve(&problem, curve.at.theta, curve.at.q, curve.at.v);
            out->list[out->count++] = curve;
        }
    }
    qsort(out->list, out->count, sizeof *out->list, by_energy);
    return status;
}

/* ---- output ---- */

enum { COLUMNS = 6, SHOWN_NODES = 10 };
static const char *const columns[COLUMNS] = {"s", "x", "y", "vx", "vy", "theta"};

static double at_column(const beam_nodes *nodes, size_t k, size_t column) {
    const double row[COLUMNS] = {nodes->s[k],     nodes->q[2 * k],     nodes->q[2 * k + 1],
                                 nodes->v[2 * k], nodes->v[2 * k + 1], nodes->theta[k]};
    return row[column];
}

const char *curves_head(bool numbered) {
    return numbered ? "branch,s,x,y,vx,vy,theta" : "s,x,y,vx,vy,theta";
}

void write_curves(const app *self, const char *path, const beam_curve *curves, size_t count, bool numbered) {
    if (path == NULL) return;
    lg_columns to = {.text = app_text()};
    lg_columns_names(&to, curves_head(numbered));
    lg_columns_end(&to);
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < curves[i].at.count; k++) {
            if (numbered) lg_columns_whole(&to, i + 1);
            for (size_t c = 0; c < COLUMNS; c++) lg_columns_number(&to, at_column(&curves[i].at, k, c));
            lg_columns_end(&to);
        }
    APP_MUST_FILE(self, path, lg_columns_write(&to, self->context, path, &error));
}

void result_nodes(app_json *out, const beam_nodes *nodes, bool all) {
    const size_t last = nodes->count - 1,
                 every = all || last <= SHOWN_NODES ? 1 : (last + SHOWN_NODES - 1) / SHOWN_NODES;
    for (int pairs = 0; pairs < 2; pairs++) {
        app_json_open(out, pairs == 0 ? "q" : "v", '[');
        for (size_t i = 0; i <= last; i++)
            app_json_reals(out, NULL, (pairs == 0 ? nodes->q : nodes->v) + 2 * i, 2);
        app_json_close(out, ']');
    }
    app_json_reals(out, "theta", nodes->theta, nodes->count);
    if (!out->people || out->tabled) return;
    app_result_rows(out, NULL);
    for (size_t k = 0; k <= last; k = k < last && k + every > last ? last : k + every)
        for (size_t c = 0; c < COLUMNS; c++) app_json_real(out, columns[c], at_column(nodes, k, c));
    app_result_rows_end(out);
}

/* ---- plots ---- */

enum { SMOOTH_POINTS = 400 };

void put_beam(app_plot *plot, const beam_curve *curve) {
    const double *q = curve->at.q, *v = curve->at.v;
    const size_t intervals = curve->problem.intervals;
    const double h = curve->problem.length / (double)intervals;
    const size_t parts = intervals < SMOOTH_POINTS ? (SMOOTH_POINTS + intervals - 1) / intervals : 1;
    for (size_t k = 0; k < 2 * intervals; k += 2)
        for (size_t i = 0; i < parts + (k + 2 == 2 * intervals); i++) {
            const double t = (double)i / (double)parts, a = t * t * (3 - 2 * t), b = t * (1 - t) * (1 - t),
                         c = t * t * (t - 1);
            double x[2];
            for (size_t d = k; d < k + 2; d++)
                x[d - k] = q[d] * (1 - a) + q[d + 2] * a + h * (v[d] * b + v[d + 2] * c);
            APP_PLOT_COLUMNS(plot, 9, 1, {x, 0, 2});
        }
    app_plot_block(plot);
}
