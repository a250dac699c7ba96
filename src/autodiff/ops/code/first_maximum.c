/* Where the largest of n numbers so far apart lies: the first of equals; a NaN is larger than all. */
static int first_maximum(int n, int apart, const real *x) {
    int best = 0;
    for (int l = 1; l < n && x[best] == x[best]; l++) {
        const real next = x[l * apart];
        if (next > x[best] || next != next) best = l * apart;
    }
    return best;
}
