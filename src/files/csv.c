/* CSV files: text files with one row per line. */
#include "files/csv.h"
#include "files/h5.h"
#include "files/read_file.h"

#include <math.h>
#include <string.h>

#include "liegrad/settings.h"

enum { BLOCK = 1 << 16, LONGEST_LINE = 1 << 20, FIRST_LINE = 1 << 12 };

lg_status lg_csv_fail(const lg_csv *c, lg_error *error, const char *what) {
    return lg_fail(error, LG_FORMAT, "%s: line %zu: %s", c->shown, c->number, what);
}

lg_status lg_csv_no_memory(const lg_csv *c, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", c->shown);
}

/* ---- lines ---- */

static int next_byte(lg_csv *c) {
    if (c->block_at == c->block_used) {
        c->block_used = fread(c->block, 1, BLOCK, c->from);
        c->block_at = 0;
        c->broken = ferror(c->from) != 0;
        if (c->block_used == 0) return EOF;
    }
    return (unsigned char)c->block[c->block_at++];
}

static lg_status widen(lg_csv *c, lg_error *error) {
    char *line = lg_alloc(c->context, 2 * c->room, 1);
    if (line == NULL) return lg_csv_no_memory(c, error);
    memcpy(line, c->line, c->length);
    lg_free(c->context, c->line);
    c->line = line;
    c->room *= 2;
    return LG_OK;
}

/* Takes one more byte of the record; `quoted` says that it is inside quotes. */
static lg_status take_byte(lg_csv *c, int byte, bool quoted, lg_error *error) {
    if (byte == '\0') return lg_csv_fail(c, error, "is not text: neither CSV nor HDF5");
    if (c->length + 1 == c->room && c->room >= LONGEST_LINE)
        return lg_csv_fail(c, error, quoted ? "a quote is not closed" : "is longer than a million bytes");
    if (c->length + 1 == c->room) LG_TRY(widen(c, error));
    c->line[c->length++] = (char)byte;
    if (c->number == 1 && c->length == 3 && memcmp(c->line, "\xef\xbb\xbf", 3) == 0) c->length = 0;
    return LG_OK;
}

/* Reads the next line without its line ending, and further lines as long as a quote is open; in a comment
 * quotes mean nothing. *more becomes false when there is no further line. */
static lg_status next_line(lg_csv *c, bool *more, lg_error *error) {
    int byte = EOF;
    bool quoted = false;
    if (lg_cancelled(c->context)) return LG_CANCELLED;
    c->length = 0;
    c->number = ++c->lines;
    while ((byte = next_byte(c)) != EOF && (quoted || byte != '\n')) {
        LG_TRY(take_byte(c, byte, quoted, error));
        quoted = quoted != (byte == '"' && c->line[0] != '#');
        c->lines += byte == '\n';
    }
    if (c->broken) return lg_fail(error, LG_FILE, "%s: cannot be read", c->shown);
    if (quoted && c->lines > c->number) return lg_csv_fail(c, error, "a quote is not closed");
    c->closed = byte == '\n';
    *more = c->closed || c->length > 0;
    while (c->length > 0 && c->line[c->length - 1] == '\r') c->length--;
    c->line[c->length] = '\0';
    return LG_OK;
}

/* True for blank lines and for comments. */
static bool is_empty(const lg_csv *c) {
    return c->line[0] == '#' || c->line[strspn(c->line, " \t\r")] == '\0';
}

lg_status lg_csv_line(lg_csv *c, bool *more, lg_error *error) {
    do LG_TRY(next_line(c, more, error));
    while (*more && is_empty(c));
    return LG_OK;
}

/* ---- cells ---- */

static bool is_space(const lg_csv *c, char byte) {
    return (byte == ' ' || byte == '\t') && byte != c->separator;
}

/* Removes the quotes of a cell in place. *at points behind the opening quote and is moved behind the closing
 * one. */
static lg_status unquote(const lg_csv *c, char **at, lg_error *error) {
    char *to = *at, *from = *at;
    for (; *from != '\0'; from++) {
        if (*from == '"' && from[1] != '"') break;
        from += *from == '"';
        *to++ = *from;
    }
    if (*from == '\0') return lg_csv_fail(c, error, "a quote is not closed");
    *at = from + 1;
    memset(to, '\0', (size_t)(from - to) + 1);
    return LG_OK;
}

lg_status lg_csv_cell(lg_csv *c, char **at, char **cell, lg_error *error) {
    char *end = *at;
    while (is_space(c, *end)) end++;
    *cell = end;
    c->quoted = *end == '"';
    if (c->quoted) {
        end = ++*cell;
        LG_TRY(unquote(c, &end, error));
        while (is_space(c, *end)) end++;
        if (*end != '\0' && *end != c->separator)
            return lg_csv_fail(c, error, "text follows a closing quote");
    } else {
        while (*end != '\0' && *end != c->separator) end++;
        for (char *last = end; last > *cell && is_space(c, last[-1]); last--) last[-1] = '\0';
    }
    *at = *end == '\0' ? NULL : end + 1;
    *end = '\0';
    return LG_OK;
}

lg_status lg_csv_name(lg_csv *c, char **at, char **name, lg_error *error) {
    LG_TRY(lg_csv_cell(c, at, name, error));
    for (const char *byte = *name; *byte != '\0' && !c->quoted; byte++)
        if ((unsigned char)*byte < ' ')
            return lg_csv_fail(c, error, "is not a header: it has control characters");
    return LG_OK;
}

void lg_csv_put(FILE *to, const char *before, const char *text, bool name) {
    const size_t length = strlen(text);
    bool plain = !lg_csv_missing(text) && strpbrk(text, ",;\"#") == NULL && text[0] != ' ' &&
                 text[length - 1] != ' ' && !(name && lg_is_decimal(text)) &&
                 strncmp(text, "\xef\xbb\xbf", 3) != 0;
    for (const char *c = text; *c != '\0'; c++) plain = plain && (unsigned char)*c >= ' ';
    (void)fputs(before, to);
    if (!plain) (void)fputc('"', to);
    for (; *text != '\0'; text++) {
        if (*text == '"') (void)fputc('"', to);
        (void)fputc(*text, to);
    }
    if (!plain) (void)fputc('"', to);
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

static size_t count_cells(const lg_csv *c, bool *open) {
    size_t count = 1;
    bool quoted = false;
    for (const char *at = c->line; *at != '\0'; at++) {
        quoted ^= *at == '"';
        count += !quoted && *at == c->separator;
    }
    *open = quoted;
    return count;
}

lg_status lg_csv_header(lg_csv *c, lg_error *error) {
    bool more = true, open = false;
    LG_TRY(lg_csv_line(c, &more, error));
    if (!more) return lg_csv_fail(c, error, "is empty: a header with the names of the columns is expected");
    c->separator = separator_of(c->line);
    c->cells = count_cells(c, &open);
    return open ? lg_csv_fail(c, error, "a quote is not closed") : LG_OK;
}

/* ---- rows ---- */

lg_status lg_csv_check_row(const lg_csv *c, bool *cut, lg_error *error) {
    bool open = false;
    const size_t cells = count_cells(c, &open);
    *cut = cells < c->cells && !c->closed;
    if (*cut) return LG_OK;
    if (open) return lg_csv_fail(c, error, "a quote is not closed");
    if (cells == c->cells) return LG_OK;
    return lg_fail(error, LG_FORMAT, "%s: line %zu: has %zu cells, the header has %zu", c->shown, c->number,
                   cells, c->cells);
}

bool lg_csv_missing(const char *cell) {
    static const char *const missing[] = {"", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "null"};
    for (size_t i = 0; i < LG_COUNT(missing); i++)
        if (strcmp(cell, missing[i]) == 0) return true;
    return false;
}

lg_status lg_csv_number(const lg_csv *c, const char *cell, const char *column, bool may_round, double *out,
                        lg_error *error) {
    char show[41];
    *out = NAN;
    if (lg_csv_missing(cell)) return LG_OK;
    const lg_status status = lg_number_parse(cell, out);
    if (status == LG_OK) return LG_OK;
    if (status == LG_OUT_OF_MEMORY) return lg_csv_no_memory(c, error);
    (void)snprintf(show, sizeof show, "%s", cell);
    if (status == LG_UNSUPPORTED && may_round) return LG_OK;
    if (status == LG_UNSUPPORTED)
        return lg_fail(error, LG_FORMAT, "%s: line %zu: column %s: %s is beyond 2^53 and " LG_ROUNDED,
                       c->shown, c->number, column, show);
    return lg_fail(error, LG_FORMAT, "%s: line %zu: column %s: '%s' is not a %snumber%s", c->shown, c->number,
                   column, lg_tamed(show), status == LG_NOT_FINITE ? "finite " : "",
                   strchr(cell, ',') != NULL ? "; write decimals with a point" : "");
}

/* ---- the file ---- */

static lg_status open_file(lg_csv *c, const char *what, lg_error *error) {
    uint64_t bytes;
    if (*c->path == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "a %s needs a name", what);
    return lg_read_open(c->path, &c->from, &bytes, error);
}

lg_status lg_csv_open(const lg_context *context, const char *path, const char *what, lg_csv *c,
                      lg_error *error) {
    *c = (lg_csv){.context = context, .path = path, .shown = lg_shown_path(path), .room = FIRST_LINE};
    LG_TRY(open_file(c, what, error));
    c->block = lg_alloc(context, BLOCK, 1);
    c->line = lg_alloc(context, FIRST_LINE, 1);
    return c->block == NULL || c->line == NULL ? lg_csv_no_memory(c, error) : LG_OK;
}

void lg_csv_close(lg_csv *c) {
    lg_free(c->context, c->block);
    lg_free(c->context, c->line);
    if (c->from != NULL) (void)fclose(c->from);
    c->from = NULL;
}

void lg_csv_add_name(lg_csv_names *names, const char *name) {
    const size_t room = sizeof names->text - names->used, length = strlen(name);
    if (room < 8) return;
    if (length + 8 > room) {
        names->used += (size_t)snprintf(names->text + names->used, room, ", ...");
        names->used = sizeof names->text;
        return;
    }
    names->used +=
        (size_t)snprintf(names->text + names->used, room, "%s%s", names->used > 0 ? ", " : "", name);
}
