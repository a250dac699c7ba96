/* CSV: lines, quotes and names that are too long. */
#include "support/io_test.h"

#include <fcntl.h>
#include <unistd.h>

#include "core/text.h"
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
    while (lg_test_again(status = lg_csv_open(NULL, path, &c, &error))) lg_csv_close(&c);
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
                {"a,b\n\"1,2\n",
                 "line 2: a quote is not closed: end the cell with a quote, and double the quotes inside"},
                {"a,b\n1\"2,\"3,4\n",
                 "line 2: a quote is not closed: end the cell with a quote, and double the quotes inside"},
                {"a,b\n\"1\"2,3\n",
                 "line 2: text follows a closing quote: quote the whole cell, and double quotes in it"},
                {"a,b\n1\n", "line 2: has 1 cells, the header has 2; leave cells without a value empty, and "
                             "put those with a separator in quotes"},
                {"# a\n", "line 2: is empty: write the names of the columns in the first line"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_says(read_row(rows[i].text, strlen(rows[i].text)), rows[i].says);
    enum { LONG = 3 << 19 };
    char *text = lg_test_memory(LONG);
    memset(text, ' ', LONG);
    memcpy(text, "a,b\n", 4);
    assert_says(read_row(text, LONG), "line 2: is longer than a million bytes: end rows with a newline");
    text[100] = '\r';
    assert_says(read_row(text, LONG), "line 2: has lines that end with a carriage return alone (CR)");
    text[100] = ' ';
    memcpy(text + 4, "1,", 2);
    text[1 << 19] = '\n';
    assert_string_equal(read_row(text, (1 << 19) + 1), "");
}

/* The names of the header, then the cells of the first row; "failed: " and the message if it fails. */
static const char *cells_of(const char *text) {
    static char all[1000];
    lg_error error = {LG_OK, ""};
    lg_csv c;
    bool more = false;
    all[0] = '\0';
    write_text_to(scratch_path("rows.csv"), text);
    lg_status status = lg_csv_open(NULL, scratch_path("rows.csv"), &c, &error);
    if (status == LG_OK) status = lg_csv_header(&c, &error);
    for (int k = 0; k < 2 && status == LG_OK; k++) {
        lg_append(all, sizeof all, "%zu:", c.number);
        for (char *at = c.line, *cell; at != NULL && status == LG_OK;) {
            status = lg_csv_name(&c, &at, &cell, &error);
            lg_append(all, sizeof all, "[%s]", cell);
        }
        if (k == 0 && status == LG_OK) status = lg_csv_line(&c, &more, &error);
    }
    lg_csv_close(&c);
    if (lg_test_again(status)) return cells_of(text);
    if (status != LG_OK) (void)snprintf(all, sizeof all, "failed: %s", error.message);
    return all;
}

TEST("a header in a comment is read if it has a name for each column, as numpy writes it") {
    static const struct {
        const char *text, *cells;
    } rows[] = {
        {"# t,x\n0,1\n2,3\n", "1:[t][x]2:[0][1]"},
        {"#t,x\r\n0,1\r\n", "1:[t][x]2:[0][1]"},
        {"#,t,x\n0,1\n", "1:[t][x]2:[0][1]"},
        {"# made by hand\n\n# t x\n0,1\n", "3:[t][x]4:[0][1]"},
        {"# t;x\n0;1\n", "1:[t][x]2:[0][1]"},
        {"# t x\n0;1\n", "1:[t][x]2:[0][1]"},
        {"# t\tx\n0\t1\n", "1:[t][x]2:[0][1]"},
        {"# t x\n0.0e+00 1.0e+00\n", "1:[t][x]2:[0.0e+00][1.0e+00]"},
        {"# t x\n  0    1 \n", "1:[t][x]2:[0][1]"},
        {"\xef\xbb\xbf# t,x\n0,nan\n", "1:[t][x]2:[0][nan]"},
        {"# \"t, s\",x\n0,1\n", "1:[t, s][x]2:[0][1]"},
        {"# t\n5.5\n", "1:[t]2:[5.5]"},
        {"#\n5.5\n",
         "failed: @: line 2: has numbers where names of columns are expected: there is no header, "
         "and the comment in line 1 has not one name for each of the 1 columns; write one"},
        {"# a note\nt,x\n0,1\n", "2:[t][x]3:[0][1]"},
        {"# t,x,u\n# s,m,N\n0,1,2\n", "1:[t][x][u]3:[0][1][2]"},
        {"# t,x,u\n# second comment line\n0,1,2\n", "1:[t][x][u]3:[0][1][2]"},
        {"# second comment line\n# t,x,u\n0,1,2\n", "2:[t][x][u]3:[0][1][2]"},
        {"# made by me\n# t x u\n0 1 2\n", "2:[t][x][u]3:[0][1][2]"},
        {"# t,x\n# 1\n# 2\n# 3\n# 4\n# 5\n# 6\n# 7\n# 8\n# 9\n#\n#\n#\n#\n#\n#\n#\n0,1\n",
         "1:[t][x]18:[0][1]"},
        {"# 1\n# 1\n# 2\n# 3\n# 4\n# 5\n# 6\n# 7\n# 8\n# 9\n#\n#\n#\n#\n#\n#\n# t,x\n0,1\n",
         "17:[t][x]18:[0][1]"},
        {"% t;x\n0;1\n", "1:[t][x]2:[0][1]"},
        {"%t x\n0 1\n", "1:[t][x]2:[0][1]"},
        {"// t,x\n0,1\n", "1:[t][x]2:[0][1]"},
        {"//t,x \"\n// s,m\nt,x\n% 5,6\n// 7 \"\n0,1\n", "3:[t][x]6:[0][1]"},
        {"/t,x\n0,1\n", "1:[/t][x]2:[0][1]"},
        {"# 7,8\n0,1\n5,6\n", "2:[0][1]3:[5][6]"}, /* columns 0, 1, 2, ... */
        {"# wind speed\n0\n5\n", "2:[0]3:[5]"},
        {"# t\n0\n5\n", "1:[t]2:[0]"},
        {"# \"t  s\"   x\n0 1\n", "1:[t  s][x]2:[0][1]"},
        {"wind speed\n5\n", "1:[wind speed]2:[5]"},
        {"3,1\n5,6\n",
         "failed: @: line 1: has numbers where names of columns are expected: there is no header; write one"},
        {"a,\1\n1,2\n",
         "failed: @: line 1: is not a header: it has control characters; put the name in quotes"},
        {"# a,b,c\n3,1\n",
         "failed: @: line 2: has numbers where names of columns are expected: there is "
         "no header, and the comment in line 1 has not one name for each of the 2 columns; write one"},
        {"# 1,2\n3,1\n",
         "failed: @: line 2: has numbers where names of columns are expected: there is "
         "no header, and the comment in line 1 has not one name for each of the 2 columns; write one"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *at = strchr(rows[i].cells, '@');
        assert_string_equal(cells_of(rows[i].text),
                            at == NULL ? rows[i].cells
                                       : test_text("failed: %s%s", scratch_path("rows.csv"), at + 1));
    }
}

TEST("blanks between cells become separators, blanks inside quotes stay") {
    static const struct {
        const char *line, *joined;
    } rows[] = {
        {" 1  \"d e\"\t\"a  b\" ", "1;\"d e\";\"a  b\""},
        {"\"a \"\"b  c\"\"\"  2 \"\" 3", "\"a \"\"b  c\"\"\";2;\"\";3"},
        {"5\"  6 7\" 8", "5\";6;7\";8"}, /* the quote of a cell stands at its beginning */
        {"1 \"a  b", "1;\"a  b"},
        {" \t ", ""},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char line[40];
        (void)snprintf(line, sizeof line, "%s", rows[i].line);
        lg_csv_join_blanks(line, ';');
        assert_string_equal(line, rows[i].joined);
    }
}

TEST("a written name that begins like a comment is read again") {
    static const char *const names[] = {"#a", "%a", "//a", "/a"};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        char text[64];
        FILE *file = fopen(scratch_path("put.csv"), "w+");
        assert_non_null(file);
        lg_columns to = {.row = 0};
        lg_columns_name(&to, names[i]);
        assert_true(!to.text.failed && fputs(to.text.data, file) >= 0);
        lg_text_destroy(&to.text);
        rewind(file);
        assert_non_null(fgets(text, sizeof text, file));
        assert_int_equal(fclose(file), 0);
        assert_string_equal(cells_of(test_text("%s,b\n0,1\n", text)),
                            test_text("1:[%s][b]2:[0][1]", names[i]));
    }
}

TEST("a row of one cell without a value is no blank line, which readers skip") {
    lg_columns to = {.row = 0};
    lg_columns_name(&to, "a");
    lg_columns_end(&to);
    lg_columns_empty(&to);
    lg_columns_end(&to);
    lg_columns_number(&to, (double)NAN);
    lg_columns_end(&to);
    lg_columns_empty(&to);
    lg_columns_empty(&to);
    lg_columns_end(&to);
    assert_false(to.text.failed);
    assert_string_equal(to.text.data, "a\n\"\"\n\"\"\n,\n");
    lg_text_destroy(&to.text);
}

TEST("a list of names ends with dots where there is no more room, and stays as it is after that") {
    lg_name_list names = {.used = 0};
    char before[sizeof names.text];
    for (int i = 0; i < 60; i++) lg_name_list_add(&names, "name");
    assert_true(strlen(names.text) < sizeof names.text);
    assert_string_equal(names.text + strlen(names.text) - 5, ", ...");
    memcpy(before, names.text, sizeof before);
    lg_name_list_add(&names, "x");
    assert_memory_equal(before, names.text, sizeof before);
}

TEST("lines, quotes and byte order marks may lie anywhere in the blocks that are read") {
    enum { BLOCK = 1 << 16, AROUND = 12 };
    static const char row[] = "\xef\xbb\xbf#\"\r\n \r\na,\"b\n\"\"c\"\r\n//\"\n1,\"2\n\n3\"\r\n";
    static char text[BLOCK + sizeof row + 1];
    for (size_t shift = 0; shift < sizeof row + AROUND; shift++) {
        lg_error error = {LG_OK, ""};
        lg_csv c;
        bool more = false;
        const size_t before = BLOCK - sizeof row + shift - AROUND; /* bytes of a comment before the rest */
        (void)snprintf(text, sizeof text, "\xef\xbb\xbf#%*s\n%s", (int)before - 5, "", row + 3);
        write_text_to(scratch_path("rows.csv"), text);
        lg_status status = lg_csv_open(NULL, scratch_path("rows.csv"), &c, &error);
        if (status == LG_OK) status = lg_csv_header(&c, &error);
        if (status == LG_OK && strcmp(c.line, "a,\"b\n\"\"c\"") != 0) fail_msg("%zu: '%s'", shift, c.line);
        if (status == LG_OK) assert_int_equal(c.number, 4);
        if (status == LG_OK) status = lg_csv_line(&c, &more, &error);
        if (status == LG_OK && (strcmp(c.line, "1,\"2\n\n3\"") != 0 || !more || c.number != 7))
            fail_msg("%zu: line %zu: '%s'", shift, c.number, c.line);
        if (status == LG_OK) status = lg_csv_line(&c, &more, &error);
        if (status == LG_OK) assert_false(more);
        lg_csv_close(&c);
        if (lg_test_again(status))
            shift--;
        else
            assert_int_equal(status, LG_OK);
    }
}

static bool two_reads(void *user) {
    return (*(int *)user)++ < 2;
}

TEST("a feed gives any lines as they come: open quotes end with the line, long lines are cut") {
    int pipes[2], reads = 0;
    char *text = lg_test_memory(9000);
    lg_error error = {LG_OK, ""};
    lg_csv c;
    bool more = false;
    memset(text, 'x', 9000);
    memcpy(text, "1,\"2\n\n#a\0b\r\n", 13);
    text[8990] = '\n';
    memcpy(text + 8991, "5,6", 3);
    assert_int_equal(pipe(pipes), 0);
    assert_int_equal(fcntl(pipes[0], F_SETFL, O_NONBLOCK), 0);
    assert_int_equal(write(pipes[1], text, 8994), 8994);
    lg_status status;
    while (
        lg_test_again(status = lg_csv_open_feed(NULL, pipes[0], "pipe", 8000, two_reads, &reads, &c, &error)))
        lg_csv_close(&c);
    assert_ok(status);
    static const struct {
        const char *line;
        bool closed, cut;
    } rows[] = {{"1,\"2", true, false},
                {"", true, false},
                {"#a?b", true, false},
                {NULL, true, true},
                {"5,6", false, false}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        if (i == 4) assert_int_equal(reads, 1);
        if (i == 4) assert_int_equal(close(pipes[1]), 0);
        assert_ok(lg_csv_next(&c, &more, &error));
        assert_true(more && c.number == i + 1 && c.closed == rows[i].closed && c.cut == rows[i].cut);
        if (rows[i].line != NULL) assert_string_equal(c.line, rows[i].line);
    }
    assert_ok(lg_csv_next(&c, &more, &error));
    assert_false(more);
    lg_csv_close(&c);
    assert_int_equal(close(pipes[0]), 0);
}
