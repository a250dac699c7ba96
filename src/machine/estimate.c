/* Machines: estimates the starts of windows when the parameters of the machine are known. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

typedef struct estimate {
    const lg_context *context;
    lg_tape *tape;
    double *numbers; /* (LG_FIT_CHUNK, lg_machine_start_numbers) */
} estimate;

void lg_machine_scale_loss(lg_machine_problem *problem) {
    const lg_machine *machine = problem->machine;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        problem->position_scale[at.index] = at.places > 0 ? machine->scales.place[at.place] : 1.0;
        problem->velocity_scale[at.index] = lg_machine_shown_unit(machine, at.velocity);
    }
}

/* Fits the numbers of the starts. They are kept if a run is not finite. */
static lg_status fit_starts(const lg_context *context, const lg_machine_problem *problem, double *numbers,
                            lg_error *error) {
    enum { MOST_EVALUATIONS = 40 };
    lg_fit_problem fit;
    lg_fit_options options;
    LG_CLEAN(lg_fit_destroy_at) lg_fit *made = NULL;
    LG_TRY(lg_machine_problem_check(problem, error));
    lg_machine_fit_problem(problem, &fit);
    lg_fit_options_init(&options);
    options.plan.phases = 1;
    options.plan.phase[0].method = LG_FIT_LM;
    options.epochs = MOST_EVALUATIONS;
    options.shards = 1;
    LG_TRY(lg_fit_create(context, &fit, &options, numbers, &made, error));
    LG_TRY(lg_fit_run(made, error));
    lg_fit_parameters(made, numbers);
    return LG_OK;
}

lg_status lg_machine_fit_starts(const lg_context *context, const lg_machine_problem *problem, size_t first,
                                size_t count, double *numbers, lg_error *error) {
    const size_t half = count / 2, each = lg_machine_start_numbers(problem->machine);
    /* The unit of a start's numbers depends on the number of windows. */
    const double factor = sqrt((double)problem->windows / (double)count);
    double *own = numbers + first * each;
    lg_machine_problem some = *problem;
    some.start += first;
    some.windows = count;
    for (size_t i = 0; i < count * each; i++) own[i] *= factor;
    const lg_status status = fit_starts(context, &some, own, error);
    for (size_t i = 0; i < count * each; i++) own[i] /= factor;
    if (status != LG_NOT_FINITE) return status;
    if (half == 0) return lg_fail(error, LG_OK, "%s", "");
    LG_TRY(lg_machine_fit_starts(context, problem, first, half, numbers, error));
    return lg_machine_fit_starts(context, problem, first + half, count - half, numbers, error);
}

/* Reads the fitted starts in the units of the log: positions (windows, positions) and velocities (windows,
 * velocities). */
static lg_status read_starts(const estimate *e, const lg_machine_problem *problem, double *q, double *v) {
    const lg_machine *machine = problem->machine;
    LG_CLEAN(lg_chain_close) lg_chain c;
    LG_TRY(lg_chain_open(e->tape, problem, e->numbers, NULL, 0, problem->windows, false, &c));
    LG_TRY(lg_chain_first_points(&c));
    for (size_t i = 0; i < c.count; i++)
        lg_chain_read(&c, i, q + i * machine->positions, v + i * machine->velocities);
    return LG_OK;
}

static lg_status estimate_group(const estimate *e, const lg_machine_problem *problem, double *q, double *v,
                                lg_error *error) {
    const size_t numbers = problem->windows * lg_machine_start_numbers(problem->machine);
    memset(e->numbers, 0, numbers * sizeof *e->numbers);
    LG_TRY(lg_machine_fit_starts(e->context, problem, 0, problem->windows, e->numbers, error));
    return lg_tape_conclude(e->tape, read_starts(e, problem, q, v), error);
}

static uint32_t rows_of(const lg_machine_log *log, size_t row, uint32_t window) {
    const size_t left = log->first[lg_machine_log_part(log, row) + 1] - row;
    return left < window ? (uint32_t)left : window;
}

/* Fills `problem` with the first windows, at most LG_FIT_CHUNK, that have the same number of rows. */
static void next_group(lg_machine_problem *problem, const size_t *start, size_t count, uint32_t window) {
    problem->start = start;
    problem->window = rows_of(&problem->log, start[0], window);
    problem->windows = 1;
    while (problem->windows < count && problem->windows < LG_FIT_CHUNK &&
           rows_of(&problem->log, start[problem->windows], window) == problem->window)
        problem->windows++;
}

lg_status lg_machine_estimate_starts(const lg_context *context, const lg_machine *machine,
                                     const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                     const lg_machine_log *log, const size_t *start, size_t count,
                                     uint32_t window, double *positions, double *velocities,
                                     lg_error *error) {
    LG_NEEDS(error, machine, scheme, log, start, positions, velocities);
    if (theta == NULL && machine->parameters > 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "theta is missing");
    lg_machine_problem problem = {.machine = machine,
                                  .scheme = scheme,
                                  .substeps = substeps,
                                  .starts = LG_MACHINE_STARTS_ESTIMATED,
                                  .theta = theta,
                                  .log = *log};
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    LG_TRY_SCRATCH(double, numbers, context, LG_FIT_CHUNK *(size_t)lg_machine_start_numbers(machine),
                   lg_no_memory(error));
    lg_machine_scale_loss(&problem);
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    estimate e = {.context = context, .tape = tape, .numbers = numbers};
    for (size_t first = 0; first < count; first += problem.windows) {
        next_group(&problem, start + first, count - first, window);
        LG_TRY(estimate_group(&e, &problem, positions + first * machine->positions,
                              velocities + first * machine->velocities, error));
    }
    return LG_OK;
}
