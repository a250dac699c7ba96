/* One program for all harnesses, for libFuzzer and for the driver of AFL++. The environment variable
 * LIEGRAD_FUZZ names the harness. */
#include <stdio.h>
#include <stdlib.h>

#include "forms.h"

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed);
size_t LLVMFuzzerCustomCrossOver(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b,
                                 uint8_t *out, size_t most, unsigned seed);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t most);

static const fuzz_harness *harness;

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    const char *name = getenv("LIEGRAD_FUZZ");
    harness = name != NULL ? fuzz_find(name) : NULL;
    if (harness == NULL) {
        (void)fprintf(stderr, "LIEGRAD_FUZZ names one of:\n");
        for (const fuzz_harness *h = fuzz_harnesses; h->name != NULL; h++)
            (void)fprintf(stderr, "  %-12s %s\n", h->name, h->reader);
        exit(2);
    }
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    harness->run(data, size < harness->most ? size : harness->most);
    return 0;
}

#ifdef LG_FUZZ_MUTATOR
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed) {
    const fuzz_mutate mutate = fuzz_forms[harness->form].mutate;
    return mutate != NULL ? mutate(data, size, most, seed, LLVMFuzzerMutate)
                          : LLVMFuzzerMutate(data, size, most);
}

size_t LLVMFuzzerCustomCrossOver(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b,
                                 uint8_t *out, size_t most, unsigned seed) {
    const fuzz_cross cross = fuzz_forms[harness->form].cross;
    return cross != NULL ? cross(a, size_a, b, size_b, out, most, seed) : 0;
}
#endif
