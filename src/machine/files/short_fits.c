/* Short fits of a machine, from which the first parameters of the fit come. If the logs measure positions
 * alone, there are several ways to first parameters, and short windows that are the same for all decide. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/median.h"
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
    (void)lg_fit_plan_parse(few ? "lm" : problem->own > 0 ? "lbfgs" : "ssbroyden", true, &chosen.plan, NULL);
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

/* ---- first parameters from positions alone ---- */

enum {
    PART = 3,      /* windows that compare the candidates are this part of the fit's */
    ENOUGH = 1000, /* intervals for a regression of momenta */
    FINALISTS = 4,
    FEW = 15,  /* evaluations in a round of a candidate's fit */
    SHARE = 40 /* a fit takes at most 1/SHARE of the time */
};

typedef enum way {
    AS_GIVEN,   /* the parameters as they are */
    APPROACHED, /* steps of explicit Euler on short windows */
    MOMENTA     /* a regression of momenta */
} way;

/* `half`: half width, in rows, of the polynomials that give velocities. Noise needs wide ones, fast motion
 * narrow ones. */
typedef struct candidate {
    way way;
    uint32_t half;
} candidate;
static const candidate candidates[] = {{MOMENTA, 15},   {MOMENTA, 40},    {MOMENTA, 6},
                                       {APPROACHED, 2}, {APPROACHED, 15}, {AS_GIVEN, 0}};

/* What a candidate's fit of the windows that compare them left. */
typedef struct tried {
    double loss;   /* first: it sorts them */
    double *theta; /* (parameters) */
} tried;

typedef struct stages {
    lg_training *self;
    lg_machine_problem compared; /* with estimated starts */
    size_t parameters, count;    /* parameters of `compared`; candidates in `all` */
    tried all[LG_COUNT(candidates)];
} stages;

static uint32_t at_least(uint32_t window, uint32_t least) {
    return window > least ? window : least;
}

static lg_stage_limits limits(const stages *s, uint64_t epochs) {
    return (lg_stage_limits){epochs, s->self->options.seconds / SHARE};
}

/* ---- a log with velocities ---- */

double lg_log_speed(const lg_machine *machine, const lg_machine_log *log, uint32_t coordinate) {
    const lg_machine_offsets at = lg_machine_offsets_of(machine, coordinate);
    lg_squares squares = {0, 0};
    for (size_t row = 0; row < log->rows; row++)
        for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++)
            lg_squares_add(&squares, lg_log_shown(log)[row * machine->velocities + k]);
    return squares.count > 0 ? lg_squares_root(&squares) : 0.0;
}

/* Scales of the loss: the root mean square of a coordinate's velocities, and half the way that this covers in
 * a window. */
static void set_scales(const lg_machine_log *log, double seconds, lg_machine_problem *problem) {
    for (uint32_t i = 0; i < problem->machine->coordinate_count; i++) {
        const double speed = lg_log_speed(problem->machine, log, i);
        if (!(speed > 0)) continue;
        problem->velocity_scale[i] = speed;
        problem->position_scale[i] = 0.5 * seconds * speed;
    }
}

/* Fits windows of `half` rows of a log whose velocities come from polynomials through 2 half + 1 rows. */
static lg_status fit_smoothed(stages *s, const candidate *from, double *theta, lg_error *error) {
    const uint32_t half = from->half;
    lg_training *self = s->self;
    const lg_machine_state *state = self->state;
    const lg_machine_model_run *run = self->run;
    const lg_machine *machine = s->compared.machine;
    lg_machine_problem problem = s->compared;
    lg_machine_log *log = &problem.log;
    double *q, *v;
    size_t *start;
    *log = state->data.training;
    LG_TRAINING_ARRAY(self, q, log->rows * machine->positions, error);
    LG_TRAINING_ARRAY(self, v, log->rows * machine->velocities, error);
    LG_TRAINING_ARRAY(self, start, log->rows, error);
    lg_machine_smooth(machine, log, half, 3, q, v);
    log->q = q;
    log->v = v;
    problem.starts = LG_MACHINE_STARTS_MEASURED;
    problem.window = from->way == MOMENTA ? 2 : half + 1;
    const uint32_t stride = from->way == MOMENTA ? (uint32_t)(log->rows / ENOUGH + 1) : half;
    problem.windows = lg_machine_windows(machine, log, problem.window, stride, false, start);
    problem.start = start;
    problem.validation = 0;
    if (problem.windows == 0) return LG_OK;
    set_scales(log, half * run->dt, &problem);
    const lg_stage_limits most = limits(s, LG_STAGE_EPOCHS);
    if (from->way == MOMENTA) {
        lg_fit_problem regression;
        lg_machine_momentum_problem(&problem, &regression);
        LG_TRY(run_fit(self, machine, &regression, &most, theta, error)); /* its result is always taken */
        const uint32_t rows = half + 1;
        problem.window = rows;
        problem.windows = lg_machine_windows(machine, log, rows, half, false, start);
        if (problem.windows == 0) return LG_OK;
        const lg_stage_limits few = limits(s, FEW);
        return lg_machine_fit_stage(self, &problem, &few, theta, error);
    }
    return lg_machine_approach(self, &problem, theta, error);
}

/* The loss that the noise of the positions leaves. */
static double expected(const stages *s) {
    const lg_machine_state *state = s->self->state;
    const lg_machine_file *file = &state->data.file;
    double sum = 0;
    for (uint32_t i = 0; i < s->compared.machine->coordinate_count; i++) {
        const lg_log_coordinate *at = &file->coordinates[i];
        const uint32_t first[] = {at->place, at->attitude}, count[] = {at->places, at->attitudes};
        for (int k = 0; k < 2; k++)
            for (uint32_t j = first[k]; j < first[k] + count[k]; j++) {
                const double noise = state->data.logs.columns[j].noise / s->compared.position_scale[i];
                if (isfinite(noise)) sum += noise * noise;
            }
    }
    return sum;
}

/* ---- candidates ---- */

/* Fits the windows that compare candidates. A run that is not finite has an infinite loss. */
static lg_status compare(stages *s, const lg_stage_limits *most, tried *one, lg_error *error) {
    lg_status status = lg_machine_fit_stage(s->self, &s->compared, most, one->theta, error);
    if (status == LG_OK)
        status = lg_machine_loss(s->self->context, &s->compared, one->theta, &one->loss, NULL, error);
    if (status == LG_NOT_FINITE) status = lg_fail(error, LG_OK, "%s", "");
    if (isnan(one->loss)) one->loss = INFINITY;
    return status;
}

static lg_status try_candidate(stages *s, const double *theta, const candidate *from, lg_error *error) {
    const lg_stage_limits most = limits(s, FEW);
    tried *one = &s->all[s->count++];
    one->loss = INFINITY;
    LG_TRAINING_ARRAY(s->self, one->theta, s->parameters, error);
    memcpy(one->theta, theta, s->compared.machine->parameters * sizeof *theta);
    const lg_status status = from->way != AS_GIVEN ? fit_smoothed(s, from, one->theta, error) : LG_OK;
    if (status == LG_NOT_FINITE) return lg_fail(error, LG_OK, "%s", "");
    LG_TRY(status);
    return compare(s, &most, one, error);
}

/* Fits windows that grow by halves up to `window` rows. Where motion is chaotic, a run of many rows has many
 * minima, and only starts and parameters that already follow most of its rows lead to the right one. */
static lg_status lengthen(stages *s, uint32_t window, const lg_stage_limits *most, tried *one,
                          lg_error *error) {
    uint32_t rows = at_least(window / PART, 2);
    do {
        rows = rows + rows / 2 + 1 < window ? rows + rows / 2 + 1 : window;
        s->compared.window = rows;
        LG_TRY(compare(s, most, one, error));
    } while (rows < window);
    return LG_OK;
}

lg_status lg_machine_fit_candidates(lg_training *self, const lg_machine *machine, double *theta,
                                    lg_error *error) {
    const lg_machine_state *state = self->state;
    const uint32_t window = state->problem.window;
    stages s = {.self = self, .compared = state->problem};
    const lg_stage_limits most = limits(&s, LG_STAGE_EPOCHS);
    s.compared.machine = machine;
    s.compared.starts = LG_MACHINE_STARTS_ESTIMATED;
    s.compared.window = at_least(window / PART, 2);
    s.parameters = lg_machine_problem_parameters(&s.compared);
    const double good = expected(&s);
    /* The parameters of a machine that was learned before are the only candidate. */
    size_t i = state->warm != NULL ? LG_COUNT(candidates) - 1 : 0;
    for (; i < LG_COUNT(candidates) && (s.count == 0 || s.all[s.count - 1].loss > good); i++)
        LG_TRY(try_candidate(&s, theta, &candidates[i], error));
    qsort(s.all, s.count, sizeof *s.all, lg_compare_doubles);
    /* Short windows hardly tell good candidates apart when there is much noise. */
    const size_t finalists = s.count < FINALISTS ? s.count : FINALISTS;
    for (i = 0; i < finalists && (i == 0 || s.all[i - 1].loss > good); i++)
        LG_TRY(lengthen(&s, window, &most, &s.all[i], error));
    qsort(s.all, finalists, sizeof *s.all, lg_compare_doubles);
    if (isfinite(s.all[0].loss)) memcpy(theta, s.all[0].theta, s.parameters * sizeof *theta);
    return LG_OK;
}
