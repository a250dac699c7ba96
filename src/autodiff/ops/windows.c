#include "autodiff/ops/windows.h"

#include <stdio.h>

const lg_c_fragment lg_c_windows = {
    .comment =
        "Windows of `size` rows of a series (length, channels), one every `stride` rows, the first one "
        "`padding` rows\nbefore it; rows outside are zero.",
    .text = LG_C(
        typedef struct conv_windows {
            int length;
            int channels;
            int size;
            int stride;
            int padding;
            int count;
        } conv_windows;

        static conv_windows make_windows(int length, int channels, int size, int stride, int padding,
                                         int count) {
            conv_windows w;
            w.length = length;
            w.channels = channels;
            w.size = size;
            w.stride = stride;
            w.padding = padding;
            w.count = count;
            return w;
        })};

const char *lg_windows_text(const lg_k_windows *w, char text[LG_WINDOWS_TEXT]) {
    (void)snprintf(text, LG_WINDOWS_TEXT, "make_windows(%zu, %zu, %zu, %zu, %zu, %zu)", w->length,
                   w->channels, w->size, w->stride, w->padding, w->count);
    return text;
}
