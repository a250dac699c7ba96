/* Documents: from YAML to nodes and back. */
#include "document.h"

#include <stdio.h>
#include <string.h>
#include <yaml.h>

enum { DEEPEST = 24 };

/* ---- nodes ---- */

static const char *keep(document *d, const char *text, size_t length) {
    if (length >= sizeof d->text - d->used) return NULL;
    char *to = d->text + d->used;
    memcpy(to, text, length);
    to[length] = '\0';
    d->used += length + 1;
    return to;
}

static int add(document *d, document_kind kind) {
    if (d->count == DOCUMENT_NODES) return NO_NODE;
    d->node[d->count] = (document_node){.kind = kind, .text = "", .first = NO_NODE, .next = NO_NODE};
    return d->count++;
}

int document_scalar(document *d, bool quoted, const char *text, size_t length) {
    const char *own = length <= UINT16_MAX ? keep(d, text, length) : NULL;
    const int node = own != NULL ? add(d, DOCUMENT_SCALAR) : NO_NODE;
    if (node == NO_NODE) return NO_NODE;
    d->node[node].quoted = quoted;
    d->node[node].text = own;
    d->node[node].length = (uint16_t)length;
    return node;
}

int document_copy(document *d, int from) {
    const int node = add(d, DOCUMENT_SCALAR);
    if (node == NO_NODE) return NO_NODE;
    d->node[node] = d->node[from];
    d->node[node].next = NO_NODE;
    return node;
}

bool document_insert(document *d, int parent, int before, int node) {
    if (node == NO_NODE) return false;
    int *link = &d->node[parent].first;
    while (*link != NO_NODE && *link != before) link = &d->node[*link].next;
    d->node[node].next = *link;
    *link = node;
    return true;
}

void document_remove(document *d, int parent, int node) {
    int *link = &d->node[parent].first;
    while (*link != NO_NODE && *link != node) link = &d->node[*link].next;
    if (*link == node) *link = d->node[node].next;
}

int document_child(const document *d, int parent, int ordinal) {
    int node = d->node[parent].first;
    while (node != NO_NODE && ordinal-- > 0) node = d->node[node].next;
    return node;
}

static void list_below(document *d, int node, int depth) {
    if (d->list_count == DOCUMENT_NODES || depth > DEEPEST) return;
    d->listed[d->list_count++] = node;
    int ordinal = 0;
    for (int child = d->node[node].first; child != NO_NODE; child = d->node[child].next) {
        d->node[child].parent = node;
        d->node[child].ordinal = ordinal++;
        list_below(d, child, depth + 1);
    }
}

void document_list(document *d) {
    d->list_count = 0;
    d->node[0].parent = NO_NODE;
    list_below(d, 0, 0);
}

bool document_is_within(const document *d, int node, int ancestor) {
    for (int depth = 0; node != NO_NODE && depth <= DEEPEST; depth++, node = d->node[node].parent)
        if (node == ancestor) return true;
    return false;
}

bool document_says(const document *d, int node, const char *text) {
    return d->node[node].kind == DOCUMENT_SCALAR && d->node[node].length == strlen(text) &&
           memcmp(d->node[node].text, text, d->node[node].length) == 0;
}

/* ---- reading ---- */

static int load(document *d, yaml_document_t *from, int index, int depth);

static bool load_child(document *d, yaml_document_t *from, int parent, int index, int depth) {
    const int node = depth < DEEPEST ? load(d, from, index, depth + 1) : NO_NODE;
    return document_insert(d, parent, NO_NODE, node);
}

static int load(document *d, yaml_document_t *from, int index, int depth) {
    const yaml_node_t *is = yaml_document_get_node(from, index);
    if (is == NULL) return NO_NODE;
    if (is->type == YAML_SCALAR_NODE)
        return document_scalar(d, is->data.scalar.style != YAML_PLAIN_SCALAR_STYLE,
                               (const char *)is->data.scalar.value, is->data.scalar.length);
    const bool map = is->type == YAML_MAPPING_NODE;
    const int node = add(d, map ? DOCUMENT_MAP : DOCUMENT_LIST);
    bool fits = node != NO_NODE;
    if (map)
        for (yaml_node_pair_t *p = is->data.mapping.pairs.start; fits && p < is->data.mapping.pairs.top; p++)
            fits = load_child(d, from, node, p->key, depth) && load_child(d, from, node, p->value, depth);
    else
        for (yaml_node_item_t *i = is->data.sequence.items.start; fits && i < is->data.sequence.items.top;
             i++)
            fits = load_child(d, from, node, *i, depth);
    return fits ? node : NO_NODE;
}

bool document_load(document *d, const uint8_t *data, size_t size) {
    yaml_parser_t parser;
    yaml_document_t from;
    d->count = 0;
    d->used = 0;
    if (yaml_parser_initialize(&parser) == 0) return false;
    yaml_parser_set_input_string(&parser, data, size);
    bool sound = yaml_parser_load(&parser, &from) != 0;
    if (sound) {
        sound = load(d, &from, 1, 0) == 0;
        yaml_document_delete(&from);
    }
    yaml_parser_delete(&parser);
    return sound;
}

/* ---- writing ---- */

typedef struct writer {
    const document *d;
    uint8_t *out;
    size_t at, most;
} writer;

static void put(writer *w, const char *text, size_t length) {
    if (length > w->most - w->at) length = w->most - w->at;
    memcpy(w->out + w->at, text, length);
    w->at += length;
}

static void put_quoted(writer *w, const char *text, size_t length) {
    put(w, "\"", 1);
    for (size_t i = 0; i < length; i++) {
        char escaped[8];
        const unsigned char c = (unsigned char)text[i];
        if (c < ' ' || c == '"' || c == '\\')
            put(w, escaped, (size_t)snprintf(escaped, sizeof escaped, "\\x%02x", c));
        else
            put(w, text + i, 1);
    }
    put(w, "\"", 1);
}

static void put_node(writer *w, int node, int depth) {
    const document_node *n = &w->d->node[node];
    if (depth > DEEPEST || w->at == w->most) return;
    if (n->kind == DOCUMENT_SCALAR) {
        if (n->quoted)
            put_quoted(w, n->text, n->length);
        else
            put(w, n->text, n->length);
        return;
    }
    const bool map = n->kind == DOCUMENT_MAP;
    bool key = true;
    put(w, map ? "{" : "[", 1);
    for (int child = n->first; child != NO_NODE; child = w->d->node[child].next) {
        if (child != n->first) put(w, map && !key ? ": " : ", ", 2);
        put_node(w, child, depth + 1);
        key = !key;
    }
    put(w, map ? "}" : "]", 1);
}

size_t document_write(const document *d, bool block, uint8_t *out, size_t most) {
    writer w = {.d = d, .out = out, .most = most};
    if (!block || d->node[0].kind != DOCUMENT_MAP) {
        put_node(&w, 0, 0);
        return w.at;
    }
    bool key = true;
    for (int child = d->node[0].first; child != NO_NODE; child = d->node[child].next) {
        put_node(&w, child, 1);
        put(&w, key ? ": " : "\n", key ? 2 : 1);
        key = !key;
    }
    return w.at;
}
