/* Growing text, and numbers, strings and comments as C. */
#include "lg-export/export.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

static void append(text *to, const char *data, size_t length) {
    if (to->length + length + 1 > to->room) {
        to->room = 2 * to->room + length + 256;
        char *grown = realloc(to->data, to->room);
        if (grown == NULL) app_out_of_memory();
        to->data = grown;
    }
    memcpy(to->data + to->length, data, length);
    to->length += length;
    to->data[to->length] = '\0';
}

void text_add(text *to, const char *format, ...) {
    char small[256];
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    const int length = vsnprintf(small, sizeof small, format, arguments);
    va_end(arguments);
    if (length >= 0 && (size_t)length < sizeof small) {
        append(to, small, (size_t)length);
    } else if (length > 0) {
        char *large = app_alloc((size_t)length + 1, 1);
        (void)vsnprintf(large, (size_t)length + 1, format, again);
        append(to, large, (size_t)length);
        free(large);
    }
    va_end(again);
}

static bool in_word(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

void text_add_named(text *to, const char *name, const char *code) {
    for (const char *s = code, *found; *s != '\0'; s = found) {
        found = strstr(s + 1, "NAME_");
        if (found == NULL) found = s + strlen(s);
        const bool here = strncmp(s, "NAME_", 5) == 0 && (s == code || !in_word(s[-1]));
        if (here) append(to, name, strlen(name));
        if (here) s += 4;
        append(to, s, (size_t)(found - s));
    }
}

void text_free(text *to) {
    free(to->data);
    *to = (text){.data = NULL};
}

/* ---- numbers ---- */

void text_add_real(text *to, lg_dtype dtype, double value) {
    const double stored = dtype == LG_F32 ? (double)(float)value : value;
    char digits[40];
    if (!isfinite(stored)) to->unfit = true;
    (void)snprintf(digits, sizeof digits, "%.*g", dtype == LG_F32 ? 9 : 17, isfinite(stored) ? stored : 0.0);
    text_add(to, "%s%s%s", digits, strpbrk(digits, ".e") == NULL ? ".0" : "", dtype == LG_F32 ? "f" : "");
}

void text_add_reals(text *to, lg_dtype dtype, int indent, const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (i % 4 == 0) text_add(to, "%*s", indent, "");
        text_add_real(to, dtype, values[i]);
        text_add(to, "%s", i + 1 == count ? "\n" : i % 4 == 3 ? ",\n" : ", ");
    }
}

/* ---- foreign words ---- */

void text_add_literal(text *to, const char *value) {
    append(to, "\"", 1);
    for (const char *s = value; *s != '\0'; s++) {
        if (*s == '"' || *s == '\\' || *s == '?')
            text_add(to, "\\%c", *s);
        else if (*s >= ' ' && *s <= '~')
            append(to, s, 1);
        else
            text_add(to, "\\%03o", (unsigned)(unsigned char)*s);
    }
    append(to, "\"", 1);
}

/* The code point of a UTF-8 sequence of `length` bytes; 0 bytes: none. */
static unsigned long code_point(const unsigned char *s, size_t *length) {
    const size_t n = s[0] >= 0xc2 && s[0] <= 0xdf   ? 2
                     : s[0] >= 0xe0 && s[0] <= 0xef ? 3
                     : s[0] >= 0xf0 && s[0] <= 0xf4 ? 4
                                                    : 0;
    unsigned long code = n == 2 ? s[0] & 0x1fu : n == 3 ? s[0] & 0x0fu : s[0] & 0x07u;
    *length = n;
    for (size_t i = 1; i < n; i++) {
        if ((s[i] & 0xc0) != 0x80) *length = 0;
        if (*length == 0) return 0;
        code = code << 6 | (s[i] & 0x3fu);
    }
    return code;
}

/* Pairs that mean something in a comment (its end, another beginning, a trigraph) are kept apart by a blank;
 * a backslash never ends a line; control characters become blanks; what is not ASCII is written as a number.
 */
void text_add_comment(text *to, const char *value) {
    for (const unsigned char *s = (const unsigned char *)value; *s != '\0'; s++) {
        const char next = (char)s[1];
        if (*s >= 0x80) {
            size_t length;
            const unsigned long code = code_point(s, &length);
            if (length > 0)
                text_add(to, "<U+%04lX>", code);
            else
                text_add(to, "<%02X>", *s);
            s += length > 0 ? length - 1 : 0;
            continue;
        }
        text_add(to, "%c", *s == '\n' || (*s >= ' ' && *s != 0x7f) ? *s : ' ');
        if ((*s == '*' && next == '/') || (*s == '/' && next == '*') || (*s == '?' && next == '?'))
            append(to, " ", 1);
        if (*s == '\\' && (next == '\n' || next == '\0')) append(to, ".", 1);
    }
}
