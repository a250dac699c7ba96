/* e_1, e_2: the axis of the smallest |q_i| made orthogonal to q, and q x e_1. */
static void frame_at(const real *q, real *e) {
    const int first = FABS(q[1]) < FABS(q[0]) ? 1 : 0, least = FABS(q[2]) < FABS(q[first]) ? 2 : first;
    real length = REAL(0.0);
    for (int c = 0; c < 3; c++) {
        e[c] = (c == least ? REAL(1.0) : REAL(0.0)) - q[least] * q[c];
        length += e[c] * e[c];
    }
    length = SQRT(length);
    for (int c = 0; c < 3; c++) e[c] /= length;
    for (int c = 0; c < 3; c++) e[3 + c] = q[(c + 1) % 3] * e[(c + 2) % 3] - q[(c + 2) % 3] * e[(c + 1) % 3];
}

static real inner(const real *a, const real *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Coordinates of a copy of a factor. */
static int tangent_of(int numbers) {
    return numbers == DIRECTION ? 4 : numbers == ROTATION ? 3 : 1;
}

/* The direction of coordinate k of a copy. */
static void copy_direction(int numbers, const real *y, int k, real *out) {
    for (int i = 0; i < numbers; i++) out[i] = REAL(0.0);
    if (numbers == DIRECTION) {
        real e[6];
        frame_at(y, e);
        for (int c = 0; c < 3; c++) {
            out[c] = k < 2 ? e[3 * k + c] : REAL(0.0);
            out[3 + c] = k < 2 ? -y[c] * inner(e + 3 * k, y + 3) : e[3 * (k - 2) + c];
        }
    } else if (numbers == ROTATION) {
        for (int row = 0; row < 9; row += 3) {
            out[row + (k + 1) % 3] = y[row + (k + 2) % 3];
            out[row + (k + 2) % 3] = -y[row + (k + 1) % 3];
        }
    } else {
        out[0] = REAL(1.0);
    }
}

static void copy_coordinates(int numbers, const real *y, const real *vector, real *c) {
    if (numbers == DIRECTION) {
        real e[6];
        frame_at(y, e);
        for (int j = 0; j < 4; j++) c[j] = inner(e + 3 * (j % 2), vector + 3 * (j / 2));
    } else if (numbers == ROTATION) {
        for (int j = 0; j < 3; j++) {
            const int k = (j + 1) % 3, l = (j + 2) % 3;
            real a = REAL(0.0), b = REAL(0.0);
            for (int row = 0; row < 9; row += 3)
                a += y[row + l] * vector[row + k], b += y[row + k] * vector[row + l];
            c[j] = REAL(0.5) * (a - b);
        }
    } else {
        c[0] = vector[0];
    }
}
