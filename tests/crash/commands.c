#define _GNU_SOURCE
#include "crash/commands.h"

#include <dirent.h>
#include <errno.h>
#include <stdarg.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { WORDS = 64 };

#define TRAINED "model.h5", "history.csv"
#define SAVES   "--checkpoint check.h5 --history history.csv --out model.h5"
#define RESUMES .checkpoint = "check.h5", .again = "--resume check.h5", .counted = true, .keeps = true
const job jobs[] = {
    {"`lg-hamiltonian train`, adam, 1 thread", "lg-hamiltonian",
     "train ../in/data.h5 --threads 1 --method adam --epochs @80:4 --hidden 16,16 --checkpoint-every "
     "@4:2 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-hamiltonian train`, adam, 2 threads", "lg-hamiltonian",
     "train ../in/data.h5 --threads 2 --method adam --epochs @80:4 --hidden 16,16 --checkpoint-every "
     "@4:2 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-hamiltonian train`, ssbroyden, 1 thread", "lg-hamiltonian",
     "train ../in/data.h5 --threads 1 --method ssbroyden --epochs @120:4 --hidden 16,16 --checkpoint-every "
     "@5:2 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-hamiltonian train`, ssbroyden, 2 threads, plot", "lg-hamiltonian",
     "train ../in/data.h5 --threads 2 --method ssbroyden --epochs @120:4 --hidden 16,16 --checkpoint-every "
     "@5:2 "
     "--plot loss.svg " SAVES,
     RESUMES, .parts = ".svg .gp", .outputs = {TRAINED, "loss.svg", "loss.gp"}},
    {"`lg-elastica train`, adam", "lg-elastica",
     "train ../in/curves.h5 --threads 2 --network discrete --method adam --epochs @60:4 --hidden @64:8 "
     "--checkpoint-every @3:2 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-anomaly train`, cnn", "lg-anomaly",
     "train ../in/well.h5 --threads 2 --method cnn --epochs @4:2 --checkpoint-every 1 " SAVES, RESUMES,
     .outputs = {TRAINED}},
    {"`lg-identify fit`", "lg-identify",
     "fit ../in/machine.yaml ../in/log.csv --threads 2 --epochs @8:3 --method lm --checkpoint-every 1 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-fit train`", "lg-fit",
     "train ../in/table.csv --threads 1 --outputs y --method ssbroyden --epochs @200:6 --hidden 12,12 "
     "--checkpoint-every @10:2 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-elastica search`", "lg-elastica",
     "search ../in/ranges.yaml ../in/curves.h5 --threads 1 --trials @8:3 --seed 3 --out trials.csv",
     .checkpoint = "trials.csv", .again = "--resume", .counted = true, .parts = ".csv",
     .outputs = {"trials.csv"}},
    {"`lg-hamiltonian study`", "lg-hamiltonian",
     "study @../in/grid.yaml:../in/few.yaml --threads 1 --jobs 1 --out study.csv", .checkpoint = "study.csv",
     .again = "", .parts = ".csv", .outputs = {"study.csv"}},
    {"`lg-hamiltonian study`, 2 jobs, plot", "lg-hamiltonian",
     "study @../in/grid.yaml:../in/few.yaml --threads 2 --jobs 2 --out study.csv --plot study.svg",
     .checkpoint = "study.csv", .again = "", .parts = ".csv", .outputs = {"study.csv"}},
    {"`lg-hamiltonian generate`", "lg-hamiltonian",
     "generate ../in/pendulum.yaml --threads 2 --trajectories @4000:20 --points @60:5 --out made.h5",
     .keeps = true, .outputs = {"made.h5"}},
    {"`lg-anomaly generate`, plot", "lg-anomaly",
     "generate --noise 10 --runs @9:3 --hours @1:0.1 --threads 2 --plot made.svg --out made.h5",
     .keeps = true, .parts = ".svg .dat .gp", .outputs = {"made.h5", "made.svg", "made.dat", "made.gp"}},
    {"`lg-elastica generate`", "lg-elastica", "generate --count @200:10 --threads 2 --out made.h5",
     .keeps = true, .outputs = {"made.h5"}},
    {"`lg-anomaly feed`", "lg-anomaly", "feed --hours @3:0.2 --noise 10 --threads 2 --out feed.csv",
     .keeps = true, .outputs = {"feed.csv"}},
    {"`lg-export`, C", "lg-export", "../in/net.h5 --name alarm --out code", .outputs = {"code/"}},
    {"`lg-export`, C, into the folder of another export", "lg-export", "../in/net.h5 --name alarm --out code",
     .keeps = true, .outputs = {"code/"}},
    {"`lg-export`, package", "lg-export", "../in/net.h5 --name alarm --target package --out code",
     .outputs = {"code/"}},
    {"`lg-export`, onnx", "lg-export", "../in/net.h5 --name alarm --target onnx --out code",
     .outputs = {"code/"}},
    {"`lg-export`, casadi", "lg-export", "../in/net.h5 --name alarm --target casadi --out code",
     .outputs = {"code/"}},
    {"`lg-export`, safetensors", "lg-export", "../in/net.h5 --name alarm --target safetensors --out code",
     .outputs = {"code/"}},
    {"`lg-export`, fmu3", "lg-export", "../in/net.h5 --name alarm --target fmu3 --out code",
     .outputs = {"code/"}},
    {"`lg-anomaly watch --log`", "lg-anomaly", "watch ../in/net.h5 --input ../in/feed.csv --log verdicts.txt",
     .appends = true, .outputs = {"verdicts.txt"}},
    {"`lg-hamiltonian predict`, plot", "lg-hamiltonian",
     "predict ../in/model.h5 ../in/pendulum.yaml --t-end @200:2 --points @20000:50 --plot flow.png --out "
     "flow.h5",
     .keeps = true, .parts = ".png .dat .gp", .outputs = {"flow.h5", "flow.png", "flow.dat", "flow.gp"}},
    {"`lg-learn train`, sgd", "lg-learn",
     "train ../in/table.csv --recipe table --threads 1 --outputs y --method sgd --epochs @60:4 --hidden "
     "12,12 "
     "--checkpoint-every @4:2 " SAVES,
     RESUMES, .outputs = {TRAINED}},
    {"`lg-control train`", "lg-control",
     "train ../in/task.yaml --threads 2 --seeds 2 --race @60:5 --finish @80:5 --polish @10:2 --out made.h5",
     .keeps = true, .outputs = {"made.h5"}},
    {"`lg-control evaluate`, plot", "lg-control", "evaluate ../in/policy.h5 --runs runs.csv --plot runs.svg",
     .keeps = true, .parts = ".svg .dat .gp", .outputs = {"runs.csv", "runs.svg", "runs.dat", "runs.gp"}},
    {"`lg-simulate`, plot", "lg-simulate", "../in/pendulum.yaml --t-end @300:2 --plot run.svg --out run.h5",
     .keeps = true, .parts = ".svg .dat .gp", .outputs = {"run.h5", "run.svg", "run.dat", "run.gp"}},
    {"`lg-simulate --ensemble --save`", "lg-simulate",
     "../in/pendulum.yaml --ensemble @2000:20 --save all --threads 2 --out run.h5", .keeps = true,
     .parts = ".trajectories.h5",
     .fallback = "../in/pendulum.yaml --ensemble @2000:20 --threads 2 --out run.h5",
     .outputs = {"run.h5", "run.trajectories.h5"}},
    {"`lg-identify predict`", "lg-identify", "predict ../in/body.h5 ../in/log.csv --out run.csv",
     .keeps = true, .outputs = {"run.csv"}},
};

const size_t job_count = LG_COUNT(jobs);

/* Files that are made before all runs. */
static const struct {
    const char *program, *arguments;
} inputs[] = {
    {"lg-hamiltonian", "generate pendulum.yaml --trajectories 60 --points 10 --out data.h5"},
    {"lg-hamiltonian", "train data.h5 --epochs 20 --hidden 16,16 --out model.h5"},
    {"lg-elastica", "generate --count 60 --out curves.h5"},
    {"lg-anomaly", "generate --noise 10 --runs @18:9 --hours @1:0.1 --out well.h5"},
    {"lg-anomaly", "train well.h5 --method cnn --epochs 1 --out net.h5"},
    {"lg-anomaly", "feed --hours @12:1 --noise 10 --out feed.csv"},
    {"lg-identify", "generate truth.yaml --runs @4:2 --t-end @6:3 --out log.csv"},
    {"lg-export", "net.h5 --name alarm --dtype f64 --golden 3 --out old"},
    {"lg-identify", "fit machine.yaml log.csv --epochs 3 --method lm --out body.h5"},
    {"lg-control", "train task.yaml --seeds 1 --race 20 --finish 20 --polish 2 --out policy.h5"},
};

#define MACHINE_COLUMNS                                                                                      \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], hold: zero}\n"

#define GRID(repeats)                                                                                        \
    "scene: pendulum.yaml\nintegrators: [euler, rk4]\nN: [20]\nM: [3]\neps: [0]\nrepeats: " repeats          \
    "\nt_end: 0.1\nepochs: 20\nbatch: 80\nlr: 1e-2\nlr_step: 50\nlr_gamma: 0.1\n"                            \
    "test: {trajectories: 10, points: 5}\nseed: 1\n"

static const struct {
    const char *name, *text;
} texts[] = {
    {"pendulum.yaml", "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1]\nlengths: [1]\n"
                      "t_end: 0.1\nstarts: {kind: thesis}\n"},
    {"ranges.yaml", "fixed: {network: discrete, method: adam, epochs: 40, dtype: f32, most-curves: 0, modes: "
                    "0, mirror: false}\nranges:\n  hidden: {integer: [8, 24]}\n"
                    "  lr: {log-uniform: [1e-3, 1e-2]}\n"},
    {"grid.yaml", GRID("6")},
    {"few.yaml", GRID("2")},
    {"truth.yaml", MACHINE_COLUMNS
     "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
     "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n"},
    {"task.yaml",
     "plant: truth.yaml\nperiod: 0.05\nhorizon: 2\nlimits: {u: 5}\nstarts: {x: [-1, 1], vx: [-1, 1]}\n"
     "cost: {x: 1, vx: 0.1, u: 0.05}\nsuccess: {x: 0.1, hold: 0.5, within: 4}\n"
     "controller: {kind: network, hidden: [8, 8], gate: lqr}\n"},
    {"machine.yaml", MACHINE_COLUMNS
     "mass: diagonal\npotential: {kind: network, of: [x], hidden: [12, 12]}\ndamping: diagonal\n"
     "input_map: {kind: known, values: [[1]]}\n"},
};

static const char *bin;
static char base[200];
static bool quick_runs;

void stop(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fputc('\n', stderr);
    exit(2);
}

double seconds_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void run_shell(const char *format, ...) {
    char command[1024];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(command, sizeof command, format, arguments);
    va_end(arguments);
    if (system(command) != 0) stop("'%s' failed", command);
}

/* ---- processes ---- */

void resolve(const char *arguments, char *out, size_t size) {
    size_t n = 0;
    for (const char *at = arguments; *at != '\0' && n + 1 < size;) {
        const size_t length = strcspn(at, " "), first = *at == '@' ? strcspn(at, ":") : 0;
        const char *from = first == 0 ? at : quick_runs ? at + first + 1 : at + 1;
        const size_t some = first == 0 ? length : quick_runs ? length - first - 1 : first - 1;
        n += (size_t)snprintf(out + n, size - n, "%.*s ", (int)some, from);
        at += length + strspn(at + length, " ");
    }
}

/* The words of `text` from words[n] on, and NULL. */
static void split(char *text, char **words, int n) {
    for (char *save = NULL, *word = strtok_r(text, " ", &save); word != NULL && n < WORDS - 1;
         word = strtok_r(NULL, " ", &save))
        words[n++] = word;
    words[n] = NULL;
}

static pid_t start_in(const char *folder, const char *executables, const char *program, const char *arguments,
                      const char *more) {
    char text[2048], path[1024];
    char *words[WORDS] = {path};
    (void)snprintf(path, sizeof path, "%s/%s", executables != NULL ? executables : bin, program);
    resolve(arguments, text, sizeof text - strlen(more));
    (void)strcat(text, more);
    split(text, words, 1);
    (void)fflush(stdout);
    const pid_t pid = fork();
    if (pid != 0) return pid;
    if (chdir(folder) != 0 || freopen("/dev/null", "w", stdout) == NULL ||
        freopen(error_path(), "w", stderr) == NULL)
        _exit(126);
    (void)execv(path, words);
    _exit(127);
}

pid_t start(const char *executables, const job *j, const char *more) {
    return start_in(work(""), executables, j->program, j->arguments, more);
}

const char *error_path(void) {
    static char path[512];
    (void)snprintf(path, sizeof path, "%s/err.txt", base);
    return path;
}

int wait_for(pid_t pid) {
    int status = 0;
    while (waitpid(pid, &status, 0) < 0)
        if (errno != EINTR) return -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

/* ---- the working folder ---- */

const char *work(const char *name) {
    static char path[2][512];
    static int at;
    at = !at;
    (void)snprintf(path[at], sizeof path[at], "%s/w/%s", base, name);
    return path[at];
}

bool exists(const char *path) {
    struct stat about;
    return stat(path, &about) == 0;
}

int count_left(const char *path, const char *part, bool folders) {
    int count = 0;
    DIR *folder = opendir(path);
    for (const struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;) {
        char inner[1024];
        const char *name = entry->d_name;
        if (strcmp(name, ".") == 0 || strcmp(name, "..") == 0) continue;
        (void)snprintf(inner, sizeof inner, "%.700s/%.255s", path, name);
        count += strstr(name, part) != NULL && (folders || entry->d_type != DT_DIR);
        if (entry->d_type == DT_DIR) count += count_left(inner, part, folders);
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
        if (entry->d_type == DT_REG && strstr(entry->d_name, ".liegrad-") == NULL)
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

bool digest(const job *j, const char *path, char text[LG_SHA256_TEXT]) {
    return is_folder(path) ? digest_folder(path, text) : digest_file(path, text);
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

long progress(const job *j) {
    const char *path = j->checkpoint != NULL ? work(j->checkpoint) : NULL;
    if (path == NULL || !exists(path)) return 0;
    return digest_ends(path, ".h5") ? epochs_of(path) : rows_of(path);
}

void fail(bench *b, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    b->failed++;
    (void)fprintf(stderr, "%s: %s (kept in %s/failed-%s-%llu)\n", b->job->name, text, base, b->job->program,
                  (unsigned long long)b->failed);
    run_shell("rm -rf '%s/failed-%s-%llu'; cp -r '%s/w' '%s/failed-%s-%llu'", base, b->job->program,
              (unsigned long long)b->failed, base, base, b->job->program, (unsigned long long)b->failed);
}

/* Writes older outputs: another export, or the complete file with a line more (a table: its last row), since
 * commands replace only results of the same kind. */
void put_old(bench *b) {
    const job *j = b->job;
    run_shell("mkdir -p '%s/old'", base);
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) {
        const char *name = j->outputs[i];
        if (is_folder(name))
            run_shell("cp -r '%s/in/old' '%s'", base, work(name));
        else
            run_shell("cd '%s' && { cat 'new/%s'; %s 'new/%s'; } > 'old/%s' && cp 'old/%s' '%s'", base, name,
                      digest_ends(name, ".csv") ? "tail -n 1" : "printf 'old\\n%.0s'", name, name, name,
                      work(name));
        /* a plot is an earlier result if its data lie next to it */
        if (digest_ends(name, ".svg"))
            run_shell("cd '%s/new' && cp '%.*s.dat' '%s'", base, (int)strlen(name) - 4, name, work(""));
    }
}

/* Whether the file is as put_old wrote it, or complete. */
static bool is_whole(const char *path, const char *wanted) {
    char now[LG_SHA256_TEXT], old[LG_SHA256_TEXT], before[1024];
    if (!digest_file(path, now)) return false;
    (void)snprintf(before, sizeof before, "%.700s/old/%.255s", base, strrchr(path, '/') + 1);
    return strcmp(now, wanted) == 0 || (exists(before) && digest_file(before, old) && strcmp(now, old) == 0);
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
long whole_lines(const char *path) {
    long at = 0, end = 0;
    FILE *file = fopen(path, "rb");
    for (int c; file != NULL && (c = fgetc(file)) != EOF;) {
        at++;
        if (c == '\n') end = at;
    }
    if (file != NULL) (void)fclose(file);
    return end;
}

/* Whether the log from byte b->cut on is the beginning of the log `whole`, or with `all` the same log. Only
 * the first run writes the line of names. With b->gaps the log may lack lines. */
static bool continues(const bench *b, const char *path, const char *whole, bool all) {
    FILE *log = fopen(path, "rb"), *model = fopen(whole, "rb");
    char *line = NULL, *wanted = NULL;
    size_t size = 0, room = 0;
    bool same = log != NULL && model != NULL && fseek(log, b->cut, SEEK_SET) == 0;
    if (same && b->cut > 0) same = getline(&wanted, &room, model) > 0;
    while (same && getline(&line, &size, log) > 0) {
        do same = getline(&wanted, &room, model) > 0;
        while (same && b->gaps && strcmp(line, wanted) != 0);
        same = same && strncmp(line, wanted, strlen(line)) == 0;
    }
    if (same && all) same = getline(&wanted, &room, model) < 0;
    free(line);
    free(wanted);
    if (log != NULL) (void)fclose(log);
    if (model != NULL) (void)fclose(model);
    return same;
}

static bool is_continued(const bench *b, const char *path, bool all) {
    char whole[512];
    (void)snprintf(whole, sizeof whole, "%s/new/%s", base, b->job->outputs[0]);
    return continues(b, path, whole, all);
}

/* Whether the file is a history whose rows are complete, with fewer rows than in the undisturbed run. */
static bool is_shorter(const char *path, const char *name) {
    char whole[512];
    (void)snprintf(whole, sizeof whole, "%s/new/%s", base, name);
    const long rows = rows_of(path);
    return digest_ends(name, "history.csv") && rows > 0 && rows < rows_of(whole);
}

void check_cut_short(bench *b, long before, long after) {
    const job *j = b->job;
    if (after < before) fail(b, "the checkpoint has %ld, before the run it had %ld", after, before);
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) {
        const char *path = work(j->outputs[i]);
        if (!exists(path) || (j->checkpoint != NULL && strcmp(j->outputs[i], j->checkpoint) == 0)) continue;
        const bool whole = is_folder(j->outputs[i])                        ? is_whole_folder(path)
                           : j->appends                                    ? is_continued(b, path, false)
                           : b->stopped && is_shorter(path, j->outputs[i]) ? true
                           : i == 0 && is_whole(path, b->fallback)         ? true
                                                                           : is_whole(path, b->wanted[i]);
        if (!whole) fail(b, "%s is neither old nor complete", j->outputs[i]);
    }
}

/* Whether the output may lack a part, because a warning has said so. */
static bool may_differ(const bench *b, const char *name) {
    const char *ending = strrchr(name, '.');
    return b->warned && b->job->parts != NULL && ending != NULL && strstr(b->job->parts, ending) != NULL;
}

bool outputs_equal(bench *b) {
    const job *j = b->job;
    bool equal = true;
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) {
        char now[LG_SHA256_TEXT];
        const char *path = work(j->outputs[i]);
        if (may_differ(b, j->outputs[i])) continue;
        if (j->appends ? is_continued(b, path, true) : digest(j, path, now) && strcmp(now, b->wanted[i]) == 0)
            continue;
        equal = false;
        fail(b, "%s is not that of the unbroken run", j->outputs[i]);
    }
    return equal;
}

const char *more_of(const job *j) {
    return j->again != NULL && exists(work(j->checkpoint)) ? j->again : "";
}

void clean(void) {
    run_shell("rm -rf '%s/w'; mkdir '%s/w'", base, base);
}

static void put_text(const char *name, const char *text) {
    char path[512];
    (void)snprintf(path, sizeof path, "%s/in/%s", base, name);
    FILE *file = fopen(path, "w");
    if (file == NULL || fputs(text, file) < 0 || fclose(file) != 0) stop("%s cannot be written", path);
}

static void put_table(lg_rng *rng) {
    char text[16384] = "a,b,y\n";
    size_t n = strlen(text);
    for (int i = 0; i < 300; i++) {
        const double a = lg_rng_uniform(rng), c = lg_rng_uniform(rng);
        n += (size_t)snprintf(text + n, sizeof text - n, "%.6f,%.6f,%.6f\n", a, c, a * c - c * c);
    }
    put_text("table.csv", text);
}

const char *make_inputs(const char *executables, bool quick, lg_rng *rng) {
    char folder[512];
    const char *temporary = getenv("TMPDIR");
    /* fsync takes no time in memory */
    if (temporary == NULL) temporary = access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp";
    quick_runs = quick;
    bin = realpath(executables, NULL);
    if (bin == NULL) stop("%s: %s", executables, strerror(errno));
    (void)snprintf(base, sizeof base, "%s/lg-crash-XXXXXX", temporary);
    if (mkdtemp(base) == NULL) stop("%s: %s", base, strerror(errno));
    run_shell("mkdir '%s/in'", base);
    for (size_t i = 0; i < LG_COUNT(texts); i++) put_text(texts[i].name, texts[i].text);
    put_table(rng);
    (void)snprintf(folder, sizeof folder, "%s/in", base);
    for (size_t i = 0; i < LG_COUNT(inputs); i++)
        if (wait_for(start_in(folder, NULL, inputs[i].program, inputs[i].arguments, "")) != 0)
            stop("%s %s failed; see %s", inputs[i].program, inputs[i].arguments, error_path());
    return base;
}

void remove_inputs(void) {
    run_shell("rm -rf '%s'", base);
}

void clean_for(bench *b) {
    clean();
    if (b->job->outputs[0] != NULL && is_folder(b->job->outputs[0]) && b->job->keeps) put_old(b);
}

void note_outputs(bench *b) {
    const job *j = b->job;
    if (j->fallback != NULL) {
        const int code = wait_for(start_in(work(""), NULL, j->program, j->fallback, ""));
        if (code != 0 || !digest(j, work(j->outputs[0]), b->fallback))
            stop("%s %s: exit code %d; see %s", j->program, j->fallback, code, error_path());
        clean();
    }
    const double begin = seconds_now();
    const int code = wait_for(start(NULL, j, ""));
    b->seconds = seconds_now() - begin;
    if (code != 0) stop("%s %s: exit code %d; see %s", j->program, j->arguments, code, error_path());
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++)
        if (!digest(j, work(j->outputs[i]), b->wanted[i])) stop("%s: no %s", j->arguments, j->outputs[i]);
    run_shell("rm -rf '%s/new'; cp -r '%s/w' '%s/new'", base, base, base);
}
