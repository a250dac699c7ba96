/* The chain of k spherical pendulums in Lagrangian form on (TS^2)^k, y = (q_1, omega_1, q_2, omega_2, ...);
 * equations at lg_system_ode in liegrad/mechanics.h. Its fields are in fields/chain_lagrangian.inc. */
#include "mechanics/chain.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/vectors.inc"

#include "mechanics/fields/chain_lagrangian.inc"

typedef double pair __attribute__((vector_size(16), may_alias, aligned(8)));

/* Stores two numbers at a time, because the code that reads them next loads two at a time. */
static inline void write_lie(const double *y, const double *a, double *out) {
    const double along = field_dot(y, a);
    *(pair *)out = (pair){y[3], y[4]};
    *(pair *)(out + 2) = (pair){y[5], y[0] * along - a[0]};
    *(pair *)(out + 4) = (pair){y[1] * along - a[1], y[2] * along - a[2]};
}

static lg_status field_lie(void *user, double t, const double *y, const double *input, double *algebra) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    if (chain.links == 1)
        pendulum_lie(&chain, y, algebra);
    else
        chain_field(&chain, y, own->work, algebra, write_lie);
    return LG_OK;
}

static lg_status field_ambient(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    if (chain.links == 1)
        pendulum_ambient(&chain, y, out);
    else
        chain_field(&chain, y, own->work, out, write_ambient);
    return LG_OK;
}

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const lg_chain chain = lg_chain_of(system);
    lg_chain_velocity_of_omega(chain.links, y, work);
    return index == 0 ? lg_chain_energy(&chain, y, work) : lg_chain_vertical_momentum(&chain, y, work);
}

static const lg_state_entry state[] = {
    {.key = "q", .outer = 0, .rows = 1, .columns = 3, .first = 0, .stride = 6},
    {.key = "omega", .outer = 0, .rows = 1, .columns = 3, .first = 3, .stride = 6},
    {.key = NULL}};

const lg_system_row lg_system_row_chain_lagrangian = {
    .form = "lagrangian",
    .structure = LG_STRUCTURE_LAGRANGIAN,
    .field = {[LG_COORDINATES_LIE] = field_lie, [LG_COORDINATES_AMBIENT] = field_ambient},
    .taped = lg_chain_taped_lagrangian,
    LG_CHAIN_MEMBERS,
};
