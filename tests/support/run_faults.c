#define _GNU_SOURCE
#include "support/run_faults.h"

#include <fcntl.h>
#include <fnmatch.h>
#include <limits.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "support/faults.h"
#include "support/seed.h"

/* A run hangs if it takes PATIENCE seconds and SLOWER times as long as the undisturbed run took on this
 * machine, with its present load. A test that takes more CPU time than LONGEST times the seconds that it is
 * given is left out: its few runs would take most of the time. */
enum { MOST_STACKS = 1 << 20, PATIENCE = 60, SLOWER = 20, LONGEST = 25 };
typedef enum verdict { PASSED, REFUSED, SILENT, LEAKED, DIED, VERDICTS } verdict;
static const char *const verdict_names[] = {"passed", "refused", "silent", "leaked", "died"};

/* The result of a run in shared memory. A run is a child process; its parent reads the result. */
static struct report {
    long calls, live;
    bool ended, passed, hit, told;
    uint64_t stacks[MOST_STACKS];
} * report;

static struct {
    bool wanted;
    fault_class of;
    fault_way way;
    double seconds; /* for a test */
    long from, to;  /* of the run */
    bool armed;
    long live; /* blocks and identifiers before the test */
    unsigned patience;
    int output;
} now = {.of = FAULT_MEMORY, .seconds = 10};

int run_faults_options(int *argc, char **argv) {
    if (*argc < 3 || strcmp(argv[1], "--faults") != 0) return 0;
    now.wanted = true;
    now.of = strncmp(argv[2], "files", 5) == 0  ? FAULT_FILES
             : strncmp(argv[2], "hdf5", 4) == 0 ? FAULT_HDF5
                                                : FAULT_MEMORY;
    now.way = strstr(argv[2], ":short") != NULL       ? FAULT_SHORT
              : strstr(argv[2], ":interrupt") != NULL ? FAULT_INTERRUPT
                                                      : FAULT_FAIL;
    const char *seconds = strrchr(argv[2], ':');
    if (seconds != NULL && seconds[1] >= '0' && seconds[1] <= '9') now.seconds = strtod(seconds + 1, NULL);
    argv[2] = argv[0];
    *argc -= 2;
    return 2;
}

bool run_faults_wanted(void) {
    return now.wanted;
}

void run_faults_begin(void) {
    if (!now.armed) return;
    now.live = faults_live() + faults_identifiers();
    faults_arm(now.of, now.way, now.from, now.to);
}

void run_faults_end(bool passed) {
    if (!now.armed) return;
    report->calls = faults_calls(now.of);
    report->hit = faults_hit();
    report->live = faults_live() + faults_identifiers() - now.live;
    report->passed = passed;
    report->ended = true;
}

bool lg_test_faulty(void) {
    return now.wanted;
}

bool lg_test_again(lg_status status) {
    static bool done;
    if (status == LG_OK || !now.armed || !faults_hit()) return false;
    report->told = report->told || status == LG_OUT_OF_MEMORY || status == LG_FILE ||
                   (now.of == FAULT_HDF5 && (status == LG_FORMAT || status == LG_NOT_FOUND));
    if (status != LG_OUT_OF_MEMORY || done) return false;
    faults_disarm();
    done = true;
    return true;
}

/* ---- a run ---- */

static _Noreturn void run_child(lg_suite *suite, const struct CMUnitTest *test) {
    (void)dup2(now.output, STDOUT_FILENO);
    (void)dup2(now.output, STDERR_FILENO);
    (void)alarm(now.patience);
    const struct itimerval most = {.it_value.tv_sec = (time_t)(LONGEST * now.seconds),
                                   .it_value.tv_usec = (suseconds_t)(1e6 * fmod(LONGEST * now.seconds, 1.0))};
    if (now.from == 0) (void)setitimer(ITIMER_PROF, &most, NULL);
    now.armed = true;
    const int failed = _cmocka_run_group_tests("faults", test, 1, suite->begin, NULL);
    const int end = suite->end != NULL ? suite->end(NULL) : 0;
    (void)fflush(NULL);
    if (failed == 0 && end == 0) exit(0); /* the leak sanitizer looks for leaks at the exit */
    _exit(1);
}

/* What the last run printed. */
static const char *output_of_run(void) {
    static char text[8192];
    const ssize_t n = pread(now.output, text, sizeof text - 1, 0);
    text[n > 0 ? n : 0] = '\0';
    return text;
}

/* Whether the last run says that memory or a file is the reason. */
static bool says_why(void) {
    static const char *const words[][5] = {{"memory", "allocation failed", "OUT_OF_MEMORY", "--- 0x4 != "},
                                           {"cannot be", "Input/output error", "LG_FILE", "No space left"},
                                           {"memory", "OUT_OF_MEMORY", "FORMAT", "NOT_FOUND", "cannot be"}};
    const char *text = output_of_run();
    for (size_t i = 0; i < LG_COUNT(words[0]) && words[now.of][i] != NULL; i++)
        if (strstr(text, words[now.of][i]) != NULL) return true;
    return false;
}

static verdict run(lg_suite *suite, const struct CMUnitTest *test, long from, long to) {
    int state = 0;
    now.from = from;
    now.to = to;
    report->ended = report->told = false;
    if (ftruncate(now.output, 0) != 0 || lseek(now.output, 0, SEEK_SET) != 0) return DIED;
    (void)fflush(NULL);
    const pid_t child = fork();
    if (child == 0) run_child(suite, test);
    if (child < 0 || waitpid(child, &state, 0) < 0) return DIED;
    if (!report->ended || !WIFEXITED(state) || WEXITSTATUS(state) > 1) return DIED;
    if (strstr(output_of_run(), "exception: ") != NULL) return DIED;
    if (report->passed) return WEXITSTATUS(state) == 0 ? PASSED : LEAKED;
    return report->told || says_why() ? REFUSED : SILENT;
}

/* ---- a test ---- */

static void tell(const struct CMUnitTest *test, verdict is, long from, long to) {
    const char *text = output_of_run(), *at = strstr(text, "ERROR");
    printf("%s: '%s', call %ld%s\n%.1500s\n", verdict_names[is], test->name, from,
           to > from ? " and all later ones" : "", at != NULL ? at : text);
}

static double seconds_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* If there is time for fewer calls than there are stacks, the commit draws them. */
static long choose_calls(long calls, long most, long *chosen) {
    static uint64_t drawn;
    const long noted = calls < MOST_STACKS ? calls : MOST_STACKS;
    const long stacks = faults_choose(report->stacks, noted, calls, 0, chosen);
    if (most >= stacks) return faults_choose(report->stacks, noted, calls, most, chosen);
    lg_rng rng = test_rng(commit_seed(), drawn++);
    for (long i = 0; i < most; i++) {
        long *at = &chosen[i + (long)lg_rng_below(&rng, (uint64_t)(stacks - i))], call = *at;
        *at = chosen[i];
        chosen[i] = call;
    }
    return most;
}

static void try_test(lg_suite *suite, const struct CMUnitTest *test, long sum[VERDICTS]) {
    enum { TOLD = 3 }; /* runs of a test and verdict that are printed */
    long mine[VERDICTS] = {0};
    faults_note_stacks(now.of, report->stacks, MOST_STACKS);
    const double begin = seconds_now();
    now.patience = PATIENCE * SLOWER;
    const verdict plain = run(suite, test, 0, 0);
    const double took = seconds_now() - begin, most = now.seconds / took / 2.0;
    now.patience = PATIENCE + (unsigned)(SLOWER * took);
    const long calls = report->calls, live = report->live;
    faults_note_stacks(now.of, NULL, 0);
    if (plain != PASSED || calls == 0) return; /* the test was skipped, or fails without a failing call */
    long *chosen = lg_test_memory((size_t)calls * sizeof *chosen);
    const long count = choose_calls(calls, (long)fmax(2.0, fmin(most, (double)calls)), chosen);
    for (long k = 0; k < 2 * count; k++) {
        const long n = chosen[k / 2], to = k % 2 > 0 ? LONG_MAX : n;
        verdict is = run(suite, test, n, to);
        if (is == PASSED && report->live != live) is = LEAKED;
        if (++mine[is] <= TOLD && is >= SILENT) tell(test, is, n, to);
    }
    for (int i = 0; i < VERDICTS; i++) sum[i] += mine[i];
    if (mine[SILENT] + mine[LEAKED] + mine[DIED] == 0) return;
    printf("'%s': %ld calls", test->name, calls);
    for (int i = 0; i < VERDICTS; i++) printf(", %ld %s", mine[i], verdict_names[i]);
    printf("\n");
    lg_test_give_back(0);
}

int run_faults(lg_suite *suite, const char *claim) {
    long sum[VERDICTS] = {0};
    report = mmap(NULL, sizeof *report, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    now.output = memfd_create("output", MFD_CLOEXEC);
    if (report == MAP_FAILED || now.output < 0) return 2;
    for (size_t i = 0; i < suite->count; i++)
        if (claim == NULL || fnmatch(claim, suite->tests[i].name, 0) == 0)
            try_test(suite, &suite->tests[i], sum);
    printf("faults:");
    for (int i = 0; i < VERDICTS; i++) printf(" %ld %s", sum[i], verdict_names[i]);
    printf("\n");
    return sum[LEAKED] + sum[DIED] > 0;
}
