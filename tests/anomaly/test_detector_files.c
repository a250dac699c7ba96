/* The text of a detector's blocks; classifiers, and names in files of any kind; which kind a file has.
 * test_model_files.c tests what all kinds of models share. */
#include "datasets/series_files.h"
#include "model/model_kinds.h"

TEST("blocks are written as a readable text") {
    for (size_t e = 0; e < LG_COUNT(detector_examples); e++) {
        lg_h5 *h5;
        char blocks[512];
        assert_ok(lg_h5_open(NULL, good_model(KIND_DETECTOR, e), NULL, &h5, NULL));
        assert_true(lg_h5_has(h5, "model/conv1/weight") == (detector_examples[e].net.blocks > 0));
        assert_true(lg_h5_has(h5, "model/plane/weight") == (detector_examples[e].net.plane > 0));
        assert_ok(lg_h5_text(h5, "model", "blocks", blocks, sizeof blocks, NULL));
        if (detector_examples[e].blocks != NULL) assert_string_equal(blocks, detector_examples[e].blocks);
        lg_h5_close(h5);
    }
}

static void assert_blocks(const char *text, lg_status expected, const char *word) {
    lg_error error = {LG_OK, ""};
    const char *path = fresh_detector();
    replace_text(path, "model", "blocks", text);
    assert_status(read_detector(NULL, path, NULL, &error), expected);
    if (strstr(error.message, word) == NULL) fail_msg("%s: %s", text, error.message);
}

TEST("the text of the blocks is read back as written") {
    assert_blocks("3 kernel 4 stride 3 padding 3 none", LG_OK, "");
    /* Another stride or padding leaves another number of samples for the output layer. */
    static const char *const fine[] = {"3 kernel 4 padding 3", "3 kernel 4", "  3  kernel  4  stride 2"};
    for (size_t i = 0; i < LG_COUNT(fine); i++) assert_blocks(fine[i], LG_FORMAT, "output/weight");
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
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_blocks(bad[i], LG_FORMAT, "attribute blocks: expected up to 8 as");
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
                                          "1048576 kernel 9, 1048576 kernel 1"};
    for (size_t i = 0; i < LG_COUNT(hostile); i++)
        assert_blocks(hostile[i], LG_FORMAT, "do not describe a possible network: ");
    assert_blocks("", LG_FORMAT, "wrong shape");
}

/* ---- files of other kinds ---- */

static lg_series names_only(void) {
    lg_series names = {.classes = 2, .channels = 3, .rate = 50};
    names.class_name = lg_test_gives(2, sizeof *names.class_name);
    names.channel_name = lg_test_gives(3, sizeof *names.channel_name);
    names.class_label = lg_test_gives(2, sizeof *names.class_label);
    for (int i = 0; i < 2; i++) (void)snprintf(names.class_label[i], LG_SERIES_NAME, "%d", i + 1);
    for (int i = 0; i < 2; i++) (void)snprintf(names.class_name[i], LG_SERIES_NAME, "%c|%c", 'a' + i, 'x');
    for (int i = 0; i < 3; i++) (void)snprintf(names.channel_name[i], LG_SERIES_NAME, "channel %d", i);
    return names;
}

static lg_status write_names(lg_file_writer *writer, const lg_series *names, lg_error *error) {
    lg_h5 *h5 = lg_file_writer_h5(writer);
    LG_TRY(lg_sensing_check(NULL, h5->path, names, error));
    return lg_sensing_put(h5, names, error);
}

static lg_status read_names(lg_file_reader *reader, lg_series *names, lg_error *error) {
    *names = (lg_series){.classes = 0};
    return lg_sensing_get(lg_file_reader_h5(reader), names, error);
}

/* Writes a classifier as the program does: names at the root, arrays and texts below /classifier. */
static lg_status write_classifier(const lg_context *context, const char *path, lg_error *error) {
    static const double weights[2][3] = {{1, 2, 3}, {4, 5, 6}};
    static const uint32_t counts[3] = {7, 0, 4294967295u};
    const uint64_t dims[2] = {2, 3};
    lg_file_writer *writer;
    lg_archive_writer archive;
    lg_series names = names_only();
    lg_status status = lg_file_writer_create(context, path, "classifier", NULL, &writer, error);
    if (status == LG_OK) {
        status = write_names(writer, &names, error);
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
    lg_status status = read_names(reader, &names, error);
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

static void write_good_classifier(const char *path) {
    assert_ok(write_classifier(NULL, path, NULL));
}

static const char *good_classifier(void) {
    return fresh_copy("classifier.h5", write_good_classifier);
}

TEST("the names and arrays of a classifier are read back as they were written") {
    lg_file_reader *reader;
    lg_archive_reader archive;
    lg_series names, want = names_only();
    char text[16];
    double weights[6];
    uint32_t counts[3], rank;
    uint64_t dims[4];
    assert_ok(lg_file_reader_create(NULL, good_classifier(), "classifier", NULL, &reader, NULL));
    assert_ok(read_names(reader, &names, NULL));
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
}

TEST("names and rates that could not be read back are not written") {
    lg_file_writer *writer;
    lg_series names = names_only();
    lg_error error = {LG_OK, ""};
    assert_ok(lg_file_writer_create(NULL, scratch_path("names.h5"), "classifier", NULL, &writer, NULL));
    memcpy(names.class_name[1], names.class_name[0], LG_SERIES_NAME);
    assert_status(write_names(writer, &names, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "'a|x' is there twice"));
    names.rate = NAN;
    assert_status(write_names(writer, &names, NULL), LG_NOT_FINITE);
    lg_series_destroy(&names);
    assert_status(write_names(writer, &names, NULL), LG_INVALID_ARGUMENT);
    lg_file_writer_destroy(writer);
}

static lg_status read_kind(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    char kind[64];
    return lg_model_file_kind(context, path, options, kind, sizeof kind, error);
}

TEST("a file states its kind") {
    static const struct {
        change format, kind;
        const char *expected;
    } rows[] = {{TEXT("liegrad"), TEXT("hamiltonian"), "hamiltonian"},
                {TEXT("liegrad"), TEXT("surrogate"), "surrogate"},
                {TEXT("liegrad"), TEXT("series"), "series"},
                {GONE, TEXT("detector"), "detector"}, /* a file written by hand */
                {TEXT("another"), TEXT("detector"), ""},
                {GONE, WHOLE(7), ""},
                {GONE, GONE, ""}};
    char kind[24] = "before";
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = fresh_detector();
        (void)apply_change(path, "@format", &rows[i].format);
        (void)apply_change(path, "@kind", &rows[i].kind);
        assert_ok(lg_model_file_kind(NULL, path, NULL, kind, sizeof kind, NULL));
        assert_string_equal(kind, rows[i].expected);
    }
    const char *path = fresh_detector();
    assert_status(lg_model_file_kind(NULL, path, NULL, kind, 8, &error), LG_INVALID_ARGUMENT);
    assert_string_equal(kind, "");
    assert_ok(lg_model_file_kind(NULL, path, NULL, kind, 9, NULL));
    assert_string_equal(kind, "detector");
    assert_ok(lg_model_file_kind(NULL, good_classifier(), NULL, kind, sizeof kind, NULL));
    assert_string_equal(kind, "classifier");
    static const damage newer[] = {{"@format_version", WHOLE(3), LG_VERSION, ""}};
    refuse_damage(read_kind, fresh_detector, newer, LG_COUNT(newer));
    refuse_damaged_files(read_kind, fresh_detector(), "");
}

/* ---- memory ---- */

static lg_status classifier_step(const lg_context *context, void *user, lg_error *error) {
    const lg_read_options options = without_probe();
    LG_TRY(write_classifier(context, user, error));
    return read_classifier(context, user, &options, error);
}

TEST("every allocation may fail, and nothing leaks") {
    assert_true(fail_every_allocation(classifier_step, (void *)(uintptr_t)good_classifier()) >= 12);
}
