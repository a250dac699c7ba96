/* Families of bodies: rotations R in SO(3), directions q in S^2 and lines x in R, coupled by masses.
 *
 * The columns r_1, r_2, r_3 of each R, the directions q and, for each line, x e with a vector e of three
 * parameters are the vectors of the system. They move as points of bodies move, so with the Gram matrix m
 *
 *   T = 1/2 sum_ij m_ij v_i'.v_j'.
 *
 * For one body m is the matrix of its second moments, integral of x x^T dm in the body, and the inertia is
 * trace(m) I - m. For a body and a pendulum of mass M and length l with its pivot at d in the body, the last
 * row of m is M l (d_1, d_2, d_3, l).
 *
 * z (N) is the ambient position: the numbers of all R, of all q, then all x. w (D) is the velocity: spatial
 * rates omega of the rotations, q' of the directions, x'. Then z' = A(z) w, where A is affine in z, and
 *
 *   p = A^T K A w,  K = E^T (m o I_3) E,  q_i.q_i' = 0.
 *
 * E takes z' to the velocities of the vectors, and m o I_3 has the blocks m_ij I. With C^T w = 0 for the
 * directions, M = A^T K A and multipliers lambda:
 *
 *   w = M^-1 (p - C lambda),  C^T M^-1 C lambda = C^T M^-1 p.
 *
 * From the stationary form H = max_w p.w - 1/2 w^T M w - lambda.C^T w + V the gradient by z at fixed p is
 * dV/dz - d/dz (y.A(z) w) - lambda_i w_i, with the constant y = K z'. With g = dH/dz and the spatial angular
 * momenta pi the equations are
 *
 *   R' = hat(omega) R, pi' = omega x pi - sum_j r_j x g_j;  q, p as in a chain;  x' = w, p' = -g.
 *
 * Without lines M is constant in the frame of the body, which saves its factorization for each state. */

#include "hamiltonian/internal.h"

/* vars->kinetic: K (1, N, N); the linear part of A (N, N D) and its constant part (N D); M^-1 (D, D) in the
 * frame of the body, or LG_NONE where M is not constant in this frame. */
enum { MASS, TURN, REST, INVERSE };

enum { MOST_AMBIENT = 30, MOST_RATES = 18, MOST_VECTORS = 10 };

/* The numbers of rotations, directions, lines and vectors; N and D. */
typedef struct counts {
    uint32_t rotations, directions, lines, vectors, ambient, rates;
} counts;

static counts counts_of(const lg_hamiltonian_family *family, uint32_t n) {
    counts c = {
        .rotations = n * family->bodies.rotations,
        .directions = n * family->bodies.directions,
        .lines = n * family->bodies.lines,
    };
    c.vectors = 3 * c.rotations + c.directions + c.lines;
    c.ambient = 9 * c.rotations + 3 * c.directions + c.lines;
    c.rates = 3 * c.rotations + 3 * c.directions + c.lines;
    return c;
}

/* Returns the index in z of component i of vector v. Vector v belongs to a rotation or a direction, not to a
 * line. */
static uint32_t place_of(const counts *c, uint32_t v, uint32_t i) {
    return v < 3 * c->rotations ? 9 * (v / 3) + 3 * i + v % 3 : 3 * v + i;
}

/* ---- constants ---- */

static lg_var constant(lg_tape *tape, uint32_t rows, uint32_t columns, const double *values) {
    return lg_input_f64(tape, lg_shape2(rows, columns), values);
}

/* K from m (1, V, V) and the vectors e of the lines (3 l), or LG_NONE. */
static lg_var ambient_mass(lg_tape *tape, const counts *c, lg_var m, lg_var axes) {
    const uint32_t rows = 3 * c->vectors, bound = c->vectors - c->lines;
    double fixed[3 * MOST_VECTORS * MOST_AMBIENT] = {0.0}, column[3 * MOST_VECTORS * MOST_VECTORS] = {0.0};
    for (uint32_t r = 0; r < rows; r++) {
        if (r < 3 * bound)
            fixed[r * c->ambient + place_of(c, r / 3, r % 3)] = 1.0;
        else
            column[(r - 3 * bound) * c->lines + r / 3 - bound] = 1.0;
    }
    lg_var E = constant(tape, rows, c->ambient, fixed);
    if (c->lines > 0) {
        lg_var along = lg_mul(tape, lg_reshape(tape, axes, lg_shape2(3 * c->lines, 1)),
                              constant(tape, 3 * c->lines, c->lines, column));
        along = lg_pad(tape, lg_pad(tape, along, 0, 3 * bound, 0), 1, c->ambient - c->lines, 0);
        E = lg_add(tape, E, along);
    }
    lg_var K = lg_matmul_tn(tape, E, lg_matmul(tape, lg_hamiltonian_record_blocks(tape, c->vectors, m), E));
    return lg_reshape(tape, K, lg_shape3(1, c->ambient, c->ambient));
}

/* The linear part of A: r' = omega x r for the columns of each R. */
static lg_var turning(lg_tape *tape, const counts *c) {
    double turn[MOST_AMBIENT * MOST_AMBIENT * MOST_RATES] = {0.0};
    for (uint32_t v = 0; v < 3 * c->rotations; v++)
        for (uint32_t i = 0; i < 3; i++) {
            const uint32_t to = place_of(c, v, i), a = (i + 1) % 3, b = (i + 2) % 3, first = 3 * (v / 3);
            turn[(place_of(c, v, b) * c->ambient + to) * c->rates + first + a] = 1.0;
            turn[(place_of(c, v, a) * c->ambient + to) * c->rates + first + b] = -1.0;
        }
    return constant(tape, c->ambient, c->ambient * c->rates, turn);
}

/* The constant part of A: the velocities of directions and lines are part of w. */
static lg_var resting(lg_tape *tape, const counts *c) {
    double rest[MOST_AMBIENT * MOST_RATES] = {0.0};
    const uint32_t row = 9 * c->rotations, column = 3 * c->rotations;
    for (uint32_t i = 0; i < 3 * c->directions + c->lines; i++) rest[(row + i) * c->rates + column + i] = 1.0;
    return constant(tape, 1, c->ambient * c->rates, rest);
}

/* Whether M is constant in the frame of the body, which has at most one direction. A q' turned into this
 * frame is a velocity like any other, but the vector e of a line is fixed in space. */
static bool has_frame(const counts *c) {
    return c->rotations == 1 && c->lines == 0;
}

static lg_var motion_matrix(lg_tape *tape, const lg_hamiltonian_vars *vars, const counts *c, lg_var z) {
    const lg_var A = lg_add(tape, lg_matmul(tape, z, vars->kinetic[TURN]), vars->kinetic[REST]);
    return lg_reshape(tape, A, lg_shape3(lg_rows_of(tape, z), c->ambient, c->rates));
}

static lg_var mass_matrix(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var A) {
    return lg_matmul_tn(tape, A, lg_matmul(tape, vars->kinetic[MASS], A));
}

/* M^-1 at R = I, whatever q is. */
static lg_var inverse_at_unit(lg_tape *tape, const lg_hamiltonian_vars *vars, const counts *c) {
    const double unit[MOST_AMBIENT] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
    const lg_var A = motion_matrix(tape, vars, c, constant(tape, 1, c->ambient, unit));
    const lg_var inverse = lg_spd_solve(tape, mass_matrix(tape, vars, A), lg_unit_matrix(tape, c->rates));
    return lg_reshape(tape, inverse, lg_shape2(c->rates, c->rates));
}

static void bind(lg_tape *tape, const lg_var *arrays, lg_hamiltonian_vars *vars) {
    const counts c = counts_of(vars->model->family, vars->model->n);
    lg_var m = lg_hamiltonian_record_gram(tape, c.vectors, arrays[0], arrays[1]);
    vars->kinetic[MASS] = ambient_mass(tape, &c, m, c.lines > 0 ? arrays[2] : LG_NONE);
    vars->kinetic[TURN] = turning(tape, &c);
    vars->kinetic[REST] = resting(tape, &c);
    vars->kinetic[INVERSE] = has_frame(&c) ? inverse_at_unit(tape, vars, &c) : LG_NONE;
}

/* ---- kinetic energy ---- */

/* A (B, N, D), w (B, D, 1), and lambda (B, k, 1) or LG_NONE, from z (B, N) and p (B, D). */
typedef struct motion {
    lg_var A, w, lambda;
} motion;

static motion motion_of(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var z, lg_var p) {
    const counts c = counts_of(vars->model->family, vars->model->n);
    const uint32_t rows = lg_rows_of(tape, z), k = c.directions;
    motion s = {.A = motion_matrix(tape, vars, &c, z), .lambda = LG_NONE};
    const lg_var M = mass_matrix(tape, vars, s.A), column = lg_reshape(tape, p, lg_shape3(rows, c.rates, 1));
    if (k == 0) {
        s.w = lg_spd_solve(tape, M, column);
        return s;
    }
    const lg_var q = lg_reshape(tape, lg_slice(tape, z, 1, 9 * c.rotations, 3 * k), lg_shape3(rows, k, 3)),
                 C = lg_tie_columns(tape, q, 3 * c.rotations, c.rates);
    s.w = lg_tied_velocities(tape, M, LG_NONE, column, C, &s.lambda);
    return s;
}

/* The motion in the frame of the body, with k = 0 or 1 directions. The rows of x (B, 1 + 2 k, 3) are pi, p, q
 * in space, the rows of x R in the frame. `momenta` and `w` (B, D) are pi, p and omega, q' in the frame,
 * lambda (B, 1) or LG_NONE. */
typedef struct framed {
    lg_var R, x, momenta, w, lambda;
} framed;

static framed framed_of(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const counts c = counts_of(vars->model->family, vars->model->n);
    const lg_var inverse = vars->kinetic[INVERSE];
    const uint32_t rows = lg_rows_of(tape, y[0]);
    const lg_shape line = lg_shape3(rows, 1, 3);
    framed s = {.R = lg_reshape(tape, y[0], lg_shape3(rows, 3, 3)), .lambda = LG_NONE};
    s.x = lg_reshape(tape, y[1], line);
    if (c.directions > 0) {
        const lg_var parts[3] = {s.x, lg_reshape(tape, y[3], line), lg_reshape(tape, y[2], line)};
        s.x = lg_concat(tape, parts, 3, 1);
    }
    const lg_var turned = lg_matmul(tape, s.x, s.R);
    s.momenta = lg_reshape(tape, lg_slice(tape, turned, 1, 0, 1 + c.directions), lg_shape2(rows, c.rates));
    s.w = lg_matmul(tape, s.momenta, inverse);
    if (c.directions > 0) {
        const lg_var q = lg_reshape(tape, lg_slice(tape, turned, 1, 2, 1), lg_shape2(rows, 3));
        const lg_var tied = lg_matmul(tape, q, lg_slice(tape, inverse, 0, 3, 3));
        s.lambda =
            lg_div(tape, lg_rowdot(tape, s.momenta, tied), lg_rowdot(tape, q, lg_slice(tape, tied, 1, 3, 3)));
        s.w = lg_sub(tape, s.w, lg_mul(tape, s.lambda, tied));
    }
    return s;
}

/* dH/dx in the frame (B, 1 + 2 k, 3): omega, q', -lambda q'. */
static lg_var framed_rates(lg_tape *tape, const framed *s) {
    const lg_shape shape = lg_var_shape(tape, s->w);
    const lg_var w = lg_reshape(tape, s->w, lg_shape3(shape.dims[0], shape.dims[1] / 3, 3));
    if (lg_is_none(s->lambda)) return w;
    const lg_var pull = lg_neg(tape, lg_mul(tape, s->lambda, lg_slice(tape, s->w, 1, 3, 3)));
    const lg_var both[2] = {w, lg_reshape(tape, pull, lg_shape3(shape.dims[0], 1, 3))};
    return lg_concat(tape, both, 2, 1);
}

static lg_var half_power(lg_tape *tape, lg_var p, lg_var w) {
    return lg_scale(tape, lg_rowdot(tape, p, w), 0.5);
}

static lg_var energy(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const lg_hamiltonian_family *family = vars->model->family;
    const counts c = counts_of(family, vars->model->n);
    const lg_var z = lg_hamiltonian_joined(tape, family, y, 0), p = lg_hamiltonian_joined(tape, family, y, 1);
    const lg_var potential = lg_hamiltonian_potential(tape, vars, z);
    if (has_frame(&c)) {
        const framed s = framed_of(tape, vars, y);
        return lg_add(tape, half_power(tape, s.momenta, s.w), potential);
    }
    const motion s = motion_of(tape, vars, z, p);
    return lg_add(tape, half_power(tape, p, lg_reshape(tape, s.w, lg_var_shape(tape, p))), potential);
}

/* d/dz (y.A(z) w) with y = K z' (B, N). */
static lg_var turned(lg_tape *tape, const lg_hamiltonian_vars *vars, const motion *s) {
    const lg_shape shape = lg_var_shape(tape, s->A);
    lg_var rate = lg_matmul(tape, s->A, s->w);
    lg_var y = lg_matmul(tape, vars->kinetic[MASS], rate);
    lg_var products = lg_reshape(tape, lg_matmul_nt(tape, y, s->w),
                                 lg_shape2(shape.dims[0], shape.dims[1] * shape.dims[2]));
    return lg_matmul_nt(tape, products, vars->kinetic[TURN]);
}

/* With b = x R: dT/dR = x^T dT/db, and dT/dx = dT/db R^T. */
static void gradient_framed(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    const lg_hamiltonian_family *family = vars->model->family;
    const framed s = framed_of(tape, vars, y);
    const lg_var rates = framed_rates(tape, &s), in_space = lg_matmul_nt(tape, rates, s.R);
    const lg_var z = lg_hamiltonian_joined(tape, family, y, 0);
    lg_hamiltonian_cut(tape, family, y, lg_hamiltonian_potential_gradient(tape, vars, z), 0, out);
    out[0] = lg_add(tape, out[0], lg_reshape(tape, lg_matmul_tn(tape, s.x, rates), lg_var_shape(tape, y[0])));
    out[1] = lg_reshape(tape, lg_slice(tape, in_space, 1, 0, 1), lg_var_shape(tape, y[1]));
    if (lg_is_none(s.lambda)) return;
    out[3] = lg_reshape(tape, lg_slice(tape, in_space, 1, 1, 1), lg_var_shape(tape, y[3]));
    const lg_var pull = lg_reshape(tape, lg_slice(tape, in_space, 1, 2, 1), lg_var_shape(tape, y[2]));
    out[2] = lg_add(tape, out[2], pull);
}

static void gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    const lg_hamiltonian_family *family = vars->model->family;
    const counts c = counts_of(family, vars->model->n);
    if (has_frame(&c)) {
        gradient_framed(tape, vars, y, out);
        return;
    }
    const lg_var z = lg_hamiltonian_joined(tape, family, y, 0), p = lg_hamiltonian_joined(tape, family, y, 1);
    const motion s = motion_of(tape, vars, z, p);
    const lg_var w = lg_reshape(tape, s.w, lg_var_shape(tape, p));
    lg_var g = lg_hamiltonian_potential_gradient(tape, vars, z);
    if (c.rotations > 0) g = lg_sub(tape, g, turned(tape, vars, &s));
    lg_hamiltonian_cut(tape, family, y, g, 0, out);
    lg_hamiltonian_cut(tape, family, y, w, 1, out);
    if (c.directions == 0) return;
    const size_t q = c.rotations > 0 ? 2 : 0;
    out[q] = lg_sub(tape, out[q], lg_mul(tape, out[q + 1], s.lambda));
}

/* K and z' = A w (B, N), for variational steps. */
static void ambient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *K,
                    lg_var *rate) {
    const lg_hamiltonian_family *family = vars->model->family;
    const lg_var z = lg_hamiltonian_joined(tape, family, y, 0), p = lg_hamiltonian_joined(tape, family, y, 1);
    const motion s = motion_of(tape, vars, z, p);
    *K = vars->kinetic[MASS];
    *rate = lg_reshape(tape, lg_matmul(tape, s.A, s.w), lg_var_shape(tape, z));
}

/* ---- rows ---- */

#define ROTATION       "R^T R = I"
#define DIRECTION      "|q| = 1 and q.p = 0"
#define MANIFOLD(c, k) ((k) == 0 ? ROTATION : (c) == 0 ? DIRECTION : ROTATION ", " DIRECTION)

/* What follows from the numbers of rotations, directions and lines of one copy. */
#define BODIES(c, k, l)                                                                                      \
    .copy = (c) > 0 ? "body" : "pendulum", .bodies = {c, k, l}, .most = 1,                                   \
    .factors = 2 * (c) + (k) + ((l) > 0 ? 2 : 0), .inputs = 9 * (c) + 3 * (k) + (l),                         \
    .forces = 3 * (c) + 3 * (k) + (l), .energy_unit = "J", .scheme = "rkmk5", .accurate = "rkmk54",          \
    .arrays = {{"mass/gamma", 2, 3 * (c) + (k) + (l)},                                                       \
               {"mass/b", 1, 3 * (c) + (k) + (l)},                                                           \
               {"mass/axis", (l) > 0 ? 1 : 0, 3 * (l)}},                                                     \
    .usable = lg_hamiltonian_usable_mass, .bind = bind, .energy = energy, .gradient = gradient,              \
    .ambient = ambient, .manifold = MANIFOLD(c, k)

/* A body, and its coordinates on lines. */
#define BODY_ON_LINES                                                                                        \
    .factor = {LG_SPACE_SO3, LG_SPACE_RN, LG_SPACE_RN, LG_SPACE_RN}, .scaled = {false, true, true, true},    \
    .layout = {"R", "pi", "x", "px"}, .state_units = "R: 1, pi: kg m^2/s, x: m, px: kg m/s",                 \
    .field_meaning = "omega, pi', x', px'"

const lg_hamiltonian_family lg_hamiltonian_rotation = {
    .name = "rotation",
    .description = "learned Hamiltonian of bodies that turn about fixed points",
    .factor = {LG_SPACE_SO3, LG_SPACE_RN},
    .each = {1, 3},
    .scaled = {false, true},
    .layout = {"R", "pi"},
    .state_units = "R: 1, pi: kg m^2/s",
    .formula = "1/2 pi.J(R)^-1 pi + V(R) on T*SO(3)",
    .input_meaning = "torques in space",
    .field_meaning = "omega in space, then pi': R' = hat(omega) R",
    BODIES(1, 0, 0)};

const lg_hamiltonian_family lg_hamiltonian_rotation_direction = {
    .name = "rotation-direction",
    .description = "learned Hamiltonian of a body with a pendulum",
    .factor = {LG_SPACE_SO3, LG_SPACE_RN, LG_SPACE_TS2},
    .each = {1, 3, 1},
    .scaled = {false, true, false, true},
    .layout = {"R", "pi", "q", "p"},
    .state_units = "R, q: 1, pi, p: kg m^2/s",
    .formula = "1/2 p.M(R,q)^-1 p + V(R,q) on T*(SO(3) x S^2)",
    .input_meaning = "torques in space: on the body, then on the direction about its pivot",
    .field_meaning = "omega, pi' of the body, then (xi, eta) of the direction as in a chain",
    BODIES(1, 1, 0)};

const lg_hamiltonian_family lg_hamiltonian_rotation_line = {
    .name = "rotation-line",
    .description = "learned Hamiltonian of a body with a coordinate",
    .each = {1, 3, 1, 1},
    .formula = "1/2 p.M(R)^-1 p + V(R,x) on T*(SO(3) x R)",
    .input_meaning = "torques in space, then the force along x",
    BODY_ON_LINES,
    BODIES(1, 0, 1)};

const lg_hamiltonian_family lg_hamiltonian_pose = {.name = "pose",
                                                   .description = "learned Hamiltonian of a free body",
                                                   .each = {1, 3, 3, 3},
                                                   .formula = "1/2 p.M(R)^-1 p + V(R,x) on T*SE(3)",
                                                   .input_meaning =
                                                       "torques in space about x, then forces in space",
                                                   BODY_ON_LINES,
                                                   BODIES(1, 0, 3)};

const lg_hamiltonian_family lg_hamiltonian_pose_direction = {
    .name = "pose-direction",
    .description = "learned Hamiltonian of a free body with a pendulum",
    .factor = {LG_SPACE_SO3, LG_SPACE_RN, LG_SPACE_TS2, LG_SPACE_RN, LG_SPACE_RN},
    .each = {1, 3, 1, 3, 3},
    .scaled = {false, true, false, true, true, true},
    .layout = {"R", "pi", "q", "p", "x", "px"},
    .state_units = "R, q: 1, pi, p: kg m^2/s, x: m, px: kg m/s",
    .formula = "1/2 p.M(R,q)^-1 p + V(R,q,x) on T*(SE(3) x S^2)",
    .input_meaning = "torques in space: on the body, on the direction; then forces in space",
    .field_meaning = "omega, pi', then (xi, eta) of the direction as in a chain, then x', px'",
    BODIES(1, 1, 3)};

const lg_hamiltonian_family lg_hamiltonian_direction_line = {
    .name = "direction-line",
    .description = "learned Hamiltonian of a cart with a spherical pendulum",
    .factor = {LG_SPACE_TS2, LG_SPACE_RN, LG_SPACE_RN},
    .each = {1, 1, 1},
    .scaled = {false, true, true, true},
    .layout = {"q", "p", "x", "px"},
    .state_units = "q: 1, p: kg m^2/s, x: m, px: kg m/s",
    .formula = "1/2 p.M(q)^-1 p + V(q,x) on T*(S^2 x R)",
    .input_meaning = "the torque in space on the direction about its pivot, then the force along x",
    .field_meaning = "(xi, eta) of the direction as in a chain, then x', px'",
    BODIES(0, 1, 1)};
