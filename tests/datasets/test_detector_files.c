/* Detectors and their checkpoints: round trip, the matrix of bad input; names in files of other kinds, and
 * which kind a file is. What all kinds of models share is tested with the learned Hamiltonians. */
#define MODEL_KIND   detector
#define MODEL_BAD    1
#define MODEL_SINGLE 0
#include "model_file_checks.h"

#include "liegrad/detector.h"

enum { EPOCHS = 4 };

typedef struct example {
    lg_cnn net; /* outputs by the loss */
    uint32_t classes;
    lg_detector_loss loss;
    bool centred;
    lg_dtype dtype;
    const char *blocks; /* as the file says it */
} example;

static const example examples[] = {
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
      .block = {{1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 0, LG_POOL_NONE, 1, 1},
                {1, 2, 1, 1, LG_POOL_MAX, 2, 3}},
      .plane = 1,
      .activation = LG_SINE},
     2,
     LG_DETECTOR_MSE,
     false,
     LG_F64,
     NULL},
};

static lg_detector_run make_run(size_t which) {
    const example *e = &examples[which];
    lg_detector_run run = {
        .model = {.net = e->net, .classes = e->classes, .loss = e->loss, .centred = e->centred},
        .training = {.dtype = e->dtype,
                     .epochs = 300,
                     .batch = 32,
                     .lr = 0.002,
                     .schedule = LG_SCHEDULE_STEP,
                     .lr_step = 100,
                     .lr_gamma = 0.1,
                     .weight_decay = 1e-7,
                     .adam_eps = 1e-8,
                     .clip = 0.5,
                     .shards = 2,
                     .seed = 77},
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

static void make_model(size_t which, lg_detector_file *file) {
    const example *e = &examples[which];
    lg_rng rng;
    lg_rng_seed(&rng, 5, 6);
    const uint32_t channels = e->net.channels;
    *file = (lg_detector_file){.run = make_run(which),
                               .rate = 10,
                               .accuracy = 0.9875,
                               .f1 = 0.75,
                               .test_mse = 1.5e-3,
                               .epochs_done = EPOCHS};
    file->parameters = lg_cnn_parameters(&file->run.model.net);
    file->theta = numbers(file->parameters, &rng, e->dtype);
    file->scaler = (lg_scaler){.channels = channels, .mean = numbers(channels, &rng, LG_F64)};
    file->scaler.scale = numbers(channels, &rng, LG_F64);
    file->class_name = lg_alloc(NULL, e->classes, sizeof *file->class_name);
    file->class_label = lg_alloc(NULL, e->classes, sizeof *file->class_label);
    file->channel_name = lg_alloc(NULL, channels, sizeof *file->channel_name);
    for (uint32_t c = 0; c < channels; c++) {
        file->scaler.scale[c] = 0.1 + fabs(file->scaler.scale[c]);
        (void)snprintf(file->channel_name[c], LG_SERIES_NAME, "acc_%u_x", c);
    }
    for (uint32_t c = 0; c < e->classes; c++) {
        (void)snprintf(file->class_name[c], LG_SERIES_NAME, "state %u", c);
        (void)snprintf(file->class_label[c], LG_SERIES_NAME, "%u", c + 1);
    }
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) file->history[i] = numbers(EPOCHS, &rng, LG_F64);
    (void)snprintf(file->provenance.command, sizeof file->provenance.command, "train");
}

static void assert_same_net(const lg_cnn *a, const lg_cnn *b) {
    assert_int_equal(a->channels, b->channels);
    assert_int_equal(a->length, b->length);
    assert_int_equal(a->blocks, b->blocks);
    assert_memory_equal(a->block, b->block, b->blocks * sizeof *b->block);
    assert_memory_equal(a->lengths, b->lengths, (b->blocks + 1) * sizeof *b->lengths);
    assert_int_equal(a->plane, b->plane);
    assert_int_equal(a->outputs, b->outputs);
    assert_int_equal(a->activation, b->activation);
}

static void assert_same_model(const lg_detector_file *a, const lg_detector_file *b) {
    const lg_detector *have = &a->run.model, *want = &b->run.model;
    assert_ok(lg_run_compare(&lg_run_detector, &a->run, &b->run, "a.h5", NULL));
    assert_same_net(&have->net, &want->net);
    assert_int_equal(have->classes, want->classes);
    assert_int_equal(have->loss, want->loss);
    assert_int_equal(have->centred, want->centred);
    assert_int_equal(a->parameters, b->parameters);
    assert_memory_equal(a->theta, b->theta, b->parameters * sizeof(double));
    assert_int_equal(a->scaler.channels, want->net.channels);
    assert_memory_equal(a->scaler.mean, b->scaler.mean, want->net.channels * sizeof(double));
    assert_memory_equal(a->scaler.scale, b->scaler.scale, want->net.channels * sizeof(double));
    assert_memory_equal(a->class_name, b->class_name, want->classes * LG_SERIES_NAME);
    assert_non_null(a->class_label);
    assert_memory_equal(a->class_label, b->class_label, want->classes * LG_SERIES_NAME);
}

TEST("a model comes back as it was saved") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_detector_file file, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        make_model(e, &file);
        if (e == 1) file.test_mse = NAN;
        if (e == 2) {
            file.accuracy = file.f1 = file.test_mse = NAN;
            file.rate = 0;
            lg_free(NULL, file.channel_name);
            file.channel_name = NULL;
        }
        assert_ok(lg_model_save_detector(NULL, path, &file, NULL, NULL));
        assert_ok(lg_model_load_detector(NULL, path, NULL, &again, NULL));
        assert_same_model(&again, &file);
        assert_true((again.channel_name != NULL) == (e != 2));
        if (e != 2) {
            assert_memory_equal(again.channel_name, file.channel_name,
                                examples[e].net.channels * LG_SERIES_NAME);
            assert_close(again.accuracy, 0.9875, 0, 0);
            assert_close(again.f1, 0.75, 0, 0);
        } else {
            assert_true(isnan(again.accuracy) && isnan(again.f1));
        }
        assert_close(again.rate, e == 2 ? 0 : 10, 0, 0);
        if (e == 1 || e == 2)
            assert_true(isnan(again.test_mse));
        else
            assert_close(again.test_mse, 1.5e-3, 0, 0);
        assert_int_equal(again.epochs_done, EPOCHS);
        for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
            assert_memory_equal(again.history[i], file.history[i], EPOCHS * sizeof(double));
        assert_string_equal(again.provenance.command, "train");
        assert_ok(lg_model_save_detector(NULL, second, &again, NULL, NULL));
        assert_same_bytes(path, second);
        lg_detector_file_destroy(&file);
        lg_detector_file_destroy(&again);
        lg_detector_file_destroy(&again);
    }
}

/* Every slice of the network's vector lies below /model under its name, in the type of the training; blocks
 * are a text that a person reads. */
TEST("every layer is an array below its name") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_detector_file file;
        lg_slice_info slice;
        lg_h5 *h5;
        char blocks[512];
        size_t total = 0;
        make_model(e, &file);
        assert_ok(lg_h5_open(NULL, good_model(e), NULL, &h5, NULL));
        for (uint32_t i = 0; lg_cnn_slice(&file.run.model.net, i, &slice); i++) {
            assert_slice_stored(h5, &slice, file.theta, examples[e].dtype);
            total += slice.count;
        }
        assert_int_equal(total, file.parameters);
        assert_true(lg_h5_has(h5, "model/conv1/weight") == (examples[e].net.blocks > 0));
        assert_true(lg_h5_has(h5, "model/plane/weight") == (examples[e].net.plane > 0));
        assert_ok(lg_h5_text(h5, "model", "blocks", blocks, sizeof blocks, NULL));
        if (examples[e].blocks != NULL) assert_string_equal(blocks, examples[e].blocks);
        lg_h5_close(h5);
        lg_detector_file_destroy(&file);
    }
}

TEST("a model written by hand may leave out what is not needed") {
    static const char *const links[] = {"train", "run"};
    static const char *const attributes[] = {"classes",  "class_labels", "channels",      "rate",
                                             "accuracy", "f1",           "test_mse",      "seed",
                                             "command",  "format",       "format_version"};
    lg_detector_file file, full;
    const char *path = good_model(1);
    assert_ok(lg_model_load_detector(NULL, path, NULL, &full, NULL));
    for (size_t i = 0; i < LG_COUNT(links); i++) delete_link(path, links[i]);
    for (size_t i = 0; i < LG_COUNT(attributes); i++) delete_attribute(path, "/", attributes[i]);
    replace_text(path, "model", "blocks", "  3 kernel 4 stride 3  padding 3 "); /* none is what is left out */
    assert_ok(lg_model_load_detector(NULL, path, NULL, &file, NULL));
    assert_same_net(&file.run.model.net, &full.run.model.net);
    assert_memory_equal(file.theta, full.theta, full.parameters * sizeof(double));
    assert_string_equal(file.class_name[4], "4");
    assert_true(file.class_label == NULL && file.channel_name == NULL && file.history[LG_FIT_LOSS] == NULL);
    assert_true(isnan(file.accuracy) && isnan(file.f1) && isnan(file.test_mse));
    assert_close(file.rate, 0, 0, 0);
    assert_int_equal(file.epochs_done, 0);
    lg_detector_file_destroy(&file);
    lg_detector_file_destroy(&full);
}

TEST("the text of the blocks is read as it is written") {
    static const struct {
        const char *text;
        uint32_t padding, stride;
    } fine[] = {{"3 kernel 4 stride 3 padding 3 none", 3, 3},
                {"3 kernel 4 padding 3", 3, 1},
                {"3 kernel 4", 0, 1},
                {"  3  kernel  4  stride 2", 0, 2}};
    for (size_t i = 0; i < LG_COUNT(fine); i++) {
        lg_error error = {LG_OK, ""};
        const char *path = good_model(1);
        replace_text(path, "model", "blocks", fine[i].text);
        const lg_status status = read_model(NULL, path, NULL, &error);
        /* Another stride or padding leaves another number of samples to the output layer. */
        if (i == 0) assert_ok(status);
        if (i > 0 && strstr(error.message, "output/weight") == NULL) fail_msg("%s", error.message);
    }
    static const char *const bad[] = {"3",
                                      "3 kernel",
                                      "3 kernel x",
                                      "3 kernel 4 stride",
                                      "3 kernel 4 stride -1",
                                      "3 kernel 4 padding 3 stride 3",
                                      "3 kernel 4 stride 3 padding 3 median 2/2",
                                      "3 kernel 4 stride 3 padding 3 max",
                                      "3 kernel 4 stride 3 padding 3 max 2",
                                      "3 kernel 4 stride 3 padding 3 max 2/",
                                      "3 kernel 4 stride 3 padding 3 max 2/2/2",
                                      "3 kernel 4 stride 3 padding 3 none 2/2",
                                      "3 kernel 4 stride 3 padding 3 none,",
                                      "3 kernel 4 stride 3 padding 3 none, ",
                                      ", 3 kernel 4 stride 3 padding 3 none",
                                      "3 kernel 4 stride 3 padding 3 none; 1 kernel 1",
                                      "3.0 kernel 4 stride 3 padding 3 none",
                                      "4294967299 kernel 4 stride 3 padding 3 none",
                                      "99999999999999999999 kernel 4",
                                      "3 kernel 4 stride 3 padding 3 none extra",
                                      "3 kernel 4 stride 3 padding 3 max 1/1/3 kernel 1",
                                      "12x5",
                                      ("1 kernel 1,1 kernel 1,1 kernel 1,1 kernel 1,1 kernel 1,1 kernel 1,"
                                       "1 kernel 1,1 kernel 1,1 kernel 1")};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        const char *path = good_model(1);
        replace_text(path, "model", "blocks", bad[i]);
        assert_refused(read_model, path, LG_FORMAT, "attribute blocks: expected up to 8 as", "");
    }
    static const char *const hostile[] = {"0 kernel 4",
                                          "3 kernel 0",
                                          "3 kernel 4 stride 0",
                                          "3 kernel 4 padding 4",
                                          "3 kernel 10",
                                          "3 kernel 4 max 0/1",
                                          "3 kernel 4 max 1/0",
                                          "3 kernel 4 max 7/1",
                                          "3 kernel 4294967295 padding 4294967294",
                                          "4294967295 kernel 4",
                                          "1048576 kernel 9, 1048576 kernel 1",
                                          ""};
    for (size_t i = 0; i < LG_COUNT(hostile); i++) {
        const char *path = good_model(1);
        replace_text(path, "model", "blocks", hostile[i]);
        assert_refused(read_model, path, LG_FORMAT,
                       i + 1 < LG_COUNT(hostile) ? "no network: " : "wrong shape", "");
    }
}

/* ---- bad input ---- */

TEST("a damaged model is refused") {
    refuse_damaged_files(read_model, good_model(0), "");
    survive_changed_bytes(read_model, good_model(0), 100);
}

TEST("an array of the wrong shape or value is refused by name") {
    static const bad_array cases[] = {
        {"model/conv1/weight", 3, {4, 2, 4}, 0, LG_FORMAT, "shape"},
        {"model/conv1/weight", 2, {4, 6}, 0, LG_FORMAT, "shape"},
        {"model/conv1/weight", 3, {4, 2, 3}, NAN, LG_NOT_FINITE, "(0, 0, 0)"},
        {"model/conv1/bias", 1, {4}, 0, LG_FORMAT, "shape"},
        {"model/output/weight", 2, {12, 5}, INFINITY, LG_NOT_FINITE, "(0, 0)"},
        {"model/output/weight", 2, {12, 4}, 0, LG_FORMAT, "shape"},
        {"model/output/bias", 1, {0}, 0, LG_FORMAT, "shape"},
        {"scaler/mean", 1, {3}, 0, LG_FORMAT, "3 numbers, the model has 2"},
        {"scaler/mean", 2, {2, 1}, 0, LG_FORMAT, "rank"},
        {"scaler/mean", 1, {2}, NAN, LG_NOT_FINITE, "(0)"},
        {"scaler/scale", 1, {1}, 1, LG_FORMAT, "1 numbers"},
        {"scaler/scale", 1, {2}, 0, LG_FORMAT, "is 0 at index (0)"},
        {"scaler/scale", 1, {2}, -1, LG_FORMAT, "is -1"},
        {"scaler/scale", 1, {2}, INFINITY, LG_NOT_FINITE, "(0)"},
        {"train/history/loss", 2, {2, 2}, 0, LG_FORMAT, "epoch"},
        {"train/history/rate", 1, {5}, 0, LG_FORMAT, "epoch"},
    };
    refuse_arrays(read_model, fresh_model, true, cases, LG_COUNT(cases));
    static const char *const needed[] = {"model/conv1/weight", "model/conv1/bias", "model/output/weight",
                                         "scaler/mean", "scaler/scale"};
    refuse_without_links(read_model, fresh_model, "", needed, LG_COUNT(needed));
}

TEST("an attribute of the wrong type or value is refused by name") {
    static const bad_value texts[] = {{"/", "kind", NULL, "missing"},
                                      {"/", "kind", "surrogate", "detector"},
                                      {"/", "classes", "a|b", "2 names, expected 5"},
                                      {"/", "class_labels", "1|2|3", "3 names, expected 5"},
                                      {"/", "classes", "a|b|c|d|a", "twice"},
                                      {"/", "classes", "a|b|c|d|", "empty"},
                                      {"/", "channels", "one", "1 names, expected 2"},
                                      {"/", "rate", "fast", "number"},
                                      {"model", "blocks", NULL, "missing"},
                                      {"model", "channels", NULL, "missing"},
                                      {"model", "length", NULL, "missing"},
                                      {"model", "plane", NULL, "missing"},
                                      {"model", "centred", NULL, "missing"},
                                      {"model", "classes", NULL, "missing"},
                                      {"model", "loss", NULL, "missing"},
                                      {"model", "loss", "hinge", "known name"},
                                      {"model", "activation", "gelu", "known name"},
                                      {"run", "split", "by hand", "known name"},
                                      {"run", "lr", "fast", "number"}};
    refuse_texts(read_model, fresh_model, texts, LG_COUNT(texts));
    static const bad_integer integers[] = {{"model", "channels", 0, "channels"},
                                           {"model", "channels", 3, "shape"},
                                           {"model", "channels", 1 << 20, "shape"},
                                           {"model", "channels", 1 << 21, "no network"},
                                           {"model", "length", 0, "length"},
                                           {"model", "length", 90, "shape"},
                                           {"model", "length", 4000000000, "sizes"},
                                           {"model", "plane", 1 << 20, "plane/weight"},
                                           {"model", "plane", -1, "plane"},
                                           {"model", "classes", 1, "classes"},
                                           {"model", "classes", 6, "shape"},
                                           {"model", "classes", 4000000000, "no network"},
                                           {"model", "classes", (int64_t)1 << 40, "classes"},
                                           {"model", "centred", 2, "0 nor 1"},
                                           {"run", "test_fraction", 1, "out of range"},
                                           {"run", "validation_fraction", -1, "out of range"}};
    refuse_integers(read_model, fresh_model, integers, LG_COUNT(integers));
    const char *path = good_model(1);
    replace_text(path, "model", "loss", "mse"); /* of five classes */
    assert_refused(read_model, path, LG_FORMAT, "2 classes", "");
    static const char *const reals[][2] = {
        {"/", "rate"}, {"/", "accuracy"}, {"/", "f1"}, {"/", "test_mse"}, {"run", "test_fraction"}};
    refuse_nans(read_model, fresh_model, "", reals, LG_COUNT(reals));
}

TEST("a model that could not be read is not saved") {
    lg_detector_file file;
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    make_model(1, &file);
#define REFUSED(place, bad, status)                                                                          \
    do {                                                                                                     \
        const lg_detector_file before = file;                                                                \
        place = bad;                                                                                         \
        assert_status(lg_model_save_detector(NULL, path, &file, NULL, &error), status);                      \
        assert_non_null(strstr(error.message, "refused.h5"));                                                \
        file = before;                                                                                       \
    } while (0)
    REFUSED(file.parameters, file.parameters + 1, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.net.lengths[1], 7, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.net.blocks, 99, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.net.block[0].kernel, 0, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.net.block[0].pooling, (lg_pooling)LG_POOLING_COUNT, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.net.outputs, 4, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.loss, LG_DETECTOR_MSE, LG_INVALID_ARGUMENT);
    REFUSED(file.run.model.loss, (lg_detector_loss)LG_DETECTOR_LOSS_COUNT, LG_INVALID_ARGUMENT);
    REFUSED(file.run.split, (lg_split)LG_SPLIT_COUNT, LG_INVALID_ARGUMENT);
    REFUSED(file.run.test_fraction, 0.95, LG_INVALID_ARGUMENT);
    REFUSED(file.run.test_fraction, NAN, LG_NOT_FINITE);
    REFUSED(file.scaler.channels, 1, LG_INVALID_ARGUMENT);
    REFUSED(file.scaler.mean, NULL, LG_INVALID_ARGUMENT);
    REFUSED(file.class_name, NULL, LG_INVALID_ARGUMENT);
    REFUSED(file.rate, -1, LG_INVALID_ARGUMENT);
    REFUSED(file.rate, INFINITY, LG_NOT_FINITE);
    REFUSED(file.accuracy, INFINITY, LG_NOT_FINITE);
    file.theta[3] = NAN;
    assert_status(lg_model_save_detector(NULL, path, &file, NULL, &error), LG_NOT_FINITE);
    assert_non_null(strstr(error.message, "refused.h5: /model/conv1/weight"));
    file.theta[3] = 0;
    file.scaler.scale[1] = 0;
    assert_status(lg_model_save_detector(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.scaler.scale[1] = INFINITY;
    assert_status(lg_model_save_detector(NULL, path, &file, NULL, NULL), LG_NOT_FINITE);
    file.scaler.scale[1] = 1;
    (void)snprintf(file.class_name[1], LG_SERIES_NAME, "state 4");
    assert_status(lg_model_save_detector(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_model_save_detector(NULL, NULL, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_int_not_equal(access(path, F_OK), 0);
    lg_detector_file_destroy(&file);
    assert_status(lg_model_save_detector(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
}

static void same_net_as_saved(const lg_detector_run *run, lg_file_reader *reader,
                              const lg_archive_reader *archive) {
    const lg_detector_run wanted = make_run(0);
    (void)reader, (void)archive;
    assert_same_net(&run->model.net, &wanted.model.net);
}

TEST("a fit resumed from its checkpoint ends in the same bits") {
    resume_checkpoint(same_net_as_saved);
}

TEST("a damaged checkpoint is refused") {
    static const char *const needed[] = {"batch",         "lr",      "data_sha256", "split",
                                         "test_fraction", "windows", "hop"};
    refuse_damaged_checkpoints("detector", "detector-checkpoint", 60, needed, LG_COUNT(needed));
}

TEST("a checkpoint of another run is refused, and the sentence names the difference") {
    const lg_detector_run wanted = make_run(3);
    lg_detector_run runs[12];
    static const char *const words[] = {"batch 33, not 32",   "split run, not group",
                                        "hop 75, not 150",    "centred yes, not no",
                                        "activation tanh",    "plane 2, not 1",
                                        "max 2/4, not",       "padding 0 none, not",
                                        "data_sha256",        "loss cross-entropy, not mse",
                                        "test_fraction 0.25", "windows 1, not 43200"};
    for (size_t i = 0; i < LG_COUNT(runs); i++) runs[i] = wanted;
    runs[0].training.batch = 33;
    runs[1].split = LG_SPLIT_RUN;
    runs[2].hop = 75;
    runs[3].model.centred = true;
    runs[4].model.net.activation = LG_TANH;
    runs[5].model.net.plane = 2;
    runs[6].model.net.block[7].pool_stride = 4; /* far along the text */
    runs[7].model.net.blocks = 7;
    runs[8].data_sha256[0] = 'f';
    runs[9].model.loss = LG_DETECTOR_CROSS_ENTROPY;
    runs[10].test_fraction = 0.25;
    runs[11].windows = 1;
    refuse_other_runs(&wanted, runs, words, LG_COUNT(runs));
}

/* ---- files of other kinds ---- */

static lg_series names_only(void) {
    lg_series names = {.classes = 2, .channels = 3, .rate = 50};
    names.class_name = lg_alloc(NULL, 2, sizeof *names.class_name);
    names.channel_name = lg_alloc(NULL, 3, sizeof *names.channel_name);
    names.class_label = lg_alloc(NULL, 2, sizeof *names.class_label);
    for (int i = 0; i < 2; i++) (void)snprintf(names.class_label[i], LG_SERIES_NAME, "%d", i + 1);
    for (int i = 0; i < 2; i++) (void)snprintf(names.class_name[i], LG_SERIES_NAME, "%c|%c", 'a' + i, 'x');
    for (int i = 0; i < 3; i++) (void)snprintf(names.channel_name[i], LG_SERIES_NAME, "channel %d", i);
    return names;
}

/* A classifier as the program writes it: names at the root, arrays and texts below /classifier. */
static lg_status write_classifier(const lg_context *context, const char *path, lg_error *error) {
    static const double weights[2][3] = {{1, 2, 3}, {4, 5, 6}};
    static const uint32_t counts[3] = {7, 0, 4294967295u};
    const uint64_t dims[2] = {2, 3};
    lg_file_writer *writer;
    lg_archive_writer archive;
    lg_series names = names_only();
    lg_status status = lg_file_writer_create(context, path, "classifier", NULL, &writer, error);
    if (status == LG_OK) {
        status = lg_file_writer_names(writer, &names, error);
        if (status == LG_OK) status = lg_file_writer_archive(writer, "", &archive);
        if (status == LG_OK) status = archive.text(archive.user, "classifier/method", "logistic");
        if (status == LG_OK) status = archive.text(archive.user, "classifier/features/kind", "cov");
        if (status == LG_OK)
            status =
                archive.array(archive.user, "classifier/logistic/weight", LG_ELEMENT_F64, 2, dims, weights);
        if (status == LG_OK)
            status =
                archive.array(archive.user, "classifier/tree/counts", LG_ELEMENT_U32, 1, dims + 1, counts);
        if (status == LG_OK) status = lg_file_writer_commit(writer, error);
        lg_file_writer_destroy(writer);
    }
    lg_series_destroy(&names);
    return status;
}

static lg_status read_classifier(const lg_context *context, const char *path, const lg_read_options *options,
                                 lg_error *error) {
    lg_file_reader *reader;
    lg_archive_reader archive;
    lg_series names;
    char method[16];
    double weights[6];
    uint32_t counts[3];
    const uint64_t dims[2] = {2, 3};
    LG_TRY(lg_file_reader_create(context, path, "classifier", options, &reader, error));
    lg_status status = lg_file_reader_names(reader, &names, error);
    if (status == LG_OK) {
        lg_series_destroy(&names);
        status = lg_file_reader_archive(reader, "", &archive);
    }
    if (status == LG_OK) status = archive.text(archive.user, "classifier/method", method, sizeof method);
    if (status == LG_OK)
        status = archive.array(archive.user, "classifier/logistic/weight", LG_ELEMENT_F64, 2, dims, weights);
    if (status == LG_OK)
        status = archive.array(archive.user, "classifier/tree/counts", LG_ELEMENT_U32, 1, dims + 1, counts);
    if (status != LG_OK && error != NULL && error->message[0] == '\0')
        (void)lg_fail(error, status, "%s", lg_file_reader_message(reader));
    lg_file_reader_destroy(reader);
    return status;
}

static const char *good_classifier(void) {
    const char *path = scratch_path("classifier.h5"), *original = scratch_path("classifier.original");
    if (access(original, F_OK) != 0) assert_ok(write_classifier(NULL, original, NULL));
    copy_file(original, path);
    return path;
}

TEST("the names and arrays of a classifier come back as they were written") {
    lg_file_reader *reader;
    lg_archive_reader archive;
    lg_series names, want = names_only();
    char text[16];
    double weights[6];
    uint32_t counts[3], rank;
    uint64_t dims[4];
    assert_ok(lg_file_reader_create(NULL, good_classifier(), "classifier", NULL, &reader, NULL));
    assert_ok(lg_file_reader_names(reader, &names, NULL));
    assert_int_equal(names.classes, 2);
    assert_int_equal(names.channels, 3);
    assert_close(names.rate, 50, 0, 0);
    assert_memory_equal(names.class_name, want.class_name, 2 * LG_SERIES_NAME);
    assert_memory_equal(names.class_label, want.class_label, 2 * LG_SERIES_NAME);
    assert_memory_equal(names.channel_name, want.channel_name, 3 * LG_SERIES_NAME);
    assert_ok(lg_file_reader_archive(reader, "", &archive));
    assert_ok(archive.text(archive.user, "classifier/method", text, sizeof text));
    assert_string_equal(text, "logistic");
    assert_ok(archive.text(archive.user, "classifier/features/kind", text, sizeof text));
    assert_string_equal(text, "cov");
    assert_ok(archive.shape(archive.user, "classifier/logistic/weight", &rank, dims));
    assert_true(rank == 2 && dims[0] == 2 && dims[1] == 3);
    assert_ok(archive.array(archive.user, "classifier/logistic/weight", LG_ELEMENT_F64, 2, dims, weights));
    for (int i = 0; i < 6; i++) assert_close(weights[i], i + 1, 0, 0);
    assert_ok(archive.array(archive.user, "classifier/tree/counts", LG_ELEMENT_U32, 1, dims + 1, counts));
    assert_int_equal(counts[2], 4294967295u);
    lg_file_reader_destroy(reader);
    lg_series_destroy(&names);
    lg_series_destroy(&want);
    refuse_damaged_files(read_classifier, good_classifier(), "");
    survive_changed_bytes(read_classifier, good_classifier(), 60);
    delete_link(good_classifier(), "classes");
    assert_refused(read_classifier, scratch_path("classifier.h5"), LG_FORMAT, "classes", "missing");
}

TEST("names and rates that could not be read are not written") {
    lg_file_writer *writer;
    lg_series names = names_only();
    lg_error error = {LG_OK, ""};
    assert_ok(lg_file_writer_create(NULL, scratch_path("names.h5"), "classifier", NULL, &writer, NULL));
    memcpy(names.class_name[1], names.class_name[0], LG_SERIES_NAME);
    assert_status(lg_file_writer_names(writer, &names, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "'a|x' is there twice"));
    names.rate = NAN;
    assert_status(lg_file_writer_names(writer, &names, NULL), LG_NOT_FINITE);
    lg_series_destroy(&names);
    assert_status(lg_file_writer_names(writer, &names, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_names(writer, NULL, NULL), LG_INVALID_ARGUMENT);
    lg_file_writer_destroy(writer);
    assert_status(lg_file_reader_names(NULL, &names, NULL), LG_INVALID_ARGUMENT);
}

static lg_status read_kind(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    char kind[64];
    return lg_file_kind(context, path, options, kind, sizeof kind, error);
}

static void assert_kind(const char *path, const char *expected) {
    char kind[24] = "untouched";
    assert_ok(lg_file_kind(NULL, path, NULL, kind, sizeof kind, NULL));
    assert_string_equal(kind, expected);
}

TEST("a file tells its kind") {
    char kind[9] = "before";
    lg_error error = {LG_OK, ""};
    assert_kind(good_model(0), "detector");
    assert_kind(good_checkpoint(), "detector-checkpoint");
    assert_kind(good_classifier(), "classifier");
    static const char *const others[] = {"hamiltonian", "surrogate", "series"};
    for (size_t i = 0; i < LG_COUNT(others); i++) {
        const char *path = good_model(0);
        replace_text(path, "/", "kind", others[i]);
        assert_kind(path, others[i]);
    }
    const char *path = good_model(0);
    assert_status(lg_file_kind(NULL, path, NULL, kind, 8, &error), LG_INVALID_ARGUMENT);
    assert_string_equal(kind, "before");
    assert_ok(lg_file_kind(NULL, path, NULL, kind, sizeof kind, NULL));
    delete_attribute(path, "/", "format");
    assert_kind(path, "detector"); /* written by hand */
    replace_text(path, "/", "format", "another");
    assert_kind(path, "");
    delete_attribute(path, "/", "format");
    replace_integer(path, "/", "kind", 7);
    assert_kind(path, "");
    delete_attribute(path, "/", "kind");
    assert_kind(path, "");
    path = good_model(0);
    replace_integer(path, "/", "format_version", 2);
    assert_refused(read_kind, path, LG_VERSION, "format_version", "");
    refuse_damaged_files(read_kind, good_model(0), "");
    assert_status(lg_file_kind(NULL, NULL, NULL, kind, sizeof kind, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_file_kind(NULL, path, NULL, NULL, 0, NULL), LG_INVALID_ARGUMENT);
}

/* ---- memory ---- */

static lg_status classifier_step(const lg_context *context, void *user, lg_error *error) {
    const lg_read_options options = without_probe();
    LG_TRY(write_classifier(context, user, error));
    return read_classifier(context, user, &options, error);
}

TEST("every allocation may fail, and nothing leaks") {
    fail_model_allocations(12, 8);
    assert_true(fail_every_allocation(classifier_step, (void *)good_classifier()) >= 12);
}

TEST("a model comes back with the state of its fit") {
    model_with_fit();
}
