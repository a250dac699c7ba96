/* Controllers: the function `control`, words about its input and output, and a self-test with a closed loop. */
#include "lg-export/policy/policy.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- words ---- */

static void add_names(const lg_policy_task *task, bool velocities, text *to) {
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &task->coordinate[i];
        const lg_policy_motion_row *row = lg_policy_motion_row_of(c->motion);
        const uint32_t count = velocities ? row->velocity : row->given;
        const char *name = velocities ? c->velocity : c->name;
        static const char *const units[LG_POLICY_MOTION_COUNT] = {"", " (rad)", " (a unit vector, 3)",
                                                                  " (quaternion w x y z, 4)"};
        if (name[0] == '\0') continue;
        lg_text_add(to, " %s", name);
        if (!velocities)
            lg_text_add(to, "%s", units[c->motion]);
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
        lg_text_add(to, " %s", c->name);
        for (uint32_t k = 0; k < count; k++) lg_text_add(to, " %g", c->goal[k]);
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
    lg_text_add(&source->state, "(%zu) positions as in the log,", j->given + j->velocities);
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
    *out = (export_policy_job){.self = self, .source = source};
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
    lg_program_destroy(j->program);
    lg_policy_destroy(j->policy);
    lg_free(j->self->context, j->text);
}

int export_policy_words(const app *self, const char *path, export_source *source) {
    export_policy_job j;
    lg_error error = {LG_OK, ""};
    const lg_status status = open_policy(self, path, source, &j, &error);
    if (status == LG_OK) {
        source->maps = true;
        tell(&j);
    }
    close_policy(&j);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, path);
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

static int write_policy(export_policy_job *j, const char *path) {
    export_source *source = j->source;
    source->maps = true;
    tell(j);
    int code = export_policy_loop(j);
    if (code == APP_EXIT_OK)
        code = export_whole(j->self, path, j->program, source->options->functions, source);
    if (code != APP_EXIT_OK) return code;
    export_size(source, "INPUTS", j->given + j->velocities, "numbers in x of NAME_control");
    export_size(source, "OUTPUTS", j->inputs, "numbers in u of NAME_control");
    lg_text_add(&source->sizes, "#define %s_PERIOD ", source->options->name);
    lg_text_add_real(&source->sizes, source->options->dtype, j->task->period);
    lg_text_add(&source->sizes, " /* seconds for which u is held */\n");
    return code;
}

int export_policy(const app *self, const char *path, export_source *source) {
    export_policy_job j;
    lg_error error = {LG_OK, ""};
    lg_status status = open_policy(self, path, source, &j, &error);
    if (status == LG_OK) status = load_program(&j, path, &error);
    const int code = status == LG_OK ? write_policy(&j, path) : app_fail_file(self, status, &error, path);
    close_policy(&j);
    return code;
}
