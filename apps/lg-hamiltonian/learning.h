/* What the commands of lg-hamiltonian share: sampling a scene, judging, drawing. Functions that
 * return a status explain a failure in `error`. */
#ifndef LG_APPS_LEARNING_H
#define LG_APPS_LEARNING_H

#include "common/app.h"
#include "common/train.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/io.h"
#include "liegrad/mechanics.h"
#include "liegrad/model.h"

extern const app_command generate_command, train_command, evaluate_command, predict_command, study_command,
    demo_command;

/* ---- sampling (sample.c) ---- */

/* Family and n of what is learned from a scene that was read in FORM. Errors: LG_UNSUPPORTED. */
#define FORM "hamiltonian"
lg_status scene_family(const lg_scene *scene, const lg_hamiltonian_family **family, uint32_t *n,
                       lg_error *error);

typedef struct sampling {
    size_t trajectories, points; /* N, M */
    double t_end, noise;
    lg_noise noise_kind;
    bool noise_first;
    uint64_t seed;
} sampling;
/* Trajectories of the scene's system from random starts as the scene's `starts` say; energies of the starts
 * included. The caller frees. */
/* Room for all trajectories, and their times; then a part of them, from any thread. */
lg_status sample_create(const lg_context *context, const lg_scene *scene, const sampling *how,
                        lg_trajectories *out, lg_error *error);
lg_status sample_part(const lg_context *context, const lg_scene *scene, const sampling *how, size_t first,
                      size_t count, lg_trajectories *data, lg_error *error);
/* Both at once. */
lg_status sample_scene(const lg_context *context, const lg_scene *scene, const sampling *how,
                       lg_trajectories *out, lg_error *error);
/* ---- judging (judge.c) ---- */

/* Tolerance, relative to each number and to its group, of the adaptive reference integrators: 1e-10, and
 * 1e-13 for linear potentials, whose E1 may be 1e-17 and less. */
double default_tolerance(const lg_hamiltonian *model);
/* The learned flow from `start` at the given times: out (count, d), energy (count) of the learned Hamiltonian
 * along it, or NULL; stats may be NULL. */
lg_status learned_flow(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                       double tolerance, const double *start, const double *times, size_t count, double *out,
                       double *energy, lg_run_stats *stats, lg_error *error);

typedef struct verdict {
    double e1, e2; /* e2 is NaN when the energies of the starts are unknown */
    double relative, relative_worst;
} verdict;
/* E1: mean over trajectories, coordinates and points, the first included, of the squared difference; both
 * flows integrated accurately. E2: mean |d - mean d|, d = H - H_Theta at the starts. `predicted` (N, M, d)
 * may be NULL. */
lg_status judge(const lg_context *context, uint64_t threads, const lg_hamiltonian *model, const double *theta,
                const lg_trajectories *test, double tolerance, double *predicted, verdict *out,
                lg_error *error);
/* Relative errors r = |z - z'|/|z + z'| + 1e-8 of what is seen (lg_system_observe) of given and predicted
 * states: the geometric mean over all points, the first included, into `relative`; the largest geometric mean
 * of a trajectory into `relative_worst`. test->truth must be known. Errors: those of lg_system_observe. */
lg_status judge_relative(const lg_trajectories *test, const double *predicted, verdict *out, lg_error *error);
/* Writes a finite verdict and what the test set was into the model file at `path`, which holds this run and
 * theta; all else in it stays. */
lg_status record_verdict(const lg_context *context, const char *path, const lg_hamiltonian_run *run,
                         double *theta, const lg_trajectories *test, const verdict *result, lg_error *error);

/* ---- drawing (pictures.c) ---- */

/* Each reports where the picture went; a missing gnuplot is only a warning. */
/* True (may be NULL) and predicted (n, points, d) at times t (points): links on the sphere in space; of one
 * degree of freedom the phase portrait, q and p against t; else q_1 against q_2. `title` holds no quotes. */
enum { SHOWN_TRAJECTORIES = 10 }; /* unless more are asked for */
lg_status draw_trajectories(const app *app, const char *picture, const char *title,
                            const lg_hamiltonian *model, const double *t, const double *truth,
                            const double *predicted, size_t n, size_t points, lg_error *error);
/* |H - H(0)| of the true energy (may be NULL) and of the learned one along one prediction, in units of
 * m = L = g = 1. */
lg_status draw_energy(const app *app, const char *picture, const double *t, const double *true_energy,
                      const double *learned_energy, size_t count, lg_error *error);

#endif
