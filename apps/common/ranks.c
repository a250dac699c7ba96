/* Processes started by mpirun: finds this process's rank, and loads liegrad_mpi only when it is needed. */
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "common/app.h"

/* Environment variables with rank and rank count: Open MPI; MPICH and others with PMI; Slurm with PMIx. */
static const struct {
    const char *rank, *count;
} launchers[] = {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                 {"PMI_RANK", "PMI_SIZE"},
                 {"PMIX_RANK", "SLURM_STEP_NUM_TASKS"}};

static bool environment_number(const char *name, uint64_t *out) {
    const char *text = getenv(name);
    return text != NULL && lg_integer_parse(text, out) == LG_OK;
}

static bool find(uint64_t *rank, uint64_t *count) {
    for (size_t i = 0; i < LG_COUNT(launchers); i++)
        if (environment_number(launchers[i].rank, rank) && environment_number(launchers[i].count, count) &&
            *rank < *count && *count <= UINT32_MAX)
            return true;
    return false;
}

/* Ranks other than 0 keep here a copy of the standard error that app_find_ranks has redirected. It is a
 * descriptor, because writing to a descriptor needs no memory. */
static int voice = -1;

void app_find_ranks(app *self) {
    uint64_t rank = 0, count = 1;
    self->rank_count = 1;
    if (!find(&rank, &count)) return;
    self->rank = (uint32_t)rank;
    self->rank_count = (uint32_t)count;
    if (rank == 0) return;
    voice = dup(STDERR_FILENO);
    const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (null < 0 || dup2(null, STDOUT_FILENO) < 0 || dup2(null, STDERR_FILENO) < 0) return;
    (void)close(null);
}

void app_say_as_rank(const app *self, const char *sentence) {
    if (self->rank == 0) (void)fprintf(stderr, "%s: %s\n", self->title, sentence); /* needs no memory */
    if (voice >= 0) (void)dprintf(voice, "%s: rank %u: %s\n", self->title, self->rank, sentence);
}

uint64_t app_processors(void) {
    enum { MOST = 256 };
    cpu_set_t set;
    uint64_t local = 1;
    const long online = sysconf(_SC_NPROCESSORS_ONLN);
    uint64_t own = online > 0 ? (uint64_t)online : 1, part;
    (void)environment_number("OMPI_COMM_WORLD_LOCAL_SIZE", &local);
    part = own / (local > 0 ? local : 1);
    if (sched_getaffinity(0, sizeof set, &set) == 0) own = (uint64_t)CPU_COUNT(&set);
    if (own > part) own = part;
    return own < 1 ? 1 : own < MOST ? own : MOST;
}

/* ---- liegrad_mpi ---- */

static struct {
    lg_status (*begin)(const lg_context *context, const void *communicator, double silence, lg_ranks *out,
                       lg_error *error);
    lg_status (*end)(lg_ranks *ranks, lg_error *error);
    void (*abort)(int code);
    lg_ranks ranks;
    bool over; /* no exchange between ranks follows */
} mpi;

static bool load(void) {
    /* The library of the same major version, which is the part of lg_version() before the first point. */
    char name[64];
    (void)snprintf(name, sizeof name, "libliegrad_mpi.so.%.*s", (int)strcspn(lg_version(), "."),
                   lg_version());
    const lg_plugin_function functions[] = {
        {"lg_mpi_begin", &mpi.begin}, {"lg_mpi_end", &mpi.end}, {"lg_mpi_abort", &mpi.abort}};
    return lg_plugin_load(name, LG_COUNT(functions), functions);
}

/* ---- limits of time ---- */

/* Returns the number of seconds after which a silent process counts as lost (LIEGRAD_SILENCE, default 30). 0
 * means that no process counts as lost. */
static double silence_of(const app *self) {
    static const double otherwise = 30.0;
    const char *text = getenv("LIEGRAD_SILENCE");
    double seconds = otherwise;
    if (text != NULL && !(lg_number_parse(text, &seconds) == LG_OK && seconds >= 0.0))
        app_stop_usage(self, "LIEGRAD_SILENCE: expected seconds, or 0 for no limit, not '%s'", text);
    return seconds;
}

/* MPI_Init and MPI_Finalize cannot be interrupted. If they do not return in time, this thread ends the
 * process. While the process is suspended, its time does not count. */
static struct {
    const app *self;
    const char *what;
    double silence;
    pthread_t thread;
    bool begun;
    atomic_bool over;
} watch;

static void *watch_thread(void *user) {
    const struct timespec pause = {0, 100000000};
    for (double waited = 0.0; waited < watch.silence; waited += 0.1) {
        if (atomic_load(&watch.over)) return NULL;
        (void)nanosleep(&pause, NULL);
    }
    APP_FREE char *text =
        app_format("%s within %g s (LIEGRAD_SILENCE): a rank is stopped, dead or out of memory", watch.what,
                   watch.silence);
    app_say_as_rank(watch.self, text);
    app_release_claims();
    _exit(APP_EXIT_FILE);
}

static void watch_begin(const app *self, const char *what) {
    watch.self = self;
    watch.what = what;
    watch.silence = silence_of(self);
    atomic_store(&watch.over, false);
    watch.begun = watch.silence > 0.0 && pthread_create(&watch.thread, NULL, watch_thread, NULL) == 0;
}

static void watch_end(void) {
    atomic_store(&watch.over, true);
    if (watch.begun) (void)pthread_join(watch.thread, NULL);
    watch.begun = false;
}

/* ---- joining and leaving ---- */

/* If a limit on addresses leaves too little room for the libraries, threads and shared memory of MPI, MPI
 * crashes, ends the process or waits for ever. */
static bool has_room(size_t bytes) {
    void *room =
        mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    return room != MAP_FAILED && munmap(room, bytes) == 0;
}

/* If MPI cannot start a rank, it prints the reason on standard error and ends the process. So the rank has
 * its real standard error while MPI starts. lend_voice returns the descriptor that take_back restores, or
 * -1. */
static int lend_voice(void) {
    const int mute = voice >= 0 ? dup(STDERR_FILENO) : -1;
    if (mute >= 0) (void)dup2(voice, STDERR_FILENO);
    return mute;
}

static void take_back(int mute) {
    if (mute < 0) return;
    (void)dup2(mute, STDERR_FILENO);
    (void)close(mute);
}

void app_join_ranks(app *self) {
    enum { ROOM_MIB = 256 };
    lg_error error = {LG_OK, ""};
    if (self->rank_count == 1) return;
    if (self->command->together == APP_ALONE)
        app_stop_usage(self, "this command runs in one process only, but mpirun started %u processes",
                       self->rank_count);
    if (!has_room((size_t)ROOM_MIB << 20))
        app_stop(self, LG_OUT_OF_MEMORY,
                 "out of memory: the limit on addresses (ulimit -v) leaves less than the %d MiB that "
                 "MPI may use: raise the limit",
                 ROOM_MIB);
    if (!load())
        app_stop_usage(self,
                       "mpirun started %u ranks, but the library liegrad_mpi could not be loaded (%s): "
                       "install it, or build with MPI",
                       self->rank_count, dlerror());
    watch_begin(self, "MPI has not connected the ranks");
    const int mute = lend_voice();
    const lg_status status = mpi.begin(self->context, NULL, silence_of(self), &mpi.ranks, &error);
    take_back(mute);
    watch_end();
    app_must(self, status, &error);
    self->ranks = &mpi.ranks;
}

void app_end_exchanges(app *self) {
    if (self->ranks != NULL) mpi.over = true;
}

/* Rank 0 usually fails for the same reason and reports it. So another rank first gives rank 0 two seconds to
 * end it, and reports its own failure only after that. `at_once`: it is the failure of another rank. */
static void say_alone(const app *self, bool at_once) {
    if (self->rank == 0) return;
    if (!at_once && !app_interrupted()) (void)sleep(2);
    if (!at_once && app_interrupted()) return; /* rank 0 has failed and ended this rank */
    app_say_as_rank(self, app_last_failure());
}

/* Ends all ranks. If a rank is lost, this function first waits, so that the other ranks can say so and rank 0
 * can save its state. After a signal it does not wait, because the launcher ends all ranks. */
static void end_all(const app *self, int code, bool lost) {
    app_release_claims();
    if (lost && self->rank == 0) (void)sleep(1);
    if (lost && self->rank > 0) (void)sleep(app_interrupted() ? 60 : 3);
    mpi.abort(code);
}

int app_leave_ranks(app *self, int code) {
    lg_error error = {LG_OK, ""};
    if (self->ranks == NULL) {
        if (code != APP_EXIT_OK) say_alone(self, false);
        return code;
    }
    const bool lost = mpi.ranks.reason(mpi.ranks.user) != NULL;
    if (code != APP_EXIT_OK && (lost || !mpi.over)) {
        say_alone(self, lost);
        end_all(self, code, lost);
    }
    app_release_claims(); /* mpirun may kill the ranks that it interrupted while they wait in mpi.end */
    watch_begin(self, "not all ranks have ended");
    const lg_status status = mpi.end(&mpi.ranks, &error);
    watch_end();
    if (status != LG_OK) {
        code = app_fail(self, status, "%s", error.message);
        say_alone(self, true);
        end_all(self, code, true);
    }
    self->ranks = NULL;
    return code;
}
