/* Plots, drawn by gnuplot: energy over time, and the histogram of latencies. */
#ifndef PLOTS_H
#define PLOTS_H

#include "latency.h"
#include "trial.h"

typedef struct histogram_series {
    const char *title;
    const samples *from;
} histogram_series;

/* Write energy.{dat,gp,svg} and latency.{dat,gp,svg} into `folder`, which must exist. Without gnuplot only
 * the .dat and .gp files are written, with a message on stderr. Return false if a file cannot be written. */
bool plot_energy(const char *folder, const trace *record, double target, double tolerance);
bool plot_latency(const char *folder, const histogram_series *series, int count);

#endif
