/* Warnings: each sentence is printed on stderr once and kept for JSON. */
#include <pthread.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "common/app.h"

enum { KEPT = 64 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static size_t count;
static char *sentences[KEPT];

void app_warn(const app *self, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char *sentence = app_format_list(format, arguments);
    va_end(arguments);
    (void)pthread_mutex_lock(&lock);
    size_t i = 0;
    while (i < count && strcmp(sentences[i], sentence) != 0) i++;
    if (i == count) app_note(self, "warning: %s", sentence);
    if (i == count && i < KEPT)
        sentences[count++] = sentence;
    else
        free(sentence);
    (void)pthread_mutex_unlock(&lock);
}

void app_json_warnings(app_json *json, const app *self) {
    (void)self;
    app_json_open(json, "warnings", '[');
    for (size_t i = 0; i < count; i++) app_json_text(json, NULL, sentences[i]);
    app_json_close(json, ']');
}
