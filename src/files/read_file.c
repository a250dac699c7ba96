/* Opening and reading input files. */
#include <string.h>
#include <sys/stat.h>

#include "core/core.h"
#include "files/h5.h"
#include "files/read_file.h"

lg_status lg_read_open(const char *path, FILE **out, uint64_t *bytes, lg_error *error) {
    const char *shown = lg_shown_path(path);
    struct stat about;
    if (stat(path, &about) != 0)
        return lg_fail(error, errno == ENOENT || errno == ENOTDIR ? LG_NOT_FOUND : LG_FILE, "%s: %s", shown,
                       strerror(errno));
    if (!S_ISREG(about.st_mode))
        return lg_fail(error, LG_FILE, "%s: is not a regular file; save the output of a pipe in a file first",
                       shown);
    FILE *file = fopen(path, "rb");
    if (file == NULL)
        return lg_fail(error, lg_status_of(errno), "%s: cannot be read: %s", shown, strerror(errno));
    *out = file;
    *bytes = (uint64_t)about.st_size;
    return LG_OK;
}

lg_status lg_file_is_h5(const char *path, bool *is, lg_error *error) {
    char first[sizeof LG_H5_SIGNATURE - 1];
    FILE *from = NULL;
    uint64_t bytes;
    LG_NEEDS(error, path, is);
    *is = false;
    LG_TRY(lg_read_open(path, &from, &bytes, error));
    for (uint64_t at = 0; !*is && at + sizeof first <= bytes; at = at == 0 ? 512 : 2 * at)
        *is = fseeko(from, (off_t)at, SEEK_SET) == 0 && fread(first, 1, sizeof first, from) == sizeof first &&
              memcmp(first, LG_H5_SIGNATURE, sizeof first) == 0;
    const bool broken = ferror(from) != 0;
    (void)fclose(from);
    return broken ? lg_fail(error, LG_FILE, "%s: cannot be read", lg_shown_path(path)) : LG_OK;
}

lg_status lg_read_first(const char *path, void *out, size_t room, size_t *got, lg_error *error) {
    FILE *from = NULL;
    uint64_t bytes;
    LG_TRY(lg_read_open(path, &from, &bytes, error));
    *got = fread(out, 1, room, from);
    const bool broken = ferror(from) != 0;
    (void)fclose(from);
    return broken ? lg_fail(error, LG_FILE, "%s: cannot be read", lg_shown_path(path)) : LG_OK;
}
