/* What data say of the shared parameters of a fit: their covariance, with the parameters of single samples
 * eliminated. Each sample is a window of a log and has its own start. */
#ifndef LG_FIT_ERRORS_H
#define LG_FIT_ERRORS_H

#include "core/clean.h"
#include "liegrad/fit.h"

LG_AT(lg_tape_destroy, lg_tape)
LG_AT(lg_fit_destroy, lg_fit)

enum { LG_FIT_MOST_OWN = 128 }; /* largest lg_fit_problem.own, and most residuals of one row of the log */

/* Eigenvalues (n), rising, of the symmetric matrix (n, n), which is replaced by its eigenvectors, one after
 * the other. Errors: LG_NOT_FINITE (the matrix; no convergence), LG_OUT_OF_MEMORY. */
lg_status lg_fit_eigen(const lg_context *context, size_t n, double *matrix, double *values);
/* F (n, n), column-major: if W W^T is the covariance of n parameters for white residuals, W F (W F)^T is the
 * one for the residuals that the scores h (count, n) of successive stretches of the log show, in units of W.
 * h is overwritten. P (n, n), W^T D^-2 W: the part of a prior. `least`: stretches of a window, the least of a
 * block. `share`: part of the log's windows that has scores. `coloured`: that the residuals are not white is
 * known; else it must show. `block`: stretches in a block; 0 means that the residuals are white, or that
 * there are too few stretches, and that F is not set. */
lg_status lg_fit_colour(const lg_context *context, size_t count, size_t n, size_t least, double share,
                        bool coloured, const double *P, double *h, double *F, size_t *block);
/* Sums of a[i] b[i] and of a[i] b[i] c[i]. */
double lg_fit_dot(const double *a, const double *b, size_t n);
double lg_fit_dot3(const double *a, const double *b, const double *c, size_t n);
/* Makes the n columns (rows), each `stride` numbers behind the one before, orthogonal to the `own` columns of
 * a start behind them (modified Gram-Schmidt). Returns the variance that these take: of residuals with the
 * variances `variance` (rows), or of 1 with NULL. A direction has three rotation parameters, but only two are
 * independent: the rest of the third column is rounding error, and the column is skipped. */
double lg_fit_take_start(double *columns, size_t stride, size_t rows, size_t n, size_t own,
                         const double *variance);

/* Sums over windows. R (n, n), column-major, is the factor of J = Q R after the starts of the windows have
 * been eliminated; the columns of J are the shared parameters and, with `last`, the residuals as the last
 * column. `squares` is the sum of the squared residuals, `weighted` the number of independent residuals, less
 * what the starts take. */
typedef struct lg_fit_errors {
    /* ---- set by the caller ---- */
    const lg_context *context;
    lg_fit_problem fit; /* with `linearise`; the residuals of a window are those of its rows, one after the
                         * other, then priors */
    const double *theta;
    size_t n;      /* columns of J, which are the shared parameters and, with `last`, the residuals */
    size_t each;   /* residuals of a row of the log, at most LG_FIT_MOST_OWN */
    size_t priors; /* the last residuals of each window are priors: their number */
    double worth[LG_FIT_MOST_OWN]; /* (each): how many independent residuals a residual is worth */
    double seconds;                /* that the log takes; 0 without blocks in seconds */
    const size_t *start; /* first rows of the windows, which have `window` rows; NULL: no row is in two */
    size_t window;
    /* The used windows are `used` of `windows`, in runs of neighbours of RUN windows if `runs`, else evenly
     * spread. */
    size_t windows, used;
    bool last;
    const double *unmoved; /* parameters at which the residuals are taken; NULL: theta */
    /* (n, n): products of the columns of the Jacobian with the same columns one row of the log later, for
     * errors that are correlated in time. NULL if they are not wanted. */
    double *lagged;
    double
        *lengths; /* (n): gets the squared lengths of the columns before starts are eliminated; may be NULL */
    /* Gets the columns of one window, `rows` apart, in place of all sums; NULL: the sums are wanted. */
    void (*visit)(void *user, double *columns, uint32_t window);
    void *user;
    /* ---- set by lg_fit_errors_gather ---- */
    lg_tape *tape;
    size_t chunk;     /* windows of one chunk, at most */
    size_t rows;      /* residuals of one chunk */
    double *jacobian; /* (rows, n + fit.own) */
    /* (n + fit.own, rows): transpose of `jacobian`, with the residuals as row n - 1 if `last` */
    double *columns;
    double *residuals;  /* (rows) */
    double *triangle;   /* (n, n): R */
    double *reflectors; /* (2 BLOCK, n): work space */
    double *bound;      /* (n): the caller sets it, see lg_fit_errors_invert */
    double squares, weighted;
    bool runs;
    /* (used * stretches, n): J^T r of each stretch of a window, in the order of the windows; NULL: not
     * wanted. `neighbours`: sum of the products of residuals of neighbouring rows. */
    double *scores;
    size_t stretches;
    double *slope; /* (n): J^T r of all windows, with their priors; set with `scores` */
    double neighbours;
} lg_fit_errors;
/* Finds R of the used windows, and with `scored` the scores. lg_fit_errors_end frees what it made, also
 * after a failure; it returns `status` with the tape's message. */
lg_status lg_fit_errors_gather(lg_fit_errors *s, bool scored);
lg_status lg_fit_errors_end(lg_fit_errors *s, lg_status status, lg_error *error);
/* `weighted` with rows that are in several windows counted once, and the variance s^2 of a residual. */
double lg_fit_errors_count(const lg_fit_errors *s);
double lg_fit_errors_variance(const lg_fit_errors *s);
/* W (n, n), column-major, such that W W^T is the inverse of J^T J/s^2 + D^-2, with D the diagonal matrix of
 * s->bound, the deviations before any data. Rows of the factor whose pivot is below 1e-12 of the largest are
 * rounding error and are set to 0. `work`: (3 n, n); `order`: (n). */
lg_status lg_fit_errors_invert(const lg_fit_errors *s, double *work, int *order, double *W);
/* Replaces W by the factor of a covariance for residuals that are correlated in time, if they are: *block is
 * then the length of a block in seconds. Needs scores. */
lg_status lg_fit_errors_colour(const lg_fit_errors *s, double *W, double *block);

#endif
