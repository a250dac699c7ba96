/* Files for the trajectories of an ensemble: rows that are put in any order, refused arguments, full disks,
 * and several files as one data set. */
#include "support/io_test.h"

#include <sys/resource.h>

#include "liegrad/files.h"

enum { ROWS = 3, POINTS = 2, DIM = 4, NUMBERS = ROWS * POINTS * DIM };

RELEASES(release_rows, lg_rows_file_destroy)
RELEASES(release_writer, lg_file_writer_destroy)

static lg_rows_options rows_options(uint64_t first) {
    static const double t[POINTS] = {0.5, 1.0};
    return (lg_rows_options){
        .first = first, .rows = ROWS, .points = POINTS, .dim = DIM, .t = t, .layout = "q p", .run = "a run"};
}

static double number_at(uint64_t first, size_t i) {
    return 100.0 * (double)first + (double)i;
}

/* Writes ROWS rows, the last one first. */
static void write_rows(const char *path, uint64_t first, bool commit) {
    const lg_rows_options options = rows_options(first);
    double row[POINTS * DIM];
    lg_rows_file *file;
    assert_told(lg_rows_file_create(NULL, path, &options, &file, &told));
    lg_test_owns(file, release_rows);
    for (size_t r = ROWS; r-- > 0;) {
        for (size_t i = 0; i < LG_COUNT(row); i++) row[i] = number_at(first, r * POINTS * DIM + i);
        assert_ok(lg_rows_file_put(file, r, row));
    }
    assert_status(lg_rows_file_put(file, ROWS, row), LG_INVALID_ARGUMENT);
    assert_status(lg_rows_file_put(NULL, 0, row), LG_INVALID_ARGUMENT);
    assert_status(lg_rows_file_put(file, 0, NULL), LG_INVALID_ARGUMENT);
    if (commit) assert_told(lg_rows_file_commit(file, &told));
}

/* Reads /trajectories with HDF5 only. */
static void read_rows(const char *path, size_t numbers, double *out) {
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT),
                set = H5Dopen2(file, "trajectories", H5P_DEFAULT), space = H5Dget_space(set);
    assert_int_equal(H5Sget_simple_extent_npoints(space), numbers);
    assert_true(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, out) >= 0);
    (void)H5Sclose(space), (void)H5Dclose(set), (void)H5Fclose(file);
}

TEST("rows that are put in any order are in the file after the commit, and without it there is no file") {
    const char *path = scratch_path("rows.h5");
    double numbers[NUMBERS];
    lg_rows_about about;
    char run[16];
    const size_t mark = lg_test_owned();
    write_rows(path, 7, false);
    lg_test_give_back(mark);
    assert_int_equal(scratch_files(), 0);
    write_rows(path, 7, true);
    assert_int_equal(scratch_files(), 1);
    read_rows(path, NUMBERS, numbers);
    for (size_t i = 0; i < NUMBERS; i++) assert_true(numbers[i] == number_at(7, i));
    assert_ok(lg_rows_file_look(NULL, path, &about, run, sizeof run, NULL));
    assert_true(about.first == 7 && about.rows == ROWS && about.points == POINTS && about.dim == DIM);
    assert_string_equal(run, "a run");
    assert_status(lg_rows_file_look(NULL, path, &about, run, 3, NULL), LG_SHAPE);
    lg_rows_file_destroy(NULL);
}

TEST("arguments that are NULL or 0, too many numbers, and places that cannot be written are refused") {
    const lg_rows_options good = rows_options(0);
    const char *path = scratch_path("refused.h5");
    const size_t files = scratch_files();
    lg_rows_file *file = NULL;
    lg_error error;
    assert_status(lg_rows_file_create(NULL, NULL, &good, &file, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_rows_file_create(NULL, path, NULL, &file, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_rows_file_create(NULL, path, &good, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_rows_file_commit(NULL, NULL), LG_INVALID_ARGUMENT);
    lg_rows_options bad[] = {good, good, good, good, good};
    bad[0].rows = bad[1].points = bad[2].dim = 0;
    bad[3].points = SIZE_MAX / 64, bad[4].rows = INT64_MAX / 64;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_status(lg_rows_file_create(NULL, path, &bad[i], &file, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, i < 3 ? "is 0" : "too many numbers");
    }
    assert_status(lg_rows_file_create(NULL, scratch_path("no/rows.h5"), &good, &file, &error), LG_FILE);
    assert_says(error.message, "no/rows.h5");
    assert_null(file);
    assert_int_equal(scratch_files(), files);
}

TEST("a disk that is too small is noticed at the start, and no file is left") {
    const char *path = scratch_path("large.h5");
    const size_t files = scratch_files();
    struct rlimit limit, tight;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    tight = limit;
    for (rlim_t bytes = 0; bytes < 200000; bytes += 9999) {
        lg_rows_options options = rows_options(0);
        options.rows = 1600; /* 102400 bytes */
        lg_rows_file *file = NULL;
        lg_error error = {LG_OK, ""};
        tight.rlim_cur = bytes;
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &tight), 0);
        const lg_status status = lg_rows_file_create(NULL, path, &options, &file, &error);
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
        if (bytes > 168000) { /* 102400 bytes of rows and at most 64 KB of other parts */
            assert_ok(status);
            lg_rows_file_destroy(file);
        } else {
            assert_int_equal(status, LG_FILE);
            assert_says(error.message, "large.h5: cannot be written: File too large");
            assert_null(file);
        }
        assert_int_equal(scratch_files(), files);
    }
}

TEST("every allocation may fail") {
    const lg_rows_options options = rows_options(0);
    EVERY_ALLOCATION_FAILS(context, 4, {
        lg_rows_file *file = NULL;
        status = lg_rows_file_create(context, scratch_path("failing.h5"), &options, &file, NULL);
        lg_rows_file_destroy(file);
    });
    assert_true(access(scratch_path("failing.h5"), F_OK) != 0);
}

TEST("a file of another rank or kind has no rows, and a file without a run has no text of a run") {
    const char *path = scratch_path("other.h5");
    const uint64_t dims[2] = {2, 3}, first = 1;
    static const double numbers[6] = {0};
    lg_rows_about about;
    lg_file_writer *writer;
    lg_archive_writer archive;
    lg_error error;
    char run[16];
    assert_told(lg_file_writer_create(NULL, path, "ensemble-trajectories", NULL, &writer, &told));
    lg_test_owns(writer, release_writer);
    assert_ok(lg_file_writer_archive(writer, "", &archive));
    assert_ok(archive.array(archive.user, "trajectories", LG_ELEMENT_F64, 2, dims, numbers));
    assert_told(lg_file_writer_commit(writer, &told));
    assert_status(lg_rows_file_look(NULL, path, &about, NULL, 0, &error), LG_NOT_FOUND);
    assert_says(error.message, "first");
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), scalar = H5Screate(H5S_SCALAR),
                attribute = H5Acreate2(file, "first", H5T_STD_U64LE, scalar, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Awrite(attribute, H5T_NATIVE_UINT64, &first) >= 0);
    (void)H5Aclose(attribute), (void)H5Sclose(scalar), (void)H5Fclose(file);
    assert_status(lg_rows_file_look(NULL, path, &about, NULL, 0, &error), LG_FORMAT);
    assert_says(error.message, "), expected (>= 1 rows, >= 1 points, >= 1 numbers per state)");
    assert_status(lg_rows_file_look(NULL, path, &about, run, sizeof run, &error), LG_NOT_FOUND);
}

TEST("a virtual data set joins the rows of several files of its folder") {
    const char *const paths[2] = {scratch_path("part0.h5"), scratch_path("part1.h5")};
    const lg_rows_part parts[2] = {{paths[0], ROWS}, {"part1.h5", ROWS}};
    double numbers[2 * NUMBERS];
    lg_file_writer *writer;
    for (uint64_t i = 0; i < 2; i++) write_rows(paths[i], i, true);
    assert_told(lg_file_writer_create(NULL, scratch_path("whole.h5"), "whole", NULL, &writer, &told));
    lg_test_owns(writer, release_writer);
    assert_status(lg_file_writer_rows(NULL, parts, 2, POINTS, DIM, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_file_writer_rows(writer, NULL, 2, POINTS, DIM, NULL), LG_INVALID_ARGUMENT);
    assert_told(lg_file_writer_rows(writer, parts, 2, POINTS, DIM, &told));
    assert_status(lg_file_writer_rows(writer, parts, 1, POINTS, DIM, NULL), LG_OUT_OF_MEMORY); /* twice */
    assert_told(lg_file_writer_commit(writer, &told));
    read_rows(scratch_path("whole.h5"), LG_COUNT(numbers), numbers);
    for (size_t i = 0; i < LG_COUNT(numbers); i++)
        assert_true(numbers[i] == number_at(i / NUMBERS, i % NUMBERS));
}
