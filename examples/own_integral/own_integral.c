/* own_integral: writes a first integral G(x) into a file, for lg-hamiltonian train --penalty 0.1
 * --penalty-integral FILE. The state x is a row of the data: here (q, p) of one link, three numbers each. */
#include <stdio.h>

#include <liegrad/ops.h>
#include <liegrad/program.h>

enum { D = 6 }; /* numbers of a state */

/* G = e3.(q x p), for each row of x (B, D) */
static lg_status integral(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *G) {
    const lg_var q = lg_slice(t, x[0], 1, 0, 3), p = lg_slice(t, x[0], 1, 3, 3);
    (void)user, (void)theta;
    *G = lg_slice(t, lg_cross(t, q, p), 1, 2, 1);
    return lg_tape_status(t);
}

int main(int argc, char **argv) {
    const lg_port x = {.name = "x", .shape = lg_shape1(D), .low = -2, .high = 2}, G = {.name = "G"};
    const lg_function_spec function = {"integral", &x, 1, &G, 1, integral, NULL};
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_error error;
    if (argc != 2) return fprintf(stderr, "usage: own_integral FILE.h5\n"), 2;
    lg_program_spec_init(&spec);
    spec.functions = &function;
    spec.function_count = 1;
    lg_status status = lg_program_build(NULL, &spec, &program, &error);
    if (status == LG_OK) status = lg_program_save(NULL, argv[1], program, NULL, &error);
    if (status != LG_OK) fprintf(stderr, "own_integral: %s\n", error.message);
    lg_program_destroy(program);
    return status == LG_OK ? 0 : 1;
}
