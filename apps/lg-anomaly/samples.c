/* Fast reading of lines of numbers: no allocation, no dependence on the locale, and for most numbers no call
 * of the library. */
#include "lg-anomaly/samples.h"

#include <ctype.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "files/csv.h"
#include "liegrad/settings.h"

enum {
    ROOM = 1 << 18,   /* bytes in the buffer, which limits the length of a line, if there are few channels */
    ROOM_FIELD = 512, /* bytes in the buffer per number of a line, if there are many channels */
    LONGEST_NUMBER = 512, /* characters */
    LAYOUT_VOTES = 3,     /* lines of the same kind that decide the layout */
    LAYOUT_LINES = 50,    /* most lines that are examined for the layout */
    PATIENCE_MS = 200     /* time within which Ctrl-C is noticed */
};

void sample_reader_open(int file, uint32_t channels, const char *const *names, sample_reader *out) {
    const size_t fields = (size_t)channels + 1, wanted = fields * ROOM_FIELD;
    *out = (sample_reader){
        .file = file, .channels = channels, .room = wanted > ROOM ? wanted : ROOM, .names = names};
    out->place = app_alloc(channels, sizeof *out->place);
    for (uint32_t c = 0; c < channels; c++) out->place[c] = c;
    out->field = app_alloc(fields, sizeof *out->field);
    out->buffer = app_alloc(out->room + 1, 1);
}

void sample_reader_close(sample_reader *reader) {
    free(reader->place);
    free(reader->left_out);
    free(reader->field);
    free(reader->buffer);
    *reader = (sample_reader){.file = -1};
}

/* ---- parsing a number ---- */

typedef struct decimal {
    uint64_t digits; /* the first 19 digits as an integer */
    int count;       /* number of digits, counted from the first that is not 0 */
    int exponent;
    bool negative;
} decimal;

/* Scans [+-] digits [. digits] [e [+-] digits]. Returns the end of the number, or NULL. Some other character
 * must follow the number. */
static const char *scan_decimal(const char *p, decimal *out) {
    uint64_t digits = 0;
    int count = 0, exponent = 0;
    bool any = false;
    const bool negative = *p == '-';
    if (*p == '-' || *p == '+') p++;
    for (unsigned d; (d = (unsigned)(unsigned char)*p - '0') < 10; p++) {
        any = true;
        if (count < 19) digits = 10 * digits + d;
        count += count > 0 || d > 0;
    }
    if (*p == '.') {
        p++;
        for (unsigned d; (d = (unsigned)(unsigned char)*p - '0') < 10; p++) {
            any = true;
            if (count < 19) {
                digits = 10 * digits + d;
                exponent--;
            }
            count += count > 0 || d > 0;
        }
    }
    if (!any) return NULL;
    if (*p == 'e' || *p == 'E') {
        int power = 0;
        p++;
        const bool down = *p == '-';
        if (*p == '-' || *p == '+') p++;
        if (!isdigit((unsigned char)*p)) return NULL;
        for (; isdigit((unsigned char)*p); p++)
            if (power < 100000) power = 10 * power + (*p - '0');
        exponent += down ? -power : power;
    }
    *out = (decimal){digits, count, exponent, negative};
    return p;
}

/* Converts long numbers and numbers with large exponents by the library, which rounds correctly. */
static double convert_slowly(const char *text, const char *end) {
    char copy[LONGEST_NUMBER + 1];
    double value = (double)NAN;
    if ((size_t)(end - text) > LONGEST_NUMBER) return value;
    memcpy(copy, text, (size_t)(end - text));
    copy[end - text] = '\0';
    (void)lg_number_parse(copy, &value); /* a number beyond the largest double stays NaN */
    return value;
}

/* Multiplies or divides the digits by a power of ten up to 10^22. If the digits are below 2^53, both factors
 * are exact and the result is rounded once (Clinger 1990). With more digits, up to 19, it may be wrong by
 * one unit in its last place. For a float this is good enough, unless the value is so close to the middle
 * between two floats that this unit decides how it is rounded; then, or if `exact` is set, the library
 * converts the number. */
static double convert(const decimal *number, bool exact, const char *text, const char *end) {
    static const double powers[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    const uint64_t middle = UINT64_C(1) << 28, below = (UINT64_C(1) << 29) - 1;
    if (number->count > 19 || number->exponent < -22 || number->exponent > 22)
        return convert_slowly(text, end);
    double value = (double)number->digits;
    value = number->exponent < 0 ? value / powers[-number->exponent] : value * powers[number->exponent];
    if (number->digits >> 53 != 0) {
        uint64_t bits;
        memcpy(&bits, &value, sizeof bits);
        const bool decides = ((bits & below) - middle + 2) <= 4;
        if (exact || decides) return convert_slowly(text, end);
    }
    return number->negative ? -value : value;
}

static bool is_blank(char c) {
    return c == ' ' || c == '\t' || c == '\r';
}
static bool ends_field(char c) {
    return c == ',' || c == ';' || c == '#' || c == '\n' || is_blank(c);
}

/* Accepts a word that stands for a missing number, such as nan. Returns the end of the word, or NULL. */
static const char *scan_word(const char *p, const char *end) {
    static const char *const words[] = {"nan", "inf", "infinity", "na", "n/a", "null", "none"};
    if (*p == '-' || *p == '+') p++;
    const char *last = p;
    while (last < end && !ends_field(*last)) last++;
    for (size_t i = 0; i < LG_COUNT(words); i++)
        if ((size_t)(last - p) == strlen(words[i]) && strncasecmp(p, words[i], strlen(words[i])) == 0)
            return last;
    return NULL;
}

/* ---- parsing a line ---- */

static const char *skip_blanks(const char *p) {
    while (is_blank(*p)) p++;
    return p;
}

/* False: the line has more fields than any layout. */
static bool add_field(sample_reader *reader, double value) {
    if (reader->fields <= reader->channels) reader->field[reader->fields] = value;
    reader->fields++;
    return reader->fields <= reader->channels + 1;
}

static bool refuse_word(sample_reader *reader, const char *p, const char *end) {
    int n = 0;
    while (p + n < end && !ends_field(p[n]) && n < 23) n++;
    (void)snprintf(reader->problem, sizeof reader->problem, "'%.*s' is not a number", n, p);
    reader->words = true;
    return false;
}

/* Returns the end of the cell that begins at `from`. A cell that begins with a quote ends behind the
 * closing quote: separators between the quotes belong to the cell, and two quotes stand for one. */
static const char *cell_end(const char *from, const char *to, char separator) {
    bool quoted = from < to && *from == '"';
    for (from += quoted; quoted && from < to; from++) {
        if (*from != '"') continue;
        quoted = from + 1 < to && from[1] == '"';
        from += quoted;
    }
    while (from < to && (separator == ' ' ? !is_blank(*from) : *from != separator)) from++;
    return from;
}

/* Stores the numbers of a line in `field` and their count in `fields`; *open: the line ends with a separator.
 * False: the line holds something else, described in `problem`. The line must end with a newline at `end`. */
static bool split_line(sample_reader *reader, const char *p, const char *end, bool *open) {
    char separator = '\0';
    reader->fields = 0;
    reader->words = *open = false;
    for (uint32_t column = 0; p < end; column++) {
        const bool skipped = column < reader->columns && reader->left_out[column];
        decimal number;
        if (*p == '#' && !skipped) break;
        *open = false;
        if (skipped) {
            p = skip_blanks(cell_end(p, end, reader->separator));
        } else if (*p == ',' || *p == ';') {
            if (!add_field(reader, (double)NAN)) return true;
        } else {
            const char *next = scan_decimal(p, &number);
            const bool usual = next != NULL && ends_field(*next);
            if (!usual) next = scan_word(p, end);
            if (next == NULL) return refuse_word(reader, p, end);
            if (!add_field(reader, usual ? convert(&number, reader->fields == 0, p, next) : (double)NAN))
                return true;
            p = skip_blanks(next);
        }
        if (*p != ',' && *p != ';') continue;
        if (separator != '\0' && *p != separator) return refuse_word(reader, p, p + 1);
        separator = *p;
        *open = true;
        p = skip_blanks(p + 1);
    }
    return true;
}

/* The same. If only its place makes the first column one of times, and the first sample has no number there,
 * the column is left out. */
static bool read_line(sample_reader *reader, const char *p, const char *end, bool *open) {
    if (split_line(reader, p, end, open)) return true;
    if (reader->guess[0] == '\0' || reader->lines > 0) return false;
    reader->left_out[0] = true;
    reader->left_out[0] = split_line(reader, p, end, open);
    if (!reader->left_out[0]) return false;
    (void)snprintf(reader->extra, sizeof reader->extra, "%s", reader->guess);
    reader->guess[0] = '\0';
    reader->layout = LAYOUT_VALUES;
    return true;
}

static sample_kind refuse_count(sample_reader *reader) {
    const uint32_t c = reader->channels, timed = reader->layout == LAYOUT_TIMED;
    const bool more = reader->fields > c + 1;
    char wanted[64];
    if (reader->layout == LAYOUT_UNKNOWN)
        (void)snprintf(wanted, sizeof wanted, "%u, or %u with a time", c, c + 1);
    else
        (void)snprintf(wanted, sizeof wanted, "%u%s", c + timed, timed != 0 ? " with the time" : "");
    (void)snprintf(reader->problem, sizeof reader->problem, "%s%u number%s, not %s", more ? "more than " : "",
                   more ? c + 1 : reader->fields, reader->fields == 1 ? "" : "s", wanted);
    return SAMPLE_MALFORMED;
}

/* The layout that fits the line's number of fields. */
static sample_layout layout_of(const sample_reader *reader) {
    const uint32_t c = reader->channels;
    if (reader->fields == c) return LAYOUT_VALUES;
    return reader->fields == c + 1 && isfinite(reader->field[0]) ? LAYOUT_TIMED : LAYOUT_UNKNOWN;
}

/* Returns whether the fields fit the layout. If the layout is still unknown, sets it from the fields. */
static bool fits_layout(sample_reader *reader, bool open) {
    const uint32_t c = reader->channels;
    if (reader->layout == LAYOUT_UNKNOWN) reader->layout = layout_of(reader);
    if (reader->layout == LAYOUT_UNKNOWN) return false;
    const uint32_t wanted = c + (reader->layout == LAYOUT_TIMED);
    if (open && reader->fields + 1 == wanted) (void)add_field(reader, (double)NAN);
    return reader->fields == wanted;
}

/* Returns whether the line's last number ends exactly at the end of the file, so that it may be cut. */
static bool may_be_cut(const sample_reader *reader, const char *from, const char *end) {
    if (!reader->unended || reader->lines == 0) return false;
    return !ends_field(end[-1]) && memchr(from, '#', (size_t)(end - from)) == NULL;
}

static sample_kind take_line(sample_reader *reader, const char *p, const char *end, float *sample,
                             double *time) {
    bool open;
    if (!read_line(reader, p, end, &open)) return SAMPLE_MALFORMED;
    if (!fits_layout(reader, open)) return refuse_count(reader);
    const uint32_t timed = reader->layout == LAYOUT_TIMED;
    const bool cut = may_be_cut(reader, p, end);
    *time = timed ? reader->field[0] : (double)NAN;
    for (uint32_t c = 0; c < reader->channels; c++) {
        const double value = reader->field[reader->place[c] + timed];
        sample[c] = !cut && fabs(value) <= (double)FLT_MAX ? (float)value : NAN;
    }
    if (cut)
        (void)snprintf(reader->problem, sizeof reader->problem,
                       "the last line has no line end, so its last number may be cut");
    else if (timed && !isfinite(*time))
        (void)snprintf(reader->problem, sizeof reader->problem, "the time is not a number");
    else
        return SAMPLE_READ;
    return SAMPLE_MALFORMED;
}

/* ---- lines of words ---- */

/* Returns the character that separates the cells of a line: a comma if the line has one, else a semicolon if
 * it has one, else a blank. */
static char separator_of(const char *from, const char *to) {
    return cell_end(from, to, ',') < to ? ',' : cell_end(from, to, ';') < to ? ';' : ' ';
}

/* Finds the next cell of a line, without blanks around it; moves *p behind the separator after it. */
static void next_name(const char **p, const char *to, char separator, const char **name, size_t *length) {
    const char *from = *p, *end = cell_end(from, to, separator);
    *p = end < to ? end + 1 : to;
    while (separator == ' ' && *p < to && is_blank(**p)) (*p)++;
    while (from < end && is_blank(*from)) from++;
    while (end > from && is_blank(end[-1])) end--;
    *name = from;
    *length = (size_t)(end - from);
}

static uint32_t count_names(const char *from, const char *to) {
    const char separator = separator_of(from, to), *name;
    uint32_t count = separator != ' ' && to[-1] == separator;
    size_t length;
    while (from < to && is_blank(*from)) from++;
    for (; from < to; count++) next_name(&from, to, separator, &name, &length);
    return count;
}

/* FNV-1a hash of the line without blanks at its end. */
static uint64_t hash_line(const char *from, const char *to) {
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    while (to > from && is_blank(to[-1])) to--;
    for (; from < to; from++) hash = (hash ^ (unsigned char)*from) * UINT64_C(0x100000001b3);
    return hash;
}

/* Returns whether this is a line of words before the first sample, or a repetition of such a line. */
static bool is_header(sample_reader *reader, const char *from, const char *to) {
    const uint64_t hash = hash_line(from, to);
    for (uint32_t i = 0; i < reader->headers; i++)
        if (reader->header[i] == hash) return true;
    if (reader->lines > 0 || reader->headers == SAMPLE_HEADERS) return false;
    reader->header[reader->headers++] = hash;
    return true;
}

/* ---- names of columns ---- */

/* Returns whether the cell is the channel's name, either as it is or in quotes, where "" stands for ". */
static bool is_name(const sample_reader *reader, uint32_t channel, const char *cell, size_t length) {
    const char *name = reader->names[channel];
    const bool quoted = length > 1 && cell[0] == '"' && cell[length - 1] == '"';
    const char *end = cell + length - quoted;
    for (cell += quoted; cell < end && *cell == *name; cell++, name++)
        if (quoted && *cell == '"' && *++cell != '"') return false;
    return cell == end && *name == '\0';
}

/* Finds the column of each channel, column (channels); UINT32_MAX if there is none. *columns: number of
 * columns; *found: number of channels found. False: a channel's name occurs twice. */
static bool find_columns(sample_reader *reader, const char *from, const char *to, uint32_t *column,
                         uint32_t *columns, uint32_t *found) {
    const char separator = separator_of(from, to);
    for (uint32_t c = 0; c < reader->channels; c++) column[c] = UINT32_MAX;
    *columns = *found = 0;
    for (const char *p = from; p < to; ++*columns) {
        const char *name;
        size_t length;
        next_name(&p, to, separator, &name, &length);
        for (uint32_t c = 0; c < reader->channels; c++) {
            if (!is_name(reader, c, name, length)) continue;
            if (column[c] != UINT32_MAX) {
                (void)snprintf(reader->problem, sizeof reader->problem, "there are two columns %.64s",
                               reader->names[c]);
                return false;
            }
            column[c] = *columns;
            ++*found;
        }
    }
    return true;
}

/* Whether the name is t, time, times, timestamp or datetime, also with a unit, as in "time_s" or "t [s]". */
static bool is_time(const char *name, size_t length) {
    static const char *const names[] = {"t", "time", "times", "timestamp", "datetime"};
    size_t letters = 0;
    while (length > 0 && *name == '"') name++, length--;
    while (letters < length && isalpha((unsigned char)name[letters])) letters++;
    for (size_t i = 0; i < LG_COUNT(names); i++)
        if (letters == strlen(names[i]) && strncasecmp(name, names[i], letters) == 0) return true;
    return false;
}

/* Marks the columns that are neither channels nor times as left out, and lists their names. *timed
 * becomes 1 if a column before the channels is one of times. False: a column behind a channel is one. */
static bool leave_out(sample_reader *reader, const char *from, const char *to, uint32_t columns,
                      uint32_t *timed) {
    const uint32_t others = columns - reader->channels;
    uint32_t used = 0;
    bool behind = false;
    *timed = 0;
    reader->separator = separator_of(from, to);
    for (uint32_t i = 0; from < to; i++) {
        const char *name;
        size_t length;
        next_name(&from, to, reader->separator, &name, &length);
        behind = behind || !reader->left_out[i];
        if (!reader->left_out[i]) continue;
        const bool times = is_time(name, length);
        if (*timed == 0 && !behind && (times || (i == 0 && others == 1))) {
            reader->left_out[i] = false;
            *timed = 1;
            if (!times) (void)snprintf(reader->guess, sizeof reader->guess, "%.*s", (int)length, name);
            continue;
        }
        if (times && *timed == 0) {
            (void)snprintf(reader->problem, sizeof reader->problem,
                           "column %.*s is behind a channel; expected are the channels, alone or after a "
                           "column of times",
                           (int)(length < 32 ? length : 32), name);
            return false;
        }
        if (used + 1 >= sizeof reader->extra) continue;
        used += (uint32_t)snprintf(reader->extra + used, sizeof reader->extra - used, "%s%.*s",
                                   used > 0 ? ", " : "", (int)length, name);
    }
    return true;
}

/* Sets the places of the channels from the columns of their names. False: the columns do not fit; `problem`
 * says why. */
static bool set_places(sample_reader *reader, const char *from, const char *to, const uint32_t *column,
                       uint32_t columns) {
    for (uint32_t c = 0; c < reader->channels; c++) {
        if (column[c] == UINT32_MAX) {
            (void)snprintf(reader->problem, sizeof reader->problem,
                           "there is no column %.64s, which the model was trained with", reader->names[c]);
            return false;
        }
    }
    reader->left_out = app_alloc(columns, sizeof *reader->left_out);
    reader->columns = columns;
    for (uint32_t i = 0; i < columns; i++) reader->left_out[i] = true;
    for (uint32_t c = 0; c < reader->channels; c++) reader->left_out[column[c]] = false;
    uint32_t timed;
    if (!leave_out(reader, from, to, columns, &timed)) return false;
    for (uint32_t c = 0; c < reader->channels; c++) {
        uint32_t place = 0;
        for (uint32_t i = 0; i < column[c]; i++) place += !reader->left_out[i];
        reader->place[c] = place - timed;
    }
    if (reader->extra[0] != '\0') reader->layout = timed == 1 ? LAYOUT_TIMED : LAYOUT_VALUES;
    reader->named = true;
    return true;
}

/* Processes a line of words before the first sample. Returns false if it names only some of the channels, or
 * names one twice. If it names no channel, it returns true, and the feed may be rejected at the first
 * sample. */
static bool take_names(sample_reader *reader, const char *from, const char *to) {
    uint32_t columns, found;
    if (reader->names == NULL || reader->named) return true;
    APP_FREE uint32_t *column = app_alloc(reader->channels, sizeof *column);
    bool fits = find_columns(reader, from, to, column, &columns, &found);
    if (fits && found == 0) reader->unnamed = columns == reader->channels || columns == reader->channels + 1;
    if (fits && found > 0) fits = set_places(reader, from, to, column, columns);
    return fits;
}

/* The same for a comment before the first sample, which numpy.savetxt writes. It is a comment only, unless it
 * names all channels. */
static bool take_comment(sample_reader *reader, const char *from, const char *to) {
    uint32_t columns, found;
    if (reader->names == NULL || reader->named) return true;
    APP_FREE uint32_t *column = app_alloc(reader->channels, sizeof *column);
    from = skip_blanks(from);
    if (*from == ',' || *from == ';') from++;
    if (!find_columns(reader, from, to, column, &columns, &found) || found < reader->channels) return true;
    return set_places(reader, from, to, column, columns);
}

/* ---- reading lines from the file ---- */

/* Waits for more data. False: end of file, Ctrl-C or an error. */
static bool fill(sample_reader *reader) {
    struct pollfd poll_in = {reader->file, POLLIN, 0};
    if (reader->begin > 0) {
        memmove(reader->buffer, reader->buffer + reader->begin, reader->end - reader->begin);
        reader->end -= reader->begin;
        reader->begin = 0;
    }
    (void)fflush(stdout);
    while (!app_interrupted()) {
        const int ready = poll(&poll_in, 1, PATIENCE_MS);
        if (reader->idle != NULL) reader->idle(reader->user);
        if (ready == 0 || (ready < 0 && errno == EINTR)) continue;
        const ssize_t n = read(reader->file, reader->buffer + reader->end, reader->room - reader->end);
        if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
        if (n < 0) reader->failure = errno;
        if (n == 0) reader->at_end = true;
        if (n > 0) reader->end += (size_t)n;
        return n > 0;
    }
    return false;
}

typedef enum found { FOUND_LINE, FOUND_LONG_LINE, FOUND_NOTHING } found;

/* Finds the next line, without its line end, as *from..*to. A newline follows it. */
static found next_line(sample_reader *reader, const char **from, const char **to) {
    size_t searched = 0; /* bytes after `begin` that are known to hold no line end */
    for (;;) {
        char *text = reader->buffer + reader->begin;
        const size_t held = reader->end - reader->begin;
        char *end = held > searched ? memchr(text + searched, '\n', held - searched) : NULL;
        if (end != NULL || (reader->at_end && held > 0)) {
            reader->unended = end == NULL;
            if (end == NULL) {
                /* The last line without a line end; the buffer has room for one more byte. */
                end = text + held;
                *end = '\n';
            }
            const bool tail = reader->skipping;
            reader->begin = (size_t)(end - reader->buffer) + 1;
            if (reader->begin > reader->end) reader->begin = reader->end;
            reader->skipping = false;
            reader->line++;
            *from = text;
            *to = end;
            return tail ? FOUND_LONG_LINE : FOUND_LINE;
        }
        if (reader->at_end) {
            const bool tail = reader->skipping;
            reader->skipping = false;
            reader->line += tail;
            return tail ? FOUND_LONG_LINE : FOUND_NOTHING;
        }
        searched = held;
        if (held == reader->room) {
            reader->skipping = true;
            reader->begin = reader->end = searched = 0;
        }
        if (!fill(reader) && !reader->at_end) return FOUND_NOTHING;
    }
}

/* Returns the line's text without blanks before it, and, if it is the first line, without the UTF-8 byte
 * order mark. */
static const char *text_of(bool first, const char *from, const char *to) {
    if (first && to - from >= 3 && memcmp(from, "\xef\xbb\xbf", 3) == 0) from += 3;
    return skip_blanks(from);
}

static bool is_empty(const char *from, const char *to) {
    return from >= to || lg_csv_comment(from) > 0;
}

/* ---- finding the layout ---- */

typedef struct election {
    uint32_t votes[3], lines; /* votes: number of lines per layout */
    /* names: layout that the line of names suggests; first: layout of the first line of numbers. */
    sample_layout names, first;
} election;

/* Counts one more line. Returns true if the layout is now decided. */
static bool elect(sample_reader *reader, election *e, const char *from, const char *to) {
    bool open;
    from = text_of(e->lines++ == 0, from, to);
    if (is_empty(from, to)) return false;
    sample_layout vote = LAYOUT_UNKNOWN;
    if (split_line(reader, from, to, &open)) {
        vote = layout_of(reader);
        if (open && vote == LAYOUT_VALUES && e->names == LAYOUT_TIMED) vote = LAYOUT_TIMED;
        if (e->first == LAYOUT_UNKNOWN) e->first = vote;
    } else if (reader->words && e->first == LAYOUT_UNKNOWN && e->names == LAYOUT_UNKNOWN) {
        const uint32_t names = count_names(from, to);
        vote = e->names = names == reader->channels       ? LAYOUT_VALUES
                          : names == reader->channels + 1 ? LAYOUT_TIMED
                                                          : LAYOUT_UNKNOWN;
    }
    return vote != LAYOUT_UNKNOWN && ++e->votes[vote] == LAYOUT_VOTES;
}

/* Examines the first lines in the buffer without consuming them, so that they are read again later. */
static void look_ahead(sample_reader *reader) {
    election e = {{0, 0, 0}, 0, LAYOUT_UNKNOWN, LAYOUT_UNKNOWN};
    size_t at = 0; /* offset of the examined line from `begin` */
    bool decided = false;
    while (!decided && e.lines < LAYOUT_LINES) {
        char *text = reader->buffer + reader->begin + at;
        const size_t held = reader->end - reader->begin - at;
        char *end = memchr(text, '\n', held);
        if (end == NULL && reader->at_end && held > 0) {
            end = text + held;
            *end = '\n';
        }
        if (end != NULL) {
            decided = elect(reader, &e, text, end);
            at += (size_t)(end - text) + 1;
            if (at > reader->end - reader->begin) break;
        } else if (reader->at_end || at + held == reader->room || (!fill(reader) && !reader->at_end)) {
            break;
        }
    }
    const uint32_t *votes = e.votes;
    reader->layout = votes[LAYOUT_TIMED] > votes[LAYOUT_VALUES]   ? LAYOUT_TIMED
                     : votes[LAYOUT_VALUES] > votes[LAYOUT_TIMED] ? LAYOUT_VALUES
                                                                  : e.first;
    /* A line of names alone does not decide. */
    if (e.first == LAYOUT_UNKNOWN) reader->layout = LAYOUT_UNKNOWN;
}

sample_kind sample_next(sample_reader *reader, float *sample, double *time) {
    const char *from, *to;
    if (!reader->looked) look_ahead(reader);
    reader->looked = true;
    for (;;) {
        const found what = next_line(reader, &from, &to);
        *time = (double)NAN;
        if (what == FOUND_NOTHING)
            return reader->failure != 0 ? SAMPLE_FAILED : reader->at_end ? SAMPLE_END : SAMPLE_STOPPED;
        if (what == FOUND_LONG_LINE) {
            reader->lines++;
            (void)snprintf(reader->problem, sizeof reader->problem, "longer than %zu bytes", reader->room);
            return SAMPLE_MALFORMED;
        }
        from = text_of(reader->line == 1, from, to);
        const size_t sign = from < to && reader->lines == 0 ? lg_csv_comment(from) : 0;
        if (sign > 0 && !take_comment(reader, from + sign, to)) return SAMPLE_REFUSED;
        if (is_empty(from, to)) continue;
        const sample_kind kind = take_line(reader, from, to, sample, time);
        if (kind == SAMPLE_MALFORMED && reader->words && is_header(reader, from, to)) {
            if (reader->lines == 0 && !take_names(reader, from, to)) return SAMPLE_REFUSED;
            continue;
        }
        reader->lines++;
        return kind;
    }
}
