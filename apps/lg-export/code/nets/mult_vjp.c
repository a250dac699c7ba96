/* The cotangent of what the layers read, from those of U, V and the first H, which are overwritten. */
static void heads_vjp(real *const *cotangents, real *to, real *work) {
    real *t = work + NET_INNER;
    for (int i = 0; i < 3; i++) {
        scale_by(NET_HIDDEN, work + NET_SLOPES + i * NET_HIDDEN, cotangents[i]);
        dense_transposed(&net_layers[NET_FIRST + i], cotangents[i], i == 0 ? to : t);
        if (i == 0) continue;
        for (int j = 0; j < net_layers[NET_FIRST].in; j++) to[j] += t[j];
    }
}

/* y (outputs; or NULL) and dx = sum over outputs of cotangent dy/dx. With G the cotangent of H:
 * dZ = G o (V - U), dU += G o (1 - Z), dV += G o Z, G <- the cotangent of H through Z. */
static void net_vjp(const real *x, const real *cotangent, real *y, real *dx, real *work) {
    real *u = work + NET_U, *v = work + NET_V, *h = work + NET_H, *t = work + NET_T;
    real *du = work + NET_U_D, *dv = work + NET_V_D, *dz = work + NET_Z_D;
    real *slope = work + NET_SLOPES + 3 * NET_HIDDEN, *z = work + NET_GATES;
    real *const cotangents[3] = {du, dv, h};
    const real *a = net_input(x, work);
    dense_kept(&net_layers[NET_FIRST], a, u, slope - 3 * NET_HIDDEN);
    dense_kept(&net_layers[NET_FIRST + 1], a, v, slope - 2 * NET_HIDDEN);
    dense_kept(&net_layers[NET_FIRST + 2], a, h, slope - NET_HIDDEN);
    for (int l = NET_FIRST + 3; l < NET_LAST; l += NET_STEPS, z += NET_HIDDEN, slope += NET_HIDDEN) {
        gate_kept(&net_layers[l], h, t, z, slope);
        for (int j = 0; j < NET_HIDDEN; j++) h[j] = (REAL(1.0) - z[j]) * u[j] + z[j] * v[j];
    }
    if (y != NULL) dense(&net_layers[NET_LAST], h, y);
    dense_transposed(&net_layers[NET_LAST], cotangent, h);
    for (int j = 0; j < NET_HIDDEN; j++) du[j] = dv[j] = REAL(0.0);
    for (int l = NET_LAST - NET_STEPS; l > NET_FIRST + 2; l -= NET_STEPS) {
        z -= NET_HIDDEN;
        slope -= NET_HIDDEN;
        for (int j = 0; j < NET_HIDDEN; j++) {
            dz[j] = h[j] * (v[j] - u[j]);
            du[j] += h[j] * (REAL(1.0) - z[j]);
            dv[j] += h[j] * z[j];
        }
        gate_vjp(&net_layers[l], slope, dz, t, h);
    }
    heads_vjp(cotangents, net_input_cotangent(dx, work), work);
    net_input_vjp(dx, work);
}
