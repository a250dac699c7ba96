/* Model files and checkpoints of every kind: written and read back, resumed fits, tables of damages. Errors
 * recorded into Hamiltonians.
 * ctest-labels: slow src/model src/files */
#include "model/model_kinds.h"

#include "files/h5.h"
#include "model/files/program_file.h"
#include "liegrad/ops.h"

#define EACH_KIND(k) (const kind_row *k = kinds; k < kinds + KIND_COUNT; k++)

static model_kind number_of(const kind_row *k) {
    return (model_kind)(k - kinds);
}

static void assert_same_file(const kind_row *k, any_file *a, any_file *b) {
    const common have = common_of(a), want = common_of(b);
    assert_ok(lg_recipe_compare_runs(k->recipe, have.run, want.run, "a.h5", NULL));
    assert_int_equal(have.parameters, want.parameters);
    assert_memory_equal(have.theta, want.theta, want.parameters * sizeof(double));
    assert_int_equal(have.epochs_done, want.epochs_done);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
        assert_memory_equal(have.history[i], want.history[i], want.epochs_done * sizeof(double));
    assert_string_equal(have.provenance->command, want.provenance->command);
    assert_string_equal(have.provenance->liegrad_version, lg_version());
    k->same(a, b);
}

TEST("a model is read back as it was saved, and may be freed twice") {
    for
        EACH_KIND(k)
    for (size_t e = 0; e < examples_of(k); e++) {
        any_file file, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        k->make(e, &file);
        assert_ok(save(NULL, path, &file, NULL, NULL));
        assert_ok(load(NULL, path, NULL, number_of(k), &again, NULL));
        assert_same_file(k, &again, &file);
        assert_ok(save(NULL, second, &again, NULL, NULL));
        assert_same_bytes(path, second);
        destroy(&file);
        destroy(&again);
        destroy(&again);
    }
}

/* ---- where weights are stored ---- */

static void assert_stored(lg_h5 *h5, const lg_slice_info *slice, const double *theta, lg_dtype dtype) {
    double values[512];
    lg_h5_about about;
    const char *name = test_text("model/%s", slice->name);
    assert_true(slice->count <= LG_COUNT(values));
    assert_ok(lg_h5_get(h5, name, LG_ELEMENT_F64, slice->rank, slice->dims, values, NULL));
    assert_memory_equal(values, theta + slice->offset, slice->count * sizeof(double));
    assert_ok(lg_h5_look(h5, name, sizeof(double), &about, NULL));
    assert_true(dtype == LG_F32 ? about.epsilon > 1e-8 : about.epsilon < 1e-15);
}

/* For a chain of two links the vector is: weight (in, out) row-major, bias, ..., then the kinetic part. */
static bool slice_of(const any_file *file, uint32_t i, lg_slice_info *slice) {
    static const lg_slice_info of_chain[] = {
        {.name = "potential/layer1/weight", .rank = 2, .dims = {6, 4}, .offset = 0, .count = 24},
        {.name = "potential/layer1/bias", .rank = 1, .dims = {4}, .offset = 24, .count = 4},
        {.name = "potential/layer2/weight", .rank = 2, .dims = {4, 3}, .offset = 28, .count = 12},
        {.name = "potential/layer2/bias", .rank = 1, .dims = {3}, .offset = 40, .count = 3},
        {.name = "potential/layer3/weight", .rank = 2, .dims = {3, 1}, .offset = 43, .count = 3},
        {.name = "mass/gamma", .rank = 2, .dims = {2, 2}, .offset = 46, .count = 4},
        {.name = "mass/b", .rank = 1, .dims = {2}, .offset = 50, .count = 2}};
    const lg_recipe *recipe = kinds[file->kind].recipe;
    if (file->kind != KIND_HAMILTONIAN) return recipe->slice(file->bytes + recipe->file_run, i, slice);
    if (i < LG_COUNT(of_chain)) *slice = of_chain[i];
    return i < LG_COUNT(of_chain);
}

TEST("every slice of the vector is stored under its name, in the type of the training") {
    for
        EACH_KIND(k)
    for (size_t e = 0; e < (number_of(k) == KIND_HAMILTONIAN ? 1 : k->examples); e++) {
        any_file file;
        lg_slice_info slice;
        lg_h5 *h5;
        size_t total = 0;
        k->make(e, &file);
        const common c = common_of(&file);
        assert_ok(lg_h5_open(NULL, good_model(number_of(k), e), NULL, &h5, NULL));
        for (uint32_t i = 0; slice_of(&file, i, &slice); i++) {
            assert_stored(h5, &slice, c.theta, c.training->dtype);
            total += slice.count;
        }
        assert_int_equal(total, c.parameters);
        assert_false(lg_h5_has(h5, "model/potential/layer3/bias"));
        lg_h5_close(h5);
        destroy(&file);
    }
}

/* ---- parts that may be left out ---- */

/* Removes these links and attributes from a good model. Both lists end with NULL. */
static const char *stripped(model_kind kind, size_t which, const char *const *links,
                            const char *const *attributes) {
    const char *path = good_model(kind, which);
    for (; *links != NULL; links++) delete_link(path, *links);
    for (; *attributes != NULL; attributes++) delete_attribute(path, "/", *attributes);
    return path;
}

TEST("a Hamiltonian written by hand may leave out optional parts, and can be saved again") {
    static const char *const links[] = {"train", "run", NULL};
    static const char *const attributes[] = {"E1",          "seed",   "command", "cpu", "liegrad_version",
                                             "conventions", "format", NULL};
    lg_hamiltonian_file file;
    const char *path = stripped(KIND_HAMILTONIAN, 0, links, attributes);
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_hamiltonian, &file, NULL));
    assert_int_equal(file.run.substeps, 1);
    assert_int_equal(file.parameters, 52);
    /* An unknown number is not out of range. */
    assert_ok(lg_recipe_save(NULL, scratch_path("again.h5"), &lg_recipe_hamiltonian, &file, NULL, NULL));
    lg_recipe_release(&lg_recipe_hamiltonian, &file);
}

TEST("a surrogate written by hand may leave out optional parts") {
    static const char *const links[] = {"train", "run", "trained", NULL};
    static const char *const attributes[] = {"train_mse", "test_mse", "seed", "command",
                                             "cpu",       "format",   NULL};
    lg_surrogate_file file;
    const char *path = stripped(KIND_SURROGATE, 2, links, attributes);
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_surrogate, &file, NULL));
    assert_true(file.trained == NULL && file.trained_count == 0 && !file.has_errors && file.epochs_done == 0);
    assert_int_equal(file.run.model.options.kind, LG_SURROGATE_ANGLE);
    assert_true(file.run.model.options.boundary);
    lg_recipe_release(&lg_recipe_surrogate, &file);
}

TEST("a table network written by hand may leave out optional parts") {
    static const char *const links[] = {"train", "run", "names", "range", NULL};
    static const char *const attributes[] = {"rmse", "seed", "command", "cpu", "format", NULL};
    lg_table_file file;
    const char *path = stripped(KIND_TABLE, 0, links, attributes);
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_table, &file, NULL));
    assert_null(file.low);
    assert_true(isnan(file.rmse) && file.run.decay.count == 0);
    assert_string_equal(file.input_name[2], "x3");
    assert_string_equal(file.output_name[0], "y1");
    lg_recipe_release(&lg_recipe_table, &file);
}

static const char *fresh_first_table(void) {
    return good_model(KIND_TABLE, 0);
}

TEST("errors in a table network are refused by name") {
    static const damage rows[] = {
        {"model@task", TEXT("guessing"), LG_FORMAT, "task"},
        {"model@hidden", TEXT("4,5"), LG_FORMAT, "all must have the same width"},
        {"scaler/inputs/mean", GONE, LG_FORMAT, "scaler/inputs/mean"},
        {"scaler/outputs/scale", GONE, LG_FORMAT, "scaler/outputs/scale"},
        {"run@decay", TEXT("1,2"), LG_FORMAT, "decay"},
        {"@rmse", REAL(NAN), LG_NOT_FINITE, "rmse"},
    };
    refuse_damage(read_table, fresh_first_table, rows, LG_COUNT(rows));
}

TEST("a detector written by hand may leave out optional parts") {
    static const char *const links[] = {"train", "run", NULL};
    static const char *const attributes[] = {"classes",  "class_labels", "channels",       "rate",
                                             "accuracy", "f1",           "test_mse",       "seed",
                                             "command",  "format",       "format_version", NULL};
    lg_detector_file file, full;
    assert_ok(lg_recipe_load(NULL, good_model(KIND_DETECTOR, 1), NULL, &lg_recipe_detector, &full, NULL));
    const char *path = stripped(KIND_DETECTOR, 1, links, attributes);
    /* a pooling that is left out means `none` */
    replace_text(path, "model", "blocks", "  3 kernel 4 stride 3  padding 3 ");
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_detector, &file, NULL));
    assert_same_net(&file.run.model.net, &full.run.model.net);
    assert_memory_equal(file.theta, full.theta, full.parameters * sizeof(double));
    assert_string_equal(file.names.class_name[4], "4");
    assert_true(file.names.class_label == NULL && file.names.channel_name == NULL &&
                file.history[LG_FIT_LOSS] == NULL);
    assert_true(isnan(file.accuracy) && isnan(file.f1) && isnan(file.test_mse));
    assert_close(file.names.rate, 0, 0, 0);
    assert_int_equal(file.epochs_done, 0);
    lg_recipe_release(&lg_recipe_detector, &file);
    lg_recipe_release(&lg_recipe_detector, &full);
}

/* ---- damaged files ---- */

TEST("damaged models and checkpoints are refused") {
    for
        EACH_KIND(k) {
            const size_t changes = number_of(k) == KIND_HAMILTONIAN ? 300 : 100;
            refuse_damaged_files(k->read, k->fresh(), "");
            survive_changed_bytes(k->read, k->fresh(), changes);
        }
}

TEST("parts that every kind of file has are refused by name if missing or wrong") {
    static const damage rows[] = {
        {"@kind", GONE, LG_FORMAT, "missing"},
        {"@kind", TEXT("trajectories"), LG_FORMAT, "trajectories"},
        {"@format", TEXT("other"), LG_FORMAT, "other"},
        {"@format_version", TEXT("two"), LG_FORMAT, "integer"},
        {"@format_version", WHOLE(LG_FORMAT_VERSION + 1), LG_VERSION, ""},
        {"@format_version", WHOLE(1), LG_VERSION, "in format 2 only"},
        {"@format_version", WHOLE(0), LG_FORMAT, ""},
        {"model", GONE, LG_FORMAT, ""},
        {"train/history/rate", ARRAY(1, EPOCHS + 1), LG_FORMAT, "epoch"},
        {"train/history/loss", ARRAY(1, EPOCHS, 2), LG_FORMAT, "epoch"},
    };
    for
        EACH_KIND(k) refuse_damage(k->read, k->fresh, rows, LG_COUNT(rows));
}

/* An array of weights must be refused if it is missing, has another shape, or has a number that is not
 * finite. */
static void refuse_weights(const kind_row *k, fresh_fn fresh, const lg_slice_info *s) {
    const char *at = test_text("model/%s", s->name);
    change is = {.what = IS_ARRAY, .real = 1, .rank = (int)s->rank};
    for (uint32_t d = 0; d < s->rank; d++) is.dims[d] = s->dims[d];
    change longer = is, turned = is, deeper = is, flat = {.what = IS_ARRAY, .rank = 1, .dims = {s->count}};
    longer.dims[s->rank - 1]++;
    deeper.dims[deeper.rank++] = 1;
    for (uint32_t d = 0; d < s->rank; d++) turned.dims[d] = s->dims[s->rank - 1 - d];
    change bad = is, endless = is;
    bad.real = NAN, endless.real = -INFINITY;
    const damage rows[] = {{at, GONE, LG_FORMAT, ""},          {at, longer, LG_FORMAT, "shape"},
                           {at, deeper, LG_FORMAT, "shape"},   {at, bad, LG_NOT_FINITE, "(0"},
                           {at, endless, LG_NOT_FINITE, "(0"}, {at, flat, LG_FORMAT, "shape"},
                           {at, turned, LG_FORMAT, "shape"}};
    const bool square = memcmp(turned.dims, is.dims, sizeof is.dims) == 0;
    refuse_damage(k->read, fresh, rows, s->rank == 1 ? 5 : square ? 6 : 7);
}

TEST("for every kind, weights that are missing, of another shape or not finite are refused by name") {
    for
        EACH_KIND(k) {
            const any_run run = k->make_run(k->bad);
            lg_slice_info s;
            for (uint32_t i = 0; k->recipe->slice(&run, i, &s); i++) refuse_weights(k, k->fresh, &s);
        }
}

TEST("errors in a Hamiltonian are refused by name") {
    static const damage rows[] = {
        {"model/potential", GONE, LG_FORMAT, "~layer1"},
        /* accepted by lg_hamiltonian_init, but does not fit the arrays */
        {"model@links", WHOLE(3), LG_FORMAT, "~layer1"},
        {"model@links", WHOLE(0), LG_FORMAT, ""},
        {"model@links", WHOLE(1 << 20), LG_FORMAT, ""},
        {"model@links", WHOLE(5000000000), LG_FORMAT, ""},
        {"model@hidden", TEXT("4,,3"), LG_FORMAT, "separated by commas"},
        {"model@hidden", TEXT("4,-3"), LG_FORMAT, "separated by commas"},
        {"model@hidden", TEXT("4,3,"), LG_FORMAT, "separated by commas"},
        {"model@hidden", TEXT("4,0"), LG_FORMAT, "at least 1"},
        {"model@hidden", TEXT("4,99999999999"), LG_FORMAT, "at most 1048576"},
        {"model@hidden", TEXT("1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1"), LG_FORMAT, "at most 15"},
        {"model@hidden", TEXT("4,4"), LG_FORMAT, "~layer2"},
        {"model@space", TEXT("T*S^2"), LG_FORMAT, "T*S^2 x 2"},
        {"model@space", TEXT("T*S^2 x two"), LG_FORMAT, "found 'T*S^2 x two'"},
        {"model@space", WHOLE(2), LG_FORMAT, ""},
        {"model@scales", TEXT("1,1"), LG_FORMAT, "~at least 3 are needed"},
        {"model@scales", TEXT(""), LG_FORMAT, "~is empty"},
        {"model@scales", TEXT("0,1,1"), LG_FORMAT, "scales is out of range"},
        {"model@scales", TEXT("1,1,0"), LG_FORMAT, "scales is out of range"},
        {"model@scales", TEXT("1,2,1"), LG_FORMAT, "scales is out of range"}, /* q has no scale */
        {"run@substeps", WHOLE(0), LG_FORMAT, ""},
        {"@E1", REAL(NAN), LG_NOT_FINITE, "finite"},
    };
    refuse_damage(read_hamiltonian, fresh_hamiltonian, rows, LG_COUNT(rows));
    any_file separable;
    const char *path = scratch_path("separable.h5");
    kinds[KIND_HAMILTONIAN].make(2, &separable);
    assert_ok(save(NULL, path, &separable, NULL, NULL));
    destroy(&separable);
    replace_text(path, "model", "symmetry", "axial");
    assert_refused(read_hamiltonian, path, LG_FORMAT, "separable", "cannot have this symmetry");
}

TEST("errors in a surrogate are refused by name") {
    static const damage rows[] = {
        {"trained", ARRAY(1, 3, 7), LG_FORMAT, "(3, 7), expected (>= 1 curves, 8)"},
        {"trained", ARRAY(1, 24), LG_FORMAT, "(24), expected (>= 1 curves, 8)"},
        {"trained", ARRAY(1, 0, 8), LG_FORMAT, ""},
        {"trained", ARRAY(NAN, 3, 8), LG_NOT_FINITE, "(0, 0)"},
        {"@kind", TEXT("hamiltonian"), LG_FORMAT, "surrogate"},
        {"model@hidden", WHOLE(0), LG_FORMAT, "is out of range"},
        {"model@hidden", WHOLE(5), LG_FORMAT, "~shape"},
        {"model@hidden", WHOLE(1 << 20), LG_FORMAT, "~shape"},
        {"model@symmetric", WHOLE(1), LG_FORMAT, "~angle"},
        {"model@layers", WHOLE(99), LG_FORMAT, "is out of range"},
        {"model@intervals", WHOLE(1), LG_FORMAT, ""},
        {"model@intervals", WHOLE(4000000000), LG_FORMAT, ""},
        {"model@embedding", WHOLE(7), LG_FORMAT, ""},
        {"model@length", WHOLE(0), LG_FORMAT, ""},
        {"run@train_fraction", WHOLE(2), LG_FORMAT, ""},
        {"@train_mse", REAL(NAN), LG_NOT_FINITE, "finite"},
        {"@test_mse", REAL(NAN), LG_NOT_FINITE, "finite"},
    };
    refuse_damage(read_surrogate, fresh_surrogate, rows, LG_COUNT(rows));
}

static const char *fresh_modes(void) {
    return good_model(KIND_SURROGATE, 4);
}

TEST("errors in the modes of a surrogate are refused by name, and older files have no modes") {
    static const damage rows[] = {
        {"model/mean", ARRAY(1, 11), LG_FORMAT, "shape"},
        {"model/mean", ARRAY(1, 12, 1), LG_FORMAT, "shape"},
        {"model/mean", ARRAY(NAN, 12), LG_NOT_FINITE, "(0)"},
        {"model/mean", GONE, LG_FORMAT, ""},
        {"model/modes", ARRAY(1, 2, 12), LG_FORMAT, "shape"},
        {"model/modes", ARRAY(1, 36), LG_FORMAT, "shape"},
        {"model/modes", ARRAY(INFINITY, 3, 12), LG_NOT_FINITE, "(0, 0)"},
        {"model/modes", GONE, LG_FORMAT, ""},
        {"model@modes", WHOLE(2), LG_FORMAT, "~output/weight"},
        {"model@modes", WHOLE(13), LG_FORMAT, "13 modes"},
    };
    refuse_damage(read_surrogate, fresh_modes, rows, LG_COUNT(rows));
    lg_surrogate_file file;
    const char *path = good_model(KIND_SURROGATE, 0);
    delete_attribute(path, "model", "modes");
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_surrogate, &file, NULL));
    assert_true(file.run.model.options.modes == 0 && file.run.model.modes == NULL);
    lg_recipe_release(&lg_recipe_surrogate, &file);
}

TEST("errors in a detector are refused by name") {
    static const damage rows[] = {
        {"model/output/bias", ARRAY(0, 0), LG_FORMAT, "shape"},
        {"scaler/mean", ARRAY(0, 3), LG_FORMAT, "has shape (3), expected (2 channels as in /model)"},
        {"scaler/mean", ARRAY(0, 2, 2), LG_FORMAT, "has shape (2, 2)"},
        {"scaler/mean", ARRAY(NAN, 2), LG_NOT_FINITE, "(0)"},
        {"scaler/mean", GONE, LG_FORMAT, ""},
        {"scaler/scale", ARRAY(1, 1), LG_FORMAT, "(1), expected (2 channels"},
        {"scaler/scale", ARRAY(0, 2), LG_FORMAT, "is 0 at index (0)"},
        {"scaler/scale", ARRAY(-1, 2), LG_FORMAT, "is -1"},
        {"scaler/scale", ARRAY(INFINITY, 2), LG_NOT_FINITE, "(0)"},
        {"scaler/scale", GONE, LG_FORMAT, ""},
        {"@kind", TEXT("surrogate"), LG_FORMAT, "detector"},
        {"@classes", TEXT("a|b"), LG_FORMAT, "2 names, expected 5"},
        {"@class_labels", TEXT("1|2|3"), LG_FORMAT, "3 names, expected 5"},
        {"@classes", TEXT("a|b|c|d|a"), LG_FORMAT, "twice"},
        {"@classes", TEXT("a|b|c|d|"), LG_FORMAT, "empty"},
        {"@channels", TEXT("one"), LG_FORMAT, "1 names, expected 2"},
        {"@rate", TEXT("fast"), LG_FORMAT, "number"},
        {"@rate", REAL(NAN), LG_NOT_FINITE, ""},
        {"@accuracy", REAL(NAN), LG_NOT_FINITE, ""},
        {"@f1", REAL(NAN), LG_NOT_FINITE, ""},
        {"@test_mse", REAL(NAN), LG_NOT_FINITE, ""},
        {"model@blocks", GONE, LG_FORMAT, "missing"},
        {"model@channels", WHOLE(0), LG_FORMAT, ""},
        {"model@channels", WHOLE(3), LG_FORMAT, "~shape"},
        {"model@channels", WHOLE(1 << 20), LG_FORMAT, "~shape"},
        {"model@channels", WHOLE(1 << 21), LG_FORMAT, "~do not describe a possible network"},
        {"model@length", WHOLE(0), LG_FORMAT, ""},
        {"model@length", WHOLE(90), LG_FORMAT, "~shape"},
        {"model@length", WHOLE(4000000000), LG_FORMAT, "~sizes"},
        {"model@plane", WHOLE(1 << 20), LG_FORMAT, "plane/weight"},
        {"model@classes", WHOLE(1), LG_FORMAT, ""},
        {"model@classes", WHOLE(6), LG_FORMAT, "~shape"},
        {"model@classes", WHOLE(4000000000), LG_FORMAT, "~do not describe a possible network"},
        {"model@classes", WHOLE((int64_t)1 << 40), LG_FORMAT, ""},
        {"model@loss", TEXT("mse"), LG_FORMAT, "~2 classes"}, /* needs 2 classes, there are five */
        {"run@test_fraction", WHOLE(1), LG_FORMAT, "out of range"},
    };
    refuse_damage(read_detector, fresh_detector, rows, LG_COUNT(rows));
}

#define TEN "1,1,1,1,1,1,1,1,1,1,"

TEST("errors in a machine are refused by name") {
    static const damage rows[] = {
        {"model@machine", TEXT("coordinates: ["), LG_FORMAT, "~YAML"},
        {"model@machine", TEXT("coordinates: [{name: x, kind: line, velocity: v}]\nmass: none"), LG_FORMAT,
         "~needs a mass"},
        {"model@machine", TEXT("coordinates: [{name: x, kind: line, velocity: v}]\ndamping: diagonal"),
         LG_FORMAT, "~damping/diagonal"},
        {"model@scales", TEXT("1,2"), LG_FORMAT, "scales"},
        {"model@scales", TEXT(TEN TEN TEN TEN TEN TEN TEN TEN "1,1,1,1"), LG_FORMAT, "scales"},
        {"model@lag_range", TEXT("2,1"), LG_FORMAT, "lag_range"},
        {"model@lag_range", TEXT("0,1"), LG_FORMAT, "lag_range"},
        {"model@lag_range", TEXT("1"), LG_FORMAT, "~at least 2 are needed"},
        {"run@range", TEXT("1,2"), LG_FORMAT, "~too short"},
        {"run@velocity_scale", TEXT("1"), LG_FORMAT, "~too short"},
        {"model@space", TEXT("R^2"), LG_FORMAT, "SO(3)"},
        {"spread", ARRAY(1, 2, 2), LG_FORMAT, "(2, 2), expected ("},
        {"spread", ARRAY(1, 4), LG_FORMAT, "(4), expected ("},
    };
    refuse_damage(read_machine_model, fresh_machine_model, rows, LG_COUNT(rows));
}

/* ---- models that are not saved ---- */

/* After each change saving must fail, and the file must stay unchanged. */
#define REFUSED(k, file, expected, ...)                                                                      \
    do {                                                                                                     \
        const any_file before = file;                                                                        \
        lg_error error = {LG_OK, ""};                                                                        \
        __VA_ARGS__;                                                                                         \
        assert_status(save(NULL, scratch_path("refused.h5"), &file, NULL, &error), expected);                \
        if (strstr(error.message, "refused.h5") == NULL) fail_msg("%s", error.message);                      \
        file = before;                                                                                       \
    } while (0)

TEST("a model that could not be read back is not saved") {
    any_file h, s, d, t, m;
    kinds[KIND_MACHINE_MODEL].make(0, &m);
    kinds[KIND_TABLE].make(0, &t);
    kinds[KIND_HAMILTONIAN].make(0, &h);
    kinds[KIND_SURROGATE].make(1, &s);
    kinds[KIND_DETECTOR].make(1, &d);
    const struct {
        double *at, bad;
        model_kind kind;
        any_file *file;
        lg_status status;
        const char *word;
    } numbers_in_arrays[] = {
        {&h.hamiltonian.theta[47], NAN, KIND_HAMILTONIAN, &h, LG_NOT_FINITE,
         "/model/mass/gamma: NaN at index (0, 1)"},
        {&s.surrogate.theta[3], NAN, KIND_SURROGATE, &s, LG_NOT_FINITE, "/model/embedding/weight"},
        {&s.surrogate.trained[9], INFINITY, KIND_SURROGATE, &s, LG_NOT_FINITE, "/trained"},
        {&d.detector.theta[3], NAN, KIND_DETECTOR, &d, LG_NOT_FINITE, "/model/conv1/weight"},
        {&d.detector.scaler.scale[1], 0, KIND_DETECTOR, &d, LG_INVALID_ARGUMENT, ""},
        {&d.detector.scaler.scale[1], INFINITY, KIND_DETECTOR, &d, LG_NOT_FINITE, ""},
        {&t.table.theta[2], NAN, KIND_TABLE, &t, LG_NOT_FINITE, "/model/layer1/weight"},
        {&t.table.inputs.scale[1], 0, KIND_TABLE, &t, LG_INVALID_ARGUMENT, "/scaler/inputs/scale"},
        {&t.table.outputs.mean[1], NAN, KIND_TABLE, &t, LG_NOT_FINITE, "/scaler/outputs/mean"},
        {&t.table.low[2], INFINITY, KIND_TABLE, &t, LG_NOT_FINITE, "/range/low"},
        {&t.table.rmse, INFINITY, KIND_TABLE, &t, LG_NOT_FINITE, "rmse"},
        {&m.machine_model.theta[4], NAN, KIND_MACHINE_MODEL, &m, LG_NOT_FINITE, "/model/mass/layer1/weight"},
        {&m.machine_model.run.dt, NAN, KIND_MACHINE_MODEL, &m, LG_NOT_FINITE, "dt"}};
    for (size_t i = 0; i < LG_COUNT(numbers_in_arrays); i++) {
        const double kept = *numbers_in_arrays[i].at;
        *numbers_in_arrays[i].at = numbers_in_arrays[i].bad;
        lg_error error = {LG_OK, ""};
        assert_status(save(NULL, scratch_path("refused.h5"), numbers_in_arrays[i].file, NULL, &error),
                      numbers_in_arrays[i].status);
        if (strstr(error.message, numbers_in_arrays[i].word) == NULL) fail_msg("%s", error.message);
        *numbers_in_arrays[i].at = kept;
    }
    lg_hamiltonian_file *hf = &h.hamiltonian;
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->parameters--);
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->run.model.n = 77);
    REFUSED(KIND_HAMILTONIAN, h, LG_NOT_FINITE, hf->run.training.lr = NAN);
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->run.model.net.layers = 0);
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->run.model.net.layers = LG_MLP_MAX_LAYERS + 1);
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->run.model.net.width[0]++);
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->run.model.scales.time = 0.0);
    REFUSED(KIND_HAMILTONIAN, h, LG_INVALID_ARGUMENT, hf->run.model.scales.part[0] = 2.0);
    lg_surrogate_file *sf = &s.surrogate;
    REFUSED(KIND_SURROGATE, s, LG_INVALID_ARGUMENT, sf->parameters++);
    REFUSED(KIND_SURROGATE, s, LG_NOT_FINITE, sf->train_mse = NAN);
    REFUSED(KIND_SURROGATE, s, LG_INVALID_ARGUMENT, sf->run.model.net.activation = LG_TANH);
    REFUSED(KIND_SURROGATE, s, LG_INVALID_ARGUMENT, sf->run.model.net.hidden++);
    REFUSED(KIND_SURROGATE, s, LG_INVALID_ARGUMENT, sf->run.train_fraction = 1.5);
    REFUSED(KIND_SURROGATE, s, LG_INVALID_ARGUMENT,
            sf->run.training.schedule = (lg_schedule_kind)LG_SCHEDULE_COUNT);
    destroy(&s);
    kinds[KIND_SURROGATE].make(4, &s);
    REFUSED(KIND_SURROGATE, s, LG_INVALID_ARGUMENT, sf->run.model.modes = NULL);
    double *mode = (double *)(uintptr_t)(sf->run.model.modes + 20);
    *mode = NAN;
    REFUSED(KIND_SURROGATE, s, LG_NOT_FINITE, (void)sf);
    lg_detector_file *df = &d.detector;
    lg_detector *model = &df->run.model;
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->parameters++);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, model->net.lengths[1] = 7);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, model->net.blocks = 99);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, model->net.block[0].kernel = 0);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT,
            model->net.block[0].pooling = (lg_pooling)LG_POOLING_COUNT);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, model->net.outputs = 4);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, model->loss = LG_DETECTOR_MSE);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, model->loss = (lg_detector_loss)LG_DETECTOR_LOSS_COUNT);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->run.split = (lg_split)LG_SPLIT_COUNT);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->run.test_fraction = 0.95);
    REFUSED(KIND_DETECTOR, d, LG_NOT_FINITE, df->run.test_fraction = NAN);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->scaler.channels = 1);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->scaler.mean = NULL);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->names.class_name = NULL);
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, df->names.rate = -1);
    REFUSED(KIND_DETECTOR, d, LG_NOT_FINITE, df->names.rate = INFINITY);
    REFUSED(KIND_DETECTOR, d, LG_NOT_FINITE, df->accuracy = INFINITY);
    (void)snprintf(df->names.class_name[1], LG_SERIES_NAME, "state 4");
    REFUSED(KIND_DETECTOR, d, LG_INVALID_ARGUMENT, (void)0);
    lg_table_file *tf = &t.table;
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->parameters++);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->run.model.net.inputs = 7);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->run.model.options.hidden[1] = 7);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->run.decay.count--);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->outputs.channels = 1);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->outputs.mean = NULL);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->inputs.scale = NULL);
    REFUSED(KIND_TABLE, t, LG_INVALID_ARGUMENT, tf->run.model.net.activation = LG_SIGMOID);
    lg_machine_model_file *mf = &m.machine_model;
    REFUSED(KIND_MACHINE_MODEL, m, LG_INVALID_ARGUMENT, mf->parameters--);
    REFUSED(KIND_MACHINE_MODEL, m, LG_INVALID_ARGUMENT, mf->run.machine.terms[0].hidden[0] = 7);
    any_file *const files[] = {&h, &s, &d, &t, &m};
    for
        EACH_KIND(k) {
            any_file *file = files[number_of(k)];
            assert_status(save(NULL, NULL, file, NULL, NULL), LG_INVALID_ARGUMENT);
            destroy(file);
            assert_status(save(NULL, scratch_path("refused.h5"), file, NULL, NULL), LG_INVALID_ARGUMENT);
        }
    lg_error error;
    kinds[KIND_HAMILTONIAN].make(0, &h);
    assert_status(save(NULL, scratch_path("no/folder/model.h5"), &h, NULL, &error), LG_FILE);
    assert_non_null(strstr(error.message, "no/folder/model.h5"));
    destroy(&h);
    assert_int_not_equal(access(scratch_path("refused.h5"), F_OK), 0);
}

/* ---- number of arrays of weights in a file ---- */

static uint32_t arrays_of_weights;

/* One long array, and arrays of a single number. */
static bool many_slices(const void *run, uint32_t index, lg_slice_info *s) {
    const size_t long_one = lg_recipe_parameters(&lg_recipe_table, run) - (arrays_of_weights - 1);
    if (index >= arrays_of_weights) return false;
    *s = (lg_slice_info){.rank = 1, .count = index == 0 ? long_one : 1};
    s->dims[0] = s->count;
    s->offset = index == 0 ? 0 : long_one + index - 1;
    (void)snprintf(s->name, sizeof s->name, "array%u", index);
    return true;
}

TEST("a model with as many arrays of weights as a file may list is saved; with more it is refused") {
    const lg_table_options options = {.network = LG_NET_MLP, .hidden_count = 2, .hidden = {40, 40}};
    const char *path = scratch_path("many.h5");
    lg_recipe recipe = lg_recipe_table;
    any_file file;
    lg_error error;
    lg_rng rng = test_rng(11, 12);
    kinds[KIND_TABLE].make(0, &file);
    lg_table_file *table = &file.table;
    assert_ok(lg_table_init(&table->run.model, &options, 3, 2, NULL));
    free(table->theta);
    table->parameters = lg_table_parameters(&table->run.model);
    table->theta = drawn(table->parameters, &rng, LG_F32);
    table->run.decay.count = 0;
    recipe.slice = many_slices;
    arrays_of_weights = LG_PROGRAM_MOST_NAMES;
    assert_ok(lg_recipe_save(NULL, path, &recipe, table, NULL, NULL));
    lg_program *program;
    assert_ok(lg_program_load(NULL, path, NULL, &program, NULL));
    assert_memory_equal(lg_program_parameter(program, 0).values, table->theta,
                        table->parameters * sizeof(double));
    lg_program_destroy(program);
    arrays_of_weights++;
    assert_status(lg_recipe_save(NULL, path, &recipe, table, NULL, &error), LG_UNSUPPORTED);
    assert_says(error.message, "many.h5: the model has more than 1024 arrays of weights");
    destroy(&file);
}

/* ---- models with the state of a fit ---- */

static lg_status square_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                             size_t batch, lg_var *loss) {
    (void)user, (void)samples;
    *loss = lg_scale(tape, lg_sum(tape, lg_mul(tape, theta, theta)), (double)count / (double)batch);
    return lg_tape_status(tape);
}

RELEASES(release_fit, lg_fit_destroy)

/* A fit that runs three epochs at a time, five in all, with the training settings of the damaged example. */
static lg_fit *make_fit(const kind_row *k, const double *theta, size_t parameters) {
    const lg_fit_problem problem = {.parameters = parameters, .samples = 12, .loss = square_loss};
    any_file file;
    lg_fit_options options;
    lg_fit *fit;
    k->make(k->bad, &file);
    lg_fit_settings training = *common_of(&file).training;
    destroy(&file);
    lg_fit_options_init(&options);
    training.epochs = 5;
    training.batch = 5;
    lg_fit_settings_apply(&training, &options);
    options.stop_after = 3;
    assert_ok(lg_fit_create(NULL, &problem, &options, theta, &fit, NULL));
    lg_test_owns(fit, release_fit);
    return fit;
}

/* Saves the model with its fit after three epochs, and loads it. */
static any_file load_fitted(const kind_row *k) {
    any_file file, again;
    const char *path = scratch_path("fitted.h5");
    k->make(k->bad, &file);
    const common c = common_of(&file);
    lg_fit *fit = make_fit(k, c.theta, c.parameters);
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, c.theta);
    assert_ok(save(NULL, path, &file, fit, NULL));
    assert_ok(load(NULL, path, NULL, number_of(k), &again, NULL));
    const common got = common_of(&again);
    assert_memory_equal(got.theta, c.theta, c.parameters * sizeof(double));
    assert_int_equal(got.epochs_done, 3);
    assert_memory_equal(got.history[LG_FIT_LOSS], lg_fit_history(fit, LG_FIT_LOSS), 3 * sizeof(double));
    destroy(&file);
    return again;
}

TEST("a model is read back with the state of its fit") {
    for
        EACH_KIND(k) {
            any_file again = load_fitted(k);
            uint64_t step = 0;
            lg_h5 *h5;
            assert_ok(lg_h5_open(NULL, scratch_path("fitted.h5"), NULL, &h5, NULL));
            assert_ok(lg_h5_get(h5, "optimizer/adam/step", LG_ELEMENT_U64, 0, NULL, &step, NULL));
            assert_true(number_of(k) == KIND_HAMILTONIAN ? step == 9 : step > 0 && step % 3 == 0);
            lg_h5_close(h5);
            destroy(&again);
        }
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
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_hamiltonian, &got, NULL));
    assert_true(got.has_e1 == want->has_e1 && got.has_e2 == want->has_e2);
    assert_close(got.e1, want->e1, 0, 0);
    if (want->has_e2) assert_close(got.e2, want->e2, 0, 0);
    assert_true(got.test.trajectories == want->test.trajectories && got.test.points == want->test.points);
    assert_close(got.test.t_end, want->test.t_end, 0, 0);
    assert_string_equal(got.test.sha256, want->test.sha256);
    lg_recipe_release(&lg_recipe_hamiltonian, &got);
}

/* Errors must not change a model with the state of its fit, or an attribute that another program wrote. */
TEST("recording errors leaves everything else in the file unchanged") {
    const kind_row *k = &kinds[KIND_HAMILTONIAN];
    any_file file = load_fitted(k), again;
    lg_h5 *h5;
    char note[16];
    double best[52], moment[2][52];
    const uint64_t count = 52;
    const char *path = scratch_path("fitted.h5"), *once = scratch_path("once.h5");
    replace_text(path, "model/mass", "note", "weighed");
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    assert_ok(lg_h5_get(h5, "optimizer/adam/m", LG_ELEMENT_F64, 1, &count, moment[0], NULL));
    lg_h5_close(h5);
    set_verdict(&file.hamiltonian);
    assert_ok(lg_hamiltonian_save_errors(NULL, path, &file.hamiltonian, NULL));
    assert_verdict(path, &file.hamiltonian);
    assert_ok(load(NULL, path, NULL, number_of(k), &again, NULL));
    assert_same_file(k, &again, &file);
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    assert_ok(lg_h5_get(h5, "optimizer/best", LG_ELEMENT_F64, 1, &count, best, NULL));
    assert_ok(lg_h5_get(h5, "optimizer/adam/m", LG_ELEMENT_F64, 1, &count, moment[1], NULL));
    assert_true(lg_h5_has(h5, "train/permutation") && lg_h5_has(h5, "train/options/batch"));
    assert_ok(lg_h5_text(h5, "model/mass", "note", note, sizeof note, NULL));
    assert_string_equal(note, "weighed");
    lg_h5_close(h5);
    assert_memory_equal(moment[0], moment[1], sizeof moment[0]);
    copy_file(path, once);
    assert_ok(lg_hamiltonian_save_errors(NULL, path, &again.hamiltonian, NULL));
    assert_same_bytes(path, once);
    destroy(&file);
    destroy(&again);
}

/* Results of another test set are removed even if the new ones lack them; weights stored as floats are
 * recognised. */
TEST("recorded errors replace those of another test set") {
    for (size_t e = 0; e < LG_COUNT(hamiltonian_examples); e++) {
        lg_hamiltonian_file file;
        const char *path = good_model(KIND_HAMILTONIAN, e);
        draw_hamiltonian(e, &file);
        if (hamiltonian_examples[e].dtype == LG_F32) file.theta[0] = nextafter(file.theta[0], 2);
        set_verdict(&file);
        assert_ok(lg_hamiltonian_save_errors(NULL, path, &file, NULL));
        file.has_e2 = false;
        file.e1 = 0.25;
        file.test = (lg_test_set){.trajectories = 3};
        assert_ok(lg_hamiltonian_save_errors(NULL, path, &file, NULL));
        assert_verdict(path, &file);
        lg_recipe_release(&lg_recipe_hamiltonian, &file);
    }
}

static lg_status record_into(const lg_context *context, const char *path, const lg_read_options *options,
                             lg_error *error) {
    lg_hamiltonian_file file;
    (void)options;
    draw_hamiltonian(0, &file);
    set_verdict(&file);
    const lg_status status = lg_hamiltonian_save_errors(context, path, &file, error);
    lg_recipe_release(&lg_recipe_hamiltonian, &file);
    return status;
}

/* After the change, recording errors into the good model must fail. */
#define NOT_RECORDED(expected, word, ...)                                                                    \
    do {                                                                                                     \
        const lg_hamiltonian_file before = file;                                                             \
        const char *path = fresh_hamiltonian(), *copy = scratch_path("before.h5");                           \
        lg_error error = {LG_OK, ""};                                                                        \
        copy_file(path, copy);                                                                               \
        __VA_ARGS__;                                                                                         \
        assert_status(lg_hamiltonian_save_errors(NULL, path, &file, &error), expected);                      \
        if (strstr(error.message, word) == NULL) fail_msg("no '%s' in: %s", word, error.message);            \
        assert_same_bytes(path, copy);                                                                       \
        file = before;                                                                                       \
    } while (0)

TEST("errors are recorded only into the model that they belong to, and only if they are finite") {
    lg_hamiltonian_file file;
    draw_hamiltonian(0, &file);
    set_verdict(&file);
    const double last = file.theta[51];
    NOT_RECORDED(LG_INVALID_ARGUMENT, "not the parameters that were judged",
                 file.theta[51] = nextafter(last, 9));
    file.theta[51] = last;
    NOT_RECORDED(LG_INVALID_ARGUMENT, "seed", file.run.training.seed = 5);
    NOT_RECORDED(LG_INVALID_ARGUMENT, "links", file.run = make_hamiltonian_run(1));
    NOT_RECORDED(LG_NOT_FINITE, "E1", file.e1 = NAN);
    NOT_RECORDED(LG_NOT_FINITE, "E2", file.e2 = INFINITY);
    assert_status(lg_hamiltonian_save_errors(NULL, NULL, &file, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_save_errors(NULL, "model.h5", NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(
        lg_hamiltonian_save_errors(NULL, "model.h5", &(lg_hamiltonian_file){.epochs_done = 1}, NULL),
        LG_INVALID_ARGUMENT);
    lg_recipe_release(&lg_recipe_hamiltonian, &file);
    lg_recipe_release(&lg_recipe_hamiltonian, NULL);
    lg_recipe_release(&lg_recipe_surrogate, NULL);
    refuse_damaged_files(record_into, fresh_hamiltonian(), "");
    survive_changed_bytes(record_into, fresh_hamiltonian(), 60);
}

/* The test set is only information for readers. */
TEST("errors in the stored test set do not make the model unreadable") {
    static const struct {
        const char *at;
        change change;
        const char *sha256; /* the value that must be read */
    } rows[] = {
        {"@test_trajectories", TEXT("many"), ""},
        {"@test_trajectories", REAL(2.5), ""},
        {"@test_trajectories", REAL(-1), ""},
        {"@test_points", TEXT("many"), ""},
        {"@test_points", REAL(2.5), ""},
        {"@test_points", REAL(-1), ""},
        {"@test_t_end", TEXT("many"), ""},
        {"@test_t_end", REAL(NAN), ""},
        {"@test_t_end", REAL(-1), ""},
        {"@test_sha256", TEXT("0000000000000000000000000000000000000000000000000000000000000000000003"), ""},
        {"@test_sha256", WHOLE(3), ""},
        {"@test_sha256", TEXT("abc"), "abc"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_hamiltonian_file want = {.has_e1 = true, .e1 = 1.7e-7};
        const char *path = fresh_hamiltonian();
        (void)apply_change(path, rows[i].at, &rows[i].change);
        (void)snprintf(want.test.sha256, sizeof want.test.sha256, "%s", rows[i].sha256);
        assert_verdict(path, &want);
    }
}

/* ---- checkpoints ---- */

/* Writes a checkpoint of example 0 with the state of a fit of three parameters. */
static lg_status write_checkpoint(const kind_row *k, const lg_context *context, const char *path,
                                  const lg_fit *fit, lg_error *error) {
    any_file file;
    lg_file_writer *writer;
    lg_archive_writer archive;
    k->make(0, &file);
    lg_status status =
        lg_checkpoint_create(context, path, k->recipe, common_of(&file).run, NULL, &writer, error);
    destroy(&file);
    if (status != LG_OK) return status;
    status = lg_file_writer_archive(writer, "fit", &archive);
    if (status == LG_OK && fit != NULL) status = lg_fit_save(fit, &archive, error);
    if (status == LG_OK) status = archive.text(archive.user, "note/author", "nobody");
    if (status == LG_OK) status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}

static const double three[3] = {1, 2, 3};

static const char *good_checkpoint(const kind_row *k) {
    const char *path = scratch_path("check.h5"),
               *original = scratch_path(test_text("%s.original", k->recipe->checkpoint));
    if (access(original, F_OK) != 0) {
        lg_fit *fit = make_fit(k, three, 3);
        assert_ok(lg_fit_run(fit, NULL));
        assert_ok(write_checkpoint(k, NULL, original, fit, NULL));
    }
    copy_file(original, path);
    return path;
}

static const kind_row *fresh_kind;
static const char *fresh_checkpoint(void) {
    return good_checkpoint(fresh_kind);
}

static void look_into_archive(lg_file_reader *reader, const lg_archive_reader *archive) {
    char note[16];
    double value;
    uint32_t rank;
    uint64_t dims[4];
    assert_ok(archive->text(archive->user, "note/author", note, sizeof note));
    assert_string_equal(note, "nobody");
    assert_status(archive->text(archive->user, "note/author", note, 3), LG_SHAPE);
    assert_status(archive->text(archive->user, "note/nothing", note, sizeof note), LG_NOT_FOUND);
    assert_status(archive->array(archive->user, "nothing", LG_ELEMENT_F64, 0, NULL, &value), LG_NOT_FOUND);
    assert_non_null(strstr(lg_file_reader_message(reader), "check.h5: has no /fit/nothing"));
    assert_status(archive->array(archive->user, "optimizer/adam/m", LG_ELEMENT_F64, 0, NULL, &value),
                  LG_SHAPE);
    assert_ok(archive->shape(archive->user, "optimizer/adam/m", &rank, dims));
    assert_true(rank == 1 && dims[0] == 3);
}

/* 3 epochs, a checkpoint and 2 more epochs must give the same bits as 5 epochs. */
TEST("a fit resumed from its checkpoint gives the same bits") {
    for
        EACH_KIND(k) {
            double straight[3], resumed[3];
            any_run run, wanted = k->make_run(0);
            lg_file_reader *reader;
            lg_archive_reader archive;
            lg_fit *whole = make_fit(k, three, 3), *fit = make_fit(k, three, 3);
            for (int i = 0; i < 2; i++) assert_ok(lg_fit_run(whole, NULL));
            lg_fit_parameters(whole, straight);
            assert_ok(lg_checkpoint_open(NULL, good_checkpoint(k), NULL, k->recipe, &run, &reader, NULL));
            assert_ok(lg_recipe_compare_runs(k->recipe, &run, &wanted, "check.h5", NULL));
            if (number_of(k) == KIND_DETECTOR)
                assert_same_net(&run.detector.model.net, &wanted.detector.model.net);
            assert_ok(lg_file_reader_archive(reader, "fit", &archive));
            assert_ok(lg_fit_load(fit, &archive, NULL));
            look_into_archive(reader, &archive);
            lg_file_reader_destroy(reader);
            assert_ok(lg_fit_run(fit, NULL));
            lg_fit_parameters(fit, resumed);
            assert_memory_equal(straight, resumed, sizeof straight);
        }
}

/* Files that are older than schedules have no key for them, which means steps. All other keys must exist. */
TEST("a file without a schedule has steps") {
    const kind_row *k = &kinds[KIND_HAMILTONIAN];
    lg_hamiltonian_run run, wanted = make_hamiltonian_run(0);
    lg_file_reader *reader;
    lg_hamiltonian_file file;
    const char *path = good_checkpoint(k);
    delete_attribute(path, "run", "schedule");
    assert_ok(lg_checkpoint_open(NULL, path, NULL, k->recipe, &run, &reader, NULL));
    lg_file_reader_destroy(reader);
    wanted.training.schedule = LG_SCHEDULE_STEP;
    assert_ok(lg_recipe_compare_runs(k->recipe, &run, &wanted, path, NULL));
    path = fresh_hamiltonian();
    delete_attribute(path, "run", "schedule");
    assert_ok(lg_recipe_load(NULL, path, NULL, &lg_recipe_hamiltonian, &file, NULL));
    assert_ok(lg_recipe_compare_runs(k->recipe, &file.run, &wanted, path, NULL));
    lg_recipe_release(&lg_recipe_hamiltonian, &file);
    /* Fits in these files were saved with a floor of 0, whatever lr_gamma is, and must get it again. */
    lg_fit_options options;
    lg_fit_options_init(&options);
    lg_fit_settings_apply(&run.training, &options);
    assert_close(options.schedule.gamma, 0.1, 0, 0);
    assert_close(options.schedule.floor, 0, 0, 0);
}

TEST("a NaN in the saved state of the optimiser is found when the fit loads it") {
    const kind_row *k = &kinds[KIND_HAMILTONIAN];
    const char *path = good_checkpoint(k);
    const double bad[3] = {0, NAN, 0};
    const hsize_t count = 3;
    replace_dataset(path, "fit/optimizer/adam/m", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &count, bad);
    lg_hamiltonian_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    assert_ok(lg_checkpoint_open(NULL, path, NULL, k->recipe, &run, &reader, NULL));
    assert_ok(lg_file_reader_archive(reader, "fit", &archive));
    const lg_status status = lg_fit_load(make_fit(k, three, 3), &archive, NULL);
    assert_true(status == LG_FORMAT || status == LG_NOT_FINITE);
    lg_file_reader_destroy(reader);
}

TEST("a damaged checkpoint is refused, and a checkpoint is not mistaken for a model or a model for a "
     "checkpoint") {
    static const damage rows[] = {{"@format_version", WHOLE(7), LG_VERSION, "7"}};
    for
        EACH_KIND(k) {
            fresh_kind = k;
            refuse_damaged_files(k->read_checkpoint, good_checkpoint(k), "");
            survive_changed_bytes(k->read_checkpoint, good_checkpoint(k),
                                  number_of(k) == KIND_HAMILTONIAN ? 300 : 60);
            refuse_damage(k->read_checkpoint, fresh_checkpoint, rows, LG_COUNT(rows));
            assert_refused(k->read_checkpoint, k->fresh(), LG_FORMAT, "kind", k->recipe->checkpoint);
            assert_refused(k->read, good_checkpoint(k), LG_FORMAT, "kind", k->recipe->name);
        }
    assert_refused(record_into, good_checkpoint(&kinds[KIND_HAMILTONIAN]), LG_FORMAT, "checkpoint", "");
}

/* ---- every field of a run's description ---- */

static const damage wrong_values[LG_FIELD_SHOWN + 1][2] = {
    [LG_FIELD_REAL] = {{NULL, TEXT("many"), LG_FORMAT, "number"}, {NULL, REAL(NAN), LG_NOT_FINITE, "finite"}},
    [LG_FIELD_U64] = {{NULL, TEXT("many"), LG_FORMAT, "integer"}, {NULL, WHOLE(-1), LG_FORMAT, ""}},
    [LG_FIELD_U32] = {{NULL, TEXT("many"), LG_FORMAT, "integer"}, {NULL, WHOLE(-1), LG_FORMAT, ""}},
    [LG_FIELD_FLAG] = {{NULL, TEXT("yes"), LG_FORMAT, "integer"}, {NULL, WHOLE(2), LG_FORMAT, "0 nor 1"}},
    [LG_FIELD_NAME] = {{NULL, TEXT("no such name"), LG_FORMAT, "known name"},
                       {NULL, TEXT(""), LG_FORMAT, "known name"}},
    [LG_FIELD_PHRASE] = {{NULL, TEXT("no such word"), LG_FORMAT, "is not a"},
                         {NULL, TEXT(""), LG_FORMAT, "is not a"}}};

/* `whole`: no field may be missing, except fields that files of earlier versions lack. */
static void refuse_row(const lg_field *r, bool whole, read_fn reader, fresh_fn fresh) {
    const char *at = test_text("%s@%s", r->group, r->name);
    const bool needed = !r->optional && (whole || strcmp(r->group, "model") == 0);
    const damage gone = {at, GONE, LG_FORMAT, "missing"},
                 below = {at, REAL(nextafter(r->low, -INFINITY)), LG_FORMAT, "out of range"};
    if (needed) refuse_damage(reader, fresh, &gone, 1);
    if (r->type == LG_FIELD_REAL) refuse_damage(reader, fresh, &below, 1);
    for (size_t i = 0; i < 2 && wrong_values[r->type][i].word != NULL; i++) {
        damage row = wrong_values[r->type][i];
        row.at = at;
        refuse_damage(reader, fresh, &row, 1);
    }
    if (needed) return;
    const char *path = fresh();
    (void)apply_change(path, at, &gone.change);
    assert_ok(reader(NULL, path, NULL, NULL));
}

TEST("every hyperparameter of a model or checkpoint is refused by name if missing or wrong") {
    for
        EACH_KIND(k) {
            const lg_field *const tables[] = {k->recipe->facts, k->recipe->fields};
            fresh_kind = k;
            for (size_t t = 0; t < LG_COUNT(tables); t++)
                for (const lg_field *r = tables[t]; r->name != NULL; r++) {
                    refuse_row(r, false, k->read, k->fresh);
                    refuse_row(r, true, k->read_checkpoint, fresh_checkpoint);
                }
        }
}

/* Gives the field another value. Returns false if the field's text is made from several members. */
static bool change_row(const lg_field *r, void *run) {
    char *at = (char *)run + r->offset;
    double values[LG_FIELD_LIST_MAX] = {0};
    uint32_t count = 1;
    if (r->type == LG_FIELD_SHOWN) return false;
    if (r->type == LG_FIELD_TEXT) {
        at[0] ^= 1;
        return true;
    }
    if (r->type == LG_FIELD_PHRASE) return lg_field_set(r, "adam:3,lbfgs", run, NULL) == LG_OK;
    if (r->type == LG_FIELD_WHOLES || r->type == LG_FIELD_REALS) {
        count = lg_field_list(r, run, values);
        count = count > 0 ? count : 1;
        values[0]++;
    } else if (r->type == LG_FIELD_REAL)
        values[0] = nextafter(lg_field_number(r, run), INFINITY);
    else
        values[0] = lg_field_whole(r, run) != 1;
    lg_field_fill(r, values, count, run);
    return true;
}

static void refuse_other_run(const kind_row *k, const any_run *run, const any_run *wanted, const char *says) {
    lg_error error;
    assert_status(lg_recipe_compare_runs(k->recipe, run, wanted, "a.h5", &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "a.h5: was written ");
    assert_says(error.message, says);
    assert_ok(lg_recipe_compare_runs(k->recipe, wanted, wanted, "a.h5", &error));
}

TEST("a checkpoint of another run is refused, and the message names the difference") {
    for
        EACH_KIND(k) {
            const lg_field *const tables[] = {k->recipe->facts, k->recipe->fields};
            const any_run wanted = k->make_run(k->bad);
            for (size_t t = 0; t < LG_COUNT(tables); t++)
                for (const lg_field *r = tables[t]; r->name != NULL; r++) {
                    any_run run = wanted;
                    char have[512], want[512];
                    if (!change_row(r, &run)) continue;
                    lg_field_show(r, &run, have, sizeof have);
                    lg_field_show(r, &wanted, want, sizeof want);
                    char *says = test_text("%s %s, not %s", r->name, have, want);
                    /* the message is cut within a machine's description */
                    if (strlen(says) > 400) says[400] = '\0';
                    refuse_other_run(k, &run, &wanted, says);
                }
        }
    const kind_row *k = &kinds[KIND_HAMILTONIAN];
    any_run wanted = k->make_run(0), run = wanted;
    run.hamiltonian.scheme = lg_scheme_find("rk4");
    refuse_other_run(k, &run, &wanted, "integrator rk4, not cf4");
    k = &kinds[KIND_DETECTOR];
    run = wanted = k->make_run(3);
    run.detector.model.net.block[7].pool_stride = 4; /* late in the text of the blocks */
    refuse_other_run(k, &run, &wanted, "max 2/4, not");
    run = wanted;
    run.detector.model.net.blocks = 7;
    refuse_other_run(k, &run, &wanted, "padding 0 none, not");
}

TEST("if writing an array fails the writer keeps the error, and no file is made") {
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

typedef struct step {
    const kind_row *kind;
    const char *path;
} step;

static lg_status save_step(const lg_context *context, void *user, lg_error *error) {
    const step *s = user;
    any_file file;
    s->kind->make(s->kind->single, &file);
    const lg_status status = save(context, s->path, &file, NULL, error);
    destroy(&file);
    return status;
}

static lg_status open_step(const lg_context *context, void *user, lg_error *error) {
    const step *s = user;
    any_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    const lg_read_options options = without_probe();
    LG_TRY(lg_checkpoint_open(context, s->path, &options, s->kind->recipe, &run, &reader, error));
    const lg_status status = lg_file_reader_archive(reader, "fit", &archive);
    lg_file_reader_destroy(reader);
    return status;
}

static lg_status checkpoint_step(const lg_context *context, void *user, lg_error *error) {
    const step *s = user;
    return write_checkpoint(s->kind, context, s->path, NULL, error);
}

TEST("every allocation may fail; nothing leaks and no file is left") {
    for
        EACH_KIND(k) {
            step model = {k, good_model(number_of(k), 0)}, checkpoint = {k, good_checkpoint(k)};
            const size_t files = scratch_files();
            assert_true(fail_every_reading(k->read, model.path) >= k->loads);
            assert_true(fail_every_allocation(save_step, &model) >= k->saves);
            assert_true(fail_every_allocation(open_step, &checkpoint) >= 4);
            assert_true(fail_every_allocation(checkpoint_step, &checkpoint) >= 6);
            assert_int_equal(scratch_files(), files);
        }
}
