/* The tables of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const uint32_t combination_axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_PENALTY},
                      integrator_axes[] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS};

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

/* Fills best[0..] in rising order of the geometric mean of E1; returns their number. */
static size_t best_combinations(const study_table *table, study_noise noise, combination best[BEST]) {
    const study_plan *plan = table->plan;
    const size_t all = study_cells(plan) / plan->axes[AXIS_EPS].count;
    APP_FREE combination *list = app_alloc(all, sizeof *list);
    size_t n = 0;
    for (size_t i = 0; i < all; i++) {
        const study_row key = study_run_at(plan, i);
        const study_summary s =
            study_summarise(table, &key, combination_axes, LG_COUNT(combination_axes), noise);
        if (s.runs > s.failed) list[n++] = (combination){key, s};
    }
    qsort(list, n, sizeof *list, by_e1);
    if (n > BEST) n = BEST;
    memcpy(best, list, n * sizeof *best);
    return n;
}

/* ---- results ---- */

/* Writes a table row: the values on the given axes, the figures, and the numbers of runs and failed runs. */
static void put_row(app_json *out, const study_plan *plan, const study_row *key, const uint32_t *axes,
                    size_t count, const study_summary *s, const double *figures) {
    app_json_open(out, NULL, '{');
    for (size_t i = 0; i < count; i++) {
        const study_axis *axis = &plan->axes[axes[i]];
        const uint32_t at = key->at[axes[i]];
        if (isnan(axis->number[at]))
            app_json_text(out, study_axis_names[axes[i]], axis->text[at]);
        else
            app_json_real(out, study_axis_names[axes[i]], axis->number[at]);
    }
    for (uint32_t k = 0; k < MEASURES; k++) app_json_real(out, study_measure_names[k], figures[k]);
    app_json_size(out, "runs", s->runs);
    app_json_size(out, "failed", s->failed);
    app_json_close(out, '}');
}

static void put_best(app_json *out, const char *name, const study_table *table, study_noise noise) {
    combination best[BEST];
    const size_t n = best_combinations(table, noise, best);
    if (n > 0)
        app_result_line(out, "\nBest combinations %s noise (geometric means)",
                        noise == STUDY_WITH ? "with" : "without");
    app_result_rows(out, name);
    for (size_t i = 0; i < n; i++)
        put_row(out, table->plan, &best[i].key, combination_axes, LG_COUNT(combination_axes),
                &best[i].summary, best[i].summary.geometric);
    app_result_rows_end(out);
}

void study_report(const app *self, const study_table *table, size_t fresh, double seconds) {
    const study_plan *plan = table->plan;
    const uint32_t substeps = plan->axes[AXIS_SUBSTEPS].count;
    app_json *out = self->out;
    app_result_size(out, "planned", study_runs(plan), "runs of the grid");
    app_result_size(out, "done", table->count, "runs of the table");
    app_result_size(out, "new", fresh, NULL);
    app_json_text(out, "protocol", plan->protocol);
    app_result_line(out, "\nMedians over the repeats");
    app_result_rows(out, "medians");
    for (size_t i = 0; i < study_cells(plan); i++) {
        const study_row key = study_run_at(plan, i);
        const study_summary s = study_summarise(table, &key, study_cell_axes, AXES, STUDY_ANY);
        if (s.runs > 0) put_row(out, plan, &key, study_cell_axes, AXES, &s, s.median);
    }
    app_result_rows_end(out);
    app_result_line(out, "\nGeometric means over all runs of an integrator");
    app_result_rows(out, "geometric_means");
    for (uint32_t i = 0; i < plan->axes[AXIS_INTEGRATOR].count * substeps; i++) {
        const study_row key = {.at = {[AXIS_INTEGRATOR] = i / substeps, [AXIS_SUBSTEPS] = i % substeps}};
        const study_summary s =
            study_summarise(table, &key, integrator_axes, LG_COUNT(integrator_axes), STUDY_ANY);
        put_row(out, plan, &key, integrator_axes, LG_COUNT(integrator_axes), &s, s.geometric);
    }
    app_result_rows_end(out);
    put_best(out, "best_without_noise", table, STUDY_WITHOUT);
    put_best(out, "best_with_noise", table, STUDY_WITH);
    app_json_size(out, "threads", self->threads);
    app_json_text(out, "out", table->text.path);
    app_result_real(out, "seconds", seconds, NULL);
}
