/* Generation of sets of curves over families of boundary conditions. */
#include <math.h>

#include "elastica/elastica.h"

/* Number of values of x per block. In a block each curve starts from the one before. Blocks do not depend on
 * the number of threads, so the results do not either. */
#define BLOCK 25
/* A curve starts from the one before only if no end angle changes by more than this, radians. In both
 * families theta_N changes by at least as much as theta_0. */
#define NEAR 0.2

/* ---- memory ---- */

lg_status lg_elastica_curves_create(const lg_context *context, size_t count, uint32_t intervals,
                                    bool optional, lg_elastica_curves *out) {
    if (!out || count < 1 || intervals < 1 || intervals > LG_ELASTICA_MAX_INTERVALS)
        return LG_INVALID_ARGUMENT;
    const size_t row = 2 * ((size_t)intervals + 1) * sizeof(double);
    lg_elastica_curves c = {.count = count, .intervals = intervals, .context = context};
    lg_status status = LG_ALLOC_ALL(context, {&c.boundary, count, 8 * sizeof(double)}, {&c.q, count, row},
                                    {&c.v, count, row});
    if (optional && status == LG_OK)
        status =
            LG_ALLOC_ALL(context, LG_ARRAY(c.energy, count), LG_ARRAY(c.x, count), LG_ARRAY(c.kind, count));
    if (status == LG_OK)
        *out = c;
    else
        lg_elastica_curves_destroy(&c);
    return status;
}

void lg_elastica_curves_destroy(lg_elastica_curves *curves) {
    if (!curves) return;
    LG_FREE_ALL(curves->context, curves->boundary, curves->q, curves->v, curves->energy, curves->x,
                curves->kind);
    *curves = (lg_elastica_curves){.count = 0};
}

/* ---- sampling ---- */

void lg_elastica_sampling_init(lg_elastica_sampling *sampling) {
    *sampling = (lg_elastica_sampling){.both_ends = true, .count = 1000, .gap = 0.01, .threads = 1};
    lg_elastica_init(&sampling->problem);
}

static lg_status check_sampling(const lg_elastica_sampling *s, lg_error *error) {
    if (!s->both_ends && !s->right_end)
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: no family of curves is chosen");
    if (s->count < 1) return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: count must be at least 1");
    if (isnan(s->gap)) return lg_fail(error, LG_NOT_FINITE, "elastica: the gap is not finite");
    if (!(s->gap >= 0.0 && s->gap < 0.5))
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: the gap is %g, expected a number in [0, 0.5)",
                       s->gap);
    if (s->threads < 1 || s->threads > 1024)
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: %d threads; 1 to 1024 are possible",
                       s->threads);
    lg_elastica problem = s->problem;
    /* Valid end angles; lg_elastica_generate replaces the caller's end angles anyway. */
    lg_elastica_set_case(&problem, LG_ELASTICA_BOTH_ENDS, 1.0);
    return lg_elastica_check(&problem, error);
}

static double boundary_angle(const lg_elastica_sampling *s, size_t number) {
    const size_t first = (s->count + 1) / 2, half = number >= first;
    const size_t points = half ? s->count - first : first, i = number - (half ? first : 0);
    const double t = points > 1 ? (double)i / (double)(points - 1) : 0.0;
    return LG_PI * ((double)half + s->gap + t * (1.0 - 2.0 * s->gap));
}

/* A set of curves that is being generated. Each block writes its own rows. */
typedef struct job {
    const lg_context *context;
    const lg_elastica_sampling *sampling;
    lg_elastica_curves *curves;
    size_t blocks; /* number of blocks per family */
} job;

/* Memory for computing one block. */
typedef struct block_memory {
    lg_beam_work work;
    lg_collocation *collocation;
    double *theta;
} block_memory;

static void block_free(const job *j, block_memory *m) {
    lg_free(j->context, m->theta);
    lg_collocation_destroy(j->context, m->collocation);
    if (m->work.memory) lg_beam_work_destroy(&m->work);
}

static lg_status block_create(const job *j, block_memory *m) {
    lg_beam beam = lg_beam_frame_make(&j->sampling->problem).beam;
    beam.first = 2.0 * LG_PI; /* a rotation of 2 pi, the largest in both families */
    beam.last = 0.0;
    const size_t grid = j->sampling->continuous ? lg_collocation_grid(&beam) : beam.n;
    *m = (block_memory){.theta = lg_alloc(j->context, beam.n + 1, sizeof(double))};
    LG_TRY(m->theta ? LG_OK : LG_OUT_OF_MEMORY);
    LG_TRY(lg_beam_work_create(j->context, grid, &m->work));
    return j->sampling->continuous ? lg_collocation_create(j->context, &m->collocation) : LG_OK;
}

static void export_row(const job *j, const lg_elastica *problem, const lg_beam_frame *frame, block_memory *m,
                       size_t row, lg_elastica_case kind, double x) {
    const lg_elastica_curves *c = j->curves;
    const size_t n = c->intervals, width = 2 * (n + 1);
    double *q = c->q + row * width, *v = c->v + row * width, *boundary = c->boundary + 8 * row;
    if (m->collocation) {
        lg_collocation_result result;
        lg_collocation_result_get(m->collocation, &result);
        lg_collocation_export(m->collocation, problem, frame, m->theta, q);
        lg_elastica_curve(problem, m->theta, NULL, v);
        c->energy[row] = frame->energy * result.energy;
    } else {
        for (size_t k = 0; k <= n; k++) m->theta[k] = m->work.theta[k] + frame->turn;
        m->theta[0] = problem->theta0;
        m->theta[n] = problem->theta0 + problem->rotation;
        lg_elastica_curve(problem, m->theta, q, v);
        c->energy[row] = frame->energy * lg_beam_energy(&frame->beam, m->work.theta);
    }
    for (int i = 0; i < 2; i++) {
        boundary[i] = problem->q0[i];
        boundary[2 + i] = v[i];
        boundary[4 + i] = problem->qN[i];
        boundary[6 + i] = v[2 * n + (size_t)i];
    }
    c->x[row] = x;
    c->kind[row] = (uint32_t)kind;
}

/* Returns family number `place` among the families that are wanted, in the order of the enumeration. */
static lg_elastica_case family(const lg_elastica_sampling *s, size_t place) {
    return place == 1 || !s->both_ends ? LG_ELASTICA_RIGHT_END : LG_ELASTICA_BOTH_ENDS;
}

static lg_status run_block(const job *j, size_t place, size_t block, block_memory *m, lg_error *error) {
    const lg_elastica_sampling *s = j->sampling;
    const lg_elastica_case kind = family(s, place);
    lg_elastica_options options;
    lg_elastica_options_init(&options);
    lg_beam before = {0};
    for (size_t i = block * BLOCK; i < s->count && i < (block + 1) * BLOCK; i++) {
        if (lg_cancelled(j->context)) return lg_fail(error, LG_CANCELLED, "elastica: cancelled");
        lg_elastica problem = s->problem;
        lg_beam_end end = LG_BEAM_LOST;
        const double x = boundary_angle(s, i);
        lg_elastica_set_case(&problem, kind, x);
        const lg_beam_frame frame = lg_beam_frame_make(&problem);
        lg_beam beam = frame.beam;
        if (m->collocation) beam.n = m->work.room;
        const bool near =
            before.n == beam.n && before.last * beam.last > 0.0 && fabs(before.last - beam.last) <= NEAR;
        lg_status status = lg_beam_next(near ? &before : NULL, &beam, &m->work, options.max_step, &end);
        if (status == LG_OK && end == LG_BEAM_MINIMUM && m->collocation)
            status = lg_collocation_polish(m->collocation, &beam, &m->work, &end);
        if (status == LG_OK && end == LG_BEAM_MINIMUM) {
            export_row(j, &problem, &frame, m, place * s->count + i, kind, x);
            before = beam;
            continue;
        }
        lg_error reason = {LG_OK, ""};
        if (status == LG_OK) status = lg_elastica_no_minimum(end, &beam, &m->work, &reason);
        return lg_fail(error, status, "elastica: %s, x = %.6g: %s", lg_elastica_case_name(kind), x,
                       reason.message[0] ? reason.message : lg_status_sentence(status));
    }
    return LG_OK;
}

static lg_status run_task(void *user, size_t index, lg_error *error) {
    const job *j = user;
    block_memory m;
    lg_status status = block_create(j, &m);
    if (status == LG_OK)
        status = run_block(j, index / j->blocks, index % j->blocks, &m, error);
    else
        lg_fail(error, status, "elastica: %s", lg_status_sentence(status));
    block_free(j, &m);
    return status;
}

lg_status lg_elastica_generate(const lg_context *context, const lg_elastica_sampling *sampling,
                               lg_elastica_curves *out, lg_error *error) {
    LG_NEEDS(error, sampling, out);
    LG_TRY(check_sampling(sampling, error));
    const size_t families = (size_t)sampling->both_ends + sampling->right_end;
    const size_t blocks = (sampling->count - 1) / BLOCK + 1;
    LG_CLEAN(lg_elastica_curves_destroy) lg_elastica_curves curves = {.count = 0};
    job j = {.context = context, .sampling = sampling, .curves = &curves, .blocks = blocks};
    const lg_status status = sampling->count <= SIZE_MAX / 16
                                 ? lg_elastica_curves_create(context, families * sampling->count,
                                                             sampling->problem.intervals, true, &curves)
                                 : LG_OUT_OF_MEMORY;
    if (status != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "elastica: no memory for %zu curves", sampling->count);
    curves.length = sampling->problem.length;
    curves.stiffness = sampling->problem.stiffness;
    curves.continuous = sampling->continuous;
    LG_TRY(lg_jobs_run(context, (uint64_t)sampling->threads, families * blocks, run_task, &j, error));
    return LG_GIVE(out, curves);
}
