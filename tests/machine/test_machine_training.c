/* The recipe of machines through the hooks of its trainer: short logs, without a command.
 * ctest-labels: src/machine */
#include "machine/files/choice.h"
#include "support/io_test.h"

/* ---- a log ---- */

#define LINE        "coordinates: [{name: x, kind: line, velocity: v}]\ncolumns: {run: run}\n"
#define INPUT       "inputs: {columns: [u, w], hold: zero}\n"
#define LAW         "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
#define ALONE       "coordinates: [{name: x, kind: line"
#define ASKS(words) LINE "inputs: {columns: [u, w], " words "}\n" LAW MAP
#define MAP         "input_map: {kind: known, values: [[1, -0.5]]}\n"

enum { RUNS = 2, STEPS = 40 };
static const double dt = 0.1;

/* 2 x'' = -4 x - 0.3 x' + u - 0.5 w; u and w are constant between rows. */
static double acceleration(double x, double v, double u, double w) {
    return (-4 * x - 0.3 * v + u - 0.5 * w) / 2;
}

static void move(double *x, double *v, double u, double w) {
    for (int i = 0; i < STEPS; i++) { /* midpoint rule */
        const double h = dt / STEPS, xm = *x + 0.5 * h * *v, vm = *v + 0.5 * h * acceleration(*x, *v, u, w);
        *x += h * vm;
        *v += h * acceleration(xm, vm, u, w);
    }
}

/* Writes two runs of `rows` rows. The inputs change in each row, and act `delay` rows after they are
 * logged. */
static const char *write_log(size_t rows, size_t delay) {
    const char *path = scratch_path("log.csv");
    FILE *file = fopen(path, "w");
    lg_rng rng = test_rng(5, 0);
    assert_non_null(file);
    (void)fprintf(file, "t,run,x,v,a,u,w\n");
    for (size_t run = 0; run < RUNS; run++) {
        double x = 1 - 1.5 * (double)run, v = 0.5, u[8] = {0}, w[8] = {0};
        for (size_t row = 0; row < rows; row++) {
            u[row % 8] = lg_rng_uniform_in(&rng, -2, 2);
            w[row % 8] = lg_rng_uniform_in(&rng, -2, 2);
            const size_t at = (row + 8 - delay) % 8;
            (void)fprintf(file, "%.17g,%zu,%.17g,%.17g,%.17g,%.17g,%.17g\n", dt * (double)row, run, x, v,
                          acceleration(x, v, u[at], w[at]), u[row % 8], w[row % 8]);
            move(&x, &v, u[at], w[at]);
        }
    }
    (void)fclose(file);
    return path;
}

/* ---- a training ---- */

typedef struct learning {
    lg_context *context;
    char told[4096]; /* warnings */
    lg_training training;
    lg_machine_model_run run;
    lg_machine_state state;
    const char *paths[2];
    const char *given; /* options "name=value name=value" */
} learning;

static bool given(const lg_training *self, const char *option) {
    const char *at = strstr(((const learning *)self->user)->given, option);
    return at != NULL && at[strlen(option)] == '=';
}

RELEASES(release_file, lg_machine_model_file_destroy)

static void note(void *user, lg_log_level level, const char *message) {
    learning *l = user;
    const size_t used = strlen(l->told);
    (void)level;
    (void)snprintf(l->told + used, sizeof l->told - used, "%s\n", message);
}

static void release_learning(void *object) {
    learning *l = object;
    if (l->training.recipe != NULL) lg_training_close(&l->training);
    l->training.recipe = NULL;
    lg_context_destroy(l->context);
    l->context = NULL;
}

/* Sets the fields of the run and of the options of the trainer. */
static void set_options(learning *l) {
    char text[256], *save = NULL;
    (void)snprintf(text, sizeof text, "%s", l->given);
    lg_fields_default(lg_recipe_machine_model.fields, &l->run);
    l->run.training.epochs = 3;
    for (char *word = strtok_r(text, " ", &save); word != NULL; word = strtok_r(NULL, " ", &save)) {
        char *value = strchr(word, '=');
        *value++ = '\0';
        const lg_field *row = lg_field_find(lg_recipe_machine_model.fields, word);
        if (row != NULL) assert_ok(lg_field_set(row, value, &l->run, NULL));
        if (strcmp(word, "select") == 0) l->state.select = 1;
        if (strcmp(word, "suggest") == 0) l->state.suggest = "-";
        if (strcmp(word, "size") == 0) l->state.size = test_text("%s", value);
    }
}

static void open_training(learning *l) {
    l->training = lg_training_of(l->context, &lg_recipe_machine_model, &l->run, &l->state);
    l->training.paths = l->paths;
    l->training.path_count = 2;
    l->training.model = "model.h5";
    l->training.given = given;
    l->training.user = l;
}

static lg_status learn_once(learning *l, lg_error *error) {
    lg_training *t = &l->training;
    const lg_trainer *trainer = lg_recipe_machine_model.trainer;
    lg_context_options options;
    release_learning(l);
    l->told[0] = '\0';
    lg_context_options_init(&options);
    options.log = note;
    options.log_user = l;
    LG_TRY(lg_context_create(&options, &l->context));
    memset(&l->run, 0, sizeof l->run);
    memset(&l->state, 0, sizeof l->state);
    set_options(l);
    open_training(l);
    LG_TRY(trainer->read(t, error));
    LG_TRY(trainer->describe(t, error));
    LG_TRY(trainer->prepare(t, error));
    lg_fit_options_init(&t->options);
    lg_fit_settings_apply(&l->run.training, &t->options);
    t->options.threads = 1;
    LG_TRY(lg_training_create_fit(t, error));
    LG_TRY(lg_fit_run(t->fit, error));
    lg_fit_parameters(t->fit, t->theta);
    LG_TRY(trainer->judge(t, t->theta, error));
    return t->results_lost ? LG_OUT_OF_MEMORY : LG_OK;
}

/* Results of a model file on the log. */
static lg_status evaluate_once(learning *l, const lg_machine_model_file *file, lg_error *error) {
    lg_training_close(&l->training);
    memset(&l->state, 0, sizeof l->state);
    open_training(l);
    l->training.paths++;
    l->training.path_count--;
    return lg_training_evaluate(&l->training, file, error);
}

static learning *learn(const char *yaml, const char *log, const char *options) {
    learning *l = TEST_ARRAY(learning, 1);
    write_text_to(scratch_path("m.yaml"), yaml);
    l->paths[0] = test_text("%s/m.yaml", scratch);
    l->paths[1] = log;
    l->given = options;
    lg_test_owns(l, release_learning);
    assert_told(learn_once(l, &told));
    return l;
}

static void assert_number(const learning *l, const char *name, double value, double tolerance) {
    const lg_machine_verdict *v = &l->state.verdict;
    for (size_t i = 0; i < v->count; i++)
        if (strcmp(v->identified.numbers[i].name, name) == 0) {
            assert_close(v->identified.numbers[i].value, value, tolerance, 0);
            return;
        }
    fail_msg("%s is not identified", name);
}

static void assert_law(const learning *l, double tolerance) {
    assert_number(l, "mass.1.1", 2, tolerance);
    assert_number(l, "potential.x^2", 2, tolerance);
    assert_number(l, "damping.x", 0.3, tolerance);
}

TEST("a short log gives the numbers of its machine; the model that is saved has no error on the log") {
    learning *l = learn(LINE INPUT LAW MAP, write_log(20, 0), "");
    const char *path = scratch_path("model.h5");
    const lg_provenance provenance = {.has_seed = true, .seed = 1};
    lg_machine_model_file *file = TEST_ARRAY(lg_machine_model_file, 1);
    assert_law(l, 1e-5);
    assert_told(lg_training_save(&l->training, path, l->training.theta, &provenance, &told));
    assert_told(lg_machine_model_load(NULL, path, NULL, file, &told));
    lg_test_owns(file, release_file);
    assert_told(evaluate_once(l, file, &told));
    assert_true(lg_result_find(&l->training, "window_loss")->real < 1e-6);
    assert_true(lg_result_find(&l->training, "velocity")->real < 1e-3);
}

TEST("positions alone or accelerations alone give the numbers too") {
    assert_law(
        learn("measured: positions\n" ALONE "}]\ncolumns: {run: run}\n" INPUT LAW MAP, write_log(60, 0), ""),
        1e-5);
    assert_law(learn("measured: accelerations\n" ALONE
                     ", acceleration: a}]\ncolumns: {run: run}\n" INPUT LAW MAP,
                     write_log(60, 0), ""),
               1e-4);
}

TEST("lags and bristles that the log does not need hardly change the numbers") {
    assert_law(learn(ASKS("hold: zero, lag: unknown"), write_log(20, 0), ""), 0.05);
    assert_law(learn(LINE INPUT "mass: diagonal\npotential: {kind: quadratic, of: x}\n"
                                "damping: [diagonal, lugre]\n" MAP,
                     write_log(8, 0), ""),
               1e-4);
}

TEST("windows of more than a thousand rows fit into memory") {
    assert_law(learn(LINE INPUT LAW MAP, write_log(1100, 0), "window=1100"), 1e-5);
}

TEST("hold and delay of each input are found") {
    const learning *l = learn(ASKS("hold: auto, delay: auto"), write_log(120, 1), "");
    assert_says(l->state.data.file.text, "hold: zero, delay: 1}");
    assert_says(l->told, "the input u acts 1 row after it is logged");
    assert_law(l, 1e-5);
}

TEST("damping that is missing is suggested") {
    const learning *l = learn(LINE INPUT "mass: diagonal\npotential: {kind: quadratic, of: x}\n" MAP,
                              write_log(120, 0), "suggest=- epochs=1");
    assert_says(l->state.data.file.text, "damping: {kind: diagonal}");
    assert_says(l->told, "the log asks for ");
    assert_law(l, 1e-3);
}

TEST("free runs choose the widths of networks and the epoch") {
    learning *l = learn(LINE INPUT "mass: diagonal\npotential: {kind: network, of: x, hidden: [2]}\n"
                                   "damping: diagonal\n" MAP,
                        write_log(120, 0), "size=auto select=1 epochs=1");
    assert_says(l->state.data.file.text, test_text("hidden: [%s]", l->state.width));
    assert_string_equal(lg_result_find(&l->training, "size")->text, l->state.width);
    assert_says(l->told, test_text("networks of width [%s] are taken", l->state.width));
}
