/* An archive in memory. The running test owns what is stored in it. */
#ifndef LG_MEMORY_ARCHIVE_H
#define LG_MEMORY_ARCHIVE_H

#include "test_support.h"

#include "liegrad/core.h"

typedef struct memory_item {
    char path[64];
    lg_element type;
    uint32_t rank;
    uint64_t dims[4];
    size_t bytes;
    void *data; /* owned by the running test */
} memory_item;

typedef struct memory_archive {
    memory_item items[96];
    size_t count;
    size_t fail_after; /* number of writes that succeed, later ones fail; 0: all succeed */
} memory_archive;

static inline memory_item *memory_find(const memory_archive *archive, const char *path) {
    for (size_t i = 0; i < archive->count; i++)
        if (strcmp(archive->items[i].path, path) == 0) return (memory_item *)(uintptr_t)&archive->items[i];
    return NULL;
}

static inline void memory_fill(memory_item *item, const void *data, size_t bytes) {
    item->bytes = bytes;
    item->data = lg_test_memory(bytes);
    memcpy(item->data, data, bytes);
}

/* Adds an item with this path; returns NULL when the archive is full. No path may be written twice. */
static inline memory_item *memory_add(memory_archive *archive, const char *path) {
    if (archive->fail_after > 0 && archive->count >= archive->fail_after) return NULL;
    assert_null(memory_find(archive, path));
    assert_true(archive->count < LG_COUNT(archive->items) && strlen(path) < sizeof archive->items[0].path);
    memory_item *item = &archive->items[archive->count++];
    *item = (memory_item){0};
    (void)snprintf(item->path, sizeof item->path, "%s", path);
    return item;
}

static inline lg_status memory_write(void *user, const char *path, lg_element type, uint32_t rank,
                                     const uint64_t *dims, const void *data) {
    memory_item *item = memory_add(user, path);
    size_t bytes = type == LG_ELEMENT_F32 || type == LG_ELEMENT_U32 ? 4 : 8;
    if (item == NULL) return LG_FILE;
    item->type = type;
    item->rank = rank;
    for (uint32_t i = 0; i < rank; i++) bytes *= item->dims[i] = dims[i];
    memory_fill(item, data, bytes);
    return LG_OK;
}

static inline lg_status memory_write_text(void *user, const char *path, const char *value) {
    memory_item *item = memory_add(user, path);
    if (item == NULL) return LG_FILE;
    memory_fill(item, value, strlen(value) + 1);
    return LG_OK;
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
    return (lg_archive_writer){.user = archive, .array = memory_write, .text = memory_write_text};
}

static inline lg_archive_reader memory_reader(memory_archive *archive) {
    return (lg_archive_reader){
        .user = archive, .array = memory_read, .shape = memory_shape, .text = memory_read_text};
}

#endif
