/* lg-elastica solve --sweep: the branches of a case over x, each followed from one x to the next. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/beam.h"

/* Between neighbouring x a branch moves less than it is away from the others: the tangents' difference (root
 * of the mean square) is at most this many times the step in x, and never more than far_curve. */
static const double moved = 6, far_curve = 0.5;

typedef struct sweep {
    const app *self;
    const sweep_values *values;
    const lg_elastica_options *options;
    beam_curves *found; /* one for each x */
    size_t **branch;    /* number of each one's branch */
    double *x;
    lg_status *status;
    lg_error *error;
    size_t branches;
} sweep;

static void find(void *user, size_t i) {
    const sweep *s = user;
    boundary where = {.problem = s->values->problem};
    if (app_interrupted()) {
        s->status[i] = LG_CANCELLED;
        return;
    }
    lg_elastica_set_case(&where.problem, s->values->kind, s->x[i]);
    boundary_rotations(where.problem.theta0, where.problem.theta0 + where.problem.rotation, &where);
    s->status[i] =
        beam_branches(s->self->context, &where, s->options, s->values->saddles, &s->found[i], &s->error[i]);
    s->branch[i] = app_alloc(s->found[i].count, sizeof *s->branch[i]);
}

/* ---- following ---- */

typedef struct pair {
    double distance;
    size_t before, after;
} pair;

static int by_distance(const void *a, const void *b) {
    return app_compare_doubles(&((const pair *)a)->distance, &((const pair *)b)->distance);
}

/* Each curve at x[i] takes the branch of the nearest one at x[i - 1] that no nearer one has taken. */
static void follow(sweep *s, size_t i) {
    const size_t n = s->found[i].count, m = i > 0 ? s->found[i - 1].count : 0;
    const double reach = i > 0 ? fmin(far_curve, moved * (s->x[i] - s->x[i - 1])) : 0;
    pair *pairs = app_alloc(n * m, sizeof *pairs);
    bool *taken = app_alloc(m, sizeof *taken), *named = app_alloc(n, sizeof *named);
    for (size_t a = 0; a < n; a++)
        for (size_t b = 0; b < m; b++)
            pairs[a * m + b] = (pair){beam_distance(&s->found[i - 1].list[b], &s->found[i].list[a]), b, a};
    qsort(pairs, n * m, sizeof *pairs, by_distance);
    for (size_t k = 0; k < n * m && pairs[k].distance < reach; k++) {
        if (taken[pairs[k].before] || named[pairs[k].after]) continue;
        taken[pairs[k].before] = named[pairs[k].after] = true;
        s->branch[i][pairs[k].after] = s->branch[i - 1][pairs[k].before];
    }
    for (size_t a = 0; a < n; a++)
        if (!named[a]) s->branch[i][a] = s->branches++;
    free(pairs);
    free(taken);
    free(named);
}

/* ---- output ---- */

static int by_branch(const void *a, const void *b) {
    const sweep_point *p = a, *q = b;
    if (p->branch != q->branch) return (p->branch > q->branch) - (p->branch < q->branch);
    return app_compare_doubles(&p->x, &q->x);
}

static sweep_point *collect(const sweep *s, size_t *count) {
    size_t n = 0;
    for (size_t i = 0; i < s->values->points; i++) n += s->found[i].count;
    sweep_point *points = app_alloc(n, sizeof *points);
    *count = 0;
    for (size_t i = 0; i < s->values->points; i++)
        for (size_t k = 0; k < s->found[i].count; k++) {
            const beam_curve *curve = &s->found[i].list[k];
            points[(*count)++] =
                (sweep_point){s->x[i], curve->solution.energy, curve->solution.negative_eigenvalues,
                              curve->problem.rotation, s->branch[i][k]};
        }
    qsort(points, n, sizeof *points, by_branch);
    return points;
}

static lg_status write_sweep(const char *path, const sweep_point *points, size_t count, lg_error *error) {
    app_file file;
    app_file_begin(&file, path);
    (void)fputs("branch,x,energy,negative_eigenvalues,rotation\n", file.stream);
    for (size_t i = 0; i < count; i++)
        (void)fprintf(file.stream, "%zu,%.17g,%.17g,%u,%.17g\n", points[i].branch + 1, points[i].x,
                      points[i].energy, points[i].negative_eigenvalues, points[i].rotation);
    return app_file_end(&file, error);
}

static size_t branch_end(const sweep_point *points, size_t count, size_t first) {
    size_t i = first;
    while (i < count && points[i].branch == points[first].branch) i++;
    return i;
}

static void print_sweep(const sweep_point *points, size_t count) {
    static const char *const heads[] = {"branch", "points", "x from", "to", "energy from", "to", "saddles"};
    app_table table;
    app_table_begin(&table, LG_COUNT(heads));
    for (size_t c = 0; c < LG_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t i = 0, last; i < count; i = last) {
        size_t saddles = 0;
        double low = INFINITY, high = -INFINITY;
        last = branch_end(points, count, i);
        for (size_t k = i; k < last; k++) {
            if (points[k].negative_eigenvalues > 0) saddles++;
            low = fmin(low, points[k].energy);
            high = fmax(high, points[k].energy);
        }
        app_table_cell(&table, "%zu", points[i].branch + 1);
        app_table_cell(&table, "%zu", last - i);
        app_table_cell(&table, "%.4f", points[i].x);
        app_table_cell(&table, "%.4f", points[last - 1].x);
        app_table_cell(&table, "%.6g", low);
        app_table_cell(&table, "%.6g", high);
        app_table_cell(&table, "%zu", saddles);
    }
    app_table_end(&table, stdout);
}

static void report(const sweep *s, const sweep_point *points, size_t count, double seconds) {
    if (!s->self->json) {
        print_sweep(points, count);
        return;
    }
    app_json json;
    app_json_begin(&json);
    app_json_text(&json, "case", lg_elastica_case_name(s->values->kind));
    app_json_reals(&json, "x", s->x, s->values->points);
    app_json_size(&json, "branches", s->branches);
    app_json_open(&json, "points", '[');
    for (size_t i = 0; i < count; i++) {
        app_json_open(&json, NULL, '{');
        app_json_size(&json, "branch", points[i].branch + 1);
        app_json_real(&json, "x", points[i].x);
        app_json_real(&json, "energy", points[i].energy);
        app_json_size(&json, "negative_eigenvalues", points[i].negative_eigenvalues);
        app_json_real(&json, "rotation", points[i].rotation);
        app_json_close(&json, '}');
    }
    app_json_close(&json, ']');
    app_json_size(&json, "intervals", s->values->problem.intervals);
    app_json_text(&json, "out", s->values->out);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

static int write_outputs(const sweep *s, double seconds) {
    lg_error error = {LG_OK, ""};
    lg_status status = LG_OK;
    size_t count;
    const char *path = s->values->out;
    sweep_point *points = collect(s, &count);
    if (path != NULL) status = write_sweep(path, points, count, &error);
    if (status == LG_OK && s->values->plot != NULL) {
        path = s->values->plot;
        status = draw_sweep(s->self, path, points, count, &error);
    }
    if (status == LG_OK) report(s, points, count, seconds);
    free(points);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(s->self, status, &error, path);
}

static int first_failure(const sweep *s) {
    for (size_t i = 0; i < s->values->points; i++) {
        if (s->status[i] == LG_OK) continue;
        if (app_interrupted()) return app_fail(s->self, LG_CANCELLED, "stopped by %s", app_stopper());
        return app_fail(s->self, s->status[i], "x = %.9g: %s", s->x[i],
                        s->error[i].message[0] != '\0' ? s->error[i].message
                                                       : lg_status_sentence(s->status[i]));
    }
    return APP_EXIT_OK;
}

int sweep_run(const app *self, const sweep_values *values, const lg_elastica_options *options) {
    const size_t n = values->points;
    sweep s = {.self = self,
               .values = values,
               .options = options,
               .found = app_alloc(n, sizeof *s.found),
               .branch = app_alloc(n, sizeof *s.branch),
               .x = app_alloc(n, sizeof *s.x),
               .status = app_alloc(n, sizeof *s.status),
               .error = app_alloc(n, sizeof *s.error)};
    const double begin = app_seconds();
    for (size_t i = 0; i < n; i++) s.x[i] = 2 * 3.14159265358979323846 * (double)i / (double)(n - 1);
    app_parallel(self->threads, n, find, &s);
    int code = first_failure(&s);
    for (size_t i = 0; i < n && code == APP_EXIT_OK; i++) follow(&s, i);
    if (code == APP_EXIT_OK) code = write_outputs(&s, app_seconds() - begin);
    for (size_t i = 0; i < n; i++) {
        beam_curves_free(&s.found[i]);
        free(s.branch[i]);
    }
    free(s.found);
    free(s.branch);
    free(s.x);
    free(s.status);
    free(s.error);
    return code;
}
