/* The table of forms. */
#include "forms.h"

const fuzz_form_row fuzz_forms[FORM_COUNT] = {[FORM_TREE] = {tree_mutate, tree_cross},
                                              [FORM_YAML] = {yaml_mutate, yaml_cross},
                                              [FORM_TENSORS] = {tensors_mutate, NULL},
                                              [FORM_NPY] = {npy_mutate, NULL},
                                              [FORM_FUNCTIONS] = {functions_mutate, functions_cross}};

uint32_t fuzz_draw(uint64_t *random, uint32_t below) {
    *random += UINT64_C(0x9e3779b97f4a7c15); /* splitmix64 */
    uint64_t z = *random;
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    z ^= z >> 31;
    return below == 0 ? 0 : (uint32_t)(z % below);
}
