/* train --size auto: a race of a few widths on a validation part. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/train.h"

static const double PART = 0.2, TIE = 2.0; /* of the data; a smaller network may be so much worse */
enum { EPOCHS_DIVISOR = 6 };

/* Trains one width for a sixth of the epochs. */
static lg_status run_lane(app *self, const train_task *task, app_slot *slot, train_lane *lane,
                          lg_error *error) {
    const double begin = app_seconds();
    const lg_training kept = *task->training;
    lg_fit *fit = NULL;
    lg_status status = app_store(slot, lane->size, error);
    task->training->seed = self->seed;
    if (status == LG_OK) status = task->describe(task->user, self, NULL, error);
    const uint64_t planned = train_epochs(self, task->training);
    task->training->epochs = planned / EPOCHS_DIVISOR > 0 ? planned / EPOCHS_DIVISOR : 1;
    task->training->validation = PART;
    task->training->patience = 0;
    if (status == LG_OK && task->prepare != NULL && task->prepare(task->user, self) != APP_EXIT_OK)
        status = app_error(error, LG_INVALID_ARGUMENT, "the data cannot be split");
    const lg_fit_options options = train_fit_options(self, task->training);
    if (status == LG_OK) status = task->create(task->user, self, &options, &fit, error);
    if (status == LG_OK) status = lg_fit_run(fit, error);
    if (status == LG_OK) {
        lane->parameters = task->parameters(task->user);
        lane->validation = lg_fit_history(fit, LG_FIT_VALIDATION)[lg_fit_best_epoch(fit) - 1];
    }
    task->release(task->user);
    *task->training = kept;
    lane->seconds = app_seconds() - begin;
    return status;
}

/* The smallest network whose loss is within TIE of the lowest. */
static size_t winner(const train_race *race) {
    double lowest = INFINITY;
    size_t best = 0;
    for (size_t i = 0; i < race->count; i++) lowest = fmin(lowest, race->lane[i].validation);
    for (size_t i = race->count; i-- > 0;)
        if (race->lane[i].validation <= TIE * lowest) best = i;
    return best;
}

static void print_race(const train_race *race) {
    app_table table;
    app_table_begin(&table, 4);
    static const char *const heads[] = {"size", "parameters", "validation loss", "seconds"};
    for (size_t c = 0; c < LG_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t i = 0; i < race->count; i++) {
        app_table_cell(&table, "%s%s", race->lane[i].size, i == race->winner ? " *" : "");
        app_table_cell(&table, "%zu", race->lane[i].parameters);
        app_table_cell(&table, "%.3e", race->lane[i].validation);
        app_table_cell(&table, "%.1f", race->lane[i].seconds);
    }
    app_table_end(&table, stderr);
}

int train_size(app *self, const train_task *task, const char *size, train_race *race) {
    lg_error error = {LG_OK, ""};
    *race = (train_race){.count = 0};
    if (size == NULL) return APP_EXIT_OK;
    app_slot *slot = task->sizes != NULL ? app_find_slot(self, "hidden") : NULL;
    if (slot == NULL) return app_usage(self, "--size: this network has no width to choose");
    if (slot->given) return app_usage(self, "--size and --hidden say the same; give one of them");
    if (strcmp(size, "auto") != 0) {
        if (app_store(slot, size, &error) == LG_OK) return APP_EXIT_OK;
        return app_usage(self, "--size: %s, or auto", error.message);
    }
    for (; task->sizes[race->count] != NULL && race->count < TRAIN_LANES; race->count++) {
        train_lane *lane = &race->lane[race->count];
        lane->size = task->sizes[race->count];
        const lg_status status = run_lane(self, task, slot, lane, &error);
        if (status != LG_OK)
            return app_fail(self, status, "--size auto, %s: %s", lane->size, app_sentence(status, &error));
    }
    race->winner = winner(race);
    print_race(race);
    (void)app_store(slot, race->lane[race->winner].size, NULL);
    return APP_EXIT_OK;
}

void train_size_json(const train_race *race, app_json *json) {
    if (race->count == 0) return;
    app_json_open(json, "sizes", '[');
    for (size_t i = 0; i < race->count; i++) {
        app_json_open(json, NULL, '{');
        app_json_text(json, "size", race->lane[i].size);
        app_json_size(json, "parameters", race->lane[i].parameters);
        app_json_real(json, "validation", race->lane[i].validation);
        app_json_real(json, "seconds", race->lane[i].seconds);
        app_json_close(json, '}');
    }
    app_json_close(json, ']');
}
