/* Controllers: the function `control`, words about it, and a self-test with a closed loop. */
#include "lg-export/policy/policy.h"

#include <stdlib.h>
#include <string.h>

/* ---- words ---- */

static void add_names(const lg_policy_task *task, bool velocities, text *to) {
    const char *before = ""; /* what no sensor measures */
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &task->coordinate[i];
        const char *kept = c->ago > 0          ? ", past inputs"
                           : c->follows > 0    ? ", lagged inputs"
                           : c->integrates > 0 ? ", integrals"
                                               : "";
        if (!velocities && strcmp(kept, before) != 0) lg_text_add(to, "%s", kept);
        before = kept;
        const lg_policy_motion_row *row = lg_policy_motion_row_of(c->motion);
        const uint32_t count = velocities ? row->velocity : row->given;
        const char *name = velocities ? c->velocity : c->name;
        static const char *const units[LG_POLICY_MOTION_COUNT] = {"", " (rad)", " (a unit vector, 3)",
                                                                  " (quaternion w x y z, 4)"};
        if (name[0] == '\0') continue;
        lg_text_add(to, " %s", name);
        if (!velocities)
            lg_text_add(to, "%s%s", units[c->motion], c->free ? " (free: its number is not used)" : "");
        else if (count > 1)
            lg_text_add(to, " (%u)", count);
    }
}

static void add_input(const export_policy_job *j, text *to) {
    lg_text_add(to, "(%zu) ", j->inputs);
    for (uint32_t l = 0; l < j->task->input_count; l++) {
        const lg_policy_input *in = &j->task->input[l];
        lg_text_add(to, "%s%s from %g to %g", l > 0 ? ", " : "", in->name, in->low, in->high);
    }
    lg_text_add(to, "; to be held for a period of %g s, then call again", j->task->period);
}

static void add_goal(const export_policy_job *j, text *to) {
    lg_text_add(to, "goal         ");
    for (uint32_t i = 0; i < j->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        const uint32_t count = lg_policy_motion_row_of(c->motion)->position;
        lg_text_add(to, " %s%s", c->name, c->free ? " anywhere" : "");
        for (uint32_t k = 0; k < count && !c->free; k++) lg_text_add(to, " %g", c->goal[k]);
    }
    lg_text_add(to, "%s\n", j->velocities > 0 ? ", at rest" : "");
}

static void add_starts(const export_policy_job *j, text *to) {
    lg_text_add(to, "starts       ");
    for (uint32_t i = 0; i < j->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        lg_text_add(to, "%s %s %g to %g", i > 0 ? ";" : "", c->name, c->start[0], c->start[1]);
        if (c->velocity[0] != '\0')
            lg_text_add(to, ", %s %g to %g", c->velocity, c->start_velocity[0], c->start_velocity[1]);
    }
    lg_text_add(to, "; from the goal, trained and judged for these\n");
}

static void tell(const export_policy_job *j) {
    export_source *source = j->source;
    text *about = &source->about;
    const bool net = j->task->kind == LG_POLICY_NETWORK;
    lg_text_add(about, "Controller of lg-control: kind %s%s.\n\n", lg_policy_kind_name(j->task->kind),
                net && j->task->gate ? ", with the linear regulator at the goal" : "");
    lg_text_add(&source->state, "(%zu) %s", j->given + j->velocities,
                j->velocities > 0 ? "positions as in the log," : "states of the plant's program:");
    add_names(j->task, false, &source->state);
    if (j->velocities > 0) lg_text_add(&source->state, ", then velocities");
    add_names(j->task, true, &source->state);
    add_input(j, &source->input);
    export_tell_words(source, about);
    lg_text_add(about, "units         as in the log; angles in radians, seconds\n");
    add_goal(j, about);
    add_starts(j, about);
}

/* ---- opening ---- */

static lg_status open_policy(const app *self, const char *path, export_source *source, export_policy_job *out,
                             lg_error *error) {
    *out = (export_policy_job){.self = self, .source = source, .declarations = app_text()};
    LG_TRY(lg_policy_load(self->context, path, NULL, &out->policy, &out->text, error));
    out->task = lg_policy_task_of(out->policy);
    out->inputs = out->task->input_count;
    for (uint32_t i = 0; i < out->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &out->task->coordinate[i];
        const lg_policy_motion_row *row = lg_policy_motion_row_of(c->motion);
        out->positions += row->position;
        out->given += row->given;
        out->velocities += c->velocity[0] != '\0' ? row->velocity : 0;
    }
    return LG_OK;
}

static void close_policy(export_policy_job *j) {
    lg_text_destroy(&j->declarations);
    lg_program_destroy(j->program);
    lg_policy_destroy(j->policy);
    lg_free(j->self->context, j->text);
}

void export_policy_words(const app *self, const char *path, export_source *source) {
    export_policy_job j;
    lg_error error = {LG_OK, ""};
    app_must_file(self, open_policy(self, path, source, &j, &error), &error, path);
    source->maps = true;
    tell(&j);
    close_policy(&j);
}

/* ---- functions around the policy ---- */

void export_policy_simple(const export_policy_job *j, const char *function) {
    for (uint32_t i = 0; i < j->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        if (c->motion > LG_POLICY_ANGLE)
            app_stop_usage(j->self,
                           "--functions %s: '%s' is a %s; this is for plants of lines and angles only",
                           function, c->name, lg_policy_motion_row_of(c->motion)->name);
    }
    if (j->velocities == j->given && j->state == 2 * j->given) return;
    app_stop_usage(j->self,
                   "--functions %s: the plant's state must be positions and one momentum for each position, "
                   "without lags of inputs",
                   function);
}

void export_policy_real(const export_policy_job *j, text *to, const char *name, double value) {
    lg_text_add(to, "static const real %s = ", name);
    lg_text_add_real(to, j->source->options->dtype, value);
    lg_text_add(to, ";\n");
}

void export_policy_reals(const export_policy_job *j, text *to, const char *type, const char *name,
                         const double *values, size_t count) {
    const lg_dtype dtype = strcmp(type, "real") == 0 ? j->source->options->dtype : LG_F64;
    lg_text_add(to, "static const %s %s[%zu] = {\n", type, name, count);
    lg_text_add_reals(to, dtype, 4, values, count);
    lg_text_add(to, "};\n");
}

void export_policy_need(export_source *source, size_t work, size_t stack, size_t calls) {
    if (work > source->further_work) source->further_work = work;
    source->stack += stack;
    source->calls += calls;
}

static const struct {
    const char *name;
    void (*add)(export_policy_job *job);
    const char *check; /* Its part of the self-test. */
} around[] = {{"observe", export_policy_observe, "check_observer"},
              {"adapt", export_policy_adapt, "check_adaptation"}};

/* Adds what --functions names of the table; the other names, or `control`, are left in `rest`. */
static void add_around(export_policy_job *j, text *rest) {
    text checks = app_text();
    APP_FREE char *list = app_format("%s", j->source->options->functions);
    bool taken[LG_COUNT(around)] = {false};
    for (char *save = NULL, *name = strtok_r(list, ",", &save); name != NULL;
         name = strtok_r(NULL, ",", &save)) {
        size_t i = 0;
        while (i < LG_COUNT(around) && strcmp(around[i].name, name) != 0) i++;
        if (i == LG_COUNT(around))
            lg_text_add(rest, "%s%s", rest->length > 0 ? "," : "", name);
        else
            taken[i] = true;
    }
    for (size_t i = 0; i < LG_COUNT(around); i++) {
        if (!taken[i]) continue;
        around[i].add(j);
        lg_text_add(&checks, " + %s()", around[i].check);
    }
    if (rest->length == 0) lg_text_add(rest, "control");
    lg_text_add(&j->source->further_test, "static int further(void) {\n    return check_loop()%s;\n}\n",
                checks.data != NULL ? checks.data : "");
    lg_text_destroy(&checks);
}

/* ---- C ---- */

static lg_status load_program(export_policy_job *j, const char *path, lg_error *error) {
    size_t count;
    LG_TRY(lg_program_load(j->self->context, path, NULL, &j->program, error));
    j->state = lg_shape_count(export_ports(j->program, "period", false, &count)[0].shape);
    /* export_whole rounds again, and counts what is lost. */
    const size_t lost = j->source->lost;
    const lg_status status = export_round_parameters(j->source, j->program);
    j->source->lost = lost;
    return status;
}

static bool names_control(const char *list) {
    const char *at = strstr(list, "control");
    return at != NULL && (at == list || at[-1] == ',') && (at[7] == ',' || at[7] == '\0');
}

static void write_policy(export_policy_job *j, const char *path) {
    export_source *source = j->source;
    text functions = app_text();
    source->maps = true;
    tell(j);
    export_policy_loop(j);
    add_around(j, &functions);
    static const char *const besides[] = {"track", "lagged", "remember",
                                          "reset"}; /* By default, if the policy has them. */
    size_t found;
    for (size_t i = 0; i < LG_COUNT(besides); i++)
        if (strcmp(source->options->functions, "control") == 0 &&
            lg_program_find(j->program, besides[i], &found, NULL) == LG_OK)
            lg_text_add(&functions, ",%s", besides[i]);
    /* The closed loop needs it. */
    if (!names_control(functions.data)) lg_text_add(&functions, ",control");
    export_whole(j->self, path, j->program, functions.data, source);
    lg_text_destroy(&functions);
    if (j->declarations.length > 0) lg_text_add(&source->declarations, "%s", j->declarations.data);
    export_size(source, "INPUTS", j->given + j->velocities, "numbers in x of control");
    export_size(source, "GIVEN", j->given,
                j->velocities > 0 ? "of these are positions" : "of these are states");
    export_size(source, "OUTPUTS", j->inputs, "numbers in u of control");
    lg_text_add(&source->sizes, "#define %s_PERIOD ", source->options->name);
    lg_text_add_real(&source->sizes, source->options->dtype, j->task->period);
    lg_text_add(&source->sizes, " /* seconds for which u is held */\n");
}

void export_policy(const app *self, const char *path, export_source *source) {
    export_policy_job j;
    lg_error error = {LG_OK, ""};
    lg_status status = open_policy(self, path, source, &j, &error);
    if (status == LG_OK) status = load_program(&j, path, &error);
    app_must_file(self, status, &error, path);
    write_policy(&j, path);
    close_policy(&j);
}
