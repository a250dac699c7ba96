/* CSV: lines, quotes and names that are too long. */
#include "support/io_test.h"

#include "files/csv.h"

/* Reads the header and one row of two cells; says what went wrong, or "". */
static const char *read_row(const char *text, size_t bytes) {
    static lg_error error;
    const char *path = scratch_path("rows.csv");
    lg_csv c;
    bool more = false, cut = false;
    char *at, *cell;
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
    error = (lg_error){LG_OK, ""};
    lg_status status;
    while (lg_test_again(status = lg_csv_open(NULL, path, "table", &c, &error))) lg_csv_close(&c);
    if (status == LG_OK) status = lg_csv_header(&c, &error);
    if (status == LG_OK) status = lg_csv_line(&c, &more, &error);
    if (status == LG_OK) status = lg_csv_check_row(&c, &cut, &error);
    at = c.line;
    while (status == LG_OK && at != NULL) status = lg_csv_cell(&c, &at, &cell, &error);
    lg_csv_close(&c);
    return status == LG_OK ? "" : error.message;
}

TEST("quotes that are not closed and lines of more than a million bytes are refused with the line") {
    static const struct {
        const char *text, *says;
    } rows[] = {{"a,b\n\"1,\"\"2\",3\n", ""},
                {"a,b\n\"1,2\n", "line 2: a quote is not closed"},
                {"a,b\n1\"2,\"3,4\n", "line 2: a quote is not closed"},
                {"a,b\n\"1\"2,3\n", "line 2: text follows a closing quote"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_says(read_row(rows[i].text, strlen(rows[i].text)), rows[i].says);
    enum { LONG = 3 << 19 };
    char *text = lg_test_memory(LONG);
    memset(text, ' ', LONG);
    memcpy(text, "a,b\n", 4);
    assert_says(read_row(text, LONG), "line 2: is longer than a million bytes");
    memcpy(text + 4, "1,", 2);
    text[1 << 19] = '\n';
    assert_string_equal(read_row(text, (1 << 19) + 1), "");
}

TEST("a list of names ends with dots where there is no more room, and stays as it is after that") {
    lg_csv_names names = {.used = 0};
    char before[sizeof names.text];
    for (int i = 0; i < 60; i++) lg_csv_add_name(&names, "name");
    assert_true(strlen(names.text) < sizeof names.text);
    assert_string_equal(names.text + strlen(names.text) - 5, ", ...");
    memcpy(before, names.text, sizeof before);
    lg_csv_add_name(&names, "x");
    assert_memory_equal(before, names.text, sizeof before);
}
