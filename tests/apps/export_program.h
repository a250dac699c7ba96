/* Programs for the tests of lg-export, saved in the test's folder. */
#ifndef LG_TEST_EXPORT_PROGRAM_H
#define LG_TEST_EXPORT_PROGRAM_H

#include "autodiff/program_support.h"
#include "export_support.h"

#include "liegrad/hamiltonian.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "hamiltonian/internal.h"

static inline void save_program(lg_program *program, const char *name) {
    assert_told(lg_program_save(NULL, cli_at(test_text("%s.h5", name)), program, NULL, &told));
    lg_program_destroy(program);
}

/* Saves a program with value, gradient, field, step, ten steps, and derivatives of some of them. */
static inline void save_hamiltonian(const char *name, const lg_hamiltonian_family *family) {
    static const uint32_t hidden[] = {24, 16};
    lg_hamiltonian model;
    lg_program *program;
    assert_ok(lg_hamiltonian_init(&model, family, 2, LG_POTENTIAL_MLP, hidden, 2, LG_TANH));
    double *theta = TEST_ARRAY(double, lg_hamiltonian_parameters(&model));
    lg_rng rng = test_rng(7, 2);
    lg_hamiltonian_initialise(&model, &rng, theta);
    assert_told(lg_hamiltonian_program(NULL, &model, theta, NULL, &program, &told));
    const lg_carry carry = {"next", "x"};
    const char *const path = carry.output;
    const lg_loop_spec loop = {sizeof loop, "ten", "step", 10, &carry, 1, &path, 1};
    assert_told(lg_program_add_loop(program, &loop, &told));
    (void)derived(program, LG_DERIVATIVE_FORWARD, "value");
    (void)derived(program, LG_DERIVATIVE_ADJOINT, "step");
    (void)derived(program, LG_DERIVATIVE_JACOBIAN, "field");
    save_program(program, name);
}

/* Two functions of a window of 20 samples of 2 channels: "value" (convolution with sine, max pooling, a dense
 * layer) and "many", which has two results computed from value's. */
enum { WAVE_W1 = 5 * 2 * 6, WAVE_B1 = 6, WAVE_W2 = 8 * 6 * 3, WAVE_B2 = 3 };

static inline lg_status record_waves(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                     lg_var *y) {
    (void)user;
    const lg_var z = lg_conv1d_dense(tape, x[0], theta[0], theta[1], 1, 0, LG_SINE);
    const lg_var pooled = lg_max_pool1d(tape, z, 2, 2);
    const lg_shape shape = lg_var_shape(tape, pooled);
    const lg_var flat = lg_reshape(tape, pooled, lg_shape2(shape.dims[0], shape.dims[1] * shape.dims[2]));
    y[0] = lg_dense(tape, flat, theta[2], theta[3], LG_IDENTITY);
    return lg_tape_status(tape);
}

static inline lg_status record_many(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                    lg_var *y) {
    lg_var z;
    const lg_status status = record_waves(user, tape, theta, x, &z);
    if (status != LG_OK) return status;
    y[0] = lg_act(tape, z, LG_SWISH);
    y[1] = lg_exp(tape, lg_log_softmax(tape, z));
    return lg_tape_status(tape);
}

static inline void save_network(const char *name) {
    static double w1[WAVE_W1], b1[WAVE_B1], w2[WAVE_W2], b2[WAVE_B2];
    double *const values[] = {w1, b1, w2, b2};
    static const size_t counts[] = {WAVE_W1, WAVE_B1, WAVE_W2, WAVE_B2};
    const lg_parameter_spec parameters[] = {{"w1", lg_shape3(5, 2, 6), w1},
                                            {"b1", lg_shape1(6), b1},
                                            {"w2", lg_shape2(48, 3), w2},
                                            {"b2", lg_shape1(3), b2}};
    const lg_port in = {.name = "x", .shape = lg_shape2(20, 2), .unit = "m/s^2", .low = -2, .high = 2};
    const lg_port y = {.name = "y"}, both[] = {{.name = "I"}, {.name = "work_"}};
    const lg_function_spec functions[] = {{"value", &in, 1, &y, 1, record_waves, NULL},
                                          {"many", &in, 1, both, 2, record_many, NULL}};
    lg_program_spec spec;
    lg_program *program;
    lg_rng rng = test_rng(3, 4);
    for (size_t i = 0; i < 4; i++)
        for (size_t k = 0; k < counts[i]; k++) values[i][k] = 0.4 * lg_rng_normal(&rng);
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = 4;
    spec.functions = functions;
    spec.function_count = 2;
    spec.description = "Waves: what */ is it?\nTwo lines.";
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    (void)derived(program, LG_DERIVATIVE_JACOBIAN, "value");
    (void)derived(program, LG_DERIVATIVE_ADJOINT, "many");
    (void)derived(program, LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "value");
    save_program(program, name);
}

#endif
