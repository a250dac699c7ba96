/* CMA-ES. Formulas and names of constants are those of Hansen's tutorial. */
#include "certify/evolution.h"

#include <math.h>
#include <string.h>

#include "kernels/matrix.h"

lg_status lg_evolution_begin(const lg_context *context, size_t n, size_t members, const double *mean,
                             const double *spread, uint64_t seed, lg_evolution *out) {
    lg_evolution e = {.n = n, .members = members, .parents = members / 2, .sigma = 1};
    e.memory = lg_alloc(context, 3 * n + 2 * n * n + 2 * members * n + members, sizeof *e.memory);
    if (e.memory == NULL) return LG_OUT_OF_MEMORY;
    e.mean = e.memory;
    e.path_sigma = e.mean + n;
    e.path_C = e.path_sigma + n;
    e.C = e.path_C + n;
    e.A = e.C + n * n;
    e.y = e.A + n * n;
    e.x = e.y + members * n;
    e.weight = e.x + members * n;
    double sum = 0, squares = 0;
    for (size_t i = 0; i < e.parents; i++)
        sum += e.weight[i] = log((double)members / 2 + 0.5) - log((double)i + 1);
    for (size_t i = 0; i < e.parents; i++) squares += pow(e.weight[i] /= sum, 2);
    e.effective = 1 / squares;
    memcpy(e.mean, mean, n * sizeof *mean);
    for (size_t i = 0; i < n; i++) {
        e.C[i * (n + 1)] = spread[i] * spread[i];
        e.A[i * (n + 1)] = spread[i];
    }
    lg_rng_seed(&e.rng, seed, 11);
    *out = e;
    return LG_OK;
}

void lg_evolution_end(const lg_context *context, lg_evolution *e) {
    lg_free(context, e->memory);
}

void lg_evolution_ask(lg_evolution *e) {
    const size_t n = e->n;
    for (size_t k = 0; k < e->members; k++) {
        double *y = e->y + k * n, *x = e->x + k * n;
        for (size_t i = 0; i < n; i++) y[i] = lg_rng_normal(&e->rng);
        for (size_t i = 0; i < n; i++) {
            double sum = 0;
            for (size_t j = 0; j <= i; j++) sum += e->A[i * n + j] * y[j];
            x[i] = e->mean[i] + e->sigma * sum;
        }
    }
}

/* rank[i] is the place of the i-th best value; equal values keep their order. */
static void best_first(size_t members, const double *values, size_t *rank) {
    for (size_t k = 0; k < members; k++) {
        size_t i = k;
        for (; i > 0 && (values[k] > values[rank[i - 1]] || isnan(values[rank[i - 1]])); i--)
            rank[i] = rank[i - 1];
        rank[i] = k;
    }
}

enum { MOST_MEMBERS = 64 };

/* Moves the mean to the weighted mean of the better half; returns the square of the length of the path of
 * sigma. */
static double move_mean(lg_evolution *e, const size_t *rank) {
    const size_t n = e->n;
    const double c = (e->effective + 2) / ((double)n + e->effective + 5);
    double length = 0;
    for (size_t i = 0; i < n; i++) {
        double mean = 0, step = 0;
        for (size_t k = 0; k < e->parents; k++) {
            mean += e->weight[k] * e->x[rank[k] * n + i];
            step += e->weight[k] * e->y[rank[k] * n + i];
        }
        e->path_sigma[i] = (1 - c) * e->path_sigma[i] + sqrt(c * (2 - c) * e->effective) * step;
        length += e->path_sigma[i] * e->path_sigma[i];
        e->y[rank[0] * n + i] = mean; /* the new mean, until the old one has served */
    }
    return length;
}

static void adapt(lg_evolution *e, const size_t *rank, bool steady) {
    const size_t n = e->n;
    const double size = (double)n, mu = e->effective, cc = (4 + mu / size) / (size + 4 + 2 * mu / size),
                 c1 = 2 / ((size + 1.3) * (size + 1.3) + mu),
                 cmu = fmin(1 - c1, 2 * (mu - 2 + 1 / mu) / ((size + 2) * (size + 2) + mu));
    const double *mean = e->y + rank[0] * n;
    for (size_t i = 0; i < n; i++)
        e->path_C[i] =
            (1 - cc) * e->path_C[i] + steady * sqrt(cc * (2 - cc) * mu) * (mean[i] - e->mean[i]) / e->sigma;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            double sum = 0;
            for (size_t k = 0; k < e->parents; k++) {
                const double *x = e->x + rank[k] * n;
                sum += e->weight[k] * (x[i] - e->mean[i]) * (x[j] - e->mean[j]);
            }
            double *C = e->C + i * n + j;
            const double keep = 1 - c1 - cmu + (steady ? 0 : c1 * cc * (2 - cc));
            *C = keep * *C + c1 * e->path_C[i] * e->path_C[j] + cmu * sum / (e->sigma * e->sigma);
        }
    memcpy(e->mean, mean, n * sizeof *mean);
}

void lg_evolution_tell(lg_evolution *e, const double *values) {
    size_t rank[MOST_MEMBERS];
    const double n = (double)e->n, mu = e->effective, c = (mu + 2) / (n + mu + 5);
    const double damping = 1 + 2 * fmax(0, sqrt((mu - 1) / (n + 1)) - 1) + c;
    const double expected = sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n));
    best_first(e->members, values, rank);
    const double length = sqrt(move_mean(e, rank));
    e->generation++;
    const double grown = sqrt(1 - pow(1 - c, 2 * e->generation));
    adapt(e, rank, length / grown < (1.4 + 2 / (n + 1)) * expected);
    e->sigma *= exp(c / damping * (length / expected - 1));
    if (!lg_matrix_cholesky(e->n, e->C, e->A)) memset(e->A, 0, e->n * e->n * sizeof *e->A);
}
