/* Describes the numbers of a machine's state and input, for every target. */

#include "lg-export/faces.h"
#include "liegrad/machine.h"

/* ---- the state ---- */

/* Adds the names of `count` numbers to the list of the state's numbers. */
static void add_numbers(text *list, const char *name, const char *part, const char *letters, uint32_t count) {
    for (uint32_t k = 0; k < count; k++) {
        lg_text_add(list, "%s%s", name, part);
        if (count == 9)
            lg_text_add(list, "%u%u", k / 3 + 1, k % 3 + 1);
        else if (count > 1 && letters != NULL)
            lg_text_add(list, ".%c", letters[k % 3]);
        else if (count > 1)
            lg_text_add(list, " %u", k + 1);
        lg_text_add(list, "\n");
    }
}

enum { PLACES, DIRECTIONS, ROTATIONS, MOMENTA, GROUPS };

/* Describes the numbers that a coordinate has in a group of the state. */
static void tell_group(export_source *source, const lg_machine_coordinate *c, int group) {
    const lg_coordinate_row *row = lg_coordinate_row_of(c->kind);
    text *state = &source->state, *list = &source->places;
    if (group == PLACES) {
        for (uint32_t k = 0; k < row->places; k++)
            if (row->places == 1)
                lg_text_add(state, "%s ", c->name);
            else
                lg_text_add(state, "%s.%c ", c->name, "xyz"[k % 3]);
        add_numbers(list, c->name, "", "xyz", row->places);
    } else if (group == DIRECTIONS && row->directions > 0) {
        lg_text_add(state, "%s.q (3) %s.p (3) ", c->name, c->name);
        add_numbers(list, c->name, ".q", "xyz", 3);
        add_numbers(list, c->name, ".p", "xyz", 3);
    } else if (group == ROTATIONS && row->rotations > 0) {
        lg_text_add(state, "%s.R (9, rows) ", c->name);
        add_numbers(list, c->name, ".R", NULL, 9);
    } else if (group == MOMENTA && row->directions == 0) {
        lg_text_add(state, " %s (%u)", c->name, row->velocities);
        APP_FREE char *name = app_format("momentum of %s", c->name);
        add_numbers(list, name, "", NULL, row->velocities);
    }
}

/* Describes the state: "x theta rod.q (3) rod.p (3) body.R (9, rows) momenta x (1) theta (1) body (3)". */
static void tell_state(export_source *source, const lg_machine *machine) {
    for (int group = 0; group < GROUPS; group++) {
        if (group == MOMENTA && machine->momenta > 0) lg_text_add(&source->state, "momenta");
        for (uint32_t i = 0; i < machine->coordinate_count; i++)
            tell_group(source, &machine->coordinates[i], group);
    }
    if (machine->bristles > 0) {
        lg_text_add(&source->state, " bristles (%u)", machine->bristles);
        add_numbers(&source->places, "bristle", "", NULL, machine->bristles);
    }
    if (machine->lags > 0) lg_text_add(&source->state, " lagged inputs");
    for (uint32_t k = 0; k < machine->lags; k++) {
        const bool first = k + 1 < machine->lags && machine->lagged[k + 1] == machine->lagged[k];
        const char *name = machine->inputs[machine->lagged[k]],
                   *of = first ? " after the first of two lags" : "";
        lg_text_add(&source->state, " %s%s (1)", name, of);
        lg_text_add(&source->places, "lagged %s%s\n", name, of);
    }
}

/* ---- the range ---- */

static void tell_number(text *about, const char *what, const char *name, const lg_machine_range *range,
                        uint32_t i) {
    if (range->low[i] <= range->high[i])
        lg_text_add(about, "  %-11s %s %g to %g\n", what, name, range->low[i], range->high[i]);
    else
        lg_text_add(about, "  %-11s %s unknown\n", what, name);
}

/* Describes the range of the training data. Positions of directions and rotations are left out: they may be
 * anywhere. */
static void tell_range(text *about, const lg_machine_model_run *run) {
    const lg_machine *machine = &run->machine;
    const lg_machine_range *range = &run->range;
    uint32_t q = 0, v = machine->positions;
    lg_text_add(about, "\nrange of the data, which the model knows alone\n");
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_machine_coordinate *c = &machine->coordinates[i];
        const lg_coordinate_row *row = lg_coordinate_row_of(c->kind);
        for (uint32_t k = 0; k < row->places; k++) tell_number(about, "position", c->name, range, q + k);
        for (uint32_t k = 0; k < row->velocities; k++) tell_number(about, "velocity", c->name, range, v++);
        q += lg_coordinate_positions(c->kind);
    }
    for (uint32_t i = 0; i < machine->input_count; i++)
        tell_number(about, "input", machine->inputs[i], range, v++);
}

/* ---- inputs ---- */

/* "inputs act 2 rows of the log, ... later than they are logged", or of each input that is delayed. */
static void tell_delays(text *to, const lg_machine_model_run *run) {
    const uint32_t n = run->machine.input_count;
    bool same = true;
    for (uint32_t i = 0; i < n; i++) same = same && run->delay[i] == run->delay[0];
    if (same && run->delay[0] > 0)
        lg_text_add(to, "inputs act %u rows of the log, %g in time, later than they are logged",
                    run->delay[0], run->delay[0] * run->dt);
    for (uint32_t i = 0; i < n && !same; i++)
        if (run->delay[i] > 0)
            lg_text_add(to, "%sinput %s acts %u rows of the log, %g in time, later than it is logged",
                        to->length > 0 ? "; " : "", run->machine.inputs[i], run->delay[i],
                        run->delay[i] * run->dt);
}

void export_machine_words(const void *contents, export_source *source) {
    const lg_machine_model_run *run = &((const lg_machine_model_file *)contents)->run;
    const lg_machine *machine = &run->machine;
    source->step = run->dt / run->substeps;
    tell_range(&source->range, run);
    tell_state(source, machine);
    for (uint32_t i = 0; i < machine->input_count; i++) {
        lg_text_add(&source->input, "%s%s", i > 0 ? " " : "", machine->inputs[i]);
        lg_text_add(&source->inputs_each, "%s\n", machine->inputs[i]);
    }
    tell_delays(&source->delay, run);
}

void export_warn_delay(const app *self, const export_source *source) {
    if (source->delay.length > 0)
        app_warn(
            self,
            "the model's %s; the exported functions do not delay them: delay the inputs before you pass them",
            source->delay.data);
}
