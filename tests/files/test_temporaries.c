/* Temporary names and locks: files that killed writers leave, and two writers of the same file. */
#define _DEFAULT_SOURCE /* mkdtemp, flock */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "test_support.h"

#include "files/temporary.h"
#include "liegrad/files.h"
#include "support/faults.h"

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

static void put_text(const char *path, const char *text) {
    const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, text, strlen(text)), strlen(text));
    assert_int_equal(close(fd), 0);
}

/* A writer of the target begins a temporary file or folder and is killed. Returns its name. */
static const char *leave_behind(const char *target, bool folder) {
    char name[300] = "";
    int ends[2], status = 0;
    assert_int_equal(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) {
        lg_temporary t;
        if (lg_temporary_create(NULL, target, folder, &t, NULL) != LG_OK) _exit(1);
        if (write(ends[1], t.name, strlen(t.name)) > 0) (void)kill(getpid(), SIGKILL);
        _exit(1);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    assert_true(read(ends[0], name, sizeof name - 1) > 0);
    (void)close(ends[0]);
    (void)close(ends[1]);
    return test_text("%s", name);
}

static uint64_t inode_of(const char *path) {
    struct stat about;
    assert_int_equal(lstat(path, &about), 0);
    return about.st_ino;
}

static const char *long_target(void) {
    static char name[241];
    memset(name, 'n', 240);
    return name;
}

static void sweep(const char *target) {
    const int folder = lg_open_folder(target);
    assert_true(folder >= 0);
    lg_sweep(folder, target);
    assert_int_equal(close(folder), 0);
}

TEST("a writer that was killed leaves a file or empty folder that the next writer removes, also for long "
     "names") {
    const char *const targets[] = {"dead.h5", "./dead.h5", long_target()};
    io_enter_folder();
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        const char *name = leave_behind(targets[i], false);
        assert_says(name, test_text(".liegrad-tmp-%llu-", (unsigned long long)inode_of(name)));
        put_text(name, "half");
        assert_ok(lg_file_write(NULL, targets[i], "x", 1, NULL));
        assert_true(is_there(targets[i]));
        assert_false(is_there(name));
    }
    assert_int_equal(mkdir("out", 0777), 0);
    for (int i = 0; i < 2; i++) { /* the folder `code`; a folder in `out` */
        lg_temporary t;
        const char *target = i == 0 ? "code" : "out/", *name = leave_behind(target, true);
        assert_says(name, i == 0 ? ".code.liegrad-tmp-" : "out/.liegrad-tmp-");
        assert_ok(lg_temporary_create(NULL, target, true, &t, NULL));
        assert_false(is_there(name));
        assert_true(is_there(t.name));
        assert_int_equal(rmdir(t.name), 0);
        lg_temporary_end(&t);
    }
}

TEST("at the end of a process its open temporary files and folders are removed, but not by a forked child") {
    io_enter_folder();
    lg_temporary file, folder, done, gone;
    assert_ok(lg_temporary_create(NULL, "file", false, &file, NULL));
    assert_ok(lg_temporary_create(NULL, "folder", true, &folder, NULL));
    assert_ok(lg_temporary_create(NULL, "done", false, &done, NULL));
    assert_ok(lg_temporary_create(NULL, "gone", false, &gone, NULL));
    assert_ok(lg_temporary_publish(&done, "done", NULL));
    assert_int_equal(unlink(gone.name), 0);
    put(gone.name); /* another file with this name */
    const char *name = test_text("%s", gone.name);
    const pid_t child = fork();
    if (child == 0) {
        lg_temporary own;
        const bool made = lg_temporary_create(NULL, "own", false, &own, NULL) == LG_OK;
        lg_temporary_remove_all();
        _exit(!made || is_there(own.name) || !is_there(file.name) || !is_there(folder.name));
    }
    int status = 1;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
    lg_temporary_remove_all();
    assert_false(is_there(file.name) || is_there(folder.name));
    assert_true(is_there("done") && is_there(name));
    lg_temporary *const all[] = {&file, &folder, &done, &gone};
    for (size_t i = 0; i < LG_COUNT(all); i++) lg_temporary_end(all[i]);
}

TEST("a folder with the name of a temporary folder keeps its files") {
    io_enter_folder();
    lg_temporary t;
    assert_int_equal(mkdir("thesis", 0777), 0);
    put_text("thesis/chapter", "three years\n");
    const char *name = test_text(".code.liegrad-tmp-%llu-1", (unsigned long long)inode_of("thesis"));
    assert_int_equal(rename("thesis", name), 0);
    assert_ok(lg_temporary_create(NULL, "code", true, &t, NULL));
    assert_true(is_there(test_text("%s/chapter", name)));
    assert_int_equal(rmdir(t.name), 0);
    lg_temporary_end(&t);
}

TEST("a writer that is killed before its file has its name leaves an empty file that the next writer "
     "removes") {
    io_enter_folder();
    for (int folder = 0; folder < 2; folder++) {
        struct timespec now;
        (void)clock_gettime(CLOCK_REALTIME, &now);
        const long long t = (long long)now.tv_sec * 1000000000 + now.tv_nsec;
        const char *young = test_text(".model.h5.liegrad-tmp-%lld-1", t);
        const char *old = test_text(".model.h5.liegrad-tmp-%lld-1", t - 5000000000);
        const char *full = test_text(".model.h5.liegrad-tmp-%lld-2", t);
        const char *const names[] = {young, old, full};
        for (size_t i = 0; i < LG_COUNT(names); i++)
            if (folder) assert_int_equal(mkdir(names[i], 0777), 0);
        if (!folder) put(young), put(old), put_text(full, "x");
        if (folder) put(test_text("%s/a", full));
        sweep("model.h5");
        assert_false(is_there(young));
        assert_true(is_there(old) && is_there(full));
    }
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
        (void)close(done[1]);
        lg_status status = lg_temporary_create(NULL, "busy.h5", false, &t, NULL);
        if (lg_test_again(status)) status = lg_temporary_create(NULL, "busy.h5", false, &t, NULL);
        if (status != LG_OK) _exit(1);
        (void)!write(ready[1], t.name, strlen(t.name));
        (void)!read(done[0], &byte, 1);
        _exit(rename(t.name, "theirs.h5") == 0 ? 0 : 1);
    }
    (void)close(ready[1]); /* so the parent does not wait for a child that has ended */
    assert_true(read(ready[0], name, sizeof name - 1) > 0);
    assert_true(is_there(name));
    assert_ok(lg_file_write(NULL, "busy.h5", "x", 1, NULL));
    assert_true(is_there(name) && is_there("busy.h5"));
    assert_int_equal(write(done[1], "x", 1), 1);
    int status = 1;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    assert_true(is_there("theirs.h5"));
}

TEST("a temporary file of another user stays") {
    io_enter_folder();
    if (getuid() != 0) skip();
    const char *name = leave_behind("model.h5", false);
    assert_int_equal(chown(name, 65534, 65534), 0);
    sweep("model.h5");
    assert_true(is_there(name));
}

/* Before call number `at` of the sweep, the folder `left` is exchanged for `with`: a link or a folder. */
static struct {
    long calls, at;
    const char *left, *with;
} exchange;

static void exchange_folder(void) {
    if (++exchange.calls != exchange.at) return;
    (void)rename(exchange.left, "elsewhere");
    (void)rename(exchange.with, exchange.left);
}

/* Sweeps with the exchange before the given call (0: none). Returns the number of calls. */
static long sweep_exchanged(long at, bool link) {
    assert_int_equal(system("rm -rf mine elsewhere link .code* code*; mkdir mine"), 0);
    put("mine/a");
    if (link) assert_int_equal(symlink("mine", "link"), 0);
    exchange.left = leave_behind("code", true);
    exchange.with = link ? "link" : "mine";
    exchange.at = at;
    exchange.calls = 0;
    faults_interpose(exchange_folder);
    sweep("code");
    faults_interpose(NULL);
    assert_true(is_there("mine/a") || (at > 0 && !link && is_there(test_text("%s/a", exchange.left))));
    assert_true(at > 0 || !is_there(exchange.left));
    return exchange.calls;
}

TEST("a folder that is exchanged for a link or another folder during the sweep is not emptied") {
    io_enter_folder();
    for (int link = 0; link < 2; link++) {
        const long calls = sweep_exchanged(0, link);
        assert_true(calls > 3);
        for (long at = 1; at <= calls; at++) (void)sweep_exchanged(at, link);
    }
}

/* ---- files of others ---- */

/* What is in the folder, but for the output: names, inodes, kinds, rights, sizes, times, targets of links. */
static char *look_around(void) {
    enum { MOST = 1 << 16 };
    char *found = lg_test_memory(MOST);
    FILE *list =
        popen("find . -mindepth 1 ! -path ./model.h5 -printf '%P %i %y %m %n %s %C@ %l\\n' | sort", "r");
    assert_non_null(list);
    assert_true(fread(found, 1, MOST, list) < MOST);
    assert_int_equal(pclose(list), 0);
    return found;
}

/* Fails with the first line that differs from `before`. */
static void assert_untouched(const char *before) {
    const char *now = look_around();
    if (strcmp(now, before) == 0) return;
    while (*now == *before) now++, before++;
    fail_msg("a file was changed: %.60s became %.60s", before, now);
}

/* A name around model.h5 of a form that this or an earlier version uses, or of one that is near to it. */
static const char *draw_name(lg_rng *rng) {
    static const char *const forms[] = {"%s.lock",
                                        ".%s.lock",
                                        "%s.tmp-%llu-%llu",
                                        ".%s.liegrad-tmp-%llu-%llu",
                                        ".%s.liegrad-tmp-0%llu-%llu",
                                        ".%s.liegrad-tmp-%llu--%llu",
                                        ".%s.liegrad-tmp-+%llu-%llu",
                                        ".%s.liegrad-tmp-%llu-%llux",
                                        ".%s.liegrad-tmp- %llu-%llu",
                                        ".%s.liegrad-tmp-%llu",
                                        "%s.liegrad-tmp-%llu-%llu",
                                        ".%s.liegrad-tmp-99999999999999999999-%llu",
                                        ".%s.liegrad-tmp--%llu-%llu",
                                        "%s.liegrad-lock",
                                        ".%s.liegrad-lock.%llu"};
    static const char *const bases[] = {"model.h5", "model.h5", "model.h5", "xmodel.h5", "model.h", "*"};
    const struct timespec now = {time(NULL), 0};
    const unsigned long long numbers[] = {inode_of("."), inode_of("mine"), inode_of("mine/a"),
                                          lg_rng_below(rng, 100),
                                          (unsigned long long)now.tv_sec * 1000000000 - 3000000000};
    const char *base = bases[lg_rng_below(rng, LG_COUNT(bases))];
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
    return test_text(forms[lg_rng_below(rng, LG_COUNT(forms))], base,
                     numbers[lg_rng_below(rng, LG_COUNT(numbers))], lg_rng_below(rng, 99999));
#pragma GCC diagnostic pop
}

static void put_foreign(const char *name, lg_rng *rng) {
    if (is_there(name)) return;
    switch (lg_rng_below(rng, 6)) {
    case 0:
        put(name);
        break;
    case 1:
        put_text(name, "important\n");
        break;
    case 2:
        assert_int_equal(mkdir(name, 0777), 0);
        break;
    case 3:
        assert_int_equal(mkdir(name, 0777), 0);
        put_text(test_text("%s/results.csv", name), "mine\n");
        break;
    case 4:
        assert_int_equal(symlink(lg_rng_below(rng, 2) ? "mine" : "mine/a", name), 0);
        break;
    default:
        assert_int_equal(lg_rng_below(rng, 2) ? mkfifo(name, 0666) : link("mine/a", name), 0);
    }
}

TEST("files and folders of others stay as they are, whatever their names") {
    enum { ROUNDS = 150, NAMES = 12 };
    io_enter_folder();
    lg_rng rng = test_rng(62, 0);
    assert_int_equal(mkdir("mine", 0777), 0);
    put_text("mine/a", "important\n");
    for (int round = 0; round < ROUNDS; round++) {
        lg_temporary t;
        lg_lock lock = {.fd = -1};
        for (int i = 0; i < NAMES; i++) put_foreign(draw_name(&rng), &rng);
        const bool foreign = lg_rng_below(&rng, 2) > 0;
        if (foreign) put_foreign(".model.h5.liegrad-lock", &rng);
        char *before = look_around();
        assert_int_equal(lg_lock_take(NULL, "model.h5", "x", &lock, NULL), foreign ? LG_FILE : LG_OK);
        assert_ok(lg_file_write(NULL, "model.h5", "x", 1, NULL));
        assert_ok(lg_temporary_create(NULL, "model.h5", true, &t, NULL));
        assert_int_equal(rmdir(t.name), 0);
        lg_temporary_end(&t);
        lg_lock_release(&lock);
        assert_untouched(before);
        assert_int_equal(system("find . -mindepth 1 ! -path './mine*' -delete"), 0);
    }
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
        /* the orphan inherits the descriptor and outlives its parent */
        if (!orphan || fork() == 0) (void)!write(ends[1], "x", 1);
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
    assert_true(is_there(".model.h5.liegrad-lock"));
    end_holder(h);
    assert_true(is_there(".model.h5.liegrad-lock"));
    assert_ok(lg_lock_take(NULL, "model.h5", "another", &lock, NULL));
    lg_lock_release(&lock);
    assert_false(is_there(".model.h5.liegrad-lock"));
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
    assert_true(is_there(".model.h5.liegrad-lock"));
    lg_lock_release(&lock);
    assert_false(is_there(".model.h5.liegrad-lock"));
}

/* The text of a lock that was left by a killed process. */
static const char *text_of_lock(char text[1000]) {
    memset(text, 0, 1000);
    const int fd = open(".model.h5.liegrad-lock", O_RDONLY);
    assert_true(fd >= 0 && read(fd, text, 999) > 0);
    assert_int_equal(close(fd), 0);
    return text;
}

TEST("a file that has the name of a lock and is none stays, and the lock is refused") {
    char text[1000];
    lg_error error = {LG_OK, ""};
    lg_lock lock;
    io_enter_folder();
    end_holder(hold("model.h5", false));
    const char *left = text_of_lock(text);
    const char *const texts[] = {"",
                                 "important\n",
                                 test_text("%smore\n", left),
                                 test_text("%.40s", left),
                                 test_text("%.*s", (int)strlen(left) - 1, left),
                                 test_text("\n%s", left),
                                 test_text("%.*s\n", (int)(strchr(left, '\n') - left), left)};
    for (size_t i = 0; i < LG_COUNT(texts) + 4; i++) {
        assert_int_equal(system("rm -rf .model.h5.liegrad-lock"), 0);
        if (i < LG_COUNT(texts)) put_text(".model.h5.liegrad-lock", texts[i]);
        if (i == LG_COUNT(texts)) assert_int_equal(mkdir(".model.h5.liegrad-lock", 0777), 0);
        if (i == LG_COUNT(texts) + 1) assert_int_equal(mkfifo(".model.h5.liegrad-lock", 0666), 0);
        if (i == LG_COUNT(texts) + 2) assert_int_equal(symlink("elsewhere", ".model.h5.liegrad-lock"), 0);
        if (i == LG_COUNT(texts) + 3) {
            put_text("copy", left);
            assert_int_equal(symlink("copy", ".model.h5.liegrad-lock"), 0);
        }
        char *before = look_around();
        assert_int_equal(lg_lock_take(NULL, "model.h5", "another", &lock, &error), LG_FILE);
        assert_string_equal(error.message,
                            "model.h5: cannot be written: its lock would be .model.h5.liegrad-lock, "
                            "but that is not a lock: move it away");
        assert_int_equal(lock.fd, -1);
        assert_untouched(before);
    }
}

TEST("a file that gets the name of a held lock stays when the lock is released") {
    lg_lock lock;
    io_enter_folder();
    assert_ok(lg_lock_take(NULL, "model.h5", "x", &lock, NULL));
    assert_int_equal(rename(".model.h5.liegrad-lock", "moved"), 0);
    put_text(".model.h5.liegrad-lock", "important\n");
    char *before = look_around();
    lg_lock_release(&lock);
    assert_untouched(before);
}

TEST("no output has the name of a lock or of a temporary file") {
    static const char *const names[] = {".model.h5.liegrad-lock", "./.model.h5.liegrad-tmp-1-2",
                                        ".liegrad-lock"};
    lg_error error = {LG_OK, ""};
    lg_lock lock;
    lg_temporary t;
    io_enter_folder();
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        put_text(names[i], "important\n");
        char *before = look_around();
        assert_int_equal(lg_lock_take(NULL, names[i], "x", &lock, NULL), LG_FILE);
        assert_int_equal(lg_temporary_create(NULL, names[i], false, &t, NULL), LG_FILE);
        assert_int_equal(lg_file_write(NULL, names[i], "x", 1, &error), LG_FILE);
        assert_says(error.message, "cannot be written: locks and temporary files have such names");
        assert_untouched(before);
    }
}

TEST("a process does not take a lock twice, and a lock that cannot be written leaves nothing") {
    lg_error error = {LG_OK, ""};
    lg_lock lock, second;
    io_enter_folder();
    assert_ok(lg_lock_take(NULL, "model.h5", "first", &lock, NULL));
    assert_int_equal(lg_lock_take(NULL, "model.h5", "second", &second, &error), LG_FILE);
    assert_says(error.message, "first");
    assert_true(is_there(".model.h5.liegrad-lock"));
    lg_lock_release(&lock);
    int status = 1;
    const pid_t child = fork();
    if (child == 0) {
        const struct rlimit none = {10, 10};
        (void)setrlimit(RLIMIT_FSIZE, &none);
        const bool refused = lg_lock_take(NULL, "model.h5", "x", &lock, &error) == LG_FILE;
        _exit(refused && strstr(error.message, "File too large") != NULL ? 0 : 1);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
    assert_untouched("");
}

TEST("locks of long names, and of a folder, work") {
    const char *const targets[] = {long_target(), "out/"};
    lg_lock lock;
    io_enter_folder();
    assert_int_equal(mkdir("out", 0777), 0);
    char *before = look_around();
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        assert_ok(lg_lock_take(NULL, targets[i], "x", &lock, NULL));
        assert_true(lock.fd >= 0 && is_there(lock.name));
        lg_lock_release(&lock);
    }
    struct dirent **names = NULL;
    assert_true(before[0] != '\0' && scandir("out", &names, NULL, NULL) == 2);
    free(names[0]);
    free(names[1]);
    free(names);
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
    end_holder(hold("model.h5", false));
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        holder *h = rows[i].held ? hold("model.h5", false) : NULL;
        assert_int_equal(chmod(".model.h5.liegrad-lock", 0444) | chmod(".", rows[i].folder), 0);
        assert_int_equal(take_as_another_user(), rows[i].wanted);
        assert_int_equal(chmod(".", 0777), 0);
        if (h != NULL) end_holder(h);
        assert_int_equal(is_there(".model.h5.liegrad-lock"), rows[i].wanted != TAKEN);
    }
}

TEST("what a lock file says is printed without control characters, and long words are cut") {
    static char words[1000];
    char line[1000] = "";
    lg_lock lock, second;
    io_enter_folder();
    memset(words, 'w', sizeof words - 1);
    assert_ok(lg_lock_take(NULL, "a", words, &lock, NULL));
    FILE *file = fopen(".a.liegrad-lock", "r");
    assert_non_null(file);
    assert_non_null(fgets(line, sizeof line, file));
    assert_non_null(fgets(line, sizeof line, file));
    assert_true(strlen(line) > 300 && strlen(line) < 500 && line[strlen(line) - 1] == '\n');
    (void)fclose(file);
    lg_lock_release(&lock);
    lg_error error = {LG_OK, ""};
    holder *h = hold("b", false);
    file = fopen(".b.liegrad-lock", "r+");
    assert_non_null(file);
    assert_non_null(fgets(line, sizeof line, file));
    assert_int_equal(fseek(file, 0, SEEK_CUR) | ftruncate(fileno(file), (off_t)strlen(line)), 0);
    (void)fputs("process 1\033[31mred\n", file);
    (void)fclose(file);
    assert_int_equal(lg_lock_take(NULL, "b", "another", &lock, &error), LG_FILE);
    assert_string_equal(error.message, "b: is being written by process 1?[31mred");
    assert_ok(lg_lock_take(NULL, "c", "one\ntwo\033", &lock, NULL));
    assert_int_equal(lg_lock_take(NULL, "c", "x", &second, &error), LG_FILE);
    assert_says(error.message, ": one?two?");
    lg_lock_release(&lock);
    end_holder(h);
}

TEST("a lock is refused if the target's folder is missing") {
    lg_lock lock = {.fd = 7};
    lg_error error = {LG_OK, ""};
    io_enter_folder();
    assert_int_equal(lg_lock_take(NULL, "none/model.h5", "x", &lock, &error), LG_FILE);
    assert_non_null(
        strstr(error.message, "none/model.h5: cannot be written: its lock none/.model.h5.liegrad-lock: "));
    assert_int_equal(lock.fd, -1);
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
    assert_false(is_there(".count.liegrad-lock"));
}
