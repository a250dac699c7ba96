/* A sweep: trials of settings, and the table of these trials. A search of the options of train and a study of
 * lg-hamiltonian are sweeps: they say what the settings are and what a trial does. The sweep chooses the
 * settings of each trial, runs the trials (trials.h), and keeps their table, with which it continues. */
#ifndef LG_APPS_SWEEP_H
#define LG_APPS_SWEEP_H

#include "common/trials.h"
#include "settings/settings.h"

typedef struct sweep {
    /* The caller sets `app`, `file`, `options`, `setting`, `run` and of `work`: values, out, noun, resume,
     * count (number of planned trials), threads, jobs and most. */
    app *app;
    const lg_search_file *file; /* the settings that vary */
    lg_search_options options;
    const char *setting; /* what the results depend on in addition to `file` and the seed */
    /* Runs a trial, as lg_search_problem. `user` is the sweep, so it is the first member of the caller's
     * structure. Called from work.threads threads. */
    lg_status (*run)(void *user, lg_search *session, lg_trial *trial, lg_error *error);
    /* Whether a trial that fails for this reason ends the command; NULL: none does. */
    bool (*ends)(lg_status status);
    trials_work work;
    /* The following members are set by sweep.c. */
    bool continues;              /* an existing table is continued */
    char label[LG_SEARCH_LABEL]; /* of the table; ends with the hash of `setting` */
    lg_trial *results;           /* (work.count) by number, as the trials reported them */
    lg_trial *trials; /* (count) that are done, stopped where one process would have stopped them */
    size_t count, written, before; /* written: trials in the file; before: trials of earlier commands */
    lg_error failure;              /* why the first failed trial of this call failed */
    size_t failed;                 /* number of this trial */
    bool stopped;                  /* while a trial waited for others */
    app_progress progress;
} sweep;

/* Checks the output; call it before the inputs are read. `continues`: an existing table is continued. It is
 * continued, too, if parts of it lie next to it; otherwise it is replaced. */
void sweep_choose(sweep *self, bool continues);
/* Runs the trials that the table lacks. True: this process has written the table; `trials` has all trials.
 * False: another process writes it. Failures end the command. */
bool sweep_run(sweep *self);
/* Writes the values of trial `number`. The sampler must not learn. */
void sweep_values(const sweep *self, uint64_t number, double *value);
void sweep_close(sweep *self);

#endif
