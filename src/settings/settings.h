/* Shared by the readers of fields, and by the programs that search. */
#ifndef LG_SETTINGS_H
#define LG_SETTINGS_H

#include "core/text.h"
#include "liegrad/settings.h"

/* Sets the field's member of `run` without checks. `values` is one number, `count` numbers of a list, or the
 * position of a name. */
void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run);

/* Finds the value with this name. no and false are the same name, and so are yes and true. */
bool lg_field_find_name(const lg_field *row, const char *text, uint32_t *value);

/* The layout of the table of a study. In contrast to that of a search, it begins with the column names. */
typedef struct lg_trial_layout {
    const char *what;           /* whose trials these are, in messages: "a study" */
    const char *const *columns; /* names, ended by NULL: ranges, reports, fields of a trial, and marks */
    const char *const *report_names;
    uint32_t reports; /* number of reports of a trial that is done; a row that lacks one counts as not done */
    /* Writes the text of a mark, a column that says which work a row belongs to; a row with another text is
     * rejected. Only the values of the trial are set; values outside their range may be any number. */
    void (*mark)(void *user, const lg_trial *trial, const char *column, char text[LG_RANGE_NAME]);
    void *user;
    /* A trial is identified by its values; its number is its index in the grid of all values. `low` and
     * `high` of a choice are its first and last index. Rows with values outside the ranges, and rows that
     * repeat a trial, are kept here as text, and are written after the trials. The caller destroys the
     * text. */
    lg_text others;
    size_t other_rows;
} lg_trial_layout;

/* Returns true if the state, the number of reports and the values of the trial are valid for this table. */
bool lg_trial_is_possible(const lg_search_file *search, const lg_trial *trial);

#endif
