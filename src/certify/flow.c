/* Bounds of flows over boxes (flow.h). */
#include "certify/flow.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "core/portions.h"
#include "kernels/matrix.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

/* Orders of the remainders of F and of S */
enum {
    ORDER = LG_FLOW_ORDER,
    LOW = ORDER - 1,
    STEEP = 3,
    FLAT = STEEP - 1,
    TRIES = 14,
    FINER = 3,
    PARTS = 4 /* of a period, at least */
};

/* Evaluators, and the number of numbers of each of their inputs */
enum { START, START_CHORDS, TUBE, VALUES, CHORDS, REST, REST_SLOPES, RATE_SLOPES, ADVANCE, EVALUATORS };

LG_AT(lg_flow_destroy, lg_flow)

struct lg_flow {
    const lg_context *context;
    size_t n, m;
    uint32_t steps;
    lg_flow_spec spec; /* its pointers serve while functions are recorded */
    lg_program *program;
    lg_interval *f[EVALUATORS];
    double error[32]; /* of u */
    bool odd;
};

/* ---- recordings ---- */

static lg_var shifted(const lg_flow *w, lg_tape *tape, lg_var z) {
    bool moved = false;
    for (size_t i = 0; i < w->n; i++) moved = moved || w->spec.goal[i] != 0.0;
    return moved ? lg_add(tape, z, lg_input_f64(tape, lg_shape1((uint32_t)w->n), w->spec.goal)) : z;
}

/* y -> z, u */
static lg_status start(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_flow *w = user;
    const uint32_t n = (uint32_t)w->n;
    out[0] = lg_matmul_nt(tape, in[0], lg_input_f64(tape, lg_shape2(n, n), w->spec.T));
    const lg_var x = shifted(w, tape, out[0]);
    return lg_program_record(tape, w->spec.program, w->spec.control, NULL, &x, &out[1]);
}

/* z, u -> z' */
static lg_status field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_flow *w = user;
    const lg_var x[2] = {shifted(w, tape, in[0]), in[1]};
    return lg_program_record(tape, w->spec.program, w->spec.rate, NULL, x, out);
}

/* Picard's map of a tube: z_0, u, Z, [0, h] -> z_0 + [0, h] f(Z, u) */
static lg_status tube(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var f = lg_program_call(tape, "field", 0, (const lg_var[]){in[2], in[1]});
    out[0] = lg_add(tape, in[0], lg_mul(tape, in[3], f));
    return lg_tape_status(tape);
}

/* (B, i, k) (B, k, j) -> (B, i, j) */
static lg_var product(lg_tape *tape, lg_var a, lg_var b) {
    const lg_shape l = lg_var_shape(tape, a), r = lg_var_shape(tape, b);
    const lg_var left = lg_reshape(tape, a, lg_shape4(l.dims[0], l.dims[1], l.dims[2], 1)),
                 right = lg_reshape(tape, b, lg_shape4(r.dims[0], 1, r.dims[1], r.dims[2]));
    return lg_sum_axis(tape, lg_mul(tape, left, right), 2, false);
}

/* c_0 + t (c_1 + ... t c_count-1) */
static lg_var horner(lg_tape *tape, const lg_var *c, int count, lg_var t) {
    lg_var sum = c[count - 1];
    for (int k = count - 2; k >= 0; k--) sum = lg_add(tape, c[k], lg_mul(tape, t, sum));
    return sum;
}

enum { IN_Z, IN_C, IN_R, IN_A, IN_DR, IN_FX, IN_W, IN_S, IN_K, IN_DEVIATION, IN_T, IN_H, INPUTS };

/* One step. Inputs: the state z at its start from m; the coefficients x_1 to x_{p-1} there, and x_p over the
 * tube of m; their Jacobians over the box (p - 1, n, n + m) and over its tube (n, n + m); the rate's Jacobian
 * over the tube; bounds of |J - 1| (n, n + m); S at the start, the Jacobian of u by y; k; t; [0, h]. Outputs:
 * D, Q, F, S, and F + S k. */
static lg_status advance(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_flow *w = user;
    const uint32_t n = (uint32_t)w->n, m = (uint32_t)w->m, rows = lg_var_shape(tape, in[IN_Z]).dims[0];
    const lg_var t3 = lg_reshape(tape, in[IN_T], lg_shape3(rows, 1, 1)),
                 h3 = lg_reshape(tape, in[IN_H], lg_shape3(rows, 1, 1));
    lg_var c[ORDER], by_x[STEEP], by_u[STEEP], one = LG_NONE;
    double unit[16 * 16] = {0};
    for (size_t i = 0; i < w->n; i++) unit[i * (w->n + 1)] = 1;
    one = lg_input_f64(tape, lg_shape2(n, n), unit);
#define SPLIT(from, x, u) const lg_var x = lg_slice(tape, from, 2, 0, n), u = lg_slice(tape, from, 2, n, m)
    SPLIT(in[IN_W], wx, wu);
    SPLIT(in[IN_FX], fx, fu);
    SPLIT(in[IN_DR], rx, ru);
#undef SPLIT
    /* J by x and by u: Picard's map once more */
    const lg_var jx = lg_add(tape, lg_mul(tape, h3, product(tape, fx, lg_add(tape, wx, one))), one),
                 ju = lg_mul(tape, h3, lg_add(tape, product(tape, fx, wu), fu));
    for (uint32_t k = 0; k < LOW; k++) c[k] = lg_slice(tape, in[IN_C], 1, k * n, n);
    for (uint32_t k = 0; k < FLAT; k++) {
        const lg_var J = lg_slice(tape, in[IN_A], 1, k * n, n);
        by_x[k] = lg_slice(tape, J, 2, 0, n);
        by_u[k] = lg_slice(tape, J, 2, n, m);
    }
    c[LOW] = in[IN_R];
    by_x[FLAT] = product(tape, rx, jx);
    by_u[FLAT] = lg_add(tape, product(tape, rx, ju), ru);
    const lg_var qx = horner(tape, by_x, STEEP, t3),
                 qu = product(tape, horner(tape, by_u, STEEP, t3), in[IN_K]);
    out[0] = horner(tape, c, ORDER, in[IN_T]);
    out[1] = lg_add(tape, product(tape, qx, in[IN_S]), qu);
    out[2] = lg_add(tape, in[IN_Z], lg_mul(tape, in[IN_T], out[0]));
    out[3] =
        lg_add(tape, product(tape, lg_add(tape, lg_mul(tape, t3, qx), one), in[IN_S]), lg_mul(tape, t3, qu));
    const lg_var k3 = lg_reshape(tape, in[IN_DEVIATION], lg_shape3(rows, n, 1));
    out[4] = lg_add(tape, out[2], lg_reshape(tape, product(tape, out[3], k3), lg_shape2(rows, n)));
    return lg_tape_status(tape);
}

static lg_status record(lg_flow *w, lg_error *error) {
    const uint32_t n = (uint32_t)w->n, m = (uint32_t)w->m, all = n + m;
    const lg_shape state = lg_shape1(n), input = lg_shape1(m), one = lg_shape1(1), wide = lg_shape2(n, all);
    const lg_port y = {.name = "y", .shape = state}, z = {.name = "z", .shape = state},
                  u = {.name = "u", .shape = input}, Z = {.name = "Z", .shape = state},
                  h = {.name = "h", .shape = one};
    const lg_port at[2] = {z, u}, from[4] = {z, u, Z, h},
                  many[INPUTS] = {[IN_Z] = z,
                                  [IN_C] = {.name = "c", .shape = lg_shape1(LOW * n)},
                                  [IN_R] = {.name = "r", .shape = state},
                                  [IN_A] = {.name = "a", .shape = lg_shape2(FLAT * n, all)},
                                  [IN_DR] = {.name = "dr", .shape = wide},
                                  [IN_FX] = {.name = "fx", .shape = wide},
                                  [IN_W] = {.name = "w", .shape = wide},
                                  [IN_S] = {.name = "s", .shape = lg_shape2(n, n)},
                                  [IN_K] = {.name = "gain", .shape = lg_shape2(m, n)},
                                  [IN_DEVIATION] = {.name = "k", .shape = state},
                                  [IN_T] = {.name = "t", .shape = one},
                                  [IN_H] = h};
    const lg_port out[5] = {{.name = "D"}, {.name = "Q"}, {.name = "F"}, {.name = "S"}, {.name = "X"}};
    const lg_function_spec functions[] = {{"start", &y, 1, at, 2, start, w},
                                          {"field", at, 2, out, 1, field, w},
                                          {"tube", from, 4, out, 1, tube, w},
                                          {"advance", many, INPUTS, out, 5, advance, w}};
    return lg_program_of(w->context, functions, LG_COUNT(functions), &w->program, error);
}

static lg_status evaluators(lg_flow *w, lg_error *error) {
    static const struct {
        uint32_t place;
        size_t function; /* of the program */
    } plain[] = {{START, 0}, {TUBE, 2}, {ADVANCE, 3}};
    static const struct {
        uint32_t place, first, last;
        bool slopes, chords;
        size_t function;
    } taylor[] = {{START_CHORDS, 0, 0, true, true, 0},
                  {VALUES, 1, LOW, false, false, 1},
                  {CHORDS, 1, FLAT, true, true, 1},
                  {REST, ORDER, ORDER, false, false, 1},
                  {REST_SLOPES, STEEP, STEEP, true, false, 1},
                  {RATE_SLOPES, 1, 1, true, false, 1}};
    static const size_t rate = 1;
    LG_CLEAN(lg_interval_destroy_at) lg_interval *f = NULL;
    for (size_t i = 0; i < LG_COUNT(plain); i++)
        LG_TRY(lg_interval_create(w->program, &plain[i].function, 1, NULL, &w->f[plain[i].place], error));
    for (size_t i = 0; i < LG_COUNT(taylor); i++) {
        lg_interval_taylor_spec spec;
        lg_interval_taylor_spec_init(&spec);
        spec.function = taylor[i].function;
        spec.first = taylor[i].first;
        spec.last = taylor[i].last;
        spec.slopes = taylor[i].slopes;
        spec.chords = taylor[i].chords;
        LG_TRY(lg_interval_taylor(w->program, &spec, NULL, &w->f[taylor[i].place], error));
    }
    LG_TRY(lg_interval_create(w->program, &rate, 1, NULL, &f, error));
    w->odd = true;
    for (size_t i = 0; i < w->n; i++) w->odd = w->odd && lg_interval_parity(f, i) == -1;
    for (size_t i = 0; i < w->n + w->m; i++) w->odd = w->odd && lg_interval_parity(w->f[START], i) == -1;
    return LG_OK;
}

/* ---- work memory ---- */

typedef struct desk {
    const lg_flow *w;
    const lg_flow_boxes *b;
    lg_bounds z, u, zm, um, Z, Zm, c, r, skip, A, dr, fx, W, S, K, k, t, h, D, Q, next;
    void *evaluation;
    uint8_t *flags; /* of the outputs of an evaluator */
    uint8_t least[LG_FLOW_BOXES];
} desk;

static desk desk_of(const lg_flow *w, void *base, size_t *used) {
    const size_t n = w->n, m = w->m, all = n * (n + m);
    size_t bytes = 0, outputs = 0; /* of the largest evaluators */
    for (size_t i = 0; i < EVALUATORS; i++) {
        const size_t own = lg_interval_work_size(w->f[i]), results = lg_interval_outputs(w->f[i]);
        bytes = own > bytes ? own : bytes;
        outputs = results > outputs ? results : outputs;
    }
    lg_portions from = {base, 0};
    desk d = {.w = w, .evaluation = lg_portion(&from, bytes, 1)};
    const struct {
        lg_bounds *to;
        size_t width;
    } all_of[] = {{&d.z, n},    {&d.u, m},       {&d.zm, n},  {&d.um, m},          {&d.Z, n},
                  {&d.Zm, n},   {&d.c, LOW * n}, {&d.r, n},   {&d.skip, FLAT * n}, {&d.A, FLAT * all},
                  {&d.dr, all}, {&d.fx, all},    {&d.W, all}, {&d.S, n * n},       {&d.K, m * n},
                  {&d.k, n},    {&d.t, 1},       {&d.h, 1},   {&d.D, n},           {&d.Q, n * n},
                  {&d.next, n}};
    for (size_t i = 0; i < LG_COUNT(all_of); i++)
        *all_of[i].to = lg_bounds_take(&from, LG_FLOW_BOXES, all_of[i].width);
    d.flags = lg_portion(&from, LG_FLOW_BOXES * outputs, 1);
    *used = from.used;
    return d;
}

size_t lg_flow_work_size(const lg_flow *w) {
    size_t used;
    (void)desk_of(w, NULL, &used);
    return used;
}

/* ---- evaluation ---- */

static void limit(const desk *d, size_t i, uint8_t flag) {
    if (flag < d->b->flag[i]) d->b->flag[i] = flag;
}

/* Evaluates f of the columns of `in`, one after the other, into the columns of `out`. A box on which a result
 * may be undefined has no bounds from then on. The input as a function of the state must be Lipschitz
 * continuous; so must the rate on tubes (find_tube). A coefficient over which a kink is not decided is either
 * a hull or undefined (interval_taylor.c). */
static void evaluate(desk *d, int which, const lg_bounds *const *in, size_t ins, const lg_bounds *const *out,
                     size_t outs) {
    const lg_interval *f = d->w->f[which];
    const size_t results = lg_interval_outputs(f);
    lg_interval_bound(f, d->b->count, in, ins, out, outs, d->flags, d->b->unbounded, d->evaluation);
    for (size_t i = 0; i < d->b->count; i++) {
        d->least[i] = LG_INTERVAL_DIFFERENTIABLE;
        for (size_t j = i * results; j < (i + 1) * results; j++)
            if (d->flags[j] < d->least[i]) d->least[i] = d->flags[j];
        if (d->least[i] >= (which == START ? LG_INTERVAL_LIPSCHITZ : LG_INTERVAL_DEFINED) || which == TUBE ||
            d->b->unbounded[i])
            continue;
        limit(d, i, d->least[i]);
        d->b->unbounded[i] = true;
    }
}

#define EVALUATE(d, which, in, out) evaluate(d, which, in, LG_COUNT(in), out, LG_COUNT(out))

static void set(const lg_bounds *b, size_t boxes, double low, double high) {
    for (size_t i = 0; i < boxes * b->width; i++) {
        b->low[i] = low;
        b->high[i] = high;
    }
}

static void copy(const lg_bounds *to, const lg_bounds *from, size_t boxes) {
    memcpy(to->low, from->low, boxes * to->width * sizeof(double));
    memcpy(to->high, from->high, boxes * to->width * sizeof(double));
}

/* Z holds the motions from z during [0, h] as soon as Picard's map of Z lies in Z. Until then Z is what the
 * map gave, made larger by a part of the way that it moved; further maps make it smaller. */
static void find_tube(desk *d, const lg_bounds *z, const lg_bounds *u, const lg_bounds *Z) {
    const size_t n = d->w->n;
    const lg_bounds *const in[4] = {z, u, Z, &d->h};
    const lg_bounds *const out[1] = {&d->next};
    uint8_t flag[LG_FLOW_BOXES];
    bool found[LG_FLOW_BOXES] = {false}, before[LG_FLOW_BOXES], all = false;
    memcpy(before, d->b->unbounded, d->b->count * sizeof *before);
    copy(Z, z, d->b->count);
    for (int k = 0, finer = 0; k < TRIES + (int)n && finer < FINER; k++, finer += all) {
        const double more = k < 2 ? 0 : 0.15 * ldexp(1, k < 8 ? k - 2 : 6);
        EVALUATE(d, TUBE, in, out);
        all = true;
        for (size_t i = 0; i < d->b->count; i++) {
            bool inside = true;
            for (size_t j = i * n; j < (i + 1) * n; j++)
                inside = inside && d->next.low[j] >= Z->low[j] && d->next.high[j] <= Z->high[j];
            if (inside && !found[i]) flag[i] = d->least[i];
            found[i] = found[i] || inside;
            all = all && (found[i] || d->b->unbounded[i]);
            for (size_t j = i * n; j < (i + 1) * n; j++) {
                const double l = d->next.low[j], h = d->next.high[j];
                const double by = found[i] ? 0
                                           : more * (fmax(z->low[j] - l, 0) + fmax(h - z->high[j], 0)) +
                                                 4 * DBL_EPSILON * fmax(fabs(l), fabs(h));
                Z->low[j] = l - by;
                Z->high[j] = h + by;
            }
        }
    }
    for (size_t i = 0; i < d->b->count; i++) {
        if (found[i] && !before[i]) limit(d, i, flag[i]);
        if (!before[i] && (!found[i] || flag[i] < LG_INTERVAL_LIPSCHITZ || d->b->unbounded[i]))
            d->b->no_tube[i] = d->b->unbounded[i] = true;
    }
}

/* W with B + B W <= W, where B is h times bounds of the rate's |Jacobian| over the tube: then the
 * Jacobians of motions differ from 1 by W at most. A candidate is a sum of powers of B; sums are rounded up
 * by 1e-12. */
static void find_widths(const desk *d, double h) {
    enum { TERMS = 40, MOST = 32 };
    const size_t n = d->w->n, all = n + d->w->m;
    for (size_t i = 0; i < d->b->count; i++) {
        double B[MOST * MOST], power[MOST * MOST], next[MOST], *W = d->W.high + i * n * all;
        bool holds = true;
        for (size_t j = 0; j < n * all; j++) {
            const double l = d->fx.low[i * n * all + j], u = d->fx.high[i * n * all + j], size = fmax(-l, u);
            B[j] = size == 0 ? 0 : fmax(h * size * (1 + 1e-12), DBL_MIN);
            power[j] = B[j];
            W[j] = B[j] * (1 + 1e-9); /* there may be no further power of a state that is a plain integral */
            holds = holds && B[j] < 1e290;
        }
        const bool finite = holds;
        for (int k = 2; k < TERMS && finite; k++) {
            for (size_t c = 0; c < all; c++) {
                for (size_t r = 0; r < n; r++) {
                    next[r] = 0;
                    for (size_t l = 0; l < n; l++) next[r] += B[r * all + l] * power[l * all + c];
                }
                for (size_t r = 0; r < n; r++) {
                    power[r * all + c] = next[r];
                    W[r * all + c] += next[r] * (1 + 0.01 * k);
                }
            }
            if (k != 4 && k != 8 && k != 16 && k != TERMS - 1) continue;
            holds = true;
            for (size_t r = 0; r < n; r++)
                for (size_t c = 0; c < all && holds; c++) {
                    double sum = B[r * all + c];
                    for (size_t l = 0; l < n; l++) {
                        const double b = B[r * all + l], x = W[l * all + c];
                        sum += b * x + (b > 0 && x > 0 ? DBL_MIN : 0);
                    }
                    holds = sum * (1 + 1e-12) <= W[r * all + c] && W[r * all + c] < DBL_MAX;
                }
            if (holds) break;
        }
        if (!holds && !d->b->unbounded[i]) d->b->no_tube[i] = d->b->unbounded[i] = true;
        for (size_t j = 0; j < n * all; j++) d->W.low[i * n * all + j] = -(W[j] = holds ? W[j] : 0);
    }
}

static void report_parts(desk *d, const lg_bounds *const *in, double h) {
    const lg_flow_boxes *b = d->b;
    const lg_bounds *const out[2] = {&d->D, &d->Q};
    const uint32_t steps = d->w->steps << b->doublings, parts = steps < PARTS ? PARTS / steps : 1;
    for (uint32_t p = 0; p < parts; p++) {
        set(&d->t, b->count, p * h / parts, (p + 1) * h / parts);
        evaluate(d, ADVANCE, in, INPUTS, out, 2);
        b->part(b->user, b->count, &d->zm, &d->S, &d->D, &d->Q, p * h / parts, (p + 1) * h / parts);
    }
}

static void step(desk *d, double h) {
    const lg_flow_boxes *b = d->b;
    set(&d->h, b->count, 0, h);
    find_tube(d, &d->zm, &d->um, &d->Zm);
    find_tube(d, &d->z, &d->u, &d->Z);
    if (b->tube.low != NULL) copy(&b->tube, &d->Z, b->count);
    EVALUATE(d, CHORDS, ((const lg_bounds *[]){&d->z, &d->u, &d->zm, &d->um}),
             ((const lg_bounds *[]){&d->skip, &d->A}));
    EVALUATE(d, VALUES, ((const lg_bounds *[]){&d->zm, &d->um}), ((const lg_bounds *[]){&d->c}));
    EVALUATE(d, REST, ((const lg_bounds *[]){&d->Zm, &d->um}), ((const lg_bounds *[]){&d->r}));
    EVALUATE(d, REST_SLOPES, ((const lg_bounds *[]){&d->Z, &d->u}), ((const lg_bounds *[]){&d->dr}));
    EVALUATE(d, RATE_SLOPES, ((const lg_bounds *[]){&d->Z, &d->u}), ((const lg_bounds *[]){&d->fx}));
    find_widths(d, h);
    const lg_bounds *const in[INPUTS] = {&d->zm, &d->c, &d->r, &d->A, &d->dr, &d->fx,
                                         &d->W,  &d->S, &d->K, &d->k, &d->t,  &d->h};
    if (b->part != NULL) report_parts(d, in, h);
    const lg_bounds *const out[5] = {&d->D, &d->Q, &b->F, &b->S, &d->z};
    set(&d->t, b->count, h, h);
    EVALUATE(d, ADVANCE, in, out);
    if (b->part != NULL) b->part(b->user, b->count, &d->zm, &d->S, &d->D, &d->Q, h, h);
    for (size_t i = 0; i < b->count * d->w->n; i++) { /* the end is in the tube, too */
        d->z.low[i] = fmax(d->z.low[i], d->Z.low[i]);
        d->z.high[i] = fmin(d->z.high[i], d->Z.high[i]);
        if (d->z.low[i] > d->z.high[i]) d->z.low[i] = d->z.high[i] = 0; /* of a box without bounds */
    }
    copy(&d->zm, &b->F, b->count);
    copy(&d->S, &b->S, b->count);
}

static void add_error(const lg_flow *w, const lg_bounds *u, size_t boxes) {
    for (size_t i = 0; i < boxes * w->m; i++) {
        const double by = w->error[i % w->m];
        if (by == 0) continue;
        u->low[i] = nextafter(u->low[i] - by, -(double)INFINITY);
        u->high[i] = nextafter(u->high[i] + by, (double)INFINITY);
    }
}

void lg_flow_eval(const lg_flow *w, const lg_flow_boxes *b, void *work) {
    size_t used;
    desk d = desk_of(w, work, &used);
    d.b = b;
    const size_t n = w->n;
    const lg_bounds at = {(double *)b->at, (double *)b->at, n},
                    box = {(double *)b->low, (double *)b->high, n};
    const uint32_t steps = w->steps << b->doublings;
    memset(b->unbounded, 0, b->count * sizeof *b->unbounded);
    memset(b->no_tube, 0, b->count * sizeof *b->no_tube);
    memset(b->flag, LG_INTERVAL_DIFFERENTIABLE, b->count);
    EVALUATE(&d, START, ((const lg_bounds *[]){&box}), ((const lg_bounds *[]){&d.z, &d.u}));
    EVALUATE(&d, START_CHORDS, ((const lg_bounds *[]){&box, &at}),
             ((const lg_bounds *[]){&d.zm, &d.um, &d.S, &d.K}));
    add_error(w, &d.u, b->count);
    add_error(w, &d.um, b->count);
    for (size_t i = 0; i < b->count * n; i++) {
        const double l = b->low[i] - b->at[i], h = b->high[i] - b->at[i];
        d.k.low[i] = l == 0 ? 0 : nextafter(l, -DBL_MAX);
        d.k.high[i] = h == 0 ? 0 : nextafter(h, DBL_MAX);
    }
    for (uint32_t k = 0; k < steps; k++) step(&d, w->spec.period / steps);
    copy(&b->X, &d.z, b->count);
    const lg_bounds *const all[3] = {&b->F, &b->S, &b->X};
    for (size_t i = 0; i < b->count; i++) {
        for (size_t p = 0; p < 3; p++)
            for (size_t j = i * all[p]->width; j < (i + 1) * all[p]->width; j++)
                if (!(all[p]->low[j] >= -DBL_MAX && all[p]->high[j] <= DBL_MAX)) b->unbounded[i] = true;
        if (!b->unbounded[i]) continue;
        for (size_t p = 0; p < 3; p++) {
            memset(all[p]->low + i * all[p]->width, 0, all[p]->width * sizeof(double));
            memset(all[p]->high + i * all[p]->width, 0, all[p]->width * sizeof(double));
        }
    }
}

/* ---- creation ---- */

/* Two steps where the period times the fastest mode is above .05, and so on. Their number is a power of two,
 * so that the steps add up to the period without rounding. */
static lg_status choose_steps(lg_flow *w) {
    static const double longest = 0.05;
    enum { MOST_STEPS = 64, STATES = 16 };
    const size_t n = w->n, all = n + w->m;
    size_t used;
    LG_TRY_SCRATCH(char, work, w->context, lg_flow_work_size(w), LG_OUT_OF_MEMORY);
    desk d = desk_of(w, work, &used);
    bool unbounded = false;
    uint8_t flag = LG_INTERVAL_DIFFERENTIABLE;
    d.b = &(lg_flow_boxes){.count = 1, .unbounded = &unbounded, .flag = &flag};
    double A[STATES * STATES];
    set(&d.k, 1, 0, 0);
    EVALUATE(&d, START, ((const lg_bounds *[]){&d.k}), ((const lg_bounds *[]){&d.z, &d.u}));
    EVALUATE(&d, RATE_SLOPES, ((const lg_bounds *[]){&d.z, &d.u}), ((const lg_bounds *[]){&d.fx}));
    for (size_t i = 0; i < n * n; i++) {
        const size_t from = i / n * all + i % n;
        A[i] = 0.5 * d.fx.low[from] + 0.5 * d.fx.high[from];
    }
    const double fast = lg_matrix_radius(n, A) * w->spec.period;
    for (w->steps = 1; fast / w->steps > longest && w->steps < MOST_STEPS;) w->steps *= 2;
    return LG_OK;
}

static lg_status begin(lg_flow *w, const lg_flow_spec *spec, lg_error *error) {
    size_t inputs[2], outputs;
    const lg_port *in = lg_program_inputs(spec->program, spec->rate, &inputs[0]),
                  *x = lg_program_inputs(spec->program, spec->control, &inputs[1]),
                  *to = lg_program_outputs(spec->program, spec->rate, &outputs),
                  *u = lg_program_outputs(spec->program, spec->control, &outputs);
    w->n = lg_shape_count(x[0].shape);
    w->m = inputs[0] == 2 ? lg_shape_count(in[1].shape) : 0;
    if (inputs[1] != 1 || w->m == 0 || w->n + w->m > 32 || lg_shape_count(in[0].shape) != w->n ||
        lg_shape_count(to[0].shape) != w->n || lg_shape_count(u[0].shape) != w->m)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the rate needs the inputs x (n) and u (m) and the output x' (n), the control the input "
            "x (n) and the output u (m), with n + m at most 32");
    w->spec = *spec;
    LG_TRY(record(w, error));
    LG_TRY(evaluators(w, error));
    return choose_steps(w);
}

lg_status lg_flow_create(const lg_context *context, const lg_flow_spec *spec, lg_flow **out,
                         lg_error *error) {
    LG_CLEAN(lg_flow_destroy_at) lg_flow *w = lg_alloc(context, 1, sizeof *w);
    if (w == NULL) return LG_OUT_OF_MEMORY;
    w->context = context;
    LG_TRY(begin(w, spec, error));
    return LG_MOVE(out, w);
}

void lg_flow_destroy(lg_flow *w) {
    if (w == NULL) return;
    for (size_t i = 0; i < EVALUATORS; i++) lg_interval_destroy(w->f[i]);
    lg_program_destroy(w->program);
    lg_free(w->context, w);
}

uint32_t lg_flow_steps(const lg_flow *w) {
    return w->steps;
}

void lg_flow_set_steps(lg_flow *w, uint32_t steps) {
    w->steps = steps;
}

bool lg_flow_is_odd(const lg_flow *w) {
    return w->odd;
}

void lg_flow_set_error(lg_flow *w, const double *error) {
    for (size_t i = 0; i < w->m; i++) w->error[i] = error == NULL ? 0 : error[i];
}
