#include "datasets/scene.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "datasets/names.h"
#include "liegrad/geometry.h"

#define OFF_MANIFOLD 1e-6  /* beyond it a start is an error, not rounding */
#define ROUNDING     1e-14 /* below it nothing is said or changed */

/* ---- names ---- */

static const char *system_name(uint32_t value) {
    return value < LG_KNOWN_SYSTEMS ? lg_known_systems[value].name : NULL;
}

static const char *form_name(uint32_t value) {
    static const char *const names[] = {"lagrangian", "hamiltonian"}; /* lg_scene_form - 1 */
    return value < LG_COUNT(names) ? names[value] : NULL;
}

static const char *starts_name(uint32_t value) {
    static const char *const names[] = {[LG_STARTS_THESIS] = "thesis", [LG_STARTS_BOX] = "box"};
    return value < LG_COUNT(names) ? names[value] : NULL;
}

/* ---- keys: one row each ---- */

#define ON(system) (1u << (system))
#define ALL        UINT32_MAX
#define FLAT       (ON(LG_KNOWN_QUARTIC) | ON(LG_KNOWN_COUPLED))
#define LINKS      LG_HAMILTONIAN_MAX_LINKS

enum {
    KEY_SYSTEM,
    KEY_FORM,
    KEY_LINKS,
    KEY_GRAVITY,
    KEY_MASSES,
    KEY_LENGTHS,
    KEY_T_END,
    KEY_INITIAL,
    KEY_Q,
    KEY_P,
    KEY_OMEGA,
    KEY_FLAT_Q,
    KEY_FLAT_P,
    KEY_STARTS,
    KEY_KIND,
    KEY_LOW,
    KEY_HIGH,
    KEY_SEGMENTS,
    KEYS
};

/* name, type, systems, required, open, low, high, capacity, names */
static const lg_key keys[KEYS] = {
    [KEY_SYSTEM] = {"system", LG_KEY_NAME, ALL, true, false, 0, 0, 1, system_name},
    [KEY_FORM] = {"form", LG_KEY_NAME, ALL, false, false, 0, 0, 1, form_name},
    [KEY_LINKS] = {"links", LG_KEY_COUNT, ON(LG_KNOWN_CHAIN), false, false, 1, LINKS, 1, NULL},
    [KEY_GRAVITY] = {"gravity", LG_KEY_REAL, ON(LG_KNOWN_CHAIN), true, false, -1e12, 1e12, 1, NULL},
    [KEY_MASSES] = {"masses", LG_KEY_REALS, ON(LG_KNOWN_CHAIN), false, true, 0, 1e12, LINKS, NULL},
    [KEY_LENGTHS] = {"lengths", LG_KEY_REALS, ON(LG_KNOWN_CHAIN), false, true, 0, 1e12, LINKS, NULL},
    [KEY_T_END] = {"t_end", LG_KEY_REAL, ALL, false, true, 0, 1e12, 1, NULL},
    [KEY_INITIAL] = {"initial", LG_KEY_MAP, ALL, false, false, 0, 0, 0, NULL},
    [KEY_Q] = {"initial.q", LG_KEY_ROWS, ON(LG_KNOWN_CHAIN), true, false, -2, 2, LINKS, NULL},
    [KEY_P] = {"initial.p", LG_KEY_ROWS, ON(LG_KNOWN_CHAIN), false, false, -1e12, 1e12, LINKS, NULL},
    [KEY_OMEGA] = {"initial.omega", LG_KEY_ROWS, ON(LG_KNOWN_CHAIN), false, false, -1e12, 1e12, LINKS, NULL},
    [KEY_FLAT_Q] = {"initial.q", LG_KEY_REALS, FLAT, true, false, -1e12, 1e12, LINKS, NULL},
    [KEY_FLAT_P] = {"initial.p", LG_KEY_REALS, FLAT, true, false, -1e12, 1e12, LINKS, NULL},
    [KEY_STARTS] = {"starts", LG_KEY_MAP, ALL, false, false, 0, 0, 0, NULL},
    [KEY_KIND] = {"starts.kind", LG_KEY_NAME, ALL, true, false, 0, 0, 1, starts_name},
    [KEY_LOW] = {"starts.low", LG_KEY_REAL, ALL, false, false, -1e12, 1e12, 1, NULL},
    [KEY_HIGH] = {"starts.high", LG_KEY_REAL, ALL, false, false, -1e12, 1e12, 1, NULL},
    [KEY_SEGMENTS] = {"starts.segments", LG_KEY_COUNT, ALL, false, false, 1, 1000, 1, NULL},
};

/* ---- the chain's numbers ---- */

/* Every list that is there has one entry a link; the first of them says how many links. */
static lg_status find_links(const lg_yaml *yaml, const lg_key_value *v, uint32_t *links, lg_error *error) {
    static const struct {
        int key;
        uint32_t per;
    } sources[] = {{KEY_LINKS, 0}, {KEY_MASSES, 1}, {KEY_LENGTHS, 1}, {KEY_Q, 3}, {KEY_P, 3}, {KEY_OMEGA, 3}};
    uint32_t found = 0;
    const char *by = "";
    for (size_t i = 0; i < LG_COUNT(sources); i++) {
        const lg_key_value *value = &v[sources[i].key];
        const char *name = keys[sources[i].key].name;
        if (value->line == 0) continue;
        uint32_t count = sources[i].per == 0 ? (uint32_t)value->real[0] : value->count / sources[i].per;
        if (found != 0 && count != found)
            return lg_yaml_fail(yaml, value->line, LG_FORMAT, error, "%s: is for %u links, %s for %u", name,
                                count, by, found);
        found = count;
        by = name;
    }
    if (found == 0)
        return lg_yaml_fail(yaml, v[KEY_SYSTEM].line, LG_FORMAT, error, "key 'links' or 'masses' is missing");
    *links = found;
    return LG_OK;
}

static double norm3(const double *a) {
    return sqrt(lg_dot3(a, a));
}

/* One link's (q, w) onto T S^2: q/|q|, w - q (q.w). What is off by rounding is projected and told, more is an
 * error. */
static lg_status place_link(const lg_yaml *yaml, const lg_key_value *q, const lg_key_value *w,
                            const char *w_name, uint32_t link, lg_scene *out, lg_error *error) {
    const double *from_q = q->real + 3 * (size_t)link, *from_w = w->real + 3 * (size_t)link;
    double *to = out->state + 6 * (size_t)link;
    double length = norm3(from_q), off_sphere = fabs(length - 1);
    if (!(off_sphere <= OFF_MANIFOLD))
        return lg_yaml_fail(yaml, q->lines[3 * link], LG_FORMAT, error,
                            "initial.q: row %u is off the sphere: |q| = %.9g, expected 1 within %g", link + 1,
                            length, OFF_MANIFOLD);
    double scale = off_sphere > ROUNDING ? 1 / length : 1;
    for (int i = 0; i < 3; i++) to[i] = from_q[i] * scale;
    double along = lg_dot3(to, from_w);
    double off_tangent = fabs(along) / (1 + norm3(from_w));
    if (!(off_tangent <= OFF_MANIFOLD))
        return lg_yaml_fail(yaml, w->lines[3 * link], LG_FORMAT, error,
                            "%s: row %u is not orthogonal to q: their product is %.9g", w_name, link + 1,
                            along);
    if (off_tangent <= ROUNDING) along = 0;
    for (int i = 0; i < 3; i++) to[3 + i] = from_w[i] - along * to[i];
    double off = fmax(off_sphere, off_tangent);
    if (off > ROUNDING) out->projected = true;
    if (off > out->projection) out->projection = off;
    return LG_OK;
}

static lg_status chain_start(const lg_context *context, const lg_yaml *yaml, const lg_key_value *v,
                             lg_scene *out, lg_error *error) {
    bool has_p = v[KEY_P].line != 0, has_omega = v[KEY_OMEGA].line != 0;
    uint32_t line = v[KEY_INITIAL].line;
    if (has_p == has_omega)
        return lg_yaml_fail(yaml, line, LG_FORMAT, error, "initial: %s",
                            has_p ? "p and omega exclude each other"
                                  : "key 'initial.p' (or 'initial.omega') is missing");
    lg_scene_form means = has_p ? LG_SCENE_HAMILTONIAN : LG_SCENE_LAGRANGIAN;
    const lg_key_value *w = &v[has_p ? KEY_P : KEY_OMEGA];
    const char *w_name = keys[has_p ? KEY_P : KEY_OMEGA].name;
    if (out->form != LG_SCENE_UNSPECIFIED && out->form != means)
        return lg_yaml_fail(yaml, w->line, LG_FORMAT, error, "%s: does not belong to the form %s", w_name,
                            form_name((uint32_t)out->form - 1));
    out->form = means;
    for (uint32_t i = 0; i < out->links; i++) LG_TRY(place_link(yaml, &v[KEY_Q], w, w_name, i, out, error));
    if (out->projected)
        lg_log_message(context, LG_LOG_WARNING,
                       "%s: line %u: the start was off the manifold by %.3g and was projected",
                       lg_yaml_path(yaml), line, out->projection);
    return LG_OK;
}

static lg_status flat_start(const lg_yaml *yaml, const lg_key_value *v, lg_scene *out, lg_error *error) {
    static const int parts[] = {KEY_FLAT_Q, KEY_FLAT_P};
    for (size_t i = 0; i < LG_COUNT(parts); i++) {
        const lg_key_value *value = &v[parts[i]];
        if (value->count != out->links)
            return lg_yaml_fail(yaml, value->line, LG_FORMAT, error, "%s: has %u numbers, %u are expected",
                                keys[parts[i]].name, value->count, out->links);
        memcpy(out->state + i * out->links, value->real, out->links * sizeof *out->state);
    }
    return LG_OK;
}

/* ---- a scene from the values of its keys ---- */

static void set_list(const lg_key_value *value, uint32_t links, double *out) {
    for (uint32_t i = 0; i < links; i++) out[i] = value->line != 0 ? value->real[i] : 1.0;
}

static lg_status set_starts(const lg_yaml *yaml, const lg_key_value *v, lg_scene *out, lg_error *error) {
    if (!out->has_starts) return LG_OK;
    out->starts = (lg_starts)(int)v[KEY_KIND].real[0];
    if (v[KEY_LOW].line != 0) out->low = v[KEY_LOW].real[0];
    if (v[KEY_HIGH].line != 0) out->high = v[KEY_HIGH].real[0];
    if (v[KEY_SEGMENTS].line != 0) out->segments = (uint32_t)v[KEY_SEGMENTS].real[0];
    uint32_t bounds = v[KEY_HIGH].line != 0 ? v[KEY_HIGH].line : v[KEY_LOW].line;
    if (bounds != 0 && out->starts != LG_STARTS_BOX)
        return lg_yaml_fail(yaml, bounds, LG_FORMAT, error, "starts: low and high belong to kind: box");
    if (!(out->low < out->high))
        return lg_yaml_fail(yaml, bounds, LG_FORMAT, error, "starts: low must be below high");
    return LG_OK;
}

static lg_status fill(const lg_context *context, const lg_yaml *yaml, const lg_key_value *v, lg_scene *out,
                      lg_error *error) {
    const lg_known_system *row = &lg_known_systems[(size_t)v[KEY_SYSTEM].real[0]];
    *out = (lg_scene){.family = row->family,
                      .links = row->links,
                      .low = -1,
                      .high = 1,
                      .segments = 1,
                      .has_initial = v[KEY_INITIAL].line != 0,
                      .has_t_end = v[KEY_T_END].line != 0,
                      .has_starts = v[KEY_STARTS].line != 0,
                      .line_system = v[KEY_SYSTEM].line,
                      .line_form = v[KEY_FORM].line,
                      .line_initial = v[KEY_INITIAL].line,
                      .line_starts = v[KEY_STARTS].line};
    bool chain = row->family == LG_HAMILTONIAN_CHAIN;
    memcpy(out->system, row->name, strlen(row->name) + 1);
    if (v[KEY_FORM].line != 0) out->form = (lg_scene_form)((int)v[KEY_FORM].real[0] + 1);
    if (!chain && out->form == LG_SCENE_LAGRANGIAN)
        return lg_yaml_fail(yaml, v[KEY_FORM].line, LG_FORMAT, error, "form: %s is Hamiltonian", row->name);
    if (!chain) out->form = LG_SCENE_HAMILTONIAN;
    if (chain) LG_TRY(find_links(yaml, v, &out->links, error));
    out->state_size = out->links * (chain ? 6 : 2);
    out->gravity = chain ? v[KEY_GRAVITY].real[0] : 0;
    if (chain) set_list(&v[KEY_MASSES], out->links, out->masses);
    if (chain) set_list(&v[KEY_LENGTHS], out->links, out->lengths);
    if (out->has_t_end) out->t_end = v[KEY_T_END].real[0];
    LG_TRY(set_starts(yaml, v, out, error));
    if (!out->has_initial) return LG_OK;
    return chain ? chain_start(context, yaml, v, out, error) : flat_start(yaml, v, out, error);
}

lg_status lg_scene_from(const lg_context *context, lg_yaml *yaml, const lg_key_set *more, lg_scene *out,
                        lg_error *error) {
    lg_key_value *values = lg_alloc(context, KEYS, sizeof *values);
    if (values == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_yaml_path(yaml));
    lg_key_set sets[2] = {{keys, KEYS, values}, {NULL, 0, NULL}};
    if (more != NULL) sets[1] = *more;
    lg_scene made;
    lg_status status = lg_yaml_name(yaml, &keys[KEY_SYSTEM], &values[KEY_SYSTEM], error);
    if (status == LG_OK) {
        uint32_t system = (uint32_t)values[KEY_SYSTEM].real[0];
        status = lg_yaml_read(yaml, sets, more != NULL ? 2 : 1, ON(system), system_name(system), error);
    }
    if (status == LG_OK) status = fill(context, yaml, values, &made, error);
    lg_free(context, values);
    if (status == LG_OK) *out = made;
    return status;
}

lg_status lg_scene_read(const lg_context *context, const char *path, lg_scene *out, lg_error *error) {
    lg_yaml *yaml;
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "a scene is read into something");
    LG_TRY(lg_yaml_open(context, path, &yaml, error));
    lg_status status = lg_scene_from(context, yaml, NULL, out, error);
    lg_yaml_close(yaml);
    return status;
}

lg_status lg_scene_default(const char *system, uint32_t links, lg_scene *out) {
    if (system == NULL || out == NULL) return LG_INVALID_ARGUMENT;
    const lg_known_system *row = lg_find_system(system);
    if (row == NULL) return LG_INVALID_ARGUMENT;
    bool chain = row->family == LG_HAMILTONIAN_CHAIN;
    if (chain && (links < 1 || links > LINKS)) return LG_INVALID_ARGUMENT;
    *out = (lg_scene){.family = row->family,
                      .form = LG_SCENE_HAMILTONIAN,
                      .links = chain ? links : row->links,
                      .gravity = chain ? 1 : 0,
                      .low = -1,
                      .high = 1,
                      .segments = 1};
    memcpy(out->system, system, strlen(system) + 1);
    out->state_size = out->links * (chain ? 6 : 2);
    for (uint32_t i = 0; chain && i < links; i++) out->masses[i] = out->lengths[i] = 1;
    return LG_OK;
}

/* ---- the table in words ---- */

int lg_scene_describe(const char *system, char *text, size_t size) {
    static const char *const shapes[] = {
        [LG_KEY_REAL] = "number", [LG_KEY_COUNT] = "whole number",  [LG_KEY_WHOLE] = "whole number",
        [LG_KEY_NAME] = "name",   [LG_KEY_TEXT] = "text",           [LG_KEY_REALS] = "list of numbers",
        [LG_KEY_COUNTS] = "list", [LG_KEY_NAMES] = "list of names", [LG_KEY_ROWS] = "k x 3 numbers",
        [LG_KEY_MAP] = "mapping"};
    size_t used = 0;
    const lg_known_system *row = system != NULL ? lg_find_system(system) : NULL;
    if (row == NULL) return 0;
    const uint32_t mask = ON(row - lg_known_systems);
    if (size > 0) text[0] = '\0';
    for (size_t i = 0; i < KEYS; i++) {
        char range[64] = "";
        const lg_key *key = &keys[i];
        if (!(key->systems & mask)) continue;
        if (key->low < key->high && key->high < 1e12)
            (void)snprintf(range, sizeof range, ", %s%g, %g]", key->open ? "(" : "[", key->low, key->high);
        else if (key->open)
            (void)snprintf(range, sizeof range, ", > %g", key->low);
        bool room = used < size;
        used += (size_t)snprintf(room ? text + used : NULL, room ? size - used : 0, "%-16s %s%s%s\n",
                                 key->name, shapes[key->type], range, key->required ? ", required" : "");
    }
    return (int)used;
}
