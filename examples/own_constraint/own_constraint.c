/* own_constraint KNOT.h5: a bead on a trefoil knot in R^3, held by two constraints g(q) = 0. Writes the
 * constraint as a program, generates trajectories, learns V and the mass from them, and compares the learned
 * motion with the true one. KNOT.h5 also serves `lg-hamiltonian generate KNOT.h5 --out data.h5`. */
#include <math.h>
#include <stdio.h>

#include <liegrad/hamiltonian.h>
#include <liegrad/ops.h>

enum { N = 100, M = 5, D = 6, STEPS = 1000 };
static lg_error error;

/* g = ((r - 1)^2 + z^2 - 0.4^2, Im((r - 1 + i z)^2 (x - i y)^3)) with r^2 = x^2 + y^2: the torus of the radii
 * 1 and 0.4, and on it 2 phi = 3 theta (mod pi) for the two angles. */
static lg_status knot(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var x = lg_slice(t, in[0], 1, 0, 1), y = lg_slice(t, in[0], 1, 1, 1),
                 z = lg_slice(t, in[0], 1, 2, 1);
    const lg_var xx = lg_square(t, x), yy = lg_square(t, y), zz = lg_square(t, z);
    const lg_var a = lg_add_scalar(t, lg_sqrt(t, lg_add(t, xx, yy)), -1), aa = lg_square(t, a);
    const lg_var re = lg_mul(t, x, lg_sub(t, xx, lg_scale(t, yy, 3))),
                 im = lg_mul(t, y, lg_sub(t, lg_scale(t, xx, 3), yy));
    const lg_var turn =
        lg_sub(t, lg_mul(t, lg_scale(t, lg_mul(t, a, z), 2), re), lg_mul(t, lg_sub(t, aa, zz), im));
    out[0] = lg_concat(t, (lg_var[]){lg_add_scalar(t, lg_add(t, aa, zz), -0.16), turn}, 2, 1);
    return (void)user, (void)theta, lg_tape_status(t);
}

/* V = z + x^2/2; the mass is 1. */
static lg_status potential(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var x = lg_slice(t, in[0], 1, 0, 1), z = lg_slice(t, in[0], 1, 2, 1);
    out[0] = lg_add(t, z, lg_scale(t, lg_square(t, x), 0.5));
    return (void)user, (void)theta, lg_tape_status(t);
}

#define NEED(call)                                                                                           \
    if ((call) != LG_OK) return (void)fprintf(stderr, "own_constraint: %s\n", error.message), 1

int main(int argc, char **argv) {
    static double data[N * M * D], energies[N], theta[1000], truth[(STEPS + 1) * D], learned[(STEPS + 1) * D],
        times[STEPS + 1];
    const lg_port q = {.name = "q", .shape = lg_shape1(3), .low = -1.4, .high = 1.4}, g = {.name = "g"},
                  V = {.name = "V"};
    const lg_function_spec functions[] = {{"constraint", &q, 1, &g, 1, knot, NULL},
                                          {"potential", &q, 1, &V, 1, potential, NULL}};
    lg_program_spec spec;
    lg_program *program, *model_program;
    lg_constraint *bead, *model_bead;
    lg_program_spec_init(&spec);
    spec.functions = functions, spec.function_count = 2;
    NEED(lg_program_build(NULL, &spec, &program, &error));
    if (argc > 1) NEED(lg_program_save(NULL, argv[1], program, NULL, &error));
    NEED(lg_constraint_create(NULL, program, &bead, &error));

    lg_trajectory_options how;
    lg_trajectory_options_init(&how);
    how.trajectories = N, how.points = M, how.t_end = 0.2;
    NEED(lg_constraint_generate(bead, &how, NULL, data, energies, &error));

    lg_hamiltonian model;
    lg_hamiltonian_problem problem = {.model = &model,
                                      .scheme = lg_scheme_find("rk4"),
                                      .substeps = 1,
                                      .trajectories = N,
                                      .points = M,
                                      .dt = how.t_end / (M - 1),
                                      .data = data};
    lg_fit_problem loss;
    lg_fit_options options;
    lg_fit *fit;
    lg_rng rng;
    NEED(lg_hamiltonian_init(&model, lg_hamiltonian_family_find("constrained"), 3, LG_POTENTIAL_MLP,
                             (uint32_t[]){10}, 1, LG_TANH));
    model.constraint = bead;
    NEED(lg_hamiltonian_find_scales(&problem, &model.scales, &error));
    NEED(lg_hamiltonian_weigh(&problem, &error));
    lg_rng_seed(&rng, 1, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    lg_hamiltonian_fit_problem(&problem, &loss);
    lg_fit_options_init(&options);
    options.epochs = 400;
    NEED(lg_fit_plan_parse("ssbroyden", true, &options.plan, &error));
    NEED(lg_fit_create(NULL, &loss, &options, theta, &fit, &error));
    NEED(lg_fit_run(fit, &error));
    lg_fit_parameters(fit, theta);

    /* A learned model is a program with constraint, potential and mass too. */
    double off = 0, gap = 0, H[2];
    lg_constraint_view view;
    NEED(lg_hamiltonian_program(NULL, &model, theta, NULL, &model_program, &error));
    NEED(lg_constraint_create(NULL, model_program, &model_bead, &error));
    for (int i = 0; i <= STEPS; i++) times[i] = 0.01 * i;
    NEED(lg_constraint_flow(bead, 1e-12, times, STEPS + 1, data, truth, &error));
    NEED(lg_constraint_rattle(model_bead, 4, 0.01, STEPS, 1, data, learned, &error));
    NEED(lg_constraint_energy(bead, learned, &H[0], &error));
    NEED(lg_constraint_energy(bead, learned + STEPS * D, &H[1], &error));
    for (int i = 0; i <= STEPS; i++) {
        NEED(lg_constraint_look(bead, 0, learned + i * D, &view, &error));
        off = fmax(off, view.residual);
        for (int j = 0; j < 3; j++) gap = fmax(gap, fabs(learned[i * D + j] - truth[i * D + j]));
    }
    printf("%u constraints; in %g s the learned bead leaves them by %.1e and the true motion by %.1e; the "
           "true energy drifts by %.1e\n",
           lg_constraint_equations(bead), times[STEPS], off, gap, fabs(H[1] - H[0]));
    return off < 1e-14 && gap < 0.1 ? 0 : 1;
}
