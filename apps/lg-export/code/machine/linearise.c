/* The coordinates (TANGENT) of a vector (STATE). */
static void tangent_coordinates(const real *state, const real *vector, real *c) {
    for (int f = 0; f < FACTORS; f++)
        for (int copy = 0; copy < factors[f][1]; copy++) {
            const int numbers = factors[f][0];
            copy_coordinates(numbers, state, vector, c);
            state += numbers, vector += numbers, c += tangent_of(numbers);
        }
}

void NAME_linearise(const NAME_real *state, const NAME_real *input, NAME_real *A, NAME_real *B,
                    NAME_real *work) {
    real *jx = work, *ju = jx + STATE * STATE, *vector = ju + STATE * INPUT, *c = vector + STATE;
    real direction[ROTATION];
    int at = 0, column = 0;
    (void)input;
    NAME_linear(state, GIVEN jx, INTO(ju) c + TANGENT);
    for (int f = 0; f < FACTORS && A != NULL; f++)
        for (int j = 0; j < factors[f][1] * tangent_of(factors[f][0]); j++) {
            const int numbers = factors[f][0], k = j % tangent_of(numbers);
            copy_direction(numbers, state + at, k, direction);
            for (int i = 0; i < STATE; i++) {
                vector[i] = REAL(0.0);
                for (int l = 0; l < numbers; l++) vector[i] += jx[i * STATE + at + l] * direction[l];
            }
            tangent_coordinates(state, vector, c);
            for (int i = 0; i < TANGENT; i++) A[i * TANGENT + column] = c[i];
            column++;
            if (k + 1 == tangent_of(numbers)) at += numbers;
        }
    for (int j = 0; j < INPUT && B != NULL; j++) {
        for (int i = 0; i < STATE; i++) vector[i] = ju[i * INPUT + j];
        tangent_coordinates(state, vector, c);
        for (int i = 0; i < TANGENT; i++) B[i * INPUT + j] = c[i];
    }
}
