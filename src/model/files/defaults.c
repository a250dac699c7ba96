/* Describes the defaults of a recipe's fields for help texts. */
#include <stdio.h>
#include <string.h>

#include "model/files/training.h"
#include "settings/training.h"

enum { SHOWN = 256 /* bytes of a default */ };

/* Writes the value that all cases of the preset have, or LG_CHOSEN if they differ. */
static void usual_value(lg_training *self, const lg_field *row, const char *preset, char out[SHOWN]) {
    const lg_trainer *trainer = self->recipe->trainer;
    char value[LG_FIELD_TEXT_SIZE];
    self->preset = preset;
    for (uint32_t at = 0; at == 0 || trainer->usual != NULL; at++) {
        memset(self->run, 0, self->recipe->run_size);
        lg_fields_default(self->recipe->fields, self->run);
        if (trainer->usual != NULL && !trainer->usual(self, at)) return;
        lg_field_show(row, self->run, value, sizeof value);
        const bool differs = at > 0 && strcmp(out, value) != 0;
        (void)snprintf(out, SHOWN, "%.200s", differs ? LG_CHOSEN : value);
        if (differs) return;
    }
}

static const lg_recipe *recipe_of(const lg_field *row) {
    for (const lg_recipe *const *recipe = lg_recipes; *recipe != NULL; recipe++)
        for (const lg_field *own = (*recipe)->fields; own->name != NULL; own++)
            if (own == row) return *recipe;
    return NULL;
}

int lg_training_describe_field(const lg_field *row, char *text, size_t size) {
    char usual[SHOWN], thesis[SHOWN], both[2 * SHOWN + 16];
    const lg_recipe *recipe = recipe_of(row);
    const bool of_preset =
        row->otherwise == NULL || strncmp(row->otherwise, LG_OF_PRESET, sizeof LG_OF_PRESET - 1) == 0;
    void *run = recipe != NULL && of_preset ? lg_alloc(NULL, 1, recipe->run_size) : NULL;
    if (run == NULL) return lg_field_describe(row, text, size);
    lg_field shown = *row;
    lg_training training = lg_training_of(NULL, recipe, run, NULL);
    usual_value(&training, row, lg_preset_name(1), usual);
    usual_value(&training, row, lg_preset_name(recipe->trainer->presets ? 0 : 1), thesis);
    const bool two = strcmp(thesis, usual) != 0;
    (void)snprintf(both, sizeof both, "%s%s%s", usual, two ? "; thesis: " : "", two ? thesis : "");
    shown.otherwise = both;
    lg_free(NULL, run);
    return lg_field_describe(&shown, text, size);
}
