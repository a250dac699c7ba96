/* Work against error on chains of pendulums: the library and other integrators, alternating in one process.
 *
 *     ode_peers [ROUNDS [LINKS...]]     defaults: 7 rounds, 2 6 10 20 links
 *
 * Lagrangian form, (q, omega) = (sqrt(1/2), 0, sqrt(1/2), 0, 1, 0) for every link, m = 1, g = 9.81, L = 1,
 * from 0 to T = 3. Relative and absolute tolerance are equal and decrease in half decades. The other
 * integrators:
 * - hand: Dormand-Prince 5(4) in ambient coordinates, written for this comparison: first same as last, fused
 *   loops, the library's vector field, step control and first step
 * - arkode: ERKStep of SUNDIALS, Dormand-Prince 5(4), serial vectors, the same field (HAVE_ARKODE)
 * - arkode-dense: the same, but the angular accelerations solve the symmetric 3N x 3N system, by LAPACK
 *
 * Prints one JSON object. Times are seconds for one integration, without the allocation of memory. Errors
 * are max |y(T) - reference| / max |reference|. The reference is RKMK(5,4) at tolerance 1e-13; the error of
 * the reference is estimated by its difference from Dormand-Prince at 1e-13 in ambient coordinates.
 */
#define _GNU_SOURCE
#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"

#if defined(HAVE_ARKODE)
#include <arkode/arkode_erkstep.h>
#include <nvector/nvector_serial.h>
#endif

enum { TOLERANCES = 20, MAX_ROUNDS = 101, LANES = 8 };
static const double t_end = 3.0, gravity = 9.81, reference_tolerance = 1e-13;
static const double sample_seconds = 1e-3, warm_seconds = 0.2;

static void *allocate(size_t count, size_t size) {
    const size_t bytes = (count * size + 63) / 64 * 64;
    void *memory = aligned_alloc(64, bytes > 0 ? bytes : 64);
    if (!memory) {
        (void)fprintf(stderr, "ode_peers: out of memory\n");
        exit(1);
    }
    return memset(memory, 0, bytes);
}

static double seconds(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void check(lg_status status, const char *what) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "ode_peers: %s: %s\n", what, lg_status_sentence(status));
    exit(1);
}

/* Pins the process to a core. Returns the core, or -1 if this failed. */
static int pin(void) {
    cpu_set_t allowed, one;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) return -1;
    for (int core = CPU_SETSIZE - 1; core >= 0; core--) {
        if (!CPU_ISSET(core, &allowed)) continue;
        CPU_ZERO(&one);
        CPU_SET(core, &one);
        return sched_setaffinity(0, sizeof one, &one) == 0 ? core : -1;
    }
    return -1;
}

/* ---- the problem ---- */

typedef struct problem {
    size_t links, dim;
    lg_system *system;
    lg_ode ode[2]; /* indexed by lg_coordinates */
    lg_system_user user[2];
    double *work[2], *y0, *reference, reference_error;
} problem;

/* The result of an integration. y is the state at the end. */
typedef struct outcome {
    double *y;
    size_t steps, rejected, evaluations;
} outcome;

/* A way to integrate. make and end are called once; run integrates from start to end. */
typedef struct method {
    const char *name;
    void *(*make)(const problem *p);
    bool (*run)(void *self, double tolerance, outcome *out);
    void (*end)(void *self);
} method;

static double difference(size_t n, const double *x, const double *reference) {
    double most = 0.0, largest = 0.0;
    for (size_t i = 0; i < n; i++) {
        const double d = fabs(x[i] - reference[i]);
        if (isnan(d)) return NAN;
        most = fmax(most, d);
        largest = fmax(largest, fabs(reference[i]));
    }
    return most / largest;
}

static double manifold_error(const problem *p, const double *y) {
    return lg_space_manifold_error(lg_system_space(p->system), y);
}

/* ---- the library's schemes ---- */

typedef struct ours {
    const problem *problem;
    lg_stepper *stepper;
} ours;

static void *ours_make(const problem *p, const char *scheme) {
    ours *o = allocate(1, sizeof *o);
    o->problem = p;
    const lg_scheme *found = lg_scheme_find(scheme);
    check(lg_stepper_create(NULL, found, &p->ode[lg_system_coordinates_for(found)], &o->stepper), scheme);
    return o;
}

static void *rkmk_make(const problem *p) {
    return ours_make(p, "rkmk54");
}

static void *dp_make(const problem *p) {
    return ours_make(p, "dp54");
}

static bool ours_run(void *self, double tolerance, outcome *out) {
    ours *o = self;
    lg_step_controller control;
    lg_run_stats stats;
    lg_step_controller_init(&control);
    control.rtol = control.atol = tolerance;
    lg_stepper_reset(o->stepper);
    if (lg_integrate_adaptive(o->stepper, &control, 0.0, o->problem->y0, &t_end, 1, out->y, &stats) != LG_OK)
        return false;
    *out = (outcome){out->y, stats.steps, stats.rejected, stats.evaluations};
    return true;
}

static void ours_end(void *self) {
    ours *o = self;
    lg_stepper_destroy(o->stepper);
    free(o);
}

/* ---- Dormand-Prince by hand ---- */

/* All vectors are padded with zeros to whole blocks of LANES. */
typedef struct hand {
    const lg_ode *ode;
    const double *start;
    size_t dim, padded, evaluations;
    double *k[7], *y, *z, *stage;
} hand;

static void *hand_make(const problem *p) {
    hand *d = allocate(1, sizeof *d);
    d->ode = &p->ode[LG_COORDINATES_AMBIENT];
    d->start = p->y0;
    d->dim = p->dim;
    d->padded = (p->dim + LANES - 1) / LANES * LANES;
    for (int i = 0; i < 7; i++) d->k[i] = allocate(d->padded, sizeof(double));
    d->y = allocate(d->padded, sizeof(double));
    d->z = allocate(d->padded, sizeof(double));
    d->stage = allocate(d->padded, sizeof(double));
    return d;
}

static void hand_end(void *self) {
    hand *d = self;
    for (int i = 0; i < 7; i++) free(d->k[i]);
    free(d->y);
    free(d->z);
    free(d->stage);
    free(d);
}

static inline void field(hand *d, double t, const double *y, double *out) {
    d->evaluations++;
    (void)d->ode->field(d->ode->user, t, y, NULL, out);
}

static double summed(size_t n, const double lanes[LANES]) {
    double sum = 0.0;
    for (int j = 0; j < LANES; j++) sum += lanes[j];
    return sqrt(sum / (double)n);
}

/* Root mean square of x / (tolerance (1 + |y|)). */
static double norm(const hand *d, double tolerance, const double *restrict x, const double *restrict y) {
    double lanes[LANES] = {0.0};
    for (size_t i = 0; i < d->padded; i += LANES)
        for (size_t j = 0; j < LANES; j++) {
            const double e = x[i + j] / (tolerance + tolerance * fabs(y[i + j]));
            lanes[j] += e * e;
        }
    return summed(d->dim, lanes);
}

/* Length of the first step after Hairer, Norsett and Wanner, II.4. k[0] is the field at y. */
static double first_step(hand *d, double tolerance) {
    const size_t n = d->padded;
    const double speed = norm(d, tolerance, d->k[0], d->y);
    double h = fmin(fmax(0.01 * norm(d, tolerance, d->y, d->y) / speed, 1e-6 * t_end), t_end);
    for (size_t i = 0; i < n; i++) d->stage[i] = d->y[i] + h * d->k[0][i];
    field(d, h, d->stage, d->k[1]);
    for (size_t i = 0; i < n; i++) d->z[i] = (d->k[1][i] - d->k[0][i]) / h;
    const double steepest = fmax(speed, norm(d, tolerance, d->z, d->y));
    return fmin(fmin(pow(0.01 / steepest, 0.2), 100.0 * h), t_end);
}

/* Computes stages 2 to 7. z becomes the end of the step, and k[6] the field at z. */
static void stages(hand *d, double t, double h) {
    const size_t n = d->padded;
    const double *restrict y = d->y;
    double *restrict s = d->stage, *restrict z = d->z;
    const double *restrict k1 = d->k[0], *restrict k2 = d->k[1], *restrict k3 = d->k[2],
                           *restrict k4 = d->k[3], *restrict k5 = d->k[4], *restrict k6 = d->k[5];
    const double a21 = h / 5.0;
    for (size_t i = 0; i < n; i++) s[i] = y[i] + a21 * k1[i];
    field(d, t + h / 5.0, s, d->k[1]);
    const double a31 = h * 3.0 / 40.0, a32 = h * 9.0 / 40.0;
    for (size_t i = 0; i < n; i++) s[i] = y[i] + (a31 * k1[i] + a32 * k2[i]);
    field(d, t + h * 3.0 / 10.0, s, d->k[2]);
    const double a41 = h * 44.0 / 45.0, a42 = h * -56.0 / 15.0, a43 = h * 32.0 / 9.0;
    for (size_t i = 0; i < n; i++) s[i] = y[i] + (a41 * k1[i] + a42 * k2[i] + a43 * k3[i]);
    field(d, t + h * 4.0 / 5.0, s, d->k[3]);
    const double a51 = h * 19372.0 / 6561.0, a52 = h * -25360.0 / 2187.0, a53 = h * 64448.0 / 6561.0,
                 a54 = h * -212.0 / 729.0;
    for (size_t i = 0; i < n; i++) s[i] = y[i] + (a51 * k1[i] + a52 * k2[i] + (a53 * k3[i] + a54 * k4[i]));
    field(d, t + h * 8.0 / 9.0, s, d->k[4]);
    const double a61 = h * 9017.0 / 3168.0, a62 = h * -355.0 / 33.0, a63 = h * 46732.0 / 5247.0,
                 a64 = h * 49.0 / 176.0, a65 = h * -5103.0 / 18656.0;
    for (size_t i = 0; i < n; i++)
        s[i] = y[i] + (a61 * k1[i] + a62 * k2[i] + (a63 * k3[i] + a64 * k4[i]) + a65 * k5[i]);
    field(d, t + h, s, d->k[5]);
    const double b1 = h * 35.0 / 384.0, b3 = h * 500.0 / 1113.0, b4 = h * 125.0 / 192.0,
                 b5 = h * -2187.0 / 6784.0, b6 = h * 11.0 / 84.0;
    for (size_t i = 0; i < n; i++)
        z[i] = y[i] + (b1 * k1[i] + b3 * k3[i] + (b4 * k4[i] + b5 * k5[i]) + b6 * k6[i]);
    field(d, t + h, z, d->k[6]);
}

/* The norm of the embedded error estimate, scaled and summed in one pass without being stored. */
static double estimate(const hand *d, double tolerance, double h) {
    const double e1 = h * 71.0 / 57600.0, e3 = h * -71.0 / 16695.0, e4 = h * 71.0 / 1920.0,
                 e5 = h * -17253.0 / 339200.0, e6 = h * 22.0 / 525.0, e7 = h * -1.0 / 40.0;
    const double *restrict y = d->y, *restrict z = d->z;
    const double *restrict k1 = d->k[0], *restrict k3 = d->k[2], *restrict k4 = d->k[3],
                           *restrict k5 = d->k[4], *restrict k6 = d->k[5], *restrict k7 = d->k[6];
    double lanes[LANES] = {0.0};
    for (size_t i = 0; i < d->padded; i += LANES)
        for (size_t j = 0; j < LANES; j++) {
            const size_t l = i + j;
            const double size = fabs(y[l]) > fabs(z[l]) ? fabs(y[l]) : fabs(z[l]);
            const double e =
                (e1 * k1[l] + e3 * k3[l] + (e4 * k4[l] + e5 * k5[l]) + (e6 * k6[l] + e7 * k7[l])) /
                (tolerance + tolerance * size);
            lanes[j] += e * e;
        }
    return summed(d->dim, lanes);
}

static void swap(double **a, double **b) {
    double *const was = *a;
    *a = *b;
    *b = was;
}

static bool hand_run(void *self, double tolerance, outcome *out) {
    hand *d = self;
    lg_step_controller control;
    size_t steps = 0, rejected = 0;
    bool again = false;
    lg_step_controller_init(&control);
    control.rtol = control.atol = tolerance;
    d->evaluations = 0;
    memcpy(d->y, d->start, d->dim * sizeof(double));
    field(d, 0.0, d->y, d->k[0]);
    for (double t = 0.0, h = first_step(d, tolerance); t < t_end;) {
        const double left = t_end - t;
        const bool last = h * (1.0 + 1e-3) >= left;
        if (last) h = left;
        if (steps + rejected > control.max_steps || h < 1e-15) return false;
        stages(d, t, h);
        const lg_step_history history = {h, 0.0, again};
        const lg_step_decision decision =
            lg_step_controller_decide(&control, 0.2, estimate(d, tolerance, h), &history);
        again = !decision.accept;
        if (decision.accept) {
            t = last ? t_end : t + h;
            steps++;
            swap(&d->y, &d->z);
            swap(&d->k[0], &d->k[6]);
        } else {
            rejected++;
        }
        h = decision.h;
    }
    memcpy(out->y, d->y, d->dim * sizeof(double));
    *out = (outcome){out->y, steps, rejected, d->evaluations};
    return true;
}

/* ---- ARKODE ---- */

#if defined(HAVE_ARKODE)

typedef struct arkode {
    const problem *problem;
    SUNContext context;
    void *memory;
    N_Vector y, start;
    double *matrix, *rest; /* used by arkode_dense only */
} arkode;

static int arkode_field(double t, N_Vector y, N_Vector out, void *user) {
    const arkode *a = user;
    const lg_ode *ode = &a->problem->ode[LG_COORDINATES_AMBIENT];
    return ode->field(ode->user, t, N_VGetArrayPointer(y), NULL, N_VGetArrayPointer(out)) == LG_OK ? 0 : -1;
}

extern void dposv_(const char *uplo, const int *n, const int *columns, double *a, const int *lda, double *b,
                   const int *ldb, int *info);
extern void dgesv_(const int *n, const int *columns, double *a, const int *lda, int *pivot, double *b,
                   const int *ldb, int *info);
extern void openblas_set_num_threads(int threads);

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Writes c times the 3 x 3 block hat(a)^T hat(b) = (a.b) I - b a^T to block (i, j) of the matrix, which is
 * column-major. i < j is the upper triangle. */
static void put_block(double *matrix, size_t n, size_t i, size_t j, double c, const double *a,
                      const double *b) {
    const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    for (size_t r = 0; r < 3; r++)
        for (size_t s = 0; s < 3; s++)
            matrix[(3 * j + s) * n + 3 * i + r] = c * ((r == s ? dot : 0.0) - b[r] * a[s]);
}

/* Sets up m_ii omega_i' + sum_{j != i} m_ij hat(q_i)^T hat(q_j) omega_j' = sum_{j != i} m_ij |omega_j|^2 q_i
 * x q_j - mu_i g q_i x e3, with m_ij = mu_max(i,j) = N - max(i, j) here. `mirror` fills both triangles,
 * otherwise the upper one is filled. */
static void dense_system(const arkode *a, const double *y, bool mirror) {
    const size_t links = a->problem->links, n = 3 * links;
    for (size_t i = 0; i < links; i++) {
        const double *q = y + 6 * i, mu = (double)(links - i);
        double *rest = a->rest + 3 * i;
        rest[0] = -mu * gravity * q[1];
        rest[1] = mu * gravity * q[0];
        rest[2] = 0.0;
        for (size_t r = 0; r < 3; r++)
            for (size_t s = 0; s < 3; s++) a->matrix[(3 * i + s) * n + 3 * i + r] = r == s ? mu : 0.0;
    }
    for (size_t j = 1; j < links; j++)
        for (size_t i = 0; i < j; i++) {
            const double *qi = y + 6 * i, *qj = y + 6 * j, m = (double)(links - j);
            const double wi = qi[3] * qi[3] + qi[4] * qi[4] + qi[5] * qi[5];
            const double wj = qj[3] * qj[3] + qj[4] * qj[4] + qj[5] * qj[5];
            double c[3];
            cross(qi, qj, c);
            for (size_t r = 0; r < 3; r++) {
                a->rest[3 * i + r] += m * wj * c[r];
                a->rest[3 * j + r] -= m * wi * c[r];
            }
            put_block(a->matrix, n, i, j, m, qi, qj);
            if (mirror) put_block(a->matrix, n, j, i, m, qj, qi);
        }
}

/* Solves by Cholesky's method. Off the manifold the matrix may not be positive definite; then it solves by
 * elimination. */
static int arkode_dense(double t, N_Vector state, N_Vector rate, void *user) {
    const arkode *a = user;
    const double *y = N_VGetArrayPointer(state);
    double *out = N_VGetArrayPointer(rate);
    const int n = (int)(3 * a->problem->links), one = 1;
    int info = 0;
    (void)t;
    dense_system(a, y, false);
    dposv_("U", &n, &one, a->matrix, &n, a->rest, &n, &info);
    if (info != 0) {
        int *pivot = allocate((size_t)n, sizeof *pivot);
        dense_system(a, y, true);
        dgesv_(&n, &one, a->matrix, &n, pivot, a->rest, &n, &info);
        free(pivot);
        if (info != 0) return 1;
    }
    for (size_t i = 0; i < a->problem->links; i++) {
        cross(y + 6 * i + 3, y + 6 * i, out + 6 * i);
        memcpy(out + 6 * i + 3, a->rest + 3 * i, 3 * sizeof(double));
    }
    return 0;
}

static void *arkode_make_with(const problem *p, ARKRhsFn f) {
    arkode *a = allocate(1, sizeof *a);
    a->problem = p;
    openblas_set_num_threads(1);
    if (SUNContext_Create(NULL, &a->context) != 0) exit(1);
    a->y = N_VNew_Serial((sunindextype)p->dim, a->context);
    a->start = N_VMake_Serial((sunindextype)p->dim, p->y0, a->context);
    a->matrix = allocate(9 * p->links * p->links, sizeof(double));
    a->rest = allocate(3 * p->links, sizeof(double));
    N_VScale(1.0, a->start, a->y);
    a->memory = ERKStepCreate(f, 0.0, a->y, a->context);
    int status = a->memory ? 0 : -1;
    status |= ERKStepSetUserData(a->memory, a);
    status |= ERKStepSetTableNum(a->memory, ARKODE_DORMAND_PRINCE_7_4_5);
    status |= ERKStepSetMaxNumSteps(a->memory, 10000000);
    if (status != 0) exit(1);
    return a;
}

static void *arkode_make(const problem *p) {
    return arkode_make_with(p, arkode_field);
}

static void *arkode_dense_make(const problem *p) {
    return arkode_make_with(p, arkode_dense);
}

static bool arkode_run_with(void *self, ARKRhsFn f, double tolerance, outcome *out) {
    arkode *a = self;
    double t = 0.0;
    long steps = 0, tried = 0, before = 0, after = 0;
    long before_steps = 0, before_tried = 0;
    (void)ERKStepGetNumRhsEvals(a->memory, &before);
    (void)ERKStepGetNumSteps(a->memory, &before_steps);
    (void)ERKStepGetNumStepAttempts(a->memory, &before_tried);
    N_VScale(1.0, a->start, a->y);
    int status = ERKStepReInit(a->memory, f, 0.0, a->y);
    status |= ERKStepSStolerances(a->memory, tolerance, tolerance);
    status |= ERKStepSetStopTime(a->memory, t_end);
    if (status != 0 || ERKStepEvolve(a->memory, t_end, a->y, &t, ARK_NORMAL) < 0) return false;
    (void)ERKStepGetNumRhsEvals(a->memory, &after);
    (void)ERKStepGetNumSteps(a->memory, &steps);
    (void)ERKStepGetNumStepAttempts(a->memory, &tried);
    if (after < before) before = 0; /* the counter restarted with this run */
    if (steps <= before_steps) before_steps = before_tried = 0;
    memcpy(out->y, N_VGetArrayPointer(a->y), a->problem->dim * sizeof(double));
    *out = (outcome){out->y, (size_t)steps, (size_t)(tried - steps), (size_t)after};
    return true;
}

static bool arkode_run(void *self, double tolerance, outcome *out) {
    return arkode_run_with(self, arkode_field, tolerance, out);
}

static bool arkode_dense_run(void *self, double tolerance, outcome *out) {
    return arkode_run_with(self, arkode_dense, tolerance, out);
}

static void arkode_end(void *self) {
    arkode *a = self;
    ERKStepFree(&a->memory);
    N_VDestroy(a->y);
    N_VDestroy(a->start);
    (void)SUNContext_Free(&a->context);
    free(a->matrix);
    free(a->rest);
    free(a);
}

#endif

static const method methods[] = {
    {"rkmk54", rkmk_make, ours_run, ours_end},
    {"hand", hand_make, hand_run, hand_end},
    {"dp54", dp_make, ours_run, ours_end},
#if defined(HAVE_ARKODE)
    {"arkode", arkode_make, arkode_run, arkode_end},
    {"arkode-dense", arkode_dense_make, arkode_dense_run, arkode_end},
#endif
};
enum { METHODS = sizeof methods / sizeof *methods };

/* ---- measuring ---- */

static problem problem_make(size_t links) {
    problem p = {.links = links, .dim = 6 * links};
    const double start[6] = {sqrt(0.5), 0.0, sqrt(0.5), 0.0, 1.0, 0.0};
    lg_system_options options;
    lg_system_options_init(&options);
    options.links = links;
    double *ones = allocate(links, sizeof *ones);
    for (size_t i = 0; i < links; i++) ones[i] = 1.0;
    const lg_named_values values[] = {
        {"gravity", &gravity, 1}, {"masses", ones, links}, {"lengths", ones, links}};
    options.form = "lagrangian";
    options.parameters = values;
    options.parameter_count = sizeof values / sizeof *values;
    check(lg_system_create(NULL, "pendulum-chain", &options, &p.system, NULL), "pendulum-chain");
    free(ones);
    p.y0 = allocate(p.dim, sizeof(double));
    p.reference = allocate(p.dim, sizeof(double));
    for (size_t i = 0; i < p.dim; i++) p.y0[i] = start[i % 6];
    for (int form = 0; form < 2; form++) p.work[form] = allocate(lg_system_work_size(p.system), 1);
    return p;
}

/* Computes the fields and the reference. From here on the problem must stay at its address. */
static void problem_prepare(problem *p) {
    outcome exact = {.y = p->reference}, other = {.y = allocate(p->dim, sizeof(double))};
    for (int form = 0; form < 2; form++)
        check(lg_system_ode(p->system, (lg_coordinates)form, &p->ode[form], &p->user[form], p->work[form]),
              "field");
    void *lie = rkmk_make(p), *classical = dp_make(p);
    if (!ours_run(lie, reference_tolerance, &exact) || !ours_run(classical, reference_tolerance, &other)) {
        (void)fprintf(stderr, "ode_peers: no reference for %zu links\n", p->links);
        exit(1);
    }
    p->reference_error = difference(p->dim, other.y, p->reference);
    ours_end(lie);
    ours_end(classical);
    free(other.y);
}

static void problem_end(problem *p) {
    lg_system_destroy(p->system);
    for (int form = 0; form < 2; form++) free(p->work[form]);
    free(p->y0);
    free(p->reference);
}

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double timed(const method *m, void *self, double tolerance, outcome *out, size_t runs) {
    const double begin = seconds();
    for (size_t i = 0; i < runs; i++) (void)m->run(self, tolerance, out);
    return (seconds() - begin) / (double)runs;
}

/* Runs all methods at one tolerance, alternating, and prints their results. */
static void compare_at(const problem *p, void *const *self, double tolerance, int rounds, bool first) {
    static double samples[METHODS][MAX_ROUNDS];
    outcome out[METHODS];
    size_t runs[METHODS];
    bool works[METHODS];
    for (int m = 0; m < METHODS; m++) {
        out[m] = (outcome){.y = allocate(p->dim, sizeof(double))};
        works[m] = methods[m].run(self[m], tolerance, &out[m]);
        const double one = works[m] ? timed(&methods[m], self[m], tolerance, &out[m], 1) : 1.0;
        runs[m] = 1 + (size_t)(sample_seconds / fmax(one, 1e-8));
    }
    for (int r = 0; r < rounds; r++)
        for (int m = 0; m < METHODS; m++)
            if (works[m]) samples[m][r] = timed(&methods[m], self[m], tolerance, &out[m], runs[m]);
    for (int m = 0; m < METHODS; m++) {
        qsort(samples[m], (size_t)rounds, sizeof(double), ascending);
        if (works[m]) {
            (void)printf(
                "%s\n{\"method\": \"%s\", \"tolerance\": %.17g, \"median_s\": %.6g, \"min_s\": %.6g, "
                "\"error\": %.6g, ",
                first ? "" : ",", methods[m].name, tolerance, samples[m][rounds / 2], samples[m][0],
                difference(p->dim, out[m].y, p->reference));
            (void)printf("\"steps\": %zu, \"rejected\": %zu, \"evaluations\": %zu, \"manifold_error\": %.3g}",
                         out[m].steps, out[m].rejected, out[m].evaluations, manifold_error(p, out[m].y));
            first = false;
        }
        free(out[m].y);
    }
}

static void compare(size_t links, int rounds, bool first) {
    problem p = problem_make(links);
    void *self[METHODS];
    problem_prepare(&p);
    for (int m = 0; m < METHODS; m++) self[m] = methods[m].make(&p);
    outcome warm = {.y = allocate(p.dim, sizeof(double))};
    for (const double begin = seconds(); seconds() - begin < warm_seconds;)
        for (int m = 0; m < METHODS; m++) (void)methods[m].run(self[m], 1e-6, &warm);
    free(warm.y);
    (void)printf("%s\n{\"links\": %zu, \"reference_error\": %.3g, \"points\": [", first ? "" : ",", links,
                 p.reference_error);
    for (int i = 0; i < TOLERANCES; i++) compare_at(&p, self, pow(10.0, -3.0 - 0.5 * i), rounds, i == 0);
    (void)printf("]}");
    for (int m = 0; m < METHODS; m++) methods[m].end(self[m]);
    problem_end(&p);
}

int main(int argc, char **argv) {
    static const size_t usual[] = {2, 6, 10, 20};
    const int rounds = argc > 1 ? atoi(argv[1]) : 7;
    if (rounds < 1 || rounds > MAX_ROUNDS) {
        (void)fprintf(stderr, "ode_peers [ROUNDS [LINKS...]]: 1 to %d rounds\n", MAX_ROUNDS);
        return 2;
    }
    (void)printf("{\"core\": %d, \"rounds\": %d, \"chains\": [", pin(), rounds);
    if (argc > 2)
        for (int i = 2; i < argc; i++) compare((size_t)strtoul(argv[i], NULL, 10), rounds, i == 2);
    else
        for (size_t i = 0; i < sizeof usual / sizeof *usual; i++) compare(usual[i], rounds, i == 0);
    (void)printf("]}\n");
    return 0;
}
