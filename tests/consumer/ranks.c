/* Ranks of MPI in a program outside the tree: each rank tells its number. */
#include <liegrad/core.h>
#include <stdio.h>

int main(void) {
    lg_error error = {LG_OK, ""};
    lg_ranks ranks;
    uint32_t numbers[64] = {0};
    size_t bytes[64];
    if (lg_mpi_begin(NULL, NULL, 30, &ranks, &error) != LG_OK || ranks.count > 64) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    for (uint32_t r = 0; r < ranks.count; r++) bytes[r] = sizeof numbers[0];
    numbers[ranks.rank] = 10 + ranks.rank;
    const lg_status status = ranks.gather(ranks.user, numbers, bytes);
    for (uint32_t r = 0; r < ranks.count; r++)
        if (status != LG_OK || numbers[r] != 10 + r) return 1;
    const uint32_t rank = ranks.rank, count = ranks.count;
    if (lg_mpi_end(&ranks, &error) != LG_OK) return 1;
    (void)printf("rank %u of %u\n", rank, count);
    return 0;
}
