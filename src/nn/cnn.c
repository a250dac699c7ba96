/* Convolutional networks: description, parameters, initialisation. */
#include <inttypes.h>
#include <string.h>

#include "core/core.h"
#include "nn/cnn.h"

static const char *const pooling_names[LG_POOLING_COUNT] = {"none", "average", "max"};

const char *lg_pooling_name(lg_pooling kind) {
    return (unsigned)kind < LG_POOLING_COUNT ? pooling_names[kind] : "unknown";
}

/* ---- description ---- */

#define MAX_PARAMETERS ((uint64_t)1 << 31)

/* Checks block i, counted from 0. *length is the length of its input; it becomes that of its output. */
static lg_status check_block(const lg_cnn_block *b, uint32_t i, uint32_t *length, lg_error *error) {
    const uint32_t number = i + 1;
    const bool pooled = b->pooling != LG_POOL_NONE;
    if ((unsigned)b->pooling >= LG_POOLING_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "block %" PRIu32 ": unknown pooling", number);
    if (!lg_layers_size_fits(b->channels) || !lg_layers_size_fits(b->kernel) ||
        !lg_layers_size_fits(b->stride) ||
        (pooled && (!lg_layers_size_fits(b->pool_size) || !lg_layers_size_fits(b->pool_stride))))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "block %" PRIu32 ": channels, kernel, stride, pooling size and stride must be 1 to "
                       "2^20",
                       number);
    if (b->padding >= b->kernel)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "block %" PRIu32 ": a padding of %" PRIu32 " must be below its kernel of %" PRIu32,
                       number, b->padding, b->kernel);
    const uint32_t padded = *length + 2 * b->padding;
    if (padded < b->kernel)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "block %" PRIu32 ": a kernel of %" PRIu32 " is longer than the %" PRIu32
                       " samples that reach it",
                       number, b->kernel, padded);
    const uint32_t convolved = (padded - b->kernel) / b->stride + 1;
    if (pooled && convolved < b->pool_size)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "block %" PRIu32 ": the pooling size is %" PRIu32
                       ", but the convolution leaves only %" PRIu32 " samples",
                       number, b->pool_size, convolved);
    *length = pooled ? (convolved - b->pool_size) / b->pool_stride + 1 : convolved;
    return LG_OK;
}

static bool few_parameters(const lg_cnn *net) {
    uint64_t sum = 0;
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_cnn_block *b = &net->block[i];
        sum += (uint64_t)b->kernel * cnn_channels(net, i) * b->channels + b->channels;
        if (sum > MAX_PARAMETERS) return false;
    }
    const uint64_t flat = (uint64_t)net->lengths[net->blocks] * cnn_channels(net, net->blocks);
    const uint64_t last = net->plane > 0 ? net->plane : flat;
    if (net->plane > 0) sum += (flat + 1) * net->plane;
    return sum <= MAX_PARAMETERS && (last + 1) <= (MAX_PARAMETERS - sum) / net->outputs;
}

lg_status lg_cnn_init(lg_cnn *net, lg_error *error) {
    if (net == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the network is NULL");
    if (net->blocks > LG_CNN_MAX_BLOCKS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%" PRIu32 " blocks; at most %d are possible", net->blocks,
                       LG_CNN_MAX_BLOCKS);
    if (!lg_layers_size_fits(net->channels) || !lg_layers_size_fits(net->length) ||
        !lg_layers_size_fits(net->outputs) || (net->plane > 0 && !lg_layers_size_fits(net->plane)))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%" PRIu32 " channels, %" PRIu32 " samples, a plane of %" PRIu32 ", %" PRIu32
                       " outputs: sizes must be 1 to 2^20",
                       net->channels, net->length, net->plane, net->outputs);
    if ((unsigned)net->activation >= LG_ACTIVATION_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown activation");
    lg_cnn made = *net;
    uint32_t length = net->length;
    memset(made.lengths, 0, sizeof made.lengths);
    made.lengths[0] = length;
    for (uint32_t i = 0; i < net->blocks; i++) {
        LG_TRY(check_block(&net->block[i], i, &length, error));
        made.lengths[i + 1] = length;
    }
    if (!few_parameters(&made))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the network has more than 2^31 parameters");
    *net = made;
    return LG_OK;
}

/* ---- the default network ---- */

enum { DEFAULT_BLOCKS = 3, DEFAULT_KERNEL = 5, DEFAULT_POOL = 2, DEFAULT_PLANE = 2 };
enum { WIDEST_DEFAULT = 4096, LARGEST_DEFAULT = 1 << 28 };

/* Twice the number of input channels, but at most WIDEST_DEFAULT, and fewer where the block would have more
 * than LARGEST_DEFAULT weights. */
static uint32_t default_channels(uint32_t in) {
    uint32_t out = in < WIDEST_DEFAULT / 2 ? 2 * in : WIDEST_DEFAULT;
    const uint32_t limit = in > 0 ? LARGEST_DEFAULT / DEFAULT_KERNEL / in : out;
    if (out > limit) out = limit;
    return out > 0 ? out : 1;
}

void lg_cnn_init_default(lg_cnn *out, uint32_t channels, uint32_t length, uint32_t outputs,
                         lg_activation activation) {
    lg_cnn net = {.channels = channels,
                  .length = length,
                  .plane = DEFAULT_PLANE,
                  .outputs = outputs,
                  .activation = activation};
    uint32_t left = length;
    while (net.blocks < DEFAULT_BLOCKS && (net.blocks == 0 || left > 1)) {
        const uint32_t kernel = left < DEFAULT_KERNEL ? left : DEFAULT_KERNEL;
        const uint32_t convolved = left - kernel + 1;
        const bool pooled = convolved >= DEFAULT_POOL;
        net.block[net.blocks] = (lg_cnn_block){
            .channels = default_channels(cnn_channels(&net, net.blocks)),
            .kernel = kernel,
            .stride = 1,
            .pooling = pooled ? LG_POOL_AVERAGE : LG_POOL_NONE,
            .pool_size = DEFAULT_POOL,
            .pool_stride = DEFAULT_POOL,
        };
        left = pooled ? convolved / DEFAULT_POOL : convolved;
        net.blocks++;
    }
    (void)lg_cnn_init(&net, NULL);
    *out = net;
}

lg_layers lg_cnn_layers(const lg_cnn *net) {
    size_t in = (size_t)net->lengths[net->blocks] * cnn_channels(net, net->blocks);
    lg_layers all = {.count = 0};
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_cnn_block *b = &net->block[i];
        const size_t read = (size_t)b->kernel * cnn_channels(net, i);
        lg_layers_add(&all, "conv", i + 1, read, b->channels, b->kernel, true);
    }
    if (net->plane > 0) {
        lg_layers_add(&all, "plane", 0, in, net->plane, 0, true);
        in = net->plane;
    }
    lg_layers_add(&all, "output", 0, in, net->outputs, 0, true);
    return all;
}

size_t lg_cnn_parameters(const lg_cnn *net) {
    return lg_cnn_layers(net).parameters;
}

bool lg_cnn_slice(const lg_cnn *net, uint32_t index, lg_slice_info *out) {
    const lg_layers layers = lg_cnn_layers(net);
    return lg_layers_slice(&layers, index, out);
}

void lg_cnn_initialise(const lg_cnn *net, lg_rng *rng, double *theta) {
    const lg_layers layers = lg_cnn_layers(net);
    lg_layers_initialise(&layers, rng, theta);
}
