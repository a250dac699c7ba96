/* CSV files: text files with one row per line. */
#include "core/widen.h"
#include "files/csv.h"
#include "files/h5.h"
#include "files/read_file.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <unistd.h>

#include "liegrad/settings.h"

#define OPEN_QUOTE "a quote is not closed: end the cell with a quote, and double the quotes inside it"
#define CR_ALONE   "has lines that end with a carriage return alone (CR): let them end with a newline (LF)"
enum { BLOCK = 1 << 16, LONGEST_LINE = 1 << 20, FIRST_LINE = 1 << 12 };

lg_status lg_csv_fail(const lg_csv *c, lg_error *error, const char *what) {
    return lg_fail(error, LG_FORMAT, "%s: line %zu: %s", c->shown, c->number, what);
}

/* ---- lines ---- */

/* Reads the next block. Returns false after the last block. */
static bool fill(lg_csv *c) {
    ssize_t got = -1;
    while (got < 0 && !c->ended) {
        c->ended = c->wait != NULL && !c->wait(c->user);
        if (!c->ended)
            got = c->file < 0 ? (ssize_t)fread(c->block, 1, BLOCK, c->from) : read(c->file, c->block, BLOCK);
        if (got < 0 && !c->ended && errno != EINTR && errno != EAGAIN) c->failure = errno;
        c->ended = c->ended || got == 0 || c->failure != 0;
    }
    c->block_at = 0;
    c->block_used = got > 0 ? (size_t)got : 0;
    return got > 0;
}

static lg_status widen(lg_csv *c, lg_error *error) {
    char *line = lg_widen(c->context, c->line, c->length, 2 * c->room, 1);
    if (line == NULL) return lg_no_memory_for(c->shown, error);
    c->line = line;
    c->room *= 2;
    return LG_OK;
}

/* Adds bytes to the line; `quoted` says that they are inside quotes. */
static lg_status take_bytes(lg_csv *c, const char *from, size_t count, bool quoted, lg_error *error) {
    while (!c->cut && c->length + count >= c->room) {
        c->cut = c->room >= c->longest;
        if (c->cut && c->wait == NULL)
            return lg_csv_fail(c, error,
                               quoted ? OPEN_QUOTE
                               : memchr(c->line, '\r', c->length) != NULL
                                   ? CR_ALONE
                                   : "is longer than a million bytes: end rows with a newline");
        if (!c->cut) LG_TRY(widen(c, error));
    }
    if (c->cut) return LG_OK;
    char *to = c->line + c->length;
    memcpy(to, from, count);
    for (char *zero; (zero = memchr(to, '\0', count)) != NULL; *zero = '?')
        if (c->wait == NULL)
            return lg_csv_fail(
                c, error,
                strncmp(c->line, "PK", 2) == 0
                    ? "is not text: it begins as a zip file; from .npz save one array as .npy (numpy.save)"
                    : "is not text: it has a zero byte, so it is no CSV in UTF-8, and it does not begin "
                      "as HDF5 or an array of numpy (.npy): save it as one of these");
    c->length += count;
    if (c->number == 1 && c->length >= 3 && memcmp(c->line, "\xef\xbb\xbf", 3) == 0) {
        c->length -= 3;
        memmove(c->line, c->line + 3, c->length);
    }
    c->line[c->length] = '\0';
    return LG_OK;
}

size_t lg_csv_comment(const char *line) {
    return line[0] == '#' || line[0] == '%' ? 1 : line[0] == '/' && line[1] == '/' ? 2 : 0;
}

/* The line continues as long as a quote is open; in a comment quotes mean nothing. */
lg_status lg_csv_next(lg_csv *c, bool *more, lg_error *error) {
    bool quoted = false;
    if (lg_cancelled(c->context)) return LG_CANCELLED;
    c->length = 0;
    c->closed = c->cut = false;
    c->number = ++c->lines;
    while (!c->closed && (c->block_at < c->block_used || fill(c))) {
        const char *from = c->block + c->block_at, *end = memchr(from, '\n', c->block_used - c->block_at);
        const size_t count = (end != NULL ? (size_t)(end - c->block) : c->block_used) - c->block_at;
        c->block_at += count + (end != NULL);
        LG_TRY(take_bytes(c, from, count, quoted, error));
        if (c->wait == NULL && lg_csv_comment(c->line) == 0)
            for (; (from = memchr(from, '"', (size_t)(c->block + c->block_at - from))) != NULL; from++)
                quoted = !quoted;
        c->closed = end != NULL && !quoted;
        if (end == NULL || !quoted) continue;
        LG_TRY(take_bytes(c, "\n", 1, true, error));
        c->lines++;
    }
    if (c->failure != 0)
        return lg_fail(error, lg_status_of(c->failure), "%s: cannot be read: %s", c->shown,
                       strerror(c->failure));
    if (quoted && c->lines > c->number) return lg_csv_fail(c, error, OPEN_QUOTE);
    *more = c->closed || c->length > 0 || c->cut;
    size_t end = c->length;
    for (; end > 0 && c->line[end - 1] == '\r'; end--) c->closed = true;
    c->line[end] = '\0';
    return LG_OK;
}

/* True for blank lines and for comments. */
static bool is_empty(const lg_csv *c) {
    return lg_csv_comment(c->line) > 0 || c->line[strspn(c->line, " \t\r")] == '\0';
}

void lg_csv_join_blanks(char *line, char separator) {
    static const char blanks[] = " \t";
    char *to = line;
    for (const char *from = line + strspn(line, blanks); *from != '\0'; from += strspn(from, blanks)) {
        const bool quotes = *from == '"';
        if (to > line) *to++ = separator;
        for (bool inside = false; *from != '\0' && (inside || strchr(blanks, *from) == NULL); *to++ = *from++)
            inside ^= quotes && *from == '"';
    }
    *to = '\0';
}

lg_status lg_csv_line(lg_csv *c, bool *more, lg_error *error) {
    *more = true;
    if (c->row != NULL) { /* the first row, behind a header in a comment */
        lg_free(c->context, c->line);
        c->line = c->row, c->number = c->row_number;
        c->row = NULL;
        return LG_OK;
    }
    const size_t next = c->lines + 1;
    do {
        LG_TRY(lg_csv_next(c, more, error));
        if (*more && lg_csv_hides_row(c, c->line) && c->hidden++ == 0) c->first_hidden = c->number;
    } while (*more && is_empty(c));
    if (*more && c->ours && c->number > next)
        return lg_fail(error, LG_FORMAT, "%s: line %zu: is blank or a comment: remove it", c->shown, next);
    if (c->blanks) lg_csv_join_blanks(c->line, c->separator);
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
    if (*from == '\0') return lg_csv_fail(c, error, OPEN_QUOTE);
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
            return lg_csv_fail(c, error,
                               "text follows a closing quote: quote the whole cell, and double quotes in it");
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
            return lg_csv_fail(c, error,
                               "is not a header: it has control characters; put the name in quotes");
    return LG_OK;
}

/* ---- the header ---- */

size_t lg_csv_count(const char *line, char separator, bool *open) {
    size_t count = 1;
    bool quoted = false;
    for (const char *at = line; *at != '\0'; at++) {
        quoted ^= *at == '"';
        count += !quoted && *at == separator;
    }
    *open = quoted;
    return count;
}

char lg_csv_separator(const char *line, char otherwise) {
    static const char candidates[] = {',', ';', '\t'};
    size_t most = 1;
    char best = otherwise;
    bool open;
    for (size_t i = 0; i < sizeof candidates; i++) {
        const size_t count = lg_csv_count(line, candidates[i], &open);
        if (count > most) most = count, best = candidates[i];
    }
    return best;
}

/* Counts the cells that are numbers or missing numbers, without quotes. *counting: the cells are 0, 1, 2,
 * ..., which some programs write as the header of a table without names. */
static size_t count_numbers(const char *line, char separator, bool *counting) {
    size_t numbers = 0, column = 0;
    *counting = true;
    for (const char *at = line; at != NULL; column++) {
        char cell[64], wanted[24];
        while (*at != separator && (*at == ' ' || *at == '\t')) at++;
        const char *end = strchr(at, separator);
        size_t length = end != NULL ? (size_t)(end - at) : strlen(at);
        while (length > 0 && at[length - 1] == ' ') length--;
        (void)snprintf(cell, sizeof cell, "%.*s", (int)(length < sizeof cell ? length : 0), at);
        (void)snprintf(wanted, sizeof wanted, "%zu", column);
        numbers += lg_is_decimal(cell) || (cell[0] != '\0' && lg_csv_missing(cell));
        *counting = *counting && strcmp(cell, wanted) == 0;
        at = end != NULL ? end + 1 : NULL;
    }
    return numbers;
}

bool lg_csv_hides_row(const lg_csv *c, const char *line) {
    bool open, counting;
    return lg_csv_comment(line) > 0 && c->cells > 1 && lg_csv_count(line, c->separator, &open) == c->cells &&
           count_numbers(line, c->separator, &counting) > 0;
}

static lg_status keep_comment(lg_csv *c, lg_error *error) {
    if (c->comments == LG_COUNT(c->comment)) lg_free(c->context, c->comment[--c->comments].text);
    char *text = lg_strdup(c->context, c->line + lg_csv_comment(c->line));
    if (text == NULL) return lg_no_memory_for(c->shown, error);
    c->comment[c->comments].text = text;
    c->comment[c->comments++].number = c->number;
    return LG_OK;
}

/* Makes comment i the header if it has one name for each cell of the first row, which is the current line.
 * Blanks may separate the names too, and a separator may follow the sign of the comment. */
static bool take_comment(lg_csv *c, size_t i) {
    bool open, counting;
    char *text = c->comment[i].text;
    if (strchr(text, c->separator) == NULL) lg_csv_join_blanks(text, c->separator);
    const size_t skip = strspn(text, " ");
    size_t names = lg_csv_count(text, c->separator, &open);
    if (text[skip] == c->separator && names == c->cells + 1) {
        memmove(text, text + skip + 1, strlen(text + skip));
        names--;
    }
    if (open || text[0] == '\0' || names != c->cells || count_numbers(text, c->separator, &counting) > 0)
        return false;
    c->row = c->line, c->row_number = c->number;
    c->line = text, c->number = c->comment[i].number;
    c->comment[i].text = NULL;
    return true;
}

/* A line of units, or a note, may follow the names; a note of as many words may come before them. */
static bool take_a_comment(lg_csv *c) {
    for (size_t i = 0; i < c->comments; i++)
        if (strchr(c->comment[i].text, c->separator) != NULL && take_comment(c, i)) return true;
    for (size_t i = c->comments; i-- > 0;)
        if (take_comment(c, i)) return true;
    return false;
}

/* Finds blanks that separate numbers: `line` is a row of numbers if they become separators. */
static lg_status split_blanks(lg_csv *c, lg_error *error) {
    bool open, counting;
    char *copy = lg_strdup(c->context, c->line);
    if (copy == NULL) return lg_no_memory_for(c->shown, error);
    lg_csv_join_blanks(copy, c->separator);
    const size_t cells = lg_csv_count(copy, c->separator, &open);
    c->blanks = cells > 1 && count_numbers(copy, c->separator, &counting) == cells;
    if (c->blanks) lg_csv_join_blanks(c->line, c->separator), c->cells = cells;
    lg_free(c->context, copy);
    return LG_OK;
}

static lg_status check_header(lg_csv *c, lg_error *error) {
    const size_t numbers = count_numbers(c->line, c->separator, &c->counting);
    if (numbers == 0 || (numbers == 1 && c->cells > 2)) return LG_OK;
    if (take_a_comment(c) || c->counting) return LG_OK;
    if (c->comments == 0)
        return lg_csv_fail(c, error,
                           "has numbers where names of columns are expected: there is no header; write one");
    return lg_fail(
        error, LG_FORMAT,
        "%s: line %zu: has numbers where names of columns are expected: there is no header, and the "
        "comment in line %zu has not one name for each of the %zu columns; write one",
        c->shown, c->number, c->comment[c->comments - 1].number, c->cells);
}

lg_status lg_csv_header(lg_csv *c, lg_error *error) {
    bool more = true, open = false;
    for (;;) {
        LG_TRY(lg_csv_next(c, &more, error));
        if (!more) return lg_csv_fail(c, error, "is empty: write the names of the columns in the first line");
        if (lg_csv_comment(c->line) > 0) LG_TRY(keep_comment(c, error));
        if (!is_empty(c)) break;
    }
    if (strchr(c->line, '\r') != NULL && strchr(c->line, '"') == NULL) return lg_csv_fail(c, error, CR_ALONE);
    c->separator = lg_csv_separator(c->line, ',');
    c->cells = lg_csv_count(c->line, c->separator, &open);
    if (open) return lg_csv_fail(c, error, OPEN_QUOTE);
    if (c->cells == 1 && c->comments > 0) LG_TRY(split_blanks(c, error));
    return check_header(c, error);
}

/* ---- writing ---- */

lg_text *lg_columns_cell(lg_columns *to) {
    if (to->open) lg_text_append(&to->text, ",", 1);
    to->open = true;
    return &to->text;
}

static void put_text(lg_columns *to, const char *text, bool name) {
    lg_text *out = lg_columns_cell(to);
    const size_t length = strlen(text);
    bool plain = !lg_csv_missing(text) && strpbrk(text, ",;\"#") == NULL && lg_csv_comment(text) == 0 &&
                 text[0] != ' ' && text[length - 1] != ' ' && !(name && lg_is_decimal(text)) &&
                 strncmp(text, "\xef\xbb\xbf", 3) != 0;
    for (const char *c = text; *c != '\0'; c++) plain = plain && (unsigned char)*c >= ' ';
    if (!plain) lg_text_append(out, "\"", 1);
    for (; *text != '\0'; text++) lg_text_append(out, *text == '"' ? "\"\"" : text, *text == '"' ? 2 : 1);
    if (!plain) lg_text_append(out, "\"", 1);
}

void lg_columns_names(lg_columns *to, const char *names) {
    lg_text_append(lg_columns_cell(to), names, strlen(names));
}

void lg_columns_name(lg_columns *to, const char *name) {
    put_text(to, name, true);
}

void lg_columns_text(lg_columns *to, const char *text) {
    put_text(to, text, false);
}

void lg_columns_whole(lg_columns *to, uint64_t value) {
    lg_text_add(lg_columns_cell(to), "%" PRIu64, value);
}

void lg_columns_number(lg_columns *to, double value) {
    char text[LG_SHORTEST];
    lg_text *out = lg_columns_cell(to);
    if (!isfinite(value) && !to->words) return;
    (void)lg_format(text, sizeof text, "%.17g", isnan(value) ? (double)NAN : value);
    lg_text_append(out, text, strlen(text));
}

void lg_columns_numbers(lg_columns *to, const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) lg_columns_number(to, values[i]);
}

void lg_columns_empty(lg_columns *to) {
    (void)lg_columns_cell(to);
}

void lg_columns_end(lg_columns *to) {
    /* readers would skip an empty line */
    if (to->text.length == to->row) to->open = false, lg_columns_text(to, "");
    lg_text_append(&to->text, "\n", 1);
    to->row = to->text.length;
    to->open = false;
}

lg_status lg_columns_write(lg_columns *to, const lg_context *context, const char *path, lg_error *error) {
    const lg_text *text = &to->text;
    const lg_status status = text->failed ? lg_no_memory_for(path, error)
                                          : lg_file_write(context, path, text->data, text->length, error);
    lg_text_destroy(&to->text);
    return status;
}

/* ---- rows ---- */

lg_status lg_csv_check_row(const lg_csv *c, bool *cut, lg_error *error) {
    bool open = false;
    const size_t cells = lg_csv_count(c->line, c->separator, &open);
    *cut = !c->closed && (cells < c->cells || c->ours);
    if (*cut) return LG_OK;
    if (open) return lg_csv_fail(c, error, OPEN_QUOTE);
    if (cells == c->cells) return LG_OK;
    return lg_fail(
        error, LG_FORMAT,
        "%s: line %zu: has %zu cells, the header has %zu%s, and put those with a separator in quotes",
        c->shown, c->number, cells, c->cells, lg_csv_empty(c->blanks));
}

bool lg_csv_missing(const char *cell) {
    static const char *const missing[] = {"", "-nan", LG_MISSING_WORDS};
    for (size_t i = 0; i < LG_COUNT(missing); i++)
        if (strcmp(cell, missing[i]) == 0) return true;
    return false;
}

/* ---- the file ---- */

lg_status lg_csv_open(const lg_context *context, const char *path, lg_csv *c, lg_error *error) {
    uint64_t bytes;
    LG_TRY(lg_csv_open_feed(context, -1, path, LONGEST_LINE, NULL, NULL, c, error));
    LG_TRY(lg_read_open(path, &c->from, &bytes, error));
    c->file = fileno(c->from);
    return LG_OK;
}

lg_status lg_csv_open_feed(const lg_context *context, int file, const char *name, size_t longest,
                           bool (*wait)(void *user), void *user, lg_csv *c, lg_error *error) {
    *c = (lg_csv){.context = context,
                  .shown = lg_shown_path(name),
                  .file = file,
                  .room = FIRST_LINE,
                  .longest = longest,
                  .wait = wait,
                  .user = user};
    const lg_status status = LG_ALLOC_ALL(context, LG_ARRAY(c->block, BLOCK), LG_ARRAY(c->line, FIRST_LINE));
    return status == LG_OK ? LG_OK : lg_no_memory_for(c->shown, error);
}

void lg_csv_close(lg_csv *c) {
    LG_FREE_ALL(c->context, c->block, c->line, c->row);
    for (size_t i = 0; i < c->comments; i++) lg_free(c->context, c->comment[i].text);
    c->comments = 0;
    if (c->from != NULL) (void)fclose(c->from);
    c->from = NULL;
}
