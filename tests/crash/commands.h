/* Commands that the tests of this folder disturb: a table of them, the inputs they need, a folder to run them
 * in, and what must hold of their outputs afterwards. */
#ifndef LG_TEST_COMMANDS_H
#define LG_TEST_COMMANDS_H

#include <stdbool.h>
#include <sys/types.h>

#include "core/count.h"
#include "crash/digest.h"
#include "liegrad/core.h"

enum { OUTPUTS = 5 };

/* A command. Inputs are in ../in, outputs in the current folder. A name that ends with a slash is a folder. A
 * word @LONG:SHORT is LONG in a run of usual length and SHORT in a short one. */
typedef struct job {
    const char *name, *program, *arguments;
    /* the file that shows the progress; NULL: the command starts from the beginning */
    const char *checkpoint;
    const char *again; /* options added if the checkpoint exists */
    bool counted;      /* each step of progress renames the checkpoint once */
    bool keeps;        /* an existing output is replaced only at the end */
    bool appends;      /* the output is a log, to which a second run appends */
    bool unordered;    /* rows are in the order in which they were finished */
    const char *outputs[OUTPUTS];
} job;

extern const job jobs[];
extern const size_t job_count;

/* A job at work: what its outputs must be, and how often something was wrong. */
typedef struct bench {
    const job *job;
    double seconds; /* of the undisturbed run */
    long cut;       /* bytes of the log before this run */
    bool stopped;   /* a run that fails may leave a history of the epochs before */
    char wanted[OUTPUTS][LG_SHA256_TEXT];
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

/* Starts a command with the executables of another folder (NULL: the usual one) in the working folder;
 * standard error goes to error_path(). wait_for: its exit code, 1000 plus the signal if one ended it. */
pid_t start(const char *folder, const job *j, const char *more);
int wait_for(pid_t pid);
const char *error_path(void);

/* Empties the working folder. clean_for: then writes the older folder that the job has to replace, if it has
 * to. */
void clean(void);
void clean_for(bench *b);

/* Runs the command without disturbance and notes time and outputs. */
void note_outputs(bench *b);

/* The path of a name in the working folder; the last two results are valid. */
const char *work(const char *name);
bool exists(const char *path);

/* Number of names below the folder that contain `part`. */
int count_left(const char *path, const char *part);

/* Epochs or rows in the checkpoint; 0: there is none; -1: it cannot be read. */
long progress(const job *j);

/* Writes older outputs: another export, or a file of four bytes. */
void put_old(bench *b);

/* The options that continue the job where its checkpoint is there. */
const char *more_of(const job *j);

/* Number of bytes up to the end of the last complete line. */
long whole_lines(const char *path);

/* Counts and tells a failure, and keeps the folder. */
void fail(bench *b, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* After a run that was cut short: every output must be absent, as before, or complete, and the checkpoint
 * must hold no less than before. */
void check_cut_short(bench *b, long before, long after);

/* After a complete run: whether the outputs are those of the undisturbed run. Fails otherwise. */
bool outputs_equal(bench *b);

#endif
