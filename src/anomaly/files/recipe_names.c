/* Names, rate and novelty in files of detectors and classifiers. */
#include <stdio.h>

#include "anomaly/files/recipe.h"
#include "datasets/series_files.h"
#include "files/h5.h"

lg_status lg_detector_put_part(lg_h5 *h5, lg_part_saver *save, const void *part, lg_error *error) {
    lg_error failure = {LG_OK, ""};
    lg_h5_view view = {.h5 = h5, .failure = &failure};
    const lg_archive_writer writer = lg_h5_view_writer(&view);
    return save(part, &writer, error);
}

lg_status lg_detector_get_part(lg_h5 *h5, lg_part_loader *load, void *part, lg_error *error) {
    lg_error failure = {LG_OK, ""}, reason = {LG_OK, ""};
    lg_h5_view view = {.h5 = h5, .failure = &failure};
    const lg_archive_reader reader = lg_h5_view_reader(&view);
    const lg_status status = load(h5->context, &reader, part, &reason);
    if (status == LG_OK || status == LG_NOT_FOUND) return LG_OK;
    return lg_fail(error, status, "%s: /%s", lg_shown_path(h5->path), reason.message);
}

static lg_status save_novelty(const void *part, const lg_archive_writer *to, lg_error *error) {
    return lg_novelty_save(part, to, error);
}

static lg_status load_novelty(const lg_context *context, const lg_archive_reader *from, void *part,
                              lg_error *error) {
    return lg_novelty_load(context, from, part, error);
}

static lg_status check_novelty(const lg_h5 *h5, const lg_series *model, const lg_novelty *v, lg_status status,
                               lg_error *error) {
    if (v->channels == 0 || (v->channels == model->channels && v->length == model->length)) return LG_OK;
    return lg_fail(
        error, status,
        "%s: /novelty: is for windows of %u channels and %u samples, but windows of the model have %u and %u",
        lg_shown_path(h5->path), v->channels, v->length, model->channels, model->length);
}

lg_status lg_detector_put_names(lg_h5 *h5, const lg_series *names, const lg_novelty *novelty,
                                lg_error *error) {
    LG_TRY(lg_sensing_check(h5->context, h5->path, names, error));
    LG_TRY(lg_sensing_put(h5, names, error));
    LG_TRY(check_novelty(h5, names, novelty, LG_INVALID_ARGUMENT, error));
    return novelty->channels == 0 ? LG_OK : lg_detector_put_part(h5, save_novelty, novelty, error);
}

lg_status lg_detector_get_names(lg_h5 *h5, uint64_t window, lg_series *names, lg_novelty *novelty,
                                lg_error *error) {
    LG_TRY(lg_detector_get_part(h5, load_novelty, novelty, error));
    if (names->channels == 0) names->channels = novelty->channels, names->length = novelty->length;
    LG_TRY(check_novelty(h5, names, novelty, LG_FORMAT, error));
    if (names->length != window)
        return lg_h5_fail(h5, error,
                          "/model: attribute window is %llu, but the model has windows of %u samples",
                          (unsigned long long)window, names->length);
    LG_TRY(lg_sensing_get(h5, names, error));
    if (names->class_name != NULL) return LG_OK;
    names->class_name = lg_alloc(h5->context, names->classes, sizeof *names->class_name);
    if (names->class_name == NULL) return lg_h5_no_memory(h5, error);
    for (uint32_t c = 0; c < names->classes; c++)
        (void)snprintf(names->class_name[c], LG_SERIES_NAME, "%u", c);
    return LG_OK;
}
