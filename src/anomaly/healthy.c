/* Which class of a series means that all is well. */
#include <ctype.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/series.h"

/* Names that say so as a whole, words that say so anywhere in a name, and words that deny it. All have a
 * blank on both sides, as spaced() makes them. */
static const char *const whole[] = {
    " 0 ",           " none ",        " nofault ",    " no fault ",      " no faults ",     " no damage ",
    " no defect ",   " no failure ",  " no anomaly ", " no crack ",      " fault free ",    " damage free ",
    " defect free ", " not damaged ", " not broken ", " without fault ", " without damage "};
static const char *const said[] = {" healthy ", " normal ",   " ok ",        " okay ",     " good ",
                                   " intact ",  " baseline ", " undamaged ", " unbroken ", " nominal "};
static const char *const denied[] = {" not ",    " no ",      " non ",    " un ",    " nor ",    " never ",
                                     " almost ", " near ",    " nearly ", " fault ", " faulty ", " broken ",
                                     " damage ", " damaged ", " defect ", " crack ", " bad ",    " unlike "};

/* Writes the words of a name in lower case, with a blank before, between and after them. */
static void spaced(const char *name, char text[LG_SERIES_NAME + 2]) {
    size_t n = 0;
    text[n++] = ' ';
    for (size_t i = 0; i < LG_SERIES_NAME && name[i] != '\0'; i++) {
        const unsigned char c = (unsigned char)name[i];
        const bool letter = isalnum(c) || c >= 0x80; /* bytes of UTF-8 are letters */
        if (letter || text[n - 1] != ' ') text[n++] = (char)(letter ? tolower(c) : ' ');
    }
    if (text[n - 1] != ' ') text[n++] = ' ';
    text[n] = '\0';
}

static bool has_word(const char *text, const char *const *words, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (strstr(text, words[i]) != NULL) return true;
    return false;
}

static bool says_healthy(const char *name) {
    char text[LG_SERIES_NAME + 2];
    spaced(name, text);
    for (size_t i = 0; i < LG_COUNT(whole); i++)
        if (strcmp(text, whole[i]) == 0) return true;
    return has_word(text, said, LG_COUNT(said)) && !has_word(text, denied, LG_COUNT(denied));
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
