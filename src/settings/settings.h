/* Shared by the readers of fields, and by the programs that search. */
#ifndef LG_SETTINGS_H
#define LG_SETTINGS_H

#include "files/csv.h"
#include "liegrad/settings.h"

/* Sets the field's member of `run` without checks. `values` is one number, `count` numbers of a list, or the
 * position of a name. */
void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run);

/* Finds the value with this name. no and false are the same name, and so are yes and true. */
bool lg_field_find_name(const lg_field *row, const char *text, uint32_t *value);

/* A table of trials in CSV: what is in it, and how it is written. */
typedef struct lg_trial_table {
    const lg_search_file *search;
    uint64_t seed;
    const char *setting; /* as for lg_trials_write */
    /* The following members are 0 for the table of a search. Another table has the columns that it names (a
     * list that ends with NULL) and no line before them. `what` says whose trials these are ("a study"). */
    const char *what;
    const char *const *columns;
    /* Names of a trial's reports. A row of a trial that is done and lacks one counts as not done. */
    const char *const *report_names;
    uint32_t reports;
    /* Writes the text of a column that is neither a range nor a report nor a field of a trial. Such columns say
     * which work a row belongs to, and a row with another text is rejected. Of the trial only the values are
     * known, and one that is outside its range may be any number. */
    void (*mark)(const struct lg_trial_table *table, const lg_trial *trial, const char *column,
                 char text[LG_RANGE_NAME]);
    /* The trials of such a table are known by their values, and their numbers are the points of a grid, of
     * which all values are levels. Rows with values outside the ranges, and rows with the values of an earlier
     * row, are kept here as they are and written after the trials. */
    lg_columns others;
    size_t other_rows;
} lg_trial_table;

/* lg_trials_read and lg_trials_write for any table of trials. Reading adds to `others`, which the caller
 * destroys. */
lg_status lg_trial_table_read(lg_trial_table *table, const lg_context *context, const char *path, size_t room,
                              lg_trial *trials, size_t *count, lg_error *error);
lg_status lg_trial_table_write(const lg_trial_table *table, const lg_context *context, const char *path,
                               const lg_trial *trials, size_t count, lg_error *error);
/* Returns true if the state, the number of reports and the values of the trial are valid for this table. */
bool lg_trial_is_possible(const lg_trial_table *table, const lg_trial *trial);

#endif
