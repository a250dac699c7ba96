/* The maps of so(3) and se(3) as operations: values against the plain functions, with every instruction set
 * and both types; the kernels' cotangents against recorded ones; values and cotangents at extreme angles by
 * plain functions, tapes, plans and C; derivatives of higher order; wrong shapes. */
#include "compiled.h"
#include "program_support.h"
#include "support/fixtures.h"

#include "kernels/kernels.h"
#include "autodiff/ops/lie.h"
#include "golden/lie_table.h"
#include "liegrad/core.h"
#include "liegrad/geometry.h"
#include "liegrad/ops.h"

enum { ROWS = 37, NUMBERS = 9 * ROWS, LONGEST = 4 };

/* Draws rows of u with angles from 0 to beyond pi, so that every vector block has angles on both sides of the
 * limit of the series. */
static void draw_rotations(double *u) {
    lg_rng rng = test_rng(21, 0);
    for (int i = 0; i < ROWS; i++) {
        double length = 0.0;
        for (int j = 0; j < 3; j++) u[3 * i + j] = lg_rng_uniform_in(&rng, -1.0, 1.0);
        length = sqrt(lg_dot3(u + 3 * i, u + 3 * i));
        const double angle = i % 7 == 0 ? 0.0 : i % 5 == 0 ? 3.6 : i % 5 == 1 ? 1e-9 : 0.1 * (double)(i % 20);
        for (int j = 0; j < 3; j++) u[3 * i + j] *= angle / length;
    }
}

static void draw(uint64_t stream, size_t n, double *x) {
    lg_rng rng = test_rng(22, stream);
    for (size_t i = 0; i < n; i++) x[i] = lg_rng_uniform_in(&rng, -1.5, 1.5);
}

typedef struct problem {
    double in[LG_K_LIE_INPUTS][NUMBERS];
    double g[NUMBERS];
} problem;

static problem *problem_make(void) {
    problem *p = TEST_ARRAY(problem, 1);
    draw_rotations(p->in[0]);
    for (int k = 1; k < LG_K_LIE_INPUTS; k++) draw((uint64_t)k, NUMBERS, p->in[k]);
    draw(9, NUMBERS, p->g);
    return p;
}

/* A case is a map number, or MATRICES: exp(u) times a matrix. */
enum { MATRICES = LG_K_LIE_MAPS, CASES };

static uint32_t inputs_of(int map) {
    return map == LG_K_SE3_ACT || map == LG_K_SE3_DEXPINV ? 4 : 2;
}

static uint32_t width_of(int map, uint32_t input) {
    return map == MATRICES && input == 1 ? 9 : 3;
}

static uint32_t result_width(int map) {
    return width_of(map, inputs_of(map) - 1);
}

static void plain(int map, const problem *p, size_t row, double *out) {
    const double *x[LG_K_LIE_INPUTS];
    double a[6], b[6], c[6];
    for (uint32_t k = 0; k < LG_K_LIE_INPUTS; k++) x[k] = p->in[k] + width_of(map, k) * row;
    memcpy(a, x[0], 3 * sizeof *a);
    memcpy(a + 3, x[1], 3 * sizeof *a);
    memcpy(b, x[2], 3 * sizeof *b);
    memcpy(b + 3, x[3], 3 * sizeof *b);
    if (map == LG_K_SO3_EXP) lg_so3_exp_act(x[0], x[1], out);
    if (map == LG_K_SO3_DEXP) lg_so3_dexp(x[0], x[1], out);
    if (map == LG_K_SO3_DEXPINV) lg_so3_dexpinv(x[0], x[1], out);
    if (map == MATRICES) lg_so3_exp_multiply(x[0], x[1], out);
    if (map == LG_K_SE3_ACT) lg_se3_exp_act(a, b, c);
    if (map == LG_K_SE3_DEXPINV) lg_se3_dexpinv(a, b, c);
    if (inputs_of(map) == 4) memcpy(out, c + 3, 3 * sizeof *out);
}

static int kernel_of(int map) {
    return map == MATRICES ? LG_K_SO3_EXP : map;
}

/* ---- kernels ---- */

static void convert(const lg_kernels *k, const double *x, void *out) {
    k->convert_in(NUMBERS, x, out);
}

/* Computes the value, and then the cotangents of the inputs, which the kernel adds to 1. */
static void run_kernel(const lg_kernels *k, int map, const problem *p, double (*out)[NUMBERS]) {
    static double in[LG_K_LIE_INPUTS][NUMBERS], g[NUMBERS], y[LG_K_LIE_INPUTS + 1][NUMBERS];
    const void *const values[] = {in[0], in[1], in[2], in[3]};
    void *const cotangents[] = {y[1], y[2], y[3], y[4]};
    const bool add[] = {true, false, true, true};
    const size_t columns = map == MATRICES ? 3 : 1;
    for (int i = 0; i < LG_K_LIE_INPUTS; i++) convert(k, p->in[i], in[i]);
    convert(k, p->g, g);
    for (int i = 0; i <= LG_K_LIE_INPUTS; i++) k->fill(NUMBERS, 1.0, y[i]);
    k->lie[kernel_of(map)](ROWS, columns, values, y[0]);
    k->lie_reverse[kernel_of(map)](ROWS, columns, values, g, cotangents, add);
    for (int i = 0; i <= LG_K_LIE_INPUTS; i++) k->convert_out(NUMBERS, y[i], out[i]);
}

TEST("values and cotangents of the maps agree with the plain functions for all kernel tables") {
    static double found[LG_K_LIE_INPUTS + 1][NUMBERS], expected[LG_K_LIE_INPUTS + 1][NUMBERS];
    problem *p = problem_make();
    for (int map = 0; map < CASES; map++) {
        run_kernel(lg_kernels_of(LG_F64, LG_ISA_BASELINE), map, p, expected);
        for (size_t row = 0; row < ROWS; row++) {
            const size_t width = result_width(map);
            double y[9];
            plain(map, p, row, y);
            assert_all_close(expected[0] + width * row, y, width, 1e-14, 1e-13);
        }
        for (int dtype = LG_F64; dtype <= LG_F32; dtype++)
            for (int isa = LG_ISA_BASELINE; isa < LG_ISA_COUNT; isa++) {
                const lg_kernels *k = lg_kernels_of((lg_dtype)dtype, (lg_isa)isa);
                const double tolerance = dtype == LG_F64 ? 1e-13 : 2e-5;
                if (k == NULL) continue;
                run_kernel(k, map, p, found);
                for (int i = 0; i <= LG_K_LIE_INPUTS; i++)
                    assert_all_close(found[i], expected[i], NUMBERS, tolerance, tolerance);
            }
    }
}

/* ---- maps on the tape ---- */

static lg_var apply(lg_tape *tape, int map, const lg_var *x) {
    if (map == LG_K_SO3_EXP || map == MATRICES) return lg_so3_exp_rows(tape, x[0], x[1]);
    if (map == LG_K_SO3_DEXP) return lg_so3_dexp_rows(tape, x[0], x[1]);
    if (map == LG_K_SO3_DEXPINV) return lg_so3_dexpinv_rows(tape, x[0], x[1]);
    if (map == LG_K_SE3_ACT) return lg_se3_act_rows(tape, x[0], x[1], x[2], x[3]);
    return lg_se3_dexpinv_rows(tape, x[0], x[1], x[2], x[3]);
}

static const double *table_input(size_t at, int i) {
    const int map = lie_table[at].map, two = inputs_of(map) == 2 && map != LG_K_SO3_DEXP;
    const double *const in[] = {lie_table[at].u, two ? lie_table_q : lie_table_v, lie_table_q, lie_table_p};
    return in[i];
}

/* The largest error of a value and of the cotangents that follow it, in units of the allowed error. */
static double table_error(size_t at, double (*out)[3]) {
    double worst = 0.0;
    for (uint32_t i = 0; i < 3 * (inputs_of(lie_table[at].map) + 1); i++) {
        const double exact = i < 3 ? lie_table[at].y[i] : lie_table[at].slope[i - 3];
        const double allowed = i < 3 ? lie_table[at].allowed : lie_table[at].slack;
        const double error = fabs(out[i / 3][i % 3] - exact) / allowed;
        worst = error <= worst ? worst : error; /* a NaN is kept */
    }
    return worst;
}

static void table_by_kernel(const lg_kernels *k, size_t at, double (*out)[3]) {
    const int map = lie_table[at].map, inputs = (int)inputs_of(map);
    double x[LG_K_LIE_INPUTS][3], g[3], y[LG_K_LIE_INPUTS + 1][3];
    const void *const values[] = {x[0], x[1], x[2], x[3]};
    void *const cotangents[] = {y[1], y[2], inputs > 2 ? y[3] : NULL, inputs > 2 ? y[4] : NULL};
    const bool add[LG_K_LIE_INPUTS] = {false};
    for (int i = 0; i < inputs; i++) k->convert_in(3, table_input(at, i), x[i]);
    k->convert_in(3, lie_table_g, g);
    k->lie[map](1, 1, values, y[0]);
    k->lie_reverse[map](1, 1, values, g, cotangents, add);
    for (int i = 0; i <= inputs; i++) k->convert_out(3, y[i], out[i]);
}

/* The plain function, and the recorded gradient. */
static void table_by_tape(lg_tape *tape, size_t at, double (*out)[3]) {
    const int map = lie_table[at].map, inputs = (int)inputs_of(map);
    problem *p = TEST_ARRAY(problem, 1);
    lg_var x[LG_K_LIE_INPUTS], slope[LG_K_LIE_INPUTS];
    lg_tape_reset(tape);
    for (int i = 0; i < inputs; i++) {
        memcpy(p->in[i], table_input(at, i), 3 * sizeof(double));
        x[i] = lg_input_f64(tape, lg_shape2(1, 3), p->in[i]);
    }
    plain(map, p, 0, out[0]);
    lg_var g = lg_input_f64(tape, lg_shape2(1, 3), lie_table_g);
    lg_var sum = lg_sum(tape, lg_mul(tape, apply(tape, map, x), g));
    assert_ok(lg_grad(tape, sum, x, (uint32_t)inputs, slope));
    for (int i = 0; i < inputs; i++) assert_ok(lg_read(tape, slope[i], 3, out[i + 1]));
}

/* The allowed error is such that changing each number of u by one unit of rounding gives an error of 1. */
TEST("maps and cotangents agree with 120 digits at angles from 0 to 1e15: plain, recorded, and in every "
     "kernel table") {
    double out[LG_K_LIE_INPUTS + 1][3];
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(lie_table); i++) {
        for (int isa = LG_ISA_BASELINE; isa < LG_ISA_COUNT; isa++) {
            const lg_kernels *k = lg_kernels_of(lie_table[i].single ? LG_F32 : LG_F64, (lg_isa)isa);
            if (k == NULL) continue;
            table_by_kernel(k, i, out);
            if (!(table_error(i, out) <= 2.0))
                fail_msg("map %d, angle %s, table %d: %.2g times what rounding allows", lie_table[i].map,
                         lie_table[i].angle, isa, table_error(i, out));
        }
        table_by_tape(tape, i, out);
        if (!(table_error(i, out) <= 2.0))
            fail_msg("map %d, angle %s, recorded: %.2g times what rounding allows", lie_table[i].map,
                     lie_table[i].angle, table_error(i, out));
    }
}

/* ---- maps in programs: plans and C ---- */

RECORDING(record_map) {
    (void)theta;
    y[0] = apply(tape, *(const int *)user, x);
}

/* A program with the function f<map> and its adjoint adj1_f<map> for each map on vectors. */
static lg_program *program_of_maps(void) {
    static const lg_port in[LG_K_LIE_INPUTS] = {{.name = "a", .shape = {.rank = 1, .dims = {3}}},
                                                {.name = "b", .shape = {.rank = 1, .dims = {3}}},
                                                {.name = "c", .shape = {.rank = 1, .dims = {3}}},
                                                {.name = "d", .shape = {.rank = 1, .dims = {3}}}};
    static const lg_port out = {.name = "y"};
    static int number[LG_K_LIE_MAPS];
    lg_function_spec functions[LG_K_LIE_MAPS];
    char name[LG_K_LIE_MAPS][16];
    for (int map = 0; map < LG_K_LIE_MAPS; map++) {
        number[map] = map;
        (void)snprintf(name[map], sizeof name[map], "f%d", map);
        functions[map] = (lg_function_spec){name[map], in, inputs_of(map), &out, 1, record_map, &number[map]};
    }
    const lg_program_spec spec = spec_of(NULL, 0, functions, LG_K_LIE_MAPS);
    lg_program *program = test_program(&spec);
    for (int map = 0; map < LG_K_LIE_MAPS; map++) (void)derived(program, LG_DERIVATIVE_ADJOINT, name[map]);
    return program;
}

/* One way to evaluate a function of the program, for one row. */
typedef struct way {
    const char *name;
    lg_program *program;
    lg_dtype dtype;
    const compiled *c; /* NULL: plans */
    lg_plan_options options;
} way;

static void run_way(const way *w, const char *function, const void *const *in, void *const *out) {
    if (w->c != NULL) {
        shim_of(w->c, function)(in, out, TEST_ARRAY(double, w->c->source->work_size));
        return;
    }
    lg_plan *plan = NULL;
    size_t number;
    assert_ok(lg_program_find(w->program, function, &number, NULL));
    assert_ok(lg_plan_create(w->program, number, &w->options, &plan, NULL));
    void *work = lg_alloc(NULL, lg_plan_work_size(plan) + 1, 1);
    lg_plan_eval(plan, in, out, work);
    lg_free(NULL, work);
    lg_plan_destroy(plan);
}

/* The value at the inputs x, followed by the cotangents of the inputs. */
static void map_by_way(const way *w, int map, const double *const *x, double (*out)[3]) {
    const lg_kernels *k = lg_kernels_for(w->dtype);
    const size_t inputs = inputs_of(map);
    double in[LG_K_LIE_INPUTS + 1][3], y[LG_K_LIE_INPUTS + 1][3];
    const void *values[LG_K_LIE_INPUTS + 1];
    void *to[LG_K_LIE_INPUTS + 1];
    for (size_t i = 0; i <= inputs; i++) {
        k->convert_in(3, i < inputs ? x[i] : lie_table_g, in[i]);
        values[i] = in[i];
        to[i] = y[i];
    }
    run_way(w, test_text("f%d", map), values, to);
    run_way(w, test_text("adj1_f%d", map), values, to + 1);
    for (size_t i = 0; i <= inputs; i++) k->convert_out(3, y[i], out[i]);
}

/* Where |u|^2 overflows, all results must be NaN or infinite. */
static void check_overflow(const way *w) {
    static const double sizes[] = {1e155, 1e200, 1e300};
    for (int map = 0; map < LG_K_LIE_MAPS; map++)
        for (size_t i = 0; i < LG_COUNT(sizes) && w->dtype == LG_F64; i++) {
            const double u[3] = {0.48 * sizes[i], -0.64 * sizes[i], 0.6 * sizes[i]};
            const double *const x[] = {u, lie_table_v, lie_table_q, lie_table_p};
            double out[LG_K_LIE_INPUTS + 1][3];
            map_by_way(w, map, x, out);
            for (uint32_t e = 0; e < 3 * (inputs_of(map) + 1); e++)
                if (isfinite(out[e / 3][e % 3]))
                    fail_msg("%s, map %d at %g: number %u is %g", w->name, map, sizes[i], e,
                             out[e / 3][e % 3]);
        }
}

static void check_way(const way *w) {
    double out[LG_K_LIE_INPUTS + 1][3];
    for (size_t i = 0; i < LG_COUNT(lie_table); i++) {
        const double *const x[] = {table_input(i, 0), table_input(i, 1), table_input(i, 2),
                                   table_input(i, 3)};
        const size_t mark = lg_test_owned();
        if (lie_table[i].single != (w->dtype == LG_F32)) continue;
        map_by_way(w, lie_table[i].map, x, out);
        if (!(table_error(i, out) <= 2.0))
            fail_msg("%s, map %d, angle %s: %.2g times what rounding allows", w->name, lie_table[i].map,
                     lie_table[i].angle, table_error(i, out));
        lg_test_give_back(mark);
    }
    check_overflow(w);
}

TEST("plans of the maps and of their adjoints have these digits too") {
    lg_program *program = program_of_maps();
    for (int n = 0; n < 4; n++) {
        way w = {.name = n < 2 ? "plan, double" : "plan, single",
                 .program = program,
                 .dtype = n < 2 ? LG_F64 : LG_F32};
        lg_plan_options_init(&w.options);
        w.options.dtype = w.dtype;
        w.options.compact = n % 2 == 1;
        check_way(&w);
    }
}

TEST("compiled C of the maps and of their adjoints has these digits too") {
    if (!has_compiler()) skip();
    lg_program *program = program_of_maps();
    for (int n = 0; n < 4; n++) {
        compiled c;
        const way w = {.name = n < 2 ? "C, double" : "C, single",
                       .program = program,
                       .dtype = n < 2 ? LG_F64 : LG_F32,
                       .c = &c};
        if (!compile_program(&c, program, "gcc", "-O1", w.dtype, n % 2 == 1)) fail_msg("%s", c.why);
        check_way(&w);
        assert_true(discard_compiled(&c));
    }
}

TEST("the kernels' cotangents agree with the recorded ones; inputs may be views of one variable") {
    static double block[LG_K_LIE_INPUTS * NUMBERS], expected[LG_K_LIE_INPUTS * NUMBERS];
    static double found[LG_K_LIE_INPUTS * NUMBERS];
    problem *p = problem_make();
    lg_tape *tape = test_tape(LG_F64);
    for (int map = 0; map < CASES; map++) {
        const uint32_t n = inputs_of(map);
        lg_var x[LG_K_LIE_INPUTS], gradient;
        uint32_t total = 0, at = 0;
        lg_tape_reset(tape);
        for (uint32_t k = 0; k < n; k++) {
            memcpy(block + total, p->in[k], ROWS * width_of(map, k) * sizeof *block);
            total += ROWS * width_of(map, k);
        }
        lg_var all = lg_input_f64(tape, lg_shape1(total), block);
        for (uint32_t k = 0; k < n; at += ROWS * width_of(map, k), k++)
            x[k] = lg_reshape(tape, lg_slice(tape, all, 0, at, ROWS * width_of(map, k)),
                              lg_shape2(ROWS, width_of(map, k)));
        lg_var g = lg_input_f64(tape, lg_shape2(ROWS, result_width(map)), p->g);
        lg_var sum = lg_sum(tape, lg_mul(tape, apply(tape, map, x), g));
        assert_ok(lg_grad(tape, sum, &all, 1, &gradient));
        assert_ok(lg_read(tape, gradient, total, expected));
        assert_ok(lg_backward_set(tape, sum, &all, 1, (void *[]){found}));
        assert_all_close(found, expected, total, 1e-12, 1e-12);
    }
}

/* d^order/ds^order of <g, map(x + s dx)> at s = `at`, for one row. */
static double along(int map, const problem *p, double at, int order) {
    lg_tape *tape = test_tape(LG_F64);
    lg_var s = lg_input_f64(tape, lg_shape1(1), &at), x[LG_K_LIE_INPUTS];
    double value = 0.0;
    for (uint32_t k = 0; k < inputs_of(map); k++) {
        const lg_shape shape = lg_shape2(1, width_of(map, k));
        lg_var d = lg_input_f64(tape, shape, p->g + 9 * k + 9);
        x[k] = lg_add(tape, lg_input_f64(tape, shape, p->in[k] + 6 * width_of(map, k)), lg_mul(tape, d, s));
    }
    lg_var g = lg_input_f64(tape, lg_shape2(1, result_width(map)), p->g);
    lg_var y = lg_sum(tape, lg_mul(tape, apply(tape, map, x), g));
    for (int i = 0; i < order; i++) {
        lg_var one = lg_full(tape, lg_var_shape(tape, s), 1.0), next;
        if (i % 2 == 0)
            assert_ok(lg_grad(tape, y, &s, 1, &next));
        else
            assert_ok(lg_jvp(tape, &y, 1, &s, &one, 1, &next));
        y = next;
    }
    assert_ok(lg_read(tape, y, 1, &value));
    return value;
}

TEST("derivatives up to order 4 agree with differences of the next lower order") {
    problem *p = problem_make();
    for (int map = 0; map < CASES; map++)
        for (int order = 1; order <= LONGEST; order++) {
            const double h = 1e-3, exact = along(map, p, 0.2, order);
            const double near = along(map, p, 0.2 + h, order - 1) - along(map, p, 0.2 - h, order - 1);
            const double far = along(map, p, 0.2 + 2 * h, order - 1) - along(map, p, 0.2 - 2 * h, order - 1);
            assert_close((8.0 * near - far) / (12.0 * h), exact, 1e-7, 1e-7);
        }
}

TEST("shapes that do not fit are refused") {
    lg_tape *tape = test_tape(LG_F64);
    for (int wrong = 0; wrong < 5; wrong++) {
        lg_tape_reset(tape);
        const lg_var u = lg_full(tape, lg_shape2(2, 3), 0.0), other = lg_full(tape, lg_shape2(3, 3), 0.0);
        const lg_var four = lg_full(tape, lg_shape2(2, 4), 0.0), nine = lg_full(tape, lg_shape2(2, 9), 0.0);
        const lg_var y = wrong == 0   ? lg_so3_exp_rows(tape, four, u)
                         : wrong == 1 ? lg_so3_exp_rows(tape, u, other)
                         : wrong == 2 ? lg_so3_dexp_rows(tape, u, nine)
                         : wrong == 3 ? lg_so3_exp_rows(tape, lg_full(tape, lg_shape1(3), 0.0), u)
                                      : lg_se3_act_rows(tape, u, other, u, u);
        assert_true(lg_is_none(y));
        assert_status(lg_tape_status(tape), LG_SHAPE);
        assert_says(lg_tape_message(tape), "lie");
    }
}
