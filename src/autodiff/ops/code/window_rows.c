/* Of window t: which of its rows lie in the series, and which row of the series is the first. */
static void window_rows(const conv_windows *w, int t, int *first, int *rows, int *at) {
    const int start = t * w->stride - w->padding;
    const int begin = start < 0 ? -start : 0;
    const int end = start + w->size > w->length ? w->length - start : w->size;
    *first = begin;
    *rows = end > begin ? end - begin : 0;
    *at = start + begin;
}
