/* Runs executables and checks their exit code, standard output, standard error and JSON. */
#ifndef LG_TEST_CLI_SUPPORT_H
#define LG_TEST_CLI_SUPPORT_H

#include "test_support.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { CLI_TEXT = 524288, CLI_WORDS = 64 };

typedef struct cli {
    int code; /* exit code; 1000 + signal when a signal killed the program */
    char out[CLI_TEXT], err[CLI_TEXT];
} cli;
static cli result; /* of the command that ran last */

typedef struct cli_child {
    pid_t pid;
    int out, err;
} cli_child;

static char cli_folder[256]; /* where commands run */

static inline void cli_make_folder(void) {
    const char *base = getenv("TMPDIR");
    (void)snprintf(cli_folder, sizeof cli_folder, "%s/lg-test-XXXXXX", base != NULL ? base : "/tmp");
    if (mkdtemp(cli_folder) == NULL) cli_folder[0] = '\0';
}

static inline void cli_path(const char *name, char *out, size_t size) {
    (void)snprintf(out, size, "%s/%s", cli_folder, name);
}

static inline const char *cli_at(const char *name) {
    return test_text("%s/%s", cli_folder, name);
}

static inline bool cli_is_dots(const char *name) {
    return strcmp(name, ".") == 0 || strcmp(name, "..") == 0;
}

static inline void cli_remove_folder(void) {
    DIR *folder = opendir(cli_folder);
    for (struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;) {
        if (cli_is_dots(entry->d_name)) continue;
        const char *path = test_text("%s/%s", cli_folder, entry->d_name);
        if (unlink(path) != 0) (void)rmdir(path);
    }
    if (folder != NULL) (void)closedir(folder);
    (void)rmdir(cli_folder);
}

/* Number of entries of the test's folder whose name contains `part`. */
static inline int cli_count_files(const char *part) {
    int count = 0;
    DIR *folder = opendir(cli_folder);
    for (struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;)
        if (!cli_is_dots(entry->d_name) && strstr(entry->d_name, part) != NULL) count++;
    if (folder != NULL) (void)closedir(folder);
    return count;
}

static inline bool cli_exists(const char *name) {
    struct stat information;
    return stat(cli_at(name), &information) == 0;
}

static inline void cli_write(const char *name, const char *text) {
    FILE *file = fopen(cli_at(name), "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

/* Makes a symbolic link `name` to `target`; both are in the test's folder. */
static inline void cli_link(const char *target, const char *name) {
    assert_int_equal(symlink(target, cli_at(name)), 0);
}

static inline void cli_unlink(const char *name) {
    assert_int_equal(unlink(cli_at(name)), 0);
}

/* Removes files that an earlier command made and that a command of another kind is going to write; `names`
 * are separated by blanks. */
static inline void cli_forget(const char *names) {
    char *text = test_text("%s", names);
    for (char *save = NULL, *name = strtok_r(text, " ", &save); name != NULL;
         name = strtok_r(NULL, " ", &save))
        (void)unlink(cli_at(name));
}

static inline size_t cli_read(const char *name, char *out, size_t size) {
    FILE *file = fopen(cli_at(name), "r");
    assert_non_null(file);
    const size_t n = fread(out, 1, size - 1, file);
    out[n] = '\0';
    assert_int_equal(fclose(file), 0);
    return n;
}

/* Starts a program. `arguments` are split at blanks. `file_limit` > 0: the most bytes that a file may have
 * (RLIMIT_FSIZE). */
static inline cli_child cli_start(const char *program, const char *arguments, rlim_t file_limit) {
    int out[2], err[2];
    char path[1024];
    char *words[CLI_WORDS] = {path};
    int n = 1;
    (void)snprintf(path, sizeof path, "%s/%s", LG_BIN_DIR, program);
    char *text = test_text("%s", arguments);
    for (char *save = NULL, *word = strtok_r(text, " ", &save); word != NULL && n < CLI_WORDS - 1;
         word = strtok_r(NULL, " ", &save))
        words[n++] = word;
    words[n] = NULL;
    assert_int_equal(pipe(out), 0);
    assert_int_equal(pipe(err), 0);
    const pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        const struct rlimit limit = {file_limit, file_limit};
        if (dup2(out[1], STDOUT_FILENO) < 0 || dup2(err[1], STDERR_FILENO) < 0) _exit(126);
        (void)close(out[0]);
        (void)close(err[0]);
        if (chdir(cli_folder) != 0) _exit(126);
        if (file_limit > 0 && setrlimit(RLIMIT_FSIZE, &limit) != 0) _exit(126);
        (void)execv(path, words);
        _exit(127);
    }
    (void)close(out[1]);
    (void)close(err[1]);
    return (cli_child){pid, out[0], err[0]};
}

/* Appends what can be read now to `text`. Returns false at the end of the stream. */
static inline bool cli_drain(int fd, char *text, size_t *used) {
    char buffer[4096];
    const ssize_t n = read(fd, buffer, sizeof buffer);
    if (n < 0 && errno == EINTR) return true;
    if (n <= 0) return false;
    const size_t room = CLI_TEXT - 1 - *used, kept = (size_t)n < room ? (size_t)n : room;
    memcpy(text + *used, buffer, kept);
    *used += kept;
    text[*used] = '\0';
    return true;
}

static inline void cli_finish(cli_child child) {
    struct pollfd streams[2] = {{child.out, POLLIN, 0}, {child.err, POLLIN, 0}};
    size_t used[2] = {0, 0};
    int status = 0;
    result.out[0] = result.err[0] = '\0';
    while (streams[0].fd >= 0 || streams[1].fd >= 0) {
        if (poll(streams, 2, -1) < 0 && errno != EINTR) break;
        for (int i = 0; i < 2; i++)
            if (streams[i].fd >= 0 && streams[i].revents != 0 &&
                !cli_drain(streams[i].fd, i == 0 ? result.out : result.err, &used[i]))
                streams[i].fd = -1;
    }
    (void)close(child.out);
    (void)close(child.err);
    while (waitpid(child.pid, &status, 0) < 0 && errno == EINTR) {
    }
    result.code = WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

static inline void cli_run_limited(const char *program, const char *arguments, rlim_t file_limit) {
    cli_finish(cli_start(program, arguments, file_limit));
}

/* Runs a command. Fails unless its exit code is `code`, and `words` are in standard error (code != 0) or in
 * standard output (code 0). */
static inline void cli_expect_limited(const char *program, const char *arguments, rlim_t file_limit, int code,
                                      const char *words) {
    cli_run_limited(program, arguments, file_limit);
    if (result.code != code)
        fail_msg("%s %s: exit code %d, expected %d\n%s%s", program, arguments, result.code, code, result.out,
                 result.err);
    if (strstr(code != 0 ? result.err : result.out, words) == NULL)
        fail_msg("%s %s: '%s' is not in\n%s%s", program, arguments, words, result.out, result.err);
}

static inline void cli_expect(const char *program, const char *arguments, int code, const char *words) {
    cli_expect_limited(program, arguments, 0, code, words);
}

/* Runs a command that must succeed. */
static inline void cli_run(const char *program, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
static inline void cli_run(const char *program, const char *format, ...) {
    char line[1024];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    cli_expect(program, line, 0, "");
}

/* ---- names that a plot shows as they are ---- */

enum { CLI_NAMES = 6 };
static inline const char *cli_strange_name(size_t i) {
    static const char *const names[CLI_NAMES] = {
        "a`touch RAN`\"5",           "u'.system('touch RAN').'\\n_x^y",
        "'.system(\"touch RAN\").'", "\"; !touch RAN; <b>&amp; %d",
        "$(touch RAN)@T[1]\\7",      "~{a}{.6-}&{/Symbol b}%",
    };
    return names[i];
}

/* Asserts that the plot is drawn and shows the names first to end - 1, each behind the text `before`, and
 * that no command in them ran. Without gnuplot there is no plot. */
static inline void cli_shows_names(const char *path, const char *before, size_t first, size_t end) {
    static char text[4 * CLI_TEXT];
    assert_false(cli_exists("RAN"));
    if (strstr(result.err, "gnuplot is not installed") != NULL) return;
    if (strstr(result.err, "gnuplot") != NULL) fail_msg("%s: %s", path, result.err);
    (void)cli_read(path, text, sizeof text);
    for (size_t i = first; i < end; i++) {
        char name[256];
        size_t used = (size_t)snprintf(name, sizeof name, "%s", before);
        for (const char *c = cli_strange_name(i); *c != '\0'; c++)
            used += (size_t)snprintf(name + used, sizeof name - used, "%s%.*s",
                                     *c == '<'   ? "&lt;"
                                     : *c == '&' ? "&amp;"
                                                 : "",
                                     *c != '<' && *c != '&', c);
        if (strstr(text, name) == NULL) fail_msg("%s does not show %s", path, name);
    }
}

/* ---- a strict JSON reader (RFC 8259): each function returns the position after the value, or NULL if there
 * is none ---- */

static inline const char *json_value(const char *s);
static inline const char *json_key(const char *text, const char *quoted, size_t length);

static inline const char *json_space(const char *s) {
    while (*s == ' ' || *s == '\n' || *s == '\t' || *s == '\r') s++;
    return s;
}

static inline const char *json_string(const char *s) {
    if (*s++ != '"') return NULL;
    for (; *s != '"'; s++) {
        if ((unsigned char)*s < 0x20) return NULL;
        if (*s != '\\') continue;
        s++;
        if (*s == 'u') {
            for (int i = 0; i < 4; i++)
                if (!isxdigit((unsigned char)*++s)) return NULL;
        } else if (*s == '\0' || strchr("\"\\/bfnrt", *s) == NULL) {
            return NULL;
        }
    }
    return s + 1;
}

static inline const char *json_digits(const char *s) {
    if (!isdigit((unsigned char)*s)) return NULL;
    while (isdigit((unsigned char)*s)) s++;
    return s;
}

static inline const char *json_number_end(const char *s) {
    if (*s == '-') s++;
    s = *s == '0' ? s + 1 : json_digits(s);
    if (s != NULL && *s == '.') s = json_digits(s + 1);
    if (s != NULL && (*s == 'e' || *s == 'E')) {
        s++;
        if (*s == '+' || *s == '-') s++;
        s = json_digits(s);
    }
    return s;
}

/* The members behind the bracket `first`. An object has no key twice. */
static inline const char *json_members(const char *first, char close, bool keys) {
    const char *s = json_space(first + 1);
    if (*s == close) return s + 1;
    for (;;) {
        if (keys) {
            const char *key = json_space(s);
            s = json_string(key);
            if (s == NULL) return NULL;
            const char *before = json_key(first, key, (size_t)(s - key));
            if (before != NULL && before < key) return NULL;
            s = json_space(s);
            if (*s++ != ':') return NULL;
        }
        s = json_value(s);
        if (s == NULL) return NULL;
        s = json_space(s);
        if (*s == close) return s + 1;
        if (*s++ != ',') return NULL;
    }
}

static inline const char *json_value(const char *s) {
    static const char *const words[] = {"true", "false", "null"};
    s = json_space(s);
    if (*s == '{') return json_members(s, '}', true);
    if (*s == '[') return json_members(s, ']', false);
    if (*s == '"') return json_string(s);
    for (size_t i = 0; i < 3; i++)
        if (strncmp(s, words[i], strlen(words[i])) == 0) return s + strlen(words[i]);
    return json_number_end(s);
}

/* Whether the text is one JSON object and nothing else. */
static inline bool json_is_object(const char *text) {
    if (*json_space(text) != '{') return false;
    const char *end = json_value(text);
    return end != NULL && *json_space(end) == '\0';
}

/* Where a member of the outermost object begins; NULL if it is missing. */
static inline const char *json_key(const char *text, const char *quoted, size_t length) {
    const char *s = json_space(text) + 1;
    for (;;) {
        s = json_space(s);
        const char *end = json_string(s);
        if (end == NULL) return NULL;
        if ((size_t)(end - s) == length && strncmp(s, quoted, length) == 0) return s;
        s = json_space(json_space(end) + 1);
        s = json_value(s);
        if (s == NULL || *(s = json_space(s)) != ',') return NULL;
        s++;
    }
}

/* Where its value begins. */
static inline const char *json_find(const char *text, const char *key) {
    const char *quoted = test_text("\"%s\"", key), *s = json_key(text, quoted, strlen(quoted));
    return s == NULL ? NULL : json_space(json_space(json_string(s)) + 1);
}

static inline double json_number(const char *text, const char *key) {
    const char *s = json_find(text, key);
    if (s == NULL) fail_msg("no key '%s' in %s", key, text);
    return s != NULL && json_number_end(s) != NULL ? strtod(s, NULL) : (double)NAN;
}

/* Reads an array of numbers, or an array of such arrays, into `out`, one number after the other. */
static inline size_t json_array(const char *text, const char *key, double *out, size_t room) {
    const char *s = json_find(text, key);
    if (s == NULL || *s != '[') fail_msg("no array '%s' in %.200s", key, text);
    size_t n = 0;
    for (int depth = 0; s != NULL; s++) {
        if (*s == '[') depth++;
        if (*s == ']' && --depth == 0) break;
        if (strchr("[], \n", *s) != NULL) continue;
        const char *end = json_number_end(s);
        if (end == NULL) fail_msg("'%s' holds no numbers", key);
        if (n < room) out[n] = strtod(s, NULL);
        n++;
        s = end - 1;
    }
    return n;
}

/* Whether the member `key` is as `want` says: * accepts anything; <x and >x compare; a number must agree to a
 * relative error of 1e-12; any other text must be equal. */
static inline bool json_is(const char *object, const char *key, const char *want) {
    const char *value = json_find(object, key);
    if (value == NULL) fail_msg("no key '%s' in %s", key, object);
    const bool compared = *want == '<' || *want == '>';
    if (*want == '*') return true;
    if (!compared && *want != '-' && !isdigit((unsigned char)*want))
        return strncmp(value, want, strlen(want)) == 0;
    const double number = json_number(object, key), than = strtod(want + compared, NULL);
    return *want == '<' ? number < than : *want == '>' ? number > than : lg_is_close(number, than, 1e-12, 0);
}

/* Fails unless `object` has these members: "points 6, loss <1e-3, preset null, seconds *" (see json_is). */
static inline void json_expect(const char *object, const char *members) {
    char list[1024], key[64], want[64], *save = NULL;
    (void)snprintf(list, sizeof list, "%s", members);
    for (char *member = strtok_r(list, ",", &save); member != NULL; member = strtok_r(NULL, ",", &save)) {
        assert_int_equal(sscanf(member, " %63s %63[^,]", key, want), 2);
        if (!json_is(object, key, want)) fail_msg("%s: not %s in %s", key, want, object);
    }
}

/* Runs the command with --json. It must print one object with these members. */
static inline void cli_json(const char *program, const char *arguments, const char *members) {
    const char *line = test_text("%s --json", arguments);
    cli_expect(program, line, 0, "");
    if (!json_is_object(result.out)) fail_msg("%s %s: no JSON object: %s", program, line, result.out);
    json_expect(result.out, members);
}

/* Skips tests of demos in cross builds: a demo starts other programs directly, without the emulator. */
static inline void cli_needs_programs(void) {
#ifdef LG_CROSS
    skip();
#endif
}

/* ---- for programs with several commands ---- */

/* Makes a folder for the group of tests, with an empty file and a file that is not HDF5. */
static inline int cli_begin(void) {
    cli_make_folder();
    if (cli_folder[0] == '\0') return -1;
    /* By default the sanitizers end a program that allocates too much; here malloc must return NULL. */
    (void)setenv("ASAN_OPTIONS", "allocator_may_return_null=1", 0);
    (void)setenv("TSAN_OPTIONS", "allocator_may_return_null=1", 0);
    cli_write("empty.h5", "");
    cli_write("foreign.h5", "this is no HDF5 file, whatever its name says\n");
    return 0;
}

static inline int cli_end(void **state) {
    cli_remove_folder();
    return 0;
}

static inline void cli_release_folder(void *folder) {
    cli_remove_folder();
}

/* Makes a folder for the running test alone. */
static inline void cli_test_folder(void) {
    assert_int_equal(cli_begin(), 0);
    lg_test_owns(cli_folder, cli_release_folder);
}

/* Waits up to half a minute for a file to appear. */
static inline void cli_wait_for(const char *name) {
    const struct timespec pause = {0, 20000000};
    for (int i = 0; i < 1500 && !cli_exists(name); i++) (void)nanosleep(&pause, NULL);
    assert_true(cli_exists(name));
}

/* Whether the process has installed its handler of SIGINT. */
static inline bool cli_catches_interrupts(pid_t pid) {
    char line[256];
    unsigned long long caught = 0;
    FILE *status = fopen(test_text("/proc/%d/status", (int)pid), "r");
    assert_non_null(status);
    while (fgets(line, sizeof line, status) != NULL) (void)sscanf(line, "SigCgt: %llx", &caught);
    (void)fclose(status);
    return (caught >> (SIGINT - 1) & 1) != 0;
}

/* Sends SIGINT once the child catches it. On a busy machine the child may need up to half a minute to
 * start. */
static inline void cli_interrupt(cli_child child) {
    const struct timespec pause = {0, 20000000};
    for (int i = 0; i < 1500 && !cli_catches_interrupts(child.pid); i++) (void)nanosleep(&pause, NULL);
    assert_int_equal(kill(child.pid, SIGINT), 0);
    cli_finish(child);
    assert_int_equal(result.code, 130);
}

#endif
