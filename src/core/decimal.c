/* Numbers with a decimal point, in every locale. */
#include <locale.h>
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
