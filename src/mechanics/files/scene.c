/* Reads scenes. Their keys and shapes come from the table of systems. */
#include "mechanics/files/scene_reading.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "files/h5.h"

#define UNIT_VECTOR 1e-9
#define LARGEST     1e300 /* bound on every number */
#define MAX_LINKS   1000000

/* ---- the table of systems ---- */

/* The names of the systems, each once, by value 0, 1, ...; NULL beyond the last. */
static const char *system_name(uint32_t value) {
    const char *name, *last = "";
    for (size_t i = 0; lg_system_at(i, &name, NULL); i++) {
        if (strcmp(name, last) == 0) continue; /* the forms of a system are consecutive rows */
        if (value-- == 0) return name;
        last = name;
    }
    return NULL;
}

/* The forms of a system, by value 0, 1, ...; NULL beyond the last, and if the system has only one form. */
static const char *form_of(const char *system, size_t value) {
    const char *name, *form;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++)
        if (strcmp(name, system) == 0 && value-- == 0) return form;
    return NULL;
}

static const char *find_form(const char *system, const char *text) {
    size_t i = 0;
    while (form_of(system, i) != NULL && strcmp(form_of(system, i), text) != 0) i++;
    return form_of(system, i);
}

/* Whether the system has one form only and the state (q, p): `form: hamiltonian` then has no effect. */
static bool plainly_hamiltonian(const char *system) {
    const lg_state_entry *state = lg_system_state(system, NULL);
    return form_of(system, 0) == NULL && strcmp(state[0].key, "q") == 0 && state[1].key != NULL &&
           strcmp(state[1].key, "p") == 0;
}

/* Whether a parameter or a part of the state has one entry per link. */
static bool has_links(const char *system, const char *form) {
    const lg_parameter_entry *parameter = lg_system_parameters(system, form);
    const lg_state_entry *part = lg_system_state(system, form);
    while (parameter->key != NULL && parameter->count != 0) parameter++;
    while (part->key != NULL && part->outer != 0) part++;
    return parameter->key != NULL || part->key != NULL;
}

/* Whether any system has this key. */
static bool known_elsewhere(const char *name) {
    static const char initial[] = "initial.";
    const char *system, *form;
    const bool inner = strncmp(name, initial, sizeof initial - 1) == 0;
    const char *key = inner ? name + sizeof initial - 1 : name;
    if (strcmp(name, "links") == 0 || strcmp(name, "reference") == 0) return true;
    for (size_t i = 0; lg_system_at(i, &system, &form); i++) {
        const lg_parameter_entry *parameter = lg_system_parameters(system, form);
        const lg_state_entry *part = lg_system_state(system, form);
        for (; !inner && parameter->key != NULL; parameter++)
            if (strcmp(parameter->key, key) == 0) return true;
        for (; inner && part->key != NULL; part++)
            if (strcmp(part->key, key) == 0) return true;
    }
    return false;
}

/* ---- the keys of one system ---- */

static const lg_field common_keys[] = {
    {.name = "system", .type = LG_FIELD_NAME, .required = true, .value_name = system_name},
    {.name = "form", .type = LG_FIELD_TEXT},
    LG_FIELD(lg_scene, NULL, "t_end", REAL, t_end, .above = true, .high = LARGEST),
    LG_MAP("initial"),
    LG_MAP("starts"),
    LG_FIELD(lg_scene, NULL, "starts.kind", NAME, starts, .required = true,
             LG_NAMES([LG_STARTS_THESIS] = "thesis", [LG_STARTS_BOX] = "box", [LG_STARTS_PLANE] = "plane")),
    LG_FIELD(lg_scene, NULL, "starts.low", REAL, low, .low = -LARGEST, .high = LARGEST),
    LG_FIELD(lg_scene, NULL, "starts.high", REAL, high, .low = -LARGEST, .high = LARGEST),
    LG_FIELD(lg_scene, NULL, "starts.segments", U32, segments, .low = 1, .high = 1000),
    LG_FIELD(lg_scene, NULL, "starts.ahead", REAL, ahead, .high = LARGEST),
    LG_FIELD(lg_scene, NULL, "ensemble", TEXT, ensemble, .low = 0),
};
static const lg_field links_key = {.name = "links", .type = LG_FIELD_U32, .low = 1, .high = MAX_LINKS};
static const lg_field reference_key = {.name = "reference", .type = LG_FIELD_NAME, LG_NAMES("parabola")};

/* The line of a common key; 0: the file does not have it. */
static uint32_t line_at(const lg_key_value *values, const char *name) {
    return lg_yaml_value(common_keys, values, name)->line;
}

static size_t add_key(scene_table *table, const char *prefix, const lg_field *key) {
    const size_t at = table->count++;
    if (at >= LG_SCENE_MAX_KEYS) return 0;
    table->keys[at] = *key;
    (void)snprintf(table->names[at], sizeof table->names[at], "%s%s", prefix, key->name);
    table->keys[at].name = table->names[at];
    return at;
}

static void add_parameters(scene_table *table) {
    table->parameters_at = table->count;
    for (const lg_parameter_entry *row = table->parameters; row->key != NULL; row++) {
        const bool positive = row->rule == LG_PARAMETER_POSITIVE;
        const lg_field key = {.name = row->key,
                              .type = row->count == 1 ? LG_FIELD_REAL : LG_FIELD_NODE,
                              .required = row->fallback == NULL,
                              .above = positive,
                              .low = positive ? 0 : -LARGEST,
                              .high = LARGEST,
                              .most = 1};
        (void)add_key(table, "", &key);
    }
}

static void add_parts(scene_table *table) {
    lg_field key = {.type = LG_FIELD_NODE, .low = -LARGEST, .high = LARGEST, .most = 1};
    table->parts_at = table->count;
    for (const lg_state_entry *row = table->parts; row->key != NULL; row++) {
        key.name = row->key;
        key.required = row->fallback == NULL;
        if (table->own_key != NULL && strcmp(table->own_key, row->key) == 0) key.required = false;
        (void)add_key(table, "initial.", &key);
    }
    if (table->other_key == NULL) return;
    key.name = table->other_key;
    key.required = false;
    table->other_at = add_key(table, "initial.", &key);
}

static lg_status build_table(const char *system, const char *form, scene_table *table, lg_error *error) {
    table->system = system;
    table->form = form;
    lg_append(table->title, sizeof table->title, form != NULL ? "%s (%s" : "%s", system, form);
    for (size_t i = 0; form != NULL && form_of(system, i) != NULL; i++)
        if (strcmp(form_of(system, i), form) != 0)
            lg_append(table->title, sizeof table->title, "; or `form: %s`", form_of(system, i));
    if (form != NULL) lg_append(table->title, sizeof table->title, ")");
    table->parameters = lg_system_parameters(system, form);
    table->parts = lg_system_state(system, form);
    if (strcmp(system, "pendulum-chain") == 0) {
        const bool momenta = form != NULL && strcmp(form, "hamiltonian") == 0;
        table->own_key = momenta ? "p" : "omega";
        table->other_key = momenta ? "omega" : "p";
    }
    for (size_t i = 0; i < LG_COUNT(common_keys); i++) (void)add_key(table, "", &common_keys[i]);
    if (has_links(system, form)) table->links_at = add_key(table, "", &links_key);
    if (strcmp(system, "quadrotors") == 0) (void)add_key(table, "", &reference_key);
    add_parameters(table);
    add_parts(table);
    if (table->count <= LG_SCENE_MAX_KEYS) return LG_OK;
    return lg_fail(error, LG_UNSUPPORTED, "system %s has more than %d keys", system, LG_SCENE_MAX_KEYS);
}

/* ---- choice of the form ---- */

static lg_status wrong_form(const lg_yaml *yaml, const char *system, const lg_key_value *value,
                            lg_error *error) {
    lg_name_list known = {.used = 0};
    for (size_t i = 0; form_of(system, i) != NULL; i++) lg_name_list_add(&known, form_of(system, i));
    if (known.used == 0 && !plainly_hamiltonian(system))
        return lg_yaml_fail(yaml, value->line, LG_FORMAT, error, "form: system %s has one form only", system);
    return lg_yaml_fail(yaml, value->line, LG_FORMAT, error, "form: '%.40s' is none of %s", value->text,
                        known.used > 0 ? known.text : "hamiltonian");
}

/* The first form for which `initial` has all parts without a default; if there is none, the first form. */
static const char *form_of_initial(const lg_yaml *yaml, const char *system) {
    for (size_t i = 0; form_of(system, i) != NULL; i++) {
        bool all = true;
        for (const lg_state_entry *row = lg_system_state(system, form_of(system, i)); row->key != NULL;
             row++) {
            char name[48];
            (void)snprintf(name, sizeof name, "initial.%s", row->key);
            all = all && (row->fallback != NULL || lg_yaml_has(yaml, name));
        }
        if (all) return form_of(system, i);
    }
    return form_of(system, 0);
}

static lg_status choose_form(lg_yaml *yaml, const char *system, const char *wanted, const char **form,
                             lg_error *error) {
    lg_key_value value;
    *form = NULL;
    if (wanted != NULL) wanted = find_form(system, wanted);
    if (!lg_yaml_has(yaml, "form")) {
        *form = wanted != NULL ? wanted : form_of_initial(yaml, system);
        return LG_OK;
    }
    LG_TRY(lg_yaml_name(yaml, lg_field_find(common_keys, "form"), &value, error));
    if (plainly_hamiltonian(system) && strcmp(value.text, "hamiltonian") == 0) return LG_OK;
    *form = find_form(system, value.text);
    if (*form == NULL) return wrong_form(yaml, system, &value, error);
    if (wanted != NULL) *form = wanted;
    return LG_OK;
}

/* ---- reading ---- */

/* Determines the number of links from the value of key `at`: the number itself, or the number of entries (of
 * `inner` numbers each) of a list. Fails if it differs from r->links, which was found from key *by; else sets
 * both. Does nothing if the key is not given. */
static lg_status count_links(reading *r, size_t at, size_t inner, const char **by) {
    const lg_key_value *value = &r->table->values[at];
    const char *name = r->table->keys[at].name;
    size_t count = 0;
    if (value->line == 0) return LG_OK;
    if (at == r->table->links_at)
        count = (size_t)value->real[0];
    else
        LG_TRY(lg_yaml_entries(r->yaml, &r->table->keys[at], value, inner, &count, r->error));
    if (count > MAX_LINKS)
        return LG_SCENE_FAULT(r, value->line, "%s: gives more than %d links, the largest possible number",
                              name, MAX_LINKS);
    if (r->links != 0 && count != r->links)
        return LG_SCENE_FAULT(r, value->line, "%s: gives %zu links, but %s gives %zu", name, count, *by,
                              r->links);
    r->links = count;
    *by = name;
    return LG_OK;
}

/* Finds the number of links. The key `links` and all lists with one entry per link must agree. */
static lg_status find_links(reading *r) {
    const scene_table *table = r->table;
    const char *by = "", *needed = "links";
    if (table->links_at == 0) return LG_OK;
    LG_TRY(count_links(r, table->links_at, 1, &by));
    for (size_t i = 0; table->parameters[i].key != NULL; i++) {
        if (table->parameters[i].count != 0) continue;
        needed = table->parameters[i].key;
        LG_TRY(count_links(r, table->parameters_at + i, 1, &by));
    }
    for (size_t i = 0; table->parts[i].key != NULL; i++) {
        const lg_state_entry *row = &table->parts[i];
        if (row->outer != 0) continue;
        LG_TRY(count_links(r, table->parts_at + i, row->rows * row->columns, &by));
        if (table->other_at != 0 && strcmp(row->key, table->own_key) == 0)
            LG_TRY(count_links(r, table->other_at, row->rows * row->columns, &by));
    }
    if (r->links != 0) return LG_OK;
    return LG_SCENE_FAULT(r, table->values->line, "key 'links' or '%s' is missing", needed);
}

/* ---- parameters ---- */

static lg_status check_unit(const reading *r, size_t at, const double *values, size_t count) {
    double sum = 0;
    for (size_t i = 0; i < count; i++) sum += values[i] * values[i];
    if (fabs(sqrt(sum) - 1) <= UNIT_VECTOR) return LG_OK;
    return LG_SCENE_FAULT(r, r->table->values[at].line, "%s: is not a unit vector: its length is %.12g",
                          r->table->keys[at].name, sqrt(sum));
}

static lg_status read_parameter(const reading *r, size_t index, double *out) {
    const lg_parameter_entry *row = &r->table->parameters[index];
    const size_t at = r->table->parameters_at + index, count = per_link(row->count, r->links);
    const lg_key_value *value = &r->table->values[at];
    const size_t shape[3] = {1, 1, count};
    if (row->count == 1)
        out[0] = value->real[0];
    else
        LG_TRY(lg_yaml_block(r->yaml, &r->table->keys[at], value, shape, out, NULL, r->error));
    return row->rule == LG_PARAMETER_UNIT_VECTOR ? check_unit(r, at, out, count) : LG_OK;
}

/* `values` has room for the values of all parameters, `named` for one entry per parameter. */
static lg_status create_system(reading *r, double *values, lg_named_values *named) {
    const scene_table *table = r->table;
    lg_system_options options;
    lg_system_options_init(&options);
    for (size_t i = 0; table->parameters[i].key != NULL; i++) {
        const size_t count = per_link(table->parameters[i].count, r->links);
        if (table->values[table->parameters_at + i].line == 0) continue;
        LG_TRY(read_parameter(r, i, values));
        named[options.parameter_count++] = (lg_named_values){table->parameters[i].key, values, count};
        values += count;
    }
    options.form = table->form;
    if (r->links > 0) options.links = r->links;
    options.parameters = named;
    lg_error inner = {LG_OK, ""};
    const lg_status status = lg_system_create(r->context, table->system, &options, &r->out->system, &inner);
    if (status == LG_OK) return LG_OK;
    return lg_yaml_fail(r->yaml, table->values->line, status == LG_INVALID_ARGUMENT ? LG_FORMAT : status,
                        r->error, "%.300s", inner.message);
}

static lg_status read_system(reading *r) {
    size_t numbers = 0, rows = 0;
    for (; r->table->parameters[rows].key != NULL; rows++)
        numbers += per_link(r->table->parameters[rows].count, r->links);
    LG_SCRATCH(double, values, r->context, numbers);
    LG_SCRATCH(lg_named_values, named, r->context, rows);
    return values != NULL && named != NULL ? create_system(r, values, named) : lg_scene_no_memory(r);
}

/* ---- random starts ---- */

static lg_status read_starts(reading *r) {
    const lg_key_value *v = r->table->values;
    const lg_scene *out = r->out;
    if (!out->has_starts) return LG_OK;
    const uint32_t high = line_at(v, "starts.high"), bounds = high != 0 ? high : line_at(v, "starts.low");
    if (bounds != 0 && out->starts != LG_STARTS_BOX)
        return LG_SCENE_FAULT(r, bounds, "starts: low and high can be given with kind: box only");
    if (!(out->low < out->high)) return LG_SCENE_FAULT(r, bounds, "starts: low must be below high");
    return LG_OK;
}

/* ---- a scene from the values of its keys ---- */

static lg_status fill(reading *r) {
    const lg_key_value *v = r->table->values;
    *r->out = (lg_scene){.low = -1,
                         .high = 1,
                         .segments = 1,
                         .context = r->context,
                         .has_initial = line_at(v, "initial") != 0,
                         .has_t_end = line_at(v, "t_end") != 0,
                         .has_starts = line_at(v, "starts") != 0,
                         .line_system = line_at(v, "system"),
                         .line_form = line_at(v, "form"),
                         .line_initial = line_at(v, "initial"),
                         .line_starts = line_at(v, "starts")};
    LG_TRY(lg_yaml_store(r->yaml, r->table->keys, v, r->table->count, r->out, r->error));
    LG_TRY(find_links(r));
    LG_TRY(read_starts(r));
    LG_TRY(read_system(r));
    return r->out->has_initial ? lg_scene_read_start(r) : LG_OK;
}

static lg_status read_scene(const lg_context *context, lg_yaml *yaml, const char *form_wanted,
                            const lg_key_set *more, scene_table *table, lg_scene *out, lg_error *error) {
    const char *form;
    if (!lg_yaml_has(yaml, "system") && (lg_yaml_has(yaml, "integrators") || lg_yaml_has(yaml, "schemes")))
        return lg_fail(error, LG_FORMAT, "%s: this file is a grid for `lg-hamiltonian study`, not a scene",
                       lg_shown_path(lg_yaml_path(yaml)));
    LG_TRY(lg_yaml_name(yaml, common_keys, table->values, error)); /* the first key is `system` */
    const char *system = system_name((uint32_t)table->values->real[0]);
    LG_TRY(choose_form(yaml, system, form_wanted, &form, error));
    LG_TRY(build_table(system, form, table, error));
    lg_key_set sets[2] = {{table->keys, table->count, table->values}, {NULL, 0, NULL}};
    if (more != NULL) sets[1] = *more;
    LG_TRY(lg_yaml_read(yaml, sets, more != NULL ? 2 : 1, known_elsewhere, table->title, error));
    reading r = {context, yaml, table, 0, out, error};
    const lg_status status = fill(&r);
    if (status != LG_OK) lg_scene_destroy(out);
    return status;
}

lg_status lg_scene_from(const lg_context *context, lg_yaml *yaml, const char *form_wanted,
                        const lg_key_set *more, lg_scene *out, lg_error *error) {
    lg_scene made = {.context = context};
    LG_SCRATCH(scene_table, table, context, 1);
    if (table == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_yaml_path(yaml));
    LG_TRY(read_scene(context, yaml, form_wanted, more, table, &made, error));
    *out = made;
    return LG_OK;
}

lg_status lg_scene_read(const lg_context *context, const char *path, const char *form_wanted, lg_scene *out,
                        lg_error *error) {
    LG_CLEAN(lg_yaml_close_at) lg_yaml *yaml = NULL;
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "`out` is NULL");
    LG_TRY(lg_yaml_open(context, path, &yaml, error));
    return lg_scene_from(context, yaml, form_wanted, NULL, out, error);
}

lg_status lg_scene_draw_start(lg_scene *scene, uint64_t seed) {
    if (scene == NULL || scene->system == NULL || scene->state != NULL) return LG_INVALID_ARGUMENT;
    lg_trajectory_options options;
    lg_trajectory_options_init(&options);
    options.starts = scene->starts;
    options.low = scene->low;
    options.high = scene->high;
    LG_TRY_SCRATCH(double, state, scene->context, lg_system_dim(scene->system), LG_OUT_OF_MEMORY);
    lg_rng rng;
    lg_rng_seed(&rng, seed, 0);
    LG_TRY(lg_system_draw_start(scene->system, &options, &rng, state));
    scene->state = LG_KEEP(state);
    return LG_OK;
}

void lg_scene_destroy(lg_scene *scene) {
    if (scene == NULL) return;
    lg_system_destroy(scene->system);
    lg_free(scene->context, scene->state);
    *scene = (lg_scene){.system = NULL};
}
