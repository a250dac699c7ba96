/* A few numbers of a learned machine for a new log: which numbers there are, the directions in which they
 * move the machine's parameters, and the text of the machine that has them. */
#include <stdio.h>
#include <string.h>

#include "core/text.h"
#include "machine/files/recipe.h"

/* ---- directions ---- */

size_t lg_adaptation_direction(const lg_adaptation *adaptation, uint32_t velocity) {
    size_t k = 0;
    while (k < adaptation->count && adaptation->velocities[k] != velocity) k++;
    return k;
}

static bool pushes(const lg_adaptation *of, uint32_t velocity) {
    return lg_adaptation_direction(of, velocity) < of->count;
}

/* Appends one direction, which multiplies all friction by one factor. */
static bool friction(const double *force, lg_adaptation *out) {
    const lg_machine *machine = &out->run.machine;
    double *direction = out->directions + out->count * machine->parameters;
    if (pushes(out, LG_ADAPT_FRICTION) || !lg_machine_scale_friction(machine, out->theta, direction))
        return false;
    for (size_t i = 0; i < machine->parameters; i++) direction[i] *= LG_ADAPT_SIGMA;
    (void)snprintf(out->names[out->count], LG_IDENTIFIED_NAME, "friction");
    out->units[out->count] = LG_ADAPT_SIGMA;
    out->velocities[out->count] = LG_ADAPT_FRICTION;
    return true;
}

/* The number that changes with parameter `at` when all others are 0: its name, and its value where the
 * parameter is 1. Returns 0 if no number changes. */
static double unit_of(const lg_machine *machine, size_t at, double *theta, char *name) {
    lg_identified one[LG_MACHINE_VALUES], none[LG_MACHINE_VALUES];
    memset(theta, 0, machine->parameters * sizeof *theta);
    size_t count = lg_machine_numbers(machine, theta, LG_MACHINE_VALUES, none);
    theta[at] = 1.0;
    (void)lg_machine_numbers(machine, theta, LG_MACHINE_VALUES, one);
    theta[at] = 0.0;
    if (count > LG_MACHINE_VALUES) count = LG_MACHINE_VALUES;
    for (size_t i = 0; i < count; i++) {
        if (one[i].value == none[i].value) continue;
        (void)snprintf(name, LG_IDENTIFIED_NAME, "%s", one[i].name);
        return one[i].value - none[i].value;
    }
    return 0.0;
}

/* Appends the direction that changes number `index` of an offset. Returns false if another direction already
 * pushes the velocity on which this number acts. */
static bool push(const lg_machine_term *term, const double *force, size_t index, lg_adaptation *out) {
    const lg_machine *machine = &out->run.machine;
    uint32_t all[LG_MACHINE_VELOCITIES];
    (void)lg_machine_offset_velocities(machine, term, all);
    const uint32_t velocity = all[term->entry_count > 0 ? term->entries[index].index : index];
    if (pushes(out, velocity)) return false;
    double *direction = out->directions + out->count * machine->parameters;
    const double unit = unit_of(machine, term->offset + index, direction, out->names[out->count]);
    direction[term->offset + index] = unit != 0.0 ? force[velocity] / unit : 0.0;
    out->units[out->count] = force[velocity];
    out->velocities[out->count] = velocity;
    return true;
}

/* Appends the direction of a constant force on a velocity. Each velocity on which a learned number of an
 * offset acts gets one such direction. */
static bool offset(const double *force, lg_adaptation *out) {
    const lg_machine *machine = &out->run.machine;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_OFFSET, &term);)
        for (size_t i = 0; i < term->parameters; i++)
            if (push(term, force, i, out)) return true;
    return false;
}

/* `append` fills the arrays of `out` at out->count, where the direction begins as zeros. The direction gets
 * the length of one standard deviation of the prior. The caller increments out->count. `append` returns false
 * if the kind has no further direction. */
typedef struct adaptable {
    const char *name, *missing;
    bool (*append)(const double *force, lg_adaptation *out);
} adaptable;
static const adaptable kinds[] = {
    {"offset", "the machine has no learned offset", offset},
    {"friction", "the machine has no learned friction: its damping is known or missing", friction}};

static lg_status refuse(const char *name, size_t length, lg_error *error) {
    lg_name_list list = {.used = 0};
    for (size_t i = 0; i < LG_COUNT(kinds); i++) lg_name_list_add(&list, kinds[i].name);
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "--numbers: \"%.*s\" is no number that can be adapted; take of: %s", (int)length, name,
                   list.text);
}

/* The kinds that a list names, in its order. */
typedef struct picked {
    size_t count;
    const adaptable *kind[LG_COUNT(kinds)];
} picked;

static bool has(const picked *of, const adaptable *kind) {
    for (size_t i = 0; i < of->count; i++)
        if (of->kind[i] == kind) return true;
    return false;
}

static lg_status pick(const char *names, picked *out, lg_error *error) {
    *out = (picked){.count = 0};
    for (const char *at = names; at != NULL;) {
        const size_t length = strcspn(at, ",");
        const adaptable *kind = kinds;
        while (kind < kinds + LG_COUNT(kinds) &&
               (strlen(kind->name) != length || strncmp(kind->name, at, length) != 0))
            kind++;
        if (kind == kinds + LG_COUNT(kinds)) return refuse(at, length, error);
        if (has(out, kind))
            return lg_fail(error, LG_INVALID_ARGUMENT, "--numbers: \"%s\" stands twice", kind->name);
        out->kind[out->count++] = kind;
        at = at[length] == ',' ? at + length + 1 : NULL;
    }
    return LG_OK;
}

lg_status lg_adapt_check(const char *names, lg_error *error) {
    picked all;
    return pick(names, &all, error);
}

/* ---- the machine's text with an offset ---- */

static lg_status add_offset(char text[LG_MACHINE_TEXT], lg_error *error) {
    static const char change[] = "\n---\noffset: unknown\n";
    if (strlen(text) + sizeof change <= LG_MACHINE_TEXT) {
        lg_append(text, LG_MACHINE_TEXT, "%s", change);
        return LG_OK;
    }
    return lg_fail(error, LG_FORMAT,
                   "the machine's text is too long for a further line: write "
                   "`offset: unknown` in the machine's file and fit it");
}

static lg_status extend(const lg_context *context, const char *path, lg_machine_model_run *run,
                        lg_error *error) {
    LG_CLEAN(lg_machine_file_destroy) lg_machine_file file = {.text = NULL};
    LG_TRY(add_offset(run->text, error));
    LG_TRY(lg_machine_file_parse(context, path, run->text, strlen(run->text), &file, error));
    run->machine = file.machine;
    run->machine.scales = run->scales;
    return LG_OK;
}

/* ---- preparing ---- */

static lg_status fill(const picked *of, const double *force, lg_adaptation *out, lg_error *error) {
    for (size_t i = 0; i < of->count; i++) {
        const size_t before = out->count;
        while (of->kind[i]->append(force, out)) out->count++;
        if (out->count == before)
            return lg_fail(error, LG_INVALID_ARGUMENT, "--numbers %s: %s", of->kind[i]->name,
                           of->kind[i]->missing);
    }
    return LG_OK;
}

lg_status lg_adaptation_create(const lg_context *context, const char *path, const lg_machine_model_file *file,
                               const char *names, const double *force, lg_adaptation *out, lg_error *error) {
    const lg_machine *before = &file->run.machine;
    *out = (lg_adaptation){.run = file->run, .context = context};
    picked all;
    LG_TRY(pick(names, &all, error));
    if (has(&all, &kinds[0]) && !lg_machine_has_part(before, LG_MACHINE_OFFSET))
        LG_TRY(extend(context, path, &out->run, error));
    const size_t P = out->run.machine.parameters;
    out->theta = lg_alloc(context, (1 + LG_ADAPT_MOST) * P + 1, sizeof *out->theta);
    if (out->theta == NULL) return lg_no_memory(error);
    out->directions = out->theta + P;
    memset(out->theta, 0, P * sizeof *out->theta);
    lg_machine_carry(before, file->theta, &out->run.machine, out->theta);
    return fill(&all, force, out, error);
}

void lg_adaptation_move(lg_adaptation *adaptation, const double *x) {
    const size_t P = adaptation->run.machine.parameters;
    for (size_t k = 0; k < adaptation->count; k++)
        for (size_t i = 0; i < P; i++) adaptation->theta[i] += x[k] * adaptation->directions[k * P + i];
}

void lg_adaptation_destroy(lg_adaptation *adaptation) {
    lg_free(adaptation->context, adaptation->theta);
    *adaptation = (lg_adaptation){.count = 0};
}
