/* y (d0, d1, d2, d3), row-major, from x with the strides s0, s1, s2, s3. */
static NOINLINE void permute(int d0, int d1, int d2, int d3, int s0, int s1, int s2, int s3,
                             const real *RESTRICT x, real *RESTRICT y) {
    for (int a = 0; a < d0; a++)
        for (int b = 0; b < d1; b++)
            for (int c = 0; c < d2; c++, y += d3)
                for (int d = 0; d < d3; d++) y[d] = x[a * s0 + b * s1 + c * s2 + d * s3];
}
