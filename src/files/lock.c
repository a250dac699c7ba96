/* Locks on outputs. Only one process at a time works on a file or folder. A second process gets an error,
 * which names the first one. The kernel holds the lock (flock) on a small file in the folder of the output,
 * and releases it when the process ends. Over NFS the server holds it. The file contains the name of the
 * process.
 *
 * A process writes and locks this file before it gives the file its name, and never changes it after that. If
 * a file has the name of a lock and other content, it belongs to the user: lg_lock_take does not touch it,
 * and fails. A killed process leaves its file without a lock. The next process removes it and makes its own.
 * */
#define _DEFAULT_SOURCE /* flock */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/h5.h"
#include "files/temporary.h"

enum { TRIES = 1000, WORDS = 400 };
static const char head[] = "This is a lock of liegrad. It is removed when the output is written.\nprocess ";
enum { HEAD = sizeof head - 1, NAMED = HEAD - 8 }; /* the words "process N on HOST: ..." begin at NAMED */

/* For each descriptor: whether it holds a lock. A forked child has copies of these descriptors. A child that
 * outlived its killed parent would hold the lock until it ends. So a child closes its copies at once. */
static _Atomic bool holding[4096];

static void in_child(void) {
    for (int fd = 0; fd < (int)LG_COUNT(holding); fd++)
        if (holding[fd]) holding[fd] = close(fd) != 0;
}

static void watch_forks(void) {
    (void)pthread_atfork(NULL, NULL, in_child);
}

static void note(int fd, bool holds) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    (void)pthread_once(&once, watch_forks);
    if (fd < (int)LG_COUNT(holding)) holding[fd] = holds;
}

/* ---- one attempt ---- */

typedef enum held { HELD_HERE, HELD_ELSEWHERE, HELD_GONE, HELD_NEVER, HELD_FOREIGN } held;

typedef struct taking {
    const char *target, *words;
    int folder, fd;
    int code; /* for HELD_NEVER: errno; 0: the file system has no locks */
    char name[LG_OWN_NAME], holder[HEAD + WORDS];
} taking;

static held never(taking *t, int code) {
    t->code = code;
    return HELD_NEVER;
}

/* Locks the file. NFS allows only a shared lock if the file was not opened for writing. */
static held hold(taking *t, int fd, bool writable) {
    if (flock(fd, (writable ? LOCK_EX : LOCK_SH) | LOCK_NB) == 0) return HELD_HERE;
    return errno == EWOULDBLOCK ? HELD_ELSEWHERE : never(t, 0);
}

/* Reads who holds the lock: the head and one line. Anything else is HELD_FOREIGN. */
static held read_holder(taking *t, int fd) {
    size_t n = 0;
    ssize_t got;
    while ((got = pread(fd, t->holder + n, sizeof t->holder - n, (off_t)n)) > 0) n += (size_t)got;
    if (got < 0) return never(t, errno);
    if (n <= HEAD || n == sizeof t->holder || memcmp(t->holder, head, HEAD) != 0 ||
        memchr(t->holder + HEAD, '\n', n - HEAD) != t->holder + n - 1)
        return HELD_FOREIGN;
    t->holder[n - 1] = '\0';
    (void)lg_tamed(t->holder + HEAD);
    return HELD_ELSEWHERE;
}

/* Looks at the opened file that has the name of the lock. A lock that nobody holds is removed. */
static held look_at(taking *t, int fd, bool writable) {
    held got = read_holder(t, fd);
    if (got == HELD_ELSEWHERE) got = hold(t, fd, writable);
    if (got == HELD_FOREIGN || got == HELD_NEVER) return got;
    if (!lg_has_name(fd, t->folder, t->name)) return HELD_GONE;
    if (got == HELD_ELSEWHERE) return got;
    return unlinkat(t->folder, t->name, 0) == 0 || errno == ENOENT ? HELD_GONE : never(t, 0);
}

/* Writes the locked file. It must survive a loss of power as a whole: half of it is not a lock. */
static int write_lock(int fd, const char *words) {
    char host[65] = "", text[HEAD + WORDS];
    (void)gethostname(host, sizeof host - 1);
    (void)snprintf(text, sizeof text - 1, "%s%ld on %s: %s", head, (long)getpid(), host, words);
    (void)lg_tamed(text + HEAD);
    (void)strcat(text, "\n");
    const int code = lg_write_all(fd, text, strlen(text));
    return code != 0 ? code : lg_sync(fd);
}

/* Makes the file under a temporary name, and renames it. */
static held make(taking *t) {
    char name[LG_OWN_NAME];
    t->fd = lg_make_temporary(t->folder, t->target, false, name);
    if (t->fd < 0) return never(t, errno);
    held got = hold(t, t->fd, true);
    const int code = got == HELD_HERE ? write_lock(t->fd, t->words) : 0;
    if (code != 0) got = never(t, code);
    if (got == HELD_HERE && lg_give_name(t->folder, name, t->name)) return got;
    /* Some file systems can neither rename without replacing nor link. Commands run without locks there. */
    const bool cannot_link = errno == EPERM || errno == ENOSYS || errno == EOPNOTSUPP;
    if (got == HELD_HERE) got = errno == EEXIST ? HELD_GONE : never(t, cannot_link ? 0 : errno);
    (void)unlinkat(t->folder, name, 0);
    (void)close(t->fd);
    return got;
}

static held attempt(taking *t) {
    const int flags = O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;
    struct stat about;
    if (fstatat(t->folder, t->name, &about, AT_SYMLINK_NOFOLLOW) != 0)
        return errno == ENOENT ? make(t) : never(t, errno);
    if (!S_ISREG(about.st_mode)) return HELD_FOREIGN;
    int fd = openat(t->folder, t->name, O_RDWR | flags);
    const bool writable = fd >= 0;
    if (!writable && errno == EACCES) fd = openat(t->folder, t->name, O_RDONLY | flags);
    if (fd < 0) return errno == ENOENT ? HELD_GONE : never(t, errno);
    const held got = look_at(t, fd, writable);
    (void)close(fd);
    return got;
}

/* ---- taking and releasing ---- */

static held take(taking *t) {
    t->folder = lg_open_folder(t->target);
    if (t->folder < 0) return never(t, errno);
    /* Temporary files of killed writers may fill the disk, and the lock file needs a few bytes. */
    lg_sweep(t->folder, t->target);
    held got = HELD_GONE;
    for (int i = 0; i < TRIES && got == HELD_GONE; i++) got = attempt(t);
    (void)close(t->folder);
    return got;
}

static lg_status refuse(const taking *t, held got, const char *name, lg_error *error) {
    const char *target = lg_shown_path(t->target), *lock = lg_shown_path(name);
    if (got == HELD_ELSEWHERE)
        return lg_fail(error, LG_FILE, "%s: is being written by %s", target, t->holder + NAMED);
    if (got == HELD_FOREIGN)
        return lg_fail(error, LG_FILE,
                       "%s: cannot be written: its lock would be %s, but that is not a lock: move it away",
                       target, lock);
    return lg_fail(error, lg_status_of(t->code), "%s: cannot be written: its lock %s: %s", target, lock,
                   got == HELD_NEVER ? strerror(t->code) : "is made and removed again and again");
}

lg_status lg_lock_take(const lg_context *context, const char *target, const char *words, lg_lock *out,
                       lg_error *error) {
    LG_NEEDS(error, target, words, out);
    taking t = {.target = target, .words = words};
    const size_t length = lg_folder_length(target);
    lg_lock made = {.context = context, .process = (long)getpid()};
    made.name = lg_alloc(context, length + LG_OWN_NAME, 1);
    if (made.name == NULL) return lg_no_memory_for(target, error);
    lg_own_name(target, "lock", t.name);
    (void)memcpy(made.name, target, length);
    (void)strcpy(made.name + length, t.name);
    lg_status status = lg_refuse_own_name(target, error);
    const held got = status == LG_OK ? take(&t) : HELD_NEVER;
    if (got == HELD_HERE) {
        note(made.fd = t.fd, true);
        *out = made;
        return LG_OK;
    }
    *out = (lg_lock){.fd = -1};
    if (status == LG_OK && (got != HELD_NEVER || t.code != 0)) status = refuse(&t, got, made.name, error);
    lg_free(context, made.name);
    return status;
}

void lg_lock_release(lg_lock *lock) {
    if (lock->fd >= 0 && lock->process == (long)getpid()) {
        if (lg_has_name(lock->fd, AT_FDCWD, lock->name)) (void)unlink(lock->name);
        note(lock->fd, false);
        (void)close(lock->fd);
    }
    lg_free(lock->context, lock->name);
    *lock = (lg_lock){.fd = -1};
}
