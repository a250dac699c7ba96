/* Trees, as a list of bytes. */
#include "tree.h"

#include <stdbool.h>
#include <string.h>

/* ---- bytes ---- */

static uint32_t number(const uint8_t *at, size_t bytes) {
    uint32_t value = 0;
    for (size_t i = bytes; i-- > 0;) value = value << 8 | at[i];
    return value;
}

static uint8_t *put_number(uint8_t *to, uint32_t value, size_t bytes) {
    for (size_t i = 0; i < bytes; i++) *to++ = (uint8_t)(value >> 8 * i);
    return to;
}

/* Reads one record at *at. Returns false if it is incomplete. */
static bool read_record(const uint8_t **at, const uint8_t *end, tree_record *r) {
    const uint8_t *p = *at;
    if (end - p < 5) return false;
    *r = (tree_record){.kind = p[0], .type = p[1], .size = (uint16_t)number(p + 2, 2), .rank = p[4]};
    if (r->rank != TREE_NO_SPACE) r->rank %= TREE_RANK + 1;
    const size_t extents = r->rank == TREE_NO_SPACE ? 0 : r->rank;
    p += 5;
    if ((size_t)(end - p) < 4 * extents + 1) return false;
    for (size_t i = 0; i < extents; i++, p += 4) r->dims[i] = number(p, 4);
    r->name_length = *p++;
    if (end - p < r->name_length + 2) return false;
    r->name = p;
    p += r->name_length;
    r->length = (uint16_t)number(p, 2);
    p += 2;
    if (end - p < r->length) return false;
    r->data = p;
    *at = p + r->length;
    return true;
}

size_t tree_read(const uint8_t *bytes, size_t size, tree_record *out) {
    const uint8_t *at = bytes, *end = bytes + size;
    size_t count = 0;
    while (count < TREE_RECORDS && read_record(&at, end, &out[count])) count++;
    return count;
}

static size_t record_bytes(const tree_record *r) {
    return 5 + 4 * (r->rank == TREE_NO_SPACE ? 0u : r->rank) + 1 + r->name_length + 2 + r->length;
}

size_t tree_write(const tree_record *records, size_t count, uint8_t *out, size_t most) {
    uint8_t *to = out;
    for (const tree_record *r = records; r < records + count; r++) {
        if (record_bytes(r) > most - (size_t)(to - out)) continue;
        *to++ = r->kind;
        *to++ = r->type;
        to = put_number(to, r->size, 2);
        *to++ = r->rank;
        for (size_t i = 0; r->rank != TREE_NO_SPACE && i < r->rank; i++) to = put_number(to, r->dims[i], 4);
        *to++ = r->name_length;
        memcpy(to, r->name, r->name_length);
        to = put_number(to + r->name_length, r->length, 2);
        memcpy(to, r->data, r->length);
        to += r->length;
    }
    return (size_t)(to - out);
}

/* ---- types and elements ---- */

const tree_type tree_types[] = {{"f8", NATURE_REAL, 8, 0},
                                {"f8 big", NATURE_REAL, 8, 1},
                                {"f4", NATURE_REAL, 4, 0},
                                {"f4 big", NATURE_REAL, 4, 1},
                                {"f2", NATURE_REAL, 2, 0},
                                {"i1", NATURE_WHOLE, 1, 0},
                                {"u1", NATURE_WHOLE, 1, 0},
                                {"i2", NATURE_WHOLE, 2, 0},
                                {"u2 big", NATURE_WHOLE, 2, 1},
                                {"i4", NATURE_WHOLE, 4, 0},
                                {"u4", NATURE_WHOLE, 4, 0},
                                {"i8", NATURE_WHOLE, 8, 0},
                                {"u8", NATURE_WHOLE, 8, 0},
                                {"i8 big", NATURE_WHOLE, 8, 1},
                                {"u4 big", NATURE_WHOLE, 4, 1},
                                {"text", NATURE_TEXT, 0, 0},
                                {"text, blanks", NATURE_TEXT, 0, 0},
                                {"text, zeros", NATURE_TEXT, 0, 0},
                                {"text of any length", NATURE_TEXT, 0, 0},
                                {"bool", NATURE_WHOLE, 1, 0},
                                {"enum", NATURE_WHOLE, 4, 0},
                                {"complex", NATURE_OTHER, 16, 0},
                                {"opaque", NATURE_OTHER, 0, 0},
                                {"array", NATURE_OTHER, 16, 0},
                                {"odd integer", NATURE_OTHER, 8, 0},
                                {"odd real", NATURE_OTHER, 8, 0},
                                {"reference", NATURE_OTHER, 8, 0},
                                {"bits", NATURE_OTHER, 4, 0},
                                {"long double", NATURE_REAL, 16, 0},
                                {"ragged", NATURE_OTHER, 0, 0}};
const size_t tree_type_count = sizeof tree_types / sizeof tree_types[0];

size_t tree_count(const tree_record *r, size_t bytes) {
    size_t count = r->rank == TREE_NO_SPACE ? 0 : 1;
    for (size_t i = 0; r->rank != TREE_NO_SPACE && i < r->rank; i++)
        if (r->dims[i] == 0) return 0;
    for (size_t i = 0; count > 0 && i < r->rank && count <= TREE_BYTES; i++)
        count = r->dims[i] > TREE_BYTES ? TREE_BYTES + 1 : count * r->dims[i];
    return count * bytes > TREE_BYTES ? TREE_BYTES + 1 : count;
}

void tree_fill(const tree_record *r, uint8_t *out, size_t bytes) {
    if (r->length == 0) {
        memset(out, 0, bytes);
        return;
    }
    for (size_t at = 0; at < bytes; at += r->length)
        memcpy(out + at, r->data, r->length < bytes - at ? r->length : bytes - at);
}
