/* lg-control demo: from a log to a controller in C, by the commands that a user would give. */
#include <errno.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "lg-control/control_app.h"

typedef struct demo_values {
    const char *out;
    double seconds;
} demo_values;

static const lg_field options[] = {
    LG_OPTION(demo_values, out, STRING, "FOLDER", "Folder for all files", .value = "liegrad-control"),
    LG_OPTION(demo_values, seconds, REAL, "s", "Shorten the phases to this time", .high = 1e9, .above = true,
              .value = "20"),
    LG_FIELD_END};

static demo_values values;

/* The cart and pole that stands for reality; what is learned of it; the task. */
static const char truth[] = "columns: {time: t, run: run}\n"
                            "coordinates:\n"
                            "  - {name: x, kind: line, velocity: vx}\n"
                            "  - {name: theta, kind: angle, velocity: vtheta}\n"
                            "inputs: {columns: [u], hold: zero}\n"
                            "system: cart-pole\n"
                            "parameters: {cart: 1, pole: 0.1, length: 1, gravity: 9.81}\n"
                            "damping: {kind: known, values: [0.1, 0.005]}\n"
                            "input_map: {kind: known, values: [[1], [0]]}\n";
static const char machine[] = "columns: {time: t, run: run}\n"
                              "coordinates:\n"
                              "  - {name: x, kind: line, velocity: vx}\n"
                              "  - {name: theta, kind: angle, velocity: vtheta}\n"
                              "inputs: {columns: [u], hold: zero}\n"
                              "system: cart-pole\n"
                              "parameters: {cart: unknown, pole: unknown, length: unknown, gravity: 9.81}\n"
                              "damping: diagonal\n"
                              "input_map: {kind: known, values: [[1], [0]]}\n";
static const char task[] =
    "plant: cart.h5\n"
    "goal: {x: 0, theta: 0}        # upright\n"
    "period: 0.05                  # s; the input is held\n"
    "horizon: 5                    # s\n"
    "starts: {x: [-0.5, 0.5], theta: [-3.14159, 3.14159], vx: [-0.5, 0.5], vtheta: [-1, 1]}\n"
    "limits: {u: 10}\n"
    "cost: {x: 0.1, theta: 1, vx: 0.01, vtheta: 0.02, u: 0.002}\n"
    "success: {theta: 0.05, hold: 1, within: 10}\n"
    "controller: {kind: network, hidden: [32, 32], gate: lqr}\n";

static const app_named_text texts[] = {{"truth.yaml", truth}, {"cart.yaml", machine}, {"task.yaml", task}};

/* The commands, which run in the folder. %s: the time of training. */
static const char *const commands[] = {
    "lg-identify generate truth.yaml --inputs steps:0.4 --amplitude 8 --runs 4 --t-end 10 --dt 0.02 "
    "--start-spread 1 "
    "--noise 1e-3,1e-2 --out log.csv",
    "lg-identify fit cart.yaml log.csv --out cart.h5",
    "lg-control train task.yaml --out policy.h5 --seconds %s",
    "lg-control evaluate policy.h5 --plant truth.yaml",
    "lg-export policy.h5 --name swingup --out swingup",
    "make -B -f Makefile -C swingup test", /* what else is in the folder counts for nothing */
};

/* Our own programs are in the folder of this one. */
static void find_programs(const app *self) {
    char own[4096];
    const ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    if (length <= 0) app_stop(self, LG_FILE, "/proc/self/exe: %s", strerror(errno));
    own[length] = '\0';
    *strrchr(own, '/') = '\0';
    const char *path = getenv("PATH");
    APP_FREE char *with = app_format("%s:%s", own, path != NULL ? path : "/usr/bin:/bin");
    (void)setenv("PATH", with, 1);
}

static void run_command(const app *self, const char *command) {
    extern char **environ;
    char *words[64], *save = NULL;
    size_t n = 0;
    pid_t child;
    int status;
    APP_FREE char *line = app_format("%s", command);
    app_put(stdout, "\n$ %s\n", command);
    (void)fflush(stdout);
    for (char *word = strtok_r(line, " ", &save); word != NULL && n + 1 < LG_COUNT(words);
         word = strtok_r(NULL, " ", &save))
        words[n++] = word;
    words[n] = NULL;
    const int failed = posix_spawnp(&child, words[0], NULL, NULL, words, environ);
    if (failed != 0) app_stop(self, LG_FILE, "%s: %s", words[0], strerror(failed));
    while (waitpid(child, &status, 0) < 0)
        if (errno != EINTR) app_stop(self, LG_FILE, "%s: %s", words[0], strerror(errno));
    if (app_interrupted()) app_end(APP_EXIT_INTERRUPTED);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        app_end(WIFEXITED(status) ? WEXITSTATUS(status) : APP_EXIT_CHECK);
}

static int run(app *self) {
    APP_MUST_FILE(self, values.out, app_make_folder(values.out, &error));
    app_write_texts(self, values.out, texts, LG_COUNT(texts));
    static const char *const made[] = {"swingup_test", "swingup.o"}; /* by make */
    static const char elf[] = {0x7f, 'E', 'L', 'F', '\0'};           /* how they begin */
    for (size_t i = 0; i < LG_COUNT(made); i++) {
        APP_FREE char *path = app_format("%s/swingup/%s", values.out, made[i]);
        app_check_text(self, path, elf);
    }
    find_programs(self);
    if (chdir(values.out) != 0) app_stop(self, LG_FILE, "%s: %s", values.out, strerror(errno));
    char seconds[32];
    (void)snprintf(seconds, sizeof seconds, "%g", values.seconds);
    for (size_t i = 0; i < LG_COUNT(commands); i++) {
        const char *at = strstr(commands[i], "%s");
        APP_FREE char *command = at == NULL
                                     ? app_format("%s", commands[i])
                                     : app_format("%.*s%s", (int)(at - commands[i]), commands[i], seconds);
        run_command(self, command);
    }
    return APP_EXIT_OK;
}

const app_command demo_command = {.name = "demo",
                                  .summary = "From a log to a controller in C, by the commands that do it",
                                  .details = "Writes a machine and a task into the folder and runs there: "
                                             "lg-identify generate and fit, train, evaluate "
                                             "on the true machine, lg-export, and the self-test of the C.",
                                  .settings = APP_SETTINGS(APP_GIVEN(options, values)),
                                  .run = run};
