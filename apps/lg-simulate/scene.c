/* The scene: system, start, final time, and the names of the state's numbers. */
#include "lg-simulate/simulate.h"

#include <stdlib.h>
#include <string.h>

/* ---- names ---- */

static int by_offset(const void *a, const void *b) {
    const block *x = a, *y = b;
    return x->offset < y->offset ? -1 : x->offset > y->offset;
}

static void make_blocks(simulation *sim) {
    const lg_state_entry *rows = lg_system_state(lg_system_name(sim->system), lg_system_form(sim->system));
    const size_t links = lg_system_links(sim->system);
    sim->blocks = app_keep(sim->reported, sizeof *sim->blocks);
    for (const lg_state_entry *row = rows; row != NULL && row->key != NULL; row++)
        for (size_t i = 0, n = row->outer > 0 ? row->outer : links > 0 ? links : 1; i < n; i++) {
            const block at = {row->key, row->outer == 1 ? 0 : i + 1, row->first + i * row->stride,
                              row->rows * row->columns, row->columns};
            if (at.offset + at.count <= sim->reported) sim->blocks[sim->block_count++] = at;
        }
    qsort(sim->blocks, sim->block_count, sizeof *sim->blocks, by_offset);
}

void block_name(const block *at, char *text, size_t size) {
    if (at->index > 0)
        (void)snprintf(text, size, "%s%zu", at->key, at->index);
    else
        (void)snprintf(text, size, "%s", at->key);
}

void block_part(const block *at, size_t component, char *text, size_t size) {
    if (at->count == 9)
        (void)snprintf(text, size, "%zu%zu", component / 3 + 1, component % 3 + 1);
    else if (at->count == 3)
        (void)snprintf(text, size, "%c", "xyz"[component]);
    else if (at->count > 1)
        (void)snprintf(text, size, "%zu", component + 1);
    else
        text[0] = '\0';
}

const block *find_block(const simulation *sim, const char *key, size_t index) {
    for (size_t i = 0; i < sim->block_count; i++)
        if (strcmp(sim->blocks[i].key, key) == 0 &&
            (sim->blocks[i].index == index || sim->blocks[i].index == 0))
            return &sim->blocks[i];
    return NULL;
}

const double *parameter_values(const simulation *sim, const char *key, size_t *count) {
    const lg_parameter_entry *row =
        lg_system_parameters(lg_system_name(sim->system), lg_system_form(sim->system));
    const double *at = lg_system_parameter_values(sim->system);
    for (; row != NULL && row->key != NULL; row++) {
        *count = row->count > 0 ? row->count : lg_system_links(sim->system);
        if (strcmp(row->key, key) == 0) return at;
        at += *count;
    }
    return NULL;
}

/* ---- opening a scene ---- */

static void choose_t_end(simulation *sim, const char *path) {
    const simulate_values *values = sim->values;
    const lg_reals *times = &values->times;
    sim->t_end = values->t_end > 0      ? values->t_end
                 : sim->scene.has_t_end ? sim->scene.t_end
                 : times->count > 0     ? times->values[times->count - 1]
                                        : 0;
    if (!(sim->t_end > 0))
        app_stop_usage(sim->self, "there is no final time: give --t-end T, or the key t_end in %s", path);
    for (size_t i = 0; i < times->count; i++)
        if (times->values[i] < 0 || times->values[i] > sim->t_end ||
            (i > 0 && times->values[i] <= times->values[i - 1]))
            app_stop_usage(
                sim->self,
                "--times: %g is out of order or out of range; times must ascend and lie in [0, %g]",
                times->values[i], sim->t_end);
}

void simulation_open(app *self, const simulate_values *values, const char *path, simulation *out) {
    lg_scene *scene = &out->scene;
    *out = (simulation){.self = self, .values = values};
    APP_FILE(self, path, lg_scene_read, NULL, scene);
    /* A start is drawn at random only for the form hamiltonian; in an ensemble --vary and --members say what
     * is drawn. */
    if (!scene->has_initial && scene->line_form == 0 && values->ensemble == 0) {
        lg_scene_destroy(scene);
        APP_FILE(self, path, lg_scene_read, "hamiltonian", scene);
    }
    out->system = scene->system;
    const char *form = lg_system_form(out->system);
    (void)snprintf(out->title, sizeof out->title, "%s%s%s", lg_system_name(out->system),
                   form != NULL ? ", " : "", form != NULL ? form : "");
    /* Each member of an ensemble has its own start. */
    if (values->ensemble == 0) app_scene_start(self, scene, path);
    out->dim = lg_system_dim(out->system);
    out->reported = lg_system_reported(out->system);
    out->work = app_keep(lg_system_work_size(out->system), 1);
    for (int i = 0; i < 2; i++)
        app_must(self, lg_system_ode(out->system, (lg_coordinates)i, &out->ode[i], &out->user[i], out->work),
                 NULL);
    make_blocks(out);
    choose_t_end(out, path);
}
