/* A second implementation of the riser from its energies. It uses nothing of the library's assembly. */
#ifndef RISER_CHECK_H
#define RISER_CHECK_H

#include <math.h>
#include <stddef.h>

#include "liegrad/anomaly.h"

#define RISER_PI 3.14159265358979323846

/* The offsets of the flex joint, of nodes 1..12 and of the top, computed from the degrees of freedom. */
static inline void riser_shape(const lg_riser_parameters *p, const double *q, double y[LG_RISER_NODES + 2]) {
    y[0] = q[0] + p->bop_height * q[1];
    for (int i = 1; i <= LG_RISER_NODES; i++) y[i] = q[i + 1];
    y[LG_RISER_NODES + 1] = 0.0;
}

static inline double riser_kinetic(const lg_riser_parameters *p, const double *v) {
    const double l = (p->depth - p->bop_height) / 13.0, D = p->hydro_diameter;
    const double lump = (p->riser_mass + p->rho * RISER_PI * D * D / 4.0 * p->added_mass) * l;
    const double centre = v[0] + p->bop_centre * v[1], m = p->bop_mass + p->bop_added_mass;
    double y[LG_RISER_NODES + 2];
    riser_shape(p, v, y);
    double sum = 0.5 * m * (centre * centre + p->bop_height * p->bop_height / 12.0 * v[1] * v[1]);
    for (int i = 0; i <= LG_RISER_NODES; i++) sum += 0.5 * (i == 0 ? 0.5 : 1.0) * lump * y[i] * y[i];
    return sum;
}

/* Energy of tension, bending and flex joint, of weight and tension of the BOP, of the wellhead spring k, of
 * the soil spring, and of the wires. */
static inline double riser_line_energy(const lg_riser_parameters *p, const double *q) {
    const double l = (p->depth - p->bop_height) / 13.0;
    double y[LG_RISER_NODES + 2], sum = 0.0;
    riser_shape(p, q, y);
    for (int i = 0; i < 13; i++) {
        const double z = p->bop_height + l * (i + 0.5), slope = (y[i + 1] - y[i]) / l;
        sum += 0.5 * (p->top_tension - p->submerged_weight * (p->depth - z)) * slope * slope * l;
    }
    for (int i = 1; i < 13; i++) {
        const double kappa = (y[i - 1] + y[i + 1] - 2.0 * y[i]) / (l * l);
        sum += 0.5 * p->bending_stiffness * kappa * kappa * l;
    }
    const double bend = (y[1] - y[0]) / l - q[1];
    return sum + 0.5 * p->flex_joint * bend * bend;
}

static inline double riser_potential(const lg_riser_parameters *p, double k, const double *q) {
    const double bottom = p->top_tension - p->submerged_weight * (p->depth - p->bop_height);
    return riser_line_energy(p, q) +
           0.5 * (bottom * p->bop_height - p->bop_weight * p->bop_centre + k) * q[1] * q[1] +
           0.5 * p->soil_stiffness * q[0] * q[0] +
           0.5 * p->relief_stiffness * pow(q[0] + p->relief_height * q[1], 2.0);
}

/* The matrix (n, n) of a quadratic form, into `out`. */
#define RISER_MATRIX(form, out)                                                                              \
    for (size_t i_ = 0; i_ < LG_RISER_DOF; i_++)                                                             \
        for (size_t j_ = 0; j_ < LG_RISER_DOF; j_++) {                                                       \
            double a_[LG_RISER_DOF] = {0.0}, b_[LG_RISER_DOF] = {0.0}, c_[LG_RISER_DOF] = {0.0}, x_, y_, s_; \
            a_[i_] = b_[j_] = 1.0;                                                                           \
            c_[i_] += 1.0;                                                                                   \
            c_[j_] += 1.0;                                                                                   \
            x_ = form(a_);                                                                                   \
            y_ = form(b_);                                                                                   \
            s_ = form(c_);                                                                                   \
            (out)[i_ * LG_RISER_DOF + j_] = s_ - x_ - y_;                                                    \
        }

#endif
