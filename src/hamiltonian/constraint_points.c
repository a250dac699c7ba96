/* Constraints of the user at a point: how regular it is, and projections. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "hamiltonian/constraint.h"
#include "integrators/taped_internal.h"

enum { MOST = LG_CONSTRAINT_MOST };

static double norm(size_t n, const double *x) {
    double most = 0.0, sum = 0.0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(x[i]));
    if (!(most > 0.0 && most <= DBL_MAX)) return most;
    for (size_t i = 0; i < n; i++) sum += x[i] / most * (x[i] / most);
    return most * sqrt(sum);
}

static bool all_finite(size_t n, const double *x) {
    for (size_t i = 0; i < n; i++)
        if (!isfinite(x[i])) return false;
    return true;
}

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
    work->size = size > 0.0 ? size : norm(n, q);
    return LG_OK;
}

void lg_constraint_end(lg_constraint_work *work) {
    lg_free(work->of->context, work->plans);
}

void lg_constraint_value(lg_constraint_work *work, const double *q) {
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
        size[a] = fmax(norm(n, work->G + a * n), work->size * norm(n * n, hessian));
        if (!all_finite(n * n, hessian)) size[a] = (double)NAN;
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
    for (size_t a = 0; a < m; a++) least = fmin(least, norm(n, A + a * n));
    return least;
}

static double rank_of(lg_constraint_work *work, const double *q) {
    const size_t n = work->of->n, m = work->of->m;
    double size[MOST], A[MOST * MOST];
    row_sizes(work, q, size);
    for (size_t a = 0; a < m; a++) {
        if (isnan(size[a])) return (double)NAN;
        for (size_t i = 0; i < n; i++) A[a * n + i] = size[a] > 0.0 ? work->G[a * n + i] / size[a] : 0.0;
    }
    return smallest_singular(m, n, A);
}

/* ---- linear algebra with the normals ---- */

/* Rows of G divided by their lengths. */
static void unit_rows(const lg_constraint_work *work, double *unit, double *length) {
    const size_t n = work->of->n, m = work->of->m;
    for (size_t a = 0; a < m; a++) {
        length[a] = norm(n, work->G + a * n);
        for (size_t i = 0; i < n; i++) unit[a * n + i] = work->G[a * n + i] / length[a];
    }
}

/* out = A B^T for A (m, n), B (m, n). */
static void product_nt(size_t m, size_t n, const double *A, const double *B, double *out) {
    for (size_t a = 0; a < m; a++)
        for (size_t b = 0; b < m; b++) {
            double sum = 0.0;
            for (size_t i = 0; i < n; i++) sum += A[a * n + i] * B[b * n + i];
            out[a * m + b] = sum;
        }
}

/* y = A x for A (m, n). */
static void apply(size_t m, size_t n, const double *A, const double *x, double *y) {
    for (size_t a = 0; a < m; a++) {
        y[a] = 0.0;
        for (size_t i = 0; i < n; i++) y[a] += A[a * n + i] * x[i];
    }
}

static void weighted(size_t m, size_t n, const double *A, const double *K, double *out) {
    for (size_t a = 0; a < m; a++)
        for (size_t j = 0; j < n; j++) {
            out[a * n + j] = 0.0;
            for (size_t i = 0; i < n; i++) out[a * n + j] += A[a * n + i] * K[i * n + j];
        }
}

bool lg_constraint_clear(const lg_constraint_work *work, const double *K, double *x) {
    const size_t n = work->of->n, m = work->of->m;
    double unit[MOST * MOST], GK[MOST * MOST], S[MOST * MOST], length[MOST], r[MOST], k[MOST];
    unit_rows(work, unit, length);
    if (K != NULL)
        weighted(m, n, unit, K, GK);
    else
        memcpy(GK, unit, m * n * sizeof *GK);
    product_nt(m, n, GK, unit, S);
    if (!lg_taped_invert(m, S, k)) return false;
    apply(m, n, GK, x, r);
    apply(m, m, S, r, k);
    for (size_t a = 0; a < m; a++)
        for (size_t i = 0; i < n; i++) x[i] -= unit[a * n + i] * k[a];
    return true;
}

/* The step G^T (G G^T)^-1 g of Newton's method; false: singular. */
static bool newton_step(const lg_constraint_work *work, double *step) {
    const size_t n = work->of->n, m = work->of->m;
    double unit[MOST * MOST], S[MOST * MOST], length[MOST], r[MOST], k[MOST];
    unit_rows(work, unit, length);
    product_nt(m, n, unit, unit, S);
    if (!lg_taped_invert(m, S, k)) return false;
    for (size_t a = 0; a < m; a++) r[a] = work->g[a] / length[a];
    apply(m, m, S, r, k);
    memset(step, 0, n * sizeof *step);
    for (size_t a = 0; a < m; a++)
        for (size_t i = 0; i < n; i++) step[i] += unit[a * n + i] * k[a];
    return all_finite(n, step);
}

/* ---- points ---- */

lg_status lg_constraint_view_of(lg_constraint_work *work, const double *q, lg_constraint_view *out,
                                lg_error *error) {
    const size_t n = work->of->n, m = work->of->m;
    double step[MOST];
    *out = (lg_constraint_view){.off = INFINITY};
    if (!all_finite(m, work->g) || !all_finite(m * n, work->G))
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
            "the Jacobian G of the constraint loses rank at %s: its relative smallest singular value "
            "is %.2g, and %g is needed; the %u constraints depend on each other or one of them is "
            "flat there",
            lg_constraint_show(work->of, q).text, out->rank, LG_CONSTRAINT_LEAST_RANK, work->of->m);
    if (newton_step(work, step)) out->off = norm(n, step) / (work->size > 0.0 ? work->size : 1.0);
    return LG_OK;
}

lg_status lg_constraint_look(const lg_constraint *constraint, double size, const double *state,
                             lg_constraint_view *out, lg_error *error) {
    LG_NEEDS(error, constraint, state, out);
    const size_t n = constraint->n;
    lg_constraint_work work;
    double p[MOST], whole = norm(n, state + n);
    LG_TRY(lg_constraint_begin(constraint, size, state, &work, error));
    lg_constraint_value(&work, state);
    lg_constraint_normals(&work, state);
    const lg_status status = lg_constraint_view_of(&work, state, out, error);
    memcpy(p, state + n, n * sizeof *p);
    if (status == LG_OK && whole > 0.0) {
        (void)lg_constraint_clear(&work, NULL, p); /* the rank is high enough */
        for (size_t i = 0; i < n; i++) p[i] -= state[n + i];
        out->across = norm(n, p) / whole;
    }
    lg_constraint_end(&work);
    return status;
}

bool lg_constraint_settled(double moved, double before, double size) {
    return moved <= 4.0 * DBL_EPSILON * size ||
           (moved >= 0.25 * before && moved <= 1024.0 * DBL_EPSILON * size);
}

lg_status lg_constraint_land(lg_constraint_work *work, double *q, lg_error *error) {
    enum { LONGEST = 50 };
    const lg_constraint *c = work->of;
    lg_constraint_view view;
    double step[MOST], before = INFINITY, first[MOST];
    bool done = false;
    memcpy(first, q, c->n * sizeof *first);
    for (int i = 0; i < LONGEST && !done; i++) {
        lg_constraint_value(work, q);
        lg_constraint_normals(work, q);
        if (!all_finite(c->m, work->g) || !newton_step(work, step)) break;
        for (size_t k = 0; k < c->n; k++) q[k] -= step[k];
        const double moved = norm(c->n, step);
        done = lg_constraint_settled(moved, before, fmax(norm(c->n, q), work->size));
        before = moved;
    }
    if (!done) memcpy(q, first, c->n * sizeof *q);
    lg_constraint_value(work, q);
    lg_constraint_normals(work, q);
    if (done) return LG_OK;
    LG_TRY(lg_constraint_view_of(work, q, &view, error)); /* the rank may be the reason */
    return lg_fail(error, LG_NO_CONVERGENCE, "Newton's method finds no point with g(q) = 0 from %s",
                   lg_constraint_show(c, first).text);
}

lg_status lg_constraint_project(const lg_constraint *constraint, double size, double *state,
                                lg_error *error) {
    LG_NEEDS(error, constraint, state);
    const size_t n = constraint->n;
    lg_constraint_work work;
    lg_constraint_view view;
    double moved[2 * MOST];
    memcpy(moved, state, 2 * n * sizeof *moved);
    LG_TRY(lg_constraint_begin(constraint, size, state, &work, error));
    lg_status status = lg_constraint_land(&work, moved, error);
    if (status == LG_OK) status = lg_constraint_view_of(&work, moved, &view, error);
    if (status == LG_OK) {
        (void)lg_constraint_clear(&work, NULL, moved + n); /* the rank is high enough */
        memcpy(state, moved, 2 * n * sizeof *state);
    }
    lg_constraint_end(&work);
    return status;
}
