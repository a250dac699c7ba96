/* Logs as text: a header line, then one row per line. */
#include <string.h>

#include "files/csv.h"
#include "files/h5.h"
#include "machine/files/log_table.h"

#define NO_COLUMN UINT32_MAX

typedef struct csv {
    lg_csv text;
    lg_log_table *table;
    uint32_t file;
    uint32_t *column;      /* (cells) index in the machine's file, or NO_COLUMN */
    char run[LG_LOG_NAME]; /* name of the previous row's run */
    double *values;
} csv;

/* ---- the header ---- */

static uint32_t column_of(const lg_machine_file *machine, const char *name) {
    for (uint32_t i = 0; i < machine->column_count; i++)
        if (strcmp(machine->columns[i].name, name) == 0) return i;
    return NO_COLUMN;
}

static lg_status missing_column(const csv *c, const char *name, const lg_csv_names *have, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s: line %zu: there is no column '%s'; the columns are: %s",
                   c->text.shown, c->text.number, name, have->text);
}

static lg_status read_names(csv *c, lg_error *error) {
    const lg_machine_file *machine = c->table->machine;
    bool seen[LG_LOG_COLUMNS] = {false};
    lg_csv_names have = {.used = 0};
    char *at = c->text.line, *cell = NULL;
    for (size_t k = 0; at != NULL; k++) {
        LG_TRY(lg_csv_name(&c->text, &at, &cell, error));
        if (k == c->text.cells) return lg_csv_fail(&c->text, error, "a cell has a quote inside");
        const uint32_t column = column_of(machine, cell);
        c->column[k] = column;
        lg_csv_add_name(&have, cell);
        if (column == NO_COLUMN) continue;
        if (seen[column])
            return lg_fail(error, LG_FORMAT, "%s: line %zu: there are two columns '%s'", c->text.shown,
                           c->text.number, cell);
        seen[column] = true;
    }
    for (uint32_t i = 0; i < machine->column_count; i++)
        if (!seen[i]) return missing_column(c, machine->columns[i].name, &have, error);
    return LG_OK;
}

static lg_status read_header(csv *c, lg_error *error) {
    LG_TRY(lg_csv_header(&c->text, error));
    c->column = lg_alloc(c->table->context, c->text.cells, sizeof *c->column);
    if (c->column == NULL) return lg_csv_no_memory(&c->text, error);
    return read_names(c, error);
}

/* ---- rows ---- */

/* Reads the run of a row; *again becomes true if it is the run of the previous row. */
static lg_status read_run(csv *c, const char *cell, bool *again, lg_error *error) {
    const size_t length = strlen(cell);
    if (length == 0 || length >= sizeof c->run)
        return lg_fail(error, LG_FORMAT,
                       "%s: line %zu: column %s: the name of the run has %zu bytes, expected 1 to %zu",
                       c->text.shown, c->text.number, c->table->machine->columns[c->table->machine->run].name,
                       length, sizeof c->run - 1);
    *again = strcmp(cell, c->run) == 0;
    memcpy(c->run, cell, length + 1);
    return LG_OK;
}

static lg_status read_cells(csv *c, bool *again, lg_error *error) {
    const lg_log_table *table = c->table;
    char *at = c->text.line, *cell = NULL;
    for (size_t k = 0; at != NULL; k++) {
        LG_TRY(lg_csv_cell(&c->text, &at, &cell, error));
        const uint32_t column = k < c->text.cells ? c->column[k] : NO_COLUMN;
        if (column == NO_COLUMN) continue;
        LG_TRY(column == table->machine->run
                   ? read_run(c, cell, again, error)
                   : lg_csv_number(&c->text, cell, table->machine->columns[column].name,
                                   column == table->machine->time, &c->values[column], error));
    }
    return LG_OK;
}

static lg_status read_row(csv *c, bool first, lg_error *error) {
    bool again = !first, cut = false;
    LG_TRY(lg_csv_check_row(&c->text, &cut, error));
    if (cut) return lg_log_warn(c->table, "%s: the last line was cut off and left out", c->text.shown);
    LG_TRY(read_cells(c, &again, error));
    return lg_log_append(c->table, c->file, c->text.number, c->values, first || !again, error);
}

static lg_status read_rows(csv *c, lg_error *error) {
    bool more = true, first = true;
    LG_TRY(read_header(c, error));
    for (;;) {
        LG_TRY(lg_csv_line(&c->text, &more, error));
        if (!more) return LG_OK;
        LG_TRY(read_row(c, first, error));
        first = false;
    }
}

lg_status lg_log_read_csv(lg_log_table *table, uint32_t file, lg_error *error) {
    const lg_context *context = table->context;
    csv c = {.table = table, .file = file};
    lg_status status = lg_csv_open(context, table->paths[file], "log", &c.text, error);
    if (status == LG_OK) {
        c.values = lg_alloc(context, table->columns, sizeof *c.values);
        status = c.values == NULL ? lg_csv_no_memory(&c.text, error) : read_rows(&c, error);
    }
    lg_csv_close(&c.text);
    lg_free(context, c.values);
    lg_free(context, c.column);
    return status;
}
