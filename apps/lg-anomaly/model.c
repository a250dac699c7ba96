/* Models of either kind, from and to files, and what they say of a window. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/anomaly.h"
#include "common/fit.h"

static const char *const kinds[] = {"detector", "classifier"};

/* ---- networks ---- */

static void *convert(const double *theta, size_t n, lg_dtype dtype) {
    void *out = app_alloc(n, dtype == LG_F32 ? sizeof(float) : sizeof(double));
    for (size_t i = 0; i < n; i++)
        if (dtype == LG_F32)
            ((float *)out)[i] = (float)theta[i];
        else
            ((double *)out)[i] = theta[i];
    return out;
}

void well_model_of_detector(const lg_detector_file *file, well_model *out) {
    const lg_detector_run *run = &file->run;
    *out = (well_model){.network = true,
                        .method = "cnn",
                        .classes = run->model.classes,
                        .channels = run->model.net.channels,
                        .window = run->model.net.length,
                        .rate = file->rate,
                        .class_name = file->class_name,
                        .class_label = file->class_label,
                        .channel_name = file->channel_name,
                        .probabilities = true,
                        .detector = *file,
                        .dtype = run->training.dtype};
    out->cut = (well_cut){.split = run->split,
                          .test_fraction = run->test_fraction,
                          .validation_fraction = run->validation_fraction,
                          .seed = run->training.seed,
                          .windows = run->windows,
                          .window = run->window,
                          .hop = run->hop};
    memcpy(out->cut.data_sha256, run->data_sha256, sizeof out->cut.data_sha256);
    out->theta = convert(file->theta, file->parameters, out->dtype);
}

static int load_detector(const app *self, const char *path, well_model *out) {
    lg_error error = {LG_OK, ""};
    lg_detector_file file;
    const lg_status status = lg_model_load_detector(self->context, path, NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    well_model_of_detector(&file, out);
    return APP_EXIT_OK;
}

/* ---- classical classifiers: what stands below /run ---- */

typedef struct stored {
    const char *path;
    lg_element type;
    void *value;
} stored;

enum { STORED = 7 };
static void list_stored(well_model *model, double *accuracy, double *f1, stored out[STORED]) {
    const stored rows[STORED] = {{"run/test_fraction", LG_ELEMENT_F64, &model->cut.test_fraction},
                                 {"run/seed", LG_ELEMENT_U64, &model->cut.seed},
                                 {"run/windows", LG_ELEMENT_U64, &model->cut.windows},
                                 {"run/window", LG_ELEMENT_U64, &model->cut.window},
                                 {"run/hop", LG_ELEMENT_U64, &model->cut.hop},
                                 {"run/accuracy", LG_ELEMENT_F64, accuracy},
                                 {"run/f1", LG_ELEMENT_F64, f1}};
    memcpy(out, rows, sizeof rows);
}
enum { NEEDED = STORED - 2 }; /* the last two may be missing */

static lg_status write_run(const lg_archive_writer *to, const well_model *model, double accuracy, double f1) {
    well_model copy = *model;
    stored rows[STORED];
    lg_status status = LG_OK;
    list_stored(&copy, &accuracy, &f1, rows);
    for (size_t i = 0; i < STORED && status == LG_OK; i++)
        if (i < NEEDED || isfinite(*(const double *)rows[i].value))
            status = to->array(to->user, rows[i].path, rows[i].type, 0, NULL, rows[i].value);
    const char *const texts[][2] = {{"run/method", model->method},
                                    {"run/split", lg_split_name(model->cut.split)},
                                    {"run/data_sha256", model->cut.data_sha256}};
    for (size_t i = 0; i < APP_COUNT(texts) && status == LG_OK; i++)
        status = to->text(to->user, texts[i][0], texts[i][1]);
    return status;
}

lg_status well_model_save(const app *self, const char *path, const well_model *model, double accuracy,
                          double f1, lg_error *error) {
    const lg_provenance provenance = app_provenance(self, model->cut.seed);
    const lg_series names = {.classes = model->classes,
                             .channels = model->channels,
                             .rate = model->rate,
                             .class_name = model->class_name,
                             .class_label = model->class_label,
                             .channel_name = model->channel_name};
    lg_file_writer *writer = NULL;
    lg_archive_writer archive;
    lg_status status = lg_file_writer_create(self->context, path, "classifier", &provenance, &writer, error);
    if (status == LG_OK) status = lg_file_writer_archive(writer, "", &archive);
    if (status == LG_OK) status = lg_file_writer_names(writer, &names, error);
    if (status == LG_OK) status = write_run(&archive, model, accuracy, f1);
    if (status == LG_OK) status = lg_classifier_save(&model->classifier, &archive, error);
    if (writer != NULL && (status == LG_OK || error->message[0] == '\0'))
        status = lg_file_writer_commit(writer, error); /* repeats what failed before it */
    lg_file_writer_destroy(writer);
    return status;
}

static const char *const methods[] = {"logistic", "tree", "svm-linear", "svm-rbf", "baseline"};

static const char *known_method(const char *name) {
    for (size_t i = 0; i < APP_COUNT(methods); i++)
        if (strcmp(methods[i], name) == 0) return methods[i];
    return NULL;
}

static lg_status read_texts(const lg_archive_reader *from, well_model *out, lg_error *error) {
    char method[32], split[32];
    lg_status status = from->text(from->user, "run/method", method, sizeof method);
    if (status == LG_OK) status = from->text(from->user, "run/split", split, sizeof split);
    if (status == LG_OK)
        status = from->text(from->user, "run/data_sha256", out->cut.data_sha256, sizeof out->cut.data_sha256);
    if (status != LG_OK) return status;
    out->method = known_method(method);
    if (out->method == NULL || lg_split_parse(split, &out->cut.split) != LG_OK)
        return app_error(error, LG_FORMAT, "/run: method or split are not those of a classifier");
    return LG_OK;
}

static lg_status read_names(lg_file_reader *reader, well_model *out, lg_error *error) {
    const lg_status status = lg_file_reader_names(reader, &out->names, error);
    if (status != LG_OK) return status;
    const lg_classifier *classifier = &out->classifier;
    if (out->names.classes != classifier->classes)
        return app_error(error, LG_FORMAT, "the file names %u classes, its classifier has %u",
                         out->names.classes, classifier->classes);
    out->class_name = out->names.class_name;
    out->class_label = out->names.class_label;
    out->channels = classifier->features.channels;
    out->window = classifier->features.length;
    out->rate = out->names.rate;
    if (out->names.channels == out->channels) out->channel_name = out->names.channel_name;
    return LG_OK;
}

static lg_status read_run(const lg_archive_reader *from, well_model *out, lg_error *error) {
    double accuracy, f1;
    stored rows[STORED];
    lg_status status = LG_OK;
    list_stored(out, &accuracy, &f1, rows);
    for (size_t i = 0; i < NEEDED && status == LG_OK; i++)
        status = from->array(from->user, rows[i].path, rows[i].type, 0, NULL, rows[i].value);
    if (status == LG_OK) status = read_texts(from, out, error);
    if (status != LG_OK) return status;
    const well_cut *cut = &out->cut;
    if (cut->window != out->window || cut->hop < 1 || !(cut->test_fraction >= 0 && cut->test_fraction < 1))
        return app_error(error, LG_FORMAT, "/run does not fit the classifier: window, hop or test_fraction");
    return LG_OK;
}

static int load_classifier(const app *self, const char *path, well_model *out) {
    lg_error error = {LG_OK, ""};
    lg_file_reader *reader = NULL;
    lg_archive_reader archive;
    *out = (well_model){.network = false};
    lg_status status = lg_file_reader_open(self->context, path, "classifier", NULL, &reader, &error);
    if (status == LG_OK) status = lg_file_reader_archive(reader, "", &archive);
    if (status == LG_OK) status = lg_classifier_load(self->context, &archive, &out->classifier, &error);
    if (status == LG_OK) {
        out->classes = out->classifier.classes;
        out->probabilities = out->classifier.method <= LG_METHOD_TREE;
        status = read_names(reader, out, &error);
    }
    if (status == LG_OK) {
        status = read_run(&archive, out, &error);
    }
    if (status != LG_OK && reader != NULL && error.message[0] == '\0')
        (void)app_error(&error, status, "%s", lg_file_reader_message(reader));
    lg_file_reader_close(reader);
    if (status == LG_OK) return APP_EXIT_OK;
    well_model_free(self, out);
    return app_fail_file(self, status == LG_NOT_FOUND && out->classes > 0 ? LG_FORMAT : status, &error, path);
}

/* ---- either ---- */

int well_model_load(const app *self, const char *path, well_model *out) {
    lg_error error = {LG_OK, ""};
    char kind[64];
    const lg_status status = lg_file_kind(self->context, path, NULL, kind, sizeof kind, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    if (strcmp(kind, kinds[0]) == 0) return load_detector(self, path, out);
    if (strcmp(kind, kinds[1]) == 0) return load_classifier(self, path, out);
    return app_fail(self, LG_FORMAT, "%s: holds %s%s%s, not a detector or classifier as train writes them",
                    path, kind[0] != '\0' ? "a '" : "no model of liegrad", kind, kind[0] != '\0' ? "'" : "");
}

void well_model_free(const app *self, well_model *model) {
    free(model->theta);
    if (model->network) {
        lg_detector_file_free(self->context, &model->detector);
    } else {
        lg_series_free(self->context, &model->names);
        lg_classifier_free(self->context, &model->classifier);
    }
    *model = (well_model){.network = false};
}

size_t well_model_work(const well_model *model) {
    return model->network ? lg_detector_work_size(&model->detector.run.model, model->dtype)
                          : lg_classifier_work(&model->classifier) * sizeof(double);
}

lg_status well_model_score(const well_model *model, const float *x, double *score, double *plane,
                           void *work) {
    if (!model->network) return lg_classifier_window(&model->classifier, x, score, work);
    lg_detector_eval(&model->detector.run.model, &model->detector.scaler, model->dtype, model->theta, x,
                     score, plane, work);
    return LG_OK;
}

double well_model_alarm(const well_model *model, const double *score) {
    if (model->classes == 2) return score[1];
    if (model->probabilities) return 1 - score[0];
    double best = -INFINITY;
    for (uint32_t c = 1; c < model->classes; c++) best = fmax(best, score[c]);
    return best - score[0];
}
