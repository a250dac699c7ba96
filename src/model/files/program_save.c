/* Saves programs to files. */
#include <stdio.h>
#include <string.h>

#include "liegrad/model.h"

#include "model/files/program_file.h"

void lg_program_hash(const void *bytes, size_t size, char text[LG_SHA256_TEXT]) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add(&state, bytes, size);
    lg_sha256_finish(&state, text);
}

lg_program_key lg_program_below(const char *group, const char *name) {
    lg_program_key k;
    (void)snprintf(k.text, sizeof k.text, "%.180s/%.64s", group, name);
    return k;
}

static lg_status put_function(lg_h5 *h5, const lg_program *program, size_t function, lg_error *error) {
    LG_CLEAN(lg_function_image_destroy_at) lg_function_image *image = NULL;
    if (lg_function_image_create(program, function, &image) != LG_OK) return lg_h5_no_memory(h5, error);
    const lg_program_key at = lg_program_below("functions", lg_program_function_name(program, function));
    const int64_t fitted = 1;
    char hash[LG_SHA256_TEXT];
    size_t size;
    LG_TRY(lg_function_pack(image, NULL, &size, error));
    LG_TRY_SCRATCH(char, bytes, h5->context, size, lg_h5_no_memory(h5, error));
    LG_TRY(lg_function_pack(image, bytes, &size, error));
    LG_TRY(lg_h5_put(h5, at.text, LG_ELEMENT_U8, 1, &(uint64_t){size}, bytes, error));
    lg_program_hash(bytes, size, hash);
    LG_TRY(lg_h5_put_text(h5, at.text, "sha256", hash, error));
    if (!lg_program_is_fitted(program, function)) return LG_OK;
    return lg_h5_put_number(h5, at.text, "fitted", LG_ELEMENT_I64, &fitted, error);
}

/* Writes the names of all parameters, or of all functions, in order. */
static lg_status put_order(lg_h5 *h5, const lg_program *program, bool functions, lg_error *error) {
    const size_t count = functions ? lg_program_functions(program) : lg_program_parameters(program);
    LG_TRY_SCRATCH(lg_program_name, names, h5->context, count, lg_h5_no_memory(h5, error));
    for (size_t i = 0; i < count; i++)
        (void)snprintf(names[i], sizeof names[i], "%s",
                       functions ? lg_program_function_name(program, i)
                                 : lg_program_parameter(program, i).name);
    return lg_h5_put_text_list(h5, functions ? "functions" : "parameters", "order", *names, sizeof *names,
                               count, error);
}

/* ---- parameters whose numbers are stored elsewhere in the file ---- */

static double as_it_is(double x) {
    return x;
}

static double single(double x) {
    const float near = (float)x;
    return near - near == 0.0F ? (double)near : 0.0;
}

static double rest(double x) {
    return x - single(x);
}

static double inverse(double x) {
    return 1.0 / x;
}

lg_program_word lg_program_word_of(const char *place, const char **path) {
    static const struct {
        const char *word;
        lg_program_word make;
    } words[] = {{"single ", single}, {"rest ", rest}, {"inverse ", inverse}};
    *path = place;
    for (size_t i = 0; i < LG_COUNT(words); i++) {
        const size_t length = strlen(words[i].word);
        if (strncmp(place, words[i].word, length) != 0) continue;
        *path = place + length;
        return words[i].make;
    }
    return as_it_is;
}

/* Writes the places of a parameter. *stored: it has places; otherwise it is stored below /parameters. */
static lg_status put_places(lg_h5 *h5, const char *parameter, const lg_program_source *places, size_t count,
                            bool *stored, lg_error *error) {
    LG_SCRATCH(lg_program_name, texts, h5->context, count);
    size_t n = 0;
    if (texts == NULL) return lg_h5_no_memory(h5, error);
    for (size_t i = 0; i < count; i++)
        if (strcmp(places[i].parameter, parameter) == 0)
            (void)snprintf(texts[n++], LG_PROGRAM_PLACE, "%s", places[i].place);
    *stored = n > 0;
    return n > 0 ? lg_h5_put_text_list(h5, "parameters", parameter, *texts, sizeof *texts, n, error) : LG_OK;
}

lg_status lg_program_put_parameters(lg_h5 *h5, const lg_program *program, const lg_program_source *places,
                                    size_t count, lg_error *error) {
    LG_TRY(put_order(h5, program, false, error));
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec p = lg_program_parameter(program, i);
        bool stored;
        LG_TRY(put_places(h5, p.name, places, count, &stored, error));
        uint64_t dims[LG_MAX_RANK];
        for (uint32_t d = 0; d < p.shape.rank; d++) dims[d] = p.shape.dims[d];
        if (!stored)
            LG_TRY(lg_h5_put(h5, lg_program_below("parameters", p.name).text, LG_ELEMENT_F64, p.shape.rank,
                             dims, p.values, error));
    }
    return LG_OK;
}

lg_status lg_program_put_version(lg_h5 *h5, lg_error *error) {
    const int64_t version = LG_FORMAT_VERSION;
    LG_TRY(lg_h5_remove_attribute(h5, "", "format_version", error));
    return lg_h5_put_number(h5, "", "format_version", LG_ELEMENT_I64, &version, error);
}

lg_status lg_program_put_functions(lg_h5 *h5, const lg_program *program, lg_error *error) {
    LG_TRY(lg_program_put_version(h5, error));
    LG_TRY(put_order(h5, program, true, error));
    for (size_t i = 0; i < lg_program_functions(program); i++) LG_TRY(put_function(h5, program, i, error));
    return LG_OK;
}

lg_status lg_program_put_space(lg_h5 *h5, const lg_space *space, lg_error *error) {
    char text[LG_SPACE_TEXT];
    lg_space_text(space, text);
    return lg_h5_put_text(h5, "model", "space", text, error);
}

static lg_status put_model(lg_h5 *h5, const char *kind, const lg_program *program, const lg_space *space,
                           const lg_provenance *provenance, lg_error *error) {
    LG_TRY(lg_h5_put_header(h5, kind, provenance, error));
    if (lg_program_description(program)[0] != '\0')
        LG_TRY(lg_h5_put_text(h5, "", "description", lg_program_description(program), error));
    if (space != NULL) LG_TRY(lg_program_put_space(h5, space, error));
    LG_TRY(lg_program_put_parameters(h5, program, NULL, 0, error));
    return lg_program_put_functions(h5, program, error);
}

lg_status lg_model_save(const lg_context *context, const char *path, const char *kind,
                        const lg_program *program, const lg_space *space, const lg_provenance *provenance,
                        lg_error *error) {
    lg_h5 *h5;
    LG_NEEDS(error, path, kind, program);
    LG_TRY(lg_h5_create(context, path, &h5, error));
    return lg_h5_finish(h5, put_model(h5, kind, program, space, provenance, error), error);
}

lg_status lg_program_save(const lg_context *context, const char *path, const lg_program *program,
                          const lg_provenance *provenance, lg_error *error) {
    return lg_model_save(context, path, "program", program, NULL, provenance, error);
}
