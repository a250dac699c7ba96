/* Spaces: a table with one row per kind of factor, and loops over the factors of a product. */
#include "liegrad/geometry.h"
#include "liegrad/integrators.h"
#include "liegrad/taped.h"

#include <stdint.h>
#include <string.h>

#include "core/core.h"
#include "integrators/doubles.inc"
#include "integrators/groups.h"

/* In exact arithmetic the group actions preserve |q| = 1 and R^T R = I. Rounded actions do not: the rounding
 * error of a coefficient is the same in every step with the same |u|, so the drift grows with the number of
 * steps. Therefore every action ends with one Newton correction of the constraint, if the constraint is
 * violated by less than LG_LIE_ROUNDING. Points farther away are assumed to be intended and keep their
 * distance from the manifold. Dual spaces have no constraint, but invariants whose values depend on the
 * start. There the rotation itself is computed so accurately that they do not drift. */

/* The larger of a and b, or NaN when one of them is NaN. */
static double worse(double a, double b) {
    return b > a || isnan(b) ? b : a;
}

/* 0, or NaN when y holds a NaN. */
static double nan_in(size_t n, const double *y) {
    bool found = false;
    for (size_t i = 0; i < n; i++) found = found || isnan(y[i]);
    return found ? NAN : 0.0;
}

/* NAME calls ONE for each copy. One copy of `a`, `b` and `out` has A, B and OUT numbers. WORST returns the
 * largest value of ONE. */
#define EACH(NAME, ONE, A, B, OUT)                                                                           \
    static void NAME(size_t count, const double *a, const double *b, double *out) {                          \
        for (size_t i = 0; i < count; i++) ONE(a + (A)*i, b + (B)*i, out + (OUT)*i);                         \
    }
#define EACH_OF_KIND(NAME, ONE, KIND, A, B)                                                                  \
    static void NAME(size_t count, const double *a, const double *y, double *out) {                          \
        for (size_t i = 0; i < count; i++) ONE(KIND, a + (A)*i, y + (B)*i, out + (B)*i);                     \
    }
#define EACH_IN_PLACE(NAME, ONE, N)                                                                          \
    static void NAME(size_t count, const double *y, double *g) {                                             \
        for (size_t i = 0; i < count; i++) ONE(y + (N)*i, g + (N)*i);                                        \
    }
#define EACH_PROJECTED(NAME, ONE, N)                                                                         \
    static void NAME(size_t count, double *y) {                                                              \
        for (size_t i = 0; i < count; i++) ONE(y + (N)*i);                                                   \
    }
#define WORST(NAME, ONE, N)                                                                                  \
    static double NAME(size_t count, const double *y) {                                                      \
        double error = 0.0;                                                                                  \
        for (size_t i = 0; i < count; i++) error = worse(error, ONE(y + (N)*i));                             \
        return error;                                                                                        \
    }

/* ---- tangent coordinates, whose C is also what lg-export writes ---- */

typedef double real;
#define REAL(number) number
#define SQRT         sqrt
#define FABS         fabs
enum { DIRECTION = 6, ROTATION = 9 }; /* numbers of a copy of T*S^2 and of SO(3) */
#include "integrators/code/tangent.c"

/* Writes the directions of a copy's coordinates as columns, whose rows are `stride` numbers apart. */
static void place_directions(int numbers, const double *y, size_t stride, double *out) {
    double direction[ROTATION];
    for (int k = 0; k < tangent_of(numbers); k++) {
        copy_direction(numbers, y, k, direction);
        for (int i = 0; i < numbers; i++) out[stride * (size_t)i + (size_t)k] = direction[i];
    }
}

/* ---- R^n ---- */

static void rn_act(size_t count, const double *a, const double *y, double *out) {
    for (size_t i = 0; i < count; i++) out[i] = y[i] + a[i];
}

static void rn_generator(size_t count, const double *a, const double *y, double *out) {
    memmove(out, a, count * sizeof(*a));
}

static void free_project(size_t count, double *y) {
}

static void free_gradient(size_t count, const double *y, double *g) {
}

/* ---- algebras so(3) and se(3), shared by several spaces ---- */

EACH(so3_bracket, lg_cross3, 3, 3, 3)
EACH(so3_dexpinv, lg_so3_dexpinv, 3, 3, 3)
EACH(se3_bracket, lg_se3_bracket, 6, 6, 6)

static double so3_angle(size_t count, const double *a) {
    double w = 0.0;
    for (size_t i = 0; i < count; i++) w = worse(w, lg_dot3(a + 3 * i, a + 3 * i));
    return sqrt(w);
}

static void se3_dexpinv(size_t count, const double *a, const double *b, double *out) {
    lg_kernels_for(LG_F64)->se3_dexpinv(count, a, b, out);
}

static double se3_angle(size_t count, const double *a) {
    return lg_kernels_for(LG_F64)->se3_angle(count, a);
}

/* ---- T*S^2 under SE(3) ---- */

static void ts2_act(size_t count, const double *a, const double *y, double *out) {
    lg_kernels_for(LG_F64)->se3_act(count, a, y, out);
}

EACH(ts2_generator, lg_se3_generator, 6, 6, 6)

static void project_direction(double *y) {
    const double norm = sqrt(lg_dot3(y, y));
    for (int j = 0; j < 3; j++) y[j] /= norm;
    const double along = lg_dot3(y, y + 3);
    for (int j = 0; j < 3; j++) y[3 + j] -= along * y[j];
}
EACH_PROJECTED(ts2_project, project_direction, 6)

static double direction_error(const double *y) {
    return worse(fabs(sqrt(lg_dot3(y, y)) - 1.0), fabs(lg_dot3(y, y + 3)));
}
WORST(ts2_manifold_error, direction_error, 6)

/* The constraints |q|^2/2 and q.p have the gradients (q, 0) and (p, q). Subtracts from g its orthogonal
 * projection onto their span. */
static void sphere_gradient(const double *q, double *g) {
    const double *p = q + 3;
    const double a11 = lg_dot3(q, q), a12 = lg_dot3(q, p), a22 = a11 + lg_dot3(p, p);
    const double b1 = lg_dot3(q, g), b2 = lg_dot3(p, g) + lg_dot3(q, g + 3);
    const double det = a11 * a22 - a12 * a12;
    const double x1 = (a22 * b1 - a12 * b2) / det, x2 = (a11 * b2 - a12 * b1) / det;
    for (int j = 0; j < 3; j++) {
        g[j] -= x1 * q[j] + x2 * p[j];
        g[3 + j] -= x2 * q[j];
    }
}
EACH_IN_PLACE(ts2_gradient, sphere_gradient, 6)

static void ts2_basis(const double *y, size_t stride, double *directions) {
    place_directions(DIRECTION, y, stride, directions);
}

static void ts2_coordinates(size_t count, const double *y, const double *vector, double *c) {
    for (size_t i = 0; i < count; i++) copy_coordinates(DIRECTION, y + 6 * i, vector + 6 * i, c + 4 * i);
}

/* Solves (u x q, u x p + v x q) = (dq, dp) for u and v orthogonal to q: u = q x dq, v = q x (dp - u x p). */
static void ts2_lift(size_t count, const double *y, const double *vector, double *a) {
    for (size_t i = 0; i < count; i++, y += 6, vector += 6, a += 6) {
        double rest[3];
        lg_cross3(y, vector, a);
        lg_cross3(a, y + 3, rest);
        for (int j = 0; j < 3; j++) rest[j] = vector[3 + j] - rest[j];
        lg_cross3(y, rest, a + 3);
    }
}

/* ---- rotation matrices: SO(3), SE(3) ---- */

enum { SO3_STATE = 9, SE3_STATE = 12 };

/* The largest |entry| of R^T R - I, or 1 - det R if that is larger and det R < 0: a reflection gives 2. */
static double rotation_error(const double R[9]) {
    double error = 0.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++)
            error = worse(error, fabs(R[i] * R[j] + R[3 + i] * R[3 + j] + R[6 + i] * R[6 + j] - (i == j)));
    const double det = lie_dot(lie_cross(lie_at(R), lie_at(R + 3)), lie_at(R + 6));
    return det < 0.0 ? worse(error, 1.0 - det) : error;
}

/* Projects G onto the tangent space {hat(u) R}, in place. As |hat(u) R|^2 = 2 |u|^2, the projection has
 * u = 1/2 sum_j (column j of R) x (column j of G); for orthogonal R it equals R skew(R^T G). */
static void rotation_gradient(const double R[9], double G[9]) {
    double u[3] = {0.0, 0.0, 0.0};
    for (int j = 0; j < 3; j++) {
        const double column[3] = {R[j], R[3 + j], R[6 + j]}, of_g[3] = {G[j], G[3 + j], G[6 + j]};
        double c[3];
        lg_cross3(column, of_g, c);
        for (int i = 0; i < 3; i++) u[i] += 0.5 * c[i];
    }
    cross_columns(lie_at(u), R, G);
}

EACH_OF_KIND(so3_act, act_copy, LG_SPACE_SO3, 3, SO3_STATE)
EACH_OF_KIND(se3_act, act_copy, LG_SPACE_SE3, 6, SE3_STATE)
EACH_OF_KIND(so3_generator, generate_copy, LG_SPACE_SO3, 3, SO3_STATE)
EACH_OF_KIND(se3_generator, generate_copy, LG_SPACE_SE3, 6, SE3_STATE)

EACH_PROJECTED(so3_project, lg_so3_project, SO3_STATE)
EACH_PROJECTED(se3_project, lg_so3_project, SE3_STATE)

static double pose_error(const double *y) {
    return worse(rotation_error(y), nan_in(3, y + 9));
}
WORST(so3_manifold_error, rotation_error, SO3_STATE)
WORST(se3_manifold_error, pose_error, SE3_STATE)

EACH_IN_PLACE(so3_gradient, rotation_gradient, SO3_STATE)
EACH_IN_PLACE(se3_gradient, rotation_gradient, SE3_STATE)

static void so3_basis(const double *R, size_t stride, double *directions) {
    place_directions(ROTATION, R, stride, directions);
}

static void rotation_coordinates(const double *R, const double *dR, double *c) {
    copy_coordinates(ROTATION, R, dR, c);
}

/* Solves dR = hat(u) R: with dR = R hat(c), u = R c. */
static void rotation_lift(const double *R, const double *dR, double *u) {
    double c[3];
    rotation_coordinates(R, dR, c);
    for (int i = 0; i < 3; i++) u[i] = R[3 * i] * c[0] + R[3 * i + 1] * c[1] + R[3 * i + 2] * c[2];
}

EACH(so3_coordinates, rotation_coordinates, SO3_STATE, SO3_STATE, 3)
EACH(so3_lift, rotation_lift, SO3_STATE, SO3_STATE, 3)

static void se3_basis(const double *y, size_t stride, double *directions) {
    for (size_t i = 0; i < SE3_STATE; i++) memset(directions + stride * i, 0, 6 * sizeof *directions);
    so3_basis(y, stride, directions);
    for (size_t i = 0; i < 3; i++) directions[stride * (9 + i) + 3 + i] = 1.0;
}

static void se3_coordinates(size_t count, const double *y, const double *vector, double *c) {
    for (size_t i = 0; i < count; i++, y += SE3_STATE, vector += SE3_STATE, c += 6) {
        rotation_coordinates(y, vector, c);
        memcpy(c + 3, vector + 9, 3 * sizeof *c);
    }
}

/* From dr = u x r + v: v = dr - u x r. */
static void se3_lift(size_t count, const double *y, const double *vector, double *a) {
    for (size_t i = 0; i < count; i++, y += SE3_STATE, vector += SE3_STATE, a += 6) {
        double turned[3];
        rotation_lift(y, vector, a);
        lg_cross3(a, y + 9, turned);
        for (int j = 0; j < 3; j++) a[3 + j] = vector[9 + j] - turned[j];
    }
}

/* Only the rotation of exp(a) acts on tangent vectors: the translation shifts r but does not change dr. */
static void se3_carry(size_t count, const double *a, const double *vector, double *out) {
    for (size_t i = 0; i < count; i++, a += 6, vector += SE3_STATE, out += SE3_STATE) {
        const double turn[6] = {a[0], a[1], a[2], 0.0, 0.0, 0.0};
        se3_act(1, turn, vector, out);
    }
}

/* ---- dual spaces ---- */

/* exp(hat(u)) as a quaternion q = (scalar, v): x -> x + k (scalar v x x + v x (v x x)) is a rotation for any
 * q when k = 2/|q|^2. k is stored in twice the precision, k + k_low, and each sum is rounded once. Then the
 * error of |x| is not the same in every step: |x| only drifts like a random walk. q deliberately does not
 * have unit length. With k = 2 too many sums would lie half-way between two doubles, and the error of k would
 * round them to the same side every time. */
typedef struct rotor {
    double scalar, v[3], k, k_low;
} rotor;

static rotor rotor_of(const double u[3]) {
    rotor q;
    const double length = 0.7310585786300049;
    double c[2];
    lg_stumpff(0.25 * lg_dot3(u, u), 1, 0, c);
    q.scalar = length * c[0];
    for (int i = 0; i < 3; i++) q.v[i] = 0.5 * length * c[1] * u[i];
    const double part[4] = {q.scalar, q.v[0], q.v[1], q.v[2]};
    double norm = 0.0, low = 0.0; /* |q|^2 = norm + low */
    for (int i = 0; i < 4; i++) {
        const double square = part[i] * part[i], sum = norm + square, back = sum - norm;
        low += (norm - (sum - back)) + (square - back) + fma(part[i], part[i], -square);
        norm = sum;
    }
    q.k = 2.0 / norm;
    q.k_low = (fma(-q.k, norm, 2.0) - q.k * low) / norm;
    return q;
}

static void rotate(const rotor *q, const double x[3], double out[3]) {
    double vx[3], vvx[3];
    lg_cross3(q->v, x, vx);
    lg_cross3(q->v, vx, vvx);
    for (int i = 0; i < 3; i++) {
        const double z = q->scalar * vx[i] + vvx[i], turn = q->k * z, sum = x[i] + turn, back = sum - x[i];
        const double low = fma(q->k, z, -turn) + q->k_low * z;
        out[i] = sum + (((x[i] - (sum - back)) + (turn - back)) + low);
    }
}

static void so3_dual_act(size_t count, const double *a, const double *y, double *out) {
    for (size_t i = 0; i < count; i++) {
        const rotor q = rotor_of(a + 3 * i);
        rotate(&q, y + 3 * i, out + 3 * i);
    }
}

static double so3_dual_manifold_error(size_t count, const double *y) {
    return nan_in(3 * count, y);
}

static void se3_dual_act(size_t count, const double *a, const double *y, double *out) {
    for (size_t i = 0; i < count; i++, a += 6, y += 6, out += 6) {
        const rotor q = rotor_of(a);
        double r[3], moved[3], turned[3];
        lg_so3_dexp(a, a + 3, r);
        rotate(&q, y + 3, moved);
        rotate(&q, y, out);
        lg_cross3(r, out, turned);
        for (int j = 0; j < 3; j++) out[3 + j] = moved[j] + turned[j];
    }
}

static double se3_dual_manifold_error(size_t count, const double *y) {
    return nan_in(6 * count, y);
}

/* ---- the table ---- */

static const lg_space_entry rows[LG_SPACE_KINDS] = {
    [LG_SPACE_RN] = {"R^n", 1, 1, true, rn_act, rn_generator, NULL, NULL, free_project, nan_in, nan_in,
                     .tangent = 1},
    [LG_SPACE_TS2] = {"T*S^2", 6, 6, false, ts2_act, ts2_generator, se3_bracket, se3_dexpinv, ts2_project,
                      ts2_manifold_error, se3_angle, 4, ts2_basis, ts2_coordinates, ts2_lift, ts2_act},
    [LG_SPACE_SO3] = {"SO(3)", SO3_STATE, 3, false, so3_act, so3_generator, so3_bracket, so3_dexpinv,
                      so3_project, so3_manifold_error, so3_angle, 3, so3_basis, so3_coordinates, so3_lift,
                      so3_act},
    [LG_SPACE_SE3] = {"SE(3)", SE3_STATE, 6, false, se3_act, se3_generator, se3_bracket, se3_dexpinv,
                      se3_project, se3_manifold_error, se3_angle, 6, se3_basis, se3_coordinates, se3_lift,
                      se3_carry},
    [LG_SPACE_SO3_DUAL] = {"so(3)*", 3, 3, false, so3_dual_act, so3_bracket, so3_bracket, so3_dexpinv,
                           free_project, so3_dual_manifold_error, so3_angle, .tangent = 3},
    [LG_SPACE_SE3_DUAL] = {"se(3)*", 6, 6, false, se3_dual_act, ts2_generator, se3_bracket, se3_dexpinv,
                           free_project, se3_dual_manifold_error, se3_angle, .tangent = 6},
};

/* Projects the ambient gradient g at y orthogonally onto the tangent space, in place. */
static void (*const project_gradient[LG_SPACE_KINDS])(size_t count, const double *y, double *g) = {
    [LG_SPACE_RN] = free_gradient, [LG_SPACE_TS2] = ts2_gradient,       [LG_SPACE_SO3] = so3_gradient,
    [LG_SPACE_SE3] = se3_gradient, [LG_SPACE_SO3_DUAL] = free_gradient, [LG_SPACE_SE3_DUAL] = free_gradient,
};

const lg_space_entry *lg_space_kind_entry(lg_space_kind kind) {
    return (unsigned)kind < LG_SPACE_KINDS ? &rows[kind] : NULL;
}

#define DIM_MAX (SIZE_MAX / 4096) /* so that sizes of workspaces in bytes cannot overflow */

lg_status lg_space_init(lg_space *space, const lg_space_factor *factors, size_t count) {
    lg_space result = {.factors = count};
    if (!space || !factors || count < 1 || count > LG_SPACE_MAX_FACTORS) return LG_INVALID_ARGUMENT;
    for (size_t i = 0; i < count; i++) {
        const lg_space_entry *row = lg_space_kind_entry(factors[i].kind);
        if (!row || factors[i].count < 1 || factors[i].count > DIM_MAX / LG_SPACE_MAX_FACTORS / 32)
            return LG_INVALID_ARGUMENT;
        result.factor[i] = factors[i];
        result.dim += row->state * factors[i].count;
        result.algebra_dim += row->algebra * factors[i].count;
        result.tangent_dim += row->tangent * factors[i].count;
    }
    *space = result;
    return LG_OK;
}

lg_status lg_space_init_rn(lg_space *space, size_t n) {
    return lg_space_init(space, &(lg_space_factor){LG_SPACE_RN, n}, 1);
}

bool lg_space_is_abelian(const lg_space *space) {
    bool abelian = true;
    for (size_t i = 0; i < space->factors; i++) abelian = abelian && rows[space->factor[i].kind].abelian;
    return abelian;
}

/* Number of entries in each group (integrators/groups.h) of one copy; at most two groups. */
static const size_t groups[LG_SPACE_KINDS][2] = {
    [LG_SPACE_RN] = {1},     [LG_SPACE_TS2] = {3, 3},   [LG_SPACE_SO3] = {9},
    [LG_SPACE_SE3] = {9, 3}, [LG_SPACE_SO3_DUAL] = {3}, [LG_SPACE_SE3_DUAL] = {3, 3},
};

size_t lg_space_groups(const lg_space *space, size_t *end) {
    size_t count = 0, at = 0;
    for (size_t f = 0; f < space->factors; f++) {
        /* copies that share a group */
        const size_t each = (space->vectors >> f & 1) != 0 && space->factor[f].count % 3 == 0 ? 3 : 1;
        for (size_t copy = 0; copy < space->factor[f].count; copy += each)
            for (size_t i = 0; i < 2 && groups[space->factor[f].kind][i] > 0; i++)
                end[count++] = at += each * groups[space->factor[f].kind][i];
    }
    return count;
}

/* Loops over the factors: `row` is the factor's table row, `n` its number of copies, `y` and `a` its offsets
 * in the state and in the algebra element. */
#define FOR_FACTORS(space, row, n, y, a)                                                                     \
    size_t y = 0, a = 0, n = 0;                                                                              \
    const lg_space_entry *row = NULL;                                                                        \
    for (size_t f_ = 0; f_ < (space)->factors &&                                                             \
                        (row = &rows[(space)->factor[f_].kind], n = (space)->factor[f_].count, true);        \
         y += n * row->state, a += n * row->algebra, f_++, (void)y)

void lg_space_act(const lg_space *space, const double *a, const double *y, double *out) {
    FOR_FACTORS(space, row, n, at, in) {
        row->act(n, a + in, y + at, out + at);
    }
}

void lg_space_generator(const lg_space *space, const double *a, const double *y, double *out) {
    FOR_FACTORS(space, row, n, at, in) {
        row->generator(n, a + in, y + at, out + at);
    }
}

void lg_space_bracket(const lg_space *space, const double *a, const double *b, double *out) {
    FOR_FACTORS(space, row, n, at, in) {
        if (row->abelian)
            memset(out + in, 0, n * row->algebra * sizeof(*out));
        else
            row->bracket(n, a + in, b + in, out + in);
    }
}

const double lg_dexpinv_series[LG_DEXPINV_MAX + 1] = {
    1.0,           -1.0 / 2.0, 1.0 / 12.0,       0.0, -1.0 / 720.0,     0.0,
    1.0 / 30240.0, 0.0,        -1.0 / 1209600.0, 0.0, 1.0 / 47900160.0,
};

void lg_space_dexpinv(const lg_space *space, int truncation, const double *a, const double *b, double *out) {
    FOR_FACTORS(space, row, n, at, in) {
        if (row->abelian)
            memmove(out + in, b + in, n * row->algebra * sizeof(*out));
        else if (truncation == LG_DEXPINV_EXACT)
            row->dexpinv(n, a + in, b + in, out + in);
        else
            for (size_t i = in; i < in + n * row->algebra; i += row->algebra)
                dexpinv_series(row->algebra, truncation < LG_DEXPINV_MAX ? truncation : LG_DEXPINV_MAX, a + i,
                               b + i, out + i);
    }
}

void lg_space_project(const lg_space *space, double *y) {
    FOR_FACTORS(space, row, n, at, in) {
        row->project(n, y + at);
    }
}

double lg_space_manifold_error(const lg_space *space, const double *y) {
    double error = 0.0;
    FOR_FACTORS(space, row, n, at, in) {
        error = worse(error, row->manifold_error(n, y + at));
    }
    return error;
}

double lg_space_angle(const lg_space *space, const double *a) {
    double angle = 0.0;
    FOR_FACTORS(space, row, n, at, in) {
        angle = worse(angle, row->angle(n, a + in));
    }
    return angle;
}

/* ---- tangent coordinates ---- */

/* The matrices `basis` and `carried` are block diagonal with one block per copy. In the functions below the
 * pointer moves from one block to the next. */

/* Writes a unit matrix (n, n) whose rows are `stride` apart. Returns where the next block begins. */
static double *place_unit(size_t n, size_t stride, double *out) {
    for (size_t i = 0; i < n; i++, out += stride + 1) *out = 1.0;
    return out;
}

void lg_space_basis(const lg_space *space, const double *y, double *basis) {
    const size_t r = space->tangent_dim;
    memset(basis, 0, space->dim * r * sizeof *basis);
    FOR_FACTORS(space, row, n, at, in) {
        if (row->basis == NULL) basis = place_unit(n * row->state, r, basis);
        for (size_t i = 0; i < n && row->basis != NULL; i++, basis += row->state * r + row->tangent)
            row->basis(y + at + i * row->state, r, basis);
    }
}

void lg_space_coordinates(const lg_space *space, const double *y, const double *vector, double *c) {
    FOR_FACTORS(space, row, n, at, in) {
        if (row->coordinates == NULL)
            memcpy(c, vector + at, n * row->state * sizeof *c);
        else
            row->coordinates(n, y + at, vector + at, c);
        c += n * row->tangent;
    }
}

/* Writes the matrix for one copy of the factor, (tangent, tangent) with rows `stride` apart: the map from
 * tangent coordinates at y to those at the point that a step along `vector` reaches. */
static void carry_copy(const lg_space_entry *row, const double *y, const double *vector, size_t stride,
                       double *block) {
    double a[LG_SPACE_MAX_ALGEBRA], next[LG_SPACE_MAX_STATE], column[LG_SPACE_MAX_STATE];
    double basis[LG_SPACE_MAX_STATE * LG_SPACE_MAX_STATE], c[LG_SPACE_MAX_STATE];
    row->lift(1, y, vector, a);
    row->act(1, a, y, next);
    row->basis(y, row->tangent, basis);
    for (size_t j = 0; j < row->tangent; j++) {
        for (size_t i = 0; i < row->state; i++) column[i] = basis[i * row->tangent + j];
        row->carry(1, a, column, column);
        row->coordinates(1, next, column, c);
        for (size_t i = 0; i < row->tangent; i++) block[i * stride + j] = c[i];
    }
}

enum { AT_ONCE = 8 }; /* copies that are moved per call of `lift` and `act` */

static void move_copies(const lg_space_entry *row, size_t count, const double *y, const double *vector,
                        double *out) {
    double a[AT_ONCE * LG_SPACE_MAX_ALGEBRA];
    for (size_t i = 0; i < count; i += AT_ONCE) {
        const size_t n = count - i < AT_ONCE ? count - i : AT_ONCE, at = i * row->state;
        row->lift(n, y + at, vector + at, a);
        row->act(n, a, y + at, out + at);
    }
}

void lg_space_retract(const lg_space *space, const double *y, const double *vector, double *out,
                      double *carried) {
    const size_t r = space->tangent_dim;
    if (carried != NULL) memset(carried, 0, r * r * sizeof *carried);
    FOR_FACTORS(space, row, n, at, in) {
        const bool moves = row->lift != NULL;
        if (carried != NULL && !moves) carried = place_unit(n * row->state, r, carried);
        for (size_t i = 0; i < n && carried != NULL && moves; i++, carried += row->tangent * (r + 1))
            carry_copy(row, y + at + i * row->state, vector + at + i * row->state, r, carried);
        if (moves)
            move_copies(row, n, y + at, vector + at, out + at);
        else
            rn_act(n * row->state, vector + at, y + at, out + at);
    }
}

void lg_space_project_gradient(const lg_space *space, const double *y, double *g) {
    FOR_FACTORS(space, row, n, at, in) {
        project_gradient[space->factor[f_].kind](n, y + at, g + at);
    }
}
