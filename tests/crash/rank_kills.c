/* Disturbs commands that mpirun runs as several ranks, and lets them continue with another number of ranks:
 *
 *     rank_kills FOLDER-OF-EXECUTABLES [-n CASES] [-s SEED] [-o NAME]
 *
 * At a random moment of the run a rank is killed, stopped for ever or slowed (stopped and continued many
 * times), or mpirun gets SIGTERM; or one rank has little memory from the start. The run must end within
 * `patience` seconds, a rank that was only slowed must not be given up, and a rank must have said why the run
 * failed. Afterwards each output must be absent, unchanged or complete, and a checkpoint must hold at least
 * what it held before. SIGTERM must leave no lock and no temporary file. Then the command runs to its end,
 * with 1 to 4 ranks: its outputs must be those of one undisturbed process, and no temporary file, lock or
 * part may be left. If a check fails the exit code is 1; without mpirun or liegrad_mpi it is 77. The results
 * are printed as a Markdown table. */
#define _GNU_SOURCE /* getopt in addition to POSIX */
#include "crash/commands.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { RANKS = 3, RANKS_MOST = 4, WORDS_ROOM = 2048 };
static const double patience = 60.0; /* s */
static const char silence[] = "10";  /* LIEGRAD_SILENCE, s */

#define SAVES   "--checkpoint check.h5 --out model.h5"
#define RESUMES .checkpoint = "check.h5", .again = "--resume check.h5", .keeps = true
/* The parts of searches and studies continue by themselves. */
#define CONTINUES(table) .checkpoint = table, .again = "", .outputs = {table}

static const job rank_jobs[] = {
    {"`lg-hamiltonian train`, adam", "lg-hamiltonian",
     "train ../in/data.h5 --threads 1 --shards 4 --method adam --epochs 60 --hidden 16,16 --checkpoint-every "
     "4 " SAVES,
     RESUMES, .outputs = {"model.h5"}},
    {"`lg-hamiltonian train`, ssbroyden", "lg-hamiltonian",
     "train ../in/data.h5 --threads 1 --shards 4 --method ssbroyden --epochs 60 --hidden 16,16 "
     "--checkpoint-every 4 " SAVES,
     RESUMES, .outputs = {"model.h5"}},
    {"`lg-identify fit`, lm", "lg-identify",
     "fit ../in/machine.yaml ../in/log.csv --threads 1 --shards 4 --epochs 5 --method lm --checkpoint-every "
     "1 " SAVES,
     RESUMES, .outputs = {"model.h5"}},
    {"`lg-control train`", "lg-control",
     "train ../in/task.yaml --threads 1 --seeds 2 --race 6 --finish 4 --polish 3 --out model.h5",
     .keeps = true, .outputs = {"model.h5"}},
    {"`lg-elastica search`", "lg-elastica",
     "search ../in/ranges.yaml ../in/curves.h5 --threads 1 --trials 12 --seed 3 --out trials.csv",
     CONTINUES("trials.csv")},
    {"`lg-hamiltonian study`", "lg-hamiltonian", "study ../in/wide.yaml --threads 1 --out study.csv",
     CONTINUES("study.csv")},
    {"`lg-hamiltonian generate`", "lg-hamiltonian",
     "generate ../in/pendulum.yaml --threads 1 --trajectories 8000 --points 60 --out made.h5", .keeps = true,
     .outputs = {"made.h5"}},
    {"`lg-anomaly generate`", "lg-anomaly", "generate --noise 10 --runs 12 --threads 1 --out made.h5",
     .keeps = true, .outputs = {"made.h5"}},
    {"`lg-simulate --ensemble`", "lg-simulate",
     "../in/circles.yaml --ensemble 40000 --points 4 --event q=0 --threads 1 --out made.h5", .keeps = true,
     .outputs = {"made.h5"}},
};

static const struct {
    const char *name, *text;
} texts[] = {
    {"circles.yaml", "system: oscillator\ninitial: {q: 1, p: 0}\nensemble: q = normal 0 1\nt_end: 20\n"},
    {"wide.yaml", "scene: pendulum.yaml\nintegrators: [euler, rk4]\nN: [20]\nM: [3]\neps: [0]\nrepeats: 8\n"
                  "t_end: 0.1\nepochs: 60\nbatch: 80\nlr: 1e-2\nlr_step: 50\nlr_gamma: 0.1\n"
                  "test: {trajectories: 10, points: 5}\nseed: 1\n"},
    {"plant.yaml",
     "columns: {time: t}\ncoordinates: [{name: th, kind: angle, velocity: w}]\ninputs: {columns: [u]}\n"
     "mass: {kind: known, values: [[1]]}\npotential: {kind: known, form: linear, of: th, values: [0, 1]}\n"
     "damping: {kind: known, values: [0.1]}\ninput_map: {kind: known, values: [[1]]}\n"},
    {"task.yaml", "plant: plant.yaml\nperiod: 0.1\nhorizon: 3\nstarts: {th: [-3, 3]}\nlimits: {u: 0.7}\n"
                  "cost: {th: 1, w: 0.1}\nsuccess: {th: 0.1, hold: 1, within: 5}\n"
                  "controller: {kind: network, hidden: [8]}\n"},
    {"less", "[ \"$OMPI_COMM_WORLD_RANK\" != \"$LESS_RANK\" ] || ulimit -v $LESS_MEMORY\nexec \"$@\"\n"},
};

typedef enum disturbance { KILLED, STOPPED, SLOWED, TERMINATED, LITTLE_MEMORY, DISTURBANCES } disturbance;

typedef struct result {
    uint64_t cases[DISTURBANCES], untouched, resumed, failed;
    double longest; /* s from the disturbance to the end */
} result;

static lg_rng rng;
static bool others_ended; /* if a run does not end: whether all ranks but one have ended */
static const char *executables;

static void sleep_for(double seconds) {
    const struct timespec pause = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
    if (seconds > 0) (void)nanosleep(&pause, NULL);
}

static void set_number(const char *name, uint64_t value) {
    char text[32];
    (void)snprintf(text, sizeof text, "%llu", (unsigned long long)value);
    (void)setenv(name, text, 1);
}

/* ---- processes ---- */

static pid_t start_ranks(const job *j, uint64_t ranks, const char *more) {
    char words[WORDS_ROOM];
    (void)snprintf(words, sizeof words,
                   "--oversubscribe --mca odls_base_sigkill_timeout 4 -n %llu sh ../in/less %s/%s %s",
                   (unsigned long long)ranks, executables, j->program, j->arguments);
    const job launched = {.name = j->name, .program = "mpirun", .arguments = words};
    return ranks == 1 ? start(NULL, j, more) : start("/usr/bin", &launched, more);
}

/* Returns the process of a rank, or 0 if the rank has no process. mpirun starts the ranks as its children. */
static pid_t rank_process(pid_t launcher, uint64_t rank) {
    char path[64], name[32] = "";
    pid_t pid = 0, found = 0;
    (void)snprintf(path, sizeof path, "/proc/%d/task/%d/children", (int)launcher, (int)launcher);
    FILE *children = fopen(path, "r");
    for (uint64_t i = 0; children != NULL && fscanf(children, "%d", &pid) == 1; i++)
        if (i == rank) found = pid;
    if (children != NULL) (void)fclose(children);
    (void)snprintf(path, sizeof path, "/proc/%d/comm", (int)found);
    FILE *comm = found > 0 ? fopen(path, "r") : NULL;
    if (comm != NULL && fscanf(comm, "%31s", name) != 1) name[0] = '\0';
    if (comm != NULL) (void)fclose(comm);
    return strncmp(name, "lg-", 3) == 0 || strcmp(name, "exe") == 0 ? found : 0;
}

/* Waits for the end of the run, at most `patience` seconds. If the run does not end, kills it and returns
 * -1. */
static int wait_at_most(pid_t launcher, double since) {
    siginfo_t info = {.si_pid = 0};
    int left = 0;
    while (seconds_now() - since < patience) {
        if (waitid(P_PID, (id_t)launcher, &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid != 0)
            return wait_for(launcher);
        sleep_for(0.02);
    }
    for (uint64_t r = 0; r < RANKS; r++) {
        const pid_t pid = rank_process(launcher, r);
        if (pid > 0) (void)kill(pid, SIGKILL);
        left += pid > 0;
    }
    others_ended = left <= 1;
    (void)kill(launcher, SIGKILL);
    (void)wait_for(launcher);
    return -1;
}

/* Returns the epoch in which the training says that it stopped and saved its state, or 0 if it says
 * nothing. */
static long stopped_in(void) {
    static const char words[] = "stopped in epoch ";
    char line[1024];
    long epoch = 0;
    FILE *said = fopen(error_path(), "r");
    while (said != NULL && fgets(line, sizeof line, said) != NULL) {
        const char *at = strstr(line, words);
        if (at != NULL && strstr(line, "--resume") != NULL) epoch = strtol(at + strlen(words), NULL, 10);
    }
    if (said != NULL) (void)fclose(said);
    return epoch;
}

/* Whether a rank has written a line: all lines of commands begin with their name. */
static bool has_spoken(const job *j) {
    char line[1024], begin[64];
    bool found = false;
    FILE *said = fopen(error_path(), "r");
    (void)snprintf(begin, sizeof begin, "%s", j->program);
    while (said != NULL && fgets(line, sizeof line, said) != NULL)
        found = found || strncmp(line, begin, strlen(begin)) == 0 || strstr(line, "MPI") != NULL ||
                strstr(line, "shared libraries") != NULL;
    if (said != NULL) (void)fclose(said);
    return found;
}

/* ---- one case ---- */

/* Returns false if the run had ended before. */
static bool disturb(disturbance what, pid_t launcher, uint64_t rank) {
    enum { TIMES = 6 };
    const pid_t pid = what == TERMINATED ? launcher : rank_process(launcher, rank);
    if (what == LITTLE_MEMORY) return true;
    if (pid == 0) return false;
    if (what == KILLED) return kill(pid, SIGKILL) == 0;
    if (what == STOPPED) return kill(pid, SIGSTOP) == 0;
    if (what == TERMINATED) return kill(pid, SIGTERM) == 0;
    for (int i = 0; i < TIMES; i++) {
        (void)kill(pid, SIGSTOP);
        sleep_for(0.3);
        (void)kill(pid, SIGCONT);
        sleep_for(0.02);
    }
    return true;
}

static void check_left(bench *b, const char *when) {
    static const char *const parts[] = {".liegrad-", ".csv.part-", ".h5.part-"};
    for (size_t i = 0; i < LG_COUNT(parts); i++) {
        if (strcmp(when, "SIGTERM") == 0 && i > 0) continue;
        const int left = count_left(work(""), parts[i], true);
        if (left > 0) fail(b, "%s: %d files *%s* are left", when, left, parts[i]);
    }
}

static const char *const names[] = {"a killed rank", "a stopped rank", "a slow rank", "SIGTERM",
                                    "little memory"};

static void check_end(bench *b, disturbance what, int code) {
    if (what == STOPPED && code < 0 && others_ended && outputs_equal(b))
        return; /* the stopped rank had left the other ranks */
    if (code < 0) fail(b, "%s: no end after %g s", names[what], patience);
    if (what == SLOWED && code != 0) fail(b, "%s: exit code %d", names[what], code);
    if (what == STOPPED && code > 0 && !has_spoken(b->job)) fail(b, "%s: nothing was said", names[what]);
    if (what == LITTLE_MEMORY && code > 0 && !has_spoken(b->job))
        fail(b, "%s: nothing was said", names[what]);
    if (what == TERMINATED) check_left(b, "SIGTERM");
    const long epoch =
        digest_ends(b->job->outputs[0], "model.h5") && b->job->checkpoint != NULL ? stopped_in() : 0;
    if (epoch > 0 && progress(b->job) != epoch - 1)
        fail(b, "%s: stopped in epoch %ld, but epoch %ld is saved", names[what], epoch, progress(b->job));
}

static void run_case(bench *b, double seconds, result *sum) {
    const job *j = b->job;
    const uint64_t rank = lg_rng_below(&rng, RANKS);
    const disturbance what = (disturbance)lg_rng_below(&rng, DISTURBANCES);
    const uint64_t failed = b->failed;
    clean();
    if (j->keeps && lg_rng_uniform(&rng) < 0.5) put_old(b);
    set_number("LESS_RANK", what == LITTLE_MEMORY ? rank : RANKS_MOST);
    const uint64_t memory = 120000 + lg_rng_below(&rng, 480000); /* KiB */
    set_number("LESS_MEMORY", memory);
    const pid_t launcher = start_ranks(j, RANKS, "");
    const double moment = what == LITTLE_MEMORY ? 0.0 : seconds * lg_rng_uniform(&rng);
    sleep_for(moment);
    const long before = progress(j);
    const double since = seconds_now();
    const bool touched = disturb(what, launcher, rank);
    const int code = wait_at_most(launcher, since);
    const long saved = progress(j);
    const double took = seconds_now() - since;
    if (touched) sum->cases[what]++;
    sum->untouched += !touched;
    if (touched && took > sum->longest) sum->longest = took;
    check_end(b, what, code);
    /* lg-control saves the best controller so far when it gets SIGTERM, as mpirun sends to ranks that are
     * left */
    if (what == SLOWED || what == LITTLE_MEMORY || strcmp(j->program, "lg-control") != 0)
        check_cut_short(b, before, saved);
    set_number("LESS_RANK", RANKS_MOST);
    sum->resumed += j->checkpoint != NULL && exists(work(j->checkpoint));
    const int end = wait_for(start_ranks(j, 1 + lg_rng_below(&rng, RANKS_MOST), more_of(j)));
    if (end != 0) {
        fail(b, "exit code %d of the run after it", end);
        run_shell("grep '^lg-' '%s' | tail -n 3 >&2", error_path());
    }
    if (end == 0 && outputs_equal(b)) check_left(b, "the end");
    if (b->failed > failed)
        (void)fprintf(stderr,
                      "  %s: rank %llu after %.2f s, memory %llu KiB; exit code %d, then %ld saved, %s\n",
                      names[what], (unsigned long long)rank, moment, (unsigned long long)memory, code, saved,
                      more_of(j)[0] != '\0' ? "resumed" : "run again");
}

static result run_job(const job *j, uint64_t cases) {
    bench b = {.job = j};
    result sum = {.longest = 0.0};
    clean_for(&b);
    note_outputs(&b);
    clean();
    set_number("LESS_RANK", RANKS_MOST);
    const double begin = seconds_now();
    const int code = wait_for(start_ranks(j, RANKS, ""));
    const double seconds = seconds_now() - begin;
    if (code != 0) fail(&b, "exit code %d of undisturbed ranks", code);
    for (uint64_t i = 0; i < cases && b.failed < 10; i++) run_case(&b, seconds, &sum);
    sum.failed = b.failed;
    (void)printf("| %s | %.1f |", j->name, seconds);
    for (int i = 0; i < DISTURBANCES; i++) (void)printf(" %llu |", (unsigned long long)sum.cases[i]);
    (void)printf(" %llu | %llu | %.1f | %llu |\n", (unsigned long long)sum.untouched,
                 (unsigned long long)sum.resumed, sum.longest, (unsigned long long)sum.failed);
    (void)fflush(stdout);
    return sum;
}

/* ---- all jobs ---- */

static void put_texts(void) {
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        char name[64];
        (void)snprintf(name, sizeof name, "../in/%s", texts[i].name);
        FILE *file = fopen(work(name), "w");
        if (file == NULL || fputs(texts[i].text, file) < 0 || fclose(file) != 0)
            stop("rank_kills: %s cannot be written", work(name));
    }
}

static bool have_mpi(void) {
    char command[1024];
    (void)snprintf(command, sizeof command,
                   "command -v mpirun >/dev/null && find '%s'/../lib* -name libliegrad_mpi.so | grep -q .",
                   executables);
    return system(command) == 0;
}

int main(int argc, char **argv) {
    uint64_t cases = 10, seed = 1, failed = 0, done = 0, made = 0, chosen = 0;
    const char *only = "";
    for (int c; (c = getopt(argc, argv, "n:s:o:")) != -1;) {
        if (c == 'n') cases = strtoull(optarg, NULL, 10);
        if (c == 's') seed = strtoull(optarg, NULL, 10);
        if (c == 'o') only = optarg;
        if (c == '?') return 2;
    }
    if (optind + 1 != argc) stop("usage: rank_kills FOLDER-OF-EXECUTABLES [-n CASES] [-s SEED] [-o NAME]");
    executables = realpath(argv[optind], NULL);
    if (executables == NULL || !have_mpi()) return 77;
    (void)setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
    (void)setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
    (void)setenv("LIEGRAD_SILENCE", silence, 1);
    lg_rng_seed(&rng, seed, 0);
    make_inputs(executables, false, &rng);
    clean();
    put_texts();
    for (size_t i = 0; i < LG_COUNT(rank_jobs); i++) chosen += strstr(rank_jobs[i].name, only) != NULL;
    (void)printf("| command | seconds | killed | stopped | slowed | SIGTERM | little memory | ended before | "
                 "resumed | longest end, s | failures |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < LG_COUNT(rank_jobs); i++) {
        if (strstr(rank_jobs[i].name, only) == NULL) continue;
        made++;
        const uint64_t some = cases * made / chosen - cases * (made - 1) / chosen;
        if (some == 0) continue;
        failed += run_job(&rank_jobs[i], some).failed;
        done += some;
    }
    (void)printf("\n%llu cases, %llu failures\n", (unsigned long long)done, (unsigned long long)failed);
    if (failed == 0) remove_inputs();
    return failed > 0;
}
