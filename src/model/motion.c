/* Coordinates of tangent spaces: those of a family of Hamiltonians, and those of the factors of a machine's
 * space. */
#include <string.h>

#include "core/core.h"
#include "liegrad/geometry.h"
#include "hamiltonian/internal.h"
#include "model/internal.h"

/* ---- Hamiltonians ---- */

static void family_basis(const lg_model *model, const double *state, double *basis) {
    model->motion.family->basis(model->motion.copies, state, basis);
}

static void family_coordinates(const lg_model *model, const double *state, const double *vector, double *c) {
    model->motion.family->coordinates(model->motion.copies, state, vector, c);
}

static void unit_basis(const lg_model *model, const double *state, double *basis) {
    const size_t d = model->inputs;
    (void)state;
    memset(basis, 0, d * d * sizeof *basis);
    for (size_t i = 0; i < d; i++) basis[i * d + i] = 1.0;
}

static void unit_coordinates(const lg_model *model, const double *state, const double *vector, double *c) {
    (void)state;
    memcpy(c, vector, model->inputs * sizeof *c);
}

lg_status lg_model_hamiltonian_motion(const lg_hamiltonian *hamiltonian, lg_model_motion *out) {
    const lg_hamiltonian_family *family = hamiltonian->family;
    *out =
        (lg_model_motion){.moves = true,
                          .forces = lg_hamiltonian_input_dim(hamiltonian),
                          .tangent = (size_t)family->tangent * hamiltonian->n,
                          .basis = family->basis != NULL ? family_basis : unit_basis,
                          .coordinates = family->coordinates != NULL ? family_coordinates : unit_coordinates,
                          .family = family,
                          .copies = hamiltonian->n};
    return lg_hamiltonian_space(family, hamiltonian->n, &out->space);
}

/* ---- the factors of a machine's space ---- */

/* One copy: `tangent` coordinates, basis (numbers of the state, tangent). */
typedef struct factor_row {
    size_t tangent;
    void (*basis)(const double *state, double *basis);
    void (*coordinates)(const double *state, const double *vector, double *c);
} factor_row;

static void number_basis(const double *state, double *basis) {
    (void)state;
    basis[0] = 1.0;
}

static void number_coordinates(const double *state, const double *vector, double *c) {
    (void)state;
    c[0] = vector[0];
}

static void direction_basis(const double *state, double *basis) {
    lg_hamiltonian_chain.basis(1, state, basis);
}

static void direction_coordinates(const double *state, const double *vector, double *c) {
    lg_hamiltonian_chain.coordinates(1, state, vector, c);
}

/* dR = R hat(a): column j of dR is that of a x e_j, in the body. */
static void rotation_basis(const double *R, double *basis) {
    for (size_t row = 0; row < 3; row++)
        for (size_t j = 0; j < 3; j++) {
            const size_t k = (j + 1) % 3, l = (j + 2) % 3; /* e_k x e_j = -e_l, e_l x e_j = e_k */
            double *out = basis + 3 * (3 * row + j);
            out[j] = 0.0;
            out[k] = -R[3 * row + l];
            out[l] = R[3 * row + k];
        }
}

/* The vector of the skew part of R^T dR. */
static void rotation_coordinates(const double *R, const double *dR, double *c) {
    double a[9];
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++)
            a[3 * i + j] = R[i] * dR[j] + R[3 + i] * dR[3 + j] + R[6 + i] * dR[6 + j];
    c[0] = 0.5 * (a[7] - a[5]);
    c[1] = 0.5 * (a[2] - a[6]);
    c[2] = 0.5 * (a[3] - a[1]);
}

enum { MOST_COPY = 9 * 4 }; /* numbers in the basis of a copy */
static const factor_row factor_rows[] = {
    [LG_SPACE_RN] = {1, number_basis, number_coordinates},
    [LG_SPACE_TS2] = {4, direction_basis, direction_coordinates},
    [LG_SPACE_SO3] = {3, rotation_basis, rotation_coordinates},
};

/* One copy after the other: where its state and its coordinates begin. */
static void product_basis(const lg_model *model, const double *state, double *basis) {
    const lg_space *space = &model->motion.space;
    const size_t r = model->motion.tangent;
    size_t at = 0, column = 0;
    memset(basis, 0, space->dim * r * sizeof *basis);
    for (size_t f = 0; f < space->factors; f++) {
        const factor_row *row = &factor_rows[space->factor[f].kind];
        const size_t numbers = lg_space_kind_entry(space->factor[f].kind)->state, t = row->tangent;
        for (size_t copy = 0; copy < space->factor[f].count; copy++, at += numbers, column += t) {
            double own[MOST_COPY];
            row->basis(state + at, own);
            for (size_t i = 0; i < numbers; i++)
                memcpy(basis + (at + i) * r + column, own + i * t, t * sizeof *own);
        }
    }
}

static void product_coordinates(const lg_model *model, const double *state, const double *vector, double *c) {
    const lg_space *space = &model->motion.space;
    for (size_t f = 0; f < space->factors; f++) {
        const factor_row *row = &factor_rows[space->factor[f].kind];
        const size_t numbers = lg_space_kind_entry(space->factor[f].kind)->state;
        for (size_t copy = 0; copy < space->factor[f].count; copy++) {
            row->coordinates(state, vector, c);
            state += numbers;
            vector += numbers;
            c += row->tangent;
        }
    }
}

lg_status lg_model_machine_motion(const lg_machine *machine, lg_model_motion *out) {
    *out = (lg_model_motion){.moves = true,
                             .forces = machine->input_count,
                             .basis = product_basis,
                             .coordinates = product_coordinates};
    LG_TRY(lg_machine_space(machine, &out->space));
    for (size_t f = 0; f < out->space.factors; f++)
        out->tangent += out->space.factor[f].count * factor_rows[out->space.factor[f].kind].tangent;
    return LG_OK;
}

/* ---- vectors and the group ---- */

static void number_lift(const double *state, const double *vector, double *a) {
    (void)state;
    a[0] = vector[0];
}

/* (xi x q, xi x p + eta x q) = (dq, dp), xi and eta orthogonal to q: xi = q x dq, eta = q x (dp - xi x
 * p). */
static void direction_lift(const double *state, const double *vector, double *a) {
    double rest[3];
    lg_cross3(state, vector, a);
    lg_cross3(a, state + 3, rest);
    for (int i = 0; i < 3; i++) rest[i] = vector[3 + i] - rest[i];
    lg_cross3(state, rest, a + 3);
}

/* dR = hat(u) R: u = R c with dR = R hat(c). */
static void rotation_lift(const double *R, const double *dR, double *u) {
    double c[3];
    rotation_coordinates(R, dR, c);
    for (int i = 0; i < 3; i++) u[i] = R[3 * i] * c[0] + R[3 * i + 1] * c[1] + R[3 * i + 2] * c[2];
}

static void (*const lifts[LG_SPACE_KINDS])(const double *, const double *, double *) = {
    [LG_SPACE_RN] = number_lift,
    [LG_SPACE_TS2] = direction_lift,
    [LG_SPACE_SO3] = rotation_lift,
};

lg_status lg_space_lift(const lg_space *space, const double *state, const double *vector, double *algebra) {
    for (size_t f = 0; f < space->factors; f++) {
        const lg_space_entry *entry = lg_space_kind_entry(space->factor[f].kind);
        if (lifts[space->factor[f].kind] == NULL) return LG_UNSUPPORTED;
        for (size_t copy = 0; copy < space->factor[f].count; copy++) {
            lifts[space->factor[f].kind](state, vector, algebra);
            state += entry->state;
            vector += entry->state;
            algebra += entry->algebra;
        }
    }
    return LG_OK;
}

/* exp(a) acts linearly on T*S^2 and SO(3); on R^n it moves points and leaves vectors as they are. */
void lg_space_push(const lg_space *space, const double *algebra, size_t columns, double *x, double *column) {
    const size_t d = space->dim;
    for (size_t j = 0; j < columns; j++) {
        for (size_t i = 0; i < d; i++) column[i] = x[i * columns + j];
        double *at = column;
        const double *a = algebra;
        for (size_t f = 0; f < space->factors; f++) {
            const lg_space_factor *factor = &space->factor[f];
            const lg_space_entry *entry = lg_space_kind_entry(factor->kind);
            if (!entry->abelian) entry->act(factor->count, a, at, at);
            at += factor->count * entry->state;
            a += factor->count * entry->algebra;
        }
        for (size_t i = 0; i < d; i++) x[i * columns + j] = column[i];
    }
}
