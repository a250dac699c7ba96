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
 * needed: pi = sum_j r_j x P_j, p = P - q (q.P), and the components of P for lines. Momenta that belong to
 * a symmetry of V under rotations and shifts are conserved to rounding. */
#include "core/core.h"
#include "hamiltonian/internal.h"
#include "integrators/taped_internal.h"
#include "liegrad/ops.h"

enum { PAIRS = LG_HAMILTONIAN_MAX_PARTS / 2 };

/* How the positions of a part are constrained, and what its momenta are. x and P are parts in the shape of
 * the position. */
typedef struct manifold_row {
    uint32_t constraints;                                  /* per copy */
    lg_var (*violation)(lg_tape *tape, lg_var x);          /* c, (B, constraints k) */
    lg_var (*normal)(lg_tape *tape, lg_var x, lg_var nu);  /* C^T nu in the shape of x */
    lg_var (*momentum)(lg_tape *tape, lg_var x, lg_var P); /* the momentum of the state */
} manifold_row;

static lg_var rows_of(lg_tape *tape, lg_var x, uint32_t width) {
    return lg_reshape(tape, x, lg_shape2(lg_var_shape(tape, x).dims[0], width));
}

/* ---- directions: |q|^2 - 1 ---- */

static lg_var off_sphere(lg_tape *tape, lg_var q) {
    return rows_of(tape, lg_add_scalar(tape, lg_rownorm2(tape, q), -1.0), lg_var_shape(tape, q).dims[1]);
}

static lg_var across_sphere(lg_tape *tape, lg_var q, lg_var nu) {
    const lg_shape shape = lg_var_shape(tape, q);
    const lg_var tall = lg_reshape(tape, nu, lg_shape3(shape.dims[0], shape.dims[1], 1));
    return lg_mul(tape, lg_scale(tape, q, 2.0), tall);
}

static lg_var along_sphere(lg_tape *tape, lg_var q, lg_var P) {
    return lg_sub(tape, P, lg_mul(tape, q, lg_rowdot(tape, q, P)));
}

/* ---- rotations: the upper triangle of R^T R - I ---- */

static lg_var matrices(lg_tape *tape, lg_var R) {
    const lg_shape shape = lg_var_shape(tape, R);
    return lg_reshape(tape, R, lg_shape3(shape.dims[0] * shape.dims[1], 3, 3));
}

static lg_var off_rotation(lg_tape *tape, lg_var R) {
    static const double upper[9 * 6] = {[0] = 1,      [6 + 1] = 1,  [12 + 2] = 1,
                                        [24 + 3] = 1, [30 + 4] = 1, [48 + 5] = 1};
    static const double unit[6] = {1, 0, 0, 1, 0, 1};
    const lg_shape shape = lg_var_shape(tape, R);
    const lg_var X = matrices(tape, R);
    lg_var gram = lg_reshape(tape, lg_matmul_tn(tape, X, X), lg_shape2(shape.dims[0] * shape.dims[1], 9));
    gram = lg_matmul(tape, gram, lg_input_f64(tape, lg_shape2(9, 6), upper));
    gram = lg_sub(tape, gram, lg_input_f64(tape, lg_shape2(1, 6), unit));
    return lg_reshape(tape, gram, lg_shape2(shape.dims[0], 6 * shape.dims[1]));
}

/* R S, where S is symmetric: nu above the diagonal, 2 nu on it. */
static lg_var across_rotation(lg_tape *tape, lg_var R, lg_var nu) {
    static const double both[6 * 9] = {[0] = 2,      [9 + 1] = 1,  [9 + 3] = 1,  [18 + 2] = 1, [18 + 6] = 1,
                                       [27 + 4] = 2, [36 + 5] = 1, [36 + 7] = 1, [45 + 8] = 2};
    const lg_shape shape = lg_var_shape(tape, R);
    const uint32_t count = shape.dims[0] * shape.dims[1];
    lg_var S =
        lg_matmul(tape, lg_reshape(tape, nu, lg_shape2(count, 6)), lg_input_f64(tape, lg_shape2(6, 9), both));
    S = lg_matmul(tape, matrices(tape, R), lg_reshape(tape, S, lg_shape3(count, 3, 3)));
    return lg_reshape(tape, S, shape);
}

static const manifold_row flat = {0}, sphere = {1, off_sphere, across_sphere, along_sphere},
                          rotation = {6, off_rotation, across_rotation, lg_columns_crossed};

static const manifold_row *row_of(lg_tape *tape, lg_var x) {
    const lg_shape shape = lg_var_shape(tape, x);
    return shape.rank != 3 ? &flat : shape.dims[2] == 9 ? &rotation : &sphere;
}

/* ---- a step ---- */

/* All parts of positions one after the other; `violation` and `normal` of all parts. */
typedef struct step {
    const lg_hamiltonian_family *family;
    const lg_var *y; /* the state at the start */
    lg_var free;     /* z + h W P, (B, N) */
    lg_var W;        /* (N, N) */
} step;

static lg_var all_violations(lg_tape *tape, const step *s, lg_var z) {
    lg_var x[LG_HAMILTONIAN_MAX_PARTS], c[PAIRS];
    size_t count = 0;
    lg_hamiltonian_cut(tape, s->family, s->y, z, 0, x);
    for (size_t i = 0; s->family->layout[i] != NULL; i += 2) {
        const manifold_row *row = row_of(tape, s->y[i]);
        if (row->constraints > 0) c[count++] = row->violation(tape, x[i]);
    }
    return count == 1 ? c[0] : lg_concat(tape, c, count, 1);
}

/* C^T nu at the start, (B, N). */
static lg_var all_normals(lg_tape *tape, const step *s, lg_var nu) {
    lg_var each[PAIRS];
    uint32_t from = 0;
    size_t count = 0;
    for (size_t i = 0; s->family->layout[i] != NULL; i += 2, count++) {
        const manifold_row *row = row_of(tape, s->y[i]);
        const lg_shape shape = lg_var_shape(tape, s->y[i]);
        const uint32_t width = lg_hamiltonian_width(tape, s->y[i]);
        if (row->constraints == 0) {
            each[count] = lg_full(tape, lg_shape2(shape.dims[0], width), 0.0);
            continue;
        }
        const uint32_t own = row->constraints * shape.dims[1];
        const lg_var part = lg_slice(tape, nu, 1, from, own);
        each[count] = rows_of(tape, row->normal(tape, s->y[i], part), width);
        from += own;
    }
    return count == 1 ? each[0] : lg_concat(tape, each, count, 1);
}

static lg_status held(void *user, lg_tape *tape, lg_var nu, lg_var *r) {
    const step *s = user;
    const lg_var z = lg_sub(tape, s->free, lg_matmul(tape, all_normals(tape, s, nu), s->W));
    *r = all_violations(tape, s, z);
    return lg_tape_status(tape);
}

static uint32_t constraints_of(lg_tape *tape, const step *s) {
    uint32_t count = 0;
    for (size_t i = 0; s->family->layout[i] != NULL; i += 2)
        count += row_of(tape, s->y[i])->constraints * lg_var_shape(tape, s->y[i]).dims[1];
    return count;
}

/* The state's momenta from P (B, N) at positions out[0], out[2], ...; y gives the shapes. */
static void take_momenta(lg_tape *tape, const step *s, lg_var P, lg_var *out) {
    lg_var own[LG_HAMILTONIAN_MAX_PARTS];
    lg_hamiltonian_cut(tape, s->family, s->y, P, 0, own);
    for (size_t i = 0; s->family->layout[i] != NULL; i += 2) {
        const manifold_row *row = row_of(tape, s->y[i]);
        out[i + 1] = row->constraints == 0 ? own[i] : row->momentum(tape, out[i], own[i]);
    }
}

lg_status lg_hamiltonian_variational_step(lg_tape *tape, const lg_hamiltonian_vars *vars, double h,
                                          const lg_var *y, lg_var *out) {
    const lg_hamiltonian_family *family = vars->model->family;
    lg_var next[LG_HAMILTONIAN_MAX_PARTS], K, rate;
    family->ambient(tape, vars, y, &K, &rate);
    const uint32_t N = lg_var_shape(tape, rate).dims[1], rows = lg_var_shape(tape, rate).dims[0];
    const lg_var z = lg_hamiltonian_joined(tape, family, y, 0);
    step s = {.family = family, .y = y};
    s.W = lg_spd_solve(tape, K, lg_unit_matrix(tape, N));
    s.W = lg_reshape(tape, s.W, lg_shape2(N, N));
    lg_var P = lg_matmul(tape, rate, lg_reshape(tape, K, lg_shape2(N, N)));
    P = lg_taped_moved(tape, P, -0.5 * h, lg_hamiltonian_potential_gradient(tape, vars, z));
    s.free = lg_taped_moved(tape, z, h, lg_matmul(tape, P, s.W));
    lg_var nu = lg_full(tape, lg_shape2(rows, constraints_of(tape, &s)), 0.0);
    LG_TRY(lg_taped_root(tape, &(lg_root){.equations = held, .user = &s, .scale = 1.0}, nu, &nu));
    const lg_var normal = all_normals(tape, &s, nu);
    const lg_var z1 = lg_sub(tape, s.free, lg_matmul(tape, normal, s.W));
    P = lg_taped_moved(tape, P, -1.0 / h, normal);
    P = lg_taped_moved(tape, P, -0.5 * h, lg_hamiltonian_potential_gradient(tape, vars, z1));
    lg_hamiltonian_cut(tape, family, y, z1, 0, next);
    take_momenta(tape, &s, P, next);
    for (size_t i = 0; family->layout[i] != NULL; i++) out[i] = next[i];
    return lg_tape_status(tape);
}
