/* Of work: the network's output, the curve, and the memory of the network. */
enum { AT_CURVE = 4 * (INTERVALS - 1), AT_NET = AT_CURVE + 4 * (INTERVALS + 1) };

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    real *curve = work + AT_CURVE, point[2], tangent[2];
    NAME_eval(x, work, work + AT_NET);
    spread_nodes(INTERVALS, x, work, curve);
    for (int i = 0; i < points; i++) {
        read_curve(INTERVALS, LENGTH, curve, s[i], point, tangent);
        for (int c = 0; c < 2; c++) {
            if (q != NULL) q[2 * i + c] = point[c];
            if (v != NULL) v[2 * i + c] = tangent[c];
        }
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
