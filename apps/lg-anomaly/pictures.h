/* Declarations that the pictures of lg-anomaly share. */
#ifndef LG_APPS_ANOMALY_PICTURES_H
#define LG_APPS_ANOMALY_PICTURES_H

#include "lg-anomaly/anomaly.h"

const char *class_colour(size_t i);
/* A gnuplot string in double quotes, as text: no markup. */
void put_text(FILE *script, const char *text);

#endif
