/* Short fits of a machine, from which the first parameters of the fit come. */
#include <math.h>
#include <string.h>

#include "machine/files/recipe.h"
#include "model/files/training.h"

bool lg_machine_is_small(const lg_machine *machine) {
    enum { FEW = 60 };
    return machine->parameters <= FEW;
}

/* A short fit. Numbers are held near their first values, in proportion to the loss that is left: a number
 * that ran to 0 or infinity would never come back. theta, in and out, has the problem's parameters. */
static lg_status run_fit(lg_training *self, const lg_machine *machine, const lg_fit_problem *problem,
                         const lg_stage_limits *most, double *theta, lg_error *error) {
    enum { EPOCHS = 200, ROUNDS = 4 };
    static const double pull = 0.02, slow = 0.9;
    const bool few = lg_machine_is_small(machine);
    const size_t numbers = problem->parameters < machine->parameters ? 0 : machine->parameters;
    lg_fit_problem held = *problem;
    lg_fit_options chosen = self->options;
    double *decay, loss = 0, before = INFINITY;
    LG_TRAINING_ARRAY(self, decay, problem->parameters, error);
    (void)lg_fit_plan_parse(few ? "lm" : problem->own > 0 ? "lbfgs" : "ssbroyden", &chosen.plan, NULL);
    chosen.seconds = most->seconds / ROUNDS;
    chosen.validation = chosen.prior = 0;
    chosen.keep_best = false;
    chosen.patience = chosen.stop_after = chosen.checkpoint_every = 0;
    chosen.checkpoint = NULL;
    chosen.on_epoch = NULL;
    for (int round = few ? 0 : ROUNDS; round <= ROUNDS && !(loss > slow * before); round++) {
        lg_fit *fit = NULL;
        if (round > 1) before = loss;
        chosen.epochs = !few ? EPOCHS : round == 0 ? 1 : most->epochs;
        lg_status status = lg_fit_create(self->context, &held, &chosen, theta, &fit, error);
        if (status == LG_OK) status = lg_fit_run(fit, error);
        if (status == LG_OK) lg_fit_parameters(fit, theta), loss = lg_fit_loss(fit);
        lg_fit_destroy(fit);
        LG_TRY(status);
        for (size_t i = machine->weights; i < numbers; i++) decay[i] = pull * loss;
        held.decay = decay;
    }
    return LG_OK;
}

/* Takes the fit's parameters if they lower the loss by more than rounding error. Along directions that the
 * logs leave open, a fit would follow rounding error arbitrarily far. */
lg_status lg_machine_fit_stage(lg_training *self, const lg_machine_problem *problem,
                               const lg_stage_limits *most, double *theta, lg_error *error) {
    static const double rounding = 1e-9;
    const size_t n = lg_machine_problem_parameters(problem);
    lg_fit_problem fit_problem;
    double before = 0, after = 0, *found;
    LG_TRAINING_ARRAY(self, found, n, error);
    memcpy(found, theta, n * sizeof *found);
    lg_machine_fit_problem(problem, &fit_problem);
    LG_TRY(run_fit(self, problem->machine, &fit_problem, most, found, error));
    LG_TRY(lg_machine_loss(self->context, problem, theta, &before, NULL, error));
    LG_TRY(lg_machine_loss(self->context, problem, found, &after, NULL, error));
    if (after < (1.0 - rounding) * before || !isfinite(before)) memcpy(theta, found, n * sizeof *found);
    return LG_OK;
}

lg_status lg_machine_fit_momenta(lg_training *self, const lg_machine_problem *problem,
                                 const lg_stage_limits *most, double *theta, lg_error *error) {
    lg_fit_problem fit_problem;
    lg_machine_momentum_problem(problem, &fit_problem);
    return run_fit(self, problem->machine, &fit_problem, most, theta, error);
}

/* Copies the parameters of the system, which are those of its mass term. */
static void copy_system(const lg_machine *machine, const double *from, double *to) {
    for (uint32_t i = 0; i < machine->term_count; i++) {
        const lg_machine_term *term = &machine->terms[i];
        if (strcmp(lg_term_kind_name(term->kind), "system") == 0)
            memcpy(to + term->offset, from + term->offset, term->parameters * sizeof *to);
    }
}

/* The initial parameters of a system may make it too stiff for the integrator's steps. A step of explicit
 * Euler is linear in the acceleration and works from any start. Euler's own error would appear as damping, so
 * that only the system's parameters are kept, and only if they do not raise the loss. */
lg_status lg_machine_approach(lg_training *self, const lg_machine_problem *on, double *theta,
                              lg_error *error) {
    double before = 0, after = 0, *own, *start;
    const lg_machine *machine = on->machine;
    if (machine->grey.system == NULL) return LG_OK;
    const size_t n = machine->parameters;
    lg_machine_problem problem = *on;
    problem.starts = LG_MACHINE_STARTS_MEASURED;
    LG_TRAINING_ARRAY(self, own, n + 1, error);
    LG_TRAINING_ARRAY(self, start, n + 1, error);
    memcpy(own, theta, n * sizeof *own);
    memcpy(start, theta, n * sizeof *start);
    LG_TRY(lg_machine_loss(self->context, &problem, theta, &before, NULL, error));
    problem.scheme = lg_scheme_find("lie-euler");
    LG_TRY(lg_machine_fit_stage(self, &problem,
                                &(lg_stage_limits){LG_STAGE_EPOCHS, self->options.seconds / 8}, own, error));
    problem.scheme = on->scheme;
    copy_system(machine, own, start);
    LG_TRY(lg_machine_loss(self->context, &problem, start, &after, NULL, error));
    if (isfinite(after) && !(after > before)) memcpy(theta, start, n * sizeof *start);
    return LG_OK;
}
