/* Whether trajectories can come from the Hamiltonian that was learned from them. */
#include <math.h>
#include <stdlib.h>

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

/* Learned energies of one point, and their changes up to the last points. The point is the second one, where
 * there is a third: noise in the data raises the energies of all points but, often, the first. */
typedef struct energies {
    moments start, change;
} energies;

static void measure(const lg_model *model, const lg_hamiltonian_problem *problem, energies *out) {
    const size_t d = lg_model_inputs(model), points = problem->points;
    void *work = app_alloc(1, lg_model_work_size(model));
    for (size_t i = 0; i < problem->trajectories; i++) {
        const double *first = problem->data + i * points * d, *last = first + (points - 1) * d;
        double begin, end;
        lg_model_eval(model, points > 2 ? first + d : first, &begin, work);
        lg_model_eval(model, last, &end, work);
        if (!isfinite(begin) || !isfinite(end)) continue;
        add(&out->start, begin);
        add(&out->change, end - begin);
    }
    free(work);
}

/* A conservative model has no change on average, whatever the noise: more than `scatter` standard errors, and
 * more than `part` of the energies' spread, is damping or a drive. */
lg_status warn_of_drift(const app *self, const learner *trained, const double *theta, lg_error *error) {
    static const double scatter = 6.0, part = 2e-3;
    lg_model *model;
    energies found = {{0, 0, 0}, {0, 0, 0}};
    const lg_hamiltonian_problem *problem = &trained->problem;
    const lg_status status = lg_model_create_hamiltonian(self->context, problem->model, theta, &model, error);
    if (status != LG_OK) return status;
    measure(model, problem, &found);
    lg_model_destroy(model);
    const double change = found.change.mean, spread = deviation(&found.start);
    const double standard = deviation(&found.change) / sqrt(fmax(found.change.count, 1));
    if (found.change.count > 5 && fabs(change) > scatter * standard && fabs(change) > part * spread)
        app_warn(self,
                 "the data are not conservative: along a trajectory the learned energy %s by %.2g on average "
                 "(standard error %.1g; energies spread by %.2g), which no Hamiltonian can do; lg-identify "
                 "learns damped and driven machines",
                 change < 0 ? "falls" : "rises", fabs(change), standard, spread);
    return LG_OK;
}
