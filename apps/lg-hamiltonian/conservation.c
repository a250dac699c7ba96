/* Whether trajectories can come from the Hamiltonian that was learned from them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-hamiltonian/learning.h"

/* Mean and variance, one number after the other. */
typedef struct moments {
    double count, mean, squares;
} moments;

static void add(moments *m, double x) {
    const double before = x - m->mean;
    m->count++;
    m->mean += before / m->count;
    m->squares += before * (x - m->mean);
}

static double deviation(const moments *m) {
    return m->count > 1 ? sqrt(m->squares / (m->count - 1)) : 0.0;
}

/* Along one trajectory the learned energy is H = a + b S, S the sum of squared steps of the state so far: b
 * is what motion costs, whatever the energy at the start. x = S.H and y = S.S, both about their means. */
typedef struct course {
    double begin, way, x, y; /* H at the start, S at the end */
} course;

/* b of all trajectories. Each counts about as much as any other: large energies would outweigh all others. */
typedef struct cost {
    double slope, error, change, spread; /* change: b S, of the mean S; spread: of the energies */
    size_t count;
} cost;

static cost find_cost(const course *courses, size_t count) {
    moments start = {0, 0, 0}, way = {0, 0, 0};
    double x = 0.0, y = 0.0, left = 0.0;
    for (size_t i = 0; i < count; i++) add(&start, courses[i].begin), add(&way, courses[i].way);
    for (size_t i = 0; i < count; i++) {
        const double unit = courses[i].way + way.mean, weight = 1.0 / (unit * unit);
        x += weight * courses[i].x, y += weight * courses[i].y;
    }
    for (size_t i = 0; i < count; i++) {
        const double unit = courses[i].way + way.mean, weight = 1.0 / (unit * unit);
        const double off = weight * (courses[i].x - x / y * courses[i].y);
        left += off * off;
    }
    return (cost){x / y, sqrt(left) / y, x / y * way.mean, deviation(&start), count};
}

typedef struct measuring {
    const lg_hamiltonian_problem *problem;
    double unit[6 * LG_HAMILTONIAN_MAX_COPIES]; /* of each number of a state, in S */
    const lg_model *model;
    void *work;         /* of the model's evaluations */
    lg_stepper *steps;  /* of the scheme of training; NULL: none for this model */
    double *predicted;  /* (points, d) */
    double *way, *gain; /* (points): S; H of the data less H of the scheme's own run */
} measuring;

static double energy(const measuring *m, const double *state) {
    double value;
    lg_model_eval(m->model, state, &value, m->work);
    return value;
}

/* The run of the scheme of training from `first`: what it gains is its error, not the data's. */
static void run_scheme(const measuring *m, const double *first, size_t points) {
    const lg_hamiltonian_problem *problem = m->problem;
    const size_t d = lg_model_inputs(m->model);
    const double h = problem->dt / problem->substeps;
    if (m->steps == NULL || lg_integrate_fixed(m->steps, 0.0, h, (points - 1) * problem->substeps, NULL, 0,
                                               problem->substeps, first, m->predicted, NULL) != LG_OK)
        for (size_t j = 0; j < points; j++) memcpy(m->predicted + j * d, first, d * sizeof *first);
}

static double square_step(const measuring *m, const double *a, const double *b) {
    double sum = 0.0;
    for (size_t k = 0; k < lg_model_inputs(m->model); k++) sum += pow((b[k] - a[k]) / m->unit[k], 2.0);
    return sum;
}

static course follow(const measuring *m, const double *first, size_t points) {
    const size_t d = lg_model_inputs(m->model);
    course out = {.begin = energy(m, first)};
    double way = 0.0, gain = 0.0;
    run_scheme(m, first, points);
    for (size_t j = 0; j < points; j++) {
        m->way[j] = j == 0 ? 0.0 : m->way[j - 1] + square_step(m, first + (j - 1) * d, first + j * d);
        m->gain[j] = energy(m, first + j * d) - energy(m, m->predicted + j * d);
        way += m->way[j] / (double)points, gain += m->gain[j] / (double)points;
    }
    for (size_t j = 0; j < points; j++) {
        out.x += (m->way[j] - way) * (m->gain[j] - gain);
        out.y += (m->way[j] - way) * (m->way[j] - way);
    }
    out.way = m->way[points - 1];
    return out;
}

static bool is_finite(const course *c) {
    return isfinite(c->begin) && isfinite(c->x) && isfinite(c->y);
}

/* Different trajectories count, from their second point on, where there is a third: noise in the data
 * raises the energies of all points but, often, the first. */
static size_t follow_all(const measuring *m, course *out) {
    const size_t d = lg_model_inputs(m->model), points = m->problem->points, skipped = points > 2 ? 1 : 0;
    size_t *index = app_alloc(m->problem->trajectories, sizeof *index), count = 0;
    const size_t different = different_trajectories(m->problem, index);
    for (size_t i = 0; i < different; i++) {
        out[count] = follow(m, m->problem->data + (index[i] * points + skipped) * d, points - skipped);
        count += is_finite(&out[count]);
    }
    free(index);
    return count;
}

/* The scale of each number of a state, by the data. */
static void number_units(const lg_hamiltonian_problem *problem, double *unit) {
    lg_hamiltonian scaled = *problem->model;
    (void)lg_hamiltonian_find_scales(problem, &scaled.scales, NULL); /* on failure: the scales of the model */
    lg_hamiltonian_number_scales(&scaled, unit);
}

/* What motion costs, beside the run of the scheme of training or, without `scheme`, beside no change. */
static cost measure(const app *self, const lg_model *model, const lg_hamiltonian_problem *problem,
                    bool scheme) {
    const size_t points = problem->points;
    void *flow = app_alloc(1, lg_model_work_size(model));
    lg_model_user user;
    lg_ode ode;
    measuring m = {.problem = problem,
                   .model = model,
                   .work = app_alloc(1, lg_model_work_size(model)),
                   .predicted = app_alloc(points * lg_model_inputs(model), sizeof(double)),
                   .way = app_alloc(points, sizeof(double)),
                   .gain = app_alloc(points, sizeof(double))};
    number_units(problem, m.unit);
    course *courses = app_alloc(problem->trajectories, sizeof *courses);
    if (!scheme || lg_model_ode(model, &ode, &user, flow) != LG_OK ||
        lg_stepper_create(self->context, problem->scheme, &ode, &m.steps) != LG_OK)
        m.steps = NULL;
    const cost out = find_cost(courses, follow_all(&m, courses));
    lg_stepper_destroy(m.steps);
    free(flow);
    free(m.work);
    free(m.predicted);
    free(m.way);
    free(m.gain);
    free(courses);
    return out;
}

/* More than chance, which few trajectories leave more of, and more than a part of the energies. */
static bool is_told(const cost *c) {
    static const double scatter = 4.5, few = 6.0, part = 2e-3;
    return c->count >= (size_t)few && fabs(c->change) > part * c->spread &&
           fabs(c->slope) > scatter * (1.0 + few / (double)c->count) * c->error;
}

/* Whether the fit is near what it can reach: most of the motion is explained, and the loss has ceased to
 * fall. The energy of a model that is not learned changes along any data. */
static bool is_learned(const app *self, const learner *trained, const double *theta) {
    static const double explained = 0.3, fall = 1.5;
    enum { FEWEST = 16 }; /* epochs */
    const lg_hamiltonian_problem *problem = &trained->problem;
    const double *history = lg_fit_history(trained->fit, LG_FIT_LOSS);
    const size_t epochs = lg_fit_epochs_done(trained->fit);
    double loss = 0.0;
    if (epochs < FEWEST || !(history[epochs / 2] <= fall * history[epochs - 1])) return false;
    return lg_hamiltonian_mean_squared_error(self->context, problem, theta, &loss, NULL) == LG_OK &&
           loss <= explained * unchanged_error(problem);
}

/* A conservative model loses nothing to motion, whatever the noise. A scheme with large steps does; then the
 * energy falls beside its run, or by itself, but not both. */
lg_status warn_of_drift(const app *self, const learner *trained, const double *theta, lg_error *error) {
    lg_model *model;
    const lg_hamiltonian_problem *problem = &trained->problem;
    if (!is_learned(self, trained, theta)) return LG_OK;
    const lg_status status = lg_model_create_hamiltonian(self->context, problem->model, theta, &model, error);
    if (status != LG_OK) return status;
    const cost found = measure(self, model, problem, false), beside = measure(self, model, problem, true);
    lg_model_destroy(model);
    if (is_told(&found) && is_told(&beside) && found.change * beside.change > 0.0)
        app_warn(self,
                 "the data are not conservative: along a trajectory the learned energy %s by %.2g on average "
                 "(standard error %.1g; energies spread by %.2g), which no Hamiltonian can do; lg-identify "
                 "learns damped and driven machines",
                 found.change < 0 ? "falls" : "rises", fabs(found.change),
                 fabs(found.change * found.error / found.slope), found.spread);
    return LG_OK;
}
