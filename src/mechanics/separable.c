/* Fields of separable systems: (velocity(p), force(q)). */
#include "liegrad/ops.h"
#include "mechanics/system.h"

lg_status lg_separable_field(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system *system = ((const lg_system_user *)user)->system;
    const size_t n = system->space.dim / 2;
    LG_TRY(system->row->velocity(user, t, y + n, input, out));
    return system->row->force(user, t, y, input, out + n);
}

lg_status lg_separable_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                             lg_var input, lg_var parameters, lg_var *algebra) {
    const uint32_t n = (uint32_t)system->space.dim / 2;
    const lg_system_row *row = system->row;
    lg_var half[2] = {LG_NONE, LG_NONE};
    lg_var p = lg_slice(tape, y[0], -1, n, n);
    LG_TRY(row->taped_velocity(system, tape, t, p, input, parameters, &half[0]));
    lg_var q = lg_slice(tape, y[0], -1, 0, n);
    LG_TRY(row->taped_force(system, tape, t, q, input, parameters, &half[1]));
    algebra[0] = lg_concat(tape, half, 2, -1);
    return lg_tape_status(tape);
}
