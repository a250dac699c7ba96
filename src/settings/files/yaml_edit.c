#include "settings/files/yaml_edit.h"

#include <string.h>
#include <yaml.h>

#include "core/text.h"
#include "settings/files/yaml.h"

/* Nodes are never changed in place: an edit makes new nodes from the root down to the changed one. A node is
 * identified by its index in the document, from 1; 0 means that memory ran out. Adding a node moves the other
 * nodes in memory, so the functions do not keep pointers to nodes. */
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

static int add_map(editing *e, yaml_mapping_style_t style) {
    return checked(e, yaml_document_add_mapping(e->document, NULL, style));
}

static int add_list(editing *e, yaml_sequence_style_t style) {
    return checked(e, yaml_document_add_sequence(e->document, NULL, style));
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
        out = add_list(e, node->data.sequence.style);
        for (const yaml_node_item_t *i = node->data.sequence.items.start; i < node->data.sequence.items.top;
             i++)
            append_item(e, out, graft(e, from, *i));
        return out;
    case YAML_MAPPING_NODE:
        out = add_map(e, node->data.mapping.style);
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
    static const char key[] = "a: ";
    const size_t length = strlen(fragment);
    lg_yaml *yaml = NULL;
    char *text = lg_alloc(e->context, sizeof key + length, 1);
    if (text == NULL) return lg_no_memory(e->error);
    memcpy(text, key, sizeof key - 1);
    memcpy(text + sizeof key - 1, fragment, length);
    const lg_status status =
        lg_yaml_open_text(e->context, fragment, text, sizeof key - 1 + length, &yaml, e->error);
    if (status == LG_OK) {
        yaml_document_t *from = lg_yaml_document(yaml);
        *out = graft(e, from, yaml_document_get_root_node(from)->data.mapping.pairs.start->value);
    }
    lg_yaml_close(yaml);
    lg_free(e->context, text);
    return status;
}

/* ---- mappings ---- */

/* The value of a key; 0: absent. */
static int value_of(const editing *e, int map, const char *key, size_t length) {
    const yaml_node_t *node = node_at(e, map);
    if (node == NULL || node->type != YAML_MAPPING_NODE) return 0;
    for (const yaml_node_pair_t *p = node->data.mapping.pairs.start; p < node->data.mapping.pairs.top; p++)
        if (is_word(node_at(e, p->key), key, length)) return p->value;
    return 0;
}

/* A copy of a mapping with another value of a key; value 0: without the key. */
static int with_value(editing *e, int map, const char *key, size_t length, int value) {
    const int out = add_map(e, node_at(e, map)->data.mapping.style);
    bool found = false;
    for (ptrdiff_t i = 0; !e->full; i++) {
        const yaml_node_t *node = node_at(e, map);
        if (node->data.mapping.pairs.start + i >= node->data.mapping.pairs.top) break;
        const yaml_node_pair_t pair = node->data.mapping.pairs.start[i];
        const bool same = is_word(node_at(e, pair.key), key, length);
        found = found || same;
        if (!same || value != 0) append_pair(e, out, pair.key, same ? value : pair.value);
    }
    if (!found && value != 0) append_pair(e, out, add_scalar(e, key, length, YAML_ANY_SCALAR_STYLE), value);
    return out;
}

/* A copy of the mapping `map` in which all keys of the mapping `more` are set. */
static int merged(editing *e, int map, int more) {
    for (ptrdiff_t i = 0; !e->full; i++) {
        const yaml_node_t *node = node_at(e, more);
        if (node->data.mapping.pairs.start + i >= node->data.mapping.pairs.top) break;
        const yaml_node_pair_t pair = node->data.mapping.pairs.start[i];
        const yaml_node_t *key = node_at(e, pair.key);
        map = with_value(e, map, (const char *)key->data.scalar.value, key->data.scalar.length, pair.value);
    }
    return map;
}

/* ---- lists ---- */

/* A list with the items of `value`, or with `value` itself as an item; `other` (0: none) takes the place of
 * item `at`, and `last` (0: none) follows. */
static int with_items(editing *e, int value, ptrdiff_t at, int other, int last) {
    const bool list = node_at(e, value)->type == YAML_SEQUENCE_NODE;
    const int out = add_list(e, list ? node_at(e, value)->data.sequence.style : YAML_ANY_SEQUENCE_STYLE);
    for (ptrdiff_t i = 0; !e->full; i++) {
        const yaml_node_t *node = node_at(e, value);
        if (list ? node->data.sequence.items.start + i >= node->data.sequence.items.top : i > 0) break;
        append_item(e, out,
                    other != 0 && i == at ? other
                    : list                ? node->data.sequence.items.start[i]
                                          : value);
    }
    if (last != 0) append_item(e, out, last);
    return out;
}

static int appended(editing *e, int value, int fragment) {
    if (value == 0 || is_word(node_at(e, value), "none", strlen("none"))) return fragment;
    return with_items(e, value, 0, 0, fragment);
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
    const int wanted = value_of(e, fragment, "of", 2);
    const yaml_node_t *one = only_word(e, wanted), *own = only_word(e, value_of(e, item, "of", 2));
    if (one == NULL) return wanted == 0;
    return is_word(own, (const char *)one->data.scalar.value, one->data.scalar.length);
}

/* What an item becomes when `fragment` replaces `old` in it; 0: it does not have `old`. *more: the fragment
 * must still be appended. */
static int replaced(editing *e, int item, const char *old, int fragment, bool *more) {
    const size_t length = strlen(old);
    const yaml_node_t *node = node_at(e, item);
    *more = false;
    if (is_word(node, old, length)) return fragment;
    if (node->type != YAML_MAPPING_NODE) return 0;
    if (is_word(node_at(e, value_of(e, item, "kind", 4)), old, length) && is_of(e, item, fragment))
        return node_at(e, fragment)->type == YAML_MAPPING_NODE ? merged(e, item, fragment)
                                                               : with_value(e, item, "kind", 4, fragment);
    *more = is_word(node_at(e, value_of(e, item, old, length)), "true", 4);
    return *more ? with_value(e, item, old, length, 0) : 0;
}

static int replace(editing *e, int value, const char *old, int fragment) {
    bool more = false;
    int other = 0;
    if (value == 0 || node_at(e, value)->type != YAML_SEQUENCE_NODE) {
        other = value == 0 ? 0 : replaced(e, value, old, fragment, &more);
        if (other == 0) return appended(e, value, fragment);
        return more ? with_items(e, other, 0, 0, fragment) : other;
    }
    for (ptrdiff_t i = 0; !e->full; i++) {
        const yaml_node_t *node = node_at(e, value);
        if (node->data.sequence.items.start + i >= node->data.sequence.items.top) break;
        other = replaced(e, node->data.sequence.items.start[i], old, fragment, &more);
        if (other != 0) return with_items(e, value, i, other, more ? fragment : 0);
    }
    return appended(e, value, fragment);
}

/* ---- paths ---- */

/* The value at the rest of a path below `at` (0: absent) after the edit. */
static lg_status edited(editing *e, int at, const lg_yaml_edit *edit, const char *path, int fragment,
                        int *out) {
    const size_t length = path != NULL ? strcspn(path, ".") : 0;
    int value = 0;
    if (path == NULL) {
        *out = edit->how == LG_YAML_SET      ? fragment
               : edit->how == LG_YAML_APPEND ? appended(e, at, fragment)
                                             : replace(e, at, edit->old, fragment);
        return LG_OK;
    }
    if (at == 0) at = add_map(e, YAML_ANY_MAPPING_STYLE);
    if (e->full) return LG_OUT_OF_MEMORY;
    if (node_at(e, at)->type != YAML_MAPPING_NODE)
        return lg_yaml_fail(e->yaml, (uint32_t)node_at(e, at)->start_mark.line + 1, LG_FORMAT, e->error,
                            "%s: keys and values are expected above this key", edit->path);
    LG_TRY(edited(e, value_of(e, at, path, length), edit, path[length] == '.' ? path + length + 1 : NULL,
                  fragment, &value));
    *out = with_value(e, at, path, length, value);
    return LG_OK;
}

/* The root of a document is its first node: the pairs of the new root move there. */
static void set_root(editing *e, int index) {
    if (e->full || index == 1) return;
    yaml_node_t *root = node_at(e, 1), *node = node_at(e, index);
    const yaml_node_t kept = *root;
    root->data = node->data;
    node->data = kept.data;
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
    lg_text text = {.context = e->context};
    lg_status status = LG_OK;
    for (size_t i = 0; i < count && status == LG_OK; i++) {
        int fragment = 0, root = 0;
        status = add_fragment(e, edits[i].fragment, &fragment);
        if (status == LG_OK && !e->full) status = edited(e, 1, &edits[i], edits[i].path, fragment, &root);
        if (status == LG_OK) set_root(e, root);
        if (e->full) status = LG_OUT_OF_MEMORY;
    }
    if (status == LG_OK && !dump(e, &text)) status = LG_OUT_OF_MEMORY;
    if (status == LG_OK)
        *out = text.data;
    else
        lg_text_destroy(&text);
    return status == LG_OUT_OF_MEMORY ? lg_fail(e->error, status, "%s", lg_status_sentence(status)) : status;
}

lg_status lg_yaml_change(const lg_context *context, const char *name, const char *text,
                         const lg_yaml_edit *edits, size_t count, char **out, lg_error *error) {
    editing e = {.context = context, .error = error};
    LG_TRY(lg_yaml_open_text(context, name, text, strlen(text), &e.yaml, error));
    e.document = lg_yaml_document(e.yaml);
    const lg_status status = change(&e, edits, count, out);
    lg_yaml_close(e.yaml);
    return status;
}
