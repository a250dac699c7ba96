/* Builds the C of a model: fragments, constants, arrays, and lines about the model's origin. */
#include "lg-export/export.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/bytes.h"

/* ---- fragments ---- */

const char *export_fragment_text(const char *name) {
    const char *found = lg_named_text_of(export_fragments, name);
    return found != NULL ? found : "#error missing fragment\n";
}

static void add_fragment(const export_source *source, const char *fragment, text *to) {
    lg_text_add(to, "\n");
    lg_text_add_named(to, source->options->name, export_fragment_text(fragment));
}

void export_code(export_source *source, const char *fragment) {
    add_fragment(source, fragment, &source->code);
}

void export_test_code(export_source *source, const char *fragment) {
    add_fragment(source, fragment, &source->test);
}

/* ---- constants ---- */

void export_size(export_source *source, const char *constant, size_t value, const char *comment) {
    lg_text_add(&source->sizes, "#define %s_%s %zu", source->options->name, constant, value);
    lg_text_add(&source->sizes, "%s", comment != NULL ? " /* " : "");
    lg_text_add_comment(&source->sizes, comment != NULL ? comment : "");
    lg_text_add(&source->sizes, "%s\n", comment != NULL ? " */" : "");
}

void export_constant(export_source *source, const char *constant, size_t value) {
    lg_text_add(&source->code, "enum { %s = %zu };\n", constant, value);
}

void export_real(const export_source *source, text *to, const char *constant, double value) {
    lg_text_add(to, "static const real %s = ", constant);
    lg_text_add_real(to, source->options->dtype, value);
    lg_text_add(to, ";\n");
}

void export_reals(const export_source *source, text *to, const char *array, const double *values,
                  size_t count) {
    lg_text_add(to, "static const real %s[%zu] = {\n", array, count);
    lg_text_add_reals(to, source->options->dtype, 4, values, count);
    lg_text_add(to, "};\n");
}

void export_raw(const export_options *options, text *to, text *about, const double *values, size_t count) {
    const bool single = options->dtype == LG_F32;
    for (size_t i = 0; i < count; i++) {
        lg_text_add_bytes(to, single ? 4 : 8,
                          single ? lg_bits_of_f32((float)values[i]) : lg_bits_of_f64(values[i]));
        if (!isfinite(export_round(options, values[i]))) about->unfit = true;
        about->lost += lg_is_lost(options->dtype, values[i]);
    }
}

/* ---- rounding, units, provenance ---- */

double export_round(const export_options *options, double value) {
    return options->dtype == LG_F32 ? (double)(float)value : value;
}

double export_eps(const export_options *options) {
    return options->dtype == LG_F32 ? (double)FLT_EPSILON : DBL_EPSILON;
}

double export_norm(const double *a, const double *b, size_t count) {
    double sum = 0;
    for (size_t i = 0; i < count; i++) {
        const double d = a[i] - (b != NULL ? b[i] : 0);
        sum += d * d;
    }
    return sqrt(sum);
}

double export_tolerance(const export_source *source) {
    const double own = 20 * export_eps(source->options) * (double)source->depth * source->condition;
    return fmin(own, EXPORT_MOST_TOLERANCE);
}

double export_bound_tolerance(export_source *source, double tolerance) {
    source->coarse = source->coarse || !(tolerance < EXPORT_MOST_TOLERANCE);
    return fmin(tolerance, EXPORT_MOST_TOLERANCE);
}

static void read_units(const lg_archive_reader *archive, const char *name, char *units) {
    if (app_had_memory(archive->text(archive->user, name, units, EXPORT_UNITS)) != LG_OK) units[0] = '\0';
}

void export_read_units(const app *self, const char *path, export_options *options) {
    lg_file_reader *reader = NULL;
    lg_archive_reader archive;
    APP_FILE(self, path, lg_file_reader_create, NULL, NULL, &reader);
    if (app_had_memory(lg_file_reader_archive(reader, "model", &archive)) == LG_OK) {
        read_units(&archive, "input_units", options->input_units);
        read_units(&archive, "output_units", options->output_units);
    }
    lg_file_reader_destroy(reader);
}

void export_units(export_source *source, const char *otherwise) {
    const char *const rows[][2] = {{"of the inputs: ", source->options->input_units},
                                   {"of the outputs: ", source->options->output_units}};
    const char *label = "units";
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        if (rows[i][1][0] == '\0') continue;
        lg_text_add(&source->about, "%-12s  %s%s\n", label, rows[i][0], rows[i][1]);
        label = "";
    }
    if (label[0] != '\0') lg_text_add(&source->about, "%-12s  %s\n", label, otherwise);
}

void export_provenance(export_source *source, const lg_provenance *provenance, const char *sha256) {
    const char *const rows[][2] = {{"trained by", provenance->command},
                                   {"liegrad", provenance->liegrad_version},
                                   {"on", provenance->cpu},
                                   {"data SHA-256", sha256 != NULL ? sha256 : ""}};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        if (rows[i][1][0] != '\0') lg_text_add(&source->about, "%-12s  %s\n", rows[i][0], rows[i][1]);
    if (provenance->has_seed)
        lg_text_add(&source->about, "%-12s  %llu\n", "seed", (unsigned long long)provenance->seed);
}

void export_source_begin(export_source *source, const export_options *options) {
    *source = (export_source){.options = options, .condition = 1};
    _Static_assert(sizeof source->texts + offsetof(export_source, texts) ==
                       offsetof(export_source, rules) + sizeof source->rules,
                   "texts has all texts");
    for (size_t i = 0; i < LG_COUNT(source->texts); i++) source->texts[i] = app_text();
}

void export_source_free(export_source *source) {
    for (size_t i = 0; i < LG_COUNT(source->texts); i++) lg_text_destroy(&source->texts[i]);
    for (size_t i = 0; i < source->file_count; i++) {
        free(source->files[i].name);
        lg_text_destroy(&source->files[i].content);
    }
}
