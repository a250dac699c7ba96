/* Numbers with a decimal point, in every locale. */
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"

/* The locale of the thread is "C" between point_begin and point_end. The C libraries of Linux keep this
 * locale ready, so newlocale allocates nothing and cannot fail. */
typedef struct point {
    locale_t c, caller;
} point;

static point point_begin(void) {
    const locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    return (point){.c = c, .caller = uselocale(c)};
}

static void point_end(point p) {
    (void)uselocale(p.caller);
    if (p.c != (locale_t)0) freelocale(p.c);
}

int lg_format_list(char *text, size_t size, const char *format, va_list arguments) {
    const point p = point_begin();
    const int length = vsnprintf(text, size, format, arguments);
    point_end(p);
    return length;
}

int lg_format(char *text, size_t size, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    const int length = lg_format_list(text, size, format, arguments);
    va_end(arguments);
    return length;
}

void lg_append(char *text, size_t size, const char *format, ...) {
    const size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    (void)lg_format_list(text + used, size - used, format, arguments);
    va_end(arguments);
}

double lg_real(const char *text, char **end) {
    const point p = point_begin();
    const double value = strtod(text, end);
    point_end(p);
    return value;
}

/* ---- texts and numbers, exactly ---- */

/* Looks for the shortest text that reads back as the same number. 15 digits come first: %g drops zeros at the
 * end, so this is the shortest text of any number that needs at most 15 digits. A subnormal number has fewer
 * correct digits, so there the search starts at 1. At a power of two the double below the value is nearer
 * than the double above it. The nearest text with n digits may then read back as the double below, and the
 * next text with n digits as the value. So the function also tries (1 + 2^-54) value. */
void lg_format_shortest(char text[LG_SHORTEST], double value, bool single) {
    const bool tiny = fabs(value) < (single ? (double)FLT_MIN : DBL_MIN);
    bool same = false;
    for (int digits = tiny ? 1 : single ? FLT_DIG : DBL_DIG; !same && digits <= DBL_DECIMAL_DIG; digits++)
        for (int above = 0; above < 2 && !same; above++) {
            (void)lg_format(text, LG_SHORTEST, "%.*Lg", digits, value * (1 + above * 0x1p-54L));
            const double read = lg_real(text, NULL);
            same = read == value || (single && (double)(float)read == value) || isnan(value);
        }
}

static const char *digits(const char *text, bool *any) {
    while (*text >= '0' && *text <= '9') text++, *any = true;
    return text;
}

bool lg_is_decimal(const char *text) {
    bool mantissa = false, exponent = false;
    if (*text == '+' || *text == '-') text++;
    text = digits(text, &mantissa);
    if (*text == '.') text = digits(text + 1, &mantissa);
    if (!mantissa) return false;
    if (*text == 'e' || *text == 'E') {
        text++;
        if (*text == '+' || *text == '-') text++;
        text = digits(text, &exponent);
        if (!exponent) return false;
    }
    return *text == '\0';
}

/* The number is sign 0.DIGITS 10^power; the first of the digits at `at` is not 0. 0 has the sign 0. */
typedef struct decimal {
    int sign;
    long power;
    const char *at;
} decimal;

static decimal decimal_of(const char *text) {
    enum { FAR = 1 << 20 }; /* beyond the exponent of any double, and more than a text has digits */
    decimal d = {.sign = *text == '-' ? -1 : 1};
    text += strspn(text, "+-");
    const size_t length = strcspn(text, "eE"), whole = strcspn(text, ".eE");
    const size_t zeros = strspn(text, "0.");
    if (text[length] != '\0') d.power = strtol(text + length + 1, NULL, 10);
    if (d.power > FAR || d.power < -FAR) d.power = d.power > 0 ? FAR : -FAR;
    d.power += zeros < whole ? (long)(whole - zeros) : (long)whole + 1 - (long)zeros;
    d.at = text + zeros;
    if (zeros >= length) d.sign = 0;
    return d;
}

/* Returns the next digit, or 0 behind the last one. */
static int next_digit(decimal *d) {
    if (*d->at == '.') d->at++;
    return *d->at >= '0' && *d->at <= '9' ? *d->at++ - '0' : 0;
}

int lg_decimal_compare(const char *a, const char *b) {
    decimal x = decimal_of(a), y = decimal_of(b);
    if (x.sign != y.sign) return x.sign < y.sign ? -1 : 1;
    if (x.sign == 0) return 0;
    if (x.power != y.power) return x.power < y.power ? -x.sign : x.sign;
    for (size_t left = strlen(x.at) + strlen(y.at); left > 0; left--) {
        const int p = next_digit(&x), q = next_digit(&y);
        if (p != q) return p < q ? -x.sign : x.sign;
    }
    return 0;
}

bool lg_decimal_is_rounded(const char *text, double value) {
    char exact[DBL_MAX_10_EXP + 3];
    if (fabs(value) < 0x1p53 || strpbrk(text, ".eE") != NULL) return false;
    (void)lg_format(exact, sizeof exact, "%.0f", value);
    return lg_decimal_compare(text, exact) != 0;
}
