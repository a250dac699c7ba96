/* Exports models of kinds that the library does not know. Their C must have the faces (kinds of interface,
 * lg-export/faces.h) for which they have functions, and must step as the library's integrator does.
 * ctest-labels: apps/lg-export src/model */
#include "export_support.h"

#include "liegrad/integrators.h"
#include "liegrad/model.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "support/fixtures.h"

static const double weights[3] = {0.7, -1.3, 0.4};
static const export_way few[] = {{"gcc", "-O2"}, {"g++", "-O1"}, {"clang", "-O0"}};

static lg_var columns(lg_tape *tape, lg_var x, uint32_t first, uint32_t count) {
    return lg_slice(tape, x, 1, first, count);
}

/* (R, p) on SO(3) x R^3: omega = w p + sin of R's first row, p' = u - p + w times R's last row. */
static lg_status body_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user;
    const lg_var p = columns(tape, x[0], 9, 3);
    const lg_var both[2] = {
        lg_add(tape, lg_mul(tape, p, theta[0]), lg_sin(tape, columns(tape, x[0], 0, 3))),
        lg_add(tape, lg_sub(tape, x[1], p), lg_mul(tape, columns(tape, x[0], 6, 3), theta[0]))};
    y[0] = lg_concat(tape, both, 2, 1);
    return lg_tape_status(tape);
}

/* H = w_1 cos q + p^2 / 2 on R^2, and its gradient. */
static lg_status energy(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user;
    const lg_var q = columns(tape, x[0], 0, 1), p = columns(tape, x[0], 1, 1);
    const lg_var w = lg_slice(tape, theta[0], 0, 0, 1);
    y[0] = lg_add(tape, lg_mul(tape, lg_cos(tape, q), w), lg_scale(tape, lg_mul(tape, p, p), 0.5));
    return lg_tape_status(tape);
}

static lg_status gradient(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var q = columns(tape, x[0], 0, 1), p = columns(tape, x[0], 1, 1);
    const lg_var w = lg_scale(tape, lg_slice(tape, theta[0], 0, 0, 1), -1.0);
    const lg_var both[2] = {lg_mul(tape, lg_sin(tape, q), w), p};
    y[1] = lg_concat(tape, both, 2, 1);
    return energy(user, tape, theta, x, y);
}

static lg_status hamilton_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    const lg_var g = lg_program_call(tape, "grad", 1, x);
    const lg_var both[2] = {columns(tape, g, 1, 1), lg_scale(tape, columns(tape, g, 0, 1), -1.0)};
    y[0] = lg_concat(tape, both, 2, 1);
    return lg_tape_status(tape);
}

/* A step that the file itself holds: Euler's. */
static lg_status euler(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    y[0] = lg_add(tape, x[0], lg_mul(tape, lg_program_call(tape, "field", 0, x), x[1]));
    return lg_tape_status(tape);
}

static lg_status decay(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    y[0] = lg_scale(tape, x[0], -1.0);
    return lg_tape_status(tape);
}

/* Logits 3 x and -3 x of two classes; their derivatives; their probabilities. */
static lg_status logits(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    const lg_var both[2] = {lg_scale(tape, x[0], 3.0), lg_scale(tape, x[0], -3.0)};
    y[0] = lg_concat(tape, both, 2, 1);
    return lg_tape_status(tape);
}

static lg_status slopes(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var none = lg_scale(tape, x[0], 0.0);
    const lg_var both[2] = {lg_add_scalar(tape, none, 3.0), lg_add_scalar(tape, none, -3.0)};
    y[1] = lg_reshape(tape, lg_concat(tape, both, 2, 1), lg_shape3(lg_var_shape(tape, none).dims[0], 2, 1));
    return logits(user, tape, theta, x, y);
}

static lg_status chances(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    const lg_var part = lg_exp(tape, lg_program_call(tape, "value", 0, x));
    y[0] = lg_div(tape, part, lg_sum_axis(tape, part, 1, true));
    return lg_tape_status(tape);
}

static void save(const char *name, const char *space_text, const lg_function_spec *functions, size_t count) {
    const lg_parameter_spec theta = {"theta", lg_shape1(3), weights};
    char path[1024];
    lg_error error = {LG_OK, ""};
    lg_program_spec spec;
    lg_program *program;
    lg_space space;
    lg_program_spec_init(&spec);
    spec.functions = functions;
    spec.function_count = count;
    spec.parameters = &theta;
    spec.parameter_count = 1;
    spec.description = "A model that nobody knows.";
    if (lg_program_build(NULL, &spec, &program, &error) != LG_OK) fail_msg("%s", error.message);
    if (space_text != NULL) assert_ok(lg_space_read(space_text, &space, NULL));
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_save(NULL, path, "stranger", program, space_text != NULL ? &space : NULL, NULL, NULL));
    lg_program_destroy(program);
}

static lg_model_file load(const char *name) {
    char path[1024];
    lg_model_file file;
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    return file;
}

static void save_body(void) {
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(12)}, {.name = "u", .shape = lg_shape1(3)}},
                  out = {.name = "f"};
    save("body.h5", "SO(3), R^3", &(lg_function_spec){"field", in, 2, &out, 1, body_field, NULL}, 1);
}

/* A program with value, grad and field; `own_step`: and with its own function `step`. */
static void save_pendulum(const char *name, bool own_step) {
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(2)}, {.name = "h", .shape = lg_shape1(1)}},
                  y[] = {{.name = "y"}, {.name = "g"}}, f = {.name = "f"}, next = {.name = "next"};
    const lg_function_spec functions[] = {{"value", in, 1, y, 1, energy, NULL},
                                          {"grad", in, 1, y, 2, gradient, NULL},
                                          {"field", in, 1, &f, 1, hamilton_field, NULL},
                                          {"step", in, 2, &next, 1, euler, NULL}};
    save(name, "R^2", functions, own_step ? 4 : 3);
}

typedef void (*field_function)(const double *state, const double *input, double *field, double *work);
typedef void (*step_function)(double h, const double *state, const double *input, double *next, double *work);
typedef void (*linear_function)(const double *state, const double *input, double *A, double *B, double *work);

/* Compares NAME_field, NAME_step and, if `linear`, NAME_linearise with the library along a run. */
static void compare(const char *folder, const lg_model *model, const char *scheme_name, bool linear) {
    const lg_scheme *scheme = lg_scheme_find(scheme_name);
    const size_t d = lg_model_inputs(model), r = lg_model_tangent_dim(model), m = lg_model_input_dim(model);
    const size_t bytes = lg_model_stepper_size(model, scheme);
    export_library lib = export_open(folder, "m", "gcc", "-O2");
    double input[3] = {0.3, -0.1, 0.2}, x[12], element[6], want[144], got[144], B[64], want_B[64];
    void *work = test_work(lg_model_work_size(model));
    lg_stepper *stepper;
    lg_rng rng;
    field_function field = (field_function)export_symbol(&lib, "field");
    step_function step = (step_function)export_symbol(&lib, "step");
    assert_ok(lg_model_stepper_init(model, scheme, &stepper, test_work(bytes), bytes));
    lg_rng_seed(&rng, 5, 1);
    /* the rotation is the identity */
    for (size_t i = 0; i < d; i++) x[i] = d == 12 && i < 9 && i % 4 == 0 ? 1.0 : 0.0;
    for (size_t i = 0; i < lg_model_space(model)->algebra_dim; i++) element[i] = lg_rng_normal(&rng);
    lg_space_act(lg_model_space(model), element, x, x);
    for (int k = 0; k < 50; k++) {
        assert_ok(lg_model_field(model, x, input, want, work));
        field(x, input, got, lib.work);
        assert_true(export_norm(got, want, lg_model_space(model)->algebra_dim) <= 1e-13);
        if (linear) {
            linear_function linearise = (linear_function)export_symbol(&lib, "linearise");
            assert_ok(lg_model_linearise(model, x, input, want, want_B, NULL, work));
            linearise(x, input, got, B, lib.work);
            assert_true(export_norm(got, want, r * r) <= 1e-12);
            assert_true(export_norm(B, want_B, r * m) <= 1e-12);
        }
        assert_ok(lg_stepper_step(stepper, 0.0, 0.05, x, input, want));
        step(0.05, x, input, x, lib.work);
        assert_true(export_norm(x, want, d) <= 1e-13);
    }
    assert_true(lg_space_manifold_error(lg_model_space(model), x) <= 1e-14);
    export_close(&lib);
}

TEST("a field of an unknown kind on SO(3) x R^3 is evaluated, stepped and linearised") {
    save_body();
    lg_model_file file = load("body.h5");
    cli_json("lg-export", "body.h5 --out plain --name m", "kind \"stranger\", scheme \"cf4\", outputs 0");
    compare("plain", file.model, "cf4", false);
    export_run("body.h5 --out linear --name m --functions linearise --scheme rkmk4");
    compare("linear", file.model, "rkmk4", true);
    export_run("body.h5 --out single --name m --functions linearise --dtype f32");
    export_check_ways("linear", "m");
    export_check_each("single", "m", few, LG_COUNT(few));
    export_check_objects("linear", "m");
    export_check_stack("linear");
    export_expect("! grep -q m_eval plain/m.h && grep -q 'space  *SO(3), R^3' plain/m.h");
    lg_model_file_destroy(&file);
}

TEST("an unknown kind with energy, gradient and field gets the faces of a Hamiltonian") {
    double y = 0.0, g[2] = {0.0}, want, want_g[2];
    const double x[2] = {0.4, -1.1};
    save_pendulum("pendulum.h5", false);
    lg_model_file file = load("pendulum.h5");
    void *work = test_work(lg_model_work_size(file.model));
    export_run("pendulum.h5 --out flat --name m");
    compare("flat", file.model, "rk4", false);
    export_library lib = export_open("flat", "m", "gcc", "-O1");
    double (*hamiltonian)(const double *, double *) =
        (double (*)(const double *, double *))export_symbol(&lib, "hamiltonian");
    lg_model_jacobian(file.model, x, &want, want_g, work);
    export_grad(&lib, x, &y, g);
    assert_close(y, want, 1e-15, 0.0);
    assert_close(hamiltonian(x, lib.work), weights[0] * cos(x[0]) + 0.5 * x[1] * x[1], 1e-15, 0.0);
    assert_true(export_norm(g, want_g, 2) <= 1e-15);
    export_close(&lib);
    export_check_each("flat", "m", few, LG_COUNT(few));
    export_run("pendulum.h5 --out functions --name m --functions value,field");
    export_expect("grep -q 'void m_value(' functions/m.h && ! grep -q m_step functions/m.h");
    cli_expect("lg-export", "pendulum.h5 --out no --scheme midpoint", 2, "explicit");
    lg_model_file_destroy(&file);
}

TEST("a step that the file holds is exported as it is, and no other scheme is accepted") {
    double next[2], field[2];
    const double x[2] = {0.4, -1.1};
    save_pendulum("euler.h5", true);
    export_run("euler.h5 --out own --name m");
    export_library lib = export_open("own", "m", "gcc", "-O1");
    ((field_function)export_symbol(&lib, "field"))(x, NULL, field, lib.work);
    ((step_function)export_symbol(&lib, "step"))(0.1, x, NULL, next, lib.work);
    for (int i = 0; i < 2; i++) assert_close(next[i], x[i] + 0.1 * field[i], 1e-15, 0.0);
    export_close(&lib);
    export_check_each("own", "m", few, LG_COUNT(few));
    export_expect("grep -q 'step  *as the file holds it' own/m.h");
    cli_expect("lg-export", "euler.h5 --out no --scheme rk4", 3, "has a function 'step', so no other scheme");
}

TEST("an unknown kind with probabilities is exported as a classifier") {
    const lg_port x = {.name = "x", .shape = lg_shape1(1)}, y[] = {{.name = "y"}, {.name = "g"}},
                  chance = {.name = "probability"};
    const lg_function_spec functions[] = {{"value", &x, 1, y, 1, logits, NULL},
                                          {"grad", &x, 1, y, 2, slopes, NULL},
                                          {"probability", &x, 1, &chance, 1, chances, NULL}};
    save("chances.h5", NULL, functions, 3);
    export_run("chances.h5 --out chances --name m");
    export_library lib = export_open("chances", "m", "gcc", "-O1");
    int (*classify)(const double *, double *, double *) =
        (int (*)(const double *, double *, double *))export_symbol(&lib, "classify");
    for (double at = -0.5; at < 1; at += 1) {
        double found[2];
        assert_int_equal(classify(&at, found, lib.work), at < 0 ? 1 : 0);
        assert_close(found[0], 1 / (1 + exp(-6 * at)), 1e-14, 0.0);
    }
    export_close(&lib);
    export_check_each("chances", "m", few, LG_COUNT(few));
}

TEST("an unknown kind without a gradient, or whose step has other inputs, is exported as a program") {
    const lg_port x = {.name = "x", .shape = lg_shape1(2)}, f = {.name = "f"},
                  in[] = {x, {.name = "h", .shape = lg_shape1(1)}};
    const lg_function_spec functions[] = {{"value", &x, 1, &f, 1, energy, NULL},
                                          {"field", &x, 1, &f, 1, decay, NULL},
                                          {"step", in, 2, &f, 1, energy, NULL}};
    save("value.h5", NULL, functions, 1);
    export_run("value.h5 --out value --name m");
    export_expect("grep -q 'void m_value(' value/m.h && ! grep -q m_eval value/m.h");
    save("other.h5", "R^2", functions, 3);
    export_run("other.h5 --out other --name m");
    export_expect("grep -q 'void m_step(const m_real \\*x, const m_real \\*h' other/m.h");
}

TEST("a model of an unknown kind can be exported to every target") {
    static const char *const targets[] = {"casadi", "fmu2",        "fmu3",   "simulink",
                                          "onnx",   "safetensors", "package"};
    char line[256];
    save_pendulum("all.h5", false);
    save_body();
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        (void)snprintf(line, sizeof line, "all.h5 --out to-%s --name m --target %s", targets[i], targets[i]);
        export_run(line);
    }
    export_run("body.h5 --out body-fmu --name m --target fmu2");
    export_expect("make -s -C body-fmu CFLAGS=-O1 test && make -s -C to-fmu3 CFLAGS=-O1 test");
    /* where there is no zip */
    export_expect("make -s -C to-fmu3 CFLAGS=-O1 ZIP=none m.fmu && cmake -E tar tf to-fmu3/m.fmu | grep -qx "
                  "modelDescription.xml");
    export_expect("grep -c 'derivative=' body-fmu/modelDescription.xml | grep -qx 12");
}

TEST_GROUP(export_begin, export_end)
