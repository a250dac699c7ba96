/* Windows of `size` rows of a series (length, channels), one every `stride` rows, the first one `padding`
 * rows before it; rows outside are zero. */
typedef struct conv_windows {
    int length;
    int channels;
    int size;
    int stride;
    int padding;
    int count;
} conv_windows;

static conv_windows make_windows(int length, int channels, int size, int stride, int padding, int count) {
    conv_windows w;
    w.length = length;
    w.channels = channels;
    w.size = size;
    w.stride = stride;
    w.padding = padding;
    w.count = count;
    return w;
}
