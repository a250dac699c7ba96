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

#endif
