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
    LG_STAGE_DONE
} lg_minimise_stage;
#define LG_MINIMISE_STAGE_COUNT 4

/* The state beside the vectors. Members of one struct are of one type: each is saved as an array. */
typedef struct lg_minimise_counts {
    uint64_t stage, end, evaluations, iterations;
    uint64_t failures;  /* searches that failed since the last step */
    uint64_t endless;   /* searches since the last one that found an end to the fall of f */
    uint64_t trials;    /* evaluations of this search or check */
    uint64_t bounded;   /* this search has an upper end */
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
    double damping, growth; /* Levenberg-Marquardt: mu, and its factor after the next refusal */
    double check_value[4], check_slope[4];
} lg_minimise_numbers;

typedef struct lg_minimise_row {
    const char *name;
    uint64_t slow; /* so many iterations without a fall of f end the run */
    /* Doubles of its memory, as saved. */
    size_t (*length)(size_t n, const lg_minimise_options *options);
    bool by_rows; /* it begins with n rows at a stride, which ranks divide */
    /* Takes a step: s (n) and y (n), y.s > 0, and the new gradient m->g. Then m->d = -H g. s and y may be
     * used as scratch. */
    void (*update)(struct lg_minimiser *m, double *s, double *y);
    void (*direction)(struct lg_minimiser *m); /* m->d = -H g, where there are pairs */
} lg_minimise_row;

struct lg_minimiser {
    const lg_context *context;
    const lg_kernels *k;
    lg_minimise_options options;
    const lg_minimise_row *row;
    size_t n, length, held;
    size_t first, end;         /* rows of this rank */
    size_t *bytes;             /* (ranks): of an exchange */
    lg_status status;          /* of the exchanges */
    double *memory;            /* all vectors */
    double *x, *g, *d, *point; /* (n) */
    double *curvature;         /* (held): what this rank has of (length) */
    double *whole;             /* (length): on rank 0 between a collection and the next step */
    double *s, *y;             /* (n), scratch */
    lg_minimise_counts counts;
    lg_minimise_numbers numbers;
};

extern const lg_minimise_row lg_minimise_ssbroyden, lg_minimise_lbfgs, lg_minimise_lm;

/* Ends the run: the point is the best one. */
void lg_minimise_finish(lg_minimiser *m, lg_minimise_end end);
/* The end where no step lowers f: the nearest upper end of the step tells why. */
lg_minimise_end lg_minimise_no_step(const lg_minimiser *m);
/* The direction of checks goes to m->s, always the same. */
void lg_minimise_check_direction(lg_minimiser *m);
/* Whether the gradient is zero to its tolerance; after a step, whether f falls too slowly. */
bool lg_minimise_flat(const lg_minimiser *m);
bool lg_minimise_slow(lg_minimiser *m);

/* The search along d from x: begins with trial step alpha. */
void lg_minimise_search_begin(lg_minimiser *m, double alpha);
typedef enum lg_search_verdict { LG_SEARCH_ON, LG_SEARCH_ACCEPT, LG_SEARCH_FAIL } lg_search_verdict;
/* Takes f and g.d of the trial; LG_SEARCH_ON: numbers.alpha is the next trial. */
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

/* max |x_i|, NaN when one is; 0 for n = 0. */
double lg_largest(const double *x, size_t n);

#endif
