/* Gradient-check cases: the taped fields of all mechanical systems, differentiated with respect to the state
 * and to all parameters. The state is on the manifold; the check perturbs its ambient coordinates freely. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gradcheck/table.h"
#include "liegrad/core.h"
#include "liegrad/geometry.h"
#include "liegrad/mechanics.h"
#include "liegrad/ops.h"

enum { PARAMETERS_MAX = 64, KEYS_MAX = 16 };

typedef enum part { FIELD, AMBIENT_FIELD, FORCE, VELOCITY, PARTS } part;

typedef struct settings {
    lg_system *system;
    part part;
} settings;

/* ---- building ---- */

/* The parts, each flattened to (B, numbers), concatenated along the second axis. */
static lg_var flat(lg_tape *tape, const lg_var *parts, size_t n) {
    lg_var rows[LG_TAPED_MAX_PARTS];
    for (size_t i = 0; i < n; i++) {
        const lg_shape s = lg_var_shape(tape, parts[i]);
        const uint32_t batch = s.dims[0], width = (uint32_t)(lg_shape_count(s) / (batch > 0 ? batch : 1));
        rows[i] = lg_reshape(tape, parts[i], lg_shape2(batch, width));
    }
    return lg_concat(tape, rows, n, 1);
}

/* Variables x: the state (1, dim), or its half q or p for FORCE or VELOCITY; the parameters (P). */
static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    const settings *s = user;
    lg_system_taped_user bound;
    lg_taped_ode ode;
    lg_var y[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    const lg_coordinates coordinates = s->part == AMBIENT_FIELD ? LG_COORDINATES_AMBIENT : LG_COORDINATES_LIE;
    const lg_taped_time t = {.value = 0.2};
    size_t parts = 1;
    lg_status status = lg_system_taped_ode(s->system, coordinates, x[1], &ode, &bound);
    if (status == LG_OK && s->part == FORCE) {
        status = ode.force(ode.user, tape, t, x[0], LG_NONE, out);
    } else if (status == LG_OK && s->part == VELOCITY) {
        status = ode.velocity(ode.user, tape, t, x[0], LG_NONE, out);
    } else if (status == LG_OK) {
        parts = lg_taped_parts(&ode.space);
        status = lg_taped_split(tape, &ode.space, x[0], y);
        if (status == LG_OK) status = ode.field(ode.user, tape, t, y, LG_NONE, out);
    }
    if (status != LG_OK) return lg_tape_fail(tape, status, lg_system_name(s->system), "the field failed");
    return flat(tape, out, parts);
}

/* ---- a system with values for all parameters that have no default ---- */

/* Writes different values that the parameter's rule allows. */
static void fill_parameter(const lg_parameter_entry *p, size_t count, double *out) {
    static const double unit[3] = {2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0};
    for (size_t i = 0; i < count; i++) {
        const double number = 0.7 + 0.11 * (double)i;
        out[i] = p->rule == LG_PARAMETER_UNIT_VECTOR ? unit[i % 3] : number;
    }
}

static lg_system *system_of(const char *name, const char *form, size_t links) {
    double numbers[PARAMETERS_MAX];
    lg_named_values given[KEYS_MAX];
    lg_system_options options;
    lg_system *system = NULL;
    lg_error error = {0};
    size_t used = 0, keys = 0;
    for (const lg_parameter_entry *p = lg_system_parameters(name, form); p->key; p++) {
        const size_t count = p->count > 0 ? p->count : links;
        if (p->fallback != NULL || keys == KEYS_MAX || used + count > PARAMETERS_MAX) continue;
        fill_parameter(p, count, numbers + used);
        given[keys++] = (lg_named_values){p->key, numbers + used, count};
        used += count;
    }
    lg_system_options_init(&options);
    options.form = form;
    options.links = links;
    options.parameters = given;
    options.parameter_count = keys;
    if (lg_system_create(NULL, name, &options, &system, &error) != LG_OK) {
        fprintf(stderr, "lg-gradcheck: %s\n", error.message);
        return NULL;
    }
    return system;
}

/* ---- a state ---- */

static void draw(lg_rng *rng, size_t n, double *out) {
    for (size_t i = 0; i < n; i++) out[i] = 2.0 * lg_rng_uniform(rng) - 1.0;
}

/* Draws y = (q, v): q is a unit vector, v is orthogonal to it. */
static void draw_tangent(lg_rng *rng, double *y) {
    draw(rng, 6, y);
    const double length = sqrt(lg_dot3(y, y));
    for (int i = 0; i < 3; i++) y[i] /= length;
    const double along = lg_dot3(y, y + 3);
    for (int i = 0; i < 3; i++) y[3 + i] -= along * y[i];
}

static void draw_copy(lg_rng *rng, lg_space_kind kind, size_t state, double *y) {
    double u[3];
    draw(rng, state, y);
    if (kind == LG_SPACE_TS2) draw_tangent(rng, y);
    if (kind != LG_SPACE_SO3 && kind != LG_SPACE_SE3) return;
    draw(rng, 3, u);
    lg_so3_exp(u, y);
}

static void draw_state(const lg_space *space, double *y) {
    lg_rng rng;
    lg_rng_seed(&rng, 7, 0);
    for (size_t f = 0; f < space->factors; f++) {
        const lg_space_kind kind = space->factor[f].kind;
        const size_t state = lg_space_kind_entry(kind)->state;
        for (size_t i = 0; i < space->factor[f].count; i++, y += state) draw_copy(&rng, kind, state, y);
    }
}

/* ---- the cases ---- */

typedef struct made_row {
    char name[80];
    settings settings;
    lg_gradcheck_argument argument[2];
} made_row;

static lg_gradcheck_case *rows;
static size_t used, capacity;

static void add(lg_system *system, part which, const double *y) {
    static const char *const words[PARTS] = {"field", "ambient field", "force", "velocity"};
    const char *form = lg_system_form(system);
    const size_t half = which == FORCE || which == VELOCITY ? 2 : 1, dim = lg_system_dim(system) / half;
    if (used == capacity) return;
    made_row *own = lg_gradcheck_alloc(1, sizeof *own);
    char links[16] = "";
    if (lg_system_links(system) > 0) (void)snprintf(links, sizeof links, " k = %zu", lg_system_links(system));
    (void)snprintf(own->name, sizeof own->name, "system %s%s%s%s, %s", lg_system_name(system),
                   form ? " " : "", form ? form : "", links, words[which]);
    own->settings = (settings){system, which};
    own->argument[0] = (lg_gradcheck_argument){.shape = S2(1, (uint32_t)dim), .values = y, .scale = 0.25};
    own->argument[1] = (lg_gradcheck_argument){.shape = S1((uint32_t)lg_system_parameter_count(system)),
                                               .values = lg_system_parameter_values(system),
                                               .scale = 0.25};
    /* Chains in Lagrangian form are a custom operation, which programs cannot contain. */
    const bool custom = lg_system_links(system) > 0 && strcmp(form, "lagrangian") == 0;
    rows[used++] = (lg_gradcheck_case){.function = {.name = own->name,
                                                    .inputs = 2,
                                                    .arguments = own->argument,
                                                    .build = build,
                                                    .user = &own->settings},
                                       .no_program = custom ? "operation custom" : NULL};
}

static void add_system(const char *name, const char *form, size_t links) {
    lg_system_taped_user bound;
    lg_taped_ode ode;
    lg_system *system = system_of(name, form, links);
    if (system == NULL) exit(1);
    double *y = lg_gradcheck_alloc(lg_system_dim(system), sizeof *y);
    draw_state(lg_system_space(system), y);
    add(system, FIELD, y);
    if (lg_system_constrained(system) &&
        lg_system_taped_ode(system, LG_COORDINATES_AMBIENT, LG_NONE, &ode, &bound) == LG_OK)
        add(system, AMBIENT_FIELD, y);
    if (!lg_system_separable(system)) return;
    add(system, FORCE, y);
    add(system, VELOCITY, y);
}

/* The cases of every row in the table of systems; chains with one and with three links. They are made in the
 * first call and kept until the program ends. */
const lg_gradcheck_case *lg_gradcheck_mechanics(size_t *count) {
    const char *name, *form;
    size_t systems = 0;
    while (lg_system_at(systems, &name, &form)) systems++;
    if (rows == NULL) {
        capacity = 2 * PARTS * systems;
        rows = lg_gradcheck_alloc(capacity, sizeof *rows);
        for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
            add_system(name, form, 1);
            if (strcmp(name, "pendulum-chain") == 0) add_system(name, form, 3);
        }
    }
    *count = used;
    return rows;
}
