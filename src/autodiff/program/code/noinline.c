/* Where compilers know the widths of a layer, they unroll its loops whole, and spill kilobytes or no longer
 * turn them into vector code: functions with loops are not inlined, nor copied for constant widths. */
#if defined(__clang__)
#define NOINLINE __attribute__((noinline))
#elif defined(__GNUC__)
#define NOINLINE __attribute__((noinline, noclone))
#else
#define NOINLINE
#endif
