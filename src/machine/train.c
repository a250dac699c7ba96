/* Machines: predictions of windows, and their loss. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

/* ---- logged data ---- */

/* Points of windows. Arrays are ordered by points, then by windows: (points * count, ...). */
typedef struct points {
    const lg_machine_problem *problem;
    const uint32_t *samples;
    size_t count;
    uint32_t first, many; /* of the points in the loss: the first, and how many */
    size_t *at, *used;    /* rows of the log of all points; of the points in the loss */
} points;

static lg_status begin(lg_tape *tape, const lg_machine_problem *problem, lg_var theta,
                       const uint32_t *samples, size_t count, points *p, lg_machine_vars *vars,
                       lg_machine_flow *flow) {
    const uint32_t first = lg_chain_first(problem);
    size_t *at = lg_payload_allocate(tape, problem->window * count * sizeof *at);
    if (at == NULL) return lg_tape_status(tape);
    for (size_t i = 0; i < problem->window * count; i++)
        at[i] = problem->start[samples[i % count]] + i / count;
    *p = (points){problem, samples, count, first, problem->window - first, at, at + first * count};
    if (problem->theta != NULL) theta = lg_machine_problem_parameter(tape, problem, NULL);
    return lg_machine_begin_flow(tape, problem, theta, vars, flow);
}

/* Logged positions and velocities (or accelerations) of the points in the loss, and their weights. */
typedef struct given {
    lg_var positions, velocities, position_weights, velocity_weights;
    /* Shaped as velocities: logged directions, 0 for other coordinates. Only for machines with directions. */
    lg_var along;
} given;

static lg_status put_given(lg_tape *tape, const points *p, double factor, given *out) {
    const lg_machine_problem *problem = p->problem;
    const lg_machine *machine = problem->machine;
    const size_t rows = p->count * p->many;
    const lg_shape places = lg_shape2((uint32_t)rows, machine->positions),
                   speeds = lg_shape2((uint32_t)rows, machine->velocities);
    void *memory[4], *along;
    out->positions = lg_input_buffer(tape, places, &memory[0]);
    out->velocities = lg_input_buffer(tape, speeds, &memory[1]);
    out->position_weights = lg_input_buffer(tape, places, &memory[2]);
    out->velocity_weights = lg_input_buffer(tape, speeds, &memory[3]);
    if (machine->directions > 0) out->along = lg_input_buffer(tape, speeds, &along);
    LG_TRY(lg_tape_status(tape));
    for (size_t i = 0; i < rows; i++) {
        double *each[4];
        for (int k = 0; k < 4; k++)
            each[k] = (double *)memory[k] + i * (k % 2 == 0 ? machine->positions : machine->velocities);
        lg_machine_shown_row(machine, &problem->log, p->used[i], each[0], each[1]);
        lg_machine_weigh_row(problem, p->used[i], factor, each[2], each[3]);
        if (machine->directions > 0)
            lg_machine_along_row(problem, p->used[i], (double *)along + i * machine->velocities);
    }
    return LG_OK;
}

/* ---- predictions of windows ---- */

/* Parameters of the samples' starts, (B, numbers). */
static lg_var start_parameters(lg_tape *tape, const points *p, lg_var theta) {
    const lg_machine *machine = p->problem->machine;
    const uint32_t numbers = lg_machine_start_numbers(machine), n = (uint32_t)p->problem->windows;
    const lg_var all =
        lg_reshape(tape, lg_slice(tape, theta, 0, (uint32_t)lg_machine_shared(p->problem), n * numbers),
                   lg_shape2(n, numbers));
    return lg_gather(tape, all, p->samples, (uint32_t)p->count);
}

/* Predicts points 0 .. M - 1 of the samples' windows: M states of `parts` variables each. */
static lg_status predict(lg_tape *tape, const points *p, const lg_machine_flow *flow, lg_var theta,
                         lg_var *predicted) {
    const lg_machine_problem *problem = p->problem;
    const size_t parts = lg_taped_parts(&flow->space);
    lg_var positions, velocities;
    LG_TRY(lg_machine_record_rows(tape, problem->machine, &problem->log, p->at, p->count, &positions,
                                  &velocities));
    if (lg_machine_starts_estimated(problem))
        LG_TRY(lg_machine_move_starts(tape, problem, flow->vars, start_parameters(tape, p, theta), positions,
                                      velocities, predicted));
    else
        LG_TRY(lg_machine_record_state(tape, flow->vars, positions, velocities, predicted));
    LG_TRY(lg_machine_start_bristles(tape, flow->vars, &problem->log, p->at, p->count, predicted));
    for (uint32_t j = 0; j + 1 < problem->window; j++) {
        lg_var *next = predicted + (j + 1) * parts;
        memcpy(next, next - parts, parts * sizeof *next);
        LG_TRY(lg_machine_record_interval(tape, flow, &problem->log, p->at + j * p->count, (uint32_t)p->count,
                                          next));
    }
    return LG_OK;
}

/* Predicts the windows of `p` and joins the points in the loss of each part of the state into one variable,
 * point after point. */
static lg_status predict_joined(lg_tape *tape, const points *p, const lg_machine_flow *flow, lg_var theta,
                                lg_var *all) {
    const size_t parts = lg_taped_parts(&flow->space), window = p->problem->window;
    lg_var *predicted = lg_payload_allocate(tape, (parts + 1) * window * sizeof *predicted);
    if (predicted == NULL) return lg_tape_status(tape);
    lg_var *each = predicted + parts * window;
    LG_TRY(predict(tape, p, flow, theta, predicted));
    for (size_t i = 0; i < parts; i++) {
        for (uint32_t j = 0; j < p->many; j++) each[j] = predicted[(p->first + j) * parts + i];
        all[i] = p->many == 1 ? each[0] : lg_concat(tape, each, p->many, 0);
    }
    return lg_tape_status(tape);
}

/* Reorders x (points * count, n), ordered by points, to rows of windows (count, points * n). */
static lg_var by_window(lg_tape *tape, const points *p, lg_var x) {
    const uint32_t n = lg_var_shape(tape, x).dims[1], count = (uint32_t)p->count;
    static const int axes[] = {1, 0, 2};
    if (p->many > 1) x = lg_permute(tape, lg_reshape(tape, x, lg_shape3(p->many, count, n)), axes);
    return lg_reshape(tape, x, lg_shape2(count, p->many * n));
}

/* Removes from the velocities of directions their parts along the logged directions: r - (r . q) q. */
static lg_var across(lg_tape *tape, const lg_machine *machine, lg_var r, lg_var along) {
    const uint32_t n = machine->velocities;
    void *memory;
    if (machine->directions == 0) return r;
    const lg_var blocks = lg_input_buffer(tape, lg_shape2(n, n), &memory);
    if (lg_is_none(blocks)) return r;
    memset(memory, 0, (size_t)n * n * sizeof(double));
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
        for (uint32_t k = 0; k < 9 * at.directions; k++)
            ((double *)memory)[(at.velocity + k / 3) * n + at.velocity + k % 3] = 1.0;
    const lg_var dots = lg_matmul(tape, lg_mul(tape, r, along), blocks);
    return lg_sub(tape, r, lg_mul(tape, dots, along));
}

/* Weighted differences of each window between predicted states `all` and data, (count, numbers). */
static lg_var differences(lg_tape *tape, const points *p, const lg_machine_vars *vars, const given *data,
                          const lg_var *all) {
    const lg_var positions = lg_machine_record_positions(tape, vars, all),
                 velocities = lg_machine_record_shown(tape, vars, &p->problem->log, p->used,
                                                      (uint32_t)(p->count * p->many), all);
    const lg_var of_v = lg_mul(tape, lg_sub(tape, velocities, data->velocities), data->velocity_weights);
    const lg_var r[2] = {
        by_window(tape, p, lg_mul(tape, lg_sub(tape, positions, data->positions), data->position_weights)),
        by_window(tape, p, across(tape, p->problem->machine, of_v, data->along))};
    return lg_concat(tape, r, 2, 1);
}

static lg_status shard_residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                 size_t count, size_t batch, lg_var *r) {
    const lg_machine_problem *problem = user;
    points p;
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var all[LG_TAPED_MAX_PARTS];
    given data;
    LG_TRY(begin(tape, problem, theta, samples, count, &p, &vars, &flow));
    LG_TRY(predict_joined(tape, &p, &flow, theta, all));
    /* The factor of the residuals r makes the sum of r^2 over a batch the mean loss of the batch. */
    LG_TRY(put_given(tape, &p, 1.0 / sqrt((double)batch * (double)p.many), &data));
    *r = differences(tape, &p, &vars, &data, all);
    if (lg_machine_problem_priors(problem) > 0) {
        const double weight = lg_machine_prior_weight(problem, batch);
        const lg_var both[2] = {*r, lg_machine_record_priors(tape, &vars, (uint32_t)count, weight)};
        *r = lg_concat(tape, both, 2, 1);
    }
    return lg_tape_status(tape);
}

/* How many logged numbers the training part has, for the prior. */
static size_t observations(const lg_machine_problem *problem) {
    const lg_machine *machine = problem->machine;
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES];
    size_t sum = 0;
    for (size_t w = 0; w < problem->windows - problem->validation; w++)
        for (uint32_t j = lg_chain_first(problem); j < problem->window; j++) {
            lg_machine_weigh_row(problem, problem->start[w] + j, 1.0, q, v);
            for (uint32_t i = 0; i < machine->positions; i++) sum += q[i] != 0.0;
            for (uint32_t i = 0; i < machine->velocities; i++) sum += v[i] != 0.0;
        }
    return sum;
}

/* Windows that are on a tape at once: few of them if they are long. */
static size_t chunk_of(const lg_machine_problem *problem) {
    const size_t rows = (size_t)LG_FIT_CHUNK * 512, count = rows / problem->window;
    return count < 1 ? 1 : count < LG_FIT_CHUNK ? count : LG_FIT_CHUNK;
}

void lg_machine_fit_problem(const lg_machine_problem *problem, lg_fit_problem *out) {
    /* Only weights of networks have a prior. */
    const size_t weights = problem->theta == NULL ? problem->machine->weights : 0;
    *out = (lg_fit_problem){.parameters = lg_machine_problem_parameters(problem),
                            .samples = problem->windows,
                            .repeats = true,
                            .residuals = shard_residuals,
                            .linearise = lg_machine_linearise,
                            .rows = lg_machine_linearised_rows(problem),
                            .user = (void *)(uintptr_t)problem, /* never written */
                            .validation = problem->validation,
                            .chunk = chunk_of(problem),
                            .own = lg_machine_own(problem),
                            .observations = weights > 0 ? observations(problem) : 0,
                            .weights = weights};
}
