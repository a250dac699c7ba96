/* Chooses how inputs act between rows, and their delay. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "machine/files/choice.h"

static const char *const holds[LG_INPUT_HOLD_COUNT] = {"zero", "linear", "cubic"};
static const char *const delays[LG_MACHINE_DELAYS] = {"0", "1", "2", "3", "4", "5"};
_Static_assert(LG_MACHINE_DELAYS == LG_HELD_OUT_DELAY + 1, "windows leave room for all delays");

/* The combinations that are tried: first .. first + count - 1 of each; trial (hold, delay). */
typedef struct grid {
    uint32_t hold, holds, delay, delays;
    lg_machine_trial trial[LG_INPUT_HOLD_COUNT][LG_MACHINE_DELAYS];
} grid;

/* Whether an input changes so little from row to row that it does not matter how it acts between rows. */
static bool acts_alike(const lg_machine_data *data) {
    static const double little = 1e-3;
    const size_t m = data->file.machine.input_count;
    const lg_machine_log *log = &data->training;
    for (size_t i = 0; i < m; i++) {
        double sum = 0, square = 0, change = 0;
        for (size_t p = 0; p < log->parts; p++)
            for (size_t row = log->first[p]; row < log->first[p + 1]; row++) {
                const double u = log->u[4 * row * m + i];
                const double d = row > log->first[p] ? u - log->u[4 * (row - 1) * m + i] : 0;
                sum += u;
                square += u * u;
                change += d * d;
            }
        const double variance = square / (double)log->rows - pow(sum / (double)log->rows, 2);
        if (change / (double)log->rows > little * little * variance) return false;
    }
    return true;
}

/* Which combinations the machine's file leaves open. False: none. */
static bool make_grid(const lg_machine_data *data, grid *out) {
    const lg_machine_file *file = &data->file;
    const bool hold = file->choose_hold || (!file->hold_given && !acts_alike(data));
    out->hold = hold ? 0 : file->hold;
    out->holds = hold ? LG_INPUT_HOLD_COUNT : 1;
    out->delay = 0;
    out->delays = file->choose_delay ? LG_MACHINE_DELAYS : 1;
    return file->machine.input_count > 0 && file->machine.parameters > 0 && (hold || file->choose_delay);
}

/* The machine's file with this hold, and with this delay if it is chosen. */
static lg_status write_text(const lg_machine_file *file, const grid *g, uint32_t hold, uint32_t delay,
                            const char *name, char **out, lg_error *error) {
    const lg_yaml_edit edits[] = {{LG_YAML_SET, "inputs.hold", NULL, holds[hold]},
                                  {LG_YAML_SET, "inputs.delay", NULL, delays[delay]}};
    return lg_yaml_change(file->context, name, file->text, edits, g->delays > 1 ? 2 : 1, out, error);
}

static lg_status run_grid(const lg_choosing *c, const lg_machine_file *file, grid *g, lg_error *error) {
    const lg_machine_trial *first = NULL;
    for (uint32_t d = g->delay; d < g->delay + g->delays; d++)
        for (uint32_t h = g->hold; h < g->hold + g->holds; h++) {
            char *text = NULL;
            LG_TRY(write_text(file, g, h, d, c->self->paths[0], &text, error));
            const lg_status status = lg_machine_try(c, text, first, &g->trial[h][d], error);
            lg_free(file->context, text);
            if (status != LG_OK) return status;
            if (first == NULL && g->trial[h][d].status == LG_OK) first = &g->trial[h][d];
        }
    return LG_OK;
}

/* How two trials compare: the error of the first one, divided by that of the other one, whether it is less by
 * more than chance and by more than 5 %, and the rows of the runs that tell. */
typedef struct comparison {
    double ratio;
    bool beats;
    size_t rows;
} comparison;

static comparison compare_on(size_t count, size_t rows, const double *one, const double *other) {
    static const double less = 0.95;
    const lg_held_out_ratio found = lg_held_out_compare(count, one, other);
    return (comparison){found.ratio, found.better && found.ratio < less, rows};
}

/* The windows of the fits compare, for holds and delays add no parameter. If these windows cannot tell which
 * of the two trials is better, the long windows do that were held out. */
static comparison compare(const lg_choosing *c, const lg_machine_trial *one, const lg_machine_trial *other) {
    if (one->square == NULL || other->square == NULL) return (comparison){.beats = one->square != NULL};
    const size_t fits = one->fits < other->fits ? one->fits : other->fits;
    const comparison own = compare_on(fits, one->rows, one->left, other->left);
    if (own.beats || compare_on(fits, one->rows, other->left, one->left).beats) return own;
    return compare_on(c->held.count, c->held.steps, one->square, other->square);
}

static bool beats(const lg_choosing *c, const lg_machine_trial *one, const lg_machine_trial *other) {
    return compare(c, one, other).beats;
}

static double ratio_of(const lg_choosing *c, const lg_machine_trial *one, const lg_machine_trial *other) {
    return compare(c, one, other).ratio;
}

/* The combination with the least error, and then the first one (small delays, then held inputs first) that it
 * does not beat. */
static void find_best(const lg_choosing *c, const grid *g, uint32_t *hold, uint32_t *delay) {
    const lg_machine_trial *best = NULL;
    for (uint32_t d = g->delay; d < g->delay + g->delays; d++)
        for (uint32_t h = g->hold; h < g->hold + g->holds; h++) {
            const lg_machine_trial *trial = &g->trial[h][d];
            if (trial->square != NULL && (best == NULL || ratio_of(c, trial, best) < 1)) best = trial;
        }
    *hold = g->hold;
    *delay = g->delay;
    for (uint32_t d = g->delay; d < g->delay + g->delays && best != NULL; d++)
        for (uint32_t h = g->hold; h < g->hold + g->holds; h++) {
            const lg_machine_trial *trial = &g->trial[h][d];
            if (trial != best && (trial->square == NULL || beats(c, best, trial))) continue;
            *hold = h;
            *delay = d;
            return;
        }
}

/* A ratio as people say it: "1/44", or ".61". */
static const char *share(double ratio, char text[32]) {
    if (ratio < 0.2)
        (void)snprintf(text, 32, "1/%.0f", 1 / ratio);
    else
        (void)snprintf(text, 32, "%.2f", ratio);
    return text;
}

static void tell_choice(const lg_training *self, const lg_choosing *c, const grid *g, uint32_t hold,
                        uint32_t delay) {
    const lg_machine_state *s = self->state;
    const lg_machine_trial *chosen = &g->trial[hold][delay];
    const comparison held = compare(c, chosen, &g->trial[LG_HOLD_ZERO][delay]),
                     early = compare(c, chosen, &g->trial[hold][0]);
    const double dt = s->data.logs.dt_median;
    char text[32];
    if (g->holds > 1 && hold != LG_HOLD_ZERO)
        LG_WARN(
            self,
            "the input is a sampled analogue signal: hold: %s leaves %s of the error of a held input (runs "
            "of %.3g s), and is taken",
            holds[hold], share(held.ratio, text), (double)held.rows * dt);
    if (g->delays > 1 && delay > 0)
        LG_WARN(self,
                "the inputs act %u row%s after they are logged: this leaves %s of the error without a delay "
                "(runs of %.3g s)",
                delay, delay == 1 ? "" : "s", share(early.ratio, text), (double)early.rows * dt);
}

static size_t numbers_of(const lg_machine_trial *trial, lg_identified *out) {
    const size_t count =
        lg_machine_numbers(&trial->learned.machine, trial->learned.theta, LG_MACHINE_VALUES, out);
    return count < LG_MACHINE_VALUES ? count : LG_MACHINE_VALUES;
}

/* How much the numbers change with the holds that the chosen one does not beat. */
static void find_changes(const lg_choosing *c, const grid *g, uint32_t hold, uint32_t delay,
                         lg_input_choice *out) {
    const lg_machine_trial *chosen = &g->trial[hold][delay];
    lg_identified other[LG_MACHINE_VALUES];
    if (chosen->square == NULL) return;
    out->count = numbers_of(chosen, out->numbers);
    for (size_t i = 0; i < out->count; i++) out->numbers[i].error = 0;
    for (uint32_t h = g->hold; h < g->hold + g->holds; h++) {
        const lg_machine_trial *trial = &g->trial[h][delay];
        if (trial == chosen || beats(c, chosen, trial)) continue;
        const size_t count = numbers_of(trial, other);
        for (size_t i = 0; i < count && i < out->count; i++)
            out->numbers[i].error = fmax(out->numbers[i].error, fabs(other[i].value - out->numbers[i].value));
    }
}

static lg_status take(lg_training *self, const lg_choosing *c, const grid *g, lg_error *error) {
    lg_machine_state *s = self->state;
    uint32_t hold, delay;
    char *text = NULL;
    find_best(c, g, &hold, &delay);
    for (uint32_t h = g->hold; h < g->hold + g->holds; h++)
        s->inputs.hold[h] = ratio_of(c, &g->trial[h][delay], &g->trial[hold][delay]);
    for (uint32_t d = g->delay; d < g->delay + g->delays; d++)
        s->inputs.delay[d] = ratio_of(c, &g->trial[hold][d], &g->trial[hold][delay]);
    find_changes(c, g, hold, delay, &s->inputs);
    tell_choice(self, c, g, hold, delay);
    LG_TRY(write_text(&s->data.file, g, hold, delay, self->paths[0], &text, error));
    const lg_status status = lg_machine_reread(self, text, error);
    lg_free(self->context, text);
    return status;
}

static lg_status choose(lg_training *self, const lg_choosing *c, grid *g, lg_error *error) {
    const lg_machine_state *s = self->state;
    const lg_machine_file *file = &s->data.file;
    if (c->held.count == 0 && (file->choose_hold || file->choose_delay))
        LG_WARN(self, "the log is too short to choose how the inputs act: hold zero and no delay are taken");
    if (c->held.count > 0) LG_TRY(run_grid(c, file, g, error));
    return take(self, c, g, error);
}

lg_status lg_machine_choose_inputs(lg_training *self, lg_error *error) {
    enum { MOST_WINDOWS = 200 };
    static const double part = 0.2;
    const lg_machine_state *s = self->state;
    lg_choosing c;
    grid *g = lg_alloc(self->context, 1, sizeof *g);
    if (g == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "%s", lg_status_sentence(LG_OUT_OF_MEMORY));
    lg_status status = LG_OK;
    if (make_grid(&s->data, g)) {
        status = lg_choosing_begin(&c, self, part, error);
        c.most_windows = MOST_WINDOWS;
        if (status == LG_OK) status = choose(self, &c, g, error);
        for (uint32_t h = 0; h < LG_INPUT_HOLD_COUNT; h++)
            for (uint32_t d = 0; d < LG_MACHINE_DELAYS; d++) lg_machine_trial_destroy(&c, &g->trial[h][d]);
        lg_choosing_end(&c);
    }
    lg_free(self->context, g);
    return status;
}

void lg_machine_widen(lg_training *self, size_t count, lg_identified *numbers) {
    const lg_input_choice *inputs = &((const lg_machine_state *)self->state)->inputs;
    const lg_identified *most = NULL;
    double worst = 1;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < inputs->count; k++) {
            const lg_identified *changed = &inputs->numbers[k];
            if (strcmp(changed->name, numbers[i].name) != 0) continue;
            if (changed->error > worst * numbers[i].error)
                worst = changed->error / numbers[i].error, most = changed;
            numbers[i].error = hypot(numbers[i].error, changed->error);
        }
    if (most != NULL)
        LG_WARN(self,
                "the log does not tell how the inputs act between rows, and it matters: another hold changes "
                "%s by %.2g; standard errors contain this",
                most->name, most->error);
}

/* Writes {"chosen": ..., "ratios": {...}} of what was tried. */
static void tell_ratios(lg_training *self, const char *const *names, const double *ratios, size_t count,
                        size_t chosen) {
    lg_result_open(self, "ratios", '{');
    for (size_t i = 0; i < count; i++)
        if (i != chosen && ratios[i] > 0) lg_result_real(self, names[i], ratios[i], NULL);
    lg_result_close(self, '}');
}

void lg_machine_tell_inputs(lg_training *self) {
    const lg_machine_state *s = self->state;
    const lg_machine_file *file = &s->data.file;
    if (file->machine.input_count == 0) return;
    lg_result_open(self, "hold", '{');
    lg_result_text(self, "chosen", holds[file->hold], NULL);
    tell_ratios(self, holds, s->inputs.hold, LG_INPUT_HOLD_COUNT, file->hold);
    lg_result_close(self, '}');
    lg_result_open(self, "delay", '{');
    lg_result_whole(self, "chosen", s->data.logs.delay, NULL);
    tell_ratios(self, delays, s->inputs.delay, LG_MACHINE_DELAYS, s->data.logs.delay);
    lg_result_close(self, '}');
}
