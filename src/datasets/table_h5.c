/* Reads tables from HDF5 files. The columns are data sets of the root group. */
#include <stdio.h>
#include <string.h>

#include "files/h5_internal.h"
#include "datasets/table_reading.h"

/* A data set, and which columns of the table it has. */
typedef struct source {
    char name[LG_TABLE_NAME];
    lg_h5_about about; /* dims: (rows, columns), also if the data set is transposed */
    uint32_t first, columns;
    bool matlab;     /* MATLAB wrote it, with its dimensions in reverse order */
    bool transposed; /* the data set is (columns, rows) */
} source;

enum { MOST_SOURCES = 4096 };
typedef struct read_call {
    lg_table_reading *r;
    source *sources; /* (MOST_SOURCES) */
    uint32_t count;
    uint64_t rows; /* of the longest column */
    lg_h5 *h5;
    bool joined;         /* names stand in one text, with commas between them */
    const char *skipped; /* a single number that is left out of the columns, or NULL */
} read_call;

static lg_status fail(const read_call *call, const char *name, const char *what, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s: /%s: %s", call->r->shown, name, what);
}

/* ---- names ---- */

static lg_status add_text(void *user, uint64_t index, const char *text, lg_error *error) {
    read_call *call = user;
    (void)index;
    for (;;) {
        char name[LG_TABLE_NAME];
        const size_t length = strcspn(text, call->joined ? "," : ""),
                     blanks = call->joined ? strspn(text, " ") : 0;
        (void)snprintf(name, sizeof name, "%.*s", (int)(length - blanks), text + blanks);
        LG_TRY(lg_table_add_name(call->r, name, error));
        if (text[length] == '\0') return LG_OK;
        text += length + 1;
    }
}

/* Names the columns of a data set (rows, k) by its attribute `columns`, or else by the data set's name with
 * numbers. */
static lg_status name_columns(read_call *call, lg_h5 *h5, const source *s, lg_error *error) {
    bool words = false;
    call->joined = false;
    LG_TRY(lg_h5_each_attribute_text(h5, s->name, "columns", &words, add_text, call, error));
    if (words && call->r->all.count - s->first != s->columns) { /* not a list: one text with commas */
        call->joined = true;
        call->r->all.count = s->first;
        LG_TRY(lg_h5_each_attribute_text(h5, s->name, "columns", &words, add_text, call, error));
    }
    if (words && call->r->all.count - s->first != s->columns)
        return lg_fail(error, LG_FORMAT, "%s: /%s: attribute columns has %u names for %u columns",
                       call->r->shown, s->name, call->r->all.count - s->first, s->columns);
    for (uint32_t i = 0; !words && i < s->columns; i++) {
        char name[LG_TABLE_NAME + 16];
        (void)snprintf(name, sizeof name, "%s%u", s->name, i);
        LG_TRY(lg_table_add_name(call->r, name, error));
    }
    return LG_OK;
}

/* Whether vector s (rank 2) is a column although its file shows it as one row: another data set has as many
 * rows, or the file has no other array and its name is wanted. */
static bool is_column(const read_call *call, const source *s) {
    const lg_table_reading *r = call->r;
    uint32_t arrays = 0;
    for (const source *other = call->sources; other < call->sources + call->count; other++) {
        const lg_h5_about *about = &other->about;
        if (other == s) continue;
        if (s->about.count == (lg_h5_is_vector(about) ? about->count : about->dims[other->matlab]))
            return true;
        arrays += about->count > 1;
    }
    for (uint32_t i = 0; i < r->count && arrays == 0; i++)
        if (strcmp(r->names[i], s->name) == 0) return true;
    return false;
}

/* Whether a data set is stored as (columns, rows). MATLAB stores arrays so. */
static bool is_transposed(const read_call *call, lg_h5 *h5, const source *s) {
    const lg_h5_about *about = &s->about;
    if (about->rank != 2 || about->kind == LG_H5_WORDS) return false;
    const bool row = lg_h5_is_vector(about) && about->dims[!s->matlab] != 1 &&
                     !lg_h5_has_attribute(h5, s->name, "columns");
    return row && is_column(call, s) ? about->dims[0] == 1 : s->matlab;
}

/* Adds the data set behind one link of the root. Objects that are not arrays of rows are skipped. */
static herr_t add_source(hid_t group, const char *name, const H5L_info_t *info, void *user) {
    read_call *call = user;
    source s = {.columns = 1};
    (void)group, (void)info;
    if (call->count == MOST_SOURCES || strlen(name) >= LG_TABLE_NAME) return 0;
    (void)snprintf(s.name, sizeof s.name, "%s", name);
    if (lg_h5_look(call->h5, name, sizeof(double), &s.about, NULL) != LG_OK) return 0;
    if (s.about.kind == LG_H5_OTHER || s.about.rank < 1 || s.about.rank > 2) return 0;
    if (s.about.kind == LG_H5_WORDS && s.about.count != s.about.dims[0]) return 0;
    s.matlab = s.about.rank == 2 && lg_h5_has_attribute(call->h5, name, "MATLAB_class");
    call->sources[call->count++] = s;
    return 0;
}

/* Sets the shape of a data set and adds the names of its columns. */
static lg_status add_columns(read_call *call, lg_h5 *h5, source *s, lg_error *error) {
    uint64_t *dims = s->about.dims;
    s->first = call->r->all.count;
    s->columns = 0;
    if (s->transposed) {
        const uint64_t rows = dims[1];
        dims[1] = dims[0];
        dims[0] = rows;
    }
    const bool single = s->about.count == 1 && s->about.kind != LG_H5_WORDS && call->rows > 1;
    if (single && lg_table_names_only(call->r)) call->skipped = s->name;
    if (call->skipped == s->name) return LG_OK;
    if (s->about.rank == 2 && (dims[1] == 0 || dims[1] > LG_TABLE_MOST_COLUMNS)) return LG_OK;
    s->columns = s->about.rank == 2 && s->about.kind != LG_H5_WORDS ? (uint32_t)dims[1] : 1;
    return s->columns > 1 ? name_columns(call, h5, s, error) : lg_table_add_name(call->r, s->name, error);
}

static lg_status list_sources(read_call *call, lg_h5 *h5, lg_error *error) {
    lg_status status = LG_OK;
    call->h5 = h5;
    if (call->sources == NULL)
        call->sources = lg_alloc(call->r->context, MOST_SOURCES, sizeof *call->sources);
    if (call->sources == NULL) return lg_table_no_memory(call->r, error);
    lg_h5_quiet quiet = lg_quiet_begin();
    const herr_t end = H5Literate(h5->file, H5_INDEX_NAME, H5_ITER_INC, NULL, add_source, call);
    lg_quiet_end(quiet);
    if (end < 0) return lg_fail(error, LG_FORMAT, "%s: cannot be read: cut short or damaged", call->r->shown);
    for (uint32_t i = 0; i < call->count; i++) {
        source *s = &call->sources[i];
        s->transposed = is_transposed(call, h5, s);
        if (s->about.dims[s->transposed] > call->rows) call->rows = s->about.dims[s->transposed];
    }
    for (uint32_t i = 0; i < call->count && status == LG_OK; i++)
        status = add_columns(call, h5, &call->sources[i], error);
    if (status == LG_OK && call->r->all.count == 0)
        return lg_fail(error, LG_FORMAT, "%s: has no data set at its root that is a column of numbers",
                       call->r->shown);
    return status;
}

/* ---- rows ---- */

static bool is_wanted(const lg_table_reading *r, const source *s) {
    bool wanted = r->class_at >= s->first && r->class_at < s->first + s->columns;
    for (uint32_t i = 0; i < s->columns; i++) wanted = wanted || r->to[s->first + i] > 0;
    return wanted;
}

typedef struct copying {
    read_call *call;
    const source *source;
    lg_status status;
    lg_error *error;
} copying;

static void copy_rows(void *user, uint64_t row, uint64_t rows, const double *values) {
    copying *copy = user;
    const bool transposed = copy->source->transposed;
    const uint64_t inner = transposed ? copy->source->about.dims[0] : copy->source->columns;
    const lg_h5_about *about = &copy->source->about;
    const char type = about->raw != 0 ? about->raw : about->kind == LG_H5_REAL && !about->wide ? 'f' : 'd';
    for (uint64_t i = 0; i < rows && copy->status == LG_OK; i++)
        for (uint64_t c = 0; c < inner && copy->status == LG_OK; c++)
            copy->status = lg_table_set_number(copy->call->r, (size_t)(transposed ? c : row + i),
                                               copy->source->first + (uint32_t)(transposed ? row + i : c),
                                               type, &values[i * inner + c], copy->error);
}

static lg_status copy_label(void *user, uint64_t index, const char *text, lg_error *error) {
    read_call *call = user;
    return lg_table_set_label(call->r, (size_t)index, text, error);
}

static lg_status read_source(read_call *call, lg_h5 *h5, const source *s, lg_error *error) {
    lg_table_reading *r = call->r;
    copying copy = {call, s, LG_OK, error};
    if (s->about.dims[0] != r->out.rows)
        return lg_fail(error, LG_FORMAT, "%s: /%s: has %llu rows, another column has %zu", r->shown, s->name,
                       (unsigned long long)s->about.dims[0], r->out.rows);
    if (s->about.kind == LG_H5_WORDS) {
        if (s->first != r->class_at || r->to[s->first] > 0)
            return fail(call, s->name, "does not hold numbers", error);
        return lg_h5_each_text(h5, s->name, copy_label, call, error);
    }
    LG_TRY(lg_h5_each_rows(h5, s->name, LG_H5_RAW, copy_rows, &copy, error));
    return copy.status;
}

static lg_status read_file(void *user, lg_h5 *h5, lg_error *error) {
    read_call *call = user;
    lg_table_reading *r = call->r;
    lg_table_reset(r);
    call->count = 0;
    call->rows = 0;
    LG_TRY(list_sources(call, h5, error));
    LG_TRY(lg_table_find_columns(r, error));
    if (lg_table_names_only(r)) return LG_OK;
    for (uint32_t i = 0; i < call->count; i++) {
        const source *s = &call->sources[i];
        if (!is_wanted(r, s)) continue;
        if (r->out.rows == 0) LG_TRY(lg_table_make_rows(r, s->about.dims[0], error));
        LG_TRY(read_source(call, h5, s, error));
    }
    return LG_OK;
}

lg_status lg_table_read_h5(lg_table_reading *r, lg_error *error) {
    read_call call = {.r = r};
    const lg_status status = lg_h5_read(r->context, r->path, r->options, read_file, &call, error);
    if (status == LG_OK && call.skipped != NULL)
        lg_log_message(r->context, LG_LOG_WARNING,
                       "%s: /%s: is a single number and is left out of the columns", r->shown, call.skipped);
    lg_free(r->context, call.sources);
    return status;
}
