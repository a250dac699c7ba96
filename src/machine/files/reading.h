/* Shared by the readers of a machine's file: machine.c (coordinates and columns), grey.c (the named system)
 * and terms.c (mass, potential, ...). */
#ifndef LG_MACHINE_READING_H
#define LG_MACHINE_READING_H

#include <string.h>

#include "settings/files/yaml.h"
#include "liegrad/machine.h"

typedef struct lg_machine_reading {
    lg_yaml *yaml;
    lg_machine_file *out;
    lg_error *error;
    /* Line of each term of the machine in the file; 0: the file does not name the term. */
    uint32_t lines[LG_MACHINE_TERMS];
} lg_machine_reading;

/* Fails with LG_FORMAT and a sentence that begins with the file and this line. */
#define LG_FAULT(r, line, ...) lg_yaml_fail((r)->yaml, line, LG_FORMAT, (r)->error, __VA_ARGS__)

/* Reads a map with these keys (lg_field[]) into `values`, which have as many elements. */
#define LG_READ_MAP(r, node, keys, values, what)                                                             \
    lg_yaml_read_below((r)->yaml, node, &(const lg_key_set){keys, LG_COUNT(values), values}, what, (r)->error)

/* Rows of several tables. */
#define LG_KEY_HIDDEN                                                                                        \
    { .name = "hidden", .type = LG_FIELD_WHOLES, .low = 1, .high = 4096, .most = LG_MACHINE_HIDDEN }
#define LG_KEY_WITHIN                                                                                        \
    { .name = "within", .type = LG_FIELD_REALS, .low = -DBL_MAX, .high = DBL_MAX, .most = 2 }
#define LG_KEY_SIGMA                                                                                         \
    { .name = "sigma", .type = LG_FIELD_REAL, .above = true, .high = DBL_MAX }

/* ---- nodes ---- */

static inline bool lg_node_is(const yaml_node_t *node, const char *word) {
    return node->type == YAML_SCALAR_NODE && node->data.scalar.length == strlen(word) &&
           memcmp(node->data.scalar.value, word, strlen(word)) == 0;
}
/* How many items a list has; another node counts as one item. */
static inline size_t lg_node_items(const yaml_node_t *node) {
    return node->type == YAML_SEQUENCE_NODE ? lg_node_length(node) : 1;
}

/* Calls visit(r, line, text, user) for the text of a scalar, or for each text of a list. `what` names the key
 * in messages. */
typedef lg_status (*lg_text_visit)(lg_machine_reading *r, uint32_t line, const char *text, void *user);
lg_status lg_machine_texts(lg_machine_reading *r, const void *node, const char *what, lg_text_visit visit,
                           void *user);

/* Numbers that are unknown one by one (grey.c): whether the node or an item of a list is the word `unknown`
 * or {start: ..., within: ..., sigma: ...}; reads the values of a term, some of which are unknown. */
bool lg_machine_has_entries(const lg_machine_reading *r, const yaml_node_t *node);
lg_status lg_machine_read_entries(lg_machine_reading *r, const lg_field *key, const yaml_node_t *node,
                                  lg_machine_term *term);

/* Reads the terms of one part. The file does not have the key if the line of `value` is 0. */
lg_status lg_machine_read_terms(lg_machine_reading *r, lg_machine_part part, const lg_key_value *value);
/* Moves terms before, before + 1, ..., which a change has added, behind the other terms of their part. A sum
 * of monomials takes the place of a term of the same coordinates whose monomials it has. */
void lg_machine_settle_terms(lg_machine_reading *r, uint32_t before);
/* Removes the lags, or all other actuators, which a change gives anew. */
void lg_machine_drop_actuators(lg_machine_reading *r, bool lags, bool curves);
/* Sets the widths of a network's hidden layers; does nothing if the term is no network. */
void lg_machine_set_widths(const lg_key_value *hidden, lg_machine_term *term);

/* Reads the keys `system`, `form` and `parameters`. A key with line 0 is not in the file. */
lg_status lg_machine_read_system(lg_machine_reading *r, const lg_key_value *system, const lg_key_value *form,
                                 const lg_key_value *parameters);

/* Read how inputs act (actuators.c): `hold` and `delay`, then `lag` and `curve`. A key with line 0 is not in
 * the file. */
lg_status lg_machine_read_timing(lg_machine_reading *r, const lg_key_value *hold, const lg_key_value *delay);
lg_status lg_machine_read_actuators(lg_machine_reading *r, const lg_key_value *lag,
                                    const lg_key_value *curve);

#endif
