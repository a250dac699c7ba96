/* A run of minimisation: its state, which is saved, and the tables of its methods. */
#ifndef LG_MINIMISE_INTERNAL_H
#define LG_MINIMISE_INTERNAL_H

#include "core/core.h"
#include "kernels/kernels.h"
#include "liegrad/minimise.h"

/* What the next value and gradient are for. */
typedef enum lg_minimise_stage {
    LG_STAGE_START,  /* the first of all */
    LG_STAGE_CHECK,  /* comparing g with f */
    LG_STAGE_SEARCH, /* along d */
    LG_STAGE_DONE,
    LG_STAGE_HESSIAN,  /* differences of g: the whole Hessian */
    LG_STAGE_CURVATURE /* the same along Lanczos vectors */
} lg_minimise_stage;
#define LG_MINIMISE_STAGE_COUNT 6

/* The state beside the vectors. Members of one struct are of one type: each is saved as an array. */
typedef struct lg_minimise_counts {
    uint64_t stage, end, evaluations, iterations;
    uint64_t failures;  /* searches that failed since the last step */
    uint64_t endless;   /* searches since the last one that found an end to the fall of f */
    uint64_t trials;    /* evaluations of this search or check */
    uint64_t bounded;   /* this search has an upper end; this check has found a difference */
    uint64_t pairs;     /* curvature pairs taken since H = 1 */
    uint64_t reference; /* iteration at which reference_value was taken */
} lg_minimise_counts;

typedef struct lg_minimise_numbers {
    double value, slope; /* f and g.d at x */
    double alpha;        /* trial step */
    double low, low_value, low_slope;
    /* The search's bracket [low, high]; Levenberg-Marquardt: high_value is f of the last refusal. */
    double high, high_value, high_slope;
    double reference_value;
    double damping; /* Levenberg-Marquardt: mu; of a Newton step: the shift of the Hessian */
    double growth;  /* Levenberg-Marquardt: the factor of mu after the next refusal */
    double check_value[4], check_slope[4];
} lg_minimise_numbers;

typedef struct lg_minimise_row {
    const char *name;
    bool dense;     /* it has a matrix of n^2 numbers */
    bool squares;   /* it takes sums of squares alone */
    uint64_t slow;  /* the run ends after so many iterations that do not lower f */
    uint64_t creep; /* so many, and 4 n, without half of f call for a Newton step */
    /* Doubles before the Hessian in its memory. */
    size_t (*before_hessian)(const struct lg_minimiser *m);
    /* Doubles of its memory, as saved. */
    size_t (*length)(size_t n, const lg_minimise_options *options);
    bool by_rows; /* it begins with n rows at a stride, which ranks divide */
    /* Takes a step: s (n) and y (n), y.s > 0, and the new gradient m->g. Then m->d = -H g. s and y may be
     * used as scratch. */
    void (*update)(struct lg_minimiser *m, double *s, double *y);
    void (*direction)(struct lg_minimiser *m); /* m->d = -H g, where there are pairs */
    /* H becomes S (L L^T)^-1 S, S = diag(scale); L lower triangular, packed (n, n), in m->curvature. NULL:
     * cannot. */
    void (*invert)(struct lg_minimiser *m, const double *scale);
} lg_minimise_row;

/* Of lg_least_squares: r (rows) and the columns of J (n, rows) at the trial and at x, and room for a factor
 * of J. */
typedef struct lg_minimise_squares {
    size_t rows;
    const double *trial_r, *trial_columns;
    double *r, *columns, *stack; /* stack: lg_minimise_stack_length */
} lg_minimise_squares;
enum { LG_SQUARES_ROOM = 34 };
static inline size_t lg_minimise_stack_length(size_t rows, size_t n) {
    return (rows + n) * (n + 1) + n + LG_SQUARES_ROOM * n;
}

struct lg_minimiser {
    const lg_context *context;
    const lg_kernels *k;
    lg_minimise_options options;
    const lg_minimise_row *row;
    size_t n, length, held;
    size_t first, end; /* rows of this rank */
    size_t *bytes;     /* (ranks): of an exchange */
    lg_status status;  /* of the exchanges */
    /* The caller's units of x (n) and of f, in which the gradient is compared with its tolerance; NULL, 1:
     * ones. */
    const double *unit;
    double value_unit;
    const lg_minimise_squares *squares; /* NULL: the Gauss-Newton matrix is all there is */
    bool newton;                        /* searches along a Newton step; of LM, which has other steps */
    bool last;                          /* of lg_least_squares: the step after which it ends */
    double *memory;                     /* all vectors */
    double *x, *g, *d, *point;          /* (n) */
    double *curvature;                  /* (held): what this rank has of (length) */
    double *whole;                      /* (length): on rank 0 between a collection and the next step */
    double *s, *y;                      /* (n), scratch */
    lg_minimise_counts counts;
    lg_minimise_numbers numbers;
};

/* The rows, in the order of lg_minimise_method, which need not name all; NULL beyond the last. */
const lg_minimise_row *lg_minimise_row_at(size_t index);

/* Ends the run: the point is the best one. */
void lg_minimise_finish(lg_minimiser *m, lg_minimise_end end);
/* The end where no step lowers f: the nearest upper end of the step tells why. */
lg_minimise_end lg_minimise_no_step(const lg_minimiser *m);
/* The direction of checks goes to m->s, always the same. */
void lg_minimise_check_direction(lg_minimiser *m);
/* Whether the gradient is zero to its tolerance; after a step, whether f falls too slowly. */
bool lg_minimise_flat(const lg_minimiser *m);
bool lg_minimise_slow(lg_minimiser *m);

/* Whether the steps since the last look, row->creep + 4 n of them, have not halved f. */
bool lg_minimise_creeps(lg_minimiser *m);
/* Whether a Newton step that lowers f by `fall` is worth another one. */
bool lg_minimise_newton_pays(const lg_minimiser *m, double fall);
/* max |g_i| in the caller's units. */
double lg_minimise_gradient_size(const lg_minimiser *m);
/* Searches along d from x, from trial step alpha; down the gradient where d does not fall. */
void lg_minimise_search(lg_minimiser *m, double alpha);

/* Where searches have failed: 2 n evaluations give the Hessian, and a search along the Newton step follows.
 * Alone, with few variables, and with options.check. */
bool lg_minimise_newton_fits(const lg_minimiser *m);
/* Ends, if the Hessian cannot be looked at; else goes on to look, which ends or finds a way down. */
lg_minimise_end lg_minimise_verify(lg_minimiser *m, lg_minimise_end end);
void lg_minimise_newton_tell(lg_minimiser *m, const double *gradient);
/* Searches along d, also where g is zero and d leads from a saddle or a top. */
void lg_minimise_leave(lg_minimiser *m);
/* The same for many variables (minimise_curvature.c): evaluations along up to LG_LANCZOS_STEPS vectors look
 * for a direction of negative curvature, along which the search goes on; without one the run ends. */
enum { LG_LANCZOS_STEPS = 30 };
bool lg_minimise_curvature_fits(const lg_minimiser *m);
void lg_minimise_curvature_begin(lg_minimiser *m);
void lg_minimise_curvature_tell(lg_minimiser *m, const double *gradient);
/* Whether the Hessian was positive semidefinite and the Newton step d leaves f or x as they are. */
bool lg_minimise_newton_shows(const lg_minimiser *m);

/* The search along d from x: begins with trial step alpha. */
void lg_minimise_search_begin(lg_minimiser *m, double alpha);
typedef enum lg_search_verdict { LG_SEARCH_ON, LG_SEARCH_ACCEPT, LG_SEARCH_FAIL } lg_search_verdict;
/* Takes f and g.d of the trial; f = INFINITY where f or g is not finite.
 * LG_SEARCH_ON: numbers.alpha is the next trial. */
lg_search_verdict lg_minimise_search_tell(lg_minimiser *m, double value, double slope);

/* Rows of the rank. The matrix is cut into blocks of rows that do not depend on the ranks. Each block has as
 * many as a kernel takes at once, or the matrix has less. */
void lg_minimise_rows(uint32_t rank, uint32_t ranks, size_t n, size_t *first, size_t *end);
/* The ranks' parts of x (n), by rows, put together. */
void lg_minimise_gather(lg_minimiser *m, double *x);

/* Elements between two vectors of n. */
static inline size_t lg_minimise_stride(size_t n) {
    return (n + 7) / 8 * 8;
}

/* Doubles that Lanczos' vectors and coefficients take; 0 where the options exclude the check. */
static inline size_t lg_minimise_curvature_length(size_t n, const lg_minimise_options *options) {
    const bool looks = options->check && options->ranks == NULL;
    return looks ? LG_LANCZOS_STEPS * (lg_minimise_stride(n) + 2) : 0;
}

/* max |x_i|, NaN when one is; 0 for n = 0. */
double lg_largest(const double *x, size_t n);

#endif
