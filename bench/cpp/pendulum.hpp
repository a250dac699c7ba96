// The planar double pendulum of lg-bench scalar, for any type of number: 100 steps of RK4 with length 0.01.
// The result is the sum of the elements of the last state.
#pragma once
#include <cmath>

constexpr double start_state[4] = {1.0, 0.5, 0.2, -0.3};

template <class T> inline void field(const T *y, T *f) {
    using std::cos;
    using std::sin;
    constexpr double g = 9.81;
    const T s1 = sin(y[0]), s2 = sin(y[1]), c1 = cos(y[0]), c2 = cos(y[1]);
    const T s = s1 * c2 - c1 * s2, c = c1 * c2 + s1 * s2;
    const T d = 1.0 / (2.0 - c * c);
    const T r1 = -(y[3] * y[3] * s) - 2.0 * g * s1, r2 = y[2] * y[2] * s - g * s2;
    f[0] = y[2];
    f[1] = y[3];
    f[2] = d * (r1 - c * r2);
    f[3] = d * (2.0 * r2 - c * r1);
}

template <class T> inline void step(T *y) {
    constexpr double h = 0.01;
    T k1[4], k2[4], k3[4], k4[4], z[4];
    field(y, k1);
    for (int j = 0; j < 4; j++) z[j] = y[j] + h / 2 * k1[j];
    field(z, k2);
    for (int j = 0; j < 4; j++) z[j] = y[j] + h / 2 * k2[j];
    field(z, k3);
    for (int j = 0; j < 4; j++) z[j] = y[j] + h * k3[j];
    field(z, k4);
    for (int j = 0; j < 4; j++) y[j] = y[j] + h / 6 * (k1[j] + 2.0 * (k2[j] + k3[j]) + k4[j]);
}

template <class T> inline T trajectory(const T *y0) {
    T y[4] = {y0[0], y0[1], y0[2], y0[3]};
    for (int n = 0; n < 100; n++) step(y);
    return y[0] + y[1] + y[2] + y[3];
}
