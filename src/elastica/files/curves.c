/* Files with sets of curves: /boundary (n, 8), /q and /v (n, N + 1, 2), /energy, /x, /case (n). */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/elastica.h"

#include "core/median.h"
#include "files/h5.h"
#include "settings/names.h"

#define END_TOLERANCE 1e-6
#define STIFFNESS     10.0
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

/* ---- reading ---- */

typedef struct read_call {
    const lg_context *context;
    const char *path;
    lg_h5 *h5;
    lg_elastica_data *out;
} read_call;

static lg_status get_doubles(read_call *call, const char *name, uint32_t rank, uint64_t dims[4], double **out,
                             lg_error *error) {
    return lg_missing_is_format(lg_h5_get_doubles(call->h5, name, rank, dims, out, error), error);
}

/* Reads an array of nodes or tangents (n, N + 1, 2). */
static lg_status read_nodes(read_call *call, const char *name, uint64_t dims[4], double **out,
                            lg_error *error) {
    LG_TRY(get_doubles(call, name, 3, dims, out, error));
    if (dims[1] < LG_ELASTICA_MIN_INTERVALS + 1 || dims[1] > LG_ELASTICA_MAX_INTERVALS + 1 || dims[2] != 2)
        return lg_fail(
            error, LG_FORMAT, "%s: /%s: shape (%llu, %llu, %llu), expected (n, N + 1, 2) with N of %d to %d",
            lg_shown_path(call->path), name, (unsigned long long)dims[0], (unsigned long long)dims[1],
            (unsigned long long)dims[2], LG_ELASTICA_MIN_INTERVALS, LG_ELASTICA_MAX_INTERVALS);
    return LG_OK;
}

static lg_status wrong_count(const read_call *call, const char *name, uint64_t got, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s: /%s: has %llu curves, but /boundary has %zu",
                   lg_shown_path(call->path), name, (unsigned long long)got, call->out->curves.count);
}

static lg_status read_arrays(read_call *call, lg_error *error) {
    lg_elastica_curves *c = &call->out->curves;
    uint64_t boundary[4], q[4], v[4];
    const char *shown = lg_shown_path(call->path);
    LG_TRY(get_doubles(call, "boundary", 2, boundary, &c->boundary, error));
    if (boundary[0] < 1 || boundary[1] != BOUNDARY)
        return lg_fail(error, LG_FORMAT, "%s: /boundary: shape (%llu, %llu), expected (n, 8) with n >= 1",
                       shown, (unsigned long long)boundary[0], (unsigned long long)boundary[1]);
    c->count = (size_t)boundary[0];
    LG_TRY(read_nodes(call, "q", q, &c->q, error));
    if (q[0] != c->count) return wrong_count(call, "q", q[0], error);
    LG_TRY(read_nodes(call, "v", v, &c->v, error));
    if (v[0] != c->count) return wrong_count(call, "v", v[0], error);
    if (v[1] != q[1])
        return lg_fail(error, LG_FORMAT, "%s: /v: has %llu nodes per curve, but /q has %llu", shown,
                       (unsigned long long)v[1], (unsigned long long)q[1]);
    c->intervals = (uint32_t)(q[1] - 1);
    return LG_OK;
}

static lg_status kinds_of(read_call *call, const double *values, lg_error *error) {
    lg_elastica_curves *c = &call->out->curves;
    for (size_t i = 0; i < c->count; i++)
        if (!(values[i] == floor(values[i]) && values[i] >= 0 && values[i] < LG_ELASTICA_CASE_COUNT))
            return lg_fail(error, LG_FORMAT, "%s: /case: is %g at index (%zu), expected 0 to %d",
                           lg_shown_path(call->path), values[i], i, LG_ELASTICA_CASE_COUNT - 1);
    c->kind = lg_alloc(call->context, c->count, sizeof *c->kind);
    if (c->kind == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(call->path));
    for (size_t i = 0; i < c->count; i++) c->kind[i] = (uint32_t)values[i];
    return LG_OK;
}

/* Reads /case, whole numbers in any number type, because other programs write floats. */
static lg_status read_kinds(read_call *call, lg_error *error) {
    double *values = NULL;
    uint64_t dims[4];
    if (!lg_h5_has(call->h5, "case")) return LG_OK;
    LG_TRY(get_doubles(call, "case", 1, dims, &values, error));
    const lg_status status = dims[0] == call->out->curves.count ? kinds_of(call, values, error)
                                                                : wrong_count(call, "case", dims[0], error);
    lg_free(call->context, values);
    return status;
}

static lg_status read_optional(read_call *call, lg_error *error) {
    lg_elastica_curves *c = &call->out->curves;
    const struct {
        const char *name;
        double **out;
    } arrays[] = {{"energy", &c->energy}, {"x", &c->x}};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) {
        uint64_t dims[4];
        if (!lg_h5_has(call->h5, arrays[i].name)) continue;
        LG_TRY(get_doubles(call, arrays[i].name, 1, dims, arrays[i].out, error));
        if (dims[0] != c->count) return wrong_count(call, arrays[i].name, dims[0], error);
    }
    return read_kinds(call, error);
}

/* ---- checks of the curves ---- */

static bool near(double a, double b) {
    return fabs(a - b) <= END_TOLERANCE * (1 + fabs(b));
}

static lg_status check_ends(const read_call *call, lg_error *error) {
    const lg_elastica_curves *c = &call->out->curves;
    const size_t row = 2 * ((size_t)c->intervals + 1), last = row - 2;
    const struct {
        const char *name;
        const double *values;
        size_t node, at;
    } ends[] = {{"q", c->q, 0, Q0}, {"v", c->v, 0, V0}, {"q", c->q, last, QN}, {"v", c->v, last, VN}};
    for (size_t i = 0; i < c->count; i++) {
        const double *b = c->boundary + BOUNDARY * i;
        if (!near(hypot(b[V0], b[V0 + 1]), 1) || !near(hypot(b[VN], b[VN + 1]), 1))
            return lg_fail(error, LG_FORMAT,
                           "%s: /boundary: a tangent of curve (%zu) has length %.9g or %.9g, not 1",
                           lg_shown_path(call->path), i, hypot(b[V0], b[V0 + 1]), hypot(b[VN], b[VN + 1]));
        for (size_t e = 0; e < LG_COUNT(ends); e++) {
            const double *node = ends[e].values + row * i + ends[e].node, *wanted = b + ends[e].at;
            if (near(node[0], wanted[0]) && near(node[1], wanted[1])) continue;
            return lg_fail(error, LG_FORMAT,
                           "%s: /%s: curve (%zu) %s at (%.9g, %.9g), /boundary says (%.9g, %.9g)",
                           lg_shown_path(call->path), ends[e].name, i, ends[e].node == 0 ? "begins" : "ends",
                           node[0], node[1], wanted[0], wanted[1]);
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
    return squares > 0 ? intervals * products / squares : (double)NAN;
}

/* Rounds to three significant digits, which changes the length by at most 0.5 %. This is meant to give the
 * value that was set in the program that wrote the file. */
static double rounded(double x) {
    const double unit = pow(10, floor(log10(x)) - 2);
    return unit >= 1 ? round(x / unit) * unit : round(x / unit) / round(1 / unit);
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

static lg_status estimate_length(const read_call *call, lg_error *error) {
    lg_elastica_curves *c = &call->out->curves;
    double *lengths = lg_alloc(call->context, c->count, sizeof *lengths);
    if (lengths == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(call->path));
    const double length = agreed_length(c, lengths);
    lg_free(call->context, lengths);
    if (!(length >= 1e-100 && length <= 1e100))
        return lg_fail(error, LG_FORMAT, "%s: /q: the length of the curves is %g, expected 1e-100 to 1e100",
                       lg_shown_path(call->path), length);
    c->length = rounded(length);
    return LG_OK;
}

static lg_status positive_attribute(const read_call *call, const char *name, double *out, lg_error *error) {
    LG_TRY(lg_h5_number(call->h5, "", name, LG_ELEMENT_F64, out, error));
    if (*out > 0 && *out <= DBL_MAX) return LG_OK;
    return lg_fail(error, isfinite(*out) ? LG_FORMAT : LG_NOT_FINITE,
                   "%s: attribute %s is %g, expected a positive number", lg_shown_path(call->path), name,
                   *out);
}

/* Checks that no curve is shorter than the distance of its ends. */
static lg_status check_length(const read_call *call, lg_error *error) {
    const lg_elastica_curves *c = &call->out->curves;
    for (size_t i = 0; i < c->count; i++) {
        const double *b = c->boundary + BOUNDARY * i;
        const double distance = hypot(b[QN] - b[Q0], b[QN + 1] - b[Q0 + 1]);
        if (!(distance <= c->length * (1 + END_TOLERANCE)))
            return lg_fail(error, LG_FORMAT,
                           "%s: attribute length is %g, but the ends of curve (%zu) are %g "
                           "apart",
                           lg_shown_path(call->path), c->length, i, distance);
    }
    return LG_OK;
}

static lg_status read_values(const read_call *call, lg_error *error) {
    char text[64];
    uint32_t value = 0;
    if (!lg_h5_has_attribute(call->h5, "", "values")) return LG_OK;
    const lg_status status = lg_h5_text(call->h5, "", "values", text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return status;
    const char *name = status == LG_OK ? lg_name_values(0) : NULL;
    while (name != NULL && strcmp(name, text) != 0) name = lg_name_values(++value);
    if (name == NULL)
        return lg_fail(error, LG_FORMAT, "%s: attribute values: expected 'discrete' or 'continuous'",
                       lg_shown_path(call->path));
    call->out->curves.continuous = value == 1;
    return LG_OK;
}

static lg_status read_attributes(read_call *call, lg_error *error) {
    lg_elastica_curves *c = &call->out->curves;
    c->stiffness = STIFFNESS;
    if (lg_h5_has_attribute(call->h5, "", "stiffness"))
        LG_TRY(positive_attribute(call, "stiffness", &c->stiffness, error));
    LG_TRY(read_values(call, error));
    if (!lg_h5_has_attribute(call->h5, "", "length")) return estimate_length(call, error);
    LG_TRY(positive_attribute(call, "length", &c->length, error));
    return check_length(call, error);
}

static lg_status read_checked(void *user, lg_h5 *h5, lg_error *error) {
    read_call *call = user;
    call->h5 = h5;
    LG_TRY(lg_h5_check_format(call->h5, "elastica", true, error));
    LG_TRY(read_arrays(call, error));
    LG_TRY(check_ends(call, error));
    LG_TRY(read_optional(call, error));
    LG_TRY(read_attributes(call, error));
    lg_h5_provenance(call->h5, &call->out->provenance);
    return LG_OK;
}

lg_status lg_elastica_data_read(const lg_context *context, const char *path, const lg_read_options *options,
                                lg_elastica_data *out, lg_error *error) {
    if (path == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the path or the place for the data is NULL");
    lg_elastica_data made = {.curves = {.context = context}};
    read_call call = {.context = context, .path = path, .out = &made};
    const lg_status status = lg_h5_read(context, path, options, read_checked, &call, error);
    if (status != LG_OK) {
        lg_elastica_data_destroy(&made);
        return status;
    }
    hash(&made);
    *out = made;
    return LG_OK;
}

/* ---- writing ---- */

/* An array of doubles to be written. `data` of optional arrays may be NULL. */
typedef struct array {
    const char *name;
    uint32_t rank;
    uint64_t dims[3];
    const double *data;
} array;

enum { ARRAYS = 5 };

static void list_arrays(const lg_elastica_curves *c, array out[ARRAYS]) {
    const uint64_t n = c->count, nodes = (uint64_t)c->intervals + 1;
    const array list[ARRAYS] = {{"boundary", 2, {n, BOUNDARY, 0}, c->boundary},
                                {"q", 3, {n, nodes, 2}, c->q},
                                {"v", 3, {n, nodes, 2}, c->v},
                                {"energy", 1, {n, 0, 0}, c->energy},
                                {"x", 1, {n, 0, 0}, c->x}};
    memcpy(out, list, sizeof list);
}

static lg_status check_written(const char *path, const lg_elastica_curves *c, lg_error *error) {
    array arrays[ARRAYS];
    list_arrays(c, arrays);
    if (!isfinite(c->length) || !isfinite(c->stiffness))
        return lg_fail(error, LG_NOT_FINITE, "%s: length or stiffness is not finite", lg_shown_path(path));
    if (c->length <= 0 || c->stiffness <= 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: length and stiffness must be positive",
                       lg_shown_path(path));
    for (size_t i = 0; i < ARRAYS; i++)
        if (arrays[i].data != NULL)
            LG_TRY(
                lg_check_finite(path, arrays[i].name, arrays[i].rank, arrays[i].dims, arrays[i].data, error));
    for (size_t i = 0; c->kind != NULL && i < c->count; i++)
        if (c->kind[i] >= LG_ELASTICA_CASE_COUNT)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: /case: is %u at index (%zu), expected 0 to %d",
                           lg_shown_path(path), c->kind[i], i, LG_ELASTICA_CASE_COUNT - 1);
    return LG_OK;
}

static lg_status put_all(lg_h5 *h5, const lg_elastica_data *data, lg_error *error) {
    const lg_elastica_curves *c = &data->curves;
    const uint64_t n = c->count;
    array arrays[ARRAYS];
    list_arrays(c, arrays);
    LG_TRY(lg_h5_put_header(h5, "elastica", &data->provenance, error));
    LG_TRY(lg_h5_put_number(h5, "", "length", LG_ELEMENT_F64, &c->length, error));
    LG_TRY(lg_h5_put_number(h5, "", "stiffness", LG_ELEMENT_F64, &c->stiffness, error));
    LG_TRY(lg_h5_put_text(h5, "", "values", lg_name_values(c->continuous), error));
    LG_TRY(lg_h5_put_text(h5, "", "data_sha256", data->sha256, error));
    for (size_t i = 0; i < ARRAYS; i++)
        if (arrays[i].data != NULL)
            LG_TRY(lg_h5_put(h5, arrays[i].name, LG_ELEMENT_F64, arrays[i].rank, arrays[i].dims,
                             arrays[i].data, error));
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
