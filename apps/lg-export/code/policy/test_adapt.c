/* The adaptation, along a run of the library on a plant with more damping and an offset: what it finds must
 * be what the library finds, in parts of the ranges. */
static int check_adaptation(void) {
    static real work[NAME_WORK_SIZE], memory[NAME_ADAPT_SIZE];
    real found[NAME_FOUND];
    double worst = 0;
    int k, i;
    NAME_adapt_start(memory);
    for (k = 0; k < ADAPTATIONS; k++) {
        const real *x = golden_moved + k * (GIVEN + VELOCITIES);
        fill(work, NAME_WORK_SIZE, (real)NAN);
        NAME_adapt(x, golden_moved_by + k * INPUT, x + GIVEN + VELOCITIES, memory, found, work);
    }
    for (i = 0; i < NAME_FOUND; i++) {
        const double away = fabs((double)found[i] - golden_found[i]) / golden_range[i];
        if (!(away <= worst)) worst = away;
    }
    printf("%-16s %-16s error %8.2e  tolerance %8.2e  %s\n", "adapt", "found", worst, ADAPT_TOLERANCE,
           worst <= ADAPT_TOLERANCE ? "ok" : "WRONG");
    return !(worst <= ADAPT_TOLERANCE);
}
