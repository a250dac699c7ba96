/* Tests whether trajectories can come from the Hamiltonian that was learned from them. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "hamiltonian/internal.h"
#include "hamiltonian/learned.h"

/* Running mean and sum of squared deviations. */
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
    return sqrt(m->squares / fmax(m->count - 1, 1.0)); /* 0 for fewer than two */
}

/* The learned energy along one trajectory is modelled as H = a + b S. S is the sum of the squared steps of
 * the state up to a point, so b is the energy that motion gains per unit of S (negative: what it costs),
 * whatever the energy a at the start. x is the sum over the points of H S, y of S^2, both about their means;
 * here H is relative to a run of the training scheme, see follow(). */
typedef struct course {
    double begin, way, x, y; /* begin: H at the first point; way: S at the last point */
} course;

/* slope: b, fitted to all trajectories; error: its standard error. Trajectories are weighted such that each
 * counts about equally; otherwise trajectories of large energy would outweigh all others. */
typedef struct cost {
    /* change: b times the mean of S; spread: standard deviation of the start energies */
    double slope, error, change, spread;
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
    const lg_context *context;
    const lg_hamiltonian_problem *problem;
    double unit[6 * LG_HAMILTONIAN_MAX_COPIES]; /* scale of each number of a state, for S */
    lg_model *model;
    void *work;         /* work memory of the model */
    lg_model_user user; /* the model as an equation, for `steps` */
    lg_stepper *steps;  /* stepper of the training scheme; NULL: there is none for this model */
    double *predicted;  /* (points, d): the scheme's run; the next three follow it in the same block */
    double *way, *gain; /* (points) each: S; H of the data minus H of the scheme's own run */
    double *error;      /* (2, d): errors of two neighbouring steps */
    course *courses;    /* (trajectories): one per different trajectory */
    size_t *different;  /* (trajectories): indices of different trajectories; the first `differ` are used */
    size_t differ;
    bool has_momentum; /* the model's symmetry conserves a momentum, and the data conserve it */
} measuring;

static double energy(const measuring *m, const double *state) {
    double value;
    lg_model_eval(m->model, state, &value, m->work);
    return value;
}

/* Integrates the model from `first` by the training scheme. Energy that this run gains is the scheme's error,
 * not a property of the data. Without a stepper, or on failure, all points are `first`. */
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

/* Measures all different trajectories. If there are three points or more, the first one is skipped: often it
 * alone has no noise, and noise raises the energies of the other points. */
static size_t follow_all(const measuring *m, course *out) {
    const size_t d = lg_model_inputs(m->model), points = m->problem->points, skipped = points > 2 ? 1 : 0;
    size_t count = 0;
    for (size_t i = 0; i < m->differ; i++) {
        out[count] = follow(m, m->problem->data + (m->different[i] * points + skipped) * d, points - skipped);
        count += isfinite(out[count].begin) && isfinite(out[count].x) && isfinite(out[count].y);
    }
    return count;
}

/* Computes the scale of each number of a state from the data. */
static void number_units(const lg_hamiltonian_problem *problem, double *unit) {
    lg_hamiltonian scaled = *problem->model;
    (void)lg_hamiltonian_find_scales(problem, &scaled.scales, NULL); /* failure keeps the model's scales */
    lg_hamiltonian_number_scales(&scaled, unit);
}

static void measuring_end(measuring *m) {
    lg_stepper_destroy(m->steps);
    lg_model_destroy(m->model);
    LG_FREE_ALL(m->context, m->work, m->predicted, m->courses, m->different);
}

static lg_status make_arrays(measuring *m) {
    const lg_context *context = m->context;
    const size_t d = lg_model_inputs(m->model), points = m->problem->points, all = m->problem->trajectories;
    LG_TRY(LG_ALLOC_ALL(context, {&m->work, 1, lg_model_work_size(m->model)},
                        LG_ARRAY(m->predicted, points * (d + 2) + 2 * d), LG_ARRAY(m->courses, all),
                        LG_ARRAY(m->different, all)));
    m->way = m->predicted + points * d, m->gain = m->way + points, m->error = m->gain + points;
    return LG_OK;
}

static lg_status measuring_begin(const lg_context *context, const lg_hamiltonian_problem *problem,
                                 const double *theta, measuring *m, lg_error *error) {
    *m = (measuring){.context = context, .problem = problem};
    LG_TRY(lg_hamiltonian_learned(context, problem->model, theta, &m->model, error));
    LG_TRY(make_arrays(m));
    LG_TRY(lg_hamiltonian_different(context, problem, m->different, &m->differ));
    number_units(problem, m->unit);
    lg_ode ode;
    if (lg_model_ode(m->model, &ode, &m->user, m->work) != LG_OK) return LG_OK;
    const lg_status status = lg_stepper_create(context, problem->scheme, &ode, &m->steps);
    return status == LG_OUT_OF_MEMORY ? lg_fail(error, status, "no memory for a stepper") : LG_OK;
}

/* Energy that the motion costs, relative to the training scheme's run; without `scheme`, to a constant. */
static cost measure(const measuring *m, bool scheme) {
    measuring with = *m;
    if (!scheme) with.steps = NULL;
    return find_cost(m->courses, follow_all(&with, m->courses));
}

/* Whether the cost is significant: more than chance, with a wider margin for few trajectories, and more than
 * a small part of the spread of the energies. */
static bool is_told(const cost *c) {
    static const double scatter = 4.5, few = 6.0, part = 5e-4;
    return c->count >= (size_t)few && fabs(c->change) > part * c->spread &&
           fabs(c->slope) > scatter * (1.0 + few / (double)c->count) * c->error;
}

/* Whether the loss fell by at most the factor `fall` over the last half of the epochs, without a peak at the
 * end. */
static bool has_settled(const lg_fit *fit, double fall) {
    static const double peak = 1.5;
    enum { FEWEST = 16 }; /* epochs to judge by */
    const double *history = lg_fit_history(fit, LG_FIT_LOSS);
    const size_t epochs = lg_fit_epochs_done(fit);
    if (epochs < FEWEST || !(history[epochs / 2] <= fall * history[epochs - 1])) return false;
    for (size_t i = epochs / 2; i < epochs; i++)
        if (history[epochs - 1] > peak * history[i]) return false;
    return true;
}

/* Whether training has converged: the minimiser ended by itself, or the loss fell clearly and now stays. */
static bool has_come_to_rest(const lg_fit *fit) {
    static const double still = 1.05, worked = 1.3;
    const double *history = lg_fit_history(fit, LG_FIT_LOSS);
    return lg_fit_why_finished(fit) == LG_FIT_END_MINIMISER ||
           (has_settled(fit, still) && history[0] >= worked * history[lg_fit_epochs_done(fit) - 1]);
}

/* Whether the fit is near the best that it can reach; before, the energy of the model changes along any data.
 * If the data lose most of their energy, a conservative model leaves most of the motion unexplained; then the
 * loss must have converged. */
static bool is_learned(const lg_fit *fit, const lg_hamiltonian_problem *problem, double loss) {
    static const double most = 0.3, slow = 1.5;
    const double left = loss / lg_hamiltonian_unchanged(problem);
    return (left <= most && has_settled(fit, slow)) || (left < 1.01 && has_come_to_rest(fit));
}

/* Correlation between the errors of neighbouring single steps, over all trajectories. It is nearly 1 if the
 * model lacks a force. White noise in the data gives about -1/2, because the noise of a point enters the
 * errors of both neighbouring steps with opposite signs; it gives 1/2 at most, if half a period lies between
 * two points. */
static double error_correlation(const measuring *m) {
    const lg_hamiltonian_problem *problem = m->problem;
    const size_t d = lg_model_inputs(m->model), points = problem->points;
    double *error = m->error, product = 0.0, square = 0.0;
    for (size_t i = 0; i < problem->trajectories; i++)
        for (size_t j = 0; j + 1 < points; j++) {
            const double *state = problem->data + (i * points + j) * d;
            double *now = error + j % 2 * d, *before = error + (j + 1) % 2 * d;
            run_scheme(m, state, 2);
            for (size_t k = 0; k < d; k++) {
                now[k] = (state[d + k] - m->predicted[d + k]) / m->unit[k];
                if (j == 0) continue;
                product += now[k] * before[k], square += (now[k] * now[k] + before[k] * before[k]) / 2.0;
            }
        }
    return product / fmax(square, DBL_MIN);
}

/* A symmetry that conserves no momentum, such as a mirror, cannot be tested by the data alone. So it is named
 * as a possible cause. */
static const char *symmetry_first(const measuring *m) {
    return m->problem->model->symmetry != LG_SYMMETRY_NONE && !m->has_momentum
               ? "the potential may not have the symmetry of --symmetry (none is without it), or "
               : "";
}

/* The energy of a conservative model does not change with motion, whatever the noise. A scheme with large
 * steps can change it; then the energy falls either relative to the run of the scheme or relative to a
 * constant, but not both. So both must agree. */
static bool warn_of_cost(const measuring *m) {
    const cost found = measure(m, false), beside = measure(m, true);
    if (!is_told(&found) || !is_told(&beside) || !(found.change * beside.change > 0.0)) return false;
    lg_log_message(m->context, LG_LOG_WARNING,
                   "%sthe data are not conservative: along a trajectory the learned energy %s by %.2g on "
                   "average (standard error %.1g; energies spread by %.2g), which cannot happen in a "
                   "Hamiltonian system; lg-identify learns damped and driven machines",
                   symmetry_first(m), found.change < 0 ? "falls" : "rises", fabs(found.change),
                   fabs(found.change * found.error / found.slope), found.spread);
    return true;
}

/* Even damped trajectories may have a Hamiltonian that is constant along them, if their starts lie on a curve
 * or have nearly equal energies. But its motion differs from the data by more than noise and the scheme's
 * error. */
static void warn_of_misfit(const measuring *m, double loss) {
    static const double small = 1e-3, alike = 0.5;
    enum { FEWEST = 4 }; /* points of a trajectory */
    const double left = loss / lg_hamiltonian_unchanged(m->problem);
    if (m->steps == NULL || m->problem->points < FEWEST || !(left > small)) return;
    const double correlation = error_correlation(m);
    if (correlation > alike)
        lg_log_message(
            m->context, LG_LOG_WARNING,
            "%sthe model does not explain the data: its error is %.2g %% of the motion (root mean "
            "square), and the errors of neighbouring steps are correlated (%.2f), as with a "
            "missing force, not as with noise; possible causes: damping, driving forces or a kinetic "
            "energy that this family does not have (lg-identify learns such machines), a network "
            "that is too small, a training that is too short, or steps that are too long "
            "(--substeps)",
            symmetry_first(m), 100.0 * sqrt(left), correlation);
}

lg_status lg_hamiltonian_warn_of_drift(const lg_context *context, const lg_hamiltonian_problem *problem,
                                       const lg_fit *fit, const double *theta, double loss, double floor,
                                       lg_error *error) {
    static const double slow = 2.0;
    const bool learned = is_learned(fit, problem, loss);
    const bool misfit = !lg_is_near_floor(loss, floor) && (has_settled(fit, slow) || has_come_to_rest(fit));
    LG_CLEAN(measuring_end) measuring m = {.context = context};
    lg_momentum_motion motion;
    if (!learned && !misfit) return LG_OK;
    LG_TRY(lg_hamiltonian_momentum_motion(context, problem, &motion));
    if (motion.moves) return LG_OK;
    LG_TRY(measuring_begin(context, problem, theta, &m, error));
    m.has_momentum = motion.size > 0.0;
    if (!(learned && warn_of_cost(&m)) && misfit) warn_of_misfit(&m, loss);
    return LG_OK;
}
