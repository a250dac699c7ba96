/* Random convolution features, after Dempster, Schmidt, Webb: MiniRocket, KDD 2021. All sums are of floats
 * in a fixed order, in both types, so the features are the same on all machines. attr.pointer = the table
 * (payload), attr.i = {its length, a bound of its numbers, number of convolutions}. */
#include "autodiff/ops/rocket.h"

#include <math.h>
#include <string.h>

#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/tape_internal.h"

enum {
    WEIGHTED = 3, /* taps of weight 2 */
    VECTOR = 16,  /* a convolution is filled up to a multiple of this */
    CHUNK = 256,  /* thresholds that are counted at a time */
    ROW = 5       /* numbers of a row of the table */
};

const char *lg_rocket_check(const lg_rocket_table *t, uint32_t channels, uint32_t length, uint64_t features) {
    uint64_t listed = 0, compared = 0;
    for (size_t i = 0; i < t->count; i++) {
        const lg_rocket_row c = t->row[i];
        if (c.kernel >= LG_ROCKET_KERNELS || c.padded > 1 || c.features == 0)
            return "has a kernel, a padding or a number of features that is out of range";
        if (c.dilation == 0 || (uint64_t)c.dilation * (LG_ROCKET_TAPS - 1) >= length)
            return "has a dilation that does not fit the window";
        if (c.channels == 0 || c.channels > channels) return "has no channels, or too many";
        listed += c.channels, compared += c.features;
    }
    if (listed != t->listed || compared != features) return "does not fit the channels or the thresholds";
    for (size_t i = 0; i < t->listed; i++)
        if (t->channel[i] / 2 >= channels) return "names a channel that does not exist";
    return NULL;
}

/* ---- convolutions ---- */

/* The taps of weight 2 of a kernel below LG_ROCKET_CHOICES. These kernels are the choices of three taps in
 * lexicographic order. */
static void weighted_taps(uint32_t kernel, uint32_t tap[WEIGHTED]) {
    for (tap[0] = 0; tap[0] < LG_ROCKET_TAPS; tap[0]++)
        for (tap[1] = tap[0] + 1; tap[1] < LG_ROCKET_TAPS; tap[1]++)
            for (tap[2] = tap[1] + 1; tap[2] < LG_ROCKET_TAPS; tap[2]++)
                if (kernel-- == 0) return;
}

/* With this margin, four times the largest dilation, a tap never lies outside of the memory. */
size_t lg_rocket_lay_out(const lg_rocket_table *t, size_t channels, size_t length, float *memory,
                         lg_rocket_work *out) {
    uint32_t most = 0;
    for (size_t i = 0; i < t->count; i++) {
        const uint32_t dilation = t->row[i].dilation;
        if (dilation > most) most = dilation;
    }
    *out = (lg_rocket_work){.channels = channels, .length = length, .margin = most * (LG_ROCKET_TAPS / 2)};
    out->row = length + 2 * out->margin;
    const size_t sums = channels * out->row, samples = sums + channels * length;
    if (memory != NULL) out->z = memory, out->sum = memory + sums, out->y = memory + samples;
    return samples + length + VECTOR;
}

/* The squares of floats are exact in double, so that fused operations cannot change their sum. */
bool lg_rocket_scale(const double *x, const double *mean, const double *inverse, lg_rocket_work *w) {
    double sum = 0;
    for (size_t i = 0; i < w->channels; i++, x += w->length) {
        float *row = w->z + i * w->row, *z = row + w->margin;
        memset(row, 0, w->row * sizeof *row);
        for (size_t t = 0; t < w->length; t++) z[t] = ((float)x[t] - (float)mean[i]) * (float)inverse[i];
        for (size_t t = 0; t < w->length; t++) sum += (double)z[t] * (double)z[t];
    }
    w->rms = (float)sqrt(sum / ((double)w->channels * (double)w->length));
    return lg_kernels_for(LG_F32)->all_finite(w->channels * w->row, w->z);
}

float *lg_rocket_convolve(const lg_rocket_work *w, const lg_rocket_row *c, const uint32_t *channel,
                          bool sum_taps, size_t *count, float *unit) {
    const lg_kernels *k = lg_kernels_for(LG_F32);
    const size_t reach = (size_t)c->dilation * (LG_ROCKET_TAPS / 2), first = c->padded ? 0 : reach;
    const bool weighted = c->kernel < LG_ROCKET_CHOICES;
    uint32_t tap[WEIGHTED] = {0};
    for (size_t i = 0; i < w->channels && sum_taps; i++)
        k->taps_sum(w->length, w->z + i * w->row + w->margin - reach, c->dilation, w->sum + i * w->length);
    if (weighted)
        weighted_taps(c->kernel, tap);
    else
        memset(w->y, 0, w->length * sizeof *w->y);
    for (uint32_t i = 0; i < c->channels; i++) {
        const size_t number = channel[i] / 2;
        const double sign = channel[i] % 2 == 0 ? 1 : -1;
        const float *from = w->z + number * w->row + w->margin - reach, *sum = w->sum + number * w->length;
        const void *at[WEIGHTED];
        for (int j = 0; j < WEIGHTED; j++) at[j] = from + (size_t)tap[j] * c->dilation;
        if (weighted)
            k->taps_apply(w->length, at, sum, sign, w->y, i > 0);
        else
            k->axpy(w->length, sign, sum, w->y);
    }
    *count = w->length - 2 * first;
    *unit = weighted ? w->rms : 1;
    return w->y + first;
}

/* out[j] = the part of the n samples y that are above bias[j] units. y is filled up to a whole vector. */
static void compare(uint32_t features, const double *bias, float *y, size_t n, float unit, double *out) {
    float level[CHUNK];
    uint32_t count[CHUNK];
    size_t whole = n;
    for (; whole % VECTOR != 0; whole++) y[whole] = -INFINITY;
    for (uint32_t j = 0; j < features; j += CHUNK) {
        const uint32_t some = features - j < CHUNK ? features - j : CHUNK;
        for (uint32_t i = 0; i < some; i++) level[i] = (float)bias[j + i] * unit;
        lg_kernels_for(LG_F32)->count_above(whole, y, some, level, count);
        for (uint32_t i = 0; i < some; i++) out[j + i] = count[i] / (double)n;
    }
}

/* ---- the operation ---- */

static lg_rocket_table table_of(const lg_attr *attr) {
    const uint32_t *payload = attr->pointer, rows = attr->i[2];
    return (lg_rocket_table){(const lg_rocket_row *)(const void *)payload, payload + ROW * (size_t)rows, rows,
                             attr->i[0] - ROW * (size_t)rows};
}

static lg_status rocket_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    const lg_shape *x = in[0], *bias = in[3];
    if (x->rank != 3 || bias->rank != 1 || in[1]->rank != 1 || in[1]->dims[0] != x->dims[1] ||
        !lg_same_shape(in[1], in[2]))
        return LG_SHAPE;
    if (attr->pointer == NULL || attr->i[2] == 0 || attr->i[0] / ROW < attr->i[2]) return LG_INVALID_ARGUMENT;
    *out = lg_shape2(x->dims[0], bias->dims[0]);
    const lg_rocket_table table = table_of(attr);
    return lg_rocket_check(&table, x->dims[1], x->dims[2], bias->dims[0]) == NULL ? LG_OK
                                                                                  : LG_INVALID_ARGUMENT;
}

static size_t rocket_numbers(const lg_evaluation *e) {
    lg_rocket_work w;
    const lg_rocket_table table = table_of(e->attr);
    return lg_rocket_lay_out(&table, e->in[0]->dims[1], e->in[0]->dims[2], NULL, &w);
}

static size_t rocket_scratch(const lg_evaluation *e) {
    return (lg_batch_doubles(e) + rocket_numbers(e)) * sizeof(double);
}

static void features_of(const lg_rocket_table *t, const double *bias, const lg_rocket_work *w, double *out) {
    const uint32_t *channel = t->channel;
    for (size_t i = 0, before = 0; i < t->count; i++) {
        const lg_rocket_row row = t->row[i];
        size_t n;
        float unit;
        float *y = lg_rocket_convolve(w, &row, channel, row.dilation != before, &n, &unit);
        compare(row.features, bias, y, n, unit, out);
        before = row.dilation;
        channel += row.channels, bias += row.features, out += row.features;
    }
}

static void rocket_row(const lg_evaluation *e, const double *const *x, double *y, double *memory) {
    const lg_rocket_table table = table_of(e->attr);
    lg_rocket_work w;
    (void)lg_rocket_lay_out(&table, e->in[0]->dims[1], e->in[0]->dims[2], (float *)(void *)memory, &w);
    if (lg_rocket_scale(x[0], x[1], x[2], &w))
        features_of(&table, x[3], &w, y);
    else
        lg_kernels_for(LG_F64)->fill(e->shape->dims[1], NAN, y);
}

LG_BATCH_FORWARD(rocket)

static void rocket_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *d = e->in[0]->dims;
    lg_c_indices(c, e->attr->pointer, e->attr->i[0]);
    lg_batch_c(c, e, rocket_numbers(e), "rocket(%u, %u, %u, $i", d[1], d[2], e->attr->i[2]);
}

extern const lg_op lg_op_rocket;
const lg_op lg_op_rocket = {LG_OP("rocket", ~0u, 4, 4, rocket_shape, rocket_forward, lg_no_vjp, lg_zero_jvp),
                            .payload = LG_PAYLOAD_INDICES, .scratch = rocket_scratch, .rows = lg_rows_first,
                            .write_c = rocket_c};

lg_var lg_rocket_record(lg_tape *tape, lg_var x, lg_var mean, lg_var inverse, lg_var bias,
                        const lg_rocket_table *table) {
    const size_t rows = ROW * table->count, count = rows + table->listed;
    uint32_t *kept = lg_payload_allocate(tape, count * sizeof *kept);
    if (kept == NULL) return LG_NONE;
    memcpy(kept, table->row, rows * sizeof *kept);
    memcpy(kept + rows, table->channel, table->listed * sizeof *kept);
    const lg_attr attr = {.i = {(uint32_t)count, INT32_MAX, (uint32_t)table->count, 0}, .pointer = kept};
    return lg_record(tape, &lg_op_rocket, (lg_var[]){x, mean, inverse, bias}, 4, &attr);
}
