/* Shared by the tests of files: a scratch folder, damaged copies, HDF5 files as other programs write them,
 * tables of damages, and failing allocations. */
#ifndef LG_IO_TEST_H
#define LG_IO_TEST_H

#include <dirent.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "files/h5.h"
#include "support/fixtures.h"

static char scratch[96];

static inline int scratch_begin(void **state) {
    (void)state;
    const char *base = getenv("TMPDIR");
    (void)snprintf(scratch, sizeof scratch, "%s/liegrad-test-XXXXXX", base != NULL ? base : "/tmp");
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    return mkdtemp(scratch) == NULL;
}

/* Number of files in the scratch folder. */
static inline size_t scratch_files(void) {
    size_t count = (size_t)-2; /* . and .. */
    DIR *folder = opendir(scratch);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) count++;
    (void)closedir(folder);
    return count;
}

static inline int scratch_end(void **state) {
    (void)state;
    if (H5Fget_obj_count((hid_t)H5F_OBJ_ALL, H5F_OBJ_ALL) != 0) {
        print_error("HDF5 objects were left open\n");
        return 1;
    }
    DIR *folder = opendir(scratch);
    if (folder == NULL) return 1;
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        char path[512];
        (void)snprintf(path, sizeof path, "%s/%s", scratch, entry->d_name);
        (void)unlink(path);
    }
    (void)closedir(folder);
    return rmdir(scratch);
}

TEST_GROUP(scratch_begin, scratch_end)

static inline const char *scratch_path(const char *name) {
    static char paths[8][128];
    static unsigned next;
    char *path = paths[next++ % 8];
    (void)snprintf(path, sizeof paths[0], "%s/%s", scratch, name);
    return path;
}

/* ---- bytes ---- */

/* Reads a file into memory of the running test. A zero byte follows the data. */
static inline unsigned char *read_bytes_of(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    *size = (size_t)ftell(file);
    rewind(file);
    unsigned char *data = lg_test_memory(*size + 1);
    assert_int_equal(fread(data, 1, *size, file), *size);
    (void)fclose(file);
    return data;
}

static inline void write_bytes_to(const char *path, const void *data, size_t size) {
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static inline void write_text_to(const char *path, const char *text) {
    write_bytes_to(path, text, strlen(text));
}

static inline void assert_same_bytes(const char *a, const char *b) {
    size_t na, nb;
    unsigned char *da = read_bytes_of(a, &na), *db = read_bytes_of(b, &nb);
    assert_int_equal(na, nb);
    assert_memory_equal(da, db, na);
}

/* Adds the bytes of doubles, the lowest byte of each first, whatever the order of this machine. */
static inline void sha256_add_little_endian(lg_sha256 *sha, const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        uint64_t bits;
        unsigned char bytes[8];
        memcpy(&bits, &values[i], sizeof bits);
        for (int k = 0; k < 8; k++) bytes[k] = (unsigned char)(bits >> (8 * k));
        lg_sha256_add(sha, bytes, sizeof bytes);
    }
}

/* Copies a file. Faster than writing it again through the library, which waits for the disk. */
static inline void copy_file(const char *from, const char *to) {
    size_t size;
    unsigned char *data = read_bytes_of(from, &size);
    write_bytes_to(to, data, size);
}

/* A copy of the file that `write` makes. `write` runs only for the first copy, because it waits for the
 * disk. */
static inline const char *fresh_copy(const char *name, void (*write)(const char *path)) {
    const char *original = test_text("%s.original", name);
    if (access(scratch_path(original), F_OK) != 0) write(scratch_path(original));
    const char *path = scratch_path(name);
    copy_file(scratch_path(original), path);
    return path;
}

/* ---- readers of files that are made to take long ---- */

/* Calls work(user) in a child that has seconds of processor time, where n^2 steps for n names take minutes.
 * */
static inline void assert_cheap(void (*work)(void *user), void *user) {
#ifdef LG_SANITIZED
    const struct rlimit most = {120, 120};
#else
    const struct rlimit most = {10, 10};
#endif
    int status = -1;
    const pid_t child = fork();
    if (child == 0) {
        if (setrlimit(RLIMIT_CPU, &most) != 0) _exit(1);
        work(user);
        _exit(0);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

/* ---- readers of damaged files ---- */

/* Reads the file and frees the result. */
typedef lg_status (*read_fn)(const lg_context *context, const char *path, const lg_read_options *options,
                             lg_error *error);

static inline lg_read_options without_probe(void) {
    lg_read_options options;
    lg_read_options_init(&options);
    options.probe = false;
    return options;
}

/* The reader must return `expected`, and its message must contain both words ("" for none). */
static inline void assert_refused_by(read_fn reader, const lg_read_options *options, const char *path,
                                     lg_status expected, const char *word1, const char *word2) {
    lg_error error = {LG_OK, ""};
    lg_status status = reader(NULL, path, options, &error);
    if (status != expected)
        fail_msg("%s: %s (%s), expected %s", path, lg_status_name(status), error.message,
                 lg_status_name(expected));
    assert_int_equal(error.status, expected);
    const char *const words[] = {strrchr(path, '/') + 1, word1, word2};
    for (size_t i = 0; i < 3; i++)
        if (strstr(error.message, words[i]) == NULL) fail_msg("no '%s' in: %s", words[i], error.message);
    /* The error may be NULL. */
    assert_int_equal(reader(NULL, path, options, NULL), expected);
}

static inline void assert_refused(read_fn reader, const char *path, lg_status expected, const char *word1,
                                  const char *word2) {
    assert_refused_by(reader, NULL, path, expected, word1, word2);
}

/* Every reader must refuse these files in the same way: missing, empty, a folder, the good file cut at each
 * tenth, PNG, text. `line`: a word that the messages of YAML readers contain. */
static inline void refuse_damaged_files(read_fn reader, const char *good, const char *line) {
    static const unsigned char png[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n', 0,
                                        0,    0,   13,  'I', 'H',  'D',  'R',  0xff};
    size_t size;
    unsigned char *data = read_bytes_of(good, &size);
    assert_ok(reader(NULL, good, NULL, NULL));
    assert_refused(reader, scratch_path("nothing-here"), LG_NOT_FOUND, "", "");
    assert_refused(reader, scratch, LG_FILE, "regular", "");
    const char *bad = scratch_path("damaged");
    write_bytes_to(bad, "", 0);
    assert_refused(reader, bad, LG_FORMAT, "empty", line);
    for (size_t tenth = 1; tenth < 10; tenth++) {
        write_bytes_to(bad, data, size * tenth / 10);
        assert_refused(reader, bad, LG_FORMAT, line, "");
    }
    write_bytes_to(bad, data, size - 1);
    lg_status last = reader(NULL, bad, NULL, NULL);
    assert_true(last == LG_OK || last == LG_FORMAT); /* the last byte may be padding */
    write_bytes_to(bad, png, sizeof png);
    assert_refused(reader, bad, LG_FORMAT, line, "");
    write_text_to(bad, "It was a dark and stormy night.\n");
    assert_refused(reader, bad, LG_FORMAT, line, "");
}

/* Reads copies in which single bytes are changed. Any status is allowed, but the process must not crash. */
static inline void survive_changed_bytes(read_fn reader, const char *good, size_t changes) {
    size_t size;
    unsigned char *data = read_bytes_of(good, &size);
    const char *bad = scratch_path("mutated");
    for (size_t i = 0; i < changes; i++) {
        size_t at = (size_t)((double)i / (double)changes * (double)size);
        unsigned char before = data[at];
        data[at] = (unsigned char)(before ^ (i % 3 == 0 ? 0xff : i % 3 == 1 ? 0x01 : 0x80));
        write_bytes_to(bad, data, size);
        lg_error error = {LG_OK, ""};
        lg_status status = reader(NULL, bad, NULL, &error);
        if (status != LG_OK && strstr(error.message, "mutated") == NULL)
            fail_msg("byte %zu: %s: %s", at, lg_status_name(status), error.message);
        data[at] = before;
    }
}

/* ---- HDF5 files as other programs write them ---- */

static inline hid_t open_for_change(const char *path) {
    hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(file >= 0);
    return file;
}

/* Writes a data set. `packed`: in chunks whose size does not divide the size of the data set. */
static inline void put_dataset(hid_t file, const char *name, hid_t stored, hid_t memory, int rank,
                               const hsize_t *dims, bool packed, const void *data) {
    hsize_t chunk[4];
    for (int i = 0; i < rank; i++) chunk[i] = dims[i] / 2 + 1;
    hid_t space = H5Screate_simple(rank, dims, NULL), plist = H5Pcreate(H5P_DATASET_CREATE);
    if (packed)
        assert_true(H5Pset_chunk(plist, rank, chunk) >= 0 && H5Pset_shuffle(plist) >= 0 &&
                    H5Pset_deflate(plist, 4) >= 0);
    hid_t set = H5Dcreate2(file, name, stored, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0);
    if (data != NULL) assert_true(H5Dwrite(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Pclose(plist) >= 0 && H5Sclose(space) >= 0);
}

/* Replaces a data set. */
static inline void replace_dataset(const char *path, const char *name, hid_t stored, hid_t memory, int rank,
                                   const hsize_t *dims, const void *data) {
    hid_t file = open_for_change(path);
    if (H5Lexists(file, name, H5P_DEFAULT) > 0) assert_true(H5Ldelete(file, name, H5P_DEFAULT) >= 0);
    put_dataset(file, name, stored, memory, rank, dims, false, data);
    assert_true(H5Fclose(file) >= 0);
}

static inline void delete_link(const char *path, const char *name) {
    hid_t file = open_for_change(path);
    assert_true(H5Ldelete(file, name, H5P_DEFAULT) >= 0 && H5Fclose(file) >= 0);
}

static inline void delete_attribute(const char *path, const char *object, const char *name) {
    hid_t file = open_for_change(path);
    if (H5Aexists_by_name(file, object, name, H5P_DEFAULT) > 0)
        assert_true(H5Adelete_by_name(file, object, name, H5P_DEFAULT) >= 0);
    assert_true(H5Fclose(file) >= 0);
}

static inline void replace_attribute(const char *path, const char *object, const char *name, hid_t stored,
                                     hid_t memory, const void *value) {
    delete_attribute(path, object, name);
    hid_t file = open_for_change(path), space = H5Screate(H5S_SCALAR);
    hid_t attribute =
        H5Acreate_by_name(file, object, name, stored, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(attribute >= 0 && H5Awrite(attribute, memory, value) >= 0);
    assert_true(H5Aclose(attribute) >= 0 && H5Sclose(space) >= 0 && H5Fclose(file) >= 0);
}

/* Replaces an attribute by a text of variable length, as h5py writes a str. */
static inline void replace_text(const char *path, const char *object, const char *name, const char *value) {
    hid_t type = H5Tcopy(H5T_C_S1);
    assert_true(type >= 0 && H5Tset_size(type, H5T_VARIABLE) >= 0 && H5Tset_cset(type, H5T_CSET_UTF8) >= 0);
    replace_attribute(path, object, name, type, type, &value);
    assert_true(H5Tclose(type) >= 0);
}

/* Replaces an attribute by a list of `count` equal texts. */
static inline void replace_texts(const char *path, const char *object, const char *name, const char *text,
                                 size_t count) {
    const size_t size = strlen(text) + 1;
    char *list = lg_test_memory(count * size);
    for (size_t i = 0; i < count; i++) memcpy(list + i * size, text, size);
    const hsize_t dims[1] = {count};
    delete_attribute(path, object, name);
    hid_t file = open_for_change(path), type = H5Tcopy(H5T_C_S1), space = H5Screate_simple(1, dims, NULL);
    assert_true(H5Tset_size(type, size) >= 0);
    hid_t at = H5Acreate_by_name(file, object, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(at >= 0 && H5Awrite(at, type, list) >= 0 && H5Aclose(at) >= 0);
    assert_true(H5Sclose(space) >= 0 && H5Tclose(type) >= 0 && H5Fclose(file) >= 0);
}

static inline void replace_integer(const char *path, const char *object, const char *name, int64_t value) {
    replace_attribute(path, object, name, H5T_STD_I64LE, H5T_NATIVE_INT64, &value);
}

/* Replaces a data set by an empty one that declares this size. It is stored in chunks, and no data are
 * written. */
static inline void declare_dataset(const char *path, const char *name, hid_t type, int rank,
                                   const hsize_t *dims) {
    const hsize_t chunk[4] = {1, 1, 1, 1};
    delete_link(path, name);
    hid_t file = open_for_change(path), plist = H5Pcreate(H5P_DATASET_CREATE);
    hid_t space = H5Screate_simple(rank, dims, NULL);
    assert_true(H5Pset_chunk(plist, rank, chunk) >= 0);
    hid_t set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, plist, H5P_DEFAULT);
    assert_true(set >= 0 && H5Dclose(set) >= 0 && H5Sclose(space) >= 0);
    assert_true(H5Pclose(plist) >= 0 && H5Fclose(file) >= 0);
}

/* ---- tables of damages; each row is applied to a new copy of a good file ---- */

typedef const char *(*fresh_fn)(void);

typedef struct change {
    enum { IS_GONE, IS_TEXT, IS_TEXTS, IS_REAL, IS_WHOLE, IS_ARRAY, IS_DECLARED } what;
    const char *text;
    double real;
    int64_t whole;
    int rank;
    hsize_t dims[4];
} change;

#define GONE                                                                                                 \
    { .what = IS_GONE }
#define TEXT(value)                                                                                          \
    { .what = IS_TEXT, .text = value }
#define TEXTS(value, count)                                                                                  \
    { .what = IS_TEXTS, .text = value, .whole = count }
#define REAL(value)                                                                                          \
    { .what = IS_REAL, .real = value }
#define WHOLE(value)                                                                                         \
    { .what = IS_WHOLE, .whole = value }
#define RANK_OF(...) (sizeof((hsize_t[]){__VA_ARGS__}) / sizeof(hsize_t))
#define ARRAY(value, ...)                                                                                    \
    {                                                                                                        \
        .what = IS_ARRAY, .real = value, .rank = RANK_OF(__VA_ARGS__), .dims = { __VA_ARGS__ }               \
    }
#define SCALAR(value)                                                                                        \
    { .what = IS_ARRAY, .real = value }
#define DECLARED(...)                                                                                        \
    {                                                                                                        \
        .what = IS_DECLARED, .rank = RANK_OF(__VA_ARGS__), .dims = { __VA_ARGS__ }                           \
    }

/* `at` says what is changed: a data set or group "model/conv1", or an attribute: "model@links" is the
 * attribute `links` of `model`, "@kind" an attribute of the root. The message must contain `word` and the
 * name of the changed object; if `word` begins with ~, only the rest of `word`. */
typedef struct damage {
    const char *at;
    change change;
    lg_status status;
    const char *word;
} damage;

static inline void change_attribute(const char *path, const char *object, const char *name, const change *c) {
    if (c->what == IS_GONE) delete_attribute(path, object, name);
    if (c->what == IS_TEXT) replace_text(path, object, name, c->text);
    if (c->what == IS_TEXTS) replace_texts(path, object, name, c->text, (size_t)c->whole);
    if (c->what == IS_WHOLE) replace_integer(path, object, name, c->whole);
    if (c->what == IS_REAL)
        replace_attribute(path, object, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &c->real);
}

static inline void change_link(const char *path, const char *name, const change *c) {
    double data[1024];
    size_t count = 1;
    for (int i = 0; i < c->rank; i++) count *= (size_t)c->dims[i];
    assert_true(c->what != IS_ARRAY || count <= LG_COUNT(data));
    for (size_t j = 0; j < LG_COUNT(data); j++) data[j] = c->real;
    if (c->what == IS_GONE) delete_link(path, name);
    if (c->what == IS_DECLARED) declare_dataset(path, name, H5T_IEEE_F64LE, c->rank, c->dims);
    if (c->what == IS_ARRAY)
        replace_dataset(path, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, c->rank, c->dims, data);
}

/* Applies the change. Returns the name of the changed data set, group or attribute, without the attribute's
 * object. */
static inline const char *apply_change(const char *path, const char *at, const change *c) {
    const char *mark = strchr(at, '@');
    char object[64] = "/";
    if (mark == NULL) {
        change_link(path, at, c);
        return at;
    }
    if (mark > at) (void)snprintf(object, sizeof object, "%.*s", (int)(mark - at), at);
    change_attribute(path, object, mark + 1, c);
    return mark + 1;
}

/* The files are read without the child process that first reads unknown files (it takes 20 ms under a
 * sanitizer): HDF5 itself wrote them, so they are well-formed. */
static inline void refuse_damage(read_fn reader, fresh_fn fresh, const damage *rows, size_t count) {
    const lg_read_options here = without_probe();
    for (size_t i = 0; i < count; i++) {
        const bool elsewhere = rows[i].word[0] == '~';
        const char *path = fresh(), *name = apply_change(path, rows[i].at, &rows[i].change);
        assert_refused_by(reader, &here, path, rows[i].status, elsewhere ? "" : name,
                          rows[i].word + elsewhere);
    }
}

/* Number of open HDF5 identifiers. */
static inline hsize_t open_identifiers(void) {
    static const H5I_type_t types[] = {H5I_FILE,    H5I_GROUP, H5I_DATATYPE,   H5I_DATASPACE,
                                       H5I_DATASET, H5I_ATTR,  H5I_GENPROP_LST};
    hsize_t total = 0;
    for (size_t i = 0; i < LG_COUNT(types); i++) {
        hsize_t count = 0;
        if (H5Inmembers(types[i], &count) >= 0) total += count;
    }
    return total;
}

/* ---- failing allocations ---- */

/* Calls act(context, user) with every allocation failing in turn. No HDF5 identifier may stay open. Returns
 * the number of failures. */
static inline size_t
fail_every_allocation(lg_status (*act)(const lg_context *context, void *user, lg_error *error), void *user) {
    lg_error error;
    size_t calls = 0;
    assert_ok(act(NULL, user, &error)); /* the first call lets HDF5 open identifiers that it keeps */
    const hsize_t open = open_identifiers();
    EVERY_ALLOCATION_FAILS(context, 0, {
        calls++;
        status = act(context, user, &error);
        assert_int_equal(open_identifiers(), open);
    });
    return calls - 1;
}

/* A reader that is called without the child process that otherwise checks a file first: allocations in the
 * child process could not be made to fail. */
typedef struct reading {
    read_fn reader;
    const char *path;
} reading;

static inline lg_status reading_step(const lg_context *context, void *user, lg_error *error) {
    const reading *r = user;
    const lg_read_options options = without_probe();
    return r->reader(context, r->path, &options, error);
}

static inline size_t fail_every_reading(read_fn reader, const char *path) {
    reading r = {reader, path};
    return fail_every_allocation(reading_step, &r);
}

#endif
