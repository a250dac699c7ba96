/* A first integral of the penalty that is in a program file. */
#include <string.h>

#include "hamiltonian/files/constrained.h"
#include "hamiltonian/files/recipe.h"
#include "model/files/program_file.h"

static lg_status hash_program(const lg_context *context, const lg_program *program, char *text) {
    lg_sha256 sum;
    lg_sha256_init(&sum);
    for (size_t i = 0; i < lg_program_functions(program); i++) {
        const char *name = lg_program_function_name(program, i);
        lg_sha256_add(&sum, name, strlen(name) + 1);
        LG_TRY(lg_hash_function(context, program, i, &sum));
    }
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec parameter = lg_program_parameter(program, i);
        lg_sha256_add_doubles(&sum, parameter.values, lg_shape_count(parameter.shape));
    }
    lg_sha256_finish(&sum, text);
    return LG_OK;
}

lg_status lg_penalty_load(const lg_context *context, lg_hamiltonian_run *run, lg_program **out,
                          lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    LG_TRY(lg_program_load(context, run->penalty_integral, NULL, &made, error));
    const lg_status status = hash_program(context, made, run->penalty_sha256);
    if (status != LG_OK)
        return lg_fail(error, status, "%s: %s", run->penalty_integral, lg_status_sentence(status));
    return LG_MOVE(out, made);
}
