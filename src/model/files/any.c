/* A model file of any kind, as one handle. */
#include <string.h>

#include "core/core.h"
#include "files/h5.h"
#include "model/files/run.h"
#include "liegrad/machine_model.h"

/* ---- the kinds: load into a file structure, make a model of it, release ---- */

static lg_status load_hamiltonian(const lg_context *context, const char *path, const lg_read_options *options,
                                  lg_model_file *out, lg_error *error) {
    return lg_model_load_hamiltonian(context, path, options, &out->hamiltonian, error);
}

static lg_status make_hamiltonian(const lg_context *context, lg_model_file *file, lg_error *error) {
    return lg_model_create_hamiltonian(context, &file->hamiltonian.run.model, file->hamiltonian.theta,
                                       &file->model, error);
}

static void free_hamiltonian(lg_model_file *file) {
    lg_hamiltonian_file_destroy(&file->hamiltonian);
}

static lg_status load_surrogate(const lg_context *context, const char *path, const lg_read_options *options,
                                lg_model_file *out, lg_error *error) {
    return lg_model_load_surrogate(context, path, options, &out->surrogate, error);
}

static lg_status make_surrogate(const lg_context *context, lg_model_file *file, lg_error *error) {
    return lg_model_create_surrogate(context, &file->surrogate.run.model, file->surrogate.theta, &file->model,
                                     error);
}

static void free_surrogate(lg_model_file *file) {
    lg_surrogate_file_destroy(&file->surrogate);
}

static lg_status load_detector(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_model_file *out, lg_error *error) {
    return lg_model_load_detector(context, path, options, &out->detector, error);
}

static lg_status make_detector(const lg_context *context, lg_model_file *file, lg_error *error) {
    return lg_model_create_detector(context, &file->detector.run.model, &file->detector.scaler,
                                    file->detector.theta, &file->model, error);
}

static void free_detector(lg_model_file *file) {
    lg_detector_file_destroy(&file->detector);
}

static lg_status load_table(const lg_context *context, const char *path, const lg_read_options *options,
                            lg_model_file *out, lg_error *error) {
    return lg_model_load_table(context, path, options, &out->table, error);
}

static lg_status make_table(const lg_context *context, lg_model_file *file, lg_error *error) {
    return lg_model_create_table(context, &file->table.run.model, &file->table.inputs, &file->table.outputs,
                                 file->table.theta, &file->model, error);
}

static void free_table(lg_model_file *file) {
    lg_table_file_destroy(&file->table);
}

/* A machine's file is large: it has memory of its own. */
static lg_status load_machine(const lg_context *context, const char *path, const lg_read_options *options,
                              lg_model_file *out, lg_error *error) {
    lg_machine_model_file *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a machine");
    const lg_status status = lg_model_load_machine_model(context, path, options, made, error);
    if (status == LG_OK)
        out->machine = made;
    else
        lg_free(context, made);
    return status;
}

static lg_status make_machine(const lg_context *context, lg_model_file *file, lg_error *error) {
    return lg_model_create_machine(context, &file->machine->run.machine, file->machine->theta, &file->model,
                                   error);
}

static void free_machine(lg_model_file *file) {
    if (file->machine == NULL) return;
    const lg_context *context = file->machine->context;
    lg_machine_model_file_destroy(file->machine);
    lg_free(context, file->machine);
}

typedef struct kind_row {
    lg_status (*load)(const lg_context *context, const char *path, const lg_read_options *options,
                      lg_model_file *out, lg_error *error);
    lg_status (*make)(const lg_context *context, lg_model_file *file, lg_error *error);
    void (*release)(lg_model_file *file);
    const lg_run_kind *run; /* its name is the attribute `kind` */
    size_t member;          /* of lg_model_file: the file structure, */
    bool apart;             /* or a pointer to it */
} kind_row;

#define KIND(kind, run, apart)                                                                               \
    { load_##kind, make_##kind, free_##kind, &run, offsetof(lg_model_file, kind), apart }
static const kind_row rows[LG_MODEL_KIND_COUNT] = {
    [LG_MODEL_HAMILTONIAN] = KIND(hamiltonian, lg_run_hamiltonian, false),
    [LG_MODEL_SURROGATE] = KIND(surrogate, lg_run_surrogate, false),
    [LG_MODEL_DETECTOR] = KIND(detector, lg_run_detector, false),
    [LG_MODEL_TABLE] = KIND(table, lg_run_table, false),
    [LG_MODEL_MACHINE] = KIND(machine, lg_run_machine_model, true)};

/* ---- what is no model ---- */

/* Words for the sentence; the last row is for any other kind. */
static const struct {
    const char *kind, *what;
} others[] = {
    {"", "the file does not say what it is (attribute kind)"},
    {"checkpoint", "it is the checkpoint of an unfinished training"},
    {"surrogate-checkpoint", "it is the checkpoint of an unfinished training"},
    {"detector-checkpoint", "it is the checkpoint of an unfinished training"},
    {"table-checkpoint", "it is the checkpoint of an unfinished training"},
    {"machine-checkpoint", "it is the checkpoint of an unfinished training"},
    {"classifier", "it is a classical classifier, which lg_classifier_load reads"},
    {"program", "it is a program of functions, which lg_program_load reads"},
    {"trajectories", "it holds data, trajectories"},
    {"trajectory", "it holds data, a trajectory"},
    {"elastica", "it holds data, curves of the elastica"},
    {"series", "it holds data, labelled series"},
    {NULL, "its kind is unknown"},
};

static lg_status refuse(const char *path, const char *kind, lg_error *error) {
    size_t i = 0;
    while (others[i].kind != NULL && strcmp(others[i].kind, kind) != 0) i++;
    return lg_fail(
        error, LG_FORMAT,
        "%s: attribute kind is '%s', expected hamiltonian, surrogate, detector, table or machine_model: %s",
        lg_shown_path(path), kind, others[i].what);
}

/* ---- outside ---- */

enum { KIND_TEXT = 64 };

lg_status lg_model_load(const lg_context *context, const char *path, const lg_read_options *options,
                        lg_model_file *out, lg_error *error) {
    char kind[KIND_TEXT];
    size_t i = 0;
    if (path == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name, the model a place");
    LG_TRY(lg_file_kind(context, path, options, kind, sizeof kind, error));
    while (i < LG_MODEL_KIND_COUNT && strcmp(rows[i].run->name, kind) != 0) i++;
    if (i == LG_MODEL_KIND_COUNT) return refuse(path, kind, error);
    lg_model_file made = {.kind = (lg_model_kind)i};
    LG_TRY(rows[i].load(context, path, options, &made, error));
    const lg_status status = rows[i].make(context, &made, error);
    if (status == LG_OK)
        *out = made;
    else
        lg_model_file_destroy(&made);
    return status;
}

void lg_model_file_destroy(lg_model_file *file) {
    if (file == NULL) return;
    lg_model_destroy(file->model);
    if ((unsigned)file->kind < LG_MODEL_KIND_COUNT) rows[file->kind].release(file);
    memset(file, 0, sizeof *file);
}

/* ---- parameters ---- */

bool lg_model_file_slice(const lg_model_file *file, uint32_t index, lg_slice_info *out,
                         const double **values) {
    const kind_row *row = &rows[file->kind];
    const lg_run_kind *kind = row->run;
    const char *at = (const char *)file + row->member;
    if (row->apart) at = *(const char *const *)(const void *)at;
    if (!kind->slice(at + kind->file_run, index, out)) return false;
    *values = *(double *const *)(const void *)(at + kind->file_theta) + out->offset;
    return true;
}
