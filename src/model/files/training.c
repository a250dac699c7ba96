/* What all trainers share: memory, presets, results, loss, the model file. */
#include "model/files/training.h"
#include "core/widen.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

static bool none_given(const lg_training *self, const char *option) {
    return false;
}

lg_training lg_training_of(const lg_context *context, const lg_recipe *recipe, void *run, void *state) {
    return (lg_training){.context = context,
                         .recipe = recipe,
                         .run = run,
                         .state = state,
                         .threads = 1,
                         .given = none_given,
                         .floor = (double)NAN};
}

/* ---- memory ---- */

/* Precedes each array of lg_training_alloc; all blocks of a training form a list. */
struct lg_training_block {
    struct lg_training_block *next;
    char gap[LG_ALIGNMENT - sizeof(void *)];
};

void *lg_training_alloc(lg_training *self, size_t count, size_t size, lg_error *error) {
    struct lg_training_block *block = NULL;
    if (count <= (SIZE_MAX - sizeof *block) / size)
        block = lg_alloc(self->context, 1, sizeof *block + count * size);
    if (block == NULL) {
        (void)lg_fail(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters",
                      lg_recipe_parameters(self->recipe, self->run));
        return NULL;
    }
    block->next = self->blocks;
    self->blocks = block;
    return block + 1;
}

void lg_training_release(lg_training *self) {
    const lg_trainer *trainer = self->recipe->trainer;
    lg_fit_destroy(self->fit);
    if (trainer->release != NULL) trainer->release(self);
    while (self->blocks != NULL) {
        struct lg_training_block *next = self->blocks->next;
        lg_free(self->context, self->blocks);
        self->blocks = next;
    }
    lg_training_clear(self);
    self->fit = NULL;
    self->theta = NULL;
}

void lg_training_close(lg_training *self) {
    const lg_trainer *trainer = self->recipe->trainer;
    lg_training_release(self);
    if (trainer->close != NULL) trainer->close(self);
}

/* ---- the run ---- */

lg_fit_settings *lg_training_settings(const lg_training *self) {
    return (lg_fit_settings *)(void *)((char *)self->run + self->recipe->training);
}

static bool is_given(const lg_training *self, const lg_field *row) {
    char option[64];
    lg_field_option(row, option, sizeof option);
    return self->given(self, option);
}

void lg_training_adopt(lg_training *self, const void *from, bool preset) {
    for (const lg_field *row = self->recipe->fields; row->name != NULL; row++)
        if (!is_given(self, row) && !(preset && row->value != NULL)) lg_field_copy(row, from, self->run);
}

static bool asks_adam(const lg_training *self) {
    const lg_fit_settings *training = lg_training_settings(self);
    const size_t plan = self->recipe->training + offsetof(lg_fit_settings, plan);
    bool adam = training->dtype == LG_F32;
    for (const lg_field *row = self->recipe->fields; row->name != NULL; row++) {
        if (!is_given(self, row)) continue;
        if (row->offset == plan) return lg_fit_plan_ends_in_batches(&training->plan);
        adam = adam || row->adam;
    }
    return adam;
}

const char *lg_preset_name(uint32_t value) {
    static const char *const names[] = {"thesis", "best"};
    return value < LG_COUNT(names) ? names[value] : NULL;
}

const char *lg_training_preset(const lg_training *self) {
    if (self->preset != NULL) return self->preset;
    return lg_preset_name(asks_adam(self) ? 0 : 1);
}

/* ---- results ---- */

static bool make_room(lg_training *self) {
    const size_t room = 2 * self->result_room + 32;
    lg_result *longer = lg_widen(self->context, self->results, self->result_count, room, sizeof *longer);
    if (longer == NULL) return false;
    self->results = longer;
    self->result_room = room;
    return true;
}

void lg_training_clear(lg_training *self) {
    lg_free(self->context, self->results);
    self->results = NULL;
    self->result_count = self->result_room = self->first_count = 0;
}

void lg_result_add(lg_training *self, lg_result result) {
    self->results_lost = self->results_lost || (self->result_count == self->result_room && !make_room(self));
    if (!self->results_lost) self->results[self->result_count++] = result;
}

void lg_result_list(lg_training *self, const lg_result *results) {
    for (; results->name != NULL; results++) lg_result_add(self, *results);
}

void lg_result_object(lg_training *self, const char *name, const lg_result *members) {
    lg_result_open(self, name, '{');
    lg_result_list(self, members);
    lg_result_close(self, '}');
}

double lg_guess_class(const uint64_t *confusion, uint32_t classes) {
    uint64_t most = 0, all = 0;
    for (uint32_t i = 0; i < classes; i++) {
        uint64_t members = 0;
        for (uint32_t j = 0; j < classes; j++) members += *confusion++;
        if (members > most) most = members;
        all += members;
    }
    return 1.0 - (double)most / (double)all;
}

const lg_result *lg_result_find(const lg_training *self, const char *name) {
    size_t depth = 0;
    for (size_t i = 0; i < self->result_count; i++) {
        const lg_result *result = &self->results[i];
        const bool opens = result->bracket == '[' || result->bracket == '{', closes = result->bracket != 0;
        if (depth == 0 && !closes && strcmp(result->name, name) == 0) return result;
        depth = opens ? depth + 1 : closes ? depth - 1 : depth;
    }
    return NULL;
}

static lg_status has_results(const lg_training *self, lg_error *error) {
    return self->results_lost ? lg_fail(error, LG_OUT_OF_MEMORY, "out of memory for the results") : LG_OK;
}

lg_status lg_training_judge(lg_training *self, double *theta, lg_error *error) {
    LG_TRY(self->recipe->trainer->judge(self, theta, error));
    return has_results(self, error);
}

double lg_training_validation(const lg_training *self) {
    const uint64_t best = lg_fit_best_epoch(self->fit);
    return best > 0 ? lg_fit_history(self->fit, LG_FIT_VALIDATION)[best - 1] : (double)NAN;
}

lg_status lg_training_objective(lg_training *self, double *out, lg_error *error) {
    const lg_trainer *trainer = self->recipe->trainer;
    if (trainer->objective != NULL) return trainer->objective(self, out, error);
    *out = lg_training_validation(self);
    return LG_OK;
}

lg_status lg_training_hold_out(lg_training *self, double part, lg_error *error) {
    const lg_trainer *trainer = self->recipe->trainer;
    if (trainer->hold_out != NULL) return trainer->hold_out(self, part, error);
    lg_training_settings(self)->validation = part;
    return trainer->prepare != NULL ? trainer->prepare(self, error) : LG_OK;
}

/* ---- the fit and the model file ---- */

lg_status lg_training_create_fit(lg_training *self, lg_error *error) {
    LG_TRY(self->recipe->trainer->problem(self, error));
    if (self->options.validation > 0 && self->problem.samples == 1)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--validation-fraction: needs at least 2 samples, and the data have one");
    return lg_fit_create(self->context, &self->problem, &self->options, self->theta, &self->fit, error);
}

lg_status lg_training_save(lg_training *self, const char *path, double *theta,
                           const lg_provenance *provenance, lg_error *error) {
    const lg_recipe *recipe = self->recipe;
    lg_model_head *file = lg_training_alloc(self, 1, recipe->file_size, error);
    if (file == NULL) return LG_OUT_OF_MEMORY;
    *file = (lg_model_head){
        .parameters = lg_recipe_parameters(recipe, self->run), .theta = theta, .provenance = *provenance};
    memcpy((char *)file + recipe->file_run, self->run, recipe->run_size);
    if (recipe->trainer->save != NULL) LG_TRY(recipe->trainer->save(self, file, error));
    return lg_recipe_save(self->context, path, recipe, file, self->fit, error);
}

static lg_status judge_again(lg_training *self, const void *file, lg_error *error) {
    const lg_recipe *recipe = self->recipe;
    const lg_trainer *trainer = recipe->trainer;
    const double *theta = ((const lg_model_head *)file)->theta;
    LG_TRY(trainer->describe(self, error));
    if (trainer->prepare != NULL) LG_TRY(trainer->prepare(self, error));
    lg_fit_options_init(&self->options);
    lg_fit_settings_apply(lg_training_settings(self), &self->options);
    LG_TRY(trainer->problem(self, error));
    memcpy(self->theta, theta, lg_recipe_parameters(recipe, self->run) * sizeof *theta);
    return trainer->judge(self, self->theta, error);
}

lg_status lg_training_evaluate(lg_training *self, const void *file, lg_error *error) {
    const lg_recipe *recipe = self->recipe;
    memcpy(self->run, (const char *)file + recipe->file_run, recipe->run_size);
    self->stored = (const char *)file + recipe->file_run;
    self->file = file;
    LG_TRY(recipe->trainer->read(self, error));
    const double begin = lg_seconds();
    LG_TRY(recipe->trainer->evaluate != NULL ? recipe->trainer->evaluate(self, file, error)
                                             : judge_again(self, file, error));
    self->seconds = lg_seconds() - begin;
    return has_results(self, error);
}
