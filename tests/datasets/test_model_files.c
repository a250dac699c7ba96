/* Models and checkpoints: round trip, the matrix of bad input. */
#define MODEL_KIND   hamiltonian
#define MODEL_BAD    0
#define MODEL_SINGLE 2
#include "model_file_checks.h"
#include "models/hamiltonian_internal.h"

static const uint32_t hidden[] = {4, 3};

typedef struct example {
    const lg_hamiltonian_family *family;
    uint32_t links;
    lg_potential_kind potential;
    lg_dtype dtype;
} example;

static const example examples[] = {
    {&lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, LG_F64},
    {&lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, LG_F32},
    {&lg_hamiltonian_separable, 2, LG_POTENTIAL_MLP, LG_F32},
    {&lg_hamiltonian_separable, 3, LG_POTENTIAL_LINEAR, LG_F64},
};

static lg_hamiltonian_run make_run(size_t which) {
    const example *e = &examples[which];
    lg_hamiltonian_run run = {.scheme = lg_scheme_find(e->family->scheme),
                              .substeps = 2,
                              .penalty = 0.125,
                              .penalty_form = LG_PENALTY_SUM_ABSOLUTE,
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
    assert_ok(lg_hamiltonian_init(&run.model, e->family, e->links, e->potential, hidden, 2, LG_TANH));
    return run;
}

static void make_model(size_t which, lg_hamiltonian_file *file) {
    const example *e = &examples[which];
    lg_rng rng;
    lg_rng_seed(&rng, 3, 4);
    *file = (lg_hamiltonian_file){.run = make_run(which),
                                  .adam_step = 700,
                                  .has_rng = true,
                                  .rng = rng,
                                  .epochs_done = 6,
                                  .has_e1 = true,
                                  .e1 = 1.7e-7};
    size_t n = file->parameters = lg_hamiltonian_parameters(&file->run.model);
    file->theta = numbers(n, &rng, e->dtype);
    file->adam_m = numbers(n, &rng, LG_F64);
    file->adam_v = numbers(n, &rng, LG_F64);
    for (size_t i = 0; i < n; i++) file->adam_v[i] = fabs(file->adam_v[i]);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) file->history[i] = numbers(6, &rng, LG_F64);
    for (int i = 0; i < 6; i++) file->history[LG_FIT_VALIDATION][i] = NAN;
    (void)snprintf(file->provenance.cpu, sizeof file->provenance.cpu, "kernels baseline");
}

TEST("a model comes back as it was saved") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_hamiltonian_file file, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        make_model(e, &file);
        assert_ok(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL));
        assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &again, NULL));
        assert_ok(lg_run_compare(&lg_run_hamiltonian, &again.run, &file.run, path, NULL));
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
        lg_hamiltonian_file_destroy(&file);
        lg_hamiltonian_file_destroy(&again);
    }
}

/* Weights lie where the flat vector says: (in, out) row-major, bias, ..., then the kinetic part. */
TEST("every layer is an array below its name") {
    lg_hamiltonian_file file;
    lg_h5 *h5;
    const char *path = good_model(0);
    double weight[6 * 4], bias[4], last[3], gamma_[4], b[2];
    make_model(0, &file);
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
    lg_hamiltonian_file_destroy(&file);
}

TEST("a model written by hand may leave out what is not needed") {
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
    /* What is not known is out of no range. */
    assert_ok(lg_model_save_hamiltonian(NULL, scratch_path("again.h5"), &file, NULL, NULL));
    lg_hamiltonian_file_destroy(&file);
}

TEST("a damaged model is refused") {
    refuse_damaged_files(read_model, good_model(0), "");
    survive_changed_bytes(read_model, good_model(0), 300);
}

TEST("an array of the wrong shape or value is refused by name") {
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
    refuse_arrays(read_model, fresh_model, true, cases, LG_COUNT(cases));
    static const char *const needed[] = {"model",
                                         "model/potential/layer2/weight",
                                         "model/potential/layer2/bias",
                                         "model/mass/gamma",
                                         "model/mass/b",
                                         "optimizer/adam/v"};
    refuse_without_links(read_model, fresh_model, "", needed, LG_COUNT(needed));
    const char *path = good_model(0);
    delete_link(path, "model/potential");
    assert_refused(read_model, path, LG_FORMAT, "layer1", "");
}

TEST("an attribute of the wrong type or value is refused by name") {
    static const bad_value cases[] = {
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
        {"model", "hidden", "4,,3", "separated by commas"},
        {"model", "hidden", "4,-3", "separated by commas"},
        {"model", "hidden", "4,3,", "separated by commas"},
        {"model", "hidden", "4,0", "at least 1"},
        {"model", "hidden", "4,99999999999", "at most 1048576"},
        {"model", "hidden", "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1", "at most 15"},
        {"run", "dtype", "f16", "known name"},
        {"run", "integrator", "magic", "known name"},
        {"run", "lr", "fast", "number"},
    };
    refuse_texts(read_model, fresh_model, cases, LG_COUNT(cases));
    const char *wide = good_model(0);
    replace_text(wide, "model", "hidden", "4,4");
    assert_refused(read_model, wide, LG_FORMAT, "layer2", "");
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
    refuse_nans(read_model, fresh_model, "finite", reals, LG_COUNT(reals));
}

TEST("a model that could not be read is not saved") {
    lg_hamiltonian_file file;
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    make_model(0, &file);
    file.theta[47] = NAN;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, &error), LG_NOT_FINITE);
    assert_non_null(strstr(error.message, "refused.h5: /model/mass/gamma"));
    assert_non_null(strstr(error.message, "(0, 1)"));
    file.theta[47] = 0;
    file.parameters--;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.parameters++;
    file.run.model.n = 77;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_INVALID_ARGUMENT);
    file.run = make_run(0);
    file.run.training.lr = NAN;
    assert_status(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL), LG_NOT_FINITE);
    file.run = make_run(0);
    assert_status(lg_model_save_hamiltonian(NULL, scratch_path("no/folder/model.h5"), &file, NULL, &error),
                  LG_FILE);
    assert_non_null(strstr(error.message, "no/folder/model.h5"));
    assert_int_not_equal(access(path, F_OK), 0);
    lg_hamiltonian_file_destroy(&file);
}

/* ---- recording errors ---- */

static void set_verdict(lg_hamiltonian_file *file) {
    file->has_e1 = file->has_e2 = true;
    file->e1 = 0.1, file->e2 = 3e-4;
    file->test = (lg_test_set){.trajectories = 100, .points = 15, .t_end = 1.5};
    (void)snprintf(file->test.sha256, sizeof file->test.sha256, "%064d", 7);
}

static void assert_verdict(const char *path, const lg_hamiltonian_file *want) {
    lg_hamiltonian_file got;
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &got, NULL));
    assert_true(got.has_e1 == want->has_e1 && got.has_e2 == want->has_e2);
    assert_close(got.e1, want->e1, 0, 0);
    if (want->has_e2) assert_close(got.e2, want->e2, 0, 0);
    assert_true(got.test.trajectories == want->test.trajectories && got.test.points == want->test.points);
    assert_close(got.test.t_end, want->test.t_end, 0, 0);
    assert_string_equal(got.test.sha256, want->test.sha256);
    lg_hamiltonian_file_destroy(&got);
}

/* What the errors do not touch: a model with the state of its fit, and an attribute of somebody else. */
TEST("recorded errors leave all else in the file as it was") {
    lg_hamiltonian_file file, again;
    lg_h5 *h5;
    char note[16];
    double best[52], moment[52];
    const uint64_t count = 52;
    load_fitted(&file);
    const char *path = scratch_path("fitted.h5"), *once = scratch_path("once.h5");
    replace_text(path, "model/mass", "note", "weighed");
    set_verdict(&file);
    assert_ok(lg_model_record_hamiltonian(NULL, path, &file, NULL));
    assert_verdict(path, &file);
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &again, NULL));
    assert_ok(lg_run_compare(&lg_run_hamiltonian, &again.run, &file.run, path, NULL));
    assert_memory_equal(again.theta, file.theta, sizeof best);
    assert_memory_equal(again.adam_m, file.adam_m, sizeof best);
    assert_memory_equal(again.adam_v, file.adam_v, sizeof best);
    assert_true(again.adam_step == file.adam_step && again.has_rng && again.epochs_done == 3);
    assert_memory_equal(&again.rng, &file.rng, sizeof file.rng);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
        assert_memory_equal(again.history[i], file.history[i], 3 * sizeof(double));
    assert_string_equal(again.provenance.cpu, "kernels baseline");
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    assert_ok(lg_h5_get(h5, "optimizer/best", LG_ELEMENT_F64, 1, &count, best, NULL));
    assert_ok(lg_h5_get(h5, "optimizer/adam/m", LG_ELEMENT_F64, 1, &count, moment, NULL));
    assert_true(lg_h5_has(h5, "train/permutation") && lg_h5_has(h5, "train/options/batch"));
    assert_ok(lg_h5_text(h5, "model/mass", "note", note, sizeof note, NULL));
    assert_string_equal(note, "weighed");
    lg_h5_close(h5);
    assert_memory_equal(moment, file.adam_m, sizeof moment);
    copy_file(path, once);
    assert_ok(lg_model_record_hamiltonian(NULL, path, &again, NULL));
    assert_same_bytes(path, once);
    lg_hamiltonian_file_destroy(&file);
    lg_hamiltonian_file_destroy(&again);
}

/* What another test set said goes, also where this one says nothing; weights of floats are found again. */
TEST("recorded errors replace those of another test set") {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        lg_hamiltonian_file file;
        const char *path = good_model(e);
        make_model(e, &file);
        if (examples[e].dtype == LG_F32) file.theta[0] = nextafter(file.theta[0], 2);
        set_verdict(&file);
        assert_ok(lg_model_record_hamiltonian(NULL, path, &file, NULL));
        file.has_e2 = false;
        file.e1 = 0.25;
        file.test = (lg_test_set){.trajectories = 3};
        assert_ok(lg_model_record_hamiltonian(NULL, path, &file, NULL));
        assert_verdict(path, &file);
        lg_hamiltonian_file_destroy(&file);
    }
}

static lg_status record_into(const lg_context *context, const char *path, const lg_read_options *options,
                             lg_error *error) {
    lg_hamiltonian_file file;
    (void)options;
    make_model(0, &file);
    set_verdict(&file);
    const lg_status status = lg_model_record_hamiltonian(context, path, &file, error);
    lg_hamiltonian_file_destroy(&file);
    return status;
}

static void assert_not_recorded(const lg_hamiltonian_file *file, lg_status status, const char *word) {
    const char *path = good_model(0), *before = scratch_path("before.h5");
    lg_error error = {LG_OK, ""};
    copy_file(path, before);
    assert_status(lg_model_record_hamiltonian(NULL, path, file, &error), status);
    if (strstr(error.message, word) == NULL) fail_msg("no '%s' in: %s", word, error.message);
    assert_same_bytes(path, before);
}

TEST("errors are recorded only into the model that they are of, and only when finite") {
    lg_hamiltonian_file file;
    make_model(0, &file);
    set_verdict(&file);
    file.theta[51] = nextafter(file.theta[51], 9);
    assert_not_recorded(&file, LG_INVALID_ARGUMENT, "other parameters");
    lg_hamiltonian_file_destroy(&file);
    make_model(0, &file);
    set_verdict(&file);
    file.run.training.seed = 5;
    assert_not_recorded(&file, LG_INVALID_ARGUMENT, "seed");
    file.run = make_run(1);
    assert_not_recorded(&file, LG_INVALID_ARGUMENT, "links");
    file.run = make_run(0);
    file.e1 = NAN;
    assert_not_recorded(&file, LG_NOT_FINITE, "E1");
    file.e1 = 0, file.e2 = INFINITY;
    assert_not_recorded(&file, LG_NOT_FINITE, "E2");
    file.e2 = 0;
    assert_status(lg_model_record_hamiltonian(NULL, NULL, &file, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_model_record_hamiltonian(NULL, "model.h5", NULL, NULL), LG_INVALID_ARGUMENT);
    lg_hamiltonian_file_destroy(&file);
    assert_refused(record_into, good_checkpoint(), LG_FORMAT, "checkpoint", "");
    refuse_damaged_files(record_into, good_model(0), "");
    survive_changed_bytes(record_into, good_model(0), 60);
}

/* A test set is for people: what is wrong with it does not make the model unreadable. */
TEST("what is wrong with a test set does not make the model unreadable") {
    static const char *const names[] = {"test_trajectories", "test_points", "test_t_end"};
    const double wrong[] = {-1, NAN, 2.5};
    lg_hamiltonian_file want = {.has_e1 = true, .e1 = 1.7e-7};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        const char *path = good_model(0);
        replace_text(path, "/", names[i], "many");
        assert_verdict(path, &want);
        replace_attribute(path, "/", names[i], H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &wrong[i == 2 ? 1 : 2]);
        assert_verdict(path, &want);
        replace_attribute(path, "/", names[i], H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &wrong[0]);
        assert_verdict(path, &want);
    }
    const char *path = good_model(0);
    char longer[80];
    (void)snprintf(longer, sizeof longer, "%070d", 3);
    replace_text(path, "/", "test_sha256", longer);
    assert_verdict(path, &want);
    replace_integer(path, "/", "test_sha256", 3);
    assert_verdict(path, &want);
    replace_text(path, "/", "test_sha256", "abc");
    (void)snprintf(want.test.sha256, sizeof want.test.sha256, "abc");
    assert_verdict(path, &want);
}

TEST("a model comes back with the state of its fit") {
    lg_hamiltonian_file again;
    load_fitted(&again);
    assert_int_equal(again.adam_step, 9);
    lg_hamiltonian_file_destroy(&again);
}

/* ---- checkpoints ---- */

/* Files of before there were schedules have no key for it: then it is steps. Every other row is there. */
TEST("a file without a schedule has steps") {
    lg_hamiltonian_run run, wanted = make_run(0);
    lg_file_reader *reader;
    lg_hamiltonian_file file;
    const char *path = good_checkpoint();
    delete_attribute(path, "run", "schedule");
    assert_ok(lg_checkpoint_open(NULL, path, NULL, &lg_run_hamiltonian, &run, &reader, NULL));
    lg_file_reader_destroy(reader);
    wanted.training.schedule = LG_SCHEDULE_STEP;
    assert_ok(lg_run_compare(&lg_run_hamiltonian, &run, &wanted, path, NULL));
    path = good_model(0);
    delete_attribute(path, "run", "schedule");
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, &file, NULL));
    assert_ok(lg_run_compare(&lg_run_hamiltonian, &file.run, &wanted, path, NULL));
    lg_hamiltonian_file_destroy(&file);
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

static void look_into_archive(const lg_hamiltonian_run *run, lg_file_reader *reader,
                              const lg_archive_reader *archive) {
    char note[16];
    (void)run;
    assert_ok(archive->text(archive->user, "note/author", note, sizeof note));
    assert_string_equal(note, "nobody");
    assert_status(archive->text(archive->user, "note/author", note, 3), LG_SHAPE);
    assert_status(archive->text(archive->user, "note/nothing", note, sizeof note), LG_NOT_FOUND);
    double value;
    assert_status(archive->array(archive->user, "nothing", LG_ELEMENT_F64, 0, NULL, &value), LG_NOT_FOUND);
    assert_non_null(strstr(lg_file_reader_message(reader), "check.h5: has no /fit/nothing"));
    assert_status(archive->array(archive->user, "optimizer/adam/m", LG_ELEMENT_F64, 0, NULL, &value),
                  LG_SHAPE);
    uint32_t rank;
    uint64_t dims[4];
    assert_ok(archive->shape(archive->user, "optimizer/adam/m", &rank, dims));
    assert_true(rank == 1 && dims[0] == 3);
}

TEST("a fit resumed from its checkpoint ends in the same bits") {
    resume_checkpoint(look_into_archive);
}

TEST("a NaN in the saved state of the optimiser is found when the fit takes it") {
    const char *path = good_checkpoint();
    const double bad[3] = {0, NAN, 0};
    const hsize_t three = 3;
    replace_dataset(path, "fit/optimizer/adam/m", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &three, bad);
    lg_hamiltonian_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    double theta[3] = {1, 2, 3};
    lg_fit *fit = make_fit(theta, 3);
    assert_ok(lg_checkpoint_open(NULL, path, NULL, &lg_run_hamiltonian, &run, &reader, NULL));
    assert_ok(lg_file_reader_archive(reader, "fit", &archive));
    lg_status status = lg_fit_load(fit, &archive, NULL);
    assert_true(status == LG_FORMAT || status == LG_NOT_FINITE);
    lg_file_reader_destroy(reader);
    lg_fit_destroy(fit);
}

TEST("a damaged checkpoint is refused") {
    static const char *const needed[] = {"batch", "lr", "data_sha256", "integrator", "dtype", "seed", "dt"};
    refuse_damaged_checkpoints("hamiltonian", "checkpoint", 300, needed, LG_COUNT(needed));
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
}

TEST("a checkpoint of another run is refused, and the sentence names the difference") {
    const lg_hamiltonian_run wanted = make_run(0);
    lg_hamiltonian_run runs[10];
    static const char *const words[] = {"batch 81, not 80",
                                        "lr 0.02",
                                        "integrator rk4, not cf4",
                                        "seed 3",
                                        "data_sha256",
                                        "hidden 4,5, not 4,3",
                                        "dtype f32, not f64",
                                        "dt 0.0",
                                        "schedule step, not cosine",
                                        "validation 0.2"};
    for (size_t i = 0; i < LG_COUNT(runs); i++) runs[i] = wanted;
    runs[0].training.batch = 81;
    runs[1].training.lr = 0.02;
    runs[2].scheme = lg_scheme_find("rk4");
    runs[3].training.seed = 3;
    runs[4].data_sha256[0] = 'f';
    assert_ok(lg_hamiltonian_init(&runs[5].model, &lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP,
                                  (const uint32_t[]){4, 5}, 2, LG_TANH));
    runs[6].training.dtype = LG_F32;
    runs[7].dt = nextafter(wanted.dt, 1);
    runs[8].training.schedule = LG_SCHEDULE_STEP;
    runs[9].training.validation = 0.2;
    refuse_other_runs(&wanted, runs, words, LG_COUNT(runs));
}

TEST("a failing array call sticks to the writer, and no file comes of it") {
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

TEST("every allocation may fail, and nothing leaks") {
    fail_model_allocations(9, 8);
}
