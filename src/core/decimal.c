/* Numbers with a decimal point, in every locale. */
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/text.h"

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

/* The first 19 digits as an integer, the number of digits without zeros at the beginning, and the power of
 * ten of the last digit. */
typedef struct scan {
    uint64_t digits;
    int count, power;
} scan;

static inline const char *scan_digits(const char *at, int behind, scan *out) {
    for (unsigned digit; (digit = (unsigned)(unsigned char)*at - '0') < 10; at++) {
        if (out->count < 19) out->digits = 10 * out->digits + digit;
        out->power -= behind;
        out->count += out->count > 0 || digit > 0;
    }
    return at;
}

/* Returns the end of the number at the beginning of a text, or NULL if no number is there. */
static inline const char *scan_number(const char *text, scan *out) {
    enum { FAR = 100000 };
    scan number = {.count = 0};
    const char *first = text + (*text == '+' || *text == '-'), *at = scan_digits(first, 0, &number);
    bool any = at > first;
    if (*at == '.') {
        const char *behind = at + 1;
        at = scan_digits(behind, 1, &number);
        any = any || at > behind;
    }
    if (*at == 'e' || *at == 'E') {
        const bool down = *++at == '-';
        int power = 0;
        at += *at == '+' || down;
        const char *begin = at;
        for (; *at >= '0' && *at <= '9'; at++)
            if (power < FAR) power = 10 * power + (*at - '0');
        number.power += down ? -power : power;
        any = any && at > begin;
    }
    *out = number;
    return any ? at : NULL;
}

bool lg_is_decimal(const char *text) {
    scan number;
    const char *end = scan_number(text, &number);
    return end != NULL && *end == '\0';
}

/* Digits below 2^53 and powers of ten up to 10^22 are exact as doubles, so that their product or quotient is
 * rounded once (Clinger 1990). The C library converts other numbers. */
const char *lg_decimal(const char *text, double *out) {
    static const double powers[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    scan number;
    const char *end = scan_number(text, &number);
    if (end == NULL) return NULL;
    if (number.count > 19 || number.digits >> 53 != 0 || number.power < -22 || number.power > 22) {
        *out = lg_real(text, NULL);
        return end;
    }
    const double digits = (double)(int64_t)number.digits;
    *out = number.power < 0 ? digits / powers[-number.power] : digits * powers[number.power];
    if (*text == '-') *out = -*out;
    return end;
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
