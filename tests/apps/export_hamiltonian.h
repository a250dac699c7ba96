/* Learned Hamiltonians for the tests of lg-export: every family, potential, activation and kind of scheme. */
#ifndef LG_TEST_EXPORT_HAMILTONIAN_H
#define LG_TEST_EXPORT_HAMILTONIAN_H

#include "support/models.h"
#include "export_support.h"

#include "liegrad/integrators.h"
#include "liegrad/io.h"
#include "liegrad/model.h"
#include "hamiltonian/internal.h"

#define CHAIN     (&lg_hamiltonian_chain)
#define SEPARABLE (&lg_hamiltonian_separable)
enum { MLP = LG_POTENTIAL_MLP, LINEAR = LG_POTENTIAL_LINEAR, DICTIONARY = LG_POTENTIAL_DICTIONARY };
enum { NONE = LG_SYMMETRY_NONE, EVEN = LG_SYMMETRY_EVEN, ODD = LG_SYMMETRY_ODD };

/* One row: the model, the scheme of its step ("": the default) and how it is compiled. */
typedef struct sample {
    const char *folder;
    const lg_hamiltonian_family *family;
    uint32_t links;
    int potential, symmetry;
    lg_activation activation;
    const char *scheme;
    int evaluations; /* in a step */
    const char *compiler, *flags;
} sample;

/* A scheme of each kind from a file: Kutta's third order with dexpinv cut behind the fourth term (odd ones
 * are 0 but the first); the classical tableau in brackets only; a reused point; McLachlan and Atela's second
 * order. */
static const char truncated_yaml[] =
    "kind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\ndexpinv: 4\n";
static const char reused_yaml[] =
    "kind: commutator-free\norder: 1\nrows:\n  - []\n  - [1/4]\n  - {base: 2, exponentials: [[0, 1/4], "
    "[1/8, 1/8]]}\n  - {base: 3, exponentials: [[0, 0, 1/4]]}\n";
static const char splitting_yaml[] =
    "kind: splitting\norder: 2\nkick: [0.70710678118654752, 0.29289321881345248]\n"
    "drift: [0.29289321881345248, 0.70710678118654752]\n";

static const sample samples[] = {
    {"chain1", CHAIN, 1, MLP, NONE, LG_TANH, "", 4, "gcc", "-O2"},
    {"chain2", CHAIN, 2, MLP, NONE, LG_SIGMOID, "rkmk4", 4, "clang", "-O3"},
    {"chain3", CHAIN, 3, MLP, NONE, LG_SWISH, "rkmk54", 6, "gcc", "-O1"},
    {"chain5", CHAIN, 5, MLP, NONE, LG_SINE, "lie-euler", 1, "gcc", "-O3"},
    {"linear1", CHAIN, 1, LINEAR, NONE, LG_TANH, "cf32a", 3, "clang", "-O0"},
    {"linear3", CHAIN, 3, LINEAR, NONE, LG_TANH, "rkmk4-2c", 4, "gcc", "-O0"},
    {"relu2", CHAIN, 2, MLP, NONE, LG_RELU, "cf43", 4, "clang", "-O2"},
    {"leaky1", CHAIN, 1, MLP, NONE, LG_LEAKY_RELU, "lie-heun", 2, "g++", "-O2"},
    {"cg2", CHAIN, 2, MLP, NONE, LG_TANH, "cg3", 3, "clang++", "-O1"},
    {"cut2", CHAIN, 2, MLP, NONE, LG_TANH, "truncated.yaml", 3, "gcc", "-O2"},
    {"base1", CHAIN, 1, MLP, NONE, LG_SWISH, "reused.yaml", 3, "clang", "-O1"},
    {"flat1", SEPARABLE, 1, MLP, NONE, LG_TANH, "", 2, "gcc", "-O2"},
    {"flat2", SEPARABLE, 2, LINEAR, NONE, LG_TANH, "rk4", 4, "clang", "-O2"},
    {"flat4", SEPARABLE, 4, MLP, NONE, LG_SWISH, "splitting.yaml", 2, "gcc", "-O3"},
    {"pair2", SEPARABLE, 2, MLP, NONE, LG_SIGMOID, "dp54", 6, "g++", "-O3"},
    {"free2", SEPARABLE, 2, MLP, NONE, LG_SINE, "cf4", 4, "clang", "-O3"},
    {"moan2", SEPARABLE, 2, MLP, NONE, LG_TANH, "blanes-moan", 7, "gcc", "-O2"},
    {"euler4", SEPARABLE, 4, LINEAR, NONE, LG_TANH, "symplectic-euler", 1, "gcc", "-O0"},
    {"words2", CHAIN, 2, DICTIONARY, NONE, LG_TANH, "", 4, "gcc", "-O2"},
    {"words3", SEPARABLE, 3, DICTIONARY, ODD, LG_TANH, "dp54", 6, "clang", "-O3"},
    {"even2", CHAIN, 2, MLP, EVEN, LG_SWISH, "cf4", 4, "clang", "-O2"},
    {"odd2", SEPARABLE, 2, MLP, ODD, LG_TANH, "blanes-moan", 7, "g++", "-O2"},
};
enum { SAMPLES = LG_COUNT(samples) };

static inline int hamiltonians_begin(void **state) {
    if (export_begin(state) != 0) return -1;
    cli_write("truncated.yaml", truncated_yaml);
    cli_write("reused.yaml", reused_yaml);
    cli_write("splitting.yaml", splitting_yaml);
    return 0;
}

/* A model with random parameters, on the disk too. */
typedef struct learned {
    lg_hamiltonian_file file;
    lg_model *model;
    lg_scheme *read; /* from a file */
    const lg_scheme *scheme;
    size_t n, m; /* numbers in a state and in an input */
} learned;

static inline void learned_save(learned *made, const char *name) {
    char path[1024], file[64];
    lg_error error = {LG_OK, ""};
    (void)snprintf(file, sizeof file, "%s.h5", name);
    cli_path(file, path, sizeof path);
    if (lg_model_save_hamiltonian(NULL, path, &made->file, NULL, &error) != LG_OK)
        fail_msg("%s", error.message);
}

static inline learned learned_make(const sample *of) {
    static const uint32_t hidden[] = {24, 16};
    learned made = {.file.run = {.scheme = lg_scheme_find(of->family->scheme),
                                 .substeps = 1,
                                 .trajectories = 20,
                                 .points = 5,
                                 .dt = 0.025}};
    lg_hamiltonian_run *run = &made.file.run;
    lg_rng rng;
    assert_ok(lg_hamiltonian_init(&run->model, of->family, of->links, (lg_potential_kind)of->potential,
                                  hidden, 2, of->activation));
    run->model.symmetry = (lg_symmetry)of->symmetry;
    run->training = (lg_training){.dtype = LG_F64,
                                  .epochs = 1,
                                  .batch = 10,
                                  .lr = 1e-3,
                                  .lr_step = 1,
                                  .lr_gamma = 1,
                                  .adam_eps = 1e-8,
                                  .shards = 4,
                                  .seed = 1};
    made.file.parameters = lg_hamiltonian_parameters(&run->model);
    made.file.theta = calloc(made.file.parameters, sizeof(double));
    assert_non_null(made.file.theta);
    lg_rng_seed(&rng, 7, of->links);
    lg_hamiltonian_initialise(&run->model, &rng, made.file.theta);
    if (strncmp(of->folder, "stiff", 5) == 0) { /* the last row of Gamma nearly depends on the others */
        double *gamma = made.file.theta + lg_mlp_parameters(&run->model.net);
        const uint32_t k = of->links;
        for (uint32_t i = 0; i < k; i++) {
            gamma[(k - 1) * k + i] = 0.5 * gamma[i] - 0.7 * gamma[k + i] + 0.2 * gamma[(k - 1) * k + i];
            gamma[k * k + i] = 0;
        }
    }
    learned_save(&made, of->folder);
    assert_ok(test_hamiltonian_model(NULL, &run->model, made.file.theta, &made.model, NULL));
    made.n = lg_model_inputs(made.model);
    made.m = lg_model_input_dim(made.model);
    return made;
}

/* The scheme of the row, as the library has it. */
static inline void learned_scheme(learned *made, const sample *of) {
    const char *name = of->scheme[0] != '\0' ? of->scheme : of->family->scheme;
    char path[1024];
    made->scheme = lg_scheme_find(name);
    if (made->scheme != NULL) return;
    lg_error error = {LG_OK, ""};
    cli_path(name, path, sizeof path);
    if (lg_scheme_read(NULL, path, &made->read, &error) != LG_OK) fail_msg("%s", error.message);
    made->scheme = made->read;
}

static inline void learned_free(learned *made) {
    lg_scheme_destroy(made->read);
    lg_model_destroy(made->model);
    free(made->file.theta);
}

/* lg-export into <folder>-<type>, name `m`. */
static inline void learned_export(const sample *of, const char *dtype, char *folder, size_t size) {
    char arguments[256];
    (void)snprintf(folder, size, "%s-%s", of->folder, dtype);
    (void)snprintf(arguments, sizeof arguments, "%s.h5 --out %s --name m --dtype %s%s%s", of->folder, folder,
                   dtype, of->scheme[0] != '\0' ? " --scheme " : "", of->scheme);
    export_run(arguments);
}

#endif
