/* Reads tables from CSV files. */
#include "files/csv.h"
#include "datasets/table_reading.h"

static lg_status read_header(lg_table_reading *r, lg_csv *c, lg_error *error) {
    LG_TRY(lg_csv_header(c, error));
    char *at = c->line, *cell = NULL;
    while (at != NULL) {
        LG_TRY(lg_csv_name(c, &at, &cell, error));
        LG_TRY(lg_table_add_name(r, cell, error));
    }
    if (r->all.count != c->cells) return lg_csv_fail(c, error, "a quote is inside a cell");
    return lg_table_find_columns(r, error);
}

static lg_status read_row(lg_table_reading *r, lg_csv *c, lg_error *error) {
    double *values = NULL;
    char *at = c->line, *cell = NULL;
    LG_TRY(lg_csv_check_row(c, &r->out.cut, error));
    if (r->out.cut) return LG_OK;
    LG_TRY(lg_table_add_row(r, c->number, &values, error));
    for (uint32_t i = 0; at != NULL; i++) {
        LG_TRY(lg_csv_cell(c, &at, &cell, error));
        if (i == r->all.count) return lg_csv_fail(c, error, "a quote is inside a cell");
        if (i == r->class_at)
            LG_TRY(lg_table_set_label(r, r->out.rows - 1, !c->quoted && lg_csv_missing(cell) ? "" : cell,
                                      error));
        if (r->to[i] > 0) LG_TRY(lg_csv_number(c, cell, r->all.name[i], false, &values[r->to[i] - 1], error));
    }
    return LG_OK;
}

static lg_status read_rows(lg_table_reading *r, lg_csv *c, lg_error *error) {
    for (bool more = true;;) {
        LG_TRY(lg_csv_line(c, &more, error));
        if (!more) return LG_OK;
        LG_TRY(read_row(r, c, error));
    }
}

lg_status lg_table_read_csv(lg_table_reading *r, lg_error *error) {
    lg_csv c;
    r->out.place = "line";
    lg_status status = lg_csv_open(r->context, r->path, "table", &c, error);
    if (status == LG_OK) status = read_header(r, &c, error);
    if (status == LG_OK && !lg_table_names_only(r)) status = read_rows(r, &c, error);
    lg_csv_close(&c);
    return status;
}
