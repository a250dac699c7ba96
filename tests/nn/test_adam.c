/* Adam compared with its definition and with steps computed by hand; clipping; schedules. */
#include "nn_support.h"

#include "nn/fit_internal.h"

#define N 3
/* Algorithm 1 of Kingma & Ba, with L2 (decay * theta is added to the gradient) or with decoupled decay. */
static void reference(const lg_adam_options *o, int step, double rate, double clip, const double *gradient,
                      double *m, double *v, double *theta) {
    const double lr = o->lr * rate;
    for (int i = 0; i < N; i++) {
        double g = clip * gradient[i];
        if (!o->decoupled) g += o->weight_decay * theta[i];
        m[i] = o->beta1 * m[i] + (1.0 - o->beta1) * g;
        v[i] = o->beta2 * v[i] + (1.0 - o->beta2) * g * g;
        const double m_hat = m[i] / (1.0 - pow(o->beta1, step)), v_hat = v[i] / (1.0 - pow(o->beta2, step));
        const double decay = o->decoupled ? lr * o->weight_decay * theta[i] : 0.0;
        theta[i] -= decay + lr * m_hat / (sqrt(v_hat) + o->eps);
    }
}
static void compare_with_reference(bool decoupled, double decay) {
    lg_adam_options o;
    lg_adam_options_init(&o);
    o.lr = 0.05;
    o.weight_decay = decay;
    o.decoupled = decoupled;
    double theta[N] = {1.0, -2.0, 0.5}, m[N] = {0}, v[N] = {0};
    double theta_e[N] = {1.0, -2.0, 0.5}, m_e[N] = {0}, v_e[N] = {0};
    float theta_f[N] = {1.0f, -2.0f, 0.5f}, m_f[N] = {0}, v_f[N] = {0}, g_f[N];
    for (int step = 1; step <= 20; step++) {
        const double rate = 1.0 / step, clip = step % 3 == 0 ? 0.5 : 1.0;
        double g[N];
        for (int i = 0; i < N; i++) g_f[i] = (float)(g[i] = theta_e[i] * theta_e[i] - 0.3 * step + i);
        lg_adam_step(&o, LG_F64, (uint64_t)step, rate, clip, g, N, m, v, theta);
        lg_adam_step(&o, LG_F32, (uint64_t)step, rate, clip, g_f, N, m_f, v_f, theta_f);
        reference(&o, step, rate, clip, g, m_e, v_e, theta_e);
        for (int i = 0; i < N; i++) {
            assert_close(theta[i], theta_e[i], 1e-14, 1e-15);
            assert_close(m[i], m_e[i], 1e-14, 1e-15);
            assert_close(v[i], v_e[i], 1e-14, 1e-15);
            assert_close(theta_f[i], theta_e[i], 1e-4, 1e-5);
        }
    }
}
TEST("Adam follows its definition, with L2 and with decoupled decay, in both types") {
    compare_with_reference(false, 0.0);
    compare_with_reference(false, 0.1);
    compare_with_reference(true, 0.1);
}
TEST("with a constant gradient a step is lr g/(|g| + eps)") {
    lg_adam_options o;
    lg_adam_options_init(&o);
    assert_close(o.lr, 1e-3, 0.0, 0.0);
    assert_close(o.eps, 1e-8, 0.0, 0.0);
    o.eps = 0.5;
    const double g[N] = {2.0, -0.25, 0.0};
    double theta[N] = {1.0, 1.0, 1.0}, m[N] = {0}, v[N] = {0};
    for (int step = 1; step <= 7; step++) {
        lg_adam_step(&o, LG_F64, (uint64_t)step, 2.0, 1.0, g, N, m, v, theta);
        assert_close(theta[0], 1.0 - step * 2e-3 * 2.0 / 2.5, 1e-14, 0.0);
        assert_close(theta[1], 1.0 + step * 2e-3 * 0.25 / 0.75, 1e-14, 0.0);
        assert_close(theta[2], 1.0, 0.0, 0.0);
    }
}
TEST("with zero gradient, decoupled decay multiplies by a factor, and L2 moves with constant steps "
     "towards zero") {
    lg_adam_options o;
    lg_adam_options_init(&o);
    o.lr = 0.01;
    o.weight_decay = 0.5;
    o.eps = 1e-300;
    const double g[N] = {0};
    double l2[N] = {4.0, -8.0, 1.0}, m[N] = {0}, v[N] = {0};
    lg_adam_step(&o, LG_F64, 1, 1.0, 1.0, g, N, m, v, l2);
    assert_close(l2[0], 3.99, 1e-14, 0.0);
    assert_close(l2[1], -7.99, 1e-14, 0.0);
    assert_close(l2[2], 0.99, 1e-14, 0.0);
    o.decoupled = true;
    double free_[N] = {4.0, -8.0, 1.0}, m0[N] = {0}, v0[N] = {0};
    o.eps = 1e-8;
    lg_adam_step(&o, LG_F64, 1, 1.0, 1.0, g, N, m0, v0, free_);
    assert_close(free_[0], 4.0 * 0.995, 1e-15, 0.0);
    assert_close(free_[1], -8.0 * 0.995, 1e-15, 0.0);
    assert_close(m0[0], 0.0, 0.0, 0.0);
}
TEST("clipping is relative to the norm, which does not overflow in floats") {
    assert_close(lg_clip_factor(7.0, 3.5), 0.5, 0.0, 0.0);
    assert_close(lg_clip_factor(7.0, 7.0), 1.0, 0.0, 0.0);
    assert_close(lg_clip_factor(7.0, 8.0), 1.0, 0.0, 0.0);
    assert_close(lg_clip_factor(7.0, 0.0), 1.0, 0.0, 0.0);
    assert_close(lg_clip_factor(0.0, 1.0), 1.0, 0.0, 0.0);
    /* The squares of these numbers overflow a float. */
    const float large[2] = {3e30f, 4e30f};
    assert_close(sqrt(lg_kernels_for(LG_F32)->dot(2, large, large)), 5e30, 1e-6, 0.0);
}
TEST("schedules have their rates and names") {
    static const struct {
        lg_schedule schedule;
        uint64_t epoch, epochs;
        double rate;
    } cases[] = {
        {{.kind = LG_SCHEDULE_CONSTANT}, 17, 20, 1.0},
        {{.kind = LG_SCHEDULE_STEP, .every = 10, .gamma = 0.5}, 0, 100, 1.0},
        {{.kind = LG_SCHEDULE_STEP, .every = 10, .gamma = 0.5}, 9, 100, 1.0},
        {{.kind = LG_SCHEDULE_STEP, .every = 10, .gamma = 0.5}, 10, 100, 0.5},
        {{.kind = LG_SCHEDULE_STEP, .every = 10, .gamma = 0.5}, 39, 100, 0.125},
        {{.kind = LG_SCHEDULE_COSINE, .floor = 0.1}, 0, 12, 1.0},
        {{.kind = LG_SCHEDULE_COSINE, .floor = 0.1}, 4, 12, 0.1 + 0.9 * 0.75}, /* cos(pi/3) = 1/2 */
        {{.kind = LG_SCHEDULE_COSINE, .floor = 0.1}, 6, 12, 0.55},
        {{.kind = LG_SCHEDULE_COSINE, .floor = 0.1}, 12, 12, 0.1},
        {{.kind = LG_SCHEDULE_COSINE, .floor = 0.1}, 99, 12, 0.1},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_close(lg_schedule_rate(&cases[i].schedule, cases[i].epoch, cases[i].epochs), cases[i].rate,
                     1e-14, 0.0);
    ASSERT_NAMES(lg_schedule_kind, lg_schedule, LG_SCHEDULE_COUNT);
}

extern const lg_fit_batches_row lg_fit_adam;

TEST("the bound of a step holds for rates and decays below 1 and sane moments only") {
    static const struct {
        double beta1, beta2, eps, lr, decay;
        bool bounded;
    } rows[] = {{0.9, 0.999, 1e-8, 1e-3, 0, true}, {0.999, 0.9, 1e-8, 1e-3, 0, false},
                {0.9, 1.0, 1e-8, 1e-3, 0, false},  {0.9, 0.999, 1e-30, 1e-3, 0, false},
                {0.9, 0.999, 1e-8, 3, 0, false},   {0.9, 0.999, 1e-8, 1e-3, 2, false}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_fit_options o;
        lg_fit_options_init(&o);
        o.adam.beta1 = rows[i].beta1;
        o.adam.beta2 = rows[i].beta2;
        o.adam.eps = rows[i].eps;
        o.adam.lr = rows[i].lr;
        o.adam.weight_decay = rows[i].decay;
        assert_int_equal(lg_fit_adam.bounded(&o, 1.0), rows[i].bounded);
    }
}
