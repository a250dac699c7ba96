/* out = [a, b] = (u x U, u x V + v x U), a = (u, v), b = (U, V); may be b */
static void se3_bracket(const real *a, const real *b, real *out) {
    real first[3], second[3], third[3];
    cross3(a, b, first);
    cross3(a, b + 3, second);
    cross3(a + 3, b, third);
    for (int i = 0; i < 3; i++) {
        out[i] = first[i];
        out[3 + i] = second[i] + third[i];
    }
}
