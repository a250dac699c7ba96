/* Temporary names and locks: files that killed writers leave, and two writers of the same file. */
#define _XOPEN_SOURCE 700 /* mkdtemp */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "test_support.h"

#include "liegrad/files.h"

static void leave_folder(void *path) {
    assert_int_equal(chdir("/") | system(test_text("cd / && rm -r '%s'", (const char *)path)), 0);
}

/* Makes a folder for the test and changes to it. */
static void io_enter_folder(void) {
    static char path[] = "/tmp/liegrad-test-XXXXXX";
    memcpy(path + strlen(path) - 6, "XXXXXX", 6);
    assert_non_null(mkdtemp(path));
    lg_test_owns(path, leave_folder);
    assert_int_equal(chdir(path), 0);
}

static bool is_there(const char *path) {
    struct stat about;
    return lstat(path, &about) == 0;
}

static void put(const char *path) {
    const int fd = open(path, O_WRONLY | O_CREAT, 0666);
    assert_true(fd >= 0);
    assert_int_equal(close(fd), 0);
}

TEST("a writer removes what killed writers of the same file left, and nothing else") {
    static const char *const left[] = {"model.h5.tmp-1-0", "model.h5.tmp-99999999-3"};
    static const char *const others[] = {"model.h5.tmp-1", "model.h5.tmp-1-0.txt", "xmodel.h5.tmp-1-0",
                                         "model.h5.tmp-a-0", "odel.h5.tmp-1-0"};
    io_enter_folder();
    for (size_t i = 0; i < LG_COUNT(left); i++) put(left[i]);
    for (size_t i = 0; i < LG_COUNT(others); i++) put(others[i]);
    assert_int_equal(symlink("model.h5.tmp-a-0", "model.h5.tmp-7-7"), 0);
    assert_ok(lg_file_write(NULL, "model.h5", "x", 1, NULL));
    assert_true(is_there("model.h5"));
    for (size_t i = 0; i < LG_COUNT(left); i++) assert_false(is_there(left[i]));
    for (size_t i = 0; i < LG_COUNT(others); i++) assert_true(is_there(others[i]));
    assert_true(is_there("model.h5.tmp-7-7"));
}

TEST("a temporary folder that was left is removed with its files") {
    io_enter_folder();
    lg_temporary t;
    assert_int_equal(mkdir("code.tmp-1-0", 0777), 0);
    put("code.tmp-1-0/a.c");
    put("code.tmp-1-0/.b");
    assert_ok(lg_temporary_create(NULL, "code", true, &t, NULL));
    assert_false(is_there("code.tmp-1-0"));
    assert_true(is_there(t.name));
    assert_int_equal(rmdir(t.name), 0);
    lg_temporary_end(&t);
    assert_int_equal(mkdir("out", 0777), 0);
    put("out/.tmp-1-0");
    assert_ok(lg_temporary_create(NULL, "out/", true, &t, NULL));
    assert_false(is_there("out/.tmp-1-0"));
    assert_int_equal(rmdir(t.name), 0);
    lg_temporary_end(&t);
}

TEST("a file that another process is writing stays") {
    int ready[2], done[2];
    char name[64] = "", byte = 0;
    io_enter_folder();
    assert_int_equal(pipe(ready), 0);
    assert_int_equal(pipe(done), 0);
    const pid_t child = fork();
    if (child == 0) {
        lg_temporary t;
        const bool made = lg_temporary_create(NULL, "busy.h5", false, &t, NULL) == LG_OK;
        (void)!write(ready[1], "x", 1);
        (void)!read(done[0], &byte, 1);
        _exit(made && rename(t.name, "theirs.h5") == 0 ? 0 : 1);
    }
    assert_int_equal(read(ready[0], &byte, 1), 1);
    (void)snprintf(name, sizeof name, "busy.h5.tmp-%ld-0", (long)child);
    assert_ok(lg_file_write(NULL, "busy.h5", "x", 1, NULL));
    assert_true(is_there(name) && is_there("busy.h5"));
    assert_int_equal(write(done[1], "x", 1), 1);
    int status = 1;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    assert_true(is_there("theirs.h5"));
}

TEST("a writer that was killed leaves a file that the next writer removes") {
    io_enter_folder();
    const pid_t child = fork();
    if (child == 0) {
        lg_temporary t;
        if (lg_temporary_create(NULL, "dead.h5", false, &t, NULL) == LG_OK) (void)kill(getpid(), SIGKILL);
        _exit(1);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    const char *name = test_text("dead.h5.tmp-%ld-0", (long)child);
    assert_true(is_there(name));
    assert_ok(lg_file_write(NULL, "dead.h5", "x", 1, NULL));
    assert_false(is_there(name));
}

/* ---- locks ---- */

/* A child in its own process group that takes the lock of `target`, reports it and waits. The running test
 * owns it. */
typedef struct holder {
    pid_t pid; /* 0: it was ended */
    int said;
} holder;

static void end_holder(void *of) {
    holder *h = of;
    if (h->pid == 0) return;
    (void)kill(h->pid, SIGKILL);
    (void)waitpid(h->pid, NULL, 0);
    (void)kill(-h->pid, SIGKILL);
    (void)close(h->said);
    h->pid = 0;
}

static holder *hold(const char *target, bool orphan) {
    int ends[2];
    char byte;
    holder *h = lg_test_memory(sizeof *h);
    assert_int_equal(pipe(ends), 0);
    *h = (holder){fork(), ends[0]};
    if (h->pid == 0) {
        lg_lock lock;
        (void)setpgid(0, 0);
        if (lg_lock_take(NULL, target, "model --out 'a b'", &lock, NULL) != LG_OK) _exit(1);
        if (orphan && fork() == 0) /* inherits the descriptor and outlives its parent */
            for (;;) (void)pause();
        (void)!write(ends[1], "x", 1);
        for (;;) (void)pause();
    }
    lg_test_owns(h, end_holder);
    (void)close(ends[1]);
    assert_int_equal(read(ends[0], &byte, 1), 1);
    return h;
}

TEST("a second process is told who holds the lock, and takes it over when the holder was killed") {
    lg_lock lock;
    lg_error error = {LG_OK, ""};
    char wanted[256], host[65] = "";
    io_enter_folder();
    (void)gethostname(host, sizeof host - 1);
    holder *h = hold("model.h5", false);
    (void)snprintf(wanted, sizeof wanted,
                   "model.h5: is being written by process %ld on %s: model --out 'a b'", (long)h->pid, host);
    assert_int_equal(lg_lock_take(NULL, "model.h5", "another", &lock, &error), LG_FILE);
    assert_string_equal(error.message, wanted);
    assert_int_equal(lock.fd, -1);
    assert_true(is_there("model.h5.lock"));
    end_holder(h);
    assert_true(is_there("model.h5.lock"));
    assert_ok(lg_lock_take(NULL, "model.h5", "another", &lock, NULL));
    lg_lock_release(&lock);
    assert_false(is_there("model.h5.lock"));
}

TEST("a child of a killed holder neither keeps nor removes the lock") {
    lg_lock lock;
    io_enter_folder();
    holder *h = hold("model.h5", true);
    assert_int_equal(kill(h->pid, SIGKILL), 0);
    assert_int_equal(waitpid(h->pid, NULL, 0), h->pid);
    assert_ok(lg_lock_take(NULL, "model.h5", "another", &lock, NULL));
    const pid_t child = fork();
    if (child == 0) {
        lg_lock_release(&lock);
        _exit(0);
    }
    assert_int_equal(waitpid(child, NULL, 0), child);
    assert_true(is_there("model.h5.lock"));
    lg_lock_release(&lock);
    assert_false(is_there("model.h5.lock"));
}

TEST("a holder whose name is not known is reported by its process number") {
    lg_lock lock;
    lg_error error = {LG_OK, ""};
    io_enter_folder();
    holder *h = hold("model.h5", false);
    assert_int_equal(truncate("model.h5.lock", 0), 0);
    const char *wanted = test_text("model.h5: is being written by process %ld", (long)h->pid);
    assert_int_equal(lg_lock_take(NULL, "model.h5", "another", &lock, &error), LG_FILE);
    assert_string_equal(error.message, wanted);
    end_holder(h);
}

/* In a child without the rights of the superuser: what taking the lock of model.h5 gives. */
typedef enum taken { TAKEN, NOT_LOCKED, REFUSED } taken;

static taken take_as_another_user(void) {
    int status = -1;
    const pid_t child = fork();
    if (child == 0) {
        lg_lock lock;
        if (getuid() == 0 && setuid(65534) != 0) _exit(9);
        if (lg_lock_take(NULL, "model.h5", "another", &lock, NULL) != LG_OK) _exit(REFUSED);
        const taken got = lock.fd >= 0 ? TAKEN : NOT_LOCKED;
        lg_lock_release(&lock);
        _exit((int)got);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    return (taken)WEXITSTATUS(status);
}

TEST("a lock file of another user is taken over if nobody holds it and it can be removed") {
    static const struct {
        mode_t folder;
        bool held;
        taken wanted;
    } rows[] = {{0777, true, REFUSED}, {0555, false, NOT_LOCKED}, {0777, false, TAKEN}};
    io_enter_folder();
    put("model.h5.lock");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        assert_int_equal(chmod("model.h5.lock", rows[i].held ? 0644 : 0444), 0);
        holder *h = rows[i].held ? hold("model.h5", false) : NULL;
        assert_int_equal(chmod("model.h5.lock", 0444) | chmod(".", rows[i].folder), 0);
        assert_int_equal(take_as_another_user(), rows[i].wanted);
        assert_int_equal(chmod(".", 0777), 0);
        if (h != NULL) end_holder(h);
        assert_int_equal(is_there("model.h5.lock"), rows[i].wanted != TAKEN);
    }
}

TEST("what a lock file says is printed without control characters, and long words are cut") {
    static char words[1000];
    char line[1000] = "";
    lg_lock lock;
    io_enter_folder();
    memset(words, 'w', sizeof words - 1);
    assert_ok(lg_lock_take(NULL, "a", words, &lock, NULL));
    FILE *file = fopen("a.lock", "r");
    assert_non_null(file);
    assert_non_null(fgets(line, sizeof line, file));
    assert_true(strlen(line) < 500 && line[strlen(line) - 1] == '\n');
    (void)fclose(file);
    lg_lock_release(&lock);
    lg_error error = {LG_OK, ""};
    holder *h = hold("b", false);
    file = fopen("b.lock", "w");
    assert_non_null(file);
    (void)fputs("\033[31mred\nsecond", file);
    (void)fclose(file);
    assert_int_equal(lg_lock_take(NULL, "b", "another", &lock, &error), LG_FILE);
    assert_string_equal(error.message, "b: is being written by ?[31mred");
    end_holder(h);
}

TEST("a lock that cannot be made is refused, also if the target's folder is missing") {
    lg_lock lock = {.fd = 7};
    lg_error error = {LG_OK, ""};
    io_enter_folder();
    assert_int_equal(lg_lock_take(NULL, "none/model.h5", "x", &lock, &error), LG_FILE);
    assert_non_null(strstr(error.message, "none/model.h5: cannot be written: its lock none/model.h5.lock: "));
    assert_int_equal(lock.fd, -1);
    assert_int_equal(symlink("elsewhere", "model.h5.lock"), 0);
    assert_int_equal(lg_lock_take(NULL, "model.h5", "x", &lock, &error), LG_FILE);
    assert_false(is_there("elsewhere"));
}

/* Adds 1 to the number in a file `rounds` times, each time under the lock. */
static void count_up(int rounds) {
    while (rounds > 0) {
        lg_lock lock;
        char text[16] = "";
        if (lg_lock_take(NULL, "count", "counting", &lock, NULL) != LG_OK) continue;
        const int fd = open("count", O_RDWR);
        if (fd < 0 || pread(fd, text, sizeof text - 1, 0) < 0) _exit(1);
        const struct timespec pause = {0, 20000};
        (void)nanosleep(&pause, NULL);
        (void)snprintf(text, sizeof text, "%-8d", atoi(text) + 1);
        if (pwrite(fd, text, 8, 0) != 8) _exit(1);
        (void)close(fd);
        lg_lock_release(&lock);
        rounds--;
    }
    _exit(0);
}

TEST("only one process at a time holds a lock that is taken and removed all the time") {
    enum { PROCESSES = 4, ROUNDS = 400 };
    char text[16] = "";
    io_enter_folder();
    put("count");
    for (int i = 0; i < PROCESSES; i++)
        if (fork() == 0) count_up(ROUNDS);
    for (int i = 0; i < PROCESSES; i++) {
        int status = 1;
        assert_true(wait(&status) > 0);
        assert_int_equal(status, 0);
    }
    const int fd = open("count", O_RDONLY);
    assert_true(pread(fd, text, sizeof text - 1, 0) > 0);
    (void)close(fd);
    assert_int_equal(atoi(text), PROCESSES * ROUNDS);
    assert_false(is_there("count.lock"));
}
