/* Symmetries of a potential: what V's network takes instead of the coordinates x, and the sign of mirrored
 * arguments. */
#include "core/core.h"
#include "liegrad/ops.h"
#include "hamiltonian/internal.h"

/* Whether x has a direction in R^3 for each copy, or is one vector of R^n. */
static bool has_directions(const lg_hamiltonian_family *family) {
    return family->factor[0] == LG_SPACE_TS2 && family->inputs == 3;
}

static bool has_vector(const lg_hamiltonian_family *family) {
    return family->factor[0] == LG_SPACE_RN && family->inputs == 1;
}

/* ---- invariants of n directions q_i, from their coordinates q[0], q[1], q[2], each (B, n) ---- */

static void split_directions(lg_tape *tape, const lg_hamiltonian *model, lg_var x, lg_var *q) {
    const uint32_t rows = lg_var_shape(tape, x).dims[0], n = model->n;
    const lg_var directions = lg_reshape(tape, x, lg_shape3(rows, n, 3));
    for (uint32_t c = 0; c < 3; c++)
        q[c] = lg_reshape(tape, lg_slice(tape, directions, 2, c, 1), lg_shape2(rows, n));
}

/* q_i.q_j for i < j */
static lg_var inner(lg_tape *tape, const lg_var *q) {
    static const double ones[3] = {1.0, 1.0, 1.0};
    lg_var products[3];
    for (size_t c = 0; c < 3; c++) products[c] = lg_hamiltonian_pairs(tape, q[c], q[c]);
    return lg_linear_combination(tape, products, ones, 3);
}

/* e3.(q_i x q_j) for i < j */
static lg_var twist(lg_tape *tape, const lg_var *q) {
    return lg_sub(tape, lg_hamiltonian_pairs(tape, q[0], q[1]), lg_hamiltonian_pairs(tape, q[1], q[0]));
}

/* ---- rows ---- */

static uint32_t pairs_of(uint32_t n) {
    return n * (n - 1) / 2;
}

static uint32_t axial_count(const lg_hamiltonian *model) {
    return has_directions(model->family) ? model->n + 2 * pairs_of(model->n) : 0;
}

static lg_var axial(lg_tape *tape, const lg_hamiltonian *model, lg_var x) {
    lg_var q[3];
    split_directions(tape, model, x, q);
    if (model->n == 1) return q[2];
    const lg_var all[3] = {q[2], inner(tape, q), twist(tape, q)};
    return lg_concat(tape, all, 3, 1);
}

static uint32_t spherical_count(const lg_hamiltonian *model) {
    if (has_directions(model->family)) return pairs_of(model->n);
    return has_vector(model->family) ? 1 : 0;
}

static lg_var spherical(lg_tape *tape, const lg_hamiltonian *model, lg_var x) {
    lg_var q[3];
    if (has_vector(model->family)) return lg_rownorm2(tape, x);
    split_directions(tape, model, x, q);
    return inner(tape, q);
}

static const lg_symmetry_row rows[LG_SYMMETRY_COUNT] = {
    [LG_SYMMETRY_NONE] = {.sign = 0.0},
    [LG_SYMMETRY_EVEN] = {.sign = 1.0},
    [LG_SYMMETRY_ODD] = {.sign = -1.0},
    [LG_SYMMETRY_AXIAL] = {.count = axial_count, .record = axial, .degree = 1},
    [LG_SYMMETRY_SPHERICAL] = {
        .count = spherical_count, .record = spherical, .degree = 2, .isotropic = true}};

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
