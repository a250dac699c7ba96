/* Chooses columns by name: inputs, outputs, classes. */
#include <stdio.h>
#include <string.h>

#include "core/clean.h"
#include "files/csv.h"
#include "table/files/recipe.h"

#define COLUMNS                                                                                              \
    LG_OPTION(lg_table_given, inputs, STRING, "A,B,...",                                                     \
              "Columns to learn from (default: all that are not outputs). A name with a comma stands "       \
              "in quotes: '\"time, s\",b'",                                                                  \
              .usual = true),                                                                                \
        LG_OPTION(lg_table_given, outputs, STRING, "Y,...", "Columns to learn (default: the last one)",      \
                  .usual = true),                                                                            \
        LG_OPTION(lg_table_given, without, STRING, "A,B,...", "Columns to leave out, such as texts"),        \
        LG_OPTION(lg_table_given, class_column, STRING, "COLUMN",                                            \
                  "Classification: the column with the classes, texts or numbers", .option = "class",        \
                  .usual = true)
const lg_field lg_table_given_rows[] = {
    COLUMNS,
    LG_TEST_ROW(lg_table_given, "TABLE", "Score the model on this table (default: on the validation part)"),
    LG_FIELD_END};
const lg_field lg_table_column_rows[] = {COLUMNS, LG_FIELD_END};

/* ---- lists of names ---- */

static lg_status make_names(const lg_context *context, size_t most, lg_table_names *out, lg_error *error) {
    *out = (lg_table_names){.name = lg_alloc(context, most, sizeof *out->name), .context = context};
    return out->name != NULL ? LG_OK : lg_fail(error, LG_OUT_OF_MEMORY, "out of memory");
}

static void add_name(lg_table_names *names, const char *name) {
    (void)snprintf(names->name[names->count++], LG_TABLE_NAME, "%s", name);
}

static bool has_name(const lg_table_names *names, const char *name) {
    for (uint32_t i = 0; i < names->count; i++)
        if (strcmp(names->name[i], name) == 0) return true;
    return false;
}

/* Takes the next name of a list, in place. A name with a comma is in quotes, as in CSV. */
static bool take_name(char **at, char **name) {
    lg_csv list = {.separator = ',', .shown = ""};
    return lg_csv_cell(&list, at, name, NULL) == LG_OK && **name != '\0' && strlen(*name) < LG_TABLE_NAME;
}

lg_status lg_table_names_parse(const lg_context *context, const char *option, const char *text,
                               lg_table_names *out, lg_error *error) {
    size_t count = 1;
    for (const char *c = text; *c != '\0'; c++) count += *c == ',';
    LG_TRY(make_names(context, count, out, error));
    LG_CLEAN(lg_owned_free) lg_owned copy = {context, lg_strdup(context, text)};
    char *at = copy.memory, *name = NULL;
    if (at == NULL) return lg_no_memory(error);
    while (at != NULL) {
        if (!take_name(&at, &name))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "--%s: expected names of 1 to %d bytes, with commas between them", option,
                           LG_TABLE_NAME - 1);
        if (has_name(out, name))
            return lg_fail(error, LG_INVALID_ARGUMENT, "--%s: '%s' is given twice", option, name);
        add_name(out, name);
    }
    return LG_OK;
}

lg_status lg_table_class_parse(const char *text, lg_table_text out, lg_error *error) {
    char copy[2 * LG_TABLE_NAME + 2], *at = NULL, *name = copy;
    (void)snprintf(copy, sizeof copy, "%s", text);
    if (text[0] == '"') at = copy;
    if ((at != NULL ? take_name(&at, &name) : strlen(text) < LG_TABLE_NAME) && at == NULL && *name != '\0') {
        memcpy(out, name, strlen(name) + 1);
        return LG_OK;
    }
    return lg_fail(error, LG_INVALID_ARGUMENT, "--class: expected one name of 1 to %d bytes",
                   LG_TABLE_NAME - 1);
}

/* ---- roles of columns ---- */

/* Whether a column is an output or the column with the classes. */
static bool is_learned(const lg_table_state *s, const char *name) {
    return has_name(&s->outputs, name) || (!lg_table_is_regression(s) && strcmp(name, s->class_name) == 0);
}

/* Makes inputs of all columns that have a name, are not learned, and are not left out by --without. */
static lg_status default_inputs(lg_training *self, const lg_table_names *all, lg_error *error) {
    lg_table_state *s = self->state;
    LG_TRY(make_names(self->context, all->count, &s->inputs, error));
    for (uint32_t i = 0; i < all->count; i++) {
        const char *name = all->name[i];
        if (name[0] == '\0')
            LG_WARN(self, "column %u has no name and is not used", i + 1);
        else if (!is_learned(s, name) && !has_name(&s->without, name))
            add_name(&s->inputs, name);
    }
    return LG_OK;
}

/* Makes an output of the last column that has a name and is not left out. */
static lg_status default_outputs(lg_training *self, const lg_table_names *all, lg_error *error) {
    lg_table_state *s = self->state;
    uint32_t last = all->count;
    while (last > 0 && (*all->name[last - 1] == '\0' || has_name(&s->without, all->name[last - 1]))) last--;
    if (last == 0) return lg_fail(error, LG_FORMAT, "%s: there is no column with a name", self->paths[0]);
    LG_TRY(make_names(self->context, 1, &s->outputs, error));
    add_name(&s->outputs, all->name[last - 1]);
    lg_log_message(self->context, LG_LOG_INFO,
                   "the output is the last column, %s; --outputs or --class names others",
                   lg_csv_quote(all->name[last - 1]).text);
    return LG_OK;
}

/* Reads --class, one name, and --without, names of columns of the table. */
static lg_status name_others(lg_training *self, const lg_table_names *all, lg_error *error) {
    lg_table_state *s = self->state;
    if (!lg_table_is_regression(s)) LG_TRY(lg_table_class_parse(s->given.class_column, s->class_name, error));
    if (s->given.without == NULL) return LG_OK;
    LG_TRY(lg_table_names_parse(self->context, "without", s->given.without, &s->without, error));
    for (uint32_t i = 0; i < s->without.count; i++) {
        lg_name_list list = {.used = 0};
        if (has_name(all, s->without.name[i])) continue;
        for (uint32_t k = 0; k < all->count; k++) lg_name_list_add(&list, lg_csv_quote(all->name[k]).text);
        return lg_fail(error, LG_FORMAT, "%s: there is no column '%s'; the columns are: %s", self->paths[0],
                       s->without.name[i], list.text);
    }
    return LG_OK;
}

/* Chooses inputs and outputs from all columns of the table. */
static lg_status name_columns(lg_training *self, const lg_table_names *all, lg_error *error) {
    lg_table_state *s = self->state;
    LG_TRY(name_others(self, all, error));
    if (s->given.outputs != NULL)
        LG_TRY(lg_table_names_parse(self->context, "outputs", s->given.outputs, &s->outputs, error));
    else if (lg_table_is_regression(s))
        LG_TRY(default_outputs(self, all, error));
    return s->given.inputs != NULL
               ? lg_table_names_parse(self->context, "inputs", s->given.inputs, &s->inputs, error)
               : default_inputs(self, all, error);
}

/* Refuses columns that have two of the roles input, output and left out. */
static lg_status check_roles(const lg_table_state *s, lg_error *error) {
    for (uint32_t i = 0; i < s->inputs.count; i++)
        if (is_learned(s, s->inputs.name[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT, "--inputs: column %s is an input and an output",
                           s->inputs.name[i]);
    for (uint32_t i = 0; i < s->without.count; i++) {
        const char *name = s->without.name[i];
        if (is_learned(s, name) || has_name(&s->inputs, name))
            return lg_fail(error, LG_INVALID_ARGUMENT, "--without: column %s is an %s", name,
                           is_learned(s, name) ? "output" : "input");
    }
    return LG_OK;
}

lg_status lg_table_choose(lg_training *self, lg_error *error) {
    const lg_table_state *s = self->state;
    lg_table_names all = {.count = 0};
    if (s->given.outputs != NULL && !lg_table_is_regression(s))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--outputs and --class cannot be given together: one is for a regression, the other "
                       "for a classification");
    LG_TRY(lg_table_names_read(self->context, self->paths[0], NULL, &all, error));
    const lg_status status = name_columns(self, &all, error);
    lg_table_names_destroy(&all);
    LG_TRY(status);
    if (s->inputs.count == 0)
        return lg_fail(error, LG_FORMAT, "%s: there is no column to learn from", self->paths[0]);
    return check_roles(s, error);
}
