/* How a table is learned: where the training begins. */
#include "table/files/recipe.h"

#include <math.h>
#include <string.h>

#include "core/core.h"

enum { STREAM_WEIGHTS = 1, RACE_EVALUATIONS = 60 };
/* Multiplications and additions: a width that was given is worth some ten seconds. */
static const double RACE_WORK = 8e9, EVIDENCE_WORK = 3e9, GIVEN_WORK = 7e11;

/* ---- parameters ---- */

lg_status lg_table_first_parameters(const lg_context *context, const lg_table_run *run, double **theta,
                                    lg_error *error) {
    const size_t count = lg_table_parameters(&run->model);
    lg_rng rng;
    *theta = lg_alloc(context, count, sizeof **theta);
    if (*theta == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters", count);
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    lg_table_initialise(&run->model, &rng, *theta);
    return LG_OK;
}

uint32_t lg_table_slices(const lg_table *model) {
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

double lg_table_work(const lg_table *model, double rows) {
    static const double BESIDE = 100.0, AT_LEAST = 3e6;
    const double n = (double)lg_table_parameters(model), m = model->net.outputs;
    return rows * m * n * (0.5 * n + BESIDE) + n * n * n + AT_LEAST;
}

/* The run's model with one hidden layer. */
static lg_status set_width(const lg_table_start *state, uint32_t width, lg_error *error) {
    lg_table_options options = state->run->model.options;
    options.hidden_count = 1;
    options.hidden[0] = width;
    return lg_table_init(&state->run->model, &options, state->run->model.net.inputs,
                         state->run->model.net.outputs, error);
}

/* What a lane of the race takes. */
static double lane_work(const lg_table_start *state, uint32_t width, double rows) {
    const lg_table kept = state->run->model;
    (void)set_width(state, width, NULL);
    const double work = RACE_EVALUATIONS * lg_table_work(&state->run->model, rows);
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
static lg_status try_width(const lg_table_start *state, uint32_t width, bool grown, race *r, double **theta,
                           lg_table_evidence_result *found, lg_error *error) {
    lg_table_run *run = state->run;
    lg_table_evidence_options effort;
    LG_TRY(set_width(state, width, error));
    LG_TRY(lg_table_first_parameters(state->context, run, theta, error));
    if (grown) grow_parameters(&run->model, &r->best.model, r->theta, *theta);
    run->decay.count = lg_table_slices(&run->model);
    lg_table_evidence_options_init(&effort);
    effort.go_on = grown;
    effort.rows = r->rows;
    effort.evaluations = RACE_EVALUATIONS;
    const lg_status status =
        lg_table_evidence(state->context, state->problem, &effort, *theta, run->decay.value, found, error);
    r->work += found->evaluations * lg_table_work(&state->run->model, (double)r->rows);
    return status;
}

/* A width from parameters as they are drawn, or grown from those of the best narrower one. */
static lg_status run_lane(lg_table_start *state, uint32_t width, bool grown, race *r, lg_error *error) {
    static const double CLEARLY = 2.0; /* seven times as probable */
    double *theta = NULL;
    lg_table_evidence_result result = {0};
    *state->run = r->best;
    const lg_status status = try_width(state, width, grown, r, &theta, &result, error);
    state->evidence.evaluations += result.evaluations;
    if (status == LG_OK && (r->theta == NULL || result.evidence > r->high + CLEARLY)) {
        lg_free(state->context, r->theta);
        r->best = *state->run, r->high = result.evidence, r->theta = theta;
        r->better = true;
    } else {
        lg_free(state->context, theta);
    }
    return status == LG_NOT_FINITE ? LG_OK : status;
}

/* Both lanes of a width, or the second alone where there is no time for two. */
static lg_status run_lanes(lg_table_start *state, uint32_t width, double lane, race *r, lg_error *error) {
    lg_status status = LG_OK;
    r->better = false;
    if (r->theta != NULL && r->work + 2.0 * lane <= RACE_WORK)
        status = run_lane(state, width, true, r, error);
    return status == LG_OK ? run_lane(state, width, false, r, error) : status;
}

/* The width whose evidence is highest, from small to large, until three in a row are not clearly better or
 * the work is done. The run gets its model and priors; *theta its parameters. */
static lg_status choose_width(lg_table_start *state, size_t rows, double **theta, lg_error *error) {
    static const uint32_t widths[] = {1, 2, 4, 6, 8, 12, 16, 24, 32, 48};
    enum { WORSE = 3 };
    race r = {.best = *state->run, .high = -INFINITY, .rows = rows};
    const double columns = (double)r.best.model.net.inputs + r.best.model.net.outputs + 1.0;
    size_t i = 4.0 * columns > (double)rows * state->run->model.net.outputs ? 0 : 1;
    lg_status status = LG_OK;
    for (uint32_t worse = 0; i < LG_COUNT(widths) && worse < WORSE && status == LG_OK; i++) {
        const double lane = lane_work(state, widths[i], (double)rows);
        if (r.work >= RACE_WORK || (r.theta != NULL && r.work + lane > RACE_WORK)) break;
        status = run_lanes(state, widths[i], lane, &r, error);
        worse = r.better ? 0 : worse + 1;
    }
    *state->run = r.best;
    *theta = r.theta;
    if (status != LG_OK) return status;
    return *theta != NULL ? LG_OK : lg_fail(error, LG_NOT_FINITE, "no width has finite residuals");
}

/* ---- the priors ---- */

/* The priors of the run's model on as many rows as its weights need. */
static lg_status find_priors(lg_table_start *state, bool go_on, double least_rows, double *theta,
                             lg_error *error) {
    static const double FOR_WEIGHTS = 3.0;
    lg_table_run *run = state->run;
    lg_table_evidence_options options;
    const uint32_t before = state->evidence.evaluations;
    const double weights = (double)lg_table_parameters(&run->model);
    const double rows = fmin(fmax(FOR_WEIGHTS * weights / state->run->model.net.outputs, least_rows),
                             (double)state->problem->samples->training);
    run->decay.count = lg_table_slices(&run->model);
    lg_table_evidence_options_init(&options);
    options.rows = (size_t)rows;
    const double work = go_on ? EVIDENCE_WORK : GIVEN_WORK, most = options.evaluations;
    options.evaluations = (uint32_t)fmin(fmax(work / lg_table_work(&state->run->model, rows), 12.0), most);
    options.go_on = go_on;
    const lg_status status = lg_table_evidence(state->context, state->problem, &options, theta,
                                               run->decay.value, &state->evidence, error);
    if (status == LG_OK && !go_on && !state->evidence.settled && 2 * options.evaluations < most)
        lg_log_message(
            state->context, LG_LOG_WARNING,
            "the search for weight decays ended after %u evaluations, before it settled: the network may be "
            "fitted too loosely; take a narrower one, or --method ssbroyden --weight-decay 0",
            state->evidence.evaluations);
    state->evidence.evaluations += before;
    return status;
}

lg_status lg_table_find_start(lg_table_start *state, bool any_width, double **theta, lg_error *error) {
    static const double LEAST_ROWS = 1000.0;
    const size_t rows = (size_t)fmin(LEAST_ROWS, (double)state->problem->samples->training);
    LG_TRY(any_width ? choose_width(state, rows, theta, error)
                     : lg_table_first_parameters(state->context, state->run, theta, error));
    return find_priors(state, any_width, LEAST_ROWS, *theta, error);
}
