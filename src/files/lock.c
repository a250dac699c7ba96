/* Locks on outputs. One process at a time works on a file or folder; another process that wants to is told
 * who holds the lock. The lock is a POSIX record lock on a small file beside the output. The kernel releases
 * it when the process dies, child processes do not inherit it, and NFS passes it on to the server. The small
 * file says who holds the lock. A killed process leaves this file behind, unlocked, and the next process
 * takes it over. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/h5.h"

enum { TRIES = 1000, WORDS = 400 };

typedef enum held { HELD_HERE, HELD_ELSEWHERE, HELD_GONE, HELD_NEVER } held;

static struct flock whole_file(void) {
    return (struct flock){.l_type = F_WRLCK, .l_whence = SEEK_SET};
}

/* True if `name` still refers to the opened file, so nobody removed the file before it was locked. */
static bool has_name(int fd, const char *name) {
    struct stat of_file, of_name;
    return fstat(fd, &of_file) == 0 && lstat(name, &of_name) == 0 && of_file.st_dev == of_name.st_dev &&
           of_file.st_ino == of_name.st_ino;
}

/* Tries to lock the file. HELD_NEVER means that the file system has no locks. HELD_GONE means that the file
 * was removed in between. */
static held hold(int fd, const char *name) {
    struct flock lock = whole_file();
    if (fcntl(fd, F_SETLK, &lock) != 0)
        return errno == EACCES || errno == EAGAIN ? HELD_ELSEWHERE : HELD_NEVER;
    return has_name(fd, name) ? HELD_HERE : HELD_GONE;
}

/* For a lock file of another user, which can be read but not written. If nobody holds the lock, the file is
 * removed. */
static held look_at(int fd, const char *name) {
    struct flock lock = whole_file();
    if (fcntl(fd, F_GETLK, &lock) != 0) return HELD_NEVER;
    if (lock.l_type != F_UNLCK) return HELD_ELSEWHERE;
    return unlink(name) == 0 || errno == ENOENT ? HELD_GONE : HELD_NEVER;
}

/* Gets what the holder wrote into the file, with unprintable bytes replaced. If the file is empty, gets the
 * number of the process that holds the lock, where the system knows it. */
static void read_holder(int fd, char out[WORDS]) {
    struct flock lock = whole_file();
    const ssize_t n = pread(fd, out, WORDS - 1, 0);
    size_t length = 0;
    while (n > 0 && length < (size_t)n && out[length] != '\n') length++;
    out[length] = '\0';
    for (char *c = out; *c != '\0'; c++)
        if ((unsigned char)*c < ' ' || *c == 0x7f) *c = '?';
    if (length > 0) return;
    if (fcntl(fd, F_GETLK, &lock) == 0 && lock.l_type != F_UNLCK && lock.l_pid > 0)
        (void)snprintf(out, WORDS, "process %ld", (long)lock.l_pid);
    else
        (void)snprintf(out, WORDS, "another process");
}

/* Writes who holds the lock. If the disk is full the file stays empty; the lock is held nevertheless. */
static void write_holder(int fd, const char *words) {
    char host[65] = "", text[WORDS];
    (void)gethostname(host, sizeof host - 1);
    const int n = snprintf(text, sizeof text - 1, "process %ld on %s: %s", (long)getpid(), host, words);
    size_t length = n < (int)sizeof text - 1 ? (size_t)n : sizeof text - 2;
    text[length++] = '\n';
    bool whole = ftruncate(fd, 0) == 0 && pwrite(fd, text, length, 0) == (ssize_t)length;
    if (!whole) whole = ftruncate(fd, 0) == 0;
    (void)whole;
}

/* One attempt to take the lock. *fd stays open only if the lock is now held here. */
static held attempt(const char *name, const char *words, int *fd, char holder[WORDS], int *code) {
    const int flags = O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;
    *fd = open(name, O_RDWR | O_CREAT | flags, 0666);
    const bool mine = *fd >= 0;
    *code = errno;
    if (!mine && *code == EACCES) *fd = open(name, O_RDONLY | flags);
    if (*fd < 0) return HELD_NEVER;
    *code = 0;
    const held got = mine ? hold(*fd, name) : look_at(*fd, name);
    if (got == HELD_ELSEWHERE) read_holder(*fd, holder);
    if (got == HELD_HERE) write_holder(*fd, words);
    if (got != HELD_HERE) (void)close(*fd);
    return got;
}

lg_status lg_lock_take(const lg_context *context, const char *target, const char *words, lg_lock *out,
                       lg_error *error) {
    if (target == NULL || words == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the lock's target, its words or `out` is NULL");
    const size_t size = strlen(target) + sizeof ".lock";
    char holder[WORDS];
    int code = 0;
    lg_lock made = {.context = context, .fd = -1, .process = (long)getpid()};
    made.name = lg_alloc(context, size, 1);
    if (made.name == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(target));
    (void)snprintf(made.name, size, "%s.lock", target);
    held got = HELD_GONE;
    for (int i = 0; i < TRIES && got == HELD_GONE; i++)
        got = attempt(made.name, words, &made.fd, holder, &code);
    if (got == HELD_HERE) {
        *out = made;
        return LG_OK;
    }
    lg_free(context, made.name);
    *out = (lg_lock){.fd = -1};
    if (got == HELD_ELSEWHERE)
        return lg_fail(error, LG_FILE, "%s: is being written by %s", lg_shown_path(target), holder);
    if (got == HELD_NEVER && code == 0) return LG_OK;
    return lg_fail(error, LG_FILE, "%s: cannot be written: its lock %s.lock: %s", lg_shown_path(target),
                   lg_shown_path(target), code != 0 ? strerror(code) : "is made and removed again and again");
}

void lg_lock_release(lg_lock *lock) {
    if (lock->fd >= 0 && lock->process == (long)getpid()) (void)unlink(lock->name);
    if (lock->fd >= 0) (void)close(lock->fd);
    lg_free(lock->context, lock->name);
    *lock = (lg_lock){.fd = -1};
}
