/* Policies: tasks, and the object. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "control/policy.h"
#include "core/widen.h"
#include "kernels/kernels.h"

LG_AT(lg_plan_destroy, lg_plan)

const char *lg_policy_kind_name(lg_policy_kind kind) {
    static const char *const names[LG_POLICY_KIND_COUNT] = {"lqr", "network", "energy"};
    return (uint32_t)kind < LG_POLICY_KIND_COUNT ? names[kind] : NULL;
}

void lg_policy_task_init(lg_policy_task *task) {
    *task =
        (lg_policy_task){.size = sizeof *task, .period = 0.05, .horizon = 5.0, .hold = 1.0, .within = 10.0};
    task->kind = LG_POLICY_NETWORK;
    task->hidden_layers = 2, task->hidden[0] = task->hidden[1] = 32;
    task->gate = task->search = true;
}

/* ---- checks ---- */

static lg_status check_coordinate(const lg_policy_coordinate *c, lg_error *error) {
    const lg_policy_motion_row *row = lg_policy_motion_row_of(c->motion);
    if (row == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "coordinate %s: unknown kind", c->name);
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const bool turns = c->motion > LG_POLICY_ANGLE;
    const double weights[] = {c->weight, c->weight_velocity}, noise[] = {c->noise, c->noise_velocity};
    const struct {
        bool fits;
        const char *says; /* of the names of the coordinate and of its kind */
    } checks[] = {
        {c->start[0] <= c->start[1] && c->start_velocity[0] <= c->start_velocity[1] &&
             k->all_finite(2, c->start) && k->all_finite(2, c->start_velocity),
         "coordinate %s: starts need finite low <= high"},
        {weights[0] >= 0.0 && weights[1] >= 0.0 && k->all_finite(2, weights),
         "coordinate %s: weights of the cost must be finite and >= 0"},
        {c->follows == 0 || (c->motion == LG_POLICY_LINE && c->velocity[0] == '\0' && !c->track && !c->free),
         "%s is a lagged input, a line without velocity that cannot be tracked or free"},
        {!c->track || !turns, "track: %s is a %s; set points are of lines and angles"},
        {!c->free || !turns, "free: %s is a %s; only lines and angles can be free"},
        {!c->free ||
             (!c->track && c->goal[0] == 0.0 && c->weight == 0.0 && c->noise == 0.0 && !isfinite(c->success)),
         "free: the position of %s is no error, so it has no goal, weight, bound of success, noise and set "
         "points"},
        {!c->integral || (!c->free && c->follows == 0 && !turns),
         "integral: %s has no error that can be integrated; integrals are of lines and angles"},
        {noise[0] >= 0.0 && noise[1] >= 0.0 && k->all_finite(2, noise),
         "coordinate %s: noise must be finite and >= 0"},
        {c->success > 0.0 && c->success_velocity > 0.0, "coordinate %s: bounds of success must be above 0"}};
    for (size_t i = 0; i < LG_COUNT(checks); i++)
        if (!checks[i].fits) return lg_fail(error, LG_INVALID_ARGUMENT, checks[i].says, c->name, row->name);
    return LG_OK;
}

/* The coordinates of the machine; behind them are those that the controller remembers. */
static uint32_t count_own(const lg_policy_task *task) {
    uint32_t n = 0;
    while (n < LG_POLICY_COORDINATES && n < task->coordinate_count && task->coordinate[n].ago == 0 &&
           task->coordinate[n].integrates == 0)
        n++;
    return n;
}

static lg_status check_gains(const lg_policy_task *t, lg_error *error) {
    const uint32_t remembered = t->coordinate_count - count_own(t);
    uint32_t errors = 0;
    for (uint32_t i = 0; i < t->coordinate_count; i++) {
        const lg_policy_coordinate *c = &t->coordinate[i];
        errors += lg_policy_row_of(c)->errors + (c->velocity[0] != '\0' ? lg_policy_row_of(c)->rates : 0);
    }
    const uint32_t wanted[LG_POLICY_KIND_COUNT] = {
        [LG_POLICY_LQR] = t->input_count * errors, [LG_POLICY_ENERGY] = 2};
    if (t->gain_count == 0) return LG_OK;
    const uint32_t fewer = t->kind == LG_POLICY_LQR ? t->input_count * remembered : 0;
    bool good = (t->gain_count == wanted[t->kind] || t->gain_count + fewer == wanted[t->kind]) &&
                t->gain_count <= LG_POLICY_GAINS;
    for (uint32_t i = 0; good && i < t->gain_count; i++)
        good = isfinite(t->gains[i]) && (t->kind == LG_POLICY_LQR || t->gains[i] > 0.0);
    if (good) return LG_OK;
    return lg_fail(
        error, LG_INVALID_ARGUMENT,
        "gains are two positive numbers, k_p and k_d, of a controller of kind energy, or K of kind lqr: "
        "%u numbers, by input, in the order of positions, then velocities",
        t->input_count * (errors - remembered));
}

static lg_status check_task(const lg_policy_task *t, lg_error *error) {
    bool weighed = false, judged = false;
    if (t->size != sizeof *t || t->coordinate_count == 0 || t->coordinate_count > LG_POLICY_COORDINATES ||
        t->input_count == 0 || t->input_count > LG_POLICY_INPUTS ||
        (uint32_t)t->kind >= LG_POLICY_KIND_COUNT || t->hidden_layers > LG_POLICY_HIDDEN)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the task's sizes are out of range");
    if (t->substeps > LG_POLICY_SUBSTEPS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "substeps is %u, expected at most %d", t->substeps,
                       LG_POLICY_SUBSTEPS);
    for (uint32_t i = 0; i < t->coordinate_count; i++) {
        const lg_policy_coordinate *c = &t->coordinate[i];
        LG_TRY(check_coordinate(c, error));
        if (c->follows > t->input_count)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s follows an input that is not there", c->name);
        if (c->follows > 0 && c->ago == 0 && t->kind == LG_POLICY_ENERGY)
            return lg_fail(
                error, LG_INVALID_ARGUMENT,
                "a controller of kind energy needs forces that act at once, but %s is a lagged input",
                c->name);
        if (c->integral && t->kind == LG_POLICY_ENERGY)
            return lg_fail(error, LG_INVALID_ARGUMENT, "a controller of kind energy has no integrals");
        weighed = weighed || c->weight > 0.0 || c->weight_velocity > 0.0;
        judged = judged || isfinite(c->success) || isfinite(c->success_velocity);
    }
    for (uint32_t l = 0; l < t->input_count; l++) {
        const lg_policy_input *in = &t->input[l];
        if (!(in->low < in->high && isfinite(in->low) && isfinite(in->high)))
            return lg_fail(error, LG_INVALID_ARGUMENT, "input %s: limits need finite low < high", in->name);
        if (!(in->weight > 0.0 && isfinite(in->weight)))
            return lg_fail(error, LG_INVALID_ARGUMENT, "input %s: its weight in the cost must be above 0",
                           in->name);
    }
    LG_TRY(check_gains(t, error));
    if (t->compensate &&
        (t->kind == LG_POLICY_ENERGY || !t->search || (t->kind == LG_POLICY_NETWORK && !t->gate)))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "compensate needs the regulator of kind lqr, or of the gate of a network");
    if (!t->search && t->kind == LG_POLICY_NETWORK && t->gate)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the gate of a network needs the search for a regulator");
    if (!(t->delay >= 0.0 && t->delay <= 1.0 && t->spread >= 0.0 && isfinite(t->spread)))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "disturbances need a delay from 0 to 1 and a finite spread of at least 0");
    if (!weighed) return lg_fail(error, LG_INVALID_ARGUMENT, "the cost weighs no coordinate");
    if (!judged) return lg_fail(error, LG_INVALID_ARGUMENT, "success bounds no coordinate");
    if (!(t->period > 0.0 && t->horizon >= t->period && t->hold >= 0.0 && t->within >= t->hold) ||
        !isfinite(t->horizon) || !isfinite(t->within) || t->within < t->period)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "times need 0 < period <= horizon and 0 <= hold <= within, all finite");
    return LG_OK;
}

/* The numbers of a port of a function of the plant; 0: no such function or port. */
static size_t numbers_of(const lg_program *plant, const char *function, bool output, size_t port) {
    size_t number, count;
    if (lg_program_find(plant, function, &number, NULL) != LG_OK) return 0;
    const lg_port *ports =
        output ? lg_program_outputs(plant, number, &count) : lg_program_inputs(plant, number, &count);
    return port < count ? lg_shape_count(ports[port].shape) : 0;
}

typedef struct demand {
    const char *function;
    bool output;
    size_t port, numbers;
    const char *what;
} demand;

/* `plant`: the plant, or the policy's program. */
static lg_status check_plant(lg_policy *p, const lg_program *plant, lg_error *error) {
    const lg_policy_layout *l = &p->layout;
    const bool own = numbers_of(plant, "plant_step", false, 0) > 0;
    const uint32_t positions = p->memory.positions;
    p->memory.plant = (uint32_t)numbers_of(plant, own ? lg_policy_plant_name(p, "step") : "step", false, 0);
    p->state = p->memory.plant + p->memory.count;
    if (p->memory.plant == 0) return lg_fail(error, LG_NOT_FOUND, "the plant has no function step (x, u, h)");
    const demand moving[] = {{"step", false, 1, p->inputs, "inputs"},
                             {"momenta", false, 0, positions, "positions"},
                             {"momenta", false, 1, l->velocities, "velocities"},
                             {"positions", true, 0, positions, "positions"},
                             {"velocities", true, 0, l->velocities, "velocities"}},
                 still[] = {{"step", false, 1, p->inputs, "inputs"},
                            {"step", false, 0, positions, "coordinates"}};
    const demand *wanted = l->velocities > 0 ? moving : still;
    const size_t count = l->velocities > 0 ? LG_COUNT(moving) : LG_COUNT(still);
    for (size_t i = 0; i < count; i++) {
        const char *name = own ? lg_policy_plant_name(p, wanted[i].function) : wanted[i].function;
        const size_t found = numbers_of(plant, name, wanted[i].output, wanted[i].port);
        if (found != wanted[i].numbers)
            return lg_fail(error, found == 0 ? LG_NOT_FOUND : LG_SHAPE,
                           "the task has %zu numbers as %s, but the plant's function %s has %zu",
                           wanted[i].numbers, wanted[i].what, wanted[i].function, found);
    }
    if (p->task.kind == LG_POLICY_ENERGY && (l->velocities == 0 || numbers_of(plant, "value", true, 0) != 1))
        return lg_fail(error, LG_NOT_FOUND,
                       "a controller of kind energy needs a plant with an energy (function value)");
    return LG_OK;
}

/* ---- steps of the integrator ---- */

enum { TRIALS = 32, MOST_STEPS = 64 };

/* Moves the states by a period in n steps. */
static void advance(const lg_policy *p, const lg_plan *step, uint32_t n, const double *u, double *x,
                    double *next, double *h, void *work) {
    for (size_t i = 0; i < TRIALS; i++) h[i] = p->task.period / n;
    for (uint32_t k = 0; k < n; k++) {
        lg_plan_eval(step, (const void *[]){x, u, h}, (void *[]){next}, work);
        memcpy(x, next, TRIALS * p->state * sizeof *x);
    }
}

/* Of the numbers of a state the one that differs most, as a part of its change; each in its own unit. */
static double largest_difference(const lg_policy *p, const double *start, const double *coarse,
                                 const double *fine) {
    double most = 0.0;
    for (uint32_t j = 0; j < p->state; j++) {
        double off = 0.0, change = 0.0;
        for (size_t i = j; i < (size_t)TRIALS * p->state; i += p->state) {
            off += (coarse[i] - fine[i]) * (coarse[i] - fine[i]);
            change += (fine[i] - start[i]) * (fine[i] - start[i]);
        }
        if (change > 0.0 && !(off <= most * most * change)) most = sqrt(off / change);
    }
    return most;
}

/* Errors of a period as parts of its change: of a machine that a policy is trained on, and of a machine on
 * which it is judged. */
static const double training_error = 1e-4, judging_error = 1e-6;

/* The number of steps, 1, 2, 4, ..., at which halving the steps changes the next state by at most `wanted` of
 * its change. */
static lg_status choose_substeps(lg_policy *p, double wanted, uint64_t seed, lg_error *error) {
    const size_t x = (size_t)TRIALS * p->state;
    LG_CLEAN(lg_plan_destroy_at) lg_plan *step = NULL;
    lg_rng rng;
    LG_TRY(lg_program_plan(p->program, "step", LG_F64, TRIALS, &step, error));
    LG_TRY_SCRATCH(double, start, p->context, 4 * x + TRIALS * (p->inputs + 1), lg_no_memory(error));
    LG_TRY_SCRATCH(char, work, p->context, lg_plan_work_size(step), lg_no_memory(error));
    double *coarse = start + x, *fine = coarse + x, *next = fine + x, *u = next + x,
           *h = u + TRIALS * p->inputs, off = INFINITY;
    lg_rng_seed(&rng, seed, 5);
    LG_TRY(lg_policy_starts(p, &rng, TRIALS, start, u, error));
    for (p->task.substeps = 1; p->task.substeps <= MOST_STEPS; p->task.substeps *= 2) {
        memcpy(coarse, start, x * sizeof *coarse);
        memcpy(fine, start, x * sizeof *fine);
        advance(p, step, p->task.substeps, u, coarse, next, h, work);
        advance(p, step, 2 * p->task.substeps, u, fine, next, h, work);
        off = largest_difference(p, start, coarse, fine);
        if (off <= wanted) return LG_OK;
    }
    return lg_fail(error, LG_CHECK_FAILED,
                   "%d steps of the integrator in a period of %g s leave an error of %.1e: take a shorter "
                   "period, or give `substeps`%s",
                   MOST_STEPS, p->task.period, off,
                   lg_policy_has(p, "lag") ? ", or leave out a lag that is much shorter than the period"
                                           : "");
}

/* ---- the object ---- */

static lg_status init_parameters(lg_policy *p, lg_error *error) {
    if (p->task.kind == LG_POLICY_NETWORK) {
        const uint32_t features = lg_policy_features(&p->task);
        if (lg_mlp_init(&p->net, features, p->task.hidden, p->task.hidden_layers, p->inputs, LG_TANH, true) !=
            LG_OK)
            return lg_fail(error, LG_INVALID_ARGUMENT, "hidden layers need 1 or more units each");
        p->parameters = lg_mlp_parameters(&p->net);
    }
    if (p->task.kind == LG_POLICY_ENERGY && p->task.gain_count == 0) p->parameters = 2 * (size_t)p->inputs;
    if (p->task.compensate) p->parameters += 2 * (size_t)p->inputs;
    p->theta = lg_alloc(p->context, p->parameters + 1, sizeof *p->theta);
    if (p->theta == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a policy");
    return LG_OK;
}

void lg_policy_initialise(const lg_policy *p, uint64_t seed, double *theta) {
    lg_rng rng;
    lg_rng_seed(&rng, seed, 1);
    if (p->task.kind == LG_POLICY_NETWORK) lg_mlp_initialise(&p->net, &rng, theta);
    const size_t n = p->task.compensate ? 2 * (size_t)p->inputs : 0;
    if (n > 0) memcpy(theta + p->parameters - n, p->first, n * sizeof *theta);
}

static lg_status set_theta(lg_policy *p) {
    if (p->parameters == 0) return LG_OK;
    return lg_program_set_parameter(p->program, lg_program_parameters(p->program) - 1, p->theta);
}

lg_status lg_policy_take(lg_policy *p, const double *theta) {
    if (theta != p->theta) memcpy(p->theta, theta, p->parameters * sizeof *theta);
    return set_theta(p);
}

lg_status lg_policy_prepare(lg_policy *p, lg_error *error) {
    LG_TRY(check_task(&p->task, error));
    p->inputs = p->task.input_count;
    p->regulator.inputs = p->inputs;
    lg_policy_lay_out(&p->task, &p->layout);
    p->regulator.errors = p->layout.errors;
    if (p->layout.errors > LG_POLICY_ERRORS || p->layout.errors == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the machine has %u errors; a policy needs 1 to %d",
                       p->layout.errors, LG_POLICY_ERRORS);
    lg_policy_lay_out_memory(p, p->task.dead_time);
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) { /* of integrals */
        const uint32_t of = p->task.coordinate[i].integrates;
        if (of > 0)
            p->task.coordinate[i].weight =
                p->task.coordinate[of - 1].weight / (p->task.horizon * p->task.horizon);
    }
    return init_parameters(p, error);
}

/* The goals of lagged inputs are the inputs that hold the machine at the goal. Returns whether there are any.
 */
static bool set_goals(lg_policy *p) {
    bool any = false;
    for (uint32_t k = 0; k < p->task.coordinate_count; k++) {
        lg_policy_coordinate *c = &p->task.coordinate[k];
        if (c->follows == 0) continue;
        c->goal[0] = p->regulator.u0[c->follows - 1];
        any = true;
    }
    return any;
}

/* Finds the regulator, or, if `rest`, only u0, the input that holds the machine at the goal. */
static lg_status design(lg_policy *p, bool rest, uint64_t seed, lg_error *error) {
    LG_CLEAN(lg_policy_destroy_at) lg_policy *sliding = NULL;
    LG_TRY(lg_policy_make_soft(p, NULL, true, &sliding, error));
    return rest ? lg_policy_find_rest(p, sliding, error) : lg_policy_find_regulator(p, sliding, seed, error);
}

/* The functions of motion contain the goals, so they are recorded again once these are known. */
static lg_status add_motion(lg_policy *p, const lg_program *plant, lg_error *error) {
    LG_TRY(lg_policy_add_motion(p, error));
    if (!set_goals(p)) return LG_OK;
    LG_TRY(design(p, true, 0, error));
    (void)set_goals(p);
    lg_program_destroy(p->program);
    p->program = NULL;
    LG_TRY(lg_policy_begin(p, plant, error));
    return lg_policy_add_motion(p, error);
}

/* The policy's own functions, with the regulator that it has. */
static lg_status add_functions(lg_policy *p, lg_error *error) {
    LG_TRY(lg_policy_add_functions(p, error));
    return set_theta(p);
}

/* The policy on friction that is soft over a tenth of the speeds of the starts. */
static lg_status make_warm(lg_policy *p, lg_error *error) {
    double size[LG_POLICY_ERRORS], speed[3 * LG_POLICY_COORDINATES];
    lg_policy_find_sizes(p, size);
    for (uint32_t i = 0; i < p->task.coordinate_count; i++)
        for (uint32_t k = 0; p->task.coordinate[i].velocity[0] != '\0' &&
                             k < lg_policy_row_of(&p->task.coordinate[i])->velocity;
             k++)
            speed[p->layout.at[i].velocity + k] = 0.1 * size[p->layout.at[i].rate];
    return lg_policy_make_soft(p, speed, false, &p->warm, error);
}

static lg_status build(lg_policy *p, const lg_context *context, const lg_policy_task *task,
                       const lg_program *plant, uint64_t seed, lg_error *error) {
    p->context = context, p->task = *task;
    LG_TRY(lg_policy_extend_task(&p->task, error));
    LG_TRY(lg_policy_prepare(p, error));
    LG_TRY(check_plant(p, plant, error));
    LG_TRY(lg_policy_begin(p, plant, error));
    if (p->task.substeps == 0) LG_TRY(choose_substeps(p, training_error, seed, error));
    LG_TRY(add_motion(p, plant, error));
    LG_TRY(lg_policy_check_shifts(p, true, seed, error));
    LG_TRY(design(p, false, seed, error));
    lg_policy_initialise(p, seed, p->theta);
    LG_TRY(add_functions(p, error));
    const lg_status status = p->parameters > 0 ? make_warm(p, error) : LG_OK;
    p->task.soften = NULL;
    return status;
}

/* What a policy on another plant is for: runs of training; evaluation, where the integrator takes finer steps
 * and the controller keeps what it believes; training on soft friction; the design of the regulator. */
typedef enum purpose { DRAWN, JUDGED, WARM, DESIGN } purpose;

static lg_status rebuild(lg_policy *p, const lg_policy *policy, const lg_program *plant,
                         const double *dead_time, purpose is, lg_error *error) {
    p->context = policy->context, p->task = policy->task;
    LG_TRY(lg_policy_prepare(p, error));
    p->believes = is == JUDGED && policy->believes == NULL ? policy : policy->believes;
    p->memory = policy->memory;
    lg_policy_lay_out_memory(p, dead_time);
    LG_TRY(check_plant(p, plant, error));
    if (p->layout.velocities == 0 && p->state != p->layout.positions)
        return lg_fail(error, LG_UNSUPPORTED, "a plant without velocities has the dead times of the policy");
    p->regulator = policy->regulator, p->terminal = policy->terminal;
    memcpy(p->scale, policy->scale, sizeof p->scale);
    memcpy(p->G, policy->G, sizeof p->G);
    memcpy(p->theta, policy->theta, p->parameters * sizeof *p->theta);
    LG_TRY(lg_policy_begin(p, plant, error));
    if (is == JUDGED || is == WARM) {
        const lg_status status = choose_substeps(p, is == JUDGED ? judging_error : training_error, 1, error);
        if (status == LG_CHECK_FAILED && plant == policy->program)
            p->task.substeps = policy->task.substeps;
        else if (status != LG_OK)
            return status;
    }
    if (is == JUDGED && p->task.substeps < policy->task.substeps) p->task.substeps = policy->task.substeps;
    LG_TRY(lg_policy_add_motion(p, error));
    if (is == DESIGN) return LG_OK;
    LG_TRY(lg_policy_check_shifts(p, false, 1, error));
    LG_TRY(lg_policy_add_regulated(p, error));
    return add_functions(p, error);
}

static lg_status transplant(const lg_policy *policy, const lg_program *plant, const double *dead_time,
                            purpose is, lg_policy **out, lg_error *error) {
    LG_CLEAN(lg_policy_destroy_at) lg_policy *p = lg_alloc(policy->context, 1, sizeof *p);
    if (p == NULL) return lg_no_memory(error);
    LG_TRY(rebuild(p, policy, plant, dead_time, is, error));
    return LG_MOVE(out, p);
}

/* ---- policies of files ---- */

/* Pairs operation a of one function with operation b of the other. False: a has another partner. */
static bool pair(uint32_t *partner, uint32_t a, uint32_t b) {
    if (partner[a] == UINT32_MAX) partner[a] = b;
    return partner[a] == b;
}

/* Puts the operations of `is` in the order of `expected`: arguments of a call are recorded in the order that
 * the compiler chooses. Leaves `is` as it was if the graphs of the operations differ. */
static lg_status put_in_order(const lg_context *context, lg_function_image *is,
                              const lg_function_image *expected) {
    const size_t n = expected->operation_count;
    if (n == 0 || is->operation_count != n || is->output_count != expected->output_count) return LG_OK;
    LG_TRY_SCRATCH(uint32_t, partner, context, n, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(lg_operation, sorted, context, n, LG_OUT_OF_MEMORY);
    bool same = true;
    for (size_t i = 0; i < n; i++) partner[i] = UINT32_MAX;
    for (size_t k = 0; k < is->output_count; k++)
        same = same && pair(partner, expected->results[k], is->results[k]);
    for (size_t i = n; same && i-- > 0;) {
        const lg_operation *wanted = &expected->operations[i];
        if (partner[i] == UINT32_MAX) partner[i] = (uint32_t)i; /* an input that is not used */
        sorted[i] = is->operations[partner[i]];
        same = sorted[i].input_count == wanted->input_count;
        for (uint32_t k = 0; same && k < wanted->input_count; k++)
            same = pair(partner, wanted->inputs[k], sorted[i].inputs[k]);
        sorted[i].inputs = wanted->inputs;
    }
    if (!same) return LG_OK;
    memcpy(is->operations, sorted, n * sizeof *sorted);
    is->results = expected->results;
    return LG_OK;
}

static lg_status compare_function(const lg_policy *p, const lg_policy *again, size_t function,
                                  lg_error *error) {
    const char *name = lg_program_function_name(again->program, function);
    LG_CLEAN(lg_function_image_destroy_at) lg_function_image *is = NULL, *expected = NULL;
    size_t size[2], stored;
    if (lg_program_find(p->program, name, &stored, NULL) != LG_OK)
        return lg_fail(error, LG_FORMAT, "the policy's program has no function %s", name);
    if (lg_function_image_create(p->program, stored, &is) != LG_OK ||
        lg_function_image_create(again->program, function, &expected) != LG_OK ||
        put_in_order(p->context, is, expected) != LG_OK)
        return lg_no_memory(error);
    LG_TRY(lg_function_pack(is, NULL, &size[0], error));
    LG_TRY(lg_function_pack(expected, NULL, &size[1], error));
    LG_TRY_SCRATCH(char, bytes, p->context, size[0] + size[1], lg_no_memory(error));
    LG_TRY(lg_function_pack(is, bytes, &size[0], error));
    LG_TRY(lg_function_pack(expected, bytes + size[0], &size[1], error));
    if (size[0] == size[1] && memcmp(bytes, bytes + size[0], size[0]) == 0) return LG_OK;
    return lg_fail(
        error, LG_FORMAT,
        "the functions control, policy, closed and period of the file are not of one policy: one of "
        "them was changed. Train the policy again");
}

/* Evaluations run `closed` and `regulated`, exported C calls `control`, and its self-test also `period`. All
 * of them must be what the task, the plant and the regulator give. The derivatives of the file are not used:
 * the policy gets the program that was recorded for the comparison. */
static lg_status take_recorded(lg_policy *p, lg_error *error) {
    LG_CLEAN(lg_policy_destroy_at) lg_policy *again = NULL;
    LG_TRY(transplant(p, p->program, NULL, DRAWN, &again, error));
    for (size_t i = 0; i < lg_program_functions(again->program); i++)
        if (!lg_program_is_derivative(lg_program_function_name(again->program, i)))
            LG_TRY(compare_function(p, again, i, error));
    lg_program *const of_file = p->program;
    p->program = again->program, again->program = of_file;
    return LG_OK;
}

lg_status lg_policy_adopt(lg_policy *p, lg_error *error) {
    (void)set_goals(p);
    for (uint32_t l = 0; l < p->inputs; l++)
        if (!(p->task.dead_time[l] >= 0.0 && p->task.dead_time[l] <= LG_POLICY_COORDINATES * p->task.period))
            return lg_fail(error, LG_FORMAT, "the dead time %g of input %s is out of range",
                           p->task.dead_time[l], p->task.input[l].name);
    lg_policy_lay_out_memory(p, p->task.dead_time);
    if (memcmp(p->memory.line, p->memory.known, sizeof p->memory.line) != 0)
        return lg_fail(error, LG_FORMAT, "the past inputs of the policy do not fit its dead times");
    LG_TRY(check_plant(p, p->program, error));
    if (!lg_policy_has(p, "period"))
        return lg_fail(error, LG_FORMAT, "the policy's program has no function period");
    if (p->parameters == 0) return take_recorded(p, error);
    const size_t last = lg_program_parameters(p->program);
    lg_parameter_spec stored = {.name = ""};
    if (last > 0) stored = lg_program_parameter(p->program, last - 1);
    if (stored.values == NULL || lg_shape_count(stored.shape) != p->parameters)
        return lg_fail(error, LG_FORMAT,
                       "the policy's program does not have the %zu parameters of its network", p->parameters);
    memcpy(p->theta, stored.values, p->parameters * sizeof *p->theta);
    return take_recorded(p, error);
}

lg_status lg_policy_make_soft(const lg_policy *policy, const double *speed, bool motion, lg_policy **out,
                              lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *plant = NULL;
    *out = NULL;
    if (policy->task.soften == NULL) return LG_OK;
    LG_TRY(policy->task.soften(policy->task.soften_user, speed, &plant, error));
    return plant == NULL ? LG_OK : transplant(policy, plant, NULL, motion ? DESIGN : WARM, out, error);
}

lg_status lg_policy_transplant(const lg_policy *policy, lg_program *plant, const double *dead_time,
                               lg_policy **out, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *own = plant;
    LG_NEEDS(error, policy, out);
    return transplant(policy, plant != NULL ? plant : policy->program, dead_time, JUDGED, out, error);
}

lg_status lg_policy_add_draw(lg_policy *policy, lg_program *plant, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *own = plant;
    LG_CLEAN(lg_policy_destroy_at) lg_policy *drawn = NULL;
    LG_NEEDS(error, policy, plant);
    if (!lg_policy_is_disturbed(&policy->task))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the policy's task has no disturbances");
    LG_TRY(transplant(policy, plant, NULL, DRAWN, &drawn, error));
    if (drawn->state != policy->state)
        return lg_fail(error, LG_SHAPE, "the other machine's state has %u numbers, the policy's has %u",
                       drawn->memory.plant, policy->memory.plant);
    const size_t count = policy->draw_count;
    lg_policy **draws = lg_widen(policy->context, policy->draws, count, count + 1, sizeof *draws);
    if (draws == NULL) return lg_no_memory(error);
    policy->draws = draws;
    policy->draw_count++;
    return LG_MOVE(&draws[count], drawn);
}

lg_status lg_policy_disturb(lg_policy *policy, const lg_policy_task *by, lg_error *error) {
    LG_NEEDS(error, policy, by);
    lg_policy_task changed = policy->task;
    const uint32_t count = count_own(&changed);
    bool same = count == count_own(by);
    for (uint32_t i = 0; same && i < count; i++) {
        const lg_policy_coordinate *from = &by->coordinate[i];
        lg_policy_coordinate *to = &changed.coordinate[i];
        same = strcmp(from->name, to->name) == 0 && from->motion == to->motion;
        to->noise = from->noise, to->noise_velocity = from->noise_velocity;
    }
    if (!same) return lg_fail(error, LG_SHAPE, "the coordinates of the task are not those of the policy");
    changed.delay = by->delay, changed.draws = by->draws, changed.spread = by->spread;
    LG_TRY(check_task(&changed, error));
    policy->task = changed;
    if (!lg_policy_is_disturbed(&changed) || lg_policy_has(policy, "disturbed")) return LG_OK;
    if (!lg_policy_has(policy, "disturbed_regulator"))
        LG_TRY(lg_policy_add(policy, "disturbed_regulator", error));
    return lg_policy_add_disturbed(policy, error);
}

lg_status lg_policy_create(const lg_context *context, const lg_policy_task *task, lg_program *plant,
                           uint64_t seed, lg_policy **out, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *own = plant;
    LG_NEEDS(error, task, plant, out);
    LG_CLEAN(lg_policy_destroy_at) lg_policy *p = lg_alloc(context, 1, sizeof *p);
    if (p == NULL) return lg_no_memory(error);
    LG_TRY(build(p, context, task, plant, seed, error));
    return LG_MOVE(out, p);
}

void lg_policy_destroy(lg_policy *p) {
    if (p == NULL) return;
    for (size_t i = 0; i < p->draw_count; i++) lg_policy_destroy(p->draws[i]);
    lg_policy_destroy(p->warm);
    lg_free(p->context, p->draws);
    lg_program_destroy(p->program);
    LG_FREE_ALL(p->context, p->theta, p);
}

const lg_policy_task *lg_policy_task_of(const lg_policy *p) {
    return &p->task;
}
const lg_program *lg_policy_program(const lg_policy *p) {
    return p->program;
}
size_t lg_policy_parameters(const lg_policy *p) {
    return p->parameters;
}
const lg_policy_regulator *lg_policy_regulator_of(const lg_policy *p) {
    return &p->regulator;
}
size_t lg_policy_steps(const lg_policy *p) {
    return lg_policy_periods(p, p->task.within);
}
