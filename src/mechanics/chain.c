/* The pendulum chain: parameters, constants, and functions that both forms use. */
#include "mechanics/chain.h"

#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"

static const double one = 1.0;

const lg_parameter_entry lg_chain_parameters[] = {
    [CHAIN_GRAVITY] = {"gravity", "g", 1, LG_PARAMETER_FINITE, NULL, "acceleration along -e3, m/s^2"},
    [CHAIN_MASSES] = {"masses", "m", 0, LG_PARAMETER_POSITIVE, &one, "mass at the end of each link, kg"},
    [CHAIN_LENGTHS] = {"lengths", "L", 0, LG_PARAMETER_POSITIVE, &one, "length of each link, m"},
    {.key = NULL}};

const char *const lg_chain_invariants[] = {"energy", "vertical-angular-momentum", NULL};

void lg_chain_prepare(lg_system *system, double *constants) {
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

void lg_chain_velocity_of_omega(size_t links, const double *y, double *v) {
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

double lg_chain_vertical_momentum(const lg_chain *chain, const double *y, const double *v) {
    double x[2] = {0.0, 0.0}, dx[2] = {0.0, 0.0}, sum = 0.0;
    for (size_t i = 0; i < chain->links; i++) {
        for (int c = 0; c < 2; c++) {
            x[c] += chain->length[i] * y[6 * i + c];
            dx[c] += chain->length[i] * v[3 * i + c];
        }
        sum += chain->mass[i] * (x[0] * dx[1] - x[1] * dx[0]);
    }
    return sum;
}

double lg_chain_energy(const lg_chain *chain, const double *y, const double *v) {
    double dx[3] = {0.0, 0.0, 0.0}, kinetic = 0.0, potential = 0.0;
    for (size_t i = 0; i < chain->links; i++) {
        for (int c = 0; c < 3; c++) dx[c] += chain->length[i] * v[3 * i + c];
        kinetic += 0.5 * chain->mass[i] * lg_dot3(dx, dx);
        potential += chain->weight[i] * y[6 * i + 2];
    }
    return kinetic + potential;
}

/* ---- members of both forms, which work with velocities ---- */

/* v (k, 3) of the state. */
static lg_status take(const lg_system *system, const double *y, double *v, double *work) {
    const lg_chain chain = lg_chain_of(system);
    if (system->row->structure == LG_STRUCTURE_HAMILTONIAN)
        return lg_chain_gradient(&chain, y, v, work, work + 3 * chain.links);
    lg_chain_velocity_of_omega(chain.links, y, v);
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

lg_status lg_chain_step(void *user, double t, double h, double *y) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    double *v = own->work, *rest = v + 3 * chain.links;
    LG_TRY(take(own->system, y, v, rest));
    LG_TRY(lg_chain_rattle(&chain, h, y, v, rest));
    put(own->system, v, y, rest);
    return LG_OK;
}

lg_status lg_chain_plane(const lg_system *system, lg_rng *rng, double *y) {
    const lg_chain chain = lg_chain_of(system);
    double v[3 * LG_PLANE_LINKS], work[3 * LG_PLANE_LINKS];
    LG_TRY(lg_chain_plane_start(&chain, rng, y, v));
    put(system, v, y, work);
    return LG_OK;
}

/* All x_i (k, 3), then all x_i' (k, 3). */
lg_status lg_chain_observe(const lg_system *system, const double *y, double *out, double *v) {
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

/* ---- public functions ---- */

static lg_status check_chain(const lg_system *system, const void *a, const void *b, const void *c) {
    if (!system || !a || !b || !c) return LG_INVALID_ARGUMENT;
    return system->row->step == lg_chain_step ? LG_OK : LG_UNSUPPORTED;
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
    lg_chain_velocity_of_omega(chain.links, from, work);
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
