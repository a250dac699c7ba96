/* Sets of curves: round trip, files of other programs, the length that the curves tell, the matrix of bad
 * input. */
#include "io_test.h"

#include "liegrad/elastica.h"

enum { CURVES = 6, INTERVALS = 10, NODES = INTERVALS + 1 };

/* Arcs of circles from the origin: length and turning are exact. */
static void make_arc(double length, uint32_t intervals, double angle, double turning, double *q, double *v) {
    for (uint32_t k = 0; k <= intervals; k++) {
        const double part = (double)k / intervals, half = 0.5 * part * turning;
        const double chord = length * part * (fabs(half) < 1e-8 ? 1 : sin(half) / half);
        q[2 * k] = chord * cos(angle + half), q[2 * k + 1] = chord * sin(angle + half);
        v[2 * k] = cos(angle + 2 * half), v[2 * k + 1] = sin(angle + 2 * half);
    }
}

static void make_curves(double length, uint32_t intervals, size_t count, bool optional,
                        lg_elastica_data *out) {
    *out = (lg_elastica_data){.sha256 = ""};
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
}

static const char *good_file(void) {
    const char *path = scratch_path("curves.h5"), *original = scratch_path("curves.original");
    if (access(original, F_OK) != 0) {
        lg_elastica_data data;
        make_curves(3.3, INTERVALS, CURVES, true, &data);
        assert_ok(lg_elastica_data_write(NULL, original, &data, NULL));
        lg_elastica_data_destroy(&data);
    }
    copy_file(original, path);
    return path;
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

TEST("curves come back as they were written") {
    for (int optional = 0; optional < 2; optional++) {
        lg_elastica_data data, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        make_curves(2.75, INTERVALS, CURVES, optional == 1, &data);
        assert_ok(lg_elastica_data_write(NULL, path, &data, NULL));
        assert_int_equal(strlen(data.sha256), 64);
        assert_ok(lg_elastica_data_read(NULL, path, NULL, &again, NULL));
        assert_same_curves(&again.curves, &data.curves);
        assert_string_equal(again.sha256, data.sha256);
        assert_close(again.curves.length, 2.75, 0, 0);
        assert_close(again.curves.stiffness, 7.5, 0, 0);
        assert_true(again.curves.continuous);
        assert_string_equal(again.provenance.cpu, "kernels baseline");
        assert_string_equal(again.provenance.liegrad_version, lg_version());
        if (optional == 1) {
            assert_memory_equal(again.curves.energy, data.curves.energy, CURVES * sizeof(double));
            assert_memory_equal(again.curves.x, data.curves.x, CURVES * sizeof(double));
            assert_memory_equal(again.curves.kind, data.curves.kind, CURVES * sizeof(uint32_t));
        } else {
            assert_true(again.curves.energy == NULL && again.curves.x == NULL && again.curves.kind == NULL);
        }
        assert_ok(lg_elastica_data_write(NULL, second, &again, NULL));
        assert_same_bytes(path, second);
        lg_elastica_data_destroy(&data);
        lg_elastica_data_destroy(&again);
        lg_elastica_data_destroy(&again);
    }
}

/* boundary, q and v as little-endian doubles, one after the other. */
TEST("the hash is that of boundary, q and v as little-endian doubles, one after the other") {
    lg_elastica_data data;
    lg_sha256 sha;
    char text[LG_SHA256_TEXT];
    assert_ok(lg_elastica_data_read(NULL, good_file(), NULL, &data, NULL));
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, data.curves.boundary, CURVES * 8 * sizeof(double));
    lg_sha256_add(&sha, data.curves.q, (size_t)CURVES * NODES * 2 * sizeof(double));
    lg_sha256_add(&sha, data.curves.v, (size_t)CURVES * NODES * 2 * sizeof(double));
    lg_sha256_finish(&sha, text);
    assert_string_equal(data.sha256, text);
    lg_elastica_data_destroy(&data);
}

/* ---- files of other programs ---- */

static void put_foreign(hid_t file, const char *name, hid_t stored, bool packed, int rank,
                        const hsize_t *dims, hid_t memory, const void *data) {
    const hsize_t chunk[3] = {1, rank > 1 ? dims[1] : 1, rank > 2 ? dims[2] : 1};
    hid_t space = H5Screate_simple(rank, dims, NULL), plist = H5Pcreate(H5P_DATASET_CREATE);
    if (packed)
        assert_true(H5Pset_chunk(plist, rank, chunk) >= 0 && H5Pset_shuffle(plist) >= 0 &&
                    H5Pset_deflate(plist, 4) >= 0);
    hid_t set = H5Dcreate2(file, name, stored, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0 && H5Dwrite(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Pclose(plist) >= 0 && H5Sclose(space) >= 0);
}

/* No attributes, nothing but the three arrays: what h5py writes from three lines. */
static const char *foreign_file(const lg_elastica_curves *c, hid_t stored, bool packed) {
    const char *path = scratch_path("foreign.h5");
    const hsize_t boundary[2] = {c->count, 8}, nodes[3] = {c->count, c->intervals + 1, 2};
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(file >= 0);
    put_foreign(file, "boundary", stored, packed, 2, boundary, H5T_NATIVE_DOUBLE, c->boundary);
    put_foreign(file, "q", stored, packed, 3, nodes, H5T_NATIVE_DOUBLE, c->q);
    put_foreign(file, "v", stored, packed, 3, nodes, H5T_NATIVE_DOUBLE, c->v);
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
        lg_elastica_data data, again;
        make_curves(3.3, INTERVALS, CURVES, false, &data);
        const char *path = foreign_file(&data.curves, cases[i].stored, cases[i].packed);
        assert_ok(lg_elastica_data_read(NULL, path, NULL, &again, NULL));
        assert_int_equal(again.curves.count, CURVES);
        assert_int_equal(again.curves.intervals, INTERVALS);
        for (size_t j = 0; j < (size_t)2 * CURVES * NODES; j++) {
            assert_close(again.curves.q[j], data.curves.q[j], cases[i].tolerance, cases[i].tolerance);
            assert_close(again.curves.v[j], data.curves.v[j], cases[i].tolerance, cases[i].tolerance);
        }
        assert_close(again.curves.length, 3.3, 0, 0);
        assert_close(again.curves.stiffness, 10, 0, 0);
        assert_false(again.curves.continuous);
        assert_null(again.curves.energy);
        assert_string_equal(again.provenance.command, "");
        assert_int_equal(strlen(again.sha256), 64);
        lg_elastica_data_destroy(&data);
        lg_elastica_data_destroy(&again);
    }
}

TEST("optional arrays and attributes are read in the types that other programs choose") {
    lg_elastica_data data, again;
    make_curves(3.3, INTERVALS, CURVES, false, &data);
    const char *path = foreign_file(&data.curves, H5T_IEEE_F64LE, false);
    const hsize_t n = CURVES;
    const double energy[CURVES] = {1, 2, 3, 4, 5, 6};
    const int64_t kinds[CURVES] = {0, 1, 1, 0, 0, 1};
    const double x[CURVES] = {0, 0.5, 1, 1.5, 2, 2.5}, length = 3.5;
    replace_dataset(path, "energy", H5T_IEEE_F32BE, H5T_NATIVE_DOUBLE, 1, &n, energy);
    replace_dataset(path, "x", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &n, x);
    replace_dataset(path, "case", H5T_STD_I64BE, H5T_NATIVE_INT64, 1, &n, kinds);
    replace_attribute(path, "/", "length", H5T_IEEE_F32LE, H5T_NATIVE_DOUBLE, &length);
    replace_integer(path, "/", "stiffness", 12);
    replace_text(path, "/", "values", "continuous");
    assert_ok(lg_elastica_data_read(NULL, path, NULL, &again, NULL));
    assert_close(again.curves.length, 3.5, 0, 0);
    assert_close(again.curves.stiffness, 12, 0, 0);
    assert_true(again.curves.continuous);
    for (size_t i = 0; i < CURVES; i++) {
        assert_close(again.curves.energy[i], energy[i], 0, 0);
        assert_close(again.curves.x[i], x[i], 0, 0);
        assert_int_equal(again.curves.kind[i], kinds[i]);
    }
    lg_elastica_data_destroy(&data);
    lg_elastica_data_destroy(&again);
}

/* Chords alone, or the trapezoidal rule, would be off by more than the rounding hides. */
TEST("the length of a curve is found to rounding") {
    const struct {
        double length;
        uint32_t intervals;
        size_t count;
    } cases[] = {{3.3, 50, 5}, {3.3, 2, 6}, {0.0123, 7, 1}, {4710, 4, 2}, {1, 3, 6}, {99.9, 5, 6}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_elastica_data data, again;
        make_curves(cases[i].length, cases[i].intervals, cases[i].count, false, &data);
        const char *path = foreign_file(&data.curves, H5T_IEEE_F32LE, false);
        assert_ok(lg_elastica_data_read(NULL, path, NULL, &again, NULL));
        assert_close(again.curves.length, cases[i].length, 1e-15, 0);
        lg_elastica_data_destroy(&data);
        lg_elastica_data_destroy(&again);
    }
}

/* What the solver's own curves tell without the attribute: the length they were made with, to the last bit.
 * Coarse discrete curves are no arcs: from N = 10 arcs alone would say 3.27. */
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
        lg_elastica_data data = {.sha256 = ""}, again;
        sampling.both_ends = cases[i].both_ends;
        sampling.right_end = !cases[i].both_ends || i % 2 == 0;
        sampling.count = 20;
        sampling.continuous = cases[i].continuous;
        sampling.problem.intervals = cases[i].intervals;
        assert_ok(lg_elastica_generate(NULL, &sampling, &data.curves, NULL));
        const char *path =
            foreign_file(&data.curves, cases[i].single ? H5T_IEEE_F32LE : H5T_IEEE_F64LE, false);
        assert_ok(lg_elastica_data_read(NULL, path, NULL, &again, NULL));
        assert_close(again.curves.length, sampling.problem.length, 0, 0);
        lg_elastica_data_destroy(&data);
        lg_elastica_data_destroy(&again);
    }
}

/* ---- bad input ---- */

TEST("a damaged file is refused") {
    refuse_damaged_files(read_data, good_file(), "");
    survive_changed_bytes(read_data, good_file(), 120);
    lg_elastica_data data;
    make_curves(3.3, INTERVALS, CURVES, false, &data);
    survive_changed_bytes(read_data, foreign_file(&data.curves, H5T_IEEE_F32BE, true), 60);
    lg_elastica_data_destroy(&data);
}

TEST("an array of the wrong shape or value is refused by name") {
    static const bad_array cases[] = {
        {"boundary", 1, {48}, 0, LG_FORMAT, "rank"},
        {"boundary", 2, {6, 7}, 0, LG_FORMAT, "(6, 7)"},
        {"boundary", 2, {0, 8}, 0, LG_FORMAT, ""},
        {"boundary", 2, {6, 8}, NAN, LG_NOT_FINITE, "(0, 0)"},
        {"boundary", 2, {6, 8}, 1, LG_FORMAT, "length 1.41"},
        {"boundary", 2, {5, 8}, 0, LG_FORMAT, "q"},
        {"q", 3, {6, 11, 3}, 0, LG_FORMAT, "(6, 11, 3)"},
        {"q", 2, {6, 22}, 0, LG_FORMAT, "rank"},
        {"q", 3, {6, 2, 2}, 0, LG_FORMAT, "N of 2"},
        {"q", 3, {6, 0, 2}, 0, LG_FORMAT, ""},
        {"q", 3, {5, 11, 2}, 0, LG_FORMAT, "5 curves"},
        {"q", 3, {6, 11, 2}, INFINITY, LG_NOT_FINITE, "(0, 0, 0)"},
        {"q", 3, {6, 11, 2}, 0, LG_FORMAT, "ends at"},
        {"v", 3, {6, 12, 2}, 0, LG_FORMAT, "12 nodes a curve, /q has 11"},
        {"v", 3, {7, 11, 2}, 0, LG_FORMAT, "7 curves"},
        {"v", 3, {6, 11, 2}, NAN, LG_NOT_FINITE, "(0, 0, 0)"},
        {"v", 3, {6, 11, 2}, 0.6, LG_FORMAT, "begins at"},
        {"energy", 1, {5}, 1, LG_FORMAT, "5 curves"},
        {"energy", 1, {6}, NAN, LG_NOT_FINITE, "(0)"},
        {"x", 2, {6, 1}, 1, LG_FORMAT, "rank"},
        {"case", 1, {7}, 1, LG_FORMAT, "7 curves"},
        {"case", 1, {6}, 2, LG_FORMAT, "is 2 at index (0)"},
        {"case", 1, {6}, 0.5, LG_FORMAT, "is 0.5"},
        {"case", 1, {6}, -1, LG_FORMAT, "is -1"},
        {"case", 1, {6}, NAN, LG_NOT_FINITE, "(0)"},
    };
    refuse_arrays(read_data, good_file, true, cases, LG_COUNT(cases));
    static const char *const needed[] = {"boundary", "q", "v"};
    refuse_without_links(read_data, good_file, "", needed, LG_COUNT(needed));
}

TEST("sizes that nobody has memory for are refused, without a byte behind them") {
    static const struct {
        const char *name;
        int rank;
        hsize_t dims[3];
    } cases[] = {{"boundary", 2, {1000000000000, 8}}, {"q", 3, {6, 1000000000, 2}},
                 {"q", 3, {1000000000, 51, 2}},       {"v", 3, {6, 4000000000, 2}},
                 {"energy", 1, {2000000000000}},      {"case", 1, {2000000000000}}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = good_file();
        const hsize_t chunk[3] = {1, 1, 1};
        delete_link(path, cases[i].name);
        hid_t file = open_for_change(path), plist = H5Pcreate(H5P_DATASET_CREATE);
        hid_t space = H5Screate_simple(cases[i].rank, cases[i].dims, NULL);
        assert_true(H5Pset_chunk(plist, cases[i].rank, chunk) >= 0);
        hid_t set = H5Dcreate2(file, cases[i].name, H5T_IEEE_F64LE, space, H5P_DEFAULT, plist, H5P_DEFAULT);
        assert_true(set >= 0 && H5Dclose(set) >= 0 && H5Sclose(space) >= 0);
        assert_true(H5Pclose(plist) >= 0 && H5Fclose(file) >= 0);
        assert_refused(read_data, path, LG_FORMAT, cases[i].name, "");
    }
}

TEST("an attribute of the wrong type or value is refused by name") {
    static const struct {
        const char *name;
        double value;
        lg_status status;
        const char *word;
    } reals[] = {{"length", NAN, LG_NOT_FINITE, "positive"},      {"length", 0, LG_FORMAT, "positive"},
                 {"length", -3.3, LG_FORMAT, "positive"},         {"length", 1, LG_FORMAT, "apart"},
                 {"length", INFINITY, LG_NOT_FINITE, "positive"}, {"stiffness", -1, LG_FORMAT, "positive"},
                 {"stiffness", NAN, LG_NOT_FINITE, "positive"}};
    for (size_t i = 0; i < LG_COUNT(reals); i++) {
        const char *path = good_file();
        replace_attribute(path, "/", reals[i].name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &reals[i].value);
        assert_refused(read_data, path, reals[i].status, reals[i].name, reals[i].word);
    }
    static const char *const texts[][3] = {
        {"values", "exact", "discrete"}, {"length", "long", "number"}, {"kind", "trajectories", "elastica"}};
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        const char *path = good_file();
        replace_text(path, "/", texts[i][0], texts[i][1]);
        assert_refused(read_data, path, LG_FORMAT, texts[i][0], texts[i][2]);
    }
    const char *path = good_file();
    replace_integer(path, "/", "format_version", 2);
    assert_refused(read_data, path, LG_VERSION, "format_version", "2");
    path = good_file();
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
    assert_refused(read_data, path, LG_FORMAT, "length 0", "");
}

TEST("curves that could not be read are not written") {
    lg_elastica_data data;
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    make_curves(3.3, INTERVALS, CURVES, true, &data);
    data.curves.v[2 * NODES + 5] = NAN;
    assert_status(lg_elastica_data_write(NULL, path, &data, &error), LG_NOT_FINITE);
    assert_non_null(strstr(error.message, "/v"));
    assert_non_null(strstr(error.message, "(1, 2, 1)"));
    data.curves.v[2 * NODES + 5] = 0;
    data.curves.energy[3] = INFINITY;
    assert_status(lg_elastica_data_write(NULL, path, &data, NULL), LG_NOT_FINITE);
    data.curves.energy[3] = 0;
    data.curves.kind[1] = 2;
    assert_status(lg_elastica_data_write(NULL, path, &data, NULL), LG_INVALID_ARGUMENT);
    data.curves.kind[1] = 1;
    data.curves.length = 0;
    assert_status(lg_elastica_data_write(NULL, path, &data, NULL), LG_INVALID_ARGUMENT);
    data.curves.length = NAN;
    assert_status(lg_elastica_data_write(NULL, path, &data, NULL), LG_NOT_FINITE);
    data.curves.length = 3.3;
    assert_status(lg_elastica_data_write(NULL, scratch_path("no/folder.h5"), &data, NULL), LG_FILE);
    assert_status(lg_elastica_data_write(NULL, NULL, &data, NULL), LG_INVALID_ARGUMENT);
    assert_int_not_equal(access(path, F_OK), 0);
    lg_elastica_data_destroy(&data);
    assert_status(lg_elastica_data_write(NULL, path, &data, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_elastica_data_read(NULL, NULL, NULL, &data, NULL), LG_INVALID_ARGUMENT);
}

/* ---- memory ---- */

static lg_status write_step(const lg_context *context, void *user, lg_error *error) {
    lg_elastica_data data;
    make_curves(3.3, INTERVALS, CURVES, true, &data);
    const lg_status status = lg_elastica_data_write(context, user, &data, error);
    lg_elastica_data_destroy(&data);
    return status;
}

TEST("every allocation may fail, and nothing leaks") {
    const char *path = good_file();
    assert_true(fail_every_reading(read_data, path) >= 7);
    assert_true(fail_every_allocation(write_step, (void *)path) >= 4);
    delete_attribute(path, "/", "length");
    assert_true(fail_every_reading(read_data, path) >= 8);
}
