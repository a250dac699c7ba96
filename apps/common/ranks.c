/* Processes started by mpirun: finds this process's rank, and loads liegrad_mpi only when it is needed. */
#include <dlfcn.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/app.h"
#include "liegrad/core.h"

/* Environment variables with rank and rank count: Open MPI; MPICH and others with PMI; Slurm with PMIx. */
static const struct {
    const char *rank, *count;
} launchers[] = {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                 {"PMI_RANK", "PMI_SIZE"},
                 {"PMIX_RANK", "SLURM_STEP_NUM_TASKS"}};

static bool environment_number(const char *name, uint64_t *out) {
    const char *text = getenv(name);
    return text != NULL && app_parse_size(text, out);
}

static bool find(uint64_t *rank, uint64_t *count) {
    for (size_t i = 0; i < LG_COUNT(launchers); i++)
        if (environment_number(launchers[i].rank, rank) && environment_number(launchers[i].count, count) &&
            *rank < *count && *count <= UINT32_MAX)
            return true;
    return false;
}

static FILE *voice; /* copy of the standard error from before app_find_ranks redirected it */

void app_find_ranks(app *self) {
    uint64_t rank = 0, count = 1;
    self->rank_count = 1;
    if (!find(&rank, &count)) return;
    self->rank = (uint32_t)rank;
    self->rank_count = (uint32_t)count;
    if (rank == 0) return;
    const int copy = dup(STDERR_FILENO);
    if (copy >= 0) voice = fdopen(copy, "w");
    if (freopen("/dev/null", "w", stdout) == NULL || freopen("/dev/null", "w", stderr) == NULL) return;
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
    lg_status (*begin)(const void *communicator, lg_ranks *out, lg_error *error);
    void (*end)(lg_ranks *ranks);
    void (*abort)(int code);
    lg_ranks ranks;
    bool over; /* no exchange between ranks follows */
} mpi;

static bool load_symbol(void *library, const char *name, void *function) {
    void *symbol = dlsym(library, name);
    memcpy(function, &symbol, sizeof symbol); /* C has no cast from an object pointer to a function pointer */
    return symbol != NULL;
}

static bool load(void) {
    /* The library of the same major version, which is the part of lg_version() before the first point. */
    char name[64];
    (void)snprintf(name, sizeof name, "libliegrad_mpi.so.%.*s", (int)strcspn(lg_version(), "."),
                   lg_version());
    void *library = dlopen(name, RTLD_NOW | RTLD_GLOBAL);
    return library != NULL && load_symbol(library, "lg_mpi_begin", &mpi.begin) &&
           load_symbol(library, "lg_mpi_end", &mpi.end) && load_symbol(library, "lg_mpi_abort", &mpi.abort);
}

int app_join_ranks(app *self) {
    lg_error error = {LG_OK, ""};
    if (self->rank_count == 1) return APP_EXIT_OK;
    if (self->command->together == APP_ALONE)
        return app_usage(self, "this command runs in one process only, but mpirun started %u processes",
                         self->rank_count);
    if (self->command->together == APP_WORKERS) return APP_EXIT_OK;
    if (!load())
        return app_usage(self,
                         "mpirun started %u ranks, but the library liegrad_mpi could not be loaded (%s): "
                         "install it, or build with MPI",
                         self->rank_count, dlerror());
    const lg_status status = mpi.begin(NULL, &mpi.ranks, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", error.message);
    self->ranks = &mpi.ranks;
    return APP_EXIT_OK;
}

void app_end_exchanges(app *self) {
    if (self->ranks != NULL) mpi.over = true;
}

/* Rank 0 usually fails for the same reason and reports it. So another rank first gives rank 0 two seconds to
 * end it, and reports its own failure only after that. */
static void say_alone(const app *self) {
    if (self->rank == 0 || voice == NULL) return;
    (void)sleep(2);
    if (app_interrupted()) return; /* rank 0 has failed and ended this rank */
    (void)fprintf(voice, "%s: rank %u: %s\n", self->title, self->rank, app_last_failure());
    (void)fflush(voice);
}

int app_leave_ranks(app *self, int code) {
    if (self->ranks == NULL) return code;
    if (code != APP_EXIT_OK && !mpi.over) {
        say_alone(self);
        mpi.abort(code);
    }
    app_release_claims(); /* mpirun may kill the ranks that it interrupted while they wait in mpi.end */
    mpi.end(&mpi.ranks);
    self->ranks = NULL;
    return code;
}
