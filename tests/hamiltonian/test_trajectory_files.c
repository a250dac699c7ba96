/* Trajectory data: written and read back, files of other programs, tables of damages. */
#include <sys/resource.h>
#include <sys/stat.h>

#include "support/constraints.h"
#include "support/io_test.h"
#include "hamiltonian/files/family.h"
#include "hamiltonian/internal.h"

OWNED(lg_trajectories, lg_trajectories_destroy)

/* N trajectories of a chain on T*S^2, with noise on all points but the first. */
static lg_trajectories *make_chain(uint32_t links, size_t count, size_t points) {
    lg_trajectories *out = own_lg_trajectories((lg_trajectories){.n = 0});
    lg_rng rng = test_rng(7, links);
    assert_ok(lg_trajectories_create(NULL, "pendulum-chain", &lg_hamiltonian_chain, links, count, points, 0.1,
                                     true, 2, out));
    for (size_t i = 0; i < count * points * links; i++) {
        double *q = out->data + 6 * i, u[3], length = 0;
        bool start = i % (points * links) < links;
        for (int j = 0; j < 3; j++)
            q[j] = lg_rng_normal(&rng), u[j] = lg_rng_uniform(&rng), length += q[j] * q[j];
        for (int j = 0; j < 3; j++) q[j] /= sqrt(length) * (start ? 1.0 : 1.1);
        for (int j = 0; j < 3; j++)
            q[3 + j] = q[(j + 1) % 3] * u[(j + 2) % 3] - q[(j + 2) % 3] * u[(j + 1) % 3];
    }
    for (size_t i = 0; i < count; i++) out->hamiltonian[i] = lg_rng_normal(&rng);
    for (size_t i = 0; i < count * (points - 1) * 2; i++) out->inputs[i] = lg_rng_normal(&rng);
    out->provenance.has_seed = true;
    out->provenance.seed = 12345678901234567890u;
    (void)snprintf(out->provenance.command, sizeof out->provenance.command,
                   "lg-hamiltonian generate p\xc3\xa9ndulum.yaml");
    return out;
}

static void write_one_link(const char *path) {
    assert_ok(lg_trajectories_write(NULL, path, make_chain(1, 3, 5), NULL));
}

static const char *good_file(void) {
    return fresh_copy("good.h5", write_one_link);
}

static void write_two_links(const char *path) {
    assert_ok(lg_trajectories_write(NULL, path, make_chain(2, 3, 5), NULL));
}

static const char *two_links(void) {
    return fresh_copy("two.h5", write_two_links);
}

static lg_trajectories *read_trajectories(const char *path) {
    lg_trajectories data;
    assert_told(lg_trajectories_read(NULL, path, NULL, &data, &told));
    return own_lg_trajectories(data);
}

static lg_status read_and_free(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_error *error) {
    lg_trajectories data;
    lg_status status = lg_trajectories_read(context, path, options, &data, error);
    if (status == LG_OK) lg_trajectories_destroy(&data);
    return status;
}

TEST("trajectories are read back as they were written") {
    for (uint32_t links = 1; links <= 3; links++) {
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        lg_trajectories *d = make_chain(links, 4, 5);
        assert_ok(lg_trajectories_write(NULL, path, d, NULL));
        lg_trajectories *a = read_trajectories(path);
        assert_string_equal(a->system, "pendulum-chain");
        assert_ptr_equal(a->family, &lg_hamiltonian_chain);
        assert_true(a->n == links && a->state_dim == 6 * links);
        assert_true(a->count == 4 && a->points == 5 && a->input_dim == 2);
        assert_memory_equal(a->t, d->t, 5 * sizeof(double));
        assert_memory_equal(a->data, d->data, 4 * 5 * 6 * links * sizeof(double));
        assert_memory_equal(a->hamiltonian, d->hamiltonian, 4 * sizeof(double));
        assert_memory_equal(a->inputs, d->inputs, 4 * 4 * 2 * sizeof(double));
        assert_close(a->dt, 0.025, 1e-15, 0);
        assert_string_equal(a->sha256, d->sha256);
        assert_string_equal(a->provenance.command, d->provenance.command);
        assert_true(a->provenance.has_seed && a->provenance.seed == 12345678901234567890u);
        assert_ok(lg_trajectories_write(NULL, second, a, NULL));
        assert_same_bytes(path, second);
    }
}

TEST("the system that made the data is read back, with all its parameters") {
    const double gravity = 9.81, masses[2] = {1, 1.3}, lengths[2] = {1, 0.8};
    const lg_named_values given[] = {
        {"gravity", &gravity, 1}, {"masses", masses, 2}, {"lengths", lengths, 2}};
    lg_system_options options;
    lg_system *system = NULL, *quartic = NULL;
    lg_system_options_init(&options);
    options.form = "hamiltonian", options.parameters = given, options.parameter_count = 3;
    options.links = 2;
    assert_ok(lg_system_create(NULL, "pendulum-chain", &options, &system, NULL));
    assert_ok(lg_system_create(NULL, "quartic", NULL, &quartic, NULL));
    const char *path = scratch_path("truth.h5");
    lg_trajectories *data = make_chain(2, 3, 4), *short_one = make_chain(1, 3, 4);
    assert_null(data->truth);
    assert_status(lg_trajectories_set_truth(data, quartic), LG_INVALID_ARGUMENT);
    assert_status(lg_trajectories_set_truth(short_one, system), LG_INVALID_ARGUMENT);
    data->family = &lg_hamiltonian_separable; /* not the family of the system */
    assert_status(lg_trajectories_set_truth(data, system), LG_INVALID_ARGUMENT);
    data->family = &lg_hamiltonian_chain;
    lg_trajectories *plain = own_lg_trajectories((lg_trajectories){.n = 0});
    assert_ok(
        lg_trajectories_create(NULL, "quartic", &lg_hamiltonian_separable, 2, 1, 2, 1, false, 0, plain));
    assert_ok(lg_trajectories_set_truth(plain, quartic));
    plain->n = 3; /* the system has 2 */
    assert_status(lg_trajectories_set_truth(plain, quartic), LG_INVALID_ARGUMENT);
    plain->n = 2;
    assert_ok(lg_trajectories_set_truth(data, system));
    assert_ok(lg_trajectories_set_truth(data, system)); /* replaces the first one */
    lg_system_destroy(system);
    lg_system_destroy(quartic);
    assert_ok(lg_trajectories_write(NULL, path, data, NULL));
    const lg_trajectories *back = read_trajectories(path);
    assert_non_null(back->truth);
    assert_string_equal(lg_system_form(back->truth), "hamiltonian");
    assert_int_equal(lg_system_parameter_count(back->truth), 5);
    assert_memory_equal(lg_system_parameter_values(back->truth), ((double[]){9.81, 1, 1.3, 1, 0.8}), 40);
    const hsize_t one = 1, row[2] = {1, 2}, square[2] = {2, 2};
    replace_dataset(path, "parameters/masses", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, row, masses);
    replace_dataset(path, "parameters/gravity", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 0, NULL, &gravity);
    const lg_trajectories *other = read_trajectories(path);
    assert_memory_equal(lg_system_parameter_values(other->truth), ((double[]){9.81, 1, 1.3, 1, 0.8}), 40);
    replace_dataset(path, "parameters/masses", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, square,
                    (double[]){1, 2, 3, 4});
    assert_refused(read_and_free, path, LG_FORMAT, "/parameters/masses", "(2, 2)");
    replace_dataset(path, "parameters/masses", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &one, masses);
    assert_refused(read_and_free, path, LG_FORMAT, "/parameters", "masses");
    delete_link(path, "parameters/masses");
    assert_null(read_trajectories(path)->truth);
    /* No matter in which order: without one of them the others are not read. */
    replace_dataset(path, "parameters/masses", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, square,
                    (double[]){1, 2, 3, 4});
    delete_link(path, "parameters/lengths");
    assert_null(read_trajectories(path)->truth);
    replace_dataset(path, "parameters/lengths", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, row, lengths);
    delete_link(path, "parameters/gravity");
    assert_null(read_trajectories(path)->truth);
}

TEST("no system has more parameters than a file of trajectories takes") {
    const char *name, *form;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
        size_t count = 0;
        for (const lg_parameter_entry *row = lg_system_parameters(name, form); row->key != NULL; row++) {
            count++;
            assert_true(row->fallback != NULL || row->count <= LG_MOST_VALUES);
        }
        assert_true(count <= LG_MOST_PARAMETERS);
    }
}

TEST("the hash is computed from t, data and inputs as little-endian doubles") {
    lg_trajectories *data = make_chain(1, 2, 3);
    lg_sha256 sha;
    char digest[LG_SHA256_TEXT];
    assert_ok(lg_trajectories_write(NULL, scratch_path("hash.h5"), data, NULL));
    lg_sha256_init(&sha);
    sha256_add_little_endian(&sha, data->t, 3);
    sha256_add_little_endian(&sha, data->data, 2 * 3 * 6);
    sha256_add_little_endian(&sha, data->inputs, 2 * 2 * 2);
    lg_sha256_finish(&sha, digest);
    assert_string_equal(data->sha256, digest);
    data->data[17] = nextafter(data->data[17], 2);
    assert_ok(lg_trajectories_write(NULL, scratch_path("hash.h5"), data, NULL));
    assert_string_not_equal(data->sha256, digest);
}

/* ---- files of other programs ---- */

static void bare_file(const char *path) {
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(file >= 0 && H5Fclose(file) >= 0);
}

TEST("numbers are read in the types of other programs") {
    /* Big-endian floats, 16-bit integers as times, texts of variable length, none of our attributes. */
    const char *path = scratch_path("foreign.h5");
    const float points[2 * 3 * 4] = {0.5f, -0.25f, 1, 0, 0.5f, -0.125f, 1,  1,  2,  3,  4,  5,
                                     6,    7,      8, 9, 10,   11,      12, 13, 14, 15, 16, 17};
    const int times[3] = {4, 6, 8};
    const hsize_t shape[3] = {2, 3, 4}, three = 3, two = 2;
    const int energies[2] = {-3, 250};
    bare_file(path);
    replace_dataset(path, "trajectories", H5T_IEEE_F32BE, H5T_NATIVE_FLOAT, 3, shape, points);
    replace_dataset(path, "t", H5T_STD_I16BE, H5T_NATIVE_INT, 1, &three, times);
    replace_dataset(path, "hamiltonian", H5T_STD_I32LE, H5T_NATIVE_INT, 1, &two, energies);
    replace_text(path, "/", "system", "quartic");
    replace_text(path, "/", "layout", "q p");
    replace_integer(path, "/", "links", 1); /* has no meaning here, and is ignored */
    replace_text(path, "/", "format", "somebody else's");
    replace_integer(path, "/", "format_version", 99);
    const lg_trajectories *data = read_trajectories(path);
    assert_string_equal(data->system, "quartic");
    assert_ptr_equal(data->family, &lg_hamiltonian_separable);
    assert_true(data->n == 2 && data->dt == 2 && data->hamiltonian[1] == 250 && data->inputs == NULL);
    for (int i = 0; i < 24; i++) assert_close(data->data[i], points[i], 0, 0);
    replace_text(path, "/", "layout", "q1 p1 q2 p2");
    assert_refused(read_and_free, path, LG_FORMAT, "layout", "expected 'q p' for quartic");
    delete_attribute(path, "/", "system");
    assert_refused(read_and_free, path, LG_FORMAT, "layout", "for this system");
}

TEST("texts are read in the types of other programs") {
    static const H5T_str_t pads[] = {H5T_STR_NULLTERM, H5T_STR_NULLPAD, H5T_STR_SPACEPAD};
    for (size_t i = 0; i < LG_COUNT(pads); i++) {
        const char *path = two_links();
        hid_t type = H5Tcopy(H5T_C_S1);
        assert_true(type >= 0 && H5Tset_size(type, 20) >= 0 && H5Tset_strpad(type, pads[i]) >= 0);
        replace_attribute(path, "/", "system", type, type,
                          i == 2 ? "pendulum-chain      " : "pendulum-chain\0\0\0\0\0\0");
        assert_true(H5Tclose(type) >= 0);
        replace_text(path, "/", "layout", "q_1, p_1, q_2, p_2");
        assert_string_equal(read_trajectories(path)->system, "pendulum-chain");
    }
}

TEST("attributes that follow from the data may be left out") {
    static const char *const names[] = {"system",         "links", "layout", "format",
                                        "format_version", "kind",  "seed",   "liegrad_version"};
    const char *path = two_links();
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        delete_attribute(path, "/", names[i]);
        const lg_trajectories *data = read_trajectories(path);
        assert_true(data->family == &lg_hamiltonian_chain && data->n == 2);
        assert_int_equal(data->guessed, i >= 2); /* without system and layout */
    }
    delete_link(path, "hamiltonian");
    delete_link(path, "inputs");
    const lg_trajectories *data = read_trajectories(path);
    assert_true(data->hamiltonian == NULL && data->inputs == NULL);
    /* Attributes on the data set; a user's system with a layout. */
    replace_text(path, "trajectories", "system", "double spherical pendulum on a cart");
    assert_refused(read_and_free, path, LG_FORMAT, "system", "layout");
    replace_text(path, "trajectories", "system", "quadrotors");
    assert_refused(read_and_free, path, LG_FORMAT, "system", "lg-identify");
    replace_text(path, "trajectories", "system", "double spherical pendulum on a cart");
    replace_text(path, "trajectories", "layout", "q1 p1 q2 p2");
    assert_string_equal(read_trajectories(path)->system, "double spherical pendulum on a cart");
    replace_text(path, "trajectories", "system", test_text("%0*d", LG_SYSTEM_NAME, 0));
    assert_refused(read_and_free, path, LG_FORMAT, "system", "");
    const lg_read_options here = without_probe();
    assert_status(read_and_free(NULL, path, &here, NULL), LG_FORMAT);
    /* With one link both layouts are the same. */
    path = good_file();
    replace_text(path, "/", "layout", "q p");
    assert_int_equal(read_trajectories(path)->n, 1);
    /* The layout of a body does not become that of another family because of the number of numbers. */
    delete_attribute(path, "/", "system");
    replace_text(path, "/", "layout", "R pi");
    assert_refused(read_and_free, path, LG_FORMAT, "trajectories", "d = 6, expected 12 numbers");
}

TEST("times stored as floats count as equidistant to their rounding") {
    const char *path = good_file();
    const hsize_t five = 5;
    const double times[5] = {1000.0, 1000.025, 1000.05, 1000.075, 1000.1};
    replace_dataset(path, "t", H5T_IEEE_F32LE, H5T_NATIVE_DOUBLE, 1, &five, times);
    assert_ok(read_and_free(NULL, path, NULL, NULL));
    const double uneven[5] = {0, 0.025, 0.0501, 0.075, 0.1};
    replace_dataset(path, "t", H5T_IEEE_F32LE, H5T_NATIVE_DOUBLE, 1, &five, uneven);
    assert_refused(read_and_free, path, LG_FORMAT, "/t", "equidistant");
    const double endless[5] = {-1.7e308, -1e308, 0, 1e308, 1.7e308};
    replace_dataset(path, "t", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &five, endless);
    assert_refused(read_and_free, path, LG_FORMAT, "/t", "not a finite number");
}

/* Parts on the manifold of any family: R = I, q = e3 with p across, or numbers. */
static void put_state(const lg_space *space, double *y) {
    for (size_t f = 0, at = 0; f < space->factors; f++)
        for (size_t i = 0; i < space->factor[f].count; i++) {
            const lg_space_kind kind = space->factor[f].kind;
            const size_t size = lg_space_kind_entry(kind)->state;
            for (size_t k = 0; k < size; k++)
                y[at + k] = kind == LG_SPACE_SO3   ? k % 4 == 0
                            : kind == LG_SPACE_TS2 ? k == 2 || k == 3
                                                   : 0.25;
            at += size;
        }
}

TEST("for every family data without a system are read back, and a mirrored rotation is refused") {
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        const lg_hamiltonian_family *family = lg_hamiltonian_family_at(i);
        lg_trajectories *data = own_lg_trajectories((lg_trajectories){.n = 0});
        const char *path = scratch_path("family.h5");
        lg_space space;
        if (family->constrained) continue;
        assert_ok(lg_hamiltonian_space(family, 1, &space));
        assert_ok(lg_trajectories_create(NULL, "", family, 1, 2, 3, 1, false, 0, data));
        for (size_t k = 0; k < 2 * 3; k++) put_state(&space, data->data + k * space.dim);
        assert_ok(lg_trajectories_write(NULL, path, data, NULL));
        const lg_trajectories *back = read_trajectories(path);
        assert_string_equal(back->family->name, family->name);
        assert_memory_equal(back->data, data->data, 2 * 3 * space.dim * sizeof *data->data);
        if (space.factor[0].kind != LG_SPACE_SO3) continue;
        data->data[8] = -1.0;
        assert_ok(lg_trajectories_write(NULL, path, data, NULL));
        assert_refused(read_and_free, path, LG_FORMAT, "off the manifold by 2", "R^T R = I");
    }
}

/* ---- invalid files ---- */

TEST("a damaged file is refused") {
    refuse_damaged_files(read_and_free, good_file(), "");
    survive_changed_bytes(read_and_free, good_file(), 400);
}

static void put_doubles(const char *path, const char *name, int rank, const hsize_t *dims, size_t bad,
                        double value) {
    size_t count = 1;
    for (int i = 0; i < rank; i++) count *= (size_t)dims[i];
    double *data = TEST_ARRAY(double, count);
    for (size_t i = 0; i < count; i++) data[i] = strcmp(name, "t") == 0 ? (double)i : i % 6 == 0 ? 1.0 : 0.0;
    if (bad < count) data[bad] = value;
    replace_dataset(path, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, rank, dims, data);
}

TEST("a column or a row is read where a list is wanted") {
    const lg_trajectories *good = read_trajectories(good_file());
    for (int row = 0; row < 2; row++) {
        const char *path = good_file();
        const hsize_t times[2] = {row ? 1 : 5, row ? 5 : 1}, runs[2] = {row ? 1 : 3, row ? 3 : 1};
        replace_dataset(path, "t", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, 2, times, good->t);
        replace_dataset(path, "hamiltonian", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, runs, good->hamiltonian);
        const lg_trajectories *back = read_trajectories(path);
        assert_string_equal(back->sha256, good->sha256);
        assert_memory_equal(back->hamiltonian, good->hamiltonian, 3 * sizeof(double));
        put_doubles(path, "t", 2, times, 3, NAN);
        assert_refused(read_and_free, path, LG_NOT_FINITE, "/t: NaN at index", row ? "(0, 3)" : "(3, 0)");
    }
}

/* Replaces the times of a good file by texts of variable length, in a column. */
static void replace_times(const char *path, const char *const times[5]) {
    const hsize_t column[2] = {5, 1};
    hid_t text = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(text, H5T_VARIABLE) >= 0);
    replace_dataset(path, "t", text, text, 2, column, times);
    assert_true(H5Tclose(text) >= 0);
}

TEST("times may be dates, which become seconds since the first one") {
    const char *path = good_file();
    const char *dates[5] = {"2024-02-29T23:59:59.975Z", "2024-03-01T00:00:00Z", "2024-03-01T00:00:00.025Z",
                            "2024-03-01T01:00:00.05+01:00", "2024-03-01T00:00:00.075Z"};
    replace_times(path, dates);
    const lg_trajectories *back = read_trajectories(path);
    for (int i = 0; i < 5; i++) assert_close(back->t[i], 0.025 * i, 1e-15, 0);
    dates[3] = "00:00:00.05";
    replace_times(path, dates);
    assert_refused(read_and_free, path, LG_FORMAT, "/t: the text at index (3) is no time in the format", "");
    dates[0] = "soon";
    replace_times(path, dates);
    assert_refused(read_and_free, path, LG_FORMAT, "/t: the text at index (0) is no time: write numbers",
                   "dates such as 2024-");
}

TEST("times as texts count as equidistant to their last digit") {
    static const struct {
        const char *times[5];
        double dt; /* 0: the times are rejected */
    } rows[] = {
        {{"0.000000", "0.016667", "0.033333", "0.050000", "0.066667"}, 1 / 60.},
        {{"0", "0.016667", "0.033333", "0.05", "0.066667"}, 1 / 60.},
        {{"9.983333", "10", "10.01667", "10.03333", "10.05"}, 1 / 60.},
        {{"0", "1.667e-02", "3.333E-02", "5e-2", "6.667e-02"}, 1 / 60.},
        {{"1700000000.000000000", "1700000000.014285714", "1700000000.028571429", "1700000000.042857143",
          "1700000000.057142857"},
         1 / 70.},
        {{"2024-03-01T12:00:00Z", "2024-03-01T12:00:00.016667Z", "2024-03-01T12:00:00.033333Z",
          "2024-03-01T12:00:00.05Z", "2024-03-01T12:00:00.066667Z"},
         1 / 60.},
        {{"9:59:59.983", "10:00:00.000", "10:00:00.017", "10:00:00.033", "10:00:00.050"}, 1 / 60.},
        /* Clocks have nanoseconds. */
        {{"12:00:00.000000000000", "12:00:00.000033333333", "12:00:00.000066666666", "12:00:00.000100000000",
          "12:00:00.000133333333"},
         1 / 30000.},
        {{"0.000000", "0.016667", "0.033335", "0.050000", "0.066667"}, 0},
        {{"0", "1.667e-02", "3.353e-02", "5e-2", "6.667e-02"}, 0},
        {{"0.000000", "0.012500", "0.025010", "0.0375", "0.05"}, 0},
        {{"2024-03-01T12:00:00Z", "2024-03-01T12:00:00.016667Z", "2024-03-01T12:00:00.033343Z",
          "2024-03-01T12:00:00.05Z", "2024-03-01T12:00:00.066667Z"},
         0},
        /* A point is missing. */
        {{"0", "1", "2", "4", "5"}, 0},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *path = good_file();
        replace_times(path, rows[i].times);
        if (rows[i].dt == 0)
            assert_refused(read_and_free, path, LG_FORMAT, "/t: the times are not equidistant", "");
        else
            assert_close(read_trajectories(path)->dt, rows[i].dt, 0.02, 0);
    }
}

/* One case per row: a data set that replaces the good one (3 trajectories, 5 points, d = 6). */
typedef struct bad_data {
    const char *name;
    int rank;
    hsize_t dims[4];
    size_t bad; /* index of the invalid value, SIZE_MAX for none */
    double value;
    lg_status status;
    const char *word1, *word2;
} bad_data;

TEST("a data set of a wrong shape or value is refused by name") {
    const bad_data cases[] = {
        {"t", 2, {5, 2}, SIZE_MAX, 0, LG_FORMAT, "/t", "(5, 2), expected (5 points as in /trajectories)"},
        {"t", 1, {4}, SIZE_MAX, 0, LG_FORMAT, "/t", "4"},
        {"t", 1, {0}, SIZE_MAX, 0, LG_FORMAT, "/t", ""},
        {"t", 1, {5}, 3, NAN, LG_NOT_FINITE, "/t", "(3)"},
        {"t", 1, {5}, 2, 1.5, LG_FORMAT, "/t", "equidistant"},
        {"t", 1, {5}, 2, 1.0, LG_FORMAT, "/t", "increase"},
        {"t", 1, {5}, 4, -9.0, LG_FORMAT, "/t", "increase"},
        {"trajectories", 2, {15, 6}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", "(15, 6)"},
        {"trajectories", 4, {3, 5, 6, 1}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", "(3, 5, 6, 1)"},
        {"trajectories", 3, {3, 1, 6}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", "M >= 2"},
        {"trajectories", 3, {0, 5, 6}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", ">= 1 trajectories"},
        {"trajectories", 3, {3, 5, 5}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", "d = 5"},
        {"trajectories", 3, {3, 5, 12}, SIZE_MAX, 0, LG_FORMAT, "links", "12"},
        {"trajectories", 3, {3, 5, 198}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", "198"},
        {"trajectories", 3, {3, 5, 6}, 31, NAN, LG_NOT_FINITE, "/trajectories", "(1, 0, 1)"},
        {"trajectories", 3, {3, 5, 6}, 89, -INFINITY, LG_NOT_FINITE, "/trajectories", "(2, 4, 5)"},
        {"trajectories", 3, {3, 5, 6}, 30, 1.00001, LG_FORMAT, "/trajectories", "trajectory 1"},
        {"trajectories", 3, {3, 5, 6}, 63, 0.001, LG_FORMAT, "/trajectories", "trajectory 2"},
        {"hamiltonian", 1, {4}, SIZE_MAX, 0, LG_FORMAT, "/hamiltonian", "4"},
        {"hamiltonian", 2, {3, 3}, SIZE_MAX, 0, LG_FORMAT, "/hamiltonian", "(3, 3)"},
        {"hamiltonian", 1, {3}, 2, NAN, LG_NOT_FINITE, "/hamiltonian", "(2)"},
        {"inputs",
         3,
         {3, 5, 2},
         SIZE_MAX,
         0,
         LG_FORMAT,
         "/inputs",
         "(3 trajectories as in /trajectories, 4 intervals, >= 1 inputs)"},
        {"inputs", 2, {3, 4}, SIZE_MAX, 0, LG_FORMAT, "/inputs", "(3, 4)"},
        {"inputs",
         3,
         {2, 4, 2},
         SIZE_MAX,
         0,
         LG_FORMAT,
         "/inputs",
         "(3 trajectories as in /trajectories, 4 intervals, >= 1 inputs)"},
        {"inputs",
         3,
         {3, 4, 0},
         SIZE_MAX,
         0,
         LG_FORMAT,
         "/inputs",
         "(3 trajectories as in /trajectories, 4 intervals, >= 1 inputs)"},
        {"trajectories", 3, {3, 5, 1}, SIZE_MAX, 0, LG_FORMAT, "/trajectories", "d of 2 to"},
        {"inputs", 3, {3, 4, 2}, 9, NAN, LG_NOT_FINITE, "/inputs", "(1, 0, 1)"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const bad_data *c = &cases[i];
        const char *path = good_file();
        put_doubles(path, c->name, c->rank, c->dims, c->bad, c->value);
        assert_refused(read_and_free, path, c->status, c->word1, c->word2);
    }
    /* Noise off the manifold is allowed at all points but the first. */
    const char *path = good_file();
    put_doubles(path, "trajectories", 3, (const hsize_t[]){3, 5, 6}, 36, 1.5);
    assert_ok(read_and_free(NULL, path, NULL, NULL));
}

/* Starts off the sphere, sizes that are no multiple of 6, and too many links. */
TEST("data that name neither system nor layout get the first family whose manifold contains the starts") {
    static const uint32_t sizes[] = {2, 3, 35};
    for (size_t i = 0; i < LG_COUNT(sizes); i++) {
        lg_trajectories *data = own_lg_trajectories((lg_trajectories){.n = 0});
        const uint32_t n = sizes[i] > LG_HAMILTONIAN_MAX_COPIES ? LG_HAMILTONIAN_MAX_COPIES : sizes[i];
        const char *path = scratch_path("guess.h5");
        assert_ok(lg_trajectories_create(NULL, "", &lg_hamiltonian_separable, n, 2, 3, 1, false, 0, data));
        for (size_t k = 0; k < 2 * 3 * 2 * (size_t)n; k++) data->data[k] = 0.5 + 0.01 * (double)k;
        assert_ok(lg_trajectories_write(NULL, path, data, NULL));
        delete_attribute(path, "/", "layout");
        delete_attribute(path, "/", "system");
        if (sizes[i] > LG_HAMILTONIAN_MAX_COPIES) {
            put_doubles(path, "trajectories", 3, (const hsize_t[]){2, 3, 2 * sizes[i]}, SIZE_MAX, 0);
            assert_refused(read_and_free, path, LG_FORMAT, "/trajectories", "d = 70");
            continue;
        }
        const lg_trajectories *back = read_trajectories(path);
        assert_true(back->guessed && back->family == &lg_hamiltonian_separable && back->n == n);
    }
}

TEST("momenta off the cotangent space are refused, whatever their unit") {
    static const double units[] = {1e-9, 1.0, 1e9};
    for (size_t i = 0; i < LG_COUNT(units); i++)
        for (int off = 0; off < 2; off++) {
            lg_trajectories set;
            const char *path = good_file();
            assert_ok(lg_trajectories_read(NULL, path, NULL, &set, NULL));
            for (size_t k = 0; k < set.count * set.points; k++) {
                double *q = set.data + k * 6, *p = q + 3;
                const double along = off && k == 0 ? 0.5 * hypot(hypot(p[0], p[1]), p[2]) : 0.0;
                for (size_t c = 0; c < 3; c++) p[c] = units[i] * (p[c] + along * q[c]);
            }
            assert_ok(lg_trajectories_write(NULL, path, &set, NULL));
            lg_trajectories_destroy(&set);
            assert_status(read_and_free(NULL, path, NULL, NULL), off ? LG_FORMAT : LG_OK);
        }
}

TEST("first points off the manifold are projected if requested, and the distance is returned") {
    lg_read_options options;
    lg_trajectories set;
    const char *path = good_file();
    put_doubles(path, "trajectories", 3, (const hsize_t[]){3, 5, 6}, 30, 1.25);
    lg_read_options_init(&options);
    assert_status(lg_trajectories_read(NULL, path, &options, &set, NULL), LG_FORMAT);
    options.project_starts = true;
    assert_ok(lg_trajectories_read(NULL, path, &options, &set, NULL));
    assert_true(set.starts_off > 0.1);
    for (size_t i = 0; i < set.count; i++) {
        const double *q = set.data + i * set.points * set.state_dim, *p = q + 3;
        assert_close(q[0] * q[0] + q[1] * q[1] + q[2] * q[2], 1, 1e-14, 0);
        assert_close(q[0] * p[0] + q[1] * p[1] + q[2] * p[2], 0, 0, 1e-14);
    }
    lg_trajectories_destroy(&set);
}

TEST("a value of a wrong type is refused") {
    static const char *const names[] = {"t", "trajectories", "hamiltonian", "inputs"};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        const char *path = good_file();
        hid_t text = H5Tcopy(H5T_C_S1);
        hsize_t one = 1;
        const char *key = test_text("/%s", names[i]);
        assert_true(text >= 0 && H5Tset_size(text, 4) >= 0);
        replace_dataset(path, names[i], text, text, 1, &one, "abc");
        assert_true(H5Tclose(text) >= 0);
        assert_refused(read_and_free, path, LG_FORMAT, key, i == 0 ? "(1), expected (5 points" : "numbers");
        hid_t file = open_for_change(path);
        assert_true(H5Ldelete(file, names[i], H5P_DEFAULT) >= 0);
        hid_t group = H5Gcreate2(file, names[i], H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
        assert_true(group >= 0 && H5Gclose(group) >= 0 && H5Fclose(file) >= 0);
        assert_refused(read_and_free, path, LG_FORMAT, key, "not a data set");
        if (i >= 2) continue;
        delete_link(path, names[i]);
        assert_refused(read_and_free, path, LG_FORMAT, key, "has no");
    }
}

TEST("a wrong attribute is refused by name, and a size without data too") {
    static const damage of_one[] = {
        {"trajectories", DECLARED((hsize_t)1 << 40, 5, 6), LG_FORMAT, ""},
        {"trajectories", DECLARED((hsize_t)1 << 62, (hsize_t)1 << 62, 6), LG_FORMAT, ""},
        {"trajectories", DECLARED(1u << 20, 64, 6), LG_FORMAT, ""}};
    static const damage of_two[] = {{"@format_version", WHOLE(3), LG_VERSION, "3"},
                                    {"@format_version", REAL(3), LG_VERSION, "3"},
                                    {"@format_version", TEXT("1"), LG_FORMAT, ""},
                                    {"@kind", TEXT("hamiltonian"), LG_FORMAT, "trajectories"},
                                    {"@layout", TEXT("q p"), LG_FORMAT, ""},
                                    {"@layout", TEXT("p q"), LG_FORMAT, ""},
                                    {"@layout", TEXT("q1 q2 p1 p2"), LG_FORMAT, "q1 p1 q2 p2"},
                                    {"@system", TEXT("quartic"), LG_FORMAT, "~quartic"},
                                    {"@system", WHOLE(1), LG_FORMAT, "text"},
                                    {"@links", TEXT("two"), LG_FORMAT, "integer"},
                                    {"@links", WHOLE(3), LG_FORMAT, "3"},
                                    {"@links", REAL(3), LG_FORMAT, "links is 3"},
                                    {"@links", REAL(2.5), LG_FORMAT, "integer"},
                                    {"@links", REAL(-2), LG_FORMAT, "links is -2"},
                                    {"@links", REAL(1e300), LG_FORMAT, "integer"},
                                    {"@links", REAL(NAN), LG_FORMAT, "integer"},
                                    {"@links", REAL(INFINITY), LG_FORMAT, "integer"}};
    refuse_damage(read_and_free, good_file, of_one, LG_COUNT(of_one));
    refuse_damage(read_and_free, two_links, of_two, LG_COUNT(of_two));
}

/* Programs that have only doubles store k as 2.0, which is read as the integer. */
TEST("integers stored as whole doubles are read") {
    const double wide = 2;
    const float narrow = 2;
    const char *path = two_links();
    replace_attribute(path, "/", "links", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &wide);
    assert_ok(read_and_free(NULL, path, NULL, NULL));
    replace_attribute(path, "/", "links", H5T_IEEE_F32BE, H5T_NATIVE_FLOAT, &narrow);
    assert_ok(read_and_free(NULL, path, NULL, NULL));
}

TEST("data in other files, behind external links, are not read") {
    const char *target = scratch_path("target.h5");
    assert_ok(lg_trajectories_write(NULL, target, make_chain(1, 3, 5), NULL));
    const char *path = good_file();
    hid_t file = open_for_change(path);
    assert_true(H5Ldelete(file, "t", H5P_DEFAULT) >= 0);
    assert_true(H5Lcreate_external(target, "/t", file, "t", H5P_DEFAULT, H5P_DEFAULT) >= 0 &&
                H5Fclose(file) >= 0);
    assert_refused(read_and_free, path, LG_FORMAT, "/t", "");
    file = open_for_change(path);
    hid_t create = H5Pcreate(H5P_DATASET_CREATE);
    hsize_t five = 5;
    hid_t space = H5Screate_simple(1, &five, NULL);
    assert_true(H5Ldelete(file, "t", H5P_DEFAULT) >= 0 && H5Pset_external(create, target, 0, 40) >= 0);
    hid_t set = H5Dcreate2(file, "t", H5T_IEEE_F64LE, space, H5P_DEFAULT, create, H5P_DEFAULT);
    assert_true(set >= 0 && H5Dclose(set) >= 0 && H5Sclose(space) >= 0 && H5Pclose(create) >= 0 &&
                H5Fclose(file) >= 0);
    assert_refused(read_and_free, path, LG_FORMAT, "/t", "another file");
}

TEST("invalid arguments are refused") {
    lg_trajectories data, untouched;
    memset(&data, 0x5a, sizeof data);
    memcpy(&untouched, &data, sizeof data);
    assert_status(lg_trajectories_read(NULL, scratch_path("nothing"), NULL, &data, NULL), LG_NOT_FOUND);
    const lg_hamiltonian_family *chain = &lg_hamiltonian_chain, *separable = &lg_hamiltonian_separable;
    const char *long_name = test_text("%0*d", LG_SYSTEM_NAME, 0);
    const struct {
        const char *system;
        const lg_hamiltonian_family *family;
        uint32_t links;
        size_t count, points;
        double t_end;
        lg_status status;
    } cases[] = {{"quartic", chain, 2, 1, 2, 1, LG_INVALID_ARGUMENT},
                 {"quartic", separable, 3, 1, 2, 1, LG_INVALID_ARGUMENT},
                 {"", chain, 0, 1, 2, 1, LG_INVALID_ARGUMENT},
                 {"", chain, 33, 1, 2, 1, LG_INVALID_ARGUMENT},
                 {"", chain, 1, 1, 1, 1, LG_INVALID_ARGUMENT},
                 {"", chain, 1, 0, 2, 1, LG_INVALID_ARGUMENT},
                 {"", chain, 1, 1, 2, 0, LG_INVALID_ARGUMENT},
                 {"", NULL, 1, 1, 2, 1, LG_INVALID_ARGUMENT},
                 {long_name, chain, 1, 1, 2, 1, LG_INVALID_ARGUMENT},
                 {"", chain, 1, SIZE_MAX / 2, 5, 1, LG_OUT_OF_MEMORY},
                 {"", chain, 1, 1, 2, NAN, LG_INVALID_ARGUMENT},
                 {"", chain, 1, SIZE_MAX / 8, 5, 1, LG_OUT_OF_MEMORY}};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_status(lg_trajectories_create(NULL, cases[i].system, cases[i].family, cases[i].links,
                                             cases[i].count, cases[i].points, cases[i].t_end, false, 0,
                                             &data),
                      cases[i].status);
    lg_read_options wrong = {.size = 3};
    assert_status(lg_trajectories_read(NULL, good_file(), &wrong, &data, NULL), LG_INVALID_ARGUMENT);
    assert_memory_equal(&data, &untouched, sizeof data);
    lg_trajectories *bad = make_chain(1, 2, 3);
    lg_trajectories empty[4];
    for (size_t i = 0; i < LG_COUNT(empty); i++) empty[i] = *bad;
    empty[0].t = NULL, empty[1].data = NULL, empty[2].count = 0, empty[3].points = 1;
    for (size_t i = 0; i < LG_COUNT(empty); i++)
        assert_status(lg_trajectories_write(NULL, scratch_path("nan.h5"), &empty[i], NULL),
                      LG_INVALID_ARGUMENT);
    lg_trajectories none = {.n = 0};
    assert_status(lg_trajectories_set_constraint(NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_trajectories_set_constraint(&none, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_trajectories_set_constraint(bad, NULL, NULL), LG_INVALID_ARGUMENT);
    lg_trajectories_destroy(NULL);
    lg_trajectories *tied = own_lg_trajectories((lg_trajectories){.n = 0});
    assert_ok(lg_trajectories_create(NULL, "", &lg_hamiltonian_constrained, 4, 1, 2, 1, false, 0, tied));
    lg_program *sphere = make_constraint_program(&constraint_cases[0], &plain_units);
    assert_status(lg_trajectories_set_constraint(tied, sphere, NULL), LG_INVALID_ARGUMENT);
    assert_null(tied->constraint);
    bad->data[20] = NAN;
    assert_status(lg_trajectories_write(NULL, scratch_path("nan.h5"), bad, NULL), LG_NOT_FINITE);
    assert_int_not_equal(access(scratch_path("nan.h5"), F_OK), 0);
}

/* ---- failing memory and disk ---- */

static lg_status write_step(const lg_context *context, void *user, lg_error *error) {
    lg_trajectories *const *data = user;
    return lg_trajectories_write(context, scratch_path("written.h5"), *data, error);
}

static lg_status create_step(const lg_context *context, void *user, lg_error *error) {
    (void)user, (void)error;
    lg_trajectories data;
    lg_status status = lg_trajectories_create(context, "", &lg_hamiltonian_chain, 2, 3, 5, 1, true, 2, &data);
    if (status == LG_OK) lg_trajectories_destroy(&data);
    return status;
}

TEST("every allocation may fail, and nothing leaks") {
    const char *path = two_links();
    lg_trajectories *data = make_chain(2, 3, 5);
    write_text_to(scratch_path("written.h5"), "");
    const size_t files = scratch_files();
    assert_true(fail_every_reading(read_and_free, path) >= 6);
    assert_true(fail_every_allocation(write_step, &data) >= 4);
    assert_int_equal(fail_every_allocation(create_step, NULL), 4);
    assert_int_equal(scratch_files(), files);
}

TEST("a full disk leaves no file") {
    const char *path = good_file(), *copy = scratch_path("copy.h5");
    struct rlimit limit, tight;
    copy_file(path, copy);
    const size_t files = scratch_files();
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    tight = limit;
    lg_trajectories *data = make_chain(3, 30, 5);
    /* The default action of SIGXFSZ would kill the process, so the writer must block it. */
    for (rlim_t bytes = 0; bytes < 4000; bytes += 999) {
        lg_error error = {LG_OK, ""};
        tight.rlim_cur = bytes;
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &tight), 0);
        lg_status status = lg_trajectories_write(NULL, path, data, &error);
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
        assert_int_equal(status, LG_FILE);
        assert_non_null(strstr(error.message, "good.h5"));
        assert_same_bytes(path, copy);
        assert_int_equal(scratch_files(), files);
    }
}

TEST("a place that cannot be written is refused") {
    lg_trajectories *data = make_chain(1, 2, 3);
    const char *const places[] = {"/proc/data.h5", scratch_path("no/such/folder/data.h5"), "/dev/full",
                                  "/dev/null", scratch};
    for (size_t i = 0; i < LG_COUNT(places); i++) {
        lg_error error = {LG_OK, ""};
        assert_status(lg_trajectories_write(NULL, places[i], data, &error), LG_FILE);
        assert_non_null(strstr(error.message, places[i]));
    }
    /* A symbolic link stays a link, and the mode of an old file is kept. */
    const char *target = scratch_path("pointed.h5"), *link_name = scratch_path("link.h5");
    write_text_to(target, "old");
    assert_int_equal(chmod(target, 0640), 0);
    assert_int_equal(symlink(target, link_name), 0);
    assert_ok(lg_trajectories_write(NULL, link_name, data, NULL));
    struct stat about;
    assert_int_equal(lstat(link_name, &about), 0);
    assert_true(S_ISLNK(about.st_mode));
    assert_int_equal(stat(target, &about), 0);
    assert_int_equal(about.st_mode & 0777, 0640);
    assert_ok(read_and_free(NULL, target, NULL, NULL));
}

/* A reader that crashes, loops or uses too much memory in the child process becomes an error in the
 * parent. */
static lg_status dies(void *user, lg_error *error) {
    (void)error;
    if (*(int *)user == 0) abort();
    if (*(int *)user == 1)
        for (volatile int i = 0;; i++) i--;
    volatile int *nowhere = NULL;
    return *nowhere == 0 ? LG_OK : LG_FORMAT;
}

TEST("the probe catches a reader that crashes") {
    const char *path = good_file();
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe_seconds = 1;
    for (int how = 0; how < 3; how++) {
        lg_error error = {LG_OK, ""};
        assert_status(lg_probe(NULL, path, &options, dies, &how, &error), LG_FORMAT);
        assert_non_null(strstr(error.message, "good.h5"));
        assert_non_null(strstr(error.message, "damaged"));
    }
    options.probe = false;
    int how = 0;
    assert_ok(lg_probe(NULL, path, &options, dies, &how, NULL));
}
