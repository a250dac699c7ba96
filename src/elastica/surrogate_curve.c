/* Surrogates without a tape: plans of the model's program compute curves in the caller's memory. Also
 * computes errors against given curves. Cubics and sums around the program's functions are computed in
 * double. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "core/clean.h"
#include "core/portions.h"
#include "elastica/surrogate_internal.h"

/* What lg-export writes, too. */
typedef double real;
#define REAL(number) number
#define REAL_EPSILON DBL_EPSILON
#define FABS         fabs
#include "elastica/code/curve_nodes.c"

/* BLOCK: largest number of rows in a batch of the network. PANELS: least number of panels of the
 * quadrature. */
enum { BLOCK = 64, PANELS = 50 };

/* Program functions that curves need. MADE is what is computed once per curve: `value` of the discrete
 * network, `ends` of the angle network. */
typedef enum asked { MADE, POINT, PLACE, SPAN, ASKED } asked;

struct lg_surrogate_curves {
    const lg_context *context;
    lg_surrogate model;
    lg_dtype dtype;
    size_t rows[ASKED];
    lg_plan *plan[ASKED]; /* NULL: the kind does not need it */
    size_t plan_work;     /* work memory of the largest plan in bytes */
};

/* Number of outputs of MADE. */
static size_t made_numbers(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_DISCRETE ? lg_surrogate_outputs(model) : LG_SURROGATE_ENDS;
}

/* Number of panels of the quadrature. It does not depend on the points. Panels are equal parts of the data's
 * intervals, at least PANELS in total. So the data's nodes are ends of panels, as in training. */
static size_t panels_of(const lg_surrogate *model) {
    const size_t n = model->intervals;
    return n * ((PANELS + n - 1) / n);
}

/* ---- memory ---- */

/* The caller's work memory, cut into arrays. All numbers except `curve` and `value` have the plans' type. */
typedef struct run {
    const lg_surrogate_curves *c;
    char *x, *made;   /* of each curve of a batch: boundary conditions (8), and the outputs of MADE */
    char *s, *length; /* (BLOCK) */
    char *q, *v;      /* (BLOCK, 2); the angle network writes theta to q */
    double *curve;    /* discrete network: nodes (N + 1, 2), then tangents; angle network: see integrate() */
    double *value;    /* discrete network in single precision: its outputs for one curve */
    char *plan;
} run;

static size_t size_of(lg_dtype dtype) {
    return dtype == LG_F64 ? sizeof(double) : sizeof(float);
}

static run cut_run(const lg_surrogate_curves *c, void *work, size_t *bytes) {
    const size_t size = size_of(c->dtype), made = made_numbers(&c->model);
    lg_portions from = {work, 0};
    run r = {.c = c};
    r.x = lg_portion(&from, 8 * c->rows[MADE], size);
    r.made = lg_portion(&from, made * c->rows[MADE], size);
    r.s = lg_portion(&from, BLOCK, size);
    r.length = lg_portion(&from, BLOCK, size);
    r.q = lg_portion(&from, 2 * (size_t)BLOCK, size);
    r.v = lg_portion(&from, 2 * (size_t)BLOCK, size);
    r.curve = lg_portion(&from, made + 8 + 2 * panels_of(&c->model), sizeof(double));
    r.value = lg_portion(&from, made, sizeof(double));
    r.plan = lg_portion(&from, c->plan_work, 1);
    *bytes = from.used;
    return r;
}

size_t lg_surrogate_curves_work_size(const lg_surrogate_curves *curves) {
    size_t bytes;
    (void)cut_run(curves, NULL, &bytes);
    return bytes;
}

/* ---- plans ---- */

static lg_status make_plan(lg_surrogate_curves *c, const lg_program *program, asked which, lg_error *error) {
    const bool discrete = c->model.options.kind == LG_SURROGATE_DISCRETE;
    const char *const names[ASKED] = {discrete ? "value" : "ends", "point", "place", "span"};
    size_t function;
    if (lg_program_find(program, names[which], &function, NULL) != LG_OK) return LG_OK;
    LG_TRY(lg_program_plan(program, names[which], c->dtype, c->rows[which], &c->plan[which], error));
    const size_t work = lg_plan_work_size(c->plan[which]);
    c->plan_work = work > c->plan_work ? work : c->plan_work;
    return LG_OK;
}

/* Number of rows per batch, if `count` rows are divided into batches of equal size, at most `most`. */
static size_t rows_for(size_t count, size_t most) {
    const size_t blocks = (count + most - 1) / most;
    return count == 0 ? 1 : (count + blocks - 1) / blocks;
}

/* curves: for how many curves MADE is computed at once. */
static lg_status create(const lg_context *context, const lg_surrogate *model, const double *theta,
                        lg_dtype dtype, size_t curves, size_t points, lg_surrogate_curves **out,
                        lg_error *error) {
    const size_t at_once = rows_for(points, BLOCK),
                 spans = rows_for(panels_of(model), BLOCK / LG_GAUSS_POINTS);
    lg_program *program = NULL;
    lg_surrogate_curves *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the curves of a network");
    *made = (lg_surrogate_curves){context, *model, dtype, {curves, at_once, at_once, spans}, {NULL}, 0};
    lg_status status = lg_surrogate_program(context, model, theta, &program, error);
    for (int which = 0; which < ASKED && status == LG_OK; which++)
        status = make_plan(made, program, (asked)which, error);
    lg_program_destroy(program);
    if (status == LG_OK)
        *out = made;
    else
        lg_surrogate_curves_destroy(made);
    return status;
}

lg_status lg_surrogate_curves_create(const lg_context *context, const lg_surrogate *model,
                                     const double *theta, lg_dtype dtype, size_t points,
                                     lg_surrogate_curves **out, lg_error *error) {
    LG_NEEDS(error, model, theta, out);
    return create(context, model, theta, dtype, 1, points, out, error);
}

void lg_surrogate_curves_destroy(lg_surrogate_curves *curves) {
    if (curves == NULL) return;
    for (size_t i = 0; i < ASKED; i++) lg_plan_destroy(curves->plan[i]);
    lg_free(curves->context, curves);
}

static void put(const run *r, char *values, size_t at, double number) {
    lg_put_numbers(r->c->dtype, values, at, &number, 1);
}

static double number(const run *r, const char *values, size_t at) {
    double out;
    lg_get_numbers(r->c->dtype, values, at, &out, 1);
    return out;
}

/* A curve to be computed: its number in the batch, boundary conditions, and the arrays for its points. q and
 * v may be NULL. */
typedef struct target {
    size_t curve;
    const double *x;
    double *q, *v;
} target;

/* Computes MADE of all curves whose boundary conditions are in r->x. */
static void make(const run *r) {
    if (r->c->plan[MADE] != NULL)
        lg_plan_eval(r->c->plan[MADE], (const void *const[]){r->x}, (void *const[]){r->made}, r->plan);
}

/* Returns how many rows the next batch has when `rest` rows remain. */
static size_t batch(const run *r, asked which, size_t rest) {
    return rest < r->c->rows[which] ? rest : r->c->rows[which];
}

/* Computes r->q and r->v at the first `count` points in r->s. The batch is filled up with copies of the last
 * point. */
static void ask(const run *r, const target *t, asked which, size_t count) {
    const size_t size = size_of(r->c->dtype) * t->curve;
    const char *shared = r->c->plan[MADE] != NULL ? r->made + LG_SURROGATE_ENDS * size : r->x + 8 * size;
    for (size_t i = count; i < r->c->rows[which]; i++) {
        put(r, r->s, i, number(r, r->s, count - 1));
        put(r, r->length, i, 0.0);
    }
    lg_plan_eval(r->c->plan[which], (const void *const[]){r->s, shared, r->length},
                 (void *const[]){r->q, r->v}, r->plan);
}

/* ---- discrete network ---- */

static void discrete_curve(const run *r, const target *t, const double *s, size_t points) {
    const size_t n = made_numbers(&r->c->model);
    const int intervals = (int)r->c->model.intervals;
    const double *value = (const double *)(const void *)r->made + n * t->curve;
    double q[2], v[2];
    for (size_t i = 0; i < n && r->c->dtype == LG_F32; i++)
        r->value[i] = number(r, r->made, n * t->curve + i);
    spread_nodes(intervals, t->x, r->c->dtype == LG_F32 ? r->value : value, r->curve);
    for (size_t i = 0; i < points; i++) {
        read_curve(intervals, r->c->model.length, r->curve, s[i], q, v);
        if (t->q != NULL) memcpy(t->q + 2 * i, q, sizeof q);
        if (t->v != NULL) memcpy(t->v + 2 * i, v, sizeof v);
    }
}

/* ---- continuous and angle networks ---- */

/* Computes q and v by POINT or PLACE; of the angle network v from theta. */
static void points_of(const run *r, const target *t, asked which, const double *s, size_t points) {
    const bool angle = r->c->model.options.kind == LG_SURROGATE_ANGLE;
    for (size_t at = 0, rows; at < points; at += rows) {
        rows = batch(r, which, points - at);
        lg_put_numbers(r->c->dtype, r->s, 0, s + at, rows);
        ask(r, t, which, rows);
        for (size_t i = 0; i < 2 * rows; i++) {
            const double f = number(r, r->q, angle ? i / 2 : i);
            if (t->q != NULL && !angle) t->q[2 * at + i] = f;
            if (t->v != NULL) t->v[2 * at + i] = !angle ? number(r, r->v, i) : i % 2 == 0 ? cos(f) : sin(f);
        }
    }
}

static void continuous_curve(const run *r, const target *t, const double *s, size_t points) {
    points_of(r, t, t->v == NULL ? PLACE : POINT, s, points);
}

/* Number of whole panels before s. *part: the length from their end to s, 0 if it may be rounding. */
static size_t whole_panels(const lg_surrogate *model, double s, double *part) {
    const double panels = (double)panels_of(model), h = model->length / panels;
    const double whole = fmin(fmax(floor(s / h + 1e-9), 0.0), panels); /* NaN: 0 */
    *part = s / h > whole + 1e-9 ? s - h * whole : 0.0;
    return (size_t)whole;
}

/* Integrals of (cos theta, sin theta) from 0 to the points s (count), or, if s is NULL, to the ends of the
 * first panels: to (count, 2). r->curve (panels + 1, 2) has the integrals to ends of panels before them. */
static void integrate(const run *r, const target *t, const double *s, size_t count, double *to) {
    const lg_surrogate *model = &r->c->model;
    const double h = model->length / (double)panels_of(model);
    size_t whole[BLOCK];
    for (size_t at = 0, rows; at < count; at += rows) {
        bool between = false;
        double part = h;
        rows = batch(r, SPAN, count - at);
        for (size_t i = 0; i < rows; i++) {
            whole[i] = s == NULL ? at + i : whole_panels(model, s[at + i], &part);
            between = between || part != 0.0;
            put(r, r->s, i, h * (double)whole[i]);
            put(r, r->length, i, part);
        }
        if (between) ask(r, t, SPAN, rows);
        for (size_t i = 0; i < 2 * rows; i++)
            to[2 * at + i] = r->curve[2 * whole[i / 2] + i % 2] + (between ? number(r, r->q, i) : 0.0);
    }
}

/* Points of the curve. With `symmetric`, what is missing to qN is spread along the beam. */
static void angle_points(const run *r, const target *t, const double *s, size_t points) {
    const lg_surrogate *model = &r->c->model;
    size_t last = model->options.symmetric ? panels_of(model) : 0;
    double part, missing[2] = {0.0, 0.0};
    for (size_t i = 0; i < points; i++) {
        const size_t panels = whole_panels(model, s[i], &part);
        last = panels > last ? panels : last;
    }
    r->curve[0] = r->curve[1] = 0.0;
    integrate(r, t, NULL, last, r->curve + 2);
    integrate(r, t, s, points, t->q);
    for (size_t c = 0; c < 2 && model->options.symmetric; c++)
        missing[c] = (t->x[LG_AT_QN + c] - t->x[LG_AT_Q0 + c] - r->curve[2 * last + c]) / model->length;
    for (size_t i = 0; i < 2 * points; i++) t->q[i] += t->x[LG_AT_Q0 + i % 2] + s[i / 2] * missing[i % 2];
}

static void angle_curve(const run *r, const target *t, const double *s, size_t points) {
    if (t->q != NULL) angle_points(r, t, s, points);
    if (t->v != NULL) points_of(r, t, POINT, s, points);
}

/* ---- curves of all kinds ---- */

/* Reads the points of a curve after `make`. The whole curve becomes NaN if a number of x is not finite, and a
 * point becomes NaN if its s is not finite. Otherwise a ReLU, or the limitation of s to the ends of the beam,
 * could hide such a number. */
static void read_points(const run *r, const target *t, const double *s, size_t points) {
    static void (*const kinds[LG_SURROGATE_KIND_COUNT])(const run *, const target *, const double *,
                                                        size_t) = {
        [LG_SURROGATE_DISCRETE] = discrete_curve,
        [LG_SURROGATE_CONTINUOUS] = continuous_curve,
        [LG_SURROGATE_ANGLE] = angle_curve,
    };
    double mark = 0.0;
    kinds[r->c->model.options.kind](r, t, s, points);
    for (size_t i = 0; i < 8; i++) mark += 0.0 * t->x[i];
    for (size_t i = 0; i < 2 * points; i++) {
        if (t->q != NULL) t->q[i] += mark + 0.0 * s[i / 2];
        if (t->v != NULL) t->v[i] += mark + 0.0 * s[i / 2];
    }
}

void lg_surrogate_curve(const lg_surrogate_curves *curves, const double *x, const double *s, size_t points,
                        double *q, double *v, void *work) {
    const target t = {0, x, q, v};
    size_t bytes;
    const run r = cut_run(curves, work, &bytes);
    lg_put_numbers(curves->dtype, r.x, 0, x, 8);
    make(&r);
    read_points(&r, &t, s, points);
}

/* ---- evaluation ---- */

/* Comparison of a model's curves with given curves. */
typedef struct judging {
    const lg_elastica_curves *curves;
    const uint32_t *chosen; /* NULL: all curves */
    size_t count;
    double *s, *half_way; /* arc lengths of the nodes (N + 1), and half-way between the nodes (N) */
    double *q, *v;        /* (N + 1, 2): the model's curve at these points */
    double *node_sums;    /* (N + 1, 2): sums over the curves of |q - q_k| and |v - v_k| */
    double square[2];     /* squared errors of q and of v, summed over curves, nodes and components */
    lg_surrogate_errors e;
} judging;

static size_t number_of(const judging *j, size_t i) {
    return j->chosen != NULL ? j->chosen[i] : i;
}

/* Returns the larger number, or NaN if a or b is NaN. */
static double larger(double a, double b) {
    return b <= a || isnan(a) ? a : b;
}

/* Returns the largest ||v| - 1| over the points. */
static double off_unit(const double *v, size_t points) {
    double largest = 0.0;
    for (size_t k = 0; k < points; k++)
        largest = larger(largest, fabs(sqrt(v[2 * k] * v[2 * k] + v[2 * k + 1] * v[2 * k + 1]) - 1.0));
    return largest;
}

static const double *boundary_of(const judging *j, size_t i) {
    return j->curves->boundary + 8 * number_of(j, i);
}

static void judge_ends(judging *j, const lg_surrogate *model, const double *x) {
    const size_t last = 2 * (size_t)j->curves->intervals;
    const double *given[4] = {x + LG_AT_V0, x + LG_AT_VN, x + LG_AT_Q0, x + LG_AT_QN};
    const double *got[4] = {j->v, j->v + last, j->q, j->q + last};
    const size_t n = model->options.kind == LG_SURROGATE_ANGLE && !model->options.symmetric ? 2 : 4;
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 2; c++)
            j->e.boundary_error = larger(j->e.boundary_error, fabs(got[i][c] - given[i][c]));
}

/* Adds the error at node k. part: 0 for q, 1 for v. counts: whether the node counts in mse and max_error. */
static void judge_node(judging *j, size_t k, size_t part, const double *got, const double *given,
                       bool counts) {
    const double dx = got[0] - given[0], dy = got[1] - given[1], square = dx * dx + dy * dy;
    j->node_sums[2 * k + part] += sqrt(square);
    if (!counts) return;
    j->square[part] += square;
    j->e.max_error = larger(j->e.max_error, larger(fabs(dx), fabs(dy)));
}

/* Adds the errors of the curve in j->q and j->v, which belongs to number i of the chosen curves. */
static void judge(judging *j, const lg_surrogate *model, size_t i) {
    const size_t at = number_of(j, i), nodes = (size_t)j->curves->intervals + 1;
    const double *q = j->curves->q + 2 * nodes * at, *v = j->curves->v + 2 * nodes * at;
    for (size_t k = 0; k < nodes; k++) {
        const bool counts = model->options.kind != LG_SURROGATE_DISCRETE || (k > 0 && k + 1 < nodes);
        judge_node(j, k, 0, j->q + 2 * k, q + 2 * k, counts);
        judge_node(j, k, 1, j->v + 2 * k, v + 2 * k, counts);
    }
    j->e.unit_tangent_error = larger(j->e.unit_tangent_error, off_unit(j->v, nodes));
    judge_ends(j, model, j->curves->boundary + 8 * at);
}

/* Judges the tangents half-way between the nodes, which are in j->v. */
static void judge_between(judging *j) {
    j->e.unit_tangent_between = larger(j->e.unit_tangent_between, off_unit(j->v, j->curves->intervals));
}

/* MADE is computed for many curves at once, so that the discrete network's parameters are read from memory
 * once for all of them. */
static void judge_all(judging *j, const lg_surrogate_curves *curves, void *work) {
    const size_t nodes = (size_t)j->curves->intervals + 1;
    size_t bytes;
    const run r = cut_run(curves, work, &bytes);
    for (size_t start = 0, count; start < j->count; start += count) {
        count = batch(&r, MADE, j->count - start);
        for (size_t i = 0; i < curves->rows[MADE]; i++)
            lg_put_numbers(curves->dtype, r.x, 8 * i, boundary_of(j, start + (i < count ? i : 0)), 8);
        make(&r);
        for (size_t i = 0; i < count; i++) {
            const double *x = boundary_of(j, start + i);
            read_points(&r, &(target){i, x, j->q, j->v}, j->s, nodes);
            judge(j, &curves->model, start + i);
            read_points(&r, &(target){i, x, NULL, j->v}, j->half_way, nodes - 1);
            judge_between(j);
        }
    }
}

static lg_status finish(judging *j, const lg_surrogate *model, double *node_error, lg_surrogate_errors *out,
                        lg_error *error) {
    const size_t nodes = (size_t)j->curves->intervals + 1;
    const size_t counted = model->options.kind == LG_SURROGATE_DISCRETE ? nodes - 2 : nodes;
    const double terms = 2.0 * (double)counted * (double)j->count;
    j->e.mse_q = j->square[0] / terms;
    j->e.mse_v = j->square[1] / terms;
    j->e.mse = 0.5 * (j->e.mse_q + j->e.mse_v);
    if (!(j->e.mse <= DBL_MAX && j->e.boundary_error <= DBL_MAX && j->e.unit_tangent_error <= DBL_MAX))
        return lg_fail(error, LG_NOT_FINITE,
                       "the differences of the network's curves from the given ones are not finite");
    for (size_t k = 0; node_error != NULL && k < 2 * nodes; k++)
        node_error[k] = j->node_sums[k] / (double)j->count;
    *out = j->e;
    return LG_OK;
}

static lg_status check_chosen(const judging *j, lg_error *error) {
    if (j->count == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there are no curves to evaluate the network on");
    for (size_t i = 0; j->chosen != NULL && i < j->count; i++)
        if (j->chosen[i] >= j->curves->count)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "there is no curve %u (counted from 0): there are %zu curves", j->chosen[i],
                           j->curves->count);
    return LG_OK;
}

static void place_nodes(judging *j, const lg_surrogate *model, size_t nodes, double *numbers) {
    j->s = numbers;
    j->q = numbers + nodes;
    j->v = numbers + 3 * nodes;
    j->node_sums = numbers + 5 * nodes;
    j->half_way = numbers + 7 * nodes;
    for (size_t k = 0; k < nodes; k++)
        j->s[k] = k + 1 == nodes ? model->length : model->length * (double)k / (double)(nodes - 1);
    for (size_t k = 0; k + 1 < nodes; k++) j->half_way[k] = 0.5 * (j->s[k] + j->s[k + 1]);
}

LG_AT(lg_surrogate_curves_destroy, lg_surrogate_curves)

lg_status lg_surrogate_evaluate(const lg_context *context, const lg_surrogate *model, const double *theta,
                                const lg_elastica_curves *curves, const uint32_t *chosen, size_t count,
                                double *node_error, lg_surrogate_errors *out, lg_error *error) {
    LG_NEEDS(error, model, theta, curves, out);
    judging j = {.curves = curves, .chosen = chosen, .count = chosen != NULL ? count : curves->count};
    LG_TRY(lg_surrogate_check_curves(model, curves, error));
    LG_TRY(check_chosen(&j, error));
    const size_t nodes = (size_t)curves->intervals + 1;
    LG_CLEAN(lg_surrogate_curves_destroy_at) lg_surrogate_curves *plans = NULL;
    LG_TRY(create(context, model, theta, LG_F64, j.count < BLOCK ? j.count : BLOCK, nodes, &plans, error));
    LG_TRY_SCRATCH(char, work, context, lg_surrogate_curves_work_size(plans), lg_no_memory(error));
    LG_TRY_SCRATCH(double, numbers, context, 8 * nodes, lg_no_memory(error));
    place_nodes(&j, model, nodes, numbers);
    judge_all(&j, plans, work);
    return finish(&j, model, node_error, out, error);
}
