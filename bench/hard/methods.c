/* Riccati equations, held inputs, minimisers, least squares, elastica. */
#include <stdlib.h>

#include "hard.h"
#include "liegrad/control.h"

static lg_status riccati(const double *in, double *out, bool discrete) {
    const size_t n = (size_t)in[0], m = (size_t)in[1], bytes = lg_riccati_work_size(n, m);
    const double *A = in + 3, *B = A + n * n, *Q = B + n * m, *R = Q + n * n, *S = R + m * m;
    const lg_riccati equation = {sizeof equation, n, m, A, B, Q, R, in[2] != 0 ? S : NULL};
    void *work = aligned_alloc(64, (bytes + 63) / 64 * 64);
    const lg_status status =
        (discrete ? lg_dare : lg_care)(&equation, out, NULL, NULL, NULL, work, bytes, NULL);
    free(work);
    return status;
}

static lg_status care(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return riccati(in, out, false);
}

static lg_status dare(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return riccati(in, out, true);
}

/* n, m, h, A, B -> Ad, Bd */
static lg_status hold(const double *in, size_t n, double *out, size_t m) {
    (void)m;
    const size_t states = (size_t)in[0], inputs = (size_t)in[1];
    const size_t bytes = lg_zero_order_hold_work_size(states, inputs);
    void *work = aligned_alloc(64, (bytes + 63) / 64 * 64);
    (void)n;
    const lg_status status = lg_zero_order_hold(states, inputs, in + 3, in + 3 + states * states, in[2], out,
                                                out + states * states, work, bytes, NULL);
    free(work);
    return status;
}

const hard_function hard_methods[] = {
    {"Riccati, continuous", .measure = care},
    {"Riccati, discrete", .measure = dare},
    {"zero-order hold", .measure = hold},
    {.name = NULL},
};
