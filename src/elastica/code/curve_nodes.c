/* The outputs `value` of a discrete network between the ends given by x: nodes (N + 1, 2), then tangents. */
static void spread_nodes(int intervals, const real *x, const real *value, real *curve) {
    const int inner = 2 * (intervals - 1);
    for (int part = 0; part < 2; part++, curve += inner + 4) {
        for (int i = 0; i < inner; i++) curve[2 + i] = value[part * inner + i];
        for (int c = 0; c < 2; c++) {
            curve[c] = x[2 * part + c];
            curve[2 + inner + c] = x[4 + 2 * part + c];
        }
    }
}

/* The cubic through two nodes with their tangents at 0 <= t <= 1 of the interval h between them, and its
 * derivative by arc length. */
static void read_between(const real *q, const real *v, real h, real t, real *point, real *tangent) {
    const real u = REAL(1.0) - t;
    for (int c = 0; c < 2; c++) {
        const real chord = q[2 + c] - q[c], a = h * v[c] - chord, b = chord - h * v[2 + c];
        point[c] = u * q[c] + t * q[2 + c] + t * u * (a * u + b * t);
        tangent[c] = (chord + (REAL(1.0) - REAL(2.0) * t) * (a * u + b * t) + t * u * (b - a)) / h;
    }
}

/* A curve as spread_nodes has made it, at s; beyond an end that end, and exactly the node at a node. */
static void read_curve(int intervals, real length, const real *curve, real s, real *point, real *tangent) {
    const real last = (real)intervals, h = length / last;
    real place = s / length * last;
    if (!(place > REAL(0.0))) place = REAL(0.0);
    if (place > last) place = last;
    const int node = (int)(place + REAL(0.5)), before = (int)place;
    const real *q = curve + 2 * before, *v = q + 2 * (intervals + 1);
    if (FABS(place - (real)node) > REAL(4.0) * REAL_EPSILON * last) {
        read_between(q, v, h, place - (real)before, point, tangent);
        return;
    }
    for (int c = 0; c < 2; c++) {
        point[c] = curve[2 * node + c];
        tangent[c] = curve[2 * (intervals + 1 + node) + c];
    }
}
