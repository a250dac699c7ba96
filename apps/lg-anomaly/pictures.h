/* Declarations that the pictures of lg-anomaly share. */
#ifndef LG_APPS_ANOMALY_PICTURES_H
#define LG_APPS_ANOMALY_PICTURES_H

#include "lg-anomaly/anomaly.h"

const char *class_colour(size_t i);
lg_status picture_begin(app_plot *plot, const char *picture, int width, int height, lg_error *error);
lg_status picture_end(const app *self, app_plot *plot, lg_error *error);
/* A gnuplot string in double quotes, as text: no markup. */
void put_text(FILE *script, const char *text);

#endif
