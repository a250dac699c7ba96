/* HDF5 1.10 crashes or loops on some damaged files, and a malicious file could do worse. Therefore a child
 * process reads the file first. The child may crash, and it can do nothing but read (sandbox.h). */
#define _DEFAULT_SOURCE /* for syscall */
#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <fcntl.h>
#include <unistd.h>

#ifdef __linux__
#include <sys/syscall.h>
#endif

#include "core/text.h"
#include "files/h5.h"
#include "files/memory.h"
#include "files/sandbox.h"

#if defined(LG_SANITIZED)
#define LG_LIMIT_MEMORY 0
#else
#define LG_LIMIT_MEMORY 1
#endif

void lg_read_options_init(lg_read_options *options) {
    *options = (lg_read_options){
        .size = sizeof *options, .probe = true, .probe_seconds = 20, .max_size = (uint64_t)8 << 30};
}

lg_status lg_read_options_resolve(const lg_read_options *options, lg_read_options *out, lg_error *error) {
    lg_read_options_init(out);
    if (options != NULL && options->size != sizeof *options)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the size of the read options is wrong: initialise them first");
    if (options != NULL) *out = *options;
    if (out->max_size > SIZE_MAX / 2) out->max_size = SIZE_MAX / 2; /* no array is larger */
    return LG_OK;
}

/* Lowers a resource limit. It never raises one. */
static bool limit(int resource, rlim_t value) {
    struct rlimit now;
    if (getrlimit(resource, &now) != 0) return false;
    if (now.rlim_max != RLIM_INFINITY && value > now.rlim_max) value = now.rlim_max;
    now.rlim_cur = value;
    now.rlim_max = value;
    return setrlimit(resource, &now) == 0;
}

/* Returns whether the parent has opened this file for reading. HDF5 may read the file through this
 * descriptor. */
static bool is_checked_file(int fd, const struct stat *file) {
    struct stat about;
    return fstat(fd, &about) == 0 && about.st_dev == file->st_dev && about.st_ino == file->st_ino &&
           (fcntl(fd, F_GETFL) & O_ACCMODE) == O_RDONLY;
}

/* Closes all descriptors of the parent except one of the file that is checked. Terminals and sockets would
 * be a way out of the sandbox. The child shares the place in an open file and its lock with the parent, and
 * could change them. Without /proc this function tries every number below 4096. */
static void close_inherited(int report, const struct stat *file) {
    enum { MOST = 4096 };
    DIR *list = opendir("/proc/self/fd");
    const struct dirent *entry = NULL;
    for (int fd = 0; list != NULL ? (entry = readdir(list)) != NULL : fd < MOST; fd++) {
        if (list != NULL) fd = atoi(entry->d_name); /* "." and ".." give 0 */
        if (fd <= STDERR_FILENO || fd == report || (list != NULL && fd == dirfd(list))) continue;
        if (!is_checked_file(fd, file)) (void)close(fd);
    }
    if (list != NULL) (void)closedir(list);
#ifdef SYS_close_range
    if (list == NULL) (void)syscall(SYS_close_range, MOST, ~0u, 0);
#endif
}

static uint64_t processor_seconds(const lg_read_options *options, const struct stat *file) {
    return options->probe_seconds + ((uint64_t)file->st_size >> 25); /* plus one second for each 32 MiB */
}

/* Largest wall-clock time of the child, far above its CPU time. */
static unsigned patience(const lg_read_options *options, const struct stat *file) {
    const uint64_t seconds = 60 + 10 * processor_seconds(options, file);
    return seconds < INT_MAX ? (unsigned)seconds : (unsigned)INT_MAX;
}

/* Restricts the child. Returns NULL on success, or else the name of the restriction that failed. */
static const char *enter_child(const lg_read_options *options, const struct stat *file, int report) {
    static const int fatal[] = {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGXCPU, SIGTERM};
    for (size_t i = 0; i < LG_COUNT(fatal); i++) (void)signal(fatal[i], SIG_DFL);
    (void)signal(SIGINT, SIG_IGN); /* Ctrl-C is for the parent; in the child it would look like a crash */
    (void)signal(SIGPIPE, SIG_IGN);
    (void)signal(SIGXFSZ, SIG_IGN);
    int sink = open("/dev/null", O_RDWR);
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++) /* also hides messages about damaged heaps */
        if (fd != report && (sink < 0 || dup2(sink, fd) < 0)) (void)close(fd);
    close_inherited(report, file);
    /* If another thread of the parent held a lock at the fork, the lock stays locked in the child. Waiting
     * for it takes no CPU time, so an alarm ends it. */
    (void)signal(SIGALRM, SIG_DFL);
    (void)alarm(patience(options, file));
    const uint64_t more = ((uint64_t)1 << 30) + options->max_size / 4 + 16 * (uint64_t)file->st_size;
    if (!limit(RLIMIT_CORE, 0) || !limit(RLIMIT_FSIZE, 0) ||
        !limit(RLIMIT_CPU, (rlim_t)processor_seconds(options, file)) ||
        (LG_LIMIT_MEMORY && !limit(RLIMIT_AS, (rlim_t)(lg_addresses_in_use() + more))))
        return "its limits cannot be set";
    return lg_sandbox_enter(report);
}

/* ---- the report ----
 *
 * A child that has read a malicious file may send anything. The parent reads one report of a fixed size. It
 * rejects a report if its status does not exist, if its text is not terminated, or if its text has control
 * characters. */

_Static_assert(sizeof(lg_error) <= PIPE_BUF, "one write sends a report as a whole");

static bool is_report(const lg_context *context, lg_error *report) {
    if (memchr(report->message, '\0', sizeof report->message) == NULL) return false;
    if (report->status == LG_CANCELLED && !lg_cancelled(context)) return false;
    return strcmp(lg_status_name(report->status), "UNKNOWN") != 0 && !lg_tame(report->message);
}

static _Noreturn void run_child(int fd, const char *path, const lg_read_options *options,
                                const struct stat *file, lg_status (*read)(void *user, lg_error *error),
                                void *user) {
    lg_error report = {LG_OK, ""};
    const char *missing = enter_child(options, file, fd), *may = getenv("LIEGRAD_UNCONFINED");
    report.status = missing == NULL || (may != NULL && strcmp(may, "1") == 0)
                        ? read(user, &report)
                        : lg_fail(&report, LG_FILE,
                                  "%s: is not read, because the process that checks it cannot be confined: "
                                  "%s; LIEGRAD_UNCONFINED=1 reads it all the same",
                                  lg_shown_path(path), missing);
    (void)lg_tame(report.message);
    while (write(fd, &report, sizeof report) < 0 && errno == EINTR) continue;
    _exit(0);
}

/* PATIENT: after this many seconds without a report, a log message says that the check goes on. STILL: the
 * child is ended after options->probe_seconds + STILL seconds in which it used no CPU time, because it waits
 * for something that will not come. */
enum { PATIENT = 3, STILL = 4 };

/* CPU time of the child in seconds, or -1 if it is not known. */
static double child_seconds(pid_t child) {
    clockid_t id;
    struct timespec used;
    if (clock_getcpuclockid(child, &id) != 0 || clock_gettime(id, &used) != 0) return -1.0;
    return (double)used.tv_sec + 1e-9 * (double)used.tv_nsec;
}

/* Waits until the child has sent its report or is dead. *got becomes the number of bytes of the report. */
static lg_status await_report(const lg_context *context, const char *path, const lg_read_options *options,
                              const struct stat *file, pid_t child, int fd, lg_error *report, size_t *got,
                              lg_error *error) {
    struct pollfd ready = {fd, POLLIN, 0};
    const unsigned most = options->probe_seconds + STILL;
    const double begun = lg_seconds();
    unsigned still = 0;
    double used = 0.0;
    for (unsigned waited = 0;; waited++) {
        if (poll(&ready, 1, 1000) > 0) {
            const ssize_t n = read(fd, (char *)report + *got, sizeof *report - *got);
            *got += n > 0 ? (size_t)n : 0;
            if (*got == sizeof *report || n == 0 || (n < 0 && errno != EINTR)) return LG_OK;
        }
        if (lg_cancelled(context)) return LG_CANCELLED;
        if (waited == PATIENT)
            lg_log_message(context, LG_LOG_INFO, "%s: is still being checked", lg_shown_path(path));
        const double now = child_seconds(child);
        still = now > used || now < 0.0 ? 0 : still + 1;
        used = now;
        const double passed = lg_seconds() - begun;
        if (still >= most || passed >= patience(options, file))
            return lg_fail(error, LG_FILE, "%s: the check of the file %s %.0f s and was ended",
                           lg_shown_path(path), still >= most ? "made no progress for" : "took",
                           still >= most ? (double)still : passed);
    }
}

lg_status lg_probe(const lg_context *context, const char *path, const lg_read_options *options,
                   lg_status (*read)(void *user, lg_error *error), void *user, lg_error *error) {
    lg_read_options chosen;
    LG_TRY(lg_read_options_resolve(options, &chosen, error));
    struct stat about;
    if (!chosen.probe || path == NULL || stat(path, &about) != 0 || !S_ISREG(about.st_mode)) return LG_OK;
    int ends[2];
    if (pipe(ends) != 0)
        return lg_fail(error, LG_FILE, "%s: the file cannot be checked: no pipe: %s", lg_shown_path(path),
                       strerror(errno));
    pid_t child = fork();
    if (child == 0) {
        (void)close(ends[0]);
        run_child(ends[1], path, &chosen, &about, read, user);
    }
    int code = errno;
    (void)close(ends[1]);
    if (child < 0) {
        (void)close(ends[0]);
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: the file cannot be checked: no process: %s",
                       lg_shown_path(path), strerror(code));
    }
    lg_error report;
    size_t got = 0;
    const lg_status waiting =
        await_report(context, path, &chosen, &about, child, ends[0], &report, &got, error);
    (void)kill(child, SIGKILL); /* the child may go on after its report */
    (void)close(ends[0]);
    while (waitpid(child, NULL, 0) < 0 && errno == EINTR) continue;
    if (waiting != LG_OK) return waiting;
    if (got < sizeof report || !is_report(context, &report))
        return lg_fail(error, LG_FORMAT, "%s: is damaged: reading it crashed or did not end",
                       lg_shown_path(path));
    return report.status == LG_OK ? LG_OK : lg_fail(error, report.status, "%s", report.message);
}
