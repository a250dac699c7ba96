/* First parameters of a machine whose logs measure positions alone. Each candidate is a way to parameters;
 * which of them is kept, short windows decide that are the same for all. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "machine/files/recipe.h"
#include "model/files/training.h"

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
    double loss, *theta; /* (parameters) */
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
    lg_machine_smooth(machine, log, half, q, v);
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
        LG_TRY(lg_machine_fit_momenta(self, &problem, &most, theta, error));
        const uint32_t rows = half + 1;
        problem.window = rows;
        problem.windows = lg_machine_windows(machine, log, rows, half, false, start);
        if (problem.windows == 0) return LG_OK;
        const lg_stage_limits few = limits(s, FEW);
        LG_TRY(lg_machine_fit_stage(self, &problem, &few, theta, error));
        return LG_OK;
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

static int by_loss(const void *a, const void *b) {
    const double x = ((const tried *)a)->loss, y = ((const tried *)b)->loss;
    return (x > y) - (x < y);
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
    qsort(s.all, s.count, sizeof *s.all, by_loss);
    /* Short windows hardly tell good candidates apart when there is much noise. */
    const size_t finalists = s.count < FINALISTS ? s.count : FINALISTS;
    for (i = 0; i < finalists && (i == 0 || s.all[i - 1].loss > good); i++)
        LG_TRY(lengthen(&s, window, &most, &s.all[i], error));
    qsort(s.all, finalists, sizeof *s.all, by_loss);
    if (isfinite(s.all[0].loss)) memcpy(theta, s.all[0].theta, s.parameters * sizeof *theta);
    return LG_OK;
}
