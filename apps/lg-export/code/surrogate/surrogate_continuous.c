/* Of work: the network's input (s/L, boundary conditions), a direction or gradient there, its output and a
 * derivative or cotangent of that. */
enum { AT_DIRECTION = 9, AT_VALUE = 18, AT_SLOPE = 20, AT_NET = 22 };

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    const real sign = mirror_sign(x + 1);
    fill_row(x + 1, sign, work + 1);
    work[0] = x[0] / LENGTH;
    net_value(work, y, work + AT_NET);
    for (int c = 0; c < 2; c++) y[c] = x[1 + c] + reflected(c, sign, y[c]);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    real *gradient = work + AT_DIRECTION, *value = work + AT_VALUE, *cotangent = work + AT_SLOPE;
    const real sign = mirror_sign(x + 1);
    fill_row(x + 1, sign, work + 1);
    work[0] = x[0] / LENGTH;
    for (int c = 0; c < 2; c++) {
        real *to = jacobian + 9 * c;
        cotangent[c] = reflected(c, sign, REAL(1.0));
        cotangent[1 - c] = REAL(0.0);
        net_vjp(work, cotangent, c == 0 ? value : NULL, gradient, work + AT_NET);
        to[0] = gradient[0] / LENGTH;
        for (int j = 2; j < 8; j++) to[1 + j] = gradient[1 + j] * row_slope(j, sign);
        for (int j = 0; j < 2; j++) to[1 + j] = (j == c ? REAL(1.0) : REAL(0.0)) - to[5 + j];
    }
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS * NAME_INPUTS, jacobian);
    if (y == NULL) return;
    for (int c = 0; c < 2; c++) y[c] = x[1 + c] + reflected(c, sign, value[c]);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    real *direction = work + AT_DIRECTION, *value = work + AT_VALUE, *slope = work + AT_SLOPE;
    const real sign = mirror_sign(x);
    fill_row(x, sign, work + 1);
    direction[0] = REAL(1.0) / LENGTH;
    for (int j = 1; j < 9; j++) direction[j] = REAL(0.0);
    for (int i = 0; i < points; i++) {
        work[0] = s[i] / LENGTH;
        if (v != NULL)
            net_jvp(work, direction, value, slope, work + AT_NET);
        else
            net_value(work, value, work + AT_NET);
        for (int c = 0; c < 2; c++) {
            if (q != NULL) q[2 * i + c] = x[c] + reflected(c, sign, value[c]);
            if (v != NULL) v[2 * i + c] = reflected(c, sign, slope[c]);
        }
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
