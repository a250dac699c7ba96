/* The tables of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>

static bool same_on(const study_row *a, const study_row *b, const uint32_t *axes, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (a->at[axes[i]] != b->at[axes[i]]) return false;
    return true;
}

/* Summary over all runs of the plan with the integrator and the number of substeps of `first`. */
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

/* Pair number `index` of (integrator, substeps); the substeps vary faster. */
static study_row integrator_at(const study_plan *plan, uint64_t index) {
    const uint32_t substeps = plan->axes[AXIS_SUBSTEPS].count;
    study_row key = {.at = {[AXIS_INTEGRATOR] = (uint32_t)(index / substeps),
                            [AXIS_SUBSTEPS] = (uint32_t)(index % substeps)}};
    return key;
}

static uint64_t integrators_of(const study_plan *plan) {
    return (uint64_t)plan->axes[AXIS_INTEGRATOR].count * plan->axes[AXIS_SUBSTEPS].count;
}

/* A combination (integrator, substeps, N, M, penalty), summarised over all repeats and over all noise levels
 * that are zero, or all that are not. */
typedef struct combination {
    study_row key;
    study_summary summary;
} combination;

enum { BEST = 5 };

static int by_e1(const void *a, const void *b) {
    return lg_compare_doubles(&((const combination *)a)->summary.geometric[STUDY_E1],
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

/* Fills best[0..] in rising order of the geometric mean of E1; returns their number. */
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

/* ---- results ---- */

static const uint32_t cell_axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY},
                      combination_axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_PENALTY},
                      integrator_axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS};

/* Writes a table row: the values on the given axes, the figures, and the numbers of runs and failed runs. */
static void put_row(app_json *out, const study_plan *plan, const study_row *key, const uint32_t *axes,
                    size_t count, const study_summary *s, const double *figures) {
    app_json_open(out, NULL, '{');
    for (size_t i = 0; i < count; i++)
        if (isnan(number_at(plan, key, axes[i])))
            app_json_text(out, plan->axes[axes[i]].name, text_at(plan, key, axes[i]));
        else
            app_json_real(out, plan->axes[axes[i]].name, number_at(plan, key, axes[i]));
    for (uint32_t k = 0; k < plan->measure_count; k++) app_json_real(out, plan->measures[k], figures[k]);
    app_json_size(out, "runs", s->runs);
    app_json_size(out, "failed", s->failed);
    app_json_close(out, '}');
}

static void put_cells(app_json *out, const study_file *file) {
    app_result_line(out, "\nMedians over the repeats");
    app_result_rows(out, "medians");
    for (uint64_t i = 0; i < study_cells(file->plan); i++) {
        const study_row key = study_run_at(file->plan, i);
        const study_summary s = study_cell_summary(file, key);
        if (s.runs > 0) put_row(out, file->plan, &key, cell_axes, LG_COUNT(cell_axes), &s, s.median);
    }
    app_result_rows_end(out);
}

static void put_integrators(app_json *out, const study_file *file) {
    app_result_line(out, "\nGeometric means over all runs of an integrator");
    app_result_rows(out, "geometric_means");
    for (uint64_t i = 0; i < integrators_of(file->plan); i++) {
        const study_row key = integrator_at(file->plan, i);
        const study_summary s = integrator_summary(file, &key);
        put_row(out, file->plan, &key, integrator_axes, LG_COUNT(integrator_axes), &s, s.geometric);
    }
    app_result_rows_end(out);
}

static void put_best(app_json *out, const char *name, const study_file *file, bool noisy) {
    combination best[BEST];
    const size_t n = best_combinations(file, noisy, best);
    if (n > 0)
        app_result_line(out, "\nBest combinations %s noise (geometric means)", noisy ? "with" : "without");
    app_result_rows(out, name);
    for (size_t i = 0; i < n; i++)
        put_row(out, file->plan, &best[i].key, combination_axes, LG_COUNT(combination_axes), &best[i].summary,
                best[i].summary.geometric);
    app_result_rows_end(out);
}

void study_report(const app *self, const study_file *file, uint64_t fresh, double seconds) {
    app_json out;
    app_result_begin(&out, self);
    app_result_size(&out, "planned", study_runs(file->plan), "runs of the grid");
    app_result_size(&out, "done", file->count, "runs of the table");
    app_result_size(&out, "new", fresh, NULL);
    app_json_text(&out, "protocol", file->plan->protocol);
    put_cells(&out, file);
    put_integrators(&out, file);
    put_best(&out, "best_without_noise", file, false);
    put_best(&out, "best_with_noise", file, true);
    app_json_size(&out, "threads", self->threads);
    app_json_text(&out, "out", file->text.path);
    app_result_real(&out, "seconds", seconds, NULL);
    app_json_end(&out);
}
