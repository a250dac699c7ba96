/* Harnesses. Each passes any bytes to one reader of files or texts, in this process, and frees the result.
 * The same table is used by libFuzzer, by AFL++, and by the replay of the corpora in the tests. */
#ifndef LG_FUZZ_H
#define LG_FUZZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"

/* What inputs are made of. The fuzzer changes them by this structure (forms.h). */
typedef enum fuzz_form {
    FORM_BYTES,
    FORM_TREE, /* a tree (tree.h), which is made an HDF5 file */
    FORM_YAML,
    FORM_TENSORS,   /* safetensors */
    FORM_NPY,       /* numpy, without the magic string */
    FORM_FUNCTIONS, /* packed functions, each after its length (u16, little-endian) */
    FORM_COUNT
} fuzz_form;

typedef struct fuzz_harness {
    const char *name;
    void (*run)(const uint8_t *data, size_t size);
    fuzz_form form;
    size_t most;        /* largest input in bytes */
    const char *reader; /* the reader that is tested */
} fuzz_harness;

/* Ends with a row whose name is NULL. */
extern const fuzz_harness fuzz_harnesses[];
/* NULL if there is no harness of this name. */
const fuzz_harness *fuzz_find(const char *name);

/* Writes the bytes to a file and returns its path. All inputs use the same file. Its name ends like the name
 * of a part. */
#define FUZZ_ENDING ".part-0-of-2"
const char *fuzz_file(const void *data, size_t size);
int fuzz_file_descriptor(void);
/* Ends the process if a reader has failed without a message. fuzz_returned counts the results of readers:
 * failures and successes. A replay of a corpus fails if no reader accepts any of it: then the harness is out
 * of date. */
void fuzz_status(lg_status status, const lg_error *error);
extern size_t fuzz_returned[2];
/* Bytes that an array of a file may take. */
extern uint64_t fuzz_limit;
/* Reads a file of any format as a table and as a frame. */
void fuzz_read_table(const char *path);

/* The harnesses of texts, of trees, and of what one process leaves for another. */
void fuzz_scene(const uint8_t *data, size_t size);
void fuzz_machine(const uint8_t *data, size_t size);
void fuzz_scheme(const uint8_t *data, size_t size);
void fuzz_grid(const uint8_t *data, size_t size);
void fuzz_search(const uint8_t *data, size_t size);
void fuzz_trials(const uint8_t *data, size_t size);
void fuzz_study(const uint8_t *data, size_t size);
void fuzz_table(const uint8_t *data, size_t size);
void fuzz_log(const uint8_t *data, size_t size);
void fuzz_npy(const uint8_t *data, size_t size);
void fuzz_tensors(const uint8_t *data, size_t size);
void fuzz_feed(const uint8_t *data, size_t size);
void fuzz_options(const uint8_t *data, size_t size);
void fuzz_model(const uint8_t *data, size_t size);
void fuzz_data(const uint8_t *data, size_t size);
void fuzz_program(const uint8_t *data, size_t size);
void fuzz_packed(const uint8_t *data, size_t size);
void fuzz_checkpoint(const uint8_t *data, size_t size);
void fuzz_task(const uint8_t *data, size_t size);
void fuzz_policy(const uint8_t *data, size_t size);
void fuzz_image(const uint8_t *data, size_t size);
void fuzz_parts(const uint8_t *data, size_t size);
void fuzz_part(const uint8_t *data, size_t size);
void fuzz_fmu2(const uint8_t *data, size_t size);
void fuzz_fmu3(const uint8_t *data, size_t size);

#endif
