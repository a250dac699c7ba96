/* gcc leaves the activation a function, called for each number, unless it is told to write it into the loops,
 * which then become vectors. */
#if defined(__GNUC__)
#define FLATTEN __attribute__((noinline, flatten))
#else
#define FLATTEN
#endif

static FLATTEN void cnn_activate(int slopes, int n, real *z, real *slope) {
    if (slopes)
        activate_slope(n, z, slope);
    else
        activate(n, z);
}
