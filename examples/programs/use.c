/* What can be done with any program: running it, deriving functions, comparing. */
#include "programs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/core.h>

enum { PORTS = 16 };

/* A function ready to run on one row, with memory for its inputs and outputs. */
typedef struct ready {
    lg_plan *plan;
    size_t inputs, outputs;
    double *in[PORTS], *out[PORTS];
    void *work;
} ready;

/* Returns 64-byte aligned, zeroed memory. */
static void *reserve(size_t bytes) {
    const size_t whole = (bytes + 63) / 64 * 64 + 64;
    unsigned char *memory = aligned_alloc(64, whole);
    if (memory == NULL) exit(5);
    for (size_t i = 0; i < whole; i++) memory[i] = 0;
    return memory;
}

static ready prepare(const lg_program *program, const char *name) {
    ready r = {.plan = NULL};
    lg_error error;
    size_t function;
    if (lg_program_find(program, name, &function, NULL) != LG_OK ||
        lg_plan_create(program, function, NULL, &r.plan, &error) != LG_OK) {
        (void)fprintf(stderr, "%s cannot be run\n", name);
        exit(1);
    }
    (void)lg_program_inputs(program, function, &r.inputs);
    (void)lg_program_outputs(program, function, &r.outputs);
    if (r.inputs > PORTS || r.outputs > PORTS) exit(1);
    for (size_t i = 0; i < r.inputs; i++) r.in[i] = reserve(lg_plan_input_count(r.plan, i) * sizeof(double));
    for (size_t j = 0; j < r.outputs; j++)
        r.out[j] = reserve(lg_plan_output_count(r.plan, j) * sizeof(double));
    r.work = reserve(lg_plan_work_size(r.plan));
    return r;
}

static void run(const ready *r) {
    lg_plan_eval(r->plan, (const void *const *)r->in, (void *const *)r->out, r->work);
}

static void release(ready *r) {
    for (size_t i = 0; i < r->inputs; i++) free(r->in[i]);
    for (size_t j = 0; j < r->outputs; j++) free(r->out[j]);
    free(r->work);
    lg_plan_destroy(r->plan);
}

/* Fills the inputs of r. The first `from` inputs are copied from `like`; the others are random, within the
 * ranges of their ports. */
static void draw(const lg_program *program, const char *name, const ready *like, size_t from, ready *r) {
    lg_rng rng;
    size_t function, count;
    lg_rng_seed(&rng, 5, from);
    if (lg_program_find(program, name, &function, NULL) != LG_OK) return;
    const lg_port *port = lg_program_inputs(program, function, &count);
    for (size_t i = 0; i < count; i++) {
        const bool open = port[i].low == 0 && port[i].high == 0;
        for (size_t k = 0; k < lg_plan_input_count(r->plan, i); k++)
            r->in[i][k] = i < from
                              ? like->in[i][k]
                              : lg_rng_uniform_in(&rng, open ? -1 : port[i].low, open ? 1 : port[i].high);
    }
}

static double dot(double *const *a, double *const *b, const lg_plan *plan, size_t n, bool inputs) {
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < (inputs ? lg_plan_input_count(plan, i) : lg_plan_output_count(plan, i)); k++)
            sum += a[i][k] * b[i][k];
    return sum;
}

static const char *const prefix[LG_DERIVATIVE_KIND_COUNT] = {"fwd1", "adj1", "jac", "jac_adj1"};

/* Checks <c, J v> = <J^T c, v> for a random direction v and a random cotangent c. */
static int check_derivatives(const lg_program *program, const char *function) {
    char name[2][80];
    for (int k = 0; k < 2; k++) (void)snprintf(name[k], sizeof name[k], "%s_%s", prefix[k], function);
    ready value = prepare(program, function), forward = prepare(program, name[0]),
          adjoint = prepare(program, name[1]);
    const size_t n = value.inputs, m = value.outputs;
    draw(program, function, NULL, 0, &value);
    draw(program, name[0], &value, n, &forward);
    draw(program, name[1], &value, n, &adjoint);
    run(&forward);
    run(&adjoint);
    const double a = dot(adjoint.in + n, forward.out, value.plan, m, false),
                 b = dot(adjoint.out, forward.in + n, value.plan, n, true);
    (void)printf("  <c, J v> = %.15g, <J^T c, v> = %.15g\n", a, b);
    release(&value);
    release(&forward);
    release(&adjoint);
    return fabs(a - b) <= 1e-12 * (1 + fabs(a));
}

int use(lg_program *program, const char *function) {
    lg_error error;
    for (int k = 0; k < LG_DERIVATIVE_KIND_COUNT; k++) {
        lg_derivative what;
        lg_derivative_init(&what);
        what.kind = (lg_derivative_kind)k;
        what.function = function;
        if (lg_program_derive(program, &what, &error) != LG_OK) {
            (void)fprintf(stderr, "%s\n", error.message);
            return 0;
        }
    }
    for (size_t f = 0; f < lg_program_functions(program); f++)
        (void)printf("  %s: %zu operations\n", lg_program_function_name(program, f),
                     lg_program_operations(program, f));
    return check_derivatives(program, function);
}

int same(const lg_program *a, const lg_program *b, const char *function) {
    ready x = prepare(a, function), y = prepare(b, function);
    int equal = x.inputs == y.inputs && x.outputs == y.outputs;
    draw(a, function, NULL, 0, &x);
    draw(b, function, NULL, 0, &y);
    run(&x);
    run(&y);
    for (size_t j = 0; equal && j < x.outputs; j++)
        equal = memcmp(x.out[j], y.out[j], lg_plan_output_count(x.plan, j) * sizeof(double)) == 0;
    release(&x);
    release(&y);
    return equal;
}
