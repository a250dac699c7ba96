/* LAPACK by its Fortran names: column-major, every argument by address, 32-bit integers. */
#ifndef LG_LAPACK_H
#define LG_LAPACK_H

/* Eigenvalues w (n, rising) and, jobz "V", eigenvectors (columns of a) of a symmetric matrix. */
extern void dsyevd_(const char *jobz, const char *uplo, const int *n, double *a, const int *lda, double *w,
                    double *work, const int *lwork, int *iwork, const int *liwork, int *info);
/* Cholesky's factor of a symmetric matrix, in its place; info > 0: it is not positive definite. */
extern void dpotrf_(const char *uplo, const int *n, double *a, const int *lda, int *info);
/* Solves A X = B with it. */
extern void dpotrs_(const char *uplo, const int *n, const int *nrhs, const double *a, const int *lda,
                    double *b, const int *ldb, int *info);
/* The inverse of the matrix, in the factor's place, the same triangle. */
extern void dpotri_(const char *uplo, const int *n, double *a, const int *lda, int *info);
/* Solves A X = B, A symmetric positive definite; a becomes its factor. */
extern void dposv_(const char *uplo, const int *n, const int *nrhs, double *a, const int *lda, double *b,
                   const int *ldb, int *info);
/* A = Q R by Householder reflections. */
extern void dgeqrf_(const int *m, const int *n, double *a, const int *lda, double *tau, double *work,
                    const int *lwork, int *info);
/* A P = Q R, the longest column that is left first: column jpvt[j] - 1 of A is column j (jpvt 0 on entry). */
extern void dgeqp3_(const int *m, const int *n, double *a, const int *lda, int *jpvt, double *tau,
                    double *work, const int *lwork, int *info);
/* The inverse of a triangular matrix, in its place. */
extern void dtrtri_(const char *uplo, const char *diag, const int *n, double *a, const int *lda, int *info);
/* A = U S V': singular values s (min(m, n), falling); jobz "S": U (m, min), V' (min, n). iwork (8 min). */
extern void dgesdd_(const char *jobz, const int *m, const int *n, double *a, const int *lda, double *s,
                    double *u, const int *ldu, double *vt, const int *ldvt, double *work, const int *lwork,
                    int *iwork, int *info);
/* C := Q C (side "L", trans "N"), Q as dgeqrf left it. */
extern void dormqr_(const char *side, const char *trans, const int *m, const int *n, const int *k,
                    const double *a, const int *lda, const double *tau, double *c, const int *ldc,
                    double *work, const int *lwork, int *info);
/* C := alpha A A' + beta C, one triangle of C (n, n), A (n, k); BLAS. */
extern void dsyrk_(const char *uplo, const char *trans, const int *n, const int *k, const double *alpha,
                   const double *a, const int *lda, const double *beta, double *c, const int *ldc);
/* A P = L U with row exchanges; solves op(A) X = B with it (trans "N", "T"); 1/condition from it, |A|_1. */
extern void dgetrf_(const int *m, const int *n, double *a, const int *lda, int *pivots, int *info);
extern void dgetrs_(const char *trans, const int *n, const int *nrhs, const double *a, const int *lda,
                    const int *pivots, double *b, const int *ldb, int *info);
extern void dgecon_(const char *norm, const int *n, const double *a, const int *lda, const double *anorm,
                    double *rcond, double *work, int *iwork, int *info);
/* job "S": scale (n) powers of 2 that make rows and columns of D^-1 A D of a size; a becomes that. */
extern void dgebal_(const char *job, const int *n, double *a, const int *lda, int *low, int *high,
                    double *scale, int *info);
/* A = Z T Z', T quasi triangular in its place, eigenvalues re + i im. `select` is not called for sort "N". */
extern void dgees_(const char *jobvs, const char *sort, int (*select)(const double *, const double *),
                   const int *n, double *a, const int *lda, int *chosen, double *re, double *im, double *vs,
                   const int *ldvs, double *work, const int *lwork, int *bwork, int *info);
/* The same of the pencil A - z B, z = (re + i im)/beta; sort "S": those that `select` likes come first. */
extern void dgges_(const char *jobvsl, const char *jobvsr, const char *sort,
                   int (*select)(const double *, const double *, const double *), const int *n, double *a,
                   const int *lda, double *b, const int *ldb, int *chosen, double *re, double *im,
                   double *beta, double *vsl, const int *ldvsl, double *vsr, const int *ldvsr, double *work,
                   const int *lwork, int *bwork, int *info);
/* Eigenvalues; left eigenvectors u^H A = z u^H, right ones A v = z v; of a pair: real part, imaginary
 * part. */
extern void dgeev_(const char *jobvl, const char *jobvr, const int *n, double *a, const int *lda, double *re,
                   double *im, double *vl, const int *ldvl, double *vr, const int *ldvr, double *work,
                   const int *lwork, int *info);
/* op(A) X + sign X op(B) = scale C, A and B quasi triangular, X in the place of C (m, n). */
extern void dtrsyl_(const char *trana, const char *tranb, const int *sign, const int *m, const int *n,
                    const double *a, const int *lda, const double *b, const int *ldb, double *c,
                    const int *ldc, double *scale, int *info);

#endif
