/* Model files of machines: they come back as they were saved, as a file and as a model in a loop. */
#include "support/models.h"
#include "io_test.h"
#include "support/machine_models.h"

static const char *const texts[] = {machine_of_all_kinds,   machine_of_a_body, machine_of_a_cart,
                                    machine_without_inputs, machine_of_a_top,  machine_of_a_chain,
                                    machine_of_an_arm};

static const char *saved(size_t which) {
    const char *path = scratch_path("machine.h5");
    save_machine_model(make_machine_model(texts[which], 7), path);
    return path;
}

TEST("a file comes back with its machine, scales, range and parameters") {
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        const lg_machine_model_file *made = make_machine_model(texts[i], 7);
        lg_machine_model_file *again = TEST_ARRAY(lg_machine_model_file, 1);
        const char *path = scratch_path("machine.h5");
        save_machine_model(made, path);
        assert_ok(lg_model_load_machine_model(NULL, path, NULL, again, NULL));
        assert_int_equal(again->parameters, made->parameters);
        assert_memory_equal(again->theta, made->theta, made->parameters * sizeof *made->theta);
        assert_memory_equal(&again->run.scales, &made->run.scales, sizeof made->run.scales);
        assert_memory_equal(&again->run.machine.scales, &made->run.scales, sizeof made->run.scales);
        assert_memory_equal(&again->run.range, &made->run.range, sizeof made->run.range);
        assert_string_equal(again->run.text, made->run.text);
        assert_int_equal(again->run.machine.term_count, made->run.machine.term_count);
        assert_true(again->run.scheme == made->run.scheme);
        lg_machine_model_file_destroy(again);
    }
}

TEST("a file loads as a model that computes what the machine's parameters say") {
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        const lg_machine_model_file *made = make_machine_model(texts[i], 7);
        lg_model_file file;
        lg_model *expected;
        assert_ok(lg_model_load(NULL, saved(i), NULL, &file, NULL));
        assert_ok(test_machine_model(NULL, &made->run.machine, made->theta, &expected, NULL));
        const lg_machine_model_file *loaded = lg_model_file_of(&file, &lg_recipe_machine_model);
        assert_non_null(loaded);
        assert_null(lg_model_file_of(&file, &lg_recipe_table));
        const size_t n = lg_model_inputs(file.model), m = lg_model_input_dim(file.model);
        assert_int_equal(n, lg_model_inputs(expected));
        assert_int_equal(m, made->run.machine.input_count);
        void *work = test_work(lg_model_work_size(file.model));
        double x[64], field[64], same[64], H, again, u[LG_MACHINE_INPUTS];
        memcpy(x, test_numbers(3, n, -1, 1), n * sizeof *x);
        memcpy(u, test_numbers(4, LG_MACHINE_INPUTS, -1, 1), sizeof u);
        lg_model_eval(file.model, x, &H, work);
        lg_model_eval(expected, x, &again, work);
        assert_true(isfinite(H) && H == again);
        assert_ok(lg_model_field(file.model, x, u, field, work));
        assert_ok(lg_model_field(expected, x, u, same, work));
        lg_space space;
        assert_ok(lg_machine_space(&loaded->run.machine, &space));
        assert_memory_equal(field, same, space.algebra_dim * sizeof *field);
        lg_model_destroy(expected);
        lg_model_file_destroy(&file);
        assert_null(file.contents);
        lg_model_file_destroy(&file); /* twice */
    }
}

static lg_status read_any(const lg_context *context, const char *path, const lg_read_options *options,
                          lg_error *error) {
    lg_model_file file;
    const lg_status status = lg_model_load(context, path, options, &file, error);
    if (status == LG_OK) lg_model_file_destroy(&file);
    return status;
}

TEST("every allocation may fail while a file is loaded as a model") {
    assert_true(fail_every_reading(read_any, saved(2)) >= 10);
}

TEST("a checkpoint of a machine is no model") {
    const char *path = scratch_path("other.h5");
    lg_file_writer *writer;
    assert_ok(lg_file_writer_create(NULL, path, "machine-checkpoint", NULL, &writer, NULL));
    assert_ok(lg_file_writer_commit(writer, NULL));
    lg_file_writer_destroy(writer);
    assert_refused(read_any, path, LG_FORMAT, "machine-checkpoint", "unfinished training");
}
