/* The recipe of machines through the hooks of its trainer: short logs, without a command.
 * ctest-labels: slow src/machine */
#include "machine/files/choice.h"
#include "support/io_test.h"

/* ---- a log ---- */

#define LINE        "coordinates: [{name: x, kind: line, velocity: v}]\ncolumns: {run: run}\n"
#define INPUT       "inputs: {columns: [u, w], hold: zero}\n"
#define LAW         "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
#define ALONE       "coordinates: [{name: x, kind: line"
#define ASKS(words) LINE "inputs: {columns: [u, w], " words "}\n" LAW MAP
#define MAP         "input_map: {kind: known, values: [[1, -0.5]]}\n"

static const double dt = 0.1;

/* 2 x'' = -4 x - d x' + u - 0.5 w; z has no effect. d is 0.3, or `back` where x' is below 0. */
static double back;
static double acceleration(double x, double v, double u, double w) {
    return (-4 * x - (v < 0 ? back : 0.3) * v + u - 0.5 * w) / 2;
}

/* The inputs go from `from` to `to`. */
static void move(double *x, double *v, const double *from, const double *to) {
    enum { STEPS = 40 };
    for (int i = 0; i < STEPS; i++) { /* midpoint rule */
        const double s = (i + 0.5) / STEPS, u = from[0] + s * (to[0] - from[0]),
                     w = from[1] + s * (to[1] - from[1]);
        const double h = dt / STEPS, xm = *x + 0.5 * h * *v, vm = *v + 0.5 * h * acceleration(*x, *v, u, w);
        *x += h * vm;
        *v += h * acceleration(xm, vm, u, w);
    }
}

/* A log of `runs` runs of `rows` rows. The inputs change in each row by up to twice `size`, and act `delay`
 * rows after they are logged. Uneven: runs after the first have a third of the rows. Linear: inputs are lines
 * between rows. Asymmetric: x' below 0 has another friction. y is twice x. h is missing in one row. */
typedef struct shape {
    size_t runs, rows, delay;
    double size;
    enum { USUAL, UNEVEN, LINEAR, ASYMMETRIC } special;
} shape;

static const char *write_log(shape of) {
    enum { ROOM = 8 };
    const char *path = scratch_path("log.csv");
    FILE *file = fopen(path, "w");
    lg_rng rng = test_rng(5, 0);
    assert_non_null(file);
    back = of.special == ASYMMETRIC ? 0.9 : 0.3;
    (void)fprintf(file, "t,run,x,v,a,u,w,z,y,vy,h\n");
    for (size_t run = 0; run < of.runs; run++) {
        double x = 1 - 1.5 * (double)(run % 2), v = 0.5, u[ROOM][3] = {{0}};
        const size_t count = of.special == UNEVEN && run > 0 ? of.rows / 3 : of.rows;
        for (size_t row = 0; row < count; row++) {
            const double *in = u[(row + ROOM - of.delay) % ROOM];
            double *now = u[row % ROOM];
            for (int i = 0; i < 3; i++) now[i] = of.size * lg_rng_uniform_in(&rng, -1, 1);
            (void)fprintf(file, "%.17g,%zu,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%s\n",
                          dt * (double)row, run, x, v, acceleration(x, v, in[0], in[1]), now[0], now[1],
                          now[2], 2 * x, 2 * v, run == 0 && row == 25 ? "" : "0");
            move(&x, &v, of.special == LINEAR ? u[(row + ROOM - 1) % ROOM] : in, in);
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

static void release_file(void *file) {
    lg_recipe_release(&lg_recipe_machine_model, file);
}

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
        if (row != NULL)
            assert_ok(lg_field_set(row, value, &l->run, NULL));
        else if (strcmp(word, "select") == 0)
            l->state.select = 1;
        else if (strcmp(word, "suggest") == 0)
            l->state.suggest = test_text("%s", value);
        else if (strcmp(word, "again") == 0)
            l->state.validation = l->paths[1];
        else if (strcmp(word, "size") == 0)
            l->state.size = test_text("%s", value);
        else if (strcmp(word, "seconds") != 0) /* learn_once reads it */
            fail_msg("no option %s", word);
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
    if (given(t, "seconds")) t->options.seconds = 100;
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

static learning *prepare(const char *yaml, const char *log, const char *options) {
    learning *l = TEST_ARRAY(learning, 1);
    write_text_to(scratch_path("m.yaml"), yaml);
    l->paths[0] = test_text("%s/m.yaml", scratch);
    l->paths[1] = log;
    l->given = options;
    lg_test_owns(l, release_learning);
    return l;
}

static learning *learn(const char *yaml, const char *log, const char *options) {
    learning *l = prepare(yaml, log, options);
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

/* Saves the model, loads it and evaluates it on the log. The mean square of its errors is at most `most`. */
static void assert_evaluated(learning *l, double most) {
    const char *path = scratch_path("model.h5");
    const lg_provenance provenance = {.has_seed = true, .seed = 1};
    lg_machine_model_file *file = TEST_ARRAY(lg_machine_model_file, 1);
    assert_told(lg_training_save(&l->training, path, l->training.theta, &provenance, &told));
    assert_told(lg_recipe_load(NULL, path, NULL, &lg_recipe_machine_model, file, &told));
    lg_test_owns(file, release_file);
    assert_told(evaluate_once(l, file, &told));
    assert_false(lg_result_find(&l->training, "window_loss")->real > most); /* NaN for accelerations */
    assert_close(lg_result_find(&l->training, "horizon")->real, 1, 0, 0);
}

TEST("a short log gives the numbers of its machine") {
    assert_law(learn(LINE INPUT LAW MAP, write_log((shape){2, 20, 0, 2, USUAL}), ""), 1e-5);
}

TEST("positions alone or accelerations alone give the numbers too") {
    assert_law(learn("measured: positions\n" ALONE "}]\ncolumns: {run: run}\n" INPUT LAW MAP,
                     write_log((shape){2, 60, 0, 2, USUAL}), ""),
               1e-5);
    assert_law(learn("measured: accelerations\n" ALONE
                     ", acceleration: a}]\ncolumns: {run: run}\n" INPUT LAW MAP,
                     write_log((shape){2, 60, 0, 2, USUAL}), ""),
               1e-4);
}

TEST("lags and bristles that the log does not need hardly change the numbers") {
    assert_law(learn(ASKS("hold: zero, lag: unknown"), write_log((shape){2, 20, 0, 2, USUAL}), ""), 0.05);
    assert_law(learn(LINE INPUT "mass: diagonal\npotential: {kind: quadratic, of: x}\n"
                                "damping: [diagonal, lugre]\n" MAP,
                     write_log((shape){2, 5, 0, 2, USUAL}), ""),
               1e-4);
}

TEST("windows of more than a thousand rows fit into memory") {
    assert_law(learn(LINE INPUT LAW MAP, write_log((shape){2, 1100, 0, 2, USUAL}), "window=1100"), 1e-5);
}

TEST("the hold of an input is found") {
    const learning *l =
        learn(ASKS("hold: [auto, zero]"), write_log((shape){2, 105, 0, 2, USUAL}), "epochs=1");
    assert_says(l->state.data.file.text, "hold: zero}");
    assert_law(l, 1e-3);
}

TEST("where no term is missing, none is suggested") {
    const learning *l =
        learn(LINE "mass: {kind: known, values: [2]}\npotential: {kind: quadratic, of: x}\n"
                   "damping: {kind: network, of: v, hidden: [2]}\noffset: {kind: known, values: [0]}\n",
              write_log((shape){2, 105, 0, 0, USUAL}), "suggest=- epochs=1");
    assert_says(l->told, "the log asks for no further term");
    assert_number(l, "potential.x^2", 2, 1e-4);
}

TEST("free runs choose the epoch") {
    learning *l = learn(LINE INPUT "mass: diagonal\npotential: {kind: network, of: x, hidden: [2]}\n"
                                   "damping: diagonal\n" MAP,
                        write_log((shape){2, 105, 0, 2, USUAL}), "size=4 select=1 epochs=13");
    assert_says(l->state.data.file.text, "hidden: [4]");
    const lg_result *epoch = l->training.results;
    while (epoch->name == NULL || strcmp(epoch->name, "epoch") != 0) epoch++;
    assert_true(epoch->whole >= 1 && epoch->whole <= 13);
}

TEST("a spring that is missing is suggested") {
    const learning *l = learn(LINE "mass: {kind: known, values: [2]}\n"
                                   "damping: {kind: network, of: v, hidden: [2]}\n",
                              write_log((shape){2, 120, 0, 0, USUAL}), "suggest=- epochs=1");
    /* Without noise, rounding decides whether the spring's law has a higher power, too. */
    assert_says(l->state.data.file.text, "potential: {kind: ");
    assert_says(l->state.data.file.text, ", of: x");
    assert_says(l->told, "the log asks for a spring of x");
    assert_number(l, "potential.x^2", 2, 0.01);
}

TEST("a spring is suggested for the line that lacks it; candidates that cannot be learned are named, too") {
    const char *path = scratch_path("suggested.yaml");
    learning *l =
        learn("coordinates: [{name: x, kind: line, velocity: v}, {name: z, kind: line, velocity: u}]\n"
              "columns: {run: run}\ninputs: {columns: [w, h], hold: zero, delay: [0, 4], lag: 0.1, curve: "
              "{dead_zone: 1}}\n"
              "mass: {kind: known, values: [2, 1]}\n"
              "potential: {kind: quadratic, of: z}\ndamping: [{kind: asymmetric, values: [[0.3, 1], [0, "
              "0]]}, {kind: quadratic, values: [0, 0]},\n"
              "  {kind: cubic, values: [0, 0]}, {kind: stribeck, values: [[0, 0], [0, 0], [1, 1]]}]\n"
              "input_map: {kind: known, values: [[1, 0], [0, 0]]}\n",
              write_log((shape){2, 105, 0, 0, USUAL}), test_text("suggest=%s", path));
    assert_says(l->told, "the log asks for a spring of x");
    size_t size;
    assert_says((const char *)read_bytes_of(path, &size), ", of: x");
}

TEST("friction that differs by direction is suggested together with an offset") {
    const learning *l =
        learn(LINE "mass: {kind: known, values: [2]}\npotential: {kind: polynomial, of: x, degree: 2}\n",

              write_log((shape){2, 105, 0, 0, ASYMMETRIC}), "suggest=-");
    assert_says(l->told, "and for a constant force (an offset)");
}

TEST("free runs choose the widths of networks and the epoch") {
    learning *l = learn(LINE INPUT "mass: diagonal\npotential: {kind: network, of: x, hidden: [2]}\n"
                                   "damping: diagonal\n" MAP,
                        write_log((shape){2, 105, 0, 2, USUAL}), "size=auto select=1 epochs=1");
    assert_says(l->state.data.file.text, test_text("hidden: [%s]", l->state.width));
    assert_string_equal(lg_result_find(&l->training, "size")->text, l->state.width);
    assert_says(l->told, test_text("networks of width [%s] are taken", l->state.width));
}

/* ---- options, holds, gaps and machines for which other code runs ---- */

#define SPRING           "potential: {kind: quadratic, of: x}\n"
#define THREE            LINE "inputs: {columns: [u, w, z], hold: zero, "
#define MAP_3            "input_map: {kind: known, values: [[1, -0.5, 0]]}\n"
#define SPRING_OF(value) "potential: {kind: known, form: quadratic, of: x, values: [" value "]}\n"
#define ACCELERATIONS    "measured: accelerations\n" ALONE ", acceleration: a}]\ncolumns: {run: run}\n"
#define KNOWN            "mass: {kind: known, values: [2]}\n"

static const struct {
    const char *yaml;
    shape log;
    const char *options, *words; /* words: in the machine's text, the warnings or the sentence of the error */
    lg_status status;
    double law; /* > 0: tolerance of the numbers of the law */
} rows[] = {
    {LINE "inputs: {columns: [u, w]}\n" LAW MAP, {2, 40, 0, 0, USUAL}, "", "always 0", LG_OK, 0},
    {ASKS("hold: auto, delay: auto"),
     {2, 120, 1, 2, USUAL},
     "",
     "the input u acts 1 row after it is logged",
     LG_OK,
     1e-4},
    {THREE "delay: [auto, auto, 0]}\n" LAW MAP_3, {2, 120, 1, 2, USUAL}, "", "delay: [1, 1, 0]", LG_OK, 1e-4},
    {LINE "inputs: {columns: [u, w], hold: auto}\nmass: {kind: network, of: x, hidden: [2]}\n" SPRING
          "damping: diagonal\n" MAP,
     {2, 105, 0, 2, USUAL},
     "epochs=1",
     "hold: zero",
     LG_OK,
     0},
    {ASKS("hold: zero, delay: estimate"),
     {2, 40, 1, 2, USUAL},
     "hop=0 seconds=1",
     "act 1 row after",
     LG_OK,
     1e-4},
    {"noise: {x: 0.01, v: 0.02}\n" LINE INPUT LAW MAP, {10, 24, 0, 2, UNEVEN}, "", "", LG_OK, 1e-4},
    {LINE INPUT LAW MAP, {10, 12, 0, 2, UNEVEN}, "", "", LG_OK, 1e-4},
    {LINE INPUT LAW MAP, {40, 12, 0, 2, USUAL}, "prior=0.1 again=1", "", LG_OK, 1e-4},
    {LINE "inputs: {columns: [u, w]}\n" LAW MAP, {2, 20, 0, 2, USUAL}, "", "", LG_OK, 1e-4},
    {LINE "inputs: {columns: [u, w], delay: 1}\n" LAW MAP,
     {2, 120, 0, 2, LINEAR},
     "",
     "the inputs are sampled analogue signals: hold: linear",
     LG_OK,
     0},
    {LINE INPUT LAW MAP, {10, 2, 0, 2, USUAL}, "", "has 2 rows; at least 3", LG_FORMAT, 0},
    {LINE INPUT LAW MAP, {1, 2100, 0, 2, USUAL}, "window=2100 shards=1", "", LG_OK, 1e-4},
    {LINE INPUT KNOWN "potential: {kind: network, of: x, hidden: [2]}\n" MAP,
     {2, 40, 0, 2, USUAL},
     "",
     "does not explain",
     LG_OK,
     0},
    {ACCELERATIONS INPUT LAW MAP, {8, 60, 0, 2, USUAL}, "window=6", "", LG_OK, 1e-3},
    {LINE INPUT "mass: diagonal\n" SPRING "damping: {kind: coulomb, values: [2], width: 1e-4}\n" MAP,
     {2, 5, 0, 2, USUAL},
     "",
     "friction stops the machine",
     LG_OK,
     0},
    {LINE INPUT KNOWN SPRING_OF("-2000") "damping: diagonal\n" MAP,
     {1, 600, 0, 2, USUAL},
     "window=600",
     "the loss is NaN",
     LG_NOT_FINITE,
     0},
    {LINE INPUT KNOWN SPRING_OF("2") MAP,
     {1, 8100, 0, 2, USUAL},
     "initial-states=measured window=5",
     "everything is known",
     LG_INVALID_ARGUMENT,
     0},
    {ACCELERATIONS "inputs: {columns: [u, w], hold: zero, lag: 0.001}\n" LAW MAP,
     {2, 60, 0, 2, USUAL},
     "",
     "",
     LG_OK,
     0},
    {"coordinates: [{name: x, kind: line, velocity: v}, {name: y, kind: angle, velocity: vy}]\ncolumns: "
     "{run: "
     "run}\nsystem: cart-pole\nparameters: {cart: unknown, pole: 0.1, length: unknown, gravity: 9.81}\n"
     "mass: {kind: network, of: y, hidden: [2]}\n",
     {2, 20, 0, 0, USUAL},
     "epochs=1",
     "does not explain",
     LG_OK,
     0},
    {"measured: positions\nnoise: {x: 2}\n" ALONE "}]\ncolumns: {run: run}\n" INPUT LAW MAP,
     {2, 100, 0, 2, USUAL},
     "",
     "",
     LG_OK,
     1e-2},
    {"measured: positions\nnoise: {x: 2}\ncoordinates: [{name: x, kind: angle}]\ncolumns: {run: run}\n" INPUT
         KNOWN "damping: {kind: known, values: [0.3]}\n" MAP,
     {1, 500, 0, 2, USUAL},
     "initial-states=measured",
     "everything is known",
     LG_INVALID_ARGUMENT,
     0},
    {ACCELERATIONS INPUT "mass: diagonal\npotential: {kind: network, of: x, hidden: [2]}\n" MAP,
     {1, 1500, 0, 2, USUAL},
     "size=auto initial-states=measured",
     "leave the option out",
     LG_INVALID_ARGUMENT,
     0},
    {LINE INPUT KNOWN SPRING_OF("2") "damping: {kind: known, values: [0.3]}\n"
                                     "input_map: {kind: network, of: x, hidden: [2]}\n",
     {2, 105, 0, 0, USUAL},
     "size=auto",
     "networks of width [4] are taken",
     LG_OK,
     0},
    {LINE INPUT KNOWN SPRING_OF("-1e10") "damping: diagonal\n" MAP,
     {2, 300, 0, 2, USUAL},
     "window=3 select=1",
     "",
     LG_OK,
     0},
    {"measured: positions\n" ALONE "}]\ncolumns: {run: run}\n" INPUT LAW MAP,
     {2, 60, 0, 2, USUAL},
     "window=6",
     "",
     LG_OK,
     1e-3},
    {"measured: positions\n" ALONE "}]\ncolumns: {run: run}\n" INPUT LAW MAP,
     {10, 14, 0, 2, USUAL},
     "",
     "",
     LG_OK,
     1e-3},
    {"measured: positions\n" ALONE
     "}]\ncolumns: {run: run}\n" INPUT KNOWN SPRING_OF("2") "damping: {kind: known, values: [0.3]}\n" MAP,
     {2, 60, 0, 2, USUAL},
     "",
     "",
     LG_OK,
     0},
    {"measured: positions\nnoise: {x: 0.01}\n" ALONE "}, {name: z, kind: line}]\ncolumns: {run: run}\n" INPUT
     "mass: {kind: known, values: [2, 1]}\n" SPRING "damping: {kind: known, values: [[0.3, 0], [0, 0.3]]}\n"
     "input_map: {kind: known, values: [[1, -0.5], [0, 0]]}\n",
     {2, 100, 0, 0, USUAL},
     "",
     "",
     LG_OK,
     0},
    {LINE "inputs: {columns: [z], hold: zero, lag: unknown}\n" LAW
          "input_map: {kind: known, values: [[1]]}\n",
     {2, 20, 0, 2, USUAL},
     "",
     "is the longest lag",
     LG_OK,
     0},
    {ASKS("hold: auto"), {2, 105, 0, 0, USUAL}, "", "hold: zero", LG_OK, 0},
    {"coordinates: [{name: x, kind: line, velocity: v}, {name: z, kind: line, velocity: u}]\ncolumns: {run: "
     "run}\n"
     "mass: {kind: known, values: [2, 1]}\n" SPRING "damping: lugre\n",
     {2, 5, 0, 0, USUAL},
     "",
     "",
     LG_OK,
     0},
    {LINE KNOWN SPRING "damping: lugre\n", {2, 103, 0, 0, USUAL}, "window=2 epochs=1", "", LG_OK, 0},
    {"measured: positions\n" ALONE "}]\ncolumns: {run: run}\n" KNOWN SPRING "damping: lugre\n",
     {1, 9, 0, 0, USUAL},
     "window=4 epochs=1",
     "",
     LG_OK,
     0},
    {LINE INPUT KNOWN SPRING "damping: {kind: network, of: v, hidden: [24]}\n" MAP,
     {2, 140, 0, 2, USUAL},
     "epochs=1",
     "",
     LG_OK,
     0},
    {ASKS("hold: zero, lag: [unknown, none]"), {2, 20, 0, 2, USUAL}, "", "", LG_OK, 0},
    {LINE INPUT LAW MAP, {2, 20, 0, 2, USUAL}, "substeps=1 scheme=lie-euler", "steps are too long", LG_OK, 0},
    {LINE INPUT LAW MAP, {2, 20, 0, 2, USUAL}, "substeps=1", "give --substeps 2", LG_OK, 0},
    {LINE INPUT "mass: diagonal\n" SPRING "damping: [diagonal, stribeck]\n" MAP,
     {2, 20, 0, 2, USUAL},
     "",
     "",
     LG_OK,
     0},
    {"coordinates: [{name: x, kind: line, velocity: v}, {name: y, kind: line, velocity: vy}]\ncolumns: {run: "
     "run}\n"
     "mass: diagonal\npotential: {kind: quadratic, of: [x, y]}\ndamping: diagonal\n",
     {2, 20, 0, 0, USUAL},
     "",
     "is set to 1",
     LG_OK,
     0},
    {ACCELERATIONS INPUT KNOWN "residual: {kind: polynomial, degree: 1, of: [x.velocity, u]}\n" MAP,
     {8, 60, 0, 2, USUAL},
     "window=6",
     "where x is cannot be known",
     LG_OK,
     0},
};

TEST("trainings with other options, holds, gaps and machines end as their rows say") {
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const size_t mark = lg_test_owned();
        learning *l = prepare(rows[i].yaml, write_log(rows[i].log), rows[i].options);
        lg_error error = {LG_OK, ""};
        LG_STATUS_OF(learn_once(l, &error), status);
        if (status != rows[i].status) fail_msg("row %zu: %s: %s", i, lg_status_name(status), error.message);
        assert_says(
            test_text("%s%s%s", status == LG_OK ? l->state.data.file.text : "", l->told, error.message),
            rows[i].words);
        if (rows[i].law > 0) assert_law(l, rows[i].law);
        if (status == LG_OK) assert_evaluated(l, rows[i].law > 0 ? 1e-4 : INFINITY);
        lg_test_give_back(mark);
    }
}
