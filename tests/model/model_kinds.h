/* The kinds of models in files: examples of each kind, and functions that work on files of any kind. */
#ifndef LG_MODEL_KINDS_H
#define LG_MODEL_KINDS_H

#include "support/io_test.h"

#include "liegrad/anomaly.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/table.h"
#include "model/files/recipe.h"
#include "support/machine_models.h"
#include "support/modes.h"
#include "hamiltonian/internal.h"

/* Random numbers that a file of this dtype holds exactly. Allocated with lg_alloc, because the file's own
 * function frees them. */
static inline double *drawn(size_t count, lg_rng *rng, lg_dtype dtype) {
    double *out = lg_test_gives(count, sizeof *out);
    assert_non_null(out);
    for (size_t i = 0; i < count; i++)
        out[i] = dtype == LG_F32 ? (double)(float)lg_rng_normal(rng) : lg_rng_normal(rng);
    return out;
}

static inline void draw_history(double **history, size_t epochs, lg_rng *rng) {
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) history[i] = drawn(epochs, rng, LG_F64);
}

enum { EPOCHS = 6, TRAINED = 3 };

/* ---- Hamiltonians ---- */

typedef struct hamiltonian_example {
    const lg_hamiltonian_family *family;
    uint32_t links;
    lg_potential_kind potential;
    lg_dtype dtype;
} hamiltonian_example;

/* Followed by one example of each family. */
static const hamiltonian_example hamiltonian_examples[] = {
    {&lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, LG_F64},
    {&lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, LG_F32},
    {&lg_hamiltonian_separable, 2, LG_POTENTIAL_MLP, LG_F32},
    {&lg_hamiltonian_separable, 3, LG_POTENTIAL_LINEAR, LG_F64},
    {&lg_hamiltonian_separable, 2, LG_POTENTIAL_DICTIONARY, LG_F64},
};

static inline hamiltonian_example hamiltonian_example_of(size_t which) {
    const size_t n = LG_COUNT(hamiltonian_examples);
    if (which < n) return hamiltonian_examples[which];
    return (hamiltonian_example){lg_hamiltonian_family_at(which - n), 2, LG_POTENTIAL_MLP, LG_F64};
}

static inline lg_hamiltonian_run make_hamiltonian_run(size_t which) {
    static const uint32_t hidden[] = {4, 3};
    const hamiltonian_example example = hamiltonian_example_of(which), *e = &example;
    lg_hamiltonian_run run = {.scheme = lg_scheme_find(e->family->scheme),
                              .substeps = 2,
                              .penalty = 0.125,
                              .penalty_form = LG_PENALTY_SUM_ABSOLUTE,
                              .penalty_integral = "anharmonic",
                              .distance = LG_DISTANCE_GEODESIC,
                              .training = {.dtype = e->dtype,
                                           .epochs = 100,
                                           .batch = 80,
                                           .lr = 0.01,
                                           .schedule = LG_SCHEDULE_COSINE,
                                           .lr_gamma = 0.1,
                                           .lr_step = 50,
                                           .weight_decay = 1e-9,
                                           .adam_eps = 1e-11,
                                           .clip = 0.25,
                                           .validation = 0.1,
                                           .shards = 4,
                                           .seed = UINT64_MAX},
                              .trajectories = 500,
                              .points = 5,
                              .dt = 0.025};
    (void)snprintf(run.system, sizeof run.system, "%s",
                   e->family == &lg_hamiltonian_chain ? "pendulum-chain" : "quartic");
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    const uint32_t links = e->family->most > 0 && e->links > e->family->most ? e->family->most : e->links;
    assert_ok(lg_hamiltonian_init(&run.model, e->family, links, e->potential, hidden, 2, LG_TANH));
    (void)lg_hamiltonian_set_symmetry(&run.model, (lg_symmetry)(which % LG_SYMMETRY_COUNT));
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS && which >= LG_COUNT(hamiltonian_examples); i++)
        if (e->family->scaled[i]) run.model.scales.part[i] = 1.25 + 0.25 * (double)i;
    return run;
}

static inline void draw_hamiltonian(size_t which, lg_hamiltonian_file *file) {
    lg_rng rng = test_rng(3, 4);
    *file = (lg_hamiltonian_file){
        .run = make_hamiltonian_run(which), .epochs_done = EPOCHS, .has_e1 = true, .e1 = 1.7e-7};
    const size_t n = file->parameters = lg_hamiltonian_parameters(&file->run.model);
    file->theta = drawn(n, &rng, file->run.training.dtype);
    draw_history(file->history, EPOCHS, &rng);
    for (int i = 0; i < EPOCHS; i++) file->history[LG_FIT_VALIDATION][i] = NAN;
}

static inline void same_hamiltonian(const lg_hamiltonian_file *a, const lg_hamiltonian_file *b) {
    assert_true(a->has_e1 == b->has_e1 && a->has_e2 == b->has_e2);
    assert_close(a->e1, b->e1, 0, 0);
    assert_memory_equal(&a->run.model.net, &b->run.model.net, sizeof b->run.model.net);
    assert_int_equal(a->run.model.symmetry, b->run.model.symmetry);
    assert_memory_equal(&a->run.model.scales, &b->run.model.scales, sizeof b->run.model.scales);
}

/* ---- surrogates ---- */

typedef struct surrogate_example {
    lg_surrogate_options options;
    lg_dtype dtype;
} surrogate_example;

static const surrogate_example surrogate_examples[] = {
    {SURROGATE(DISCRETE, MLP, 0, 5, 2, TANH, .normalise = true, .gamma = 7e-3), LG_F32},
    {SURROGATE(CONTINUOUS, MULT, 6, 4, 2, SIGMOID, .mirror = true, .gamma = 2e-2), LG_F64},
    {SURROGATE(ANGLE, MULT_AFFINE, 0, 3, 1, SWISH, .boundary = true), LG_F64},
    {SURROGATE(DISCRETE, RESNET, 4, 4, 0, SINE, .angles = true, .loss = LG_SURROGATE_ENERGY), LG_F64},
    {SURROGATE(DISCRETE, MLP, 0, 4, 1, TANH, .mirror = true, .modes = 3), LG_F32},
};

/* The training settings of the surrogates and detectors in tests. */
static inline lg_fit_settings some_training(lg_dtype dtype, double validation) {
    return (lg_fit_settings){.dtype = dtype,
                             .epochs = 300,
                             .batch = 32,
                             .lr = 0.002,
                             .schedule = LG_SCHEDULE_STEP,
                             .lr_step = 100,
                             .lr_gamma = 0.1,
                             .weight_decay = 1e-7,
                             .adam_eps = 1e-8,
                             .clip = 0.5,
                             .validation = validation,
                             .shards = 2,
                             .seed = 77};
}

static inline lg_surrogate_run make_surrogate_run(size_t which) {
    const surrogate_example *e = &surrogate_examples[which];
    lg_surrogate_run run = {.training = some_training(e->dtype, 0.2),
                            .train_fraction = 0.9,
                            .test_fraction = 0.1,
                            .curves = 1000,
                            .continuous = true};
    assert_ok(lg_surrogate_init(&run.model, &e->options, 4, 3.3, 1.5, NULL));
    give_modes(&run.model);
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    return run;
}

/* Example 1 has no test part, example 2 has no errors. */
static inline void draw_surrogate(size_t which, lg_surrogate_file *file) {
    lg_rng rng = test_rng(5, 6);
    *file = (lg_surrogate_file){.run = make_surrogate_run(which),
                                .trained_count = TRAINED,
                                .has_errors = which != 2,
                                .train_mse = which == 2 ? 0 : 2.5e-7,
                                .test_mse = which == 1 || which == 2 ? NAN : 3.5e-7,
                                .epochs_done = EPOCHS};
    file->parameters = lg_surrogate_parameters(&file->run.model);
    file->theta = drawn(file->parameters, &rng, file->run.training.dtype);
    file->trained = drawn(8 * TRAINED, &rng, LG_F64);
    draw_history(file->history, EPOCHS, &rng);
}

static inline void assert_same_or_nan(double a, double b) {
    if (isnan(b))
        assert_true(isnan(a));
    else
        assert_close(a, b, 0, 0);
}

static inline void same_surrogate(const lg_surrogate_file *a, const lg_surrogate_file *b) {
    assert_memory_equal(&a->run.model.net, &b->run.model.net, sizeof b->run.model.net);
    if (b->run.model.modes != NULL)
        assert_memory_equal(a->run.model.modes, b->run.model.modes,
                            lg_surrogate_modes_size(&b->run.model) * sizeof(double));
    assert_int_equal(a->run.model.options.modes, b->run.model.options.modes);
    assert_int_equal(a->trained_count, b->trained_count);
    assert_memory_equal(a->trained, b->trained, 8 * b->trained_count * sizeof(double));
    assert_true(a->has_errors == b->has_errors);
    if (b->has_errors) assert_close(a->train_mse, b->train_mse, 0, 0);
    assert_same_or_nan(a->test_mse, b->test_mse);
}

/* ---- detectors ---- */

typedef struct detector_example {
    lg_cnn net; /* the outputs follow from the loss */
    uint32_t classes;
    lg_detector_loss loss;
    bool centred;
    lg_dtype dtype;
    const char *blocks; /* the text of the blocks in the file */
} detector_example;

#define SMALL_BLOCK                                                                                          \
    { 1, 2, 1, 0, LG_POOL_NONE, 1, 1 }

static const detector_example detector_examples[] = {
    {{.channels = 3,
      .length = 40,
      .blocks = 3,
      .block = {{4, 5, 1, 0, LG_POOL_AVERAGE, 2, 2},
                {5, 3, 2, 1, LG_POOL_MAX, 3, 1},
                {2, 1, 1, 0, LG_POOL_NONE, 1, 1}},
      .plane = 2,
      .activation = LG_TANH},
     2,
     LG_DETECTOR_MSE,
     true,
     LG_F32,
     "4 kernel 5 stride 1 padding 0 average 2/2, 5 kernel 3 stride 2 padding 1 max 3/1, 2 kernel 1 stride 1 "
     "padding 0 none"},
    {{.channels = 2,
      .length = 9,
      .blocks = 1,
      .block = {{3, 4, 3, 3, LG_POOL_NONE, 1, 1}},
      .plane = 0,
      .activation = LG_RELU},
     5,
     LG_DETECTOR_CROSS_ENTROPY,
     false,
     LG_F64,
     "3 kernel 4 stride 3 padding 3 none"},
    {{.channels = 1, .length = 1, .blocks = 0, .plane = 3, .activation = LG_SWISH},
     2,
     LG_DETECTOR_CROSS_ENTROPY,
     false,
     LG_F64,
     ""},
    {{.channels = 1,
      .length = 30,
      .blocks = LG_CNN_MAX_BLOCKS,
      .block = {SMALL_BLOCK,
                SMALL_BLOCK,
                SMALL_BLOCK,
                SMALL_BLOCK,
                SMALL_BLOCK,
                SMALL_BLOCK,
                SMALL_BLOCK,
                {1, 2, 1, 1, LG_POOL_MAX, 2, 3}},
      .plane = 1,
      .activation = LG_SINE},
     2,
     LG_DETECTOR_MSE,
     false,
     LG_F64,
     NULL},
};

static inline lg_detector_run make_detector_run(size_t which) {
    const detector_example *e = &detector_examples[which];
    lg_detector_run run = {
        .model = {.net = e->net, .classes = e->classes, .loss = e->loss, .centred = e->centred},
        .training = some_training(e->dtype, 0),
        .split = LG_SPLIT_GROUP,
        .test_fraction = 0.2,
        .validation_fraction = 0.1,
        .windows = 43200,
        .window = e->net.length,
        .hop = 150};
    run.model.net.outputs = e->loss == LG_DETECTOR_MSE ? 1 : e->classes;
    assert_ok(lg_cnn_init(&run.model.net, NULL));
    assert_ok(lg_detector_check(&run.model, NULL));
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    return run;
}

/* Example 1 has no error; example 2 has no errors, rate or channels. */
static inline void draw_detector(size_t which, lg_detector_file *file) {
    const detector_example *e = &detector_examples[which];
    lg_rng rng = test_rng(5, 6);
    const uint32_t channels = e->net.channels;
    *file = (lg_detector_file){.run = make_detector_run(which),
                               .names = {.rate = which == 2 ? 0 : 10},
                               .accuracy = which == 2 ? NAN : 0.9875,
                               .f1 = which == 2 ? NAN : 0.75,
                               .test_mse = which == 1 || which == 2 ? NAN : 1.5e-3,
                               .epochs_done = EPOCHS};
    file->parameters = lg_cnn_parameters(&file->run.model.net);
    file->theta = drawn(file->parameters, &rng, e->dtype);
    file->scaler = (lg_scaler){.channels = channels, .mean = drawn(channels, &rng, LG_F64)};
    file->scaler.scale = drawn(channels, &rng, LG_F64);
    file->names.class_name = lg_test_gives(e->classes, sizeof *file->names.class_name);
    file->names.class_label = lg_test_gives(e->classes, sizeof *file->names.class_label);
    if (which != 2) file->names.channel_name = lg_test_gives(channels, sizeof *file->names.channel_name);
    for (uint32_t c = 0; c < channels; c++) {
        file->scaler.scale[c] = 0.1 + fabs(file->scaler.scale[c]);
        if (which != 2) (void)snprintf(file->names.channel_name[c], LG_SERIES_NAME, "acc_%u_x", c);
    }
    for (uint32_t c = 0; c < e->classes; c++) {
        (void)snprintf(file->names.class_name[c], LG_SERIES_NAME, "state %u", c);
        (void)snprintf(file->names.class_label[c], LG_SERIES_NAME, "%u", c + 1);
    }
    draw_history(file->history, EPOCHS, &rng);
}

static inline void assert_same_net(const lg_cnn *a, const lg_cnn *b) {
    assert_int_equal(a->channels, b->channels);
    assert_int_equal(a->length, b->length);
    assert_int_equal(a->blocks, b->blocks);
    assert_memory_equal(a->block, b->block, b->blocks * sizeof *b->block);
    assert_memory_equal(a->lengths, b->lengths, (b->blocks + 1) * sizeof *b->lengths);
    assert_int_equal(a->plane, b->plane);
    assert_int_equal(a->outputs, b->outputs);
    assert_int_equal(a->activation, b->activation);
}

static inline void same_detector(const lg_detector_file *a, const lg_detector_file *b) {
    const lg_detector *have = &a->run.model, *want = &b->run.model;
    const size_t channels = want->net.channels;
    assert_same_net(&have->net, &want->net);
    assert_true(have->classes == want->classes && have->loss == want->loss && have->centred == want->centred);
    assert_int_equal(a->scaler.channels, channels);
    assert_memory_equal(a->scaler.mean, b->scaler.mean, channels * sizeof(double));
    assert_memory_equal(a->scaler.scale, b->scaler.scale, channels * sizeof(double));
    assert_memory_equal(a->names.class_name, b->names.class_name, want->classes * LG_SERIES_NAME);
    assert_non_null(a->names.class_label);
    assert_memory_equal(a->names.class_label, b->names.class_label, want->classes * LG_SERIES_NAME);
    assert_true((a->names.channel_name != NULL) == (b->names.channel_name != NULL));
    if (b->names.channel_name != NULL)
        assert_memory_equal(a->names.channel_name, b->names.channel_name, channels * LG_SERIES_NAME);
    assert_close(a->names.rate, b->names.rate, 0, 0);
    assert_same_or_nan(a->accuracy, b->accuracy);
    assert_same_or_nan(a->f1, b->f1);
    assert_same_or_nan(a->test_mse, b->test_mse);
}

/* ---- tables ---- */

typedef struct table_example {
    lg_table_options options;
    uint32_t inputs, outputs;
    lg_dtype dtype;
} table_example;

static const table_example table_examples[] = {
    {{.network = LG_NET_MLP, .activation = LG_TANH, .hidden_count = 2, .hidden = {4, 4}, .linear = true},
     3,
     2,
     LG_F32},
    {{.task = LG_TABLE_CLASSIFICATION,
      .network = LG_NET_RESNET,
      .activation = LG_SWISH,
      .hidden_count = 2,
      .hidden = {5, 5}},
     2,
     3,
     LG_F64},
    {{.network = LG_NET_MULT_AFFINE, .activation = LG_SINE, .hidden_count = 1, .hidden = {3}}, 4, 1, LG_F64},
};

static inline lg_table_run make_table_run(size_t which) {
    const table_example *e = &table_examples[which];
    lg_slice_info info;
    lg_table_run run = {.training = some_training(e->dtype, 0.2), .rows = 500};
    assert_ok(lg_table_init(&run.model, &e->options, e->inputs, e->outputs, NULL));
    while (which != 1 && lg_table_slice(&run.model, run.decay.count, &info)) {
        run.decay.value[run.decay.count] = 1e-5 / (1.0 + run.decay.count);
        run.decay.count++;
    }
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    return run;
}

static inline lg_scaler make_table_scaler(uint32_t columns, lg_rng *rng) {
    lg_scaler made = {
        .channels = columns, .mean = drawn(columns, rng, LG_F64), .scale = drawn(columns, rng, LG_F64)};
    for (uint32_t c = 0; c < columns; c++) made.scale[c] = 0.1 + fabs(made.scale[c]);
    return made;
}

/* Example 2 has neither a range nor errors. */
static inline void draw_table(size_t which, lg_table_file *file) {
    const table_example *e = &table_examples[which];
    const bool regression = e->options.task == LG_TABLE_REGRESSION;
    lg_rng rng = test_rng(7, 8);
    *file = (lg_table_file){.run = make_table_run(which),
                            .rmse = which == 0 ? 0.25 : NAN,
                            .accuracy = which == 1 ? 0.75 : NAN,
                            .f1 = which == 1 ? 0.5 : NAN,
                            .epochs_done = EPOCHS};
    file->parameters = lg_table_parameters(&file->run.model);
    file->theta = drawn(file->parameters, &rng, e->dtype);
    file->inputs = make_table_scaler(e->inputs, &rng);
    if (regression) file->outputs = make_table_scaler(e->outputs, &rng);
    if (!regression) (void)snprintf(file->class_column, sizeof file->class_column, "kind of soil");
    if (which != 2) {
        file->low = drawn(e->inputs, &rng, LG_F64);
        file->high = drawn(e->inputs, &rng, LG_F64);
    }
    file->input_name = lg_test_gives(e->inputs, sizeof *file->input_name);
    file->output_name = lg_test_gives(e->outputs, sizeof *file->output_name);
    for (uint32_t c = 0; c < e->inputs; c++)
        (void)snprintf(file->input_name[c], LG_TABLE_NAME, "column %u", c);
    for (uint32_t c = 0; c < e->outputs; c++)
        (void)snprintf(file->output_name[c], LG_TABLE_NAME, "\xc3\xa4 %u", c);
    draw_history(file->history, EPOCHS, &rng);
}

static inline void same_scalers(const lg_scaler *a, const lg_scaler *b) {
    assert_int_equal(a->channels, b->channels);
    if (b->channels == 0) return;
    assert_memory_equal(a->mean, b->mean, b->channels * sizeof(double));
    assert_memory_equal(a->scale, b->scale, b->channels * sizeof(double));
}

static inline void same_table(const lg_table_file *a, const lg_table_file *b) {
    const lg_net *net = &b->run.model.net;
    assert_memory_equal(&a->run.model.net, net, sizeof *net);
    assert_true(a->run.model.options.linear == b->run.model.options.linear &&
                a->run.model.options.task == b->run.model.options.task);
    assert_memory_equal(&a->run.decay, &b->run.decay, sizeof a->run.decay);
    same_scalers(&a->inputs, &b->inputs);
    same_scalers(&a->outputs, &b->outputs);
    assert_true((a->low != NULL) == (b->low != NULL) && (a->high != NULL) == (b->high != NULL));
    if (b->low != NULL) assert_memory_equal(a->low, b->low, net->inputs * sizeof(double));
    if (b->high != NULL) assert_memory_equal(a->high, b->high, net->inputs * sizeof(double));
    assert_memory_equal(a->input_name, b->input_name, net->inputs * sizeof *a->input_name);
    assert_memory_equal(a->output_name, b->output_name, net->outputs * sizeof *a->output_name);
    assert_string_equal(a->class_column, b->class_column);
    assert_same_or_nan(a->rmse, b->rmse);
    assert_same_or_nan(a->accuracy, b->accuracy);
    assert_same_or_nan(a->f1, b->f1);
}

/* ---- machines ---- */

/* The first one has all kinds of terms; the others test where weights are stored and what a loaded machine
 * computes. */
static const char *const machine_model_examples[] = {
    machine_of_all_kinds, machine_of_a_body,  machine_of_a_cart, machine_without_inputs,
    machine_of_a_top,     machine_of_a_chain, machine_of_an_arm, machine_of_a_motor};

static inline lg_machine_model_run make_machine_model_run(size_t which) {
    lg_machine_model_run run = make_machine_model(machine_model_examples[which], 7)->run;
    run.training = some_training(which == 2 ? LG_F32 : LG_F64, 0.2);
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    return run;
}

static inline void draw_machine_model(size_t which, lg_machine_model_file *file) {
    const lg_machine_model_file *made = make_machine_model(machine_model_examples[which], 7);
    lg_rng rng = test_rng(9, 10);
    const size_t n = made->parameters;
    *file =
        (lg_machine_model_file){.run = make_machine_model_run(which), .parameters = n, .epochs_done = EPOCHS};
    file->theta = drawn(n, &rng, LG_F64);
    for (size_t i = 0; i < n; i++)
        file->theta[i] = which == 2 ? (double)(float)made->theta[i] : made->theta[i];
    if (which == 0) file->spread = drawn(n * n, &rng, LG_F64);
    draw_history(file->history, EPOCHS, &rng);
}

static inline void same_machine_model(const lg_machine_model_file *a, const lg_machine_model_file *b) {
    const lg_machine *have = &a->run.machine, *want = &b->run.machine;
    assert_memory_equal(&have->scales, &b->run.scales, sizeof b->run.scales);
    assert_memory_equal(&a->run.scales, &b->run.scales, sizeof b->run.scales);
    assert_memory_equal(&a->run.range, &b->run.range, sizeof b->run.range);
    assert_string_equal(a->run.text, b->run.text);
    assert_int_equal(have->term_count, want->term_count);
    assert_true(a->run.scheme == b->run.scheme && (a->spread != NULL) == (b->spread != NULL));
    if (b->spread != NULL)
        assert_memory_equal(a->spread, b->spread, b->parameters * b->parameters * sizeof(double));
}

/* ---- table of all kinds ---- */

typedef enum model_kind {
    KIND_HAMILTONIAN,
    KIND_SURROGATE,
    KIND_DETECTOR,
    KIND_TABLE,
    KIND_MACHINE_MODEL,
    KIND_COUNT
} model_kind;

typedef union any_run {
    lg_hamiltonian_run hamiltonian;
    lg_surrogate_run surrogate;
    lg_detector_run detector;
    lg_table_run table;
    lg_machine_model_run machine_model;
} any_run;

typedef struct any_file {
    model_kind kind;
    union {
        char bytes[1];
        lg_hamiltonian_file hamiltonian;
        lg_surrogate_file surrogate;
        lg_detector_file detector;
        lg_table_file table;
        lg_machine_model_file machine_model;
    };
} any_file;

typedef struct kind_row {
    const lg_recipe *recipe;
    /* number of examples; index of the example that is damaged; index of one in single precision */
    size_t examples, bad, single;
    size_t loads, saves; /* least number of allocations while loading and saving */
    any_run (*make_run)(size_t which);
    void (*make)(size_t which, any_file *out);
    void (*same)(const any_file *a, const any_file *b);
    read_fn read, read_checkpoint;
    fresh_fn fresh; /* a new copy of the example that is damaged */
} kind_row;

static const kind_row kinds[KIND_COUNT];

static inline void destroy(any_file *file) {
    lg_recipe_release(kinds[file->kind].recipe, file->bytes);
}

static inline lg_status save(const lg_context *context, const char *path, const any_file *file,
                             const lg_fit *fit, lg_error *error) {
    return lg_recipe_save(context, path, kinds[file->kind].recipe, file->bytes, fit, error);
}

static inline lg_status load(const lg_context *context, const char *path, const lg_read_options *options,
                             model_kind kind, any_file *out, lg_error *error) {
    out->kind = kind;
    return lg_recipe_load(context, path, options, kinds[kind].recipe, out->bytes, error);
}

/* What files of all kinds have in common. */
typedef struct common {
    void *run;
    lg_fit_settings *training;
    size_t parameters, epochs_done;
    double *theta, **history;
    lg_provenance *provenance;
} common;

static inline common common_of(any_file *file) {
    const lg_recipe *r = kinds[file->kind].recipe;
    char *at = file->bytes;
    lg_model_head *head = (lg_model_head *)(void *)at;
    return (common){.run = at + r->file_run,
                    .training = (lg_fit_settings *)(void *)(at + r->file_run + r->training),
                    .parameters = head->parameters,
                    .epochs_done = head->epochs_done,
                    .theta = head->theta,
                    .history = head->history,
                    .provenance = &head->provenance};
}

/* Number of examples, including one of each family. */
static inline size_t examples_of(const kind_row *k) {
    return k->examples + (k == &kinds[KIND_HAMILTONIAN] ? lg_hamiltonian_family_count() : 0);
}

static inline const char *good_model(model_kind kind, size_t which) {
    const kind_row *k = &kinds[kind];
    const char *path = scratch_path("model.h5"),
               *original = scratch_path(test_text("%s%zu.original", k->recipe->name, which));
    if (access(original, F_OK) != 0) {
        any_file file;
        k->make(which, &file);
        assert_told(save(NULL, original, &file, NULL, &told));
        destroy(&file);
    }
    copy_file(original, path);
    return path;
}

#define KIND_FUNCTIONS(k, K)                                                                                 \
    static any_run any_run_##k(size_t which) {                                                               \
        return (any_run){.k = make_##k##_run(which)};                                                        \
    }                                                                                                        \
    static void make_any_##k(size_t which, any_file *out) {                                                  \
        *out = (any_file){.kind = KIND_##K};                                                                 \
        draw_##k(which, &out->k);                                                                            \
        (void)snprintf(out->k.provenance.command, sizeof out->k.provenance.command, "train");                \
    }                                                                                                        \
    static void same_any_##k(const any_file *a, const any_file *b) {                                         \
        same_##k(&a->k, &b->k);                                                                              \
    }                                                                                                        \
    static lg_status read_##k(const lg_context *context, const char *path, const lg_read_options *options,   \
                              lg_error *error) {                                                             \
        any_file file;                                                                                       \
        const lg_status status = load(context, path, options, KIND_##K, &file, error);                       \
        if (status == LG_OK) destroy(&file);                                                                 \
        return status;                                                                                       \
    }                                                                                                        \
    static lg_status read_checkpoint_##k(const lg_context *context, const char *path,                        \
                                         const lg_read_options *options, lg_error *error) {                  \
        any_run run;                                                                                         \
        lg_file_reader *reader;                                                                              \
        const lg_status status =                                                                             \
            lg_checkpoint_open(context, path, options, &lg_recipe_##k, &run, &reader, error);                \
        if (status == LG_OK) lg_file_reader_destroy(reader);                                                 \
        return status;                                                                                       \
    }                                                                                                        \
    static const char *fresh_##k(void) {                                                                     \
        return good_model(KIND_##K, kinds[KIND_##K].bad);                                                    \
    }

KIND_FUNCTIONS(hamiltonian, HAMILTONIAN)
KIND_FUNCTIONS(surrogate, SURROGATE)
KIND_FUNCTIONS(detector, DETECTOR)
KIND_FUNCTIONS(table, TABLE)
KIND_FUNCTIONS(machine_model, MACHINE_MODEL)

#define KIND_ROW(k, bad, single, loads, saves)                                                               \
    {                                                                                                        \
        &lg_recipe_##k, LG_COUNT(k##_examples), bad, single, loads, saves, any_run_##k, make_any_##k,        \
            same_any_##k, read_##k, read_checkpoint_##k, fresh_##k                                           \
    }

static const kind_row kinds[KIND_COUNT] = {
    [KIND_HAMILTONIAN] = KIND_ROW(hamiltonian, 0, 2, 7, 8),
    [KIND_SURROGATE] = KIND_ROW(surrogate, 1, 0, 8, 6),
    [KIND_DETECTOR] = KIND_ROW(detector, 1, 0, 12, 8),
    [KIND_TABLE] = KIND_ROW(table, 2, 0, 12, 8),
    [KIND_MACHINE_MODEL] = KIND_ROW(machine_model, 0, 2, 8, 8),
};

#define EACH_EXAMPLE(kind, which)                                                                            \
    (size_t kind = 0, which = 0; kind < KIND_COUNT;                                                          \
     which + 1 < examples_of(&kinds[kind]) ? which++ : (kind++, which = 0))

#endif
