/* Loading files of any kind through lg_model_load: each kind, files that are not models, damage, failing
 * memory. */
#include "model/model_kinds.h"

#include "liegrad/machine.h"
#include "model/files/program_file.h"

static const char *fresh(model_kind kind) {
    return good_model(kind, kinds[kind].bad);
}

static lg_status read_any(const lg_context *context, const char *path, const lg_read_options *options,
                          lg_error *error) {
    lg_model_file file, untouched;
    memset(&file, 0x41, sizeof file);
    memcpy(&untouched, &file, sizeof file);
    const lg_status status = lg_model_load(context, path, options, &file, error);
    if (status == LG_OK)
        lg_model_file_destroy(&file);
    else
        assert_memory_equal(&file, &untouched, sizeof file);
    return status;
}

/* ---- models ---- */

/* The model must have the kind and sizes of the other model, and compute the same finite numbers. */
static void assert_same_model(const lg_model *model, const lg_model *expected) {
    const size_t n = lg_model_inputs(model), outputs = lg_model_outputs(model);
    assert_int_equal(n, lg_model_inputs(expected));
    assert_int_equal(outputs, lg_model_outputs(expected));
    assert_int_equal(lg_model_parameters(model), lg_model_parameters(expected));
    double *x = TEST_ARRAY(double, n), *y = TEST_ARRAY(double, outputs), *again = TEST_ARRAY(double, outputs);
    for (size_t i = 0; i < n; i++) x[i] = 0.1 * (double)(i % 7) - 0.2;
    lg_model_eval(model, x, y, test_work(lg_model_work_size(model)));
    lg_model_eval(expected, x, again, test_work(lg_model_work_size(expected)));
    for (size_t i = 0; i < outputs; i++) assert_true(isfinite(y[i]));
    assert_memory_equal(y, again, outputs * sizeof *y);
    const size_t inputs = lg_model_input_dim(model), tangents = lg_model_tangent_dim(model);
    assert_true(inputs == lg_model_input_dim(expected) && tangents == lg_model_tangent_dim(expected));
    if (tangents == 0) return;
    const double *u = inputs > 0 ? test_numbers(4, inputs, -1, 1) : NULL;
    double *f = TEST_ARRAY(double, n), *g = TEST_ARRAY(double, n);
    assert_ok(lg_model_field(model, x, u, f, test_work(lg_model_work_size(model))));
    assert_ok(lg_model_field(expected, x, u, g, test_work(lg_model_work_size(expected))));
    assert_memory_equal(f, g, n * sizeof *f);
}

/* A model of the functions that the recipe records anew. */
static lg_model *model_of(any_file *file) {
    const lg_recipe *recipe = kinds[file->kind].recipe;
    lg_program *program;
    lg_space space;
    lg_model *model;
    assert_ok(recipe->program(NULL, file->bytes, NULL, &program, NULL));
    if (recipe->space != NULL) assert_ok(recipe->space(common_of(file).run, &space));
    assert_int_equal(lg_model_create(NULL, program, recipe->space != NULL ? &space : NULL, &model, NULL),
                     LG_OK); /* called once */
    return model;
}

TEST("a file of any kind loads as a model and by its own loader") {
    for
        EACH_EXAMPLE(kind, which) {
            const char *path = good_model((model_kind)kind, which);
            const lg_recipe *recipe = kinds[kind].recipe;
            lg_model_file file;
            any_file own, loaded = {.kind = (model_kind)kind};
            assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
            assert_ok(load(NULL, path, NULL, (model_kind)kind, &own, NULL));
            assert_true(file.recipe == recipe);
            memcpy(loaded.bytes, lg_model_file_of(&file, recipe), recipe->file_size);
            assert_null(lg_model_file_of(&file, kinds[(kind + 1) % KIND_COUNT].recipe));
            lg_model *expected = model_of(&own);
            assert_same_model(file.model, expected);
            assert_memory_equal(common_of(&loaded).theta, common_of(&own).theta,
                                common_of(&own).parameters * sizeof(double));
            kinds[kind].same(&loaded, &own);
            lg_model_destroy(expected);
            lg_model_file_destroy(&file);
            destroy(&own);
        }
}

/* ---- the attribute `space` ---- */

static void assert_space(const char *path, const char *expected) {
    lg_h5 *h5;
    char text[LG_SPACE_TEXT] = "";
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    assert_true(lg_h5_has_attribute(h5, "model", "space") == (expected[0] != '\0'));
    if (expected[0] != '\0') assert_ok(lg_h5_text(h5, "model", "space", text, sizeof text, NULL));
    assert_string_equal(text, expected);
    lg_h5_close(h5);
}

TEST("a model of format 1 is refused with the version that wrote it and what to do") {
    for (int kind = 0; kind < KIND_COUNT; kind++) {
        const char *path = fresh((model_kind)kind);
        replace_integer(path, "/", "format_version", 1);
        replace_text(path, "/", "liegrad_version", "1.0.0");
        assert_refused(read_any, path, LG_VERSION, "format_version is 1: liegrad 1.0.0 wrote this file",
                       "train the model or build the program again with liegrad");
        delete_attribute(path, "/", "liegrad_version");
        assert_refused(read_any, path, LG_VERSION, "liegrad 1 wrote this file", "");
        delete_link(path, "functions"); /* files of format 1 have none, or others */
        assert_refused(read_any, path, LG_VERSION, "in format 2 only", "");
        delete_attribute(path, "/", "format_version"); /* as if it were written by hand */
        assert_ok(read_any(NULL, path, NULL, NULL));
    }
}

static const char *const spaces[][2] = {
    {"chain", "T*S^2"}, {"separable", "R^2, R^2"}, {"machine", "SO(3), R^3"}};

TEST("a model has a space, which must be the space of its kind; it may be left out") {
    for (size_t i = 0; i < LG_COUNT(spaces); i++) {
        lg_model_file file;
        const char *again = scratch_path("again.h5");
        assert_ok(
            lg_model_load(NULL, test_text("%s/models/%s.h5", LG_TEST_DIR, spaces[i][0]), NULL, &file, NULL));
        assert_ok(lg_recipe_save(NULL, again, file.recipe, file.contents, NULL, NULL));
        assert_space(again, spaces[i][1]);
        lg_model_file_destroy(&file);
        assert_ok(read_any(NULL, again, NULL, NULL));
        replace_text(again, "model", "space", "SO(3) x 2, R^1");
        assert_refused(read_any, again, LG_FORMAT, "/model: attribute space: is 'SO(3) x 2, R^1'",
                       spaces[i][1]);
        replace_text(again, "model", "space", "SO(3)\nR^1");
        assert_refused(read_any, again, LG_FORMAT, "found 'SO(3)?R^1'", "or remove the attribute space");
        delete_attribute(again, "model", "space");
        assert_ok(read_any(NULL, again, NULL, NULL));
    }
}

TEST("models without motion have no space") {
    for (int kind = 0; kind < KIND_COUNT; kind++)
        if (kinds[kind].recipe->space == NULL) assert_space(fresh((model_kind)kind), "");
}

TEST("a structure that was copied elsewhere still finds its numbers") {
    lg_model_file *first = TEST_ARRAY(lg_model_file, 1), second;
    assert_ok(lg_model_load(NULL, fresh(KIND_DETECTOR), NULL, first, NULL));
    second = *first;
    memset(first, 0x41, sizeof *first);
    any_file loaded = {.kind = KIND_DETECTOR};
    memcpy(&loaded.detector, lg_model_file_of(&second, &lg_recipe_detector), sizeof loaded.detector);
    lg_model *expected = model_of(&loaded);
    assert_same_model(second.model, expected);
    lg_model_destroy(expected);
    lg_model_file_destroy(&second);
}

TEST("a freed file is zero and may be freed again") {
    static const lg_model_file zero;
    lg_model_file file;
    memset(&file, 0, sizeof file);
    lg_model_file_destroy(&file); /* a zeroed one */
    lg_model_file_destroy(NULL);
    for (int kind = 0; kind < KIND_COUNT; kind++) {
        assert_ok(lg_model_load(NULL, fresh((model_kind)kind), NULL, &file, NULL));
        lg_model_file_destroy(&file);
        assert_memory_equal(&file, &zero, sizeof file);
        lg_model_file_destroy(&file); /* twice */
    }
}

/* ---- a kind that the library does not know ---- */

/* x_i' = w_i sin(x_i) on R^3. */
static lg_status rotor_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user;
    y[0] = lg_mul(tape, lg_sin(tape, x[0]), theta[0]);
    return lg_tape_status(tape);
}

static const double weights[3] = {0.7, -1.3, 0.4};

static const char *save_rotor(void) {
    const lg_port in = {.name = "x", .shape = lg_shape1(3)}, out = {.name = "f"};
    const lg_function_spec field = {"field", &in, 1, &out, 1, rotor_field, NULL};
    const lg_parameter_spec theta = {"theta", lg_shape1(3), weights};
    const char *path = scratch_path("rotor.h5");
    lg_program_spec spec;
    lg_program *program;
    lg_space space;
    lg_program_spec_init(&spec);
    spec.functions = &field;
    spec.parameters = &theta;
    spec.function_count = spec.parameter_count = 1;
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    assert_ok(lg_space_init_rn(&space, 3));
    assert_ok(lg_model_save(NULL, path, "rotor", program, &space, NULL, NULL));
    lg_program_destroy(program);
    return path;
}

TEST("for a recipe without a scheme, steps use the field of the file") {
    static const lg_recipe without = {.name = "rotor"};
    lg_model_file file;
    lg_program *program;
    size_t at;
    assert_ok(lg_model_load(NULL, save_rotor(), NULL, &file, NULL));
    file.recipe = &without;
    assert_ptr_equal(lg_model_file_scheme(&file), lg_scheme_find("rk4"));
    assert_ok(lg_model_file_program(&file, lg_scheme_find("rkmk4"), &program, NULL));
    assert_ok(lg_program_find(program, "step", &at, NULL));
    lg_program_destroy(program);
    lg_model_file_destroy(&file);
}

TEST("a file of an unknown kind is loaded, evaluated, linearised and stepped by its functions") {
    const double state[3] = {0.3, -0.2, 1.1};
    const char *path = save_rotor();
    lg_model_file file;
    lg_program *program;
    double found[3], A[9];
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    assert_null(file.recipe);
    void *work = test_work(lg_model_work_size(file.model));
    assert_ok(lg_model_field(file.model, state, NULL, found, work));
    assert_ok(lg_model_linearise(file.model, state, NULL, A, NULL, NULL, work));
    for (size_t i = 0; i < 3; i++) {
        assert_close(found[i], weights[i] * sin(state[i]), 1e-15, 0.0);
        for (size_t j = 0; j < 3; j++)
            assert_close(A[3 * i + j], i == j ? weights[i] * cos(state[i]) : 0.0, 1e-15, 0.0);
    }
    const lg_scheme *scheme = lg_scheme_find("rkmk4");
    const size_t bytes = lg_model_stepper_size(file.model, scheme);
    lg_stepper *stepper;
    assert_ok(lg_model_stepper_init(file.model, scheme, &stepper, test_work(bytes), bytes));
    assert_ok(lg_stepper_step(stepper, 0.0, 0.1, state, NULL, found));
    for (size_t i = 0; i < 3; i++) /* tan(x/2) grows by exp(w h) */
        assert_close(found[i], 2.0 * atan(tan(0.5 * state[i]) * exp(0.1 * weights[i])), 1e-6, 0.0);
    lg_model_file_destroy(&file);
    assert_ok(lg_program_load(NULL, path, NULL, &program, NULL));
    lg_program_destroy(program);
    replace_text(path, "model", "space", "R^2");
    assert_refused(read_any, path, LG_FORMAT, "the state has 3 numbers, but the space needs 2", "");
}

/* ---- files that are not models ---- */

TEST("files that state another kind are refused, whatever they contain") {
    static const char *const others[][2] = {
        {"checkpoint", "checkpoint of an unfinished training"},
        {"surrogate-checkpoint", "checkpoint of an unfinished training"},
        {"detector-checkpoint", "checkpoint of an unfinished training"},
        {"machine-checkpoint", "checkpoint of an unfinished training"},
        {"classifier", "lg_classifier_load"},
        {"trajectories", "data"},
        {"trajectory", "data"},
        {"elastica", "data"},
        {"series", "data"},
        {"hamiltonians", "unknown"},
        {"Hamiltonian", "unknown"},
    };
    for (size_t i = 0; i < LG_COUNT(others); i++) {
        lg_file_writer *writer;
        const char *path = scratch_path("other.h5");
        assert_ok(lg_file_writer_create(NULL, path, others[i][0], NULL, &writer, NULL));
        assert_ok(lg_file_writer_commit(writer, NULL));
        lg_file_writer_destroy(writer);
        assert_refused(read_any, path, LG_FORMAT, others[i][0], others[i][1]);
    }
}

/* Written by the data's own writer. test_model_files.c has checkpoints. */
TEST("a data file is not a model") {
    lg_trajectories data;
    const char *path = scratch_path("data.h5");
    assert_ok(
        lg_trajectories_create(NULL, "quartic", &lg_hamiltonian_separable, 2, 2, 3, 1.0, false, 0, &data));
    assert_ok(lg_trajectories_write(NULL, path, &data, NULL));
    lg_trajectories_destroy(&data);
    assert_refused(read_any, path, LG_FORMAT, "trajectories", "data");
}

TEST("files of other programs, and files that state a wrong kind, are refused") {
    static const damage rows[] = {{"@format", TEXT("keras"), LG_FORMAT, "~does not say"},
                                  {"@kind", GONE, LG_FORMAT, "~does not say"},
                                  {"@format_version", WHOLE(LG_FORMAT_VERSION + 1), LG_VERSION, ""}};
    for (int kind = 0; kind < KIND_COUNT; kind++) {
        refuse_damage(read_any, kinds[kind].fresh, rows, LG_COUNT(rows));
        for (int other = 0; other < KIND_COUNT; other++) {
            const char *path = fresh((model_kind)kind);
            replace_text(path, "/", "kind", kinds[other].recipe->name);
            if (kind == other)
                assert_ok(read_any(NULL, path, NULL, NULL));
            else
                assert_refused(read_any, path, LG_FORMAT, "", "");
        }
    }
}

TEST("missing or wrong functions and parameters are refused by name, for every kind") {
    static const damage rows[] = {
        {"functions@order", GONE, LG_FORMAT, ""},
        {"functions@order", WHOLE(3), LG_FORMAT, ""},
        {"functions@order", TEXT("nothing"), LG_FORMAT, "~functions/nothing"},
        {"functions@order", TEXT("../value"), LG_FORMAT, "~plain"},
        {"functions@order", TEXT("step"), LG_FORMAT,
         "~functions/step"}, /* a step calls other functions, if the kind has a step */
        {"functions@order", TEXTS("value", 2), LG_FORMAT, "~functions/value"},
        {"functions/value", GONE, LG_FORMAT, ""},
        {"functions/value", ARRAY(1, 100), LG_FORMAT, "integers"},
        {"functions/value", SCALAR(1), LG_FORMAT, "bytes"},
        {"parameters", GONE, LG_FORMAT, ""},
        {"parameters@order", GONE, LG_FORMAT, ""},
        {"parameters@order", TEXT("nothing"), LG_FORMAT, "~parameters/nothing"},
        {"parameters@theta", GONE, LG_FORMAT, ""},
        {"parameters@theta", TEXT("model/nothing"), LG_FORMAT, "~model/nothing"},
        {"parameters@theta", TEXT("../theta"), LG_FORMAT, "~path"},
        {"parameters@theta", TEXT("/model/theta"), LG_FORMAT, "~path"},
        {"parameters@theta", TEXT("model//theta"), LG_FORMAT, "~path"},
        {"parameters@theta", TEXT("model/theta/"), LG_FORMAT, "~path"},
        {"parameters@theta", WHOLE(3), LG_FORMAT, ""},
        {"parameters@theta", TEXTS("model/nothing", LG_PROGRAM_MOST_NAMES), LG_FORMAT, "~model/nothing"},
        {"parameters@theta", TEXTS("model/nothing", LG_PROGRAM_MOST_NAMES + 1), LG_FORMAT,
         "~/parameters: has too many entries"},
        {"functions@order", TEXTS("value", LG_PROGRAM_MOST_NAMES + 1), LG_FORMAT,
         "~/functions: has too many entries"},
    };
    for (int kind = 0; kind < KIND_COUNT; kind++)
        refuse_damage(read_any, kinds[kind].fresh, rows, LG_COUNT(rows));
}

TEST("every allocation may fail, and nothing leaks") {
    for (int kind = 0; kind < KIND_COUNT; kind++)
        assert_true(fail_every_reading(read_any, fresh((model_kind)kind)) >= 2);
}
