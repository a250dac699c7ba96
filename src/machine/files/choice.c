/* Learns candidates and judges them. */
#include "machine/files/choice.h"

#include <math.h>
#include <string.h>

/* ---- what trials share ---- */

lg_status lg_choosing_begin(lg_choosing *out, const lg_training *self, double part, size_t windows,
                            size_t most, lg_error *error) {
    const lg_machine_state *s = self->state;
    *out = (lg_choosing){.self = self, .most_windows = most};
    if (lg_context_quiet(self->context, &out->quiet) != LG_OK) return lg_no_memory(error);
    return lg_held_out_plan(self->context, &s->data.file.machine, &s->data.training, part, windows,
                            s->estimated || s->noisy, &out->held, error);
}

void lg_choosing_end(lg_choosing *choosing) {
    for (size_t i = 0; i < choosing->count; i++) lg_machine_trial_destroy(choosing, &choosing->trials[i]);
    lg_free(choosing->quiet, choosing->trials);
    lg_held_out_destroy(&choosing->held);
    lg_context_destroy(choosing->quiet);
    *choosing = (lg_choosing){.self = NULL};
}

/* ---- parameters of another machine ---- */

static bool are_same(const lg_machine_term *a, const lg_machine_term *b) {
    return a->kind == b->kind && a->parameters == b->parameters && a->of_count == b->of_count &&
           memcmp(a->of, b->of, a->of_count * sizeof *a->of) == 0;
}

void lg_machine_carry(const lg_machine *from, const double *theta, const lg_machine *to, double *out) {
    bool taken[LG_MACHINE_TERMS] = {false};
    for (uint32_t i = 0; i < to->term_count; i++)
        for (uint32_t j = 0; j < from->term_count; j++) {
            const lg_machine_term *a = &from->terms[j], *b = &to->terms[i];
            if (taken[j] || !are_same(a, b)) continue;
            taken[j] = true;
            memcpy(out + b->offset, theta + a->offset, a->parameters * sizeof *theta);
            break;
        }
}

/* ---- trials ---- */

/* A trial keeps the options that say how windows are predicted; the method and its epochs are its own. */
static bool is_given(const lg_training *self, const char *option) {
    static const char *const kept[] = {"window", "hop", "initial-states", "substeps", "scheme"};
    const lg_training *whole = self->user;
    for (size_t i = 0; i < LG_COUNT(kept); i++)
        if (strcmp(option, kept[i]) == 0) return whole->given(whole, option);
    return false;
}

/* The training of one candidate machine. */
typedef struct trial_training {
    lg_training training;
    lg_machine_model_run run;
    lg_machine_state state;
    lg_held_out held;
} trial_training;

/* Reads the machine from `text`, and the logs as it says. `trial`: without validation logs. */
static lg_status read_again(const lg_context *context, const lg_training *whole, const char *text, bool trial,
                            lg_machine_data *out, lg_error *error) {
    const lg_machine_state *s = whole->state;
    const lg_machine_sources from = {.machine = whole->paths[0],
                                     .text = text,
                                     .logs = whole->paths + 1,
                                     .count = whole->path_count - 1,
                                     .validation = trial ? NULL : s->validation,
                                     .delay = -1,
                                     .quiet = true};
    return lg_machine_data_read(context, &from, out, error);
}

static lg_status read_trial(const lg_choosing *c, const char *text, trial_training *t, lg_error *error) {
    const lg_machine_state *all = c->self->state;
    LG_TRY(read_again(c->quiet, c->self, text, true, &t->state.data, error));
    lg_machine_look(&t->state);
    t->state.held = &t->held;
    t->state.most_windows = c->most_windows;
    return lg_held_out_match(&c->held, &all->data.logs, &t->state.data.logs, &t->held, error);
}

/* The loss of each window of the fit, with the scales that the loss had before the fit, and with all of the
 * priors. */
static lg_status judge_fit(const trial_training *t, const lg_machine_problem *before, lg_machine_trial *out,
                           lg_error *error) {
    const lg_training *self = &t->training;
    lg_machine_problem problem = *before;
    out->rows = problem.window;
    out->fits = problem.windows - problem.validation;
    out->left = lg_alloc(self->context, problem.windows, sizeof *out->left);
    if (out->left == NULL) return lg_no_memory(error);
    problem.substeps = t->run.substeps;
    problem.residual = sqrt((double)out->fits);
    return lg_machine_losses(self->context, &problem, self->theta, out->left, error);
}

static lg_status learn(trial_training *t, lg_machine_trial *out, lg_error *error) {
    enum { MOST_EPOCHS = 300 };
    lg_training *self = &t->training;
    const lg_trainer *trainer = self->recipe->trainer;
    lg_fit_settings *training = lg_training_settings(self);
    LG_TRY(trainer->describe(self, error));
    LG_TRY(trainer->prepare(self, error));
    const lg_machine_problem before = t->state.problem;
    if (training->epochs > MOST_EPOCHS) training->epochs = MOST_EPOCHS;
    lg_fit_options_init(&self->options);
    lg_fit_settings_apply(training, &self->options);
    self->options.threads = (int)self->threads;
    LG_TRY(lg_training_create_fit(self, error));
    LG_TRY(lg_fit_run(self->fit, error));
    lg_fit_parameters(self->fit, self->theta);
    out->learned.machine = t->run.machine;
    out->learned.theta = lg_alloc(self->context, t->run.machine.parameters + 1, sizeof *out->learned.theta);
    if (out->learned.theta == NULL) return lg_no_memory(error);
    memcpy(out->learned.theta, self->theta, t->run.machine.parameters * sizeof *self->theta);
    return judge_fit(t, &before, out, error);
}

static lg_status judge(const trial_training *t, lg_machine_trial *out, lg_error *error) {
    const lg_learned_machine model =
        lg_model_learned(t->training.context, &t->run, out->learned.theta, t->state.estimated);
    LG_TRY_SCRATCH(double, square, t->training.context, t->held.count, lg_no_memory(error));
    LG_TRY(lg_held_out_judge(&t->held, &model, &t->state.data.training, square, error));
    out->square = LG_KEEP(square);
    return LG_OK;
}

static void begin_trial(const lg_choosing *c, const lg_machine_trial *from, trial_training *t) {
    const lg_training *whole = c->self;
    memcpy(&t->run, whole->run, sizeof t->run);
    t->training = lg_training_of(c->quiet, whole->recipe, &t->run, &t->state);
    t->training.paths = whole->paths;
    t->training.path_count = whole->path_count;
    t->training.threads = whole->threads;
    t->training.given = is_given;
    t->training.user = whole;
    t->held.context = c->quiet;
    if (from != NULL && from->learned.theta != NULL) t->state.warm = &from->learned;
}

lg_status lg_machine_try(const lg_choosing *c, const lg_machine_trial *from, lg_machine_trial *out,
                         lg_error *error) {
    LG_TRY_SCRATCH(trial_training, t, c->quiet, 1, lg_no_memory(error));
    if (out->text.failed) return lg_no_memory(error);
    begin_trial(c, from, t);
    out->status = read_trial(c, out->text.data, t, &out->why);
    if (out->status == LG_OK) out->status = learn(t, out, &out->why);
    if (out->status == LG_OK) out->status = judge(t, out, &out->why);
    lg_training_close(&t->training);
    lg_held_out_destroy(&t->held);
    const bool ends = out->status == LG_OUT_OF_MEMORY || out->status == LG_CANCELLED;
    return ends ? lg_fail(error, out->status, "%s", out->why.message) : LG_OK;
}

void lg_machine_trial_destroy(const lg_choosing *c, lg_machine_trial *trial) {
    lg_text_destroy(&trial->text);
    LG_FREE_ALL(c->quiet, trial->learned.theta, trial->square, trial->left);
    *trial = (lg_machine_trial){.square = NULL};
}

/* ---- the machine that is chosen ---- */

/* The mean loss of the windows of the fit. INFINITY: the trial failed, or a window has no finite loss. */
static double loss_of(const lg_machine_trial *trial) {
    double sum = 0.0;
    if (trial == NULL || trial->status != LG_OK) return INFINITY;
    for (size_t w = 0; w < trial->fits; w++) sum += trial->left[w];
    return isfinite(sum) ? sum / (double)trial->fits : INFINITY;
}

lg_status lg_machine_contest_run(lg_choosing *c, const lg_machine_contest *contest, size_t *winner,
                                 lg_error *error) {
    const lg_machine_state *s = c->self->state;
    const lg_machine_trial *from = NULL, *best = NULL;
    lg_machine_trial *trials = c->trials = lg_alloc(c->quiet, contest->count, sizeof *trials);
    if (trials == NULL) return lg_no_memory(error);
    c->count = contest->count;
    *winner = 0;
    for (size_t i = 0; i < contest->count; i++) {
        trials[i].text.context = c->quiet;
        lg_text_add(&trials[i].text, "%s" LG_MACHINE_CHANGE, s->data.file.text);
        contest->write(contest->user, i, &trials[i].text);
        if (c->held.count == 0) continue;
        LG_TRY(lg_machine_try(c, contest->follows ? from : NULL, &trials[i], error));
        if (loss_of(&trials[i]) < loss_of(from)) from = &trials[i];
        if (trials[i].square != NULL && (best == NULL || contest->compare(c, &trials[i], best).ratio < 1))
            best = &trials[i];
    }
    for (; best != NULL && &trials[*winner] != best; ++*winner) {
        if (trials[*winner].square == NULL) continue;
        const lg_held_out_ratio found = contest->compare(c, best, &trials[*winner]);
        if (!(contest->clearly ? found.clear : found.better)) break;
    }
    return LG_OK;
}

lg_status lg_machine_reread(lg_training *self, const lg_text *text, lg_error *error) {
    lg_machine_state *s = self->state;
    LG_CLEAN(lg_machine_data_destroy) lg_machine_data data = {.failed = NULL};
    if (text->failed) return lg_no_memory(error);
    LG_TRY(read_again(self->context, self, text->data, false, &data, error));
    const lg_machine_data before = s->data;
    s->data = data;
    data = before;
    lg_machine_look(s);
    return LG_OK;
}
