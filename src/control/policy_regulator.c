/* Policies: the regulator at the goal, its region by runs, and the scales that follow from the machine's motion. */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "kernels/lapack.h"
#include "liegrad/control.h"
#include "liegrad/minimise.h"

typedef struct design {
    lg_policy *policy;
    uint32_t n, m;                 /* errors, inputs */
    double *A, *B;                 /* z+ = A z + B (u - u0) */
    double size[LG_POLICY_ERRORS]; /* of the errors: of starts, or of unforced motion */
    double *z, *x;                 /* samples: (SAMPLES, errors), (SAMPLES, state) */
    bool *held;
    uint64_t seed;
    lg_error *error;
} design;

enum { SAMPLES = 256 };

/* ---- the equilibrium ---- */

static lg_status linearise(const design *d, const double *u, double *z, lg_error *error) {
    const lg_policy *p = d->policy;
    const double zero[LG_POLICY_ERRORS] = {0};
    const double *const in[2] = {zero, u};
    LG_TRY(lg_program_eval(p->context, p->program, "linear", 1, in, (double *const[]){z}, error));
    return lg_program_eval(p->context, p->program, "jac_linear", 1, in, (double *const[]){d->A, d->B}, error);
}

/* The least squares solution of B y = -z in inputs of their range. */
static lg_status correct(const design *d, const double *z, double *u) {
    double matrix[LG_POLICY_INPUTS * LG_POLICY_INPUTS] = {0}, right[LG_POLICY_INPUTS] = {0},
                                     range[LG_POLICY_INPUTS];
    for (uint32_t l = 0; l < d->m; l++)
        range[l] = d->policy->task.input[l].high - d->policy->task.input[l].low;
    for (uint32_t a = 0; a < d->m; a++)
        for (uint32_t i = 0; i < d->n; i++) {
            const double weight = 1.0 / (d->size[i] * d->size[i]), row = d->B[i * d->m + a] * range[a];
            right[a] -= weight * row * z[i];
            for (uint32_t b = 0; b < d->m; b++)
                matrix[a * d->m + b] += weight * row * d->B[i * d->m + b] * range[b];
        }
    LG_TRY(lg_normal_equations(d->m, 1, 1e-12, matrix, right));
    for (uint32_t l = 0; l < d->m; l++) u[l] += range[l] * right[l];
    return LG_OK;
}

/* The largest error after a period at the goal, over the size of this error. */
static double residual_of(const design *d, const double *z, uint32_t *which) {
    double most = 0.0;
    for (uint32_t i = 0; i < d->n; i++)
        if (!(fabs(z[i]) / d->size[i] <= most)) most = fabs(z[i]) / d->size[i], *which = i;
    return most;
}

/* The coordinate that error i belongs to. */
static const char *name_of(const lg_policy *p, uint32_t i) {
    const char *name = "";
    for (uint32_t k = 0; k < p->task.coordinate_count; k++) {
        const lg_policy_coordinate *c = &p->task.coordinate[k];
        const uint32_t count = lg_policy_motion_row_of(c->motion)->errors;
        if (i >= p->layout.at[k].error && i < p->layout.at[k].error + count) name = c->name;
        if (c->velocity[0] != '\0' && i >= p->layout.at[k].rate && i < p->layout.at[k].rate + count)
            name = c->velocity;
    }
    return name;
}

static lg_status find_equilibrium(design *d) {
    static const double most = 1e-6;
    lg_policy *p = d->policy;
    double z[LG_POLICY_ERRORS];
    uint32_t which = 0;
    for (uint32_t l = 0; l < d->m; l++)
        p->regulator.u0[l] = fmin(fmax(0.0, p->task.input[l].low), p->task.input[l].high);
    for (int i = 0; i < 8; i++) {
        LG_TRY(linearise(d, p->regulator.u0, z, d->error));
        p->regulator.residual = residual_of(d, z, &which);
        if (p->regulator.residual < 1e-12 || i == 7) break;
        if (correct(d, z, p->regulator.u0) != LG_OK) break;
    }
    if (!(p->regulator.residual <= most))
        return lg_fail(
            d->error, LG_CHECK_FAILED,
            "the goal is not an equilibrium under any constant input: from there %s changes by %.3g in a "
            "period of %g s",
            name_of(p, which), z[which], p->task.period);
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

/* Of each error the largest of the starts; where these are all 0, the bound of success, or that of the unforced
 * motion. */
static void find_sizes(design *d) {
    const lg_policy *p = d->policy;
    for (uint32_t k = 0; k < p->task.coordinate_count; k++) {
        const lg_policy_coordinate *c = &p->task.coordinate[k];
        const uint32_t count = lg_policy_motion_row_of(c->motion)->errors;
        const double far = fmax(fabs(c->start[0]), fabs(c->start[1])),
                     fast = fmax(fabs(c->start_velocity[0]), fabs(c->start_velocity[1]));
        for (uint32_t i = 0; i < count; i++) {
            d->size[p->layout.at[k].error + i] = far > 0 ? far : isfinite(c->success) ? c->success : 1.0;
            if (c->velocity[0] == '\0') continue;
            d->size[p->layout.at[k].rate + i] =
                fast > 0 ? fast
                : isfinite(c->success_velocity)
                    ? c->success_velocity
                    : d->size[p->layout.at[k].error + i] / (10.0 * p->task.period);
        }
    }
}

/* ---- weights, and the region by runs ---- */

typedef struct weights {
    double input, rate; /* weights: of inputs over their range, of velocities over their size */
} weights;

static lg_status solve(const design *d, weights w, double *K, double *P, double *radius, lg_error *error) {
    lg_policy *p = d->policy;
    const uint32_t n = d->n, m = d->m, positions = p->layout.at[0].rate;
    const size_t bytes = lg_riccati_work_size(n, m);
    double *Q = lg_alloc(p->context, n * n + m * m, sizeof *Q), *R = Q + n * n;
    void *work = lg_alloc(p->context, bytes, 1);
    lg_riccati_result result = {0};
    lg_status status = LG_OUT_OF_MEMORY;
    if (Q != NULL && work != NULL) {
        for (uint32_t i = 0; i < n; i++)
            Q[i * n + i] = (i < positions ? 1.0 : w.rate) / (d->size[i] * d->size[i]);
        for (uint32_t l = 0; l < m; l++) {
            const double half = 0.5 * (p->task.input[l].high - p->task.input[l].low);
            R[l * m + l] = w.input / (half * half);
        }
        const lg_riccati equation = {sizeof equation, n, m, d->A, d->B, Q, R, NULL};
        status = lg_dare(&equation, P, K, NULL, &result, work, bytes, error);
    }
    *radius = 1.0 - result.margin;
    lg_free(p->context, Q);
    lg_free(p->context, work);
    return status;
}

/* Upper triangular C with P = C^T C. */
static bool root(uint32_t n, const double *P, double *C) {
    const int size = (int)n;
    int info;
    memcpy(C, P, (size_t)n * n * sizeof *C);
    dpotrf_("L", &size, C, &size, &info); /* row-major: the upper triangle */
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < i; j++) C[i * n + j] = 0.0;
    return info == 0;
}

/* Samples on shells of V = z^T P z, from V = 10^-4 top to top; z is drawn by direction. */
static void draw_shells(const design *d, const double *C, double top, double *V) {
    lg_rng rng;
    lg_rng_seed(&rng, d->seed, 7);
    for (size_t s = 0; s < SAMPLES; s++) {
        double *z = d->z + s * d->n, y[LG_POLICY_ERRORS], length = 0.0;
        for (uint32_t i = 0; i < d->n; i++) y[i] = lg_rng_normal(&rng), length += y[i] * y[i];
        V[s] = top * pow(10.0, -4.0 * (double)s / SAMPLES);
        for (uint32_t i = d->n; i-- > 0;) { /* C z = y */
            z[i] = y[i] * sqrt(V[s] / length);
            for (uint32_t j = i + 1; j < d->n; j++) z[i] -= C[i * d->n + j] * z[j];
            z[i] /= C[i * d->n + i];
        }
    }
}

/* V of the states themselves: the errors of a state are not those that it was made from, far from the goal. */
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

/* The level below which every sampled run of the saturated regulator succeeds: twice, the second time in finer steps
 * around the least failure. */
static lg_status find_level(const design *d, const double *K, const double *P, double *c) {
    static const double safety = 0.85;
    const lg_policy *p = d->policy;
    double C[LG_POLICY_ERRORS * LG_POLICY_ERRORS], V[SAMPLES];
    double top = 0.0;
    *c = 0.0;
    if (!root(d->n, P, C)) return LG_OK;
    for (uint32_t i = 0; i < d->n; i++) top = fmax(top, 4.0 * P[i * d->n + i] * d->size[i] * d->size[i]);
    for (int pass = 0; pass < 2; pass++) {
        double failing = top;
        draw_shells(d, C, top, V);
        LG_TRY(measure(d, P, V));
        lg_policy_runs runs = {
            .count = SAMPLES, .steps = lg_policy_periods(p, p->task.within), .x = d->x, .succeeded = d->held};
        LG_TRY(lg_policy_run(p, K, NULL, 1, &runs, d->error));
        for (size_t s = 0; s < SAMPLES; s++)
            if (!d->held[s]) failing = fmin(failing, V[s]);
        *c = safety * failing;
        top = fmin(top, 10.0 * failing);
    }
    return LG_OK;
}

/* log of the volume of {V < c}, up to a constant. */
static double log_volume(uint32_t n, const double *P, double c) {
    double C[LG_POLICY_ERRORS * LG_POLICY_ERRORS], sum = 0.5 * n * log(c);
    if (!root(n, P, C)) return -INFINITY;
    for (uint32_t i = 0; i < n; i++) sum -= log(C[i * n + i]);
    return sum;
}

static lg_status choose_weights(design *d) {
    static const double input[] = {1e-2, 0.1, 1.0, 10.0}, rate[] = {0.01, 0.1, 1.0};
    lg_policy_regulator *best = &d->policy->regulator;
    double K[LG_POLICY_INPUTS * LG_POLICY_ERRORS], P[LG_POLICY_ERRORS * LG_POLICY_ERRORS];
    double most = -INFINITY, radius;
    lg_error why = {LG_OK, ""};
    for (size_t i = 0; i < LG_COUNT(input) * LG_COUNT(rate); i++) {
        const weights w = {input[i / LG_COUNT(rate)], rate[i % LG_COUNT(rate)]};
        double c;
        const lg_status status = solve(d, w, K, P, &radius, &why);
        if (status == LG_OUT_OF_MEMORY) return lg_fail(d->error, status, "no memory for a regulator");
        if (status != LG_OK) continue;
        LG_TRY(find_level(d, K, P, &c));
        const double volume = c > 0.0 ? log_volume(d->n, P, c) : -INFINITY;
        if (!(volume > most)) continue;
        most = volume;
        memcpy(best->K, K, (size_t)d->m * d->n * sizeof *K);
        memcpy(best->P, P, (size_t)d->n * d->n * sizeof *P);
        best->c = c, best->radius = radius;
    }
    if (most > -INFINITY) return LG_OK;
    return lg_fail(d->error, LG_CHECK_FAILED, "no linear regulator holds the goal with this period: %s",
                   why.message[0] != '\0' ? why.message : "every run from near the goal leaves it");
}

/* ---- what else the machine tells ---- */

/* Scales of a network's features: four times the largest start, as far as it has one. */
static void set_scales(const design *d) {
    for (uint32_t i = 0; i < d->n; i++) d->policy->scale[i] = 4.0 * d->size[i];
}

/* w: the mean cost of the horizon without control, by runs of `regulated` with K = 0 from random starts. */
static lg_status set_terminal(design *d) {
    lg_policy *p = d->policy;
    const double zero[LG_POLICY_INPUTS * LG_POLICY_ERRORS] = {0};
    double cost[SAMPLES];
    size_t finite = 0;
    lg_rng rng;
    lg_rng_seed(&rng, d->seed, 8);
    for (size_t s = 0; s < SAMPLES; s++) lg_policy_draw(&p->task, &p->layout, &rng, d->z + s * d->n);
    lg_policy_runs runs = {.count = SAMPLES,
                           .steps = lg_policy_periods(p, p->task.horizon),
                           .x = d->x,
                           .cost = cost,
                           .succeeded = d->held};
    LG_TRY(lg_policy_states(p, d->z, SAMPLES, d->x, d->error));
    LG_TRY(lg_policy_run(p, zero, NULL, 1, &runs, d->error));
    p->terminal = 0.0;
    for (size_t s = 0; s < SAMPLES; s++)
        if (isfinite(cost[s])) p->terminal += cost[s], finite++;
    p->terminal /= (double)(finite > 0 ? finite : 1);
    return LG_OK;
}

/* G from M B/h: the mass matrix M of errors of velocity by differences of the energy, which is quadratic in them. */
static lg_status set_map(design *d) {
    lg_policy *p = d->policy;
    const uint32_t first = p->layout.at[0].rate, k = d->n - first, rows = 2 * k * k;
    double *z = lg_alloc(p->context, (size_t)rows * (d->n + p->state + 1) + k * k, sizeof *z);
    if (z == NULL) return lg_fail(d->error, LG_OUT_OF_MEMORY, "no memory for the map of inputs");
    double *x = z + (size_t)rows * d->n, *H = x + (size_t)rows * p->state, *M = H + rows;
    for (uint32_t r = 0; r < rows; r++) {
        const uint32_t i = r / (2 * k), j = r / 2 % k;
        z[(size_t)r * d->n + first + i] += d->size[first + i];
        z[(size_t)r * d->n + first + j] += (r % 2 == 0 ? 1.0 : -1.0) * d->size[first + j];
    }
    lg_status status = lg_policy_states(p, z, rows, x, d->error);
    if (status == LG_OK)
        status = lg_program_eval(p->context, p->program, "value", rows, (const double *const[]){x},
                                 (double *const[]){H}, d->error);
    for (uint32_t i = 0; i < k * k && status == LG_OK; i++)
        M[i] = (H[2 * i] - H[2 * i + 1]) / (2.0 * d->size[first + i / k] * d->size[first + i % k]);
    for (uint32_t l = 0; l < d->m && status == LG_OK; l++)
        for (uint32_t i = 0; i < k; i++) {
            double sum = 0.0;
            for (uint32_t j = 0; j < k; j++)
                sum += M[i * k + j] * d->B[(first + j) * d->m + l] / p->task.period;
            p->G[l * d->n + first + i] = sum;
            if (i < first) p->G[l * d->n + i] = sum;
        }
    lg_free(p->context, z);
    return status;
}

/* ---- */

lg_status lg_policy_find_regulator(lg_policy *p, uint64_t seed, lg_error *error) {
    design d = {.policy = p, .n = p->layout.errors, .m = p->inputs, .seed = seed, .error = error};
    const size_t n = d.n, m = d.m, numbers = n * (n + m) + SAMPLES * (n + p->state);
    p->regulator.errors = d.n, p->regulator.inputs = d.m;
    d.A = lg_alloc(p->context, numbers, sizeof *d.A);
    d.held = lg_alloc(p->context, SAMPLES, sizeof *d.held);
    lg_status status = LG_OUT_OF_MEMORY;
    if (d.A != NULL && d.held != NULL) {
        d.B = d.A + n * n, d.z = d.B + n * m, d.x = d.z + SAMPLES * n;
        find_sizes(&d);
        status = find_equilibrium(&d);
        if (status == LG_OK) status = lg_policy_add_regulated(p, error);
        if (status == LG_OK) status = choose_weights(&d);
        if (status == LG_OK) set_scales(&d), status = set_terminal(&d);
        if (status == LG_OK && p->task.kind == LG_POLICY_ENERGY) status = set_map(&d);
    } else {
        (void)lg_fail(error, status, "no memory for a regulator");
    }
    lg_free(p->context, d.A);
    lg_free(p->context, d.held);
    return status;
}
