/* The fragments of lg-export behind activations, in one precision: EXPORT_REAL and EXPORT_NAME(x) are defined
 * by the file that includes this, which may do so again with others. Activations become
 * EXPORT_NAME(activate_tanh) and so on. */
#define NAME_real  EXPORT_REAL
#define real       EXPORT_NAME(real)
#define exp_core   EXPORT_NAME(exp_core)
#define exp_power  EXPORT_NAME(exp_power)
#define tanh_of    EXPORT_NAME(tanh_of)
#define sigmoid_of EXPORT_NAME(sigmoid_of)

/* clang-format off */
#include "../../src/autodiff/code/prelude.c"
#if EXPORT_SINGLE
#include "../../src/autodiff/code/prelude_f32.c"
#include "../../src/autodiff/code/exp_float.c"
#else
#include "../../src/autodiff/code/prelude_f64.c"
#include "../../src/autodiff/code/exp_double.c"
#endif
#include "../../src/autodiff/code/tanh.c"
#include "../../src/autodiff/code/sigmoid.c"

#define activate EXPORT_NAME(activate_tanh)
#define activate_slope EXPORT_NAME(slope_tanh)
#include "../../apps/lg-export/code/activations/activation_tanh.c"
#include "../../apps/lg-export/code/activations/activation_tanh_slope.c"
#undef activate
#undef activate_slope
#define activate EXPORT_NAME(activate_sigmoid)
#define activate_slope EXPORT_NAME(slope_sigmoid)
#include "../../apps/lg-export/code/activations/activation_sigmoid.c"
#include "../../apps/lg-export/code/activations/activation_sigmoid_slope.c"
#undef activate
#undef activate_slope
#define activate EXPORT_NAME(activate_swish)
#define activate_slope EXPORT_NAME(slope_swish)
#include "../../apps/lg-export/code/activations/activation_swish.c"
#include "../../apps/lg-export/code/activations/activation_swish_slope.c"
#undef activate
#undef activate_slope
#define activate EXPORT_NAME(activate_relu)
#define activate_slope EXPORT_NAME(slope_relu)
#include "../../apps/lg-export/code/activations/activation_relu.c"
#include "../../apps/lg-export/code/activations/activation_relu_slope.c"
#undef activate
#undef activate_slope
#define activate EXPORT_NAME(activate_leaky_relu)
#define activate_slope EXPORT_NAME(slope_leaky_relu)
#include "../../apps/lg-export/code/activations/activation_leaky_relu.c"
#include "../../apps/lg-export/code/activations/activation_leaky_relu_slope.c"
#undef activate
#undef activate_slope
#define activate EXPORT_NAME(activate_sine)
#define activate_slope EXPORT_NAME(slope_sine)
#include "../../apps/lg-export/code/activations/activation_sine.c"
#include "../../apps/lg-export/code/activations/activation_sine_slope.c"
#undef activate
#undef activate_slope
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
#undef EXP_LEAST
#undef EXP_LIFT
#undef EXP_LOWER
#undef EXPORT_REAL
#undef EXPORT_NAME
#undef EXPORT_SINGLE
