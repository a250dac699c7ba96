/* NaN where one of them is. */
static real larger(real a, real b) {
    return a != a || a >= b ? a : b;
}
