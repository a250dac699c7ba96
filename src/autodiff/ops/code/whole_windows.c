/* Windows first .. last - 1 lie in the series with all of their rows. */
static void whole_windows(const conv_windows *w, int *first, int *last) {
    const int room = w->length + w->padding - w->size;
    *first = (w->padding + w->stride - 1) / w->stride;
    *last = room < 0 ? 0 : room / w->stride + 1;
    if (*last > w->count) *last = w->count;
    if (*last < *first) *first = *last;
}
