/* Declarations that the files with lg-anomaly's pictures share. */
#ifndef LG_APPS_ANOMALY_PICTURES_H
#define LG_APPS_ANOMALY_PICTURES_H

#include "lg-anomaly/anomaly.h"

const char *class_colour(size_t i);
/* Writes text as a gnuplot string in double quotes, without interpretation of markup. */
void put_text(FILE *script, const char *text);

#endif
