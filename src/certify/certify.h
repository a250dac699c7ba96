/* Internals of certificates. Coordinates y: x = goal + T y. With a quadratic V, T^T P T is close to 1;
 * otherwise T is 1. */
#ifndef LG_CERTIFY_H
#define LG_CERTIFY_H

#include <float.h>
#include <math.h>

#include "certify/flow.h"
#include "core/core.h"
#include "liegrad/certify.h"
#include "liegrad/interval.h"

LG_AT(lg_certify_destroy, lg_certify)

enum { LG_CERTIFY_STATES = 16, LG_CERTIFY_TEXT = 1024, LG_DIGITS_MOST = 32 };

/* certify.c: x with 6 digits, or more until it is not above x (side -1), not below x (1), or x (0): what a
 * sentence says is not more than what is proved. The text lives as long as the block. */
#define LG_DIGITS(x, side) lg_digits((char[LG_DIGITS_MOST]){0}, x, side)
const char *lg_digits(char text[LG_DIGITS_MOST], double x, int side);

typedef enum lg_certify_phase {
    LG_CERTIFY_FACES,   /* V > c on the faces of the box */
    LG_CERTIFY_FALL,    /* V falls */
    LG_CERTIFY_BETWEEN, /* held loops: how large V becomes between the samples */
    LG_CERTIFY_VOLUME,  /* how much volume is certified */
    LG_CERTIFY_DONE
} lg_certify_phase;

/* What the bounds of a box say. */
typedef struct lg_certify_box {
    double v_low, v_high, rise_high;         /* over the box */
    double rise_inside;                      /* over its part in {V <= c}; not of certificates' leaves */
    double at_v_low, at_v_high, at_rise_low; /* at the point `at` of the box */
    double at[LG_CERTIFY_STATES];
    uint8_t flag;       /* of V, its gradient and the rate, on all of the box (lg_interval_flag) */
    double gain;        /* in the phase BETWEEN: V grows by at most this during the period */
    uint32_t doublings; /* held loops: the period had 2^doublings times as many steps */
    uint32_t split;     /* the side to halve */
} lg_certify_box;

struct lg_certify {
    const lg_context *context;
    lg_program *program; /* functions of y: local, point, bounds (certify_program.c) */
    lg_interval *full, *point, *local;
    lg_flow *flow;          /* a held loop; NULL: none */
    lg_interval *part;      /* its growth of V in a part of a period */
    double period, between; /* between: a bound of V between the samples */
    double rounding[32];    /* held loops: bounds of the rounding of inputs (m) */
    double eps_rounded;     /* 0: not known */
    bool rounds;            /* some are above 0, and all are finite */
    double input_error;     /* the largest; inf: there is no bound */
    size_t n;
    bool step, quadratic, automatic, raises, errors, converges, failed;
    bool even; /* V and V' are even functions of y: half of the domain is examined */
    double T[LG_CERTIFY_STATES * LG_CERTIFY_STATES], P[LG_CERTIFY_STATES * LG_CERTIFY_STATES];
    double goal[LG_CERTIFY_STATES], low[LG_CERTIFY_STATES], high[LG_CERTIFY_STATES], error[LG_CERTIFY_STATES];
    double from[LG_CERTIFY_STATES], to[LG_CERTIFY_STATES]; /* the domain, in y */
    double near[LG_CERTIFY_STATES];                        /* N = {|y_i| <= near_i} */
    double raised;                                         /* the eps of the next attempt; 0: none */
    bool again; /* all boxes are to be examined once more, with this level */
    double level, eps, asked_eps, resolution, determinant; /* determinant: a lower bound of |det T| */
    double volume, seconds;
    lg_certify_phase phase;
    size_t boxes, volume_boxes;
    double *stack; /* (stacked, 2, n) */
    size_t stacked, capacity;
    lg_thread_pool *pool;
    void *work;    /* one piece per task */
    size_t piece;  /* bytes */
    double *batch; /* (LG_CERTIFY_BATCH, 2, n) */
    lg_certify_box *found;
    size_t batched;
    double width[LG_CERTIFY_STATES]; /* what a result points to */
    double failed_low[LG_CERTIFY_STATES], failed_high[LG_CERTIFY_STATES];
    char claim[LG_CERTIFY_TEXT], reason[LG_CERTIFY_TEXT];
    /* A certificate, whose tree of boxes is examined, and written if `made` is not NULL. */
    const lg_certificate *file;
    lg_certificate *made;
    size_t depth_boxes, depth_at; /* the boxes of this depth; where they begin in the text of the tree */
};

enum {
    LG_CERTIFY_BATCH = 1024,
    LG_CERTIFY_TASK = 128,
    LG_CERTIFY_TASKS = LG_CERTIFY_BATCH / LG_CERTIFY_TASK
};

/* certify_program.c: finds a function of states and sets *n to their number, at most `most`; if *n was not 0,
 * they must be as many. Its first output has as many numbers, or one number (value). Of the rate of a held
 * loop, which has inputs too, only the number of states is checked: lg_flow_create checks the rest. */
lg_status lg_certify_function(const lg_program *program, const char *name, uint32_t most, bool value,
                              bool held, size_t *function, size_t *n, lg_error *error);
/* certify_program.c: records the functions, and makes the evaluators; they replace earlier ones. */
void lg_certify_forget(lg_certify *c);
/* Bounds the rounding of the inputs of a held loop. */
lg_status lg_certify_round(lg_certify *c, const lg_certify_spec *spec, lg_error *error);
lg_status lg_certify_record(lg_certify *c, const lg_certify_spec *spec, lg_error *error);
/* certify_local.c: coordinates of a quadratic V; eps, N and the argument on N, for the level c->level. */
lg_status lg_certify_whiten(lg_certify *c, lg_error *error);
lg_status lg_certify_turn(lg_certify *c, lg_error *error);
lg_status lg_certify_near(lg_certify *c);
/* certify_bounds.c: bounds of the boxes of the batch. */
lg_status lg_certify_memory(lg_certify *c);
void lg_certify_bounds(lg_certify *c);
/* certify_held.c: bounds of `local` over a box about 0; and F, S, X of the boxes of a desk, with periods of
 * 2^doublings times as many steps. */
lg_status lg_certify_held_local(const lg_certify *c, const double *from, const double *to, double *low,
                                double *high, bool *slopes);
/* Memory of one task: boxes y, their middles `at` and half sides r (count, n); at the middles V and V'
 * (`value`), the gradient G and the rate F; of held loops the next state X and its slopes S; the outputs of
 * `full` with their flags. gain, base, t: of the phase BETWEEN. */
typedef struct lg_certify_desk {
    const lg_certify *c;
    lg_bounds y, at, value, G, F, X, S, t, out;
    double *r, *gain, *base;
    bool *unbounded, *no_tube;
    uint8_t *flag, *flags; /* flag: of the rate and the input of a held loop */
    void *work, *flow;     /* of evaluators; of the flow */
} lg_certify_desk;
void lg_certify_held(lg_certify_desk *d, size_t count, uint32_t doublings);
/* Rounded up by more than the errors of sums of at most 300 terms. */
static inline double lg_certify_up(double x) {
    return x == x ? x + fabs(x) * 1e-13 + DBL_MIN : (double)INFINITY;
}
/* The largest |x| of an interval */
static inline double lg_certify_size(double low, double high) {
    return fmax(-low, high);
}
/* certify_form.c: the largest k.g + k^T M k for |k_i| <= r_i, from bounds of g (n) and of M + M^T (n, n);
 * part (NULL: none): how much each k_i adds, about. */
double lg_certify_form(size_t n, const double *low, const double *high, const double *r, double *part);
/* certify_boxes.c: works on the stack. */
lg_status lg_certify_begin(lg_certify *c, lg_certify_phase phase);
lg_status lg_certify_work(lg_certify *c);
/* The proof has failed on this box (low, high). */
void lg_certify_fail(lg_certify *c, const double *box, const char *reason);
/* Whether a box (low, high) lies in N. */
bool lg_certify_is_near(const lg_certify *c, const double *low, const double *high);
/* certify.c: as lg_certify_create, for a certificate. */
lg_status lg_certify_create_for(const lg_context *context, const lg_certify_spec *spec,
                                const lg_certificate *file, lg_certificate *made, lg_certify **out,
                                lg_error *error);
/* certify_tree.c: takes the coordinates of the file; the root box; what becomes of a box, which is always
 * done with; the boxes of the next depth; the end of the proof. */
lg_status lg_certify_coordinates(lg_certify *c, lg_error *error);
lg_status lg_certify_root(lg_certify *c);
bool lg_certify_leaf(lg_certify *c, const double *box, const lg_certify_box *f);
lg_status lg_certify_deeper(lg_certify *c);
void lg_certify_close(lg_certify *c);
/* certify_local.c: fails if T^T P T is not close to 1. */
lg_status lg_certify_check_coordinates(const lg_certify *c, lg_error *error);
/* States of a box of y. */
void lg_certify_states(const lg_certify *c, const double *low, const double *high, double *x_low,
                       double *x_high);
/* The largest |x_i - goal_i| on {V <= 1} (quadratic V). */
double lg_certify_width(const lg_certify *c, size_t i);
/* The largest level whose set lies within the state box (quadratic V). */
double lg_certify_reach(const lg_certify *c);

#endif
