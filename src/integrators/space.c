/* Spaces: one table row a kind of factor, and loops over the factors of a product. */
#include "liegrad/integrators.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "core/core.h"
#include "integrators/series.h"
#include "liegrad/geometry.h"

/* ---- R^n ---- */

static void rn_act(size_t count, const double *a, const double *y, double *out) {
    for (size_t i = 0; i < count; i++) out[i] = y[i] + a[i];
}

static void rn_generator(size_t count, const double *a, const double *y, double *out) {
    (void)y;
    memmove(out, a, count * sizeof(*a));
}

static void rn_project(size_t count, double *y) {
    (void)count;
    (void)y;
}

static double rn_manifold_error(size_t count, const double *y) {
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) sum += y[i];
    return isnan(sum) ? sum : 0.0;
}

static double rn_angle(size_t count, const double *a) {
    return rn_manifold_error(count, a);
}

/* ---- T*S^2 under SE(3) ---- */

static void ts2_act(size_t count, const double *a, const double *y, double *out) {
    for (size_t i = 0; i < count; i++) lg_se3_exp_act(a + 6 * i, y + 6 * i, out + 6 * i);
}

static void ts2_generator(size_t count, const double *a, const double *y, double *out) {
    for (size_t i = 0; i < count; i++) lg_se3_generator(a + 6 * i, y + 6 * i, out + 6 * i);
}

static void ts2_bracket(size_t count, const double *a, const double *b, double *out) {
    for (size_t i = 0; i < count; i++) lg_se3_bracket(a + 6 * i, b + 6 * i, out + 6 * i);
}

static void ts2_dexpinv(size_t count, const double *a, const double *b, double *out) {
    for (size_t i = 0; i < count; i++) lg_se3_dexpinv(a + 6 * i, b + 6 * i, out + 6 * i);
}

static void ts2_project(size_t count, double *y) {
    for (size_t i = 0; i < count; i++, y += 6) {
        const double norm = sqrt(lg_dot3(y, y));
        for (int j = 0; j < 3; j++) y[j] /= norm;
        const double along = lg_dot3(y, y + 3);
        for (int j = 0; j < 3; j++) y[3 + j] -= along * y[j];
    }
}

/* The larger one, NaN when either is. */
static double worse(double a, double b) {
    return b > a || isnan(b) ? b : a;
}

static double ts2_manifold_error(size_t count, const double *y) {
    double error = 0.0;
    for (size_t i = 0; i < count && !isnan(error); i++, y += 6) {
        error = worse(error, fabs(sqrt(lg_dot3(y, y)) - 1.0));
        if (!isnan(error)) error = worse(error, fabs(lg_dot3(y, y + 3)));
    }
    return error;
}

static double ts2_angle(size_t count, const double *a) {
    double w = 0.0;
    for (size_t i = 0; i < count && !isnan(w); i++) w = worse(w, lg_dot3(a + 6 * i, a + 6 * i));
    return sqrt(w);
}

/* ---- the table ---- */

static const lg_space_row rows[LG_SPACE_KINDS] = {
    [LG_SPACE_RN] = {"R^n", 1, 1, true, rn_act, rn_generator, NULL, NULL, rn_project, rn_manifold_error,
                     rn_angle},
    [LG_SPACE_TS2] = {"T*S^2", 6, 6, false, ts2_act, ts2_generator, ts2_bracket, ts2_dexpinv, ts2_project,
                      ts2_manifold_error, ts2_angle},
};

const lg_space_row *lg_space_kind_row(lg_space_kind kind) {
    return (unsigned)kind < LG_SPACE_KINDS ? &rows[kind] : NULL;
}

#define DIM_MAX (SIZE_MAX / 4096) /* so that sizes of workspaces in bytes cannot overflow */

lg_status lg_space_init(lg_space *space, const lg_space_factor *factors, size_t count) {
    lg_space result = {.factors = count};
    if (!space || !factors || count < 1 || count > LG_SPACE_MAX_FACTORS) return LG_INVALID_ARGUMENT;
    for (size_t i = 0; i < count; i++) {
        const lg_space_row *row = lg_space_kind_row(factors[i].kind);
        if (!row || factors[i].count < 1 || factors[i].count > DIM_MAX / LG_SPACE_MAX_FACTORS / 32)
            return LG_INVALID_ARGUMENT;
        result.factor[i] = factors[i];
        result.dim += row->state * factors[i].count;
        result.algebra_dim += row->algebra * factors[i].count;
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

/* Visits the factors with running offsets into state (y) and algebra (a). */
#define FOR_FACTORS(space, row, n, y, a)                                                                     \
    size_t y = 0, a = 0, n = 0;                                                                              \
    const lg_space_row *row = NULL;                                                                          \
    for (size_t f_ = 0; f_ < (space)->factors &&                                                             \
                        (row = &rows[(space)->factor[f_].kind], n = (space)->factor[f_].count, true);        \
         y += n * row->state, a += n * row->algebra, f_++)

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

static void dexpinv_series(const lg_space_row *row, int K, size_t count, const double *a, const double *b,
                           double *out) {
    double term[LG_SPACE_MAX_ALGEBRA], sum[LG_SPACE_MAX_ALGEBRA];
    const size_t m = row->algebra;
    for (size_t i = 0; i < count; i++, a += m, b += m, out += m) {
        memcpy(term, b, m * sizeof(*b));
        memcpy(sum, b, m * sizeof(*b));
        for (int k = 1; k <= K; k++) {
            row->bracket(1, a, term, term);
            for (size_t j = 0; j < m; j++) sum[j] += lg_dexpinv_series[k] * term[j];
        }
        memcpy(out, sum, m * sizeof(*out));
    }
}

void lg_space_dexpinv(const lg_space *space, int truncation, const double *a, const double *b, double *out) {
    FOR_FACTORS(space, row, n, at, in) {
        if (row->abelian)
            memmove(out + in, b + in, n * row->algebra * sizeof(*out));
        else if (truncation == LG_DEXPINV_EXACT)
            row->dexpinv(n, a + in, b + in, out + in);
        else
            dexpinv_series(row, truncation < LG_DEXPINV_MAX ? truncation : LG_DEXPINV_MAX, n, a + in, b + in,
                           out + in);
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
        if (!isnan(error)) error = worse(error, row->manifold_error(n, y + at));
    }
    return error;
}

double lg_space_angle(const lg_space *space, const double *a) {
    double angle = 0.0;
    FOR_FACTORS(space, row, n, at, in) {
        if (!isnan(angle)) angle = worse(angle, row->angle(n, a + in));
    }
    return angle;
}
