/* State of a minimisation, as minimise_archive.c saves it, and the table of methods. */
#ifndef LG_MINIMISE_INTERNAL_H
#define LG_MINIMISE_INTERNAL_H

#include "core/core.h"
#include "kernels/kernels.h"
#include "liegrad/minimise.h"

/* What the next f and g that the caller tells are used for. */
typedef enum lg_minimise_stage {
    LG_STAGE_START,  /* first evaluation, at the start point */
    LG_STAGE_CHECK,  /* compares g with differences of f */
    LG_STAGE_SEARCH, /* line search along d */
    LG_STAGE_DONE,
    LG_STAGE_HESSIAN,  /* the whole Hessian, from differences of g */
    LG_STAGE_CURVATURE /* products of the Hessian with Lanczos vectors, from differences of g */
} lg_minimise_stage;
#define LG_MINIMISE_STAGE_COUNT 6

/* lg_minimise_counts and lg_minimise_numbers hold the state apart from the vectors. All members of one struct
 * have the same type, because the struct is saved as one array. */
typedef struct lg_minimise_counts {
    uint64_t stage, end, evaluations, iterations;
    /* failed line searches (Levenberg-Marquardt: refused steps) since the last accepted step */
    uint64_t failures;
    /* line searches that found no upper end of the step, since the last one that met the Wolfe conditions */
    uint64_t endless;
    uint64_t trials; /* evaluations of the current line search, check, Hessian or Lanczos run */
    /* line search: 1 if the step has an upper end; check: 1 if a level has shown a difference */
    uint64_t bounded;
    uint64_t pairs;     /* pairs (s, y) that have updated H since it was 1 */
    uint64_t reference; /* iteration at which reference_value was taken */
    uint64_t crawls;    /* how many times in a row f has hardly fallen since reference_value was taken */
} lg_minimise_counts;

typedef struct lg_minimise_numbers {
    double value, slope; /* f and g.d at x */
    double alpha;        /* step length of the trial */
    double low, low_value, low_slope;
    /* Line search: the ends of the bracket [low, high], each with f and g.d there. Levenberg-Marquardt:
     * high_value is f at the last refused trial. */
    double high, high_value, high_slope;
    double reference_value, start_value;
    double damping; /* Levenberg-Marquardt: mu; Newton step: the shift added to the Hessian */
    double growth;  /* Levenberg-Marquardt: the next refusal multiplies mu by this factor */
    double radius;  /* lg_least_squares: longest step, in the norm of D */
    double check_value[4], check_slope[4];
    double first; /* first step along -g, from the curvature that the check has seen; 0: not known */
} lg_minimise_numbers;

typedef struct lg_minimise_row {
    const char *name;
    bool dense;     /* true: the method stores a matrix of n^2 numbers */
    bool squares;   /* true: the method minimises sums of squares only */
    uint64_t slow;  /* LG_MINIMISE_SLOW is judged each time after this many iterations */
    uint64_t creep; /* a Newton step is tried if creep + 4 n iterations have not halved f */
    /* Where the Hessian of a Newton step begins in m->curvature, in doubles. NULL: 0. */
    size_t (*before_hessian)(const struct lg_minimiser *m);
    /* Doubles in m->curvature, as saved: with the rows of all ranks. */
    size_t (*length)(size_t n, const lg_minimise_options *options);
    /* true: m->curvature begins with n rows (lg_minimise_stride), which are divided over the ranks */
    bool by_rows;
    /* Updates H by the accepted step s (n) and the change of the gradient y (n), where y.s > 0, and sets m->d
     * = -H g with the new gradient m->g. May overwrite s and y. */
    void (*update)(struct lg_minimiser *m, double *s, double *y);
    void (*direction)(struct lg_minimiser *m); /* m->d = -H g; needs counts.pairs > 0 */
    /* Replaces the inverse Hessian by H = S (L L^T)^-1 S with S = diag(scale). On entry m->curvature holds
     * the lower triangular L as n rows of n numbers. NULL: the method cannot replace it. */
    void (*invert)(struct lg_minimiser *m, const double *scale);
} lg_minimise_row;

/* Data of lg_least_squares: r (rows) and the columns of J (n, rows), once at the trial point and once at x,
 * and memory for a QR factor of J. */
typedef struct lg_minimise_squares {
    size_t rows;
    const double *trial_r, *trial_columns;
    double *r, *columns, *stack; /* stack: lg_minimise_stack_length doubles */
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
    size_t first, end; /* this rank's rows of H: first, ..., end - 1 */
    size_t *bytes;     /* (ranks): bytes that each rank sends in an exchange */
    lg_status status;  /* of the exchanges between ranks */
    /* Scaling: the caller's x_i is unit[i] x_i, and the caller's f is value_unit f. gradient_tolerance is
     * compared with the gradient in the caller's units. unit NULL: x and f are not scaled. */
    const double *unit;
    double value_unit;
    const lg_minimise_squares *squares; /* NULL: r and J are not known, only the Gauss-Newton matrix */
    bool newton;                        /* Levenberg-Marquardt: the current search goes along a Newton step */
    /* lg_least_squares: the current trial is the last one, the run ends after it */
    bool last;
    double *memory; /* one allocation for x, g, d, point, s, y and curvature */
    /* (n) each: best point, gradient there, search direction, point to evaluate next */
    double *x, *g, *d, *point;
    /* (held): this rank's part of the method's matrix or vectors, which have `length` doubles */
    double *curvature;
    /* (length): curvature of all ranks; only on rank 0, from lg_minimiser_collect to lg_minimiser_scatter */
    double *whole;
    double *s, *y; /* (n) each, scratch */
    lg_minimise_counts counts;
    lg_minimise_numbers numbers;
};

/* Row `index` of the table of methods, NULL beyond the last row. The rows are in the order of
 * lg_minimise_method; there may be more rows than this enum has names. */
const lg_minimise_row *lg_minimise_row_at(size_t index);

/* Ends the run for this reason; m->point becomes the best point. */
void lg_minimise_finish(lg_minimiser *m, lg_minimise_end end);
void lg_minimise_set_point(lg_minimiser *m, double step, const double *direction); /* m->point = x + step d */
/* Why no step lowers f: LG_MINIMISE_BARRIER if f was not finite at the upper end of the last bracket, else
 * LG_MINIMISE_ROUNDING. */
lg_minimise_end lg_minimise_no_step(const lg_minimiser *m);
/* lg_minimise_rounding: the change of f by rounding of f and x; 0 without options.check, where searches go on
 * until they fail. lg_minimise_tiny: at every eighth step, whether f is so small that it only tends to 0. */
double lg_minimise_rounding(const lg_minimiser *m);
bool lg_minimise_tiny(const lg_minimiser *m);
/* Fills m->s with the random direction of checks, which depends on n alone. */
void lg_minimise_check_direction(lg_minimiser *m);
/* lg_minimise_flat: whether the gradient is zero to options.gradient_tolerance. lg_minimise_slow: called
 * after a step, whether LG_MINIMISE_SLOW applies. */
bool lg_minimise_flat(const lg_minimiser *m);
bool lg_minimise_slow(lg_minimiser *m);

/* Whether f has not halved in the last row->creep + 4 n iterations and the Hessian can be computed. Judged
 * once in so many iterations; false in between and with options.slow. Ends the run with LG_MINIMISE_STUCK if
 * f has fallen by less than 3e-4 of it each of ten times. */
bool lg_minimise_creeps(lg_minimiser *m);
/* Whether another Newton step pays after one that lowered f by `fall`: by more than a tenth of f, and the
 * Hessian was positive semidefinite. */
bool lg_minimise_newton_pays(const lg_minimiser *m, double fall);
/* Begins a line search from x along d, with the first step alpha; along -g if d is no descent direction. */
void lg_minimise_search(lg_minimiser *m, double alpha);

/* Whether the Hessian can be computed from differences of gradients, at most 2 n of them, when searches have
 * failed; a search along the Newton step then follows. True with options.check, without ranks, for few
 * variables, and if m->curvature has room for n^2 numbers. */
bool lg_minimise_newton_fits(const lg_minimiser *m);
/* Called before a run ends for the reason `end`, to verify that x is a minimum. Begins to evaluate the
 * Hessian, or its products with Lanczos vectors, and returns LG_MINIMISE_RUNNING; the run then ends later or
 * goes on downhill. If neither is possible, ends the run and returns `end`. */
lg_minimise_end lg_minimise_verify(lg_minimiser *m, lg_minimise_end end);
void lg_minimise_newton_tell(lg_minimiser *m, const double *gradient);
/* Begins a line search along d, even if g.d = 0, as at a saddle or a maximum, where g is zero. */
void lg_minimise_leave(lg_minimiser *m);
/* The same for many variables (minimise_curvature.c): gradients along up to LG_LANCZOS_STEPS vectors look for
 * a direction of negative curvature. If there is one, the search goes on along it, else the run ends. */
enum { LG_LANCZOS_STEPS = 30 };
bool lg_minimise_curvature_fits(const lg_minimiser *m);
void lg_minimise_curvature_begin(lg_minimiser *m);
void lg_minimise_curvature_tell(lg_minimiser *m, const double *gradient);
/* Whether the Newton step d shows a minimum: the Hessian was positive semidefinite, and d would change f or x
 * by no more than 1e-8 of it. */
bool lg_minimise_newton_shows(const lg_minimiser *m);

/* Resets the line search along d from x; the first step is alpha. */
void lg_minimise_search_begin(lg_minimiser *m, double alpha);
typedef enum lg_search_verdict { LG_SEARCH_ON, LG_SEARCH_ACCEPT, LG_SEARCH_FAIL } lg_search_verdict;
/* Takes f and g of the trial. finite: whether both are. LG_SEARCH_ON: m->point is the next trial. */
lg_search_verdict lg_minimise_search_tell(lg_minimiser *m, double value, const double *gradient, bool finite);

/* Pairs (s, y) in memory of lg_minimise_pairs_length doubles, at most `most` of them (minimise_lbfgs.c).
 * lg_minimise_pairs_add stores pair number counts.pairs, and sets m->d = -H g with all pairs up to it;
 * lg_minimise_pairs_direction does the latter with `count` pairs. */
size_t lg_minimise_pairs_length(size_t n, size_t most);
void lg_minimise_pairs_add(lg_minimiser *m, double *pairs, size_t most, const double *s, const double *y);
void lg_minimise_pairs_direction(lg_minimiser *m, double *pairs, size_t most, uint64_t count);
const double *lg_minimise_pairs_diagonal(const lg_minimiser *m, const double *pairs, size_t most);

/* Rows first, ..., end - 1 of H belong to the rank. The n rows are cut into blocks whose size does not depend
 * on the number of ranks, and a rank gets whole blocks. A block has as many rows as a kernel takes at once,
 * or all rows if n is smaller. */
void lg_minimise_rows(uint32_t rank, uint32_t ranks, size_t n, size_t *first, size_t *end);
/* Sets m->bytes to the size of the message of each rank, which has `numbers` doubles for each of its rows. */
void lg_minimise_count_bytes(lg_minimiser *m, size_t numbers);
/* Fills x (n) with the elements that the other ranks have computed: each rank has the elements of its rows.
 * Collective. */
void lg_minimise_gather(lg_minimiser *m, double *x);

/* Doubles from one vector of n numbers to the next: n, rounded up to a multiple of 8. */
static inline size_t lg_minimise_stride(size_t n) {
    return (n + 7) / 8 * 8;
}

/* Doubles for the Lanczos vectors and the coefficients of T; 0 without options.check or with ranks. */
static inline size_t lg_minimise_curvature_length(size_t n, const lg_minimise_options *options) {
    const bool looks = options->check && options->ranks == NULL;
    return looks ? LG_LANCZOS_STEPS * (lg_minimise_stride(n) + 2) : 0;
}

/* max |x_i|; 0 for n = 0, NaN if an element is NaN. */
double lg_largest(const double *x, size_t n);

#endif
