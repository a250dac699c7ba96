/* Measures of trajectories and of the Hamiltonian that was learned from them, and warnings about both, which
 * go to the context's log. */
#ifndef LG_HAMILTONIAN_LEARNED_H
#define LG_HAMILTONIAN_LEARNED_H

#include "liegrad/hamiltonian.h"
#include "liegrad/model.h"

/* Makes the model with these parameters; the caller destroys it. */
lg_status lg_hamiltonian_learned(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                                 lg_model **out, lg_error *error);
/* The mean squared error of the prediction that every point of a trajectory equals its first point. */
double lg_hamiltonian_unchanged(const lg_hamiltonian_problem *problem);
/* The trajectories without exact copies of another one: writes their indices to `out`, which has room for
 * all, and their number to *count. */
lg_status lg_hamiltonian_different(const lg_context *context, const lg_hamiltonian_problem *problem,
                                   size_t *out, size_t *count);

/* Whether the loss is at most 3 times the floor. */
bool lg_is_near_floor(double loss, double floor);
/* Warns if the loss is near the floor: names both and suggests what to change. If the error is large, a
 * mirror symmetry of the model is named as a possible cause. */
void lg_hamiltonian_warn_of_floor(const lg_context *context, const lg_hamiltonian_problem *problem,
                                  double loss, double floor);
/* Warns if the data do not conserve the first integral of the penalty. */
lg_status lg_hamiltonian_warn_of_integral(const lg_context *context, const lg_hamiltonian_problem *problem);
/* Warns if the data do not conserve the momentum of the model's symmetry. */
lg_status lg_hamiltonian_warn_of_symmetry(const lg_context *context, const lg_hamiltonian_problem *problem);
/* Warns if the learned energy changes along the data in a way that no conservative system allows; or if
 * training has converged, but the errors of the model are not noise. Says nothing if the data do not conserve
 * the momentum of the model's symmetry, because then the model must be wrong. */
lg_status lg_hamiltonian_warn_of_drift(const lg_context *context, const lg_hamiltonian_problem *problem,
                                       const lg_fit *fit, const double *theta, double loss, double floor,
                                       lg_error *error);
/* Warns if nothing moves, if trajectories repeat others, or if there are more parameters than numbers in the
 * data. */
lg_status lg_hamiltonian_warn_of_data(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      const char *path);
/* Warns if the data have inputs: learned systems are autonomous and do not use them. */
void lg_warn_of_inputs(const lg_context *context, const char *path, const lg_trajectories *data);

#endif
