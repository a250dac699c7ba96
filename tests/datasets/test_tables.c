/* Tables: complete rows, ports with the range of a table, files whose sizes are wrong or large, wide tables.
 * lg-fit's tests read files too. */
#include "support/io_test.h"

#include "liegrad/table.h"

OWNED(lg_table_data, lg_table_data_destroy)
OWNED(lg_tensors, lg_tensors_destroy)

static lg_table_data *read_columns(const char *text, const char *columns, const char *class_column) {
    const char *names[] = {(char[]){columns[0], '\0'}, (char[]){columns[1], '\0'}};
    lg_table_data data;
    write_text_to(scratch_path("t.csv"), text);
    assert_ok(lg_table_read(NULL, scratch_path("t.csv"), names, (uint32_t)strlen(columns), class_column, NULL,
                            &data, NULL));
    return own_lg_table_data(data);
}

static const char holes[] = "a,b,c,run\n1,2,3,x\n4,,5,x\n6,7,,y\n8,9,10,\n11,12,13,y\n";

TEST("rows that are incomplete in one table are left out of all, with their labels and lines") {
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

TEST("tables with different rows, or without a complete row, are refused and stay unchanged") {
    lg_table_data *x = read_columns(holes, "ab", NULL), *y = read_columns("c,d\n1,\n2,\n", "cd", NULL);
    lg_error error = {LG_OK, ""};
    assert_status(lg_table_keep_complete((lg_table_data *[]){x, y}, 2, NULL, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "5 and 2 rows"));
    assert_status(lg_table_keep_complete(&y, 1, NULL, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "all 2 rows"));
    assert_int_equal(x->rows, 5);
    assert_int_equal(y->rows, 2);
}

TEST("a port has the range of the table's numbers, without missing ones") {
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

/* ---- files of arrays ---- */

/* Writes the header's length (safetensors), the header, and then a hole of `size` bytes. */
static const char *write_hole(const char *name, const char *start, size_t start_bytes, const char *header,
                              uint64_t size) {
    const char *path = scratch_path(name);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(start, 1, start_bytes, file), start_bytes);
    assert_int_equal(fwrite(header, 1, strlen(header), file), strlen(header));
    assert_int_equal(fflush(file), 0);
    assert_int_equal(ftruncate(fileno(file), (off_t)(start_bytes + strlen(header) + size)), 0);
    assert_int_equal(fclose(file), 0);
    return path;
}

static const char *write_tensors(const char *header, uint64_t size) {
    char start[8] = {0};
    for (int i = 0; i < 8; i++) start[i] = (char)((uint64_t)strlen(header) >> 8 * i & 255);
    return write_hole("t.safetensors", start, sizeof start, header, size);
}

static const char *write_npy(const char *header, uint64_t size) {
    const char start[] = {(char)0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0, (char)strlen(header), 0};
    return write_hole("t.npy", start, sizeof start, header, size);
}

#define TENSOR(name, shape, offsets)                                                                         \
    "\"" name "\":{\"dtype\":\"F64\",\"shape\":[" shape "],\"data_offsets\":[" offsets "]}"

TEST("tensors that fill a file are read, in whatever order the header lists them") {
    static const struct {
        const char *header;
        uint64_t size;
        size_t count;
    } good[] = {{"{}", 0, 0},
                {"{" TENSOR("a", "2", "0,16") "}", 16, 1},
                {"{" TENSOR("b", "1,2", "16,32") "," TENSOR("a", "2", "0,16") "}", 32, 2},
                {"{" TENSOR("a", "2", "0,16") "," TENSOR("none", "0,7", "16,16") "}   ", 16, 2},
                {"{\"__metadata__\":{\"by\":\"hand\"}," TENSOR("a", "", "0,8") "}", 8, 1}};
    const char padded[] = "{" TENSOR("a", "2", "0,16") "}\0\0\0";
    const char length[8] = {(char)(sizeof padded - 1)};
    lg_tensors zeros;
    lg_status status;
    write_hole("z.safetensors", length, sizeof length, "", 0);
    do {
        FILE *file = fopen(scratch_path("z.safetensors"), "wb");
        assert_non_null(file);
        assert_int_equal(fwrite(length, 1, sizeof length, file), sizeof length);
        assert_int_equal(fwrite(padded, 1, sizeof padded - 1, file), sizeof padded - 1);
        assert_int_equal(fwrite((double[2]){1, 2}, 1, 16, file), 16);
        assert_int_equal(fclose(file), 0);
        status = lg_tensors_read(NULL, scratch_path("z.safetensors"), &zeros, NULL);
    } while (lg_test_again(status));
    assert_ok(status);
    assert_int_equal(own_lg_tensors(zeros)->tensor[0].count, 2);
    for (size_t i = 0; i < LG_COUNT(good); i++) {
        lg_tensors made;
        lg_error error = {LG_OK, ""};
        if (lg_tensors_read(NULL, write_tensors(good[i].header, good[i].size), &made, &error) != LG_OK)
            fail_msg("row %zu: %s", i, error.message);
        assert_int_equal(own_lg_tensors(made)->count, good[i].count);
    }
}

TEST("tensors that overlap, leave gaps, or have two names or sizes are refused") {
    static const struct {
        const char *header;
        uint64_t size;
        const char *words;
    } bad[] = {{"{" TENSOR("a", "2", "0,16") "," TENSOR("b", "2", "8,24") "}", 24, "'b': shares bytes"},
               {"{" TENSOR("a", "2", "0,16") "," TENSOR("b", "2", "0,16") "}", 16, "shares bytes"},
               {"{" TENSOR("a", "4", "0,32") "," TENSOR("b", "1", "8,16") "}", 32, "'b': shares bytes"},
               {"{" TENSOR("a", "2", "8,24") "}", 24, "'a': begins after bytes that belong to no tensor"},
               {"{" TENSOR("a", "1", "0,8") "," TENSOR("b", "1", "16,24") "}", 24, "'b': begins after bytes"},
               {"{" TENSOR("a", "2", "0,16") "}", 17, "1 bytes after the last tensor"},
               {"{}", 8, "8 bytes after the last tensor"},
               {"{" TENSOR("a", "2", "0,16") "}", 15, "do not fit the shape or the file"},
               {"{" TENSOR("a", "2", "0,8") "}", 8, "do not fit the shape or the file"},
               {"{" TENSOR("a", "2", "16,0") "}", 16, "do not fit the shape or the file"},
               {"{" TENSOR("a", "99999999,99999999,99999999", "0,16") "}", 16, "do not fit the shape"},
               {"{" TENSOR("a", "1", "0,8") "," TENSOR("a", "1", "8,16") "}", 16, "key 'a' is there twice"},
               {"{\"__metadata__\":{},\"__metadata__\":{}}", 0, "key '__metadata__' is there twice"},
               {"{\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"shape\":[2],\"data_offsets\":[0,8]}}", 8,
                "key 'shape' is there twice"},
               {"{\"a\":{\"dtype\":\"F64\",\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,8]}}", 8,
                "key 'dtype' is there twice"},
               {"{" TENSOR("a\\u0000b", "1", "0,8") "}", 8, "a key is not a text"}};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        lg_tensors made;
        lg_error error = {LG_OK, ""};
        const lg_status status =
            lg_tensors_read(NULL, write_tensors(bad[i].header, bad[i].size), &made, &error);
        if (status != LG_FORMAT || strstr(error.message, bad[i].words) == NULL)
            fail_msg("row %zu: status %d: %s", i, (int)status, error.message);
    }
}

#define TEN_GB 10000000000u

TEST("a large file with a wrong header, or with too many numbers, takes no memory") {
    static const struct {
        bool npy;
        const char *header;
        const char *words;
    } bad[] = {
        {false, "{" TENSOR("a", "2", "0,16") "}", "9999999984 bytes after the last tensor"},
        {false, "{" TENSOR("a", "1250000000", "0,10000000000") "}", "1250000000 numbers; at most"},
        {false, "{\"a\":{\"dtype\":\"F16\",\"shape\":[5000000000],\"data_offsets\":[0,1410065408]}}",
         "data_offsets do not fit"}, /* the shape modulo 2^32 would fit */
        {false, "{" TENSOR("a", "9", "9999999928,10000000000") "}",
         "begins after bytes that belong to no tensor"},
        {true, "{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }\n",
         "9999999984 bytes follow after"},
        {true, "{'descr': '<f8', 'fortran_order': True, 'shape': (1250000000,), }\n", "numbers; at most"},
        {true, "{'descr': '<f8', 'shape': (9,), 'fortran_order': True, 'shape': (2,), }\n", "has no shape"},
        {true, "{'descr': '<f8', 'descr': '<f4', 'fortran_order': True, 'shape': (2,), }\n", "descr"}};
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        const char *path = (bad[i].npy ? write_npy : write_tensors)(bad[i].header, TEN_GB), *name = "c0";
        lg_tensors tensors;
        lg_table_data data;
        lg_error error = {LG_OK, ""};
        lg_fail_alloc_arm(&memory, 0);
        const lg_status status = bad[i].npy
                                     ? lg_table_read(context, path, &name, 1, NULL, NULL, &data, &error)
                                     : lg_tensors_read(context, path, &tensors, &error);
        if (status != LG_FORMAT || strstr(error.message, bad[i].words) == NULL)
            fail_msg("row %zu: status %d: %s", i, (int)status, error.message);
        assert_int_equal(lg_fail_alloc_live(&memory), 0);
        if (memory.bytes > 1000000) fail_msg("row %zu: %llu bytes", i, memory.bytes);
        assert_int_equal(unlink(path), 0);
    }
    lg_context_destroy(context);
}

TEST("reading arrays and tables stops when cancelled, and leaks nothing") {
    const int stop = 1;
    lg_fail_alloc memory;
    lg_context_options options;
    lg_context *context;
    lg_fail_alloc_arm(&memory, 0);
    lg_context_options_init(&options);
    options.allocate = lg_fail_alloc_take;
    options.release = lg_fail_alloc_release;
    options.allocator_user = &memory;
    options.cancel = &stop;
    assert_ok(lg_context_create(&options, &context));
    const long before = lg_fail_alloc_live(&memory);
    lg_tensors tensors;
    lg_table_data data;
    const char *name = "c0";
    assert_status(
        lg_tensors_read(context, write_tensors("{" TENSOR("a", "2", "0,16") "}", 16), &tensors, NULL),
        LG_CANCELLED);
    const char *npy = write_npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }\n", 16);
    assert_status(lg_table_read(context, npy, &name, 1, NULL, NULL, &data, NULL), LG_CANCELLED);
    write_text_to(scratch_path("c.csv"), "c0\n1\n2\n");
    assert_status(lg_table_read(context, scratch_path("c.csv"), &name, 1, NULL, NULL, &data, NULL),
                  LG_CANCELLED);
    assert_int_equal(lg_fail_alloc_live(&memory), before);
    lg_context_destroy(context);
}

/* ---- CSV ---- */

TEST("headers and cells of CSV files that are wrong are refused with their line") {
    enum { LONG = LG_TABLE_NAME + 10 };
    char name[LONG + 1], long_class[2 * LONG], long_name[2 * LONG], *many = TEST_ARRAY(char, 1 << 16),
                                                                    *to = many;
    memset(name, 'w', LONG), name[LONG] = '\0';
    (void)snprintf(long_class, sizeof long_class, "x,c\n1,%s\n", name);
    (void)snprintf(long_name, sizeof long_name, "x,%s\n1,2\n", name);
    to += sprintf(to, "x,c\n");
    for (int i = 0; i <= 1000; i++) to += sprintf(to, "1,class%d\n", i);
    const struct {
        const char *text, *class_column, *word; /* word NULL: the table is read */
    } rows[] = {
        {"1,2,3\n4,5,6\n", NULL,
         "line 1: has numbers where names of columns are expected: there is no header; write one"},
        {"x,2\n4,5\n", NULL, "line 1: has numbers where"},
        {"x,y,2\n4,5,6\n", NULL, NULL},
        {"x,\"y\n4,5\n", NULL, "line 1: a quote is not closed"},
        {"x,\"y\" z\n4,5\n", NULL, "line 1: text follows a closing quote"},
        {"x,\"y\" \t\n4,5\n", NULL, NULL},
        {"x,\"y \"\" z\"\n4,5\n", NULL, NULL},
        {"x,y\n4\n5,6\n", NULL, "line 2"},
        {"x,y\nfour,5\n", NULL, "line 2: column x: 'four' is not a number"},
        {"x,y\n\"1,5\",5\n", NULL, "write decimals with a point"},
        {"x,y\n1e999,5\n", NULL, "is not a finite number"},
        {"x\n", NULL, "has a header, but no rows"},
        {"", NULL, ""},
        {long_class, "c", "line 2: column c: the text has more than 63 bytes"},
        {long_name, NULL, NULL},                                     /* the column is not wanted */
        {long_name + 2 + LONG - 63, NULL, "there is no column 'x'"}, /* a name of 63 bytes */
        {many, "c", "column c: has more than 1000 different values"},
    };
    const char *const x = "x";
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_table_data data;
        lg_error error = {LG_OK, ""};
        write_text_to(scratch_path("t.csv"), rows[i].text);
        const lg_status status =
            lg_table_read(NULL, scratch_path("t.csv"), &x, 1, rows[i].class_column, NULL, &data, &error);
        if (lg_test_again(status)) continue;
        if (status == LG_OK) lg_table_data_destroy(&data);
        if (status != (rows[i].word == NULL ? LG_OK : LG_FORMAT)) fail_msg("row %zu: %s", i, error.message);
        if (rows[i].word != NULL) assert_says(error.message, rows[i].word);
    }
    lg_table_data data;
    lg_table_names names;
    lg_error error = {LG_OK, ""};
    write_text_to(scratch_path("t.csv"), long_name);
    assert_status(lg_table_names_read(NULL, scratch_path("t.csv"), NULL, &names, &error), LG_FORMAT);
    assert_says(error.message, "the name of column 2 has more than 63 bytes");
    assert_status(lg_table_read(NULL, "", &x, 1, NULL, NULL, &data, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_table_keep_complete(NULL, 1, NULL, NULL), LG_INVALID_ARGUMENT);
}

/* ---- files of numpy ---- */

/* Writes the magic number, the version, the length of the header (`length` 0: the true one), the header and
 * the numbers. */
static const char *write_numpy(int version, size_t length, const char *header, const void *data,
                               size_t size) {
    unsigned char bytes[1024] = {0x93, 'N', 'U', 'M', 'P', 'Y', (unsigned char)version, 0};
    const size_t wide = version == 1 ? 2 : 4, text = strlen(header);
    for (size_t i = 0; i < wide; i++) bytes[8 + i] = (unsigned char)((length > 0 ? length : text) >> 8 * i);
    memcpy(bytes + 8 + wide, header, text);
    if (size > 0) memcpy(bytes + 8 + wide + text, data, size);
    write_bytes_to(scratch_path("a.npy"), bytes, 8 + wide + text + size);
    return scratch_path("a.npy");
}

#define NUMPY(type, order, shape)                                                                            \
    "{'descr': '" type "', 'fortran_order': " order ", 'shape': (" shape "), }\n"

TEST("numbers of every type of numpy are read") {
    static const struct {
        const char *header, *data;
        size_t size;
        double first, second;
    } rows[] = {
        {NUMPY("<f4", "False", "2,"), "\0\0\xc0\x3f\0\0\0\xc0", 8, 1.5, -2},
        {NUMPY(">f4", "False", "2,"), "\x3f\xc0\0\0\xc0\0\0\0", 8, 1.5, -2},
        {NUMPY(">f8", "False", "2, 1"), "\x3f\xf8\0\0\0\0\0\0\xc0\0\0\0\0\0\0\0", 16, 1.5, -2},
        {NUMPY("|i1", "False", "2,"), "\x7f\xff", 2, 127, -1},
        {NUMPY("|u1", "False", "2,"), "\x7f\xff", 2, 127, 255},
        {NUMPY("|b1", "False", "2,"), "\1\0", 2, 1, 0},
        {NUMPY(">i2", "False", "2,"), "\xff\xfe\0\1", 4, -2, 1},
        {NUMPY("<u4", "False", "2,"), "\xff\xff\xff\xff\1\0\0\0", 8, 4294967295.0, 1},
        {NUMPY("<i8", "False", "2,"), "\0\0\0\0\0\0\0\x80\1\0\0\0\0\0\0\0", 16, -0x1p63, 1},
        {NUMPY("<u8", "False", "2,"), "\0\0\0\0\0\0\0\x80\1\0\0\0\0\0\0\0", 16, 0x1p63, 1},
        {NUMPY("|u1", "False", "2, 2"), "\1\2\3\4", 4, 1, 3},
        {NUMPY("|u1", "True", "2, 2"), "\1\2\3\4", 4, 1, 2},
    };
    const char *const name = "c0";
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        for (int version = 1; version <= 3; version++) {
            lg_table_data data;
            const char *path = write_numpy(version, 0, rows[i].header, rows[i].data, rows[i].size);
            assert_told(lg_table_read(NULL, path, &name, 1, NULL, NULL, &data, &told));
            own_lg_table_data(data);
            assert_int_equal(data.rows, 2);
            assert_true(data.values[0] == rows[i].first && data.values[1] == rows[i].second);
        }
}

TEST("wrong files of numpy are refused") {
    static const struct {
        int version;
        size_t length;
        const char *header;
        size_t size;
        const char *word;
    } rows[] = {
        {0, 0, NUMPY("<f8", "False", "2,"), 16, "an unknown version"},
        {4, 0, NUMPY("<f8", "False", "2,"), 16, "an unknown version"},
        {1, 60000, NUMPY("<f8", "False", "2,"), 16, "ends within numpy's header"},
        {2, 65537, NUMPY("<f8", "False", "2,"), 16, "a numpy header of more than 65536 bytes"},
        {1, 0, "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (2,)}", 16,
         "holds records of type [('a', '<f8')]; save their columns as one array"},
        {1, 0, "{'fortran_order': False, 'shape': (2,)}", 16, "not hold a plain array"},
        {1, 0, "{'fortran_order': False, 'shape': (2,), 'descr': '<", 16, "not hold a plain array"},
        {1, 0, NUMPY("<c8", "False", "2,"), 16, "values of type '<c8'"},
        {1, 0, NUMPY("<f2", "False", "2,"), 4, "values of type '<f2'"},
        {1, 0, NUMPY("<i3", "False", "2,"), 6, "values of type '<i3'"},
        {1, 0, NUMPY("|b2", "False", "2,"), 4, "values of type '|b2'"},
        {1, 0, NUMPY("<f88", "False", "2,"), 16, "values of type '<f88'"},
        {1, 0, "{'descr': '<f8', 'shape': (2,)}", 16, "has no shape"},
        {1, 0, "{'descr': '<f8', 'fortran_order': False}", 16, "has no shape"},
        {1, 0, "{'descr': '<f8', 'fortran_order': False, 'shape': 2}", 16, "has no shape"},
        {1, 0, NUMPY("<f8", "False", "1, 1, 1"), 8,
         "has shape (1, 1, 1), expected (rows) or (rows, columns): save a.reshape(len(a), -1)"},
        {1, 0, NUMPY("<f8", "False", "-1,"), 8, "has shape (-1,), expected (rows)"},
        {1, 0, NUMPY("<f8", "False", "2, -1"), 8, "has shape (2, -1), expected (rows)"},
        {1, 0, NUMPY("<f8", "False", "a"), 8, "has shape (a), expected (rows)"},
        {1, 0, NUMPY("<f8", "False", ""), 8, "is a single number"},
        {1, 0, NUMPY("<f8", "False", "0,"), 0, "one of its dimensions is 0"},
        {1, 0, NUMPY("<f8", "False", "3, 0"), 0, "one of its dimensions is 0"},
        {1, 0, NUMPY("|u1", "False", "1, 70000"), 8, "more than 65536 columns"},
        {1, 0, NUMPY("<f8", "False", "2,"), 15, "is cut off: its header announces (2, 1) numbers"},
        {1, 0, NUMPY("<f8", "False", "2305843009213693953, 8"), 64, "is cut off"}, /* 64 bytes modulo 2^64 */
        {1, 0, NUMPY("<f8", "False", "2,"), 17, "1 bytes follow after its array"},
        {1, 0, NUMPY("|b1", "False", "64,"), 64,
         "row 64: column c0: a value of type b1 is 7, expected 0 or 1: save a.view('u1')"},
    };
    static const char zeros[64] = {[63] = 7};
    const char *const name = "c0";
    lg_table_data data;
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = write_numpy(rows[i].version, rows[i].length, rows[i].header, zeros, rows[i].size);
        assert_status(lg_table_read(NULL, path, &name, 1, NULL, NULL, &data, &error), LG_FORMAT);
        assert_says(error.message, rows[i].word);
    }
    for (size_t size = 6; size < 10; size++) {
        write_bytes_to(scratch_path("cut.npy"), "\x93NUMPY\1\0\0\0", size);
        assert_status(lg_table_read(NULL, scratch_path("cut.npy"), &name, 1, NULL, NULL, &data, &error),
                      LG_FORMAT);
        assert_says(error.message, "ends within numpy's header");
    }
}

/* ---- tensors ---- */

/* Writes a file of tensors. `length` 0: the true length of the header. */
static const char *write_tensor(uint64_t length, const char *header, const void *data, size_t size) {
    unsigned char bytes[1024];
    const size_t text = strlen(header);
    for (size_t i = 0; i < 8; i++) bytes[i] = (unsigned char)((length > 0 ? length : text) >> 8 * i);
    memcpy(bytes + 8, header, text);
    if (size > 0) memcpy(bytes + 8 + text, data, size);
    write_bytes_to(scratch_path("a.safetensors"), bytes, 8 + text + size);
    return scratch_path("a.safetensors");
}

#define ONE(type, shape, offsets)                                                                            \
    "\"a\":{\"dtype\":\"" type "\",\"shape\":" shape ",\"data_offsets\":" offsets "}"

TEST("tensors of every type are read, and the layout of the file is told") {
    static const struct {
        const char *header, *data;
        size_t size;
        double value[2];
        bool inputs_first;
    } rows[] = {
        {"{" ONE("F64", "[2]", "[0,16]") "}", "\0\0\0\0\0\0\xf8\x3f\0\0\0\0\0\0\0\xc0", 16, {1.5, -2}, false},
        {"{" ONE("F32", "[1,2]", "[0,8]") "}", "\0\0\xc0\x3f\0\0\0\xc0", 8, {1.5, -2}, false},
        {"{" ONE("BF16", "[2]", "[0,4]") "}", "\xc0\x3f\0\xc0", 4, {1.5, -2}, false},
        {"{" ONE("F16", "[2]", "[0,4]") "}", "\0\x3e\0\xc0", 4, {1.5, -2}, false},
        {"{" ONE("F16", "[2]", "[0,4]") "}", "\1\0\1\x80", 4, {0x1p-24, -0x1p-24}, false},
        {"{\"__metadata__\":{\"layout\":\"(in, out)\"}," ONE("F16", "[2]", "[0,4]") "}",
         "\0\0\0\0",
         4,
         {0},
         true},
        {"{\"__metadata__\":{\"layout\":\"(out, in)\"}," ONE("F16", "[2]", "[0,4]") "}",
         "\0\0\0\0",
         4,
         {0},
         false},
        {"{\"__metadata__\":3," ONE("F16", "[2]", "[0,4]") "}", "\0\0\0\0", 4, {0}, false},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_tensors made;
        const char *path = write_tensor(0, rows[i].header, rows[i].data, rows[i].size);
        assert_told(lg_tensors_read(NULL, path, &made, &told));
        own_lg_tensors(made);
        assert_true(made.count == 1 && made.tensor[0].count == 2);
        assert_true(made.inputs_first == rows[i].inputs_first);
        assert_all_close(made.tensor[0].values, rows[i].value, 2, 0, 0);
    }
}

TEST("wrong files of tensors are refused") {
    static const struct {
        uint64_t length;
        const char *header, *data;
        size_t size;
        const char *word;
    } rows[] = {
        {1, "{}", "", 0, "is not a safetensors file"},
        {100, "{}", "", 0, "is not a safetensors file"},
        {(1 << 20) + 1, "{}", "", 0, "is not a safetensors file"},
        {0, "[]", "", 0, "is not a safetensors file"},
        {0, "{\"a\":3}", "", 0, "the type is not F64"},
        {0, "{" ONE("I64", "[1]", "[0,8]") "}", "\0\0\0\0\0\0\0", 8, "the type is not F64"},
        {0, "{\"a\":{\"dtype\":[1],\"shape\":[1]}}", "", 0, "the type is not F64"},
        {0, "{\"a\":{\"dtype\":\"F64\"}}", "", 0, "the shape is not a list"},
        {0, "{" ONE("F16", "2", "[0,4]") "}", "\0\0\0", 4, "the shape is not a list"},
        {0, "{" ONE("F16", "[[2]]", "[0,4]") "}", "\0\0\0", 4, "the shape is not a list"},
        {0, "{" ONE("F16", "[1,1,1,1,2]", "[0,4]") "}", "\0\0\0", 4, "at most 4 whole numbers"},
        {0, "{" ONE("F16", "[-2]", "[0,4]") "}", "\0\0\0", 4, "the shape is not a list"},
        {0, "{" ONE("F16", "[\"\"]", "[0,4]") "}", "\0\0\0", 4, "the shape is not a list"},
        {0, "{" ONE("F16", "[1000000000000002]", "[0,4]") "}", "\0\0\0", 4, "the shape is not a list"},
        {0, "{" ONE("F16", "[2]", "[0]") "}", "\0\0\0", 4, "data_offsets is not a list of 2"},
        {0, "{" ONE("F16", "[2]", "4") "}", "\0\0\0", 4, "data_offsets is not a list of 2"},
        {0, "{" ONE("F16", "[2]", "[0,4]") "}", "\0\x7c\0\0", 4, "has numbers that are not finite"},
        {0, "{" ONE("F16", "[2]", "[0,4]") "}", "\0\x7e\0\0", 4, "has numbers that are not finite"},
    };
    lg_tensors made;
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = write_tensor(rows[i].length, rows[i].header, rows[i].data, rows[i].size);
        assert_status(lg_tensors_read(NULL, path, &made, &error), LG_FORMAT);
        assert_says(error.message, rows[i].word);
    }
    char name[400], header[600];
    memset(name, 'n', sizeof name - 1), name[sizeof name - 1] = '\0';
    (void)snprintf(header, sizeof header, "{\"%s\":{}}", name);
    assert_status(lg_tensors_read(NULL, write_tensor(0, header, "", 0), &made, &error), LG_FORMAT);
    assert_says(error.message, "the name is too long");
    lg_tensors_destroy(NULL);
}

/* ---- tables in HDF5 ---- */

enum { H5_ROWS = 3 };

static void write_table(const char *path) {
    const hsize_t rows[1] = {H5_ROWS}, wide[2] = {H5_ROWS, 2}, empty[2] = {H5_ROWS, 0}, cube[3] = {3, 2, 1};
    const double numbers[2 * H5_ROWS] = {1, 2, 3, NAN, 5, 6}, bounds[H5_ROWS] = {0, INFINITY, 0};
    const char *words[H5_ROWS] = {"up", "down", "up"};
    char name[600];
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), text = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(text, H5T_VARIABLE) >= 0);
    for (int i = 0; i < 20; i++) { /* more than the first room for data sets */
        (void)snprintf(name, sizeof name, "n%02d", i);
        put_dataset(file, name, H5T_STD_I32LE, H5T_NATIVE_DOUBLE, 1, rows, false, numbers);
    }
    memset(name, 'l', sizeof name - 1), name[sizeof name - 1] = '\0';
    put_dataset(file, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, rows, false, numbers);
    put_dataset(file, "both", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, wide, true, numbers);
    put_dataset(file, "named", H5T_IEEE_F32LE, H5T_NATIVE_DOUBLE, 2, wide, false, numbers);
    put_dataset(file, "none", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, empty, false, NULL);
    put_dataset(file, "cube", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, cube, false, numbers);
    put_dataset(file, "bounds", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, rows, false, bounds);
    put_dataset(file, "short", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, (hsize_t[]){2}, false, numbers);
    put_dataset(file, "word", text, text, 1, rows, false, words);
    put_dataset(file, "words", text, text, 2, (hsize_t[]){1, 2}, false, words);
    put_dataset(file, "standing", text, text, 2, (hsize_t[]){H5_ROWS, 1}, false, words);
    put_dataset(file, "scalar", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 0, rows, false, numbers);
    put_dataset(file, "vast", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, (hsize_t[]){1, 65537}, false, NULL);
    hid_t pair = H5Tcreate(H5T_COMPOUND, 8);
    assert_true(H5Tinsert(pair, "x", 0, H5T_NATIVE_DOUBLE) >= 0);
    put_dataset(file, "pairs", pair, pair, 1, rows, false, numbers);
    assert_true(H5Tclose(pair) >= 0);
    assert_true(H5Gclose(H5Gcreate2(file, "group", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)) >= 0);
    assert_true(H5Tclose(text) >= 0 && H5Fclose(file) >= 0);
    replace_text(path, "named", "columns", "p, q");
}

static lg_status read_h5(const char *path, const char *column, const char *class_column, lg_table_data *data,
                         lg_error *error) {
    const lg_read_options here = without_probe();
    return lg_table_read(NULL, path, &column, 1, class_column, &here, data, error);
}

TEST("columns of an HDF5 file are arrays and columns of matrices, with the names that the file gives") {
    static const struct {
        const char *column;
        double values[H5_ROWS];
    } rows[] = {{"n00", {1, 2, 3}},   {"n19", {1, 2, 3}}, {"both0", {1, 3, 5}},
                {"both1", {2, 0, 6}}, {"p", {1, 3, 5}},   {"q", {2, 0, 6}}};
    const char *path = fresh_copy("table.h5", write_table);
    const lg_read_options here = without_probe();
    lg_table_names names;
    lg_table_data data;
    assert_told(lg_table_names_read(NULL, path, &here, &names, &told));
    const uint32_t count = names.count;
    lg_table_names_destroy(&names);
    lg_table_names_destroy(NULL);
    assert_int_equal(count,
                     20 + 2 + 2 + 6); /* both, named; bounds, short, standing, word, words, x of pairs */
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        assert_told(read_h5(path, rows[i].column, i % 2 == 0 ? "word" : "standing", &data, &told));
        own_lg_table_data(data);
        assert_int_equal(data.rows, H5_ROWS);
        for (size_t r = 0; r < H5_ROWS; r++)
            assert_true(rows[i].values[r] == 0 ? isnan(data.values[r]) : data.values[r] == rows[i].values[r]);
        assert_true(data.classes == 2 && data.label[0] == 1 && data.label[1] == 0);
    }
    assert_told(read_h5(path, "p", "n00", &data, &told));
    assert_true(data.classes == 3 && strcmp(data.class_name[2], "3") == 0);
    lg_table_data_destroy(&data);
    assert_told(read_h5(path, "p", "q", &data, &told));
    assert_true(data.classes == 2 && data.label[1] == LG_TABLE_NO_CLASS);
    lg_table_data_destroy(&data);
    lg_table_data_destroy(NULL);
}

TEST("columns of an HDF5 file that do not fit are refused by name") {
    static const struct {
        const char *column, *class_column, *word;
    } rows[] = {{"p", "short", "/short: has 2 rows, but /named has 3"},
                {"word", NULL, "/word: does not hold numbers"},
                {"word", "word", "/word: does not hold numbers"},
                {"bounds", NULL, "row 2: column bounds: the value is infinite"},
                {"p", "bounds", "row 2: column bounds: the value is infinite"},
                {"cube", NULL, "there is no column 'cube'"},
                {"p", "words", "/words: has 2 rows, but /named has 3"}};
    const char *path = fresh_copy("table.h5", write_table);
    lg_table_data data;
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        assert_status(read_h5(path, rows[i].column, rows[i].class_column, &data, &error), LG_FORMAT);
        assert_says(error.message, rows[i].word);
    }
    replace_text(path, "named", "columns", "p, q, r");
    assert_status(read_h5(path, "p", NULL, &data, &error), LG_FORMAT);
    assert_says(error.message, "/named: attribute columns has 3 names for 2 columns");
    hid_t file = H5Fcreate(scratch_path("bare.h5"), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    put_dataset(file, "none", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, (hsize_t[]){0}, false, NULL);
    assert_true(H5Fclose(file) >= 0);
    assert_status(read_h5(scratch_path("bare.h5"), "none", NULL, &data, &error), LG_FORMAT);
    assert_says(error.message, "has no rows");
    delete_link(scratch_path("bare.h5"), "none");
    assert_status(read_h5(scratch_path("bare.h5"), "none", NULL, &data, &error), LG_FORMAT);
    assert_says(error.message, "has no data set at its root that is a column of numbers");
}

static void mark_matlab(hid_t file, const char *name) {
    hid_t set = H5Dopen2(file, name, H5P_DEFAULT), space = H5Screate(H5S_SCALAR), text = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(text, 6) >= 0);
    hid_t attribute = H5Acreate2(set, "MATLAB_class", text, space, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Awrite(attribute, text, "double") >= 0);
    assert_true(H5Aclose(attribute) >= 0 && H5Sclose(space) >= 0 && H5Tclose(text) >= 0 &&
                H5Dclose(set) >= 0);
}

/* A data set with the numbers 0, 1, 2, ... */
static void put_counting(hid_t file, const char *name, hsize_t rows, hsize_t columns, bool matlab) {
    double numbers[64];
    for (int i = 0; i < 64; i++) numbers[i] = i;
    put_dataset(file, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, (hsize_t[]){rows, columns}, false, numbers);
    if (matlab) mark_matlab(file, name);
}

TEST("arrays as MATLAB writes them are columns, at any size of the user block") {
    static const hsize_t blocks[] = {0, 512, 1024, 2048, 65536};
    static const struct {
        hsize_t x[2], y[2];
        bool matlab;
        const char *names[2];
        size_t rows;
        double last[2];
    } files[] = {
        {{1, 5}, {5, 1}, false, {"x", "y"}, 5, {4, 4}},
        {{1, 5}, {1, 5}, false, {"x", "y"}, 5, {4, 4}},
        {{1, 5}, {1, 5}, true, {"x", "y"}, 5, {4, 4}},
        {{2, 5}, {1, 5}, true, {"x1", "y"}, 5, {9, 4}},   /* MATLAB's (5, 2) */
        {{1, 3}, {1, 2}, false, {"x2", "y1"}, 1, {2, 1}}, /* one row of five columns */
        {{3, 1}, {2, 1}, true, {"x2", "y1"}, 1, {2, 1}},
        {{5, 1}, {5, 1}, true, {"x", "y"}, 5, {4, 4}}, /* MATLAB's (1, 5) */
        {{5, 1}, {1, 5}, true, {"x", "y"}, 5, {4, 4}},
        {{2, 5}, {5, 1}, true, {"x1", "y"}, 5, {9, 4}},
        {{5, 2}, {1, 5}, false, {"x1", "y"}, 5, {9, 4}},
    };
    for (size_t i = 0; i < LG_COUNT(files) * LG_COUNT(blocks); i++) {
        const char *path = scratch_path("matlab.mat");
        lg_table_data data;
        lg_error error;
        bool h5 = false;
        hid_t list = H5Pcreate(H5P_FILE_CREATE);
        assert_true(H5Pset_userblock(list, blocks[i % LG_COUNT(blocks)]) >= 0);
        hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, list, H5P_DEFAULT);
        const size_t k = i / LG_COUNT(blocks);
        put_counting(file, "x", files[k].x[0], files[k].x[1], files[k].matlab);
        put_counting(file, "y", files[k].y[0], files[k].y[1], files[k].matlab);
        assert_true(H5Fclose(file) >= 0 && H5Pclose(list) >= 0);
        while (lg_test_again(lg_file_is_h5(path, &h5, NULL))) {
        }
        assert_true(h5);
        lg_status status;
        do status = lg_table_read(NULL, path, files[k].names, 2, NULL, NULL, &data, &error);
        while (lg_test_again(status));
        if (status != LG_OK) fail_msg("file %zu: %s", k, error.message);
        own_lg_table_data(data);
        assert_int_equal(data.rows, files[k].rows);
        assert_all_close(data.values + 2 * (data.rows - 1), files[k].last, 2, 0, 0);
    }
    bool h5 = true;
    write_text_to(scratch_path("t.csv"), "x,y\n1,2\n");
    assert_ok(lg_file_is_h5(scratch_path("t.csv"), &h5, NULL));
    assert_false(h5);
    assert_status(lg_file_is_h5(scratch_path("none"), &h5, NULL), LG_NOT_FOUND);
}

TEST("arrays of one length are columns by their names in every layout, and single numbers are left out") {
    enum { ARRAYS = 3, N = 41 };
    static const hsize_t shape[3][2] = {{N, 0}, {N, 1}, {1, N}};
    static const char *const name[] = {"a", "t", "y"};
    double numbers[N];
    for (int i = 0; i < N; i++) numbers[i] = 0.5 * i;
    for (int matlab = 0; matlab < 2; matlab++)
        for (int k = 0; k < 27 * 2; k++) {
            const char *path = scratch_path("layouts.mat");
            const int of[ARRAYS] = {k % 3, k / 3 % 3, k / 9 % 3};
            hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
            for (int i = 0; i < ARRAYS; i++) {
                put_dataset(file, name[i], k < 27 ? H5T_IEEE_F64LE : H5T_IEEE_F32BE, H5T_NATIVE_DOUBLE,
                            of[i] == 0 ? 1 : 2, shape[of[i]], false, numbers);
                if (matlab) mark_matlab(file, name[i]);
            }
            put_counting(file, "one", 1, 1, matlab);
            assert_true(H5Fclose(file) >= 0);
            const lg_read_options here = without_probe();
            lg_table_names names;
            lg_table_data data;
            assert_told(lg_table_names_read(NULL, path, &here, &names, &told));
            if (names.count != ARRAYS || strcmp(names.name[1], name[1]) != 0)
                fail_msg("layout %d, MATLAB %d: %u columns, the second is %s", k, matlab, names.count,
                         names.name[1]);
            lg_table_names_destroy(&names);
            assert_told(lg_table_read(NULL, path, name, ARRAYS, NULL, &here, &data, &told));
            own_lg_table_data(data);
            assert_int_equal(data.rows, N);
            for (int i = 0; i < N * ARRAYS; i++) assert_close(data.values[i], numbers[i / ARRAYS], 0, 0);
        }
}

TEST("the only array of a file is one row as its program shows it, or a column if its name is wanted") {
    static const char *const column[] = {"x"}, *const cells[] = {"x0", "x1", "x2"};
    for (int matlab = 0; matlab < 2; matlab++) {
        const char *path = scratch_path("lone.mat");
        const lg_read_options here = without_probe();
        lg_table_data data;
        hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
        put_counting(file, "x", matlab ? 3 : 1, matlab ? 1 : 3, matlab);
        assert_true(H5Fclose(file) >= 0);
        for (uint32_t count = 1; count <= 3; count += 2) {
            assert_told(
                lg_table_read(NULL, path, count == 1 ? column : cells, count, NULL, &here, &data, &told));
            own_lg_table_data(data);
            assert_int_equal(data.rows, 4 - count);
            for (int i = 0; i < 3; i++) assert_close(data.values[i], i, 0, 0);
        }
    }
}

/* ---- wide tables ---- */

TEST("a wide table takes memory in proportion to its cells, and each column keeps its numbers") {
    enum { COLUMNS = 60000, ROWS = 3 };
    char *text = TEST_ARRAY(char, COLUMNS * 8 * (ROWS + 1)), *to = text;
    lg_table_text *name = TEST_ARRAY(lg_table_text, COLUMNS);
    const char **names = TEST_ARRAY(const char *, COLUMNS);
    for (int row = -1; row < ROWS; row++)
        for (int c = 0; c < COLUMNS; c++)
            to += sprintf(to, row < 0 ? "x%d%c" : "%d%c", row < 0 ? c : 10 * c + row,
                          c + 1 < COLUMNS ? ',' : '\n');
    for (int c = 0; c < COLUMNS; c++) {
        (void)sprintf(name[c], "x%d", (c + 7) % COLUMNS);
        names[c] = name[c];
    }
    write_text_to(scratch_path("wide.csv"), text);
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    lg_table_data data;
    assert_ok(lg_table_read(context, scratch_path("wide.csv"), names, COLUMNS, NULL, NULL, &data, NULL));
    for (int row = 0; row < ROWS; row++)
        for (int c = 0; c < COLUMNS; c++)
            assert_close(data.values[row * COLUMNS + c], 10 * ((c + 7) % COLUMNS) + row, 0, 0);
    /* Names of LG_TABLE_NAME bytes in an array that doubles when it grows, and the numbers. */
    assert_true(memory.bytes < 5u * COLUMNS * (LG_TABLE_NAME + 8 * ROWS));
    lg_table_data_destroy(&data);
    lg_context_destroy(context);
}

TEST("a column can be requested only once") {
    static const char *const names[] = {"a", "b", "a"};
    lg_table_data data;
    lg_error error = {LG_OK, ""};
    write_text_to(scratch_path("t.csv"), "a,b,c,c\n1,2,3,4\n");
    assert_status(lg_table_read(NULL, scratch_path("t.csv"), names, 3, NULL, NULL, &data, &error),
                  LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "'a' is requested twice"));
    const char *const twice = "c", *const missing = "d";
    assert_status(lg_table_read(NULL, scratch_path("t.csv"), &twice, 1, NULL, NULL, &data, &error),
                  LG_FORMAT);
    assert_non_null(strstr(error.message, "there are two columns 'c'"));
    assert_status(lg_table_read(NULL, scratch_path("t.csv"), &missing, 1, NULL, NULL, &data, &error),
                  LG_FORMAT);
    assert_non_null(strstr(error.message, "no column 'd'"));
}
