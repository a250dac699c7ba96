/* For detectors and classical classifiers, which map windows of sensor data to a class. */
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

/* Writes sizes of the window for NAME.h, NAME_classify and NAME_class_names. */
void export_window_code(export_source *source, const export_window *window);
/* Describes x, channel by channel, and the classes. */
void export_window_words(export_source *source, const export_window *window);
void export_window_score_words(text *to, const export_window *window);
/* Allocates golden vectors; fewer than options->golden when windows are large. */
void export_window_golden(export_source *source, size_t extras, const char *extra_name);
/* A number that is exact in the exported type and in float, the type of recorded windows. */
float export_window_number(const export_source *source, double value);
/* Whether the best score exceeds the others by more than rounding. */
bool export_window_clear(const double *score, uint32_t classes);
/* Refuses, with a sentence, code whose indices would exceed 2^31. Returns an exit code. */
int export_window_check(const app *self, const export_source *source, double largest);

#endif
