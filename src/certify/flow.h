/* Bounds of flows over boxes: of x' = f(x, u) during a period in which u = k(x(0)) is held.
 *
 * Coordinates are y with x = goal + T y, and z = T y. About a point m of a box, for y = m + k in the box, the
 * state after a time t is F + S k, with F at m and S slopes of chords from m to the points of the box. Both
 * are Taylor polynomials in time with a remainder: with the coefficients x_k of motions
 * (lg_interval_taylor), the slopes S_k of their chords, and Jacobians D,
 *     F = sum_{k<p} t^k x_k(m) + t^p x_p(Z_m),
 *     S = (1 + sum_{k<q} t^k S_k(X, m) + t^q Dx_q(Z) J) S_0,
 * where the tubes Z_m and Z hold the motions from m and from the box X during the step (Picard), and J holds
 * their Jacobians by the state and the input at its start. A period is a chain of such steps. An error d of
 * the input is the same for y and m, so it widens F and the boxes of u, not the chords of u. */
#ifndef LG_CERTIFY_FLOW_H
#define LG_CERTIFY_FLOW_H

#include "core/core.h"
#include "certify/interval.h"

typedef struct lg_flow lg_flow;

typedef struct lg_flow_spec {
    const lg_program *program;
    size_t rate, control; /* functions (x (n), u (m)) -> x' and x -> u */
    double period;
    const double *goal, *T; /* (n); (n, n) */
} lg_flow_spec;

enum { LG_FLOW_BOXES = 128, LG_FLOW_DOUBLINGS = 4, LG_FLOW_ORDER = 6 };

/* `spec` is read during this call only. The number of steps in a period follows from the fastest mode at the
 * goal. */
lg_status lg_flow_create(const lg_context *context, const lg_flow_spec *spec, lg_flow **out, lg_error *error);
void lg_flow_destroy(lg_flow *flow);
uint32_t lg_flow_steps(const lg_flow *flow);
/* Replaces the number of steps in a period; a power of two. */
void lg_flow_set_steps(lg_flow *flow, uint32_t steps);
/* The input that is held is k(x(0)) + d with |d| <= error (m); 0 at first. NULL: 0. */
void lg_flow_set_error(lg_flow *flow, const double *error);
/* Whether the rate is an odd function of z and u, and the input of y. */
bool lg_flow_is_odd(const lg_flow *flow);
/* Bytes for lg_flow_eval of up to LG_FLOW_BOXES boxes, aligned to 64 bytes. */
size_t lg_flow_work_size(const lg_flow *flow);

/* Is called for parts of each step, in order: for times t in [from, to] after the step's start, F + S k
 * changes by t (D + Q k). The last part of a step has from = to. */
typedef void lg_flow_part(void *user, size_t boxes, const lg_bounds *F, const lg_bounds *S,
                          const lg_bounds *D, const lg_bounds *Q, double from, double to);

typedef struct lg_flow_boxes {
    size_t count;             /* at most LG_FLOW_BOXES */
    const double *at;         /* (count, n): the points m */
    const double *low, *high; /* (count, n) */
    uint32_t doublings;       /* the period has 2^doublings times as many steps */
    lg_flow_part *part;       /* NULL: none */
    void *user;
    lg_bounds F, S, X;         /* results: z at the end from m; slopes by y from m (n, n); z from the box */
    lg_bounds tube;            /* the tube of the last step from the box; low NULL: not needed */
    bool *unbounded, *no_tube; /* (count): no bounds; because of the tubes, so more steps may help */
    uint8_t *flag; /* (count): the least of the rate's over the tubes and the input's over the box; below
                    * LG_INTERVAL_LIPSCHITZ there are no bounds */
} lg_flow_boxes;
/* Bounds of boxes that are `unbounded` are 0. */
void lg_flow_eval(const lg_flow *flow, const lg_flow_boxes *boxes, void *work);

#endif
