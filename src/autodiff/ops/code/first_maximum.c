/* Offset in x of the first maximum of n numbers with the stride `apart`; NaN counts as the maximum. */
static int first_maximum(int n, int apart, const real *x) {
    int best = 0;
    for (int l = 1; l < n && x[best] == x[best]; l++) {
        const real next = x[l * apart];
        if (next > x[best] || next != next) best = l * apart;
    }
    return best;
}
