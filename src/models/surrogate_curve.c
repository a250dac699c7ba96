/* Surrogates without a tape: curves in the caller's memory, and their errors against given ones. The networks
 * compute in the type of their parameters, all else in double. Everything happens on the side of the mirror
 * that the network knows; y-components are reflected when they are handed over. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "models/surrogate_internal.h"

/* Rows that go through a network at once, and the panels of the quadrature at least. */
enum { BLOCK = 128, PANELS = 50 };

/* A place at which the angle network is asked: a Gauss point with its share of the integral, over a whole
 * panel or a part of one, or a point of the curve. */
typedef enum role { WHOLE, PART, POINT } role;
typedef struct place {
    double s, share;
    role role;
} place;

/* A model with its parameters, and the caller's memory cut into pieces. */
typedef struct run {
    const lg_surrogate *model;
    lg_dtype dtype;
    const void *theta;
    size_t rows; /* room for so many */
    char *x, *tangent, *y, *dy;
    place *places;
    double *curve; /* discrete: (4, N + 1), see spread_nodes */
    char *net;
} run;

static char *cut(char *base, size_t *at, size_t count, size_t size) {
    char *here = base == NULL ? NULL : base + *at;
    *at += (count * size + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
    return here;
}

static run cut_run(const lg_surrogate *model, lg_dtype dtype, size_t rows, void *work, size_t *bytes) {
    const size_t size = dtype == LG_F64 ? sizeof(double) : sizeof(float), n = model->intervals;
    const lg_surrogate_kind kind = model->options.kind;
    const size_t tangents = kind == LG_SURROGATE_CONTINUOUS ? rows : 0;
    size_t at = 0;
    run r = {.model = model, .dtype = dtype, .rows = rows};
    r.x = cut(work, &at, rows * model->net.inputs, size);
    r.tangent = cut(work, &at, tangents * model->net.inputs, size);
    r.y = cut(work, &at, rows * model->net.outputs, size);
    r.dy = cut(work, &at, tangents * model->net.outputs, size);
    r.places = (place *)(void *)cut(work, &at, kind == LG_SURROGATE_ANGLE ? rows : 0, sizeof(place));
    r.curve =
        (double *)(void *)cut(work, &at, kind == LG_SURROGATE_DISCRETE ? 4 * (n + 1) : 0, sizeof(double));
    r.net = cut(work, &at, 0, 1);
    if (bytes != NULL) *bytes = at + lg_net_work_size(&model->net, rows, dtype);
    return r;
}

/* One row for the curve; as many as points, in blocks; and an angle network has more places than points. */
static size_t rows_for(const lg_surrogate *model, size_t points) {
    if (model->options.kind == LG_SURROGATE_DISCRETE) return 1;
    return model->options.kind == LG_SURROGATE_ANGLE || points > BLOCK ? BLOCK : points == 0 ? 1 : points;
}

size_t lg_surrogate_work_size(const lg_surrogate *model, size_t points, lg_dtype dtype) {
    size_t bytes;
    (void)cut_run(model, dtype, rows_for(model, points), NULL, &bytes);
    return bytes;
}

/* What is asked for: boundary conditions and where the points go; q and v may be NULL. */
typedef struct target {
    const double *x;
    double sign;
    double *q, *v;
} target;

static void put_row(const run *r, size_t row, const target *t, double s) {
    double numbers[9];
    const size_t n = r->model->net.inputs;
    lg_surrogate_row(r->model, t->x, t->sign, s, numbers);
    lg_surrogate_put(r->dtype, r->x, row * n, numbers, n);
}

/* Point number i of the answer, q counted from q0, reflected where the network's side is the other one. */
static void hand_over(const target *t, size_t i, const double *q, const double *v) {
    for (size_t c = 0; c < 2; c++) {
        const double sign = c == 1 ? t->sign : 1.0;
        if (t->q != NULL) t->q[2 * i + c] = t->x[LG_AT_Q0 + c] + sign * q[c];
        if (t->v != NULL) t->v[2 * i + c] = sign * v[c];
    }
}

/* ---- discrete ---- */

/* Row `row` of the output with the given ends: nodes (N + 1, 2), then tangents (N + 1, 2), on the network's
 * side of the mirror. */
static void spread_nodes(const run *r, size_t row, const target *t) {
    const size_t n = r->model->intervals, inner = 2 * (n - 1), outputs = 2 * inner;
    for (size_t part = 0; part < 2; part++) {
        double *to = r->curve + part * 2 * (n + 1);
        for (size_t i = 0; i < inner; i++)
            to[2 + i] = lg_surrogate_get(r->dtype, r->y, row * outputs + part * inner + i);
        for (size_t c = 0; c < 2; c++) {
            const double sign = c == 1 ? t->sign : 1.0;
            const double from = part == 0 ? t->x[c] : 0.0;
            to[c] = sign * (t->x[(part == 0 ? LG_AT_Q0 : LG_AT_V0) + c] - from);
            to[2 * n + c] = sign * (t->x[(part == 0 ? LG_AT_QN : LG_AT_VN) + c] - from);
        }
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
    const uint32_t n = r->model->intervals;
    const double *q = r->curve, *v = q + 2 * (n + 1), h = r->model->length / n;
    for (size_t i = 0; i < points; i++) {
        double place_in = s[i] / r->model->length * n, point[2], tangent[2];
        if (!(place_in > 0.0)) place_in = 0.0;
        if (place_in > n) place_in = n;
        const double node = floor(place_in + 0.5);
        size_t k = (size_t)node;
        if (fabs(place_in - node) <= 4.0 * DBL_EPSILON * n) {
            hand_over(t, i, q + 2 * k, v + 2 * k);
            if (k == n && t->q != NULL) memcpy(t->q + 2 * i, t->x + LG_AT_QN, 2 * sizeof *t->q);
            continue;
        }
        k = (size_t)place_in;
        lg_surrogate_hermite(q + 2 * k, v + 2 * k, h, place_in - (double)k, point, tangent);
        hand_over(t, i, point, tangent);
    }
}

static void discrete_curve(run *r, const target *t, const double *s, size_t points) {
    put_row(r, 0, t, 0.0);
    lg_net_eval(&r->model->net, r->dtype, r->theta, r->x, 1, r->y, r->net);
    spread_nodes(r, 0, t);
    read_nodes(r, t, s, points);
}

/* ---- continuous ---- */

static void continuous_curve(run *r, const target *t, const double *s, size_t points) {
    const double along[9] = {1.0 / r->model->length};
    for (size_t i = 0; i < r->rows; i++) lg_surrogate_put(r->dtype, r->tangent, 9 * i, along, 9);
    for (size_t at = 0; at < points; at += r->rows) {
        const size_t rows = points - at < r->rows ? points - at : r->rows;
        for (size_t i = 0; i < rows; i++) put_row(r, i, t, s[at + i]);
        if (t->v == NULL)
            lg_net_eval(&r->model->net, r->dtype, r->theta, r->x, rows, r->y, r->net);
        else
            lg_net_jvp(&r->model->net, r->dtype, r->theta, r->x, r->tangent, rows, r->y, r->dy, r->net);
        for (size_t i = 0; i < rows; i++) {
            double q[2], v[2] = {0.0, 0.0};
            for (size_t c = 0; c < 2; c++) {
                q[c] = lg_surrogate_get(r->dtype, r->y, 2 * i + c);
                if (t->v != NULL) v[c] = lg_surrogate_get(r->dtype, r->dy, 2 * i + c);
            }
            hand_over(t, at + i, q, v);
        }
    }
}

/* ---- angle ---- */

/* What runs along a curve: the integral so far, and what its angles lack at the ends. */
typedef struct walk {
    double whole[2], part[2]; /* over whole panels, and from there to the next point */
    double missing[2];
    size_t panels; /* whole ones so far */
    size_t filled; /* places waiting */
    size_t done;   /* points handed over */
} walk;

/* pi f at the places that wait, left in r->y. */
static void ask(run *r, const target *t, size_t count) {
    for (size_t i = 0; i < count; i++) put_row(r, i, t, r->places[i].s);
    lg_net_eval(&r->model->net, r->dtype, r->theta, r->x, count, r->y, r->net);
}

static double answer(const run *r, size_t i) {
    return LG_SURROGATE_PI * lg_surrogate_get(r->dtype, r->y, i);
}

static void find_missing(run *r, const target *t, walk *w) {
    w->missing[0] = w->missing[1] = 0.0;
    if (!r->model->options.boundary) return;
    r->places[0].s = 0.0;
    r->places[1].s = r->model->length;
    ask(r, t, 2);
    lg_surrogate_angles(t->x, t->sign, w->missing);
    for (size_t i = 0; i < 2; i++) w->missing[i] -= answer(r, i);
}

static double angle_at(const run *r, const walk *w, size_t i) {
    double weights[2];
    if (!r->model->options.boundary) return answer(r, i);
    lg_surrogate_end_weights(r->model, r->places[i].s, weights);
    return answer(r, i) + (w->missing[0] * weights[0] + w->missing[1] * weights[1]);
}

/* Takes the places that wait in their order: shares of the integral are added, points handed over. */
static void empty(run *r, const target *t, walk *w) {
    if (w->filled == 0) return;
    ask(r, t, w->filled);
    for (size_t i = 0; i < w->filled; i++) {
        const double angle = angle_at(r, w, i), v[2] = {cos(angle), sin(angle)};
        const place *p = &r->places[i];
        double q[2];
        for (size_t c = 0; c < 2; c++) {
            if (p->role == WHOLE) w->whole[c] += p->share * v[c];
            if (p->role == PART) w->part[c] += p->share * v[c];
            q[c] = w->whole[c] + w->part[c];
        }
        if (p->role != POINT) continue;
        hand_over(t, w->done++, q, v);
        w->part[0] = w->part[1] = 0.0;
    }
    w->filled = 0;
}

static void wait_for(run *r, const target *t, walk *w, place p) {
    r->places[w->filled++] = p;
    if (w->filled == r->rows) empty(r, t, w);
}

static void gauss(run *r, const target *t, walk *w, double a, double b, role as) {
    for (int g = 0; g < LG_GAUSS_POINTS; g++)
        wait_for(r, t, w, (place){a + lg_gauss_at[g] * (b - a), (b - a) * lg_gauss_weight[g], as});
}

/* Panels are the same whatever points are asked for: equal parts of the data's intervals, so that the rule at
 * their nodes is that of training, and at least PANELS. */
static size_t panels_of(const lg_surrogate *model) {
    const size_t n = model->intervals;
    return n * ((PANELS + n - 1) / n);
}

/* The integral up to s: whole panels, then the part of the next one. */
static void integrate_to(run *r, const target *t, walk *w, double s) {
    const double panels = (double)panels_of(r->model), h = r->model->length / panels;
    const double place_in = s / h;
    while ((double)w->panels + 1.0 <= place_in + 1e-9 && (double)w->panels < panels) {
        gauss(r, t, w, h * (double)w->panels, h * ((double)w->panels + 1.0), WHOLE);
        w->panels++;
    }
    if (place_in > (double)w->panels + 1e-9) gauss(r, t, w, h * (double)w->panels, s, PART);
}

static void angle_curve(run *r, const target *t, const double *s, size_t points) {
    walk w = {.filled = 0};
    find_missing(r, t, &w);
    for (size_t i = 0; i < points; i++) {
        if (t->q != NULL) integrate_to(r, t, &w, s[i]);
        wait_for(r, t, &w, (place){s[i], 0.0, POINT});
    }
    empty(r, t, &w);
}

/* A number of x makes the whole curve NaN when it is not finite, one of s its point: a branch of ReLU, or the
 * end that s is beyond, would hide it. */
static void mark_unfit(const target *t, const double *s, size_t points) {
    double mark = 0.0;
    for (size_t i = 0; i < 8; i++) mark += 0.0 * t->x[i];
    for (size_t i = 0; i < 2 * points; i++) {
        if (t->q != NULL) t->q[i] += mark + 0.0 * s[i / 2];
        if (t->v != NULL) t->v[i] += mark + 0.0 * s[i / 2];
    }
}

void lg_surrogate_curve(const lg_surrogate *model, lg_dtype dtype, const void *theta, const double *x,
                        const double *s, size_t points, double *q, double *v, void *work) {
    static void (*const curves[LG_SURROGATE_KIND_COUNT])(run *, const target *, const double *, size_t) = {
        [LG_SURROGATE_DISCRETE] = discrete_curve,
        [LG_SURROGATE_CONTINUOUS] = continuous_curve,
        [LG_SURROGATE_ANGLE] = angle_curve,
    };
    const target t = {x, lg_surrogate_sign(model, x), q, v};
    run r = cut_run(model, dtype, rows_for(model, points), work, NULL);
    r.theta = theta;
    curves[model->options.kind](&r, &t, s, points);
    mark_unfit(&t, s, points);
}

/* ---- evaluation ---- */

/* Curves of one model beside given ones. */
typedef struct judging {
    const lg_elastica_curves *curves;
    const uint32_t *chosen; /* NULL: all */
    size_t count;
    double *s, *half_way; /* nodes (N + 1), and half-way between them (N) */
    double *q, *v;        /* (N + 1, 2): the curve there */
    double *node_sums;    /* (N + 1, 2) */
    double square[2];     /* sums over curves, nodes and components, of q and of v */
    lg_surrogate_errors e;
} judging;

static size_t number_of(const judging *j, size_t i) {
    return j->chosen != NULL ? j->chosen[i] : i;
}

/* NaN once there was one. */
static double larger(double a, double b) {
    return b <= a || isnan(a) ? a : b;
}

/* Largest ||v| - 1| over points. */
static double off_unit(const double *v, size_t points) {
    double largest = 0.0;
    for (size_t k = 0; k < points; k++)
        largest = larger(largest, fabs(sqrt(v[2 * k] * v[2 * k] + v[2 * k + 1] * v[2 * k + 1]) - 1.0));
    return largest;
}

static target target_of(const judging *j, const lg_surrogate *model, size_t i) {
    const double *x = j->curves->boundary + 8 * number_of(j, i);
    return (target){x, lg_surrogate_sign(model, x), j->q, j->v};
}

static void judge_ends(judging *j, const lg_surrogate *model, const double *x) {
    const size_t last = 2 * (size_t)j->curves->intervals;
    const double *given[4] = {x + LG_AT_V0, x + LG_AT_VN, x + LG_AT_Q0, x + LG_AT_QN};
    const double *got[4] = {j->v, j->v + last, j->q, j->q + last};
    const size_t n = model->options.kind == LG_SURROGATE_ANGLE ? 2 : 4;
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 2; c++)
            j->e.boundary_error = larger(j->e.boundary_error, fabs(got[i][c] - given[i][c]));
}

/* Node k of the curve, part 0 (q) or 1 (v). */
static void judge_node(judging *j, size_t k, size_t part, const double *got, const double *given,
                       bool counts) {
    const double dx = got[0] - given[0], dy = got[1] - given[1], square = dx * dx + dy * dy;
    j->node_sums[2 * k + part] += sqrt(square);
    if (!counts) return;
    j->square[part] += square;
    j->e.max_error = larger(j->e.max_error, larger(fabs(dx), fabs(dy)));
}

/* Adds the curve that stands in j->q and j->v, number i of those chosen. */
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

/* The tangents half-way between the nodes stand in j->v. */
static void judge_between(judging *j) {
    j->e.unit_tangent_between = larger(j->e.unit_tangent_between, off_unit(j->v, j->curves->intervals));
}

/* Of the discrete network many curves at once: its parameters are read once for all of them. */
static void judge_discrete(judging *j, run *r) {
    const size_t nodes = (size_t)r->model->intervals + 1;
    for (size_t start = 0; start < j->count; start += r->rows) {
        const size_t rows = j->count - start < r->rows ? j->count - start : r->rows;
        for (size_t i = 0; i < rows; i++) {
            const target t = target_of(j, r->model, start + i);
            put_row(r, i, &t, 0.0);
        }
        lg_net_eval(&r->model->net, r->dtype, r->theta, r->x, rows, r->y, r->net);
        for (size_t i = 0; i < rows; i++) {
            const target t = target_of(j, r->model, start + i);
            spread_nodes(r, i, &t);
            read_nodes(r, &t, j->s, nodes);
            judge(j, r->model, start + i);
            read_nodes(r, &t, j->half_way, nodes - 1);
            judge_between(j);
        }
    }
}

static void judge_all(judging *j, const lg_surrogate *model, const double *theta, size_t rows, void *work) {
    const size_t nodes = (size_t)j->curves->intervals + 1;
    if (model->options.kind == LG_SURROGATE_DISCRETE) {
        run r = cut_run(model, LG_F64, rows, work, NULL);
        r.theta = theta;
        judge_discrete(j, &r);
        return;
    }
    for (size_t i = 0; i < j->count; i++) {
        const target t = target_of(j, model, i);
        lg_surrogate_curve(model, LG_F64, theta, t.x, j->s, nodes, j->q, j->v, work);
        judge(j, model, i);
        lg_surrogate_curve(model, LG_F64, theta, t.x, j->half_way, nodes - 1, NULL, j->v, work);
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
        return lg_fail(error, LG_NOT_FINITE, "the network's curves or the given ones are not finite");
    for (size_t k = 0; node_error != NULL && k < 2 * nodes; k++)
        node_error[k] = j->node_sums[k] / (double)j->count;
    *out = j->e;
    return LG_OK;
}

static lg_status check_chosen(const judging *j, lg_error *error) {
    if (j->count == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "no curves to evaluate on");
    for (size_t i = 0; j->chosen != NULL && i < j->count; i++)
        if (j->chosen[i] >= j->curves->count)
            return lg_fail(error, LG_INVALID_ARGUMENT, "curve %u is asked for; there are %zu", j->chosen[i],
                           j->curves->count);
    return LG_OK;
}

lg_status lg_surrogate_evaluate(const lg_context *context, const lg_surrogate *model, const double *theta,
                                const lg_elastica_curves *curves, const uint32_t *chosen, size_t count,
                                double *node_error, lg_surrogate_errors *out, lg_error *error) {
    judging j = {.curves = curves, .chosen = chosen, .count = chosen != NULL ? count : curves->count};
    LG_TRY(lg_surrogate_check_curves(model, curves, error));
    LG_TRY(check_chosen(&j, error));
    const size_t nodes = (size_t)curves->intervals + 1;
    const size_t rows = j.count < BLOCK ? j.count : BLOCK; /* discrete */
    size_t bytes;
    if (model->options.kind == LG_SURROGATE_DISCRETE)
        (void)cut_run(model, LG_F64, rows, NULL, &bytes);
    else
        bytes = lg_surrogate_work_size(model, nodes, LG_F64);
    void *work = lg_alloc(context, 1, bytes);
    double *numbers = lg_alloc(context, 8 * nodes, sizeof(double));
    lg_status status = LG_OUT_OF_MEMORY;
    if (work != NULL && numbers != NULL) {
        j.s = numbers;
        j.q = numbers + nodes;
        j.v = numbers + 3 * nodes;
        j.node_sums = numbers + 5 * nodes;
        j.half_way = numbers + 7 * nodes;
        for (size_t k = 0; k < nodes; k++)
            j.s[k] = k + 1 == nodes ? model->length : model->length * (double)k / (double)(nodes - 1);
        for (size_t k = 0; k + 1 < nodes; k++) j.half_way[k] = 0.5 * (j.s[k] + j.s[k + 1]);
        judge_all(&j, model, theta, rows, work);
        status = finish(&j, model, node_error, out, error);
    } else {
        (void)lg_fail(error, status, "no memory for curves of %zu nodes", nodes);
    }
    lg_free(context, numbers);
    lg_free(context, work);
    return status;
}
