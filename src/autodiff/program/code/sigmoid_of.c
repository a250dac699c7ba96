/* The sigmoid of x: 1/(1 + e) for x >= 0, e/(1 + e) for x < 0, with e = exp(-|x|). */
static inline real sigmoid_of(real x) {
    real a = FABS(x);
    a = a > EXP_LEAST ? EXP_LEAST : a;
    const real s = EXP_ROUND - a * EXP_PER_LN2, n = s - EXP_ROUND;
    const real r = (-a - n * EXP_LN2_HIGH) - n * EXP_LN2_LOW;
    const real e = (REAL(1.0) + exp_core(r)) * exp_power(s, EXP_LIFT) * EXP_LOWER;
    return (x >= REAL(0.0) ? REAL(1.0) : e) / (REAL(1.0) + e);
}
