/* Policies: the regulator at the goal, its region by runs, and the scales that follow from the machine's
 * motion. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "control/policy.h"
#include "core/median.h"
#include "kernels/matrix.h"
#include "liegrad/control.h"
#include "liegrad/minimise.h"

typedef struct design {
    lg_policy *policy, *sliding; /* sliding: without dry friction; NULL: the plant has none */
    uint32_t n, m;               /* errors, inputs */
    double *A, *B;               /* z+ = A z + B (u - u0) */
    /* (errors, inputs): how the change of z in a period depends on u where the lagged inputs equal u */
    double *rest;
    double size[LG_POLICY_ERRORS]; /* of the errors: of starts, or of unforced motion */
    double *z, *x;                 /* samples: (SAMPLES, errors), (SAMPLES, state) */
    bool *held;
    uint64_t seed;
    lg_error *error;
} design;

enum { SAMPLES = 128 };

/* ---- the equilibrium ---- */

/* Computes A, B and `rest` at the goal, where the lagged inputs equal u. `change` becomes the change of z in
 * a period. */
static lg_status linearise(const design *d, const double *u, double *change, lg_error *error) {
    const lg_policy *p = d->sliding != NULL ? d->sliding : d->policy;
    double z[LG_POLICY_ERRORS] = {0};
    const double *const in[2] = {z, u};
    for (uint32_t k = 0; k < p->task.coordinate_count; k++) {
        const lg_policy_coordinate *c = &p->task.coordinate[k];
        if (c->follows > 0) z[p->layout.at[k].error] = u[c->follows - 1] - c->goal[0];
    }
    LG_TRY(lg_program_eval(p->context, p->program, "linear", 1, in, (double *const[]){change}, error));
    LG_TRY(
        lg_program_eval(p->context, p->program, "jac_linear", 1, in, (double *const[]){d->A, d->B}, error));
    memcpy(d->rest, d->B, (size_t)d->n * d->m * sizeof *d->rest);
    for (uint32_t i = 0; i < d->n; i++) change[i] -= z[i];
    for (uint32_t k = 0; k < p->task.coordinate_count; k++) {
        const uint32_t input = p->task.coordinate[k].follows, at = p->layout.at[k].error;
        if (input == 0) continue;
        for (uint32_t i = 0; i < d->n; i++) d->rest[i * d->m + input - 1] += d->A[i * d->n + at];
        d->rest[at * d->m + input - 1] -= 1.0;
    }
    return LG_OK;
}

/* The least squares solution of `rest` y = -z in inputs of their range. */
static lg_status correct(const design *d, const double *z, double *u) {
    double matrix[LG_POLICY_INPUTS * LG_POLICY_INPUTS] = {0}, right[LG_POLICY_INPUTS] = {0},
                                     range[LG_POLICY_INPUTS];
    for (uint32_t l = 0; l < d->m; l++)
        range[l] = d->policy->task.input[l].high - d->policy->task.input[l].low;
    for (uint32_t a = 0; a < d->m; a++)
        for (uint32_t i = 0; i < d->n; i++) {
            const double weight = 1.0 / (d->size[i] * d->size[i]), row = d->rest[i * d->m + a] * range[a];
            right[a] -= weight * row * z[i];
            for (uint32_t b = 0; b < d->m; b++)
                matrix[a * d->m + b] += weight * row * d->rest[i * d->m + b] * range[b];
        }
    LG_TRY(lg_normal_equations(d->m, 1, 1e-12, matrix, right));
    for (uint32_t l = 0; l < d->m; l++) u[l] += range[l] * right[l];
    return LG_OK;
}

/* Each error z_i changes in a period that begins at the goal. Returns the largest |change of z_i|/(size of
 * z_i); *which is its i. */
static double residual_of(const design *d, const double *z, uint32_t *which) {
    double most = 0.0;
    for (uint32_t i = 0; i < d->n; i++)
        if (!(fabs(z[i]) / d->size[i] <= most)) most = fabs(z[i]) / d->size[i], *which = i;
    return most;
}

/* The coordinate of error i. */
static const lg_policy_coordinate *owner_of(const lg_policy *p, uint32_t i) {
    return &p->task.coordinate[p->layout.owner[i]];
}

/* Returns true if error i is the error of a velocity. */
static bool is_rate(const lg_policy *p, uint32_t i) {
    return i >= p->layout.at[0].rate;
}

/* Newton's method. u is the first guess on entry and the last iterate on return; *residual is the residual of
 * the last iterate. */
static lg_status find_rest(const design *d, double *u, double *residual, double *change, uint32_t *which) {
    for (int i = 0;; i++) {
        LG_TRY(linearise(d, u, change, d->error));
        *residual = residual_of(d, change, which);
        if (*residual < 1e-12 || i == 7 || correct(d, change, u) != LG_OK) return LG_OK;
    }
}

/* The first guess is u = 0. If Newton's method finds no equilibrium from there, such as in a dead zone, it
 * starts again from inputs within the limits. */
static lg_status find_equilibrium(design *d) {
    static const double most = 5e-3; /* learned machines have their equilibrium near the goal */
    static const double guesses[] = {0.5, 0.75, 0.25, 0.95, 0.05};
    lg_policy *p = d->policy;
    double *u = p->regulator.u0, change[LG_POLICY_ERRORS];
    uint32_t which = 0;
    for (uint32_t l = 0; l < d->m; l++) u[l] = fmin(fmax(0.0, p->task.input[l].low), p->task.input[l].high);
    LG_TRY(find_rest(d, u, &p->regulator.residual, change, &which));
    for (size_t g = 0; g < LG_COUNT(guesses) && !(p->regulator.residual <= most); g++) {
        double from[LG_POLICY_INPUTS], residual, moved[LG_POLICY_ERRORS];
        uint32_t other = 0;
        for (uint32_t l = 0; l < d->m; l++)
            from[l] = p->task.input[l].low + guesses[g] * (p->task.input[l].high - p->task.input[l].low);
        LG_TRY(find_rest(d, from, &residual, moved, &other));
        if (!(residual <= most)) continue;
        memcpy(u, from, d->m * sizeof *u);
        p->regulator.residual = residual;
    }
    if (!(p->regulator.residual <= most))
        return lg_fail(
            d->error, LG_CHECK_FAILED,
            "the goal is not an equilibrium under any constant input: from there %s changes by %.3g in a "
            "period of %g s",
            is_rate(p, which) ? owner_of(p, which)->velocity : owner_of(p, which)->name, change[which],
            p->task.period);
    for (uint32_t l = 0; l < d->m; l++) {
        const lg_policy_input *in = &p->task.input[l];
        if (!(p->regulator.u0[l] > in->low && p->regulator.u0[l] < in->high))
            return lg_fail(
                d->error, LG_CHECK_FAILED,
                "to stay at the goal, the input %s must be %.4g, which is not inside its limits %g to %g",
                in->name, p->regulator.u0[l], in->low, in->high);
    }
    return LG_OK;
}

/* ---- sizes of errors ---- */

/* Of each error the largest of the starts; where these are all 0, the bound of success, or that of the
 * unforced motion. Of a lagged input half the range of the input. */
void lg_policy_find_sizes(const lg_policy *p, double *sizes) {
    for (uint32_t i = 0; i < p->layout.errors; i++) {
        const lg_policy_coordinate *c = owner_of(p, i);
        const double far = lg_policy_reach(c->start), fast = lg_policy_reach(c->start_velocity);
        const double size = far > 0                ? far
                            : c->follows > 0       ? lg_policy_half_range(p, c->follows - 1)
                            : isfinite(c->success) ? c->success
                                                   : 1.0,
                     rate = fast > 0                        ? fast
                            : isfinite(c->success_velocity) ? c->success_velocity
                                                            : size / (10.0 * p->task.period);
        sizes[i] = is_rate(p, i) ? rate : size;
        if (c->integrates > 0) /* It grows for a tenth of the horizon. */
            sizes[i] = 0.1 * p->task.horizon * sizes[p->layout.at[c->integrates - 1].error];
    }
}

/* ---- weights, and the region by runs ---- */

/* Of inputs over their range, of velocities over their size, and a factor on coordinates whose position
 * (velocity, if the position is free) success does not bound; positions over their size weigh 1. */
typedef struct weights {
    double input, rate, loose;
} weights;

/* Weights of scaled errors and inputs: each error is divided by its size, each input by half its range. w
 * NULL: those of the cost. */
static void fill_weights(const design *d, const weights *w, double *Q, double *R) {
    const lg_policy *p = d->policy;
    for (uint32_t i = 0; i < d->n; i++) {
        const lg_policy_coordinate *c = owner_of(p, i);
        const double bound = c->free ? c->success_velocity : c->success,
                     factor = w == NULL         ? c->weight
                              : c->ago > 0      ? 0.0
                              : isfinite(bound) ? 1.0
                                                : w->loose,
                     of_rate = w == NULL ? c->weight_velocity : factor * w->rate,
                     unit = w == NULL ? d->size[i] * d->size[i] : 1.0;
        Q[i * (d->n + 1)] = (is_rate(p, i) ? of_rate : factor) * unit;
    }
    for (uint32_t l = 0; l < d->m; l++)
        R[l * (d->m + 1)] = w != NULL ? w->input
                                      : p->task.input[l].weight * lg_policy_half_range(d->policy, l) *
                                            lg_policy_half_range(d->policy, l);
}

/* The equation of scaled errors and inputs is solved, so that units do not matter; K and P are in the
 * task's units. */
static lg_status solve(const design *d, const weights *w, double *K, double *P, double *radius,
                       lg_error *error) {
    lg_policy *p = d->policy;
    const uint32_t n = d->n, m = d->m;
    const size_t bytes = lg_riccati_work_size(n, m);
    lg_riccati_result result;
    LG_TRY_SCRATCH(double, A, p->context, 2 * n * n + n * m + m * m, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(char, work, p->context, bytes, LG_OUT_OF_MEMORY);
    double *B = A + n * n, *Q = B + n * m, *R = Q + n * n;
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) A[i * n + j] = d->A[i * n + j] * d->size[j] / d->size[i];
        for (uint32_t l = 0; l < m; l++)
            B[i * m + l] = d->B[i * m + l] * lg_policy_half_range(d->policy, l) / d->size[i];
    }
    fill_weights(d, w, Q, R);
    const lg_riccati equation = {sizeof equation, n, m, A, B, Q, R, NULL};
    LG_TRY(lg_dare(&equation, P, K, NULL, &result, work, bytes, error));
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t l = 0; l < m; l++) K[l * n + i] *= lg_policy_half_range(d->policy, l) / d->size[i];
        for (uint32_t j = 0; j < n; j++) P[i * n + j] /= d->size[i] * d->size[j];
    }
    *radius = 1.0 - result.margin;
    return LG_OK;
}

/* Samples on shells of V = z^T P z, in equal ratios from V = top to `least` times top; z is drawn by
 * direction. P = L L^T */
static void draw_shells(const design *d, const double *L, double top, double least, uint64_t stream,
                        double *V) {
    lg_rng rng;
    lg_rng_seed(&rng, d->seed, stream);
    for (size_t s = 0; s < SAMPLES; s++) {
        double *z = d->z + s * d->n, y[LG_POLICY_ERRORS], length = 0.0;
        for (uint32_t i = 0; i < d->n; i++) y[i] = lg_rng_normal(&rng), length += y[i] * y[i];
        V[s] = top * pow(least, (double)s / SAMPLES);
        for (uint32_t i = d->n; i-- > 0;) { /* L^T z = y */
            z[i] = y[i] * sqrt(V[s] / length);
            for (uint32_t j = i + 1; j < d->n; j++) z[i] -= L[j * d->n + i] * z[j];
            z[i] /= L[i * d->n + i];
        }
    }
}

/* V of the states themselves: the errors of a state are not those that it was made from, far from the goal.
 */
static lg_status measure(const design *d, const double *P, double *V) {
    const lg_policy *p = d->policy;
    LG_TRY(lg_policy_states(p, d->z, SAMPLES, d->x, d->error));
    LG_TRY(lg_program_eval(p->context, p->program, "errors", SAMPLES, (const double *const[]){d->x},
                           (double *const[]){d->z}, d->error));
    for (size_t s = 0; s < SAMPLES; s++) {
        const double *z = d->z + s * d->n;
        V[s] = 0.0;
        for (uint32_t i = 0; i < d->n; i++)
            for (uint32_t j = 0; j < d->n; j++) V[s] += z[i] * P[i * d->n + j] * z[j];
    }
    return LG_OK;
}

/* Runs the saturated regulator from SAMPLES states with V in [least top, top]. *failing: the least V of a
 * run that fails, at most *failing before. */
static lg_status least_failure(const design *d, const double *K, const double *P, double top, double least,
                               uint64_t stream, double *failing) {
    const lg_policy *p = d->policy;
    double L[LG_POLICY_ERRORS * LG_POLICY_ERRORS], V[SAMPLES];
    if (!lg_matrix_cholesky(d->n, P, L)) return *failing = 0.0, LG_OK;
    const lg_policy_trial trial = {
        .gain = K, .disturbed = lg_policy_is_disturbed(&p->task), .seed = d->seed + stream, .threads = 1};
    draw_shells(d, L, top, least, stream, V);
    LG_TRY(measure(d, P, V));
    lg_policy_runs runs = {
        .count = SAMPLES, .steps = lg_policy_periods(p, p->task.within), .x = d->x, .succeeded = d->held};
    LG_TRY(lg_policy_run(p, &trial, &runs, d->error));
    for (size_t s = 0; s < SAMPLES; s++)
        if (!d->held[s]) *failing = fmin(*failing, V[s]);
    return LG_OK;
}

static const double safety = 0.85;

/* A first look at the level below which runs succeed. *top is the level up to which it is sought; it
 * becomes ten times the least failure, so that a second call samples in finer steps. */
static lg_status find_level(const design *d, const double *K, const double *P, double *top, double *c) {
    double failing = *top;
    LG_TRY(least_failure(d, K, P, *top, 1e-4, 7, &failing));
    *c = safety * failing;
    *top = fmin(*top, 10.0 * failing);
    return LG_OK;
}

/* Lowers the level until a thousand runs with the gain K from its outer half in V succeed. */
static lg_status confirm_level(const design *d, const double *K, lg_policy_regulator *r) {
    enum { LOOKS = 8, MOST_LOOKS = 100 };
    int good = 0;
    for (uint64_t look = 0; good < LOOKS && look < MOST_LOOKS; look++) {
        double failing = INFINITY;
        LG_TRY(least_failure(d, K, r->P, r->c, 0.5, 100 + look, &failing));
        good = failing > r->c ? good + 1 : 0;
        if (failing <= r->c) r->c = safety * failing;
    }
    return LG_OK;
}

/* V of states beyond all starts. */
static double far_level(const design *d, const double *P) {
    double top = 0.0;
    for (uint32_t i = 0; i < d->n; i++) top = fmax(top, 4.0 * P[i * d->n + i] * d->size[i] * d->size[i]);
    return top;
}

/* Of a controller of kind lqr, which must bring every start to the goal itself, 100 times the share of the
 * starts that fail; 0 of others. d->x are states of starts. */
static lg_status find_failures(const design *d, const double *K, double *out) {
    const lg_policy *p = d->policy;
    const lg_policy_trial trial = {
        .gain = K, .disturbed = lg_policy_is_disturbed(&p->task), .seed = d->seed, .threads = 1};
    lg_policy_outcome found = {.succeeded = SAMPLES};
    if (p->task.kind == LG_POLICY_LQR)
        LG_TRY(lg_policy_try(p, &trial, d->x, SAMPLES, &found, NULL, d->error));
    *out = 100.0 * (double)(SAMPLES - found.succeeded) / SAMPLES;
    return LG_OK;
}

/* The failures, and the mean of log(V/c) over starts: how far the region is from them. */
static lg_status distance(const design *d, const double *K, const double *P, double c, double *out) {
    const lg_policy *p = d->policy;
    lg_rng rng;
    double V[SAMPLES];
    lg_rng_seed(&rng, d->seed, 6);
    for (size_t s = 0; s < SAMPLES; s++) lg_policy_draw(p, &rng, d->z + s * d->n);
    LG_TRY(measure(d, P, V));
    LG_TRY(find_failures(d, K, out));
    for (size_t s = 0; s < SAMPLES; s++) *out += log(1e-6 + V[s] / c) / SAMPLES;
    return LG_OK;
}

/* Solves the equation for one choice of weights, and finds its level; a second, finer look is worth it only
 * where the first one comes near the best so far. *far: INFINITY if the weights do not serve. */
static lg_status try_weights(const design *d, weights w, double least, lg_policy_regulator *out, double *far,
                             lg_error *why) {
    *far = INFINITY;
    const lg_status status = solve(d, &w, out->K, out->P, &out->radius, why);
    if (status == LG_OUT_OF_MEMORY) return lg_fail(d->error, status, "no memory for a regulator");
    if (status != LG_OK) return LG_OK;
    double top = far_level(d, out->P);
    for (int look = 0; look < 2; look++) {
        LG_TRY(find_level(d, out->K, out->P, &top, &out->c));
        if (out->c == 0.0) return LG_OK;
        LG_TRY(distance(d, out->K, out->P, out->c, far));
        if (*far > least + 1.0) return LG_OK;
    }
    return LG_OK;
}

static lg_status choose_weights(design *d) {
    static const double input[] = {1e-2, 0.1, 1.0, 10.0}, rate[] = {0.01, 0.1, 1.0}, loose[] = {1.0, 0.01};
    const size_t I = LG_COUNT(input), R = LG_COUNT(rate);
    lg_policy_regulator *best = &d->policy->regulator, tried = *best;
    double least = INFINITY, far;
    lg_error why = {LG_OK, ""};
    for (size_t i = 0; i < I * R * LG_COUNT(loose); i++) {
        const weights w = {input[i % I], rate[i / I % R], loose[i / (I * R)]};
        LG_TRY(try_weights(d, w, least, &tried, &far, &why));
        if (!(far < least)) continue;
        least = far;
        *best = tried;
    }
    if (isfinite(least)) return confirm_level(d, best->K, best);
    return lg_fail(d->error, LG_CHECK_FAILED, "no linear regulator holds the goal with this period: %s",
                   why.message[0] != '\0' ? why.message : "every run from near the goal leaves it");
}

/* Gains that are given. A becomes that of the closed loop, whose Lyapunov equation is a Riccati equation
 * without inputs. */
static lg_status take_gains(design *d) {
    static const weights even = {1.0, 0.1, 1.0};
    lg_policy_regulator *r = &d->policy->regulator;
    const uint32_t n = d->n, m = d->m;
    double none[LG_POLICY_INPUTS * LG_POLICY_ERRORS];
    lg_error why = {LG_OK, ""};
    for (uint32_t i = 0; i < n * n; i++)
        for (uint32_t l = 0; l < m; l++) d->A[i] -= d->B[i / n * m + l] * r->K[l * n + i % n];
    memset(d->B, 0, (size_t)n * m * sizeof *d->B);
    const lg_status status = solve(d, &even, none, r->P, &r->radius, &why);
    const double radius = status == LG_CHECK_FAILED ? lg_matrix_radius(n, d->A) : 0.0;
    if (radius > 1.0 - 1e-6)
        return lg_fail(d->error, status,
                       "the given gains do not hold the goal: with them the loop is unstable, its spectral "
                       "radius is %.6g: without `gains`, stable ones are sought",
                       radius);
    if (status != LG_OK)
        return lg_fail(d->error, status, "the given gains do not hold the goal: %s", why.message);
    double far = far_level(d, r->P);
    for (int look = 0; look < 2; look++) LG_TRY(find_level(d, r->K, r->P, &far, &r->c));
    if (!(r->c > 0.0))
        return lg_fail(d->error, LG_CHECK_FAILED,
                       "with the given gains every run from near the goal leaves it");
    return confirm_level(d, r->K, r);
}

/* The gain of the regulator of the cost, if its set within {V < c} is not much smaller than c: near the goal
 * no other gain costs less. Its own V would not do as a gate, for its set is too small or too far from the
 * starts. */
static lg_status choose_near(const design *d) {
    static const double least = 0.1;
    lg_policy_regulator *r = &d->policy->regulator, tried = *r;
    double P[LG_POLICY_ERRORS * LG_POLICY_ERRORS], radius, top = r->c;
    lg_error why = {LG_OK, ""};
    const lg_status status = solve(d, NULL, tried.near, P, &radius, &why);
    if (status == LG_OUT_OF_MEMORY) return lg_fail(d->error, status, "no memory for a regulator");
    if (status != LG_OK) return LG_OK;
    LG_TRY(find_level(d, tried.near, tried.P, &top, &tried.c));
    if (tried.c > least * r->c) LG_TRY(confirm_level(d, tried.near, &tried));
    if (tried.c > least * r->c) *r = tried;
    return LG_OK;
}

/* The gains of the task; past inputs and integrals may be left out, then their gains are 0. */
static void place_gains(const lg_policy *p, double *K) {
    const uint32_t n = p->layout.errors;
    const bool all = p->task.gain_count == p->inputs * n;
    uint32_t from = 0;
    for (uint32_t k = 0; k < p->inputs; k++)
        for (uint32_t i = 0; i < n; i++) {
            const bool kept = owner_of(p, i)->ago == 0 && owner_of(p, i)->integrates == 0;
            K[k * n + i] = all || kept ? p->task.gains[from++] : 0.0;
        }
}

static lg_status choose_regulator(design *d) {
    lg_policy *p = d->policy;
    lg_policy_regulator *r = &p->regulator;
    const bool given = p->task.kind == LG_POLICY_LQR && p->task.gain_count > 0;
    if (given) place_gains(p, r->K);
    r->c = 1.0;
    if (!p->task.search) return LG_OK;
    LG_TRY(given ? take_gains(d) : choose_weights(d));
    memcpy(r->near, r->K, sizeof r->near);
    return p->task.kind == LG_POLICY_NETWORK && p->task.gate ? choose_near(d) : LG_OK;
}

/* ---- what else the machine tells ---- */

/* Scales of a network's features: four times the largest start. */
static void set_scales(const design *d) {
    for (uint32_t i = 0; i < d->n; i++) d->policy->scale[i] = 4.0 * d->size[i];
}

/* A scale becomes what an error of the unforced motion exceeds in a twentieth of the time, where that is
 * more. Swinging machines move much faster than their starts, and a network does not learn while these
 * speeds saturate its units. path (count, errors); sorted (count). */
static void widen_scales(const design *d, const double *path, size_t count, double *sorted) {
    for (uint32_t i = 0; i < d->n; i++) {
        size_t finite = 0;
        for (size_t r = 0; r < count; r++)
            if (isfinite(path[r * d->n + i])) sorted[finite++] = fabs(path[r * d->n + i]);
        qsort(sorted, finite, sizeof *sorted, lg_compare_doubles);
        if (finite > 0) d->policy->scale[i] = fmax(d->policy->scale[i], sorted[finite * 19 / 20]);
    }
}

/* w: .6 times the mean cost of the horizon without control. */
static void set_terminal(const design *d, const double *cost) {
    double sum = 0.0;
    size_t finite = 0;
    for (size_t s = 0; s < SAMPLES; s++)
        if (isfinite(cost[s])) sum += cost[s], finite++;
    d->policy->terminal = 0.6 * sum / (double)(finite > 0 ? finite : 1);
}

/* Runs of `regulated` with K = 0 over the horizon, from random starts. */
static lg_status learn_from_unforced(design *d) {
    const lg_policy *p = d->policy;
    const double zero[LG_POLICY_INPUTS * LG_POLICY_ERRORS] = {0};
    const size_t steps = lg_policy_periods(p, p->task.horizon), count = (steps + 1) * SAMPLES;
    double cost[SAMPLES];
    lg_rng rng;
    LG_TRY_SCRATCH(double, path, p->context, count *(d->n + 1), lg_no_memory(d->error));
    lg_rng_seed(&rng, d->seed, 8);
    lg_policy_runs runs = {
        .count = SAMPLES, .steps = steps, .x = d->x, .cost = cost, .path = path, .succeeded = d->held};
    LG_TRY(lg_policy_starts(p, &rng, SAMPLES, d->x, NULL, d->error));
    LG_TRY(lg_policy_run(p, &(lg_policy_trial){.gain = zero, .threads = 1}, &runs, d->error));
    widen_scales(d, path, count, path + count * d->n);
    set_terminal(d, cost);
    return LG_OK;
}

/* Rates of the errors of velocity by the inputs of plant p, at the goal at rest: what inputs at half their
 * range, lagged ones too, change in a step of a millionth of a period, (errors, inputs). Over a whole
 * period the motion would have answered. */
static lg_status input_rates(const design *d, const lg_policy *p, double *out) {
    const uint32_t n = d->n, rows = d->m + 1;
    const double step = 1e-6 * p->task.period;
    LG_TRY_SCRATCH(double, z, p->context, (size_t)rows *(2 * n + 2 * p->state + d->m + 1),
                   lg_no_memory(d->error));
    double *after = z + (size_t)rows * n, *x = after + (size_t)rows * n, *next = x + (size_t)rows * p->state;
    double *u = next + (size_t)rows * p->state, *h = u + (size_t)rows * d->m;
    for (uint32_t r = 0; r < rows; r++) {
        h[r] = step;
        for (uint32_t l = 0; l < d->m; l++)
            u[r * d->m + l] = p->regulator.u0[l] + (r == l + 1 ? lg_policy_half_range(d->policy, l) : 0.0);
        for (uint32_t i = 0; i < p->task.coordinate_count; i++)
            if (r > 0 && p->task.coordinate[i].follows == r)
                z[r * n + p->layout.at[i].error] = lg_policy_half_range(p, r - 1);
    }
    LG_TRY(lg_policy_states(p, z, rows, x, d->error));
    LG_TRY(lg_program_eval(p->context, p->program, "step", rows, (const double *const[]){x, u, h},
                           (double *const[]){next}, d->error));
    LG_TRY(lg_program_eval(p->context, p->program, "errors", rows, (const double *const[]){next},
                           (double *const[]){after}, d->error));
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t l = 0; l < d->m; l++)
            out[i * d->m + l] =
                (after[(l + 1) * n + i] - after[i]) / (lg_policy_half_range(d->policy, l) * step);
    return LG_OK;
}

/* G = M B: B from input_rates, and the mass matrix M from differences of the energy, which is quadratic in
 * the errors of velocity. */
static lg_status set_map(design *d) {
    lg_policy *p = d->policy;
    const uint32_t first = p->layout.at[0].rate, k = d->n - first, rows = 2 * k * k;
    LG_TRY_SCRATCH(double, z, p->context, (size_t)rows *(d->n + p->state + 1) + k * k + (size_t)d->n * d->m,
                   lg_no_memory(d->error));
    double *x = z + (size_t)rows * d->n, *H = x + (size_t)rows * p->state, *M = H + rows, *B = M + k * k;
    for (uint32_t r = 0; r < rows; r++) {
        const uint32_t i = r / (2 * k), j = r / 2 % k;
        z[(size_t)r * d->n + first + i] += d->size[first + i];
        z[(size_t)r * d->n + first + j] += (r % 2 == 0 ? 1.0 : -1.0) * d->size[first + j];
    }
    LG_TRY(lg_policy_states(p, z, rows, x, d->error));
    LG_TRY(lg_program_eval(p->context, p->program, "value", rows, (const double *const[]){x},
                           (double *const[]){H}, d->error));
    LG_TRY(input_rates(d, p, B));
    for (uint32_t i = 0; i < k * k; i++)
        M[i] = (H[2 * i] - H[2 * i + 1]) / (2.0 * d->size[first + i / k] * d->size[first + i % k]);
    for (uint32_t l = 0; l < d->m; l++)
        for (uint32_t i = 0; i < k; i++) {
            double sum = 0.0;
            for (uint32_t j = 0; j < k; j++) sum += M[i * k + j] * B[(first + j) * d->m + l];
            p->G[l * d->n + first + i] = sum;
        }
    for (uint32_t i = 0; i < p->task.coordinate_count; i++)
        for (uint32_t l = 0; p->task.coordinate[i].velocity[0] != '\0' && l < d->m; l++)
            memcpy(p->G + l * d->n + p->layout.at[i].error, p->G + l * d->n + p->layout.at[i].rate,
                   lg_policy_row_of(&p->task.coordinate[i])->errors * sizeof *p->G);
    return LG_OK;
}

/* Compensation begins with k = the input that dry friction takes at the goal: h (1 - a/s), where an input
 * of half its range h gives the acceleration a, and s without dry friction. w is half of |K z| at the
 * bounds of success. */
static lg_status begin_compensation(const design *d) {
    lg_policy *p = d->policy;
    const uint32_t n = d->n, m = d->m, rates = p->layout.at[0].rate;
    LG_TRY_SCRATCH(double, a, p->context, 2 * (size_t)n * m, lg_no_memory(d->error));
    double *s = a + (size_t)n * m;
    LG_TRY(input_rates(d, p, a));
    LG_TRY(input_rates(d, d->sliding != NULL ? d->sliding : p, s));
    for (uint32_t l = 0; l < m; l++) {
        uint32_t most = rates;
        for (uint32_t i = rates; i < n; i++)
            if (fabs(s[i * m + l]) / d->size[i] > fabs(s[most * m + l]) / d->size[most]) most = i;
        double square = 0.0;
        for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
            const double bound = p->task.coordinate[i].success,
                         K = p->regulator.K[l * n + p->layout.at[i].error];
            if (isfinite(bound)) square += K * K * bound * bound;
        }
        const double half = lg_policy_half_range(p, l),
                     part = most < n ? 1.0 - a[most * m + l] / s[most * m + l] : 0.0;
        p->first[l] = log(half * fmin(fmax(part, 1e-3), 1.0));
        p->first[m + l] = log(fmin(fmax(0.5 * sqrt(square), 1e-3 * half), half));
    }
    return LG_OK;
}

/* ---- */

static lg_status begin(design *d, lg_policy *p, lg_policy *sliding, uint64_t seed, lg_error *error) {
    *d = (design){p, sliding, .n = p->layout.errors, .m = p->inputs, .seed = seed, .error = error};
    const size_t n = d->n, m = d->m, numbers = n * (n + 2 * m) + SAMPLES * (n + p->state);
    if (LG_ALLOC_ALL(p->context, LG_ARRAY(d->A, numbers), LG_ARRAY(d->held, SAMPLES)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a regulator");
    d->B = d->A + n * n, d->rest = d->B + n * m, d->z = d->rest + n * m, d->x = d->z + SAMPLES * n;
    lg_policy_find_sizes(p, d->size);
    return find_equilibrium(d);
}

static void end(design *d) {
    LG_FREE_ALL(d->policy->context, d->A, d->held);
}

lg_status lg_policy_find_rest(lg_policy *p, lg_policy *sliding, lg_error *error) {
    LG_CLEAN(end) design d;
    return begin(&d, p, sliding, 0, error);
}

lg_status lg_policy_find_regulator(lg_policy *p, lg_policy *sliding, uint64_t seed, lg_error *error) {
    LG_CLEAN(end) design d;
    LG_TRY(begin(&d, p, sliding, seed, error));
    LG_TRY(lg_policy_add_regulated(p, error));
    LG_TRY(choose_regulator(&d));
    set_scales(&d);
    if (p->task.search) LG_TRY(learn_from_unforced(&d));
    if (p->task.kind == LG_POLICY_ENERGY) LG_TRY(set_map(&d));
    return p->task.compensate ? begin_compensation(&d) : LG_OK;
}
