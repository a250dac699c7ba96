/* Writes a file completely or not at all: writes a temporary file, then lg_temporary_publish renames it. */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "files/h5.h"
#include "files/temporary.h"

/* Writes all bytes. Beyond RLIMIT_FSIZE the kernel sends SIGXFSZ, which kills a process by default. Here the
 * signal is blocked for this thread and consumed, so that `write` fails with EFBIG, whatever signal handling
 * the process has. */
int lg_write_all(int fd, const void *data, size_t bytes) {
    const char *from = data;
    sigset_t limit, before, pending;
    sigemptyset(&limit);
    sigaddset(&limit, SIGXFSZ);
    sigpending(&pending);
    bool was_pending = sigismember(&pending, SIGXFSZ) == 1;
    int code = 0;
    (void)pthread_sigmask(SIG_BLOCK, &limit, &before);
    while (bytes > 0 && code == 0) {
        ssize_t n = write(fd, from, bytes < (1u << 30) ? bytes : 1u << 30);
        if (n > 0)
            from += n, bytes -= (size_t)n;
        else if (n == 0)
            code = ENOSPC;
        else if (errno != EINTR)
            code = errno;
    }
    if (code == EFBIG && !was_pending) {
        struct timespec none = {0, 0};
        while (sigtimedwait(&limit, NULL, &none) < 0 && errno == EINTR) continue;
    }
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    return code;
}

static lg_status write_temporary(const char *path, lg_temporary *to, const struct stat *old, const void *data,
                                 size_t bytes, lg_error *error) {
    int code = lg_write_all(to->fd, data, bytes);
    if (code == 0 && old != NULL && fchmod(to->fd, old->st_mode & 0777) != 0) code = errno;
    const lg_status status =
        code == 0 ? lg_temporary_publish(to, path, error) : lg_cannot_write(path, code, error);
    if (status != LG_OK) (void)unlink(to->name);
    return status;
}

lg_status lg_file_write(const lg_context *context, const char *path, const void *data, size_t bytes,
                        lg_error *error) {
    if (path == NULL || *path == '\0' || (data == NULL && bytes > 0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the file's name is missing, or its data are NULL");
    struct stat old;
    bool exists = stat(path, &old) == 0;
    if (exists && !S_ISREG(old.st_mode))
        return lg_fail(error, LG_FILE, "%s: exists and is not a regular file", lg_shown_path(path));
    LG_TRY(lg_may_replace(context, path, data, bytes, error));
    lg_temporary to;
    LG_TRY(lg_temporary_create(context, path, false, &to, error));
    const lg_status status = write_temporary(path, &to, exists ? &old : NULL, data, bytes, error);
    lg_temporary_end(&to);
    return status;
}
