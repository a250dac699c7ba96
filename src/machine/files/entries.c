/* Reads numbers of a machine that are unknown one by one from YAML: the word `unknown`, or {start: 3,
 * within: [1, 10], sigma: 1}; of a lag with the key `order`, which actuators.c reads. */
#include <float.h>
#include <math.h>
#include <string.h>
#include <yaml.h>

#include "machine/files/reading.h"
#include "machine/internal.h"

typedef lg_machine_reading reading;

enum { KEY_START, KEY_WITHIN, KEY_SIGMA, KEY_ORDER, KEY_COUNT };
static const lg_field keys[KEY_COUNT] = {
    [KEY_START] = {.name = "start", .type = LG_FIELD_REAL, .low = -DBL_MAX, .high = DBL_MAX},
    [KEY_WITHIN] = {.name = "within", .type = LG_FIELD_REALS, .low = -DBL_MAX, .high = DBL_MAX, .most = 2},
    [KEY_SIGMA] = {.name = "sigma", .type = LG_FIELD_REAL, .above = true, .high = DBL_MAX},
    [KEY_ORDER] = {.name = "order", .type = LG_FIELD_NODE},
};

static bool is_unknown(const yaml_node_t *node) {
    static const char word[] = "unknown";
    return node->type == YAML_SCALAR_NODE && node->data.scalar.length == sizeof word - 1 &&
           memcmp(node->data.scalar.value, word, sizeof word - 1) == 0;
}

bool lg_machine_is_entry(const yaml_node_t *node) {
    return node->type == YAML_MAPPING_NODE || is_unknown(node);
}

lg_status lg_machine_read_entry(reading *r, const char *what, bool ordered, const yaml_node_t *node,
                                double *start, lg_machine_entry *out) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    const lg_key_set set = {keys, ordered ? KEY_COUNT : KEY_ORDER, values};
    *start = (double)NAN;
    if (is_unknown(node)) return LG_OK;
    LG_TRY(lg_yaml_read_below(r->yaml, node, &set, what, r->error));
    const uint32_t line = (uint32_t)node->start_mark.line + 1;
    if (values[KEY_START].line != 0) *start = values[KEY_START].real[0];
    if (values[KEY_SIGMA].line != 0) out->sigma = values[KEY_SIGMA].real[0];
    if (values[KEY_SIGMA].line != 0 && isnan(*start))
        return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error,
                            "%s: sigma needs a start, the centre of the prior", what);
    if (values[KEY_WITHIN].line == 0) return LG_OK;
    out->low = values[KEY_WITHIN].real[0], out->high = values[KEY_WITHIN].real[1];
    if (values[KEY_WITHIN].count != 2 || !(out->low < out->high))
        return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error, "%s: within: expected [low, high]", what);
    if (!isnan(*start) && !(*start > out->low && *start < out->high))
        return lg_yaml_fail(r->yaml, line, LG_FORMAT, r->error, "%s: start %g is not between %g and %g", what,
                            *start, out->low, out->high);
    return LG_OK;
}

static const yaml_node_t *node_at(const reading *r, int index) {
    return yaml_document_get_node(lg_yaml_document(r->yaml), index);
}

static size_t items_of(const yaml_node_t *node) {
    if (node->type != YAML_SEQUENCE_NODE) return 1;
    return (size_t)(node->data.sequence.items.top - node->data.sequence.items.start);
}

static const yaml_node_t *item_of(const reading *r, const yaml_node_t *node, size_t i) {
    return node->type == YAML_SEQUENCE_NODE ? node_at(r, node->data.sequence.items.start[i]) : node;
}

bool lg_machine_has_entries(const reading *r, const yaml_node_t *node) {
    bool any = lg_machine_is_entry(node);
    for (size_t i = 0; i < items_of(node) && node->type == YAML_SEQUENCE_NODE && !any; i++)
        any = lg_machine_has_entries(r, item_of(r, node, i));
    return any;
}

static lg_status read_one(reading *r, const lg_field *key, const yaml_node_t *node, lg_machine_term *term) {
    const lg_key_value value = {.line = (uint32_t)node->start_mark.line + 1, .node = node};
    if (term->value_count == LG_MACHINE_VALUES || term->entry_count == LG_MACHINE_ENTRIES)
        return lg_yaml_fail(r->yaml, value.line, LG_FORMAT, r->error,
                            "%s: more than %d numbers, or %d unknown ones", key->name, LG_MACHINE_VALUES,
                            LG_MACHINE_ENTRIES);
    double *number = &term->values[term->value_count++];
    if (!lg_machine_is_entry(node))
        return lg_yaml_block(r->yaml, key, &value, (const size_t[3]){1, 1, 1}, number, NULL, r->error);
    lg_machine_entry *entry = &term->entries[term->entry_count++];
    *entry = (lg_machine_entry){.index = term->value_count - 1};
    return lg_machine_read_entry(r, key->name, term->kind->order > 0, node, number, entry);
}

lg_status lg_machine_read_entries(reading *r, const lg_field *key, const yaml_node_t *node,
                                  lg_machine_term *term) {
    /* The matrix has an unknown number, so the matrix is not empty. */
    const size_t rows = items_of(node), columns = items_of(item_of(r, node, 0));
    for (size_t i = 0; i < rows; i++) {
        const yaml_node_t *row = item_of(r, node, i);
        if (items_of(row) != columns)
            return lg_yaml_fail(r->yaml, (uint32_t)row->start_mark.line + 1, LG_FORMAT, r->error,
                                "%s: rows of different length", key->name);
        for (size_t j = 0; j < columns; j++) LG_TRY(read_one(r, key, item_of(r, row, j), term));
    }
    return LG_OK;
}
