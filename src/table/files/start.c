/* Start of the training of a table: the width, priors and parameters with the highest evidence. */
#include "table/files/recipe.h"

#include <math.h>
#include <string.h>

enum { STREAM_WEIGHTS = 1, RACE_EVALUATIONS = 60 };
/* Bounds on work, in units of lg_table_work. A search with a given width may take some ten seconds. */
static const double RACE_WORK = 8e9, EVIDENCE_WORK = 3e9, GIVEN_WORK = 7e11;

/* ---- parameters ---- */

lg_status lg_table_first_parameters(lg_training *self, double **theta, lg_error *error) {
    const lg_table_run *run = self->run;
    lg_rng rng;
    LG_TRAINING_ARRAY(self, *theta, lg_table_parameters(&run->model), error);
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

/* Copies the parameters of a narrower model into a wider one. The weights of new units are made small, except
 * those that read the inputs. */
static void grow_parameters(const lg_table *wide, const lg_table *narrow, const double *from, double *theta) {
    static const double LITTLE = 0.1;
    lg_slice_info a, b;
    for (uint32_t s = 0; lg_table_slice(narrow, s, &a); s++) {
        (void)lg_table_slice(wide, s, &b);
        const size_t columns = a.rank == 2 ? a.dims[1] : a.dims[0], rows = a.count / columns;
        const size_t stride = b.rank == 2 ? b.dims[1] : b.dims[0];
        const bool reads = b.rank == 2 && b.dims[0] == wide->net.inputs;
        for (size_t i = 0; !reads && i < b.count; i++) theta[b.offset + i] *= LITTLE;
        for (size_t i = 0; i < rows; i++)
            memcpy(theta + b.offset + i * stride, from + a.offset + i * columns, columns * sizeof *theta);
    }
}

/* ---- work ---- */

double lg_table_work(const lg_table *model, double rows) {
    static const double BESIDE = 100.0, AT_LEAST = 3e6;
    const double n = (double)lg_table_parameters(model), m = model->net.outputs;
    return rows * m * n * (0.5 * n + BESIDE) + n * n * n + AT_LEAST;
}

/* Gives the model one hidden layer of this width. */
static lg_status set_width(lg_table *model, uint32_t width, lg_error *error) {
    lg_table_options options = model->options;
    options.hidden_count = 1;
    options.hidden[0] = width;
    return lg_table_init(model, &options, model->net.inputs, model->net.outputs, error);
}

/* Work of one lane of the race: one search with a width. */
static double lane_work(const lg_table_run *run, uint32_t width, double rows) {
    lg_table model = run->model;
    (void)set_width(&model, width, NULL);
    return RACE_EVALUATIONS * lg_table_work(&model, rows);
}

/* ---- the race of widths ---- */

typedef struct race {
    lg_table_run best;
    double *theta; /* parameters of the best model; NULL: none yet */
    double high, work;
    size_t rows;
    bool better; /* whether the last width was clearly better */
} race;

/* Searches priors and parameters with one width. Fills *theta, the priors of the run, and *found with the
 * evidence. */
static lg_status try_width(lg_training *self, uint32_t width, bool grown, race *r, double **theta,
                           lg_table_evidence_result *found, lg_error *error) {
    const lg_table_state *s = self->state;
    lg_table_run *run = self->run;
    lg_table_evidence_options effort;
    LG_TRY(set_width(&run->model, width, error));
    LG_TRY(lg_table_first_parameters(self, theta, error));
    if (grown) grow_parameters(&run->model, &r->best.model, r->theta, *theta);
    run->decay.count = lg_table_slices(&run->model);
    lg_table_evidence_options_init(&effort);
    effort.go_on = grown;
    effort.rows = r->rows;
    effort.evaluations = RACE_EVALUATIONS;
    const lg_status status =
        lg_table_evidence(self->context, &s->problem, &effort, *theta, run->decay.value, found, error);
    r->work += found->evaluations * lg_table_work(&run->model, (double)r->rows);
    return status;
}

/* Runs a lane: one width, from parameters as they are drawn, or grown from the best narrower model. */
static lg_status run_lane(lg_training *self, uint32_t width, bool grown, race *r, lg_error *error) {
    static const double CLEARLY = 2.0; /* in log evidence: e^2, about 7 times as probable */
    lg_table_run *run = self->run;
    double *theta = NULL;
    lg_table_evidence_result result = {0};
    *run = r->best;
    const lg_status status = try_width(self, width, grown, r, &theta, &result, error);
    ((lg_table_state *)self->state)->evidence.evaluations += result.evaluations;
    if (status == LG_OK && (r->theta == NULL || result.evidence > r->high + CLEARLY)) {
        r->best = *run, r->high = result.evidence, r->theta = theta;
        r->better = true;
    }
    return status == LG_NOT_FINITE ? LG_OK : status;
}

/* Runs both lanes of a width, first from grown and then from drawn parameters; the drawn lane alone if the
 * work for both is too much. */
static lg_status run_lanes(lg_training *self, uint32_t width, double lane, race *r, lg_error *error) {
    lg_status status = LG_OK;
    r->better = false;
    if (r->theta != NULL && r->work + 2.0 * lane <= RACE_WORK) status = run_lane(self, width, true, r, error);
    return status == LG_OK ? run_lane(self, width, false, r, error) : status;
}

/* Chooses the width with the highest evidence. Tries widths from small to large, until three in a row are not
 * clearly better or RACE_WORK is used up. The run gets the best model and its priors, self->theta its
 * parameters. */
static lg_status choose_width(lg_training *self, size_t rows, lg_error *error) {
    static const uint32_t widths[] = {1, 2, 4, 6, 8, 12, 16, 24, 32, 48};
    enum { WORSE = 3 };
    lg_table_run *run = self->run;
    race r = {.best = *run, .high = -INFINITY, .rows = rows};
    const double columns = (double)r.best.model.net.inputs + r.best.model.net.outputs + 1.0;
    size_t i = 4.0 * columns > (double)rows * run->model.net.outputs ? 0 : 1;
    lg_status status = LG_OK;
    for (uint32_t worse = 0; i < LG_COUNT(widths) && worse < WORSE && status == LG_OK; i++) {
        const double lane = lane_work(run, widths[i], (double)rows);
        if (r.theta != NULL && r.work + lane > RACE_WORK) break;
        status = run_lanes(self, widths[i], lane, &r, error);
        worse = r.better ? 0 : worse + 1;
    }
    *run = r.best;
    self->theta = r.theta;
    if (status != LG_OK) return status;
    return r.theta != NULL
               ? LG_OK
               : lg_fail(error, LG_NOT_FINITE, "the residuals are not finite at any width of the network");
}

/* ---- priors ---- */

/* How many rows find the priors: as many as the weights need. */
static size_t rows_for(const lg_table_run *run, size_t least, size_t trained) {
    static const double FOR_WEIGHTS = 3.0;
    const double weights = (double)lg_table_parameters(&run->model);
    return (size_t)fmin(fmax(FOR_WEIGHTS * weights / run->model.net.outputs, (double)least), (double)trained);
}

/* Finds the priors of the run's model. */
static lg_status find_priors(lg_training *self, bool go_on, size_t least_rows, lg_error *error) {
    lg_table_state *s = self->state;
    lg_table_run *run = self->run;
    lg_table_evidence_options options;
    const uint32_t before = s->evidence.evaluations;
    run->decay.count = lg_table_slices(&run->model);
    lg_table_evidence_options_init(&options);
    options.rows = rows_for(run, least_rows, s->trained);
    const double work = go_on ? EVIDENCE_WORK : GIVEN_WORK, most = options.evaluations;
    options.evaluations =
        (uint32_t)fmin(fmax(work / lg_table_work(&run->model, (double)options.rows), 12.0), most);
    options.go_on = go_on;
    const lg_status status = lg_table_evidence(self->context, &s->problem, &options, self->theta,
                                               run->decay.value, &s->evidence, error);
    if (status == LG_OK && !go_on && !s->evidence.settled && 2 * options.evaluations < most)
        LG_WARN(self,
                "the search for weight decays ended after %u evaluations, before it settled: the network may "
                "not follow the data closely enough; take a narrower network (--hidden), or --method "
                "ssbroyden --weight-decay 0",
                s->evidence.evaluations);
    s->evidence.evaluations += before;
    return status;
}

/* Tries two hidden layers of WIDTH units if the data determine nearly all parameters of the model, since they
 * may determine more. The rows must be more than the parameters, and the work limited. Keeps the two layers
 * if their evidence, on the same rows, is higher. */
static lg_status widen(lg_training *self, size_t least_rows, lg_error *error) {
    enum { WIDTH = 16, EVALUATIONS = 200, MOST_ROWS = 5000 };
    static const double NEARLY_ALL = 0.8, WORK = 8e10;
    lg_table_state *s = self->state;
    lg_table_run *run = self->run;
    const size_t numbers = lg_table_parameters(&run->model);
    if (s->trained > MOST_ROWS || s->evidence.effective < NEARLY_ALL * (double)numbers) return LG_OK;
    const lg_table_run narrow = *run;
    const lg_table_evidence_result kept = s->evidence;
    lg_table_run wide = *run;
    double *theta;
    lg_table_options two = run->model.options;
    two.hidden_count = 2;
    two.hidden[0] = two.hidden[1] = WIDTH;
    LG_TRY(lg_table_init(&wide.model, &two, run->model.net.inputs, run->model.net.outputs, error));
    const size_t rows = rows_for(&wide, least_rows, s->trained);
    if (rows * run->model.net.outputs <= lg_table_parameters(&wide.model) ||
        EVALUATIONS * lg_table_work(&wide.model, (double)rows) > WORK)
        return LG_OK;
    LG_TRAINING_ARRAY(self, theta, numbers, error);
    memcpy(theta, self->theta, numbers * sizeof *theta);
    LG_TRY(find_priors(self, true, rows, error)); /* the evidence of the narrow model on these rows */
    const double least = s->evidence.evidence;
    *run = wide;
    LG_TRY(lg_table_first_parameters(self, &self->theta, error));
    const lg_status status = find_priors(self, false, rows, error);
    if (status == LG_OK && s->evidence.evidence > least) return LG_OK;
    const uint32_t evaluations = s->evidence.evaluations;
    *run = narrow;
    self->theta = theta;
    s->evidence = kept;
    s->evidence.evaluations = evaluations;
    return status == LG_NOT_FINITE ? LG_OK : status;
}

lg_status lg_table_find_start(lg_training *self, bool any_width, lg_error *error) {
    enum { LEAST_ROWS = 1000 };
    const size_t trained = ((lg_table_state *)self->state)->trained;
    LG_TRY(any_width ? choose_width(self, trained < LEAST_ROWS ? trained : LEAST_ROWS, error)
                     : lg_table_first_parameters(self, &self->theta, error));
    LG_TRY(find_priors(self, any_width, LEAST_ROWS, error));
    return any_width ? widen(self, LEAST_ROWS, error) : LG_OK;
}
