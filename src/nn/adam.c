/* Adam, gradient clipping, learning rate schedules. */
#include <math.h>

#include "nn/fit_internal.h"

void lg_adam_options_init(lg_adam_options *options) {
    *options = (lg_adam_options){.lr = 1e-3, .beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8};
}

void lg_adam_step(const lg_adam_options *options, lg_dtype dtype, uint64_t step, double rate, double clip,
                  const void *gradient, size_t n, void *m, void *v, void *theta) {
    const double correction1 = 1.0 - pow(options->beta1, (double)step);
    const double correction2 = 1.0 - pow(options->beta2, (double)step);
    lg_kernels_for(dtype)->adam(n, options->lr * rate, options->beta1, options->beta2, options->eps,
                                correction1, correction2, options->weight_decay, options->decoupled, clip,
                                gradient, m, v, theta);
}

static void adam_step(const lg_fit_options *options, uint64_t step, double rate, double clip,
                      const void *gradient, size_t n, void *m, void *v, void *theta) {
    lg_adam_step(&options->adam, options->dtype, step, rate, clip, gradient, n, m, v, theta);
}

/* A step is at most lr rate C with C = (1 - beta1^2/beta2)^{-1/2} (1 - beta2)^{-1/2}, by the Cauchy-Schwarz
 * inequality for the moments m and v. */
static bool adam_bounded(const lg_fit_options *options, double rate) {
    const lg_adam_options *o = &options->adam;
    return o->beta1 * o->beta1 < 0.999 * o->beta2 && o->beta2 <= 1.0 - 1e-12 && o->eps >= 1e-20 &&
           o->lr * rate <= 1.0 && o->weight_decay <= 1.0;
}

const lg_fit_batches_row lg_fit_adam = {.name = "adam", .step = adam_step, .bounded = adam_bounded};

double lg_clip_factor(double norm, double limit) {
    return limit > 0.0 && norm > limit ? limit / norm : 1.0;
}

static const char *const schedule_names[LG_SCHEDULE_COUNT] = {
    [LG_SCHEDULE_CONSTANT] = "constant",
    [LG_SCHEDULE_STEP] = "step",
    [LG_SCHEDULE_COSINE] = "cosine",
};

const char *lg_schedule_name(lg_schedule_kind kind) {
    return (int)kind >= 0 && (int)kind < LG_SCHEDULE_COUNT ? schedule_names[kind] : "unknown";
}

double lg_schedule_rate(const lg_schedule *schedule, uint64_t epoch, uint64_t epochs) {
    const double pi = 3.14159265358979323846;
    switch (schedule->kind) {
    case LG_SCHEDULE_STEP:
        return pow(schedule->gamma, (double)(epoch / schedule->every));
    case LG_SCHEDULE_COSINE:
        if (epoch >= epochs) return schedule->floor;
        return schedule->floor +
               (1.0 - schedule->floor) * 0.5 * (1.0 + cos(pi * (double)epoch / (double)epochs));
    case LG_SCHEDULE_CONSTANT:
        break;
    }
    return 1.0;
}
