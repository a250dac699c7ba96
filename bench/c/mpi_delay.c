/* Simulates a slower network for bench/scale. It is loaded before MPI (LD_PRELOAD). Each MPI_Allgatherv takes
 * MPI_DELAY seconds longer, and bytes from other ranks arrive at MPI_BANDWIDTH bytes per second. */
#define _GNU_SOURCE
#include <mpi.h>
#include <stdlib.h>
#include <time.h>

static double number(const char *name) {
    const char *text = getenv(name);
    return text != NULL ? atof(text) : 0.0;
}

/* Sleeps until the last 100 microseconds, and polls the clock from then on. */
static void wait_for(double seconds) {
    struct timespec now, end;
    clock_gettime(CLOCK_MONOTONIC, &end);
    const double at = (double)end.tv_nsec + 1e9 * seconds;
    end.tv_sec += (time_t)(at / 1e9);
    end.tv_nsec = (long)(at - 1e9 * (double)(time_t)(at / 1e9));
    if (seconds > 2e-4) {
        struct timespec early = end;
        early.tv_nsec -= 100000;
        if (early.tv_nsec < 0) early.tv_nsec += 1000000000, early.tv_sec--;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &early, NULL);
    }
    do clock_gettime(CLOCK_MONOTONIC, &now);
    while (now.tv_sec < end.tv_sec || (now.tv_sec == end.tv_sec && now.tv_nsec < end.tv_nsec));
}

int MPI_Allgatherv(const void *send, int count, MPI_Datatype type, void *receive, const int *counts,
                   const int *offsets, MPI_Datatype receive_type, MPI_Comm comm) {
    int ranks, rank;
    double bytes = 0.0;
    const double delay = number("MPI_DELAY"), bandwidth = number("MPI_BANDWIDTH");
    PMPI_Comm_size(comm, &ranks);
    PMPI_Comm_rank(comm, &rank);
    for (int r = 0; r < ranks; r++) bytes += r == rank ? 0.0 : counts[r];
    const int code = PMPI_Allgatherv(send, count, type, receive, counts, offsets, receive_type, comm);
    if (delay > 0.0 || bandwidth > 0.0) wait_for(delay + (bandwidth > 0.0 ? bytes / bandwidth : 0.0));
    return code;
}
