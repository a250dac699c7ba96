/* Motion of the riser by Newmark's rule with beta = 1/4, gamma = 1/2 (Newmark 1959). The linear part is
 * implicit; it includes linear springs of soil and wellhead with their nominal stiffness. Drag is evaluated
 * at predicted velocities. The foundation's true force laws differ from the linear springs; this difference
 * depends on four numbers, the offsets and rotations in x and y. It is evaluated at predicted offsets and
 * rotations, which two fixed-point rounds correct. */
#include <math.h>
#include <string.h>

#include "liegrad/core.h"
#include "anomaly/riser.h"

#define ROUNDS 2 /* fixed-point rounds for the foundation, see docs/detectors.md */

/* ---- foundation ---- */

void lg_wellhead_make(const lg_riser_parameters *p, lg_wellhead *out) {
    const double casing = p->severity * p->housing_stiffness;
    const double housing = p->housing_factor * p->housing_stiffness;
    const bool tight = p->housing == LG_HOUSING_TIGHT;
    const double inner = tight ? casing : 1.0 / (1.0 / housing + 1.0 / casing);
    *out = (lg_wellhead){.tight = tight,
                         .inner = inner,
                         .outer = casing,
                         .gap = p->housing_gap / inner,
                         .gap_moment = p->housing_gap,
                         .softening = p->softening};
}

double lg_wellhead_secant(const lg_wellhead *w, double r) {
    if (w->tight) return w->outer;
    const double k = r <= w->gap ? w->inner : w->outer + (w->gap_moment - w->outer * w->gap) / r;
    return k / (1.0 + r / w->softening);
}

double lg_soil_secant(double stiffness, double strength, double r) {
    const double x = stiffness * r / strength;
    return x < 1e-8 ? stiffness : stiffness * (tanh(x) / x);
}

/* ---- matrices of a step ---- */

static void add_foundation(const lg_riser_motion *m, double *k) {
    k[0] += m->soil_stiffness;
    k[LG_RISER_DOF + 1] += m->wellhead.outer;
}

/* Makes the table of Newmark's acceleration from S = M + dt/2 C + dt^2/4 K. The three blocks of its rows are
 * S^-1, -K S^-1, -C S^-1. */
static lg_status make_operator(const lg_riser_motion *m, const double *c, double dt, lg_riser_operator *out) {
    enum { N = LG_RISER_DOF };
    double s[LG_RISER_MATRIX], l[LG_RISER_MATRIX], x[LG_RISER_MATRIX];
    double part[3][LG_RISER_MATRIX] = {{0.0}};
    for (size_t i = 0; i < N; i++) part[0][i * N + i] = -1.0;
    memcpy(part[1], m->matrices.stiffness, sizeof part[1]);
    add_foundation(m, part[1]);
    memcpy(part[2], c, sizeof part[2]);
    for (size_t i = 0; i < LG_RISER_MATRIX; i++)
        s[i] = m->matrices.mass[i] + 0.5 * dt * part[2][i] + 0.25 * dt * dt * part[1][i];
    if (m->kernels->spd_factor(1, N, s, l) != 0) return LG_INVALID_ARGUMENT;
    memset(out, 0, sizeof *out);
    for (size_t b = 0; b < 3; b++) {
        m->kernels->spd_solve(1, N, N, l, part[b], x);
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j < N; j++)
                out->table[(b * LG_RISER_ROW + i) * LG_RISER_ROW + j] = -x[j * N + i];
    }
    return LG_OK;
}

/* Takes over a changed severity of the damage; positions, velocities and accelerations stay as they are. */
static lg_status change(lg_riser_motion *m, const lg_riser_parameters *p, bool damped) {
    double none[LG_RISER_MATRIX] = {0.0};
    const double *c = damped ? m->matrices.damping : none;
    lg_wellhead_make(p, &m->wellhead);
    LG_TRY(make_operator(m, c, 0.0, &m->start));
    return make_operator(m, c, m->dt, &m->step);
}

lg_status lg_riser_motion_init(const lg_riser_parameters *p, double dt, bool damped, double drag_scale,
                               lg_riser_motion *out) {
    const double l = lg_riser_segment(p);
    const double bop = 0.5 * p->rho * p->bop_drag * p->bop_diameter * p->bop_height;
    const double segment = 0.5 * p->rho * p->drag * p->hydro_diameter * l, scale = damped ? drag_scale : 0.0;
    memset(out, 0, sizeof *out);
    out->kernels = lg_kernels_for(LG_F64);
    out->dt = dt;
    out->bop_centre = p->bop_centre;
    out->bop_height = p->bop_height;
    out->soil_stiffness = p->soil_stiffness;
    out->soil_strength = p->soil_strength;
    for (size_t s = 0; s < LG_RISER_DOF; s++)
        out->drag[s] = scale * (s == 0 ? bop : s == 1 ? segment / 2.0 : segment);
    lg_riser_matrices_make(p, &out->matrices);
    return change(out, p, damped);
}

/* ---- a step ---- */

static double radius(const double *q, size_t dof) {
    const double x = q[dof], y = q[LG_RISER_ROW + dof];
    return sqrt(x * x + y * y);
}

/* Writes the generalised forces of the water at the velocities v into the first LG_RISER_ROW entries of each
 * direction of m->input. */
static void water_forces(lg_riser_motion *m, const double *water, const double *v) {
    enum { R = LG_RISER_ROW };
    const double *inertia = water + LG_RISER_STATE, h = m->bop_centre, L = m->bop_height;
    double w[2 * R], pull[R];
    for (size_t i = 0; i < 2 * R; i++) w[i] = water[i] - v[i];
    for (size_t d = 0; d < 2 * R; d += R) {
        w[d] = water[d] - (v[d] + h * v[d + 1]);
        w[d + 1] = water[d + 1] - (v[d] + L * v[d + 1]);
    }
    for (size_t s = 0; s < R; s++) pull[s] = m->drag[s] * sqrt(w[s] * w[s] + w[R + s] * w[R + s]);
    for (size_t d = 0; d < 2; d++) {
        double *f = m->input + d * LG_RISER_INPUTS;
        for (size_t s = 0; s < R; s++) f[s] = inertia[d * R + s] + pull[s] * w[d * R + s];
        const double bop = pull[0] * w[d * R], joint = pull[1] * w[d * R + 1];
        f[0] = inertia[d * R] + bop + joint;
        f[1] = inertia[d * R + 1] + h * bop + L * joint;
    }
}

/* Difference between the linear springs of the foundation and its true laws: forces and moments at x = (ux,
 * thx, uy, thy). */
static void shortfall(const lg_riser_motion *m, const double x[4], double out[4]) {
    const double soil = m->soil_stiffness -
                        lg_soil_secant(m->soil_stiffness, m->soil_strength, sqrt(x[0] * x[0] + x[2] * x[2]));
    const double head = m->wellhead.outer - lg_wellhead_secant(&m->wellhead, sqrt(x[1] * x[1] + x[3] * x[3]));
    for (size_t d = 0; d < 4; d += 2) {
        out[d] = soil * x[d];
        out[d + 1] = head * x[d + 1];
    }
}

static void apply(lg_riser_motion *m, const lg_riser_operator *operator, double * a) {
    m->kernels->gemm(2, LG_RISER_ROW, LG_RISER_INPUTS, m->input, LG_RISER_INPUTS, 1, operator->table,
                     LG_RISER_ROW, a, LG_RISER_ROW, false);
}

/* a += S^-1 f. The force f acts on offset and rotation only, so only the first two rows of the table are
 * needed. */
static void add_shortfall(const lg_riser_operator *operator, const double f[4], double *a) {
    const double *u = operator->table, *th = u + LG_RISER_ROW;
    for (size_t d = 0; d < 2; d++)
        for (size_t i = 0; i < LG_RISER_ROW; i++)
            a[d * LG_RISER_ROW + i] += f[2 * d] * u[i] + f[2 * d + 1] * th[i];
}

void lg_riser_motion_start(lg_riser_motion *m, const double *water) {
    const double x[4] = {m->q[0], m->q[1], m->q[LG_RISER_ROW], m->q[LG_RISER_ROW + 1]};
    double f[4];
    water_forces(m, water, m->v);
    for (size_t d = 0; d < 2; d++) {
        double *in = m->input + d * LG_RISER_INPUTS;
        memcpy(in + LG_RISER_ROW, m->q + d * LG_RISER_ROW, LG_RISER_ROW * sizeof *in);
        memcpy(in + 2 * LG_RISER_ROW, m->v + d * LG_RISER_ROW, LG_RISER_ROW * sizeof *in);
    }
    apply(m, &m->start, m->a);
    shortfall(m, x, f);
    add_shortfall(&m->start, f, m->a);
}

/* Computes the difference f between springs and laws (see shortfall) at the end of the step, by fixed-point
 * iteration from a prediction. m->input holds the predictor q~. `a` is the acceleration at the end of the
 * step without f. Each round multiplies the error by dt^2/4 times S^-1 times the difference in stiffness. */
static void end_shortfall(const lg_riser_motion *m, const double *a, double f[4]) {
    const double quarter = 0.25 * m->dt * m->dt, *u = m->step.table, *th = u + LG_RISER_ROW;
    double base[4], x[4];
    for (size_t d = 0; d < 2; d++)
        for (size_t i = 0; i < 2; i++) {
            const double half = m->input[d * LG_RISER_INPUTS + LG_RISER_ROW + i];
            base[2 * d + i] = half + quarter * a[d * LG_RISER_ROW + i];
            x[2 * d + i] = half + quarter * m->a[d * LG_RISER_ROW + i];
        }
    shortfall(m, x, f);
    for (int round = 0; round < ROUNDS; round++) {
        for (size_t d = 0; d < 4; d += 2)
            for (size_t i = 0; i < 2; i++)
                x[d + i] = base[d + i] + quarter * (f[d] * u[i] + f[d + 1] * th[i]);
        shortfall(m, x, f);
    }
}

void lg_riser_motion_step(lg_riser_motion *m, const double *water) {
    enum { R = LG_RISER_ROW };
    const double dt = m->dt, quarter = 0.25 * dt * dt;
    double v[LG_RISER_STATE], f[4];
    for (size_t d = 0; d < 2; d++) {
        double *half = m->input + d * LG_RISER_INPUTS + R;
        for (size_t i = d * R, k = 0; k < R; i++, k++) {
            half[k] = m->q[i] + dt * m->v[i] + quarter * m->a[i];
            half[R + k] = m->v[i] + 0.5 * dt * m->a[i];
            v[i] = m->v[i] + dt * m->a[i]; /* predicted with the acceleration at the start of the step */
        }
    }
    water_forces(m, water, v);
    apply(m, &m->step, m->next);
    end_shortfall(m, m->next, f);
    add_shortfall(&m->step, f, m->next);
    memcpy(m->a, m->next, sizeof m->a);
    for (size_t d = 0; d < 2; d++) {
        const double *half = m->input + d * LG_RISER_INPUTS + R;
        for (size_t i = d * R, k = 0; k < R; i++, k++) {
            m->q[i] = half[k] + quarter * m->a[i];
            m->v[i] = half[R + k] + 0.5 * dt * m->a[i];
        }
    }
}

/* ---- runs ---- */

#define STREAM_NOISE 2

void lg_riser_run_init(lg_riser_run *out) {
    *out = (lg_riser_run){.size = sizeof(*out),
                          .sea = {.height = 2.5, .period = 8.0},
                          .seed = 1,
                          .noise_seed = 1,
                          .noise = 1.0,
                          .dt = 0.05,
                          .rate = 5.0,
                          .discard = 200.0,
                          .ramp = 100.0,
                          .drag_scale = 1.0};
}

static bool is_size(double x) {
    return x >= 0.0 && isfinite(x);
}

static const char *run_fault(const lg_riser_run *r) {
    if (!r || r->size != sizeof(*r)) return "the run was not initialised: its size is unknown";
    if (!is_size(r->sea.height)) return "the height of the sea must be zero or positive";
    if (r->sea.height > 0.0 && !(r->sea.period > 0.0 && isfinite(r->sea.period)))
        return "the period of the sea must be positive";
    if (!isfinite(r->sea.direction)) return "the direction of the sea must be finite";
    if (!is_size(r->noise)) return "noise must be zero or positive";
    if (!(r->dt > 0.0) || !isfinite(r->dt)) return "dt must be positive";
    if (!(r->rate > 0.0) || !isfinite(r->rate)) return "the rate must be positive";
    const double steps = 1.0 / (r->rate * r->dt);
    if (!(steps < 1e9) || steps < 0.5 || fabs(steps - round(steps)) > 1e-9 * steps)
        return "a sample must take a whole number of steps: 1/(rate dt)";
    if (!is_size(r->discard) || r->discard / r->dt > 1e12)
        return "discard must be zero or positive, and finite";
    if (!is_size(r->ramp)) return "ramp must be zero or positive";
    /* INFINITY is allowed: the crack never comes */
    if (!(r->crack_time >= 0.0)) return "crack_time must be zero or positive";
    if (!is_size(r->drag_scale)) return "drag_scale must be zero or positive";
    return NULL;
}

typedef struct simulation {
    lg_riser_motion motion;
    lg_water water;
    const lg_context *context;
    const lg_riser_parameters *parameters; /* after the crack */
    const lg_riser_run *run;
    lg_rng noise;
    size_t step, discarded,
        steps; /* number of the current step; steps before the first sample, and for one */
    /* Number of the first sample after the crack. SIZE_MAX if the crack never comes or is there from the
     * start. */
    size_t crack;
} simulation;

static size_t crack_sample(const lg_riser_run *run) {
    const double at = ceil(run->crack_time * run->rate - 1e-6);
    return run->crack_time == 0.0 || !(at < 1e18) ? SIZE_MAX : (size_t)at;
}

static lg_status no_water(lg_error *error, lg_status status, const lg_riser_parameters *p,
                          const lg_riser_run *run) {
    if (status == LG_OUT_OF_MEMORY) return lg_fail(error, status, "no memory for the riser's waves");
    return lg_fail(
        error, status,
        "riser: waves of height %g m and period %g s in a depth of %g m cannot be computed: numbers overflow",
        run->sea.height, run->sea.period, p->depth);
}

static lg_status begin(simulation *s, lg_error *error) {
    const lg_riser_run *run = s->run;
    lg_riser_parameters before = *s->parameters;
    const lg_status status = lg_water_create(s->context, s->parameters, run, &s->water);
    if (status != LG_OK) return no_water(error, status, s->parameters, run);
    s->discarded = (size_t)llround(run->discard / run->dt);
    s->steps = (size_t)llround(1.0 / (run->rate * run->dt));
    s->crack = crack_sample(run);
    lg_rng_seed(&s->noise, run->noise_seed, STREAM_NOISE);
    if (run->crack_time > 0.0) before.severity = 1.0;
    if (lg_riser_motion_init(&before, run->dt, true, run->drag_scale, &s->motion) != LG_OK)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "riser: with these parameters the structure does not stand");
    lg_riser_motion_start(&s->motion, lg_water_at(&s->water, 0));
    return LG_OK;
}

/* Computes the measurements without noise. */
static void measure(const simulation *s, double out[LG_RISER_CHANNELS]) {
    const lg_riser_parameters *p = s->parameters;
    const lg_riser_motion *m = &s->motion;
    const double l = lg_riser_segment(p);
    const double soil = lg_soil_secant(p->soil_stiffness, p->soil_strength, radius(m->q, 0));
    const double head = lg_wellhead_secant(&m->wellhead, radius(m->q, 1));
    for (size_t d = 0; d < 2; d++) {
        const double *q = m->q + d * LG_RISER_ROW, *a = m->a + d * LG_RISER_ROW;
        const double joint = q[0] + p->bop_height * q[1], joint_acc = a[0] + p->bop_height * a[1];
        const double slope = (q[2] - joint) / l, slope_acc = (a[2] - joint_acc) / l;
        out[d] = a[0] + p->sensor_lower * a[1] - p->gravity * q[1];
        out[2 + d] = joint_acc + p->sensor_upper * slope_acc - p->gravity * slope;
        out[4 + d] = head * q[1] + p->sensor_moment * soil * q[0];
    }
}

static lg_status advance(simulation *s, size_t to) {
    while (s->step < to) {
        const double *water = lg_water_at(&s->water, s->step + 1);
        if (s->step % LG_WATER_BLOCK == 0 && lg_cancelled(s->context)) return LG_CANCELLED;
        lg_riser_motion_step(&s->motion, water);
        s->step++;
    }
    return LG_OK;
}

static lg_status take_sample(simulation *s, size_t number, float *sample) {
    const lg_riser_parameters *p = s->parameters;
    double clean[LG_RISER_CHANNELS];
    LG_TRY(advance(s, s->discarded + number * s->steps));
    if (number == s->crack) {
        LG_TRY(change(&s->motion, p, true));
        lg_riser_motion_start(&s->motion, lg_water_at(&s->water, s->step));
    }
    measure(s, clean);
    for (size_t c = 0; c < LG_RISER_CHANNELS; c++) {
        const double sigma = s->run->noise * (c < 4 ? p->noise_acceleration : p->noise_moment);
        if (!(fabs(clean[c]) < 1e30)) return LG_NOT_FINITE;
        sample[c] = (float)(sigma > 0.0 ? clean[c] + sigma * lg_rng_normal(&s->noise) : clean[c]);
    }
    return LG_OK;
}

static lg_status take_samples(simulation *s, size_t count, float *samples, lg_error *error) {
    LG_TRY(begin(s, error));
    for (size_t i = 0; i < count; i++) {
        const lg_status status = take_sample(s, i, samples + i * LG_RISER_CHANNELS);
        if (status == LG_NOT_FINITE)
            return lg_fail(error, status,
                           "riser: the motion grew without bound by %g s: dt = %g s is too large",
                           (double)s->step * s->motion.dt, s->motion.dt);
        if (status != LG_OK) return lg_fail(error, status, "riser: %s", lg_status_sentence(status));
    }
    return LG_OK;
}

lg_status lg_riser_simulate(const lg_context *context, const lg_riser_parameters *parameters,
                            const lg_riser_run *run, size_t count, float *samples, lg_error *error) {
    simulation s = {.context = context, .parameters = parameters, .run = run};
    LG_NEEDS(error, samples);
    LG_TRY(lg_riser_parameters_check(parameters, error));
    const char *fault = run_fault(run);
    if (fault) return lg_fail(error, LG_INVALID_ARGUMENT, "riser: %s", fault);
    float *kept = lg_alloc(context, count, LG_RISER_CHANNELS * sizeof *kept);
    if (!kept) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu samples", count);
    const lg_status status = take_samples(&s, count, kept, error);
    if (status == LG_OK) memcpy(samples, kept, count * LG_RISER_CHANNELS * sizeof *samples);
    lg_free(context, kept);
    lg_water_destroy(context, &s.water);
    return status;
}
