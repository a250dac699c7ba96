/* Deviations from means, covariances, and the root of a covariance. */
#ifndef LG_COVARIANCE_H
#define LG_COVARIANCE_H

#include "liegrad/ops.h"

/* Rows of n numbers are cut into `parts` parts; part p begins at floor(p n/parts). Means are those of a part.
 * Neither an offset nor a constant leaves rounding errors. A batch of one is used for all of another one. */

/* Covariances (B, m, parts) of x and z (B, m, n), times the squares of s (m), a constant. Where s is 0,
 * nothing is computed. */
LG_API lg_var lg_covariance(lg_tape *tape, lg_var x, lg_var s, lg_var z, uint32_t parts);
/* The deviations of x (B, m, n) from their means, times s (B, m, parts) over the parts' lengths. */
LG_API lg_var lg_centre(lg_tape *tape, lg_var x, lg_var s);
/* The symmetric root (B, m, m) of the covariance of x (B, m, n) with rows times `factor` (m), a constant.
 * Each singular value of the centred rows is as accurate as the largest one. The derivative is 0 within the
 * null space of the covariance, which belongs to singular values below 2^-22 + m eps of the largest. */
LG_API lg_var lg_covariance_root(lg_tape *tape, lg_var x, lg_var factor);

#endif
