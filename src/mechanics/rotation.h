/* Products with a rotation R that is part of a system's state. On a tape R has shape (B, 1, 9), vectors have
 * shape (B, 1, 3).
 */
#ifndef LG_ROTATION_H
#define LG_ROTATION_H

#include "liegrad/ops.h"

/* 1/2 sum_i x_i^2 / inertia_i */
static inline double lg_body_energy(const double inertia[3], const double body_momentum[3]) {
    double sum = 0.0;
    for (int i = 0; i < 3; i++) sum += body_momentum[i] * body_momentum[i] / inertia[i];
    return 0.5 * sum;
}

static inline lg_var lg_taped_matrix(lg_tape *tape, lg_var R) {
    return lg_reshape(tape, R, lg_shape3(lg_var_shape(tape, R).dims[0], 3, 3));
}

static inline lg_var lg_taped_rotate(lg_tape *tape, lg_var R, lg_var x) {
    return lg_matmul_nt(tape, x, lg_taped_matrix(tape, R));
}

static inline lg_var lg_taped_rotate_back(lg_tape *tape, lg_var R, lg_var x) {
    return lg_matmul(tape, x, lg_taped_matrix(tape, R));
}

static inline lg_var lg_taped_body_velocity(lg_tape *tape, lg_var inertia, lg_var R, lg_var pi) {
    return lg_taped_rotate(tape, R, lg_div(tape, lg_taped_rotate_back(tape, R, pi), inertia));
}

/* Broadcasts x to the shape of `like`. */
static inline lg_var lg_taped_spread(lg_tape *tape, lg_var x, lg_var like) {
    return lg_broadcast_to(tape, x, lg_var_shape(tape, like));
}

#endif
