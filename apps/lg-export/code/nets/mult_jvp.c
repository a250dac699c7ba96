/* y (outputs; or NULL) and dy = (dy/dx) dx. */
static void net_jvp(const real *x, const real *dx, real *y, real *dy, real *work) {
    real *u = work + NET_U, *v = work + NET_V, *h = work + NET_H, *z = work + NET_Z;
    real *du = work + NET_U_D, *dv = work + NET_V_D, *dh = work + NET_H_D, *dz = work + NET_Z_D;
    const real *a = x, *da = dx;
    net_input_jvp(&a, &da, work);
    dense_pair_activated(&net_layers[NET_FIRST], a, da, u, du, work);
    dense_pair_activated(&net_layers[NET_FIRST + 1], a, da, v, dv, work);
    dense_pair_activated(&net_layers[NET_FIRST + 2], a, da, h, dh, work);
    for (int l = NET_FIRST + 3; l < NET_LAST; l += NET_STEPS) {
        gate_jvp(&net_layers[l], h, dh, z, dz, work);
        for (int j = 0; j < NET_HIDDEN; j++) {
            const real rest = REAL(1.0) - z[j];
            h[j] = rest * u[j] + z[j] * v[j];
            dh[j] = dz[j] * (v[j] - u[j]) + (rest * du[j] + z[j] * dv[j]);
        }
    }
    dense_pair(&net_layers[NET_LAST], h, dh, y != NULL ? y : work + NET_SLOPE, dy);
}
