/* The maximum of a and b, or NaN if one of them is NaN. */
static real larger(real a, real b) {
    return a != a || a >= b ? a : b;
}
