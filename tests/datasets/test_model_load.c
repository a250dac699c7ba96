/* Model files of any kind as one handle: each kind, what is no model, damage, failing memory. */
#include "io_test.h"

#include "liegrad/detector.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "models/hamiltonian_internal.h"

static double *numbers(size_t count, lg_rng *rng) {
    double *out = lg_alloc(NULL, count, sizeof *out);
    assert_non_null(out);
    for (size_t i = 0; i < count; i++) out[i] = 0.3 * lg_rng_normal(rng);
    return out;
}

static const lg_training training = {.dtype = LG_F64,
                                     .epochs = 10,
                                     .batch = 4,
                                     .lr = 0.01,
                                     .lr_step = 1,
                                     .lr_gamma = 0.1,
                                     .adam_eps = 1e-8,
                                     .shards = 4};
#define SHA256 "0000000000000000000000000000000000000000000000000000000000000042"

/* ---- a file of each kind ---- */

static void write_hamiltonian(const char *path) {
    const uint32_t hidden[2] = {5, 4};
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    lg_hamiltonian_file file = {.run = {.system = "pendulum-chain",
                                        .scheme = lg_scheme_find("cf4"),
                                        .substeps = 1,
                                        .training = training,
                                        .trajectories = 5,
                                        .points = 3,
                                        .dt = 0.1,
                                        .data_sha256 = SHA256}};
    assert_ok(
        lg_hamiltonian_init(&file.run.model, &lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, hidden, 2, LG_TANH));
    file.parameters = lg_hamiltonian_parameters(&file.run.model);
    file.theta = numbers(file.parameters, &rng);
    assert_ok(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL));
    lg_hamiltonian_file_destroy(&file);
}

static void write_surrogate(const char *path) {
    const lg_surrogate_options options = {.kind = LG_SURROGATE_CONTINUOUS,
                                          .architecture = LG_NET_MULT,
                                          .embedding = 5,
                                          .hidden = 6,
                                          .layers = 2,
                                          .activation = LG_TANH,
                                          .normalise = true};
    lg_rng rng;
    lg_rng_seed(&rng, 2, 0);
    lg_surrogate_file file = {.run = {.training = training,
                                      .train_fraction = 0.9,
                                      .test_fraction = 0.1,
                                      .curves = 10,
                                      .data_sha256 = SHA256}};
    assert_ok(lg_surrogate_init(&file.run.model, &options, 4, 3.3, 1.5, NULL));
    file.parameters = lg_surrogate_parameters(&file.run.model);
    file.theta = numbers(file.parameters, &rng);
    assert_ok(lg_model_save_surrogate(NULL, path, &file, NULL, NULL));
    lg_surrogate_file_destroy(&file);
}

static void write_detector(const char *path) {
    lg_rng rng;
    lg_rng_seed(&rng, 3, 0);
    lg_detector_file file = {.run = {.model = {.classes = 3, .loss = LG_DETECTOR_CROSS_ENTROPY},
                                     .training = training,
                                     .test_fraction = 0.2,
                                     .validation_fraction = 0.1,
                                     .windows = 12,
                                     .window = 60,
                                     .hop = 60,
                                     .data_sha256 = SHA256},
                             .scaler = {.channels = 2, .mean = numbers(2, &rng), .scale = numbers(2, &rng)},
                             .class_name = lg_alloc(NULL, 3, sizeof *file.class_name),
                             .accuracy = NAN,
                             .f1 = NAN,
                             .test_mse = NAN};
    assert_non_null(file.class_name);
    lg_cnn_init_default(&file.run.model.net, 2, 60, 3, LG_SWISH);
    for (int c = 0; c < 3; c++) (void)snprintf(file.class_name[c], LG_SERIES_NAME, "class %d", c);
    for (int c = 0; c < 2; c++) file.scaler.scale[c] = 1.5 + c;
    file.parameters = lg_cnn_parameters(&file.run.model.net);
    file.theta = numbers(file.parameters, &rng);
    assert_ok(lg_model_save_detector(NULL, path, &file, NULL, NULL));
    lg_detector_file_destroy(&file);
}

static void (*const writers[LG_MODEL_KIND_COUNT])(const char *) = {
    [LG_MODEL_HAMILTONIAN] = write_hamiltonian,
    [LG_MODEL_SURROGATE] = write_surrogate,
    [LG_MODEL_DETECTOR] = write_detector,
};

/* Written once; a copy each time. */
static const char *fresh(lg_model_kind kind) {
    char name[32];
    (void)snprintf(name, sizeof name, "kind%d.original", (int)kind);
    const char *path = scratch_path("model.h5"), *original = scratch_path(name);
    if (access(original, F_OK) != 0) writers[kind](original);
    copy_file(original, path);
    return path;
}

static lg_status read_any(const lg_context *context, const char *path, const lg_read_options *options,
                          lg_error *error) {
    lg_model_file file, untouched;
    memset(&file, 0x41, sizeof file);
    memcpy(&untouched, &file, sizeof file);
    const lg_status status = lg_model_load(context, path, options, &file, error);
    if (status == LG_OK)
        lg_model_file_destroy(&file);
    else
        assert_memory_equal(&file, &untouched, sizeof file);
    return status;
}

/* ---- models ---- */

static void *work_of(const lg_model *model) {
    void *work = NULL;
    assert_int_equal(posix_memalign(&work, 64, lg_model_work_size(model)), 0);
    return work;
}

static void assert_same_numbers(const double *x, const double *y, size_t count) {
    assert_memory_equal(x, y, count * sizeof *x);
}

/* The handle has the kind and the sizes of another, and computes the same numbers. */
static void assert_same_model(const lg_model *model, const lg_model *expected) {
    const size_t n = lg_model_inputs(model), outputs = lg_model_outputs(model);
    assert_int_equal(lg_model_kind_of(model), lg_model_kind_of(expected));
    assert_int_equal(n, lg_model_inputs(expected));
    assert_int_equal(outputs, lg_model_outputs(expected));
    assert_int_equal(lg_model_parameters(model), lg_model_parameters(expected));
    double *x = calloc(n, sizeof *x), *y = calloc(outputs, sizeof *y), *again = calloc(outputs, sizeof *y);
    assert_true(x != NULL && y != NULL && again != NULL);
    for (size_t i = 0; i < n; i++) x[i] = 0.1 * (double)(i % 7) - 0.2;
    void *work = work_of(model), *expected_work = work_of(expected);
    lg_model_eval(model, x, y, work);
    lg_model_eval(expected, x, again, expected_work);
    for (size_t i = 0; i < outputs; i++) {
        assert_true(isfinite(y[i]));
        assert_close(y[i], again[i], 0.0, 0.0);
    }
    free(x), free(y), free(again), free(work), free(expected_work);
}

TEST("a Hamiltonian loads as a model") {
    lg_model_file file;
    lg_hamiltonian_file own;
    const char *path = fresh(LG_MODEL_HAMILTONIAN);
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &own, NULL));
    lg_model *expected;
    assert_ok(lg_model_create_hamiltonian(NULL, &own.run.model, own.theta, &expected, NULL));
    assert_int_equal(file.kind, LG_MODEL_HAMILTONIAN);
    assert_same_model(file.model, expected);
    assert_same_numbers(file.hamiltonian.theta, own.theta, own.parameters);
    assert_memory_equal(&file.hamiltonian.run.model.net, &own.run.model.net, sizeof(lg_mlp));
    assert_string_equal(file.hamiltonian.run.system, "pendulum-chain");
    lg_model_destroy(expected);
    lg_model_file_destroy(&file);
    lg_hamiltonian_file_destroy(&own);
}

TEST("a surrogate loads as a model") {
    lg_model_file file;
    lg_surrogate_file own;
    const char *path = fresh(LG_MODEL_SURROGATE);
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    assert_ok(lg_model_load_surrogate(NULL, path, NULL, &own, NULL));
    lg_model *expected;
    assert_ok(lg_model_create_surrogate(NULL, &own.run.model, own.theta, &expected, NULL));
    assert_int_equal(file.kind, LG_MODEL_SURROGATE);
    assert_same_model(file.model, expected);
    assert_same_numbers(file.surrogate.theta, own.theta, own.parameters);
    lg_model_destroy(expected);
    lg_model_file_destroy(&file);
    lg_surrogate_file_destroy(&own);
}

TEST("a detector loads as a model") {
    lg_model_file file;
    lg_detector_file own;
    const char *path = fresh(LG_MODEL_DETECTOR);
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    assert_ok(lg_model_load_detector(NULL, path, NULL, &own, NULL));
    lg_model *expected;
    assert_ok(lg_model_create_detector(NULL, &own.run.model, &own.scaler, own.theta, &expected, NULL));
    assert_int_equal(file.kind, LG_MODEL_DETECTOR);
    assert_same_model(file.model, expected);
    assert_same_numbers(file.detector.theta, own.theta, own.parameters);
    assert_same_numbers(file.detector.scaler.mean, own.scaler.mean, 2);
    assert_same_numbers(file.detector.scaler.scale, own.scaler.scale, 2);
    assert_int_equal(file.detector.scaler.channels, 2);
    lg_model_destroy(expected);
    assert_string_equal(file.detector.class_name[2], "class 2");
    lg_model_file_destroy(&file);
    lg_detector_file_destroy(&own);
}

TEST("a structure that was moved still finds its numbers") {
    lg_model_file *first = malloc(sizeof *first), second;
    assert_non_null(first);
    assert_ok(lg_model_load(NULL, fresh(LG_MODEL_DETECTOR), NULL, first, NULL));
    second = *first;
    memset(first, 0x41, sizeof *first);
    free(first);
    void *work = work_of(second.model);
    double x[120] = {0.0}, y[3] = {NAN, NAN, NAN};
    lg_model_eval(second.model, x, y, work);
    for (int i = 0; i < 3; i++) assert_true(isfinite(y[i]));
    free(work);
    lg_model_file_destroy(&second);
}

TEST("a freed file is zero and may be freed again") {
    static const lg_model_file zero;
    lg_model_file file;
    memset(&file, 0, sizeof file);
    lg_model_file_destroy(&file); /* a zeroed one */
    lg_model_file_destroy(NULL);
    for (int kind = 0; kind < LG_MODEL_KIND_COUNT; kind++) {
        assert_ok(lg_model_load(NULL, fresh((lg_model_kind)kind), NULL, &file, NULL));
        lg_model_file_destroy(&file);
        assert_memory_equal(&file, &zero, sizeof file);
        lg_model_file_destroy(&file); /* twice */
    }
}

/* ---- what is no model ---- */

TEST("files that say that they are another kind are refused, whatever is in them") {
    static const char *const kinds[][2] = {
        {"checkpoint", "checkpoint of an unfinished training"},
        {"surrogate-checkpoint", "checkpoint of an unfinished training"},
        {"detector-checkpoint", "checkpoint of an unfinished training"},
        {"classifier", "lg_classifier_load"},
        {"trajectories", "data"},
        {"trajectory", "data"},
        {"elastica", "data"},
        {"series", "data"},
        {"hamiltonians", "unknown"},
        {"Hamiltonian", "unknown"},
    };
    for (size_t i = 0; i < LG_COUNT(kinds); i++) {
        lg_file_writer *writer;
        const char *path = scratch_path("other.h5");
        assert_ok(lg_file_writer_create(NULL, path, kinds[i][0], NULL, &writer, NULL));
        assert_ok(lg_file_writer_commit(writer, NULL));
        lg_file_writer_destroy(writer);
        assert_refused(read_any, path, LG_FORMAT, kinds[i][0], kinds[i][1]);
    }
}

/* As their own writers make them. */
TEST("data and checkpoints are no models") {
    lg_trajectories data;
    lg_file_writer *writer;
    lg_hamiltonian_file file;
    const char *path = scratch_path("data.h5");
    assert_ok(
        lg_trajectories_create(NULL, "quartic", &lg_hamiltonian_separable, 2, 2, 3, 1.0, false, 0, &data));
    assert_ok(lg_trajectories_write(NULL, path, &data, NULL));
    lg_trajectories_destroy(&data);
    assert_refused(read_any, path, LG_FORMAT, "trajectories", "data");
    assert_ok(lg_model_load_hamiltonian(NULL, fresh(LG_MODEL_HAMILTONIAN), NULL, &file, NULL));
    path = scratch_path("checkpoint.h5");
    assert_ok(lg_checkpoint_create(NULL, path, &lg_run_hamiltonian, &file.run, NULL, &writer, NULL));
    assert_ok(lg_file_writer_commit(writer, NULL));
    lg_file_writer_destroy(writer);
    lg_hamiltonian_file_destroy(&file);
    assert_refused(read_any, path, LG_FORMAT, "checkpoint", "unfinished");
}

TEST("files of other programs are refused") {
    const char *path = fresh(LG_MODEL_HAMILTONIAN);
    replace_text(path, "/", "format", "keras");
    assert_refused(read_any, path, LG_FORMAT, "does not say", "");
    path = fresh(LG_MODEL_HAMILTONIAN);
    delete_attribute(path, "/", "kind");
    assert_refused(read_any, path, LG_FORMAT, "does not say", "");
    path = fresh(LG_MODEL_SURROGATE);
    replace_integer(path, "/", "format_version", LG_FORMAT_VERSION + 1);
    assert_refused(read_any, path, LG_VERSION, "format_version", "");
}

TEST("one kind that says that it is another is refused") {
    static const char *const names[LG_MODEL_KIND_COUNT] = {"hamiltonian", "surrogate", "detector"};
    for (int kind = 0; kind < LG_MODEL_KIND_COUNT; kind++)
        for (int other = 0; other < LG_MODEL_KIND_COUNT; other++) {
            const char *path = fresh((lg_model_kind)kind);
            replace_text(path, "/", "kind", names[other]);
            if (kind == other)
                assert_ok(read_any(NULL, path, NULL, NULL));
            else
                assert_refused(read_any, path, LG_FORMAT, "", "");
        }
}

TEST("a missing file or argument is refused") {
    lg_model_file file;
    assert_status(lg_model_load(NULL, NULL, NULL, &file, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_model_load(NULL, fresh(LG_MODEL_DETECTOR), NULL, NULL, NULL), LG_INVALID_ARGUMENT);
}

/* ---- damage ---- */

TEST("a damaged file of any kind is refused") {
    for (int kind = 0; kind < LG_MODEL_KIND_COUNT; kind++) {
        (void)fresh((lg_model_kind)kind);
        char name[32];
        (void)snprintf(name, sizeof name, "kind%d.original", kind);
        refuse_damaged_files(read_any, scratch_path(name), "");
        survive_changed_bytes(read_any, scratch_path(name), 60);
    }
}

TEST("missing and bad weights are refused") {
    const hsize_t dims[2] = {6, 5}, short_dims[2] = {5, 5};
    double values[30];
    for (size_t i = 0; i < LG_COUNT(values); i++) values[i] = i == 7 ? NAN : 1.0;
    const char *path = fresh(LG_MODEL_HAMILTONIAN);
    delete_link(path, "/model/mass/gamma");
    assert_refused(read_any, path, LG_FORMAT, "gamma", "");
    path = fresh(LG_MODEL_HAMILTONIAN);
    replace_dataset(path, "/model/potential/layer1/weight", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, dims,
                    values);
    assert_refused(read_any, path, LG_NOT_FINITE, "layer1/weight", "");
    path = fresh(LG_MODEL_HAMILTONIAN);
    replace_dataset(path, "/model/potential/layer1/weight", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, short_dims,
                    values);
    assert_refused(read_any, path, LG_FORMAT, "layer1/weight", "");
    path = fresh(LG_MODEL_DETECTOR);
    delete_link(path, "/scaler/scale");
    assert_refused(read_any, path, LG_FORMAT, "scale", "");
}

TEST("every allocation may fail, and nothing leaks") {
    for (int kind = 0; kind < LG_MODEL_KIND_COUNT; kind++)
        assert_true(fail_every_reading(read_any, fresh((lg_model_kind)kind)) >= 2);
}
