/* Components of the inner nodes, and as many of their tangents. Of work: the network's output, the curve
 * (nodes, then tangents, ends included), and the memory of the network. */
enum { INNER = 2 * (INTERVALS - 1), NODES = 2 * (INTERVALS + 1) };
enum { AT_CURVE = 2 * INNER, AT_NET = AT_CURVE + 2 * NODES };

/* The output with the given ends: q (N + 1, 2), then v (N + 1, 2). */
static void spread_nodes(const real *x, const real *value, real *curve) {
    for (int part = 0; part < 2; part++) {
        real *to = curve + part * NODES;
        for (int i = 0; i < INNER; i++) to[2 + i] = value[part * INNER + i];
        for (int c = 0; c < 2; c++) {
            to[c] = x[2 * part + c];
            to[NODES - 2 + c] = x[4 + 2 * part + c];
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

/* At s; one beyond an end is that end. */
static void read_curve(const real *curve, real s, real *point, real *tangent) {
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
        return;
    }
    node = FLOOR(place);
    curve += 2 * (int)node;
    read_between(curve, curve + NODES, place - node, point, tangent);
}

void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,
                NAME_real *work) {
    real *curve = work + AT_CURVE, point[2], tangent[2];
    NAME_eval(x, work, work + AT_NET);
    spread_nodes(x, work, curve);
    for (int i = 0; i < points; i++) {
        read_curve(curve, s[i], point, tangent);
        for (int c = 0; c < 2; c++) {
            if (q != NULL) q[2 * i + c] = point[c];
            if (v != NULL) v[2 * i + c] = tangent[c];
        }
    }
    mark_curve(x, s, points, q);
    mark_curve(x, s, points, v);
}
