/* Temporary files and folders. The name of a temporary file holds the number that the file has in the file
 * system (its inode), so a file of somebody else is not taken for a temporary file, whatever its name. The
 * process that writes the file holds a lock on it (flock, which the kernel releases when the process dies).
 * A temporary file without a lock was left by a killed process.
 *
 * Another user who may write in the folder can rename a folder of this user to the name of a temporary
 * folder. So only empty folders are removed: what a killed export left in its folder stays.
 *
 * The number is known only when the file exists. Until then its name holds the time of its creation, and only
 * an empty file that was created at this time is taken for ours. */
#define _GNU_SOURCE /* flock, renameat2, O_PATH */
#include "files/h5.h"
#include "files/temporary.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* ---- names ---- */

size_t lg_folder_length(const char *target) {
    const char *slash = strrchr(target, '/');
    return slash != NULL ? (size_t)(slash - target) + 1 : 0;
}

void lg_own_name(const char *target, const char *ending, char out[LG_OWN_NAME]) {
    enum { LONGEST = 90 }; /* eCryptfs has the shortest limit: 143 bytes for a name */
    const char *base = target + lg_folder_length(target);
    char hash[LG_SHA256_TEXT];
    if (strlen(base) > LONGEST) {
        lg_sha256 sha;
        lg_sha256_init(&sha);
        lg_sha256_add(&sha, base, strlen(base));
        lg_sha256_finish(&sha, hash);
        base = hash;
    }
    (void)snprintf(out, LG_OWN_NAME, ".%s%sliegrad-%s", base, base[0] != '\0' ? "." : "", ending);
}

static void temporary_name(const char *target, uint64_t number, long process, char out[LG_OWN_NAME]) {
    char ending[64];
    (void)snprintf(ending, sizeof ending, "tmp-%" PRIu64 "-%ld", number, process);
    lg_own_name(target, ending, out);
}

lg_status lg_refuse_own_name(const char *target, lg_error *error) {
    const char *base = target + lg_folder_length(target);
    if (base[0] != '.' || strstr(base, ".liegrad-") == NULL) return LG_OK;
    return lg_fail(error, LG_FILE, "%s: cannot be written: locks and temporary files have such names",
                   lg_shown_path(target));
}

lg_status lg_cannot_write(const char *target, int code, lg_error *error) {
    return lg_fail(error, lg_status_of(code), "%s: cannot be written: %s", lg_shown_path(target),
                   strerror(code));
}

int lg_open_folder(const char *target) {
    char path[PATH_MAX] = ".";
    const size_t length = lg_folder_length(target);
    if (length >= sizeof path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    if (length > 0) (void)snprintf(path, sizeof path, "%.*s", (int)length, target);
    return open(path, O_PATH | O_DIRECTORY | O_CLOEXEC);
}

bool lg_has_name(int fd, int folder, const char *name) {
    struct stat of_file, of_name;
    return fstat(fd, &of_file) == 0 && fstatat(folder, name, &of_name, AT_SYMLINK_NOFOLLOW) == 0 &&
           of_file.st_dev == of_name.st_dev && of_file.st_ino == of_name.st_ino;
}

bool lg_give_name(int folder, const char *from, const char *to) {
    if (renameat2(folder, from, folder, to, RENAME_NOREPLACE) == 0) return true;
    if (errno == EEXIST || linkat(folder, from, folder, to, 0) != 0) return false; /* NFS can only link */
    (void)unlinkat(folder, from, 0);
    return true;
}

/* ---- removing what killed processes left ---- */

static int64_t nanoseconds(struct timespec t) {
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* Returns whether a file is a temporary file of this user. `number` is the number in its name. */
static bool is_ours(const struct stat *about, uint64_t number) {
    const bool is_folder = S_ISDIR(about->st_mode), is_file = S_ISREG(about->st_mode) && about->st_nlink == 1;
    if (about->st_uid != geteuid() || !(is_folder || is_file)) return false;
    if (about->st_ino == number) return true;
    const int64_t since = nanoseconds(about->st_mtim) - (int64_t)number;
    return (is_folder || about->st_size == 0) && llabs(since) < 1000000000;
}

/* Removes a temporary file or folder of this user that no process has locked. It is opened once and then used
 * by its descriptor, so another file that gets the same name in the meantime is not removed. */
static void remove_left(int folder, const char *name, uint64_t number) {
    struct stat about;
    if (fstatat(folder, name, &about, AT_SYMLINK_NOFOLLOW) != 0 || !is_ours(&about, number)) return;
    const bool is_folder = S_ISDIR(about.st_mode);
    const int fd = is_folder ? openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)
                             : openat(folder, name, O_WRONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0) return;
    if (flock(fd, LOCK_EX | LOCK_NB) == 0 && fstat(fd, &about) == 0 && is_ours(&about, number)) {
        if (lg_has_name(fd, folder, name)) (void)unlinkat(folder, name, is_folder ? AT_REMOVEDIR : 0);
    }
    (void)close(fd);
}

void lg_sweep(int folder, const char *target) {
    const int fd = openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *files = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *entry;
    char begin[LG_OWN_NAME], name[LG_OWN_NAME];
    lg_own_name(target, "tmp-", begin);
    const size_t length = strlen(begin);
    while (files != NULL && (entry = readdir(files)) != NULL) {
        uint64_t number;
        long process;
        if (strncmp(entry->d_name, begin, length) != 0) continue;
        if (sscanf(entry->d_name + length, "%" SCNu64 "-%ld", &number, &process) != 2) continue;
        temporary_name(target, number, process, name); /* entry->d_name may have more zeros or spaces */
        remove_left(folder, name, number);
    }
    if (files != NULL)
        (void)closedir(files);
    else if (fd >= 0)
        (void)close(fd);
}

/* ---- creating a temporary file or folder ---- */

static int create(int folder, const char *name, bool is_folder) {
    if (!is_folder) return openat(folder, name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (mkdirat(folder, name, 0777) != 0) return -1;
    return openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}

/* Locks the new file. Returns false if another process removed it before it was locked. If the file system
 * has no locks, this is not a failure. */
static bool hold(int fd, struct stat *about) {
    if (flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
    return fstat(fd, about) == 0 && about->st_nlink > 0;
}

int lg_make_temporary(int folder, const char *target, bool is_folder, char name[LG_OWN_NAME]) {
    char numbered[LG_OWN_NAME];
    for (int i = 0; i < 1000; i++) {
        struct timespec now;
        struct stat about;
        (void)clock_gettime(CLOCK_REALTIME, &now);
        temporary_name(target, (uint64_t)nanoseconds(now), (long)getpid(), name);
        const int fd = create(folder, name, is_folder);
        if (fd < 0 && errno != EEXIST) return -1;
        if (fd >= 0 && hold(fd, &about)) {
            temporary_name(target, about.st_ino, (long)getpid(), numbered);
            if (lg_give_name(folder, name, numbered)) (void)strcpy(name, numbered);
            return fd;
        }
        if (fd >= 0) (void)close(fd);
    }
    errno = EEXIST;
    return -1;
}

/* ---- what is open ---- */

/* Names of the open temporary files and folders, by descriptor. */
static const char *_Atomic open_names[4096];

static void note(int fd, const char *name) {
    if (fd >= 0 && fd < (int)LG_COUNT(open_names)) open_names[fd] = name;
}

/* A name ends with the process that made the file: a forked child removes none of its parent's. */
void lg_temporary_remove_all(void) {
    for (int fd = 0; fd < (int)LG_COUNT(open_names); fd++) {
        const char *name = open_names[fd];
        if (name == NULL || strtol(strrchr(name, '-') + 1, NULL, 10) != (long)getpid()) continue;
        if (lg_has_name(fd, AT_FDCWD, name)) (void)remove(name);
    }
}

bool lg_is_lost_link(const char *path) {
    struct stat about;
    return lstat(path, &about) == 0 && S_ISLNK(about.st_mode) && stat(path, &about) != 0;
}

static lg_status make(const lg_context *context, const char *target, bool folder, lg_temporary *out,
                      lg_error *error) {
    const size_t length = lg_folder_length(target);
    lg_temporary made = {.context = context, .fd = -1, .name = lg_alloc(context, length + LG_OWN_NAME, 1)};
    if (made.name == NULL) return lg_no_memory_for(target, error);
    (void)memcpy(made.name, target, length);
    const int above = lg_open_folder(target);
    if (above >= 0) {
        lg_sweep(above, target);
        made.fd = lg_make_temporary(above, target, folder, made.name + length);
    }
    const int code = errno;
    if (above >= 0) (void)close(above);
    if (made.fd >= 0) {
        note(made.fd, made.name);
        *out = made;
        return LG_OK;
    }
    lg_free(context, made.name);
    return lg_cannot_write(target, code, error);
}

/* The file that is replaced: the one to which a link leads, or the target. NULL without memory. */
static char *destination(const char *target) {
    char *real = realpath(target, NULL);
    return real != NULL || errno == ENOMEM ? real : strdup(target);
}

lg_status lg_temporary_create(const lg_context *context, const char *target, bool folder, lg_temporary *out,
                              lg_error *error) {
    LG_NEEDS(error, target, out);
    LG_TRY(lg_refuse_own_name(target, error));
    if (lg_is_lost_link(target))
        return lg_fail(error, LG_FILE, "%s: cannot be written: " LG_LOST_LINK, lg_shown_path(target));
    char *real = folder ? strdup(target) : destination(target);
    const lg_status status =
        real != NULL ? make(context, real, folder, out, error) : lg_no_memory_for(target, error);
    free(real);
    return status;
}

/* ---- giving the file its name ---- */

int lg_sync(int fd) {
    return fsync(fd) == 0 || errno == EINVAL || errno == EROFS ? 0 : errno;
}

/* Syncs the folder of the target. Failures are ignored, because some file systems cannot sync a folder and
 * the file has been renamed already. */
static void sync_folder(const char *target) {
    const int folder = lg_open_folder(target);
    const int fd = folder >= 0 ? openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    if (fd >= 0) (void)fsync(fd);
    if (fd >= 0) (void)close(fd);
    if (folder >= 0) (void)close(folder);
}

lg_status lg_temporary_publish(lg_temporary *temporary, const char *target, lg_error *error) {
    LG_NEEDS(error, temporary, target);
    int code = lg_sync(temporary->fd);
    /* NFS reports a failed write only when a descriptor is closed, and this must be known before the rename.
     * The descriptor itself must stay open, because it holds the lock. */
    const int copy = code == 0 ? dup(temporary->fd) : -1;
    if (copy >= 0 && close(copy) != 0 && errno != EINTR) code = errno;
    char *real = destination(target);
    if (code == 0 && (real == NULL || rename(temporary->name, real) != 0)) code = errno;
    if (code == 0) sync_folder(real);
    free(real);
    return code == 0 ? LG_OK : lg_cannot_write(target, code, error);
}

void lg_temporary_end(lg_temporary *temporary) {
    note(temporary->fd, NULL);
    if (temporary->fd >= 0) (void)close(temporary->fd);
    lg_free(temporary->context, temporary->name);
    *temporary = (lg_temporary){.fd = -1};
}
