/* Bounds of the rounding of programs: a running analysis of scalar code over a box. */
#include <float.h>
#include <math.h>

#include "certify/interval.h"

/* A computed number differs from the exact one by at most g(count + terms - 1) size, where g(k) = k unit/(1 -
 * k unit). `size` bounds the sum of the |terms| of a sum and `terms` counts them, so the order of a sum does
 * not matter. */
typedef struct rounded {
    double low, high; /* of the exact number */
    double size, count, terms;
} rounded;

/* Units of the functions exp, log, sin, and so on, and of Stumpff functions; 1 of +, -, *, / */
enum { OF_FUNCTIONS = 8, OF_SERIES = 64 };
#define UP (1 + 1e-12)

static double count_of(const rounded *a) {
    return a->count + a->terms - 1;
}

static double error_of(const rounded *a, double unit) {
    const double part = count_of(a) * unit * UP;
    return part < 0.5 ? part / (1 - part) * a->size * UP : (double)INFINITY;
}

static double least_of(const rounded *a) {
    return a->low > 0 ? a->low : a->high < 0 ? -a->high : 0;
}

static double most_of(const rounded *a) {
    return fmax(fabs(a->low), fabs(a->high));
}

/* A number of this size, with an error by its operands and units of its own; not a number: no bound */
static void set(rounded *y, double unit, double size, double error, double units) {
    const double count = size > 0 && error >= 0 ? error / size / unit * UP + units : (double)INFINITY;
    y->size = size > 0 ? size * UP : 1;
    y->count = error == 0 ? units : count;
    y->terms = 1;
}

static double power_error(const lg_scalar_code *c, const rounded *a, double e) {
    const double below = (c->p == rint(c->p) ? least_of(a) : a->low) - e;
    return below > 0 ? fabs(c->p) * pow(below, c->p - 1) * e : (double)INFINITY;
}

static void instruction(const lg_scalar_code *c, const rounded *a, const rounded *b, const rounded *d,
                        double unit, rounded *y) {
    const double e = error_of(a, unit), f = error_of(b, unit), l = a->low - e, most = most_of(a),
                 none = (double)INFINITY;
    switch (c->op) {
    case LG_S_INPUT:
    case LG_S_CONSTANT:
        set(y, unit, most_of(y), 0, 1);
        return;
    case LG_S_ADD:
    case LG_S_SUB:
        y->size = a->size + b->size;
        y->count = fmax(a->count, b->count);
        y->terms = a->terms + b->terms;
        return;
    case LG_S_MUL:
        set(y, unit, a->size * b->size, 0, count_of(a) + count_of(b) + 1);
        return;
    case LG_S_DIV: {
        const double by = least_of(b), size = a->size / by;
        set(y, unit, size, by > f ? (e + size * f) / (by - f) : none, 1);
        return;
    }
    case LG_S_NEG:
    case LG_S_ABS:
        set(y, unit, a->size, 0, count_of(a));
        return;
    case LG_S_MAX:
        set(y, unit, fmax(a->size, b->size), 0, fmax(count_of(a), count_of(b)));
        return;
    case LG_S_GE: /* jumps have no bound, where rounding may decide them */
        set(y, unit, 1, a->low - e > b->high + f || b->low - f > a->high + e ? 0 : none, 0);
        return;
    case LG_S_SIGN:
        set(y, unit, 1, least_of(a) > e ? 0 : none, 0);
        return;
    case LG_S_SELECT:
        set(y, unit, fmax(b->size, d->size), e > 0 ? none : 0, fmax(count_of(b), count_of(d)));
        return;
    case LG_S_SQRT:
        set(y, unit, sqrt(fmax(a->high, 0)), l > 0 ? e / (2 * sqrt(l)) : none, 1);
        return;
    case LG_S_POW:
        if (c->p >= 1 && (c->p == rint(c->p) || l >= 0))
            set(y, unit, pow(a->size, c->p), 0, c->p * count_of(a) + OF_FUNCTIONS);
        else
            set(y, unit, most_of(y), power_error(c, a, e), OF_FUNCTIONS);
        return;
    case LG_S_EXP:
        set(y, unit, exp(a->high), exp(a->high) * expm1(e), OF_FUNCTIONS);
        return;
    case LG_S_LOG:
        set(y, unit, most_of(y), l > 0 ? e / l : none, OF_FUNCTIONS);
        return;
    case LG_S_SIN:
    case LG_S_TANH:
        set(y, unit, fmin(most, 1), e, OF_FUNCTIONS);
        return;
    case LG_S_COS:
        set(y, unit, 1, e, OF_FUNCTIONS);
        return;
    case LG_S_SIGMOID:
        set(y, unit, 1, 0.25 * e, OF_FUNCTIONS);
        return;
    case LG_S_ATAN2: /* the slopes are at most 1/b for b > 0; elsewhere there is a cut */
        set(y, unit, 1.6, b->low > f ? (e + f) / (b->low - f) : none, OF_FUNCTIONS);
        return;
    case LG_S_STUMPFF: /* the slopes are at most .6 above -1 */
        set(y, unit, 1, a->low >= 0 && e <= 1 ? e : none, OF_SERIES);
        return;
    default:
        set(y, unit, 1, none, 0);
    }
}

/* Bounds of the exact number. */
static void bound(const lg_scalar_code *c, const rounded *v, const double *low, const double *high,
                  rounded *y) {
    lg_interval_value in[3];
    if (c->op == LG_S_CONSTANT || c->op == LG_S_INPUT) {
        y->low = c->op == LG_S_INPUT ? low[c->n] : c->p;
        y->high = c->op == LG_S_INPUT ? high[c->n] : c->p;
        return;
    }
    for (uint32_t k = 0; k < lg_scalar_instructions(c->op); k++)
        in[k] = (lg_interval_value){.low = v[c->in[k]].low, .high = v[c->in[k]].high};
    in[0] = lg_interval_one(c, true, in);
    y->low = in[0].low;
    y->high = in[0].high;
}

lg_status lg_expansion_rounding(lg_expansion *x, const double *low, const double *high, double unit,
                                double *error) {
    const double small = (unit > DBL_EPSILON ? (double)FLT_MIN : DBL_MIN) / unit,
                 large = 0.25 * (unit > DBL_EPSILON ? (double)FLT_MAX : DBL_MAX);
    rounded *v = lg_heap_take(&x->heap, (size_t)x->s.count + 1, sizeof *v);
    if (v == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < x->s.count; i++) {
        const lg_scalar_code *c = &x->s.code[i];
        const uint32_t operands = lg_scalar_instructions(c->op);
        const rounded *in[3];
        for (uint32_t k = 0; k < 3; k++) in[k] = &v[k < operands ? c->in[k] : 0];
        bound(c, v, low, high, &v[i]);
        instruction(c, in[0], in[1], in[2], unit, &v[i]);
        v[i].size = fmax(v[i].size, small); /* numbers so small may be rounded to 0 */
        if (!(v[i].size < large && most_of(&v[i]) < large)) v[i].count = (double)INFINITY;
    }
    for (size_t j = 0; j < x->results; j++) error[j] = error_of(&v[x->result[j]], unit);
    return LG_OK;
}

lg_status lg_interval_rounding(const lg_program *program, size_t function, const double *low,
                               const double *high, double unit, double *out, lg_error *error) {
    LG_NEEDS(error, program, low, high, out);
    if (unit != 0x1p-53 && unit != 0x1p-24)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the unit of rounding must be 2^-53 or 2^-24");
    LG_CLEAN(lg_expansion_destroy) lg_expansion expansion;
    LG_TRY(lg_expand(program, &function, 1, &expansion, error));
    for (size_t i = 0; i < expansion.inputs; i++)
        if (!(low[i] <= high[i] && low[i] >= -DBL_MAX && high[i] <= DBL_MAX))
            return lg_fail(error, LG_INVALID_ARGUMENT, "input %zu: [%g, %g] is empty or not finite", i,
                           low[i], high[i]);
    return lg_expansion_rounding(&expansion, low, high, unit, out);
}
