/* The observer, along a run of the library with noisy measurements: all estimates must be the library's.
 * Errors are relative to the root mean square of the estimates. */
static int check_observer(void) {
    static real work[NAME_WORK_SIZE], memory[NAME_OBSERVE_SIZE];
    real x[GIVEN + VELOCITIES];
    double square = 0, worst = 0;
    int i, k;
    NAME_observe_start(golden_seen, memory);
    for (i = 0; i < OBSERVATIONS * (GIVEN + VELOCITIES); i++)
        square += golden_estimate[i] * golden_estimate[i] / OBSERVATIONS;
    for (k = 0; k < OBSERVATIONS; k++) {
        double sum = 0;
        fill(work, NAME_WORK_SIZE, (real)NAN);
        NAME_observe(golden_seen + (k + 1) * GIVEN, golden_held + k * INPUT, memory, x, work);
        for (i = 0; i < GIVEN + VELOCITIES; i++) {
            const double away = (double)x[i] - golden_estimate[k * (GIVEN + VELOCITIES) + i];
            sum += away * away;
        }
        sum = sqrt(sum / square);
        if (!(sum <= worst)) worst = sum;
    }
    printf("%-16s %-16s error %8.2e  tolerance %8.2e  %s\n", "observe", "x", worst, OBSERVE_TOLERANCE,
           worst <= OBSERVE_TOLERANCE ? "ok" : "WRONG");
    return !(worst <= OBSERVE_TOLERANCE);
}
