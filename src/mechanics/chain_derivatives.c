/* The adjoint of the Lagrangian chain's field (see lg_system_ode), written by hand. For one row of the batch
 * the field is computed as follows:
 *
 *   T lambda = b,  T_ii = s_i + s_{i-1},  T_{i,i+1} = e_i = -s_i q_i.q_{i+1},  s_i = 1/m_i
 *   b_i = L_i |omega_i|^2 - [i = 1] g q_1z
 *   c_i = lambda_i q_i,  a_i = s_i (c_{i+1} - c_i),  x_i = q_i'' = (a_i - a_{i-1} - [i = 1] g e3)/L_i
 *   v_i = q_i (q_i.x_i) - x_i
 */
#include "mechanics/chain_derivatives.h"

#include <string.h>

#include "liegrad/geometry.h"

/* One row of the batch, in doubles. Names as in the equations above. */
typedef struct row {
    size_t k;
    double gravity, *mass, *length; /* mass and length point into `parameters` */
    double *parameters;
    double *q, *omega, *x;          /* (k, 3) */
    double *s, *lambda, *pivot, *l; /* k each; T = L D L^T with pivots D and l below the diagonal of L */
    double *rest;                   /* scratch for the derivatives */
} row;

enum { ROW_VECTORS = 3, ROW_SCALARS = 4, REST_VECTORS = 4, REST_SCALARS = 2, PARAMETER_COPIES = 2 };

static size_t parameters_of(size_t k) {
    return 1 + 2 * k;
}

size_t lg_chain_scratch(size_t k) {
    return PARAMETER_COPIES * parameters_of(k) + 3 * (ROW_VECTORS + REST_VECTORS) * k +
           (ROW_SCALARS + REST_SCALARS) * k;
}

/* The scratch memory is an input of the operation, so that the tape owns it. Writing to it is safe, as
 * nothing else reads its values. */
static double *scratch_of(const lg_chain_batch *batch) {
    return (double *)(uintptr_t)batch->scratch;
}

static row open_batch(const lg_chain_batch *batch, const void *const *in, size_t *rows) {
    double sizes[2];
    lg_get_numbers(batch->dtype, batch->sizes, 0, sizes, 2);
    *rows = (size_t)sizes[0];
    const size_t k = (size_t)sizes[1];
    double *at = scratch_of(batch);
    row r = {.k = k, .parameters = at};
    r.mass = at + 1;
    r.length = at + 1 + k;
    at += parameters_of(k);
    r.q = at, r.omega = at + 3 * k, r.x = at + 6 * k;
    at += 3 * ROW_VECTORS * k;
    r.s = at, r.lambda = at + k, r.pivot = at + 2 * k, r.l = at + 3 * k;
    r.rest = at + ROW_SCALARS * k;
    lg_get_numbers(batch->dtype, in[2], 0, r.parameters, parameters_of(k));
    r.gravity = r.parameters[0];
    for (size_t i = 0; i < k; i++) r.s[i] = 1.0 / r.mass[i];
    return r;
}

/* ---- the value ---- */

/* x = T^-1 b; x may be b. Pivots are not checked: off the manifold T need not be positive definite. */
static void solve(const row *r, const double *b, double *x) {
    const size_t k = r->k;
    x[0] = b[0];
    for (size_t i = 1; i < k; i++) x[i] = b[i] - r->l[i - 1] * x[i - 1];
    x[k - 1] /= r->pivot[k - 1];
    for (size_t i = k - 1; i-- > 0;) x[i] = x[i] / r->pivot[i] - r->l[i] * x[i + 1];
}

static void factor(const row *r) {
    double taken = 0.0;
    for (size_t i = 0; i < r->k; i++) {
        const double e = i + 1 < r->k ? -r->s[i] * lg_dot3(r->q + 3 * i, r->q + 3 * i + 3) : 0.0;
        r->pivot[i] = r->s[i] + (i > 0 ? r->s[i - 1] : 0.0) - taken;
        r->l[i] = e / r->pivot[i];
        taken = e * r->l[i];
    }
}

/* Component c of c_{i+1} - c_i. */
static double force(const row *r, size_t i, size_t c) {
    const double own = r->lambda[i] * r->q[3 * i + c];
    return (i + 1 < r->k ? r->lambda[i + 1] * r->q[3 * i + 3 + c] : 0.0) - own;
}

static void load(const lg_chain_batch *batch, const void *const *in, size_t number, const row *r) {
    const size_t n = 3 * r->k;
    lg_get_numbers(batch->dtype, in[0], number * n, r->q, n);
    lg_get_numbers(batch->dtype, in[1], number * n, r->omega, n);
    factor(r);
    for (size_t i = 0; i < r->k; i++)
        r->lambda[i] = r->length[i] * lg_dot3(r->omega + 3 * i, r->omega + 3 * i);
    r->lambda[0] -= r->gravity * r->q[2];
    solve(r, r->lambda, r->lambda);
    double above[3] = {0.0, 0.0, r->gravity};
    for (size_t i = 0; i < r->k; i++)
        for (size_t c = 0; c < 3; c++) {
            const double a = r->s[i] * force(r, i, c);
            r->x[3 * i + c] = (a - above[c]) / r->length[i];
            above[c] = a;
        }
}

void lg_chain_batch_value(const lg_chain_batch *batch, const void *const *in, void *v) {
    size_t rows;
    const row r = open_batch(batch, in, &rows);
    for (size_t number = 0; number < rows; number++) {
        load(batch, in, number, &r);
        for (size_t i = 0; i < r.k; i++) {
            const double along = lg_dot3(r.q + 3 * i, r.x + 3 * i);
            for (size_t c = 0; c < 3; c++) r.rest[3 * i + c] = r.q[3 * i + c] * along - r.x[3 * i + c];
        }
        lg_put_numbers(batch->dtype, v, 3 * r.k * number, r.rest, 3 * r.k);
    }
}

/* ---- the adjoint ---- */

typedef struct adjoint {
    /* (k, 3): cotangents of v (given), q and omega; `a` is first used for the cotangent of x, then of a. */
    double *g, *q, *omega, *a;
    double *s, *lambda; /* k; lambda is overwritten by y = T^-1 lambda_bar */
    double *parameters, *mass, *length;
} adjoint;

/* Sweeps from v back to a through v_i = q_i (q_i.x_i) - x_i and x_i = (a_i - a_{i-1} - [i = 1] g e3)/L_i. */
static void adjoint_of_acceleration(const row *r, const adjoint *d) {
    for (size_t i = 0; i < r->k; i++) {
        const double *q = r->q + 3 * i, *x = r->x + 3 * i, *g = d->g + 3 * i;
        const double along = lg_dot3(q, x), weight = lg_dot3(g, q), inverse = 1.0 / r->length[i];
        for (size_t c = 0; c < 3; c++) {
            d->q[3 * i + c] = g[c] * along + weight * x[c];
            d->a[3 * i + c] = (weight * q[c] - g[c]) * inverse;
        }
        d->length[i] -= lg_dot3(d->a + 3 * i, x);
    }
    d->parameters[0] -= d->a[2];
    for (size_t i = 0; i + 1 < r->k; i++)
        for (size_t c = 0; c < 3; c++) d->a[3 * i + c] -= d->a[3 * i + 3 + c];
}

/* Sweeps from a back to lambda through a_i = s_i (c_{i+1} - c_i) and c_i = lambda_i q_i. */
static void adjoint_of_forces(const row *r, const adjoint *d) {
    for (size_t i = 0; i < r->k; i++)
        for (size_t c = 0; c < 3; c++) {
            if (c == 0) d->s[i] = 0.0;
            d->s[i] += d->a[3 * i + c] * force(r, i, c);
            d->a[3 * i + c] *= r->s[i];
        }
    for (size_t i = 0; i < r->k; i++) {
        double sum = 0.0;
        for (size_t c = 0; c < 3; c++) {
            const double bar = (i > 0 ? d->a[3 * i - 3 + c] : 0.0) - d->a[3 * i + c];
            sum += bar * r->q[3 * i + c];
            d->q[3 * i + c] += r->lambda[i] * bar;
        }
        d->lambda[i] = sum;
    }
}

/* Sweeps from lambda back to T and b through T lambda = b: with y = T^-1 lambda_bar, b_bar = y and
 * T_bar = -y lambda^T. e_i stands in T twice, so its cotangent is the sum of both entries of T_bar. */
static void adjoint_of_solve(const row *r, const adjoint *d) {
    const double *y = d->lambda, *lambda = r->lambda;
    solve(r, d->lambda, d->lambda);
    for (size_t i = 0; i < r->k; i++) {
        const double *w = r->omega + 3 * i, *q = r->q + 3 * i, diagonal = -y[i] * lambda[i];
        d->length[i] += y[i] * lg_dot3(w, w);
        for (size_t c = 0; c < 3; c++) d->omega[3 * i + c] = 2.0 * r->length[i] * y[i] * w[c];
        d->s[i] += diagonal;
        if (i > 0) d->s[i - 1] += diagonal;
        if (i + 1 == r->k) break;
        const double e = -(y[i] * lambda[i + 1] + y[i + 1] * lambda[i]);
        d->s[i] -= e * lg_dot3(q, q + 3);
        for (size_t c = 0; c < 3; c++) {
            d->q[3 * i + c] -= e * r->s[i] * q[3 + c];
            d->q[3 * i + 3 + c] -= e * r->s[i] * q[c];
        }
    }
    d->parameters[0] -= y[0] * r->q[2];
    d->q[2] -= r->gravity * y[0];
}

void lg_chain_batch_adjoint(const lg_chain_batch *batch, const void *const *in, const void *g,
                            void *const *out) {
    size_t rows;
    const row r = open_batch(batch, in, &rows);
    const size_t k = r.k, n = 3 * k;
    adjoint d = {
        .g = r.rest, .q = r.rest + n, .omega = r.rest + 2 * n, .a = r.rest + 3 * n, .s = r.rest + 4 * n};
    d.lambda = d.s + k;
    d.parameters = d.lambda + k;
    d.mass = d.parameters + 1;
    d.length = d.mass + k;
    memset(d.parameters, 0, parameters_of(k) * sizeof(double));
    for (size_t number = 0; number < rows; number++) {
        load(batch, in, number, &r);
        lg_get_numbers(batch->dtype, g, number * n, d.g, n);
        adjoint_of_acceleration(&r, &d);
        adjoint_of_forces(&r, &d);
        adjoint_of_solve(&r, &d);
        for (size_t i = 0; i < k; i++) d.mass[i] -= d.s[i] * r.s[i] * r.s[i];
        if (out[0]) lg_put_numbers(batch->dtype, out[0], number * n, d.q, n);
        if (out[1]) lg_put_numbers(batch->dtype, out[1], number * n, d.omega, n);
    }
    if (out[2]) lg_put_numbers(batch->dtype, out[2], 0, d.parameters, parameters_of(k));
}
