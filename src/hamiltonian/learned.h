/* What is told of trajectories and of a Hamiltonian that was learned from them. Sentences go to the context's
 * log as warnings. */
#ifndef LG_HAMILTONIAN_LEARNED_H
#define LG_HAMILTONIAN_LEARNED_H

#include "liegrad/hamiltonian.h"
#include "liegrad/io.h"
#include "liegrad/model.h"

/* The model with these parameters; the caller destroys it. */
lg_status lg_hamiltonian_learned(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                                 lg_model **out, lg_error *error);
/* The mean squared error of the prediction that nothing changes: each point is the first one. */
double lg_hamiltonian_unchanged(const lg_hamiltonian_problem *problem);
/* The trajectories without those that repeat another one, all numbers alike: their indices (room for all) and
 * how many. */
lg_status lg_hamiltonian_different(const lg_context *context, const lg_hamiltonian_problem *problem,
                                   size_t *out, size_t *count);

/* Within 3 times the floor. */
bool lg_is_near_floor(double loss, double floor);
/* When the loss is near the floor: which loss, which floor, and what to change. */
void lg_hamiltonian_warn_of_floor(const lg_context *context, const lg_hamiltonian_problem *problem,
                                  double loss, double floor);
/* When the first integral of the penalty drifts along the data. */
lg_status lg_hamiltonian_warn_of_integral(const lg_context *context, const lg_hamiltonian_problem *problem,
                                          const double *theta, lg_error *error);
/* Where the learned energy changes along the data as the energy of no conservative system does, and where the
 * model at its least loss leaves errors that are not noise. */
lg_status lg_hamiltonian_warn_of_drift(const lg_context *context, const lg_hamiltonian_problem *problem,
                                       const lg_fit *fit, const double *theta, double loss, double floor,
                                       lg_error *error);
/* When nothing moves, when trajectories repeat others, and when the data have fewer numbers than there are
 * parameters. */
lg_status lg_hamiltonian_warn_of_data(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      const char *path);
/* Learned systems are autonomous: when the data come with inputs. */
void lg_warn_of_inputs(const lg_context *context, const char *path, const lg_trajectories *data);

#endif
