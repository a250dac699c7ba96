/* Controllers: the function `control`, words about it, and a self-test with a closed loop. */
#include "lg-export/policy/policy.h"

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
            lg_text_add(to, "%s%s", units[c->motion], c->free ? " (free: any finite number)" : "");
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

static void open_policy(const app *self, const char *path, export_source *source, export_policy_job *out) {
    *out = (export_policy_job){.self = self, .source = source, .declarations = app_text()};
    APP_FILE(self, path, lg_policy_load, NULL, &out->policy, NULL);
    const lg_policy *p = out->policy;
    out->task = &p->task, out->program = p->program;
    out->given = p->layout.given, out->velocities = p->layout.velocities;
    out->state = p->state, out->inputs = p->inputs;
}

static void close_policy(export_policy_job *j) {
    lg_text_destroy(&j->declarations);
    lg_policy_destroy(j->policy);
}

lg_program *export_policy_load(const app *self, const char *path, export_source *source) {
    export_policy_job j;
    open_policy(self, path, source, &j);
    source->maps = true;
    tell(&j);
    j.policy->program = NULL;
    close_policy(&j);
    return j.program;
}

/* ---- C ---- */

static void prepare_program(export_policy_job *j) {
    EXPORT_MUST(j, lg_policy_add(j->policy, "sensed_by_control", &error));
    /* export_whole rounds again, and counts what is lost. */
    const size_t lost = j->source->lost;
    APP_MUST(j->self, export_round_parameters(j->source, j->program));
    j->source->lost = lost;
    if (j->policy->parameters > 0) /* The library's runs use the rounded ones too. */
        memcpy(j->policy->theta,
               lg_program_parameter(j->program, lg_program_parameters(j->program) - 1).values,
               j->policy->parameters * sizeof *j->policy->theta);
}

static bool is_named(const char *list, const char *name) {
    const char *at = strstr(list, name);
    const size_t length = strlen(name);
    return at != NULL && (at == list || at[-1] == ',') && (at[length] == ',' || at[length] == '\0');
}

static void write_policy(export_policy_job *j, const char *path) {
    export_source *source = j->source;
    static const struct {
        const char *name;
        void (*add)(export_policy_job *job);
    } kept[] = {{"observe", export_policy_observe}, {"adapt", export_policy_adapt}};
    static const char *const besides[] = {"track", "lagged", "remember",
                                          "reset"}; /* By default, if the policy has them. */
    const char *given = source->options->functions;
    export_names functions;
    source->maps = true;
    tell(j);
    export_policy_loop(j);
    for (size_t i = 0; i < LG_COUNT(kept); i++)
        if (is_named(given, kept[i].name)) kept[i].add(j);
    export_choose(j->self, source->options, j->program, NULL, &functions);
    for (size_t i = 0; i < LG_COUNT(besides) && strcmp(given, "control") == 0; i++)
        (void)export_add_name(&functions, j->program, besides[i]);
    (void)export_add_name(&functions, j->program, "control"); /* The closed loop needs it. */
    export_whole(j->self, path, j->program, &functions, source);
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
    open_policy(self, path, source, &j);
    prepare_program(&j);
    write_policy(&j, path);
    close_policy(&j);
}
