#include "core/text.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "core/bytes.h"
#include "core/clean.h"
#include "core/widen.h"

void lg_text_append(lg_text *to, const char *data, size_t length) {
    if (to->failed) return;
    if (to->length + length + 1 > to->room) {
        const size_t room = 2 * to->room + length + 256;
        char *grown = lg_widen(to->context, to->data, to->length, room, 1);
        to->failed = grown == NULL;
        if (to->failed) return;
        to->data = grown;
        to->room = room;
    }
    memcpy(to->data + to->length, data, length);
    to->length += length;
    to->data[to->length] = '\0';
}

void lg_text_add_bytes(lg_text *to, size_t count, uint64_t bits) {
    unsigned char bytes[8];
    lg_bytes_put(bytes, count, bits);
    lg_text_append(to, (const char *)bytes, count);
}

void lg_text_join(lg_text *to, const lg_text *from) {
    if (from->length > 0) lg_text_append(to, from->data, from->length);
    to->unfit = to->unfit || from->unfit;
    to->failed = to->failed || from->failed;
    to->lost += from->lost;
}

void lg_text_add(lg_text *to, const char *format, ...) {
    char small[256];
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    const int length = lg_format_list(small, sizeof small, format, arguments);
    va_end(arguments);
    if (length >= 0 && (size_t)length < sizeof small) {
        lg_text_append(to, small, (size_t)length);
    } else if (length > 0) {
        LG_SCRATCH(char, large, to->context, (size_t)length + 1);
        if (large != NULL) (void)lg_format_list(large, (size_t)length + 1, format, again);
        to->failed = to->failed || large == NULL;
        lg_text_append(to, large, (size_t)length);
    }
    va_end(again);
}

const char *lg_named_text_of(const lg_named_text *texts, const char *name) {
    while (texts->name != NULL && strcmp(texts->name, name) != 0) texts++;
    return texts->text;
}

bool lg_in_word(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

bool lg_is_word(const char *text) {
    const char *c = text;
    while (lg_in_word(*c)) c++;
    return c > text && *c == '\0';
}

void lg_text_add_named(lg_text *to, const char *name, const char *code) {
    for (const char *s = code, *found; *s != '\0'; s = found) {
        found = strstr(s + 1, "NAME_");
        if (found == NULL) found = s + strlen(s);
        const bool here = strncmp(s, "NAME_", 5) == 0 && (s == code || !lg_in_word(s[-1]));
        if (here) lg_text_append(to, name, strlen(name));
        if (here) s += 4;
        lg_text_append(to, s, (size_t)(found - s));
    }
}

void lg_text_destroy(lg_text *to) {
    lg_free(to->context, to->data);
    *to = (lg_text){.context = to->context};
}

/* ---- numbers ---- */

bool lg_is_lost(lg_dtype dtype, double value) {
    return dtype == LG_F32 && fabs(value) < (double)FLT_MIN && (double)(float)value != value;
}

void lg_text_add_real(lg_text *to, lg_dtype dtype, double value) {
    const double stored = dtype == LG_F32 ? (double)(float)value : value;
    char digits[40];
    if (!isfinite(stored)) to->unfit = true;
    if (lg_is_lost(dtype, value)) to->lost++;
    (void)lg_format(digits, sizeof digits, "%.*g", dtype == LG_F32 ? 9 : 17, isfinite(stored) ? stored : 0.0);
    lg_text_add(to, "%s%s%s", digits, strpbrk(digits, ".e") == NULL ? ".0" : "", dtype == LG_F32 ? "f" : "");
}

void lg_text_add_reals(lg_text *to, lg_dtype dtype, int indent, const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (i % 4 == 0) lg_text_add(to, "%*s", indent, "");
        lg_text_add_real(to, dtype, values[i]);
        lg_text_add(to, "%s", i + 1 == count ? "\n" : i % 4 == 3 ? ",\n" : ", ");
    }
}

void lg_text_add_hex_line(lg_text *to, lg_dtype dtype, const double *values, size_t count) {
    lg_text_add(to, "    ");
    for (size_t i = 0; i < count; i++) {
        lg_text_add_real(to, dtype, values[i]);
        lg_text_add(to, i + 1 < count ? ", " : ",\n");
    }
    lg_text_add(to, "    /* ");
    for (size_t i = 0; i < count; i++)
        lg_text_add(to, "%a ", dtype == LG_F32 ? (double)(float)values[i] : values[i]);
    lg_text_add(to, "*/\n");
}

/* ---- words, literals and comments ---- */

void lg_text_add_word(lg_text *to, const char *word) {
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_@%+=:,./-";
    const bool quoted = *word == '\0' || word[strspn(word, plain)] != '\0';
    if (quoted) lg_text_append(to, "'", 1);
    for (; *word != '\0'; word++) lg_text_append(to, *word == '\'' ? "'\\''" : word, *word == '\'' ? 4 : 1);
    if (quoted) lg_text_append(to, "'", 1);
}

void lg_text_add_literal(lg_text *to, const char *value) {
    lg_text_append(to, "\"", 1);
    for (const char *s = value; *s != '\0'; s++) {
        if (*s == '"' || *s == '\\' || *s == '?')
            lg_text_add(to, "\\%c", *s);
        else if (*s >= ' ' && *s <= '~')
            lg_text_append(to, s, 1);
        else
            lg_text_add(to, "\\%03o", (unsigned)(unsigned char)*s);
    }
    lg_text_append(to, "\"", 1);
}

size_t lg_utf8(const char *text, size_t left, uint32_t *code) {
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    const unsigned char *s = (const unsigned char *)text;
    const size_t n = s[0] < 0x80                    ? 1
                     : s[0] >= 0xc2 && s[0] <= 0xdf ? 2
                     : s[0] >= 0xe0 && s[0] <= 0xef ? 3
                     : s[0] >= 0xf0 && s[0] <= 0xf4 ? 4
                                                    : 0;
    uint32_t number = n > 1 ? s[0] & 0x7fu >> n : s[0];
    size_t i = 1;
    for (; i < n && i < left && (s[i] & 0xc0) == 0x80; i++) number = number << 6 | (s[i] & 0x3fu);
    if (i < n && i == left) return 0;
    const bool sound = n > 0 && i == n && number >= least[n] && number <= 0x10ffff && number >> 11 != 0x1b;
    *code = sound ? number : LG_NO_CHARACTER;
    return sound ? n : 1;
}

bool lg_tame(char *text) {
    bool wild = false;
    for (size_t length; *text != '\0'; text += length) {
        uint32_t code;
        length = lg_utf8(text, SIZE_MAX, &code);
        const bool shown = code != LG_NO_CHARACTER && code >= ' ' && (code < 0x7f || code > 0x9f);
        if (!shown) *text = '?', length = 1;
        wild = wild || !shown;
    }
    return wild;
}

/* Pairs that have a meaning in a comment (its end, another beginning, a trigraph) are separated by a blank. A
 * point follows a backslash at the end of a line. Control characters become blanks. Characters outside ASCII
 * are written as numbers. */
void lg_text_add_comment(lg_text *to, const char *value) {
    for (const unsigned char *s = (const unsigned char *)value; *s != '\0'; s++) {
        const char next = (char)s[1];
        if (*s >= 0x80) {
            uint32_t code;
            const size_t length = lg_utf8((const char *)s, SIZE_MAX, &code);
            if (code != LG_NO_CHARACTER)
                lg_text_add(to, "<U+%04X>", code);
            else
                lg_text_add(to, "<%02X>", *s);
            s += length - 1;
            continue;
        }
        lg_text_add(to, "%c", *s == '\n' || (*s >= ' ' && *s != 0x7f) ? *s : ' ');
        if ((*s == '*' && next == '/') || (*s == '/' && next == '*') || (*s == '?' && next == '?'))
            lg_text_append(to, " ", 1);
        if (*s == '\\' && (next == '\n' || next == '\0')) lg_text_append(to, ".", 1);
    }
}

void lg_name_list_add(lg_name_list *names, const char *name) {
    const size_t room = sizeof names->text - names->used, length = strlen(name);
    if (room < 8) return;
    const bool fits = length + 8 <= room;
    const int added =
        snprintf(names->text + names->used, room, "%s%s", names->used > 0 ? ", " : "", fits ? name : "...");
    names->used = fits ? names->used + (size_t)added : sizeof names->text;
}
