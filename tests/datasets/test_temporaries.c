/* Temporary names: what killed writers leave. */
#define _XOPEN_SOURCE 700 /* mkdtemp */
#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "test_support.h"

#include "liegrad/io.h"

static void leave_folder(void *path) {
    char command[64];
    (void)snprintf(command, sizeof command, "cd / && rm -r '%s'", (const char *)path);
    assert_int_equal(chdir("/") | system(command), 0);
}

/* A folder of the test alone, which is the current one. */
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

TEST("a folder that was left goes with its files") {
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

TEST("a writer that was killed leaves a file for the next one to remove") {
    char name[64];
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
    (void)snprintf(name, sizeof name, "dead.h5.tmp-%ld-0", (long)child);
    assert_true(is_there(name));
    assert_ok(lg_file_write(NULL, "dead.h5", "x", 1, NULL));
    assert_false(is_there(name));
}
