/* The commands that the tests of this folder disturb. This file has a table of the commands, makes the inputs
 * and the working folder, and checks outputs. */
#ifndef LG_TEST_COMMANDS_H
#define LG_TEST_COMMANDS_H

#include <stdbool.h>
#include <sys/types.h>

#include "core/count.h"
#include "crash/digest.h"
#include "liegrad/core.h"

enum { OUTPUTS = 5 };

/* A command. Inputs are in ../in, outputs in the current folder. A name that ends with a slash is a folder. A
 * word @LONG:SHORT stands for LONG in a usual run, and for SHORT in a short run. */
typedef struct job {
    const char *name, *program, *arguments;
    /* the file that shows the progress; NULL: the command starts from the beginning */
    const char *checkpoint;
    const char *again;    /* options added if the checkpoint exists */
    bool counted;         /* each step of progress renames the checkpoint once */
    bool keeps;           /* an existing output is replaced only at the end */
    bool appends;         /* the output is a log, to which a second run appends */
    const char *parts;    /* ending of outputs that may lack a part if a warning says that the part failed */
    const char *fallback; /* arguments whose outputs[0] may be left if another output could not be written */
    const char *outputs[OUTPUTS];
} job;

extern const job jobs[];
extern const size_t job_count;

/* The state of a test of one job: the hashes of the right outputs, and the number of failures. */
typedef struct bench {
    const job *job;
    double seconds; /* of the undisturbed run */
    long cut;       /* bytes of the log before this run */
    bool warned;    /* the run printed a warning */
    bool gaps;      /* a log may lack lines, because the run said so */
    bool stopped;   /* a failed run may leave a history of its first epochs */
    char wanted[OUTPUTS][LG_SHA256_TEXT], fallback[LG_SHA256_TEXT];
    uint64_t failed;
} bench;

/* Prints the words and ends the program with exit code 2. */
void stop(const char *format, ...) __attribute__((format(printf, 1, 2)));

double seconds_now(void);

/* Ends the program if the command of the shell fails. */
void run_shell(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Makes the working folder and all inputs. `folder`: the executables; `quick`: all runs are short. Returns
 * the working folder, in which in/ has the inputs. */
const char *make_inputs(const char *folder, bool quick, lg_rng *rng);

/* The arguments of a command with @LONG:SHORT resolved. */
void resolve(const char *arguments, char *out, size_t size);

/* The hash of an output; false if it is not complete. */
bool digest(const job *j, const char *path, char text[LG_SHA256_TEXT]);
void remove_inputs(void);

/* Starts a command in the working folder, with the executables of `folder` (NULL: the folder of make_inputs).
 * Standard error goes to error_path(). wait_for returns the exit code, or 1000 plus the signal that ended the
 * process. */
pid_t start(const char *folder, const job *j, const char *more);
int wait_for(pid_t pid);
const char *error_path(void);

/* clean empties the working folder. clean_for also writes the older output folder, if the job has to replace
 * one. */
void clean(void);
void clean_for(bench *b);

/* Runs the command without disturbance and notes time and outputs. */
void note_outputs(bench *b);

/* The path of a name in the working folder; the last two results are valid. */
const char *work(const char *name);
bool exists(const char *path);

/* Number of names below the folder that contain `part`; without `folders` those of files alone. */
int count_left(const char *path, const char *part, bool folders);

/* Returns the number of epochs or rows in the checkpoint: 0 if the checkpoint does not exist, -1 if it cannot
 * be read. */
long progress(const job *j);

/* Writes older outputs: another export, or the complete file with four bytes more. */
void put_old(bench *b);

/* Returns the options that continue the job if its checkpoint exists, otherwise "". */
const char *more_of(const job *j);

/* Number of bytes up to the end of the last complete line. */
long whole_lines(const char *path);

/* Counts and prints a failure, and keeps a copy of the working folder. */
void fail(bench *b, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Checks the outputs after an interrupted run: each must be absent, unchanged or complete, and the checkpoint
 * must hold at least what it held before. */
void check_cut_short(bench *b, long before, long after);

/* Whether the outputs equal the outputs of the undisturbed run. If not, counts a failure. */
bool outputs_equal(bench *b);

#endif
