/* Where it knows the widths of a layer, clang unrolls its loops whole and spills kilobytes: products are not
 * inlined. */
#if defined(__GNUC__)
#define NOINLINE __attribute__((noinline))
#else
#define NOINLINE
#endif
