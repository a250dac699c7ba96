/* tanh(|x|) = t/(t + 2) with t = exp(2 |x|) - 1 = 2^n (exp(r) - 1) + (2^n - 1). For |x| > 22 it is 1. */
static inline real tanh_of(real x) {
    real a = FABS(x) * REAL(2.0);
    a = a > REAL(44.0) ? REAL(44.0) : a;
    const real s = a * EXP_PER_LN2 + EXP_ROUND, n = s - EXP_ROUND;
    const real power = exp_power(s, 0), r = (a - n * EXP_LN2_HIGH) - n * EXP_LN2_LOW;
    const real t = power * exp_core(r) + (power - REAL(1.0)), y = t / (t + REAL(2.0));
    return x < REAL(0.0) ? -y : y;
}
