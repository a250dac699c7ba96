/* LAPACK functions by their Fortran names. Matrices are column-major, every argument is passed by address,
 * integers have 32 bits. The comments name what the library uses. */
#ifndef LG_LAPACK_H
#define LG_LAPACK_H

/* Eigenvalues w (n, ascending) of a symmetric matrix and, with jobz "V", its eigenvectors, which become the
 * columns of a. */
extern void dsyevd_(const char *jobz, const char *uplo, const int *n, double *a, const int *lda, double *w,
                    double *work, const int *lwork, int *iwork, const int *liwork, int *info);
/* Cholesky factor of a symmetric matrix; it overwrites the matrix. info > 0: the matrix is not positive
 * definite. */
extern void dpotrf_(const char *uplo, const int *n, double *a, const int *lda, int *info);
/* Solves A X = B, given the factor from dpotrf. */
extern void dpotrs_(const char *uplo, const int *n, const int *nrhs, const double *a, const int *lda,
                    double *b, const int *ldb, int *info);
/* The inverse of A, given the factor from dpotrf. It overwrites the same triangle. */
extern void dpotri_(const char *uplo, const int *n, double *a, const int *lda, int *info);
/* Solves A X = B for a symmetric positive definite A. a becomes its Cholesky factor. */
extern void dposv_(const char *uplo, const int *n, const int *nrhs, double *a, const int *lda, double *b,
                   const int *ldb, int *info);
/* A = Q R by Householder reflections. */
extern void dgeqrf_(const int *m, const int *n, double *a, const int *lda, double *tau, double *work,
                    const int *lwork, int *info);
/* QR factor R of the matrix with A (n, n) above B (m, n). A must be an upper triangle. R overwrites A, and B
 * is overwritten. l = 0 means that B has no zeros to use. nb <= n is the number of columns of a block; t is
 * (ldt, n) with ldt >= nb, and work has nb n numbers. */
extern void dtpqrt_(const int *m, const int *n, const int *l, const int *nb, double *a, const int *lda,
                    double *b, const int *ldb, double *t, const int *ldt, double *work, int *info);
/* A P = Q R, where each step takes the longest remaining column. Column j of A P is column jpvt[j] - 1 of A,
 * j from 0; set jpvt to 0 before the call. */
extern void dgeqp3_(const int *m, const int *n, double *a, const int *lda, int *jpvt, double *tau,
                    double *work, const int *lwork, int *info);
/* The inverse of a triangular matrix; it overwrites the matrix. */
extern void dtrtri_(const char *uplo, const char *diag, const int *n, double *a, const int *lda, int *info);
/* A = U S V'. s (min(m, n)): singular values, descending. With jobz "S", U is (m, min(m, n)) and V' (min(m,
 * n), n). iwork has 8 min(m, n) integers. */
extern void dgesdd_(const char *jobz, const int *m, const int *n, double *a, const int *lda, double *s,
                    double *u, const int *ldu, double *vt, const int *ldvt, double *work, const int *lwork,
                    int *iwork, int *info);
/* C := Q C (side "L", trans "N"), with the Q that dgeqrf stored in a and tau. */
extern void dormqr_(const char *side, const char *trans, const int *m, const int *n, const int *k,
                    const double *a, const int *lda, const double *tau, double *c, const int *ldc,
                    double *work, const int *lwork, int *info);
/* C := alpha A A' + beta C for A (n, k). Only one triangle of C (n, n) is written. This function is part of
 * BLAS. */
extern void dsyrk_(const char *uplo, const char *trans, const int *n, const int *k, const double *alpha,
                   const double *a, const int *lda, const double *beta, double *c, const int *ldc);
/* dgetrf: A = P L U with row exchanges. dgetrs: solves op(A) X = B with these factors (trans "N" or "T").
 * dgecon: the reciprocal condition number, from the factors and anorm = |A|_1. */
extern void dgetrf_(const int *m, const int *n, double *a, const int *lda, int *pivots, int *info);
extern void dgetrs_(const char *trans, const int *n, const int *nrhs, const double *a, const int *lda,
                    const int *pivots, double *b, const int *ldb, int *info);
extern void dgecon_(const char *norm, const int *n, const double *a, const int *lda, const double *anorm,
                    double *rcond, double *work, int *iwork, int *info);
/* Balances a matrix. With job "S", D = diag(scale) consists of powers of 2 that make the rows and columns of
 * D^-1 A D similar in size; a becomes D^-1 A D. */
extern void dgebal_(const char *job, const int *n, double *a, const int *lda, int *low, int *high,
                    double *scale, int *info);
/* Schur form A = Z T Z'. The quasi triangular T overwrites a; the eigenvalues are re + i im. With sort "N",
 * `select` is not called. */
extern void dgees_(const char *jobvs, const char *sort, int (*select)(const double *, const double *),
                   const int *n, double *a, const int *lda, int *chosen, double *re, double *im, double *vs,
                   const int *ldvs, double *work, const int *lwork, int *bwork, int *info);
/* Schur form of the pencil A - z B with the eigenvalues z = (re + i im)/beta. With sort "S", eigenvalues for
 * which `select` returns true come first. */
extern void dgges_(const char *jobvsl, const char *jobvsr, const char *sort,
                   int (*select)(const double *, const double *, const double *), const int *n, double *a,
                   const int *lda, double *b, const int *ldb, int *chosen, double *re, double *im,
                   double *beta, double *vsl, const int *ldvsl, double *vsr, const int *ldvsr, double *work,
                   const int *lwork, int *bwork, int *info);
/* Eigenvalues z, left eigenvectors u with u^H A = z u^H, right eigenvectors v with A v = z v. For a complex
 * pair, the first column has the real part and the second one the imaginary part. */
extern void dgeev_(const char *jobvl, const char *jobvr, const int *n, double *a, const int *lda, double *re,
                   double *im, double *vl, const int *ldvl, double *vr, const int *ldvr, double *work,
                   const int *lwork, int *info);
/* Solves op(A) X + sign X op(B) = scale C for quasi triangular A and B. X overwrites C (m, n). */
extern void dtrsyl_(const char *trana, const char *tranb, const int *sign, const int *m, const int *n,
                    const double *a, const int *lda, const double *b, const int *ldb, double *c,
                    const int *ldc, double *scale, int *info);

#endif
