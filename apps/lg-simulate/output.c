/* --out: writes the trajectory as HDF5. The writer remembers the first error, and the commit returns it. */
#include "common/train.h"
#include "lg-simulate/simulate.h"

#include <string.h>

static void put_texts(const report *what, const lg_archive_writer *to) {
    char steps[32];
    const lg_system *system = what->sim->system;
    (void)snprintf(steps, sizeof steps, "%zu", what->run->stats.steps);
    const char *const texts[][2] = {{"system", lg_system_name(system)},
                                    {"form", lg_system_form(system)},
                                    {"layout", lg_system_layout(system)},
                                    {"method", what->how->scheme->name},
                                    {"steps", steps}};
    for (size_t i = 0; i < LG_COUNT(texts); i++)
        if (texts[i][1] != NULL) (void)to->text(to->user, texts[i][0], texts[i][1]);
}

/* Writes /t (M) and /trajectory (M, d). */
static void put_states(const report *what, const lg_archive_writer *to) {
    const samples *path = what->path;
    const size_t d = what->sim->reported, dim = what->sim->dim;
    const uint64_t dims[] = {path->kept, d};
    APP_FREE double *rows = app_alloc(path->kept, d * sizeof *rows);
    for (size_t i = 0; i < path->kept; i++)
        memcpy(rows + i * d, path->y + (path->first + i) * dim, d * sizeof *rows);
    (void)to->array(to->user, "t", LG_ELEMENT_F64, 1, dims, path->t + path->first);
    (void)to->array(to->user, "trajectory", LG_ELEMENT_F64, 2, dims, rows);
}

/* Writes /invariants/NAME (M) for each invariant. */
static void put_invariants(const report *what, const lg_archive_writer *to) {
    const samples *path = what->path;
    const uint64_t dims[] = {path->kept};
    APP_FREE double *values = app_alloc(path->kept, sizeof *values);
    for (size_t k = 0; k < what->seen->invariants; k++) {
        APP_FREE char *name = app_format("invariants/%s", lg_system_invariant_name(what->sim->system, k));
        for (size_t i = 0; i < path->kept; i++)
            values[i] = lg_system_invariant(what->sim->system, k,
                                            path->y + (path->first + i) * what->sim->dim, what->seen->work);
        (void)to->array(to->user, name, LG_ELEMENT_F64, 1, dims, values);
    }
}

lg_status write_trajectory(const report *what, lg_error *error) {
    const app *self = what->sim->self;
    lg_provenance provenance = app_provenance(self, 0);
    lg_archive_writer to;
    lg_file_writer *writer = NULL;
    provenance.has_seed = false;
    LG_TRY(lg_file_writer_create(self->context, what->sim->values->out, "trajectory", &provenance, &writer,
                                 error));
    (void)app_had_memory(lg_file_writer_archive(writer, "", &to));
    put_texts(what, &to);
    put_states(what, &to);
    put_invariants(what, &to);
    const lg_status status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}
