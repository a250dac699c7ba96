/* The C of the models of examples/programs/ by all compilers and levels: numbers of the tape; self-tests,
 * sanitizers, objects that need libm alone, the stated stack. ctest-labels: study */
#include "apps/export_support.h"
#include "apps/outside_models.h"
#include "liegrad/io.h"

enum { FEW = 20 };

static void compare(const model *m, lg_program *program, lg_dtype dtype) {
    static const export_way ways[] = {
        {"gcc", "-O0"},
        {"gcc", "-O1"},
        {"gcc", "-O2 -fsanitize=undefined -fno-sanitize-recover=all"},
        {"gcc", "-O3"},
        {"gcc", "-O3 -march=native -ffp-contract=fast"},
        {"clang", "-O0"},
        {"clang", "-O1"},
        {"clang", "-O2"},
        {"clang", "-O3"},
        {"clang", "-O3 -march=native -ffp-contract=fast"},
        {"g++", "-O1"},
        {"clang++", "-O1"},
    };
    /* Single precision meets every other one. */
    const size_t step = dtype == LG_F64 ? 1 : 2;
    for (size_t i = step - 1; i < LG_COUNT(ways); i += step)
        model_compare(m, program, ways[i].compiler, ways[i].flags, dtype, FEW);
}

/* By lg-export, from the file. */
static void export_and_check(const model *m, lg_program *program, lg_dtype dtype) {
    char folder[64], file[80], path[1024], arguments[256];
    lg_error error;
    const char *type = dtype == LG_F64 ? "f64" : "f32";
    (void)snprintf(folder, sizeof folder, "%s-%s", m->name, type);
    (void)snprintf(file, sizeof file, "%s.h5", folder);
    cli_path(file, path, sizeof path);
    if (lg_program_save(NULL, path, program, NULL, &error) != LG_OK) fail_msg("%s", error.message);
    (void)snprintf(arguments, sizeof arguments, "%s --out %s --name m --dtype %s", file, folder, type);
    export_run(arguments);
    if (m == models)
        export_check_all_ways(folder, "m");
    else
        export_check_ways(folder, "m");
    export_check_objects(folder, "m");
    export_check_stack(folder);
}

static void all_compilers_and_levels_give_the_tape_s_numbers(void **state) {
    (void)state;
    model_for_each(compare);
}

static void exported_models_pass_their_self_tests(void **state) {
    (void)state;
    model_for_each(export_and_check);
}

static int begin(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_compilers_and_levels_give_the_tape_s_numbers),
        cmocka_unit_test(exported_models_pass_their_self_tests),
    };
    return cmocka_run_group_tests(tests, begin, export_end);
}
