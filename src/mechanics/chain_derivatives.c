/* The adjoint of the Lagrangian chain's field (see lg_system_ode), written by hand. With W as in
 * mechanics/chain.h and r = g/L_1, the field of one row of the batch is computed as follows:
 *
 *   T lambda = b,  T_ii = W_ii,  T_{i,i+1} = W_{i,i+1} q_i.q_{i+1},  b_i = |omega_i|^2 - [i = 1] r q_1z
 *   x_i = q_i'' = -[i = 1] r e3 - sum_j W_ij lambda_j q_j,  v_i = q_i (q_i.x_i) - x_i
 */
#include "mechanics/chain_derivatives.h"

#include <string.h>

#include "liegrad/geometry.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/chain.inc"

/* One row of the batch, in doubles. Names as in the equations above. */
typedef struct row {
    lg_chain chain;
    size_t k;
    double rate, *parameters;
    double *q, *omega, *pull, *x; /* (k, 3); pull_i = lambda_i q_i */
    double *lambda, *pivot, *l;   /* k each; T = L D L^T with pivots D and l below the diagonal of L */
    double *rest;                 /* scratch for the derivatives */
} row;

enum { ROW = 4 * 3 + 3, REST = 4 * 3 + 4 }; /* numbers per link */

static size_t parameters_of(size_t k) {
    return 1 + 2 * k;
}

size_t lg_chain_scratch(size_t k) {
    return 2 * parameters_of(k) + (CHAIN_CONSTANTS + ROW + REST) * k;
}

/* The scratch memory is an input of the operation, so that the tape owns it. Writing to it is safe, as
 * nothing else reads its values. */
static row open_batch(const lg_chain_batch *batch, const void *const *in, size_t *rows) {
    double sizes[2];
    lg_get_numbers(batch->dtype, batch->sizes, 0, sizes, 2);
    *rows = (size_t)sizes[0];
    const size_t k = (size_t)sizes[1];
    double *parameters = (double *)(uintptr_t)batch->scratch, *at = parameters + parameters_of(k);
    lg_get_numbers(batch->dtype, in[2], 0, parameters, parameters_of(k));
    row r = {.chain = chain_view(k, parameters, at), .k = k, .parameters = parameters};
    at += CHAIN_CONSTANTS * k;
    r.q = at, r.omega = at + 3 * k, r.pull = at + 6 * k, r.x = at + 9 * k;
    r.lambda = at + 12 * k, r.pivot = at + 13 * k, r.l = at + 14 * k;
    r.rest = at + ROW * k;
    lg_chain_constants(&r.chain);
    r.rate = r.chain.gravity * r.chain.curvature[0];
    return r;
}

static void load(const lg_chain_batch *batch, const void *const *in, size_t b, const row *r) {
    const size_t k = r->k, n = 3 * k;
    lg_get_numbers(batch->dtype, in[0], b * n, r->q, n);
    lg_get_numbers(batch->dtype, in[1], b * n, r->omega, n);
    for (size_t i = 0; i < k; i++) {
        r->pivot[i] = r->chain.w[i];
        r->l[i] = i + 1 < k ? r->chain.w_next[i] * lg_dot3(r->q + 3 * i, r->q + 3 * i + 3) : 0.0;
        r->lambda[i] = lg_dot3(r->omega + 3 * i, r->omega + 3 * i);
    }
    r->lambda[0] -= r->rate * r->q[2];
    tridiagonal_factor_of(k, false, r->pivot, r->l); /* as the field: off the manifold T may be indefinite */
    tridiagonal_solve_of(k, r->pivot, r->l, r->lambda, r->lambda);
    for (size_t i = 0; i < n; i++) r->pull[i] = r->lambda[i / 3] * r->q[i];
    apply_w_of(&r->chain, r->pull, 3, r->x);
    for (size_t i = 0; i < n; i++) r->x[i] = -r->x[i];
    r->x[2] -= r->rate;
}

void lg_chain_batch_value(const lg_chain_batch *batch, const void *const *in, void *v) {
    size_t rows;
    const row r = open_batch(batch, in, &rows);
    for (size_t b = 0; b < rows; b++) {
        load(batch, in, b, &r);
        for (size_t i = 0; i < r.k; i++) {
            const double along = lg_dot3(r.q + 3 * i, r.x + 3 * i);
            for (size_t c = 0; c < 3; c++) r.rest[3 * i + c] = r.q[3 * i + c] * along - r.x[3 * i + c];
        }
        lg_put_numbers(batch->dtype, v, 3 * r.k * b, r.rest, 3 * r.k);
    }
}

/* ---- the adjoint ---- */

/* Cotangents: of v (given), q and x, (k, 3); of omega where W x was; of lambda, then of b, (k); summed over
 * all rows: of W, 1/m, r and the parameters. */
typedef struct adjoint {
    double *g, *q, *x, *omega;
    double *b, *w, *w_next, *light;
    double rate, *parameters;
} adjoint;

/* Sweeps from v back to x, and from x to lambda, q and W. */
static void adjoint_of_acceleration(const row *r, adjoint *d) {
    const double *lambda = r->lambda;
    double *wx = d->omega;
    for (size_t i = 0; i < r->k; i++) {
        const double *q = r->q + 3 * i, *x = r->x + 3 * i, *g = d->g + 3 * i;
        const double along = lg_dot3(q, x), weight = lg_dot3(g, q);
        for (size_t c = 0; c < 3; c++) {
            d->q[3 * i + c] = g[c] * along + weight * x[c];
            d->x[3 * i + c] = weight * q[c] - g[c];
        }
    }
    d->rate -= d->x[2];
    apply_w_of(&r->chain, d->x, 3, wx);
    for (size_t i = 0; i < r->k; i++) {
        const double *x = d->x + 3 * i, *pull = r->pull + 3 * i;
        d->b[i] = -lg_dot3(r->q + 3 * i, wx + 3 * i);
        for (size_t c = 0; c < 3; c++) d->q[3 * i + c] -= lambda[i] * wx[3 * i + c];
        d->w[i] -= lg_dot3(x, pull);
        if (i + 1 < r->k) d->w_next[i] -= lg_dot3(x, pull + 3) + lg_dot3(x + 3, pull);
    }
}

/* Sweeps from lambda back to T and b through T lambda = b: with y = T^-1 lambda_bar, b_bar = y and
 * T_bar = -y lambda^T. T_{i,i+1} stands in T twice, so its cotangent is the sum of both entries of T_bar. */
static void adjoint_of_solve(const row *r, adjoint *d) {
    const double *lambda = r->lambda, *y = d->b;
    tridiagonal_solve_of(r->k, r->pivot, r->l, d->b, d->b);
    for (size_t i = 0; i < r->k; i++) {
        const double *q = r->q + 3 * i;
        for (size_t c = 0; c < 3; c++) d->omega[3 * i + c] = 2.0 * y[i] * r->omega[3 * i + c];
        d->w[i] -= y[i] * lambda[i];
        if (i + 1 == r->k) break;
        const double next = -(y[i] * lambda[i + 1] + y[i + 1] * lambda[i]), e = next * r->chain.w_next[i];
        d->w_next[i] += next * lg_dot3(q, q + 3);
        for (size_t c = 0; c < 3; c++) {
            d->q[3 * i + c] += e * q[3 + c];
            d->q[3 * i + 3 + c] += e * q[c];
        }
    }
    d->rate -= y[0] * r->q[2];
    d->q[2] -= r->rate * y[0];
}

/* Sweeps from W and r back to g, m and L. */
static void adjoint_of_parameters(const row *r, adjoint *d) {
    const lg_chain *c = &r->chain;
    double *mass = d->parameters + 1, *length = mass + r->k;
    memset(d->light, 0, r->k * sizeof(double));
    for (size_t i = 0; i < r->k; i++) {
        const double inverse = c->curvature[i], w = d->w[i] * inverse * inverse;
        d->light[i] += w;
        if (i > 0) d->light[i - 1] += w;
        length[i] -= 2.0 * d->w[i] * c->w[i] * inverse;
        if (i + 1 == r->k) break;
        const double next = d->w_next[i] * c->w_next[i];
        d->light[i] -= d->w_next[i] * inverse * c->curvature[i + 1];
        length[i] -= next * inverse;
        length[i + 1] -= next * c->curvature[i + 1];
    }
    d->parameters[0] = d->rate * c->curvature[0];
    length[0] -= d->rate * r->rate * c->curvature[0];
    for (size_t i = 0; i < r->k; i++) mass[i] = -d->light[i] * c->light[i] * c->light[i];
}

void lg_chain_batch_adjoint(const lg_chain_batch *batch, const void *const *in, const void *g,
                            void *const *out) {
    size_t rows;
    const row r = open_batch(batch, in, &rows);
    const size_t k = r.k, n = 3 * k;
    adjoint d = {
        .g = r.rest, .q = r.rest + n, .x = r.rest + 2 * n, .omega = r.rest + 3 * n, .b = r.rest + 4 * n};
    d.w = d.b + k, d.w_next = d.w + k, d.light = d.w_next + k, d.parameters = d.light + k;
    memset(d.w, 0, (3 * k + parameters_of(k)) * sizeof(double));
    for (size_t b = 0; b < rows; b++) {
        load(batch, in, b, &r);
        lg_get_numbers(batch->dtype, g, b * n, d.g, n);
        adjoint_of_acceleration(&r, &d);
        adjoint_of_solve(&r, &d);
        if (out[0]) lg_put_numbers(batch->dtype, out[0], b * n, d.q, n);
        if (out[1]) lg_put_numbers(batch->dtype, out[1], b * n, d.omega, n);
    }
    if (!out[2]) return;
    adjoint_of_parameters(&r, &d);
    lg_put_numbers(batch->dtype, out[2], 0, d.parameters, parameters_of(k));
}
