/* Changes YAML by its grammar. The grammar is what the readers know: every table of fields that they pass to
 * lg_yaml_read, lg_yaml_read_below or lg_yaml_store is kept when an input makes them do so. A new key of a
 * reader needs nothing here. */
#include "grammar.h"

#include <stdio.h>
#include <string.h>

#include "forms.h"
#include "settings/files/yaml.h"

enum { TABLES = 128, ROWS = 40, NAME = 40, TEXT = 1200, MANY = 100 };

typedef struct grammar_row {
    char name[NAME]; /* copied, because some readers build their tables on the stack */
    lg_field field;
} grammar_row;
typedef struct grammar_table {
    uint64_t hash; /* of all names */
    size_t count;
    grammar_row row[ROWS];
} grammar_table;
static grammar_table tables[TABLES];
static uint32_t table_count;

/* ---- the tables of the readers ---- */

static uint64_t hash_of(const lg_field *keys, size_t count) {
    uint64_t hash = 14695981039346656037u; /* FNV-1a */
    for (size_t i = 0; i < count; i++)
        for (const char *c = keys[i].name; *c != '\0'; c++)
            hash = (hash ^ (unsigned char)*c) * 1099511628211u;
    return hash;
}

static void keep(const lg_field *keys, size_t count) {
    if (count > ROWS) count = ROWS;
    const uint64_t hash = hash_of(keys, count);
    for (uint32_t i = 0; i < table_count; i++)
        if (tables[i].hash == hash) return;
    if (table_count == TABLES) return;
    grammar_table *t = &tables[table_count++];
    t->hash = hash;
    t->count = count;
    for (size_t i = 0; i < count; i++) {
        t->row[i].field = keys[i];
        (void)snprintf(t->row[i].name, NAME, "%s", keys[i].name);
    }
}

/* The linker replaces the functions of the library by these functions. */
lg_status __real_lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count,
                              bool (*elsewhere)(const char *name), const char *system, lg_error *error);
lg_status __wrap_lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count,
                              bool (*elsewhere)(const char *name), const char *system, lg_error *error);
lg_status __wrap_lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count,
                              bool (*elsewhere)(const char *name), const char *system, lg_error *error) {
    for (size_t i = 0; i < set_count; i++) keep(sets[i].keys, sets[i].count);
    return __real_lg_yaml_read(yaml, sets, set_count, elsewhere, system, error);
}

lg_status __real_lg_yaml_read_below(lg_yaml *yaml, const void *node, const lg_key_set *set, const char *what,
                                    lg_error *error);
lg_status __wrap_lg_yaml_read_below(lg_yaml *yaml, const void *node, const lg_key_set *set, const char *what,
                                    lg_error *error);
lg_status __wrap_lg_yaml_read_below(lg_yaml *yaml, const void *node, const lg_key_set *set, const char *what,
                                    lg_error *error) {
    keep(set->keys, set->count);
    return __real_lg_yaml_read_below(yaml, node, set, what, error);
}

/* ---- words and values ---- */

typedef struct growing {
    document *d;
    uint64_t *random;
    size_t (*bytes)(uint8_t *, size_t, size_t);
} growing;

/* A text that is written piece by piece and cut at its end. */
typedef struct piece {
    char text[TEXT];
    size_t used;
} piece;

static uint32_t draw(const growing *g, uint32_t below) {
    return fuzz_draw(g->random, below);
}

static void say(piece *p, const char *text, size_t length) {
    if (length > sizeof p->text - 1 - p->used) length = sizeof p->text - 1 - p->used;
    memcpy(p->text + p->used, text, length);
    p->used += length;
    p->text[p->used] = '\0';
}
static void say_text(piece *p, const char *text) {
    say(p, text, strlen(text));
}

static const char *const odd_words[] = {"",      "~",    "null", "true",    "no",  ".inf", "-.inf", ".nan",
                                        "1e999", "-0",   "0x10", "1_000",   "1.",  "&a 1", "*a",    "!!int 1",
                                        "[]",    "{}",   "[[]]", "{{}: 1}", "? 1", "'",    "\"\"",  "unknown",
                                        "none",  "auto", "all",  "yes",     "x",   "u",    "t",     "hold"};
static const char *const odd_numbers[] = {"0",
                                          "1",
                                          "-1",
                                          "2",
                                          "3",
                                          "0.5",
                                          "1e-3",
                                          "1e300",
                                          "-1e300",
                                          "1e-320",
                                          "10000",
                                          "1000000",
                                          "4294967295",
                                          "4294967296",
                                          "9007199254740993",
                                          "18446744073709551615",
                                          "18446744073709551616",
                                          "1e19",
                                          "-9223372036854775808",
                                          "0.1",
                                          "12",
                                          "4096",
                                          "4097",
                                          "3.14159"};
#define ANY(g, list) list[draw(g, sizeof list / sizeof list[0])]

static const grammar_row *any_row(const growing *g) {
    const grammar_table *t = table_count > 0 ? &tables[draw(g, table_count)] : NULL;
    return t != NULL && t->count > 0 ? &t->row[draw(g, (uint32_t)t->count)] : NULL;
}

/* "b" of "a.b". */
static const char *leaf(const char *name) {
    const char *dot = strrchr(name, '.');
    return dot != NULL ? dot + 1 : name;
}

static const char *any_name(const growing *g, const lg_field *f) {
    uint32_t count = 0;
    while (count < 256 && lg_field_name(f, count) != NULL) count++;
    return count > 0 ? lg_field_name(f, draw(g, count)) : NULL;
}

static void grow_number(const growing *g, const lg_field *f, piece *to) {
    char text[40];
    const bool ranged = f != NULL && f->high > f->low;
    const double part = draw(g, 1001) / 1000.0;
    double value = 0;
    switch (draw(g, 6)) {
    case 0:
        say_text(to, ANY(g, odd_numbers));
        return;
    case 1:
        value = ranged ? (draw(g, 2) == 0 ? f->low : f->high) : 1;
        break;
    case 2:
        value = ranged ? (draw(g, 2) == 0 ? f->low - 1 : f->high + 1) : -1;
        break;
    default: /* inside the range, and small */
        value = (double)draw(g, 10) + (draw(g, 2) == 0 ? part : 0);
        if (ranged && (value < f->low || value > f->high))
            value = f->low + (f->high - f->low < 1e6 ? part * (f->high - f->low) : 1);
    }
    (void)snprintf(text, sizeof text, "%.*g", 1 + (int)draw(g, 17), value);
    say_text(to, text);
}

/* A word of the document, of a table, or an odd one. */
static void grow_word(const growing *g, const lg_field *f, piece *to) {
    const document *d = g->d;
    const char *name = f != NULL && draw(g, 8) > 0 ? any_name(g, f) : NULL;
    if (name != NULL) {
        say_text(to, name);
        return;
    }
    for (int tries = 0; tries < 8 && d->list_count > 0 && draw(g, 6) > 0; tries++) {
        const document_node *n = &d->node[d->listed[draw(g, (uint32_t)d->list_count)]];
        if (n->kind != DOCUMENT_SCALAR || n->quoted) continue;
        say(to, n->text, n->length);
        return;
    }
    const grammar_row *row = draw(g, 3) > 0 ? any_row(g) : NULL;
    name = row != NULL ? any_name(g, &row->field) : NULL;
    say_text(to, name != NULL ? name : row != NULL ? leaf(row->name) : ANY(g, odd_words));
}

static void grow_map(const growing *g, const grammar_table *t, const char *prefix, int depth, piece *to);

static void grow_list(const growing *g, const lg_field *f,
                      void (*item)(const growing *, const lg_field *, piece *), piece *to) {
    const uint32_t most = draw(g, 12) > 0 ? 5 : f != NULL && f->most > 0 ? f->most + 2 : MANY;
    say_text(to, "[");
    for (uint32_t i = 0, n = draw(g, most); i < n; i++) {
        if (i > 0) say_text(to, ", ");
        item(g, f, to);
    }
    say_text(to, "]");
}

static void grow_numbers(const growing *g, const lg_field *f, piece *to) {
    grow_list(g, f, grow_number, to);
}

/* A value whose shape the table does not tell. */
static void grow_any(const growing *g, const lg_field *f, int depth, piece *to) {
    switch (depth > 3 ? draw(g, 4) : draw(g, 9)) {
    case 0:
        grow_number(g, f, to);
        break;
    case 1:
        grow_word(g, f, to);
        break;
    case 2:
        grow_numbers(g, f, to);
        break;
    case 3:
        grow_list(g, f, grow_word, to);
        break;
    case 4:
        grow_list(g, f, grow_numbers, to);
        break;
    case 5: /* {NAME: number, ...} */
    case 6:
        say_text(to, "{");
        for (uint32_t i = 0, n = 1 + draw(g, 3); i < n; i++) {
            if (i > 0) say_text(to, ", ");
            grow_word(g, f, to);
            say_text(to, ": ");
            grow_any(g, f, depth + 2, to);
        }
        say_text(to, "}");
        break;
    case 7:
        if (table_count > 0) grow_map(g, &tables[draw(g, table_count)], "", depth + 1, to);
        break;
    default:
        say_text(to, "[");
        for (uint32_t i = 0, n = 1 + draw(g, 2), t = draw(g, table_count); i < n && table_count > 0; i++) {
            if (i > 0) say_text(to, ", ");
            grow_map(g, &tables[t], "", depth + 1, to);
        }
        say_text(to, "]");
    }
}

static void grow_value(const growing *g, const grammar_table *t, const grammar_row *row, int depth,
                       piece *to) {
    const lg_field *f = &row->field;
    char prefix[NAME + 1];
    if (draw(g, 16) == 0) {
        grow_any(g, f, depth, to);
        return;
    }
    switch (f->type) {
    case LG_FIELD_REAL:
    case LG_FIELD_U64:
    case LG_FIELD_U32:
        grow_number(g, f, to);
        break;
    case LG_FIELD_WHOLES:
    case LG_FIELD_REALS:
        grow_numbers(g, f, to);
        break;
    case LG_FIELD_MAP:
        (void)snprintf(prefix, sizeof prefix, "%s.", row->name);
        grow_map(g, t, prefix, depth + 1, to);
        break;
    case LG_FIELD_NODE:
        grow_any(g, f, depth, to);
        break;
    case LG_FIELD_NAMES:
        grow_list(g, f, grow_word, to);
        break;
    default:
        grow_word(g, f, to);
    }
}

/* Whether the row is a key of the mapping whose keys begin with `prefix`. */
static bool belongs(const grammar_row *row, const char *prefix) {
    const size_t length = strlen(prefix);
    return strncmp(row->name, prefix, length) == 0 && strchr(row->name + length, '.') == NULL;
}

static void grow_map(const growing *g, const grammar_table *t, const char *prefix, int depth, piece *to) {
    bool any = false;
    say_text(to, "{");
    for (size_t i = 0; depth < 5 && i < t->count; i++) {
        const grammar_row *row = &t->row[i];
        if (!belongs(row, prefix) ||
            draw(g, row->field.required ? 24 : 4) >= (row->field.required ? 23U : 1U))
            continue;
        say_text(to, any ? ", " : "");
        say_text(to, leaf(row->name));
        say_text(to, ": ");
        grow_value(g, t, row, depth, to);
        any = true;
    }
    say_text(to, "}");
}

/* ---- places in the document ---- */

static int any_node(const growing *g) {
    return g->d->listed[draw(g, (uint32_t)g->d->list_count)];
}

/* Returns a random mapping of the document, or NO_NODE if the document has no mapping. */
static int any_map(const growing *g) {
    for (int tries = 0; tries < 12; tries++) {
        const int node = any_node(g);
        if (g->d->node[node].kind == DOCUMENT_MAP) return node;
    }
    return g->d->node[0].kind == DOCUMENT_MAP ? 0 : NO_NODE;
}

/* The key that a mapping has in its parent, with a dot; "" at the root and in lists. */
static void prefix_of(const document *d, int map, char out[NAME + 1]) {
    const document_node *n = &d->node[map];
    out[0] = '\0';
    if (n->parent == NO_NODE || d->node[n->parent].kind != DOCUMENT_MAP || n->ordinal % 2 == 0) return;
    const int key = document_child(d, n->parent, n->ordinal - 1);
    (void)snprintf(out, NAME + 1, "%.*s.", (int)(d->node[key].length < NAME ? d->node[key].length : NAME - 1),
                   d->node[key].text);
}

static size_t keys_in_common(const document *d, int map, const grammar_table *t, const char *prefix) {
    size_t common = 0;
    for (int key = d->node[map].first; key != NO_NODE;
         key = d->node[key].next == NO_NODE ? NO_NODE : d->node[d->node[key].next].next)
        for (size_t i = 0; i < t->count; i++)
            common += belongs(&t->row[i], prefix) && document_says(d, key, leaf(t->row[i].name));
    return common;
}

/* The table that fits a mapping best, of a few; *prefix becomes "" if it fits better so. */
static const grammar_table *table_for(const growing *g, int map, char prefix[NAME + 1]) {
    const grammar_table *best = NULL;
    size_t most = 0;
    bool inner = false;
    prefix_of(g->d, map, prefix);
    for (uint32_t i = 0, first = draw(g, table_count); i < table_count; i++) {
        const grammar_table *t = &tables[(first + i) % table_count];
        const size_t with = prefix[0] != '\0' ? keys_in_common(g->d, map, t, prefix) : 0,
                     without = keys_in_common(g->d, map, t, "");
        if (best != NULL && with <= most && without <= most) continue;
        best = t;
        inner = with > without;
        most = inner ? with : without;
    }
    if (!inner) prefix[0] = '\0';
    return best;
}

static const grammar_row *row_for(const growing *g, const grammar_table *t, const char *prefix) {
    for (int tries = 0; t != NULL && t->count > 0 && tries < 32; tries++) {
        const grammar_row *row = &t->row[draw(g, (uint32_t)t->count)];
        if (belongs(row, prefix)) return row;
    }
    return NULL;
}

static int scalar_of(const growing *g, const piece *p) {
    return document_scalar(g->d, false, p->text, p->used);
}

/* Replaces the node by the other node. */
static void become(const growing *g, int node, int other) {
    if (other == NO_NODE || document_is_within(g->d, node, other)) return;
    const int next = g->d->node[node].next;
    g->d->node[node] = g->d->node[other];
    g->d->node[node].next = next;
}

/* ---- changes ---- */

static void add_key(const growing *g) {
    char prefix[NAME + 1];
    const int map = any_map(g);
    if (map == NO_NODE || table_count == 0) return;
    const grammar_table *t = draw(g, 8) > 0 ? table_for(g, map, prefix) : &tables[draw(g, table_count)];
    const grammar_row *row = row_for(g, t, prefix);
    if (row == NULL) return;
    piece value = {.used = 0};
    grow_value(g, t, row, 1, &value);
    const int key = document_scalar(g->d, false, leaf(row->name), strlen(leaf(row->name))),
              node = scalar_of(g, &value);
    if (key != NO_NODE && node != NO_NODE)
        (void)(document_insert(g->d, map, NO_NODE, key) && document_insert(g->d, map, NO_NODE, node));
}

/* A value of the mapping becomes another one that its key may have. */
static void change_value(const growing *g) {
    char prefix[NAME + 1];
    const int map = any_map(g);
    const grammar_table *t = map != NO_NODE && table_count > 0 ? table_for(g, map, prefix) : NULL;
    if (t == NULL) return;
    int pairs = 0;
    for (int key = g->d->node[map].first; key != NO_NODE; key = g->d->node[key].next) pairs++;
    if (pairs < 2) return;
    const int key = document_child(g->d, map, 2 * (int)draw(g, (uint32_t)pairs / 2));
    for (size_t i = 0; i < t->count; i++) {
        if (!belongs(&t->row[i], prefix) || !document_says(g->d, key, leaf(t->row[i].name))) continue;
        piece value = {.used = 0};
        grow_value(g, t, &t->row[i], 1, &value);
        become(g, g->d->node[key].next, scalar_of(g, &value));
        return;
    }
}

static void change_scalar(const growing *g) {
    const int node = any_node(g);
    const document_node *n = &g->d->node[node];
    piece value = {.used = 0};
    if (n->kind != DOCUMENT_SCALAR) return;
    const bool number = n->length > 0 && strchr("0123456789.-+", n->text[0]) != NULL;
    if (draw(g, 4) == 0 && n->length + 8U < TEXT) {
        memcpy(value.text, n->text, n->length);
        value.used = g->bytes((uint8_t *)value.text, n->length, n->length + 8U);
    } else if (number) {
        grow_number(g, NULL, &value);
    } else {
        grow_word(g, NULL, &value);
    }
    const int made = document_scalar(g->d, n->quoted || draw(g, 32) == 0, value.text, value.used);
    become(g, node, made);
}

/* Removes a pair or an item; with `more` repeats it, a list's item up to MANY times. */
static void drop_or_repeat(const growing *g, bool more) {
    document *d = g->d;
    const int node = any_node(g), parent = d->node[node].parent;
    if (parent == NO_NODE) return;
    const bool map = d->node[parent].kind == DOCUMENT_MAP;
    const int key = map ? document_child(d, parent, d->node[node].ordinal / 2 * 2) : node,
              value = map ? d->node[key].next : NO_NODE;
    const uint32_t times = !more ? 0 : map || draw(g, 3) > 0 ? 1 : 1 + draw(g, MANY);
    for (uint32_t i = 0; i < times; i++) {
        const int key2 = document_copy(d, key), value2 = map ? document_copy(d, value) : NO_NODE;
        if (key2 == NO_NODE || (map && value2 == NO_NODE)) return;
        (void)document_insert(d, parent, NO_NODE, key2);
        if (map) (void)document_insert(d, parent, NO_NODE, value2);
    }
    if (more) return;
    document_remove(d, parent, key);
    if (map) document_remove(d, parent, value);
}
static void drop(const growing *g) {
    drop_or_repeat(g, false);
}
static void repeat(const growing *g) {
    drop_or_repeat(g, true);
}

static void take_other(const growing *g) {
    const int node = any_node(g);
    become(g, node, document_copy(g->d, any_node(g)));
}

/* Replaces the node by a list that contains only this node, or replaces a list or mapping by one of its
 * children. */
static void wrap(const growing *g) {
    document *d = g->d;
    const int node = any_node(g);
    if (d->node[node].kind != DOCUMENT_SCALAR && draw(g, 2) == 0) {
        const int first = d->node[node].first;
        if (first != NO_NODE) become(g, node, document_copy(d, first));
        return;
    }
    const int inner = document_copy(d, node);
    if (inner == NO_NODE) return;
    d->node[node].kind = DOCUMENT_LIST;
    d->node[node].first = inner;
}

static void change_everything(const growing *g) {
    if (table_count == 0 || draw(g, 8) > 0) return;
    piece value = {.used = 0};
    grow_map(g, &tables[draw(g, table_count)], "", 0, &value);
    const int made = scalar_of(g, &value);
    if (made != NO_NODE) g->d->node[0] = g->d->node[made];
}

typedef void (*change)(const growing *g);
/* Changes that are listed several times are more likely. */
static const change changes[] = {
    add_key,      add_key,       add_key,          add_key, change_value, change_value, change_value,
    change_value, change_scalar, change_scalar,    drop,    drop,         repeat,       take_other,
    take_other,   wrap,          change_everything};

void grammar_change(document *d, uint64_t *random, size_t (*bytes)(uint8_t *, size_t, size_t)) {
    const growing g = {.d = d, .random = random, .bytes = bytes};
    document_list(d);
    changes[draw(&g, sizeof changes / sizeof changes[0])](&g);
}
