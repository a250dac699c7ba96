/* The same with a direction. */
static void net_input_jvp(const real **x, const real **dx, real *work) {
    real *angle = work + NET_ANGLE, *e = work + NET_EMBEDDED, *de = work + NET_EMBEDDED_D;
    dense_pair(&net_layers[0], *x, *dx, angle, de);
    for (int j = 0; j < NET_EMBEDDING; j++) {
        angle[j] = TWO_PI * (angle[j] - FLOOR(angle[j] + REAL(0.5)));
        e[j] = SIN(angle[j]);
        de[j] *= TWO_PI * COS(angle[j]);
    }
    *x = e;
    *dx = de;
}
