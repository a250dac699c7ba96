/* NULL arguments of the functions of programs: each that is needed is refused, whatever the others are. */
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "program_support.h"

#include "liegrad/program_image.h"
#include "liegrad/train.h"

enum { POINTERS = 4 };

/* X(function, call by the pointers p[0], p[1], ...): every one of them is needed. */
#define CALLS(X)                                                                                             \
    X(lg_program_build, lg_program_build(NULL, p[0], p[1], NULL))                                            \
    X(lg_program_begin, lg_program_begin(NULL, p[0], p[1], NULL))                                            \
    X(lg_program_find, lg_program_find(p[0], p[1], p[2]))                                                    \
    X(lg_program_set_parameter, lg_program_set_parameter(p[0], 0, p[1]))                                     \
    X(lg_program_record, lg_program_record(p[0], p[1], 0, NULL, p[2], p[3]))                                 \
    X(lg_program_derive, lg_program_derive(p[0], p[1], NULL))                                                \
    X(lg_program_sparsity, lg_program_sparsity(p[0], 0, 0, 0, p[1], NULL))                                   \
    X(lg_program_add_loop, lg_program_add_loop(p[0], p[1], p[2], 2, p[3], 1, NULL))                          \
    X(lg_plan_create, lg_plan_create(p[0], 0, NULL, p[1], NULL))                                             \
    X(lg_program_eval, lg_program_eval(NULL, p[0], p[1], 1, p[2], p[3], NULL))                               \
    X(lg_program_write_c, lg_program_write_c(p[0], p[1], p[2], NULL))                                        \
    X(lg_function_image_create, lg_function_image_create(p[0], 0, p[1]))                                     \
    X(lg_program_add_image, lg_program_add_image(p[0], p[1], NULL))                                          \
    X(lg_program_train, lg_program_train(NULL, p[0], p[1], p[2], 1, NULL, NULL, NULL))

#define DEFINE(name, ...)                                                                                    \
    static lg_status call_##name(void *const *p) {                                                           \
        return __VA_ARGS__;                                                                                  \
    }
CALLS(DEFINE)

RECORDING(product) {
    y[0] = lg_mul(tape, x[0], theta[0]);
}

/* In a child: a crash is a finding. */
static void refuse(const char *name, lg_status (*call)(void *const *), void *const *p, int missing) {
    int status = 0;
    const pid_t child = fork();
    if (child == 0) {
        static const int crashes[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL};
        for (size_t i = 0; i < LG_COUNT(crashes); i++) (void)signal(crashes[i], SIG_DFL); /* not cmocka's */
        _exit((int)call(p));
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    if (!WIFEXITED(status)) fail_msg("%s: NULL for pointer %d ends the process", name, missing);
    const lg_status expected = missing < 0 ? LG_OK : LG_INVALID_ARGUMENT;
    if ((lg_status)WEXITSTATUS(status) != expected)
        fail_msg("%s: pointer %d: %s, expected %s", name, missing,
                 lg_status_name((lg_status)WEXITSTATUS(status)), lg_status_name(expected));
}

TEST("every pointer that a function of programs needs is refused as NULL") {
    static double number = 1.0, other[1];
    static lg_port in = {.name = "x", .shape = {1, {1, 0, 0, 0}}}, out = {.name = "y"};
    lg_function_spec function = {"f", &in, 1, &out, 1, product, NULL};
    lg_parameter_spec theta = {"theta", lg_shape1(1), &number};
    lg_program_spec whole = spec_of(&theta, 1, &function, 1), begun = spec_of(&theta, 1, NULL, 0);
    lg_program *program = test_program(&whole), *made = NULL, *bare = NULL;
    assert_ok(lg_program_begin(NULL, &begun, &bare, NULL));
    lg_test_owns(bare, release_program);
    lg_function_image *image = NULL, *copy = NULL;
    assert_ok(lg_function_image_create(program, 0, &image));
    lg_derivative what;
    lg_derivative_init(&what);
    what.function = "f";
    lg_c_options how;
    lg_c_options_init(&how);
    how.name = "p";
    lg_tape *tape = test_tape(LG_F64);
    lg_var x = lg_input(tape, lg_shape2(1, 1), &number), y;
    size_t index;
    unsigned char pattern[1];
    lg_carry carry = {"y", "x"};
    lg_plan *plan = NULL;
    lg_c_source *source = NULL;
    const double *inputs[1] = {&number};
    double *outputs[1] = {other};
    const struct {
        const char *name;
        lg_status (*call)(void *const *p);
        void *p[POINTERS];
    } rows[] = {{"lg_program_build", call_lg_program_build, {&whole, &made}},
                {"lg_program_begin", call_lg_program_begin, {&begun, &made}},
                {"lg_program_find", call_lg_program_find, {program, "f", &index}},
                {"lg_program_set_parameter", call_lg_program_set_parameter, {program, &number}},
                {"lg_program_record", call_lg_program_record, {tape, program, &x, &y}},
                {"lg_program_derive", call_lg_program_derive, {program, &what}},
                {"lg_program_sparsity", call_lg_program_sparsity, {program, pattern}},
                {"lg_program_add_loop", call_lg_program_add_loop, {program, "l", "f", &carry}},
                {"lg_plan_create", call_lg_plan_create, {program, &plan}},
                {"lg_program_eval", call_lg_program_eval, {program, "f", inputs, outputs}},
                {"lg_program_write_c", call_lg_program_write_c, {program, &how, &source}},
                {"lg_function_image_create", call_lg_function_image_create, {program, &copy}},
                {"lg_program_add_image", call_lg_program_add_image, {bare, image}},
                {"lg_program_train", call_lg_program_train, {program, "f", inputs}}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        refuse(rows[i].name, rows[i].call, rows[i].p, -1);
        for (int k = 0; k < POINTERS && rows[i].p[k] != NULL; k++) {
            void *p[POINTERS];
            memcpy(p, rows[i].p, sizeof p);
            p[k] = NULL;
            refuse(rows[i].name, rows[i].call, p, k);
        }
    }
    lg_function_image_destroy(image);
}
