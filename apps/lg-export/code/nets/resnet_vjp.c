/* y (outputs; or NULL) and dx = sum over outputs of cotangent dy/dx. With G the cotangent of H, in its place:
 * G <- G + (sigma' o (G B^T)) A^T. */
static void net_vjp(const real *x, const real *cotangent, real *y, real *dx, real *work) {
    real *h = work + NET_H, *z = work + NET_Z, *t = work + NET_T, *slope = work + NET_SLOPES;
    dense_kept(&net_layers[NET_FIRST], net_input(x, work), h, slope);
    for (int l = NET_FIRST + 1; l < NET_LAST; l += 2) {
        slope += NET_HIDDEN;
        dense_kept(&net_layers[l], h, z, slope);
        dense_add(NET_HIDDEN, NET_HIDDEN, NAME_weights + net_layers[l + 1].weight, z, h);
    }
    if (y != NULL) dense(&net_layers[NET_LAST], h, y);
    dense_transposed(&net_layers[NET_LAST], cotangent, h);
    for (int l = NET_LAST - 2; l > NET_FIRST; l -= 2) {
        dense_transposed(&net_layers[l + 1], h, z);
        scale_by(NET_HIDDEN, slope, z);
        slope -= NET_HIDDEN;
        dense_transposed(&net_layers[l], z, t);
        for (int j = 0; j < NET_HIDDEN; j++) h[j] += t[j];
    }
    scale_by(NET_HIDDEN, slope, h);
    dense_transposed(&net_layers[NET_FIRST], h, net_input_cotangent(dx, work));
    net_input_vjp(dx, work);
}
