/* What every test includes: cmocka, and comparisons in double that are false for NaN. cmocka's own
 * assert_float_equal compares floats and lets NaN pass: it is not used here. */
#ifndef LG_TEST_SUPPORT_H
#define LG_TEST_SUPPORT_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "liegrad/status.h"

/* |a - e| <= atol + rtol |e|, false when either is NaN; infinities are close only when equal. */
static inline bool lg_is_close(double a, double e, double rtol, double atol) {
    if (a == e) return true;
    return isfinite(e) && fabs(a - e) <= atol + rtol * fabs(e);
}

#define assert_close(a, e, rtol, atol)                                                                       \
    do {                                                                                                     \
        const double lg_a_ = (a), lg_e_ = (e);                                                               \
        if (!lg_is_close(lg_a_, lg_e_, (rtol), (atol)))                                                      \
            fail_msg("%s = %.17g, expected %s = %.17g (difference %.3g)", #a, lg_a_, #e, lg_e_,              \
                     lg_a_ - lg_e_);                                                                         \
    } while (0)

#define assert_ok(call)                                                                                      \
    do {                                                                                                     \
        lg_status lg_s_ = (call);                                                                            \
        if (lg_s_ != LG_OK) fail_msg("%s: %s", #call, lg_status_name(lg_s_));                                \
    } while (0)

#define assert_status(call, expected)                                                                        \
    do {                                                                                                     \
        lg_status lg_s_ = (call);                                                                            \
        if (lg_s_ != (expected))                                                                             \
            fail_msg("%s: %s, expected %s", #call, lg_status_name(lg_s_), lg_status_name(expected));         \
    } while (0)

#endif
