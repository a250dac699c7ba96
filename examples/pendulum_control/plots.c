#include "plots.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

enum { PATH = 1024, DECADE_BINS = 10, DECADES = 7 }; /* bins from 10 ns to 100 ms */

/* The scripts are constants, and take numbers and titles from the data. So nothing in these is taken for a
 * command. File names begin with ./, because gnuplot starts a program if a name begins with < or |. */
static const char energy_script[] =
    "set terminal svg size 900,760 dynamic background rgb 'white' font 'Helvetica,13'\n"
    "set output './energy.svg'\n"
    "set grid lc rgb '#dddddd'\n"
    "set border lc rgb '#555555'\n"
    "data = './energy.dat'\n"
    "stats data using 6 nooutput\n"
    "set multiplot layout 3,1\n"
    "set lmargin 10\n"
    "set rmargin 3\n"
    "set key bottom right\n"
    "set ylabel 'energy / mgL'\n"
    "plot 1 lc rgb '#999999' dt 2 title 'upright at rest', \\\n"
    "    data using 1:3 with lines lw 3 lc rgb '#7fb3d5' title 'true H', \\\n"
    "    data using 1:($2+1) with lines lw 1 lc rgb '#922b21' title 'learned H'\n"
    "set ylabel 'torque / mgL'\n"
    "set yrange [0:*]\n"
    "set offsets 0, 0, 0.02, 0\n"
    "plot data using 1:5 with lines lc rgb '#1e8449' title '|torque|'\n"
    "unset offsets\n"
    "set key top right\n"
    "set ylabel 'angle to the vertical / rad'\n"
    "set xlabel 't / s'\n"
    "set logscale y\n"
    "set yrange [*:10]\n"
    "set format y '10^{%L}'\n"
    "plot STATS_max lc rgb '#999999' dt 2 title 'bound in the last seconds', \\\n"
    "    data using 1:4 with lines lw 2 lc rgb '#922b21' title 'angle'\n"
    "unset multiplot\n";
static const char latency_script[] =
    "set terminal svg size 900,480 dynamic background rgb 'white' font 'Helvetica,13'\n"
    "set output './latency.svg'\n"
    "set grid lc rgb '#dddddd'\n"
    "set border lc rgb '#555555'\n"
    "data = './latency.dat'\n"
    "stats data using 1 nooutput\n"
    "set logscale xy\n"
    "set key outside bottom center horizontal noenhanced\n"
    "set xlabel 'us'\n"
    "set ylabel 'fraction of the steps in a tenth of a decade'\n"
    "set xrange [0.01:1e5]\n"
    "set yrange [1e-6:1]\n"
    "set format y '10^{%L}'\n"
    "colour(s) = word('#922b21 #d68910 #999999 #7fb3d5 #1e8449', s % 5 + 1)\n"
    "plot for [s = 0:STATS_blocks - 1] data index s using 1:2 with steps lw 2 lc rgb colour(s) title "
    "columnheader(1)\n";

static FILE *open_in(const char *folder, const char *name) {
    char path[PATH];
    FILE *stream = NULL;
    if (snprintf(path, sizeof path, "%s/%s", folder, name) < PATH) stream = fopen(path, "w");
    if (stream == NULL) (void)fprintf(stderr, "%s/%s cannot be written: %s\n", folder, name, strerror(errno));
    return stream;
}

static bool close_whole(FILE *stream) {
    const bool whole = ferror(stream) == 0;
    return fclose(stream) == 0 && whole;
}

/* Writes the script NAME.gp and runs it with gnuplot in the folder. */
static bool draw_by_script(const char *folder, const char *name, const char *text) {
    char file[PATH];
    int status = 127 << 8;
    (void)snprintf(file, sizeof file, "./%s.gp", name);
    FILE *script = open_in(folder, file);
    if (script == NULL) return false;
    (void)fputs(text, script);
    if (!close_whole(script)) return false;
    const pid_t child = fork();
    if (child == 0) {
        if (chdir(folder) == 0) (void)execlp("gnuplot", "gnuplot", "-d", file, (char *)NULL);
        _exit(127);
    }
    while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        (void)fprintf(stderr, "gnuplot did not draw %s.svg; %s/%s.gp and %s.dat are there\n", name, folder,
                      name, name);
    return true;
}

bool plot_energy(const char *folder, const trace *record, double target, double tolerance) {
    FILE *data = open_in(folder, "energy.dat");
    if (data == NULL) return false;
    (void)fputs("# t learned_energy energy angle torque tolerance\n", data);
    for (size_t i = 0; i < record->count; i++) {
        const trace_row *row = record->rows + i;
        (void)fprintf(data, "%.9g %.9g %.9g %.9g %.9g %.9g\n", row->t, row->learned - target, row->energy,
                      row->angle, row->torque, tolerance);
    }
    return close_whole(data) && draw_by_script(folder, "energy", energy_script);
}

/* Fraction of the samples in each bin. A bin is a tenth of a decade wide; the first one begins at 10 ns.
 * Samples outside count in the outermost bins. */
static void bin(const samples *from, double *fraction) {
    for (int i = 0; i < DECADES * DECADE_BINS; i++) fraction[i] = 0.0;
    for (size_t i = 0; i < from->count; i++) {
        const double at = from->ns[i] > 10 ? floor(DECADE_BINS * (log10((double)from->ns[i]) - 1.0)) : 0.0;
        fraction[(int)fmin(at, DECADES * DECADE_BINS - 1)] += 1.0 / (double)from->count;
    }
}

bool plot_latency(const char *folder, const histogram_series *series, int count) {
    FILE *data = open_in(folder, "latency.dat");
    if (data == NULL) return false;
    (void)fputs("# for each title: left end of the bin in us, fraction\n", data);
    for (int s = 0; s < count; s++) {
        double fraction[DECADES * DECADE_BINS];
        bin(series[s].from, fraction);
        (void)fprintf(data, "%s\"%s\"\n", s > 0 ? "\n\n" : "", series[s].title);
        for (int i = 0; i < DECADES * DECADE_BINS; i++)
            (void)fprintf(data, "%.6g %.6g\n", 1e-2 * pow(10.0, (double)i / DECADE_BINS),
                          fmax(fraction[i], 1e-9));
        (void)fprintf(data, "%.6g %.6g\n", 1e-2 * pow(10.0, DECADES), 1e-9);
    }
    return close_whole(data) && draw_by_script(folder, "latency", latency_script);
}
