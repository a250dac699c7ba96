/* Finds the terms that a log asks for: candidates are learned, and judged by free runs. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/h5.h"
#include "machine/files/choice.h"

/* ---- the table of candidates ---- */

static bool has_inputs(const lg_machine_file *file, const lg_candidate *self) {
    return file->machine.input_count > 0;
}

/* The machine has inputs, and no lag whose value is known. */
static bool lags_are_open(const lg_machine_file *file, const lg_candidate *self) {
    bool open = has_inputs(file, self);
    for (const lg_machine_term *term = NULL;
         lg_machine_next_term(&file->machine, LG_MACHINE_PART_COUNT, &term);)
        open = open && (term->kind->lag == NULL || term->entry_count == term->value_count);
    return open;
}

/* An input has another hold. */
static bool holds_otherwise(const lg_machine_file *file, const lg_candidate *self) {
    bool other = false;
    for (uint32_t i = 0; i < file->machine.input_count; i++)
        other = other || strcmp(lg_input_holds[file->inputs[i].hold], self->value) != 0;
    return other;
}

/* All inputs have smaller delays. */
static bool delays_less(const lg_machine_file *file, const lg_candidate *self) {
    bool less = file->machine.input_count > 0;
    for (uint32_t i = 0; i < file->machine.input_count; i++)
        less = less && (int)file->inputs[i].delay < atoi(self->value);
    return less;
}

#define TERM(name_, key_, part_, term_, unless_, asks_, ...)                                                 \
    {                                                                                                        \
        .name = name_, .change = key_ ": " term_, .part = LG_MACHINE_##part_, .unless = unless_,             \
        .asks = asks_, __VA_ARGS__                                                                           \
    }
#define FRICTION(name_, kind_, unless_, asks_, ...)                                                          \
    TERM(name_, "damping", DAMPING, "{kind: " kind_ "}", unless_, asks_, __VA_ARGS__)
#define INPUTS(name_, key_, value_, unless_, applies_, asks_)                                                \
    TERM(name_, "inputs", ACTUATOR, "{" key_ ": " value_ "}", unless_, asks_, .value = value_,               \
         .applies = applies_)
#define SPRING(name_, kind_, unless_, asks_)                                                                 \
    TERM(name_ "spring of %P", "potential", POTENTIAL, "{kind: " kind_ ", of: %P}", unless_,                 \
         "a spring of %P" asks_, .each = true)
const lg_candidate lg_candidates[] = {
    TERM("offset", "offset", OFFSET, "unknown", "unknown known", "a constant force (an offset)"),
    FRICTION("viscous", "diagonal", "diagonal constant known network asymmetric", "viscous friction"),
    FRICTION("coulomb", "coulomb", "coulomb stribeck load position network", "Coulomb friction"),
    FRICTION("asymmetric", "asymmetric", "asymmetric network", "viscous friction that differs by direction",
             .offset = true),
    FRICTION("quadratic", "quadratic", "quadratic network",
             "friction that grows with the square of the velocity"),
    FRICTION("cubic", "cubic", "cubic network", "friction that grows with the cube of the velocity"),
    FRICTION("stribeck", "stribeck", "stribeck network", "friction that is larger near rest (Stribeck)"),
    INPUTS("hold zero", "hold", "zero", NULL, holds_otherwise, "inputs that are held between rows"),
    INPUTS("hold linear", "hold", "linear", NULL, holds_otherwise, "inputs that are lines between rows"),
    INPUTS("hold cubic", "hold", "cubic", NULL, holds_otherwise, "inputs that are smooth between rows"),
    INPUTS("delay 1", "delay", "1", NULL, delays_less, "a delay of the inputs by 1 row"),
    INPUTS("delay 2", "delay", "2", NULL, delays_less, "a delay of the inputs by 2 rows"),
    INPUTS("delay 4", "delay", "4", NULL, delays_less, "a delay of the inputs by 4 rows"),
    INPUTS("lag", "lag", "unknown", "lag second_order_lag", has_inputs, "a lag of the actuator"),
    INPUTS("second-order lag", "lag", "{order: 2}", "second_order_lag", lags_are_open,
           "a lag of second order of the actuator"),
    INPUTS("dead zone", "curve", "{dead_zone: unknown}", "dead_zone curve", has_inputs,
           "an actuator with a dead zone"),
    INPUTS("curve", "curve", "{degree: 2}", "dead_zone curve", has_inputs,
           "an actuator whose force also grows with the square of the input"),
    SPRING("", "quadratic", "quadratic polynomial network", ""),
    SPRING("quadratic ", "polynomial, degree: 3", "polynomial network", " whose force has a quadratic part"),
    SPRING("cubic ", "polynomial, degree: 4", "polynomial network", " whose force has a cubic part"),
    TERM("network of the velocities", "residual", RESIDUAL, "{kind: network, of: [%V], hidden: [8]}",
         "network", "a force of the velocities that no other candidate has (a network)", .last = true),
    {.name = NULL}};

/* ---- candidates for a machine ---- */

/* A candidate with its names filled in. */
typedef struct candidate {
    const lg_candidate *row;
    char change[LG_MACHINE_COORDINATES * (LG_MACHINE_NAME + 16) + 64], asks[128];
    lg_machine_trial trial;
    lg_suggested told; /* its row of the suggestion */
    bool offset;       /* the machine gets an offset too */
    const char *why;   /* why it does */
} candidate;

/* A round has candidates, some of them a second time with an offset, and last ones. */
enum { MOST = LG_SUGGEST_ROWS / LG_SUGGEST_ROUNDS / 3 };
#define LG_SUGGEST_MOST  0.97 /* a candidate leaves less than this */
#define LG_SUGGEST_CLEAR 0.8  /* a gain so large is worth more data, if it may be chance */

/* Puts names into a text. `line`: the coordinate that %P stands for. */
static void fill_in(const lg_machine *machine, const char *text, uint32_t line, char *out, size_t size) {
    out[0] = '\0';
    for (; *text != '\0'; text++) {
        if (*text != '%') {
            lg_append(out, size, "%c", *text);
            continue;
        }
        const bool all = *++text == 'V';
        const uint32_t first = all ? 0 : line, end = all ? machine->coordinate_count : line + 1;
        for (uint32_t i = first; i < end; i++)
            lg_append(out, size, "%s%s%s", i > first ? ", " : "", machine->coordinates[i].name,
                      all ? ".velocity" : "");
    }
}

static bool is_listed(const char *names, const char *name) {
    const size_t length = strlen(name);
    for (const char *at = names; at != NULL && *at != '\0';) {
        const size_t word = strcspn(at, " ");
        if (word == length && memcmp(at, name, length) == 0) return true;
        at += word + (at[word] == ' ');
    }
    return false;
}

/* Whether a term of the potential depends on the coordinate. */
static bool sees(const lg_machine_term *term, uint32_t coordinate) {
    for (uint32_t i = 0; i < term->of_count; i++)
        if (term->of[i].index == coordinate) return true;
    return false;
}

/* Whether the machine can get the candidate (for the line `line` with `each`). */
static bool is_open(const lg_machine_file *file, const lg_candidate *row, uint32_t line) {
    const lg_machine *machine = &file->machine;
    if (row->applies != NULL && !row->applies(file, row)) return false;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, row->part, &term);)
        if (is_listed(row->unless, lg_term_kind_name(term->kind)) && (!row->each || sees(term, line)))
            return false;
    return true;
}

static void add_candidate(const lg_machine *machine, const lg_candidate *row, uint32_t line, candidate *out,
                          size_t *count) {
    if (*count == MOST) return;
    candidate *c = &out[(*count)++];
    *c = (candidate){.row = row,
                     .offset = row->offset && !lg_machine_has_part(machine, LG_MACHINE_OFFSET),
                     .why = ", because at any single speed the two are the same"};
    fill_in(machine, row->name, line, c->told.name, sizeof c->told.name);
    fill_in(machine, row->change, line, c->change, sizeof c->change);
    fill_in(machine, row->asks, line, c->asks, sizeof c->asks);
}

static size_t list_candidates(const lg_machine_file *file, bool last, candidate *out) {
    const lg_machine *machine = &file->machine;
    size_t count = 0;
    for (const lg_candidate *row = lg_candidates; row->name != NULL; row++) {
        if (row->last != last) continue;
        if (!row->each && is_open(file, row, 0)) add_candidate(machine, row, 0, out, &count);
        for (uint32_t i = 0; i < machine->coordinate_count && row->each; i++)
            if (machine->coordinates[i].kind == LG_COORDINATE_LINE && is_open(file, row, i))
                add_candidate(machine, row, i, out, &count);
    }
    return count;
}

/* ---- rounds ---- */

/* What the rounds share. */
typedef struct search {
    lg_training *self;
    lg_machine_state *state;
    lg_choosing choosing;
    lg_machine_trial present; /* the machine so far */
    candidate list[2 * MOST]; /* candidates of the round */
    size_t count;
    uint32_t round;
    size_t first; /* the round's first row of the suggestion */
} search;

static lg_status try_candidate(search *s, candidate *c, lg_error *error) {
    c->told.round = s->round, c->told.chance = true;
    c->trial.text.context = s->choosing.quiet;
    lg_text_add(&c->trial.text, "%s" LG_MACHINE_CHANGE "%s\n%s", s->present.text.data, c->change,
                c->offset ? "offset: unknown\n" : "");
    const lg_status status = lg_machine_try(&s->choosing, &s->present, &c->trial, error);
    c->told.parameters = c->trial.learned.machine.parameters;
    if (status != LG_OK || c->trial.square == NULL) return status;
    const lg_held_out_ratio found =
        lg_held_out_compare(s->choosing.held.count, c->trial.square, s->present.square);
    c->told.ratio = found.ratio;
    c->told.chance = !found.better;
    return LG_OK;
}

/* Whether a candidate of the round, taken or not, has fewer parameters and leaves less. */
static bool is_dominated(const search *s, const candidate *c) {
    const lg_suggestion *all = &s->state->suggestion;
    const size_t parameters = c->trial.learned.machine.parameters;
    for (size_t i = s->first; i < all->count; i++)
        if (all->row[i].ratio > 0 && all->row[i].ratio < c->told.ratio && all->row[i].parameters < parameters)
            return true;
    return false;
}

/* The gain of a candidate is more than chance and 3 %, and no smaller one has a larger gain. */
static bool is_possible(const search *s, const candidate *c) {
    return !c->told.chance && c->told.ratio < LG_SUGGEST_MOST && !is_dominated(s, c);
}

/* The possible candidate with the smallest error. Of those that it does not clearly beat, the one with the
 * fewest parameters is taken, the first in the table of several. NULL: no candidate is possible. */
static candidate *find_best(search *s) {
    candidate *best = NULL, *simplest = NULL;
    for (size_t i = 0; i < s->count; i++) {
        candidate *c = &s->list[i];
        if (is_possible(s, c) && (best == NULL || c->told.ratio < best->told.ratio)) best = c;
    }
    for (size_t i = 0; i < s->count && best != NULL; i++) {
        candidate *c = &s->list[i];
        if (!is_possible(s, c) ||
            lg_held_out_compare(s->choosing.held.count, best->trial.square, c->trial.square).clear)
            continue;
        if (simplest == NULL ||
            c->trial.learned.machine.parameters < simplest->trial.learned.machine.parameters)
            simplest = c;
    }
    return simplest;
}

static int compare_ratios(const void *a, const void *b) {
    const double x = ((const lg_suggested *)a)->ratio, y = ((const lg_suggested *)b)->ratio;
    if ((x > 0) != (y > 0)) return x > 0 ? -1 : 1;
    return (x > y) - (x < y);
}

/* Adds, with an offset, the frictions that leave less, though by no more than chance: without it a constant
 * force spoils some of their runs. */
static void add_with_offset(search *s, const lg_machine *machine) {
    const size_t tried = lg_machine_has_part(machine, LG_MACHINE_OFFSET) ? 0 : s->count;
    for (size_t i = 0; i < tried; i++) {
        const candidate *from = &s->list[i];
        if (from->offset || !from->told.chance || from->row->part != LG_MACHINE_DAMPING ||
            !(from->told.ratio > 0 && from->told.ratio < LG_SUGGEST_MOST))
            continue;
        candidate *c = &s->list[s->count++];
        *c = *from;
        c->offset = true, c->why = "", c->told.ratio = 0, c->trial = (lg_machine_trial){.square = NULL};
        lg_append(c->told.name, sizeof c->told.name, " with an offset");
    }
}

/* Tries the candidates of the table, `last` ones or the others, and notes them. *taken: the best, or NULL. */
static lg_status try_all(search *s, const lg_machine_file *file, bool last, candidate **taken,
                         lg_error *error) {
    lg_suggestion *out = &s->state->suggestion;
    lg_suggested *rows = out->row + out->count;
    size_t done = s->count = list_candidates(file, last, s->list);
    for (size_t i = 0; i < done; i++) LG_TRY(try_candidate(s, &s->list[i], error));
    if (!last) add_with_offset(s, &file->machine);
    for (; done < s->count; done++) LG_TRY(try_candidate(s, &s->list[done], error));
    for (size_t i = 0; i < s->count; i++) out->row[out->count++] = s->list[i].told;
    *taken = find_best(s);
    if (*taken != NULL) rows[*taken - s->list].taken = true;
    qsort(rows, s->count, sizeof *rows, compare_ratios);
    return LG_OK;
}

static void drop_round(search *s) {
    for (size_t i = 0; i < s->count; i++) lg_machine_trial_destroy(&s->choosing, &s->list[i].trial);
    s->count = 0;
}

/* One round. *more: a candidate was taken. */
static lg_status play_round(search *s, bool *more, lg_error *error) {
    static const double small = 0.01; /* part of the motion: a smaller error of the runs ends the search */
    LG_CLEAN(lg_machine_file_destroy) lg_machine_file file = {.text = NULL};
    candidate *taken = NULL;
    s->first = s->state->suggestion.count;
    LG_TRY(lg_machine_file_parse(s->choosing.quiet, s->self->paths[0], s->present.text.data,
                                 s->present.text.length, &file, error));
    LG_TRY(try_all(s, &file, false, &taken, error));
    if (taken == NULL && lg_held_out_error(&s->choosing.held, s->present.square) > small) {
        drop_round(s);
        LG_TRY(try_all(s, &file, true, &taken, error));
    }
    *more = taken != NULL;
    if (!*more) return LG_OK;
    LG_WARN(
        s->self,
        "the log asks for %s%s%s: it leaves %.2g of the error (free runs of %.3g s that were not trained on)",
        taken->asks, taken->offset ? ", and for a constant force (an offset)" : "",
        taken->offset ? taken->why : "", taken->told.ratio, s->state->suggestion.seconds);
    lg_machine_trial_destroy(&s->choosing, &s->present);
    s->present = taken->trial;
    taken->trial = (lg_machine_trial){.square = NULL};
    return LG_OK;
}

static lg_status search_all(search *s, lg_error *error) {
    bool more = true;
    s->present.text.context = s->choosing.quiet;
    lg_text_append(&s->present.text, s->state->data.file.text, s->state->data.file.text_bytes);
    LG_TRY(lg_machine_try(&s->choosing, NULL, &s->present, error));
    if (s->present.square == NULL) return lg_fail(error, s->present.status, "%s", s->present.why.message);
    for (s->round = 1; s->round <= LG_SUGGEST_ROUNDS && more; s->round++) {
        const lg_status status = play_round(s, &more, error);
        drop_round(s);
        if (status != LG_OK) return status;
    }
    s->state->suggestion.ended = !more;
    return LG_OK;
}

/* ---- results ---- */

static lg_status write_machine(lg_training *self, lg_error *error) {
    const lg_machine_state *state = self->state;
    if (strcmp(state->suggest, "-") == 0) return LG_OK;
    const char *text = state->data.file.text;
    const size_t head = sizeof LG_SUGGEST_HEAD - 1, bytes = state->data.file.text_bytes,
                 known = strncmp(text, LG_SUGGEST_HEAD, head) == 0 ? head : 0;
    LG_TRY_SCRATCH(char, whole, self->context, head + bytes - known, lg_no_memory(error));
    memcpy(whole, LG_SUGGEST_HEAD, head);
    memcpy(whole + head, text + known, bytes - known);
    const lg_status status = lg_file_write(self->context, state->suggest, whole, head + bytes - known, error);
    if (status != LG_OK) self->failed = state->suggest;
    return status;
}

lg_status lg_machine_suggest(lg_training *self, lg_error *error) {
    enum { MOST_WINDOWS = 150, ENOUGH = 2 * LG_HELD_OUT_WINDOWS };
    static const double part = 0.2, larger = 0.4;
    lg_machine_state *state = self->state;
    LG_TRY_SCRATCH(search, s, self->context, 1, lg_no_memory(error));
    s->self = self;
    s->state = state;
    lg_status status = lg_choosing_begin(&s->choosing, self, part, LG_HELD_OUT_WINDOWS, MOST_WINDOWS, error);
    if (status == LG_OK && s->choosing.held.count < ENOUGH) {
        lg_choosing_end(&s->choosing);
        status = lg_choosing_begin(&s->choosing, self, larger, ENOUGH, MOST_WINDOWS, error);
    }
    state->suggestion.windows = s->choosing.held.count;
    state->suggestion.seconds = (double)s->choosing.held.steps * state->data.logs.dt_median;
    if (status == LG_OK && s->choosing.held.count == 0)
        status = lg_fail(error, LG_FORMAT, "%s: the log is too short to hold out windows for --suggest",
                         lg_shown_path(state->data.paths[0]));
    if (status == LG_OK) status = search_all(s, error);
    if (status == LG_OK) status = lg_machine_reread(self, &s->present.text, error);
    if (status == LG_OK) status = write_machine(self, error);
    lg_machine_trial_destroy(&s->choosing, &s->present);
    lg_choosing_end(&s->choosing);
    return status;
}

void lg_machine_conclude_suggestion(const lg_training *self, bool explained) {
    const lg_machine_state *state = self->state;
    const lg_suggestion *what = &state->suggestion;
    const lg_suggested *best = NULL;
    if (state->suggest == NULL || !what->ended || what->count == 0) return;
    const uint32_t last = what->row[what->count - 1].round;
    for (uint32_t i = 0; i < what->count; i++) {
        const lg_suggested *row = &what->row[i];
        if (row->round == last && row->ratio > 0 && (best == NULL || row->ratio < best->ratio)) best = row;
    }
    if (best != NULL && best->ratio < LG_SUGGEST_CLEAR && !explained)
        LG_WARN(self,
                "too few data to decide on a further term: %s leaves %.2g of the error, which %zu windows do "
                "not distinguish from chance; give longer logs, or more of them",
                best->name, best->ratio, what->windows);
    else
        LG_WARN(self, "%s no candidate leaves less of the error than chance explains",
                explained ? "the log asks for no further term:"
                          : "what the model lacks is not among the candidates:");
}

void lg_machine_tell_suggestion(lg_training *self) {
    const lg_machine_state *state = self->state;
    const lg_suggestion *what = &state->suggestion;
    if (state->suggest == NULL) return;
    lg_result_open(self, "suggested", '[');
    for (uint32_t i = 0; i < what->count; i++)
        if (what->row[i].taken) lg_result_add(self, LG_TEXT(NULL, what->row[i].name, NULL));
    lg_result_close(self, ']');
    lg_result_table(self, "candidates", '[', "");
    for (uint32_t i = 0; i < what->count; i++) {
        const lg_suggested *row = &what->row[i];
        LG_RESULT_OBJECT(self, NULL, LG_AS_WHOLE("round", row->round), LG_AS_TEXT("name", row->name),
                         LG_AS_ROUNDED("ratio", row->ratio > 0 ? row->ratio : NAN, 3),
                         LG_AS_WHOLE("parameters", row->parameters),
                         LG_FOR_PEOPLE("outcome", !(row->ratio > 0) ? "cannot be learned"
                                                  : row->taken      ? "taken"
                                                  : row->chance     ? "no more than chance"
                                                                    : ""));
    }
    lg_result_close(self, ']');
}
