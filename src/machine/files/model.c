/* Machines as a kind of model: their model file. */
#include "machine/files/recipe.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "files/h5.h"
#include "model/files/recipe.h"
#include "settings/files/attributes.h"

/* ---- YAML text of the machine ---- */

/* Copies a line without its comment and trailing blanks; returns the length including the line end, 0 for an
 * empty line. A # outside of quotes begins a comment at the start of the line or after a blank. */
static size_t copy_line(const char *line, size_t length, char *out) {
    char quote = '\0';
    size_t used = 0;
    for (; used < length; used++) {
        const char c = line[used];
        if (quote != '\0')
            quote = c == quote ? '\0' : quote;
        else if (c == '\'' || c == '"')
            quote = c;
        else if (c == '#' && (used == 0 || line[used - 1] == ' ' || line[used - 1] == '\t'))
            break;
    }
    while (used > 0 && strchr(" \t\r\n", line[used - 1]) != NULL) used--;
    if (used == 0) return 0;
    memcpy(out, line, used);
    out[used] = '\n';
    return used + 1;
}

lg_status lg_machine_model_describe(lg_machine_model_run *run, const char *name, const char *text,
                                    lg_error *error) {
    size_t used = 0;
    for (const char *line = text; *line != '\0';) {
        const size_t length = strcspn(line, "\n");
        if (used + length + 2 > LG_MACHINE_TEXT)
            return lg_fail(error, LG_FORMAT, "%s: is longer than the %d bytes that a model file keeps",
                           lg_shown_path(name), LG_MACHINE_TEXT - 1);
        used += copy_line(line, length, run->text + used);
        line += length + (line[length] == '\n');
    }
    memset(run->text + used, 0, LG_MACHINE_TEXT - used);
    return LG_OK;
}

/* ---- fields of the run ---- */

enum { SCALES = 3 + LG_MACHINE_POSITIONS + 2 * LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS };
_Static_assert(offsetof(lg_machine_scales, lag) == SCALES * sizeof(double),
               "scales before lag are numbers one after the other; a file stores lag in another attribute");
_Static_assert(SCALES <= LG_FIELD_LIST_MAX && 2 * LG_MACHINE_RANGE <= LG_FIELD_LIST_MAX,
               "they fit into lists");

/* A list of so many numbers, also of coordinates that the machine does not have. */
#define FIXED(count) .array = true, .least = (count), .most = (count)
#define FACT(group, name, type, member, ...)                                                                 \
    LG_FACT(lg_machine_model_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {
    FACT("model", "machine", TEXT, text, .low = 0),
    FACT("model", "scales", REALS, scales, FIXED(SCALES)),
    FACT("run", "range", REALS, range, .low = -1e300, FIXED(2 * LG_MACHINE_RANGE)),
    FACT("run", "position_scale", REALS, position_scale, FIXED(LG_MACHINE_COORDINATES)),
    FACT("run", "velocity_scale", REALS, velocity_scale, FIXED(LG_MACHINE_COORDINATES)),
    FACT("run", "residual", REAL, residual, .low = 0),
    FACT("run", "windows", U64, windows, .low = 0),
    FACT("run", "dt", REAL, dt, .low = 0),
    FACT("run", "delay", U32, estimated, .low = 0),
    FACT("run", "start_rows", U32, start_rows, .optional = true),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    LG_FIELD_END};

static const lg_machine_model_run defaults = {
    .substeps = 1, .window = 5, .stride = 1, .training = {.schedule = LG_SCHEDULE_STEP}};

static bool positive(const lg_machine_scales *scales) {
    double values[SCALES];
    memcpy(values, scales, sizeof values);
    for (uint32_t i = 0; i < SCALES; i++)
        if (!(values[i] > 0.0)) return false;
    return true;
}

/* The range of time constants, which only files of machines with lags have. */
static const lg_field lag_range = FACT("model", "lag_range", REALS, scales.lag, FIXED(2));

static lg_status read_lags(lg_h5 *h5, lg_machine_model_run *run, lg_error *error) {
    lg_machine_scales fallback;
    lg_machine_scales_init(&fallback);
    memcpy(run->scales.lag, fallback.lag, sizeof fallback.lag);
    if (lg_h5_has_attribute(h5, lag_range.group, lag_range.name))
        LG_TRY(lg_field_get(h5, &lag_range, run, error));
    if (run->scales.lag[0] > 0.0 && run->scales.lag[1] > run->scales.lag[0]) return LG_OK;
    return lg_h5_fail(h5, error, "/model: attribute lag_range: expected two rising numbers above 0");
}

static lg_status read_machine(lg_h5 *h5, void *user, lg_error *error) {
    lg_machine_model_run *run = user;
    LG_CLEAN(lg_machine_file_destroy) lg_machine_file description = {.text = NULL};
    LG_TRY(read_lags(h5, run, error));
    if (run->scheme == NULL) run->scheme = lg_scheme_at(0);
    if (!positive(&run->scales))
        return lg_h5_fail(h5, error, "/model: attribute scales: all numbers must be above 0");
    LG_TRY(lg_as_format(
        lg_machine_file_parse(h5->context, h5->path, run->text, strlen(run->text), &description, error),
        error));
    run->machine = description.machine;
    run->machine.scales = run->scales;
    for (uint32_t i = 0; i < run->machine.input_count; i++) {
        const lg_log_input *input = &description.inputs[i];
        run->delay[i] = input->estimate_delay ? run->estimated : input->delay;
    }
    return LG_OK;
}

static lg_status make(void *user, lg_error *why) {
    return lg_machine_init(&((lg_machine_model_run *)user)->machine, why);
}

static lg_status describe(lg_h5 *h5, const void *user, lg_error *error) {
    const lg_machine_model_run *run = user;
    if (run->machine.lags > 0) LG_TRY(lg_field_write(h5, &lag_range, run, error));
    LG_TRY(lg_h5_put_text(h5, "model", "inputs", "state, then inputs", error));
    return lg_h5_put_text(h5, "model", "outputs", "H", error);
}

/* ---- the flat parameter vector as named arrays ---- */

/* Name of a term: "damping", or "damping2" for the second term of its part. */
static void name_term(const lg_machine *machine, uint32_t term, char *text, size_t size) {
    uint32_t before = 1;
    const lg_machine_part part = machine->terms[term].part;
    for (uint32_t i = 0; i < term; i++) before += machine->terms[i].part == part;
    if (before == 1)
        (void)snprintf(text, size, "%s", lg_machine_part_name(part));
    else
        (void)snprintf(text, size, "%s%u", lg_machine_part_name(part), before);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *s) {
    const lg_machine *machine = &((const lg_machine_model_run *)run)->machine;
    for (uint32_t i = 0; i < machine->term_count; i++) {
        const lg_machine_term *term = &machine->terms[i];
        char name[24];
        if (term->parameters == 0) continue;
        name_term(machine, i, name, sizeof name);
        if (lg_term_is_network(term)) {
            if (lg_slice_of_mlp(&term->net, name, term->offset, &index, s)) return true;
            continue;
        }
        if (index-- != 0) continue;
        lg_slice_set(s, term->offset, 1, term->parameters, 0);
        (void)snprintf(s->name, sizeof s->name, "%s/%s", name, lg_term_kind_name(term->kind));
        return true;
    }
    return false;
}

#define PARAMETERS LG_DIM(lg_machine_model_file, parameters, "parameters")
static const lg_item items[] = {{.type = LG_ITEM_ARRAY,
                                 .name = "spread",
                                 .offset = offsetof(lg_machine_model_file, spread),
                                 .dims = {PARAMETERS, PARAMETERS},
                                 .optional = true},
                                {.type = LG_ITEM_END}};

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_machine_model_file *file = user;
    return lg_machine_program(context, &file->run.machine, file->theta, scheme, false, out, error);
}

static lg_status space(const void *run, lg_space *out) {
    return lg_machine_full_space(&((const lg_machine_model_run *)run)->machine, out);
}

static const lg_scheme *usual_scheme(const void *file) {
    return ((const lg_machine_model_file *)file)->run.scheme;
}

extern const struct lg_trainer lg_machine_model_learner; /* in recipe.c */
LG_RECIPE(machine_model, "machine-checkpoint", LG_MADE(lg_machine_model_run, machine.parameters),
          .read = read_machine, .items = items, .scheme = usual_scheme, .space = space,
          .trainer = &lg_machine_model_learner);

/* ---- about logs ---- */

void lg_machine_log_sha256(const lg_machine *machine, const lg_machine_log *log, char text[LG_SHA256_TEXT]) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add_doubles(&state, log->t, log->rows);
    lg_sha256_add_doubles(&state, log->q, log->rows * machine->positions);
    lg_sha256_add_doubles(&state, log->v, log->rows * machine->velocities);
    if (log->a != NULL) lg_sha256_add_doubles(&state, log->a, log->rows * machine->velocities);
    if (log->u != NULL) lg_sha256_add_doubles(&state, log->u, log->rows * 4 * machine->input_count);
    lg_sha256_finish(&state, text);
}
