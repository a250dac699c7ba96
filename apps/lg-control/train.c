/* lg-control train: learns a policy. */
#include <math.h>

#include "common/train.h"
#include "lg-control/control_app.h"

typedef struct train_values {
    const char *out, *resume;
    double seconds;
    uint64_t seeds, starts, race, finish, polish, robustness, optimality_gap;
} train_values;

static const lg_field options[] = {
    APP_OUT(train_values, "FILE.h5", "Write the policy", .file = LG_FILE_WRITTEN, .kind = "policy",
            .required = true),
    APP_RESUME(train_values, "Continue from the state that a stopped training left"),
    APP_BOUND(train_values, "Shorten the phases to this time", .otherwise = "no bound"),
    LG_OPTION(train_values, seeds, U64, "n", "Seeds in the race", .low = 1, .high = 1000, .value = "8"),
    LG_OPTION(train_values, starts, U64, "B", "Starts of a step of Adam, a multiple of 64", .option = "batch",
              .low = 64, .high = 65536, .value = "64"),
    LG_OPTION(train_values, race, U64, "n", "Steps of Adam of each seed", .low = 1, .high = 1e6,
              .value = "450"),
    LG_OPTION(train_values, finish, U64, "n", "Steps of Adam of the winner", .high = 1e6, .value = "1000"),
    LG_OPTION(train_values, polish, U64, "n", "Steps of L-BFGS of the winner", .high = 1e6, .value = "100"),
    LG_OPTION(train_values, robustness, U64, "n",
              "Starts of each test with a number of the plant off by 10 and 20 %; 0: no test", .high = 1e6,
              .value = "100"),
    LG_OPTION(train_values, optimality_gap, U64, "n",
              "Starts whose cost is compared with the best inputs that a search finds; 0: none", .high = 100,
              .value = "8"),
    LG_FIELD_END};

static train_values values;
static app_progress progress;

static void show(void *user, const lg_policy_progress *now) {
    app_progress_show(&progress, now->step, "success %.3f, cost %.4g", now->success, now->cost);
}

static lg_policy_train_options read_options(const app *self) {
    lg_policy_train_options o;
    lg_policy_train_options_init(&o);
    if (values.starts % o.starts != 0) app_stop_usage(self, "--batch: expected a multiple of %u", o.starts);
    o.seeds = (uint32_t)values.seeds, o.starts = (uint32_t)values.starts;
    o.race = values.race, o.finish = values.finish, o.polish = values.polish;
    o.seconds = values.seconds, o.seed = self->seed, o.threads = (int)self->threads;
    o.progress = show, o.ranks = self->ranks;
    return o;
}

static void save_state(const app *self, const lg_policy_trainer *trainer) {
    APP_FREE char *path = app_format("%s.checkpoint", values.out);
    lg_file_writer *writer = NULL;
    lg_archive_writer archive;
    const lg_provenance provenance = app_provenance(self, self->seed);
    APP_FILE(self, path, lg_file_writer_create, "policy-checkpoint", &provenance, &writer);
    APP_MUST_FILE(self, path, lg_file_writer_archive(writer, "training", &archive));
    APP_MUST_FILE(self, path, lg_policy_trainer_save(trainer, &archive, &error));
    APP_MUST_FILE(self, path, lg_file_writer_commit(writer, &error));
    lg_file_writer_destroy(writer);
    app_note(self, "stopped; the best policy so far is in %s; continue with --resume %s", values.out, path);
}

static void load_state(const app *self, lg_policy_trainer *trainer) {
    lg_file_reader *reader = NULL;
    lg_archive_reader archive;
    const char *path = values.resume;
    APP_FILE(self, path, lg_file_reader_create, "policy-checkpoint", NULL, &reader);
    APP_MUST_FILE(self, path, lg_file_reader_archive(reader, "training", &archive));
    APP_MUST_FILE(self, path, lg_policy_trainer_load(trainer, &archive, &error));
    lg_file_reader_destroy(reader);
}

/* ---- the command ---- */

lg_policy_outcome control_evaluate(const app *self, const lg_policy *policy, lg_policy_test mode,
                                   uint64_t starts, uint64_t seed, lg_policy_runs *runs) {
    lg_policy_outcome out;
    APP_MUST(self, lg_policy_evaluate(policy, mode, starts, seed, (int)self->threads, &out, runs, &error));
    return out;
}

static void put_success(app_json *out, const lg_policy_outcome *o) {
    const double interval[] = {o->success_low, o->success_high};
    APP_PUT(out, LG_REAL("success", (double)o->succeeded / (double)o->starts, "share of the starts"),
            LG_REALS("success_interval", interval, 2, "95 %"));
}

void control_tell_outcome(app_json *out, const char *key, const char *heading, const lg_policy_outcome *o) {
    if (heading != NULL) app_result_line(out, "%s:", heading);
    if (key != NULL) app_json_open(out, key, '{');
    APP_PUT(out, LG_WHOLE("starts", o->starts, NULL), LG_WHOLE("succeeded", o->succeeded, NULL));
    put_success(out, o);
    APP_PUT(out, LG_REAL("cost_mean", o->cost_mean, NULL), LG_REAL("cost_median", o->cost_median, NULL),
            LG_REAL("saturated", o->saturated, "share of the periods with an input at a limit"));
    if (key != NULL) app_json_close(out, '}');
}

static void warn_of_failures(const app *self, const lg_policy *policy, const lg_policy_outcome *held,
                             const lg_policy_train_result *result) {
    static const double enough = 0.95, cut = 0.9;
    const lg_policy_task *task = lg_policy_task_of(policy);
    const bool trained = lg_policy_parameters(policy) > 0,
               short_of_time = values.seconds > 0 && result->seconds > cut * values.seconds;
    const char *advice =
        "take nearer starts, a controller of kind network or, where friction sticks, the keys "
        "integral and compensate";
    if (trained) advice = "try another --seed, a wider network, a longer horizon, more steps (--finish)";
    if (trained && short_of_time) advice = "--seconds cut the training short: allow more";
    if (held->succeeded >= enough * (double)held->starts) return;
    app_warn(self, "only %.3g %% of the starts succeed; %s",
             100.0 * (double)held->succeeded / (double)held->starts, advice);
    if (trained && task->substeps > 2)
        app_warn(self,
                 "the machine needs %u integrator steps in a period, so training is as many times slower; "
                 "a short lag or a steep force is a common cause",
                 task->substeps);
}

/* The costs of single starts over those of the best inputs that a search finds. */
static void report_gap(const app *self, lg_policy *policy, uint64_t seed, double seconds, app_json *out) {
    const size_t starts = values.optimality_gap;
    static const double much = 1.5;
    bool complete = true;
    APP_FREE lg_policy_gap *gap = app_alloc(starts + 1, sizeof *gap);
    APP_FREE double *ratio = app_alloc(starts + 1, sizeof *ratio);
    if (starts > 0)
        APP_MUST(self, lg_policy_find_gaps(policy, starts, seed, seconds, gap, &complete, &error));
    size_t worst = 0;
    for (size_t i = 0; i < starts; i++) {
        ratio[i] = gap[i].ratio;
        if (ratio[i] > ratio[worst]) worst = i;
    }
    const double largest = starts > 0 ? ratio[worst] : 0.0, median = lg_median(ratio, starts);
    if (starts > 0)
        app_result_line(
            out, "cost from %zu starts over the cost of the best inputs found: median %.3g, largest %.3g",
            starts, median, largest);
    app_result_rows(out, "optimality_gap");
    for (size_t i = 0; i < starts; i++)
        APP_OBJECT(out, NULL, LG_AS_WHOLE("start", i), LG_AS_REAL("cost", gap[i].cost),
                   LG_AS_REAL("best", gap[i].best), LG_AS_REAL("ratio", gap[i].ratio),
                   LG_AS_REALS("errors", gap[i].errors, lg_policy_regulator_of(policy)->errors));
    app_result_rows_end(out);
    if (!complete)
        app_warn(self, "the search for better inputs was short of time, so the optimality gap may be larger");
    if (largest > much)
        app_warn(self,
                 "from start %zu the controller costs %.3g times as much as the best inputs found; try "
                 "another --seed, a wider network or more steps (--finish)",
                 worst, largest);
}

/* Success is that on the plant as its file says, with fine steps of the integrator. */
static void report(const app *self, const lg_policy *trained, control_machine *machine,
                   const lg_policy_train_result *result) {
    lg_policy_outcome rough;
    lg_policy *policy = NULL;
    const uint64_t seed = self->seed ^ UINT64_C(0x9e3779b97f4a7c15);
    APP_MUST(self, lg_policy_transplant(trained, NULL, NULL, &policy, &error));
    const lg_policy_outcome held = control_evaluate(self, policy, LG_POLICY_NOMINAL, 500, seed, NULL),
                            regulator = control_evaluate(self, policy, LG_POLICY_REGULATED, 500, seed, NULL);
    const bool disturbed = lg_policy_is_disturbed(lg_policy_task_of(policy));
    if (disturbed) rough = control_evaluate(self, trained, LG_POLICY_DISTURBED, 512, seed, NULL);
    warn_of_failures(self, trained, &held, result);
    app_json *out = self->out;
    app_result_real(out, "cost", held.cost_mean, "mean over 500 held-out starts");
    put_success(out, &held);
    app_result_real(out, "regulator_success", (double)regulator.succeeded / (double)regulator.starts,
                    "share, the saturated regulator alone");
    if (disturbed) control_tell_outcome(out, "disturbed", "with the disturbances of the task", &rough);
    APP_PUT(out, LG_WHOLE("parameters", lg_policy_parameters(policy), NULL),
            LG_WHOLE("substeps", lg_policy_task_of(trained)->substeps, "of the integrator in a period"),
            LG_REAL("seconds", result->seconds, NULL), LG_WHOLE("seed", self->seed, NULL),
            LG_WHOLE("winner", result->seed, "of the race"), LG_TEXT("out", values.out, NULL));
    report_gap(self, policy, seed,
               values.seconds > 0 ? 0.2 * values.seconds : fmax(10, 0.2 * result->seconds), out);
    control_tell_robustness(policy, machine, values.robustness, out);
    lg_policy_destroy(policy);
}

static void warn(const app *self, const lg_policy *policy) {
    const lg_policy_regulator *r = lg_policy_regulator_of(policy);
    if (r->residual > 1e-9)
        app_warn(self, "at the goal the machine drifts by %.1e of the starts' size in a period", r->residual);
}

/* Called by rank 0 after the training. */
static void store(const app *self, const lg_policy *policy, const lg_policy_trainer *trainer,
                  control_machine *machine, const char *text, const lg_policy_train_result *result,
                  bool stopped) {
    const lg_provenance provenance = app_provenance(self, self->seed);
    APP_FILE(self, values.out, lg_policy_save, policy, text, &provenance);
    if (stopped)
        save_state(self, trainer);
    else
        report(self, policy, machine, result);
}

/* --resume and --checkpoint may name the same file. */
static void check_checkpoint(app *self) {
    APP_FREE char *path = app_format("%s.checkpoint", values.out);
    const bool same = values.resume != NULL && app_same_file(values.resume, path);
    self->continues = same;
    const app_path paths[] = {{"resume", same ? NULL : values.resume, LG_FILE_READ, NULL},
                              {"checkpoint", path, LG_FILE_WRITTEN, "policy-checkpoint"}};
    app_check_outputs(self, paths, LG_COUNT(paths));
}

static void run(app *self) {
    lg_policy_task task;
    lg_policy *policy = NULL;
    lg_policy_trainer *trainer = NULL;
    lg_policy_train_result result;
    APP_FREE char *text = NULL, *source = NULL;
    APP_CLEAN(control_machine_destroy) control_machine machine = {.scheme = NULL};
    const lg_policy_train_options settings = read_options(self);
    check_checkpoint(self);
    lg_program *plant = control_read_task(self, self->arguments[0], &task, &text, &source, &machine);
    APP_DO(self, lg_policy_create, &task, plant, self->seed, &policy);
    warn(self, policy);
    control_add_draws(self, policy, source);
    APP_MUST(self, lg_policy_trainer_create(policy, &settings, &trainer, &error));
    if (values.resume != NULL) load_state(self, trainer);
    app_progress_begin(&progress, 0, settings.race + settings.finish + settings.polish);
    lg_error why = {LG_OK, ""};
    const lg_status status = lg_policy_trainer_run(trainer, &result, &why);
    app_progress_end(&progress);
    if (status != LG_CANCELLED) app_must(self, status, &why);
    app_end_exchanges(self);
    if (self->rank == 0) store(self, policy, trainer, &machine, text, &result, status == LG_CANCELLED);
    lg_policy_trainer_destroy(trainer);
    lg_policy_destroy(policy);
    if (status == LG_CANCELLED) self->code = APP_EXIT_INTERRUPTED;
}

const app_command control_train_command = {
    .name = "train",
    .arguments = "TASK.yaml",
    .summary = "Learn a policy through the machine",
    .details =
        "TASK.yaml has plant, goal, period, horizon, starts, limits, cost, success and controller. Several "
        "seeds race; the best by success, then by cost, is trained on. Ctrl-C saves the best policy so far "
        "and the state, from which --resume continues with the same numbers. Processes of mpirun train "
        "together, with the numbers of one process.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run,
    .together = APP_RANKS};
