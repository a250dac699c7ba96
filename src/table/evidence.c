/* Maximises the evidence for weights and their priors; liegrad/table.h has the formulas. H is factored as
 * H/beta, so that noise that tends to 0 does no harm. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "kernels/kernels.h"
#include "kernels/lapack.h"
#include "table/internal.h"

enum { CHUNK = 128, MOST_SLICES = 2 * NET_MAX_DENSE + 1, BURN_IN = 8, REFUSALS = 8, QUIET = 3 };

/* START: initial alpha/beta per datum. LEAST and, per datum, MOST: bounds on alpha/beta. FLOOR: least noise,
 * in deviations of the outputs. FACTOR: growth of the damping after a refused step, up to REFUSALS times in a
 * row. The search ends after QUIET steps in a row that lower |r|^2 + penalty by less than the part STILL. */
static const double START = 1e-4, LEAST = 1e-12, MOST = 1e6, FLOOR = 1e-10, FACTOR = 4.0, STILL = 1e-5;

/* Parameters, and there J^T r, J^T J and |r|^2. */
typedef struct point {
    double *theta, *g; /* (n) */
    double *A;         /* (n, n) */
    double squares;
} point;

typedef struct evidence {
    const lg_context *context;
    const lg_table_problem *problem;
    const lg_kernels *k;
    lg_tape *tape;
    size_t n, rows, data; /* number of parameters; training rows that are used; rows times outputs */
    uint32_t slices;
    lg_slice_info slice[MOST_SLICES];
    uint32_t *chosen; /* (rows): indices of these rows */
    double *memory;
    double *step; /* (n) */
    double *H;    /* (n, n): the factor */
    point at, trial;
    double *jacobian, *r;      /* of one chunk of rows */
    double ratio[MOST_SLICES]; /* alpha/beta of each slice */
    double variance;           /* 1/beta */
    double gamma[MOST_SLICES], effective;
    uint32_t evaluations;
    bool settled;
} evidence;

/* ---- sums over the rows ---- */

/* Fills the point; of J^T J (row-major) the upper triangle. */
static lg_status look(evidence *e, point *p) {
    const uint32_t outputs = e->problem->model->net.outputs;
    const size_t n = e->n;
    enum { WIDTH = 96 };
    memset(p->g, 0, n * sizeof *p->g);
    memset(p->A, 0, n * n * sizeof *p->A);
    p->squares = 0;
    e->evaluations++;
    for (size_t at = 0; at < e->rows; at += CHUNK) {
        const size_t count = e->rows - at < CHUNK ? e->rows - at : CHUNK, m = count * outputs;
        if (lg_cancelled(e->context)) return LG_CANCELLED;
        LG_TRY(
            lg_table_linearise(e->problem, e->tape, p->theta, e->chosen + at, count, 1.0, e->r, e->jacobian));
        p->squares += e->k->dot(m, e->r, e->r);
        for (size_t row = 0; row < m; row++) e->k->axpy(n, e->r[row], e->jacobian + row * n, p->g);
        for (size_t c = 0; c < n; c += WIDTH)
            e->k->gemm(n - c < WIDTH ? n - c : WIDTH, n - c, m, e->jacobian + c, 1, n, e->jacobian + c, n,
                       p->A + c * n + c, n, true);
    }
    return LG_OK;
}

/* ---- priors ---- */

/* |r|^2 and the penalty of the priors. */
static double loss(const evidence *e, const point *p) {
    double sum = 0;
    for (uint32_t s = 0; s < e->slices; s++) {
        const double *w = p->theta + e->slice[s].offset;
        sum += e->ratio[s] * e->k->dot(e->slice[s].count, w, w);
    }
    return p->squares + sum;
}

/* Factors H/beta = J^T J + diag(ratio), with damping times its diagonal added. The upper triangle of a
 * row-major matrix is LAPACK's lower triangle. */
static bool factor(evidence *e, double damping) {
    const int n = (int)e->n;
    int info = 0;
    memcpy(e->H, e->at.A, e->n * e->n * sizeof *e->H);
    for (uint32_t s = 0; s < e->slices; s++)
        for (size_t i = e->slice[s].offset; i < e->slice[s].offset + e->slice[s].count; i++) {
            double *at = e->H + i * e->n + i;
            *at += e->ratio[s] + damping * (*at + e->ratio[s]);
        }
    dpotrf_("L", &n, e->H, &n, &info);
    return info == 0;
}

/* Computes gamma of each slice from the diagonal of H^-1. dpotri cannot fail: a factor has no zero on its
 * diagonal. */
static bool count_parameters(evidence *e) {
    const int n = (int)e->n;
    int info = 0;
    if (!factor(e, 0.0)) return false;
    dpotri_("L", &n, e->H, &n, &info);
    e->effective = 0;
    for (uint32_t s = 0; s < e->slices; s++) {
        double trace = 0;
        for (size_t i = 0; i < e->slice[s].count; i++) trace += e->H[(e->slice[s].offset + i) * (e->n + 1)];
        e->gamma[s] = fmax((double)e->slice[s].count - e->ratio[s] * trace, 0.0);
        e->effective += e->gamma[s];
    }
    return isfinite(e->effective);
}

/* Estimates alpha and beta again from the current theta. */
static void estimate(evidence *e) {
    const double data = (double)e->data;
    if (!count_parameters(e)) return;
    const double rest = fmax(data - e->effective, 0.02 * data);
    e->variance = fmax(e->at.squares / rest, FLOOR * FLOOR);
    for (uint32_t s = 0; s < e->slices; s++) {
        const double *w = e->at.theta + e->slice[s].offset;
        const double size = e->k->dot(e->slice[s].count, w, w);
        const double ratio = e->variance * (e->gamma[s] + 1e-3) / fmax(size, 1e-300);
        e->ratio[s] = fmin(fmax(ratio, LEAST), MOST * data);
    }
}

/* Logarithm of the probability of the data with these alpha and beta, without terms that depend on the data
 * alone. */
static double log_evidence(evidence *e) {
    double sum = -0.5 * loss(e, &e->at) / e->variance - 0.5 * (double)e->data * log(e->variance);
    if (!factor(e, 0.0)) return (double)NAN;
    for (size_t i = 0; i < e->n; i++) sum -= log(e->H[i * (e->n + 1)]);
    for (uint32_t s = 0; s < e->slices; s++) sum += 0.5 * (double)e->slice[s].count * log(e->ratio[s]);
    return sum;
}

/* ---- the search ---- */

static bool solve(evidence *e, double damping) {
    const int n = (int)e->n, one = 1;
    int info = 0;
    if (!factor(e, damping)) return false;
    for (uint32_t s = 0; s < e->slices; s++)
        for (size_t i = e->slice[s].offset; i < e->slice[s].offset + e->slice[s].count; i++)
            e->step[i] = -e->at.g[i] - e->ratio[s] * e->at.theta[i];
    dpotrs_("L", &n, &one, e->H, &n, e->step, &n, &info);
    return e->k->all_finite(e->n, e->step);
}

/* Takes a step that lowers |r|^2 + penalty. *fall: relative decrease. LG_NO_CONVERGENCE: no step lowers
 * it. */
static lg_status advance(evidence *e, double *damping, double *fall) {
    const double before = loss(e, &e->at);
    for (uint32_t refused = 0; refused < REFUSALS; refused++, *damping *= FACTOR) {
        if (!solve(e, *damping)) continue;
        for (size_t i = 0; i < e->n; i++) e->trial.theta[i] = e->at.theta[i] + e->step[i];
        LG_TRY(look(e, &e->trial));
        const double after = loss(e, &e->trial);
        if (!(after < before)) continue;
        *fall = (before - after) / before;
        const point kept = e->at;
        e->at = e->trial;
        e->trial = kept;
        *damping = fmax(*damping / (FACTOR * FACTOR), 1e-10);
        return LG_OK;
    }
    return LG_NO_CONVERGENCE;
}

static lg_status search(evidence *e, const lg_table_evidence_options *o) {
    double damping = 1e-2, fall = 1.0, effective = 0;
    uint32_t quiet = 0;
    LG_TRY(look(e, &e->at));
    if (!isfinite(e->at.squares)) return LG_NOT_FINITE;
    for (uint32_t i = 0; e->evaluations < o->evaluations && quiet < QUIET; i++) {
        const lg_status status = advance(e, &damping, &fall);
        if (status == LG_NO_CONVERGENCE && i < BURN_IN) damping = 1e-2;
        if (status != LG_OK && status != LG_NO_CONVERGENCE) return status;
        if (status == LG_NO_CONVERGENCE) fall = 0, damping = 1e-2, quiet++;
        if (i >= BURN_IN || o->go_on) estimate(e);
        const bool still = fall < STILL && fabs(e->effective - effective) < 1e-2 * (1.0 + effective);
        quiet = i > BURN_IN && still ? quiet + 1 : 0;
        effective = e->effective;
    }
    e->settled = quiet == QUIET;
    estimate(e);
    return LG_OK;
}

/* ---- memory ---- */

static lg_status make_room(evidence *e) {
    const size_t n = e->n, chunk = (size_t)CHUNK * e->problem->model->net.outputs;
    lg_tape_options options;
    lg_tape_options_init(&options);
    LG_TRY(lg_tape_create(e->context, &options, &e->tape));
    if (n > 20000) return LG_OUT_OF_MEMORY;
    LG_TRY(LG_ALLOC_ALL(e->context, LG_ARRAY(e->chosen, e->rows),
                        LG_ARRAY(e->memory, 5 * n + 3 * n * n + chunk * (n + 1))));
    double *next = e->memory + 5 * n;
    e->step = e->memory;
    e->at = (point){.theta = e->memory + n, .g = e->memory + 2 * n, .A = next};
    e->trial = (point){.theta = e->memory + 3 * n, .g = e->memory + 4 * n, .A = next + n * n};
    e->H = next + 2 * n * n;
    e->jacobian = e->H + n * n;
    e->r = e->jacobian + chunk * n;
    return LG_OK;
}

void lg_table_evidence_options_init(lg_table_evidence_options *options) {
    *options = (lg_table_evidence_options){.size = sizeof *options, .evaluations = 200, .rows = 4000};
}

static lg_status run(evidence *e, const lg_table_evidence_options *o, double *theta, double *decay,
                     lg_table_evidence_result *result) {
    LG_TRY(make_room(e));
    const size_t training = e->problem->samples->training; /* the rows are chosen evenly */
    for (size_t i = 0; i < e->rows; i++) e->chosen[i] = (uint32_t)lg_spread(i, training, e->rows);
    memcpy(e->at.theta, theta, e->n * sizeof *theta);
    const size_t all = training * e->problem->model->net.outputs;
    for (uint32_t s = 0; s < e->slices; s++)
        e->ratio[s] = o->go_on ? 0.5 * decay[s] * (double)all : START * (double)e->data;
    LG_TRY(search(e, o));
    memcpy(theta, e->at.theta, e->n * sizeof *theta);
    /* The loss of lg_table_problem divides |r|^2 by the number of all training outputs. */
    for (uint32_t s = 0; s < e->slices; s++) decay[s] = 2.0 * e->ratio[s] / (double)all;
    if (result != NULL)
        *result = (lg_table_evidence_result){e->evaluations, e->settled, e->effective, sqrt(e->variance),
                                             log_evidence(e)};
    return LG_OK;
}

lg_status lg_table_evidence(const lg_context *context, const lg_table_problem *problem,
                            const lg_table_evidence_options *options, double *theta, double *decay,
                            lg_table_evidence_result *result, lg_error *error) {
    lg_table_evidence_options chosen;
    LG_NEEDS(error, problem, theta, decay);
    lg_table_evidence_options_init(&chosen);
    if (options != NULL) chosen = *options;
    if (problem->model->options.task != LG_TABLE_REGRESSION)
        return lg_fail(error, LG_UNSUPPORTED, "the evidence can be computed for a regression only");
    evidence e = {.context = context,
                  .problem = problem,
                  .k = lg_kernels_for(LG_F64),
                  .n = lg_table_parameters(problem->model),
                  .rows = problem->samples->training,
                  .variance = 1.0};
    if (chosen.rows > 0 && e.rows > chosen.rows) e.rows = chosen.rows;
    e.data = e.rows * problem->model->net.outputs;
    while (e.slices < MOST_SLICES && lg_table_slice(problem->model, e.slices, &e.slice[e.slices])) e.slices++;
    const lg_status status = run(&e, &chosen, theta, decay, result);
    lg_tape_destroy(e.tape);
    LG_FREE_ALL(context, e.chosen, e.memory);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "the priors of %zu weights: %s", e.n, lg_status_sentence(status));
}
