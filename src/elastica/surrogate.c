/* Surrogates of the elastica: description, mirror, input of the network, split of the data, trained range. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/core.h"
#include "elastica/surrogate_internal.h"

static const char *const kind_names[LG_SURROGATE_KIND_COUNT] = {"discrete", "continuous", "angle"};

const char *lg_surrogate_kind_name(lg_surrogate_kind kind) {
    return (unsigned)kind < LG_SURROGATE_KIND_COUNT ? kind_names[kind] : "unknown";
}

uint32_t lg_surrogate_outputs(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_DISCRETE ? 4 * (model->intervals - 1) : model->net.outputs;
}

/* ---- description ---- */

static bool positive(double x) {
    return x > 0.0 && x <= DBL_MAX;
}

static lg_status check_discrete(const lg_surrogate_options *o, uint32_t intervals, lg_error *error) {
    const uint32_t numbers = 4 * (intervals - 1);
    if ((o->modes > 0 || o->angles) && o->kind != LG_SURROGATE_DISCRETE)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s belong to the discrete network, not to the %s one",
                       o->angles ? "inner angles" : "modes", kind_names[o->kind]);
    if (o->modes > 0 && o->angles)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a network gives modes or angles, not both");
    if (o->modes > numbers)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u modes are too many: a curve has %u numbers", o->modes,
                       numbers);
    if ((unsigned)o->loss >= LG_SURROGATE_LOSS_COUNT || (o->loss == LG_SURROGATE_ENERGY && !o->angles))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "only the discrete network of angles can learn the energy alone");
    return LG_OK;
}

/* Whether the network has the terms of mechanics that are asked for. */
static lg_status check_mechanics(const lg_surrogate_options *o, lg_error *error) {
    const bool discrete = o->kind == LG_SURROGATE_DISCRETE;
    if (o->residual > 0.0 && discrete)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the discrete network has no residual: its curves are no functions of the arc length");
    if (o->energy > 0.0 && discrete && (!o->angles || o->loss == LG_SURROGATE_ENERGY))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a weight of the energy needs inner angles and the loss mse (discrete network)");
    if (o->energy > 0.0 && !discrete && !o->boundary)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the energy needs `boundary`: free ends would straighten the beam");
    if (o->energy > 0.0 && o->between)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the energy is an integral over the nodes and needs `between` false");
    return LG_OK;
}

static lg_status check(const lg_surrogate_options *o, uint32_t intervals, double length, double centre,
                       lg_error *error) {
    if ((unsigned)o->kind >= LG_SURROGATE_KIND_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown kind of surrogate");
    if (o->boundary && o->kind == LG_SURROGATE_DISCRETE)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the discrete network has no `boundary`: its curves always have the given ends");
    if (o->symmetric && o->kind != LG_SURROGATE_ANGLE)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a symmetric reconstruction belongs to the angle network, not to the %s one",
                       kind_names[o->kind]);
    if (intervals < LG_ELASTICA_MIN_INTERVALS || intervals > LG_ELASTICA_MAX_INTERVALS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u intervals; %d to %d are possible", intervals,
                       LG_ELASTICA_MIN_INTERVALS, LG_ELASTICA_MAX_INTERVALS);
    if (!positive(length) || !positive(centre))
        return lg_fail(error, LG_INVALID_ARGUMENT, "length %g and centre %g must both be positive and finite",
                       length, centre);
    LG_TRY(check_discrete(o, intervals, error));
    LG_TRY(check_mechanics(o, error));
    if ((unsigned)o->penalty >= LG_SURROGATE_PENALTY_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown form of the penalty");
    if (!(o->gamma >= 0.0 && o->gamma <= DBL_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT, "gamma %g must be finite and not negative", o->gamma);
    if (!(o->energy >= 0.0 && o->energy <= DBL_MAX && o->residual >= 0.0 && o->residual <= DBL_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "weights of energy %g and residual %g must be finite and not negative", o->energy,
                       o->residual);
    return LG_OK;
}

lg_status lg_surrogate_init(lg_surrogate *model, const lg_surrogate_options *options, uint32_t intervals,
                            double length, double centre, lg_error *error) {
    LG_NEEDS(error, model, options);
    LG_TRY(check(options, intervals, length, centre, error));
    static const uint32_t inputs[] = {8, 9, 3};
    const uint32_t nodes = options->angles ? intervals - 1 : 4 * (intervals - 1);
    const uint32_t outputs[] = {options->modes > 0 ? options->modes : nodes, 2, 1};
    lg_surrogate made = {.options = *options, .intervals = intervals, .length = length, .centre = centre};
    const lg_status status =
        lg_net_init(&made.net, options->architecture, inputs[options->kind], options->embedding,
                    options->hidden, options->layers, outputs[options->kind], options->activation);
    if (status != LG_OK)
        return lg_fail(error, status,
                       "these numbers do not describe a possible network: %u layers of width %u, embedding "
                       "%u, architecture %d, activation %d",
                       options->layers, options->hidden, options->embedding, (int)options->architecture,
                       (int)options->activation);
    *model = made;
    return LG_OK;
}

size_t lg_surrogate_parameters(const lg_surrogate *model) {
    return lg_net_parameters(&model->net);
}

/* ---- the network's input ---- */

/* Returns the sign of the first number in `order` that is not zero. All of these numbers change sign under
 * reflection. If all are zero, the boundary conditions are their own mirror image. */
double lg_surrogate_sign(const lg_surrogate *model, const double *x) {
    const double order[] = {x[LG_AT_V0 + 1] - x[LG_AT_VN + 1], x[LG_AT_V0 + 1],
                            x[LG_AT_QN + 1] - x[LG_AT_Q0 + 1]};
    if (!model->options.mirror) return 1.0;
    for (size_t i = 0; i < LG_COUNT(order); i++)
        if (order[i] != 0.0) return order[i] < 0.0 ? -1.0 : 1.0;
    return 1.0;
}

/* Adding 0.0 turns -0 into 0, because atan2 would give -pi for -0. */
void lg_surrogate_angles(const double *x, double sign, double *angles) {
    angles[0] = atan2(sign * x[LG_AT_V0 + 1] + 0.0, x[LG_AT_V0]);
    angles[1] = atan2(sign * x[LG_AT_VN + 1] + 0.0, x[LG_AT_VN]);
}

void lg_surrogate_row(const lg_surrogate *model, const double *x, double sign, double s, double *row) {
    if (model->options.kind == LG_SURROGATE_ANGLE) {
        lg_surrogate_angles(x, sign, row);
        row[0] /= LG_SURROGATE_PI;
        row[1] /= LG_SURROGATE_PI;
        row[2] = s;
        return;
    }
    if (model->options.kind == LG_SURROGATE_CONTINUOUS) *row++ = s / model->length;
    for (size_t c = 0; c < 8; c++) {
        const double from = c < LG_AT_V0 || (c >= LG_AT_QN && c < LG_AT_VN) ? x[c % 2] : 0.0;
        row[c] = (c % 2 == 1 ? sign : 1.0) * (x[c] - from);
    }
    if (!model->options.normalise) return;
    row[LG_AT_Q0] = (row[LG_AT_Q0] - model->centre) / model->centre;
    row[LG_AT_QN] = (row[LG_AT_QN] - model->centre) / model->centre;
}

void lg_surrogate_end_weights(const lg_surrogate *model, double s, double *weights, double *slopes) {
    const double rest = s - model->length;
    const double a = exp(-100.0 * s * s), b = exp(-100.0 * rest * rest);
    const double c = exp(-100.0 * model->length * model->length), whole = (1.0 - c) * (1.0 + c);
    const double da = -200.0 * s * a, db = -200.0 * rest * b;
    weights[0] = (a - c * b) / whole;
    weights[1] = (b - c * a) / whole;
    slopes[0] = (da - c * db) / whole;
    slopes[1] = (db - c * da) / whole;
}

lg_status lg_surrogate_check_curves(const lg_surrogate *model, const lg_elastica_curves *curves,
                                    lg_error *error) {
    if (!(fabs(curves->length - model->length) <= 1e-9 * model->length))
        return lg_fail(error, LG_SHAPE, "curves of length %.17g do not fit a network for length %.17g",
                       curves->length, model->length);
    if (model->options.kind == LG_SURROGATE_DISCRETE && curves->intervals != model->intervals)
        return lg_fail(error, LG_SHAPE,
                       "curves of %u intervals do not fit a discrete network for %u intervals; train one for "
                       "them, or use a continuous or angle network",
                       curves->intervals, model->intervals);
    return LG_OK;
}

/* ---- split ---- */

/* Random stream of the split, so that its draws are independent of others with the same seed. */
#define SPLIT_STREAM 0x73706c74u

static bool fraction(double x) {
    return x >= 0.0 && x <= 1.0;
}

/* Shuffles the array of parts itself instead of a list of indices. The permutation depends on n and the seed
 * only, not on the fractions, and no memory is needed. */
lg_status lg_surrogate_split(size_t n, double train_fraction, double test_fraction, uint64_t seed,
                             uint8_t *parts) {
    if (!fraction(train_fraction) || !fraction(test_fraction) || parts == NULL) return LG_INVALID_ARGUMENT;
    if (train_fraction + test_fraction > 1.0 + 1e-12) return LG_INVALID_ARGUMENT;
    const size_t test = (size_t)(test_fraction * (double)n + 0.5), rest = n - test;
    const size_t wanted = (size_t)(train_fraction * (double)n + 0.5), train = wanted < rest ? wanted : rest;
    if (train == 0) return LG_INVALID_ARGUMENT;
    lg_rng rng;
    lg_rng_seed(&rng, seed, SPLIT_STREAM);
    memset(parts, LG_PART_NONE, n);
    memset(parts, LG_PART_TEST, test);
    memset(parts + test, LG_PART_TRAIN, train);
    for (size_t i = n; i > 1; i--) {
        const size_t j = (size_t)lg_rng_below(&rng, i);
        const uint8_t label = parts[j];
        parts[j] = parts[i - 1];
        parts[i - 1] = label;
    }
    return LG_OK;
}

/* ---- trained range ---- */

/* n boundary conditions; lengths are divided by `unit`. */
typedef struct trained_set {
    const double *x; /* (n, 8) */
    size_t n;
    double unit;
} trained_set;

/* The unit of length is the largest distance of q0 and qN in the set, or `length` if all ends coincide. */
static trained_set set_of(const double *trained, size_t n, double length) {
    trained_set out = {trained, n, 0.0};
    for (size_t i = 0; i < n; i++)
        out.unit = fmax(out.unit,
                        hypot(trained[8 * i + 4] - trained[8 * i], trained[8 * i + 5] - trained[8 * i + 1]));
    if (!(out.unit > 0.0)) out.unit = length > 0.0 ? length : 1.0;
    return out;
}

/* (v0, (qN - q0)/unit, vN), mirrored for sign = -1. */
static void relative(const trained_set *set, const double *x, double sign, double *out) {
    for (size_t c = 0; c < 6; c++) {
        const bool end = c == 2 || c == 3;
        const double value = end ? (x[c + 2] - x[c - 2]) / set->unit : x[c + 2];
        out[c] = (c % 2 == 1 ? sign : 1.0) * value;
    }
}

static double product(const double *a, const double *b) {
    double sum = 0.0;
    for (size_t c = 0; c < 6; c++) sum += a[c] * b[c];
    return sum;
}

enum { NEAR = 6 };

/* Finds the conditions, other than number `but`, that are nearest to x, mirrored for sign = -1: near (NEAR,
 * 6) becomes their differences from x, square (NEAR) the squares of their distances, in rising order. Returns
 * how many there are. */
static size_t find_near(const trained_set *set, size_t but, const double *x, double sign,
                        double near[NEAR][6], double *square) {
    double here[6], there[6];
    size_t count = 0;
    relative(set, x, sign, here);
    for (size_t i = 0; i < set->n; i++) {
        relative(set, set->x + 8 * i, 1.0, there);
        for (size_t c = 0; c < 6; c++) there[c] -= here[c];
        const double distance = product(there, there);
        if (i == but || !(count < NEAR || distance < square[NEAR - 1]) || isnan(distance)) continue;
        size_t at = count < NEAR ? count++ : NEAR - 1;
        for (; at > 0 && square[at - 1] > distance; at--) {
            square[at] = square[at - 1];
            memcpy(near[at], near[at - 1], sizeof near[at]);
        }
        square[at] = distance;
        memcpy(near[at], there, sizeof there);
    }
    return count;
}

/* Squared distance from the nearest condition. */
static double nearest(const trained_set *set, size_t but, const double *x, double sign) {
    double near[NEAR][6], square[NEAR];
    return find_near(set, but, x, sign, near, square) > 0 ? square[0] : INFINITY;
}

/* Squared distance from the family: from the lines through two of the nearest conditions, each line extended
 * at both ends by the distance of the two. */
static double off_family(const trained_set *set, size_t but, const double *x, double sign) {
    double near[NEAR][6], square[NEAR];
    const size_t count = find_near(set, but, x, sign, near, square);
    double least = count > 0 ? square[0] : INFINITY;
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j < i; j++) {
            double way[6], foot[6];
            for (size_t c = 0; c < 6; c++) way[c] = near[i][c] - near[j][c];
            const double length = product(way, way);
            if (!(length > 0.0)) continue;
            const double t = fmin(fmax(-product(near[j], way) / length, -1.0), 2.0);
            for (size_t c = 0; c < 6; c++) foot[c] = near[j][c] + t * way[c];
            least = fmin(least, product(foot, foot));
        }
    return least;
}

typedef double measure(const trained_set *set, size_t but, const double *x, double sign);

/* `largest` leaves out at most this many of the largest distances. It keeps these and one more in a list, in
 * decreasing order. */
enum { LONERS = 32 };

/* The largest distance of a trained condition from the others, without the n/100 largest ones. */
static double largest(const double *trained, size_t n, measure *of) {
    const size_t loners = n / 100 < LONERS ? n / 100 : LONERS;
    const trained_set set = set_of(trained, n, 0.0);
    double list[LONERS + 1] = {0.0};
    for (size_t i = 0; n > 1 && i < n; i++) {
        const double distance = of(&set, i, trained + 8 * i, 1.0);
        size_t at = loners + 1;
        for (; at > 0 && list[at - 1] < distance; at--)
            if (at <= loners) list[at] = list[at - 1];
        if (at <= loners) list[at] = distance;
    }
    return sqrt(list[loners]);
}

static double smallest(const lg_surrogate *model, const double *trained, size_t n, const double *x,
                       measure *of) {
    const trained_set set = set_of(trained, n, model->length);
    const double here = of(&set, SIZE_MAX, x, 1.0);
    return sqrt(model->options.mirror ? fmin(here, of(&set, SIZE_MAX, x, -1.0)) : here);
}

double lg_surrogate_reach(const double *trained, size_t n) {
    return largest(trained, n, nearest);
}

double lg_surrogate_spread(const double *trained, size_t n) {
    const double reach = lg_surrogate_reach(trained, n);
    return fmax(largest(trained, n, off_family), fmax(0.02 * reach, 0.5 * reach * reach));
}

double lg_surrogate_distance(const lg_surrogate *model, const double *trained, size_t n, const double *x) {
    return smallest(model, trained, n, x, nearest);
}

double lg_surrogate_off_family(const lg_surrogate *model, const double *trained, size_t n, const double *x) {
    return smallest(model, trained, n, x, off_family);
}
