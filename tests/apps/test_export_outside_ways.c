/* The C of the models of examples/programs/ by all compilers and levels: numbers of the tape, objects that need
 * libm alone, the stated stack.
 * ctest-labels: study */
#include "apps/export_support.h"
#include "apps/outside_models.h"

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
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++)
        model_compare(m, program, ways[i].compiler, ways[i].flags, dtype, FEW);
}

/* Frames as the compiler states them: the sum, of scalars_<n> the largest alone, is within stack_size. */
static void check_frames(const outside *o, const char *compiler, const char *flags) {
    static char out[EXPORT_TEXT];
    char command[EXPORT_LINE];
    size_t sum = 0, largest = 0;
    if (!export_has(compiler)) return;
    (void)snprintf(command, sizeof command,
                   "cd %s && %s -std=c99 %s -fstack-usage -c p.c -o stack.o && cat stack.su", o->folder, compiler,
                   flags);
    if (export_shell(command, out) != 0) fail_msg("%s\n%s", command, out);
    for (char *save = NULL, *line = strtok_r(out, "\n", &save); line != NULL;
         line = strtok_r(NULL, "\n", &save)) {
        char name[256];
        unsigned long bytes;
        if (sscanf(line, "%255s %lu", name, &bytes) != 2) continue;
        if (strstr(name, ":scalars_") != NULL)
            largest = bytes > largest ? bytes : largest;
        else
            sum += bytes;
    }
    assert_true(sum > 0);
    if (sum + largest > o->source->stack_size)
        fail_msg("%s: %zu bytes, stated %zu", command, sum + largest, o->source->stack_size);
}

static void check_objects(const model *m, lg_program *program, lg_dtype dtype) {
    static const char *const compilers[] = {"gcc", "clang"};
    static const char *const levels[] = {"-O0", "-O2", "-O3 -march=native"};
    char folder[64];
    outside o = {.dtype = dtype};
    (void)snprintf(folder, sizeof folder, "%s-%s", m->name, dtype == LG_F64 ? "f64" : "f32");
    (void)snprintf(o.folder, sizeof o.folder, "%s/%s", cli_folder, folder);
    assert_int_equal(mkdir(o.folder, 0700), 0);
    outside_write_all(&o, program);
    export_check_objects(folder, "p");
    for (size_t c = 0; c < 2; c++)
        for (size_t i = 0; i < 3; i++) check_frames(&o, compilers[c], levels[i]);
    outside_discard(&o);
}

static void all_compilers_and_levels_give_the_tape_s_numbers(void **state) {
    (void)state;
    model_for_each(compare);
}

static void objects_need_libm_alone_and_the_stated_stack(void **state) {
    (void)state;
    model_for_each(check_objects);
}

static int begin(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_compilers_and_levels_give_the_tape_s_numbers),
        cmocka_unit_test(objects_need_libm_alone_and_the_stated_stack),
    };
    return cmocka_run_group_tests(tests, begin, export_end);
}
