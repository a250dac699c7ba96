/* Model files of machines for tests: from a description in YAML, with random parameters. */
#ifndef LG_MACHINE_MODELS_H
#define LG_MACHINE_MODELS_H

#include "support/fixtures.h"

#include "machine/files/recipe.h"

/* Destroys a machine model when the test that owns it ends. */
static inline void release_machine_model(void *file) {
    lg_recipe_release(&lg_recipe_machine_model, file);
}

/* Makes a model file from the description, with random parameters and scales other than 1. The stored ranges
 * of positions, velocities and inputs are -1 to 2. */
static inline lg_machine_model_file *make_machine_model(const char *yaml, uint64_t seed) {
    lg_error error = {LG_OK, ""};
    lg_machine_file description;
    lg_machine_model_file *made = TEST_ARRAY(lg_machine_model_file, 1);
    lg_machine_model_run *run = &made->run;
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", yaml, strlen(yaml), &description, &told));
    run->machine = description.machine;
    lg_machine_file_destroy(&description);
    assert_ok(lg_machine_model_describe(run, "machine.yaml", yaml, &error));
    lg_machine_scales_init(&run->machine.scales);
    run->machine.scales.time = 0.7;
    run->machine.scales.energy = 1.9;
    for (uint32_t i = 0; i < run->machine.input_count; i++) run->machine.scales.input[i] = 2.0 + i;
    run->scales = run->machine.scales;
    for (uint32_t i = 0; i < LG_MACHINE_RANGE; i++) run->range.low[i] = -1, run->range.high[i] = 2;
    for (uint32_t i = 0; i < LG_MACHINE_COORDINATES; i++) run->position_scale[i] = run->velocity_scale[i] = 1;
    run->scheme = lg_scheme_find("cf4");
    run->substeps = 1;
    run->window = 5;
    run->stride = 1;
    run->windows = 20;
    run->dt = 0.02;
    run->training = (lg_fit_settings){.dtype = LG_F64,
                                      .epochs = 1,
                                      .batch = 10,
                                      .lr = 1e-3,
                                      .lr_step = 1,
                                      .lr_gamma = 1,
                                      .adam_eps = 1e-8,
                                      .shards = 4,
                                      .seed = 1};
    made->parameters = run->machine.parameters;
    /* allocated with malloc, as lg_free requires */
    made->theta = malloc((made->parameters + 1) * sizeof(double));
    assert_non_null(made->theta);
    lg_rng rng = test_rng(seed, 0);
    for (size_t i = 0; i < made->parameters; i++) made->theta[i] = lg_rng_uniform_in(&rng, -0.8, 0.8);
    lg_test_owns(made, release_machine_model);
    return made;
}

static inline void save_machine_model(const lg_machine_model_file *file, const char *path) {
    assert_told(lg_recipe_save(NULL, path, &lg_recipe_machine_model, file, NULL, &told));
}

/* One coordinate of each kind, inputs, and networks. */
static const char machine_of_all_kinds[] =
    "coordinates:\n"
    "  - {name: x, kind: line, velocity: vx}\n"
    "  - {name: theta, kind: angle, velocity: vtheta}\n"
    "  - {name: rod, kind: direction, columns: [a, b, c], velocity: [d, e, f]}\n"
    "  - {name: body, kind: rotation, columns: [p0, p1, p2, p3], velocity: [o1, o2, o3]}\n"
    "  - {name: hull, kind: pose, position: [x1, x2, x3], columns: [q0, q1, q2, q3],\n"
    "     velocity: [v1, v2, v3], rates: [w1, w2, w3], frame: body}\n"
    "inputs: {columns: [u1, u2]}\n"
    "mass: [{kind: network, of: [theta, body.up], hidden: [5]}, {kind: diagonal}]\n"
    "potential: {kind: network, of: [x, theta, rod, body.up, hull], hidden: [6]}\n"
    "damping: {kind: diagonal, quadratic: true}\n"
    "input_map: {kind: network, of: [theta, body], hidden: [4]}\n";
static const char machine_of_a_body[] =
    "coordinates: [{name: body, kind: rotation, columns: [p0, p1, p2, p3], velocity: [o1, o2, o3]}]\n"
    "inputs: {columns: [u1, u2, u3]}\n"
    "mass: {kind: constant}\n"
    "potential: {kind: network, of: [body.up], hidden: [8]}\n"
    "damping: {kind: constant}\n"
    "input_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n";
static const char machine_of_a_cart[] =
    "coordinates: [{name: x, kind: line, velocity: vx}, {name: theta, kind: angle, velocity: vt}]\n"
    "inputs: {columns: [u]}\n"
    "mass: {kind: network, of: [theta], hidden: [8]}\n"
    "potential: {kind: network, of: [theta], hidden: [8]}\n"
    "damping: {kind: diagonal, coulomb: true, coulomb_width: 0.3}\n"
    "input_map: {kind: known, values: [[1], [0]]}\n";
static const char machine_without_inputs[] =
    "coordinates: [{name: rod, kind: direction, columns: [a, b, c], velocity: [d, e, f]}]\n"
    "mass: {kind: diagonal}\n"
    "potential: {kind: gravity}\n"
    "damping: {kind: diagonal}\n";
/* A machine that adds learned terms to a named system. */
static const char machine_of_a_top[] =
    "coordinates: [{name: top, kind: rotation, columns: [a, b, c, d], velocity: [e, f, g]}]\n"
    "inputs: {columns: [u]}\n"
    "system: heavy-top\n"
    "parameters: {mass: 0.8, length: unknown, inertia: [0.3, unknown, unknown],\n"
    "  chi: {start: [0, 0.6, 0.8], unknown: true}}\n"
    "damping: diagonal\n";
static const char machine_of_a_chain[] =
    "coordinates:\n"
    "  - {name: upper, kind: direction, columns: [a, b, c], velocity: [d, e, f]}\n"
    "  - {name: lower, kind: direction, columns: [g, h, i], velocity: [j, k, l]}\n"
    "inputs: {columns: [u]}\n"
    "system: pendulum-chain\n"
    "parameters: {gravity: 9.81, masses: [0.8, unknown], lengths: unknown}\n"
    "mass: {kind: known, values: [0.1, 0.2]}\n"
    "damping: diagonal\n";
static const char machine_of_an_arm[] =
    "coordinates: [{name: p, kind: angle, velocity: vp}, {name: q, kind: angle, velocity: vq}]\n"
    "inputs: {columns: [u]}\n"
    "system: two-link-arm\n"
    "parameters: {masses: unknown, gravity: {start: 9, unknown: true}}\n"
    "potential: {kind: network, of: q, hidden: [4]}\n"
    "input_map: {kind: known, values: [[1], [0]]}\n";
/* Inputs with lags, a dead zone and a curve. */
static const char machine_of_a_motor[] =
    "coordinates: [{name: x, kind: line, velocity: vx}, {name: theta, kind: angle, velocity: vt}]\n"
    "inputs: {columns: [u, w, f], lag: [{order: 2}, none, 0.3],\n"
    "  curve: [{degree: 3}, {dead_zone: 0.2}, {dead_zone: unknown, degree: 2, values: 0.1}]}\n"
    "mass: {kind: constant}\n"
    "damping: {kind: diagonal}\n"
    "input_map: {kind: known, values: [[1, 0, 0.5], [0, 1, 0.7]]}\n";

#endif
