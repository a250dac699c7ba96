/* Solves Riccati equations by the stable deflating subspace of their extended pencil, then by Newton's
 * method.
 *
 * With N = 2 n + m, an optimal path solves J z' = H z (discrete: J z+ = H z), z = (x, P x, u):
 *       continuous [ A  0   B ]   [ 1 0 0 ]   discrete [ A  0  B ]   [ 1  0   0 ]
 *            H =   [-Q -A^T -S],  [ 0 1 0 ]       H =  [-Q  1 -S ],  [ 0  A^T 0 ]
 *                  [S^T B^T  R]   [ 0 0 0 ] = J        [S^T 0  R ]   [ 0 -B^T 0 ] = J
 * Multiplying both sides by 2 n rows that are orthogonal to the last m columns of H eliminates u and gives
 * the pencil of (x, P x) (Van Dooren, SIAM J. Sci. Stat. Comput. 2, 1981). Its deflating subspace for the n
 * stable eigenvalues is spanned by the columns of (U1; U2), and P = U2 U1^-1. Scaling by D = diag(d, 1/d, e)
 * keeps this form (Benner 2001); if P_D is the solution of the scaled problem, P = d P_D d.
 *
 * Arrays for LAPACK are column-major, all others row-major.
 */
#include <math.h>
#include <string.h>

#include "liegrad/control.h"

#include "kernels/lapack.h"
#include "core/portions.h"
#include "kernels/matrix.h"

enum { MOST_ROWS = 10000, MOST_NEWTON = 8 };
static const double on_boundary = 2e-8, most_residual = 1e-6, asymmetry = 1e-8, most_factor = 0.3,
                    most_correction = 1e-2, rounding = 1e-12, measurable = 1e-8;

typedef struct riccati {
    const lg_riccati *of;
    bool discrete;
    size_t n, m, rows; /* rows: N */
    lg_error *error;
    double *Q, *R; /* (X + X^T)/2 of the given Q and R */
    /* The pencil H, J, column-major (N, N); V (2n, 2n): Schur vectors of dgges; N numbers each: its
     * generalised eigenvalues (re + i im)/beta, the scales of scale_pencil, and tau of dgeqrf. */
    double *H, *J, *V, *re, *im, *beta, *scale, *tau;
    /* Workspace of LAPACK: N integers, `room` doubles. */
    int *integers;
    double *work;
    int room;
    /* Newton's method: the best P and its gain K; the trial P with its gain, closed loop and residual. */
    double *P, *trial, *K, *gain, *closed, *residual, *schur, *Z;
    double *t1, *t2, *right, *W, *L;
    /* Terms of the residual in twice the digits: (n, n), (n, n), (n, m), (m, n), (m, m). */
    lg_matrix_pair PA, term, PB, twice, doubleW;
    double *poles, *found; /* (n, 2): eigenvalues of the closed loop with the best P, with the trial P */
    lg_riccati_result result;
} riccati;

static size_t plan_memory(riccati *s, void *memory) {
    lg_portions from = {memory, 0};
    const size_t n = s->n, m = s->m, N = s->rows, d = sizeof(double);
    double **const square[] = {&s->Q,  &s->P,  &s->trial,   &s->closed, &s->residual,  &s->schur,   &s->Z,
                               &s->t1, &s->t2, &s->PA.high, &s->PA.low, &s->term.high, &s->term.low};
    double **const wide[] = {&s->K,      &s->gain,       &s->right,    &s->PB.high,
                             &s->PB.low, &s->twice.high, &s->twice.low};
    double **const small[] = {&s->R, &s->W, &s->L, &s->doubleW.high, &s->doubleW.low};
    double **const long_one[] = {&s->re, &s->im, &s->beta, &s->scale, &s->tau, &s->poles, &s->found};
    double **const pencil[] = {&s->H, &s->J, &s->V};
    for (size_t i = 0; i < LG_COUNT(square); i++) *square[i] = lg_portion(&from, n * n, d);
    for (size_t i = 0; i < LG_COUNT(wide); i++) *wide[i] = lg_portion(&from, m * n, d);
    for (size_t i = 0; i < LG_COUNT(small); i++) *small[i] = lg_portion(&from, m * m, d);
    for (size_t i = 0; i < LG_COUNT(long_one); i++) *long_one[i] = lg_portion(&from, N, d);
    for (size_t i = 0; i < LG_COUNT(pencil); i++) *pencil[i] = lg_portion(&from, N * N, d);
    s->integers = lg_portion(&from, N, sizeof(int));
    s->room = (int)(40 * N + 16);
    s->work = lg_portion(&from, (size_t)s->room, d);
    return from.used;
}

static bool sizes_fit(size_t n, size_t m) {
    return n >= 1 && m >= 1 && n <= MOST_ROWS && m <= MOST_ROWS && 2 * n + m <= MOST_ROWS;
}

size_t lg_riccati_work_size(size_t n, size_t m) {
    riccati s = {.n = n, .m = m, .rows = 2 * n + m};
    return sizes_fit(n, m) ? plan_memory(&s, NULL) : 0;
}

/* ---- checks of the arguments ---- */

static lg_status check_finite(const riccati *s) {
    const lg_riccati *of = s->of;
    const struct {
        const double *x;
        size_t count;
        const char *name;
    } given[] = {{of->A, s->n * s->n, "A"},
                 {of->B, s->n * s->m, "B"},
                 {of->Q, s->n * s->n, "Q"},
                 {of->R, s->m * s->m, "R"},
                 {of->S, of->S != NULL ? s->n * s->m : 0, "S"}};
    for (size_t i = 0; i < LG_COUNT(given); i++)
        for (size_t k = 0; k < given[i].count; k++)
            if (!isfinite(given[i].x[k]))
                return lg_fail(s->error, LG_NOT_FINITE, "number %zu of %s is not finite", k, given[i].name);
    return LG_OK;
}

/* to = (x + x^T)/2; fails if x is not symmetric to 1e-8 of its largest number. */
static lg_status take_symmetric(const riccati *s, size_t n, const double *x, const char *name, double *to) {
    double largest = 0.0, apart = 0.0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            largest = fmax(largest, fabs(x[i * n + j]));
            apart = fmax(apart, fabs(x[i * n + j] - x[j * n + i]));
            to[i * n + j] = 0.5 * (x[i * n + j] + x[j * n + i]);
        }
    if (apart > asymmetry * largest)
        return lg_fail(s->error, LG_INVALID_ARGUMENT, "%s is not symmetric: two numbers differ by %.3g", name,
                       apart);
    return LG_OK;
}

static lg_status begin(riccati *s, const lg_riccati *of, void *work, size_t bytes) {
    if (of == NULL || of->size != sizeof *of || of->A == NULL || of->B == NULL || of->Q == NULL ||
        of->R == NULL)
        return lg_fail(s->error, LG_INVALID_ARGUMENT,
                       "A, B, Q or R is NULL, or the structure's size is wrong");
    if (!sizes_fit(of->n, of->m))
        return lg_fail(s->error, LG_INVALID_ARGUMENT,
                       "n = %zu states and m = %zu inputs: each must be at least 1, and 2 n + m at most %d",
                       of->n, of->m, MOST_ROWS);
    s->of = of, s->n = of->n, s->m = of->m, s->rows = 2 * of->n + of->m;
    LG_TRY(lg_portions_check(work, bytes, lg_riccati_work_size(s->n, s->m), s->error));
    (void)plan_memory(s, work);
    LG_TRY(check_finite(s));
    LG_TRY(take_symmetric(s, s->n, of->Q, "Q", s->Q));
    LG_TRY(take_symmetric(s, s->m, of->R, "R", s->R));
    if (!s->discrete && !lg_matrix_cholesky(s->m, s->R, s->L))
        return lg_fail(s->error, LG_INVALID_ARGUMENT,
                       "R is not positive definite: each input needs a weight above 0");
    return LG_OK;
}

/* ---- the pencil ---- */

static void fill_pencil(const riccati *s) {
    const size_t n = s->n, m = s->m, N = s->rows;
    double *H = s->H, *J = s->J;
#define AT(matrix, i, j) (matrix)[(i) + (j)*N]
    memset(H, 0, N * N * sizeof *H);
    memset(J, 0, N * N * sizeof *J);
    for (size_t i = 0; i < n; i++) {
        AT(J, i, i) = 1.0;
        AT(s->discrete ? H : J, n + i, n + i) = 1.0;
        for (size_t j = 0; j < n; j++) {
            AT(H, i, j) = s->of->A[i * n + j];
            AT(H, n + i, j) = -s->Q[i * n + j];
            if (s->discrete)
                AT(J, n + i, n + j) = s->of->A[j * n + i];
            else
                AT(H, n + i, n + j) = -s->of->A[j * n + i];
        }
        for (size_t j = 0; j < m; j++) {
            const double b = s->of->B[i * m + j], cross = s->of->S != NULL ? s->of->S[i * m + j] : 0.0;
            AT(H, i, 2 * n + j) = b;
            AT(H, n + i, 2 * n + j) = -cross;
            AT(H, 2 * n + j, i) = cross;
            if (s->discrete)
                AT(J, 2 * n + j, n + i) = -b;
            else
                AT(H, 2 * n + j, n + i) = b;
        }
    }
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) AT(H, 2 * n + i, 2 * n + j) = s->R[i * m + j];
#undef AT
}

/* H <- D^-1 H D and J <- D^-1 J D with D = diag(1/d, d, ...), all powers of 2. s->scale is the diagonal of
 * D^-1, which begins with d. */
static void scale_pencil(const riccati *s) {
    const size_t n = s->n, N = s->rows;
    const int size = (int)N;
    int low, high, info;
    double *sum = s->V, *scale = s->scale;
    for (size_t k = 0; k < N * N; k++) sum[k] = k % (N + 1) == 0 ? 0.0 : fabs(s->H[k]) + fabs(s->J[k]);
    dgebal_("S", &size, sum, &size, &low, &high, scale, &info);
    if (info != 0)
        for (size_t i = 0; i < N; i++) scale[i] = 1.0;
    double middle = 0.0; /* mean of the first 2n logarithms: the form (d, 1/d) below shifts it to 0 */
    for (size_t i = 0; i < 2 * n; i++) middle += log2(scale[i]) / (double)(2 * n);
    for (size_t i = 2 * n; i < N; i++) scale[i] = exp2(nearbyint(middle - log2(scale[i])));
    for (size_t i = 0; i < n; i++) {
        const double power = nearbyint(0.5 * (log2(scale[n + i]) - log2(scale[i])));
        scale[i] = exp2(power), scale[n + i] = exp2(-power);
    }
    for (size_t j = 0; j < N; j++)
        for (size_t i = 0; i < N; i++) {
            s->H[i + j * N] *= scale[i] / scale[j];
            s->J[i + j * N] *= scale[i] / scale[j];
        }
}

/* Multiplies H and J from the left by Q^T, where Q (U; 0) is the QR decomposition of the last m columns of H.
 * Then the last 2n rows and first 2n columns of H and J are the pencil of (x, P x). */
static void take_input_out(const riccati *s) {
    const int N = (int)s->rows, m = (int)s->m, n2 = 2 * (int)s->n;
    double *columns = s->H + 2 * s->n * s->rows;
    int info;
    dgeqrf_(&N, &m, columns, &N, s->tau, s->work, &s->room, &info);
    dormqr_("L", "T", &N, &n2, &m, columns, &N, s->tau, s->H, &N, s->work, &s->room, &info);
    dormqr_("L", "T", &N, &n2, &m, columns, &N, s->tau, s->J, &N, s->work, &s->room, &info);
}

static int in_left_half(const double *re, const double *im, const double *beta) {
    return *beta > 0.0 && *re < 0.0;
}

static int in_circle(const double *re, const double *im, const double *beta) {
    return hypot(*re, *im) < *beta;
}

/* Number of eigenvalues z that count as on the boundary of stability: |Re z|, or | |z| - 1 | if discrete, is
 * at most on_boundary |z|. */
static size_t count_on_boundary(const riccati *s) {
    size_t count = 0;
    for (size_t i = 0; i < 2 * s->n; i++) {
        const double size = hypot(s->re[i], s->im[i]);
        const double off = s->discrete ? fabs(size - s->beta[i]) : fabs(s->re[i]);
        if (off <= on_boundary * size) count++;
    }
    return count;
}

static lg_status explain(const riccati *s, const char *finding);

static lg_status find_subspace(const riccati *s) {
    const int N = (int)s->rows, n2 = 2 * (int)s->n, one = 1;
    int chosen = 0, info = 0;
    double none = 0.0;
    dgges_("N", "V", "S", s->discrete ? in_circle : in_left_half, &n2, s->H + s->m, &N, s->J + s->m, &N,
           &chosen, s->re, s->im, s->beta, &none, &one, s->V, &n2, s->work, &s->room, s->integers, &info);
    /* info = 2n + 2: rounding moved an eigenvalue across the boundary; `chosen` takes this into account. */
    if (info != 0 && info != n2 + 2)
        return lg_fail(s->error, LG_NO_CONVERGENCE, "LAPACK's dgges failed with %d", info);
    if (chosen != (int)s->n || count_on_boundary(s) > 0)
        return explain(s, s->discrete ? "the pencil has eigenvalues on the unit circle"
                                      : "the pencil has eigenvalues on the imaginary axis");
    return LG_OK;
}

/* trial = P = d U2 U1^-1 d, where d undoes the scaling of the pencil. */
static lg_status solve_subspace(const riccati *s) {
    const size_t n = s->n;
    const int size = (int)n;
    int info;
    double sum = 0.0, reciprocal = 0.0;
    for (size_t j = 0; j < n; j++) {
        double column = 0.0;
        for (size_t i = 0; i < n; i++) {
            s->t1[i + j * n] = s->V[i + j * 2 * n];
            s->t2[j + i * n] = s->V[n + i + j * 2 * n]; /* U2^T */
            column += fabs(s->t1[i + j * n]);
        }
        sum = fmax(sum, column);
    }
    dgetrf_(&size, &size, s->t1, &size, s->integers, &info);
    if (info == 0) {
        int *iwork = s->integers + n;
        dgecon_("1", &size, s->t1, &size, &sum, &reciprocal, s->work, iwork, &info);
    }
    if (info != 0 || !(reciprocal > 2.2e-16))
        return explain(s, "P cannot be computed from the stable subspace in double precision");
    dgetrs_("T", &size, &size, s->t1, &size, s->integers, s->t2, &size, &info);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) s->trial[i * n + j] = s->scale[i] * s->t2[i * n + j] * s->scale[j];
    lg_matrix_symmetrise(n, s->trial);
    return LG_OK;
}

/* ---- Newton's method ---- */

/* closed = A - B gain */
static void close_loop(const riccati *s) {
    const size_t n = s->n;
    lg_matrix_multiply(n, n, s->m, s->of->B, s->gain, s->closed);
    for (size_t i = 0; i < n * n; i++) s->closed[i] = s->of->A[i] - s->closed[i];
}

/* For the trial P computes right = B^T P + S^T and W = R (discrete: right = B^T P A + S^T, W = R + B^T P B),
 * and the same in twice the digits: `twice` and `doubleW`. */
static void weigh(const riccati *s) {
    const size_t n = s->n, m = s->m;
    const lg_matrix_pair A = {(double *)s->of->A, NULL}, B = {(double *)s->of->B, NULL}, P = {s->trial, NULL};
    lg_matrix_multiply_twice(n, n, n, s->trial, A, s->PA);
    lg_matrix_multiply_twice(m, n, n, s->of->B, s->discrete ? s->PA : P, s->twice);
    if (s->of->S != NULL) {
        lg_matrix_transpose(n, m, s->of->S, s->right);
        lg_matrix_add_twice(m * n, s->right, s->twice);
    }
    memset(s->doubleW.high, 0, m * m * sizeof *s->W);
    memset(s->doubleW.low, 0, m * m * sizeof *s->W);
    if (s->discrete) {
        lg_matrix_multiply_twice(n, m, n, s->trial, B, s->PB);
        lg_matrix_multiply_twice(m, m, n, s->of->B, s->PB, s->doubleW);
    }
    lg_matrix_add_twice(m * m, s->R, s->doubleW);
    memcpy(s->right, s->twice.high, m * n * sizeof *s->right);
    memcpy(s->W, s->doubleW.high, m * m * sizeof *s->W);
}

/* Adds sign x, or sign x^T if `transposed`, to the residual. residual + t2 hold it in twice the digits. */
static void add_term(const riccati *s, double sign, lg_matrix_pair x, bool transposed) {
    const size_t n = s->n;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            const size_t from = transposed ? j * n + i : i * n + j, to = i * n + j;
            const double term = sign * x.high[from], before = s->residual[to], sum = before + term;
            const double taken = sum - before;
            s->residual[to] = sum;
            s->t2[to] += (before - (sum - taken)) + (term - taken) + sign * x.low[from];
        }
}

/* For the trial P computes the gain K (m, n), closed = A - B K and the residual. *relative is the residual's
 * norm over the sum of the norms of its terms. False if W is not positive definite. An error of the residual
 * would enter P divided by the distance of the closed loop from the boundary of stability. Therefore the
 * terms are summed in twice the digits, and -right^T W^-1 right is computed as K^T (W K - right) - right^T K,
 * where the rounding error of K has no first-order effect. */
static bool evaluate(const riccati *s, double *relative) {
    const size_t n = s->n, m = s->m;
    weigh(s);
    if (!lg_matrix_cholesky(m, s->W, s->L)) return false;
    lg_kernels_for(LG_F64)->spd_solve(1, m, n, s->L, s->right, s->gain);
    memcpy(s->residual, s->Q, n * n * sizeof *s->residual);
    memset(s->t2, 0, n * n * sizeof *s->t2);
    double size = lg_matrix_norm(n * n, s->Q);
    if (s->discrete) {
        for (size_t i = 0; i < n * n; i++) s->t1[i] = 0.0;
        add_term(s, -1.0, (lg_matrix_pair){s->trial, s->t1}, false);
        lg_matrix_multiply_twice(n, n, n, s->of->A, s->PA, s->term);
        add_term(s, 1.0, s->term, false);
        size += lg_matrix_norm(n * n, s->term.high) + lg_matrix_norm(n * n, s->trial);
    } else {
        add_term(s, 1.0, s->PA, false);
        add_term(s, 1.0, s->PA, true);
        size += 2.0 * lg_matrix_norm(n * n, s->PA.high);
    }
    lg_matrix_multiply_twice(n, n, m, s->gain, s->twice, s->term); /* K^T right */
    add_term(s, -1.0, s->term, false);
    size += lg_matrix_norm(n * n, s->term.high);
    lg_matrix_multiply_twice(n, m, m, s->gain, s->doubleW, s->PB); /* K^T W */
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < m; j++)
            s->right[j * n + i] = s->PB.high[i * m + j] - s->twice.high[j * n + i] +
                                  (s->PB.low[i * m + j] - s->twice.low[j * n + i]);
    lg_matrix_multiply_tn(n, n, m, s->gain, s->right, s->t1);
    lg_matrix_add(n * n, 1.0, s->t1, s->t2);
    lg_matrix_add(n * n, 1.0, s->t2, s->residual);
    lg_matrix_symmetrise(n, s->residual);
    const double off = lg_matrix_norm(n * n, s->residual);
    *relative = off > 0.0 ? off / size : off;
    close_loop(s);
    return true;
}

/* Eigenvalues of `closed` into `found`, and their *margin. It uses the Schur form (d closed d^-1)^T = Z T Z^T
 * with the scales d of the pencil; T is in s->schur. The transpose arises because LAPACK reads the row-major
 * `closed` by columns. False if LAPACK fails. */
static bool find_poles(const riccati *s, double *margin) {
    const int n = (int)s->n;
    int chosen, info, unused = 0;
    for (size_t i = 0; i < s->n; i++)
        for (size_t j = 0; j < s->n; j++)
            s->schur[i * s->n + j] = s->closed[i * s->n + j] * (s->scale[i] / s->scale[j]);
    dgees_("V", "N", NULL, &n, s->schur, &n, &chosen, s->re, s->im, s->Z, &n, s->work, &s->room, &unused,
           &info);
    *margin = INFINITY;
    for (size_t i = 0; i < s->n; i++) {
        s->found[2 * i] = s->re[i], s->found[2 * i + 1] = s->im[i];
        *margin = fmin(*margin, s->discrete ? 1.0 - hypot(s->re[i], s->im[i]) : -s->re[i]);
    }
    return info == 0;
}

/* t1 = X, the solution of closed^T X + X closed = -residual: with Y = Z^T X Z, T Y + Y T^T = -Z^T residual Z
 * (Bartels & Stewart 1972), where X and the residual are scaled like P. The column-major Z read by rows is
 * Z^T; for symmetric matrices the order does not matter. */
static void correct_continuous(const riccati *s) {
    const size_t n = s->n;
    const int size = (int)n, plus = 1;
    double scale = 1.0;
    int info;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) s->residual[i * n + j] /= s->scale[i] * s->scale[j];
    lg_matrix_multiply(n, n, n, s->Z, s->residual, s->t1);
    lg_matrix_transpose(n, n, s->Z, s->t2);
    lg_matrix_multiply(n, n, n, s->t1, s->t2, s->residual);
    dtrsyl_("N", "T", &plus, &size, &size, s->schur, &size, s->schur, &size, s->residual, &size, &scale,
            &info);
    lg_matrix_symmetrise(n, s->residual);
    lg_matrix_multiply(n, n, n, s->t2, s->residual, s->t1);
    lg_matrix_multiply(n, n, n, s->t1, s->Z, s->t2);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            s->t1[i * n + j] = s->t2[i * n + j] / -scale * (s->scale[i] * s->scale[j]);
}

/* t1 = X, the solution of closed^T X closed - X = -residual: X = sum_k (closed^k)^T residual closed^k by
 * doubling (Smith 1968). Overwrites `closed`. */
static void correct_discrete(const riccati *s) {
    const size_t n = s->n;
    double *X = s->t1, *power = s->closed, *next = s->schur;
    memcpy(X, s->residual, n * n * sizeof *X);
    for (int doubling = 0; doubling < 60; doubling++) {
        lg_matrix_multiply(n, n, n, X, power, s->t2);
        lg_matrix_multiply_tn(n, n, n, power, s->t2, next);
        const double added = lg_matrix_norm(n * n, next);
        lg_matrix_add(n * n, 1.0, next, X);
        if (!(added > 1e-16 * lg_matrix_norm(n * n, X))) return;
        lg_matrix_multiply(n, n, n, power, power, next);
        memcpy(power, next, n * n * sizeof *power);
    }
}

/* t1 = the Newton correction X at P: residual + closed^T X + X closed = 0, or, if discrete,
 * residual + closed^T X closed - X = 0. */
static void correct(const riccati *s) {
    if (s->discrete)
        correct_discrete(s);
    else
        correct_continuous(s);
}

/* The norm of the Newton correction at P + X over the norm of X, where X = t1 is the correction at P. The
 * residual at P + X is -right^T W^-1 right with right = B^T X (discrete: right = B^T X closed, W is replaced
 * by W + B^T X B). As it is computed from X alone, it is free of the rounding errors of P. Overwrites t1. */
static double contraction(const riccati *s) {
    const size_t n = s->n, m = s->m;
    const double *B = s->of->B, size = lg_matrix_norm(n * n, s->t1);
    if (!(size > 0.0)) return size; /* 0 or NaN */
    close_loop(s);
    lg_matrix_multiply_tn(m, n, n, B, s->t1, s->right);
    if (s->discrete) {
        lg_matrix_multiply(m, m, n, s->right, B, s->L);
        lg_matrix_add(m * m, 1.0, s->L, s->W);
        memcpy(s->H, s->right, m * n * sizeof *s->H);
        lg_matrix_multiply(m, n, n, s->H, s->closed, s->right);
    }
    if (!lg_matrix_cholesky(m, s->W, s->L)) return INFINITY;
    lg_kernels_for(LG_F64)->spd_solve(1, m, n, s->L, s->right, s->gain);
    lg_matrix_multiply_tn(n, n, m, s->right, s->gain, s->residual);
    lg_matrix_symmetrise(n, s->residual);
    correct(s);
    return lg_matrix_norm(n * n, s->t1) / size;
}

static void keep(riccati *s, double residual, double margin) {
    const size_t n = s->n;
    memcpy(s->P, s->trial, n * n * sizeof *s->P);
    memcpy(s->K, s->gain, s->m * n * sizeof *s->K);
    memcpy(s->poles, s->found, 2 * n * sizeof *s->poles);
    s->result.residual = residual;
    s->result.margin = margin;
}

/* Newton's method from the trial P. An iterate is kept if its residual is smaller than the one before.
 * Residuals below `rounding` say nothing; there an iterate is kept if its correction is less than half of the
 * one before. P counts as near a solution if `contraction` is small: it tends to 0 at a stabilising solution,
 * but to 1/2 if there are eigenvalues on the boundary. */
static lg_status refine(riccati *s) {
    const size_t n = s->n;
    double before = INFINITY, change_before = INFINITY, factor = INFINITY;
    for (uint32_t step = 0; step <= MOST_NEWTON; step++) {
        double residual = INFINITY, margin = 0.0;
        const bool usable = evaluate(s, &residual) && find_poles(s, &margin) && margin > 0.0;
        if (step == 0 && !usable) return explain(s, "the closed loop is not stable");
        if (step > 0 && (!usable || !(residual < fmax(before, rounding)))) break;
        correct(s);
        const double change = lg_matrix_norm(n * n, s->t1), size = lg_matrix_norm(n * n, s->trial);
        const double correction = change > 0.0 ? change / size : 0.0;
        if (step > 0 && residual < rounding && !(correction < 0.5 * change_before)) break;
        keep(s, residual, margin);
        s->result.refinements = step;
        s->result.correction = correction;
        if (!(correction > 0.0)) break;
        lg_matrix_add(n * n, 1.0, s->t1, s->trial);
        lg_matrix_symmetrise(n, s->trial);
        if (step == 0 || correction > measurable) factor = contraction(s);
        before = residual, change_before = correction;
    }
    const bool near_one =
        (factor <= most_factor || !(s->result.correction > 0.0)) && s->result.correction <= most_correction;
    return near_one ? LG_OK : explain(s, "Newton's method does not converge");
}

/* Whether the weights Q and S are 0 and A is stable: then P = 0, and a relative residual is not defined. */
static bool is_at_rest(const riccati *s) {
    const size_t n = s->n;
    double residual, margin;
    memset(s->trial, 0, n * n * sizeof *s->trial);
    return lg_matrix_norm(n * n, s->Q) == 0.0 &&
           (s->of->S == NULL || lg_matrix_norm(n * s->m, s->of->S) == 0.0) && evaluate(s, &residual) &&
           find_poles(s, &margin) && margin > on_boundary * lg_matrix_norm(n * n, s->of->A);
}

static lg_status find_first(const riccati *s) {
    for (size_t i = 0; i < s->n; i++) s->scale[i] = 1.0;
    if (is_at_rest(s)) return LG_OK;
    fill_pencil(s);
    scale_pencil(s);
    take_input_out(s);
    LG_TRY(find_subspace(s));
    return solve_subspace(s);
}

static lg_status solve(bool discrete, const lg_riccati *of, double *P, double *K, double *eigenvalues,
                       lg_riccati_result *result, void *work, size_t bytes, lg_error *error) {
    riccati s = {.discrete = discrete, .error = error};
    LG_TRY(begin(&s, of, work, bytes));
    LG_TRY(find_first(&s));
    LG_TRY(refine(&s));
    if (!(s.result.residual <= most_residual))
        return lg_fail(error, LG_NO_CONVERGENCE,
                       "the solution is too inaccurate: its residual is %.2g of the terms of the equation",
                       s.result.residual);
    if (P != NULL) memcpy(P, s.P, s.n * s.n * sizeof *P);
    if (K != NULL) memcpy(K, s.K, s.m * s.n * sizeof *K);
    if (eigenvalues != NULL) memcpy(eigenvalues, s.poles, 2 * s.n * sizeof *eigenvalues);
    if (result != NULL) *result = s.result;
    return LG_OK;
}

lg_status lg_care(const lg_riccati *equation, double *P, double *K, double *eigenvalues,
                  lg_riccati_result *result, void *work, size_t bytes, lg_error *error) {
    return solve(false, equation, P, K, eigenvalues, result, work, bytes, error);
}

lg_status lg_dare(const lg_riccati *equation, double *P, double *K, double *eigenvalues,
                  lg_riccati_result *result, void *work, size_t bytes, lg_error *error) {
    return solve(true, equation, P, K, eigenvalues, result, work, bytes, error);
}

/* ---- why there is no solution ---- */

/* |matrix v| / (|matrix| |v|) for a matrix (other, n), or |v^T matrix| / (|matrix| |v|) for a matrix (n,
 * other) if from_left. v = re + i im; im may be NULL, which means 0. */
static double seen(size_t n, size_t other, bool from_left, const double *matrix, const double *re,
                   const double *im) {
    double sum = 0.0, length = 0.0;
    for (size_t i = 0; i < n; i++) length += re[i] * re[i] + (im != NULL ? im[i] * im[i] : 0.0);
    for (size_t j = 0; j < other; j++) {
        double x = 0.0, y = 0.0;
        for (size_t i = 0; i < n; i++) {
            const double a = from_left ? matrix[i * other + j] : matrix[j * n + i];
            x += a * re[i];
            if (im != NULL) y += a * im[i];
        }
        sum += x * x + y * y;
    }
    const double norm = lg_matrix_norm(n * other, matrix);
    return norm > 0.0 ? sqrt(sum / length) / norm : 0.0;
}

/* Fails with the reason: an eigenvalue of A that is not stable and that no input reaches (left eigenvector
 * times B is 0), or one on the boundary of stability that Q does not see (Q times right eigenvector is 0);
 * otherwise `finding`. These are the tests of Popov, Belevitch and Hautus. */
static lg_status explain(const riccati *s, const char *finding) {
    const size_t n = s->n;
    const int size = (int)n;
    double *right_of = s->Z,
           *left_of = s->schur; /* LAPACK sees A^T: right_of are left eigenvectors of A, left_of right ones */
    int info;
    memcpy(s->t1, s->of->A, n * n * sizeof *s->t1);
    dgeev_("V", "V", &size, s->t1, &size, s->re, s->im, left_of, &size, right_of, &size, s->work, &s->room,
           &info);
    for (size_t i = 0; info == 0 && i < n; i++) {
        const double re = s->re[i], im = s->im[i], modulus = hypot(re, im);
        const double out = s->discrete ? modulus - 1.0 : re, near = 1e-6 * modulus;
        const double *reach = right_of + i * n, *see = left_of + i * n;
        if (out < -near || im < 0.0) continue;
        if (seen(n, s->m, true, s->of->B, reach, im > 0.0 ? reach + n : NULL) < 1e-9)
            return lg_fail(s->error, LG_CHECK_FAILED,
                           "(A, B) is not stabilisable: no input reaches the eigenvalue %.6g%+.6gi of A", re,
                           im);
        if (s->of->S == NULL && out <= near && seen(n, n, false, s->Q, see, im > 0.0 ? see + n : NULL) < 1e-9)
            return lg_fail(s->error, LG_CHECK_FAILED,
                           "no stabilising solution: Q gives no weight to the eigenvalue %.6g%+.6gi of A, "
                           "which is on the boundary of stability",
                           re, im);
    }
    return lg_fail(s->error, LG_CHECK_FAILED, "no stabilising solution found: %s", finding);
}
