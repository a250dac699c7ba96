/* Rows of tables that are complete, and ports with the range of a table. lg-fit's tests read files. */
#include "io_test.h"

#include "liegrad/tables.h"

OWNED(lg_table_data, lg_table_data_destroy)

static lg_table_data *read_columns(const char *text, const char *columns, const char *class_column) {
    const char *names[] = {(char[]){columns[0], '\0'}, (char[]){columns[1], '\0'}};
    lg_table_data data;
    write_text_to(scratch_path("t.csv"), text);
    assert_ok(lg_table_read(NULL, scratch_path("t.csv"), names, (uint32_t)strlen(columns), class_column, NULL,
                            &data, NULL));
    return own_lg_table_data(data);
}

static const char holes[] = "a,b,c,run\n1,2,3,x\n4,,5,x\n6,7,,y\n8,9,10,\n11,12,13,y\n";

TEST("rows that are incomplete in one table are left out of all, labels and lines go with them") {
    lg_table_data *x = read_columns(holes, "ab", NULL), *y = read_columns(holes, "c", "run");
    size_t left_out = 99;
    assert_ok(lg_table_keep_complete((lg_table_data *[]){x, y}, 2, &left_out, NULL));
    assert_int_equal(left_out, 3);
    assert_int_equal(x->rows, 2);
    assert_int_equal(y->rows, 2);
    assert_all_close(x->values, ((const double[]){1, 2, 11, 12}), 4, 0, 0);
    assert_all_close(y->values, ((const double[]){3, 13}), 2, 0, 0);
    assert_int_equal(y->label[0], 0);
    assert_int_equal(y->label[1], 1);
    assert_int_equal(y->line[1], 6);
    assert_ok(lg_table_keep_complete((lg_table_data *[]){x, y}, 2, NULL, NULL));
    assert_int_equal(x->rows, 2);
    assert_ok(lg_table_keep_complete(NULL, 0, NULL, NULL));
}

TEST("tables of other rows, or without a complete row, are refused and stay as they are") {
    lg_table_data *x = read_columns(holes, "ab", NULL), *y = read_columns("c,d\n1,\n2,\n", "cd", NULL);
    lg_error error = {LG_OK, ""};
    assert_status(lg_table_keep_complete((lg_table_data *[]){x, y}, 2, NULL, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "5 and 2 rows"));
    assert_status(lg_table_keep_complete(&y, 1, NULL, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "all 2 rows"));
    assert_int_equal(x->rows, 5);
    assert_int_equal(y->rows, 2);
}

TEST("a port has the range of the table's numbers, missing ones apart") {
    const lg_table_data *x = read_columns(holes, "ac", NULL);
    const lg_port port = lg_table_port(x, "x", 7);
    assert_string_equal(port.name, "x");
    assert_int_equal(port.shape.rank, 1);
    assert_int_equal(port.shape.dims[0], 7);
    assert_close(port.low, 1, 0, 0);
    assert_close(port.high, 13, 0, 0);
    const lg_port none = lg_table_port(read_columns("c,d\n1,\n2,\n", "d", NULL), "d", 1);
    assert_close(none.low, 0, 0, 0);
    assert_close(none.high, 0, 0, 0);
}
