/* The table of first integrals for the penalty in training; see liegrad/hamiltonian.h. */
#include <string.h>

#include "hamiltonian/internal.h"

/* The first column of x (B, n), as (B, 1). */
static lg_var column(lg_tape *tape, lg_var x) {
    return lg_slice(tape, x, 1, 0, 1);
}

/* (q_1^2 + p_1^2)/2 */
static lg_var oscillator(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    lg_var q = lg_square(tape, column(tape, y[0])), p = lg_square(tape, column(tape, y[1]));
    return lg_scale(tape, lg_add(tape, q, p), 0.5);
}

/* (q_1^2 + p_1^2)/2 + q_1^4/4 */
static lg_var anharmonic(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    lg_var quartic = lg_square(tape, lg_square(tape, column(tape, y[0])));
    return lg_add(tape, oscillator(user, tape, vars, y), lg_scale(tape, quartic, 0.25));
}

/* The momentum of a symmetry: q_1 p_2 - q_2 p_1 of R^2, e3.pi + sum_i e3.(q_i x p_i) where there are
 * vectors. */
static lg_var momentum(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const bool plane = lg_hamiltonian_vectors(vars->model) == 0;
    const lg_symmetry symmetry = plane ? LG_SYMMETRY_SPHERICAL : LG_SYMMETRY_AXIAL;
    return lg_symmetry_row_of(symmetry)->momentum(tape, vars->model, y);
}

static const lg_first_integral integrals[] = {
    {.name = "oscillator",
     .formula = "(q_1^2 + p_1^2)/2",
     .family = &lg_hamiltonian_separable,
     .power = {1, 1},
     .record = oscillator},
    {.name = "anharmonic",
     .formula = "(q_1^2 + p_1^2)/2 + q_1^4/4",
     .family = &lg_hamiltonian_separable,
     .power = {1, 1},
     .record = anharmonic},
    {.name = "angular-momentum",
     .formula = "q_1 p_2 - q_2 p_1",
     .family = &lg_hamiltonian_separable,
     .n = 2,
     .power = {1, 1},
     .record = momentum},
    {.name = "vertical-angular-momentum",
     .formula = "sum e3.pi + sum_i e3.(q_i x p_i)",
     .vectors = true,
     .power = {0, 1},
     .record = momentum},
};

size_t lg_first_integral_count(void) {
    return LG_COUNT(integrals);
}

const lg_first_integral *lg_first_integral_at(size_t index) {
    return index < LG_COUNT(integrals) ? &integrals[index] : NULL;
}

const lg_first_integral *lg_first_integral_find(const char *name) {
    for (size_t i = 0; i < LG_COUNT(integrals); i++)
        if (strcmp(integrals[i].name, name) == 0) return &integrals[i];
    return NULL;
}

bool lg_first_integral_fits(const lg_first_integral *integral, const lg_hamiltonian *model) {
    return (integral->family == NULL || integral->family == model->family) &&
           (!integral->vectors || lg_hamiltonian_vectors(model) > 0) &&
           (integral->n == 0 || integral->n == model->n);
}

/* ---- a first integral in a program ---- */

static const char function_name[] = "integral";

static lg_var of_program(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const lg_program *program = user;
    const lg_hamiltonian *model = vars->model;
    const lg_space space = lg_hamiltonian_model_space(model);
    size_t function = 0;
    lg_var g;
    (void)lg_program_find(program, function_name, &function, NULL);
    const lg_var state = lg_taped_join(tape, &space, y);
    if (lg_program_record(tape, program, function, NULL, &state, &g) != LG_OK) return LG_NONE;
    return lg_reshape(tape, g, lg_shape2(lg_rows_of(tape, state), 1));
}

static lg_status check_ports(const lg_program *program, size_t function, uint32_t d, lg_error *error) {
    size_t inputs, outputs;
    const lg_port *x = lg_program_inputs(program, function, &inputs),
                  *g = lg_program_outputs(program, function, &outputs);
    if (inputs != 1 || outputs != 1)
        return lg_fail(
            error, LG_SHAPE,
            "function %s has %zu inputs and %zu outputs; it must have one input, the state, and one output",
            function_name, inputs, outputs);
    if (x->shared || x->shape.rank != 1 || x->shape.dims[0] != d)
        return lg_fail(
            error, LG_SHAPE,
            "function %s takes %llu numbers%s, but a state of the data has %u numbers, as a vector",
            function_name, (unsigned long long)lg_shape_count(x->shape),
            x->shared ? " that all rows share" : "", d);
    if (g->shared || lg_shape_count(g->shape) != 1)
        return lg_fail(error, LG_SHAPE, "function %s gives %llu numbers%s; it must give one for each state",
                       function_name, (unsigned long long)lg_shape_count(g->shape),
                       g->shared ? " for all states together" : "");
    return LG_OK;
}

lg_status lg_first_integral_from(const lg_program *program, const lg_hamiltonian *model, const char *name,
                                 lg_first_integral *out, lg_error *error) {
    LG_NEEDS(error, program, model, name, out);
    size_t function;
    LG_TRY(lg_program_find(program, function_name, &function, error));
    LG_TRY(check_ports(program, function, lg_hamiltonian_state_dim(model), error));
    *out = (lg_first_integral){.name = name,
                               .formula = "the function integral",
                               .family = model->family,
                               .n = model->n,
                               .measured = true,
                               .record = of_program,
                               .user = (void *)(uintptr_t)program}; /* never written */
    return LG_OK;
}
