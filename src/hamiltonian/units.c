/* Learned Hamiltonians: scales and weights that are computed from the trajectories. */
#include <float.h>
#include <math.h>

#include "hamiltonian/internal.h"

/* Root mean squares per part, over all trajectories. The squares of the numbers of one copy are added. */
typedef struct motion {
    size_t parts;
    /* root mean square about 0 (size) and about the mean (spread) */
    double size[LG_HAMILTONIAN_MAX_PARTS], spread[LG_HAMILTONIAN_MAX_PARTS];
    /* of the change per unit of time */
    double rate[LG_HAMILTONIAN_MAX_PARTS];
    double change[LG_HAMILTONIAN_MAX_PARTS]; /* of the change from the first point to the others */
} motion;

/* A change below `rounding` times the size is a rounding error. When weights are computed, a part changes by
 * at least least_change times what the other part changes by. */
static const double rounding = 64 * DBL_EPSILON, least_change = 1e-6;

typedef struct walk {
    const lg_hamiltonian_problem *problem;
    size_t d;
    uint8_t part[LG_HAMILTONIAN_LARGEST];
    /* a power of 2 near the largest number of the part, so that squares do not overflow */
    double unit[LG_HAMILTONIAN_MAX_PARTS];
} walk;

static const double *point(const walk *w, size_t trajectory, size_t j) {
    return w->problem->data + (trajectory * w->problem->points + j) * w->d;
}

static void find_units(walk *w) {
    const size_t count = w->problem->trajectories * w->problem->points;
    double most[LG_HAMILTONIAN_MAX_PARTS] = {0.0};
    for (size_t k = 0; k < count; k++)
        for (size_t c = 0; c < w->d; c++) most[w->part[c]] = fmax(most[w->part[c]], fabs(point(w, 0, k)[c]));
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++) {
        int exponent = 0;
        (void)frexp(most[i], &exponent);
        w->unit[i] = ldexp(1.0, exponent < -1000 ? -1000 : exponent);
    }
}

/* Adds (x - y)^2 of each number to the sum of its part. */
static void add_squares(const walk *w, const double *x, const double *y, double *sum) {
    for (size_t c = 0; c < w->d; c++) {
        const double gap = (x[c] - y[c]) / w->unit[w->part[c]];
        sum[w->part[c]] += gap * gap;
    }
}

/* Replaces the sum of each part by the root of its mean over `points` points and the n copies. */
static void take_roots(const walk *w, size_t points, double *sum) {
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        sum[i] = w->unit[i] * sqrt(sum[i] / ((double)points * w->problem->model->n));
}

static void measure_sizes(const walk *w, motion *out) {
    const lg_hamiltonian_problem *problem = w->problem;
    const size_t count = problem->trajectories * problem->points;
    const double zero[LG_HAMILTONIAN_LARGEST] = {0.0};
    double mean[LG_HAMILTONIAN_LARGEST] = {0.0};
    for (size_t k = 0; k < count; k++)
        for (size_t c = 0; c < w->d; c++) mean[c] += point(w, 0, k)[c] / (double)count;
    for (size_t k = 0; k < count; k++) {
        add_squares(w, point(w, 0, k), zero, out->size);
        add_squares(w, point(w, 0, k), mean, out->spread);
        add_squares(w, point(w, 0, k), point(w, k / problem->points, 0), out->change);
    }
    take_roots(w, count, out->size);
    take_roots(w, count, out->spread);
    take_roots(w, problem->trajectories * (problem->points - 1), out->change);
}

/* Measures the changes over a lag of so many points that one part changes by more than half its spread, at
 * most over a whole trajectory. At a long lag noise counts less than between neighbouring points. */
static void measure_rates(const walk *w, motion *out) {
    const lg_hamiltonian_problem *problem = w->problem;
    const size_t last = problem->points - 1;
    bool far = false;
    for (size_t lag = 1; !far; lag = 2 * lag < last ? 2 * lag : last) {
        double sum[LG_HAMILTONIAN_MAX_PARTS] = {0.0};
        for (size_t i = 0; i < problem->trajectories; i++)
            for (size_t j = lag; j <= last; j++) add_squares(w, point(w, i, j), point(w, i, j - lag), sum);
        take_roots(w, problem->trajectories * (last - lag + 1), sum);
        far = lag == last;
        for (size_t p = 0; p < out->parts; p++) {
            out->rate[p] = sum[p] / (problem->dt * (double)lag);
            far = far || sum[p] > 0.5 * out->spread[p];
        }
    }
}

static lg_status measure(const lg_hamiltonian_problem *problem, walk *w, motion *out, lg_error *error) {
    lg_space space;
    *out = (motion){.parts = 0};
    if (problem->model == NULL || problem->data == NULL || problem->trajectories == 0 ||
        problem->points < 2 || !(problem->dt > 0.0))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the problem has no model, no data, fewer than two points, or a dt that is not positive");
    LG_TRY(lg_hamiltonian_space(problem->model->family, problem->model->n, &space));
    w->problem = problem;
    w->d = space.dim;
    lg_taped_number_parts(&space, w->part);
    out->parts = lg_taped_parts(&space);
    find_units(w);
    measure_sizes(w, out);
    measure_rates(w, out);
    return LG_OK;
}

/* Time in which a part changes by its spread: geometric mean over the parts that change; 0 if none does. */
static double time_of(const motion *m) {
    double product = 1.0;
    size_t count = 0;
    for (size_t i = 0; i < m->parts; i++) {
        if (!(m->change[i] > rounding * m->size[i])) continue;
        product *= m->spread[i] / m->rate[i];
        count++;
    }
    return count == 0   ? 0.0
           : count == 1 ? product
           : count == 2 ? sqrt(product)
                        : pow(product, 1.0 / (double)count);
}

static bool is_scale(double x) {
    return x > 0.0 && x <= DBL_MAX && 1.0 / x <= DBL_MAX;
}

/* The scales of the pairs after the first one, in which each action is a = s_1 s_2: of positions without a
 * unit 1 and a; of others s and a/s, where s is such that with mass 1 they move as fast as in the data. */
static void scale_other_pairs(const lg_hamiltonian_family *family, const motion *m,
                              lg_hamiltonian_scales *out) {
    const double action = out->part[0] * out->part[1];
    for (size_t i = 2; i < m->parts; i += 2) {
        const double square = action * out->time * m->rate[i] / m->size[i + 1];
        const bool moves = m->change[i] > rounding * m->size[i] && square > 0.0;
        if (family->scaled[i]) out->part[i] = moves ? sqrt(square) : m->size[i] > 0.0 ? m->size[i] : 1.0;
        out->part[i + 1] = action / out->part[i];
    }
}

lg_status lg_hamiltonian_find_scales(const lg_hamiltonian_problem *problem, lg_hamiltonian_scales *out,
                                     lg_error *error) {
    LG_NEEDS(error, problem, out);
    walk w;
    motion m;
    LG_TRY(measure(problem, &w, &m, error));
    const lg_hamiltonian_family *family = problem->model->family;
    const bool *scaled = family->scaled;
    const double time = time_of(&m);
    lg_hamiltonian_scales made = LG_HAMILTONIAN_NO_SCALES;
    made.time = time > 0.0 ? time : problem->dt * (double)(problem->points - 1);
    for (size_t i = 0; i < 2; i++)
        if (scaled[i] && m.size[i] > 0.0) made.part[i] = m.size[i];
    /* The second part is a momentum; its scale is such that with mass 1, q moves as fast as in the data. */
    const double mass = m.size[1] / (m.rate[0] * made.time);
    if (scaled[1] && m.change[0] > rounding * m.size[0] && mass > 0.0) made.part[1] = made.part[0] * mass;
    if (family->many > 0 && problem->model->n >= family->many && scaled[1]) {
        made.time *= family->stretch;
        made.part[1] /= family->stretch;
    }
    bool fit = is_scale(made.time) && is_scale(made.part[0] * made.part[1] / made.time);
    scale_other_pairs(family, &m, &made);
    for (size_t i = 0; i < m.parts; i++) fit = fit && is_scale(made.part[i]);
    if (!fit)
        return lg_fail(error, LG_NOT_FINITE,
                       "the numbers of the data are too large or too small to be scaled");
    *out = made;
    return LG_OK;
}

bool lg_hamiltonian_moves(const lg_hamiltonian_problem *problem) {
    walk w;
    motion m;
    return measure(problem, &w, &m, NULL) == LG_OK && time_of(&m) > 0.0;
}

lg_status lg_hamiltonian_weigh(lg_hamiltonian_problem *problem, lg_error *error) {
    LG_NEEDS(error, problem);
    walk w;
    motion m;
    double most = 0.0;
    LG_TRY(measure(problem, &w, &m, error));
    for (size_t i = 0; i < m.parts; i++) {
        m.change[i] /= problem->model->scales.part[i];
        most = fmax(most, m.change[i]);
    }
    for (size_t i = 0; i < m.parts; i++) {
        const double change = fmax(m.change[i], least_change * most);
        problem->weight[i] = most > 0.0 ? 1.0 / (change * change) : 1.0;
    }
    return LG_OK;
}
