/* Derivative of output o by the numbers that enter the output layer, dx. */
static NOINLINE void cnn_dense_vjp(int o, real *dx, real *work) {
    (void)work;
    for (int i = 0; i < cnn_output.in; i++) dx[i] = NAME_weights[cnn_output.weight + i * NAME_OUTPUTS + o];
}
