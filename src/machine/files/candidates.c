/* The candidates of `fit --suggest`. */
#include <stdlib.h>
#include <string.h>

#include "machine/files/choice.h"
#include "machine/internal.h"

static bool has_inputs(const lg_machine_file *file, const lg_candidate *self) {
    (void)self;
    return file->machine.input_count > 0;
}

/* The machine has inputs, and no lag whose value is known. */
static bool lags_are_open(const lg_machine_file *file, const lg_candidate *self) {
    bool open = has_inputs(file, self);
    for (uint32_t i = 0; i < file->machine.term_count; i++) {
        const lg_machine_term *term = &file->machine.terms[i];
        open = open && (term->kind->lag == NULL || term->entry_count == term->value_count);
    }
    return open;
}

/* An input has another hold. */
static bool holds_otherwise(const lg_machine_file *file, const lg_candidate *self) {
    bool other = false;
    for (uint32_t i = 0; i < file->machine.input_count; i++)
        other = other || strcmp(lg_input_holds[file->inputs[i].hold], self->edit.fragment) != 0;
    return other;
}

/* All inputs have smaller delays. */
static bool delays_less(const lg_machine_file *file, const lg_candidate *self) {
    bool less = file->machine.input_count > 0;
    for (uint32_t i = 0; i < file->machine.input_count; i++)
        less = less && (int)file->inputs[i].delay < atoi(self->edit.fragment);
    return less;
}

const lg_candidate lg_candidates[] = {
    {.name = "offset",
     .edit = {LG_YAML_SET, "offset", NULL, "unknown"},
     .part = LG_MACHINE_OFFSET,
     .unless = "unknown known",
     .asks = "a constant force (an offset)"},
    {.name = "viscous",
     .edit = {LG_YAML_APPEND, "damping", NULL, "{kind: diagonal}"},
     .part = LG_MACHINE_DAMPING,
     .unless = "diagonal constant known network asymmetric",
     .asks = "viscous friction"},
    {.name = "coulomb",
     .edit = {LG_YAML_APPEND, "damping", NULL, "{kind: coulomb}"},
     .part = LG_MACHINE_DAMPING,
     .unless = "coulomb stribeck load position network",
     .asks = "Coulomb friction"},
    {.name = "asymmetric",
     .edit = {LG_YAML_APPEND, "damping", NULL, "{kind: asymmetric}"},
     .part = LG_MACHINE_DAMPING,
     .unless = "asymmetric network",
     .offset = true,
     .asks = "viscous friction that differs by direction"},
    {.name = "quadratic",
     .edit = {LG_YAML_APPEND, "damping", NULL, "{kind: quadratic}"},
     .part = LG_MACHINE_DAMPING,
     .unless = "quadratic network",
     .asks = "friction that grows with the square of the velocity"},
    {.name = "cubic",
     .edit = {LG_YAML_APPEND, "damping", NULL, "{kind: cubic}"},
     .part = LG_MACHINE_DAMPING,
     .unless = "cubic network",
     .asks = "friction that grows with the cube of the velocity"},
    {.name = "stribeck",
     .edit = {LG_YAML_APPEND, "damping", NULL, "{kind: stribeck}"},
     .part = LG_MACHINE_DAMPING,
     .unless = "stribeck network",
     .asks = "friction that is larger near rest (Stribeck)"},
    {.name = "hold zero",
     .edit = {LG_YAML_SET, "inputs.hold", NULL, "zero"},
     .applies = holds_otherwise,
     .asks = "inputs that are held between rows"},
    {.name = "hold linear",
     .edit = {LG_YAML_SET, "inputs.hold", NULL, "linear"},
     .applies = holds_otherwise,
     .asks = "inputs that are lines between rows"},
    {.name = "hold cubic",
     .edit = {LG_YAML_SET, "inputs.hold", NULL, "cubic"},
     .applies = holds_otherwise,
     .asks = "inputs that are smooth between rows"},
    {.name = "delay 1",
     .edit = {LG_YAML_SET, "inputs.delay", NULL, "1"},
     .applies = delays_less,
     .asks = "a delay of the inputs by 1 row"},
    {.name = "delay 2",
     .edit = {LG_YAML_SET, "inputs.delay", NULL, "2"},
     .applies = delays_less,
     .asks = "a delay of the inputs by 2 rows"},
    {.name = "delay 4",
     .edit = {LG_YAML_SET, "inputs.delay", NULL, "4"},
     .applies = delays_less,
     .asks = "a delay of the inputs by 4 rows"},
    {.name = "lag",
     .edit = {LG_YAML_SET, "inputs.lag", NULL, "unknown"},
     .part = LG_MACHINE_ACTUATOR,
     .unless = "lag second_order_lag",
     .applies = has_inputs,
     .asks = "a lag of the actuator"},
    {.name = "second-order lag",
     .edit = {LG_YAML_SET, "inputs.lag", NULL, "{order: 2}"},
     .part = LG_MACHINE_ACTUATOR,
     .unless = "second_order_lag",
     .applies = lags_are_open,
     .asks = "a lag of second order of the actuator"},
    {.name = "dead zone",
     .edit = {LG_YAML_SET, "inputs.curve", NULL, "{dead_zone: unknown}"},
     .part = LG_MACHINE_ACTUATOR,
     .unless = "dead_zone curve",
     .applies = has_inputs,
     .asks = "an actuator with a dead zone"},
    {.name = "curve",
     .edit = {LG_YAML_SET, "inputs.curve", NULL, "{degree: 2}"},
     .part = LG_MACHINE_ACTUATOR,
     .unless = "dead_zone curve",
     .applies = has_inputs,
     .asks = "an actuator whose force also grows with the square of the input"},
    {.name = "spring of %P",
     .edit = {LG_YAML_APPEND, "potential", NULL, "{kind: quadratic, of: %P}"},
     .part = LG_MACHINE_POTENTIAL,
     .unless = "quadratic polynomial network",
     .each = true,
     .asks = "a spring of %P"},
    {.name = "quadratic spring of %P",
     .edit = {LG_YAML_REPLACE, "potential", "quadratic", "{kind: polynomial, of: %P, degree: 3}"},
     .part = LG_MACHINE_POTENTIAL,
     .unless = "polynomial network",
     .each = true,
     .asks = "a spring of %P whose force has a quadratic part"},
    {.name = "cubic spring of %P",
     .edit = {LG_YAML_REPLACE, "potential", "quadratic", "{kind: polynomial, of: %P, degree: 4}"},
     .part = LG_MACHINE_POTENTIAL,
     .unless = "polynomial network",
     .each = true,
     .asks = "a spring of %P whose force has a cubic part"},
    {.name = "network of the velocities",
     .edit = {LG_YAML_APPEND, "residual", NULL, "{kind: network, of: [%V], hidden: [8]}"},
     .part = LG_MACHINE_RESIDUAL,
     .unless = "network",
     .last = true,
     .asks = "a force of the velocities that no other candidate has (a network)"},
    {.name = NULL}};
