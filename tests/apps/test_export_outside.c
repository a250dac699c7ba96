/* Exports programs that the library does not know (examples/programs/), after training and differentiating
 * them. Their self-tests are run with three compilers, and their objects must need only libm. One model (in
 * test_export_outside_ways: all models) is also compiled in both types by all compilers, as straight code and
 * as loops, and its stack is checked. test_program_c compares the C of each operation with the tape.
 * ctest-labels: slow apps/lg-export src/autodiff examples/programs */
#include "../../examples/programs/programs.h"
#include "export_support.h"
#include "liegrad/program.h"

static const struct {
    const char *name, *function;
    lg_status (*make)(lg_program **out, training *how, lg_error *error);
} models[] = {{"throw", "value", make_throw},
              {"driven", "step", make_driven},
              {"attitude", "step", make_attitude},
              {"waveforms", "value", make_waveforms}};

/* Whether the model is compiled by all compilers. From the third model on, this takes a minute per model. */
static bool in_every_way(size_t i) {
#ifdef EVERY_MODEL
    return i < LG_COUNT(models);
#else
    return i == 1;
#endif
}

RELEASES(release_program, lg_program_destroy)

/* Writes NAME.h5: a trained program with the derivatives of its function. */
static void make(size_t i) {
    lg_program *program = NULL;
    training how;
    lg_error error = {.status = LG_OK};
    if (models[i].make(&program, &how, &error) != LG_OK) fail_msg("%s: %s", models[i].name, error.message);
    lg_test_owns(program, release_program);
    assert_true(use(program, models[i].function));
    assert_ok(lg_program_save(NULL, cli_at(test_text("%s.h5", models[i].name)), program, NULL, NULL));
}

TEST("self-tests of the example programs pass, their objects need only libm and keep to the stated stack") {
    static const export_way few[] = {{"gcc", "-O2"}, {"clang", "-O1"}, {"g++", "-O1"}};
    static const char *const options[] = {"--dtype f64", "--dtype f32", "--dtype f64 --compact"};
    for (size_t i = 0; i < LG_COUNT(models); i++) {
        make(i);
        for (size_t k = 0; k < (in_every_way(i) ? LG_COUNT(options) : 1); k++) {
            const char *folder = test_text("%s%zu", models[i].name, k);
            export_run(
                test_text("%s.h5 --out %s --name m --golden 20 %s", models[i].name, folder, options[k]));
            if (in_every_way(i) && k == 0)
                export_check_ways(folder, "m");
            else
                export_check_each(folder, "m", few, LG_COUNT(few));
            export_check_objects(folder, "m");
            if (in_every_way(i)) export_check_stack(folder);
        }
    }
}

TEST_GROUP(export_begin, export_end)
