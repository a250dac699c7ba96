/* Safetensors (huggingface.co/docs/safetensors): 8 bytes with the header's length; the header, a JSON object
 * of names, types, shapes and offsets; then the numbers, row-major, without gaps. Parameters of a model have
 * the names of the model's file with points instead of slashes; parameters of a program keep their names. */
#include "liegrad/model.h"

#include "lg-export/export.h"

typedef struct job {
    const export_options *options;
    text header, data;
    size_t tensors;
} job;

static void add_tensor(job *j, const char *name, uint32_t rank, const uint64_t *dims, const double *values) {
    const size_t start = j->data.length;
    size_t count = 1;
    lg_text_add(&j->header, ",\"");
    for (const char *s = name; *s != '\0'; s++) lg_text_append(&j->header, *s == '/' ? "." : s, 1);
    lg_text_add(&j->header, "\":{\"dtype\":\"%s\",\"shape\":[", j->options->dtype == LG_F32 ? "F32" : "F64");
    for (uint32_t k = 0; k < rank; k++) {
        lg_text_add(&j->header, "%s%llu", k > 0 ? "," : "", (unsigned long long)dims[k]);
        count *= dims[k];
    }
    export_raw(j->options, &j->data, &j->data, values, count);
    lg_text_add(&j->header, "],\"data_offsets\":[%zu,%zu]}", start, j->data.length);
    j->tensors++;
}

/* Adds the parameters of a model under the names that its file has; nothing for a file of a program or of an
 * unknown kind. */
static void add_model(job *j, const app *self, const char *path) {
    char kind[64];
    lg_model_file file;
    lg_slice_info slice;
    const double *values;
    APP_FILE(self, path, lg_model_file_kind, NULL, kind, sizeof kind);
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_model_load(self->context, path, NULL, &file, &error);
    if (lg_recipe_find(kind) != NULL) app_must_file(self, status, &error, path);
    if (app_had_memory(status) != LG_OK) return;
    for (uint32_t i = 0; lg_model_file_slice(&file, i, &slice, &values); i++)
        add_tensor(j, slice.name, slice.rank, slice.dims, values);
    lg_model_file_destroy(&file);
}

static void add_program(job *j, const lg_program *program) {
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec p = lg_program_parameter(program, i);
        uint64_t dims[LG_MAX_RANK];
        for (uint32_t k = 0; k < p.shape.rank; k++) dims[k] = p.shape.dims[k];
        add_tensor(j, p.name, p.shape.rank, dims, p.values);
    }
}

/* Writes the file. The header is padded with blanks so that the numbers are aligned to 8 bytes. */
static void write_file(job *j, export_source *source) {
    text *to = export_add_file(source, "%s.safetensors");
    lg_text_add(&j->header, "}");
    while (j->header.length % 8 != 0) lg_text_add(&j->header, " ");
    lg_text_add_bytes(to, 8, j->header.length);
    lg_text_append(to, j->header.data, j->header.length);
    if (j->data.length > 0) lg_text_append(to, j->data.data, j->data.length);
    to->unfit = j->data.unfit;
    source->lost += j->data.lost;
}

static void build(const app *self, const char *path, lg_program *program, export_source *source) {
    job j = {.options = source->options, .header = app_text(), .data = app_text()};
    lg_text_add(
        &j.header,
        "{\"__metadata__\":{\"writer\":\"lg-export: %s\",\"layout\":\"weights are (in, out): y = x W + b\"}",
        source->options->name);
    if (!source->scene) add_model(&j, self, path);
    if (j.tensors == 0) add_program(&j, program);
    if (j.tensors == 0) app_stop_usage(self, "--target safetensors: %s has no parameters", path);
    write_file(&j, source);
    lg_text_destroy(&j.header);
    lg_text_destroy(&j.data);
}

const export_target export_target_safetensors = {.build = build};
