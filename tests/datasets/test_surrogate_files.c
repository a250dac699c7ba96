/* Surrogates and their checkpoints: round trip, the matrix of bad input. What all kinds of models share is
 * tested with the learned Hamiltonians. */
#define MODEL_KIND   surrogate
#define MODEL_BAD    1
#define MODEL_SINGLE 0
#include "model_file_checks.h"

enum { TRAINED = 3, EPOCHS = 4 };

typedef struct example {
    lg_surrogate_options options;
    lg_dtype dtype;
} example;

static const example examples[] = {
    {{.kind = LG_SURROGATE_DISCRETE,
      .architecture = LG_NET_MLP,
      .hidden = 5,
      .layers = 2,
      .activation = LG_TANH,
      .normalise = true,
      .gamma = 7e-3},
     LG_F32},
    {{.kind = LG_SURROGATE_CONTINUOUS,
      .architecture = LG_NET_MULT,
      .embedding = 6,
      .hidden = 4,
      .layers = 2,
      .activation = LG_SIGMOID,
      .mirror = true,
      .gamma = 2e-2},
     LG_F64},
    {{.kind = LG_SURROGATE_ANGLE,
      .architecture = LG_NET_MULT_AFFINE,
      .hidden = 3,
      .layers = 1,
      .activation = LG_SWISH,
      .boundary = true},
     LG_F64},
    {{.kind = LG_SURROGATE_DISCRETE,
      .architecture = LG_NET_RESNET,
      .embedding = 4,
      .hidden = 4,
      .layers = 0,
      .activation = LG_SINE},
     LG_F64},
};

static lg_surrogate_run make_run(size_t which) {
    const example *e = &examples[which];
    lg_surrogate_run run = {.training = {.dtype = e->dtype,
                                         .epochs = 300,
                                         .batch = 32,
                                         .lr = 0.002,
                                         .schedule = LG_SCHEDULE_STEP,
                                         .lr_step = 100,
                                         .lr_gamma = 0.1,
                                         .weight_decay = 1e-7,
                                         .adam_eps = 1e-8,
                                         .clip = 0.5,
                                         .validation = 0.2,
                                         .shards = 2,
                                         .seed = 77},
                            .train_fraction = 0.9,
                            .test_fraction = 0.1,
                            .curves = 1000,
                            .continuous = true};
    assert_ok(lg_surrogate_init(&run.model, &e->options, 4, 3.3, 1.5, NULL));
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    return run;
}

static void make_model(size_t which, lg_surrogate_file *file) {
    const example *e = &examples[which];
    lg_rng rng;
    lg_rng_seed(&rng, 5, 6);
    *file = (lg_surrogate_file){.run = make_run(which),
                                .trained_count = TRAINED,
                                .has_errors = true,
                                .train_mse = 2.5e-7,
                                .test_mse = 3.5e-7,
                                .epochs_done = EPOCHS};
    file->parameters = lg_surrogate_parameters(&file->run.model);
    file->theta = numbers(file->parameters, &rng, e->dtype);
    file->trained = numbers(8 * TRAINED, &rng, LG_F64);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) file->history[i] = numbers(EPOCHS, &rng, LG_F64);
    (void)snprintf(file->provenance.command, sizeof file->provenance.command, "train");
}

TEST("a model comes back as it was saved") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_surrogate_file file, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        make_model(e, &file);
        if (e == 1) file.test_mse = NAN;
        if (e == 2) file.has_errors = false;
        assert_ok(lg_model_save_surrogate(NULL, path, &file, NULL, NULL));
        assert_ok(lg_model_load_surrogate(NULL, path, NULL, &again, NULL));
        assert_ok(lg_run_compare(&lg_run_surrogate, &again.run, &file.run, path, NULL));
        assert_int_equal(again.parameters, file.parameters);
        assert_memory_equal(again.theta, file.theta, file.parameters * sizeof(double));
        assert_memory_equal(&again.run.model.net, &file.run.model.net, sizeof(lg_net));
        assert_int_equal(again.trained_count, TRAINED);
        assert_memory_equal(again.trained, file.trained, 8 * TRAINED * sizeof(double));
        assert_true(again.has_errors == (e != 2));
        if (e != 2) assert_close(again.train_mse, 2.5e-7, 0, 0);
        if (e == 0 || e == 3) assert_close(again.test_mse, 3.5e-7, 0, 0);
        if (e == 1 || e == 2) assert_true(isnan(again.test_mse));
        assert_int_equal(again.epochs_done, EPOCHS);
        for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
            assert_memory_equal(again.history[i], file.history[i], EPOCHS * sizeof(double));
        assert_string_equal(again.provenance.command, "train");
        assert_ok(lg_model_save_surrogate(NULL, second, &again, NULL, NULL));
        assert_same_bytes(path, second);
        lg_surrogate_file_destroy(&file);
        lg_surrogate_file_destroy(&again);
        lg_surrogate_file_destroy(&again);
    }
}

TEST("every slice of the vector lies under its name, in the type of the training") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_surrogate_file file;
        lg_slice_info slice;
        lg_h5 *h5;
        size_t total = 0;
        make_model(e, &file);
        assert_ok(lg_h5_open(NULL, good_model(e), NULL, &h5, NULL));
        for (uint32_t i = 0; lg_net_slice(&file.run.model.net, i, &slice); i++) {
            assert_slice_stored(h5, &slice, file.theta, examples[e].dtype);
            total += slice.count;
        }
        assert_int_equal(total, file.parameters);
        assert_true(lg_h5_has(h5, "model/embedding/weight") == (examples[e].options.embedding > 0));
        lg_h5_close(h5);
        lg_surrogate_file_destroy(&file);
    }
}

TEST("a model written by hand may leave out what is not needed") {
    static const char *const links[] = {"train", "run", "trained"};
    static const char *const attributes[] = {"train_mse", "test_mse", "seed", "command", "cpu", "format"};
    lg_surrogate_file file;
    const char *path = good_model(2);
    for (size_t i = 0; i < LG_COUNT(links); i++) delete_link(path, links[i]);
    for (size_t i = 0; i < LG_COUNT(attributes); i++) delete_attribute(path, "/", attributes[i]);
    assert_ok(lg_model_load_surrogate(NULL, path, NULL, &file, NULL));
    assert_null(file.trained);
    assert_int_equal(file.trained_count, 0);
    assert_false(file.has_errors);
    assert_int_equal(file.epochs_done, 0);
    assert_int_equal(file.run.model.options.kind, LG_SURROGATE_ANGLE);
    assert_true(file.run.model.options.boundary);
    lg_surrogate_file_destroy(&file);
}

TEST("a damaged model is refused") {
    refuse_damaged_files(read_model, good_model(1), "");
    survive_changed_bytes(read_model, good_model(1), 100);
}

TEST("an array of the wrong shape or value is refused by name") {
    static const bad_array cases[] = {
        {"model/embedding/weight", 2, {6, 9}, 1, LG_FORMAT, "shape"},
        {"model/embedding/bias", 1, {6}, NAN, LG_NOT_FINITE, "(0)"},
        {"trained", 2, {3, 7}, 1, LG_FORMAT, "(3, 7)"},
        {"trained", 1, {24}, 1, LG_FORMAT, "rank"},
        {"trained", 2, {0, 8}, 1, LG_FORMAT, "trained"},
        {"trained", 2, {3, 8}, NAN, LG_NOT_FINITE, "(0, 0)"},
        {"train/history/rate", 1, {3}, 1, LG_FORMAT, "epoch"},
    };
    refuse_arrays(read_model, fresh_model, true, cases, LG_COUNT(cases));
    const char *path = good_model(1);
    delete_link(path, "model/embedding/bias");
    assert_refused(read_model, path, LG_FORMAT, "model/embedding/bias", "");
}

TEST("an attribute of the wrong type or value is refused by name") {
    static const bad_value texts[] = {
        {"/", "kind", "hamiltonian", "surrogate"},     {"model", "network", NULL, "missing"},
        {"model", "network", "fuzzy", "known name"},   {"model", "architecture", "unet", "known name"},
        {"model", "activation", "gelu", "known name"}, {"model", "hidden", NULL, "missing"},
        {"model", "mirror", "yes", "integer"},         {"run", "values", "exact", "known name"},
        {"run", "schedule", "sawtooth", "known name"}, {"run", "lr", "fast", "number"}};
    refuse_texts(read_model, fresh_model, texts, LG_COUNT(texts));
    static const bad_integer integers[] = {{"model", "mirror", 2, "0 nor 1"},
                                           {"model", "boundary", 1, "angle"},
                                           {"model", "layers", 99, "layers is out of range"},
                                           {"model", "hidden", 0, "hidden is out of range"},
                                           {"model", "hidden", 5, "shape"},
                                           {"model", "hidden", 1 << 20, "shape"},
                                           {"model", "intervals", 1, "intervals"},
                                           {"model", "intervals", 4000000000, "intervals"},
                                           {"model", "layers", -1, "layers"},
                                           {"model", "embedding", 7, "embedding"},
                                           {"model", "length", 0, "length"},
                                           {"model", "centre", -1, "centre"},
                                           {"run", "gamma", -1, "gamma"},
                                           {"run", "train_fraction", 2, "train_fraction"}};
    refuse_integers(read_model, fresh_model, integers, LG_COUNT(integers));
    static const char *const reals[][2] = {
        {"model", "length"}, {"run", "gamma"}, {"run", "lr"}, {"/", "train_mse"}, {"/", "test_mse"}};
    refuse_nans(read_model, fresh_model, "finite", reals, LG_COUNT(reals));
}

TEST("a model that could not be read is not saved") {
    lg_surrogate_file file;
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    make_model(1, &file);
    const lg_surrogate_run run = file.run;
    file.theta[3] = NAN;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, &error), LG_NOT_FINITE);
    assert_non_null(strstr(error.message, "refused.h5: /model/embedding/weight"));
    file.theta[3] = 0;
    file.trained[9] = INFINITY;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_NOT_FINITE);
    file.trained[9] = 0;
    file.train_mse = NAN;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_NOT_FINITE);
    file.train_mse = 0;
    file.parameters++;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.parameters--;
    file.run.model.net.activation = LG_TANH;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.run = run;
    file.run.train_fraction = 1.5;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.run = run;
    file.run.training.schedule = (lg_schedule_kind)LG_SCHEDULE_COUNT;
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.run = run;
    assert_status(lg_model_save_surrogate(NULL, NULL, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_int_not_equal(access(path, F_OK), 0);
    lg_surrogate_file_destroy(&file);
    assert_status(lg_model_save_surrogate(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
}

TEST("a fit resumed from its checkpoint ends in the same bits") {
    resume_checkpoint(NULL);
}

TEST("a damaged checkpoint is refused") {
    static const char *const needed[] = {"batch", "lr", "data_sha256", "gamma", "train_fraction", "curves"};
    refuse_damaged_checkpoints("surrogate", "surrogate-checkpoint", 60, needed, LG_COUNT(needed));
}

TEST("a checkpoint of another run is refused, and the sentence names the difference") {
    const lg_surrogate_run wanted = make_run(1);
    lg_surrogate_run runs[9];
    static const char *const words[] = {"batch 33, not 32",
                                        "gamma 0.5",
                                        "network angle",
                                        "values discrete, not continuous",
                                        "mirror false, not true",
                                        "hidden 5, not 4",
                                        "test_fraction 0.25",
                                        "data_sha256",
                                        "schedule cosine, not step"};
    for (size_t i = 0; i < LG_COUNT(runs); i++) runs[i] = wanted;
    runs[0].training.batch = 33;
    runs[1].model.options.gamma = 0.5;
    runs[2].model.options.kind = LG_SURROGATE_ANGLE;
    runs[3].continuous = false;
    runs[4].model.options.mirror = false;
    runs[5].model.options.hidden = 5;
    runs[6].test_fraction = 0.25;
    runs[7].data_sha256[0] = 'f';
    runs[8].training.schedule = LG_SCHEDULE_COSINE;
    refuse_other_runs(&wanted, runs, words, LG_COUNT(runs));
}

/* ---- memory ---- */

TEST("every allocation may fail, and nothing leaks") {
    fail_model_allocations(8, 6);
}

TEST("a model comes back with the state of its fit") {
    model_with_fit();
}
