/* Linearisation of the field of a learned Hamiltonian or machine in coordinates of the tangent space.
 *
 * With y' = f(y, u) in ambient coordinates, basis (d, r) and C its coordinates, C basis = I:
 *   A = C df/dy basis,  B = C df/du.
 */
#include <string.h>

#include "core/core.h"
#include "models/model_internal.h"

size_t lg_model_tangent_dim(const lg_model *model) {
    return lg_model_moves(model) ? model->motion.tangent : 0;
}

/* Arrays that follow the plans' work, in doubles. */
typedef struct linear_parts {
    double *zeros;    /* (m): no input */
    double *jx, *ju;  /* (d, d), (d, m) */
    double *basis;    /* (d, r) */
    double *velocity; /* (d) */
    double *c;        /* (r) */
} linear_parts;

static linear_parts parts_of(const lg_model *model, void *work, size_t *doubles) {
    const size_t d = model->inputs, m = lg_model_input_dim(model), r = lg_model_tangent_dim(model);
    const size_t sizes[] = {m, d * d, d * m, d * r, d, r};
    double *at[LG_COUNT(sizes)] = {NULL};
    *doubles = 0;
    for (size_t i = 0; i < LG_COUNT(sizes); i++) {
        if (work != NULL) at[i] = (double *)(void *)((char *)work + model->plan_work) + *doubles;
        *doubles += sizes[i];
    }
    return (linear_parts){at[0], at[1], at[2], at[3], at[4], at[5]};
}

size_t lg_model_linear_work_size(const lg_model *model) {
    size_t doubles;
    (void)parts_of(model, NULL, &doubles);
    return doubles * sizeof(double);
}

const double *lg_model_no_input(const lg_model *model, void *work) {
    size_t doubles;
    double *zeros = parts_of(model, work, &doubles).zeros;
    memset(zeros, 0, lg_model_input_dim(model) * sizeof *zeros);
    return zeros;
}

/* out (r, columns) = C matrix (d, columns) */
static void to_coordinates(const lg_model *model, const double *state, const double *matrix, size_t columns,
                           const linear_parts *w, double *out) {
    const size_t d = model->inputs, r = lg_model_tangent_dim(model);
    for (size_t j = 0; j < columns; j++) {
        for (size_t i = 0; i < d; i++) w->velocity[i] = matrix[i * columns + j];
        model->motion.coordinates(model, state, w->velocity, w->c);
        for (size_t i = 0; i < r; i++) out[i * columns + j] = w->c[i];
    }
}

/* A = C jx basis, column by column. */
static void fill_A(const lg_model *model, const double *state, const linear_parts *w, double *A) {
    const size_t d = model->inputs, r = lg_model_tangent_dim(model);
    for (size_t j = 0; j < r; j++) {
        for (size_t i = 0; i < d; i++) {
            double sum = 0.0;
            for (size_t k = 0; k < d; k++) sum += w->jx[i * d + k] * w->basis[k * r + j];
            w->velocity[i] = sum;
        }
        model->motion.coordinates(model, state, w->velocity, w->c);
        for (size_t i = 0; i < r; i++) A[i * r + j] = w->c[i];
    }
}

lg_status lg_model_linearise(const lg_model *model, const double *state, const double *input, double *A,
                             double *B, double *basis, void *work) {
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    const size_t d = model->inputs, m = lg_model_input_dim(model), r = lg_model_tangent_dim(model);
    size_t doubles;
    const linear_parts w = parts_of(model, work, &doubles);
    const double *const x[] = {state, input != NULL ? input : lg_model_no_input(model, work)};
    double *const y[] = {A != NULL ? w.jx : NULL, m > 0 && B != NULL ? w.ju : NULL};
    lg_model_run(model, LG_MODEL_LINEAR, x, y, work);
    model->motion.basis(model, state, w.basis);
    if (A != NULL) fill_A(model, state, &w, A);
    if (B != NULL) to_coordinates(model, state, w.ju, m, &w, B);
    if (basis != NULL) memcpy(basis, w.basis, d * r * sizeof *basis);
    return LG_OK;
}

lg_status lg_model_deviation(const lg_model *model, const double *state, const double *other, double *c,
                             void *work) {
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    size_t doubles;
    const linear_parts w = parts_of(model, work, &doubles);
    for (size_t i = 0; i < model->inputs; i++) w.velocity[i] = other[i] - state[i];
    model->motion.coordinates(model, state, w.velocity, c);
    return LG_OK;
}
