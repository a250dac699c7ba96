/* Reads machines from YAML: coordinates, columns of logs, inputs. terms.c reads the terms. */
#include <float.h>
#include <stdio.h>
#include <string.h>

#include "files/h5.h"
#include "machine/files/reading.h"
#include "machine/files/recipe.h"

typedef lg_machine_reading reading;

/* ---- names ---- */

static const char *name_kind(uint32_t value) {
    const lg_coordinate_row *row = lg_coordinate_row_of((lg_coordinate_kind)value);
    return row != NULL ? row->name : NULL;
}

/* ---- keys ---- */

enum {
    KEY_COLUMNS,
    KEY_TIME,
    KEY_RUN,
    KEY_MAX_STEP,
    KEY_COORDINATES,
    KEY_INPUTS,
    KEY_INPUT_COLUMNS,
    KEY_HOLD,
    KEY_DELAY,
    KEY_LAG,
    KEY_CURVE,
    KEY_MEASURED,
    KEY_NOISE,
    KEY_SCALE,
    KEY_UNWRAP,
    KEY_SYSTEM,
    KEY_FORM,
    KEY_PARAMETERS,
    KEY_PARTS, /* one key per part, in the order of lg_machine_part, but actuators, which `inputs` has */
    KEY_HIDDEN = KEY_PARTS + LG_MACHINE_ACTUATOR,
    KEY_COUNT
};

static const lg_field keys[KEY_COUNT] = {
    [KEY_COLUMNS] = LG_MAP("columns"),
    [KEY_TIME] = {.name = "columns.time", .type = LG_FIELD_TEXT},
    [KEY_RUN] = {.name = "columns.run", .type = LG_FIELD_TEXT},
    [KEY_MAX_STEP] =
        LG_FIELD(lg_machine_file, NULL, "columns.max_step", REAL, max_step, .above = true, .high = DBL_MAX),
    [KEY_COORDINATES] = LG_NODE("coordinates", .required = true),
    [KEY_INPUTS] = LG_MAP("inputs"),
    [KEY_INPUT_COLUMNS] = LG_NODE("inputs.columns", .required = true),
    [KEY_HOLD] = LG_NODE("inputs.hold"),
    [KEY_DELAY] = LG_NODE("inputs.delay"),
    [KEY_LAG] = LG_NODE("inputs.lag"),
    [KEY_CURVE] = LG_NODE("inputs.curve"),
    [KEY_MEASURED] =
        LG_FIELD(lg_machine_file, NULL, "measured", NAME, measured,
                 LG_NAMES("velocities", "momenta", "positions", "velocities-only", "accelerations")),
    [KEY_NOISE] = LG_NODE("noise"),
    [KEY_SCALE] = LG_NODE("scale"),
    [KEY_UNWRAP] = LG_FIELD(lg_machine_file, NULL, "unwrap", NAME, unwrap, LG_NAMES("false", "true")),
    [KEY_SYSTEM] = {.name = "system", .type = LG_FIELD_TEXT},
    [KEY_FORM] = {.name = "form", .type = LG_FIELD_TEXT},
    [KEY_PARAMETERS] = LG_NODE("parameters"),
    [KEY_PARTS + LG_MACHINE_MASS] = LG_NODE("mass"),
    [KEY_PARTS + LG_MACHINE_POTENTIAL] = LG_NODE("potential"),
    [KEY_PARTS + LG_MACHINE_DAMPING] = LG_NODE("damping"),
    [KEY_PARTS + LG_MACHINE_INPUT_MAP] = LG_NODE("input_map"),
    [KEY_PARTS + LG_MACHINE_RESIDUAL] = LG_NODE("residual"),
    [KEY_PARTS + LG_MACHINE_BIAS] = LG_NODE("bias"),
    [KEY_PARTS + LG_MACHINE_OFFSET] = LG_NODE("offset"),
    [KEY_HIDDEN] = LG_KEY_HIDDEN,
};

enum {
    OF_NAME,
    OF_KIND,
    OF_COLUMNS,
    OF_POSITION,
    OF_VELOCITY,
    OF_ACCELERATION,
    OF_RATES,
    OF_FRAME,
    OF_COUNT
};
static const lg_field coordinate_keys[OF_COUNT] = {
    [OF_NAME] = {.name = "name", .type = LG_FIELD_TEXT, .required = true},
    [OF_KIND] = {.name = "kind",
                 .type = LG_FIELD_NAME,
                 .required = true,
                 .value_name = name_kind,
                 .hint = "; a state without inertia (a tank, a temperature) is no coordinate: learn it with "
                         "lg-fit, or with a program of your own such as examples/own_ode"},
    [OF_COLUMNS] = LG_NODE("columns"),
    [OF_POSITION] = LG_NODE("position"),
    [OF_VELOCITY] = LG_NODE("velocity"),
    [OF_ACCELERATION] = LG_NODE("acceleration"),
    [OF_RATES] = LG_NODE("rates"),
    [OF_FRAME] = LG_FIELD(lg_log_coordinate, NULL, "frame", NAME, space_frame, LG_NAMES("body", "space")),
};

/* Number of columns that each key of a coordinate takes: `count` or `other`; count 0: the key is not
 * allowed. */
static const struct {
    uint32_t count, other;
} takes[LG_COORDINATE_KIND_COUNT][OF_COUNT] = {
    [LG_COORDINATE_LINE] = {[OF_COLUMNS] = {1, 1}, [OF_VELOCITY] = {1, 1}, [OF_ACCELERATION] = {1, 1}},
    [LG_COORDINATE_ANGLE] = {[OF_COLUMNS] = {1, 1}, [OF_VELOCITY] = {1, 1}, [OF_ACCELERATION] = {1, 1}},
    [LG_COORDINATE_DIRECTION] = {[OF_COLUMNS] = {3, 3}, [OF_VELOCITY] = {3, 3}},
    [LG_COORDINATE_ROTATION] = {[OF_COLUMNS] = {4, 9}, [OF_VELOCITY] = {3, 3}},
    [LG_COORDINATE_POSE] =
        {[OF_COLUMNS] = {4, 9}, [OF_POSITION] = {3, 3}, [OF_VELOCITY] = {3, 3}, [OF_RATES] = {3, 3}},
};

/* ---- nodes ---- */

static lg_status visit_text(reading *r, const yaml_node_t *node, const char *what, lg_text_visit visit,
                            void *user) {
    char text[LG_LOG_NAME];
    const bool scalar = node->type == YAML_SCALAR_NODE;
    const size_t length = scalar ? node->data.scalar.length : 0;
    if (length == 0 || length >= sizeof text || memchr(node->data.scalar.value, '\0', length) != NULL)
        return LG_FAULT(r, lg_node_line(node), "%s: expected a name of 1 to %zu bytes", what,
                        sizeof text - 1);
    memcpy(text, node->data.scalar.value, length);
    text[length] = '\0';
    for (const char *c = text; *c != '\0'; c++)
        if ((unsigned char)*c < ' ' || *c == '\x7f')
            return LG_FAULT(r, lg_node_line(node), "%s: a name has a control character", what);
    return visit(r, lg_node_line(node), text, user);
}

lg_status lg_machine_texts(reading *r, const void *node, const char *what, lg_text_visit visit, void *user) {
    for (size_t i = 0; i < lg_node_items(node); i++)
        LG_TRY(visit_text(r, lg_node_item(r->yaml, node, i), what, visit, user));
    return LG_OK;
}

/* ---- columns ---- */

/* Role of the columns that are added, and index of their coordinate or input. */
typedef struct adding {
    lg_log_role role;
    uint32_t index;
} adding;

static lg_log_column *find_column(lg_machine_file *out, const char *name) {
    for (uint32_t i = 0; i < out->column_count; i++)
        if (strcmp(out->columns[i].name, name) == 0) return &out->columns[i];
    return NULL;
}

static lg_status add_column(reading *r, uint32_t line, const char *name, void *user) {
    const adding *what = user;
    lg_machine_file *out = r->out;
    if (find_column(out, name) != NULL) return LG_FAULT(r, line, "column '%s' is used twice", name);
    if (out->column_count == LG_LOG_COLUMNS) return LG_FAULT(r, line, "more than %d columns", LG_LOG_COLUMNS);
    lg_log_column *column = &out->columns[out->column_count++];
    *column = (lg_log_column){.role = what->role, .index = what->index, .scale = 1};
    memcpy(column->name, name, strlen(name) + 1);
    return LG_OK;
}

static lg_status add_named(reading *r, const lg_key_value *value, const char *fallback, lg_log_role role) {
    adding what = {role, 0};
    const char *name = value->line != 0 ? value->text : fallback;
    if (strlen(name) >= LG_LOG_NAME)
        return LG_FAULT(r, value->line, "the name of a column has at most %d bytes", LG_LOG_NAME - 1);
    return add_column(r, value->line, name, &what);
}

/* ---- coordinates ---- */

/* Letters, digits, _ and -. A name has no dot, because a dot separates the suffix in NAME.up. YAML refuses
 * empty names. */
static bool is_name(const char *text) {
    if (strlen(text) >= LG_MACHINE_NAME) return false;
    for (; *text != '\0'; text++) {
        const bool letter = (*text >= 'a' && *text <= 'z') || (*text >= 'A' && *text <= 'Z');
        if (!letter && !(*text >= '0' && *text <= '9') && *text != '_' && *text != '-') return false;
    }
    return true;
}

/* Refuses keys that do not belong to the kind of coordinate. */
static lg_status check_keys(reading *r, lg_coordinate_kind kind, const lg_key_value *values) {
    for (int k = OF_COLUMNS; k <= OF_RATES; k++) {
        if (values[k].line != 0 && takes[kind][k].count == 0)
            return LG_FAULT(r, values[k].line, "%s: a coordinate of kind %s does not take this key",
                            coordinate_keys[k].name, name_kind(kind));
    }
    if (values[OF_FRAME].line != 0 && kind != LG_COORDINATE_POSE)
        return LG_FAULT(r, values[OF_FRAME].line,
                        "frame: only poses take this key; the rates of a rotation are in the body frame, "
                        "the rates of a direction in the space frame");
    return LG_OK;
}

/* Reads the columns of one key of a coordinate. Without a key, a line or angle has its position in the column
 * of its own name. */
static lg_status read_columns(reading *r, int k, uint32_t line, const lg_key_value *value, lg_log_role role,
                              uint32_t *first, uint32_t *count) {
    lg_machine_file *out = r->out;
    const lg_machine_coordinate *c = &out->machine.coordinates[out->machine.coordinate_count];
    const uint32_t expected = takes[c->kind][k].count, other = takes[c->kind][k].other;
    adding what = {role, out->machine.coordinate_count};
    *first = out->column_count;
    *count = 0;
    if (expected == 0) return LG_OK;
    if (value->line == 0 && k == OF_COLUMNS && expected == 1)
        LG_TRY(add_column(r, line, c->name, &what));
    else if (value->line == 0)
        return LG_FAULT(r, line, "%s: key '%s' is missing: it names %u column%s%s", c->name,
                        coordinate_keys[k].name, expected, expected == 1 ? "" : "s",
                        other != expected ? " (w, x, y, z) or 9 (the matrix, row by row)" : "");
    else
        LG_TRY(lg_machine_texts(r, value->node, coordinate_keys[k].name, add_column, &what));
    *count = out->column_count - *first;
    if (*count == expected || *count == other) return LG_OK;
    return LG_FAULT(r, value->line, "%s: %s: has %u columns, expected %u%s", c->name, coordinate_keys[k].name,
                    *count, expected, other != expected ? " (w, x, y, z) or 9 (the matrix, row by row)" : "");
}

/* Reads the columns of a coordinate's positions. */
static lg_status read_positions(reading *r, uint32_t line, const lg_key_value *values, lg_log_coordinate *c) {
    const lg_machine *m = &r->out->machine;
    const bool attitude = takes[m->coordinates[m->coordinate_count].kind][OF_COLUMNS].count > 1;
    if (r->out->measured >= LG_MEASURED_VELOCITIES_ONLY) {
        if (values[OF_COLUMNS].line == 0 && values[OF_POSITION].line == 0) return LG_OK;
        return LG_FAULT(r, line, "columns of positions are not allowed with `measured: %s`",
                        lg_field_name(&keys[KEY_MEASURED], r->out->measured));
    }
    LG_TRY(read_columns(r, OF_POSITION, line, &values[OF_POSITION], LG_LOG_POSITION, &c->place, &c->places));
    return read_columns(r, OF_COLUMNS, line, &values[OF_COLUMNS], LG_LOG_POSITION,
                        attitude ? &c->attitude : &c->place, attitude ? &c->attitudes : &c->places);
}

/* Reads the columns of a coordinate's velocities, including a pose's rates. */
static lg_status read_velocities(reading *r, uint32_t line, const lg_key_value *values,
                                 lg_log_coordinate *c) {
    const lg_log_measured measured = r->out->measured;
    const bool accelerations = measured == LG_MEASURED_ACCELERATIONS;
    const int shown = accelerations ? OF_ACCELERATION : OF_VELOCITY;
    for (int k = OF_VELOCITY; k <= OF_ACCELERATION; k++)
        if (k != shown && values[k].line != 0)
            return LG_FAULT(r, values[k].line, "%s: this key is not allowed with `measured: %s`",
                            coordinate_keys[k].name, lg_field_name(&keys[KEY_MEASURED], measured));
    if (measured != LG_MEASURED_POSITIONS) {
        uint32_t rates = 0, first;
        LG_TRY(read_columns(r, shown, line, &values[shown], LG_LOG_VELOCITY, &c->velocity, &c->velocities));
        LG_TRY(read_columns(r, OF_RATES, line, &values[OF_RATES], LG_LOG_VELOCITY, &first, &rates));
        c->velocities += rates;
        return LG_OK;
    }
    for (int k = OF_VELOCITY; k <= OF_FRAME; k++)
        if (values[k].line != 0)
            return LG_FAULT(r, values[k].line, "%s: this key is not allowed with `measured: positions`",
                            coordinate_keys[k].name);
    return LG_OK;
}

static lg_status read_coordinate(reading *r, const yaml_node_t *node) {
    lg_key_value values[OF_COUNT] = {{.line = 0}};
    lg_machine *m = &r->out->machine;
    const uint32_t line = lg_node_line(node), i = m->coordinate_count;
    if (i == LG_MACHINE_COORDINATES)
        return LG_FAULT(r, line, "more than %d coordinates", LG_MACHINE_COORDINATES);
    LG_TRY(LG_READ_MAP(r, node, coordinate_keys, values, "coordinates"));
    lg_log_coordinate *c = &r->out->coordinates[i];
    const char *name = values[OF_NAME].text;
    if (!is_name(name))
        return LG_FAULT(r, values[OF_NAME].line, "name: expected 1 to %d letters, digits, _ and -",
                        LG_MACHINE_NAME - 1);
    for (uint32_t k = 0; k < i; k++)
        if (strcmp(m->coordinates[k].name, name) == 0)
            return LG_FAULT(r, values[OF_NAME].line, "name: two coordinates have the name '%s'", name);
    memcpy(m->coordinates[i].name, name, strlen(name) + 1);
    const lg_coordinate_kind kind = m->coordinates[i].kind = (lg_coordinate_kind)values[OF_KIND].real[0];
    LG_TRY(check_keys(r, kind, values));
    LG_TRY(read_positions(r, line, values, c));
    LG_TRY(read_velocities(r, line, values, c));
    m->coordinate_count++;
    return lg_yaml_store(r->yaml, coordinate_keys, values, OF_COUNT, c, r->error);
}

/* ---- inputs ---- */

static lg_status add_input(reading *r, uint32_t line, const char *name, void *user) {
    lg_machine *m = &r->out->machine;
    adding what = {LG_LOG_INPUT, m->input_count};
    if (m->input_count == LG_MACHINE_INPUTS)
        return LG_FAULT(r, line, "more than %d inputs", LG_MACHINE_INPUTS);
    if (strlen(name) >= LG_MACHINE_NAME)
        return LG_FAULT(r, line, "the name of an input has at most %d bytes", LG_MACHINE_NAME - 1);
    for (uint32_t i = 0; i < m->coordinate_count; i++)
        if (strcmp(m->coordinates[i].name, name) == 0)
            return LG_FAULT(r, line, "input '%s' has the name of a coordinate: rename the coordinate", name);
    LG_TRY(add_column(r, line, name, &what));
    memcpy(m->inputs[m->input_count++], name, strlen(name) + 1);
    return LG_OK;
}

/* ---- numbers of columns ---- */

/* Reads a map from columns to numbers, like {x: 0.1}, into the member of lg_log_column at `offset`. */
static lg_status read_numbers(reading *r, const lg_field *key, const lg_key_value *value, size_t offset,
                              double low) {
    const yaml_node_t *map = value->node;
    const yaml_node_pair_t *pair = NULL;
    bool seen[LG_LOG_COLUMNS] = {false};
    if (value->line == 0) return LG_OK;
    if (map->type != YAML_MAPPING_NODE)
        return LG_FAULT(r, value->line, "%s: expected {COLUMN: number}", key->name);
    for (pair = map->data.mapping.pairs.start; pair < map->data.mapping.pairs.top; pair++) {
        const yaml_node_t *name = lg_node_at(r->yaml, pair->key), *number = lg_node_at(r->yaml, pair->value);
        lg_log_column *column = name->type == YAML_SCALAR_NODE
                                    ? find_column(r->out, (const char *)name->data.scalar.value)
                                    : NULL;
        if (column == NULL)
            return LG_FAULT(r, lg_node_line(name), "%s: '%.40s' is not a column of this machine", key->name,
                            name->type == YAML_SCALAR_NODE ? (const char *)name->data.scalar.value : "?");
        if (seen[column - r->out->columns])
            return LG_FAULT(r, lg_node_line(name), "%s: column '%s' is given twice", key->name, column->name);
        seen[column - r->out->columns] = true;
        double *out = (double *)((char *)column + offset);
        const lg_field one = {.name = column->name, .above = true, .low = low, .high = DBL_MAX};
        const lg_key_value at = {.line = lg_node_line(number), .node = number};
        LG_TRY(lg_yaml_block(r->yaml, &one, &at, (const size_t[3]){1, 1, 1}, out, NULL, r->error));
        if (*out == 0)
            return LG_FAULT(r, lg_node_line(number), "%s: %s: the number must not be 0", key->name,
                            column->name);
    }
    return LG_OK;
}

/* ---- dependence on positions ---- */

/* A potential that is linear in a line: a constant force, wherever the line is. */
static bool is_constant_force(const lg_machine *machine, const lg_machine_term *term, uint32_t coordinate) {
    const char *name = lg_term_kind_name(term->kind);
    const bool linear = strcmp(name, "linear") == 0 || strcmp(name, "gravity") == 0;
    return term->part == LG_MACHINE_POTENTIAL && linear &&
           machine->coordinates[coordinate].kind == LG_COORDINATE_LINE;
}

/* Whether feature k of a term is a position on which the term depends. */
static bool uses(const lg_machine *machine, const lg_machine_term *term, uint32_t k) {
    const lg_machine_feature of = term->of[k];
    return term->part != LG_MACHINE_OFFSET && of.kind != LG_FEATURE_VELOCITY && of.kind != LG_FEATURE_INPUT &&
           !is_constant_force(machine, term, of.index);
}

bool lg_machine_sees_position(const lg_machine *machine, uint32_t coordinate) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        for (uint32_t k = 0; k < term->of_count; k++)
            if (term->of[k].index == coordinate && uses(machine, term, k)) return true;
    return false;
}

/* Logs that measure velocities alone, a drive's speed: nothing may depend on positions. */
static lg_status refuse_positions(reading *r) {
    const lg_machine *machine = &r->out->machine;
    if (r->out->measured != LG_MEASURED_VELOCITIES_ONLY) return LG_OK;
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (machine->coordinates[i].kind > LG_COORDINATE_ANGLE)
            return LG_FAULT(r, 1, "%s: with `measured: velocities-only` a coordinate is a line or an angle",
                            machine->coordinates[i].name);
    if (machine->grey.system != NULL) /* all systems of lines and angles have a potential */
        return LG_FAULT(r, 1,
                        "system: %s depends on positions, but the log has velocities alone: log the "
                        "positions too",
                        machine->grey.system->name);
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        for (uint32_t k = 0; k < term->of_count; k++)
            if (uses(machine, term, k))
                return LG_FAULT(
                    r, r->lines[term - machine->terms],
                    "%s: depends on the position of %s, but the log has velocities alone: log the "
                    "position too, or leave this out",
                    lg_machine_part_name(term->part), machine->coordinates[term->of[k].index].name);
    return LG_OK;
}

/* ---- the file ---- */

static lg_status finish_machine(reading *r) {
    lg_error inner = {LG_OK, ""};
    lg_machine *m = &r->out->machine;
    lg_machine_scales_init(&m->scales);
    const lg_status status = lg_machine_init(m, &inner);
    if (status == LG_OK) return LG_OK;
    for (uint32_t i = 0; i < m->term_count && status == LG_INVALID_ARGUMENT; i++) {
        char name[64]; /* a sentence about a term begins with it, "mass of kind known: ..." */
        (void)snprintf(name, sizeof name, "%s of kind %s:", lg_machine_part_name(m->terms[i].part),
                       lg_term_kind_name(m->terms[i].kind));
        if (strncmp(inner.message, name, strlen(name)) != 0) continue;
        if (r->lines[i] > 0) return LG_FAULT(r, r->lines[i], "%s", inner.message);
        break;
    }
    return lg_fail(r->error, status == LG_INVALID_ARGUMENT ? LG_FORMAT : status, "%s: %s",
                   lg_shown_path(lg_yaml_path(r->yaml)), inner.message);
}

static lg_status read_machine(reading *r, lg_key_value *values) {
    const lg_key_set set = {keys, KEY_HIDDEN, values};
    lg_machine_file *out = r->out;
    LG_TRY(lg_yaml_read(r->yaml, &set, 1, NULL, "", r->error));
    out->unwrap = true;
    LG_TRY(lg_yaml_store(r->yaml, keys, values, KEY_HIDDEN, out, r->error));
    out->machine.accelerations = out->measured == LG_MEASURED_ACCELERATIONS;
    LG_TRY(add_named(r, &values[KEY_TIME], "t", LG_LOG_TIME));
    if (values[KEY_RUN].line != 0) LG_TRY(add_named(r, &values[KEY_RUN], "", LG_LOG_RUN));
    const yaml_node_t *list = values[KEY_COORDINATES].node;
    if (list->type != YAML_SEQUENCE_NODE || lg_node_items(list) == 0)
        return LG_FAULT(r, values[KEY_COORDINATES].line,
                        "coordinates: expected a list of {name: ..., kind: ...}");
    for (size_t i = 0; i < lg_node_items(list); i++)
        LG_TRY(read_coordinate(r, lg_node_item(r->yaml, list, i)));
    if (values[KEY_INPUTS].line != 0) {
        LG_TRY(lg_machine_texts(r, values[KEY_INPUT_COLUMNS].node, "inputs.columns", add_input, NULL));
        LG_TRY(lg_machine_read_timing(r, &values[KEY_HOLD], &values[KEY_DELAY]));
    }
    LG_TRY(read_numbers(r, &keys[KEY_NOISE], &values[KEY_NOISE], offsetof(lg_log_column, noise), 0));
    LG_TRY(read_numbers(r, &keys[KEY_SCALE], &values[KEY_SCALE], offsetof(lg_log_column, scale), -DBL_MAX));
    out->run = values[KEY_RUN].line != 0 ? 1 : out->column_count;
    LG_TRY(lg_machine_read_system(r, &values[KEY_SYSTEM], &values[KEY_FORM], &values[KEY_PARAMETERS]));
    for (int part = 0; part < LG_MACHINE_ACTUATOR; part++)
        LG_TRY(lg_machine_read_terms(r, (lg_machine_part)part, &values[KEY_PARTS + part]));
    return lg_machine_read_actuators(r, &values[KEY_LAG], &values[KEY_CURVE]);
}

/* Reads a document behind the first one: how inputs act, further terms, and the widths of all networks. */
static lg_status read_change(reading *r, lg_key_value *values) {
    const lg_key_set sets[] = {{keys + KEY_INPUTS, 1, values + KEY_INPUTS},
                               {keys + KEY_HOLD, KEY_CURVE + 1 - KEY_HOLD, values + KEY_HOLD},
                               {keys + KEY_PARTS, KEY_COUNT - KEY_PARTS, values + KEY_PARTS}};
    lg_machine *machine = &r->out->machine;
    const uint32_t before = machine->term_count;
    LG_TRY(lg_yaml_read(r->yaml, sets, LG_COUNT(sets), NULL, "", r->error));
    LG_TRY(lg_machine_read_timing(r, &values[KEY_HOLD], &values[KEY_DELAY]));
    for (int part = 0; part < LG_MACHINE_ACTUATOR; part++)
        if (values[KEY_PARTS + part].line != 0)
            LG_TRY(lg_machine_read_terms(r, (lg_machine_part)part, &values[KEY_PARTS + part]));
    lg_machine_settle_terms(r, before);
    lg_machine_drop_actuators(r, values[KEY_LAG].line != 0, values[KEY_CURVE].line != 0);
    for (uint32_t i = 0; i < machine->term_count && values[KEY_HIDDEN].line != 0; i++)
        lg_machine_set_widths(&values[KEY_HIDDEN], &machine->terms[i]);
    return lg_machine_read_actuators(r, &values[KEY_LAG], &values[KEY_CURVE]);
}

lg_status lg_machine_file_parse(const lg_context *context, const char *name, const char *text, size_t bytes,
                                lg_machine_file *out, lg_error *error) {
    LG_NEEDS(error, name, text, out);
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    LG_TRY(lg_yaml_open_several(context, name, text, bytes, &yaml, error));
    LG_SCRATCH(lg_machine_file, made, context, 1);
    LG_SCRATCH(lg_key_value, values, context, KEY_COUNT);
    LG_SCRATCH(char, copy, context, bytes + 1);
    reading r = {.yaml = yaml, .out = made, .error = error};
    if (made == NULL || values == NULL || copy == NULL) return lg_no_memory_for(name, error);
    LG_TRY(read_machine(&r, values));
    for (bool more;;) {
        LG_TRY(lg_yaml_next(yaml, &more, error));
        if (!more) break;
        LG_TRY(read_change(&r, values));
    }
    LG_TRY(refuse_positions(&r));
    LG_TRY(finish_machine(&r));
    *out = *made;
    out->context = context;
    out->text = memcpy(LG_KEEP(copy), text, bytes);
    out->text_bytes = bytes;
    return LG_OK;
}

lg_status lg_machine_file_read(const lg_context *context, const char *path, lg_machine_file *out,
                               lg_error *error) {
    unsigned char *data = NULL;
    size_t bytes = 0;
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the place for the machine is NULL");
    LG_TRY(lg_yaml_bytes(context, path, &data, &bytes, error));
    const lg_status status = lg_machine_file_parse(context, path, (const char *)data, bytes, out, error);
    lg_free(context, data);
    return status;
}

void lg_machine_file_destroy(lg_machine_file *file) {
    if (file == NULL) return;
    lg_free(file->context, file->text);
    file->text = NULL;
    file->text_bytes = 0;
}
