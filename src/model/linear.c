/* Linearisation of the field of a learned Hamiltonian or machine in coordinates of the tangent space.
 *
 * With y' = f(y, u) in ambient coordinates, basis (d, r) of the tangent space, and the matrix C (r, d) that
 * gives the coordinates of a vector, C basis = I:
 *   A = C df/dy basis,  B = C df/du. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "kernels/matrix.h"
#include "model/internal.h"

size_t lg_model_tangent_dim(const lg_model *model) {
    return lg_model_moves(model) ? model->space.tangent_dim : 0;
}

/* Arrays of doubles in the work memory, behind the plans' work. */
typedef struct linear_parts {
    double *zeros;    /* (m): an input of zeros */
    double *jx, *ju;  /* (d, d), (d, m): Jacobians of y' */
    double *basis;    /* (d, r): of the tangent space */
    double *moved;    /* (d, r): jx basis */
    double *velocity; /* (d + r): an ambient vector and coordinates, scratch */
    /* For lg_model_equilibrium: */
    double *at, *trial;           /* (d): state, next state */
    double *drift, *ahead, *step; /* (r): c' at the state, c' at the next state, step */
    double *A, *normal;           /* (r, r): A or the Cholesky factor, A^T A */
    size_t doubles;               /* total length */
} linear_parts;

/* Lays out the arrays behind the plans' work. A model that does not move has no arrays: it may have many
 * inputs, and (d, d) would ask for too much memory. */
static linear_parts parts_of(const lg_model *model, void *work) {
    const size_t d = lg_model_moves(model) ? model->inputs : 0, m = lg_model_input_dim(model),
                 r = lg_model_tangent_dim(model);
    linear_parts w = {.doubles = 0};
    double **const arrays[] = {&w.zeros, &w.jx,    &w.ju,    &w.basis, &w.moved, &w.velocity, &w.at,
                               &w.trial, &w.drift, &w.ahead, &w.step,  &w.A,     &w.normal};
    const size_t sizes[] = {m, d * d, d * m, d * r, d * r, d + r, d, d, r, r, r, r * r, r * r};
    for (size_t i = 0; i < LG_COUNT(sizes); w.doubles += sizes[i++])
        if (work != NULL) *arrays[i] = (double *)(void *)((char *)work + model->plan_work) + w.doubles;
    return w;
}

size_t lg_model_linear_work_size(const lg_model *model) {
    return parts_of(model, NULL).doubles * sizeof(double);
}

const double *lg_model_input(const lg_model *model, const double *input, void *work) {
    if (input != NULL) return input;
    double *zeros = parts_of(model, work).zeros;
    memset(zeros, 0, lg_model_input_dim(model) * sizeof *zeros);
    return zeros;
}

void lg_model_coordinates(const lg_model *model, const double *state, const double *matrix, size_t columns,
                          double *vector, double *out) {
    const size_t d = model->inputs, r = lg_model_tangent_dim(model);
    for (size_t j = 0; j < columns; j++) {
        for (size_t i = 0; i < d; i++) vector[i] = matrix[i * columns + j];
        lg_space_coordinates(&model->space, state, vector, vector + d);
        for (size_t i = 0; i < r; i++) out[i * columns + j] = vector[d + i];
    }
}

lg_status lg_model_linearise(const lg_model *model, const double *state, const double *input, double *A,
                             double *B, double *basis, void *work) {
    LG_NEEDS(NULL, model, state, work);
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    const size_t d = model->inputs, m = lg_model_input_dim(model), r = lg_model_tangent_dim(model);
    const linear_parts w = parts_of(model, work);
    const double *const x[] = {state, lg_model_input(model, input, work)};
    double *const y[] = {A != NULL ? w.jx : NULL, m > 0 && B != NULL ? w.ju : NULL};
    lg_model_run(model, LG_MODEL_LINEAR, x, y, work);
    lg_space_basis(&model->space, state, w.basis);
    if (A != NULL) {
        lg_matrix_multiply(d, r, d, w.jx, w.basis, w.moved);
        lg_model_coordinates(model, state, w.moved, r, w.velocity, A);
    }
    if (B != NULL) lg_model_coordinates(model, state, w.ju, m, w.velocity, B);
    if (basis != NULL) memcpy(basis, w.basis, d * r * sizeof *basis);
    return LG_OK;
}

lg_status lg_model_deviation(const lg_model *model, const double *state, const double *other, double *c,
                             void *work) {
    LG_NEEDS(NULL, model, state, other, c, work);
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    const linear_parts w = parts_of(model, work);
    for (size_t i = 0; i < model->inputs; i++) w.velocity[i] = other[i] - state[i];
    lg_space_coordinates(&model->space, state, w.velocity, c);
    return LG_OK;
}

/* ---- velocities ---- */

void lg_model_velocity(const lg_model *model, const double *state, const double *input, double *velocity,
                       double *jacobian, void *work) {
    const double *const x[] = {state, lg_model_input(model, input, work)};
    double *const y[] = {jacobian, NULL};
    double *field = parts_of(model, work).jx; /* algebra_dim <= d d, so the field fits */
    if (jacobian != NULL) lg_model_run(model, LG_MODEL_LINEAR, x, y, work);
    if (velocity == NULL) return;
    lg_model_run(model, LG_MODEL_FIELD, x, &field, work);
    lg_space_generator(&model->space, field, state, velocity);
}

void lg_model_drift(const lg_model *model, const double *state, const double *input, double *c, void *work) {
    const linear_parts w = parts_of(model, work);
    lg_model_velocity(model, state, input, w.velocity, NULL, work);
    lg_space_coordinates(&model->space, state, w.velocity, c);
}

/* ---- motion along tangent coordinates ---- */

lg_status lg_model_retract(const lg_model *model, const double *state, const double *c, double *out,
                           void *work) {
    LG_NEEDS(NULL, model, state, c, out, work);
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    const size_t d = model->inputs, r = lg_model_tangent_dim(model);
    const linear_parts w = parts_of(model, work);
    lg_space_basis(&model->space, state, w.basis);
    lg_matrix_multiply(d, 1, r, w.basis, c, w.velocity);
    lg_space_retract(&model->space, state, w.velocity, out, NULL);
    return LG_OK;
}

/* Solves (A^T A + tiny I) step = -A^T drift; A becomes the Cholesky factor. False: A is not finite. */
static bool newton_step(size_t r, const linear_parts *s) {
    double trace = 0.0;
    lg_matrix_multiply_tn(r, r, r, s->A, s->A, s->normal);
    lg_matrix_multiply_tn(r, 1, r, s->A, s->drift, s->step);
    for (size_t i = 0; i < r; i++) trace += s->normal[i * (r + 1)];
    for (size_t i = 0; i < r; i++) s->normal[i * (r + 1)] += 1e-13 * trace + 1e-300, s->step[i] = -s->step[i];
    if (!lg_matrix_cholesky(r, s->normal, s->A)) return false;
    lg_kernels_for(LG_F64)->spd_solve(1, r, 1, s->A, s->step, s->step);
    return true;
}

/* Takes the step, halved until |drift| falls. Returns false if it does not fall. */
static bool descend(const lg_model *model, const double *input, const linear_parts *s, void *work) {
    const size_t d = model->inputs, r = lg_model_tangent_dim(model);
    for (int halving = 0; halving < 40; halving++) {
        if (lg_model_retract(model, s->at, s->step, s->trial, work) != LG_OK) return false;
        lg_model_drift(model, s->trial, input, s->ahead, work);
        if (lg_matrix_norm(r, s->ahead) < lg_matrix_norm(r, s->drift)) {
            memcpy(s->at, s->trial, d * sizeof *s->at);
            memcpy(s->drift, s->ahead, r * sizeof *s->drift);
            return true;
        }
        for (size_t i = 0; i < r; i++) s->step[i] *= 0.5;
    }
    return false;
}

lg_status lg_model_equilibrium(const lg_model *model, const double *input, double *state, double *drift,
                               void *work) {
    LG_NEEDS(NULL, model, state, work);
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    const size_t d = model->inputs, r = lg_model_tangent_dim(model);
    const linear_parts s = parts_of(model, work);
    double norm = 0.0, most = 0.0;
    memcpy(s.at, state, d * sizeof *state);
    lg_model_drift(model, s.at, input, s.drift, work);
    for (int iteration = 0; iteration < 200; iteration++) {
        LG_TRY(lg_model_linearise(model, s.at, input, s.A, NULL, NULL, work));
        norm = lg_matrix_norm(r * r, s.A);
        if (!newton_step(r, &s) || !descend(model, input, &s, work)) break;
    }
    if (!(lg_matrix_norm(r, s.drift) <= 1e-9 * norm)) return LG_NO_CONVERGENCE;
    for (size_t i = 0; i < r; i++) most = fmax(most, fabs(s.drift[i]));
    memcpy(state, s.at, d * sizeof *state);
    if (drift != NULL) *drift = most;
    return LG_OK;
}
