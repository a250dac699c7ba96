/* Loads a model of any kind as a program, and chooses functions of it for a target. */
#include <stdlib.h>
#include <string.h>

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
    source->start = app_alloc(space->dim, sizeof *source->start);
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
    const bool policy = strcmp(kind, "policy") == 0, program = policy || strcmp(kind, "program") == 0;
    if (!program) status = load_model(self, path, source, out, &error);
    if (status != LG_OK && lg_recipe_find(kind) == NULL) {
        if (!program) export_warn_program(self, &error);
        status = lg_program_load(self->context, path, NULL, out, &error);
    }
    app_must_file(self, status, &error, path);
    if (policy) export_policy_words(self, path, source);
}

/* ---- functions ---- */

const lg_port *export_ports(const lg_program *program, const char *function, bool outputs, size_t *count) {
    size_t at = SIZE_MAX;
    (void)lg_program_find(program, function, &at, NULL);
    return outputs ? lg_program_outputs(program, at, count) : lg_program_inputs(program, at, count);
}

static bool is_derivative(const char *name) {
    static const char *const begins[] = {"fwd1_", "adj1_", "jac_"};
    bool is = false;
    for (size_t i = 0; i < LG_COUNT(begins); i++) is = is || strncmp(name, begins[i], strlen(begins[i])) == 0;
    return is;
}

bool export_trains_only(const lg_program *program, size_t function) {
    bool others = false;
    for (size_t i = 0; i < lg_program_functions(program); i++)
        others = others || !lg_program_is_fitted(program, i);
    return others && lg_program_is_fitted(program, function);
}

/* Returns whether a list with commas holds the name. */
static bool is_listed(const char *list, const char *name) {
    const size_t length = strlen(name);
    for (const char *at = list; at != NULL; at = strchr(at, ',')) {
        at += *at == ',';
        if (strncmp(at, name, length) == 0 && (at[length] == ',' || at[length] == '\0')) return true;
    }
    return false;
}

static void add_name(text *list, const char *name) {
    if (list->data == NULL || !is_listed(list->data, name))
        lg_text_add(list, "%s%s", list->length > 0 ? "," : "", name);
}

/* Adds the names of --functions to the list, each once. *missing: the first name that the program does not
 * have. */
static void add_given(const char *functions, const lg_program *program, text *list, char **missing) {
    size_t at;
    APP_FREE char *given = app_format("%s", functions);
    for (char *save = NULL, *name = strtok_r(given, ",", &save); name != NULL && *missing == NULL;
         name = strtok_r(NULL, ",", &save)) {
        if (lg_program_find(program, name, &at, NULL) == LG_OK)
            add_name(list, name);
        else
            *missing = app_format("%s", name);
    }
}

static void add_usual(const lg_program *program, const char *const *usual, text *list) {
    size_t at;
    for (size_t i = 0; usual[i] != NULL; i++)
        if (lg_program_find(program, usual[i], &at, NULL) == LG_OK) add_name(list, usual[i]);
    const bool all = list->length == 0;
    for (size_t i = 0; all && i < lg_program_functions(program); i++) {
        const char *name = lg_program_function_name(program, i);
        if (!is_derivative(name) && !export_trains_only(program, i)) add_name(list, name);
    }
}

/* Refuses an unknown function. `linearise` is written as C around the program of a machine; other targets
 * have derivatives of functions instead. */
static void refuse_function(const app *self, const lg_program *program, const char *name) {
    size_t at;
    lg_error error = {LG_OK, ""};
    if (strcmp(name, "linearise") == 0 && lg_program_find(program, "step", &at, NULL) == LG_OK)
        app_stop_usage(
            self,
            "--functions: linearise is for --target c only; other targets have derivatives of velocity and "
            "step by x and u (casadi: jac_NAME_velocity, jac_NAME_step; FMUs: directional derivatives)");
    else if (lg_program_find(program, name, &at, &error) != LG_OK)
        app_stop_usage(self, "--functions: %s", error.message);
}

char *export_choose(const app *self, const export_options *options, const lg_program *program,
                    const char *const *usual) {
    text list = app_text();
    char *missing = NULL;
    if (options->functions != NULL)
        add_given(options->functions, program, &list, &missing);
    else
        add_usual(program, usual, &list);
    if (missing != NULL || list.length == 0) refuse_function(self, program, missing != NULL ? missing : "");
    return list.data;
}

char *export_derive(const app *self, lg_program *program, lg_derivative_kind kind, const char *function) {
    static const char *const begins[LG_DERIVATIVE_KIND_COUNT] = {[LG_DERIVATIVE_FORWARD] = "fwd1_",
                                                                 [LG_DERIVATIVE_ADJOINT] = "adj1_",
                                                                 [LG_DERIVATIVE_JACOBIAN] = "jac_",
                                                                 [LG_DERIVATIVE_JACOBIAN_OF_ADJOINT] =
                                                                     "jac_adj1_"};
    size_t at;
    lg_error error = {LG_OK, ""};
    lg_derivative what;
    char *name = app_format("%s%s", begins[kind], function);
    if (lg_program_find(program, name, &at, NULL) == LG_OK) return name;
    lg_derivative_init(&what);
    what.kind = kind;
    what.function = function;
    if (app_had_memory(lg_program_derive(program, &what, &error)) == LG_OK) return name;
    app_warn(self, "%s has no %s: %s", function, name, error.message);
    free(name);
    return NULL;
}
