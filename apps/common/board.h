/* A board distributes work over processes on one or several machines. The work has pieces 0..count-1, each
 * with a result of `record` bytes. The board is a file that all processes can open, OUT.board, beside the
 * output OUT that they make together.
 *
 * A process claims a piece by locking a byte of the file (fcntl). The system removes the lock when the
 * process dies, so another process can then take the piece: a slow or dead process delays only the piece it
 * has claimed. A process that is stopped keeps its locks. After app_silence seconds without a sign of life,
 * another process does the same piece. No process coordinates the others, and no messages are sent. Ranks of
 * mpirun, tasks of a job array and the same command in two terminals all work in the same way. On some
 * file systems a lock works only within one machine. There, two machines may compute the same piece, with the
 * same results. */
#ifndef LG_APPS_BOARD_H
#define LG_APPS_BOARD_H

#include "common/app.h"
#include "liegrad/files.h"
#include "liegrad/settings.h"

typedef enum board_state { BOARD_EMPTY, BOARD_PARTIAL, BOARD_DONE } board_state;

typedef struct board board;

/* Options of commands whose processes share a board. They are the member `board` of the structure with the
 * command's values. */
typedef struct board_values {
    const char *task;
    bool merge;
} board_values;
#define BOARD_ROWS(type)                                                                                     \
    LG_OPTION(type, board.task, STRING, "i/n",                                                               \
              "Work as task i of n (i from 0) of a job array: do pieces of the work that no other task has " \
              "taken, and leave the results in FILE.board, for --merge",                                     \
              .option = "task"),                                                                             \
        LG_OPTION(type, board.merge, SWITCH, NULL,                                                           \
                  "Collect the results that the tasks have finished in the output, without doing any work",  \
                  .option = "merge")

/* Returns whether this command shares a board with other processes, and sets app->shares: there are several
 * processes, or an earlier run left a board. `out`: path of the output. A wrong --task ends the command. */
bool board_wanted(app *app, const board_values *values, const char *out);

/* Hash of what the results depend on: this text and the contents of the file at `path` (NULL: no file).
 * Errors: as app_hash_file. */
lg_status board_label(const char *text, const char *path, char label[LG_SHA256_TEXT], lg_error *error);

/* Opens OUT.board, or creates it. `sweep` describes what the results depend on, so that results of other work
 * are not mixed in; its first 127 bytes are compared. Only rank 0 creates the board. The other ranks wait for
 * it, and get LG_NOT_FOUND when the work is already finished. On return the board is locked. If `fresh` is
 * set, the caller first writes results that it already has with board_write. In any case it then calls
 * board_begin, which lets other processes in. Errors: LG_FILE, LG_FORMAT (the board belongs to other
 * work). */
lg_status board_open(const app *app, const board_values *values, const char *out, const char *sweep,
                     size_t record, size_t count, board **board_out, bool *fresh, lg_error *error);
/* Returns true if the record is possible for this piece: any process that can write to the file may have
 * changed it. The function may clean texts. A piece with an impossible record counts as not done. Set the
 * function before board_begin; NULL accepts every record. */
typedef bool board_check(const void *user, size_t piece, void *record);
void board_set_check(board *b, board_check *is_record, const void *user);
lg_status board_begin(board *b, lg_error *error);
void board_close(board *b); /* drops this process's claims; NULL is allowed */

/* Claims the lowest piece that is not done and not claimed by another process. False: there is no such piece
 * now. May be called from any thread. */
bool board_claim(board *b, size_t *piece);
/* As board_claim, but waits while other processes may still give up a piece, and takes the piece of a process
 * that is silent, unless this is a task of a job array. False: all pieces are done, or the command was
 * interrupted. */
bool board_next(board *b, size_t *piece);
void board_release(board *b, size_t piece); /* gives the claim up; the piece stays undone */
board_state board_read(board *b, size_t piece, void *record);
/* Stores the result of a piece: complete (BOARD_DONE, which ends the claim) or unfinished (BOARD_PARTIAL). */
lg_status board_write(board *b, size_t piece, const void *record, board_state state, lg_error *error);
size_t board_left(board *b); /* number of pieces that are not done */
const char *board_path(const board *b);

/* Returns LG_FILE, and writes into `error` that `left` pieces are not done. */
lg_status board_unfinished(const board *b, size_t left, lg_error *error);
/* Prints how many pieces are done, at the end of a task of a job array. Returns APP_EXIT_OK. */
int board_report(const app *app, const board_values *values, size_t done, size_t count);

/* Makes sure that the output is written once. Waits for the board's lock, and returns true if this process is
 * to write the output now; then it must call board_end. False: another process has finished the board. Ends
 * the command if the process that has the lock is silent. Ranks other than 0 first wait up to 3 s until rank
 * 0 has written the output and removed the board. `kept`: pieces are missing, so the board file is not
 * removed. */
bool board_lock(board *b);
void board_end(board *b, bool kept);

#endif
