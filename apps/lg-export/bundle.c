/* Models whose functions are a program: the library writes their C code. */
#include <string.h>

#include "lg-export/export.h"

/* Rounds the parameters to the exported type, as the C code stores them. */
lg_status export_round_parameters(export_source *source, lg_program *program) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_parameters(program) && status == LG_OK; i++) {
        const lg_parameter_spec p = lg_program_parameter(program, i);
        const size_t count = lg_shape_count(p.shape);
        APP_FREE double *values = app_alloc(count, sizeof *values);
        for (size_t k = 0; k < count; k++) {
            values[k] = export_round(source->options, p.values[k]);
            source->lost += lg_is_lost(source->options->dtype, p.values[k]);
        }
        status = lg_program_set_parameter(program, i, values);
    }
    return status;
}

/* Returns the declarations after the first `skip` ones. Each declaration begins with an empty line and a
 * comment. */
static const char *other_declarations(const char *declarations, int skip) {
    for (int skipped = 0; declarations != NULL && skipped < skip; skipped++)
        declarations = strstr(declarations + 1, "\n/*");
    return declarations != NULL ? declarations : "";
}

/* Adds the texts and sizes of `c` to `source`. `skip`: number of declarations that NAME.h already has. */
static void take_texts(export_source *source, const lg_c_source *c, int skip) {
    lg_text_add(&source->declarations, "%s", other_declarations(c->declarations, skip));
    lg_text_add(&source->arrays, "%s", c->arrays);
    lg_text_add(&source->code, "%s", c->code);
    lg_text_add(&source->weights, "%s", c->weights);
    source->stack += c->stack_size;
    source->calls += c->stack_calls;
    source->numbers += c->numbers;
    source->integer_bytes += c->integers * sizeof(int);
    source->lost += c->lost;
    if (c->work_size > source->work) source->work = c->work_size;
}

lg_status export_c(export_source *source, lg_program *program, export_function *functions, size_t count,
                   bool compact, int skip, lg_c_source **out, lg_error *error) {
    APP_FREE size_t *chosen = app_alloc(count, sizeof *chosen);
    APP_FREE const char **names = app_alloc(count, sizeof *names);
    APP_FREE bool *hidden = app_alloc(count, sizeof *hidden);
    lg_c_options how;
    lg_c_options_init(&how);
    how.name = source->options->name;
    how.dtype = source->options->dtype;
    how.functions = chosen;
    how.names = names;
    how.hidden = hidden;
    how.compact = compact;
    how.function_count = count;
    for (size_t i = 0; i < count; i++) {
        names[i] = functions[i].name;
        hidden[i] = functions[i].hidden;
        (void)lg_program_find(program, functions[i].function, &chosen[i], NULL);
    }
    LG_TRY(lg_program_write_c(program, &how, out, error));
    for (size_t i = 0; i < count; i++)
        functions[i].work = (*out)->work[i], functions[i].depth = (*out)->depth[i];
    take_texts(source, *out, skip);
    return LG_OK;
}

void export_bundle(const app *self, export_source *source, lg_program *program, export_function *functions,
                   size_t count) {
    lg_error error = {LG_OK, ""};
    lg_c_source *c = NULL;
    const lg_status status =
        export_c(source, program, functions, count, true, source->outputs > 0 ? 2 : 0, &c, &error);
    if (status == LG_OK) lg_text_add(&source->code, "\n");
    if (status == LG_NOT_FINITE) source->weights.unfit = true; /* export_write reports it. */
    lg_c_source_destroy(c);
    if (status != LG_NOT_FINITE) app_must_file(self, status, &error, source->options->file);
}
