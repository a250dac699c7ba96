/* Classifiers as a kind of model: a recipe without parameters and functions. */
#include "common/classifier_file.h"

#include "anomaly/files/recipe.h"
#include "core/stored.h"

#define FACT(group, name, type, member, ...) LG_FACT(lg_detector_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {
    FACT("model", "window", U64, window, .low = 1),
    FACT("model", "hop", U64, hop, .low = 1),
    FACT("run", "windows", U64, windows, .low = 0),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    LG_FIELD(lg_detector_run, "run", "split", NAME, split, LG_NAMED(lg_split_name, LG_SPLIT_COUNT)),
    FACT("run", "healthy", TEXT, healthy, .low = 0),
    LG_FIELD(lg_detector_run, "run", "test_fraction", REAL, test_fraction, .high = 0.95),
    LG_FIELD(lg_detector_run, "run", "seed", U64, training.seed, .high = 0x1p64),
    LG_FIELD_END};
static const lg_field no_fields[] = {LG_FIELD_END};

static const lg_detector_run defaults = {.split = LG_SPLIT_RANDOM};

static lg_status make(void *run, lg_error *why) {
    return LG_OK;
}

static const lg_item items[] = {LG_ATTRIBUTE(classifier_file, REAL, "accuracy", accuracy),
                                LG_ATTRIBUTE(classifier_file, REAL, "f1", f1),
                                {.type = LG_ITEM_END}};

const char *classifier_method_name(uint32_t method) {
    static const char *const names[] = {"cnn",     "logistic", "tree",   "svm-linear",
                                        "svm-rbf", "baseline", "rocket", "novelty"};
    return method < LG_COUNT(names) ? names[method] : NULL;
}

static const char *method_of(const lg_classifier *c) {
    if (c->classes == 0) return "novelty";
    if (c->features.kind == LG_FEATURES_BASELINE) return "baseline";
    return c->method == LG_METHOD_RIDGE ? "rocket" : lg_classifier_method_name(c->method);
}

static lg_status save_classifier(const void *part, const lg_archive_writer *to, lg_error *error) {
    return lg_classifier_save(part, to, error);
}

static lg_status load_classifier(const lg_context *context, const lg_archive_reader *from, void *part,
                                 lg_error *error) {
    char method[32];
    if (from->text(from->user, "classifier/method", method, sizeof method) == LG_NOT_FOUND)
        return LG_NOT_FOUND;
    return lg_as_format(lg_classifier_load(context, from, part, error), NULL);
}

static lg_status put_rest(lg_h5 *h5, const void *user, lg_error *error) {
    const classifier_file *file = user;
    lg_series names = file->names;
    names.length = (uint32_t)file->run.window;
    LG_TRY(lg_detector_put_names(h5, &names, &file->novelty, error));
    return classifier_file_is_novelty(file)
               ? LG_OK
               : lg_detector_put_part(h5, save_classifier, &file->classifier, error);
}

static lg_status get_rest(lg_h5 *h5, void *user, lg_error *error) {
    classifier_file *file = user;
    const lg_classifier *c = &file->classifier;
    LG_TRY(lg_detector_get_part(h5, load_classifier, &file->classifier, error));
    if (!classifier_file_is_novelty(file) && c->features.channels == 0)
        return lg_fail(error, LG_FORMAT, "/classifier/features is for windows without channels");
    file->method = method_of(c);
    file->names = (lg_series){.classes = classifier_file_is_novelty(file) ? 2 : c->classes,
                              .channels = c->features.channels,
                              .length = c->features.length};
    return lg_detector_get_names(h5, file->run.window, &file->names, &file->novelty, error);
}

static void release(void *user) {
    classifier_file *file = user;
    lg_series_destroy(&file->names);
    lg_classifier_destroy(&file->classifier);
    lg_novelty_destroy(&file->novelty);
}

const lg_recipe classifier_recipe = {.name = "classifier",
                                     .facts = facts,
                                     .fields = no_fields,
                                     .run_size = sizeof(lg_detector_run),
                                     .training = offsetof(lg_detector_run, training),
                                     .defaults = &defaults,
                                     .make = make,
                                     .file_size = sizeof(classifier_file),
                                     .file_run = offsetof(classifier_file, run),
                                     .items = items,
                                     .put_rest = put_rest,
                                     .get_rest = get_rest,
                                     .release = release};
