/* The source of rows for HDF5 files. The columns are data sets of the root group, columns of matrices, and
 * members of records. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "files/frame.h"
#include "files/h5_internal.h"

/* A data set, or a member of one, and which columns of the frame it has. */
typedef struct source {
    char name[LG_FRAME_NAME], member[LG_FRAME_NAME]; /* member: "" if it is not a member */
    lg_h5_about about;
    uint32_t first, columns, axis; /* axis: the one along which the rows lie */
    bool matlab;                   /* MATLAB wrote it, with its dimensions in reverse order */
    double fill[LG_H5_FILLS];      /* lg_h5_fills */
} source;

enum { MOST_SOURCES = 4096 };
typedef struct h5_file {
    lg_frame *frame;
    lg_h5 *h5;
    source *sources; /* (MOST_SOURCES) */
    uint32_t count;
    uint64_t longest;   /* rows of the longest column */
    uint64_t rows;      /* of the wanted columns */
    const char *counts; /* the wanted data set that has them; NULL: none so far */
} h5_file;

static bool is_numbers(const lg_h5_about *about) {
    return about->kind == LG_H5_WHOLE || about->kind == LG_H5_REAL;
}

static uint64_t rows_of(const source *s) {
    return s->about.dims[s->axis];
}

/* ---- names ---- */

static lg_status add_text(void *user, uint64_t index, const char *text, lg_error *error) {
    return lg_frame_add_name(user, text, error);
}

/* Names the columns of a data set (rows, k) by its attribute `columns`, or else by the data set's name with
 * numbers. */
static lg_status name_columns(h5_file *h, const source *s, lg_error *error) {
    lg_frame *f = h->frame;
    bool words = false;
    const char *joint = s->columns > 1 ? ", " : NULL;
    LG_TRY(lg_h5_each_name(h->h5, s->name, "columns", joint, &words, add_text, f, error));
    if (words && f->columns - s->first != s->columns)
        return lg_fail(error, LG_FORMAT,
                       "%s: /%s: attribute columns has %u names for %u columns: write one per column",
                       f->shown, s->name, f->columns - s->first, s->columns);
    for (uint32_t i = 0; !words && i < s->columns; i++) {
        char name[LG_FRAME_NAME + 16];
        (void)snprintf(name, sizeof name, "%s%u", s->name, i);
        LG_TRY(lg_frame_add_name(f, name, error));
    }
    return LG_OK;
}

/* Whether vector s (rank 2) is a column although its file shows it as one row: another data set has as many
 * rows, or the file has no other array and its name is wanted. */
static bool is_column(const h5_file *h, const source *s) {
    const lg_frame *f = h->frame;
    uint32_t arrays = 0;
    for (const source *other = h->sources; other < h->sources + h->count; other++) {
        const lg_h5_about *about = &other->about;
        if (other == s) continue;
        if (s->about.count == (lg_h5_is_vector(about) ? about->count : about->dims[other->matlab]))
            return true;
        arrays += about->count > 1;
    }
    for (size_t i = 0; i < f->wants && arrays == 0; i++)
        if (strcmp(f->want[i].name, s->name) == 0) return true;
    return false;
}

/* The axis along which the rows lie. MATLAB stores arrays as (columns, rows). */
static uint32_t axis_of(const h5_file *h, const source *s) {
    const lg_h5_about *about = &s->about;
    const uint32_t longest = lg_h5_long_axis(about);
    if (about->rank != 2) return longest;
    const bool row = lg_h5_is_vector(about) && about->dims[!s->matlab] != 1 &&
                     !lg_h5_has_attribute(h->h5, s->name, "columns");
    return row && is_column(h, s) ? longest : s->matlab;
}

/* Notes why a data set or member is no column, if all columns or its name are wanted. */
static void leave_out(h5_file *h, const source *s, const char *why) {
    lg_frame *f = h->frame;
    const bool member = s->member[0] != '\0';
    bool wanted = f->wants == 0;
    for (size_t i = 0; i < f->wants; i++)
        wanted = wanted || strcmp(f->want[i].name, member ? s->member : s->name) == 0;
    char note[2 * LG_FRAME_NAME + 90];
    (void)snprintf(note, sizeof note, "/%s%s%s %.80s", s->name, member ? "." : "", s->member, why);
    if (wanted) lg_name_list_add(&f->note, note);
}

/* Adds numbers and texts. */
static void add_readable(h5_file *h, const source *s) {
    if (h->count == MOST_SOURCES)
        leave_out(h, s, "comes after 4096 others");
    else if (is_numbers(&s->about) || s->about.kind == LG_H5_WORDS)
        h->sources[h->count++] = *s;
    else
        leave_out(h, s, "has neither a number nor a text in each row");
}

static void add_members(h5_file *h, const source *table) {
    for (uint32_t i = 0; i < table->about.members; i++) {
        source s = *table;
        if (lg_h5_look_member(h->h5, s.name, i, s.member, sizeof s.member, &s.about, NULL) == LG_OK)
            add_readable(h, &s);
        else
            leave_out(h, &s, "has a member that cannot be read");
    }
}

/* Looks at the object behind a link. Returns why it is no array of rows; NULL if it is one; "" for a group or
 * a single number or text, which no one takes for a column unless its name is wanted. */
static const char *look(const h5_file *h, const char *name, source *s, lg_error *error) {
    const bool wanted = h->frame->wants > 0;
    char class[LG_FRAME_NAME] = "";
    LG_QUIET;
    LG_ID object = H5Oopen(h->h5->file, name, h->h5->links);
    if (object < 0) return "is a broken or external link, or of a newer HDF5";
    if (H5Iget_type(object) != H5I_DATASET) return wanted ? "is a group" : "";
    if (strlen(name) >= sizeof s->name) return "has a name of more than 63 bytes";
    if (lg_h5_look(h->h5, name, sizeof(double), &s->about, error) != LG_OK)
        return strrchr(error->message, ':') + 2;
    lg_h5_fills(h->h5, name, s->fill);
    if (s->about.rank < 1) return wanted ? "is a single number or text" : "";
    (void)lg_h5_text(h->h5, name, "MATLAB_class", class, sizeof class, NULL);
    if (strcmp(class, "char") == 0) return "is a char array of MATLAB: write numbers, or a list of texts";
    if (lg_h5_has_attribute(h->h5, name, "MATLAB_empty")) return "is empty";
    if (lg_h5_is_vector(&s->about) || s->about.rank == 1 || s->about.count == 1) return NULL;
    if (s->about.rank > 2) return s->about.rank == 3 ? "has 3 dimensions" : "has 4 dimensions";
    return is_numbers(&s->about) ? NULL : "is a matrix, but not of numbers";
}

/* Adds the data set behind one link of the root. */
static herr_t add_source(hid_t group, const char *name, const H5L_info_t *info, void *user) {
    h5_file *h = user;
    source s = {.columns = 1};
    lg_error error = {LG_OK, ""};
    (void)snprintf(s.name, sizeof s.name, "%s", name);
    const char *why = look(h, name, &s, &error);
    s.matlab = s.about.rank == 2 && lg_h5_has_attribute(h->h5, name, "MATLAB_class");
    if (why != NULL && *why != '\0')
        leave_out(h, &s, why);
    else if (why == NULL && s.about.kind == LG_H5_TABLE)
        add_members(h, &s);
    else if (why == NULL)
        add_readable(h, &s);
    return 0;
}

/* Adds the names of the columns of a data set. */
static lg_status add_columns(h5_file *h, source *s, lg_error *error) {
    const lg_h5_about *about = &s->about;
    const uint64_t columns = about->rank == 2 ? about->dims[!s->axis] : 1;
    s->first = h->frame->columns;
    s->columns = 0;
    const bool single = about->count == 1 && about->kind != LG_H5_WORDS && h->longest > 1;
    const char *why = single && h->frame->wants == 0              ? "is a single number"
                      : columns == 0                              ? "is empty"
                      : columns > LG_FRAME_MOST_COLUMNS           ? "has more than 65536 columns"
                      : about->kind == LG_H5_WORDS && columns > 1 ? "is a matrix, but not of numbers"
                                                                  : NULL;
    if (why != NULL) return leave_out(h, s, why), LG_OK;
    s->columns = (uint32_t)columns;
    if (s->columns > 1 || (about->rank == 2 && lg_h5_has_attribute(h->h5, s->name, "columns")))
        return name_columns(h, s, error);
    return lg_frame_add_name(h->frame, s->member[0] != '\0' ? s->member : s->name, error);
}

static lg_status list_sources(h5_file *h, lg_error *error) {
    lg_frame *f = h->frame;
    h->count = 0;
    if (h->sources == NULL) h->sources = lg_alloc(f->context, MOST_SOURCES, sizeof *h->sources);
    if (h->sources == NULL) return lg_frame_no_memory(f, error);
    LG_QUIET;
    const herr_t end = H5Literate(h->h5->file, H5_INDEX_NAME, H5_ITER_INC, NULL, add_source, h);
    if (end < 0)
        return lg_fail(error, LG_FORMAT, "%s: cannot be read: cut short or damaged; write it again",
                       f->shown);
    for (size_t i = 0; i < f->wants; i++) /* paths of data sets in groups */
        if (strchr(f->want[i].name, '/') != NULL) (void)add_source(h->h5->file, f->want[i].name, NULL, h);
    for (source *s = h->sources; s < h->sources + h->count; s++) {
        s->axis = axis_of(h, s);
        if (rows_of(s) > h->longest) h->longest = rows_of(s);
    }
    for (uint32_t i = 0; i < h->count; i++) LG_TRY(add_columns(h, &h->sources[i], error));
    return LG_OK;
}

/* ---- wanted columns ---- */

static bool is_wanted(const lg_frame *f, const source *s) {
    bool wanted = false;
    for (uint32_t i = 0; i < s->columns; i++) wanted = wanted || lg_frame_is_wanted(f, s->first + i);
    return wanted;
}

/* All wanted data sets must have as many rows. */
static lg_status check_sources(h5_file *h, lg_error *error) {
    for (const source *s = h->sources; s < h->sources + h->count; s++) {
        const uint64_t rows = rows_of(s);
        if (!is_wanted(h->frame, s)) continue;
        const lg_frame_use *use = &h->frame->use[s->first];
        if (s->about.kind == LG_H5_WORDS && use->value > 0 && use->clock == NULL)
            return lg_dataset_error(h->h5, s->name, LG_NO_NUMBERS, error);
        if (h->counts != NULL && rows != h->rows)
            return lg_fail(error, LG_FORMAT, "%s: /%s: has %llu rows, but /%s has %llu: write as many",
                           h->frame->shown, s->name, (unsigned long long)rows, h->counts,
                           (unsigned long long)h->rows);
        h->counts = s->name;
        h->rows = rows;
    }
    return LG_OK;
}

/* ---- rows ---- */

static lg_status put_text(void *user, uint64_t index, const char *text, lg_error *error) {
    const void *const *call = user;
    const source *s = call[1];
    lg_frame *f = ((const h5_file *)call[0])->frame;
    return lg_frame_put_cell(f, (size_t)(index - f->before), s->first, text, true, error);
}

static lg_status put_numbers(lg_frame *f, const source *s, const double *values, size_t row, size_t rows,
                             lg_error *error) {
    static const double missing = NAN;
    const lg_h5_about *about = &s->about;
    const char type = about->raw != 0 ? about->raw : about->kind == LG_H5_REAL && !about->wide ? 'f' : 'd';
    for (size_t i = 0; i < rows; i++)
        for (size_t c = 0; c < s->columns; c++) {
            const uint32_t column = s->first + (uint32_t)c;
            const double *value = &values[s->axis == 0 ? i * s->columns + c : c * rows + i];
            int64_t whole;
            memcpy(&whole, value, sizeof whole);
            const double number = type == 'i'   ? (double)whole
                                  : type == 'u' ? (double)(uint64_t)whole
                                                : *value;
            const bool fill = lg_h5_is_fill(s->fill, number);
            if (lg_frame_is_wanted(f, column))
                LG_TRY(lg_frame_put_number(f, row + i, column, fill ? 'd' : type, fill ? &missing : value,
                                           error));
        }
    return LG_OK;
}

static lg_status read_source(h5_file *h, const source *s, lg_error *error) {
    lg_frame *f = h->frame;
    lg_h5_slice slice = {s->name, s->member[0] != '\0' ? s->member : NULL, s->axis, f->before, f->rows};
    if (s->about.kind == LG_H5_WORDS)
        return lg_h5_each_text_of(h->h5, &slice, put_text, (const void *[]){h, s}, error);
    const uint64_t most = lg_h5_block(&s->about, s->axis);
    LG_SCRATCH(double, values, f->context, ((most < f->rows ? most : f->rows) * s->columns));
    if (values == NULL) return lg_frame_no_memory(f, error);
    for (size_t row = 0; row < f->rows; row += (size_t)slice.count) {
        slice.first = f->before + row;
        slice.count = f->rows - row < most ? f->rows - row : most;
        LG_TRY(lg_h5_get_slice(h->h5, &slice, LG_H5_RAW, values, error));
        LG_TRY(put_numbers(f, s, values, row, (size_t)slice.count, error));
    }
    return LG_OK;
}

static lg_status read_rows(lg_frame *f, size_t most, lg_error *error) {
    h5_file *h = f->source;
    LG_TRY(lg_frame_number_rows(f, most, h->rows - f->before, error));
    for (uint32_t i = 0; i < h->count && f->rows > 0; i++)
        if (is_wanted(f, &h->sources[i])) LG_TRY(read_source(h, &h->sources[i], error));
    return LG_OK;
}

/* ---- the file ---- */

static lg_status is_h5(const char *path, const unsigned char *first, size_t count, bool *is,
                       lg_error *error) {
    return lg_file_is_h5(path, is, error);
}

static lg_status begin(lg_frame *f, lg_error *error) {
    h5_file *h = f->source;
    LG_TRY(lg_h5_open(f->context, f->path, f->options, &h->h5, error));
    LG_TRY(list_sources(h, error));
    if (f->columns == 0)
        return lg_fail(error, LG_FORMAT,
                       "%s: has no data set at its root that is a column of numbers: write one%s%s", f->shown,
                       f->note.used > 0 ? "; " : "", lg_tamed(f->note.text));
    LG_TRY(lg_frame_find(f, error));
    return check_sources(h, error);
}

/* What the child process does: reads all that is wanted. */
static lg_status read_whole(void *user, lg_error *error) {
    enum { ROWS = 1 << 14 };
    lg_frame *f = user;
    LG_TRY(begin(f, error));
    do LG_TRY(lg_frame_next(f, ROWS, error));
    while (f->rows > 0);
    return LG_OK;
}

static lg_status open_h5(lg_frame *f, lg_error *error) {
    h5_file *h = f->source = lg_alloc(f->context, 1, sizeof *h);
    if (h == NULL) return lg_frame_no_memory(f, error);
    h->frame = f;
    LG_TRY(lg_probe(f->context, f->path, f->options, read_whole, f, error));
    LG_TRY(begin(f, error));
    if (f->note.used > 0)
        lg_log_message(f->context, LG_LOG_WARNING, "%s: left out of the columns: %s", f->shown,
                       lg_tamed(f->note.text));
    return LG_OK;
}

static void close_h5(lg_frame *f) {
    h5_file *h = f->source;
    if (h == NULL) return;
    lg_h5_close(h->h5);
    LG_FREE_ALL(f->context, h->sources, h);
}

const lg_frame_format lg_frame_h5 = {"h5", "row", is_h5, open_h5, read_rows, close_h5};
