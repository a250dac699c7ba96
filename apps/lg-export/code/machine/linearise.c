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

/* The direction (STATE) of tangent coordinate j. */
static void tangent_direction(const real *state, int j, real *out) {
    const int rotations = PLACES + 4 * DIRECTIONS, momenta = rotations + 3 * ROTATIONS;
    for (int i = 0; i < STATE; i++) out[i] = REAL(0.0);
    if (j < PLACES) {
        out[j] = REAL(1.0);
    } else if (j < rotations) {
        const int at = PLACES + (j - PLACES) / 4 * 6, k = (j - PLACES) % 4;
        const real *q = state + at;
        real e[6];
        frame_at(q, e);
        for (int c = 0; c < 3; c++) {
            out[at + c] = k < 2 ? e[3 * k + c] : REAL(0.0);
            out[at + 3 + c] = k < 2 ? -q[c] * inner(e + 3 * k, q + 3) : e[3 * (k - 2) + c];
        }
    } else if (j < momenta) {
        const int at = PLACES + 6 * DIRECTIONS + (j - rotations) / 3 * 9, k = (j - rotations) % 3;
        for (int row = at; row < at + 9; row += 3) {
            out[row + (k + 1) % 3] = state[row + (k + 2) % 3];
            out[row + (k + 2) % 3] = -state[row + (k + 1) % 3];
        }
    } else {
        out[PLACES + 6 * DIRECTIONS + 9 * ROTATIONS + j - momenta] = REAL(1.0);
    }
}

/* The coordinates (TANGENT) of a vector (STATE). */
static void tangent_coordinates(const real *state, const real *vector, real *c) {
    int at = PLACES;
    for (int i = 0; i < PLACES; i++) *c++ = vector[i];
    for (int i = 0; i < DIRECTIONS; i++, at += 6) {
        real e[6];
        frame_at(state + at, e);
        for (int j = 0; j < 4; j++) *c++ = inner(e + 3 * (j % 2), vector + at + 3 * (j / 2));
    }
    for (int i = 0; i < ROTATIONS; i++, at += 9)
        for (int j = 0; j < 3; j++) {
            const int k = (j + 1) % 3, l = (j + 2) % 3;
            real sum = REAL(0.0);
            for (int row = at; row < at + 9; row += 3)
                sum += state[row + l] * vector[row + k] - state[row + k] * vector[row + l];
            *c++ = REAL(0.5) * sum;
        }
    for (; at < STATE; at++) *c++ = vector[at];
}

void NAME_linearise(const NAME_real *state, const NAME_real *input, NAME_real *A, NAME_real *B,
                    NAME_real *work) {
    real *jx = work, *ju = jx + STATE * STATE, *direction = ju + STATE * INPUT;
    real *vector = direction + STATE, *c = vector + STATE;
    linear(state, input, jx, ju, c + TANGENT);
    for (int j = 0; j < TANGENT && A != NULL; j++) {
        tangent_direction(state, j, direction);
        for (int i = 0; i < STATE; i++) {
            real sum = REAL(0.0);
            for (int k = 0; k < STATE; k++) sum += jx[i * STATE + k] * direction[k];
            vector[i] = sum;
        }
        tangent_coordinates(state, vector, c);
        for (int i = 0; i < TANGENT; i++) A[i * TANGENT + j] = c[i];
    }
    for (int j = 0; j < INPUT && B != NULL; j++) {
        for (int i = 0; i < STATE; i++) vector[i] = ju[i * INPUT + j];
        tangent_coordinates(state, vector, c);
        for (int i = 0; i < TANGENT; i++) B[i * INPUT + j] = c[i];
    }
}
