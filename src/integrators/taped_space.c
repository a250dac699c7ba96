/* Spaces on the tape: parts, actions, brackets, dexpinv, generators and projections. A table has one row per
 * kind of factor. */
#include "integrators/taped_internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "integrators/series.h"
#include "liegrad/ops.h"

/* ---- rows ---- */

/* Turns matrices (B, k, 9) into (B, k, 3, 3) whose rows are the matrices' columns; from_columns inverts
 * it. */
static lg_var columns_of(lg_tape *tape, lg_var X) {
    const lg_shape s = lg_var_shape(tape, X);
    return lg_transpose(tape, lg_reshape(tape, X, lg_shape4(s.dims[0], s.dims[1], 3, 3)));
}

static lg_var from_columns(lg_tape *tape, lg_var columns) {
    const lg_shape s = lg_var_shape(tape, columns);
    return lg_reshape(tape, lg_transpose(tape, columns), lg_shape3(s.dims[0], s.dims[1], 9));
}

/* Repeats each of the vectors (B, k, 3) three times, once per column of columns_of: (B, k, 3, 3). */
static lg_var beside_columns(lg_tape *tape, lg_var u) {
    const lg_shape s = lg_var_shape(tape, u);
    lg_var one = lg_reshape(tape, u, lg_shape4(s.dims[0], s.dims[1], 1, 3));
    return lg_broadcast_to(tape, one, lg_shape4(s.dims[0], s.dims[1], 3, 3));
}

/* ---- actions: exp(a) . y ---- */

static void act_rn(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    out[0] = lg_add(tape, y[0], a[0]);
}

/* exp(u, v) . (q, p) = (R q, R p + (dexp_u v) x R q), R = exp(u); see lg_se3_exp_act. */
static void act_ts2(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    lg_var p = lg_se3_act_rows(tape, a[0], a[1], y[0], y[1]);
    out[0] = lg_so3_exp_rows(tape, a[0], y[0]);
    out[1] = p;
}

/* (exp(u) R, exp(u) r + dexp_u v) */
static void act_se3(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    lg_var r = lg_so3_exp_rows(tape, a[0], y[1]), shift = lg_so3_dexp_rows(tape, a[0], a[1]);
    out[0] = lg_so3_exp_rows(tape, a[0], y[0]);
    out[1] = lg_add(tape, r, shift);
}

/* exp(u) times a matrix (SO(3)) or a vector (so(3)*) */
static void act_so3(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    out[0] = lg_so3_exp_rows(tape, a[0], y[0]);
}

/* ---- generators: a . y ---- */

static void generator_rn(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    out[0] = a[0];
}

static void cross_one(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    out[0] = lg_cross(tape, a[0], y[0]);
}

/* out = (u x x1, u x x2 + v x x1) for a = (u, v) and x = (x1, x2): the generator on T*S^2 and se(3)*, and the
 * bracket of se(3) */
static void cross_two(lg_tape *tape, const lg_var *a, const lg_var *x, lg_var *out) {
    lg_var u = lg_cross(tape, a[0], x[0]);
    lg_var v = lg_add(tape, lg_cross(tape, a[0], x[1]), lg_cross(tape, a[1], x[0]));
    out[0] = u;
    out[1] = v;
}

static void generator_so3(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    lg_var U = beside_columns(tape, a[0]), columns = columns_of(tape, y[0]);
    out[0] = from_columns(tape, lg_cross(tape, U, columns));
}

/* (hat(u) R, u x r + v) */
static void generator_se3(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    lg_var r = lg_add(tape, lg_cross(tape, a[0], y[1]), a[1]);
    generator_so3(tape, a, y, out);
    out[1] = r;
}

/* ---- dexpinv, closed forms ---- */

static void dexpinv_so3(lg_tape *tape, const lg_var *a, const lg_var *b, lg_var *out) {
    out[0] = lg_so3_dexpinv_rows(tape, a[0], b[0]);
}

static void dexpinv_se3(lg_tape *tape, const lg_var *a, const lg_var *b, lg_var *out) {
    lg_var v = lg_se3_dexpinv_rows(tape, a[0], a[1], b[0], b[1]);
    out[0] = lg_so3_dexpinv_rows(tape, a[0], b[0]);
    out[1] = v;
}

/* ---- projections ---- */

/* q / |q|, p - q (q.p) */
static void project_ts2(lg_tape *tape, const lg_var *y, lg_var *out) {
    lg_var q = lg_div(tape, y[0], lg_sqrt(tape, lg_rownorm2(tape, y[0])));
    out[1] = lg_sub(tape, y[1], lg_mul(tape, q, lg_rowdot(tape, q, y[1])));
    out[0] = q;
}

/* Returns (X + X^-T)/2 for matrices X (N, 3, 3), NaN where det X is not positive. *change becomes the sum of
 * the squares of all entries of X^-T - X. */
static lg_var polar_step(lg_tape *tape, lg_var X, lg_var *change) {
    lg_var row[3], cofactor[3];
    for (uint32_t i = 0; i < 3; i++) row[i] = lg_slice(tape, X, 1, i, 1);
    for (int i = 0; i < 3; i++) cofactor[i] = lg_cross(tape, row[(i + 1) % 3], row[(i + 2) % 3]);
    lg_var determinant = lg_rowdot(tape, row[0], cofactor[0]);
    lg_var scale = lg_square(tape, lg_pow(tape, determinant, -0.5));
    lg_var step = lg_sub(tape, lg_mul(tape, lg_concat(tape, cofactor, 3, 1), scale), X);
    *change = lg_sum(tape, lg_square(tape, step));
    return lg_taped_moved(tape, X, 0.5, step);
}

/* The orthogonal polar factors of X (B, k, 9), see lg_so3_project. The error after a step is half the square
 * of the error before. The iteration ends with the third step whose change is at most 1e-4: then only
 * rounding errors are left, and derivatives of order below 8 are exact. */
static lg_var polar(lg_tape *tape, lg_var X) {
    enum { LONGEST = 100 };
    const lg_shape shape = lg_var_shape(tape, X);
    lg_var R = lg_reshape(tape, X, lg_shape3(shape.dims[0] * shape.dims[1], 3, 3));
    double change = 1.0;
    for (int more = 3, n = 0; more > 0 && n < LONGEST && isfinite(change); n++) {
        lg_var squared;
        R = polar_step(tape, R, &squared);
        if (lg_read(tape, squared, 1, &change) != LG_OK) return LG_NONE;
        if (change <= 1e-8) more--;
    }
    return lg_reshape(tape, R, shape);
}

static void project_so3(lg_tape *tape, const lg_var *y, lg_var *out) {
    out[0] = polar(tape, y[0]);
}

static void project_se3(lg_tape *tape, const lg_var *y, lg_var *out) {
    out[1] = y[1];
    out[0] = polar(tape, y[0]);
}

/* ---- the table ---- */

/* One row per kind of factor. `state` and `algebra` are the widths of the parts: how many numbers of one copy
 * a part has, in the order of the plain state (R^n has one part with all its copies). `bracket` and `dexpinv`
 * are NULL if the group is abelian, `project` is NULL if every point is on the manifold. */
typedef void (*pair_fn)(lg_tape *, const lg_var *a, const lg_var *b, lg_var *out);
typedef struct factor_row {
    uint32_t parts, state[2], algebra[2];
    pair_fn act, generator, bracket, dexpinv;
    void (*project)(lg_tape *, const lg_var *y, lg_var *out);
} factor_row;

static const factor_row rows[LG_SPACE_KINDS] = {
    [LG_SPACE_RN] = {1, {1, 0}, {1, 0}, act_rn, generator_rn, NULL, NULL, NULL},
    [LG_SPACE_TS2] = {2, {3, 3}, {3, 3}, act_ts2, cross_two, cross_two, dexpinv_se3, project_ts2},
    [LG_SPACE_SO3] = {1, {9, 0}, {3, 0}, act_so3, generator_so3, cross_one, dexpinv_so3, project_so3},
    [LG_SPACE_SE3] = {2, {9, 3}, {3, 3}, act_se3, generator_se3, cross_two, dexpinv_se3, project_se3},
    [LG_SPACE_SO3_DUAL] = {1, {3, 0}, {3, 0}, act_so3, cross_one, cross_one, dexpinv_so3, NULL},
    [LG_SPACE_SE3_DUAL] = {2, {3, 3}, {3, 3}, act_ts2, cross_two, cross_two, dexpinv_se3, NULL},
};

/* Loops over the factors f; `row` is the factor's table row, `at` the index of its first part. */
#define FOR_FACTORS(space, f, row, at)                                                                       \
    size_t at = 0;                                                                                           \
    const factor_row *row = NULL;                                                                            \
    for (size_t f = 0; f < (space)->factors && (row = &rows[(space)->factor[f].kind], true);                 \
         at += row->parts, f++)

size_t lg_taped_parts(const lg_space *space) {
    size_t parts = 0;
    for (size_t f = 0; f < space->factors; f++) parts += rows[space->factor[f].kind].parts;
    return parts;
}

void lg_taped_number_parts(const lg_space *space, uint8_t *part) {
    FOR_FACTORS(space, f, row, at) {
        for (size_t copy = 0; copy < space->factor[f].count; copy++)
            for (uint32_t p = 0; p < row->parts; p++)
                for (uint32_t i = 0; i < row->state[p]; i++) *part++ = (uint8_t)(at + p);
    }
}

/* ---- shapes ---- */

typedef enum side { STATE, ALGEBRA } side;

static const uint32_t *widths(const factor_row *row, side which) {
    return which == STATE ? row->state : row->algebra;
}

static bool misfit(lg_tape *tape, const char *operation, side which, size_t part, const lg_shape *given,
                   const lg_shape *wanted) {
    char reason[200];
    (void)snprintf(reason, sizeof reason, "part %zu of %s is ", part,
                   which == STATE ? "a state" : "an algebra element");
    lg_append_shape(reason, sizeof reason, given);
    (void)snprintf(reason + strlen(reason), sizeof reason - strlen(reason), ", not ");
    lg_append_shape(reason, sizeof reason, wanted);
    (void)lg_tape_fail(tape, LG_SHAPE, operation, reason);
    return false;
}

/* Whether `given` is a tensor of any shape with the batch size and as many numbers as `wanted`, (B, n). */
static bool fits_flat(const lg_shape *given, const lg_shape *wanted) {
    return given->rank >= 2 && given->dims[0] == wanted->dims[0] &&
           lg_shape_count(*given) == lg_shape_count(*wanted);
}

bool lg_taped_fits(lg_tape *tape, const lg_space *space, bool algebra, const lg_var *parts,
                   const lg_var *like, const char *operation) {
    const side which = algebra ? ALGEBRA : STATE;
    if (lg_tape_status(tape) != LG_OK) return false;
    const uint32_t batch = lg_var_shape(tape, like != NULL ? like[0] : parts[0]).dims[0];
    FOR_FACTORS(space, f, row, at) {
        const uint32_t count = (uint32_t)space->factor[f].count;
        const bool flat = row == &rows[LG_SPACE_RN];
        for (size_t p = 0; p < row->parts; p++) {
            const lg_node *node = lg_node_of(tape, parts[at + p], operation);
            if (node == NULL) return false;
            const lg_shape *given = &node->shape;
            const lg_shape wanted = flat && like != NULL ? lg_var_shape(tape, like[at])
                                    : flat               ? lg_shape2(batch, count)
                                                         : lg_shape3(batch, count, widths(row, which)[p]);
            if (!lg_same_shape(given, &wanted) && !(flat && like == NULL && fits_flat(given, &wanted)))
                return misfit(tape, operation, which, at + p, given, &wanted);
        }
    }
    return true;
}

static bool fit(lg_tape *tape, const lg_space *space, bool algebra, const lg_var *a, const lg_var *b,
                const char *operation) {
    return lg_taped_fits(tape, space, algebra, b, NULL, operation) &&
           lg_taped_fits(tape, space, true, a, b, operation);
}

/* ---- split and join ---- */

/* Splits the block of one factor, (B, count (width[0] + width[1])), into its parts. */
static void split_block(lg_tape *tape, const factor_row *row, const uint32_t *width, uint32_t count,
                        lg_var block, lg_var *parts) {
    if (row == &rows[LG_SPACE_RN]) {
        parts[0] = block;
        return;
    }
    const uint32_t batch = lg_var_shape(tape, block).dims[0], total = width[0] + width[1];
    lg_var copies = lg_reshape(tape, block, lg_shape3(batch, count, total));
    parts[0] = row->parts == 1 ? copies : lg_slice(tape, copies, 2, 0, width[0]);
    if (row->parts == 2) parts[1] = lg_slice(tape, copies, 2, width[0], width[1]);
}

static lg_status split(lg_tape *tape, const lg_space *space, side which, lg_var y, lg_var *parts) {
    const lg_shape shape = lg_var_shape(tape, y);
    const size_t dim = which == STATE ? space->dim : space->algebra_dim;
    lg_var result[LG_TAPED_MAX_PARTS];
    uint32_t from = 0;
    if (lg_is_none(y))
        (void)lg_tape_fail(tape, LG_STALE_HANDLE, "split", "the state is LG_NONE");
    else if (shape.rank != 2 || shape.dims[1] != dim)
        (void)lg_tape_fail(tape, LG_SHAPE, "split",
                           "the state must have shape (B, dim), where dim is the dimension of the space");
    FOR_FACTORS(space, f, row, at) {
        const uint32_t *width = widths(row, which), count = (uint32_t)space->factor[f].count;
        const uint32_t length = count * (width[0] + width[1]);
        lg_var block = space->factors == 1 ? y : lg_slice(tape, y, 1, from, length);
        split_block(tape, row, width, count, block, result + at);
        from += length;
    }
    LG_TRY(lg_tape_status(tape));
    for (size_t p = 0; p < lg_taped_parts(space); p++) parts[p] = result[p];
    return LG_OK;
}

static lg_var join(lg_tape *tape, const lg_space *space, side which, const lg_var *parts) {
    lg_var block[LG_SPACE_MAX_FACTORS];
    if (!lg_taped_fits(tape, space, which == ALGEBRA, parts, NULL, "join")) return LG_NONE;
    const uint32_t batch = lg_var_shape(tape, parts[0]).dims[0];
    FOR_FACTORS(space, f, row, at) {
        const uint32_t *width = widths(row, which), count = (uint32_t)space->factor[f].count;
        block[f] = row->parts == 1 ? parts[at] : lg_concat(tape, parts + at, 2, 2);
        block[f] = lg_reshape(tape, block[f], lg_shape2(batch, count * (width[0] + width[1])));
    }
    if (lg_tape_status(tape) != LG_OK) return LG_NONE;
    return lg_joined(tape, block, space->factors);
}

lg_status lg_taped_split(lg_tape *tape, const lg_space *space, lg_var y, lg_var *parts) {
    LG_TRY(lg_tape_needs(tape, "split", space != NULL && parts != NULL));
    return split(tape, space, STATE, y, parts);
}

lg_var lg_taped_join(lg_tape *tape, const lg_space *space, const lg_var *parts) {
    return join(tape, space, STATE, parts);
}

lg_status lg_taped_split_algebra(lg_tape *tape, const lg_space *space, lg_var a, lg_var *parts) {
    return split(tape, space, ALGEBRA, a, parts);
}

lg_var lg_taped_join_algebra(lg_tape *tape, const lg_space *space, const lg_var *parts) {
    return join(tape, space, ALGEBRA, parts);
}

/* ---- loops over the factors ---- */

/* lg_taped_act and lg_taped_generator check the arguments and call a member of each factor's row. */
#define OF_POINTS(member, title)                                                                             \
    lg_status lg_taped_##member(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y,      \
                                lg_var *out) {                                                               \
        LG_TRY(lg_tape_needs(tape, title, space != NULL && a != NULL && y != NULL && out != NULL));          \
        if (!fit(tape, space, false, a, y, title)) return lg_tape_status(tape);                              \
        FOR_FACTORS(space, f, row, at) {                                                                     \
            row->member(tape, a + at, y + at, out + at);                                                     \
        }                                                                                                    \
        return lg_tape_status(tape);                                                                         \
    }
OF_POINTS(act, "action")
OF_POINTS(generator, "generator")

lg_status lg_taped_bracket(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *b,
                           lg_var *out) {
    if (!fit(tape, space, true, a, b, "bracket")) return lg_tape_status(tape);
    FOR_FACTORS(space, f, row, at) {
        if (row->bracket != NULL)
            row->bracket(tape, a + at, b + at, out + at);
        else
            out[at] = lg_full(tape, lg_var_shape(tape, b[at]), 0.0);
    }
    return lg_tape_status(tape);
}

lg_status lg_taped_project(lg_tape *tape, const lg_space *manifold, const lg_var *y, lg_var *out) {
    FOR_FACTORS(manifold, f, row, at) {
        if (row->project != NULL)
            row->project(tape, y + at, out + at);
        else
            for (size_t p = 0; p < row->parts; p++) out[at + p] = y[at + p];
    }
    return lg_tape_status(tape);
}

/* out = sum_{k <= truncation} B_k/k! ad_a^k b; B_k is zero for odd k > 1. */
static void dexpinv_series(lg_tape *tape, const factor_row *row, int truncation, const lg_var *a,
                           const lg_var *b, lg_var *out) {
    lg_var power[2], sum[2];
    for (size_t p = 0; p < row->parts; p++) sum[p] = power[p] = b[p];
    for (int k = 1; k <= truncation; k++) {
        row->bracket(tape, a, power, power);
        if (lg_dexpinv_series[k] == 0.0) continue;
        for (size_t p = 0; p < row->parts; p++)
            sum[p] = lg_taped_moved(tape, sum[p], lg_dexpinv_series[k], power[p]);
    }
    for (size_t p = 0; p < row->parts; p++) out[p] = sum[p];
}

lg_status lg_taped_dexpinv(lg_tape *tape, const lg_space *space, int truncation, const lg_var *a,
                           const lg_var *b, lg_var *out) {
    LG_TRY(lg_tape_needs(tape, "dexpinv", space != NULL && a != NULL && b != NULL && out != NULL));
    if (truncation < LG_DEXPINV_EXACT || truncation > LG_DEXPINV_MAX)
        (void)lg_tape_fail(tape, LG_INVALID_ARGUMENT, "dexpinv",
                           "the truncation must be LG_DEXPINV_EXACT or 0 to LG_DEXPINV_MAX");
    if (!fit(tape, space, true, a, b, "dexpinv")) return lg_tape_status(tape);
    FOR_FACTORS(space, f, row, at) {
        if (row->dexpinv == NULL)
            for (size_t p = 0; p < row->parts; p++) out[at + p] = b[at + p];
        else if (truncation == LG_DEXPINV_EXACT)
            row->dexpinv(tape, a + at, b + at, out + at);
        else
            dexpinv_series(tape, row, truncation, a + at, b + at, out + at);
    }
    return lg_tape_status(tape);
}
