/* 2^(n + lift), made by setting the exponent bits; s = EXP_ROUND + n. */
static inline real exp_power(real s, unsigned lift) {
    EXP_BITS bits;
    real power;
    memcpy(&bits, &s, sizeof bits);
    bits = (bits + EXP_BIAS + lift) << EXP_SHIFT;
    memcpy(&power, &bits, sizeof power);
    return power;
}
