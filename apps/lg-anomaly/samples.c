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
    out->field = app_alloc((size_t)channels + 1, sizeof *out->field);
    out->want = app_alloc(channels, sizeof *out->want);
    for (uint32_t c = 0; c < channels; c++)
        out->want[c] = (lg_frame_want){.name = names != NULL ? names[c] : "", .optional = true};
    if (lg_csv_open_feed(NULL, file, name, wanted > LONGEST ? wanted : LONGEST, wait_for_data, out, &out->csv,
                         &out->error) != LG_OK)
        app_out_of_memory();
    out->frame = (lg_frame){.shown = out->csv.shown, .place = "line", .feed = true};
}

void sample_reader_close(sample_reader *reader) {
    for (uint32_t i = 0; i < reader->looked; i++) free(reader->ahead[i].text);
    free(reader->field);
    free(reader->want);
    free(reader->copy);
    lg_frame_close(&reader->frame);
    lg_csv_close(&reader->csv);
    *reader = (sample_reader){.channels = 0};
}

/* ---- cells ---- */

enum { LEFT_OUT = UINT32_MAX };

/* Returns where the number of a cell goes in `field`: 0 is the time. A first line without names may have a
 * time. */
static uint32_t place_of(const sample_reader *reader, uint32_t column) {
    const lg_frame *f = &reader->frame;
    if (f->columns == 0) return column + (reader->layout == LAYOUT_VALUES);
    if (column + 1 == reader->time) return 0;
    return column >= f->columns            ? reader->channels + 1
           : lg_frame_is_wanted(f, column) ? (uint32_t)f->use[column].value
                                           : LEFT_OUT;
}

/* Returns the number of cells that a line should have. */
static uint32_t cells_of(const sample_reader *reader) {
    const uint32_t names = reader->frame.columns;
    return names > 0 ? names : reader->channels + (reader->layout == LAYOUT_TIMED);
}

/* Whether the line has as many cells as it should have, or an empty one more at its end. */
static bool has_all_cells(const sample_reader *reader) {
    const uint32_t wanted = cells_of(reader), more = reader->cells - wanted;
    const bool unknown = reader->frame.columns == 0 && reader->layout == LAYOUT_UNKNOWN;
    return reader->cells >= wanted && (more == 0 || (more == 1 && (reader->open || unknown)));
}

/* A comma may be a decimal one, a semicolon is in no number. */
static char separator_of(const sample_reader *reader, const char *line) {
    return strchr(line, ';') != NULL ? ';' : strchr(line, ',') != NULL ? ',' : reader->tabs ? '\t' : ' ';
}

static const char *skip_blanks(const sample_reader *reader, const char *line) {
    while (*line == ' ' || *line == '\r' || (*line == '\t' && reader->csv.separator != '\t')) line++;
    return line;
}

/* Returns a copy of the line that can be divided into its cells. */
static char *copy_line(sample_reader *reader, const char *line) {
    const size_t bytes = strlen(line) + 1;
    if (bytes > reader->room) {
        free(reader->copy);
        reader->room = 2 * bytes;
        reader->copy = app_alloc(reader->room, 1);
    }
    (void)memcpy(reader->copy, line, bytes);
    reader->frame.blanks = reader->csv.separator == ' ';
    if (reader->frame.blanks) lg_csv_join_blanks(reader->copy, ' ');
    return reader->copy;
}

/* Reads a number or a time. The first time decides the format of times; if the first sample has a damaged
 * one, the next one does. If only its place makes the column one of times, the cell may be no time. */
static bool read_cell(sample_reader *reader, const char *cell, uint32_t place, lg_error *problem) {
    const lg_frame *f = &reader->frame;
    const char *name = f->columns > 0 ? f->name[reader->cells] : NULL;
    lg_clock *clock = place == 0 ? &reader->clock : NULL;
    if (lg_frame_read_cell(f, reader->csv.number, name, clock, cell, &reader->field[place], problem) == LG_OK)
        return true;
    if (place > 0) return false;
    lg_moment now;
    const char *end = lg_moment_scan(cell, &now);
    reader->untimed = reader->guessed && reader->clock.format == LG_TIME_NONE;
    if (reader->lines < 2 && end != NULL && *end == '\0') reader->clock = (lg_clock){.format = LG_TIME_NONE};
    return reader->untimed;
}

/* Reads the numbers of a line into `field`. False: a cell is no number, as `problem` says. */
static bool read_cells(sample_reader *reader, const char *line) {
    char *at = copy_line(reader, line), *cell;
    bool good = true, begins = false;
    lg_csv *csv = &reader->csv;
    reader->cells = 0;
    reader->words = true;
    reader->open = reader->untimed = false;
    for (; at != NULL; reader->cells++) {
        const uint32_t place = place_of(reader, reader->cells);
        const bool number = place > 0 || reader->clock.format == LG_TIME_SECONDS;
        if (number && place <= reader->channels && lg_csv_number(csv, &at, &reader->field[place])) {
            reader->words = reader->open = false;
            continue;
        }
        lg_error *problem = good ? &reader->problem : NULL;
        const bool whole = lg_csv_cell(csv, &at, &cell, problem) == LG_OK;
        char *sign = whole && place != LEFT_OUT ? strchr(cell, '#') : NULL;
        if (sign != NULL) {
            while (sign > cell && (sign[-1] == ' ' || sign[-1] == '\t')) sign--;
            *sign = '\0';
            at = NULL;
            if (csv->separator == ' ' && sign == cell) break;
        }
        reader->open = *cell == '\0';
        if (whole && place > reader->channels) continue;
        if (place <= reader->channels) reader->words = false;
        if (!whole || !read_cell(reader, cell, place, problem)) {
            if (good) begins = isdigit((unsigned char)cell[strspn(cell, "+-.")]);
            good = false;
        }
        if (!whole) break;
    }
    reader->damaged = !good && begins && has_all_cells(reader);
    reader->words = reader->words || !good;
    return good;
}

void sample_leave_times(sample_reader *reader) {
    reader->time = 0;
    reader->guessed = false;
    reader->layout = LAYOUT_VALUES;
}

static sample_kind reject_count(sample_reader *reader) {
    const uint32_t c = reader->channels, cells = reader->cells - reader->open, wanted = cells_of(reader);
    const bool names = reader->frame.columns > 0, unknown = !names && reader->layout == LAYOUT_UNKNOWN;
    char more[32] = "";
    if (unknown) (void)snprintf(more, sizeof more, ", or %u with a time", c + 1);
    (void)lg_frame_fail_at(
        &reader->frame, reader->csv.number, NULL, &reader->problem, "%u %s%s, not %u%s%s", cells,
        names ? "cell" : "number", cells == 1 ? "" : "s", wanted,
        reader->layout == LAYOUT_TIMED ? " with the time" : more,
        reader->csv.separator == ',' && cells > wanted + unknown ? "; write decimals with a point" : "");
    return SAMPLE_MALFORMED;
}

/* The layout that fits the line's number of cells. */
static sample_layout layout_of(const sample_reader *reader) {
    const uint32_t c = reader->channels, fields = reader->cells - reader->open;
    if (fields == c) return LAYOUT_VALUES;
    return fields == c + 1 && isfinite(reader->field[0]) ? LAYOUT_TIMED : LAYOUT_UNKNOWN;
}

/* Returns whether the cells fit the layout. If the layout is still unknown, sets it from the cells. */
static bool fits_layout(sample_reader *reader) {
    const uint32_t c = reader->channels;
    if (reader->layout == LAYOUT_UNKNOWN) {
        reader->layout = layout_of(reader);
        if (reader->layout == LAYOUT_UNKNOWN) return false;
        if (reader->layout == LAYOUT_VALUES) memmove(reader->field + 1, reader->field, c * sizeof(double));
    }
    return has_all_cells(reader);
}

static sample_kind take_line(sample_reader *reader, const sample_line *line, const char *p, float *sample,
                             double *time) {
    if (!read_cells(reader, p)) return SAMPLE_MALFORMED;
    if (!fits_layout(reader)) return reject_count(reader);
    if (reader->untimed) {
        lg_name_list_add(&reader->extra, reader->frame.name[0]);
        sample_leave_times(reader);
    }
    const bool timed = reader->layout == LAYOUT_TIMED;
    /* the line's last number may be cut if it ends exactly at the end of the file */
    const bool cut = !line->closed && reader->lines > 0 && strchr(",; \t", p[strlen(p) - 1]) == NULL &&
                     strchr(p, '#') == NULL;
    *time = timed ? reader->field[0] : (double)NAN;
    for (uint32_t c = 0; c < reader->channels; c++) {
        const double value = reader->field[1 + c];
        sample[c] = !cut && fabs(value) <= (double)FLT_MAX ? (float)value : NAN;
    }
    reader->separated = true;
    if (!cut && !(timed && !isfinite(*time))) return SAMPLE_READ;
    (void)lg_frame_fail_at(&reader->frame, line->number, NULL, &reader->problem, "%s",
                           cut ? "the last line has no line end, so its last number may be cut"
                               : "the time is not a number");
    return SAMPLE_MALFORMED;
}

/* ---- lines of words ---- */

/* Returns whether this is a line of words before the first sample, or a repetition of such a line. */
static bool is_header(sample_reader *reader, const char *line) {
    uint64_t hash = UINT64_C(0xcbf29ce484222325); /* FNV-1a, without blanks at the end */
    const char *end = line + strlen(line);
    while (end > line && strchr(" \t\r", end[-1]) != NULL) end--;
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

/* Reads the names of a line. If it has no separators, blanks separate them. */
static lg_frame read_names(sample_reader *reader, const char *line, char *separator) {
    lg_frame read = {.shown = reader->csv.shown,
                     .place = "line",
                     .feed = true,
                     .header = (size_t)reader->line,
                     .want = reader->want,
                     .wants = reader->channels};
    APP_FREE char *text = app_format("%s", line);
    lg_csv csv = {.shown = read.shown, .separator = lg_csv_separator(text, ' ')};
    char *at = text, *cell;
    if (csv.separator == ' ') lg_csv_join_blanks(text, ' ');
    while (at != NULL && lg_csv_cell(&csv, &at, &cell, NULL) == LG_OK && (at != NULL || *cell != '\0'))
        if (lg_frame_add_name(&read, cell, NULL) != LG_OK) break;
    *separator = csv.separator;
    return read;
}

/* Finds the channels and the times among the columns, and lists the names of the others. */
static lg_status find_columns(sample_reader *reader) {
    lg_frame *f = &reader->frame;
    bool behind = false;
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
            behind = true;
        } else if (reader->time == 0 && !behind &&
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
    reader->layout = reader->time > 0 ? LAYOUT_TIMED : LAYOUT_VALUES;
    return LG_OK;
}

static bool same_names(const lg_frame *a, const lg_frame *b) {
    bool same = a->columns == b->columns;
    for (uint32_t i = 0; same && i < a->columns; i++) same = strcmp(a->name[i], b->name[i]) == 0;
    return same;
}

/* Takes the columns from a line of words if it names all channels; frame.header is then its line. If the
 * first such line names no channel, the feed may be rejected at the first sample. Fails if the line names
 * only some of the channels, or names one twice. Later lines fail so only if lines have as many cells and the
 * line was not before the first sample (known). A comment, as numpy.savetxt writes it, is a comment only,
 * unless it names all channels. */
static lg_status take_names(sample_reader *reader, const char *line, bool comment, bool known) {
    lg_frame *f = &reader->frame;
    char separator;
    uint32_t found = 0;
    if (reader->names == NULL) return LG_OK;
    line = skip_blanks(reader, line);
    lg_frame now = read_names(reader, line + (comment && (*line == ',' || *line == ';')), &separator);
    const bool first = reader->lines == 0 && f->columns == 0, same = same_names(&now, f),
               strict = !comment && (first || (!known && now.columns == cells_of(reader)));
    const lg_status status = lg_frame_find(&now, strict ? &reader->error : NULL);
    for (uint32_t c = 0; status == LG_OK && c < reader->channels; c++) found += reader->want[c].there;
    if ((found == reader->channels && !same) || (strict && (found > 0 || status != LG_OK))) {
        lg_frame_close(f);
        *f = now;
        reader->renamed = !first;
        reader->separated = separator != ' ';
        reader->csv.separator = separator;
        return status != LG_OK ? status : find_columns(reader);
    }
    if (same) f->header = now.header;
    if (same && separator != ' ') reader->csv.separator = separator;
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
    *out = (sample_line){reader->csv.line, reader->csv.number, reader->csv.closed, reader->csv.cut,
                         reader->csv.wrong};
    return status == LG_OK && more;
}

/* Counts the vote of one more line. `names`: the layout that the line of names suggests; *first: that of the
 * first line of numbers. Returns true if the layout is now decided. */
static bool elect(sample_reader *reader, const char *line, uint32_t votes[3], sample_layout *names,
                  sample_layout *first) {
    char separator;
    sample_layout vote = LAYOUT_UNKNOWN;
    if (*line == '\0' || lg_csv_comment(line) > 0) return false;
    if (read_cells(reader, line)) {
        vote = layout_of(reader);
        if (reader->open && vote == LAYOUT_VALUES && *names == LAYOUT_TIMED) vote = LAYOUT_TIMED;
        if (*first == LAYOUT_UNKNOWN) *first = vote;
    } else if (!reader->damaged && *first == LAYOUT_UNKNOWN && *names == LAYOUT_UNKNOWN) {
        lg_frame read = read_names(reader, line, &separator);
        const uint32_t count = read.columns;
        lg_frame_close(&read);
        vote = *names = count == reader->channels       ? LAYOUT_VALUES
                        : count == reader->channels + 1 ? LAYOUT_TIMED
                                                        : LAYOUT_UNKNOWN;
        reader->tabs = separator == '\t';
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
        reader->csv.separator = separator_of(reader, line->text);
        decided = !line->cut && line->wrong == NULL &&
                  elect(reader, skip_blanks(reader, line->text), votes, &names, &first);
    }
    reader->clock = (lg_clock){.format = LG_TIME_NONE};
    /* A line of names alone does not decide. */
    reader->layout = first == LAYOUT_UNKNOWN                      ? LAYOUT_UNKNOWN
                     : votes[LAYOUT_TIMED] > votes[LAYOUT_VALUES] ? LAYOUT_TIMED
                     : votes[LAYOUT_VALUES] > votes[LAYOUT_TIMED] ? LAYOUT_VALUES
                                                                  : first;
}

/* A line of bytes that is no text, or not complete, is skipped if it begins as a comment. */
static bool is_text(sample_reader *reader, const sample_line *line) {
    if (line->wrong == NULL && !line->cut) return true;
    char longer[64];
    (void)snprintf(longer, sizeof longer, "longer than %zu bytes", reader->csv.longest);
    (void)lg_frame_fail_at(&reader->frame, line->number, NULL, &reader->problem, "%s",
                           line->wrong != NULL ? line->wrong : longer);
    return false;
}

/* Files that hold numbers and are no feeds. */
static lg_status check_kind(sample_reader *reader, const char *line) {
    const bool h5 = strncmp(line, "\x89HDF", 4) == 0;
    if (!h5 && strncmp(line, "\x93NUMPY", 6) != 0) return LG_OK;
    return lg_fail(&reader->error, LG_FORMAT,
                   "%s: is %s, but a feed is text, one sample a line: write it as CSV", reader->csv.shown,
                   h5 ? "HDF5" : "an array of numpy (.npy)");
}

sample_kind sample_next(sample_reader *reader, float *sample, double *time) {
    sample_line line;
    if (reader->looked == 0) look_ahead(reader);
    while (reader->given < reader->looked || read_file_line(reader, &line)) {
        if (reader->given < reader->looked) line = reader->ahead[reader->given++];
        *time = (double)NAN;
        reader->line = reader->csv.number = line.number;
        if (line.number == 1 && check_kind(reader, line.text) != LG_OK) break;
        if (!reader->separated) reader->csv.separator = separator_of(reader, line.text);
        const char *text = skip_blanks(reader, line.text);
        const size_t sign = lg_csv_comment(text);
        if (*text == '\0') continue;
        if (!is_text(reader, &line) && sign == 0) {
            reader->lines++;
            return SAMPLE_MALFORMED;
        }
        if (sign > 0 && take_names(reader, text + sign, true, false) != LG_OK) break;
        reader->csv.cells = cells_of(reader);
        if (sign > 0 && reader->lines > 0 && lg_csv_hides_row(&reader->csv, copy_line(reader, text))) {
            reader->lines++;
            (void)lg_frame_fail_at(&reader->frame, line.number, NULL, &reader->problem,
                                   "begins as a comment, but has as many cells as a row");
            return SAMPLE_MALFORMED;
        }
        if (sign > 0) continue;
        const sample_kind kind = take_line(reader, &line, text, sample, time);
        if (kind == SAMPLE_MALFORMED && reader->words) {
            const bool known = !reader->damaged && is_header(reader, text);
            if (take_names(reader, text, reader->damaged, known) != LG_OK) break;
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
