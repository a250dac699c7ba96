/* Losses that are recorded once and computed by plans (lg_fit_problem.repeats) agree with losses on the tape.
 * ctest-labels: threads isa */
#include "nn_support.h"

#include "autodiff/program/program_tape.h"
#include "autodiff/tape/tape_internal.h"
#include "nn/fit_internal.h"

/* ---- repeated recordings ---- */

static lg_tape *dry_tape(lg_dtype dtype) {
    lg_tape *tape = test_tape(dtype);
    lg_tape_set_dry(tape);
    return tape;
}

/* sin(theta) a + constant b, elements 0 and `index`, and element `part` once more, summed. a and b are data,
 * the others are parts of the recording. */
static lg_var record_sum(lg_tape *tape, const double *theta, const double a[2], double constant,
                         uint32_t index, uint32_t part, lg_var *of) {
    *of = lg_parameter(tape, lg_shape1(2), theta);
    const lg_var x = lg_mul(tape, lg_sin(tape, *of), lg_input_f64(tape, lg_shape1(2), a));
    const lg_var b = lg_input_f64(tape, lg_shape0(), a + 1);
    const lg_var both = lg_add(tape, lg_mul(tape, b, lg_full(tape, lg_shape1(2), constant)), x);
    const lg_var chosen = lg_sum(tape, lg_gather(tape, both, (const uint32_t[]){0, index}, 2));
    return lg_add(tape, chosen, lg_sum(tape, lg_slice(tape, both, 0, part, 1)));
}

TEST("a repeated recording takes new data, and refuses everything else that is new") {
    static const double theta[2] = {0.3, -0.7}, first[2] = {1.0, 2.0}, second[2] = {-0.5, 0.25};
    lg_tape *tape = dry_tape(LG_F64);
    lg_plan *plan = NULL;
    void *data;
    lg_var of, y = record_sum(tape, theta, first, 3.0, 1, 0, &of), out[2] = {y, LG_NONE};
    double value, got[3];
    assert_int_equal(lg_read(tape, y, 1, &value), LG_UNSUPPORTED);
    assert_null(lg_value(tape, y));
    assert_ok(lg_grad(tape, y, &of, 1, &out[1]));
    assert_ok(lg_plan_of_tape(tape, of, out, 2, 1, &plan, &data, NULL));
    void *work = lg_test_memory(lg_plan_work_size(plan));
    for (int k = 0; k < 4; k++) {
        const double *a = k % 2 == 0 ? first : second;
        lg_tape_repeat(tape);
        assert_int_equal(record_sum(tape, theta, a, 3.0, 1, 0, &of).index, y.index);
        assert_ok(lg_tape_status(tape));
        lg_plan_eval(plan, (const void *const[]){theta, data}, (void *const[]){got, got + 1}, work);
        const double x[2] = {sin(theta[0]) * a[0], sin(theta[1]) * a[1]};
        assert_close(got[0], 2.0 * x[0] + x[1] + 9.0 * a[1], 1e-14, 0.0);
        assert_close(got[1], 2.0 * cos(theta[0]) * a[0], 1e-14, 0.0);
        assert_close(got[2], cos(theta[1]) * a[1], 1e-14, 0.0);
        /* Another constant, other indices, another attribute, another operation, another shape, more than
         * there was. */
        for (int wrong = 0; wrong < 6; wrong++) {
            lg_tape_repeat(tape);
            const lg_var again = record_sum(tape, theta, second, wrong == 0 ? 2.0 : 3.0, wrong == 1 ? 0 : 1,
                                            wrong == 2 ? 1 : 0, &of);
            if (wrong >= 3) {
                assert_ok(lg_tape_status(tape));
                if (wrong == 3) (void)lg_exp(tape, again);
                if (wrong == 4) (void)lg_full(tape, lg_shape1(7), 1.0);
                for (int i = 0; wrong == 5 && i < 40; i++) (void)lg_full(tape, lg_shape0(), 1.0);
            }
            assert_int_equal(lg_tape_status(tape), LG_UNSUPPORTED);
        }
    }
    lg_tape_repeat(tape);
    const lg_mark mark = lg_tape_mark(tape);
    assert_int_equal(lg_tape_rewind(tape, mark), LG_UNSUPPORTED);
    lg_tape_reset(tape);
    (void)record_sum(tape, theta, first, 5.0, 0, 1, &of);
    assert_ok(lg_tape_status(tape));
    lg_plan_destroy(plan);
}

TEST("a repeated recording does not write to the memory of a parameter") {
    double theta[2] = {0.3, -0.7};
    lg_tape *tape = dry_tape(LG_F64);
    (void)lg_parameter(tape, lg_shape1(2), theta);
    lg_tape_repeat(tape);
    (void)lg_input_f64(tape, lg_shape1(2), (const double[2]){1.0, 2.0});
    assert_int_equal(lg_tape_status(tape), LG_UNSUPPORTED);
    assert_true(theta[0] == 0.3 && theta[1] == -0.7);
}

/* ---- fits ---- */

/* How the recordings of a loss differ from one call to another. */
typedef enum change { SAME, CONSTANT, OPERATION, JACOBIAN, GIVEN, READS } change;

typedef struct changing {
    regression r;
    change change;
} changing;

static lg_status changing_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                               size_t batch, lg_var *loss) {
    changing *c = user;
    LG_TRY(regression_loss(&c->r, tape, theta, samples, count, batch, loss));
    const bool odd = samples[0] % 2 == 1;
    double value;
    if (c->change == CONSTANT) *loss = lg_mul(tape, *loss, lg_full(tape, lg_shape0(), odd ? 2.0 : 1.0));
    if (c->change == OPERATION && odd) *loss = lg_scale(tape, *loss, 2.0);
    if (c->change == JACOBIAN) {
        const lg_var two = lg_slice(tape, theta, 0, 0, 2), wave = lg_sin(tape, two);
        const lg_var aim = lg_input_f64(tape, lg_shape2(2, 2), (const double[4]){0.5, 2.0, -1.0, 0.3});
        const lg_var off = lg_sub(tape, lg_jacobian(tape, wave, two), aim);
        const double part = (double)count / (double)batch;
        *loss = lg_add(tape, *loss, lg_scale(tape, lg_sum(tape, lg_square(tape, off)), part));
    }
    if (c->change == GIVEN) { /* numbers in the caller's memory, which differ from sample to sample */
        static const float single[2] = {1.0f, 3.0f};
        static const double whole[2] = {1.0, 3.0};
        const bool f32 = tape->options.dtype == LG_F32;
        const void *number = f32 ? (const void *)&single[odd] : &whole[odd];
        *loss = lg_mul(tape, *loss, lg_parameter(tape, lg_shape0(), number));
    }
    if (c->change == READS) LG_TRY(lg_read(tape, *loss, 1, &value));
    return LG_OK;
}

static lg_fit *changing_fit(changing *c, const lg_fit_options *o, bool repeats, size_t chunk) {
    lg_fit_problem problem = regression_problem(&c->r);
    problem.loss = changing_loss;
    problem.user = c;
    problem.repeats = repeats;
    problem.chunk = chunk;
    return test_fit(NULL, &problem, o, regression_start(&c->r));
}

/* Number of plans that the first shard has. */
static size_t plans_of(const lg_fit *fit) {
    size_t plans;
    (void)lg_fit_recordings_size(&fit->shards[0], &plans);
    return plans;
}

TEST("plans give the losses of the tape, for every kind of change from call to call") {
    static const struct {
        const char *plan;
        size_t batch, chunk, shards;
    } ways[] = {{"adam", 8, 0, 1}, {"adam", 20, 3, 2}, {"lbfgs", 0, 16, 1}, {"ssbroyden", 0, 5, 4}};
    for (change kind = SAME; kind <= READS; kind++)
        for (size_t w = 0; w < LG_COUNT(ways); w++)
            for (int dtype = 0; dtype < 2; dtype++) {
                changing c = {make_regression(), kind};
                if (dtype == 1 && ways[w].batch == 0) continue;
                lg_fit_options o = options_of(12, ways[w].batch);
                o.shards = ways[w].shards;
                o.dtype = dtype == 0 ? LG_F64 : LG_F32;
                assert_told(lg_fit_plan_parse(ways[w].plan, true, &o.plan, &told));
                lg_fit *planned = changing_fit(&c, &o, true, ways[w].chunk),
                       *taped = changing_fit(&c, &o, false, ways[w].chunk);
                run_fit(planned);
                run_fit(taped);
                assert_true(kind == READS ? plans_of(planned) == 0 : plans_of(planned) > 0);
                assert_int_equal(plans_of(taped), 0);
                for (int k = 0; k < 12; k++)
                    assert_close(lg_fit_history(planned, LG_FIT_LOSS)[k],
                                 lg_fit_history(taped, LG_FIT_LOSS)[k], dtype == 0 ? 1e-9 : 1e-2, 0.0);
            }
}

TEST("plans: results do not depend on threads, nor on a stop and a resume") {
    changing c = {make_regression(), OPERATION};
    lg_fit_options o = options_of(9, 20);
    lg_fit *one = changing_fit(&c, &o, true, 3);
    o.threads = 3;
    lg_fit *three = changing_fit(&c, &o, true, 3);
    run_fit(one);
    run_fit(three);
    assert_same_fits(one, three);
    o.stop_after = 4;
    lg_fit *part = changing_fit(&c, &o, true, 3), *rest = changing_fit(&c, &o, true, 3);
    run_fit(part);
    memory_archive archive = state_of(part);
    load_state(rest, &archive);
    while (!lg_fit_finished(rest)) run_fit(rest);
    assert_same_fits(one, rest);
}

TEST("plans: a run that was saved without plans goes on without them") {
    changing c = {make_regression(), SAME};
    lg_fit_options o = options_of(9, 20);
    lg_fit *whole = changing_fit(&c, &o, false, 3);
    run_fit(whole);
    o.stop_after = 4;
    lg_fit *part = changing_fit(&c, &o, false, 3), *rest = changing_fit(&c, &o, true, 3);
    run_fit(part);
    memory_archive archive = state_of(part);
    assert_true(lg_fit_by_plans(rest));
    load_state(rest, &archive);
    assert_false(lg_fit_by_plans(rest));
    while (!lg_fit_finished(rest)) run_fit(rest);
    assert_same_fits(whole, rest);
}

TEST("plans: a loss that is not finite is reported as on the tape") {
    changing c = {make_regression(), SAME};
    lg_error error;
    c.r.poison = 5;
    const lg_fit_options o = options_of(3, 8);
    lg_fit *fit = changing_fit(&c, &o, true, 0);
    assert_int_equal(lg_fit_run(fit, &error), LG_NOT_FINITE);
    assert_message(&error, "NaN");
}
