/* Learned Hamiltonians: the training loss through every integrator, with respect to all parameters; value,
 * gradient and field with respect to the state, the parameters and the input. */
#include "lg-gradcheck/tables.h"

#include "common/app.h"
#include "liegrad/hamiltonian.h"

enum { TRAJECTORIES = 2, POINTS = 3, CHAIN_PARAMETERS = 38, PLANE_PARAMETERS = 20 };

typedef struct settings {
    lg_hamiltonian_family family;
    lg_train_integrator integrator;
    double penalty;
    lg_penalty_form form;
} settings;

/* States (q1, p1, q2, p2) on (T*S^2)^2: |q| = 1, q.p = 0. The points of one trajectory need not belong
 * together. */
static const double chain[4 * 6] = {
    2.0 / 3, -1.0 / 3, 2.0 / 3, 0.5, 1.0,  0.0, 0.0,      0.6,     0.8,     0.7, -0.8, 0.6,
    0.6,     0.0,      -0.8,    0.8, -0.5, 0.6, -1.0 / 3, 2.0 / 3, 2.0 / 3, 0.0, 0.9,  -0.9,
};

static void fill(lg_hamiltonian_family family, double *data) {
    size_t size = family == LG_HAMILTONIAN_CHAIN ? 12 : 4;
    for (size_t row = 0; row < TRAJECTORIES * POINTS; row++)
        for (size_t j = 0; j < size; j++) data[row * size + j] = chain[(row % 2 * size + j) % (4 * 6)];
}

static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    static const uint32_t hidden[1] = {4}, samples[TRAJECTORIES] = {0, 1};
    const settings *s = user;
    double data[TRAJECTORIES * POINTS * 12];
    lg_hamiltonian model;
    lg_fit_problem fit;
    lg_var loss = LG_NONE;
    fill(s->family, data);
    lg_status status = lg_hamiltonian_init(&model, s->family, 2, LG_POTENTIAL_MLP, hidden, 1, LG_TANH);
    lg_hamiltonian_problem problem = {.model = &model,
                                      .integrator = s->integrator,
                                      .substeps = 2,
                                      .penalty = s->penalty,
                                      .penalty_form = s->form,
                                      .trajectories = TRAJECTORIES,
                                      .points = POINTS,
                                      .dt = 0.1,
                                      .data = data};
    if (status == LG_OK) status = lg_hamiltonian_problem_check(&problem, NULL);
    if (status != LG_OK) return lg_tape_fail(tape, status, "hamiltonian", "not a learning problem");
    lg_hamiltonian_fit_problem(&problem, &fit);
    status = fit.loss(fit.user, tape, x[0], samples, TRAJECTORIES, TRAJECTORIES, &loss);
    return status == LG_OK ? loss : lg_tape_fail(tape, status, "hamiltonian", "the loss failed");
}

/* ---- value, gradient, field ---- */

typedef lg_var (*taped_fn)(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
typedef struct taped_settings {
    lg_hamiltonian_family family;
    uint32_t links;
    taped_fn function; /* NULL: the field */
} taped_settings;

/* x: state (B, d), theta, and for the field the input */
static lg_var build_taped(const void *user, lg_tape *tape, const lg_var *x) {
    static const uint32_t hidden[1] = {4};
    const taped_settings *s = user;
    lg_hamiltonian model;
    lg_hamiltonian_vars vars;
    lg_status status = lg_hamiltonian_init(&model, s->family, s->links, LG_POTENTIAL_MLP, hidden, 1, LG_TANH);
    if (status == LG_OK) status = lg_hamiltonian_bind(tape, &model, x[1], &vars);
    if (status != LG_OK) return lg_tape_fail(tape, status, "hamiltonian", "not bound");
    return s->function != NULL ? s->function(tape, &vars, x[0])
                               : lg_hamiltonian_record_field(tape, &vars, x[0], x[2]);
}

/* All parameters positive: max(0, b) is off its kink and the mass matrix definite. */
#define ROW(label, family, parameters, ...)                                                                  \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = "hamiltonian " label,                                                                    \
            .build = build,                                                                                  \
            .user = &(const settings){family, __VA_ARGS__},                                                  \
            INPUTS({.shape = S1(parameters), .low = 0.2, .high = 0.8})                                       \
        }                                                                                                    \
    }
#define CHAIN(label, integrator)                                                                             \
    ROW("chain " label, LG_HAMILTONIAN_CHAIN, CHAIN_PARAMETERS, integrator, 0.0, LG_PENALTY_MEAN_SQUARE)
#define PLANE(label, ...) ROW("separable " label, LG_HAMILTONIAN_SEPARABLE, PLANE_PARAMETERS, __VA_ARGS__)

#define TAPED(label, family, links, asked, ...)                                                              \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = "hamiltonian " label,                                                                    \
            .build = build_taped,                                                                            \
            .user = &(const taped_settings){family, links, asked},                                           \
            INPUTS(__VA_ARGS__)                                                                              \
        }                                                                                                    \
    }
#define PARAMETERS(count)                                                                                    \
    { .shape = S1(count), .low = 0.2, .high = 0.8 }
#define NUMBERS(count)                                                                                       \
    { .shape = S2(2, count) }
/* One row each; width: of the state, m: of the input. */
#define FUNCTIONS(label, family, links, width, m, count)                                                     \
    TAPED(label " value", family, links, lg_hamiltonian_record_value, NUMBERS(width), PARAMETERS(count)),    \
        TAPED(label " gradient", family, links, lg_hamiltonian_record_gradient, NUMBERS(width),              \
              PARAMETERS(count)),                                                                            \
        TAPED(label " field", family, links, NULL, NUMBERS(width), PARAMETERS(count), NUMBERS(m))

/* Parameters at which no |G(y_j) - G(x)| of the published penalty is near its kink. */
static const double off_kink[PLANE_PARAMETERS] = {0.41, 0.63, 0.25, 0.77, 0.52, 0.34, 0.68, 0.29, 0.73, 0.46,
                                                  0.57, 0.22, 0.61, 0.38, 0.79, 0.43, 0.66, 0.31, 0.27, 0.54};

static const lg_gradcheck_case rows[] = {
    FUNCTIONS("chain of one link", LG_HAMILTONIAN_CHAIN, 1, 6, 3, 22),
    FUNCTIONS("chain", LG_HAMILTONIAN_CHAIN, 2, 12, 6, CHAIN_PARAMETERS),
    FUNCTIONS("separable", LG_HAMILTONIAN_SEPARABLE, 2, 4, 2, PLANE_PARAMETERS),
    CHAIN("euler", LG_TRAIN_EULER),
    CHAIN("lie-euler", LG_TRAIN_LIE_EULER),
    CHAIN("rk4", LG_TRAIN_RK4),
    CHAIN("cf4", LG_TRAIN_CF4),
    CHAIN("rkmk4", LG_TRAIN_RKMK4),
    PLANE("euler", LG_TRAIN_EULER, 0.0, LG_PENALTY_MEAN_SQUARE),
    PLANE("rk4", LG_TRAIN_RK4, 0.0, LG_PENALTY_MEAN_SQUARE),
    PLANE("stormer-verlet", LG_TRAIN_STORMER_VERLET, 0.0, LG_PENALTY_MEAN_SQUARE),
    PLANE("stormer-verlet, penalty", LG_TRAIN_STORMER_VERLET, 0.5, LG_PENALTY_MEAN_SQUARE),
    {.function = {.name = "hamiltonian separable stormer-verlet, penalty as published",
                  .build = build,
                  .user = &(const settings){LG_HAMILTONIAN_SEPARABLE, LG_TRAIN_STORMER_VERLET, 0.5,
                                            LG_PENALTY_SUM_ABSOLUTE},
                  INPUTS({.shape = S1(PLANE_PARAMETERS), .values = off_kink, .scale = 0.25})}},
};

const lg_gradcheck_case *hamiltonian_rows(size_t *count) {
    *count = LG_COUNT(rows);
    return rows;
}
