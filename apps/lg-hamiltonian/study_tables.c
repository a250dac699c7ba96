/* Summaries of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>

#define COMBINATION_AXES                                                                                     \
    { AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_PENALTY }

static bool same_on(const study_row *a, const study_row *b, const uint32_t *axes, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (a->at[axes[i]] != b->at[axes[i]]) return false;
    return true;
}

/* Over all runs of the plan with the integrator and number of substeps of `first`. */
static study_summary integrator_summary(const study_file *file, const study_row *first) {
    static const uint32_t axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS};
    const uint64_t runs = study_runs(file->plan);
    study_collection c = study_collect((size_t)runs);
    for (uint64_t i = 0; i < runs; i++) {
        const study_row key = study_run_at(file->plan, i);
        if (same_on(&key, first, axes, LG_COUNT(axes))) study_add(&c, study_file_find(file, &key));
    }
    return study_end(&c);
}

/* Row number `index` of the pairs (integrator, substeps), integrators first. */
static study_row integrator_at(const study_plan *plan, uint64_t index) {
    const uint32_t substeps = plan->axes[AXIS_SUBSTEPS].count;
    study_row key = {.at = {[AXIS_INTEGRATOR] = (uint32_t)(index / substeps),
                            [AXIS_SUBSTEPS] = (uint32_t)(index % substeps)}};
    return key;
}

static uint64_t integrators_of(const study_plan *plan) {
    return (uint64_t)plan->axes[AXIS_INTEGRATOR].count * plan->axes[AXIS_SUBSTEPS].count;
}

/* A combination (integrator, substeps, N, M, penalty) over all noises of one kind and all repeats. */
typedef struct combination {
    study_row key;
    study_summary summary;
} combination;

enum { BEST = 5 };

static int by_e1(const void *a, const void *b) {
    return app_compare_doubles(&((const combination *)a)->summary.geometric[STUDY_E1],
                               &((const combination *)b)->summary.geometric[STUDY_E1]);
}

static study_summary combination_summary(const study_file *file, study_row key, bool noisy) {
    const study_plan *plan = file->plan;
    const study_axis *eps = &plan->axes[AXIS_EPS];
    study_collection c = study_collect((size_t)eps->count * plan->repeats);
    for (uint32_t i = 0; i < eps->count; i++) {
        if ((eps->number[i] > 0) != noisy) continue;
        key.at[AXIS_EPS] = i;
        for (key.repeat = 1; key.repeat <= plan->repeats; key.repeat++)
            study_add(&c, study_file_find(file, &key));
    }
    return study_end(&c);
}

/* Fills best[0..] in the order of the geometric mean of E1; returns how many there are. */
static size_t best_combinations(const study_file *file, bool noisy, combination best[BEST]) {
    const study_plan *plan = file->plan;
    const size_t all = (size_t)(study_cells(plan) / plan->axes[AXIS_EPS].count);
    combination *list = app_alloc(all, sizeof *list);
    size_t n = 0;
    for (size_t i = 0; i < all; i++) {
        list[n].key = study_run_at(plan, i);
        list[n].summary = combination_summary(file, list[n].key, noisy);
        if (list[n].summary.runs > list[n].summary.failed) n++;
    }
    qsort(list, n, sizeof *list, by_e1);
    if (n > BEST) n = BEST;
    for (size_t i = 0; i < n; i++) best[i] = list[i];
    free(list);
    return n;
}

/* ---- tables ---- */

static void number_cell(app_table *table, const char *format, double value) {
    if (isfinite(value))
        app_table_cell(table, format, value);
    else
        app_table_cell(table, "-");
}

/* The first row: names of axes, then `more`. */
static void head_cells(app_table *table, const study_plan *plan, const uint32_t *axes, size_t count,
                       const char *const *more, size_t more_count) {
    app_table_begin(table, count + more_count);
    for (size_t i = 0; i < count; i++) app_table_cell(table, "%s", plan->axes[axes[i]].name);
    for (size_t i = 0; i < more_count; i++) app_table_cell(table, "%s", more[i]);
}

static void key_cells(app_table *table, const study_plan *plan, const study_row *key, const uint32_t *axes,
                      size_t count) {
    for (size_t i = 0; i < count; i++) app_table_cell(table, "%s", text_at(plan, key, axes[i]));
}

static void figure_cells(app_table *table, const double *figures, const uint32_t *measures, size_t count) {
    for (size_t i = 0; i < count; i++)
        number_cell(table, measures[i] == STUDY_SECONDS ? "%.2f" : "%.2e", figures[measures[i]]);
}

static void print_cells(const study_file *file) {
    static const uint32_t axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY};
    static const uint32_t measures[] = {STUDY_LOSS, STUDY_E1, STUDY_E2, STUDY_SECONDS};
    static const char *const more[] = {"loss", "E1", "E2", "seconds", "runs", "failed"};
    app_table table;
    head_cells(&table, file->plan, axes, LG_COUNT(axes), more, LG_COUNT(more));
    for (uint64_t i = 0; i < study_cells(file->plan); i++) {
        const study_row key = study_run_at(file->plan, i);
        const study_summary s = study_cell_summary(file, key);
        if (s.runs == 0) continue;
        key_cells(&table, file->plan, &key, axes, LG_COUNT(axes));
        figure_cells(&table, s.median, measures, LG_COUNT(measures));
        app_table_cell(&table, "%zu", s.runs);
        app_table_cell(&table, "%zu", s.failed);
    }
    (void)printf("Medians over the repeats\n");
    app_table_end(&table, stdout);
}

static void print_best(const study_file *file, bool noisy) {
    static const uint32_t axes[] = COMBINATION_AXES, measures[] = {STUDY_E1, STUDY_E2};
    static const char *const more[] = {"E1", "E2", "runs"};
    combination best[BEST];
    const size_t n = best_combinations(file, noisy, best);
    if (n == 0) return;
    app_table table;
    head_cells(&table, file->plan, axes, LG_COUNT(axes), more, LG_COUNT(more));
    for (size_t i = 0; i < n; i++) {
        key_cells(&table, file->plan, &best[i].key, axes, LG_COUNT(axes));
        figure_cells(&table, best[i].summary.geometric, measures, LG_COUNT(measures));
        app_table_cell(&table, "%zu", best[i].summary.runs - best[i].summary.failed);
    }
    (void)printf("\nBest combinations %s noise (geometric means)\n", noisy ? "with" : "without");
    app_table_end(&table, stdout);
}

static void print_integrators(const study_file *file) {
    static const uint32_t axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS};
    static const uint32_t measures[] = {STUDY_E1, STUDY_E2, STUDY_LOSS, STUDY_SECONDS};
    static const char *const more[] = {"E1", "E2", "loss", "seconds", "runs", "failed"};
    app_table table;
    head_cells(&table, file->plan, axes, LG_COUNT(axes), more, LG_COUNT(more));
    for (uint64_t i = 0; i < integrators_of(file->plan); i++) {
        const study_row key = integrator_at(file->plan, i);
        const study_summary s = integrator_summary(file, &key);
        if (s.runs == 0) continue;
        key_cells(&table, file->plan, &key, axes, LG_COUNT(axes));
        figure_cells(&table, s.geometric, measures, LG_COUNT(measures));
        app_table_cell(&table, "%zu", s.runs);
        app_table_cell(&table, "%zu", s.failed);
    }
    (void)printf("\nGeometric means over all runs of an integrator\n");
    app_table_end(&table, stdout);
}

/* ---- JSON ---- */

static void json_key(app_json *json, const study_plan *plan, const study_row *key, const uint32_t *axes,
                     size_t count) {
    for (size_t i = 0; i < count; i++)
        if (isnan(number_at(plan, key, axes[i])))
            app_json_text(json, plan->axes[axes[i]].name, text_at(plan, key, axes[i]));
        else
            app_json_real(json, plan->axes[axes[i]].name, number_at(plan, key, axes[i]));
}

static void json_row(app_json *json, const study_plan *plan, const study_row *key, const uint32_t *axes,
                     size_t count, const study_summary *s, const double *figures) {
    app_json_open(json, NULL, '{');
    json_key(json, plan, key, axes, count);
    for (uint32_t k = 0; k < plan->measure_count; k++) app_json_real(json, plan->measures[k], figures[k]);
    app_json_size(json, "runs", s->runs);
    app_json_size(json, "failed", s->failed);
    app_json_close(json, '}');
}

static void json_best(app_json *json, const char *name, const study_file *file, bool noisy) {
    static const uint32_t axes[] = COMBINATION_AXES;
    combination best[BEST];
    const size_t n = best_combinations(file, noisy, best);
    app_json_open(json, name, '[');
    for (size_t i = 0; i < n; i++)
        json_row(json, file->plan, &best[i].key, axes, LG_COUNT(axes), &best[i].summary,
                 best[i].summary.geometric);
    app_json_close(json, ']');
}

static void json_cells(app_json *json, const study_file *file) {
    static const uint32_t axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY};
    app_json_open(json, "medians", '[');
    for (uint64_t i = 0; i < study_cells(file->plan); i++) {
        const study_row key = study_run_at(file->plan, i);
        const study_summary s = study_cell_summary(file, key);
        if (s.runs > 0) json_row(json, file->plan, &key, axes, LG_COUNT(axes), &s, s.median);
    }
    app_json_close(json, ']');
}

static void json_integrators(app_json *json, const study_file *file) {
    static const uint32_t axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS};
    app_json_open(json, "geometric_means", '[');
    for (uint64_t i = 0; i < integrators_of(file->plan); i++) {
        const study_row key = integrator_at(file->plan, i);
        const study_summary s = integrator_summary(file, &key);
        json_row(json, file->plan, &key, axes, LG_COUNT(axes), &s, s.geometric);
    }
    app_json_close(json, ']');
}

static void report_json(const app *self, const study_file *file, uint64_t fresh, double seconds) {
    app_json json;
    app_json_begin(&json);
    app_json_size(&json, "planned", study_runs(file->plan));
    app_json_size(&json, "done", file->count);
    app_json_size(&json, "new", fresh);
    app_json_text(&json, "protocol", file->plan->protocol);
    json_cells(&json, file);
    json_integrators(&json, file);
    json_best(&json, "best_without_noise", file, false);
    json_best(&json, "best_with_noise", file, true);
    app_json_size(&json, "threads", self->threads);
    app_json_text(&json, "out", file->path);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

void study_report(const app *self, const study_file *file, uint64_t fresh, double seconds) {
    if (self->json) {
        report_json(self, file, fresh, seconds);
        return;
    }
    print_cells(file);
    print_integrators(file);
    print_best(file, false);
    print_best(file, true);
}
