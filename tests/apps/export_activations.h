/* tanh and sigmoid of the exported code in one precision: EXPORT_NAME(tanh)(n, z) and EXPORT_NAME(sigmoid)(n,
 * z) work in place. The including file defines EXPORT_REAL and EXPORT_NAME(x), and may include this header
 * again with other definitions. */
#define NAME_real  EXPORT_REAL
#define real       EXPORT_NAME(real)
#define exp_core   EXPORT_NAME(exp_core)
#define exp_power  EXPORT_NAME(exp_power)
#define tanh_of    EXPORT_NAME(tanh_of)
#define sigmoid_of EXPORT_NAME(sigmoid_of)

/* clang-format off */
#include "../../src/autodiff/program/code/prelude.c"
#if EXPORT_SINGLE
#include "../../src/autodiff/program/code/prelude_f32.c"
#include "../../src/autodiff/program/code/exp_f32.c"
#else
#include "../../src/autodiff/program/code/prelude_f64.c"
#include "../../src/autodiff/program/code/exp_f64.c"
#endif
#include "../../src/autodiff/program/code/exp_power.c"
#include "../../src/autodiff/program/code/tanh_of.c"
#include "../../src/autodiff/program/code/sigmoid_of.c"

static void EXPORT_NAME(tanh)(int n, real *z) {
    for (int i = 0; i < n; i++) z[i] = tanh_of(z[i]);
}
static void EXPORT_NAME(sigmoid)(int n, real *z) {
    for (int i = 0; i < n; i++) z[i] = sigmoid_of(z[i]);
}
/* clang-format on */

#undef NAME_real
#undef real
#undef exp_core
#undef exp_power
#undef tanh_of
#undef sigmoid_of
#undef RESTRICT
#undef REAL
#undef REAL_EPSILON
#undef EXP
#undef EXPM1
#undef LOG
#undef SIN
#undef COS
#undef TAN
#undef SQRT
#undef FABS
#undef FLOOR
#undef ATAN2
#undef POW
#undef REAL_LARGEST
#undef EXP_ROUND
#undef EXP_PER_LN2
#undef EXP_LN2_HIGH
#undef EXP_LN2_LOW
#undef EXP_BITS
#undef EXP_BIAS
#undef EXP_SHIFT
#undef EXP_LEAST
#undef EXP_LIFT
#undef EXP_LOWER
#undef EXPORT_REAL
#undef EXPORT_NAME
#undef EXPORT_SINGLE
