/* Quadratic Lyapunov functions for large certified sets. In this file states are z = (x - goal)/scale. A
 * proposal is theta = (L row by row, K): V = |L^T z|^2 with L (n, n) lower triangular, and gains K (m, n) of
 * scaled states. The level of a proposal is the least V at which a point of a sample shows that V does not
 * fall, at most the level up to which {V <= level} is inside of the box. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "certify/evolution.h"
#include "core/portions.h"
#include "core/clean.h"
#include "kernels/matrix.h"
#include "liegrad/control.h"
#include "liegrad/lyapunov.h"

enum { STATES = 16, INPUTS = 16, MOST = STATES * (STATES + 1) / 2 + STATES * INPUTS, ROWS = 128, POOL = 512 };

/* The fractions of V up to the box at which a sample is tried. */
static const double fractions[] = {0.3, 0.5, 0.65, 0.8, 0.9, 1.0};
enum { FRACTIONS = sizeof fractions / sizeof *fractions };

typedef struct searching {
    const lg_context *context;
    const lg_lyapunov_search *spec;
    size_t n, m, numbers; /* numbers of theta */
    size_t generations;
    lg_plan *plan;                                                   /* of ROWS rows */
    double goal[STATES], scale[STATES], room[STATES], error[STATES]; /* room, error: scaled */
    double *y;                                                       /* (directions, n), of length 1 */
    double *pool;                                                    /* (POOL, n): z where proposals failed */
    size_t pooled, found;
    lg_evolution evolution;
    double values[64];
    unsigned char *desks;
    size_t desk_bytes, directions;
    double A[STATES * STATES], B[STATES * INPUTS]; /* scaled, of the linear loop z' = A z - B K z */
} searching;

/* Memory of one evaluation. */
typedef struct desk {
    double *z, *x, *rate, *K; /* (ROWS, n) three times, (m, n) */
    void *work;
} desk;

/* Desk number `number`; without memory for desks its bytes are counted. */
static desk desk_of(const searching *s, size_t number, size_t *bytes) {
    lg_portions from = {s->desks == NULL ? NULL : (char *)s->desks + number * s->desk_bytes, 0};
    desk d;
    double **const arrays[] = {&d.z, &d.x, &d.rate};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) *arrays[i] = lg_portion(&from, ROWS * s->n, sizeof *d.z);
    d.K = lg_portion(&from, s->m * s->n + 1, sizeof *d.K);
    d.work = lg_portion(&from, lg_plan_work_size(s->plan), 1);
    if (bytes != NULL) *bytes = from.used;
    return d;
}

void lg_lyapunov_search_init(lg_lyapunov_search *search) {
    if (search != NULL)
        *search = (lg_lyapunov_search){.size = sizeof *search, .directions = 400, .seed = 1, .threads = 1};
}

/* ---- a proposal ---- */

typedef struct form {
    double L[STATES * STATES], P[STATES * STATES], T[STATES * STATES]; /* P = L L^T, T = L^-T */
    double top;                                                        /* {V <= top} touches the box */
    double logarithm;                                                  /* of det L */
    double margin;                                                     /* V'/V must be below -margin */
} form;

static bool read_form(const searching *s, const double *theta, form *f) {
    const size_t n = s->n;
    size_t at = 0;
    memset(f, 0, sizeof *f);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++) f->L[i * n + j] = theta[at++];
    for (size_t i = 0; i < n; i++) {
        f->logarithm += log(fabs(f->L[i * (n + 1)]));
        if (!isfinite(f->logarithm)) return false;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            for (size_t k = 0; k < n; k++) f->P[i * n + j] += f->L[i * n + k] * f->L[j * n + k];
    lg_matrix_invert_transposed(n, f->L, f->T);
    f->top = (double)INFINITY;
    for (size_t i = 0; i < n; i++) {
        double row = 0;
        for (size_t j = 0; j < n; j++) row += f->T[i * n + j] * f->T[i * n + j];
        f->top = fmin(f->top, s->room[i] * s->room[i] / row * (1 - 1e-6));
    }
    if (!isfinite(f->top)) { /* without a box: up to a hundred sizes */
        double row = 0;
        for (size_t j = 0; j < n; j++) row += f->T[j] * f->T[j];
        f->top = 1e4 / row;
    }
    return f->top > 0;
}

/* V' of the first `rows` rows of d->z (steps: V(F) - V), over V, plus the margin. */
static void evaluate(const searching *s, const form *f, const desk *d, size_t rows, double *rise) {
    const size_t n = s->n;
    for (size_t r = rows; r < ROWS; r++) memcpy(d->z + r * n, d->z, n * sizeof *d->z);
    for (size_t i = 0; i < ROWS * n; i++) d->x[i] = s->goal[i % n] + s->scale[i % n] * d->z[i];
    lg_plan_eval(s->plan, (const void *[]){d->x, d->K}, (void *[]){d->rate}, d->work);
    for (size_t r = 0; r < rows; r++) {
        double V = 0, change = 0, next[STATES];
        const double *z = d->z + r * n, *rate = d->rate + r * n;
        for (size_t i = 0; i < n; i++)
            next[i] = s->spec->step ? (rate[i] - s->goal[i]) / s->scale[i] : rate[i] / s->scale[i];
        for (size_t i = 0; i < n; i++) {
            double Pz = 0, Pn = 0;
            for (size_t j = 0; j < n; j++) Pz += f->P[i * n + j] * z[j], Pn += f->P[i * n + j] * next[j];
            V += z[i] * Pz;
            change += s->spec->step ? next[i] * Pn - z[i] * Pz : 2 * next[i] * Pz;
            change += 2 * fabs(s->spec->step ? Pn : Pz) * s->error[i];
        }
        rise[r] = isnan(change) ? (double)INFINITY : change / V + f->margin;
    }
}

/* The least fraction at which V does not fall along a ray whose place is between two fractions. */
typedef struct ray {
    double z[STATES]; /* where V = top */
    double low, high;
} ray;

enum { HALVINGS = 5 };

static double refine(const searching *s, const form *f, const desk *d, ray *rays, size_t count) {
    double rise[ROWS], least = (double)INFINITY;
    for (int k = 0; k < HALVINGS; k++) {
        for (size_t r = 0; r < count; r++)
            for (size_t i = 0; i < s->n; i++)
                d->z[r * s->n + i] = rays[r].z[i] * sqrt(0.5 * (rays[r].low + rays[r].high));
        evaluate(s, f, d, count, rise);
        for (size_t r = 0; r < count; r++)
            *(rise[r] >= 0 ? &rays[r].high : &rays[r].low) = 0.5 * (rays[r].low + rays[r].high);
    }
    for (size_t r = 0; r < count; r++) least = fmin(least, rays[r].low);
    return least;
}

/* z at V = top in direction number i: of the sample, then of the pool. */
static void aim(const searching *s, const form *f, size_t number, double *z) {
    const size_t n = s->n;
    if (number < s->directions) {
        const double *y = s->y + number * n;
        for (size_t i = 0; i < n; i++) {
            z[i] = 0;
            for (size_t j = i; j < n; j++) z[i] += f->T[i * n + j] * y[j];
            z[i] *= sqrt(f->top);
        }
        return;
    }
    const double *at = s->pool + (number - s->directions) * n;
    double V = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) V += at[i] * f->P[i * n + j] * at[j];
    for (size_t i = 0; i < n; i++) z[i] = at[i] * sqrt(f->top / V);
}

/* The fraction of top below which V falls at all points that are tried along the directions first, first + 1,
 * ... (count), and not above `most`. */
static double fraction_of(const searching *s, const form *f, const desk *d, size_t first, size_t count,
                          double most) {
    double aims[ROWS][STATES], rise[ROWS];
    ray rays[ROWS];
    for (size_t r = 0; r < count; r++) aim(s, f, first + r, aims[r]);
    for (size_t k = 0; k < FRACTIONS && (k == 0 || fractions[k - 1] < most); k++) {
        size_t failing = 0;
        for (size_t r = 0; r < count; r++)
            for (size_t i = 0; i < s->n; i++) d->z[r * s->n + i] = aims[r][i] * sqrt(fractions[k]);
        evaluate(s, f, d, count, rise);
        for (size_t r = 0; r < count; r++) {
            if (rise[r] < 0) continue;
            memcpy(rays[failing].z, aims[r], sizeof aims[r]);
            rays[failing].low = k > 0 ? fractions[k - 1] : 0;
            rays[failing++].high = fractions[k];
        }
        if (failing > 0) return fmin(most, refine(s, f, d, rays, failing));
    }
    return most;
}

/* Of the mean rate at which V falls near the goal, but at most half of the least rate: a smaller rate
 * elsewhere costs proofs many boxes. */
static const double margin = 0.02;

/* How fast V falls near the goal: the least eigenvalue of -T^T (C^T P + P C) T (steps: 1 - T^T C^T P C T),
 * over the mean of the eigenvalues, with the linear loop C = A - B K. At most 0: it does not fall. */
static double fall_near(const searching *s, form *f, const double *K) {
    const size_t n = s->n, m = s->m;
    double C[STATES * STATES], CT[STATES * STATES], M[STATES * STATES], w[STATES], mean = 0;
    memcpy(C, s->A, n * n * sizeof *C);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            for (size_t l = 0; l < m; l++) C[i * n + j] -= s->B[i * m + l] * K[l * n + j];
    lg_matrix_multiply(n, n, n, C, f->T, CT);
    lg_matrix_multiply_tn(n, n, n, f->L, CT, C); /* L^T C T: the loop in y */
    lg_matrix_multiply_tn(n, n, n, C, C, M);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            CT[i * n + j] = s->spec->step ? (i == j) - M[i * n + j] : -C[i * n + j] - C[j * n + i];
            if (!isfinite(CT[i * n + j])) return -1;
            if (i == j) mean += CT[i * n + j] / (double)n;
        }
    const bool found = lg_matrix_eigen(n, false, CT, w);
    f->margin = fmin(margin * mean, 0.5 * w[0]);
    return found && mean > 0 ? w[0] / mean : -1;
}

/* What a slow fall near the goal costs: proofs need boxes there. */
static const double slowness = 0.05;

/* The logarithm of the volume of {V <= level}, up to a constant, less a little for a slow fall near the goal;
 * NaN: no set. */
static double worth(const searching *s, const double *theta, const desk *d, double *level) {
    form f;
    double fraction = 1;
    const size_t n = s->n, all = s->directions + s->pooled;
    const double *K = theta + n * (n + 1) / 2;
    if (!read_form(s, theta, &f)) return (double)NAN;
    const double near = fall_near(s, &f, K);
    if (!(near > 1e-6)) return (double)NAN;
    for (size_t i = 0; i < s->m * n; i++) d->K[i] = K[i] / s->scale[i % n];
    for (size_t first = 0; first < all && fraction > 0; first += ROWS)
        fraction = fraction_of(s, &f, d, first, all - first < ROWS ? all - first : ROWS, fraction);
    *level = fraction * f.top;
    if (!(fraction > 0)) return (double)NAN;
    return 0.5 * (double)n * log(*level) - f.logarithm + slowness * log(near);
}

/* ---- the linear loop ---- */

static lg_status column_of(searching *s, const desk *d, size_t i, size_t input, double step, double *column) {
    const size_t n = s->n;
    double rates[2][STATES];
    for (int side = 0; side < 2; side++) {
        memset(d->K, 0, s->m * n * sizeof *d->K);
        if (input < s->m) d->K[input * n + i] = 1 / s->scale[i];
        for (size_t r = 0; r < ROWS * n; r++) d->x[r] = s->goal[r % n];
        d->x[i] += (side == 0 ? 1 : -1) * step * s->scale[i];
        lg_plan_eval(s->plan, (const void *[]){d->x, d->K}, (void *[]){d->rate}, d->work);
        memcpy(rates[side], d->rate, n * sizeof *d->rate);
    }
    for (size_t k = 0; k < n; k++) {
        column[k] = (rates[0][k] - rates[1][k]) / (2 * step * s->scale[k]);
        if (!isfinite(column[k])) return LG_NOT_FINITE;
    }
    return LG_OK;
}

/* A (n, n) without gains, and B from what a gain of 1 on the first state changes. */
static lg_status linearise(searching *s) {
    static const double step = 1e-6;
    const desk d = desk_of(s, 0, NULL);
    double column[STATES];
    for (size_t i = 0; i < s->n; i++) {
        LG_TRY(column_of(s, &d, i, SIZE_MAX, step, column));
        for (size_t k = 0; k < s->n; k++) s->A[k * s->n + i] = column[k];
    }
    for (size_t l = 0; l < s->m; l++) {
        LG_TRY(column_of(s, &d, 0, l, step, column));
        for (size_t k = 0; k < s->n; k++) s->B[k * s->m + l] = s->A[k * s->n] - column[k];
    }
    return LG_OK;
}

/* ---- first proposals ---- */

enum { STARTS = 400, CLIMBS = 3 };

/* A regulator for weights that are drawn over some orders of magnitude; its gains are multiplied by a number
 * about 1. Units of time and inputs do not matter: A and the columns of B are divided by their norms. */
static bool draw_start(const searching *s, lg_rng *rng, void *work, size_t bytes, double *theta) {
    const size_t n = s->n, m = s->m, inputs = m > 0 ? m : 1;
    double A[STATES * STATES], B[STATES * INPUTS] = {0}, Q[STATES * STATES] = {0}, R[INPUTS * INPUTS] = {0};
    double P[STATES * STATES], K[STATES * INPUTS], L[STATES * STATES], norm[INPUTS];
    const double speed = s->spec->step ? 1 : lg_matrix_norm(n * n, s->A);
    for (size_t i = 0; i < n * n; i++) A[i] = s->A[i] / speed;
    for (size_t l = 0; l < inputs; l++) {
        norm[l] = 0;
        for (size_t k = 0; k < n && m > 0; k++) norm[l] = hypot(norm[l], s->B[k * m + l]);
        for (size_t k = 0; k < n && norm[l] > 0; k++) B[k * inputs + l] = s->B[k * m + l] / norm[l];
        R[l * (inputs + 1)] = pow(10, lg_rng_uniform_in(rng, -3, s->spec->step ? 5 : 1));
    }
    for (size_t i = 0; i < n; i++) Q[i * (n + 1)] = pow(10, lg_rng_uniform_in(rng, -2.5, 1));
    const double factor = pow(2, lg_rng_uniform_in(rng, -0.5, 0.5));
    const lg_riccati equation = {sizeof equation, n, inputs, A, B, Q, R, NULL};
    const lg_status status =
        (s->spec->step ? lg_dare : lg_care)(&equation, P, K, NULL, NULL, work, bytes, NULL);
    if (status != LG_OK || !lg_matrix_cholesky(n, P, L)) return false;
    const double size = sqrt(P[0]);
    size_t at = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++) theta[at++] = L[i * n + j] / size;
    for (size_t i = 0; i < m * n; i++) theta[at++] = factor * K[i] * speed / norm[i / n];
    return true;
}

typedef struct best {
    double value, level, theta[MOST];
} best;

static void sort_in(best *b, const double *theta, size_t numbers, double value, double level) {
    if (!(value > b[CLIMBS - 1].value)) return;
    size_t i = CLIMBS - 1;
    for (; i > 0 && value > b[i - 1].value; i--) b[i] = b[i - 1];
    b[i].value = value, b[i].level = level;
    memcpy(b[i].theta, theta, numbers * sizeof *theta);
}

static lg_status fails_everywhere(lg_error *error) {
    return lg_fail(
        error, LG_CHECK_FAILED,
        "no quadratic V falls at all points of a set about the goal, with the given error of the model");
}

static lg_status first_proposals(searching *s, best *b, lg_error *error) {
    const size_t bytes = lg_riccati_work_size(s->n, s->m > 0 ? s->m : 1);
    LG_TRY_SCRATCH(char, work, s->context, bytes, LG_OUT_OF_MEMORY);
    const desk d = desk_of(s, 0, NULL);
    lg_rng rng;
    lg_rng_seed(&rng, s->spec->seed, 12);
    size_t stable = 0;
    for (size_t i = 0; i < CLIMBS; i++) b[i].value = -INFINITY;
    for (size_t i = 0; i < STARTS; i++) {
        double theta[MOST], level = 0;
        if (!draw_start(s, &rng, work, bytes, theta)) continue;
        stable++;
        const double value = worth(s, theta, &d, &level);
        if (value == value) sort_in(b, theta, s->numbers, value, level);
    }
    if (b[0].value > -INFINITY) return LG_OK;
    if (stable > 0) return fails_everywhere(error);
    return lg_fail(error, LG_CHECK_FAILED,
                   "no quadratic V falls near the goal: the linear closed loop is not %s",
                   s->m > 0 ? "stabilised by any gains that were tried" : "stable");
}

/* ---- where a proposal fails ---- */

typedef struct attacker {
    double y[STATES], rise; /* |y| = 1 */
} attacker;

/* A point z of the set near the attacker's ray. The points fill the outer half of the set. */
static void place(const searching *s, const form *f, const attacker *a, double spread, size_t row,
                  double level, lg_rng *rng, double *z) {
    const size_t n = s->n;
    const double far = sqrt(level * (1 - 0.5 * (double)row / ROWS));
    double y[STATES], length = 0;
    for (size_t i = 0; i < n; i++) {
        y[i] = a->y[i] + spread * lg_rng_normal(rng);
        length = hypot(length, y[i]);
    }
    for (size_t i = 0; i < n; i++) {
        z[i] = 0;
        for (size_t j = i; j < n; j++) z[i] += f->T[i * n + j] * y[j] / length * far;
    }
}

/* The attacker moves to z, where V' is larger. Where V does not fall, z joins the pool. */
static void move(searching *s, const form *f, attacker *a, const double *z, double rise) {
    const size_t n = s->n;
    double length = 0;
    a->rise = rise;
    for (size_t i = 0; i < n; i++) { /* y = L^T z */
        a->y[i] = 0;
        for (size_t j = i; j < n; j++) a->y[i] += f->L[j * n + i] * z[j];
        length = hypot(length, a->y[i]);
    }
    for (size_t i = 0; i < n; i++) a->y[i] /= length;
    if (rise < 0) return;
    memcpy(s->pool + s->found++ % POOL * n, z, n * sizeof *z);
    s->pooled = s->found < POOL ? s->found : POOL;
}

/* Looks for points of the proposal's set at which V does not fall: random points, then shorter and shorter
 * steps. */
static void attack(searching *s, const best *b, lg_rng *rng) {
    enum { STEPS = 12 };
    const size_t n = s->n;
    const desk d = desk_of(s, 0, NULL);
    attacker attackers[ROWS] = {{{0}, 0}};
    double rise[ROWS], spread = 1;
    form f;
    (void)read_form(s, b->theta, &f);
    (void)fall_near(s, &f, b->theta + n * (n + 1) / 2);
    for (size_t i = 0; i < s->m * n; i++) d.K[i] = b->theta[n * (n + 1) / 2 + i] / s->scale[i % n];
    for (int step = 0; step < STEPS; step++, spread = 0.5 * pow(0.75, step)) {
        for (size_t r = 0; r < ROWS; r++) place(s, &f, &attackers[r], spread, r, b->level, rng, d.z + r * n);
        evaluate(s, &f, &d, ROWS, rise);
        for (size_t r = 0; r < ROWS; r++)
            if (step == 0 || rise[r] > attackers[r].rise) move(s, &f, &attackers[r], d.z + r * n, rise[r]);
    }
}

/* ---- the search ---- */

static void task(void *user, size_t number) {
    searching *s = user;
    const desk d = desk_of(s, number, NULL);
    double level;
    s->values[number] = worth(s, s->evolution.x + number * s->numbers, &d, &level);
}

static void spread_of(const searching *s, const double *theta, double *spread) {
    const size_t n = s->n;
    size_t at = 0;
    for (size_t i = 0; i < n; i++) {
        double row = 0;
        for (size_t j = 0; j <= i; j++) row = hypot(row, theta[at + j]);
        for (size_t j = 0; j <= i; j++) spread[at++] = 0.05 * row;
    }
    for (size_t l = 0; l < s->m; l++) {
        double row = 0;
        for (size_t i = 0; i < n; i++) row = hypot(row, theta[at + i]);
        for (size_t i = 0; i < n; i++, at++) spread[at] = 0.05 * (fabs(theta[at]) + 0.1 * row);
    }
}

/* Judges the best proposal again, with all of the pool, and another one that may replace it. */
static void judge(const searching *s, const double *other, best *b) {
    const desk d = desk_of(s, 0, NULL);
    double level = 0, value = worth(s, b->theta, &d, &b->level);
    b->value = value == value ? value : -DBL_MAX;
    value = worth(s, other, &d, &level);
    if (!(value > b->value)) return;
    b->value = value, b->level = level;
    memcpy(b->theta, other, s->numbers * sizeof *other);
}

/* Climbs from *b; every ten generations the best proposal is attacked. */
static lg_status climb(searching *s, lg_thread_pool *pool, size_t generations, uint64_t stream, best *b) {
    enum { BETWEEN = 10 };
    double spread[MOST];
    const size_t members = s->evolution.members;
    lg_rng rng;
    lg_rng_seed(&rng, s->spec->seed, 100 + stream);
    spread_of(s, b->theta, spread);
    LG_TRY(lg_evolution_begin(s->context, s->numbers, members, b->theta, spread, s->spec->seed + stream,
                              &s->evolution));
    lg_status status = LG_OK;
    for (size_t g = 0; g < generations && status == LG_OK; g++) {
        if (lg_cancelled(s->context)) status = LG_CANCELLED;
        lg_evolution_ask(&s->evolution);
        lg_thread_pool_run(pool, members, task, s);
        for (size_t i = 0; i < members; i++)
            if (s->values[i] > b->value) {
                b->value = s->values[i];
                memcpy(b->theta, s->evolution.x + i * s->numbers, s->numbers * sizeof *b->theta);
            }
        lg_evolution_tell(&s->evolution, s->values);
        if (g % BETWEEN != BETWEEN - 1) continue;
        judge(s, s->evolution.mean, b);
        attack(s, b, &rng);
        judge(s, s->evolution.mean, b);
    }
    lg_evolution_end(s->context, &s->evolution);
    s->evolution = (lg_evolution){.members = members};
    return status;
}

static lg_status run(searching *s, best *b, lg_error *error) {
    LG_CLEAN(lg_thread_pool_destroy_at) lg_thread_pool *pool = NULL;
    size_t lead = 0;
    if (linearise(s) != LG_OK)
        return lg_fail(error, LG_CHECK_FAILED, "the closed loop is not finite near the goal");
    LG_TRY(first_proposals(s, b, error));
    LG_TRY(lg_thread_pool_create(s->context, s->spec->threads, &pool));
    for (size_t i = 0; i < CLIMBS; i++)
        if (b[i].value > -INFINITY) LG_TRY(climb(s, pool, s->generations / 6, i, &b[i]));
    for (size_t i = 0; i < CLIMBS; i++) {
        if (b[i].value > -INFINITY) judge(s, b[i].theta, &b[i]);
        if (b[i].value > b[lead].value) lead = i;
    }
    if (lead != 0) b[0] = b[lead];
    LG_TRY(climb(s, pool, s->generations / 2, CLIMBS, &b[0]));
    return b[0].value == -DBL_MAX ? fails_everywhere(error) : LG_OK;
}

static void write_out(const searching *s, const best *b, double *P, double *K, double *volume) {
    const size_t n = s->n;
    const double half = 0.5 * (double)n;
    form f;
    (void)read_form(s, b->theta, &f);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            P[i * n + j] = (f.P[i * n + j] + f.P[j * n + i]) / (2 * b->level * s->scale[i] * s->scale[j]);
    for (size_t i = 0; i < s->m * n; i++) K[i] = b->theta[n * (n + 1) / 2 + i] / s->scale[i % n];
    if (volume == NULL) return;
    *volume = exp(half * log(b->level) - f.logarithm) * pow(3.14159265358979, half) / tgamma(half + 1);
    for (size_t i = 0; i < n; i++) *volume *= s->scale[i];
}

/* ---- what a caller sees ---- */

static lg_status take_ports(searching *s, const lg_program *program, lg_error *error) {
    size_t function, inputs, outputs;
    LG_TRY(lg_program_find(program, s->spec->rate, &function, error));
    const lg_port *in = lg_program_inputs(program, function, &inputs);
    const lg_port *out = lg_program_outputs(program, function, &outputs);
    s->n = inputs >= 1 && inputs <= 2 && !in[0].shared && in[0].shape.rank == 1 ? in[0].shape.dims[0] : 0;
    const bool gains = inputs == 2 && in[1].shared && in[1].shape.rank == 2 && in[1].shape.dims[1] == s->n;
    s->m = gains ? in[1].shape.dims[0] : 0;
    if (s->n < 1 || s->n > STATES || s->m > INPUTS || (inputs == 2 && !gains) || outputs < 1 ||
        lg_shape_count(out[0].shape) != s->n)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the function '%s' needs one input of 1 to %d states, perhaps gains K (inputs, states), "
            "and as many outputs as states",
            s->spec->rate, STATES);
    s->numbers = s->n * (s->n + 1) / 2 + s->m * s->n;
    s->generations = s->spec->generations > 0 ? s->spec->generations : 100 * s->numbers;
    return LG_OK;
}

static lg_status take_box(searching *s, lg_error *error) {
    const lg_lyapunov_search *spec = s->spec;
    for (size_t i = 0; i < s->n; i++) {
        s->goal[i] = spec->goal != NULL ? spec->goal[i] : 0;
        const double room = fmin(spec->high[i] - s->goal[i], s->goal[i] - spec->low[i]);
        s->scale[i] = spec->scale != NULL ? spec->scale[i] : room;
        s->room[i] = room / s->scale[i];
        s->error[i] = spec->model_error != NULL ? spec->model_error[i] / s->scale[i] : 0;
        if (!(room > 0) || !(s->scale[i] > 0 && isfinite(s->scale[i])) || !(s->error[i] >= 0))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "state %zu: the box must hold the goal, sizes must be finite and above 0", i);
    }
    return LG_OK;
}

static lg_status prepare(searching *s, const lg_program *program, lg_error *error) {
    lg_rng rng;
    LG_TRY(lg_program_plan(program, s->spec->rate, LG_F64, ROWS, &s->plan, error));
    const size_t members = 4 + (size_t)(3 * log((double)s->numbers)), n = s->n;
    s->evolution.members = members;
    (void)desk_of(s, 0, &s->desk_bytes);
    LG_TRY(LG_ALLOC_ALL(s->context, {&s->desks, members, s->desk_bytes},
                        LG_ARRAY(s->y, (s->directions + POOL) * n)));
    s->pool = s->y + s->directions * n;
    lg_rng_seed(&rng, s->spec->seed, 13);
    for (size_t r = 0; r < s->directions; r++) {
        double length = 0;
        for (size_t i = 0; i < n; i++) length = hypot(length, s->y[r * n + i] = lg_rng_normal(&rng));
        for (size_t i = 0; i < n; i++) s->y[r * n + i] /= length;
    }
    return LG_OK;
}

lg_status lg_lyapunov_quadratic(const lg_context *context, const lg_program *program,
                                const lg_lyapunov_search *search, double *P, double *K, double *volume,
                                lg_error *error) {
    LG_NEEDS(error, program, search, P);
    LG_NEEDS(error, search->rate, search->low, search->high);
    if (search->size != sizeof *search || search->directions < 10 || search->directions > 1000000 ||
        search->threads < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "threads must be 1 or more, directions 10 to 1e6");
    best b[CLIMBS];
    searching s = {.context = context, .spec = search, .directions = search->directions};
    LG_TRY(take_ports(&s, program, error));
    if (s.m > 0 && K == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the function '%s' has gains, but K is NULL",
                       search->rate);
    LG_TRY(take_box(&s, error));
    lg_status status = prepare(&s, program, error);
    if (status == LG_OK) status = run(&s, b, error);
    if (status == LG_OK) write_out(&s, &b[0], P, K, volume);
    lg_plan_destroy(s.plan);
    LG_FREE_ALL(context, s.desks, s.y);
    return status == LG_OUT_OF_MEMORY ? lg_fail(error, status, "no memory for a search") : status;
}
