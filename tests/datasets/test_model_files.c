/* Models and checkpoints: round trip, the matrix of bad input. */
#include "io_test.h"

static const uint32_t hidden[] = {4, 3};

typedef struct example {
    lg_hamiltonian_family family;
    uint32_t links;
    lg_potential_kind potential;
    lg_dtype dtype;
} example;

static const example examples[] = {
    {LG_HAMILTONIAN_CHAIN, 2, LG_POTENTIAL_MLP, LG_F64},
    {LG_HAMILTONIAN_CHAIN, 1, LG_POTENTIAL_LINEAR, LG_F32},
    {LG_HAMILTONIAN_SEPARABLE, 2, LG_POTENTIAL_MLP, LG_F32},
    {LG_HAMILTONIAN_SEPARABLE, 3, LG_POTENTIAL_LINEAR, LG_F64},
};

static lg_hamiltonian_run make_run(const example *e) {
    lg_hamiltonian_run run = {.integrator =
                                  e->family == LG_HAMILTONIAN_CHAIN ? LG_TRAIN_CF4 : LG_TRAIN_STORMER_VERLET,
                              .substeps = 2,
                              .penalty = 0.125,
                              .penalty_form = LG_PENALTY_PUBLISHED,
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
                   e->family == LG_HAMILTONIAN_CHAIN ? "pendulum-chain" : "quartic");
    (void)snprintf(run.data_sha256, sizeof run.data_sha256, "%064d", 42);
    assert_ok(lg_hamiltonian_init(&run.model, e->family, e->links, e->potential, hidden, 2, LG_TANH));
    return run;
}

static double *numbers(size_t count, lg_rng *rng, bool positive, lg_dtype dtype) {
    double *out = lg_alloc(NULL, count, sizeof *out);
    assert_non_null(out);
    for (size_t i = 0; i < count; i++) {
        out[i] = positive ? lg_rng_uniform(rng) : lg_rng_normal(rng);
        if (dtype == LG_F32) out[i] = (float)out[i];
    }
    return out;
}

static void make_model(const example *e, lg_hamiltonian_file *file) {
    lg_rng rng;
    lg_rng_seed(&rng, 3, 4);
    *file = (lg_hamiltonian_file){.run = make_run(e),
                                  .adam_step = 700,
                                  .has_rng = true,
                                  .rng = rng,
                                  .epochs_done = 6,
                                  .has_e1 = true,
                                  .e1 = 1.7e-7};
    size_t n = file->parameters = lg_hamiltonian_parameters(&file->run.model);
    file->theta = numbers(n, &rng, false, e->dtype);
    file->adam_m = numbers(n, &rng, false, LG_F64);
    file->adam_v = numbers(n, &rng, true, LG_F64);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) file->history[i] = numbers(6, &rng, true, LG_F64);
    for (int i = 0; i < 6; i++) file->history[LG_FIT_VALIDATION][i] = NAN;
    (void)snprintf(file->provenance.cpu, sizeof file->provenance.cpu, "kernels baseline");
}

static const char *good_model(size_t which) {
    lg_hamiltonian_file file;
    const char *path = scratch_path("model.h5");
    make_model(&examples[which], &file);
    assert_ok(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL));
    lg_hamiltonian_file_free(NULL, &file);
    return path;
}

static lg_status read_model(const lg_context *context, const char *path, const lg_read_options *options,
                            lg_error *error) {
    lg_hamiltonian_file file;
    lg_status status = lg_model_load_hamiltonian(context, path, options, &file, error);
    if (status == LG_OK) lg_hamiltonian_file_free(context, &file);
    return status;
}

static void model_round_trip(void **state) {
    (void)state;
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_hamiltonian_file file, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        make_model(&examples[e], &file);
        assert_ok(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL));
        assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &again, NULL));
        assert_ok(lg_hamiltonian_run_compare(path, &again.run, &file.run, NULL));
        size_t bytes = file.parameters * sizeof(double);
        assert_int_equal(again.parameters, file.parameters);
        assert_memory_equal(again.theta, file.theta, bytes);
        assert_memory_equal(again.adam_m, file.adam_m, bytes);
        assert_memory_equal(again.adam_v, file.adam_v, bytes);
        assert_true(again.adam_step == 700 && again.has_rng && again.has_e1 && !again.has_e2);
        assert_memory_equal(&again.rng, &file.rng, sizeof file.rng);
        assert_close(again.e1, 1.7e-7, 0, 0);
        assert_int_equal(again.epochs_done, 6);
        for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
            assert_memory_equal(again.history[i], file.history[i], 6 * sizeof(double));
        assert_string_equal(again.provenance.cpu, "kernels baseline");
        assert_string_equal(again.provenance.liegrad_version, lg_version());
        assert_ok(lg_model_save_hamiltonian(NULL, second, &again, NULL, NULL));
        assert_same_bytes(path, second);
        lg_hamiltonian_file_free(NULL, &file);
        lg_hamiltonian_file_free(NULL, &again);
    }
}

/* Weights lie where the flat vector says: (in, out) row-major, bias, ..., then the kinetic part. */
static void layers_by_name(void **state) {
    (void)state;
    lg_hamiltonian_file file;
    lg_h5 *h5;
    const char *path = good_model(0);
    double weight[6 * 4], bias[4], last[3], gamma_[4], b[2];
    make_model(&examples[0], &file);
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    assert_ok(lg_h5_get(h5, "model/potential/layer1/weight", LG_ELEMENT_F64, 2, (const uint64_t[]){6, 4},
                        weight, NULL));
    assert_ok(
        lg_h5_get(h5, "model/potential/layer1/bias", LG_ELEMENT_F64, 1, (const uint64_t[]){4}, bias, NULL));
    assert_ok(lg_h5_get(h5, "model/potential/layer3/weight", LG_ELEMENT_F64, 2, (const uint64_t[]){3, 1},
                        last, NULL));
    assert_false(lg_h5_has(h5, "model/potential/layer3/bias"));
    assert_ok(lg_h5_get(h5, "model/mass/gamma", LG_ELEMENT_F64, 2, (const uint64_t[]){2, 2}, gamma_, NULL));
    assert_ok(lg_h5_get(h5, "model/mass/b", LG_ELEMENT_F64, 1, (const uint64_t[]){2}, b, NULL));
    lg_h5_close(h5);
    assert_memory_equal(weight, file.theta, sizeof weight);
    assert_memory_equal(bias, file.theta + 24, sizeof bias);
    assert_memory_equal(last, file.theta + 24 + 4 + 12 + 3, sizeof last);
    assert_memory_equal(gamma_, file.theta + 46, sizeof gamma_);
    assert_memory_equal(b, file.theta + 50, sizeof b);
    assert_int_equal(file.parameters, 52);
    lg_hamiltonian_file_free(NULL, &file);
}

/* What a model written by hand needs, and what it may leave out. */
static void minimal_model(void **state) {
    (void)state;
    const char *path = good_model(0);
    static const char *const links[] = {"optimizer", "rng", "train", "run"};
    static const char *const attributes[] = {"E1",          "seed",  "command", "cpu", "liegrad_version",
                                             "conventions", "format"};
    for (size_t i = 0; i < LG_COUNT(links); i++) delete_link(path, links[i]);
    for (size_t i = 0; i < LG_COUNT(attributes); i++) delete_attribute(path, "/", attributes[i]);
    lg_hamiltonian_file file;
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &file, NULL));
    assert_null(file.adam_m);
    assert_int_equal(file.run.substeps, 1);
    assert_int_equal(file.parameters, 52);
    lg_hamiltonian_file_free(NULL, &file);
}

static void damaged_models(void **state) {
    (void)state;
    refuse_damaged_files(read_model, good_model(0), "");
    survive_changed_bytes(read_model, good_model(0), 300);
}

typedef struct bad_array {
    const char *name;
    int rank;
    hsize_t dims[2];
    double value; /* everywhere */
    lg_status status;
    const char *word;
} bad_array;

static void bad_arrays(void **state) {
    (void)state;
    static const bad_array cases[] = {
        {"model/potential/layer1/weight", 2, {4, 6}, 1, LG_FORMAT, "shape"},
        {"model/potential/layer1/weight", 1, {24}, 1, LG_FORMAT, "shape"},
        {"model/potential/layer1/weight", 2, {6, 4}, NAN, LG_NOT_FINITE, "(0, 0)"},
        {"model/potential/layer1/bias", 1, {5}, 1, LG_FORMAT, "shape"},
        {"model/potential/layer2/bias", 1, {3}, INFINITY, LG_NOT_FINITE, "(0)"},
        {"model/mass/gamma", 2, {3, 3}, 1, LG_FORMAT, "shape"},
        {"model/mass/gamma", 2, {2, 2}, NAN, LG_NOT_FINITE, "(0, 0)"},
        {"model/mass/b", 1, {1}, 1, LG_FORMAT, "shape"},
        {"optimizer/adam/m", 1, {51}, 1, LG_FORMAT, "51"},
        {"optimizer/adam/m", 2, {52, 1}, 1, LG_FORMAT, "rank"},
        {"optimizer/adam/v", 1, {52}, NAN, LG_NOT_FINITE, "(0)"},
        {"optimizer/adam/v", 1, {52}, -1, LG_FORMAT, "negative"},
        {"optimizer/adam/step", 1, {1}, 1, LG_FORMAT, "shape"},
        {"rng", 1, {4}, 0.5, LG_FORMAT, "integers"},
        {"train/history/rate", 1, {7}, 1, LG_FORMAT, "epoch"},
        {"train/history/loss", 2, {6, 1}, 1, LG_FORMAT, "epoch"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const bad_array *c = &cases[i];
        const char *path = good_model(0);
        double data[64];
        for (size_t j = 0; j < LG_COUNT(data); j++) data[j] = c->value;
        replace_dataset(path, c->name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, c->rank, c->dims, data);
        assert_refused(read_model, path, c->status, c->name, c->word);
    }
    static const char *const needed[] = {"model",
                                         "model/potential",
                                         "model/potential/layer2/weight",
                                         "model/potential/layer2/bias",
                                         "model/mass/gamma",
                                         "model/mass/b",
                                         "optimizer/adam/v"};
    for (size_t i = 0; i < LG_COUNT(needed); i++) {
        const char *path = good_model(0);
        delete_link(path, needed[i]);
        assert_refused(read_model, path, LG_FORMAT,
                       strcmp(needed[i], "model/potential") == 0 ? "layer1" : needed[i], "");
    }
}

typedef struct bad_attribute {
    const char *object, *name, *text; /* text NULL: deleted */
    const char *word;
} bad_attribute;

static void bad_model_attributes(void **state) {
    (void)state;
    static const bad_attribute cases[] = {
        {"/", "kind", NULL, "kind"},
        {"/", "kind", "trajectories", "trajectories"},
        {"/", "format", "other", "other"},
        {"/", "format_version", "two", "integer"},
        {"model", "family", NULL, "missing"},
        {"model", "family", "pendulum", "known name"},
        {"model", "links", NULL, "missing"},
        {"model", "links", "two", "integer"},
        {"model", "potential", "cubic", "known name"},
        {"model", "activation", "softsign", "known name"},
        {"model", "hidden", NULL, "missing"},
        {"model", "hidden", "4,,3", "100,100,100"},
        {"model", "hidden", "4,-3", "100,100,100"},
        {"model", "hidden", "4,3,", "100,100,100"},
        {"model", "hidden", "4,0", "out of range"},
        {"model", "hidden", "4,4", "layer2"},
        {"model", "hidden", "4,99999999999", "100,100,100"},
        {"model", "hidden", "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1", "100,100,100"},
        {"run", "dtype", "f16", "known name"},
        {"run", "integrator", "magic", "known name"},
        {"run", "lr", "fast", "number"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const bad_attribute *c = &cases[i];
        const char *path = good_model(0);
        delete_attribute(path, c->object, c->name);
        if (c->text != NULL) replace_text(path, c->object, c->name, c->text);
        const char *key = strcmp(c->word, "layer2") == 0 ? "" : c->name;
        assert_refused(read_model, path, LG_FORMAT, key, c->word);
    }
    static const struct {
        const char *object, *name;
        int64_t value;
        lg_status status;
    } integers[] = {{"/", "format_version", 2, LG_VERSION},
                    {"/", "format_version", 0, LG_FORMAT},
                    {"model", "links", 3, LG_FORMAT},
                    {"model", "links", 0, LG_FORMAT},
                    {"model", "links", -1, LG_FORMAT},
                    {"model", "links", 1 << 20, LG_FORMAT},
                    {"model", "links", 5000000000, LG_FORMAT},
                    {"run", "substeps", 0, LG_FORMAT},
                    {"run", "seed", -1, LG_FORMAT}};
    for (size_t i = 0; i < LG_COUNT(integers); i++) {
        const char *path = good_model(0);
        replace_integer(path, integers[i].object, integers[i].name, integers[i].value);
        /* links 3 fits lg_hamiltonian_init: then the arrays do not. */
        assert_refused(read_model, path, integers[i].status,
                       integers[i].value == 3 ? "layer1" : integers[i].name, "");
    }
    static const char *const reals[][2] = {{"run", "lr"}, {"run", "dt"}, {"run", "penalty"}, {"/", "E1"}};
    for (size_t i = 0; i < LG_COUNT(reals); i++) {
        const double nan_value = NAN;
        const char *path = good_model(0);
        replace_attribute(path, reals[i][0], reals[i][1], H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &nan_value);
        assert_refused(read_model, path, LG_NOT_FINITE, reals[i][1], "finite");
    }
}

static void refused_on_save(void **state) {
    (void)state;
    lg_hamiltonian_file file;
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    make_model(&examples[0], &file);
    file.theta[47] = NAN;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, &error), LG_NOT_FINITE);
    assert_non_null(strstr(error.message, "refused.h5: /model/mass/gamma"));
    assert_non_null(strstr(error.message, "(0, 1)"));
    file.theta[47] = 0;
    file.parameters--;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.parameters++;
    file.run.model.links = 77;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.run = make_run(&examples[0]);
    file.run.integrator = (lg_train_integrator)77;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.run = make_run(&examples[0]);
    file.run.training.lr = NAN;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_NOT_FINITE);
    file.run = make_run(&examples[0]);
    assert_status(lg_model_save_hamiltonian(NULL, scratch_path("no/folder/model.h5"), &file, NULL, &error),
                  LG_FILE);
    assert_non_null(strstr(error.message, "no/folder/model.h5"));
    assert_int_not_equal(access(path, F_OK), 0);
    lg_hamiltonian_file_free(NULL, &file);
}

/* ---- a model with the state of its fit ---- */

static lg_status square_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                             size_t batch, lg_var *loss) {
    (void)user, (void)samples;
    *loss = lg_scale(tape, lg_sum(tape, lg_mul(tape, theta, theta)), (double)count / (double)batch);
    return lg_tape_status(tape);
}

static lg_fit *make_fit(const double *theta, size_t parameters) {
    lg_fit_problem problem = {.parameters = parameters, .samples = 12, .loss = square_loss};
    lg_fit_options options;
    lg_fit *fit;
    lg_fit_options_init(&options);
    options.epochs = 5;
    options.batch = 5;
    options.stop_after = 3;
    assert_ok(lg_fit_create(NULL, &problem, &options, theta, &fit, NULL));
    return fit;
}

static void model_with_fit(void **state) {
    (void)state;
    lg_hamiltonian_file file, again;
    const char *path = scratch_path("fitted.h5");
    make_model(&examples[0], &file);
    lg_fit *fit = make_fit(file.theta, file.parameters);
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, file.theta);
    assert_ok(lg_model_save_hamiltonian(NULL, path, &file, fit, NULL));
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &again, NULL));
    assert_memory_equal(again.theta, file.theta, file.parameters * sizeof(double));
    assert_int_equal(again.adam_step, 9);
    assert_int_equal(again.epochs_done, 3);
    assert_memory_equal(again.history[LG_FIT_LOSS], lg_fit_history(fit, LG_FIT_LOSS), 3 * sizeof(double));
    lg_fit_destroy(fit);
    lg_hamiltonian_file_free(NULL, &file);
    lg_hamiltonian_file_free(NULL, &again);
}

/* ---- checkpoints ---- */

static lg_status write_checkpoint(const lg_context *context, const char *path, const lg_hamiltonian_run *run,
                                  const lg_fit *fit, lg_error *error) {
    lg_file_writer *writer;
    lg_archive_writer archive;
    LG_TRY(lg_checkpoint_create(context, path, run, NULL, &writer, error));
    lg_status status = lg_file_writer_archive(writer, "fit", &archive);
    if (status == LG_OK && fit != NULL) status = lg_fit_save(fit, &archive, error);
    if (status == LG_OK) status = archive.text(archive.user, "note/author", "nobody");
    if (status == LG_OK) status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}

static lg_status read_checkpoint(const lg_context *context, const char *path, const lg_read_options *options,
                                 lg_error *error) {
    lg_hamiltonian_run run;
    lg_file_reader *reader;
    lg_status status = lg_checkpoint_open(context, path, options, &run, &reader, error);
    if (status == LG_OK) lg_file_reader_close(reader);
    return status;
}

static const char *good_checkpoint(void) {
    lg_hamiltonian_run run = make_run(&examples[0]);
    const char *path = scratch_path("check.h5");
    double theta[3] = {1, 2, 3};
    lg_fit *fit = make_fit(theta, 3);
    assert_ok(lg_fit_run(fit, NULL));
    assert_ok(write_checkpoint(NULL, path, &run, fit, NULL));
    lg_fit_destroy(fit);
    return path;
}

/* Files of before there were schedules have no key for it: then it is steps. Every other row is there. */
static void without_schedule(void **state) {
    (void)state;
    lg_hamiltonian_run run, wanted = make_run(&examples[0]);
    lg_file_reader *reader;
    lg_hamiltonian_file file;
    const char *path = good_checkpoint();
    delete_attribute(path, "run", "schedule");
    assert_ok(lg_checkpoint_open(NULL, path, NULL, &run, &reader, NULL));
    lg_file_reader_close(reader);
    wanted.training.schedule = LG_SCHEDULE_STEP;
    assert_ok(lg_hamiltonian_run_compare(path, &run, &wanted, NULL));
    path = good_model(0);
    delete_attribute(path, "run", "schedule");
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &file, NULL));
    assert_ok(lg_hamiltonian_run_compare(path, &file.run, &wanted, NULL));
    lg_hamiltonian_file_free(NULL, &file);
    /* Their fits were saved with a floor of 0, whatever lr_gamma: they must find it again. */
    lg_fit_options options;
    lg_fit_options_init(&options);
    lg_training_apply(&run.training, &options);
    assert_close(options.schedule.gamma, 0.1, 0, 0);
    assert_close(options.schedule.floor, 0, 0, 0);
    path = good_model(0);
    replace_text(path, "run", "schedule", "sawtooth");
    assert_refused(read_model, path, LG_FORMAT, "schedule", "known name");
}

/* 3 epochs, checkpoint, 2 more: the same bits as 5. */
static void checkpoint_resumes(void **state) {
    (void)state;
    double theta[3] = {1, 2, 3}, straight[3], resumed[3];
    char note[16];
    lg_hamiltonian_run wanted = make_run(&examples[0]), run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    lg_fit *fit = make_fit(theta, 3);
    assert_ok(lg_fit_run(fit, NULL));
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, straight);
    lg_fit_destroy(fit);
    assert_ok(lg_checkpoint_open(NULL, good_checkpoint(), NULL, &run, &reader, NULL));
    assert_ok(lg_hamiltonian_run_compare("check.h5", &run, &wanted, NULL));
    assert_ok(lg_file_reader_archive(reader, "fit", &archive));
    fit = make_fit(theta, 3);
    assert_ok(lg_fit_load(fit, &archive, NULL));
    assert_ok(archive.text(archive.user, "note/author", note, sizeof note));
    assert_string_equal(note, "nobody");
    assert_status(archive.text(archive.user, "note/author", note, 3), LG_SHAPE);
    assert_status(archive.text(archive.user, "note/nothing", note, sizeof note), LG_NOT_FOUND);
    double value;
    assert_status(archive.array(archive.user, "nothing", LG_ELEMENT_F64, 0, NULL, &value), LG_NOT_FOUND);
    assert_non_null(strstr(lg_file_reader_message(reader), "check.h5: has no /fit/nothing"));
    assert_status(archive.array(archive.user, "optimizer/adam/m", LG_ELEMENT_F64, 0, NULL, &value), LG_SHAPE);
    uint32_t rank;
    uint64_t dims[4];
    assert_ok(archive.shape(archive.user, "optimizer/adam/m", &rank, dims));
    assert_true(rank == 1 && dims[0] == 3);
    lg_file_reader_close(reader);
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, resumed);
    lg_fit_destroy(fit);
    assert_memory_equal(straight, resumed, sizeof straight);
}

/* A NaN in the saved state of the optimiser is found when the fit takes it. */
static void checkpoint_with_nan(void **state) {
    (void)state;
    const char *path = good_checkpoint();
    const double bad[3] = {0, NAN, 0};
    const hsize_t three = 3;
    replace_dataset(path, "fit/optimizer/adam/m", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &three, bad);
    lg_hamiltonian_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    double theta[3] = {1, 2, 3};
    lg_fit *fit = make_fit(theta, 3);
    assert_ok(lg_checkpoint_open(NULL, path, NULL, &run, &reader, NULL));
    assert_ok(lg_file_reader_archive(reader, "fit", &archive));
    lg_status status = lg_fit_load(fit, &archive, NULL);
    assert_true(status == LG_FORMAT || status == LG_NOT_FINITE);
    lg_file_reader_close(reader);
    lg_fit_destroy(fit);
}

static void damaged_checkpoints(void **state) {
    (void)state;
    refuse_damaged_files(read_checkpoint, good_checkpoint(), "");
    survive_changed_bytes(read_checkpoint, good_checkpoint(), 300);
    const char *path = good_checkpoint();
    replace_integer(path, "/", "format_version", 7);
    assert_refused(read_checkpoint, path, LG_VERSION, "format_version", "7");
    path = good_checkpoint();
    replace_text(path, "run", "batch", "eighty");
    assert_refused(read_checkpoint, path, LG_FORMAT, "batch", "integer");
    const double nan_value = NAN;
    path = good_checkpoint();
    replace_attribute(path, "run", "lr", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &nan_value);
    assert_refused(read_checkpoint, path, LG_NOT_FINITE, "lr", "finite");
    static const char *const needed[] = {"batch", "lr", "data_sha256", "integrator", "dtype", "seed", "dt"};
    for (size_t i = 0; i < LG_COUNT(needed); i++) {
        path = good_checkpoint();
        delete_attribute(path, "run", needed[i]);
        assert_refused(read_checkpoint, path, LG_FORMAT, needed[i], "missing");
    }
    assert_refused(read_checkpoint, good_model(0), LG_FORMAT, "kind", "checkpoint");
    assert_refused(read_model, good_checkpoint(), LG_FORMAT, "kind", "hamiltonian");
}

static void another_problem(void **state) {
    (void)state;
    const lg_hamiltonian_run wanted = make_run(&examples[0]);
    lg_error error;
    struct {
        lg_hamiltonian_run run;
        const char *word;
    } cases[] = {{wanted, "batch 81, not 80"},
                 {wanted, "lr 0.02"},
                 {wanted, "integrator rk4, not cf4"},
                 {wanted, "seed 3"},
                 {wanted, "data_sha256"},
                 {wanted, "hidden 4,3, not"},
                 {wanted, "dtype f32, not f64"},
                 {wanted, "dt 0.0"},
                 {wanted, "schedule step, not cosine"},
                 {wanted, "validation 0.2"}};
    cases[0].run.training.batch = 81;
    cases[1].run.training.lr = 0.02;
    cases[2].run.integrator = LG_TRAIN_RK4;
    cases[3].run.training.seed = 3;
    cases[4].run.data_sha256[0] = 'f';
    cases[6].run.training.dtype = LG_F32;
    cases[7].run.dt = nextafter(wanted.dt, 1);
    cases[8].run.training.schedule = LG_SCHEDULE_STEP;
    cases[9].run.training.validation = 0.2;
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_hamiltonian_run other = wanted;
        uint32_t wide[] = {4, 5};
        if (i == 5)
            assert_ok(lg_hamiltonian_init(&other.model, LG_HAMILTONIAN_CHAIN, 2, LG_POTENTIAL_MLP, wide, 2,
                                          LG_TANH));
        assert_status(lg_hamiltonian_run_compare("a.h5", &cases[i].run, &other, &error), LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, "a.h5"));
        if (strstr(error.message, cases[i].word) == NULL)
            fail_msg("no '%s' in: %s", cases[i].word, error.message);
    }
}

/* A failing array call sticks to the writer, and no file comes of it. */
static void failures_stick(void **state) {
    (void)state;
    lg_file_writer *writer;
    lg_archive_writer archive;
    const char *path = scratch_path("sticky.h5");
    const double one = 1;
    assert_ok(lg_file_writer_create(NULL, path, "test", NULL, &writer, NULL));
    assert_ok(lg_file_writer_archive(writer, "", &archive));
    assert_ok(archive.array(archive.user, "a/b", LG_ELEMENT_F64, 0, NULL, &one));
    assert_status(archive.array(archive.user, "", LG_ELEMENT_F64, 0, NULL, &one), LG_INVALID_ARGUMENT);
    assert_status(archive.array(archive.user, "c", LG_ELEMENT_F64, 0, NULL, &one), LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_commit(writer, NULL), LG_INVALID_ARGUMENT);
    lg_file_writer_destroy(writer);
    assert_int_not_equal(access(path, F_OK), 0);
    assert_status(lg_file_writer_archive(NULL, "", &archive), LG_INVALID_ARGUMENT);
}

/* ---- memory ---- */

static lg_status load_step(const lg_context *context, void *user, lg_error *error) {
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe = false;
    return read_model(context, user, &options, error);
}

static lg_status save_step(const lg_context *context, void *user, lg_error *error) {
    lg_hamiltonian_file file;
    make_model(&examples[2], &file);
    lg_status status = lg_model_save_hamiltonian(context, user, &file, NULL, error);
    lg_hamiltonian_file_free(NULL, &file);
    return status;
}

static lg_status open_step(const lg_context *context, void *user, lg_error *error) {
    lg_hamiltonian_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe = false;
    LG_TRY(lg_checkpoint_open(context, user, &options, &run, &reader, error));
    lg_status status = lg_file_reader_archive(reader, "fit", &archive);
    lg_file_reader_close(reader);
    return status;
}

static lg_status checkpoint_step(const lg_context *context, void *user, lg_error *error) {
    lg_hamiltonian_run run = make_run(&examples[0]);
    return write_checkpoint(context, user, &run, NULL, error);
}

static void failing_allocations(void **state) {
    (void)state;
    const char *model = good_model(0), *checkpoint = good_checkpoint();
    size_t files = scratch_files();
    assert_true(fail_every_allocation(load_step, (void *)model) >= 9);
    assert_true(fail_every_allocation(save_step, (void *)model) >= 8);
    assert_true(fail_every_allocation(open_step, (void *)checkpoint) >= 4);
    assert_true(fail_every_allocation(checkpoint_step, (void *)checkpoint) >= 6);
    assert_int_equal(scratch_files(), files);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(model_round_trip),    cmocka_unit_test(layers_by_name),
        cmocka_unit_test(minimal_model),       cmocka_unit_test(damaged_models),
        cmocka_unit_test(bad_arrays),          cmocka_unit_test(bad_model_attributes),
        cmocka_unit_test(refused_on_save),     cmocka_unit_test(model_with_fit),
        cmocka_unit_test(checkpoint_resumes),  cmocka_unit_test(checkpoint_with_nan),
        cmocka_unit_test(damaged_checkpoints), cmocka_unit_test(another_problem),
        cmocka_unit_test(failures_stick),      cmocka_unit_test(without_schedule),
        cmocka_unit_test(failing_allocations),
    };
    return cmocka_run_group_tests(tests, scratch_begin, scratch_end);
}
