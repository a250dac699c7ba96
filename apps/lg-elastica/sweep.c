/* lg-elastica solve --sweep: follows the branches of a case from each x to the next. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"
#include "files/csv.h"

/* Largest distance (beam_distance) between curves of one branch at neighbouring x: `moved` times the step in
 * x, but at most far_curve. Different branches are farther apart than this. */
static const double moved = 6, far_curve = 0.5;

typedef struct sweep {
    const app *self;
    const sweep_values *values;
    const lg_elastica_options *options;
    beam_curves *found; /* (points): the curves found at each x */
    size_t **branch;    /* (points): for each x, the branch number of each curve */
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
    s->branch[i] = app_keep(s->found[i].count, sizeof *s->branch[i]);
}

typedef struct sweep_point {
    double x, energy;
    uint32_t negative_eigenvalues;
    double rotation;
    size_t branch;
} sweep_point;

/* ---- following the branches ---- */

typedef struct pair {
    double distance; /* first: it sorts the pairs */
    size_t before, after;
} pair;

/* Assigns the curves at x[i] to branches, pair by pair in order of distance: a curve gets the branch of the
 * nearest curve at x[i - 1] that no nearer curve has taken. The curves that are left begin new branches. */
static void follow(sweep *s, size_t i) {
    const size_t n = s->found[i].count, m = i > 0 ? s->found[i - 1].count : 0;
    const double reach = i > 0 ? fmin(far_curve, moved * (s->x[i] - s->x[i - 1])) : 0;
    APP_FREE pair *pairs = app_alloc(n * m, sizeof *pairs);
    APP_FREE bool *taken = app_alloc(m, sizeof *taken);
    APP_FREE bool *named = app_alloc(n, sizeof *named);
    for (size_t a = 0; a < n; a++)
        for (size_t b = 0; b < m; b++)
            pairs[a * m + b] = (pair){beam_distance(&s->found[i - 1].list[b], &s->found[i].list[a]), b, a};
    qsort(pairs, n * m, sizeof *pairs, lg_compare_doubles);
    for (size_t k = 0; k < n * m && pairs[k].distance < reach; k++) {
        if (taken[pairs[k].before] || named[pairs[k].after]) continue;
        taken[pairs[k].before] = named[pairs[k].after] = true;
        s->branch[i][pairs[k].after] = s->branch[i - 1][pairs[k].before];
    }
    for (size_t a = 0; a < n; a++)
        if (!named[a]) s->branch[i][a] = s->branches++;
}

/* ---- output ---- */

static int by_branch(const void *a, const void *b) {
    const sweep_point *p = a, *q = b;
    if (p->branch != q->branch) return (p->branch > q->branch) - (p->branch < q->branch);
    return lg_compare_doubles(&p->x, &q->x);
}

static sweep_point *collect(const sweep *s, size_t *count) {
    size_t n = 0;
    for (size_t i = 0; i < s->values->points; i++) n += s->found[i].count;
    sweep_point *points = app_keep(n, sizeof *points);
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

static void write_sweep(const app *self, const char *path, const sweep_point *points, size_t count) {
    if (path == NULL) return;
    lg_columns to = {.text = app_text()};
    lg_columns_names(&to, SWEEP_HEAD);
    lg_columns_end(&to);
    for (const sweep_point *at = points; at < points + count; at++) {
        lg_columns_whole(&to, at->branch + 1);
        lg_columns_numbers(&to, (double[]){at->x, at->energy}, 2);
        lg_columns_whole(&to, at->negative_eigenvalues);
        lg_columns_number(&to, at->rotation);
        lg_columns_end(&to);
    }
    APP_MUST_FILE(self, path, lg_columns_write(&to, self->context, path, &error));
}

/* Branches are drawn as pieces of equal stability, since stable and unstable ones have different dashes. */
static void draw_sweep(const app *self, const sweep_point *points, size_t count) {
    app_plot plot;
    double before = NAN;
    if (!app_plot_begin(&plot, "elastica_sweep")) return;
    for (const sweep_point *at = points; at < points + count; at++) {
        const bool follows = at > points && at[-1].branch == at->branch;
        const double saddle = at->negative_eigenvalues > 0, branch = (double)at->branch;
        if (!follows || saddle != before) app_plot_gap(&plot);
        if (follows && saddle != before) /* a piece begins with the last point of the piece before it */
            APP_PLOT_ROW(&plot, 9, at[-1].x, at[-1].energy, saddle, branch);
        APP_PLOT_ROW(&plot, 9, at->x, at->energy, saddle, branch);
        before = saddle;
    }
    app_plot_block(&plot);
    app_plot_end(self, &plot);
}

/* For people: prints a table row per branch. */
static void add_branches(app_json *out, const sweep_point *points, size_t count) {
    app_result_rows(out, NULL);
    for (size_t i = 0, last; i < count; i = last) {
        size_t saddles = 0;
        double low = INFINITY, high = -INFINITY;
        for (last = i; last < count && points[last].branch == points[i].branch; last++) {
            saddles += points[last].negative_eigenvalues > 0;
            low = fmin(low, points[last].energy);
            high = fmax(high, points[last].energy);
        }
        APP_PUT(out, LG_AS_WHOLE("branch", points[i].branch + 1), LG_AS_WHOLE("points", last - i),
                LG_AS_REAL("x from", points[i].x), LG_AS_REAL("to", points[last - 1].x),
                LG_AS_REAL("energy from", low), LG_AS_REAL("to", high), LG_AS_WHOLE("saddles", saddles));
    }
    app_result_rows_end(out);
}

static void add_points(app_json *out, const sweep_point *points, size_t count) {
    app_json_open(out, "points", '[');
    for (size_t i = 0; i < count; i++)
        APP_OBJECT(out, NULL, LG_AS_WHOLE("branch", points[i].branch + 1), LG_AS_REAL("x", points[i].x),
                   LG_AS_REAL("energy", points[i].energy),
                   LG_AS_WHOLE("negative_eigenvalues", points[i].negative_eigenvalues),
                   LG_AS_REAL("rotation", points[i].rotation));
    app_json_close(out, ']');
}

static void report(const sweep *s, const sweep_point *points, size_t count, double seconds) {
    app_json *out = s->self->out;
    if (out->people) add_branches(out, points, count);
    APP_PUT(out, LG_AS_TEXT("case", lg_elastica_case_name(s->values->kind)),
            LG_AS_REALS("x", s->x, s->values->points), LG_AS_WHOLE("branches", s->branches));
    add_points(out, points, count);
    APP_PUT(out, LG_AS_WHOLE("intervals", s->values->problem.intervals), LG_AS_TEXT("out", s->values->out),
            LG_AS_REAL("seconds", seconds));
}

static void check_found(const sweep *s, size_t i) {
    if (app_interrupted()) app_must(s->self, LG_CANCELLED, NULL);
    if (s->status[i] != LG_OK)
        app_stop(s->self, s->status[i], "x = %.9g: %s", s->x[i], app_sentence(s->status[i], &s->error[i]));
}

void sweep_run(const app *self, const sweep_values *values, const lg_elastica_options *options) {
    const size_t n = values->points;
    size_t count;
    sweep s = {.self = self,
               .values = values,
               .options = options,
               .found = app_keep(n, sizeof *s.found),
               .branch = app_keep(n, sizeof *s.branch),
               .x = app_keep(n, sizeof *s.x),
               .status = app_keep(n, sizeof *s.status),
               .error = app_keep(n, sizeof *s.error)};
    const double begin = app_seconds();
    APP_MUST(self, lg_elastica_check(&values->problem, &error));
    for (size_t i = 0; i < n; i++) s.x[i] = 2 * 3.14159265358979323846 * (double)i / (double)(n - 1);
    app_parallel(self->threads, n, find, &s);
    for (size_t i = 0; i < n; i++) check_found(&s, i);
    for (size_t i = 0; i < n; i++) follow(&s, i);
    sweep_point *points = collect(&s, &count);
    const double seconds = app_seconds() - begin;
    write_sweep(self, values->out, points, count);
    draw_sweep(self, points, count);
    report(&s, points, count, seconds);
}
