/* The start of a scene: its numbers are put in the order of the state, a start that is off the manifold by
 * rounding is projected, and a part that was given under the other key (omega for p, p for omega) is
 * converted.
 */
#include "mechanics/files/scene_reading.h"

#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"

#define OFF_MANIFOLD 1e-6  /* a start farther from the manifold is an error */
#define ROUNDING     1e-14 /* a start nearer to the manifold is neither changed nor reported */

/* ---- the start: numbers ---- */

/* The state, and the line in the file of each of its numbers. */
typedef struct start {
    double *y;
    uint32_t *lines;
    double *numbers; /* numbers of one part in the order of the file; room for dim */
    uint32_t *number_lines;
    bool other; /* the part own_key was given under other_key */
} start;

static size_t key_of_part(const reading *r, const start *s, size_t part) {
    const scene_table *table = r->table;
    const bool other = s->other && strcmp(table->parts[part].key, table->own_key) == 0;
    return other ? table->other_at : table->parts_at + part;
}

static lg_status read_part(const reading *r, start *s, size_t part) {
    const lg_state_entry *row = &r->table->parts[part];
    const size_t at = key_of_part(r, s, part), size = row->rows * row->columns;
    const size_t shape[3] = {per_link(row->outer, r->links), row->rows, row->columns};
    const lg_key_value *value = &r->table->values[at];
    const bool given = value->line != 0;
    if (given)
        LG_TRY(
            lg_yaml_block(r->yaml, &r->table->keys[at], value, shape, s->numbers, s->number_lines, r->error));
    for (size_t block = 0; block < shape[0]; block++) {
        for (size_t i = 0; i < size; i++) {
            const size_t to = row->first + block * row->stride + i, from = block * size + i;
            s->y[to] = given ? s->numbers[from] : row->fallback[i];
            s->lines[to] = given ? s->number_lines[from] : r->out->line_initial;
        }
    }
    return LG_OK;
}

/* Checks that exactly one of own_key and other_key is given, and sets s->other. */
static lg_status check_alternatives(const reading *r, start *s) {
    const scene_table *table = r->table;
    if (table->other_at == 0) return LG_OK;
    size_t part = 0;
    while (strcmp(table->parts[part].key, table->own_key) != 0) part++;
    const lg_key_value *own = &table->values[table->parts_at + part],
                       *other = &table->values[table->other_at];
    s->other = other->line != 0;
    if ((own->line != 0) != s->other) return LG_OK;
    if (s->other)
        return LG_SCENE_FAULT(r, r->out->line_initial, "initial: give either %s or %s, not both",
                              table->own_key, table->other_key);
    return LG_SCENE_FAULT(r, r->out->line_initial, "key 'initial.%s' (or 'initial.%s') is missing",
                          table->own_key, table->other_key);
}

/* ---- the start: onto the manifold ---- */

/* The key in the file that gave number `offset` of the state. *block becomes its block, counted from 1. */
static const char *find_source(const reading *r, const start *s, size_t offset, size_t *block) {
    const lg_state_entry *parts = r->table->parts;
    for (size_t i = 0; parts[i].key != NULL; i++) {
        const size_t blocks = per_link(parts[i].outer, r->links), stride = parts[i].stride;
        if (offset < parts[i].first) continue;
        const size_t from = offset - parts[i].first;
        *block = (stride > 0 ? from / stride : 0) + 1;
        if (*block <= blocks && from - (*block - 1) * stride < parts[i].rows * parts[i].columns)
            return r->table->keys[key_of_part(r, s, i)].name;
    }
    *block = 1;
    return "initial";
}

static void note(lg_scene *out, double off) {
    if (off > ROUNDING) out->projected = true;
    if (off > out->projection) out->projection = off;
}

static double norm3(const double *a) {
    return sqrt(lg_dot3(a, a));
}

/* Projects (q, w) at offset `at` onto TS^2: q/|q|, w - q (q.w). Fails if they are off by more than
 * OFF_MANIFOLD; a smaller distance is noted for a warning. */
static lg_status place_on_sphere(const reading *r, start *s, size_t at) {
    size_t block;
    double *q = s->y + at, *w = q + 3, length = norm3(q), off_sphere = fabs(length - 1);
    if (!(off_sphere <= OFF_MANIFOLD)) {
        const char *key = find_source(r, s, at, &block);
        return LG_SCENE_FAULT(r, s->lines[at],
                              "%s: row %zu is off the sphere: its length is %.9g, expected 1 within %g", key,
                              block, length, OFF_MANIFOLD);
    }
    const double scale = off_sphere > ROUNDING ? 1 / length : 1;
    for (int i = 0; i < 3; i++) q[i] *= scale;
    double along = lg_dot3(q, w);
    const double off_tangent = along != 0 ? fabs(along) / norm3(w) : 0;
    if (!(off_tangent <= OFF_MANIFOLD)) {
        const char *key = find_source(r, s, at + 3, &block);
        return LG_SCENE_FAULT(r, s->lines[at + 3],
                              "%s: row %zu is not orthogonal to q: their dot product is %.9g, expected 0",
                              key, block, along);
    }
    if (off_tangent <= ROUNDING) along = 0;
    for (int i = 0; i < 3; i++) w[i] -= along * q[i];
    note(r->out, fmax(off_sphere, off_tangent));
    return LG_OK;
}

static double determinant(const double *a) {
    double minors[3];
    lg_cross3(a + 3, a + 6, minors);
    return lg_dot3(a, minors);
}

/* Does the same for the rotation at offset `at`, the first nine numbers of a copy of SO(3) or SE(3). */
static lg_status place_rotation(const reading *r, start *s, size_t at) {
    const lg_space_entry *so3 = lg_space_kind_entry(LG_SPACE_SO3);
    double *rotation = s->y + at;
    const double off = so3->manifold_error(1, rotation), det = determinant(rotation);
    if (!(off <= OFF_MANIFOLD)) {
        size_t block;
        const char *key = find_source(r, s, at, &block);
        return LG_SCENE_FAULT(r, s->lines[at],
                              "%s: matrix %zu is not a rotation: its transpose times itself differs from the "
                              "identity by %.3g, and its determinant is %.9g",
                              key, block, off, det);
    }
    if (off > ROUNDING) so3->project(1, rotation);
    note(r->out, off);
    return LG_OK;
}

static lg_status place(const reading *r, start *s) {
    const lg_space *space = lg_system_space(r->out->system);
    size_t at = 0;
    for (size_t f = 0; f < space->factors; f++) {
        const lg_space_kind kind = space->factor[f].kind;
        const size_t numbers = lg_space_kind_entry(kind)->state;
        for (size_t i = 0; i < space->factor[f].count; i++, at += numbers) {
            if (kind == LG_SPACE_TS2) LG_TRY(place_on_sphere(r, s, at));
            if (kind == LG_SPACE_SO3 || kind == LG_SPACE_SE3) LG_TRY(place_rotation(r, s, at));
        }
    }
    if (r->out->projected)
        lg_log_message(r->context, LG_LOG_WARNING,
                       "%s: line %u: the start was off the manifold by %.3g and was projected",
                       lg_yaml_path(r->yaml), r->out->line_initial, r->out->projection);
    return LG_OK;
}

/* If the part was given under other_key, converts it to own_key. */
static lg_status convert(const reading *r, start *s) {
    const lg_system *system = r->out->system;
    if (!s->other) return LG_OK;
    LG_TRY_SCRATCH(char, work, r->context, lg_system_work_size(system), lg_scene_no_memory(r));
    const bool momenta = strcmp(r->table->own_key, "p") == 0;
    const lg_status status =
        (momenta ? lg_chain_momenta : lg_chain_velocities)(system, s->y, s->y, (double *)(void *)work);
    if (status == LG_OK) return LG_OK;
    return LG_SCENE_FAULT(r, r->out->line_initial, "initial: %s cannot be computed from %s: %s",
                          r->table->own_key, r->table->other_key, lg_status_sentence(status));
}

lg_status lg_scene_read_start(reading *r) {
    const size_t dim = lg_system_dim(r->out->system);
    LG_SCRATCH(double, y, r->context, dim);
    LG_SCRATCH(double, numbers, r->context, dim);
    LG_SCRATCH(uint32_t, lines, r->context, (2 * dim));
    if (y == NULL || numbers == NULL || lines == NULL) return lg_scene_no_memory(r);
    start s = {.y = y, .numbers = numbers, .lines = lines, .number_lines = lines + dim};
    for (size_t i = 0; i < dim; i++) s.lines[i] = r->out->line_initial;
    LG_TRY(check_alternatives(r, &s));
    for (size_t i = 0; r->table->parts[i].key != NULL; i++) LG_TRY(read_part(r, &s, i));
    LG_TRY(place(r, &s));
    LG_TRY(convert(r, &s));
    r->out->state = LG_KEEP(y);
    return LG_OK;
}
