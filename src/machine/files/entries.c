/* Reads numbers of a machine that are unknown one by one from YAML: the word `unknown`, or {start: 3,
 * within: [1, 10], sigma: 1}; of a lag with the key `order`, which actuators.c reads. */
#include <float.h>
#include <math.h>

#include "machine/files/reading.h"
#include "machine/internal.h"

typedef lg_machine_reading reading;

enum { KEY_START, KEY_WITHIN, KEY_SIGMA, KEY_ORDER, KEY_COUNT };
static const lg_field keys[KEY_COUNT] = {
    [KEY_START] = {.name = "start", .type = LG_FIELD_REAL, .low = -DBL_MAX, .high = DBL_MAX},
    [KEY_WITHIN] = LG_KEY_WITHIN,
    [KEY_SIGMA] = LG_KEY_SIGMA,
    [KEY_ORDER] = LG_NODE("order"),
};

bool lg_machine_is_entry(const yaml_node_t *node) {
    return node->type == YAML_MAPPING_NODE || lg_node_is(node, "unknown");
}

lg_status lg_machine_read_entry(reading *r, const char *what, bool ordered, const yaml_node_t *node,
                                double *start, lg_machine_entry *out) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    const lg_key_set set = {keys, ordered ? KEY_COUNT : KEY_ORDER, values};
    *start = NAN;
    if (lg_node_is(node, "unknown")) return LG_OK;
    LG_TRY(lg_yaml_read_below(r->yaml, node, &set, what, r->error));
    const uint32_t line = lg_node_line(node);
    if (values[KEY_START].line != 0) *start = values[KEY_START].real[0];
    if (values[KEY_SIGMA].line != 0) out->sigma = values[KEY_SIGMA].real[0];
    if (values[KEY_SIGMA].line != 0 && isnan(*start))
        return LG_FAULT(r, line, "%s: sigma needs a start, the centre of the prior", what);
    if (values[KEY_WITHIN].line == 0) return LG_OK;
    out->low = values[KEY_WITHIN].real[0], out->high = values[KEY_WITHIN].real[1];
    if (values[KEY_WITHIN].count != 2 || !(out->low < out->high))
        return LG_FAULT(r, line, "%s: within: expected [low, high]", what);
    if (!isnan(*start) && !(*start > out->low && *start < out->high))
        return LG_FAULT(r, line, "%s: start %g is not between %g and %g", what, *start, out->low, out->high);
    return LG_OK;
}

bool lg_machine_has_entries(const reading *r, const yaml_node_t *node) {
    bool any = lg_machine_is_entry(node);
    for (size_t i = 0; i < lg_node_items(node) && node->type == YAML_SEQUENCE_NODE && !any; i++)
        any = lg_machine_has_entries(r, lg_node_item(r->yaml, node, i));
    return any;
}

static lg_status read_one(reading *r, const lg_field *key, const yaml_node_t *node, lg_machine_term *term) {
    const lg_key_value value = {.line = lg_node_line(node), .node = node};
    if (term->value_count == LG_MACHINE_VALUES || term->entry_count == LG_MACHINE_ENTRIES)
        return LG_FAULT(r, value.line, "%s: more than %d numbers, or %d unknown ones", key->name,
                        LG_MACHINE_VALUES, LG_MACHINE_ENTRIES);
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
    const size_t rows = lg_node_items(node), columns = lg_node_items(lg_node_item(r->yaml, node, 0));
    for (size_t i = 0; i < rows; i++) {
        const yaml_node_t *row = lg_node_item(r->yaml, node, i);
        if (lg_node_items(row) != columns)
            return LG_FAULT(r, lg_node_line(row), "%s: rows of different length", key->name);
        for (size_t j = 0; j < columns; j++) LG_TRY(read_one(r, key, lg_node_item(r->yaml, row, j), term));
    }
    return LG_OK;
}
