/* Variational steps of learned Hamiltonians on a tape: RATTLE in ambient positions.
 *
 * Families with a kinetic energy 1/2 z'.K z', K constant, in ambient positions z (B, N) and with the
 * constraints c(z) = 0 of S^2 and SO(3), |q|^2 = 1 and R^T R = I, step by
 *
 *   P = K z' - h/2 dV/dz,  z1 = z + h W P - W C^T nu,  c(z1) = 0,  W = K^-1, C = dc/dz at z,
 *   P1 = P - C^T nu/h - h/2 dV/dz at z1,
 *
 * of order 2, symplectic and symmetric (Andersen 1983; Hairer, Lubich, Wanner, Geometric Numerical
 * Integration, VII.1.4). Both constraints say that 3-vectors of z, directions or the columns of a rotation,
 * are orthonormal: c_j = a_j.b_j - d_j, where the constant matrices A and B select a = A z and b = B z.
 * Newton's method finds nu row by row, with exact first and second derivatives. The momenta of the state are
 * invariant under multiples of C^T at z1, so the second multiplier of RATTLE is not needed:
 * pi = sum_j r_j x P_j, p = P - q (q.P), and the components of P for lines. Momenta that belong to a symmetry
 * of V under rotations and shifts are conserved to rounding. */
#include "hamiltonian/internal.h"
#include "integrators/taped_internal.h"
#include "liegrad/ops.h"

typedef struct step {
    uint32_t rows, N, k; /* states, numbers in z, constraints */
    lg_var A, B;         /* (3 k, N); LG_NONE: they are unit matrices, because z has directions alone */
    lg_var d;            /* (1, k) */
    lg_var a, b;         /* at the start, (rows, k, 3) */
    lg_var free, W;      /* z + h W P (rows, N); (N, N) */
} step;

/* How many 3-vectors of length 1 a copy of a part of the positions has: 0 on R^n, 1 on S^2, 3 on SO(3). */
static uint32_t vectors_of(lg_shape part) {
    return part.rank == 3 ? part.dims[2] / 3 : 0;
}

/* Rows of a matrix (3, N) that select the 3-vector whose numbers in z are `stride` apart. */
static void select_vector(uint32_t N, uint32_t first, uint32_t stride, double *rows) {
    for (uint32_t c = 0; c < 3; c++) rows[c * N + first + c * stride] = 1.0;
}

/* Sets A, B, d and k for the parts y. */
static void set_constraints(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y, step *s) {
    enum { MOST = LG_HAMILTONIAN_AMBIENT };
    double A[2 * MOST * MOST] = {0.0}, B[2 * MOST * MOST] = {0.0}, d[MOST]; /* rotations: 3 k = 2 N */
    const uint32_t N = s->N;
    if (N > MOST) {
        (void)lg_tape_fail(tape, LG_UNSUPPORTED, "hamiltonian", "too many positions for a variational step");
        return;
    }
    uint32_t from = 0;
    for (size_t i = 0; family->layout[i] != NULL; i += 2) {
        const uint32_t v = vectors_of(lg_var_shape(tape, y[i]));
        const uint32_t end = from + lg_hamiltonian_width(tape, y[i]);
        for (; v > 0 && from < end; from += 3 * v)
            for (uint32_t a = 0; a < v; a++)
                for (uint32_t b = a; b < v; b++, s->k++) {
                    select_vector(N, from + a, v, A + 3 * s->k * N);
                    select_vector(N, from + b, v, B + 3 * s->k * N);
                    d[s->k] = a == b;
                }
        from = end;
    }
    s->d = lg_input_f64(tape, lg_shape2(1, s->k), d);
    if (family->layout[2] == NULL && vectors_of(lg_var_shape(tape, y[0])) == 1) return;
    s->A = lg_input_f64(tape, lg_shape2(3 * s->k, N), A);
    s->B = lg_input_f64(tape, lg_shape2(3 * s->k, N), B);
}

/* The vectors a or b of z, (rows, k, 3). */
static lg_var selected(lg_tape *tape, const step *s, lg_var z, lg_var matrix) {
    const lg_var x = lg_is_none(matrix) ? z : lg_matmul_nt(tape, z, matrix);
    return lg_reshape(tape, x, lg_shape3(s->rows, s->k, 3));
}

/* C^T nu at the start, (rows, N): A^T (nu b) + B^T (nu a). */
static lg_var normal_of(lg_tape *tape, const step *s, lg_var nu) {
    const lg_shape flat = lg_shape2(s->rows, 3 * s->k);
    const lg_var tall = lg_reshape(tape, nu, lg_shape3(s->rows, s->k, 1));
    const lg_var on_a = lg_reshape(tape, lg_mul(tape, s->b, tall), flat);
    if (lg_is_none(s->A)) return lg_scale(tape, on_a, 2.0);
    const lg_var on_b = lg_reshape(tape, lg_mul(tape, s->a, tall), flat);
    return lg_add(tape, lg_matmul(tape, on_a, s->A), lg_matmul(tape, on_b, s->B));
}

/* r = c(z1). */
static lg_status held(void *user, lg_tape *tape, lg_var nu, lg_var *r) {
    const step *s = user;
    const lg_var z = lg_sub(tape, s->free, lg_matmul(tape, normal_of(tape, s, nu), s->W));
    const lg_var c = lg_rowdot(tape, selected(tape, s, z, s->A), selected(tape, s, z, s->B));
    *r = lg_sub(tape, lg_reshape(tape, c, lg_shape2(s->rows, s->k)), s->d);
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
    step s = {.rows = lg_var_shape(tape, z).dims[0], .N = N};
    set_constraints(tape, family, y, &s);
    s.a = selected(tape, &s, z, s.A);
    s.b = selected(tape, &s, z, s.B);
    s.W = lg_spd_solve(tape, K, lg_unit_matrix(tape, N));
    s.W = lg_reshape(tape, s.W, lg_shape2(N, N));
    lg_var P = lg_matmul(tape, rate, lg_reshape(tape, K, lg_shape2(N, N)));
    P = moved(tape, over, P, -0.5, lg_hamiltonian_potential_gradient(tape, vars, z));
    s.free = moved(tape, over, z, 1.0, lg_matmul(tape, P, s.W));
    lg_var nu = lg_full(tape, lg_shape2(s.rows, s.k), 0.0);
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
