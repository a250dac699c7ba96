/* Sets of curves in files: written and read back, files of other programs, the length found from the curves,
 * tables of invalid input. */
#include "support/io_test.h"

#include "elastica/elastica.h"

enum { CURVES = 6, INTERVALS = 10, NODES = INTERVALS + 1 };

/* Circular arcs from the origin, whose length and turning are exact. */
static void make_arc(double length, uint32_t intervals, double angle, double turning, double *q, double *v) {
    for (uint32_t k = 0; k <= intervals; k++) {
        const double part = (double)k / intervals, half = 0.5 * part * turning;
        const double chord = length * part * (fabs(half) < 1e-8 ? 1 : sin(half) / half);
        q[2 * k] = chord * cos(angle + half), q[2 * k + 1] = chord * sin(angle + half);
        v[2 * k] = cos(angle + 2 * half), v[2 * k + 1] = sin(angle + 2 * half);
    }
}

OWNED(lg_elastica_data, lg_elastica_data_destroy)

static lg_elastica_data *make_curves(double length, uint32_t intervals, size_t count, bool optional) {
    lg_elastica_data *out = own_lg_elastica_data((lg_elastica_data){.sha256 = ""});
    lg_elastica_curves *c = &out->curves;
    const size_t row = 2 * ((size_t)intervals + 1);
    assert_ok(lg_elastica_curves_create(NULL, count, intervals, optional, c));
    c->length = length;
    c->stiffness = 7.5;
    c->continuous = true;
    for (size_t i = 0; i < count; i++) {
        double *q = c->q + row * i, *v = c->v + row * i, *b = c->boundary + 8 * i;
        make_arc(length, intervals, 0.1 * (double)i, 0.4 * (double)i - 1, q, v);
        memcpy(b, q, 2 * sizeof *b);
        memcpy(b + 2, v, 2 * sizeof *b);
        memcpy(b + 4, q + row - 2, 2 * sizeof *b);
        memcpy(b + 6, v + row - 2, 2 * sizeof *b);
        if (!optional) continue;
        c->energy[i] = 1.5 + (double)i;
        c->x[i] = 0.25 * (double)i;
        c->kind[i] = i % 2;
    }
    (void)snprintf(out->provenance.cpu, sizeof out->provenance.cpu, "kernels baseline");
    return out;
}

static lg_elastica_data *read_curves(const char *path) {
    lg_elastica_data data;
    assert_told(lg_elastica_data_read(NULL, path, NULL, &data, &told));
    return own_lg_elastica_data(data);
}

static void write_curves(const char *path) {
    assert_ok(lg_elastica_data_write(NULL, path, make_curves(3.3, INTERVALS, CURVES, true), NULL));
}

static const char *good_file(void) {
    return fresh_copy("curves.h5", write_curves);
}

static lg_status read_data(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    lg_elastica_data data;
    const lg_status status = lg_elastica_data_read(context, path, options, &data, error);
    if (status == LG_OK) lg_elastica_data_destroy(&data);
    return status;
}

static void assert_same_curves(const lg_elastica_curves *a, const lg_elastica_curves *b) {
    assert_int_equal(a->count, b->count);
    assert_int_equal(a->intervals, b->intervals);
    const size_t nodes = 2 * a->count * ((size_t)a->intervals + 1) * sizeof(double);
    assert_memory_equal(a->boundary, b->boundary, 8 * a->count * sizeof(double));
    assert_memory_equal(a->q, b->q, nodes);
    assert_memory_equal(a->v, b->v, nodes);
}

TEST("curves are read back as they were written") {
    for (int optional = 0; optional < 2; optional++) {
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        lg_elastica_data *data = make_curves(2.75, INTERVALS, CURVES, optional == 1);
        assert_ok(lg_elastica_data_write(NULL, path, data, NULL));
        assert_int_equal(strlen(data->sha256), 64);
        lg_elastica_data *again = read_curves(path);
        const lg_elastica_curves *a = &again->curves, *d = &data->curves;
        assert_same_curves(a, d);
        assert_string_equal(again->sha256, data->sha256);
        assert_true(a->length == 2.75 && a->stiffness == 7.5 && a->continuous);
        assert_string_equal(again->provenance.cpu, "kernels baseline");
        assert_string_equal(again->provenance.liegrad_version, lg_version());
        if (optional == 1) {
            assert_memory_equal(a->energy, d->energy, CURVES * sizeof(double));
            assert_memory_equal(a->x, d->x, CURVES * sizeof(double));
            assert_memory_equal(a->kind, d->kind, CURVES * sizeof(uint32_t));
        } else {
            assert_true(a->energy == NULL && a->x == NULL && a->kind == NULL);
        }
        assert_ok(lg_elastica_data_write(NULL, second, again, NULL));
        assert_same_bytes(path, second);
        lg_elastica_data_destroy(again); /* the test destroys it a second time */
    }
}

TEST("the hash is computed from boundary, q and v as little-endian doubles, one after the other") {
    const lg_elastica_data *data = read_curves(good_file());
    lg_sha256 sha;
    char text[LG_SHA256_TEXT];
    lg_sha256_init(&sha);
    sha256_add_little_endian(&sha, data->curves.boundary, CURVES * 8);
    sha256_add_little_endian(&sha, data->curves.q, (size_t)CURVES * NODES * 2);
    sha256_add_little_endian(&sha, data->curves.v, (size_t)CURVES * NODES * 2);
    lg_sha256_finish(&sha, text);
    assert_string_equal(data->sha256, text);
}

/* ---- files of other programs ---- */

/* A file with only the three arrays and no attributes, as three lines of h5py write it. */
static const char *foreign_file(const lg_elastica_curves *c, hid_t stored, bool packed) {
    const char *path = scratch_path("foreign.h5");
    const hsize_t boundary[2] = {c->count, 8}, nodes[3] = {c->count, c->intervals + 1, 2};
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(file >= 0);
    put_dataset(file, "boundary", stored, H5T_NATIVE_DOUBLE, 2, boundary, packed, c->boundary);
    put_dataset(file, "q", stored, H5T_NATIVE_DOUBLE, 3, nodes, packed, c->q);
    put_dataset(file, "v", stored, H5T_NATIVE_DOUBLE, 3, nodes, packed, c->v);
    assert_true(H5Fclose(file) >= 0);
    return path;
}

TEST("files of other programs are read") {
    const struct {
        hid_t stored;
        bool packed;
        double tolerance;
    } cases[] = {{H5T_IEEE_F64LE, false, 0},
                 {H5T_IEEE_F64BE, true, 0},
                 {H5T_IEEE_F32LE, true, 1e-6},
                 {H5T_IEEE_F32BE, false, 1e-6}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const lg_elastica_curves *d = &make_curves(3.3, INTERVALS, CURVES, false)->curves;
        const lg_elastica_data *again = read_curves(foreign_file(d, cases[i].stored, cases[i].packed));
        const lg_elastica_curves *a = &again->curves;
        const double tolerance = cases[i].tolerance;
        assert_true(a->count == CURVES && a->intervals == INTERVALS);
        for (size_t j = 0; j < (size_t)2 * CURVES * NODES; j++) {
            assert_close(a->q[j], d->q[j], tolerance, tolerance);
            assert_close(a->v[j], d->v[j], tolerance, tolerance);
        }
        assert_true(a->length == 3.3 && a->stiffness == 10 && !a->continuous && a->energy == NULL);
        assert_string_equal(again->provenance.command, "");
        assert_int_equal(strlen(again->sha256), 64);
    }
}

TEST("optional arrays and attributes are read in the types that other programs use") {
    const lg_elastica_data *data = make_curves(3.3, INTERVALS, CURVES, false);
    const char *path = foreign_file(&data->curves, H5T_IEEE_F64LE, false);
    const hsize_t n = CURVES, column[2] = {CURVES, 1}, row[2] = {1, CURVES};
    const double energy[CURVES] = {1, 2, 3, 4, 5, 6};
    const int64_t kinds[CURVES] = {0, 1, 1, 0, 0, 1};
    const double x[CURVES] = {0, 0.5, 1, 1.5, 2, 2.5}, length = 3.5;
    replace_dataset(path, "energy", H5T_IEEE_F32BE, H5T_NATIVE_DOUBLE, 2, column, energy);
    replace_dataset(path, "x", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &n, x);
    replace_dataset(path, "case", H5T_STD_I64BE, H5T_NATIVE_INT64, 2, row, kinds);
    replace_attribute(path, "/", "length", H5T_IEEE_F32LE, H5T_NATIVE_DOUBLE, &length);
    replace_integer(path, "/", "stiffness", 12);
    replace_text(path, "/", "values", "continuous");
    const lg_elastica_curves *a = &read_curves(path)->curves;
    assert_true(a->length == 3.5 && a->stiffness == 12 && a->continuous);
    assert_memory_equal(a->energy, energy, sizeof energy);
    assert_memory_equal(a->x, x, sizeof x);
    for (size_t i = 0; i < CURVES; i++) assert_int_equal(a->kind[i], kinds[i]);
}

/* Chords alone, or the trapezoidal rule, would have errors above rounding. */
TEST("the length of a curve is found to rounding") {
    const struct {
        double length;
        uint32_t intervals;
        size_t count;
    } cases[] = {{3.3, 50, 5}, {3.3, 2, 6}, {0.0123, 7, 1}, {4710, 4, 2}, {1, 3, 6}, {99.9, 5, 6}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const lg_elastica_data *data =
            make_curves(cases[i].length, cases[i].intervals, cases[i].count, false);
        const char *path = foreign_file(&data->curves, H5T_IEEE_F32LE, false);
        assert_close(read_curves(path)->curves.length, cases[i].length, 1e-15, 0);
    }
}

/* From the solver's curves without the attribute, the length must be found to the last bit. Coarse discrete
 * curves are no arcs: for N = 10 arcs would give 3.27. */
TEST("the length of coarse discrete equilibria is found") {
    static const struct {
        uint32_t intervals;
        bool both_ends, continuous, single;
    } cases[] = {{50, true, false, false}, {50, true, true, true},    {10, false, false, true},
                 {10, true, false, false}, {20, false, true, false},  {4, true, false, false},
                 {10, false, true, false}, {100, false, false, true}, {100, true, true, false}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_elastica_sampling sampling;
        lg_elastica_sampling_init(&sampling);
        lg_elastica_data *data = own_lg_elastica_data((lg_elastica_data){.sha256 = ""});
        sampling.both_ends = cases[i].both_ends;
        sampling.right_end = !cases[i].both_ends || i % 2 == 0;
        sampling.count = 20;
        sampling.continuous = cases[i].continuous;
        sampling.problem.intervals = cases[i].intervals;
        assert_ok(lg_elastica_generate(NULL, &sampling, &data->curves, NULL));
        const hid_t stored = cases[i].single ? H5T_IEEE_F32LE : H5T_IEEE_F64LE;
        const char *path = foreign_file(&data->curves, stored, false);
        assert_close(read_curves(path)->curves.length, sampling.problem.length, 0, 0);
    }
}

/* ---- invalid files ---- */

TEST("a damaged file is refused") {
    refuse_damaged_files(read_data, good_file(), "");
    survive_changed_bytes(read_data, good_file(), 120);
    const lg_elastica_data *data = make_curves(3.3, INTERVALS, CURVES, false);
    survive_changed_bytes(read_data, foreign_file(&data->curves, H5T_IEEE_F32BE, true), 60);
}

TEST("errors in a file are refused by name, and the format of other programs is accepted") {
    static const damage rows[] = {
        {"boundary", ARRAY(0, 48), LG_FORMAT, "(48), expected (>= 1 curves, 8)"},
        {"boundary", ARRAY(0, 6, 7), LG_FORMAT, "(6, 7), expected (>= 1 curves, 8)"},
        {"boundary", ARRAY(0, 0, 8), LG_FORMAT, ""},
        {"boundary", ARRAY(NAN, 6, 8), LG_NOT_FINITE, "(0, 0)"},
        {"boundary", ARRAY(1, 6, 8), LG_FORMAT, "length 1.41"},
        {"boundary", ARRAY(0, 5, 8), LG_FORMAT, "q"},
        {"q", ARRAY(0, 6, 11, 3), LG_FORMAT, "(6, 11, 3)"},
        {"q", ARRAY(0, 6, 22), LG_FORMAT, "(6, 22)"},
        {"q", ARRAY(0, 6, 2, 2), LG_FORMAT, "N of 2"},
        {"q", ARRAY(0, 6, 0, 2), LG_FORMAT, ""},
        {"q", ARRAY(0, 5, 11, 2), LG_FORMAT, "(5, 11, 2)"},
        {"q", ARRAY(INFINITY, 6, 11, 2), LG_NOT_FINITE, "(0, 0, 0)"},
        {"q", ARRAY(0, 6, 11, 2), LG_FORMAT, "ends at"},
        {"v", ARRAY(0, 6, 12, 2), LG_FORMAT,
         "(6, 12, 2), expected (6 curves as in /boundary, 11 nodes as in /q, 2)"},
        {"v", ARRAY(0, 7, 11, 2), LG_FORMAT, "(7, 11, 2)"},
        {"v", ARRAY(NAN, 6, 11, 2), LG_NOT_FINITE, "(0, 0, 0)"},
        {"v", ARRAY(0.6, 6, 11, 2), LG_FORMAT, "begins at"},
        {"energy", ARRAY(1, 5), LG_FORMAT, "(5)"},
        {"energy", ARRAY(NAN, 6), LG_NOT_FINITE, "(0)"},
        {"x", ARRAY(1, 6, 2), LG_FORMAT, "(6, 2), expected (6 curves as in /boundary)"},
        {"case", ARRAY(1, 7), LG_FORMAT, "(7)"},
        {"case", ARRAY(2, 6), LG_FORMAT, "is 2 at index (0)"},
        {"case", ARRAY(0.5, 6), LG_FORMAT, "0.5 at index (0) is not a whole number"},
        {"case", ARRAY(-1, 6), LG_FORMAT, "is -1"},
        {"case", ARRAY(NAN, 6), LG_NOT_FINITE, "(0)"},
        {"boundary", GONE, LG_FORMAT, ""},
        {"q", GONE, LG_FORMAT, ""},
        {"v", GONE, LG_FORMAT, ""},
        /* Sizes for which there is no memory, declared without any data. */
        {"boundary", DECLARED(1000000000000, 8), LG_FORMAT, ""},
        {"q", DECLARED(6, 1000000000, 2), LG_FORMAT, ""},
        {"q", DECLARED(1000000000, 51, 2), LG_FORMAT, ""},
        {"v", DECLARED(6, 4000000000, 2), LG_FORMAT, ""},
        {"energy", DECLARED(2000000000000), LG_FORMAT, ""},
        {"case", DECLARED(2000000000000), LG_FORMAT, ""},
        {"@length", REAL(NAN), LG_NOT_FINITE, "positive"},
        {"@length", REAL(0), LG_FORMAT, "positive"},
        {"@length", REAL(-3.3), LG_FORMAT, "positive"},
        {"@length", REAL(1), LG_FORMAT, "apart"},
        {"@length", REAL(INFINITY), LG_NOT_FINITE, "positive"},
        {"@length", TEXT("long"), LG_FORMAT, "number"},
        {"@stiffness", REAL(-1), LG_FORMAT, "positive"},
        {"@stiffness", REAL(NAN), LG_NOT_FINITE, "positive"},
        {"@values", TEXT("exact"), LG_FORMAT, "discrete"},
        {"@values", WHOLE(1), LG_FORMAT, "text"},
        {"@values", TEXT("a word of more than sixty-three letters, which is longer than any value of it"),
         LG_FORMAT, "discrete"},
        {"@kind", TEXT("trajectories"), LG_FORMAT, "elastica"},
        {"@format_version", WHOLE(3), LG_VERSION, "3"},
    };
    refuse_damage(read_data, good_file, rows, LG_COUNT(rows));
    const char *path = good_file();
    replace_text(path, "/", "format", "somebody else's");
    assert_ok(read_data(NULL, path, NULL, NULL));
}

TEST("curves that shrink to a point have no length") {
    const char *path = good_file();
    const hsize_t boundary[2] = {6, 8}, nodes[3] = {6, 11, 2};
    double b[48], q[132] = {0}, v[132];
    for (size_t i = 0; i < 48; i++) b[i] = i % 8 == 2 || i % 8 == 6;
    for (size_t i = 0; i < 132; i++) v[i] = i % 2 == 0;
    replace_dataset(path, "boundary", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, boundary, b);
    replace_dataset(path, "q", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, nodes, q);
    replace_dataset(path, "v", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, nodes, v);
    assert_ok(read_data(NULL, path, NULL, NULL));
    delete_attribute(path, "/", "length");
    assert_refused(read_data, path, LG_FORMAT, "length of the curves is 0", "");
    for (size_t i = 0; i < 132; i++) q[i] = i % 2 == 0 ? 1e101 * (double)(i / 2 % 11) : 0.0;
    for (size_t i = 0; i < 48; i++) b[i] = i % 8 == 4 ? 1e102 : b[i];
    replace_dataset(path, "boundary", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, boundary, b);
    replace_dataset(path, "q", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, nodes, q);
    assert_refused(read_data, path, LG_FORMAT, "expected 1e-100 to 1e100", "");
    b[6] = 0.5;
    replace_dataset(path, "boundary", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, boundary, b);
    assert_refused(read_data, path, LG_FORMAT, "has length 1 or 0.5", "");
}

/* Writing must fail when *at has the value `bad`. */
static void not_written(lg_elastica_data *data, double *at, double bad, lg_status status, const char *word) {
    lg_error error = {LG_OK, ""};
    const double good = *at;
    *at = bad;
    assert_status(lg_elastica_data_write(NULL, scratch_path("refused.h5"), data, &error), status);
    if (strstr(error.message, word) == NULL) fail_msg("%s", error.message);
    *at = good;
}

TEST("curves that could not be read back are not written") {
    lg_elastica_data *data = make_curves(3.3, INTERVALS, CURVES, true);
    lg_elastica_curves *c = &data->curves;
    const char *path = scratch_path("refused.h5");
    not_written(data, &c->v[2 * NODES + 5], NAN, LG_NOT_FINITE, "/v: NaN at index (1, 2, 1)");
    not_written(data, &c->energy[3], INFINITY, LG_NOT_FINITE, "/energy");
    not_written(data, &c->length, 0, LG_INVALID_ARGUMENT, "");
    not_written(data, &c->length, NAN, LG_NOT_FINITE, "");
    not_written(data, &c->stiffness, INFINITY, LG_NOT_FINITE, "");
    not_written(data, &c->stiffness, -1, LG_INVALID_ARGUMENT, "");
    lg_elastica_data bad[5];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = *data;
    bad[0].curves.q = bad[1].curves.v = NULL, bad[2].curves.count = 0, bad[3].curves.intervals = 1;
    bad[4].curves.intervals = LG_ELASTICA_MAX_INTERVALS + 1;
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(lg_elastica_data_write(NULL, path, &bad[i], NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_elastica_data_write(NULL, path, NULL, NULL), LG_INVALID_ARGUMENT);
    lg_elastica_data_destroy(NULL);
    c->kind[1] = 2;
    assert_status(lg_elastica_data_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
    c->kind[1] = 1;
    assert_status(lg_elastica_data_write(NULL, scratch_path("no/folder.h5"), data, NULL), LG_FILE);
    assert_status(lg_elastica_data_write(NULL, NULL, data, NULL), LG_INVALID_ARGUMENT);
    assert_int_not_equal(access(path, F_OK), 0);
    lg_elastica_data_destroy(data);
    assert_status(lg_elastica_data_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
}

/* ---- memory ---- */

static lg_status write_step(const lg_context *context, void *user, lg_error *error) {
    lg_elastica_data *const *data = user;
    return lg_elastica_data_write(context, scratch_path("written.h5"), *data, error);
}

TEST("every allocation may fail, and nothing leaks") {
    const char *path = good_file();
    lg_elastica_data *data = make_curves(3.3, INTERVALS, CURVES, true);
    assert_true(fail_every_reading(read_data, path) >= 7);
    assert_true(fail_every_allocation(write_step, &data) >= 4);
    delete_attribute(path, "/", "length");
    assert_true(fail_every_reading(read_data, path) >= 8);
}
