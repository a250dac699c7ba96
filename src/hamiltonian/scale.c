/* Scales a potential before training, from the size of its forces relative to the forces in the data. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "hamiltonian/internal.h"

LG_AT(lg_tape_destroy, lg_tape)

enum { MOST_STATES = 256 };

/* Computes the velocities y' (count, d) at the states. The variables stay on the tape until it is reset. */
static lg_status velocities(lg_tape *tape, const lg_hamiltonian *model, const double *theta,
                            const double *states, size_t count, double *out) {
    const uint32_t d = lg_hamiltonian_state_dim(model);
    lg_hamiltonian_vars vars;
    lg_tape_reset(tape);
    lg_var parameters = lg_input_f64(tape, lg_shape1((uint32_t)lg_hamiltonian_parameters(model)), theta);
    LG_TRY(lg_hamiltonian_bind(tape, model, parameters, &vars));
    lg_var y = lg_input_f64(tape, lg_shape2((uint32_t)count, d), states);
    return lg_read(tape, lg_hamiltonian_record_velocity(tape, &vars, y, LG_NONE), count * d, out);
}

/* The root mean square of the forces in the data, divided by the root mean square of the network's forces.
 * The arrays have `count` numbers: `quotient` is the difference quotient D of the data, `whole` is y' with
 * the potential, `kinetic` is y' without it. */
static double ratio_of(size_t count, const double *quotient, const double *whole, const double *kinetic) {
    double wanted = 0.0, have = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double force = whole[i] - kinetic[i], rest = quotient[i] - kinetic[i];
        if (force == 0.0) continue;
        wanted += rest * rest;
        have += force * force;
    }
    return have > 0.0 ? sqrt(wanted / have) : 1.0;
}

/* Takes the first points of `count` trajectories from all over the data, and the mean velocity of each. */
static void take_states(const lg_hamiltonian_problem *problem, size_t d, size_t count, double *states,
                        double *quotient) {
    const size_t last = problem->points - 1;
    for (size_t i = 0; i < count; i++) {
        const double *first = problem->data + i * (problem->trajectories / count) * problem->points * d;
        memcpy(states + i * d, first, d * sizeof(*states));
        for (size_t c = 0; c < d; c++)
            quotient[i * d + c] = (first[last * d + c] - first[c]) / (problem->dt * (double)last);
    }
}

lg_status lg_hamiltonian_scale(const lg_context *context, const lg_hamiltonian_problem *problem,
                               double *theta, double *factor) {
    LG_NEEDS(NULL, problem, theta);
    LG_TRY(lg_hamiltonian_problem_check(problem, NULL));
    const lg_hamiltonian *model = problem->model;
    const size_t count = problem->trajectories < MOST_STATES ? problem->trajectories : MOST_STATES;
    const size_t d = lg_hamiltonian_state_dim(model), size = count * d;
    const size_t parameters = lg_hamiltonian_parameters(model), end = lg_mlp_parameters(&model->net);
    const size_t last = lg_mlp_weight_offset(&model->net, model->net.layers - 1);
    LG_TRY_SCRATCH(double, states, context, 4 * size + parameters, LG_OUT_OF_MEMORY);
    double *quotient = states + size, *whole = quotient + size, *kinetic = whole + size;
    double *flat = kinetic + size; /* theta with a last layer of V that is 0 */
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    LG_TRY(lg_tape_create(context, NULL, &tape));
    take_states(problem, d, count, states, quotient);
    memcpy(flat, theta, parameters * sizeof(*flat));
    memset(flat + last, 0, (end - last) * sizeof(*flat));
    LG_TRY(velocities(tape, model, theta, states, count, whole));
    LG_TRY(velocities(tape, model, flat, states, count, kinetic));
    const double ratio = ratio_of(size, quotient, whole, kinetic);
    const double scale = ratio > 1.0 && ratio <= DBL_MAX ? cbrt(ratio) : 1.0;
    for (size_t i = last; i < end; i++) theta[i] *= scale;
    if (factor != NULL) *factor = scale;
    return LG_OK;
}
