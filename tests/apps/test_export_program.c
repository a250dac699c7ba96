/* Exports programs with lg-export: self-tests in both types, symbols, stacks, and the errors that a self-test
 * finds.
 * ctest-labels: slow apps/lg-export src/autodiff */
#include "export_support.h"

#include "liegrad/fit.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

#include "export_program.h"

static const export_way few[] = {{"gcc", "-O2"}, {"clang", "-O1"}, {"g++", "-O1"}};
enum { FEW = LG_COUNT(few) };

TEST("a Hamiltonian chain is exported as a program") {
    save_hamiltonian("links", &lg_hamiltonian_chain);
    export_run("links.h5 --out links --name links --seed 3");
    export_check_ways("links", "links");
    export_check_objects("links", "links");
    export_check_stack("links");
}

TEST("a separable Hamiltonian is exported in single precision") {
    save_hamiltonian("flat", &lg_hamiltonian_separable);
    export_run("flat.h5 --out flat --name flat --dtype f32 --golden 20");
    export_check_each("flat", "flat", few, FEW);
    export_check_objects("flat", "flat");
    export_check_stack("flat");
}

TEST("ONNX: the path of a loop is the results of all its rounds") {
    save_hamiltonian("path", &lg_hamiltonian_separable);
    export_run("path.h5 --out one --name path --target onnx --functions step");
    export_run("path.h5 --out ten --name path --target onnx --functions ten");
    export_expect("count() { grep -ao Concat $1/path.onnx | wc -l; }\n"
                  "test $(count ten) = $((10 * $(count one) + 1))");
}

TEST("convolutions are exported as loops") {
    save_network("waves");
    export_run("waves.h5 --out waves --name waves --compact");
    export_check_ways("waves", "waves");
    export_check_objects("waves", "waves");
    export_check_stack("waves");
    export_run("waves.h5 --out single --name waves --dtype f32");
    export_check_each("single", "waves", few, 1);
}

/* Code and weights that the chosen functions do not need are left out. */
TEST("--functions exports only the named functions") {
    static char out[EXPORT_TEXT];
    save_network("some");
    export_run("some.h5 --out some --name some --functions jac_value,value");
    export_check_each("some", "some", few, FEW);
    assert_int_equal(export_shell("grep -q 'void some_value(' some/some.h", out), 0);
    assert_int_equal(export_shell("grep -q 'void some_jac_value(' some/some.h", out), 0);
    assert_int_not_equal(export_shell("grep -q 'void some_many(' some/some.h", out), 0);
}

static lg_status record_use(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    (void)user;
    out[0] = lg_mul(tape, in[0], theta[0]);
    return lg_tape_status(tape);
}
static lg_status record_gap(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    (void)user;
    out[0] = lg_sub(tape, lg_mul(tape, in[0], theta[0]), in[1]);
    return lg_tape_status(tape);
}

/* Whether functions are marked as training functions; what a fit marks and a file keeps. */
static void save_fitted(const char *name, bool both) {
    static const double x[8] = {1, 2, 3, 4, 5, 6, 7, 8}, wanted[8] = {2, 4, 6, 8, 10, 12, 14, 16}, start = 1;
    const lg_port in[] = {{.name = "x"}, {.name = "y"}}, out = {.name = "z"};
    const lg_parameter_spec theta = {"theta", lg_shape1(1), &start};
    const lg_function_spec functions[] = {{"use", in, 1, &out, 1, record_use, NULL},
                                          {"training_gap", in, 2, &out, 1, record_gap, NULL}};
    lg_program_spec spec;
    lg_program *program, *read;
    lg_program_spec_init(&spec);
    spec.parameters = &theta;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = 2;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    assert_told(lg_program_fit(NULL, program, "training_gap", (const double *const[]){x, wanted}, 8, NULL,
                               NULL, NULL, &told));
    assert_true(lg_program_is_fitted(program, 1) && !lg_program_is_fitted(program, 0));
    assert_true(!lg_program_is_fitted(program, 2) && !lg_program_is_fitted(NULL, 0));
    assert_status(lg_program_set_fitted(program, 2, true), LG_INVALID_ARGUMENT);
    if (both) assert_ok(lg_program_set_fitted(program, 0, true));
    assert_told(lg_program_save(NULL, cli_at(test_text("%s.h5", name)), program, NULL, &told));
    assert_told(lg_program_load(NULL, cli_at(test_text("%s.h5", name)), NULL, &read, &told));
    assert_true(lg_program_is_fitted(read, 1) && lg_program_is_fitted(read, 0) == both);
    lg_program_destroy(read);
    lg_program_destroy(program);
}

TEST("a function that a fit minimised is left out of every export, unless it is named or is all there is") {
    static const char *const targets[] = {"c", "package", "casadi", "fmu2", "fmu3", "simulink", "onnx"};
    save_fitted("line", false);
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        export_run(test_text("line.h5 --out line_%s --name line --target %s", targets[i], targets[i]));
        export_expect(
            test_text("! grep -rqa training_gap line_%s && grep -rqaw z line_%s", targets[i], targets[i]));
    }
    export_run("line.h5 --out named --name line --functions training_gap,use");
    export_expect("grep -q 'void line_training_gap(' named/line.h && grep -q 'void line_use(' named/line.h");
    save_fitted("all", true);
    export_run("all.h5 --out all --name line");
    export_expect("grep -q 'void line_training_gap(' all/line.h && grep -q 'void line_use(' all/line.h");
}

TEST("a file of an unknown kind that holds functions is exported as a program") {
    static char out[EXPORT_TEXT];
    lg_program *program;
    save_network("network");
    assert_ok(lg_program_load(NULL, cli_at("network.h5"), NULL, &program, NULL));
    assert_ok(lg_model_save(NULL, cli_at("unknown.h5"), "rotor", program, NULL, NULL, NULL));
    lg_program_destroy(program);
    export_run("network.h5 --out network --name n");
    export_run("unknown.h5 --out unknown --name n");
    assert_int_equal(export_shell("cmp network/n.c unknown/n.c", out), 0);
    assert_int_equal(export_shell("cmp network/n_weights.c unknown/n_weights.c", out), 0);
}

/* Weights that several functions use are stored once. */
TEST("functions share their weights") {
    static char out[EXPORT_TEXT];
    save_network("once");
    export_run("once.h5 --out once --name once --compact --functions value");
    export_run("once.h5 --out twice --name once --compact --functions value,many");
    export_expect("cmp once/once_weights.c twice/once_weights.c");
    assert_int_equal(export_shell("grep -c 'const once_real once_weights' once/once_weights.c", out), 0);
}

/* One changed digit of a weight, or one changed sign in the code. */
TEST("self-tests find planted errors") {
    static char out[EXPORT_TEXT];
    static const struct {
        const char *file, *change;
    } plants[] = {
        {"wrong_weights.c", "awk '!done && /^    -?[0-9]/ { sub(/[0-9]/, \"8\"); done = 1 } { print }'"},
        {"wrong.c", "sed '0,/ + v/s// - v/'"},
        {"wrong.c", "sed 's/y\\[j\\] += (x0/y[j] -= (x0/'"},
    };
    save_hamiltonian("wrong", &lg_hamiltonian_separable);
    export_run("wrong.h5 --out wrong --name wrong");
    for (size_t i = 0; i < LG_COUNT(plants); i++) {
        char command[EXPORT_LINE];
        (void)snprintf(
            command, sizeof command,
            "rm -rf bad && cp -r wrong bad && %s wrong/%s > bad/%s && ! cmp -s wrong/%s bad/%s && cd bad "
            "&& gcc -O1 *.c -lm -o t && ./t",
            plants[i].change, plants[i].file, plants[i].file, plants[i].file, plants[i].file);
        const int code = export_shell(command, out);
        if (code == 0 || strstr(out, "WRONG") == NULL) fail_msg("%s passed:\n%s", plants[i].change, out);
    }
}

/* sin(2 pi t): for large t it has no digits in single precision. */
static lg_status record_wave(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    (void)user, (void)theta;
    out[0] = lg_sin(tape, lg_scale(tape, in[0], 6.283185307179586));
    return lg_tape_status(tape);
}

TEST(
    "the self-test accepts no error above a tenth; where rounding is as large, a warning names --dtype f64") {
    static char out[EXPORT_TEXT];
    static const struct {
        double high;
        const char *type;
    } rows[] = {{1e6, "f32"}, {1e6, "f64"}, {1, "f32"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_port t = {.name = "t", .high = rows[i].high}, d = {.name = "d"};
        const lg_function_spec wave = {"wave", &t, 1, &d, 1, record_wave, NULL};
        const lg_program_spec spec = {.size = sizeof spec, .functions = &wave, .function_count = 1};
        lg_program *program;
        assert_ok(lg_program_build(NULL, &spec, &program, NULL));
        assert_ok(lg_program_save(NULL, cli_at("t.h5"), program, NULL, NULL));
        lg_program_destroy(program);
        cli_expect("lg-export", test_text("t.h5 --out t --name t --dtype %s", rows[i].type), 0, "");
        assert_int_equal(strstr(result.err, "export it with --dtype f64") != NULL, i == 0);
        const int code = export_shell("cd t && sed -i 's/define SIN .*/define SIN(x) (0 * (x))/' t.c && gcc "
                                      "-std=c99 -O1 *.c -lm -o t && ./t",
                                      out);
        if (code == 0 || strstr(out, "WRONG") == NULL) fail_msg("zeros passed:\n%s", out);
    }
}

TEST_GROUP(export_begin, export_end)
