/* Counts the reasons why lg-export refuses programs or leaves derivatives out. */
#include <ctype.h>
#include <stdio.h>
#include <string.h>

#include "apps/random/exports.h"

enum { REASONS = 200, LENGTH = 200 };

static struct {
    char words[LENGTH];
    size_t count;
} reasons[REASONS];

/* Replaces the numbers of a sentence by #, so that sentences of different recordings are equal. */
static void generalise(const char *sentence, char *out) {
    size_t n = 0;
    for (const char *at = sentence; *at != '\0' && *at != '\n' && n + 1 < LENGTH; at++) {
        if (!isdigit((unsigned char)*at))
            out[n++] = *at;
        else if (n == 0 || out[n - 1] != '#')
            out[n++] = '#';
    }
    out[n] = '\0';
}

void add_reason(const char *from, const char *sentence) {
    char words[LENGTH], own[LENGTH + 16];
    size_t at = 0;
    generalise(sentence, words);
    (void)snprintf(own, sizeof own, "%s: %s", from, words);
    own[LENGTH - 1] = '\0';
    while (at + 1 < REASONS && reasons[at].count > 0 && strcmp(reasons[at].words, own) != 0) at++;
    memcpy(reasons[at].words, own, LENGTH);
    reasons[at].count++;
}

void print_reasons(void) {
    for (size_t i = 0; i < REASONS; i++)
        if (reasons[i].count > 0) printf("%8zu  %s\n", reasons[i].count, reasons[i].words);
}
