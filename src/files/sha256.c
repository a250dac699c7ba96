/* SHA-256, FIPS 180-4 sections 4.1.2, 4.2.2, 5.3.3 and 6.2. */
#include <string.h>

#include "core/bytes.h"
#include "files/h5.h"

static const uint32_t round_constants[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2,
};

static uint32_t rotate(uint32_t x, unsigned n) {
    return (x >> n) | (x << (32 - n));
}

static void compress(uint32_t h[8], const uint8_t *block) {
    uint32_t w[64], s[8];
    for (int i = 0; i < 16; i++) {
        const uint8_t *b = block + 4 * i;
        w[i] = (uint32_t)b[0] << 24 | (uint32_t)b[1] << 16 | (uint32_t)b[2] << 8 | b[3];
    }
    for (int i = 16; i < 64; i++) {
        uint32_t a = w[i - 15], b = w[i - 2];
        w[i] = w[i - 16] + (rotate(a, 7) ^ rotate(a, 18) ^ (a >> 3)) + w[i - 7] +
               (rotate(b, 17) ^ rotate(b, 19) ^ (b >> 10));
    }
    memcpy(s, h, sizeof s);
    for (int i = 0; i < 64; i++) {
        uint32_t sum1 = rotate(s[4], 6) ^ rotate(s[4], 11) ^ rotate(s[4], 25);
        uint32_t choice = (s[4] & s[5]) ^ (~s[4] & s[6]);
        uint32_t t1 = s[7] + sum1 + choice + round_constants[i] + w[i];
        uint32_t sum0 = rotate(s[0], 2) ^ rotate(s[0], 13) ^ rotate(s[0], 22);
        uint32_t majority = (s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]);
        memmove(s + 1, s, 7 * sizeof *s);
        s[4] += t1;
        s[0] = t1 + sum0 + majority;
    }
    for (int i = 0; i < 8; i++) h[i] += s[i];
}

void lg_sha256_init(lg_sha256 *state) {
    *state = (lg_sha256){.h = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c,
                               0x1f83d9ab, 0x5be0cd19}};
}

void lg_sha256_add(lg_sha256 *state, const void *data, size_t bytes) {
    const uint8_t *in = data;
    size_t held = (size_t)(state->bytes % 64);
    state->bytes += bytes;
    while (bytes > 0) {
        if (held == 0 && bytes >= 64) {
            compress(state->h, in);
            in += 64, bytes -= 64;
            continue;
        }
        size_t part = bytes < 64 - held ? bytes : 64 - held;
        memcpy(state->block + held, in, part);
        in += part, bytes -= part, held += part;
        if (held == 64) compress(state->h, state->block), held = 0;
    }
}

void lg_sha256_finish(lg_sha256 *state, char text[LG_SHA256_TEXT]) {
    static const char digits[] = "0123456789abcdef";
    static const uint8_t padding[64] = {0x80};
    uint8_t length[8];
    for (int i = 0; i < 8; i++) length[i] = (uint8_t)((state->bytes * 8) >> (56 - 8 * i));
    size_t held = (size_t)(state->bytes % 64);
    lg_sha256_add(state, padding, held < 56 ? 56 - held : 120 - held);
    lg_sha256_add(state, length, sizeof length);
    for (int i = 0; i < 64; i++) text[i] = digits[state->h[i / 8] >> (28 - 4 * (i % 8)) & 15];
    text[64] = '\0';
}

/* Adds numbers of 4 or 8 bytes with the lowest byte first. */
static void add_numbers(lg_sha256 *state, const void *values, size_t count, size_t size) {
    unsigned char bytes[4096];
    const unsigned char *from = values;
    for (size_t left = count; left > 0;) {
        const size_t part = left < sizeof bytes / size ? left : sizeof bytes / size;
        for (size_t j = 0; j < part; j++, from += size) {
            uint64_t wide;
            uint32_t narrow;
            memcpy(size == sizeof wide ? (void *)&wide : &narrow, from, size);
            lg_bytes_put(bytes + size * j, size, size == sizeof wide ? wide : narrow);
        }
        lg_sha256_add(state, bytes, size * part);
        left -= part;
    }
}

void lg_sha256_add_doubles(lg_sha256 *state, const double *values, size_t count) {
    add_numbers(state, values, count, sizeof *values);
}

void lg_sha256_add_floats(lg_sha256 *state, const float *values, size_t count) {
    add_numbers(state, values, count, sizeof *values);
}

void lg_sha256_add_u32(lg_sha256 *state, const uint32_t *values, size_t count) {
    add_numbers(state, values, count, sizeof *values);
}
