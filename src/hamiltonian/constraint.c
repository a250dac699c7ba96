/* Constraints of the user: the object, and the equations of motion on a tape; liegrad/constraint.h has the
 * formulas. */
#include "hamiltonian/constraint.h"

#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "autodiff/program/program.h"
#include "kernels/matrix.h"

LG_AT(lg_constraint_destroy, lg_constraint)

/* ---- on a tape ---- */

/* x (B, n) as columns (B, n, 1), and back. */
static lg_var column(lg_tape *tape, lg_var x) {
    const lg_shape shape = lg_var_shape(tape, x);
    return lg_reshape(tape, x, lg_shape3(shape.dims[0], shape.dims[1], 1));
}

static lg_var flat(lg_tape *tape, lg_var x) {
    const lg_shape shape = lg_var_shape(tape, x);
    return lg_reshape(tape, x, lg_shape2(shape.dims[0], shape.dims[1]));
}

/* The normals at q: G (B, m, n), the rows of G divided by their lengths `length` (B, m, 1); LG_NONE without
 * constraints. */
typedef struct normals {
    lg_var whole, G, length;
} normals;

static normals normals_at(lg_tape *tape, const lg_constraint *c, double unit, lg_var q) {
    normals made = {LG_NONE, LG_NONE, LG_NONE};
    if (c == NULL) return made;
    const lg_var x = unit == 1.0 ? q : lg_scale(tape, q, unit);
    if (lg_program_record(tape, c->program, c->jacobian, NULL, &x, &made.whole) != LG_OK) return made;
    made.length = lg_sqrt(tape, lg_rownorm2(tape, made.whole));
    made.G = lg_div(tape, made.whole, made.length);
    return made;
}

/* The derivative of G along v, its rows divided by the same lengths. The lengths are not differentiated:
 * liegrad/constraint.h holds for any factors of the rows. */
static lg_var bent(lg_tape *tape, const normals *at, lg_var q, lg_var v) {
    lg_var change = LG_NONE;
    if (lg_jvp(tape, &at->whole, 1, &q, &v, 1, &change) != LG_OK) return LG_NONE;
    return lg_div(tape, change, at->length);
}

static lg_var velocity_of(lg_tape *tape, lg_var G, lg_var inverse_mass, lg_var p, lg_var *lambda) {
    lg_var u = column(tape, p);
    if (!lg_is_none(G)) {
        const lg_var GW = lg_matmul(tape, G, inverse_mass);
        *lambda = lg_spd_solve(tape, lg_matmul_nt(tape, GW, G), lg_matmul(tape, GW, u));
        u = lg_sub(tape, u, lg_matmul_tn(tape, G, *lambda));
    }
    return flat(tape, lg_matmul(tape, inverse_mass, u));
}

lg_var lg_constraint_record_velocity(lg_tape *tape, const lg_constraint *constraint, double unit,
                                     lg_var inverse_mass, lg_var q, lg_var p) {
    lg_var lambda;
    return velocity_of(tape, normals_at(tape, constraint, unit, q).G, inverse_mass, p, &lambda);
}

void lg_constraint_record_gradient(lg_tape *tape, const lg_constraint *constraint, double unit,
                                   lg_var inverse_mass, lg_var q, lg_var p, lg_var slope, lg_var *dH) {
    lg_var lambda;
    const normals at = normals_at(tape, constraint, unit, q);
    dH[0] = slope;
    dH[1] = velocity_of(tape, at.G, inverse_mass, p, &lambda);
    if (lg_is_none(at.G)) return;
    const lg_var pull = lg_matmul_tn(tape, bent(tape, &at, q, dH[1]), lambda);
    dH[0] = lg_sub(tape, slope, flat(tape, pull));
}

void lg_constraint_record_field(lg_tape *tape, const lg_constraint *constraint, double unit, const lg_var *y,
                                const lg_var *dH, lg_var input, lg_var *out) {
    const lg_var q = y[0], p = y[1], v = dH[1];
    lg_var force = lg_neg(tape, dH[0]);
    if (!lg_is_none(input)) force = lg_add(tape, force, input);
    const normals at = normals_at(tape, constraint, unit, q);
    const lg_var across = lg_matmul(tape, at.G, column(tape, force));
    const lg_var turn = lg_matmul(tape, bent(tape, &at, q, v), column(tape, p));
    const lg_var k = lg_spd_solve(tape, lg_matmul_nt(tape, at.G, at.G), lg_add(tape, across, turn));
    out[0] = v;
    out[1] = lg_sub(tape, force, flat(tape, lg_matmul_tn(tape, at.G, k)));
}

/* ---- the functions of the user ---- */

enum { CONSTRAINT, POTENTIAL, MASS, FUNCTIONS };
static const char *const names[] = {"constraint", "potential", "mass"}, *const outputs[] = {"g", "V", "M"};

/* Whether the function takes q (n) and gives one tensor. */
static lg_status check_ports(const lg_program *program, size_t function, uint32_t n, lg_error *error) {
    size_t in = 0, out = 0;
    const lg_port *q = lg_program_inputs(program, function, &in);
    const char *name = lg_program_function_name(program, function);
    (void)lg_program_outputs(program, function, &out);
    if (in != 1 || out != 1)
        return lg_fail(error, LG_FORMAT,
                       "function %s has %zu inputs and %zu outputs; it must take q and give %s", name, in,
                       out, "one output");
    if (q->shared || q->shape.rank != 1)
        return lg_fail(error, LG_FORMAT, "function %s: input %s must be a vector, one per row", name,
                       q->name);
    if (n > 0 && q->shape.dims[0] != n)
        return lg_fail(error, LG_FORMAT, "function %s takes %u numbers, but function constraint takes %u",
                       name, q->shape.dims[0], n);
    return LG_OK;
}

/* Makes c->own, with the functions that the program has. */
static lg_status take_functions(lg_constraint *c, const lg_program *program, lg_error *error) {
    lg_program_part from[FUNCTIONS];
    lg_port in[FUNCTIONS], out[FUNCTIONS];
    lg_function_spec functions[FUNCTIONS];
    lg_program_spec spec;
    size_t count = 0, function;
    lg_program_spec_init(&spec);
    for (int i = 0; i < FUNCTIONS; i++) {
        const lg_status found = lg_program_find(program, names[i], &function, i == 0 ? error : NULL);
        if (found == LG_NOT_FOUND && i > 0) continue;
        if (found != LG_OK) {
            if (error != NULL) error->status = LG_FORMAT;
            return LG_FORMAT;
        }
        LG_TRY(check_ports(program, function, c->n, error));
        in[count] = *lg_program_inputs(program, function, &(size_t){0});
        if (i == CONSTRAINT) c->n = in[count].shape.dims[0];
        in[count].name = "q";
        out[count] =
            (lg_port){.name = outputs[i], .unit = lg_program_outputs(program, function, &(size_t){0})->unit};
        from[count] = (lg_program_part){program, function};
        functions[count] =
            (lg_function_spec){names[i], &in[count], 1, &out[count], 1, lg_program_record_part, &from[count]};
        count++;
    }
    spec.functions = functions;
    spec.function_count = count;
    return lg_program_build(c->context, &spec, &c->own, error);
}

static const lg_port *output_of(const lg_program *program, const char *name) {
    size_t function, count;
    if (lg_program_find(program, name, &function, NULL) != LG_OK) return NULL;
    return lg_program_outputs(program, function, &count);
}

static lg_status check_sizes(lg_constraint *c, lg_error *error) {
    const lg_port *g = output_of(c->own, "constraint"), *V = output_of(c->own, "potential");
    const uint64_t m = lg_shape_count(g->shape);
    if (c->n < 2 || c->n > LG_CONSTRAINT_MOST)
        return lg_fail(error, LG_FORMAT, "function constraint takes %u numbers; 2 to %d are possible", c->n,
                       LG_CONSTRAINT_MOST);
    if (g->shared || g->shape.rank > 1 || m < 1 || m >= c->n)
        return lg_fail(error, LG_FORMAT,
                       "function constraint must give a vector of 1 to %u numbers for each q of %u numbers",
                       c->n - 1, c->n);
    if (V != NULL && (V->shared || lg_shape_count(V->shape) != 1))
        return lg_fail(error, LG_FORMAT, "function potential must give one number for each q");
    c->m = (uint32_t)m;
    return LG_OK;
}

/* ---- the mass ---- */

/* The inverse of a symmetric positive definite matrix. */
static bool invert_spd(size_t n, const double *a, double *inverse) {
    double L[LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST];
    size_t pivot[LG_CONSTRAINT_MOST];
    if (!lg_matrix_cholesky(n, a, L)) return false;
    for (size_t i = 0; i < n * n; i += n + 1)
        if (!(L[i] * L[i] > 64 * 2.3e-16 * a[i])) return false;
    memcpy(L, a, n * n * sizeof *L);
    return lg_matrix_invert(n, L, pivot, inverse);
}

static lg_status read_mass(lg_constraint *c, const lg_port *port, lg_error *error) {
    unsigned char pattern[LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST];
    double q[LG_CONSTRAINT_MOST] = {0.0}, M[LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST];
    const size_t n = c->n, count = lg_shape_count(port->shape);
    const double *in = q;
    double *out = M;
    size_t function;
    LG_TRY(lg_program_find(c->own, "mass", &function, error));
    if (count != n && count != n * n)
        return lg_fail(error, LG_FORMAT, "function mass gives %zu numbers; %zu or %zu are possible", count, n,
                       n * n);
    LG_TRY(lg_program_sparsity(c->own, function, 0, 0, pattern, error));
    for (size_t i = 0; i < count * n; i++)
        if (pattern[i])
            return lg_fail(error, LG_FORMAT, "function mass depends on q: the mass must be constant");
    LG_TRY(lg_program_eval(c->context, c->own, "mass", 1, &in, &out, error));
    memset(c->mass, 0, sizeof c->mass);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            c->mass[i * n + j] = count == n ? (i == j ? M[i] : 0.0) : 0.5 * (M[i * n + j] + M[j * n + i]);
    for (size_t i = 0; i < n * n; i++)
        if (!isfinite(c->mass[i])) return lg_fail(error, LG_NOT_FINITE, "function mass: not finite");
    for (size_t i = 0; count > n && i < n * n; i++)
        if (fabs(M[i] - c->mass[i]) > 1e-12 * sqrt(c->mass[i % n * (n + 1)] * c->mass[i / n * (n + 1)]))
            return lg_fail(error, LG_FORMAT, "function mass: the matrix is not symmetric");
    return LG_OK;
}

static lg_status find_mass(lg_constraint *c, lg_error *error) {
    const lg_port *port = output_of(c->own, "mass");
    for (size_t i = 0; i < c->n; i++) c->mass[i * (c->n + 1)] = 1.0;
    if (port != NULL) LG_TRY(read_mass(c, port, error));
    if (!invert_spd(c->n, c->mass, c->inverse))
        return lg_fail(error, LG_FORMAT, "function mass: the matrix is not positive definite");
    return LG_OK;
}

/* ---- derivatives and plans ---- */

static lg_status derive(lg_constraint *c, lg_derivative_kind kind, const char *function, const char *name,
                        lg_error *error) {
    const lg_derivative what = {.size = sizeof what, .kind = kind, .function = function, .name = name};
    return lg_program_derive(c->program, &what, error);
}

static lg_status plan(lg_constraint *c, const lg_program *program, const char *name, size_t rows,
                      lg_plan **out, lg_error *error) {
    LG_TRY(lg_program_plan(program, name, LG_F64, rows, out, error));
    const size_t size = lg_plan_work_size(*out);
    c->work_size = size > c->work_size ? size : c->work_size;
    return LG_OK;
}

/* The field of the true motion. */
static lg_status motion(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *f) {
    const lg_constraint *c = user;
    const uint32_t n = c->n;
    const lg_var y[2] = {lg_slice(tape, x[0], 1, 0, n), lg_slice(tape, x[0], 1, n, n)};
    const lg_var W = lg_input_f64(tape, lg_shape3(1, n, n), c->inverse);
    lg_var slope, dH[2] = {LG_NONE, LG_NONE}, out[2];
    size_t function;
    LG_TRY(lg_program_find(c->program, "slope", &function, NULL));
    LG_TRY(lg_program_record(tape, c->program, function, NULL, y, &slope));
    slope = lg_reshape(tape, slope, lg_var_shape(tape, y[0]));
    lg_constraint_record_gradient(tape, c, 1.0, W, y[0], y[1], slope, dH);
    lg_constraint_record_field(tape, c, 1.0, y, dH, LG_NONE, out);
    *f = lg_concat(tape, out, 2, 1);
    return lg_tape_status(tape);
}

static lg_status make_motion(lg_constraint *c, lg_error *error) {
    size_t function, count;
    LG_TRY(lg_program_find(c->own, "constraint", &function, error));
    const lg_port *q = lg_program_inputs(c->own, function, &count);
    const lg_port x = {.name = "x", .shape = lg_shape1(2 * c->n), .low = q->low, .high = q->high};
    const lg_port f = {.name = "f"};
    const lg_function_spec field = {"field", &x, 1, &f, 1, motion, c};
    return lg_program_of(c->context, &field, 1, &c->motion, error);
}

static lg_status fill(lg_constraint *c, const lg_program *program, lg_error *error) {
    LG_TRY(take_functions(c, program, error));
    LG_TRY(check_sizes(c, error));
    LG_TRY(find_mass(c, error));
    program = c->own;
    const bool moves = output_of(c->own, "potential") != NULL;
    lg_constraint from = *c; /* a second copy, to which derivatives are added */
    from.own = NULL, from.n = 0;
    const lg_status copied = take_functions(&from, program, error);
    c->program = from.own;
    LG_TRY(copied);
    LG_TRY(derive(c, LG_DERIVATIVE_JACOBIAN, "constraint", "jacobian", error));
    LG_TRY(derive(c, LG_DERIVATIVE_FORWARD, "jacobian", "bend", error));
    if (moves) LG_TRY(derive(c, LG_DERIVATIVE_JACOBIAN, "potential", "slope", error));
    LG_TRY(lg_program_find(c->program, "jacobian", &c->jacobian, error));
    LG_TRY(plan(c, c->program, "constraint", 1, &c->g, error));
    LG_TRY(plan(c, c->program, "jacobian", 1, &c->G, error));
    LG_TRY(plan(c, c->program, "bend", c->n, &c->bends, error));
    if (!moves) return LG_OK;
    LG_TRY(plan(c, c->program, "potential", 1, &c->potential, error));
    LG_TRY(plan(c, c->program, "slope", 1, &c->slope, error));
    LG_TRY(make_motion(c, error));
    return plan(c, c->motion, "field", 1, &c->field, error);
}

lg_status lg_constraint_create(const lg_context *context, const lg_program *program, lg_constraint **out,
                               lg_error *error) {
    LG_NEEDS(error, program, out);
    LG_CLEAN(lg_constraint_destroy_at) lg_constraint *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a constraint");
    made->context = context;
    LG_TRY(fill(made, program, error));
    return LG_MOVE(out, made);
}

void lg_constraint_destroy(lg_constraint *constraint) {
    if (constraint == NULL) return;
    lg_plan *const plans[] = {constraint->g,         constraint->G,     constraint->bends,
                              constraint->potential, constraint->slope, constraint->field};
    for (size_t i = 0; i < LG_COUNT(plans); i++) lg_plan_destroy(plans[i]);
    lg_program_destroy(constraint->motion);
    lg_program_destroy(constraint->program);
    lg_program_destroy(constraint->own);
    lg_free(constraint->context, constraint);
}

uint32_t lg_constraint_coordinates(const lg_constraint *constraint) {
    return constraint->n;
}

uint32_t lg_constraint_equations(const lg_constraint *constraint) {
    return constraint->m;
}

bool lg_constraint_moves(const lg_constraint *constraint) {
    return constraint->field != NULL;
}

const lg_program *lg_constraint_program(const lg_constraint *constraint) {
    return constraint->own;
}
