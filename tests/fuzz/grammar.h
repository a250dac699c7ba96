/* Texts from the tables of fields by which the readers read YAML. */
#ifndef LG_FUZZ_GRAMMAR_H
#define LG_FUZZ_GRAMMAR_H

#include "document.h"

/* Draws a change of the document and makes it. `bytes` changes single scalars. */
void grammar_change(document *d, uint64_t *random, size_t (*bytes)(uint8_t *, size_t, size_t));

#endif
