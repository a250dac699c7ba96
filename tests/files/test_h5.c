/* Files in HDF5: what archives write and read, and what readers accept and refuse in files of other
 * programs. */
#include "support/io_test.h"

#include "files/h5_internal.h"

RELEASES(release_h5, lg_h5_close)
RELEASES(release_writer, lg_file_writer_destroy)
RELEASES(release_reader, lg_file_reader_destroy)

static const lg_element elements[] = {LG_ELEMENT_F64, LG_ELEMENT_F32, LG_ELEMENT_I64,
                                      LG_ELEMENT_U64, LG_ELEMENT_U32, LG_ELEMENT_U8};
static const uint64_t some[4] = {2, 1, 3, 1}, none[4] = {2, 0, 3, 1};

static lg_h5 *open_h5(const char *path) {
    const lg_read_options here = without_probe();
    lg_h5 *h5;
    assert_told(lg_h5_open(NULL, path, &here, &h5, &told));
    lg_test_owns(h5, release_h5);
    return h5;
}

static lg_file_writer *new_writer(const char *path, const char *prefix, lg_archive_writer *archive) {
    lg_file_writer *writer;
    assert_told(lg_file_writer_create(NULL, path, "test", NULL, &writer, &told));
    lg_test_owns(writer, release_writer);
    assert_ok(lg_file_writer_archive(writer, prefix, archive));
    return writer;
}

static lg_file_reader *new_reader(const char *path, const char *prefix, lg_archive_reader *archive) {
    const lg_read_options here = without_probe();
    lg_file_reader *reader;
    assert_told(lg_file_reader_create(NULL, path, "test", &here, &reader, &told));
    lg_test_owns(reader, release_reader);
    assert_ok(lg_file_reader_archive(reader, prefix, archive));
    return reader;
}

/* ---- archives ---- */

TEST("an archive gives back arrays of every type and rank, with and without numbers") {
    const char *path = scratch_path("arrays.h5");
    lg_archive_writer to;
    lg_archive_reader from;
    unsigned char data[48], got[48];
    for (size_t i = 0; i < sizeof data; i++) data[i] = (unsigned char)(i + 1);
    lg_file_writer *writer = new_writer(path, "part", &to);
    for (uint32_t i = 0; i < LG_COUNT(elements); i++)
        for (uint32_t rank = 0; rank <= 4; rank++) {
            assert_ok(to.array(to.user, test_text("some/%u/%u", i, rank), elements[i], rank, some, data));
            assert_ok(to.array(to.user, test_text("none/%u/%u", i, rank), elements[i], rank, none, data));
        }
    assert_ok(lg_file_writer_commit(writer, NULL));
    (void)new_reader(path, "part", &from);
    for (uint32_t i = 0; i < LG_COUNT(elements); i++)
        for (uint32_t rank = 0; rank <= 4; rank++) {
            const char *name = test_text("some/%u/%u", i, rank);
            const size_t bytes = (rank < 1 ? 1 : rank < 3 ? 2 : 6) * lg_element_size(elements[i]);
            uint64_t dims[4] = {9, 9, 9, 9};
            uint32_t have = 9;
            memset(got, 0, sizeof got);
            assert_ok(from.array(from.user, name, elements[i], rank, some, got));
            assert_memory_equal(got, data, bytes);
            assert_ok(from.shape(from.user, name, &have, dims));
            assert_int_equal(have, rank);
            assert_memory_equal(dims, some, rank * sizeof *dims);
            name = test_text("none/%u/%u", i, rank);
            assert_ok(from.array(from.user, name, elements[i], rank, none, got));
        }
    assert_ok(lg_h5_read_all(open_h5(path), NULL));
}

TEST("an archive refuses names and prefixes that are missing, empty or too long, and keeps the first "
     "refusal") {
    char prefix[LG_H5_PREFIX + 1], name[300], text[8] = "unread";
    const char *path = scratch_path("names.h5"), *names[] = {NULL, "", name};
    uint32_t rank = 9;
    uint64_t dims[4] = {9};
    const double x = 1;
    double got = 2;
    lg_archive_writer to;
    lg_archive_reader from;
    lg_error error = {LG_OK, ""};
    memset(prefix, 'p', sizeof prefix), prefix[LG_H5_PREFIX] = '\0';
    memset(name, 'n', sizeof name), name[299] = '\0';
    assert_status(lg_file_writer_create(NULL, NULL, "test", NULL, &(lg_file_writer *){NULL}, &error),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_create(NULL, "", "test", NULL, &(lg_file_writer *){NULL}, &error),
                  LG_INVALID_ARGUMENT);
    lg_file_writer *writer = new_writer(path, "", &to);
    lg_file_reader *reader = NULL;
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        lg_file_writer *bad = new_writer(path, i == 2 ? "p" : "", &to);
        const lg_status status = i == 1 ? to.text(to.user, names[i], "x")
                                        : to.array(to.user, names[i], LG_ELEMENT_F64, 0, NULL, &x);
        assert_int_equal(status, LG_INVALID_ARGUMENT);
        assert_status(to.array(to.user, "x", LG_ELEMENT_F64, 0, NULL, &x), LG_INVALID_ARGUMENT);
        assert_status(to.text(to.user, "x", "x"), LG_INVALID_ARGUMENT);
        assert_status(lg_file_writer_commit(bad, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "a path is empty or too long");
    }
    lg_file_writer *bad = new_writer(path, "", &to);
    assert_status(to.text(to.user, "x", NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_commit(bad, NULL), LG_INVALID_ARGUMENT);
    assert_int_equal(access(path, F_OK), -1);
    assert_ok(lg_file_writer_archive(writer, "", &to));
    assert_ok(to.array(to.user, "x", LG_ELEMENT_F64, 0, NULL, &x));
    assert_ok(lg_file_writer_commit(writer, NULL));
    assert_status(lg_file_writer_commit(writer, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_commit(NULL, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "committed before, or the writer is NULL");
    reader = new_reader(path, "", &from);
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        assert_status(from.array(from.user, names[i], LG_ELEMENT_F64, 0, NULL, &got), LG_INVALID_ARGUMENT);
        assert_status(from.shape(from.user, names[i], &rank, dims), LG_INVALID_ARGUMENT);
        assert_status(from.text(from.user, names[i], text, sizeof text), LG_INVALID_ARGUMENT);
        assert_says(lg_file_reader_message(reader), "a path is empty or too long");
    }
    assert_true(got == 2 && rank == 9 && dims[0] == 9 && strcmp(text, "unread") == 0);
    for (size_t i = 0; i < 2; i++) {
        const char *wrong = i == 0 ? NULL : prefix;
        assert_status(lg_file_writer_archive(writer, wrong, &to), LG_INVALID_ARGUMENT);
        assert_status(lg_file_reader_archive(reader, wrong, &from), LG_INVALID_ARGUMENT);
    }
    assert_status(lg_file_writer_archive(NULL, "", &to), LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_archive(writer, "", NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_file_reader_archive(NULL, "", &from), LG_INVALID_ARGUMENT);
    assert_status(lg_file_reader_archive(reader, "", NULL), LG_INVALID_ARGUMENT);
    lg_file_writer_destroy(NULL);
    lg_file_reader_destroy(NULL);
}

TEST("files that are written or changed at the same time do not mix") {
    const char *paths[2] = {scratch_path("one.h5"), scratch_path("two.h5")};
    lg_file_writer *writers[2];
    lg_archive_writer to[2];
    lg_h5 *h5[2];
    for (size_t i = 0; i < 2; i++) writers[i] = new_writer(paths[i], "", &to[i]);
    for (size_t i = 0; i < 2; i++)
        assert_ok(to[i].array(to[i].user, "x", LG_ELEMENT_F64, 0, NULL, &(double){(double)i}));
    for (size_t i = 0; i < 2; i++) assert_told(lg_file_writer_commit(writers[i], &told));
    for (size_t i = 0; i < 2; i++) {
        assert_told(lg_h5_edit(NULL, paths[i], &h5[i], &told));
        lg_test_owns(h5[i], release_h5);
    }
    for (size_t i = 0; i < 2; i++) {
        double x = 9;
        assert_told(lg_h5_put_number(h5[i], "", "n", LG_ELEMENT_F64, &(double){(double)i}, &told));
        assert_told(lg_h5_get(h5[i], "x", LG_ELEMENT_F64, 0, NULL, &x, &told));
        assert_true(x == (double)i);
    }
    for (size_t i = 0; i < 2; i++) assert_told(lg_h5_commit(h5[i], &told));
    for (size_t i = 0; i < 2; i++) {
        double n = 9;
        assert_told(lg_h5_number(open_h5(paths[i]), "", "n", LG_ELEMENT_F64, &n, &told));
        assert_true(n == (double)i);
    }
}

/* ---- texts and attributes ---- */

static lg_status count_text(void *user, uint64_t index, const char *text, lg_error *error) {
    size_t *count = user;
    if (strcmp(text, index == 0 ? "first" : index == 1 ? "" : "third") != 0)
        return lg_fail(error, LG_FORMAT, "another text");
    ++*count;
    return LG_OK;
}

static const lg_provenance origin = {.command = "made by a test", .cpu = "none", .seed = 7, .has_seed = true};
static const char three[3][8] = {"first", "", "third"};
static const double half = 0.5;

static void put_all(lg_h5 *h5) {
    const int64_t below = -3;
    const uint64_t most = UINT64_MAX;
    const uint32_t word = 4000000000u;
    const float fraction = 0.25f;
    char long_text[5000];
    memset(long_text, 'x', sizeof long_text - 1), long_text[sizeof long_text - 1] = '\0';
    assert_told(lg_h5_put_header(h5, "test", &origin, &told));
    assert_told(lg_h5_put(h5, "set", LG_ELEMENT_F64, 0, NULL, &half, &told));
    assert_told(lg_h5_put_texts(h5, "texts", three[0], sizeof three[0], 3, &told));
    assert_told(lg_h5_put_text_list(h5, "set", "list", three[0], sizeof three[0], 3, &told));
    assert_told(lg_h5_put_text(h5, "made/group", "long", long_text, &told));
    assert_told(lg_h5_put_text(h5, "set", "empty", "", &told));
    assert_told(lg_h5_put_number(h5, "set", "f64", LG_ELEMENT_F64, &half, &told));
    assert_told(lg_h5_put_number(h5, "set", "f32", LG_ELEMENT_F32, &fraction, &told));
    assert_told(lg_h5_put_number(h5, "", "i64", LG_ELEMENT_I64, &below, &told));
    assert_told(lg_h5_put_number(h5, "set", "u64", LG_ELEMENT_U64, &most, &told));
    assert_told(lg_h5_put_number(h5, "set", "u32", LG_ELEMENT_U32, &word, &told));
    assert_told(lg_h5_put_number(h5, "set", "old", LG_ELEMENT_U32, &word, &told));
}

TEST("texts, numbers and provenance are read back, after a change of the file too") {
    const char *path = scratch_path("texts.h5");
    lg_h5 *h5;
    char text[LG_H5_TEXT];
    double f64 = 0;
    float f32 = 0;
    int64_t i64 = 0;
    uint64_t u64 = 0;
    uint32_t u32 = 0;
    size_t count = 0;
    bool words = false;
    lg_provenance got;
    assert_told(lg_h5_create(NULL, path, &h5, &told));
    lg_test_owns(h5, release_h5);
    put_all(h5);
    assert_told(lg_h5_commit(h5, &told));
    assert_told(lg_h5_edit(NULL, path, &h5, &told));
    lg_test_owns(h5, release_h5);
    assert_told(lg_h5_remove_attribute(h5, "set", "old", &told));
    assert_told(lg_h5_remove_attribute(h5, "set", "old", &told));
    assert_told(lg_h5_remove_attribute(h5, "", "i64", &told));
    assert_told(lg_h5_put_number(h5, "", "i64", LG_ELEMENT_I64, &(int64_t){-4}, &told));
    assert_told(lg_h5_commit(h5, &told));
    h5 = open_h5(path);
    assert_told(lg_h5_check_format(h5, "test", false, &told));
    assert_true(lg_h5_has(h5, "") && lg_h5_has(h5, "made/group"));
    if (!lg_test_faulty()) { /* if HDF5 cannot tell, the answer is yes */
        assert_true(!lg_h5_has(h5, "made/other") && !lg_h5_has(h5, "other/group"));
        assert_true(!lg_h5_has_attribute(h5, "set", "old") && !lg_h5_has_attribute(h5, "other", "x"));
    }
    assert_told(lg_h5_each_text(h5, "texts", count_text, &count, &told));
    assert_told(lg_h5_each_name(h5, "set", "list", NULL, &words, count_text, &count, &told));
    assert_true(count == 6 && words);
    assert_told(lg_h5_each_name(h5, "set", "f64", NULL, &words, count_text, &count, &told));
    assert_false(words);
    assert_told(lg_h5_text(h5, "made/group", "long", text, sizeof text, &told));
    assert_int_equal(strspn(text, "x"), LG_H5_TEXT - 1);
    assert_told(lg_h5_text(h5, "set", "empty", text, sizeof text, &told));
    assert_string_equal(text, "");
    assert_told(lg_h5_number(h5, "set", "f64", LG_ELEMENT_F64, &f64, &told));
    assert_told(lg_h5_number(h5, "set", "f32", LG_ELEMENT_F32, &f32, &told));
    assert_told(lg_h5_number(h5, "", "i64", LG_ELEMENT_I64, &i64, &told));
    assert_told(lg_h5_number(h5, "set", "u32", LG_ELEMENT_U32, &u32, &told));
    assert_true(f64 == 0.5 && f32 == 0.25f && i64 == -4 && u32 == 4000000000u);
    assert_told(lg_h5_number(h5, "set", "u64", LG_ELEMENT_U64, &u64, &told));
    assert_true(u64 == UINT64_MAX);
    lg_h5_provenance(h5, &got);
    assert_string_equal(got.command, origin.command);
    assert_string_equal(got.cpu, origin.cpu);
    assert_true(got.has_seed && got.seed == 7);
    assert_told(lg_h5_read_all(h5, &told));
}

static void read_deep(void *path) {
    lg_h5 *h5;
    lg_error error = {LG_OK, ""};
    if (lg_h5_open(NULL, path, NULL, &h5, NULL) != LG_OK) _exit(1);
    _exit(lg_h5_read_all(h5, &error) == LG_FORMAT && strstr(error.message, "nested too deep") != NULL ? 0
                                                                                                      : 2);
}

TEST("groups may be nested 32 deep, and a file with many more is refused at once") {
    enum { LEVELS = 1500 };
    const char *path = scratch_path("deep.h5");
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), at[LEVELS + 1] = {file};
    for (int i = 0; i < LEVELS; i++)
        at[i + 1] = H5Gcreate2(at[i], "g", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    for (int i = LEVELS; i > 0; i--) assert_true(H5Gclose(at[i]) >= 0);
    assert_true(H5Fclose(file) >= 0);
    assert_cheap(read_deep, (void *)(uintptr_t)path);
    for (int slashes = LG_H5_DEPTH; slashes <= LG_H5_DEPTH + 1; slashes++) {
        lg_file_writer *writer;
        lg_archive_writer to;
        const uint64_t one = 1;
        char name[2 * LG_H5_DEPTH + 8] = "g";
        for (int i = 0; i < slashes; i++) (void)strcat(name, "/g");
        assert_ok(lg_file_writer_create(NULL, path, "deep", NULL, &writer, NULL));
        assert_ok(lg_file_writer_archive(writer, "", &to));
        const lg_status status = to.array(to.user, name, LG_ELEMENT_F64, 1, &one, &half);
        assert_int_equal(status, slashes > LG_H5_DEPTH ? LG_INVALID_ARGUMENT : LG_OK);
        if (status == LG_OK) assert_ok(lg_file_writer_commit(writer, NULL));
        lg_file_writer_destroy(writer);
        lg_file_reader *reader;
        assert_ok(lg_file_reader_create(NULL, path, "deep", NULL, &reader, NULL));
        lg_file_reader_destroy(reader);
    }
}

TEST("a data set without a name or of too high a rank is not written") {
    const uint64_t dims[5] = {1, 1, 1, 1, 1};
    lg_error error = {LG_OK, ""};
    lg_h5 *h5;
    assert_ok(lg_h5_create(NULL, scratch_path("refused.h5"), &h5, NULL));
    lg_test_owns(h5, release_h5);
    const struct {
        const char *name;
        lg_element type;
        uint32_t rank;
    } rows[] = {{NULL, LG_ELEMENT_F64, 0}, {"", LG_ELEMENT_F64, 0}, {"x", LG_ELEMENT_F64, 5}, {"x", 99, 0}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        error.message[0] = '\0';
        assert_status(lg_h5_put(h5, rows[i].name, rows[i].type, rows[i].rank, dims, &half, &error),
                      LG_INVALID_ARGUMENT);
        assert_says(error.message, "needs a name, a type and rank <= 4");
    }
    assert_ok(lg_h5_put(h5, "x", LG_ELEMENT_F64, 0, NULL, &half, NULL));
    assert_status(lg_h5_put(h5, "x", LG_ELEMENT_F64, 0, NULL, &half, &error), LG_OUT_OF_MEMORY);
    assert_status(lg_h5_put(h5, "x", LG_ELEMENT_F64, 1, &(uint64_t){0}, NULL, &error), LG_OUT_OF_MEMORY);
    assert_says(error.message, "/x could not be stored in memory");
    assert_ok(lg_h5_put_number(h5, "x", "n", LG_ELEMENT_F64, &half, NULL));
    assert_status(lg_h5_put_number(h5, "x", "n", LG_ELEMENT_F64, &half, &error), LG_OUT_OF_MEMORY);
    assert_says(error.message, "/x attribute n could not be stored in memory");
    assert_status(lg_h5_put_texts(h5, "x", "ab", 3, 1, &error), LG_OUT_OF_MEMORY);
    assert_says(error.message, "/x could not be stored in memory");
    assert_false(lg_h5_has(h5, test_text("%0600d", 0)));
}

/* ---- files of other programs ---- */

/* A type of a text. size 0: variable length. */
static hid_t words_of(size_t size, H5T_str_t padding) {
    hid_t type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, size > 0 ? size : H5T_VARIABLE) >= 0 && H5Tset_strpad(type, padding) >= 0);
    return type;
}

/* Numbers of two bytes, as numpy's float16. */
static hid_t half_type(void) {
    hid_t type = H5Tcopy(H5T_IEEE_F32LE);
    assert_true(H5Tset_fields(type, 15, 10, 5, 0, 10) >= 0 && H5Tset_size(type, 2) >= 0 &&
                H5Tset_ebias(type, 15) >= 0);
    return type;
}

static void put_foreign(hid_t file, const char *name, hid_t stored, hid_t memory, hid_t space, hid_t plist,
                        const void *data) {
    hid_t set = H5Dcreate2(file, name, stored, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0 &&
                (data == NULL || H5Dwrite(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0));
    assert_true(H5Dclose(set) >= 0);
}

static void put_foreign_attribute(hid_t file, const char *name, hid_t type, hid_t space, const void *data) {
    hid_t at = H5Acreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(at >= 0 && (data == NULL || H5Awrite(at, type, data) >= 0) && H5Aclose(at) >= 0);
}

enum { WORDS_OF_LIST = 5000, VAST = 5000000 }; /* more than are read at once */

static void write_foreign(const char *path) {
    static char big[70000], block[8192];
    const hsize_t bytes[1] = {sizeof block}, two[1] = {2}, pair[2] = {1, 2}, four[2] = {2, 2},
                  cube[5] = {1, 1, 1, 1, 1};
    const double numbers[2] = {1.5, 1e300};
    const uint64_t large[2] = {1, UINT64_MAX};
    const int64_t signs[2] = {-1, 1};
    const char *texts[2] = {NULL, big};
    memset(big, 'b', sizeof big - 1);
    const hsize_t no_rows[1] = {0}, vast[2] = {2, VAST};
    const char *words[WORDS_OF_LIST];
    for (size_t i = 0; i < WORDS_OF_LIST; i++) words[i] = i % 2 == 0 ? "even" : "odd";
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    hid_t one = H5Screate(H5S_SCALAR), list = H5Screate_simple(1, two, NULL), null = H5Screate(H5S_NULL),
          row = H5Screate_simple(2, pair, NULL), square = H5Screate_simple(2, four, NULL),
          deep = H5Screate_simple(5, cube, NULL);
    hid_t compact = H5Pcreate(H5P_DATASET_CREATE), elsewhere = H5Pcreate(H5P_DATASET_CREATE);
    hid_t variable = words_of(0, H5T_STR_NULLTERM), blanks = words_of(6, H5T_STR_SPACEPAD),
          wide = words_of(sizeof big, H5T_STR_NULLTERM), broad = words_of(LG_H5_TEXT + 1, H5T_STR_NULLTERM),
          f16 = half_type(), many = H5Tvlen_create(H5T_NATIVE_DOUBLE), both = H5Tcreate(H5T_COMPOUND, 8),
          block_type = H5Tarray_create2(H5T_NATIVE_CHAR, 1, bytes);
    assert_true(H5Tinsert(both, "x", 0, H5T_NATIVE_DOUBLE) >= 0);
    assert_true(H5Pset_layout(compact, H5D_COMPACT) >= 0);
    assert_true(H5Pset_external(elsewhere, "no-such-file", 0, 16) >= 0);
    put_foreign(file, "compact", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, list, compact, numbers);
    put_foreign(file, "elsewhere", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, list, elsewhere, NULL);
    /* The parts of a virtual data set lie in another file; a chunked one of any extent takes no room. */
    const hsize_t immense[2] = {(hsize_t)1 << 60, 1}, chunk[2] = {1, 1};
    hid_t plane = H5Screate_simple(2, immense, NULL), parts = H5Pcreate(H5P_DATASET_CREATE),
          chunks = H5Pcreate(H5P_DATASET_CREATE);
    assert_true(H5Pset_virtual(parts, list, "no-such-file", "x", list) >= 0);
    assert_true(H5Pset_chunk(chunks, 2, chunk) >= 0);
    put_foreign(file, "virtual", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, list, parts, NULL);
    put_foreign(file, "immense", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, plane, chunks, NULL);
    put_foreign(file, "half", f16, H5T_NATIVE_DOUBLE, one, H5P_DEFAULT, numbers);
    put_foreign(file, "large", H5T_STD_U64LE, H5T_NATIVE_UINT64, list, H5P_DEFAULT, large);
    put_foreign(file, "signs", H5T_STD_I64BE, H5T_NATIVE_INT64, list, H5P_DEFAULT, signs);
    put_foreign(file, "null", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, null, H5P_DEFAULT, NULL);
    for (int i = 0; i < 2; i++) {
        const char *name = i == 0 ? "scaled" : "offset";
        put_foreign(file, name, H5T_STD_I64BE, H5T_NATIVE_INT64, list, H5P_DEFAULT, signs);
        hid_t set = H5Dopen2(file, name, H5P_DEFAULT);
        put_foreign_attribute(set, i == 0 ? "scale_factor" : "add_offset", H5T_NATIVE_DOUBLE, one, numbers);
        assert_true(H5Dclose(set) >= 0);
    }
    for (int i = 0; i < 2; i++) {
        const char *name = i == 0 ? "filled" : "missing";
        put_foreign(file, name, H5T_STD_I64BE, H5T_NATIVE_INT64, list, H5P_DEFAULT, signs);
        hid_t set = H5Dopen2(file, name, H5P_DEFAULT);
        put_foreign_attribute(set, i == 0 ? "_FillValue" : "missing_value", H5T_NATIVE_INT64,
                              i == 0 ? one : list, signs);
        assert_true(H5Dclose(set) >= 0);
    }
    put_foreign(file, "deep", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, deep, H5P_DEFAULT, numbers);
    put_foreign(file, "both", both, both, list, H5P_DEFAULT, numbers);
    put_foreign(file, "long", variable, variable, list, H5P_DEFAULT, texts);
    put_foreign(file, "blanks", blanks, blanks, one, H5P_DEFAULT, "      ");
    put_foreign(file, "wide", wide, wide, one, H5P_DEFAULT, big);
    put_foreign(file, "row", blanks, blanks, row, H5P_DEFAULT, "word1 word2 ");
    put_foreign(file, "square", blanks, blanks, square, H5P_DEFAULT, "word1 word2 word3 word4 ");
    assert_true(H5Gclose(H5Gcreate2(file, "group", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)) >= 0);
    put_foreign_attribute(file, "two", H5T_NATIVE_DOUBLE, list, numbers);
    put_foreign_attribute(file, "fraction", H5T_NATIVE_DOUBLE, one, numbers);
    put_foreign_attribute(file, "huge", H5T_NATIVE_DOUBLE, one, numbers + 1);
    put_foreign_attribute(file, "minus", H5T_NATIVE_INT64, one, signs);
    put_foreign_attribute(file, "null", H5T_NATIVE_DOUBLE, null, NULL);
    put_foreign_attribute(file, "none", variable, null, NULL);
    put_foreign_attribute(file, "word", variable, one, &texts[1]);
    put_foreign_attribute(file, "words", variable, list, texts);
    put_foreign_attribute(file, "couple", blanks, list, "word1 word2 ");
    put_foreign_attribute(file, "spaces", blanks, one, "a     ");
    put_foreign_attribute(file, "blank", blanks, one, "      ");
    put_foreign_attribute(file, "unset", variable, one, NULL);
    put_foreign_attribute(file, "broad", broad, one, big);
    put_foreign_attribute(file, "many", many, one, &(hvl_t){2, (void *)(uintptr_t)numbers});
    put_foreign_attribute(file, "block", block_type, one, block);
    put_dataset(file, "empty", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, no_rows, false, NULL);
    put_dataset(file, "list", variable, variable, 1, (hsize_t[]){WORDS_OF_LIST}, false, words);
    hid_t chunked = H5Pcreate(H5P_DATASET_CREATE), wide_rows = H5Screate_simple(2, vast, NULL);
    assert_true(H5Pset_chunk(chunked, 2, vast) >= 0);
    put_foreign(file, "vast", H5T_STD_U8LE, H5T_NATIVE_DOUBLE, wide_rows, chunked, NULL);
    assert_true(H5Pclose(chunked) >= 0 && H5Sclose(wide_rows) >= 0);
    const hid_t spaces[] = {one, list, null, row, square, deep},
                types[] = {variable, blanks, wide, broad, f16, many, both, block_type};
    for (size_t i = 0; i < LG_COUNT(spaces); i++) assert_true(H5Sclose(spaces[i]) >= 0);
    for (size_t i = 0; i < LG_COUNT(types); i++) assert_true(H5Tclose(types[i]) >= 0);
    assert_true(H5Pclose(compact) >= 0 && H5Pclose(elsewhere) >= 0 && H5Pclose(parts) >= 0 &&
                H5Pclose(chunks) >= 0);
    assert_true(H5Sclose(plane) >= 0 && H5Fclose(file) >= 0);
}

static lg_h5 *foreign_h5(void) {
    return open_h5(fresh_copy("foreign.h5", write_foreign));
}

static lg_status pass(void *user, uint64_t index, const char *text, lg_error *error) {
    (void)index, (void)error;
    (void)snprintf(user, 16, "%.15s", text);
    return LG_OK;
}

/* Reads a data set of zeros in blocks of rows. */
static lg_status count_rows(lg_h5 *h5, const char *name, uint64_t *seen, lg_error *error) {
    lg_h5_about about;
    LG_TRY(lg_h5_look(h5, name, sizeof(float), &about, error));
    if (about.count == 0) return LG_OK;
    const uint64_t row = about.count / about.dims[0], most = lg_h5_block(&about, 0);
    LG_TRY_SCRATCH(double, values, h5->context, most *row, LG_OUT_OF_MEMORY);
    while (*seen < about.dims[0]) {
        const uint64_t left = about.dims[0] - *seen;
        const lg_h5_slice slice = {.name = name, .first = *seen, .count = left < most ? left : most};
        LG_TRY(lg_h5_get_slice(h5, &slice, LG_H5_EXACT, values, error));
        for (uint64_t i = 0; i < slice.count * row; i += 1000) assert_true(values[i] == 0);
        *seen += slice.count;
    }
    return LG_OK;
}

static void assert_outcome(const char *name, lg_status status, const char *message, lg_status expected,
                           const char *word) {
    if (status == expected && strstr(message, word) != NULL) return;
    (void)lg_test_again(status); /* a call that run_faults.h made fail is a refusal */
    fail_msg("%s: %s: %s", name, lg_status_name(status), message);
}

TEST("arrays that other programs wrote are read in every layout, or refused with the array's name") {
    enum { DOUBLES, SINGLES, SIGNED, UNSIGNED, NATURAL, WORDS, SHAPED, LOOKED, ROWS };
    static const struct {
        const char *name;
        int as;
        lg_status status;
        const char *word;
    } rows[] = {
        {"compact", DOUBLES, LG_OK, ""},
        {"compact", SINGLES, LG_FORMAT, "out of range"},
        {"empty", ROWS, LG_OK, ""},
        {"vast", ROWS, LG_OK, ""},
        {"absent", ROWS, LG_NOT_FOUND, "has no /absent"},
        {"half", SHAPED, LG_OK, ""},
        {"blanks", WORDS, LG_OK, ""},
        {"elsewhere", DOUBLES, LG_FORMAT, "keeps its data in another file"},
        {"virtual", DOUBLES, LG_FORMAT, "keeps its data in another file"},
        {"immense", DOUBLES, LG_FORMAT, "declares more data than the file can hold"},
        {"null", DOUBLES, LG_FORMAT, "has no shape"},
        {"scaled", DOUBLES, LG_FORMAT, "is packed (scale_factor, add_offset); write the values themselves"},
        {"offset", DOUBLES, LG_FORMAT, "is packed (scale_factor, add_offset); write the values themselves"},
        {"filled", DOUBLES, LG_OK, ""},
        {"missing", DOUBLES, LG_OK, ""},
        {"deep", DOUBLES, LG_FORMAT, "has rank 5, but at most 4 can be read"},
        {"both", DOUBLES, LG_FORMAT, "does not hold numbers"},
        {"both", WORDS, LG_FORMAT, "does not hold texts"},
        {"both", LOOKED, LG_OK, ""},
        {"group", DOUBLES, LG_FORMAT, "is not a data set"},
        {"absent", DOUBLES, LG_NOT_FOUND, "has no /absent"},
        {"group/absent", DOUBLES, LG_NOT_FOUND, "has no /group/absent"},
        {"compact", SIGNED, LG_FORMAT, "does not hold integers"},
        {"large", SIGNED, LG_FORMAT, "out of range"},
        {"signs", UNSIGNED, LG_FORMAT, "out of range"},
        {"signs", SIGNED, LG_OK, ""},
        {"signs", NATURAL, LG_FORMAT, "out of range"},
        {"list", WORDS, LG_OK, ""},
        {"long", WORDS, LG_FORMAT, "/long: the text at index (1) is too long: shorten it to 4095 bytes"},
        {"wide", WORDS, LG_FORMAT,
         "has a type of 70000 bytes for each text; at most 4096 can be read: use a"},
        {"row", WORDS, LG_OK, ""},
        {"square", WORDS, LG_FORMAT, "is not a list of texts"},
    };
    lg_h5 *h5 = foreign_h5();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        const char *name = rows[i].name;
        const uint64_t dims[1] = {2};
        double doubles[2];
        float floats[2] = {1.5f, INFINITY};
        uint64_t rows_seen = 0;
        int64_t wholes[2];
        char text[16] = "unread";
        lg_h5_about about;
        const lg_status status =
            rows[i].as == DOUBLES    ? lg_h5_get(h5, name, LG_ELEMENT_F64, 1, dims, doubles, &error)
            : rows[i].as == SINGLES  ? lg_h5_get(h5, name, LG_ELEMENT_F32, 1, dims, floats, &error)
            : rows[i].as == NATURAL  ? lg_h5_get(h5, name, LG_ELEMENT_U32, 1, dims, wholes, &error)
            : rows[i].as == ROWS     ? count_rows(h5, name, &rows_seen, &error)
            : rows[i].as == SIGNED   ? lg_h5_get(h5, name, LG_ELEMENT_I64, 1, dims, wholes, &error)
            : rows[i].as == UNSIGNED ? lg_h5_get(h5, name, LG_ELEMENT_U64, 1, dims, wholes, &error)
            : rows[i].as == WORDS    ? lg_h5_each_text(h5, name, pass, text, &error)
                                     : lg_h5_look(h5, name, 8, &about, &error);
        assert_outcome(name, status, error.message, rows[i].status, rows[i].word);
        if (status != LG_OK) assert_says(error.message, "foreign.h5: ");
        const bool missing = strcmp(name, "filled") == 0 || strcmp(name, "missing") == 0;
        if (missing) assert_true(isnan(doubles[0]) && isnan(doubles[1]) == (*name == 'm'));
        if (rows[i].as == DOUBLES && status == LG_OK && !missing)
            assert_true(doubles[0] == 1.5 && doubles[1] == 1e300);
        if (rows[i].as == SHAPED) assert_true(about.rank == 0 && about.epsilon == 0x1p-10);
        if (strcmp(name, "vast") == 0) assert_int_equal(rows_seen, 2);
        if (strcmp(name, "list") == 0) assert_string_equal(text, "odd");
        if (strcmp(name, "row") == 0) assert_string_equal(text, "word2");
        if (rows[i].as == LOOKED) assert_int_equal(about.kind, LG_H5_TABLE);
        if (strcmp(name, "blanks") == 0) assert_string_equal(text, "");
    }
    assert_ok(lg_h5_read_all(h5, NULL));
}

TEST("attributes that other programs wrote are read, or refused with the attribute's name") {
    enum { TEXT_OF, EACH, REAL_OF, INTEGER, NATURAL };
    static const struct {
        const char *name;
        int as;
        lg_status status;
        const char *word;
    } rows[] = {
        {"two", REAL_OF, LG_FORMAT, "has more than one value, expected one"},
        {"null", REAL_OF, LG_FORMAT, "is not a number"},
        {"null", INTEGER, LG_FORMAT, "is not an integer"},
        {"spaces", REAL_OF, LG_FORMAT, "is not a number"},
        {"fraction", REAL_OF, LG_OK, ""},
        {"fraction", INTEGER, LG_FORMAT, "is not an integer"},
        {"huge", INTEGER, LG_FORMAT, "is not an integer"},
        {"minus", INTEGER, LG_OK, ""},
        {"minus", NATURAL, LG_FORMAT, "is out of range"},
        {"fraction", TEXT_OF, LG_FORMAT, "is not a text"},
        {"absent", TEXT_OF, LG_NOT_FOUND, "is missing"},
        {"none", TEXT_OF, LG_OK, ""},
        {"none", EACH, LG_OK, ""},
        {"couple", TEXT_OF, LG_FORMAT, "has more than one text: write one string"},
        {"word", TEXT_OF, LG_FORMAT, "/: attribute word: the text at index (0) is too long"},
        {"word", EACH, LG_FORMAT, "the text at index (0) is too long: shorten it to 65535 bytes"},
        {"words", EACH, LG_FORMAT, "the text at index (1) is too long: shorten it to 4095 bytes"},
        {"blank", TEXT_OF, LG_OK, ""},
        {"unset", TEXT_OF, LG_OK, ""},
        {"unset", EACH, LG_OK, ""},
        {"broad", TEXT_OF, LG_SHAPE, "is too long"},
        {"spaces", TEXT_OF, LG_OK, ""},
        {"spaces", EACH, LG_OK, ""},
        {"many", TEXT_OF, LG_FORMAT, "is not a text"},
        {"block", REAL_OF, LG_FORMAT, "is not a number"},
    };
    lg_h5 *h5 = foreign_h5();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        const char *name = rows[i].name;
        char text[16] = "";
        double real = 0;
        int64_t whole = 0;
        uint32_t natural = 0;
        bool words;
        const lg_status status =
            rows[i].as == TEXT_OF   ? lg_h5_text(h5, "", name, text, sizeof text, &error)
            : rows[i].as == EACH    ? lg_h5_each_name(h5, "", name, NULL, &words, pass, text, &error)
            : rows[i].as == REAL_OF ? lg_h5_number(h5, "", name, LG_ELEMENT_F64, &real, &error)
            : rows[i].as == INTEGER ? lg_h5_number(h5, "", name, LG_ELEMENT_I64, &whole, &error)
                                    : lg_h5_number(h5, "", name, LG_ELEMENT_U32, &natural, &error);
        assert_outcome(name, status, error.message, rows[i].status, rows[i].word);
        if (status != LG_OK) assert_says(error.message, name);
        if (rows[i].as == REAL_OF && status == LG_OK) assert_true(real == 1.5);
        if (rows[i].as == INTEGER && status == LG_OK) assert_int_equal(whole, -1);
        if (strcmp(name, "spaces") == 0 && rows[i].as <= EACH) assert_string_equal(text, "a");
        if (strcmp(name, "couple") == 0) assert_string_equal(text, "");
        if (strcmp(name, "none") == 0 || strcmp(name, "blank") == 0 || strcmp(name, "unset") == 0)
            assert_string_equal(text, "");
    }
    lg_error error = {LG_OK, ""};
    char text[16];
    assert_status(lg_h5_text(h5, "nowhere/deep", "none", text, sizeof text, &error), LG_NOT_FOUND);
    assert_says(error.message, "nowhere/deep");
    assert_false(lg_h5_has_attribute(h5, "nowhere", "none"));
    assert_true(lg_h5_has_attribute(h5, "", "none"));
    assert_true(lg_h5_has(h5, ""));
}

TEST("the kind of a file is checked, and its format and version") {
    char name[LG_H5_KIND + 10], kind[LG_H5_KIND];
    memset(name, 'k', sizeof name - 1), name[sizeof name - 1] = '\0';
    const struct {
        const char *format, *kind;
        bool foreign;
        lg_status status;
        const char *word;
    } rows[] = {
        {"liegrad", "test", false, LG_OK, ""},
        {"liegrad", "other", false, LG_FORMAT, "attribute kind is 'other', expected 'test'"},
        {"liegrad", "other", true, LG_FORMAT, "attribute kind is 'other', expected 'test'"},
        {"liegrad", NULL, false, LG_FORMAT, "attribute kind is missing, expected 'test'"},
        {"liegrad", NULL, true, LG_OK, ""},
        {"liegrad", name, false, LG_FORMAT, "attribute kind: is too long"},
        {"other", "test", false, LG_FORMAT, "attribute format is 'other', expected 'liegrad'"},
        {"o\x7fther", "test", false, LG_FORMAT, "attribute format is 'o?ther'"},
        {"other", "other", true, LG_OK, ""},
        {NULL, "other", true, LG_OK, ""},
        {NULL, "other", false, LG_FORMAT, "attribute kind is 'other', expected 'test'"},
        {NULL, "test", false, LG_OK, ""},
        {name, "test", false, LG_FORMAT, "attribute format is '', expected 'liegrad'"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = scratch_path("kind.h5");
        lg_error error = {LG_OK, ""};
        lg_h5 *h5;
        assert_told(lg_h5_create(NULL, path, &h5, &told));
        lg_test_owns(h5, release_h5);
        if (rows[i].format != NULL) assert_told(lg_h5_put_text(h5, "", "format", rows[i].format, &told));
        if (rows[i].kind != NULL) assert_told(lg_h5_put_text(h5, "", "kind", rows[i].kind, &told));
        assert_outcome(path, lg_h5_check_format(h5, "test", rows[i].foreign, &error), error.message,
                       rows[i].status, rows[i].word);
        assert_told(lg_h5_kind(h5, kind, &told));
        const bool ours = rows[i].format == NULL || strcmp(rows[i].format, "liegrad") == 0;
        const bool named = ours && rows[i].kind != NULL && strlen(rows[i].kind) < LG_H5_KIND;
        if (!lg_test_faulty()) assert_string_equal(kind, named ? rows[i].kind : "");
    }
}

/* ---- files that exist ---- */

typedef struct decision {
    size_t asked;
    bool allowed;
    char path[512];
    unsigned char begin[8];
} decision;

static lg_status decide(void *user, const char *path, const void *data, size_t bytes, lg_error *error) {
    decision *made = user;
    made->asked++;
    (void)snprintf(made->path, sizeof made->path, "%s", path);
    memcpy(made->begin, data, bytes < sizeof made->begin ? bytes : sizeof made->begin);
    if (made->allowed) return LG_OK;
    (void)snprintf(error->message, sizeof error->message, "not this one");
    return error->status = LG_CHECK_FAILED;
}

static lg_status write_all_kinds(const lg_context *context, size_t kind, const char *path, lg_error *error) {
    static const double t[] = {0};
    const lg_rows_options options = {.rows = 1, .points = 1, .dim = 1, .t = t, .layout = "q"};
    lg_rows_file *rows;
    lg_file_writer *writer;
    if (kind == 0) return lg_file_write(context, path, "text", 4, error);
    if (kind == 1) {
        LG_TRY(lg_file_writer_create(context, path, "test", NULL, &writer, error));
        const lg_status status = lg_file_writer_commit(writer, error);
        lg_file_writer_destroy(writer);
        return status;
    }
    LG_TRY(lg_rows_file_create(context, path, &options, &rows, error));
    const lg_status status = lg_rows_file_commit(rows, error);
    lg_rows_file_destroy(rows);
    return status;
}

TEST("the context decides whether a writer may replace a file, and what it refuses stays") {
    decision made = {.allowed = false};
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.replace = decide;
    options.replace_user = &made;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    for (size_t kind = 0; kind < 3; kind++) {
        const char *path = scratch_path("mine");
        lg_error error = {LG_OK, ""};
        size_t bytes;
        write_text_to(path, "notes");
        made = (decision){.allowed = false};
        assert_outcome(path, write_all_kinds(context, kind, path, &error), error.message, LG_CHECK_FAILED,
                       "not this one");
        assert_true(lg_test_faulty() || (made.asked == 1 && strcmp(made.path, path) == 0));
        if (!lg_test_faulty()) assert_memory_equal(made.begin, kind == 0 ? "text\0\0\0" : LG_H5_SIGNATURE, 8);
        assert_string_equal(read_bytes_of(path, &bytes), "notes");
        made.allowed = true;
        assert_told(write_all_kinds(context, kind, path, &told));
        bool ours = true;
        const lg_status status = lg_file_is_ours(NULL, path, &ours, &error);
        assert_true(lg_test_faulty() || (status == LG_OK) == (kind > 0));
        assert_true(ours == (kind > 0) || (lg_test_faulty() && !ours));
    }
}

TEST("HDF5 files by liegrad are recognised, HDF5 files of others are not") {
    static const char *const formats[] = {"liegrad", "other", "liegrad2", "a format with a long name", NULL};
    for (size_t i = 0; i < LG_COUNT(formats); i++) {
        const char *path = scratch_path("whose.h5");
        lg_h5 *h5;
        assert_told(lg_h5_create(NULL, path, &h5, &told));
        lg_test_owns(h5, release_h5);
        assert_told(lg_h5_put_text(h5, "", "kind", "test", &told));
        if (formats[i] != NULL) assert_told(lg_h5_put_text(h5, "", "format", formats[i], &told));
        assert_told(lg_h5_commit(h5, &told));
        bool ours = i != 0;
        assert_told(lg_file_is_ours(NULL, path, &ours, &told));
        assert_true(ours == (i == 0));
    }
    bool ours = true;
    lg_error error = {LG_OK, ""};
    assert_outcome(scratch_path("nothing"), lg_file_is_ours(NULL, scratch_path("nothing"), &ours, &error),
                   error.message, LG_NOT_FOUND, "nothing");
    assert_false(ours);
    assert_int_equal(lg_file_is_ours(NULL, NULL, &ours, NULL), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_file_is_ours(NULL, "a.h5", NULL, NULL), LG_INVALID_ARGUMENT);
}

TEST("names of files that are missing or too long are refused, and a file may be empty") {
    char name[400];
    lg_error error = {LG_OK, ""};
    lg_h5 *h5;
    memset(name, 'f', sizeof name - 1), name[0] = '/', name[sizeof name - 1] = '\0';
    assert_status(lg_file_write(NULL, NULL, "x", 1, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_file_write(NULL, "", "x", 1, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_file_write(NULL, scratch_path("x"), NULL, 1, &error), LG_INVALID_ARGUMENT);
    assert_told(lg_file_write(NULL, scratch_path("x"), NULL, 0, &told));
    assert_status(lg_file_write(NULL, name, "x", 1, &error), LG_FILE);
    if (strspn(error.message, "f") != 200) fail_msg("%s", error.message);
    assert_status(lg_h5_open(NULL, name, NULL, &h5, &error), LG_FILE);
    assert_status(lg_h5_open(NULL, test_text("%s/y", scratch_path("x")), NULL, &h5, &error), LG_NOT_FOUND);
    assert_status(lg_h5_open(NULL, NULL, NULL, &h5, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_h5_open(NULL, scratch_path("x"), NULL, &h5, &error), LG_FORMAT);
    assert_says(error.message, "is empty");
    const lg_read_options huge = {.size = sizeof huge, .max_size = UINT64_MAX};
    lg_read_options resolved;
    assert_ok(lg_read_options_resolve(&huge, &resolved, NULL));
    assert_true(resolved.max_size <= SIZE_MAX / 2);
}

TEST("the first number that is not finite is named with its index") {
    const uint64_t dims[2] = {2, 3};
    const double values[6] = {1, 2, 3, 4, -INFINITY, NAN};
    lg_error error = {LG_OK, ""};
    assert_ok(lg_check_finite("f.h5", "x", 1, (uint64_t[]){4}, values, &error));
    assert_status(lg_check_finite("f.h5", "x", 2, dims, values, &error), LG_NOT_FINITE);
    assert_string_equal(error.message, "f.h5: /x: an infinity at index (1, 1)");
    assert_status(lg_check_finite("f.h5", "x", 1, (uint64_t[]){1}, values + 5, &error), LG_NOT_FINITE);
    assert_string_equal(error.message, "f.h5: /x: NaN at index (0)");
}
