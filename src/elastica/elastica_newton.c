/* Newton's method for the inner angles of a beam. A step costs O(n).
 *
 * The force lambda = 2 P r is treated as a separate unknown. With U = h (-sin theta, cos theta), the gradient
 * g, the tridiagonal part T of the Hessian and c = r - lambda/(2 P), a step solves
 *
 *   [ T    -U       ] [dtheta ]     [g]
 *   [ -U^T -1/(2 P) ] [dlambda] = - [c],   C = 1/(2 P) + U^T T^-1 U,   C dlambda = c + U^T T^-1 g.
 *
 * For c = 0 this is the step with the Hessian H = T + 2 P U U^T (Sherman, Morrison, Woodbury). During the
 * descent lambda is set to 2 P r. For the last digits lambda is independent of r, because P grows like n^2
 * and 2 P r then loses digits.
 *
 * Inertia (Haynsworth): the number of negative eigenvalues of H is the number of negative eigenvalues of T,
 * plus the number of positive eigenvalues of C, minus 2. T is often indefinite where H is not. T is therefore
 * factored with pivots of one and two rows (Bunch 1974; N. Higham, Accuracy and Stability of Numerical
 * Algorithms, 11.1.4), which needs no exchange of rows. A pivot of zero is replaced by one rounding unit of
 * the largest entry. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "elastica/elastica.h"

#define STEP_MAX    0.5  /* largest change of an angle per step, radians */
#define CLOSE       1e-2 /* smaller steps are taken whole, without a test of the energy */
#define POLISH      30
#define HALVINGS    40
#define SUFFICIENT  1e-4
#define CORRECTIONS 4
/* Tolerance of correct_closure, relative to the decrease of energy that is expected. */
#define SMALL       1e-2
#define ESCAPE      0.2 /* distance from a saddle at which the descents start, radians */
#define ESCAPES     4
#define STAGNATION  1e-8
#define SHIFT_FIRST 1.0
#define SHIFT_LAST  1e14

/* ---- memory ---- */

#define ARRAYS 15

lg_status lg_beam_work_create(const lg_context *context, size_t room, lg_beam_work *out) {
    double *memory = lg_alloc(context, ARRAYS * (room + 1), sizeof *memory);
    if (!memory) return LG_OUT_OF_MEMORY;
    *out = (lg_beam_work){.context = context,
                          .room = room,
                          .memory = memory,
                          .tolerance = 1e-12,
                          .limit = 200,
                          .theta = memory};
    double **const arrays[ARRAYS - 1] = {&out->gradient, &out->diag,   &out->off, &out->ux,    &out->uy,
                                         &out->pivot,    &out->factor, &out->z,   &out->yx,    &out->yy,
                                         &out->saved,    &out->base,   &out->way, &out->before};
    for (size_t i = 0; i + 1 < ARRAYS; i++) *arrays[i] = memory + (i + 1) * (room + 1);
    return LG_OK;
}

void lg_beam_work_destroy(lg_beam_work *work) {
    lg_free(work->context, work->memory);
    work->memory = NULL;
}

/* ---- derivatives ---- */

static double penalty(const lg_beam *beam) {
    return 18.0 * (double)beam->n * (double)beam->n;
}

/* sum += x; `carry` holds the rounding error (Kahan summation). */
static void add(double *sum, double *carry, double x) {
    const double y = x - *carry, t = *sum + y;
    *carry = (t - *sum) - y;
    *sum = t;
}

/* Computes energy, gradient, T and U at w->theta. If `own`, the force keeps its value, and the defect becomes
 * r - lambda/(2 P). Otherwise the force is set to 2 P r and the defect is 0. */
static void evaluate(const lg_beam *beam, lg_beam_work *w, bool own) {
    const size_t n = beam->n;
    const double *theta = w->theta, h = 1.0 / (double)n, N = (double)n, P = penalty(beam);
    double x = 0.0, y = 0.0, cx = 0.0, cy = 0.0, bend = 0.0, carry = 0.0, before = 0.0, largest = 0.0;
    for (size_t k = 0; k <= n; k++) {
        const double c = h * cos(theta[k]), s = h * sin(theta[k]), half = k == 0 || k == n ? 0.5 : 1.0;
        add(&x, &cx, half * c);
        add(&y, &cy, half * s);
        w->ux[k] = -s;
        w->uy[k] = c;
    }
    for (size_t k = 0; k < n; k++) {
        const double delta = 0.5 * (theta[k + 1] - theta[k]), s = sin(delta), c = cos(delta);
        const double turn = N * 2.0 * s * c, stiff = N * (1.0 - 2.0 * s * s);
        add(&bend, &carry, 2.0 * s * s);
        w->gradient[k] = before - turn;
        w->off[k] = -stiff;
        w->diag[k] = (k > 0 ? -w->off[k - 1] : 0.0) + stiff;
        largest = fmax(largest, fabs(turn));
        before = turn;
    }
    const double r[2] = {beam->d - x, -y};
    w->energy = N * bend + P * (r[0] * r[0] + r[1] * r[1]);
    for (int c = 0; c < 2; c++) {
        if (!own) w->force[c] = 2.0 * P * r[c];
        w->defect[c] = own ? r[c] - w->force[c] / (2.0 * P) : 0.0;
    }
    for (size_t k = 1; k < n; k++) {
        const double gx = w->force[0] * w->ux[k], gy = w->force[1] * w->uy[k];
        w->gradient[k] -= gx + gy;
        w->diag[k] += w->force[0] * w->uy[k] - w->force[1] * w->ux[k];
        largest = fmax(largest, fmax(fabs(gx), fabs(gy)));
    }
    w->largest = largest;
}

double lg_beam_gradient(const lg_beam *beam, const lg_beam_work *work) {
    double largest = 0.0;
    for (size_t k = 1; k < beam->n; k++) largest = fmax(largest, fabs(work->gradient[k]));
    return largest;
}

double lg_beam_relative_gradient(const lg_beam *beam, const lg_beam_work *work) {
    const double g = lg_beam_gradient(beam, work);
    return g == 0.0 ? 0.0 : g / work->largest;
}

double lg_beam_energy(const lg_beam *beam, const double *theta) {
    const lg_elastica unit = {
        .length = 1.0, .stiffness = 1.0, .qN = {beam->d, 0.0}, .intervals = (uint32_t)beam->n};
    return lg_elastica_energy(&unit, theta);
}

/* ---- factorisation ---- */

/* Factors T + shift as L D L^T, where D has blocks of one or two rows. In general pivot[k] is the entry of D,
 * and factor[k] the entry of L in row k + 1 and column k. A block of the two rows k and k + 1 is marked by
 * factor[k] = NAN; its entries are pivot[k], off[k], pivot[k + 1], and factor[k + 1] is its determinant.
 * Returns the number of negative eigenvalues. */
static uint32_t factor_tridiagonal(size_t n, lg_beam_work *w, double shift) {
    const double alpha = 0.6180339887498949;
    double largest = 0.0;
    uint32_t negative = 0;
    for (size_t k = 1; k < n; k++) {
        w->pivot[k] = w->diag[k] + shift;
        largest = fmax(largest, fmax(fabs(w->pivot[k]), k + 1 < n ? fabs(w->off[k]) : 0.0));
    }
    if (!(largest > 0.0)) largest = 1.0;
    for (size_t k = 1; k < n; k++) {
        const bool more = k + 1 < n;
        const double e = more ? w->off[k] : 0.0;
        if (largest * fabs(w->pivot[k]) >= alpha * e * e) {
            if (!(fabs(w->pivot[k]) > largest * DBL_EPSILON)) w->pivot[k] = largest * DBL_EPSILON;
            negative += w->pivot[k] < 0.0;
            w->factor[k] = e / w->pivot[k];
            if (more) w->pivot[k + 1] -= w->factor[k] * e;
            continue;
        }
        const double det = w->pivot[k] * w->pivot[k + 1] - e * e;
        negative += 1; /* det < 0: one negative and one positive eigenvalue */
        w->factor[k] = NAN;
        w->factor[k + 1] = det;
        if (k + 2 < n) w->pivot[k + 2] -= w->off[k + 1] * w->off[k + 1] * (w->pivot[k] / det);
        k++;
    }
    return negative;
}

/* Solves for three right-hand sides at once, in place. */
static void solve_tridiagonal(size_t n, const lg_beam_work *w, double *const x[3]) {
    for (size_t k = 1; k < n; k++) {
        if (!isnan(w->factor[k])) {
            for (int i = 0; k + 1 < n && i < 3; i++) x[i][k + 1] -= w->factor[k] * x[i][k];
            for (int i = 0; i < 3; i++) x[i][k] /= w->pivot[k];
            continue;
        }
        const double a = w->pivot[k], e = w->off[k], b = w->pivot[k + 1], det = w->factor[k + 1];
        for (int i = 0; i < 3; i++) {
            const double u = x[i][k], v = x[i][k + 1];
            x[i][k] = (b * u - e * v) / det;
            x[i][k + 1] = (a * v - e * u) / det;
            if (k + 2 < n) x[i][k + 2] -= w->off[k + 1] * x[i][k + 1];
        }
        k++;
    }
    for (size_t k = n - 1; k >= 1; k--) {
        if (k + 1 >= n) continue;
        if (!isnan(w->factor[k]) && !(k > 1 && isnan(w->factor[k - 1]))) {
            for (int i = 0; i < 3; i++) x[i][k] -= w->factor[k] * x[i][k + 1];
        } else if (k > 1 && isnan(w->factor[k - 1])) { /* k is the second row of a block of two */
            const double a = w->pivot[k - 1], e = w->off[k - 1], det = w->factor[k], f = w->off[k];
            for (int i = 0; i < 3; i++) {
                const double u = f * x[i][k + 1];
                x[i][k] -= a * u / det;
                x[i][k - 1] += e * u / det;
            }
        }
    }
}

/* Factors T + shift h, solves for the right-hand sides U and -gradient, computes C with `soft` for 1/(2 P),
 * and counts the negative eigenvalues of the shifted Hessian. */
static void factor_softly(const lg_beam *beam, lg_beam_work *w, double shift, double soft) {
    const size_t n = beam->n;
    const uint32_t negative = factor_tridiagonal(n, w, shift / (double)n);
    for (size_t k = 1; k < n; k++) {
        w->z[k] = -w->gradient[k];
        w->yx[k] = w->ux[k];
        w->yy[k] = w->uy[k];
    }
    solve_tridiagonal(n, w, (double *const[3]){w->z, w->yx, w->yy});
    double xx = soft, xy = 0.0, yy = soft;
    for (size_t k = 1; k < n; k++) {
        xx += w->ux[k] * w->yx[k];
        xy += w->ux[k] * w->yy[k];
        yy += w->uy[k] * w->yy[k];
    }
    w->capacity[0] = xx;
    w->capacity[1] = xy;
    w->capacity[2] = yy;
    w->det = xx * yy - xy * xy;
    const uint32_t positive = w->det < 0.0 ? 1 : xx + yy > 0.0 ? 2 : 0;
    w->negative = negative + positive >= 2 ? negative + positive - 2 : 0;
}

/* Returns false if C is singular or not finite. */
static bool factor(const lg_beam *beam, lg_beam_work *w, double shift) {
    factor_softly(beam, w, shift, 0.5 / penalty(beam));
    return isfinite(w->det) && w->det != 0.0;
}

/* Computes the Newton step: w->z becomes dtheta, `force` becomes dlambda. Needs the results of `factor`. */
static void step(const lg_beam *beam, lg_beam_work *w, double force[2]) {
    double a = w->defect[0], b = w->defect[1];
    for (size_t k = 1; k < beam->n; k++) {
        a -= w->ux[k] * w->z[k];
        b -= w->uy[k] * w->z[k];
    }
    force[0] = (w->capacity[2] * a - w->capacity[1] * b) / w->det;
    force[1] = (w->capacity[0] * b - w->capacity[1] * a) / w->det;
    for (size_t k = 1; k < beam->n; k++) w->z[k] += force[0] * w->yx[k] + force[1] * w->yy[k];
}

static double length(const lg_beam *beam, const double *z) {
    double largest = 0.0;
    for (size_t k = 1; k < beam->n; k++) {
        if (!(fabs(z[k]) <= DBL_MAX)) return INFINITY;
        largest = fmax(largest, fabs(z[k]));
    }
    return largest;
}

static void move(const lg_beam *beam, const double *from, double share, const double *z, double *to) {
    for (size_t k = 1; k < beam->n; k++) to[k] = from[k] + share * z[k];
}

static void copy(const lg_beam *beam, double *to, const double *from) {
    memcpy(to, from, (beam->n + 1) * sizeof(*to));
}

/* ---- the last digits ---- */

static bool is_solved(const lg_beam *beam, const lg_beam_work *w) {
    const double force = hypot(w->force[0], w->force[1]), soft = 0.5 / penalty(beam);
    const double allowed = fmax(0.25 * DBL_EPSILON, 0.5 * w->tolerance * force * soft);
    return lg_beam_relative_gradient(beam, w) <= w->tolerance &&
           fmax(fabs(w->defect[0]), fabs(w->defect[1])) <= allowed;
}

/* Takes whole Newton steps in (theta, lambda) until the problem is solved, or until steps below STAGNATION no
 * longer shrink because of rounding. `within` is the size of the step before. If the steps grow or the matrix
 * is singular, restores the starting point and returns false. */
static bool polish(const lg_beam *beam, lg_beam_work *w, double within) {
    double before = within, force[2];
    copy(beam, w->saved, w->theta);
    evaluate(beam, w, false);
    for (int i = 0; i < POLISH; i++) {
        if (!factor(beam, w, 0.0)) break;
        if (i > 0 && is_solved(beam, w)) return true;
        step(beam, w, force);
        const double now = length(beam, w->z);
        if (!(now <= 2.0 * before)) break;
        const bool stagnates = i > 1 && now >= 0.25 * before && now < STAGNATION;
        move(beam, w->theta, 1.0, w->z, w->theta);
        w->force[0] += force[0];
        w->force[1] += force[1];
        evaluate(beam, w, true);
        w->iterations++;
        before = now;
        if (!stagnates) continue;
        factor(beam, w, 0.0);
        return true;
    }
    copy(beam, w->theta, w->saved);
    evaluate(beam, w, false);
    return false;
}

/* ---- descent ---- */

/* Factors with a shift > 0 that makes the Hessian positive definite. Tries larger and larger shifts. */
static bool factor_definite(const lg_beam *beam, lg_beam_work *w) {
    for (double shift = SHIFT_FIRST; shift < SHIFT_LAST; shift *= 4.0)
        if (factor(beam, w, shift) && w->negative == 0) return true;
    return false;
}

/* Second-order correction of a step (Nocedal and Wright, Numerical Optimization, 18.3). The energy P |r|^2 is
 * stiff: it is low only in a narrow curved valley around r = 0. A plain Newton step goes along the tangent
 * and leaves the valley, so it would have to be short. The correction moves theta by a combination of the
 * columns of Y = T^-1 U, which is the smallest change in the metric of T. It does so until r equals its
 * first-order value `wanted`, up to an energy of `small`. */
static void correct_closure(const lg_beam *beam, lg_beam_work *w, const double wanted[2], double small) {
    const double P = penalty(beam), soft = 0.5 / P;
    const double xx = w->capacity[0] - soft, xy = w->capacity[1], yy = w->capacity[2] - soft;
    const double det = xx * yy - xy * xy;
    for (int i = 0; i < CORRECTIONS; i++) {
        const double a = w->force[0] * soft - wanted[0], b = w->force[1] * soft - wanted[1];
        if (P * (a * a + b * b) <= small) return;
        const double x = (yy * a - xy * b) / det, y = (xx * b - xy * a) / det;
        if (!isfinite(x) || !isfinite(y)) return;
        const double size = fmax(fabs(x) * length(beam, w->yx), fabs(y) * length(beam, w->yy));
        if (!(size <= STEP_MAX)) return;
        for (size_t k = 1; k < beam->n; k++) w->theta[k] += x * w->yx[k] + y * w->yy[k];
        evaluate(beam, w, false);
    }
}

/* Line search from w->theta along w->z, beginning with the step length `share`. Returns false if the energy
 * does not decrease enough. */
static bool search_line(const lg_beam *beam, lg_beam_work *w, double share) {
    const double start = w->energy, soft = 0.5 / penalty(beam);
    double slope = 0.0, r[2] = {w->force[0] * soft, w->force[1] * soft}, change[2] = {0.0, 0.0};
    for (size_t k = 1; k < beam->n; k++) {
        slope += w->gradient[k] * w->z[k];
        change[0] -= w->ux[k] * w->z[k];
        change[1] -= w->uy[k] * w->z[k];
    }
    if (!(slope < 0.0)) return false;
    copy(beam, w->saved, w->theta);
    for (int i = 0; i < HALVINGS; i++, share *= 0.5) {
        move(beam, w->saved, share, w->z, w->theta);
        evaluate(beam, w, false);
        correct_closure(beam, w, (double[2]){r[0] + share * change[0], r[1] + share * change[1]},
                        -SMALL * share * slope);
        if (w->energy <= start + SUFFICIENT * share * slope) return true;
    }
    copy(beam, w->theta, w->saved);
    evaluate(beam, w, false);
    return false;
}

static lg_beam_end end_of(const lg_beam *beam, const lg_beam_work *w) {
    for (size_t k = 0; k < beam->n; k++)
        if (!(fabs(w->theta[k + 1] - w->theta[k]) < LG_PI)) return LG_BEAM_FOLDED;
    return w->negative == 0 ? LG_BEAM_MINIMUM : LG_BEAM_SADDLE;
}

/* Goes downhill in energy to a stationary point, which may be a saddle. */
static lg_beam_end descend(const lg_beam *beam, lg_beam_work *w) {
    double force[2];
    evaluate(beam, w, false);
    for (uint32_t i = 0; i < w->limit; i++) {
        const bool definite = factor(beam, w, 0.0) && w->negative == 0;
        if (!definite && lg_beam_relative_gradient(beam, w) < 1e-4) {
            step(beam, w, force);
            const double size = length(beam, w->z);
            if (size < 10.0 * CLOSE && polish(beam, w, size)) return end_of(beam, w);
        }
        if (!definite && !factor_definite(beam, w)) return LG_BEAM_LOST;
        step(beam, w, force);
        const double size = length(beam, w->z);
        if (!isfinite(size)) return LG_BEAM_LOST;
        if (definite && size < CLOSE && polish(beam, w, size)) return end_of(beam, w);
        if (definite && size < CLOSE) { /* polish() has overwritten the factorisation and the step */
            factor(beam, w, 0.0);
            step(beam, w, force);
        }
        w->iterations++;
        if (!search_line(beam, w, size > STEP_MAX ? STEP_MAX / size : 1.0)) break;
    }
    return polish(beam, w, CLOSE) ? end_of(beam, w) : LG_BEAM_LOST;
}

/* Writes the direction of lowest curvature to w->z, scaled so that its largest entry is 1. Inverse iteration
 * is used, with the smallest shift that makes the Hessian definite. Bisection on the inertia finds this
 * shift. */
static bool lowest_direction(const lg_beam *beam, lg_beam_work *w) {
    const size_t n = beam->n;
    double low = 0.0, high = SHIFT_FIRST, force[2];
    while (high < SHIFT_LAST && !(factor(beam, w, high) && w->negative == 0)) high *= 4.0;
    if (!(high < SHIFT_LAST)) return false;
    for (int i = 0; i < 30; i++) {
        const double middle = 0.5 * (low + high);
        if (factor(beam, w, middle) && w->negative == 0)
            high = middle;
        else
            low = middle;
        if (high - low < 1e-6 * high) break;
    }
    for (size_t k = 1; k < n; k++) {
        const double s = LG_PI * (double)k / (double)n;
        w->gradient[k] = -(sin(s) + 0.3 * sin(2.0 * s) + 0.1 * cos(7.0 * s));
    }
    w->defect[0] = w->defect[1] = 0.0;
    for (int i = 0; i < 6; i++) {
        if (!factor(beam, w, high)) return false;
        step(beam, w, force);
        const double size = length(beam, w->z);
        if (!(size > 0.0) || !isfinite(size)) return false;
        for (size_t k = 1; k < n; k++) w->gradient[k] = -(w->z[k] /= size);
    }
    return true;
}

/* Goes downhill from a saddle to both sides. The result is the minimum with the lower energy, or the first
 * one if both are equally low. */
static lg_beam_end escape(const lg_beam *beam, lg_beam_work *w) {
    lg_beam_end ends[2];
    double energies[2], middle = 0.0;
    if (!lowest_direction(beam, w)) return LG_BEAM_SADDLE;
    for (size_t k = 1; k < beam->n; k++) middle += w->z[k];
    const double sign = middle < 0.0 ? -1.0 : 1.0;
    copy(beam, w->base, w->theta);
    copy(beam, w->way, w->theta);
    move(beam, w->base, sign * ESCAPE, w->z, w->theta);
    move(beam, w->base, -sign * ESCAPE, w->z, w->way);
    ends[0] = descend(beam, w);
    energies[0] = w->energy;
    for (size_t k = 0; k <= beam->n; k++) {
        const double first = w->theta[k];
        w->theta[k] = w->way[k];
        w->base[k] = first;
    }
    ends[1] = descend(beam, w);
    energies[1] = w->energy;
    const bool second = ends[1] == LG_BEAM_MINIMUM &&
                        (ends[0] != LG_BEAM_MINIMUM || energies[1] < energies[0] * (1.0 - 1e-9));
    if (second) return ends[1];
    copy(beam, w->theta, w->base);
    return descend(beam, w);
}

lg_beam_end lg_beam_minimise(const lg_beam *beam, lg_beam_work *work) {
    lg_beam_end end = descend(beam, work);
    for (int i = 0; !work->keep_saddles && end == LG_BEAM_SADDLE && i < ESCAPES; i++)
        end = escape(beam, work);
    return end;
}

lg_beam_end lg_beam_stationary(const lg_beam *beam, lg_beam_work *work) {
    double force[2];
    for (uint32_t i = 0; i < work->limit; i++) {
        evaluate(beam, work, false);
        if (!factor(beam, work, 0.0)) return LG_BEAM_LOST;
        step(beam, work, force);
        const double size = length(beam, work->z);
        if (!isfinite(size)) return LG_BEAM_LOST;
        if (size < CLOSE) return polish(beam, work, size) ? end_of(beam, work) : LG_BEAM_LOST;
        move(beam, work->theta, size > STEP_MAX ? STEP_MAX / size : 1.0, work->z, work->theta);
        work->iterations++;
    }
    return LG_BEAM_LOST;
}

void lg_beam_flow(const lg_beam *beam, lg_beam_work *work, double rate, int steps) {
    double force[2];
    for (int i = 0; i < steps; i++) {
        evaluate(beam, work, false);
        double shift = rate;
        while (shift < SHIFT_LAST && !(factor(beam, work, shift) && work->negative == 0)) shift *= 2.0;
        step(beam, work, force);
        const double size = length(beam, work->z);
        if (!(shift < SHIFT_LAST) || !isfinite(size)) return;
        move(beam, work->theta, size > STEP_MAX ? STEP_MAX / size : 1.0, work->z, work->theta);
    }
}

uint32_t lg_beam_inertia(const lg_beam *beam, lg_beam_work *work, const double theta[],
                         const double force[2]) {
    copy(beam, work->theta, theta);
    work->force[0] = force[0];
    work->force[1] = force[1];
    evaluate(beam, work, true);
    factor_softly(beam, work, 0.0, 0.0);
    return work->negative;
}
