/* HDF5 1.10 crashes or loops on some damaged files, and a malicious file could do worse. Therefore a child
 * process reads the file first. The child may crash, and it can do nothing but read (sandbox.h). */
#define _DEFAULT_SOURCE /* for syscall */
#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
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
static void limit(int resource, rlim_t value) {
    struct rlimit now;
    if (getrlimit(resource, &now) != 0) return;
    if (now.rlim_max != RLIM_INFINITY && value > now.rlim_max) value = now.rlim_max;
    now.rlim_cur = value;
    now.rlim_max = value;
    (void)setrlimit(resource, &now);
}

/* Closes all descriptors of the parent except regular files. Terminals and sockets would be a way out of the
 * sandbox. Regular files cannot be written, because the limit on file sizes is 0; HDF5 may read a file
 * through a descriptor of the parent. Without /proc this function tries every number below 4096. */
static void close_inherited(int report) {
    enum { MOST = 4096 };
    DIR *list = opendir("/proc/self/fd");
    const struct dirent *entry = NULL;
    for (int fd = 0; list != NULL ? (entry = readdir(list)) != NULL : fd < MOST; fd++) {
        struct stat about;
        if (list != NULL) fd = atoi(entry->d_name); /* "." and ".." give 0 */
        if (fd <= STDERR_FILENO || fd == report || (list != NULL && fd == dirfd(list))) continue;
        if (fstat(fd, &about) == 0 && !S_ISREG(about.st_mode)) (void)close(fd);
    }
    if (list != NULL) (void)closedir(list);
#ifdef SYS_close_range
    if (list == NULL) (void)syscall(SYS_close_range, MOST, ~0u, 0);
#endif
}

static void enter_child(const lg_read_options *options, uint64_t file_bytes, int report) {
    static const int fatal[] = {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGXCPU, SIGTERM};
    for (size_t i = 0; i < LG_COUNT(fatal); i++) (void)signal(fatal[i], SIG_DFL);
    (void)signal(SIGINT, SIG_IGN); /* Ctrl-C is for the parent; in the child it would look like a crash */
    (void)signal(SIGPIPE, SIG_IGN);
    int sink = open("/dev/null", O_RDWR);
    for (int fd = STDIN_FILENO; sink >= 0 && fd <= STDERR_FILENO; fd++)
        if (fd != report) (void)dup2(sink, fd); /* hides the C library's messages about damaged heaps */
    close_inherited(report);
    limit(RLIMIT_CORE, 0);
    uint64_t seconds = options->probe_seconds + (file_bytes >> 25); /* plus one second per 32 MiB */
    limit(RLIMIT_CPU, (rlim_t)seconds);
    /* If another thread of the parent held a lock at the fork, the lock stays locked in the child. Waiting
     * for it takes no CPU time, so an alarm ends it. */
    (void)signal(SIGALRM, SIG_DFL);
    const uint64_t patience = 60 + 10 * seconds;
    (void)alarm(patience < INT_MAX ? (unsigned)patience : (unsigned)INT_MAX);
    if (LG_LIMIT_MEMORY) {
        uint64_t extra = ((uint64_t)1 << 30) + options->max_size / 4 + 16 * file_bytes;
        limit(RLIMIT_AS, (rlim_t)(lg_addresses_in_use() + extra));
    }
}

static bool transfer(int fd, void *data, size_t bytes, bool out) {
    unsigned char *at = data;
    while (bytes > 0) {
        ssize_t n = out ? write(fd, at, bytes) : read(fd, at, bytes);
        if (n > 0)
            at += n, bytes -= (size_t)n;
        else if (n == 0 || errno != EINTR)
            return false;
    }
    return true;
}

static _Noreturn void run_child(int fd, const lg_read_options *options, uint64_t file_bytes,
                                lg_status (*read)(void *user, lg_error *error), void *user) {
    lg_error report = {LG_OK, ""};
    enter_child(options, file_bytes, fd);
    (void)lg_sandbox_enter(fd);
    report.status = read(user, &report);
    _exit(transfer(fd, &report, sizeof report, true) ? 0 : 1);
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

/* Waits until the child reports or dies. If it returns LG_CANCELLED or LG_FILE, the caller must kill the
 * child. */
static lg_status await_report(const lg_context *context, const char *path, const lg_read_options *options,
                              pid_t child, int fd, lg_error *error) {
    struct pollfd report = {fd, POLLIN, 0};
    const unsigned most = options->probe_seconds + STILL;
    unsigned still = 0;
    double used = 0.0;
    for (unsigned waited = 0;; waited++) {
        if (poll(&report, 1, 1000) > 0) return LG_OK;
        if (lg_cancelled(context)) return LG_CANCELLED;
        if (waited == PATIENT)
            lg_log_message(context, LG_LOG_INFO, "%s: is still being checked", lg_shown_path(path));
        const double now = child_seconds(child);
        still = now > used || now < 0.0 ? 0 : still + 1;
        used = now;
        if (still >= most)
            return lg_fail(error, LG_FILE,
                           "%s: the check of the file made no progress for %u s and was ended",
                           lg_shown_path(path), still);
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
        run_child(ends[1], &chosen, (uint64_t)about.st_size, read, user);
    }
    int code = errno;
    (void)close(ends[1]);
    if (child < 0) {
        (void)close(ends[0]);
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: the file cannot be checked: no process: %s",
                       lg_shown_path(path), strerror(code));
    }
    lg_error report;
    const lg_status waiting = await_report(context, path, &chosen, child, ends[0], error);
    if (waiting != LG_OK) (void)kill(child, SIGKILL);
    const bool complete = waiting == LG_OK && transfer(ends[0], &report, sizeof report, false);
    (void)close(ends[0]);
    while (waitpid(child, NULL, 0) < 0 && errno == EINTR) continue;
    if (waiting != LG_OK) return waiting;
    if (!complete)
        return lg_fail(error, LG_FORMAT, "%s: is damaged: reading it crashed or did not end",
                       lg_shown_path(path));
    return report.status == LG_OK ? LG_OK : lg_fail(error, report.status, "%s", report.message);
}
