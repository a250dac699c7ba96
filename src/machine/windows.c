/* Machines: cuts logs into windows, and weighs their rows in the loss. */
#include <math.h>

#include "machine/internal.h"

/* The start of the next window: the first complete row from `first` on. It should not lie behind `most`,
 * because rows between the windows would then be left out (with a stride above `window`: more rows than the
 * stride leaves out). If it does, the last complete row from `before` to `most` is taken, if there is one.
 * `end`: there is no next window. */
static size_t next_start(const lg_machine *machine, const lg_machine_log *log, bool positions_only,
                         size_t before, size_t first, size_t most, size_t end) {
    size_t row = first;
    while (row < end && !lg_machine_log_complete(machine, log, row, positions_only)) row++;
    if (row <= most && row < end) return row;
    for (size_t back = (most < end ? most + 1 : end); back-- > before;)
        if (lg_machine_log_complete(machine, log, back, positions_only)) return back;
    return row < end ? row : end;
}

size_t lg_machine_windows(const lg_machine *machine, const lg_machine_log *log, uint32_t window,
                          uint32_t stride, bool positions_only, size_t *out) {
    const size_t covered = stride > window ? stride : window;
    size_t count = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);) {
        size_t before = p.first, first = before, most = SIZE_MAX;
        if (p.end < before + window) continue;
        const size_t end = p.end - window + 1;
        for (;;) {
            const size_t row = next_start(machine, log, positions_only, before, first, most, end);
            if (row == end) break;
            if (out != NULL) out[count] = row;
            count++;
            before = row + 1;
            first = row + stride;
            most = row + covered;
        }
    }
    return count;
}

size_t lg_machine_problem_parameters(const lg_machine_problem *problem) {
    return lg_machine_shared(problem) + problem->windows * lg_machine_own(problem);
}

static bool positive(const double *x, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        if (!(x[i] > 0.0 && isfinite(x[i]))) return false;
    return true;
}

lg_status lg_machine_problem_check(const lg_machine_problem *problem, lg_error *error) {
    LG_NEEDS(error, problem);
    const lg_machine *machine = problem->machine;
    lg_space space;
    if (problem->windows == 0 || problem->windows > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the logs have no window of %u rows without a gap",
                       problem->window);
    if (problem->window < 2 || problem->substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a window must have at least 2 rows, and there must be at least 1 substep");
    if (machine->accelerations && problem->log.a == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the log has no accelerations");
    if (problem->validation >= problem->windows)
        return lg_fail(error, LG_INVALID_ARGUMENT, "no windows are left for training");
    if (lg_machine_problem_parameters(problem) == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "everything is known: there is nothing to learn");
    if (!positive(problem->position_scale, machine->coordinate_count) ||
        !positive(problem->velocity_scale, machine->coordinate_count))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the scales of the loss must be above 0");
    LG_TRY(lg_machine_space(machine, &space));
    const char *fault = lg_machine_variational_fault(machine);
    if (problem->scheme->kind == LG_SCHEME_VARIATIONAL)
        return fault == NULL ? LG_OK : lg_fail(error, LG_UNSUPPORTED, "%s", fault);
    const bool lie =
        problem->scheme->kind == LG_SCHEME_RKMK || problem->scheme->kind == LG_SCHEME_COMMUTATOR_FREE;
    if (!lie || (problem->scheme->ambient && !lg_space_is_abelian(&space)))
        return lg_fail(error, LG_UNSUPPORTED, "%s %s; take cf4, rkmk4 or another explicit Lie group scheme%s",
                       problem->scheme->name,
                       lie ? "does not stay on the manifold of this machine"
                           : "is an implicit, splitting or slgi scheme, which machines do not have",
                       fault == NULL ? ", or variational" : "");
    return LG_OK;
}

/* ---- rows ---- */

void lg_machine_weigh_row(const lg_machine_problem *problem, size_t row, double factor, double *positions,
                          double *velocities) {
    const lg_machine *machine = problem->machine;
    const lg_machine_scales *s = &machine->scales;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const double *q = problem->log.q + row * machine->positions,
                     *v = (machine->accelerations ? problem->log.a : problem->log.v) +
                          row * machine->velocities;
        for (uint32_t k = at.position; k < at.position + at.positions; k++) {
            const uint32_t place = k - at.position;
            const double unit = place < at.places  ? s->place[at.place + place]
                                : at.rotations > 0 ? sqrt(0.5)
                                                   : 1.0;
            const bool given = !isnan(q[k]) && !machine->accelerations;
            positions[k] = given ? factor * unit / problem->position_scale[at.index] : 0.0;
        }
        for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++)
            velocities[k] =
                isnan(v[k]) ? 0.0
                            : factor * lg_machine_shown_unit(machine, k) / problem->velocity_scale[at.index];
    }
}

void lg_machine_along_row(const lg_machine_problem *problem, size_t row, double *along) {
    const lg_machine *machine = problem->machine;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const double *q = problem->log.q + row * machine->positions + at.position;
        for (uint32_t k = 0; k < at.velocities; k++)
            along[at.velocity + k] = at.directions > 0 && !isnan(q[k]) ? q[k] : 0.0;
    }
}
