/* Starts of a chain in the plane of e1 and e3 (LG_STARTS_PLANE).
 *
 * The unknowns z are the nodes x_i and velocities v_i in R^2. With d_i = x_i - x_{i-1}, u_i = v_i - v_{i-1}
 * the constraints are f_i = |d_i|^2 - L_i^2 = 0 and f_{k+i} = 2 d_i.u_i = 0. A Newton step of least norm is
 * z -= J^T (J J^T)^-1 f, J = df/dz; no coordinate changes by more than half the root mean square of z. With
 * C_il = 2 - [i = 1] for i = l, -1 for |i - l| = 1 and 0 otherwise, D = (d_i) and U = (u_i),
 *   J J^T = 4 [C o DD^T, C o DU^T; C o UD^T, C o (DD^T + UU^T)].
 */
#include <math.h>

#include "kernels/matrix.h"
#include "mechanics/chain.h"

enum { LINKS = LG_PLANE_LINKS, NODES = 2 * LINKS, STEPS = 500, DRAWS = 100 };
static const double tolerance = 1e-13;

typedef struct plane_start {
    size_t k;
    const double *length;
    double x[NODES], v[NODES], d[NODES], u[NODES]; /* (k, 2) each */
    double f[NODES], a[NODES][NODES];
} plane_start;

static double dot2(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1];
}

/* out = each row of x (k, 2) minus the row before; the first row is copied. */
static void differences(size_t k, const double *x, double *out) {
    for (size_t i = 0; i < 2 * k; i++) out[i] = x[i] - (i < 2 ? 0.0 : x[i - 2]);
}

static void draw(plane_start *s, lg_rng *rng) {
    double x[2] = {0.0, 0.0}, v[2] = {0.0, 0.0};
    for (size_t i = 0; i < s->k; i++) {
        const double a = lg_rng_normal(rng), w = s->length[i] * lg_rng_normal(rng);
        x[0] += s->length[i] * sin(a), x[1] -= s->length[i] * cos(a);
        v[0] += w * cos(a), v[1] += w * sin(a);
        for (size_t c = 0; c < 2; c++) {
            s->x[2 * i + c] = x[c] + 0.2 * lg_rng_normal(rng);
            s->v[2 * i + c] = 3.0 * (0.5 * v[c] + 0.4 * lg_rng_normal(rng));
        }
    }
}

/* Computes d, u and f. Returns the root mean square of f. */
static double violation(plane_start *s) {
    const size_t k = s->k;
    double sum = 0.0;
    differences(k, s->x, s->d);
    differences(k, s->v, s->u);
    for (size_t i = 0; i < k; i++) {
        const double *d = s->d + 2 * i;
        s->f[i] = dot2(d, d) - s->length[i] * s->length[i];
        s->f[k + i] = 2.0 * dot2(d, s->u + 2 * i);
        sum += s->f[i] * s->f[i] + s->f[k + i] * s->f[k + i];
    }
    return sqrt(sum / (2.0 * (double)k));
}

static void normal_matrix(plane_start *s) {
    const size_t k = s->k;
    for (size_t i = 0; i < k; i++)
        for (size_t l = 0; l < k; l++) {
            const double c = i == l ? (i > 0 ? 8.0 : 4.0) : i + 1 == l || l + 1 == i ? -4.0 : 0.0;
            const double *d = s->d + 2 * i, *u = s->u + 2 * i, *e = s->d + 2 * l, *w = s->u + 2 * l;
            s->a[i][l] = c * dot2(d, e);
            s->a[i][k + l] = c * dot2(d, w);
            s->a[k + i][l] = c * dot2(u, e);
            s->a[k + i][k + l] = c * (dot2(d, e) + dot2(u, w));
        }
}

/* f <- (J J^T)^-1 f. False if the matrix is singular. */
static bool solve(plane_start *s) {
    size_t pivot[NODES];
    if (!lg_matrix_factor(2 * s->k, NODES, s->a[0], pivot)) return false;
    lg_matrix_solve(2 * s->k, NODES, s->a[0], pivot, 1, s->f);
    return true;
}

/* z -= J^T f, with the change of each coordinate bounded */
static void step(plane_start *s) {
    const size_t k = s->k;
    double square = 0.0;
    for (size_t i = 0; i < 2 * k; i++) square += s->x[i] * s->x[i] + s->v[i] * s->v[i];
    const double bound = 0.5 * sqrt(square / (4.0 * (double)k));
    for (size_t i = 0; i < 2 * k; i++) {
        const size_t link = i / 2;
        double dx = s->d[i] * s->f[link] + s->u[i] * s->f[k + link], dv = s->d[i] * s->f[k + link];
        if (link + 1 < k) {
            dx -= s->d[i + 2] * s->f[link + 1] + s->u[i + 2] * s->f[k + link + 1];
            dv -= s->d[i + 2] * s->f[k + link + 1];
        }
        s->x[i] -= fmax(-bound, fmin(bound, 2.0 * dx));
        s->v[i] -= fmax(-bound, fmin(bound, 2.0 * dv));
    }
}

static bool project(plane_start *s) {
    for (int i = 0; i < STEPS; i++) {
        if (violation(s) <= tolerance) return true;
        normal_matrix(s);
        if (!solve(s)) return false;
        step(s);
    }
    return false;
}

/* q_i = d_i/|d_i|; v_i is u_i/L_i minus its part along q_i. */
static void put(const plane_start *s, double *y, double *v) {
    for (size_t i = 0; i < s->k; i++) {
        const double *d = s->d + 2 * i, *u = s->u + 2 * i, norm = sqrt(dot2(d, d));
        const double q[2] = {d[0] / norm, d[1] / norm}, along = dot2(q, u);
        for (size_t c = 0; c < 3; c++) y[6 * i + c] = c == 1 ? 0.0 : q[c / 2];
        for (size_t c = 0; c < 3; c++)
            v[3 * i + c] = c == 1 ? 0.0 : (u[c / 2] - along * q[c / 2]) / s->length[i];
    }
}

lg_status lg_chain_plane_start(const lg_chain *chain, lg_rng *rng, double *y, double *v) {
    plane_start s = {.k = chain->links, .length = chain->length};
    if (chain->links > LINKS) return LG_UNSUPPORTED;
    for (int i = 0; i < DRAWS; i++) {
        draw(&s, rng);
        if (!project(&s)) continue;
        put(&s, y, v);
        return LG_OK;
    }
    return LG_NO_CONVERGENCE;
}
