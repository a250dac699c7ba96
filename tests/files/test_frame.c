/* Frames: the same columns, whatever the format and the size of the blocks. */
#include "support/io_test.h"

#include "files/frame.h"
#include "support/fixtures.h"

enum { ROWS = 11, COLUMNS = 3 };

/* The number in a column; one is missing, one is beyond 2^53. */
static double number_of(size_t row, size_t column) {
    if (row == 4 && column == 1) return NAN;
    return column == 2 ? 3.0 + (double)(row / 3) : (double)row * 0.5 - (double)column;
}

/* ---- files with columns c0, c1, c2 ---- */

static void write_csv(const char *path) {
    char text[40 * (ROWS + 1)] = "c0,c1,c2\n";
    for (size_t i = 0; i < ROWS; i++)
        lg_append(text, sizeof text, "%g,%g,%g\n", number_of(i, 0), number_of(i, 1), number_of(i, 2));
    write_text_to(path, text);
}

static void write_numpy(const char *path, bool fortran, bool big) {
    char header[128];
    double numbers[ROWS * COLUMNS];
    (void)snprintf(header, sizeof header, "{'descr': '%sf8', 'fortran_order': %s, 'shape': (%d, %d), }\n",
                   big ? ">" : "<", fortran ? "True" : "False", ROWS, COLUMNS);
    for (size_t i = 0; i < ROWS * COLUMNS; i++) {
        numbers[i] = fortran ? number_of(i % ROWS, i / ROWS) : number_of(i / COLUMNS, i % COLUMNS);
        unsigned char *byte = (unsigned char *)&numbers[i];
        for (size_t k = 0; k < 4 && big; k++) {
            const unsigned char last = byte[7 - k];
            byte[7 - k] = byte[k], byte[k] = last;
        }
    }
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    const unsigned char length = (unsigned char)strlen(header);
    assert_int_equal(fwrite("\x93NUMPY\1\0", 1, 8, file), 8);
    assert_true(fputc(length, file) >= 0 && fputc(0, file) >= 0);
    assert_int_equal(fwrite(header, 1, length, file), length);
    assert_int_equal(fwrite(numbers, sizeof *numbers, ROWS * COLUMNS, file), ROWS * COLUMNS);
    assert_int_equal(fclose(file), 0);
}

typedef enum layout { SETS, ROW_SETS, MATRIX, MATLAB, TABLE, LAYOUTS } layout;

static void put_sets(hid_t file, layout how) {
    for (size_t c = 0; c < COLUMNS; c++) {
        double numbers[ROWS];
        for (size_t i = 0; i < ROWS; i++) numbers[i] = number_of(i, c);
        const hsize_t dims[3] = {how == SETS ? ROWS : 1, how == SETS ? 1 : ROWS, 1};
        put_dataset(file, test_text("c%zu", c), c == 0 ? H5T_IEEE_F64BE : H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE,
                    how == SETS ? 1
                    : c == 1    ? 3
                                : 2,
                    dims, c == 2, numbers);
    }
}

static void put_matrix(hid_t file, layout how) {
    double numbers[ROWS * COLUMNS];
    for (size_t i = 0; i < ROWS * COLUMNS; i++)
        numbers[i] = how == MATLAB ? number_of(i % ROWS, i / ROWS) : number_of(i / COLUMNS, i % COLUMNS);
    const hsize_t dims[2] = {how == MATLAB ? COLUMNS : ROWS, how == MATLAB ? ROWS : COLUMNS};
    put_dataset(file, "c", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, dims, true, numbers);
    if (how != MATLAB) return;
    hid_t set = H5Dopen2(file, "c", H5P_DEFAULT), space = H5Screate(H5S_SCALAR);
    hid_t mark = H5Acreate2(set, "MATLAB_class", H5T_NATIVE_INT, space, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Aclose(mark) >= 0 && H5Sclose(space) >= 0 && H5Dclose(set) >= 0);
}

/* Records as pandas and PyTables write them: an index, the columns, and a text of fixed length. */
static void put_table(hid_t file) {
    struct record {
        double c1;
        int64_t c2;
        char word[6];
        double c0;
    } records[ROWS];
    for (size_t i = 0; i < ROWS; i++) {
        records[i] =
            (struct record){.c0 = number_of(i, 0), .c1 = number_of(i, 1), .c2 = (int64_t)number_of(i, 2)};
        (void)snprintf(records[i].word, sizeof records[i].word, "w%zu", i % 2);
    }
    hid_t type = H5Tcreate(H5T_COMPOUND, sizeof *records), word = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(word, 6) >= 0 &&
                H5Tinsert(type, "c1", HOFFSET(struct record, c1), H5T_NATIVE_DOUBLE) >= 0 &&
                H5Tinsert(type, "c2", HOFFSET(struct record, c2), H5T_NATIVE_INT64) >= 0 &&
                H5Tinsert(type, "word", HOFFSET(struct record, word), word) >= 0 &&
                H5Tinsert(type, "c0", HOFFSET(struct record, c0), H5T_NATIVE_DOUBLE) >= 0);
    put_dataset(file, "records", type, type, 1, (hsize_t[]){ROWS}, true, records);
    assert_true(H5Tclose(word) >= 0 && H5Tclose(type) >= 0);
}

static void write_hdf(const char *path, layout how) {
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    if (how == TABLE)
        put_table(file);
    else if (how == SETS || how == ROW_SETS)
        put_sets(file, how);
    else
        put_matrix(file, how);
    assert_true(H5Fclose(file) >= 0);
}

/* Writes file number `which` of all formats; false if there is no such file. */
static bool write_file(const char *path, size_t which) {
    if (which == 0)
        write_csv(path);
    else if (which <= 4)
        write_numpy(path, (which & 1) != 0, which > 2);
    else if (which < 5 + LAYOUTS)
        write_hdf(path, (layout)(which - 5));
    return which < 5 + LAYOUTS;
}

/* ---- reading ---- */

static lg_frame new_frame(const char *path, const lg_read_options *options, lg_frame_want *want,
                          size_t wants) {
    return (lg_frame){.path = path, .what = "table", .options = options, .want = want, .wants = wants};
}

/* Compares the columns c2 and c0, and c2 as a text. */
static void check_block(const lg_frame *f, const lg_frame_want *want, size_t before) {
    static size_t first; /* line of the first row */
    if (before == 0 && f->rows > 0) first = f->line[0];
    assert_true(f->width == 2 && f->texts == 1);
    for (size_t i = 0; i < f->rows; i++) {
        char shown[16];
        const double *row = f->value + i * f->width;
        assert_true(row[want[0].first] == number_of(before + i, 2) &&
                    row[want[2].first] == number_of(before + i, 0));
        (void)snprintf(shown, sizeof shown, "%g", number_of(before + i, 2));
        assert_string_equal(lg_frame_text_of(f, i, &want[1]), shown);
        assert_string_equal(lg_frame_text_of(f, i, &want[3]), "");
        assert_int_equal(f->line[i], first + before + i);
    }
}

#define X(name) &lg_frame_##name,
static const lg_frame_format *const formats[] = {LG_FRAME_FORMATS};
#undef X

TEST("columns are the same in every format, in blocks of any size") {
    static const size_t blocks[] = {1, 3, ROWS, SIZE_MAX};
    bool met[LG_COUNT(formats)] = {false};
    const lg_read_options here = without_probe();
    for (size_t which = 0; write_file(scratch_path("frame"), which); which++)
        for (size_t b = 0; b < LG_COUNT(blocks); b++) {
            lg_frame_want want[] = {{.name = "c2"},
                                    {.name = "c2", .as = LG_FRAME_TEXT},
                                    {.name = "c0"},
                                    {.name = "none", .as = LG_FRAME_TEXT, .optional = true}};
            lg_frame f = new_frame(scratch_path("frame"), &here, want, LG_COUNT(want));
            lg_error error = {LG_OK, ""};
            size_t read = 0;
            lg_status status;
            while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
            for (size_t i = 0; i < LG_COUNT(formats); i++) met[i] = met[i] || f.format == formats[i];
            do {
                if (status == LG_OK) status = lg_frame_next(&f, blocks[b], &error);
                if (status != LG_OK) fail_msg("file %zu: %s", which, error.message);
                assert_true(f.rows <= blocks[b]);
                check_block(&f, want, read);
                read += f.rows;
            } while (f.rows > 0);
            assert_int_equal(read, ROWS);
            assert_true(!want[3].there && want[0].there);
            lg_frame_close(&f);
        }
    for (size_t i = 0; i < LG_COUNT(formats); i++)
        if (!met[i])
            fail_msg("the format %s of LG_FRAME_FORMATS has no file here: let write_file write one",
                     formats[i]->name);
}

TEST("in a text file whose cells are separated by blanks, cells in quotes stay as they are") {
    static const char *const labels[] = {"", "d e", "a  b", " \"c\"\tx", ""};
    lg_frame_want want[] = {{.name = "x"}, {.name = "label", .as = LG_FRAME_TEXT}};
    lg_frame f = new_frame(scratch_path("frame"), NULL, want, LG_COUNT(want));
    lg_error error = {LG_OK, ""};
    lg_status status;
    write_text_to(f.path, "# x label\n0 nan\n1 \"d e\"\n 2\t\"a  b\" \n3  \" \"\"c\"\"\tx\"\n4 \"\"\n");
    while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
    assert_status(status, LG_OK);
    assert_ok(lg_frame_next(&f, SIZE_MAX, &error));
    assert_int_equal(f.rows, LG_COUNT(labels));
    for (size_t i = 0; i < f.rows; i++) {
        assert_true(f.value[i] == (double)i);
        assert_string_equal(lg_frame_text_of(&f, i, &want[1]), labels[i]);
    }
    lg_frame_close(&f);
}

TEST("missing numbers are NaN in every format") {
    const lg_read_options here = without_probe();
    for (size_t which = 0; write_file(scratch_path("frame"), which); which++) {
        lg_frame_want want[] = {{.name = "c0"}, {.name = "c1"}, {.name = "c2"}};
        lg_frame f = new_frame(scratch_path("frame"), &here, want, COLUMNS);
        lg_error error = {LG_OK, ""};
        lg_status status;
        while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
        assert_status(status, LG_OK);
        assert_ok(lg_frame_next(&f, SIZE_MAX, &error));
        assert_true(f.width == COLUMNS);
        for (size_t i = 0; i < ROWS * COLUMNS; i++) {
            const double expected = number_of(i / COLUMNS, i % COLUMNS);
            assert_true(isnan(expected) ? isnan(f.value[i]) : f.value[i] == expected);
        }
        lg_frame_close(&f);
    }
}

TEST("netCDF's fill values are missing numbers") {
    const lg_read_options here = without_probe();
    const hid_t stored[] = {H5T_STD_I32LE, H5T_STD_U64BE, H5T_STD_I64LE, H5T_IEEE_F32LE, H5T_IEEE_F64LE};
    const short numbers[] = {98, 97};
    const double fill = 98;
    const char *path = scratch_path("fill.nc");
    for (size_t i = 0; i < LG_COUNT(stored); i++) {
        lg_frame_want want[] = {{.name = "x"}};
        lg_frame f = new_frame(path, &here, want, 1);
        lg_error error = {LG_OK, ""};
        lg_status status;
        hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
        put_dataset(file, "x", stored[i], H5T_NATIVE_SHORT, 1, (hsize_t[]){2}, false, numbers);
        assert_true(H5Fclose(file) >= 0);
        replace_attribute(path, "x", i % 2 == 0 ? "_FillValue" : "missing_value", stored[i],
                          H5T_NATIVE_DOUBLE, &fill);
        while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
        assert_status(status, LG_OK);
        assert_ok(lg_frame_next(&f, SIZE_MAX, &error));
        assert_true(f.rows == 2 && isnan(f.value[0]) && f.value[1] == 97);
        lg_frame_close(&f);
    }
}

/* ---- data sets of HDF5 that do not fit ---- */

static void write_sets(const char *path) {
    double numbers[ROWS * 6];
    for (int i = 0; i < ROWS * 6; i++) numbers[i] = i;
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    put_dataset(file, "q", H5T_IEEE_F32LE, H5T_NATIVE_DOUBLE, 3, (hsize_t[]){ROWS, 2, 3}, true, numbers);
    put_dataset(file, "e", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, (hsize_t[]){ROWS}, false, numbers);
    put_dataset(file, "t", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, (hsize_t[]){ROWS + 1}, false, numbers);
    numbers[9] = INFINITY;
    put_dataset(file, "far", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, (hsize_t[]){ROWS, 6}, false, numbers);
    assert_true(H5Fclose(file) >= 0);
}

static bool damaged; /* the numbers of the file may be any */

static lg_status read_sets(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    lg_frame_want want[] = {{.name = "e"}, {.name = "far0"}};
    lg_frame f = new_frame(path, options, want, LG_COUNT(want));
    f.context = context;
    lg_status status = lg_frame_open(&f, error);
    do {
        if (status == LG_OK) status = lg_frame_next(&f, 4, error);
        for (size_t i = 0; i < f.rows && status == LG_OK && !damaged; i++) {
            const double row = (double)(f.line[i] - 1);
            assert_true(f.value[i * f.width + want[0].first] == row);
            assert_true(f.value[i * f.width + want[1].first] == 6 * row);
        }
    } while (status == LG_OK && f.rows > 0);
    lg_frame_close(&f);
    return status;
}

TEST("arrays of rank 3 are no columns; damaged files and failing calls of HDF5 are survived") {
    const char *path = fresh_copy("sets.h5", write_sets);
    const lg_read_options here = without_probe();
    assert_told(read_sets(NULL, path, &here, &told));
    lg_frame f = new_frame(path, &here, NULL, 0);
    assert_told(lg_frame_open(&f, &told));
    assert_int_equal(f.columns, 8); /* e, far0 to far5, t */
    lg_frame_close(&f);
    assert_true(fail_every_reading(read_sets, path) > 10);
    damaged = true;
    survive_changed_bytes(read_sets, path, 60);
    damaged = false;
}

TEST("columns that do not belong together are rejected with file, row and column") {
    static const struct {
        lg_frame_want want[2];
        const char *says;
    } rows[] = {
        {{{.name = "e"}, {.name = "t"}}, "sets.h5: /t: has 12 rows, but /e has 11"},
        {{{.name = "e"}, {.name = "x"}}, "there is no column 'x'; the columns are: e, far0, far1"},
        {{{.name = "e"}, {.name = "e"}}, "column 'e' is requested twice: name it once"},
        {{{.name = "e"}, {.name = "far3"}}, "row 2: column far3: the value is infinite"},
    };
    const char *path = fresh_copy("sets.h5", write_sets);
    const lg_read_options here = without_probe();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_frame_want want[] = {rows[i].want[0], rows[i].want[1]};
        lg_frame f = new_frame(path, &here, want, 2);
        lg_error error = {LG_OK, ""};
        lg_status status;
        while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
        if (status == LG_OK) status = lg_frame_next(&f, SIZE_MAX, &error);
        assert_true(status == LG_FORMAT || status == LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].says);
        lg_frame_close(&f);
    }
    lg_frame f = new_frame("", NULL, NULL, 0);
    assert_status(lg_frame_open(&f, NULL), LG_INVALID_ARGUMENT);
    lg_frame_close(&f);
}

/* ---- what is found in a bad file, and what to do ---- */

/* Numbers x, records with another x, and what is no column: a single number y0, an array of rank 3, lists, a
 * matrix of texts, a group, and links to another file and to nothing. */
static void write_misfits(const char *path) {
    const struct record { double x, y; } records[2] = {{1, 2}, {3, 4}};
    const double numbers[8] = {0, 1, 2, 3, 4, 5, 6, 7};
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    hid_t type = H5Tcreate(H5T_COMPOUND, sizeof *records);
    assert_true(H5Tinsert(type, "x", HOFFSET(struct record, x), H5T_NATIVE_DOUBLE) >= 0 &&
                H5Tinsert(type, "y", HOFFSET(struct record, y), H5T_NATIVE_DOUBLE) >= 0);
    put_dataset(file, "records", type, type, 1, (hsize_t[]){2}, false, records);
    put_dataset(file, "x", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, (hsize_t[]){2}, false, numbers);
    put_dataset(file, "y0", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 0, NULL, false, numbers);
    put_dataset(file, "cube", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, (hsize_t[]){2, 2, 2}, false, numbers);
    hid_t list = H5Tvlen_create(H5T_NATIVE_DOUBLE), word = H5Tcopy(H5T_C_S1);
    put_dataset(file, "list", list, list, 1, (hsize_t[]){2}, false, NULL);
    put_dataset(file, "words", word, word, 2, (hsize_t[]){2, 2}, false, "abcd");
    assert_true(H5Lcreate_external("other.h5", "/x", file, "far", H5P_DEFAULT, H5P_DEFAULT) >= 0 &&
                H5Lcreate_soft("/none", file, "lost", H5P_DEFAULT, H5P_DEFAULT) >= 0 &&
                H5Gclose(H5Gcreate2(file, "group", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)) >= 0);
    assert_true(H5Tclose(list) >= 0 && H5Tclose(word) >= 0);
    assert_true(H5Tclose(type) >= 0 && H5Fclose(file) >= 0);
}

/* Two whole numbers each, with an attribute of MATLAB or netCDF. `one` is a matrix of one column with a
 * name. */
static void write_marked(const char *path) {
    static const char *const rows[][3] = {{"chars", "MATLAB_class", "char"},
                                          {"empty", "MATLAB_empty", ""},
                                          {"packed", "scale_factor", ""},
                                          {"one", "columns", "force"},
                                          {"same", "MATLAB_class", "uint16"}};
    static const short numbers[2] = {97, 98};
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        put_dataset(file, rows[i][0], H5T_STD_U16LE, H5T_NATIVE_SHORT, i == 3 ? 2 : 1, (hsize_t[]){2, 1},
                    false, numbers);
    assert_true(H5Fclose(file) >= 0);
    for (size_t i = 0; i < LG_COUNT(rows); i++) replace_text(path, rows[i][0], rows[i][1], rows[i][2]);
}

static void write_bad(const char *path, const char *text, size_t bytes) {
    if (text == NULL && bytes > 0)
        write_marked(path);
    else if (text == NULL)
        write_misfits(path);
    else
        write_bytes_to(path, text, bytes);
}

#define BYTES(text) text, sizeof text - 1
#define NPY(descr)  BYTES("\x93NUMPY\1\0\x30\0{'descr': " descr ", 'fortran_order': False, 'shape': (2,)}\n")
#define NO_TEXT     "is not text: it has a zero byte, so it is no CSV in UTF-8, and it does not begin as HDF5"

TEST("a message about a bad file says what was found and what to do") {
    static const struct {
        const char *text; /* NULL: HDF5; then bytes = 1: write_marked */
        size_t bytes;
        const char *want, *says;
    } rows[] = {
        {NULL, 1, "chars",
         "the columns are: force, same; /chars is a char array of MATLAB: write numbers, or a list of texts"},
        {NULL, 1, "empty", "; /empty is empty"},
        {NULL, 1, "packed", "; /packed is packed (scale_factor, add_offset); write the values themselves"},
        {BYTES("t|x\n0|1\n"), "x",
         "the columns are: t|x; the first line must name the columns, separated by commas, semicolons or "
         "tabs"},
        {BYTES("n,t,x,y\n0,1,2,3\nx\",\"a,b,c,d\",y\"\n"), "y",
         "line 3: a cell has a quote inside: put the cell in quotes, and double this one"},
        {NPY("'<f2'"), "x",
         "values of type '<f2'; the types that can be read are f4, f8, i1 to i8, u1 to u8"},
        {NPY("'<f2'"), "x", "b1; convert with a.astype('f8')"},
        {NPY("'xf8'"), "x", "values of type 'xf8'; the types"},
        {BYTES("\x93NUMPY\1\0\x34\0{'descr': '<f8', 'fortran_order': 1, 'shape': (2,)}\n"), "x",
         "has no shape or no order in its header: save it again with numpy.save"},
        {NPY("'<M8[ns]'"), "x", "values of type '<M8[ns]'; the types"},
        {NPY("[('t', '<f8'), ('x', '<f8')]"), "x",
         "records of type [('t', '<f8'), ('x', '<f8')]; save their"},
        {NPY("[('t', '<f8'), ('x', '<f8')]"), "x", "as one array, numpy.column_stack("},
        {BYTES("t,x,x\n0,1,2\n"), "x", "line 1: there are two columns 'x': rename one of them"},
        {NULL, 0, "x", "there are two columns 'x': rename one of them"},
        {NULL, 0, "y0", "there is no column 'y0'; the columns are: x, y, x; /y0 is a single number"},
        {NULL, 0, "cube", "there is no column 'cube'; the columns are: x, y, x; /cube has 3 dimensions"},
        {NULL, 0, "z", "there is no column 'z'; the columns are: x, y, x"},
        {NULL, 0, "far", "are: x, y, x; /far is a broken or external link, or of a newer HDF5"},
        {NULL, 0, "list", "are: x, y, x; /list has neither a number nor a text in each row"},
        {NULL, 0, "words", "are: x, y, x; /words is a matrix, but not of numbers"},
        {NULL, 0, "group", "are: x, y, x; /group is a group"},
        {BYTES("# s,m\n# t,x\n0,1\n"), "x",
         "line 1: there is no column 'x'; the columns are: s, m; the line is a comment: remove it if it does "
         "not hold the names"},
        {BYTES("t,x\ns,m\n0,1\n"), "x",
         "line 2: column x: 'm' is not a number; leave cells without a value empty, and begin a line of "
         "units with #"},
        {BYTES("t,x\n0,1\ns,m\n"), "x", "line 3: column x: 'm' is not a number; leave cells without"},
        {BYTES("# t x\n0 1\nm 3\n4 m\n"), "x",
         "line 4: column x: 'm' is not a number; write nan in cells without a value"},
        {BYTES("# t x\n0 1\n2\n"), "x",
         "line 3: has 1 cells, the header has 2; write nan in cells without a value, and put"},
        {BYTES("t\0,\0x\0\n"), "x",
         NO_TEXT " or an array of numpy (.npy): save it as one of these"}, /* UTF-16 */
        {BYTES("PK\3\4\0"), "x", "is not text: it begins as a zip file; from .npz save one array as .npy"},
        {BYTES("t,x\r0,1\r2,3\r"), "x", "line 1: has lines that end with a carriage return alone (CR): let"},
        {BYTES("t,\"x\rm\"\n0,1\n"), "x", "there is no column 'x'"},
    };
    const lg_read_options here = without_probe();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = scratch_path("bad");
        lg_frame_want want = {.name = rows[i].want};
        lg_frame f = new_frame(path, &here, &want, 1);
        lg_error error = {LG_OK, ""};
        write_bad(path, rows[i].text, rows[i].bytes);
        lg_status status;
        while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
        if (status == LG_OK) status = lg_frame_next(&f, SIZE_MAX, &error);
        assert_int_equal(status, LG_FORMAT);
        assert_says(error.message, rows[i].says);
        lg_frame_close(&f);
    }
}

static void keep(void *user, lg_log_level level, const char *message) {
    lg_append(user, 1024, "%s%s\n", level == LG_LOG_WARNING ? "" : "note: ", message);
}

TEST("data sets that are no columns, and a last line that may be cut, are named in one warning") {
    static const char misfits[] =
        "left out of the columns: /cube has 3 dimensions, /far is a broken or "
        "external link, or of a newer HDF5, /list has neither a number nor a text in each "
        "row, /lost is a broken or external link, or of a newer HDF5, /words is a "
        "matrix, but not of numbers\n";
    static const struct {
        const char *text; /* NULL: HDF5 */
        size_t bytes;
        const char *want, *says; /* want NULL: only names are read */
    } rows[] = {
        {NULL, 0, NULL, misfits},
        {NULL, 1, "force", ""},
        {BYTES("t,x\n0,1\n#N/A,4\n# 2,3\n# a,b\n# 2\n3,6\n"), "x",
         "warned: 2 lines with as many cells as a row were left out as comments, the first is line 3: if "
         "they "
         "are rows, put their first cell in quotes\n"},
        {BYTES("t,x\n0,1\n\"#N/A\",4\n"), "x", ""},
        {NULL, 0, "y", ""},
        {BYTES("t,x\n0,1\n1,2"), "x",
         "the last line (3) has no line end; if the file was cut, its last value may be wrong\n"},
        {BYTES("# t,x\n1,2"), "x", "the last line (2) has no line end"},
        {BYTES("t,x\n0,1\n1,2"), "t", ""}, /* the cell is whole */
        {BYTES("t,x\n0,1\n1,2"), NULL, ""},
        {BYTES("t,x\n0,1\n1,2\n"), "x", ""},
        {BYTES("t,x\r\n0,1\r\n1,2\r"), "x", ""},
        {BYTES("0,1\n2,3\n"), "1",
         "warned: line 1: 0, 1, ... were taken as names of columns: if the line is a row, write names above "
         "it, otherwise put each of them in quotes\n"},
        {BYTES("0\n2\n"), "0", "line 1: 0, 1, ... were taken as names of columns"},
        {BYTES("0,1\n2,3\n"), NULL, ""},
        {BYTES("\"0\",\"1\"\n2,3\n"), "1", ""},
        {BYTES("# t,x\n0,1\n2,3\n"), "x", ""},
    };
    char said[1024];
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.log = keep, options.log_user = said;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    const lg_read_options here = without_probe();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = scratch_path("warned");
        lg_frame_want want = {.name = rows[i].want};
        lg_frame f = new_frame(path, &here, &want, rows[i].want != NULL);
        f.context = context;
        write_bad(path, rows[i].text, rows[i].bytes);
        lg_status status;
        do {
            lg_frame_close(&f);
            said[0] = '\0';
            status = lg_frame_open(&f, NULL);
            if (status == LG_OK && rows[i].want != NULL) status = lg_frame_next(&f, SIZE_MAX, NULL);
        } while (lg_test_again(status));
        assert_status(status, LG_OK);
        const char *end = strchr(said, '\n');
        if (!lg_test_faulty()) assert_says(said, rows[i].says);
        if (!lg_test_faulty()) assert_true(*rows[i].says == '\0' ? end == NULL : end[1] == '\0');
        lg_frame_close(&f);
    }
}

/* ---- times ---- */

/* Reads the column t in blocks of two rows; returns the times as "0 0.25 ..." or the message. */
static const char *times_of(const char *path) {
    static char all[1000];
    const lg_read_options here = without_probe();
    lg_frame_want want = {.name = "t", .as = LG_FRAME_TIME};
    lg_frame f = new_frame(path, &here, &want, 1);
    lg_error error = {LG_OK, ""};
    lg_status status;
    all[0] = '\0';
    while (lg_test_again(status = lg_frame_open(&f, &error))) lg_frame_close(&f);
    do {
        if (status == LG_OK) status = lg_frame_next(&f, 2, &error);
        for (size_t i = 0; i < f.rows && status == LG_OK; i++)
            lg_append(all, sizeof all, "%s%.15g", *all != '\0' ? " " : "", f.value[i]);
    } while (status == LG_OK && f.rows > 0);
    lg_frame_close(&f);
    if (lg_test_again(status)) return times_of(path);
    if (status != LG_OK) (void)snprintf(all, sizeof all, "%s", error.message);
    return all;
}

#define NO_TIME "is not a number of seconds, a date such as 2024-03-01T12:00:00.25Z or a time of day"

TEST("dates and times of day are seconds since the first one, exact to nanoseconds") {
    static const struct {
        const char *cells, *times;
    } rows[] = {
        {"5\n5.25\n1709294400000000001\n", "5 5.25 1.7092944e+18"},
        {"2024-03-01T12:00:00.250Z\n2024-03-01T12:00:00.250000001Z\n2024-03-01T12:00:01Z\n", "0 1e-09 0.75"},
        {"2024-02-28 23:59:59.999\nnan\n2024-02-29 00:00:00\n2024-03-01 0:00:00\n", "0 nan 0.001 86400.001"},
        {"2023-02-28T00:00:00\n2023-03-01T00:00:00\n1900-01-01T00:00:00\n2100-03-01T00:00:00\n",
         "0 86400 -3886531200 2430000000"},
        {"2000-01-01T00:00:00\n1900-03-01T00:00:00\n2000-03-01T00:00:00\n", "0 -3150576000 5184000"},
        {"2024-03-31T01:59:59+01:00\n2024-03-31T03:00:00+0200\n2024-03-31T01:00:02Z\n"
         "2024-03-30T20:30:03.5-04:30\n2024-03-31T01:00:04+00\n",
         "0 1 3 4.5 5"},
        {"nan\n9:00:00\n09:00:00.125000000999\n9:59:59\n", "nan 0 0.125 3599"},
        {"23:59:59.5\n00:00:00.5\n12:00:00\n23:00:00\n01:00:00\n", "0 1 43200.5 82800.5 90000.5"},
        {"12:00:00\n11:59:59\n12:00:01\n", "0 -1 1"}, /* no midnight: the clock was set back */
        {"14:00:00\n00:00:00\n14:00:01\n", "0 36000 1"},
        {"2024-03-01T12:00:00Z\n2024-03-01T12:00:01\n",
         "line 3: column t: '2024-03-01T12:00:01' is a date without an offset, but line 2 has a date with an "
         "offset: write all times in one format"},
        {"\n0.5\n12:00:00\n",
         "line 4: column t: '12:00:00' is a time of day, but line 3 has a number of seconds"},
        {"12:00:00\n0.5\n", "line 3: column t: '0.5' is a number of seconds, but line 2 has a time of day"},
        {"1e999\n", "line 2: column t: '1e999' is not a finite number"},
        {"one\n", "'one' " NO_TIME "; leave cells without a value empty"},
        {"12:00:00,5\n", "has 2 cells"},
        {"24:00:00\n", "'24:00:00' " NO_TIME},
        {"12:60:00\n", NO_TIME},
        {"12:00:60\n", NO_TIME},
        {"12:00\n", NO_TIME},
        {"-12:00:00\n", NO_TIME},
        {"12:00:00h\n", NO_TIME},
        {"2024-03-01\n", NO_TIME},
        {"2024-03-01T\n", NO_TIME},
        {"2024-03-01_12:00:00\n", NO_TIME},
        {"2024-00-01T12:00:00\n", NO_TIME},
        {"2024-13-01T12:00:00\n", NO_TIME},
        {"2024-04-00T12:00:00\n", NO_TIME},
        {"2024-04-31T12:00:00\n", NO_TIME},
        {"2023-02-29T12:00:00\n", NO_TIME},
        {"2100-02-29T12:00:00\n", NO_TIME},
        {"1899-12-31T12:00:00\n", NO_TIME},
        {"2190-01-01T12:00:00\n", NO_TIME},
        {"2024-03-01T12:00:00+24:00\n", NO_TIME},
        {"2024-03-01T12:00:00+01:60\n", NO_TIME},
        {"2024-03-01T12:00:00+1\n", NO_TIME},
        {"2024-03-01T12:00:00+01:\n", NO_TIME},
        {"2024-03-01T12:00:00+01:0\n", NO_TIME},
        {"2024-03-01T12:00:00ZZ\n", NO_TIME},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        write_text_to(scratch_path("times.csv"), test_text("t\n%s", rows[i].cells));
        assert_says(times_of(scratch_path("times.csv")), rows[i].times);
    }
}

TEST("times that are texts in HDF5 are read as those of CSV, other columns must be numbers") {
    static const char *const texts[] = {"2024-03-01T12:00:00Z", "2024-03-01T12:00:00.5Z", "12:00:00"};
    for (int good = 0; good < 2; good++) {
        char words[3][24] = {""};
        for (int i = 0; i < 3; i++)
            (void)snprintf(words[i], sizeof *words, "%s", texts[good && i == 2 ? 0 : i]);
        hid_t file = H5Fcreate(scratch_path("times.h5"), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
        hid_t type = H5Tcopy(H5T_C_S1);
        assert_true(H5Tset_size(type, sizeof *words) >= 0);
        put_dataset(file, "t", type, type, 1, (hsize_t[]){3}, false, words);
        assert_true(H5Tclose(type) >= 0 && H5Fclose(file) >= 0);
        assert_says(times_of(scratch_path("times.h5")),
                    good ? "0 0.5 0"
                         : "row 3: column t: '12:00:00' is a time of day, but row 1 has a date with");
    }
}

TEST(
    "a table that is continued has its columns in order, whole lines, and no others; cells stay as written") {
    static const struct {
        const char *text, *says; /* NULL: it is read */
        size_t rows;
    } files[] = {
        {"# note\na,b\nnan,1\n,2\n", NULL, 2},
        {"a\nnan\n\n\n", NULL, 1},
        {"a,b\nnan,1\nx,22", NULL, 1},
        {"b,a\n1,nan\n", "line 1: this is not the table: column 1 is 'b', expected: a; write to another file",
         0},
        {"a,b,c\n1,2,3\n", "line 1: this is not the table: column 3 is 'c', expected: no further column", 0},
        {"a,b\n\nx,1\n", "line 2: is blank or a comment", 0},
        {"a,b\nx,1\n#\ny,2\n", "line 3: is blank or a comment", 0}};
    const char *path = scratch_path("ours.csv");
    for (size_t i = 0; i < LG_COUNT(files); i++) {
        lg_frame_want want[] = {{.name = "a", .as = LG_FRAME_CELL},
                                {.name = "b", .as = LG_FRAME_CELL, .optional = true}};
        lg_frame f = new_frame(path, NULL, want, LG_COUNT(want));
        lg_error error = {LG_OK, ""};
        f.ours = true;
        write_text_to(path, files[i].text);
        lg_status status = lg_frame_open(&f, &error);
        if (status == LG_OK) status = lg_frame_next(&f, SIZE_MAX, &error);
        assert_status(status, files[i].says == NULL ? LG_OK : LG_FORMAT);
        if (files[i].says != NULL) assert_says(error.message, files[i].says);
        if (status == LG_OK) assert_int_equal(f.rows, files[i].rows);
        if (status == LG_OK) assert_string_equal(lg_frame_text_of(&f, 0, &want[0]), "nan");
        if (f.rows == 2) assert_string_equal(lg_frame_text_of(&f, 1, &want[0]), "");
        lg_frame_close(&f);
    }
}
