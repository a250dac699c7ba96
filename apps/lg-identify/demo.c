/* lg-identify demo: a driven, damped rigid body, from its log to a controller. */
#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/wait.h>
#include <fcntl.h>
#include <unistd.h>

#include "core/core.h"
#include "lg-identify/identify.h"
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
} demo;

static const app_named_text texts[] = {{"truth.yaml", truth_text}, {"machine.yaml", machine_text}};

/* ---- commands: run this program again, in the folder ---- */

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

static void run_command(const app *self, const char *arguments) {
    int status = 0;
    APP_FREE char *line = app_format("%s --threads %llu", arguments, (unsigned long long)self->threads);
    if (!self->json) app_put(stdout, "\n$ lg-identify %s\n", arguments);
    (void)fflush(stdout);
    const pid_t child = fork();
    if (child == 0) become(line, self->json);
    if (child < 0) app_stop(self, LG_OUT_OF_MEMORY, "a process cannot be started");
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (app_interrupted()) app_end(APP_EXIT_INTERRUPTED);
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : APP_EXIT_NUMERIC;
    if (code != APP_EXIT_OK) {
        (void)app_fail(self, LG_NO_CONVERGENCE, "'lg-identify %s' ended with code %d", arguments, code);
        app_end(code);
    }
}

static void run_commands(const app *self) {
    const uint64_t epochs = values.epochs > 0 ? values.epochs : 3000;
    APP_FREE char *fit =
        app_format("fit machine.yaml train.csv --out model.h5 --seconds %g --epochs %llu --plot fit.svg "
                   "--seed %llu",
                   values.seconds, (unsigned long long)epochs, (unsigned long long)self->seed);
    const char *const lines[] = {
        "generate truth.yaml --out train.csv --runs 12 --t-end 6 --inputs multisine --amplitude 0.3",
        "generate truth.yaml --out test.csv --runs 4 --t-end 6 --inputs multisine --amplitude 0.25 --seed 2",
        "check machine.yaml train.csv --plot log.svg",
        fit,
        "evaluate model.h5 test.csv --plot learned.svg",
        "predict model.h5 test.csv --out predicted.csv --plot predicted.svg"};
    for (size_t i = 0; i < LG_COUNT(lines); i++) run_command(self, lines[i]);
}

/* ---- comparison with the true machine ---- */

enum { BODY = 3, COMPARED = 2 * BODY };
typedef struct comparison {
    char name[COMPARED][LG_IDENTIFIED_NAME];
    double learned[COMPARED], truth[COMPARED];
    /* Root mean square of the potentials' difference over random attitudes, relative to the true
     * potential's. */
    double potential;
} comparison;

static const lg_machine_term *term_of(const lg_machine *machine, lg_machine_part part) {
    const lg_machine_term *term = machine->terms;
    while (term->part != part) term++;
    return term;
}

/* Compares the diagonal masses and the damping. */
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

static void compare_potentials(const demo *d, comparison *out) {
    enum { ATTITUDES = 400 };
    const lg_learned_machine learned = {.machine = &d->model.run.machine, .theta = d->model.theta},
                             truth = {.machine = &d->truth.machine};
    double q[9 * ATTITUDES], a[ATTITUDES], b[ATTITUDES];
    lg_rng rng;
    lg_rng_seed(&rng, d->app->seed, 7);
    for (size_t i = 0; i < ATTITUDES; i++) random_attitude(&rng, 2, q + 9 * i);
    identify_values(d->app, &learned, ATTITUDES, q, NULL, a, NULL);
    identify_values(d->app, &truth, ATTITUDES, q, NULL, b, NULL);
    for (size_t i = 0; i < ATTITUDES; i++) a[i] -= b[i];
    out->potential = spread(a, ATTITUDES) / spread(b, ATTITUDES);
}

/* ---- the controller: finds the torque after which the learned body has the wanted rate ---- */

enum { STARTS = 20, STEPS = 200, TRIES = 4 }; /* TRIES: no torque, and one about each of the three axes. */
#define STEP 0.02

typedef struct control {
    double R[9 * STARTS], rate[3 * STARTS], torque[3 * STARTS];
    double largest; /* Largest torque so far. */
    double worst;   /* Largest angle at the end, rad. */
    size_t arrived;
} control;

/* Makes one step of `count` bodies with constant torques. */
static void step(const demo *d, const lg_learned_machine *model, size_t count, const double *R,
                 const double *rate, const double *torque, double *next_R, double *next_rate) {
    enum { MOST = TRIES * STARTS };
    double to_q[18 * MOST], to_v[6 * MOST];
    APP_CLEAN(identify_pieces_end) identify_pieces p;
    identify_pieces_begin(&p, model->machine, count, 2);
    for (size_t i = 0; i < count; i++) {
        p.t[2 * i + 1] = STEP;
        for (size_t row = 2 * i; row < 2 * i + 2; row++) {
            memcpy(p.q + 9 * row, R + 9 * i, 9 * sizeof *R);
            memcpy(p.v + 3 * row, rate + 3 * i, 3 * sizeof *rate);
        }
        memcpy(p.u + 24 * i, torque + 3 * i, 3 * sizeof *torque);
    }
    identify_run(d->app, model, &p.log, p.first, count, 1, to_q, to_v);
    for (size_t i = 0; i < count; i++) {
        if (next_R != NULL) memcpy(next_R + 9 * i, to_q + 9 * (2 * i + 1), 9 * sizeof *next_R);
        memcpy(next_rate + 3 * i, to_v + 3 * (2 * i + 1), 3 * sizeof *next_rate);
    }
}

/* Solves x_0 a[0] + x_1 a[1] + x_2 a[2] = b for x. */
static void solve3(double a[3][3], const double *b, double *x) {
    double cross[3];
    lg_cross3(a[1], a[2], cross);
    const double determinant = lg_dot3(a[0], cross);
    for (int k = 0; k < 3; k++) {
        lg_cross3(a[(k + 1) % 3], a[(k + 2) % 3], cross);
        x[k] = lg_dot3(cross, b) / determinant;
    }
}

/* Rate after the next step that turns the body towards R = 1, critically damped. */
static void wanted_rate(const double *R, const double *rate, double *out) {
    static const double stiffness = 16, friction = 8;
    double turn[3];
    lg_so3_log(R, turn);
    for (int k = 0; k < 3; k++) out[k] = rate[k] - STEP * (stiffness * turn[k] + friction * rate[k]);
}

static void choose_torques(const demo *d, const lg_learned_machine *learned, control *c) {
    static const double unit = 0.1;
    double R[9 * TRIES * STARTS], rate[3 * TRIES * STARTS], torque[3 * TRIES * STARTS] = {0},
                                                                               after[3 * TRIES * STARTS];
    for (size_t i = 0; i < STARTS; i++)
        for (size_t k = 0; k < TRIES; k++) {
            memcpy(R + 9 * (TRIES * i + k), c->R + 9 * i, 9 * sizeof *R);
            memcpy(rate + 3 * (TRIES * i + k), c->rate + 3 * i, 3 * sizeof *rate);
            if (k > 0) torque[3 * (TRIES * i + k) + k - 1] = unit;
        }
    step(d, learned, TRIES * STARTS, R, rate, torque, NULL, after);
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
}

static void control_all(const demo *d, control *c) {
    const lg_machine_model_run *run = &d->model.run;
    const lg_learned_machine learned = {&run->machine, d->model.theta, run->scheme, run->substeps, 0},
                             truth = {&d->truth.machine, NULL, lg_scheme_find("rkmk5"), 8, 0};
    lg_rng rng;
    lg_rng_seed(&rng, d->app->seed, 11);
    *c = (control){.largest = 0};
    for (size_t i = 0; i < STARTS; i++) {
        random_attitude(&rng, 1.5, c->R + 9 * i);
        for (size_t k = 0; k < 3; k++) c->rate[3 * i + k] = 2 * lg_rng_normal(&rng);
    }
    for (int at = 0; at < STEPS; at++) {
        choose_torques(d, &learned, c);
        step(d, &truth, STARTS, c->R, c->rate, c->torque, c->R, c->rate);
    }
    for (size_t i = 0; i < STARTS; i++) {
        double turn[3];
        lg_so3_log(c->R + 9 * i, turn);
        const double angle = sqrt(lg_dot3(turn, turn)); /* From the upright attitude. */
        c->worst = fmax(c->worst, angle);
        c->arrived += angle < 1e-2;
    }
}

/* ---- the command ---- */

static void report(const app *self, const comparison *learned, const control *c, double seconds) {
    app_json out;
    app_result_begin(&out, self);
    app_result_line(&out, "\nLearned numbers and the numbers of the true machine:");
    app_result_named(&out, "identified", "number");
    for (int k = 0; k < COMPARED; k++) {
        app_json_open(&out, learned->name[k], '{');
        app_json_real(&out, "value", learned->learned[k]);
        app_json_real(&out, "truth", learned->truth[k]);
        app_json_close(&out, '}');
    }
    app_result_rows_end(&out);
    app_result_real(&out, "potential", learned->potential,
                    "difference of the potential, a network of the direction of gravity, from the true one");
    app_result_line(
        &out,
        "\nA controller asks the learned body every %g s for the torque that turns it upright, "
        "against\ngravity, and the true body gets it for %g s; the starts are turned by up to 180 "
        "degrees and spin.",
        STEP, STEP * STEPS);
    app_result_size(&out, "starts", STARTS, NULL);
    app_result_size(&out, "arrived", c->arrived, "stand within 0.01 rad");
    app_result_line(&out, "The worst is off by %.2g rad.", c->worst);
    app_result_real(&out, "largest_torque", c->largest, NULL);
    app_result_text(&out, "out", values.out, "(log.svg, fit.svg, learned.svg, predicted.svg)");
    app_result_real(&out, "seconds", seconds, NULL);
    app_json_warnings(&out, self);
    app_json_end(&out);
}

static void load(demo *d) {
    APP_FREE char *path = app_format("%s/model.h5", values.out);
    APP_MUST_FILE(d->app, path,
                  lg_machine_file_parse(d->app->context, "truth.yaml", truth_text, strlen(truth_text),
                                        &d->truth, &error));
    APP_MUST_FILE(d->app, path, lg_machine_model_load(d->app->context, path, NULL, &d->model, &error));
}

static void demo_destroy(demo *d) {
    lg_machine_file_destroy(&d->truth);
    lg_machine_model_file_destroy(&d->model);
}

static int run(app *self) {
    APP_CLEAN(demo_destroy) demo d = {.app = self};
    comparison learned;
    control c;
    const double begin = app_seconds();
    APP_MUST_FILE(self, values.out, app_make_folder(values.out, &error));
    APP_MUST_FILE(self, values.out, app_claim(self, values.out, &error));
    app_write_texts(self, values.out, texts, LG_COUNT(texts));
    run_commands(self);
    load(&d);
    compare_numbers(&d, &learned);
    compare_potentials(&d, &learned);
    control_all(&d, &c);
    report(self, &learned, &c, app_seconds() - begin);
    if (c.arrived == STARTS) return APP_EXIT_OK;
    return app_fail(self, LG_NO_CONVERGENCE, "the controller fails from %zu of %d starts: more --seconds",
                    STARTS - c.arrived, STARTS);
}

const app_command demo_command = {
    .name = "demo",
    .summary = "A driven, damped rigid body from its log to a controller",
    .details =
        "Makes a log of a body whose masses, damping and potential are known, learns them from it, and "
        "controls the true body with the learned one. Every command is shown before it runs.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
