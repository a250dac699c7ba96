/* Files with sets of curves: /boundary (n, 8), /q and /v (n, N + 1, 2), /energy, /x, /case (n). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/elastica.h"

#include "core/median.h"
#include "files/h5.h"
#include "settings/files/attributes.h"

#define END_TOLERANCE   1e-6
#define USUAL_STIFFNESS 10.0
enum { BOUNDARY = 8, Q0 = 0, V0 = 2, QN = 4, VN = 6 };

void lg_elastica_data_destroy(lg_elastica_data *data) {
    if (data == NULL) return;
    lg_elastica_curves_destroy(&data->curves);
    *data = (lg_elastica_data){.sha256 = ""};
}

static void hash(lg_elastica_data *data) {
    const lg_elastica_curves *c = &data->curves;
    const size_t nodes = c->count * ((size_t)c->intervals + 1);
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add_doubles(&state, c->boundary, BOUNDARY * c->count);
    lg_sha256_add_doubles(&state, c->q, 2 * nodes);
    lg_sha256_add_doubles(&state, c->v, 2 * nodes);
    lg_sha256_finish(&state, data->sha256);
}

/* ---- the arrays of a file ---- */

enum { ARRAYS = 5 };

typedef struct sizes {
    lg_h5_size curves, boundary, nodes, plane;
} sizes;

static void list_arrays(lg_elastica_curves *c, sizes *s, lg_h5_array out[ARRAYS]) {
    *s = (sizes){{c->count, "curves", NULL},
                 {BOUNDARY, NULL, NULL},
                 {c->intervals > 0 ? (uint64_t)c->intervals + 1 : 0, "nodes", NULL},
                 {2, NULL, NULL}};
    const lg_h5_array list[ARRAYS] = {{"boundary", &c->boundary, {&s->curves, &s->boundary}, false},
                                      {"q", &c->q, {&s->curves, &s->nodes, &s->plane}, false},
                                      {"v", &c->v, {&s->curves, &s->nodes, &s->plane}, false},
                                      {"energy", &c->energy, {&s->curves}, true},
                                      {"x", &c->x, {&s->curves}, true}};
    memcpy(out, list, sizeof list);
}

/* ---- reading ---- */

static lg_status read_arrays(lg_h5 *h5, lg_elastica_data *data, lg_error *error) {
    lg_elastica_curves *c = &data->curves;
    lg_h5_array arrays[ARRAYS];
    sizes s;
    list_arrays(c, &s, arrays);
    LG_TRY(lg_h5_get_arrays(h5, arrays, 2, error));
    if (s.nodes.n < LG_ELASTICA_MIN_INTERVALS + 1 || s.nodes.n > LG_ELASTICA_MAX_INTERVALS + 1)
        return lg_h5_fail(h5, error, "/q: has %llu nodes, expected N + 1 with N of %d to %d",
                          (unsigned long long)s.nodes.n, LG_ELASTICA_MIN_INTERVALS,
                          LG_ELASTICA_MAX_INTERVALS);
    c->count = (size_t)s.curves.n;
    c->intervals = (uint32_t)(s.nodes.n - 1);
    return lg_h5_get_arrays(h5, arrays + 2, ARRAYS - 2, error);
}

/* Reads /case, whole numbers in any number type, because other programs write floats. */
static lg_status read_kinds(lg_h5 *h5, lg_elastica_data *data, lg_error *error) {
    lg_elastica_curves *c = &data->curves;
    lg_h5_about about;
    lg_h5_size curves = {c->count, "curves", NULL};
    const lg_h5_array kinds = {.name = "case", .dims = {&curves}};
    if (!lg_h5_has(h5, "case")) return LG_OK;
    LG_TRY(lg_h5_fit(h5, &kinds, sizeof(int64_t), false, &about, error));
    LG_TRY_SCRATCH(int64_t, values, h5->context, c->count, lg_h5_no_memory(h5, error));
    LG_TRY(lg_h5_get_wholes(h5, "case", &about, values, error));
    c->kind = lg_alloc(h5->context, c->count, sizeof *c->kind);
    if (c->kind == NULL) return lg_h5_no_memory(h5, error);
    return lg_h5_narrow(h5, "case", values, c->count, LG_ELASTICA_CASE_COUNT - 1, c->kind, error);
}

/* ---- checks of the curves ---- */

static bool near(double a, double b) {
    return fabs(a - b) <= END_TOLERANCE * (1 + fabs(b));
}

static lg_status check_ends(lg_h5 *h5, lg_elastica_data *data, lg_error *error) {
    const lg_elastica_curves *c = &data->curves;
    const size_t row = 2 * ((size_t)c->intervals + 1), last = row - 2;
    const struct {
        const char *name;
        const double *values;
        size_t node, at;
    } ends[] = {{"q", c->q, 0, Q0}, {"v", c->v, 0, V0}, {"q", c->q, last, QN}, {"v", c->v, last, VN}};
    for (size_t i = 0; i < c->count; i++) {
        const double *b = c->boundary + BOUNDARY * i;
        if (!near(hypot(b[V0], b[V0 + 1]), 1) || !near(hypot(b[VN], b[VN + 1]), 1))
            return lg_h5_fail(
                h5, error, "/boundary: a tangent of curve (%zu) has length %.9g or %.9g, not 1: normalise it",
                i, hypot(b[V0], b[V0 + 1]), hypot(b[VN], b[VN + 1]));
        for (size_t e = 0; e < LG_COUNT(ends); e++) {
            const double *node = ends[e].values + row * i + ends[e].node, *wanted = b + ends[e].at;
            if (near(node[0], wanted[0]) && near(node[1], wanted[1])) continue;
            return lg_h5_fail(h5, error, "/%s: curve (%zu) %s at (%.9g, %.9g), /boundary says (%.9g, %.9g)",
                              ends[e].name, i, ends[e].node == 0 ? "begins" : "ends", node[0], node[1],
                              wanted[0], wanted[1]);
        }
    }
    return LG_OK;
}

/* ---- attributes ---- */

/* Length of a curve whose nodes are joined by circular arcs: an arc that turns by phi has a chord of
 * sin(phi/2)/(phi/2) times its length. */
static double arc_length(const double *q, const double *v, uint32_t intervals) {
    double sum = 0;
    for (uint32_t k = 0; k < intervals; k++, q += 2, v += 2) {
        const double half = 0.5 * fabs(atan2(v[0] * v[3] - v[1] * v[2], v[0] * v[2] + v[1] * v[3]));
        const double chord = hypot(q[2] - q[0], q[3] - q[1]);
        sum += half < 1e-8 ? chord : chord * half / sin(half);
    }
    return sum;
}

/* Length of a curve that minimises the discrete energy (liegrad/elastica.h). For such a curve
 *   q_{k+1} - q_k - (h/2)(v_k + v_{k+1})
 * is the same for all k. So h is the regression coefficient of the second differences of q on the differences
 * (v_{k+1} - v_{k-1})/2. NaN for a straight curve. */
static double trapezoid_length(const double *q, const double *v, uint32_t intervals) {
    double products = 0, squares = 0;
    for (size_t i = 0; i < 2 * (size_t)(intervals - 1); i++) {
        const double bend = q[i + 4] - 2 * q[i + 2] + q[i], turn = 0.5 * (v[i + 4] - v[i]);
        products += bend * turn;
        squares += turn * turn;
    }
    return squares > 0 ? intervals * products / squares : NAN;
}

/* Returns the median length of the curves. Of the two ways to estimate the length, the one is used whose
 * results differ less between the curves (from the 10th to the 90th percentile). */
static double agreed_length(const lg_elastica_curves *c, double *lengths) {
    static double (*const rules[])(const double *, const double *, uint32_t) = {arc_length, trapezoid_length};
    const size_t row = 2 * ((size_t)c->intervals + 1), n = c->count;
    double median = NAN, least = INFINITY;
    for (size_t r = 0; r < LG_COUNT(rules); r++) {
        size_t known = 0;
        for (size_t i = 0; i < n; i++) {
            lengths[known] = rules[r](c->q + row * i, c->v + row * i, c->intervals);
            if (isfinite(lengths[known])) known++;
        }
        if (known == 0) continue;
        qsort(lengths, known, sizeof *lengths, lg_compare_doubles);
        const double spread = lengths[(known - 1) * 9 / 10] - lengths[known / 10];
        if (!(spread < least)) continue;
        least = spread;
        median = lengths[known / 2];
    }
    return median;
}

static lg_status estimate_length(lg_h5 *h5, lg_elastica_data *data, lg_error *error) {
    lg_elastica_curves *c = &data->curves;
    LG_TRY_SCRATCH(double, lengths, h5->context, c->count, lg_h5_no_memory(h5, error));
    const double length = agreed_length(c, lengths);
    if (!(length >= 1e-100 && length <= 1e100))
        return lg_h5_fail(h5, error, "/q: the length of the curves is %g, expected 1e-100 to 1e100", length);
    /* Rounding to three significant digits, which changes the length by at most 0.5 %, is meant to give the
     * value that was set in the program that wrote the file. */
    const double unit = pow(10, floor(log10(length)) - 2);
    c->length = unit >= 1 ? round(length / unit) * unit : round(length / unit) / round(1 / unit);
    return LG_OK;
}

#define ROW(type, name, member, ...) LG_FIELD(lg_elastica_curves, "", name, type, member, __VA_ARGS__)
static const lg_field attributes[] = {ROW(REAL, "length", length, LG_POSITIVE),
                                      ROW(REAL, "stiffness", stiffness, LG_POSITIVE),
                                      ROW(NAME, "values", continuous, LG_NAMES("discrete", "continuous"))};

/* Checks that no curve is shorter than the distance of its ends. */
static lg_status check_length(lg_h5 *h5, lg_elastica_data *data, lg_error *error) {
    const lg_elastica_curves *c = &data->curves;
    for (size_t i = 0; i < c->count; i++) {
        const double *b = c->boundary + BOUNDARY * i;
        const double distance = hypot(b[QN] - b[Q0], b[QN + 1] - b[Q0 + 1]);
        if (!(distance <= c->length * (1 + END_TOLERANCE)))
            return lg_h5_fail(h5, error, "attribute length is %g, but the ends of curve (%zu) are %g apart",
                              c->length, i, distance);
    }
    return LG_OK;
}

static lg_status read_attributes(lg_h5 *h5, lg_elastica_data *data, lg_error *error) {
    lg_elastica_curves *c = &data->curves;
    c->stiffness = USUAL_STIFFNESS;
    for (const lg_field *row = attributes; row < attributes + LG_COUNT(attributes); row++)
        if (lg_h5_has_attribute(h5, "", row->name)) LG_TRY(lg_field_get(h5, row, c, error));
    return lg_h5_has_attribute(h5, "", "length") ? check_length(h5, data, error)
                                                 : estimate_length(h5, data, error);
}

static lg_status read_checked(void *user, lg_h5 *h5, lg_error *error) {
    lg_elastica_data *data = user;
    LG_TRY(lg_h5_check_format(h5, "elastica", true, error));
    LG_TRY(read_arrays(h5, data, error));
    LG_TRY(check_ends(h5, data, error));
    LG_TRY(read_kinds(h5, data, error));
    LG_TRY(read_attributes(h5, data, error));
    lg_h5_provenance(h5, &data->provenance);
    return LG_OK;
}

lg_status lg_elastica_data_read(const lg_context *context, const char *path, const lg_read_options *options,
                                lg_elastica_data *out, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_elastica_data_destroy) lg_elastica_data made = {.curves = {.context = context}};
    LG_TRY(lg_h5_read(context, path, options, read_checked, &made, error));
    hash(&made);
    return LG_GIVE(out, made);
}

/* ---- writing ---- */

static lg_status check_written(const char *path, const lg_elastica_curves *c, lg_error *error) {
    for (size_t i = 0; i < LG_COUNT(attributes); i++)
        LG_TRY(lg_field_check(path, &attributes[i], c, LG_INVALID_ARGUMENT, error));
    for (size_t i = 0; c->kind != NULL && i < c->count; i++)
        if (c->kind[i] >= LG_ELASTICA_CASE_COUNT)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: /case: is %u at index (%zu), expected 0 to %d",
                           lg_shown_path(path), c->kind[i], i, LG_ELASTICA_CASE_COUNT - 1);
    return LG_OK;
}

static lg_status put_all(lg_h5 *h5, const lg_elastica_data *data, lg_error *error) {
    const lg_elastica_curves *c = &data->curves;
    const uint64_t n = c->count;
    lg_elastica_curves copy =
        *c; /* a copy that is only read, because the list takes pointers without const */
    lg_h5_array arrays[ARRAYS];
    sizes s;
    list_arrays(&copy, &s, arrays);
    LG_TRY(lg_h5_put_header(h5, "elastica", &data->provenance, error));
    for (size_t i = 0; i < LG_COUNT(attributes); i++) LG_TRY(lg_field_write(h5, &attributes[i], c, error));
    LG_TRY(lg_h5_put_text(h5, "", "data_sha256", data->sha256, error));
    LG_TRY(lg_h5_put_arrays(h5, arrays, ARRAYS, error));
    return c->kind != NULL ? lg_h5_put(h5, "case", LG_ELEMENT_U32, 1, &n, c->kind, error) : LG_OK;
}

lg_status lg_elastica_data_write(const lg_context *context, const char *path, lg_elastica_data *data,
                                 lg_error *error) {
    if (path == NULL || data == NULL || data->curves.boundary == NULL || data->curves.q == NULL ||
        data->curves.v == NULL || data->curves.count < 1 ||
        data->curves.intervals < LG_ELASTICA_MIN_INTERVALS ||
        data->curves.intervals > LG_ELASTICA_MAX_INTERVALS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "to write curves, a path, boundary conditions and nodes are needed");
    lg_h5 *h5;
    LG_TRY(check_written(path, &data->curves, error));
    LG_TRY(lg_h5_create(context, path, &h5, error));
    hash(data);
    return lg_h5_finish(h5, put_all(h5, data, error), error);
}
