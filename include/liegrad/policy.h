/* Controllers that are learned through a machine: a machine, its integrator and a policy are one program,
 * and the cost of closed-loop runs is differentiated exactly. The library is liegrad; the last section is
 * in liegrad_io. docs/policies.md is the guide.
 *
 *   lg_policy_create(NULL, &task, plant, seed, &policy, &error);      (plant: a program, see below)
 *   lg_policy_trainer_create(policy, NULL, &trainer, &error);
 *   lg_policy_trainer_run(trainer, &result, &error);
 *   lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 500, seed, 1, &outcome, NULL, &error);
 *
 * A run. The input u is held for `period` seconds h; s_{k+1} = F(s_k, u_k) is the machine's own step, in
 * lg_policy_task.substeps parts; u_k = pi(q_k, v_k, theta). The cost of a run from s_0 is
 *
 *   J = sum_{k < N} h (sum_i w_i d_i(q_k) + sum_j w_j v_j^2 + sum_l w_l (u_l - u0_l)^2) + W(s_N)
 *
 * with N h = horizon, d = (q - goal)^2 for a line, 2 (1 - cos(q - goal)) for an angle, 2 (1 - q.goal) for a
 * direction and tr(1 - goal^T R) for a rotation: the square of the angle from the goal, to first order. u0
 * is the constant input that holds the machine at the goal. Training minimises the mean of J over random
 * starts.
 *
 * Errors z of a state (in the order: positions of all coordinates, then velocities of all coordinates).
 * With the angle a of a coordinate from its goal they have the length 2 sin(a/2), and are the tangent
 * coordinates at the goal to first order. In the last 1e-2 rad before the opposite side, where they have no
 * direction, they fall to 0 (cos(a/2)^2 below is in fact cos(a/2)^2 + 1e-6). Success is measured by a.
 *   line       q - goal                                                       velocity v
 *   angle      sin(q - goal)/|cos((q - goal)/2)|                              velocity v
 *   direction  E^T q/cos(a/2), E (3, 2) a basis of the plane across the goal  velocity E^T omega
 *   rotation   vee(S - S^T)/(2 cos(a/2)), S = goal^T R                        velocity Omega
 *   free       none (a line or an angle whose position does not matter)       velocity v
 *
 * The regulator. u = sat(u0 - K z), where K and the matrix P of V(z) = z^T P z solve the discrete Riccati
 * equation of the linearised step for weights Q, R, which runs on the machine choose together with the level
 * c (docs/policies.md, "Kinds of controllers"): the set {V < c} is nearest to the starts, with the least mean
 * of log(V/c) over starts. In the gate of a network a second regulator acts, with the gain `near`: its
 * weights Q, R are the weights of the cost. If a task of kind lqr gives K, P is the solution of the Lyapunov
 * equation of the closed loop for Q = 1 of scaled errors. sat keeps each input in its limits.
 *
 * Memory. lg_policy_create adds lines to the task for what the controller must remember: past.u.k, the input
 * u of k periods ago, for k up to the input's dead time over the period, rounded up; and integral.x for a
 * coordinate x with `integral`. They are positions without velocities behind the other positions, they have
 * errors, and the regulator and networks use them. The state x of the program's functions then has behind the
 * plant's state the inputs of earlier periods and the integrals y, which become
 *   y + h e(x) prod_l (1 - s_l^16),   s_l = (u_l - (low + high)/2)/((high - low)/2)
 * in a period: e is the error of the coordinate, and an integral stops while an input is at a limit.
 *
 * Kinds of policies:
 *   lqr      the regulator alone; nothing is trained
 *   network  u = g u_near + (1 - g) u_net with u_near = sat(u0 - near z) and the gate
 *            g = 1/(1 + exp(4.5 (V/c - 1))); tanh keeps u_net in the limits
 *   energy   u = sat(u0 - k_p G^T z_q - k_d G^T v), with the map G from inputs to generalised forces at the
 *            goal, and k_p, k_d > 0: one number per input if trained, the same for all inputs if given. z_q
 *            of an angle is q - goal here: angles are counted, so after a full turn the controller unwinds
 *
 * Terminal cost: W = w log(1 + V/(13 c)), where w is .6 times the mean cost of the machine under u0 from the
 * starts over the horizon. The logarithm has a slope wherever a run ends. */
#ifndef LIEGRAD_POLICY_H
#define LIEGRAD_POLICY_H

#include "liegrad/files.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

#define LG_POLICY_NAME        32 /* bytes of a name, with its terminator */
#define LG_POLICY_COORDINATES 40 /* with lagged inputs, inputs of earlier periods and integrals */
#define LG_POLICY_INPUTS      16
#define LG_POLICY_ERRORS      48 /* most numbers in z */
#define LG_POLICY_HIDDEN      4
#define LG_POLICY_GAINS       256  /* most numbers of K in a task */
#define LG_POLICY_SUBSTEPS    1000 /* most integrator steps in a period */

typedef enum lg_policy_kind { LG_POLICY_LQR, LG_POLICY_NETWORK, LG_POLICY_ENERGY } lg_policy_kind;
#define LG_POLICY_KIND_COUNT 3
LG_API const char *lg_policy_kind_name(lg_policy_kind kind); /* "lqr", "network", "energy"; NULL: unknown */

typedef enum lg_policy_motion {
    LG_POLICY_LINE,
    LG_POLICY_ANGLE,
    LG_POLICY_DIRECTION,
    LG_POLICY_ROTATION
} lg_policy_motion;
#define LG_POLICY_MOTION_COUNT 4
/* Numbers of a position (line and angle 1, direction 3, rotation 9: R row-major), of a position as
 * controllers get it (rotation 4: quaternion w x y z), of a velocity, and of the errors of a position and of
 * a velocity. */
typedef struct lg_policy_motion_row {
    const char *name; /* "line", "angle", "direction", "rotation" */
    uint32_t position, given, velocity, errors, rates;
} lg_policy_motion_row;
LG_API const lg_policy_motion_row *lg_policy_motion_row_of(lg_policy_motion motion); /* NULL: unknown */

typedef struct lg_policy_coordinate {
    char name[LG_POLICY_NAME], velocity[LG_POLICY_NAME]; /* velocity "": a state of a program that has none */
    lg_policy_motion motion;
    /* 0, or 1 + the number of an input: this line without velocity is that input as it acts, behind a lag
     * (lg_machine_program). lg_policy_create sets its goal, the input that holds the machine at the goal. */
    uint32_t follows;
    /* Of coordinates that lg_policy_create adds (liegrad/policy.h, Memory), 0 in others. With `follows`:
     * the line is the input of `ago` periods ago. integrates: 1 + the number of a coordinate, whose error
     * this line integrates. */
    uint32_t ago, integrates;
    bool integral; /* the error of this line or angle is integrated */
    double goal[9];
    /* Starts: a line or angle is drawn from goal + [low, high]; a direction or rotation turns by an angle
     * from [low, high] about a random axis. Each number of the velocity is drawn from its own [low, high]. */
    double start[2], start_velocity[2];
    double weight, weight_velocity;   /* of the cost, >= 0 */
    double success, success_velocity; /* largest |error| (of an angle: in radians); INFINITY: any */
    bool track; /* the controller follows set points of this line or angle (function `track`) */
    /* The position of this line or angle does not matter (a wheel, a turntable): it is no part of z, of the
     * features of a network, of cost and success. Its velocity is. goal, weight and noise must be 0, success
     * INFINITY, track false; `start` is for the comparison alone, runs start at 0. The machine must move in
     * the same way wherever the coordinate is: lg_policy_create compares it at random states, and fails with
     * LG_CHECK_FAILED. */
    bool free;
    /* Standard deviations of the sensors' noise, of each number (of an attitude or direction: of the angle
     * about each axis); 0: none. */
    double noise, noise_velocity;
} lg_policy_coordinate;

/* The row of the coordinate's motion; a free coordinate has no errors of its position. NULL: unknown. */
LG_API const lg_policy_motion_row *lg_policy_row_of(const lg_policy_coordinate *coordinate);

typedef struct lg_policy_input {
    char name[LG_POLICY_NAME];
    double low, high; /* low < high, finite */
    double weight;    /* > 0 */
} lg_policy_input;

/* Makes a plant with softer dry friction: over speeds (velocities) of this size, or none if `speed` is NULL.
 * *out NULL: the plant has no dry friction. */
typedef lg_status (*lg_policy_soften)(void *user, const double *speed, lg_program **out, lg_error *error);

typedef struct lg_policy_task {
    size_t size; /* sizeof(lg_policy_task) */
    uint32_t coordinate_count, input_count;
    lg_policy_coordinate coordinate[LG_POLICY_COORDINATES];
    lg_policy_input input[LG_POLICY_INPUTS];
    double period, horizon; /* seconds */
    /* A run succeeds if all errors stay below their bounds during the last `hold` of `within` seconds. */
    double hold, within;
    lg_policy_kind kind;
    uint32_t hidden_layers, hidden[LG_POLICY_HIDDEN]; /* of a network, with tanh; default 32, 32 */
    bool gate;                                        /* default true; false: the network acts alone */
    /* Gains that are given; 0 of them (default): they are trained or chosen. Kind energy: k_p and k_d, for
     * all inputs. Kind lqr: K (inputs, errors), row by row. */
    uint32_t gain_count;
    double gains[LG_POLICY_GAINS];
    double dead_time[LG_POLICY_INPUTS]; /* seconds by which an input acts later than it is given, >= 0 */
    /* kinds lqr and network: the regulator is u0 + r + k tanh(r/w) with r = -K z, k and w trained, of each
     * input: against dry friction, which holds the machine where r is small. */
    bool compensate;
    /* NULL, or for plants with dry friction. The regulator is designed without dry friction, because at rest
     * it looks like a huge damping. Training begins with soft friction; its last steps, and all evaluations,
     * are on the plant itself. */
    lg_policy_soften soften;
    void *soften_user; /* its first argument; both are used by lg_policy_create alone */
    /* Default true. false: no weights of a regulator are tried, so that lg_policy_create is fast; P and W are
     * 0, c is 1, and K is 0 unless it is given. For certificates; a network with a gate needs true. */
    bool search;
    /* Disturbances of training: the share of the runs in which inputs act a period late, and the number of
     * other machines (lg_policy_add_draw). A task with a disturbance is disturbed; see lg_policy_test. */
    double delay;
    uint32_t draws;
    double spread; /* of these machines: standard deviation of each learned number, over its size */
    /* Integrator steps in a period, 1 to LG_POLICY_SUBSTEPS; 0: as many as keep its error below 1e-4. */
    uint32_t substeps;
} lg_policy_task;
LG_API void lg_policy_task_init(lg_policy_task *task);

typedef struct lg_policy lg_policy;

/* Makes a policy with random (seeded) parameters. `plant` is a program with the function
 *   step       (x, u, h) -> next, and if there are velocities
 *   momenta    (q, v) -> x, positions (x) -> q, velocities (x) -> v
 * as lg_machine_program with `lagged` makes it. Without velocities x = q are the positions. For `energy` also
 * value (x)
 * -> H. The policy takes ownership of the plant, also when it fails; the caller destroys the policy.
 * Errors: LG_INVALID_ARGUMENT (the task is out of range), LG_NOT_FOUND, LG_SHAPE (functions that the plant
 * lacks or that do not fit the task), LG_CHECK_FAILED (the goal is no equilibrium: the message has the
 * residual; no regulator holds it), those of lg_program_build. */
LG_API lg_status lg_policy_create(const lg_context *context, const lg_policy_task *task, lg_program *plant,
                                  uint64_t seed, lg_policy **out, lg_error *error);
LG_API void lg_policy_destroy(lg_policy *policy);
/* The task, with the substeps that were chosen; it belongs to the policy. */
LG_API const lg_policy_task *lg_policy_task_of(const lg_policy *policy);
/* The plant's functions and parameters; parameter `policy` (theta); and the functions
 *   errors     (x) -> z
 *   policy     (q, v, weights) -> u          `weights` is a shared input like theta; without velocities no v
 *   lagged     (a, u) -> next                the lagged inputs a after a period in which u is held, if
 *                                            there are lagged inputs
 *   remember   (x, u) -> next                and
 *   reset      (x) -> first                  if there is a memory, in place of `lagged`: the lagged inputs,
 *                                            past inputs and integrals in x as `control` takes it, after a
 *                                            period in which u was given, and at the beginning
 *   control    (x) -> u                      x: positions as controllers get them, then velocities. x
 *                                            has the free positions, too; u does not depend on them
 *   closed     (x, weights) -> next, cost, u   one period
 *   regulated  (x, K) -> next, cost, u         one period of the saturated regulator
 *   terminal   (x) -> cost                   W
 * and if coordinates are tracked, with `reference` = their set points, then the set points' rates (a machine
 * with velocities),
 *   track      (x, reference) -> u           as control, with the goal of these coordinates at the set points
 * and of a disturbed task, with the state s = (x, the input of the period before) and `late` 0 or 1,
 *   disturbed      (s, weights, noise, late) -> next, cost, u
 *   disturbed_end  (s) -> cost */
LG_API const lg_program *lg_policy_program(const lg_policy *policy);
LG_API size_t lg_policy_parameters(const lg_policy *policy);
LG_API size_t lg_policy_steps(const lg_policy *policy); /* periods in task.within */

/* The regulator. */
typedef struct lg_policy_regulator {
    uint32_t errors, inputs;
    double K[LG_POLICY_INPUTS * LG_POLICY_ERRORS]; /* (inputs, errors) */
    /* (inputs, errors): in the gate of a network, K or the gain of the regulator of the cost */
    double near[LG_POLICY_INPUTS * LG_POLICY_ERRORS];
    double P[LG_POLICY_ERRORS * LG_POLICY_ERRORS]; /* (errors, errors) */
    double u0[LG_POLICY_INPUTS];
    double c; /* level: all sampled runs of the saturated regulator, by K and near, from {V < c} succeed */
    double radius;   /* largest |eigenvalue| of the linear closed loop, < 1 */
    double residual; /* change of z in a period at the goal under u0, over the size of z of the starts */
} lg_policy_regulator;
LG_API const lg_policy_regulator *lg_policy_regulator_of(const lg_policy *policy);

/* ---- functions for certificates (liegrad/certify.h) ---- */

/* Adds the closed loop, with inputs that are held for a period, to the policy's program:
 *   rate_by_input   (z, a) -> z'  z = (positions - goal, velocities), angles counted on the real line; z = x
 *                                 - goal without velocities; free positions are no part of z. Lagged inputs,
 *                                 inputs of earlier periods and integrals are positions. a: the inputs that
 *                                 act, then the constant rates by which the inputs of earlier periods and
 *                                 integrals come to their next values at the end of a period
 *   input_by_state  (z) -> a      by the policy
 *   advance_by_input, advance     (z, a) -> z, (z) -> z after a period, by the classical Runge-Kutta method
 *                                 in task.substeps parts
 *   rate            (z) -> z'     rate_by_input under input_by_state: the continuous loop, if no input acts
 *                                 late
 *   rate_by_gains, advance_by_gains  (z, K) -> the same with the saturated regulator of a shared K
 * `program`: the policy's program, to which a Lyapunov function may be added; it belongs to the policy. If
 * the functions are there already, nothing is added. Errors: LG_UNSUPPORTED (directions, rotations, bristles,
 * dead times that are no whole periods, a free position that operations of the plant's motion use),
 * LG_NOT_FOUND (a plant without `field`), those of lg_program_add_function. */
LG_API lg_status lg_policy_add_rate(lg_policy *policy, lg_program **program, lg_error *error);

/* For a network with a gate, of a machine of lines and angles, |angle| <= pi: an upper bound *ratio of V/c
 * of the gate over {z: z^T P z <= level}, P (n, n) symmetric and positive definite. The regulator has at
 * least the part 1/(1 + exp(4.5 (*ratio - 1))) of the input there. Errors: LG_INVALID_ARGUMENT (P),
 * LG_UNSUPPORTED (no gate; other coordinates; more than 8 angles). */
LG_API lg_status lg_policy_bound_gate(const lg_policy *policy, const double *P, double level, double *ratio,
                                      lg_error *error);

/* For lg_certify_energy_spec, which explains the numbers */
typedef struct lg_policy_slope {
    double damping, gain, saturated;
} lg_policy_slope;
/* For a policy of kind energy of a machine with one coordinate (a line or an angle), one input and a
 * constant mass: adds the function `slope` (z) -> g, minus the rate of the momentum at v = 0 under u =
 * policy(goal + z, 0), and fills `out`. That the mass, the damping and the map of the input are constant is
 * compared at several states, it is not proved. Errors: those of lg_policy_add_rate; LG_UNSUPPORTED (another
 * kind or machine, a dead time, integrals; the potential of a line is not constant, so it has no period);
 * LG_CHECK_FAILED (the damping is not linear, or not positive). */
LG_API lg_status lg_policy_add_slope(lg_policy *policy, lg_policy_slope *out, lg_error *error);

/* For lg_certify_rotation_spec, which explains the numbers */
typedef struct lg_policy_turn {
    double J[9], stiffness, damping;
    uint32_t inputs;
    double map[LG_POLICY_INPUTS * 3], gains[2], limit[LG_POLICY_INPUTS]; /* map (inputs, 3) */
} lg_policy_turn;
/* For a policy of kind energy of a machine with one rotation. That the inertia, the damping and the map of
 * the inputs are constant, and that nothing but inputs and damping turns the machine, is compared at several
 * rotations and rates, it is not proved. Errors: LG_NOT_FOUND (a plant without `field`), LG_UNSUPPORTED
 * (another kind or machine, a dead time; a stiffness that depends on the axis), LG_CHECK_FAILED (the damping
 * is not linear). */
LG_API lg_status lg_policy_find_turn(const lg_policy *policy, lg_policy_turn *out, lg_error *error);

/* How many coordinates of the task are tracked. Set points need a machine that moves in the same way wherever
 * these coordinates are: lg_policy_create compares it at random states, and fails with LG_CHECK_FAILED. */
LG_API uint32_t lg_policy_tracked(const lg_policy_task *task);

/* ---- disturbances ---- */

/* Replaces the disturbances of the policy's task by the disturbances of the task `by`, so that the policy
 * can be evaluated under them. Both tasks must have the same coordinates, except those that lg_policy_create
 * adds. Errors: LG_SHAPE (other coordinates), LG_INVALID_ARGUMENT, those of lg_program_add_function. */
LG_API lg_status lg_policy_disturb(lg_policy *policy, const lg_policy_task *by, lg_error *error);
/* Adds another machine that the policy must serve too, such as a draw from the covariance of a fit. Training
 * and judgement of disturbed runs take the machines that were added in turn; without one they take the
 * policy's machine. The inputs act as late as those of the policy's machine. The policy takes ownership of
 * the plant. Errors: those of lg_policy_create, LG_SHAPE (the state has another dimension). */
LG_API lg_status lg_policy_add_draw(lg_policy *policy, lg_program *plant, lg_error *error);
/* Whether the task has noise, a delay or draws. */
LG_API bool lg_policy_is_disturbed(const lg_policy_task *task);

/* ---- training ---- */

typedef struct lg_policy_progress {
    uint64_t step, steps; /* of all */
    uint32_t seed;        /* the seed that leads */
    double cost,
        success; /* of the leading seed on the validation starts, success as a share; NaN: not known yet */
    double seconds;
} lg_policy_progress;

typedef struct lg_policy_train_options {
    size_t size;
    uint32_t seeds;                /* in the race; default 8 */
    uint32_t starts;               /* of a step of Adam; default 64, a multiple of 64 */
    uint64_t race, finish, polish; /* steps of Adam in the race (450), then (1000), and of L-BFGS (100) */
    double lr;                     /* default 2e-2, cosine schedule */
    double seconds;                /* bound on the wall time; 0: none. Phases are shortened to fit it. */
    uint64_t seed;
    int threads; /* default 1; the result does not depend on it */
    /* NULL, or the processes that train together: each runs a part of the runs. Then the functions of the
     * trainer are collective, and all ranks end with the same bits as one process. */
    const lg_ranks *ranks;
    void (*progress)(void *user, const lg_policy_progress *now);
    void *user;
} lg_policy_train_options;
LG_API void lg_policy_train_options_init(lg_policy_train_options *options);

typedef struct lg_policy_train_result {
    double cost, success; /* on 512 validation starts */
    uint32_t seed;        /* that won */
    double seconds;
} lg_policy_train_result;
/* A trainer: the race of seeds that docs/policies.md describes, then L-BFGS on 512 fixed starts over the
 * whole horizon. The policy gets the best parameters that the validation starts saw, by success, then by
 * cost. With options.seconds the winner's steps are not repeated. If the task is disturbed, all runs are. For
 * `lqr`, and for `energy` with given gains, the trainer only evaluates the policy.
 *
 * `options` NULL means the defaults. The policy must outlive the trainer. After LG_CANCELLED
 * lg_policy_trainer_save stores the state; a trainer with the same policy and options loads it and runs
 * on, with the same bits (unless options.seconds bounds them). Errors of create: LG_INVALID_ARGUMENT; of run:
 * LG_NOT_FINITE (all seeds), LG_CANCELLED (the context's cancel flag; the policy has the best parameters so
 * far); of load: LG_INVALID_ARGUMENT (other options), LG_FORMAT (the trainer must then be destroyed).
 * `result` may be NULL. If one rank alone fails, such as for memory, the caller must end the other ranks
 * (lg_mpi_abort). */
typedef struct lg_policy_trainer lg_policy_trainer;
LG_API lg_status lg_policy_trainer_create(lg_policy *policy, const lg_policy_train_options *options,
                                          lg_policy_trainer **out, lg_error *error);
/* Runs what is left of the training. */
LG_API lg_status lg_policy_trainer_run(lg_policy_trainer *trainer, lg_policy_train_result *result,
                                       lg_error *error);
/* Stores the state of a training. */
LG_API lg_status lg_policy_trainer_save(const lg_policy_trainer *trainer, const lg_archive_writer *to,
                                        lg_error *error);
/* Restores the state of a training. */
LG_API lg_status lg_policy_trainer_load(lg_policy_trainer *trainer, const lg_archive_reader *from,
                                        lg_error *error);
LG_API void lg_policy_trainer_destroy(lg_policy_trainer *trainer);

/* ---- evaluation ---- */

/* Makes a copy of the policy with another plant, which the copy owns (NULL: the policy's own plant).
 * lg_policy_evaluate of the copy shows what a difference between machine and model does. The regulator and
 * theta are the policy's. The integrator takes so many steps in a period that its error stays below
 * 1e-6. The inputs of the plant act `dead_time` (inputs) seconds late; NULL: the dead times of the policy.
 * The controller does not know the new plant: it uses the dead time and the lag of the policy's plant, with
 * and without disturbances. The policy must outlive the copy.
 * Errors: those of lg_policy_create, LG_UNSUPPORTED (other dead times of a plant without velocities). */
LG_API lg_status lg_policy_transplant(const lg_policy *policy, lg_program *plant, const double *dead_time,
                                      lg_policy **out, lg_error *error);

typedef struct lg_policy_outcome {
    uint64_t starts, succeeded;
    double cost_mean, cost_median;    /* of J without W, over `within` seconds */
    double saturated;                 /* share of the periods in which an input was at a limit */
    double worst;                     /* largest cost */
    uint64_t worst_start;             /* its start */
    double success_low, success_high; /* Wilson's interval of the share of successes, 95 % */
} lg_policy_outcome;

/* What runs did, for each of `count` starts. */
typedef struct lg_policy_runs {
    size_t count, steps; /* periods */
    double *x;           /* (count, state): the starts; then the ends */
    double *cost;        /* (count): sum of stage costs; NULL: not wanted */
    bool *succeeded;     /* (count) */
    double *saturated; /* (count): share of the periods in which an input was at a limit; NULL: not wanted */
    double *path;      /* (steps + 1, count, errors): z; NULL: not wanted */
    double *input;     /* (steps, count, inputs); NULL: not wanted */
    double *motion;    /* (steps + 1, count, state): x; NULL: not wanted */
    double *costs;     /* (steps, count): cost of each period; NULL: not wanted */
} lg_policy_runs;

typedef enum lg_policy_test {
    LG_POLICY_NOMINAL,
    LG_POLICY_REGULATED, /* the saturated regulator alone */
    /* With the task's disturbances: noise of the sensors, inputs a period late in a share of the runs, and
     * the machines of lg_policy_add_draw in turn, one for 64 runs. */
    LG_POLICY_DISTURBED
} lg_policy_test;

/* Runs the policy from `starts` random starts over task.within seconds. `runs` (may be NULL): arrays that
 * the caller provides are filled; count and x are not read. Errors: LG_INVALID_ARGUMENT (also: the task has
 * no disturbances). */
LG_API lg_status lg_policy_evaluate(const lg_policy *policy, lg_policy_test test, uint64_t starts,
                                    uint64_t seed, int threads, lg_policy_outcome *out, lg_policy_runs *runs,
                                    lg_error *error);

/* The cost J of a run of the policy, with W, over the horizon of the task, without disturbances; the cost of
 * the best inputs that a search found for the same start; and cost/best >= 1 (1 if both are 0). `best` is an
 * upper bound of the optimum, so `ratio` is a lower bound of the policy's cost over the optimum's. */
typedef struct lg_policy_gap {
    double cost, best, ratio;
    double errors[LG_POLICY_ERRORS]; /* of the start */
} lg_policy_gap;

/* Fills out (starts) for the first starts that lg_policy_evaluate takes with the same seed. J is minimised
 * over the inputs of all periods, each held and in its limits, by L-BFGS from eight guesses: the inputs of
 * the policy, of the regulator, u0, and random ones; then eight times from the best inputs of this start and
 * of the seven starts after it. Inputs may pass their limits at a price that grows from round to round, but
 * `best` is the cost of a run with inputs in their limits. The search ends after `seconds` of wall time (0:
 * no bound), and *complete (may be NULL) is then false. It runs in the calling thread. The function `planned`
 * is added to the policy's program. Errors: LG_INVALID_ARGUMENT (not 1 to 1000 starts), LG_CANCELLED, those
 * of lg_program_add_function. */
LG_API lg_status lg_policy_find_gaps(lg_policy *policy, size_t starts, uint64_t seed, double seconds,
                                     lg_policy_gap *out, bool *complete, lg_error *error);

/* ---- files (library liegrad_io) ---- */

/* Reads a task in two steps, because its names are those of the plant. lg_policy_task_read sets the
 * defaults, reads the name of the plant's file into `plant` (`size` bytes), the coordinates of a plant that
 * is a program (key `states`), and the whole text, which the caller frees with lg_free. The caller then
 * adds names and kinds of coordinates and inputs, and lg_policy_task_parse reads the rest. docs/control.md
 * has the keys. Errors: LG_NOT_FOUND, LG_FILE (the file), LG_FORMAT (with the line). */
LG_API lg_status lg_policy_task_read(const lg_context *context, const char *path, lg_policy_task *task,
                                     char *plant, size_t size, char **text, lg_error *error);
LG_API lg_status lg_policy_task_parse(const lg_context *context, const char *path, const char *text,
                                      lg_policy_task *task, lg_error *error);
/* Saves a policy with the text of its task, as a file of kind "policy"; lg_program_load reads its
 * functions. lg_policy_load: `text` (may be NULL) becomes the task's text. The functions of the file must be
 * those that its task, plant and regulator give; lg_policy_load records the policy's derivatives again.
 * Errors: as of lg_program_save and lg_program_load. */
LG_API lg_status lg_policy_save(const lg_context *context, const char *path, const lg_policy *policy,
                                const char *text, const lg_provenance *provenance, lg_error *error);
LG_API lg_status lg_policy_load(const lg_context *context, const char *path, const lg_read_options *options,
                                lg_policy **out, char **text, lg_error *error);

LG_END_DECLS

#endif
