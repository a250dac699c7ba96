/* A learned Hamiltonian in a loop: its field with an input, and steps along it. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "models/hamiltonian_internal.h"
#include "models/model_internal.h"

bool lg_model_is_hamiltonian(const lg_model *model) {
    return model != NULL && model->kind == LG_MODEL_HAMILTONIAN;
}

static bool is_chain(const lg_model *model) {
    return model->hamiltonian.family == LG_HAMILTONIAN_CHAIN;
}

/* ---- the field ---- */

size_t lg_model_input_size(const lg_model *model) {
    if (!lg_model_is_hamiltonian(model)) return 0;
    return (size_t)model->hamiltonian.links * (is_chain(model) ? 3 : 1);
}

/* Chain: eta_i += tau_i; separable: p' += u. */
static void add_input(const lg_model *model, const double *input, double *field) {
    const size_t k = model->hamiltonian.links;
    if (!is_chain(model))
        for (size_t i = 0; i < k; i++) field[k + i] += input[i];
    else
        for (size_t i = 0; i < 3 * k; i++) field[i / 3 * 6 + 3 + i % 3] += input[i];
}

lg_status lg_model_field(const lg_model *model, const double *state, const double *input, double *field,
                         void *work) {
    if (!lg_model_is_hamiltonian(model)) return LG_UNSUPPORTED;
    lg_hamiltonian_field(&model->hamiltonian, model->theta, state, field, work);
    if (input != NULL) add_input(model, input, field);
    lg_model_mark_unfit(model, state, lg_model_inputs(model), field);
    return LG_OK;
}

/* ---- for an integrator ---- */

static lg_status ode_field(void *user, double t, const double *y, const double *input, double *algebra) {
    const lg_model_user *self = user;
    (void)t;
    return lg_model_field(self->model, y, input, algebra, self->work);
}

static lg_status ode_force(void *user, double t, const double *q, const double *input, double *out) {
    const lg_model_user *self = user;
    const lg_hamiltonian *model = &self->model->hamiltonian;
    (void)t;
    lg_hamiltonian_force(model, self->model->theta, q, out, self->work);
    for (size_t i = 0; input != NULL && i < model->links; i++) out[i] += input[i];
    return LG_OK;
}

static lg_status ode_velocity(void *user, double t, const double *p, const double *input, double *out) {
    const lg_model_user *self = user;
    (void)t, (void)input;
    lg_hamiltonian_velocity(&self->model->hamiltonian, self->model->theta, p, out, self->work);
    return LG_OK;
}

lg_status lg_model_ode(const lg_model *model, lg_model_user *user, void *work, lg_ode *ode) {
    if (!lg_model_is_hamiltonian(model)) return LG_UNSUPPORTED;
    if (user == NULL || ode == NULL) return LG_INVALID_ARGUMENT;
    const lg_hamiltonian *hamiltonian = &model->hamiltonian;
    lg_ode made = {.field = ode_field, .user = user};
    if (is_chain(model)) {
        const lg_space_factor links = {LG_SPACE_TS2, hamiltonian->links};
        LG_TRY(lg_space_init(&made.space, &links, 1));
    } else {
        LG_TRY(lg_space_init_rn(&made.space, 2 * (size_t)hamiltonian->links));
        made.force = ode_force;
        made.velocity = ode_velocity;
    }
    *user = (lg_model_user){model, work};
    *ode = made;
    return LG_OK;
}

/* ---- a stepper in one piece of memory: user, work, stepper ---- */

static size_t padded(size_t bytes) {
    return (bytes + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
}

/* Bytes before the stepper. */
static size_t before_stepper(const lg_model *model) {
    return padded(sizeof(lg_model_user)) + padded(lg_hamiltonian_work_size(&model->hamiltonian));
}

/* The model's equation, and whether the scheme is one for it. */
static lg_status equation(const lg_model *model, const lg_scheme *scheme, lg_model_user *user, void *work,
                          lg_ode *ode) {
    if (model == NULL || scheme == NULL) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_model_ode(model, user, work, ode));
    return scheme->kind == LG_SCHEME_VARIATIONAL ? LG_UNSUPPORTED : LG_OK;
}

size_t lg_model_stepper_size(const lg_model *model, const lg_scheme *scheme) {
    lg_model_user user;
    lg_ode ode;
    if (equation(model, scheme, &user, NULL, &ode) != LG_OK) return 0;
    const size_t bytes = lg_stepper_size(scheme, &ode);
    return bytes > 0 ? before_stepper(model) + bytes : 0;
}

lg_status lg_model_stepper_init(void *memory, size_t bytes, const lg_model *model, const lg_scheme *scheme,
                                lg_stepper **out) {
    lg_model_user asked;
    lg_ode ode;
    LG_TRY(equation(model, scheme, &asked, NULL, &ode));
    const size_t before = before_stepper(model);
    /* Without memory: whether the scheme fits, which is said before anything about the memory. */
    if (memory == NULL || (uintptr_t)memory % LG_ALIGNMENT != 0 || bytes < before || out == NULL)
        return lg_stepper_init(NULL, 0, scheme, &ode, NULL);
    char *base = memory;
    lg_model_user *user = memory;
    lg_stepper *made;
    ode.user = user;
    LG_TRY(lg_stepper_init(base + before, bytes - before, scheme, &ode, &made));
    *user = (lg_model_user){model, base + padded(sizeof *user)};
    *out = made;
    return LG_OK;
}
