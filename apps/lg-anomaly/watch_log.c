/* The file of verdicts. Each line is appended by one write call. The file is opened again after logrotate has
 * renamed it. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/temporary.h"
#include "lg-anomaly/watch.h"

enum { LONGEST_LINE = 1 << 16 };

/* Cuts off the unfinished last line of a process that was killed. LG_FORMAT: the file does not consist of
 * lines. */
static lg_status end_line(const watch_log *log, int fd, lg_error *error) {
    struct stat about;
    APP_FREE char *text = app_alloc(LONGEST_LINE, 1);
    if (fstat(fd, &about) != 0 || about.st_size == 0) return LG_OK;
    const off_t from = about.st_size > LONGEST_LINE ? about.st_size - LONGEST_LINE : 0;
    ssize_t n = pread(fd, text, LONGEST_LINE, from);
    while (n > 0 && text[n - 1] != '\n') n--;
    if (n <= 0 && from > 0) return lg_fail(error, LG_FORMAT, "%s: is not a text file", log->path);
    if (n >= 0 && from + n < about.st_size && ftruncate(fd, from + n) != 0)
        return lg_fail(error, LG_FILE, "%s: %s", log->path, strerror(errno));
    return LG_OK;
}

/* The file must be empty or begin as a log does. No other file is changed. */
static lg_status open_file(const watch_log *log, int *out, lg_error *error) {
    struct stat about;
    const int fd = open(log->path, O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (fd < 0) return lg_fail(error, LG_FILE, "%s: %s", log->path, strerror(errno));
    const bool begun = fstat(fd, &about) != 0 || (S_ISREG(about.st_mode) && about.st_size > 0),
               other = begun && !app_begins(log->path, log->begin, strlen(log->begin), 1);
    const lg_status status =
        !other ? end_line(log, fd, error)
               : lg_fail(error, LG_FILE,
                         "%s: exists and is not a log of such verdicts: remove it, or choose another file",
                         log->path);
    if (status == LG_OK)
        *out = fd;
    else
        (void)close(fd);
    return status;
}

void watch_log_open(watch_log *log, const app *self, const char *path, const char *begin) {
    *log = (watch_log){.app = self, .path = path, .begin = begin, .fd = -1, .stream = stdout};
    if (path == NULL) return;
    APP_MUST_FILE(self, path, open_file(log, &log->fd, &error));
    log->stream = open_memstream(&log->text, &log->length);
    if (log->stream == NULL) app_out_of_memory();
    app_reopen_on_hangup();
}

void watch_log_turn(watch_log *log) {
    lg_error error = {LG_OK, ""};
    int fd = -1;
    if (log->fd < 0 || !app_reopen_asked()) return;
    if (open_file(log, &fd, &error) != LG_OK) {
        app_warn(log->app, "the log cannot be opened again and is written to the old file: %s",
                 error.message);
        return;
    }
    if (close(log->fd) != 0 && errno != EINTR) app_warn(log->app, "%s: %s", log->path, strerror(errno));
    log->fd = fd;
}

void watch_log_put(watch_log *log) {
    if (log->fd < 0) return;
    struct stat about;
    if (fflush(log->stream) != 0) app_out_of_memory();
    const bool file = fstat(log->fd, &about) == 0 && S_ISREG(about.st_mode),
               named = (file ? about.st_size > 0 : log->named) || strchr(log->begin, '\n') == NULL;
    /* The text has the end of an earlier, longer line after `length`. */
    APP_FREE char *text = app_format("%s%.*s", named ? "" : log->begin, (int)log->length, log->text);
    /* Everything or nothing is appended. If the disk is full, the part that was written is cut off, unless
     * somebody else has shortened the file meanwhile. */
    const off_t before = lseek(log->fd, 0, SEEK_END);
    const int code = lg_write_all(log->fd, text, strlen(text));
    if (code != 0 && fstat(log->fd, &about) == 0 && about.st_size > before && before >= 0)
        (void)!ftruncate(log->fd, before);
    if (code != 0 && !log->failing)
        app_warn(log->app, "%s: verdicts cannot be written: %s", log->path, strerror(code));
    if (code == 0 && log->failing) app_warn(log->app, "%s: verdicts are written again", log->path);
    log->named = log->named || code == 0;
    log->lost += code != 0;
    log->failing = code != 0;
    if (fseeko(log->stream, 0, SEEK_SET) != 0) app_out_of_memory();
}

void watch_log_close(watch_log *log) {
    if (log->fd < 0) return;
    (void)fclose(log->stream);
    free(log->text);
    if (close(log->fd) != 0 && errno != EINTR)
        app_stop(log->app, LG_FILE, "%s: %s", log->path, strerror(errno));
    if (log->lost > 0)
        app_stop(log->app, LG_FILE, "%s: %llu verdicts could not be written", log->path,
                 (unsigned long long)log->lost);
}
