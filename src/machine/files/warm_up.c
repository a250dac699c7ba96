/* Fits of short windows, before that of a learned machine. */
#include <math.h>
#include <string.h>

#include "machine/files/recipe.h"
#include "model/files/learning.h"

bool lg_machine_is_small(const lg_machine *machine) {
    enum { FEW = 60 };
    return machine->parameters <= FEW;
}

/* ---- a machine without residuals and networks that other terms can do without ---- */

static bool is_network(const lg_machine_term *term) {
    return (lg_term_kind_options(term->kind) & LG_TERM_HIDDEN) != 0;
}

/* True if term i is a residual, or if it is a network and another term of the same part is not a network. */
static bool is_spare(const lg_machine *machine, uint32_t i) {
    const lg_machine_term *term = &machine->terms[i];
    if (term->part == LG_MACHINE_RESIDUAL) return true;
    bool others = false;
    for (uint32_t j = 0; j < machine->term_count; j++)
        others = others || (machine->terms[j].part == term->part && !is_network(&machine->terms[j]));
    return others && is_network(term);
}

/* The machine without its spare terms; from[i]: the term that its term i is. */
typedef struct plain_machine {
    lg_machine machine;
    uint32_t from[LG_MACHINE_TERMS];
} plain_machine;

static lg_status make_plain(const lg_machine *machine, plain_machine *out, lg_error *error) {
    out->machine = *machine;
    out->machine.term_count = 0;
    for (uint32_t i = 0; i < machine->term_count; i++) {
        if (is_spare(machine, i)) continue;
        out->from[out->machine.term_count] = i;
        out->machine.terms[out->machine.term_count++] = machine->terms[i];
    }
    return lg_machine_init(&out->machine, error);
}

/* Copies the parameters of the plain machine's terms to the machine's theta, or back. */
static void copy_parameters(const lg_machine *machine, const plain_machine *plain, double *theta, double *own,
                            bool back) {
    for (uint32_t i = 0; i < plain->machine.term_count; i++) {
        const lg_machine_term *term = &plain->machine.terms[i];
        double *all = theta + machine->terms[plain->from[i]].offset;
        memcpy(back ? own + term->offset : all, back ? all : own + term->offset,
               term->parameters * sizeof *own);
    }
}

/* Spare networks begin with next to nothing: their last layers are scaled down. */
static void quieten(const lg_machine *machine, double *theta) {
    static const double quiet = 1e-2;
    for (uint32_t i = 0; i < machine->term_count; i++) {
        const lg_machine_term *term = &machine->terms[i];
        if (!is_spare(machine, i) || !is_network(term)) continue; /* polynomials begin at 0 */
        for (size_t k = lg_mlp_weight_offset(&term->net, term->net.layers - 1); k < term->parameters; k++)
            theta[term->offset + k] *= quiet;
    }
}

/* ---- fits ---- */

/* Theta becomes what the fit found, where that lowers the loss by more than rounding: along directions that
 * the logs leave open a fit follows rounding as far as numbers go. */
static lg_status take_lower(lg_learning *self, const lg_machine_problem *problem, const lg_fit *fit,
                            double *theta, lg_error *error) {
    static const double rounding = 1e-9;
    const size_t n = lg_machine_problem_parameters(problem);
    double before = 0, after = 0, *found;
    LG_LEARNING_ARRAY(self, found, n, error);
    lg_fit_parameters(fit, found);
    LG_TRY(lg_machine_loss(self->context, problem, theta, &before, NULL, error));
    LG_TRY(lg_machine_loss(self->context, problem, found, &after, NULL, error));
    if (after < (1.0 - rounding) * before || !isfinite(before)) memcpy(theta, found, n * sizeof *found);
    return LG_OK;
}

/* So few rows do not tell a start that was not measured: it is the derivative of positions. */
enum { SHORTEST = 3 };

/* A fit of windows of `window` rows at most. theta, in and out: the parameters of `machine`, then with
 * positions alone those of the starts. */
static lg_status fit_short(lg_learning *self, const lg_machine *machine, const lg_scheme *scheme,
                           uint32_t window, double *theta, lg_error *error) {
    enum { EPOCHS = 200 };
    const lg_machine_model_run *run = self->run;
    const lg_machine_state *s = self->state;
    const bool few = lg_machine_is_small(machine), estimated = s->positions && window > SHORTEST;
    lg_machine_problem problem = s->problem;
    lg_fit_problem fit_problem;
    lg_fit_options chosen = self->options;
    lg_fit *fit;
    problem.machine = machine;
    problem.scheme = scheme;
    problem.starts = estimated ? LG_MACHINE_STARTS_ESTIMATED : LG_MACHINE_STARTS_MEASURED;
    problem.window = window < run->window ? window : run->window;
    lg_machine_fit_problem(&problem, &fit_problem);
    (void)lg_fit_plan_parse(few ? "lm" : estimated ? "lbfgs" : "ssbroyden", &chosen.plan, NULL);
    chosen.epochs = few ? EPOCHS / 4 : EPOCHS;
    chosen.seconds = self->options.seconds / 8;
    chosen.validation = chosen.prior = 0;
    chosen.keep_best = false;
    chosen.patience = chosen.stop_after = chosen.checkpoint_every = 0;
    chosen.checkpoint = NULL;
    chosen.on_epoch = NULL;
    LG_TRY(lg_fit_create(self->context, &fit_problem, &chosen, theta, &fit, error));
    lg_status status = lg_fit_run(fit, error);
    if (status == LG_OK) status = take_lower(self, &problem, fit, theta, error);
    lg_fit_destroy(fit);
    return status;
}

/* Positions that do not follow from the velocities as well as velocities can be predicted (other programs'
 * integrators, sensors with a lag) count less: their errors in units of the scale become those of the
 * velocities. *changed: a scale grew. */
static lg_status balance(lg_learning *self, const lg_machine *machine, const double *theta, bool *changed,
                         lg_error *error) {
    static const double tolerated = 2.0;
    lg_machine_noise found;
    lg_machine_model_run *run = self->run;
    lg_machine_state *s = self->state;
    const lg_learned_machine model = {
        .machine = machine, .theta = theta, .scheme = run->scheme, .substeps = run->substeps};
    LG_TRY(lg_machine_residuals(self->context, &model, &s->problem, &found, error));
    *changed = false;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const double q = found.position[i] / run->position_scale[i],
                     v = found.velocity[i] / run->velocity_scale[i];
        if (!(q > tolerated * v && v > 0.0) || s->noise.position[i] > 0.0) continue;
        run->position_scale[i] = s->problem.position_scale[i] *= q / v;
        *changed = true;
    }
    return LG_OK;
}

/* The loss of one-step windows. */
static lg_status short_loss(const lg_learning *self, const lg_machine *machine, const double *theta,
                            double *loss, lg_error *error) {
    const lg_machine_state *s = self->state;
    lg_machine_problem problem = s->problem;
    problem.machine = machine;
    problem.starts = LG_MACHINE_STARTS_MEASURED;
    problem.window = s->positions ? SHORTEST : 2;
    return lg_machine_loss(self->context, &problem, theta, loss, NULL, error);
}

/* The parameters of the system: those of its mass. */
static void copy_system(const lg_machine *machine, const double *from, double *to) {
    for (uint32_t i = 0; i < machine->term_count; i++) {
        const lg_machine_term *term = &machine->terms[i];
        if (strcmp(lg_term_kind_name(term->kind), "system") == 0)
            memcpy(to + term->offset, from + term->offset, term->parameters * sizeof *to);
    }
}

/* Parameters of a system may start so far off that it is too stiff for a step. A step of Euler's is linear in
 * the acceleration: no start is too far. What it takes for damping is its own error, so that the system's
 * parameters alone are kept, where they are better. */
static lg_status approach(lg_learning *self, const lg_machine *machine, double *theta, lg_error *error) {
    const uint32_t window = ((const lg_machine_state *)self->state)->positions ? SHORTEST : 2;
    double before = 0, after = 0, *own, *start;
    if (machine->grey.system == NULL) return LG_OK;
    const size_t n = machine->parameters;
    LG_LEARNING_ARRAY(self, own, n + 1, error);
    LG_LEARNING_ARRAY(self, start, n + 1, error);
    memcpy(own, theta, n * sizeof *own);
    memcpy(start, theta, n * sizeof *start);
    LG_TRY(short_loss(self, machine, theta, &before, error));
    LG_TRY(fit_short(self, machine, lg_scheme_find("lie-euler"), window, own, error));
    copy_system(machine, own, start);
    LG_TRY(short_loss(self, machine, start, &after, error));
    if (isfinite(after) && !(after > before)) memcpy(theta, start, n * sizeof *start);
    return LG_OK;
}

/* Windows that grow, or one-step windows again and again until the scales of the loss stand. */
static lg_status fit_windows(lg_learning *self, const lg_machine *machine, double *theta, lg_error *error) {
    enum { ROUNDS = 4 };
    static const uint32_t growing[] = {SHORTEST, 15, 50};
    const lg_machine_state *s = self->state;
    const lg_scheme *scheme = s->problem.scheme;
    bool changed = true;
    LG_TRY(approach(self, machine, theta, error));
    if (s->positions) {
        for (size_t i = 0; i < LG_COUNT(growing); i++)
            LG_TRY(fit_short(self, machine, scheme, growing[i], theta, error));
        return LG_OK;
    }
    for (int round = 0; round < ROUNDS && changed; round++) {
        LG_TRY(fit_short(self, machine, scheme, s->noisy ? 5 : 2, theta, error));
        LG_TRY(balance(self, machine, theta, &changed, error));
    }
    return LG_OK;
}

/* Steps between two rows, where they are not given: the error of the steps is small against what the
 * parameters that short windows gave leave of the loss, or below all that matters. */
static lg_status find_substeps(lg_learning *self, const lg_machine *machine, const double *theta,
                               lg_error *error) {
    enum { MOST = 4 };
    static const double enough = 1e-11, part = 1e-2;
    lg_machine_model_run *run = self->run;
    lg_machine_state *s = self->state;
    lg_machine_problem problem = s->problem;
    double loss = 0, floor = 0;
    if (self->given(self, "substeps")) return LG_OK;
    problem.machine = machine;
    if (!s->positions) problem.starts = LG_MACHINE_STARTS_MEASURED;
    for (run->substeps = 1; run->substeps < MOST; run->substeps++) {
        problem.substeps = run->substeps;
        LG_TRY(lg_machine_loss(self->context, &problem, theta, &loss, &floor, error));
        if (floor <= fmax(enough, part * loss)) break;
    }
    s->problem.substeps = run->substeps;
    return LG_OK;
}

lg_status lg_machine_warm_up(lg_learning *self, double *theta, lg_error *error) {
    const lg_machine *machine = &((const lg_machine_model_run *)self->run)->machine;
    const lg_machine_state *s = self->state;
    /* Numbers of all starts, where short windows find them. */
    const size_t starts = s->positions ? lg_machine_problem_parameters(&s->problem) - machine->parameters : 0;
    plain_machine *plain;
    double *own;
    LG_LEARNING_ARRAY(self, plain, 1, error);
    LG_LEARNING_ARRAY(self, own, machine->parameters + starts + 1, error);
    LG_TRY(make_plain(machine, plain, error));
    copy_parameters(machine, plain, theta, own, true);
    if (plain->machine.parameters > 0) LG_TRY(fit_windows(self, &plain->machine, own, error));
    LG_TRY(find_substeps(self, &plain->machine, own, error));
    copy_parameters(machine, plain, theta, own, false);
    memcpy(theta + machine->parameters, own + plain->machine.parameters, starts * sizeof *own);
    quieten(machine, theta);
    return LG_OK;
}
