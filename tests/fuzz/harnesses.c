/* The table of harnesses, and the file that they write for the readers. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "files/h5.h"
#include "fuzz.h"

const fuzz_harness fuzz_harnesses[] = {
    {"scene", fuzz_scene, FORM_YAML, 1024, "scenes (YAML)"},
    {"machine", fuzz_machine, FORM_YAML, 1536, "machines (YAML)"},
    {"task", fuzz_task, FORM_YAML, 1024, "tasks of controllers (YAML)"},
    {"scheme", fuzz_scheme, FORM_YAML, 512, "schemes of integration (YAML)"},
    {"grid", fuzz_grid, FORM_YAML, 768, "grids of studies (YAML)"},
    {"search", fuzz_search, FORM_YAML, 768, "ranges of searches (YAML)"},
    {"trials", fuzz_trials, FORM_BYTES, 1024, "trials of a search (CSV)"},
    {"study", fuzz_study, FORM_BYTES, 512, "table of a study (CSV)"},
    {"table", fuzz_table, FORM_BYTES, 512, "tables (CSV)"},
    {"log", fuzz_log, FORM_BYTES, 512, "logs of machines (CSV)"},
    {"npy", fuzz_npy, FORM_NPY, 512, "tables (numpy)"},
    {"tensors", fuzz_tensors, FORM_TENSORS, 1024, "weights (safetensors)"},
    {"feed", fuzz_feed, FORM_BYTES, 512, "the feed of lg-anomaly watch"},
    {"options", fuzz_options, FORM_BYTES, 256, "numbers, names, lists and settings of the command line"},
    {"model", fuzz_model, FORM_TREE, 16384, "models and classifiers (HDF5)"},
    {"policy", fuzz_policy, FORM_TREE, 32768, "controllers (HDF5)"},
    {"data", fuzz_data, FORM_TREE, 8192, "trajectories, curves, series, tables, logs (HDF5)"},
    {"program", fuzz_program, FORM_TREE, 16384, "programs (HDF5)"},
    {"packed", fuzz_packed, FORM_FUNCTIONS, 4096, "packed functions"},
    {"image", fuzz_image, FORM_FUNCTIONS, 4096,
     "packed functions of random programs, their plans and their C"},
    {"checkpoint", fuzz_checkpoint, FORM_TREE, 16384, "checkpoints (HDF5)"},
    {"parts", fuzz_parts, FORM_TREE, 32768, "parts of an ensemble (HDF5)"},
    {"part", fuzz_part, FORM_BYTES, 512, "the part of a task that shares work"},
    {"fmu2", fuzz_fmu2, FORM_BYTES, 512, "calls and serialised states of an FMU 2.0"},
    {"fmu3", fuzz_fmu3, FORM_BYTES, 512, "calls and serialised states of an FMU 3.0"},
    {NULL, NULL, FORM_BYTES, 0, NULL}};

const fuzz_harness *fuzz_find(const char *name) {
    for (const fuzz_harness *h = fuzz_harnesses; h->name != NULL; h++)
        if (strcmp(h->name, name) == 0) return h;
    return NULL;
}

/* ---- results of readers ---- */

size_t fuzz_returned[2];

void fuzz_status(lg_status status, const lg_error *error) {
    if (status != LG_OK && error->message[0] == '\0') abort();
    fuzz_returned[status == LG_OK]++;
}

/* ---- the file for the readers ---- */

static int file = -1;
static char path[256];

static void remove_file(void) {
    (void)unlink(path);
}

/* Opens the file in TMPDIR, which is in memory under scripts/fuzz. HDF5 cannot open a file without a name. */
static void open_once(void) {
    if (file >= 0) return;
    const char *folder = getenv("TMPDIR");
    (void)snprintf(path, sizeof path, "%s/liegrad-fuzz-XXXXXX" FUZZ_ENDING, folder != NULL ? folder : "/tmp");
    file = mkstemps(path, sizeof FUZZ_ENDING - 1);
    if (file >= 0 && atexit(remove_file) == 0) return;
    perror(path);
    exit(1);
}

const char *fuzz_file(const void *data, size_t size) {
    open_once();
    if (ftruncate(file, 0) != 0 || pwrite(file, data, size, 0) != (ssize_t)size ||
        lseek(file, 0, SEEK_SET) != 0) {
        perror(path);
        exit(1);
    }
    return path;
}

int fuzz_file_descriptor(void) {
    return file;
}

uint64_t fuzz_limit = 1 << 16;

/* ---- functions that the linker puts in place of the library's ----
 *
 * No child process reads the file first, so that a crash happens here, where the fuzzer finds it. Arrays are
 * limited to a small size, so that a thousand files can be read per second. */

lg_status __real_lg_read_options_resolve(const lg_read_options *options, lg_read_options *out,
                                         lg_error *error);
lg_status __wrap_lg_read_options_resolve(const lg_read_options *options, lg_read_options *out,
                                         lg_error *error);
lg_status __wrap_lg_read_options_resolve(const lg_read_options *options, lg_read_options *out,
                                         lg_error *error) {
    LG_TRY(__real_lg_read_options_resolve(options, out, error));
    out->max_size = fuzz_limit;
    return LG_OK;
}

lg_status __wrap_lg_probe(const lg_context *context, const char *name, const lg_read_options *options,
                          lg_status (*read)(void *user, lg_error *error), void *user, lg_error *error);
lg_status __wrap_lg_probe(const lg_context *context, const char *name, const lg_read_options *options,
                          lg_status (*read)(void *user, lg_error *error), void *user, lg_error *error) {
    (void)context, (void)name, (void)options, (void)read, (void)user, (void)error;
    return LG_OK;
}
