/* Kinds of potentials: networks of the coordinates x (B, d) or of functions of the coordinates. */
#include "hamiltonian/internal.h"

/* ---- functions of the dictionary ---- */

static lg_var same(lg_tape *tape, lg_var x) {
    return x;
}

static lg_var cube(lg_tape *tape, lg_var x) {
    return lg_mul(tape, x, lg_square(tape, x));
}

static lg_var fourth(lg_tape *tape, lg_var x) {
    return lg_square(tape, lg_square(tape, x));
}

lg_var lg_hamiltonian_pairs(lg_tape *tape, lg_var a, lg_var b) {
    const uint32_t n = lg_var_shape(tape, a).dims[1];
    lg_var out[LG_DICTIONARY_COORDINATES];
    for (uint32_t i = 0; i + 1 < n; i++)
        out[i] = lg_mul(tape, lg_slice(tape, a, 1, i, 1), lg_slice(tape, b, 1, i + 1, n - i - 1));
    return lg_concat(tape, out, n - 1, 1);
}

static lg_var products(lg_tape *tape, lg_var x) {
    return lg_hamiltonian_pairs(tape, x, x);
}

static uint32_t one_each(uint32_t d) {
    return d;
}

static uint32_t one_a_pair(uint32_t d) {
    return d * (d - 1) / 2;
}

/* count: how many functions of d coordinates there are; record: their values, (B, d) -> (B, count); angle: x
 * is in radians, without scale. */
static const struct {
    uint32_t (*count)(uint32_t d);
    lg_var (*record)(lg_tape *tape, lg_var x);
    bool angle;
} functions[] = {{one_each, same, false},      {one_each, lg_square, false}, {one_each, cube, false},
                 {one_each, fourth, false},    {one_each, lg_sin, true},     {one_each, lg_cos, true},
                 {one_a_pair, products, false}};

static uint32_t dictionary_count(uint32_t d) {
    uint32_t sum = 0;
    for (size_t i = 0; i < LG_COUNT(functions); i++) sum += functions[i].count(d);
    return sum;
}

static lg_var dictionary_record(lg_tape *tape, lg_var x, double unit) {
    const uint32_t d = lg_var_shape(tape, x).dims[1];
    const lg_var angles = lg_hamiltonian_scaled(tape, x, unit);
    lg_var out[LG_COUNT(functions)];
    size_t used = 0;
    for (size_t i = 0; i < LG_COUNT(functions); i++)
        if (functions[i].count(d) > 0)
            out[used++] = functions[i].record(tape, functions[i].angle ? angles : x);
    return lg_concat(tape, out, used, 1);
}

/* ---- kinds ---- */

static const lg_potential_row rows[LG_POTENTIAL_KIND_COUNT] = {
    [LG_POTENTIAL_MLP] = {.layered = true, .count = one_each},
    [LG_POTENTIAL_LINEAR] = {.count = one_each},
    [LG_POTENTIAL_DICTIONARY] = {.count = dictionary_count, .record = dictionary_record}};

const lg_potential_row *lg_potential_row_of(lg_potential_kind kind) {
    return (unsigned)kind < LG_POTENTIAL_KIND_COUNT ? &rows[kind] : NULL;
}
