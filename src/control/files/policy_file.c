/* Policies in files: the program, the task's text, what the plant calls its coordinates, and the regulator.
 */
#include <stdio.h>
#include <string.h>

#include "control/policy.h"
#include "files/h5.h"
#include "model/files/program_file.h"

static const char group[] = "policy", kind[] = "policy";

/* Arrays of the file, and where they lie in the policy. */
typedef struct array {
    const char *name;
    uint32_t rank;
    uint64_t dims[2];
    double *at;
} array;
enum { ARRAYS = 10 };

static void list_arrays(lg_policy *p, array out[ARRAYS]) {
    const uint64_t n = p->layout.errors, m = p->inputs;
    lg_policy_regulator *g = &p->regulator;
    const array all[ARRAYS] = {{"policy/K", 2, {m, n}, g->K},
                               {"policy/near", 2, {m, n}, g->near},
                               {"policy/P", 2, {n, n}, g->P},
                               {"policy/u0", 1, {m, 0}, g->u0},
                               {"policy/level", 0, {0, 0}, &g->c},
                               {"policy/radius", 0, {0, 0}, &g->radius},
                               {"policy/scale", 1, {n, 0}, p->scale},
                               {"policy/G", 2, {m, n}, p->G},
                               {"policy/terminal", 0, {0, 0}, &p->terminal},
                               {"policy/dead_time", 1, {m, 0}, p->task.dead_time}};
    memcpy(out, all, sizeof all);
}

/* ---- saving ---- */

enum { LINE = 3 * LG_POLICY_NAME };

/* Each coordinate has a line: its name, its kind, the name of its velocity (- if it has none), then the
 * numbers of the input that it follows, of periods ago, and of the coordinate that it integrates (0: none of
 * them). Tabs separate them. */
static lg_status put_names(lg_h5 *h5, const lg_policy *p, lg_error *error) {
    char lines[LG_POLICY_COORDINATES][LINE], inputs[LG_POLICY_INPUTS][LG_POLICY_NAME];
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        (void)snprintf(lines[i], LINE, "%s\t%s\t%s\t%u\t%u\t%u", c->name,
                       lg_policy_motion_row_of(c->motion)->name, c->velocity[0] != '\0' ? c->velocity : "-",
                       c->follows, c->ago, c->integrates);
    }
    for (uint32_t l = 0; l < p->inputs; l++) memcpy(inputs[l], p->task.input[l].name, LG_POLICY_NAME);
    LG_TRY(lg_h5_put_text_list(h5, group, "coordinates", lines[0], LINE, p->task.coordinate_count, error));
    return lg_h5_put_text_list(h5, group, "inputs", inputs[0], LG_POLICY_NAME, p->inputs, error);
}

static lg_status put_all(lg_h5 *h5, lg_policy *p, const char *text, const lg_provenance *provenance,
                         lg_error *error) {
    array arrays[ARRAYS];
    const uint32_t substeps = p->task.substeps;
    list_arrays(p, arrays);
    LG_TRY(lg_h5_put_header(h5, kind, provenance, error));
    LG_TRY(lg_program_put_parameters(h5, p->program, NULL, 0, error));
    LG_TRY(lg_program_put_functions(h5, p->program, error));
    for (size_t i = 0; i < ARRAYS; i++)
        LG_TRY(lg_h5_put(h5, arrays[i].name, LG_ELEMENT_F64, arrays[i].rank, arrays[i].dims, arrays[i].at,
                         error));
    LG_TRY(put_names(h5, p, error));
    LG_TRY(lg_h5_put_number(h5, group, "substeps", LG_ELEMENT_U32, &substeps, error));
    return lg_h5_put_text(h5, group, "task", text, error);
}

lg_status lg_policy_save(const lg_context *context, const char *path, const lg_policy *policy,
                         const char *text, const lg_provenance *provenance, lg_error *error) {
    lg_h5 *h5;
    LG_NEEDS(error, path, policy, text);
    if (strlen(text) >= LG_H5_TEXT)
        return lg_fail(error, LG_FORMAT,
                       "the task has %zu bytes, more than the %d that a policy's file keeps", strlen(text),
                       LG_H5_TEXT - 1);
    LG_TRY(lg_h5_create(context, path, &h5, error));
    return lg_h5_finish(h5, put_all(h5, (lg_policy *)(uintptr_t)policy, text, provenance, error), error);
}

/* ---- loading ---- */

typedef struct loading {
    lg_policy *policy;
    char text[LG_H5_TEXT];
} loading;

static lg_status bad_name(const char *text, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "/policy: '%.60s' is no coordinate or input of a policy", text);
}

static lg_status take_coordinate(void *user, uint64_t index, const char *text, lg_error *error) {
    lg_policy_task *task = user;
    char name[LINE], motion[LINE], velocity[LINE];
    unsigned follows, ago, integrates;
    if (index >= LG_POLICY_COORDINATES || strlen(text) >= LINE ||
        sscanf(text, "%[^\t]\t%[^\t]\t%[^\t]\t%u\t%u\t%u", name, motion, velocity, &follows, &ago,
               &integrates) != 6 ||
        strlen(name) >= LG_POLICY_NAME || strlen(velocity) >= LG_POLICY_NAME || follows > LG_POLICY_INPUTS ||
        ago > LG_POLICY_COORDINATES || (ago > 0 && follows == 0) || integrates > index)
        return bad_name(text, error);
    lg_policy_coordinate *c = &task->coordinate[task->coordinate_count++];
    memcpy(c->name, name, strlen(name) + 1);
    c->follows = follows, c->ago = ago, c->integrates = integrates;
    if (strcmp(velocity, "-") != 0) memcpy(c->velocity, velocity, strlen(velocity) + 1);
    uint32_t k = 0;
    while (k < LG_POLICY_MOTION_COUNT &&
           strcmp(lg_policy_motion_row_of((lg_policy_motion)k)->name, motion) != 0)
        k++;
    if (k == LG_POLICY_MOTION_COUNT) return bad_name(text, error);
    c->motion = (lg_policy_motion)k;
    return LG_OK;
}

static lg_status take_input(void *user, uint64_t index, const char *text, lg_error *error) {
    lg_policy_task *task = user;
    if (index >= LG_POLICY_INPUTS || strlen(text) >= LG_POLICY_NAME) return bad_name(text, error);
    memcpy(task->input[task->input_count++].name, text, strlen(text) + 1);
    return LG_OK;
}

static lg_status get_task(lg_h5 *h5, loading *l, lg_error *error) {
    lg_policy_task *task = &l->policy->task;
    bool words = false;
    lg_policy_task_init(task);
    LG_TRY(lg_h5_each_name(h5, group, "coordinates", NULL, &words, take_coordinate, task, error));
    if (words) LG_TRY(lg_h5_each_name(h5, group, "inputs", NULL, &words, take_input, task, error));
    if (!words) return lg_fail(error, LG_FORMAT, "/policy: the names of coordinates and inputs are missing");
    LG_TRY(lg_h5_text(h5, group, "task", l->text, sizeof l->text, error));
    LG_TRY(lg_policy_task_parse(h5->context, h5->path, l->text, task, error));
    return lg_h5_number(h5, group, "substeps", LG_ELEMENT_U32, &task->substeps, error);
}

static lg_status load(void *user, lg_h5 *h5, lg_error *error) {
    loading *l = user;
    lg_policy *p = l->policy;
    array arrays[ARRAYS];
    LG_TRY(lg_h5_check_format(h5, kind, false, error));
    LG_TRY(lg_as_format(get_task(h5, l, error), error));
    LG_TRY(lg_as_format(lg_policy_prepare(p, error), error));
    list_arrays(p, arrays);
    for (size_t i = 0; i < ARRAYS; i++) {
        const array *a = &arrays[i];
        LG_TRY(lg_as_format(lg_h5_get(h5, a->name, LG_ELEMENT_F64, a->rank, a->dims, a->at, error), error));
    }
    LG_TRY(lg_program_get(h5, &p->program, error));
    return lg_as_format(lg_policy_adopt(p, error), error);
}

lg_status lg_policy_load(const lg_context *context, const char *path, const lg_read_options *options,
                         lg_policy **out, char **text, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_policy_destroy_at) lg_policy *policy = lg_alloc(context, 1, sizeof *policy);
    if (policy == NULL) return lg_no_memory(error);
    policy->context = context;
    loading l = {.policy = policy};
    LG_TRY(lg_h5_read(context, path, options, load, &l, error));
    if (text != NULL && (*text = lg_strdup(context, l.text)) == NULL) return lg_no_memory(error);
    return LG_MOVE(out, policy);
}
