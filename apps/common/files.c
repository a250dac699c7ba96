/* Text files that appear whole or not at all. */
#include "common/app.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static lg_status fail(lg_error *error, lg_status status, const char *path, const char *what, int number) {
    if (error != NULL) {
        error->status = status;
        (void)snprintf(error->message, sizeof error->message, "%s: %s%s%s", path, what,
                       number != 0 ? ": " : "", number != 0 ? strerror(number) : "");
    }
    return status;
}

void app_file_begin(app_file *file, const char *path) {
    *file = (app_file){.path = path};
    file->stream = open_memstream(&file->text, &file->length);
    if (file->stream == NULL) {
        (void)fputs("out of memory\n", stderr);
        exit(APP_EXIT_MEMORY);
    }
}

static bool write_all(int fd, const char *text, size_t length) {
    while (length > 0) {
        const ssize_t n = write(fd, text, length);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        text += n;
        length -= (size_t)n;
    }
    return true;
}

lg_status app_file_end(app_file *file, lg_error *error) {
    if (fclose(file->stream) != 0) {
        free(file->text);
        return fail(error, LG_OUT_OF_MEMORY, file->path, "out of memory", 0);
    }
    char *temporary = app_format("%s.%ld.tmp", file->path, (long)getpid());
    lg_status status = LG_OK;
    const int fd = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0) {
        status = fail(error, LG_FILE, file->path, "cannot be written", errno);
    } else {
        bool written = write_all(fd, file->text, file->length) && fsync(fd) == 0;
        int number = errno;
        if (close(fd) != 0 && written) {
            written = false;
            number = errno;
        }
        if (written && rename(temporary, file->path) != 0) {
            written = false;
            number = errno;
        }
        if (!written) {
            (void)unlink(temporary);
            status = fail(error, LG_FILE, file->path, "cannot be written", number);
        }
    }
    free(temporary);
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
        return fail(error, LG_FILE, path, "cannot be written: it is a folder", 0);
    char *folder = app_format("%s", path);
    char *slash = strrchr(folder, '/');
    if (slash == NULL)
        (void)strcpy(folder, path[0] != '\0' ? "." : "");
    else
        slash[slash == folder ? 1 : 0] = '\0';
    lg_status status = LG_OK;
    if (stat(folder, &information) != 0)
        status = fail(error, LG_FILE, path, "cannot be written", errno);
    else if (!S_ISDIR(information.st_mode))
        status = fail(error, LG_FILE, path, "cannot be written", ENOTDIR);
    else if (access(folder, W_OK | X_OK) != 0)
        status = fail(error, LG_FILE, path, "cannot be written", errno);
    free(folder);
    return status;
}

lg_status app_make_folder(const char *path, lg_error *error) {
    struct stat information;
    if (mkdir(path, 0777) == 0) return LG_OK;
    const int number = errno;
    if (number == EEXIST && stat(path, &information) == 0 && S_ISDIR(information.st_mode)) return LG_OK;
    return fail(error, LG_FILE, path, "the folder cannot be made", number);
}
