/* lg-identify demo: a driven, damped rigid body from its log to a controller. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <fcntl.h>
#include <unistd.h>

#include "core/core.h"
#include "lg-identify/runs.h"
#include "liegrad/geometry.h"

typedef struct demo_values {
    const char *out;
    double seconds;
    uint64_t epochs;
} demo_values;

static const lg_field options[] = {
    LG_OPTION(demo_values, out, STRING, "DIR", "Folder for files and pictures", .value = "liegrad-machine"),
    LG_OPTION(demo_values, seconds, REAL, "S", "Time for the fit", LG_POSITIVE, .value = "8"),
    LG_OPTION(demo_values, epochs, U64, "E", "Evaluations of the loss (default: as the time allows)",
              .low = 1, .high = 1e6),
    LG_FIELD_END};

static demo_values values;

/* ---- files ---- */

#define COLUMNS                                                                                              \
    "columns: {time: t, run: run}\n"                                                                         \
    "coordinates:\n"                                                                                         \
    "  - {name: body, kind: rotation, columns: [qw, qx, qy, qz], velocity: [wx, wy, wz]}\n"                  \
    "inputs: {columns: [t1, t2, t3], hold: zero}\n"                                                          \
    "input_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n"

static const char truth_text[] =
    "# the true machine: a rigid body about a fixed point\n" COLUMNS
    "mass: {kind: known, values: [0.05, 0.06, 0.03]}\n"
    "potential: {kind: known, form: linear, of: body.up, values: [0.1, -0.05, 0.6]}\n"
    "damping: {kind: known, values: [0.01, 0.012, 0.008]}\n";

static const char machine_text[] =
    "# what is known of it: torques act about its axes, and these are principal\n" COLUMNS "mass: diagonal\n"
    "potential: {kind: network, of: body.up, hidden: [8, 8]}\n"
    "damping: diagonal\n";

typedef struct demo {
    app *app;
    lg_machine_file truth;
    lg_machine_model_file model;
    bool loaded;
} demo;

static int write_text(const demo *d, const char *name, const char *text) {
    lg_error error = {LG_OK, ""};
    char *path = app_format("%s/%s", values.out, name);
    app_file file;
    app_file_begin(&file, path);
    (void)fputs(text, file.stream);
    const lg_status status = app_file_end(&file, &error);
    const int code = status == LG_OK ? APP_EXIT_OK : app_fail_file(d->app, status, &error, path);
    free(path);
    return code;
}

/* ---- commands: this program again, in the folder ---- */

enum { WORDS = 32 };

static void become(char *line, bool quiet) {
    static char name[] = "lg-identify";
    char *words[WORDS] = {name};
    int n = 1;
    for (char *save = NULL, *word = strtok_r(line, " ", &save); word != NULL && n < WORDS - 1;
         word = strtok_r(NULL, " ", &save))
        words[n++] = word;
    const int null = quiet ? open("/dev/null", O_WRONLY) : -1;
    if (null >= 0) (void)dup2(null, STDOUT_FILENO);
    if (chdir(values.out) == 0) (void)execv("/proc/self/exe", words);
    _exit(127);
}

static int run_command(const demo *d, const char *arguments) {
    int status = 0;
    char *line = app_format("%s --threads %llu", arguments, (unsigned long long)d->app->threads);
    if (!d->app->json) (void)printf("\n$ lg-identify %s\n", arguments);
    (void)fflush(stdout);
    const pid_t child = fork();
    if (child == 0) become(line, d->app->json);
    free(line);
    if (child < 0) return app_fail(d->app, LG_OUT_OF_MEMORY, "a process cannot be started");
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (app_interrupted()) return APP_EXIT_INTERRUPTED;
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : APP_EXIT_NUMERIC;
    if (code == APP_EXIT_OK) return code;
    return app_fail(d->app, LG_NO_CONVERGENCE, "'lg-identify %s' ended with code %d", arguments, code);
}

static int run_commands(const demo *d) {
    const uint64_t epochs = values.epochs > 0 ? values.epochs : 3000;
    char *fit =
        app_format("fit machine.yaml train.csv --out model.h5 --seconds %g --epochs %llu --plot fit.svg "
                   "--seed %llu",
                   values.seconds, (unsigned long long)epochs, (unsigned long long)d->app->seed);
    const char *const lines[] = {
        "generate truth.yaml --out train.csv --runs 12 --t-end 6 --inputs multisine --amplitude 0.3",
        "generate truth.yaml --out test.csv --runs 4 --t-end 6 --inputs multisine --amplitude 0.25 --seed 2",
        "check machine.yaml train.csv --plot log.svg",
        fit,
        "evaluate model.h5 test.csv --plot learned.svg",
        "predict model.h5 test.csv --out predicted.csv --plot predicted.svg"};
    int code = APP_EXIT_OK;
    for (size_t i = 0; i < LG_COUNT(lines) && code == APP_EXIT_OK; i++) code = run_command(d, lines[i]);
    free(fit);
    return code;
}

/* ---- what was learned beside the truth ---- */

enum { BODY = 3, COMPARED = 2 * BODY };
typedef struct comparison {
    char name[COMPARED][LG_IDENTIFIED_NAME];
    double learned[COMPARED], truth[COMPARED];
    double potential; /* root mean square of the difference over attitudes, of that of the truth */
} comparison;

static const lg_machine_term *term_of(const lg_machine *machine, lg_machine_part part) {
    const lg_machine_term *term = machine->terms;
    while (term->part != part) term++;
    return term;
}

/* The diagonal masses, then damping. */
static void compare_numbers(const demo *d, comparison *out) {
    lg_identified numbers[64];
    const lg_machine *machine = &d->model.run.machine;
    const size_t count = lg_machine_numbers(machine, d->model.theta, LG_COUNT(numbers), numbers);
    const double *mass = term_of(&d->truth.machine, LG_MACHINE_MASS)->values,
                 *damping = term_of(&d->truth.machine, LG_MACHINE_DAMPING)->values;
    for (int k = 0; k < BODY; k++) {
        (void)snprintf(out->name[k], sizeof out->name[k], "mass.%d.%d", k + 1, k + 1);
        (void)snprintf(out->name[BODY + k], sizeof out->name[k], "damping.body.%d", k + 1);
        out->truth[k] = mass[k], out->truth[BODY + k] = damping[k];
    }
    for (int k = 0; k < COMPARED; k++) {
        out->learned[k] = (double)NAN;
        for (size_t i = 0; i < count && i < LG_COUNT(numbers); i++)
            if (strcmp(numbers[i].name, out->name[k]) == 0) out->learned[k] = numbers[i].value;
    }
}

static double spread(const double *x, size_t count) {
    double mean = 0, sum = 0;
    for (size_t i = 0; i < count; i++) mean += x[i] / (double)count;
    for (size_t i = 0; i < count; i++) sum += (x[i] - mean) * (x[i] - mean);
    return sqrt(sum / (double)count);
}

static void random_attitude(lg_rng *rng, double size, double R[9]) {
    double turn[3];
    for (int k = 0; k < 3; k++) turn[k] = size * lg_rng_normal(rng);
    lg_so3_exp(turn, R);
}

static lg_status compare_potentials(const demo *d, comparison *out, lg_error *error) {
    enum { ATTITUDES = 400 };
    const identify_model learned = {&d->model.run.machine, d->model.theta, NULL, 1},
                         truth = {&d->truth.machine, NULL, NULL, 1};
    double *q = app_alloc(9 * ATTITUDES, sizeof *q), a[ATTITUDES], b[ATTITUDES];
    lg_rng rng;
    lg_rng_seed(&rng, d->app->seed, 7);
    for (size_t i = 0; i < ATTITUDES; i++) random_attitude(&rng, 2, q + 9 * i);
    lg_status status = identify_values(d->app, &learned, ATTITUDES, q, NULL, a, NULL, error);
    if (status == LG_OK) status = identify_values(d->app, &truth, ATTITUDES, q, NULL, b, NULL, error);
    for (size_t i = 0; i < ATTITUDES; i++) a[i] -= b[i];
    out->potential = spread(a, ATTITUDES) / spread(b, ATTITUDES);
    free(q);
    return status;
}

/* ---- the controller: the torque after which the learned body has the wanted rate ---- */

enum { STARTS = 20, STEPS = 200, TRIES = 4 }; /* no torque, and one about each axis */
#define STEP 0.02

typedef struct control {
    double R[9 * STARTS], rate[3 * STARTS], torque[3 * STARTS];
    double angle[STARTS]; /* from the upright attitude */
    double largest;       /* torque */
    size_t arrived;
} control;

/* One step of `count` bodies with held torques. */
static lg_status step(const demo *d, const identify_model *model, size_t count, const double *R,
                      const double *rate, const double *torque, double *next_R, double *next_rate,
                      lg_error *error) {
    enum { MOST = TRIES * STARTS };
    size_t first[MOST + 1];
    double t[2 * MOST], q[18 * MOST], v[6 * MOST], u[24 * MOST] = {0}, to_q[18 * MOST], to_v[6 * MOST];
    for (size_t i = 0; i < count; i++) {
        first[i] = 2 * i;
        t[2 * i] = 0, t[2 * i + 1] = STEP;
        for (size_t half = 0; half < 2; half++) {
            memcpy(q + 9 * (2 * i + half), R + 9 * i, 9 * sizeof *q);
            memcpy(v + 3 * (2 * i + half), rate + 3 * i, 3 * sizeof *v);
        }
        memcpy(u + 24 * i, torque + 3 * i, 3 * sizeof *u);
    }
    first[count] = 2 * count;
    const lg_machine_log log = {2 * count, count, first, t, q, v, u};
    LG_TRY(lg_machine_free_run(d->app->context, model->machine, model->theta, model->scheme, model->substeps,
                               &log, first, count, 1, to_q, to_v, error));
    for (size_t i = 0; i < count; i++) {
        if (next_R != NULL) memcpy(next_R + 9 * i, to_q + 9 * (2 * i + 1), 9 * sizeof *next_R);
        memcpy(next_rate + 3 * i, to_v + 3 * (2 * i + 1), 3 * sizeof *next_rate);
    }
    return LG_OK;
}

/* x of A x = b for the 3 columns of A. */
static void solve3(double a[3][3], const double *b, double *x) {
    double cross[3];
    lg_cross3(a[1], a[2], cross);
    const double determinant = lg_dot3(a[0], cross);
    for (int k = 0; k < 3; k++) {
        lg_cross3(a[(k + 1) % 3], a[(k + 2) % 3], cross);
        x[k] = lg_dot3(cross, b) / determinant;
    }
}

/* The wanted rate turns the body towards R = 1, critically damped. */
static void wanted_rate(const double *R, const double *rate, double *out) {
    static const double stiffness = 16, friction = 8;
    double turn[3];
    lg_so3_log(R, turn);
    for (int k = 0; k < 3; k++) out[k] = rate[k] - STEP * (stiffness * turn[k] + friction * rate[k]);
}

static lg_status choose_torques(const demo *d, const identify_model *learned, control *c, lg_error *error) {
    static const double unit = 0.1;
    double R[9 * TRIES * STARTS], rate[3 * TRIES * STARTS], torque[3 * TRIES * STARTS] = {0},
                                                                               after[3 * TRIES * STARTS];
    for (size_t i = 0; i < STARTS; i++)
        for (size_t k = 0; k < TRIES; k++) {
            memcpy(R + 9 * (TRIES * i + k), c->R + 9 * i, 9 * sizeof *R);
            memcpy(rate + 3 * (TRIES * i + k), c->rate + 3 * i, 3 * sizeof *rate);
            if (k > 0) torque[3 * (TRIES * i + k) + k - 1] = unit;
        }
    LG_TRY(step(d, learned, TRIES * STARTS, R, rate, torque, NULL, after, error));
    for (size_t i = 0; i < STARTS; i++) {
        const double *free = after + 3 * TRIES * i;
        double effect[3][3], missing[3];
        wanted_rate(c->R + 9 * i, c->rate + 3 * i, missing);
        for (int k = 0; k < 3; k++) {
            missing[k] -= free[k];
            for (int j = 0; j < 3; j++) effect[k][j] = (free[3 * (k + 1) + j] - free[j]) / unit;
        }
        solve3(effect, missing, c->torque + 3 * i);
        for (int k = 0; k < 3; k++) c->largest = fmax(c->largest, fabs(c->torque[3 * i + (size_t)k]));
    }
    return LG_OK;
}

static lg_status control_all(const demo *d, control *c, lg_error *error) {
    const lg_machine_model_run *run = &d->model.run;
    const identify_model learned = {&run->machine, d->model.theta, run->scheme, run->substeps},
                         truth = {&d->truth.machine, NULL, lg_scheme_find("rkmk5"), 8};
    lg_rng rng;
    lg_rng_seed(&rng, d->app->seed, 11);
    *c = (control){.largest = 0};
    for (size_t i = 0; i < STARTS; i++) {
        random_attitude(&rng, 1.5, c->R + 9 * i);
        for (size_t k = 0; k < 3; k++) c->rate[3 * i + k] = 2 * lg_rng_normal(&rng);
    }
    for (int at = 0; at < STEPS; at++) {
        LG_TRY(choose_torques(d, &learned, c, error));
        LG_TRY(step(d, &truth, STARTS, c->R, c->rate, c->torque, c->R, c->rate, error));
    }
    for (size_t i = 0; i < STARTS; i++) {
        double turn[3];
        lg_so3_log(c->R + 9 * i, turn);
        c->angle[i] = sqrt(lg_dot3(turn, turn));
        c->arrived += c->angle[i] < 1e-2;
    }
    return LG_OK;
}

/* ---- report ---- */

static void report_json(const demo *d, const comparison *learned, const control *c, double seconds) {
    app_json json;
    app_json_begin(&json);
    app_json_open(&json, "identified", '{');
    for (int k = 0; k < COMPARED; k++) {
        app_json_open(&json, learned->name[k], '{');
        app_json_real(&json, "value", learned->learned[k]);
        app_json_real(&json, "truth", learned->truth[k]);
        app_json_close(&json, '}');
    }
    app_json_close(&json, '}');
    app_json_real(&json, "potential", learned->potential);
    app_json_size(&json, "starts", STARTS);
    app_json_size(&json, "arrived", c->arrived);
    app_json_real(&json, "largest_torque", c->largest);
    app_json_text(&json, "out", values.out);
    app_json_real(&json, "seconds", seconds);
    app_json_warnings(&json, d->app);
    app_json_end(&json);
}

static void report(const comparison *learned, const control *c, double seconds) {
    app_table table;
    double worst = 0;
    (void)printf("\nWhat was learned, beside the true machine:\n");
    app_table_begin(&table, 3);
    app_table_cell(&table, "number");
    app_table_cell(&table, "learned");
    app_table_cell(&table, "true");
    for (int k = 0; k < COMPARED; k++) {
        app_table_cell(&table, "%s", learned->name[k]);
        app_table_cell(&table, "%.6g", learned->learned[k]);
        app_table_cell(&table, "%.6g", learned->truth[k]);
    }
    app_table_end(&table, stdout);
    for (int i = 0; i < STARTS; i++) worst = fmax(worst, c->angle[i]);
    (void)printf(
        "The potential, a network of the direction of gravity, differs from the true one by %.2g of it.\n\n"
        "A controller asks the learned body every %g s for the torque that turns it upright, against\n"
        "gravity, and the true body gets it: %zu of %d starts, turned by up to 180 degrees and spinning,\n"
        "stand within 0.01 rad after %g s (the worst off by %.2g rad; torques up to %.2g).\n\n"
        "Everything is in %s/ (log.svg, fit.svg, learned.svg, predicted.svg); %.0f s.\n",
        learned->potential, STEP, c->arrived, STARTS, STEP * STEPS, worst, c->largest, values.out, seconds);
}

/* ---- the command ---- */

static int load(demo *d) {
    lg_error error = {LG_OK, ""};
    char *path = app_format("%s/model.h5", values.out);
    lg_status status = lg_machine_file_parse(d->app->context, "truth.yaml", truth_text, strlen(truth_text),
                                             &d->truth, &error);
    if (status == LG_OK) status = lg_model_load_machine_model(d->app->context, path, NULL, &d->model, &error);
    d->loaded = status == LG_OK;
    const int code = status == LG_OK ? APP_EXIT_OK : app_fail_file(d->app, status, &error, path);
    free(path);
    return code;
}

static int judge(demo *d, double begin) {
    lg_error error = {LG_OK, ""};
    comparison learned;
    control *c = app_alloc(1, sizeof *c);
    compare_numbers(d, &learned);
    lg_status status = compare_potentials(d, &learned, &error);
    if (status == LG_OK) status = control_all(d, c, &error);
    int code = status == LG_OK ? APP_EXIT_OK : app_fail(d->app, status, "%s", app_sentence(status, &error));
    const double seconds = app_seconds() - begin;
    if (code == APP_EXIT_OK && d->app->json) report_json(d, &learned, c, seconds);
    if (code == APP_EXIT_OK && !d->app->json) report(&learned, c, seconds);
    if (code == APP_EXIT_OK && c->arrived < STARTS)
        code =
            app_fail(d->app, LG_NO_CONVERGENCE, "the controller fails from %zu of %d starts: more --seconds",
                     STARTS - c->arrived, STARTS);
    free(c);
    return code;
}

static int run_demo(app *self) {
    lg_error error = {LG_OK, ""};
    demo *d = app_alloc(1, sizeof *d);
    d->app = self;
    const double begin = app_seconds();
    lg_status status = app_make_folder(values.out, &error);
    if (status == LG_OK) status = app_claim(self, values.out, &error);
    int code = status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.out);
    if (code == APP_EXIT_OK) code = write_text(d, "truth.yaml", truth_text);
    if (code == APP_EXIT_OK) code = write_text(d, "machine.yaml", machine_text);
    if (code == APP_EXIT_OK) code = run_commands(d);
    if (code == APP_EXIT_OK) code = load(d);
    if (code == APP_EXIT_OK) code = judge(d, begin);
    lg_machine_file_destroy(&d->truth);
    if (d->loaded) lg_machine_model_file_destroy(&d->model);
    free(d);
    return code;
}

const app_command demo_command = {
    .name = "demo",
    .summary = "A driven, damped rigid body from its log to a controller",
    .details =
        "Makes a log of a body whose masses, damping and potential are known, learns them from it, and "
        "controls the true body with the learned one. Every command is shown before it runs.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run_demo};
