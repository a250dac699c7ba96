/* `fit --select free-run`: free runs over windows that are held out choose the widths of networks, and the
 * epoch whose parameters are the result. */
#include <math.h>
#include <string.h>

#include "machine/files/choice.h"

/* Widths that --size auto compares, from small to large. */
static const char *const widths[] = {"4", "8", "16", "16, 16", "32, 32"};

/* ---- the epoch ---- */

/* Stands between the fit and the driver's callbacks. */
struct lg_selection {
    lg_training *self;
    lg_held_out held;
    /* The fit's parameters now; the best so far, and the windows' mean square error with them. */
    double *now, *best, *square, least;
    uint64_t epoch, next; /* of the best, 0: none; at which to judge again */
    lg_status (*checkpoint)(void *user, const lg_fit *fit);
    int (*on_epoch)(void *user, const lg_fit_epoch *report);
    void *user;
};
typedef struct lg_selection selection;

static lg_status judge_now(selection *s, uint64_t epoch, lg_error *error) {
    const lg_machine_state *state = s->self->state;
    const lg_machine_model_run *run = s->self->run;
    const lg_learned_machine model = lg_model_learned(s->self->context, run, s->now, state->estimated);
    LG_TRY(lg_held_out_judge(&s->held, &model, &state->data.training, s->square, error));
    const double found = lg_held_out_error(&s->held, s->square);
    if (!(found < s->least)) return LG_OK;
    s->least = found;
    s->epoch = epoch;
    memcpy(s->best, s->now, s->self->problem.parameters * sizeof *s->now);
    return LG_OK;
}

/* Judges after each of the first epochs, then at least a tenth of the epochs later, and after the last. */
static int on_epoch(void *user, const lg_fit_epoch *report) {
    selection *s = user;
    if (s->self->fit != NULL && (report->epoch >= s->next || report->epoch == report->epochs)) {
        lg_fit_parameters(s->self->fit, s->now);
        (void)judge_now(s, report->epoch, NULL); /* an epoch that cannot be judged is not the best */
        s->next = report->epoch + 1 + report->epoch / 10;
    }
    return s->on_epoch != NULL ? s->on_epoch(s->user, report) : 0;
}

static lg_status on_checkpoint(void *user, const lg_fit *fit) {
    const selection *s = user;
    return s->checkpoint(s->user, fit);
}

lg_status lg_machine_select_begin(lg_training *self, lg_error *error) {
    lg_machine_state *state = self->state;
    lg_fit_options *options = &self->options;
    selection *s = state->selection;
    if (s == NULL) return LG_OK;
    LG_TRAINING_ARRAY(self, s->now, self->problem.parameters, error);
    LG_TRAINING_ARRAY(self, s->best, self->problem.parameters, error);
    LG_TRAINING_ARRAY(self, s->square, s->held.count, error);
    s->self = self;
    s->least = INFINITY;
    s->epoch = s->next = 0;
    s->checkpoint = options->checkpoint;
    s->on_epoch = options->on_epoch;
    s->user = options->user;
    if (options->checkpoint != NULL) options->checkpoint = on_checkpoint;
    options->on_epoch = on_epoch;
    options->user = s;
    return LG_OK;
}

lg_status lg_machine_select_end(lg_training *self, double *theta, lg_error *error) {
    selection *s = lg_machine_state_of(self)->selection;
    if (s == NULL) return LG_OK;
    memcpy(s->now, theta, self->problem.parameters * sizeof *theta);
    LG_TRY(judge_now(s, lg_fit_epochs_done(self->fit), error));
    if (s->epoch > 0) memcpy(theta, s->best, self->problem.parameters * sizeof *theta);
    return LG_OK;
}

void lg_machine_tell_selection(lg_training *self) {
    const lg_machine_state *state = self->state;
    const selection *s = state->selection;
    if (state->width != NULL) LG_TELL(self, LG_TEXT("size", state->width, "widths of networks"));
    if (s == NULL) return;
    LG_RESULT_OBJECT(self, "select", LG_WHOLE("windows", s->held.count, NULL),
                     LG_REAL("seconds", (double)s->held.steps * state->data.logs.dt_median, NULL),
                     LG_WHOLE("epoch", s->epoch, NULL), LG_REAL("error", s->least, NULL));
}

/* ---- widths of networks ---- */

static void write_width(const void *user, size_t index, lg_text *out) {
    lg_text_add(out, "hidden: [%s]\n", widths[index]);
}

static lg_held_out_ratio compare(const lg_choosing *c, const lg_machine_trial *one,
                                 const lg_machine_trial *other) {
    return lg_held_out_compare(c->held.count, one->square, other->square);
}

static void tell_race(const lg_training *self, const lg_choosing *c, size_t winner) {
    const lg_machine_trial *trials = c->trials;
    char text[256] = "";
    for (size_t i = 0; i < LG_COUNT(widths); i++)
        if (i != winner && trials[i].square != NULL)
            lg_append(text, sizeof text, "%s[%s] %.3g", text[0] != '\0' ? ", " : "", widths[i],
                      compare(c, &trials[i], &trials[winner]).ratio);
    lg_log_message(self->context, LG_LOG_INFO,
                   "networks of width [%s] are taken; errors of the others in free runs, as multiples: %s",
                   widths[winner], text);
}

/* *width: what was taken. */
static lg_status choose_widths(lg_training *self, double part, const char **width, lg_error *error) {
    enum { MOST_WINDOWS = 200 };
    const lg_machine_contest contest = {LG_COUNT(widths), false, false, write_width, compare, NULL};
    LG_CLEAN(lg_choosing_end) lg_choosing c;
    size_t winner = 0;
    LG_TRY(lg_choosing_begin(&c, self, part, LG_HELD_OUT_WINDOWS, MOST_WINDOWS, error));
    *width = widths[0];
    if (c.held.count == 0) return LG_OK;
    LG_TRY(lg_machine_contest_run(&c, &contest, &winner, error));
    if (c.trials[winner].square == NULL)
        return lg_fail(error, c.trials[0].status, "%s", c.trials[0].why.message);
    tell_race(self, &c, winner);
    *width = widths[winner];
    return LG_OK;
}

/* ---- before training ---- */

static lg_status set_widths(lg_training *self, double part, lg_error *error) {
    lg_machine_state *state = self->state;
    const lg_machine_file *file = &state->data.file;
    const char *width = state->size;
    bool any = false;
    if (width == NULL) return LG_OK;
    for (const lg_machine_term *term = NULL;
         lg_machine_next_term(&file->machine, LG_MACHINE_PART_COUNT, &term);)
        any = any || lg_term_is_network(term);
    if (!any) return lg_fail(error, LG_INVALID_ARGUMENT, "--size: this machine has no network");
    if (strcmp(width, "auto") == 0) {
        LG_TRY(choose_widths(self, part, &width, error));
        state->width = width;
    }
    LG_CLEAN(lg_text_destroy) lg_text text = {.context = self->context};
    lg_text_add(&text, "%s" LG_MACHINE_CHANGE "hidden: [%s]\n", file->text, width);
    return lg_machine_reread(self, &text, error);
}

lg_status lg_machine_select(lg_training *self, lg_error *error) {
    static const double usual = 0.2;
    lg_machine_state *state = self->state;
    lg_machine_model_run *run = self->run;
    const double part = run->training.validation > 0 ? run->training.validation : usual;
    LG_TRY(set_widths(self, part, error));
    if (!state->select) return LG_OK;
    selection *s = state->selection = lg_alloc(self->context, 1, sizeof *s);
    if (s == NULL) return lg_no_memory(error);
    run->training.validation = 0;
    LG_TRY(lg_held_out_plan(self->context, &state->data.file.machine, &state->data.training, part,
                            LG_HELD_OUT_WINDOWS, state->estimated || state->noisy, &s->held, error));
    state->held = &s->held;
    if (s->held.count > 0) return LG_OK;
    return lg_fail(error, LG_FORMAT, "%s: the log is too short to hold out windows for --select free-run",
                   state->data.paths[0]);
}

void lg_machine_select_close(lg_training *self) {
    lg_machine_state *state = self->state;
    if (state->selection == NULL) return;
    lg_held_out_destroy(&state->selection->held);
    lg_free(self->context, state->selection);
    state->selection = NULL;
    state->held = NULL;
}
