/* The functions whose bounds a certificate needs, recorded from the closed loop and V. */
#include "control/certify.h"

#include "liegrad/ops.h"

typedef struct recording {
    const lg_certify *c;
    const lg_program *from;
    size_t rate, lyapunov; /* functions of `from` */
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

static lg_var rate(const recording *r, lg_tape *tape, lg_var z) {
    const lg_var x = add_goal(r->c, tape, z, 1);
    lg_var f = LG_NONE;
    (void)lg_program_record(tape, r->from, r->rate, NULL, &x, &f);
    return f;
}

static lg_var slope(lg_tape *tape, lg_var v, lg_var z) {
    lg_var g = LG_NONE;
    (void)lg_grad(tape, lg_sum(tape, v), &z, 1, &g);
    return g;
}

/* V (B, 1), and V' or V(F(x)) - V(x) (B, 1), with the error as a further input */
static lg_status claim(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const recording *r = user;
    (void)theta;
    const lg_var z = deviation(r->c, tape, in[0]);
    const lg_var v = value(r, tape, z);
    lg_var f = rate(r, tape, z);
    if (r->c->errors) f = lg_add(tape, f, in[1]);
    out[0] = v;
    out[1] = r->c->step ? lg_sub(tape, value(r, tape, add_goal(r->c, tape, f, -1)), v)
                        : lg_rowdot(tape, slope(tape, v, z), f);
    return lg_tape_status(tape);
}

/* The gradient of V by z, and the rate (for steps: the next deviation) */
static lg_status local(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const recording *r = user;
    (void)theta;
    const lg_var z = deviation(r->c, tape, in[0]);
    out[0] = slope(tape, value(r, tape, z), z);
    out[1] = rate(r, tape, z);
    if (r->c->step) out[1] = add_goal(r->c, tape, out[1], -1);
    return lg_tape_status(tape);
}

static lg_status jacobian(lg_program *program, const char *function, lg_error *error) {
    lg_derivative what;
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_JACOBIAN;
    what.function = function;
    return lg_program_derive(program, &what, error);
}

static lg_status find(const lg_certify_spec *spec, const char *name, bool state, size_t *function, size_t *n,
                      lg_error *error) {
    size_t inputs, outputs;
    LG_TRY(lg_program_find(spec->program, name, function, error));
    const lg_port *in = lg_program_inputs(spec->program, *function, &inputs);
    const lg_port *out = lg_program_outputs(spec->program, *function, &outputs);
    const size_t states = inputs == 1 ? lg_shape_count(in[0].shape) : 0;
    if (states == 0 || states > LG_CERTIFY_STATES || in[0].shared || in[0].shape.rank != 1 || out[0].shared ||
        (*n != 0 && states != *n) || lg_shape_count(out[0].shape) != (state ? states : 1))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the function '%s' needs one input of 1 to %d states, and %s as its first output",
                       name, LG_CERTIFY_STATES, state ? "as many numbers" : "one number");
    *n = states;
    return LG_OK;
}

static lg_status evaluators(lg_certify *c, lg_error *error) {
    const size_t full[2] = {0, 2}, near[2] = {1, 3};
    LG_TRY(lg_interval_create(c->program, full, 2, NULL, &c->full, error));
    LG_TRY(lg_interval_create(c->program, full, 1, NULL, &c->point, error));
    LG_TRY(lg_interval_create(c->program, near, 2, NULL, &c->local, error));
    c->smooth = lg_interval_continuous(c->full, 0);
    return LG_OK;
}

void lg_certify_forget(lg_certify *c) {
    lg_interval_destroy(c->full);
    lg_interval_destroy(c->point);
    lg_interval_destroy(c->local);
    lg_program_destroy(c->program);
    c->full = c->point = c->local = NULL;
    c->program = NULL;
}

lg_status lg_certify_record(lg_certify *c, const lg_certify_spec *spec, lg_error *error) {
    recording r = {.c = c, .from = spec->program};
    lg_certify_forget(c);
    LG_TRY(find(spec, spec->rate, true, &r.rate, &c->n, error));
    if (!c->quadratic) LG_TRY(find(spec, spec->lyapunov, false, &r.lyapunov, &c->n, error));
    const lg_shape states = lg_shape1((uint32_t)c->n);
    const lg_port in[2] = {{.name = "y", .shape = states}, {.name = "e", .shape = states}};
    const lg_port out[2] = {{.name = "v"}, {.name = "rise"}},
                  local_out[2] = {{.name = "slope"}, {.name = "rate"}};
    const lg_function_spec functions[2] = {{"claim", in, c->errors ? 2 : 1, out, 2, claim, &r},
                                           {"local", in, 1, local_out, 2, local, &r}};
    lg_program_spec program;
    lg_program_spec_init(&program);
    program.functions = functions;
    program.function_count = 2;
    LG_TRY(lg_program_build(c->context, &program, &c->program, error));
    LG_TRY(jacobian(c->program, "claim", error));
    LG_TRY(jacobian(c->program, "local", error));
    return evaluators(c, error);
}
