/* Arrays that are made piece by piece: by threads, or by processes that share a board (common/board.h). */
#ifndef LG_APPS_PIECES_H
#define LG_APPS_PIECES_H

#include <pthread.h>

#include "common/board.h"

/* Piece i of an array is `each` bytes at i * each; the last one ends with the array. */
typedef struct pieces_array {
    void *data;
    size_t each, total;
} pieces_array;

enum { PIECES_ARRAYS = 4 };

typedef struct pieces {
    const app *app;
    const board_values *board;
    const char *out;   /* the file that the arrays are for */
    const char *sweep; /* what they depend on */
    size_t count, array_count;
    pieces_array arrays[PIECES_ARRAYS];
    lg_status (*make)(void *user, size_t piece, lg_error *error); /* writes its piece only; from any thread */
    void *user;
    /* The driver's own. */
    struct board *shared;
    pthread_mutex_t mutex;
    lg_status status;
    lg_error error;
    size_t failed;
} pieces;

/* Makes all pieces, with other processes where app->shares. True: the arrays are complete, and the caller
 * writes the file and then calls pieces_end. False: another process writes it, or a task has said what there
 * is. What fails ends the command; a board stays for the next one. */
bool pieces_make(pieces *self);
void pieces_end(pieces *self); /* the file is written */

#endif
