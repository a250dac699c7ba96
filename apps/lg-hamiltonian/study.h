/* The study of lg-hamiltonian: its columns, tables and picture. */
#ifndef LG_APPS_STUDY_H
#define LG_APPS_STUDY_H

#include "common/study.h"
#include "lg-hamiltonian/learning.h"

/* Axes and measures of the plan. */
enum { AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY, AXES };
enum { STUDY_LOSS, STUDY_E1, STUDY_E2, STUDY_SECONDS, MEASURES };

/* A row's value on an axis, as text and as number. */
static inline const char *text_at(const study_plan *plan, const study_row *row, uint32_t axis) {
    return plan->axes[axis].text[row->at[axis]];
}

static inline double number_at(const study_plan *plan, const study_row *row, uint32_t axis) {
    return plan->axes[axis].number[row->at[axis]];
}

/* Medians over the repeats of each cell, geometric means of each integrator. */
void study_report(const app *app, const study_file *file, uint64_t fresh, double seconds);

/* Median E1 against median training time, one mark a cell, one series an integrator and number of substeps.
 */
lg_status study_draw_work(const app *app, const char *picture, const study_file *file, lg_error *error);

#endif
