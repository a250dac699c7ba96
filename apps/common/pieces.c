#include "common/pieces.h"

#include <string.h>

/* ---- a piece as a record on the board ---- */

static size_t record_size(const pieces *self) {
    size_t bytes = 0;
    for (size_t k = 0; k < self->array_count; k++) bytes += self->arrays[k].each;
    return bytes;
}

/* Copies a piece between the arrays and its record; `out`: from the arrays to the record. */
static void copy_piece(const pieces *self, size_t piece, char *record, bool out) {
    for (size_t k = 0; k < self->array_count; k++) {
        const pieces_array *array = &self->arrays[k];
        const size_t at = piece * array->each, rest = array->total - at;
        const size_t bytes = rest < array->each ? rest : array->each;
        char *data = (char *)array->data + at;
        memcpy(out ? record : data, out ? data : record, bytes);
        record += array->each;
    }
}

/* ---- computing the pieces ---- */

static bool is_stopped(pieces *self) {
    (void)pthread_mutex_lock(&self->mutex);
    const bool stop = self->status != LG_OK || app_interrupted();
    (void)pthread_mutex_unlock(&self->mutex);
    return stop;
}

static lg_status make(pieces *self, size_t piece) {
    lg_error error = {LG_OK, ""};
    lg_status status = self->make(self->user, piece, &error);
    if (status == LG_OK && self->shared != NULL) {
        APP_FREE char *record = app_alloc(record_size(self), 1);
        copy_piece(self, piece, record, true);
        status = board_write(self->shared, piece, record, BOARD_DONE, &error);
    }
    if (status == LG_OK) return LG_OK;
    (void)pthread_mutex_lock(&self->mutex);
    if (self->status == LG_OK || piece < self->failed) {
        self->status = status;
        self->error = error;
        self->failed = piece;
    }
    (void)pthread_mutex_unlock(&self->mutex);
    return status;
}

static void make_task(void *user, size_t index) {
    pieces *self = user;
    if (!is_stopped(self)) (void)make(self, index);
}

static void board_task(void *user, size_t index) {
    pieces *self = user;
    size_t piece;
    (void)index;
    while (!is_stopped(self) && board_next(self->shared, &piece))
        if (make(self, piece) != LG_OK) board_release(self->shared, piece);
}

/* Ends the command if it was interrupted or if a thread failed. */
static void stop_if_failed(const pieces *self) {
    if (app_interrupted() || self->status == LG_CANCELLED)
        app_stop(self->app, LG_CANCELLED, "stopped by %s%s", app_stopper(),
                 self->shared != NULL ? "; the same command continues" : "");
    app_must(self->app, self->status, &self->error);
}

/* ---- sharing the work with other processes ---- */

static void take_all(pieces *self) {
    APP_FREE char *record = app_alloc(record_size(self), 1);
    size_t missing = 0;
    for (size_t i = 0; i < self->count; i++) {
        if (board_read(self->shared, i, record) == BOARD_DONE)
            copy_piece(self, i, record, false);
        else
            missing++;
    }
    if (missing > 0) APP_MUST_FILE(self->app, self->out, board_unfinished(self->shared, missing, &error));
}

/* Returns whether this process has all pieces and is to write the file. */
static bool make_together(pieces *self) {
    const app *host = self->app;
    lg_error why = {LG_OK, ""};
    bool fresh = false;
    const lg_status status = board_open(host, self->board, self->out, self->sweep, record_size(self),
                                        self->count, &self->shared, &fresh, &why);
    if (status == LG_NOT_FOUND) return false; /* the other processes have already finished */
    app_must_file(host, status, &why, self->out);
    APP_MUST_FILE(host, self->out, board_begin(self->shared, &error));
    if (!self->board->merge) app_parallel(host->threads, (size_t)host->threads, board_task, self);
    stop_if_failed(self);
    if (self->board->task != NULL) {
        (void)board_report(host, self->board, self->count - board_left(self->shared), self->count);
        return false;
    }
    if (!board_lock(self->shared)) return false;
    take_all(self);
    return true;
}

static void close_pieces(pieces *self) {
    board_close(self->shared);
    self->shared = NULL;
    (void)pthread_mutex_destroy(&self->mutex);
}

bool pieces_make(pieces *self) {
    (void)pthread_mutex_init(&self->mutex, NULL);
    if (self->app->shares) {
        if (make_together(self)) return true;
        close_pieces(self);
        return false;
    }
    app_parallel(self->app->threads, self->count, make_task, self);
    stop_if_failed(self);
    return true;
}

void pieces_end(pieces *self) {
    if (self->shared != NULL) board_end(self->shared, false);
    close_pieces(self);
}
