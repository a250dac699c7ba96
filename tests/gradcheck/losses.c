/* Cases of the gradient check: losses. */
#include "gradcheck/rows.h"

/* ---- losses ---- */

BUILD_BINARY(mse)
BUILD_UNARY(log_softmax)

BUILD(build_loss) {
    SETTINGS;
    return lg_loss_record(t, (lg_loss)s->i[0], x[0], x[1], s->i[1] ? x[2] : LG_NONE);
}
#define LOSS_ROWS(label, kind, a, b)                                                                         \
    ROW_COMPOSED("loss " label, build_loss, WITH(.i = {kind, 0}), INPUTS(a(S2(4, 3)), b(S2(4, 3)))),         \
        ROW_COMPOSED("loss " label " weighted", build_loss, WITH(.i = {kind, 1}),                            \
                     INPUTS(a(S2(4, 3)), b(S2(4, 3)), POSITIVE(S1(4))))
#define PROBABILITY(...) IN_RANGE(0.1, 0.9, __VA_ARGS__)

/* Points where smooth losses choose between two formulas: logits at 0 and far from it, with targets 0, 1/2
 * and 1. Huber's loss is checked at residuals on both sides of its kinks; test_tape.c has the kinks
 * themselves. */
static const double logits[12] = {0, 0, 0, -0.0, 1e-9, -1e-9, 30, -30, 30, -1e3, 1e3, 1e3};
static const double targets[12] = {0, 0.5, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0};
static const double near_kinks[12] = {0, 0.75, -0.75, 1.25, -1.25, 0, 0, 1e3, -1e3, 0.75, 1.25, 0};
#define LOGITS(...)  IN_VALUES(logits, __VA_ARGS__)
#define TARGETS(...) IN_VALUES(targets, __VA_ARGS__)
#define KINKS(...)   IN_VALUES(near_kinks, __VA_ARGS__)
#define ZEROS(...)   IN_VALUES(zeros, __VA_ARGS__)
static const double zeros[12] = {0};

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
    LOSS_ROWS("mse", LG_LOSS_MSE, ANY, ANY),
    LOSS_ROWS("mae", LG_LOSS_MAE, APART, BETWEEN),
    LOSS_ROWS("huber", LG_LOSS_HUBER, APART, BETWEEN),
    LOSS_ROWS("bce", LG_LOSS_BCE_LOGITS, APART, PROBABILITY),
    LOSS_ROWS("bce at 0 and far away", LG_LOSS_BCE_LOGITS, LOGITS, TARGETS),
    LOSS_ROWS("huber on both sides of its kinks", LG_LOSS_HUBER, KINKS, ZEROS),
    LOSS_ROWS("cross-entropy of equal logits", LG_LOSS_CROSS_ENTROPY, ZEROS, TARGETS),
    LOSS_ROWS("cross-entropy", LG_LOSS_CROSS_ENTROPY, APART, PROBABILITY),
    ROW_COMPOSED("mse", build_mse, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW_COMPOSED("log_softmax (4, 3)", build_log_softmax, INPUTS(APART(S2(4, 3)))),
};
FAMILY(losses)
