/* Symmetries of a potential: what V's network takes instead of the coordinates x, and the sign of mirrored
 * arguments. */
#include "hamiltonian/internal.h"

uint32_t lg_hamiltonian_vectors(const lg_hamiltonian *model) {
    const lg_hamiltonian_family *family = model->family;
    const bool chain = family->factor[0] == LG_SPACE_TS2 && family->inputs == 3;
    if (chain) return model->n;
    return family->bodies.lines > 0 ? 0
                                    : model->n * (3 * family->bodies.rotations + family->bodies.directions);
}

/* Whether x is one vector of R^n. */
static bool has_vector(const lg_hamiltonian_family *family) {
    return family->factor[0] == LG_SPACE_RN && family->inputs == 1;
}

/* ---- invariants of a body's R and k directions q_i ---- */

static uint32_t rotations_of(const lg_hamiltonian *model) {
    return model->n * model->family->bodies.rotations;
}

static uint32_t directions_of(const lg_hamiltonian *model) {
    return model->n * model->family->bodies.directions;
}

/* R^T v of the v in order (B, 3 m): q_i, with `axis` e3 first. Each function of R and the q_i that rotations
 * do not change is a function of R^T q_i; if only rotations about e3 do not change it, of R^T e3, too. */
static lg_var in_frame(lg_tape *tape, const lg_hamiltonian *model, lg_var x, bool axis) {
    const uint32_t rows = lg_rows_of(tape, x), k = directions_of(model);
    const lg_var R = lg_reshape(tape, lg_slice(tape, x, 1, 0, 9), lg_shape3(rows, 3, 3));
    lg_var part[2];
    size_t parts = 0;
    if (axis) part[parts++] = lg_reshape(tape, lg_slice(tape, R, 1, 2, 1), lg_shape2(rows, 3));
    if (k > 0) {
        const lg_var q = lg_reshape(tape, lg_slice(tape, x, 1, 9, 3 * k), lg_shape3(rows, k, 3));
        part[parts++] = lg_reshape(tape, lg_matmul(tape, q, R), lg_shape2(rows, 3 * k));
    }
    return lg_joined(tape, part, parts);
}

/* ---- invariants of a chain's q_i, from their coordinates q[0], q[1], q[2], each (B, n) ---- */

static void split_vectors(lg_tape *tape, const lg_hamiltonian *model, lg_var x, lg_var *q) {
    const uint32_t rows = lg_rows_of(tape, x), n = lg_hamiltonian_vectors(model);
    const lg_var vectors = lg_reshape(tape, x, lg_shape3(rows, n, 3));
    for (uint32_t c = 0; c < 3; c++)
        q[c] = lg_reshape(tape, lg_slice(tape, vectors, 2, c, 1), lg_shape2(rows, n));
}

/* q_i.q_j for i < j */
static lg_var inner(lg_tape *tape, const lg_var *q) {
    static const double ones[3] = {1.0, 1.0, 1.0};
    lg_var products[3];
    for (size_t c = 0; c < 3; c++) products[c] = lg_hamiltonian_pairs(tape, q[c], q[c]);
    return lg_linear_combination(tape, products, ones, 3);
}

/* ---- rows ---- */

static uint32_t pairs_of(uint32_t n) {
    return n * (n - 1) / 2;
}

static uint32_t axial_count(const lg_hamiltonian *model) {
    const uint32_t n = lg_hamiltonian_vectors(model);
    if (n == 0) return 0;
    return rotations_of(model) > 0 ? 3 + 3 * directions_of(model) : n + 2 * pairs_of(n);
}

static lg_var axial(lg_tape *tape, const lg_hamiltonian *model, lg_var x) {
    lg_var q[3];
    if (rotations_of(model) > 0) return in_frame(tape, model, x, true);
    split_vectors(tape, model, x, q);
    if (lg_hamiltonian_vectors(model) == 1) return q[2];
    /* e3.(q_i x q_j) for i < j */
    const lg_var twist =
        lg_sub(tape, lg_hamiltonian_pairs(tape, q[0], q[1]), lg_hamiltonian_pairs(tape, q[1], q[0]));
    const lg_var all[3] = {q[2], inner(tape, q), twist};
    return lg_concat(tape, all, 3, 1);
}

static uint32_t spherical_count(const lg_hamiltonian *model) {
    const uint32_t n = lg_hamiltonian_vectors(model);
    if (n > 0) return rotations_of(model) > 0 ? 3 * directions_of(model) : pairs_of(n);
    return has_vector(model->family) ? 1 : 0;
}

static lg_var spherical(lg_tape *tape, const lg_hamiltonian *model, lg_var x) {
    lg_var q[3];
    if (has_vector(model->family)) return lg_rownorm2(tape, x);
    if (rotations_of(model) > 0) return in_frame(tape, model, x, false);
    split_vectors(tape, model, x, q);
    return inner(tape, q);
}

/* sum pi + sum_i q_i x p_i, (B, 3) */
static lg_var total_momentum(lg_tape *tape, const lg_hamiltonian *model, const lg_var *y) {
    const uint32_t turned = rotations_of(model);
    if (turned == 0) return lg_sum_axis(tape, lg_cross(tape, y[0], y[1]), 1, false);
    const lg_shape shape = lg_shape3(lg_rows_of(tape, y[1]), turned, 3);
    const lg_var spin = lg_sum_axis(tape, lg_reshape(tape, y[1], shape), 1, false);
    return directions_of(model) == 0
               ? spin
               : lg_add(tape, spin, lg_sum_axis(tape, lg_cross(tape, y[2], y[3]), 1, false));
}

static lg_var axial_momentum(lg_tape *tape, const lg_hamiltonian *model, const lg_var *y) {
    return lg_slice(tape, total_momentum(tape, model, y), 1, 2, 1);
}

/* Of one vector of R^n: all q_i p_j - q_j p_i, i < j. */
static lg_var spherical_momentum(lg_tape *tape, const lg_hamiltonian *model, const lg_var *y) {
    if (!has_vector(model->family)) return total_momentum(tape, model, y);
    return lg_sub(tape, lg_hamiltonian_pairs(tape, y[0], y[1]), lg_hamiltonian_pairs(tape, y[1], y[0]));
}

static const lg_symmetry_row rows[LG_SYMMETRY_COUNT] = {
    [LG_SYMMETRY_NONE] = {.sign = 0.0},
    [LG_SYMMETRY_EVEN] = {.sign = 1.0},
    [LG_SYMMETRY_ODD] = {.sign = -1.0},
    [LG_SYMMETRY_AXIAL] = {.count = axial_count, .record = axial, .degree = 1, .momentum = axial_momentum},
    [LG_SYMMETRY_SPHERICAL] = {.count = spherical_count,
                               .record = spherical,
                               .degree = 2,
                               .isotropic = true,
                               .momentum = spherical_momentum}};

const lg_symmetry_row *lg_symmetry_row_of(lg_symmetry symmetry) {
    return (unsigned)symmetry < LG_SYMMETRY_COUNT ? &rows[symmetry] : NULL;
}

lg_status lg_hamiltonian_set_symmetry(lg_hamiltonian *model, lg_symmetry symmetry) {
    LG_NEEDS(NULL, model);
    const lg_symmetry_row *row = lg_symmetry_row_of(symmetry);
    const lg_potential_row *potential = lg_potential_row_of(model->potential);
    if (row == NULL || potential == NULL || model->family == NULL || model->net.layers == 0)
        return LG_INVALID_ARGUMENT;
    const uint32_t d = row->count != NULL ? row->count(model) : model->family->inputs * model->n;
    if (d == 0 || (potential->record != NULL && d > LG_DICTIONARY_COORDINATES)) return LG_UNSUPPORTED;
    lg_mlp net;
    LG_TRY(lg_mlp_init(&net, potential->count(d), model->net.width + 1, model->net.layers - 1, 1,
                       model->net.activation, false));
    model->net = net;
    model->symmetry = symmetry;
    return LG_OK;
}
