/* The functions whose bounds a certificate needs, recorded from the closed loop and V. */
#include "certify/certify.h"

#include "autodiff/program/program.h"
#include "liegrad/ops.h"

typedef struct recording {
    const lg_certify *c;
    const lg_program *from;
    size_t rate, lyapunov, control; /* functions of `from` */
    bool held;
} recording;

static lg_var matrix(lg_tape *tape, const double *values, size_t n) {
    return lg_input_f64(tape, lg_shape2((uint32_t)n, (uint32_t)n), values);
}

/* z = T y, the deviation from the goal */
static lg_var deviation(const lg_certify *c, lg_tape *tape, lg_var y) {
    return c->quadratic ? lg_matmul_nt(tape, y, matrix(tape, c->T, c->n)) : y;
}

static lg_var add_goal(const lg_certify *c, lg_tape *tape, lg_var z, double sign) {
    const double *goal = c->goal;
    for (size_t i = 0; i < c->n; i++)
        if (goal[i] != 0.0) {
            const lg_var g = lg_input_f64(tape, lg_shape1((uint32_t)c->n), goal);
            return sign > 0 ? lg_add(tape, z, g) : lg_sub(tape, z, g);
        }
    return z;
}

/* V of the deviation z, (B, 1) */
static lg_var value(const recording *r, lg_tape *tape, lg_var z) {
    const lg_certify *c = r->c;
    if (c->quadratic) return lg_rowdot(tape, z, lg_matmul(tape, z, matrix(tape, c->P, c->n)));
    const lg_var x = add_goal(c, tape, z, 1);
    lg_var v = LG_NONE;
    if (lg_program_record(tape, r->from, r->lyapunov, NULL, &x, &v) != LG_OK) return LG_NONE;
    const lg_shape shape = lg_var_shape(tape, v);
    return lg_reshape(tape, v, lg_shape2(shape.dims[0], 1));
}

/* The gradient of V by z, and the rate (for steps: the next deviation) */
static lg_status local(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const recording *r = user;
    const lg_var z = deviation(r->c, tape, in[0]), x = r->held ? in[1] : add_goal(r->c, tape, z, 1);
    LG_TRY(lg_grad(tape, lg_sum(tape, value(r, tape, z)), &z, 1, &out[0]));
    out[1] = x;
    if (!r->held) LG_TRY(lg_program_record(tape, r->from, r->rate, NULL, &x, &out[1]));
    if (r->c->step && !r->held) out[1] = add_goal(r->c, tape, out[1], -1);
    return lg_tape_status(tape);
}

/* V; V' (steps: V(F(x)) - V(x)); gradient and rate */
static lg_status point(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const recording *r = user;
    const lg_var z = deviation(r->c, tape, in[0]);
    out[0] = value(r, tape, z);
    LG_TRY(local(user, tape, theta, in, out + 2));
    out[1] = r->c->step ? lg_sub(tape, value(r, tape, out[3]), out[0]) : lg_rowdot(tape, out[2], out[3]);
    return lg_tape_status(tape);
}

/* (B, k, i) and (B, k, j) -> sum_k a_ki b_kj, (B, i, j) */
static lg_var product(lg_tape *tape, lg_var a, lg_var b, uint32_t rows, uint32_t n) {
    const lg_var left = lg_reshape(tape, a, lg_shape4(rows, n, n, 1)),
                 right = lg_reshape(tape, b, lg_shape4(rows, n, 1, n));
    return lg_sum_axis(tape, lg_mul(tape, left, right), 1, false);
}

/* (B, k, j) -> sum_k P_ik a_kj, (B, i, j), with a symmetric P */
static lg_var weighed(lg_tape *tape, lg_var P, lg_var a, uint32_t rows, uint32_t n) {
    const int swap[] = {0, 2, 1};
    const lg_var turned = lg_reshape(tape, lg_permute(tape, a, swap), lg_shape2(rows * n, n));
    return lg_permute(tape, lg_reshape(tape, lg_matmul(tape, turned, P), lg_shape3(rows, n, n)), swap);
}

/* (B, k, i) and (B, k) -> sum_k a_ki b_k, (B, i) */
static lg_var times(lg_tape *tape, lg_var a, lg_var b, uint32_t rows, uint32_t n) {
    return lg_sum_axis(tape, lg_mul(tape, a, lg_reshape(tape, b, lg_shape3(rows, n, 1))), 1, false);
}

/* Over a box about the point m, with the gradient G and the rate F at m and their Jacobians over the box:
 *     V'(m + k) = G F + k.g + k^T M k,  g = G_y^T F + F_y^T G,  M = G_y^T F_y.
 * Steps, with the next deviation F and 2 P F in place of the gradient:
 *     V(F(m + k)) - V(m + k) = V(F) - V(m) + k.g + k^T M k,
 *     g = F_y^T 2 P F - T^T G,  M = F_y^T P F_y - T^T P T.
 * Outputs: V, the gradient of V at the rate's errors (G or 2 P F over the box), the rate F over the box, g,
 * M + M^T. Inputs: y, G, F; of a held loop also the next deviation over the box, and F_y. */
static lg_status bounds(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const recording *r = user;
    const lg_certify *c = r->c;
    const uint32_t n = (uint32_t)c->n, rows = lg_var_shape(tape, in[0]).dims[0];
    lg_var whole[4], M;
    LG_TRY(point(user, tape, theta, r->held ? (const lg_var[]){in[0], in[3]} : in, whole));
    const lg_var G = r->held ? LG_NONE : lg_program_call(tape, "jac_local", 0, in),
                 F = r->held ? in[4] : lg_program_call(tape, "jac_local", 1, in);
    out[0] = whole[0];
    out[2] = whole[3];
    if (!c->step) {
        out[3] = lg_add(tape, times(tape, G, in[2], rows, n), times(tape, F, in[1], rows, n));
        M = product(tape, G, F, rows, n);
        out[1] = whole[2];
    } else { /* G = 2 P T */
        const lg_var P = matrix(tape, c->P, n), T = matrix(tape, c->T, n),
                     PF = lg_scale(tape, lg_matmul(tape, in[2], P), 2);
        out[3] = lg_sub(tape, times(tape, F, PF, rows, n), lg_matmul(tape, in[1], T));
        const lg_var before = lg_matmul_tn(tape, T, lg_matmul(tape, P, T));
        M = lg_sub(tape, product(tape, weighed(tape, P, F, rows, n), F, rows, n), before);
        out[1] = lg_scale(tape, lg_matmul(tape, whole[3], P), 2);
    }
    out[4] = lg_add(tape, M, lg_permute(tape, M, (const int[]){0, 2, 1}));
    return lg_tape_status(tape);
}

/* Held loops, during a part of a step. V of F + S k + t (D + Q k) less V of F + S k is t (v + k.g + k^T M k),
 *     v = D.P (2 F + t D),  g = 2 (S^T P D + Q^T P (F + t D)),  M = S^T P Q + Q^T P S + t Q^T P Q.
 * Outputs: v, g, M + M^T. */
static lg_status between(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_certify *c = ((const recording *)user)->c;
    const uint32_t n = (uint32_t)c->n, rows = lg_var_shape(tape, in[0]).dims[0];
    const lg_var P = matrix(tape, c->P, n), F = in[0], S = in[1], D = in[2], Q = in[3], t = in[4],
                 t3 = lg_reshape(tape, t, lg_shape3(rows, 1, 1));
    const lg_var moved = lg_mul(tape, t, D), PD = lg_matmul(tape, D, P),
                 PF = lg_matmul(tape, lg_add(tape, F, moved), P);
    const lg_var PQ = weighed(tape, P, Q, rows, n);
    const lg_var M = lg_add(tape, product(tape, lg_scale(tape, S, 2), PQ, rows, n),
                            lg_mul(tape, t3, product(tape, Q, PQ, rows, n)));
    out[0] = lg_rowdot(tape, PD, lg_add(tape, lg_scale(tape, F, 2), moved));
    out[1] = lg_scale(tape, lg_add(tape, times(tape, S, PD, rows, n), times(tape, Q, PF, rows, n)), 2);
    out[2] = lg_add(tape, M, lg_permute(tape, M, (const int[]){0, 2, 1}));
    return lg_tape_status(tape);
}

lg_status lg_certify_function(const lg_program *program, const char *name, uint32_t most, bool value,
                              bool held, size_t *function, size_t *n, lg_error *error) {
    size_t inputs, outputs;
    LG_TRY(lg_program_find(program, name, function, error));
    const lg_port *in = lg_program_inputs(program, *function, &inputs);
    const lg_port *out = lg_program_outputs(program, *function, &outputs);
    const size_t states = inputs == 1 || (held && inputs > 0) ? lg_shape_count(in[0].shape) : 0;
    const bool fits =
        held || (states > 0 && !in[0].shared && in[0].shape.rank == 1 && !out[0].shared &&
                 (*n == 0 || states == *n) && lg_shape_count(out[0].shape) == (value ? 1 : states));
    if (states == 0 || states > most || !fits)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the function '%s' needs one input of 1 to %u states, and %s as its first output",
                       name, most, value ? "one number" : "as many numbers");
    *n = states;
    return LG_OK;
}

/* Whether V and V' (and so their parts by an error of the rate) are the same on both sides of the goal: the
 * outputs of `point` are V, V', the gradient and the rate (for steps: the next deviation). */
static bool is_even(const lg_certify *c) {
    if (c->flow != NULL) return lg_flow_is_odd(c->flow);
    bool even = lg_interval_parity(c->point, 0) == 1 && lg_interval_parity(c->point, 1) == 1;
    for (size_t k = 0; k < c->n; k++) even = even && lg_interval_parity(c->point, 2 + c->n + k) == -1;
    return even;
}

static lg_status evaluators(lg_certify *c, lg_error *error) {
    const bool held = c->flow != NULL;
    static const size_t near[2] = {0, 2};       /* local, point, jac_local, bounds */
    const size_t full = held ? 0 : 3, part = 2; /* held loops: bounds, point, between */
    static const size_t at = 1;
    LG_TRY(lg_interval_create(c->program, &full, 1, NULL, &c->full, error));
    LG_TRY(lg_interval_create(c->program, &at, 1, NULL, &c->point, error));
    c->even = is_even(c);
    if (held) return lg_interval_create(c->program, &part, 1, NULL, &c->part, error);
    return lg_interval_create(c->program, near, 2, NULL, &c->local, error);
}

void lg_certify_forget(lg_certify *c) {
    lg_interval_destroy(c->full);
    lg_interval_destroy(c->point);
    lg_interval_destroy(c->local);
    lg_interval_destroy(c->part);
    lg_flow_destroy(c->flow);
    lg_program_destroy(c->program);
    c->full = c->point = c->local = c->part = NULL;
    c->flow = NULL;
    c->program = NULL;
}

lg_status lg_certify_record(lg_certify *c, const lg_certify_spec *spec, lg_error *error) {
    recording r = {.c = c, .from = spec->program, .held = spec->control != NULL};
    lg_certify_forget(c);
    LG_TRY(lg_program_find(spec->program, spec->rate, &r.rate, error));
    if (!c->quadratic)
        LG_TRY(lg_certify_function(spec->program, spec->lyapunov, LG_CERTIFY_STATES, true, false, &r.lyapunov,
                                   &c->n, error));
    const uint32_t n = (uint32_t)c->n;
    const lg_shape states = lg_shape1(n), square = lg_shape2(n, n);
    const lg_port in[5] = {{.name = "y", .shape = states},
                           {.name = "g", .shape = states},
                           {.name = "f", .shape = states},
                           {.name = "x", .shape = states},
                           {.name = "jac", .shape = square}},
                  at[2] = {in[0], in[2]},
                  part[5] = {in[2],
                             in[4],
                             {.name = "d", .shape = states},
                             {.name = "q", .shape = square},
                             {.name = "t", .shape = lg_shape1(1)}},
                  out[4] = {{.name = "v"}, {.name = "rise"}, {.name = "slope"}, {.name = "rate"}},
                  terms[5] = {{.name = "v"},
                              {.name = "lever"},
                              {.name = "rate"},
                              {.name = "linear"},
                              {.name = "square"}};
    /* Of a held loop the states at the end of the period are given. */
    const lg_function_spec held[3] = {{"bounds", in, 5, terms, 5, bounds, &r},
                                      {"point", at, 2, out, 4, point, &r},
                                      {"between", part, 5, terms, 3, between, &r}},
                           others[3] = {{"local", in, 1, out + 2, 2, local, &r},
                                        {"point", in, 1, out, 4, point, &r},
                                        {"bounds", in, 3, terms, 5, bounds, &r}};
    if (!r.held) {
        LG_TRY(lg_program_of(c->context, others, 2, &c->program, error));
        LG_TRY(lg_program_jacobian(c->program, "local", error));
        LG_TRY(lg_program_add_function(c->program, &others[2], error));
        return evaluators(c, error);
    }
    LG_TRY(lg_program_find(spec->program, spec->control, &r.control, error));
    const lg_flow_spec flow = {spec->program, r.rate, r.control, spec->period, c->goal, c->T};
    LG_TRY(lg_flow_create(c->context, &flow, &c->flow, error));
    if (c->file != NULL && c->made == NULL) lg_flow_set_steps(c->flow, c->file->steps);
    LG_TRY(lg_program_of(c->context, held, LG_COUNT(held), &c->program, error));
    return evaluators(c, error);
}

/* Over the box of {V <= the largest level}. */
lg_status lg_certify_round(lg_certify *c, const lg_certify_spec *spec, lg_error *error) {
    double low[LG_CERTIFY_STATES], high[LG_CERTIFY_STATES];
    size_t function, outputs;
    const double level = c->automatic ? fmin(c->level, lg_certify_reach(c)) : c->level;
    if (spec->unit == 0) return LG_OK;
    for (size_t i = 0; i < c->n; i++) {
        const double side = fmin(sqrt(level) * lg_certify_width(c, i) * (1 + 1e-6), DBL_MAX);
        low[i] = c->goal[i] - side;
        high[i] = c->goal[i] + side;
    }
    LG_TRY(lg_program_find(spec->program, spec->control, &function, error));
    LG_TRY(lg_interval_rounding(spec->program, function, low, high, spec->unit, c->rounding, error));
    const lg_port *u = lg_program_outputs(spec->program, function, &outputs);
    for (size_t j = 0; j < lg_shape_count(u[0].shape); j++)
        c->input_error = fmax(c->input_error, c->rounding[j]);
    c->rounds = c->input_error > 0 && c->input_error <= DBL_MAX;
    return LG_OK;
}
