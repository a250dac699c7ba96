/* Declarations that the training losses of the surrogates share. */
#ifndef LG_SURROGATE_LOSS_H
#define LG_SURROGATE_LOSS_H

#include "elastica/surrogate_internal.h"

/* The samples of a batch whose loss is recorded together. */
typedef struct lg_loss_part {
    const lg_surrogate_problem *problem;
    lg_tape *tape;
    const uint32_t *samples;
    size_t count;
} lg_loss_part;

/* A training curve; sign is -1 if the network sees its mirror image. */
typedef struct lg_loss_curve {
    const double *x, *q, *v;
    double sign;
} lg_loss_curve;

/* The loss of a network of each kind: the mean over the samples. */
lg_var lg_loss_discrete(const lg_loss_part *b, lg_var theta);
lg_var lg_loss_continuous(const lg_loss_part *b, lg_var theta);
lg_var lg_loss_angle(const lg_loss_part *b, lg_var theta);

/* Whether the loss has a term that needs whole curves and their turning. */
bool lg_loss_has_mechanics(const lg_surrogate *model);
/* Whether a sample is a point of a curve; otherwise it is a curve. */
bool lg_loss_samples_are_points(const lg_surrogate *model);

extern const double lg_loss_origin[2]; /* zeros */
lg_loss_curve lg_loss_curve_at(const lg_loss_part *b, size_t i);
lg_var lg_loss_mean_square(lg_tape *tape, lg_var d);
lg_var lg_loss_add(const lg_loss_part *b, lg_var sum, double weight, lg_var term); /* sum + weight * term */
/* Adds weight times the residual of curves: turning, x and y at n points, (B, n) each. */
lg_var lg_loss_add_residual(const lg_loss_part *b, lg_var sum, lg_var turning, lg_var x, lg_var y);
/* Adds weight times the mean energy of a network of s, above the known energy. energies (B, 1). */
lg_var lg_loss_add_energy(const lg_loss_part *b, lg_var sum, lg_var energies);
/* Writes points (n, 2) of a curve, relative to `start` and mirrored for sign = -1, to values[at ...]. */
void lg_loss_put_points(const lg_loss_part *b, void *values, size_t at, const double *points, size_t n,
                        const double *start, double sign);
/* Writes the network's inputs for the curve, at arc length s, to row `row` of values. */
void lg_loss_put_row(const lg_loss_part *b, void *values, size_t row, const lg_loss_curve *c, double s);
/* Arc length of node k of the training data, whose N may differ from the model's for networks of a continuous
 * s. */
double lg_loss_node_of_data(const lg_loss_part *b, uint32_t k);
/* qN - q0 of the curves, reflected if the network sees the mirror image: (B, 2). */
lg_var lg_loss_chords(const lg_loss_part *b);
/* The forces in the curves of the data (B, 2), as the network sees them. */
lg_var lg_loss_forces(const lg_loss_part *b);

#endif
