/* A curve of the elastica when it is needed: Newton's method against trained networks, each with its distance
 * from the continuous solution. The boundary conditions belong to the case both-ends, at 32 values of x that
 * cover both halves of the period and lie on no training grid. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-bench/bench.h"
#include "liegrad/elastica.h"

enum { PROBLEMS = 32, NODES = 51 };
/* `gap` is in units of pi, `beside` in radians. */
static const double pi = 3.14159265358979323846, gap = 0.012, beside = 0.01;

/* Parameter x of problem i. `neighbour`: x of a nearby problem, whose solution is used as a warm start. */
static double x_of(size_t i, bool neighbour) {
    const size_t half = PROBLEMS / 2;
    const double at = gap + (1 - 2 * gap) * ((double)(i % half) + 0.37) / half;
    return pi * (at + (i < half ? 0.0 : 1.0)) + (neighbour ? beside : 0.0);
}

static lg_elastica problem_of(size_t i, uint32_t intervals, bool neighbour) {
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.intervals = intervals;
    lg_elastica_set_case(&problem, LG_ELASTICA_BOTH_ENDS, x_of(i, neighbour));
    return problem;
}

/* What is timed: one curve per call, problem after problem. */
typedef struct use {
    const bench *b;
    lg_dtype dtype;
    uint32_t intervals;
    bool warm, continuous;
    const lg_surrogate *model;
    lg_surrogate_curves *curves;
    double s[NODES], boundary[PROBLEMS][8];
    double *guess;           /* Initial guesses for warm starts, (PROBLEMS, intervals + 1). */
    double *angle, *q, *v;   /* The curve that the last call computed. */
    double *true_q, *true_v; /* Continuous solutions, (PROBLEMS, intervals + 1, 2). */
    void *work;
    size_t next;
} use;

static void solve_next(void *user) {
    use *u = user;
    const size_t i = u->next++ % PROBLEMS;
    const lg_elastica problem = problem_of(i, u->intervals, false);
    lg_elastica_options options;
    lg_error error = {LG_OK, ""};
    lg_elastica_options_init(&options);
    if (u->warm) options.guess = u->guess + i * (u->intervals + 1);
    if (u->continuous) {
        bench_check(u->b,
                    lg_elastica_solve_continuous(u->b->app->context, &problem, &options, u->angle, u->q, NULL,
                                                 &error),
                    error.message);
        return;
    }
    bench_check(u->b, lg_elastica_solve(u->b->app->context, &problem, &options, u->angle, NULL, &error),
                error.message);
    lg_elastica_curve(&problem, u->angle, u->q, u->v);
}

static void evaluate_next(void *user) {
    use *u = user;
    const size_t i = u->next++ % PROBLEMS;
    lg_surrogate_curve(u->curves, u->boundary[i], u->s, NODES, u->q, u->v, u->work);
}

static void tangents(size_t nodes, const double *angle, double *v) {
    for (size_t k = 0; k < nodes; k++) {
        v[2 * k] = cos(angle[k]);
        v[2 * k + 1] = sin(angle[k]);
    }
}

/* Computes the continuous solutions at the nodes of `intervals` intervals. */
static void open_truth(const bench *b, use *u) {
    const size_t nodes = (size_t)u->intervals + 1;
    lg_error error = {LG_OK, ""};
    u->true_q = app_alloc(PROBLEMS * nodes * 2, sizeof *u->true_q);
    u->true_v = app_alloc(PROBLEMS * nodes * 2, sizeof *u->true_v);
    u->angle = app_alloc(nodes, sizeof *u->angle);
    u->q = app_alloc(2 * nodes, sizeof *u->q);
    u->v = app_alloc(2 * nodes, sizeof *u->v);
    for (size_t i = 0; i < PROBLEMS; i++) {
        const lg_elastica problem = problem_of(i, u->intervals, false);
        bench_check(b,
                    lg_elastica_solve_continuous(b->app->context, &problem, NULL, u->angle,
                                                 u->true_q + 2 * nodes * i, NULL, &error),
                    error.message);
        tangents(nodes, u->angle, u->true_v + 2 * nodes * i);
        const double *q = u->true_q + 2 * nodes * i, *v = u->true_v + 2 * nodes * i;
        memcpy(u->boundary[i], q, 2 * sizeof *q);
        memcpy(u->boundary[i] + 2, v, 2 * sizeof *v);
        memcpy(u->boundary[i] + 4, q + 2 * (nodes - 1), 2 * sizeof *q);
        memcpy(u->boundary[i] + 6, v + 2 * (nodes - 1), 2 * sizeof *v);
    }
}

static void close_use(use *u) {
    free(u->true_q), free(u->true_v), free(u->angle), free(u->q), free(u->v), free(u->guess), free(u->work);
}

/* Computes the row's error: the root mean square of the differences over all problems, nodes and components.
 * Adds a note: the median over the problems. */
static void judge(use *u, void (*call)(void *user), bench_row *row) {
    const size_t values = 2 * ((size_t)u->intervals + 1);
    double sum = 0, each[PROBLEMS];
    u->next = 0;
    for (size_t i = 0; i < PROBLEMS; i++) {
        call(u);
        if (u->continuous) tangents(values / 2, u->angle, u->v);
        each[i] = 0;
        for (size_t k = 0; k < values; k++) {
            const double dq = u->q[k] - u->true_q[values * i + k], dv = u->v[k] - u->true_v[values * i + k];
            each[i] += dq * dq + dv * dv;
        }
        sum += each[i];
        each[i] = sqrt(each[i] / (2.0 * (double)values));
    }
    row->error = sqrt(sum / (2.0 * (double)values * PROBLEMS));
    row->error_is = "root mean square of the distance from the continuous solution, 32 curves";
    bench_note_add(row, "median_error", lg_median(each, PROBLEMS));
}

static void measure(bench *b, use *u, const char *name, void (*call)(void *user)) {
    u->b = b;
    u->next = 0;
    bench_row *row = bench_measure(b, name, call, u);
    if (row == NULL) return;
    row->width = u->intervals;
    judge(u, call, row);
}

static void open_guesses(const bench *b, use *u) {
    const size_t nodes = (size_t)u->intervals + 1;
    lg_error error = {LG_OK, ""};
    u->guess = app_alloc(PROBLEMS * nodes, sizeof *u->guess);
    for (size_t i = 0; i < PROBLEMS; i++) {
        const lg_elastica problem = problem_of(i, u->intervals, true);
        bench_check(b, lg_elastica_solve(b->app->context, &problem, NULL, u->guess + nodes * i, NULL, &error),
                    error.message);
    }
}

void bench_elastica_solve(bench *b) {
    static const uint32_t intervals[] = {10, 20, 50, 100, 200, 400, 800};
    char name[64];
    for (size_t i = 0; i < LG_COUNT(intervals); i++) {
        use u = {.intervals = intervals[i]};
        open_truth(b, &u);
        open_guesses(b, &u);
        (void)snprintf(name, sizeof name, "cold N=%u", intervals[i]);
        measure(b, &u, name, solve_next);
        u.warm = true;
        (void)snprintf(name, sizeof name, "warm N=%u", intervals[i]);
        measure(b, &u, name, solve_next);
        close_use(&u);
    }
    use u = {.intervals = NODES - 1, .continuous = true};
    open_truth(b, &u);
    measure(b, &u, "collocation", solve_next);
    close_use(&u);
}

void bench_elastica_curve(bench *b) {
    lg_surrogate_file file;
    lg_error error = {LG_OK, ""};
    use u = {.intervals = NODES - 1};
    if (b->given->weights == NULL)
        exit(app_usage(b->app, "elastica-curve needs a model: --weights MODEL.h5"));
    const lg_status status =
        lg_recipe_load(b->app->context, b->given->weights, NULL, &lg_recipe_surrogate, &file, &error);
    if (status != LG_OK) exit(app_fail_file(b->app, status, &error, b->given->weights));
    u.model = &file.run.model;
    if (u.model->intervals != u.intervals)
        exit(app_fail(b->app, LG_SHAPE, "%s: trained on %u intervals, not %u", b->given->weights,
                      u.model->intervals, u.intervals));
    for (size_t k = 0; k < NODES; k++) u.s[k] = u.model->length * (double)k / (NODES - 1);
    open_truth(b, &u);
    for (int t = 0; t < 2; t++) {
        u.dtype = t == 0 ? LG_F32 : LG_F64;
        bench_check(b,
                    lg_surrogate_curves_create(b->app->context, u.model, file.theta, u.dtype, NODES,
                                               &u.curves, &error),
                    error.message);
        u.work = app_alloc(lg_surrogate_curves_work_size(u.curves), 1);
        measure(b, &u, u.dtype == LG_F32 ? "f32" : "f64", evaluate_next);
        lg_surrogate_curves_destroy(u.curves);
        free(u.work);
        u.work = NULL;
    }
    close_use(&u);
    lg_recipe_release(&lg_recipe_surrogate, &file);
}
