/* Reads the task of a policy from YAML. Coordinates and inputs are known from the plant; the file names
 * them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "control/policy.h"
#include "core/text.h"
#include "settings/files/yaml.h"

typedef struct reading {
    lg_yaml *yaml;
    lg_policy_task *task;
    lg_error *error;
} reading;

/* ---- keys ---- */

#define FIELD(name, type, member, ...) LG_FIELD(lg_policy_task, NULL, name, type, member, __VA_ARGS__)
static const lg_field keys[] = {
    {.name = "plant", .type = LG_FIELD_TEXT, .required = true},
    LG_NODE("states"),
    LG_NODE("goal"),
    FIELD("period", REAL, period, .required = true, LG_POSITIVE),
    FIELD("horizon", REAL, horizon, .required = true, LG_POSITIVE),
    LG_NODE("starts", .required = true),
    LG_NODE("limits", .required = true),
    LG_NODE("cost", .required = true),
    LG_NODE("success", .required = true),
    FIELD("substeps", U32, substeps, .low = 1, .high = LG_POLICY_SUBSTEPS),
    LG_MAP("controller"),
    FIELD("controller.kind", NAME, kind, LG_NAMED(lg_policy_kind_name, LG_POLICY_KIND_COUNT)),
    FIELD("controller.hidden", WHOLES, hidden, LG_COUNTED(lg_policy_task, hidden_layers), .low = 1,
          .high = 4096, .most = LG_POLICY_HIDDEN),
    FIELD("controller.gate", NAME, gate, LG_NAMES("none", "lqr")),
    FIELD("controller.gains", REALS, gains, LG_COUNTED(lg_policy_task, gain_count), LG_ANY_REAL,
          .most = LG_POLICY_GAINS),
    LG_MAP("robust"),
    FIELD("robust.draws", U32, draws, .high = 1000),
    FIELD("robust.spread", REAL, spread, .high = 10),
    FIELD("robust.delay", REAL, delay, .high = 1),
    LG_NODE("robust.noise"),
    LG_NODE("track"),
    LG_NODE("free"),
    LG_NODE("integral"),
    FIELD("compensate", NAME, compensate, LG_NAMES("false", "true")),
};
enum { KEYS = LG_COUNT(keys) };

/* ---- mappings from names to numbers ---- */

static lg_status read_number(const reading *r, const yaml_node_t *node, const char *what, double *out) {
    if (node->type == YAML_SCALAR_NODE &&
        lg_number_parse((const char *)node->data.scalar.value, out) == LG_OK)
        return LG_OK;
    return LG_FAIL_AT(r->yaml, node, r->error, "%s: expected a finite number", what);
}

enum { MOST_NUMBERS = 9 };

/* A number, or a list of numbers. */
static lg_status read_numbers(const reading *r, const yaml_node_t *node, const char *what, double *out,
                              uint32_t *count) {
    *count = 1;
    if (node->type != YAML_SEQUENCE_NODE) return read_number(r, node, what, out);
    *count = (uint32_t)lg_node_length(node);
    if (*count > MOST_NUMBERS)
        return LG_FAIL_AT(r->yaml, node, r->error, "%s: more than %d numbers", what, MOST_NUMBERS);
    for (uint32_t i = 0; i < *count; i++)
        LG_TRY(read_number(r, lg_node_item(r->yaml, node, i), what, out + i));
    return LG_OK;
}

/* What the name of an entry stands for. */
typedef struct named {
    lg_policy_coordinate *coordinate; /* NULL: none */
    bool velocity;
    lg_policy_input *input; /* NULL: none */
} named;

static named find_name(lg_policy_task *task, const char *name) {
    char usual[LG_POLICY_NAME + 1];
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        lg_policy_coordinate *c = &task->coordinate[i];
        (void)snprintf(usual, sizeof usual, "v%s", c->name);
        if (strcmp(name, c->name) == 0) return (named){c, false, NULL};
        if (c->velocity[0] != '\0' && (strcmp(name, c->velocity) == 0 || strcmp(name, usual) == 0))
            return (named){c, true, NULL};
    }
    for (uint32_t l = 0; l < task->input_count; l++)
        if (strcmp(name, task->input[l].name) == 0) return (named){NULL, false, &task->input[l]};
    return (named){NULL, false, NULL};
}

/* What an entry of a mapping is: where its numbers go, in a coordinate (positions, velocities) and an
 * input; 0: it may not be there. */
typedef struct entries {
    const char *what; /* the key */
    size_t position, velocity, input;
    bool range, positive;          /* low and high; one number above 0, or not below it */
    const char *expected, *lagged; /* lagged: the same for lagged inputs; NULL: they have such numbers, too */
} entries;

#define OF(member)    offsetof(lg_policy_coordinate, member)
#define INPUT(member) offsetof(lg_policy_input, member)
static const entries mappings[] = {
    {.what = "goal", .lagged = "a coordinate of the machine; a lagged input has no goal to choose"},
    {"starts", OF(start), OF(start_velocity), 0, true, false, "[low, high], or one number", NULL},
    {"limits", 0, 0, INPUT(low), true, true, "[low, high], or one number above 0 for both sides", NULL},
    {"cost", OF(weight), OF(weight_velocity), INPUT(weight), false, false, "a weight, not below 0", NULL},
    {"success", OF(success), OF(success_velocity), 0, false, true, "a number above 0",
     "a coordinate of the machine, not a lagged input"},
    {"robust.noise", OF(noise), OF(noise_velocity), 0, false, false, "a standard deviation, not below 0",
     "a coordinate of the machine: no sensor measures a lagged input"}};
#undef OF
#undef INPUT

static lg_status unknown(const reading *r, const yaml_node_t *key, const char *what, const char *name) {
    lg_name_list known = {.used = 0};
    const lg_policy_task *t = r->task;
    for (uint32_t i = 0; i < t->coordinate_count; i++) lg_name_list_add(&known, t->coordinate[i].name);
    for (uint32_t i = 0; i < t->coordinate_count; i++)
        if (t->coordinate[i].velocity[0] != '\0') lg_name_list_add(&known, t->coordinate[i].velocity);
    for (uint32_t l = 0; l < t->input_count; l++) lg_name_list_add(&known, t->input[l].name);
    return LG_FAIL_AT(r->yaml, key, r->error, "%s: unknown name '%.40s'; the plant has %s", what, name,
                      known.text);
}

/* ---- the entries of each key ---- */

static bool unit_vector(const double *x, uint32_t n) {
    double sum = 0.0;
    for (uint32_t i = 0; i < n; i++) sum += x[i] * x[i];
    return fabs(sum - 1.0) < 1e-3;
}

static void rotation_of(const double *q, double *R) {
    const double n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], w = q[0], x = q[1], y = q[2],
                 z = q[3];
    const double of[9] = {
        w * w + x * x - y * y - z * z, 2 * (x * y - w * z),           2 * (x * z + w * y),
        2 * (x * y + w * z),           w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
        2 * (x * z - w * y),           2 * (y * z + w * x),           w * w - x * x - y * y + z * z};
    for (int i = 0; i < 9; i++) R[i] = of[i] / n;
}

/* What a key expects, said where the key names the position of a free coordinate. */
static const char not_free[] = "a position that is not free: this one has no error (key free)";

static bool is_free(named of) {
    return of.coordinate != NULL && of.coordinate->free && !of.velocity;
}

static const char *take_goal(named of, const double *x, uint32_t count) {
    lg_policy_coordinate *c = of.coordinate;
    if (of.velocity) return count == 1 && x[0] == 0.0 ? NULL : "0, for the goal is a state at rest";
    switch (c->motion) {
    case LG_POLICY_DIRECTION:
        if (count != 3 || !unit_vector(x, 3)) return "a unit vector [x, y, z]";
        for (int i = 0; i < 3; i++) c->goal[i] = x[i] / sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
        return NULL;
    case LG_POLICY_ROTATION:
        if (count != 4 || !unit_vector(x, 4)) return "a unit quaternion [w, x, y, z]";
        rotation_of(x, c->goal);
        return NULL;
    default:
        if (count != 1) return "a number";
        c->goal[0] = x[0];
        return NULL;
    }
}

/* Takes the numbers of an entry; returns what is expected instead, or NULL; "": the name is unknown. */
static const char *take(lg_policy_task *task, const entries *row, named of, const char *name, const double *x,
                        uint32_t count) {
    double *const time = strcmp(row->what, "success") != 0 ? NULL
                         : strcmp(name, "hold") == 0       ? &task->hold
                         : strcmp(name, "within") == 0     ? &task->within
                                                           : NULL;
    const bool goal = strcmp(row->what, "goal") == 0, input = row->input > 0,
               coordinate = goal || row->position > 0;
    if (time == NULL && of.coordinate == NULL && of.input == NULL) return "";
    if (of.input != NULL && !input) return "a coordinate, not an input";
    if (of.coordinate != NULL && !coordinate) return "an input, not a coordinate";
    if (strcmp(row->what, "starts") != 0 && is_free(of)) return not_free;
    if (row->lagged != NULL && of.coordinate != NULL && of.coordinate->follows > 0) return row->lagged;
    if (goal) return take_goal(of, x, count);
    double *to = of.input != NULL ? (double *)(void *)((char *)of.input + row->input) : time;
    if (of.coordinate != NULL)
        to = (double *)(void *)((char *)of.coordinate + (of.velocity ? row->velocity : row->position));
    if (!row->range) {
        if (count != 1 || !(row->positive ? x[0] > 0.0 : x[0] >= 0.0)) return row->expected;
        to[0] = x[0];
        return NULL;
    }
    /* Limits are symmetric, or have a width; a start may be one number. */
    if (count < 1 || count > 2 ||
        (row->positive ? !(count == 1 ? x[0] > 0.0 : x[0] < x[1]) : x[0] > x[count - 1]))
        return row->expected;
    to[0] = count == 1 && row->positive ? -x[0] : x[0], to[1] = x[count - 1];
    return NULL;
}

static lg_status read_entries(reading *r, const lg_key_value *value, const entries *row) {
    const yaml_node_t *map = value->node;
    const char *what = row->what;
    if (value->line == 0) return LG_OK;
    if (map->type != YAML_MAPPING_NODE)
        return lg_yaml_fail(r->yaml, value->line, LG_FORMAT, r->error, "%s: expected {NAME: number, ...}",
                            what);
    for (const yaml_node_pair_t *p = map->data.mapping.pairs.start; p < map->data.mapping.pairs.top; p++) {
        const yaml_node_t *key = lg_node_at(r->yaml, p->key), *node = lg_node_at(r->yaml, p->value);
        double x[MOST_NUMBERS];
        uint32_t count;
        const char *name = key->type == YAML_SCALAR_NODE ? (const char *)key->data.scalar.value : "";
        for (const yaml_node_pair_t *q = map->data.mapping.pairs.start; q < p; q++) {
            const yaml_node_t *before = lg_node_at(r->yaml, q->key);
            if (before->type == YAML_SCALAR_NODE &&
                strcmp((const char *)before->data.scalar.value, name) == 0)
                return LG_FAIL_AT(r->yaml, key, r->error, "%s: '%.40s' stands twice", what, name);
        }
        LG_TRY(read_numbers(r, node, what, x, &count));
        const named of = find_name(r->task, name);
        const char *expected = take(r->task, row, of, name, x, count);
        if (expected == NULL) continue;
        if (expected[0] == '\0') return unknown(r, key, what, name);
        return LG_FAIL_AT(r->yaml, node, r->error, "%s: %.40s: expected %s", what, name, expected);
    }
    return LG_OK;
}

/* A list of names of positions, for `track` or `free`. */
static lg_status read_positions(reading *r, const lg_key_value *values, const char *what) {
    const lg_key_value *value = lg_yaml_value(keys, values, what);
    const yaml_node_t *list = value->node;
    if (value->line == 0) return LG_OK;
    if (list->type != YAML_SEQUENCE_NODE)
        return lg_yaml_fail(r->yaml, value->line, LG_FORMAT, r->error, "%s: expected a list of positions",
                            what);
    for (size_t i = 0; i < lg_node_length(list); i++) {
        const yaml_node_t *node = lg_node_item(r->yaml, list, i);
        const char *name = node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value : "";
        const named of = find_name(r->task, name);
        if (of.coordinate == NULL && of.input == NULL) return unknown(r, node, what, name);
        if (of.coordinate == NULL || of.velocity)
            return LG_FAIL_AT(r->yaml, node, r->error, "%s: expected a position, not '%.40s'", what, name);
        if (is_free(of))
            return LG_FAIL_AT(r->yaml, node, r->error, "%s: %.40s: expected %s", what, name, not_free);
        *(strcmp(what, "free") == 0    ? &of.coordinate->free
          : strcmp(what, "track") == 0 ? &of.coordinate->track
                                       : &of.coordinate->integral) = true;
    }
    return LG_OK;
}

/* ---- the task ---- */

static void set_defaults(lg_policy_task *task) {
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, up[3] = {0, 0, 1};
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        lg_policy_coordinate *c = &task->coordinate[i];
        memset(c->goal, 0, sizeof c->goal);
        if (c->motion == LG_POLICY_ROTATION) memcpy(c->goal, identity, sizeof identity);
        if (c->motion == LG_POLICY_DIRECTION) memcpy(c->goal, up, sizeof up);
        c->success = c->success_velocity = INFINITY;
    }
}

/* An input without a weight in the cost gets a thousandth of all weights at its limits. */
static lg_status check_inputs(const reading *r) {
    lg_policy_task *t = r->task;
    double sum = 0.0;
    for (uint32_t i = 0; i < t->coordinate_count; i++)
        sum += t->coordinate[i].weight + t->coordinate[i].weight_velocity;
    for (uint32_t l = 0; l < t->input_count; l++) {
        lg_policy_input *in = &t->input[l];
        if (!(in->low < in->high))
            return lg_fail(r->error, LG_FORMAT, "%s: limits: input '%s' has no limits", lg_yaml_path(r->yaml),
                           in->name);
        const double half = 0.5 * (in->high - in->low);
        if (in->weight == 0.0) in->weight = 1e-3 * sum / (half * half);
    }
    return LG_OK;
}

static lg_status read_task(reading *r) {
    lg_key_value values[KEYS] = {{0}};
    const lg_key_set set = {keys, KEYS, values};
    LG_TRY(lg_yaml_read(r->yaml, &set, 1, NULL, "policy", r->error));
    set_defaults(r->task);
    LG_TRY(lg_yaml_store(r->yaml, keys, values, KEYS, r->task, r->error));
    LG_TRY(read_positions(r, values, "free"));
    for (size_t i = 0; i < LG_COUNT(mappings); i++)
        LG_TRY(read_entries(r, lg_yaml_value(keys, values, mappings[i].what), &mappings[i]));
    LG_TRY(read_positions(r, values, "track"));
    LG_TRY(read_positions(r, values, "integral"));
    return check_inputs(r);
}

lg_status lg_policy_task_parse(const lg_context *context, const char *path, const char *text,
                               lg_policy_task *task, lg_error *error) {
    LG_NEEDS(error, path, text, task);
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    LG_TRY(lg_yaml_open_text(context, path, text, strlen(text), &yaml, error));
    return read_task(&(reading){yaml, task, error});
}

/* ---- before the plant is known ---- */

static const lg_field state_keys[] = {
    {.name = "name", .type = LG_FIELD_TEXT, .required = true},
    {.name = "kind", .type = LG_FIELD_NAME, .required = true, LG_NAMES("line", "angle")}};

static lg_status take_state(reading *r, const yaml_node_t *node) {
    lg_policy_task *task = r->task;
    if (task->coordinate_count == LG_POLICY_COORDINATES)
        return LG_FAIL_AT(r->yaml, node, r->error, "states: more than %d", LG_POLICY_COORDINATES);
    lg_policy_coordinate *c = &task->coordinate[task->coordinate_count++];
    const char *name = (const char *)node->data.scalar.value;
    lg_key_value values[2] = {{0}};
    if (node->type != YAML_SCALAR_NODE) {
        const lg_key_set set = {state_keys, 2, values};
        LG_TRY(lg_yaml_read_below(r->yaml, node, &set, "states", r->error));
        name = values[0].text;
        c->motion = values[1].real[0] > 0.0 ? LG_POLICY_ANGLE : LG_POLICY_LINE;
    }
    if (name[0] == '\0' || strlen(name) >= LG_POLICY_NAME)
        return LG_FAIL_AT(r->yaml, node, r->error, "states: a name has 1 to %d bytes", LG_POLICY_NAME - 1);
    (void)snprintf(c->name, sizeof c->name, "%s", name);
    return LG_OK;
}

static lg_status read_head(reading *r, char *plant, size_t size) {
    lg_key_value values[KEYS] = {{0}};
    const lg_key_set set = {keys, KEYS, values};
    LG_TRY(lg_yaml_read(r->yaml, &set, 1, NULL, "policy", r->error));
    const lg_key_value *period = lg_yaml_value(keys, values, "period"),
                       *states = lg_yaml_value(keys, values, "states");
    (void)snprintf(plant, size, "%s", lg_yaml_value(keys, values, "plant")->text);
    LG_TRY(lg_yaml_store(r->yaml, &keys[period - values], period, 1, r->task, r->error));
    if (states->line == 0) return LG_OK;
    const yaml_node_t *list = states->node;
    if (list->type != YAML_SEQUENCE_NODE)
        return lg_yaml_fail(r->yaml, states->line, LG_FORMAT, r->error, "states: expected a list");
    for (size_t i = 0; i < lg_node_length(list); i++) LG_TRY(take_state(r, lg_node_item(r->yaml, list, i)));
    return LG_OK;
}

lg_status lg_policy_task_read(const lg_context *context, const char *path, lg_policy_task *task, char *plant,
                              size_t size, char **text, lg_error *error) {
    LG_NEEDS(error, path, task, plant, text);
    LG_CLEAN(lg_owned_free) lg_owned bytes = {context, NULL};
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    unsigned char *read;
    size_t count;
    lg_policy_task_init(task);
    LG_TRY(lg_yaml_bytes(context, path, &read, &count, error));
    bytes.memory = read;
    LG_TRY(lg_yaml_open_text(context, path, read, count, &yaml, error));
    LG_TRY(read_head(&(reading){yaml, task, error}, plant, size));
    return LG_MOVE(text, bytes.memory);
}
