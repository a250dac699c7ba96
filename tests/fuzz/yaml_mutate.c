/* Changes of YAML, safetensors and numpy. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "forms.h"
#include "grammar.h"

enum { ROOM = 1 << 12 };

static document made, other;
static uint8_t text[ROOM];

/* ---- YAML ---- */

static void change_some(uint64_t *random, fuzz_bytes bytes) {
    const uint32_t many = 1 + (fuzz_draw(random, 3) == 0 ? fuzz_draw(random, 4) : 0);
    for (uint32_t i = 0; i < many; i++) grammar_change(&made, random, bytes);
}

size_t yaml_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes) {
    uint64_t random = seed;
    if (fuzz_draw(&random, 3) == 0 || !document_load(&made, data, size)) return bytes(data, size, most);
    change_some(&random, bytes);
    return document_write(&made, fuzz_draw(&random, 8) > 0, data, most);
}

/* Replaces a node of one document by a node of the other document. */
size_t yaml_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out, size_t most,
                  unsigned seed) {
    uint64_t random = seed;
    if (!document_load(&made, a, size_a) || !document_load(&other, b, size_b)) return 0;
    document_list(&made);
    document_list(&other);
    const int from = other.listed[fuzz_draw(&random, (uint32_t)other.list_count)];
    /* As text, which is a scalar that is written as it is. */
    document_node *root = &other.node[0];
    const document_node was = *root;
    *root = other.node[from];
    const size_t length = document_write(&other, false, text, sizeof text);
    *root = was;
    const int node = document_scalar(&made, false, (const char *)text, length);
    if (node == NO_NODE) return 0;
    int to = made.listed[fuzz_draw(&random, (uint32_t)made.list_count)];
    const int parent = other.node[from].parent;
    /* A value takes the place of the value of the same key, where there is one. */
    if (parent != NO_NODE && other.node[parent].kind == DOCUMENT_MAP && other.node[from].ordinal % 2 == 1) {
        const document_node *key = &other.node[document_child(&other, parent, other.node[from].ordinal - 1)];
        for (int i = 0; i < made.list_count; i++) {
            const document_node *n = &made.node[made.listed[i]];
            if (n->parent != NO_NODE && made.node[n->parent].kind == DOCUMENT_MAP && n->ordinal % 2 == 0 &&
                document_says(&made, made.listed[i], key->text) && n->next != NO_NODE)
                to = n->next;
        }
    }
    const int next = made.node[to].next;
    made.node[to] = made.node[node];
    made.node[to].next = next;
    return document_write(&made, true, out, most);
}

/* ---- safetensors: the length of the header (8 bytes), the header, the numbers ---- */

static int value_of(const document *d, int map, const char *key) {
    if (d->node[map].kind != DOCUMENT_MAP) return NO_NODE;
    for (int k = d->node[map].first; k != NO_NODE && d->node[k].next != NO_NODE;
         k = d->node[d->node[k].next].next)
        if (document_says(d, k, key)) return d->node[k].next;
    return NO_NODE;
}

static size_t bytes_of(const document *d, int about) {
    static const struct {
        const char *type;
        size_t bytes;
    } types[] = {{"F64", 8}, {"F32", 4}, {"F16", 2}, {"BF16", 2}};
    const int type = value_of(d, about, "dtype"), shape = value_of(d, about, "shape");
    size_t bytes = 0;
    for (size_t i = 0; type != NO_NODE && i < sizeof types / sizeof types[0]; i++)
        if (document_says(d, type, types[i].type)) bytes = types[i].bytes;
    if (shape == NO_NODE || d->node[shape].kind != DOCUMENT_LIST) return bytes;
    for (int n = d->node[shape].first; n != NO_NODE && bytes <= ROOM; n = d->node[n].next)
        bytes *= strtoull(d->node[n].text, NULL, 10) % (ROOM + 1);
    return bytes;
}

/* Gives each tensor the bytes after the bytes of the tensor before it. Returns the number of all bytes. */
static size_t lay_out(document *d) {
    char offsets[64];
    size_t at = 0;
    for (int k = d->node[0].first; k != NO_NODE && d->node[k].next != NO_NODE;
         k = d->node[d->node[k].next].next) {
        const int about = d->node[k].next, range = value_of(d, about, "data_offsets");
        if (range == NO_NODE) continue;
        const size_t bytes = bytes_of(d, about);
        const int length = snprintf(offsets, sizeof offsets, "[%zu, %zu]", at, at + bytes);
        const int node = document_scalar(d, false, offsets, (size_t)length), next = d->node[range].next;
        if (node == NO_NODE) break;
        d->node[range] = d->node[node];
        d->node[range].next = next;
        at += bytes;
    }
    return at;
}

/* The numbers: `have` bytes, cut or repeated to `wanted`. */
static size_t put_numbers(uint8_t *out, size_t room, const uint8_t *from, size_t have, size_t wanted) {
    if (wanted > room) wanted = room;
    for (size_t i = 0; i < wanted; i++) out[i] = have > 0 ? from[i % have] : (uint8_t)(i % 8 == 7 ? 63 : 0);
    return wanted;
}

enum { LENGTH = 8 };

size_t tensors_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes) {
    static uint8_t out[ROOM];
    uint64_t random = seed, length = 0;
    if (most > sizeof out) most = sizeof out;
    for (size_t i = 0; i < LENGTH && size >= LENGTH; i++) length |= (uint64_t)data[i] << 8 * i;
    if (size < LENGTH || length > size - LENGTH || fuzz_draw(&random, 3) == 0 ||
        !document_load(&made, data + LENGTH, (size_t)length) || made.node[0].kind != DOCUMENT_MAP)
        return bytes(data, size, most);
    const size_t have = size - LENGTH - (size_t)length;
    if (fuzz_draw(&random, 5) > 0) change_some(&random, bytes);
    /* The last change may have made the root a text; then there is no layout. */
    const bool laid = made.node[0].kind == DOCUMENT_MAP && fuzz_draw(&random, 4) > 0;
    const size_t wanted = laid ? lay_out(&made) : have;
    const size_t header = document_write(&made, false, out + LENGTH, most - LENGTH);
    for (size_t i = 0; i < LENGTH; i++) out[i] = (uint8_t)((uint64_t)header >> 8 * i);
    if (fuzz_draw(&random, 16) == 0) out[fuzz_draw(&random, LENGTH)] += (uint8_t)(fuzz_draw(&random, 3) - 1);
    const size_t used = LENGTH + header +
                        put_numbers(out + LENGTH + header, most - LENGTH - header, data + LENGTH + length,
                                    have, fuzz_draw(&random, 8) > 0 ? wanted : have);
    memcpy(data, out, used);
    return used;
}

/* ---- numpy ----
 *
 * After the magic string: version (2 bytes), length of the header (2 or 4 bytes), the header, the numbers. */

size_t npy_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes) {
    static const char *const orders[] = {"<", ">", "|", "=", ""}, *const types[] = {
                                                                      "f8",  "f4", "i8", "i4", "i2", "i1",
                                                                      "u8",  "u4", "u2", "u1", "b1", "f2",
                                                                      "c16", "U4", "O",  "f0", "i3", "f88"};
    static const unsigned widths[] = {8, 4, 8, 4, 2, 1, 8, 4, 2, 1, 1, 2, 16, 16, 8, 0, 3, 8};
    /* around the number of rows, and of columns; `between` NULL: it has no columns */
    static const struct {
        const char *open, *between, *close;
    } shapes[] = {{"(", ", ", ")"}, {"(", NULL, ",)"}, {"(", ", ", ", 2)"},
                  {"(", ",", ",)"}, {"(-", ", ", ")"}, {"(", ".0, ", ")"},
                  {"", NULL, ""},   {"[", ", ", "]"},  {"(", NULL, ")"}};
    static uint8_t out[ROOM];
    uint64_t random = seed;
    if (most > sizeof out) most = sizeof out;
    if (most < 128 || fuzz_draw(&random, 2) == 0) return bytes(data, size, most);
    const unsigned version = fuzz_draw(&random, 12) > 0 ? 1 + fuzz_draw(&random, 3) : fuzz_draw(&random, 256),
                   wide = version == 1 ? 2 : 4, start = 2 + wide;
    const uint32_t type = fuzz_draw(&random, fuzz_draw(&random, 4) > 0 ? 11 : 18),
                   shape = fuzz_draw(&random, fuzz_draw(&random, 4) > 0 ? 2 : 9),
                   rows = fuzz_draw(&random, 9), columns = fuzz_draw(&random, 5);
    char dims[64], header[200];
    if (shapes[shape].between != NULL)
        (void)snprintf(dims, sizeof dims, "%s%u%s%u%s", shapes[shape].open, rows, shapes[shape].between,
                       columns, shapes[shape].close);
    else
        (void)snprintf(dims, sizeof dims, "%s%u%s", shapes[shape].open, rows, shapes[shape].close);
    const int length =
        snprintf(header, sizeof header, "{'descr': '%s%s', 'fortran_order': %s, 'shape': %s, }%*s",
                 orders[fuzz_draw(&random, 5)], types[type], fuzz_draw(&random, 2) == 0 ? "False" : "True",
                 dims, (int)fuzz_draw(&random, 20), "\n");
    out[0] = (uint8_t)version;
    out[1] = 0;
    for (unsigned i = 0; i < wide; i++) out[2 + i] = (uint8_t)((unsigned)length >> 8 * i);
    memcpy(out + start, header, (size_t)length);
    size_t at = start + (size_t)length;
    const size_t wanted = (size_t)widths[type] * rows * (shapes[shape].between == NULL ? 1 : columns);
    at += put_numbers(out + at, most - at, data, size, fuzz_draw(&random, 8) > 0 ? wanted : size);
    memcpy(data, out, at);
    return at;
}
