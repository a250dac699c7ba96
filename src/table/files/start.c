/* Start of the training of a table: the width, priors and parameters with the highest evidence. */
#include "table/files/recipe.h"

#include <math.h>
#include <string.h>

enum { STREAM_WEIGHTS = 1, RACE_EVALUATIONS = 60, MOST_EVALUATIONS = 200 };
/* Bounds on work, in units of lg_table_work. A search with a given width may take some ten seconds. */
static const double RACE_WORK = 8e9, EVIDENCE_WORK = 3e9, GIVEN_WORK = 7e11;

/* ---- parameters ---- */

lg_status lg_table_first_parameters(lg_training *self, const lg_table *model, double **theta,
                                    lg_error *error) {
    lg_rng rng;
    LG_TRAINING_ARRAY(self, *theta, lg_table_parameters(model), error);
    lg_rng_seed(&rng, lg_training_settings(self)->seed, STREAM_WEIGHTS);
    lg_table_initialise(model, &rng, *theta);
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

/* ---- candidates ---- */

/* A network, its priors and parameters, and how well it explains the rows. */
typedef struct candidate {
    lg_table_run run;
    double *theta; /* NULL until the candidate is trained */
    lg_table_evidence_result found;
} candidate;

/* Gives the candidate `layers` hidden layers of this width and draws its parameters. */
static lg_status draw(lg_training *self, uint32_t layers, uint32_t width, candidate *c, lg_error *error) {
    lg_table_options options = c->run.model.options;
    options.hidden_count = layers;
    for (uint32_t i = 0; i < layers; i++) options.hidden[i] = width;
    LG_TRY(lg_table_init(&c->run.model, &options, c->run.model.net.inputs, c->run.model.net.outputs, error));
    return lg_table_first_parameters(self, &c->run.model, &c->theta, error);
}

/* Searches the priors and parameters of highest evidence. */
static lg_status search(lg_training *self, size_t rows, uint32_t evaluations, bool go_on, candidate *c,
                        lg_error *error) {
    lg_table_state *s = self->state;
    lg_table_evidence_options effort;
    const lg_table_problem problem = {.model = &c->run.model, .samples = &s->samples};
    lg_table_evidence_options_init(&effort);
    effort.go_on = go_on;
    effort.rows = rows;
    effort.evaluations = evaluations;
    c->run.decay.count = lg_table_slices(&c->run.model);
    c->found = (lg_table_evidence_result){0};
    const lg_status status =
        lg_table_evidence(self->context, &problem, &effort, c->theta, c->run.decay.value, &c->found, error);
    s->evidence.evaluations += c->found.evaluations;
    return status;
}

/* ---- the race of widths ---- */

typedef struct race {
    candidate best;
    double work;
    size_t rows;
    bool better; /* whether the last width was clearly better */
} race;

/* Trains one candidate of the race. */
static lg_status run_lane(lg_training *self, candidate *c, bool grown, race *r, lg_error *error) {
    static const double CLEARLY = 2.0; /* in log evidence: e^2, about 7 times as probable */
    const lg_status status = search(self, r->rows, RACE_EVALUATIONS, grown, c, error);
    const bool first = r->best.theta == NULL;
    r->work += c->found.evaluations * lg_table_work(&c->run.model, (double)r->rows);
    if (status == LG_OK && (first || c->found.evidence > r->best.found.evidence + CLEARLY)) {
        r->best = *c;
        r->better = true;
    }
    return status == LG_NOT_FINITE ? LG_OK : status;
}

/* Chooses the width with the highest evidence. Tries widths from small to large, until three in a row are not
 * clearly better or RACE_WORK is used up. A width has two lanes, first from grown and then from drawn
 * parameters; the drawn lane alone if the work for both is too much. */
static lg_status choose_width(lg_training *self, size_t rows, candidate *best, lg_error *error) {
    static const uint32_t widths[] = {1, 2, 4, 6, 8, 12, 16, 24, 32, 48};
    enum { WORSE = 3 };
    race r = {.best = *best, .rows = rows};
    const lg_net *net = &best->run.model.net;
    const double columns = (double)net->inputs + net->outputs + 1.0;
    size_t i = 4.0 * columns > (double)rows * net->outputs ? 0 : 1;
    for (uint32_t worse = 0; i < LG_COUNT(widths) && worse < WORSE; i++) {
        candidate drawn = r.best, grown = r.best;
        LG_TRY(draw(self, 1, widths[i], &drawn, error));
        const double lane = RACE_EVALUATIONS * lg_table_work(&drawn.run.model, (double)rows);
        if (r.best.theta != NULL && r.work + lane > RACE_WORK) break;
        r.better = false;
        if (r.best.theta != NULL && r.work + 2.0 * lane <= RACE_WORK) {
            LG_TRY(draw(self, 1, widths[i], &grown, error));
            grow_parameters(&grown.run.model, &r.best.run.model, r.best.theta, grown.theta);
            LG_TRY(run_lane(self, &grown, true, &r, error));
        }
        LG_TRY(run_lane(self, &drawn, false, &r, error));
        worse = r.better ? 0 : worse + 1;
    }
    *best = r.best;
    return best->theta != NULL
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

/* Finds the priors of the candidate. */
static lg_status find_priors(lg_training *self, bool go_on, size_t least_rows, candidate *c,
                             lg_error *error) {
    const size_t rows = rows_for(&c->run, least_rows, ((lg_table_state *)self->state)->trained);
    const double work = go_on ? EVIDENCE_WORK : GIVEN_WORK, each = lg_table_work(&c->run.model, (double)rows);
    const uint32_t evaluations = (uint32_t)fmin(fmax(work / each, 12.0), MOST_EVALUATIONS);
    LG_TRY(search(self, rows, evaluations, go_on, c, error));
    if (!go_on && !c->found.settled && 2 * evaluations < MOST_EVALUATIONS)
        LG_WARN(self,
                "the search for weight decays ended after %u evaluations, before it settled: the network may "
                "not follow the data closely enough; take a narrower network (--hidden), or --optimizer "
                "ssbroyden --weight-decay 0",
                c->found.evaluations);
    return LG_OK;
}

/* Tries two hidden layers of WIDTH units if the data determine nearly all parameters of the model, since they
 * may determine more. The rows must be more than the parameters, and the work limited. Keeps the two layers
 * if their evidence, on the same rows, is higher. */
static lg_status widen(lg_training *self, size_t least_rows, candidate *best, lg_error *error) {
    enum { WIDTH = 16, MOST_ROWS = 5000 };
    static const double NEARLY_ALL = 0.8, WORK = 8e10;
    const size_t trained = ((lg_table_state *)self->state)->trained,
                 numbers = lg_table_parameters(&best->run.model);
    candidate narrow = *best, wide = *best;
    if (trained > MOST_ROWS || best->found.effective < NEARLY_ALL * (double)numbers) return LG_OK;
    LG_TRY(draw(self, 2, WIDTH, &wide, error));
    const size_t rows = rows_for(&wide.run, least_rows, trained);
    if (rows * wide.run.model.net.outputs <= lg_table_parameters(&wide.run.model) ||
        MOST_EVALUATIONS * lg_table_work(&wide.run.model, (double)rows) > WORK)
        return LG_OK;
    LG_TRAINING_ARRAY(self, narrow.theta, numbers, error);
    memcpy(narrow.theta, best->theta, numbers * sizeof *narrow.theta);
    LG_TRY(find_priors(self, true, rows, &narrow, error)); /* its evidence on these rows */
    const lg_status status = find_priors(self, false, rows, &wide, error);
    if (status == LG_OK && wide.found.evidence > narrow.found.evidence) *best = wide;
    return status == LG_NOT_FINITE ? LG_OK : status;
}

lg_status lg_table_find_start(lg_training *self, bool any_width, lg_error *error) {
    enum { LEAST_ROWS = 1000 };
    lg_table_state *s = self->state;
    lg_table_run *run = self->run;
    candidate best = {.run = *run};
    LG_TRY(any_width ? choose_width(self, s->trained < LEAST_ROWS ? s->trained : LEAST_ROWS, &best, error)
                     : lg_table_first_parameters(self, &run->model, &best.theta, error));
    LG_TRY(find_priors(self, any_width, LEAST_ROWS, &best, error));
    if (any_width) LG_TRY(widen(self, LEAST_ROWS, &best, error));
    const uint32_t evaluations = s->evidence.evaluations;
    *run = best.run;
    self->theta = best.theta;
    s->evidence = best.found;
    s->evidence.evaluations = evaluations;
    return LG_OK;
}
