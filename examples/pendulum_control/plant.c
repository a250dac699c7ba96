#include "plant.h"

#include <stdlib.h>
#include <string.h>

/* The torque adds torque x q to p', which means that it is added to the algebra element's second half. */
static lg_status field(void *user, double t, const double *y, const double *torque, double *algebra) {
    const plant *self = user;
    const lg_status status = self->ode.field(self->ode.user, t, y, NULL, algebra);
    for (int i = 0; i < 3 && status == LG_OK; i++) algebra[3 + i] += torque[i];
    return status;
}

bool plant_create(plant *self) {
    const double gravity = 1.0;
    const lg_named_values given = {"gravity", &gravity, 1};
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = "hamiltonian";
    options.parameters = &given;
    options.parameter_count = 1;
    memset(self, 0, sizeof *self);
    if (lg_system_create(NULL, "pendulum-chain", &options, &self->system, NULL) != LG_OK) return false;
    self->work = malloc(lg_system_work_size(self->system));
    if (self->work == NULL ||
        lg_system_ode(self->system, LG_COORDINATES_LIE, &self->ode, &self->user, self->work) != LG_OK ||
        lg_chain_potential_weights(self->system, &self->weight) != LG_OK ||
        lg_chain_mass_matrix(self->system, &self->mass) != LG_OK)
        return false;
    lg_ode driven = self->ode;
    driven.field = field;
    driven.user = self;
    return lg_stepper_create(NULL, lg_scheme_find("rkmk4"), &driven, &self->stepper) == LG_OK;
}

void plant_destroy(plant *self) {
    lg_stepper_destroy(self->stepper);
    lg_system_destroy(self->system);
    free(self->work);
}

bool plant_advance(plant *self, double period, const double *torque, double *state) {
    for (int i = 0; i < PLANT_STEPS; i++)
        if (lg_stepper_step(self->stepper, 0.0, period / PLANT_STEPS, state, torque, state) != LG_OK)
            return false;
    return true;
}

double plant_energy(plant *self, const double *state) {
    return lg_system_hamiltonian(self->system, state, self->work);
}
