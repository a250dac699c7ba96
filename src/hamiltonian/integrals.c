/* The table of first integrals for the penalty in training; see liegrad/hamiltonian.h. */
#include <string.h>

#include "core/core.h"
#include "liegrad/ops.h"
#include "hamiltonian/internal.h"

/* Column j of x (B, n), as (B, 1). */
static lg_var column(lg_tape *tape, lg_var x, uint32_t j) {
    return lg_slice(tape, x, 1, j, 1);
}

/* (q_j^2 + p_j^2)/2 */
static lg_var oscillator(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, uint32_t j,
                         const lg_var *y) {
    (void)user, (void)vars;
    lg_var q = lg_square(tape, column(tape, y[0], j)), p = lg_square(tape, column(tape, y[1], j));
    return lg_scale(tape, lg_add(tape, q, p), 0.5);
}

/* (q_j^2 + p_j^2)/2 + q_j^4/4 */
static lg_var anharmonic(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, uint32_t j,
                         const lg_var *y) {
    lg_var quartic = lg_square(tape, lg_square(tape, column(tape, y[0], j)));
    return lg_add(tape, oscillator(user, tape, vars, j, y), lg_scale(tape, quartic, 0.25));
}

/* q_1 p_2 - q_2 p_1 */
static lg_var planar_momentum(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, uint32_t j,
                              const lg_var *y) {
    (void)user, (void)vars, (void)j;
    lg_var first = lg_mul(tape, column(tape, y[0], 0), column(tape, y[1], 1));
    return lg_sub(tape, first, lg_mul(tape, column(tape, y[0], 1), column(tape, y[1], 0)));
}

/* sum_i e3.(q_i x p_i), with q and p (B, n, 3) */
static lg_var vertical_momentum(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, uint32_t j,
                                const lg_var *y) {
    (void)user, (void)vars, (void)j;
    return lg_sum_axis(tape, lg_slice(tape, lg_cross(tape, y[0], y[1]), 2, 2, 1), 1, false);
}

static const lg_first_integral integrals[] = {
    {.name = "oscillator",
     .formula = "(q_j^2 + p_j^2)/2",
     .family = &lg_hamiltonian_separable,
     .numbered = true,
     .power = {1, 1},
     .record = oscillator},
    {.name = "anharmonic",
     .formula = "(q_j^2 + p_j^2)/2 + q_j^4/4",
     .family = &lg_hamiltonian_separable,
     .numbered = true,
     .power = {1, 1},
     .record = anharmonic},
    {.name = "angular-momentum",
     .formula = "q_1 p_2 - q_2 p_1",
     .family = &lg_hamiltonian_separable,
     .n = 2,
     .power = {1, 1},
     .record = planar_momentum},
    {.name = "vertical-angular-momentum",
     .formula = "sum_i e3.(q_i x p_i)",
     .family = &lg_hamiltonian_chain,
     .power = {0, 1},
     .record = vertical_momentum},
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
           (integral->n == 0 || integral->n == model->n);
}
