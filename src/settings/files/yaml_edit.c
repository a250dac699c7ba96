#include "settings/files/yaml_edit.h"

#include <string.h>
#include <yaml.h>

#include "core/text.h"
#include "settings/files/yaml.h"

/* A node is identified by its index in the document, from 1; 0 means that memory ran out. Adding a node
 * moves the other nodes in memory, so the functions do not keep pointers to nodes; lists of pairs and items
 * stay. */
typedef struct editing {
    const lg_context *context;
    yaml_document_t *document;
    lg_yaml *yaml;
    lg_error *error;
    bool full; /* memory ran out */
} editing;

static yaml_node_t *node_at(const editing *e, int index) {
    return yaml_document_get_node(e->document, index);
}

static int checked(editing *e, int index) {
    e->full = e->full || index == 0;
    return index;
}

static void append_pair(editing *e, int map, int key, int value) {
    if (!e->full && !yaml_document_append_mapping_pair(e->document, map, key, value)) e->full = true;
}

static void append_item(editing *e, int list, int item) {
    if (!e->full && !yaml_document_append_sequence_item(e->document, list, item)) e->full = true;
}

static int add_scalar(editing *e, const char *text, size_t length, yaml_scalar_style_t style) {
    return checked(
        e, yaml_document_add_scalar(e->document, NULL, (const yaml_char_t *)text, (int)length, style));
}

static bool is_word(const yaml_node_t *node, const char *word, size_t length) {
    return node != NULL && node->type == YAML_SCALAR_NODE && node->data.scalar.length == length &&
           memcmp(node->data.scalar.value, word, length) == 0;
}

/* ---- fragments ---- */

/* Copies a node of another document with everything below it. */
static int graft(editing *e, yaml_document_t *from, int index) {
    const yaml_node_t *node = yaml_document_get_node(from, index);
    int out = 0;
    switch (node->type) {
    case YAML_SEQUENCE_NODE:
        out = checked(e, yaml_document_add_sequence(e->document, NULL, node->data.sequence.style));
        for (const yaml_node_item_t *i = node->data.sequence.items.start; i < node->data.sequence.items.top;
             i++)
            append_item(e, out, graft(e, from, *i));
        return out;
    case YAML_MAPPING_NODE:
        out = checked(e, yaml_document_add_mapping(e->document, NULL, node->data.mapping.style));
        for (const yaml_node_pair_t *p = node->data.mapping.pairs.start; p < node->data.mapping.pairs.top;
             p++) {
            const int key = graft(e, from, p->key);
            append_pair(e, out, key, graft(e, from, p->value));
        }
        return out;
    default:
        return add_scalar(e, (const char *)node->data.scalar.value, node->data.scalar.length,
                          node->data.scalar.style);
    }
}

/* Adds a fragment to the document. A mapping around it, which is not added, makes it a file of its own. */
static lg_status add_fragment(editing *e, const char *fragment, int *out) {
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    LG_CLEAN(lg_text_destroy) lg_text text = {.context = e->context};
    lg_text_add(&text, "a: %s", fragment);
    if (text.failed) return lg_no_memory(e->error);
    LG_TRY(lg_yaml_open_text(e->context, fragment, text.data, text.length, &yaml, e->error));
    yaml_document_t *from = lg_yaml_document(yaml);
    *out = graft(e, from, yaml_document_get_root_node(from)->data.mapping.pairs.start->value);
    return LG_OK;
}

/* ---- mappings ---- */

/* Where the value of a key is; NULL: absent. */
static int *place_of(const editing *e, int map, const char *key, size_t length) {
    const yaml_node_t *node = node_at(e, map);
    if (node == NULL || node->type != YAML_MAPPING_NODE) return NULL;
    for (yaml_node_pair_t *p = node->data.mapping.pairs.start; p < node->data.mapping.pairs.top; p++)
        if (is_word(node_at(e, p->key), key, length)) return &p->value;
    return NULL;
}

static int value_of(const editing *e, int map, const char *key) {
    const int *place = place_of(e, map, key, strlen(key));
    return place != NULL ? *place : 0;
}

static void set(editing *e, int map, const char *key, size_t length, int value) {
    int *place = place_of(e, map, key, length);
    if (place != NULL)
        *place = value;
    else
        append_pair(e, map, add_scalar(e, key, length, YAML_ANY_SCALAR_STYLE), value);
}

/* ---- lists ---- */

static int appended(editing *e, int value, int fragment) {
    int list = value;
    if (value == 0 || is_word(node_at(e, value), "none", strlen("none"))) return fragment;
    if (node_at(e, value)->type != YAML_SEQUENCE_NODE) {
        list = checked(e, yaml_document_add_sequence(e->document, NULL, YAML_ANY_SEQUENCE_STYLE));
        append_item(e, list, value);
    }
    append_item(e, list, fragment);
    return list;
}

/* The text of a word or of a list of one word; NULL: something else. */
static const yaml_node_t *only_word(const editing *e, int index) {
    const yaml_node_t *node = node_at(e, index);
    if (node != NULL && node->type == YAML_SEQUENCE_NODE &&
        node->data.sequence.items.top - node->data.sequence.items.start == 1)
        node = node_at(e, *node->data.sequence.items.start);
    return node != NULL && node->type == YAML_SCALAR_NODE ? node : NULL;
}

/* Whether an item depends on what the fragment depends on. */
static bool is_of(const editing *e, int item, int fragment) {
    const int wanted = value_of(e, fragment, "of");
    const yaml_node_t *one = only_word(e, wanted), *own = only_word(e, value_of(e, item, "of"));
    if (one == NULL) return wanted == 0;
    return is_word(own, (const char *)one->data.scalar.value, one->data.scalar.length);
}

/* Lets the fragment take the place of an item if this is the word `old` or of this kind. */
static bool replaced(editing *e, int *item, const char *old, int fragment) {
    const size_t length = strlen(old);
    if (is_word(node_at(e, *item), old, length)) {
        *item = fragment;
        return true;
    }
    if (!is_word(node_at(e, value_of(e, *item, "kind")), old, length) || !is_of(e, *item, fragment))
        return false;
    const yaml_node_t *from = node_at(e, fragment);
    if (from->type != YAML_MAPPING_NODE) {
        set(e, *item, "kind", strlen("kind"), fragment);
        return true;
    }
    const yaml_node_pair_t *end = from->data.mapping.pairs.top;
    for (const yaml_node_pair_t *p = from->data.mapping.pairs.start; p < end; p++) {
        const yaml_node_t *key = node_at(e, p->key);
        set(e, *item, (const char *)key->data.scalar.value, key->data.scalar.length, p->value);
    }
    return true;
}

static int replace(editing *e, int value, const char *old, int fragment) {
    const yaml_node_t *node = node_at(e, value);
    if (node == NULL || node->type != YAML_SEQUENCE_NODE)
        return node != NULL && replaced(e, &value, old, fragment) ? value : appended(e, value, fragment);
    yaml_node_item_t *const end = node->data.sequence.items.top;
    for (yaml_node_item_t *item = node->data.sequence.items.start; item < end; item++)
        if (replaced(e, item, old, fragment)) return value;
    return appended(e, value, fragment);
}

/* ---- paths ---- */

static lg_status carry_out(editing *e, const lg_yaml_edit *edit, int fragment) {
    int map = 1;
    for (const char *key = edit->path; !e->full;) {
        const size_t length = strcspn(key, ".");
        const int *place = place_of(e, map, key, length);
        int value = place != NULL ? *place : 0;
        if (node_at(e, map)->type != YAML_MAPPING_NODE)
            return lg_yaml_fail(e->yaml, (uint32_t)node_at(e, map)->start_mark.line + 1, LG_FORMAT, e->error,
                                "%s: keys and values are expected above this key", edit->path);
        if (key[length] == '\0') {
            set(e, map, key, length,
                edit->how == LG_YAML_SET      ? fragment
                : edit->how == LG_YAML_APPEND ? appended(e, value, fragment)
                                              : replace(e, value, edit->old, fragment));
            break;
        }
        if (value == 0) {
            value = checked(e, yaml_document_add_mapping(e->document, NULL, YAML_ANY_MAPPING_STYLE));
            set(e, map, key, length, value);
        }
        map = value;
        key += length + 1;
    }
    return e->full ? lg_no_memory(e->error) : LG_OK;
}

/* ---- text ---- */

/* libyaml's handler of output: 0 for a failure. */
static int put(void *user, unsigned char *bytes, size_t size) {
    lg_text *text = user;
    lg_text_append(text, (const char *)bytes, size);
    return !text->failed;
}

/* Writes the document, which is empty afterwards. */
static bool dump(editing *e, lg_text *out) {
    enum { INDENT = 2, WIDTH = 110 };
    yaml_emitter_t emitter;
    if (!yaml_emitter_initialize(&emitter)) return false;
    yaml_emitter_set_output(&emitter, put, out);
    yaml_emitter_set_indent(&emitter, INDENT);
    yaml_emitter_set_width(&emitter, WIDTH);
    yaml_emitter_set_unicode(&emitter, 1);
    e->document->start_implicit = e->document->end_implicit = 1;
    const bool good = yaml_emitter_dump(&emitter, e->document) && yaml_emitter_flush(&emitter);
    yaml_emitter_delete(&emitter);
    return good && out->data != NULL;
}

static lg_status change(editing *e, const lg_yaml_edit *edits, size_t count, char **out) {
    LG_CLEAN(lg_text_destroy) lg_text text = {.context = e->context};
    for (size_t i = 0; i < count; i++) {
        int fragment = 0;
        LG_TRY(add_fragment(e, edits[i].fragment, &fragment));
        LG_TRY(carry_out(e, &edits[i], fragment));
    }
    if (!dump(e, &text)) return lg_no_memory(e->error);
    *out = text.data;
    text.data = NULL;
    return LG_OK;
}

lg_status lg_yaml_change(const lg_context *context, const char *name, const char *text,
                         const lg_yaml_edit *edits, size_t count, char **out, lg_error *error) {
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    LG_TRY(lg_yaml_open_text(context, name, text, strlen(text), &yaml, error));
    editing e = {.context = context, .yaml = yaml, .document = lg_yaml_document(yaml), .error = error};
    return change(&e, edits, count, out);
}
