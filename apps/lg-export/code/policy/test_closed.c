/* The closed loop: PATHS segments of paths. The plant, in double precision, moves for SEGMENT periods
 * under NAME_control, and must arrive where the library does. Where an input is outside its limits,
 * nothing does. */
#ifdef ROTATIONS
/* The quaternion w x y z of a rotation. The largest number of it is found first. */
static void to_quaternion(const double *R, real *q) {
    const double trace = R[0] + R[4] + R[8];
    double big = trace, p[4];
    int i, first = -1;
    for (i = 0; i < 3; i++)
        if (R[4 * i] > big) big = R[4 * i], first = i;
    if (first < 0) {
        p[0] = 1 + trace;
        for (i = 0; i < 3; i++)
            p[1 + i] = R[3 * ((i + 2) % 3) + (i + 1) % 3] - R[3 * ((i + 1) % 3) + (i + 2) % 3];
    } else {
        const int j = (first + 1) % 3, k = (first + 2) % 3;
        p[0] = R[3 * k + j] - R[3 * j + k];
        p[1 + first] = 1 + 2 * R[4 * first] - trace;
        p[1 + j] = R[3 * j + first] + R[3 * first + j];
        p[1 + k] = R[3 * k + first] + R[3 * first + k];
    }
    big = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3]);
    for (i = 0; i < 4; i++) q[i] = (real)(p[i] / big);
}
#endif

/* What the controller sees of the state x. */
static void see(const double *x, real *seen, double *work) {
    double q[POSITIONS];
    int i, k, at = 0;
#ifdef MOVES
    double v[VELOCITIES];
    NAME_plant_positions(x, q, work);
    NAME_plant_velocities(x, v, work);
    for (i = 0; i < VELOCITIES; i++) seen[GIVEN + i] = (real)v[i];
#else
    (void)work;
    memcpy(q, x, sizeof q);
#endif
    for (i = 0; i < COORDINATES; at += golden_motion[i++]) {
#ifdef ROTATIONS
        if (golden_motion[i] == 9) {
            to_quaternion(q + at, seen);
            seen += 4;
            continue;
        }
#endif
        for (k = 0; k < golden_motion[i]; k++) *seen++ = (real)q[at + k];
    }
}

static int outside(const real *u) {
    int i, out = 0;
    for (i = 0; i < INPUT; i++) {
        const double low = golden_limits[2 * i], high = golden_limits[2 * i + 1],
                     room = 4 * EPSILON * (high - low);
        if (!((double)u[i] >= low - room && (double)u[i] <= high + room)) out = 1;
    }
    return out;
}

static void run_loop(const real *x, real *y, int only, real *work) {
    static double moving[NAME_plant_WORK_SIZE + 1];
    double at[STATE], next[STATE], held[INPUT];
    real seen[GIVEN + VELOCITIES], u[INPUT];
    int i, k, p;
    (void)only;
    for (p = 0; p < PATHS; p++, x += STATE, y += STATE) {
        int wrong = 0;
        for (i = 0; i < STATE; i++) at[i] = (double)x[i];
        for (k = 0; k < SEGMENT; k++) {
            see(at, seen, moving);
            NAME_control(seen, u, work);
            wrong += outside(u);
            for (i = 0; i < INPUT; i++) held[i] = (double)u[i];
            NAME_plant_period(at, held, next, moving);
            memcpy(at, next, sizeof at);
        }
        for (i = 0; i < STATE; i++) y[i] = wrong > 0 ? (real)NAN : (real)at[i];
    }
}
static const result outputs_of_loop[] = {{"x", 0, 0, PATHS *STATE}, {NULL, 0, 0, 0}};
