/* Kills commands (SIGKILL) at random moments, lets them continue, and compares the results with those of an
 * uninterrupted run:
 *
 *     kills FOLDER-OF-EXECUTABLES [-n KILLS] [-s SEED] [-o NAME]
 *
 * Half of the moments are uniform over the time of the uninterrupted run. The other half are up to 3 ms after
 * the beginning of a randomly drawn write. After a kill each output must be absent, unchanged, or complete,
 * and a checkpoint must be readable and hold at least what it held before the kill. Then the command runs
 * again, with --resume if there is a checkpoint; in a third of the cases it is killed again. At the end the
 * outputs must equal those of the uninterrupted run, the run must have written exactly the missing
 * checkpoints, and no temporary file or lock may be left. If a check fails the exit code is 1. The results
 * are printed as a Markdown table. */
#define _GNU_SOURCE /* getopt in addition to POSIX */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "core/count.h"
#include "crash/digest.h"
#include "liegrad/core.h"

enum { OUTPUTS = 5, WORDS = 64, DRAWS = 40, PATIENCE = 120 };
static const double after_write = 3e-3; /* s */

/* A command. Inputs are in ../in, outputs in the current folder. A name that ends with a slash is a
 * folder. */
typedef struct job {
    const char *name, *program, *arguments;
    /* the file that shows the progress; NULL: the command starts from the beginning */
    const char *checkpoint;
    const char *again; /* options added if the checkpoint exists */
    bool counted;      /* each step of progress renames the checkpoint once */
    bool keeps;        /* an existing output is replaced only at the end */
    bool appends;      /* the output is a log, to which a second run appends */
    bool unordered;    /* rows are in the order in which they were finished */
    const char *outputs[OUTPUTS];
} job;

#define TRAINED "model.h5", "history.csv"
#define SAVES   "--checkpoint check.h5 --history history.csv --out model.h5"
#define RESUMES .checkpoint = "check.h5", .again = "--resume check.h5", .counted = true, .keeps = true

static const job jobs[] = {
    {"`lg-hamiltonian train`, adam, 1 thread", "lg-hamiltonian",
     "train ../in/data.h5 --threads 1 --method adam --epochs 80 --hidden 16,16 --checkpoint-every 4 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-hamiltonian train`, adam, 2 threads", "lg-hamiltonian",
     "train ../in/data.h5 --threads 2 --method adam --epochs 80 --hidden 16,16 --checkpoint-every 4 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-hamiltonian train`, ssbroyden, 1 thread", "lg-hamiltonian",
     "train ../in/data.h5 --threads 1 --method ssbroyden --epochs 120 --hidden 16,16 --checkpoint-every "
     "5 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-hamiltonian train`, ssbroyden, 2 threads, picture", "lg-hamiltonian",
     "train ../in/data.h5 --threads 2 --method ssbroyden --epochs 120 --hidden 16,16 --checkpoint-every 5 "
     "--plot loss.svg " SAVES,
     RESUMES, .outputs = {TRAINED, "loss.svg", "loss.gp"}},
    {"`lg-elastica train`, adam", "lg-elastica",
     "train ../in/curves.h5 --threads 2 --network discrete --method adam --epochs 60 --hidden 64 "
     "--checkpoint-every 3 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-anomaly train`, cnn", "lg-anomaly",
     "train ../in/well.h5 --threads 2 --method cnn --epochs 4 --checkpoint-every 1 " SAVES, RESUMES,
     .outputs = {TRAINED}},
    {"`lg-identify fit`", "lg-identify",
     "fit ../in/machine.yaml ../in/log.csv --threads 2 --epochs 8 --method lm --checkpoint-every 1 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-fit train`", "lg-fit",
     "train ../in/table.csv --threads 1 --outputs y --method ssbroyden --epochs 200 --hidden 12,12 "
     "--checkpoint-every 10 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-elastica search`", "lg-elastica",
     "search ../in/ranges.yaml ../in/curves.h5 --threads 1 --trials 8 --seed 3 --out trials.csv",
     .checkpoint = "trials.csv", .again = "--resume", .counted = true, .outputs = {"trials.csv"}},
    {"`lg-hamiltonian study`", "lg-hamiltonian", "study ../in/grid.yaml --threads 1 --jobs 1 --out study.csv",
     .checkpoint = "study.csv", .again = "", .outputs = {"study.csv"}},
    {"`lg-hamiltonian study`, 2 jobs, picture", "lg-hamiltonian",
     "study ../in/grid.yaml --threads 2 --jobs 2 --out study.csv --plot study.svg", .checkpoint = "study.csv",
     .again = "", .unordered = true, .outputs = {"study.csv"}},
    {"`lg-hamiltonian generate`", "lg-hamiltonian",
     "generate ../in/pendulum.yaml --threads 2 --trajectories 4000 --points 60 --out made.h5", .keeps = true,
     .outputs = {"made.h5"}},
    {"`lg-anomaly generate`, picture", "lg-anomaly",
     "generate --noise 10 --runs 9 --threads 2 --plot made.svg --out made.h5", .keeps = true,
     .outputs = {"made.h5", "made.svg", "made.dat", "made.gp"}},
    {"`lg-elastica generate`", "lg-elastica", "generate --count 200 --threads 2 --out made.h5", .keeps = true,
     .outputs = {"made.h5"}},
    {"`lg-anomaly feed`", "lg-anomaly", "feed --hours 3 --noise 10 --threads 2 --out feed.csv", .keeps = true,
     .outputs = {"feed.csv"}},
    {"`lg-export`, C", "lg-export", "../in/net.h5 --name alarm --out code", .outputs = {"code/"}},
    {"`lg-export`, C, into the folder of another export", "lg-export", "../in/net.h5 --name alarm --out code",
     .keeps = true, .outputs = {"code/"}},
    {"`lg-export`, package", "lg-export", "../in/net.h5 --name alarm --target package --out code",
     .outputs = {"code/"}},
    {"`lg-export`, onnx", "lg-export", "../in/net.h5 --name alarm --target onnx --out code",
     .outputs = {"code/"}},
    {"`lg-export`, fmu3", "lg-export", "../in/net.h5 --name alarm --target fmu3 --out code",
     .outputs = {"code/"}},
    {"`lg-anomaly watch --log`", "lg-anomaly", "watch ../in/net.h5 --input ../in/feed.csv --log verdicts.txt",
     .appends = true, .outputs = {"verdicts.txt"}},
    {"`lg-hamiltonian predict`, picture", "lg-hamiltonian",
     "predict ../in/model.h5 ../in/pendulum.yaml --t-end 200 --points 20000 --plot flow.png --out flow.h5",
     .keeps = true, .outputs = {"flow.h5", "flow.png", "flow.dat", "flow.gp"}},
    {"`lg-identify predict`", "lg-identify", "predict ../in/body.h5 ../in/log.csv --out run.csv",
     .keeps = true, .outputs = {"run.csv"}},
};

/* Files that are made before the kills. */
static const struct {
    const char *program, *arguments;
} inputs[] = {
    {"lg-hamiltonian", "generate pendulum.yaml --trajectories 60 --points 10 --out data.h5"},
    {"lg-hamiltonian", "train data.h5 --epochs 20 --hidden 16,16 --out model.h5"},
    {"lg-elastica", "generate --count 60 --out curves.h5"},
    {"lg-anomaly", "generate --noise 10 --runs 18 --out well.h5"},
    {"lg-anomaly", "train well.h5 --method cnn --epochs 1 --out net.h5"},
    {"lg-anomaly", "feed --hours 12 --noise 10 --out feed.csv"},
    {"lg-identify", "generate truth.yaml --runs 4 --t-end 6 --out log.csv"},
    {"lg-export", "net.h5 --name alarm --dtype f64 --golden 3 --out old"},
    {"lg-identify", "fit machine.yaml log.csv --epochs 3 --method lm --out body.h5"},
};

#define MACHINE_COLUMNS                                                                                      \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], hold: zero}\n"

static const struct {
    const char *name, *text;
} texts[] = {
    {"pendulum.yaml", "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1]\nlengths: [1]\n"
                      "t_end: 0.1\nstarts: {kind: thesis}\n"},
    {"ranges.yaml", "fixed: {network: discrete, method: adam, epochs: 40, dtype: f32, most-curves: 0, modes: "
                    "0, mirror: false}\nranges:\n  hidden: {integer: [8, 24]}\n"
                    "  lr: {log-uniform: [1e-3, 1e-2]}\n"},
    {"grid.yaml", "scene: pendulum.yaml\nintegrators: [euler, rk4]\nN: [20]\nM: [3]\neps: [0]\nrepeats: 6\n"
                  "t_end: 0.1\nepochs: 20\nbatch: 80\nlr: 1e-2\nlr_step: 50\nlr_gamma: 0.1\n"
                  "test: {trajectories: 10, points: 5}\nseed: 1\n"},
    {"truth.yaml", MACHINE_COLUMNS
     "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
     "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n"},
    {"machine.yaml", MACHINE_COLUMNS
     "mass: diagonal\npotential: {kind: network, of: [x], hidden: [12, 12]}\ndamping: diagonal\n"
     "input_map: {kind: known, values: [[1]]}\n"},
};

typedef struct result {
    uint64_t kills, first, writing, later, resumed, equal, left, failed;
} result;

static const char *bin;
static char base[200];
static lg_rng rng;

static void stop(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fputc('\n', stderr);
    exit(2);
}

static double seconds_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void sleep_for(double seconds) {
    const struct timespec pause = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
    if (seconds > 0) (void)nanosleep(&pause, NULL);
}

static void run_shell(const char *format, ...) {
    char command[1024];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(command, sizeof command, format, arguments);
    va_end(arguments);
    if (system(command) != 0) stop("kills: '%s' failed", command);
}

/* ---- processes ---- */

static pid_t start(const char *program, const char *arguments, const char *more, const char *folder) {
    char text[2048], path[1024];
    char *words[WORDS] = {path};
    int n = 1;
    (void)snprintf(path, sizeof path, "%s/%s", bin, program);
    (void)snprintf(text, sizeof text, "%s %s", arguments, more);
    for (char *save = NULL, *word = strtok_r(text, " ", &save); word != NULL && n < WORDS - 1;
         word = strtok_r(NULL, " ", &save))
        words[n++] = word;
    words[n] = NULL;
    (void)fflush(stdout);
    const pid_t pid = fork();
    if (pid != 0) return pid;
    if (chdir(folder) != 0 || freopen("/dev/null", "w", stdout) == NULL ||
        freopen("../err.txt", "w", stderr) == NULL)
        _exit(126);
    (void)execv(path, words);
    _exit(127);
}

static int wait_for(pid_t pid) {
    int status = 0;
    while (waitpid(pid, &status, 0) < 0)
        if (errno != EINTR) return -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

/* ---- the working folder ---- */

static const char *work(const char *name) {
    static char path[2][512];
    static int at;
    at = !at;
    (void)snprintf(path[at], sizeof path[at], "%s/w/%s", base, name);
    return path[at];
}

static bool exists(const char *path) {
    struct stat about;
    return stat(path, &about) == 0;
}

/* Number of names below the folder that contain `part`. */
static int count_left(const char *path, const char *part) {
    int count = 0;
    DIR *folder = opendir(path);
    for (const struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;) {
        char inner[1024];
        const char *name = entry->d_name;
        if (strcmp(name, ".") == 0 || strcmp(name, "..") == 0) continue;
        (void)snprintf(inner, sizeof inner, "%.700s/%.255s", path, name);
        count += strstr(name, part) != NULL;
        if (entry->d_type == DT_DIR) count += count_left(inner, part);
    }
    if (folder != NULL) (void)closedir(folder);
    return count;
}

static int by_name(const void *a, const void *b) {
    return strcmp(a, b);
}

/* Lists the files of a folder by name, without temporary files. */
static int list(const char *path, char names[64][256]) {
    int count = 0;
    DIR *folder = opendir(path);
    for (const struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL && count < 64;)
        if (entry->d_type == DT_REG && strstr(entry->d_name, ".tmp-") == NULL)
            (void)snprintf(names[count++], 256, "%s", entry->d_name);
    if (folder != NULL) (void)closedir(folder);
    qsort(names, (size_t)count, sizeof names[0], by_name);
    return count;
}

static bool digest_folder(const char *path, char text[LG_SHA256_TEXT]) {
    static char names[64][256];
    char one[LG_SHA256_TEXT], inner[1024];
    const int count = list(path, names);
    lg_sha256 sha;
    lg_sha256_init(&sha);
    for (int i = 0; i < count; i++) {
        (void)snprintf(inner, sizeof inner, "%.700s/%.255s", path, names[i]);
        if (!digest_file(inner, one)) return false;
        lg_sha256_add(&sha, names[i], strlen(names[i]));
        lg_sha256_add(&sha, one, sizeof one);
    }
    lg_sha256_finish(&sha, text);
    return count > 0;
}

static bool is_folder(const char *name) {
    return digest_ends(name, "/");
}

static bool digest(const job *j, const char *path, char text[LG_SHA256_TEXT]) {
    char sorted[512];
    (void)snprintf(sorted, sizeof sorted, "%.400s/sorted.csv", base);
    if (j->unordered) run_shell("(sed 1q '%s'; sed 1d '%s' | sort) > '%s'", path, path, sorted);
    return is_folder(path) ? digest_folder(path, text) : digest_file(j->unordered ? sorted : path, text);
}

/* ---- progress of a command ---- */

static long rows_of(const char *path) {
    long rows = -1; /* minus one for the line of names */
    FILE *file = fopen(path, "r");
    char line[4096];
    if (file == NULL) return 0;
    while (fgets(line, sizeof line, file) != NULL) rows += line[0] != '#' && strchr(line, '\n') != NULL;
    (void)fclose(file);
    return rows > 0 ? rows : 0;
}

static long epochs_of(const char *path) {
    uint64_t epoch = 0;
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    if (file < 0) return -1;
    const hid_t value = H5Dopen2(file, "/fit/train/epoch", H5P_DEFAULT);
    const bool read =
        value >= 0 && H5Dread(value, H5T_NATIVE_UINT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &epoch) >= 0;
    if (value >= 0) (void)H5Dclose(value);
    (void)H5Fclose(file);
    return read ? (long)epoch : -1;
}

/* Epochs or rows in the checkpoint; 0: there is none; -1: it cannot be read. */
static long progress(const job *j) {
    const char *path = j->checkpoint != NULL ? work(j->checkpoint) : NULL;
    if (path == NULL || !exists(path)) return 0;
    return digest_ends(path, ".h5") ? epochs_of(path) : rows_of(path);
}

/* ---- writes, observed in the folder by inotify ---- */

typedef struct listener {
    int fd;
    const job *job;
    long begun, saved; /* number of writes; number of checkpoints renamed */
} listener;

static listener listen_to(const job *j) {
    const listener made = {inotify_init1(IN_NONBLOCK | IN_CLOEXEC), j, 0, 0};
    if (inotify_add_watch(made.fd, work(""), IN_CREATE | IN_MOVED_TO | IN_MODIFY) < 0)
        stop("kills: inotify: %s", strerror(errno));
    return made;
}

static void count_event(listener *l, const struct inotify_event *event) {
    const char *name = event->len > 0 ? event->name : "", *checkpoint = l->job->checkpoint;
    const bool watched = checkpoint != NULL && strcmp(name, checkpoint) == 0;
    const bool log = l->job->appends && strcmp(name, l->job->outputs[0]) == 0;
    if ((event->mask & IN_CREATE) != 0 && (strstr(name, ".tmp-") != NULL || digest_ends(name, ".lock")))
        l->begun++;
    if ((event->mask & IN_MODIFY) != 0 && (watched || log)) l->begun++;
    if ((event->mask & IN_MOVED_TO) != 0 && watched) l->saved++;
}

static void drain(listener *l) {
    _Alignas(struct inotify_event) char buffer[16384];
    for (ssize_t n; (n = read(l->fd, buffer, sizeof buffer)) > 0;)
        for (char *at = buffer; at < buffer + n;) {
            const struct inotify_event *event = (const void *)at;
            count_event(l, event);
            at += sizeof *event + event->len;
        }
}

/* Waits until `writes` writes have begun, or the process has ended. */
static void wait_for_writes(listener *l, pid_t pid, long writes) {
    struct pollfd on = {l->fd, POLLIN, 0};
    siginfo_t info;
    for (const double begin = seconds_now(); l->begun < writes && seconds_now() < begin + PATIENCE;
         drain(l)) {
        (void)poll(&on, 1, 5);
        info.si_pid = 0;
        if (waitid(P_PID, (id_t)pid, &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid != 0) return;
    }
}

/* ---- one job ---- */

typedef struct bench {
    const job *job;
    double seconds;    /* of the uninterrupted run */
    long begun, saved; /* writes in it; its checkpoints */
    long end;          /* progress at its end */
    long cut;          /* bytes of the log before this run */
    char wanted[OUTPUTS][LG_SHA256_TEXT];
    result sum;
} bench;

static void fail(bench *b, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    b->sum.failed++;
    (void)fprintf(stderr, "%s: %s (kept in %s/failed-%s-%llu)\n", b->job->name, text, base, b->job->program,
                  (unsigned long long)b->sum.failed);
    run_shell("rm -rf '%s/failed-%s-%llu'; cp -r '%s/w' '%s/failed-%s-%llu'", base, b->job->program,
              (unsigned long long)b->sum.failed, base, base, b->job->program,
              (unsigned long long)b->sum.failed);
}

/* Writes older outputs: another export, or a file of four bytes. */
static void put_old(bench *b) {
    const job *j = b->job;
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) {
        if (is_folder(j->outputs[i]))
            run_shell("cp -r '%s/in/old' '%s'", base, work(j->outputs[i]));
        else
            run_shell("printf 'old\\n' > '%s'", work(j->outputs[i]));
    }
}

/* Whether the file is as before, or complete. */
static bool is_whole(const char *path, const char *wanted) {
    char now[LG_SHA256_TEXT], text[8] = "";
    FILE *file = fopen(path, "rb");
    const size_t n = file != NULL ? fread(text, 1, sizeof text, file) : 0;
    if (file != NULL) (void)fclose(file);
    if (n == 4 && memcmp(text, "old\n", 4) == 0) return true;
    return digest_file(path, now) && strcmp(now, wanted) == 0;
}

/* Whether each file of the folder belongs to the older export or to the complete one. */
static bool is_whole_folder(const char *path) {
    static const char *const sources[] = {"in/old", "new/code"};
    static char names[64][256];
    const int count = list(path, names);
    for (int i = 0; i < count; i++) {
        char one[1024], mine[LG_SHA256_TEXT], other[LG_SHA256_TEXT];
        bool known = false;
        (void)snprintf(one, sizeof one, "%.700s/%.255s", path, names[i]);
        if (!digest_file(one, mine)) return false;
        for (size_t k = 0; k < LG_COUNT(sources); k++) {
            (void)snprintf(one, sizeof one, "%.400s/%s/%.255s", base, sources[k], names[i]);
            known = known || (exists(one) && digest_file(one, other) && strcmp(mine, other) == 0);
        }
        if (!known) return false;
    }
    return true;
}

/* Number of bytes up to the end of the last complete line. */
static long whole_lines(const char *path) {
    long at = 0, end = 0;
    FILE *file = fopen(path, "rb");
    for (int c; file != NULL && (c = fgetc(file)) != EOF;) {
        at++;
        if (c == '\n') end = at;
    }
    if (file != NULL) (void)fclose(file);
    return end;
}

/* Whether the log from byte `from` on is the beginning of the complete log, or with `all` the whole of it.
 * Only the first run writes the line of names. */
static bool continues(const char *path, long from, const char *whole, bool all) {
    FILE *log = fopen(path, "rb"), *model = fopen(whole, "rb");
    bool same = log != NULL && model != NULL && fseek(log, from, SEEK_SET) == 0;
    for (int c; same && from > 0 && (c = fgetc(model)) != '\n' && c != EOF;) continue;
    int c = EOF;
    while (same && (c = fgetc(log)) != EOF) same = c == fgetc(model);
    if (same && all) same = fgetc(model) == EOF;
    if (log != NULL) (void)fclose(log);
    if (model != NULL) (void)fclose(model);
    return same;
}

static bool is_continued(const bench *b, const char *path, bool all) {
    char whole[512];
    (void)snprintf(whole, sizeof whole, "%s/new/%s", base, b->job->outputs[0]);
    return continues(path, b->cut, whole, all);
}

static void check_after_kill(bench *b, long before, long after) {
    const job *j = b->job;
    if (after < before) fail(b, "the checkpoint has %ld, before the kill it had %ld", after, before);
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) {
        const char *path = work(j->outputs[i]);
        if (!exists(path) || (j->checkpoint != NULL && strcmp(j->outputs[i], j->checkpoint) == 0)) continue;
        const bool whole = is_folder(j->outputs[i]) ? is_whole_folder(path)
                           : j->appends             ? is_continued(b, path, false)
                                                    : is_whole(path, b->wanted[i]);
        if (!whole) fail(b, "%s is neither old nor complete", j->outputs[i]);
    }
}

static bool outputs_equal(bench *b) {
    const job *j = b->job;
    bool equal = true;
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) {
        char now[LG_SHA256_TEXT];
        const char *path = work(j->outputs[i]);
        if (j->appends ? is_continued(b, path, true) : digest(j, path, now) && strcmp(now, b->wanted[i]) == 0)
            continue;
        equal = false;
        fail(b, "%s is not that of the unbroken run", j->outputs[i]);
    }
    return equal;
}

static const char *more_of(const job *j) {
    return j->again != NULL && exists(work(j->checkpoint)) ? j->again : "";
}

/* Starts a run and kills it at the drawn moment. Returns false if the run ended before. */
static bool run_killed(bench *b) {
    const job *j = b->job;
    listener l = listen_to(j);
    const bool at_write = b->begun > 0 && lg_rng_uniform(&rng) < 0.5;
    const double wait = at_write ? after_write * lg_rng_uniform(&rng) : b->seconds * lg_rng_uniform(&rng);
    const long writes = 1 + (long)lg_rng_below(&rng, (uint64_t)(b->begun > 0 ? b->begun : 1));
    if (j->appends) b->cut = whole_lines(work(j->outputs[0]));
    const pid_t pid = start(j->program, j->arguments, more_of(j), work(""));
    if (at_write) wait_for_writes(&l, pid, writes);
    sleep_for(wait);
    const long before = progress(j);
    (void)kill(pid, SIGKILL);
    const int code = wait_for(pid);
    (void)close(l.fd);
    if (code != 1000 + SIGKILL) {
        if (code != 0) fail(b, "exit code %d without a kill", code);
        return false;
    }
    const long after = progress(j);
    b->sum.kills++;
    *(count_left(work(""), ".tmp-") > 0 ? &b->sum.writing : after == 0 ? &b->sum.first : &b->sum.later) += 1;
    check_after_kill(b, before, after);
    return true;
}

/* Runs the command to its end. */
static void run_rest(bench *b) {
    const job *j = b->job;
    const bool resumes = j->checkpoint != NULL && exists(work(j->checkpoint));
    const long at = progress(j);
    listener l = listen_to(j);
    if (j->appends) b->cut = whole_lines(work(j->outputs[0]));
    const int code = wait_for(start(j->program, j->arguments, more_of(j), work("")));
    drain(&l);
    (void)close(l.fd);
    b->sum.resumed += resumes;
    if (code != 0) {
        fail(b, "exit code %d of the run after a kill", code);
        return;
    }
    const long step = b->saved > 0 ? b->end / b->saved : 1;
    if (j->counted && l.saved != b->saved - at / step)
        fail(b, "%ld checkpoints after %ld of %ld, each of %ld", l.saved, at, b->end, step);
    b->sum.equal += outputs_equal(b) && resumes;
    const int left = count_left(work(""), ".tmp-") + count_left(work(""), ".lock");
    b->sum.left += (uint64_t)left;
    if (left > 0) fail(b, "%d temporary files or locks are left", left);
}

static void clean(void) {
    run_shell("rm -rf '%s/w'; mkdir '%s/w'", base, base);
}

/* Kills the command repeatedly, until a random draw ends this or a command with a checkpoint finishes before
 * its kill. */
static void kill_once(bench *b, uint64_t wanted) {
    const uint64_t failures = b->sum.failed;
    clean();
    if (b->job->keeps && lg_rng_uniform(&rng) < 0.5) put_old(b);
    for (int draw = 0; draw < DRAWS && b->sum.kills < wanted && b->sum.failed == failures; draw++) {
        const bool killed = run_killed(b);
        if (killed ? lg_rng_uniform(&rng) > 1.0 / 3 : b->job->checkpoint != NULL) break;
    }
    run_rest(b);
}

static void run_unbroken(bench *b) {
    const job *j = b->job;
    clean();
    if (is_folder(j->outputs[0]) && j->keeps) put_old(b);
    listener l = listen_to(j);
    const double begin = seconds_now();
    const int code = wait_for(start(j->program, j->arguments, "", work("")));
    b->seconds = seconds_now() - begin;
    drain(&l);
    (void)close(l.fd);
    if (code != 0) stop("kills: %s %s: exit code %d; see %s/err.txt", j->program, j->arguments, code, base);
    b->begun = l.begun;
    b->saved = l.saved;
    b->end = progress(j);
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++)
        if (!digest(j, work(j->outputs[i]), b->wanted[i]))
            stop("kills: %s: no %s", j->arguments, j->outputs[i]);
    run_shell("rm -rf '%s/new'; cp -r '%s/w' '%s/new'", base, base, base);
}

static result run_job(const job *j, uint64_t kills) {
    bench b = {.job = j};
    run_unbroken(&b);
    while (b.sum.kills < kills && b.sum.failed < 10) kill_once(&b, kills);
    (void)printf("| %s | %.2f | %llu | %llu | %llu | %llu | %llu/%llu | %llu | %llu |\n", j->name, b.seconds,
                 (unsigned long long)b.sum.kills, (unsigned long long)b.sum.first,
                 (unsigned long long)b.sum.writing, (unsigned long long)b.sum.later,
                 (unsigned long long)b.sum.equal, (unsigned long long)b.sum.resumed,
                 (unsigned long long)b.sum.left, (unsigned long long)b.sum.failed);
    (void)fflush(stdout);
    return b.sum;
}

/* ---- all jobs ---- */

static void put_text(const char *name, const char *text) {
    char path[512];
    (void)snprintf(path, sizeof path, "%s/in/%s", base, name);
    FILE *file = fopen(path, "w");
    if (file == NULL || fputs(text, file) < 0 || fclose(file) != 0) stop("kills: %s cannot be written", path);
}

static void put_table(void) {
    char text[16384] = "a,b,y\n";
    size_t n = strlen(text);
    for (int i = 0; i < 300; i++) {
        const double a = lg_rng_uniform(&rng), c = lg_rng_uniform(&rng);
        n += (size_t)snprintf(text + n, sizeof text - n, "%.6f,%.6f,%.6f\n", a, c, a * c - c * c);
    }
    put_text("table.csv", text);
}

static void make_inputs(void) {
    char folder[512];
    const char *temporary = getenv("TMPDIR");
    (void)snprintf(base, sizeof base, "%s/lg-kills-XXXXXX", temporary != NULL ? temporary : "/tmp");
    if (mkdtemp(base) == NULL) stop("kills: %s: %s", base, strerror(errno));
    run_shell("mkdir '%s/in'", base);
    for (size_t i = 0; i < LG_COUNT(texts); i++) put_text(texts[i].name, texts[i].text);
    put_table();
    (void)snprintf(folder, sizeof folder, "%s/in", base);
    for (size_t i = 0; i < LG_COUNT(inputs); i++)
        if (wait_for(start(inputs[i].program, inputs[i].arguments, "", folder)) != 0)
            stop("kills: %s %s failed; see %s/err.txt", inputs[i].program, inputs[i].arguments, base);
}

int main(int argc, char **argv) {
    uint64_t kills = 32, seed = 1, failed = 0, done = 0, made = 0, chosen = 0;
    const char *only = "";
    for (int c; (c = getopt(argc, argv, "n:s:o:")) != -1;) {
        if (c == 'n') kills = strtoull(optarg, NULL, 10);
        if (c == 's') seed = strtoull(optarg, NULL, 10);
        if (c == 'o') only = optarg;
        if (c == '?') return 2;
    }
    if (optind + 1 != argc) stop("usage: kills FOLDER-OF-EXECUTABLES [-n KILLS] [-s SEED] [-o NAME]");
    bin = realpath(argv[optind], NULL);
    if (bin == NULL) stop("kills: %s: %s", argv[optind], strerror(errno));
    lg_rng_seed(&rng, seed, 0);
    make_inputs();
    for (size_t i = 0; i < LG_COUNT(jobs); i++) chosen += strstr(jobs[i].name, only) != NULL;
    (void)printf(
        "| command | seconds | kills | before a checkpoint | in a write | later | resumes equal | left | "
        "failures |\n|---|---|---|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < LG_COUNT(jobs); i++) {
        if (strstr(jobs[i].name, only) == NULL) continue;
        made++;
        const result r = run_job(&jobs[i], kills * made / chosen - kills * (made - 1) / chosen);
        failed += r.failed;
        done += r.kills;
    }
    (void)printf("\n%llu kills, %llu failures\n", (unsigned long long)done, (unsigned long long)failed);
    if (failed == 0) run_shell("rm -rf '%s'", base);
    return failed > 0;
}
