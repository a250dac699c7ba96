/* Which class of a series means that all is well. */
#include <ctype.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/series.h"

/* Names that say so as a whole, with a blank on both sides and between words. */
static const char *const whole[] = {
    " 0 ",           " none ",        " nofault ",    " no fault ",      " no faults ",     " no damage ",
    " no defect ",   " no failure ",  " no anomaly ", " no crack ",      " fault free ",    " damage free ",
    " defect free ", " not damaged ", " not broken ", " without fault ", " without damage "};
/* Words that say so if all other words of the name are numbers (which may have a unit) or neutral. Any other
 * word may deny it, in some language, and so may any other punctuation mark. */
static const char *const said[] = {"healthy", "normal",   "ok",        "okay",     "good",
                                   "intact",  "baseline", "undamaged", "unbroken", "nominal"};
static const char *const neutral[] = {"bearing", "case",    "class",  "condition", "data",
                                      "label",   "machine", "mode",   "motor",     "operation",
                                      "run",     "state",   "status", "time"};
static const char separators[] = " \t_-.:,;/()[]#";

static bool is_among(const char *word, const char *const *words, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (strcmp(word, words[i]) == 0) return true;
    return false;
}

static bool says_healthy(const char *name) {
    char lower[LG_SERIES_NAME], text[2 * LG_SERIES_NAME + 2] = " ";
    size_t n = 0;
    bool healthy = false, doubtful = false;
    for (; n + 1 < LG_SERIES_NAME && name[n] != '\0'; n++) lower[n] = (char)tolower((unsigned char)name[n]);
    lower[n] = '\0';
    for (char *at = lower + strspn(lower, separators); *at != '\0'; at += strspn(at, separators)) {
        char *word = at;
        at += strcspn(at, separators);
        if (*at != '\0') *at++ = '\0';
        const bool says = is_among(word, said, LG_COUNT(said));
        healthy = healthy || says;
        doubtful = doubtful ||
                   !(says || isdigit((unsigned char)*word) || is_among(word, neutral, LG_COUNT(neutral)));
        (void)strcat(strcat(text, word), " ");
    }
    return is_among(text, whole, LG_COUNT(whole)) || (healthy && !doubtful);
}

uint32_t lg_series_healthy(const lg_series *series, const char *name) {
    uint32_t found = LG_NO_CLASS;
    if (series == NULL || series->class_name == NULL) return LG_NO_CLASS;
    const bool given = name != NULL && name[0] != '\0';
    for (uint32_t c = 0; c < series->classes; c++) {
        if (given && strcmp(series->class_name[c], name) == 0) return c;
        if (given ? series->class_label == NULL || strcmp(series->class_label[c], name) != 0
                  : !says_healthy(series->class_name[c]))
            continue;
        if (found != LG_NO_CLASS && !given) return LG_NO_CLASS;
        found = c;
    }
    return found;
}
