/* Labelled series in files: written and read back, files of other programs, tables of damages. */
#include "support/io_test.h"

#include "anomaly/files/recipe.h"
#include "liegrad/series.h"

enum { WINDOWS = 6, CHANNELS = 2, LENGTH = 5, WINDOW = CHANNELS * LENGTH };

static const char *const class_names[] = {"intact", "cracked", "broken"};
static const char *const channel_names[] = {"acc_lower_x", "moment_x"};

static void set_name(char out[LG_SERIES_NAME], const char *name) {
    (void)snprintf(out, LG_SERIES_NAME, "%s", name);
}

static float sample(size_t i) {
    return (float)sin(0.7 * (double)i) * 3;
}

OWNED(lg_series_data, lg_series_data_destroy)

static lg_series_data *make_series(bool full) {
    lg_series_data *out = own_lg_series_data(
        (lg_series_data){.series = {.count = WINDOWS, .channels = CHANNELS, .length = LENGTH, .classes = 3},
                         .noise = NAN,
                         .severity = NAN});
    lg_series *s = &out->series;
    assert_ok(lg_series_allocate(NULL, s, full, full));
    for (size_t i = 0; i < WINDOWS * WINDOW; i++) s->x[i] = sample(i);
    for (size_t i = 0; i < WINDOWS; i++) s->label[i] = i / 3 == 0 ? 0 : 2; /* class 1 does not occur */
    for (size_t c = 0; c < 3; c++) set_name(s->class_name[c], class_names[c]);
    if (!full) return out;
    s->rate = 10;
    s->channel_name = lg_test_gives(CHANNELS, sizeof *s->channel_name);
    assert_non_null(s->channel_name);
    for (size_t c = 0; c < CHANNELS; c++) set_name(s->channel_name[c], channel_names[c]);
    for (size_t i = 0; i < WINDOWS; i++) {
        s->group[i] = 4000000000u - (uint32_t)(i / 2);
        s->run[i] = 9 - (uint32_t)(i / 2);
    }
    out->noise = 10;
    out->severity = 0.8;
    (void)snprintf(out->housing, sizeof out->housing, "slack");
    (void)snprintf(out->provenance.command, sizeof out->provenance.command, "generate");
    out->provenance.has_seed = true;
    out->provenance.seed = 7;
    return out;
}

static void write_series(const char *path) {
    assert_ok(lg_series_write(NULL, path, make_series(true), NULL));
}

static const char *good_file(void) {
    return fresh_copy("series.h5", write_series);
}

static lg_status read_data(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    lg_series_data data;
    const lg_status status = lg_series_read(context, path, options, NULL, &data, error);
    if (status == LG_OK) lg_series_data_destroy(&data);
    return status;
}

/* Warnings during the last reading. */
static struct {
    int count;
    char last[512];
} heard;

static void hear(void *user, lg_log_level level, const char *message) {
    (void)user;
    if (level == LG_LOG_INFO) return; /* the child that reads first takes long, as under emulation */
    assert_int_equal(level, LG_LOG_WARNING);
    heard.count++;
    (void)snprintf(heard.last, sizeof heard.last, "%s", message);
}

static void assert_heard(int count, const char *word) {
    assert_int_equal(heard.count, count);
    if (count > 0 && strstr(heard.last, word) == NULL) fail_msg("no '%s' in: %s", word, heard.last);
}

/* Reads a file whose classes must match those of `like`, which may be NULL. `word`: the file must be refused
 * with this word; then NULL is returned. Warnings are recorded. */
static lg_series_data *read_like(const char *path, const lg_series *like, const char *word) {
    lg_series_data data;
    lg_context *context;
    lg_context_options options;
    lg_error error = {LG_OK, ""};
    heard.count = 0;
    lg_context_options_init(&options);
    options.log = hear;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    const lg_status status = lg_series_read(context, path, NULL, like, &data, &error);
    if (status != (word == NULL ? LG_OK : LG_FORMAT) || (word != NULL && strstr(error.message, word) == NULL))
        fail_msg("%s: %s", lg_status_name(status), error.message);
    return status == LG_OK ? own_lg_series_data(data) : NULL;
}

static lg_series_data *read_series(const char *path) {
    return read_like(path, NULL, NULL);
}

static void assert_names(char (*have)[LG_SERIES_NAME], size_t count, const char *joined) {
    char text[512] = "";
    for (size_t i = 0; i < count; i++) {
        if (i > 0) (void)strcat(text, "|");
        (void)strcat(text, have[i]);
    }
    assert_string_equal(text, joined);
}

TEST("a series is read back as it was written") {
    for (int full = 0; full < 2; full++) {
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        lg_series_data *data = make_series(full == 1);
        assert_ok(lg_series_write(NULL, path, data, NULL));
        assert_int_equal(strlen(data->sha256), 64);
        lg_series_data *again = read_series(path);
        const lg_series *a = &again->series, *d = &data->series;
        assert_true(a->count == WINDOWS && a->channels == CHANNELS && a->length == LENGTH && a->classes == 3);
        assert_memory_equal(a->x, d->x, sizeof(float) * WINDOWS * WINDOW);
        assert_memory_equal(a->label, d->label, sizeof(uint32_t) * WINDOWS);
        assert_names(a->class_name, 3, "intact|cracked|broken");
        assert_string_equal(again->sha256, data->sha256);
        assert_string_equal(again->provenance.liegrad_version, lg_version());
        if (full == 1) {
            assert_memory_equal(a->group, d->group, sizeof(uint32_t) * WINDOWS);
            assert_memory_equal(a->run, d->run, sizeof(uint32_t) * WINDOWS);
            assert_names(a->channel_name, CHANNELS, "acc_lower_x|moment_x");
            assert_true(a->rate == 10 && again->noise == 10 && again->severity == 0.8);
            assert_string_equal(again->housing, "slack");
            assert_int_equal(again->provenance.seed, 7);
        } else {
            assert_true(a->group == NULL && a->run == NULL && a->channel_name == NULL && a->rate == 0);
            assert_true(isnan(again->noise) && isnan(again->severity));
            assert_string_equal(again->housing, "");
        }
        assert_ok(lg_series_write(NULL, second, again, NULL));
        assert_same_bytes(path, second);
        lg_series_data_destroy(again); /* the test destroys it a second time */
    }
}

TEST("the hash is computed from x as little-endian floats, then the labels, groups and runs") {
    const lg_series_data *data = read_series(good_file());
    lg_sha256 sha;
    char text[LG_SHA256_TEXT];
    lg_sha256_init(&sha);
    const void *const arrays[] = {data->series.x, data->series.label, data->series.group, data->series.run};
    const size_t counts[] = {WINDOWS * WINDOW, WINDOWS, WINDOWS, WINDOWS};
    for (size_t a = 0; a < 4; a++)
        for (size_t i = 0; i < counts[a]; i++) {
            uint32_t bits;
            memcpy(&bits, (const char *)arrays[a] + 4 * i, sizeof bits);
            for (int b = 0; b < 4; b++)
                lg_sha256_add(&sha, &(unsigned char){(unsigned char)(bits >> 8 * b)}, 1);
        }
    lg_sha256_finish(&sha, text);
    assert_string_equal(data->sha256, text);
}

TEST("names with separators, and more names than an attribute can hold, are read back") {
    for (size_t many = 0; many < 2; many++) {
        const uint32_t classes = many == 1 ? 3000 : 2;
        lg_series_data *data = own_lg_series_data(
            (lg_series_data){.series = {.count = classes, .channels = 3, .length = 1, .classes = classes}});
        lg_series *d = &data->series;
        const char *path = scratch_path("names.h5");
        assert_ok(lg_series_allocate(NULL, d, false, false));
        d->channel_name = lg_test_gives(3, sizeof *d->channel_name);
        for (uint32_t i = 0; i < classes; i++) {
            d->label[i] = i;
            (void)snprintf(d->class_name[i], LG_SERIES_NAME, "%s%u", many == 0 ? "a|b" : "class ", i);
        }
        set_name(d->channel_name[1], "\xce\xb8"); /* the others are unknown */
        assert_ok(lg_series_write(NULL, path, data, NULL));
        const lg_series *a = &read_series(path)->series;
        assert_int_equal(a->classes, classes);
        assert_memory_equal(a->class_name, d->class_name, classes * LG_SERIES_NAME);
        assert_memory_equal(a->label, d->label, classes * sizeof(uint32_t));
        assert_names(a->channel_name, 3, "|\xce\xb8|");
    }
}

/* ---- files of other programs ---- */

/* A file with the integers -25..25 in /X, stored as `stored`; without labels and attributes. */
static const char *foreign_file(hid_t stored, int rank, bool packed) {
    const char *path = scratch_path("foreign.h5");
    const hsize_t three[3] = {WINDOWS, CHANNELS, LENGTH}, two[2] = {WINDOWS, WINDOW};
    double x[WINDOWS * WINDOW];
    for (size_t i = 0; i < LG_COUNT(x); i++) x[i] = (double)(i * 7 % 51) - 25;
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(file >= 0);
    put_dataset(file, "X", stored, H5T_NATIVE_DOUBLE, rank, rank == 3 ? three : two, packed, x);
    assert_true(H5Fclose(file) >= 0);
    return path;
}

static void put_labels(const char *path, const char *name, hid_t stored, int rank, const double *values) {
    const hsize_t dims[2] = {WINDOWS, 1};
    replace_dataset(path, name, stored, H5T_NATIVE_DOUBLE, rank, dims, values);
}

/* size 0: variable length; rank -2: a row. */
static void put_text_labels(const char *path, const char *name, size_t size, H5T_str_t padding, int rank,
                            const char *const *values) {
    const hsize_t dims[2] = {rank < 0 ? 1 : WINDOWS, rank < 0 ? WINDOWS : 1};
    char fixed[WINDOWS * 128];
    hid_t type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, size > 0 ? size : H5T_VARIABLE) >= 0 && H5Tset_strpad(type, padding) >= 0);
    memset(fixed, padding == H5T_STR_SPACEPAD ? ' ' : 0, sizeof fixed);
    for (size_t i = 0; i < WINDOWS && size > 0; i++)
        memcpy(fixed + i * size, values[i], strlen(values[i]) < size ? strlen(values[i]) : size);
    replace_dataset(path, name, type, type, abs(rank), dims,
                    size > 0 ? (const void *)fixed : (const void *)values);
    assert_true(H5Tclose(type) >= 0);
}

static void assert_labels(const char *path, const lg_series *like, const char *names,
                          const uint32_t *expected) {
    const lg_series *s = &read_like(path, like, NULL)->series;
    assert_names(s->class_name, s->classes, names);
    assert_memory_equal(s->label, expected, WINDOWS * sizeof *expected);
}

/* A file with samples as floats and integer labels. `classes` NULL: without names. */
static const char *labelled_file(const double *y, const char *classes) {
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_labels(path, "y", H5T_STD_I32LE, 1, y);
    if (classes != NULL) replace_text(path, "/", "classes", classes);
    return path;
}

static const double plain[WINDOWS] = {0, 1, 0, 1, 1, 0};

TEST("samples are read in the types of other programs") {
    const struct {
        hid_t stored;
        int rank;
        bool packed;
    } cases[] = {{H5T_IEEE_F64LE, 3, false}, {H5T_IEEE_F64BE, 3, true}, {H5T_IEEE_F32BE, 2, false},
                 {H5T_STD_I16BE, 3, true},   {H5T_STD_I8LE, 2, false},  {H5T_STD_I64LE, 3, false},
                 {H5T_IEEE_F32LE, 3, true}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = foreign_file(cases[i].stored, cases[i].rank, cases[i].packed);
        put_labels(path, "y", H5T_STD_U8LE, 1, plain);
        const lg_series_data *data = read_series(path);
        const lg_series *s = &data->series;
        assert_int_equal(s->channels, cases[i].rank == 3 ? CHANNELS : 1);
        assert_int_equal(s->length, cases[i].rank == 3 ? LENGTH : WINDOW);
        for (size_t j = 0; j < WINDOWS * WINDOW; j++) assert_close(s->x[j], (double)(j * 7 % 51) - 25, 0, 0);
        assert_names(s->class_name, s->classes, "0|1");
        assert_true(s->group == NULL && s->run == NULL && s->channel_name == NULL && s->rate == 0);
        assert_true(isnan(data->noise) && isnan(data->severity));
        assert_string_equal(data->provenance.command, "");
        assert_int_equal(strlen(data->sha256), 64);
    }
}

TEST("a series that MATLAB has saved is rejected, because its dimensions are in reverse order") {
    const char *path = foreign_file(H5T_IEEE_F64LE, 3, false);
    put_labels(path, "y", H5T_STD_U8LE, 1, plain);
    replace_text(path, "X", "MATLAB_class", "double");
    assert_refused(read_data, path, LG_FORMAT, "/X", "permute(x, 3:-1:1)");
}

TEST("labels may be numbers of any type") {
    const struct {
        hid_t stored;
        int rank;
        double y[WINDOWS];
        const char *classes; /* attribute; NULL: none */
        const char *names;
        uint32_t expected[WINDOWS];
    } cases[] = {
        {H5T_STD_I8LE, 1, {-1, 1, 1, -1, 1, -1}, NULL, "-1|1", {0, 1, 1, 0, 1, 0}},
        {H5T_IEEE_F64BE, 2, {3, 1, 2, 3, 2, 1}, NULL, "1|2|3", {2, 0, 1, 2, 1, 0}},
        {H5T_STD_I16LE, 1, {-2, -1, 10, 9, -2, -1}, NULL, "-2|-1|9|10", {0, 1, 3, 2, 0, 1}},
        {H5T_STD_I32BE, 1, {5, 0, 2, 5, 0, 2}, NULL, "0|2|5", {2, 0, 1, 2, 0, 1}},
        {H5T_IEEE_F32LE, 1, {0, 0, 0, 0, 0, 0}, NULL, "0", {0, 0, 0, 0, 0, 0}},
        {H5T_STD_I64LE, 1, {1099511627776, 7, 7, 7, 7, 7}, NULL, "7|1099511627776", {1, 0, 0, 0, 0, 0}},
        {H5T_STD_I8LE, 1, {-1, 1, 1, -1, 1, -1}, "bad|good", "bad|good", {0, 1, 1, 0, 1, 0}},
        {H5T_IEEE_F64LE, 1, {2, 1, 1, 1, 1, 2}, "a|b", "a|b", {1, 0, 0, 0, 0, 1}},
        /* Numbers within 0..K-1 are the classes, even if one does not occur. */
        {H5T_STD_I64BE, 1, {2, 0, 2, 0, 2, 0}, "a|b|c", "a|b|c", {2, 0, 2, 0, 2, 0}},
        {H5T_STD_U64LE, 2, {1, 1, 1, 1, 1, 1}, "a|b", "a|b", {1, 1, 1, 1, 1, 1}},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_labels(path, "y", cases[i].stored, cases[i].rank, cases[i].y);
        if (cases[i].classes != NULL) replace_text(path, "/", "classes", cases[i].classes);
        assert_labels(path, NULL, cases[i].names, cases[i].expected);
    }
}

TEST("labels may be texts") {
    static const char *const words[WINDOWS] = {"ok", "worn out", "ok", "leak", "worn out", "ok"};
    /* bytewise, 10 comes first */
    static const char *const digits[WINDOWS] = {"10", "9", "10", "9", "10", "9"};
    static const uint32_t rising[WINDOWS] = {1, 2, 1, 0, 2, 1}, listed[WINDOWS] = {0, 1, 0, 2, 1, 0};
    static const uint32_t both[WINDOWS] = {0, 1, 0, 1, 0, 1};
    const struct {
        size_t size;
        H5T_str_t padding;
        int rank;
    } types[] = {{0, H5T_STR_NULLTERM, 1},   {0, H5T_STR_NULLTERM, 2},
                 {0, H5T_STR_NULLTERM, -2},  {8, H5T_STR_NULLPAD, 1}, /* "worn out" without a terminator */
                 {16, H5T_STR_NULLTERM, -2}, {20, H5T_STR_SPACEPAD, 1}};
    for (size_t i = 0; i < LG_COUNT(types); i++) {
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_text_labels(path, "y", types[i].size, types[i].padding, types[i].rank, words);
        assert_labels(path, NULL, "leak|ok|worn out", rising);
        replace_text(path, "/", "classes", "ok|worn out|leak"); /* another order */
        assert_labels(path, NULL, "ok|worn out|leak", listed);
        replace_text(path, "/", "classes", "L|O|W"); /* other names, assigned in increasing order */
        assert_labels(path, NULL, "L|O|W", rising);
        put_text_labels(path, "y", types[i].size, types[i].padding, types[i].rank, digits);
        delete_attribute(path, "/", "classes");
        assert_labels(path, NULL, "10|9", both);
    }
}

TEST("labels may be numpy's bool, which is an enumeration") {
    const signed char no = 0, yes = 1, y[WINDOWS] = {1, 0, 0, 1, 1, 0};
    const hsize_t n = WINDOWS;
    const uint32_t expected[WINDOWS] = {1, 0, 0, 1, 1, 0};
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    hid_t type = H5Tenum_create(H5T_STD_I8LE);
    assert_true(H5Tenum_insert(type, "FALSE", &no) >= 0 && H5Tenum_insert(type, "TRUE", &yes) >= 0);
    replace_dataset(path, "y", type, type, 1, &n, y);
    assert_true(H5Tclose(type) >= 0);
    assert_labels(path, NULL, "0|1", expected);
    replace_text(path, "/", "classes", "whole|torn");
    assert_labels(path, NULL, "whole|torn", expected);
}

/* A list of texts, as attrs["classes"] = ["a", "b"] writes it; numbers are not names. */
TEST("a list of texts gives names, and a list of numbers does not") {
    const char *const names[2] = {"dry|cold", "wet"};
    const hsize_t n = 2;
    const uint32_t expected[WINDOWS] = {0, 1, 0, 1, 1, 0};
    const char *path = labelled_file(plain, NULL);
    hid_t file = open_for_change(path), space = H5Screate_simple(1, &n, NULL), type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, H5T_VARIABLE) >= 0);
    for (int i = 0; i < 2; i++) {
        hid_t attribute =
            H5Acreate2(file, i == 0 ? "classes" : "channels", type, space, H5P_DEFAULT, H5P_DEFAULT);
        assert_true(attribute >= 0 && H5Awrite(attribute, type, names) >= 0 && H5Aclose(attribute) >= 0);
    }
    assert_true(H5Tclose(type) >= 0 && H5Sclose(space) >= 0 && H5Fclose(file) >= 0);
    const lg_series *s = &read_series(path)->series;
    assert_memory_equal(s->label, expected, sizeof expected);
    assert_string_equal(s->class_name[0], "dry|cold");
    assert_string_equal(s->channel_name[1], "wet");
    replace_integer(path, "/", "classes", 2);
    replace_integer(path, "/", "channels", 2);
    replace_text(path, "/", "noise", "gaussian"); /* has another meaning in that program */
    replace_integer(path, "/", "housing", 4);
    replace_text(path, "/", "format", "UCR");
    replace_text(path, "/", "kind", "archive");
    assert_labels(path, NULL, "0|1", expected);
}

TEST("runs and groups of other programs are read") {
    static const char *const people[WINDOWS] = {"p7", "p7", "p12", "p12", "p9", "p9"};
    static const double runs[WINDOWS] = {40, 40, 3, 3, 3, 0}, rate = 12.5;
    static const uint32_t groups[WINDOWS] = {1, 1, 0, 0, 2, 2};
    const char *path = labelled_file(plain, NULL);
    put_text_labels(path, "group", 0, H5T_STR_NULLTERM, 1, people);
    put_labels(path, "run", H5T_IEEE_F64BE, 2, runs);
    replace_attribute(path, "/", "rate", H5T_IEEE_F32BE, H5T_NATIVE_DOUBLE, &rate);
    replace_text(path, "/", "channels", "left|");
    const lg_series *s = &read_series(path)->series;
    assert_memory_equal(s->group, groups, sizeof groups);
    for (size_t i = 0; i < WINDOWS; i++) assert_int_equal(s->run[i], runs[i]);
    assert_close(s->rate, 12.5, 0, 0);
    assert_names(s->channel_name, 2, "left|");
}

TEST("runs whose windows are not consecutive, and invalid rates, are left out with a warning") {
    static const double runs[WINDOWS] = {1, 1, 2, 1, 2, 2};
    const char *path = good_file();
    put_labels(path, "run", H5T_STD_I32LE, 1, runs);
    const lg_series *s = &read_series(path)->series;
    assert_true(s->run == NULL && s->group != NULL);
    assert_heard(1, "series.h5: /run: the windows of run 1");
    path = labelled_file(plain, NULL);
    replace_text(path, "/", "rate", "10 Hz");
    assert_close(read_series(path)->series.rate, 0, 0, 0);
    assert_heard(1, "attribute rate");
}

/* ---- a test file for a training file ---- */

static const lg_series *classes_like(uint32_t classes, const char *const *names) {
    lg_series_data *like = own_lg_series_data(
        (lg_series_data){.series = {.count = 1, .channels = 1, .length = 1, .classes = classes}});
    assert_ok(lg_series_allocate(NULL, &like->series, false, false));
    for (uint32_t c = 0; c < classes; c++) set_name(like->series.class_name[c], names[c]);
    return &like->series;
}

TEST("classes are matched by name") {
    static const struct {
        const char *like[3];
        double y[WINDOWS];
        const char *classes, *names;
        uint32_t expected[WINDOWS];
        int warnings;
    } cases[] = {
        {{"intact", "broken", "worn"},
         {0, 1, 0, 1, 1, 0},
         "broken|intact",
         "intact|broken|worn",
         {1, 0, 1, 0, 0, 1},
         0},
        {{"1", "2", "3"}, {3, 2, 3, 2, 3, 2}, NULL, "1|2|3", {2, 1, 2, 1, 2, 1}, 0},
        {{"-1", "0.0", "+1"}, {1, -1, 1, -1, 0, 0}, NULL, "-1|0.0|+1", {2, 0, 2, 0, 1, 1}, 0},
        {{"0", "1", "x"}, {0, 1, 0, 1, 1, 0}, "1|0", "0|1|x", {1, 0, 1, 0, 0, 1}, 0},
        {{"a", "b", "c"}, {0, 2, 0, 2, 0, 2}, NULL, "a|b|c", {0, 2, 0, 2, 0, 2}, 1},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        assert_labels(labelled_file(cases[i].y, cases[i].classes), classes_like(3, cases[i].like),
                      cases[i].names, cases[i].expected);
        assert_heard(cases[i].warnings, "");
    }
}

TEST("classes that do not match are refused, and classes that do not occur need no match") {
    static const struct {
        const char *like[3];
        uint32_t classes;
        double y[WINDOWS];
        const char *names, *word;
    } cases[] = {
        {{"intact", "broken"}, 2, {0, 1, 0, 1, 1, 0}, "intact|torn", "'torn'"},
        {{"intact", "broken"}, 2, {1, 2, 1, 2, 1, 2}, NULL, "'1' is none of the classes intact|broken"},
        {{"intact", "broken"}, 2, {1, 1, 1, 1, 1, 1}, NULL, "'1'"}, /* ambiguous: numbered 0..1 or 1..2? */
        {{"intact", "broken"}, 2, {0, 1, 2, 0, 1, 2}, NULL, "'0'"},
        {{"0", "1"}, 2, {0, 1, -1, 0, 1, 0}, NULL, "'-1'"},
        /* Without names of classes, the labels become the names. A label that did not occur in training is
         * then not taken as the index of a class. */
        {{"1", "2", "3"}, 3, {0, 1, 2, 0, 1, 2}, NULL, "'0' is none of the classes 1|2|3"},
    };
    const uint32_t expected[WINDOWS] = {0, 1, 0, 1, 1, 0};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        (void)read_like(labelled_file(cases[i].y, cases[i].names),
                        classes_like(cases[i].classes, cases[i].like), cases[i].word);
    const char *path = labelled_file(plain, "intact|broken|unheard of");
    assert_labels(path, classes_like(2, cases[0].like), "intact|broken", expected);
    assert_status(
        lg_series_read(NULL, path, NULL, &(lg_series){.count = 0}, &(lg_series_data){.sha256 = ""}, NULL),
        LG_INVALID_ARGUMENT);
}

TEST("the meaning of numbers with names does not depend on which of them occur") {
    static const double one[WINDOWS] = {1, 2, 3, 1, 2, 3}, zero[WINDOWS] = {0, 1, 2, 0, 1, 2},
                        odd[WINDOWS] = {-1, 7, 9, -1, 7, 9};
    static const struct {
        const double *train;
        double y[WINDOWS];
        const char *classes; /* in the second file */
        uint32_t expected[WINDOWS];
        const char *word; /* in the message; NULL: no error */
    } cases[] = {
        {one, {1, 2, 1, 2, 1, 2}, "a|b|c", {0, 1, 0, 1, 0, 1}, NULL},
        {one, {2, 3, 2, 3, 2, 3}, "a|b|c", {1, 2, 1, 2, 1, 2}, NULL},
        {one, {2, 2, 2, 2, 2, 2}, "a|b|c", {1, 1, 1, 1, 1, 1}, NULL},
        {one, {3, 1, 3, 1, 3, 1}, NULL, {2, 0, 2, 0, 2, 0}, NULL},
        {zero, {1, 2, 1, 2, 1, 2}, "a|b|c", {1, 2, 1, 2, 1, 2}, NULL},
        {zero, {1, 1, 1, 1, 1, 1}, NULL, {1, 1, 1, 1, 1, 1}, NULL},
        {odd, {9, 7, 9, 7, 9, 7}, "a|b|c", {2, 1, 2, 1, 2, 1}, NULL},
        {odd, {7, 7, 7, 7, 7, 7}, NULL, {1, 1, 1, 1, 1, 1}, NULL},
        {one, {3, 1, 3, 1, 3, 1}, "c|b|a", {0, 2, 0, 2, 0, 2}, NULL}, /* another list: numbered anew */
        {one, {0, 2, 0, 2, 0, 2}, "c|b|a", {2, 0, 2, 0, 2, 0}, NULL},
        {one, {0, 1, 2, 0, 1, 2}, "a|b|c", {0}, "label '0' is none of 1|2|3"},
        {one, {0, 1, 2, 0, 1, 2}, NULL, {0}, "label '0' is none of 1|2|3"},
        {zero,
         {3, 1, 2, 1, 1, 2},
         "a|b|c",
         {0},
         "label '3' is none of 0|1|2, the labels of the classes a|b|c"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const lg_series *train = &read_series(labelled_file(cases[i].train, "a|b|c"))->series;
        assert_memory_equal(train->label, ((const uint32_t[]){0, 1, 2, 0, 1, 2}), WINDOWS * 4);
        assert_heard(0, "");
        const lg_series_data *data =
            read_like(labelled_file(cases[i].y, cases[i].classes), train, cases[i].word);
        assert_heard(0, "");
        if (data == NULL) continue;
        assert_memory_equal(data->series.label, cases[i].expected, sizeof cases[i].expected);
        assert_names(data->series.class_label, 3,
                     cases[i].train == one    ? "1|2|3"
                     : cases[i].train == zero ? "0|1|2"
                                              : "-1|7|9");
    }
}

/* Neither 0 nor K occurs, and nothing else determines the numbering. */
TEST("class_labels states what 0 means; without it numbers start at 0, with a warning") {
    static const double y[WINDOWS] = {1, 2, 1, 2, 1, 2};
    static const uint32_t from_zero[WINDOWS] = {1, 2, 1, 2, 1, 2}, given[WINDOWS] = {2, 0, 2, 0, 2, 0};
    const char *path = labelled_file(y, "a|b|c");
    assert_labels(path, NULL, "a|b|c", from_zero);
    assert_heard(1, "class_labels");
    replace_text(path, "/", "class_labels", "2|3|1");
    assert_labels(path, NULL, "a|b|c", given);
    assert_heard(0, "");
    replace_text(path, "/", "class_labels", "2|3");
    assert_refused(read_data, path, LG_FORMAT, "class_labels", "2 labels, but 3 classes");
    replace_text(path, "/", "class_labels", "2|3|4");
    assert_refused(read_data, path, LG_FORMAT, "class_labels", "'1' is none of 2|3|4");
    replace_integer(path, "/", "class_labels", 1);
    assert_refused(read_data, path, LG_FORMAT, "class_labels", "expected texts");
}

/* ---- as many names as can be read ---- */

enum { MANY = 65536 };

static char (*many_names(const char *format, bool falling))[LG_SERIES_NAME] {
    char(*name)[LG_SERIES_NAME] = lg_test_memory(MANY * sizeof *name);
    for (int i = 0; i < MANY; i++)
        (void)snprintf(name[i], sizeof *name, format, 1000 + (falling ? MANY - 1 - i : i));
    return name;
}

/* A file with MANY windows, or MANY channels, whose samples are 0, 1, ... */
static lg_h5 *many_file(const char *path, uint64_t windows, uint64_t channels) {
    const uint64_t dims[3] = {windows, channels, 1};
    float *x = lg_test_memory(MANY * sizeof *x);
    lg_h5 *h5;
    for (int i = 0; i < MANY; i++) x[i] = (float)i;
    assert_ok(lg_h5_create(NULL, path, &h5, NULL));
    assert_ok(lg_h5_put(h5, "X", LG_ELEMENT_F32, 3, dims, x, NULL));
    return h5;
}

static void put_many(lg_h5 *h5, const char *key, char (*name)[LG_SERIES_NAME]) {
    assert_ok(lg_h5_put_texts(h5, key, name[0], LG_SERIES_NAME, MANY, NULL));
}

static void read_labels(void *path) {
    lg_series_data data;
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe = false;
    if (lg_series_read(NULL, path, &options, NULL, &data, NULL) != LG_OK) _exit(1);
    for (uint32_t i = 0; i < MANY; i++)
        if (data.series.label[i] != MANY - 1 - i) _exit(2);
}

TEST("many labels find their classes, by text and by number") {
    const char *forms[] = {"n%d", "%d.0"};
    for (size_t i = 0; i < LG_COUNT(forms); i++) {
        const char *path = scratch_path("many.h5");
        lg_h5 *h5 = many_file(path, MANY, 1);
        put_many(h5, "y", many_names(forms[i], true));
        put_many(h5, "classes", many_names("c%d", false));
        put_many(h5, "class_labels", many_names(i == 0 ? "n%d" : "%d", false));
        assert_ok(lg_h5_commit(h5, NULL));
        lg_h5_close(h5);
        assert_cheap(read_labels, (void *)(uintptr_t)path);
    }
}

static void read_channels(void *path) {
    lg_series like = {.channels = MANY, .length = 1, .channel_name = many_names("n%d", false)};
    lg_series_data data;
    if (lg_series_read_like(NULL, path, &like, &data, NULL) != LG_OK) _exit(1);
    for (uint32_t i = 0; i < MANY; i++)
        if (data.series.x[i] != (float)(MANY - 1 - i)) _exit(2);
}

TEST("many channels are put into the order of the model's names") {
    const char *path = scratch_path("channels.h5");
    const uint32_t label = 0;
    lg_h5 *h5 = many_file(path, 1, MANY);
    assert_ok(lg_h5_put(h5, "y", LG_ELEMENT_U32, 1, (const uint64_t[]){1}, &label, NULL));
    put_many(h5, "channels", many_names("n%d", true));
    assert_ok(lg_h5_commit(h5, NULL));
    lg_h5_close(h5);
    assert_cheap(read_channels, (void *)(uintptr_t)path);
}

TEST("files written by this program count from 0, whatever numbers were read") {
    static const double y[WINDOWS] = {2, 3, 3, 2, 3, 2};
    static const uint32_t expected[WINDOWS] = {1, 2, 2, 1, 2, 1};
    const char *out = scratch_path("again.h5");
    lg_series_data *data = read_series(labelled_file(y, "a|b|c"));
    assert_memory_equal(data->series.label, expected, sizeof expected);
    assert_ok(lg_series_write(NULL, out, data, NULL));
    assert_heard(0, "");
    assert_labels(out, &data->series, "a|b|c", expected);
    assert_heard(0, "");
    assert_labels(out, NULL, "a|b|c", expected);
    assert_heard(0, "");
}

/* ---- single precision ---- */

/* Writes offset + scale sin(i) for each channel, in doubles. */
static void put_waves(const char *path, const double offset[CHANNELS], const double scale[CHANNELS]) {
    const hsize_t dims[3] = {WINDOWS, CHANNELS, LENGTH};
    double x[WINDOWS * WINDOW];
    for (size_t i = 0; i < LG_COUNT(x); i++) {
        const size_t c = i / LENGTH % CHANNELS;
        x[i] = offset[c] + scale[c] * sin((double)i);
    }
    replace_dataset(path, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, dims, x);
}

TEST("variations that floats lose cause a warning or are refused") {
    static const struct {
        double offset[CHANNELS], scale[CHANNELS];
        const char *warning, *word;
    } cases[] = {
        {{0, 5}, {1, 1}, NULL, NULL},
        {{0, 1e4}, {1e-20, 1}, NULL, NULL},
        {{0.1, 1e8}, {0, 0}, NULL, NULL},        /* constant */
        {{0.1, 1e8}, {1e-17, 1e-8}, NULL, NULL}, /* constant except for the rounding of doubles */
        {{0, 1e6}, {1, 1}, "channel 2 'moment_x'", NULL},
        {{1e6, 1e6}, {1, 1}, "of others", NULL},
        {{0, 1e8}, {1, 1}, NULL, "channel 2 'moment_x'"},
        {{0, 0}, {1e-300, 1}, NULL, "channel 1 'acc_lower_x'"},
        {{0, 1e9}, {1, 0.01}, NULL, "subtract the channel's mean or rescale it"}, /* constant as floats */
        {{-1e8, 0}, {1, 1}, NULL, "channel 1"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = labelled_file(plain, NULL);
        replace_text(path, "/", "channels", "acc_lower_x|moment_x");
        put_waves(path, cases[i].offset, cases[i].scale);
        (void)read_like(path, NULL, cases[i].word);
        assert_heard(cases[i].warning != NULL, cases[i].warning != NULL ? cases[i].warning : "");
    }
}

TEST("data with more than one block of rows are read, stored in chunks that do not divide them") {
    enum { ROWS = 700, SAMPLES = 300 };
    const hsize_t dims[2] = {ROWS, SAMPLES};
    double *x = TEST_ARRAY(double, (size_t)ROWS *SAMPLES), y[ROWS];
    const char *path = scratch_path("blocks.h5");
    for (size_t i = 0; i < ROWS; i++) y[i] = (double)(i % 2);
    for (size_t i = 0; i < (size_t)ROWS * SAMPLES; i++) x[i] = sin(0.01 * (double)i);
    for (int packed = 0; packed < 2; packed++) {
        hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
        put_dataset(file, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, dims, packed, x);
        put_dataset(file, "y", H5T_STD_U8LE, H5T_NATIVE_DOUBLE, 1, dims, false, y);
        assert_true(H5Fclose(file) >= 0);
        const float *read = read_series(path)->series.x;
        for (size_t i = 0; i < (size_t)ROWS * SAMPLES; i++)
            if (read[i] != (float)x[i]) fail_msg("sample %zu", i);
    }
}

/* ---- invalid files ---- */

TEST("a damaged file is refused") {
    static const char *const words[WINDOWS] = {"ok", "leak", "ok", "worn out", "leak", "ok"};
    refuse_damaged_files(read_data, good_file(), "");
    survive_changed_bytes(read_data, good_file(), 80);
    const char *path = foreign_file(H5T_IEEE_F64BE, 3, true);
    put_text_labels(path, "y", 0, H5T_STR_NULLTERM, 1, words);
    put_text_labels(path, "group", 12, H5T_STR_NULLPAD, 1, words);
    survive_changed_bytes(read_data, path, 80);
}

TEST("errors in a file are refused by name") {
    static const damage rows[] = {
        {"X", ARRAY(0, 60), LG_FORMAT, "has shape (60), expected (>= 1 windows, >= 1 samples)"},
        {"X", ARRAY(0, 6, 2, 5, 1), LG_FORMAT,
         "(6, 2, 5, 1), expected (>= 1 windows, >= 1 channels, >= 1 samples)"},
        {"X", ARRAY(0, 0, 2, 5), LG_FORMAT, "(0, 2, 5)"},
        {"X", ARRAY(0, 6, 0, 5), LG_FORMAT, "(6, 0, 5), expected (>= 1 windows"},
        {"X", ARRAY(0, 6, 2, 0), LG_FORMAT, "(6, 2, 0)"},
        {"X", ARRAY(0, 6, 0), LG_FORMAT, "has shape (6, 0), expected (>= 1 windows, >= 1 samples)"},
        {"X", ARRAY(0, 7, 2, 5), LG_FORMAT, "/y: has shape (6), expected (7 windows as in /X)"},
        {"X", ARRAY(NAN, 6, 2, 5), LG_NOT_FINITE, "NaN in window 0, channel 0, sample 0"},
        {"X", ARRAY(INFINITY, 6, 2, 5), LG_NOT_FINITE, "single precision in window 0"},
        {"X", ARRAY(-1e39, 6, 2, 5), LG_NOT_FINITE, "single precision"},
        {"X", ARRAY(0, 6, 3, 5), LG_FORMAT, "~channels: 2 names, expected 3"},
        {"y", ARRAY(0, 5), LG_FORMAT, "has shape (5), expected (6 windows as in /X)"},
        {"y", ARRAY(0, 0), LG_FORMAT, "has shape (0)"},
        {"y", ARRAY(0, 6, 2), LG_FORMAT, "(6, 2), expected (6 windows as in /X)"},
        {"y", ARRAY(0, 6, 0), LG_FORMAT, "(6, 0)"},
        {"y", ARRAY(0, 2, 3), LG_FORMAT, "(2, 3)"},
        {"y", ARRAY(3, 1, 6), LG_FORMAT, "3 names, but /y has 1 different labels from '3' to '3'"},
        {"y", ARRAY(0, 1, 5), LG_FORMAT, "(1, 5)"},
        {"run", ARRAY(1, 2, 3), LG_FORMAT, "(2, 3)"},
        {"y", ARRAY(0, 6, 1, 2), LG_FORMAT, "(6, 1, 2)"},
        {"y", ARRAY(0.5, 6), LG_FORMAT, "0.5 at index (0) is not a whole number"},
        {"y", ARRAY(NAN, 6), LG_NOT_FINITE, "index (0)"},
        {"y", ARRAY(INFINITY, 6), LG_NOT_FINITE, "index (0)"},
        {"y", ARRAY(1e300, 6), LG_FORMAT, "not a whole number"},
        {"y", ARRAY(3, 6), LG_FORMAT, "3 names, but /y has 1 different labels from '3' to '3'"},
        {"y", ARRAY(1099511627776, 6), LG_FORMAT, "3 names"},
        {"y", ARRAY(-1, 6), LG_FORMAT, "3 names"},
        {"group", ARRAY(-1, 6), LG_FORMAT, "is -1 at index (0)"},
        {"group", ARRAY(4294967296, 6), LG_FORMAT, "is 4294967296 at index (0)"},
        {"group", ARRAY(1.5, 6), LG_FORMAT, "whole"},
        {"group", ARRAY(1, 7), LG_FORMAT, "/group: has shape (7)"},
        {"run", ARRAY(1, 5), LG_FORMAT, "/run: has shape (5)"},
        {"run", ARRAY(-3, 6), LG_FORMAT, "is -3"},
        {"run", ARRAY(1, 6, 3), LG_FORMAT, "(6, 3)"},
        {"X", GONE, LG_FORMAT, "has no"},
        {"y", GONE, LG_FORMAT, "has no"},
        /* Sizes for which there is no memory, declared without any data. */
        {"X", DECLARED(1000000000000, 2, 5), LG_FORMAT, ""},
        {"X", DECLARED(6, 1000000000, 1000000), LG_FORMAT, ""},
        {"X", DECLARED(4294967296, 4294967296, 4294967296), LG_FORMAT, ""},
        {"X", DECLARED(6, 2000000000000), LG_FORMAT, ""},
        {"y", DECLARED(2000000000000), LG_FORMAT, ""},
        {"group", DECLARED(2000000000000), LG_FORMAT, ""},
        {"@rate", REAL(-1), LG_FORMAT, ""},
        {"@rate", REAL(NAN), LG_NOT_FINITE, ""},
        {"@rate", REAL(INFINITY), LG_NOT_FINITE, ""},
        {"@rate", TEXT("10 Hz"), LG_FORMAT, "number"},
        {"@noise", REAL(NAN), LG_NOT_FINITE, ""},
        {"@noise", TEXT("much"), LG_FORMAT, "number"},
        {"@severity", REAL(INFINITY), LG_NOT_FINITE, ""},
        {"@kind", TEXT("elastica"), LG_FORMAT, "series"},
        {"@classes", TEXT(""), LG_FORMAT, "empty"},
        {"@classes", TEXT("a|b|"), LG_FORMAT, "number 3 is empty"},
        {"@classes", TEXT("a|b|a"), LG_FORMAT, "'a' is there twice"},
        {"@classes", TEXT("a"), LG_FORMAT, "1 names, but /y has 2 different"},
        {"@classes", TEXT("a|bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb|c"), LG_FORMAT,
         "63 bytes"},
        {"@channels", TEXT("a"), LG_FORMAT, "1 names, expected 2"},
        {"@channels", TEXT("a|b|c"), LG_FORMAT, "3 names, expected 2"},
        {"@housing", TEXT("a housing that has a long name"), LG_FORMAT, ""},
        {"@format_version", WHOLE(3), LG_VERSION, "3"},
    };
    refuse_damage(read_data, good_file, rows, LG_COUNT(rows));
}

TEST("the first invalid sample is reported with its place, and no other") {
    const hsize_t dims[3] = {WINDOWS, CHANNELS, LENGTH};
    double x[WINDOWS * WINDOW] = {0};
    x[4 * WINDOW + LENGTH + 3] = NAN;
    x[5 * WINDOW] = INFINITY;
    const char *path = good_file();
    replace_dataset(path, "X", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, 3, dims, x);
    assert_refused(read_data, path, LG_NOT_FINITE, "/X: NaN in window 4, channel 1, sample 3", "");
    x[4 * WINDOW + LENGTH + 3] = 3.5e38; /* slightly beyond the range of a float */
    replace_dataset(path, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, dims, x);
    assert_refused(read_data, path, LG_NOT_FINITE, "precision in window 4, channel 1, sample 3", "");
    x[4 * WINDOW + LENGTH + 3] = 3.4e38;
    replace_dataset(path, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, dims, x);
    assert_refused(read_data, path, LG_NOT_FINITE, "precision in window 5, channel 0, sample 0", "");
}

TEST("a label that int64 cannot hold is refused") {
    const hsize_t dims[1] = {WINDOWS};
    const uint64_t large[WINDOWS] = {0, 1, 2, 0, 1, (uint64_t)INT64_MAX + 1};
    const hid_t types[] = {H5T_STD_U64LE, H5T_STD_U64BE};
    for (size_t i = 0; i < LG_COUNT(types); i++) {
        const char *path = good_file();
        replace_dataset(path, "y", types[i], H5T_NATIVE_UINT64, 1, dims, large);
        assert_refused(read_data, path, LG_FORMAT, "/y: cannot be read", "out of range");
    }
}

TEST("texts in place of numbers, and texts that are not names, are refused") {
    static char longest[65];
    const char *const words[WINDOWS] = {"a", "b", "", "a", "b", "a"};
    const char *const lengthy[WINDOWS] = {"a", longest, "a", "a", "b", "a"};
    const hsize_t dims[2] = {WINDOWS, WINDOW};
    memset(longest, 'w', sizeof longest - 1);
    const char *path = good_file();
    put_text_labels(path, "y", 0, H5T_STR_NULLTERM, 1, words);
    assert_refused(read_data, path, LG_FORMAT, "/y: the text at index (2)", "empty");
    for (size_t size = 0; size <= 64; size += 64) {
        path = good_file();
        put_text_labels(path, "y", size, H5T_STR_NULLPAD, 1, lengthy);
        assert_refused(read_data, path, LG_FORMAT, "/y: the text at index (1)", "63 bytes");
    }
    path = good_file();
    hid_t type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, H5T_VARIABLE) >= 0);
    replace_dataset(path, "X", type, type, 2, dims, NULL);
    assert_refused(read_data, path, LG_FORMAT, "/X: does not hold numbers", "");
    assert_true(H5Tclose(type) >= 0);
    path = good_file();
    type = H5Tcreate(H5T_COMPOUND, 4);
    assert_true(H5Tinsert(type, "a", 0, H5T_NATIVE_INT32) >= 0);
    replace_dataset(path, "y", type, type, 1, dims, NULL);
    assert_refused(read_data, path, LG_FORMAT, "/y: holds neither numbers nor texts", "");
    assert_true(H5Tclose(type) >= 0);
}

TEST("texts of a size for which there is no memory are refused") {
    static const hsize_t sizes[2] = {2000000000000, 1};
    hid_t text = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(text, 2000) >= 0);
    for (int i = 0; i < 2; i++) {
        const char *path = good_file();
        declare_dataset(path, i == 0 ? "y" : "run", text, 1 + i, sizes);
        assert_refused(read_data, path, LG_FORMAT, i == 0 ? "/y" : "/run", "");
    }
    assert_true(H5Tclose(text) >= 0);
}

/* A filter of another program, which changes nothing. */
static size_t pass_through(unsigned flags, size_t count, const unsigned *values, size_t bytes, size_t *size,
                           void **buffer) {
    (void)flags, (void)count, (void)values, (void)size, (void)buffer;
    return bytes;
}

TEST("an unknown filter is refused") {
    static const H5Z_class2_t squeeze = {.version = H5Z_CLASS_T_VERS,
                                         .id = 300,
                                         .encoder_present = 1,
                                         .decoder_present = 1,
                                         .name = "squeeze",
                                         .filter = pass_through};
    const hsize_t dims[3] = {WINDOWS, CHANNELS, LENGTH};
    const float x[WINDOWS * WINDOW] = {0};
    const char *path = good_file();
    delete_link(path, "X");
    assert_true(H5Zregister(&squeeze) >= 0);
    hid_t file = open_for_change(path), plist = H5Pcreate(H5P_DATASET_CREATE);
    hid_t space = H5Screate_simple(3, dims, NULL);
    assert_true(H5Pset_chunk(plist, 3, dims) >= 0 && H5Pset_filter(plist, 300, 0, 0, NULL) >= 0);
    hid_t set = H5Dcreate2(file, "X", H5T_IEEE_F32LE, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0 && H5Dwrite(set, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, x) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Sclose(space) >= 0 && H5Pclose(plist) >= 0 && H5Fclose(file) >= 0);
    assert_true(H5Zunregister(300) >= 0);
    assert_refused(read_data, path, LG_FORMAT, "/X: is compressed with 'squeeze'", "gzip");
}

TEST("the limit counts the size in memory: floats, whatever type is stored") {
    lg_error error = {LG_OK, ""};
    lg_read_options options;
    lg_read_options_init(&options);
    const char *path = foreign_file(H5T_IEEE_F64LE, 3, false);
    put_labels(path, "y", H5T_STD_U8LE, 1, plain);
    options.max_size = WINDOWS * WINDOW * sizeof(float);
    assert_ok(read_data(NULL, path, &options, NULL));
    options.max_size--;
    assert_status(read_data(NULL, path, &options, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "/X"));
}

TEST("a series that could not be read back is not written") {
    lg_series_data *data = make_series(true);
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    lg_series *s = &data->series;
#define REFUSED(place, bad, good, status)                                                                    \
    do {                                                                                                     \
        place = bad;                                                                                         \
        assert_status(lg_series_write(NULL, path, data, &error), status);                                    \
        assert_non_null(strstr(error.message, "refused.h5"));                                                \
        place = good;                                                                                        \
    } while (0)
    REFUSED(s->x[2 * WINDOW + LENGTH + 1], NAN, 0, LG_NOT_FINITE);
    REFUSED(s->x[0], INFINITY, 0, LG_NOT_FINITE);
    REFUSED(s->label[5], 3, 2, LG_INVALID_ARGUMENT);
    REFUSED(s->run[0], 7, 9, LG_INVALID_ARGUMENT);
    REFUSED(s->rate, -1, 10, LG_INVALID_ARGUMENT);
    REFUSED(s->rate, NAN, 10, LG_NOT_FINITE);
    REFUSED(data->noise, INFINITY, 1, LG_NOT_FINITE);
    REFUSED(data->severity, INFINITY, 1, LG_NOT_FINITE);
    REFUSED(s->class_name[1][0], '\0', 'c', LG_INVALID_ARGUMENT);
    REFUSED(s->classes, 0, 3, LG_INVALID_ARGUMENT);
    REFUSED(s->classes, 65537, 3, LG_INVALID_ARGUMENT);
    const struct {
        size_t count;
        uint32_t channels, length;
    } empty[] = {
        {0, CHANNELS, LENGTH}, {SIZE_MAX, CHANNELS, LENGTH}, {WINDOWS, 0, LENGTH}, {WINDOWS, CHANNELS, 0}};
    const lg_series whole = *s;
    for (size_t i = 0; i < LG_COUNT(empty); i++) {
        s->count = empty[i].count, s->channels = empty[i].channels, s->length = empty[i].length;
        assert_status(lg_series_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
        *s = whole;
    }
    s->label = NULL;
    assert_status(lg_series_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
    *s = whole;
    assert_status(lg_series_write(NULL, path, NULL, NULL), LG_INVALID_ARGUMENT);
    lg_series_data_destroy(NULL);
    set_name(s->class_name[1], "intact");
    assert_status(lg_series_write(NULL, path, data, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "twice"));
    memset(s->class_name[1], 'x', LG_SERIES_NAME);
    assert_status(lg_series_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
    set_name(s->class_name[1], "cracked");
    memset(data->housing, 'x', sizeof data->housing);
    assert_status(lg_series_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
    data->housing[3] = '\0';
    assert_status(lg_series_write(NULL, scratch_path("no/folder.h5"), data, NULL), LG_FILE);
    assert_status(lg_series_write(NULL, NULL, data, NULL), LG_INVALID_ARGUMENT);
    assert_int_not_equal(access(path, F_OK), 0);
    assert_ok(lg_series_write(NULL, path, data, NULL));
    lg_series_data_destroy(data);
    assert_status(lg_series_write(NULL, path, data, NULL), LG_INVALID_ARGUMENT);
}

/* ---- memory ---- */

typedef struct like_step {
    const char *path;
    const lg_series *like;
} like_step;

static lg_status read_like_step(const lg_context *context, void *user, lg_error *error) {
    const like_step *step = user;
    lg_series_data data;
    const lg_read_options options = without_probe();
    const lg_status status = lg_series_read(context, step->path, &options, step->like, &data, error);
    if (status == LG_OK) lg_series_data_destroy(&data);
    return status;
}

static lg_status write_step(const lg_context *context, void *user, lg_error *error) {
    lg_series_data *const *data = user;
    return lg_series_write(context, scratch_path("written.h5"), *data, error);
}

TEST("every allocation may fail, and nothing leaks") {
    static const char *const words[WINDOWS] = {"ok", "leak", "ok", "worn out", "leak", "ok"};
    static const char *const names[] = {"leak", "ok", "worn out", "new"};
    lg_series_data *data = make_series(true);
    assert_true(fail_every_reading(read_data, good_file()) >= 20);
    assert_true(fail_every_allocation(write_step, &data) >= 5);
    like_step step = {foreign_file(H5T_IEEE_F32LE, 3, false), classes_like(4, names)};
    put_text_labels(step.path, "y", 0, H5T_STR_NULLTERM, 1, words);
    put_labels(step.path, "group", H5T_IEEE_F64LE, 1, plain);
    replace_text(step.path, "/", "classes", "worn out|leak|ok");
    assert_true(fail_every_allocation(read_like_step, &step) >= 20);
}
