/* Measures what an exchange costs, for bench/scale: medians of the time of MPI_Allgatherv over all ranks.
 * Prints one line "bytes seconds" per message length, in bytes per rank. Between exchanges each rank computes
 * for 2 ms, as in training: after a barrier, TCP delays short messages by milliseconds. */
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    enum { ROUNDS = 60, MOST = 1 << 20 };
    int ranks, rank;
    MPI_Init(&argc, &argv);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    char *all = malloc((size_t)ranks * MOST);
    int *counts = malloc(2 * (size_t)ranks * sizeof *counts), *offsets = counts + ranks;
    const double work = 2e-3;
    double seconds[ROUNDS];
    for (int bytes = 64; bytes <= MOST; bytes *= 8) {
        for (int r = 0; r < ranks; r++) counts[r] = bytes, offsets[r] = r * bytes;
        const int rounds = bytes > 1 << 16 ? ROUNDS / 6 : ROUNDS;
        MPI_Barrier(MPI_COMM_WORLD);
        double last = MPI_Wtime();
        for (int i = 0; i < rounds; i++) {
            while (MPI_Wtime() < last + work) continue;
            MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, all, counts, offsets, MPI_BYTE,
                           MPI_COMM_WORLD);
            const double now = MPI_Wtime();
            seconds[i] = now - last - work;
            last = now;
        }
        qsort(seconds, (size_t)rounds, sizeof *seconds, by_value);
        if (rank == 0) printf("%d %.9f\n", bytes, seconds[rounds / 2]);
    }
    free(all);
    free(counts);
    MPI_Finalize();
    return 0;
}
