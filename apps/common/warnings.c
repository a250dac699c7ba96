/* Warnings: each sentence is printed on stderr once and kept for JSON. */
#include <pthread.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "common/app.h"

enum { KEPT = 64 };

struct app_warnings {
    pthread_mutex_t lock;
    size_t count;
    char *sentences[KEPT];
};

app_warnings *app_warnings_create(void) {
    app_warnings *self = app_alloc(1, sizeof *self);
    (void)pthread_mutex_init(&self->lock, NULL);
    return self;
}

void app_warnings_destroy(app_warnings *self) {
    for (size_t i = 0; i < self->count; i++) free(self->sentences[i]);
    (void)pthread_mutex_destroy(&self->lock);
    free(self);
}

/* Prints the sentence unless it is already kept, and takes ownership of it. */
static void tell(const app *host, app_warnings *self, char *sentence) {
    (void)pthread_mutex_lock(&self->lock);
    size_t i = 0;
    while (i < self->count && strcmp(self->sentences[i], sentence) != 0) i++;
    const bool fresh = i == self->count, room = i < KEPT;
    if (fresh) app_note(host, "warning: %s", sentence);
    if (fresh && room) self->sentences[self->count++] = sentence;
    (void)pthread_mutex_unlock(&self->lock);
    if (!fresh || !room) free(sentence);
}

void app_warn(const app *self, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char *sentence = app_format_list(format, arguments);
    va_end(arguments);
    tell(self, self->warnings, sentence);
}

void app_json_warnings(app_json *json, const app *self) {
    app_json_open(json, "warnings", '[');
    for (size_t i = 0; i < self->warnings->count; i++)
        app_json_text(json, NULL, self->warnings->sentences[i]);
    app_json_close(json, ']');
}
