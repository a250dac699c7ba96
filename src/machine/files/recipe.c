/* The recipe of machines: how a machine is learned from its logs. */
#include "machine/files/choice.h"

#include <math.h>
#include <string.h>

enum { STREAM_WEIGHTS = 1, SHORTEST_LOG = 3 };

/* ---- the data ---- */

/* Paths are MACHINE.yaml LOG...; when a model file is given, which contains its machine, they are LOG...
 * alone. */
static lg_status read_data(lg_training *self, lg_error *error) {
    lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    const bool model = self->file != NULL;
    const size_t first = model ? 0 : 1;
    if (self->path_count <= first)
        return lg_fail(error, LG_INVALID_ARGUMENT, "--recipe machine_model: needs MACHINE.yaml LOG...");
    const lg_machine_sources from = {.machine = model ? self->model : self->paths[0],
                                     .text = model ? run->text : NULL,
                                     .logs = self->paths + first,
                                     .count = self->path_count - first,
                                     .validation = s->validation,
                                     .delay = model ? (int64_t)run->estimated : -1};
    const lg_status status = lg_machine_data_read(self->context, &from, &s->data, error);
    self->failed = s->data.failed;
    if (status != LG_OK) return status;
    lg_machine_look(s);
    if (!model) LG_TRY(lg_machine_choose_inputs(self, error));
    if (!model && s->suggest != NULL) LG_TRY(lg_machine_suggest(self, error));
    if (!model) LG_TRY(lg_machine_select(self, error));
    lg_machine_log_sha256(&s->data.file.machine, &s->data.logs.log, self->sha256);
    return LG_OK;
}

static void close_data(lg_training *self) {
    lg_machine_select_close(self);
    lg_machine_data_destroy(&lg_machine_state_of(self)->data);
}

/* ---- the run ---- */

/* Rows of the longest part. */
size_t lg_log_longest_part(const lg_machine_log *log) {
    size_t longest = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        if (p.end - p.first > longest) longest = p.end - p.first;
    return longest;
}

/* The longest window of at most `wanted` rows with which three quarters of the rows are in parts that have
 * one: gaps leave short parts. */
static uint32_t window_of_parts(const lg_machine_log *log, uint32_t wanted) {
    enum { SHORT = 8 };
    const size_t longest = lg_log_longest_part(log);
    for (uint32_t window = longest >= 2 && longest < wanted ? (uint32_t)longest : wanted;;
         window -= (window + 3) / 4) {
        size_t covered = 0;
        for (lg_log_part p = {0}; lg_log_next(log, &p);) {
            const size_t rows = p.end - p.first;
            if (rows >= window) covered += rows;
        }
        if (4 * covered >= 3 * log->rows || window <= SHORT) return window;
    }
}

/* Root mean square of what straight lines leave of position number `k`, over pieces of `rows` rows. */
static double bend(const lg_machine *machine, const lg_machine_log *log, uint32_t k, size_t rows) {
    double squares = 0;
    size_t all = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t first = p.first; first + rows <= p.end; first += rows) {
            double n = 0, t = 0, x = 0, tt = 0, tx = 0, xx = 0;
            const double origin = log->q[first * machine->positions + k];
            for (size_t row = first; row < first + rows; row++) {
                const double y = log->q[row * machine->positions + k] - origin,
                             s = log->t[row] - log->t[first];
                if (isnan(y)) continue;
                n++, t += s, x += y, tt += s * s, tx += s * y, xx += y * y;
            }
            const double a = n * tt - t * t, b = n * tx - t * x, c = n * xx - x * x;
            if (n > 2) squares += (c - b * b / a) / n, all += (size_t)n;
        }
    return all > 0 ? sqrt(fmax(squares, 0) / (double)all) : INFINITY;
}

/* The shortest windows, of `least` rows or more, in which the motion of every line and angle bends by several
 * times its noise: in shorter ones the estimated starts explain everything. */
static uint32_t window_of_noise(const lg_machine_model_run *run, const lg_machine_state *s, uint32_t least) {
    enum { MOST = 600 };
    static const double several = 4;
    const lg_machine *machine = &run->machine;
    uint32_t window = least;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const double enough = several * s->noise.position[at.index];
        while (at.positions == 1 && window < MOST &&
               bend(machine, &s->data.training, at.position, window) < enough)
            window += window / 2;
    }
    return window < MOST ? window : MOST;
}

static size_t count_windows(const lg_machine_model_run *run, const lg_machine_state *s, uint32_t stride) {
    return lg_machine_windows(&run->machine, &s->data.training, run->window, stride, s->positions, NULL);
}

/* Neighbouring windows share one row. Measured starts: the stride is halved while there are fewer than 2000
 * windows. */
static uint32_t find_stride(const lg_machine_model_run *run, const lg_machine_state *s) {
    enum { ENOUGH = 2000 };
    uint32_t stride = run->window - 1;
    if (run->starts == LG_MACHINE_STARTS_ESTIMATED) return stride;
    while (stride > 1 && count_windows(run, s, stride) < ENOUGH) stride /= 2;
    return stride;
}

/* Approximate number of the fit's parameters, including those of the starts. */
static size_t count_parameters(const lg_machine_model_run *run, const lg_machine_state *s) {
    const lg_machine *machine = &run->machine;
    const size_t windows =
        lg_machine_windows(machine, &s->data.training, run->window, run->stride, true, NULL);
    const size_t starts = run->starts == LG_MACHINE_STARTS_ESTIMATED ? windows : 0;
    return machine->parameters + starts * (machine->positions + machine->velocities);
}

/* Chooses the settings that are not given. docs/reports/accuracy.md has the measurements behind these
 * choices. */
static void choose_settings(const lg_training *self) {
    enum { DENSE = 4000 };
    static const double prior = 0.3;
    const lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    const bool positions = s->positions, noisy = s->noisy || s->estimated;
    if (!self->given(self, "initial-states"))
        run->starts = noisy ? LG_MACHINE_STARTS_ESTIMATED : LG_MACHINE_STARTS_MEASURED;
    if (!self->given(self, "window")) {
        const uint32_t wanted = positions                    ? window_of_noise(run, s, 60)
                                : run->machine.accelerations ? (uint32_t)lg_start_rows(&run->machine)
                                : noisy                      ? 20
                                                             : 5;
        run->window = window_of_parts(&s->data.training, wanted);
    }
    if (!self->given(self, "substeps")) run->substeps = 1;
    if (!self->given(self, "hop") || run->stride == 0) run->stride = find_stride(run, s);
    const bool lm = lg_machine_is_small(&run->machine), dense = count_parameters(run, s) <= DENSE;
    if (!self->given(self, "optimizer"))
        (void)lg_fit_plan_parse(lm ? "lm" : dense ? "ssbroyden" : "lbfgs", true, &run->training.plan, NULL);
    const lg_fit_plan *plan = &run->training.plan;
    const bool lm_last = plan->phases > 0 && plan->phase[plan->phases - 1].method == LG_FIT_LM;
    if (!self->given(self, "prior")) run->training.prior = lm_last ? 0.0 : prior;
    if (!self->given(self, "epochs")) run->training.epochs = lm ? 100 : 3000;
}

/* Sets the scales of the loss: the noise of each coordinate; without noise the root mean square of its
 * velocities, and for positions half the distance that this velocity covers in a window. */
static void set_loss_scales(lg_machine_model_run *run, const lg_machine_state *s) {
    const lg_machine *machine = &run->machine;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const double moves = lg_log_speed(machine, &s->data.training, i);
        const double speed = moves > 0.0 ? moves : run->scales.velocity[0] / run->scales.time;
        const double v = s->noise.velocity[i], q = s->noise.position[i];
        run->velocity_scale[i] = v > 0.0 ? v : speed;
        run->position_scale[i] = q > 0.0 ? q : 0.5 * run->window * run->dt * speed;
        /* Positions that are only integrals of the velocities have no weight. */
        if (s->data.file.measured == LG_MEASURED_VELOCITIES_ONLY) run->position_scale[i] *= 1e6;
    }
}

static lg_status check_data(const lg_training *self, lg_error *error) {
    const lg_machine_data *data = &lg_machine_state_of(self)->data;
    const size_t longest = lg_log_longest_part(&data->training);
    LG_TRY(lg_machine_refuse_momenta(&data->file, self->paths[0], error));
    if (longest >= SHORTEST_LOG) return LG_OK;
    return lg_fail(
        error, LG_FORMAT,
        "%s: the longest part without a gap has %zu rows; at least %d are needed to estimate accelerations",
        data->paths[0], longest, SHORTEST_LOG);
}

/* Differences of noisy positions would make time scales far too short: they are smoothed first. */
static lg_status find_scales(lg_training *self, lg_error *error) {
    enum { PART = 8 };
    const lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    LG_CLEAN(lg_started_log_destroy) lg_started_log smooth = {.log = s->data.training};
    if (s->positions && s->noisy)
        LG_TRY(lg_machine_smooth(self->context, &run->machine, &s->data.training,
                                 window_of_noise(run, s, 60) / PART, 3, &smooth, error));
    return lg_machine_find_scales(&run->machine, &smooth.log, error);
}

/* The delays of the inputs as they were applied (lg_machine_model_run). */
static void find_delays(const lg_machine_state *s, lg_machine_model_run *run) {
    bool any = false;
    memcpy(run->delay, s->data.logs.delay, sizeof run->delay);
    run->estimated = 0;
    for (uint32_t i = 0; i < run->machine.input_count && !any; i++) {
        any = s->data.file.inputs[i].estimate_delay;
        if (any || run->delay[i] > run->estimated) run->estimated = run->delay[i];
    }
}

static lg_status describe(lg_training *self, lg_error *error) {
    const lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    LG_TRY(check_data(self, error));
    memcpy(run->data_sha256, self->sha256, sizeof run->data_sha256);
    run->machine = s->data.file.machine;
    LG_TRY(lg_machine_model_describe(run, self->paths[0], s->data.file.text, error));
    LG_TRY(find_scales(self, error));
    run->scales = run->machine.scales;
    lg_machine_find_range(&run->machine, &s->data.training, &run->range);
    find_delays(s, run);
    run->dt = s->data.logs.dt_median;
    if (self->stored != NULL) {
        const lg_machine_model_run *before = self->stored;
        memcpy(run->position_scale, before->position_scale, sizeof run->position_scale);
        memcpy(run->velocity_scale, before->velocity_scale, sizeof run->velocity_scale);
        run->residual = before->residual;
    } else {
        choose_settings(self);
        set_loss_scales(run, s);
    }
    run->windows = count_windows(run, s, run->stride);
    if (run->machine.accelerations && run->starts != LG_MACHINE_STARTS_ESTIMATED)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "--initial-states measured: logs of accelerations alone do not have the states at which windows "
            "start: leave the option out");
    return LG_OK;
}

/* ---- the problem ---- */

/* Warns if more than a hundredth of the rows is in no window, unless --hop, longer than a window, leaves
 * them out. */
static void warn_of_rows(const lg_training *self) {
    const lg_machine_model_run *run = self->run;
    const lg_machine_state *s = self->state;
    const size_t all = s->data.training.rows, *start = s->problem.start;
    size_t rows = 0, end = 0;
    for (size_t w = 0; w < run->windows; w++) {
        const size_t begin = start[w] > end ? start[w] : end;
        end = start[w] + run->window;
        rows += end - begin;
    }
    if (run->stride <= run->window && 100 * (all - rows) > all)
        LG_WARN(self,
                "%zu of %zu rows are in no window of %u rows and are not used: their part without a gap is "
                "shorter than a window, or they come after its last complete row; give a shorter --window",
                all - rows, all, run->window);
}

/* Removes windows of training with rows that are held out, and then as many as are too many, evenly. Returns
 * the number of all windows that are left. */
static size_t leave_out(lg_machine_model_run *run, const lg_machine_state *s, size_t *start, size_t all) {
    size_t kept = 0, taken = 0;
    for (size_t w = 0; w < run->windows; w++)
        if (!lg_held_out_has(s->held, start[w], run->window)) start[kept++] = start[w];
    const size_t most = s->most_windows > 0 && s->most_windows < kept ? s->most_windows : kept;
    for (size_t w = 0; w < kept; w++)
        if (lg_spread(w, most, kept) >= taken) start[taken++] = start[w];
    memmove(start + taken, start + run->windows, (all - run->windows) * sizeof *start);
    all -= run->windows - taken;
    run->windows = taken;
    return all;
}

static lg_status prepare(lg_training *self, lg_error *error) {
    lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    const lg_machine_log *log = &s->data.logs.log;
    size_t *start;
    LG_TRAINING_ARRAY(self, start, log->rows, error);
    size_t all = lg_machine_windows(&run->machine, log, run->window, run->stride, s->positions, start);
    if (s->held != NULL) all = leave_out(run, s, start, all);
    s->problem = (lg_machine_problem){.machine = &run->machine,
                                      .scheme = run->scheme,
                                      .substeps = run->substeps,
                                      .window = run->window,
                                      .starts = run->starts,
                                      .log = *log,
                                      .windows = all,
                                      .start = start,
                                      .validation = all - run->windows};
    s->problem.residual = run->residual;
    memcpy(s->problem.position_scale, run->position_scale, sizeof run->position_scale);
    memcpy(s->problem.velocity_scale, run->velocity_scale, sizeof run->velocity_scale);
    LG_TRY(lg_machine_problem_check(&s->problem, error));
    if (s->held == NULL) warn_of_rows(self);
    return LG_OK;
}

/* Sets the deviation of the residuals, which weighs priors: 1 in units of the noise; without noise what the
 * parameters from short windows leave. */
static lg_status weigh_priors(lg_training *self, const double *theta, lg_error *error) {
    static const double silent = 1e-100;
    lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    const double positions = run->machine.accelerations ? 0.0 : run->machine.positions,
                 numbers = positions + (s->positions ? 0.0 : run->machine.velocities);
    double loss = 0;
    lg_machine_problem problem = s->problem;
    problem.residual = silent;
    if (!s->noisy) LG_TRY(lg_machine_loss(self->context, &problem, theta, &loss, NULL, error));
    run->residual = s->problem.residual = s->noisy ? 1.0 : fmax(sqrt(loss / numbers), 1e-12);
    return LG_OK;
}

static lg_status make_problem(lg_training *self, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    const lg_machine_problem *problem = &lg_machine_state_of(self)->problem;
    lg_fit_options *options = &self->options;
    const double begin = lg_seconds();
    double *initial;
    lg_rng rng;
    lg_machine_fit_problem(problem, &self->problem);
    LG_TRAINING_ARRAY(self, self->theta, self->problem.parameters, error);
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    lg_machine_initialise(&run->machine, &rng, self->theta);
    const struct lg_machine_warm *warm = lg_machine_state_of(self)->warm;
    LG_TRAINING_ARRAY(self, initial, run->machine.parameters + 1, error);
    memcpy(initial, self->theta, run->machine.parameters * sizeof *initial);
    if (warm != NULL) lg_machine_carry(&warm->machine, warm->theta, &run->machine, self->theta);
    lg_machine_revive(&run->machine, initial, self->theta);
    LG_TRY(lg_machine_check_room(self, error));
    if (self->stored == NULL) LG_TRY(lg_machine_warm_up(self, self->theta, error));
    lg_machine_revive(&run->machine, initial, self->theta);
    /* The warm-up chose the substeps. */
    if (run->substeps > 1) LG_TRY(lg_machine_check_room(self, error));
    if (self->stored == NULL) LG_TRY(weigh_priors(self, self->theta, error));
    LG_TRY(lg_machine_select_begin(self, error));
    if (problem->validation > 0) options->keep_best = true;
    if (options->seconds > 0) options->seconds = fmax(options->seconds - (lg_seconds() - begin), 1e-3);
    return LG_OK;
}

/* ---- results ---- */

static lg_status save(lg_training *self, void *into, lg_error *error) {
    const lg_machine_verdict *verdict = &lg_machine_state_of(self)->verdict;
    ((lg_machine_model_file *)into)->spread = verdict->count > 0 ? verdict->identified.spread : NULL;
    return LG_OK;
}

/* Reports the loss over windows, and errors of free runs of one second. */
static lg_status evaluate(lg_training *self, const void *from, lg_error *error) {
    enum { EVERY = 25 };
    const lg_machine_model_file *file = from;
    const lg_machine_state *s = self->state;
    const lg_machine_model_run *run = &file->run;
    const lg_machine_log *log = &s->data.logs.log;
    const lg_learned_machine model = lg_model_learned(self->context, run, file->theta, s->estimated);
    double loss;
    lg_horizon found;
    LG_TRY(lg_machine_refuse_momenta(&s->data.file, self->model, error));
    LG_TRY(lg_machine_window_loss(&model, log, run->window, &loss, error));
    LG_TRY(lg_horizon_of(&model, lg_machine_run, &model, log, 1.0, EVERY, &found, error));
    LG_TELL(self, LG_REAL("window_loss", loss, "mean over windows and rows, in the units of the logs"),
            LG_REAL("horizon", found.seconds, "s of free runs; the root mean squares of their errors:"));
    for (int e = 0; e < LG_RUN_ERRORS; e++)
        if (!isnan(found.pooled[e])) LG_TELL(self, LG_REAL(lg_run_error_names[e], found.pooled[e], NULL));
    return LG_OK;
}

const lg_trainer lg_machine_model_learner = {.data = "MACHINE.yaml LOG...",
                                             .state_size = sizeof(lg_machine_state),
                                             .held_out = "validation-fraction",
                                             .read = read_data,
                                             .describe = describe,
                                             .prepare = prepare,
                                             .problem = make_problem,
                                             .judge = lg_machine_judge,
                                             .save = save,
                                             .evaluate = evaluate,
                                             .close = close_data};
