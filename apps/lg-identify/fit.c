/* lg-identify fit: learn the machine. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-identify/runs.h"
#include "lg-identify/fit.h"

/* ---- settings ---- */

static struct { const char *validation; } given;

static const lg_field options[] = {
    LG_OPTION(__typeof__(given), validation, STRING, "LOG,LOG,...",
              "Logs that are not trained on: the parameters of the best epoch on them are the result"),
    LG_FIELD_END};

static lg_machine_model_run run; /* all that determines the result */
static const app_settings settings[] = {{lg_machine_model_fields, &run, sizeof run},
                                        APP_GIVEN(options, given),
                                        TRAIN_SHARED_NO_SIZE,
                                        APP_SETTINGS_END};

static training state = {.run = &run};

/* ---- data and run ---- */

enum { SHORTEST_LOG = 3 };

/* Rows of the longest part without a gap. */
static size_t longest_part(const training *t) {
    const lg_machine_log *log = &t->data.training;
    size_t longest = 0;
    for (size_t p = 0; p < log->parts; p++)
        if (log->first[p + 1] - log->first[p] > longest) longest = log->first[p + 1] - log->first[p];
    return longest;
}

static int read_data(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    training *t = user;
    const size_t logs = (size_t)self->argument_count - 1;
    int code = identify_read(self, path, self->arguments + 1, logs, given.validation, &t->data);
    if (code == APP_EXIT_OK) code = identify_refuse_momenta(self, &t->data.file, path);
    if (code != APP_EXIT_OK) return code;
    if (longest_part(t) < SHORTEST_LOG)
        return app_fail(self, LG_FORMAT,
                        "%s: the longest part without a gap has %zu rows; accelerations take %d at least",
                        self->arguments[1], longest_part(t), SHORTEST_LOG);
    identify_noise(&t->data, t->position_noise, t->velocity_noise);
    lg_machine_log_sha256(&t->data.file.machine, &t->data.logs.log, sha256);
    memcpy(run.data_sha256, sha256, LG_SHA256_TEXT);
    return APP_EXIT_OK;
}

static uint32_t at_most(size_t rows, uint32_t wanted) {
    return rows >= 2 && rows < wanted ? (uint32_t)rows : wanted;
}

/* Windows touch; they overlap where there would be too few. */
static uint32_t find_stride(const training *t) {
    enum { ENOUGH = 2000 };
    if (run.starts == LG_MACHINE_STARTS_ESTIMATED) return run.window - 1;
    const lg_machine *machine = &t->data.file.machine;
    const bool positions = t->data.file.measured == LG_MEASURED_POSITIONS;
    uint32_t stride = run.window - 1;
    while (stride > 1 &&
           lg_machine_windows(machine, &t->data.training, run.window, stride, positions, NULL) < ENOUGH)
        stride /= 2;
    return stride;
}

/* Parameters of the fit, about: those of the starts included. */
static size_t count_parameters(const training *t) {
    const lg_machine *machine = &run.machine;
    const size_t windows = lg_machine_windows(machine, &t->data.training, run.window, run.stride, true, NULL);
    const size_t starts = run.starts == LG_MACHINE_STARTS_ESTIMATED ? windows : 0;
    return machine->parameters + starts * (machine->positions + machine->velocities);
}

static bool ends_with_lm(const lg_fit_plan *plan) {
    return plan->phases > 0 && plan->phase[plan->phases - 1].method == LG_FIT_LM;
}

/* What is not given: how measured best, docs/reports/machines.md. */
static void choose_settings(const app *self, const training *t) {
    enum { DENSE = 4000 };
    static const double prior = 0.3;
    const bool positions = t->data.file.measured == LG_MEASURED_POSITIONS, noisy = is_noisy(t) || positions;
    if (!app_given(self, "starts"))
        run.starts = noisy ? LG_MACHINE_STARTS_ESTIMATED : LG_MACHINE_STARTS_MEASURED;
    if (!app_given(self, "window")) run.window = at_most(longest_part(t), positions ? 60 : noisy ? 20 : 5);
    if (!app_given(self, "substeps")) run.substeps = 1;
    if (!app_given(self, "stride") || run.stride == 0) run.stride = find_stride(t);
    const bool lm = are_few(&run.machine), dense = count_parameters(t) <= DENSE;
    if (!app_given(self, "method"))
        (void)lg_fit_plan_parse(lm ? "lm" : dense ? "ssbroyden" : "lbfgs", &run.training.plan, NULL);
    if (!app_given(self, "prior")) run.training.prior = ends_with_lm(&run.training.plan) ? 0.0 : prior;
    if (!app_given(self, "epochs")) run.training.epochs = lm ? 100 : 3000;
}

/* ---- the problem ---- */

static double root_mean_square(const training *t, uint32_t coordinate) {
    const lg_machine_log *log = &t->data.training;
    const lg_machine *machine = &run.machine;
    uint32_t first = 0;
    double sum = 0.0;
    size_t count = 0;
    for (uint32_t i = 0; i < coordinate; i++)
        first += lg_coordinate_row_of(machine->coordinates[i].kind)->velocities;
    const uint32_t each = lg_coordinate_row_of(machine->coordinates[coordinate].kind)->velocities;
    for (size_t row = 0; row < log->rows; row++)
        for (uint32_t k = first; k < first + each; k++) {
            const double v = log->v[row * machine->velocities + k];
            if (isnan(v)) continue;
            sum += v * v;
            count++;
        }
    return count > 0 ? sqrt(sum / (double)count) : 0.0;
}

/* Errors count in units of the noise; without noise, of velocities and of half the way of a window. */
static void set_loss_scales(const training *t) {
    for (uint32_t i = 0; i < run.machine.coordinate_count; i++) {
        const double moves = root_mean_square(t, i);
        const double speed = moves > 0.0 ? moves : run.scales.velocity[0] / run.scales.time;
        const double v = t->velocity_noise[i], q = t->position_noise[i];
        run.velocity_scale[i] = v > 0.0 ? v : speed;
        run.position_scale[i] = q > 0.0 ? q : 0.5 * run.window * run.dt * speed;
    }
}

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    const training *t = user;
    run.machine = t->data.file.machine;
    LG_TRY(lg_machine_model_describe(&run, self->arguments[0], t->data.file.text, error));
    LG_TRY(lg_machine_find_scales(&run.machine, &t->data.training, error));
    run.scales = run.machine.scales;
    lg_machine_find_range(&run.machine, &t->data.training, &run.range);
    run.delay = t->data.logs.delay;
    run.dt = t->data.logs.dt_median;
    if (stored != NULL) {
        const lg_machine_model_run *before = stored;
        memcpy(run.position_scale, before->position_scale, sizeof run.position_scale);
        memcpy(run.velocity_scale, before->velocity_scale, sizeof run.velocity_scale);
    } else {
        choose_settings(self, t);
        set_loss_scales(t);
    }
    run.windows = lg_machine_windows(&run.machine, &t->data.training, run.window, run.stride,
                                     t->data.file.measured == LG_MEASURED_POSITIONS, NULL);
    return LG_OK;
}

/* Rows that no window has, where they are more than a hundredth and were not left out by --stride. */
static void warn_of_rows(const app *self, const training *t) {
    const size_t all = t->data.training.rows;
    size_t rows = 0, end = 0;
    for (size_t w = 0; w < run.windows; w++) {
        const size_t begin = t->start[w] > end ? t->start[w] : end;
        end = t->start[w] + run.window;
        rows += end - begin;
    }
    if (run.stride <= run.window && 100 * (all - rows) > all)
        app_warn(self,
                 "%zu of %zu rows are in no window of %u rows, and are not learned from: they lie in parts "
                 "without a gap that are shorter, or behind the last complete row; take a shorter --window",
                 all - rows, all, run.window);
}

static int prepare(void *user, app *self) {
    training *t = user;
    lg_error error = {LG_OK, ""};
    const lg_machine_log *log = &t->data.logs.log;
    const bool positions = t->data.file.measured == LG_MEASURED_POSITIONS;
    t->start = app_alloc(log->rows, sizeof *t->start);
    const size_t all = lg_machine_windows(&run.machine, log, run.window, run.stride, positions, t->start);
    t->problem = (lg_machine_problem){.machine = &run.machine,
                                      .scheme = run.scheme,
                                      .substeps = run.substeps,
                                      .window = run.window,
                                      .starts = run.starts,
                                      .log = *log,
                                      .windows = all,
                                      .start = t->start,
                                      .validation = all - run.windows};
    take_loss_scales(t);
    const lg_status status = lg_machine_problem_check(&t->problem, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", app_sentence(status, &error));
    warn_of_rows(self, t);
    return APP_EXIT_OK;
}

/* ---- the fit ---- */

static lg_status create(void *user, app *self, const lg_fit_options *how, lg_fit **fit, lg_error *error) {
    training *t = user;
    lg_rng rng;
    lg_fit_options chosen = *how;
    lg_machine_fit_problem(&t->problem, &t->fit_problem);
    double *theta = app_alloc(t->fit_problem.parameters, sizeof *theta);
    lg_rng_seed(&rng, run.training.seed, 1);
    lg_machine_initialise(&run.machine, &rng, theta);
    const double begin = app_seconds();
    const bool fresh = train_given_files.resume == NULL;
    lg_status status = fresh ? warm_up(self, t, how, theta, error) : LG_OK;
    lg_training_apply(&run.training, &chosen);
    if (t->problem.validation > 0) chosen.keep_best = true;
    if (how->seconds > 0) chosen.seconds = fmax(how->seconds - (app_seconds() - begin), 1e-3);
    if (status == LG_OK)
        status = lg_fit_create(self->context, &t->fit_problem, &chosen, theta, &t->fit, error);
    free(theta);
    *fit = t->fit;
    return status;
}

static void release(void *user) {
    training *t = user;
    lg_fit_destroy(t->fit);
    t->fit = NULL;
    free(t->start);
    t->start = NULL;
}

/* ---- result ---- */

static lg_status save(const app *self, const training *t, const double *theta, const double *spread,
                      lg_error *error) {
    lg_machine_model_file *file = app_alloc(1, sizeof *file);
    file->run = run;
    file->parameters = run.machine.parameters;
    file->provenance = app_provenance(self, run.training.seed);
    file->theta = (double *)(uintptr_t)theta; /* only read */
    file->spread = (double *)(uintptr_t)spread;
    const lg_status status =
        lg_model_save_machine_model(self->context, train_given_files.out, file, t->fit, error);
    free(file);
    return status;
}

/* ---- gauge ---- */

/* Mass, potential, damping and input map are known up to a common factor. */
static void warn_of_gauge(const app *self, const lg_machine *machine) {
    if (machine->normalised)
        app_warn(
            self,
            "nothing in the machine's file fixes the common factor of mass, potential, damping and "
            "input map: one mass, that without an error below, is set to 1; give a mass or the input map "
            "to fix it");
    if (machine->free_gauge && machine->grey.system == NULL)
        app_warn(self,
                 "nothing fixes the common factor of mass, potential, damping and input map: only their "
                 "ratios mean something; give the input map, or a mass that is known or constant");
}

/* {name: {value, error}} */
static void put_identified(app_json *json, const lg_identified *numbers, size_t count) {
    app_json_open(json, "identified", '{');
    for (size_t i = 0; i < count; i++) {
        app_json_open(json, numbers[i].name, '{');
        app_json_real(json, "value", numbers[i].value);
        app_json_real(json, "error", numbers[i].error);
        app_json_close(json, '}');
    }
    app_json_close(json, '}');
}

static const double strong = 0.9; /* correlations that are told */

/* {"a,b": r} */
static void put_correlations(app_json *json, const lg_identification *of, size_t count) {
    app_json_open(json, "correlations", '{');
    for (size_t i = 0; i < count; i++)
        for (size_t j = i + 1; j < count; j++) {
            char both[2 * LG_IDENTIFIED_NAME + 2];
            const double r = of->correlations[i * count + j];
            (void)snprintf(both, sizeof both, "%s,%s", of->numbers[i].name, of->numbers[j].name);
            if (fabs(r) > strong) app_json_real(json, both, r);
        }
    app_json_close(json, '}');
}

/* ---- where the mass of a network is told ---- */

/* Positions at which M of a network is told; `text` is "at x 1.2, theta 3.1", or empty where no mass is one.
 */
typedef struct mass_place {
    bool is;
    double positions[LG_MACHINE_POSITIONS];
    char text[256];
} mass_place;

/* A mass sees coordinate i. */
static bool is_seen(const lg_machine *machine, uint32_t i) {
    for (uint32_t t = 0; t < machine->term_count; t++)
        for (uint32_t k = 0; machine->terms[t].part == LG_MACHINE_MASS && k < machine->terms[t].of_count; k++)
            if (machine->terms[t].of[k].index == i) return true;
    return false;
}

static void find_mass_place(const training *t, mass_place *out) {
    const double *q = out->positions;
    size_t used = 0;
    *out = (mass_place){.is = false};
    out->is = lg_machine_mass_at(&t->problem, out->positions);
    for (uint32_t i = 0; i < run.machine.coordinate_count && out->is; i++) {
        const lg_machine_coordinate *each = &run.machine.coordinates[i];
        const uint32_t count = lg_coordinate_positions(each->kind);
        for (uint32_t k = 0; k < count && is_seen(&run.machine, i) && used < sizeof out->text; k++)
            used += (size_t)snprintf(out->text + used, sizeof out->text - used, "%s%s %.3g",
                                     k > 0      ? ","
                                     : used > 0 ? ", "
                                                : "at ",
                                     k > 0 ? "" : each->name, q[k]);
        q += count;
    }
}

/* "mass_at": {coordinate: its positions} */
static void put_mass_place(app_json *json, const mass_place *at) {
    const double *q = at->positions;
    if (!at->is) return;
    app_json_open(json, "mass_at", '{');
    for (uint32_t i = 0; i < run.machine.coordinate_count; i++) {
        const lg_machine_coordinate *each = &run.machine.coordinates[i];
        app_json_reals(json, each->name, q, lg_coordinate_positions(each->kind));
        q += lg_coordinate_positions(each->kind);
    }
    app_json_close(json, '}');
}

static bool is_mass(const char *number) {
    return strncmp(number, "mass.", strlen("mass.")) == 0;
}

static void show_identified(const lg_identified *numbers, size_t count, const mass_place *at) {
    app_table table;
    if (count == 0) return;
    if (at->is) (void)printf("mass: of a network, %s\n", at->text);
    app_table_begin(&table, 3);
    app_table_cell(&table, "identified");
    app_table_cell(&table, "value");
    app_table_cell(&table, "standard error");
    for (size_t i = 0; i < count; i++) {
        app_table_cell(&table, "%s", numbers[i].name);
        app_table_cell(&table, "%.6g", numbers[i].value);
        app_table_cell(&table, "%.2g", numbers[i].error);
    }
    app_table_end(&table, stdout);
}

/* The number of open directions in which several numbers move. */
static size_t open_together(const lg_identification *of, size_t count) {
    size_t several = 0;
    for (size_t k = 0; k < of->open_count; k++)
        several += lg_identification_sentence(of, count, k, NULL, 0) > 1;
    return several;
}

/* The first number of the first direction in which several move together, or just the first one. */
static const lg_identified *first_open(const lg_identification *of, size_t count) {
    for (size_t k = 0; k < of->open_count; k++)
        for (size_t i = 0; i < count; i++)
            if (of->open[k * count + i] != 0.0 && lg_identification_sentence(of, count, k, NULL, 0) > 1)
                return &of->numbers[i];
    return count > 0 ? &of->numbers[0] : NULL;
}

/* What fixes the common factor; where nothing does, the value at which learning left it. */
static void put_gauge(app_json *json, const lg_machine *machine, const lg_identification *of, size_t count) {
    const lg_identified *open = first_open(of, count);
    char text[160] = "the values given in the machine's file";
    if (machine->normalised)
        (void)snprintf(text, sizeof text, "one mass is 1 in the units of the logs");
    else if ((machine->free_gauge || open_together(of, count) > 0) && open == NULL)
        (void)snprintf(text, sizeof text, "nothing");
    else if (machine->free_gauge || open_together(of, count) > 0)
        (void)snprintf(text, sizeof text, "nothing: learning left %s at %.6g", open->name, open->value);
    app_json_text(json, "gauge", text);
}

/* What of the logs was explained, and how well. */
typedef struct explained {
    double loss, expected; /* `expected`: at most, of a model that explains the logs */
    double tolerated;      /* the same but for the error of the steps */
    double forces;         /* the loss of a model in which nothing acts, about */
    lg_machine_missing missing;
    mass_place mass;
} explained;

static void report(const training *t, const train_session *session, const explained *what,
                   const lg_identification *of, size_t count) {
    app_json json;
    const lg_fit *fit = t->fit;
    const uint64_t done = lg_fit_epochs_done(fit);
    const double validation = done > 0 ? lg_fit_history(fit, LG_FIT_VALIDATION)[done - 1] : (double)NAN;
    if (!session->app->json) {
        (void)printf("%s: %zu parameters, %llu windows, %llu evaluations, loss %.3e (noise and steps leave "
                     "%.1e at most), floor of the steps %.1e, %.1f s\n",
                     train_given_files.out, run.machine.parameters, (unsigned long long)run.windows,
                     (unsigned long long)done, what->loss, what->expected, session->floor, session->seconds);
        show_identified(of->numbers, count, &what->mass);
        return;
    }
    app_json_begin(&json);
    app_json_real(&json, "loss", what->loss);
    app_json_real(&json, "expected_loss", what->expected);
    app_json_real(&json, "validation", validation);
    app_json_size(&json, "windows", run.windows);
    app_json_size(&json, "parameters", run.machine.parameters);
    put_identified(&json, of->numbers, count);
    put_mass_place(&json, &what->mass);
    put_correlations(&json, of, count);
    put_gauge(&json, &run.machine, of, count);
    train_json(session, &json);
    app_json_end(&json);
}

/* Numbers of one kind have the same first word: "mass" of "mass.1.2", "I" of the label "I2". */
static bool are_alike(const char *a, const char *b) {
    size_t word = strcspn(a, ".");
    if (a[word] == '\0')
        while (word > 1 && strchr("0123456789", a[word - 1]) != NULL) word--;
    return strncmp(a, b, word) == 0 && strcspn(b, ".0123456789") <= word;
}

static double largest_alike(const lg_identified *numbers, size_t count, size_t i) {
    double largest = 0.0;
    for (size_t k = 0; k < count; k++)
        if (are_alike(numbers[i].name, numbers[k].name)) largest = fmax(largest, fabs(numbers[k].value));
    return largest;
}

/* Whether an open direction of several numbers moves number i, or one like it. */
static bool is_open(const lg_identification *of, size_t count, size_t i) {
    for (size_t k = 0; k < of->open_count; k++)
        for (size_t j = 0; j < count; j++)
            if (of->open[k * count + j] != 0.0 && are_alike(of->numbers[i].name, of->numbers[j].name) &&
                lg_identification_sentence(of, count, k, NULL, 0) > 1)
                return true;
    return false;
}

static void warn_of_open(const app *self, const lg_identification *of, size_t count) {
    char text[512];
    for (size_t k = 0; k < of->open_count; k++)
        if (lg_identification_sentence(of, count, k, text, sizeof text) > 1) app_warn(self, "%s", text);
}

/* A number that its error exceeds, unless both are next to nothing beside the others of its kind. */
static void warn_of_numbers(const app *self, const lg_identification *of, size_t count,
                            const mass_place *at) {
    static const double nothing = 0.02;
    const lg_identified *numbers = of->numbers;
    for (size_t i = 0; i < count; i++) {
        const double error = numbers[i].error;
        if (error <= fabs(numbers[i].value) || error < nothing * largest_alike(numbers, count, i)) continue;
        if (is_open(of, count, i)) continue;
        const bool told = at->is && is_mass(numbers[i].name);
        app_warn(self,
                 "the logs do not determine %s%s%s: %.3g with a standard error of %.2g; give it as "
                 "known, or move the machine in other ways",
                 numbers[i].name, told ? " " : "", told ? at->text : "", numbers[i].value, error);
    }
}

/* The loss of a model that explains the logs: what their noise leaves of each number, of numbers without
 * noise what .8 % of the forces would make, and what the steps make, unless that is more than all else. */
static lg_status find_expected(const app *self, const training *t, const double *theta, double floor,
                               explained *what, lg_error *error) {
    static const double small = 8e-3;
    lg_machine_noise noise;
    lg_machine_expected expected;
    identify_traces(&t->data, noise.position, noise.velocity);
    for (uint32_t i = 0; i < run.machine.coordinate_count; i++) {
        if (t->position_noise[i] > 0.0) noise.position[i] = t->position_noise[i];
        if (t->velocity_noise[i] > 0.0) noise.velocity[i] = t->velocity_noise[i];
    }
    LG_TRY(lg_machine_expect(self->context, &t->problem, theta, &noise, &expected, error));
    what->tolerated =
        isfinite(expected.loss) ? expected.loss : 0.0; /* a model that blows up excuses nothing */
    for (uint32_t i = 0; i < run.machine.coordinate_count; i++) {
        what->forces += expected.change.position[i] + expected.change.velocity[i];
        if (!(t->position_noise[i] > 0.0)) what->tolerated += small * small * expected.change.position[i];
        if (!(t->velocity_noise[i] > 0.0)) what->tolerated += small * small * expected.change.velocity[i];
    }
    what->expected = what->tolerated + fmin(floor, what->tolerated);
    return LG_OK;
}

/* Whether forces are missing, at least a ten thousandth of all: neither chance nor the error of the steps. */
static bool are_missing(const explained *what, double floor) {
    static const double chance = 8.0, least = 1e-4;
    const lg_machine_missing *missing = &what->missing;
    return missing->ratio > chance && missing->loss > fmax(floor, least * least * what->forces);
}

static void warn_of_misfit(const app *self, const explained *what, double floor) {
    /* The loss may exceed the expected one by half, and by four standard deviations of chance. */
    const double numbers = 2.0 * (double)run.windows * run.window * run.machine.velocities,
                 more = 1.5 + 4.0 * sqrt(2.0 / numbers);
    if (floor > what->tolerated)
        app_warn(
            self,
            "the steps are too long: their error makes %.2g of the loss, where the noise leaves %.2g; take "
            "more --substeps: only then the loss tells whether the model explains the logs",
            floor, what->tolerated);
    const bool large = what->loss > more * what->expected, missing = are_missing(what, floor);
    char size[128] = "", forces[256] = "";
    if (large)
        (void)snprintf(size, sizeof size,
                       "the loss is %.2g, where their noise and the steps leave %.2g at most", what->loss,
                       what->expected);
    if (missing)
        (void)snprintf(forces, sizeof forces,
                       "forces that it does not have, functions of positions, velocities and inputs that are "
                       "about %.2g %% of all forces, make %.2g of the loss of %.2g",
                       100.0 * sqrt(what->missing.loss / what->forces), what->missing.loss, what->loss);
    if (large || missing)
        app_warn(
            self,
            "the model does not explain the logs: %s%s%s; standard errors mean nothing then, the numbers "
            "are further off. More epochs, if the loss still falls; else a term is missing%s",
            size, large && missing ? "; " : "", forces,
            large ? ", or the logs contradict themselves: the sign or order of inputs, their delay, "
                    "sensors on two clocks"
                  : "");
}

static int finish(void *user, train_session *session) {
    training *t = user;
    const app *self = session->app;
    lg_error error = {LG_OK, ""};
    explained what = {.loss = 0.0};
    double *theta = app_alloc(t->fit_problem.parameters, sizeof *theta);
    lg_fit_parameters(t->fit, theta);
    lg_machine_wrap_biases(&run.machine, theta);
    lg_status status =
        lg_machine_loss(self->context, &t->problem, theta, &what.loss, &session->floor, &error);
    if (status == LG_OK && !isfinite(what.loss)) status = LG_NOT_FINITE;
    if (status == LG_OK) status = find_expected(self, t, theta, session->floor, &what, &error);
    if (status == LG_OK)
        status = lg_machine_find_missing(self->context, &t->problem, theta, &what.missing, &error);
    find_mass_place(t, &what.mass);
    int code = status == LG_OK ? APP_EXIT_OK : app_fail(self, status, "%s", app_sentence(status, &error));
    const size_t count = lg_machine_numbers(&run.machine, theta, 0, NULL), n = run.machine.parameters;
    lg_identification of = {.numbers = app_alloc(count + 1, sizeof *of.numbers),
                            .correlations = app_alloc(count * count + 1, sizeof *of.correlations),
                            .open = app_alloc(count * count + 1, sizeof *of.open),
                            .spread = n <= IDENTIFY_MOST_SPREAD ? app_alloc(n * n, sizeof *of.spread) : NULL};
    if (code == APP_EXIT_OK) {
        status = lg_machine_identify(self->context, &t->problem, theta, &of, &error);
        if (status != LG_OK) code = app_fail(self, status, "%s", app_sentence(status, &error));
        status = save(self, t, theta, status == LG_OK && count > 0 ? of.spread : NULL, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, train_given_files.out);
    }
    free(theta);
    if (code == APP_EXIT_OK) warn_of_gauge(self, &run.machine);
    if (code == APP_EXIT_OK) warn_of_misfit(self, &what, session->floor);
    if (code == APP_EXIT_OK) warn_of_open(self, &of, count);
    if (code == APP_EXIT_OK) warn_of_numbers(self, &of, count, &what.mass);
    if (code == APP_EXIT_OK) code = train_draw(session);
    if (code == APP_EXIT_OK) report(t, session, &what, &of, count);
    free(of.numbers);
    free(of.correlations);
    free(of.open);
    free(of.spread);
    return code;
}

/* ---- the command ---- */

static const train_task task = {.kind = &lg_recipe_machine_model,
                                .settings = settings,
                                .training = &run.training,
                                .prior = true,
                                .user = &state,
                                .read = read_data,
                                .describe = describe,
                                .prepare = prepare,
                                .create = create,
                                .release = release,
                                .finish = finish};

static int run_fit(app *self) {
    const int code = train_main(self, &task);
    identify_release(&state.data);
    return code;
}

const app_command fit_command = {
    .name = "fit",
    .arguments = "MACHINE.yaml LOG...",
    .summary = "Learn the machine from logs",
    .details =
        "Windows of --window rows are predicted from their first row. The loss is the mean over windows and "
        "rows of squared errors in units of the noise; without noise, of the velocities' root mean squares "
        "and of half the way in a window. Short windows are fitted first.\n\nMethod, epochs, prior, window, "
        "stride, starts and substeps that are not given are chosen by the logs and the machine, whatever the "
        "defaults above: docs/machines.md has the table, --json the values of a run.",
    .settings = settings,
    .run = run_fit,
    .together = APP_RANKS};
