#include "autodiff/ops/windows.h"

#include <stdio.h>

const char *lg_windows_text(const lg_k_windows *w, char text[LG_WINDOWS_TEXT]) {
    (void)snprintf(text, LG_WINDOWS_TEXT, "make_windows(%zu, %zu, %zu, %zu, %zu, %zu)", w->length,
                   w->channels, w->size, w->stride, w->padding, w->count);
    return text;
}
