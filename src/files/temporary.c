/* Temporary files and folders. The process that writes one holds a lock on it (flock, which the kernel
 * releases when the process dies). So the remains of a killed process can be told from a file that is being
 * written. */
#define _DEFAULT_SOURCE /* for flock */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/h5.h"

enum { ROOM = 64 }; /* bytes for the suffix of the name after the target */

/* ---- removing what killed processes left ---- */

/* True if `name` is `base`.tmp-PID-i. */
static bool is_temporary(const char *name, const char *base) {
    const size_t length = strlen(base);
    long pid;
    unsigned attempt;
    int end = 0;
    if (strncmp(name, base, length) != 0) return false;
    return sscanf(name + length, ".tmp-%ld-%u%n", &pid, &attempt, &end) == 2 && name[length + end] == '\0';
}

/* Removes a folder and its files. Such folders have no subfolders. */
static void remove_folder(int folder, const char *path) {
    DIR *open_folder = fdopendir(dup(folder));
    const struct dirent *entry;
    while (open_folder != NULL && (entry = readdir(open_folder)) != NULL)
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
            (void)unlinkat(folder, entry->d_name, 0);
    if (open_folder != NULL) (void)closedir(open_folder);
    (void)rmdir(path);
}

static void remove_left(const char *path) {
    struct stat about;
    int fd = open(path, O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 && errno == EISDIR) fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return;
    if (flock(fd, LOCK_EX | LOCK_NB) == 0 && fstat(fd, &about) == 0) {
        if (S_ISDIR(about.st_mode))
            remove_folder(fd, path);
        else if (S_ISREG(about.st_mode))
            (void)unlink(path);
    }
    (void)close(fd);
}

/* Removes what killed processes left for this target. `path` is a buffer of `size` bytes for the names. */
static void sweep(const char *target, char *path, size_t size) {
    const char *slash = strrchr(target, '/'), *base = slash != NULL ? slash + 1 : target;
    const size_t length = (size_t)(base - target);
    (void)snprintf(path, size, "%.*s", (int)length, target);
    DIR *folder = opendir(length > 0 ? path : ".");
    const struct dirent *entry;
    while (folder != NULL && (entry = readdir(folder)) != NULL)
        if (is_temporary(entry->d_name, base) && strlen(entry->d_name) < size - length) {
            (void)strcpy(path + length, entry->d_name);
            remove_left(path);
        }
    if (folder != NULL) (void)closedir(folder);
}

void lg_temporary_sweep(const lg_context *context, const char *target) {
    const size_t size = strlen(target) + ROOM;
    char *path = lg_alloc(context, size, 1);
    if (path != NULL) sweep(target, path, size);
    lg_free(context, path);
}

/* ---- creating a temporary file or folder ---- */

static int create(const char *name, bool folder) {
    if (!folder) return open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    return mkdir(name, 0777) == 0 ? open(name, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
}

/* Locks the new file. Returns false if another process removed it before it was locked. If the file system
 * has no locks, this is not a failure. */
static bool hold(int fd) {
    struct stat about;
    if (flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
    return fstat(fd, &about) == 0 && about.st_nlink > 0;
}

lg_status lg_temporary_create(const lg_context *context, const char *target, bool folder, lg_temporary *out,
                              lg_error *error) {
    LG_NEEDS(error, target, out);
    const size_t size = strlen(target) + ROOM;
    int code = 0;
    lg_temporary made = {.context = context, .fd = -1, .name = lg_alloc(context, size, 1)};
    if (made.name == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(target));
    sweep(target, made.name, size);
    for (unsigned attempt = 0; attempt < 1000; attempt++) {
        (void)snprintf(made.name, size, "%s.tmp-%ld-%u", target, (long)getpid(), attempt);
        made.fd = create(made.name, folder);
        code = errno;
        if (made.fd >= 0 && hold(made.fd)) {
            *out = made;
            return LG_OK;
        }
        if (made.fd < 0 && code != EEXIST) break;
        if (made.fd >= 0) (void)close(made.fd);
    }
    lg_free(context, made.name);
    return lg_fail(error, LG_FILE, "%s: cannot be written: %s", lg_shown_path(target), strerror(code));
}

/* ---- giving the file its name ---- */

/* Syncs the folder of the target. Failures are ignored, because some file systems cannot sync a folder and
 * the file has been renamed already. */
static void sync_folder(const char *target, char *buffer) {
    const char *slash = strrchr(target, '/');
    size_t length = slash == NULL ? 0 : (size_t)(slash - target) + 1;
    memcpy(buffer, target, length);
    buffer[length] = '\0';
    int fd = open(length == 0 ? "." : buffer, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return;
    (void)fsync(fd);
    (void)close(fd);
}

/* Closes a duplicate of the descriptor. NFS reports a failed write only when a descriptor is closed, and this
 * must be known before the rename. `fd` itself must stay open, because it holds the lock. */
static int close_copy(int fd) {
    const int copy = dup(fd);
    return copy < 0 || close(copy) == 0 || errno == EINTR ? 0 : errno;
}

lg_status lg_temporary_publish(lg_temporary *temporary, const char *target, lg_error *error) {
    LG_NEEDS(error, temporary, target);
    int code = fsync(temporary->fd) == 0 || errno == EINVAL || errno == EROFS ? 0 : errno;
    if (code == 0) code = close_copy(temporary->fd);
    if (code == 0 && rename(temporary->name, target) != 0) code = errno;
    if (code != 0)
        return lg_fail(error, LG_FILE, "%s: cannot be written: %s", lg_shown_path(target), strerror(code));
    sync_folder(target, temporary->name);
    return LG_OK;
}

void lg_temporary_end(lg_temporary *temporary) {
    if (temporary->fd >= 0) (void)close(temporary->fd);
    lg_free(temporary->context, temporary->name);
    *temporary = (lg_temporary){.fd = -1};
}
