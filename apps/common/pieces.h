/* Arrays that are computed piece by piece, by threads or by processes that share a board (common/board.h). */
#ifndef LG_APPS_PIECES_H
#define LG_APPS_PIECES_H

#include <pthread.h>

#include "common/board.h"

/* Piece i of an array is the `each` bytes at offset i * each; the last piece may be shorter. */
typedef struct pieces_array {
    void *data;
    size_t each, total;
} pieces_array;

enum { PIECES_ARRAYS = 4 };

typedef struct pieces {
    const app *app;
    const board_values *board;
    const char *out;   /* path of the file that the arrays are written to */
    const char *sweep; /* what the arrays depend on (see board_open) */
    size_t count, array_count;
    pieces_array arrays[PIECES_ARRAYS];
    /* computes one piece and writes nothing else; called from any thread */
    lg_status (*make)(void *user, size_t piece, lg_error *error);
    void *user;
    /* The following members are set and used by pieces.c only. */
    struct board *shared;
    pthread_mutex_t mutex;
    lg_status status;
    lg_error error;
    size_t failed;
} pieces;

/* Computes all pieces, together with other processes if app->shares. True: the arrays are complete; the
 * caller writes the file and then calls pieces_end. False: another process writes the file, or this was a
 * task of a job array, which has printed how much is done. A failure ends the command; the board stays for
 * the next run. */
bool pieces_make(pieces *self);
void pieces_end(pieces *self); /* called after the file is written */

#endif
