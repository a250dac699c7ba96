/* train --size auto: a race of networks of several widths, judged on a validation part of the data. */
#include <math.h>
#include <string.h>

#include "common/train.h"

/* PART: fraction of the data held out for validation. TIE: a smaller network wins if its forecast is at most
 * this factor above the lowest. SHARE: fraction of --seconds for the race. MOST_FALL: the forecast is at
 * least this fraction of the loss. FAST: a forecast below this fraction of the loss means that the loss still
 * falls fast. */
static const double PART = 0.2, TIE = 2.0, SHARE = 1.0 / 3.0, MOST_FALL = 1e-3, FAST = 0.25;
enum { EPOCHS_DIVISOR = 2, MOST_WORSE = 2 };

static double lowest(const double *values, uint64_t count) {
    double low = INFINITY;
    for (uint64_t i = 0; i < count; i++) low = fmin(low, values[i]);
    return low;
}

/* Reads the lowest validation loss and forecasts it for twice as many epochs. Errors fall as a power of the
 * number of epochs, so the next doubling of epochs is assumed to reduce the loss by the same factor as the
 * last one. */
static void read_lane(const lg_fit *fit, train_lane *lane) {
    const double *values = lg_fit_history(fit, LG_FIT_VALIDATION);
    const uint64_t done = lg_fit_epochs_done(fit);
    const double half = lowest(values, (done + 1) / 2);
    lane->validation = lowest(values, done);
    lane->forecast = lane->validation;
    if (lane->validation > 0.0 && isfinite(half)) lane->forecast *= fmax(lane->validation / half, MOST_FALL);
}

/* Trains a network of one width for half of the planned epochs and at most `seconds` (0: no limit). */
static lg_status run_lane(app *self, train_task *task, app_slot *slot, double seconds, train_lane *lane,
                          lg_error *error) {
    const double begin = app_seconds();
    lg_fit_settings *training = train_training(task);
    const lg_fit_settings kept = *training;
    lg_status status = app_store(slot, lane->size, error);
    training->seed = self->seed;
    if (status == LG_OK) status = train_describe(self, task, NULL, error);
    const uint64_t planned = train_epochs(self, training);
    training->epochs = planned / EPOCHS_DIVISOR > 0 ? planned / EPOCHS_DIVISOR : 1;
    training->validation = PART;
    training->patience = 0;
    if (status == LG_OK) train_prepare(self, task);
    lg_fit_options options = train_fit_options(self, training);
    options.seconds = seconds;
    if (status == LG_OK) status = train_create(task, &options, error);
    if (status == LG_OK) status = lg_fit_run(task->training.fit, error);
    if (status == LG_OK) {
        lane->parameters = lg_recipe_parameters(task->recipe, task->training.run);
        read_lane(task->training.fit, lane);
    }
    lg_training_release(&task->training);
    *training = kept;
    lane->seconds = app_seconds() - begin;
    /* All ranks use the time that rank 0 measured, so that they race the same networks. */
    if (status == LG_OK && self->ranks != NULL)
        status = lg_ranks_share(self->ranks, 0, &lane->seconds, sizeof lane->seconds);
    return status;
}

/* The factor that a network's forecast may be above the lowest one. It is 1 while the loss still falls fast:
 * such a network may be ahead of a larger one only for a while. */
static double tie(const train_lane *lane) {
    return lane->forecast < FAST * lane->validation ? 1.0 : TIE;
}

/* The smallest network whose forecast is at most its tie factor times the lowest forecast. */
static size_t winner(const train_race *race) {
    double low = INFINITY;
    size_t best = 0;
    for (size_t i = 0; i < race->count; i++) low = fmin(low, race->lane[i].forecast);
    for (size_t i = race->count; i-- > 0;)
        if (race->lane[i].forecast <= tie(&race->lane[i]) * low) best = i;
    return best;
}

/* Returns whether the race can end: the last MOST_WORSE networks did not beat a smaller one, or the time is
 * used up. */
static bool decided(const train_race *race) {
    const double seconds = train_given_files.seconds;
    if (seconds > 0.0 && train_race_seconds(race) >= SHARE * seconds) return true;
    return race->count > MOST_WORSE && winner(race) + MOST_WORSE < race->count;
}

double train_race_seconds(const train_race *race) {
    double sum = 0.0;
    for (size_t i = 0; i < race->count; i++) sum += race->lane[i].seconds;
    return sum;
}

/* Trains the networks from small to large; each gets an equal part of the race's time. */
static void run_race(app *self, train_task *task, app_slot *slot, train_race *race) {
    lg_error error = {LG_OK, ""};
    size_t count = 0;
    while (count < TRAIN_LANES && task->recipe->trainer->sizes[count] != NULL) count++;
    const double seconds = SHARE * train_given_files.seconds / (double)count;
    for (size_t i = 0; i < count && !decided(race); i++) {
        train_lane *lane = &race->lane[i];
        lane->size = task->recipe->trainer->sizes[i];
        const lg_status status = run_lane(self, task, slot, seconds, lane, &error);
        if (status != LG_OK)
            app_stop(self, status, "--size auto, %s: %s%s", lane->size, app_sentence(status, &error),
                     status == LG_CANCELLED ? "; the widths that were tried are not kept" : "");
        race->count++;
    }
}

void train_size(app *self, train_task *task, const char *size, train_race *race) {
    lg_error error = {LG_OK, ""};
    *race = (train_race){.count = 0};
    if (size == NULL) return;
    const lg_trainer *trainer = task->recipe->trainer;
    app_slot *slot = trainer->sizes != NULL ? app_find_slot(self, "hidden") : NULL;
    if (slot == NULL) app_stop_usage(self, "--size: the width of this network cannot be chosen");
    const bool automatic = strcmp(size, "auto") == 0;
    if (trainer->has_width != NULL && !trainer->has_width(&task->training)) {
        if (!automatic) app_stop_usage(self, "--size: this model has no network");
        app_warn(self, "--size auto: this model has no network, so there is no width to choose");
        return;
    }
    if (slot->given)
        app_stop_usage(self, "--size and --hidden both set the widths of the network; give one of them");
    if (!automatic) {
        if (app_store(slot, size, &error) != LG_OK)
            app_stop_usage(self, "--size: %s, or auto", error.message);
        return;
    }
    if (train_given_files.resume != NULL) return; /* the checkpoint stores the winner's size */
    run_race(self, task, slot, race);
    race->winner = winner(race);
    app_note(self, "--size auto: %s, of %zu widths", race->lane[race->winner].size, race->count);
    (void)app_store(slot, race->lane[race->winner].size, NULL);
}

void train_size_json(const train_race *race, app_json *json) {
    if (race->count == 0) return;
    app_result_rows(json, "sizes");
    for (size_t i = 0; i < race->count; i++)
        APP_OBJECT(json, NULL, LG_AS_TEXT("size", race->lane[i].size),
                   LG_AS_WHOLE("parameters", race->lane[i].parameters),
                   LG_AS_REAL("validation", race->lane[i].validation),
                   LG_AS_REAL("forecast", race->lane[i].forecast),
                   LG_AS_REAL("seconds", race->lane[i].seconds));
    app_result_rows_end(json);
}
