/* The continuous problem, theta'' = lx sin theta - ly cos theta, by Chebyshev collocation on panels.
 *
 * A panel has length l and begins at s_0. Its unknowns are theta and theta' at s_0, and w = theta'' at the
 * extreme points t_i of a Chebyshev polynomial, t in [0, 1]. The angles follow by integrating the interpolant
 * of w twice,
 *
 *   theta_i = theta_0 + l t_i theta'_0 + l^2 sum_k B_ik w_k,   w_i = f(theta_i).
 *
 * Integration loses no digits, unlike differentiation. Newton's method first eliminates w in each panel; the
 * matrix I - l^2 f' B is small and dense. It then solves for the unknowns that join the panels, theta and
 * theta' at the ends of the panels, and for the force. The equations are the continuity of theta and theta',
 * the end angles, and int v ds = (d, 0). They are all solved as one system, so solutions that grow like
 * exp(s/layer) along the beam do no harm. Panels are halved until w satisfies the differential equation
 * between the points t_i too, and the last coefficients of the series of cos theta and sin theta are
 * negligible. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "elastica/elastica.h"
#include "kernels/matrix.h"

#define DEGREE       16
#define M            (DEGREE + 1)
#define SERIES       (M + 2) /* number of coefficients of the series of theta */
#define RIGHT        5       /* number of right-hand sides: defect, theta_0, theta'_0, lx, ly */
#define PANELS_FIRST 8
#define PANELS_MAX   256
#define REFINEMENTS  16
#define ITERATIONS   40
#define CONVERGED    1e-13
#define STAGNATION   1e-9
#define TAIL         1e-13
#define STEP_MAX     0.5

/* Matrices for the interval [0, 1], which all panels use. */
typedef struct reference {
    double t[M], weight[M]; /* collocation points, quadrature weights */
    double series[M][M];    /* maps values at the points to Chebyshev coefficients */
    /* Map values of w to its integral from 0 to t_i, and to its double integral. */
    double once[M][M], twice[M][M];
    /* Map values of w to values and double integrals at the points middle_t, which lie between the points
     * t_i. */
    double middle[DEGREE][M], middle_twice[DEGREE][M], middle_t[DEGREE];
} reference;

typedef struct panel {
    double start, length;
    double theta, slope; /* at the start of the panel */
    double w[M];
    double angle[M], cosine[M], sine[M];
    double response[M][RIGHT]; /* change of w per unit of each right-hand side */
    double angles[SERIES];     /* Chebyshev series of theta */
    double x[M + 1], y[M + 1]; /* series of the position, relative to the beginning of the beam */
} panel;

struct lg_collocation {
    reference reference;
    const lg_context *context;
    size_t count;           /* number of panels */
    panel *panels, *halves; /* PANELS_MAX each; refine() writes the next panels to `halves` */
    double *matrix;         /* system of the joints between panels */
    size_t room;            /* largest order of the system that fits into `matrix` */
    double last, slope;     /* theta and theta' at the end of the beam */
    double force[2], energy, defect, gradient;
    uint32_t iterations;
};

/* ---- Chebyshev series on [0, 1] ---- */

static double sum_series(const double *c, size_t count, double t) {
    const double x = 2.0 * t - 1.0;
    double b1 = 0.0, b2 = 0.0;
    for (size_t k = count; k-- > 1;) {
        const double b = 2.0 * x * b1 - b2 + c[k];
        b2 = b1;
        b1 = b;
    }
    return x * b1 - b2 + c[0];
}

/* out (count + 1) becomes the series of the integral from 0. */
static void integrate_series(const double *c, size_t count, double *out) {
    double at_zero = 0.0;
    for (size_t j = 1; j <= count; j++) {
        const double below = j == 1 ? 2.0 * c[0] : c[j - 1], above = j + 1 < count ? c[j + 1] : 0.0;
        out[j] = 0.25 * (below - above) / (double)j;
        at_zero += j % 2 ? -out[j] : out[j];
    }
    out[0] = -at_zero;
}

static void values_to_series(const reference *r, const double *values, double *c) {
    for (size_t j = 0; j < M; j++) {
        c[j] = 0.0;
        for (size_t i = 0; i < M; i++) c[j] += r->series[j][i] * values[i];
    }
}

static void reference_make(reference *r) {
    double c[M], once[M + 1], twice[M + 2];
    for (size_t i = 0; i < M; i++) {
        const double s = sin(0.5 * LG_PI * (double)i / DEGREE);
        r->t[i] = s * s;
        for (size_t j = 0; j < M; j++) { /* T_j at 2 t - 1 = -cos(pi i/DEGREE) */
            const double share = (i == 0 || i == DEGREE ? 0.5 : 1.0) * (j == 0 || j == DEGREE ? 0.5 : 1.0);
            r->series[j][i] = share * 2.0 / DEGREE * (j % 2 ? -1.0 : 1.0) *
                              cos(LG_PI * (double)((i * j) % (2 * DEGREE)) / DEGREE);
        }
    }
    for (size_t i = 0; i < DEGREE; i++) {
        const double s = sin(0.5 * LG_PI * ((double)i + 0.5) / DEGREE);
        r->middle_t[i] = s * s;
    }
    for (size_t k = 0; k < M; k++) {
        for (size_t j = 0; j < M; j++) c[j] = r->series[j][k];
        integrate_series(c, M, once);
        integrate_series(once, M + 1, twice);
        for (size_t i = 0; i < M; i++) {
            r->once[i][k] = sum_series(once, M + 1, r->t[i]);
            r->twice[i][k] = sum_series(twice, M + 2, r->t[i]);
        }
        for (size_t i = 0; i < DEGREE; i++) {
            r->middle[i][k] = sum_series(c, M, r->middle_t[i]);
            r->middle_twice[i][k] = sum_series(twice, M + 2, r->middle_t[i]);
        }
        r->weight[k] = r->once[DEGREE][k];
    }
}

/* ---- memory ---- */

lg_status lg_collocation_create(const lg_context *context, lg_collocation **out) {
    LG_SCRATCH(panel, panels, context, 2 * PANELS_MAX);
    lg_collocation *c = panels ? lg_alloc(context, 1, sizeof *c) : NULL;
    if (!c) return LG_OUT_OF_MEMORY;
    c->context = context;
    c->panels = LG_KEEP(panels);
    c->halves = c->panels + PANELS_MAX;
    reference_make(&c->reference);
    *out = c;
    return LG_OK;
}

void lg_collocation_destroy(const lg_context *context, lg_collocation *collocation) {
    if (!collocation) return;
    LG_FREE_ALL(context, collocation->matrix,
                collocation->panels < collocation->halves ? collocation->panels : collocation->halves,
                collocation);
}

static size_t unknowns(size_t panels) {
    return 2 * panels + 4;
}

/* Makes room for the system of the joints, with one more column for the right-hand side. */
static lg_status make_room(lg_collocation *c) {
    const size_t n = unknowns(c->count);
    if (c->room >= n) return LG_OK;
    double *matrix = lg_alloc(c->context, n * (n + 1), sizeof *matrix);
    if (!matrix) return LG_OUT_OF_MEMORY;
    lg_free(c->context, c->matrix);
    c->matrix = matrix;
    c->room = n;
    return LG_OK;
}

/* ---- one panel ---- */

static void panel_angles(const reference *r, panel *p) {
    for (size_t i = 0; i < M; i++) {
        double sum = 0.0;
        for (size_t k = 0; k < M; k++) sum += r->twice[i][k] * p->w[k];
        p->angle[i] = p->theta + p->length * (r->t[i] * p->slope + p->length * sum);
        p->cosine[i] = cos(p->angle[i]);
        p->sine[i] = sin(p->angle[i]);
    }
}

/* Computes p->response: how w changes because of its defect, and per unit change of theta_0, theta'_0 and the
 * two components of the force. Returns false if the matrix is singular. */
static bool panel_respond(const reference *r, const double force[2], panel *p) {
    double a[M * M];
    size_t pivot[M];
    panel_angles(r, p);
    for (size_t i = 0; i < M; i++) {
        const double c = p->cosine[i], s = p->sine[i], slope = force[0] * c + force[1] * s;
        const double share = -p->length * p->length * slope;
        const double right[RIGHT] = {force[0] * s - force[1] * c - p->w[i], slope,
                                     slope * p->length * r->t[i], s, -c};
        for (size_t k = 0; k < M; k++) a[i * M + k] = share * r->twice[i][k] + (i == k ? 1.0 : 0.0);
        memcpy(p->response[i], right, sizeof right);
    }
    if (!lg_matrix_factor(M, M, a, pivot)) return false;
    for (size_t j = 0; j < RIGHT; j++) lg_matrix_solve(M, M, a, pivot, RIGHT, &p->response[0][j]);
    return true;
}

/* Computes what the panel contributes to the system of the joints. Rows of `out`: theta and theta' at the end
 * of the panel, and the two components of the panel's chord. Column 0 holds these values, including the
 * effect of the defect of w. Columns 1..4 hold their derivatives with respect to theta_0, theta'_0 and the
 * two components of the force. */
static void panel_transfer(const reference *r, const panel *p, double out[4][RIGHT]) {
    const double l = p->length;
    memset(out, 0, 4 * sizeof *out);
    out[0][0] = p->theta + l * p->slope;
    out[1][0] = p->slope;
    out[0][1] = out[1][2] = 1.0;
    out[0][2] = l;
    for (size_t k = 0; k < M; k++)
        for (size_t j = 0; j < RIGHT; j++) {
            const double change = p->response[k][j] + (j == 0 ? p->w[k] : 0.0);
            out[0][j] += l * l * r->twice[DEGREE][k] * change;
            out[1][j] += l * r->once[DEGREE][k] * change;
        }
    for (size_t i = 0; i < M; i++) {
        const double weight = l * r->weight[i];
        double turn[RIGHT] = {0.0, 1.0, l * r->t[i], 0.0, 0.0};
        for (size_t k = 0; k < M; k++)
            for (size_t j = 0; j < RIGHT; j++) turn[j] += l * l * r->twice[i][k] * p->response[k][j];
        out[2][0] += weight * p->cosine[i];
        out[3][0] += weight * p->sine[i];
        for (size_t j = 0; j < RIGHT; j++) {
            out[2][j] -= weight * p->sine[i] * turn[j];
            out[3][j] += weight * p->cosine[i] * turn[j];
        }
    }
}

/* ---- Newton's method for the whole beam ---- */

/* Fills the system of the joints. Rows: the first angle; continuity of theta and theta' at the end of each
 * panel; the last angle; the two components of the chord. Columns: changes of theta and theta' at the joints
 * 0..count; changes of the force; the right-hand side. */
static bool assemble(lg_collocation *c, const lg_beam *beam) {
    const size_t K = c->count, n = unknowns(K), columns = n + 1;
    double *a = c->matrix, out[4][RIGHT];
    memset(a, 0, n * columns * sizeof *a);
    a[0] = 1.0;
    a[n] = beam->first - c->panels[0].theta;
    double *last = a + (2 * K + 1) * columns, *chord = last + columns;
    last[2 * K] = 1.0;
    last[n] = beam->last - c->last;
    chord[n] = beam->d;
    for (size_t j = 0; j < K; j++) {
        panel *p = &c->panels[j];
        if (!panel_respond(&c->reference, c->force, p)) return false;
        panel_transfer(&c->reference, p, out);
        const double end[2] = {j + 1 < K ? p[1].theta : c->last, j + 1 < K ? p[1].slope : c->slope};
        for (int e = 0; e < 2; e++) {
            double *row = a + (1 + 2 * j + (size_t)e) * columns, *sum = chord + (size_t)e * columns;
            row[2 * j] = -out[e][1];
            row[2 * j + 1] = -out[e][2];
            row[2 * j + 2 + (size_t)e] = 1.0;
            row[n - 2] = -out[e][3];
            row[n - 1] = -out[e][4];
            row[n] = out[e][0] - end[e];
            sum[2 * j] += out[2 + e][1];
            sum[2 * j + 1] += out[2 + e][2];
            sum[n - 2] += out[2 + e][3];
            sum[n - 1] += out[2 + e][4];
            sum[n] -= out[2 + e][0];
        }
    }
    return true;
}

/* Takes one Newton step, shortened if an angle would change by more than STEP_MAX. Returns the largest change
 * of an angle before shortening, or NAN on failure. */
static double advance(lg_collocation *c, const lg_beam *beam) {
    const size_t K = c->count, n = unknowns(K), columns = n + 1;
    double *a = c->matrix, largest = 0.0;
    size_t pivot[2 * PANELS_MAX + 4];
    if (!assemble(c, beam) || !lg_matrix_factor(n, columns, a, pivot)) return NAN;
    lg_matrix_solve(n, columns, a, pivot, columns, a + n);
    for (size_t j = 0; j <= K; j++) {
        if (!isfinite(a[2 * j * columns + n])) return NAN;
        largest = fmax(largest, fabs(a[2 * j * columns + n]));
    }
    const double share = largest > STEP_MAX ? STEP_MAX / largest : 1.0;
    const double force[2] = {share * a[(n - 2) * columns + n], share * a[(n - 1) * columns + n]};
    for (size_t j = 0; j < K; j++) {
        panel *p = &c->panels[j];
        const double theta = share * a[2 * j * columns + n], slope = share * a[(2 * j + 1) * columns + n];
        for (size_t i = 0; i < M; i++)
            p->w[i] += share * p->response[i][0] + theta * p->response[i][1] + slope * p->response[i][2] +
                       force[0] * p->response[i][3] + force[1] * p->response[i][4];
        p->theta += theta;
        p->slope += slope;
    }
    c->last += share * a[2 * K * columns + n];
    c->slope += share * a[(2 * K + 1) * columns + n];
    c->force[0] += force[0];
    c->force[1] += force[1];
    return isfinite(c->force[0] + c->force[1]) ? largest : NAN;
}

static lg_status newton(lg_collocation *c, const lg_beam *beam) {
    double before = INFINITY;
    LG_TRY(make_room(c));
    for (int i = 0; i < ITERATIONS; i++) {
        if (lg_cancelled(c->context)) return LG_CANCELLED;
        const double now = advance(c, beam);
        if (!(now <= DBL_MAX)) return LG_NO_CONVERGENCE;
        c->iterations++;
        if (now < CONVERGED || (now < STAGNATION && now >= 0.25 * before)) return LG_OK;
        before = now;
    }
    return LG_NO_CONVERGENCE;
}

/* ---- defect and refinement of panels ---- */

/* Size of the terms of the differential equation: the largest of |force| and theta'^2/2. */
static double equation_scale(const lg_collocation *c) {
    double scale = hypot(c->force[0], c->force[1]);
    for (size_t j = 0; j < c->count; j++) scale = fmax(scale, 0.5 * c->panels[j].slope * c->panels[j].slope);
    return fmax(scale, 0.5 * c->slope * c->slope);
}

/* Largest |w - f(theta)| of a panel at the points between the collocation points. */
static double panel_defect(const reference *r, const double force[2], const panel *p) {
    double largest = 0.0;
    for (size_t i = 0; i < DEGREE; i++) {
        double w = 0.0, sum = 0.0;
        for (size_t k = 0; k < M; k++) {
            w += r->middle[i][k] * p->w[k];
            sum += r->middle_twice[i][k] * p->w[k];
        }
        const double theta = p->theta + p->length * (r->middle_t[i] * p->slope + p->length * sum);
        const double defect = fabs(w - force[0] * sin(theta) + force[1] * cos(theta));
        largest = defect > largest || isnan(defect) ? defect : largest;
    }
    return largest;
}

static bool has_tail(const reference *r, const double *values) {
    double tail = 0.0;
    for (size_t j = DEGREE - 1; j < M; j++) {
        double c = 0.0;
        for (size_t i = 0; i < M; i++) c += r->series[j][i] * values[i];
        tail = fmax(tail, fabs(c));
    }
    return tail > TAIL;
}

static void make_series(const reference *r, panel *p, double *x, double *y) {
    double c[M], once[M + 1], w[M + 2];
    values_to_series(r, p->w, c);
    integrate_series(c, M, once);
    integrate_series(once, M + 1, w);
    for (size_t j = 0; j < SERIES; j++) p->angles[j] = p->length * p->length * w[j];
    p->angles[0] += p->theta + 0.5 * p->length * p->slope; /* because t = (1 + T_1)/2 */
    p->angles[1] += 0.5 * p->length * p->slope;
    values_to_series(r, p->cosine, c);
    integrate_series(c, M, p->x);
    values_to_series(r, p->sine, c);
    integrate_series(c, M, p->y);
    for (size_t j = 0; j <= M; j++) {
        p->x[j] *= p->length;
        p->y[j] *= p->length;
    }
    p->x[0] += *x;
    p->y[0] += *y;
    *x = sum_series(p->x, M + 1, 1.0);
    *y = sum_series(p->y, M + 1, 1.0);
}

static void halve(const reference *r, const panel *p, panel out[2]) {
    double c[M], once[M + 1], twice[M + 2];
    values_to_series(r, p->w, c);
    integrate_series(c, M, once);
    integrate_series(once, M + 1, twice);
    for (int i = 0; i < 2; i++) {
        const double l = p->length, t = 0.5 * i;
        out[i].start = p->start + t * l;
        out[i].length = 0.5 * l;
        out[i].theta = p->theta + l * (t * p->slope + l * sum_series(twice, M + 2, t));
        out[i].slope = p->slope + l * sum_series(once, M + 1, t);
        for (size_t k = 0; k < M; k++) out[i].w[k] = sum_series(c, M, t + 0.5 * r->t[k]);
    }
}

/* Sets defect and gradient, makes the series of all panels, and halves the panels that are not fine enough.
 * *done tells that no panel had to be halved. */
static lg_status refine(lg_collocation *c, double tolerance, bool *done) {
    const double scale = equation_scale(c);
    size_t count = 0;
    double x = 0.0, y = 0.0;
    *done = true;
    c->gradient = 0.0;
    for (size_t j = 0; j < c->count; j++) {
        panel *p = &c->panels[j];
        panel_angles(&c->reference, p);
        const double defect = panel_defect(&c->reference, c->force, p);
        if (!(defect <= DBL_MAX)) return LG_NO_CONVERGENCE;
        c->gradient = fmax(c->gradient, defect);
        const bool fine = defect <= tolerance * scale && !has_tail(&c->reference, p->cosine) &&
                          !has_tail(&c->reference, p->sine);
        if (count + (fine ? 1 : 2) > PANELS_MAX) return LG_NO_CONVERGENCE;
        if (fine)
            c->halves[count] = *p;
        else
            halve(&c->reference, p, &c->halves[count]);
        count += fine ? 1 : 2;
        *done = *done && fine;
        make_series(&c->reference, p, &x, &y);
    }
    c->defect = c->gradient / scale; /* a beam longer than its chord is curved: scale > 0 */
    if (*done) return LG_OK;
    panel *swap = c->panels;
    c->panels = c->halves;
    c->halves = swap;
    c->count = count;
    return LG_OK;
}

/* ---- start, solution and sampling ---- */

/* A central difference of the angles theta (n + 1) at equidistant points, at s in [0, 1]. */
static double slope_at(size_t n, const double *theta, double s) {
    const double h = 1.0 / (double)n, low = fmax(s - h, 0.0), high = fmin(s + h, 1.0);
    return (lg_beam_angle_at(n, theta, high) - lg_beam_angle_at(n, theta, low)) / (high - low);
}

static void start(lg_collocation *c, const lg_beam *beam, const double *theta, const double force[2]) {
    const size_t n = beam->n;
    c->count = PANELS_FIRST;
    c->iterations = 0;
    memcpy(c->force, force, sizeof c->force);
    for (size_t j = 0; j < c->count; j++) {
        panel *p = &c->panels[j];
        p->length = 1.0 / (double)c->count;
        p->start = (double)j * p->length;
        p->theta = lg_beam_angle_at(n, theta, p->start);
        p->slope = slope_at(n, theta, p->start);
        for (size_t i = 0; i < M; i++) {
            const double angle = lg_beam_angle_at(n, theta, p->start + p->length * c->reference.t[i]);
            p->w[i] = force[0] * sin(angle) - force[1] * cos(angle);
        }
    }
    c->last = theta[n];
    c->slope = slope_at(n, theta, 1.0);
}

static double bending_energy(const lg_collocation *c) {
    const reference *r = &c->reference;
    double energy = 0.0;
    for (size_t j = 0; j < c->count; j++) {
        const panel *p = &c->panels[j];
        for (size_t i = 0; i < M; i++) {
            double slope = p->slope;
            for (size_t k = 0; k < M; k++) slope += p->length * r->once[i][k] * p->w[k];
            energy += 0.5 * p->length * r->weight[i] * slope * slope;
        }
    }
    return energy;
}

/* Newton's method and refinement, starting from the panels and force that are set. */
static lg_status solve_on(lg_collocation *collocation, const lg_beam *beam, double tolerance) {
    bool done = false;
    for (int i = 0; i < REFINEMENTS && !done; i++) {
        LG_TRY(newton(collocation, beam));
        LG_TRY(refine(collocation, fmax(tolerance, 16.0 * DBL_EPSILON), &done));
    }
    if (!done) return LG_NO_CONVERGENCE;
    collocation->energy = bending_energy(collocation);
    return LG_OK;
}

lg_status lg_collocation_solve(lg_collocation *collocation, const lg_beam *beam, const double *theta,
                               const double force[2], double tolerance) {
    start(collocation, beam, theta, force);
    return solve_on(collocation, beam, tolerance);
}

static void scale_angles(lg_collocation *c, double factor) {
    for (size_t j = 0; j < c->count; j++) {
        panel *p = &c->panels[j];
        p->theta *= factor;
        p->slope *= factor;
        for (size_t i = 0; i < M; i++) p->w[i] *= factor;
    }
    c->last *= factor;
    c->slope *= factor;
}

lg_status lg_collocation_solve_scaled(lg_collocation *collocation, const lg_beam *beam, double factor,
                                      double tolerance) {
    scale_angles(collocation, factor);
    return solve_on(collocation, beam, tolerance);
}

void lg_collocation_result_get(const lg_collocation *collocation, lg_collocation_result *out) {
    *out = (lg_collocation_result){.force = {collocation->force[0], collocation->force[1]},
                                   .energy = collocation->energy,
                                   .defect = collocation->defect,
                                   .gradient = collocation->gradient,
                                   .iterations = collocation->iterations};
}

void lg_collocation_sample(const lg_collocation *collocation, size_t n, double *theta, double *q) {
    size_t j = 0;
    for (size_t k = 0; k <= n; k++) {
        const double s = (double)k / (double)n;
        while (j + 1 < collocation->count && s >= collocation->panels[j + 1].start) j++;
        const panel *p = &collocation->panels[j];
        const double t = (s - p->start) / p->length;
        theta[k] = sum_series(p->angles, SERIES, t);
        if (!q) continue;
        q[2 * k] = sum_series(p->x, M + 1, t);
        q[2 * k + 1] = sum_series(p->y, M + 1, t);
    }
}
