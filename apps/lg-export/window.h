/* Export of models that map windows of sensor data to a class: detectors and classical classifiers. */
#ifndef LG_EXPORT_WINDOW_H
#define LG_EXPORT_WINDOW_H

#include "liegrad/series.h"

#include "lg-export/export.h"

typedef struct export_window {
    lg_series names; /* Channels, length and classes with their names, and the rate; no samples. */
    /* Name of the class that means "all is well", as stored with the model; "" if unknown. NULL: the classes
     * of the model have no such meaning. */
    const char *healthy;
    const char *scores;      /* What the scores of the classes are; NULL: "probabilities". */
    const char *score_words; /* Lines about the scores for the comment of NAME_classify. */
} export_window;

/* Adds the sizes of the window to NAME.h, and adds NAME_classify and NAME_class_names. */
void export_window_code(export_source *source, const export_window *window);
/* Writes the description of the window x into the comment of the exported header: its channels and their
 * units. */
void export_window_words(export_source *source, const export_window *window);
void export_window_score_words(text *to, const export_window *window);
/* Allocates the golden vectors; fewer than options->golden if windows are large. `further`: how many further
 * results each will have. */
void export_window_golden(export_source *source, size_t further);
/* Returns whether the best score exceeds all others by more than rounding (1e-3). */
bool export_window_clear(const double *score, uint32_t classes);
/* Refuses, with a message, a model whose C code would need indices of 2^31 or more. */
void export_window_check(const app *self, const export_source *source, double largest);

#endif
