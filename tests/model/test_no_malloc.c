/* A training step calls no malloc after the first epochs. Functions of a model that control code calls, and
 * curves, allocate nothing and take no lock. test_plan.c tests plans. */
#include "support/models.h"
#include "support/machine_support.h"
#include "support/model_support.h"
#include "anomaly/series_support.h"
#include "elastica/surrogate_support.h"
#include "nn/nn_support.h"
#include "support/malloc_count.h"

/* ---- training ---- */

typedef struct counting {
    lg_counts used;
    bool done;
} counting;

/* Epochs 1 and 2 warm up, epochs 3 to 5 are counted. The counters are not part of the library. */
static int count_epochs(void *user, const lg_fit_epoch *report) {
    counting *self = user;
    if (report->epoch == 2) lg_count_begin();
    if (report->epoch == 5) {
        self->used = lg_count_end();
        self->done = true;
    }
    return 0;
}

static void train_counted(const lg_fit_problem *problem, lg_dtype dtype, int threads, const double *theta) {
    counting counted = {.done = false};
    lg_fit_options options = options_of(5, 16);
    options.dtype = dtype;
    options.threads = threads;
    options.shards = 2;
    options.validation = problem->samples > 16 && problem->validation == 0 ? 0.1 : 0.0;
    options.clip_norm = 1e-3;
    options.on_epoch = count_epochs;
    options.user = &counted;
    run_fit(test_fit(NULL, problem, &options, theta));
    assert_true(counted.done);
    assert_int_equal(counted.used.allocations, 0);
    assert_int_equal(counted.used.releases, 0);
}

TEST("after warming up a training step of a Hamiltonian calls no malloc") {
    enum { COUNT = 50, POINTS = 3 };
    static const struct {
        const char *scheme;
        uint32_t n;
        const lg_hamiltonian_family *family;
        lg_dtype dtype;
        int threads;
    } settings[] = {{"cf4", 1, &lg_hamiltonian_chain, LG_F64, 1},
                    {"cf4", 1, &lg_hamiltonian_chain, LG_F32, 2},
                    {"rkmk4", 2, &lg_hamiltonian_chain, LG_F64, 2},
                    {"rk4", 2, &lg_hamiltonian_chain, LG_F64, 1},
                    {"stormer-verlet", 2, &lg_hamiltonian_separable, LG_F32, 1}};
    if (!lg_count_available()) skip();
    for (size_t i = 0; i < LG_COUNT(settings); i++) {
        const built b = build_hamiltonian(settings[i].family, settings[i].n, LG_POTENTIAL_MLP, LG_TANH);
        const size_t d = lg_model_inputs(b.model);
        double *y = room(COUNT * POINTS * d);
        lg_fit_problem fit_problem;
        lg_rng rng = test_rng(1, i);
        for (size_t k = 0; k < COUNT * POINTS; k++) draw_state(&b, &rng, y + k * d);
        const lg_hamiltonian_problem problem = {.model = &b.hamiltonian,
                                                .scheme = lg_scheme_find(settings[i].scheme),
                                                .substeps = 1,
                                                .trajectories = COUNT,
                                                .points = POINTS,
                                                .dt = 0.01,
                                                .data = y};
        lg_hamiltonian_fit_problem(&problem, &fit_problem);
        train_counted(&fit_problem, settings[i].dtype, settings[i].threads, b.theta);
    }
}

TEST("after warming up a training step of a surrogate calls no malloc") {
    static const uint32_t all[6] = {0, 1, 2, 3, 4, 5};
    const lg_elastica_curves set = make_curves(6, 20);
    if (!lg_count_available()) skip();
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, 20, TEST_LENGTH, 41);
        const lg_surrogate_problem problem = problem_of(&s, &set, all, 6);
        lg_fit_problem fit_problem;
        lg_surrogate_fit_problem(&problem, &fit_problem);
        train_counted(&fit_problem, LG_F32, 1, s.theta);
    }
}

TEST("after warming up a training step of a detector calls no malloc, and its evaluation takes no lock "
     "either") {
    enum { COUNT = 40 };
    if (!lg_count_available()) skip();
    const built b = build_detector(LG_SWISH);
    const lg_series series = make_series(COUNT, 2, 60, 3, false, false);
    const lg_windows windows = cut_windows(&series, 0, 0);
    for (size_t i = 0; i < COUNT * 120; i++) series.x[i] = (float)sin((double)i);
    const lg_scaler scaler = fit_scaler(&series, &windows, NULL, COUNT, false);
    lg_detector_data data;
    assert_ok(
        lg_detector_data_create(NULL, &b.detector, &scaler, &series, &windows, NULL, 0, LG_F32, &data, NULL));
    (void)own_lg_detector_data(data);
    const lg_detector_problem problem = {&b.detector, &data, COUNT - 9, 1};
    lg_fit_problem fit_problem;
    lg_detector_fit_problem(&problem, &fit_problem);
    train_counted(&fit_problem, LG_F32, 1, b.theta);
    lg_detector_plan *plan;
    double p[3], plane[2];
    assert_ok(lg_detector_plan_create(NULL, &b.detector, &scaler, b.theta, LG_F64, &plan, NULL));
    void *work = test_work(lg_detector_work_size(plan));
    assert_no_malloc_no_lock(lg_detector_eval(plan, series.x, p, plane, work));
    lg_detector_plan_destroy(plan);
}

/* ---- functions that control code calls ---- */

/* Value and derivative of a model of any kind. */
static void count_function(const built *b) {
    const size_t n = lg_model_inputs(b->model), outputs = lg_model_outputs(b->model);
    double *x = room(n), *y = room(outputs), *jacobian = room(outputs * n);
    size_t sizes = 0;
    for (size_t i = 0; i < n; i++) x[i] = 0.1 * (double)(i % 7);
    assert_no_malloc_no_lock(sizes += lg_model_inputs(b->model) + lg_model_outputs(b->model) +
                                      lg_model_parameters(b->model) + lg_model_work_size(b->model));
    assert_no_malloc_no_lock(lg_model_eval(b->model, x, y, b->work));
    assert_no_malloc_no_lock(lg_model_jacobian(b->model, x, y, jacobian, b->work));
    assert_true(sizes > 0 && isfinite(y[0]));
}

/* The first step after the set-up is counted too. */
static void count_steps(const moving *s, const lg_scheme *scheme) {
    const lg_model *model = s->b.model;
    lg_stepper *stepper = NULL;
    lg_status status = LG_OK;
    double y[MOST_STATE];
    size_t bytes = 0;
    assert_no_malloc_no_lock(bytes = lg_model_stepper_size(model, scheme));
    if (bytes == 0) return;
    void *memory = test_work(bytes);
    memcpy(y, s->y, sizeof y);
    assert_no_malloc_no_lock(status = lg_model_stepper_init(model, scheme, &stepper, memory, bytes));
    assert_ok(status);
    for (int n = 0; n < 4; n++) {
        assert_no_malloc_no_lock(status = lg_stepper_step(stepper, 0.0, 0.01, y, n < 2 ? s->u : NULL, y));
        assert_ok(status);
    }
}

static void count_motion(const moving *s) {
    double field[MOST_STATE], A[MOST_TANGENT * MOST_TANGENT], B[MOST_TANGENT * MOST_INPUT],
        basis[MOST_STATE * MOST_TANGENT], c[MOST_TANGENT];
    const lg_model *model = s->b.model;
    lg_model_user user;
    lg_ode ode;
    lg_status status[4] = {LG_CHECK_FAILED};
    count_function(&s->b);
    assert_no_malloc_no_lock(status[0] = lg_model_field(model, s->y, s->u, field, s->b.work));
    assert_no_malloc_no_lock(status[1] = lg_model_linearise(model, s->y, s->u, A, B, basis, s->b.work));
    assert_no_malloc_no_lock(status[2] = lg_model_deviation(model, s->y, s->y, c, s->b.work));
    assert_no_malloc_no_lock(status[3] = lg_model_ode(model, &ode, &user, s->b.work));
    for (int i = 0; i < 4; i++) assert_ok(status[i]);
    for (size_t i = 0; i < lg_scheme_count(); i++) count_steps(s, lg_scheme_at(i));
}

TEST("a Hamiltonian in a control loop allocates nothing and takes no lock") {
    const uint32_t wide[3] = {100, 100, 100}; /* as large as trained networks, whose products are large */
    lg_hamiltonian model;
    if (!lg_count_available()) skip();
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_TANH);
        count_motion(&s);
    }
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, wide, 3, LG_SWISH));
    double *theta = room(lg_hamiltonian_parameters(&model));
    lg_rng rng = test_rng(24, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    const moving s = put_in_motion(build_from(&model, theta), 1);
    count_motion(&s);
}

TEST("a machine with every kind of coordinate in a control loop allocates nothing and takes no lock") {
    enum { STATE = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES };
    double q[STATE], v[STATE], y[STATE], out[STATE], u[2] = {0.3, -0.4};
    if (!lg_count_available()) skip();
    const lg_machine machine = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "network"), LG_MACHINE_MASS);
    built b = {.model = NULL};
    assert_ok(test_machine_model(NULL, &machine, machine_theta(&machine, 4), &b.model, NULL));
    b = ready_to_run(b);
    const lg_model *model = b.model;
    const size_t d = lg_model_inputs(model), r = lg_model_tangent_dim(model);
    double *A = room(r * r), *B = room(2 * r), *basis = room(d * r);
    lg_model_user user;
    lg_ode ode;
    lg_status status[7] = {LG_CHECK_FAILED};
    random_rows(&machine, 2, 1, q, v);
    count_function(&b);
    assert_no_malloc_no_lock(status[0] = lg_model_machine_state(model, q, v, y, b.work));
    assert_no_malloc_no_lock(status[1] = lg_model_machine_velocities(model, y, out, b.work));
    assert_no_malloc_no_lock(status[2] = lg_model_machine_positions(model, y, out, b.work));
    assert_no_malloc_no_lock(status[3] = lg_model_field(model, y, u, out, b.work));
    assert_no_malloc_no_lock(status[4] = lg_model_linearise(model, y, u, A, B, basis, b.work));
    assert_no_malloc_no_lock(status[5] = lg_model_deviation(model, y, y, out, b.work));
    assert_no_malloc_no_lock(status[6] = lg_model_ode(model, &ode, &user, b.work));
    for (int i = 0; i < 7; i++) assert_ok(status[i]);
    lg_stepper *stepper = NULL;
    lg_status stepped = LG_CHECK_FAILED;
    const size_t bytes = lg_model_stepper_size(model, lg_scheme_find("cf4"));
    void *memory = test_work(bytes);
    assert_ok(lg_model_stepper_init(model, lg_scheme_find("cf4"), &stepper, memory, bytes));
    for (int n = 0; n < 4; n++) {
        assert_no_malloc_no_lock(stepped = lg_stepper_step(stepper, 0.0, 0.01, y, n < 2 ? u : NULL, y));
        assert_ok(stepped);
    }
}

TEST("surrogates, detectors and curves in a control loop allocate nothing and take no lock") {
    enum { POINTS = 30 };
    static const double x[8] = {0.0, 0.0, 0.8, 0.6, 3.0, 0.0, 0.8, -0.6};
    double at[POINTS], q[2 * POINTS], v[2 * POINTS];
    if (!lg_count_available()) skip();
    const built detector = build_detector(LG_SWISH);
    count_function(&detector);
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        const built b = build_surrogate((lg_surrogate_kind)kind);
        count_function(&b);
    }
    for (size_t k = 0; k < POINTS; k++) at[k] = TEST_LENGTH * (double)k / POINTS;
    for (size_t which = 0; which < 2 * TEST_OPTIONS; which++) {
        const small s = make_small(which / 2, 20, TEST_LENGTH, 42);
        lg_surrogate_curves *curves;
        assert_ok(lg_surrogate_curves_create(NULL, &s.model, s.theta, which % 2 == 0 ? LG_F64 : LG_F32,
                                             POINTS, &curves, NULL));
        void *work = test_work(lg_surrogate_curves_work_size(curves));
        assert_no_malloc_no_lock(lg_surrogate_curve(curves, x, at, POINTS, q, v, work));
        lg_surrogate_curves_destroy(curves);
    }
}
