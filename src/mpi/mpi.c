/* Implements lg_ranks with MPI. Counts of MPI are of type int, so longer messages are split into rounds. */
#include "liegrad/core.h"

#include <mpi.h>
#include <stdio.h>
#include <string.h>

#include "core/core.h"

/* Largest number of bytes per MPI call. If all ranks together send as much or more, gather broadcasts rank by
 * rank. */
#define ROUND ((size_t)1 << 30)

typedef struct link {
    MPI_Comm comm;
    int *counts, *offsets; /* (number of ranks) */
    bool finalise;
} link;

static lg_status status_of(int code) {
    return code == MPI_SUCCESS ? LG_OK : LG_FILE;
}

static size_t total_of(const size_t *bytes, uint32_t count) {
    size_t total = 0;
    for (uint32_t r = 0; r < count; r++) total += bytes[r];
    return total;
}

static void set_counts(link *l, uint32_t count, const size_t *bytes) {
    int at = 0;
    for (uint32_t r = 0; r < count; r++) {
        l->counts[r] = (int)bytes[r];
        l->offsets[r] = at;
        at += l->counts[r];
    }
}

/* Gathers messages that are too long for MPI_Allgatherv: each rank in turn broadcasts its part of `all` to
 * the same place on the other ranks. */
static lg_status gather_in_rounds(const link *l, char *all, const size_t *bytes, uint32_t count) {
    size_t at = 0;
    for (uint32_t r = 0; r < count; at += bytes[r++])
        for (size_t done = 0; done < bytes[r]; done += ROUND) {
            const size_t length = bytes[r] - done < ROUND ? bytes[r] - done : ROUND;
            LG_TRY(status_of(MPI_Bcast(all + at + done, (int)length, MPI_BYTE, (int)r, l->comm)));
        }
    return LG_OK;
}

static lg_status gather(void *user, void *all, const size_t *bytes) {
    link *l = user;
    int count;
    (void)MPI_Comm_size(l->comm, &count);
    if (total_of(bytes, (uint32_t)count) >= ROUND) return gather_in_rounds(l, all, bytes, (uint32_t)count);
    set_counts(l, (uint32_t)count, bytes);
    return status_of(
        MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, all, l->counts, l->offsets, MPI_BYTE, l->comm));
}

static lg_status receive_in_rounds(const link *l, char *to, size_t bytes, int from) {
    for (size_t done = 0; done < bytes; done += ROUND) {
        const size_t length = bytes - done < ROUND ? bytes - done : ROUND;
        LG_TRY(status_of(MPI_Recv(to + done, (int)length, MPI_BYTE, from, 0, l->comm, MPI_STATUS_IGNORE)));
    }
    return LG_OK;
}

static lg_status collect(void *user, const void *mine, void *all, const size_t *bytes) {
    link *l = user;
    int count, rank;
    (void)MPI_Comm_size(l->comm, &count);
    (void)MPI_Comm_rank(l->comm, &rank);
    if (rank > 0) {
        for (size_t done = 0; done < bytes[rank]; done += ROUND) {
            const size_t length = bytes[rank] - done < ROUND ? bytes[rank] - done : ROUND;
            LG_TRY(status_of(MPI_Send((const char *)mine + done, (int)length, MPI_BYTE, 0, 0, l->comm)));
        }
        return LG_OK;
    }
    char *at = all;
    if (at != mine && bytes[0] > 0) memcpy(at, mine, bytes[0]);
    for (int r = 1; r < count; r++) {
        at += bytes[r - 1];
        LG_TRY(receive_in_rounds(l, at, bytes[r], r));
    }
    return LG_OK;
}

static lg_status compare(const lg_ranks *ranks, lg_error *error) {
    char mine[256] = "", first[256] = "", cpu[192];
    (void)lg_cpu_describe(cpu, sizeof cpu);
    (void)snprintf(mine, sizeof mine, "liegrad %s, %s", lg_version(), cpu);
    memcpy(first, mine, sizeof first);
    LG_TRY(lg_ranks_share(ranks, 0, first, sizeof first));
    lg_status status = LG_OK;
    if (strcmp(mine, first) != 0)
        status =
            lg_fail(error, LG_INVALID_ARGUMENT,
                    "ranks must be of one kind, or bits differ: rank 0 has %s, this one %s", first, mine);
    return lg_ranks_agree(ranks, status, error);
}

static void release(lg_ranks *ranks) {
    link *l = ranks->user;
    (void)MPI_Comm_free(&l->comm);
    lg_free(NULL, l->counts);
    lg_free(NULL, l);
    *ranks = (lg_ranks){.size = sizeof *ranks};
}

static lg_status join(const void *communicator, lg_ranks *out, lg_error *error) {
    int rank, count;
    link *l = lg_alloc(NULL, 1, sizeof *l);
    if (l == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the ranks");
    MPI_Comm from = MPI_COMM_WORLD;
    if (communicator != NULL) memcpy(&from, communicator, sizeof from);
    (void)MPI_Comm_dup(from, &l->comm);
    (void)MPI_Comm_rank(l->comm, &rank);
    (void)MPI_Comm_size(l->comm, &count);
    l->counts = lg_alloc(NULL, 2 * (size_t)count, sizeof *l->counts);
    lg_ranks made = {sizeof made, (uint32_t)rank, (uint32_t)count, l, gather, collect};
    if (l->counts == NULL) {
        release(&made);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %d ranks", count);
    }
    l->offsets = l->counts + count;
    const lg_status status = compare(&made, error);
    if (status != LG_OK) {
        release(&made);
        return status;
    }
    *out = made;
    return LG_OK;
}

lg_status lg_mpi_begin(const void *communicator, lg_ranks *out, lg_error *error) {
    int initialised = 0, provided = 0;
    (void)MPI_Initialized(&initialised);
    if (out == NULL || (communicator != NULL && !initialised))
        return lg_fail(error, LG_INVALID_ARGUMENT, "there is no output, or MPI has not been initialised");
    if (!initialised && MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS)
        return lg_fail(error, LG_FILE, "MPI could not be initialised");
    LG_TRY(join(communicator, out, error));
    ((link *)out->user)->finalise = !initialised;
    return LG_OK;
}

void lg_mpi_end(lg_ranks *ranks) {
    if (ranks->user == NULL) return;
    const bool finalise = ((const link *)ranks->user)->finalise;
    release(ranks);
    if (finalise) (void)MPI_Finalize();
}

void lg_mpi_abort(int code) {
    (void)MPI_Abort(MPI_COMM_WORLD, code);
}
