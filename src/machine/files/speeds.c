/* Logs that measure velocities alone, a drive's speed: positions are their integrals from 0 at the start of
 * each part, and nothing may depend on them. Logs that measure accelerations alone: velocities and positions
 * are integrals without their drift, guesses from which the starts of windows are estimated. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "machine/files/log_table.h"
#include "machine/files/reading.h"
#include "machine/files/recipe.h"
#include "machine/internal.h"

/* A potential that is linear in a line: a constant force, wherever the line is. */
static bool is_constant_force(const lg_machine *machine, const lg_machine_term *term, uint32_t coordinate) {
    const char *name = lg_term_kind_name(term->kind);
    const bool linear = strcmp(name, "linear") == 0 || strcmp(name, "gravity") == 0;
    return term->part == LG_MACHINE_POTENTIAL && linear &&
           machine->coordinates[coordinate].kind == LG_COORDINATE_LINE;
}

/* Whether feature k of a term is a position on which the term depends. */
static bool uses(const lg_machine *machine, const lg_machine_term *term, uint32_t k) {
    const lg_machine_feature of = term->of[k];
    return term->part != LG_MACHINE_OFFSET && of.kind != LG_FEATURE_VELOCITY && of.kind != LG_FEATURE_INPUT &&
           !is_constant_force(machine, term, of.index);
}

bool lg_machine_sees_position(const lg_machine *machine, uint32_t coordinate) {
    for (uint32_t t = 0; t < machine->term_count; t++)
        for (uint32_t k = 0; k < machine->terms[t].of_count; k++)
            if (machine->terms[t].of[k].index == coordinate && uses(machine, &machine->terms[t], k))
                return true;
    return false;
}

lg_status lg_machine_refuse_positions(lg_machine_reading *r) {
    const lg_machine *machine = &r->out->machine;
    if (r->out->measured != LG_MEASURED_VELOCITIES_ONLY) return LG_OK;
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (machine->coordinates[i].kind > LG_COORDINATE_ANGLE)
            return LG_FAULT(r, 1, "%s: with `measured: velocities-only` a coordinate is a line or an angle",
                            machine->coordinates[i].name);
    if (machine->grey.system != NULL) /* all systems of lines and angles have a potential */
        return LG_FAULT(r, 1,
                        "system: %s depends on positions, but the log has velocities alone: log the "
                        "positions too",
                        machine->grey.system->name);
    for (uint32_t t = 0; t < machine->term_count; t++)
        for (uint32_t k = 0; k < machine->terms[t].of_count; k++)
            if (uses(machine, &machine->terms[t], k))
                return LG_FAULT(
                    r, r->lines[t],
                    "%s: depends on the position of %s, but the log has velocities alone: log the "
                    "position too, or leave this out",
                    lg_machine_part_name(machine->terms[t].part),
                    machine->coordinates[machine->terms[t].of[k].index].name);
    return LG_OK;
}

/* out (rows, velocities): integrals of x from 0 at the start of each part; a missing number is the one
 * before. */
static void integrate(const lg_log_table *table, const double *x, double *out) {
    const size_t n = table->machine->machine.velocities;
    double held[LG_MACHINE_VELOCITIES], next[LG_MACHINE_VELOCITIES];
    for (size_t part = 0; part < table->parts; part++)
        for (size_t row = table->first[part], begin = row; row < table->first[part + 1]; row++)
            for (size_t k = 0; k < n; k++) {
                const double here = x[row * n + k];
                next[k] = !isnan(here) ? here : row > begin ? held[k] : 0.0;
                const double h = row > begin ? lg_log_time(table, row) - lg_log_time(table, row - 1) : 0.0;
                out[row * n + k] = row > begin ? out[(row - 1) * n + k] + 0.5 * h * (held[k] + next[k]) : 0.0;
                held[k] = next[k];
            }
}

/* ---- accelerations ---- */

/* A straight line, x0 + slope (t - t0). */
typedef struct line {
    double t0, x0, slope;
} line;

static line fit_line(const lg_log_table *table, const double *x, size_t k, size_t first, size_t end) {
    const size_t n = table->machine->machine.velocities;
    const double count = (double)(end - first);
    double t0 = 0, x0 = 0, tt = 0, tx = 0;
    for (size_t row = first; row < end; row++) {
        t0 += lg_log_time(table, row) / count;
        x0 += x[row * n + k] / count;
    }
    for (size_t row = first; row < end; row++) {
        const double t = lg_log_time(table, row) - t0;
        tt += t * t;
        tx += t * (x[row * n + k] - x0);
    }
    return (line){t0, x0, tt > 0 ? tx / tt : 0};
}

static double line_at(const line *of, double t) {
    return of->x0 + of->slope * (t - of->t0);
}

/* Subtracts from number k of rows first .. end - 1 what drifts: the lines through pieces of PIECE rows, half
 * of which each shares with the next, blended linearly from one to the next. work (rows) */
static void remove_drift(const lg_log_table *table, double *x, size_t k, size_t first, size_t end,
                         double *work) {
    enum { PIECE = 400, HALF = PIECE / 2 };
    const size_t n = table->machine->machine.velocities;
    line now = fit_line(table, x, k, first, end < first + PIECE ? end : first + PIECE), next = now;
    for (size_t begin = first; begin < end; begin += HALF) {
        const size_t stop = end < begin + HALF ? end : begin + HALF;
        const bool more = begin > first && begin + PIECE <= end;
        now = next;
        if (more) next = fit_line(table, x, k, begin, begin + PIECE);
        for (size_t row = begin; row < stop; row++) {
            const double t = lg_log_time(table, row), share = (double)(row - begin) / HALF;
            work[row] = (1 - share) * line_at(&now, t) + share * line_at(&next, t);
        }
    }
    for (size_t row = first; row < end; row++) x[row * n + k] -= work[row];
}

static void remove_drifts(const lg_log_table *table, double *x, double *work) {
    for (size_t part = 0; part < table->parts; part++)
        for (size_t k = 0; k < table->machine->machine.velocities; k++)
            remove_drift(table, x, k, table->first[part], table->first[part + 1], work);
}

lg_status lg_log_integrate(const lg_log_table *table, lg_logs *out) {
    const size_t n = table->machine->machine.velocities;
    if (table->machine->measured == LG_MEASURED_VELOCITIES_ONLY) integrate(table, out->v, out->q);
    if (table->machine->measured != LG_MEASURED_ACCELERATIONS) return LG_OK;
    LG_TRY_SCRATCH(double, work, table->context, table->rows, LG_OUT_OF_MEMORY);
    out->a = lg_alloc(table->context, table->rows, n * sizeof *out->a);
    if (out->a == NULL) return LG_OUT_OF_MEMORY;
    memcpy(out->a, out->v, table->rows * n * sizeof *out->a);
    integrate(table, out->a, out->v);
    remove_drifts(table, out->v, work);
    integrate(table, out->v, out->q);
    remove_drifts(table, out->q, work);
    return LG_OK;
}
