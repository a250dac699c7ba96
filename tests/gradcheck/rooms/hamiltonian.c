/* Cases of the gradient check for learned Hamiltonians, for every family of the table: value, gradient and
 * field, differentiated by the state, the parameters and the input; and the training loss, differentiated
 * through the integrators by all parameters. */
#include <stdio.h>
#include <string.h>

#include "gradcheck/table.h"
#include "hamiltonian/internal.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/mechanics.h"

enum { TRAJECTORIES = 2, POINTS = 3, BATCH = 2, MOST_NUMBERS = 64, MOST_ROWS = 256, MOST_COPIES = 2 };

typedef enum question { VALUE, GRADIENT, FIELD, LOSS } question;

/* The settings of one case. */
typedef struct settings {
    lg_hamiltonian model;
    question asked;
    const lg_scheme *scheme; /* for LOSS only, like the members up to `distance` */
    double penalty;
    lg_penalty_form form;
    const lg_first_integral *integral;
    lg_hamiltonian_distance distance;
    char name[160];
    lg_gradcheck_argument arguments[3];
} settings;

/* ---- data ---- */

/* Fills `data` with states on the manifold. The points of a trajectory do not follow each other in time. */
static void fill(const lg_hamiltonian *model, double *data) {
    static const double numbers[] = {2.0 / 3, -1.0 / 3, 2.0 / 3,  0.5,     1.0,     0.0, 0.0,  0.6,
                                     0.8,     0.7,      -0.8,     0.6,     0.6,     0.0, -0.8, 0.8,
                                     -0.5,    0.6,      -1.0 / 3, 2.0 / 3, 2.0 / 3, 0.0, 0.9,  -0.9};
    const size_t d = lg_hamiltonian_state_dim(model);
    const lg_space space = lg_hamiltonian_space_of(model->family, model->n);
    lg_rng rng;
    lg_rng_seed(&rng, 5, 0);
    for (size_t row = 0; row < TRAJECTORIES * POINTS; row++) {
        for (size_t j = 0; j < d; j++) data[row * d + j] = numbers[(row % 2 * d + j) % LG_COUNT(numbers)];
        lg_space_project(&space, data + row * d);
        if (model->family->bodies.rotations > 0)
            (void)lg_space_draw_start(&space, NULL, &rng, data + row * d);
    }
}

static lg_hamiltonian_problem problem_of(const settings *s, const double *data) {
    return (lg_hamiltonian_problem){.model = &s->model,
                                    .scheme = s->scheme,
                                    .substeps = 2,
                                    .penalty = s->penalty,
                                    .penalty_form = s->form,
                                    .penalty_integral = s->integral,
                                    .distance = s->distance,
                                    .trajectories = TRAJECTORIES,
                                    .points = POINTS,
                                    .dt = 0.1,
                                    .data = data};
}

/* ---- what is recorded ---- */

static lg_var build_loss(const settings *s, lg_tape *tape, const lg_var *x) {
    static const uint32_t samples[TRAJECTORIES] = {0, 1};
    double data[TRAJECTORIES * POINTS * MOST_NUMBERS];
    lg_fit_problem fit;
    lg_var loss = LG_NONE;
    fill(&s->model, data);
    const lg_hamiltonian_problem problem = problem_of(s, data);
    lg_hamiltonian_fit_problem(&problem, &fit);
    const lg_status status = fit.loss(fit.user, tape, x[0], samples, TRAJECTORIES, TRAJECTORIES, &loss);
    return status == LG_OK ? loss : lg_tape_fail(tape, status, "hamiltonian", "the loss failed");
}

/* x: theta for LOSS; else state (B, d), theta, and for FIELD the input. */
static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    const settings *s = user;
    lg_hamiltonian_vars vars;
    if (s->asked == LOSS) return build_loss(s, tape, x);
    const lg_status status = lg_hamiltonian_bind(tape, &s->model, x[1], &vars);
    if (status != LG_OK) return lg_tape_fail(tape, status, "hamiltonian", "not bound");
    switch (s->asked) {
    case VALUE:
        return lg_hamiltonian_record_value(tape, &vars, x[0]);
    case GRADIENT:
        return lg_hamiltonian_record_gradient(tape, &vars, x[0]);
    default:
        return lg_hamiltonian_record_field(tape, &vars, x[0],
                                           lg_hamiltonian_input_dim(&s->model) > 0 ? x[2] : LG_NONE);
    }
}

/* ---- rows ---- */

static settings all[MOST_ROWS];
static lg_gradcheck_case cases[MOST_ROWS];
static size_t rows;

static lg_gradcheck_argument vectors(size_t width) {
    return (lg_gradcheck_argument){.shape = {2, {BATCH, (uint32_t)width}}};
}

/* All parameters are positive, so max(0, b) is off its kink and the mass matrix is positive definite. */
static lg_gradcheck_argument parameters(const lg_hamiltonian *model) {
    const uint32_t count = (uint32_t)lg_hamiltonian_parameters(model);
    return (lg_gradcheck_argument){.shape = {1, {count}}, .low = 0.2, .high = 0.8};
}

static settings *add(const lg_hamiltonian *model, question what, const char *label) {
    settings *s = &all[rows];
    const uint32_t m = lg_hamiltonian_input_dim(model);
    const bool state = what != LOSS;
    *s = (settings){.model = *model, .asked = what};
    (void)snprintf(s->name, sizeof s->name, "hamiltonian %s%s%s %s", model->family->name,
                   model->n == 1 ? " of one " : "", model->n == 1 ? model->family->copy : "", label);
    if (state) s->arguments[0] = vectors(lg_hamiltonian_state_dim(model));
    s->arguments[state ? 1 : 0] = parameters(model);
    if (what == FIELD && m > 0) s->arguments[2] = vectors(m);
    cases[rows++].function = (lg_gradcheck_function){.name = s->name,
                                                     .inputs = !state                   ? 1
                                                               : what == FIELD && m > 0 ? 3
                                                                                        : 2,
                                                     .arguments = s->arguments,
                                                     .build = build,
                                                     .user = s};
    return s;
}

/* Parameters at which no |G(y_j) - G(x)| of the penalty is near its kink at 0. */
static const double off_kink[] = {0.41, 0.63, 0.25, 0.77, 0.52, 0.34, 0.68, 0.29, 0.73, 0.46,
                                  0.57, 0.22, 0.61, 0.38, 0.79, 0.43, 0.66, 0.31, 0.27, 0.54};

static void add_loss(const lg_hamiltonian *model, const lg_scheme *scheme, double penalty,
                     lg_penalty_form form, const lg_first_integral *integral) {
    static const double nothing[TRAJECTORIES * POINTS * MOST_NUMBERS];
    const settings asked = {
        .model = *model, .scheme = scheme, .penalty = penalty, .form = form, .integral = integral};
    const lg_hamiltonian_problem problem = problem_of(&asked, nothing);
    if (lg_hamiltonian_problem_check(&problem, NULL) != LG_OK) return;
    settings *s = add(model, LOSS, scheme->name);
    s->scheme = scheme, s->penalty = penalty, s->form = form, s->integral = integral;
    if (scheme->kind == LG_SCHEME_IMPLICIT) cases[rows - 1].no_program = "solves equations";
    cases[rows - 1].rounded = scheme->kind == LG_SCHEME_VARIATIONAL;
    if (penalty == 0) return;
    (void)strcat(s->name, form == LG_PENALTY_MEAN_SQUARE ? ", penalty on " : ", published penalty on ");
    (void)strcat(s->name, integral->name);
    if (form == LG_PENALTY_SUM_ABSOLUTE && s->arguments[0].shape.dims[0] == LG_COUNT(off_kink))
        s->arguments[0] =
            (lg_gradcheck_argument){.shape = s->arguments[0].shape, .values = off_kink, .scale = 0.25};
}

static void add_geodesic_loss(const lg_hamiltonian *model, const lg_scheme *scheme) {
    static const double nothing[TRAJECTORIES * POINTS * MOST_NUMBERS];
    const settings asked = {.model = *model, .scheme = scheme, .distance = LG_DISTANCE_GEODESIC};
    const lg_hamiltonian_problem problem = problem_of(&asked, nothing);
    if (lg_hamiltonian_problem_check(&problem, NULL) != LG_OK) return;
    add_loss(model, scheme, 0, LG_PENALTY_MEAN_SQUARE, NULL);
    settings *s = &all[rows - 1];
    s->distance = LG_DISTANCE_GEODESIC;
    (void)strcat(s->name, ", geodesic");
}

/* Cases for the other kinds of potentials, with one copy. */
static void add_potentials(const lg_hamiltonian_family *family) {
    static const uint32_t hidden[1] = {4};
    lg_hamiltonian model;
    (void)lg_hamiltonian_init(&model, family, 1, LG_POTENTIAL_DICTIONARY, NULL, 0, LG_TANH);
    (void)add(&model, VALUE, "dictionary");
    (void)add(&model, FIELD, "field with a dictionary");
    (void)lg_hamiltonian_init(&model, family, 1, LG_POTENTIAL_MLP, hidden, 1, LG_TANH);
    model.symmetry = LG_SYMMETRY_EVEN;
    (void)add(&model, FIELD, "field of an even potential");
    model.symmetry = LG_SYMMETRY_ODD;
    (void)add(&model, FIELD, "field of an odd potential");
    if (lg_hamiltonian_init(&model, family, 2, LG_POTENTIAL_MLP, hidden, 1, LG_TANH) != LG_OK) return;
    if (lg_hamiltonian_set_symmetry(&model, LG_SYMMETRY_AXIAL) == LG_OK)
        (void)add(&model, FIELD, "field of an axial potential");
    if (lg_hamiltonian_set_symmetry(&model, LG_SYMMETRY_SPHERICAL) == LG_OK)
        (void)add(&model, FIELD, "field of a spherical potential");
}

static void add_family(const lg_hamiltonian_family *family) {
    static const uint32_t hidden[1] = {4};
    lg_hamiltonian model;
    for (uint32_t n = 1; n <= MOST_COPIES; n++) {
        if (lg_hamiltonian_init(&model, family, n, LG_POTENTIAL_MLP, hidden, 1, LG_TANH) != LG_OK) continue;
        (void)add(&model, VALUE, "value");
        (void)add(&model, GRADIENT, "gradient");
        (void)add(&model, FIELD, "field");
    }
    add_potentials(family);
    /* The families of bodies share their functions: the schemes are checked for one of them. */
    const bool alike = family->most == 1 && strcmp(family->name, "rotation-direction") != 0;
    for (size_t i = 0; i < lg_scheme_count() && !alike; i++)
        add_loss(&model, lg_scheme_at(i), 0, LG_PENALTY_MEAN_SQUARE, NULL);
    const lg_scheme *scheme = lg_scheme_find(family->scheme);
    add_geodesic_loss(&model, scheme);
    for (size_t i = 0; i < lg_first_integral_count(); i++)
        add_loss(&model, scheme, 0.5, LG_PENALTY_MEAN_SQUARE, lg_first_integral_at(i));
    add_loss(&model, lg_scheme_find("stormer-verlet"), 0.5, LG_PENALTY_SUM_ABSOLUTE,
             lg_first_integral_find("oscillator"));
}

const lg_gradcheck_case *lg_gradcheck_hamiltonian(size_t *count) {
    static bool made;
    for (size_t i = 0; !made && i < lg_hamiltonian_family_count(); i++)
        add_family(lg_hamiltonian_family_at(i));
    made = true;
    *count = rows;
    return cases;
}
