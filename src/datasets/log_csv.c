/* Logs as text: a header line, then one row a line; separated by commas, semicolons or tabs. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "datasets/h5.h"
#include "datasets/log_table.h"

enum { BLOCK = 1 << 16, LONGEST_LINE = 1 << 20, FIRST_LINE = 1 << 12 };
#define NO_COLUMN UINT32_MAX

static const char *const missing[] = {"", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "null"};

typedef struct csv {
    lg_log_table *table;
    uint32_t file;
    const char *shown;
    FILE *from;
    char *block, *line; /* line: terminated */
    size_t block_used, block_at, length, room;
    size_t number;       /* of the line, from 1 */
    bool broken, closed; /* closed: the line ended with a newline */
    char separator;
    uint32_t *column; /* (cells) column of the machine file, or NO_COLUMN */
    size_t cells;
    char run[LG_LOG_NAME]; /* of the row before */
    double *values;
} csv;

static lg_status fail(const csv *c, lg_error *error, const char *what) {
    return lg_fail(error, LG_FORMAT, "%s: line %zu: %s", c->shown, c->number, what);
}

/* ---- lines ---- */

static int next_byte(csv *c) {
    if (c->block_at == c->block_used) {
        c->block_used = fread(c->block, 1, BLOCK, c->from);
        c->block_at = 0;
        c->broken = ferror(c->from) != 0;
        if (c->block_used == 0) return EOF;
    }
    return (unsigned char)c->block[c->block_at++];
}

static lg_status widen(csv *c, lg_error *error) {
    char *line = lg_alloc(c->table->context, 2 * c->room, 1);
    if (line == NULL) return lg_log_no_memory(c->table->paths[c->file], error);
    memcpy(line, c->line, c->length);
    lg_free(c->table->context, c->line);
    c->line = line;
    c->room *= 2;
    return LG_OK;
}

/* The next line without its end; *more is false behind the last one. */
static lg_status next_line(csv *c, bool *more, lg_error *error) {
    int byte = EOF;
    c->length = 0;
    c->number++;
    while ((byte = next_byte(c)) != EOF && byte != '\n') {
        if (byte == '\0') return fail(c, error, "is not text: neither CSV nor HDF5");
        if (c->length + 1 == c->room && c->room >= LONGEST_LINE)
            return fail(c, error, "is longer than a million bytes");
        if (c->length + 1 == c->room) LG_TRY(widen(c, error));
        c->line[c->length++] = (char)byte;
    }
    if (c->broken) return lg_fail(error, LG_FILE, "%s: cannot be read", c->shown);
    c->closed = byte == '\n';
    *more = c->closed || c->length > 0;
    while (c->length > 0 && c->line[c->length - 1] == '\r') c->length--;
    c->line[c->length] = '\0';
    return LG_OK;
}

/* A line that says nothing: blank, or a comment. */
static bool is_empty(const csv *c) {
    return c->line[0] == '#' || c->line[strspn(c->line, " \t\r")] == '\0';
}

/* ---- cells ---- */

static bool is_space(const csv *c, char byte) {
    return (byte == ' ' || byte == '\t') && byte != c->separator;
}

/* Unquotes in place, from behind the first quote; *at goes behind the last one. */
static lg_status unquote(const csv *c, char **at, lg_error *error) {
    char *to = *at, *from = *at;
    for (; *from != '\0'; from++) {
        if (*from == '"' && from[1] != '"') break;
        from += *from == '"';
        *to++ = *from;
    }
    if (*from == '\0') return fail(c, error, "a quote is not closed");
    *at = from + 1;
    memset(to, '\0', (size_t)(from - to) + 1);
    return LG_OK;
}

/* The cell at *at, terminated in place; *at goes to the next one, or becomes NULL behind the last. */
static lg_status next_cell(const csv *c, char **at, char **cell, lg_error *error) {
    char *end = *at;
    while (is_space(c, *end)) end++;
    *cell = end;
    if (*end == '"') {
        end = ++*cell;
        LG_TRY(unquote(c, &end, error));
        while (is_space(c, *end)) end++;
        if (*end != '\0' && *end != c->separator) return fail(c, error, "text stands behind a closed quote");
    } else {
        while (*end != '\0' && *end != c->separator) end++;
        for (char *last = end; last > *cell && is_space(c, last[-1]); last--) last[-1] = '\0';
    }
    *at = *end == '\0' ? NULL : end + 1;
    *end = '\0';
    return LG_OK;
}

/* ---- the header ---- */

static char separator_of(const char *line) {
    static const char candidates[] = {',', ';', '\t'};
    size_t most = 0;
    char best = ',';
    for (size_t i = 0; i < sizeof candidates; i++) {
        size_t count = 0;
        bool quoted = false;
        for (const char *at = line; *at != '\0'; at++) {
            quoted ^= *at == '"';
            count += !quoted && *at == candidates[i];
        }
        if (count > most) most = count, best = candidates[i];
    }
    return best;
}

static uint32_t column_of(const lg_machine_file *machine, const char *name) {
    for (uint32_t i = 0; i < machine->column_count; i++)
        if (strcmp(machine->columns[i].name, name) == 0) return i;
    return NO_COLUMN;
}

static lg_status missing_column(const csv *c, const char *name, const lg_log_names *have, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s: line %zu: there is no column '%s'; the columns are: %s", c->shown,
                   c->number, name, have->text);
}

static lg_status read_names(csv *c, lg_error *error) {
    const lg_machine_file *machine = c->table->machine;
    bool seen[LG_LOG_COLUMNS] = {false};
    lg_log_names have = {.used = 0};
    char *at = c->line, *cell = NULL;
    for (c->cells = 0; at != NULL; c->cells++) {
        LG_TRY(next_cell(c, &at, &cell, error));
        const uint32_t column = column_of(machine, cell);
        c->column[c->cells] = column;
        for (char *byte = cell; *byte != '\0'; byte++)
            if ((unsigned char)*byte < ' ') return fail(c, error, "is no header: it has control characters");
        lg_log_add_name(&have, cell);
        if (column == NO_COLUMN) continue;
        if (seen[column])
            return lg_fail(error, LG_FORMAT, "%s: line %zu: column '%s' is there twice", c->shown, c->number,
                           cell);
        seen[column] = true;
    }
    for (uint32_t i = 0; i < machine->column_count; i++)
        if (!seen[i]) return missing_column(c, machine->columns[i].name, &have, error);
    return LG_OK;
}

static lg_status read_header(csv *c, lg_error *error) {
    bool more = true;
    do {
        LG_TRY(next_line(c, &more, error));
        if (!more) return fail(c, error, "is empty: a header with the names of the columns is expected");
        if (c->number == 1 && strncmp(c->line, "\xef\xbb\xbf", 3) == 0)
            memmove(c->line, c->line + 3, c->length -= 2);
    } while (is_empty(c));
    c->separator = separator_of(c->line);
    c->column = lg_alloc(c->table->context, strlen(c->line) + 1, sizeof *c->column);
    if (c->column == NULL) return lg_log_no_memory(c->table->paths[c->file], error);
    return read_names(c, error);
}

/* ---- rows ---- */

static lg_status read_number(const csv *c, const char *cell, uint32_t column, lg_error *error) {
    const char *name = c->table->machine->columns[column].name;
    for (size_t i = 0; i < LG_COUNT(missing); i++) {
        if (strcmp(cell, missing[i]) != 0) continue;
        c->values[column] = NAN;
        return LG_OK;
    }
    const lg_status status = lg_number_parse(cell, &c->values[column]);
    if (status == LG_OK) return LG_OK;
    if (status == LG_OUT_OF_MEMORY) return lg_log_no_memory(c->table->paths[c->file], error);
    char show[41];
    (void)snprintf(show, sizeof show, "%s", cell);
    return lg_fail(error, LG_FORMAT, "%s: line %zu: column %s: '%s' is not a %snumber%s", c->shown, c->number,
                   name, lg_tamed(show), status == LG_NOT_FINITE ? "finite " : "",
                   strchr(cell, ',') != NULL ? "; decimals stand behind a point" : "");
}

/* *again becomes true when the row belongs to the run of the row before. */
static lg_status read_run(csv *c, const char *cell, bool *again, lg_error *error) {
    const size_t length = strlen(cell);
    if (length == 0 || length >= sizeof c->run)
        return lg_fail(error, LG_FORMAT, "%s: line %zu: column %s: 1 to %zu bytes are expected", c->shown,
                       c->number, c->table->machine->columns[c->table->machine->run].name, sizeof c->run - 1);
    *again = strcmp(cell, c->run) == 0;
    memcpy(c->run, cell, length + 1);
    return LG_OK;
}

static lg_status read_cells(csv *c, size_t *cells, bool *again, lg_error *error) {
    char *at = c->line, *cell = NULL;
    for (*cells = 0; at != NULL; ++*cells) {
        LG_TRY(next_cell(c, &at, &cell, error));
        const uint32_t column = *cells < c->cells ? c->column[*cells] : NO_COLUMN;
        if (column == NO_COLUMN) continue;
        LG_TRY(column == c->table->machine->run ? read_run(c, cell, again, error)
                                                : read_number(c, cell, column, error));
    }
    return LG_OK;
}

static size_t count_cells(const csv *c, bool *open) {
    size_t count = 1;
    bool quoted = false;
    for (const char *at = c->line; *at != '\0'; at++) {
        quoted ^= *at == '"';
        count += !quoted && *at == c->separator;
    }
    *open = quoted;
    return count;
}

static lg_status read_row(csv *c, bool first, lg_error *error) {
    bool again = !first, open = false;
    size_t cells = count_cells(c, &open);
    if (cells < c->cells && !c->closed)
        return lg_log_warn(c->table, "%s: the last line was cut off and left out", c->shown);
    if (open) return fail(c, error, "a quote is not closed");
    if (cells == c->cells) LG_TRY(read_cells(c, &cells, &again, error));
    if (cells != c->cells)
        return lg_fail(error, LG_FORMAT, "%s: line %zu: has %zu cells, the header has %zu", c->shown,
                       c->number, cells, c->cells);
    return lg_log_append(c->table, c->file, c->number, c->values, first || !again, error);
}

static lg_status read_rows(csv *c, lg_error *error) {
    bool more = true, first = true;
    LG_TRY(read_header(c, error));
    for (;;) {
        LG_TRY(next_line(c, &more, error));
        if (!more) return LG_OK;
        if (is_empty(c)) continue;
        LG_TRY(read_row(c, first, error));
        first = false;
    }
}

static lg_status open_file(csv *c, const char *path, lg_error *error) {
    struct stat about;
    if (path == NULL || *path == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "a log needs a name");
    if (stat(path, &about) != 0)
        return lg_fail(error, errno == ENOENT || errno == ENOTDIR ? LG_NOT_FOUND : LG_FILE, "%s: %s",
                       c->shown, strerror(errno));
    if (!S_ISREG(about.st_mode)) return lg_fail(error, LG_FILE, "%s: is not a regular file", c->shown);
    c->from = fopen(path, "rb");
    if (c->from == NULL) return lg_fail(error, LG_FILE, "%s: cannot be read: %s", c->shown, strerror(errno));
    return LG_OK;
}

lg_status lg_log_read_csv(lg_log_table *table, uint32_t file, lg_error *error) {
    const lg_context *context = table->context;
    const char *path = table->paths[file];
    csv c = {.table = table, .file = file, .shown = lg_shown_path(path), .room = FIRST_LINE};
    LG_TRY(open_file(&c, path, error));
    c.block = lg_alloc(context, BLOCK, 1);
    c.line = lg_alloc(context, FIRST_LINE, 1);
    c.values = lg_alloc(context, table->columns, sizeof *c.values);
    lg_status status = c.block == NULL || c.line == NULL || c.values == NULL ? lg_log_no_memory(path, error)
                                                                             : read_rows(&c, error);
    lg_free(context, c.block);
    lg_free(context, c.line);
    lg_free(context, c.values);
    lg_free(context, c.column);
    (void)fclose(c.from);
    return status;
}
