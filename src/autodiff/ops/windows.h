/* Windows of a time series in generated C, for operations along time. */
#ifndef LG_OPS_WINDOWS_H
#define LG_OPS_WINDOWS_H

#include "autodiff/ops/op_c.h"
#include "kernels/kernels.h"

/* Writes a C expression that constructs these windows. */
enum { LG_WINDOWS_TEXT = 160 };
const char *lg_windows_text(const lg_k_windows *windows, char text[LG_WINDOWS_TEXT]);

#endif
