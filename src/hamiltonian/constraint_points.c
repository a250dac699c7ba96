/* Constraints of the user at a point: how regular it is, and projections. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/clean.h"
#include "hamiltonian/constraint.h"
#include "integrators/stepper.h"
#include "kernels/matrix.h"

enum { MOST = LG_CONSTRAINT_MOST };

lg_constraint_text lg_constraint_show(const lg_constraint *constraint, const double *q) {
    lg_constraint_text out = {"q = ("};
    size_t used = strlen(out.text);
    for (size_t i = 0; i < constraint->n && used < sizeof out.text - 24; i++)
        used += (size_t)lg_format(out.text + used, sizeof out.text - used, "%s%.6g", i > 0 ? ", " : "", q[i]);
    (void)snprintf(out.text + used, sizeof out.text - used, used < sizeof out.text - 24 ? ")" : ", ...)");
    return out;
}

/* ---- work memory ---- */

lg_status lg_constraint_begin(const lg_constraint *constraint, double size, const double *q,
                              lg_constraint_work *work, lg_error *error) {
    const size_t n = constraint->n, bends = n * constraint->m * n * sizeof(double);
    const size_t plans = (constraint->work_size + 63) / 64 * 64;
    char *memory = lg_alloc(constraint->context, plans + bends, 1);
    if (memory == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a constraint");
    work->of = constraint;
    work->plans = memory;
    work->bends = (double *)(void *)(memory + plans);
    work->size = size > 0.0 ? size : lg_matrix_norm(n, q);
    return LG_OK;
}

void lg_constraint_end(lg_constraint_work *work) {
    lg_free(work->of->context, work->plans);
}

/* Sets work->g at q. */
static void value_at(lg_constraint_work *work, const double *q) {
    lg_plan_eval(work->of->g, (const void *[]){q}, (void *[]){work->g}, work->plans);
}

void lg_constraint_normals(lg_constraint_work *work, const double *q) {
    lg_plan_eval(work->of->G, (const void *[]){q}, (void *[]){work->G}, work->plans);
}

/* ---- rank ---- */

/* Writes the size of each row of G: max(|G_i|, L |H_i|). */
static void row_sizes(lg_constraint_work *work, const double *q, double *size) {
    const size_t n = work->of->n, m = work->of->m;
    double rows[MOST * MOST], unit[MOST * MOST] = {0.0};
    for (size_t i = 0; i < n; i++) {
        memcpy(rows + i * n, q, n * sizeof *q);
        unit[i * n + i] = 1.0;
    }
    lg_plan_eval(work->of->bends, (const void *[]){rows, unit}, (void *[]){work->bends}, work->plans);
    for (size_t a = 0; a < m; a++) {
        double hessian[MOST * MOST];
        for (size_t i = 0; i < n; i++)
            memcpy(hessian + i * n, work->bends + (i * m + a) * n, n * sizeof *hessian);
        size[a] = fmax(lg_matrix_norm(n, work->G + a * n), work->size * lg_matrix_norm(n * n, hessian));
        if (!lg_all_finite(n * n, hessian)) size[a] = NAN;
    }
}

/* The smallest length of the rows of A (m, n) after they have been made orthogonal by rotations of pairs of
 * rows (Hestenes 1958): the smallest singular value. */
static double smallest_singular(size_t m, size_t n, double *A) {
    enum { SWEEPS = 40 };
    bool turned = true;
    double least = INFINITY;
    for (int sweep = 0; sweep < SWEEPS && turned; sweep++) {
        turned = false;
        for (size_t a = 0; a + 1 < m; a++)
            for (size_t b = a + 1; b < m; b++) {
                double *x = A + a * n, *y = A + b * n, xx = 0.0, yy = 0.0, xy = 0.0;
                for (size_t i = 0; i < n; i++) xx += x[i] * x[i], yy += y[i] * y[i], xy += x[i] * y[i];
                if (!(fabs(xy) > DBL_EPSILON * sqrt(xx * yy))) continue;
                const double cot = (yy - xx) / (2.0 * xy);
                const double t = copysign(1.0, cot) / (fabs(cot) + sqrt(1.0 + cot * cot));
                const double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
                for (size_t i = 0; i < n; i++) {
                    const double old = x[i];
                    x[i] = c * old - s * y[i];
                    y[i] = s * old + c * y[i];
                }
                turned = true;
            }
    }
    for (size_t a = 0; a < m; a++) least = fmin(least, lg_matrix_norm(n, A + a * n));
    return least;
}

static double rank_of(lg_constraint_work *work, const double *q) {
    const size_t n = work->of->n, m = work->of->m;
    double size[MOST], A[MOST * MOST];
    row_sizes(work, q, size);
    for (size_t a = 0; a < m; a++) {
        if (isnan(size[a])) return NAN;
        for (size_t i = 0; i < n; i++) A[a * n + i] = size[a] > 0.0 ? work->G[a * n + i] / size[a] : 0.0;
    }
    return smallest_singular(m, n, A);
}

/* ---- linear algebra with the normals ---- */

/* out = F^T (G K F^T)^-1 r for rows of G of length 1, with r = G K x; for x NULL r is g in units of the rows'
 * lengths. K (n, n) NULL: the unit matrix; F (m, n) NULL: G. Returns the sign of det G K F^T; 0: singular.
 * out NULL: the sign alone. */
static int along_normals(const lg_constraint_work *work, const double *F, const double *K, const double *x,
                         double *out) {
    const size_t n = work->of->n, m = work->of->m;
    double unit[MOST * MOST], GK[MOST * MOST], turned[MOST * MOST], S[MOST * MOST];
    double Kx[MOST], length[MOST], r[MOST];
    size_t pivot[MOST];
    int sign = 1;
    for (size_t a = 0; a < m; a++) {
        length[a] = lg_matrix_norm(n, work->G + a * n);
        for (size_t i = 0; i < n; i++) unit[a * n + i] = work->G[a * n + i] / length[a];
    }
    if (F == NULL) F = unit;
    if (K != NULL) lg_matrix_multiply(m, n, n, unit, K, GK);
    lg_matrix_transpose(m, n, F, turned);
    lg_matrix_multiply(m, m, n, K != NULL ? GK : unit, turned, S);
    if (!lg_matrix_factor(m, m, S, pivot)) return 0;
    for (size_t a = 0; a < m; a++) sign = (pivot[a] != a) != (S[a * (m + 1)] < 0.0) ? -sign : sign;
    if (out == NULL) return sign;
    if (K != NULL && x != NULL) lg_matrix_multiply(n, 1, n, K, x, Kx);
    if (x != NULL) lg_matrix_multiply(m, 1, n, unit, K != NULL ? Kx : x, r);
    for (size_t a = 0; a < m && x == NULL; a++) r[a] = work->g[a] / length[a];
    lg_matrix_solve(m, m, S, pivot, 1, r);
    lg_matrix_multiply_tn(n, 1, m, F, r, out);
    return sign;
}

bool lg_constraint_clear(const lg_constraint_work *work, const double *K, double *x) {
    double along[MOST];
    if (along_normals(work, NULL, K, x, along) == 0) return false;
    for (size_t i = 0; i < work->of->n; i++) x[i] -= along[i];
    return true;
}

/* ---- points ---- */

lg_status lg_constraint_view_of(lg_constraint_work *work, const double *q, lg_constraint_view *out,
                                lg_error *error) {
    const size_t n = work->of->n, m = work->of->m;
    double step[MOST];
    *out = (lg_constraint_view){.off = INFINITY};
    value_at(work, q);
    lg_constraint_normals(work, q);
    if (!lg_all_finite(m, work->g) || !lg_all_finite(m * n, work->G))
        return lg_fail(error, LG_NOT_FINITE, "the constraint or its Jacobian is not finite at %s",
                       lg_constraint_show(work->of, q).text);
    for (size_t a = 0; a < m; a++) out->residual = fmax(out->residual, fabs(work->g[a]));
    out->rank = rank_of(work, q);
    if (isnan(out->rank))
        return lg_fail(error, LG_NOT_FINITE, "a second derivative of the constraint is not finite at %s",
                       lg_constraint_show(work->of, q).text);
    if (out->rank < LG_CONSTRAINT_LEAST_RANK)
        return lg_fail(
            error, LG_FORMAT,
            "the Jacobian G of the constraint loses rank at %s: its relative smallest singular value is "
            "%.2g, and %g is needed; the %u constraints depend on each other or one of them is flat there",
            lg_constraint_show(work->of, q).text, out->rank, LG_CONSTRAINT_LEAST_RANK, work->of->m);
    if (along_normals(work, NULL, NULL, NULL, step) != 0 && lg_all_finite(n, step))
        out->off = lg_matrix_norm(n, step) / (work->size > 0.0 ? work->size : 1.0);
    return LG_OK;
}

lg_status lg_constraint_look(const lg_constraint *constraint, double size, const double *state,
                             lg_constraint_view *out, lg_error *error) {
    LG_NEEDS(error, constraint, state, out);
    const size_t n = constraint->n;
    LG_CLEAN(lg_constraint_end) lg_constraint_work work = {.of = constraint};
    double p[MOST], whole = lg_matrix_norm(n, state + n);
    LG_TRY(lg_constraint_begin(constraint, size, state, &work, error));
    LG_TRY(lg_constraint_view_of(&work, state, out, error));
    memcpy(p, state + n, n * sizeof *p);
    if (!(whole > 0.0)) return LG_OK;
    (void)lg_constraint_clear(&work, NULL, p); /* the rank is high enough */
    for (size_t i = 0; i < n; i++) p[i] -= state[n + i];
    out->across = lg_matrix_norm(n, p) / whole;
    return LG_OK;
}

bool lg_constraint_land(lg_constraint_work *work, const double *W, const double *F, double *q,
                        double *impulse) {
    enum { LONGEST = 50 };
    const size_t n = work->of->n;
    double along[MOST], step[MOST], before = INFINITY;
    bool done = false;
    memset(impulse, 0, n * sizeof *impulse);
    for (int i = 0; i < LONGEST && !done; i++) {
        value_at(work, q);
        lg_constraint_normals(work, q);
        if (along_normals(work, F, W, NULL, along) == 0) return false;
        if (W != NULL) lg_matrix_multiply(n, 1, n, W, along, step);
        if (W == NULL) memcpy(step, along, n * sizeof *step);
        if (!lg_all_finite(n, step)) return false;
        for (size_t k = 0; k < n; k++) {
            q[k] -= step[k];
            impulse[k] += along[k];
        }
        const double moved = lg_matrix_norm(n, step), size = fmax(lg_matrix_norm(n, q), work->size);
        done = moved <= 4.0 * DBL_EPSILON * size ||
               (moved >= 0.25 * before && moved <= 1024.0 * DBL_EPSILON * size);
        before = moved;
    }
    lg_constraint_normals(work, q);
    return done && (F == NULL || along_normals(work, F, W, NULL, NULL) > 0);
}

lg_status lg_constraint_project(const lg_constraint *constraint, double size, double *state,
                                lg_error *error) {
    LG_NEEDS(error, constraint, state);
    const size_t n = constraint->n;
    LG_CLEAN(lg_constraint_end) lg_constraint_work work = {.of = constraint};
    lg_constraint_view view;
    double moved[2 * MOST], impulse[MOST];
    memcpy(moved, state, 2 * n * sizeof *moved);
    LG_TRY(lg_constraint_begin(constraint, size, state, &work, error));
    if (!lg_constraint_land(&work, NULL, NULL, moved, impulse)) {
        LG_TRY(lg_constraint_view_of(&work, state, &view, error)); /* the rank may be the reason */
        return lg_fail(error, LG_NO_CONVERGENCE, "Newton's method finds no point with g(q) = 0 from %s",
                       lg_constraint_show(constraint, state).text);
    }
    LG_TRY(lg_constraint_view_of(&work, moved, &view, error));
    (void)lg_constraint_clear(&work, NULL, moved + n); /* the rank is high enough */
    memcpy(state, moved, 2 * n * sizeof *state);
    return LG_OK;
}
