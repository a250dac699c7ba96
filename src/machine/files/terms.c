/* Reads the terms of a machine from YAML. */
#include <float.h>
#include <string.h>

#include "machine/files/reading.h"
#include "machine/internal.h"

typedef lg_machine_reading reading;

static const uint32_t default_hidden[] = {16, 16};

enum {
    KEY_KIND,
    KEY_FORM,
    KEY_OF,
    KEY_HIDDEN,
    KEY_ACTIVATION,
    KEY_DEGREE,
    KEY_VALUES,
    KEY_COULOMB,
    KEY_QUADRATIC,
    KEY_WIDTH,
    KEY_COULOMB_WIDTH,
    KEY_COUNT
};

static const lg_field keys[KEY_COUNT] = {
    [KEY_KIND] = {.name = "kind", .type = LG_FIELD_TEXT, .required = true},
    [KEY_FORM] = {.name = "form", .type = LG_FIELD_TEXT},
    [KEY_OF] = LG_NODE("of"),
    [KEY_HIDDEN] = LG_KEY_HIDDEN,
    [KEY_ACTIVATION] = LG_FIELD(lg_machine_term, NULL, "activation", NAME, activation,
                                LG_NAMED(lg_activation_name, LG_ACTIVATION_COUNT)),
    [KEY_DEGREE] = LG_FIELD(lg_machine_term, NULL, "degree", U32, degree, .low = 1, .high = 8),
    [KEY_VALUES] = LG_NODE("values", .low = -DBL_MAX, .high = DBL_MAX),
    [KEY_COULOMB] = {.name = "coulomb", .type = LG_FIELD_NAME, LG_NAMES("false", "true")},
    [KEY_QUADRATIC] = {.name = "quadratic", .type = LG_FIELD_NAME, LG_NAMES("false", "true")},
    [KEY_WIDTH] = {.name = "width", .type = LG_FIELD_REAL, .above = true, .high = DBL_MAX},
    [KEY_COULOMB_WIDTH] = {.name = "coulomb_width", .type = LG_FIELD_REAL, .above = true, .high = DBL_MAX},
};

/* The options of a kind, any of which makes the key allowed; 0: check_keys decides, or the key is always
 * allowed. */
static const uint32_t takes[KEY_COUNT] = {[KEY_OF] = LG_TERM_OF | LG_TERM_SOME,
                                          [KEY_HIDDEN] = LG_TERM_HIDDEN,
                                          [KEY_ACTIVATION] = LG_TERM_HIDDEN,
                                          [KEY_DEGREE] = LG_TERM_DEGREE,
                                          [KEY_VALUES] = LG_TERM_VALUES | LG_TERM_KNOWN};

static bool is_true(const lg_key_value *value) {
    return value->line != 0 && value->real[0] == 1;
}

/* ---- features ---- */

/* Suffixes of a coordinate's name, and the kinds of coordinates that have them. */
#define BIT(kind) (1U << (kind))
static const struct {
    const char *suffix;
    lg_machine_sight kind;
    unsigned kinds;
} suffixes[] = {
    {"", LG_FEATURE_POSITION, ~0U},
    {".place", LG_FEATURE_PLACE, BIT(LG_COORDINATE_POSE)},
    {".rotation", LG_FEATURE_ROTATION, BIT(LG_COORDINATE_POSE)},
    {".up", LG_FEATURE_UP, BIT(LG_COORDINATE_POSE) | BIT(LG_COORDINATE_ROTATION)},
    {".height", LG_FEATURE_HEIGHT, ~0U},
    {".velocity", LG_FEATURE_VELOCITY, ~0U},
};

/* Finds the feature NAME or NAME.suffix of a coordinate. */
static bool find_coordinate(const lg_machine *m, const char *text, lg_machine_feature *out) {
    const size_t length = strcspn(text, ".");
    for (uint32_t i = 0; i < m->coordinate_count; i++) {
        const char *name = m->coordinates[i].name;
        if (strlen(name) != length || memcmp(name, text, length) != 0) continue;
        for (size_t s = 0; s < LG_COUNT(suffixes); s++) {
            if (strcmp(text + length, suffixes[s].suffix) != 0) continue;
            *out = (lg_machine_feature){suffixes[s].kind, i};
            return (suffixes[s].kinds & BIT(m->coordinates[i].kind)) != 0;
        }
    }
    return false;
}

/* Finds the feature of an input's column, or of a velocity's column of a line or angle; in biases also of an
 * acceleration's column. */
static bool find_column(const lg_machine_file *file, lg_machine_part part, const char *text,
                        lg_machine_feature *out) {
    const bool shown = !file->machine.accelerations || part == LG_MACHINE_BIAS;
    for (uint32_t i = 0; i < file->column_count; i++) {
        const lg_log_column *c = &file->columns[i];
        if (strcmp(c->name, text) != 0) continue;
        const bool input = c->role == LG_LOG_INPUT;
        *out = (lg_machine_feature){input ? LG_FEATURE_INPUT : LG_FEATURE_VELOCITY, c->index};
        return input || (c->role == LG_LOG_VELOCITY && shown && file->coordinates[c->index].attitudes == 0);
    }
    return false;
}

static lg_status unknown_feature(reading *r, uint32_t line, const char *text) {
    char known[160] = "";
    const lg_machine *m = &r->out->machine;
    for (uint32_t i = 0; i < m->coordinate_count; i++)
        lg_append(known, sizeof known, "%s%s", i > 0 ? ", " : "", m->coordinates[i].name);
    return LG_FAULT(
        r, line,
        "of: '%s' is unknown; expected one of %s, or NAME.velocity, NAME.height, NAME.place, NAME.rotation "
        "(poses), NAME.up (rotations, poses), an input, or a column of a velocity",
        text, known);
}

static lg_status add_feature(reading *r, uint32_t line, const char *text, void *user) {
    lg_machine_term *term = user;
    lg_machine_feature feature = {LG_FEATURE_POSITION, 0};
    const char *part = lg_machine_part_name(term->part), *kind = lg_term_kind_name(term->kind);
    const bool moving = lg_term_has(term, LG_TERM_MOVING);
    const bool coordinate = find_coordinate(&r->out->machine, text, &feature);
    if (!coordinate && !find_column(r->out, term->part, text, &feature))
        return unknown_feature(r, line, text);
    if (coordinate && term->part == LG_MACHINE_BIAS && r->out->machine.accelerations)
        return LG_FAULT(r, line, "of: '%s' is not measured: name the column of an acceleration", text);
    if (term->part == LG_MACHINE_OFFSET && feature.kind == LG_FEATURE_VELOCITY)
        feature.kind = LG_FEATURE_POSITION;
    if (feature.kind == LG_FEATURE_VELOCITY && !moving)
        return LG_FAULT(r, line, "of: '%s' is a velocity; %s of kind %s depends on positions alone", text,
                        part, kind);
    const bool inputs = lg_term_has(term, LG_TERM_INPUTS);
    if (feature.kind == LG_FEATURE_INPUT && !inputs && !(moving && term->part == LG_MACHINE_RESIDUAL))
        return LG_FAULT(r, line, "of: '%s' is an input; only a residual and a load depend on inputs", text);
    if (feature.kind != LG_FEATURE_INPUT && inputs)
        return LG_FAULT(r, line, "of: '%s' is not an input; without `of` the load is the potential's force",
                        text);
    for (uint32_t i = 0; i < term->of_count; i++)
        if (term->of[i].kind == feature.kind && term->of[i].index == feature.index)
            return LG_FAULT(r, line, "of: '%s' is given twice", text);
    if (term->of_count == LG_MACHINE_FEATURES)
        return LG_FAULT(r, line, "of: more than %d names", LG_MACHINE_FEATURES);
    term->of[term->of_count++] = feature;
    return LG_OK;
}

/* ---- values ---- */

/* Reads a number, a list of numbers or a list of rows. */
static lg_status read_values(reading *r, const lg_key_value *value, lg_machine_term *term) {
    const lg_field *key = &keys[KEY_VALUES];
    size_t shape[3] = {1, 1, 1};
    if (value->line == 0) return LG_OK;
    if (lg_machine_has_entries(r, value->node)) return lg_machine_read_entries(r, key, value->node, term);
    LG_TRY(lg_yaml_entries(r->yaml, key, value, 1, &shape[0], r->error));
    const yaml_node_t *list = value->node;
    if (list->type == YAML_SEQUENCE_NODE) {
        const yaml_node_t *first = lg_node_item(r->yaml, list, 0);
        const lg_key_value row = {.line = lg_node_line(first), .node = first};
        LG_TRY(lg_yaml_entries(r->yaml, key, &row, 1, &shape[1], r->error));
    }
    if (shape[0] > LG_MACHINE_VALUES || shape[1] > LG_MACHINE_VALUES ||
        shape[0] * shape[1] > LG_MACHINE_VALUES)
        return LG_FAULT(r, value->line, "values: more than %d numbers", LG_MACHINE_VALUES);
    term->value_count = (uint32_t)(shape[0] * shape[1]);
    return lg_yaml_block(r->yaml, key, value, shape, term->values, NULL, r->error);
}

/* ---- terms ---- */

static lg_status unknown_kind(reading *r, lg_machine_part part, uint32_t line, const char *name) {
    char known[200] = "none";
    const lg_term_kind *kind = NULL;
    if (part == LG_MACHINE_POTENTIAL) lg_append(known, sizeof known, ", known");
    for (size_t i = 0; (kind = lg_term_kind_at(part, i)) != NULL; i++)
        lg_append(known, sizeof known, ", %s", lg_term_kind_name(kind));
    return LG_FAULT(r, line, "%s: kind '%.40s' is unknown; expected one of %s", lg_machine_part_name(part),
                    name, known);
}

static lg_status add_term(reading *r, lg_machine_part part, uint32_t line, const char *kind,
                          lg_machine_term **out) {
    lg_machine *m = &r->out->machine;
    const lg_term_kind *row = lg_term_kind_find(part, kind);
    if (row == NULL) return unknown_kind(r, part, line, kind);
    if (part == LG_MACHINE_INPUT_MAP && m->input_count == 0)
        return LG_FAULT(r, line, "input_map: this machine has no inputs");
    if (m->term_count == LG_MACHINE_TERMS) return LG_FAULT(r, line, "more than %d terms", LG_MACHINE_TERMS);
    r->lines[m->term_count] = line;
    lg_machine_term *term = &m->terms[m->term_count++];
    *term = (lg_machine_term){.kind = row, .part = part, .activation = LG_TANH};
    const uint32_t options = lg_term_kind_options(row);
    if ((options & LG_TERM_HIDDEN) != 0) {
        term->hidden_layers = LG_COUNT(default_hidden);
        memcpy(term->hidden, default_hidden, sizeof default_hidden);
    }
    *out = term;
    return LG_OK;
}

/* Refuses keys that the kind does not take. */
static lg_status check_keys(reading *r, lg_machine_part part, const char *kind, uint32_t options,
                            const lg_key_value *values) {
    const bool damping = part == LG_MACHINE_DAMPING;
    const bool known = part == LG_MACHINE_POTENTIAL && strcmp(values[KEY_KIND].text, "known") == 0;
    const bool width = (options & LG_TERM_WIDTH) != 0 || is_true(&values[KEY_COULOMB]);
    for (int k = 0; k < KEY_COUNT; k++) {
        bool taken = takes[k] == 0 || (options & takes[k]) != 0;
        if (k == KEY_FORM) taken = known;
        if (k == KEY_COULOMB || k == KEY_QUADRATIC) taken = damping;
        if (k == KEY_WIDTH || k == KEY_COULOMB_WIDTH) taken = damping && width;
        if (values[k].line != 0 && !taken)
            return LG_FAULT(r, values[k].line, "%s: %s of kind %s does not take this key%s", keys[k].name,
                            lg_machine_part_name(part), kind,
                            k == KEY_WIDTH || k == KEY_COULOMB_WIDTH ? " without `coulomb: true`" : "");
    }
    if (values[KEY_WIDTH].line != 0 && values[KEY_COULOMB_WIDTH].line != 0)
        return LG_FAULT(r, values[KEY_COULOMB_WIDTH].line,
                        "coulomb_width: is the same as `width`; give one of them");
    return LG_OK;
}

/* 0: from the log. */
static double width_of(const lg_key_value *values) {
    if (values[KEY_WIDTH].line != 0) return values[KEY_WIDTH].real[0];
    return values[KEY_COULOMB_WIDTH].line != 0 ? values[KEY_COULOMB_WIDTH].real[0] : 0.0;
}

void lg_machine_set_widths(const lg_key_value *hidden, lg_machine_term *term) {
    if (!lg_term_has(term, LG_TERM_HIDDEN)) return;
    term->hidden_layers = hidden->count;
    for (uint32_t i = 0; i < hidden->count; i++) term->hidden[i] = (uint32_t)hidden->real[i];
}

static lg_status fill_term(reading *r, lg_machine_term *term, const lg_key_value *values) {
    if (values[KEY_OF].line != 0) LG_TRY(lg_machine_texts(r, values[KEY_OF].node, "of", add_feature, term));
    if (values[KEY_HIDDEN].line != 0) lg_machine_set_widths(&values[KEY_HIDDEN], term);
    LG_TRY(lg_yaml_store(r->yaml, keys, values, KEY_COUNT, term, r->error));
    if (lg_term_has(term, LG_TERM_WIDTH)) term->width = width_of(values);
    return read_values(r, &values[KEY_VALUES], term);
}

/* Adds the terms of `coulomb: true` and `quadratic: true` to a damping. */
static lg_status add_friction(reading *r, const lg_key_value *values) {
    lg_machine_term *term = NULL;
    if (is_true(&values[KEY_COULOMB])) {
        LG_TRY(add_term(r, LG_MACHINE_DAMPING, values[KEY_COULOMB].line, "coulomb", &term));
        term->width = width_of(values);
    }
    if (!is_true(&values[KEY_QUADRATIC])) return LG_OK;
    return add_term(r, LG_MACHINE_DAMPING, values[KEY_QUADRATIC].line, "quadratic", &term);
}

/* The name of the term's kind in the table of terms: for a known potential its `form`. */
static lg_status kind_of(reading *r, lg_machine_part part, const lg_key_value *values, const char **out) {
    *out = values[KEY_KIND].text;
    if (part != LG_MACHINE_POTENTIAL || strcmp(*out, "known") != 0) return LG_OK;
    static const char *const needed[] = {"form", "values"};
    static const int needed_key[] = {KEY_FORM, KEY_VALUES};
    for (size_t i = 0; i < LG_COUNT(needed); i++)
        if (values[needed_key[i]].line == 0)
            return LG_FAULT(r, values[KEY_KIND].line, "potential: kind known needs key '%s'", needed[i]);
    *out = values[KEY_FORM].text;
    const lg_term_kind *row = lg_term_kind_find(part, *out);
    if (row != NULL && (lg_term_kind_options(row) & LG_TERM_VALUES) != 0) return LG_OK;
    return LG_FAULT(r, values[KEY_FORM].line,
                    "form: '%.40s' is unknown; expected linear, quadratic, polynomial or gravity", *out);
}

static lg_status read_mapping(reading *r, lg_machine_part part, const yaml_node_t *node) {
    lg_key_value values[KEY_COUNT] = {{.line = 0}};
    const char *kind = NULL;
    lg_machine_term *term = NULL;
    LG_TRY(LG_READ_MAP(r, node, keys, values, lg_machine_part_name(part)));
    LG_TRY(kind_of(r, part, values, &kind));
    if (strcmp(kind, "none") == 0) {
        LG_TRY(check_keys(r, part, kind, 0, values));
    } else {
        LG_TRY(add_term(r, part, values[KEY_KIND].line, kind, &term));
        LG_TRY(check_keys(r, part, kind, lg_term_kind_options(term->kind), values));
        LG_TRY(fill_term(r, term, values));
    }
    return add_friction(r, values);
}

/* Adds the offset of a coordinate to the term of the names before it. */
static lg_status add_offset(reading *r, uint32_t line, const char *text) {
    lg_machine *m = &r->out->machine;
    lg_machine_feature feature;
    lg_machine_term *term = m->term_count > 0 ? &m->terms[m->term_count - 1] : NULL;
    if (!find_coordinate(m, text, &feature) && !find_column(r->out, LG_MACHINE_OFFSET, text, &feature))
        return LG_FAULT(r, line, "offset: '%.40s' is neither a kind (unknown, known) nor a coordinate", text);
    if (term == NULL || term->part != LG_MACHINE_OFFSET || term->of_count == 0 || term->value_count > 0)
        LG_TRY(add_term(r, LG_MACHINE_OFFSET, line, "unknown", &term));
    return add_feature(r, line, text, term);
}

static lg_status read_word(reading *r, uint32_t line, const char *text, void *user) {
    lg_machine_term *term = NULL;
    const lg_machine_part part = *(const lg_machine_part *)user;
    if (strcmp(text, "none") == 0) return LG_OK;
    if (part == LG_MACHINE_POTENTIAL && strcmp(text, "known") == 0)
        return LG_FAULT(r, line,
                        "potential: for kind known, give {kind: known, form: ..., of: [...], values: ...}");
    if (part == LG_MACHINE_OFFSET && lg_term_kind_find(part, text) == NULL) return add_offset(r, line, text);
    return add_term(r, part, line, text, &term);
}

static lg_status read_one(reading *r, lg_machine_part part, const yaml_node_t *node) {
    if (node->type == YAML_MAPPING_NODE) return read_mapping(r, part, node);
    if (node->type == YAML_SCALAR_NODE)
        return lg_machine_texts(r, node, lg_machine_part_name(part), read_word, &part);
    return LG_FAULT(r, lg_node_line(node), "%s: expected {kind: ...}, a list of these, or the name of a kind",
                    lg_machine_part_name(part));
}

lg_status lg_machine_read_terms(reading *r, lg_machine_part part, const lg_key_value *value) {
    lg_machine_term *term = NULL;
    const lg_machine *machine = &r->out->machine;
    const bool constant = (part == LG_MACHINE_MASS && machine->grey.system == NULL) ||
                          (part == LG_MACHINE_INPUT_MAP && machine->input_count > 0);
    if (value->line == 0) return constant ? add_term(r, part, 0, "constant", &term) : LG_OK;
    const yaml_node_t *node = value->node;
    if (lg_node_items(node) == 0)
        return LG_FAULT(r, value->line, "%s: the list is empty", lg_machine_part_name(part));
    for (size_t i = 0; i < lg_node_items(node); i++)
        LG_TRY(read_one(r, part, lg_node_item(r->yaml, node, i)));
    return LG_OK;
}

/* ---- terms of changes ---- */

static void drop_term(reading *r, uint32_t at) {
    lg_machine *m = &r->out->machine;
    const size_t after = --m->term_count - at;
    memmove(&m->terms[at], &m->terms[at + 1], after * sizeof *m->terms);
    memmove(&r->lines[at], &r->lines[at + 1], after * sizeof *r->lines);
}

/* Moves a term to an index before its own. */
static void move_term(reading *r, uint32_t from, uint32_t to) {
    lg_machine *m = &r->out->machine;
    const lg_machine_term term = m->terms[from];
    const uint32_t line = r->lines[from];
    memmove(&m->terms[to + 1], &m->terms[to], (from - to) * sizeof term);
    memmove(&r->lines[to + 1], &r->lines[to], (from - to) * sizeof line);
    m->terms[to] = term;
    r->lines[to] = line;
}

/* Whether `term` has the monomials of the learned term `old`, of the same coordinates. */
static bool contains(const lg_machine_term *term, const lg_machine_term *old) {
    return old->part == term->part && old->kind->most > 0 && old->value_count == 0 && term->of_count > 0 &&
           term->kind->least <= old->kind->least && term->degree >= old->kind->most &&
           old->of_count == term->of_count &&
           memcmp(old->of, term->of, term->of_count * sizeof *term->of) == 0;
}

void lg_machine_settle_terms(reading *r, uint32_t before) {
    const lg_machine *m = &r->out->machine;
    for (uint32_t i = before; i < m->term_count; i++) {
        uint32_t old = 0, to = i;
        while (to > 0 && m->terms[to - 1].part > m->terms[i].part) to--;
        while (old < i && !contains(&m->terms[i], &m->terms[old])) old++;
        move_term(r, i, old < i ? old : to);
        if (old < i) drop_term(r, old + 1), i--;
    }
}

void lg_machine_drop_actuators(reading *r, bool lags, bool curves) {
    const lg_machine *m = &r->out->machine;
    for (uint32_t i = m->term_count; i-- > 0;)
        if (m->terms[i].part == LG_MACHINE_ACTUATOR && (m->terms[i].kind->lag != NULL ? lags : curves))
            drop_term(r, i);
}
