/* Derivatives of tanh and of the sigmoid, written as products over their zeros.
 *
 * With h = tanh x the n-th derivative is
 *
 *     tanh^(n) = (1 - h^2) n! (-h)^p prod_k (h^2 - z_k),   p = (n - 1) mod 2,   k < (n - 1)/2,
 *
 * and all zeros z_k lie in (0, 1). A sum of powers of h would suffer from cancellation: at order 8 its terms
 * cancel to 1e-14 of the derivative. A factor h^2 - z_k is as exact as its condition allows if it is computed
 * as (h^2 - 1) - (z_k - 1) for z_k > 1/2, where 1 - h^2 = (1 - h) (1 + h) has no cancellation.
 *
 * Since s = sigmoid(x) = (1 + tanh(x/2))/2, the n-th derivative of the sigmoid is 2^(1-n)/4 times the same
 * product with h = tanh(x/2), for which -h = 1 - 2 s and 1 - h^2 = 4 s (1 - s).
 */
#ifndef LG_ACT_ZEROS_H
#define LG_ACT_ZEROS_H

#include "kernels/kernels.h"

static const double lg_act_factorial[LG_K_ACT_ORDERS + 1] = {1, 1, 2, 6, 24, 120, 720, 5040, 40320};

/* Row n holds the zeros of the n-th derivative. A zero z_k above 1/2 is stored as z_k - 1, which is negative.
 * Computed with mpmath, 60 digits. */
static const double lg_act_zeros[LG_K_ACT_ORDERS + 1][3] = {
    {0},
    {0},
    {0},
    {0.333333333333333333},
    {-0.333333333333333333},
    {0.158434974468013387, -0.158434974468013387},
    {0.408467776919505541, -0.0751344435861722077},
    {0.0916234188706026031, -0.389022483921496148, -0.0359342682824397889},
    {0.266911073642956747, -0.249558649260507488, -0.0173524243824492587},
};

#endif
