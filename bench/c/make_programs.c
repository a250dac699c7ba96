/* make_programs FOLDER: writes a program as a file, FOLDER/p.h5, and as C, FOLDER/p.h, p.c, p_weights.c. Its
 * function `step` is one step of bench/cpp/pendulum.hpp, y (4) over 0.01 s, written with plain operations on
 * variables of one number per row. Its adjoint is the function `adj1_step`. */
#include <stdio.h>
#include <string.h>

#include "liegrad/ops.h"
#include "liegrad/program.h"

static void field(lg_tape *t, const lg_var *y, lg_var *f) {
    const double g = 9.81;
    const lg_var s1 = lg_sin(t, y[0]), s2 = lg_sin(t, y[1]), c1 = lg_cos(t, y[0]), c2 = lg_cos(t, y[1]);
    const lg_var s = lg_sub(t, lg_mul(t, s1, c2), lg_mul(t, c1, s2));
    const lg_var c = lg_add(t, lg_mul(t, c1, c2), lg_mul(t, s1, s2));
    const lg_var det = lg_add_scalar(t, lg_neg(t, lg_mul(t, c, c)), 2);
    const lg_var w11 = lg_mul(t, y[2], y[2]), w22 = lg_mul(t, y[3], y[3]);
    const lg_var r1 = lg_sub(t, lg_scale(t, s1, -2 * g), lg_mul(t, w22, s));
    const lg_var r2 = lg_sub(t, lg_mul(t, w11, s), lg_scale(t, s2, g));
    f[0] = y[2];
    f[1] = y[3];
    f[2] = lg_div(t, lg_sub(t, r1, lg_mul(t, c, r2)), det);
    f[3] = lg_div(t, lg_sub(t, lg_scale(t, r2, 2), lg_mul(t, c, r1)), det);
}

static lg_status step(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    static const double offset[] = {0, 0.5, 0.5, 1};
    const double h = 0.01;
    lg_var y[4], k[4][4], at[4], next[4];
    (void)user;
    (void)theta;
    for (uint32_t j = 0; j < 4; j++) y[j] = lg_slice(t, in[0], 1, j, 1);
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 4; j++)
            at[j] = i == 0 ? y[j] : lg_add(t, y[j], lg_scale(t, k[i - 1][j], h * offset[i]));
        field(t, at, k[i]);
    }
    for (int j = 0; j < 4; j++) {
        const lg_var x[5] = {y[j], k[0][j], k[1][j], k[2][j], k[3][j]};
        const double c[5] = {1, h / 6, h / 3, h / 3, h / 6};
        next[j] = lg_linear_combination(t, x, c, 5);
    }
    out[0] = lg_concat(t, next, 4, 1);
    return lg_tape_status(t);
}

static lg_status make_pendulum(lg_program **out, lg_error *error) {
    const lg_port y = {.name = "y", .shape = lg_shape1(4)}, next = {.name = "next"};
    const lg_function_spec function = {"step", &y, 1, &next, 1, step, NULL};
    lg_program_spec spec;
    lg_derivative what;
    lg_program_spec_init(&spec);
    spec.functions = &function;
    spec.function_count = 1;
    lg_status status = lg_program_build(NULL, &spec, out, error);
    if (status != LG_OK) return status;
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_ADJOINT;
    what.function = "step";
    return lg_program_derive(*out, &what, error);
}

static int write_file(const char *folder, const char *name, const char *const *parts) {
    char path[1024];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    if (file == NULL) return 0;
    for (; *parts != NULL; parts++) (void)fputs(*parts, file);
    return fclose(file) == 0;
}

static int write_all(const char *folder, const lg_program *program, lg_error *error) {
    lg_c_options options;
    lg_c_source *s;
    char path[1024];
    lg_c_options_init(&options);
    options.name = "p";
    (void)snprintf(path, sizeof path, "%s/p.h5", folder);
    if (lg_program_save(NULL, path, program, NULL, error) != LG_OK ||
        lg_program_write_c(program, &options, &s, error) != LG_OK)
        return 0;
    const int good =
        write_file(folder, "p.h",
                   (const char *const[]){"#ifndef P_H\n#define P_H\n", s->sizes, s->declarations, "#endif\n",
                                         NULL}) &&
        write_file(folder, "p.c", (const char *const[]){"#include \"p.h\"\n", s->arrays, s->code, NULL}) &&
        write_file(folder, "p_weights.c",
                   (const char *const[]){"#include \"p.h\"\n", s->arrays, s->weights, NULL});
    lg_c_source_destroy(s);
    return good;
}

int main(int argc, char **argv) {
    lg_error error = {.status = LG_OK};
    lg_program *program = NULL;
    if (argc != 2) return 2;
    const int good = make_pendulum(&program, &error) == LG_OK && write_all(argv[1], program, &error);
    if (!good) (void)fprintf(stderr, "%s\n", error.message);
    lg_program_destroy(program);
    return good ? 0 : 1;
}
