// The gradient of a step of the double pendulum on the minimal operator tape, for bench/c/pendulum.c.
#include "pendulum.hpp"
#include "tape.hpp"

// gradient = d(sum_j c_j z_j)/dy, where z is the state after a step from y.
extern "C" void tape_step_gradient(const double *y, const double *c, double *gradient) {
    tape::clear();
    tape::Real y0[4], z[4];
    for (int j = 0; j < 4; j++) z[j] = y0[j] = tape::Real(y[j]);
    step(z);
    const tape::Real sum = (c[0] * z[0] + c[1] * z[1]) + (c[2] * z[2] + c[3] * z[3]);
    tape::reverse(sum.i);
    for (int j = 0; j < 4; j++) gradient[j] = tape::adjoints[y0[j].i];
}
