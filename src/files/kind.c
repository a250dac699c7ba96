/* The kind of a file, from its attribute `kind`. */
#include <string.h>

#include "liegrad/model.h"

#include "core/core.h"
#include "files/h5.h"

lg_status lg_h5_kind(lg_h5 *h5, char text[LG_H5_KIND], lg_error *error) {
    text[0] = '\0';
    LG_TRY(lg_h5_check_format(h5, NULL, true, error));
    if (!lg_h5_has_attribute(h5, "", "format") || lg_h5_is_ours(h5))
        (void)lg_h5_text(h5, "", "kind", text, LG_H5_KIND, NULL);
    (void)lg_tamed(text);
    return LG_OK;
}

static lg_status read_format(void *user, lg_h5 *h5, lg_error *error) {
    *(bool *)user = lg_h5_is_ours(h5);
    return LG_OK;
}

lg_status lg_file_is_ours(const lg_context *context, const char *path, bool *ours, lg_error *error) {
    LG_NEEDS(error, path, ours);
    *ours = false;
    return lg_h5_read(context, path, NULL, read_format, ours, error);
}

static lg_status read_kind(void *user, lg_h5 *h5, lg_error *error) {
    return lg_h5_kind(h5, user, error);
}

lg_status lg_model_file_kind(const lg_context *context, const char *path, const lg_read_options *options,
                             char *kind, size_t size, lg_error *error) {
    char text[LG_H5_KIND] = "";
    if (path == NULL || kind == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the file's name or the memory for its kind is NULL");
    LG_TRY(lg_h5_read(context, path, options, read_kind, text, error));
    const size_t length = strlen(text);
    if (length >= size)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the memory for the kind is too small for '%s'",
                       lg_shown_path(path), text);
    memcpy(kind, text, length + 1);
    return LG_OK;
}
