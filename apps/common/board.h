/* A board of work for processes of one or several machines: pieces 0..count-1, each of which has a result of
 * `record` bytes. It is a file that all of them see, OUT.board beside the output that they make together.
 *
 * A process claims a piece by a lock on a byte of the file (fcntl), which the system lifts when the process
 * dies: so a slow or dead process costs its own piece, and another one takes it. There is no process that
 * all depend on, and no message: ranks of mpirun, tasks of a job array and the same command in two terminals
 * are alike. Where the file system's locks reach one machine alone, pieces may be done twice, with the same
 * results. */
#ifndef LG_APPS_BOARD_H
#define LG_APPS_BOARD_H

#include "common/app.h"
#include "liegrad/io.h"

typedef enum board_state { BOARD_EMPTY, BOARD_PARTIAL, BOARD_DONE } board_state;

typedef struct board board;

/* Options of commands whose processes share a board, as the member `board` of their values. */
typedef struct board_values {
    const char *task;
    bool merge;
} board_values;
#define BOARD_ROWS(type)                                                                                     \
    LG_OPTION(type, board.task, STRING, "i/n",                                                               \
              "Task i of n (i from 0) of a job array: takes pieces of the work beside the others and "       \
              "leaves the results in FILE.board, for --merge",                                               \
              .option = "task"),                                                                             \
        LG_OPTION(type, board.merge, SWITCH, NULL,                                                           \
                  "Put what the tasks have finished into the output, and do no work", .option = "merge")

/* Whether the command's processes share a board, and so its outputs (app->shares): there are several, or one
 * left a board. `out`: the output. A wrong --task ends the command. */
bool board_wanted(app *app, const board_values *values, const char *out);

/* What results depend on, in short: this text, and the file at `path` (NULL: none). */
void board_label(const char *text, const char *path, char label[LG_SHA256_TEXT]);

/* Opens OUT.board, or makes it. `sweep`: what the results depend on, so that no other sweep's are taken: the
 * first 127 bytes are compared. Ranks beyond 0 wait for that of rank 0, and get LG_NOT_FOUND where the sweep
 * is over already. The board is locked: `fresh` says that the caller is to put what is known by board_write,
 * and then board_begin lets others in. Errors: LG_FILE, LG_FORMAT (of another sweep). */
lg_status board_open(const app *app, const board_values *values, const char *out, const char *sweep,
                     size_t record, size_t count, board **board_out, bool *fresh, lg_error *error);
lg_status board_begin(board *b, lg_error *error);
void board_close(board *b); /* NULL is fine; drops claims */

/* The lowest piece that is neither done nor another process'. False: there is none now. From any thread. */
bool board_claim(board *b, size_t *piece);
/* The same, but waits for pieces that others may yet leave undone, unless this is a task of an array. False:
 * all are done, or the command is interrupted. */
bool board_next(board *b, size_t *piece);
void board_release(board *b, size_t piece); /* undone */
board_state board_read(board *b, size_t piece, void *record);
/* A result, complete (then the claim ends) or part of one. */
lg_status board_write(board *b, size_t piece, const void *record, board_state state, lg_error *error);
size_t board_left(board *b); /* pieces that are not done */
const char *board_path(const board *b);

/* LG_FILE, with the sentence that so many pieces are not done. */
lg_status board_unfinished(const board *b, size_t left, lg_error *error);
/* What a task of an array says at its end; APP_EXIT_OK. */
int board_report(const app *app, const board_values *values, size_t done, size_t count);

/* The output is made once: true for the process that is to make it now, which calls board_end after that.
 * `kept`: pieces are left, and the board stays. */
bool board_lock(board *b);
/* Ranks beyond 0 leave that to rank 0, which reports; they wait in case it is dead. */
void board_wait_for_end(const board *b);
void board_end(board *b, bool kept);

#endif
