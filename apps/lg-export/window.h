/* What detectors and classical classifiers have in common: windows of sensor data in, a class out. */
#ifndef LG_EXPORT_WINDOW_H
#define LG_EXPORT_WINDOW_H

#include "lg-export/export.h"

typedef struct export_window {
    uint32_t channels, length, classes;
    double rate;                          /* Hz; 0: unknown */
    char (*class_name)[LG_SERIES_NAME];   /* (classes) */
    char (*channel_name)[LG_SERIES_NAME]; /* (channels) or NULL */
    double accuracy, f1;                  /* on the test part; NaN: unknown */
    const char *scores;                   /* "probabilities" */
    const char *score_words;              /* lines of the comment of NAME_classify on them */
} export_window;

/* Sizes of the window for NAME.h, NAME_classify and NAME_class_names. */
void export_window_code(export_source *source, const export_window *window);
/* What x is, channel by channel, and the classes. */
void export_window_words(export_source *source, const export_window *window);
void export_window_score_words(text *to, const export_window *window);
/* Sets up golden vectors: as many as were asked for, or fewer when windows are large. */
void export_window_golden(export_source *source, size_t extras, const char *extra_name);
/* The same number in the exported type and in float, as which windows are recorded. */
float export_window_number(const export_source *source, double value);
/* Whether the best score is above the others by more than rounding. */
bool export_window_clear(const double *score, uint32_t classes);
/* LG_UNSUPPORTED, told, where indices of the code would be beyond 2^31. An exit code. */
int export_window_check(const app *self, const export_source *source, double largest);

#endif
