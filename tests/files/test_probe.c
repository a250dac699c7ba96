/* The probe, a child process that reads a foreign file first: what it must not be able to do, and that it can
 * still read. */
#define _GNU_SOURCE /* ptrace, process_vm_writev */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <sys/wait.h>

#include "files/memory.h"
#include "files/sandbox.h"
#include "support/faults.h"
#include "support/io_test.h"

/* The targets of the attempts. */
static struct {
    const char *old, *fresh; /* an existing file, and a path without a file */
    int descriptor;          /* of the existing file, opened for writing before the fork */
    int heard;               /* one end of a pipe that is not the pipe of the report */
    pid_t parent;
    int word;
} scene;

/* ---- attempts; they return 0, or errno ---- */

static int result(long value) {
    return value < 0 ? errno : 0;
}

static int creates(void) {
    const int fd = open(scene.fresh, O_WRONLY | O_CREAT, 0600);
    const int code = result(fd);
    if (fd >= 0) (void)close(fd);
    return code;
}
static int opens_for_writing(void) {
    const int fd = open(scene.old, O_RDWR);
    const int code = result(fd);
    if (fd >= 0) (void)close(fd);
    return code;
}
static int empties(void) {
    const int fd = openat(AT_FDCWD, scene.old, O_RDONLY | O_TRUNC);
    const int code = result(fd);
    if (fd >= 0) (void)close(fd);
    return code;
}
static int makes_stream(void) {
    FILE *file = fopen(scene.fresh, "w");
    const int code = file == NULL ? errno : 0;
    if (file != NULL) (void)fclose(file);
    return code;
}
static int writes_descriptor(void) {
    return result(pwrite(scene.descriptor, "x", 1, 0));
}
static int writes_elsewhere(void) {
    return result(write(scene.heard, "x", 1));
}
static int shortens(void) {
    return result(ftruncate(scene.descriptor, 1));
}
static int shares_memory(void) {
    void *at = mmap(NULL, 1, PROT_READ | PROT_WRITE, MAP_SHARED, scene.descriptor, 0);
    return at == MAP_FAILED ? errno : result(munmap(at, 1));
}
static int removes(void) {
    return result(unlink(scene.old));
}
static int renames(void) {
    return result(rename(scene.old, scene.fresh));
}
static int links(void) {
    return result(link(scene.old, scene.fresh));
}
static int links_softly(void) {
    return result(symlink(scene.old, scene.fresh));
}
static int makes_folder(void) {
    return result(mkdir(scene.fresh, 0700));
}
static int changes_mode(void) {
    return result(chmod(scene.old, 0777));
}
static int changes_mode_open(void) {
    return result(fchmod(scene.descriptor, 0777));
}
static int changes_owner(void) {
    return result(chown(scene.old, getuid(), getgid()));
}
static int opens_socket(void) {
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    const int code = result(fd);
    if (fd >= 0) (void)close(fd);
    return code;
}
static int opens_pair(void) {
    int ends[2];
    const int code = result(socketpair(AF_UNIX, SOCK_STREAM, 0, ends));
    if (code == 0) (void)close(ends[0]), (void)close(ends[1]);
    return code;
}
static int forks(void) {
    const pid_t child = fork();
    if (child == 0) _exit(0);
    return child < 0 ? errno : result(waitpid(child, NULL, 0));
}
/* Starts a program that does not exist: ENOENT means that starting programs is allowed. */
static int starts_program(void) {
    char *arguments[] = {NULL};
    (void)execve(scene.fresh, arguments, arguments);
    return errno == ENOENT ? 0 : errno;
}
static int traces(void) {
    (void)ptrace(PTRACE_PEEKDATA, (pid_t)1 << 29, NULL, NULL);
    return errno == ESRCH ? 0 : errno;
}
static int signals_parent(void) {
    return result(kill(scene.parent, 0));
}
static int signals_group(void) {
    return result(kill(0, 0));
}
static int writes_memory(void) {
    int one = 1;
    const struct iovec local = {&one, sizeof one}, remote = {&scene.word, sizeof scene.word};
    return process_vm_writev(scene.parent, &local, 1, &remote, 1, 0) < 0 ? errno : 0;
}
static int raises_limit(void) {
    struct rlimit limit;
    if (getrlimit(RLIMIT_CPU, &limit) != 0) return 0;
    return result(setrlimit(RLIMIT_CPU, &limit));
}

static const struct attempt {
    const char *what;
    int (*attempt)(void);
} attempts[] = {{"makes a file", creates},
                {"opens a file for writing", opens_for_writing},
                {"empties a file", empties},
                {"makes a stream", makes_stream},
                {"writes to an open file", writes_descriptor},
                {"writes to another pipe", writes_elsewhere},
                {"shortens an open file", shortens},
                {"shares memory with a file", shares_memory},
                {"removes a file", removes},
                {"renames a file", renames},
                {"links a file", links},
                {"makes a symbolic link", links_softly},
                {"makes a folder", makes_folder},
                {"changes a mode", changes_mode},
                {"changes the mode of an open file", changes_mode_open},
                {"changes an owner", changes_owner},
                {"opens a socket", opens_socket},
                {"opens a pair of sockets", opens_pair},
                {"forks", forks},
                {"starts a program", starts_program},
                {"traces a process", traces},
                {"signals its parent", signals_parent},
                {"signals its group", signals_group},
                {"writes to its parent's memory", writes_memory},
                {"sets a limit", raises_limit}};

static void set_scene(int pipe_end) {
    scene.old = scratch_path("old");
    scene.fresh = scratch_path("fresh");
    (void)unlink(scene.fresh);
    (void)rmdir(scene.fresh);
    write_text_to(scene.old, "as it was");
    scene.descriptor = open(scene.old, O_RDWR);
    scene.heard = pipe_end;
    scene.parent = getpid();
    assert_true(scene.descriptor >= 0);
}

/* A reader that makes an attempt instead of reading. */
static lg_status attempts_it(void *user, lg_error *error) {
    const struct attempt *it = user;
    const int code = it->attempt();
    return code == 0 ? LG_OK : lg_fail(error, LG_FILE, "%s: %s", it->what, strerror(code));
}

/* Whether the system and the build can confine the child. */
static bool is_confined(void) {
    const pid_t child = fork();
    if (child == 0) {
        const bool entered = lg_sandbox_enter(STDERR_FILENO) == NULL;
        _exit(entered && socket(AF_INET, SOCK_STREAM, 0) < 0 && errno == EPERM ? 0 : 1);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/* ---- the tests ---- */

TEST("without the probe every attempt succeeds, so the table tries what is really possible") {
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    for (size_t i = 0; i < LG_COUNT(attempts); i++) {
        set_scene(ends[1]);
        const int code = attempts[i].attempt();
        if (code != 0) print_message("%s: %s\n", attempts[i].what, strerror(code));
        /* ptrace may be forbidden in a container, and qemu does not have it. */
        assert_true(code == 0 || code == EPERM || code == ENOSYS);
        (void)close(scene.descriptor);
    }
    (void)unlink(scene.fresh);
    (void)rmdir(scene.fresh);
    (void)close(ends[0]), (void)close(ends[1]);
}

TEST("the probe cannot write, send, start or signal anything, and the parent gets the reason") {
    int ends[2];
    if (!is_confined()) skip();
    assert_int_equal(pipe(ends), 0);
    for (size_t i = 0; i < LG_COUNT(attempts); i++) {
        struct attempt it = attempts[i];
        lg_error error = {LG_OK, ""};
        set_scene(ends[1]);
        const char *sentence = test_text("%s: %s", it.what, strerror(EPERM));
        if (lg_probe(NULL, scene.old, NULL, attempts_it, &it, &error) != LG_FILE) fail_msg("it %s", it.what);
        assert_string_equal(error.message, sentence);
        assert_int_equal(access(scene.fresh, F_OK), -1);
        struct stat about;
        assert_int_equal(stat(scene.old, &about), 0);
        assert_int_equal(about.st_size, 9);
        (void)close(scene.descriptor);
    }
    (void)close(ends[0]), (void)close(ends[1]);
}

/* Writes to a descriptor that has the number of an allowed one. */
static lg_status passes_out(void *user, lg_error *error) {
    (void)user;
    (void)close(STDERR_FILENO);
    const int fd = fcntl(scene.heard, F_DUPFD_CLOEXEC, STDERR_FILENO);
    return fd == STDERR_FILENO && write(fd, "x", 1) == 1 ? LG_OK
                                                         : lg_fail(error, LG_FILE, "nothing to write to");
}

TEST("the child has none of the parent's pipes and sockets, whatever numbers it uses") {
    int ends[2], spare;
    assert_int_equal(pipe(ends), 0);
    spare = fcntl(ends[1], F_DUPFD_CLOEXEC, 500);
    for (int i = 0; i < 2; i++) {
        set_scene(i == 0 ? ends[1] : spare);
        assert_status(lg_probe(NULL, scene.old, NULL, passes_out, NULL, NULL), LG_FILE);
        (void)close(scene.descriptor);
    }
    char byte;
    (void)close(spare), (void)close(ends[1]);
    assert_int_equal(read(ends[0], &byte, 1), 0);
    (void)close(ends[0]);
}

/* The limit RLIMIT_FSIZE = 0 keeps files from growing, also where system calls cannot be filtered. */
static lg_status grows_a_file(void *user, lg_error *error) {
    struct rlimit limit;
    (void)user;
    if (getrlimit(RLIMIT_FSIZE, &limit) != 0 || limit.rlim_cur != 0) return LG_OK;
    const ssize_t written = pwrite(scene.descriptor, "more than there was", 19, 0);
    return written > 9 ? LG_OK : lg_fail(error, LG_FILE, "it did not grow");
}

TEST("no file can grow in the probe") {
    set_scene(-1);
    assert_status(lg_probe(NULL, scene.old, NULL, grows_a_file, NULL, NULL), LG_FILE);
    (void)close(scene.descriptor);
}

static lg_status reads(void *user, lg_error *error) {
    char text[16] = "";
    (void)user;
    FILE *file = fopen(scene.old, "r");
    if (file == NULL) return lg_fail(error, LG_FILE, "%s", strerror(errno));
    const size_t length = fread(text, 1, sizeof text - 1, file);
    (void)fclose(file);
    void *much = malloc((size_t)1 << 24); /* by mmap */
    if (much == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory");
    memset(much, 1, (size_t)1 << 24);
    free(much);
    return length == 9 && strcmp(text, "as it was") == 0 ? LG_OK : lg_fail(error, LG_FORMAT, "other bytes");
}

static lg_status aborts(void *user, lg_error *error) {
    (void)user, (void)error;
    abort();
}

static void *computes(void *user) {
    volatile double *x = user;
    for (int i = 0; i < 1000 || *x > 0; i++) *x = *x * 0.999999 - (i > 1000000);
    return NULL;
}

TEST("the probe can read, also if the parent has threads, and a crash is reported as a crash") {
    volatile double x = 1;
    pthread_t thread;
    lg_error error = {LG_OK, ""};
    set_scene(-1);
    assert_int_equal(pthread_create(&thread, NULL, computes, (void *)&x), 0);
    for (int i = 0; i < 20; i++) assert_told(lg_probe(NULL, scene.old, NULL, reads, NULL, &told));
    assert_status(lg_probe(NULL, scene.old, NULL, aborts, NULL, &error), LG_FORMAT);
    assert_says(error.message, "crashed or did not end");
    assert_int_equal(pthread_join(thread, NULL), 0);
    (void)close(scene.descriptor);
}

/* ---- a child under control of the file ---- */

/* What the child writes to the pipe of the report, and what it does then. */
typedef struct lie {
    const char *what;
    unsigned status;
    const char *message;
    size_t bytes;         /* of the report; 0: all */
    bool waits;           /* instead of ending */
    lg_status expected;   /* of lg_probe */
    const char *sentence; /* NULL: as `message` */
} lie;

/* The only pipe that the child has. */
static int pipe_of_report(void) {
    struct stat about;
    int fd = STDERR_FILENO + 1;
    while (fd < 4096 && (fstat(fd, &about) != 0 || !S_ISFIFO(about.st_mode))) fd++;
    return fd;
}

static lg_status lies(void *user, lg_error *error) {
    const lie *it = user;
    struct {
        unsigned status;
        char message[sizeof error->message];
    } report = {it->status, ""};
    _Static_assert(sizeof report == sizeof *error, "the report is as lg_error");
    memset(report.message, 'a', sizeof report.message);
    if (it->message != NULL) memcpy(report.message, it->message, strlen(it->message) + 1);
    const size_t bytes = it->bytes > 0 ? it->bytes : sizeof report;
    if (write(pipe_of_report(), &report, bytes) != (ssize_t)bytes) _exit(1);
    (void)alarm(0);
    (void)signal(SIGALRM, SIG_IGN);
    const struct timespec for_ever = {100000, 0};
    if (it->waits) (void)nanosleep(&for_ever, NULL);
    _exit(0);
}

#define DAMAGED "is damaged: reading it crashed or did not end"

TEST("what a child sends that is not a status with a clean sentence counts as its death") {
    static const lie rows[] = {
        {"a sentence", LG_FORMAT,
         "old: key 'Gr\xc3\xb6\xc3\x9f"
         "e' is missing",
         0, false, LG_FORMAT, NULL},
        {"success", LG_OK, "", 0, false, LG_OK, ""},
        {"success, and does not end", LG_OK, "", 0, true, LG_OK, ""},
        {"a failure, and does not end", LG_VERSION, "old: is new", 0, true, LG_VERSION, NULL},
        {"no such status", 17, "old: is odd", 0, false, LG_FORMAT, DAMAGED},
        {"a negative status", ~0u, "old: is odd", 0, false, LG_FORMAT, DAMAGED},
        {"a text without an end", LG_FORMAT, NULL, 0, false, LG_FORMAT, DAMAGED},
        {"success with a text without an end", LG_OK, NULL, 0, false, LG_FORMAT, DAMAGED},
        {"an escape sequence", LG_FORMAT, "old: \x1b]0;mine\a", 0, false, LG_FORMAT, DAMAGED},
        {"a new line", LG_FORMAT, "old: is good\nlg-fit: error", 0, false, LG_FORMAT, DAMAGED},
        {"delete", LG_FORMAT, "old: \x7f", 0, false, LG_FORMAT, DAMAGED},
        {"a control character of U+0080 to U+009F", LG_FORMAT,
         "old: \xc2\x9b"
         "31m",
         0, false, LG_FORMAT, DAMAGED},
        {"no UTF-8", LG_FORMAT, "old: \xff", 0, false, LG_FORMAT, DAMAGED},
        {"a character cut off", LG_FORMAT, "old: \xe2\x82", 0, false, LG_FORMAT, DAMAGED},
        {"a longer form of /", LG_FORMAT, "old: \xe0\x80\xaf", 0, false, LG_FORMAT, DAMAGED},
        {"a surrogate", LG_FORMAT, "old: \xed\xa0\x80", 0, false, LG_FORMAT, DAMAGED},
        {"beyond Unicode", LG_FORMAT, "old: \xf4\x90\x80\x80", 0, false, LG_FORMAT, DAMAGED},
        {"Ctrl-C", LG_CANCELLED, "cancelled", 0, false, LG_FORMAT, DAMAGED},
        {"half of a report", LG_FORMAT, "old", 100, false, LG_FORMAT, DAMAGED},
        {"a byte, and does not end", LG_FORMAT, "old", 1, true, LG_FILE, "made no progress"}};
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe_seconds = 1;
    set_scene(-1);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lie it = rows[i];
        lg_error error = {LG_OK, ""};
        (void)alarm(60); /* the parent must not wait for a child that does not end */
        const lg_status status = lg_probe(NULL, scene.old, &options, lies, &it, &error);
        (void)alarm(0);
        if (status != it.expected) fail_msg("%s: %s", it.what, lg_status_name(status));
        assert_says(error.message, it.sentence != NULL ? it.sentence : it.message);
    }
    (void)close(scene.descriptor);
}

/* Says something that the honest child must not pass on as it is. */
static lg_status says_wildly(void *user, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s", (const char *)user);
}

TEST("a sentence with wild bytes of the file arrives with question marks") {
    lg_error error = {LG_OK, ""};
    char long_text[600];
    set_scene(-1);
    assert_status(lg_probe(NULL, scene.old, NULL, says_wildly, "a\x1b[2J\xc2\x9b\xff\xc3\xa9", &error),
                  LG_FORMAT);
    assert_string_equal(error.message, "a?[2J???\xc3\xa9");
    memset(long_text, 'x', sizeof long_text);
    memcpy(long_text + sizeof error.message - 2, "\xc3\xa9", 3); /* is cut in two */
    assert_status(lg_probe(NULL, scene.old, NULL, says_wildly, long_text, &error), LG_FORMAT);
    assert_int_equal(strlen(error.message), sizeof error.message - 1);
    assert_says(error.message, "xx?");
    (void)close(scene.descriptor);
}

/* Unlocks and moves everything that the child has from its parent. */
static lg_status meddles(void *user, lg_error *error) {
    (void)user, (void)error;
    for (int fd = 0; fd < 1024; fd++) (void)flock(fd, LOCK_UN), (void)lseek(fd, 0, SEEK_END);
    return LG_OK;
}

TEST("the child cannot release a lock of its parent or move the place in its open files") {
    const char *path = scratch_path("locked");
    write_text_to(path, "a lock, or a log");
    set_scene(-1);
    const int held = open(path, O_RDONLY), other = open(path, O_RDONLY);
    assert_int_equal(flock(held, LOCK_EX), 0);
    assert_ok(lg_probe(NULL, scene.old, NULL, meddles, NULL, NULL));
    assert_int_equal(flock(other, LOCK_EX | LOCK_NB), -1);
    assert_int_equal(lseek(held, 0, SEEK_CUR), 0);
    assert_int_equal(lseek(scene.descriptor, 0, SEEK_CUR), 0);
    (void)close(held), (void)close(other), (void)close(scene.descriptor);
}

/* ---- what is missing ---- */

static lg_status says_whether_all_worked(void *user, lg_error *error) {
    (void)user;
    return faults_hit() ? lg_fail(error, LG_NOT_FOUND, "it is read") : LG_OK;
}

/* Probes with one failing call after the other; returns the number of calls. */
static long with_each_call_failing(lg_status expected, const char *sentence) {
    for (long n = 1;; n++) {
        lg_error error = {LG_OK, ""};
        faults_arm(FAULT_CONFINE, FAULT_FAIL, n, n);
        const lg_status status = lg_probe(NULL, scene.old, NULL, says_whether_all_worked, NULL, &error);
        faults_disarm();
        if (status == LG_OK) return n - 1;
        if (status != expected) fail_msg("call %ld: %s", n, lg_status_name(status));
        assert_says(error.message, sentence);
    }
}

static void allow_unconfined(const char *value) {
    assert_int_equal(value != NULL ? setenv("LIEGRAD_UNCONFINED", value, 1) : unsetenv("LIEGRAD_UNCONFINED"),
                     0);
}

TEST("a file is not read if any call that confines the child fails, unless the user allows it") {
    const char *was = getenv("LIEGRAD_UNCONFINED"); /* set under qemu, which has no filters */
    const char *kept = was != NULL ? test_text("%s", was) : NULL;
    set_scene(-1);
    allow_unconfined(NULL);
    const bool filtered = is_confined(), all = lg_probe(NULL, scene.old, NULL, reads, NULL, NULL) == LG_OK;
    assert_true(all || !filtered);
    if (all) {
        const long calls = with_each_call_failing(LG_FILE, "cannot be confined: ");
        assert_true(calls > (filtered ? 80 : 6)); /* a call of libseccomp for each rule */
        allow_unconfined("0");
        assert_int_equal(with_each_call_failing(LG_FILE, "LIEGRAD_UNCONFINED=1 reads it all the same"),
                         calls);
        allow_unconfined("1");
        assert_int_equal(with_each_call_failing(LG_NOT_FOUND, "it is read"), calls);
    }
    allow_unconfined(kept);
    (void)close(scene.descriptor);
    if (!all) skip();
}

static lg_status stands_still(void *user, lg_error *error) {
    const struct timespec long_time = {1000, 0};
    (void)user, (void)error;
    (void)nanosleep(&long_time, NULL);
    return LG_OK;
}

/* Memory of the parent and the child: the last message of the log. */
typedef struct {
    char words[256];
    atomic_bool written;
} shared_words;

/* Works until the parent has written a message, or for a minute. */
static lg_status works(void *user, lg_error *error) {
    const shared_words *shared = user;
    struct timespec begin, now;
    volatile double x = 1;
    (void)error;
    (void)clock_gettime(CLOCK_MONOTONIC, &begin);
    do {
        for (int i = 0; i < 1000000; i++) x = x * 0.999 + 1;
        (void)clock_gettime(CLOCK_MONOTONIC, &now);
    } while (!atomic_load(&shared->written) && now.tv_sec - begin.tv_sec < 60);
    return LG_OK;
}

static void keep_words(void *user, lg_log_level level, const char *message) {
    shared_words *shared = user;
    (void)snprintf(shared->words, sizeof shared->words, "%d %s", (int)level, message);
    atomic_store(&shared->written, true);
}

static double seconds_of_day(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

TEST("a check that hangs is ended and reported within its time limit plus four seconds, a working one is "
     "not") {
    lg_read_options options;
    lg_context_options how;
    lg_context *context;
    volatile int stop = 0;
    lg_error error = {LG_OK, ""};
    shared_words *shared =
        mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    assert_true(shared != MAP_FAILED);
    set_scene(-1);
    lg_context_options_init(&how);
    how.log = keep_words;
    how.log_user = shared;
    how.cancel = &stop;
    assert_ok(lg_context_create(&how, &context));
    lg_read_options_init(&options);
    options.probe_seconds = 1;
    double begin = seconds_of_day();
    assert_status(lg_probe(context, scene.old, &options, stands_still, NULL, &error), LG_FILE);
    assert_says(error.message, "made no progress");
    assert_says(shared->words, "is still being checked");
    assert_true(seconds_of_day() - begin < 30);
    options.probe_seconds = 20;
    shared->words[0] = '\0';
    atomic_store(&shared->written, false);
    assert_ok(lg_probe(context, scene.old, &options, works, shared, &error));
    assert_says(shared->words, "is still being checked");
    begin = seconds_of_day();
    stop = 1;
    assert_status(lg_probe(context, scene.old, &options, stands_still, NULL, &error), LG_CANCELLED);
    assert_true(seconds_of_day() - begin < 15);
    lg_context_destroy(context);
    (void)munmap(shared, sizeof *shared);
    (void)close(scene.descriptor);
}

TEST("the parent is not restricted") {
    set_scene(-1);
    assert_ok(lg_probe(NULL, scene.old, NULL, reads, NULL, NULL));
    assert_int_equal(creates(), 0);
    assert_int_equal(forks(), 0);
    assert_int_equal(opens_pair(), 0);
    (void)close(scene.descriptor);
}

/* ---- limits of the process ---- */

static void limit(int resource, rlim_t value) {
    const struct rlimit to = {value, value};
    assert_int_equal(setrlimit(resource, &to), 0);
}

static void with_little_time(void) {
    limit(RLIMIT_CPU, 3600);
    limit(RLIMIT_NOFILE, 64);
}

static void with_less_time(void) {
    limit(RLIMIT_CPU, 10);
}

/* The pipe of the report gets the numbers 0 and 1. */
static void without_terminal(void) {
    (void)close(STDIN_FILENO);
    (void)close(STDOUT_FILENO);
}

static bool probes(unsigned seconds) {
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe_seconds = seconds;
    return lg_probe(NULL, scene.old, &options, reads, NULL, NULL) == LG_OK;
}

TEST("the probe works with limits and descriptors of any kind, and for any time") {
    static void (*const ways[])(void) = {with_little_time, with_less_time, without_terminal};
    set_scene(-1);
    for (size_t i = 0; i < LG_COUNT(ways); i++) {
        int status = -1;
        const pid_t child = fork();
        if (child == 0) {
            ways[i]();
            _exit(probes(20) ? 0 : 1);
        }
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    }
    assert_true(probes(1u << 29));
    assert_ok(lg_probe(NULL, NULL, NULL, reads, NULL, NULL)); /* the reader refuses it */
    (void)close(scene.descriptor);
}

TEST("memory that is left is not above a limit, and is 0 beyond it") {
    static const rlim_t limits[] = {(rlim_t)1 << 46, 1};
    const uint64_t left = lg_memory_left();
    assert_true(left > 0);
    for (size_t i = 0; i < LG_COUNT(limits); i++) {
        int status = -1;
        const pid_t child = fork();
        if (child == 0) {
            const struct rlimit to = {limits[i], RLIM_INFINITY};
            const bool set = setrlimit(RLIMIT_AS, &to) == 0;
            if (limits[i] == 1 && malloc(16 << 20) != NULL) _exit(0); /* qemu has no such limit */
            const uint64_t now = lg_memory_left();
            _exit(set && (i == 0 ? now > 0 && now <= limits[i] : now == 0) ? 0 : 1);
        }
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    }
}
