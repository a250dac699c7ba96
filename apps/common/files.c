/* Text files that appear whole or not at all. */
#include "common/app.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "liegrad/io.h"

void app_file_begin(app_file *file, const char *path) {
    *file = (app_file){.path = path};
    file->stream = open_memstream(&file->text, &file->length);
    if (file->stream == NULL) {
        (void)fputs("out of memory\n", stderr);
        exit(APP_EXIT_MEMORY);
    }
}

lg_status app_file_end(app_file *file, lg_error *error) {
    const bool whole = fclose(file->stream) == 0;
    const lg_status status = whole ? lg_file_write(NULL, file->path, file->text, file->length, error)
                                   : app_error(error, LG_OUT_OF_MEMORY, "%s: out of memory", file->path);
    free(file->text);
    return status;
}

void app_file_discard(app_file *file) {
    (void)fclose(file->stream);
    free(file->text);
}

lg_status app_check_writable(const char *path, lg_error *error) {
    struct stat information;
    if (stat(path, &information) == 0 && S_ISDIR(information.st_mode))
        return app_error(error, LG_FILE, "%s: cannot be written: it is a folder", path);
    char *folder = app_format("%s", path);
    char *slash = strrchr(folder, '/');
    if (slash == NULL)
        (void)strcpy(folder, path[0] != '\0' ? "." : "");
    else
        slash[slash == folder ? 1 : 0] = '\0';
    lg_status status = LG_OK;
    if (stat(folder, &information) != 0)
        status = app_error(error, LG_FILE, "%s: cannot be written: %s", path, strerror(errno));
    else if (!S_ISDIR(information.st_mode))
        status = app_error(error, LG_FILE, "%s: cannot be written: %s", path, strerror(ENOTDIR));
    else if (access(folder, W_OK | X_OK) != 0)
        status = app_error(error, LG_FILE, "%s: cannot be written: %s", path, strerror(errno));
    free(folder);
    return status;
}

lg_status app_make_folder(const char *path, lg_error *error) {
    struct stat information;
    if (mkdir(path, 0777) == 0) return LG_OK;
    const int number = errno;
    if (number == EEXIST && stat(path, &information) == 0 && S_ISDIR(information.st_mode)) return LG_OK;
    return app_error(error, LG_FILE, "%s: the folder cannot be made: %s", path, strerror(number));
}
