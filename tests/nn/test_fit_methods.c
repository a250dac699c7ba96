/* Methods of training: plans, full-batch minimisation by lg_fit, its bits, states and ends. */
#include "nn_support.h"

#include "nn/fit_internal.h"

static lg_fit_plan plan_of(const char *text) {
    lg_fit_plan plan;
    assert_told(lg_fit_plan_parse(text, true, &plan, &told));
    return plan;
}

static lg_fit_options planned(const char *plan, uint64_t epochs) {
    lg_fit_options o = options_of(epochs, 8);
    o.plan = plan_of(plan);
    return o;
}

TEST("plans are read and written, and a text that is no plan is refused with a message") {
    static const char *const good[] = {"adam", "ssbroyden",          "lbfgs",
                                       "lm",   "adam:100,ssbroyden", "adam:3,lbfgs:20,adam:1,ssbroyden:7"};
    static const char *const bad[] = {"",
                                      "adma",
                                      "adam,ssbroyden",
                                      "adam:",
                                      "adam:0",
                                      "adam:1e3",
                                      "adam:-1",
                                      "adam:100,",
                                      "adam:1,adam:1,adam:1,adam:1,adam:1",
                                      "ssbroyden:99999999999"};
    for (size_t i = 0; i < LG_COUNT(good); i++) {
        char text[LG_FIT_PLAN_TEXT];
        const lg_fit_plan plan = plan_of(good[i]);
        lg_fit_plan_show(&plan, text);
        assert_string_equal(text, good[i]);
    }
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        lg_fit_plan plan = {.phases = 77};
        lg_error error;
        assert_int_equal(lg_fit_plan_parse(bad[i], true, &plan, &error), LG_INVALID_ARGUMENT);
        assert_int_not_equal(strlen(error.message), 0);
        assert_int_equal(plan.phases, 77);
    }
}

TEST("the message about an unknown method lists every method") {
    lg_fit_plan plan;
    lg_error error;
    assert_int_equal(lg_fit_plan_parse("descent", true, &plan, &error), LG_INVALID_ARGUMENT);
    for (int method = 0; lg_fit_method_name((lg_fit_method)method) != NULL; method++)
        assert_non_null(strstr(error.message, lg_fit_method_name((lg_fit_method)method)));
}

static double trained(const char *plan, uint64_t epochs) {
    regression r = make_regression();
    const lg_fit_options o = planned(plan, epochs);
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    return lg_fit_loss(fit);
}

TEST("with the same number of evaluations full-batch methods reach a lower loss than Adam") {
    const double adam = trained("adam", 400), dense = trained("ssbroyden", 400),
                 limited = trained("lbfgs", 400);
    const double squares = trained("lm", 60);
    print_message("after 400: adam %.1e, ssbroyden %.1e, lbfgs %.1e; lm after 60: %.1e\n", adam, dense,
                  limited, squares);
    assert_true(squares < 1e-4 * adam);
    assert_true(dense < 1e-4 * adam);
    assert_true(limited < 1e-2 * adam);
}

static lg_fit_method method_of(const char *name) {
    int method = 0;
    while (strcmp(lg_fit_method_name((lg_fit_method)method), name) != 0) method++;
    return (lg_fit_method)method;
}

/* With a constant gradient g the momentum after k steps is g (1 - 0.9^k)/(1 - 0.9). Decay adds to the
 * gradient. */
TEST("sgd moves against the gradient with momentum, in both types") {
    const lg_fit_batches_row *sgd = lg_fit_batches_of(method_of("sgd"));
    lg_fit_options o;
    lg_fit_options_init(&o);
    o.adam.lr = 0.5;
    double g[2] = {1.0, -2.0}, theta[2] = {3.0, 5.0}, m[2] = {0}, v[2] = {0}, expected[2] = {3.0, 5.0};
    float g_f[2] = {1.0f, -2.0f}, theta_f[2] = {3.0f, 5.0f}, m_f[2] = {0}, v_f[2] = {0};
    for (uint64_t k = 1; k <= 5; k++) {
        o.dtype = LG_F64;
        sgd->step(&o, k, 0.1, 0.25, g, 2, m, v, theta);
        o.dtype = LG_F32;
        sgd->step(&o, k, 0.1, 0.25, g_f, 2, m_f, v_f, theta_f);
        for (int i = 0; i < 2; i++) {
            expected[i] -= 0.05 * 0.25 * g[i] * (1.0 - pow(0.9, (double)k)) / (1.0 - 0.9);
            assert_close(theta[i], expected[i], 1e-14, 0.0);
            assert_close(theta_f[i], expected[i], 1e-6, 0.0);
            assert_true(v[i] == 0.0);
        }
    }
    double still[1] = {4.0}, zero[1] = {0.0}, at_rest[1] = {0.0};
    o.dtype = LG_F64;
    o.adam.weight_decay = 0.25;
    sgd->step(&o, 1, 0.1, 1.0, zero, 1, at_rest, v, still);
    assert_close(still[0], 4.0 - 0.05 * 0.25 * 4.0, 1e-15, 0.0);
}

TEST("sgd lowers the loss, and less than Adam in as many epochs where the rate is Adam's") {
    regression r = make_regression();
    lg_fit_options o = planned("sgd", 400);
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    const double *history = lg_fit_history(fit, LG_FIT_LOSS), adam = trained("adam", 400);
    print_message("sgd: %.2e -> %.2e; adam %.2e\n", history[0], history[399], adam);
    assert_true(history[399] < 0.3 * history[0]);
    assert_true(history[399] > adam);
}

TEST("results do not depend on the number of threads") {
    for (int method = 1; lg_fit_method_name((lg_fit_method)method) != NULL; method++) {
        regression r = make_regression();
        lg_fit_options o = planned(lg_fit_method_name((lg_fit_method)method), 40);
        lg_fit *one = regression_fit(NULL, &r, &o);
        o.threads = 3;
        lg_fit *three = regression_fit(NULL, &r, &o);
        run_fit(one);
        run_fit(three);
        assert_same_fits(one, three);
    }
}

/* Stops after `part` epochs, saves, loads the state into a new fit and continues. */
static void assert_resumes(const lg_fit_options *o, uint64_t part) {
    regression r = make_regression();
    lg_fit *whole = regression_fit(NULL, &r, o), *fit;
    run_fit(whole);
    lg_fit_options stopping = *o;
    stopping.stop_after = part;
    for (fit = regression_fit(NULL, &r, &stopping); !lg_fit_finished(fit);) {
        run_fit(fit);
        memory_archive archive = state_of(fit);
        fit = regression_fit(NULL, &r, &stopping);
        load_state(fit, &archive);
    }
    assert_same_fits(whole, fit);
    assert_int_equal(lg_fit_why_finished(fit), lg_fit_why_finished(whole));
}

TEST("a run in parts has the bits of one run, in every phase of the plan") {
    const char *name = "";
    for (int method = 1; name != NULL; method++)
        for (uint64_t part = 1; part < 9; part += 3) {
            name = lg_fit_method_name((lg_fit_method)method);
            lg_fit_options o = planned(name != NULL ? name : "adam:7,ssbroyden:20,adam:3,lbfgs", 45);
            assert_resumes(&o, part);
            o.validation = 0.2;
            o.keep_best = true;
            assert_resumes(&o, part);
        }
}

TEST("a fit says why it is finished") {
    regression r = make_regression();
    lg_fit_options o = planned("adam:5,ssbroyden", 9);
    lg_fit *fit = regression_fit(NULL, &r, &o);
    assert_int_equal(lg_fit_why_finished(fit), LG_FIT_RUNNING);
    assert_string_equal(lg_fit_end_sentence(fit), "");
    run_fit(fit);
    assert_int_equal(lg_fit_why_finished(fit), LG_FIT_END_EPOCHS);
    assert_int_equal(lg_fit_epochs_done(fit), 9);
    o = planned("ssbroyden:6", 9);
    fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    assert_int_equal(lg_fit_epochs_done(fit), 6);
    assert_int_equal(lg_fit_why_finished(fit), LG_FIT_END_EPOCHS);
    o = planned("ssbroyden", 1000000);
    o.seconds = 1e-9;
    fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    assert_int_equal(lg_fit_epochs_done(fit), 1);
    assert_int_equal(lg_fit_why_finished(fit), LG_FIT_END_SECONDS);
    memory_archive archive = state_of(fit);
    o.seconds = 0;
    o.stop_after = 3;
    fit = regression_fit(NULL, &r, &o);
    load_state(fit, &archive);
    assert_int_equal(lg_fit_why_finished(fit), LG_FIT_RUNNING);
    run_fit(fit);
    assert_int_equal(lg_fit_epochs_done(fit), 4);
}

/* Only five samples train, so they are overfitted and the validation loss rises. */
TEST("training stops when the validation loss has not improved during the patience") {
    regression r = make_regression();
    r.validation = REGRESSION_SAMPLES - 5;
    lg_fit_options o = planned("ssbroyden", 100000);
    o.patience = 50;
    o.keep_best = true;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    const uint64_t best = lg_fit_best_epoch(fit), done = lg_fit_epochs_done(fit);
    assert_int_equal(lg_fit_why_finished(fit), LG_FIT_END_PATIENCE);
    const double *loss = lg_fit_history(fit, LG_FIT_LOSS);
    uint64_t steps = 0;
    for (uint64_t i = best; i < done; i++) steps += loss[i] != loss[i - 1];
    assert_int_equal(steps, 50);
    assert_true(done > best + 50);
    const double *validation = lg_fit_history(fit, LG_FIT_VALIDATION);
    for (uint64_t i = best; i < done; i++) assert_true(validation[i] >= validation[best - 1]);
}

/* The first line search takes more than three evaluations. */
TEST("evaluations within a line search do not count for the patience") {
    regression r = make_regression();
    for (uint64_t patience = 1; patience <= 3; patience++) {
        lg_fit_options o = planned("ssbroyden", 100000);
        o.validation = 0.2;
        o.patience = patience;
        o.keep_best = true;
        lg_fit *fit = regression_fit(NULL, &r, &o);
        run_fit(fit);
        const uint64_t best = lg_fit_best_epoch(fit);
        const double *validation = lg_fit_history(fit, LG_FIT_VALIDATION);
        print_message("patience %d: best epoch %d of %d, %g from %g\n", (int)patience, (int)best,
                      (int)lg_fit_epochs_done(fit), validation[best - 1], validation[0]);
        assert_int_equal(lg_fit_why_finished(fit), LG_FIT_END_PATIENCE);
        assert_true(validation[best - 1] < 0.9 * validation[0]);
    }
}

TEST("the loss never rises, and the result is the lowest point") {
    regression r = make_regression();
    lg_fit_options o = planned("ssbroyden", 120);
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    const double *loss = lg_fit_history(fit, LG_FIT_LOSS);
    for (int i = 1; i < 120; i++) assert_true(loss[i] <= loss[i - 1]);
    double *theta = TEST_ARRAY(double, lg_mlp_parameters(&r.net));
    lg_fit_current_parameters(fit, theta);
    o.plan = plan_of("lbfgs");
    o.epochs = 1;
    const lg_fit_problem problem = regression_problem(&r);
    lg_fit *again = test_fit(NULL, &problem, &o, theta);
    run_fit(again);
    assert_close(lg_fit_loss(again), loss[119], 1e-12, 0);
}

/* The loss at theta times `factor`, without weight decay. */
static double loss_at(regression *r, const double *theta, double factor) {
    const size_t n = lg_mlp_parameters(&r->net);
    double *x = TEST_ARRAY(double, n);
    for (size_t i = 0; i < n; i++) x[i] = factor * theta[i];
    const lg_fit_options o = planned("lbfgs", 1);
    const lg_fit_problem problem = regression_problem(r);
    lg_fit *fit = test_fit(NULL, &problem, &o, x);
    run_fit(fit);
    return lg_fit_loss(fit);
}

/* At the minimum of L + W/2 |theta|^2 the derivative of L along theta is -W |theta|^2. A run ends before the
 * minimum, when 200 iterations lower the sum by less than 1e-4 of it; further runs go on from there. */
static void assert_decays(const char *plan, uint64_t epochs) {
    regression r = make_regression();
    lg_fit_options o = planned(plan, epochs);
    o.adam.weight_decay = 1e-3;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    const size_t n = lg_mlp_parameters(&r.net);
    double *theta = TEST_ARRAY(double, n), norm = 0;
    lg_fit_current_parameters(fit, theta);
    const lg_fit_problem problem = regression_problem(&r);
    for (int run = 0; run < 4; run++) {
        fit = test_fit(NULL, &problem, &o, theta);
        run_fit(fit);
        lg_fit_current_parameters(fit, theta);
    }
    for (size_t i = 0; i < n; i++) norm += theta[i] * theta[i];
    const double e = 1e-4, slope = (loss_at(&r, theta, 1 + e) - loss_at(&r, theta, 1 - e)) / (2 * e);
    assert_close(slope, -o.adam.weight_decay * norm, 1e-3, 0);
    assert_close(lg_fit_loss(fit), loss_at(&r, theta, 1), 1e-9, 0);
}

TEST("weight decay is minimised too, but is not part of the reported loss") {
    assert_decays("ssbroyden", 3000);
    assert_decays("lm", 300);
}

static regression noisy_regression(double deviation) {
    regression r = make_regression();
    lg_rng rng = test_rng(7, 0);
    for (int i = 0; i < REGRESSION_SAMPLES; i++) r.t[i] += deviation * lg_rng_normal(&rng);
    return r;
}

/* A fit with a prior on the first `weights` parameters; 0: on all. */
static lg_fit *fit_with_priors(regression *r, size_t weights, double prior, uint64_t epochs) {
    lg_fit_options o = planned("ssbroyden", epochs);
    lg_fit_problem problem = regression_problem(r);
    problem.observations = REGRESSION_SAMPLES;
    problem.weights = weights;
    o.prior = prior;
    lg_fit *fit = test_fit(NULL, &problem, &o, regression_start(r));
    run_fit(fit);
    return fit;
}

static lg_fit *fit_with_prior(regression *r, double prior, uint64_t epochs) {
    return fit_with_priors(r, 0, prior, epochs);
}

/* Mean squared error relative to the true function. */
static double true_error(const lg_fit *fit, const regression *r) {
    regression clean = make_regression();
    double *theta = TEST_ARRAY(double, lg_mlp_parameters(&r->net));
    lg_fit_current_parameters(fit, theta);
    return loss_at(&clean, theta, 1);
}

TEST("with a prior the noise of the data is estimated and not learned") {
    const double deviation = 0.1;
    regression r = noisy_regression(deviation);
    lg_fit *with = fit_with_prior(&r, 0.5, 1500), *without = fit_with_prior(&r, 0, 1500);
    print_message("error %.1e with a prior, %.1e without; variance of the noise %.1e\n", true_error(with, &r),
                  true_error(without, &r), with->state.noise);
    assert_true(with->state.noise > 0.5 * deviation * deviation);
    assert_true(with->state.noise < 1.5 * deviation * deviation);
    assert_true(without->state.noise == 0);
    assert_true(true_error(with, &r) < 0.3 * true_error(without, &r));
}

/* At the minimum of L + W/2 |w|^2: dL/dx = -W x for a weight x and 0 for any other parameter. */
TEST("parameters after the weights have no prior") {
    regression r = noisy_regression(0.1);
    const size_t n = lg_mlp_parameters(&r.net);
    const double s = 0.2, e = 1e-5;
    double *theta = TEST_ARRAY(double, n);
    for (int all = 0; all < 2; all++) {
        const lg_fit *fit = fit_with_priors(&r, all ? 0 : n - 1, s, 1500);
        lg_fit_current_parameters(fit, theta);
        const double last = theta[n - 1], pull = 2 * fit->state.noise / (s * s * REGRESSION_SAMPLES) * last;
        theta[n - 1] = last + e;
        const double above = loss_at(&r, theta, 1);
        theta[n - 1] = last - e;
        const double slope = (above - loss_at(&r, theta, 1)) / (2 * e);
        print_message("slope %.2e, pull of a prior %.2e\n", slope, pull);
        assert_true(fabs(pull) > 1e-4);
        assert_close(slope, all ? -pull : 0, 1e-3, 1e-3 * fabs(pull));
    }
}

TEST("without noise a prior costs little: the loss falls as far as without it") {
    regression r = make_regression();
    const double with = lg_fit_loss(fit_with_prior(&r, 0.5, 800)),
                 without = lg_fit_loss(fit_with_prior(&r, 0, 800));
    print_message("loss %.1e with a prior, %.1e without\n", with, without);
    assert_true(with < 30 * without);
}

TEST("a run with a prior, in parts, has the bits of one run") {
    regression r = noisy_regression(0.1);
    lg_fit_options o = planned("ssbroyden", 900);
    lg_fit_problem problem = regression_problem(&r);
    problem.observations = REGRESSION_SAMPLES;
    o.prior = 0.5;
    lg_fit *whole = test_fit(NULL, &problem, &o, regression_start(&r)), *fit = whole;
    run_fit(whole);
    o.stop_after = 37;
    for (fit = test_fit(NULL, &problem, &o, regression_start(&r)); !lg_fit_finished(fit);) {
        run_fit(fit);
        memory_archive archive = state_of(fit);
        fit = test_fit(NULL, &problem, &o, regression_start(&r));
        load_state(fit, &archive);
    }
    assert_same_fits(whole, fit);
    assert_true(fit->state.noise > 0);
}

TEST("a loss that is not finite is an error at the start, and later shortens the step") {
    regression r = make_regression();
    r.poison = 3;
    lg_fit_options o = planned("ssbroyden", 10);
    lg_fit *fit = regression_fit(NULL, &r, &o);
    lg_error error;
    assert_int_equal(lg_fit_run(fit, &error), LG_NOT_FINITE);
    assert_message(&error, "loss is NaN");
}

TEST("each setting of a training is in the options of the fit") {
    lg_fit_settings s = {.dtype = LG_F32,
                         .epochs = 2,
                         .batch = 3,
                         .lr = 4,
                         .schedule = LG_SCHEDULE_STEP,
                         .lr_step = 5,
                         .lr_gamma = 6,
                         .weight_decay = 7,
                         .prior = 8,
                         .adam_eps = 9,
                         .clip = 10,
                         .validation = 0.5,
                         .patience = 11,
                         .shards = 12,
                         .seed = 13};
    lg_fit_options o;
    s.plan = (lg_fit_plan){.phases = 1, .phase = {{LG_FIT_LM, 14}}};
    lg_fit_options_init(&o);
    lg_fit_settings_apply(&s, &o);
    assert_true(o.plan.phases == 1 && o.plan.phase[0].epochs == 14 && o.dtype == LG_F32 && o.epochs == 2 &&
                o.batch == 3);
    assert_true(o.adam.lr == 4 && o.adam.weight_decay == 7 && o.adam.eps == 9 && o.prior == 8 &&
                o.clip_norm == 10);
    assert_true(o.schedule.kind == LG_SCHEDULE_STEP && o.schedule.every == 5 && o.schedule.gamma == 6 &&
                o.schedule.floor == 0);
    assert_true(o.validation == 0.5 && o.keep_best && o.patience == 11 && o.shards == 12 && o.seed == 13);
    s.schedule = LG_SCHEDULE_COSINE;
    s.validation = 0;
    lg_fit_settings_apply(&s, &o);
    assert_true(o.schedule.floor == 6 && !o.keep_best);
}

TEST("without a loss function the loss is the sum of the squares of the residuals") {
    regression r = make_regression();
    lg_fit_problem problem = regression_problem(&r);
    const double *theta = regression_start(&r);
    double given = 0, derived = 0;
    assert_ok(lg_fit_problem_loss(NULL, &problem, theta, &given, NULL));
    problem.loss = NULL;
    assert_ok(lg_fit_problem_loss(NULL, &problem, theta, &derived, NULL));
    problem.residuals = NULL;
    assert_status(lg_fit_problem_loss(NULL, &problem, theta, &derived, NULL), LG_INVALID_ARGUMENT);
    assert_close(derived, given, 1e-13, 0);
}

TEST("single precision and too many parameters are refused") {
    regression r = make_regression();
    lg_fit_problem problem = regression_problem(&r);
    lg_fit_options o = planned("lbfgs", 10);
    o.dtype = LG_F32;
    lg_fit *fit = NULL;
    lg_error error;
    double *theta = TEST_ARRAY(double, 20000);
    assert_int_equal(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);
    assert_message(&error, "lbfgs needs double precision");
    o = planned("lm", 10);
    problem.residuals = NULL;
    assert_int_equal(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);
    assert_message(&error, "sum of squares");
    o = planned("ssbroyden", 10);
    problem.parameters = 20000;
    assert_int_equal(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);
    assert_message(&error, "use lbfgs");
}

TEST("a state of another plan, or with an impossible phase, is refused") {
    regression r = make_regression();
    lg_fit_options o = planned("adam:3,ssbroyden", 20);
    o.stop_after = 8;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    memory_archive archive = state_of(fit);
    const lg_archive_reader reader = memory_reader(&archive);
    o.plan = plan_of("ssbroyden");
    lg_fit *other = regression_fit(NULL, &r, &o);
    lg_error error;
    assert_int_equal(lg_fit_load(other, &reader, &error), LG_INVALID_ARGUMENT);
    static const char *const paths[] = {"train/phase", "train/phase_start", "train/adam_epochs"};
    for (size_t i = 0; i < LG_COUNT(paths); i++) {
        uint64_t *value = memory_find(&archive, paths[i])->data, kept = *value;
        *value = 1000;
        assert_int_equal(lg_fit_load(fit, &reader, &error), LG_FORMAT);
        *value = kept;
    }
    load_state(fit, &archive);
}
