/* Reads YAML and JSON files by tables of fields. A table is flat: "initial.q" is the key q of the mapping
 * `initial`. The line of each value is kept for error messages. If a row has no member in the struct (size
 * 0), the caller reads its value: a text, a name that stands for more than its number, or a NODE whose shape
 * is known only later. Files have at most 1 MiB and 16 levels of lists and mappings. Anchors, aliases and
 * %TAG lines are rejected. */
#ifndef LG_YAML_H
#define LG_YAML_H

#include <yaml.h>

#include "core/clean.h"
#include "liegrad/settings.h"
#include "settings/settings.h"

#define LG_VALUES 32 /* longest list, except in nodes */
typedef struct lg_key_value {
    uint32_t line;  /* line of the value, from 1; 0 if the key is absent */
    uint32_t count; /* how many numbers or names were read */
    double real[LG_VALUES];
    uint64_t whole;   /* value of a U64 row whose upper bound is 2^64 */
    char text[256];   /* value of a TEXT or PHRASE row */
    const void *node; /* value of a NODE row */
} lg_key_value;

/* A row of a key whose value is read by other code: LG_NODE takes any YAML node, LG_MAP a mapping. Further
 * members of the row may follow the name. */
#define LG_NODE(...)                                                                                         \
    { .type = LG_FIELD_NODE, .name = __VA_ARGS__ }
#define LG_MAP(...)                                                                                          \
    { .type = LG_FIELD_MAP, .name = __VA_ARGS__ }

/* A table of `count` rows, and the value that was read for each row. */
typedef struct lg_key_set {
    const lg_field *keys;
    size_t count;
    lg_key_value *values;
} lg_key_set;

typedef struct lg_yaml lg_yaml;

lg_status lg_yaml_open(const lg_context *context, const char *path, lg_yaml **out, lg_error *error);
/* lg_yaml_open reads a file; lg_yaml_open_text reads a text in memory, and `path` names it in error messages.
 * The path must stay valid until lg_yaml_close; the text need not. */
lg_status lg_yaml_open_text(const lg_context *context, const char *path, const void *data, size_t bytes,
                            lg_yaml **out, lg_error *error);
/* As lg_yaml_open_text, for a text that may have several documents, which must stay valid until
 * lg_yaml_close. The first one is open; lg_yaml_next opens the next one, and *more is false behind the last.
 */
lg_status lg_yaml_open_several(const lg_context *context, const char *path, const void *data, size_t bytes,
                               lg_yaml **out, lg_error *error);
lg_status lg_yaml_next(lg_yaml *yaml, bool *more, lg_error *error);
/* Reads the bytes of a file that may be YAML, into memory that the caller frees with lg_free. A zero byte
 * follows them. */
lg_status lg_yaml_bytes(const lg_context *context, const char *path, unsigned char **out, size_t *bytes,
                        lg_error *error);
void lg_yaml_close(lg_yaml *yaml);
LG_AT(lg_yaml_close, lg_yaml) /* yaml may be NULL */
const char *lg_yaml_path(const lg_yaml *yaml);
/* The document of libyaml, for reading what is below a NODE. */
yaml_document_t *lg_yaml_document(lg_yaml *yaml);
/* Line of a node, from 1; the node with this index in the document. */
uint32_t lg_node_line(const yaml_node_t *node);
yaml_node_t *lg_node_at(lg_yaml *yaml, int index);
/* Number of items of a list, 0 for another node; item `i`, where another node is its own item. */
size_t lg_node_length(const yaml_node_t *node);
const yaml_node_t *lg_node_item(lg_yaml *yaml, const yaml_node_t *node, size_t i);
/* The value of the key, of which the part before its first dot counts; NULL: no such key, or no mapping. */
const yaml_node_t *lg_node_below(const lg_yaml *yaml, const yaml_node_t *map, const char *key);
/* The text of a scalar, shorter than `size` bytes and without zero bytes; else NULL. */
const char *lg_node_text(const yaml_node_t *node, size_t size);

/* The value of the key `name`, which must be a row of `keys`. */
const lg_key_value *lg_yaml_value(const lg_field *keys, const lg_key_value *values, const char *name);

/* True if the top mapping has the key. "initial.q" is the key q of its mapping `initial`. */
bool lg_yaml_has(const lg_yaml *yaml, const char *key);
/* Reads the value of a required NAME or TEXT key of the top mapping, before everything else is read. */
lg_status lg_yaml_name(lg_yaml *yaml, const lg_field *key, lg_key_value *value, lg_error *error);
/* Reads the top mapping. A key is a row's name, or its option. Fails, with the line in the message, for
 * unknown, duplicate and missing keys, wrong shapes, texts where numbers are expected, and numbers out of
 * range. `elsewhere` (may be NULL) returns true for keys of other systems; `system` is the name of this
 * system. Both serve the message about an unknown key. */
lg_status lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count,
                       bool (*elsewhere)(const char *name), const char *system, lg_error *error);
/* Reads the mapping of a NODE, or of an item of a NODE, in the same way. `what` names it in error
 * messages. */
lg_status lg_yaml_read_below(lg_yaml *yaml, const void *node, const lg_key_set *set, const char *what,
                             lg_error *error);
/* Stores the values that were in the file into the members of `into`. Rows without a member are skipped. */
lg_status lg_yaml_store(const lg_yaml *yaml, const lg_field *keys, const lg_key_value *values, size_t count,
                        void *into, lg_error *error);
/* Gets the number of entries in a NODE, where an entry has `inner` numbers. A single list of `inner` > 1
 * numbers is one entry; so is a single number if `inner` is 1. */
lg_status lg_yaml_entries(lg_yaml *yaml, const lg_field *key, const lg_key_value *value, size_t inner,
                          size_t *out, lg_error *error);
/* Reads the numbers of a NODE: three levels of lists with the lengths `shape`. Levels of length 1 may be left
 * out. `lines` (may be NULL) receives the line of each number. */
lg_status lg_yaml_block(lg_yaml *yaml, const lg_field *key, const lg_key_value *value, const size_t shape[3],
                        double *out, uint32_t *lines, lg_error *error);
/* Fails with the message "FILE: line 7: ...". */
lg_status lg_yaml_fail(const lg_yaml *yaml, uint32_t line, lg_status status, lg_error *error,
                       const char *format, ...) __attribute__((format(printf, 5, 6)));
/* The same for the line of a node, with LG_FORMAT. */
#define LG_FAIL_AT(yaml, node, error, ...)                                                                   \
    lg_yaml_fail(yaml, lg_node_line(node), LG_FORMAT, error, __VA_ARGS__)

#endif
