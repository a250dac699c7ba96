/* Stochastic gradient descent with momentum (Polyak's heavy ball, in the form of Sutskever et al. 2013):
 * m <- beta1 m + g, theta <- theta - lr rate m, with g the clipped gradient plus weight_decay theta. v is not
 * used. */
#include "nn/fit_internal.h"

#define STEP(name, type)                                                                                     \
    static void name(const lg_adam_options *o, double rate, double clip, const type *gradient, size_t n,     \
                     type *m, type *theta) {                                                                 \
        for (size_t i = 0; i < n; i++) {                                                                     \
            m[i] = (type)(o->beta1 * m[i] + clip * gradient[i] + o->weight_decay * theta[i]);                \
            theta[i] = (type)(theta[i] - o->lr * rate * m[i]);                                               \
        }                                                                                                    \
    }
STEP(step_f64, double)
STEP(step_f32, float)

static void step(const lg_fit_options *o, uint64_t number, double rate, double clip, const void *gradient,
                 size_t n, void *m, void *v, void *theta) {
    if (o->dtype == LG_F32)
        step_f32(&o->adam, rate, clip, gradient, n, m, theta);
    else
        step_f64(&o->adam, rate, clip, gradient, n, m, theta);
}

const lg_fit_batches_row lg_fit_sgd = {.name = "sgd", .step = step};
