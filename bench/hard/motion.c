/* Cases of runs of mechanical systems. */
#include <stdlib.h>
#include <string.h>

#include "hard.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"

static lg_status integrate(lg_stepper *stepper, double t0, double T, double tolerance, const double *start,
                           double *end, size_t dim) {
    if (tolerance < 0) {
        const size_t steps = (size_t)-tolerance;
        double *both = malloc(2 * dim * sizeof(*both));
        const lg_status status =
            lg_integrate_fixed(stepper, t0, T / (double)steps, steps, NULL, 0, steps, start, both, NULL);
        memcpy(end, both + dim, dim * sizeof(*both));
        free(both);
        return status;
    }
    lg_step_controller control;
    lg_step_controller_init(&control);
    control.rtol = tolerance, control.atol = -tolerance * 1e-3, control.max_steps = 100000000;
    const double last = t0 + T;
    return lg_integrate_adaptive(stepper, &control, t0, start, &last, 1, end, NULL);
}

lg_status hard_run(const hard_function *f, const double *in, double *out, size_t m) {
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = f->form, options.links = f->links ? f->links : 1;
    const lg_named_values gravity = {"gravity", in + 3, 1};
    if (f->links) options.parameters = &gravity, options.parameter_count = 1;
    lg_system *system;
    lg_status status = lg_system_create(NULL, f->system, &options, &system, NULL);
    if (status != LG_OK) return status;
    const size_t dim = lg_system_dim(system);
    double *work = aligned_alloc(64, (lg_system_work_size(system) + 63) / 64 * 64);
    double *end = calloc(dim, sizeof(*end));
    const lg_scheme *scheme = lg_scheme_find(f->scheme);
    lg_ode ode;
    lg_system_user user;
    lg_stepper *stepper = NULL;
    status = lg_system_set_parameters(system, in + 3);
    if (status == LG_OK) status = lg_system_ode(system, lg_system_coordinates_for(scheme), &ode, &user, work);
    if (status == LG_OK) status = lg_stepper_create(NULL, scheme, &ode, &stepper);
    if (status == LG_OK)
        status =
            integrate(stepper, in[0], in[1], in[2], in + 3 + lg_system_parameter_count(system), end, dim);
    if (status == LG_OK) memcpy(out, end, m * sizeof(*out));
    lg_stepper_destroy(stepper);
    lg_system_destroy(system);
    free(work), free(end);
    return status;
}

const hard_function hard_motion[] = {
    {"rigid body", .system = "rigid-body", .scheme = "rkmk54"},
    {"rigid body, dp54", .system = "rigid-body", .scheme = "dp54"},
    {"attitude", .system = "rigid-body-attitude", .scheme = "rkmk54"},
    {"heavy top", .system = "heavy-top", .form = "lie-poisson", .scheme = "rkmk54"},
    {"spherical pendulum", .system = "pendulum-chain", .form = "lagrangian", .scheme = "rkmk54", .links = 1},
    {"spherical pendulum, Hamiltonian", .system = "pendulum-chain", .form = "hamiltonian", .scheme = "rkmk54",
     .links = 1},
    {"two links", .system = "pendulum-chain", .form = "lagrangian", .scheme = "rkmk54", .links = 2},
    {"two links, Hamiltonian", .system = "pendulum-chain", .form = "hamiltonian", .scheme = "rkmk54",
     .links = 2},
    {"three links", .system = "pendulum-chain", .form = "lagrangian", .scheme = "rkmk54", .links = 3},
    {"oscillator, stormer-verlet", .system = "oscillator", .scheme = "stormer-verlet"},
    {"oscillator, variational", .system = "oscillator", .scheme = "variational"},
    {.name = NULL},
};
