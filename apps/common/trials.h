/* Work that is divided into items 0..count-1, each with a result of `record` bytes: the trials of a search,
 * the runs of a study, the pieces of a data file. The items are done by threads of one process, by jobs
 * (child processes), by tasks of a job array or by ranks of mpirun. The results are the same in all cases.
 *
 * A process that works alone keeps its results itself. Task i of n does the items i, i + n, i + 2n, ... and
 * adds each result to a file that no other process writes, the part OUT.part-i-of-n. Rank i of n ranks is
 * task i of n; jobs take the items of their process in turn. A command reads all parts that it finds next to
 * its output OUT and never repeats what is in them, so each killed command continues from there. The process
 * that writes OUT removes the parts when no item is missing. */
#ifndef LG_APPS_TRIALS_H
#define LG_APPS_TRIALS_H

#include <pthread.h>
#include <stdatomic.h>
#include <sys/types.h>

#include "common/app.h"

/* Options of these commands. They are the member `shared` of the structure with the command's values. */
typedef struct trials_values {
    const char *task;
    bool merge;
} trials_values;
#define TRIALS_JOBS(type, ...)         LG_OPTION(type, jobs, U64, "J", __VA_ARGS__, .low = 1, .high = 256)
#define TRIALS_TASK(type, member, ...) LG_OPTION(type, member, STRING, "i/n", __VA_ARGS__, .option = "task")
#define TRIALS_ROWS(type)                                                                                    \
    TRIALS_TASK(type, shared.task,                                                                           \
                "Work as task i of n (i from 0) of a job array: do each n-th piece of the work, and leave "  \
                "the results in FILE.part-i-of-n, for --merge"),                                             \
        LG_OPTION(type, shared.merge, SWITCH, NULL,                                                          \
                  "Collect the results that the tasks have finished in the output, without doing any work",  \
                  .option = "merge")

enum { TRIALS_LABEL = 128, TRIALS_ARRAYS = 4 };

/* Piece i of an array is the `each` bytes at offset i * each; the last piece may be shorter, and ends
 * at `total`. */
typedef struct trials_array {
    void *data;
    size_t each, total;
} trials_array;

typedef struct trials_work {
    app *app;
    const trials_values *values;
    const char *out;    /* path of the output */
    const char *noun;   /* what an item is, in the plural */
    const char *resume; /* how a process that works alone is continued; NULL: not at all */
    size_t count, record;
    uint64_t threads; /* threads of this process that do items at the same time */
    uint64_t jobs;    /* child processes that do items, for items that need the whole process; 0 or 1: none */
    uint64_t most;    /* most items that this process begins; 0: no limit */
    void *user;
    /* Does an item and fills its record, or its piece of the arrays. A failure ends the command. Called from
     * `threads` threads. */
    lg_status (*run)(void *user, size_t item, void *record, lg_error *error);
    /* Keeps the record of an item that is done or unfinished. `own`: this process has just done the item. The
     * records of other processes come from files that anybody may have written: false if this record is
     * impossible; such an item counts as not done. One thread calls it at a time. NULL: nothing is kept. */
    bool (*take)(void *user, size_t item, void *record, bool done, bool own);
    /* If there are arrays, a record is a piece of each, and trials.c sets `record`, and copies the pieces of
     * other processes into the arrays. `take` is not called. */
    size_t array_count;
    trials_array arrays[TRIALS_ARRAYS];
    /* Saves the results that are done so far, in a process that works alone or has jobs. May be NULL. */
    lg_status (*save)(void *user, lg_error *error);
    /* The following members are set by trials.c. Others may read `known` and `own_part`. */
    bool *known;    /* (count) the item is done */
    char *own_part; /* path of the file that this process adds its results to; NULL: it works alone */
    size_t task, tasks, fresh; /* fresh: number of items that this process and its jobs have done */
    char label[TRIALS_LABEL];
    struct trials_part *parts;
    atomic_size_t begun; /* number of items that the threads of this process have begun */
    atomic_size_t turn,
        *turns; /* number of items of this task that are taken; *turns is shared by the jobs */
    pthread_mutex_t mutex;
    bool child;
    lg_status status;
    lg_error error;
    size_t failed;
} trials_work;

/* Reads the i/n of --task, n at most `most`. Anything else, and ranks, end the command. */
void trials_task(const app *app, const char *text, uint64_t most, uint64_t *i, uint64_t *n);
/* Reads --task and finds out what this process does; call it before app_check_outputs. Returns the path that
 * the process writes: OUT, a file in HDF5 of this kind (NULL: a text), or the part of a task. A wrong --task
 * ends the command. */
app_path trials_choose(trials_work *self, const char *kind);
/* Whether parts of OUT exist or this process adds to one: the command continues earlier work. */
bool trials_continues(const trials_work *self);
/* Reads all parts. `label` (at most 127 bytes are compared) says what the results depend on, so that results
 * of other work are not mixed in. Then the caller sets `known` for items whose results it has from elsewhere.
 * LG_FORMAT: a part belongs to other work. */
lg_status trials_open(trials_work *self, const char *label, lg_error *error);
/* trials_open; the label is the hash of what the results depend on: this text and the contents of the file at
 * `path` (NULL: no file). A failure ends the command. */
void trials_begin(trials_work *self, const char *text, const char *path);
/* Does the items. True: the caller writes OUT with the items that are known, and then calls trials_end.
 * False: another process writes OUT, or this was a task, which has printed how much is done. A failure or
 * signal ends the command. */
bool trials_run(trials_work *self);
/* Removes the parts if no item is missing; otherwise --merge ends the command with LG_FILE. */
void trials_end(trials_work *self);
void trials_close(trials_work *self);

/* Waits until the items below `count` are done by other processes. False: the command is to stop. */
bool trials_wait(trials_work *self, size_t count);
/* For an item that goes on: shows its unfinished record to the other processes, and takes the records that
 * they have added. */
void trials_exchange(trials_work *self, size_t item, const void *record);
/* Adds a record to the part of this process. trials_run calls it for each item that is done. */
lg_status trials_add(trials_work *self, size_t item, const void *record, bool done, lg_error *error);
size_t trials_known(const trials_work *self); /* number of items that are done */

#endif
