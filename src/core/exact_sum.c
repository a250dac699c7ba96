#include "core/exact_sum.h"

#include <math.h>
#include <string.h>

void lg_exact_add(lg_exact_sum *sum, double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof(bits));
    const uint64_t exponent = bits >> 52 & 0x7ff, fraction = bits & 0xfffffffffffffu;
    const uint64_t mantissa = exponent > 0 ? fraction | 1ull << 52 : fraction;
    const uint64_t place = exponent > 0 ? exponent - 1 : 0, shift = place % 32;
    /* mantissa 2^shift, split into three parts of 32 bits */
    const uint64_t low = mantissa << shift, high = shift > 0 ? mantissa >> (64 - shift) : 0;
    const int64_t parts[3] = {(int64_t)(low & 0xffffffffu), (int64_t)(low >> 32), (int64_t)high};
    for (int i = 0; i < 3; i++) sum->part[place / 32 + (uint64_t)i] += bits >> 63 != 0 ? -parts[i] : parts[i];
}

void lg_exact_merge(lg_exact_sum *into, const lg_exact_sum *from) {
    for (int i = 0; i < LG_EXACT_PARTS; i++) into->part[i] += from->part[i];
}

/* Carries bring every part but the last into 0..2^32 - 1. A negative sum is negated first, so that the parts
 * do not cancel. The loop runs at most twice, because the last part of a positive sum is at least 0. */
double lg_exact_value(const lg_exact_sum *sum) {
    int64_t part[LG_EXACT_PARTS];
    double sign = 1.0, value = 0.0;
    memcpy(part, sum->part, sizeof(part));
    for (;;) {
        for (int i = 0; i + 1 < LG_EXACT_PARTS; i++) {
            const int64_t rest = (int64_t)((uint64_t)part[i] & 0xffffffffu),
                          carry = (part[i] - rest) / 4294967296;
            part[i] = rest;
            part[i + 1] += carry;
        }
        if (part[LG_EXACT_PARTS - 1] >= 0) break;
        sign = -1.0;
        for (int i = 0; i < LG_EXACT_PARTS; i++) part[i] = -part[i];
    }
    for (int i = LG_EXACT_PARTS - 1; i >= 0; i--) value += ldexp((double)part[i], 32 * i - 1074);
    return sign * value;
}
