/* Compares plans of a program's functions with the tape, in both types and for many numbers of rows. A test
 * that includes this header must include support/malloc_count.h first. */
#ifndef LG_PLAN_WAYS_H
#define LG_PLAN_WAYS_H

#include "autodiff/program_support.h"

#include "autodiff/program/plan.h"
#include "autodiff/program/program.h"

enum { PORTS = LG_PROGRAM_MAX_PORTS };
static const size_t rows_tried[] = {1, 2, 3, 7, 64};

/* ---- numbers ---- */

typedef struct numbers {
    size_t inputs, outputs, in_count[PORTS], out_count[PORTS];
    double *in[PORTS], *out[PORTS];
} numbers;

/* `bytes` and 64 guard bytes, which `run` checks. */
static inline void *room(size_t bytes) {
    return lg_test_memory(bytes + 64);
}

static inline void open_numbers(numbers *n, const lg_program *program, size_t function, size_t rows,
                                bool rounded) {
    const lg_port *in = lg_program_inputs(program, function, &n->inputs),
                  *out = lg_program_outputs(program, function, &n->outputs);
    for (size_t i = 0; i < n->inputs; i++) {
        const bool ranged = in[i].low != 0.0 || in[i].high != 0.0;
        n->in_count[i] = lg_shape_count(lg_port_shape(&in[i], rows));
        n->in[i] = test_numbers(12 + rows + 100 * i, n->in_count[i], ranged ? in[i].low : -1.0,
                                ranged ? in[i].high : 1.0);
        for (size_t j = 0; rounded && j < n->in_count[i]; j++) n->in[i][j] = (double)(float)n->in[i][j];
    }
    for (size_t j = 0; j < n->outputs; j++) {
        n->out_count[j] = lg_shape_count(lg_port_shape(&out[j], rows));
        n->out[j] = TEST_ARRAY(double, n->out_count[j]);
    }
}

/* Evaluates the function on the tape into n->out. */
static inline void by_tape(const lg_program *program, size_t function, size_t rows, const numbers *n) {
    lg_tape *tape = test_tape(LG_F64);
    lg_var in[PORTS], out[PORTS];
    size_t count;
    const lg_port *port = lg_program_inputs(program, function, &count);
    for (size_t i = 0; i < n->inputs; i++) in[i] = lg_input(tape, lg_port_shape(&port[i], rows), n->in[i]);
    if (lg_program_record(tape, program, function, NULL, in, out) != LG_OK)
        fail_msg("%s", lg_tape_message(tape));
    for (size_t j = 0; j < n->outputs; j++) assert_ok(lg_read(tape, out[j], n->out_count[j], n->out[j]));
}

/* ---- plans ---- */

RELEASES(release_plan, lg_plan_destroy)

/* A plan that the running test owns; options NULL: one row. */
static inline lg_plan *test_plan(const lg_program *program, size_t function, const lg_plan_options *options) {
    lg_plan *plan = NULL;
    assert_told(lg_plan_create(program, function, options, &plan, &told));
    lg_test_owns(plan, release_plan);
    return plan;
}

static inline lg_plan_options plan_options(size_t rows, lg_dtype dtype) {
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = dtype;
    return options;
}

typedef struct ready {
    lg_plan *plan;
    void *in[PORTS], *out[PORTS], *work;
    size_t size; /* bytes per number */
} ready;

static inline void open_plan(ready *r, const lg_program *program, size_t function, size_t rows,
                             lg_dtype dtype, const numbers *n) {
    const lg_plan_options options = plan_options(rows, dtype);
    r->plan = test_plan(program, function, &options);
    r->size = dtype == LG_F64 ? sizeof(double) : sizeof(float);
    r->work = room(lg_plan_work_size(r->plan));
    for (size_t i = 0; i < n->inputs; i++) {
        assert_int_equal(lg_plan_input_count(r->plan, i), n->in_count[i]);
        r->in[i] = room(n->in_count[i] * r->size);
        lg_kernels_for(dtype)->convert_in(n->in_count[i], n->in[i], r->in[i]);
    }
    for (size_t j = 0; j < n->outputs; j++) {
        assert_int_equal(lg_plan_output_count(r->plan, j), n->out_count[j]);
        r->out[j] = room(n->out_count[j] * r->size);
    }
    assert_int_equal(lg_plan_input_count(r->plan, n->inputs), 0);
    assert_int_equal(lg_plan_output_count(r->plan, n->outputs), 0);
}
/* Runs the plan in work memory filled with `fill`, and with outputs full of NaN. The guard bytes behind each
 * array must stay. */
static inline void run(const ready *r, const numbers *n, void *const *out, int fill) {
    const size_t bytes = lg_plan_work_size(r->plan);
    memset(r->work, fill, bytes);
    memset((char *)r->work + bytes, 0x5a, 64);
    for (size_t j = 0; j < n->outputs; j++)
        if (out[j] != NULL) memset(out[j], 0xff, n->out_count[j] * r->size + 64);
    lg_plan_eval(r->plan, (const void *const *)(void *const *)r->in, out, r->work);
    for (size_t i = 0; i < 64; i++) assert_int_equal(((unsigned char *)r->work)[bytes + i], 0x5a);
    for (size_t j = 0; j < n->outputs; j++)
        for (size_t i = 0; out[j] != NULL && i < 64; i++)
            assert_int_equal(((unsigned char *)out[j])[n->out_count[j] * r->size + i], 0xff);
}

static inline void compare(const char *name, size_t rows, const ready *r, const numbers *n,
                           double tolerance) {
    for (size_t j = 0; j < n->outputs; j++) {
        double size = 1e-3;
        for (size_t i = 0; i < n->out_count[j]; i++) size = fmax(size, fabs(n->out[j][i]));
        for (size_t i = 0; i < n->out_count[j]; i++) {
            double got;
            lg_kernels_for(r->size == sizeof(double) ? LG_F64 : LG_F32)
                ->convert_out(1, (char *)r->out[j] + i * r->size, &got);
            if (!(fabs(got - n->out[j][i]) <= tolerance * size))
                fail_msg("%s, %zu rows, output %zu, element %zu: %.17g, not %.17g", name, rows, j, i, got,
                         n->out[j][i]);
        }
    }
}

/* The bits must not depend on the contents of the work memory, or on which outputs are requested. A run must
 * not allocate or lock. */
static inline void compare_asked(const char *name, const ready *r, const numbers *n) {
    void *other[PORTS] = {NULL};
    run(r, n, other, 0x00);
    for (size_t j = 0; j < n->outputs; j++) {
        void *alone[PORTS] = {NULL};
        other[j] = alone[j] = room(n->out_count[j] * r->size);
        for (int more = 0; more < 2; more++) {
            run(r, n, more ? other : alone, j % 2 == 0 ? 0x00 : 0xff);
            if (memcmp(other[j], r->out[j], n->out_count[j] * r->size) != 0)
                fail_msg("%s: output %zu %s has other bits", name, j, more ? "with those before" : "alone");
        }
    }
    if (!lg_count_available()) return;
    assert_no_malloc_no_lock(
        lg_plan_eval(r->plan, (const void *const *)(void *const *)r->in, r->out, r->work));
}

static inline void check_function(const char *name, const lg_program *program, size_t function, size_t rows) {
    for (int dtype = 0; dtype < 2; dtype++) {
        numbers n;
        ready r;
        open_numbers(&n, program, function, rows, dtype == 1);
        by_tape(program, function, rows, &n);
        open_plan(&r, program, function, rows, dtype == 0 ? LG_F64 : LG_F32, &n);
        run(&r, &n, r.out, 0xff);
        compare(name, rows, &r, &n, dtype == 0 ? 1e-12 : 2e-4);
        if (rows <= 7) compare_asked(name, &r, &n);
    }
}

/* Checks all functions. Parameters are first rounded to float, so that both types compute with the same
 * numbers. */
static inline void check_all(const char *name, lg_program *program) {
    for (size_t p = 0; p < lg_program_parameters(program); p++) {
        const lg_parameter_spec spec = lg_program_parameter(program, p);
        const size_t count = lg_shape_count(spec.shape);
        double *rounded = TEST_ARRAY(double, count);
        for (size_t i = 0; i < count; i++) rounded[i] = (double)(float)spec.values[i];
        assert_ok(lg_program_set_parameter(program, p, rounded));
    }
    for (size_t f = 0; f < lg_program_functions(program); f++)
        for (size_t k = 0; k < LG_COUNT(rows_tried); k++) {
            check_function(test_text("%s, %s", name, lg_program_function_name(program, f)), program, f,
                           rows_tried[k]);
        }
}

#endif
