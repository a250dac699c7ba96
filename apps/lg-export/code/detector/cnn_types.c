/* A block of a convolutional network: convolution, activation, pooling over time. Series are (time,
 * channels), so that what a kernel covers lies contiguous: a convolution is a dense layer from (kernel,
 * channels) numbers to `layer.out`, applied at one place after the other. */
typedef struct cnn_block {
    int length, channels;          /* of its input, without the zeros around it */
    int stride, padding;           /* samples; padding at both ends */
    int convolved;                 /* samples that the convolution gives */
    int pooling;                   /* 0 none, 1 average, 2 maximum */
    int pool, pool_stride, pooled; /* samples of a window, from one to the next; windows */
    net_layer layer;
} cnn_block;

/* Where in `work` lie a block's input with its zeros, its convolution, on which the activation works in
 * place (without pooling that is where the next input's samples lie), and the activation's derivative. The
 * last row is that of the layers behind the blocks: their input, and the same of the plane. */
typedef struct cnn_place {
    int input, activated, slope;
} cnn_place;
