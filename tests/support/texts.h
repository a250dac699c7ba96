/* Random names and labels. */
#ifndef LG_TEST_TEXTS_H
#define LG_TEST_TEXTS_H

#include <string.h>

#include "liegrad/core.h"

/* A random text of 0 to 4 pieces, most of which mean something in CSV or to a terminal. Any byte but 0 may
 * occur. */
static inline void draw_text(lg_rng *rng, char *text) {
    static const char *const pieces[] = {
        "\"", ",",   ";", "\t", "\n", "\r\n", " ",        "#",        "=", "\xef\xbb\xbf",
        "NA", "nan", "1", "0",  ".5", "e7",   "\x1b[31m", "\xc2\x9b", "'"};
    const uint64_t count = lg_rng_below(rng, 5);
    text[0] = '\0';
    for (uint64_t i = 0; i < count; i++) {
        const char byte[2] = {(char)(1 + lg_rng_below(rng, 255)), '\0'};
        (void)strcat(text, lg_rng_below(rng, 2) == 0 ? byte : pieces[lg_rng_below(rng, LG_COUNT(pieces))]);
    }
}

#endif
