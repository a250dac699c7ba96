/* Training of a program by one call: sums of squares and means, several tensors, refusals. */
#include "support/fixtures.h"

#include "core/core.h"

#include "liegrad/fit.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "liegrad/series.h"

enum { ROWS = 300 };

RELEASES(release_program, lg_program_destroy)

/* y = x W + b. */
static lg_var line(lg_tape *tape, const lg_var *theta, lg_var x) {
    return lg_add(tape, lg_matmul(tape, x, theta[0]), theta[1]);
}

static lg_status value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = line(tape, theta, in[0]);
    return lg_tape_status(tape);
}

static lg_status error_of(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = lg_mul(tape, lg_sub(tape, line(tape, theta, in[0]), in[1]), in[2]);
    return lg_tape_status(tape);
}

static lg_status mean_square(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    LG_TRY(error_of(user, tape, theta, in, out));
    out[0] = lg_mean(tape, lg_square(tape, out[0]));
    return lg_tape_status(tape);
}

static lg_status two_means(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    LG_TRY(error_of(user, tape, theta, in, out));
    out[0] = lg_sum_axis(tape, lg_square(tape, out[0]), 0, false);
    return lg_tape_status(tape);
}

/* A program with two inputs and two outputs; the third input, which is shared, weights the outputs. */
static lg_program *build_line(void) {
    static const double W[4] = {0.1, 0.2, -0.1, 0.3}, b[2] = {0.0, 0.0};
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(2)},
                          {.name = "wanted", .shape = lg_shape1(2)},
                          {.name = "weight", .shape = lg_shape1(2), .shared = true}};
    const lg_port out = {.name = "y"};
    const lg_function_spec functions[] = {{"value", in, 1, &out, 1, value, NULL},
                                          {"error", in, 3, &out, 1, error_of, NULL},
                                          {"loss", in, 3, &out, 1, mean_square, NULL},
                                          {"sums", in, 3, &out, 1, two_means, NULL}};
    const lg_parameter_spec parameters[] = {{"W", lg_shape2(2, 2), W}, {"b", lg_shape1(2), b}};
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.parameters = parameters, spec.parameter_count = 2;
    spec.functions = functions, spec.function_count = 4;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

typedef struct rows {
    double x[ROWS * 2], wanted[ROWS * 2], weight[2];
    const double *data[3];
} rows;

/* Data of the line W = (1, 2; 3, -1), b = (0.5, -4), plus `bent` times a part that no line can fit. */
static rows *make_rows(double bent) {
    rows *r = TEST_ARRAY(rows, 1);
    const double *x = memcpy(r->x, test_numbers(3, 2 * ROWS, -1.0, 1.0), sizeof r->x);
    for (size_t i = 0; i < ROWS; i++) {
        r->wanted[2 * i] = x[2 * i] + 3.0 * x[2 * i + 1] + 0.5 + bent * x[2 * i] * x[2 * i];
        r->wanted[2 * i + 1] = 2.0 * x[2 * i] - x[2 * i + 1] - 4.0;
    }
    r->weight[0] = 2.0, r->weight[1] = 0.5;
    r->data[0] = r->x, r->data[1] = r->wanted, r->data[2] = r->weight;
    return r;
}

static void assert_line(const lg_program *program, double tolerance) {
    assert_all_close(lg_program_parameter(program, 0).values, ((double[]){1, 2, 3, -1}), 4, 0.0, tolerance);
    assert_all_close(lg_program_parameter(program, 1).values, ((double[]){0.5, -4}), 2, 0.0, tolerance);
}

TEST("a sum of squares and a mean give the same parameters, with several tensors and shared data") {
    const rows *r = make_rows(0.0);
    lg_program *squares = build_line(), *mean = build_line();
    lg_program_fit_result a, b;
    lg_error error;
    assert_told(lg_program_fit(NULL, squares, "error", r->data, ROWS, NULL, NULL, &a, &told));
    assert_ok(lg_program_fit(NULL, mean, "loss", r->data, ROWS, NULL, NULL, &b, &error));
    assert_line(squares, 1e-9);
    assert_line(mean, 1e-6);
    assert_close(a.before, b.before, 1e-13, 0.0);
    assert_true(a.after < 1e-20 && b.after < 1e-10 && a.before > 1.0);
    assert_true(a.epochs > 0 && a.epochs < 100 && b.epochs < 1000 && strlen(a.end) > 0 && a.seconds > 0.0);
}

TEST("the loss of a program is what training minimises, for any rows; its options are the defaults of "
     "training") {
    const rows *r = make_rows(1.0);
    lg_program *program = build_line(), *same = build_line();
    lg_program_fit_result result, again;
    lg_fit_options options;
    lg_error error;
    double loss, means, some, rest;
    assert_ok(lg_program_fit_options_init(program, "error", &options, &error));
    assert_true(options.plan.phases == 1 && options.plan.phase[0].method == LG_FIT_LM);
    assert_ok(lg_program_fit(NULL, program, "error", r->data, ROWS, NULL, NULL, &result, &error));
    assert_ok(lg_program_fit(NULL, same, "error", r->data, ROWS, &options, NULL, &again, &error));
    assert_true(result.after == again.after && result.epochs == again.epochs);
    assert_ok(lg_program_loss(NULL, program, "error", r->data, ROWS, &loss, &error));
    assert_ok(lg_program_loss(NULL, program, "loss", r->data, ROWS, &means, &error));
    assert_true(loss == result.after);
    assert_close(means, loss, 1e-14, 0.0);
    const double *const part[] = {r->x + 200, r->wanted + 200, r->weight};
    assert_ok(lg_program_loss(NULL, program, "error", r->data, 100, &some, &error));
    assert_ok(lg_program_loss(NULL, program, "error", part, ROWS - 100, &rest, &error));
    assert_close((100 * some + 200 * rest) / 300, loss, 1e-13, 0.0);
    assert_status(lg_program_loss(NULL, program, "sums", r->data, ROWS, &loss, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_program_fit_options_init(program, "lost", &options, &error), LG_NOT_FOUND);
}

TEST("every method finds the minimum over all rows of a loss that cannot become zero") {
    const rows *r = make_rows(1.0);
    lg_program *lm = build_line(), *adam = build_line();
    lg_program_fit_result a, b;
    lg_fit_options options;
    lg_fit_options_init(&options);
    options.epochs = 400;
    options.adam.lr = 0.05;
    options.schedule.kind = LG_SCHEDULE_COSINE;
    assert_ok(lg_program_fit(NULL, lm, "error", r->data, ROWS, NULL, NULL, &a, NULL));
    assert_ok(lg_program_fit(NULL, adam, "error", r->data, ROWS, &options, NULL, &b, NULL));
    assert_true(a.after > 0.1 && b.epochs == 400);
    assert_close(b.after, a.after, 1e-4, 0.0);
    for (size_t i = 0; i < 4; i++)
        assert_close(lg_program_parameter(adam, 0).values[i], lg_program_parameter(lm, 0).values[i], 0.0,
                     1e-2);
}

static lg_status first_input(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    (void)theta;
    out[0] = lg_scale(tape, in[0], 1.0);
    return lg_tape_status(tape);
}

TEST("impossible trainings are refused with a message, and the program stays unchanged") {
    rows *r = make_rows(0.0);
    lg_program *program = build_line();
    lg_program_fit_result result = {.epochs = 77};
    lg_error error;
    const double before = lg_program_parameter(program, 0).values[0];
#define REFUSED(call, status, part)                                                                          \
    do {                                                                                                     \
        assert_status(call, status);                                                                         \
        assert_says(error.message, part);                                                                    \
    } while (0)
    REFUSED(lg_program_fit(NULL, program, "lost", r->data, ROWS, NULL, NULL, &result, &error), LG_NOT_FOUND,
            "'lost'");
    REFUSED(lg_program_fit(NULL, program, "loss", r->data, 0, NULL, NULL, &result, &error),
            LG_INVALID_ARGUMENT, "rows");
    REFUSED(lg_program_fit(NULL, program, "sums", r->data, ROWS, NULL, NULL, &result, &error),
            LG_INVALID_ARGUMENT, "2 numbers that all rows share");
    r->x[7] = NAN;
    REFUSED(lg_program_fit(NULL, program, "error", r->data, ROWS, NULL, NULL, &result, &error), LG_NOT_FINITE,
            "row 3 of the input 'x'");
    r->data[1] = NULL, r->x[7] = 0.0;
    REFUSED(lg_program_fit(NULL, program, "error", r->data, ROWS, NULL, NULL, &result, &error),
            LG_INVALID_ARGUMENT, "the data of the input 'wanted' are NULL");
    REFUSED(lg_program_fit(NULL, program, "error", r->data, SIZE_MAX, NULL, NULL, &result, &error),
            LG_INVALID_ARGUMENT, "rows");
    assert_true(result.epochs == 77 && lg_program_parameter(program, 0).values[0] == before);
    /* more parameters than a training takes, and none */
    const lg_port in = {.name = "x", .shape = lg_shape1(1)}, out = {.name = "y"};
    const lg_function_spec function = {"f", &in, 1, &out, 1, first_input, NULL};
    static char name[LG_PROGRAM_FIT_MOST + 1][8];
    lg_parameter_spec parameters[LG_COUNT(name)];
    for (size_t i = 0; i < LG_COUNT(name); i++) {
        (void)snprintf(name[i], sizeof name[i], "a%zu", i);
        parameters[i] = (lg_parameter_spec){name[i], lg_shape1(1), NULL};
    }
    for (size_t count = 0; count <= LG_COUNT(name); count += LG_COUNT(name)) {
        const lg_program_spec spec = {sizeof spec, parameters, count, &function, 1, NULL};
        lg_program *other = NULL;
        lg_fit_options options;
        assert_told(lg_program_build(NULL, &spec, &other, &told));
        lg_test_owns(other, release_program);
        REFUSED(lg_program_fit_options_init(other, "f", &options, &error),
                count == 0 ? LG_INVALID_ARGUMENT : LG_UNSUPPORTED,
                count == 0 ? "no parameters" : "more than 64 parameters");
    }
}

/* ---- several starts ---- */

/* The mean over rows of x ((w^2 - 1)^2 + 0.3 w): its minimum near w = 1 is higher than the one near w =
 * -1. */
static lg_status two_wells(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var wall = lg_square(tape, lg_add_scalar(tape, lg_square(tape, theta[0]), -1.0));
    out[0] = lg_mean(tape, lg_mul(tape, in[0], lg_add(tape, wall, lg_scale(tape, theta[0], 0.3))));
    return lg_tape_status(tape);
}

typedef struct drawing {
    const double *start; /* the parameter of each start */
    double number[4];    /* the first random number of each start */
    uint32_t drawn;
} drawing;

static void draw_next(void *user, size_t parameter, size_t count, lg_rng *rng, double *values) {
    drawing *d = user;
    assert_true(parameter == 0 && count == 1);
    d->number[d->drawn] = lg_rng_uniform_in(rng, 0.0, 1.0);
    values[0] = d->start[d->drawn++];
}

static lg_program *build_wells(void) {
    const lg_port in = {.name = "x", .shape = lg_shape1(1)}, out = {.name = "loss"};
    const lg_function_spec function = {"loss", &in, 1, &out, 1, two_wells, NULL};
    const lg_parameter_spec w = {"w", lg_shape1(1), NULL};
    const lg_program_spec spec = {sizeof spec, &w, 1, &function, 1, NULL};
    lg_program *program;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

static lg_status fit_wells(lg_program *program, const double *starts, uint32_t count, drawing *d,
                           lg_program_fit_result *result, lg_error *error) {
    static const double x[2] = {0.5, 1.5};
    *d = (drawing){.start = starts};
    return lg_program_fit(NULL, program, "loss", (const double *const[]){x}, 2, NULL,
                          &(lg_fit_starts){count, draw_next, d, 5}, result, error);
}

TEST("of several starts the one with the lowest loss is kept, and starts that are not finite are skipped") {
    lg_program *program = build_wells();
    lg_program_fit_result result, again;
    lg_error error;
    drawing d, e;
    assert_ok(fit_wells(program, (const double[]){1.1, NAN, -0.8, 0.9}, 4, &d, &result, &error));
    assert_int_equal(result.start, 2);
    assert_true(result.after < -0.3 && lg_program_parameter(program, 0).values[0] < -1.0);
    assert_true(d.number[0] != d.number[1] && d.number[1] != d.number[2] && d.number[2] != d.number[3]);
    assert_ok(fit_wells(program, (const double[]){1.1, 0.9}, 2, &e, &again, &error));
    assert_true(again.after > 0.0 && lg_program_parameter(program, 0).values[0] > 0.9);
    assert_true(e.number[0] == d.number[0] && e.number[1] == d.number[1]);
}

/* k net(x) - wanted, with the parameters k (1) and theta. */
static lg_status scaled_network(void *net, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                lg_var *out) {
    const lg_var y = lg_mlp_record(tape, net, theta[1], 0, in[0]);
    out[0] = lg_sub(tape, lg_mul(tape, y, theta[0]), in[1]);
    return lg_tape_status(tape);
}

TEST("drawn networks leave the other parameters as they are") {
    const double k[1] = {3.0}, *x = test_numbers(7, 20, -1.0, 1.0);
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 1, (const uint32_t[]){4}, 1, 1, LG_TANH, true));
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(1)}, {.name = "wanted", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    const lg_function_spec function = {"miss", in, 2, &out, 1, scaled_network, &net};
    const lg_parameter_spec parameters[] = {{"k", lg_shape1(1), k},
                                            {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)), NULL}};
    const lg_program_spec spec = {sizeof spec, parameters, 2, &function, 1, NULL};
    lg_program *program;
    lg_fit_options options;
    lg_program_fit_result result;
    lg_error error;
    assert_ok(lg_program_build(NULL, &spec, &program, &error));
    lg_test_owns(program, release_program);
    lg_fit_options_init(&options);
    options.epochs = 1, options.adam.lr = 1e-9;
    assert_told(lg_program_fit(NULL, program, "miss", (const double *const[]){x, x}, 20, &options,
                               &(lg_fit_starts){2, lg_mlp_draw, &net, 1}, &result, &told));
    assert_close(lg_program_parameter(program, 0).values[0], 3.0, 1e-8, 0.0);
    assert_true(fabs(lg_program_parameter(program, 1).values[0]) > 1e-6);
}

TEST("if all starts fail or there are none, the program stays unchanged") {
    lg_program *program = build_wells();
    lg_program_fit_result result = {.epochs = 77};
    lg_error error;
    drawing d;
    const double x[1] = {1.0};
    const lg_fit_starts no_draw = {1, NULL, NULL, 0};
    assert_status(fit_wells(program, (const double[]){NAN, INFINITY}, 2, &d, &result, &error), LG_NOT_FINITE);
    assert_int_equal(d.drawn, 2);
    assert_status(fit_wells(program, NULL, 0, &d, &result, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "number of starts is 0");
    assert_status(
        lg_program_fit(NULL, program, "loss", (const double *const[]){x}, 1, NULL, &no_draw, &result, &error),
        LG_INVALID_ARGUMENT);
    assert_true(result.epochs == 77 && lg_program_parameter(program, 0).values[0] == 0.0);
}

/* ---- losses that are not means over rows ---- */

/* x (B, 1), weight (B, 1), wanted (1) shared by all rows -> e = x theta - wanted, (B, 1). */
static lg_var miss(lg_tape *tape, const lg_var *theta, const lg_var *in) {
    return lg_sub(tape, lg_mul(tape, in[0], theta[0]), in[2]);
}
#define LOSS(name, ...)                                                                                      \
    static lg_status name(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {   \
        const lg_var e = miss(tape, theta, in), square = lg_square(tape, e);                                 \
        (void)square;                                                                                        \
        out[0] = __VA_ARGS__;                                                                                \
        return lg_tape_status(tape);                                                                         \
    }
LOSS(of_mean, lg_mean(tape, square))
LOSS(of_mean_and_size, lg_add(tape, lg_mean(tape, square), lg_sum(tape, lg_square(tape, theta[0]))))
LOSS(of_rows, e)
LOSS(of_rounding, lg_add(tape, lg_mul(tape, in[0], lg_sub(tape, theta[0], in[2])),
                         lg_scale(tape, lg_mean(tape, lg_add(tape, in[1], e)), 1e-16)))
LOSS(of_sum, lg_sum(tape, square))
LOSS(of_product, lg_sum(tape, lg_mul(tape, square, theta[0])))
LOSS(of_root, lg_sqrt(tape, lg_mean(tape, square)))
LOSS(of_largest, lg_sum(tape, lg_max_axis(tape, square, 0, false)))
LOSS(of_weighted, lg_div(tape, lg_sum(tape, lg_mul(tape, square, in[1])), lg_sum(tape, in[1])))
LOSS(of_spread, lg_sub(tape, e, lg_mean(tape, e)))
LOSS(of_nothing, lg_mean(tape, lg_square(tape, lg_sub(tape, in[0], in[2]))))
LOSS(of_stopped, lg_mean(tape, lg_square(tape, lg_stop_gradient(tape, e))))
LOSS(of_sign, lg_mean(tape, lg_mul(tape, lg_sign(tape, e), in[0])))
LOSS(of_constant_rows, lg_mul(tape, in[0], in[1]))

/* Trains a parameter that starts at `theta` with `count` rows. */
static lg_status train(lg_record_function record, double theta, size_t count, double *after,
                       lg_error *error) {
    const double start[1] = {theta}, wanted[1] = {0.7};
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(1)},
                          {.name = "weight", .shape = lg_shape1(1), .low = 1.0, .high = 2.0},
                          {.name = "wanted", .shape = lg_shape1(1), .shared = true}};
    const lg_port out = {.name = "loss"};
    const lg_function_spec function = {"loss", in, 3, &out, 1, record, NULL};
    const lg_parameter_spec parameter = {"theta", lg_shape1(1), start};
    const double *const data[] = {test_numbers(5, count, 0.5, 1.5), test_numbers(6, count, 1.0, 2.0), wanted};
    lg_program_fit_result result = {.epochs = 77};
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_program_spec_init(&spec);
    spec.parameters = &parameter, spec.parameter_count = 1;
    spec.functions = &function, spec.function_count = 1;
    assert_ok(lg_program_build(NULL, &spec, &program, error));
    lg_test_owns(program, release_program);
    const lg_status status = lg_program_fit(NULL, program, "loss", data, count, NULL, NULL, &result, error);
    if (status != LG_OK)
        assert_true(result.epochs == 77 && lg_program_parameter(program, 0).values[0] == theta);
    *after = result.after;
    return status;
}

TEST("a loss must be a mean over rows for any chunks, and depend on a parameter") {
    static const struct {
        lg_record_function record;
        const char *words; /* NULL: it can be trained */
    } cases[] = {{of_mean, NULL},
                 {of_mean_and_size, NULL},
                 {of_rows, NULL},
                 {of_sum, "not a mean over rows"},
                 {of_product, "not a mean over rows"},
                 {of_root, "not a mean over rows"},
                 {of_largest, "not a mean over rows"},
                 {of_weighted, "not a mean over rows"},
                 {of_spread, "depends on other rows"},
                 {of_nothing, "depends on no parameter"},
                 {of_stopped, "depends on no parameter"},
                 {of_sign, "depends on no parameter"},
                 {of_constant_rows, "depends on no parameter"}};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        for (size_t count = 2; count < 3000; count = count * 11 + 1) {
            lg_error error = {LG_OK, ""};
            double after;
            const lg_status status = train(cases[i].record, 0.3, count, &after, &error);
            if (cases[i].words == NULL && status != LG_OK) fail_msg("case %zu: %s", i, error.message);
            if (cases[i].words == NULL) continue;
            assert_status(status, LG_INVALID_ARGUMENT);
            assert_says(error.message, cases[i].words);
            assert_says(error.message, "'loss'");
        }
}

TEST("a loss that is learned to the last digit is not judged by its rounding") {
    lg_error error = {LG_OK, ""};
    double after;
    if (train(of_rounding, 0.3, 100, &after, &error) != LG_OK) fail_msg("%s", error.message);
    assert_true(after < 1e-30);
}

TEST("the loss of all rows is the same for any chunks; a loss that is a sum and starts at zero is found "
     "at the end") {
    lg_error error = {LG_OK, ""};
    double after, again;
    assert_ok(train(of_mean, 0.3, 2000, &after, &error));
    assert_ok(train(of_rows, 0.3, 2000, &again, &error));
    assert_close(again, after, 1e-9, 0.0);
    assert_ok(train(of_sum, 0.3, 1, &after, &error));
    assert_status(train(of_product, 0.0, 100, &after, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "not a mean over rows");
}

TEST("a program is evaluated by name, for any number of rows") {
    const rows *r = make_rows(0.0);
    const lg_program *program = build_line();
    double y[2 * ROWS], x[2] = {1.0, 2.0};
    const double *const in[] = {r->x}, *const one[] = {x};
    double *const out[] = {y};
    lg_error error;
    assert_ok(lg_program_eval(NULL, program, "value", 1, one, out, NULL));
    assert_all_close(y, ((double[]){-0.1, 0.8}), 2, 1e-15, 0.0);
    assert_ok(lg_program_eval(NULL, program, "value", ROWS, in, out, NULL));
    for (size_t i = 0; i < ROWS; i++)
        assert_close(y[2 * i], 0.1 * r->x[2 * i] - 0.1 * r->x[2 * i + 1], 1e-14, 1e-16);
    assert_status(lg_program_eval(NULL, program, "values", 1, one, out, &error), LG_NOT_FOUND);
    assert_says(error.message, "'values'");
    assert_status(lg_program_eval(NULL, program, "value", 0, one, out, &error), LG_INVALID_ARGUMENT);
}

TEST("columns are scaled on a tape, and back") {
    double mean[2] = {1.0, -2.0}, scale[2] = {2.0, 0.5};
    const lg_scaler scaler = {.channels = 2, .mean = mean, .scale = scale};
    const double x[4] = {3.0, -1.0, 1.0, -2.5};
    lg_tape *tape = test_tape(LG_F64);
    const lg_var v = lg_input(tape, lg_shape2(2, 2), x), z = lg_scaler_record(tape, &scaler, v, false);
    assert_reads(tape, z, 4, ((double[]){1, 2, 0, -1}), 1e-15, 0.0);
    assert_reads(tape, lg_scaler_record(tape, &scaler, z, true), 4, x, 1e-15, 0.0);
}
