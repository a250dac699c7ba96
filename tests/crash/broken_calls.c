/* Runs commands whose calls of the C library fail (support/faults.h): in each run another call fails, alone
 * or with all later calls.
 *
 *     broken_calls EXECUTABLES FAULTY-EXECUTABLES memory|files [-n CALLS] [-s SEED] [-o NAME]
 *
 * In other runs, a call that moves bytes moves half of them, or is interrupted. A run must end with exit code
 * 0 and the outputs of an undisturbed run, or with the exit code for memory (5) or files (3) and one
 * sentence. Each output must be absent, unchanged or complete. If memory fails, no temporary file or lock may
 * be left. If there is a checkpoint, the command then continues without failing calls, and must write the
 * outputs of the undisturbed run. The first call of each different stack fails, in every way. With -n, so
 * many of these calls of each command are drawn, and each fails in one way; without -s, SEED is that of the
 * commit. The results are printed as a Markdown table. If a check fails, the exit code is 1. */
#define _GNU_SOURCE
#include <limits.h>
#include <sys/wait.h>
#include <unistd.h>

#include "crash/commands.h"
#include "support/faults.h"
#include "support/seed.h"

enum { CODE_FILE = 3, CODE_MEMORY = 5 };

static const struct {
    const char *name;
    fault_class of;
    fault_way way;
    bool later;
} ways[] = {
    {"fails", FAULT_MEMORY, FAULT_FAIL, false},    {"and all later ones", FAULT_MEMORY, FAULT_FAIL, true},
    {"fails", FAULT_FILES, FAULT_FAIL, false},     {"and all later ones", FAULT_FILES, FAULT_FAIL, true},
    {"is short", FAULT_FILES, FAULT_SHORT, false}, {"is interrupted", FAULT_FILES, FAULT_INTERRUPT, false},
};

typedef struct breaking {
    bench b;
    long calls, tried, runs, good, refused, resumed;
    long *chosen; /* (tried): numbers of the calls that fail */
    const char *faulty;
    fault_class of;
} breaking;

static lg_rng rng;

/* Runs the job without failing calls. Fills k->calls and k->chosen. */
static void choose_calls(breaking *k, long most) {
    const char *path = work("../chosen");
    char words[PATH_MAX + 64];
    clean();
    (void)snprintf(words, sizeof words, "%d:0:%s", (int)k->of, path);
    (void)setenv("LG_FAULT_CHOOSE", words, 1);
    const int code = wait_for(start(k->faulty, k->b.job, ""));
    (void)unsetenv("LG_FAULT_CHOOSE");
    FILE *file = fopen(path, "r");
    if (code != 0 || file == NULL || fscanf(file, "%ld", &k->calls) != 1)
        stop("%s: exit code %d; see %s", k->b.job->name, code, error_path());
    k->chosen = calloc((size_t)k->calls + 1, sizeof *k->chosen);
    if (k->chosen == NULL) stop("out of memory");
    while (k->tried < k->calls && fscanf(file, "%ld", &k->chosen[k->tried]) == 1) k->tried++;
    (void)fclose(file);
    if (most == 0 || most >= k->tried) return;
    for (long i = 0; i < most; i++) {
        long *drawn = &k->chosen[i + (long)lg_rng_below(&rng, (uint64_t)(k->tried - i))], call = *drawn;
        *drawn = k->chosen[i];
        k->chosen[i] = call;
    }
    k->tried = most;
}

/* Counts the lines that the program or its libraries wrote on standard error, without warnings and without
 * the lines that say where results are kept, or which earlier results are replaced. */
static int sentences(char all[512], int *warnings) {
    char line[4096];
    size_t length = 0;
    int count = 0;
    FILE *file = fopen(error_path(), "r");
    all[0] = '\0';
    *warnings = 0;
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        if (strncmp(line, "lg-", 3) != 0 && strncmp(line, "liegrad:", 8) != 0) continue;
        const bool warning = strstr(line, "warning: ") != NULL;
        *warnings += warning;
        count += !warning && strstr(line, "kept in") == NULL && strstr(line, ": replaces an earlier") == NULL;
        if (length < 400) length += (size_t)snprintf(all + length, 512 - length, "%.100s", line);
    }
    if (file != NULL) (void)fclose(file);
    return count;
}

static void resume(breaking *k, const char *told) {
    bench *b = &k->b;
    const job *j = b->job;
    if (j->checkpoint == NULL || !exists(work(j->checkpoint))) return;
    if (j->appends) b->cut = whole_lines(work(j->outputs[0]));
    const int code = wait_for(start(NULL, j, more_of(j)));
    k->resumed++;
    if (code != 0) fail(b, "%s: exit code %d of the run after it", told, code);
    if (code == 0 && !outputs_equal(b)) fail(b, "%s: other outputs of the run after it", told);
}

static void try_call(breaking *k, size_t way, long n) {
    bench *b = &k->b;
    const job *j = b->job;
    char words[64], told[128], all[512];
    if (j->outputs[0] != NULL && j->keeps && lg_rng_uniform(&rng) < 0.5) {
        clean();
        put_old(b);
    } else {
        clean_for(b);
    }
    b->cut = 0;
    (void)snprintf(words, sizeof words, "%d:%d:%ld:%ld", (int)k->of, (int)ways[way].way, n,
                   ways[way].later ? LONG_MAX : n);
    (void)snprintf(told, sizeof told, "LG_FAULT=%s", words);
    (void)setenv("LG_FAULT", words, 1);
    const int code = wait_for(start(k->faulty, j, ""));
    (void)unsetenv("LG_FAULT");
    int warnings;
    k->runs++;
    const int said = sentences(all, &warnings);
    if (code == 0) {
        k->good++;
        b->warned = warnings > 0;
        if (!outputs_equal(b)) fail(b, "%s: exit code 0 with other outputs: %s", told, all);
        b->warned = false;
    } else if (code != (k->of == FAULT_MEMORY ? CODE_MEMORY : CODE_FILE)) {
        fail(b, "%s: exit code %d: %s", told, code, all);
    } else {
        k->refused++;
        if (said < 1 || said > 1 + ways[way].later) fail(b, "%s: %d sentences: %s", told, said, all);
    }
    b->gaps = k->of == FAULT_FILES && said > 0;
    if (code != 0) check_cut_short(b, 0, progress(j));
    b->gaps = false;
    const int left = count_left(work(""), ".liegrad-", true);
    if (left > 0 && k->of == FAULT_MEMORY) fail(b, "%s: %d temporary files or locks are left", told, left);
    if (code != 0) resume(k, told);
}

static void run_job(breaking *k, long most) {
    clean_for(&k->b);
    note_outputs(&k->b);
    choose_calls(k, most);
    for (long i = 0; i < k->tried && k->b.failed < 10; i++) {
        /* calls of files fail more often than they are short or interrupted, which most calls cannot be */
        uint64_t way = 0, drawn = lg_rng_below(&rng, k->of == FAULT_MEMORY ? 2 : 6) % 4;
        for (size_t w = 0; w < LG_COUNT(ways); w++)
            if (ways[w].of == k->of && (way++ == drawn || most == 0)) try_call(k, w, k->chosen[i]);
    }
    (void)printf("| %s | %ld | %ld | %ld | %ld | %ld | %ld | %llu |\n", k->b.job->name, k->calls, k->tried,
                 k->runs, k->good, k->refused, k->resumed, (unsigned long long)k->b.failed);
    (void)fflush(stdout);
    free(k->chosen);
}

int main(int argc, char **argv) {
    uint64_t seed = 0, failed = 0;
    const char *only = "";
    long runs = 0, most = 0;
    for (int c; (c = getopt(argc, argv, "n:s:o:")) != -1;) {
        if (c == 'n') most = strtol(optarg, NULL, 10);
        if (c == 's') seed = strtoull(optarg, NULL, 10);
        if (c == 'o') only = optarg;
        if (c == '?') return 2;
    }
    if (optind + 3 != argc)
        stop("usage: broken_calls EXECUTABLES FAULTY memory|files [-n CALLS] [-s SEED] [-o NAME]");
    char *faulty = realpath(argv[optind + 1], NULL);
    if (faulty == NULL) stop("there is no folder %s", argv[optind + 1]);
    lg_rng_seed(&rng, seed > 0 ? seed : commit_seed(), 0);
    make_inputs(argv[optind], true, &rng);
    (void)printf("| command | calls | tried | runs | complete | refused | resumed | failures "
                 "|\n|---|---|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < job_count; i++) {
        if (strstr(jobs[i].name, only) == NULL) continue;
        breaking k = {.b.job = &jobs[i], .b.stopped = true, .faulty = faulty};
        k.of = strcmp(argv[optind + 2], "files") == 0 ? FAULT_FILES : FAULT_MEMORY;
        run_job(&k, most);
        failed += k.b.failed;
        runs += k.runs;
    }
    (void)printf("\n%ld runs, %llu failures\n", runs, (unsigned long long)failed);
    if (failed == 0) remove_inputs();
    free(faulty);
    return failed > 0;
}
