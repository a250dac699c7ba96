/* Loads a model of any kind as a program, and chooses functions of it for a target. */
#include <string.h>

#include "autodiff/program/program.h"
#include "lg-export/faces.h"

/* ---- the initial state ---- */

/* A state at rest: places and momenta 0, directions down (-e3), rotations the identity. */
static void add_factor(const lg_space_factor *factor, double *y) {
    const lg_space_entry *entry = lg_space_kind_entry(factor->kind);
    for (size_t i = 0; i < factor->count; i++, y += entry->state) {
        if (factor->kind == LG_SPACE_TS2) y[2] = -1.0;
        if (factor->kind == LG_SPACE_SO3 || factor->kind == LG_SPACE_SE3) y[0] = y[4] = y[8] = 1.0;
    }
}

void export_rest(const lg_space *space, double *y) {
    for (size_t i = 0; i < space->factors; i++) {
        add_factor(&space->factor[i], y);
        y += lg_space_kind_entry(space->factor[i].kind)->state * space->factor[i].count;
    }
}

static void make_start(const lg_space *space, export_source *source) {
    source->start = app_keep(space->dim, sizeof *source->start);
    source->starts = space->dim;
    export_rest(space, source->start);
}

/* ---- models of any kind ---- */

static void tell_words(const lg_model_file *file, export_source *source) {
    const export_kind *kind = export_kind_of(file->recipe);
    if (kind->words == NULL) return;
    kind->words(file->contents, source);
    export_tell_words(source, &source->about);
    if (source->range.length > 0) lg_text_add(&source->about, "%s\n", source->range.data);
}

static lg_status load_model(const app *self, const char *path, export_source *source, lg_program **out,
                            lg_error *error) {
    lg_model_file file;
    LG_TRY(lg_model_load(self->context, path, NULL, &file, error));
    const lg_scheme *chosen = source->options->scheme;
    const lg_status status =
        lg_model_file_program(&file, chosen != NULL ? chosen : lg_model_file_scheme(&file), out, error);
    const lg_space *space = lg_model_space(file.model);
    if (status == LG_OK && space != NULL) {
        make_start(space, source);
        tell_words(&file, source);
        export_warn_delay(self, source);
    }
    lg_model_file_destroy(&file);
    return status;
}

void export_warn_program(const app *self, const lg_error *why) {
    app_warn(self, "%s: only its functions are exported, as for a program", why->message);
}

void export_load(const app *self, const char *path, const char *kind, export_source *source,
                 lg_program **out) {
    lg_error error = {LG_OK, ""};
    lg_status status = LG_UNSUPPORTED;
    const bool program = strcmp(kind, "program") == 0;
    if (strcmp(kind, "policy") == 0) {
        *out = export_policy_load(self, path, source);
        return;
    }
    if (!program) status = load_model(self, path, source, out, &error);
    if (status != LG_OK && lg_recipe_find(kind) == NULL) {
        if (!program) export_warn_program(self, &error);
        status = lg_program_load(self->context, path, NULL, out, &error);
    }
    app_must_file(self, status, &error, path);
}

/* ---- functions ---- */

export_ports export_ports_of(const lg_program *program, const char *function) {
    export_ports p = {NULL, NULL, 0, 0};
    size_t at = SIZE_MAX;
    (void)lg_program_find(program, function, &at, NULL);
    p.in = lg_program_inputs(program, at, &p.ins);
    p.out = lg_program_outputs(program, at, &p.outs);
    return p;
}

size_t export_numbers(const lg_port *ports, size_t count) {
    size_t sum = 0;
    for (size_t i = 0; i < count; i++) sum += lg_shape_count(ports[i].shape);
    return sum;
}

size_t export_parameters(const lg_program *program) {
    size_t sum = 0;
    for (size_t i = 0; i < lg_program_parameters(program); i++)
        sum += lg_shape_count(lg_program_parameter(program, i).shape);
    return sum;
}

bool export_trains_only(const lg_program *program, size_t function) {
    bool others = false;
    for (size_t i = 0; i < lg_program_functions(program); i++)
        others = others || !lg_program_is_fitted(program, i);
    return others && lg_program_is_fitted(program, function);
}

bool export_add_name(export_names *names, const lg_program *program, const char *function) {
    size_t at;
    if (lg_program_find(program, function, &at, NULL) != LG_OK) return false;
    const char *own = lg_program_function_name(program, at);
    for (size_t i = 0; i < names->count; i++)
        if (names->name[i] == own) return true;
    names->name[names->count++] = own;
    return true;
}

/* Refuses an unknown function. `linearise` is written as C around the program of a machine; other targets
 * have derivatives of functions instead. */
static void refuse_function(const app *self, const lg_program *program, const char *name, bool c) {
    size_t at;
    lg_error error = {LG_OK, ""};
    if (!c && strcmp(name, "linearise") == 0 && lg_program_find(program, "step", &at, NULL) == LG_OK)
        app_stop_usage(
            self,
            "--functions: linearise is for --target c only; other targets have derivatives of velocity and "
            "step by x and u (casadi: jac_NAME_velocity, jac_NAME_step; FMUs: directional derivatives)");
    if (c && name[0] == '\0') app_stop_usage(self, "--functions: no function is named");
    if (lg_program_find(program, name, &at, &error) != LG_OK)
        app_stop_usage(self, "--functions: %s", error.message);
}

void export_choose(const app *self, const export_options *options, const lg_program *program,
                   const char *const *usual, export_names *out) {
    *out = (export_names){.count = 0};
    APP_FREE char *given = app_format("%s", options->functions != NULL ? options->functions : "");
    for (char *rest = given, *name; (name = strsep(&rest, ",")) != NULL;)
        if (name[0] != '\0' && !export_add_name(out, program, name))
            refuse_function(self, program, name, usual == NULL);
    for (size_t i = 0; options->functions == NULL && usual[i] != NULL; i++)
        (void)export_add_name(out, program, usual[i]);
    const bool all = options->functions == NULL && out->count == 0;
    for (size_t i = 0; all && i < lg_program_functions(program); i++) {
        const char *name = lg_program_function_name(program, i);
        if (!lg_program_is_derivative(name) && !export_trains_only(program, i))
            (void)export_add_name(out, program, name);
    }
    if (out->count == 0) refuse_function(self, program, "", usual == NULL);
}

const char *export_derive(const app *self, lg_program *program, lg_derivative_kind kind,
                          const char *function) {
    size_t at;
    lg_error error = {LG_OK, ""};
    lg_derivative what;
    APP_FREE char *name = app_format("%s%s", lg_derivative_begins[kind], function);
    lg_derivative_init(&what);
    what.kind = kind;
    what.function = function;
    if (lg_program_find(program, name, &at, NULL) != LG_OK &&
        app_had_memory(lg_program_derive(program, &what, &error)) != LG_OK) {
        app_warn(self, "%s has no %s: %s", function, name, error.message);
        return NULL;
    }
    (void)lg_program_find(program, name, &at, NULL);
    return lg_program_function_name(program, at);
}
