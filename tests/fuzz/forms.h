/* Changes of inputs by their structure, for the fuzzer alone. */
#ifndef LG_FUZZ_FORMS_H
#define LG_FUZZ_FORMS_H

#include "fuzz.h"

/* Changes plain bytes in place; returns their number. */
typedef size_t (*fuzz_bytes)(uint8_t *data, size_t size, size_t most);
/* Changes an input in place; returns its new size. */
typedef size_t (*fuzz_mutate)(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes);
/* Makes an input from parts of two inputs. Returns its size, or 0 if the parts do not fit. */
typedef size_t (*fuzz_cross)(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out,
                             size_t most, unsigned seed);

/* The index is a fuzz_form. If a member is NULL, libFuzzer changes the bytes. */
typedef struct fuzz_form_row {
    fuzz_mutate mutate;
    fuzz_cross cross;
} fuzz_form_row;
extern const fuzz_form_row fuzz_forms[FORM_COUNT];

/* A number from 0 to below - 1; 0 if below is 0. */
uint32_t fuzz_draw(uint64_t *random, uint32_t below);

size_t tree_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes);
size_t yaml_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes);
size_t tensors_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes);
size_t npy_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes);
size_t functions_mutate(uint8_t *data, size_t size, size_t most, unsigned seed, fuzz_bytes bytes);
size_t tree_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out, size_t most,
                  unsigned seed);
size_t yaml_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out, size_t most,
                  unsigned seed);
size_t functions_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out,
                       size_t most, unsigned seed);

#endif
