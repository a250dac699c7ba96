/* Random starts, and trajectories of a system computed with the reference integrator. */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "core/clean.h"
#include "mechanics/system.h"

/* ---- starts ---- */

static void box_start(lg_rng *rng, double low, double high, size_t n, double *y) {
    for (size_t i = 0; i < n; i++) y[i] = lg_rng_uniform_in(rng, low, high);
}

/* q is uniform on the sphere; p = q x u, with u uniform in the box. */
static void sphere_start(lg_rng *rng, double low, double high, size_t n, double *y) {
    double norm = 0.0, u[3];
    while (!(norm > 1e-8)) { /* almost always one draw is enough */
        for (int c = 0; c < 3; c++) y[c] = lg_rng_normal(rng);
        norm = sqrt(lg_dot3(y, y));
    }
    for (int c = 0; c < 3; c++) y[c] /= norm;
    for (int c = 0; c < 3; c++) u[c] = lg_rng_uniform_in(rng, low, high);
    lg_cross3(y, u, y + 3);
}

/* A uniform (Haar) rotation: of the quaternion of four normal numbers, divided by its norm. */
static void rotation_start(lg_rng *rng, double low, double high, size_t n, double *R) {
    double x[4], norm = 0.0;
    while (!(norm > 1e-8)) {
        norm = 0.0;
        for (int i = 0; i < 4; i++) x[i] = lg_rng_normal(rng);
        for (int i = 0; i < 4; i++) norm += x[i] * x[i];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 - i - j;
            const double sign = (j - i + 3) % 3 == 1 ? -1.0 : 1.0; /* of the number k of the vector part */
            const double square = i == j ? norm - 2.0 * (x[1 + (i + 1) % 3] * x[1 + (i + 1) % 3] +
                                                         x[1 + (i + 2) % 3] * x[1 + (i + 2) % 3])
                                         : 2.0 * (x[1 + i] * x[1 + j] + sign * x[0] * x[1 + k]);
            R[3 * i + j] = square / norm;
        }
    lg_so3_project(R);
}

/* A uniform rotation, and three numbers in the box. */
static void body_start(lg_rng *rng, double low, double high, size_t n, double *y) {
    rotation_start(rng, low, high, n, y);
    box_start(rng, low, high, 3, y + 9);
}

/* For each kind of factor: how one copy is drawn, and the low end of the box for LG_STARTS_THESIS. */
static const struct {
    void (*draw)(lg_rng *rng, double low, double high, size_t n, double *y);
    double low;
} samplers[LG_SPACE_KINDS] = {
    [LG_SPACE_RN] = {box_start, -1.0},       [LG_SPACE_TS2] = {sphere_start, 0.0},
    [LG_SPACE_SO3] = {rotation_start, -1.0}, [LG_SPACE_SE3] = {body_start, -1.0},
    [LG_SPACE_SO3_DUAL] = {box_start, -1.0}, [LG_SPACE_SE3_DUAL] = {box_start, -1.0}};

static const char *starts_fault(const lg_trajectory_options *o) {
    if (o->size != sizeof(*o)) return "the size of the options is wrong: initialise the options first";
    if ((unsigned)o->starts >= LG_STARTS_COUNT) return "the kind of the starts is unknown";
    if (o->starts == LG_STARTS_BOX && !(o->low < o->high && isfinite(o->low) && isfinite(o->high)))
        return "low must be below high";
    return NULL;
}

lg_status lg_space_draw_start(const lg_space *space, const lg_trajectory_options *options, lg_rng *rng,
                              double *y) {
    lg_trajectory_options defaults;
    lg_trajectory_options_init(&defaults);
    const lg_trajectory_options *o = options ? options : &defaults;
    if (!space || !rng || !y || starts_fault(o)) return LG_INVALID_ARGUMENT;
    const bool box = o->starts == LG_STARTS_BOX;
    if (o->starts == LG_STARTS_PLANE) return LG_UNSUPPORTED;
    for (size_t f = 0; f < space->factors; f++) {
        const lg_space_kind kind = space->factor[f].kind;
        const size_t n = lg_space_kind_entry(kind)->state;
        const double low = box ? o->low : samplers[kind].low, high = box ? o->high : 1.0;
        for (size_t i = 0; i < space->factor[f].count; i++, y += n) samplers[kind].draw(rng, low, high, n, y);
    }
    return LG_OK;
}

lg_status lg_system_draw_start(const lg_system *system, const lg_trajectory_options *options, lg_rng *rng,
                               double *y) {
    const bool plane = options && options->size == sizeof(*options) && options->starts == LG_STARTS_PLANE;
    if (!system) return LG_INVALID_ARGUMENT;
    if (!plane || !system->row->plane) return lg_space_draw_start(&system->space, options, rng, y);
    return rng && y ? system->row->plane(system, rng, y) : LG_INVALID_ARGUMENT;
}

/* ---- the reference integrator ---- */

typedef struct reference {
    const lg_context *context;
    lg_system_user user;
    lg_stepper *stepper;
    lg_step_controller control;
    double *work;
} reference;

static void reference_destroy(reference *r) {
    lg_stepper_destroy(r->stepper);
    lg_free(r->context, r->work);
}

/* `r` must be destroyed even after an error. */
static lg_status reference_create(const lg_context *context, const lg_system *system, double rtol,
                                  double atol, reference *r, lg_error *error) {
    const bool lie = lg_system_constrained(system);
    lg_ode ode;
    *r = (reference){.context = context, .work = lg_alloc(context, lg_system_work_size(system), 1)};
    lg_step_controller_init(&r->control);
    r->control.rtol = rtol;
    r->control.atol = atol;
    r->control.max_steps = 10000000;
    lg_status status = r->work ? LG_OK : LG_OUT_OF_MEMORY;
    if (status == LG_OK)
        status =
            lg_system_ode(system, lie ? LG_COORDINATES_LIE : LG_COORDINATES_AMBIENT, &ode, &r->user, r->work);
    if (status == LG_OK)
        status = lg_stepper_create(context, lg_scheme_find(lie ? "rkmk54" : "dp54"), &ode, &r->stepper);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "%s: %s", system->row->name, lg_status_sentence(status));
}

/* ---- sampling ---- */

void lg_trajectory_options_init(lg_trajectory_options *options) {
    *options = (lg_trajectory_options){.size = sizeof(lg_trajectory_options),
                                       .trajectories = 500,
                                       .points = 5,
                                       .t_end = 0.1,
                                       .low = -1.0,
                                       .high = 1.0,
                                       .segments = 1,
                                       .seed = 1,
                                       .rtol = 1e-12,
                                       .atol = -1e-13};
}

const char *lg_trajectory_fault(const lg_trajectory_options *o) {
    if (starts_fault(o)) return starts_fault(o);
    if (o->trajectories < 1) return "trajectories must be at least 1";
    if (o->points < 2) return "points must be at least 2";
    if (!(o->t_end > 0.0) || !isfinite(o->t_end)) return "t_end must be positive";
    if (!(o->noise >= 0.0) || !isfinite(o->noise)) return "noise must not be negative";
    if ((unsigned)o->noise_kind > LG_NOISE_UNIFORM) return "the kind of the noise is unknown";
    if (!(o->ahead >= 0.0) || !isfinite(o->ahead)) return "ahead must not be negative";
    if (o->segments < 1) return "segments must be at least 1";
    if (o->first % o->segments != 0) return "first must be a multiple of segments";
    if (!(o->rtol >= 0.0 && isfinite(o->rtol)) || !isfinite(o->atol) || !(o->rtol + fabs(o->atol) > 0.0))
        return "rtol must not be negative, and rtol and atol must be finite and not both zero";
    return NULL;
}

/* One call of lg_system_generate. The results are kept here until all starts have succeeded; then they
 * are copied to the caller's arrays. */
typedef struct sampling {
    const lg_context *context;
    const lg_system *system;
    const lg_trajectory_options *options;
    reference *reference;
    double *t;            /* M */
    double *trajectories; /* (N, M, d) */
    double *hamiltonian;  /* N */
} sampling;

void lg_trajectory_disturb(const lg_trajectory_options *o, size_t d, size_t number, double *trajectory) {
    lg_rng rng;
    lg_rng_seed(&rng, o->seed, 2 * (uint64_t)number + 1);
    /* Noise of the first point is drawn last, so that noise_first does not change that of the others. */
    for (size_t j = d; j < (o->points + (o->noise_first ? 1 : 0)) * d; j++)
        trajectory[j % (o->points * d)] +=
            o->noise *
            (o->noise_kind == LG_NOISE_NORMAL ? lg_rng_normal(&rng) : lg_rng_uniform_in(&rng, -1.0, 1.0));
}

/* Moves the start y along its trajectory for a time of U[0, ahead]. Draws no number if `ahead` is 0. */
static lg_status go_ahead(sampling *s, lg_rng *rng, double *y) {
    const double time = s->options->ahead > 0.0 ? s->options->ahead * lg_rng_uniform(rng) : 0.0;
    double end[1] = {time};
    if (!(time > 0.0)) return LG_OK;
    return lg_integrate_adaptive(s->reference->stepper, &s->reference->control, 0.0, y, end, 1, y, NULL);
}

/* Computes all segments of start `number` of this call. Each segment begins where the one before ended,
 * without noise: noise is added after all of them are integrated. */
static lg_status sample_start(sampling *s, size_t number) {
    const lg_trajectory_options *o = s->options;
    const uint64_t start = o->first / o->segments + number;
    const size_t d = s->system->space.dim, block = o->points * d, first = number * o->segments;
    const size_t last = first + o->segments < o->trajectories ? first + o->segments : o->trajectories;
    lg_rng rng;
    lg_rng_seed(&rng, o->seed, 2 * start);
    LG_TRY(lg_system_draw_start(s->system, o, &rng, s->trajectories + first * block));
    LG_TRY(go_ahead(s, &rng, s->trajectories + first * block));
    for (size_t i = first; i < last; i++) {
        double *y = s->trajectories + i * block;
        if (lg_cancelled(s->context)) return LG_CANCELLED;
        if (i > first) memcpy(y, y - d, d * sizeof(*y));
        LG_TRY(lg_integrate_adaptive(s->reference->stepper, &s->reference->control, 0.0, y, s->t + 1,
                                     o->points - 1, y + d, NULL));
        s->hamiltonian[i] = lg_system_hamiltonian(s->system, y, s->reference->work);
    }
    for (size_t i = first; o->noise > 0.0 && i < last; i++) {
        lg_trajectory_disturb(o, d, o->first + i, s->trajectories + i * block);
        if (o->noise_first) lg_space_project(&s->system->space, s->trajectories + i * block);
    }
    return LG_OK;
}

static lg_status sample_all(sampling *s, lg_error *error) {
    const lg_trajectory_options *o = s->options;
    for (size_t j = 0; j < o->points; j++) s->t[j] = o->t_end * (double)j / (double)(o->points - 1);
    for (size_t number = 0; number * o->segments < o->trajectories; number++) {
        const lg_status status = sample_start(s, number);
        if (status != LG_OK)
            return lg_fail(error, status, "%s, start %zu: %s", s->system->row->name,
                           o->first / o->segments + number, lg_status_sentence(status));
    }
    return LG_OK;
}

lg_status lg_system_generate(const lg_context *context, const lg_system *system,
                             const lg_trajectory_options *options, double *t, double *trajectories,
                             double *hamiltonian, lg_error *error) {
    lg_trajectory_options defaults;
    lg_trajectory_options_init(&defaults);
    const lg_trajectory_options *o = options ? options : &defaults;
    LG_NEEDS(error, system, t, trajectories, hamiltonian);
    const char *fault = lg_trajectory_fault(o);
    if (fault) return lg_fail(error, LG_INVALID_ARGUMENT, "%s", fault);
    const size_t d = system->space.dim, n = o->trajectories;
    if (n > SIZE_MAX / sizeof(double) / 4 / d / o->points)
        return lg_fail(error, LG_OUT_OF_MEMORY, "too many points");
    const size_t states = n * o->points * d;
    LG_TRY_SCRATCH(double, memory, context, states + n + o->points,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu trajectories", n));
    LG_CLEAN(reference_destroy) reference r;
    LG_TRY(reference_create(context, system, o->rtol, o->atol, &r, error));
    sampling s = {.context = context,
                  .system = system,
                  .options = o,
                  .reference = &r,
                  .t = memory + states + n,
                  .trajectories = memory,
                  .hamiltonian = memory + states};
    LG_TRY(sample_all(&s, error));
    memcpy(t, s.t, o->points * sizeof(*t));
    memcpy(trajectories, s.trajectories, states * sizeof(*trajectories));
    memcpy(hamiltonian, s.hamiltonian, n * sizeof(*hamiltonian));
    return lg_fail(error, LG_OK, "%s", "");
}

/* ---- reference solutions ---- */

static lg_status run_references(const lg_context *context, reference *r, size_t d, const double *starts,
                                size_t n, const double *times, size_t count, double *out, lg_error *error) {
    for (size_t i = 0; i < n; i++) {
        lg_status status = lg_cancelled(context)
                               ? LG_CANCELLED
                               : lg_integrate_adaptive(r->stepper, &r->control, 0.0, starts + i * d, times,
                                                       count, out + i * count * d, NULL);
        if (status != LG_OK)
            return lg_fail(error, status, "trajectory %zu: %s", i, lg_status_sentence(status));
    }
    return LG_OK;
}

lg_status lg_system_solve(const lg_context *context, const lg_system *system, const double *starts, size_t n,
                          const double *times, size_t count, double rtol, double atol, double *out,
                          lg_error *error) {
    if (!system || !starts || !times || !out || n < 1 || count < 1 || !isfinite(rtol) || !isfinite(atol))
        return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is NULL, empty or not finite");
    const size_t d = system->space.dim;
    if (n > SIZE_MAX / sizeof(double) / d / count) return lg_fail(error, LG_OUT_OF_MEMORY, "too many points");
    LG_TRY_SCRATCH(double, memory, context, n *count *d,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu trajectories", n));
    LG_CLEAN(reference_destroy) reference r;
    LG_TRY(
        reference_create(context, system, rtol > 0.0 ? rtol : 1e-12, atol != 0.0 ? atol : -1e-13, &r, error));
    LG_TRY(run_references(context, &r, d, starts, n, times, count, memory, error));
    memcpy(out, memory, n * count * d * sizeof(*out));
    return lg_fail(error, LG_OK, "%s", "");
}
