/* The study of lg-hamiltonian: its columns, tables and plot. */
#ifndef LG_APPS_STUDY_H
#define LG_APPS_STUDY_H

#include "common/study.h"
#include "lg-hamiltonian/training.h"

/* Indices of the plan's axes and measures. */
enum { AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY, AXES };
enum { STUDY_LOSS, STUDY_E1, STUDY_E2, STUDY_SECONDS, MEASURES };

/* The value of a row on an axis, as text and as number. */
static inline const char *text_at(const study_plan *plan, const study_row *row, uint32_t axis) {
    return plan->axes[axis].text[row->at[axis]];
}

static inline double number_at(const study_plan *plan, const study_row *row, uint32_t axis) {
    return plan->axes[axis].number[row->at[axis]];
}

/* Prints the medians over the repeats of each cell, and the geometric means over all runs of each
 * integrator. */
void study_report(const app *app, const study_file *file, uint64_t fresh, double seconds);

/* Draws median E1 against median training time: one mark per cell, one series per integrator and M. */
void study_draw_work(const app *app, const char *path, const study_file *file);

#endif
