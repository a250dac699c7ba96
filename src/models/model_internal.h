/* Inside of lg_model_*: what it asks of surrogates and detectors, sizes, value and Jacobian in the caller's
 * memory, and what its own parts ask of each other.
 *
 * x, y and the rows of the Jacobian are as liegrad/model.h says for each kind; y of a Jacobian may be NULL.
 * work: *_work_size bytes, 64-byte aligned, whichever of the two is called.
 */
#ifndef LG_MODELS_MODEL_INTERNAL_H
#define LG_MODELS_MODEL_INTERNAL_H

#include "liegrad/model.h"

size_t lg_model_surrogate_inputs(const lg_surrogate *model);
size_t lg_model_surrogate_outputs(const lg_surrogate *model);
size_t lg_model_surrogate_work_size(const lg_surrogate *model);
void lg_model_surrogate_eval(const lg_surrogate *model, const double *theta, const double *x, double *y,
                             void *work);
void lg_model_surrogate_jacobian(const lg_surrogate *model, const double *theta, const double *x, double *y,
                                 double *jacobian, void *work);

size_t lg_model_detector_inputs(const lg_detector *model);
size_t lg_model_detector_outputs(const lg_detector *model);
size_t lg_model_detector_work_size(const lg_detector *model);
void lg_model_detector_eval(const lg_detector *model, const lg_scaler *scaler, const double *theta,
                            const double *x, double *y, void *work);
void lg_model_detector_jacobian(const lg_detector *model, const lg_scaler *scaler, const double *theta,
                                const double *x, double *y, double *jacobian, void *work);

/* A branch of ReLU or a maximum would hide an input that is not finite: results y (n) of such an x become NaN
 * as a whole. */
void lg_model_mark_unfit(const lg_model *model, const double *x, size_t n, double *y);

/* Memory of lg_model_linearise, enough for every other function about a Hamiltonian. */
size_t lg_model_linear_work_size(const lg_hamiltonian *model);
bool lg_model_is_hamiltonian(const lg_model *model);

#endif
