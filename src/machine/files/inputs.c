/* Chooses how inputs act between rows, and their delays. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "machine/files/choice.h"

_Static_assert(LG_MACHINE_DELAYS == LG_HELD_OUT_DELAY + 1, "windows leave room for all delays");

/* What is tried: each hold with each delay, for the inputs of which `hold` or `delay` is true; the other
 * inputs keep their hold or delay. holds or delays is 1 if no input is varied. */
typedef struct grid {
    const lg_training *self;
    bool hold[LG_MACHINE_INPUTS], delay[LG_MACHINE_INPUTS];
    uint32_t holds, delays;
    const lg_machine_trial *trial; /* (holds delays): holds of the first delay come first */
} grid;

static const lg_machine_trial *trial_at(const grid *g, uint32_t hold, uint32_t delay) {
    return &g->trial[delay * g->holds + hold];
}

/* Whether an input changes so little from row to row that it does not matter how it acts between rows. */
static bool acts_alike(const lg_machine_data *data) {
    static const double little = 1e-3;
    const lg_machine *machine = &data->file.machine;
    const size_t first = machine->positions + machine->velocities, end = first + machine->input_count;
    for (size_t i = first; i < end; i++)
        if (lg_log_change(machine, &data->training, i, 1) >
            little * little * lg_log_variance(machine, &data->training, i))
            return false;
    return true;
}

/* Varies inputs first .. end - 1 where `asked` leaves the hold or the delay open; `all`: the holds of all of
 * them. */
static void make_grid(const lg_log_input *asked, uint32_t first, uint32_t end, bool all, grid *out) {
    *out = (grid){.holds = 1, .delays = 1};
    for (uint32_t i = first; i < end; i++) {
        out->hold[i] = all || asked[i].choose_hold;
        out->delay[i] = asked[i].choose_delay;
        if (out->hold[i]) out->holds = LG_INPUT_HOLD_COUNT;
        if (out->delay[i]) out->delays = LG_MACHINE_DELAYS;
    }
}

static bool is_same(uint32_t count, const uint32_t *values) {
    bool same = true;
    for (uint32_t i = 0; i < count; i++) same = same && values[i] == values[0];
    return same;
}

/* Writes one value, or a list by input where they differ: names[value], or without names the number. */
static void put_values(const char *key, uint32_t count, const uint32_t *values, const char *const *names,
                       lg_text *to) {
    const bool same = is_same(count, values);
    lg_text_add(to, "%s: %s", key, same ? "" : "[");
    for (uint32_t i = 0; i < (same ? 1 : count); i++) {
        if (i > 0) lg_text_add(to, ", ");
        if (names != NULL)
            lg_text_add(to, "%s", names[values[i]]);
        else
            lg_text_add(to, "%u", values[i]);
    }
    lg_text_add(to, same ? "" : "]");
}

/* Writes a hold and a delay of the inputs that the grid varies. */
static void write_change(const void *user, size_t index, lg_text *out) {
    const grid *g = user;
    const lg_machine_data *data = &lg_machine_state_of(g->self)->data;
    const uint32_t n = data->file.machine.input_count;
    uint32_t hold[LG_MACHINE_INPUTS], delay[LG_MACHINE_INPUTS];
    for (uint32_t i = 0; i < n; i++) {
        hold[i] = g->hold[i] ? (uint32_t)index % g->holds : (uint32_t)data->file.inputs[i].hold;
        delay[i] = g->delay[i] ? (uint32_t)index / g->holds : data->logs.delay[i];
    }
    lg_text_add(out, "inputs: {");
    if (g->holds > 1) put_values("hold", n, hold, lg_input_holds, out);
    if (g->holds > 1 && g->delays > 1) lg_text_add(out, ", ");
    if (g->delays > 1) put_values("delay", n, delay, NULL, out);
    lg_text_add(out, "}\n");
}

/* The windows of the fits compare, for holds and delays add no parameter. If these windows cannot tell which
 * of the two trials is better, the long windows do that were held out. */
static lg_held_out_ratio compare(const lg_choosing *c, const lg_machine_trial *one,
                                 const lg_machine_trial *other) {
    if (one->square == NULL || other->square == NULL)
        return (lg_held_out_ratio){.clear = one->square != NULL};
    const size_t fits = one->fits < other->fits ? one->fits : other->fits;
    lg_held_out_ratio out = lg_held_out_compare(fits, one->left, other->left);
    out.rows = one->rows;
    if (out.clear || lg_held_out_compare(fits, other->left, one->left).clear) return out;
    out = lg_held_out_compare(c->held.count, one->square, other->square);
    out.rows = c->held.steps;
    return out;
}

/* A ratio as people say it: "1/44", or ".61". */
static const char *share(double ratio, char text[32]) {
    if (ratio < 0.2)
        (void)lg_format(text, 32, "1/%.0f", 1 / ratio);
    else
        (void)lg_format(text, 32, "%.2f", ratio);
    return text;
}

/* Writes "the input NAME `one`" if one of several inputs is varied and returns true, else `all`. */
static bool name_inputs(const lg_machine *machine, const bool *varied, const char *one, const char *all,
                        char text[96]) {
    const char *name = NULL;
    uint32_t count = 0;
    for (uint32_t i = 0; i < machine->input_count; i++)
        if (varied[i]) count++, name = machine->inputs[i];
    const bool single = count == 1 && machine->input_count > 1;
    (void)snprintf(text, 96, "%s%s%s%s", single ? "the input " : "", single ? name : "", single ? " " : "",
                   single ? one : all);
    return single;
}

static void tell_choice(const lg_choosing *c, const grid *g, uint32_t hold, uint32_t delay) {
    const lg_training *self = g->self;
    const lg_machine_state *s = self->state;
    const lg_machine *machine = &s->data.file.machine;
    const lg_machine_trial *chosen = trial_at(g, hold, delay);
    const lg_held_out_ratio held = compare(c, chosen, trial_at(g, LG_HOLD_ZERO, delay)),
                            early = compare(c, chosen, trial_at(g, hold, 0));
    const double dt = s->data.logs.dt_median;
    char text[32], who[96];
    if (g->holds > 1 && hold != LG_HOLD_ZERO) {
        (void)name_inputs(machine, g->hold, "is a sampled analogue signal",
                          machine->input_count > 1 ? "the inputs are sampled analogue signals"
                                                   : "the input is a sampled analogue signal",
                          who);
        LG_WARN(self, "%s: hold: %s leaves %s of the error of a held input (runs of %.3g s), and is taken",
                who, lg_input_holds[hold], share(held.ratio, text), (double)held.rows * dt);
    }
    if (g->delays > 1 && delay > 0) {
        const bool single = name_inputs(machine, g->delay, "acts", "the inputs act", who);
        char edge[128] = "";
        if (delay + 1 == g->delays)
            (void)lg_format(edge, sizeof edge,
                            "; more are not tried: for a greater delay set `delay: estimate` (up to %d rows) "
                            "or a number of rows",
                            LG_DELAY_ESTIMATED);
        LG_WARN(self,
                "%s %u row%s after %s logged: this leaves %s of the error without a delay (runs of %.3g s)%s",
                who, delay, delay == 1 ? "" : "s", single ? "it is" : "they are", share(early.ratio, text),
                (double)early.rows * dt, edge);
    }
}

static size_t numbers_of(const lg_machine_trial *trial, lg_identified *out) {
    const size_t count =
        lg_machine_numbers(&trial->learned.machine, trial->learned.theta, LG_MACHINE_VALUES, out);
    return count < LG_MACHINE_VALUES ? count : LG_MACHINE_VALUES;
}

/* How much the numbers change with the holds that the chosen one does not beat; with several searches the
 * largest change of all. */
static void find_changes(const lg_choosing *c, const grid *g, uint32_t hold, uint32_t delay,
                         lg_input_changes *out) {
    const lg_machine_trial *chosen = trial_at(g, hold, delay);
    lg_identified other[LG_MACHINE_VALUES];
    double before[LG_MACHINE_VALUES] = {0.0};
    if (chosen->square == NULL) return;
    for (size_t i = 0; i < out->count; i++) before[i] = out->numbers[i].error;
    out->count = numbers_of(chosen, out->numbers);
    for (size_t i = 0; i < out->count; i++) out->numbers[i].error = before[i];
    for (uint32_t h = 0; h < g->holds; h++) {
        const lg_machine_trial *trial = trial_at(g, h, delay);
        if (trial == chosen || compare(c, chosen, trial).clear) continue;
        /* The two machines differ only in their hold, so they have equally many numbers. */
        (void)numbers_of(trial, other);
        for (size_t i = 0; i < out->count; i++)
            out->numbers[i].error = fmax(out->numbers[i].error, fabs(other[i].value - out->numbers[i].value));
    }
}

/* Writes a combination into the machine's text and reads it and the logs again. */
static lg_status take(lg_training *self, const lg_choosing *c, grid *g, size_t winner, bool tell,
                      lg_error *error) {
    lg_machine_state *s = self->state;
    const uint32_t hold = (uint32_t)winner % g->holds, delay = (uint32_t)winner / g->holds;
    const lg_machine_trial *chosen = &g->trial[winner];
    for (uint32_t i = 0; i < s->data.file.machine.input_count; i++) {
        for (uint32_t h = 0; h < g->holds && g->hold[i]; h++)
            s->inputs[i].hold[h] = compare(c, trial_at(g, h, delay), chosen).ratio;
        for (uint32_t d = 0; d < g->delays && g->delay[i]; d++)
            s->inputs[i].delay[d] = compare(c, trial_at(g, hold, d), chosen).ratio;
    }
    if (tell) {
        find_changes(c, g, hold, delay, &s->changes);
        tell_choice(c, g, hold, delay);
    }
    return lg_machine_reread(self, &chosen->text, error);
}

/* Tries the combinations of a grid, and takes the best one: the one with the least error, or the first one
 * (small delays, then held inputs first) that it does not beat. Each starts from the numbers of the best
 * before it: the numbers that a wrong hold has found may be far off. */
static lg_status search(lg_training *self, grid *g, bool tell, lg_error *error) {
    enum { MOST_WINDOWS = 200 };
    static const double part = 0.2;
    const lg_machine_state *s = self->state;
    const lg_machine_contest contest = {g->holds * g->delays, true, true, write_change, compare, g};
    LG_CLEAN(lg_choosing_end) lg_choosing c;
    size_t winner = 0;
    LG_TRY(lg_choosing_begin(&c, self, part, LG_HELD_OUT_WINDOWS, MOST_WINDOWS, error));
    g->self = self;
    if (c.held.count == 0 && tell && (g->delays > 1 || s->data.file.hold_given))
        LG_WARN(self, "the log is too short to choose how the inputs act: hold zero and no delay are taken");
    LG_TRY(lg_machine_contest_run(&c, &contest, &winner, error));
    g->trial = c.trials;
    return take(self, &c, g, winner, tell, error);
}

/* First one hold and one delay for all inputs that have `auto`, then those of one such input after the
 * other. A file without `hold` gets one hold for all inputs. */
lg_status lg_machine_choose_inputs(lg_training *self, lg_error *error) {
    const lg_machine_data *data = &lg_machine_state_of(self)->data;
    const lg_machine *machine = &data->file.machine;
    const uint32_t n = machine->input_count;
    if (n == 0 || machine->parameters == 0) return LG_OK;
    const bool all = !data->file.hold_given && !acts_alike(data);
    lg_log_input asked[LG_MACHINE_INPUTS];
    uint32_t count = 0;
    grid g;
    memcpy(asked, data->file.inputs, sizeof asked);
    for (uint32_t i = 0; i < n; i++) count += asked[i].choose_hold || asked[i].choose_delay;
    make_grid(asked, 0, n, all, &g);
    if (g.holds * g.delays > 1) LG_TRY(search(self, &g, count <= 1, error));
    for (uint32_t i = 0; i < n && count > 1; i++) {
        make_grid(asked, i, i + 1, false, &g);
        if (g.holds * g.delays > 1) LG_TRY(search(self, &g, true, error));
    }
    return LG_OK;
}

/* Multiplies a parameter's row of W by the largest factor of the numbers that change with this parameter.
 * W W^T then has errors of the numbers that are the widened ones, or above these where a number shares a
 * parameter with a number that was widened more. */
static lg_status widen_spread(lg_training *self, const double *theta, size_t count, const double *factor,
                              double *W, lg_error *error) {
    static const double step = 1e-3;
    const lg_machine *machine = lg_machine_state_of(self)->problem.machine;
    const size_t n = machine->parameters;
    double *at;
    lg_identified *numbers, *moved;
    if (W == NULL) return LG_OK;
    LG_TRAINING_ARRAY(self, at, n + 1, error);
    LG_TRAINING_ARRAY(self, numbers, count + 1, error);
    LG_TRAINING_ARRAY(self, moved, count + 1, error);
    memcpy(at, theta, n * sizeof *at);
    (void)lg_machine_numbers(machine, at, count, numbers);
    for (size_t k = 0; k < n; k++) {
        double most = 1;
        at[k] += step * (1 + fabs(theta[k]));
        (void)lg_machine_numbers(machine, at, count, moved);
        at[k] = theta[k];
        for (size_t i = 0; i < count; i++)
            if (isfinite(factor[i]) && moved[i].value != numbers[i].value) most = fmax(most, factor[i]);
        for (size_t i = 0; i < n; i++) W[k * n + i] *= most;
    }
    return LG_OK;
}

lg_status lg_machine_widen(lg_training *self, const double *theta, size_t count, lg_identification *of,
                           lg_error *error) {
    const lg_machine_state *s = self->state;
    const lg_input_changes *inputs = &s->changes;
    const lg_identified *most = NULL;
    lg_identified *numbers = of->numbers;
    double worst = 1, at[LG_MACHINE_POSITIONS], *factor;
    /* A mass that depends on the state is reported at other positions by the trials. */
    const bool placed = lg_machine_mass_at(&s->problem, at);
    LG_TRAINING_ARRAY(self, factor, count + 1, error);
    for (size_t i = 0; i < count; i++) {
        const double before = numbers[i].error;
        for (size_t k = 0; k < inputs->count; k++) {
            const lg_identified *changed = &inputs->numbers[k];
            if (strcmp(changed->name, numbers[i].name) != 0) continue;
            if (placed && strncmp(changed->name, "mass.", 5) == 0) continue;
            if (changed->error > worst * numbers[i].error)
                worst = changed->error / numbers[i].error, most = changed;
            numbers[i].error = hypot(numbers[i].error, changed->error);
        }
        factor[i] = numbers[i].error / before;
    }
    if (most != NULL)
        LG_WARN(self,
                "the log does not tell how the inputs act between rows, and it matters: another hold changes "
                "%s by %.2g; standard errors contain this",
                most->name, most->error);
    return widen_spread(self, theta, count, factor, of->spread, error);
}

/* ---- results ---- */

/* Writes {"chosen": ..., "ratios": {...}}, each once if it is the same for all inputs, else as a list by
 * input. ratios (count) belongs to the first input; the ratios of input i lie i lg_input_choice further. */
static void tell(lg_training *self, const char *key, const char *const *names, size_t count,
                 const uint32_t *value, const double *ratios) {
    enum { NEXT = sizeof(lg_input_choice) / sizeof(double) };
    const uint32_t n = lg_machine_state_of(self)->data.file.machine.input_count;
    const bool same = is_same(n, value);
    bool alike = same;
    for (uint32_t i = 0; i < n; i++)
        alike = alike && memcmp(ratios + i * NEXT, ratios, count * sizeof *ratios) == 0;
    lg_result_open(self, key, '{');
    if (!same) lg_result_open(self, "chosen", '[');
    for (uint32_t i = 0; i < (same ? 1 : n); i++)
        if (names == lg_input_holds)
            lg_result_add(self, LG_TEXT(same ? "chosen" : NULL, names[value[i]], NULL));
        else
            lg_result_add(self, LG_WHOLE(same ? "chosen" : NULL, value[i], NULL));
    if (!same) lg_result_close(self, ']');
    if (!alike) lg_result_open(self, "ratios", '[');
    for (uint32_t i = 0; i < (alike ? 1 : n); i++) {
        lg_result_open(self, alike ? "ratios" : NULL, '{');
        for (size_t k = 0; k < count; k++)
            if (k != value[i] && ratios[i * NEXT + k] > 0)
                LG_TELL(self, LG_REAL(names[k], ratios[i * NEXT + k], NULL));
        lg_result_close(self, '}');
    }
    if (!alike) lg_result_close(self, ']');
    lg_result_close(self, '}');
}

void lg_machine_tell_inputs(lg_training *self) {
    static const char *const delays[LG_MACHINE_DELAYS] = {"0", "1", "2", "3", "4", "5"};
    const lg_machine_state *s = self->state;
    uint32_t hold[LG_MACHINE_INPUTS];
    for (uint32_t i = 0; i < s->data.file.machine.input_count; i++)
        hold[i] = (uint32_t)s->data.file.inputs[i].hold;
    if (s->data.file.machine.input_count == 0) return;
    tell(self, "hold", lg_input_holds, LG_INPUT_HOLD_COUNT, hold, s->inputs[0].hold);
    tell(self, "delay", delays, LG_MACHINE_DELAYS, s->data.logs.delay, s->inputs[0].delay);
}
