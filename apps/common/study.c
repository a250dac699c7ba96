/* The study driver: trains the runs of a grid, several at a time. */
#include "common/study.h"

#include <math.h>
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
    TRIALS_ROWS(study_values), LG_FIELD_END};

typedef struct study {
    app *app;
    const study_task *task;
    study_plan plan;
    study_file file;
    trials_work work;
    study_row *rows; /* (runs) those that are done, from all processes */
    bool *saved;     /* (runs) the row is in `file` */
    uint64_t threads_each;
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

static lg_status do_run(void *user, size_t index, void *record, lg_error *error) {
    study *self = user;
    study_row *row = record;
    *row = study_run_at(&self->plan, index);
    const lg_status status =
        self->task->run(self->task->user, self->app, &self->plan, self->threads_each, row, error);
    if (!is_result(status)) return status;
    fail_row(&self->plan, row);
    return LG_OK;
}

/* A record of another process must be of this run. */
static bool take_row(void *user, size_t index, void *record, bool done, bool own) {
    study *self = user;
    const study_plan *plan = &self->plan;
    const study_row run = study_run_at(plan, index), *row = record;
    unsigned char failed;
    char text[256];
    memcpy(&failed, &row->failed, 1);
    if (!done || failed > 1 || row->repeat != run.repeat ||
        memcmp(row->at, run.at, plan->axis_count * sizeof *run.at) != 0)
        return false;
    self->rows[index] = *row;
    if (!own) return true;
    self->task->show(plan, row, text, sizeof text);
    app_progress_show(&self->progress, self->work.fresh, "run %zu  %s", self->work.fresh, text);
    return true;
}

/* Appends the rows that are done to the table, in the order of the plan. */
static lg_status save(void *user, lg_error *error) {
    study *self = user;
    for (size_t i = 0; i < self->work.count; i++) {
        if (self->work.known[i] && !self->saved[i]) study_file_append(&self->file, &self->rows[i]);
        self->saved[i] = self->work.known[i];
    }
    return study_file_save(&self->file, error);
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

/* ---- the command ---- */

static void study_end_all(study **self) {
    trials_close(&(*self)->work);
    study_file_close(&(*self)->file);
    free((*self)->rows);
    free((*self)->saved);
    free(*self);
}

/* Reads the table and the results of other processes. */
static void begin(study *self) {
    trials_work *work = &self->work;
    char label[LG_SHA256_TEXT];
    work->count = (size_t)study_runs(&self->plan);
    self->rows = app_alloc(work->count, sizeof *self->rows);
    self->saved = app_alloc(work->count, sizeof *self->saved);
    APP_MUST_FILE(self->app, work->out, study_file_open(work->out, &self->plan, &self->file, &error));
    app_continue(work->out);
    label_of(&self->plan, label);
    APP_MUST_FILE(self->app, work->out, trials_open(work, label, &error));
    for (size_t i = 0; i < work->count; i++) {
        const study_row key = study_run_at(&self->plan, i);
        self->saved[i] = study_file_find(&self->file, &key) != NULL;
        work->known[i] = work->known[i] || self->saved[i];
    }
}

void study_main(app *host, const study_task *task) {
    const double start = app_seconds();
    const uint64_t jobs = study_given.jobs > 0 ? study_given.jobs : host->threads;
    APP_CLEAN(study_end_all) study *self = app_alloc(1, sizeof *self);
    *self = (study){.app = host,
                    .task = task,
                    .threads_each = host->threads / jobs > 0 ? host->threads / jobs : 1,
                    .work = {.app = host,
                             .values = &study_given.shared,
                             .out = study_given.out,
                             .noun = "runs",
                             .resume = "the same command continues",
                             .record = sizeof(study_row),
                             .threads = jobs,
                             .most = study_given.stop_after,
                             .user = self,
                             .run = do_run,
                             .take = take_row,
                             .save = save}};
    const app_path paths[] = {trials_choose(&self->work, LG_FILE_TEXT), {"plot", task->plot, LG_FILE_DRAWN}};
    const int code = app_check_outputs(host, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) app_end(code);
    task->read(task->user, host, &self->plan);
    begin(self);
    app_progress_begin(&self->progress, 0, self->work.count - trials_known(&self->work));
    const bool whole = trials_run(&self->work);
    app_progress_end(&self->progress);
    if (!whole) return;
    APP_MUST_FILE(host, study_given.out, save(self, &error));
    trials_end(&self->work);
    if (task->plot != NULL) task->draw(host, task->plot, &self->file);
    task->report(host, &self->file, self->work.fresh, app_seconds() - start);
}
