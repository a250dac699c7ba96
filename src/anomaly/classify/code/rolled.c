/* Before loops that clang would write out, or turn into vectors across short rows: both take kilobytes of
 * stack. */
#if defined(__clang__)
#define ROLLED     _Pragma("clang loop unroll(disable)")
#define ROW_BY_ROW _Pragma("clang loop vectorize(disable) interleave(disable) unroll(disable)")
#else
#define ROLLED
#define ROW_BY_ROW
#endif

/* The library compiles the code of the features with sizes that it reads from a structure. */
#define FOR_WINDOW
#define OF_WINDOW
#define INVERSE_SCALE(channel) NAME_inverse_scale[channel]
