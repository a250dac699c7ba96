/* Judges how well a learned machine explains its logs, and what the logs say of its numbers. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "machine/files/choice.h"

/* ---- position at which a network mass is reported ---- */

static void find_place(const lg_machine_problem *problem, lg_machine_verdict *out) {
    const lg_machine *machine = problem->machine;
    out->placed = lg_machine_mass_at(problem, out->positions);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at) && out->placed;) {
        for (uint32_t k = 0; k < at.positions && lg_machine_sees(machine, LG_MACHINE_MASS, at.index); k++)
            lg_append(out->place, sizeof out->place, "%s%s %.3g",
                      k > 0                   ? ","
                      : out->place[0] != '\0' ? ", "
                                              : "at ",
                      k > 0 ? "" : machine->coordinates[at.index].name, out->positions[at.position + k]);
    }
}

/* ---- numbers and their common factor ---- */

void lg_machine_warn_of_gauge(const lg_context *context, const lg_machine *machine) {
    if (machine->normalised)
        lg_log_message(context, LG_LOG_WARNING,
                       "nothing in the machine's file fixes the scale of the forces, a common factor of "
                       "mass, potential, damping and input map: one mass, which has no standard error, is "
                       "set to 1; to fix the scale, give a mass or the input map");
    if (machine->free_gauge)
        lg_log_message(
            context, LG_LOG_WARNING,
            "nothing fixes the common factor of mass, potential, damping and input map, the scale of the "
            "forces: "
            "only their ratios are meaningful; give the input map, or a mass that is known or constant");
}

/* Keeps the open directions in which more than one number moves, and drops the other directions. */
static void keep_several(lg_identification *of, size_t count) {
    size_t kept = 0;
    for (size_t k = 0; k < of->open_count; k++)
        if (lg_identification_sentence(of, count, k, NULL, 0) > 1)
            memmove(of->open + kept++ * count, of->open + k * count, count * sizeof *of->open);
    of->open_count = kept;
}

/* The first number that moves in the first open direction; without open directions the first of all
 * numbers. */
static const lg_identified *first_open(const lg_identification *of, size_t count) {
    size_t i = 0;
    while (of->open_count > 0 && i + 1 < count && of->open[i] == 0.0) i++;
    return count > 0 ? &of->numbers[i] : NULL;
}

/* Whether two names are of one kind, which means that their first words are equal: "mass" of "mass.1.2", "I"
 * of the label "I2". */
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

/* Whether an open direction moves number i or a number of the same kind. */
static bool is_open(const lg_identification *of, size_t count, size_t i) {
    for (size_t k = 0; k < of->open_count; k++)
        for (size_t j = 0; j < count; j++)
            if (of->open[k * count + j] != 0.0 && are_alike(of->numbers[i].name, of->numbers[j].name))
                return true;
    return false;
}

/* Whether the fit has gone as far as the errors of its numbers claim: its method has ended, or a further step
 * would change no number by more than its error. Few evaluations are no evidence of it. */
static bool has_converged(const lg_training *self, const lg_machine_verdict *what) {
    enum { FEW = 5 };
    const lg_fit_end end = lg_fit_why_finished(self->fit);
    if (end == LG_FIT_END_MINIMISER || end == LG_FIT_END_PATIENCE) return true;
    return lg_fit_epochs_done(self->fit) >= FEW && what->identified.step <= 1.0;
}

/* Numbers of a fit that has not converged have no errors. */
static void drop_errors(const lg_training *self, lg_machine_verdict *what) {
    lg_identification *of = &what->identified;
    if (what->converged || what->count == 0) return;
    char why[128] = "it had too few evaluations";
    if (of->step > 1.0)
        (void)lg_format(why, sizeof why,
                        "a further step would change a number by %.2g times its standard error", of->step);
    LG_WARN(
        self,
        "the fit has not converged (%s): %s, so no standard errors are given; give more epochs or seconds",
        lg_fit_end_sentence(self->fit), why);
    for (size_t i = 0; i < what->count; i++) of->numbers[i].error = NAN;
    for (size_t i = 0; i < what->count * what->count; i++) of->correlations[i] = 0.0;
    of->spread = NULL;
    of->open_count = 0;
    of->block = 0.0;
}

static void warn_of_open(const lg_training *self, const lg_identification *of, size_t count) {
    char text[512];
    for (size_t k = 0; k < of->open_count; k++) {
        (void)lg_identification_sentence(of, count, k, text, sizeof text);
        LG_WARN(self, "%s", text);
    }
}

/* Accelerations show a position only through what depends on it. */
static void warn_of_positions(const lg_training *self, const lg_machine *machine) {
    for (uint32_t i = 0; i < machine->coordinate_count && machine->accelerations; i++)
        if (!lg_machine_sees_position(machine, i))
            LG_WARN(
                self,
                "where %s is cannot be known: the log has accelerations alone, and nothing in the machine "
                "depends on this position",
                machine->coordinates[i].name);
}

/* Warns of numbers whose error exceeds their value, unless the error is next to nothing against the largest
 * number of the same kind. */
static void warn_of_numbers(const lg_training *self, const lg_machine_verdict *what) {
    static const double nothing = 0.02;
    const lg_identification *of = &what->identified;
    const size_t count = what->count;
    const lg_identified *numbers = of->numbers;
    const bool zeros = lg_machine_run_of(self)->machine.accelerations;
    for (size_t i = 0; i < count; i++) {
        const double error = numbers[i].error;
        if (isnan(error) || error <= fabs(numbers[i].value) ||
            error < nothing * largest_alike(numbers, count, i))
            continue;
        if (is_open(of, count, i)) continue;
        const bool told = what->placed && strncmp(numbers[i].name, "mass.", strlen("mass.")) == 0;
        LG_WARN(self,
                "the logs do not determine %s%s%s: %.3g with a standard error of %.2g; give it as "
                "known, or move the machine in other ways%s",
                numbers[i].name, told ? " " : "", told ? what->place : "", numbers[i].value, error,
                zeros && strncmp(numbers[i].name, "potential.", strlen("potential.")) == 0
                    ? ". Accelerations do not show which position is 0: say it by a number of the potential "
                      "that is known, such as 0"
                    : "");
    }
}

/* ---- the loss ---- */

/* The loss to expect of a model that explains the logs: what their noise leaves, for numbers without noise
 * what .8 % of the forces would make, and the steps' error, which counts at most as much as all of these. */
static lg_status find_expected(const lg_training *self, const double *theta, lg_machine_verdict *what,
                               lg_error *error) {
    static const double small = 8e-3;
    const lg_machine_state *s = self->state;
    const uint32_t coordinates = s->problem.machine->coordinate_count;
    lg_machine_noise noise;
    lg_machine_expected expected;
    lg_machine_data_traces(&s->data, &noise);
    for (uint32_t i = 0; i < coordinates; i++)
        if (s->noise.position[i] > 0.0) noise.position[i] = s->noise.position[i];
    LG_TRY(lg_machine_expect(self->context, &s->problem, theta, &noise, &expected, error));
    what->tolerated =
        /* A model whose runs are not finite must not make a large loss acceptable. */
        isfinite(expected.loss) ? expected.loss : 0.0;
    for (uint32_t i = 0; i < coordinates; i++) {
        what->forces += expected.change.position[i] + expected.change.velocity[i];
        if (!(s->noise.position[i] > 0.0)) what->tolerated += small * small * expected.change.position[i];
        if (!(s->noise.velocity[i] > 0.0)) what->tolerated += small * small * expected.change.velocity[i];
    }
    what->expected = what->tolerated + fmin(expected.steps, what->tolerated);
    return LG_OK;
}

/* Whether forces are missing: at least a ten-thousandth of all forces, and more than chance or the error of
 * the steps explains. */
static bool are_missing(const lg_machine_verdict *what, double floor) {
    static const double chance = 8.0, least = 1e-4;
    const lg_machine_missing *missing = &what->missing;
    return missing->ratio > chance && missing->loss > fmax(floor, least * least * what->forces);
}

/* Returns whether the model explains the logs. */
static bool warn_of_misfit(const lg_training *self, const lg_machine_verdict *what) {
    const lg_machine_model_run *run = self->run;
    /* Long steps do not make a large loss acceptable, but they may be the reason for it. */
    const double floor = self->floor, explained = fmax(what->expected, what->tolerated + floor);
    /* The loss may exceed the expected loss by half and by four standard deviations of its random
     * variation. */
    const double numbers = 2.0 * (double)run->windows * run->window * run->machine.velocities,
                 more = 1.5 + 4.0 * sqrt(2.0 / numbers);
    if (floor > what->tolerated)
        LG_WARN(
            self,
            "the integrator's steps are too long: their error is %.2g in units of the loss, but noise and "
            "small errors of the forces make only %.2g; give more --substeps, otherwise the loss does not "
            "show whether the model explains the logs",
            floor, what->tolerated);
    const bool large = what->loss > more * explained, missing = are_missing(what, floor);
    char size[128] = "", forces[256] = "";
    if (large)
        (void)lg_format(
            size, sizeof size,
            "the loss is %.2g, but noise, small errors of the forces and the steps explain at most %.2g",
            what->loss, explained);
    if (missing)
        (void)lg_format(forces, sizeof forces,
                        "forces that the model lacks (functions of positions, velocities and inputs, about "
                        "%.2g %% of all forces) make %.2g of the loss of %.2g",
                        100.0 * sqrt(what->missing.loss / what->forces), what->missing.loss, what->loss);
    if (large || missing)
        LG_WARN(self,
                "the model does not explain the logs: %s%s%s%s. Train "
                "more epochs if the loss still falls; otherwise a term is missing%s",
                size, large && missing ? "; " : "", forces,
                what->identified.block > 0.0 || !what->converged ? ""
                                                                 : "; the standard errors are too small then",
                large ? ", or the logs are wrong: check the sign, order and delay of the inputs, and whether "
                        "all sensors have one clock"
                      : "");
    return !large && !missing;
}

/* Near the floor more training fits the error of the steps, and not the machine. A floor below
 * LG_MACHINE_FLOOR does not matter. The number of steps was chosen by the same bound, but before the networks
 * were trained. */
static void warn_of_floor(const lg_training *self, const lg_machine_verdict *what) {
    static const double near_floor = 3.0;
    const lg_machine_model_run *run = self->run;
    const double floor = self->floor;
    if (what->loss > near_floor * floor || floor <= LG_MACHINE_FLOOR || floor > what->tolerated) return;
    LG_WARN(self,
            "the error of the integrator with %u step%s between two rows, %.2g in units of the loss, is not "
            "small against the loss %.2g: give --substeps %u for a better model",
            run->substeps, run->substeps == 1 ? "" : "s", floor, what->loss, 2 * run->substeps);
}

/* ---- lags that were learned ---- */

static const char not_shown[] = "no lag that the log shows";
static const double least_rows = 0.2; /* scales.lag[0], in rows */

/* The learned lag of this input; NULL: none was learned. */
static const lg_identified *find_lag(const lg_machine_verdict *what, const char *input) {
    for (size_t i = 0; i < what->count; i++) {
        const lg_identified *number = &what->identified.numbers[i];
        if (strncmp(number->name, "lag.", 4) == 0 && strcmp(number->name + 4, input) == 0) return number;
    }
    return NULL;
}

/* The log shows no lag below its step, however small its stated error is. */
static bool is_shown(const lg_machine *machine, const lg_identified *lag) {
    return lag->value >= machine->scales.lag[0] / least_rows;
}

/* Warns if the fitted lag is near an end of the range in which it is searched. */
static void warn_of_lags(const lg_training *self, const lg_machine_verdict *what) {
    static const double near_high = 0.95;
    const lg_machine *machine = &lg_machine_run_of(self)->machine;
    const double *range = machine->scales.lag;
    for (uint32_t i = 0; i < machine->input_count; i++) {
        const lg_identified *lag = find_lag(what, machine->inputs[i]);
        if (lag == NULL) continue;
        if (!is_shown(machine, lag))
            LG_WARN(self,
                    "%s: %s: %.3g s is below the step between two rows, %.3g s; take `lag: none` for %s",
                    lag->name, not_shown, lag->value, range[0] / least_rows, machine->inputs[i]);
        if (lag->value > near_high * range[1])
            LG_WARN(self,
                    "%s: %.3g s is the longest lag that these logs can show: they have no part that is "
                    "longer than five such times",
                    lag->name, lag->value);
    }
}

/* The time constant of an input in seconds, learned or known; 0: it has no lag. */
static double lag_of(const lg_machine *machine, const lg_machine_verdict *what, uint32_t input) {
    const lg_identified *learned = find_lag(what, machine->inputs[input]);
    if (learned != NULL) return learned->value;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        for (uint32_t k = 0; k < term->of_count && term->kind->order > 0; k++)
            if (term->of[k].index == input) return term->values[k];
    return 0.0;
}

/* Writes the losses from each start of the scan, which is named by its seconds. */
static lg_status tell_ratios(lg_training *self, lg_error *error) {
    enum { ROOM = 24 };
    const lg_machine_state *s = self->state;
    const double row = lg_machine_run_of(self)->machine.scales.lag[0] / least_rows;
    char *text;
    LG_TRAINING_ARRAY(self, text, ROOM * LG_LAG_STARTS, error);
    lg_result_open(self, "ratios", '{');
    for (size_t i = 0; i < LG_LAG_STARTS; i++, text += ROOM) {
        (void)lg_format(text, ROOM, "%.6g", lg_lag_starts[i] * row);
        if (s->lag_ratios[i] > 0) LG_TELL(self, LG_REAL(text, s->lag_ratios[i], NULL));
    }
    lg_result_close(self, '}');
    return LG_OK;
}

/* Writes {"chosen": seconds, or with several inputs a list where 0 is no lag; "ratios": {seconds of a start:
 * its loss divided by the least one}}, and a sentence "warning" if the log does not show one of the lags.
 * Nothing if no lag was learned. */
static lg_status tell_lags(lg_training *self, const lg_machine_verdict *what, lg_error *error) {
    const lg_machine *machine = &lg_machine_run_of(self)->machine;
    const uint32_t n = machine->input_count;
    bool learned = false, shown = true;
    for (uint32_t i = 0; i < n; i++) {
        const lg_identified *lag = find_lag(what, machine->inputs[i]);
        learned = learned || lag != NULL;
        shown = shown && (lag == NULL || is_shown(machine, lag));
    }
    if (!learned) return LG_OK;
    lg_result_open(self, "lag", '{');
    if (n > 1) lg_result_open(self, "chosen", '[');
    for (uint32_t i = 0; i < n; i++)
        lg_result_add(self, LG_REAL(n > 1 ? NULL : "chosen", lag_of(machine, what, i), NULL));
    if (n > 1) lg_result_close(self, ']');
    LG_TRY(tell_ratios(self, error));
    if (!shown) LG_TELL(self, LG_TEXT("warning", not_shown, NULL));
    lg_result_close(self, '}');
    return LG_OK;
}

/* ---- results ---- */

/* Writes {name: {value, error}}. */
static void tell_numbers(lg_training *self, const lg_machine_verdict *what) {
    lg_result_table(self, "identified", '{', "identified");
    for (size_t i = 0; i < what->count; i++) {
        const lg_identified *number = &what->identified.numbers[i];
        LG_RESULT_OBJECT(self, number->name, LG_AS_REAL("value", number->value),
                         LG_AS_ROUNDED("error", number->error, 2));
    }
    lg_result_close(self, '}');
}

/* Writes whether the standard errors are those of white residuals. */
static void tell_errors(lg_training *self, const lg_machine_verdict *what) {
    if (!what->converged) {
        if (what->count > 0) LG_TELL(self, LG_TEXT("errors", "the fit has not converged", NULL));
        return;
    }
    const bool white = !(what->identified.block > 0.0);
    if (what->count > 0)
        LG_TELL(self, LG_TEXT("errors", white ? "white" : "corrected for correlation",
                              white ? NULL : "the residuals are correlated in time"));
}

/* Writes {coordinate: its positions}. */
static void tell_place(lg_training *self, const lg_machine *machine, const lg_machine_verdict *what) {
    if (!what->placed) return;
    lg_result_open(self, "mass_at", '{');
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
        LG_TELL(self, LG_AS_REALS(machine->coordinates[at.index].name, what->positions + at.position,
                                  at.positions));
    lg_result_close(self, '}');
}

/* Writes {"a,b": r} for pairs of numbers with a correlation |r| above .9. */
static lg_status tell_correlations(lg_training *self, const lg_machine_verdict *what, lg_error *error) {
    enum { BOTH = 2 * LG_IDENTIFIED_NAME + 2 };
    static const double strong = 0.9;
    const lg_identification *of = &what->identified;
    lg_result_open(self, "correlations", '{');
    for (size_t i = 0; i < what->count; i++)
        for (size_t j = i + 1; j < what->count; j++) {
            const double r = of->correlations[i * what->count + j];
            char *both;
            if (!(fabs(r) > strong)) continue;
            LG_TRAINING_ARRAY(self, both, BOTH, error);
            (void)snprintf(both, BOTH, "%s,%s", of->numbers[i].name, of->numbers[j].name);
            LG_TELL(self, LG_REAL(both, r, NULL));
        }
    lg_result_close(self, '}');
    return LG_OK;
}

/* Writes what fixes the common factor. If nothing does, names a number and the value at which learning left
 * it. */
static void tell_gauge(lg_training *self, const lg_machine *machine, lg_machine_verdict *what) {
    const lg_identified *open = first_open(&what->identified, what->count);
    const bool free = machine->free_gauge || what->identified.open_count > 0;
    (void)snprintf(what->gauge, sizeof what->gauge, "the values given in the machine's file");
    if (machine->normalised)
        (void)snprintf(what->gauge, sizeof what->gauge, "one mass is 1 in the units of the logs");
    else if (free && open == NULL)
        (void)snprintf(what->gauge, sizeof what->gauge, "nothing");
    else if (free)
        (void)lg_format(what->gauge, sizeof what->gauge, "nothing: learning left %s at %.6g", open->name,
                        open->value);
    LG_TELL(self, LG_TEXT("gauge", what->gauge, NULL));
}

static lg_status tell(lg_training *self, lg_machine_verdict *what, lg_error *error) {
    const lg_machine_model_run *run = self->run;
    const lg_machine *machine = &run->machine;
    LG_TELL(
        self, LG_REAL("loss", what->loss, "mean over windows and rows"),
        LG_REAL("expected_loss", what->expected, "of a model that explains the logs"),
        LG_REAL("validation", lg_training_validation(self), "loss of the windows that are not trained on"),
        LG_WHOLE("windows", run->windows, NULL), LG_WHOLE("parameters", machine->parameters, NULL));
    if (run->start_rows > 0)
        LG_TELL(self, LG_WHOLE("start_rows", run->start_rows, "rows that estimate the state at a start"));
    tell_numbers(self, what);
    tell_errors(self, what);
    tell_place(self, machine, what);
    LG_TRY(tell_correlations(self, what, error));
    tell_gauge(self, machine, what);
    lg_machine_tell_inputs(self);
    LG_TRY(tell_lags(self, what, error));
    lg_machine_tell_suggestion(self);
    lg_machine_tell_selection(self);
    self->first_count = self->result_count;
    return LG_OK;
}

/* ---- hook of the trainer ---- */

static lg_status find_numbers(lg_training *self, const double *theta, lg_machine_verdict *out,
                              lg_error *error) {
    const lg_machine_problem *problem = &lg_machine_state_of(self)->problem;
    const size_t n = problem->machine->parameters,
                 count = lg_machine_numbers(problem->machine, theta, 0, NULL);
    lg_identification *of = &out->identified;
    out->count = count;
    LG_TRAINING_ARRAY(self, of->numbers, count + 1, error);
    LG_TRAINING_ARRAY(self, of->correlations, count * count + 1, error);
    LG_TRAINING_ARRAY(self, of->open, count * count + 1, error);
    if (n <= LG_MACHINE_MOST_SPREAD) LG_TRAINING_ARRAY(self, of->spread, n * n + 1, error);
    of->prior = lg_machine_run_of(self)->training.prior;
    LG_TRY(lg_machine_identify(self->context, problem, theta, of, error));
    LG_TRY(lg_machine_widen(self, theta, count, of, error));
    keep_several(of, count);
    out->converged = has_converged(self, out);
    return LG_OK;
}

/* What needs the states that no column shows: how starts are estimated, and the range of these states. */
static lg_status find_states(lg_training *self, const double *theta, lg_error *error) {
    const lg_machine_state *s = self->state;
    lg_machine_model_run *run = self->run;
    lg_learned_machine model = lg_model_learned(self->context, run, theta, s->estimated);
    if (!s->estimated) return LG_OK;
    LG_TRY(lg_machine_choose_start_rows(&model, &s->data.logs.log, error));
    run->start_rows = model.start_rows;
    return lg_machine_widen_range(&model, &s->problem, &run->range, error);
}

lg_status lg_machine_judge(lg_training *self, double *theta, lg_error *error) {
    lg_machine_state *s = self->state;
    const lg_machine *machine = s->problem.machine;
    lg_machine_verdict *what = &s->verdict;
    *what = (lg_machine_verdict){.loss = 0.0};
    LG_TRY(lg_machine_select_end(self, theta, error));
    lg_machine_wrap_biases(machine, theta);
    LG_TRY(lg_machine_loss(self->context, &s->problem, theta, &what->loss, &self->floor, error));
    if (!isfinite(what->loss)) return LG_NOT_FINITE;
    LG_TRY(find_expected(self, theta, what, error));
    LG_TRY(lg_machine_find_missing(self->context, &s->problem, theta, &what->missing, error));
    find_place(&s->problem, what);
    LG_TRY(find_numbers(self, theta, what, error));
    LG_TRY(find_states(self, theta, error));
    drop_errors(self, what);
    if (machine->normalised || machine->grey.system == NULL) lg_machine_warn_of_gauge(self->context, machine);
    lg_machine_conclude_suggestion(self, warn_of_misfit(self, what));
    warn_of_floor(self, what);
    warn_of_open(self, &what->identified, what->count);
    warn_of_numbers(self, what);
    warn_of_positions(self, machine);
    warn_of_lags(self, what);
    return tell(self, what, error);
}
