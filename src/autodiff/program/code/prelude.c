#if defined(__FAST_MATH__)
#error "this code needs arithmetic as it is written: compile without -ffast-math"
#endif

#include <float.h>
#include <math.h>
#include <stddef.h>

#ifdef __cplusplus
#define RESTRICT __restrict
#else
#define RESTRICT restrict
#endif

typedef NAME_real real;
