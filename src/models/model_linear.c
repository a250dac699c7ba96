/* Linearisation of a learned Hamiltonian's field, in coordinates of the tangent space of (T*S^2)^k or R^2n.
 *
 * The field of a chain at y is the ambient vector a . y of an algebra element a, bilinear in both: its
 * derivative along dy is da . y + a . dy, where da is the derivative of the learned algebra element (an input
 * does not change with the state) and a contains the input.
 */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/geometry.h"
#include "models/hamiltonian_internal.h"
#include "models/model_internal.h"

static bool is_chain(const lg_hamiltonian *model) {
    return model->family == LG_HAMILTONIAN_CHAIN;
}

static size_t tangent_size(const lg_hamiltonian *model) {
    return (size_t)model->links * (is_chain(model) ? 4 : 2);
}

size_t lg_model_tangent_size(const lg_model *model) {
    return lg_model_is_hamiltonian(model) ? tangent_size(&model->hamiltonian) : 0;
}

/* The caller's memory; each array has as many numbers as a state. */
typedef struct linear_parts {
    double *frame; /* (k, 2, 3): e_1, e_2 */
    double *gradient, *dgradient;
    double *dy, *velocity; /* a direction, and the derivative of the field along it */
    double *field;         /* algebra elements, with the input */
    void *hessian;
} linear_parts;

static linear_parts parts_of(const lg_hamiltonian *model, void *work, size_t *bytes) {
    const size_t one = ((size_t)lg_hamiltonian_state_size(model) + 7) / 8 * 8;
    double *base = work;
    *bytes = 6 * one * sizeof(double) + lg_hamiltonian_hessian_work_size(model);
    if (base == NULL) return (linear_parts){.frame = NULL};
    return (linear_parts){base,           base + one,     base + 2 * one, base + 3 * one,
                          base + 4 * one, base + 5 * one, base + 6 * one};
}

size_t lg_model_linear_work_size(const lg_hamiltonian *model) {
    size_t bytes;
    (void)parts_of(model, NULL, &bytes);
    return bytes;
}

/* ---- coordinates ---- */

/* e_1: the coordinate axis least along q (the first of equals), made orthogonal to it; e_2 = q x e_1. */
static void frame_at(const double *q, double *e1, double *e2) {
    size_t least = 0;
    for (size_t c = 1; c < 3; c++)
        if (fabs(q[c]) < fabs(q[least])) least = c;
    for (size_t c = 0; c < 3; c++) e1[c] = (c == least ? 1.0 : 0.0) - q[least] * q[c];
    const double length = sqrt(lg_dot3(e1, e1));
    for (size_t c = 0; c < 3; c++) e1[c] /= length;
    lg_cross3(q, e1, e2);
}

/* dy = the tangent vector of coordinate number j: a_1, a_2, b_1, b_2 of each link, or (dq, dp). */
static void direction(const lg_hamiltonian *model, const double *frame, const double *y, size_t j,
                      double *dy) {
    memset(dy, 0, lg_hamiltonian_state_size(model) * sizeof *dy);
    if (!is_chain(model)) {
        dy[j] = 1.0;
        return;
    }
    const double *e = frame + 6 * (j / 4) + 3 * (j % 2), *q = y + 6 * (j / 4);
    double *dq = dy + 6 * (j / 4), *dp = dq + 3;
    const bool turns = j % 4 < 2;
    const double along = turns ? lg_dot3(e, q + 3) : 0.0;
    for (size_t c = 0; c < 3; c++) {
        dq[c] = turns ? e[c] : 0.0;
        dp[c] = turns ? -q[c] * along : e[c];
    }
}

/* Coordinates of an ambient vector, each `stride` numbers from the one before. */
static void coordinates(const lg_hamiltonian *model, const double *frame, const double *vector, size_t stride,
                        double *c) {
    const size_t r = tangent_size(model);
    for (size_t j = 0; j < r; j++)
        c[j * stride] = is_chain(model) ? lg_dot3(frame + 6 * (j / 4) + 3 * (j % 2),
                                                  vector + 6 * (j / 4) + 3 * (j % 4 / 2))
                                        : vector[j];
}

/* ---- derivatives of the field ---- */

/* dH and its derivative along dy, link by link: xi = q x v, eta = g x q + v x p [+ tau]. */
static void chain_velocity(const lg_hamiltonian *model, const double *y, const linear_parts *w) {
    for (size_t i = 0; i < 6 * (size_t)model->links; i += 6) {
        const double *q = y + i, *p = q + 3, *dq = w->dy + i, *dp = dq + 3;
        const double *g = w->gradient + i, *v = g + 3, *dg = w->dgradient + i, *dv = dg + 3;
        double a[6], part[6];
        lg_cross3(dq, v, a);
        lg_cross3(q, dv, part);
        for (size_t c = 0; c < 3; c++) a[c] += part[c];
        lg_cross3(dg, q, a + 3);
        lg_cross3(g, dq, part);
        for (size_t c = 0; c < 3; c++) a[3 + c] += part[c];
        lg_cross3(dv, p, part);
        lg_cross3(v, dp, part + 3);
        for (size_t c = 0; c < 3; c++) a[3 + c] += part[c] + part[3 + c];
        lg_se3_generator(a, q, w->velocity + i);
        lg_se3_generator(w->field + i, dq, part);
        for (size_t c = 0; c < 6; c++) w->velocity[i + c] += part[c];
    }
}

static void separable_velocity(const lg_hamiltonian *model, const linear_parts *w) {
    const size_t n = model->links;
    for (size_t i = 0; i < n; i++) {
        w->velocity[i] = w->dgradient[n + i];
        w->velocity[n + i] = -w->dgradient[i];
    }
}

/* Column j of A: the derivative of the field along coordinate j. */
static void fill_A(const lg_model *model, const double *y, const linear_parts *w, double *A) {
    const lg_hamiltonian *h = &model->hamiltonian;
    const size_t r = tangent_size(h);
    for (size_t j = 0; j < r; j++) {
        direction(h, w->frame, y, j, w->dy);
        lg_hamiltonian_gradient_jvp(h, model->theta, y, w->dy, w->gradient, w->dgradient, w->hessian);
        if (is_chain(h))
            chain_velocity(h, y, w);
        else
            separable_velocity(h, w);
        coordinates(h, w->frame, w->velocity, r, A + j);
    }
}

/* Of an input: p_i' = tau_i x q_i, hence b_1' = tau.(q x e_1) = tau.e_2, b_2' = -tau.e_1; or p' = u. */
static void fill_B(const lg_model *model, const linear_parts *w, double *B) {
    const lg_hamiltonian *h = &model->hamiltonian;
    const size_t r = tangent_size(h), m = lg_model_input_size(model), k = h->links;
    memset(B, 0, r * m * sizeof *B);
    for (size_t i = 0; i < k; i++) {
        if (!is_chain(h)) {
            B[(k + i) * m + i] = 1.0;
            continue;
        }
        for (size_t c = 0; c < 3; c++) {
            B[(4 * i + 2) * m + 3 * i + c] = w->frame[6 * i + 3 + c];
            B[(4 * i + 3) * m + 3 * i + c] = -w->frame[6 * i + c];
        }
    }
}

static void fill_basis(const lg_hamiltonian *h, const double *y, const linear_parts *w, double *basis) {
    const size_t r = tangent_size(h), d = lg_hamiltonian_state_size(h);
    for (size_t j = 0; j < r; j++) {
        direction(h, w->frame, y, j, w->dy);
        for (size_t i = 0; i < d; i++) basis[i * r + j] = w->dy[i];
    }
}

lg_status lg_model_linearise(const lg_model *model, const double *state, const double *input, double *A,
                             double *B, double *basis, void *work) {
    if (!lg_model_is_hamiltonian(model)) return LG_UNSUPPORTED;
    const lg_hamiltonian *h = &model->hamiltonian;
    size_t bytes;
    const linear_parts w = parts_of(h, work, &bytes);
    for (size_t i = 0; is_chain(h) && i < 6 * (size_t)h->links; i += 6)
        frame_at(state + i, w.frame + i, w.frame + i + 3);
    if (A != NULL) {
        LG_TRY(lg_model_field(model, state, input, w.field, w.hessian));
        fill_A(model, state, &w, A);
    }
    if (B != NULL) fill_B(model, &w, B);
    if (basis != NULL) fill_basis(h, state, &w, basis);
    return LG_OK;
}

/* Column j of the basis that is b_1 or b_2 of link i has e_1 or e_2 for its dp. */
lg_status lg_model_deviation(const lg_model *model, const double *basis, const double *state,
                             const double *other, double *c) {
    if (!lg_model_is_hamiltonian(model)) return LG_UNSUPPORTED;
    const lg_hamiltonian *h = &model->hamiltonian;
    const size_t r = tangent_size(h);
    for (size_t j = 0; j < r; j++) {
        if (!is_chain(h)) {
            c[j] = other[j] - state[j];
            continue;
        }
        const size_t link = 6 * (j / 4), part = link + 3 * (j % 4 / 2), column = j / 4 * 4 + 2 + j % 2;
        c[j] = 0.0;
        for (size_t i = 0; i < 3; i++)
            c[j] += basis[(link + 3 + i) * r + column] * (other[part + i] - state[part + i]);
    }
    return LG_OK;
}
