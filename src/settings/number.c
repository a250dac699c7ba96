/* Parses numbers. The whole text must be a number; the locale does not matter. */
#include <math.h>

#include "core/text.h"
#include "liegrad/settings.h"

lg_status lg_number_parse(const char *text, double *out) {
    if (text == NULL || out == NULL) return LG_INVALID_ARGUMENT;
    double value;
    const char *end = lg_decimal(text, &value);
    if (end == NULL || *end != '\0') return LG_FORMAT;
    if (!isfinite(value)) return LG_NOT_FINITE;
    *out = value;
    return lg_decimal_is_rounded(text, value) ? LG_UNSUPPORTED : LG_OK;
}

lg_status lg_integer_parse(const char *text, uint64_t *out) {
    if (text == NULL || out == NULL) return LG_INVALID_ARGUMENT;
    if (*text == '\0') return LG_FORMAT;
    uint64_t value = 0;
    for (; *text != '\0'; text++) {
        if (*text < '0' || *text > '9') return LG_FORMAT;
        uint64_t digit = (uint64_t)(*text - '0');
        if (value > (UINT64_MAX - digit) / 10) return LG_FORMAT;
        value = 10 * value + digit;
    }
    *out = value;
    return LG_OK;
}
