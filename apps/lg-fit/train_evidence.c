/* lg-fit train: the width, the priors and the parameters that make the data most probable. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-fit/train.h"

enum { STREAM_WEIGHTS = 1, RACE_EVALUATIONS = 60 };
/* Multiplications and additions: a width that was given is worth some ten seconds. */
static const double RACE_WORK = 8e9, EVIDENCE_WORK = 3e9, GIVEN_WORK = 7e11;

/* ---- parameters ---- */

double *first_parameters(const training *state) {
    double *theta = app_try_alloc(lg_table_parameters(&state->run->model), sizeof *theta);
    lg_rng rng;
    lg_rng_seed(&rng, state->run->training.seed, STREAM_WEIGHTS);
    if (theta != NULL) lg_table_initialise(&state->run->model, &rng, theta);
    return theta;
}

uint32_t slices_of(const lg_table *model) {
    lg_slice_info info;
    uint32_t slices = 0;
    while (lg_table_slice(model, slices, &info)) slices++;
    return slices;
}

/* The parameters of the wide model with those of a narrower one in it: its units, and new ones of little
 * weight. */
static void grow_parameters(const lg_table *wide, const lg_table *narrow, const double *from, double *theta) {
    static const double LITTLE = 0.1;
    lg_slice_info a, b;
    for (uint32_t s = 0; lg_table_slice(narrow, s, &a) && lg_table_slice(wide, s, &b); s++) {
        const size_t columns = a.rank == 2 ? a.dims[1] : a.dims[0], rows = a.count / columns;
        const size_t stride = b.rank == 2 ? b.dims[1] : b.dims[0];
        const bool reads = b.rank == 2 && b.dims[0] == wide->net.inputs;
        for (size_t i = 0; !reads && i < b.count; i++) theta[b.offset + i] *= LITTLE;
        for (size_t i = 0; i < rows; i++)
            memcpy(theta + b.offset + i * stride, from + a.offset + i * columns, columns * sizeof *theta);
    }
}

/* ---- what it takes ---- */

double work_of(const training *state, double rows) {
    static const double BESIDE = 100.0, AT_LEAST = 3e6;
    const double n = (double)lg_table_parameters(&state->run->model), m = state->outputs.count;
    return rows * m * n * (0.5 * n + BESIDE) + n * n * n + AT_LEAST;
}

/* The run's model with one hidden layer. */
static lg_status set_width(const training *state, uint32_t width, lg_error *error) {
    lg_table_options options = state->run->model.options;
    options.hidden_count = 1;
    options.hidden[0] = width;
    return lg_table_init(&state->run->model, &options, state->inputs.count, state->outputs.count, error);
}

/* What a lane of the race takes. */
static double lane_work(const training *state, uint32_t width, double rows) {
    const lg_table kept = state->run->model;
    (void)set_width(state, width, NULL);
    const double work = RACE_EVALUATIONS * work_of(state, rows);
    state->run->model = kept;
    return work;
}

/* ---- the race of widths ---- */

typedef struct race {
    lg_table_run best;
    double *theta; /* of the best model; NULL: none yet */
    double high, work;
    size_t rows;
    bool better; /* the last width was */
} race;

/* One width: *theta and the priors of the run, and how probable they make the data. */
static lg_status try_width(const training *state, const app *self, uint32_t width, bool grown, race *r,
                           double **theta, lg_table_evidence_result *found, lg_error *error) {
    lg_table_run *run = state->run;
    lg_table_evidence_options effort;
    lg_status status = set_width(state, width, error);
    if (status != LG_OK) return status;
    *theta = first_parameters(state);
    if (*theta == NULL) return train_no_room(lg_table_parameters(&run->model), error);
    if (grown) grow_parameters(&run->model, &r->best.model, r->theta, *theta);
    run->decay.count = slices_of(&run->model);
    lg_table_evidence_options_init(&effort);
    effort.go_on = grown;
    effort.rows = r->rows;
    effort.evaluations = RACE_EVALUATIONS;
    status =
        lg_table_evidence(self->context, &state->problem, &effort, *theta, run->decay.value, found, error);
    r->work += found->evaluations * work_of(state, (double)r->rows);
    return status;
}

/* A width from parameters as they are drawn, or grown from those of the best narrower one. */
static lg_status run_lane(training *state, const app *self, uint32_t width, bool grown, race *r,
                          lg_error *error) {
    static const double CLEARLY = 2.0; /* seven times as probable */
    double *theta = NULL;
    lg_table_evidence_result result = {0};
    *state->run = r->best;
    const lg_status status = try_width(state, self, width, grown, r, &theta, &result, error);
    state->evidence.evaluations += result.evaluations;
    if (status == LG_OK && (r->theta == NULL || result.evidence > r->high + CLEARLY)) {
        free(r->theta);
        r->best = *state->run, r->high = result.evidence, r->theta = theta;
        r->better = true;
    } else {
        free(theta);
    }
    return status == LG_NOT_FINITE ? LG_OK : status;
}

/* Both lanes of a width, or the second alone where there is no time for two. */
static lg_status run_lanes(training *state, const app *self, uint32_t width, double lane, race *r,
                           lg_error *error) {
    lg_status status = LG_OK;
    r->better = false;
    if (r->theta != NULL && r->work + 2.0 * lane <= RACE_WORK)
        status = run_lane(state, self, width, true, r, error);
    return status == LG_OK ? run_lane(state, self, width, false, r, error) : status;
}

/* The width whose evidence is highest, from small to large, until three in a row are not clearly better or
 * the work is done. The run gets its model and priors; *theta its parameters. */
static lg_status choose_width(training *state, const app *self, size_t rows, double **theta,
                              lg_error *error) {
    static const uint32_t widths[] = {1, 2, 4, 6, 8, 12, 16, 24, 32, 48};
    enum { WORSE = 3 };
    race r = {.best = *state->run, .high = -INFINITY, .rows = rows};
    const double columns = (double)state->inputs.count + state->outputs.count + 1.0;
    size_t i = 4.0 * columns > (double)rows * state->outputs.count ? 0 : 1;
    lg_status status = LG_OK;
    for (uint32_t worse = 0; i < LG_COUNT(widths) && worse < WORSE && status == LG_OK; i++) {
        const double lane = lane_work(state, widths[i], (double)rows);
        if (r.work >= RACE_WORK || (r.theta != NULL && r.work + lane > RACE_WORK)) break;
        status = run_lanes(state, self, widths[i], lane, &r, error);
        worse = r.better ? 0 : worse + 1;
    }
    *state->run = r.best;
    *theta = r.theta;
    if (status != LG_OK) return status;
    return *theta != NULL ? LG_OK : app_error(error, LG_NOT_FINITE, "no width has finite residuals");
}

/* ---- the priors ---- */

bool seeks_evidence(const training *state, const app *self) {
    return is_regression(state) && !state->resumed && !lg_fit_plan_batches(&state->run->training.plan) &&
           !app_given(self, "decay") && !app_given(self, "weight-decay") && !app_given(self, "prior") &&
           lg_table_parameters(&state->run->model) <= MOST_LM;
}

/* The priors of the run's model on as many rows as its weights need. */
static lg_status find_priors(training *state, const app *self, bool go_on, double least_rows, double *theta,
                             lg_error *error) {
    static const double FOR_WEIGHTS = 3.0;
    lg_table_run *run = state->run;
    lg_table_evidence_options options;
    const uint32_t before = state->evidence.evaluations;
    const double weights = (double)lg_table_parameters(&run->model);
    const double rows =
        fmin(fmax(FOR_WEIGHTS * weights / state->outputs.count, least_rows), (double)state->trained);
    run->decay.count = slices_of(&run->model);
    lg_table_evidence_options_init(&options);
    options.rows = (size_t)rows;
    const double work = go_on ? EVIDENCE_WORK : GIVEN_WORK, most = options.evaluations;
    options.evaluations = (uint32_t)fmin(fmax(work / work_of(state, rows), 12.0), most);
    options.go_on = go_on;
    const lg_status status = lg_table_evidence(self->context, &state->problem, &options, theta,
                                               run->decay.value, &state->evidence, error);
    if (status == LG_OK && !go_on && !state->evidence.settled && 2 * options.evaluations < most)
        app_warn(
            self,
            "the search for weight decays ended after %u evaluations, before it settled: the network may be "
            "fitted too loosely; take a narrower one, or --method ssbroyden --weight-decay 0",
            state->evidence.evaluations);
    state->evidence.evaluations += before;
    return status;
}

lg_status find_evidence(training *state, const app *self, double **theta, lg_error *error) {
    static const double LEAST_ROWS = 1000.0;
    const bool free_width = !app_given(self, "hidden");
    const size_t rows = (size_t)fmin(LEAST_ROWS, (double)state->trained);
    if (free_width) {
        const lg_status status = choose_width(state, self, rows, theta, error);
        if (status != LG_OK) return status;
    } else {
        *theta = first_parameters(state);
        if (*theta == NULL) return train_no_room(lg_table_parameters(&state->run->model), error);
    }
    return find_priors(state, self, free_width, LEAST_ROWS, *theta, error);
}
