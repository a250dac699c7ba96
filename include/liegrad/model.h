/* A trained model in a control loop: one handle for learned Hamiltonians, surrogates, detectors, tables,
 * machines and programs of your own, evaluated without a tape in the caller's memory. The library is liegrad.
 * Only lg_model_load is in liegrad_io, because it reads HDF5.
 *
 *   lg_model_file file;                                            (liegrad/io.h)
 *   lg_model_load(NULL, "pendulum.h5", NULL, &file, &error);
 *   const lg_model *model = file.model;
 *   void *work = aligned_alloc(64, lg_model_work_size(model));
 *   lg_model_eval(model, state, &energy, work);
 *
 * After the set-up nothing here allocates, locks or fails; everything is double precision. A model is
 * read-only: threads may share it, each with work memory of its own. `work`: lg_model_work_size bytes,
 * 64-byte aligned, contents irrelevant before and after; outputs must not overlap inputs or work. A
 * number of x or state that is not finite makes all of y, Jacobian and field NaN; so does a mass that is not
 * positive definite. The networks of a model that was trained in single precision are evaluated in double
 * here.
 *
 * Inputs x and outputs y of the kinds (rows of the Jacobian are outputs, columns inputs):
 *   Hamiltonian            state of its family (chain, 6k: q_1 p_1 q_2 p_2 ...; separable, 2n: q p) -> H (1)
 *   surrogate, discrete    boundary conditions (8: q0 v0 qN vN) -> inner nodes and tangents (q_1 .. q_{N-1},
 *                          v_1 .. v_{N-1}), 4(N-1)
 *   surrogate, continuous  (s, q0 v0 qN vN), 9 -> q(s), 2. Column 0 of the Jacobian is the tangent v(s).
 *   surrogate, angle       (s, q0 v0 qN vN), 9 -> theta(s), 1. Column 0 is the curvature.
 *   detector               window as recorded (channels, length) -> logits (outputs of its network)
 *   table                  a row of the input columns -> outputs in their units, or a logit a class
 *   machine                state of lg_machine_space (places; q p of each direction; R of each rotation;
 *                          momenta), in the units of the log -> H (1)
 *
 * The gradient of a Hamiltonian is that of lg_hamiltonian_record_gradient: the gradient of the extension of H
 * to the ambient space. The field of the extension gives the flow on the manifold. ReLU and max pooling have
 * the derivative of the branch that is taken.
 */
#ifndef LIEGRAD_MODEL_H
#define LIEGRAD_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/integrators.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/settings.h"

LG_BEGIN_DECLS

/* An immutable handle: a program with plans of its functions. lg_model_load makes it, or
 *
 *   lg_hamiltonian_space(hamiltonian.family, hamiltonian.n, &space);
 *   lg_hamiltonian_program(NULL, &hamiltonian, theta, NULL, &program, &error);
 *   lg_model_create(NULL, program, &space, &model, &error);
 */
typedef struct lg_model lg_model;
/* Takes the program, also where it fails; the context must outlive the model. `space`: of the states; NULL
 * where nothing moves. Functions of these names are used, those that are there (D numbers of x, which is the
 * state where there is a space; Y of y; M of u, which may be absent):
 *   value (x) -> y (Y)                          grad (x) -> y, dy/dx (Y, D)
 *   field (x, u) -> algebra element of the space
 *   jac_velocity (x, u) -> dx'/dx (D, D), dx'/du (D, M); made from field where it is missing
 *   force (q, u) -> p', drift (p) -> q', q and p of D/2: for splitting schemes
 *   momenta (q, v) -> x, positions (x) -> q, velocities (x) -> v: of machines
 * Errors: LG_NOT_FOUND (neither value nor field; a space and no field), LG_SHAPE (functions that do not fit
 * together or the space), those of lg_plan_create. */
LG_API lg_status lg_model_create(const lg_context *context, lg_program *program, const lg_space *space,
                                 lg_model **out, lg_error *error);
/* Makes a plan of any function of the program; the caller destroys the plan. Call this before a loop.
 * `options` NULL takes the default options. Errors: LG_NOT_FOUND (no such function), and the errors of
 * lg_plan_create. */
LG_API lg_status lg_model_find(const lg_model *model, const char *function, const lg_plan_options *options,
                               lg_plan **out, lg_error *error);
LG_API const lg_program *lg_model_program(const lg_model *model); /* borrowed */
LG_API void lg_model_destroy(lg_model *model);                    /* NULL is fine */

/* Where the states of a model that moves are; NULL: it does not move. */
LG_API const lg_space *lg_model_space(const lg_model *model);
LG_API size_t lg_model_parameters(const lg_model *model);
LG_API size_t lg_model_inputs(const lg_model *model);
LG_API size_t lg_model_outputs(const lg_model *model);
/* Bytes, for any of the functions below. */
LG_API size_t lg_model_work_size(const lg_model *model);
/* x (inputs) -> y (outputs) */
LG_API void lg_model_eval(const lg_model *model, const double *x, double *y, void *work);
/* y (outputs) or NULL; jacobian (outputs, inputs). */
LG_API void lg_model_jacobian(const lg_model *model, const double *x, double *y, double *jacobian,
                              void *work);

/* ---- models with a space, in a loop (without: sizes 0, LG_UNSUPPORTED) ----
 *
 * State, input and field follow from the row of the model's family (lg_hamiltonian_family). `factor` and
 * `layout` give the state, `forces` and `field` the input u and the algebra element. Tangent coordinates are
 * those of the space (lg_space_basis). Of the library's families:
 *   chain      u = (tau_1, ..., tau_k), 3k: spatial torques about the links' own joints, conjugate to their
 *              angular velocities; p_i' gets tau_i x q_i, the algebra element eta_i gets tau_i
 *   separable  u = forces (n): p' = -dV/dq + u
 *
 * Machines: the state and the algebra element are those of lg_machine_space, u are the inputs of the log; all
 * in the units of the log.
 */
LG_API size_t lg_model_input_dim(const lg_model *model); /* m = forces n; chain 3k, separable n */
/* With input (m) or NULL, which is zero: the algebra element of the space; chain (xi_i, eta_i), 6k, separable
 * (q', p'), 2n; machines (places', xi eta of each direction, R Omega of each rotation, momenta'). */
LG_API lg_status lg_model_field(const lg_model *model, const double *state, const double *input,
                                double *field, void *work);

/* The learned system for an integrator: lg_hamiltonian_space (chain (T*S^2)^k, separable R^2n) or
 * lg_machine_space, field, and force and velocity if a family has them; the stepper's `input` is u. `user`
 * (filled too), `model` and `work` (lg_model_work_size bytes) must outlive the use of `ode`.
 * LG_INVALID_ARGUMENT: user or ode NULL. */
typedef struct lg_model_user {
    const lg_model *model;
    void *work;
} lg_model_user;
LG_API lg_status lg_model_ode(const lg_model *model, lg_ode *ode, lg_model_user *user, void *work);

/* Puts the learned system and a scheme into one piece of the caller's memory: 64-byte aligned,
 * lg_model_stepper_size bytes. lg_step(stepper, t, h, state, input, next) then makes a step; it stays on the
 * manifold and neither allocates nor locks. `model` and `scheme` must outlive the stepper. There is nothing
 * to destroy. Errors:
 * - LG_UNSUPPORTED, and size 0: classical schemes on a space other than R^d (they leave the manifold),
 *   splitting schemes for a family without force and drift, variational schemes, slgi where the space is
 *   not SE(3) x R^2m
 * - LG_INVALID_ARGUMENT: as lg_stepper_init; the scheme is checked before the memory */
LG_API size_t lg_model_stepper_size(const lg_model *model, const lg_scheme *scheme);
LG_API lg_status lg_model_stepper_init(const lg_model *model, const lg_scheme *scheme, lg_stepper **out,
                                       void *memory, size_t bytes);

/* ---- linearisation, for LQR, a filter, an observer ----
 *
 * Coordinates c (r) of states near y: y + basis c to first order, with the basis of lg_space_basis. On R^n,
 * where separable systems and places and momenta of machines are, c is dy. A chain has r = 4k: for link i,
 * c_i = (a_1, a_2, b_1, b_2) as on T*S^2. Coordinates of machines are in the order of the state: 4 of each
 * direction, 3 of each rotation, a rotation vector in the body.
 */
LG_API size_t lg_model_tangent_dim(const lg_model *model); /* r */
/* c' = A c + B du to first order at (state, input), with the frames e_1, e_2 and R held fixed (at an
 * equilibrium this neglects nothing). A (r, r), B (r, m), basis (d, r); each may be NULL; input (m) may be
 * NULL, which is zero. The derivatives of the field are exact: they use second derivatives of the network,
 * not differences. */
LG_API lg_status lg_model_linearise(const lg_model *model, const double *state, const double *input,
                                    double *A, double *B, double *basis, void *work);
/* The coordinates c (r) of `other` - `state` (lg_space_coordinates); for chains in the frame at `state`. Of
 * rotations S = other and R = state it is 1/2 vee(R^T S - S^T R): the axis times the sine of the angle. */
LG_API lg_status lg_model_deviation(const lg_model *model, const double *state, const double *other,
                                    double *c, void *work);

/* out: the state that a step along c (r) leads to from `state`: lg_space_retract of basis c. It is on the
 * manifold, and its deviation is c to first order; on R^d it is state + c. `out` may be `state`. */
LG_API lg_status lg_model_retract(const lg_model *model, const double *state, const double *c, double *out,
                                  void *work);
/* Moves `state` (in/out) to the nearest place where it stays under `input` (NULL: zero): Newton's method for
 * c' = 0, damped, where several directions are free the shortest step. *drift (may be NULL): the largest
 * |c'_i| left. LG_NO_CONVERGENCE: |c'| stays above 1e-9 |A|_F; `state` is then as before. */
LG_API lg_status lg_model_equilibrium(const lg_model *model, const double *input, double *state,
                                      double *drift, void *work);

/* ---- machines: states and what a log has (other kinds: LG_UNSUPPORTED) ----
 *
 * Positions and velocities in the order and units of the log (liegrad/machine.h): positions of each
 * coordinate (R row-major), velocities of each coordinate. The state has momenta instead of velocities. */
LG_API lg_status lg_model_machine_state(const lg_model *model, const double *positions,
                                        const double *velocities, double *state, void *work);
LG_API lg_status lg_model_machine_velocities(const lg_model *model, const double *state, double *velocities,
                                             void *work);
LG_API lg_status lg_model_machine_positions(const lg_model *model, const double *state, double *positions,
                                            void *work);

/* ---- files of models (library liegrad_io) ---- */

/* Attribute `kind` of a file written here (or by hand, without `format`), which selects the loader. "" for a
 * file without `kind` or of another format. LG_INVALID_ARGUMENT: no room in `size` bytes; 64 are enough. */
LG_API lg_status lg_file_kind(const lg_context *context, const char *path, const lg_read_options *options,
                              char *kind, size_t size, lg_error *error);

/* A recipe: how a kind of model is trained and stored. The functions below take an lg_hamiltonian_run,
 * lg_surrogate_run, lg_detector_run, lg_table_run or lg_machine_model_run by its address. Fields:
 * liegrad/fields.h. */
typedef struct lg_recipe lg_recipe;
LG_API extern const lg_recipe lg_recipe_hamiltonian, lg_recipe_surrogate, lg_recipe_detector, lg_recipe_table;
/* The list of all recipes, ended by NULL. A new kind of model is a row of this list. */
LG_API extern const lg_recipe *const lg_recipes[];
/* Finds the recipe with this name, the attribute `kind` of its model files. NULL: no recipe has the name. */
LG_API const lg_recipe *lg_recipe_find(const char *name);

/* A checkpoint holds the run's description under /run and the state of lg_fit under /fit:
 *   lg_checkpoint_create -> lg_file_writer_archive(writer, "fit", &archive) -> the fit's save ->
 *   lg_file_writer_commit
 * Kinds "checkpoint" (Hamiltonians), "surrogate-checkpoint", "detector-checkpoint",
 * "table-checkpoint". */
LG_API lg_status lg_checkpoint_create(const lg_context *context, const char *path, const lg_recipe *kind,
                                      const void *run, const lg_provenance *provenance, lg_file_writer **out,
                                      lg_error *error);
/* Opens a checkpoint and reads its run. lg_file_reader_archive(reader, "fit", &archive) opens /fit. */
LG_API lg_status lg_checkpoint_open(const lg_context *context, const char *path,
                                    const lg_read_options *options, const lg_recipe *kind, void *run,
                                    lg_file_reader **out, lg_error *error);
/* Compares everything that is stored of two runs. Errors: LG_INVALID_ARGUMENT when `stored` is not the run
 * `wanted`; the sentence names the first difference ("...: was written with batch 80, not 100"). `path` is
 * only for the sentence. */
LG_API lg_status lg_run_compare(const lg_recipe *kind, const void *stored, const void *wanted,
                                const char *path, lg_error *error);

/* Writes a model as functions: kind, program, and the space of the states (NULL: it does not move). What
 * lg_model_create takes becomes a file that lg_model_load, lg_program_load and lg-export read, whatever the
 * kind is called. `provenance` may be NULL. Errors: those of lg_program_save. */
LG_API lg_status lg_model_save(const lg_context *context, const char *path, const char *kind,
                               const lg_program *program, const lg_space *space,
                               const lg_provenance *provenance, lg_error *error);

/* A model file, loaded for use in a control program. */
typedef struct lg_model_file {
    const lg_context *context;
    const lg_recipe *recipe; /* NULL: no recipe has the file's kind */
    lg_model *model;         /* owned */
    void *contents;          /* owned: the recipe's file structure; lg_model_file_of gives it with its type */
} lg_model_file;
/* Loads the functions of a file of any kind (liegrad/model.h says which it needs), for a recipe its contents
 * too. Files of version 1 hold no functions: their recipe records them. Errors: those of the recipe's own
 * loader and of lg_program_load; LG_FORMAT for functions that lg_model_create refuses, and for files without
 * functions, with a sentence that says what the file is: checkpoints, data, classical classifiers (read by
 * lg_classifier_load). */
LG_API lg_status lg_model_load(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_model_file *out, lg_error *error);
/* The contents where the file is of this recipe: an lg_hamiltonian_file of lg_recipe_hamiltonian and so on.
 * NULL where it is of another one. Borrowed. */
LG_API const void *lg_model_file_of(const lg_model_file *file, const lg_recipe *recipe);
/* The model's functions as a program, as lg_hamiltonian_program, lg_surrogate_program, ... make it; `scheme`
 * of its steps, NULL: the model's default. Without a recipe, or where the recipe has no scheme: the file's
 * functions and, where it has a space and no function `step`, a step made of the field: by rk4 on R^n, by cf4
 * on other spaces. A file that holds a function `step` takes no other scheme: LG_UNSUPPORTED. The caller
 * destroys the program. */
LG_API lg_status lg_model_file_program(const lg_model_file *file, const lg_scheme *scheme, lg_program **out,
                                       lg_error *error);
/* The scheme of the model's steps unless another one is chosen; NULL: the model has no steps, or no recipe
 * has a scheme and the file holds the function `step`. */
LG_API const lg_scheme *lg_model_file_scheme(const lg_model_file *file);
/* Part number `index` = 0, 1, ... of the parameters, as it lies below /model in the file: name, shape, and
 * its numbers (borrowed). False beyond the last. */
LG_API bool lg_model_file_slice(const lg_model_file *file, uint32_t index, lg_slice_info *out,
                                const double **values);
LG_API void lg_model_file_destroy(lg_model_file *file);

LG_END_DECLS

#endif
