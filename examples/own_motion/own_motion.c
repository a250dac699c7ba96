/* own_motion: solves the equations of a free rigid body on SO(3) x R^3, and says how far energy and the
 * spatial momentum drift. The state is the attitude R (9 numbers, row-major) and the angular velocity W in
 * the body: R' = R hat(W), J W' = J W x W. */
#include <math.h>
#include <stdio.h>

#include <liegrad/integrators.h>

static const double J[3] = {1, 2, 3}; /* moments of inertia; turning about the second axis is unstable */

/* f = (spatial angular velocity R W, which is the element of the algebra of SO(3); W'). */
static lg_status field(void *user, double t, const double *y, const double *input, double *f) {
    const double *W = y + 9;
    (void)user, (void)t, (void)input;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        f[i] = y[3 * i] * W[0] + y[3 * i + 1] * W[1] + y[3 * i + 2] * W[2];
        f[3 + i] = (J[j] - J[k]) * W[j] * W[k] / J[i];
    }
    return LG_OK;
}

/* 0: energy; 1 to 3: spatial momentum R J W. */
static void invariants(const double *y, double *out) {
    const double *W = y + 9;
    out[0] = (J[0] * W[0] * W[0] + J[1] * W[1] * W[1] + J[2] * W[2] * W[2]) / 2;
    for (int i = 0; i < 3; i++)
        out[1 + i] = y[3 * i] * J[0] * W[0] + y[3 * i + 1] * J[1] * W[1] + y[3 * i + 2] * J[2] * W[2];
}

int main(void) {
    enum { N = 101 };
    const double start[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1e-3};
    double times[N], y[N][12], first[4], last[4], drift = 0;
    lg_error error;
    for (int i = 0; i < N; i++) times[i] = i;
    if (lg_ode_solve(NULL, "SO(3), R^3", field, NULL, 1e-10, times, N, start, y[0], &error) != LG_OK)
        return puts(error.message), 1;
    invariants(y[0], first);
    invariants(y[N - 1], last);
    for (int i = 0; i < 4; i++) drift = fmax(drift, fabs(last[i] - first[i]));
    printf("after %g s W = (%.6f, %.6f, %.6f); energy and momentum drift by %.1e\n", times[N - 1],
           y[N - 1][9], y[N - 1][10], y[N - 1][11], drift);
    return drift < 1e-6 ? 0 : 1;
}
