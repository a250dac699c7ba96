/* Items of work that several threads, jobs, tasks or ranks do. */
#include "common/trials.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "files/temporary.h"

/* A part: this head, then entries of an item's number, its state (1: done) and its record. A later entry of
 * an item replaces an earlier one. An entry is written by one call. */
typedef struct head {
    char magic[16], label[TRIALS_LABEL];
    uint64_t record, count;
} head;
static const char magic[16] = "liegrad part 1";
enum { ENTRY_HEAD = 2 * sizeof(uint64_t) };

typedef struct trials_part {
    struct trials_part *next;
    char *path;
    int fd;
    off_t at; /* end of the entries that have been read; 0: the head has not been read */
} part;

static void nap(long milliseconds) {
    const struct timespec pause = {.tv_sec = 0, .tv_nsec = milliseconds * 1000000};
    (void)nanosleep(&pause, NULL);
}

/* ---- what this process does ---- */

static char *part_path(const trials_work *self, size_t task, size_t tasks) {
    return app_format("%s.part-%zu-of-%zu", self->out, task, tasks);
}

void trials_task(const app *self, const char *text, uint64_t most, uint64_t *i, uint64_t *n) {
    const char *slash = strchr(text, '/');
    APP_FREE char *first = app_format("%.*s", slash != NULL ? (int)(slash - text) : 0, text);
    if (self->rank_count > 1)
        app_stop_usage(self, "--task cannot be given with mpirun, whose ranks already are the tasks");
    if (slash == NULL || lg_integer_parse(first, i) != LG_OK || lg_integer_parse(slash + 1, n) != LG_OK ||
        *i >= *n || *n > most)
        app_stop_usage(self, "--task: expected i/n with 0 <= i < n <= %llu, not '%s'",
                       (unsigned long long)most, text);
}

static void read_task(trials_work *self) {
    uint64_t i, n;
    trials_task(self->app, self->values->task, UINT32_MAX, &i, &n);
    if (self->values->merge)
        app_stop_usage(
            self->app,
            "--task does a part of the work and --merge only collects the results; give one of them");
    self->task = (size_t)i;
    self->tasks = (size_t)n;
}

app_path trials_choose(trials_work *self, const char *kind) {
    self->task = self->app->rank;
    self->tasks = self->app->rank_count;
    if (self->values->task != NULL) read_task(self);
    if (self->jobs > 1 && self->app->rank_count > 1)
        app_stop_usage(self->app, "--jobs cannot be given with mpirun: give more ranks");
    if (self->values->task != NULL || self->app->rank_count > 1)
        self->own_part = part_path(self, self->task, self->tasks);
    const bool task = self->values->task != NULL;
    return (app_path){"out", task ? self->own_part : self->out,
                      task || kind == NULL ? LG_FILE_TEXT : LG_FILE_WRITTEN, kind};
}

/* Returns the name of the next part of OUT in the folder, or NULL. */
static const char *next_part(DIR *folder, const char *out) {
    const char *name = app_name_of(out);
    static const char middle[] = ".part-";
    const size_t length = strlen(name);
    for (const struct dirent *at; (at = readdir(folder)) != NULL;)
        if (strncmp(at->d_name, name, length) == 0 &&
            strncmp(at->d_name + length, middle, sizeof middle - 1) == 0)
            return at->d_name;
    return NULL;
}

bool trials_continues(const trials_work *self) {
    APP_FREE char *path = app_folder_of(self->out);
    DIR *folder = opendir(path);
    const bool found = folder != NULL && next_part(folder, self->out) != NULL;
    if (folder != NULL) (void)closedir(folder);
    return found || self->own_part != NULL || self->values->merge;
}

/* ---- reading parts ---- */

static lg_status put(const part *p, const void *data, size_t bytes, off_t at, lg_error *error) {
    const ssize_t n = pwrite(p->fd, data, bytes, at);
    if (n == (ssize_t)bytes) return LG_OK;
    return lg_cannot_write(p->path, n < 0 ? errno : ENOSPC, error);
}

static head head_of(const trials_work *self) {
    head out = {.record = self->record, .count = self->count};
    memcpy(out.magic, magic, sizeof magic);
    memcpy(out.label, self->label, sizeof out.label);
    return out;
}

/* Copies an item between the arrays and its record; `out`: from the arrays to the record. */
static void copy_pieces(const trials_work *self, size_t item, char *record, bool out) {
    for (size_t k = 0; k < self->array_count; k++) {
        const trials_array *array = &self->arrays[k];
        const size_t at = item * array->each, rest = array->total - at;
        char *data = (char *)array->data + at;
        memcpy(out ? record : data, out ? data : record, rest < array->each ? rest : array->each);
        record += array->each;
    }
}

/* Reads the entries that were added to the part since the last call. */
static lg_status read_part(trials_work *self, part *p, void *record, lg_error *error) {
    const head mine = head_of(self);
    head found;
    uint64_t entry[2];
    if (p->at == 0) {
        const ssize_t size = pread(p->fd, &found, sizeof found, 0);
        if (size < 0 || memcmp(&found, &mine, (size_t)size) != 0)
            return lg_fail(error, LG_FORMAT,
                           "%s: belongs to work with other options or data; remove it, or write to another "
                           "file",
                           p->path);
        if (size < (ssize_t)sizeof found) return LG_OK; /* its process has just made it */
        p->at = sizeof found;
    }
    for (; pread(p->fd, entry, sizeof entry, p->at) == (ssize_t)sizeof entry &&
           pread(p->fd, record, self->record, p->at + ENTRY_HEAD) == (ssize_t)self->record;
         p->at += (off_t)(ENTRY_HEAD + self->record)) {
        const bool done = entry[1] == 1;
        const size_t item = (size_t)entry[0];
        if (entry[0] >= self->count || entry[1] > 1 || self->known[item]) continue;
        if (self->array_count > 0) copy_pieces(self, item, record, false);
        self->known[item] = (self->take == NULL || self->take(self->user, item, record, done, false)) && done;
    }
    return LG_OK;
}

/* All parts lie in one folder. `flags`: O_CREAT or 0. */
static part *open_part(trials_work *self, const char *path, int flags) {
    const bool own = self->own_part != NULL && strcmp(app_name_of(path), app_name_of(self->own_part)) == 0;
    part *p = self->parts;
    while (p != NULL && strcmp(app_name_of(p->path), app_name_of(path)) != 0) p = p->next;
    if (p != NULL) return p;
    const int fd = open(path, flags | (own ? O_RDWR : O_RDONLY) | O_CLOEXEC, 0666);
    if (fd < 0) return NULL;
    p = app_alloc(1, sizeof *p);
    *p = (part){self->parts, app_format("%s", path), fd, 0};
    return self->parts = p;
}

/* Takes what all processes have added to their parts. */
static lg_status read_parts(trials_work *self, lg_error *error) {
    APP_FREE char *path = app_folder_of(self->out);
    APP_FREE void *record = app_alloc(self->record, 1);
    lg_status status = LG_OK;
    DIR *folder = opendir(path);
    if (folder == NULL) return LG_OK;
    for (const char *name; (name = next_part(folder, self->out)) != NULL && status == LG_OK;) {
        APP_FREE char *at = app_format("%s/%s", path, name);
        part *p = open_part(self, at, 0);
        if (p != NULL) status = read_part(self, p, record, error);
    }
    (void)closedir(folder);
    return status;
}

/* Adds an entry to the part of this process. What a killed process left of an entry is overwritten. */
lg_status trials_add(trials_work *self, size_t item, const void *record, bool done, lg_error *error) {
    const head mine = head_of(self);
    const uint64_t entry[2] = {item, done};
    APP_FREE char *bytes = app_alloc(ENTRY_HEAD + self->record, 1);
    part *p = open_part(self, self->own_part, O_CREAT);
    if (p == NULL) return lg_cannot_write(self->own_part, errno, error);
    if (p->at == 0) LG_TRY(read_part(self, p, bytes, error));
    if (p->at == 0) {
        LG_TRY(put(p, &mine, sizeof mine, 0, error));
        p->at = sizeof mine;
    }
    memcpy(bytes, entry, ENTRY_HEAD);
    memcpy(bytes + ENTRY_HEAD, record, self->record);
    LG_TRY(put(p, bytes, ENTRY_HEAD + self->record, p->at, error));
    p->at += (off_t)(ENTRY_HEAD + self->record);
    return done && fdatasync(p->fd) != 0 ? lg_cannot_write(p->path, errno, error) : LG_OK;
}

lg_status trials_open(trials_work *self, const char *label, lg_error *error) {
    (void)pthread_mutex_init(&self->mutex, NULL);
    (void)snprintf(self->label, sizeof self->label, "%s", label);
    self->known = app_alloc(self->count, sizeof *self->known);
    for (size_t k = 0; k < self->array_count; k++) self->record += self->arrays[k].each;
    self->turns = &self->turn;
    return read_parts(self, error);
}

void trials_begin(trials_work *self, const char *text, const char *path) {
    char label[LG_SHA256_TEXT];
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, text, strlen(text) + 1);
    if (path != NULL) APP_MUST_FILE(self->app, path, app_hash_file(path, &sha, &error));
    lg_sha256_finish(&sha, label);
    APP_MUST_FILE(self->app, self->out, trials_open(self, label, &error));
}

void trials_exchange(trials_work *self, size_t item, const void *record) {
    lg_error error = {LG_OK, ""};
    if (self->own_part == NULL) return;
    (void)trials_add(self, item, record, false, &error);
    (void)read_parts(self, &error);
}

bool trials_wait(trials_work *self, size_t count) {
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; !app_interrupted(); nap(20)) {
        if (self->own_part != NULL) (void)read_parts(self, &error);
        while (i < count && self->known[i]) i++;
        if (i == count) return true;
    }
    return false;
}

size_t trials_known(const trials_work *self) {
    size_t known = 0;
    for (size_t i = 0; i < self->count; i++) known += self->known[i];
    return known;
}

/* ---- doing items ---- */

static bool is_stopped(trials_work *self) {
    (void)pthread_mutex_lock(&self->mutex);
    const bool stop = self->status != LG_OK || app_interrupted();
    (void)pthread_mutex_unlock(&self->mutex);
    return stop;
}

/* The next item of this task that is not done. */
static bool next_item(trials_work *self, size_t *item) {
    for (size_t turn; (turn = atomic_fetch_add(self->turns, 1)) < self->count;) {
        *item = self->task + turn * self->tasks;
        if (*item >= self->count) return false;
        if (!self->known[*item]) return true;
    }
    return false;
}

/* Called when an item has ended. */
static void finish(trials_work *self, size_t item, void *record, lg_status status, lg_error *error) {
    (void)pthread_mutex_lock(&self->mutex);
    if (status == LG_OK && self->own_part != NULL) copy_pieces(self, item, record, true);
    if (status == LG_OK && self->own_part != NULL) status = trials_add(self, item, record, true, error);
    if (status == LG_OK) {
        self->known[item] = true;
        self->fresh++;
        if (self->take != NULL) (void)self->take(self->user, item, record, true, true);
        if (self->save != NULL && self->own_part == NULL) status = self->save(self->user, error);
    }
    if (status != LG_OK && (self->status == LG_OK || item < self->failed)) {
        self->status = status;
        self->error = *error;
        self->failed = item;
    }
    (void)pthread_mutex_unlock(&self->mutex);
}

static void work(void *user, size_t thread) {
    trials_work *self = user;
    APP_FREE void *record = app_alloc(self->record, 1);
    size_t item;
    while (!is_stopped(self)) {
        lg_error error = {LG_OK, ""};
        if (self->most > 0 && atomic_fetch_add(&self->begun, 1) >= self->most) return;
        if (!next_item(self, &item)) return;
        finish(self, item, record, self->run(self->user, item, record, &error), &error);
    }
}

/* ---- jobs ---- */

/* Job j of J jobs has the part of task i + j n of n J, if its process is task i of n, and takes its items in
 * turn with the other jobs. */
static void start_job(trials_work *self, size_t job, pid_t parent) {
    self->child = true;
    if (prctl(PR_SET_PDEATHSIG, (unsigned long)SIGKILL) != 0 || getppid() != parent) _exit(APP_EXIT_FILE);
    self->parts = NULL; /* they belong to the parent */
    self->own_part = part_path(self, self->task + job * self->tasks, (size_t)self->jobs * self->tasks);
    self->app->threads = self->app->threads > self->jobs ? self->app->threads / self->jobs : 1;
    work(self, 0);
    if (app_interrupted()) _exit(APP_EXIT_INTERRUPTED);
    if (self->status == LG_OK) _exit(APP_EXIT_OK);
    _exit(app_fail(self->app, self->status, "%s", app_sentence(self->status, &self->error)));
}

/* Takes what the jobs have done, and saves it. */
static lg_status follow(trials_work *self, lg_error *error) {
    const size_t before = trials_known(self);
    LG_TRY(read_parts(self, error));
    const size_t after = trials_known(self);
    self->fresh += after - before;
    return after > before && self->save != NULL && self->values->task == NULL ? self->save(self->user, error)
                                                                              : LG_OK;
}

/* Returns the exit code of the job that failed last. */
static int wait_for_jobs(trials_work *self, const pid_t *pids, size_t jobs) {
    int state, code = APP_EXIT_OK;
    bool told = false;
    for (size_t ended = 0; ended < jobs; nap(20)) {
        for (pid_t pid; ended < jobs && (pid = waitpid(-1, &state, WNOHANG)) > 0; ended++) {
            if (WIFSIGNALED(state) && self->status == LG_OK && !app_interrupted())
                self->status = lg_fail(&self->error, LG_FILE, "a job was ended by signal %d; %s",
                                       WTERMSIG(state), "the same command continues");
            if (WIFEXITED(state) && WEXITSTATUS(state) != APP_EXIT_OK) code = WEXITSTATUS(state);
        }
        if (self->status == LG_OK) self->status = follow(self, &self->error);
        if (told || (!app_interrupted() && self->status == LG_OK && code == APP_EXIT_OK)) continue;
        for (size_t i = 0; i < jobs; i++) (void)kill(pids[i], SIGTERM);
        told = true;
    }
    return code;
}

static void run_jobs(trials_work *self) {
    const size_t jobs = (size_t)self->jobs;
    const pid_t parent = getpid();
    APP_FREE pid_t *pids = app_alloc(jobs, sizeof *pids);
    size_t started = 0;
    self->turns = mmap(NULL, sizeof *self->turns, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (self->turns == MAP_FAILED) app_out_of_memory();
    for (; started < jobs && (pids[started] = fork()) >= 0; started++)
        if (pids[started] == 0) start_job(self, started, parent);
    if (started == 0) app_stop(self->app, LG_FILE, "no job can be started: %s", strerror(errno));
    const int code = wait_for_jobs(self, pids, started);
    (void)munmap(self->turns, sizeof *self->turns);
    self->turns = &self->turn;
    if (code != APP_EXIT_OK && self->status == LG_OK && !app_interrupted()) app_end(code);
}

/* ---- the command ---- */

static void report_task(const trials_work *self) {
    const size_t done = trials_known(self);
    app_json *out = self->app->out;
    app_result_line(out, "task %s: all tasks together have done %zu of %zu pieces%s", self->values->task,
                    done, self->count, done == self->count ? "; collect them with --merge" : "");
    APP_PUT(out, LG_AS_TEXT("task", self->values->task), LG_AS_WHOLE("done", done),
            LG_AS_WHOLE("count", self->count));
}

static void stop_if_unfinished(const trials_work *self) {
    const size_t left = self->count - trials_known(self);
    if (left > 0)
        app_stop(self->app, LG_FILE, "%s: %zu of %zu pieces are not done yet", self->out, left, self->count);
}

bool trials_run(trials_work *self) {
    app *host = self->app;
    const bool parts = self->own_part != NULL || self->jobs > 1;
    const lg_ranks *ranks = host->ranks;
    host->ranks = NULL; /* each rank does its items alone */
    if (!self->values->merge && self->jobs > 1)
        run_jobs(self);
    else if (!self->values->merge)
        app_parallel(self->threads, (size_t)self->threads, work, self);
    host->ranks = ranks;
    if (ranks != NULL) { /* all ranks have ended their work, or one of them has failed */
        if (self->status == LG_OK && app_interrupted()) self->status = LG_CANCELLED;
        self->status = lg_ranks_agree(ranks, self->status, &self->error);
        app_end_exchanges(host);
    }
    const char *again = parts ? "the same command continues" : self->resume;
    if (app_interrupted() || self->status == LG_CANCELLED)
        app_stop(host, LG_CANCELLED, "stopped after %zu of %zu %s (%s)%s%s", trials_known(self), self->count,
                 self->noun, app_stopper(), again != NULL ? "; " : "", again != NULL ? again : "");
    app_must(host, self->status, &self->error);
    APP_MUST_FILE(host, self->out, read_parts(self, &error));
    if (self->values->task != NULL) report_task(self);
    const bool writes = self->values->task == NULL && host->rank == 0;
    if (writes && self->array_count > 0) stop_if_unfinished(self);
    return writes;
}

void trials_end(trials_work *self) {
    if (self->values->merge) stop_if_unfinished(self);
    const bool whole = trials_known(self) == self->count;
    for (const part *p = self->parts; p != NULL && whole; p = p->next) (void)unlink(p->path);
}

void trials_close(trials_work *self) {
    while (self->parts != NULL) {
        part *first = self->parts;
        self->parts = first->next;
        (void)close(first->fd);
        free(first->path);
        free(first);
    }
    free(self->own_part);
    free(self->known);
    (void)pthread_mutex_destroy(&self->mutex);
}
