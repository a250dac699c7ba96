/* Files of programs: round trips to the bit, what is refused, damage. The 20000 mutants are in
 * test_program_mutants.c. */
#include "program_mutants.h"

static lg_status read_program(const lg_context *context, const char *path, const lg_read_options *options,
                              lg_error *error) {
    lg_program *program = NULL;
    const lg_status status = lg_program_load(context, path, options, &program, error);
    if (status == LG_OK)
        lg_program_destroy(program);
    else
        assert_null(program);
    return status;
}

/* The network, written once; a copy each time. */
static const char *fresh(void) {
    const char *path = scratch_path("program.h5"), *original = scratch_path("program.original");
    if (access(original, F_OK) != 0) {
        lg_program *program = zoo_network();
        assert_ok(lg_program_save(NULL, original, program, NULL, NULL));
        lg_program_destroy(program);
    }
    copy_file(original, path);
    return path;
}

static void check_round_trip(const lg_program *program, const lg_read_options *options) {
    const char *path = scratch_path("first.h5"), *second = scratch_path("second.h5");
    lg_error error = {LG_OK, ""};
    lg_program *again = NULL;
    assert_ok(lg_program_save(NULL, path, program, NULL, &error));
    if (lg_program_load(NULL, path, options, &again, &error) != LG_OK) fail_msg("%s", error.message);
    assert_ok(lg_program_save(NULL, second, again, NULL, &error));
    assert_same_bytes(path, second);
    assert_same_results(program, again);
    lg_program_destroy(again);
}

static void networks_round_trip(void **state) {
    (void)state;
    char kind[64];
    lg_program *program = zoo_network(), *again;
    check_round_trip(program, NULL);
    const char *path = scratch_path("provenance.h5");
    const lg_provenance provenance = {.command = "make", .has_seed = true, .seed = 5};
    assert_ok(lg_program_save(NULL, path, program, &provenance, NULL));
    assert_ok(lg_program_load(NULL, path, NULL, &again, NULL));
    assert_ok(lg_file_kind(NULL, path, NULL, kind, sizeof kind, NULL));
    assert_string_equal(kind, "program");
    assert_string_equal(lg_program_description(again), ZOO_DESCRIPTION);
    assert_int_equal(lg_program_parameters(again), lg_program_parameters(program));
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec a = lg_program_parameter(program, i), b = lg_program_parameter(again, i);
        assert_string_equal(a.name, b.name);
        assert_memory_equal(&a.shape, &b.shape, sizeof a.shape);
        assert_memory_equal(a.values, b.values, lg_shape_count(a.shape) * sizeof(double));
    }
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        size_t na, nb;
        assert_string_equal(lg_program_function_name(program, f), lg_program_function_name(again, f));
        const lg_port *a = lg_program_inputs(program, f, &na), *b = lg_program_inputs(again, f, &nb);
        assert_int_equal(na, nb);
        for (size_t i = 0; i < na; i++) {
            assert_string_equal(a[i].name, b[i].name);
            assert_string_equal(a[i].unit != NULL ? a[i].unit : "", b[i].unit != NULL ? b[i].unit : "");
            assert_memory_equal(&a[i].shape, &b[i].shape, sizeof a[i].shape);
            assert_true(a[i].shared == b[i].shared && a[i].low == b[i].low && a[i].high == b[i].high);
        }
    }
    lg_program_destroy(again);
    lg_program_destroy(program);
}

/* Every operation that can be in a program, with its derivative. */
static void operations_round_trip(void **state) {
    (void)state;
    const lg_read_options here = without_probe();
    const lg_gradcheck_case *row;
    size_t checked = 0;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        lg_program *program = zoo_operation(row);
        if (program == NULL) continue;
        check_round_trip(program, &here);
        lg_program_destroy(program);
        checked++;
    }
    assert_true(checked > 0);
}

static void empty_program(void **state) {
    (void)state;
    lg_program_spec spec;
    lg_program *program, *again;
    const char *path = scratch_path("empty.h5");
    lg_program_spec_init(&spec);
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    assert_ok(lg_program_save(NULL, path, program, NULL, NULL));
    assert_ok(lg_program_load(NULL, path, NULL, &again, NULL));
    assert_int_equal(lg_program_functions(again), 0);
    assert_string_equal(lg_program_description(again), "");
    lg_program_destroy(program);
    lg_program_destroy(again);
}

/* ---- damage ---- */

static void damaged_files(void **state) {
    (void)state;
    refuse_damaged_files(read_program, fresh(), "");
    survive_changed_bytes(read_program, fresh(), 100);
}

static void missing_parts(void **state) {
    (void)state;
    static const char *const links[] = {"operations",
                                        "function_names",
                                        "parameters/theta",
                                        "functions/value",
                                        "functions/value/inputs/name",
                                        "functions/value/inputs/unit",
                                        "functions/value/outputs/range",
                                        "functions/value/operations/whole",
                                        "functions/value/edges",
                                        "functions/value/reals",
                                        "functions/value/results",
                                        "functions/ten_steps/carry"};
    refuse_without_links(read_program, fresh, "", links, LG_COUNT(links));
    const char *path = fresh();
    delete_link(path, "revisions"); /* of the first revision then */
    assert_ok(read_program(NULL, path, NULL, NULL));
}

static void bad_arrays(void **state) {
    (void)state;
    static const bad_array cases[] = {
        {"parameters/theta", 1, {5}, 1, LG_FORMAT, "functions/value"},
        {"parameters/scale", 0, {0}, NAN, LG_NOT_FINITE, "NaN"},
        {"functions/value/operations/real", 1, {3}, 1, LG_FORMAT, "expected"},
        {"functions/value/inputs/range", 2, {1, 2}, NAN, LG_FORMAT, "range"},
        {"functions/value/inputs/range", 2, {2, 2}, 0, LG_FORMAT, "expected"},
        {"functions/value/reals", 1, {100}, 0, LG_FORMAT, "length"},
    };
    refuse_arrays(read_program, fresh, false, cases, LG_COUNT(cases));
}

static void bad_attributes(void **state) {
    (void)state;
    static const bad_value texts[] = {
        {"/", "kind", "hamiltonian", "program"},
        {"functions/ten_steps", "calls", "ten_steps", "before"},
        {"functions/ten_steps", "calls", "no such", "before"},
        {"functions/ten_steps", "times", "ten", "integer"},
    };
    refuse_texts(read_program, fresh, texts, LG_COUNT(texts));
    static const bad_integer integers[] = {
        {"functions/ten_steps", "times", 0, "times"},
        {"functions/ten_steps", "times", -1, "times"},
        {"functions/ten_steps", "times", (int64_t)1 << 31, "times"},
    };
    refuse_integers(read_program, fresh, integers, LG_COUNT(integers));
}

/* Names of operations and of what would enter C. */
static void bad_names(void **state) {
    (void)state;
    static const struct {
        const char *path, *name, *word;
    } cases[] = {
        {"operations", "no_such_operation", "no_such_operation"},
        {"operations", "bad\x01\x1b[31m", "bad??[31m"},
        {"operations", "custom", "caller"},
        {"functions/value/inputs/name", "int", "word of C"},
        {"functions/value/inputs/name", "x; system(\"id\");", "identifier"},
        {"functions/value/inputs/name", "__x", "begin"},
        {"functions/value/inputs/name", "", "empty"},
        {"functions/value/inputs/unit", "*/ int evil; /*", "comment"},
        {"functions/value/inputs/unit", "m\\", "comment"},
        {"function_names", "../parameters", "function_names"},
        {"function_names", "loss", "loss"},
        {"parameter_names", "a b", "parameter_names"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = fresh();
        change_text(path, cases[i].path, 0, cases[i].name);
        assert_refused(read_program, path, LG_FORMAT, cases[i].word, "");
    }
}

static void newer_files(void **state) {
    (void)state;
    const char *path = fresh();
    change_number(path, "revisions", 0, 2.0);
    assert_refused(read_program, path, LG_VERSION, "revision", "");
    path = fresh();
    change_number(path, "revisions", 0, 0.0);
    assert_refused(read_program, path, LG_FORMAT, "revision", "");
    path = fresh();
    replace_integer(path, "/", "format_version", 2);
    assert_refused(read_program, path, LG_VERSION, "format_version", "");
}

static void limits(void **state) {
    (void)state;
    lg_read_options options;
    lg_read_options_init(&options);
    options.max_bytes = 3000; /* no array is larger, all together are */
    lg_error error;
    assert_status(read_program(NULL, fresh(), &options, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "limit"));
}

static void no_model(void **state) {
    (void)state;
    lg_model_file file;
    lg_error error;
    assert_status(lg_model_load(NULL, fresh(), NULL, &file, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "lg_program_load"));
    lg_hamiltonian_file model;
    assert_status(lg_model_load_hamiltonian(NULL, fresh(), NULL, &model, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "program"));
}

static void bad_calls(void **state) {
    (void)state;
    lg_program *program = zoo_network(), *out = NULL;
    assert_status(lg_program_save(NULL, NULL, program, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_program_save(NULL, fresh(), NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_program_load(NULL, NULL, NULL, &out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_program_load(NULL, fresh(), NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    lg_function_image *image = NULL;
    assert_status(lg_function_image_create(program, lg_program_functions(program), &image), LG_NOT_FOUND);
    lg_program_destroy(program);
}

/* ---- memory ---- */

static lg_status save_and_load(const lg_context *context, void *user, lg_error *error) {
    const lg_read_options here = without_probe();
    lg_program *program = NULL, *again = NULL;
    lg_status status = lg_program_load(context, user, &here, &program, error);
    if (status == LG_OK) status = lg_program_save(context, scratch_path("again.h5"), program, NULL, error);
    if (status == LG_OK) status = lg_program_load(context, scratch_path("again.h5"), &here, &again, error);
    lg_program_destroy(program);
    lg_program_destroy(again);
    return status;
}

static void failing_allocations(void **state) {
    (void)state;
    char path[128];
    (void)snprintf(path, sizeof path, "%s", fresh());
    assert_true(fail_every_allocation(save_and_load, path) > 50);
}

/* ---- mutants ---- */

static void some_mutants(void **state) {
    (void)state;
    mutate_images(400, 1);
    mutate_arrays(100, 2);
    mutate_bytes(50, 3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(networks_round_trip), cmocka_unit_test(operations_round_trip),
        cmocka_unit_test(empty_program),       cmocka_unit_test(damaged_files),
        cmocka_unit_test(missing_parts),       cmocka_unit_test(bad_arrays),
        cmocka_unit_test(bad_attributes),      cmocka_unit_test(bad_names),
        cmocka_unit_test(newer_files),         cmocka_unit_test(limits),
        cmocka_unit_test(no_model),            cmocka_unit_test(bad_calls),
        cmocka_unit_test(failing_allocations), cmocka_unit_test(some_mutants),
    };
    return cmocka_run_group_tests(tests, scratch_begin, scratch_end);
}
