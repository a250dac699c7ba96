/* Choices by data: candidates are machine files with different changes behind them. Each one is learned, and
 * scored by free runs over windows of the log that are not trained on. */
#ifndef LG_MACHINE_CHOICE_H
#define LG_MACHINE_CHOICE_H

#include "core/text.h"
#include "machine/files/recipe.h"

/* ---- windows that are held out (held_out.c) ---- */

/* Greatest delay of the inputs, in rows, that is tried. Windows begin so many rows after a part's first. */
#define LG_HELD_OUT_DELAY 5
/* Fewer windows show nothing by their signs: all of 8 are better by chance once in 256 times. */
#define LG_HELD_OUT_WINDOWS 8

/* Windows of a log on which machines are judged and not trained. Window i predicts the rows start[i] + 1
 * .. start[i] + steps from row start[i]. If starts are estimated, each is estimated from
 * lg_start_rows rows, of which start[i] is the last; `before` rows must then stand before start[i]. */
struct lg_held_out {
    size_t count, steps, before;
    bool estimated;
    size_t *start; /* (count), rising; owned */
    /* 1/(mean square change within windows) of each position, then each velocity; 0: it does not count. */
    double weight[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES];
    const lg_context *context;
};
typedef struct lg_held_out lg_held_out;

/* Spreads windows over the log, `part` of its rows. They last ten times the time in which positions change
 * by their size, at least 100 rows, but not so long that there are fewer than `windows` (LG_HELD_OUT_WINDOWS
 * or more). count 0: the log is too short. */
lg_status lg_held_out_plan(const lg_context *context, const lg_machine *machine, const lg_machine_log *log,
                           double part, size_t windows, bool estimated, lg_held_out *out, lg_error *error);
void lg_held_out_destroy(lg_held_out *held);
/* The same windows, by their times, in the logs `to`, which were read with other holds or delays. Errors:
 * LG_FORMAT (one is missing). `out` must be destroyed even after an error. */
lg_status lg_held_out_match(const lg_held_out *held, const lg_logs *from, const lg_logs *to, lg_held_out *out,
                            lg_error *error);
/* Whether one of the rows row .. row + rows - 1 is predicted by a window. */
bool lg_held_out_has(const lg_held_out *held, size_t row, size_t rows);
/* Mean squared error of each window's free run, in units of the motion in windows; infinite if a run is not
 * finite. Positions count where they are measured, else velocities (horizons.c). */
lg_status lg_held_out_judge(const lg_held_out *held, const lg_learned_machine *model,
                            const lg_machine_log *log, double *square, lg_error *error);
/* Compares errors of the same windows: `ratio` of the root mean squares, and whether `square` is smaller
 * by more than chance explains: the mean of the logarithms' differences against their spread (Student, one
 * in 200), or of few windows their signs (one in 200). */
typedef struct lg_held_out_ratio {
    double ratio;
    bool better, clear; /* clear: it is better, and by more than 5 % */
    size_t rows;        /* length of a window; the caller sets it */
} lg_held_out_ratio;
lg_held_out_ratio lg_held_out_compare(size_t count, const double *square, const double *than);
/* Root of the mean of `square` over the windows that have an error; NaN: none has. */
double lg_held_out_error(const lg_held_out *held, const double *square);

/* ---- machines that are learned for a comparison (choice.c) ---- */

/* A machine that the candidates' parameters begin from. */
struct lg_machine_warm {
    lg_machine machine;
    double *theta;
};

typedef struct lg_machine_trial {
    lg_text text;     /* the machine's file; owned */
    lg_status status; /* other than LG_OK: it could not be read or learned, `sentence` says why */
    lg_error why;
    struct lg_machine_warm learned; /* theta is owned */
    double *square;                 /* (windows), owned; NULL if it was not learned */
    /* (fits), owned: what the fit left of its own windows, in units that do not depend on the machine. Long
     * runs hide how inputs act from row to row. */
    double *left;
    size_t fits, rows; /* rows: of such a window */
} lg_machine_trial;

/* What trials share. */
typedef struct lg_choosing {
    const lg_training *self; /* the training for which the choice is made: options, paths, threads */
    lg_context *quiet;       /* its context without messages */
    lg_held_out held;
    size_t most_windows;
    lg_machine_trial *trials; /* (count), of a contest; owned */
    size_t count;
} lg_choosing;

/* Begins a choice for the machine and logs in the training's state, with `part` of the rows held out in
 * `windows` windows or more, by fits of at most `most` windows. End it after an error, too. */
lg_status lg_choosing_begin(lg_choosing *out, const lg_training *self, double part, size_t windows,
                            size_t most, lg_error *error);
void lg_choosing_end(lg_choosing *choosing);
/* A change stands behind this line in the text of a machine's file. */
#define LG_MACHINE_CHANGE "\n---\n"
/* Learns the machine trial->text from the parameters of `from` (may be NULL), and scores it. Fails only
 * without memory or if cancelled; a machine that cannot be learned has a status. */
lg_status lg_machine_try(const lg_choosing *choosing, const lg_machine_trial *from, lg_machine_trial *trial,
                         lg_error *error);
void lg_machine_trial_destroy(const lg_choosing *choosing, lg_machine_trial *trial);
/* A choice: `write` adds the change of machine i; `compare` finds the better of two machines. With `clearly`
 * a machine must be clearly better to win. With `follows` each machine begins with the parameters of an
 * earlier one: of those, the one with the smallest loss on its own windows. */
typedef struct lg_machine_contest {
    size_t count;
    bool follows, clearly;
    void (*write)(const void *user, size_t i, lg_text *change);
    lg_held_out_ratio (*compare)(const lg_choosing *c, const lg_machine_trial *one,
                                 const lg_machine_trial *other);
    const void *user;
} lg_machine_contest;
/* Writes and learns all machines, from simple ones to others: c->trials. *winner: the first one that the one
 * with the least error does not beat; its `square` is NULL if none was learned, as without windows. */
lg_status lg_machine_contest_run(lg_choosing *c, const lg_machine_contest *contest, size_t *winner,
                                 lg_error *error);

/* Reads the machine's file again from `text`, and the logs as this file says. */
lg_status lg_machine_reread(lg_training *self, const lg_text *text, lg_error *error);

/* ---- hold and delay of the inputs (inputs.c) ---- */

/* Chooses what the machine's file leaves open, `hold: auto` or no `hold`, `delay: auto`, by the windows of
 * the fits or, where these cannot tell, by free runs. Tells the choice,
 * and writes it into the machine's text. */
lg_status lg_machine_choose_inputs(lg_training *self, lg_error *error);
void lg_machine_tell_inputs(lg_training *self);
/* Adds to the errors of numbers, and to the covariance of the parameters theta, how much the numbers change
 * with another hold that the log does not refute. Warns if that is more than the error of one of them. */
lg_status lg_machine_widen(lg_training *self, const double *theta, size_t count, lg_identification *of,
                           lg_error *error);

/* ---- terms (suggest.c) ---- */

/* A candidate: one change of a machine's file. In its name, change and sentence %P stands for the name of a
 * line, %V for the velocities of all coordinates. */
typedef struct lg_candidate {
    const char *name, *change;
    const char *value; /* of a key of the inputs, for `applies` */
    /* No term of `part` may be of a kind in `unless`, names with blanks between; with `each` only terms of
     * this line count. unless NULL: there is no such condition. */
    lg_machine_part part;
    const char *unless;
    const char *asks; /* "the log asks for ..." */
    bool offset;      /* a machine without an offset gets one too: motion hardly tells the two apart */
    bool each;        /* one for each line */
    bool last;        /* only if no other candidate helps */
    bool (*applies)(const lg_machine_file *file, const struct lg_candidate *self); /* NULL: always */
} lg_candidate;
extern const lg_candidate lg_candidates[]; /* ends with a name NULL */

/* Finds terms that the log asks for, in at most LG_SUGGEST_ROUNDS rounds: in each one the candidate that
 * leaves least of the error is taken, if it is more than chance. The machine in the training's state
 * becomes the suggested one. */
lg_status lg_machine_suggest(lg_training *self, lg_error *error);
/* After the fit: says why no further term was taken. `explained`: the model explains the logs. */
void lg_machine_conclude_suggestion(const lg_training *self, bool explained);
void lg_machine_tell_suggestion(lg_training *self);

/* ---- free runs that choose widths and the epoch (select.c) ---- */

/* After reading: chooses widths as --size says, and with --select free-run holds out windows. */
lg_status lg_machine_select(lg_training *self, lg_error *error);
/* Before the fit, when its problem and options are set: follows its epochs. */
lg_status lg_machine_select_begin(lg_training *self, lg_error *error);
/* After the fit: theta becomes the parameters with the least error of free runs. */
lg_status lg_machine_select_end(lg_training *self, double *theta, lg_error *error);
void lg_machine_tell_selection(lg_training *self);
void lg_machine_select_close(lg_training *self);

#endif
