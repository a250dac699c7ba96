/* The parts of a state: pairs of positions and momenta. */
#include "hamiltonian/internal.h"
#include "liegrad/ops.h"

uint32_t lg_hamiltonian_width(lg_tape *tape, lg_var part) {
    const lg_shape shape = lg_var_shape(tape, part);
    return (uint32_t)(lg_shape_count(shape) / (shape.dims[0] > 0 ? shape.dims[0] : 1));
}

lg_var lg_hamiltonian_joined(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y,
                             size_t odd) {
    lg_var flat[LG_HAMILTONIAN_MAX_PARTS / 2];
    size_t pairs = 0;
    for (const char *const *name = family->layout; *name != NULL; name += 2, pairs++) {
        const lg_var part = y[2 * pairs + odd];
        flat[pairs] = lg_reshape(
            tape, part, lg_shape2(lg_var_shape(tape, part).dims[0], lg_hamiltonian_width(tape, part)));
    }
    return pairs == 1 ? flat[0] : lg_concat(tape, flat, pairs, 1);
}

void lg_hamiltonian_cut(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y, lg_var x,
                        size_t odd, lg_var *out) {
    uint32_t from = 0;
    for (size_t i = odd; i < LG_HAMILTONIAN_MAX_PARTS && family->layout[i] != NULL; i += 2) {
        const uint32_t width = lg_hamiltonian_width(tape, y[i]);
        out[i] = lg_reshape(tape, lg_slice(tape, x, 1, from, width), lg_var_shape(tape, y[i]));
        from += width;
    }
}
