/* Reads how inputs act from the section `inputs` of a machine's file: `hold`, `delay`, `lag` and `curve`, one
 * value for all inputs or a list of one for each. Inputs with terms of the same kind share a term. */
#include <float.h>
#include <string.h>

#include "machine/files/reading.h"
#include "machine/files/recipe.h"

typedef lg_machine_reading reading;

/* Calls `read` with the node of each input. */
static lg_status read_each(reading *r, const char *name, const lg_key_value *value,
                           lg_status (*read)(reading *r, const yaml_node_t *node, uint32_t input)) {
    const yaml_node_t *list = value->node;
    const uint32_t m = r->out->machine.input_count;
    if (value->line == 0) return LG_OK;
    if (list->type == YAML_SEQUENCE_NODE && lg_node_items(list) != m)
        return LG_FAULT(r, value->line,
                        "%s: expected one value, or a list with one for each of the %u inputs", name, m);
    for (uint32_t i = 0; i < m; i++) LG_TRY(read(r, lg_node_item(r->yaml, list, i), i));
    return LG_OK;
}

/* ---- hold and delay ---- */

const char *const lg_input_holds[LG_INPUT_HOLD_COUNT] = {"zero", "linear", "cubic"};

static lg_status read_hold(reading *r, const yaml_node_t *node, uint32_t input) {
    lg_log_input *out = &r->out->inputs[input];
    out->choose_hold = lg_node_is(node, "auto");
    if (out->choose_hold) return LG_OK;
    for (uint32_t hold = 0; hold < LG_INPUT_HOLD_COUNT; hold++)
        if (lg_node_is(node, lg_input_holds[hold])) {
            out->hold = (lg_input_hold)hold;
            return LG_OK;
        }
    return LG_FAULT(r, lg_node_line(node),
                    "inputs.hold: '%.40s' is unknown; known: zero, linear, cubic, auto",
                    node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value : "?");
}

static lg_status read_delay(reading *r, const yaml_node_t *node, uint32_t input) {
    static const uint64_t most = 1000000;
    lg_log_input *out = &r->out->inputs[input];
    uint64_t rows = 0;
    out->estimate_delay = lg_node_is(node, "estimate");
    out->choose_delay = lg_node_is(node, "auto");
    if (out->estimate_delay || out->choose_delay) return LG_OK;
    const char *text = node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value : "";
    if (!lg_node_is(node, text) || lg_integer_parse(text, &rows) != LG_OK || rows > most)
        return LG_FAULT(r, lg_node_line(node),
                        "inputs.delay: expected a whole number of rows from 0 to 1000000, `auto` or "
                        "`estimate`");
    out->delay = (uint32_t)rows;
    return LG_OK;
}

lg_status lg_machine_read_timing(reading *r, const lg_key_value *hold, const lg_key_value *delay) {
    r->out->hold_given = r->out->hold_given || hold->line != 0;
    LG_TRY(read_each(r, "inputs.hold", hold, read_hold));
    return read_each(r, "inputs.delay", delay, read_delay);
}

/* ---- lags and curves ---- */

/* What one input gets: a kind, its degree, and `count` numbers, which are at least `low`. */
typedef struct wish {
    const char *kind, *name;
    uint32_t input, degree, count;
    double low;
    bool above; /* the numbers are greater than `low` */
} wish;

/* The term of this kind and degree, with or without values, or a new one. */
static lg_status find_term(reading *r, const wish *w, bool given, uint32_t line, lg_machine_term **out) {
    lg_machine *m = &r->out->machine;
    const lg_term_kind *kind = lg_term_kind_find(LG_MACHINE_ACTUATOR, w->kind);
    for (uint32_t i = 0; i < m->term_count; i++) {
        *out = &m->terms[i];
        if ((*out)->kind == kind && (*out)->degree == w->degree && ((*out)->value_count > 0) == given)
            return LG_OK;
    }
    if (m->term_count == LG_MACHINE_TERMS) return LG_FAULT(r, line, "more than %d terms", LG_MACHINE_TERMS);
    r->lines[m->term_count] = line;
    *out = &m->terms[m->term_count++];
    **out = (lg_machine_term){.kind = kind, .part = LG_MACHINE_ACTUATOR, .degree = w->degree};
    return LG_OK;
}

/* Adds what the input gets, which is read at the node `at`. `node`: its numbers, some of which may be
 * unknown; NULL or the word `unknown`: all are, without starts. */
static lg_status add(reading *r, const wish *w, const yaml_node_t *at, const yaml_node_t *node) {
    lg_machine_term *term;
    const lg_field key = {.name = w->name, .low = w->low, .above = w->above, .high = DBL_MAX};
    const bool given = node != NULL && !lg_node_is(node, "unknown");
    const lg_key_value value = {.line = lg_node_line(at), .node = node};
    LG_TRY(find_term(r, w, given, value.line, &term));
    term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_INPUT, w->input};
    if (!given) return LG_OK;
    const uint32_t before = term->value_count;
    if (!lg_machine_has_entries(r, node)) {
        term->value_count += w->count;
        return lg_yaml_block(r->yaml, &key, &value, (const size_t[3]){1, 1, w->count}, term->values + before,
                             NULL, r->error);
    }
    LG_TRY(lg_machine_read_entries(r, &key, node, term));
    if (term->value_count - before == w->count) return LG_OK;
    return LG_FAULT(r, value.line, "%s: has %u numbers, expected %u", w->name, term->value_count - before,
                    w->count);
}

/* Keys of a lag that is a map; `start`, `within` and `sigma` are those of a number that is unknown. */
enum { LAG_ORDER, LAG_VALUE, LAG_START, LAG_WITHIN, LAG_SIGMA, LAG_COUNT };
static const lg_field lag_keys[LAG_COUNT] = {
    [LAG_ORDER] = {.name = "order", .type = LG_FIELD_WHOLES, .low = 1, .high = 2, .most = 1},
    [LAG_VALUE] = LG_NODE("value"),
    [LAG_START] = LG_NODE("start"),
    [LAG_WITHIN] = LG_NODE("within"),
    [LAG_SIGMA] = LG_NODE("sigma"),
};

static lg_status read_lag(reading *r, const yaml_node_t *node, uint32_t input) {
    lg_key_value values[LAG_COUNT] = {{.line = 0}};
    wish w = {.kind = "lag", .name = "inputs.lag", .input = input, .count = 1, .above = true};
    if (lg_node_is(node, "none")) return LG_OK;
    if (node->type != YAML_MAPPING_NODE) return add(r, &w, node, node);
    LG_TRY(LG_READ_MAP(r, node, lag_keys, values, "inputs.lag"));
    const bool given = values[LAG_VALUE].line != 0,
               bound = values[LAG_START].line + values[LAG_WITHIN].line + values[LAG_SIGMA].line != 0;
    if (given && bound)
        return LG_FAULT(r, lg_node_line(node),
                        "inputs.lag: a lag with a value has no start, bounds or prior");
    if (values[LAG_ORDER].line != 0 && values[LAG_ORDER].real[0] == 2.0) w.kind = "second_order_lag";
    return add(r, &w, node, given ? values[LAG_VALUE].node : bound ? node : NULL);
}

enum { KEY_DEGREE, KEY_VALUES, KEY_DEAD_ZONE, KEY_COUNT };
static const lg_field keys[KEY_COUNT] = {
    [KEY_DEGREE] = {.name = "degree", .type = LG_FIELD_WHOLES, .low = 2, .high = 3, .most = 1},
    [KEY_VALUES] = LG_NODE("values"),
    [KEY_DEAD_ZONE] = LG_NODE("dead_zone"),
};

static lg_status read_curve(reading *r, const yaml_node_t *node, uint32_t input) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    const lg_key_value *degree = &values[KEY_DEGREE], *zone = &values[KEY_DEAD_ZONE],
                       *given = &values[KEY_VALUES];
    const wish dead = {.kind = "dead_zone", .name = "inputs.curve.dead_zone", .input = input, .count = 1};
    wish bent = {.kind = "curve", .name = "inputs.curve.values", .input = input, .low = -DBL_MAX};
    if (lg_node_is(node, "none")) return LG_OK;
    if (node->type != YAML_MAPPING_NODE)
        return LG_FAULT(r, lg_node_line(node),
                        "inputs.curve: expected none, {degree: 2}, {degree: 3} or {dead_zone: unknown}");
    LG_TRY(LG_READ_MAP(r, node, keys, values, "inputs.curve"));
    if (degree->line == 0 && (zone->line == 0 || given->line != 0))
        return LG_FAULT(r, lg_node_line(node), "inputs.curve: needs key 'degree'%s",
                        zone->line == 0 ? " or key 'dead_zone'" : ", because it has values");
    if (zone->line != 0) LG_TRY(add(r, &dead, node, zone->node));
    if (degree->line == 0) return LG_OK;
    bent.degree = (uint32_t)degree->real[0];
    bent.count = bent.degree - 1;
    return add(r, &bent, node, given->line != 0 ? given->node : NULL);
}

lg_status lg_machine_read_actuators(reading *r, const lg_key_value *lag, const lg_key_value *curve) {
    LG_TRY(read_each(r, "inputs.lag", lag, read_lag));
    return read_each(r, "inputs.curve", curve, read_curve);
}
