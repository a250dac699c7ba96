/* Reads numbers of a machine that are unknown one by one from YAML, the word `unknown`, or {start: 3, within:
 * [1, 10], sigma: 1}, of a lag with the key `order`, which actuators.c reads; and the system of a machine and
 * its parameters. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "machine/files/reading.h"
#include "machine/internal.h"

typedef lg_machine_reading reading;

/* ---- numbers that are unknown one by one ---- */

enum { ENTRY_START, ENTRY_WITHIN, ENTRY_SIGMA, ENTRY_ORDER, ENTRY_COUNT };
static const lg_field entry_keys[ENTRY_COUNT] = {
    [ENTRY_START] = {.name = "start", .type = LG_FIELD_REAL, .low = -DBL_MAX, .high = DBL_MAX},
    [ENTRY_WITHIN] = LG_KEY_WITHIN,
    [ENTRY_SIGMA] = LG_KEY_SIGMA,
    [ENTRY_ORDER] = LG_NODE("order"),
};

/* Whether the node is the word `unknown` or {start: ..., within: ..., sigma: ...}. */
static bool is_entry(const yaml_node_t *node) {
    return node->type == YAML_MAPPING_NODE || lg_node_is(node, "unknown");
}

/* *start is NaN where it is not given. `ordered`: the key `order` is allowed. */
static lg_status read_entry(reading *r, const char *what, bool ordered, const yaml_node_t *node,
                            double *start, lg_machine_entry *out) {
    lg_key_value values[ENTRY_COUNT] = {{.line = 0}};
    const lg_key_set set = {entry_keys, ordered ? ENTRY_COUNT : ENTRY_ORDER, values};
    *start = NAN;
    if (lg_node_is(node, "unknown")) return LG_OK;
    LG_TRY(lg_yaml_read_below(r->yaml, node, &set, what, r->error));
    const uint32_t line = lg_node_line(node);
    if (values[ENTRY_START].line != 0) *start = values[ENTRY_START].real[0];
    if (values[ENTRY_SIGMA].line != 0) out->sigma = values[ENTRY_SIGMA].real[0];
    if (values[ENTRY_SIGMA].line != 0 && isnan(*start))
        return LG_FAULT(r, line, "%s: sigma needs a start, the centre of the prior", what);
    if (values[ENTRY_WITHIN].line == 0) return LG_OK;
    out->low = values[ENTRY_WITHIN].real[0], out->high = values[ENTRY_WITHIN].real[1];
    if (values[ENTRY_WITHIN].count != 2 || !(out->low < out->high))
        return LG_FAULT(r, line, "%s: within: expected [low, high]", what);
    if (!isnan(*start) && !(*start > out->low && *start < out->high))
        return LG_FAULT(r, line, "%s: start %g is not between %g and %g", what, *start, out->low, out->high);
    return LG_OK;
}

bool lg_machine_has_entries(const reading *r, const yaml_node_t *node) {
    bool any = is_entry(node);
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
    if (!is_entry(node))
        return lg_yaml_block(r->yaml, key, &value, (const size_t[3]){1, 1, 1}, number, NULL, r->error);
    lg_machine_entry *entry = &term->entries[term->entry_count++];
    *entry = (lg_machine_entry){.index = term->value_count - 1};
    return read_entry(r, key->name, term->kind->order > 0, node, number, entry);
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

/* ---- parameters ---- */

/* One parameter while it is read: its numbers (NaN: use the default), and which of them are unknown. */
typedef struct parameter {
    const char *key;
    size_t count;    /* how many numbers are given; 0: all have their defaults */
    size_t unknowns; /* how many truths are given; 1 stands for all numbers */
    double values[LG_MACHINE_PARAMETERS];
    bool unknown[LG_MACHINE_PARAMETERS];
    lg_machine_entry entries[LG_MACHINE_PARAMETERS]; /* bounds and priors of unknown numbers */
} parameter;

static lg_status check_items(const reading *r, const char *key, const yaml_node_t *node, size_t *count) {
    *count = lg_node_items(node);
    if (*count > 0 && *count <= LG_MACHINE_PARAMETERS) return LG_OK;
    return LG_FAULT(r, lg_node_line(node), "%s: expected 1 to %d numbers", key, LG_MACHINE_PARAMETERS);
}

/* ---- values ---- */

static lg_status read_number(reading *r, const yaml_node_t *node, parameter *p, size_t i) {
    const lg_field key = {.name = p->key, .low = -DBL_MAX, .high = DBL_MAX};
    const lg_key_value value = {.line = lg_node_line(node), .node = node};
    p->unknown[i] = is_entry(node);
    if (p->unknown[i]) return read_entry(r, p->key, false, node, &p->values[i], &p->entries[i]);
    return lg_yaml_block(r->yaml, &key, &value, (const size_t[3]){1, 1, 1}, &p->values[i], NULL, r->error);
}

/* Reads a number, a list of numbers, or the word `unknown` in place of any number or of the whole list. */
static lg_status read_numbers(reading *r, const yaml_node_t *node, parameter *p) {
    if (lg_node_is(node, "unknown")) {
        p->count = 0;
        p->unknown[0] = true;
        return LG_OK;
    }
    LG_TRY(check_items(r, p->key, node, &p->count));
    for (size_t i = 0; i < p->count; i++) LG_TRY(read_number(r, lg_node_item(r->yaml, node, i), p, i));
    return LG_OK;
}

/* Reads true, false, or a list of them. */
static lg_status read_truths(const reading *r, const yaml_node_t *node, parameter *p) {
    LG_TRY(check_items(r, p->key, node, &p->unknowns));
    for (size_t i = 0; i < p->unknowns; i++) {
        const yaml_node_t *item = lg_node_item(r->yaml, node, i);
        p->unknown[i] = lg_node_is(item, "true");
        if (!p->unknown[i] && !lg_node_is(item, "false"))
            return LG_FAULT(r, lg_node_line(item),
                            "%s: unknown: expected true, false, or a list of true and false", p->key);
    }
    return LG_OK;
}

enum { KEY_START, KEY_UNKNOWN, KEY_WITHIN, KEY_SIGMA, KEY_COUNT };
static const lg_field keys[KEY_COUNT] = {
    [KEY_START] = LG_NODE("start", .required = true),
    [KEY_UNKNOWN] = LG_NODE("unknown"),
    [KEY_WITHIN] = LG_KEY_WITHIN,
    [KEY_SIGMA] = LG_KEY_SIGMA,
};

/* Reads {start: ..., unknown: ..., within: [...], sigma: ...}; the latter hold for all unknown numbers.
 * `unknown` is a truth value, or one per number of `start`; default true. */
static lg_status read_start(reading *r, const yaml_node_t *node, parameter *p) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    LG_TRY(LG_READ_MAP(r, node, keys, values, p->key));
    LG_TRY(read_numbers(r, values[KEY_START].node, p));
    if (p->count == 0)
        return LG_FAULT(r, values[KEY_START].line, "%s: start: expected a number, or a list of numbers",
                        p->key);
    p->unknowns = 1;
    p->unknown[0] = true;
    if (values[KEY_UNKNOWN].line != 0) LG_TRY(read_truths(r, values[KEY_UNKNOWN].node, p));
    if (p->unknowns != 1 && p->unknowns != p->count)
        return LG_FAULT(r, values[KEY_UNKNOWN].line,
                        "%s: unknown: expected true or false, once or for each of the %zu numbers of start",
                        p->key, p->count);
    for (size_t i = 1; i < p->count && p->unknowns == 1; i++) p->unknown[i] = p->unknown[0];
    const lg_key_value *within = &values[KEY_WITHIN];
    if (within->line != 0 && !(within->count == 2 && within->real[0] < within->real[1]))
        return LG_FAULT(r, within->line, "%s: within: expected [low, high]", p->key);
    for (size_t i = 0; i < p->count; i++) {
        if (within->line != 0) p->entries[i].low = within->real[0], p->entries[i].high = within->real[1];
        if (values[KEY_SIGMA].line != 0) p->entries[i].sigma = values[KEY_SIGMA].real[0];
    }
    return LG_OK;
}

static lg_status read_parameter(reading *r, const char *key, const yaml_node_t *node) {
    lg_error inner = {LG_OK, ""};
    parameter p = {.key = key};
    LG_TRY(node->type == YAML_MAPPING_NODE ? read_start(r, node, &p) : read_numbers(r, node, &p));
    lg_status status = lg_machine_set_parameter(&r->out->machine, key, p.count, p.values, p.unknown, &inner);
    for (size_t i = 0; i < p.count && status == LG_OK; i++) {
        const lg_machine_entry *e = &p.entries[i];
        if (p.unknown[i] && (e->low < e->high || e->sigma > 0.0))
            status = lg_machine_bound_parameter(&r->out->machine, key, i, e->low, e->high, e->sigma, &inner);
    }
    if (status == LG_OK) return LG_OK;
    return LG_FAULT(r, lg_node_line(node), "parameters: %s", inner.message);
}

/* ---- the keys of the file ---- */

static lg_status read_parameters(reading *r, const lg_key_value *value) {
    const yaml_node_t *map = value->node;
    if (map->type != YAML_MAPPING_NODE) return LG_FAULT(r, value->line, "parameters: expected {KEY: ...}");
    const yaml_node_pair_t *first = map->data.mapping.pairs.start;
    for (const yaml_node_pair_t *pair = first; pair < map->data.mapping.pairs.top; pair++) {
        const yaml_node_t *name = lg_node_at(r->yaml, pair->key);
        char key[LG_MACHINE_NAME] = "";
        if (name->type != YAML_SCALAR_NODE || name->data.scalar.length >= sizeof key)
            return LG_FAULT(r, lg_node_line(name), "parameters: a key is too long");
        memcpy(key, name->data.scalar.value, name->data.scalar.length);
        for (const yaml_node_pair_t *other = first; other < pair; other++)
            if (lg_node_is(lg_node_at(r->yaml, other->key), key))
                return LG_FAULT(r, lg_node_line(name), "parameters: key '%s' is given twice", key);
        LG_TRY(read_parameter(r, key, lg_node_at(r->yaml, pair->value)));
    }
    return LG_OK;
}

lg_status lg_machine_read_system(reading *r, const lg_key_value *system, const lg_key_value *form,
                                 const lg_key_value *parameters) {
    lg_error inner = {LG_OK, ""};
    const lg_key_value *without = form->line != 0 ? form : parameters;
    if (system->line == 0 && without->line == 0) return LG_OK;
    if (system->line == 0)
        return LG_FAULT(r, without->line, "key 'system' is missing: only a system has a form or parameters");
    if (lg_machine_set_system(&r->out->machine, system->text, &inner) != LG_OK)
        return LG_FAULT(r, system->line, "system: %s", inner.message);
    if (form->line != 0 && lg_system_parameters(system->text, form->text) == NULL)
        return LG_FAULT(r, form->line, "form: system %s has no form '%.40s'", system->text, form->text);
    return parameters->line != 0 ? read_parameters(r, parameters) : LG_OK;
}
