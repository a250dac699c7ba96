/* What a C program outside the tree sees of the library: a network on a tape, its input gradient, and the
 * parameter gradient of the squared norm of that, beside the evaluation without a tape. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/nn.h>
#include <liegrad/ops.h>

enum { HIDDEN = 8, ROWS = 2 };

static int close_to(double a, double b) {
    return fabs(a - b) <= 1e-12 * (1.0 + fabs(b));
}

/* Returns 0 when value and input gradient agree with and without a tape and the last pass gives a finite
 * gradient. */
static int use(const lg_context *context) {
    const uint32_t hidden[1] = {HIDDEN};
    const double x[ROWS * 3] = {0.1, -0.4, 0.9, 0.3, 0.2, -0.7};
    lg_mlp net;
    lg_rng rng;
    if (lg_mlp_init(&net, 3, hidden, 1, 1, LG_TANH, false) != LG_OK) return 1;
    const size_t n = lg_mlp_parameters(&net);
    double params[3 * HIDDEN + HIDDEN + HIDDEN], grad[3 * HIDDEN + HIDDEN + HIDDEN] = {0.0};
    double y[ROWS], dx[ROWS * 3], taped[ROWS * 3], norm = 0.0;
    if (n != sizeof params / sizeof *params) return 2;
    lg_rng_seed(&rng, 1, 0);
    lg_mlp_initialise(&net, &rng, params);

    lg_tape *tape = NULL;
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return 3;
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)n), params);
    lg_var q = lg_input(tape, lg_shape2(ROWS, 3), x);
    lg_var V = lg_mlp_record(tape, &net, theta, 0, q), g = LG_NONE;
    lg_grad(tape, lg_sum(tape, V), &q, 1, &g);
    lg_var loss = lg_sum(tape, lg_square(tape, g));
    void *out = grad;
    int failed =
        lg_backward(tape, loss, &theta, 1, &out) != LG_OK || lg_read(tape, g, taped, ROWS * 3) != LG_OK;
    lg_tape_destroy(tape);

    void *work = malloc(lg_mlp_work_size(&net, ROWS, LG_F64) + 64);
    if (work == NULL) return 4;
    lg_mlp_input_gradient(&net, LG_F64, params, x, ROWS, NULL, y, dx,
                          (void *)(((size_t)work + 63) & ~(size_t)63));
    free(work);
    for (int i = 0; i < ROWS * 3; i++) failed |= !close_to(dx[i], taped[i]);
    for (size_t i = 0; i < n; i++) norm += grad[i] * grad[i];
    return failed || !(norm > 0.0 && norm < 1e6) ? 5 : 0;
}

int main(void) {
    lg_context *context = NULL;
    lg_status status = lg_context_create(NULL, &context);
    const int failed = use(context);
    printf("C: liegrad %s, %s, %d\n", lg_version(), lg_status_name(status), failed);
    lg_context_destroy(context);
    return status == LG_OK && failed == 0 && strcmp(lg_status_name(LG_SHAPE), "SHAPE") == 0 ? 0 : 1;
}
