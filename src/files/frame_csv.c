/* The source of rows for text files: a line of names, then one row per line. */
#include "files/csv.h"
#include "files/frame.h"

#define QUOTE_INSIDE "a cell has a quote inside: put the cell in quotes, and double this one"

static lg_status open_csv(lg_frame *f, lg_error *error) {
    lg_csv *c = f->source = lg_alloc(f->context, 1, sizeof *c);
    char *cell = NULL;
    if (c == NULL) return lg_frame_no_memory(f, error);
    LG_TRY(lg_csv_open(f->context, f->path, c, error));
    c->ours = f->ours;
    LG_TRY(lg_csv_header(c, error));
    f->header = c->number;
    for (char *at = c->line; at != NULL;) {
        LG_TRY(lg_csv_name(c, &at, &cell, error));
        LG_TRY(lg_frame_add_name(f, cell, error));
    }
    if (f->columns != c->cells) return lg_csv_fail(c, error, QUOTE_INSIDE);
    if (c->row != NULL)
        lg_name_list_add(&f->note, "the line is a comment: remove it if it does not hold the names");
    else if (c->counting && f->wants > 0)
        lg_log_message(f->context, LG_LOG_WARNING,
                       "%s: line %zu: 0, 1, ... were taken as names of columns: if the line is a row, write "
                       "names above it, otherwise put each of them in quotes",
                       c->shown, c->number);
    return lg_frame_find(f, error);
}

static lg_status read_row(lg_frame *f, lg_csv *c, lg_error *error) {
    char *at = c->line, *cell = NULL;
    const size_t row = f->rows;
    LG_TRY(lg_csv_check_row(c, &f->cut, error));
    if (f->cut) return LG_OK;
    LG_TRY(lg_frame_reserve(f, row + 1, error));
    f->line[row] = c->number;
    for (uint32_t i = 0; i < f->columns || at != NULL; i++) {
        if (i == f->columns || at == NULL) return lg_csv_fail(c, error, QUOTE_INSIDE);
        LG_TRY(lg_csv_cell(c, &at, &cell, error));
        LG_TRY(lg_frame_put_cell(f, row, i, cell, c->quoted, error));
    }
    f->rows++;
    if (!c->closed && lg_frame_is_wanted(f, f->columns - 1))
        lg_log_message(f->context, LG_LOG_WARNING,
                       "%s: the last line (%zu) has no line end; if the file was cut, its last value may be "
                       "wrong",
                       c->shown, c->number);
    return LG_OK;
}

lg_status lg_frame_csv_rows(lg_frame *f, size_t most, lg_error *error) {
    lg_csv *c = f->source;
    f->blanks = c->blanks;
    for (bool more = true; f->rows < most && !f->cut;) {
        LG_TRY(lg_csv_line(c, &more, error));
        if (more) {
            LG_TRY(read_row(f, c, error));
            continue;
        }
        if (c->hidden > 0)
            lg_log_message(
                f->context, LG_LOG_WARNING,
                "%s: %zu lines with as many cells as a row were left out as comments, the first is line %zu: "
                "if they are rows, put their first cell in quotes",
                c->shown, c->hidden, c->first_hidden);
        c->hidden = 0;
        break;
    }
    return LG_OK;
}

void lg_frame_csv_close(lg_frame *f) {
    if (f->source != NULL) lg_csv_close(f->source);
    lg_free(f->context, f->source);
}

const lg_frame_format lg_frame_csv = {"csv", "line", NULL, open_csv, lg_frame_csv_rows, lg_frame_csv_close};
