/* The chain's fields on a tape, in both forms, as compositions of plain operations on k x k matrices. In
 * Lagrangian form a custom operation computes the value, and the adjoint for lg_backward, in O(k)
 * (chain_derivatives.c). All other derivatives use the composition, which takes 4 times as long with 2 links
 * and 60 times with 150. */
#include "mechanics/chain_derivatives.h"
#include "mechanics/engine.h"

/* ---- constants ---- */

/* A constant (1, rows, 3): e3 in the first row, 0 in the others. */
static lg_var e3_first(lg_tape *tape, uint32_t rows) {
    void *values = NULL;
    lg_var out = lg_input_buffer(tape, lg_shape3(1, rows, 3), &values);
    if (lg_is_none(out)) return out;
    for (size_t i = 0; i < 3 * (size_t)rows; i++)
        lg_put_numbers(lg_tape_dtype(tape), values, i, &(double){i == 2}, 1);
    return out;
}

/* ---- parameters ---- */

typedef struct taped_chain {
    lg_var gravity;      /* (1) */
    lg_var mass, length; /* (1, k, 1) */
    lg_var rate;         /* (1, 1, 1): g/L_1 */
    lg_var own, next;    /* (1, k, k): the diagonal of W, and W without it */
} taped_chain;

static taped_chain bind(lg_tape *tape, uint32_t k, lg_var parameters) {
    const lg_shape column = lg_shape3(1, k, 1);
    taped_chain c = {.gravity = lg_slice(tape, parameters, 0, 0, 1)};
    c.mass = lg_reshape(tape, lg_slice(tape, parameters, 0, 1, k), column);
    c.length = lg_reshape(tape, lg_slice(tape, parameters, 0, 1 + k, k), column);
    const lg_var light = lg_pow(tape, c.mass, -1.0), curvature = lg_pow(tape, c.length, -1.0),
                 scale = lg_mul(tape, curvature, lg_transpose(tape, curvature));
    const lg_var links = lg_matmul(tape, lg_band_matrix(tape, k, 1.0, 1.0, 0.0), light),
                 above = lg_mul(tape, lg_band_matrix(tape, k, 0.0, 0.0, -1.0), light);
    c.rate = lg_mul(tape, c.gravity, lg_slice(tape, curvature, 1, 0, 1));
    c.own = lg_mul(tape, lg_mul(tape, lg_unit_matrix(tape, k), links), scale);
    c.next = lg_mul(tape, lg_add(tape, above, lg_transpose(tape, above)), scale);
    return c;
}

/* ---- Lagrangian ---- */

/* The second part v = (q_i (q_i.q_i'') - q_i'') of the LIE field, (B, k, 3); as in chain_derivatives.c. */
static lg_var compose(lg_tape *tape, lg_var q, lg_var omega, lg_var parameters) {
    const uint32_t k = lg_var_shape(tape, q).dims[1];
    const taped_chain c = bind(tape, k, parameters);
    const lg_var fall = lg_mul(tape, c.rate, e3_first(tape, k)); /* (1, k, 3) */
    const lg_var T = lg_add(tape, c.own, lg_mul(tape, c.next, lg_matmul_nt(tape, q, q)));
    const lg_var weight = lg_sum_axis(tape, lg_mul(tape, fall, q), -1, true);
    const lg_var lambda = lg_spd_solve(tape, T, lg_sub(tape, lg_rownorm2(tape, omega), weight));
    const lg_var pulled = lg_matmul(tape, lg_add(tape, c.own, c.next), lg_mul(tape, lambda, q));
    const lg_var second = lg_neg(tape, lg_add(tape, fall, pulled));
    return lg_sub(tape, lg_mul(tape, q, lg_rowdot(tape, q, second)), second);
}

enum { Q, OMEGA, PARAMETERS, VARIABLES };
enum { SIZES = VARIABLES, SCRATCH, INPUTS }; /* further inputs of field_op */

/* The composition of copies x of the inputs, for partial derivatives: one input may depend on another. */
static lg_var composed(lg_tape *tape, const lg_var *in, lg_var *x) {
    for (size_t i = 0; i < VARIABLES; i++) x[i] = lg_scale(tape, in[i], 1.0);
    return compose(tape, x[Q], x[OMEGA], x[PARAMETERS]);
}

static lg_status field_forward(void *user, lg_dtype dtype, const void *const *in, void *y) {
    lg_chain_batch_value(&(lg_chain_batch){dtype, in[SIZES], in[SCRATCH]}, in, y);
    return LG_OK;
}

static lg_status field_numeric_vjp(void *user, lg_dtype dtype, const void *const *in, const void *y,
                                   const void *g, void *const *out) {
    lg_chain_batch_adjoint(&(lg_chain_batch){dtype, in[SIZES], in[SCRATCH]}, in, g, out);
    return LG_OK;
}

static lg_status field_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                           const bool *need, lg_var *out) {
    lg_var x[VARIABLES];
    const lg_var value = composed(tape, in, x);
    return lg_vjp(tape, &value, &g, 1, x, VARIABLES, out);
}

static lg_status field_jvp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y,
                           const lg_var *tangents, lg_var *out) {
    lg_var x[VARIABLES], moving[VARIABLES], direction[VARIABLES];
    const lg_var value = composed(tape, in, x);
    size_t count = 0;
    for (size_t i = 0; i < VARIABLES; i++) {
        if (lg_is_none(tangents[i])) continue;
        moving[count] = x[i];
        direction[count++] = tangents[i];
    }
    return lg_jvp(tape, &value, 1, moving, direction, count, out);
}

static const lg_custom_op field_op = {.name = "pendulum-chain",
                                      .forward = field_forward,
                                      .vjp = field_vjp,
                                      .numeric_vjp = field_numeric_vjp,
                                      .jvp = field_jvp};

lg_status lg_chain_taped_lagrangian(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                    lg_var input, lg_var parameters, lg_var *algebra) {
    const uint32_t k = (uint32_t)system->links, batch = lg_rows_of(tape, y[0]);
    const size_t scratch = lg_chain_scratch(k) * (lg_tape_dtype(tape) == LG_F64 ? 1 : 2);
    void *unused = NULL;
    if (scratch > UINT32_MAX) {
        (void)lg_tape_fail(tape, LG_OUT_OF_MEMORY, "pendulum-chain", "too many links for a tape");
        return lg_tape_status(tape);
    }
    const double sizes[2] = {batch, k};
    lg_var in[INPUTS] = {[Q] = y[0],
                         [OMEGA] = y[1],
                         [PARAMETERS] = parameters,
                         [SIZES] = lg_input_f64(tape, lg_shape1(2), sizes),
                         [SCRATCH] = lg_input_buffer(tape, lg_shape1((uint32_t)scratch), &unused)};
    lg_var v = lg_custom(tape, &field_op, in, INPUTS, lg_shape3(batch, k, 3));
    algebra[0] = y[1];
    algebra[1] = v;
    return lg_tape_status(tape);
}

/* ---- Hamiltonian; notation as at lg_chain_gradient ---- */

lg_status lg_chain_taped_hamiltonian(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                     lg_var input, lg_var parameters, lg_var *algebra) {
    const uint32_t k = (uint32_t)system->links;
    const taped_chain c = bind(tape, k, parameters);
    lg_var lambda, v = lg_tied_velocity(tape, lg_add(tape, c.own, c.next), y[0], y[1], &lambda);
    lg_var mu = lg_matmul(tape, lg_upper_ones(tape, k), c.mass);
    lg_var weight = lg_mul(tape, c.gravity, lg_mul(tape, mu, c.length)); /* (1, k, 1) */
    lg_var g = lg_sub(tape, lg_mul(tape, weight, e3_first(tape, 1)), lg_mul(tape, lambda, v));
    const lg_var dH[2] = {g, v};
    algebra[0] = lg_bracket_rate(tape, y, dH);
    algebra[1] = lg_bracket_change(tape, y, dH);
    return lg_tape_status(tape);
}

/* ---- the row: m_ij = mu_max(i,j) L_i L_j, V = sum_i mu_i g L_i e3.q_i, mu_i = m_i + m_{i+1} + ... ---- */

/* The matrix A (1, k, k) with A_il = L_i for l >= i, else 0. M is A diag(m) A^T. */
static lg_var summing(lg_tape *tape, const lg_at *at) {
    const uint32_t k = at->size;
    return lg_mul(tape, lg_reshape(tape, lg_row_numbers(tape, at, 1 + k, k), lg_shape3(1, k, 1)),
                  lg_upper_ones(tape, k));
}

static lg_var mass(lg_tape *tape, const lg_at *at) {
    const uint32_t k = at->size;
    const lg_var A = summing(tape, at),
                 m = lg_reshape(tape, lg_row_numbers(tape, at, 1, k), lg_shape3(1, 1, k));
    return lg_matmul_nt(tape, lg_mul(tape, A, m), A);
}

static lg_var potential(lg_tape *tape, const lg_at *at) {
    const uint32_t k = at->size;
    const lg_var m = lg_reshape(tape, lg_row_numbers(tape, at, 1, k), lg_shape3(1, k, 1));
    const lg_var heights = lg_slice(tape, at->state[0], 2, 2, 1); /* (B, k, 1) */
    const lg_var all = lg_mul(tape, heights, lg_matmul(tape, summing(tape, at), m));
    const lg_var V = lg_sum_axis(tape, lg_reshape(tape, all, lg_shape2(at->rows, k)), 1, true);
    return lg_mul(tape, V, lg_row_number(tape, at, 0));
}

static const double one = 1.0;

const lg_parameter_entry lg_chain_parameters[] = {
    {"gravity", "g", 1, LG_PARAMETER_FINITE, NULL, "acceleration along -e3, m/s^2"},
    {"masses", "m", 0, LG_PARAMETER_POSITIVE, &one, "mass at the end of each link, kg"},
    {"lengths", "L", 0, LG_PARAMETER_POSITIVE, &one, "length of each link, m"},
    {.key = NULL}};

const lg_energy_row lg_energy_chain = {"pendulum-chain",          lg_chain_parameters, mass, potential, 0,
                                       {LG_COORDINATE_DIRECTION}, .seen = ~0U};
