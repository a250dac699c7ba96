/* Learned Hamiltonians and machines in a control loop: the field with an input, and steps along it. */
#include "core/core.h"
#include "model/internal.h"

/* ---- the field ---- */

lg_status lg_model_field(const lg_model *model, const double *state, const double *input, double *field,
                         void *work) {
    LG_NEEDS(NULL, model, state, field, work);
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    const double *const x[] = {state, lg_model_input(model, input, work)};
    lg_model_run(model, LG_MODEL_FIELD, x, &field, work);
    return LG_OK;
}

/* ---- conversion between states of machines and numbers of logs ---- */

static lg_status convert(const lg_model *model, lg_model_function function, const double *const *x, double *y,
                         void *work) {
    if (model->plan[function] == NULL) return LG_UNSUPPORTED;
    lg_model_run(model, function, x, &y, work);
    return LG_OK;
}

lg_status lg_model_machine_state(const lg_model *model, const double *positions, const double *velocities,
                                 double *state, void *work) {
    LG_NEEDS(NULL, model, positions, velocities, state, work);
    const double *const x[] = {positions, velocities};
    return convert(model, LG_MODEL_STATE, x, state, work);
}

lg_status lg_model_machine_velocities(const lg_model *model, const double *state, double *velocities,
                                      void *work) {
    LG_NEEDS(NULL, model, state, velocities, work);
    return convert(model, LG_MODEL_VELOCITIES, &state, velocities, work);
}

lg_status lg_model_machine_positions(const lg_model *model, const double *state, double *positions,
                                     void *work) {
    LG_NEEDS(NULL, model, state, positions, work);
    return convert(model, LG_MODEL_POSITIONS, &state, positions, work);
}

/* ---- the equation for an integrator ---- */

static lg_status ode_field(void *user, double t, const double *y, const double *input, double *algebra) {
    const lg_model_user *self = user;
    return lg_model_field(self->model, y, input, algebra, self->work);
}

static lg_status ode_force(void *user, double t, const double *q, const double *input, double *out) {
    const lg_model_user *self = user;
    const double *const x[] = {q, lg_model_input(self->model, input, self->work)};
    lg_model_run(self->model, LG_MODEL_FORCE, x, &out, self->work);
    return LG_OK;
}

static lg_status ode_drift(void *user, double t, const double *p, const double *input, double *out) {
    const lg_model_user *self = user;
    lg_model_run(self->model, LG_MODEL_DRIFT, &p, &out, self->work);
    return LG_OK;
}

/* Without `work` the equation can be inspected, but not evaluated. */
static lg_status ode_of(const lg_model *model, lg_ode *ode, lg_model_user *user, void *work) {
    if (!lg_model_moves(model)) return LG_UNSUPPORTED;
    lg_ode made = {.space = model->space, .field = ode_field, .user = user};
    if (model->plan[LG_MODEL_FORCE] != NULL) {
        LG_TRY(lg_space_init_rn(&made.space, made.space.dim));
        made.force = ode_force;
        made.velocity = ode_drift;
    }
    *user = (lg_model_user){model, work};
    *ode = made;
    return LG_OK;
}

lg_status lg_model_ode(const lg_model *model, lg_ode *ode, lg_model_user *user, void *work) {
    LG_NEEDS(NULL, model, ode, user, work);
    return ode_of(model, ode, user, work);
}

/* ---- a stepper in one piece of memory: lg_model_user, work, stepper ---- */

static size_t padded(size_t bytes) {
    return (bytes + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
}

/* Bytes before the stepper in that memory. */
static size_t before_stepper(const lg_model *model) {
    return padded(sizeof(lg_model_user)) + padded(model->work);
}

/* Makes the model's equation. LG_UNSUPPORTED for schemes that it does not fit: variational schemes, and
 * splitting schemes without force and drift. */
static lg_status equation(const lg_model *model, const lg_scheme *scheme, lg_model_user *user, void *work,
                          lg_ode *ode) {
    if (model == NULL || scheme == NULL) return LG_INVALID_ARGUMENT;
    LG_TRY(ode_of(model, ode, user, work));
    const bool splits = scheme->kind == LG_SCHEME_SPLITTING && ode->force == NULL;
    return scheme->kind == LG_SCHEME_VARIATIONAL || splits ? LG_UNSUPPORTED : LG_OK;
}

size_t lg_model_stepper_size(const lg_model *model, const lg_scheme *scheme) {
    lg_model_user user;
    lg_ode ode;
    if (equation(model, scheme, &user, NULL, &ode) != LG_OK) return 0;
    const size_t bytes = lg_stepper_size(scheme, &ode);
    return bytes > 0 ? before_stepper(model) + bytes : 0;
}

lg_status lg_model_stepper_init(const lg_model *model, const lg_scheme *scheme, lg_stepper **out,
                                void *memory, size_t bytes) {
    lg_model_user asked;
    lg_ode ode;
    LG_TRY(equation(model, scheme, &asked, NULL, &ode));
    const size_t before = before_stepper(model);
    /* The memory is missing, misaligned or too small. lg_stepper_init reports a fault of the scheme first. */
    if (memory == NULL || (uintptr_t)memory % LG_ALIGNMENT != 0 || bytes < before || out == NULL)
        return lg_stepper_init(scheme, &ode, NULL, NULL, 0);
    char *base = memory;
    lg_model_user *user = memory;
    lg_stepper *made;
    ode.user = user;
    LG_TRY(lg_stepper_init(scheme, &ode, &made, base + before, bytes - before));
    *user = (lg_model_user){model, base + padded(sizeof *user)};
    *out = made;
    return LG_OK;
}
