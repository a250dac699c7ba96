/* |vector - p|^2 */
static real square_distance(const real *vector, const real *p) {
    real lane[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    for (int i = 0; i + 8 <= PROJECTIONS; i += 8)
        for (int j = 0; j < 8; j++) lane[j] += (vector[i + j] - p[i + j]) * (vector[i + j] - p[i + j]);
    for (int j = 0, i = PROJECTIONS / 8 * 8; j < PROJECTIONS % 8; j++, i++)
        lane[j] += (vector[i] - p[i]) * (vector[i] - p[i]);
    return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}
