/* Implements lg_ranks with MPI. Counts of MPI are of type int, so longer messages are split into rounds.
 *
 * MPI itself waits for ever for a process that is stopped or dead. Here every exchange is nonblocking. Each
 * rank has a thread, the listener. Each second the listener of rank 0 sends a sign of life to each other
 * rank, and the listener of each other rank sends one to rank 0. A rank that sends no sign for `silence`
 * seconds is lost. So a rank may compute for hours between two exchanges, but it must be running. Rank 0
 * tells the other ranks whom it has lost. */
#include "liegrad/core.h"

#include <math.h>
#include <mpi.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "core/core.h"

/* Largest number of bytes per MPI call. If all ranks together send as much or more, gather broadcasts rank by
 * rank. */
#define ROUND ((size_t)1 << 30)

/* A sign of life is one int: ALIVE, LEAVING (the last one), or 1 + the rank that rank 0 has lost. */
enum { LEAVING = -1, ALIVE = 0 };
static const double tick = 1.0; /* s between two signs of life */

/* Another rank, with which this rank exchanges signs of life. */
typedef struct peer {
    int rank, heard, said;
    MPI_Request receiving, sending; /* MPI_REQUEST_NULL: nothing is under way */
    double silent;                  /* s since the last sign of life */
    bool left;                      /* the peer's listener has ended */
} peer;

typedef struct link {
    const lg_context *context;
    MPI_Comm comm;         /* of the exchanges */
    int *counts, *offsets; /* (number of ranks) */
    bool finalise;
    char reason[192]; /* why an exchange failed; then MPI is not called again, except for MPI_Abort */

    /* of the listener thread. A rank without MPI_THREAD_MULTIPLE has no listener. */
    bool listens;
    double silence;
    MPI_Comm signs;
    peer *peers;
    size_t peer_count;
    int rank;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    bool ending, quit;  /* under the mutex: leave as agreed with the peers, or at once */
    char lost_how[160]; /* written before `lost` is set */
    atomic_bool lost;   /* the listener has ended because a rank is lost */
} link;

/* ---- signs of life ---- */

static void nap(double seconds) {
    const struct timespec pause = {0, (long)(1e9 * seconds)};
    (void)nanosleep(&pause, NULL);
}

static void receive_sign(link *l, peer *p) {
    if (MPI_Irecv(&p->heard, 1, MPI_INT, p->rank, 0, l->signs, &p->receiving) != MPI_SUCCESS)
        p->silent = INFINITY;
}

/* Receives all signs that have arrived from the peer. If one of them names a lost rank, this sign is
 * returned, otherwise ALIVE. */
static int take_signs(link *l, peer *p) {
    int done = 1, lost = ALIVE;
    while (done && !p->left) {
        if (MPI_Test(&p->receiving, &done, MPI_STATUS_IGNORE) != MPI_SUCCESS) p->silent = INFINITY, done = 0;
        if (!done) break;
        p->silent = 0.0;
        p->left = p->heard == LEAVING;
        if (p->heard > ALIVE) lost = p->heard;
        if (!p->left) receive_sign(l, p);
    }
    return lost;
}

/* False: the sign before this one is still under way. */
static bool send_sign(link *l, peer *p, int sign) {
    int done = 0;
    if (MPI_Test(&p->sending, &done, MPI_STATUS_IGNORE) != MPI_SUCCESS || !done) return false;
    p->said = sign;
    return MPI_Isend(&p->said, 1, MPI_INT, p->rank, 0, l->signs, &p->sending) == MPI_SUCCESS;
}

/* Writes to lost_how why the rank is lost. `silent`: seconds of silence; 0 if rank 0 has told this rank of
 * the loss. */
static void tell_how(link *l, int rank, double silent) {
    if (rank == l->rank)
        (void)snprintf(l->lost_how, sizeof l->lost_how, "rank 0 has given this rank up, which was silent");
    else if (isinf(silent))
        (void)snprintf(l->lost_how, sizeof l->lost_how, "the connection to rank %d is broken", rank);
    else
        (void)snprintf(l->lost_how, sizeof l->lost_how,
                       "rank %d has given no sign of life%s for %ld s: it is stopped or dead, or not reached",
                       rank, silent == 0.0 ? " to rank 0" : "", (long)(silent == 0.0 ? l->silence : silent));
}

/* Marks a rank as lost. Rank 0 also sends the number of the lost rank to all other ranks, and waits up to a
 * second until MPI has sent it. */
static void lose(link *l, int rank, double silent) {
    enum { PAUSES = 20 };
    tell_how(l, rank, silent);
    for (size_t i = 0; l->rank == 0 && i < l->peer_count; i++) (void)send_sign(l, &l->peers[i], 1 + rank);
    for (int pause = 0, done = 0; l->rank == 0 && pause < PAUSES; pause++, nap(tick / PAUSES))
        for (size_t i = 0; i < l->peer_count; i++)
            (void)MPI_Test(&l->peers[i].sending, &done, MPI_STATUS_IGNORE);
    atomic_store(&l->lost, true);
}

/* Exchanges signs with all peers. `passed`: seconds since the last call. Returns false when the listener has
 * to end. */
static bool go_round(link *l, double passed, bool leaving) {
    bool ended = leaving;
    for (size_t i = 0; i < l->peer_count; i++) {
        peer *p = &l->peers[i];
        p->silent += passed;
        const int lost = take_signs(l, p);
        if (lost > ALIVE || (p->silent > l->silence && !p->left)) {
            lose(l, lost > ALIVE ? lost - 1 : p->rank, lost > ALIVE ? 0.0 : p->silent);
            return false;
        }
        if (p->said != LEAVING) (void)send_sign(l, p, leaving ? LEAVING : ALIVE);
        int sent = 0;
        if (p->said == LEAVING) (void)MPI_Test(&p->sending, &sent, MPI_STATUS_IGNORE);
        ended = ended && sent && p->left;
    }
    return !ended;
}

/* Waits for the next round. Returns false when the listener must end at once. */
static bool wait_for_round(link *l, bool *leaving) {
    struct timespec until;
    (void)clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += (time_t)tick;
    (void)pthread_mutex_lock(&l->mutex);
    if (!l->ending && !l->quit) (void)pthread_cond_timedwait(&l->wake, &l->mutex, &until);
    const bool quit = l->quit;
    *leaving = l->ending;
    (void)pthread_mutex_unlock(&l->mutex);
    if (*leaving) nap(1e-3);
    return !quit;
}

/* While this process or its machine was stopped, it could hear no peer. So at most two ticks of a round count
 * as silence of the peers. */
static void *listen_to_peers(void *user) {
    link *l = user;
    bool leaving = false;
    for (double before = lg_seconds(), now; wait_for_round(l, &leaving); before = now) {
        now = lg_seconds();
        if (!go_round(l, fmin(now - before, 2.0 * tick), leaving)) break;
    }
    return NULL;
}

/* Ends the listener thread. Without `at_once` the thread first waits until the listeners of all peers are
 * ready to end. */
static void stop_listening(link *l, bool at_once) {
    if (!l->listens) return;
    (void)pthread_mutex_lock(&l->mutex);
    l->ending = !at_once;
    l->quit = at_once;
    (void)pthread_cond_signal(&l->wake);
    (void)pthread_mutex_unlock(&l->mutex);
    (void)pthread_join(l->thread, NULL);
    l->listens = false;
}

/* ---- exchanges ---- */

/* After a failure MPI must not touch the buffers of the exchange, which belong to the caller. */
static lg_status give_up(link *l, lg_status status, const char *why) {
    (void)snprintf(l->reason, sizeof l->reason, "%s", why);
    stop_listening(l, true);
    return status;
}

static lg_status broken(link *l, int code) {
    char text[MPI_MAX_ERROR_STRING] = "";
    int length = 0;
    (void)MPI_Error_string(code, text, &length);
    return give_up(l, LG_FILE, text);
}

/* Seconds for which an exchange continues after the context was cancelled: half of the time between the
 * SIGTERM and the SIGKILL of mpirun. The caller saves its state in the other half. */
static double patience(void) {
    const char *text = getenv("OMPI_MCA_odls_base_sigkill_timeout");
    const double left = text != NULL ? (double)strtol(text, NULL, 10) : 1.0;
    return left > 0.0 ? 0.5 * left : 0.5;
}

/* Waits for the end of an operation that was started with this code. */
static lg_status complete(link *l, int code, MPI_Request *request) {
    static const double spin = 2e-2, rest = 2e-4; /* s: tests all the time at first, then sleeps */
    const double begin = lg_seconds();
    double asked = INFINITY;
    for (int done = 0;;) {
        if (code == MPI_SUCCESS) code = MPI_Test(request, &done, MPI_STATUS_IGNORE);
        if (code != MPI_SUCCESS) return broken(l, code);
        if (done) return LG_OK;
        if (atomic_load(&l->lost)) return give_up(l, LG_FILE, l->lost_how);
        const double now = lg_seconds();
        if (lg_cancelled(l->context)) asked = fmin(asked, now);
        if (now - asked > patience())
            return give_up(l, LG_CANCELLED, "not all ranks came to the exchange after the call to stop");
        if (now - begin > spin) nap(rest);
    }
}

static const char *reason(void *user) {
    const link *l = user;
    return l->reason[0] != '\0' ? l->reason : NULL;
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

/* Gathers messages that are too long for MPI_Iallgatherv: each rank in turn broadcasts its part of `all` to
 * the same place on the other ranks. */
static lg_status gather_in_rounds(link *l, char *all, const size_t *bytes, uint32_t count) {
    MPI_Request request = MPI_REQUEST_NULL;
    size_t at = 0;
    for (uint32_t r = 0; r < count; at += bytes[r++])
        for (size_t done = 0; done < bytes[r]; done += ROUND) {
            const size_t length = bytes[r] - done < ROUND ? bytes[r] - done : ROUND;
            const int code = MPI_Ibcast(all + at + done, (int)length, MPI_BYTE, (int)r, l->comm, &request);
            LG_TRY(complete(l, code, &request));
        }
    return LG_OK;
}

static lg_status gather(void *user, void *all, const size_t *bytes) {
    link *l = user;
    MPI_Request request = MPI_REQUEST_NULL;
    int count;
    if (l->reason[0] != '\0') return LG_FILE;
    (void)MPI_Comm_size(l->comm, &count);
    if (total_of(bytes, (uint32_t)count) >= ROUND) return gather_in_rounds(l, all, bytes, (uint32_t)count);
    set_counts(l, (uint32_t)count, bytes);
    const int code = MPI_Iallgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, all, l->counts, l->offsets, MPI_BYTE,
                                     l->comm, &request);
    return complete(l, code, &request);
}

/* Sends or receives a message in rounds. */
static lg_status pass(link *l, char *data, size_t bytes, int other, bool sends) {
    MPI_Request request = MPI_REQUEST_NULL;
    for (size_t done = 0; done < bytes; done += ROUND) {
        const int length = (int)(bytes - done < ROUND ? bytes - done : ROUND);
        const int code = sends ? MPI_Isend(data + done, length, MPI_BYTE, other, 0, l->comm, &request)
                               : MPI_Irecv(data + done, length, MPI_BYTE, other, 0, l->comm, &request);
        LG_TRY(complete(l, code, &request));
    }
    return LG_OK;
}

static lg_status collect(void *user, const void *mine, void *all, const size_t *bytes) {
    link *l = user;
    int count, rank;
    if (l->reason[0] != '\0') return LG_FILE;
    (void)MPI_Comm_size(l->comm, &count);
    (void)MPI_Comm_rank(l->comm, &rank);
    if (rank > 0) return pass(l, (char *)(uintptr_t)mine, bytes[rank], 0, true);
    char *at = all;
    if (at != mine && bytes[0] > 0) memcpy(at, mine, bytes[0]);
    for (int r = 1; r < count; r++) {
        at += bytes[r - 1];
        LG_TRY(pass(l, at, bytes[r], r, false));
    }
    return LG_OK;
}

/* ---- beginning and end ---- */

static lg_status compare(const lg_ranks *ranks, lg_error *error) {
    char mine[256] = "", first[256] = "", cpu[192];
    (void)lg_cpu_describe(cpu, sizeof cpu);
    (void)snprintf(mine, sizeof mine, "liegrad %s, %s", lg_version(), cpu);
    memcpy(first, mine, sizeof first);
    lg_status status = lg_ranks_share(ranks, 0, first, sizeof first);
    if (status != LG_OK) return lg_ranks_lost(ranks, status, error);
    if (strcmp(mine, first) != 0)
        status =
            lg_fail(error, LG_INVALID_ARGUMENT,
                    "ranks must be of one kind, or bits differ: rank 0 has %s, this one %s", first, mine);
    return lg_ranks_agree(ranks, status, error);
}

/* After a failure MPI may still have the addresses of buffers, so nothing is freed. */
static lg_status release(lg_ranks *ranks, lg_error *error) {
    link *l = ranks->user;
    stop_listening(l, false);
    if (atomic_load(&l->lost) && l->reason[0] == '\0') (void)give_up(l, LG_FILE, l->lost_how);
    if (l->reason[0] != '\0') return lg_ranks_lost(ranks, LG_FILE, error);
    (void)MPI_Comm_free(&l->comm);
    (void)MPI_Comm_free(&l->signs);
    lg_free(NULL, l->counts);
    lg_free(NULL, l->peers);
    lg_free(NULL, l);
    *ranks = (lg_ranks){.size = sizeof *ranks};
    return LG_OK;
}

/* The listener waits by the monotonic clock: it must send its signs when the wall clock is set back, too. */
static void make_wake(link *l) {
    pthread_condattr_t how;
    (void)pthread_condattr_init(&how);
    (void)pthread_condattr_setclock(&how, CLOCK_MONOTONIC);
    (void)pthread_cond_init(&l->wake, &how);
    (void)pthread_condattr_destroy(&how);
}

/* Rank 0 is the peer of all other ranks. */
static bool begin_listening(link *l, int rank, int count) {
    int level = MPI_THREAD_SINGLE;
    l->rank = rank;
    (void)MPI_Query_thread(&level);
    if (level < MPI_THREAD_MULTIPLE || count == 1 || !(l->silence > 0.0)) return true;
    l->peer_count = rank == 0 ? (size_t)count - 1 : 1;
    l->peers = lg_alloc(NULL, l->peer_count, sizeof *l->peers);
    if (l->peers == NULL) return false;
    for (size_t i = 0; i < l->peer_count; i++) {
        l->peers[i] = (peer){.rank = rank == 0 ? (int)i + 1 : 0, .sending = MPI_REQUEST_NULL};
        receive_sign(l, &l->peers[i]);
    }
    l->listens = pthread_create(&l->thread, NULL, listen_to_peers, l) == 0;
    return l->listens;
}

static lg_status join(const lg_context *context, const void *communicator, double silence, lg_ranks *out,
                      lg_error *error) {
    int rank, count;
    link *l = lg_alloc(NULL, 1, sizeof *l);
    if (l == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the ranks");
    MPI_Comm from = MPI_COMM_WORLD;
    if (communicator != NULL) memcpy(&from, communicator, sizeof from);
    l->context = context;
    l->silence = silence;
    (void)pthread_mutex_init(&l->mutex, NULL);
    make_wake(l);
    (void)MPI_Comm_dup(from, &l->comm);
    (void)MPI_Comm_dup(from, &l->signs);
    (void)MPI_Comm_set_errhandler(l->comm, MPI_ERRORS_RETURN);
    (void)MPI_Comm_set_errhandler(l->signs, MPI_ERRORS_RETURN);
    (void)MPI_Comm_rank(l->comm, &rank);
    (void)MPI_Comm_size(l->comm, &count);
    l->counts = lg_alloc(NULL, 2 * (size_t)count, sizeof *l->counts);
    lg_ranks made = {sizeof made, (uint32_t)rank, (uint32_t)count, l, gather, collect, reason};
    if (l->counts == NULL || !begin_listening(l, rank, count)) {
        (void)release(&made, NULL);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %d ranks", count);
    }
    l->offsets = l->counts + count;
    const lg_status status = compare(&made, error);
    if (status != LG_OK) {
        (void)release(&made, NULL);
        return status;
    }
    *out = made;
    return LG_OK;
}

lg_status lg_mpi_begin(const lg_context *context, const void *communicator, double silence, lg_ranks *out,
                       lg_error *error) {
    int initialised = 0, provided = 0;
    (void)MPI_Initialized(&initialised);
    if (out == NULL || (communicator != NULL && !initialised) || !(silence >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "there is no output, MPI has not been initialised, or the silence is negative");
    if (!initialised && MPI_Init_thread(NULL, NULL, MPI_THREAD_MULTIPLE, &provided) != MPI_SUCCESS)
        return lg_fail(error, LG_FILE, "MPI could not be initialised");
    LG_TRY(join(context, communicator, silence, out, error));
    ((link *)out->user)->finalise = !initialised;
    return LG_OK;
}

lg_status lg_mpi_end(lg_ranks *ranks, lg_error *error) {
    if (ranks == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "ranks is NULL");
    if (ranks->user == NULL) return LG_OK;
    const bool finalise = ((const link *)ranks->user)->finalise;
    LG_TRY(release(ranks, error));
    if (finalise) (void)MPI_Finalize();
    return LG_OK;
}

void lg_mpi_abort(int code) {
    (void)MPI_Abort(MPI_COMM_WORLD, code);
}
