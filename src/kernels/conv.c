#include "kernels/conv.h"

#include <string.h>

/* Inner sums much longer than INNER_BLOCK are computed in blocks of that length. Each block's sum is added to
 * the result. */
#define INNER_BLOCK 256

bool lg_windows_count(lg_k_windows *w) {
    w->count = 0;
    if (w->size == 0 || w->stride == 0 || w->padding >= w->size) return false;
    const uint64_t length = w->length + 2 * (uint64_t)w->padding;
    if (length < w->size || length > SIZE_MAX) return false;
    w->count = (size_t)(length - w->size) / w->stride + 1;
    return true;
}

/* c [+]= A B. Element (i, l) of A is at a[i ra + l ca], and row l of B begins at b + l ldb. */
typedef struct product {
    const lg_kernels *kernels;
    size_t m, n, k, ra, ca, ldb;
    const void *a, *b;
    void *c;
} product;

static void run(const product *p, bool add) {
    const size_t size = p->kernels->size;
    const unsigned char *a = p->a, *b = p->b;
    size_t l = 0;
    do {
        const size_t rest = p->k - l, length = rest > INNER_BLOCK + INNER_BLOCK / 2 ? INNER_BLOCK : rest;
        p->kernels->gemm(p->m, p->n, length, a + l * p->ca * size, p->ra, p->ca, b + l * p->ldb * size,
                         p->ldb, p->c, p->n, add || l > 0);
        l += length;
    } while (l < p->k);
}

/* ---- the matrix of windows ---- */

static size_t padded_count(const lg_k_windows *w) {
    return w->padding == 0 ? 0 : (w->length + 2 * w->padding) * w->channels;
}

/* The windows as rows of matrices. There is one piece per sample, or a single piece for all samples if the
 * windows of all samples lie at equal distances in memory. */
typedef struct layout {
    /* Number of pieces, rows per piece, and elements between the beginnings of two rows. */
    size_t pieces, rows, pitch;
} layout;

static layout layout_of(const lg_conv *c) {
    const lg_k_windows *w = &c->windows;
    const size_t series = w->length * w->channels, step = w->stride * w->channels;
    if (w->padding == 0 && w->count == 1) return (layout){1, c->batch, series};
    if (w->padding == 0 && w->count * step == series) return (layout){1, c->batch * w->count, step};
    return (layout){c->batch, w->count, step};
}

/* Returns the first row of piece i. With padding, the sample is copied into scratch, between margins of
 * zeros. */
static const void *windows_of(const lg_kernels *k, const lg_k_windows *w, const void *x, size_t i,
                              void *scratch) {
    const size_t series = w->length * w->channels * k->size;
    const unsigned char *sample = (const unsigned char *)x + i * series;
    if (w->padding == 0) return sample;
    const size_t margin = w->padding * w->channels * k->size;
    unsigned char *copy = scratch;
    if (i == 0) {
        memset(copy, 0, margin);
        memset(copy + margin + series, 0, margin);
    }
    memcpy(copy + margin, sample, series);
    return copy;
}

/* ---- convolution ---- */

/* The bias is repeated TOGETHER times in scratch. Then as many rows pass through the activation as one long
 * row, so that vectors are rarely partial. */
enum { TOGETHER = 16 };

/* Number of activated elements per piece that wait in scratch to be averaged; 0 without a pool. */
static size_t activated_count(const lg_conv *conv) {
    return conv->pool.count == 0 ? 0 : layout_of(conv).rows * conv->outputs;
}

size_t lg_conv_scratch(const lg_conv *conv) {
    return padded_count(&conv->windows) + TOGETHER * conv->outputs + activated_count(conv);
}

/* Without slopes: replaces z in y by sigma(z + b). With slopes: z is in `slope`; y becomes sigma(z + b) and
 * slope becomes sigma'(z + b). */
static void activate(const lg_kernels *k, lg_k_act kind, size_t rows, size_t n, const void *biases,
                     void *slope, void *y) {
    const size_t together = rows / TOGETHER, rest = rows % TOGETHER, done = together * TOGETHER * n * k->size;
    if (slope == NULL) {
        k->bias_act(kind, together, TOGETHER * n, biases, y);
        if (rest > 0) k->bias_act(kind, 1, rest * n, biases, (unsigned char *)y + done);
        return;
    }
    k->act_slope(kind, together, TOGETHER * n, biases, slope, y);
    k->act_slope(kind, 1, rest * n, biases, (unsigned char *)slope + done, (unsigned char *)y + done);
}

/* Fills `biases` with TOGETHER copies of the bias and returns it. Without a bias, it is filled with zeros if
 * `wanted` (slopes need it), else the function returns NULL. */
static const void *repeat_bias(const lg_kernels *k, size_t n, const void *bias, bool wanted, void *biases) {
    if (bias == NULL && !wanted) return NULL;
    if (bias == NULL) k->fill(TOGETHER * n, 0.0, biases);
    for (size_t i = 0; bias != NULL && i < TOGETHER; i++)
        memcpy((unsigned char *)biases + i * n * k->size, bias, n * k->size);
    return biases;
}

void lg_conv_apply(const lg_kernels *k, const lg_conv *conv, const void *x, const void *w, const void *bias,
                   lg_k_act kind, void *slope, void *y, void *scratch) {
    const layout lie = layout_of(conv);
    const size_t n = conv->outputs, together = lie.pieces == 0 ? 0 : conv->batch / lie.pieces;
    const size_t piece = lie.rows * n * k->size;
    const size_t out = conv->pool.count == 0 ? piece : together * conv->pool.count * n * k->size;
    product p = {.kernels = k,
                 .m = lie.rows,
                 .n = n,
                 .k = conv->windows.size * conv->windows.channels,
                 .ra = lie.pitch,
                 .ca = 1,
                 .ldb = n,
                 .b = w};
    unsigned char *biases = (unsigned char *)scratch + padded_count(&conv->windows) * k->size;
    const void *added = repeat_bias(k, n, bias, slope != NULL, biases);
    for (size_t i = 0; i < lie.pieces; i++) {
        unsigned char *to = (unsigned char *)y + i * out;
        unsigned char *activated = conv->pool.count == 0 ? to : biases + TOGETHER * n * k->size;
        unsigned char *slopes = slope == NULL ? NULL : (unsigned char *)slope + i * piece;
        p.a = windows_of(k, &conv->windows, x, i, scratch);
        p.c = slopes != NULL ? slopes : activated;
        run(&p, false);
        activate(k, kind, lie.rows, n, added, slopes, activated);
        if (conv->pool.count > 0) k->window_mean(&conv->pool, together, activated, to);
    }
}

/* ---- derivatives ---- */

void lg_conv_slope(const lg_kernels *k, const lg_conv *conv, const void *g, const void *slope, void *out) {
    const lg_k_windows *w = &conv->pool;
    if (w->count == 0)
        k->binary[LG_K_MUL](conv->batch * conv->windows.count * conv->outputs, g, slope, out);
    else
        k->window_fold(w, conv->batch, 1.0 / (double)w->size, g, w->channels, 0, slope, out, false);
}

size_t lg_conv_input_scratch(const lg_conv *conv) {
    return conv->windows.count * conv->windows.size * conv->windows.channels;
}

void lg_conv_input(const lg_kernels *k, const lg_conv *conv, const void *g, const void *wt, void *x, bool add,
                   void *scratch) {
    const lg_k_windows *w = &conv->windows;
    const size_t width = w->size * w->channels, series = w->length * w->channels * k->size;
    product p = {.kernels = k,
                 .m = w->count,
                 .n = width,
                 .k = conv->outputs,
                 .ra = conv->outputs,
                 .ca = 1,
                 .ldb = width,
                 .b = wt,
                 .c = scratch};
    for (size_t i = 0; i < conv->batch; i++) {
        p.a = (const unsigned char *)g + i * w->count * conv->outputs * k->size;
        run(&p, false);
        k->window_fold(w, 1, 1.0, scratch, width, w->channels, NULL, (unsigned char *)x + i * series, add);
    }
}

/* Columns that a product with n columns really computes: n rounded up to whole vectors. */
static size_t vector_width(const lg_kernels *k, size_t n) {
    static const size_t bytes[LG_ISA_COUNT] = {
        [LG_ISA_BASELINE] = 16, [LG_ISA_AVX2] = 32, [LG_ISA_AVX512] = 64, [LG_ISA_NEON] = 16};
    const size_t lanes = bytes[k->isa] / k->size;
    return (n + lanes - 1) / lanes * lanes;
}

size_t lg_conv_weight_scratch(const lg_conv *conv) {
    const lg_k_windows *w = &conv->windows;
    return padded_count(w) + 2 * w->size * w->channels * conv->outputs;
}

/* Computes A^T G or its transpose G^T A, whichever leaves fewer vector lanes empty. */
void lg_conv_weight(const lg_kernels *k, const lg_conv *conv, const void *x, const void *g, void *w, bool add,
                    void *scratch) {
    const layout lie = layout_of(conv);
    const size_t width = conv->windows.size * conv->windows.channels, outputs = conv->outputs;
    const size_t count = width * outputs;
    const bool turned = outputs * vector_width(k, width) < width * vector_width(k, outputs);
    unsigned char *sum = (unsigned char *)scratch + padded_count(&conv->windows) * k->size;
    product p = {.kernels = k,
                 .m = turned ? outputs : width,
                 .n = turned ? width : outputs,
                 .k = lie.rows,
                 .ra = 1,
                 .ca = turned ? outputs : lie.pitch,
                 .ldb = turned ? lie.pitch : outputs,
                 .c = turned ? sum : w};
    for (size_t i = 0; i < lie.pieces; i++) {
        const void *rows = windows_of(k, &conv->windows, x, i, scratch);
        const void *given = (const unsigned char *)g + i * lie.rows * outputs * k->size;
        p.a = turned ? given : rows;
        p.b = turned ? rows : given;
        run(&p, i > 0 || (add && !turned));
    }
    if (lie.pieces == 0 && !add) k->fill(count, 0.0, w);
    if (lie.pieces == 0 || !turned) return;
    unsigned char *back = add ? sum + count * k->size : w;
    k->transpose(outputs, width, sum, back);
    if (add) k->axpy(count, 1.0, back, w);
}

/* LG_CONV_BIAS_SCRATCH rows are added as one long row, which consists of whole vectors; then their sums are
 * added up. */
void lg_conv_bias(const lg_kernels *k, const lg_conv *conv, const void *g, void *bias, bool add,
                  void *scratch) {
    const size_t rows = conv->batch * conv->windows.count, n = conv->outputs;
    const size_t together = rows / LG_CONV_BIAS_SCRATCH, rest = rows % LG_CONV_BIAS_SCRATCH;
    if (together > 0) {
        k->sum_rows(together, LG_CONV_BIAS_SCRATCH * n, g, scratch, false);
        k->sum_rows(LG_CONV_BIAS_SCRATCH, n, scratch, bias, add);
    }
    const unsigned char *tail = (const unsigned char *)g + together * LG_CONV_BIAS_SCRATCH * n * k->size;
    if (rest > 0 || together == 0) k->sum_rows(rest, n, tail, bias, add || together > 0);
}
