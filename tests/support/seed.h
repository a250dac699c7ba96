/* Random sweeps draw anew for each commit: a number of LG_SEED, otherwise the time of the last commit. */
#ifndef LG_TEST_SEED_H
#define LG_TEST_SEED_H

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

static inline uint64_t commit_seed(void) {
    static uint64_t seed;
    if (seed > 0) return seed;
    seed = 1;
    const char *given = getenv("LG_SEED");
    FILE *git = given == NULL ? popen("git log -1 --format=%ct 2>/dev/null", "r") : NULL;
    if (given != NULL) seed = strtoull(given, NULL, 10);
    if (git != NULL) {
        if (fscanf(git, "%" SCNu64, &seed) != 1) seed = 1;
        (void)pclose(git);
    }
    (void)printf("LG_SEED=%" PRIu64 "\n", seed);
    return seed;
}

#endif
