/* Labelled series: round trip, what other programs write, the matrix of bad input. */
#include "io_test.h"

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

static void make_series(bool full, lg_series_data *out) {
    *out =
        (lg_series_data){.series = {.count = WINDOWS, .channels = CHANNELS, .length = LENGTH, .classes = 3},
                         .noise = NAN,
                         .severity = NAN};
    lg_series *s = &out->series;
    assert_ok(lg_series_allocate(NULL, s, full, full));
    for (size_t i = 0; i < WINDOWS * WINDOW; i++) s->x[i] = sample(i);
    for (size_t i = 0; i < WINDOWS; i++) s->label[i] = i / 3 == 0 ? 0 : 2; /* class 1 does not occur */
    for (size_t c = 0; c < 3; c++) set_name(s->class_name[c], class_names[c]);
    if (!full) return;
    s->rate = 10;
    s->channel_name = lg_alloc(NULL, CHANNELS, sizeof *s->channel_name);
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
}

static const char *good_file(void) {
    const char *path = scratch_path("series.h5"), *original = scratch_path("series.original");
    if (access(original, F_OK) != 0) {
        lg_series_data data;
        make_series(true, &data);
        assert_ok(lg_series_write(NULL, original, &data, NULL));
        lg_series_data_destroy(&data);
    }
    copy_file(original, path);
    return path;
}

static lg_status read_data(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    lg_series_data data;
    const lg_status status = lg_series_read(context, path, options, NULL, &data, error);
    if (status == LG_OK) lg_series_data_destroy(&data);
    return status;
}

static void assert_names(char (*have)[LG_SERIES_NAME], size_t count, const char *joined) {
    char text[512] = "";
    for (size_t i = 0; i < count; i++) {
        if (i > 0) (void)strcat(text, "|");
        (void)strcat(text, have[i]);
    }
    assert_string_equal(text, joined);
}

TEST("a series comes back as it was written") {
    for (int full = 0; full < 2; full++) {
        lg_series_data data, again;
        const char *path = scratch_path("round.h5"), *second = scratch_path("round2.h5");
        make_series(full == 1, &data);
        assert_ok(lg_series_write(NULL, path, &data, NULL));
        assert_int_equal(strlen(data.sha256), 64);
        assert_ok(lg_series_read(NULL, path, NULL, NULL, &again, NULL));
        const lg_series *a = &again.series, *d = &data.series;
        assert_int_equal(a->count, WINDOWS);
        assert_int_equal(a->channels, CHANNELS);
        assert_int_equal(a->length, LENGTH);
        assert_int_equal(a->classes, 3);
        assert_memory_equal(a->x, d->x, sizeof(float) * WINDOWS * WINDOW);
        assert_memory_equal(a->label, d->label, sizeof(uint32_t) * WINDOWS);
        assert_names(a->class_name, 3, "intact|cracked|broken");
        assert_string_equal(again.sha256, data.sha256);
        assert_string_equal(again.provenance.liegrad_version, lg_version());
        if (full == 1) {
            assert_memory_equal(a->group, d->group, sizeof(uint32_t) * WINDOWS);
            assert_memory_equal(a->run, d->run, sizeof(uint32_t) * WINDOWS);
            assert_names(a->channel_name, CHANNELS, "acc_lower_x|moment_x");
            assert_close(a->rate, 10, 0, 0);
            assert_close(again.noise, 10, 0, 0);
            assert_close(again.severity, 0.8, 0, 0);
            assert_string_equal(again.housing, "slack");
            assert_int_equal(again.provenance.seed, 7);
        } else {
            assert_true(a->group == NULL && a->run == NULL && a->channel_name == NULL);
            assert_close(a->rate, 0, 0, 0);
            assert_true(isnan(again.noise) && isnan(again.severity));
            assert_string_equal(again.housing, "");
        }
        assert_ok(lg_series_write(NULL, second, &again, NULL));
        assert_same_bytes(path, second);
        lg_series_data_destroy(&data);
        lg_series_data_destroy(&again);
        lg_series_data_destroy(&again);
    }
}

TEST("the hash is that of x as little-endian floats, then the labels") {
    lg_series_data data;
    lg_sha256 sha;
    char text[LG_SHA256_TEXT];
    assert_ok(lg_series_read(NULL, good_file(), NULL, NULL, &data, NULL));
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, data.series.x, sizeof(float) * WINDOWS * WINDOW);
    lg_sha256_add(&sha, data.series.label, sizeof(uint32_t) * WINDOWS);
    lg_sha256_finish(&sha, text);
    assert_string_equal(data.sha256, text);
    lg_series_data_destroy(&data);
}

/* Names that cannot be joined by |, and more of them than an attribute holds. */
TEST("names that cannot be joined, and more than an attribute holds, come back") {
    for (size_t many = 0; many < 2; many++) {
        const uint32_t classes = many == 1 ? 3000 : 2;
        lg_series_data data = {.series = {.count = classes, .channels = 3, .length = 1, .classes = classes}},
                       again;
        const char *path = scratch_path("names.h5");
        assert_ok(lg_series_allocate(NULL, &data.series, false, false));
        data.series.channel_name = lg_alloc(NULL, 3, sizeof *data.series.channel_name);
        for (uint32_t i = 0; i < classes; i++) {
            data.series.label[i] = i;
            (void)snprintf(data.series.class_name[i], LG_SERIES_NAME, "%s%u", many == 0 ? "a|b" : "class ",
                           i);
        }
        set_name(data.series.channel_name[1], "\xce\xb8"); /* the others are unknown */
        assert_ok(lg_series_write(NULL, path, &data, NULL));
        assert_ok(lg_series_read(NULL, path, NULL, NULL, &again, NULL));
        assert_int_equal(again.series.classes, classes);
        assert_memory_equal(again.series.class_name, data.series.class_name, classes * LG_SERIES_NAME);
        assert_memory_equal(again.series.label, data.series.label, classes * sizeof(uint32_t));
        assert_names(again.series.channel_name, 3, "|\xce\xb8|");
        lg_series_data_destroy(&data);
        lg_series_data_destroy(&again);
    }
}

/* ---- files of other programs ---- */

static void put_set(hid_t file, const char *name, hid_t stored, hid_t memory, int rank, const hsize_t *dims,
                    bool packed, const void *data) {
    const hsize_t chunk[3] = {4, 1, 3};
    hid_t space = H5Screate_simple(rank, dims, NULL), plist = H5Pcreate(H5P_DATASET_CREATE);
    if (packed)
        assert_true(H5Pset_chunk(plist, rank, chunk) >= 0 && H5Pset_shuffle(plist) >= 0 &&
                    H5Pset_deflate(plist, 4) >= 0);
    hid_t set = H5Dcreate2(file, name, stored, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0 && H5Dwrite(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Pclose(plist) >= 0 && H5Sclose(space) >= 0);
}

/* Whole numbers -25..25 in /X of `stored`; no labels yet, no attributes. */
static const char *foreign_file(hid_t stored, int rank, bool packed) {
    const char *path = scratch_path("foreign.h5");
    const hsize_t three[3] = {WINDOWS, CHANNELS, LENGTH}, two[2] = {WINDOWS, WINDOW};
    double x[WINDOWS * WINDOW];
    for (size_t i = 0; i < LG_COUNT(x); i++) x[i] = (double)(i * 7 % 51) - 25;
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(file >= 0);
    put_set(file, "X", stored, H5T_NATIVE_DOUBLE, rank, rank == 3 ? three : two, packed && rank == 3, x);
    assert_true(H5Fclose(file) >= 0);
    return path;
}

static void put_labels(const char *path, const char *name, hid_t stored, int rank, const double *values) {
    const hsize_t dims[2] = {WINDOWS, 1};
    replace_dataset(path, name, stored, H5T_NATIVE_DOUBLE, rank, dims, values);
}

/* size 0: variable length */
static void put_text_labels(const char *path, const char *name, size_t size, H5T_str_t padding, int rank,
                            const char *const *values) {
    const hsize_t dims[2] = {WINDOWS, 1};
    char fixed[WINDOWS * 128];
    hid_t type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, size > 0 ? size : H5T_VARIABLE) >= 0 && H5Tset_strpad(type, padding) >= 0);
    memset(fixed, padding == H5T_STR_SPACEPAD ? ' ' : 0, sizeof fixed);
    for (size_t i = 0; i < WINDOWS && size > 0; i++)
        memcpy(fixed + i * size, values[i], strlen(values[i]) < size ? strlen(values[i]) : size);
    replace_dataset(path, name, type, type, rank, dims,
                    size > 0 ? (const void *)fixed : (const void *)values);
    assert_true(H5Tclose(type) >= 0);
}

static void assert_labels(const char *path, const lg_series *like, const char *names,
                          const uint32_t *expected) {
    lg_series_data data;
    lg_error error = {LG_OK, ""};
    if (lg_series_read(NULL, path, NULL, like, &data, &error) != LG_OK) fail_msg("%s", error.message);
    assert_names(data.series.class_name, data.series.classes, names);
    assert_memory_equal(data.series.label, expected, WINDOWS * sizeof *expected);
    lg_series_data_destroy(&data);
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
        lg_series_data data;
        const char *path = foreign_file(cases[i].stored, cases[i].rank, cases[i].packed);
        put_labels(path, "y", H5T_STD_U8LE, 1, plain);
        assert_ok(lg_series_read(NULL, path, NULL, NULL, &data, NULL));
        assert_int_equal(data.series.channels, cases[i].rank == 3 ? CHANNELS : 1);
        assert_int_equal(data.series.length, cases[i].rank == 3 ? LENGTH : WINDOW);
        for (size_t j = 0; j < WINDOWS * WINDOW; j++)
            assert_close(data.series.x[j], (double)(j * 7 % 51) - 25, 0, 0);
        assert_names(data.series.class_name, data.series.classes, "0|1");
        assert_true(data.series.group == NULL && data.series.run == NULL && data.series.channel_name == NULL);
        assert_close(data.series.rate, 0, 0, 0);
        assert_true(isnan(data.noise) && isnan(data.severity));
        assert_string_equal(data.provenance.command, "");
        assert_int_equal(strlen(data.sha256), 64);
        lg_series_data_destroy(&data);
    }
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
        {H5T_STD_I32BE, 1, {5, 0, 2, 5, 0, 2}, NULL, "0|2|5", {2, 0, 1, 2, 0, 1}},
        {H5T_IEEE_F32LE, 1, {0, 0, 0, 0, 0, 0}, NULL, "0", {0, 0, 0, 0, 0, 0}},
        {H5T_STD_I64LE, 1, {1099511627776, 7, 7, 7, 7, 7}, NULL, "7|1099511627776", {1, 0, 0, 0, 0, 0}},
        {H5T_STD_I8LE, 1, {-1, 1, 1, -1, 1, -1}, "bad|good", "bad|good", {0, 1, 1, 0, 1, 0}},
        {H5T_IEEE_F64LE, 1, {2, 1, 1, 1, 1, 2}, "a|b", "a|b", {1, 0, 0, 0, 0, 1}},
        /* within 0..K-1 the number is the class, even where one is missing */
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
    static const char *const digits[WINDOWS] = {"10", "9", "10", "9", "10", "9"}; /* bytewise: 10 first */
    static const uint32_t rising[WINDOWS] = {1, 2, 1, 0, 2, 1}, listed[WINDOWS] = {0, 1, 0, 2, 1, 0};
    static const uint32_t both[WINDOWS] = {0, 1, 0, 1, 0, 1};
    const struct {
        size_t size;
        H5T_str_t padding;
        int rank;
    } types[] = {{0, H5T_STR_NULLTERM, 1},
                 {0, H5T_STR_NULLTERM, 2},
                 {8, H5T_STR_NULLPAD, 1}, /* "worn out" without a terminator */
                 {16, H5T_STR_NULLTERM, 2},
                 {20, H5T_STR_SPACEPAD, 1}};
    for (size_t i = 0; i < LG_COUNT(types); i++) {
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_text_labels(path, "y", types[i].size, types[i].padding, types[i].rank, words);
        assert_labels(path, NULL, "leak|ok|worn out", rising);
        replace_text(path, "/", "classes", "ok|worn out|leak"); /* another order */
        assert_labels(path, NULL, "ok|worn out|leak", listed);
        replace_text(path, "/", "classes", "L|O|W"); /* other names: in rising order */
        assert_labels(path, NULL, "L|O|W", rising);
        put_text_labels(path, "y", types[i].size, types[i].padding, types[i].rank, digits);
        delete_attribute(path, "/", "classes");
        assert_labels(path, NULL, "10|9", both);
    }
}

/* numpy's bool is an enumeration. */
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

/* A list of texts, as attrs["classes"] = ["a", "b"] writes; numbers are no names. */
TEST("a list of texts is names, and a list of numbers is not") {
    const char *const names[2] = {"dry|cold", "wet"};
    const hsize_t n = 2;
    const uint32_t expected[WINDOWS] = {0, 1, 0, 1, 1, 0};
    lg_series_data data;
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_labels(path, "y", H5T_STD_U8LE, 1, plain);
    hid_t file = open_for_change(path), space = H5Screate_simple(1, &n, NULL), type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, H5T_VARIABLE) >= 0);
    for (int i = 0; i < 2; i++) {
        hid_t attribute =
            H5Acreate2(file, i == 0 ? "classes" : "channels", type, space, H5P_DEFAULT, H5P_DEFAULT);
        assert_true(attribute >= 0 && H5Awrite(attribute, type, names) >= 0 && H5Aclose(attribute) >= 0);
    }
    assert_true(H5Tclose(type) >= 0 && H5Sclose(space) >= 0 && H5Fclose(file) >= 0);
    assert_ok(lg_series_read(NULL, path, NULL, NULL, &data, NULL));
    assert_memory_equal(data.series.label, expected, sizeof expected);
    assert_string_equal(data.series.class_name[0], "dry|cold");
    assert_string_equal(data.series.channel_name[1], "wet");
    lg_series_data_destroy(&data);
    replace_integer(path, "/", "classes", 2);
    replace_integer(path, "/", "channels", 2);
    replace_text(path, "/", "noise", "gaussian"); /* means something else there */
    replace_integer(path, "/", "housing", 4);
    replace_text(path, "/", "format", "UCR");
    replace_text(path, "/", "kind", "archive");
    assert_labels(path, NULL, "0|1", expected);
}

TEST("units of other programs are read") {
    static const char *const people[WINDOWS] = {"p7", "p7", "p12", "p12", "p9", "p9"};
    static const double runs[WINDOWS] = {40, 40, 3, 3, 3, 0}, rate = 12.5;
    static const uint32_t groups[WINDOWS] = {1, 1, 0, 0, 2, 2};
    lg_series_data data;
    const char *path = foreign_file(H5T_IEEE_F64LE, 3, false);
    put_labels(path, "y", H5T_STD_U8LE, 1, plain);
    put_text_labels(path, "group", 0, H5T_STR_NULLTERM, 1, people);
    put_labels(path, "run", H5T_IEEE_F64BE, 2, runs);
    replace_attribute(path, "/", "rate", H5T_IEEE_F32BE, H5T_NATIVE_DOUBLE, &rate);
    replace_text(path, "/", "channels", "left|");
    assert_ok(lg_series_read(NULL, path, NULL, NULL, &data, NULL));
    assert_memory_equal(data.series.group, groups, sizeof groups);
    for (size_t i = 0; i < WINDOWS; i++) assert_int_equal(data.series.run[i], runs[i]);
    assert_close(data.series.rate, 12.5, 0, 0);
    assert_names(data.series.channel_name, 2, "left|");
    lg_series_data_destroy(&data);
}

typedef struct heard {
    int count;
    char last[512];
} heard;

static void hear(void *user, lg_log_level level, const char *message) {
    heard *h = user;
    assert_int_equal(level, LG_LOG_WARNING);
    h->count++;
    (void)snprintf(h->last, sizeof h->last, "%s", message);
}

static lg_context *listening(heard *h) {
    lg_context *context;
    lg_context_options options;
    lg_context_options_init(&options);
    options.log = hear;
    options.log_user = h;
    assert_ok(lg_context_create(&options, &context));
    return context;
}

TEST("runs whose windows do not follow one another are left out, with a warning") {
    static const double runs[WINDOWS] = {1, 1, 2, 1, 2, 2};
    heard h = {0, ""};
    lg_series_data data;
    lg_context *context = listening(&h);
    const char *path = good_file();
    put_labels(path, "run", H5T_STD_I32LE, 1, runs);
    assert_ok(lg_series_read(context, path, NULL, NULL, &data, NULL));
    assert_null(data.series.run);
    assert_non_null(data.series.group);
    assert_int_equal(h.count, 1);
    assert_non_null(strstr(h.last, "series.h5: /run: the windows of run 1"));
    lg_series_data_destroy(&data);
    lg_context_destroy(context);
}

/* ---- a test file beside a training file ---- */

static lg_series classes_like(uint32_t classes, const char *const *names) {
    lg_series like = {.count = 1, .channels = 1, .length = 1, .classes = classes};
    assert_ok(lg_series_allocate(NULL, &like, false, false));
    for (uint32_t c = 0; c < classes; c++) set_name(like.class_name[c], names[c]);
    return like;
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
        heard h = {0, ""};
        lg_series_data data;
        lg_context *context = listening(&h);
        lg_series like = classes_like(3, cases[i].like);
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_labels(path, "y", H5T_STD_I32LE, 1, cases[i].y);
        if (cases[i].classes != NULL) replace_text(path, "/", "classes", cases[i].classes);
        assert_ok(lg_series_read(context, path, NULL, &like, &data, NULL));
        assert_int_equal(data.series.classes, 3);
        assert_names(data.series.class_name, 3, cases[i].names);
        assert_memory_equal(data.series.label, cases[i].expected, sizeof cases[i].expected);
        assert_int_equal(h.count, cases[i].warnings);
        lg_series_data_destroy(&data);
        lg_series_destroy(&like);
        lg_context_destroy(context);
    }
}

TEST("classes that do not match are refused") {
    static const struct {
        const char *like[2];
        double y[WINDOWS];
        const char *classes, *word;
    } cases[] = {
        {{"intact", "broken"}, {0, 1, 0, 1, 1, 0}, "intact|torn", "'torn'"},
        {{"intact", "broken"}, {1, 2, 1, 2, 1, 2}, NULL, "'1' is none of the classes intact|broken"},
        {{"intact", "broken"}, {1, 1, 1, 1, 1, 1}, NULL, "'1'"}, /* 0..1 or 1..2? */
        {{"intact", "broken"}, {0, 1, 2, 0, 1, 2}, NULL, "'0'"},
        {{"0", "1"}, {0, 1, -1, 0, 1, 0}, NULL, "'-1'"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_error error = {LG_OK, ""};
        lg_series_data data;
        lg_series like = classes_like(2, cases[i].like);
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_labels(path, "y", H5T_STD_I32LE, 1, cases[i].y);
        if (cases[i].classes != NULL) replace_text(path, "/", "classes", cases[i].classes);
        assert_status(lg_series_read(NULL, path, NULL, &like, &data, &error), LG_FORMAT);
        if (strstr(error.message, cases[i].word) == NULL) fail_msg("%s", error.message);
        lg_series_destroy(&like);
    }
    /* What does not occur needs no match. */
    lg_series like = classes_like(2, cases[0].like);
    const uint32_t expected[WINDOWS] = {0, 1, 0, 1, 1, 0};
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_labels(path, "y", H5T_STD_I32LE, 1, plain);
    replace_text(path, "/", "classes", "intact|broken|unheard of");
    assert_labels(path, &like, "intact|broken", expected);
    lg_series_destroy(&like);
    assert_status(lg_series_read(NULL, path, NULL, &like, &(lg_series_data){.sha256 = ""}, NULL),
                  LG_INVALID_ARGUMENT);
}

TEST("what numbers with names mean does not depend on which of them occur") {
    static const double one[WINDOWS] = {1, 2, 3, 1, 2, 3}, zero[WINDOWS] = {0, 1, 2, 0, 1, 2},
                        odd[WINDOWS] = {-1, 7, 9, -1, 7, 9};
    static const struct {
        const double *train;
        double y[WINDOWS];
        const char *classes; /* of the second file */
        uint32_t expected[WINDOWS];
        const char *word; /* of an error; NULL: none */
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
        heard h = {0, ""};
        lg_context *context = listening(&h);
        lg_series_data train, data;
        lg_error error = {LG_OK, ""};
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_labels(path, "y", H5T_STD_I32LE, 1, cases[i].train);
        replace_text(path, "/", "classes", "a|b|c");
        assert_ok(lg_series_read(context, path, NULL, NULL, &train, NULL));
        assert_memory_equal(train.series.label, ((const uint32_t[]){0, 1, 2, 0, 1, 2}), WINDOWS * 4);
        path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_labels(path, "y", H5T_STD_I32LE, 1, cases[i].y);
        if (cases[i].classes != NULL) replace_text(path, "/", "classes", cases[i].classes);
        const lg_status status = lg_series_read(context, path, NULL, &train.series, &data, &error);
        if (cases[i].word != NULL) {
            assert_status(status, LG_FORMAT);
            if (strstr(error.message, cases[i].word) == NULL) fail_msg("%zu: %s", i, error.message);
        } else {
            if (status != LG_OK) fail_msg("%zu: %s", i, error.message);
            assert_memory_equal(data.series.label, cases[i].expected, sizeof cases[i].expected);
            assert_names(data.series.class_label, 3,
                         cases[i].train == one    ? "1|2|3"
                         : cases[i].train == zero ? "0|1|2"
                                                  : "-1|7|9");
            lg_series_data_destroy(&data);
        }
        assert_int_equal(h.count, 0);
        lg_series_data_destroy(&train);
        lg_context_destroy(context);
    }
}

TEST("labels without names are names: one that did not occur is no number of a class") {
    static const char *const names[] = {"1", "2", "3"};
    static const double y[WINDOWS] = {0, 1, 2, 0, 1, 2};
    lg_series_data data;
    lg_error error = {LG_OK, ""};
    lg_series like = classes_like(3, names);
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_labels(path, "y", H5T_STD_I32LE, 1, y);
    assert_status(lg_series_read(NULL, path, NULL, &like, &data, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "'0' is none of the classes 1|2|3"));
    lg_series_destroy(&like);
}

/* Neither 0 nor K occurs and nothing else tells: 0 is taken, with a warning. class_labels tells. */
TEST("class_labels tells what 0 means; without it 0 is taken, with a warning") {
    static const double y[WINDOWS] = {1, 2, 1, 2, 1, 2};
    static const uint32_t from_zero[WINDOWS] = {1, 2, 1, 2, 1, 2}, given[WINDOWS] = {2, 0, 2, 0, 2, 0};
    heard h = {0, ""};
    lg_context *context = listening(&h);
    lg_series_data data;
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_labels(path, "y", H5T_STD_I32LE, 1, y);
    replace_text(path, "/", "classes", "a|b|c");
    assert_ok(lg_series_read(context, path, NULL, NULL, &data, NULL));
    assert_memory_equal(data.series.label, from_zero, sizeof from_zero);
    assert_int_equal(h.count, 1);
    assert_non_null(strstr(h.last, "class_labels"));
    lg_series_data_destroy(&data);
    replace_text(path, "/", "class_labels", "2|3|1");
    assert_ok(lg_series_read(context, path, NULL, NULL, &data, NULL));
    assert_memory_equal(data.series.label, given, sizeof given);
    assert_int_equal(h.count, 1);
    lg_series_data_destroy(&data);
    lg_context_destroy(context);
    replace_text(path, "/", "class_labels", "2|3");
    assert_refused(read_data, path, LG_FORMAT, "class_labels", "2 labels, but 3 classes");
    replace_text(path, "/", "class_labels", "2|3|4");
    assert_refused(read_data, path, LG_FORMAT, "class_labels", "'1' is none of 2|3|4");
    replace_integer(path, "/", "class_labels", 1);
    assert_refused(read_data, path, LG_FORMAT, "class_labels", "expected texts");
}

TEST("what this program writes counts from 0, whatever the file that was read said") {
    static const double y[WINDOWS] = {2, 3, 3, 2, 3, 2};
    static const uint32_t expected[WINDOWS] = {1, 2, 2, 1, 2, 1};
    heard h = {0, ""};
    lg_context *context = listening(&h);
    lg_series_data data, again;
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false), *out = scratch_path("again.h5");
    put_labels(path, "y", H5T_STD_I32LE, 1, y);
    replace_text(path, "/", "classes", "a|b|c");
    assert_ok(lg_series_read(context, path, NULL, NULL, &data, NULL));
    assert_memory_equal(data.series.label, expected, sizeof expected);
    assert_ok(lg_series_write(context, out, &data, NULL));
    assert_ok(lg_series_read(context, out, NULL, &data.series, &again, NULL));
    assert_memory_equal(again.series.label, expected, sizeof expected);
    lg_series_data_destroy(&again);
    assert_ok(lg_series_read(context, out, NULL, NULL, &again, NULL));
    assert_memory_equal(again.series.label, expected, sizeof expected);
    assert_int_equal(h.count, 0);
    lg_series_data_destroy(&again);
    lg_series_data_destroy(&data);
    lg_context_destroy(context);
}

/* ---- single precision ---- */

/* Of each channel offset + scale sin(i), in doubles. */
static void put_waves(const char *path, const double offset[CHANNELS], const double scale[CHANNELS]) {
    const hsize_t dims[3] = {WINDOWS, CHANNELS, LENGTH};
    double x[WINDOWS * WINDOW];
    for (size_t i = 0; i < LG_COUNT(x); i++) {
        const size_t c = i / LENGTH % CHANNELS;
        x[i] = offset[c] + scale[c] * sin((double)i);
    }
    replace_dataset(path, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, dims, x);
}

TEST("a spread that floats lose is told, or refused") {
    static const struct {
        double offset[CHANNELS], scale[CHANNELS];
        const char *warning, *word;
    } cases[] = {
        {{0, 5}, {1, 1}, NULL, NULL},
        {{0, 1e4}, {1e-20, 1}, NULL, NULL},
        {{0.1, 1e8}, {0, 0}, NULL, NULL},        /* constant */
        {{0.1, 1e8}, {1e-17, 1e-8}, NULL, NULL}, /* constant but for the rounding of doubles */
        {{0, 1e6}, {1, 1}, "channel 2 'moment_x'", NULL},
        {{1e6, 1e6}, {1, 1}, "of others", NULL},
        {{0, 1e8}, {1, 1}, NULL, "channel 2 'moment_x'"},
        {{0, 0}, {1e-300, 1}, NULL, "channel 1 'acc_lower_x'"},
        {{0, 1e9}, {1, 0.01}, NULL, "subtract the channel's mean or rescale it"}, /* constant as floats */
        {{-1e8, 0}, {1, 1}, NULL, "channel 1"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        heard h = {0, ""};
        lg_context *context = listening(&h);
        lg_series_data data;
        lg_error error = {LG_OK, ""};
        const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
        put_labels(path, "y", H5T_STD_I32LE, 1, plain);
        replace_text(path, "/", "channels", "acc_lower_x|moment_x");
        put_waves(path, cases[i].offset, cases[i].scale);
        const lg_status status = lg_series_read(context, path, NULL, NULL, &data, &error);
        if (status != (cases[i].word != NULL ? LG_FORMAT : LG_OK)) fail_msg("%zu: %s", i, error.message);
        if (cases[i].word != NULL && strstr(error.message, cases[i].word) == NULL)
            fail_msg("%zu: %s", i, error.message);
        assert_int_equal(h.count, cases[i].warning != NULL);
        if (cases[i].warning != NULL && strstr(h.last, cases[i].warning) == NULL) fail_msg("%s", h.last);
        if (status == LG_OK) lg_series_data_destroy(&data);
        lg_context_destroy(context);
    }
}

TEST("more than one block of rows is read, in chunks that do not divide them") {
    enum { ROWS = 700, SAMPLES = 300 };
    const hsize_t dims[2] = {ROWS, SAMPLES}, chunk[2] = {37, 64};
    double *x = malloc(sizeof *x * ROWS * SAMPLES), y[ROWS];
    lg_series_data data;
    const char *path = scratch_path("blocks.h5");
    assert_non_null(x);
    for (size_t i = 0; i < ROWS; i++) y[i] = (double)(i % 2);
    for (size_t i = 0; i < (size_t)ROWS * SAMPLES; i++) x[i] = sin(0.01 * (double)i);
    for (int packed = 0; packed < 2; packed++) {
        hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
              space = H5Screate_simple(2, dims, NULL), plist = H5Pcreate(H5P_DATASET_CREATE);
        if (packed) assert_true(H5Pset_chunk(plist, 2, chunk) >= 0 && H5Pset_deflate(plist, 1) >= 0);
        hid_t set = H5Dcreate2(file, "X", H5T_IEEE_F64LE, space, H5P_DEFAULT, plist, H5P_DEFAULT);
        assert_true(H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, x) >= 0);
        put_set(file, "y", H5T_STD_U8LE, H5T_NATIVE_DOUBLE, 1, dims, false, y);
        assert_true(H5Dclose(set) >= 0 && H5Pclose(plist) >= 0 && H5Sclose(space) >= 0 &&
                    H5Fclose(file) >= 0);
        assert_ok(lg_series_read(NULL, path, NULL, NULL, &data, NULL));
        for (size_t i = 0; i < (size_t)ROWS * SAMPLES; i++)
            if (data.series.x[i] != (float)x[i]) fail_msg("sample %zu", i);
        lg_series_data_destroy(&data);
    }
    free(x);
}

TEST("rates of other programs are read") {
    heard h = {0, ""};
    lg_context *context = listening(&h);
    lg_series_data data;
    const char *path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_labels(path, "y", H5T_STD_I32LE, 1, plain);
    replace_text(path, "/", "rate", "10 Hz");
    assert_ok(lg_series_read(context, path, NULL, NULL, &data, NULL));
    assert_close(data.series.rate, 0, 0, 0);
    assert_int_equal(h.count, 1);
    assert_non_null(strstr(h.last, "attribute rate"));
    lg_series_data_destroy(&data);
    lg_context_destroy(context);
}

/* ---- bad input ---- */

TEST("a damaged file is refused") {
    static const char *const words[WINDOWS] = {"ok", "leak", "ok", "worn out", "leak", "ok"};
    refuse_damaged_files(read_data, good_file(), "");
    survive_changed_bytes(read_data, good_file(), 80);
    const char *path = foreign_file(H5T_IEEE_F64BE, 3, true);
    put_text_labels(path, "y", 0, H5T_STR_NULLTERM, 1, words);
    put_text_labels(path, "group", 12, H5T_STR_NULLPAD, 1, words);
    survive_changed_bytes(read_data, path, 80);
}

TEST("an array of the wrong shape or value is refused by name") {
    static const bad_array cases[] = {
        {"X", 1, {60}, 0, LG_FORMAT, "rank 1"},
        {"X", 4, {6, 2, 5, 1}, 0, LG_FORMAT, "rank 4"},
        {"X", 3, {0, 2, 5}, 0, LG_FORMAT, "0 windows"},
        {"X", 3, {6, 0, 5}, 0, LG_FORMAT, "0 channels"},
        {"X", 3, {6, 2, 0}, 0, LG_FORMAT, "0 samples"},
        {"X", 2, {6, 0}, 0, LG_FORMAT, "0 samples"},
        {"X", 3, {7, 2, 5}, 0, LG_FORMAT, "/y: 6 of them, /X has 7 windows"},
        {"X", 3, {6, 2, 5}, NAN, LG_NOT_FINITE, "NaN in window 0, channel 0, sample 0"},
        {"X", 3, {6, 2, 5}, INFINITY, LG_NOT_FINITE, "single precision in window 0"},
        {"X", 3, {6, 2, 5}, -1e39, LG_NOT_FINITE, "single precision"},
        {"X", 3, {6, 3, 5}, 0, LG_FORMAT, "channels: 2 names, expected 3"},
        {"y", 1, {5}, 0, LG_FORMAT, "5 of them"},
        {"y", 1, {0}, 0, LG_FORMAT, "0 of them"},
        {"y", 2, {6, 2}, 0, LG_FORMAT, "2 columns"},
        {"y", 2, {6, 0}, 0, LG_FORMAT, "rank 2"},
        {"y", 2, {1, 6}, 0, LG_FORMAT, "rank 2"},
        {"y", 3, {6, 1, 1}, 0, LG_FORMAT, "rank 3"},
        {"y", 1, {6}, 0.5, LG_FORMAT, "0.5 at index (0) is not a whole number"},
        {"y", 1, {6}, NAN, LG_NOT_FINITE, "index (0)"},
        {"y", 1, {6}, INFINITY, LG_NOT_FINITE, "index (0)"},
        {"y", 1, {6}, 1e300, LG_FORMAT, "not a whole number"},
        {"y", 1, {6}, 3, LG_FORMAT, "3 names, but /y has 1 different labels from '3' to '3'"},
        {"y", 1, {6}, 1099511627776, LG_FORMAT, "3 names"},
        {"y", 1, {6}, -1, LG_FORMAT, "3 names"},
        {"group", 1, {6}, -1, LG_FORMAT, "is -1 at index (0)"},
        {"group", 1, {6}, 4294967296, LG_FORMAT, "is 4294967296 at index (0)"},
        {"group", 1, {6}, 1.5, LG_FORMAT, "whole"},
        {"group", 1, {7}, 1, LG_FORMAT, "7 of them"},
        {"run", 1, {5}, 1, LG_FORMAT, "5 of them"},
        {"run", 1, {6}, -3, LG_FORMAT, "is -3"},
        {"run", 2, {6, 3}, 1, LG_FORMAT, "3 columns"},
    };
    refuse_arrays(read_data, good_file, false, cases, LG_COUNT(cases));
    static const char *const needed[] = {"X", "y"};
    refuse_without_links(read_data, good_file, "has no", needed, LG_COUNT(needed));
}

TEST("the place of the first bad sample is told, and of no other") {
    const hsize_t dims[3] = {WINDOWS, CHANNELS, LENGTH};
    double x[WINDOWS * WINDOW] = {0};
    x[4 * WINDOW + LENGTH + 3] = NAN;
    x[5 * WINDOW] = INFINITY;
    const char *path = good_file();
    replace_dataset(path, "X", H5T_IEEE_F64BE, H5T_NATIVE_DOUBLE, 3, dims, x);
    assert_refused(read_data, path, LG_NOT_FINITE, "/X: NaN in window 4, channel 1, sample 3", "");
    x[4 * WINDOW + LENGTH + 3] = 3.5e38; /* beyond a float by a little */
    replace_dataset(path, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, dims, x);
    assert_refused(read_data, path, LG_NOT_FINITE, "precision in window 4, channel 1, sample 3", "");
    x[4 * WINDOW + LENGTH + 3] = 3.4e38;
    replace_dataset(path, "X", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 3, dims, x);
    assert_refused(read_data, path, LG_NOT_FINITE, "precision in window 5, channel 0, sample 0", "");
}

TEST("a label that int64 does not hold is refused") {
    const hsize_t dims[1] = {WINDOWS};
    const uint64_t large[WINDOWS] = {0, 1, 2, 0, 1, (uint64_t)INT64_MAX + 1};
    const char *path = good_file();
    replace_dataset(path, "y", H5T_STD_U64LE, H5T_NATIVE_UINT64, 1, dims, large);
    assert_refused(read_data, path, LG_FORMAT, "/y: cannot be read", "out of range");
}

TEST("texts where numbers belong, and texts that are no names, are refused") {
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

static void put_empty(const char *path, const char *name, hid_t type, int rank, const hsize_t *dims) {
    const hsize_t chunk[3] = {1, 1, 1};
    delete_link(path, name);
    hid_t file = open_for_change(path), plist = H5Pcreate(H5P_DATASET_CREATE);
    hid_t space = H5Screate_simple(rank, dims, NULL);
    assert_true(H5Pset_chunk(plist, rank, chunk) >= 0);
    hid_t set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0 && H5Dclose(set) >= 0 && H5Sclose(space) >= 0);
    assert_true(H5Pclose(plist) >= 0 && H5Fclose(file) >= 0);
}

TEST("sizes that nobody has memory for are refused, without a byte behind them") {
    static const struct {
        const char *name;
        int rank;
        hsize_t dims[3];
        bool texts;
    } cases[] = {{"X", 3, {1000000000000, 2, 5}, false},
                 {"X", 3, {6, 1000000000, 1000000}, false},
                 {"X", 3, {4294967296, 4294967296, 4294967296}, false},
                 {"X", 2, {6, 2000000000000}, false},
                 {"y", 1, {2000000000000}, false},
                 {"y", 1, {2000000000000}, true},
                 {"group", 1, {2000000000000}, false},
                 {"run", 2, {2000000000000, 1}, true}};
    hid_t text = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(text, 2000) >= 0);
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = good_file();
        put_empty(path, cases[i].name, cases[i].texts ? text : H5T_IEEE_F64LE, cases[i].rank, cases[i].dims);
        assert_refused(read_data, path, LG_FORMAT, cases[i].name, "");
    }
    assert_true(H5Tclose(text) >= 0);
}

/* Data that went through a filter of another program. */
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

TEST("the limit counts what lies in memory: floats, whatever the stored type") {
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

TEST("an attribute of the wrong type or value is refused by name") {
    static const struct {
        const char *name;
        double value;
        lg_status status;
    } reals[] = {{"rate", -1, LG_FORMAT},
                 {"rate", NAN, LG_NOT_FINITE},
                 {"rate", INFINITY, LG_NOT_FINITE},
                 {"noise", NAN, LG_NOT_FINITE},
                 {"severity", INFINITY, LG_NOT_FINITE}};
    for (size_t i = 0; i < LG_COUNT(reals); i++) {
        const char *path = good_file();
        replace_attribute(path, "/", reals[i].name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &reals[i].value);
        assert_refused(read_data, path, reals[i].status, reals[i].name, "");
    }
    static const char *const texts[][3] = {
        {"rate", "10 Hz", "number"},
        {"noise", "much", "number"},
        {"kind", "elastica", "series"},
        {"classes", "", "empty"},
        {"classes", "a|b|", "number 3 is empty"},
        {"classes", "a|b|a", "'a' is there twice"},
        {"classes", "a", "1 names, but /y has 2 different"},
        {"classes", "a|bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb|c", "63 bytes"},
        {"channels", "a", "1 names, expected 2"},
        {"channels", "a|b|c", "3 names, expected 2"},
        {"housing", "a housing that has a long name", "housing"}};
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        const char *path = good_file();
        replace_text(path, "/", texts[i][0], texts[i][1]);
        assert_refused(read_data, path, LG_FORMAT, texts[i][0], texts[i][2]);
    }
    const char *path = good_file();
    replace_integer(path, "/", "format_version", 2);
    assert_refused(read_data, path, LG_VERSION, "format_version", "2");
}

TEST("a series that could not be read is not written") {
    lg_series_data data;
    lg_error error = {LG_OK, ""};
    const char *path = scratch_path("refused.h5");
    make_series(true, &data);
    lg_series *s = &data.series;
#define REFUSED(place, bad, good, status)                                                                    \
    do {                                                                                                     \
        place = bad;                                                                                         \
        assert_status(lg_series_write(NULL, path, &data, &error), status);                                   \
        assert_non_null(strstr(error.message, "refused.h5"));                                                \
        place = good;                                                                                        \
    } while (0)
    REFUSED(s->x[2 * WINDOW + LENGTH + 1], NAN, 0, LG_NOT_FINITE);
    REFUSED(s->x[0], INFINITY, 0, LG_NOT_FINITE);
    REFUSED(s->label[5], 3, 2, LG_INVALID_ARGUMENT);
    REFUSED(s->run[0], 7, 9, LG_INVALID_ARGUMENT);
    REFUSED(s->rate, -1, 10, LG_INVALID_ARGUMENT);
    REFUSED(s->rate, NAN, 10, LG_NOT_FINITE);
    REFUSED(data.noise, INFINITY, 1, LG_NOT_FINITE);
    REFUSED(data.severity, INFINITY, 1, LG_NOT_FINITE);
    REFUSED(s->class_name[1][0], '\0', 'c', LG_INVALID_ARGUMENT);
    set_name(s->class_name[1], "intact");
    assert_status(lg_series_write(NULL, path, &data, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "twice"));
    memset(s->class_name[1], 'x', LG_SERIES_NAME);
    assert_status(lg_series_write(NULL, path, &data, NULL), LG_INVALID_ARGUMENT);
    set_name(s->class_name[1], "cracked");
    memset(data.housing, 'x', sizeof data.housing);
    assert_status(lg_series_write(NULL, path, &data, NULL), LG_INVALID_ARGUMENT);
    data.housing[3] = '\0';
    assert_status(lg_series_write(NULL, scratch_path("no/folder.h5"), &data, NULL), LG_FILE);
    assert_status(lg_series_write(NULL, NULL, &data, NULL), LG_INVALID_ARGUMENT);
    assert_int_not_equal(access(path, F_OK), 0);
    assert_ok(lg_series_write(NULL, path, &data, NULL));
    lg_series_data_destroy(&data);
    assert_status(lg_series_write(NULL, path, &data, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_series_read(NULL, NULL, NULL, NULL, &data, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_series_read(NULL, path, NULL, NULL, NULL, NULL), LG_INVALID_ARGUMENT);
}

/* ---- memory ---- */

static lg_status read_like_step(const lg_context *context, void *user, lg_error *error) {
    static const char *const names[] = {"leak", "ok", "worn out", "new"};
    lg_series like = classes_like(4, names);
    lg_series_data data;
    const lg_read_options options = without_probe();
    const lg_status status = lg_series_read(context, user, &options, &like, &data, error);
    if (status == LG_OK) lg_series_data_destroy(&data);
    lg_series_destroy(&like);
    return status;
}

static lg_status write_step(const lg_context *context, void *user, lg_error *error) {
    lg_series_data data;
    make_series(true, &data);
    const lg_status status = lg_series_write(context, user, &data, error);
    lg_series_data_destroy(&data);
    return status;
}

TEST("every allocation may fail, and nothing leaks") {
    static const char *const words[WINDOWS] = {"ok", "leak", "ok", "worn out", "leak", "ok"};
    const char *path = good_file();
    assert_true(fail_every_reading(read_data, path) >= 20);
    assert_true(fail_every_allocation(write_step, (void *)path) >= 5);
    path = foreign_file(H5T_IEEE_F32LE, 3, false);
    put_text_labels(path, "y", 0, H5T_STR_NULLTERM, 1, words);
    put_labels(path, "group", H5T_IEEE_F64LE, 1, plain);
    replace_text(path, "/", "classes", "worn out|leak|ok");
    assert_true(fail_every_allocation(read_like_step, (void *)path) >= 20);
}
