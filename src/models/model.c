/* Models in a loop: one handle for all kinds, and what each kind is a function of. */
#include "liegrad/model.h"

#include "core/core.h"
#include "models/model_internal.h"

/* ---- Hamiltonians: state -> H ---- */

static size_t hamiltonian_parameters(const lg_model *m) {
    return lg_hamiltonian_parameters(&m->hamiltonian);
}

static size_t hamiltonian_inputs(const lg_model *m) {
    return lg_hamiltonian_state_size(&m->hamiltonian);
}

static size_t hamiltonian_outputs(const lg_model *m) {
    (void)m;
    return 1;
}

static size_t hamiltonian_work(const lg_model *m) {
    return lg_model_linear_work_size(&m->hamiltonian);
}

static void hamiltonian_eval(const lg_model *m, const double *x, double *y, void *work) {
    *y = lg_hamiltonian_value(&m->hamiltonian, m->theta, x, work);
}

static void hamiltonian_jacobian(const lg_model *m, const double *x, double *y, double *jacobian,
                                 void *work) {
    const double value = lg_hamiltonian_gradient(&m->hamiltonian, m->theta, x, jacobian, work);
    if (y != NULL) *y = value;
}

/* ---- surrogates ---- */

static size_t surrogate_parameters(const lg_model *m) {
    return lg_surrogate_parameters(&m->surrogate);
}

static size_t surrogate_inputs(const lg_model *m) {
    return lg_model_surrogate_inputs(&m->surrogate);
}

static size_t surrogate_outputs(const lg_model *m) {
    return lg_model_surrogate_outputs(&m->surrogate);
}

static size_t surrogate_work(const lg_model *m) {
    return lg_model_surrogate_work_size(&m->surrogate);
}

static void surrogate_eval(const lg_model *m, const double *x, double *y, void *work) {
    lg_model_surrogate_eval(&m->surrogate, m->theta, x, y, work);
}

static void surrogate_jacobian(const lg_model *m, const double *x, double *y, double *jacobian, void *work) {
    lg_model_surrogate_jacobian(&m->surrogate, m->theta, x, y, jacobian, work);
}

/* ---- detectors ---- */

static size_t detector_parameters(const lg_model *m) {
    return lg_cnn_parameters(&m->detector.net);
}

static size_t detector_inputs(const lg_model *m) {
    return lg_model_detector_inputs(&m->detector);
}

static size_t detector_outputs(const lg_model *m) {
    return lg_model_detector_outputs(&m->detector);
}

static size_t detector_work(const lg_model *m) {
    return lg_model_detector_work_size(&m->detector);
}

static void detector_eval(const lg_model *m, const double *x, double *y, void *work) {
    lg_model_detector_eval(&m->detector, &m->scaler, m->theta, x, y, work);
}

static void detector_jacobian(const lg_model *m, const double *x, double *y, double *jacobian, void *work) {
    lg_model_detector_jacobian(&m->detector, &m->scaler, m->theta, x, y, jacobian, work);
}

/* ---- any of them ---- */

typedef struct kind_row {
    size_t (*parameters)(const lg_model *model);
    size_t (*inputs)(const lg_model *model);
    size_t (*outputs)(const lg_model *model);
    size_t (*work)(const lg_model *model);
    void (*eval)(const lg_model *model, const double *x, double *y, void *work);
    void (*jacobian)(const lg_model *model, const double *x, double *y, double *jacobian, void *work);
} kind_row;

#define ROW(kind)                                                                                            \
    { kind##_parameters, kind##_inputs, kind##_outputs, kind##_work, kind##_eval, kind##_jacobian }
static const kind_row rows[LG_MODEL_KIND_COUNT] = {
    [LG_MODEL_HAMILTONIAN] = ROW(hamiltonian),
    [LG_MODEL_SURROGATE] = ROW(surrogate),
    [LG_MODEL_DETECTOR] = ROW(detector),
};

static bool known(const lg_model *model) {
    return model != NULL && (unsigned)model->kind < LG_MODEL_KIND_COUNT;
}

size_t lg_model_parameters(const lg_model *model) {
    return known(model) ? rows[model->kind].parameters(model) : 0;
}

size_t lg_model_inputs(const lg_model *model) {
    return known(model) ? rows[model->kind].inputs(model) : 0;
}

size_t lg_model_outputs(const lg_model *model) {
    return known(model) ? rows[model->kind].outputs(model) : 0;
}

size_t lg_model_work_size(const lg_model *model) {
    return known(model) ? rows[model->kind].work(model) : 0;
}

void lg_model_mark_unfit(const lg_model *model, const double *x, size_t n, double *y) {
    const size_t inputs = lg_model_inputs(model);
    double mark = 0.0;
    for (size_t i = 0; i < inputs; i++) mark += 0.0 * x[i];
    for (size_t i = 0; i < n; i++) y[i] += mark;
}

void lg_model_eval(const lg_model *model, const double *x, double *y, void *work) {
    rows[model->kind].eval(model, x, y, work);
    lg_model_mark_unfit(model, x, lg_model_outputs(model), y);
}

void lg_model_jacobian(const lg_model *model, const double *x, double *y, double *jacobian, void *work) {
    const size_t outputs = lg_model_outputs(model);
    rows[model->kind].jacobian(model, x, y, jacobian, work);
    lg_model_mark_unfit(model, x, outputs * lg_model_inputs(model), jacobian);
    if (y != NULL) lg_model_mark_unfit(model, x, outputs, y);
}
