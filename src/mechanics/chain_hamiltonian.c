/* The chain of k spherical pendulums in Hamiltonian form on (T*S^2)^k.
 * Its fields are in fields/chain_hamiltonian.inc. */
#include <math.h>

#include "liegrad/geometry.h"
#include "mechanics/chain.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/vectors.inc"

#include "mechanics/fields/chain.inc"

#include "mechanics/fields/chain_hamiltonian.inc"

/* LG_NOT_FINITE if lambda is NaN, which means that a pivot was not positive. */
static lg_status sound(const number *lambda) {
    return isnan(lambda[0]) ? LG_NOT_FINITE : LG_OK;
}

lg_status lg_chain_gradient(const lg_chain *chain, const double *y, double *v, double *g, double *memory) {
    gradient_of(chain, y, v, g, memory);
    return sound(split_work(chain->links, memory).lambda);
}

static double hamiltonian(const lg_chain *chain, const double *y, double *memory) {
    chain_work work = split_work(chain->links, memory);
    solve_extended(chain, y, &work);
    double kinetic = 0.0, potential = 0.0;
    for (size_t i = 0; i < chain->links; i++) {
        kinetic += 0.5 * (lg_dot3(y + 6 * i + 3, work.wp + 3 * i) + work.lambda[i] * work.r[i]);
        potential += chain->weight[i] * y[6 * i + 2];
    }
    return kinetic + potential;
}

/* sum_i e3.(q_i x p_i), which is conserved because rotations about e3 are a symmetry. */
static double vertical_momentum(const lg_chain *chain, const double *y) {
    double sum = 0.0;
    for (size_t i = 0; i < chain->links; i++, y += 6) sum += y[0] * y[4] - y[1] * y[3];
    return sum;
}

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const lg_chain chain = lg_chain_of(system);
    return index == 0 ? hamiltonian(&chain, y, work) : vertical_momentum(&chain, y);
}

/* ---- vector fields ---- */

static lg_status field_lie(void *user, double t, const double *y, const double *input, double *algebra) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    hamiltonian_lie_of(&chain, y, own->work, algebra);
    return sound(split_work(chain.links, own->work + 6 * chain.links).lambda);
}

static lg_status field_ambient(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    hamiltonian_ambient_of(&chain, y, own->work, out);
    return sound(split_work(chain.links, own->work + 6 * chain.links).lambda);
}

static const lg_state_entry state[] = {
    {.key = "q", .outer = 0, .rows = 1, .columns = 3, .first = 0, .stride = 6},
    {.key = "p", .outer = 0, .rows = 1, .columns = 3, .first = 3, .stride = 6},
    {.key = NULL}};

const lg_system_row lg_system_row_chain_hamiltonian = {
    .form = "hamiltonian",
    .structure = LG_STRUCTURE_HAMILTONIAN,
    .field = {[LG_COORDINATES_LIE] = field_lie, [LG_COORDINATES_AMBIENT] = field_ambient},
    .extended = true,
    .taped = lg_chain_taped_hamiltonian,
    LG_CHAIN_MEMBERS,
};
