/* What the programs print: no text of a file or command line reaches a terminal as a control character, and
 * none can begin a line or a cell of a table. */
#include "common/app.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "files/temporary.h"

bool app_is_harmless(uint32_t code) {
    static const uint32_t ranges[][2] = {{0, 0x1f},        {0x7f, 0x9f},     {0x61c, 0x61c},
                                         {0x200e, 0x200f}, {0x2028, 0x202e}, {0x2066, 0x2069},
                                         {0xfeff, 0xfeff}};
    bool harmless = code != LG_NO_CHARACTER;
    for (size_t i = 0; i < LG_COUNT(ranges); i++)
        harmless = harmless && !(code >= ranges[i][0] && code <= ranges[i][1]);
    return harmless;
}

enum { SHOWN = 4 }; /* bytes that show a byte */

/* Copies a character of `length` bytes if it is harmless, otherwise shows its bytes as \x1b. Returns the
 * number of bytes. */
static size_t show(char *to, const char *from, size_t length, uint32_t code) {
    const bool harmless = app_is_harmless(code);
    if (harmless) memcpy(to, from, length);
    for (size_t i = 0; i < length && !harmless; i++)
        (void)snprintf(to + SHOWN * i, SHOWN + 1, "\\x%02x", (unsigned)(unsigned char)from[i]);
    return harmless ? length : SHOWN * length;
}

/* ---- standard output and standard error ---- */

typedef struct screen {
    int fd;
    size_t held; /* bytes of a character whose end has not been printed yet */
    char rest[4];
} screen;
static screen screens[] = {{.fd = STDOUT_FILENO}, {.fd = STDERR_FILENO}};

/* Writes a text with its newlines and tabs; everything else that is not harmless is shown. Needs no memory,
 * since it prints that there is none. */
static ssize_t put_shown(void *user, const char *text, size_t size) {
    enum { PIECE = 4096 };
    screen *s = user;
    char piece[PIECE + sizeof s->rest], out[SHOWN * sizeof piece + 1];
    for (size_t done = 0, taken; done < size; done += taken) {
        size_t n = s->held, at = 0, used = 0, length;
        uint32_t code;
        taken = size - done < PIECE ? size - done : PIECE;
        memcpy(piece, s->rest, n);
        memcpy(piece + n, text + done, taken);
        for (n += taken; at < n && (length = lg_utf8(piece + at, n - at, &code)) > 0; at += length)
            if (code == '\n' || code == '\t')
                out[used++] = (char)code;
            else
                used += show(out + used, piece + at, length, code);
        s->held = n - at;
        memcpy(s->rest, piece + at, s->held);
        if (lg_write_all(s->fd, out, used) != 0) return 0;
    }
    return (ssize_t)size;
}

void app_screen_begin(void) {
    static char buffer[BUFSIZ];
    const cookie_io_functions_t functions = {.write = put_shown};
    FILE *out = fopencookie(&screens[0], "w", functions), *err = fopencookie(&screens[1], "w", functions);
    if (out == NULL || err == NULL) app_out_of_memory();
    (void)setvbuf(out, buffer, isatty(STDOUT_FILENO) == 1 ? _IOLBF : _IOFBF, sizeof buffer);
    (void)setvbuf(err, NULL, _IONBF, 0);
    stdout = out;
    stderr = err;
}

bool app_screen_flush(void) {
    bool whole = fflush(stdout) == 0 && ferror(stdout) == 0;
    for (size_t i = 0; i < LG_COUNT(screens); i++) {
        char out[SHOWN * sizeof screens[i].rest + 1];
        const size_t used = show(out, screens[i].rest, screens[i].held, LG_NO_CHARACTER);
        if (lg_write_all(screens[i].fd, out, used) != 0 && i == 0) whole = false;
        screens[i].held = 0;
    }
    return whole;
}

void app_screen_raw(const char *text) {
    (void)lg_write_all(STDERR_FILENO, text, strlen(text));
}

/* ---- lines and cells ---- */

/* Shows a text; `line` and `cell` are the bytes that become a newline and a tab, or 0. */
static char *shown(const char *text, char line, char cell) {
    char *out = app_alloc(SHOWN * strlen(text) + 1, 1), *to = out;
    uint32_t code;
    for (size_t length; *text != '\0'; text += length) {
        length = lg_utf8(text, SIZE_MAX, &code);
        if (line != '\0' && (*text == line || *text == cell))
            *to++ = *text == line ? '\n' : '\t';
        else
            to += show(to, text, length, code);
    }
    return out;
}

char *app_shown(const char *text) {
    return shown(text, '\0', '\0');
}

static char *format_list(const char *format, va_list arguments) {
    va_list again;
    va_copy(again, arguments);
    const int length = vsnprintf(NULL, 0, format, again);
    va_end(again);
    char *text = app_alloc((size_t)(length < 0 ? 0 : length) + 1, 1);
    (void)vsnprintf(text, (size_t)(length < 0 ? 0 : length) + 1, format, arguments);
    return text;
}

char *app_format(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char *text = format_list(format, arguments);
    va_end(arguments);
    return text;
}

/* Only newlines and tabs of the format may remain. So the format gets two other control characters in their
 * place, which do not occur in the arguments. Both become newlines and tabs at the end. */
char *app_words(const char *format, ...) {
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    APP_FREE char *text = format_list(format, arguments), *marked = app_format("%s", format);
    char marks[2];
    size_t found = 0;
    for (char c = 1; c < ' ' && found < 2; c++)
        if (c != '\n' && c != '\t' && strchr(text, c) == NULL) marks[found++] = c;
    for (char *c = marked; *c != '\0' && found == 2; c++)
        *c = *c == '\n' ? marks[0] : *c == '\t' ? marks[1] : *c;
    APP_FREE char *with = format_list(marked, again);
    va_end(again);
    va_end(arguments);
    return found == 2 ? shown(with, marks[0], marks[1]) : app_shown(with);
}

void app_put_words(FILE *to, char *words) {
    (void)fputs(words, to);
    free(words);
}

void app_note_words(const app *self, char *words) {
    (void)fprintf(stderr, "%s: %s\n", self->title, words);
    free(words);
}
