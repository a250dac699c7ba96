/* Exports controllers of lg-control: self-tests with a closed loop, and what an observer and an adaptation
 * find, against the library's filter and against plants that differ from the machine.
 * ctest-labels: apps/lg-export src/control */
#include "export_support.h"

#include "liegrad/control.h"
#include "liegrad/machine.h"
#include "liegrad/policy.h"
#include "liegrad/program.h"

static const export_way few[] = {{"gcc", "-O2"}, {"g++", "-O1"}, {"clang", "-O0"}};

/* ---- machines and tasks ---- */

static const char cart[] =
    "system: cart-pole\n"
    "parameters: {cart: %g, pole: 0.1, length: 1, gravity: 9.81}\n"
    "coordinates: [{name: x, kind: line, velocity: vx}, {name: theta, kind: angle, velocity: w}]\n"
    "inputs: {columns: [u]}\ninput_map: {kind: known, values: [[1], [0]]}\n%s";
static const char cart_task[] =
    "plant: %s.yaml\ngoal: {x: 0, theta: 0}\nperiod: 0.05\nhorizon: 3\n"
    "starts: {x: [-1, 1], theta: [%g, %g], vx: [-1, 1], w: [-0.5, 0.5]}\nlimits: {u: 10}\n"
    "cost: {x: 0.5, theta: 2, vx: 0.1, w: 0.1, u: 0.01}\n"
    "success: {theta: 0.05, hold: 1, within: 10}\ncontroller: {kind: %s}\n";

/* Linear: constant mass with a coupling, and damping. */
static const char linear[] =
    "coordinates: [{name: x, kind: line, velocity: vx}, {name: a, kind: angle, velocity: w}]\n"
    "inputs: {columns: [u, f]}\nmass: {kind: known, values: [[2, 0.3], [0.3, 0.5]]}\n"
    "potential: {kind: none}\n"
    "damping: {kind: known, values: [0.4, 0.1]}\n"
    "input_map: {kind: known, values: [[1, 0], [0.7, 1]]}\n";
static const char body[] =
    "coordinates: [{name: b, kind: rotation, columns: [qw, qx, qy, qz], velocity: [wx, wy, wz]}]\n"
    "inputs: {columns: [tx, ty, tz]}\n"
    "mass: {kind: known, values: [[1, 0, 0], [0, 2, 0], [0, 0, 3]]}\npotential: {kind: none}\n"
    "damping: {kind: none}\n"
    "input_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n";
static const char body_task[] = "plant: body.yaml\ngoal: {b: [1, 0, 0, 0]}\nperiod: 0.1\nhorizon: 5\n"
                                "starts: {b: [0, 3], vb: [-1, 1]}\nlimits: {tx: 2, ty: 2, tz: 2}\n"
                                "cost: {b: 1, vb: 0.1, tx: 0.01, ty: 0.01, tz: 0.01}\n"
                                "success: {b: 0.05, hold: 1, within: 10}\ncontroller: {kind: lqr}\n";

/* Saves NAME.h5, which a test may have made before. */
static void train(const char *name, const char *task) {
    if (cli_exists(test_text("%s.h5", name))) return;
    cli_write(test_text("%s-task.yaml", name), task);
    cli_run("lg-control",
            "train %s-task.yaml --out %s.h5 --seeds 1 --race 2 --finish 2 --polish 1 --optimality-gap 0 "
            "--robustness 0",
            name, name);
}

/* Saves NAME.h5 for a cart-pole with a cart of this mass and more terms; it starts near the upper position.
 * */
static void make_cart(const char *name, double mass, const char *more, const char *kind) {
    cli_write(test_text("%s.yaml", name), test_text(cart, mass, more));
    train(name, test_text(cart_task, name, -0.3, 0.3, kind));
}

/* ---- the library's numbers ---- */

static lg_program *program;
RELEASES(release_program, lg_program_destroy)

static void load(const char *name) {
    assert_told(lg_program_load(NULL, cli_at(test_text("%s.h5", name)), NULL, &program, &told));
    lg_test_owns(program, release_program);
}

static void evaluate(const char *function, const double *a, const double *b, double *out) {
    assert_told(lg_program_eval(NULL, program, function, 1, (const double *const[]){a, b},
                                (double *const[]){out}, &told));
}

/* x (plant) after a period under u; seen: positions and velocities of it. */
static void move(double *x, const double *u, double *seen, size_t positions) {
    double next[16];
    evaluate("period", x, u, next);
    memcpy(x, next, 2 * positions * sizeof *x);
    evaluate("positions", x, NULL, seen);
    evaluate("velocities", x, NULL, seen + positions);
}

/* ---- control ---- */

TEST("a controller is exported in both types, with a closed loop in its self-test") {
    static char out[EXPORT_TEXT];
    make_cart("cart", 1, "", "network, hidden: [8]");
    static const char *const types[] = {"f64", "f32"};
    for (size_t i = 0; i < LG_COUNT(types); i++) {
        cli_expect("lg-export", test_text("cart.h5 --out %s --name cp --dtype %s", types[i], types[i]), 0,
                   "");
        export_check_each(types[i], "cp", few, LG_COUNT(few));
        export_check_objects(types[i], "cp");
        export_expect(test_text("%s/test-0 | grep -q '^closed loop .* ok'", types[i]));
    }
    export_expect("make -s -C f64 stack CC=gcc CFLAGS=-O0");
    static const char *const words[] = {
        "(4) positions as in the log, x theta (rad), then velocities vx w",
        "(1) u from -10 to 10; to be held for a period of 0.05 s", "goal          x 0 theta 0",
        "void cp_control(const cp_real \\*x, cp_real \\*u, cp_real \\*work);", "#define cp_PERIOD 0.05"};
    for (size_t i = 0; i < LG_COUNT(words); i++)
        if (export_shell(test_text("tr -d '\\n' < f64/cp.h | sed 's/ \\*  */ /g' | grep -q '%s'", words[i]),
                         out) != 0)
            fail_msg("the header lacks: %s", words[i]);
    assert_int_not_equal(export_shell("grep -q 'cp_policy\\|cp_momenta' f64/cp.h", out), 0);

    load("cart");
    export_library lib = export_open("f64", "cp", "gcc", "-O2");
    static const double x[] = {0.4, 2.5, -0.8, 1.5};
    double u[2];
    evaluate("control", x, NULL, u);
    export_call(&lib, "control", 2, (export_port[]){EXPORT_IN(x, 4), EXPORT_OUT(u + 1, 1)});
    assert_close(u[1], u[0], 1e-13, 0);
    export_close(&lib);
}

/* A wrong number of the weights, a wrong sign of the velocities and of the input, an input that is too
 * large. */
TEST("the closed loop finds planted errors") {
    static char out[EXPORT_TEXT];
    static const char *const plants[] = {
        "awk '!n && /^    -?[0-9]/ { sub(/[0-9]/, \"8\"); n = 1 } 1' good/cp_weights.c > bad/cp_weights.c",
        "sed 's/seen\\[i\\] = (real)/seen[i] = (i < 2 ? 1 : -1) * (real)/' good/cp_test.c > bad/cp_test.c",
        "sed 's/held\\[i\\] = (double)u/held[i] = -(double)u/' good/cp_test.c > bad/cp_test.c",
        "sed 's/^    u\\[0\\] = \\|y0\\[0\\] = /&REAL(1.001) * /' good/cp.c > bad/cp.c"};
    make_cart("cart", 1, "", "network, hidden: [8]");
    export_run("cart.h5 --out good --name cp --dtype f32");
    for (size_t i = 0; i < LG_COUNT(plants); i++) {
        export_expect(
            test_text("rm -rf bad && cp -r good bad && %s && ! diff -rq good bad >/dev/null", plants[i]));
        const int code =
            export_shell("cd bad && gcc -O1 *.c -lm -o t && ! ./t | grep 'closed loop.*WRONG'", out);
        if (code == 0 || strstr(out, "WRONG") == NULL) fail_msg("%s passed:\n%s", plants[i], out);
    }
}

TEST("a controller of a body takes quaternions") {
    cli_write("body.yaml", body);
    train("body", body_task);
    export_run("body.h5 --out body --name body");
    export_check_each("body", "body", few, 1);
    export_expect("grep -q 'b (quaternion w x y z, 4), then velocities vb (3)' body/body.h");
}

TEST("a controller with late inputs, a lag, an integral and compensation passes its own test as C") {
    cli_write("late.yaml", "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: "
                           "{columns: [u], lag: 0.2, delay: 2}\nmass: {kind: known, values: [2]}\n"
                           "damping: [{kind: known, values: [0.5]}, {kind: coulomb, values: [0.4]}]\n"
                           "input_map: {kind: known, values: [3]}\n");
    train("late",
          "plant: late.yaml\nperiod: 0.1\nhorizon: 3\nstarts: {x: [-1, 1], v: [-1, 1]}\nlimits: {u: "
          "2}\ncost: {x: 1, v: 0.1, u: 0.01}\nsuccess: {x: 0.05, hold: 1, within: 10}\nintegral: [x]\n"
          "compensate: true\ncontroller: {kind: network, hidden: [8]}\n");
    export_run("late.h5 --out late --name late");
    export_check_each("late", "late", few, LG_COUNT(few));
    export_expect("grep -q 'x, lagged inputs lagged.u, past inputs past.u.1 past.u.2' late/late.h && "
                  "grep -q 'integrals integral.x, then velocities v' late/late.h");
    export_expect("grep -q 'late_remember(const' late/late.h && grep -q 'late_reset(const' late/late.h");
}

TEST("control and the lagged input that the C computes follow the plant for 100 periods") {
    cli_write("slow.yaml", "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: "
                           "{columns: [u], lag: {order: 2, value: 0.3}}\nmass: {kind: known, values: [2]}\n"
                           "damping: {kind: known, values: [0.5]}\noffset: {kind: known, values: [-6]}\n"
                           "input_map: {kind: known, values: [3]}\n");
    train("slow", "plant: slow.yaml\nperiod: 0.1\nhorizon: 3\nstarts: {x: [-1, 1], v: [-1, 1]}\nlimits: {u: "
                  "[-2, 6]}\ncost: {x: 1, v: 0.1, u: 0.01}\nsuccess: {x: 0.05, hold: 1, within: "
                  "10}\ncontroller: {kind: network, hidden: [8]}\n");
    export_run("slow.h5 --out slow --name slow");
    export_check_each("slow", "slow", few, LG_COUNT(few));
    export_expect("grep -q 'as in the log, x, lagged inputs lagged.u.1 lagged.u.2, then' slow/slow.h");
    load("slow");
    export_library lib = export_open("slow", "slow", "gcc", "-O2");
    double x[4], seen[4] = {0.8, 0, 0, 0.5}, a[2] = {0, 0};
    assert_told(lg_program_eval(NULL, program, "momenta", 1, (const double *const[]){seen, seen + 3},
                                (double *const[]){x}, &told));
    for (int k = 0; k < 100; k++) {
        double u, next[4];
        memcpy(seen + 1, a, sizeof a);
        export_call(&lib, "control", 2, (export_port[]){EXPORT_IN(seen, 4), EXPORT_OUT(&u, 1)});
        export_call(&lib, "lagged", 3,
                    (export_port[]){EXPORT_IN(a, 2), EXPORT_IN(&u, 1), EXPORT_OUT(next, 2)});
        memcpy(a, next, sizeof a);
        evaluate("period", x, &u, next);
        memcpy(x, next, sizeof x);
        evaluate("positions", x, NULL, seen);
        evaluate("velocities", x, NULL, seen + 3);
        assert_all_close(a, seen + 1, 2, 1e-12, 1e-12);
    }
    assert_close(seen[0], 0, 0, 0.05);
    export_close(&lib);
}

TEST("the number of a free position changes no input, and the self-tests of all functions pass") {
    cli_write("drive.yaml", test_text(cart, 1.0, "damping: {kind: known, values: [0.1, 0.01]}\n"));
    train("drive",
          "plant: drive.yaml\nperiod: 0.05\nhorizon: 3\nstarts: {x: [-1, 1], theta: [-0.3, 0.3], vx: "
          "[-1, 1]}\nlimits: {u: 10}\ncost: {theta: 2, vx: 0.1, w: 0.1, u: 0.01}\nsuccess: {theta: "
          "0.05, vx: 0.1, hold: 1, within: 10}\ncontroller: {kind: network, hidden: [8]}\nfree: "
          "[x]\n");
    export_run("drive.h5 --out drive --name drive --functions control,observe,adapt");
    export_check_each("drive", "drive", few, LG_COUNT(few));
    export_expect("tr -d '\\n' < drive/drive.h | sed 's/ \\*  */ /g' | grep -q 'x (free: any finite "
                  "number) theta (rad)' && grep -q 'x anywhere theta 0' drive/drive.h");
    double x[] = {0.4, 0.2, -0.8, 0.5}, u[2];
    load("drive");
    evaluate("control", x, NULL, u);
    export_library lib = export_open("drive", "drive", "gcc", "-O1");
    x[0] = 7e8;
    export_call(&lib, "control", 2, (export_port[]){EXPORT_IN(x, 4), EXPORT_OUT(u + 1, 1)});
    assert_close(u[1], u[0], 1e-13, 0);
    export_close(&lib);
}

TEST("observer and adaptation are refused for other plants than lines and angles") {
    cli_write("body.yaml", body);
    train("body", body_task);
    cli_expect("lg-export", "body.h5 --out no --functions control,observe", 2, "'b' is a rotation");
    cli_expect("lg-export", "body.h5 --out no --functions adapt", 2, "'b' is a rotation");
    make_cart("lqr", 1, "", "lqr");
    cli_expect("lg-export", "lqr.h5 --out no --functions observe --sensor 1,2,3", 2, "one for each position");
    cli_expect("lg-export", "lqr.h5 --out no --functions control,nothing", 2, "nothing");
    cli_expect("lg-export", "lqr.h5 --out no --target onnx --functions observe", 2, "observe");
}

/* ---- other targets ---- */

/* Sets x, variables 0 to 3 of the FMU of version 2, and gets its output, variable 4. */
static void call_fmu(const double *x, double *u) {
    static char guid[EXPORT_TEXT];
    static const unsigned in[] = {0, 1, 2, 3}, out[] = {4};
    void *handle = dlopen(cli_at("fmu2/cp.so"), RTLD_NOW | RTLD_LOCAL);
    if (handle == NULL) fail_msg("%s", dlerror());
    void *(*instantiate)(const char *, int, const char *, const char *, const void *, int, int);
    int (*set)(void *, const unsigned *, size_t, const double *);
    int (*get)(void *, const unsigned *, size_t, double *);
    int (*initialise)(void *);
    void (*release)(void *);
    *(void **)&instantiate = dlsym(handle, "fmi2Instantiate");
    *(void **)&set = dlsym(handle, "fmi2SetReal");
    *(void **)&get = dlsym(handle, "fmi2GetReal");
    *(void **)&initialise = dlsym(handle, "fmi2EnterInitializationMode");
    *(void **)&release = dlsym(handle, "fmi2FreeInstance");
    assert_int_equal(
        export_shell("sed -n 's/.* guid=\"\\([^\"]*\\)\".*/\\1/p' fmu2/modelDescription.xml | tr -d '\\n'",
                     guid),
        0);
    void *instance = instantiate("a", 1, guid, NULL, NULL, 0, 0);
    assert_non_null(instance);
    assert_int_equal(set(instance, in, 4, x), 0);
    assert_int_equal(initialise(instance), 0);
    assert_int_equal(get(instance, out, 1, u), 0);
    release(instance);
    assert_int_equal(dlclose(handle), 0);
}

TEST("CasADi and FMUs get a controller as a map from x to u") {
    static const double x[] = {0.4, 2.5, -0.8, 1.5};
    static double w[4096];
    double u[2];
    make_cart("cart", 1, "", "network, hidden: [8]");
    load("cart");
    evaluate("control", x, NULL, u);
    static const char *const targets[] = {"casadi", "fmu2", "fmu3"};
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        cli_expect("lg-export", test_text("cart.h5 --out %s --name cp --target %s", targets[i], targets[i]),
                   0, "");
        export_expect(test_text("make -s -C %s CFLAGS=-O1 all test", targets[i]));
    }
    export_expect("grep -q 'name=\"control\".*causality=\"output\"' fmu2/modelDescription.xml && "
                  "! grep -q '<Derivatives>\\|der(' fmu2/modelDescription.xml");
    void *handle = dlopen(cli_at("casadi/libcp.so"), RTLD_NOW | RTLD_LOCAL);
    if (handle == NULL) fail_msg("%s", dlerror());
    int (*control)(const double **, double **, long long *, double *, int) = NULL;
    *(void **)&control = dlsym(handle, "cp_control");
    if (control == NULL) *(void **)&control = dlsym(handle, "control");
    assert_non_null(control);
    assert_int_equal(control((const double *[]){x}, (double *[]){&u[1]}, NULL, w, 0), 0);
    assert_close(u[1], u[0], 1e-13, 0);
    assert_int_equal(dlclose(handle), 0);
    call_fmu(x, &u[1]);
    assert_close(u[1], u[0], 1e-13, 0);
}

/* ---- the observer ---- */

static double pairs[4][4]; /* M diag(s^2) M^T for momenta, s^2 for positions */

static double *covariance(const double *position, const double *velocity) {
    static const double M[2][2] = {{2, 0.3}, {0.3, 0.5}};
    memset(pairs, 0, sizeof pairs);
    for (int i = 0; i < 2; i++) {
        pairs[i][i] = position[i] * position[i];
        for (int j = 0; j < 2; j++)
            for (int k = 0; k < 2; k++) pairs[2 + i][2 + j] += M[i][k] * velocity[k] * velocity[k] * M[j][k];
    }
    return pairs[0];
}

static lg_ekf *library_filter(lg_model *model, const double *y, void *memory, size_t bytes) {
    static const double sensor[] = {0.01, 0.02}, none[2] = {0, 0}, drift[] = {0.3, 0.2}, first[] = {1, 1.5};
    const lg_sensor sensors[] = {{LG_SENSOR_STATE, 0, 0.01, 0},
                                 {LG_SENSOR_STATE, 1, 0.02, 2 * 3.14159265358979324}};
    double P[16], W[16];
    const double state[] = {y[0], y[1], 0, 0};
    lg_ekf_options options;
    lg_ekf *ekf;
    lg_ekf_options_init(&options);
    memcpy(P, covariance(sensor, first), sizeof P);
    memcpy(W, covariance(none, drift), sizeof W);
    options.scheme = lg_scheme_find("rkmk4"), options.state = state, options.P = P, options.W = W;
    options.sensors = sensors, options.sensor_count = 2;
    assert_told(lg_ekf_init(model, &options, &ekf, memory, bytes, &told));
    return ekf;
}

RELEASES(release_model, lg_model_destroy)

/* The plant is linear, so both filters are the Kalman filter: they differ by rounding alone. One angle is a
 * turn off. */
TEST("the observer is the library's filter") {
    static const char task[] =
        "plant: linear.yaml\ngoal: {x: 0, a: 0}\nperiod: 0.05\nhorizon: 3\n"
        "starts: {x: [-1, 1], a: [-1, 1], vx: [-1, 0.5], w: [-1, 1.5]}\nlimits: {u: 3, f: 3}\n"
        "cost: {x: 1, a: 1, vx: 0.1, w: 0.1, u: 0.1, f: 0.1}\nsuccess: {vx: 9, hold: 1, within: 5}\n"
        "controller: {kind: lqr}\n";
    lg_machine_file file = {.column_count = 0};
    lg_program *plant;
    lg_model *model;
    lg_space space;
    cli_write("linear.yaml", linear);
    train("linear", task);
    export_run(
        "linear.h5 --out linear --name l --functions control,observe --sensor 0.01,0.02 --drift 0.3,0.2");
    export_check_each("linear", "l", few, 2);
    assert_told(lg_machine_file_read(NULL, cli_at("linear.yaml"), &file, &told));
    assert_told(lg_machine_program(NULL, &file.machine, NULL, lg_scheme_find("rkmk4"), false, &plant, &told));
    assert_ok(lg_machine_space(&file.machine, &space));
    assert_told(lg_model_create(NULL, plant, &space, &model, &told));
    lg_test_owns(model, release_model);
    load("linear");
    export_library lib = export_open("linear", "l", "gcc", "-O2");
    double memory[20], x[4] = {0.5, -0.4, 1, 0.2}, seen[4], got[4], want[4];
    double y[2] = {0.5, -0.4};
    const size_t bytes = lg_ekf_size(model, lg_scheme_find("rkmk4"), 2);
    void *room = aligned_alloc(64, (bytes + 63) / 64 * 64);
    lg_ekf *ekf = library_filter(model, y, room, bytes);
    lg_rng rng = test_rng(3, 7);
    export_call(&lib, "observe_start", 2, (export_port[]){EXPORT_IN(y, 2), EXPORT_OUT(memory, 20)});
    for (int k = 0; k < 60; k++) {
        const double u[2] = {sin(0.3 * k), cos(0.2 * k)};
        move(x, u, seen, 2);
        for (int i = 0; i < 2; i++) y[i] = seen[i] + 0.01 * lg_rng_normal(&rng);
        if (k == 20) y[1] += 2 * 3.14159265358979324;
        assert_ok(lg_ekf_predict(ekf, 0.05, u));
        assert_ok(lg_ekf_update(ekf, y, NULL));
        export_call(
            &lib, "observe", 4,
            (export_port[]){EXPORT_IN(y, 2), EXPORT_IN(u, 2), EXPORT_OUT(memory, 20), EXPORT_OUT(got, 4)});
        memcpy(want, lg_ekf_state(ekf), sizeof want);
        assert_told(lg_program_eval(NULL, program, "velocities", 1,
                                    (const double *const[]){lg_ekf_state(ekf)}, (double *const[]){want + 2},
                                    &told));
        for (int i = 0; i < 4; i++) assert_close(got[i], want[i], 0, 1e-10);
    }
    for (int i = 0; i < 4; i++) assert_close(got[i], seen[i], 0, 0.15);
    free(room);
    export_close(&lib);
    lg_machine_file_destroy(&file);
}

TEST("an observer that gets no measurement predicts, and no input changes nothing") {
    make_cart("lqr", 1, "", "lqr");
    export_run("lqr.h5 --out lqr --name cp --functions observe");
    load("lqr");
    export_library lib = export_open("lqr", "cp", "gcc", "-O2");
    static const double lost[] = {NAN, NAN}, u[] = {2}, unfit[] = {NAN};
    double memory[20], before[20], got[4], plant[4] = {0.1, 0.2, 0, 0}, seen[4];
    export_call(&lib, "observe_start", 2, (export_port[]){EXPORT_IN(plant, 2), EXPORT_OUT(memory, 20)});
    export_call(
        &lib, "observe", 4,
        (export_port[]){EXPORT_IN(lost, 2), EXPORT_IN(u, 1), EXPORT_OUT(memory, 20), EXPORT_OUT(got, 4)});
    move(plant, u, seen, 2);
    for (int i = 0; i < 4; i++) assert_close(got[i], seen[i], 0, 1e-12);
    memcpy(before, memory, sizeof before);
    export_call(
        &lib, "observe", 4,
        (export_port[]){EXPORT_IN(seen, 2), EXPORT_IN(unfit, 1), EXPORT_OUT(memory, 20), EXPORT_OUT(got, 4)});
    for (int i = 0; i < 20; i++) assert_close(memory[i], before[i], 0, 0);
    export_close(&lib);
}

/* ---- the adaptation ---- */

/* The plant's cart is heavier by 0.6 and has friction. NAME_adapt sees the closed loop, whose input has a
 * dither. */
TEST("a changed payload is found in a closed loop") {
    static const char *const types[] = {"f64", "f32"};
    make_cart("lqr", 1, "", "lqr");
    make_cart("loaded", 1.6, "damping: {kind: known, values: [0.5, 0]}\n", "lqr");
    load("loaded");
    for (size_t t = 0; t < LG_COUNT(types); t++) {
        export_run(
            test_text("lqr.h5 --out a%s --name cp --functions control,adapt --dtype %s", types[t], types[t]));
        export_check_each(test_text("a%s", types[t]), "cp", few + t, 1);
        export_library lib = export_open(test_text("a%s", types[t]), "cp", "gcc", "-O2");
        static const double zero[2] = {0, 0};
        double memory[40], found[8], x[4] = {0.2, 0.1, 0, 0}, seen[4] = {0.2, 0.1, 0, 0}, before[4], u[1];
        export_call(&lib, "adapt_start", 2, (export_port[]){EXPORT_OUT(memory, 40), EXPORT_IN(zero, 2)});
        for (int k = 0; k < 200; k++) {
            memcpy(before, seen, sizeof before);
            export_call(&lib, "control", 2, (export_port[]){EXPORT_IN(seen, 4), EXPORT_OUT(u, 1)});
            u[0] += sin(0.9 * k) + sin(0.13 * k);
            move(x, u, seen, 2);
            export_call(&lib, "adapt", 5,
                        (export_port[]){EXPORT_IN(before, 4), EXPORT_IN(u, 1), EXPORT_IN(seen, 4),
                                        EXPORT_OUT(memory, 40), EXPORT_OUT(found, 8)});
        }
        print_message("%s: damping %.4f of 0.5, Coulomb %.4f, offset %.4f, payload %.4f of 0.6\n", types[t],
                      found[0], found[1], found[2], found[3]);
        assert_close(found[3], 0.6, 0.05, 0);
        assert_close(found[0], 0.5, 0.1, 0);
        assert_close(found[1], 0, 0, 0.05);
        assert_close(found[2], 0, 0, 0.05);
        for (int i = 0; i < 40; i++) { /* a covariance that is not symmetric diverges in single precision */
            const int row = (i % 20 - 4) / 4, column = i % 4, of = i / 20 * 20 + 4;
            if (i % 20 >= 4) assert_close(memory[of + 4 * row + column], memory[of + 4 * column + row], 0, 0);
        }
        export_close(&lib);
    }
}

/* The plant's force is 0.3 sign(v) - 0.5 v, but no Coulomb friction is below 0. v is normal with the
 * deviation 1.5, so the best damping without friction is 0.5 - 0.3 E|v|/E v^2. Large inputs tell the
 * inertia apart. */
TEST("at a bound the other numbers take what is best for them") {
    cli_write("mass.yaml", "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: "
                           "{columns: [u]}\nmass: {kind: known, values: [2]}\n"
                           "damping: {kind: none}\ninput_map: {kind: known, values: [1]}\n");
    train("mass", "plant: mass.yaml\nperiod: 0.1\nhorizon: 3\nstarts: {x: [-1, 1], v: [-1, 1]}\nlimits: {u: "
                  "2}\ncost: {x: 1, v: 0.1, u: 0.01}\nsuccess: {x: 0.05, hold: 1, within: 10}\n"
                  "controller: {kind: lqr}\n");
    export_run("mass.h5 --out mass --name m --functions adapt --forget 100");
    export_check_each("mass", "m", few, 1);
    export_library lib = export_open("mass", "m", "gcc", "-O2");
    static const double zero[2] = {0, 0};
    double memory[20], found[4];
    lg_rng rng = test_rng(5, 6);
    export_call(&lib, "adapt_start", 2, (export_port[]){EXPORT_OUT(memory, 20), EXPORT_IN(zero, 2)});
    for (int k = 0; k <= 3000; k++) {
        const double v = k > 0 ? 1.5 * lg_rng_normal(&rng) : 0, u = k > 0 ? 4 * lg_rng_normal(&rng) : 0;
        const double force = k > 0 ? 0.3 * copysign(1, v) - 0.5 * v : 0, half = 0.05 * (force + u) / 2;
        const double x[2] = {0, v - half}, next[2] = {0.1 * v, v + half};
        export_call(&lib, "adapt", 5,
                    (export_port[]){EXPORT_IN(x, 2), EXPORT_IN(&u, 1), EXPORT_IN(next, 2),
                                    EXPORT_OUT(memory, 20), EXPORT_OUT(found, 4)});
        /* no force, no motion: nothing is found */
        for (int i = 0; k == 0 && i < 4; i++) assert_close(found[i], 0, 0, 0);
        static const double low[] = {0, 0, -1, -0.2};
        for (int i = 0; i < 4; i++) assert_true(memory[i] >= low[i] && memory[i] <= 1);
    }
    print_message("damping %.4f, Coulomb %.4f, offset %.4f, inertia %.4f\n", found[0], found[1], found[2],
                  found[3]);
    assert_close(found[0], 0.5 - 0.3 * 0.79788 / 1.5, 0.1, 0);
    assert_close(found[1], 0, 0, 0.02);
    assert_close(found[2], 0, 0, 0.05);
    export_close(&lib);
}

TEST_GROUP(export_begin, export_end)
