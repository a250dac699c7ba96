/* Random closed loops. A loop is lists of expressions, which are recorded for a proof, and evaluated here in
 * long double: what attacks a proof shares no code with it. */
#ifndef LG_LOOP_TEST_SUPPORT_H
#define LG_LOOP_TEST_SUPPORT_H

#include "certify_support.h"

enum { LOOP_STATES = 4, LOOP_INPUTS = 2, LOOP_CODE = 256, LOOP_TERMS = 24, LOOP_GUARDS = 32 };

/* ---- expressions ---- */

typedef enum loop_op {
    L_STATE, /* a state's deviation from the goal, by its size */
    L_INPUT, /* an input, by its size */
    L_NUMBER,
    L_ADD,
    L_SUB,
    L_MUL,
    L_DIV,
    L_MAX,
    L_ATAN2,
    L_GE,
    L_SELECT,
    L_SCALE,
    L_SHIFT,
    L_POW,
    L_SQUARE,
    L_SQRT,
    L_LOG,
    L_EXP,
    L_SIN,
    L_COS,
    L_TANH,
    L_SIGMOID,
    L_RELU,
    L_ABS,
    L_SIGN
} loop_op;

typedef struct expression {
    loop_op op;
    uint32_t in[3];
    double p;
} expression;

/* Output i is scale_i times a sum of expressions. */
typedef struct expressions {
    expression at[LOOP_CODE];
    uint32_t length, outputs, terms[LOOP_STATES][LOOP_TERMS], count[LOOP_STATES];
    double scale[LOOP_STATES];
} expressions;

typedef enum loop_mode { LOOP_CONTINUOUS, LOOP_HELD, LOOP_STEP, LOOP_MODES } loop_mode;

/* A number a_0 + sum_j a_j X_j at whose zero the loop has a kink, a jump, a cut or an end */
typedef struct loop_guard {
    double a[1 + LOOP_STATES], strip; /* strip: what is drawn about it has this width */
} loop_guard;

typedef struct loop {
    int kind;
    loop_mode mode;
    size_t n, m;
    expressions control, rate;
    double size[LOOP_STATES], goal[LOOP_STATES], force, tau, period;
    double P[LOOP_STATES * LOOP_STATES], low[LOOP_STATES], high[LOOP_STATES];
    double level, most, eps, error[LOOP_STATES];
    bool errors;
    uint32_t diagonal[LOOP_STATES]; /* expressions of the rate: the diagonal of its linear part */
    loop_guard guard[LOOP_GUARDS];
    size_t guards;
    double radius; /* of the linear part's map of a period (steps: of a step) */
} loop;

/* NaN where a function is not defined */
static inline long double loop_defined(bool defined, long double x) {
    return defined ? x : (long double)NAN;
}

static inline long double loop_value(const loop *l, const expression *e, const long double *v,
                                     const long double *z, const long double *u) {
    if (e->op == L_STATE) return z[e->in[0]] * (long double)(1 / l->size[e->in[0]]);
    if (e->op == L_INPUT) return u[e->in[0]] * (long double)(1 / l->force);
    const long double a = v[e->in[0]], b = v[e->in[1]], p = e->p;
    switch (e->op) {
    case L_NUMBER:
        return p;
    case L_ADD:
        return a + b;
    case L_SUB:
        return a - b;
    case L_MUL:
        return a * b;
    case L_DIV:
        return loop_defined(b != 0, a / b);
    case L_MAX:
        return a >= b ? a : b > a ? b : (long double)NAN;
    case L_ATAN2:
        return loop_defined(a != 0 || b != 0, atan2l(a + 0.0L, b));
    case L_GE:
        return a >= b;
    case L_SELECT:
        return a != 0 ? b : v[e->in[2]];
    case L_SCALE:
        return a * p;
    case L_SHIFT:
        return a + p;
    case L_POW:
        return loop_defined(a > 0 || (a < 0 && p == floorl(p)) || (a == 0 && p > 0), powl(a, p));
    case L_SQUARE:
        return a * a;
    case L_SQRT:
        return loop_defined(a >= 0, sqrtl(a));
    case L_LOG:
        return loop_defined(a > 0, logl(a));
    case L_EXP:
        return expl(a);
    case L_SIN:
        return sinl(a);
    case L_COS:
        return cosl(a);
    case L_TANH:
        return tanhl(a);
    case L_SIGMOID:
        return 1 / (1 + expl(-a));
    case L_RELU:
        return a >= 0 ? a : a < 0 ? 0 : (long double)NAN;
    case L_ABS:
        return fabsl(a);
    case L_SIGN:
        return a >= 0 ? 1 : a < 0 ? -1 : (long double)NAN;
    default:
        return NAN;
    }
}

/* sizes (NULL: none): sums of |terms|. Returns whether all outputs are defined. */
static inline bool loop_evaluate(const loop *l, const expressions *e, const long double *z,
                                 const long double *u, long double *out, long double *sizes) {
    long double v[LOOP_CODE];
    bool defined = true;
    for (uint32_t k = 0; k < e->length; k++) v[k] = loop_value(l, &e->at[k], v, z, u);
    for (uint32_t i = 0; i < e->outputs; i++) {
        long double sum = 0, size = 0;
        for (uint32_t k = 0; k < e->count[i]; k++) {
            sum += v[e->terms[i][k]];
            size += fabsl(v[e->terms[i][k]]);
        }
        out[i] = sum * e->scale[i];
        if (sizes != NULL) sizes[i] = size * fabsl((long double)e->scale[i]);
        defined = defined && isfinite(sum);
    }
    return defined;
}

/* ---- recording ---- */

static inline lg_var loop_node(const loop *l, lg_tape *tape, const expression *e, const lg_var *v, lg_var x,
                               lg_var u) {
    const lg_var a = v[e->in[0]], b = v[e->in[1]];
    switch (e->op) {
    case L_STATE: {
        const lg_var z = column(tape, x, e->in[0]);
        const double goal = l->goal[e->in[0]];
        return lg_scale(tape, goal == 0 ? z : lg_add_scalar(tape, z, -goal), 1 / l->size[e->in[0]]);
    }
    case L_INPUT:
        return lg_scale(tape, column(tape, u, e->in[0]), 1 / l->force);
    case L_NUMBER: /* of the shape of a column */
        return lg_add_scalar(tape, lg_scale(tape, column(tape, x, 0), 0), e->p);
    case L_ADD:
        return lg_add(tape, a, b);
    case L_SUB:
        return lg_sub(tape, a, b);
    case L_MUL:
        return lg_mul(tape, a, b);
    case L_DIV:
        return lg_div(tape, a, b);
    case L_MAX:
        return lg_max(tape, a, b);
    case L_ATAN2:
        return lg_atan2(tape, a, b);
    case L_GE:
        return lg_ge(tape, a, b);
    case L_SELECT:
        return lg_select(tape, a, b, v[e->in[2]]);
    case L_SCALE:
        return lg_scale(tape, a, e->p);
    case L_SHIFT:
        return lg_add_scalar(tape, a, e->p);
    case L_POW:
        return lg_pow(tape, a, e->p);
    case L_SQUARE:
        return lg_square(tape, a);
    case L_SQRT:
        return lg_sqrt(tape, a);
    case L_LOG:
        return lg_log(tape, a);
    case L_EXP:
        return lg_exp(tape, a);
    case L_SIN:
        return lg_sin(tape, a);
    case L_COS:
        return lg_cos(tape, a);
    case L_TANH:
        return lg_act(tape, a, LG_TANH);
    case L_SIGMOID:
        return lg_act(tape, a, LG_SIGMOID);
    case L_RELU:
        return lg_act(tape, a, LG_RELU);
    case L_ABS:
        return lg_abs(tape, a);
    case L_SIGN:
        return lg_sign(tape, a);
    }
    return LG_NONE;
}

static inline lg_var loop_recorded(const loop *l, lg_tape *tape, const expressions *e, lg_var x, lg_var u) {
    lg_var v[LOOP_CODE], out[LOOP_STATES];
    v[0] = LG_NONE;
    for (uint32_t k = 0; k < e->length; k++) v[k] = loop_node(l, tape, &e->at[k], v, x, u);
    for (uint32_t i = 0; i < e->outputs; i++) {
        lg_var sum = v[e->terms[i][0]];
        for (uint32_t k = 1; k < e->count[i]; k++) sum = lg_add(tape, sum, v[e->terms[i][k]]);
        out[i] = lg_scale(tape, sum, e->scale[i]);
        if (e == &l->rate && l->mode == LOOP_STEP && l->goal[i] != 0)
            out[i] = lg_add_scalar(tape, out[i], l->goal[i]);
    }
    return lg_concat(tape, out, e->outputs, 1);
}

static inline lg_status loop_control(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                     lg_var *y) {
    const loop *l = user;
    (void)theta;
    y[0] = loop_recorded(l, tape, &l->control, x[0], LG_NONE);
    return lg_tape_status(tape);
}

static inline lg_status loop_rate(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                  lg_var *y) {
    const loop *l = user;
    (void)theta;
    y[0] = loop_recorded(l, tape, &l->rate, x[0],
                         l->mode == LOOP_HELD ? x[1] : loop_recorded(l, tape, &l->control, x[0], LG_NONE));
    return lg_tape_status(tape);
}

/* The functions `rate` and `control`; owned by the running test */
static inline lg_program *loop_recording(loop *l) {
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1((uint32_t)l->n)},
                           {.name = "u", .shape = lg_shape1((uint32_t)l->m)}},
                  out = {.name = "y"};
    const lg_function_spec functions[2] = {{"rate", in, l->mode == LOOP_HELD ? 2 : 1, &out, 1, loop_rate, l},
                                           {"control", in, 1, &out, 1, loop_control, l}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, 2);
    return test_program(&spec);
}

static inline lg_certify_spec loop_spec(loop *l) {
    lg_certify_spec spec;
    lg_certify_spec_init(&spec);
    spec.program = loop_recording(l);
    spec.rate = "rate";
    spec.control = l->mode == LOOP_HELD ? "control" : NULL;
    spec.period = l->mode == LOOP_HELD ? l->period : 0;
    spec.step = l->mode == LOOP_STEP;
    spec.P = l->P;
    spec.goal = l->goal;
    spec.low = l->low;
    spec.high = l->high;
    spec.level = l->level;
    spec.most = l->most;
    spec.eps = l->eps;
    spec.model_error = l->errors ? l->error : NULL;
    spec.resolution = 1.0 / 128;
    return spec;
}

/* ---- building ---- */

static inline uint32_t loop_put(expressions *e, loop_op op, uint32_t a, uint32_t b, double p) {
    assert_true(e->length < LOOP_CODE);
    e->at[e->length] = (expression){op, {a, b, 0}, p};
    return e->length++;
}

#define PUT(op, a, b)        loop_put(e, op, a, b, 0)
#define PUT_NUMBER(op, a, p) loop_put(e, op, a, 0, p)

static inline uint32_t loop_select(expressions *e, uint32_t condition, uint32_t yes, uint32_t no) {
    const uint32_t s = PUT(L_SELECT, condition, yes);
    e->at[s].in[2] = no;
    return s;
}

static inline void loop_term(expressions *e, size_t i, uint32_t term) {
    assert_true(e->count[i] < LOOP_TERMS);
    e->terms[i][e->count[i]++] = term;
}

/* States are the first expressions of a list; in the rate, inputs follow. */
static inline void loop_begin(const loop *l, expressions *e, size_t inputs, size_t outputs) {
    *e = (expressions){.outputs = (uint32_t)outputs};
    for (uint32_t i = 0; i < l->n; i++) (void)loop_put(e, L_STATE, i, 0, 0);
    for (uint32_t i = 0; i < inputs; i++) (void)loop_put(e, L_INPUT, i, 0, 0);
    for (size_t i = 0; i < outputs; i++) e->scale[i] = 1;
}

static inline uint32_t loop_linear(const loop *l, expressions *e, const double *a) {
    uint32_t sum = UINT32_MAX;
    for (uint32_t j = 0; j < l->n; j++) {
        if (a[j] == 0) continue;
        const uint32_t term = PUT_NUMBER(L_SCALE, j, a[j]);
        sum = sum == UINT32_MAX ? term : PUT(L_ADD, sum, term);
    }
    return sum == UINT32_MAX ? PUT_NUMBER(L_SCALE, 0, 0) : sum;
}

static inline double loop_log(lg_rng *r, double low, double high) {
    return exp(lg_rng_uniform_in(r, log(low), log(high)));
}

static inline double loop_sign(lg_rng *r) {
    return lg_rng_below(r, 2) == 0 ? -1 : 1;
}

static inline bool loop_chance(lg_rng *r, double share) {
    return lg_rng_uniform(r) < share;
}

static inline void loop_direction(const loop *l, lg_rng *r, double *a) {
    double size = 0;
    const size_t only = lg_rng_below(r, l->n);
    const bool axis = loop_chance(r, 0.3);
    for (size_t j = 0; j < l->n; j++) {
        a[j] = axis ? (double)(j == only) : lg_rng_normal(r);
        size += a[j] * a[j];
    }
    for (size_t j = 0; j < l->n; j++) a[j] *= loop_sign(r) / sqrt(size);
}

static inline uint32_t loop_drawn_linear(const loop *l, expressions *e, lg_rng *r) {
    double a[LOOP_STATES];
    loop_direction(l, r, a);
    return loop_linear(l, e, a);
}

/* a_0 + a.X with |a| = 1 */
static inline uint32_t loop_drawn_guard(loop *l, expressions *e, lg_rng *r, double a0, double strip) {
    loop_guard *g = &l->guard[l->guards < LOOP_GUARDS ? l->guards++ : LOOP_GUARDS - 1];
    loop_direction(l, r, g->a + 1);
    g->a[0] = a0;
    g->strip = strip;
    const uint32_t sum = loop_linear(l, e, g->a + 1);
    return a0 == 0 ? sum : PUT_NUMBER(L_SHIFT, sum, a0);
}

static inline double loop_offset(lg_rng *r) {
    return loop_chance(r, 0.1) ? 0 : loop_log(r, 0.02, 2);
}

/* ---- what makes a loop hard: one term each, mostly 0 at the goal ---- */

typedef uint32_t loop_spice(loop *l, expressions *e, lg_rng *r);

static inline uint32_t loop_smooth(loop *l, expressions *e, lg_rng *r) {
    const uint32_t a = loop_drawn_linear(l, e, r), b = loop_drawn_linear(l, e, r);
    switch (lg_rng_below(r, 7)) {
    case 6: { /* a step of some width */
        const double width = loop_log(r, 1e-4, 0.3);
        const uint32_t g = loop_drawn_guard(l, e, r, loop_offset(r), width);
        return PUT(L_MUL, a, PUT(L_TANH, PUT_NUMBER(L_SCALE, g, 1 / width), 0));
    }
    case 0:
        return PUT(L_SIN, PUT_NUMBER(L_SCALE, a, loop_log(r, 0.5, 3)), 0);
    case 1:
        return PUT(L_DIV, PUT(L_MUL, a, b), PUT_NUMBER(L_SHIFT, PUT(L_SQUARE, a, 0), 1));
    case 2:
        return PUT(L_MUL, a, PUT(L_SQUARE, b, 0));
    case 3:
        return PUT(L_MUL, a, PUT(L_EXP, b, 0));
    case 4:
        return PUT(L_MUL, a, PUT(L_SIGMOID, PUT_NUMBER(L_SCALE, b, loop_log(r, 0.5, 5)), 0));
    default:
        return PUT(L_TANH, PUT_NUMBER(L_SCALE, PUT(L_SUB, a, PUT(L_MUL, a, b)), loop_log(r, 0.5, 4)), 0);
    }
}

/* The angle of (sin a, cos a): a, wrapped to (-pi, pi] */
static inline uint32_t loop_wrapped(loop *l, expressions *e, lg_rng *r) {
    static const double pi = 3.14159265358979323846;
    const double turn = loop_log(r, 0.7, 20);
    const uint32_t a = loop_drawn_guard(l, e, r, pi / turn, 0), by = PUT_NUMBER(L_SHIFT, a, -pi / turn),
                   angle = PUT_NUMBER(L_SCALE, by, turn);
    if (l->guards < LOOP_GUARDS) {
        loop_guard *other = &l->guard[l->guards++];
        *other = other[-1];
        other->a[0] = -pi / turn;
    }
    return PUT_NUMBER(L_SCALE, PUT(L_ATAN2, PUT(L_SIN, angle, 0), PUT(L_COS, angle, 0)), 1 / turn);
}

static inline uint32_t loop_cut(loop *l, expressions *e, lg_rng *r) {
    const double strip = loop_log(r, 1e-9, 0.3);
    const uint32_t a = loop_drawn_linear(l, e, r);
    switch (lg_rng_below(r, 6)) {
    case 0: { /* the cut begins at a distance from the goal */
        const uint32_t g = loop_drawn_guard(l, e, r, 0, 0), h = loop_drawn_guard(l, e, r, loop_offset(r), 0);
        return PUT(L_ATAN2, g, h);
    }
    case 1:
        return loop_wrapped(l, e, r);
    case 2: { /* a plane that is a cut, with a slope of 0 on both sides */
        const uint32_t g = loop_drawn_guard(l, e, r, loop_offset(r), 0);
        return PUT(L_MUL, a, PUT(L_ATAN2, g, g));
    }
    case 3: { /* on the cut, on one of its sides */
        const uint32_t g = loop_drawn_guard(l, e, r, loop_offset(r), 0);
        return PUT(L_MUL, a, PUT(L_ATAN2, g, PUT_NUMBER(L_NUMBER, 0, -1)));
    }
    case 4: { /* two cuts that make a strip */
        const uint32_t g = loop_drawn_guard(l, e, r, loop_offset(r), strip),
                       one = PUT_NUMBER(L_NUMBER, 0, -1),
                       h = PUT_NUMBER(L_SHIFT, PUT_NUMBER(L_SCALE, g, -1), strip);
        return PUT(L_MUL, a, PUT(L_ADD, PUT(L_ATAN2, g, one), PUT(L_ATAN2, h, one)));
    }
    default: {
        const uint32_t g = loop_drawn_guard(l, e, r, loop_offset(r), 0),
                       h = loop_drawn_guard(l, e, r, loop_offset(r), 0);
        return PUT(L_MUL, a, PUT(L_ATAN2, g, h));
    }
    }
}

static inline uint32_t loop_hole(loop *l, expressions *e, lg_rng *r) {
    static const double powers[] = {0.5, 1.5, -0.5, -1, -2, 0.3, 2.5, 3, -1.5};
    const double offset = loop_chance(r, 0.1) ? -loop_offset(r) : loop_offset(r),
                 small = loop_log(r, 1e-6, 0.3);
    const uint32_t a = loop_drawn_linear(l, e, r), g = loop_drawn_guard(l, e, r, offset, small);
    uint32_t f = 0;
    switch (lg_rng_below(r, 11)) {
    case 0:
        f = PUT(L_SQRT, g, 0);
        break;
    case 1:
        f = PUT(L_LOG, g, 0);
        break;
    case 2:
        f = PUT_NUMBER(L_POW, g, powers[lg_rng_below(r, LG_COUNT(powers))]);
        break;
    case 3:
        return PUT(L_DIV, PUT_NUMBER(L_SCALE, a, small), g);
    case 4:
        f = PUT(L_TANH, PUT(L_DIV, PUT_NUMBER(L_NUMBER, 0, small), g), 0);
        break;
    case 5:
        f = PUT(L_SIN, PUT(L_SQRT, g, 0), 0);
        break;
    case 6:
        f = PUT(L_TANH, PUT(L_LOG, g, 0), 0);
        break;
    case 7: { /* sat(log g) */
        const uint32_t one = PUT_NUMBER(L_NUMBER, 0, -1);
        f = PUT(L_MAX, PUT_NUMBER(L_SCALE, PUT(L_MAX, PUT(L_LOG, g, 0), one), -1), one);
        break;
    }
    case 8: /* a pole between two small hills */
        f = PUT(L_SIGMOID, PUT_NUMBER(L_POW, PUT_NUMBER(L_SCALE, g, 1 / small), -1), 0);
        break;
    case 9:
        return PUT(L_TANH, PUT(L_DIV, a, g), 0);
    default: /* a function whose argument is 0 times one that is not defined */
        f = PUT(L_COS, PUT_NUMBER(L_SCALE, PUT(L_SQRT, g, 0), small), 0);
    }
    return PUT(L_MUL, a, f);
}

/* 1 in a strip, else 0 */
static inline uint32_t loop_strip(loop *l, expressions *e, lg_rng *r) {
    const double width = loop_log(r, 1e-9, 0.3);
    const uint32_t g = loop_drawn_guard(l, e, r, loop_offset(r), width), zero = PUT_NUMBER(L_NUMBER, 0, 0);
    return PUT(L_MUL, PUT(L_GE, g, zero), PUT(L_GE, PUT_NUMBER(L_NUMBER, 0, width), g));
}

static inline uint32_t loop_jump(loop *l, expressions *e, lg_rng *r) {
    const uint32_t a = loop_drawn_linear(l, e, r), b = loop_drawn_linear(l, e, r);
    switch (lg_rng_below(r, 6)) {
    case 0:
        return PUT(L_MUL, a, PUT(L_SIGN, loop_drawn_guard(l, e, r, loop_offset(r), 0), 0));
    case 1: {
        const uint32_t strip = loop_strip(l, e, r);
        const double by = loop_log(r, 1, 1 / l->guard[l->guards - 1].strip);
        return PUT(L_MUL, PUT_NUMBER(L_SCALE, a, by), strip);
    }
    case 2:
        return loop_select(e, loop_strip(l, e, r), a, b);
    case 3:
        return PUT_NUMBER(L_SCALE, PUT(L_SIGN, loop_drawn_guard(l, e, r, loop_offset(r), 0), 0),
                          loop_log(r, 1e-4, 0.3));
    case 4: /* continuous, though an operation jumps */
        return PUT(L_MUL, PUT(L_SIGN, a, 0), PUT(L_MUL, a, b));
    default:
        return loop_select(
            e, PUT(L_GE, loop_drawn_guard(l, e, r, loop_offset(r), 0), PUT_NUMBER(L_NUMBER, 0, 0)), a, b);
    }
}

static inline uint32_t loop_saturated(expressions *e, uint32_t a, double limit) {
    const uint32_t bound = PUT_NUMBER(L_NUMBER, 0, -limit), low = PUT_NUMBER(L_SCALE, a, -1);
    return PUT(L_MAX, PUT_NUMBER(L_SCALE, PUT(L_MAX, low, bound), -1), bound);
}

static inline uint32_t loop_kink(loop *l, expressions *e, lg_rng *r) {
    const double width = loop_log(r, 1e-6, 0.3);
    const uint32_t a = loop_drawn_linear(l, e, r), b = loop_drawn_linear(l, e, r);
    switch (lg_rng_below(r, 7)) {
    case 0:
        return PUT(L_ABS, a, 0);
    case 1:
        return PUT(L_MUL, a, PUT(L_RELU, loop_drawn_guard(l, e, r, loop_offset(r), 0), 0));
    case 2:
        return PUT(L_MAX, a, b);
    case 3:
        return loop_saturated(e, a, loop_offset(r));
    case 4: { /* a tent */
        const uint32_t g = PUT(L_ABS, loop_drawn_guard(l, e, r, loop_offset(r), width), 0),
                       rest = PUT_NUMBER(L_SHIFT, PUT_NUMBER(L_SCALE, g, -1), width);
        return PUT(L_MUL, a, PUT_NUMBER(L_SCALE, PUT(L_RELU, rest, 0), loop_log(r, 1, 1 / width) / width));
    }
    case 5: /* a dead band */
        return PUT(L_SUB, a, loop_saturated(e, a, loop_log(r, 1e-3, 1)));
    default:
        return loop_select(e, PUT(L_GE, a, b), a, b);
    }
}

static inline uint32_t loop_friction(loop *l, expressions *e, lg_rng *r) {
    const double width = loop_log(r, 1e-4, 0.3);
    const uint32_t a = loop_chance(r, 0.7) ? (uint32_t)lg_rng_below(r, l->n) : loop_drawn_linear(l, e, r);
    return PUT(L_TANH, PUT_NUMBER(L_SCALE, a, -1 / width), 0);
}

/* ---- drawn loops ---- */

typedef enum loop_speed { SPEED_ANY, SPEED_COARSE, SPEED_FAST, SPEED_STILL } loop_speed;

typedef struct loop_kind {
    const char *name;
    loop_spice *spice;
    loop_speed speed;
} loop_kind;

static const loop_kind loop_kinds[] = {{"smooth", loop_smooth, SPEED_ANY},
                                       {"cuts", loop_cut, SPEED_ANY},
                                       {"holes", loop_hole, SPEED_ANY},
                                       {"jumps", loop_jump, SPEED_ANY},
                                       {"kinks", loop_kink, SPEED_ANY},
                                       {"coarse steps", loop_smooth, SPEED_COARSE},
                                       {"fast modes", loop_smooth, SPEED_FAST},
                                       {"oscillators", loop_smooth, SPEED_STILL},
                                       {"steep friction", loop_friction, SPEED_ANY}};

enum { LOOP_SQUARE = LOOP_STATES * LOOP_STATES, LOOP_WIDE = LOOP_STATES + LOOP_INPUTS };

static inline void loop_product(size_t n, const double *a, const double *b, double *out) {
    double sum[LOOP_WIDE * LOOP_WIDE] = {0};
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < n; k++)
            for (size_t j = 0; j < n; j++) sum[i * n + j] += a[i * n + k] * b[k * n + j];
    memcpy(out, sum, n * n * sizeof *out);
}

static inline double loop_norm(size_t n, const double *a) {
    double most = 0;
    for (size_t i = 0; i < n * n; i++) most = fmax(most, fabs(a[i]));
    return most;
}

/* The exponential of A, in place */
static inline void loop_exponential(size_t n, double *A) {
    const double norm = (double)n * loop_norm(n, A);
    const int halvings = norm > 0.1 ? (int)ceil(log2(norm / 0.1)) : 0;
    double power[LOOP_WIDE * LOOP_WIDE], sum[LOOP_WIDE * LOOP_WIDE] = {0};
    for (size_t i = 0; i < n * n; i++) A[i] = ldexp(A[i], -halvings);
    for (size_t i = 0; i < n; i++) sum[i * (n + 1)] = 1;
    memcpy(power, sum, sizeof power);
    for (int k = 1; k < 14; k++) {
        loop_product(n, power, A, power);
        for (size_t i = 0; i < n * n; i++) sum[i] += power[i] /= k;
    }
    for (int k = 0; k < halvings; k++) loop_product(n, sum, sum, sum);
    memcpy(A, sum, n * n * sizeof *A);
}

/* The largest |eigenvalue|: |A^(2^30)|^(2^-30) */
static inline double loop_radius(size_t n, const double *A) {
    double power[LOOP_WIDE * LOOP_WIDE], size = 0;
    memcpy(power, A, n * n * sizeof *A);
    for (int k = 0; k <= 30; k++) {
        const double most = loop_norm(n, power);
        if (!(most > 0 && most < 1e300)) return 0;
        size += ldexp(log(most), -k);
        for (size_t i = 0; i < n * n; i++) power[i] /= most;
        loop_product(n, power, power, power);
    }
    return exp(size);
}

/* Slopes at the goal, in sizes and units of time: of the rate by states and by inputs, and of the input */
typedef struct loop_slopes {
    double x[LOOP_SQUARE], u[LOOP_STATES * LOOP_INPUTS], k[LOOP_INPUTS * LOOP_STATES];
} loop_slopes;

static inline bool loop_linearise(const loop *l, loop_slopes *s) {
    const long double h = 1e-7L;
    long double z[LOOP_STATES] = {0}, u[LOOP_INPUTS] = {0}, at[LOOP_INPUTS], out[2][LOOP_STATES];
    bool defined = loop_evaluate(l, &l->control, z, NULL, at, NULL);
    for (size_t j = 0; j < l->n + l->m; j++) {
        const bool state = j < l->n;
        long double *const moved = state ? &z[j] : &u[j - l->n];
        const double size = state ? l->size[j] : l->force;
        for (int list = 0; list < 2; list++) {
            const expressions *e = list == 0 ? &l->rate : &l->control;
            for (int side = 0; side < 2; side++) {
                for (size_t i = 0; i < l->m; i++) u[i] = at[i];
                *moved += (side == 0 ? -h : h) * size;
                defined = loop_evaluate(l, e, z, u, out[side], NULL) && defined;
                z[state ? j : 0] = 0;
            }
            for (size_t i = 0; i < e->outputs; i++) {
                const double slope = (double)((out[1][i] - out[0][i]) / (2 * h));
                if (list == 0)
                    *(state ? &s->x[i * l->n + j] : &s->u[i * l->m + j - l->n]) = slope * l->tau / l->size[i];
                else if (state)
                    s->k[i * l->n + j] = slope / l->force;
            }
        }
    }
    return defined;
}

/* The linear part's map of `time` (steps: of a step), in sizes */
static inline void loop_map(const loop *l, const loop_slopes *s, double time, double *M) {
    const size_t n = l->n, m = l->m, all = n + m;
    double closed[LOOP_SQUARE], wide[LOOP_WIDE * LOOP_WIDE] = {0};
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            closed[i * n + j] = s->x[i * n + j];
            for (size_t k = 0; k < m; k++) closed[i * n + j] += s->u[i * m + k] * s->k[k * n + j];
        }
    memcpy(M, closed, n * n * sizeof *M);
    if (l->mode == LOOP_STEP) return;
    if (l->mode == LOOP_CONTINUOUS) {
        for (size_t i = 0; i < n * n; i++) M[i] *= time;
        loop_exponential(n, M);
        return;
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) wide[i * all + j] = time * s->x[i * n + j];
        for (size_t j = 0; j < m; j++) wide[i * all + n + j] = time * s->u[i * m + j];
    }
    loop_exponential(all, wide);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            M[i * n + j] = wide[i * all + j];
            for (size_t k = 0; k < m; k++) M[i * n + j] += wide[i * all + n + k] * s->k[k * n + j];
        }
}

/* P = sum_k M^k^T Q M^k for a random Q, in sizes; M is scaled to a radius below 1. */
static inline void loop_form(loop *l, lg_rng *r, double *M, double radius) {
    const size_t n = l->n;
    double Q[LOOP_SQUARE], turned[LOOP_SQUARE], more[LOOP_SQUARE], *P = l->P;
    for (size_t i = 0; i < n * n; i++) Q[i] = lg_rng_normal(r) / 2;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            P[i * n + j] = i == j ? 0.2 : 0;
            for (size_t k = 0; k < n; k++) P[i * n + j] += Q[k * n + i] * Q[k * n + j];
        }
    const double by = radius > 1 - 1e-6 ? (1 - 1e-6) / radius : 1;
    for (size_t i = 0; i < n * n; i++) M[i] *= by;
    for (int k = 0; k < 24; k++) {
        for (size_t i = 0; i < n * n; i++) turned[i] = M[i % n * n + i / n];
        loop_product(n, turned, P, more);
        loop_product(n, more, M, more);
        for (size_t i = 0; i < n * n; i++) P[i] += more[i];
        loop_product(n, M, M, M);
    }
}

/* P, perturbed or wrong, in the units of the states */
static inline void loop_spoil(loop *l, lg_rng *r) {
    const size_t n = l->n;
    const double share = lg_rng_uniform(r), off = share < 0.6 ? 1 : lg_rng_uniform(r);
    double factor[LOOP_STATES], trace = 0;
    for (size_t i = 0; i < n; i++) trace += l->P[i * (n + 1)] / (double)n;
    trace /= loop_log(r, 1, 1e8); /* the unit of V */
    for (size_t i = 0; i < n; i++)
        factor[i] = share < 0.6 ? 1 : share < 0.85 ? loop_log(r, 0.7, 1.4) : loop_log(r, 0.2, 5);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++) {
            const double mean = 0.5 * l->P[i * n + j] + 0.5 * l->P[j * n + i];
            l->P[i * n + j] = l->P[j * n + i] =
                mean * off * factor[i] * factor[j] / trace / (l->size[i] * l->size[j]);
        }
    for (size_t i = 0; i < n; i++)
        l->P[i * (n + 1)] *= factor[i] * factor[i] / trace / (l->size[i] * l->size[i]);
}

static inline void loop_controller(loop *l, lg_rng *r, loop_spice *spice) {
    expressions *const e = &l->control;
    loop_begin(l, e, 0, l->m);
    for (size_t i = 0; i < l->m; i++) {
        double k[LOOP_STATES];
        for (size_t j = 0; j < l->n; j++) k[j] = loop_chance(r, 0.2) ? 0 : lg_rng_uniform_in(r, -1.5, 1.5);
        uint32_t u = loop_linear(l, e, k);
        if (loop_chance(r, 0.25))
            u = PUT(L_ADD, u, PUT_NUMBER(L_SCALE, spice(l, e, r), loop_sign(r) * loop_log(r, 3e-3, 1)));
        else if (loop_chance(r, 0.6)) {
            const double limit = loop_log(r, 0.1, 3);
            u = loop_saturated(e, u, limit);
            for (int side = -1; side < 2 && l->guards < LOOP_GUARDS; side += 2) {
                loop_guard *g = &l->guard[l->guards++];
                g->a[0] = side * limit;
                memcpy(g->a + 1, k, sizeof k);
            }
        }
        loop_term(e, i, u);
        e->scale[i] = l->force;
    }
}

static inline void loop_plant(loop *l, lg_rng *r, loop_spice *spice, loop_speed speed) {
    expressions *const e = &l->rate;
    loop_begin(l, e, l->m, l->n);
    double A[LOOP_SQUARE];
    for (size_t i = 0; i < l->n * l->n; i++) A[i] = lg_rng_normal(r);
    const double fast = speed == SPEED_FAST ? loop_log(r, 5, 200) : speed == SPEED_STILL ? 0 : 1;
    if (speed == SPEED_STILL)
        for (size_t i = 0; i < l->n; i++)
            for (size_t j = 0; j < l->n; j++)
                A[i * l->n + j] = 0.2 * A[i * l->n + j] + (i + 1 == j) - (i == j + 1);
    for (size_t i = 0; i < l->n; i++) {
        A[i * (l->n + 1)] -= i == 0 ? fast : 0;
        for (size_t j = 0; j < l->n; j++) {
            if (i != j && loop_chance(r, 0.2)) continue;
            const uint32_t term = PUT_NUMBER(L_SCALE, (uint32_t)j, A[i * l->n + j]);
            if (i == j) l->diagonal[i] = term;
            loop_term(e, i, term);
        }
        for (size_t j = 0; j < l->m; j++)
            loop_term(e, i, PUT_NUMBER(L_SCALE, (uint32_t)(l->n + j), lg_rng_normal(r)));
        e->scale[i] = l->size[i] / (l->mode == LOOP_STEP ? 1 : l->tau);
    }
    for (size_t k = speed == SPEED_STILL && loop_chance(r, 0.7) ? 0
                                                                : lg_rng_below(r, 3) + (speed == SPEED_ANY);
         k-- > 0;) {
        loop_spice *const which = loop_chance(r, 0.2) ? loop_smooth : spice;
        const double by = loop_log(r, 3e-3, 1.5) * (spice == loop_friction ? 1 : loop_sign(r));
        loop_term(e, lg_rng_below(r, l->n), PUT_NUMBER(L_SCALE, which(l, e, r), by));
    }
}

/* Moves the diagonal of the plant such that the linear part's map has a wanted radius. */
static inline void loop_settle(loop *l, lg_rng *r, loop_speed speed) {
    const bool held = l->mode == LOOP_HELD;
    loop_slopes s;
    double M[LOOP_SQUARE], time = 1;
    const double still = loop_sign(r) * loop_log(r, 1e-7, 0.02), decay = loop_log(r, 0.05, 1.5),
                 part = speed == SPEED_COARSE  ? lg_rng_uniform_in(r, 0.2, loop_chance(r, 0.3) ? 3 : 0.5)
                        : speed == SPEED_STILL ? lg_rng_uniform_in(r, 0.05, 0.5)
                                               : loop_log(r, 0.01, 0.5);
    bool defined = true;
    for (int pass = 0; pass < 5; pass++) {
        defined = loop_linearise(l, &s);
        const double fast = fmax(loop_radius(l->n, s.x), 1e-3);
        time = held ? part / fast : 0.02 / fast;
        loop_map(l, &s, time, M);
        l->radius = loop_radius(l->n, M);
        const double wanted =
            speed == SPEED_STILL ? 1 + still * (held || l->mode == LOOP_STEP ? 1 : time) : exp(-decay * time);
        if (pass == 4 || !defined || !(l->radius > 1e-6) || (speed == SPEED_COARSE && pass > 1)) continue;
        for (size_t i = 0; i < l->n; i++) {
            if (l->mode == LOOP_STEP)
                l->rate.scale[i] *= wanted / l->radius;
            else
                l->rate.at[l->diagonal[i]].p -= log(l->radius / wanted) / time;
        }
    }
    l->period = time * l->tau;
    if (!defined)
        for (size_t i = 0; i < l->n * l->n; i++) M[i] = 0;
    const double radius = l->radius;
    loop_form(l, r, M, defined ? radius : 0);
    loop_spoil(l, r);
}

static inline void loop_claims(loop *l, lg_rng *r) {
    const size_t n = l->n;
    double most = INFINITY;
    for (size_t i = 0; i < n; i++) {
        const double reach = loop_log(r, 0.1, 4) * l->size[i];
        l->low[i] = l->goal[i] - reach;
        l->high[i] = l->goal[i] + reach * (loop_chance(r, 0.2) ? 1.5 : 1);
        most = fmin(most, reach * reach * l->P[i * (n + 1)] / (double)n); /* about the level that fits */
    }
    const double share = lg_rng_uniform(r), level = most * loop_log(r, 1e-3, 1);
    l->level = share < 0.35 ? level : 0;
    l->most = share > 0.7 ? level : 0;
    l->eps = loop_chance(r, 0.25) ? (share < 0.35 ? level : most) * loop_log(r, 1e-4, 0.3) : 0;
    l->errors = loop_chance(r, 0.15);
    const double size = sqrt(most) * loop_log(r, 1e-4, 0.1);
    for (size_t i = 0; i < n; i++)
        l->error[i] = l->errors && loop_chance(r, 0.7)
                          ? size / sqrt(l->P[i * (n + 1)]) / (l->mode == LOOP_CONTINUOUS ? l->tau : 1)
                          : 0;
}

/* The loop of a number: its kind, and whether its input is held, go round. */
static inline void loop_draw(uint64_t number, loop *l) {
    static const double units[] = {1, 1, 1, 0x1p30, 0x1p-30, 1e9, 1e-9, 1e3, 0.03};
    static const loop_mode modes[] = {LOOP_HELD, LOOP_CONTINUOUS, LOOP_HELD, LOOP_CONTINUOUS, LOOP_STEP};
    static const size_t states[] = {1, 1, 2, 2, 2, 2, 2, 3, 3, 4};
    lg_rng rng = test_rng(6401, number), *r = &rng;
    memset(l, 0, sizeof *l);
    l->kind = (int)(number % LG_COUNT(loop_kinds));
    const loop_kind *kind = &loop_kinds[l->kind];
    l->mode = modes[number / LG_COUNT(loop_kinds) % LG_COUNT(modes)];
    if (kind->speed == SPEED_COARSE || (kind->speed == SPEED_STILL && loop_chance(r, 0.5)))
        l->mode = LOOP_HELD;
    l->n = kind->speed == SPEED_STILL && loop_chance(r, 0.6) ? 2 : states[lg_rng_below(r, LG_COUNT(states))];
    l->m = l->n > 2 || loop_chance(r, 0.75) ? 1 : 2;
    const bool plain = loop_chance(r, 0.4), shifted = loop_chance(r, 0.2);
    for (size_t i = 0; i < l->n; i++) {
        l->size[i] = plain ? 1 : units[lg_rng_below(r, LG_COUNT(units))];
        l->goal[i] = shifted ? l->size[i] * lg_rng_uniform_in(r, -2, 2) : 0;
    }
    l->force = plain ? 1 : units[lg_rng_below(r, LG_COUNT(units))];
    l->tau = plain ? 1 : units[lg_rng_below(r, LG_COUNT(units))];
    loop_controller(l, r, kind->spice);
    loop_plant(l, r, kind->spice, kind->speed);
    loop_settle(l, r, kind->speed);
    loop_claims(l, r);
}

#undef PUT
#undef PUT_NUMBER
#endif
