/* examples/attitude_control: the controller with a machine that equals the true body, the log, and a whole
 * run without allocation. */
#include "support/models.h"
#include "support/machine_support.h"

#include "../../examples/attitude_control/controller.c"
#include "../../examples/attitude_control/log.c"
#include "../../examples/attitude_control/observer.c"
#include "../../examples/attitude_control/plant.c"
#include "../../examples/attitude_control/trial.c"
#include "support/malloc_count.h"

static const double set_point[3] = {1.1, -0.7, 0.5}, frequency = 5.0;

typedef struct fixture {
    lg_model *model;
    void *work;
    controller control;
    plant truth;
    double Rd[9];
    char why[256];
} fixture;

static void release_fixture(void *of) {
    fixture *self = of;
    lg_model_destroy(self->model);
    plant_destroy(&self->truth);
}

/* The true body as a machine with known terms, except that the spring is a polynomial of the vertical. */
static lg_machine true_machine(void) {
    lg_machine machine = empty_machine();
    const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    add_coordinate(&machine, "body", LG_COORDINATE_ROTATION);
    for (int i = 0; i < 3; i++) add_input(&machine, i == 0 ? "u1" : i == 1 ? "u2" : "u3");
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 9, true_body.J);
    lg_machine_term *gravity = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
    add_feature(gravity, LG_FEATURE_UP, 0);
    add_values(gravity, 3, true_body.w);
    lg_machine_term *spring = add_term(&machine, LG_MACHINE_POTENTIAL, "polynomial");
    add_feature(spring, LG_FEATURE_UP, 0);
    spring->degree = 2;
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "known"), 3, true_body.d);
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "quadratic"), 3, true_body.c);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 9, unit);
    assert_machine(&machine);
    return machine;
}

static lg_model *model_with(const lg_machine *machine, const double *theta) {
    lg_model *model = NULL;
    assert_ok(test_machine_model(NULL, machine, theta, &model, NULL));
    return model;
}

/* H at rest, with the vertical along axis i of the body. */
static double energy_along(const lg_model *model, int axis, void *work) {
    const double turns[3][3] = {{0, -1.5707963267948966, 0}, {1.5707963267948966, 0, 0}, {0, 0, 0}};
    double state[12] = {0}, H;
    plant_attitude(turns[axis], state);
    for (int i = 0; i < 3; i++) assert_close(state[6 + i], i == axis ? 1.0 : 0.0, 0, 1e-15);
    lg_model_eval(model, state, &H, work);
    return H;
}

/* Index of the parameter of Gamma_2^2. It adds the same along axis 2 and along -2, and nothing else does. */
static size_t spring_parameter(const lg_machine *machine) {
    size_t found = machine->parameters, count = 0;
    for (size_t p = 0; p < machine->parameters; p++) {
        double *theta = TEST_ARRAY(double, machine->parameters), turned[12] = {0}, H, with;
        const double half[3] = {-1.5707963267948966, 0, 0};
        lg_model *none = model_with(machine, theta);
        theta[p] = 1.0;
        lg_model *one = model_with(machine, theta);
        void *work = test_work(lg_model_work_size(one));
        plant_attitude(half, turned);
        lg_model_eval(none, turned, &H, work);
        lg_model_eval(one, turned, &with, work);
        const double even = energy_along(one, 1, work) - energy_along(none, 1, work);
        if (even > 0.5 && with - H > 0.5) found = p, count++;
        lg_model_destroy(none);
        lg_model_destroy(one);
    }
    assert_int_equal(count, 1);
    return found;
}

static fixture *make(double bound) {
    fixture *self = TEST_ARRAY(fixture, 1);
    const lg_machine machine = true_machine();
    double *theta = TEST_ARRAY(double, machine.parameters);
    theta[spring_parameter(&machine)] = 0.5 * true_body.k;
    self->model = model_with(&machine, theta);
    assert_true(plant_create(&self->truth));
    lg_test_owns(self, release_fixture);
    self->work = test_work(lg_model_work_size(self->model));
    plant_attitude(set_point, self->Rd);
    if (!controller_init(&self->control, self->model, self->work, self->Rd, frequency, bound, self->why))
        fail_msg("%s", self->why);
    return self;
}

TEST("the plant equals the known machine, and the energy changes by the power of torque and friction") {
    const fixture *self = make(6.0);
    lg_rng rng = test_rng(3, 0);
    for (int n = 0; n < 100; n++) {
        double y[PLANT_STATE], algebra[6], state[STATE], want[6], J_rate[3], u[3], before, after, power = 0;
        plant_start(&rng, 2.0, y);
        for (int i = 0; i < 3; i++) u[i] = lg_rng_normal(&rng);
        assert_ok(field((void *)(uintptr_t)&self->truth, 0, y, u, algebra));
        assert_ok(lg_model_machine_state(self->model, y, y + 9, state, self->work));
        assert_ok(lg_model_field(self->model, state, u, want, self->work));
        times(true_body.J, algebra + 3, J_rate);
        for (int i = 0; i < 3; i++) {
            assert_close(algebra[i], want[i], 1e-13, 1e-13);
            assert_close(J_rate[i], want[3 + i], 1e-12, 1e-12);
            const double w = y[9 + i];
            power += w * (u[i] - (true_body.d[i] + true_body.c[i] * fabs(w)) * w);
        }
        lg_model_eval(self->model, state, &before, self->work);
        assert_true(plant_advance((plant *)(uintptr_t)&self->truth, 1e-6, u, y));
        assert_ok(lg_model_machine_state(self->model, y, y + 9, state, self->work));
        lg_model_eval(self->model, state, &after, self->work);
        assert_close((after - before) / 1e-6, power, 1e-3, 1e-3);
    }
}

/* W = w^2 tr(I - Rd^T R)/2 + |Omega|^2/2. */
static double lyapunov(const fixture *self, const double *y) {
    double trace = 0, square = 0;
    for (int i = 0; i < 9; i++) trace += self->Rd[i] * y[i];
    for (int i = 0; i < 3; i++) square += y[9 + i] * y[9 + i];
    return 0.5 * self->control.stiffness * (3 - trace) + 0.5 * square;
}

TEST("with an exact machine the Lyapunov function falls by damping * |Omega|^2 in every period") {
    fixture *self = make(1e3);
    lg_rng rng = test_rng(4, 0);
    for (int n = 0; n < 1000; n++) {
        double y[PLANT_STATE], torque[3];
        plant_start(&rng, 2.0, y);
        const double W = lyapunov(self, y), rate = trial_norm(y + 9);
        controller_step(&self->control, y, y + 9, torque);
        assert_true(plant_advance(&self->truth, 1e-5, torque, y));
        assert_close((lyapunov(self, y) - W) / 1e-5, -self->control.damping * rate * rate, 2e-2, 2e-2);
    }
}

TEST("e_R agrees with its formula") {
    fixture *self = make(6.0);
    lg_rng rng = test_rng(5, 0);
    double y[PLANT_STATE], torque[3], M[9] = {0};
    plant_start(&rng, 1.0, y);
    controller_step(&self->control, y, y + 9, torque);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                M[3 * i + j] += self->Rd[3 * k + i] * y[3 * k + j] - y[3 * k + i] * self->Rd[3 * k + j];
    const double e[3] = {0.5 * M[7], 0.5 * M[2], 0.5 * M[3]};
    for (int i = 0; i < 3; i++) assert_close(self->control.error[i], e[i], 1e-14, 1e-14);
}

TEST("at the set point the torque holds the body still") {
    fixture *self = make(6.0);
    double y[PLANT_STATE] = {0}, torque[3];
    memcpy(y, self->Rd, sizeof self->Rd);
    for (int n = 0; n < 1000; n++) {
        controller_step(&self->control, y, y + 9, torque);
        assert_true(plant_advance(&self->truth, 1e-3, torque, y));
    }
    assert_true(trial_angle(y, self->Rd) < 1e-10);
    assert_true(trial_norm(torque) > 0.5); /* gravity alone would not keep it there */
}

TEST("the torque is bounded, and a state that is not finite gives no torque") {
    fixture *self = make(0.3);
    lg_rng rng = test_rng(6, 0);
    int at_bound = 0;
    for (int n = 0; n < 200; n++) {
        double y[PLANT_STATE], torque[3];
        plant_start(&rng, 3.0, y);
        controller_step(&self->control, y, y + 9, torque);
        assert_true(trial_norm(torque) <= 0.3);
        at_bound += trial_norm(torque) > 0.299;
        y[n % PLANT_STATE] = n % 2 == 0 ? (double)NAN : (double)INFINITY;
        controller_step(&self->control, y, y + 9, torque);
        for (int i = 0; i < 3; i++) assert_close(torque[i], 0, 0, 0);
    }
    assert_true(at_bound > 100);
}

TEST("machines of another form are refused with a message") {
    lg_machine line = empty_machine();
    controller control;
    char why[256] = "";
    const double Rd[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    add_coordinate(&line, "x", LG_COORDINATE_LINE);
    add_values(add_term(&line, LG_MACHINE_MASS, "known"), 1, (double[]){1});
    assert_machine(&line);
    lg_model *model = model_with(&line, NULL);
    void *work = test_work(lg_model_work_size(model));
    assert_false(controller_init(&control, model, work, Rd, 5, 6, why));
    assert_says(why, "one rotation with three inputs");
    lg_model_destroy(model);
    lg_machine weak = true_machine();
    for (uint32_t i = 0; i < weak.term_count; i++)
        if (weak.terms[i].part == LG_MACHINE_INPUT_MAP) weak.terms[i].values[8] = 0;
    model = model_with(&weak, TEST_ARRAY(double, weak.parameters));
    work = test_work(lg_model_work_size(model));
    assert_false(controller_init(&control, model, work, Rd, 5, 6, why));
    assert_says(why, "do not move the body about all axes");
    lg_model_destroy(model);
}

TEST("a run reaches the set point, allocates nothing and takes no lock") {
    fixture *self = make(6.0);
    lg_rng rng;
    trial_result r = {.finite = false};
    const trial_options options = {1e-3, 5.0, 1.0, 0.01};
    lg_counts used = {0, 0, 1};
    samples kept = {TEST_ARRAY(int64_t, 5000), 0, 5000};
    /* OpenBLAS's threads, which start with the process, each take a lock once. */
    for (int attempt = 0; attempt < 5 && used.locks > 0; attempt++) {
        double y[PLANT_STATE];
        lg_rng_seed(&rng, 7, 0);
        plant_start(&rng, 1.0, y);
        kept.count = 0;
        lg_count_begin();
        r = trial_run(&options, &self->truth, &self->control, NULL, y, &kept);
        used = lg_count_end();
    }
    if (lg_count_available()) {
        assert_int_equal(used.allocations, 0);
        assert_int_equal(used.locks, 0);
    }
    assert_true(r.finite && r.worst < 1e-3 && r.arrived < 3.0);
    assert_int_equal(kept.count, 5000);
}

TEST("a filter with noisy sensors holds the attitude, without allocation") {
    fixture *self = make(6.0);
    lg_rng rng = test_rng(9, 0);
    const trial_options options = {1e-3, 5.0, 1.0, 0.01};
    samples kept = {TEST_ARRAY(int64_t, 5000), 0, 5000};
    observer by;
    double y[PLANT_STATE];
    assert_true(observer_create(&by, self->model, self->work, 0.01, 1));
    plant_start(&rng, 1.0, y);
    lg_count_begin();
    const trial_result r = trial_run(&options, &self->truth, &self->control, &by, y, &kept);
    const lg_counts used = lg_count_end();
    observer_destroy(&by);
    if (lg_count_available()) assert_int_equal(used.allocations, 0);
    assert_true(r.finite && r.worst < 0.01 && r.arrived < 3.0);
    assert_true(r.measured > 0.02 && by.worst < 0.002);
}

TEST("quaternions in a log agree with its attitudes, whichever component is largest") {
    lg_rng rng = test_rng(8, 0);
    for (int n = 0; n < 200; n++) {
        double y[PLANT_STATE], q[4], R[9], length = 0;
        plant_start(&rng, 1.0, y);
        quaternion_of(y, q);
        for (int i = 0; i < 4; i++) length += q[i] * q[i];
        assert_close(length, 1, 1e-12, 0);
        const double s = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), a = 2 * atan2(s, q[0]);
        const double v[3] = {a * q[1] / s, a * q[2] / s, a * q[3] / s};
        plant_attitude(v, R);
        assert_all_close(R, y, 9, 1e-12, 1e-12);
    }
}
