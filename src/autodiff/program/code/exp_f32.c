#include <stdint.h>
#include <string.h>

/* exp(x) = 2^n exp(r) with x = n ln 2 + r, |r| <= ln(2)/2. The code has no branches, so that compilers
 * vectorise loops over it. Adding 1.5 2^23 rounds to a whole number, which is then in the low bits of the
 * sum. ln 2 is subtracted in two parts; n times the first part is exact. The error is at most 3 units in the
 * last place. */
#define EXP_ROUND    12582912.0f
#define EXP_PER_LN2  1.44269504f
#define EXP_LN2_HIGH 0.693359375f
#define EXP_LN2_LOW  (-2.12194440e-4f)
#define EXP_BITS     uint32_t /* of a number: exponent n is stored as n + bias */
#define EXP_BIAS     127u
#define EXP_SHIFT    23
/* exp(-EXP_LEAST) is 0. Multiplying by 2^EXP_LIFT keeps the power of two in the range of normal numbers;
 * EXP_LOWER = 2^-EXP_LIFT undoes it. */
#define EXP_LEAST 110.0f
#define EXP_LIFT  40
#define EXP_LOWER 9.09494702e-13f

/* exp(r) - 1 = r + r^2/2 + r^3 p(r), where p is a Chebyshev fit on |r| <= 0.3475. */
static inline real exp_core(real r) {
    real p = 1.988291202e-4f;
    p = p * r + 1.39263759958e-3f;
    p = p * r + 8.3333207585e-3f;
    p = p * r + 4.16665534587e-2f;
    p = p * r + 1.66666666667e-1f;
    p = p * r + 0.5f;
    return p * (r * r) + r;
}
