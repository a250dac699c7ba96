/* Runs of mechanical systems. */
#include <stdlib.h>

#include "hard.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"

/* A run of a system: the state at the end, reached from t0 to t0 + T. */
static lg_status run(lg_system *system, const char *scheme, double tolerance, size_t steps, double t0,
                     double T, const double *start, double *out) {
    lg_ode ode;
    lg_system_user user;
    double *work = aligned_alloc(64, (lg_system_work_size(system) + 63) / 64 * 64);
    const lg_scheme *of = lg_scheme_find(scheme);
    lg_status status = lg_system_ode(system, lg_system_coordinates_for(of), &ode, &user, work);
    lg_stepper *stepper = NULL;
    if (status == LG_OK) status = lg_stepper_create(NULL, of, &ode, &stepper);
    if (status == LG_OK && steps) {
        double *both = malloc(2 * ode.space.dim * sizeof(*both));
        status = lg_integrate_fixed(stepper, t0, T / (double)steps, steps, NULL, 0, steps, start, both, NULL);
        for (size_t i = 0; status == LG_OK && i < ode.space.dim; i++) out[i] = both[ode.space.dim + i];
        free(both);
    } else if (status == LG_OK) {
        lg_step_controller control;
        lg_step_controller_init(&control);
        control.rtol = tolerance, control.atol = -tolerance * 1e-3, control.max_steps = 100000000;
        const double end = t0 + T;
        status = lg_integrate_adaptive(stepper, &control, t0, start, &end, 1, out, NULL);
    }
    lg_stepper_destroy(stepper);
    free(work);
    return status;
}

/* t0, T, tolerance (or -steps), inertia (3), mu (3) -> mu */
static lg_status body(const double *in, const char *adaptive, const char *fixed, double *out) {
    const lg_named_values inertia = {"inertia", in + 3, 3};
    lg_system_options options;
    lg_system_options_init(&options);
    options.parameters = &inertia, options.parameter_count = 1;
    lg_system *system;
    lg_status status = lg_system_create(NULL, "rigid-body", &options, &system, NULL);
    if (status != LG_OK) return status;
    const size_t steps = in[2] < 0 ? (size_t)-in[2] : 0;
    status = run(system, steps ? fixed : adaptive, in[2], steps, in[0], in[1], in + 6, out);
    lg_system_destroy(system);
    return status;
}

static lg_status rigid_body(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return body(in, "rkmk54", "rkmk4", out);
}

const hard_function hard_motion[] = {
    {"rigid body", .measure = rigid_body},
    {.name = NULL},
};
