/* What a correlation of the residuals in time makes of the errors of parameters.
 *
 * The score g_k = J_k^T r_k of a stretch k of the log is its pull on the parameters. With white residuals of
 * variance s^2 the sum of g_k g_k^T is s^2 J^T J, and scores of different stretches are independent. For
 * other residuals the covariance of the parameters is the sandwich
 *   (J^T J)^-1 (sum over k, l of E g_k g_l^T) (J^T J)^-1.
 * In units h_k = W^T g_k/s^2 with W W^T = s^2 (J^T J)^-1 it is W S W^T, where S is 1 for white residuals. S
 * is estimated from sums of h_k over blocks: over four times the correlation time of the scores, and over an
 * eighth of the log, which is the spread between disjoint parts. The larger estimate is taken, and no
 * direction becomes better than with white residuals. A prior with covariance D^2, which is part of W W^T,
 * adds P = W^T D^-2 W to S; white residuals then make it 1 - P before. */
#include <cblas.h>
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"
#include "kernels/lapack.h"
#include "nn/fit_errors.h"

enum { PARTS = 8, TIMES = 4, TOGETHER = 32 };

lg_status lg_fit_eigen(const lg_context *context, size_t n, double *matrix, double *values) {
    const int size = (int)n;
    double want = 0.0;
    int iwant = 0, info = 0, query = -1;
    for (size_t i = 0; i < n * n; i++) /* for NaN, LAPACK returns meaningless numbers */
        if (!isfinite(matrix[i])) return LG_NOT_FINITE;
    dsyevd_("V", "U", &size, matrix, &size, values, &want, &query, &iwant, &query, &info);
    const int room = (int)want, iroom = iwant;
    LG_TRY_SCRATCH(double, work, context, (size_t)room, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(int, iwork, context, (size_t)iroom, LG_OUT_OF_MEMORY);
    dsyevd_("V", "U", &size, matrix, &size, values, work, &room, iwork, &iroom, &info);
    return info == 0 ? LG_OK : LG_NOT_FINITE;
}

static void centre(size_t count, size_t n, double *h) {
    for (size_t j = 0; j < n; j++) {
        double mean = 0.0;
        for (size_t k = 0; k < count; k++) mean += h[k * n + j] / (double)count;
        for (size_t k = 0; k < count; k++) h[k * n + j] -= mean;
    }
}

/* Correlation of scores `lag` stretches apart, all parameters together. */
static double correlation(size_t count, size_t n, const double *h, size_t lag) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const double squares = k->dot(count * n, h, h);
    return squares > 0.0 ? k->dot((count - lag) * n, h, h + lag * n) / squares : 0.0;
}

/* Stretches in a block of several correlation times, at least `least` and at most `most`. */
static size_t block_of(size_t count, size_t n, const double *h, size_t least, size_t most) {
    const double chance = 2.0 / sqrt((double)count);
    double time = 1.0;
    for (size_t lag = 1; lag <= most; lag++) {
        const double r = correlation(count, n, h, lag);
        if (!(r > chance)) break;
        time += 2.0 * r;
    }
    const double wanted = fmax((double)least, time > 1.0 ? ceil(TIMES * time) : 1.0);
    return wanted < (double)most ? (size_t)wanted : most;
}

/* Independent blocks that all blocks of this length, which overlap, are worth. */
static double worth(size_t count, size_t block) {
    return (block > 1 ? 1.5 : 1.0) * (double)count / (double)block;
}

/* What scores are compared with: G = 1 - P (n, n), the S of white residuals, and its trace. */
typedef struct white {
    const double *P;
    double trace;
} white;

/* S += factor x^T x for x (rows, n). */
static void add_squares(size_t rows, size_t n, double factor, const double *x, double *S) {
    cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, (int)n, (int)n, (int)rows, factor, x, (int)n, x,
                (int)n, 1.0, S, (int)n);
}

/* S (n, n) from the sums over all blocks of `block` stretches; returns its trace in units of white residuals.
 * Few blocks make the ratio of a number and its error wider than normal; S is as wide as theirs (Student). */
static double estimate(size_t count, size_t n, const double *h, size_t block, const white *of, double *sums,
                       double *S) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const double blocks = (double)count / (double)block, many = worth(count, block),
                 wide = blocks / (blocks - 1.0) * (many - 1.0) / (many - 3.0),
                 factor = wide * blocks / (double)(count - block + 1);
    double trace = 0.0;
    size_t held = 0;
    memset(S, 0, n * n * sizeof *S);
    memset(sums, 0, n * sizeof *sums);
    for (size_t end = 0; end < count; end++) {
        double *sum = sums + held * n;
        k->axpy(n, 1.0, h + end * n, sum);
        if (end >= block) k->axpy(n, -1.0, h + (end - block) * n, sum);
        if (end + 1 < block) continue;
        memcpy(sum + n, sum, n * sizeof *sum);
        if (++held < TOGETHER && end + 1 < count) continue;
        add_squares(held, n, factor, sums, S);
        memcpy(sums, sums + held * n, n * sizeof *sums);
        held = 0;
    }
    for (size_t i = 0; i < n; i++) trace += S[i * n + i];
    return trace / of->trace;
}

/* Whether S is larger than white residuals make it by chance. */
static bool shows(double trace, size_t count, const white *of, size_t block) {
    static const double deviations = 3.0;
    return trace > 1.0 + deviations * sqrt(2.0 / (of->trace * worth(count, block)));
}

/* S -> F, column-major, with F F^T = S + P with eigenvalues raised to 1. Where blocks are few for the number
 * of parameters, S is first mixed with its mean. */
static lg_status take_root(const lg_context *context, size_t n, double trace, double blocks, const white *of,
                           double *S, double *values) {
    const double mixed = fmin(1.0, of->trace / blocks);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            const double P = of->P[i * n + j], G = (i == j ? 1.0 : 0.0) - P;
            S[i * n + j] = (1.0 - mixed) * S[i * n + j] + mixed * trace * G + P;
        }
    LG_TRY(lg_fit_eigen(context, n, S, values));
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) S[j * n + i] *= sqrt(fmax(values[j], 1.0));
    return LG_OK;
}

/* Scores of a direction that the logs do not show are rounding errors. Returns the trace of 1 - P. */
static double clear_open(size_t count, size_t n, const double *P, double *h) {
    static const double open = 0.99;
    double trace = 0.0;
    for (size_t j = 0; j < n; j++) {
        trace += 1.0 - P[j * n + j];
        for (size_t k = 0; P[j * n + j] > open && k < count; k++) h[k * n + j] = 0.0;
    }
    return trace;
}

lg_status lg_fit_colour(const lg_context *context, size_t count, size_t n, size_t least, double share,
                        bool coloured, const double *P, double *h, double *F, size_t *block) {
    static const double nothing = 0.01;
    const size_t most = count / PARTS;
    const white of = {P, clear_open(count, n, P, h)};
    *block = 0;
    if (most == 0 || of.trace < nothing) return LG_OK;
    LG_TRY_SCRATCH(double, parts, context, n *n + (TOGETHER + 1) * n, LG_OUT_OF_MEMORY);
    double *sums = parts + n * n;
    centre(count, n, h);
    for (size_t i = 0; i < count * n; i++) h[i] /= sqrt(share);
    const size_t near = block_of(count, n, h, least, most);
    const double trace = estimate(count, n, h, near, &of, sums, F),
                 spread = estimate(count, n, h, most, &of, sums, parts);
    const bool far = spread > trace;
    lg_status status = LG_OK;
    if (far) memcpy(F, parts, n * n * sizeof *F);
    if (coloured || shows(trace, count, &of, near) || shows(spread, count, &of, most)) {
        *block = far ? most : near;
        status = take_root(context, n, far ? spread : trace, worth(count, *block), &of, F, sums);
        if (status != LG_OK) *block = 0;
    }
    return status == LG_NOT_FINITE ? LG_OK : status; /* scores that are not finite give no errors */
}
