/* The chain of k spherical pendulums in Lagrangian form on (TS^2)^k, y = (q_1, omega_1, q_2, omega_2, ...);
 * equations at lg_system_ode in liegrad/mechanics.h. The tridiagonal system is eliminated from both ends to
 * the middle, which halves the chain of divisions that wait for each other. */
#include "mechanics/chain.h"

static inline double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* b_i without gravity, and e_i */
static inline double load(const lg_chain *chain, const double *y, size_t i) {
    return chain->length[i] * dot(y + 6 * i + 3, y + 6 * i + 3);
}

static inline double coupling(const lg_chain *chain, const double *y, size_t i) {
    return -chain->light[i] * dot(y + 6 * i, y + 6 * i + 6);
}

/* One end of the elimination: what the eliminated rows subtract from the next row. */
typedef struct front {
    double d, b;
} front;

/* Eliminates a row with diagonal d and right-hand side b, coupled to the next row by e: lambda = z - l
 * lambda_next. */
static inline front eliminate(front f, double d, double b, double e, double *l, double *z) {
    const double reciprocal = 1.0 / (d - f.d), rest = b - f.b;
    *l = e * reciprocal;
    *z = rest * reciprocal;
    return (front){e * e * reciprocal, e * *z};
}

/* lambda -> z (k); l (k): scratch */
static inline void tensions(const lg_chain *chain, const double *y, double *restrict l, double *restrict z) {
    const size_t k = chain->links, middle = k / 2, below = k - 1 - middle;
    const double *d = chain->diagonal, weight = chain->gravity * y[2];
    front top = {0.0, weight}, bottom = {0.0, 0.0};
    for (size_t i = 0; i < below; i++) {
        const size_t j = k - 1 - i;
        top = eliminate(top, d[i], load(chain, y, i), coupling(chain, y, i), &l[i], &z[i]);
        bottom = eliminate(bottom, d[j], load(chain, y, j), coupling(chain, y, j - 1), &l[j], &z[j]);
    }
    if (middle > below)
        top =
            eliminate(top, d[below], load(chain, y, below), coupling(chain, y, below), &l[below], &z[below]);
    double up = (load(chain, y, middle) - top.b - bottom.b) / (d[middle] - top.d - bottom.d), down = up;
    z[middle] = up;
    for (size_t i = middle, j = middle + 1; j < k; j++) {
        i--;
        z[i] = up = z[i] - l[i] * up;
        z[j] = down = z[j] - l[j] * down;
    }
    if (middle > below) z[0] = z[0] - l[0] * up;
}

/* The acceleration q_i'' of a link. `force` is lambda_i q_i - lambda_{i+1} q_{i+1}. `above` enters as the
 * acceleration of the mass above and leaves as that of the link's own mass. Both are without gravity, which
 * only the first link feels. */
static inline void accelerate(const lg_chain *chain, size_t i, const double force[3], double above[3],
                              double out[3]) {
    for (int c = 0; c < 3; c++) {
        const double own = -chain->light[i] * force[c];
        out[c] = chain->curvature[i] * (own - above[c]);
        above[c] = own;
    }
}

typedef double pair __attribute__((vector_size(16), may_alias, aligned(8)));

/* Writes two numbers at a time, because they are read next two at a time. */
static inline void write_lie(const double *y, const double *a, double *out) {
    const double along = dot(y, a);
    *(pair *)out = (pair){y[3], y[4]};
    *(pair *)(out + 2) = (pair){y[5], y[0] * along - a[0]};
    *(pair *)(out + 4) = (pair){y[1] * along - a[1], y[2] * along - a[2]};
}

static inline void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void write_ambient(const double *y, const double *a, double *out) {
    cross(y + 3, y, out);
    cross(y, a, out + 3);
}

/* out does not overlap y or work (2k). */
static inline void field(const lg_chain *chain, const double *restrict y, double *restrict work,
                         double *restrict out, void (*write)(const double *, const double *, double *)) {
    const size_t k = chain->links;
    double *lambda = work, above[3] = {0.0, 0.0, chain->gravity}, pull[3], force[3], a[3];
    tensions(chain, y, work + k, lambda);
    for (int c = 0; c < 3; c++) pull[c] = lambda[0] * y[c];
    for (size_t i = 0; i + 1 < k; i++, y += 6, out += 6) {
        for (int c = 0; c < 3; c++) {
            const double next = lambda[i + 1] * y[6 + c];
            force[c] = pull[c] - next;
            pull[c] = next;
        }
        accelerate(chain, i, force, above, a);
        write(y, a, out);
    }
    accelerate(chain, k - 1, pull, above, a);
    write(y, a, out);
}

static lg_status field_lie(void *user, double t, const double *y, const double *input, double *algebra) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    (void)t, (void)input;
    field(&chain, y, own->work, algebra, write_lie);
    return LG_OK;
}

static lg_status field_ambient(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    (void)t, (void)input;
    field(&chain, y, own->work, out, write_ambient);
    return LG_OK;
}

static lg_status step(void *user, double t, double h, double *y) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    double *v = own->work;
    (void)t;
    lg_chain_velocity_of_omega(chain.links, y, v);
    LG_TRY(lg_chain_rattle(&chain, h, y, v, v + 3 * chain.links));
    lg_chain_omega_of_velocity(chain.links, v, y);
    return LG_OK;
}

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const lg_chain chain = lg_chain_of(system);
    lg_chain_velocity_of_omega(chain.links, y, work);
    return index == 0 ? lg_chain_energy(&chain, y, work) : lg_chain_vertical_momentum(&chain, y, work);
}

static lg_status observe(const lg_system *system, const double *y, double *out, double *work) {
    const lg_chain chain = lg_chain_of(system);
    lg_chain_velocity_of_omega(chain.links, y, work);
    lg_chain_nodes(&chain, y, work, out);
    return LG_OK;
}

static lg_status plane(const lg_system *system, lg_rng *rng, double *y) {
    const lg_chain chain = lg_chain_of(system);
    double v[3 * LG_PLANE_LINKS];
    LG_TRY(lg_chain_plane_start(&chain, rng, y, v));
    lg_chain_omega_of_velocity(chain.links, v, y);
    return LG_OK;
}

/* lg_chain_velocities needs the most. */
static size_t work_of(size_t links) {
    return (3 + CHAIN_MOMENTUM_WORK) * links;
}

static const lg_state_entry state[] = {
    {.key = "q", .outer = 0, .rows = 1, .columns = 3, .first = 0, .stride = 6},
    {.key = "omega", .outer = 0, .rows = 1, .columns = 3, .first = 3, .stride = 6},
    {.key = NULL}};

const lg_system_row lg_system_row_chain_lagrangian = {
    .name = "pendulum-chain",
    .form = "lagrangian",
    .parameters = lg_chain_parameters,
    .state = state,
    .space = lg_chain_space,
    .constants = lg_chain_constants,
    .prepare = lg_chain_prepare,
    .work = work_of,
    .invariants = lg_chain_invariants,
    .invariant = invariant,
    .observed = lg_chain_observed,
    .observe = observe,
    .plane = plane,
    .structure = LG_STRUCTURE_LAGRANGIAN,
    .field = {[LG_COORDINATES_LIE] = field_lie, [LG_COORDINATES_AMBIENT] = field_ambient},
    .step = step,
    .taped = lg_chain_taped_lagrangian,
};
