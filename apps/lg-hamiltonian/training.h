/* Declarations that the commands of lg-hamiltonian share: sampling a scene, judging, drawing. Functions that
 * return a status explain a failure in `error`. */
#ifndef LG_APPS_LEARNING_H
#define LG_APPS_LEARNING_H

#include "common/train.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"

extern const app_command hamiltonian_generate_command, hamiltonian_evaluate_command,
    hamiltonian_predict_command, hamiltonian_study_command;

/* ---- sampling (generate.c) ---- */

/* Family and number of copies n of the Hamiltonian that is learned for a scene. The scene must have been read
 * with the form FORM. LG_UNSUPPORTED: such a system cannot be learned. */
#define FORM "hamiltonian"
lg_status scene_family(const lg_scene *scene, const lg_hamiltonian_family **family, uint32_t *n,
                       lg_error *error);

/* The options of lg_system_generate that the scene gives; NULL: the defaults. */
lg_trajectory_options sample_options(const lg_scene *scene);
/* Samples trajectories of the scene's system, with the energies of the starts. */
lg_status sample_scene(const lg_context *context, const lg_scene *scene, const lg_trajectory_options *how,
                       lg_trajectories *out, lg_error *error);
/* ---- judging (judge.c) ---- */

/* Default tolerance of the adaptive integration of the learned flow, used for rtol and atol as in app_flow.
 * It is 1e-10, and 1e-13 for LG_POTENTIAL_LINEAR, whose error E1 may be 1e-17 or less. */
double default_tolerance(const lg_hamiltonian *model);
/* Projects the points of a flow (count, d) onto the constraint of the model, if it has one. The integration
 * in R^2n leaves it by about the tolerance. */
lg_status land(const lg_hamiltonian *model, size_t count, double *y, lg_error *error);
/* H_Theta at `count` states; consecutive states are `stride` numbers apart. */
void energies_of(const lg_model *learned, const double *states, size_t count, size_t stride, double *out);

typedef struct verdict {
    double e1, e2; /* e2 is NaN if the energies of the starts are unknown */
    double relative, relative_worst;
} verdict;
/* E1: mean of the squared difference between the test trajectories and the learned flow, over trajectories,
 * coordinates and points (the first included). E2: mean |d - mean d|, where d = H - H_Theta at the starts.
 * predicted (N, M, d) receives the learned flow. */
lg_status judge(const lg_context *context, uint64_t threads, const lg_hamiltonian *model, const double *theta,
                const lg_trajectories *test, double tolerance, double *predicted, verdict *out,
                lg_error *error);
/* Relative errors r = |z - z'|/|z + z'| + 1e-8 between given and predicted states, where z is what
 * lg_system_observe returns for a state. relative: geometric mean over all points (the first included) of all
 * trajectories; relative_worst: largest geometric mean of a single trajectory. test->truth must be known.
 * Errors as of lg_system_observe. */
lg_status judge_relative(const lg_trajectories *test, const double *predicted, verdict *out, lg_error *error);

/* ---- drawing (evaluate.c) ---- */

/* Trajectories: true (may be NULL) and predicted ones, both (n, points, d), at times t (points). Chains: each
 * link on a sphere. One degree of freedom: the phase portrait, and q and p against t. Otherwise: q_2 against
 * q_1. */
typedef struct drawn_flow {
    const char *title;
    const lg_hamiltonian *model;
    const double *t, *truth, *predicted;
    size_t n, points;
} drawn_flow;
void put_flow(app_plot *plot, const void *drawn);

#endif
