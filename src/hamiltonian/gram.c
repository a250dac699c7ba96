/* Positive definite matrices m = Gamma^T Gamma + diag(max(0, b)), which learned masses have. */
#include "hamiltonian/internal.h"
#include "kernels/matrix.h"

void lg_hamiltonian_gram(size_t n, const double *arrays, double *m) {
    const double *gamma = arrays, *b = gamma + n * n;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            double sum = 0.0;
            for (size_t l = 0; l < n; l++) sum += gamma[l * n + i] * gamma[l * n + j];
            m[i * n + j] = i == j && b[i] > 0.0 ? sum + b[i] : sum;
        }
}

bool lg_hamiltonian_usable_mass(const lg_hamiltonian_family *family, uint32_t copies, const double *arrays) {
    const size_t n = copies * (size_t)family->arrays[0].each;
    double m[LG_HAMILTONIAN_MAX_COPIES * LG_HAMILTONIAN_MAX_COPIES];
    double L[LG_HAMILTONIAN_MAX_COPIES * LG_HAMILTONIAN_MAX_COPIES];
    lg_hamiltonian_gram(n, arrays, m);
    bool usable = lg_matrix_cholesky(n, m, L);
    for (size_t i = 0; usable && i < n * n; i += n + 1) usable = L[i] * L[i] >= LG_HAMILTONIAN_LEAST_PIVOT;
    return usable;
}

/* U m U^T repeats each number of m in a block of 3 by 3, of which the diagonal is kept. */
lg_var lg_hamiltonian_record_blocks(lg_tape *tape, uint32_t n, lg_var m) {
    double repeat[LG_HAMILTONIAN_AMBIENT * LG_HAMILTONIAN_MAX_COPIES];
    double kept[LG_HAMILTONIAN_AMBIENT * LG_HAMILTONIAN_AMBIENT];
    const uint32_t rows = 3 * n;
    for (uint32_t r = 0; r < rows; r++) {
        for (uint32_t i = 0; i < n; i++) repeat[r * n + i] = r / 3 == i;
        for (uint32_t s = 0; s < rows; s++) kept[r * rows + s] = r % 3 == s % 3;
    }
    const lg_var U = lg_input_f64(tape, lg_shape2(rows, n), repeat);
    const lg_var full = lg_matmul_nt(tape, lg_matmul(tape, U, lg_reshape(tape, m, lg_shape2(n, n))), U);
    return lg_mul(tape, full, lg_input_f64(tape, lg_shape2(rows, rows), kept));
}

lg_var lg_hamiltonian_record_gram(lg_tape *tape, uint32_t n, lg_var gamma, lg_var b) {
    lg_var diagonal = lg_reshape(tape, b, lg_shape3(1, 1, n)), unit = lg_unit_matrix(tape, n);
    lg_var square = lg_reshape(tape, lg_matmul_tn(tape, gamma, gamma), lg_shape3(1, n, n));
    return lg_add(tape, square, lg_mul(tape, unit, lg_act(tape, diagonal, LG_RELU)));
}
