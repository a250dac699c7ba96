/* Policies that remember: inputs that act late, and integrals of errors.
 * ctest-labels: src/control src/machine */
#include <unistd.h>

#include "liegrad/ops.h"
#include "support/policies.h"

/* A cart of 2 kg with damping and two motors, the second of them behind a lag. */
static const char cart[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\n"
    "inputs: {columns: [u, w], lag: [none, %g]}\nmass: {kind: known, values: [[2]]}\n"
    "damping: {kind: known, values: [0.5]}\ninput_map: {kind: known, values: [[1, 0.7]]}\n";
enum { INPUTS = 2, PERIODS = 60 };

static lg_policy_task cart_with(const double late[INPUTS], bool integral) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.kind = LG_POLICY_LQR, task.coordinate_count = 2, task.input_count = INPUTS;
    task.coordinate[0] = coordinate("x", "v", LG_POLICY_LINE, 0.5);
    task.coordinate[0].integral = integral;
    task.coordinate[1] = (lg_policy_coordinate){
        .name = "lagged", .follows = 2, .success = INFINITY, .success_velocity = INFINITY};
    task.input[0] = (lg_policy_input){"u", -3.0, 1.0, 0.01};
    task.input[1] = (lg_policy_input){"w", -2.0, 2.0, 0.01};
    task.period = 0.1, task.horizon = 3.0, task.within = 8.0, task.substeps = 4;
    for (int l = 0; l < INPUTS; l++) task.dead_time[l] = late[l] * task.period;
    return task;
}

static lg_policy *make_cart(const double late[INPUTS], bool integral) {
    const lg_policy_task task = cart_with(late, integral);
    lg_policy *policy;
    lg_error error = {LG_OK, ""};
    if (lg_policy_create(NULL, &task, machine_program(test_text(cart, 0.3)), 1, &policy, &error) != LG_OK)
        fail_msg("%s", error.message);
    lg_test_owns(policy, release_policy);
    return policy;
}

static void call(const lg_program *program, const char *function, const double *a, const double *b,
                 double *out) {
    assert_ok(lg_program_eval(NULL, program, function, 1, (const double *const[]){a, b},
                              (double *const[]){out}, NULL));
}

/* The cart by hand: exact solutions over pieces of a period in which the inputs are constant. */
typedef struct world {
    double x, v, a, tau, late[INPUTS], given[PERIODS][INPUTS];
} world;

/* The inputs that act at time s, in periods. */
static void inputs_at(const world *w, double s, double *u) {
    for (int l = 0; l < INPUTS; l++) {
        const double k = floor(s - w->late[l] + 1e-9);
        u[l] = k < 0 ? 0.0 : w->given[(int)k][l];
    }
}

/* 2 v' = u + .7 a - .5 v, tau a' = w - a, by many small steps of the classical method. */
static void move(world *w, int period, double h) {
    enum { STEPS = 1000 };
    const double dt = h / STEPS;
    for (int i = 0; i < STEPS; i++) {
        double u[INPUTS], k[4][3], y[3] = {w->x, w->v, w->a};
        inputs_at(w, period + (i + 0.5) / STEPS, u);
        for (int s = 0; s < 4; s++) {
            const double by = s == 0 ? 0.0 : s == 3 ? dt : 0.5 * dt;
            double z[3];
            for (int j = 0; j < 3; j++) z[j] = y[j] + (s > 0 ? by * k[s - 1][j] : 0.0);
            k[s][0] = z[1], k[s][1] = (u[0] + 0.7 * z[2] - 0.5 * z[1]) / 2, k[s][2] = (u[1] - z[2]) / w->tau;
        }
        for (int j = 0; j < 3; j++) y[j] += dt * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]) / 6;
        w->x = y[0], w->v = y[1], w->a = y[2];
    }
}

/* Runs the policy's control and remember in the world, and the library's closed loop of `plant` next to
 * it. */
static void compare_runs(const lg_policy *policy, const lg_policy *plant, world *w) {
    const lg_program *own = lg_policy_program(policy), *other = lg_policy_program(plant);
    const lg_policy_layout *l = &policy->layout;
    const uint32_t memory = l->given - 1; /* the positions but x */
    double see[LG_POLICY_COORDINATES + 1] = {0}, x[LG_POLICY_COORDINATES + 2],
                                       next[LG_POLICY_COORDINATES + 2], kept[LG_POLICY_COORDINATES], seen[2];
    see[0] = w->x, see[l->given] = w->v;
    call(own, "reset", see, NULL, see + 1);
    call(other, "momenta", see, see + l->given, x);
    for (int k = 0; k < PERIODS; k++) {
        see[0] = w->x, see[l->given] = w->v;
        call(own, "control", see, NULL, w->given[k]);
        call(own, "remember", see, w->given[k], kept);
        memcpy(see + 1, kept, memory * sizeof *see);
        move(w, k, policy->task.period);
        double cost, u[INPUTS];
        assert_ok(lg_program_eval(NULL, other, "closed", 1, (const double *const[]){x},
                                  (double *const[]){next, &cost, u}, NULL));
        assert_all_close(u, w->given[k], INPUTS, 1e-6, 1e-7);
        memcpy(x, next, sizeof x);
        call(other, "positions", x, NULL, next);
        call(other, "velocities", x, NULL, &seen[1]);
        assert_close(next[0], w->x, 1e-6, 1e-7);
        assert_close(seen[1], w->v, 1e-6, 1e-7);
        assert_all_close(next + 1, see + 1, memory, 1e-6, 1e-7);
    }
}

TEST("the closed loop is the motion under inputs that act late, and `remember` gives what `closed` carries") {
    static const double lates[][INPUTS] = {{1, 0}, {0, 1}, {3, 0.4}, {0.25, 2.25}, {2.5, 1.75}};
    for (size_t i = 0; i < LG_COUNT(lates); i++)
        for (int integral = 0; integral < 2; integral++) {
            const lg_policy *p = make_cart(lates[i], integral);
            world w = {.x = 0.45, .v = -0.4, .tau = 0.3, .late = {lates[i][0], lates[i][1]}};
            compare_runs(p, p, &w);
            assert_true(fabs(w.x) < 0.1); /* the regulator knows the late inputs */
        }
}

TEST("on another plant the controller keeps its dead times and its lags") {
    static const double own[][INPUTS] = {{0, 0}, {2, 0.5}, {1.5, 2}},
                        true_ones[][INPUTS] = {{0, 0}, {3, 0}, {0.5, 2.75}};
    for (size_t i = 0; i < LG_COUNT(own); i++)
        for (size_t k = 0; k < LG_COUNT(true_ones); k++) {
            const double dead[INPUTS] = {0.1 * true_ones[k][0], 0.1 * true_ones[k][1]};
            const lg_policy *p = make_cart(own[i], true);
            lg_policy *other;
            lg_error error = {LG_OK, ""};
            if (lg_policy_transplant(p, machine_program(test_text(cart, 0.6)), dead, &other, &error) != LG_OK)
                fail_msg("%s", error.message);
            lg_test_owns(other, release_policy);
            world w = {.x = 0.3, .v = 0.2, .tau = 0.6, .late = {true_ones[k][0], true_ones[k][1]}};
            compare_runs(p, other, &w);
        }
}

/* The cart with friction that has a state. */
static const char bristles[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\n"
    "inputs: {columns: [u, w], lag: [none, 0.6]}\nmass: {kind: known, values: [[2]]}\n"
    "damping: {kind: lugre, values: [0.3, 0.4, 0.1, 50, 1]}\n"
    "input_map: {kind: known, values: [[1, 0.7]]}\n";

/* The costs of 64 runs of a cart from the same starts. */
static void cost_of_runs(const lg_policy *p, bool disturbed, double *cost) {
    enum { N = 64 };
    double x[N * (LG_POLICY_COORDINATES + 2)];
    bool held[N];
    lg_rng rng = test_rng(11, 0);
    assert_ok(lg_policy_starts(p, &rng, N, x, NULL, NULL));
    lg_policy_runs runs = {.count = N, .steps = 20, .x = x, .cost = cost, .succeeded = held};
    assert_ok(lg_policy_run(
        p, &(lg_policy_trial){.theta = p->theta, .disturbed = disturbed, .seed = 3, .threads = 1}, &runs,
        NULL));
}

TEST("disturbances too small to matter, and draws equal to the machine, leave runs on another plant") {
    static const double own[INPUTS] = {1.5, 2}, dead[INPUTS] = {0.3, 0.275};
    double plain[64], same[64];
    lg_error error = {LG_OK, ""};
    const lg_policy *p = make_cart(own, true);
    lg_policy_task by = cart_with((const double[INPUTS]){0, 0}, false);
    lg_policy *other;
    const char *const text = test_text(cart, 0.6);
    assert_ok(lg_policy_transplant(p, machine_program(text), dead, &other, NULL));
    lg_test_owns(other, release_policy);
    by.coordinate[0].noise = 1e-300; /* the task does not have what the controller remembers */
    by.draws = 2;
    assert_ok(lg_policy_disturb(other, &by, NULL));
    cost_of_runs(other, false, plain);
    cost_of_runs(other, true, same);
    assert_all_close(same, plain, 64, 1e-12, 0.0);
    assert_ok(lg_policy_add_draw(other, machine_program(text), NULL));
    cost_of_runs(other, true, same);
    assert_all_close(same, plain, 64, 1e-12, 0.0);
    assert_status(lg_policy_add_draw(other, machine_program(bristles), &error), LG_SHAPE);
    assert_says(error.message, "the other machine's state has");
    by.coordinate[0].name[0] = 'y';
    assert_status(lg_policy_disturb(other, &by, &error), LG_SHAPE);
}

TEST("an integral grows by the error, and stops while an input is at a limit") {
    const lg_policy *p = make_cart((const double[INPUTS]){0, 0}, true);
    const double x[] = {0.3, 0, 0.25, 0}; /* x, lagged, integral, v */
    static const struct {
        double u[INPUTS], part;
    } rows[] = {{{-1, 0}, 1}, {{1, 0}, 0}, {{-3, 0}, 0}, {{-1, 2}, 0}, {{0, 0}, 1 - 1.0 / 65536}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double next[2];
        call(lg_policy_program(p), "remember", x, rows[i].u, next);
        assert_close(next[1], 0.25 + 0.1 * 0.3 * rows[i].part, 1e-12, 1e-14);
    }
}

TEST("an integral removes the offset of a force that the controller does not know") {
    static const char pushed[] = "offset: {kind: known, values: [-0.3]}\n";
    double ends[2];
    for (int integral = 0; integral < 2; integral++) {
        const lg_policy *p = make_cart((const double[INPUTS]){2, 0}, integral);
        lg_policy *other;
        const char *const text = test_text(cart, 0.3);
        assert_ok(
            lg_policy_transplant(p, machine_program(test_text("%s%s", text, pushed)), NULL, &other, NULL));
        lg_test_owns(other, release_policy);
        double z[8] = {0}, x[8];
        bool held;
        assert_ok(lg_policy_states(other, z, 1, x, NULL));
        lg_policy_runs runs = {.count = 1, .steps = 800, .x = x, .succeeded = &held};
        assert_ok(lg_policy_run(other, &(lg_policy_trial){.theta = other->theta, .threads = 1}, &runs, NULL));
        call(lg_policy_program(other), "errors", x, NULL, z);
        ends[integral] = fabs(z[0]);
    }
    print_message("%g without, %g with an integral\n", ends[0], ends[1]);
    assert_true(ends[0] > 1e-3 && ends[1] < 1e-6 * ends[0]);
}

/* z = (x, lagged, past.u, past.w.1, past.w.2, integral; v), the goal of all positions is 0. */
TEST("the loop of certificates has lags, inputs of earlier periods and integrals as states") {
    const lg_policy *p = make_cart((const double[INPUTS]){1, 2}, true);
    const uint32_t n = p->layout.errors, m = p->layout.positions;
    lg_program *program;
    lg_rng rng = test_rng(5, 0);
    double z[8], next[8], x[8], v, cost, u[INPUTS], seen[8], held[INPUTS + 4], rate[8];
    assert_int_equal(n, 7);
    assert_ok(lg_policy_add_rate((lg_policy *)(uintptr_t)p, &program, NULL));
    for (uint32_t i = 0; i < n; i++) z[i] = 0.5 * lg_rng_normal(&rng);
    call(program, "momenta", z, z + m, x);
    for (int k = 0; k < 30; k++) {
        call(program, "advance", z, NULL, next);
        call(program, "input_by_state", z, NULL, held);
        assert_true(held[0] == z[2] && held[1] == z[4]);
        call(program, "rate_by_input", z, held, rate);
        assert_close(rate[3] * p->task.period, next[3] - z[3], 1e-12, 1e-13);
        assert_ok(lg_program_eval(NULL, program, "closed", 1, (const double *const[]){x},
                                  (double *const[]){x, &cost, u}, NULL));
        call(program, "positions", x, NULL, seen);
        call(program, "velocities", x, NULL, &v);
        assert_all_close(next, seen, m, 1e-5, 1e-6); /* two integrators */
        assert_close(next[m], v, 1e-5, 1e-6);
        assert_all_close(next + 2, u, INPUTS, 1e-5, 1e-6);
        memcpy(z, next, sizeof z);
    }
}

TEST("a file keeps the memory, and certificates say that they do not cover parts of periods") {
    lg_policy *p = make_cart((const double[INPUTS]){1.5, 0}, true), *read;
    const char *const path = "test_policy_memory.h5";
    lg_program *program;
    lg_error error;
    static const char task[] =
        "plant: cart\nperiod: 0.1\nhorizon: 3\nstarts: {x: [-0.5, 0.5]}\nlimits: {u: [-3, 1], w: 2}\n"
        "cost: {x: 1, v: 0.1, u: 0.01, w: 0.01}\nsuccess: {x: 0.1, hold: 1, within: 8}\ncontroller: {kind: "
        "lqr}\nintegral: [x]\n";
    assert_ok(lg_policy_save(NULL, path, p, task, NULL, NULL));
    if (lg_policy_load(NULL, path, NULL, &read, NULL, &error) != LG_OK) fail_msg("%s", error.message);
    lg_test_owns(read, release_policy);
    assert_true(read->state == p->state && memcmp(&read->memory, &p->memory, sizeof p->memory) == 0);
    world w = {.x = 0.3, .v = 0.2, .tau = 0.3, .late = {1.5, 0}};
    compare_runs(p, read, &w);
    assert_status(lg_policy_add_rate(read, &program, &error), LG_UNSUPPORTED);
    assert_says(error.message,
                "the input u acts 1.5 periods late, and this certificate does not cover a part");
}

/* `control` or `closed`, with an input that is a little larger. */
static lg_status record_larger(void *closed, lg_tape *tape, const lg_var *theta, const lg_var *in,
                               lg_var *out) {
    lg_var seen[2] = {in[0], LG_NONE};
    if (closed != NULL) {
        for (int i = 0; i < 2; i++)
            seen[i] = lg_program_call(tape, i == 0 ? "positions" : "velocities", 0, in);
    } else {
        const uint32_t n = lg_var_shape(tape, in[0]).dims[1] - 1;
        seen[0] = lg_slice(tape, in[0], 1, 0, n), seen[1] = lg_slice(tape, in[0], 1, n, 1);
    }
    const lg_var u = lg_scale(tape, lg_program_call(tape, "policy", 0, seen), 1.0001);
    out[closed != NULL ? 2 : 0] = u;
    if (closed == NULL) return lg_tape_status(tape);
    out[0] = lg_program_call(tape, "period", 0, (const lg_var[]){in[0], u});
    out[1] = lg_slice(tape, u, 1, 0, 1);
    return lg_tape_status(tape);
}

/* The program of `own` with one function of `other`. */
static lg_program *mixed(const lg_program *own, const lg_program *other, const char *function) {
    lg_program_spec spec;
    lg_program *out;
    lg_program_spec_init(&spec);
    assert_ok(lg_program_begin(NULL, &spec, &out, NULL));
    for (size_t f = 0; f < lg_program_functions(own); f++) {
        const bool taken = strcmp(lg_program_function_name(own, f), function) == 0,
                   closed = strcmp(function, "closed") == 0;
        if (taken && (closed || strcmp(function, "control") == 0)) { /* its image only calls others */
            size_t ins, outs;
            const lg_port *in = lg_program_inputs(own, f, &ins), *of = lg_program_outputs(own, f, &outs);
            const lg_function_spec larger = {function, in, ins, of, outs, record_larger, closed ? out : NULL};
            assert_ok(lg_program_add_function(out, &larger, NULL));
            continue;
        }
        lg_function_image *image;
        assert_ok(lg_function_image_create(taken ? other : own, f, &image));
        assert_ok(lg_program_add_image(out, image, NULL));
        lg_function_image_destroy(image);
    }
    return out;
}

static const char task[] =
    "plant: cart\nperiod: 0.1\nhorizon: 3\nstarts: {x: [-0.5, 0.5]}\nlimits: {u: [-3, 1], w: 2}\n"
    "cost: {x: 1, v: 0.1, u: 0.01, w: 0.01}\nsuccess: {x: 0.1, hold: 1, within: 8}\ncontroller: {kind: "
    "lqr}\nintegral: [x]\n";

/* Exchanges operations that follow each other and do not depend on each other, where the next pair begins
 * behind them. Returns how many pairs were exchanged. `places`: memory for all inputs and outputs. */
enum { PLACES = 16384 };
static size_t exchange(lg_function_image *image, uint32_t *places) {
    size_t pairs = 0;
    const size_t n = image->operation_count;
    uint32_t place[4096];
    size_t all = image->output_count;
    for (size_t i = 0; i < n; i++) all += image->operations[i].input_count;
    assert_true(n <= LG_COUNT(place) && all <= PLACES);
    for (uint32_t i = 0; i < n; i++) place[i] = i;
    for (size_t i = 0; i + 1 < n; i++) {
        const lg_operation first = image->operations[i], next = image->operations[i + 1];
        bool free = strcmp(first.name, "input") != 0 && strcmp(next.name, "input") != 0;
        for (uint32_t k = 0; k < next.input_count; k++) free = free && next.inputs[k] != i;
        if (!free) continue;
        image->operations[i] = next, image->operations[i + 1] = first;
        place[i] = (uint32_t)i + 1, place[i + 1] = (uint32_t)i;
        pairs++, i++;
    }
    for (size_t i = 0; i < n; i++) {
        lg_operation *o = &image->operations[i];
        for (uint32_t k = 0; k < o->input_count; k++) places[k] = place[o->inputs[k]];
        o->inputs = places, places += o->input_count;
    }
    for (size_t k = 0; n > 0 && k < image->output_count; k++) places[k] = place[image->results[k]];
    if (n > 0) image->results = places;
    return pairs;
}

TEST("a file is accepted whose operations are in another order, as another compiler records them") {
    const char *const path = "test_policy_order.h5";
    const double late[INPUTS] = {1.5, 0};
    lg_policy *p = make_cart(late, true), *read;
    lg_error error = {LG_OK, ""};
    lg_program *own = p->program, *other;
    lg_program_spec spec;
    size_t pairs = 0;
    lg_program_spec_init(&spec);
    assert_ok(lg_program_begin(NULL, &spec, &other, NULL));
    for (size_t f = 0; f < lg_program_functions(own); f++) {
        uint32_t places[PLACES];
        lg_function_image *image;
        assert_ok(lg_function_image_create(own, f, &image));
        pairs += exchange(image, places);
        assert_ok(lg_program_add_image(other, image, &error));
        lg_function_image_destroy(image);
    }
    assert_true(pairs > 10);
    p->program = other;
    assert_ok(lg_policy_save(NULL, path, p, task, NULL, NULL));
    p->program = own;
    lg_program_destroy(other);
    if (lg_policy_load(NULL, path, NULL, &read, NULL, &error) != LG_OK) fail_msg("%s", error.message);
    lg_policy_destroy(read);
}

TEST("a file in which one of the functions was changed is not accepted") {
    static const char *const changed[] = {"control", "policy", "closed", "regulated"};
    const char *const path = "test_policy_changed.h5";
    const double late[INPUTS] = {1.5, 0};
    lg_policy_task wider = cart_with(late, true);
    wider.input[0].low = -0.1, wider.input[0].high = 0.05;
    for (size_t i = 0; i < LG_COUNT(changed); i++) {
        lg_policy *p = make_cart(late, true), *other, *read;
        lg_error error = {LG_OK, ""};
        assert_ok(lg_policy_create(NULL, &wider, machine_program(test_text(cart, 0.4)), 2, &other, &error));
        lg_test_owns(other, release_policy);
        lg_program *own = p->program;
        p->program = mixed(own, other->program, changed[i]);
        assert_ok(lg_policy_save(NULL, path, p, task, NULL, NULL));
        lg_program_destroy(p->program);
        p->program = own;
        assert_status(lg_policy_load(NULL, path, NULL, &read, NULL, &error), LG_FORMAT);
        assert_says(error.message, "one of them was changed");
    }
}

/* The bytes of a function, which the caller frees. */
static char *packed(const lg_program *program, const char *function, size_t *size) {
    lg_function_image *image;
    size_t at;
    assert_ok(lg_program_find(program, function, &at, NULL));
    assert_ok(lg_function_image_create(program, at, &image));
    assert_ok(lg_function_pack(image, NULL, size, NULL));
    char *bytes = malloc(*size);
    assert_non_null(bytes);
    assert_ok(lg_function_pack(image, bytes, size, NULL));
    lg_function_image_destroy(image);
    return bytes;
}

TEST("derivatives are made anew when a policy is loaded: a changed derivative of its file is not used") {
    static const char *const changed[] = {"adj1_closed", "jac_linear"};
    const char *const path = "test_policy_derivative.h5";
    const double late[INPUTS] = {1.5, 0};
    lg_policy_task wider = cart_with(late, true);
    wider.input[0].low = -0.1, wider.input[0].high = 0.05;
    for (size_t i = 0; i < LG_COUNT(changed); i++) {
        lg_policy *p = make_cart(late, true), *other, *read;
        size_t size[3];
        assert_ok(lg_policy_create(NULL, &wider, machine_program(test_text(cart, 0.4)), 2, &other, NULL));
        lg_test_owns(other, release_policy);
        lg_program *own = p->program, *file = mixed(own, other->program, changed[i]);
        char *right = packed(own, changed[i], &size[0]), *wrong = packed(file, changed[i], &size[1]);
        p->program = file;
        assert_ok(lg_policy_save(NULL, path, p, task, NULL, NULL));
        p->program = own;
        lg_program_destroy(file);
        assert_ok(lg_policy_load(NULL, path, NULL, &read, NULL, NULL));
        char *taken = packed(read->program, changed[i], &size[2]);
        assert_true(size[1] != size[0] || memcmp(wrong, right, size[0]) != 0);
        assert_int_equal(size[2], size[0]);
        assert_memory_equal(taken, right, size[0]);
        free(right), free(wrong), free(taken);
        lg_policy_destroy(read);
    }
}
