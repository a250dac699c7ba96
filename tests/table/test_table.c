/* Table networks: Jacobians, scaling, the evidence, and the recording compared with the plan. */
#include "support/models.h"
#include "test_support.h"

#include "liegrad/model.h"
#include "liegrad/table.h"
#include "core/core.h"
#include "table/internal.h"
#include "support/fixtures.h"

static void samples_destroy(lg_table_samples *samples) {
    lg_free(NULL, samples->x);
    lg_free(NULL, samples->y);
}
OWNED(lg_table_samples, samples_destroy)

enum { ROWS = 40 };

typedef struct example {
    lg_table_options options;
    uint32_t inputs, outputs;
} example;

#define NETWORK(kind, activation_, layers, width, linear_)                                                   \
    {                                                                                                        \
        .network = LG_NET_##kind, .activation = LG_##activation_, .hidden_count = layers,                    \
        .hidden = {width, width, width}, .linear = linear_                                                   \
    }
static const example examples[] = {
    {NETWORK(MLP, TANH, 1, 5, true), 3, 1},         {NETWORK(MLP, SWISH, 3, 4, false), 2, 3},
    {NETWORK(RESNET, SIGMOID, 3, 4, true), 4, 2},   {NETWORK(MULT, TANH, 2, 5, false), 3, 2},
    {NETWORK(MULT_AFFINE, SINE, 2, 3, true), 2, 1},
};

static lg_table make(const example *e) {
    lg_table model;
    assert_ok(lg_table_init(&model, &e->options, e->inputs, e->outputs, NULL));
    return model;
}

/* y = sin of the sum, and a product of the inputs, with noise; x and y have size 1. */
static lg_table_samples *draw(const lg_table *model, size_t rows, double noise, lg_rng *rng) {
    const uint32_t n = model->net.inputs, m = model->net.outputs;
    lg_table_samples made = {.count = rows, .training = rows};
    made.x = lg_test_gives(rows * n, sizeof *made.x);
    made.y = lg_test_gives(rows * m, sizeof *made.y);
    assert_true(made.x != NULL && made.y != NULL);
    for (size_t i = 0; i < rows; i++) {
        double sum = 0;
        for (uint32_t c = 0; c < n; c++) sum += made.x[i * n + c] = lg_rng_normal(rng);
        for (uint32_t o = 0; o < m; o++)
            made.y[i * m + o] =
                sin(sum + o) + 0.3 * made.x[i * n] * made.x[i * n + n - 1] + noise * lg_rng_normal(rng);
    }
    return own_lg_table_samples(made);
}

static double *parameters(const lg_table *model, lg_rng *rng) {
    const size_t n = lg_table_parameters(model);
    double *theta = TEST_ARRAY(double, n);
    lg_table_initialise(model, rng, theta);
    for (size_t i = 0; i < n; i++) theta[i] += 0.1 * lg_rng_normal(rng);
    return theta;
}

/* Compared with forward sweeps over the recorded residuals, which share no code with the Jacobian. */
TEST("the Jacobian of the residuals agrees with forward sweeps, for every network") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        const lg_table model = make(&examples[e]);
        const size_t n = lg_table_parameters(&model), m = ROWS * (size_t)model.net.outputs;
        lg_rng rng = test_rng(5, e);
        lg_table_samples *samples = draw(&model, ROWS, 0.1, &rng);
        const double *theta = parameters(&model, &rng);
        const lg_table_problem problem = {&model, samples, NULL};
        lg_fit_problem fit;
        uint32_t chosen[ROWS];
        double *r = TEST_ARRAY(double, m), *J = TEST_ARRAY(double, m *n), *again = TEST_ARRAY(double, m),
               loss;
        lg_tape *tape = test_tape(LG_F64);
        for (uint32_t i = 0; i < ROWS; i++) chosen[i] = (7 * i + 3) % ROWS;
        lg_table_fit_problem(&problem, &fit);
        assert_ok(fit.linearise(fit.user, tape, theta, chosen, ROWS, 2 * ROWS, &loss, r, J));
        lg_tape_reset(tape);
        lg_var given = lg_input_f64(tape, lg_shape1((uint32_t)n), theta), recorded = LG_NONE, total = LG_NONE;
        assert_ok(fit.residuals(fit.user, tape, given, chosen, ROWS, 2 * ROWS, &recorded));
        assert_ok(fit.loss(fit.user, tape, given, chosen, ROWS, 2 * ROWS, &total));
        assert_ok(lg_read(tape, recorded, m, again));
        assert_all_close(r, again, m, 1e-13, 1e-15);
        assert_close(*(const double *)lg_value(tape, total), loss, 1e-13, 0);
        for (size_t j = 0; j < n; j++) {
            double *unit = TEST_ARRAY(double, n);
            lg_var column = LG_NONE;
            unit[j] = 1;
            const lg_var direction = lg_input_f64(tape, lg_shape1((uint32_t)n), unit);
            assert_ok(lg_jvp(tape, &recorded, 1, &given, &direction, 1, &column));
            assert_ok(lg_read(tape, column, m, again));
            for (size_t i = 0; i < m; i++) assert_close(J[i * n + j], again[i], 1e-11, 1e-14);
        }
    }
}

static lg_scaler some_scaler(uint32_t columns, lg_rng *rng, double size) {
    lg_scaler made = {
        .channels = columns, .mean = TEST_ARRAY(double, columns), .scale = TEST_ARRAY(double, columns)};
    for (uint32_t c = 0; c < columns; c++) {
        made.mean[c] = size * lg_rng_normal(rng);
        made.scale[c] = size * (0.5 + lg_rng_uniform(rng));
    }
    return made;
}

TEST("a model scales its inputs and outputs") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        const lg_table model = make(&examples[e]);
        const uint32_t n = model.net.inputs, m = model.net.outputs;
        lg_rng rng = test_rng(6, e);
        const double *theta = parameters(&model, &rng);
        const lg_scaler in = some_scaler(n, &rng, 1e-6), out = some_scaler(m, &rng, 1e4);
        lg_model *handle = NULL;
        assert_ok(test_table_model(NULL, &model, &in, &out, theta, &handle, NULL));
        void *work = test_work(lg_model_work_size(handle));
        double x[8], z[8], y[4], f[4];
        for (uint32_t c = 0; c < n; c++) x[c] = in.mean[c] + in.scale[c] * (z[c] = lg_rng_normal(&rng));
        lg_model_eval(handle, x, y, work);
        lg_tape *tape = test_tape(LG_F64);
        const lg_var flat = lg_input_f64(tape, lg_shape1((uint32_t)lg_table_parameters(&model)), theta);
        const lg_var row = lg_input_f64(tape, lg_shape2(1, n), z);
        assert_ok(lg_read(tape, lg_table_record(tape, &model, flat, row, NULL), m, f));
        for (uint32_t o = 0; o < m; o++) assert_close(y[o], out.mean[o] + out.scale[o] * f[o], 1e-12, 0);
        lg_model_destroy(handle);
    }
}

typedef struct column {
    const char *what;
    double (*cell)(lg_rng *rng, size_t row);
    size_t far; /* number of cells that are far */
} column;

enum { CELLS = 1000, MARKED = 17 };

static double normal_cell(lg_rng *rng, size_t row) {
    return 3.0 + lg_rng_normal(rng);
}
static double skew_cell(lg_rng *rng, size_t row) {
    return exp(lg_rng_normal(rng));
}
static double rare_cell(lg_rng *rng, size_t row) {
    return row == MARKED;
}
static double constant_cell(lg_rng *rng, size_t row) {
    return 2.5;
}
static double pair_cell(lg_rng *rng, size_t row) {
    return row % 2 == 0 ? 1e-3 : 1.0;
}
static double one_far_cell(lg_rng *rng, size_t row) {
    return row == MARKED ? 1000.0 : lg_rng_normal(rng);
}
static double hidden_cell(lg_rng *rng, size_t row) { /* far, but with less than half of the sum of squares */
    return row == MARKED ? 25.0 : 0.3 * lg_rng_normal(rng);
}
static double codes_cell(lg_rng *rng, size_t row) {
    return row % 10 == MARKED % 10 ? -9999.0 - (row == MARKED) : lg_rng_normal(rng);
}

static double heavy_cell(lg_rng *rng,
                         size_t row) { /* Cauchy: the farthest cells, not the 2 % beyond the limit */
    return tan(3.14159265358979 * (lg_rng_uniform(rng) - 0.5));
}
/* A quiet sensor that an event moves in a part of the rows, to one place or in all directions. */
#define MODE(name, part, low, moved)                                                                         \
    static double name(lg_rng *rng, size_t row) {                                                            \
        const double n = lg_rng_normal(rng);                                                                 \
        return row % 1000 < (part)*1000 ? (moved) : (low) + 3e-4 * n;                                        \
    }
MODE(half_cell, 0.5, 0.03, 1.0 + 1e-2 * n)
MODE(event_cell, 0.3, 0.03, 0.5 * n)
MODE(tenth_cell, 0.1, 0.03, 1.0 + 1e-2 * n)
MODE(rare_event_cell, 0.03, 0.03, 0.5 * n)
MODE(rare_mode_cell, 0.02, 0.03, 1.0 + 1e-2 * n)
MODE(percent_cell, 0.01, 0.03, 1.0 + 1e-2 * n)
MODE(level_cell, 0.3, 0.03, 1.0)
static double inflated_cell(lg_rng *rng, size_t row) {
    return row % 10 != 0 ? 0.0 : exp(1.5 * lg_rng_normal(rng));
}
static double one_hot_cell(lg_rng *rng, size_t row) {
    return row % 33 == 0;
}
static double whole_cell(lg_rng *rng, size_t row) {
    return (double)(row % 7 * (row % 7));
}
static double few_codes_cell(lg_rng *rng, size_t row) {
    return row % 250 == MARKED ? -9999.0 - (row == MARKED) : lg_rng_normal(rng);
}

static const column columns[] = {{"normal", normal_cell, 0},
                                 {"lognormal", skew_cell, 0},
                                 {"one 1 among zeros", rare_cell, 0},
                                 {"constant", constant_cell, 0},
                                 {"two values", pair_cell, 0},
                                 {"one far", one_far_cell, 1},
                                 {"one that is seven deviations of all", hidden_cell, 1},
                                 {"codes of missing cells", codes_cell, 100},
                                 {"four codes", few_codes_cell, 4},
                                 {"two modes", half_cell, 0},
                                 {"30 % moved", event_cell, 0},
                                 {"10 % at another place", tenth_cell, 0},
                                 {"3 % moved", rare_event_cell, 0},
                                 {"2 % at another place", rare_mode_cell, 0},
                                 {"1 % at another place", percent_cell, 0},
                                 {"30 % at one value", level_cell, 0},
                                 {"90 % zeros", inflated_cell, 0},
                                 {"one in 33", one_hot_cell, 0},
                                 {"squares", whole_cell, 0}};

TEST("cells far from all others are found in any units, and merely unusual columns have none") {
    static const double units[] = {1.0, -1.0, 1e-9, 1e9, 1e-300, 1e300};
    double *x = TEST_ARRAY(double, 2 * CELLS);
    for (size_t c = 0; c < LG_COUNT(columns); c++)
        for (size_t u = 0; u < LG_COUNT(units); u++) {
            lg_table_far far;
            lg_rng rng = test_rng(11, c);
            for (size_t i = 0; i < CELLS; i++)
                x[2 * i] = units[u] * columns[c].cell(&rng, i), x[2 * i + 1] = NAN;
            assert_ok(lg_table_find_far(NULL, x, 2, CELLS, &far));
            if (far.count != columns[c].far)
                fail_msg("%s in units of %g: %zu far cells", columns[c].what, units[u], far.count);
            for (size_t i = 0, n = 0; i < CELLS; i++) {
                n += lg_table_is_far(&far, x[2 * i]);
                if (i + 1 == CELLS) assert_int_equal(n, far.count);
            }
            if (far.count > 0) assert_int_equal(far.farthest, MARKED);
        }
}

TEST("of heavy tails only few cells are far, and scaling without them keeps the others apart") {
    double x[CELLS];
    lg_table_far far;
    for (uint64_t seed = 0; seed < 9; seed++) {
        lg_rng rng = test_rng(13, seed);
        for (size_t i = 0; i < CELLS; i++) x[i] = heavy_cell(&rng, i);
        assert_ok(lg_table_find_far(NULL, x, 1, CELLS, &far));
        assert_true(far.count <= 5 && !far.single);
    }
}

TEST("the median used for far cells agrees with a sorted column, and the largest numbers do not overflow") {
    double x[] = {1.7e308, -1.7e308, 1.0, 2.0, 4.0, 3.0, 5.0, 0.0, 6.0};
    lg_table_far far;
    for (size_t rows = 1; rows <= LG_COUNT(x); rows++) {
        double sorted[LG_COUNT(x)];
        memcpy(sorted, x, sizeof x);
        for (size_t i = 0; i < rows; i++)
            for (size_t k = i + 1; k < rows; k++)
                if (sorted[k] < sorted[i]) {
                    const double kept = sorted[i];
                    sorted[i] = sorted[k], sorted[k] = kept;
                }
        assert_ok(lg_table_find_far(NULL, x, 1, rows, &far));
        assert_close(far.median, sorted[rows / 2], 0, 0);
    }
    assert_int_equal(far.count, 2);
    assert_ok(lg_table_find_far(NULL, x, 1, 2, &far));
    assert_int_equal(far.count, 0);
    static const double apart[] = {-1e308, -1.0001e308, -0.9999e308, -1.00005e308, 1.7e308};
    assert_ok(lg_table_find_far(NULL, apart, 1, LG_COUNT(apart), &far));
    assert_int_equal(far.count, 1);
    assert_int_equal(far.farthest, 4);
    assert_status(lg_table_find_far(NULL, x, 1, 0, &far), LG_INVALID_ARGUMENT);
    assert_status(lg_table_find_far(NULL, x, 0, 1, &far), LG_INVALID_ARGUMENT);
    EVERY_ALLOCATION_FAILS(context, 1, status = lg_table_find_far(context, x, 1, LG_COUNT(x), &far););
}

TEST("the work of a model grows linearly with its inputs, not quadratically") {
    enum { INPUTS = 4000 };
    lg_rng rng = test_rng(12, 0);
    const example wide = {NETWORK(MLP, TANH, 1, 2, true), INPUTS, 1};
    const lg_table model = make(&wide);
    const lg_scaler in = some_scaler(INPUTS, &rng, 1.0), out = some_scaler(1, &rng, 1.0);
    lg_model *handle = NULL;
    assert_ok(test_table_model(NULL, &model, &in, &out, parameters(&model, &rng), &handle, NULL));
    assert_true(lg_model_work_size(handle) < (size_t)100 * INPUTS * sizeof(double));
    lg_model_destroy(handle);
}

TEST("a column is scaled by its deviation unless its numbers are equal up to rounding, at any offset") {
    enum { N = 1000 };
    static const double spreads[] = {1.0, 1e-5, 1e-9, 1e-12, 1e-13}, offsets[] = {0, 1, -3e5, 1e8, 1e300};
    double x[N];
    for (size_t k = 0; k < LG_COUNT(spreads) * LG_COUNT(offsets); k++) {
        const double offset = offsets[k / LG_COUNT(spreads)],
                     spread = spreads[k % LG_COUNT(spreads)] * (offset == 0 ? 1.0 : fabs(offset));
        lg_scaler s;
        for (size_t i = 0; i < N; i++) x[i] = offset + spread * (i % 2 == 0 ? 1.0 : -1.0);
        assert_ok(lg_table_scaler_fit(NULL, x, 1, NULL, N, &s));
        assert_close(s.mean[0], offset, 1e-15, 1e-16 * spread);
        assert_close(s.scale[0], spread, 1e-2, 0);
        lg_scaler_destroy(&s);
        for (size_t i = 0; i < N; i++) x[i] = i % 2 == 0 ? offset : nextafter(offset, INFINITY);
        assert_ok(lg_table_scaler_fit(NULL, x, 1, NULL, N, &s));
        assert_close(s.scale[0], 1.0, 0, 0);
        lg_scaler_destroy(&s);
    }
}

TEST("a scaler is fit in two passes, so that offsets, constants and large numbers are harmless") {
    enum { N = 5, COLUMNS = 7 };
    double values[N * COLUMNS];
    static const uint32_t chosen[] = {4, 0, 2};
    lg_scaler s;
    for (size_t i = 0; i < N; i++) {
        const double t = (double)i;
        const double row[COLUMNS] = {t, 1e9 + t, 0.1, 1e300 * (t - 2), 1e-300 * t, 0, 1e-310 * t};
        memcpy(values + i * COLUMNS, row, sizeof row);
    }
    assert_ok(lg_table_scaler_fit(NULL, values, COLUMNS, NULL, N, &s));
    const double deviation = sqrt(2);
    const double mean[] = {2, 1e9 + 2, 0.1, 0, 2e-300, 0, 2e-310},
                 scale[] = {1, 1, 1 / deviation, 1e300, 1e-300, 1 / deviation, 1 / deviation};
    for (size_t c = 0; c < COLUMNS; c++) {
        assert_close(s.mean[c], mean[c], 1e-14, 1e-20);
        assert_close(s.scale[c], deviation * scale[c], 1e-7, 0);
    }
    lg_scaler_destroy(&s);
    assert_ok(lg_table_scaler_fit(NULL, values, COLUMNS, chosen, 3, &s));
    assert_close(s.mean[0], 2, 1e-15, 0);
    assert_close(s.scale[0], sqrt(8.0 / 3), 1e-14, 0);
    lg_scaler_destroy(&s);
    values[3] = NAN;
    assert_status(lg_table_scaler_fit(NULL, values, COLUMNS, NULL, N, &s), LG_NOT_FINITE);
    assert_status(lg_table_scaler_fit(NULL, values, COLUMNS, NULL, 0, &s), LG_INVALID_ARGUMENT);
}

/* ---- the evidence of a network ---- */

typedef struct found {
    double decay[LG_TABLE_SLICES], *theta;
    lg_table_evidence_result result;
} found;

static found evidence_of(const lg_table *model, const lg_table_samples *samples, uint64_t seed) {
    found f = {.theta = TEST_ARRAY(double, lg_table_parameters(model))};
    lg_rng rng = test_rng(seed, 9);
    lg_table_initialise(model, &rng, f.theta);
    const lg_table_problem problem = {model, samples, NULL};
    assert_ok(lg_table_evidence(NULL, &problem, NULL, f.theta, f.decay, &f.result, NULL));
    return f;
}

static double error_on(const lg_table *model, const double *theta, const lg_table_samples *samples) {
    const size_t m = samples->count * model->net.outputs;
    lg_tape *tape = test_tape(LG_F64);
    double *f = TEST_ARRAY(double, m), sum = 0;
    const lg_var z = lg_input_f64(tape, lg_shape2((uint32_t)samples->count, model->net.inputs), samples->x);
    const lg_var flat = lg_input_f64(tape, lg_shape1((uint32_t)lg_table_parameters(model)), theta);
    assert_ok(lg_read(tape, lg_table_record(tape, model, flat, z, NULL), m, f));
    for (size_t i = 0; i < m; i++) sum += pow(f[i] - samples->y[i], 2) / (double)m;
    return sqrt(sum);
}

TEST("the evidence finds the noise of the data, and a network that generalises") {
    static const double noises[] = {0.5, 0.1, 0.01};
    const example e = {NETWORK(MLP, TANH, 1, 16, true), 2, 1};
    const lg_table model = make(&e);
    for (size_t i = 0; i < LG_COUNT(noises); i++) {
        lg_rng rng = test_rng(31, i);
        const lg_table_samples *samples = draw(&model, 300, noises[i], &rng),
                               *clear = draw(&model, 400, 0, &rng);
        const found f = evidence_of(&model, samples, 4);
        const double error = error_on(&model, f.theta, clear);
        print_message("noise %.3g: found %.3g, %.1f effective of %zu, error %.3g\n", noises[i],
                      f.result.noise, f.result.effective, lg_table_parameters(&model), error);
        assert_close(f.result.noise, noises[i], 0.25, 0);
        const double rows = (double)samples->count,
                     squares = rows * pow(error_on(&model, f.theta, samples), 2);
        assert_close(pow(f.result.noise, 2) * (rows - f.result.effective), squares, 1e-9, 0);
        assert_true(f.result.effective > 5 && f.result.effective < (double)lg_table_parameters(&model));
        assert_true(error < 0.5 * noises[i] + 0.02);
    }
}

TEST("a network that is too narrow for the data has less evidence than one that fits") {
    double evidence[2];
    static const uint32_t widths[] = {1, 6};
    for (size_t i = 0; i < LG_COUNT(widths); i++) {
        const example e = {NETWORK(MLP, TANH, 1, widths[i], true), 2, 1};
        const lg_table model = make(&e);
        lg_rng rng = test_rng(32, 0);
        const lg_table_samples *samples = draw(&model, 150, 0.05, &rng);
        evidence[i] = evidence_of(&model, samples, 4).result.evidence;
        print_message("width %u: log evidence %.1f\n", widths[i], evidence[i]);
    }
    assert_true(evidence[1] > evidence[0] + 20);
}

static double with_penalty(double loss, const double *decay, const double *theta, size_t n) {
    for (size_t i = 0; i < n; i++) loss += 0.5 * decay[i] * theta[i] * theta[i];
    return loss;
}

/* At the end the gradient of loss and penalty, with the returned decay, is small, so lg_fit has nothing to
 * improve. */
TEST("parameters and decay of the evidence are a minimum of the loss of lg_fit") {
    const example e = {NETWORK(MLP, TANH, 1, 6, true), 2, 2};
    const lg_table model = make(&e);
    const size_t n = lg_table_parameters(&model);
    lg_slice_info info;
    lg_rng rng = test_rng(33, 0);
    const lg_table_samples *samples = draw(&model, 60, 0.5, &rng);
    const found f = evidence_of(&model, samples, 4);
    double *decay = TEST_ARRAY(double, n), *end = TEST_ARRAY(double, n), *far = TEST_ARRAY(double, n);
    for (uint32_t s = 0; lg_table_slice(&model, s, &info); s++)
        for (size_t i = 0; i < info.count; i++) decay[info.offset + i] = f.decay[s];
    const lg_table_problem problem = {&model, samples, decay};
    lg_fit_problem learned;
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_fit_options_init(&options);
    options.plan.phases = 1;
    lg_table_fit_problem(&problem, &learned);
    for (int method = LG_FIT_SSBROYDEN; lg_fit_method_name((lg_fit_method)method) != NULL; method++) {
        if (lg_fit_method_batches((lg_fit_method)method)) continue;
        options.plan.phase[0].method = (uint32_t)method;
        assert_ok(lg_fit_create(NULL, &learned, &options, f.theta, &fit, NULL));
        assert_ok(lg_fit_run(fit, NULL));
        lg_fit_parameters(fit, end);
        const double before = lg_fit_history(fit, LG_FIT_LOSS)[0], after = lg_fit_loss(fit);
        lg_fit_destroy(fit);
        assert_close(after, before, 3e-3, 0);
        /* From a distant start, loss and penalty together become equally small. */
        for (size_t i = 0; i < n; i++) far[i] = 1.5 * f.theta[i];
        assert_ok(lg_fit_create(NULL, &learned, &options, far, &fit, NULL));
        assert_ok(lg_fit_run(fit, NULL));
        lg_fit_parameters(fit, end);
        const double whole = with_penalty(lg_fit_loss(fit), decay, end, n);
        print_message("method %d: loss with its penalty %.6g, that of the evidence %.6g\n", method, whole,
                      with_penalty(before, decay, f.theta, n));
        lg_fit_destroy(fit);
        assert_true(whole < 1.005 * with_penalty(before, decay, f.theta, n));
    }
    /* Without the decay the same start is not a minimum. */
    learned.decay = NULL;
    assert_ok(lg_fit_create(NULL, &learned, &options, f.theta, &fit, NULL));
    assert_ok(lg_fit_run(fit, NULL));
    print_message("loss %.4g with the decay, %.4g without\n", lg_fit_history(fit, LG_FIT_LOSS)[0],
                  lg_fit_loss(fit));
    assert_true(lg_fit_loss(fit) < 0.9 * lg_fit_history(fit, LG_FIT_LOSS)[0]);
    lg_fit_destroy(fit);
}

TEST("invalid table networks are refused with a message, and the model is unchanged") {
    static const struct {
        lg_table_options options;
        uint32_t inputs, outputs;
        const char *words;
    } rows[] = {
        {{.network = LG_NET_MLP, .hidden_count = 2, .hidden = {4, 5}}, 2, 1, "all must have the same width"},
        {{.network = LG_NET_MLP, .hidden_count = 0}, 2, 1, "0 hidden layers; 1 to"},
        {{.network = LG_NET_MLP, .hidden_count = LG_TABLE_LAYERS + 1}, 2, 1, "hidden layers; 1 to"},
        {{.network = LG_NET_MLP, .hidden_count = 1, .hidden = {0}}, 2, 1, "widths must be 1 to 2^20"},
        {{.network = LG_NET_MLP, .hidden_count = 1, .hidden = {4}}, 0, 1, "0 inputs"},
        {{.task = LG_TABLE_TASK_COUNT, .hidden_count = 1, .hidden = {4}}, 2, 1, "unknown task"},
        {{.task = LG_TABLE_CLASSIFICATION, .hidden_count = 1, .hidden = {4}}, 2, 1, "two at least"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_table model = {.net.inputs = 77};
        lg_error error = {LG_OK, ""};
        assert_status(lg_table_init(&model, &rows[i].options, rows[i].inputs, rows[i].outputs, &error),
                      LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].words);
        assert_int_equal(model.net.inputs, 77);
    }
}

TEST("a program of a table refuses scalings that do not fit") {
    const example e = {NETWORK(MLP, TANH, 1, 3, true), 2, 1};
    const lg_table model = make(&e);
    lg_rng rng = test_rng(34, 0);
    const double *theta = parameters(&model, &rng);
    const lg_scaler in = some_scaler(2, &rng, 1.0), out = some_scaler(1, &rng, 1.0);
    const lg_scaler wrong[] = {out, {.channels = 2, .scale = in.scale}, {.channels = 2, .mean = in.mean}};
    lg_program *program = NULL;
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        assert_status(lg_table_program(NULL, &model, &wrong[i], &out, theta, &program, &error),
                      LG_INVALID_ARGUMENT);
        assert_says(error.message, "the scaling of the inputs does not have 2 columns");
    }
    assert_status(lg_table_program(NULL, &model, &in, NULL, theta, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the scaling of the outputs does not have 1 columns");
    assert_null(program);
}

/* ---- evidence of hard data ---- */

typedef struct attempt {
    lg_status status;
    lg_error error;
    lg_table_evidence_result result;
    bool changed; /* whether the call wrote to theta or decay */
} attempt;

/* Seeks the evidence from the parameters theta. */
static attempt try_evidence(const lg_context *context, const lg_table_problem *problem,
                            const lg_table_evidence_options *options, const double *theta) {
    const size_t bytes = lg_table_parameters(problem->model) * sizeof(double);
    double *learned = lg_test_memory(bytes), decay[LG_TABLE_SLICES] = {0};
    attempt made = {.status = LG_OK};
    memcpy(learned, theta, bytes);
    LG_STATUS_OF(lg_table_evidence(context, problem, options, learned, decay, &made.result, &made.error), s);
    made.status = s;
    made.changed = memcmp(learned, theta, bytes) != 0 || decay[0] != 0.0;
    return made;
}

TEST("a search for the evidence that fails says why, and leaves parameters and decay unchanged") {
    const example small = {NETWORK(MLP, TANH, 1, 3, true), 2, 1},
                  wide = {NETWORK(MLP, TANH, 1, 5001, false), 3, 1};
    const lg_table model = make(&small), large = make(&wide);
    lg_table classes = model;
    lg_rng rng = test_rng(35, 0);
    lg_table_samples *samples = draw(&model, ROWS, 0.1, &rng), *others = draw(&large, 2, 0.1, &rng);
    const lg_table_problem problem = {&model, samples, NULL}, too_large = {&large, others, NULL},
                           classification = {&classes, samples, NULL};
    double *theta = parameters(&model, &rng);
    volatile int cancel = 1;
    lg_context_options how;
    lg_context_options_init(&how);
    how.cancel = &cancel;
    lg_context *context = NULL;
    assert_ok(lg_context_create(&how, &context));
    classes.options.task = LG_TABLE_CLASSIFICATION;
    const attempt made[] = {try_evidence(NULL, &classification, NULL, theta),
                            try_evidence(NULL, &too_large, NULL, parameters(&large, &rng)),
                            try_evidence(context, &problem, NULL, theta),
                            (theta[14] = 1e200, try_evidence(NULL, &problem, NULL, theta))};
    static const lg_status expected[] = {LG_UNSUPPORTED, LG_OUT_OF_MEMORY, LG_CANCELLED, LG_NOT_FINITE};
    lg_context_destroy(context);
    for (size_t i = 0; i < LG_COUNT(made); i++) {
        assert_int_equal(made[i].status, expected[i]);
        assert_int_equal(made[i].error.status, expected[i]);
        assert_false(made[i].changed);
    }
    assert_says(made[0].error.message, "for a regression only");
    assert_says(made[1].error.message, "the priors of 25006 weights");
    assert_says(made[3].error.message, "the priors of 15 weights");
    for (int i = 0; i < 3; i++)
        assert_status(lg_table_evidence(NULL, i == 0 ? NULL : &problem, NULL, i == 1 ? NULL : theta,
                                        i == 2 ? NULL : theta, NULL, NULL),
                      LG_INVALID_ARGUMENT);
}

TEST("the evidence of at most N rows equals the evidence of all rows if a table has N rows; the result may "
     "be NULL") {
    const example e = {NETWORK(MLP, TANH, 1, 3, true), 2, 1};
    const lg_table model = make(&e);
    lg_rng rng = test_rng(36, 0);
    lg_table_samples *samples = draw(&model, ROWS, 0.1, &rng);
    const lg_table_problem problem = {&model, samples, NULL};
    const double *theta = parameters(&model, &rng);
    lg_table_evidence_options options;
    lg_table_evidence_options_init(&options);
    const attempt usual = try_evidence(NULL, &problem, &options, theta);
    options.rows = 0; /* all */
    const attempt all = try_evidence(NULL, &problem, &options, theta);
    options.rows = ROWS / 2;
    const attempt half = try_evidence(NULL, &problem, &options, theta);
    assert_memory_equal(&all.result, &usual.result, sizeof all.result);
    assert_true(half.status == LG_OK && half.result.noise != all.result.noise);
    double *learned = TEST_ARRAY(double, lg_table_parameters(&model)), decay[LG_TABLE_SLICES];
    memcpy(learned, theta, lg_table_parameters(&model) * sizeof *learned);
    assert_ok(lg_table_evidence(NULL, &problem, &options, learned, decay, NULL, NULL));
}

/* Two equal columns of 1e9: J^T J is singular up to rounding, and the priors are lost in it. */
TEST("weights that rounding does not tell apart have finite numbers, or an evidence that is not a number") {
    const example e = {NETWORK(MLP, TANH, 1, 2, true), 2, 1};
    const lg_table model = make(&e);
    lg_rng rng = test_rng(37, 0);
    lg_table_samples *samples = draw(&model, ROWS, 0.1, &rng);
    const lg_table_problem problem = {&model, samples, NULL};
    for (size_t i = 0; i < ROWS; i++) samples->x[2 * i] = samples->x[2 * i + 1] = 1e9 * samples->x[2 * i];
    const attempt made = try_evidence(NULL, &problem, NULL, parameters(&model, &rng));
    assert_int_equal(made.status, LG_OK);
    assert_true(isfinite(made.result.noise) && isfinite(made.result.effective));
    assert_true(isnan(made.result.evidence));
}

TEST("every allocation of a fit may fail") {
    double x[8], y[8];
    lg_table_fit_options options;
    lg_table_fit_options_init(&options);
    options.starts = 1;
    options.model.hidden_count = 1;
    options.model.hidden[0] = 2;
    options.evidence.evaluations = 3;
    for (size_t i = 0; i < LG_COUNT(x); i++) x[i] = (double)i, y[i] = sin(x[i]);
    EVERY_ALLOCATION_FAILS(context, 10, lg_program *program = NULL;
                           status =
                               lg_table_fit(context, x, 1, y, 1, LG_COUNT(x), &options, &program, NULL, NULL);
                           lg_program_destroy(program););
}

/* ---- a regression in one call ---- */

static void release_made(void *program) {
    lg_program_destroy(program);
}

/* Fits y = sin(x) + noise on [-3, 3] with x and y in other units, and returns the root mean square error of
 * the prediction against sin(x), in the unit of sin(x). */
static double error_of_fit(double x_unit, double y_unit, double noise, lg_table_fit_result *result) {
    enum { TRAIN = 64, TEST = 101 };
    double x[TRAIN], y[TRAIN], at[TEST], predicted[TEST], sum = 0;
    lg_program *program = NULL;
    lg_error error;
    lg_rng rng = test_rng(31, 1);
    for (int i = 0; i < TRAIN; i++) {
        const double a = -3 + 6.0 * i / (TRAIN - 1);
        x[i] = a * x_unit;
        y[i] = (sin(a) + noise * lg_rng_normal(&rng)) * y_unit;
    }
    for (int i = 0; i < TEST; i++) at[i] = (-3 + 6.0 * i / (TEST - 1)) * x_unit;
    assert_told(lg_table_fit(NULL, x, 1, y, 1, TRAIN, NULL, &program, result, &told));
    lg_test_owns(program, release_made);
    const double *const in[] = {at};
    double *const out[] = {predicted};
    assert_ok(lg_program_eval(NULL, program, "value", TEST, in, out, &error));
    for (int i = 0; i < TEST; i++) sum += pow(predicted[i] / y_unit - sin(at[i] / x_unit), 2) / TEST;
    return sqrt(sum);
}

TEST("a regression in one call finds the function below the noise, in any units") {
    lg_table_fit_result result;
    const double exact = error_of_fit(1, 1, 0, &result), noisy = error_of_fit(1, 1, 0.1, &result),
                 huge = error_of_fit(0x1p30, 0x1p-30, 0.1, NULL);
    print_message("error %.2g without noise, %.2g with noise 0.1 (estimated %.2g)\n", exact, noisy,
                  result.evidence.noise * 0.7);
    assert_true(exact < 1e-3);
    assert_true(noisy < 0.05);
    assert_true(result.evidence.noise > 0.05 && result.evidence.noise < 0.25);
    assert_true(huge == noisy); /* powers of 2 change no bit */
    assert_true(result.start < 3);
}

TEST("a regression in one call keeps the best of its starts") {
    double x[ROWS], y[ROWS], last = -INFINITY;
    bool kept = false;
    lg_rng rng = test_rng(33, 1);
    uint32_t best = 0;
    for (int i = 0; i < ROWS; i++) {
        x[i] = i;
        y[i] = sin(0.5 * i) + 0.1 * lg_rng_normal(&rng);
    }
    for (uint32_t starts = 1; starts <= 3; starts++) {
        lg_table_fit_options options;
        lg_table_fit_result result;
        lg_program *program = NULL;
        lg_table_fit_options_init(&options);
        options.starts = starts;
        assert_told(lg_table_fit(NULL, x, 1, y, 1, ROWS, &options, &program, &result, &told));
        lg_test_owns(program, release_made);
        assert_true(result.start < starts);
        assert_true(result.evidence.evidence >= last);
        if (result.evidence.evidence > last) best = starts - 1;
        assert_int_equal(result.start, best);
        kept = kept || best + 1 < starts;
        last = result.evidence.evidence;
    }
    assert_true(best > 0 && kept); /* a later start was better, and the one after it was not */
}

TEST("a regression in one call refuses what it cannot fit") {
    double x[4] = {0, 1, 2, 3}, y[4] = {0, 1, 4, 9};
    lg_table_fit_options options;
    lg_program *program = NULL;
    lg_error error;
    lg_table_fit_options_init(&options);
    assert_status(lg_table_fit(NULL, x, 1, y, 1, 0, NULL, &program, NULL, &error), LG_INVALID_ARGUMENT);
    options.starts = 0;
    assert_status(lg_table_fit(NULL, x, 1, y, 1, 4, &options, &program, NULL, &error), LG_INVALID_ARGUMENT);
    options.starts = 1;
    options.model.task = LG_TABLE_CLASSIFICATION;
    assert_status(lg_table_fit(NULL, x, 1, y, 1, 4, &options, &program, NULL, &error), LG_INVALID_ARGUMENT);
    options.model.task = LG_TABLE_REGRESSION;
    options.size--;
    assert_status(lg_table_fit(NULL, x, 1, y, 1, 4, &options, &program, NULL, &error), LG_INVALID_ARGUMENT);
    y[2] = NAN;
    assert_status(lg_table_fit(NULL, x, 1, y, 1, 4, NULL, &program, NULL, &error), LG_NOT_FINITE);
    assert_non_null(strstr(error.message, "of the outputs, column 0 (both from 0): nan"));
    assert_says(error.message, "outputs");
    assert_null(program);
}
