/* Certificates: what is true is proved, what is false is refused with the box.
 * ctest-labels: src/certify src/autodiff */
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

static lg_certify_result pol(double gain, double level, const double *low, const double *high) {
    lg_certify_spec spec = spec_for(loop_program(2, van_der_pol, NULL, &gain), pol_P, low, high);
    spec.level = level;
    return prove(&spec, 60);
}

static void assert_refused(const lg_certify_result *r, const char *reason) {
    assert_true(!r->verified && !r->converges && r->finished && r->volume == 0 && r->failed_low != NULL);
    if (strstr(r->reason, reason) == NULL) fail_msg("the reason is '%s', not '%s'", r->reason, reason);
    for (int i = 0; i < 2; i++) assert_true(r->failed_low[i] <= r->failed_high[i]);
}

TEST("a level below the largest is proved, one above it is refused with a box where V rises") {
    const lg_certify_result good = pol(3, 0.117, pol_low, pol_high), bad = pol(3, 0.119, pol_low, pol_high);
    assert_true(good.verified && good.converges && good.level == 0.117);
    assert_refused(&bad, "V does not fall");
    const double a = 0.5 * (bad.failed_low[0] + bad.failed_high[0]),
                 b = 0.5 * (bad.failed_low[1] + bad.failed_high[1]);
    assert_true(fabs(fabs(a) - 0.06) < 0.1 && fabs(fabs(b) - 0.54) < 0.1);
}

TEST("a wrong sign and a gain that is too small are refused") {
    const lg_certify_result wrong = pol(-3, 0.05, pol_low, pol_high),
                            weak = pol(0.6, 0.05, pol_low, pol_high);
    assert_refused(&wrong, "V does not fall");
    assert_refused(&weak, "V does not fall");
}

TEST("a set that reaches the box is refused") {
    const double low[2] = {-0.2, -1}, high[2] = {0.2, 1};
    const lg_certify_result r = pol(3, 0.1, low, high);
    assert_refused(&r, "is not inside of the box");
}
