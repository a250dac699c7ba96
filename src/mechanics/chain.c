/* The pendulum chain of k spherical pendulums in two forms: Hamiltonian on (T*S^2)^k, and Lagrangian on
 * (TS^2)^k, y = (q_1, omega_1, q_2, omega_2, ...), with equations at lg_system_ode in liegrad/mechanics.h. */
#include "mechanics/chain.h"

#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/vectors.inc"

#include "mechanics/fields/chain.inc"
#include "mechanics/fields/chain_hamiltonian.inc"
#include "mechanics/fields/chain_lagrangian.inc"

static void prepare(lg_system *system, double *constants) {
    const lg_chain c = lg_chain_of(system);
    lg_chain_constants(&c);
}

/* Applies the factors of m = D U diag(m_l) U^T D from right to left: the first loop computes the momentum of
 * each mass, the second one sums the momenta of all masses below each joint. */
static void apply_m(const lg_chain *chain, const double *x, double *out) {
    double sum[3] = {0.0, 0.0, 0.0};
    for (size_t i = 0; i < chain->links; i++)
        for (int c = 0; c < 3; c++) {
            sum[c] += chain->length[i] * x[3 * i + c];
            out[3 * i + c] = chain->mass[i] * sum[c];
        }
    memset(sum, 0, sizeof(sum));
    for (size_t i = chain->links; i-- > 0;)
        for (int c = 0; c < 3; c++) {
            sum[c] += out[3 * i + c];
            out[3 * i + c] = chain->length[i] * sum[c];
        }
}

/* ---- velocities ---- */

static void velocity_of_omega(size_t links, const double *y, double *v) {
    for (size_t i = 0; i < links; i++) lg_cross3(y + 6 * i + 3, y + 6 * i, v + 3 * i);
}

static void put_omega(size_t links, const double *v, double *y) {
    for (size_t i = 0; i < links; i++) lg_cross3(y + 6 * i, v + 3 * i, y + 6 * i + 3);
}

/* p_i = P_i sum_j m_ij v_j, P_i = I - q_i q_i^T. v_i is tangent, so projecting the whole sum leaves its term
 * m_ii v_i unchanged. work: 3k doubles. */
static void put_momentum(const lg_chain *chain, const double *v, double *y, double *work) {
    apply_m(chain, v, work);
    for (size_t i = 0; i < chain->links; i++) {
        double *q = y + 6 * i;
        const double along = lg_dot3(q, work + 3 * i);
        for (int c = 0; c < 3; c++) q[3 + c] = work[3 * i + c] - along * q[c];
    }
}

/* LG_NOT_FINITE if lambda is NaN, which means that a pivot was not positive. */
static lg_status sound(const number *lambda) {
    return isnan(lambda[0]) ? LG_NOT_FINITE : LG_OK;
}

lg_status lg_chain_gradient(const lg_chain *chain, const double *y, double *v, double *g, double *memory) {
    gradient_of(chain, y, v, g, memory);
    return sound(split_work(chain->links, memory).lambda);
}

/* ---- members of both forms, which work with velocities ---- */

/* v (k, 3) of the state. */
static lg_status take(const lg_system *system, const double *y, double *v, double *work) {
    const lg_chain chain = lg_chain_of(system);
    if (system->row->structure == LG_STRUCTURE_HAMILTONIAN)
        return lg_chain_gradient(&chain, y, v, work, work + 3 * chain.links);
    velocity_of_omega(chain.links, y, v);
    return LG_OK;
}

/* Writes omega or p of v into the state. */
static void put(const lg_system *system, const double *v, double *y, double *work) {
    const lg_chain chain = lg_chain_of(system);
    if (system->row->structure == LG_STRUCTURE_HAMILTONIAN)
        put_momentum(&chain, v, y, work);
    else
        put_omega(chain.links, v, y);
}

static lg_status step(void *user, double t, double h, double *y) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    double *v = own->work, *rest = v + 3 * chain.links;
    LG_TRY(take(own->system, y, v, rest));
    LG_TRY(lg_chain_rattle(&chain, h, y, v, rest));
    put(own->system, v, y, rest);
    return LG_OK;
}

static lg_status plane(const lg_system *system, lg_rng *rng, double *y) {
    const lg_chain chain = lg_chain_of(system);
    double v[3 * LG_PLANE_LINKS], work[3 * LG_PLANE_LINKS];
    LG_TRY(lg_chain_plane_start(&chain, rng, y, v));
    put(system, v, y, work);
    return LG_OK;
}

/* All x_i (k, 3), then all x_i' (k, 3). */
static lg_status observe(const lg_system *system, const double *y, double *out, double *v) {
    const lg_chain chain = lg_chain_of(system);
    const size_t k = chain.links;
    LG_TRY(take(system, y, v, v + 3 * k));
    for (size_t i = 0; i < k; i++)
        for (size_t c = 0; c < 3; c++) {
            double *x = out + 3 * i + c, *dx = x + 3 * k;
            *x = chain.length[i] * y[6 * i + c] + (i > 0 ? x[-3] : 0.0);
            *dx = chain.length[i] * v[3 * i + c] + (i > 0 ? dx[-3] : 0.0);
        }
    return LG_OK;
}

/* ---- invariants ---- */

/* The energy 1/2 sum_l m_l |x_l'|^2 + V(q), or the angular momentum about e3, sum_l m_l e3.(x_l x x_l'). */
static double lagrangian_invariant(const lg_system *system, size_t index, const double *y, double *v) {
    const lg_chain chain = lg_chain_of(system);
    double x[2] = {0.0, 0.0}, dx[3] = {0.0, 0.0, 0.0}, kinetic = 0.0, potential = 0.0, turning = 0.0;
    velocity_of_omega(chain.links, y, v);
    for (size_t i = 0; i < chain.links; i++) {
        for (int c = 0; c < 3; c++) dx[c] += chain.length[i] * v[3 * i + c];
        for (int c = 0; c < 2; c++) x[c] += chain.length[i] * y[6 * i + c];
        kinetic += 0.5 * chain.mass[i] * lg_dot3(dx, dx);
        potential += chain.weight[i] * y[6 * i + 2];
        turning += chain.mass[i] * (x[0] * dx[1] - x[1] * dx[0]);
    }
    return index == 0 ? kinetic + potential : turning;
}

/* sum_i e3.(q_i x p_i) is conserved because rotations about e3 are a symmetry. */
static double hamiltonian_invariant(const lg_system *system, size_t index, const double *y, double *memory) {
    const lg_chain chain = lg_chain_of(system);
    chain_work work = split_work(chain.links, memory);
    double kinetic = 0.0, potential = 0.0, turning = 0.0;
    if (index == 0) solve_extended(&chain, y, &work);
    for (size_t i = 0; i < chain.links; i++, y += 6) {
        turning += y[0] * y[4] - y[1] * y[3];
        if (index > 0) continue;
        kinetic += 0.5 * (lg_dot3(y + 3, work.wp + 3 * i) + work.lambda[i] * work.r[i]);
        potential += chain.weight[i] * y[2];
    }
    return index == 0 ? kinetic + potential : turning;
}

/* ---- vector fields ---- */

typedef double pair __attribute__((vector_size(16), may_alias, aligned(8)));

/* Stores two numbers at a time, because the code that reads them next loads two at a time. */
static inline void write_lie(const double *y, const double *a, double *out) {
    const double along = field_dot(y, a);
    *(pair *)out = (pair){y[3], y[4]};
    *(pair *)(out + 2) = (pair){y[5], y[0] * along - a[0]};
    *(pair *)(out + 4) = (pair){y[1] * along - a[1], y[2] * along - a[2]};
}

#define FIELD(name, call)                                                                                    \
    static lg_status name(void *user, double t, const double *y, const double *input, double *out) {         \
        const lg_system_user *own = user;                                                                    \
        const lg_chain chain = lg_chain_of(own->system);                                                     \
        call;                                                                                                \
    }
#define LAGRANGIAN(pendulum, write)                                                                          \
    if (chain.links == 1)                                                                                    \
        pendulum(&chain, y, out);                                                                            \
    else                                                                                                     \
        chain_field(&chain, y, own->work, out, write);                                                       \
    return LG_OK
#define HAMILTONIAN(of)                                                                                      \
    of(&chain, y, own->work, out);                                                                           \
    return sound(split_work(chain.links, own->work + 6 * chain.links).lambda)
FIELD(lagrangian_lie, LAGRANGIAN(pendulum_lie, write_lie))
FIELD(lagrangian_ambient, LAGRANGIAN(pendulum_ambient, write_ambient))
FIELD(hamiltonian_lie, HAMILTONIAN(hamiltonian_lie_of))
FIELD(hamiltonian_ambient, HAMILTONIAN(hamiltonian_ambient_of))

/* ---- rows ---- */

enum { WORK = 6 + 12 }; /* numbers for each link: 6 for v and g, 12 that lg_chain_gradient needs */
static const char *const invariants[] = {"energy", "vertical-angular-momentum", NULL};

#define STATE(name, second)                                                                                  \
    static const lg_state_entry name[] = {                                                                   \
        {"q", 0, 1, 3, 0, 6, NULL}, {second, 0, 1, 3, 3, 6, NULL}, {.key = NULL}};
STATE(lagrangian_state, "omega")
STATE(hamiltonian_state, "p")

#define FORM(of)                                                                                             \
    .name = "pendulum-chain", .form = #of, .parameters = lg_chain_parameters, .state = of##_state,           \
    .factor = {{LG_SPACE_TS2, 0}}, .constants = CHAIN_CONSTANTS, .prepare = prepare,                         \
    .invariants = invariants, .invariant = of##_invariant, .observed = 6, .observe = observe,                \
    .plane = plane, .step = step, .work = WORK, .field = {of##_lie, of##_ambient},                           \
    .taped = lg_chain_taped_##of
const lg_system_row lg_system_row_chain_lagrangian = {FORM(lagrangian), .structure = LG_STRUCTURE_LAGRANGIAN};
const lg_system_row lg_system_row_chain_hamiltonian = {
    FORM(hamiltonian), .structure = LG_STRUCTURE_HAMILTONIAN, .extended = true};

/* ---- public functions ---- */

static lg_status check_chain(const lg_system *system, const void *a, const void *b, const void *c) {
    if (!system || !a || !b || !c) return LG_INVALID_ARGUMENT;
    return system->row->step == step ? LG_OK : LG_UNSUPPORTED;
}

lg_status lg_chain_mass_matrix(const lg_system *system, double *m) {
    LG_TRY(check_chain(system, m, m, m));
    const lg_chain chain = lg_chain_of(system);
    for (size_t i = 0; i < chain.links; i++)
        for (size_t j = 0; j < chain.links; j++)
            m[i * chain.links + j] = chain.mu[i > j ? i : j] * chain.length[i] * chain.length[j];
    return LG_OK;
}

lg_status lg_chain_potential_weights(const lg_system *system, double *weights) {
    LG_TRY(check_chain(system, weights, weights, weights));
    memcpy(weights, lg_chain_of(system).weight, system->links * sizeof(*weights));
    return LG_OK;
}

lg_status lg_chain_momenta(const lg_system *system, const double *from, double *to, double *work) {
    LG_TRY(check_chain(system, from, to, work));
    const lg_chain chain = lg_chain_of(system);
    velocity_of_omega(chain.links, from, work);
    if (to != from) memcpy(to, from, 6 * chain.links * sizeof(*to));
    put_momentum(&chain, work, to, work + 3 * chain.links);
    return LG_OK;
}

lg_status lg_chain_velocities(const lg_system *system, const double *from, double *to, double *work) {
    LG_TRY(check_chain(system, from, to, work));
    const lg_chain chain = lg_chain_of(system);
    double *v = work, *g = v + 3 * chain.links;
    LG_TRY(lg_chain_gradient(&chain, from, v, g, g + 3 * chain.links));
    if (to != from) memcpy(to, from, 6 * chain.links * sizeof(*to));
    put_omega(chain.links, v, to);
    return LG_OK;
}
