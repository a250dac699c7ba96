/* Cases of the gradient check: losses. */
#include "autodiff/cases/rows.h"

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

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
    LOSS_ROWS("mse", LG_LOSS_MSE, ANY, ANY),
    LOSS_ROWS("mae", LG_LOSS_MAE, APART, BETWEEN),
    LOSS_ROWS("huber", LG_LOSS_HUBER, APART, BETWEEN),
    LOSS_ROWS("bce", LG_LOSS_BCE_LOGITS, APART, PROBABILITY),
    LOSS_ROWS("cross-entropy", LG_LOSS_CROSS_ENTROPY, APART, PROBABILITY),
    ROW_COMPOSED("mse", build_mse, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW_COMPOSED("log_softmax (4, 3)", build_log_softmax, INPUTS(APART(S2(4, 3)))),
};
FAMILY(losses)
