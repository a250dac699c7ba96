/* Trained models in a control loop, and their files. One handle, lg_model, evaluates learned Hamiltonians,
 * surrogates, detectors, tables, machines and programs of your own, without a tape, in the caller's memory.
 * The library is liegrad; the last section (files of models) is in liegrad_io. docs/models.md is the guide.
 *
 *   lg_model_file file;
 *   lg_model_load(NULL, "pendulum.h5", NULL, &file, &error);         (liegrad_io)
 *   const lg_model *model = file.model;
 *   void *work = aligned_alloc(64, lg_model_work_size(model));
 *   lg_model_eval(model, state, &energy, work);
 *
 * The functions between lg_model_work_size and the section on files neither allocate nor lock, and they fail
 * only with a status that their comment names. Everything is double precision; the networks of a model that
 * was trained in single precision are evaluated in double. A model is read-only: threads may share it, each
 * with its own work memory. `work` has lg_model_work_size bytes and is 64-byte aligned; what it holds before
 * and after a call does not matter. Outputs must not overlap inputs or work. If a number of x or of a state
 * is not finite, or a mass is not positive definite, all numbers of y, Jacobian and field are NaN.
 *
 * The inputs x and outputs y of the kinds of models (in a Jacobian, rows are outputs and columns are inputs):
 *   Hamiltonian            state of its family (chain, 6k: q_1 p_1 q_2 p_2 ...; separable, 2n: q p; other
 *                          families: liegrad/hamiltonian.h) -> H (1)
 *   surrogate, discrete    boundary conditions (8: q0 v0 qN vN) -> inner nodes and tangents (q_1 .. q_{N-1},
 *                          v_1 .. v_{N-1}), 4(N-1)
 *   surrogate, continuous  (s, q0 v0 qN vN), 9 -> q(s), 2. Column 0 of the Jacobian is the tangent v(s).
 *   surrogate, angle       (s, q0 v0 qN vN), 9 -> theta(s), 1. Column 0 is the curvature.
 *   detector               window as recorded (channels, length) -> logits (outputs of its network)
 *   table                  a row of the input columns -> outputs in their units, or one logit per class
 *   machine                state of lg_machine_space (places; q p of each direction; R of each rotation;
 *                          momenta), in the units of the log -> H (1)
 *
 * The gradient of a Hamiltonian is that of lg_hamiltonian_record_gradient: the gradient of an extension of
 * H to the ambient space, whose field gives the flow on the manifold. At a kink of ReLU or max pooling,
 * the derivative is that of the branch that is taken. */
#ifndef LIEGRAD_MODEL_H
#define LIEGRAD_MODEL_H

#include "liegrad/files.h"
#include "liegrad/integrators.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/settings.h"

LG_BEGIN_DECLS

/* An immutable handle: a program with plans of its functions. lg_model_load makes it from a file, or
 * lg_model_create from a program:
 *
 *   lg_hamiltonian_space(hamiltonian.family, hamiltonian.n, &space);
 *   lg_hamiltonian_program(NULL, &hamiltonian, theta, NULL, &program, &error);
 *   lg_model_create(NULL, program, &space, &model, &error); */
typedef struct lg_model lg_model;
/* Makes a model. It takes ownership of the program, also when it fails; the context must outlive the model.
 * `space` is the space of the states; NULL for a model that does not move, that is, has no equation of
 * motion. The following functions of the program are used if it has them. D is the number of numbers of x,
 * which is the state if there is a space; Y that of y; M that of u, which may be absent.
 *   value (x) -> y (Y)                          grad (x) -> y, dy/dx (Y, D)
 *   field (x, u) -> algebra element of the space
 *   jac_velocity (x, u) -> dx'/dx (D, D), dx'/du (D, M); made from field if it is missing
 *   force (q, u) -> p', drift (p) -> q', with q and p of D/2 numbers: for splitting schemes
 *   momenta (q, v) -> x, positions (x) -> q, velocities (x) -> v: for machines
 * Errors: LG_NOT_FOUND (neither value nor field; a space and no field), LG_SHAPE (functions that do not
 * fit together or the space), those of lg_plan_create. */
LG_API lg_status lg_model_create(const lg_context *context, lg_program *program, const lg_space *space,
                                 lg_model **out, lg_error *error);
/* Makes a plan of any function of the program. Call it before a loop; the caller destroys the plan.
 * `options` NULL means the default options. Errors: LG_NOT_FOUND (no such function), those of
 * lg_plan_create. */
LG_API lg_status lg_model_find(const lg_model *model, const char *function, const lg_plan_options *options,
                               lg_plan **out, lg_error *error);
LG_API const lg_program *lg_model_program(const lg_model *model); /* Belongs to the model. */
LG_API void lg_model_destroy(lg_model *model);

/* lg_model_space returns the space of the states; NULL if the model does not move. The other three return
 * how many numbers theta, x and y have. */
LG_API const lg_space *lg_model_space(const lg_model *model);
LG_API size_t lg_model_parameters(const lg_model *model);
LG_API size_t lg_model_inputs(const lg_model *model);
LG_API size_t lg_model_outputs(const lg_model *model);
/* Bytes of work memory for any of the functions below. */
LG_API size_t lg_model_work_size(const lg_model *model);
/* x (inputs) -> y (outputs). Does nothing if the program has no function `value`. */
LG_API void lg_model_eval(const lg_model *model, const double *x, double *y, void *work);
/* x (inputs) -> y (outputs), jacobian (outputs, inputs); either may be NULL. Does nothing if the program
 * has no function `grad`. */
LG_API void lg_model_jacobian(const lg_model *model, const double *x, double *y, double *jacobian,
                              void *work);

/* ---- Models that move, in a loop (other models: sizes 0, LG_UNSUPPORTED) ----
 *
 * The entry of a Hamiltonian's family (lg_hamiltonian_family) determines the state (`factor` and `layout`),
 * the input u (`forces`) and the algebra element (`field`). Tangent coordinates are those of lg_space_basis.
 * For learned Hamiltonians:
 *   chain      u = (tau_1, ..., tau_k), 3k: spatial torques about the links' own joints, conjugate to the
 *              links' angular velocities; p_i' gets tau_i x q_i, the algebra element eta_i gets tau_i
 *   separable  u = forces (n): p' = -dV/dq + u
 *   bodies     torques in space on R and on q, forces along x
 *
 * For machines the state and the algebra element are those of lg_machine_space, and u are the inputs of
 * the log, all in the units of the log. */
LG_API size_t lg_model_input_dim(const lg_model *model); /* m: numbers in an input; chain 3k, separable n. */
/* Writes the field, an algebra element of the space: for a chain (xi_i, eta_i), 6k numbers; for separable
 * systems (q', p'), 2n numbers; for machines (places', xi eta of each direction, R Omega of each rotation,
 * momenta'). `input` (m) may be NULL, which is zero. Errors: LG_UNSUPPORTED (the model does not move). */
LG_API lg_status lg_model_field(const lg_model *model, const double *state, const double *input,
                                double *field, void *work);

/* The learned system as an equation for an integrator: lg_model_ode fills `ode` with the space of the
 * states (for a chain (T*S^2)^k; R^2n with force and velocity for separable systems; lg_machine_space),
 * and fills `user`. The `input` of lg_stepper_step is u. `user`, `model` and `work` (lg_model_work_size
 * bytes) must outlive the use of `ode`. Errors: LG_UNSUPPORTED (the model does not move). */
typedef struct lg_model_user {
    const lg_model *model;
    void *work;
} lg_model_user;
LG_API lg_status lg_model_ode(const lg_model *model, lg_ode *ode, lg_model_user *user, void *work);

/* Put the learned system and a scheme into one piece of the caller's memory, which is 64-byte aligned and has
 * lg_model_stepper_size bytes (`bytes` says how many it has). lg_stepper_step(stepper, t, h, state, input,
 * next) then makes a step, which stays on the manifold and neither allocates nor locks. `memory`, `model`
 * and `scheme` must outlive the stepper. There is nothing to destroy. Errors:
 * - LG_UNSUPPORTED, and lg_model_stepper_size is 0: classical schemes on a space other than R^d (they leave
 *   the manifold), splitting schemes for a family without force and drift, variational schemes, slgi where
 *   the space is not SE(3) x R^2m
 * - LG_INVALID_ARGUMENT: as lg_stepper_init; faults of the scheme are found before those of the memory */
LG_API size_t lg_model_stepper_size(const lg_model *model, const lg_scheme *scheme);
LG_API lg_status lg_model_stepper_init(const lg_model *model, const lg_scheme *scheme, lg_stepper **out,
                                       void *memory, size_t bytes);

/* ---- Linearisation, for regulators and filters ----
 *
 * Tangent coordinates c (r numbers) describe the states near y: y + basis c to first order, with the basis
 * of lg_space_basis. On R^n, which has separable systems and places and momenta of machines, c is dy. A
 * chain has r = 4k: for link i, c_i = (a_1, a_2, b_1, b_2) as on T*S^2. The coordinates of a machine are
 * in the order of the state: 4 numbers per direction, and per rotation 3 numbers, a rotation vector in the
 * body. d is the number of numbers in a state. */
LG_API size_t lg_model_tangent_dim(const lg_model *model); /* r: tangent coordinates. */
/* Linearises the motion at (state, input): c' = A c + B du to first order, where the frames e_1, e_2 and R
 * are held fixed (at an equilibrium this neglects nothing). Writes A (r, r), B (r, m) and basis (d, r),
 * row-major; each may be NULL; `input` (m) may be NULL, which is zero. The derivatives of the field are
 * exact: second derivatives of the network, not differences. Errors: LG_UNSUPPORTED (the model does not
 * move). */
LG_API lg_status lg_model_linearise(const lg_model *model, const double *state, const double *input,
                                    double *A, double *B, double *basis, void *work);
/* Writes the coordinates c (r) of the difference `other` - `state` (lg_space_coordinates), in the frame at
 * `state`. For rotations S = other and R = state they are 1/2 vee(R^T S - S^T R): the axis times the sine
 * of the angle. Errors: LG_UNSUPPORTED (the model does not move). */
LG_API lg_status lg_model_deviation(const lg_model *model, const double *state, const double *other,
                                    double *c, void *work);

/* Writes to `out` the state that a step along the coordinates c (r) leads to from `state`:
 * lg_space_retract with the vector basis c. It is on the manifold, and its lg_model_deviation is c to
 * first order; on R^d it is state + c. `out` may be `state`. Errors: LG_UNSUPPORTED (the model does not
 * move). */
LG_API lg_status lg_model_retract(const lg_model *model, const double *state, const double *c, double *out,
                                  void *work);
/* Moves `state` (in and out) to a nearby equilibrium, where it stays under the constant `input` (NULL:
 * zero). Damped Newton's method for c' = 0, with c' and its matrix A as in lg_model_linearise; where the
 * steps are not unique it takes the shortest one. *drift (may be NULL) becomes the largest |c'_i| that is
 * left. Errors: LG_NO_CONVERGENCE (|c'| stays above 1e-9 |A|_F; `state` is then as before), LG_UNSUPPORTED
 * (the model does not move). */
LG_API lg_status lg_model_equilibrium(const lg_model *model, const double *input, double *state,
                                      double *drift, void *work);

/* ---- Machines: states and rows of a log (other models: LG_UNSUPPORTED) ----
 *
 * These functions convert between a state, which has momenta, and positions and velocities in the order
 * and units of the log (liegrad/machine.h): the positions of each coordinate (R row-major), and the
 * velocities of each coordinate. */
LG_API lg_status lg_model_machine_state(const lg_model *model, const double *positions,
                                        const double *velocities, double *state, void *work);
LG_API lg_status lg_model_machine_velocities(const lg_model *model, const double *state, double *velocities,
                                             void *work);
LG_API lg_status lg_model_machine_positions(const lg_model *model, const double *state, double *positions,
                                            void *work);

/* ---- Files of models (library liegrad_io) ---- */

/* Writes the attribute `kind` of a file to `kind`, which has room for `size` bytes; it tells which
 * function loads the file. "" for a file of another format or without `kind`. The file may also be written
 * by hand, without the attribute `format`. Errors: LG_INVALID_ARGUMENT (too little room; 64 bytes are
 * enough), those of opening the file. */
LG_API lg_status lg_model_file_kind(const lg_context *context, const char *path,
                                    const lg_read_options *options, char *kind, size_t size, lg_error *error);

/* A recipe: how a kind of model is trained and stored. The functions below take the address of a run, an
 * lg_hamiltonian_run, lg_surrogate_run, lg_detector_run, lg_table_run or lg_machine_model_run. Fields of
 * runs: liegrad/settings.h. */
typedef struct lg_recipe lg_recipe;
typedef struct lg_fit lg_fit; /* in liegrad/fit.h */
LG_API extern const lg_recipe lg_recipe_hamiltonian, lg_recipe_surrogate, lg_recipe_detector, lg_recipe_table;
/* The list of all recipes, ended by NULL. A new kind of model is added to this list. */
LG_API extern const lg_recipe *const lg_recipes[];
/* Finds the recipe with this name, which is the attribute `kind` of its model files. NULL: no recipe has
 * the name. */
LG_API const lg_recipe *lg_recipe_find(const char *name);

/* Model files of a kind; `file` is the kind's file structure, such as an lg_hamiltonian_file, and
 * docs/files.md has the arrays and attributes of each kind. lg_recipe_save also writes the functions of the
 * model (lg_model_save), with the usual scheme of the kind for `step`. theta comes from `file`, which is only
 * read. If `fit` is not NULL, the history comes from the fit, and so do the states of optimiser and random
 * generator when it trains by Adam; the state of another method is far larger than the model, and only
 * checkpoints have it. Errors: LG_INVALID_ARGUMENT (a model that its ..._init function rejects, sizes
 * that do not fit). lg_recipe_load overwrites *file; on failure it is zeroed. Files that were written by hand
 * need the arrays and attributes that docs/files.md names; everything else becomes zero or the default.
 * lg_recipe_release frees what *file owns, and zeroes it. */
LG_API lg_status lg_recipe_save(const lg_context *context, const char *path, const lg_recipe *kind,
                                const void *file, const lg_fit *fit, lg_error *error);
LG_API lg_status lg_recipe_load(const lg_context *context, const char *path, const lg_read_options *options,
                                const lg_recipe *kind, void *file, lg_error *error);
LG_API void lg_recipe_release(const lg_recipe *kind, void *file);

/* lg_checkpoint_create begins a checkpoint. A checkpoint holds the run's description under /run and the state
 * of lg_fit under /fit:
 *   lg_checkpoint_create -> lg_file_writer_archive(writer, "fit", &archive) -> the fit's save ->
 *   lg_file_writer_commit
 * `kind` is the recipe of the run; the kinds of files are "checkpoint" (Hamiltonians),
 * "surrogate-checkpoint", "detector-checkpoint", "table-checkpoint" and "machine-checkpoint". Errors:
 * LG_INVALID_ARGUMENT (the run is out of range), LG_NOT_FINITE, those of lg_file_writer_create. */
LG_API lg_status lg_checkpoint_create(const lg_context *context, const char *path, const lg_recipe *kind,
                                      const void *run, const lg_provenance *provenance, lg_file_writer **out,
                                      lg_error *error);
/* Opens a checkpoint and reads its run into `run`. lg_file_reader_archive(reader, "fit", &archive) then
 * opens /fit. */
LG_API lg_status lg_checkpoint_open(const lg_context *context, const char *path,
                                    const lg_read_options *options, const lg_recipe *kind, void *run,
                                    lg_file_reader **out, lg_error *error);
/* Compares everything that files store of two runs. Errors: LG_INVALID_ARGUMENT when they differ; `error`
 * names the first difference ("...: was written with batch 80, not 100"), and `path` is only used there. */
LG_API lg_status lg_recipe_compare_runs(const lg_recipe *kind, const void *stored, const void *wanted,
                                        const char *path, lg_error *error);

/* Writes a model file from a program: `kind`, the functions, and the space of the states (NULL: the model
 * does not move). It takes what lg_model_create takes; lg_model_load, lg_program_load and lg-export read
 * the file, whatever the kind is called. `provenance` may be NULL. Errors: those of lg_program_save. */
LG_API lg_status lg_model_save(const lg_context *context, const char *path, const char *kind,
                               const lg_program *program, const lg_space *space,
                               const lg_provenance *provenance, lg_error *error);

/* A model file that was loaded for use in a control program. */
typedef struct lg_model_file {
    const lg_context *context;
    const lg_recipe *recipe; /* NULL: no recipe has the kind of the file. */
    lg_model *model;         /* Owned. */
    /* Owned: the recipe's file structure, such as lg_hamiltonian_file; lg_model_file_of returns it. */
    void *contents;
} lg_model_file;
/* Loads a model file of any kind: its functions, which lg_model_create must accept, and if a recipe has its
 * kind, its contents. If the file holds no functions (written by hand), the recipe records them. Errors:
 * those of the recipe's own loader and of lg_program_load; LG_FORMAT if lg_model_create
 * rejects the functions, or if the file has none; then `error` says what the file is: a checkpoint, data, or
 * a classical classifier (read by lg_classifier_load). */
LG_API lg_status lg_model_load(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_model_file *out, lg_error *error);
/* Returns the contents if the file is of this recipe: an lg_hamiltonian_file for lg_recipe_hamiltonian and
 * so on. NULL otherwise. They belong to `file`. */
LG_API const void *lg_model_file_of(const lg_model_file *file, const lg_recipe *recipe);
/* Makes a program of the model's functions, as lg_hamiltonian_program, lg_surrogate_program, ... do. `scheme`
 * is the scheme of its steps; NULL means the model's default. Without a recipe, or where the recipe has no
 * scheme, the program has the file's functions; if the file has a space and no function `step`, a step is
 * made from the field, by default by rk4 on R^n and by cf4 on other spaces. Errors: LG_UNSUPPORTED (`scheme`
 * is given, but the file holds its own function `step`), those of making the program. */
LG_API lg_status lg_model_file_program(const lg_model_file *file, const lg_scheme *scheme, lg_program **out,
                                       lg_error *error);
/* Returns the default scheme of the model's steps; NULL if the model has no steps, or if the file's own
 * function `step` is used. */
LG_API const lg_scheme *lg_model_file_scheme(const lg_model_file *file);
/* Writes part `index` = 0, 1, ... of the parameters, as it is stored below /model in the file: name and
 * shape to `out`, and the address of its numbers, which belong to `file`, to *values. Returns false beyond
 * the last part, and for a file without a recipe. */
LG_API bool lg_model_file_slice(const lg_model_file *file, uint32_t index, lg_slice_info *out,
                                const double **values);
LG_API void lg_model_file_destroy(lg_model_file *file);

LG_END_DECLS

#endif
