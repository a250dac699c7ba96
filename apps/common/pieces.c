#include "common/pieces.h"

#include <stdlib.h>
#include <string.h>

#include "common/train.h"

/* ---- a piece as a record of the board ---- */

static size_t record_size(const pieces *self) {
    size_t bytes = 0;
    for (size_t k = 0; k < self->array_count; k++) bytes += self->arrays[k].each;
    return bytes;
}

/* Between the arrays and a record: `out` of the arrays. */
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

/* ---- making ---- */

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
        char *record = app_alloc(record_size(self), 1);
        copy_piece(self, piece, record, true);
        status = board_write(self->shared, piece, record, BOARD_DONE, &error);
        free(record);
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

static int told(const pieces *self) {
    if (app_interrupted() || self->status == LG_CANCELLED)
        return app_fail(self->app, LG_CANCELLED, "stopped by %s%s", app_stopper(),
                        self->shared != NULL ? "; the same command continues" : "");
    return self->status == LG_OK
               ? APP_EXIT_OK
               : app_fail(self->app, self->status, "%s", app_sentence(self->status, &self->error));
}

static int make_alone(pieces *self, bool *complete) {
    app_parallel(self->app->threads, self->count, make_task, self);
    const int code = told(self);
    *complete = code == APP_EXIT_OK;
    return code;
}

/* ---- with others ---- */

static int take_all(pieces *self) {
    char *record = app_alloc(record_size(self), 1);
    size_t missing = 0;
    for (size_t i = 0; i < self->count; i++) {
        if (board_read(self->shared, i, record) == BOARD_DONE)
            copy_piece(self, i, record, false);
        else
            missing++;
    }
    free(record);
    if (missing == 0) return APP_EXIT_OK;
    lg_error error = {LG_OK, ""};
    const lg_status status = board_unfinished(self->shared, missing, &error);
    return app_fail_file(self->app, status, &error, self->out);
}

static int make_together(pieces *self, bool *complete) {
    lg_error error = {LG_OK, ""};
    bool fresh = false;
    lg_status status = board_open(self->app, self->board, self->out, self->sweep, record_size(self),
                                  self->count, &self->shared, &fresh, &error);
    if (status == LG_NOT_FOUND) return APP_EXIT_OK; /* the others have come to the end */
    if (status == LG_OK) status = board_begin(self->shared, &error);
    if (status != LG_OK) return app_fail_file(self->app, status, &error, self->out);
    const size_t threads = (size_t)self->app->threads;
    if (!self->board->merge) app_parallel(threads, threads, board_task, self);
    int code = told(self);
    if (code != APP_EXIT_OK) return code;
    if (self->board->task != NULL)
        return board_report(self->app, self->board, self->count - board_left(self->shared), self->count);
    if (self->app->rank > 0) board_wait_for_end(self->shared);
    self->locked = board_lock(self->shared);
    if (!self->locked) return APP_EXIT_OK;
    code = take_all(self);
    *complete = code == APP_EXIT_OK;
    return code;
}

int pieces_make(pieces *self, bool *complete) {
    *complete = false;
    (void)pthread_mutex_init(&self->mutex, NULL);
    const int code = self->together ? make_together(self, complete) : make_alone(self, complete);
    if (!*complete) pieces_end(self, false);
    return code;
}

void pieces_end(pieces *self, bool written) {
    if (self->locked) board_end(self->shared, !written);
    board_close(self->shared);
    self->shared = NULL;
    self->locked = false;
    (void)pthread_mutex_destroy(&self->mutex);
}
