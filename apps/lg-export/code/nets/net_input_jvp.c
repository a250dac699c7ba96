/* The same with a direction. */
static void net_input_jvp(const real **x, const real **dx, real *work) {
    (void)x;
    (void)dx;
    (void)work;
}
