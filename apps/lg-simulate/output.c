/* --out: the trajectory as HDF5. */
#include "lg-simulate/simulate.h"

#include <stdlib.h>
#include <string.h>

static lg_provenance provenance_of(const app *self) {
    lg_provenance out = {.has_seed = false};
    (void)snprintf(out.command, sizeof out.command, "%s", self->command_line);
    (void)lg_cpu_describe(out.cpu, sizeof out.cpu);
    return out;
}

static lg_status put_texts(const report *what, const lg_archive_writer *to) {
    char steps[32];
    const lg_system *system = what->sim->system;
    const char *form = lg_system_form(system);
    (void)snprintf(steps, sizeof steps, "%zu", what->run->stats.steps);
    const char *const texts[][2] = {{"system", lg_system_name(system)},
                                    {"form", form != NULL ? form : ""},
                                    {"layout", lg_system_layout(system)},
                                    {"method", what->how->scheme->name},
                                    {"steps", steps}};
    lg_status status = LG_OK;
    for (size_t i = 0; i < LG_COUNT(texts) && status == LG_OK; i++)
        if (texts[i][1][0] != '\0') status = to->text(to->user, texts[i][0], texts[i][1]);
    return status;
}

/* /t (M), /trajectory (M, d) */
static lg_status put_states(const report *what, const lg_archive_writer *to) {
    const samples *path = what->path;
    const size_t d = what->sim->reported, dim = what->sim->dim;
    const uint64_t dims[] = {path->kept, d};
    double *rows = app_alloc(path->kept, d * sizeof *rows);
    for (size_t i = 0; i < path->kept; i++)
        memcpy(rows + i * d, path->y + (path->first + i) * dim, d * sizeof *rows);
    lg_status status = to->array(to->user, "t", LG_ELEMENT_F64, 1, dims, path->t + path->first);
    if (status == LG_OK) status = to->array(to->user, "trajectory", LG_ELEMENT_F64, 2, dims, rows);
    free(rows);
    return status;
}

/* /invariants/NAME (M) */
static lg_status put_invariants(const report *what, const lg_archive_writer *to) {
    const samples *path = what->path;
    const uint64_t dims[] = {path->kept};
    lg_status status = LG_OK;
    double *values = app_alloc(path->kept, sizeof *values);
    for (size_t k = 0; k < what->seen->invariants && status == LG_OK; k++) {
        char *name = app_format("invariants/%s", lg_system_invariant_name(what->sim->system, k));
        for (size_t i = 0; i < path->kept; i++)
            values[i] = lg_system_invariant(what->sim->system, k,
                                            path->y + (path->first + i) * what->sim->dim, what->seen->work);
        status = to->array(to->user, name, LG_ELEMENT_F64, 1, dims, values);
        free(name);
    }
    free(values);
    return status;
}

lg_status write_trajectory(const report *what, lg_error *error) {
    const app *self = what->sim->self;
    const lg_provenance provenance = provenance_of(self);
    lg_archive_writer to;
    lg_file_writer *writer = NULL;
    lg_status status = lg_file_writer_create(self->context, what->sim->values->out, "trajectory", &provenance,
                                             &writer, error);
    if (status != LG_OK) return status;
    status = lg_file_writer_archive(writer, "", &to);
    if (status == LG_OK) status = put_texts(what, &to);
    if (status == LG_OK) status = put_states(what, &to);
    if (status == LG_OK) (void)put_invariants(what, &to);
    /* What failed in the archive sticks to the writer, and the commit says it. */
    status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}
