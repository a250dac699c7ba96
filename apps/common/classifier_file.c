/* Writes and reads files of classifiers. */
#include "common/classifier_file.h"

#include <math.h>
#include <string.h>

#include "common/app.h"
#include "core/stored.h"

/* ---- the values in the group /run ---- */

enum { STORED = 7, NEEDED = STORED - 2 /* the last two may be missing in a file */ };
static void list_stored(classifier_file *file, lg_stored out[STORED]) {
    const lg_stored rows[STORED] = {{"run/test_fraction", LG_ELEMENT_F64, .data = &file->run.test_fraction},
                                    {"run/seed", LG_ELEMENT_U64, .data = &file->run.training.seed},
                                    {"run/windows", LG_ELEMENT_U64, .data = &file->run.windows},
                                    {"run/window", LG_ELEMENT_U64, .data = &file->run.window},
                                    {"run/hop", LG_ELEMENT_U64, .data = &file->run.hop},
                                    {"run/accuracy", LG_ELEMENT_F64, .data = &file->accuracy},
                                    {"run/f1", LG_ELEMENT_F64, .data = &file->f1}};
    memcpy(out, rows, sizeof rows);
}

/* ---- writing ---- */

bool classifier_file_is_novelty(const classifier_file *file) {
    return strcmp(file->method, "novelty") == 0;
}

static lg_status write_models(const lg_archive_writer *to, const classifier_file *file, lg_error *error) {
    if (!classifier_file_is_novelty(file)) LG_TRY(lg_classifier_save(&file->classifier, to, error));
    return file->novelty.channels > 0 ? lg_novelty_save(&file->novelty, to, error) : LG_OK;
}

static lg_status write_run(const lg_archive_writer *to, const classifier_file *file) {
    classifier_file copy = *file;
    lg_stored rows[STORED];
    list_stored(&copy, rows);
    for (size_t i = NEEDED; i < STORED; i++)
        if (!isfinite(*(const double *)rows[i].data)) rows[i].data = NULL;
    LG_TRY(lg_stored_save(to, rows, STORED, NULL));
    const char *const texts[][2] = {{"run/method", file->method},
                                    {"run/split", lg_split_name(file->run.split)},
                                    {"run/data_sha256", file->run.data_sha256},
                                    {"run/healthy", file->run.healthy}};
    for (size_t i = 0; i < LG_COUNT(texts); i++) LG_TRY(to->text(to->user, texts[i][0], texts[i][1]));
    return LG_OK;
}

lg_status classifier_file_save(const lg_context *context, const char *path, const classifier_file *file,
                               lg_error *error) {
    lg_file_writer *writer = NULL;
    lg_archive_writer archive;
    lg_status status = lg_file_writer_create(context, path, "classifier", &file->provenance, &writer, error);
    if (status == LG_OK) status = lg_file_writer_archive(writer, "", &archive);
    if (status == LG_OK) status = lg_file_writer_names(writer, &file->names, error);
    if (status == LG_OK) status = write_run(&archive, file);
    if (status == LG_OK) status = write_models(&archive, file, error);
    if (writer != NULL && (status == LG_OK || error->message[0] == '\0'))
        status = lg_file_writer_commit(writer, error); /* returns the error of an earlier write that failed */
    lg_file_writer_destroy(writer);
    return status;
}

/* ---- reading ---- */

const char *classifier_method_name(uint32_t method) {
    static const char *const names[] = {"cnn",     "logistic", "tree",   "svm-linear",
                                        "svm-rbf", "baseline", "rocket", "novelty"};
    return method < LG_COUNT(names) ? names[method] : NULL;
}

static lg_status read_texts(const lg_archive_reader *from, classifier_file *out, lg_error *error) {
    char method[32], split[32];
    LG_TRY(from->text(from->user, "run/method", method, sizeof method));
    LG_TRY(from->text(from->user, "run/split", split, sizeof split));
    LG_TRY(from->text(from->user, "run/data_sha256", out->run.data_sha256, sizeof out->run.data_sha256));
    for (uint32_t i = 1; (out->method = classifier_method_name(i)) != NULL; i++)
        if (strcmp(out->method, method) == 0) break;
    /* Files of earlier versions lack it. */
    if (from->text(from->user, "run/healthy", out->run.healthy, sizeof out->run.healthy) != LG_OK)
        out->run.healthy[0] = '\0';
    LG_FIND_NAME(out->run.split, LG_SPLIT_COUNT, lg_split_name, split);
    if (out->method == NULL || out->run.split == LG_SPLIT_COUNT)
        return lg_fail(error, LG_FORMAT, "/run: the attribute method or split is unknown");
    return LG_OK;
}

static lg_status read_models(const lg_context *context, const lg_archive_reader *from, classifier_file *out,
                             lg_error *error) {
    const bool alone = classifier_file_is_novelty(out);
    if (!alone) LG_TRY(lg_classifier_load(context, from, &out->classifier, error));
    const lg_status status = lg_novelty_load(context, from, &out->novelty, error);
    const lg_features *f = &out->classifier.features;
    if (status == LG_NOT_FOUND && !alone) return LG_OK;
    LG_TRY(status);
    if (!alone && (out->novelty.channels != f->channels || out->novelty.length != f->length))
        return lg_fail(error, LG_FORMAT,
                       "the novelty detector is for windows of another shape than the classifier");
    return LG_OK;
}

static lg_status read_names(lg_file_reader *reader, classifier_file *out, lg_error *error) {
    LG_TRY(lg_file_reader_names(reader, &out->names, error));
    const uint32_t classes = classifier_file_is_novelty(out) ? 2 : out->classifier.classes;
    const uint32_t channels =
        classifier_file_is_novelty(out) ? out->novelty.channels : out->classifier.features.channels;
    if (out->names.channels > 0 && out->names.channels != channels)
        return lg_fail(error, LG_FORMAT, "the file names %u channels, but its model has %u",
                       out->names.channels, channels);
    if (out->names.classes != classes)
        return lg_fail(error, LG_FORMAT, "the file names %u classes, but its classifier has %u",
                       out->names.classes, classes);
    return LG_OK;
}

static lg_status read_run(const lg_archive_reader *from, classifier_file *out, lg_error *error) {
    const lg_detector_run *run = &out->run;
    lg_stored rows[STORED];
    list_stored(out, rows);
    LG_TRY(lg_stored_load(from, rows, NEEDED, NULL));
    const uint32_t length =
        classifier_file_is_novelty(out) ? out->novelty.length : out->classifier.features.length;
    if (run->window != length || run->hop < 1 || !(run->test_fraction >= 0 && run->test_fraction < 1))
        return lg_fail(error, LG_FORMAT, "/run does not fit the classifier: window, hop or test_fraction");
    for (size_t i = NEEDED; i < STORED; i++)
        if (lg_stored_load(from, &rows[i], 1, NULL) != LG_OK) *(double *)rows[i].data = NAN;
    return LG_OK;
}

static lg_status read_all(const lg_context *context, lg_file_reader *reader, classifier_file *out,
                          lg_error *error) {
    lg_archive_reader archive;
    LG_TRY(lg_file_reader_archive(reader, "", &archive));
    LG_TRY(read_texts(&archive, out, error));
    LG_TRY(read_models(context, &archive, out, error));
    LG_TRY(read_names(reader, out, error));
    LG_TRY(read_run(&archive, out, error));
    lg_file_reader_provenance(reader, &out->provenance);
    return LG_OK;
}

lg_status classifier_file_load(const lg_context *context, const char *path, classifier_file *out,
                               lg_error *error) {
    lg_file_reader *reader = NULL;
    *out = (classifier_file){.method = NULL};
    LG_TRY(lg_file_reader_create(context, path, "classifier", NULL, &reader, error));
    const lg_status status = read_all(context, reader, out, error);
    if (status != LG_OK && error->message[0] == '\0')
        (void)lg_fail(error, status, "%s", lg_file_reader_message(reader));
    lg_file_reader_destroy(reader);
    if (status == LG_OK) return LG_OK;
    /* The method was read, so the file exists; LG_NOT_FOUND then means that a part of the file is missing. */
    const bool loaded = out->method != NULL;
    classifier_file_free(out);
    return status == LG_NOT_FOUND && loaded ? LG_FORMAT : status;
}

void classifier_file_free(classifier_file *file) {
    lg_series_destroy(&file->names);
    lg_classifier_destroy(&file->classifier);
    lg_novelty_destroy(&file->novelty);
    *file = (classifier_file){.method = NULL};
}
