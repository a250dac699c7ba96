/* Surrogates without a tape: plans of the model's program compute curves in the caller's memory. Also
 * computes errors against given curves. Cubics and integrals around the network's functions are computed in
 * double. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "liegrad/program.h"
#include "elastica/surrogate_internal.h"

LG_AT(lg_program_destroy, lg_program)
LG_AT(lg_surrogate_curves_destroy, lg_surrogate_curves)

/* BLOCK: largest number of rows in a batch of the network. PANELS: least number of panels of the
 * quadrature. */
enum { BLOCK = 64, PANELS = 50 };

/* Program functions that curves need. `many`: there is also a plan for many rows at once. */
typedef enum asked { VALUE, ENDS, POINT, PLACE, ASKED } asked;
static const struct {
    const char *name;
    bool many;
} functions[ASKED] = {[VALUE] = {"value", true},
                      [ENDS] = {"ends", false},
                      [POINT] = {"point", true},
                      [PLACE] = {"place", true}};

struct lg_surrogate_curves {
    const lg_context *context;
    lg_surrogate model;
    lg_dtype dtype;
    size_t rows;                      /* rows of the plans `all`: points, or curves (discrete network) */
    lg_plan *one[ASKED], *all[ASKED]; /* NULL: not needed for this kind; `all` also if rows is 1 */
    size_t plan_work;                 /* work memory of the largest plan in bytes */
};

/* Number of outputs of the function that is evaluated once per curve: `value` of the discrete network, `ends`
 * of the angle network. */
static size_t made_numbers(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_DISCRETE ? lg_surrogate_outputs(model) : LG_SURROGATE_ENDS;
}

/* ---- memory ---- */

typedef enum role { WHOLE, PART, ASKED_FOR } role;
/* A point at which the angle network is evaluated. It is a point of the curve that was asked for (ASKED_FOR),
 * or a Gauss point, with its weight `share`, of an integral over a whole panel (WHOLE) or a part of a panel
 * (PART). */
typedef struct place {
    double share;
    role role;
} place;

/* The caller's work memory, cut into arrays. All numbers except `places` and `curve` have the plans' type. */
typedef struct run {
    const lg_surrogate_curves *c;
    /* x: boundary conditions (8); made: the outputs computed from them once per curve (made_numbers). The
     * discrete network has (rows) of each. */
    char *x, *made;
    char *s;       /* (rows) */
    char *q, *v;   /* (rows, 2); the angle network writes theta (rows) to q */
    place *places; /* (rows) */
    double *curve; /* discrete network: nodes (N + 1, 2), then tangents */
    char *plan;
} run;

static char *cut(char *base, size_t *at, size_t count, size_t size) {
    char *here = base == NULL ? NULL : base + *at;
    *at += (count * size + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
    return here;
}

static size_t size_of(lg_dtype dtype) {
    return dtype == LG_F64 ? sizeof(double) : sizeof(float);
}

static run cut_run(const lg_surrogate_curves *c, void *work, size_t *bytes) {
    const size_t size = size_of(c->dtype), nodes = (size_t)c->model.intervals + 1;
    const bool discrete = c->model.options.kind == LG_SURROGATE_DISCRETE;
    size_t at = 0;
    run r = {.c = c};
    const size_t curves = discrete ? c->rows : 1;
    r.x = cut(work, &at, 8 * curves, size);
    r.made = cut(work, &at, made_numbers(&c->model) * curves, size);
    r.s = cut(work, &at, c->rows, size);
    r.q = cut(work, &at, 2 * c->rows, size);
    r.v = cut(work, &at, 2 * c->rows, size);
    r.places = (place *)(void *)cut(work, &at, c->rows, sizeof(place));
    r.curve = (double *)(void *)cut(work, &at, discrete ? 4 * nodes : 0, sizeof(double));
    r.plan = cut(work, &at, c->plan_work, 1);
    *bytes = at;
    return r;
}

size_t lg_surrogate_curves_work_size(const lg_surrogate_curves *curves) {
    size_t bytes;
    (void)cut_run(curves, NULL, &bytes);
    return bytes;
}

/* ---- plans ---- */

static lg_status make_plan(lg_surrogate_curves *c, const lg_program *program, asked which, size_t rows,
                           lg_plan **out, lg_error *error) {
    lg_plan_options options;
    size_t function;
    const bool unused = which == VALUE && c->model.options.kind != LG_SURROGATE_DISCRETE;
    if (unused || lg_program_find(program, functions[which].name, &function, NULL) != LG_OK) return LG_OK;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = c->dtype;
    LG_TRY(lg_plan_create(program, function, &options, out, error));
    if (lg_plan_work_size(*out) > c->plan_work) c->plan_work = lg_plan_work_size(*out);
    return LG_OK;
}

static lg_status make_plans(lg_surrogate_curves *c, const double *theta, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    LG_TRY(lg_surrogate_program(c->context, &c->model, theta, &program, error));
    for (int which = 0; which < ASKED; which++) {
        LG_TRY(make_plan(c, program, (asked)which, 1, &c->one[which], error));
        if (functions[which].many && c->rows > 1)
            LG_TRY(make_plan(c, program, (asked)which, c->rows, &c->all[which], error));
    }
    return LG_OK;
}

static lg_status create(const lg_context *context, const lg_surrogate *model, const double *theta,
                        lg_dtype dtype, size_t rows, lg_surrogate_curves **out, lg_error *error) {
    LG_CLEAN(lg_surrogate_curves_destroy_at)
    lg_surrogate_curves *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the curves of a network");
    *made = (lg_surrogate_curves){.context = context, .model = *model, .dtype = dtype, .rows = rows};
    LG_TRY(make_plans(made, theta, error));
    return LG_MOVE(out, made);
}

/* Number of panels of the quadrature. It does not depend on the points. Panels are equal parts of the data's
 * intervals, at least PANELS in total. So the data's nodes are ends of panels, as in training. */
static size_t panels_of(const lg_surrogate *model) {
    const size_t n = model->intervals;
    return n * ((PANELS + n - 1) / n);
}

/* Number of rows per batch. The evaluations for a curve of `points` points are divided into batches of equal
 * size, at most BLOCK. */
static size_t rows_for(const lg_surrogate *model, size_t points) {
    const bool angle = model->options.kind == LG_SURROGATE_ANGLE;
    const size_t places = points + (angle ? LG_GAUSS_POINTS * panels_of(model) : 0);
    const size_t blocks = (places + BLOCK - 1) / BLOCK;
    if (model->options.kind == LG_SURROGATE_DISCRETE || places == 0) return 1;
    return (places + blocks - 1) / blocks;
}

lg_status lg_surrogate_curves_create(const lg_context *context, const lg_surrogate *model,
                                     const double *theta, lg_dtype dtype, size_t points,
                                     lg_surrogate_curves **out, lg_error *error) {
    LG_NEEDS(error, model, theta, out);
    return create(context, model, theta, dtype, rows_for(model, points), out, error);
}

void lg_surrogate_curves_destroy(lg_surrogate_curves *curves) {
    if (curves == NULL) return;
    for (size_t i = 0; i < ASKED; i++) {
        lg_plan_destroy(curves->one[i]);
        lg_plan_destroy(curves->all[i]);
    }
    lg_free(curves->context, curves);
}

/* Computes r->made from the boundary conditions in r->x. */
static void make_of_ends(const run *r, asked which) {
    const lg_plan *plan = r->c->all[which] != NULL ? r->c->all[which] : r->c->one[which];
    lg_plan_eval(plan, (const void *const[]){r->x}, (void *const[]){r->made}, r->plan);
}

/* Computes r->q and r->v at the first `count` points in r->s; `shared` is the input that all points of the
 * curve share. If count is less than a quarter of the plan's rows, the points are evaluated one by one;
 * otherwise in one batch, which is filled up with copies of the last point. */
static void ask(const run *r, asked which, const char *shared, size_t count) {
    const size_t rows = r->c->rows, size = size_of(r->c->dtype);
    const size_t width = size * (r->c->model.options.kind == LG_SURROGATE_CONTINUOUS ? 2 : 1);
    if (r->c->all[which] != NULL && 4 * count >= rows) {
        for (size_t i = count; i < rows; i++) memcpy(r->s + i * size, r->s + (count - 1) * size, size);
        lg_plan_eval(r->c->all[which], (const void *const[]){r->s, shared}, (void *const[]){r->q, r->v},
                     r->plan);
        return;
    }
    for (size_t i = 0; i < count; i++)
        lg_plan_eval(r->c->one[which], (const void *const[]){r->s + i * size, shared},
                     (void *const[]){r->q + i * width, r->v + i * width}, r->plan);
}

static double number(const run *r, const char *values, size_t at) {
    return lg_surrogate_get(r->c->dtype, values, at);
}

/* A curve to be computed: its boundary conditions, and the arrays for its points. q and v may be NULL. */
typedef struct target {
    const double *x;
    double *q, *v;
} target;

static void hand_over(const target *t, size_t i, const double *q, const double *v) {
    if (t->q != NULL) memcpy(t->q + 2 * i, q, 2 * sizeof *q);
    if (t->v != NULL) memcpy(t->v + 2 * i, v, 2 * sizeof *v);
}

/* ---- discrete network ---- */

/* Fills r->curve with the network's numbers values[first ...] (4(N - 1)) between the ends given by x. */
static void spread_nodes(const run *r, const char *values, size_t first, const double *x) {
    const size_t n = r->c->model.intervals, inner = 2 * (n - 1);
    for (size_t part = 0; part < 2; part++) {
        double *to = r->curve + part * 2 * (n + 1);
        memcpy(to, x + (part == 0 ? LG_AT_Q0 : LG_AT_V0), 2 * sizeof *to);
        memcpy(to + 2 * n, x + (part == 0 ? LG_AT_QN : LG_AT_VN), 2 * sizeof *to);
        for (size_t i = 0; i < inner; i++) to[2 + i] = number(r, values, first + part * inner + i);
    }
}

void lg_surrogate_hermite(const double *q, const double *v, double h, double t, double *point,
                          double *tangent) {
    for (size_t c = 0; c < 2; c++) {
        const double chord = q[2 + c] - q[c], a = h * v[c] - chord, b = chord - h * v[2 + c];
        const double u = 1.0 - t;
        point[c] = u * q[c] + t * q[2 + c] + t * u * (a * u + b * t);
        tangent[c] = (chord + (1.0 - 2.0 * t) * (a * u + b * t) + t * u * (b - a)) / h;
    }
}

static void read_nodes(const run *r, const target *t, const double *s, size_t points) {
    const uint32_t n = r->c->model.intervals;
    const double *q = r->curve, *v = q + 2 * (n + 1), h = r->c->model.length / n;
    for (size_t i = 0; i < points; i++) {
        double place_in = s[i] / r->c->model.length * n, point[2], tangent[2];
        if (!(place_in > 0.0)) place_in = 0.0;
        if (place_in > n) place_in = n;
        const double node = floor(place_in + 0.5);
        size_t k = (size_t)node;
        if (fabs(place_in - node) <= 4.0 * DBL_EPSILON * n) {
            hand_over(t, i, q + 2 * k, v + 2 * k);
            continue;
        }
        k = (size_t)place_in;
        lg_surrogate_hermite(q + 2 * k, v + 2 * k, h, place_in - (double)k, point, tangent);
        hand_over(t, i, point, tangent);
    }
}

static void discrete_curve(const run *r, const target *t, const double *s, size_t points) {
    make_of_ends(r, VALUE);
    spread_nodes(r, r->made, 0, t->x);
    read_nodes(r, t, s, points);
}

/* ---- continuous network ---- */

static void continuous_curve(const run *r, const target *t, const double *s, size_t points) {
    const size_t most = r->c->rows;
    for (size_t at = 0; at < points; at += most) {
        const size_t rows = points - at < most ? points - at : most;
        lg_surrogate_put(r->c->dtype, r->s, 0, s + at, rows);
        ask(r, t->v == NULL ? PLACE : POINT, r->x, rows);
        for (size_t i = 0; i < 2 * rows; i++) {
            if (t->q != NULL) t->q[2 * at + i] = number(r, r->q, i);
            if (t->v != NULL) t->v[2 * at + i] = number(r, r->v, i);
        }
    }
}

/* ---- angle network ---- */

/* State of the integration along a curve. */
typedef struct walk {
    double whole[2], part[2]; /* integral over the whole panels, and from their end to the next point */
    size_t panels;            /* number of whole panels so far */
    size_t filled;            /* number of places that wait for evaluation */
    size_t done;              /* number of points written */
} walk;

/* Evaluates the waiting places and processes them in their order: Gauss points add to the integral, asked
 * points are written. */
static void empty(const run *r, const target *t, walk *w) {
    if (w->filled == 0) return;
    ask(r, POINT, r->made, w->filled);
    for (size_t i = 0; i < w->filled; i++) {
        const double angle = number(r, r->q, i), v[2] = {cos(angle), sin(angle)};
        const place *p = &r->places[i];
        double q[2];
        for (size_t c = 0; c < 2; c++) {
            if (p->role == WHOLE) w->whole[c] += p->share * v[c];
            if (p->role == PART) w->part[c] += p->share * v[c];
            q[c] = t->x[LG_AT_Q0 + c] + (w->whole[c] + w->part[c]);
        }
        if (p->role != ASKED_FOR) continue;
        hand_over(t, w->done++, q, v);
        w->part[0] = w->part[1] = 0.0;
    }
    w->filled = 0;
}

static void wait_for(const run *r, const target *t, walk *w, double s, double share, role as) {
    lg_surrogate_put(r->c->dtype, r->s, w->filled, &s, 1);
    r->places[w->filled++] = (place){share, as};
    if (w->filled == r->c->rows) empty(r, t, w);
}

static void gauss(const run *r, const target *t, walk *w, double a, double b, role as) {
    for (int g = 0; g < LG_GAUSS_POINTS; g++)
        wait_for(r, t, w, a + lg_gauss_at[g] * (b - a), (b - a) * lg_gauss_weight[g], as);
}

/* Queues the Gauss points of the integral up to s: whole panels, then the part of the next panel. */
static void integrate_to(const run *r, const target *t, walk *w, double s) {
    const double panels = (double)panels_of(&r->c->model), h = r->c->model.length / panels;
    const double place_in = s / h;
    while ((double)w->panels + 1.0 <= place_in + 1e-9 && (double)w->panels < panels) {
        gauss(r, t, w, h * (double)w->panels, h * ((double)w->panels + 1.0), WHOLE);
        w->panels++;
    }
    if (place_in > (double)w->panels + 1e-9) gauss(r, t, w, h * (double)w->panels, s, PART);
}

/* For `symmetric`: distributes the distance that is missing to qN linearly along the beam. */
static void close_curve(const run *r, const target *t, walk *w, const double *s, size_t points) {
    const double length = r->c->model.length;
    integrate_to(r, t, w, length);
    empty(r, t, w);
    for (size_t i = 0; i < 2 * points; i++) {
        const size_t c = i % 2;
        t->q[i] += s[i / 2] / length * (t->x[LG_AT_QN + c] - t->x[LG_AT_Q0 + c] - w->whole[c]);
    }
}

static void angle_curve(const run *r, const target *t, const double *s, size_t points) {
    walk w = {.filled = 0};
    make_of_ends(r, ENDS);
    for (size_t i = 0; i < points; i++) {
        if (t->q != NULL) integrate_to(r, t, &w, s[i]);
        wait_for(r, t, &w, s[i], 0.0, ASKED_FOR);
    }
    empty(r, t, &w);
    if (r->c->model.options.symmetric && t->q != NULL) close_curve(r, t, &w, s, points);
}

/* ---- curves of all kinds ---- */

/* Makes the whole curve NaN if a number of x is not finite, and a point NaN if its s is not finite. Otherwise
 * a ReLU, or the limitation of s to the ends of the beam, could hide such a number. */
static void mark_unfit(const target *t, const double *s, size_t points) {
    double mark = 0.0;
    for (size_t i = 0; i < 8; i++) mark += 0.0 * t->x[i];
    for (size_t i = 0; i < 2 * points; i++) {
        if (t->q != NULL) t->q[i] += mark + 0.0 * s[i / 2];
        if (t->v != NULL) t->v[i] += mark + 0.0 * s[i / 2];
    }
}

void lg_surrogate_curve(const lg_surrogate_curves *curves, const double *x, const double *s, size_t points,
                        double *q, double *v, void *work) {
    static void (*const kinds[LG_SURROGATE_KIND_COUNT])(const run *, const target *, const double *,
                                                        size_t) = {
        [LG_SURROGATE_DISCRETE] = discrete_curve,
        [LG_SURROGATE_CONTINUOUS] = continuous_curve,
        [LG_SURROGATE_ANGLE] = angle_curve,
    };
    const target t = {x, q, v};
    size_t bytes;
    const run r = cut_run(curves, work, &bytes);
    lg_surrogate_put(curves->dtype, r.x, 0, x, 8);
    kinds[curves->model.options.kind](&r, &t, s, points);
    mark_unfit(&t, s, points);
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

/* Evaluates the discrete network for many curves at once, so that its parameters are read from memory once
 * for all of them. */
static void judge_discrete(judging *j, const run *r) {
    const size_t nodes = (size_t)r->c->model.intervals + 1, outputs = made_numbers(&r->c->model);
    const target t = {NULL, j->q, j->v};
    for (size_t start = 0; start < j->count; start += r->c->rows) {
        const size_t rows = j->count - start < r->c->rows ? j->count - start : r->c->rows;
        for (size_t i = 0; i < r->c->rows; i++)
            lg_surrogate_put(r->c->dtype, r->x, 8 * i, boundary_of(j, start + (i < rows ? i : 0)), 8);
        make_of_ends(r, VALUE);
        for (size_t i = 0; i < rows; i++) {
            spread_nodes(r, r->made, i * outputs, boundary_of(j, start + i));
            read_nodes(r, &t, j->s, nodes);
            judge(j, &r->c->model, start + i);
            read_nodes(r, &t, j->half_way, nodes - 1);
            judge_between(j);
        }
    }
}

static void judge_all(judging *j, const lg_surrogate_curves *curves, void *work) {
    const size_t nodes = (size_t)j->curves->intervals + 1;
    size_t bytes;
    const run r = cut_run(curves, work, &bytes);
    if (curves->model.options.kind == LG_SURROGATE_DISCRETE) {
        judge_discrete(j, &r);
        return;
    }
    for (size_t i = 0; i < j->count; i++) {
        lg_surrogate_curve(curves, boundary_of(j, i), j->s, nodes, j->q, j->v, work);
        judge(j, &curves->model, i);
        lg_surrogate_curve(curves, boundary_of(j, i), j->half_way, nodes - 1, NULL, j->v, work);
        judge_between(j);
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

lg_status lg_surrogate_evaluate(const lg_context *context, const lg_surrogate *model, const double *theta,
                                const lg_elastica_curves *curves, const uint32_t *chosen, size_t count,
                                double *node_error, lg_surrogate_errors *out, lg_error *error) {
    LG_NEEDS(error, model, theta, curves, out);
    judging j = {.curves = curves, .chosen = chosen, .count = chosen != NULL ? count : curves->count};
    LG_TRY(lg_surrogate_check_curves(model, curves, error));
    LG_TRY(check_chosen(&j, error));
    const size_t nodes = (size_t)curves->intervals + 1;
    const bool discrete = model->options.kind == LG_SURROGATE_DISCRETE;
    const size_t rows = discrete ? (j.count < BLOCK ? j.count : BLOCK) : rows_for(model, nodes);
    lg_surrogate_curves *plans = NULL;
    LG_TRY(create(context, model, theta, LG_F64, rows, &plans, error));
    void *work = lg_alloc(context, 1, lg_surrogate_curves_work_size(plans));
    double *numbers = lg_alloc(context, 8 * nodes, sizeof(double));
    lg_status status = LG_OUT_OF_MEMORY;
    if (work != NULL && numbers != NULL) {
        place_nodes(&j, model, nodes, numbers);
        judge_all(&j, plans, work);
        status = finish(&j, model, node_error, out, error);
    } else {
        (void)lg_fail(error, status, "no memory for curves of %zu nodes", nodes);
    }
    LG_FREE_ALL(context, numbers, work);
    lg_surrogate_curves_destroy(plans);
    return status;
}
