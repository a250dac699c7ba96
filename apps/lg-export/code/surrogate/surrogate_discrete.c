/* Components of the inner nodes, and as many of their tangents. Of work: the network's input, a direction
 * there, its output, and a derivative of that or the curve (nodes, then tangents, ends included). */
enum { INNER = 2 * (INTERVALS - 1), NODES = 2 * (INTERVALS + 1) };
enum { AT_DIRECTION = 8, AT_VALUE = 16, AT_CURVE = AT_VALUE + 2 * INNER, AT_NET = AT_CURVE + 2 * NODES };

/* From the network's side of the mirror, where places count from q0. */
static void hand_over(const real *x, real sign, real *y) {
    for (int i = 0; i < INNER; i++) y[i] = x[i % 2] + reflected(i, sign, y[i]);
    for (int i = INNER; i < 2 * INNER; i++) y[i] = reflected(i, sign, y[i]);
}

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    const real sign = mirror_sign(x);
    fill_row(x, sign, work);
    net_value(work, y, work + AT_NET);
    hand_over(x, sign, y);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    real *direction = work + AT_DIRECTION, *value = work + AT_VALUE, *slope = work + AT_CURVE;
    const real sign = mirror_sign(x);
    fill_row(x, sign, work);
    for (int j = 2; j < 8; j++) {
        for (int i = 0; i < 8; i++) direction[i] = REAL(0.0);
        direction[j] = row_slope(j, sign);
        net_jvp(work, direction, value, slope, work + AT_NET);
        for (int i = 0; i < 2 * INNER; i++) jacobian[8 * i + j] = reflected(i, sign, slope[i]);
    }
    for (int i = 0; i < 2 * INNER; i++)
        for (int j = 0; j < 2; j++)
            jacobian[8 * i + j] = (i < INNER && i % 2 == j ? REAL(1.0) : REAL(0.0)) - jacobian[8 * i + 4 + j];
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS * NAME_INPUTS, jacobian);
    if (y == NULL) return;
    for (int i = 0; i < 2 * INNER; i++) y[i] = value[i];
    hand_over(x, sign, y);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

/* The output with the given ends, on the network's side: q (N + 1, 2), then v (N + 1, 2). */
static void spread_nodes(const real *x, real sign, const real *value, real *curve) {
    for (int part = 0; part < 2; part++) {
        real *to = curve + part * NODES;
        for (int i = 0; i < INNER; i++) to[2 + i] = value[part * INNER + i];
        for (int c = 0; c < 2; c++) {
            const real from = part == 0 ? x[c] : REAL(0.0);
            to[c] = reflected(c, sign, x[2 * part + c] - from);
            to[NODES - 2 + c] = reflected(c, sign, x[4 + 2 * part + c] - from);
        }
    }
}

/* The cubic through two nodes with their tangents at 0 <= t <= 1 of the interval between them, and its
 * derivative by arc length. */
static void read_between(const real *q, const real *v, real t, real *point, real *tangent) {
    const real u = REAL(1.0) - t;
    for (int c = 0; c < 2; c++) {
        const real chord = q[2 + c] - q[c], a = INTERVAL * v[c] - chord, b = chord - INTERVAL * v[2 + c];
        point[c] = u * q[c] + t * q[2 + c] + t * u * (a * u + b * t);
        tangent[c] = (chord + (REAL(1.0) - REAL(2.0) * t) * (a * u + b * t) + t * u * (b - a)) / INTERVAL;
    }
}

/* At s, on the network's side; s beyond an end is that end. True: at the node of qN. */
static int read_curve(const real *curve, real s, real *point, real *tangent) {
    const real last = (real)INTERVALS;
    real place = s / LENGTH * last, node;
    if (!(place > REAL(0.0))) place = REAL(0.0);
    if (place > last) place = last;
    node = FLOOR(place + REAL(0.5));
    if (FABS(place - node) <= REAL(4.0) * REAL_EPSILON * last) {
        const real *here = curve + 2 * (int)node;
        for (int c = 0; c < 2; c++) {
            point[c] = here[c];
            tangent[c] = here[NODES + c];
        }
        return here == curve + NODES - 2;
    }
    node = FLOOR(place);
    curve += 2 * (int)node;
    read_between(curve, curve + NODES, place - node, point, tangent);
    return 0;
}

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    real *value = work + AT_VALUE, *curve = work + AT_CURVE, point[2], tangent[2];
    const real sign = mirror_sign(x);
    fill_row(x, sign, work);
    net_value(work, value, work + AT_NET);
    spread_nodes(x, sign, value, curve);
    for (int i = 0; i < points; i++) {
        const int end = read_curve(curve, s[i], point, tangent);
        for (int c = 0; c < 2; c++) {
            if (q != NULL) q[2 * i + c] = end ? x[4 + c] : x[c] + reflected(c, sign, point[c]);
            if (v != NULL) v[2 * i + c] = reflected(c, sign, tangent[c]);
        }
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
