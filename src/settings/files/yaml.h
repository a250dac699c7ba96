/* Reads YAML and JSON files by tables of fields. A table is flat: "initial.q" is key q of the mapping
 * `initial`. Each value keeps its line. A row without a member (size 0) is looked at by the caller: a text, a
 * name that is more than its number, a NODE once its shape is known. */
#ifndef LG_YAML_H
#define LG_YAML_H

#include "core/core.h"
#include "liegrad/io.h"
#include "settings/settings.h"

#define LG_VALUES 32 /* the longest list, but for nodes */
typedef struct lg_key_value {
    uint32_t line;  /* of the value, from 1; 0: absent */
    uint32_t count; /* numbers or names read */
    double real[LG_VALUES];
    uint64_t whole;   /* U64 up to 2^64 - 1 */
    char text[256];   /* TEXT, PHRASE */
    const void *node; /* NODE */
} lg_key_value;

/* A table and what was read, a value for each row. */
typedef struct lg_key_set {
    const lg_field *keys;
    size_t count;
    lg_key_value *values;
} lg_key_set;

typedef struct lg_yaml lg_yaml;

lg_status lg_yaml_open(const lg_context *context, const char *path, lg_yaml **out, lg_error *error);
/* The same of a text in memory; `path` names it in sentences. Both borrow the path, not the text. */
lg_status lg_yaml_open_text(const lg_context *context, const char *path, const void *data, size_t bytes,
                            lg_yaml **out, lg_error *error);
/* The bytes of a file that may be YAML (lg_free); a zero stands behind. */
lg_status lg_yaml_bytes(const lg_context *context, const char *path, unsigned char **out, size_t *bytes,
                        lg_error *error);
void lg_yaml_close(lg_yaml *yaml); /* NULL is fine */
const char *lg_yaml_path(const lg_yaml *yaml);
/* libyaml's document, for what is below a NODE. */
struct yaml_document_s *lg_yaml_document(lg_yaml *yaml);

/* True when the top mapping has the key; "initial.q" is key q of its mapping `initial`. */
bool lg_yaml_has(const lg_yaml *yaml, const char *key);
/* The value of a required NAME or TEXT key of the top mapping, before the rest is read. */
lg_status lg_yaml_name(lg_yaml *yaml, const lg_field *key, lg_key_value *value, lg_error *error);
/* Reads the top mapping. Refuses, with the line: unknown keys, duplicate keys, missing keys, wrong shapes,
 * texts that are no numbers, numbers out of range. `elsewhere` (may be NULL) knows the keys of other systems;
 * `system` is the name of this one. */
lg_status lg_yaml_read(lg_yaml *yaml, const lg_key_set *sets, size_t set_count,
                       bool (*elsewhere)(const char *name), const char *system, lg_error *error);
/* The same for the mapping of a NODE, or of an item of one; `what` names it in sentences. */
lg_status lg_yaml_read_below(lg_yaml *yaml, const void *node, const lg_key_set *set, const char *what,
                             lg_error *error);
/* Stores the values that stand in the file, by the rows that have members. */
lg_status lg_yaml_store(const lg_yaml *yaml, const lg_field *keys, const lg_key_value *values, size_t count,
                        void *into, lg_error *error);
/* The number of entries of `inner` numbers in a NODE. A list of `inner` > 1 numbers is one entry, and so is
 * a single number. */
lg_status lg_yaml_entries(lg_yaml *yaml, const lg_field *key, const lg_key_value *value, size_t inner,
                          size_t *out, lg_error *error);
/* The numbers of a NODE: lists of lists of lists of these lengths; levels of length one may be left out.
 * `lines` (may be NULL) becomes the line of each number. */
lg_status lg_yaml_block(lg_yaml *yaml, const lg_field *key, const lg_key_value *value, const size_t shape[3],
                        double *out, uint32_t *lines, lg_error *error);
/* "FILE: line 7: ..." */
lg_status lg_yaml_fail(const lg_yaml *yaml, uint32_t line, lg_status status, lg_error *error,
                       const char *format, ...) __attribute__((format(printf, 5, 6)));

#endif
