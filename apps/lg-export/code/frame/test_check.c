/* Every quantity is computed twice for every golden vector, in two work memories with different contents:
 * both must give the same bits. Its error is |got - want| / max(|want|, root mean square of |want| over the
 * vectors), in Euclidean norms. Returns 0 when no error exceeds NAME_TOLERANCE, otherwise 1. */

typedef void (*quantity)(const real *x, real *out, real *work);

static double mean_norm(const real *want, int size) {
    double sum = 0;
    int v;
    for (v = 0; v < GOLDEN; v++) sum += norm(want + v * size, size) * norm(want + v * size, size);
    return sqrt(sum / (double)GOLDEN);
}

/* 1 when it is wrong. */
static int check(const char *name, quantity compute, const real *want, int size) {
    static real got[LARGEST], again[LARGEST], work[2][NAME_WORK_SIZE];
    const double mean = mean_norm(want, size);
    double worst = 0;
    int v, near = 1, same = 1;
    for (v = 0; v < GOLDEN; v++) {
        const double own = norm(want + v * size, size), scale = own > mean ? own : mean;
        double error;
        fill(work[0], NAME_WORK_SIZE, (real)NAN);
        fill(work[1], NAME_WORK_SIZE, (real)1e30);
        fill(got, size, (real)NAN);
        fill(again, size, (real)NAN);
        compute(golden_x + v * NAME_INPUTS, got, work[0]);
        compute(golden_x + v * NAME_INPUTS, again, work[1]);
        if (memcmp(got, again, (size_t)size * sizeof(real)) != 0) same = 0;
        error = distance(got, want + v * size, size);
        if (scale > 0) error /= scale;
        if (!(error <= (double)NAME_TOLERANCE)) near = 0;
        if (!(error <= worst)) worst = error;
    }
    printf("%-24s error %8.2e  tolerance %8.2e  %s\n", name, worst, (double)NAME_TOLERANCE,
           !near   ? "WRONG"
           : !same ? "DEPENDS ON THE CONTENTS OF WORK"
                   : "ok");
    return !near || !same;
}
