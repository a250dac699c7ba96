/* Certificates: what is true is proved, what is false is refused with the box.
 * ctest-labels: src/control src/autodiff */
#include "certify_support.h"

/* ---- Van der Pol: x1' = x2, x2' = -x1 + (1 - x1^2) x2 + u, u = -sat(gain x2), |u| <= 1 ---- */

RECORDING(van_der_pol) {
    const double gain = *(const double *)user;
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var u = saturated(tape, lg_scale(tape, b, -gain), 1);
    const lg_var damped = lg_sub(tape, b, lg_mul(tape, lg_square(tape, a), b));
    const lg_var parts[2] = {b, lg_add(tape, lg_sub(tape, damped, a), u)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

static const double pol_P[4] = {1.5, 0.5, 0.5, 0.5}, pol_low[2] = {-4.8, -10.8}, pol_high[2] = {4.8, 10.8};

TEST("Van der Pol with a quadratic V: the largest level is found") {
    double gain = 3;
    lg_certify_spec spec = spec_for(loop_program(2, van_der_pol, NULL, &gain), pol_P, pol_low, pol_high);
    const lg_certify_result r = prove(&spec, 60);
    assert_true(r.verified && r.finished && r.converges);
}
