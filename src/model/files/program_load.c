/* Loads programs from files. Sizes in the file are checked before memory is allocated. */
#include "model/files/program_file.h"

#include "core/text.h"
#include "files/h5_internal.h"

#include <stdio.h>
#include <string.h>

enum { TEXT = 4096 };

typedef struct texts {
    lg_program_name *text;
    size_t count;
    const lg_context *context;
} texts;

typedef struct reading {
    lg_h5 *h5;
    size_t left; /* bytes that may still be allocated */
    lg_program *program;
    texts parameters, functions; /* names, in order */
    lg_owned *values;            /* of each parameter */
    lg_error *error;
} reading;

static lg_status bad(const reading *r, const char *path, const char *what) {
    return lg_dataset_error(r->h5, path, what, r->error);
}

/* Allocates memory of at most r->left bytes, and subtracts its size from r->left. */
static lg_status take(reading *r, const char *path, uint64_t count, size_t size, void **out) {
    if (count > r->left / size)
        return bad(r, path, "declares more data than the file can hold or the limit allows");
    r->left -= (size_t)count * size;
    *out = lg_alloc(r->h5->context, (size_t)count, size);
    return *out != NULL ? LG_OK : lg_h5_no_memory(r->h5, r->error);
}

/* ---- texts ---- */

typedef struct listing {
    reading *r;
    const char *path;
    texts *out;
} listing;

static lg_status keep_text(void *user, uint64_t index, const char *text, lg_error *error) {
    const listing *l = user;
    if (index >= LG_PROGRAM_MOST_NAMES) return bad(l->r, l->path, "has too many entries");
    if (strlen(text) >= LG_PROGRAM_NAME) return bad(l->r, l->path, "has a text that is too long");
    (void)snprintf(l->out->text[index], LG_PROGRAM_NAME, "%s", text);
    l->out->count = (size_t)index + 1;
    return LG_OK;
}

/* Reads at most LG_PROGRAM_MOST_NAMES texts of this attribute of the group `path`. The caller frees
 * out->text, also after a failure. */
static lg_status get_texts(reading *r, const char *path, const char *attribute, texts *out) {
    listing l = {r, path, out};
    bool words = true;
    char what[LG_PROGRAM_NAME + 32];
    out->text = lg_alloc(r->h5->context, LG_PROGRAM_MOST_NAMES, sizeof *out->text);
    if (out->text == NULL) return lg_h5_no_memory(r->h5, r->error);
    const lg_status status = lg_h5_each_name(r->h5, path, attribute, NULL, &words, keep_text, &l, r->error);
    (void)snprintf(what, sizeof what, "has no attribute %s with names", attribute);
    return lg_as_format(words ? status : bad(r, path, what), r->error);
}

static void free_texts(const texts *t) {
    lg_free(t->context, t->text);
}

/* Reads the names of parameters or functions. A name becomes part of a path, so it must be a plain word that
 * cannot lead elsewhere in the file. */
static lg_status get_names(reading *r, const char *group, texts *out) {
    LG_TRY(get_texts(r, group, "order", out));
    for (size_t i = 0; i < out->count; i++)
        if (!lg_is_word(out->text[i]))
            return bad(r, group,
                       "an entry of the order is not a plain name (letters, digits and underscores)");
    return LG_OK;
}

/* ---- functions ---- */

/* Adds the function to the program. If the file has a hash of the bytes, they must match it, because changed
 * bytes may form another valid function. */
static lg_status unpack(reading *r, const char *path, const char *name, const void *bytes, size_t size) {
    LG_CLEAN(lg_function_image_destroy_at) lg_function_image *image = NULL;
    lg_error why = {LG_OK, ""};
    char hash[LG_SHA256_TEXT], stored[LG_SHA256_TEXT];
    lg_program_hash(bytes, size, hash);
    if (lg_h5_has_attribute(r->h5, path, "sha256"))
        LG_TRY(lg_as_format(lg_h5_text(r->h5, path, "sha256", stored, sizeof stored, r->error), r->error));
    else
        memcpy(stored, hash, sizeof stored);
    if (strcmp(hash, stored) != 0) return bad(r, path, "has changed: attribute sha256 does not match");
    lg_status status = lg_function_unpack(r->h5->context, name, bytes, size, &r->left, &image, &why);
    if (status == LG_OK) status = lg_as_format(lg_program_add_image(r->program, image, &why), NULL);
    if (status == LG_OK) return LG_OK;
    return lg_fail(r->error, status, "%s: /%s: %s", lg_shown_path(r->h5->path), path, why.message);
}

static lg_status get_function(reading *r, const char *name) {
    const lg_program_key at = lg_program_below("functions", name);
    lg_h5_about about;
    int64_t fitted = 0;
    LG_CLEAN(lg_owned_free) lg_owned bytes = {r->h5->context, NULL};
    LG_TRY(lg_as_format(lg_h5_look(r->h5, at.text, 1, &about, r->error), r->error));
    if (about.rank != 1) return bad(r, at.text, "is not a list of bytes");
    LG_TRY(take(r, at.text, about.count, 1, &bytes.memory));
    LG_TRY(lg_as_format(lg_h5_get(r->h5, at.text, LG_ELEMENT_U8, 1, about.dims, bytes.memory, r->error),
                        r->error));
    LG_TRY(unpack(r, at.text, name, bytes.memory, (size_t)about.count));
    if (lg_h5_has_attribute(r->h5, at.text, "fitted"))
        LG_TRY(lg_as_format(lg_h5_number(r->h5, at.text, "fitted", LG_ELEMENT_I64, &fitted, r->error),
                            r->error));
    if (fitted == 0) return LG_OK;
    return lg_program_set_fitted(r->program, lg_program_functions(r->program) - 1, true);
}

/* ---- parameters ---- */

static lg_status get_array(reading *r, const char *path, lg_shape *shape, lg_owned *values) {
    lg_h5_about about;
    const uint64_t *dims = about.dims;
    LG_TRY(lg_as_format(lg_h5_look(r->h5, path, sizeof(double), &about, r->error), r->error));
    shape->rank = about.rank;
    for (uint32_t d = 0; d < about.rank; d++) {
        if (dims[d] > UINT32_MAX) return bad(r, path, "is too large");
        shape->dims[d] = (uint32_t)dims[d];
    }
    LG_TRY(take(r, path, about.count, sizeof(double), &values->memory));
    return lg_h5_get_finite(r->h5, path, about.rank, dims, values->memory, r->error);
}

/* Whether the text is a path of plain names. */
static bool is_path(const char *path) {
    for (const char *c = path; *c != '\0'; c++)
        if (!lg_in_word(*c) && (*c != '/' || c == path || c[1] == '/' || c[1] == '\0')) return false;
    return *path != '\0';
}

/* Appends the numbers of a place to `values`, which has *count numbers. */
static lg_status get_place(reading *r, const char *place, lg_owned *values, size_t *count) {
    const char *path;
    lg_shape shape;
    LG_CLEAN(lg_owned_free) lg_owned part = {r->h5->context, NULL}, longer = part;
    const lg_program_word word = lg_program_word_of(place, &path);
    if (!is_path(path))
        return bad(r, "parameters",
                   "an entry is not a path of plain names (letters, digits and underscores)");
    LG_TRY(get_array(r, path, &shape, &part));
    const size_t more = lg_shape_count(shape);
    LG_TRY(take(r, path, *count + more, sizeof(double), &longer.memory));
    double *all = longer.memory;
    if (*count > 0) memcpy(all, values->memory, *count * sizeof *all);
    for (size_t i = 0; i < more; i++) all[*count + i] = word(((double *)part.memory)[i]);
    longer.memory = values->memory; /* is freed */
    values->memory = all;
    *count += more;
    return LG_OK;
}

static lg_status get_parameter(reading *r, const char *name, lg_parameter_spec *p, lg_owned *values) {
    const lg_program_key at = lg_program_below("parameters", name);
    LG_CLEAN(free_texts) texts places = {.context = r->h5->context};
    size_t count = 0;
    p->name = name;
    if (lg_h5_has(r->h5, "parameters") && lg_h5_has_attribute(r->h5, "parameters", name)) {
        LG_TRY(get_texts(r, "parameters", name, &places));
        for (size_t i = 0; i < places.count; i++) LG_TRY(get_place(r, places.text[i], values, &count));
        if (count > UINT32_MAX) return bad(r, "parameters", "is too large");
        p->shape = lg_shape1((uint32_t)count);
    } else {
        LG_TRY(get_array(r, at.text, &p->shape, values));
    }
    p->values = values->memory;
    return LG_OK;
}

/* Makes the program with its parameters, without functions. */
static lg_status get_parameters(reading *r) {
    const lg_context *context = r->h5->context;
    const size_t count = r->parameters.count;
    char description[TEXT] = "";
    lg_error why = {LG_OK, ""};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    if (lg_h5_has_attribute(r->h5, "", "description"))
        LG_TRY(lg_as_format(lg_h5_text(r->h5, "", "description", description, TEXT, r->error), r->error));
    LG_SCRATCH(lg_parameter_spec, made, context, count);
    r->values = lg_alloc(context, count, sizeof *r->values);
    if (made == NULL || r->values == NULL) return lg_h5_no_memory(r->h5, r->error);
    for (size_t i = 0; i < count; i++) {
        r->values[i].context = context;
        LG_TRY(get_parameter(r, r->parameters.text[i], &made[i], &r->values[i]));
    }
    spec.parameters = made;
    spec.parameter_count = count;
    spec.description = description[0] != '\0' ? description : NULL;
    const lg_status status = lg_program_begin(context, &spec, &r->program, &why);
    if (status == LG_OK) return LG_OK;
    return lg_as_format(
        lg_fail(r->error, status, "%s: /parameters: %s", lg_shown_path(r->h5->path), why.message), r->error);
}

/* ---- the file ---- */

lg_status lg_program_check_version(lg_h5 *h5, lg_error *error) {
    int64_t version;
    lg_provenance from;
    if (lg_h5_number(h5, "", "format_version", LG_ELEMENT_I64, &version, NULL) != LG_OK || version != 1)
        return LG_OK;
    lg_h5_provenance(h5, &from);
    return lg_fail(
        error, LG_VERSION,
        "%s: attribute format_version is 1: liegrad %s wrote this file, but models and programs are read in "
        "format %d only; train the model or build the program again with liegrad %s",
        lg_shown_path(h5->path), from.liegrad_version[0] != '\0' ? lg_tamed(from.liegrad_version) : "1",
        LG_FORMAT_VERSION, lg_version());
}

static void end_reading(reading *r) {
    for (size_t i = 0; r->values != NULL && i < r->parameters.count; i++) lg_owned_free(&r->values[i]);
    LG_FREE_ALL(r->h5->context, r->values, r->parameters.text, r->functions.text);
    lg_program_destroy(r->program);
}

lg_status lg_program_get(lg_h5 *h5, lg_program **out, lg_error *error) {
    LG_CLEAN(end_reading)
    reading r = {.h5 = h5, .left = h5->max_size < SIZE_MAX ? (size_t)h5->max_size : SIZE_MAX, .error = error};
    LG_TRY(lg_program_check_version(h5, error));
    LG_TRY(get_names(&r, "parameters", &r.parameters));
    LG_TRY(get_names(&r, "functions", &r.functions));
    LG_TRY(get_parameters(&r));
    for (size_t i = 0; i < r.functions.count; i++) LG_TRY(get_function(&r, r.functions.text[i]));
    *out = r.program;
    r.program = NULL;
    return LG_OK;
}

static lg_status load(void *user, lg_h5 *h5, lg_error *error) {
    const bool functions =
        lg_h5_has(h5, "functions"); /* a file with the group `functions` may be of any kind */
    LG_TRY(lg_h5_check_format(h5, functions ? NULL : "program", false, error));
    return lg_program_get(h5, user, error);
}

lg_status lg_program_load(const lg_context *context, const char *path, const lg_read_options *options,
                          lg_program **out, lg_error *error) {
    LG_NEEDS(error, path, out);
    return lg_h5_read(context, path, options, load, out, error);
}
