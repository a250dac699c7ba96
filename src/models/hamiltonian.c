/* Learned Hamiltonians: description, initialisation, evaluation in the caller's memory. */
#include "liegrad/hamiltonian.h"

#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/geometry.h"
#include "models/hamiltonian_internal.h"

static const char *const integrator_names[LG_TRAIN_INTEGRATOR_COUNT] = {
    "euler", "lie-euler", "rk4", "cf4", "rkmk4", "stormer-verlet"};

const char *lg_train_integrator_name(lg_train_integrator integrator) {
    return (unsigned)integrator < LG_TRAIN_INTEGRATOR_COUNT ? integrator_names[integrator] : "unknown";
}

lg_status lg_train_integrator_parse(const char *name, lg_train_integrator *out) {
    for (int i = 0; i < LG_TRAIN_INTEGRATOR_COUNT; i++)
        if (strcmp(name, integrator_names[i]) == 0) {
            *out = (lg_train_integrator)i;
            return LG_OK;
        }
    return LG_NOT_FOUND;
}

/* ---- description ---- */

lg_status lg_hamiltonian_init(lg_hamiltonian *model, lg_hamiltonian_family family, uint32_t links,
                              lg_potential_kind potential, const uint32_t *hidden, uint32_t hidden_layers,
                              lg_activation activation) {
    if (links < 1 || links > LG_HAMILTONIAN_MAX_LINKS) return LG_INVALID_ARGUMENT;
    if (family != LG_HAMILTONIAN_CHAIN && family != LG_HAMILTONIAN_SEPARABLE) return LG_INVALID_ARGUMENT;
    if (potential != LG_POTENTIAL_MLP && potential != LG_POTENTIAL_LINEAR) return LG_INVALID_ARGUMENT;
    lg_hamiltonian made = {.family = family, .links = links, .potential = potential};
    uint32_t inputs = family == LG_HAMILTONIAN_CHAIN ? 3 * links : links;
    uint32_t layers = potential == LG_POTENTIAL_LINEAR ? 0 : hidden_layers;
    LG_TRY(lg_mlp_init(&made.net, inputs, hidden, layers, 1, activation, false));
    *model = made;
    return LG_OK;
}

size_t lg_hamiltonian_kinetic_offset(const lg_hamiltonian *model) {
    return lg_mlp_parameters(&model->net);
}

size_t lg_hamiltonian_parameters(const lg_hamiltonian *model) {
    size_t k = model->links;
    return lg_hamiltonian_kinetic_offset(model) + k * k + (model->family == LG_HAMILTONIAN_CHAIN ? k : 0);
}

uint32_t lg_hamiltonian_state_size(const lg_hamiltonian *model) {
    return model->family == LG_HAMILTONIAN_CHAIN ? 6 * model->links : 2 * model->links;
}

/* m = Gamma^T Gamma + diag(max(0, b)) */
static double mass_entry(size_t k, const double *kinetic, size_t i, size_t j) {
    double sum = 0.0;
    for (size_t l = 0; l < k; l++) sum += kinetic[l * k + i] * kinetic[l * k + j];
    const double b = kinetic[k * k + i];
    return i == j && b > 0.0 ? sum + b : sum;
}

/* Cholesky factor of the symmetric matrix a (k, k), lower triangle, in place. A pivot that is not positive
 * turns it and what follows into NaN. */
static void factor(size_t k, double *a) {
    for (size_t j = 0; j < k; j++)
        for (size_t i = j; i < k; i++) {
            double sum = a[i * k + j];
            for (size_t l = 0; l < j; l++) sum -= a[i * k + l] * a[j * k + l];
            a[i * k + j] = i == j ? (sum > 0.0 ? sqrt(sum) : NAN) : sum / a[j * k + j];
        }
}

/* Smallest pivot of m; NaN when one is not positive. */
static double smallest_pivot(size_t k, const double *kinetic) {
    double m[LG_HAMILTONIAN_MAX_LINKS * LG_HAMILTONIAN_MAX_LINKS], least = INFINITY;
    for (size_t i = 0; i < k * k; i++) m[i] = mass_entry(k, kinetic, i / k, i % k);
    factor(k, m);
    for (size_t i = 0; i < k; i++) {
        const double pivot = m[i * k + i] * m[i * k + i];
        if (!(pivot >= least)) least = pivot;
    }
    return least;
}

enum { MASS_DRAWS = 10000 };

void lg_hamiltonian_initialise(const lg_hamiltonian *model, lg_rng *rng, double *theta) {
    const size_t k = model->links, n = lg_hamiltonian_parameters(model);
    double *kinetic = theta + lg_hamiltonian_kinetic_offset(model);
    lg_mlp_initialise(&model->net, rng, theta);
    for (int draw = 0; draw < MASS_DRAWS; draw++) {
        for (double *x = kinetic; x < theta + n; x++) *x = lg_rng_uniform(rng);
        if (model->family == LG_HAMILTONIAN_SEPARABLE ||
            smallest_pivot(k, kinetic) >= LG_HAMILTONIAN_LEAST_PIVOT)
            return;
    }
}

/* ---- evaluation ---- */

/* The caller's memory, cut into arrays of doubles; the network's work comes last. */
typedef struct work_parts {
    double *q, *g;      /* (inputs) positions gathered, dV/dq */
    double *W, *S;      /* (k, k) m^-1; factor of W o G */
    double *wp, *v;     /* (k, 3) */
    double *u, *lambda; /* (k) */
    double *column;     /* (k) */
    void *net;
} work_parts;

static size_t cut(size_t *at, size_t doubles) {
    size_t here = *at;
    *at += (doubles + 7) & ~(size_t)7;
    return here;
}

/* `bytes`, or NULL: of all but the network's work. */
static work_parts parts_of(const lg_hamiltonian *model, void *work, size_t *bytes) {
    size_t k = model->links, inputs = model->net.width[0], at = 0;
    size_t q = cut(&at, inputs), g = cut(&at, inputs), W = cut(&at, k * k), S = cut(&at, k * k);
    size_t wp = cut(&at, 3 * k), v = cut(&at, 3 * k), u = cut(&at, k), lambda = cut(&at, k),
           column = cut(&at, k);
    double *base = work;
    if (bytes != NULL) *bytes = at * sizeof(double);
    if (base == NULL) return (work_parts){0};
    return (work_parts){base + q, base + g, base + W,      base + S,      base + wp,
                        base + v, base + u, base + lambda, base + column, base + at};
}

size_t lg_hamiltonian_work_size(const lg_hamiltonian *model) {
    size_t bytes;
    (void)parts_of(model, NULL, &bytes);
    return bytes + lg_mlp_work_size(&model->net, 1, LG_F64);
}

static void solve(size_t k, const double *l, double *x) {
    for (size_t i = 0; i < k; i++) {
        for (size_t j = 0; j < i; j++) x[i] -= l[i * k + j] * x[j];
        x[i] /= l[i * k + i];
    }
    for (size_t i = k; i-- > 0;) {
        for (size_t j = i + 1; j < k; j++) x[i] -= l[j * k + i] * x[j];
        x[i] /= l[i * k + i];
    }
}

static void invert_mass(size_t k, const double *kinetic, work_parts *w) {
    for (size_t i = 0; i < k; i++)
        for (size_t j = 0; j < k; j++) w->S[i * k + j] = mass_entry(k, kinetic, i, j);
    factor(k, w->S);
    for (size_t j = 0; j < k; j++) {
        for (size_t i = 0; i < k; i++) w->column[i] = i == j ? 1.0 : 0.0;
        solve(k, w->S, w->column);
        for (size_t i = 0; i < k; i++) w->W[i * k + j] = w->column[i];
    }
}

lg_status lg_hamiltonian_mass(const lg_hamiltonian *model, const double *theta, double *m, double *W,
                              void *work) {
    const size_t k = model->links;
    const double *kinetic = theta + lg_hamiltonian_kinetic_offset(model);
    work_parts w = parts_of(model, work, NULL);
    if (model->family != LG_HAMILTONIAN_CHAIN) return LG_UNSUPPORTED;
    for (size_t i = 0; m != NULL && i < k * k; i++) m[i] = mass_entry(k, kinetic, i / k, i % k);
    if (W == NULL) return LG_OK;
    invert_mass(k, kinetic, &w);
    memcpy(W, w.W, k * k * sizeof *W);
    return LG_OK;
}

/* Fills W, wp = W p, u, and lambda = (W o G)^-1 u of the chain's kinetic energy on the manifold. */
static void kinetic_parts(size_t k, const double *kinetic, const double *y, work_parts *w) {
    invert_mass(k, kinetic, w);
    for (size_t i = 0; i < k; i++) {
        for (int c = 0; c < 3; c++) {
            double sum = 0.0;
            for (size_t j = 0; j < k; j++) sum += w->W[i * k + j] * y[6 * j + 3 + c];
            w->wp[3 * i + c] = sum;
        }
        w->lambda[i] = w->u[i] = lg_dot3(y + 6 * i, w->wp + 3 * i);
        for (size_t l = 0; l < k; l++) w->S[i * k + l] = w->W[i * k + l] * lg_dot3(y + 6 * i, y + 6 * l);
    }
    factor(k, w->S);
    solve(k, w->S, w->lambda);
}

static const double *positions(const lg_hamiltonian *model, const double *y, work_parts *w) {
    if (model->family == LG_HAMILTONIAN_SEPARABLE) return y;
    for (size_t i = 0; i < model->links; i++) memcpy(w->q + 3 * i, y + 6 * i, 3 * sizeof(double));
    return w->q;
}

/* 1/2 p^T (W p) less what the constraints take, from kinetic_parts. */
static double chain_energy(size_t k, const double *y, const work_parts *w) {
    double energy = 0.0;
    for (size_t i = 0; i < k; i++)
        energy += 0.5 * (lg_dot3(y + 6 * i + 3, w->wp + 3 * i) - w->u[i] * w->lambda[i]);
    return energy;
}

/* row i of A p */
static double times_row(size_t n, const double *a, size_t i, const double *p) {
    double sum = 0.0;
    for (size_t j = 0; j < n; j++) sum += a[i * n + j] * p[j];
    return sum;
}

double lg_hamiltonian_value(const lg_hamiltonian *model, const double *theta, const double *state,
                            void *work) {
    work_parts w = parts_of(model, work, NULL);
    const size_t k = model->links;
    const double *kinetic = theta + lg_hamiltonian_kinetic_offset(model);
    double potential, energy = 0.0;
    lg_mlp_eval(&model->net, LG_F64, theta, positions(model, state, &w), 1, &potential, w.net);
    if (model->family == LG_HAMILTONIAN_SEPARABLE) {
        for (size_t i = 0; i < k; i++) {
            const double ap = times_row(k, kinetic, i, state + k);
            energy += 0.5 * ap * ap;
        }
        return energy + potential;
    }
    kinetic_parts(k, kinetic, state, &w);
    return chain_energy(k, state, &w) + potential;
}

/* Chain, with w->g = dV/dq: w->v = dT/dp, and dT/dq is added to w->g, both (k, 3). Returns T. */
static double chain_kinetic(const lg_hamiltonian *model, const double *theta, const double *y,
                            work_parts *w) {
    const size_t k = model->links;
    kinetic_parts(k, theta + lg_hamiltonian_kinetic_offset(model), y, w);
    for (size_t i = 0; i < k; i++)
        for (int c = 0; c < 3; c++) {
            double sum = 0.0;
            for (size_t j = 0; j < k; j++)
                sum += w->W[i * k + j] * (y[6 * j + 3 + c] - w->lambda[j] * y[6 * j + c]);
            w->v[3 * i + c] = sum;
            w->g[3 * i + c] -= w->lambda[i] * sum;
        }
    return chain_energy(k, y, w);
}

/* Chain: w->v = dH/dp, w->g = dH/dq, both (k, 3). Returns H. */
static double chain_gradient(const lg_hamiltonian *model, const double *theta, const double *y,
                             work_parts *w) {
    double potential;
    lg_mlp_input_gradient(&model->net, LG_F64, theta, positions(model, y, w), 1, NULL, &potential, w->g,
                          w->net);
    return chain_kinetic(model, theta, y, w) + potential;
}

/* Separable: A^T A p -> out, with |A p|^2/2 returned. w->u = A p. */
static double separable_velocity(const lg_hamiltonian *model, const double *theta, const double *p,
                                 double *out, work_parts *w) {
    const size_t n = model->links;
    const double *a = theta + lg_hamiltonian_kinetic_offset(model);
    double energy = 0.0;
    for (size_t i = 0; i < n; i++) w->u[i] = times_row(n, a, i, p);
    for (size_t i = 0; i < n; i++) energy += 0.5 * w->u[i] * w->u[i];
    for (size_t j = 0; j < n; j++) {
        out[j] = 0.0;
        for (size_t i = 0; i < n; i++) out[j] += a[i * n + j] * w->u[i];
    }
    return energy;
}

/* Separable: dV/dq -> g_q, A^T A p -> g_p. Returns H. */
static double separable_gradient(const lg_hamiltonian *model, const double *theta, const double *y,
                                 double *g_q, double *g_p, work_parts *w) {
    double potential;
    lg_mlp_input_gradient(&model->net, LG_F64, theta, y, 1, NULL, &potential, g_q, w->net);
    return separable_velocity(model, theta, y + model->links, g_p, w) + potential;
}

void lg_hamiltonian_force(const lg_hamiltonian *model, const double *theta, const double *q, double *out,
                          void *work) {
    const work_parts w = parts_of(model, work, NULL);
    lg_mlp_input_gradient(&model->net, LG_F64, theta, q, 1, NULL, NULL, out, w.net);
    for (size_t i = 0; i < model->links; i++) out[i] = -out[i];
}

void lg_hamiltonian_velocity(const lg_hamiltonian *model, const double *theta, const double *p, double *out,
                             void *work) {
    work_parts w = parts_of(model, work, NULL);
    (void)separable_velocity(model, theta, p, out, &w);
}

/* g and v, (k, 3), to where they stand in the state's layout. */
static void interleave(size_t k, const double *g, const double *v, double *out) {
    for (size_t i = 0; i < k; i++) {
        memcpy(out + 6 * i, g + 3 * i, 3 * sizeof(double));
        memcpy(out + 6 * i + 3, v + 3 * i, 3 * sizeof(double));
    }
}

double lg_hamiltonian_gradient(const lg_hamiltonian *model, const double *theta, const double *state,
                               double *gradient, void *work) {
    work_parts w = parts_of(model, work, NULL);
    if (model->family == LG_HAMILTONIAN_SEPARABLE)
        return separable_gradient(model, theta, state, gradient, gradient + model->links, &w);
    const double energy = chain_gradient(model, theta, state, &w);
    interleave(model->links, w.g, w.v, gradient);
    return energy;
}

double lg_hamiltonian_jvp(const lg_hamiltonian *model, const double *theta, const double *state,
                          const double *tangent, void *work) {
    work_parts w = parts_of(model, work, NULL);
    const size_t k = model->links;
    double sum = 0.0;
    if (model->family == LG_HAMILTONIAN_SEPARABLE) {
        (void)separable_gradient(model, theta, state, w.g, w.v, &w);
        for (size_t i = 0; i < k; i++) sum += w.g[i] * tangent[i] + w.v[i] * tangent[k + i];
        return sum;
    }
    (void)chain_gradient(model, theta, state, &w);
    for (size_t i = 0; i < k; i++)
        sum += lg_dot3(w.g + 3 * i, tangent + 6 * i) + lg_dot3(w.v + 3 * i, tangent + 6 * i + 3);
    return sum;
}

void lg_hamiltonian_field(const lg_hamiltonian *model, const double *theta, const double *state,
                          double *field, void *work) {
    work_parts w = parts_of(model, work, NULL);
    const size_t n = model->links;
    if (model->family == LG_HAMILTONIAN_SEPARABLE) {
        (void)separable_gradient(model, theta, state, w.g, field, &w);
        for (size_t i = 0; i < n; i++) field[n + i] = -w.g[i];
        return;
    }
    (void)chain_gradient(model, theta, state, &w);
    for (size_t i = 0; i < n; i++) {
        double gq[3], vp[3];
        lg_cross3(w.g + 3 * i, state + 6 * i, gq);
        lg_cross3(w.v + 3 * i, state + 6 * i + 3, vp);
        lg_cross3(state + 6 * i, w.v + 3 * i, field + 6 * i);
        for (int c = 0; c < 3; c++) field[6 * i + 3 + c] = gq[c] + vp[c];
    }
}

/* ---- second derivatives ---- */

/* Memory of a directional derivative of the gradient: its own arrays first, then the gradient's. */
typedef struct second_parts {
    work_parts w;
    double *dq, *dg, *dv; /* (inputs), (inputs) and (k, 3): directions gathered, derivatives of w.g and w.v */
    double *dlambda;      /* (k) */
} second_parts;

static second_parts second_parts_of(const lg_hamiltonian *model, void *work, size_t *bytes) {
    const size_t k = model->links, inputs = model->net.width[0];
    size_t at = 0, rest;
    const size_t dq = cut(&at, inputs), dg = cut(&at, inputs), dv = cut(&at, 3 * k), dlambda = cut(&at, k);
    double *base = work;
    const work_parts w = parts_of(model, base == NULL ? NULL : base + at, &rest);
    if (bytes != NULL) *bytes = at * sizeof(double) + rest;
    if (base == NULL) return (second_parts){.dq = NULL};
    return (second_parts){w, base + dq, base + dg, base + dv, base + dlambda};
}

size_t lg_hamiltonian_hessian_work_size(const lg_hamiltonian *model) {
    size_t bytes;
    (void)second_parts_of(model, NULL, &bytes);
    return bytes + lg_mlp_hessian_work_size(&model->net, 1, LG_F64);
}

/* dlambda from d of (W o G) lambda = u: (W o G) dlambda = du - (W o dG) lambda, with du_i = dq_i.(W p)_i +
 * q_i.(W dp)_i and dG_il = dq_i.q_l + q_i.dq_l. w.S holds the factor of W o G. */
static void multiplier_tangent(size_t k, const double *y, const double *dy, second_parts *s) {
    const work_parts *w = &s->w;
    for (size_t i = 0; i < k; i++) {
        const double *q = y + 6 * i, *dq = dy + 6 * i;
        double sum = lg_dot3(dq, w->wp + 3 * i);
        for (size_t l = 0; l < k; l++) {
            const double dG = lg_dot3(dq, y + 6 * l) + lg_dot3(q, dy + 6 * l);
            sum += w->W[i * k + l] * (lg_dot3(q, dy + 6 * l + 3) - w->lambda[l] * dG);
        }
        s->dlambda[i] = sum;
    }
    solve(k, w->S, s->dlambda);
}

/* s->dv = d(dH/dp); d(dT/dq_i) = -dlambda_i v_i - lambda_i dv_i is added to s->dg = d(dV/dq). */
static void chain_tangent(size_t k, const double *y, const double *dy, second_parts *s) {
    const work_parts *w = &s->w;
    multiplier_tangent(k, y, dy, s);
    for (size_t i = 0; i < k; i++)
        for (size_t c = 0; c < 3; c++) {
            double sum = 0.0;
            for (size_t j = 0; j < k; j++)
                sum += w->W[i * k + j] *
                       (dy[6 * j + 3 + c] - s->dlambda[j] * y[6 * j + c] - w->lambda[j] * dy[6 * j + c]);
            s->dv[3 * i + c] = sum;
            s->dg[3 * i + c] -= s->dlambda[i] * w->v[3 * i + c] + w->lambda[i] * sum;
        }
}

void lg_hamiltonian_gradient_jvp(const lg_hamiltonian *model, const double *theta, const double *state,
                                 const double *tangent, double *gradient, double *dgradient, void *work) {
    second_parts s = second_parts_of(model, work, NULL);
    const size_t k = model->links;
    if (model->family == LG_HAMILTONIAN_SEPARABLE) {
        lg_mlp_hessian_vector(&model->net, LG_F64, theta, state, tangent, 1, NULL, gradient, dgradient,
                              s.w.net);
        if (gradient != NULL) (void)separable_velocity(model, theta, state + k, gradient + k, &s.w);
        (void)separable_velocity(model, theta, tangent + k, dgradient + k, &s.w);
        return;
    }
    for (size_t i = 0; i < k; i++) memcpy(s.dq + 3 * i, tangent + 6 * i, 3 * sizeof(double));
    lg_mlp_hessian_vector(&model->net, LG_F64, theta, positions(model, state, &s.w), s.dq, 1, NULL, s.w.g,
                          s.dg, s.w.net);
    (void)chain_kinetic(model, theta, state, &s.w);
    chain_tangent(k, state, tangent, &s);
    if (gradient != NULL) interleave(k, s.w.g, s.w.v, gradient);
    interleave(k, s.dg, s.dv, dgradient);
}
