/* One table of kernels. This file is compiled once for each type (LG_KERNEL_f64, LG_KERNEL_f32) and each
 * instruction set (LG_KERNEL_ISA = baseline, avx2, avx512 or neon, together with LG_KERNEL_ISA_<set>). Its
 * only external symbol is the table lg_kernels_<type>_<set>. */
#include "kernels/act_zeros.h"
#include "kernels/kernels.h"
#include "kernels/stumpff.h"

#include "kernels/common.inc"
#include "kernels/math.inc"

#include "kernels/elementwise.inc"

#include "kernels/act.inc"
#include "kernels/mix.inc"
#include "kernels/reduce.inc"
#include "kernels/transpose.inc"

#include "kernels/gemm.inc"
#include "kernels/products.inc"
#include "kernels/window.inc"

#include "kernels/taps.inc"

#include "kernels/geometry.inc"
#include "kernels/lie.inc"
#include "kernels/lie_maps.inc"
#include "kernels/spd.inc"
#include "kernels/steps.inc"
#include "kernels/scalars.inc"

#define PASTE_(a, b) a##b
#define PASTE(a, b)  PASTE_(a, b)
#if defined(LG_KERNEL_f64)
#define TABLE PASTE(lg_kernels_f64_, LG_KERNEL_ISA)
#else
#define TABLE PASTE(lg_kernels_f32_, LG_KERNEL_ISA)
#endif
#if defined(LG_KERNEL_ISA_avx512)
#define TABLE_ISA LG_ISA_AVX512
#elif defined(LG_KERNEL_ISA_avx2)
#define TABLE_ISA LG_ISA_AVX2
#elif defined(LG_KERNEL_ISA_neon)
#define TABLE_ISA LG_ISA_NEON
#else
#define TABLE_ISA LG_ISA_BASELINE
#endif

extern const lg_kernels TABLE;
const lg_kernels TABLE = {
    .dtype = sizeof(real) == sizeof(double) ? LG_F64 : LG_F32,
    .isa = TABLE_ISA,
    .size = sizeof(real),
    .fill = fill,
    .axpy = axpy,
    .outer = outer,
    .combine = combine,
    .convert_in = convert_in,
    .convert_out = convert_out,
    .all_finite = all_finite,
    .binary = {[LG_K_ADD] = binary_add,
               [LG_K_SUB] = binary_sub,
               [LG_K_MUL] = binary_mul,
               [LG_K_DIV] = binary_div,
               [LG_K_MAX] = binary_max,
               [LG_K_GE] = binary_ge,
               [LG_K_ATAN2] = binary_atan2},
    .binary_strided = {[LG_K_ADD] = strided_add,
                       [LG_K_SUB] = strided_sub,
                       [LG_K_MUL] = strided_mul,
                       [LG_K_DIV] = strided_div,
                       [LG_K_MAX] = strided_max,
                       [LG_K_GE] = strided_ge,
                       [LG_K_ATAN2] = strided_atan2},
    .unary = {[LG_K_SCALE] = unary_scale,
              [LG_K_SHIFT] = unary_shift,
              [LG_K_POW] = unary_pow,
              [LG_K_SQRT] = unary_sqrt,
              [LG_K_EXP] = unary_exp,
              [LG_K_LOG] = unary_log,
              [LG_K_SIN] = unary_sin,
              [LG_K_COS] = unary_cos,
              [LG_K_ABS] = unary_abs,
              [LG_K_SIGN] = unary_sign,
              [LG_K_RECIPROCAL] = unary_reciprocal},
    .act = act,
    .act_reverse = act_reverse,
    .bias_act = bias_act,
    .act_slope = act_slope,
    .select = select_one,
    .mix = mix,
    .mix_reverse = mix_reverse,
    .gemm = gemm,
    .small_products = small_products,
    .transpose = transpose,
    .matvec = matvec,
    .window_mean = window_mean,
    .window_pick = window_pick,
    .window_place = window_place,
    .window_fold = window_fold,
    .taps_sum = taps_sum,
    .taps_apply = taps_apply,
    .count_above = count_above,
    .sum = sum,
    .dot = dot,
    .sum_rows = sum_rows,
    .sum_cols = sum_cols,
    .cross = cross,
    .rowdot = rowdot,
    .stumpff = stumpff,
    .dexpinv_coef = dexpinv_coef,
    .scalars = scalars,
    .row_scalars = row_scalars,
    .load_rows = load_rows,
    .store_rows = store_rows,
    .stage_sum = stage_sum,
    .error_norm = error_norm,
    .se3_act = se3_act,
    .se3_dexpinv = se3_dexpinv,
    .se3_angle = se3_angle,
    .se3_pack = se3_pack,
    .se3_stage = se3_stage,
    .se3_estimate = se3_estimate,
    .lie = {[LG_K_SO3_EXP] = so3_exp_rows,
            [LG_K_SO3_DEXP] = so3_dexp_rows,
            [LG_K_SE3_ACT] = se3_act_second_rows,
            [LG_K_SO3_DEXPINV] = so3_dexpinv_rows,
            [LG_K_SE3_DEXPINV] = se3_dexpinv_second_rows},
    .lie_reverse = {[LG_K_SO3_EXP] = so3_exp_reverse,
                    [LG_K_SO3_DEXP] = so3_dexp_reverse,
                    [LG_K_SE3_ACT] = se3_act_second_reverse,
                    [LG_K_SO3_DEXPINV] = so3_dexpinv_reverse,
                    [LG_K_SE3_DEXPINV] = se3_dexpinv_second_reverse},
    .spd_factor = spd_factor,
    .spd_solve = spd_solve,
    .adam = adam,
};
