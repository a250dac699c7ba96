/* Internals of liegrad/policy.h. */
#ifndef LG_CONTROL_POLICY_H
#define LG_CONTROL_POLICY_H

#include <math.h>

#include "core/clean.h"
#include "liegrad/networks.h"
#include "liegrad/policy.h"
#include "liegrad/tape.h"

LG_AT(lg_policy_destroy, lg_policy)

/* ---- coordinates (policy_errors.c) ---- */

/* Where a coordinate's numbers lie among positions, positions as controllers get them, velocities and
 * errors. */
typedef struct lg_policy_place {
    uint32_t position, given, velocity, error, rate; /* error: of the position; rate: of the velocity */
} lg_policy_place;

typedef struct lg_policy_layout {
    uint32_t positions, given, velocities, errors, noise; /* sums over all coordinates; errors = z */
    lg_policy_place at[LG_POLICY_COORDINATES];
    uint32_t owner[6 * LG_POLICY_COORDINATES]; /* the coordinate of each error; velocities' are behind */
    double basis[LG_POLICY_COORDINATES][6];    /* (3, 2): of the plane across the goal of a direction */
} lg_policy_layout;
void lg_policy_lay_out(const lg_policy_task *task, lg_policy_layout *out);

typedef struct lg_policy_seen { /* positions and velocities, (B, ...); v LG_NONE: no velocities */
    lg_var q, v;
} lg_policy_seen;
/* Record the errors z (B, errors; `counted`: with q - goal for an angle, on the real line), the sum of the
 * costs of positions and velocities (B, 1), the features of a network (B, lg_policy_features), and positions
 * from positions as controllers get them; with `given`, these from positions. */
lg_var lg_policy_record_errors(lg_tape *tape, const lg_policy *p, bool counted, lg_policy_seen seen);
/* The sum over turning coordinates of factors[i] (4 sin^2(a/2) - |z_i|^2), (B, 1): what the errors lose
 * near the opposite side. LG_NONE: no coordinate turns. */
lg_var lg_policy_record_lost(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var z,
                             const double *factors);
lg_var lg_policy_record_stage(lg_tape *tape, const lg_policy *p, lg_policy_seen seen);
uint32_t lg_policy_features(const lg_policy_task *task);
lg_var lg_policy_record_features(lg_tape *tape, const lg_policy *p, const double *scales,
                                 lg_policy_seen seen);
lg_var lg_policy_record_positions(lg_tape *tape, const lg_policy *p, bool given, lg_var q);
/* Record the position and velocity at the errors z from the goal: a rotation turns by the vector z. */
lg_policy_seen lg_policy_record_place(lg_tape *tape, const lg_policy *p, lg_var z);
/* Sensors' noise. noise (B, layout.noise) has numbers for the positions, then for the velocities, 3 for a
 * direction or rotation: it turns by that vector, a direction to first order. sizes: standard deviations. */
enum { LG_POLICY_NOISE = 6 * LG_POLICY_COORDINATES };
void lg_policy_noise_sizes(const lg_policy_task *task, double *sizes);
lg_policy_seen lg_policy_record_noise(lg_tape *tape, const lg_policy *p, lg_policy_seen seen, lg_var noise);
/* Draws the errors of a start. */
void lg_policy_draw(const lg_policy *p, lg_rng *rng, double *z);
static inline double lg_policy_reach(const double *range) {
    return fmax(fabs(range[0]), fabs(range[1]));
}
/* Whether positions q with the errors z are inside the bounds of success. Opposite to the goal z is 0 too. */
bool lg_policy_inside(const lg_policy *p, const double *q, const double *z);

/* ---- the policy ---- */

/* The parts of a state x: the plant's state, inputs of earlier periods (of each input, the last one first),
 * integrals, and lagged inputs as the controller computes them. */
typedef struct lg_policy_memory {
    uint32_t plant, positions;                  /* numbers of the plant's state, and of its positions */
    uint32_t lags;                              /* of its positions, the lagged inputs: the last ones */
    uint32_t known[LG_POLICY_INPUTS];           /* past inputs that the controller sees */
    uint32_t line[LG_POLICY_INPUTS];            /* past inputs in x */
    uint32_t lines, integrals, believed, count; /* sums; count: of all numbers behind the plant's */
    double late[LG_POLICY_INPUTS];              /* periods by which the plant's inputs act late */
} lg_policy_memory;

struct lg_policy {
    const lg_context *context;
    lg_policy_task task;
    lg_policy_layout layout;
    lg_program *program;
    uint32_t state, inputs; /* numbers in x and u */
    lg_policy_memory memory;
    lg_policy *warm;           /* on the plant with soft friction, where training begins; NULL: none */
    const lg_policy *believes; /* of a transplanted policy, its draws: whose lags the controller computes */
    lg_policy_regulator regulator;
    double scale[LG_POLICY_ERRORS]; /* of the features of a network, by error */
    double G[LG_POLICY_INPUTS *
             LG_POLICY_ERRORS];         /* energy: (inputs, errors) of positions, then of velocities */
    double terminal;                    /* w of W */
    double first[2 * LG_POLICY_INPUTS]; /* where training of compensation begins: log k, then log w */
    lg_mlp net;
    size_t parameters;
    double *theta;     /* (parameters); the program's parameter `policy` */
    lg_policy **draws; /* (draw_count): the other machines of a disturbed task */
    size_t draw_count;
};

static inline double lg_policy_half_range(const lg_policy *p, uint32_t input) {
    return 0.5 * (p->task.input[input].high - p->task.input[input].low);
}
static inline bool lg_policy_has(const lg_policy *p, const char *function) {
    size_t number;
    return lg_program_find(p->program, function, &number, NULL) == LG_OK;
}
/* Checks the task and sets sizes, with room for theta. lg_policy_adopt checks the program that the policy
 * was loaded with, takes its parameters, sets the goals of lagged inputs from the regulator, and replaces the
 * program by one whose own derivatives are made anew. */
LG_API lg_status lg_policy_prepare(lg_policy *policy, lg_error *error);
LG_API lg_status lg_policy_adopt(lg_policy *policy, lg_error *error);
/* Writes random parameters. */
void lg_policy_initialise(const lg_policy *policy, uint64_t seed, double *theta);
/* The policy on a plant with softer friction (lg_policy_soften). *out NULL: there is no dry friction.
 * `motion`: only the functions of motion are made. */
lg_status lg_policy_make_soft(const lg_policy *policy, const double *speed, bool motion, lg_policy **out,
                              lg_error *error);
/* Makes theta the policy's parameters. */
lg_status lg_policy_take(lg_policy *policy, const double *theta);

/* ---- what the controller remembers (policy_memory.c) ---- */

/* Adds the coordinates of past inputs and integrals to the task. */
lg_status lg_policy_extend_task(lg_policy_task *task, lg_error *error);
/* Lays out the memory for a plant whose inputs act `dead_time` seconds late; NULL: as late as before. */
void lg_policy_lay_out_memory(lg_policy *policy, const double *dead_time);
/* Replaces the names of the plant's functions step, momenta, positions, velocities and value, if there is a
 * memory; lg_policy_add_memory then adds functions of these names for states with a memory. */
const char *lg_policy_plant_name(const lg_policy *policy, const char *function);
lg_status lg_policy_add_memory(lg_policy *policy, lg_error *error);
/* Records the state after a period in which the controller gives u. late (B, 1): share by which the inputs
 * act a further period late, and `dropped` (B, inputs): the inputs before the oldest ones in x; LG_NONE:
 * none. */
lg_var lg_policy_record_period(lg_tape *tape, const lg_policy *policy, lg_var x, lg_var u, lg_var dropped,
                               lg_var late);
/* The inputs that the memory drops in this period. */
lg_var lg_policy_record_dropped(lg_tape *tape, const lg_policy *policy, lg_var x, lg_var u);
/* The part of the plant in a state x. */
lg_var lg_policy_plant_part(lg_tape *tape, const lg_policy *policy, lg_var x);
/* Fails for certificates: dead times that are no whole periods; `any`: all dead times, and integrals. */
lg_status lg_policy_check_memory(const lg_policy *policy, bool any, lg_error *error);
/* For certificates: the inputs that act during a period in which the controller gives u at x, then the
 * constant rates that bring the memory to its next value in a period. Dead times are whole periods. */
lg_var lg_policy_record_acting(lg_tape *tape, const lg_policy *policy, lg_var x, lg_policy_seen seen,
                               lg_var u);
/* Adds remember and reset. */
lg_status lg_policy_add_remember(lg_policy *policy, lg_error *error);
/* (B, n) with rows like those of x. */
lg_var lg_policy_filled(lg_tape *tape, lg_var x, uint32_t n, double value);

/* ---- functions of the program (policy_program.c) ---- */

/* Begins the definition of a function for lg_program_add (`user` is the policy p). Its body sets `out`; the
 * function returns the status of the tape. */
#define LG_POLICY_RECORDING(function)                                                                        \
    static void function##_of(const lg_policy *p, lg_tape *tape, const lg_var *theta, const lg_var *in,      \
                              lg_var *out);                                                                  \
    static lg_status function(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,              \
                              lg_var *out) {                                                                 \
        function##_of(user, tape, theta, in, out);                                                           \
        return lg_tape_status(tape);                                                                         \
    }                                                                                                        \
    static void function##_of(const lg_policy *p, lg_tape *tape, const lg_var *theta, const lg_var *in,      \
                              lg_var *out)

/* A function of the program: a row of names of its ports, which policy_ports.c explains. A port without
 * numbers is left out. */
typedef struct lg_policy_function {
    const char *name;
    lg_record_function record; /* `user` is the policy */
    const char *in[5], *out[4];
} lg_policy_function;
lg_status lg_policy_add_row(const lg_policy *policy, const lg_policy_function *row, lg_error *error);
/* Does the same, and passes `user` instead of the policy to the recording. */
lg_status lg_policy_add_row_with(const lg_policy *policy, const lg_policy_function *row, const void *user,
                                 lg_error *error);
/* Adds a function of policy_program.c by its name, or its adjoint: adj1_NAME.
 *   disturbed_regulator  (s, K, noise, late) -> next, cost, u; lg_policy_add_regulated adds it for a
 *                        disturbed task
 *   planned              (x, y, how) -> next, cost, u. With the half range of the inputs and
 *                        r = half y + how_0 policy(x) + how_1 regulator(x), u = sat(r) + how_2 (r - sat(r)),
 *                        and how_3 |(r - sat(r))/half|^2 is added to the cost of the period.
 *                        y (B, inputs), how (B, LG_POLICY_PLANNED)
 *   sensed_by_control    (x) -> what `control` takes: its name leaves `sensed` to the plant */
LG_API lg_status lg_policy_add(const lg_policy *policy, const char *name, lg_error *error);
enum { LG_POLICY_BEYOND = 2, LG_POLICY_PENALTY = 3, LG_POLICY_PLANNED = 4 };
/* Makes a program with the plant's functions, retract (z) -> x, and the plant's parameters. A further
 * parameter `policy` (zeros) is added if the policy has parameters. */
lg_status lg_policy_begin(lg_policy *policy, const lg_program *plant, lg_error *error);
/* Adds period (x, u) -> next, errors (x) -> z, lagged (a, u) -> next if the plant has lags, linear (z, u)
 * -> z of the next period from the tangent at the goal, and jac_linear; then regulated (x, K) -> next,
 * cost, u with a shared gain, which needs u0. */
lg_status lg_policy_add_motion(lg_policy *policy, lg_error *error);
lg_status lg_policy_add_regulated(lg_policy *policy, lg_error *error);
/* Adds policy, control, closed, terminal, and the adjoints adj1_closed and adj1_terminal; of a disturbed task
 * also what lg_policy_add_disturbed adds: disturbed, disturbed_end and their adjoints. */
lg_status lg_policy_add_functions(lg_policy *policy, lg_error *error);
lg_status lg_policy_add_disturbed(lg_policy *policy, lg_error *error);
/* Plans of `count` functions of the policy, or of each of its draws (`drawn`). */
typedef struct lg_policy_plans {
    const lg_context *context;
    lg_plan **plan;               /* (machines, count) */
    size_t machines, count, work; /* work: bytes that a plan needs */
} lg_policy_plans;
/* On failure too, lg_policy_plans_destroy must be called. */
LG_API lg_status lg_policy_plans_create(const lg_policy *policy, bool drawn, const char *const *functions,
                                        size_t count, lg_dtype dtype, size_t rows, lg_policy_plans *out,
                                        lg_error *error);
LG_API void lg_policy_plans_destroy(lg_policy_plans *plans);

/* Rows of the plans that run batches: a batch is cut into pieces of so many rows, whatever the number of
 * threads. */
#define LG_POLICY_ROWS 64

/* ---- observer and adaptation (policy_observe.c, policy_adapt.c): functions with a memory, for plants of
 * lines and angles whose state is positions and one momentum for each, n = layout.given ---- */

/* sensor: standard deviation of each position's noise; drift: standard deviation of the error of each
 * predicted velocity after a period; tiny: the smallest normal number of the function's type */
typedef struct lg_policy_filter {
    const lg_policy *policy;
    double sensor[LG_POLICY_COORDINATES], drift[LG_POLICY_COORDINATES], tiny;
} lg_policy_filter;
/* Adds observe_step (x, u) -> next, its Jacobian, and observe (seen, u, memory) -> kept. They call
 * sensed_by_control, which the program must have. */
LG_API lg_status lg_policy_add_observer(const lg_policy_filter *filter, lg_error *error);

/* For each velocity the adaptation finds LG_POLICY_FOUND numbers: damping, Coulomb friction, offset, inertia.
 * Its memory has LG_POLICY_ADAPT numbers. */
enum { LG_POLICY_FOUND = 4, LG_POLICY_ADAPT = LG_POLICY_FOUND * (LG_POLICY_FOUND + 1) };
/* scale, speed: typical forces and velocities; range: of each number that is found; keep: the factor by which
 * a period reduces the weight of older data; tiny: as above */
typedef struct lg_policy_adaptation {
    const lg_policy *policy;
    double scale[LG_POLICY_COORDINATES], speed[LG_POLICY_COORDINATES],
        range[LG_POLICY_COORDINATES][LG_POLICY_FOUND], keep, tiny;
} lg_policy_adaptation;
LG_API extern const double lg_policy_adapt_lowest[LG_POLICY_FOUND]; /* lower bounds; upper ones: 1 */
/* Sets scale, speed and range from the states and the controller's view (periods + 1, 2 n) of a run. */
LG_API void lg_policy_find_ranges(lg_policy_adaptation *a, const double *state, const double *seen,
                                  size_t periods);
LG_API lg_status lg_policy_add_adaptation(const lg_policy_adaptation *a, lg_error *error);
/* Record the plant's state from positions and velocities x, and 1/x, which is 0 where x is below `tiny`. */
lg_var lg_policy_record_state(lg_tape *tape, const lg_policy *policy, lg_var x);
lg_var lg_policy_record_inverse(lg_tape *tape, double tiny, lg_var x);

/* ---- machines of one coordinate (policy_rotation.c) ---- */

/* p = M v and, with n velocities, p' - p x v = rest - D v + B u: M, D (n, n), B (n, inputs); n is 1, or 3
 * in the axes of a body. */
typedef struct lg_policy_body {
    double rest[3], mass[9], damping[9], map[3 * LG_POLICY_INPUTS];
} lg_policy_body;
lg_status lg_policy_needs_energy(const lg_policy *policy, lg_error *error); /* LG_UNSUPPORTED: another kind */
/* Finds M, D and B of a policy of kind energy, whose machine has one coordinate, and compares them at
 * positions all around and at rates up to ten times the largest of the starts. */
lg_status lg_policy_probe(const lg_policy *policy, lg_policy_body *out, lg_error *error);

/* ---- positions that may be shifted: tracked or free ones (policy_track.c) ---- */

/* Compares the motion of a machine with and without a shift of each free and, if `tracked`, of each tracked
 * coordinate, at random states. LG_CHECK_FAILED: it differs. */
lg_status lg_policy_check_shifts(const lg_policy *policy, bool tracked, uint64_t seed, lg_error *error);

/* ---- runs (policy_runs.c) ---- */

/* States (count, state) from positions and velocities, and these from states. */
LG_API lg_status lg_policy_states_at(const lg_policy *policy, const double *q, const double *v, size_t count,
                                     double *x, lg_error *error);
LG_API lg_status lg_policy_see(const lg_policy *policy, const double *x, size_t count, double *q, double *v,
                               lg_error *error);
/* Whether one of the inputs u is at a limit, to a thousandth of its range. */
LG_API bool lg_policy_at_limit(const lg_policy *policy, const double *u);
/* States (count, state) from errors z (count, errors), by the function retract. */
LG_API lg_status lg_policy_states(const lg_policy *policy, const double *z, size_t count, double *x,
                                  lg_error *error);
/* Draws the states (count, state) of starts and, unless u is NULL, inputs (count, inputs) in their limits. */
LG_API lg_status lg_policy_starts(const lg_policy *policy, lg_rng *rng, size_t count, double *x, double *u,
                                  lg_error *error);

typedef struct lg_policy_trial {
    const double *gain;  /* the shared input K of `regulated`; NULL: runs of the policy with theta */
    const double *theta; /* the policy's parameters */
    bool disturbed;
    uint64_t seed; /* of the disturbances */
    int threads;
} lg_policy_trial;
LG_API lg_status lg_policy_run(const lg_policy *policy, const lg_policy_trial *trial, lg_policy_runs *runs,
                               lg_error *error);
/* Runs over task.within from the states x (n, state), and what they show; `wanted` as in
 * lg_policy_evaluate. */
lg_status lg_policy_try(const lg_policy *policy, const lg_policy_trial *trial, const double *x, size_t n,
                        lg_policy_outcome *out, lg_policy_runs *wanted, lg_error *error);
/* The noise of `periods` periods (periods, LG_POLICY_ROWS, n) and which of the runs of a piece are late
 * (LG_POLICY_ROWS), 0 or 1, in arrays of this type. */
void lg_policy_draw_noise(const lg_policy *policy, uint64_t seed, uint64_t piece, size_t periods,
                          lg_dtype dtype, void *noise, void *late);
size_t lg_policy_periods(const lg_policy *policy, double seconds);

/* ---- the regulator (policy_regulator.c) ---- */

/* Finds u0, K, P, c, and what depends on them: scales of features, the map G, the terminal weight. `sliding`:
 * the policy on the plant without dry friction, or NULL if the plant has none. */
lg_status lg_policy_find_regulator(lg_policy *policy, lg_policy *sliding, uint64_t seed, lg_error *error);
/* Sizes of the errors (errors). */
void lg_policy_find_sizes(const lg_policy *policy, double *size);
/* The regulator's u0 alone. It does not depend on the goals of lagged inputs. */
lg_status lg_policy_find_rest(lg_policy *policy, lg_policy *sliding, lg_error *error);

#endif
