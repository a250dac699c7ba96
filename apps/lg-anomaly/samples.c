/* Reads the lines of a feed, any of which may be damaged. */
#include "lg-anomaly/samples.h"

#include <ctype.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum {
    LONGEST = 1 << 18,   /* bytes of the longest line, if there are few channels */
    LONGEST_FIELD = 512, /* bytes per number of the longest line, if there are many channels */
    LAYOUT_VOTES = 3,    /* lines of the same kind that decide the layout */
    PATIENCE_MS = 200    /* time within which Ctrl-C is noticed */
};

/* Waits for more data. False: Ctrl-C. */
static bool wait_for_data(void *user) {
    const sample_reader *reader = user;
    struct pollfd poll_in = {reader->csv.file, POLLIN, 0};
    (void)fflush(stdout);
    while (!app_interrupted()) {
        const int ready = poll(&poll_in, 1, PATIENCE_MS);
        if (reader->idle != NULL) reader->idle(reader->user);
        if (ready != 0 && (ready > 0 || errno != EINTR)) return true;
    }
    return false;
}

void sample_reader_open(int file, const char *name, uint32_t channels, lg_frame_text *names,
                        sample_reader *out) {
    const size_t wanted = ((size_t)channels + 1) * LONGEST_FIELD;
    *out = (sample_reader){.channels = channels, .names = names};
    out->place = app_alloc(channels, sizeof *out->place);
    out->field = app_alloc((size_t)channels + 1, sizeof *out->field);
    out->want = app_alloc(channels, sizeof *out->want);
    for (uint32_t c = 0; c < channels; c++) {
        out->place[c] = c;
        out->want[c] = (lg_frame_want){.name = names != NULL ? names[c] : "", .optional = true};
    }
    if (lg_csv_open_feed(NULL, file, name, wanted > LONGEST ? wanted : LONGEST, wait_for_data, out, &out->csv,
                         &out->error) != LG_OK)
        app_out_of_memory();
    out->frame = (lg_frame){.shown = out->csv.shown, .place = "line", .want = out->want, .wants = channels};
}

void sample_reader_close(sample_reader *reader) {
    for (uint32_t i = 0; i < reader->looked; i++) free(reader->ahead[i].text);
    free(reader->place);
    free(reader->field);
    free(reader->want);
    lg_frame_close(&reader->frame);
    lg_csv_close(&reader->csv);
    *reader = (sample_reader){.channels = 0};
}

/* ---- cells ---- */

/* Tabs are blanks, unless they separate the names. */
static bool is_blank(const sample_reader *reader, char c) {
    return c == ' ' || c == '\r' || (c == '\t' && reader->csv.separator != '\t');
}
static bool separates(const sample_reader *reader, char c) {
    return c == ',' || c == ';' || (c == '\t' && !is_blank(reader, c));
}
static bool ends_field(const sample_reader *reader, char c) {
    return separates(reader, c) || c == '#' || c == '\0' || is_blank(reader, c);
}
/* Whether a cell, or what is in its quotes, ends at p. */
static bool ends_cell(const sample_reader *reader, const char *p, bool quoted) {
    return (!quoted || *p == '"') && ends_field(reader, p[quoted]);
}
static char *skip_blanks(const sample_reader *reader, char *p) {
    while (is_blank(reader, *p)) p++;
    return p;
}

/* Returns the end of a word that stands for a missing number, such as nan, or NULL. */
static const char *scan_word(const sample_reader *reader, const char *p, bool quoted) {
    static const char *const words[] = {LG_MISSING_WORDS, "none", "inf", "infinity"};
    p += *p == '-' || *p == '+';
    for (size_t i = 0; i < LG_COUNT(words); i++) {
        const size_t length = strlen(words[i]);
        if (strncasecmp(p, words[i], length) == 0 && ends_cell(reader, p + length, quoted)) return p + length;
    }
    return NULL;
}

/* Returns the end of a cell. A cell that begins with a quote ends behind the closing quote: separators
 * between the quotes belong to the cell, and two quotes stand for one. */
static char *cell_end(const sample_reader *reader, char *at) {
    const char separator = reader->csv.separator;
    bool quoted = *at == '"';
    for (at += quoted; quoted && *at != '\0'; at++) {
        if (*at != '"') continue;
        quoted = at[1] == '"';
        at += quoted;
    }
    while (*at != '\0' && (separator == ' ' ? !is_blank(reader, *at) : *at != separator)) at++;
    return at;
}

/* ---- parsing a line ---- */

/* Writes what is wrong with the line. */
#define REJECT(reader, ...)                                                                                  \
    ((void)snprintf((reader)->problem, sizeof(reader)->problem, __VA_ARGS__), SAMPLE_MALFORMED)

/* False: the line has more fields than any layout. */
static bool add_field(sample_reader *reader, double value) {
    if (reader->fields <= reader->channels) reader->field[reader->fields] = value;
    reader->fields++;
    return reader->fields <= reader->channels + 1;
}

/* A number in quotes with something behind them is no word. */
static bool reject_word(sample_reader *reader, const char *word) {
    int n = 0;
    double number;
    const char *end = *word == '"' ? lg_decimal(word + 1, &number) : NULL;
    while (!ends_field(reader, word[n]) && n < 23) n++;
    (void)REJECT(reader, "'%.*s' is not a number", n, word);
    reader->words = end == NULL || *end != '"';
    return false;
}

/* Reads the number or time at p, which may be in quotes. Returns the end of the cell, or NULL. */
static const char *scan_number(sample_reader *reader, const char *p, bool timed, double *value) {
    lg_moment now;
    const bool quoted = *p == '"';
    p += quoted;
    const char *next = timed ? lg_moment_scan(p, &now) : lg_decimal(p, value);
    const bool ends = next != NULL && ends_cell(reader, next, quoted);
    if (timed && ends) {
        const bool packed = now.format == LG_TIME_SECONDS && lg_moment_is_packed(now.seconds);
        *value = packed ? (double)NAN : lg_clock_read(&reader->clock, now);
        /* If the first sample has a damaged time, the next one decides the format. */
        if (isnan(*value) && reader->lines < 2) reader->clock = (lg_clock){.format = LG_TIME_NONE};
    }
    if (!ends) {
        next = quoted && ends_cell(reader, p, true) ? p : scan_word(reader, p, quoted);
        *value = (double)NAN;
    }
    return next != NULL ? next + quoted : NULL;
}

/* Stores the numbers of a line in `field` and their count in `fields`; *open: the line ends with a separator.
 * False: the line holds something else, described in `problem`. */
static bool split_line(sample_reader *reader, char *p, bool *open) {
    char separator = '\0';
    bool blanks = false;
    uint32_t column = 0;
    reader->fields = 0;
    reader->words = *open = false;
    for (; *p != '\0'; column++) {
        const bool named = reader->frame.columns > 0, of_time = column + 1 == reader->time;
        const bool skipped =
            column < reader->frame.columns && !of_time && !lg_frame_is_wanted(&reader->frame, column);
        /* Without names the first cell may be a time. */
        const bool timed = named ? of_time : column == 0 && reader->layout != LAYOUT_VALUES;
        if (*p == '#' && !skipped) break;
        *open = false;
        if (skipped) {
            p = skip_blanks(reader, cell_end(reader, p));
        } else {
            double value = (double)NAN;
            if (!separates(reader, *p)) {
                const char *next = scan_number(reader, p, timed, &value);
                if (next == NULL) return reject_word(reader, p);
                p = skip_blanks(reader, p + (next - p));
            }
            if (!add_field(reader, value)) return true;
        }
        if (!separates(reader, *p)) {
            blanks = blanks || (*p != '\0' && *p != '#');
            continue;
        }
        if (separator != '\0' && *p != separator) return reject_word(reader, p);
        separator = *p;
        *open = true;
        p = skip_blanks(reader, p + 1);
    }
    column += *open;
    if (blanks && separator != '\0')
        (void)REJECT(reader, "blanks separate some numbers, '%c' others", separator);
    else if (column < reader->frame.columns)
        (void)REJECT(reader, "%u cells for %u names", column, reader->frame.columns);
    else
        return true;
    return false;
}

void sample_leave_times(sample_reader *reader) {
    reader->time = 0;
    reader->guessed = false;
    reader->layout = LAYOUT_VALUES;
}

/* The same. If only its place makes the first column one of times, and it has no time before something that
 * is no number, the column is left out. */
static bool read_line(sample_reader *reader, char *p, bool *open) {
    if (split_line(reader, p, open)) return true;
    if (!reader->guessed || reader->clock.format != LG_TIME_NONE) return false;
    reader->time = 0;
    if (!split_line(reader, p, open)) {
        reader->time = 1;
        return false;
    }
    lg_name_list_add(&reader->extra, reader->frame.name[0]);
    sample_leave_times(reader);
    return true;
}

static sample_kind reject_count(sample_reader *reader) {
    const uint32_t c = reader->channels, timed = reader->layout == LAYOUT_TIMED;
    const bool more = reader->fields > c + 1;
    char wanted[64];
    if (reader->layout == LAYOUT_UNKNOWN)
        (void)snprintf(wanted, sizeof wanted, "%u, or %u with a time", c, c + 1);
    else
        (void)snprintf(wanted, sizeof wanted, "%u%s", c + timed, timed != 0 ? " with the time" : "");
    return REJECT(reader, "%s%u number%s, not %s", more ? "more than " : "", more ? c + 1 : reader->fields,
                  reader->fields == 1 ? "" : "s", wanted);
}

/* The layout that fits the line's number of fields. */
static sample_layout layout_of(const sample_reader *reader) {
    const uint32_t c = reader->channels;
    if (reader->fields == c) return LAYOUT_VALUES;
    return reader->fields == c + 1 && isfinite(reader->field[0]) ? LAYOUT_TIMED : LAYOUT_UNKNOWN;
}

static sample_kind take_line(sample_reader *reader, const sample_line *line, char *p, float *sample,
                             double *time) {
    bool open;
    if (!read_line(reader, p, &open)) return SAMPLE_MALFORMED;
    if (reader->layout == LAYOUT_UNKNOWN) reader->layout = layout_of(reader);
    const uint32_t timed = reader->layout == LAYOUT_TIMED, wanted = reader->channels + timed;
    const bool known = reader->layout != LAYOUT_UNKNOWN;
    if (known && open && reader->fields + 1 == wanted) (void)add_field(reader, (double)NAN);
    if (!known || reader->fields != wanted) return reject_count(reader);
    /* the line's last number may be cut if it ends exactly at the end of the file */
    const bool cut =
        !line->closed && reader->lines > 0 && !ends_field(reader, p[strlen(p) - 1]) && strchr(p, '#') == NULL;
    *time = timed ? reader->field[0] : (double)NAN;
    for (uint32_t c = 0; c < reader->channels; c++) {
        const double value = reader->field[reader->place[c] + timed];
        sample[c] = !cut && fabs(value) <= (double)FLT_MAX ? (float)value : NAN;
    }
    if (!cut && !(timed && !isfinite(*time))) return SAMPLE_READ;
    return REJECT(reader, "%s",
                  cut ? "the last line has no line end, so its last number may be cut"
                      : "the time is not a number");
}

/* ---- lines of words ---- */

/* Returns whether this is a line of words before the first sample, or a repetition of such a line. */
static bool is_header(sample_reader *reader, const char *line) {
    uint64_t hash = UINT64_C(0xcbf29ce484222325); /* FNV-1a, without blanks at the end */
    const char *end = line + strlen(line);
    while (end > line && is_blank(reader, end[-1])) end--;
    for (; line < end; line++) hash = (hash ^ (unsigned char)*line) * UINT64_C(0x100000001b3);
    for (uint32_t i = 0; i < reader->headers; i++)
        if (reader->header[i] == hash) return true;
    if (reader->lines > 0 || reader->headers == SAMPLE_HEADERS) return false;
    reader->header[reader->headers++] = hash;
    return true;
}

/* Whether the name is t, time, times, seconds, timestamp or datetime, also with a unit, as in "time_s" or
 * "t [s]". */
static bool is_time(const char *name) {
    static const char *const names[] = {"t", "time", "times", "seconds", "timestamp", "datetime"};
    size_t letters = 0;
    while (isalpha((unsigned char)name[letters])) letters++;
    for (size_t i = 0; i < LG_COUNT(names); i++)
        if (letters == strlen(names[i]) && strncasecmp(name, names[i], letters) == 0) return true;
    return false;
}

/* Returns the number of cells that a line should have. */
static uint32_t cells_of(const sample_reader *reader) {
    const uint32_t names = reader->frame.columns;
    return names > 0 ? names : reader->channels + (reader->layout == LAYOUT_TIMED);
}

/* Reads the names of a line. If it has no separators, blanks separate them. */
static lg_frame read_names(sample_reader *reader, const char *line) {
    lg_frame read = {.shown = reader->csv.shown, .place = "line", .header = (size_t)reader->line};
    APP_FREE char *text = app_format("%s", line);
    lg_csv *csv = &reader->csv;
    char *at = text, *cell;
    csv->separator = lg_csv_separator(text, ' ');
    if (csv->separator == ' ') lg_csv_join_blanks(text, ' ');
    while (at != NULL && lg_csv_cell(csv, &at, &cell, NULL) == LG_OK && (at != NULL || *cell != '\0'))
        if (lg_frame_add_name(&read, cell, NULL) != LG_OK) break;
    return read;
}

/* Finds the channels and the times among the columns, and lists the names of the others. */
static lg_status find_columns(sample_reader *reader) {
    lg_frame *f = &reader->frame;
    uint32_t numbers = 0;
    reader->time = 0;
    reader->guessed = false;
    reader->clock = (lg_clock){.format = LG_TIME_NONE};
    for (uint32_t c = 0; c < reader->channels; c++)
        if (!reader->want[c].there)
            return lg_frame_fail(f, 0, NULL, &reader->error,
                                 "there is no column %s, which the model was trained with", reader->names[c]);
    for (uint32_t i = 0; i < f->columns; i++) {
        const bool times = is_time(f->name[i]);
        if (f->use[i].value > 0) {
            reader->place[f->use[i].value - 1] = numbers++;
        } else if (reader->time == 0 && numbers == 0 &&
                   (times || (i == 0 && f->columns == reader->channels + 1))) {
            reader->time = i + 1;
            reader->guessed = !times;
        } else if (times && reader->time == 0) {
            return lg_frame_fail(f, 0, NULL, &reader->error,
                                 "column %s is behind a channel; expected are the channels, alone or after a "
                                 "column of times",
                                 f->name[i]);
        } else {
            lg_name_list_add(&reader->extra, f->name[i]);
        }
    }
    if (reader->extra.used > 0 || reader->renamed)
        reader->layout = reader->time > 0 ? LAYOUT_TIMED : LAYOUT_VALUES;
    return LG_OK;
}

/* Takes the columns from a line of words if it names all channels; frame.header is then its line. If the
 * first such line names no channel, the feed may be rejected at the first sample. Fails if the line names
 * only some of the channels, or names one twice. Later lines fail so only if lines have as many cells and the
 * line was not before the first sample (known). A comment, as numpy.savetxt writes it, is a comment only,
 * unless it names all channels. */
static lg_status take_names(sample_reader *reader, char *line, bool comment, bool known) {
    lg_frame *f = &reader->frame;
    const char separator = reader->csv.separator;
    uint32_t found = 0;
    if (reader->names == NULL) return LG_OK;
    line = skip_blanks(reader, line);
    lg_frame now = read_names(reader, line + (comment && (*line == ',' || *line == ';')));
    now.want = reader->want;
    now.wants = reader->channels;
    bool same = now.columns == f->columns;
    for (uint32_t i = 0; same && i < now.columns; i++) same = strcmp(now.name[i], f->name[i]) == 0;
    const bool first = reader->lines == 0 && f->columns == 0,
               strict = !comment && (first || (!known && now.columns == cells_of(reader)));
    const lg_status status = lg_frame_find(&now, strict ? &reader->error : NULL);
    for (uint32_t c = 0; status == LG_OK && c < reader->channels; c++) found += reader->want[c].there;
    if ((found == reader->channels && !same) || (strict && (found > 0 || status != LG_OK))) {
        lg_frame_close(f);
        *f = now;
        reader->renamed = !first;
        return status != LG_OK ? status : find_columns(reader);
    }
    if (same)
        f->header = now.header;
    else
        reader->csv.separator = separator;
    if (first && !comment) reader->unnamed = now.columns - reader->channels < 2;
    lg_frame_close(&now);
    return LG_OK;
}

/* ---- reading lines ---- */

/* Reads a line from the file. Its text is valid until the next call. */
static bool read_file_line(sample_reader *reader, sample_line *out) {
    bool more = false;
    const lg_status status = lg_csv_next(&reader->csv, &more, &reader->error);
    if (status == LG_OUT_OF_MEMORY) app_out_of_memory();
    *out = (sample_line){reader->csv.line, reader->csv.number, reader->csv.closed, reader->csv.cut};
    return status == LG_OK && more;
}

/* Counts the vote of one more line. `names`: the layout that the line of names suggests; *first: that of the
 * first line of numbers. Returns true if the layout is now decided. */
static bool elect(sample_reader *reader, char *line, uint32_t votes[3], sample_layout *names,
                  sample_layout *first) {
    bool open;
    sample_layout vote = LAYOUT_UNKNOWN;
    if (*line == '\0' || lg_csv_comment(line) > 0) return false;
    if (split_line(reader, line, &open)) {
        vote = layout_of(reader);
        if (open && vote == LAYOUT_VALUES && *names == LAYOUT_TIMED) vote = LAYOUT_TIMED;
        if (*first == LAYOUT_UNKNOWN) *first = vote;
    } else if (reader->words && *first == LAYOUT_UNKNOWN && *names == LAYOUT_UNKNOWN) {
        lg_frame read = read_names(reader, line);
        const uint32_t count = read.columns;
        lg_frame_close(&read);
        vote = *names = count == reader->channels       ? LAYOUT_VALUES
                        : count == reader->channels + 1 ? LAYOUT_TIMED
                                                        : LAYOUT_UNKNOWN;
    }
    return vote != LAYOUT_UNKNOWN && ++votes[vote] == LAYOUT_VOTES;
}

/* Examines the first lines for the layout and keeps them. */
static void look_ahead(sample_reader *reader) {
    sample_layout names = LAYOUT_UNKNOWN, first = LAYOUT_UNKNOWN;
    uint32_t votes[3] = {0};
    bool decided = false;
    while (!decided && reader->looked < SAMPLE_AHEAD) {
        sample_line *line = &reader->ahead[reader->looked];
        if (!read_file_line(reader, line)) break;
        line->text = app_format("%s", line->text);
        reader->looked++;
        decided = !line->cut && elect(reader, skip_blanks(reader, line->text), votes, &names, &first);
    }
    reader->clock = (lg_clock){.format = LG_TIME_NONE};
    /* A line of names alone does not decide. */
    reader->layout = first == LAYOUT_UNKNOWN                      ? LAYOUT_UNKNOWN
                     : votes[LAYOUT_TIMED] > votes[LAYOUT_VALUES] ? LAYOUT_TIMED
                     : votes[LAYOUT_VALUES] > votes[LAYOUT_TIMED] ? LAYOUT_VALUES
                                                                  : first;
}

static bool hides_row(const sample_reader *reader, const char *line) {
    const lg_csv as = {.separator =
                           reader->frame.columns > 0 ? reader->csv.separator : lg_csv_separator(line, ' '),
                       .cells = cells_of(reader)};
    return reader->lines > 0 && lg_csv_hides_row(&as, line);
}

sample_kind sample_next(sample_reader *reader, float *sample, double *time) {
    sample_line line;
    if (reader->looked == 0) look_ahead(reader);
    while (reader->given < reader->looked || read_file_line(reader, &line)) {
        if (reader->given < reader->looked) line = reader->ahead[reader->given++];
        char *text = skip_blanks(reader, line.text);
        *time = (double)NAN;
        reader->line = line.number;
        if (line.cut) {
            reader->lines++;
            return REJECT(reader, "longer than %zu bytes", reader->csv.longest);
        }
        const size_t sign = lg_csv_comment(text);
        if (sign > 0 && take_names(reader, text + sign, true, false) != LG_OK) break;
        if (sign > 0 && hides_row(reader, text)) {
            reader->lines++;
            return REJECT(reader, "begins as a comment, but has as many cells as a row");
        }
        if (sign > 0 || *text == '\0') continue;
        const sample_kind kind = take_line(reader, &line, text, sample, time);
        if (kind == SAMPLE_MALFORMED && (reader->words || reader->fields == 0)) {
            const bool known = reader->words && is_header(reader, text);
            if (take_names(reader, text, false, known) != LG_OK) break;
            if (known || reader->frame.header == line.number) continue;
        }
        reader->lines++;
        if (kind != SAMPLE_READ || !reader->unnamed || reader->frame.columns > 0) return kind;
        (void)lg_fail(
            &reader->error, LG_FORMAT,
            "%s: no column of the feed has the name of a channel of the model (%s, ...): rename the "
            "columns, or leave the line of names out; columns without names are taken in their order",
            reader->csv.shown, reader->names[0]);
        break;
    }
    return SAMPLE_END;
}
