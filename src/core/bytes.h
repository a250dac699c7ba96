/* Converts numbers to the bytes of a file, lowest byte first, and back. The byte order of the machine does
 * not matter. */
#ifndef LG_BYTES_H
#define LG_BYTES_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline uint64_t lg_bytes_get(const unsigned char *from, size_t count) {
    uint64_t bits = 0;
    for (size_t i = 0; i < count; i++) bits |= (uint64_t)from[i] << 8 * i;
    return bits;
}

static inline void lg_bytes_put(unsigned char *to, size_t count, uint64_t bits) {
    for (size_t i = 0; i < count; i++) to[i] = (unsigned char)(bits >> 8 * i);
}

static inline double lg_f64_of_bits(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline float lg_f32_of_bits(uint32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline uint64_t lg_bits_of_f64(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline uint32_t lg_bits_of_f32(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

#endif
