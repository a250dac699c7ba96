/* Compares programs as C with the tape: every operation that a program can have, as straight code and as
 * loops over tensors, compiled by gcc and clang, in both types.
 * ctest-labels: slow src/autodiff src/kernels */
#include <float.h>

#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/op_table.h"
#include "autodiff/program/program.h"
#include "gradcheck/cases.h"
#include "compiled.h"
#include "program_support.h"
#include "support/seed.h"

enum { POINTS = 1000, SOME = 40, MOST = 12, OUTPUTS = LG_GRADCHECK_MAX_INPUTS };

/* ---- programs of registered cases ---- */

typedef struct bundle {
    lg_program *program;
    const lg_gradcheck_case **row; /* the case of each function */
    size_t functions;
    bool gradients;
} bundle;

typedef struct recording {
    const lg_gradcheck_case *row;
    bool gradient;
} recording;

/* sum c_i (y_i + y_i^2/2), where c_i depends on i alone. No symmetry can make its gradient vanish. */
static lg_var functional(lg_tape *tape, lg_var y) {
    const lg_shape shape = lg_var_shape(tape, y);
    const size_t count = lg_shape_count(shape);
    double *c = malloc(count * sizeof *c + 1);
    for (size_t i = 0; i < count; i++) c[i] = 1.0 + 0.7 * cos(1.0 + (double)i);
    const lg_var weights = lg_input(tape, shape, c);
    free(c);
    const lg_var square = lg_scale(tape, lg_mul(tape, y, y), 0.5);
    return lg_sum(tape, lg_mul(tape, weights, lg_add(tape, y, square)));
}

/* Records the value, or the gradient of a functional by all inputs, which has the operations that
 * differentiation introduces. */
static lg_status record(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    const lg_gradcheck_function *f = &r->row->function;
    const lg_var value = f->build(f->user, tape, x);
    if (!r->gradient) {
        y[0] = value;
        return lg_tape_status(tape);
    }
    return lg_grad(tape, functional(tape, value), x, f->inputs, y);
}

static bool in_process(const lg_gradcheck_case *row) {
    for (size_t i = 0; i < LG_GRADCHECK_CASE_OPERATIONS && row->operations[i] != NULL; i++)
        if (strncmp(row->operations[i], "custom", 6) == 0) return true;
    return strstr(row->function.name, "custom") != NULL;
}

static lg_port port_of(const lg_gradcheck_function *f, uint32_t k, char *name) {
    const lg_gradcheck_argument *a = &f->arguments[k];
    (void)snprintf(name, 16, "x%u", k);
    return (lg_port){.name = name, .shape = a->shape, .shared = true, .low = a->low, .high = a->high};
}

static void add_function(bundle *b, const lg_gradcheck_case *row, size_t index) {
    const lg_gradcheck_function *f = &row->function;
    recording r = {row, b->gradients};
    lg_port in[MOST], out[OUTPUTS];
    char names[MOST][16], outputs[OUTPUTS][16];
    lg_error error;
    const char *name = test_text("f%zu", index);
    const size_t count = b->gradients ? f->inputs : 1;
    for (uint32_t k = 0; k < f->inputs; k++) in[k] = port_of(f, k, names[k]);
    for (size_t j = 0; j < count; j++) {
        (void)snprintf(outputs[j], sizeof outputs[j], "y%zu", j);
        out[j] = (lg_port){.name = outputs[j]};
    }
    const lg_function_spec spec = {name, in, f->inputs, out, count, record, &r};
    const lg_status status = lg_program_record_function(b->program, &spec, false, &error);
    if (status != LG_OK && in_process(row)) return;
    if (status != LG_OK) fail_msg("%s: %s", f->name, error.message);
    b->row[b->functions++] = row;
}

/* A program of as many cases as fit, from case *next on. */
static bundle make_bundle(bool gradients, size_t *next) {
    bundle b = {.row = TEST_ARRAY(const lg_gradcheck_case *, LG_PROGRAM_MAX_FUNCTIONS),
                .gradients = gradients};
    assert_ok(lg_program_create(NULL, &b.program));
    lg_test_owns(b.program, release_program);
    while (b.functions < LG_PROGRAM_MAX_FUNCTIONS && lg_gradcheck_operation(*next) != NULL) {
        add_function(&b, lg_gradcheck_operation(*next), *next);
        (*next)++;
    }
    assert_true(b.functions > 0);
    return b;
}

/* ---- compiling ---- */

static compiled compile(const bundle *b, const char *compiler, const char *flags, lg_dtype dtype,
                        bool compact) {
    compiled c;
    if (!compile_program(&c, b->program, compiler, flags, dtype, compact)) fail_msg("%s", c.why);
    return c;
}

static void discard(compiled *c) {
    assert_true(discard_compiled(c));
}

/* ---- comparing ---- */

/* Draws numbers near the case's given point, or anywhere in its range if it has no point; rounded to the
 * type. */
static void draw(lg_rng *rng, const lg_gradcheck_argument *a, bool single, double *x) {
    const size_t count = lg_shape_count(a->shape);
    const double low = a->low == 0 && a->high == 0 ? -1 : a->low,
                 high = a->low == 0 && a->high == 0 ? 1 : a->high;
    for (size_t i = 0; i < count; i++) {
        const double u = lg_rng_uniform(rng);
        x[i] = a->values != NULL ? a->values[i] * (1 + 0.05 * (u - 0.5)) : low + (high - low) * u;
        if (single) x[i] = (double)(float)x[i];
    }
}

static void to_type(bool single, const double *x, size_t count, void *y) {
    for (size_t i = 0; i < count; i++) {
        if (single)
            ((float *)y)[i] = (float)x[i];
        else
            ((double *)y)[i] = x[i];
    }
}

static double of_type(bool single, const void *y, size_t i) {
    return single ? (double)((const float *)y)[i] : ((const double *)y)[i];
}

static double norm(const double *a, size_t count) {
    double sum = 0;
    for (size_t i = 0; i < count; i++) sum += a[i] * a[i];
    return sqrt(sum);
}

/* How much the registered functions amplify rounding at the drawn points: sums that cancel, quotients,
 * functions of large arguments. */
static const double condition = 2;

/* Compares function `i` of the written code with the tape. Returns the largest error in units of eps *
 * depth. */
static double compare(const bundle *b, const compiled *c, size_t i, lg_tape *tape, size_t points) {
    const size_t function = c->source->function[i];
    const lg_gradcheck_function *f = &b->row[function]->function;
    const char *name = lg_program_function_name(b->program, function);
    size_t outs;
    const shim run = shim_of(c, name);
    assert_non_null(run);
    const lg_port *out = lg_program_outputs(b->program, function, &outs);
    void *in[MOST] = {NULL}, *got[OUTPUTS] = {NULL}, *work = TEST_ARRAY(double, c->source->work_size);
    double *x[MOST] = {NULL}, *want[OUTPUTS] = {NULL}, *mean = TEST_ARRAY(double, outs), worst = 0;
    for (uint32_t k = 0; k < f->inputs; k++) {
        x[k] = TEST_ARRAY(double, lg_shape_count(f->arguments[k].shape));
        in[k] = TEST_ARRAY(double, lg_shape_count(f->arguments[k].shape));
    }
    for (size_t j = 0; j < outs; j++) {
        want[j] = TEST_ARRAY(double, points *lg_shape_count(out[j].shape));
        got[j] = TEST_ARRAY(double, points *lg_shape_count(out[j].shape));
    }
    const size_t size = c->single ? sizeof(float) : sizeof(double);
    lg_rng rng = test_rng(14, i);
    for (size_t p = 0; p < points; p++) {
        lg_var in_vars[MOST], out_vars[OUTPUTS];
        void *to[OUTPUTS];
        lg_tape_reset(tape);
        for (uint32_t k = 0; k < f->inputs; k++) {
            draw(&rng, &f->arguments[k], c->single, x[k]);
            to_type(c->single, x[k], lg_shape_count(f->arguments[k].shape), in[k]);
            in_vars[k] = lg_input(tape, f->arguments[k].shape, x[k]);
        }
        assert_ok(lg_program_record(tape, b->program, function, NULL, in_vars, out_vars));
        memset(work, 0xff, c->source->work_size * sizeof(double)); /* NaN */
        for (size_t j = 0; j < outs; j++) {
            const size_t count = lg_shape_count(out[j].shape);
            memcpy(want[j] + p * count, lg_value(tape, out_vars[j]), count * sizeof(double));
            mean[j] += pow(norm(want[j] + p * count, count), 2) / (double)points;
            to[j] = (unsigned char *)got[j] + p * count * size;
        }
        run((const void *const *)in, to, work);
    }
    const double eps = c->single ? (double)FLT_EPSILON : DBL_EPSILON;
    for (size_t j = 0; j < outs; j++)
        for (size_t p = 0; p < points; p++) {
            const size_t count = lg_shape_count(out[j].shape);
            double distance = 0;
            for (size_t e = 0; e < count; e++)
                distance += pow(of_type(c->single, got[j], p * count + e) - want[j][p * count + e], 2);
            const double own = fmax(norm(want[j] + p * count, count), sqrt(mean[j]));
            const double error = sqrt(distance) / (own > 0 ? own : 1) /
                                 (eps * (double)(c->source->depth[i] > 0 ? c->source->depth[i] : 1));
            if (!(error <= 20 * condition))
                fail_msg("%s (%s), output %zu, point %zu: error %.3g eps depth", f->name, name, j, p, error);
            if (error > worst) worst = error;
        }
    return worst;
}

static void check(const bundle *b, const char *compiler, const char *flags, lg_dtype dtype, bool compact,
                  size_t points) {
    compiled c = compile(b, compiler, flags, dtype, compact);
    double worst = 0;
    const char *which = "";
    lg_tape *tape = test_tape(LG_F64);
    assert_int_equal(c.source->functions, b->functions);
    for (size_t i = 0; i < c.source->functions; i++) {
        const size_t mark = lg_test_owned();
        const double error = compare(b, &c, i, tape, points);
        lg_test_give_back(mark);
        if (error > worst) {
            worst = error;
            which = b->row[c.source->function[i]]->function.name;
        }
    }
    print_message("%s %s, %s, %s: worst %.2f eps depth (%s)\n", compiler, flags,
                  dtype == LG_F32 ? "f32" : "f64", compact ? "loops" : "straight code", worst, which);
    discard(&c);
}

static bool has(const char *compiler) {
    return system(test_text("command -v %s >/dev/null", compiler)) == 0;
}

static void check_all(bool gradients) {
    static const struct {
        const char *compiler;
        lg_dtype dtype;
        bool compact;
        size_t points;
    } ways[] = {{"gcc", LG_F64, false, POINTS},
                {"clang", LG_F32, false, SOME},
                {"clang", LG_F64, true, SOME},
                {"gcc", LG_F32, true, SOME}};
    uint64_t part = commit_seed() + gradients;
    for (size_t next = 0; lg_gradcheck_operation(next) != NULL;) {
        bundle b = make_bundle(gradients, &next);
        for (size_t i = part++ % 2; i < sizeof ways / sizeof *ways; i += 2)
            if (has(ways[i].compiler))
                check(&b, ways[i].compiler, "-O2", ways[i].dtype, ways[i].compact, ways[i].points);
    }
}

TEST("values in C agree with the tape, for every compiler, type and form in turn") {
    check_all(false);
}

TEST("gradients in C agree with the tape, for every compiler, type and form in turn") {
    check_all(true);
}

/* The code of a single function must contain exactly what it needs, so that gcc and g++ give no warning. */
static void check_alone(const bundle *b, bool compact, const char *compiler) {
    char folder[] = "/tmp/liegrad-program-c-XXXXXX", command[1024];
    assert_non_null(mkdtemp(folder));
    compiled c = {.single = false};
    (void)snprintf(c.folder, sizeof c.folder, "%s", folder);
    for (size_t i = 0; i < b->functions; i++) {
        lg_c_options options;
        lg_c_source *source;
        lg_c_options_init(&options);
        options.name = "p";
        options.compact = compact;
        options.functions = &i;
        options.function_count = 1;
        options.mark_unfit = i % 2 == 0;
        assert_told(lg_program_write_c(b->program, &options, &source, &told));
        assert_true(write_file(
            &c, test_text("p%zu.c", i),
            (const char *const[]){source->sizes, source->declarations, source->arrays, source->code}, 4));
        lg_c_source_destroy(source);
    }
    (void)snprintf(command, sizeof command, "cd %s && %s " WARNINGS " -O0 -c p*.c 2>&1", folder, compiler);
    if (system(command) != 0) fail_msg("%s", command);
    (void)snprintf(command, sizeof command, "rm -rf -- '%s'", folder);
    assert_int_equal(system(command), 0);
}

TEST("every function compiles alone, as C or as C++") {
    uint64_t part = commit_seed();
    for (size_t next = 0; lg_gradcheck_operation(next) != NULL; part++) {
        bundle b = make_bundle(false, &next);
        if (part % 2 == 0 && has("gcc"))
            check_alone(&b, false, "gcc -std=c99 -Wstrict-prototypes -Wmissing-prototypes");
        if (part % 2 == 1 && has("g++")) check_alone(&b, true, "g++ -x c++ -std=c++14");
    }
}

/* ---- functions of a rotation angle, all orders ---- */

enum { ANGLES = 4000, TOP = 8 };

typedef struct family {
    const lg_op *op;
    uint32_t columns, order;
} family;

static lg_status record_family(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const family *f = user;
    const lg_attr attr = {.i = {f->columns - 1, f->order, 0, 0}};
    y[0] = lg_record(tape, f->op, x, 1, &attr);
    return lg_tape_status(tape);
}

/* Squares of angles: small, on both sides of the limits of the series, near the zeros and the pole, large,
 * negative, and squares of extreme angles. */
static double angle(lg_rng *rng, size_t i) {
    static const double centres[] = {0.0, 1.0, 4.0, 9.8696044010893586, 16.0, 39.478417604357434, 45.0};
    static const double extreme[] = {
        0.0,   1e-320,      1e-18, 1e-8, 10.89, 12.25, 13.69, 15.9999, 16.0001,
        16.81, 39.47841759, 1e4,   1e8,  1e16,  1e20,  1e26,  1e30,
    };
    const size_t kind = i % 10;
    if (kind == 9) return extreme[i / 10 % LG_COUNT(extreme)];
    if (kind < 7) return centres[kind] + pow(10, lg_rng_uniform_in(rng, -12, 0)) * (i % 2 == 0 ? 1 : -1);
    return kind == 7 ? lg_rng_uniform_in(rng, -60, 300) : lg_rng_uniform_in(rng, -1, 1);
}

/* Error relative to the kernels' number; near a zero, relative to the largest c_k of the angle. */
static double family_error(const family *f, const double *w, const double *got) {
    double worst = 0;
    for (size_t i = 0; i < ANGLES; i++) {
        double want[TOP + 1], most = 0;
        if (f->op == &lg_op_stumpff)
            lg_kernels_for(LG_F64)->stumpff(1, TOP, (int)f->order, &w[i], want);
        else
            lg_kernels_for(LG_F64)->dexpinv_coef(1, (int)f->order, &w[i], want);
        for (size_t k = 0; k < f->columns; k++) most = fmax(most, fabs(want[k]));
        for (size_t k = 0; k < f->columns; k++) {
            const double error = fabs(got[i * f->columns + k] - want[k]) / fmax(fabs(want[k]), 1e-2 * most);
            if (!(error <= worst)) worst = error;
        }
    }
    return worst;
}

TEST("functions of the angle agree in C with the kernels for all orders") {
    static double w[ANGLES], got[ANGLES * (TOP + 1)];
    family families[2 * (TOP + 1)];
    bundle b = {.functions = 0};
    lg_rng rng = test_rng(5, 5);
    for (size_t i = 0; i < ANGLES; i++) w[i] = angle(&rng, i);
    assert_ok(lg_program_create(NULL, &b.program));
    lg_test_owns(b.program, release_program);
    for (uint32_t i = 0; i < 2 * (TOP + 1); i++) {
        families[i] =
            (family){i % 2 == 0 ? &lg_op_stumpff : &lg_op_dexpinv_coef, i % 2 == 0 ? TOP + 1 : 1, i / 2};
        const lg_port in = {.name = "w", .shape = lg_shape2(ANGLES, 1), .shared = true}, out = {.name = "c"};
        const lg_function_spec spec = {test_text("f%u", i), &in, 1, &out, 1, record_family, &families[i]};
        assert_told(lg_program_record_function(b.program, &spec, false, &told));
    }
    compiled c = compile(&b, has("gcc") ? "gcc" : "clang", "-O2", LG_F64, false);
    double *work = TEST_ARRAY(double, c.source->work_size);
    for (size_t i = 0; i < c.source->functions; i++) {
        const shim run = shim_of(&c, test_text("f%zu", i));
        run((const void *[]){w}, (void *[]){got}, work);
        const double error = family_error(&families[i], w, got);
        print_message("%s order %u: %.1e\n", families[i].op->name, families[i].order, error);
        assert_close(error, 0, 0, 1e-13);
    }
    discard(&c);
}

/* ---- outputs that a call does not use ---- */

RECORDING(record_constants) {
    const uint32_t rows = lg_var_shape(tape, x[0]).dims[0];
    double row[24];
    for (size_t i = 0; i < 24; i++) row[i] = (double)i;
    const lg_var one = lg_input(tape, lg_shape2(1, 24), row);
    y[0] = lg_broadcast_to(tape, one, lg_shape2(rows, 24));
    y[1] = lg_slice(tape, y[0], 1, 0, 20);
}

RECORDING(record_calls) {
    lg_var now = x[0];
    for (size_t i = 0; i < 3; i++) now = lg_slice(tape, lg_program_call(tape, "f", i % 2, &now), 1, 3, 3);
    y[0] = now;
}

RECORDING(record_still) {
    const double row[9] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
    const lg_var one = lg_input(tape, lg_shape2(1, 9), row);
    y[0] = lg_broadcast_to(tape, one, lg_shape2(lg_var_shape(tape, x[0]).dims[0], 9));
}

RECORDING(record_joined) {
    const lg_var still = lg_program_call(tape, "still", 0, x), both[2] = {still, still};
    const lg_var joined = lg_concat(tape, both, 2, 1);
    y[0] = lg_program_call(tape, "still", 0, &joined);
}

TEST("calls whose outputs are constants, or of which only one output is used, compile without a warning") {
    const lg_port in = {.name = "x", .shape = {1, {3}}}, out[] = {{.name = "y"}, {.name = "z"}};
    const lg_port wide = {.name = "x", .shape = {1, {18}}};
    const lg_function_spec functions[] = {{"f", &in, 1, out, 2, record_constants, NULL},
                                          {"g", &in, 1, out, 1, record_calls, NULL},
                                          {"still", &wide, 1, out, 1, record_still, NULL},
                                          {"joined", &wide, 1, out, 1, record_joined, NULL}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, LG_COUNT(functions));
    const bundle b = {.program = test_program(&spec)};
    for (int single = 0; single < 2; single++) {
        compiled c = compile(&b, has("gcc") ? "gcc" : "clang", "-O2", single ? LG_F32 : LG_F64, true);
        discard(&c);
    }
}
