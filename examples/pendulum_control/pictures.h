/* Energy against time and the histogram of latencies, drawn by gnuplot. */
#ifndef PICTURES_H
#define PICTURES_H

#include "latency.h"
#include "trial.h"

typedef struct histogram_series {
    const char *title;
    const samples *from;
} histogram_series;

/* Folder `folder` (which exists) gets energy.{dat,gp,svg} and latency.{dat,gp,svg}; without gnuplot the first
 * two of each, and a sentence on stderr. False when a file cannot be written. */
bool picture_energy(const char *folder, const trace *record, double target, double tolerance);
bool picture_latency(const char *folder, const histogram_series *series, int count);

#endif
