/* Variational steps of learned Hamiltonians on a tape: RATTLE in ambient positions.
 *
 * Families with a kinetic energy 1/2 z'.K z', K constant, in ambient positions z (B, N) and with the
 * constraints c(z) = 0 of S^2 and SO(3), |q|^2 = 1 and R^T R = I, step by
 *
 *   P = K z' - h/2 dV/dz,  z1 = z + h W P - W C^T nu,  c(z1) = 0,  W = K^-1, C = dc/dz at z,
 *   P1 = P - C^T nu/h - h/2 dV/dz at z1,
 *
 * of order 2, symplectic and symmetric (Andersen 1983; Hairer, Lubich, Wanner, Geometric Numerical
 * Integration, VII.1.4). Newton's method finds nu row by row, with exact first and second derivatives. The
 * momenta of the state are invariant under multiples of C^T at z1, so the second multiplier of RATTLE is not
 * needed: pi = sum_j r_j x P_j, p = P - q (q.P), and the components of P for lines. Momenta that belong to a
 * symmetry of V under rotations and shifts are conserved to rounding. */
#include "hamiltonian/internal.h"

typedef struct step {
    const lg_hamiltonian_family *family;
    const lg_var *y; /* the parts of the state */
    lg_var z, c;     /* the positions (B, N) at the start, c(z) (B, k) */
    lg_var free, W;  /* z + h W P (B, N); (N, N) */
} step;

/* How many 3-vectors of length 1 a copy of a part of the positions has: 0 on R^n, 1 on S^2, 3 on SO(3). */
static uint32_t vectors_of(lg_shape part) {
    return part.rank == 3 ? part.dims[2] / 3 : 0;
}

/* c(z): |q|^2 - 1 of each direction, R^T R - I on and above the diagonal of each rotation. */
static lg_var constraints_of(lg_tape *tape, const step *s, lg_var z) {
    static const double above[9][6] = {[0] = {[0] = 1.0}, [1] = {[1] = 1.0}, [2] = {[2] = 1.0},
                                       [4] = {[3] = 1.0}, [5] = {[4] = 1.0}, [8] = {[5] = 1.0}},
                        unit[6] = {1.0, 0.0, 0.0, 1.0, 0.0, 1.0};
    lg_var x[LG_HAMILTONIAN_MAX_PARTS], c[LG_HAMILTONIAN_MAX_PARTS];
    uint32_t count = 0;
    lg_hamiltonian_cut(tape, s->family, s->y, z, 0, x);
    for (size_t i = 0; s->family->layout[i] != NULL; i += 2) {
        const lg_shape shape = lg_var_shape(tape, x[i]);
        if (vectors_of(shape) == 0) continue;
        if (vectors_of(shape) == 1) {
            c[count] = lg_add_scalar(tape, lg_rownorm2(tape, x[i]), -1.0);
            c[count] = lg_reshape(tape, c[count], lg_shape2(shape.dims[0], shape.dims[1]));
        } else {
            const lg_var R = lg_row_matrices(tape, x[i]),
                         all = lg_reshape(tape, lg_matmul_tn(tape, R, R),
                                          lg_shape2(shape.dims[0] * shape.dims[1], 9));
            c[count] = lg_sub(tape, lg_matmul(tape, all, lg_input_f64(tape, lg_shape2(9, 6), above[0])),
                              lg_input_f64(tape, lg_shape2(1, 6), unit));
            c[count] = lg_reshape(tape, c[count], lg_shape2(shape.dims[0], 6 * shape.dims[1]));
        }
        count++;
    }
    return lg_joined(tape, c, count);
}

/* C^T nu, (B, N). */
static lg_var normal_of(lg_tape *tape, const step *s, lg_var nu) {
    lg_var out = LG_NONE;
    (void)lg_vjp(tape, &s->c, &nu, 1, &s->z, 1, &out);
    return out;
}

/* r = c(z1). */
static lg_status held(void *user, lg_tape *tape, lg_var nu, lg_var *r) {
    const step *s = user;
    const lg_var moved = lg_matmul(tape, normal_of(tape, s, nu), s->W);
    *r = constraints_of(tape, s, lg_sub(tape, s->free, moved));
    return lg_tape_status(tape);
}

/* The momentum of the state from P at the position x; x and P are parts. */
static lg_var momentum_of(lg_tape *tape, lg_var x, lg_var P) {
    const uint32_t v = vectors_of(lg_var_shape(tape, x));
    if (v == 3) return lg_columns_crossed(tape, x, P);
    return v == 0 ? P : lg_sub(tape, P, lg_mul(tape, x, lg_rowdot(tape, x, P)));
}

/* to + c h x */
static lg_var moved(lg_tape *tape, const lg_taped_span *over, lg_var to, double c, lg_var x) {
    return lg_taped_moved(tape, to, c * over->h, lg_taped_by_rows(tape, over, x));
}

lg_status lg_hamiltonian_variational_step(lg_tape *tape, const lg_hamiltonian_vars *vars,
                                          const lg_taped_span *over, const lg_var *y, lg_var *out) {
    const lg_hamiltonian_family *family = vars->model->family;
    lg_var next[LG_HAMILTONIAN_MAX_PARTS], momenta[LG_HAMILTONIAN_MAX_PARTS], K, rate;
    family->ambient(tape, vars, y, &K, &rate);
    const lg_var z = lg_hamiltonian_joined(tape, family, y, 0);
    const uint32_t N = lg_var_shape(tape, z).dims[1];
    step s = {.family = family, .y = y, .z = z};
    s.c = constraints_of(tape, &s, z);
    s.W = lg_spd_solve(tape, K, lg_unit_matrix(tape, N));
    s.W = lg_reshape(tape, s.W, lg_shape2(N, N));
    lg_var P = lg_matmul(tape, rate, lg_reshape(tape, K, lg_shape2(N, N)));
    P = moved(tape, over, P, -0.5, lg_hamiltonian_potential_gradient(tape, vars, z));
    s.free = moved(tape, over, z, 1.0, lg_matmul(tape, P, s.W));
    lg_var nu = lg_full(tape, lg_var_shape(tape, s.c), 0.0);
    LG_TRY(lg_taped_root(tape, &(lg_root){.equations = held, .user = &s, .scale = 1.0}, nu, &nu));
    lg_var normal = normal_of(tape, &s, nu);
    const lg_var z1 = lg_sub(tape, s.free, lg_matmul(tape, normal, s.W));
    if (!lg_is_none(over->rows)) { /* h = 0 has the multiplier 0: it is divided by 1 */
        const lg_var still = lg_ge(tape, lg_full(tape, lg_shape2(1, 1), 0.0), lg_abs(tape, over->rows));
        normal = lg_div(tape, normal, lg_add(tape, over->rows, still));
    }
    P = lg_taped_moved(tape, P, -1.0 / over->h, normal);
    P = moved(tape, over, P, -0.5, lg_hamiltonian_potential_gradient(tape, vars, z1));
    lg_hamiltonian_cut(tape, family, y, z1, 0, next);
    lg_hamiltonian_cut(tape, family, y, P, 0, momenta);
    for (size_t i = 0; family->layout[i] != NULL; i += 2) {
        out[i] = next[i];
        out[i + 1] = momentum_of(tape, next[i], momenta[i]);
    }
    return lg_tape_status(tape);
}
