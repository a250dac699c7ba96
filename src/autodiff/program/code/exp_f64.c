#include <stdint.h>
#include <string.h>

/* exp(x) = 2^n exp(r) with x = n ln 2 + r, |r| <= ln(2)/2. The code has no branches, so that compilers
 * vectorise loops over it. Adding 1.5 2^52 rounds to a whole number, which is then in the low bits of the
 * sum. ln 2 is subtracted in two parts; n times the first part is exact. The error is at most 3 units in the
 * last place. */
#define EXP_ROUND    6755399441055744.0
#define EXP_PER_LN2  1.4426950408889634
#define EXP_LN2_HIGH 6.93147180369123816490e-01
#define EXP_LN2_LOW  1.90821492927058770002e-10
#define EXP_BITS     uint64_t /* of a number: exponent n is stored as n + bias */
#define EXP_BIAS     1023u
#define EXP_SHIFT    52
/* exp(-EXP_LEAST) is 0. Multiplying by 2^EXP_LIFT keeps the power of two in the range of normal numbers;
 * EXP_LOWER = 2^-EXP_LIFT undoes it. */
#define EXP_LEAST 750.0
#define EXP_LIFT  100
#define EXP_LOWER 7.888609052210118e-31

/* exp(r) - 1 = r + r^2/2 + r^3 p(r), where p is a Chebyshev fit on |r| <= 0.3475. */
static inline real exp_core(real r) {
    real p = 2.5095778714723427e-8;
    p = p * r + 2.7614098187529960e-7;
    p = p * r + 2.7557279662257570e-6;
    p = p * r + 2.4801535862366182e-5;
    p = p * r + 1.9841269854541738e-4;
    p = p * r + 1.3888888906145675e-3;
    p = p * r + 8.3333333333321313e-3;
    p = p * r + 4.1666666666651037e-2;
    p = p * r + 1.6666666666666667e-1;
    p = p * r + 0.5;
    return p * (r * r) + r;
}
