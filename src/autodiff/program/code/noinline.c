/* If compilers know the widths of a layer, they unroll its loops completely and then spill kilobytes or no
 * longer vectorise them. Functions with loops are therefore neither inlined nor cloned for constant
 * widths. */
#if defined(__clang__)
#define NOINLINE __attribute__((noinline))
#elif defined(__GNUC__)
#define NOINLINE __attribute__((noinline, noclone))
#else
#define NOINLINE
#endif
