/* The study driver: trains the runs of a grid, several at a time. */
#include "common/study.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "core/bytes.h"
#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/settings.h"

study_values study_given;

const lg_field study_options[] = {
    LG_OPTION(study_values, out, STRING, "FILE.csv",
              "Table of runs; runs that are in it already are not repeated", .required = true),
    LG_OPTION(study_values, jobs, U64, "J",
              "Number of simultaneous runs (default: --threads); each uses threads/jobs threads", .low = 1,
              .high = 256),
    LG_OPTION(study_values, stop_after, U64, "n", "Stop after n new runs", .low = 1, .high = 1e9),
    BOARD_ROWS(study_values), LG_FIELD_END};

typedef struct study {
    app *app;
    const study_task *task;
    study_plan plan;
    study_file file;
    uint64_t *pending; /* indices of the runs that are still to be done */
    size_t pending_count, done;
    board *board; /* NULL unless several processes run the study together */
    uint64_t threads_each;
    pthread_mutex_t mutex; /* protects file, done, status, error and progress */
    lg_status status;
    lg_error error;
    app_progress progress;
} study;

/* ---- the plan ---- */

uint64_t study_cells(const study_plan *plan) {
    uint64_t cells = 1;
    for (uint32_t i = 0; i < plan->axis_count; i++) cells *= plan->axes[i].count;
    return cells;
}

uint64_t study_runs(const study_plan *plan) {
    return study_cells(plan) * plan->repeats;
}

uint64_t study_seed(uint64_t seed, uint64_t repeat, uint64_t kind) {
    enum { KINDS = 8 };
    lg_rng rng;
    lg_rng_seed(&rng, seed, repeat * KINDS + kind);
    return lg_rng_next(&rng) >> 1;
}

study_row study_run_at(const study_plan *plan, uint64_t index) {
    study_row row = {.failed = false};
    for (uint32_t i = 0; i < plan->axis_count; i++) {
        const uint32_t axis = plan->order[i], count = plan->axes[axis].count;
        row.at[axis] = (uint32_t)(index % count);
        index /= count;
    }
    row.repeat = (uint32_t)index + 1;
    row.seed = study_seed(plan->seed, row.repeat, 0);
    return row;
}

void study_set_protocol(study_plan *plan, const char *text) {
    char hash[LG_SHA256_TEXT];
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, text, strlen(text));
    lg_sha256_finish(&sha, hash);
    (void)snprintf(plan->protocol, sizeof plan->protocol, "%.*s", STUDY_PROTOCOL_TEXT - 1, hash);
}

/* ---- summaries ---- */

study_collection study_collect(size_t room) {
    study_collection c = {.count = 0};
    for (int k = 0; k < STUDY_MEASURES; k++) c.values[k] = app_alloc(room, sizeof(double));
    return c;
}

void study_add(study_collection *c, const study_row *row) {
    if (row == NULL) return;
    if (row->failed) {
        c->failed++;
        return;
    }
    for (int k = 0; k < STUDY_MEASURES; k++) c->values[k][c->count] = row->result[k];
    c->count++;
}

study_summary study_end(study_collection *c) {
    study_summary s = {.runs = c->count + c->failed, .failed = c->failed};
    for (int k = 0; k < STUDY_MEASURES; k++) {
        double logarithm = 0;
        for (size_t i = 0; i < c->count; i++) logarithm += log(c->values[k][i]);
        s.geometric[k] = c->count > 0 ? exp(logarithm / (double)c->count) : (double)NAN;
        s.median[k] = lg_median(c->values[k], c->count);
        free(c->values[k]);
    }
    return s;
}

study_summary study_cell_summary(const study_file *file, study_row key) {
    study_collection c = study_collect(file->plan->repeats);
    for (key.repeat = 1; key.repeat <= file->plan->repeats; key.repeat++)
        study_add(&c, study_file_find(file, &key));
    return study_end(&c);
}

/* ---- runs ---- */

/* Statuses that mark a run as failed in the table. Any other failure ends the study. */
static bool is_result(lg_status status) {
    return status == LG_NOT_FINITE || status == LG_NO_CONVERGENCE || status == LG_STEP_TOO_SMALL ||
           status == LG_TOO_MANY_STEPS;
}

static void fail_row(const study_plan *plan, study_row *row) {
    row->failed = true;
    for (uint32_t k = 0; k + 1 < plan->measure_count; k++) row->result[k] = (double)NAN;
}

static bool is_stopped(study *self) {
    (void)pthread_mutex_lock(&self->mutex);
    const bool stop = self->status != LG_OK || app_interrupted();
    (void)pthread_mutex_unlock(&self->mutex);
    return stop;
}

/* Trains run `index` of the plan; its row goes to the table, or to the board if there is one. */
static void run_one(study *self, uint64_t index) {
    char text[256];
    lg_error error = {LG_OK, ""};
    study_row row = study_run_at(&self->plan, index);
    lg_status status =
        self->task->run(self->task->user, self->app, &self->plan, self->threads_each, &row, &error);
    if (is_result(status)) {
        fail_row(&self->plan, &row);
        status = LG_OK;
    }
    (void)pthread_mutex_lock(&self->mutex);
    if (status == LG_OK)
        status = self->board != NULL ? board_write(self->board, (size_t)index, &row, BOARD_DONE, &error)
                                     : study_file_append(&self->file, &row, &error);
    if (status == LG_OK) {
        self->done++;
        self->task->show(&self->plan, &row, text, sizeof text);
        app_progress_show(&self->progress, self->done, "run %zu/%zu  %s", self->done, self->pending_count,
                          text);
    } else if (self->status == LG_OK) {
        self->status = status;
        self->error = error;
    }
    (void)pthread_mutex_unlock(&self->mutex);
}

static void run_task(void *user, size_t index) {
    study *self = user;
    if (!is_stopped(self)) run_one(self, self->pending[index]);
}

static void collect_pending(study *self) {
    const uint64_t runs = study_runs(&self->plan);
    self->pending = app_alloc((size_t)runs, sizeof *self->pending);
    for (uint64_t i = 0; i < runs; i++) {
        const study_row row = study_run_at(&self->plan, i);
        if (study_file_find(&self->file, &row) == NULL) self->pending[self->pending_count++] = i;
    }
    if (study_given.stop_after > 0 && self->pending_count > study_given.stop_after)
        self->pending_count = (size_t)study_given.stop_after;
}

/* Calls task(self, i) for i < count, `jobs` of them at a time. Ctrl-C and failures end the command. When it
 * is stopped, it says that finished(self) runs are stored in the file `where`. */
static void run_jobs(study *self, uint64_t jobs, size_t count, void (*task)(void *user, size_t index),
                     const char *where, size_t (*finished)(const study *self)) {
    self->threads_each = self->app->threads / jobs > 0 ? self->app->threads / jobs : 1;
    (void)pthread_mutex_init(&self->mutex, NULL);
    app_progress_begin(&self->progress, 0, self->pending_count);
    app_parallel(jobs, count, task, self);
    app_progress_end(&self->progress);
    (void)pthread_mutex_destroy(&self->mutex);
    if (app_interrupted() || self->status == LG_CANCELLED)
        app_stop(self->app, LG_CANCELLED, "stopped; %zu of %llu runs are in %s, the same command continues",
                 finished(self), (unsigned long long)study_runs(&self->plan), where);
    app_must(self->app, self->status, &self->error);
}

static uint64_t jobs_of(const study *self) {
    return study_given.jobs > 0 ? study_given.jobs : self->app->threads;
}

static size_t rows_of(const study *self) {
    return self->file.count;
}

/* ---- runs of several processes ---- */

static size_t done_on_board(const study *self) {
    return (size_t)study_runs(&self->plan) - board_left(self->board);
}

static bool is_enough(const study *self) {
    return study_given.stop_after > 0 && self->done >= study_given.stop_after;
}

static void board_task(void *user, size_t index) {
    study *self = user;
    size_t piece;
    (void)index;
    while (!is_stopped(self) && !is_enough(self) && board_next(self->board, &piece)) {
        run_one(self, piece);
        if (is_stopped(self)) board_release(self->board, piece);
    }
}

/* Hash of everything that the runs depend on. */
static void label_of(const study_plan *plan, char label[LG_SHA256_TEXT]) {
    lg_sha256 sha;
    unsigned char seed[8];
    lg_bytes_put(seed, sizeof seed, plan->seed);
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, plan->protocol, strlen(plan->protocol));
    lg_sha256_add(&sha, seed, sizeof seed);
    for (uint32_t i = 0; i < plan->axis_count; i++) {
        const study_axis *axis = &plan->axes[i];
        lg_sha256_add(&sha, axis->name, strlen(axis->name) + 1);
        for (uint32_t k = 0; k < axis->count; k++)
            lg_sha256_add(&sha, axis->text[k], strlen(axis->text[k]) + 1);
    }
    lg_sha256_finish(&sha, label);
}

/* Copies the rows of the table to the board. */
static lg_status post_rows(study *self, lg_error *error) {
    lg_status status = study_file_open(study_given.out, &self->plan, &self->file, error);
    if (status != LG_OK) return status;
    for (uint64_t i = 0; i < study_runs(&self->plan) && status == LG_OK; i++) {
        const study_row key = study_run_at(&self->plan, i), *row = study_file_find(&self->file, &key);
        if (row != NULL) status = board_write(self->board, (size_t)i, row, BOARD_DONE, error);
    }
    study_file_close(&self->file);
    return status;
}

/* Appends the rows that only the board has to the table, in the order of the plan. */
static lg_status append_rows(study *self, lg_error *error) {
    lg_status status = study_file_open(study_given.out, &self->plan, &self->file, error);
    if (status != LG_OK) return status;
    for (uint64_t i = 0; i < study_runs(&self->plan) && status == LG_OK; i++) {
        const study_row key = study_run_at(&self->plan, i);
        study_row row;
        if (study_file_find(&self->file, &key) == NULL &&
            board_read(self->board, (size_t)i, &row) == BOARD_DONE)
            status = study_file_append(&self->file, &row, error);
    }
    study_file_close(&self->file);
    return status;
}

/* Returns true if this run can have the values of the record, which any process may have written. */
static bool is_run(const void *user, size_t piece, void *record) {
    const study_plan *plan = &((const study *)user)->plan;
    const study_row run = study_run_at(plan, piece), *row = record;
    unsigned char failed;
    memcpy(&failed, &row->failed, 1);
    return failed <= 1 && row->repeat == run.repeat &&
           memcmp(row->at, run.at, plan->axis_count * sizeof *run.at) == 0;
}

static lg_status open_board(study *self, lg_error *error) {
    char label[LG_SHA256_TEXT];
    bool fresh = false;
    label_of(&self->plan, label);
    lg_status status = board_open(self->app, &study_given.board, study_given.out, label, sizeof(study_row),
                                  (size_t)study_runs(&self->plan), &self->board, &fresh, error);
    if (status == LG_OK) board_set_check(self->board, is_run, self);
    if (status == LG_OK && fresh) status = post_rows(self, error);
    if (status == LG_OK) return board_begin(self->board, error);
    /* the table belongs to other work, so the new board is removed */
    if (fresh) board_end(self->board, false);
    return status;
}

/* Trains runs, and completes the table when all are done; with --merge the runs that are done are added to
 * it. False: another process prints the report, or this was a task of a job array. */
static bool run_together(study *self) {
    const app *host = self->app;
    lg_error why = {LG_OK, ""};
    const lg_status status = open_board(self, &why);
    if (status == LG_NOT_FOUND) return false;
    app_must_file(host, status, &why, study_given.out);
    const size_t jobs = (size_t)jobs_of(self);
    self->pending_count = board_left(self->board);
    if (!study_given.board.merge)
        run_jobs(self, jobs, jobs, board_task, board_path(self->board), done_on_board);
    const size_t left = board_left(self->board);
    if (study_given.board.task != NULL) {
        (void)board_report(host, &study_given.board, done_on_board(self), (size_t)study_runs(&self->plan));
        return false;
    }
    if (!board_lock(self->board)) return true;
    APP_MUST_FILE(host, study_given.out, append_rows(self, &error));
    board_end(self->board, left > 0);
    if (left > 0 && study_given.board.merge)
        APP_MUST_FILE(host, study_given.out, board_unfinished(self->board, left, &error));
    return true;
}

/* ---- the command ---- */

static void check_outputs(const app *self, const study_task *task) {
    const app_path paths[] = {{"out", study_given.out, LG_FILE_TEXT}, {"plot", task->plot, LG_FILE_DRAWN}};
    const int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) app_end(code);
}

static void study_end_all(study **self) {
    board_close((*self)->board);
    study_file_close(&(*self)->file);
    free((*self)->pending);
    free(*self);
}

void study_main(app *host, const study_task *task) {
    const double begin = app_seconds();
    const bool together = board_wanted(host, &study_given.board, study_given.out);
    check_outputs(host, task);
    APP_CLEAN(study_end_all) study *self = app_alloc(1, sizeof *self);
    *self = (study){.app = host, .task = task, .file = {.fd = -1}};
    task->read(task->user, host, &self->plan);
    if (together && !run_together(self)) return;
    APP_MUST_FILE(host, study_given.out, study_file_open(study_given.out, &self->plan, &self->file, &error));
    if (!together) {
        collect_pending(self);
        run_jobs(self, jobs_of(self), self->pending_count, run_task, self->file.path, rows_of);
    }
    if (task->plot != NULL) task->draw(host, task->plot, &self->file);
    task->report(host, &self->file, self->done, app_seconds() - begin);
}
