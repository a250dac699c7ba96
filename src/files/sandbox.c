/* A filter of system calls. A call that is not on the list fails with EPERM. The reader then reacts as to any
 * failed call, so that a good file can be read even if a library tries something unusual.
 *
 * The list has the calls that a reading process needs: those of glibc, HDF5, and of the sanitizers and
 * valgrind, under which tests run. Some calls are allowed only with certain arguments: `open` for reading,
 * `write` to two descriptors, memory that is not shared with a file, signals to the process itself. The
 * filter cannot look at structures behind pointers, so openat2 and clone3 fail with ENOSYS, and the C library
 * then uses the older calls.
 */
#define _GNU_SOURCE /* for the numbers of system calls, and prctl */
#include "files/sandbox.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#ifdef __linux__
#include <sys/prctl.h>
#endif
#ifdef LG_SECCOMP
#include <seccomp.h>
#endif

#include "core/count.h"

#ifdef LG_SECCOMP

/* Calls that are allowed with any arguments. Calls that this architecture does not have are skipped. */
static const int free_calls[] = {
    /* reading files, and asking about them */
    SCMP_SYS(read), SCMP_SYS(pread64), SCMP_SYS(readv), SCMP_SYS(preadv), SCMP_SYS(lseek), SCMP_SYS(_llseek),
    SCMP_SYS(close), SCMP_SYS(stat), SCMP_SYS(lstat), SCMP_SYS(fstat), SCMP_SYS(newfstatat),
    SCMP_SYS(fstatat64), SCMP_SYS(statx), SCMP_SYS(statfs), SCMP_SYS(fstatfs), SCMP_SYS(access),
    SCMP_SYS(faccessat), SCMP_SYS(faccessat2), SCMP_SYS(readlink), SCMP_SYS(readlinkat), SCMP_SYS(getcwd),
    SCMP_SYS(getdents64), SCMP_SYS(flock), SCMP_SYS(fadvise64), SCMP_SYS(poll), SCMP_SYS(ppoll),
    SCMP_SYS(select), SCMP_SYS(pselect6),
    /* memory */
    SCMP_SYS(brk), SCMP_SYS(munmap), SCMP_SYS(mprotect), SCMP_SYS(mremap), SCMP_SYS(madvise),
    SCMP_SYS(mincore), SCMP_SYS(get_mempolicy), SCMP_SYS(membarrier),
    /* waiting and time */
    SCMP_SYS(futex), SCMP_SYS(futex_time64), SCMP_SYS(sched_yield), SCMP_SYS(nanosleep),
    SCMP_SYS(clock_nanosleep), SCMP_SYS(clock_gettime), SCMP_SYS(clock_getres), SCMP_SYS(gettimeofday),
    SCMP_SYS(time), SCMP_SYS(times), SCMP_SYS(getrusage), SCMP_SYS(alarm), SCMP_SYS(setitimer),
    /* receiving and handling signals */
    SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask), SCMP_SYS(rt_sigreturn), SCMP_SYS(rt_sigtimedwait),
    SCMP_SYS(rt_sigpending), SCMP_SYS(sigaltstack), SCMP_SYS(restart_syscall),
    /* information about the process itself */
    SCMP_SYS(getpid), SCMP_SYS(gettid), SCMP_SYS(getppid), SCMP_SYS(getuid), SCMP_SYS(geteuid),
    SCMP_SYS(getgid), SCMP_SYS(getegid), SCMP_SYS(getrlimit), SCMP_SYS(sched_getaffinity), SCMP_SYS(sysinfo),
    SCMP_SYS(uname), SCMP_SYS(getrandom), SCMP_SYS(getcpu), SCMP_SYS(set_robust_list), SCMP_SYS(rseq),
    SCMP_SYS(arch_prctl), SCMP_SYS(set_tid_address), SCMP_SYS(exit), SCMP_SYS(exit_group)};

/* A call that is allowed if one of its arguments, masked, has a given value. */
typedef struct condition {
    int call;
    struct scmp_arg_cmp is;
} condition;
#define IS(parameter, mask, value)                                                                           \
    { (parameter), SCMP_CMP_MASKED_EQ, (mask), (value) }

/* Matches descriptors from `most` on, where `most` is the limit of open files. Only valgrind has descriptors
 * above this limit. */
static struct scmp_arg_cmp is_beyond_descriptors(rlim_t most) {
    return (struct scmp_arg_cmp){0, SCMP_CMP_GE, most < INT_MAX ? most : INT_MAX, 0};
}

enum { MOST_CONDITIONS = 24 };
static size_t list_conditions(int report, rlim_t descriptors, condition out[MOST_CONDITIONS]) {
    const uint64_t all = UINT64_MAX, self = (uint64_t)getpid();
    const uint64_t writing = O_WRONLY | O_RDWR | O_CREAT | O_TRUNC | O_APPEND, low = UINT32_MAX;
    size_t n = 0;
    const condition list[] = {
        {SCMP_SYS(open), IS(1, writing, 0)},
        {SCMP_SYS(openat), IS(2, writing, 0)},
        {SCMP_SYS(write), IS(0, low, (uint64_t)report)},
        {SCMP_SYS(write), IS(0, low, STDERR_FILENO)},
        {SCMP_SYS(write), is_beyond_descriptors(descriptors)},
        {SCMP_SYS(writev), IS(0, low, STDERR_FILENO)},
        {SCMP_SYS(mmap), IS(3, MAP_SHARED, 0)},
        {SCMP_SYS(mmap2), IS(3, MAP_SHARED, 0)},
        {SCMP_SYS(kill), IS(0, low, self)},
        {SCMP_SYS(tkill), IS(0, low, self)},
        {SCMP_SYS(tgkill), IS(0, low, self)},
        {SCMP_SYS(fcntl), IS(1, all, F_GETFD)},
        {SCMP_SYS(fcntl), IS(1, all, F_SETFD)},
        {SCMP_SYS(fcntl), IS(1, all, F_GETFL)},
        {SCMP_SYS(fcntl), IS(1, all, F_GETLK)},
        {SCMP_SYS(fcntl), IS(1, all, F_DUPFD_CLOEXEC)},
        {SCMP_SYS(prlimit64), IS(2, all, 0)}, /* allowed for reading a limit, not for setting one */
    };
    for (; n < LG_COUNT(list); n++) out[n] = list[n];
    return n;
}

static bool add_rules(scmp_filter_ctx filter, int report, rlim_t descriptors) {
    static const int missing[] = {SCMP_SYS(openat2), SCMP_SYS(clone3)};
    condition conditions[MOST_CONDITIONS];
    bool good = true;
    for (size_t i = 0; i < LG_COUNT(free_calls); i++)
        if (free_calls[i] >= 0) good &= seccomp_rule_add(filter, SCMP_ACT_ALLOW, free_calls[i], 0) == 0;
    for (size_t i = 0; i < LG_COUNT(missing); i++)
        if (missing[i] >= 0) good &= seccomp_rule_add(filter, SCMP_ACT_ERRNO(ENOSYS), missing[i], 0) == 0;
    const size_t n = list_conditions(report, descriptors, conditions);
    for (size_t i = 0; i < n; i++) {
        const condition *c = &conditions[i];
        if (c->call >= 0) good &= seccomp_rule_add_array(filter, SCMP_ACT_ALLOW, c->call, 1, &c->is) == 0;
    }
    return good;
}

static bool load_filter(int report) {
    struct rlimit files;
    const scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(EPERM));
    if (filter == NULL) return false;
    const bool loaded = getrlimit(RLIMIT_NOFILE, &files) == 0 && add_rules(filter, report, files.rlim_cur) &&
                        seccomp_load(filter) == 0;
    seccomp_release(filter);
    return loaded;
}

#endif

const char *lg_sandbox_enter(int report) {
#if defined(__linux__) && defined(PR_SET_NO_NEW_PRIVS)
    if (prctl(PR_SET_NO_NEW_PRIVS, 1ul, 0ul, 0ul, 0ul) != 0) return "it could gain rights";
#endif
#ifdef LG_SECCOMP
    if (!load_filter(report)) return "the system takes no filter of system calls";
#endif
    return NULL;
}
