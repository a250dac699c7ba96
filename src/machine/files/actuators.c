/* Reads lags and curves of actuators from the section `inputs` of a machine's file: `lag` and `curve`, one
 * value for all inputs or a list of one for each. Inputs with terms of the same kind share a term. */
#include <float.h>
#include <string.h>
#include <yaml.h>

#include "machine/files/reading.h"
#include "settings/names.h"

typedef lg_machine_reading reading;

static uint32_t line_of(const yaml_node_t *node) {
    return (uint32_t)node->start_mark.line + 1;
}

static bool is_word(const yaml_node_t *node, const char *word) {
    return node->type == YAML_SCALAR_NODE && node->data.scalar.length == strlen(word) &&
           memcmp(node->data.scalar.value, word, strlen(word)) == 0;
}

enum { MOST_VALUES = 2 };
/* What one input gets: a kind, its degree, and `count` values (0: unknown). */
typedef struct wish {
    const char *kind;
    uint32_t input, degree, count, line;
    double values[MOST_VALUES];
} wish;

/* The term of this kind and degree, known or unknown, or a new one. */
static lg_status find_term(reading *r, const wish *w, lg_machine_term **out) {
    lg_machine *m = &r->out->machine;
    const lg_term_kind *kind = lg_term_kind_find(LG_MACHINE_ACTUATOR, w->kind);
    for (uint32_t i = 0; i < m->term_count; i++) {
        *out = &m->terms[i];
        if ((*out)->kind == kind && (*out)->degree == w->degree &&
            ((*out)->value_count > 0) == (w->count > 0))
            return LG_OK;
    }
    if (m->term_count == LG_MACHINE_TERMS)
        return lg_yaml_fail(r->yaml, w->line, LG_FORMAT, r->error, "more than %d terms", LG_MACHINE_TERMS);
    r->lines[m->term_count] = w->line;
    *out = &m->terms[m->term_count++];
    **out = (lg_machine_term){.kind = kind, .part = LG_MACHINE_ACTUATOR, .degree = w->degree};
    return LG_OK;
}

static lg_status add(reading *r, const wish *w) {
    lg_machine_term *term;
    LG_TRY(find_term(r, w, &term));
    term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_INPUT, w->input};
    memcpy(term->values + term->value_count, w->values, w->count * sizeof *w->values);
    term->value_count += w->count;
    return LG_OK;
}

/* Reads `unknown`, or `count` numbers from `low` on. */
static lg_status read_values(reading *r, const char *name, const yaml_node_t *node, bool above, double low,
                             size_t count, wish *out) {
    const lg_field key = {.name = name, .low = low, .above = above, .high = DBL_MAX};
    const lg_key_value value = {.line = line_of(node), .node = node};
    if (is_word(node, "unknown")) return LG_OK;
    out->count = (uint32_t)count;
    return lg_yaml_block(r->yaml, &key, &value, (const size_t[3]){1, 1, count}, out->values, NULL, r->error);
}

static lg_status read_lag(reading *r, const yaml_node_t *node, uint32_t input) {
    wish w = {.kind = "lag", .input = input, .line = line_of(node)};
    if (is_word(node, "none")) return LG_OK;
    LG_TRY(read_values(r, "inputs.lag", node, true, 0.0, 1, &w));
    return add(r, &w);
}

enum { KEY_DEGREE, KEY_VALUES, KEY_DEAD_ZONE, KEY_COUNT };
static const lg_field keys[KEY_COUNT] = {
    [KEY_DEGREE] = {.name = "degree", .type = LG_FIELD_WHOLES, .low = 2, .high = 3, .most = 1},
    [KEY_VALUES] = {.name = "values", .type = LG_FIELD_NODE},
    [KEY_DEAD_ZONE] = {.name = "dead_zone", .type = LG_FIELD_NODE},
};

static lg_status read_curve(reading *r, const yaml_node_t *node, uint32_t input) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    const lg_key_set set = {keys, KEY_COUNT, values};
    const lg_key_value *degree = &values[KEY_DEGREE], *zone = &values[KEY_DEAD_ZONE],
                       *given = &values[KEY_VALUES];
    wish w = {.input = input, .line = line_of(node)}, bent = w;
    if (is_word(node, "none")) return LG_OK;
    if (node->type != YAML_MAPPING_NODE)
        return lg_yaml_fail(r->yaml, w.line, LG_FORMAT, r->error,
                            "inputs.curve: expected none, {degree: 2}, {degree: 3} or {dead_zone: unknown}");
    LG_TRY(lg_yaml_read_below(r->yaml, node, &set, "inputs.curve", r->error));
    if (degree->line == 0 && (zone->line == 0 || given->line != 0))
        return lg_yaml_fail(r->yaml, w.line, LG_FORMAT, r->error, "inputs.curve: needs key 'degree'%s",
                            zone->line == 0 ? " or key 'dead_zone'" : ", because it has values");
    if (zone->line != 0) {
        w.kind = "dead_zone";
        LG_TRY(read_values(r, "inputs.curve.dead_zone", zone->node, false, 0.0, 1, &w));
        LG_TRY(add(r, &w));
    }
    if (degree->line == 0) return LG_OK;
    bent.kind = "curve";
    bent.degree = (uint32_t)degree->real[0];
    if (given->line != 0)
        LG_TRY(read_values(r, "inputs.curve.values", given->node, false, -DBL_MAX, bent.degree - 1, &bent));
    return add(r, &bent);
}

/* Calls `read` with the node of each input. */
static lg_status read_each(reading *r, const char *name, const lg_key_value *value,
                           lg_status (*read)(reading *r, const yaml_node_t *node, uint32_t input)) {
    const yaml_node_t *list = value->node;
    const uint32_t m = r->out->machine.input_count;
    if (value->line == 0) return LG_OK;
    const bool many = list->type == YAML_SEQUENCE_NODE;
    if (many && list->data.sequence.items.top - list->data.sequence.items.start != (ptrdiff_t)m)
        return lg_yaml_fail(r->yaml, value->line, LG_FORMAT, r->error,
                            "%s: expected one value, or a list with one for each of the %u inputs", name, m);
    for (uint32_t i = 0; i < m; i++)
        LG_TRY(
            read(r,
                 many ? yaml_document_get_node(lg_yaml_document(r->yaml), list->data.sequence.items.start[i])
                      : list,
                 i));
    return LG_OK;
}

lg_status lg_machine_read_actuators(reading *r, const lg_key_value *lag, const lg_key_value *curve) {
    LG_TRY(read_each(r, "inputs.lag", lag, read_lag));
    return read_each(r, "inputs.curve", curve, read_curve);
}
