#define TWO_PI REAL(6.283185307179586)

/* What the network's layers read: sin(2 pi u), u = x A + b. Whole turns are taken off u, exactly. The angles
 * stay in work. */
static const real *net_input(const real *x, real *work) {
    real *angle = work + NET_ANGLE, *e = work + NET_EMBEDDED;
    dense(&net_layers[0], x, angle);
    for (int j = 0; j < NET_EMBEDDING; j++) {
        angle[j] = TWO_PI * (angle[j] - FLOOR(angle[j] + REAL(0.5)));
        e[j] = SIN(angle[j]);
    }
    return e;
}
