/* Shared by the tests of src/classify: clouds of points, an archive in memory. */
#ifndef LG_CLASSIFY_SUPPORT_H
#define LG_CLASSIFY_SUPPORT_H

#include "test_support.h"

#include "liegrad/archive.h"
#include "liegrad/classify.h"
#include "liegrad/random.h"

/* n points in d dimensions, class i mod classes, whose centres lie `apart` along different axes. */
static inline double *clouds(size_t n, uint32_t d, uint32_t classes, double apart, uint64_t seed,
                             uint32_t *label) {
    double *x = TEST_ARRAY(double, n *d);
    lg_rng rng;
    lg_rng_seed(&rng, seed, 0);
    for (size_t i = 0; i < n; i++) {
        label[i] = (uint32_t)(i % classes);
        for (uint32_t j = 0; j < d; j++)
            x[i * d + j] = lg_rng_normal(&rng) + (j % classes == label[i] ? apart : 0.0);
    }
    return x;
}

/* Objects by value, whose memory the running test owns. */
#define CLASSIFY_OWNED(type)                                                                                 \
    static inline void release_##type(void *object) {                                                        \
        type##_destroy(object);                                                                              \
    }                                                                                                        \
    static inline type own_##type(type object) {                                                             \
        type *kept = TEST_ARRAY(type, 1);                                                                    \
        *kept = object;                                                                                      \
        lg_test_owns(kept, release_##type);                                                                  \
        return object;                                                                                       \
    }
CLASSIFY_OWNED(lg_series)
CLASSIFY_OWNED(lg_features)
CLASSIFY_OWNED(lg_windows)
CLASSIFY_OWNED(lg_classifier)

static inline lg_features features_of(lg_feature_kind kind, bool directions_x, const lg_series *series,
                                      uint32_t length, const lg_scaler *scaler) {
    lg_features f;
    assert_ok(lg_features_create(NULL, kind, directions_x, series, length, scaler, &f, NULL));
    return own_lg_features(f);
}

static inline lg_windows windows_of(const lg_series *series) {
    lg_windows w;
    assert_ok(lg_windows_create(NULL, series, 0, 0, &w, NULL));
    return own_lg_windows(w);
}

typedef struct memory_item {
    char path[64];
    lg_element type;
    uint32_t rank;
    uint64_t dims[4];
    size_t bytes;
    unsigned char *data;
} memory_item;

typedef struct memory_archive {
    memory_item item[64];
    size_t count;
} memory_archive;

static inline memory_item *memory_find(memory_archive *archive, const char *path) {
    for (size_t i = 0; i < archive->count; i++)
        if (strcmp(archive->item[i].path, path) == 0) return &archive->item[i];
    return NULL;
}

static inline lg_status memory_put(memory_archive *archive, const char *path, const void *data,
                                   size_t bytes) {
    assert_null(memory_find(archive, path));
    assert_true(archive->count < 64 && strlen(path) < 64);
    memory_item *item = &archive->item[archive->count++];
    memset(item, 0, sizeof *item);
    (void)snprintf(item->path, sizeof item->path, "%s", path);
    item->bytes = bytes;
    item->data = malloc(bytes + 1);
    assert_non_null(item->data);
    memcpy(item->data, data, bytes);
    return LG_OK;
}

static inline lg_status memory_array(void *user, const char *path, lg_element type, uint32_t rank,
                                     const uint64_t *dims, const void *data) {
    memory_archive *archive = user;
    size_t bytes = type == LG_ELEMENT_F32 || type == LG_ELEMENT_U32 ? 4 : 8;
    for (uint32_t i = 0; i < rank; i++) bytes *= dims[i];
    const lg_status status = memory_put(archive, path, data, bytes);
    memory_item *item = &archive->item[archive->count - 1];
    item->type = type;
    item->rank = rank;
    for (uint32_t i = 0; i < rank; i++) item->dims[i] = dims[i];
    return status;
}

static inline lg_status memory_text(void *user, const char *path, const char *value) {
    return memory_put(user, path, value, strlen(value) + 1);
}

static inline lg_status memory_read(void *user, const char *path, lg_element type, uint32_t rank,
                                    const uint64_t *dims, void *out) {
    const memory_item *item = memory_find(user, path);
    if (item == NULL) return LG_NOT_FOUND;
    if (item->rank != rank) return LG_SHAPE;
    for (uint32_t i = 0; i < rank; i++)
        if (item->dims[i] != dims[i]) return LG_SHAPE;
    if (item->type != type) return LG_FORMAT;
    memcpy(out, item->data, item->bytes);
    return LG_OK;
}

static inline lg_status memory_shape(void *user, const char *path, uint32_t *rank, uint64_t dims[4]) {
    const memory_item *item = memory_find(user, path);
    if (item == NULL) return LG_NOT_FOUND;
    *rank = item->rank;
    memcpy(dims, item->dims, sizeof item->dims);
    return LG_OK;
}

static inline lg_status memory_read_text(void *user, const char *path, char *out, size_t size) {
    const memory_item *item = memory_find(user, path);
    if (item == NULL) return LG_NOT_FOUND;
    if (item->bytes > size) return LG_SHAPE;
    memcpy(out, item->data, item->bytes);
    return LG_OK;
}

static inline lg_archive_writer memory_writer(memory_archive *archive) {
    return (lg_archive_writer){.user = archive, .array = memory_array, .text = memory_text};
}

static inline lg_archive_reader memory_reader(memory_archive *archive) {
    return (lg_archive_reader){
        .user = archive, .array = memory_read, .shape = memory_shape, .text = memory_read_text};
}

static inline void memory_clear(memory_archive *archive) {
    for (size_t i = 0; i < archive->count; i++) free(archive->item[i].data);
    *archive = (memory_archive){0};
}

#endif
