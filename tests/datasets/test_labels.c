/* Labels and whole numbers of tables: texts as written, exact whatever the file, and CSV that reads back. */
#include "support/io_test.h"

#include "files/csv.h"
#include "liegrad/table.h"
#include "support/texts.h"

OWNED(lg_table_data, lg_table_data_destroy)

TEST("decimal texts are compared as numbers, exactly") {
    /* In rising order; texts with the same number are the same value. */
    static const struct {
        const char *text;
        int number;
    } rows[] = {{"-1e400", 0},
                {"-1152921504606846977", 1},
                {"-1152921504606846976", 2},
                {"-1", 3},
                {"-1.00e0", 3},
                {"0", 4},
                {"-0.0", 4},
                {"+.0e7", 4},
                {"1e-99999999999999999999", 5},
                {"0.1", 6},
                {"00.10", 6},
                {"1", 7},
                {"01", 7},
                {"10e-1", 7},
                {"1.0000000000000000000000001", 8},
                {"9", 9},
                {"10", 10},
                {"9007199254740992", 11},
                {"9007199254740993", 12},
                {"9007199254740993.0", 12},
                {"90071992547409.93e2", 12},
                {"9007199254740993.5", 13},
                {"1e300", 14},
                {"1e99999999999999999999", 15}};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        for (size_t k = 0; k < LG_COUNT(rows); k++) {
            const int order = lg_decimal_compare(rows[i].text, rows[k].text),
                      wanted = (rows[i].number > rows[k].number) - (rows[i].number < rows[k].number);
            if ((order > 0) - (order < 0) != wanted) fail_msg("%s %s: %d", rows[i].text, rows[k].text, order);
        }
}

TEST("the shortest text of a float or a double reads back as the same number") {
    static const struct {
        double value;
        bool single;
        const char *text;
    } rows[] = {{0.1, false, "0.1"},
                {(double)0.1f, true, "0.1"},
                {(double)0.1f, false, "0.10000000149011612"},
                {0x1p-1074, false, "5e-324"},
                {0x1p-149, true, "1e-45"},
                {0x1p53, false, "9007199254740992"},
                {16777217, false, "16777217"},
                {1e23, false, "1e+23"},
                {-INFINITY, false, "-inf"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char text[LG_SHORTEST];
        lg_format_shortest(text, rows[i].value, rows[i].single);
        assert_string_equal(text, rows[i].text);
    }
    lg_rng rng;
    lg_rng_seed(&rng, 5, 0);
    for (int i = 0; i < 20000; i++) {
        char text[LG_SHORTEST];
        const uint64_t bits = lg_rng_next(&rng);
        const uint32_t half = (uint32_t)bits;
        double value;
        float single;
        memcpy(&value, &bits, sizeof value);
        memcpy(&single, &half, sizeof single);
        lg_format_shortest(text, value, false);
        if (isfinite(value)) assert_true(strtod(text, NULL) == value);
        lg_format_shortest(text, (double)single, true);
        if (isfinite(single)) assert_true(strtof(text, NULL) == single);
    }
}

/* ---- the same labels in CSV, numpy and HDF5 ---- */

enum { ROWS = 4 };

/* Writes a file of numpy with the columns c0, the labels, and c1 = 0, 1, ... */
static const char *write_npy(const char *descr, size_t size, const void *labels, const void *counts) {
    const char *path = scratch_path("t.npy");
    char header[119];
    (void)snprintf(header, sizeof header, "{'descr': '%s', 'fortran_order': True, 'shape': (%d, 2), }%60s",
                   descr, ROWS, "");
    header[117] = '\n';
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite("\x93NUMPY\x01\0\x76\0", 1, 10, file), 10);
    assert_int_equal(fwrite(header, 1, 118, file), 118);
    assert_int_equal(fwrite(labels, size, ROWS, file), ROWS);
    assert_int_equal(fwrite(counts, size, ROWS, file), ROWS);
    assert_int_equal(fclose(file), 0);
    return path;
}

static const char *write_h5(hid_t type, hid_t stored, const void *labels, const void *counts) {
    const char *path = scratch_path("t.h5");
    const hsize_t rows[1] = {ROWS};
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    put_dataset(file, "c0", stored, type, 1, rows, true, labels);
    put_dataset(file, "c1", stored, type, 1, rows, false, counts);
    assert_true(H5Fclose(file) >= 0);
    return path;
}

/* As write_h5, in one data set of two columns. */
static const char *write_matrix(hid_t type, size_t size, const void *labels, const void *counts) {
    const char *path = scratch_path("m.h5");
    const hsize_t dims[2] = {ROWS, 2};
    unsigned char both[2 * ROWS * 8];
    for (size_t i = 0; i < ROWS; i++) {
        memcpy(both + 2 * i * size, (const char *)labels + i * size, size);
        memcpy(both + (2 * i + 1) * size, (const char *)counts + i * size, size);
    }
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    put_dataset(file, "c", type, type, 2, dims, true, both);
    assert_true(H5Fclose(file) >= 0);
    return path;
}

static const char *write_csv(const char *const *labels) {
    const char *path = scratch_path("t.csv");
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs("c0,c1\n", file) >= 0);
    for (int i = 0; i < ROWS; i++) assert_true(fprintf(file, "%s,%d\n", labels[i], i) > 0);
    assert_int_equal(fclose(file), 0);
    return path;
}

/* The labels of the rows must be these texts, "" if they are missing, and the classes must be in order. */
static void expect_labels(const char *path, const char *const *labels) {
    const char *const column = "c1";
    lg_table_data data;
    assert_told(lg_table_read(NULL, path, &column, 1, "c0", NULL, &data, &told));
    own_lg_table_data(data);
    assert_int_equal(data.rows, ROWS);
    for (uint32_t i = 0; i < ROWS; i++) {
        const char *got = data.label[i] == LG_TABLE_NO_CLASS ? "" : data.class_name[data.label[i]];
        if (strcmp(got, labels[i]) != 0) fail_msg("%s: row %u: '%s' is not '%s'", path, i, got, labels[i]);
        assert_true(data.values[i] == i);
    }
    for (uint32_t c = 1; c < data.classes; c++)
        assert_true(lg_decimal_compare(data.class_name[c - 1], data.class_name[c]) < 0);
}

#define TYPE(name, c, memory, stored_as, ...)                                                                \
    {                                                                                                        \
        .descr = name, .size = sizeof(c), .labels = (const c[ROWS]){__VA_ARGS__},                            \
        .counts = (const c[ROWS]){0, 1, 2, 3}, .type = &memory, .stored = &stored_as                         \
    }

TEST("labels that are numbers become the same texts in every format, exactly") {
    assert_true(H5open() >= 0);
    const struct {
        struct {
            const char *descr;
            size_t size;
            const void *labels, *counts;
            const hid_t *type, *stored;
        } type;
        const char *texts[ROWS];
    } rows[] = {
        {TYPE("<i1", int8_t, H5T_NATIVE_INT8_g, H5T_STD_I8LE_g, -128, 7, 127, 0), {"-128", "7", "127", "0"}},
        {TYPE("<u2", uint16_t, H5T_NATIVE_UINT16_g, H5T_STD_U16LE_g, 65535, 1, 2, 3),
         {"65535", "1", "2", "3"}},
        {TYPE("<i4", int32_t, H5T_NATIVE_INT32_g, H5T_STD_I32BE_g, INT32_MIN, 10, 9, -1),
         {"-2147483648", "10", "9", "-1"}},
        {TYPE("<i8", int64_t, H5T_NATIVE_INT64_g, H5T_STD_I64LE_g, INT64_MIN, 9007199254740993,
              1152921504606846975, 1152921504606846977),
         {"-9223372036854775808", "9007199254740993", "1152921504606846975", "1152921504606846977"}},
        {TYPE("<i8", int64_t, H5T_NATIVE_INT64_g, H5T_STD_I64BE_g, -9007199254740993, -9007199254740992,
              1234567890123456, 1234567890123457),
         {"-9007199254740993", "-9007199254740992", "1234567890123456", "1234567890123457"}},
        {TYPE("<u8", uint64_t, H5T_NATIVE_UINT64_g, H5T_STD_U64LE_g, UINT64_MAX, UINT64_MAX - 1,
              9007199254740993, 5),
         {"18446744073709551615", "18446744073709551614", "9007199254740993", "5"}},
        {TYPE("<f4", float, H5T_NATIVE_FLOAT_g, H5T_IEEE_F32LE_g, 0.1f, 16777216, NAN, -0.0f),
         {"0.1", "16777216", "", "0"}},
        {TYPE("<f8", double, H5T_NATIVE_DOUBLE_g, H5T_IEEE_F64LE_g, 0.1, 0.30000000000000004, NAN, 1e300),
         {"0.1", "0.30000000000000004", "", "1e+300"}}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const void *labels = rows[i].type.labels, *counts = rows[i].type.counts;
        const size_t size = rows[i].type.size;
        expect_labels(write_csv(rows[i].texts), rows[i].texts);
        expect_labels(write_npy(rows[i].type.descr, size, labels, counts), rows[i].texts);
        expect_labels(write_h5(*rows[i].type.type, *rows[i].type.stored, labels, counts), rows[i].texts);
        expect_labels(write_matrix(*rows[i].type.type, size, labels, counts), rows[i].texts);
    }
}

/* ---- numbers that no double equals ---- */

static lg_status read_number(const char *path, double *out, lg_error *error) {
    const char *const column = "c0";
    lg_table_data data;
    const lg_status status = lg_table_read(NULL, path, &column, 1, NULL, NULL, &data, error);
    if (status == LG_OK) *out = data.values[2];
    if (status == LG_OK) lg_table_data_destroy(&data);
    return status;
}

TEST("whole numbers beyond 2^53 are read exactly or refused with file, row, column and value") {
    static const struct {
        int64_t value;
        bool exact;
    } rows[] = {{9007199254740992, true},    {9007199254740993, false},    {-9007199254740993, false},
                {1152921504606846976, true}, {1152921504606846975, false}, {INT64_MIN, true},
                {INT64_MAX, false},          {-9007199254740994, true}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const int64_t values[ROWS] = {1, 2, rows[i].value, 3};
        const char *texts[ROWS] = {"1", "2", test_text("%lld", (long long)rows[i].value), "3"};
        const char *const paths[] = {write_csv(texts), write_npy("<i8", 8, values, values),
                                     write_h5(H5T_NATIVE_INT64, H5T_STD_I64BE, values, values),
                                     write_matrix(H5T_NATIVE_INT64, 8, values, values)};
        for (size_t k = 0; k < LG_COUNT(paths); k++) {
            double got = 0;
            lg_error error = {LG_OK, ""};
            const lg_status status = read_number(paths[k], &got, &error);
            const char *place = k == 0 ? "t.csv: line 4: column c0: " : ": row 3: column c0: ";
            if (rows[i].exact) {
                assert_status(status, LG_OK);
                assert_true(got == (double)rows[i].value);
            } else {
                assert_status(status, LG_FORMAT);
                assert_says(error.message, strrchr(paths[k], '/') + 1);
                assert_says(error.message, test_text("%s%s is beyond 2^53", place, texts[2]));
            }
        }
    }
    const uint64_t large[ROWS] = {1, 2, UINT64_MAX, 3};
    lg_error error = {LG_OK, ""};
    double got = 0;
    assert_status(read_number(write_npy("<u8", 8, large, large), &got, &error), LG_FORMAT);
    assert_says(error.message, "row 3: column c0: 18446744073709551615 is beyond 2^53");
    /* The text of a real number may be rounded. */
    assert_ok(
        read_number(write_csv((const char *const[]){"1", "2", "9.007199254740993e15", "3"}), &got, &error));
    assert_true(got == 0x1p53);
}

static lg_status open_and_read(const char *path, lg_status (*read)(lg_h5 *, lg_error *), lg_error *error) {
    lg_h5 *h5;
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    const lg_status status = read(h5, error);
    lg_h5_close(h5);
    return status;
}

static lg_status read_array(lg_h5 *h5, lg_error *error) {
    double *out = NULL;
    lg_h5_size rows = {0, NULL, NULL}, columns = rows;
    const lg_status status =
        lg_h5_get_arrays(h5, &(lg_h5_array){"c", &out, {&rows, &columns}, false}, 1, error);
    lg_free(NULL, out);
    return status;
}

static lg_status read_real(lg_h5 *h5, lg_error *error) {
    double value;
    return lg_h5_number(h5, "", "n", LG_ELEMENT_F64, &value, error);
}

static lg_status read_signed(lg_h5 *h5, lg_error *error) {
    int64_t value;
    return lg_h5_number(h5, "", "n", LG_ELEMENT_I64, &value, error);
}

TEST("arrays and attributes of HDF5 are not rounded either; a file's own state may hold any integer") {
    const int64_t values[ROWS] = {1, 2, 9007199254740993, 3}, counts[ROWS] = {0, 1, 2, 3};
    const uint64_t large = (uint64_t)1 << 63, odd = 9007199254740993;
    lg_error error = {LG_OK, ""};
    const char *path = write_matrix(H5T_NATIVE_INT64, 8, values, counts);
    assert_status(open_and_read(path, read_array, &error), LG_FORMAT);
    assert_says(error.message, "m.h5: /c: row 3, index (2, 0): 9007199254740993 is beyond 2^53");
    assert_status(open_and_read(path, lg_h5_read_all, &error), LG_OK);
    replace_attribute(path, "/", "n", H5T_STD_U64LE, H5T_NATIVE_UINT64, &odd);
    assert_status(open_and_read(path, read_real, &error), LG_FORMAT);
    assert_says(error.message, "attribute n: is out of range");
    assert_ok(open_and_read(path, read_signed, &error));
    replace_attribute(path, "/", "n", H5T_STD_U64LE, H5T_NATIVE_UINT64, &large);
    assert_ok(open_and_read(path, read_real, &error));
    assert_status(open_and_read(path, read_signed, &error), LG_FORMAT);
}

TEST("the names of a matrix stand in one text with commas, or in a list, whose texts may have commas") {
    static const struct {
        const char *one, *two;
        bool list;
    } rows[] = {{"p", "q, r", true}, {" p", "q", true}, {"p", "q", false}};
    const int64_t values[ROWS] = {1, 2, 3, 4};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = write_matrix(H5T_NATIVE_INT64, 8, values, values);
        const char *const both[2] = {rows[i].one, rows[i].two};
        const hsize_t dims[1] = {2};
        lg_table_names names;
        if (!rows[i].list) replace_text(path, "c", "columns", "p, q");
        if (rows[i].list) {
            hid_t file = open_for_change(path), type = H5Tcopy(H5T_C_S1),
                  space = H5Screate_simple(1, dims, NULL);
            assert_true(H5Tset_size(type, H5T_VARIABLE) >= 0);
            hid_t at =
                H5Acreate_by_name(file, "c", "columns", type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
            assert_true(at >= 0 && H5Awrite(at, type, both) >= 0 && H5Aclose(at) >= 0);
            assert_true(H5Sclose(space) >= 0 && H5Tclose(type) >= 0 && H5Fclose(file) >= 0);
        }
        assert_told(lg_table_names_read(NULL, path, NULL, &names, &told));
        const bool same =
            names.count == 2 && strcmp(names.name[0], both[0]) == 0 && strcmp(names.name[1], both[1]) == 0;
        lg_table_names_destroy(&names);
        assert_true(same);
    }
}

/* ---- labels that differ only in their writing ---- */

static int warned;
static char warning[512];

static void on_log(void *user, lg_log_level level, const char *message) {
    warned += level == LG_LOG_WARNING;
    (void)snprintf(warning, sizeof warning, "%s", message);
}

TEST("1, 1.0 and 01 are three classes beside each other, which is told; distinct numbers are not told of") {
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.log = on_log;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    static const char *const same[ROWS] = {"1", "2", "1.0", "01"}, *const other[ROWS] = {"9007199254740993",
                                                                                         "9007199254740992",
                                                                                         "10", "text"};
    const char *const column = "c1";
    for (int k = 0; k < 2; k++) {
        lg_table_data data;
        warned = 0;
        assert_told(
            lg_table_read(context, write_csv(k == 0 ? same : other), &column, 1, "c0", NULL, &data, &told));
        own_lg_table_data(data);
        assert_int_equal(data.classes, 4);
        assert_int_equal(warned, k == 0 ? 2 : 0);
        assert_string_equal(data.class_name[0], k == 0 ? "01" : "10");
        assert_string_equal(data.class_name[3], k == 0 ? "2" : "text");
    }
    assert_says(warning, "column c0: the classes '1' and '1.0' are the same number");
}

/* ---- CSV that reads back ---- */

/* Writes a table with these names and labels in column `at`, and numbers elsewhere. */
static void put_table(const char *path, lg_table_text *name, uint32_t columns, uint32_t at,
                      lg_table_text *label, size_t rows) {
    lg_columns to = {.row = 0};
    for (uint32_t c = 0; c < columns; c++) lg_columns_name(&to, name[c]);
    lg_columns_end(&to);
    for (size_t i = 0; i < rows; i++) {
        for (uint32_t c = 0; c < columns; c++)
            if (c == at)
                lg_columns_text(&to, label[i]);
            else
                lg_columns_whole(&to, i);
        lg_columns_end(&to);
    }
    write_text_to(path, to.text.data);
    lg_text_destroy(&to.text);
}

TEST("any names and labels that are written as CSV read back equal") {
    enum { TABLES = 3000, MOST = 4 };
    lg_rng rng;
    lg_rng_seed(&rng, 11, 0);
    const char *path = scratch_path("random.csv");
    for (int k = 0; k < TABLES; k++) {
        lg_table_text name[MOST], label[MOST];
        lg_table_names names;
        lg_table_data data;
        const uint32_t columns = 1 + (uint32_t)lg_rng_below(&rng, MOST),
                       at = (uint32_t)lg_rng_below(&rng, columns);
        const size_t rows = 1 + (size_t)lg_rng_below(&rng, MOST);
        for (uint32_t c = 0; c < columns; c++) draw_text(&rng, name[c]);
        for (size_t i = 0; i < rows; i++) draw_text(&rng, label[i]);
        (void)snprintf(name[at], sizeof name[at], "class %d, \"%s\"", k, k % 2 == 0 ? "\n" : "");
        put_table(path, name, columns, at, label, rows);
        assert_told(lg_table_names_read(NULL, path, NULL, &names, &told));
        const bool same =
            names.count == columns && memcmp(names.name[at], name[at], strlen(name[at]) + 1) == 0;
        for (uint32_t c = 0; c < columns && same; c++) assert_string_equal(names.name[c], name[c]);
        lg_table_names_destroy(&names);
        assert_true(same);
        assert_told(lg_table_read(NULL, path, (const char *const[]){""}, 0, name[at], NULL, &data, &told));
        own_lg_table_data(data);
        assert_int_equal(data.rows, rows);
        for (size_t i = 0; i < rows; i++)
            assert_string_equal(data.label[i] == LG_TABLE_NO_CLASS ? "" : data.class_name[data.label[i]],
                                label[i]);
    }
}

TEST("a table of names that are numbers keeps them, but numbers without quotes are a missing header") {
    lg_table_text name[2] = {"2020", "1e3"}, label[1] = {"x"};
    lg_table_names names;
    lg_error error = {LG_OK, ""};
    put_table(scratch_path("years.csv"), name, 2, 1, label, 1);
    assert_told(lg_table_names_read(NULL, scratch_path("years.csv"), NULL, &names, &told));
    assert_string_equal(names.name[0], "2020");
    lg_table_names_destroy(&names);
    write_text_to(scratch_path("bare.csv"), "2020,1e3\n1,2\n");
    assert_status(lg_table_names_read(NULL, scratch_path("bare.csv"), NULL, &names, &error), LG_FORMAT);
    assert_says(error.message, "there is no header");
}

TEST("a stray quote cannot make a table shorter without a word") {
    static const char *const texts[] = {"a,b\n1,2\n3,\"4\n5,6\n7,8\n", "a,b\n1,2\n3,\"4\n5,6\n7,8",
                                        "a,b\n1,\"2\n3,4\n\"5\",6\n"};
    static const char *const says[] = {"line 3: a quote is not closed", "line 3: a quote is not closed",
                                       "line 2: "};
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        const char *const column = "a";
        lg_table_data data;
        lg_error error = {LG_OK, ""};
        write_text_to(scratch_path("stray.csv"), texts[i]);
        assert_status(lg_table_read(NULL, scratch_path("stray.csv"), &column, 1, NULL, NULL, &data, &error),
                      LG_FORMAT);
        assert_says(error.message, says[i]);
    }
    /* In a comment quotes mean nothing, and lines are counted as an editor counts them. */
    const char *const column = "b";
    lg_table_data data;
    write_text_to(scratch_path("stray.csv"), "\xef\xbb\xbf# 5\" pipe\na,b\n\"1\n2\",3\n# \"\n4,5\n");
    assert_told(lg_table_read(NULL, scratch_path("stray.csv"), &column, 1, "a", NULL, &data, &told));
    own_lg_table_data(data);
    assert_true(data.rows == 2 && data.line[0] == 3 && data.line[1] == 6 && data.values[1] == 5);
    assert_string_equal(data.class_name[1], "1\n2");
}
