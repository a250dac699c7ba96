/* The closed loop: PATHS segments of paths. The plant, in double precision, moves for SEGMENT periods
 * under NAME_control, and must arrive where the library does. Where an input is outside its limits,
 * nothing does. */
static int outside(const real *u) {
    int i, out = 0;
    for (i = 0; i < NAME_OUTPUTS; i++) {
        const double low = golden_limits[2 * i], high = golden_limits[2 * i + 1],
                     room = 4 * EPSILON * (high - low);
        if (!((double)u[i] >= low - room && (double)u[i] <= high + room)) out = 1;
    }
    return out;
}

static void run_loop(const real *x, real *y, int only, real *work) {
    static double moving[NAME_plant_WORK_SIZE + 1];
    double at[STATE], next[STATE], sensed[NAME_INPUTS], held[NAME_OUTPUTS];
    real seen[NAME_INPUTS], u[NAME_OUTPUTS];
    int i, k, p;
    (void)only;
    for (p = 0; p < PATHS; p++, x += STATE, y += STATE) {
        int wrong = 0;
        for (i = 0; i < STATE; i++) at[i] = (double)x[i];
        for (k = 0; k < SEGMENT; k++) {
            NAME_plant_sensed_by_control(at, sensed, moving);
            for (i = 0; i < NAME_INPUTS; i++) seen[i] = (real)sensed[i];
            NAME_control(seen, u, work);
            wrong += outside(u);
            for (i = 0; i < NAME_OUTPUTS; i++) held[i] = (double)u[i];
            NAME_plant_period(at, held, next, moving);
            memcpy(at, next, sizeof at);
        }
        for (i = 0; i < STATE; i++) y[i] = wrong > 0 ? (real)NAN : (real)at[i];
    }
}
static const result outputs_of_loop[] = {{"x", 0, 0, PATHS *STATE}, {NULL, 0, 0, 0}};
